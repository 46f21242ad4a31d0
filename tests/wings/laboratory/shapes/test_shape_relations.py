"""Relations of shapes: hand-made ones, and uncertainties as large as the spread of many measurements."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm import shapes
from truearm.errors import InputError

GRID = np.array([[x, y, 0.0] for x in (-20.0, 0, 20) for y in (-30.0, 0, 30)])
TURNS = np.arange(12) * np.pi / 6
RING = np.column_stack([8 * np.cos(TURNS), 8 * np.sin(TURNS), 10.0 * (np.arange(12) % 3)])
TILT = Rotation.from_euler("x", 30, degrees=True)


def plane(turn=None, at=(0, 0, 0)):
    return (turn or Rotation.identity()).apply(GRID) + at


def test_hand_made_relations():
    floor, lid = shapes.fit_plane(plane()), shapes.fit_plane(plane(at=[5, 3, 40]))
    slope = shapes.fit_plane(plane(TILT))
    bore = shapes.fit_cylinder(RING + [5, 3, 0])
    other = shapes.fit_cylinder(RING + [25, 3, 7])
    cross = shapes.fit_cylinder(Rotation.from_euler("y", 90, degrees=True).apply(RING) + [0, 13, 50])
    assert shapes.angle(floor, slope).value == pytest.approx(np.radians(30))
    assert shapes.angle(floor, bore).value == pytest.approx(np.pi / 2)
    assert shapes.angle(slope, bore).value == pytest.approx(np.radians(60))
    assert shapes.distance(floor, lid).value == pytest.approx(40)
    assert shapes.distance(bore, other).value == pytest.approx(20)
    assert shapes.distance(bore, cross).value == pytest.approx(10)
    assert shapes.concentricity(bore, other).value == pytest.approx(40)
    assert shapes.parallelism(floor, lid, 100.0).value == pytest.approx(0, abs=1e-9)
    assert shapes.perpendicularity(floor, slope, 100.0).value == pytest.approx(100 * np.cos(np.radians(30)))
    ball = shapes.fit_sphere(5 * np.concatenate([np.eye(3), -np.eye(3)]) + [1, 2, 17])
    assert shapes.distance(ball, floor).value == pytest.approx(17)
    assert shapes.distance(ball, bore).value == pytest.approx(np.hypot(4, 1))


def test_a_plane_is_concentric_with_nothing():
    floor, lid = shapes.fit_plane(plane()), shapes.fit_plane(plane(at=[5, 3, 40]))
    bore = shapes.fit_cylinder(RING)
    for pair in ((floor, lid), (floor, bore), (bore, floor)):
        refuses("centres or axes, got a plane", shapes.concentricity, *pair)


def test_what_has_no_distance_or_no_direction_is_refused():
    with pytest.raises(InputError, match=r"got an angle of 30.0 deg. Try: measure the angle"):
        shapes.distance(shapes.fit_plane(plane()), shapes.fit_plane(plane(TILT)))
    ball = shapes.fit_sphere(5 * np.concatenate([np.eye(3), -np.eye(3)]))
    refuses("got a sphere", shapes.angle, ball, shapes.fit_plane(plane()))


def test_a_right_angle_is_as_uncertain_as_one_beside_it():
    """Of two like planes at any angle ``sqrt(2)`` times the uncertainty of a normal."""
    floor = shapes.fit_plane(plane(), std_mm=0.01)
    for degrees in (90.0, 89.0):
        wall = shapes.fit_plane(plane(Rotation.from_euler("x", degrees, degrees=True)), std_mm=0.01)
        expected = 0.01 * np.sqrt(2 / (GRID[:, 1] ** 2).sum())
        assert shapes.angle(floor, wall).u == pytest.approx(expected, rel=1e-6)
        assert shapes.perpendicularity(floor, wall, 100.0).u == pytest.approx(100 * expected, rel=1e-3)
    edge = shapes.fit_line([[0, y, 0] for y in (-30.0, 0, 30)], std_mm=0.01)  # lies in the plane
    expected = 0.01 * np.sqrt(1 / (GRID[:, 1] ** 2).sum() + 1 / 1800)
    assert shapes.angle(floor, edge).u == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("relation", "make"),
    [
        (shapes.angle, lambda e: (shapes.fit_plane(plane() + e()), shapes.fit_plane(plane(TILT) + e()))),
        pytest.param(
            shapes.distance,
            lambda e: (shapes.fit_plane(plane() + e()), shapes.fit_plane(plane(at=[0, 0, 40]) + e())),
            marks=pytest.mark.weekly,
        ),
        (
            shapes.distance,
            lambda e: (
                shapes.fit_sphere(5 * np.concatenate([np.eye(3), -np.eye(3)]) + e(6)),
                shapes.fit_line(GRID[3:6] + [9, 0, 30] + e(3)),
            ),
        ),
    ],
    ids=["angle of planes", "distance of planes", "sphere and line"],
)
def test_uncertainties_are_those_of_many_measurements(relation, make):
    """The spread of 300 measurements has an uncertainty of 4 %; three of it."""
    rng = np.random.default_rng(2)
    found = [relation(*make(lambda n=9: 0.01 * rng.normal(size=(n, 3)))) for _ in range(300)]
    values = np.array([one.value for one in found])
    assert values.std(ddof=1) == pytest.approx(np.sqrt(np.mean([one.u**2 for one in found])), rel=0.12)
