"""Artefacts' unknowns eliminated, seat by seat and sphere by sphere: the same numbers as by dense normal equations."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.identification.estimation.identification import grouped_prior, identify
from truearm.identification.estimation.linearisation import eliminate_unknowns
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.references.references import Length, Points, Seats
from truearm.identification.references.surfaces import planes_of, spheres_of
from truearm.identification.terms import ArmState, candidate_terms, constants
from truearm.solve.group_evidence import posterior


@pytest.mark.parametrize("seed", [1, 2])
def test_posterior_of_coefficients_and_unknowns_is_that_of_the_dense_matrix(seed):
    """Points; seats, some a bar apart that stood in several places, one with a length of its own; spheres; planes."""
    rng = np.random.default_rng(seed)
    arm = load_arm("gao2017")
    state = ArmState(arm.chain, arm.working + 0.8 * rng.uniform(-1, 1, (150, 6)))
    terms, _ = candidate_terms(state, free=("tip",), highest=16)
    perturbed_chain = PerturbedChain(arm.chain, tuple(terms))
    tips = arm.chain.tip_in_base(state.angles)
    rows = np.arange(150)
    lengths = [Length(2 * i, 2 * i + 1, 200.0, 0.002, "bar", 0.001) for i in range(6)] + [Length(11, 12, 300.0, 0.01)]
    seats = Seats(rows[20:90], rng.permutation(np.arange(70) % 20), tuple(f"s{i}" for i in range(20)), tuple(lengths))
    names = rng.permutation(np.array(["a", "b", "c"])[np.arange(30) % 3])
    started = [
        reference.initialise(tips[reference.rows].T)
        for reference in (
            Points(rows[:20], tips[:20] + rng.normal(size=(20, 3))),
            seats,
            spheres_of(rows[90:120], names, [("b", 100.0, 0.1)]),
            planes_of(rows[120:], names),
        )
    ]
    problem = SmallMotionProblem(perturbed_chain, state, tuple(reference for reference, _ in started))
    x = np.concatenate([np.zeros(perturbed_chain.n_coefficients), *(unknowns for _, unknowns in started)])
    weights = [rng.uniform(20, 50, residual.shape) for residual in problem.residuals(x)]
    parts, whole = problem.equations(x, weights)
    prior, _ = grouped_prior(terms, len(x) - perturbed_chain.n_coefficients)
    left = eliminate_unknowns(parts, whole, x)
    assert len(left.kept) == perturbed_chain.n_coefficients + 1  # the bar's length stays
    gram = whole.dense()
    dense = posterior(gram, gram @ x - whole.gradient, prior)
    found = posterior(left.gram, left.gram @ x[left.kept] - left.gradient, prior.subset(left.kept), size=left.size)
    std = np.sqrt(dense.covariance.diagonal())
    kept = left.kept
    # With priors of some metres, in which tip and last link are equivalent, Cholesky's factors are accurate to a few
    # 1e-9, depending on the number of BLAS threads.
    np.testing.assert_allclose(
        found.covariance / np.outer(std[kept], std[kept]),
        dense.covariance[np.ix_(kept, kept)] / np.outer(std[kept], std[kept]),
        atol=5e-9,
    )
    step, expected = left.step(found.x - x[kept]), dense.x - x
    np.testing.assert_allclose((step - expected) / std, 0, atol=1e-9 * np.linalg.norm(expected / std))
    own = [np.r_[: perturbed_chain.n_coefficients, problem.unknowns_of(i)] for i in range(len(parts))]
    np.testing.assert_allclose(
        left.traces(parts, found.covariance),
        [np.vdot(part.dense(), dense.covariance[np.ix_(at, at)]) for part, at in zip(parts, own, strict=True)],
        rtol=1e-8,
    )


def test_hundreds_of_seats_are_identified(rng):
    """300 seats of two readings, 900 unknowns, and 30 points: constants err by what their uncertainty says."""
    arm = load_arm("gao2017")
    terms = [replace(term, learn=False) for term in constants(arm.chain, free=(), angle_std=1e-3, length_std=0.5)]
    x = np.concatenate([term.prior_stds for term in terms]) * rng.normal(size=len(terms))
    chain = PerturbedChain(arm.chain, tuple(terms)).with_constants(x)
    first = arm.working + 0.8 * rng.uniform(-1, 1, (330, 6))
    again = solve_inverse_kinematics(
        chain, chain.tip_in_base(first[:300]), start=first[:300] + rng.normal(0, 0.3, (300, 6))
    )
    angles = np.concatenate([first, again.angles])
    reached = np.r_[np.flatnonzero(again.reached), 330 + np.flatnonzero(again.reached)]
    seats = Seats(reached, reached % 330, tuple(str(i) for i in range(300)))
    assert again.reached.all()
    points = Points(np.arange(300, 330), chain.tip_in_base(first[300:]) + rng.normal(0, 0.01, (30, 3)))
    state = ArmState(arm.chain, angles + rng.normal(0, 1e-5, angles.shape))
    fit = identify(arm.chain, state, terms, [points, seats])
    assert fit.converged
    # 45 constants: their mean square, in standard deviations, lies within 1 +- 4 sqrt(2 / 45).
    wrong = fit.coefficients - x
    assert wrong @ np.linalg.solve(fit.covariance, wrong) / len(x) < 1 + 4 * np.sqrt(2 / len(x))
    assert 0.003 < fit.references[1].noise_std < 0.02  # 1e-5 rad at half a metre or so
