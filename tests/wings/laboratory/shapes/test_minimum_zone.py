"""Minimum zones: planted by points that balance, and never narrower by any small move."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.wings.laboratory import shapes

TURN = Rotation.from_euler("xyz", [0.4, -0.9, 1.3]).as_matrix()
CENTRE = np.array([812.0, -340.0, 155.0])
R, HALF = 20.0, 0.015
EIGHTHS = np.arange(8) * np.pi / 4


def planted(kind, rng):
    """Points on both limits that balance each other (forces and moments), and others anywhere between them.

    That no move brings all those on the outer limit inwards and all those on the inner limit outwards is the
    condition of the minimum zone.
    """
    if kind == "plane":
        limits = np.column_stack([30 * np.cos(EIGHTHS), 30 * np.sin(EIGHTHS), HALF * (-1.0) ** np.arange(8)])
        between = np.column_stack([rng.uniform(-25, 25, (12, 2)), rng.uniform(-HALF, HALF, 12)])
        return limits, between
    size = np.concatenate([R + HALF * (-1.0) ** np.arange(8), R + rng.uniform(-HALF, HALF, 12)])[:, None]
    turn = np.concatenate([EIGHTHS, rng.uniform(0, 2 * np.pi, 12)])
    ring = size * np.column_stack([np.cos(turn), np.sin(turn)])
    if kind == "circle":
        points = np.column_stack([ring, np.zeros(20)])
    elif kind == "cylinder":
        z = np.concatenate([np.zeros(8), rng.uniform(-30, 30, 12)])
        points = np.column_stack([ring, z])
        both = [points[:8] + [0, 0, 30], points[:8] - [0, 0, 30]]
        return np.concatenate(both), points[8:]
    else:
        corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / np.sqrt(3)
        away = rng.normal(size=(12, 3))
        directions = np.concatenate([corners, away / np.linalg.norm(away, axis=1)[:, None]])
        size[:8, 0] = R + HALF * np.sign(corners.prod(axis=1))
        points = size * directions
    return points[:8], points[8:]


@pytest.mark.parametrize("kind", ["plane", "circle", "sphere", "cylinder"])
@pytest.mark.parametrize("seed", range(3))
def test_a_planted_zone_is_found(kind, seed):
    limits, between = planted(kind, np.random.default_rng(seed))
    points = CENTRE + np.concatenate([limits, between]) @ TURN.T
    zone = shapes.minimum_zone(kind, points)
    assert zone.form_mm == pytest.approx(2 * HALF, abs=1e-9)
    assert zone.touches[: len(limits)].all()
    assert zone.form_mm <= getattr(shapes, f"fit_{kind}")(points).form_mm + 1e-12
    if kind != "plane":
        assert zone.radius_mm == pytest.approx(R, abs=1e-7)
    if kind in ("circle", "sphere"):
        np.testing.assert_allclose(zone.centre, CENTRE, atol=1e-7)
    if kind != "sphere":
        np.testing.assert_allclose(np.abs(zone.axis @ TURN), [0, 0, 1], atol=1e-6)


def test_a_plate_is_as_flat_as_its_thinnest_direction():
    """Against a plain search of all directions about the normal, each with its range of heights."""
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-50, 50, (15, 2)), rng.normal(0, 0.05, 15)])
    zone = shapes.minimum_zone("plane", points)
    tilts = rng.normal(0, 2e-3, (200_000, 2))
    heights = np.ptp(points[:, 2, None] - points[:, :2] @ tilts.T, axis=0)
    assert zone.form_mm <= heights.min() + 1e-6
    assert zone.form_mm == pytest.approx(heights.min(), rel=0.02)
    assert zone.touches.sum() >= 4  # as many as a plane has parameters, and one


def test_perfect_points_have_no_width():
    assert shapes.minimum_zone("plane", [[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 4, 0]]).form_mm == pytest.approx(0)
    ring = R * np.column_stack([np.cos(EIGHTHS), np.sin(EIGHTHS), np.zeros(8)])
    assert shapes.minimum_zone("circle", ring).form_mm == pytest.approx(0, abs=1e-12)


def test_other_kinds_are_refused():
    refuses("expected a zone of plane, circle, sphere, cylinder, got 'cone'", shapes.minimum_zone, "cone", np.eye(3))
