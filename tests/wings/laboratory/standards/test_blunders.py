"""Points and groups that are alone in the wrong: told if they are, and seldom of points whose noise is equal."""

import datetime
from dataclasses import replace

import numpy as np
import pytest

from truearm.errors import InputError
from truearm.wings.laboratory.standards.artefacts import CalibratedSphere
from truearm.wings.laboratory.standards.blunders import in_groups, in_seats, on_spheres
from truearm.wings.laboratory.standards.decision import Budget, ConformityResult
from truearm.wings.laboratory.standards.measurands import SphereMeasurement
from truearm.wings.laboratory.standards.measured_points import PointGroup
from truearm.wings.laboratory.standards.positions import hemisphere

DAY = datetime.date(2026, 1, 1)
BALL = CalibratedSphere(
    name="ball", diameter_mm=25.0, u_diameter_mm=0.0005, certificate="K-1", date=DAY, expires=DAY.replace(year=2027),
    form_mm=0.0, u_fixture_mm=0.0, expansion_per_K=1e-5, u_expansion_per_K=1e-6, u_temperature_K=0.5,
)  # fmt: skip
SIZE = ConformityResult("P_Size", 0.0, "mm", Budget(()), None, None)
FALSE_REMARKS = 1e-3


def group(points) -> PointGroup:
    return PointGroup("it", {"position": "1"}, points, 20.0, 0.0, DAY, tuple(range(2, 2 + len(points))))


def of_ball(points) -> list[str]:
    return list(on_spheres("probing", [group(points)], [SphereMeasurement(BALL, points)], SIZE))


def of_seat(points) -> list[str]:
    return list(in_seats("single_point", [group(points)]))


def of_groups(centres) -> list[str]:
    balls = [12.5 * hemisphere(9) + centre for centre in centres]
    measured = [SphereMeasurement(BALL, points) for points in balls]
    return list(in_groups("articulation", [group(points) for points in balls], measured))


@pytest.mark.parametrize(("times", "n_remarks"), [(2.0, 0), (-2.0, 0), (100.0, 1), (-100.0, 1)])
def test_a_size_far_beyond_its_limit_on_either_side_asks_for_the_diameter(times, n_remarks):
    """A tip that was not taken off makes a ball too large, one that was taken off twice too small."""
    points, size = 12.5 * hemisphere(9), replace(SIZE, value=0.01 * times, limit=0.01)
    remarks = list(on_spheres("probing", [group(points)], [SphereMeasurement(BALL, points)], size))
    assert len(remarks) == n_remarks
    assert all("check diameter_mm of 'ball'" in remark for remark in remarks)


@pytest.mark.parametrize(
    ("n", "many"), [(8, 1000), *(pytest.param(n, 2000, marks=pytest.mark.weekly) for n in (7, 8, 9))]
)
def test_of_balls_with_equal_noise_fewer_than_1_in_1000_have_an_outlier(n, many):
    """Touched anywhere on the upper half. Seven leave two to spare without one, and agree more often."""
    rng, remarks = np.random.default_rng(n), 0
    for _ in range(many):
        towards = rng.normal(size=(n, 3))
        towards[:, 2] = np.abs(towards[:, 2])
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        try:
            remarks += len(of_ball(12.5 * towards + 0.01 * rng.normal(size=(n, 3))))
        except InputError:  # directions that do not determine a ball
            continue
    assert remarks <= FALSE_REMARKS * many


@pytest.mark.parametrize("n", [4, *(pytest.param(n, marks=pytest.mark.weekly) for n in (5, 6, 7))])
@pytest.mark.parametrize("across", [0.02, 1.0])
def test_of_seats_with_equal_noise_fewer_than_1_in_1000_have_an_outlier(n, across):
    """Along one line mostly is worst, as of a loose joint."""
    rng, many = np.random.default_rng(n), 10_000
    scattered = 0.02 * rng.normal(size=(many, n, 3)) * [1.0, across, across]
    assert sum(len(of_seat(points)) for points in scattered) <= FALSE_REMARKS * many


@pytest.mark.parametrize(
    ("report", "least", "good"),
    [(of_ball, 9, 12.5 * hemisphere(9)), (of_seat, 6, np.zeros((6, 3))), (of_groups, 5, np.zeros((5, 3)))],
)
def test_a_single_outlier_is_reported_from_the_least_number_of_points(report, least, good):
    rng = np.random.default_rng(0)
    points = good + 0.005 * rng.normal(size=good.shape)
    assert report(points) == []
    points[2] += [0.0, 0.0, 1.0]
    assert len(points) == least
    assert "only" in report(points)[0]
    assert report(points[:-1]) == []
