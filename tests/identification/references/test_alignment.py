"""Rigid motions between points of which some are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truearm.identification.references.alignment import align, align_robust


def points(rng, n):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.normal(0, 1000, 3)
    b = rng.uniform(-500, 500, (n, 3))
    return T, b, b @ T[:3, :3].T + T[:3, 3]


@pytest.mark.parametrize(("n", "wrong"), [(3, 0), (6, 1), (6, 2), (30, 10)])
def test_a_third_of_the_points_may_be_anywhere(n, wrong):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        T, b, a = points(rng, n)
        a[:wrong] += rng.normal(0, 1000, (wrong, 3))
        np.testing.assert_allclose(align_robust(b, a), T, atol=1e-9)  # of lengths of a metre


def test_without_gross_errors_it_is_the_least_squares_motion_but_for_the_noise(rng):
    _, b, a = points(rng, 40)
    noisy = a + rng.normal(0, 0.1, a.shape)
    for found in (align(b, noisy), align_robust(b, noisy)):
        off = b @ found[:3, :3].T + found[:3, 3] - a
        assert np.sqrt((off**2).mean()) < 0.1  # mm: the noise of one point; the mean of 40 has a third of it


def test_three_points_are_all_used_however_well_two_of_them_agree():
    """Two points would leave the rotation about their line open."""
    T, b, a = points(np.random.default_rng(0), 3)
    a[2] += 0.5 * (b[0] - b[1]) @ T[:3, :3].T / np.linalg.norm(b[0] - b[1])  # mm
    np.testing.assert_allclose(align_robust(b, a), align(b, a), atol=1e-9)  # mm


def test_a_single_point_is_moved_and_not_turned():
    motion = align(np.array([[1.0, 2, 3]]), np.array([[4.0, 5, 6]]))
    np.testing.assert_array_equal(motion, [[1, 0, 0, 3], [0, 1, 0, 3], [0, 0, 1, 3], [0, 0, 0, 1]])


def test_many_sets_of_points_are_aligned_as_one_by_one(rng):
    b, a = rng.normal(0, 500, (2, 4, 5, 3))
    np.testing.assert_allclose(align(b, a), [align(*one) for one in zip(b, a, strict=True)], atol=1e-9)  # mm
