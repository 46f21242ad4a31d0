"""A wrong length is named by what is found without it, in closed form; right ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from mixed_session import reached, unit
from plain_jacobian import plain_jacobian
from truearm.arm import load_arm
from truearm.identification.estimation.identification import identify, initial_problem
from truearm.identification.estimation.linearisation import UNKNOWN_STD
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.outliers import MAX_NORMALIZED_RESIDUAL, constraint_residuals, length_outliers
from truearm.identification.references.references import seats_of
from truearm.identification.references.surfaces import spheres_of
from truearm.identification.terms import ArmState, constants

U_MM, WRONG_MM = 0.002, 0.5
PAIRS = [("A", "B"), ("C", "D"), ("A", "C"), ("B", "D"), ("A", "D")]


@pytest.fixture(scope="module")
def held():
    """An arm off its drawing in four seats of ten poses each, and twice around a ball; true lengths between seats."""
    rng = np.random.default_rng(4)
    arm = load_arm("gao2017")
    terms = constants(arm.chain, free=("tip",))
    off = [rng.normal(0, 3e-4 if max(map(abs, term.direction[:3])) else 0.1) for term in terms]  # rad, mm
    chain = PerturbedChain(arm.chain, tuple(terms)).with_constants(np.array(off))
    middle = arm.chain.tip_in_base(arm.working[None])[0]
    places = middle + rng.uniform([-300, -200, -100], [100, 200, 100], (6, 3))
    on_ball = np.repeat(places[4:], 12, axis=0) + 28.0 * unit(rng.normal(size=(24, 3)))
    angles = reached(arm, chain, np.concatenate([np.repeat(places[:4], 10, axis=0), on_ball]), rng)
    state = ArmState(arm.chain, angles + rng.normal(0, 3e-6, angles.shape))
    lengths = [float(np.linalg.norm(places["ABCD".index(b)] - places["ABCD".index(a)])) for a, b in PAIRS]
    return state, terms, np.array(lengths) + rng.normal(0, U_MM, len(PAIRS))


def references(lengths, *, ball=28.0):
    stated = [(*pair, float(length), U_MM) for pair, length in zip(PAIRS, lengths, strict=True)]
    seats = seats_of(np.arange(40), np.repeat(list("ABCD"), 10), stated)
    return [seats, spheres_of(np.arange(40, 64), np.repeat(["E", "F"], 12), [("E", ball, 0.01), ("F", ball, 0.01)])]


def test_right_lengths_are_not_named(held):
    state, terms, lengths = held
    known = references(lengths)
    fit = identify(state.chain, state, terms, known)
    assert length_outliers(fit, state, known) == []
    assert length_outliers(identify(state.chain, state, terms, bare(known)), state, bare(known)) == []


def bare(known):
    return [replace(known[0], lengths=()), replace(known[1], radii=())]


def test_the_wrong_length_alone_is_named(held):
    state, terms, lengths = held
    lengths = lengths.copy()
    lengths[1] += WRONG_MM
    known = references(lengths)
    (found,) = length_outliers(identify(state.chain, state, terms, known), state, known)
    assert found.name == "length between seats C and D"
    assert found.error_mm == pytest.approx(WRONG_MM, abs=0.05)  # of seats that it has torn by tenths
    assert found.normalized_residual > MAX_NORMALIZED_RESIDUAL


def test_a_wrong_distance_is_named_as_that_of_all_its_spheres(held):
    state, terms, lengths = held
    known = references(lengths, ball=28.2)
    found = length_outliers(identify(state.chain, state, terms, known), state, known)
    assert [one.name for one in found] == ["distance of spheres of 28.2 mm"]
    assert found[0].error_mm == pytest.approx(0.2, abs=0.02)


def test_closed_form_is_that_of_a_fit_without(held):
    """The residual of each length in a fit without it; noise found anew and small steps left make a difference."""
    state, terms, lengths = held
    known = references(lengths)
    fit = identify(state.chain, state, terms, known, robust=False)
    told = constraint_residuals(fit, state, known, known)
    white = 1 - told.covariance.diagonal() / told.std**2
    for left_out in range(len(PAIRS)):
        kept = tuple(length for i, length in enumerate(known[0].lengths) if i != left_out)
        without = [replace(known[0], lengths=kept), known[1]]
        there = constraint_residuals(identify(state.chain, state, terms, without, robust=False), state, without, known)
        std = np.sqrt(there.covariance[left_out, left_out] + told.std[left_out] ** 2)
        assert told.residuals[left_out] / white[left_out] == pytest.approx(there.residuals[left_out], abs=0.1 * std)
        assert told.std[left_out] / np.sqrt(white[left_out]) == pytest.approx(std, rel=0.1)


def test_the_covariance_is_that_of_the_whole_matrix(held):
    """All unknowns at once, none eliminated."""
    state, terms, lengths = held
    known = references(lengths)
    fit = identify(state.chain, state, terms, known)
    told = constraint_residuals(fit, state, known, known)
    problem, _ = initial_problem(fit.perturbed_chain, state, known)
    x = np.concatenate([fit.coefficients, *(list(part.unknowns.values()) for part in fit.references)])
    weights = [np.sqrt(part.robust_weight / (part.std**2 + part.noise_std**2)) for part in fit.references]
    J = np.hstack([(j * w).reshape(len(x), -1) for j, w in zip(plain_jacobian(problem, x), weights, strict=True)])
    n = len(fit.coefficients)
    by = np.zeros((len(told.names), len(x)))
    start = 0
    for i, reference in enumerate(known):
        own = reference.constraints(x[problem.unknowns_of(i)]).by_unknown
        by[start : start + len(own), problem.unknowns_of(i)] = own
        start += len(own)
    prior = np.concatenate([fit.prior_std, np.full(len(x) - n, UNKNOWN_STD)])
    W = by / told.std[:, None]
    scale = 1 / np.sqrt((J**2).sum(axis=1) + (W**2).sum(axis=0) + prior**-2)
    matrix = (J @ J.T + W.T @ W + np.diag(prior**-2)) * scale * scale[:, None]
    expected = by * scale @ np.linalg.solve(matrix, (by * scale).T)
    np.testing.assert_allclose(told.covariance, expected, rtol=1e-5, atol=1e-6 * U_MM**2)
