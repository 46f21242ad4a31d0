"""Orientations: residuals solved by hand, exact derivatives, the tool's rotation on the flange, full poses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.references.orientations import LEVER_MM, Orientations, orient_flange_coarsely
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, constants
from truearm.identification.terms.catalogue import tool_rotation

ALL = slice(None)


def linearised(reference, axes):
    """Of axes (m, 3, 3), at tips of no interest."""
    return reference.linearised(np.zeros((3, len(axes))), np.zeros(0), ALL, axes.transpose(1, 2, 0))


def test_a_turn_about_the_tool_is_its_rotation_vector_at_a_metre():
    seen = Rotation.from_rotvec([[0, 0, 0.5], [0.3, 0, 0]])
    about = Rotation.from_rotvec([[1e-3, 0, 0], [0, -2.0, 0]])
    reference = Orientations(np.arange(2), seen.as_matrix(), np.full((2, 3), 1e-5))
    found = linearised(reference, (seen * about).as_matrix())
    np.testing.assert_allclose(found.residuals.T, LEVER_MM * about.as_rotvec(), atol=1e-9)
    np.testing.assert_allclose(reference.std, 0.01)  # mm at the lever
    assert not found.by_tip.any()


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-9, 9e-5, 1e-2, 1.0, 3.0, 3.14]))
def test_derivative_by_turns_is_the_difference_quotient_up_to_half_a_turn(seed, size):
    rng = np.random.default_rng(seed)
    r = rng.normal(size=(4, 3))
    r *= size / np.linalg.norm(r, axis=1, keepdims=True)
    seen = Rotation.random(4, rng=rng)
    model = seen * Rotation.from_rotvec(r)
    reference = Orientations(np.arange(4), seen.as_matrix())
    by_turn = linearised(reference, model.as_matrix()).by_turn
    h = 1e-4  # rad, also short of half a turn; truncation h^2 / 6 of a lever of 1000 mm, rounding 1e-13 / h
    for axis in range(3):
        there, back = (
            linearised(reference, (Rotation.from_rotvec(sign * h * np.eye(3)[axis]) * model).as_matrix()).residuals
            for sign in (1, -1)
        )
        np.testing.assert_allclose(by_turn[:, axis], (there - back) / (2 * h), atol=1e-4)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(0, 2.5))
def test_the_chain_with_the_motions_is_the_plain_form(seed, turned_by):
    """Finite motions of all places, the tip's rotation among them, in the problem and in `Chain.pose`."""
    rng = np.random.default_rng(seed)
    chain = load_arm("ur10").chain
    terms = [*constants(chain), *tool_rotation(chain)]
    angles = rng.uniform(-3, 3, (4, 6))
    x = 0.1 * rng.normal(size=len(terms)) * [1 if max(term.direction[:3]) else 100 for term in terms]
    axis = rng.normal(size=3)
    x[-3:] = turned_by * axis / np.linalg.norm(axis)
    perturbed_chain = PerturbedChain(chain, tuple(terms))
    pose = perturbed_chain.with_constants(x).pose(angles)
    reference = Orientations(np.arange(4), pose.R_base_tip)
    (residuals,) = SmallMotionProblem(perturbed_chain, ArmState(chain, angles), (reference,)).residuals(x)
    np.testing.assert_allclose(residuals, 0, atol=1e-9)  # 1e-12 rad at a metre
    np.testing.assert_allclose(perturbed_chain.tips(ArmState(chain, angles), x), pose.tip_in_base, atol=1e-9)


@pytest.mark.parametrize("turned_by", [0.01, 1.5, np.pi])
def test_full_poses_of_a_planted_arm(turned_by, rng):
    """Tool turned by up to half a turn; millimetres and radians have noises of their own."""
    arm = load_arm("ur10")
    chain, n = arm.chain, 80
    terms = [*constants(chain), *tool_rotation(chain)]
    x = 0.3 * rng.normal(size=len(terms)) * [term.prior_std if term.learn else 0.01 for term in terms]
    x[-3:] = turned_by * np.array([0.6, 0.0, 0.8])
    truth = PerturbedChain(chain, tuple(terms)).with_constants(x)
    angles = rng.uniform(-3, 3, (n, 6))
    pose = truth.pose(angles)
    seen = Rotation.from_matrix(pose.R_base_tip) * Rotation.from_rotvec(rng.normal(0, 2e-4, (n, 3)))
    points = pose.tip_in_base + rng.normal(0, 0.02, (n, 3))
    rows = np.arange(n)
    references = [Points(rows, points), Orientations(rows, seen.as_matrix())]
    start = orient_flange_coarsely(chain, angles, references[1].R_reference_flange)
    found = identify(start, ArmState(chain, angles), terms, references)
    assert found.converged
    noise = {explained.kind: explained.noise_std for explained in found.references}
    # 240 residuals each less some 20 parameters: 5 % at one standard deviation
    assert noise["point"] == pytest.approx(0.02, rel=0.2)
    assert noise["orientation"] == pytest.approx(2e-4 * LEVER_MM, rel=0.2)
    elsewhere = rng.uniform(-3, 3, (50, 6))
    error = found.chain.pose(elsewhere), truth.pose(elsewhere)
    turn = Rotation.from_matrix(error[0].R_base_tip).inv() * Rotation.from_matrix(error[1].R_base_tip)
    # Twenty-odd parameters share 240 numbers each of 0.02 mm and 2e-4 rad: a third of them, and thrice that
    assert np.sqrt((turn.as_rotvec() ** 2).mean()) < 2e-4
    assert np.sqrt(((error[0].tip_in_base - error[1].tip_in_base) ** 2).mean()) < 0.02


def test_a_stated_uncertainty_of_orientations_is_used(rng):
    """Noise of the stated size leaves nothing unexplained."""
    chain = load_arm("ur10").chain
    angles = rng.uniform(-3, 3, (60, 6))
    seen = Rotation.from_matrix(chain.pose(angles).R_base_tip) * Rotation.from_rotvec(rng.normal(0, 1e-4, (60, 3)))
    reference = Orientations(np.arange(60), seen.as_matrix(), np.full((60, 3), 1.1e-4))
    found = identify(chain, ArmState(chain, angles), tool_rotation(chain), [reference])
    assert found.references[0].noise_std < 0.3 * 1e-4 * LEVER_MM
    # known to 1e-4 rad / sqrt(60), four times it
    np.testing.assert_allclose(found.coefficients, 0, atol=5.2e-5)
    np.testing.assert_allclose(np.sqrt(found.covariance.diagonal()), 1.1e-4 / np.sqrt(60), rtol=0.1)


@pytest.mark.parametrize(
    ("R", "message"),
    [
        (np.zeros((2, 3, 3)), "expected 1 orientations"),
        (2 * np.eye(3)[None], "reading 5"),
        (np.diag([1.0, 1, -1])[None], "reading 5"),
        (np.full((1, 3, 3), np.nan), "reading 5"),
        (np.full((1, 3, 3), 1e300), "reading 5"),
    ],
)
def test_invalid_orientations_are_refused(R, message):
    with pytest.raises(InputError, match=message):
        Orientations(np.array([4]), R)
