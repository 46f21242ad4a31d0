"""Small rigid motions of a set of points: shifts, turns, and the growth that all distances share."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truearm.errors import InputError
from truearm.identification.references.alignment import rigid_motions

POINTS = np.random.default_rng(5).uniform(-400, 800, (9, 3))  # mm


def left_of(shifts, motions):
    """What a least-squares fit of the motions leaves of shifts, in mm."""
    return np.abs(shifts - motions @ np.linalg.lstsq(motions, shifts, rcond=None)[0]).max()


def test_shifts_and_turns_of_all_points_are_among_them():
    motions = rigid_motions(POINTS)
    assert motions.shape == (27, 6)
    turned = Rotation.from_rotvec([1e-7, -2e-7, 3e-7]).apply(POINTS) + [0.1, -0.2, 0.3]
    # To first order: what a turn of 4e-7 rad leaves at 1 m is 1e-10 mm.
    assert left_of((turned - POINTS).ravel(), motions) < 1e-9
    # A turn of one point alone is none of all.
    alone = np.zeros_like(POINTS)
    alone[0] = 1.0
    assert left_of(alone.ravel(), motions) > 0.1


def test_scale_is_included_only_on_request():
    growth = (1e-4 * POINTS).ravel()
    assert left_of(growth, rigid_motions(POINTS, scale=True)) < 1e-12
    assert left_of(growth, rigid_motions(POINTS)) > 0.01


def test_they_keep_all_distances_and_are_of_like_size():
    motions = rigid_motions(POINTS).reshape(9, 3, 6)
    apart, moved = (x[:, None] - x[None] for x in (POINTS, motions))
    np.testing.assert_allclose(np.einsum("ija,ijak->ijk", apart, moved), 0, atol=1e-9)  # mm, of 1000
    sizes = np.linalg.norm(motions.reshape(27, 6), axis=0)
    assert sizes.max() / sizes.min() < 3


def test_one_point_is_shifted_only():
    assert np.linalg.matrix_rank(rigid_motions(POINTS[:1])) == 3


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((2, 2)), [[0, 0, np.nan]]])
def test_points_that_are_none_are_refused(points):
    with pytest.raises(InputError, match="finite points of shape"):
        rigid_motions(points)
