"""Error figures by hand."""

import numpy as np
import pytest

from refusals import refuses
from truearm.readings import compare_errors, point_errors


def test_errors_by_hand():
    points = np.array([[10.0, 20, 30], [1, 2, 3]])
    errors = point_errors(points + [[3.0, 0, -4.0], [0, 0, 0]], points)
    assert errors == {
        "mean_mm": 2.5,
        "rms_mm": pytest.approx(12.5**0.5),
        "p95_mm": pytest.approx(4.75),  # between 0 and 5
        "max_mm": 5.0,
        "mean_abs_coordinate_mm": pytest.approx(7 / 6),
        "max_abs_coordinate_mm": 4.0,
        "n": 2,
    }


def test_the_papers_97_percent():
    """0.4492 mm before, 0.0136 mm after (Gao et al. 2017, section 4)."""
    points = np.zeros((5, 3))
    assert compare_errors(points + 0.0136, points - 0.4492, points)["removed_percent"] == pytest.approx(
        96.97, abs=0.005
    )


def test_an_arm_without_error_has_nothing_to_remove():
    points = np.zeros((5, 3))
    assert compare_errors(points, points, points)["removed_percent"] == 0


def test_no_readings_no_errors():
    refuses("got none", point_errors, np.empty((0, 3)), np.empty((0, 3)))


def test_readings_without_a_reference_point_count_nothing():
    points = np.array([[10.0, 20, 30], [np.nan] * 3, [1, 2, 3]])
    found = np.array([[13.0, 20, 26], [5, 5, 5], [1, 2, 3]])
    assert point_errors(found, points) == point_errors(found[::2], points[::2])
    assert point_errors(found, points)["n"] == 2
    refuses("got none", point_errors, found[1:2], points[1:2])
