"""The basis of a process over all joints: its covariances, what it leaves out, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.terms import ArmState, InducedProcess, basis_from_data
from truearm.identification.terms.kernel import embedded, inducing_points, kernel

TURNING, SLIDING = np.array([False, False]), np.array([False, True])


def chain(prismatic):
    fixed = np.tile(np.eye(4), (3, 1, 1))
    fixed[1:, :3, 3] = [50.0, 0.0, 100.0]
    return Chain(fixed, np.zeros(3), prismatic)


def process(angles, scales=(0.7, 0.7), sliding=()):
    return InducedProcess(tuple(np.ravel(angles).tolist()), scales, sliding)


@pytest.mark.parametrize("is_sliding", [TURNING, SLIDING])
def test_at_inducing_points_the_functions_have_the_covariance_of_the_process(is_sliding, rng):
    angles = rng.uniform(-2, 2, (7, 2)) * np.where(is_sliding, 30.0, 1.0)
    scales = np.where(is_sliding, 20.0, 0.7)
    basis = process(angles, tuple(scales.tolist()), tuple((np.flatnonzero(is_sliding) + 1).tolist()))
    state = ArmState(chain(is_sliding), angles)
    values = basis.values(state)
    difference = angles[:, None] - angles
    exponent = np.where(is_sliding, -0.5 * (difference / scales) ** 2, (np.cos(difference) - 1) / scales**2)
    np.testing.assert_allclose(values.T @ values, np.exp(exponent.sum(axis=2)), atol=1e-9)
    np.testing.assert_allclose(basis.remainder(state), 0, atol=1e-9)


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(-7, 7), st.floats(-7, 7)), min_size=1, max_size=6, unique=True))
def test_turns_of_a_joint_change_nothing_and_no_variance_exceeds_one(poses):
    angles = np.array(poses)
    basis = process(np.array([[0.0, 0.0], [1.0, -0.5], [-2.0, 2.5]]))
    state = ArmState(chain(TURNING), angles)
    turned = replace(state, angles=angles + 2 * np.pi * np.array([1, -3]))
    np.testing.assert_allclose(basis.values(turned), basis.values(state), atol=1e-8)
    remainder = basis.remainder(state)
    assert ((remainder >= 0) & (remainder <= 1)).all()


def test_far_from_the_inducing_points_nothing_is_spanned(rng):
    basis = process(0.1 * rng.normal(size=(5, 2)), (0.2, 0.2))
    far = ArmState(chain(TURNING), np.array([[np.pi, np.pi]]))
    # exp(-2 * 2 / 0.2^2) is 1e-43.
    assert np.abs(basis.values(far)).max() < 1e-20
    assert basis.remainder(far) == pytest.approx(1.0)


def test_the_variance_of_sums_is_that_of_the_dense_remainder(rng):
    basis = process(rng.uniform(-1, 1, (4, 2)), (0.5, 0.8))
    state, weights = ArmState(chain(TURNING), rng.uniform(-2, 2, (7, 2))), rng.normal(size=(3, 7))
    at = basis._embedded(state.angles)
    dense = kernel(at, at) - basis.values(state).T @ basis.values(state)
    np.testing.assert_allclose(basis.remainder_of_sums(state, weights), np.diag(weights @ dense @ weights.T), rtol=1e-9)
    np.testing.assert_allclose(basis.remainder_of_sums(state, np.eye(7)), basis.remainder(state), atol=1e-12)


def test_inducing_points_are_far_from_one_another_and_end_where_nothing_is_left(rng):
    angles = np.repeat(rng.uniform(-1, 1, (4, 2)), 5, axis=0)
    points = embedded(angles, np.full(2, 0.3), TURNING)
    chosen = inducing_points(points, 10)
    assert sorted(row // 5 for row in chosen) == [0, 1, 2, 3]
    matrix = kernel(points[chosen], points[chosen])
    assert np.linalg.eigvalsh(matrix)[0] > 1e-6


def test_it_is_plain_data(rng):
    basis = process(rng.uniform(-1, 1, (3, 2)), (0.5, 40.0), (2,))
    again = basis_from_data(basis.as_data())
    assert again == basis
    assert hash(again) == hash(basis)
    assert again.labels() == ("inducing point 1", "inducing point 2", "inducing point 3")


@pytest.mark.parametrize(
    ("angles", "scales", "sliding", "problem"),
    [
        ((0.0, 0.0), (), (), "length scale"),
        ((0.0, 0.0), (1.0, 0.0), (), "length scale"),
        ((0.0, 0.0), (1.0, float("nan")), (), "finite"),
        ((0.0, 0.0, 0.0), (1.0, 1.0), (), "inducing points"),
        ((), (1.0, 1.0), (), "inducing points"),
        ((0.0,) * 2002, (1.0, 1.0), (), "1 to 1000"),
        ((0.0, 0.0), (1.0, 1.0), (3,), "sliding"),
        ((0.0, 0.0), (1.0, 1.0), (2.0,), "whole numbers"),
        ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0), (), "the same"),
        ("ab", (1.0,), (), "finite"),
    ],
)
def test_what_it_refuses(angles, scales, sliding, problem):
    refuses(problem, InducedProcess, angles, scales, sliding)


def test_an_arm_with_other_joints_is_refused():
    with pytest.raises(InputError, match="expected 3 joints of a process, got 2"):
        process(np.zeros((1, 3)), (1.0,) * 3).values(ArmState(chain(TURNING), np.zeros((1, 2))))
