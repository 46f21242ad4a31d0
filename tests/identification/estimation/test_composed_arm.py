"""Laws of an arm with constant motions: its derivatives are those of the arm, and its repeated columns say nothing."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.chain import Chain
from truearm.identification.estimation.covariance_root import CovarianceRoot
from truearm.identification.estimation.identification_result import ComposedArm
from truearm.identification.estimation.perturbed_chain import CHUNK, PerturbedChain
from truearm.identification.terms import ArmState, Constant, Expression, Harmonics, Term, candidate_terms
from truearm.identification.terms.basis import Formula
from truearm.typing import FloatArray

UR10 = load_arm("ur10").chain
SLIDING = replace(UR10, prismatic=np.arange(6) == 2)
COUPLED = replace(UR10, coupling=np.eye(6) + 0.1 * np.eye(6, k=-1))


def state_of(chain: Chain, n: int) -> ArmState:
    rng = np.random.default_rng(n)
    return ArmState(chain, rng.uniform(-6, 6, (n, 6)), directions=rng.choice([-1.0, 1.0], (n, 6)))


def arm_of(chain: Chain) -> PerturbedChain:
    """An arm with every kind of term, and constants of all six motions, at the tip too."""
    terms, _ = candidate_terms(state_of(chain, 2), highest=3)
    turns = [Term("t", 7, tuple(np.eye(6)[axis]), Constant(), "tip", 1.0) for axis in range(3)]
    return PerturbedChain(chain, (*terms, *turns))


def constants_of(arm: PerturbedChain) -> FloatArray:
    """Coefficients of constants, rotations of a tenth of a radian; others are zero."""
    is_constant = np.repeat(
        [isinstance(term.basis, Constant) for term in arm.terms], [term.n_coefficients for term in arm.terms]
    )
    return np.where(is_constant, np.random.default_rng(1).normal(0, 0.1, arm.n_coefficients), 0.0)


@pytest.mark.parametrize("n", [1, CHUNK + 3])
@pytest.mark.parametrize("chain", [UR10, SLIDING, COUPLED], ids=["ur10", "sliding", "coupled"])
def test_its_derivatives_are_those_of_the_arm(chain, n):
    arm, state = arm_of(chain), state_of(chain, n)
    x = constants_of(arm)
    of_arm, composed = arm.site_derivatives(state, x), ComposedArm.of(arm, x).site_derivatives(state)
    for (rows, tips, along, values), (own_rows, own_tips, own_along, own_values) in zip(of_arm, composed, strict=True):
        assert own_rows == rows
        # mm, and mm per rad: of lengths of metres rounding is 1e-12.
        np.testing.assert_allclose(own_tips, tips, rtol=0, atol=1e-10)
        np.testing.assert_allclose(own_along, along, rtol=0, atol=1e-10)
        np.testing.assert_array_equal(own_values, values)


@pytest.mark.parametrize("known", ["none", "third", "rank"])
@pytest.mark.parametrize("chain", [UR10, SLIDING, COUPLED], ids=["ur10", "sliding", "coupled"])
def test_without_its_repeated_columns_tips_have_the_same_covariance(chain, known):
    """At poses that were not compared; where coefficients are known, and known together, too."""
    arm, state, rng = arm_of(chain), state_of(chain, 100), np.random.default_rng(2)
    p = arm.n_coefficients
    rows = rng.normal(size=(p // 3 if known == "rank" else p + 3, p)) * 10 ** rng.uniform(-4, 1, p)
    if known == "third":
        rows[:, ::3] = 0.0
    covariance, x = rows.T @ rows, constants_of(arm)
    shorter, fewer = ComposedArm.of(arm, x).without_repeated(covariance)
    assert np.count_nonzero(fewer.diagonal()) < np.count_nonzero(covariance.diagonal())
    ((_, _, columns),) = arm.derivatives(state, x)
    expected = np.einsum("pin,pq,qjn->nij", columns, covariance, columns, optimize=True)
    ((_, _, along_sites, values),) = shorter.site_derivatives(state)
    found = CovarianceRoot.of(fewer, shorter.perturbed_chain).covariances(along_sites, values, state.joint_angles)
    size = np.trace(expected, axis1=1, axis2=2)[:, None, None]
    # Rounding of columns that are 1e-5 apart, which is 1e-11 of them, where their sum is small; of u half the share.
    np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=1e-8)


@pytest.mark.parametrize("joints", [(1,), (2, 3, 4)])
def test_columns_along_few_directions_need_more_poses(joints):
    """Rotations about one axis move a tip along one direction, those about parallel axes in a plane."""
    about_z, orders = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), tuple(range(1, 51))
    gears = [Term(f"gear {joint}", joint, about_z, Harmonics(joint, orders), "gears", 1.0) for joint in joints]
    zeros = [Term(f"zero {joint}", joint, about_z, Constant(), "zeros", 1.0) for joint in joints]
    arm = PerturbedChain(UR10, (*zeros, *gears))
    covariance = np.eye(arm.n_coefficients)
    _, fewer = ComposedArm.of(arm, np.zeros(arm.n_coefficients)).without_repeated(covariance)
    np.testing.assert_array_equal(fewer, covariance)  # each function moves the tip in its own way


def test_columns_that_are_left_are_independent():
    """Constants of every joint repeat what its first harmonics do; formulas go first, and a triangle remains."""
    axes = [tuple(np.eye(6)[axis]) for axis in range(6)]
    bases = {"constants": Constant(), "wobble": None, "formulas": Formula((Expression.angle(6).sin(),))}
    terms = tuple(
        Term(name, place, axis, basis or Harmonics(place, (1,)), name, 1.0)
        for name, basis in bases.items()
        for place in range(1, 7)
        for axis in axes
        if name != "formulas" or place == 6
    )
    arm = PerturbedChain(UR10, terms)
    zero = np.zeros(arm.n_coefficients)
    ((_, _, columns),) = arm.derivatives(state_of(UR10, 300), zero)
    size = np.linalg.norm(columns.reshape(len(columns), -1), axis=1, keepdims=True)
    rank = np.linalg.matrix_rank(columns.reshape(len(columns), -1) / np.maximum(size, 1e-3), tol=1e-9)
    shorter, fewer = ComposedArm.of(arm, zero).without_repeated(np.eye(arm.n_coefficients))
    assert np.count_nonzero(fewer.diagonal()) == rank
    assert "formulas" not in {term.group for term in shorter.perturbed_chain.terms}
    assert CovarianceRoot.of(fewer, shorter.perturbed_chain).is_triangle
