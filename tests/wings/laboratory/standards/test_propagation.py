"""The uncertainty of test values: closed forms, refitted shapes, and how often it holds what set-ups did."""

import numpy as np
import pytest
from scipy.stats import binom

from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere
from truearm.wings.laboratory.shapes.minimum_zone import circumscribed_diameters, circumscribed_sphere
from truearm.wings.laboratory.standards.artefacts import example_artefacts
from truearm.wings.laboratory.standards.asme_b89_4_22 import volumetric
from truearm.wings.laboratory.standards.measurands import LengthMeasurement, SphereMeasurement
from truearm.wings.laboratory.standards.positions import hemisphere
from truearm.wings.laboratory.standards.propagation import (
    ErrorSource,
    drawn_budget,
    farthest_pair,
    half_range,
    in_each,
    largest_distance,
    linear_budget,
    two_rms,
    two_s,
    two_s_of_points,
    value_range,
)
from truearm.wings.laboratory.standards.specification import Specification

RANGE = 2500.0
NO_LIMITS = Specification(name="none", source="none", measuring_range_mm=RANGE, limits={})
WIDE = np.array([0.08, -0.11, 0.02, 0.05, -0.04, -0.09, 0.13, 0.01])


def test_the_statistics_by_hand():
    deviations = np.array([1.0, 2.0, -3.0])
    assert value_range(deviations) == 5
    assert two_s(deviations) == pytest.approx(2 * np.sqrt(14 / 2))
    assert two_rms(deviations) == pytest.approx(2 * np.sqrt(14 / 3))
    points = np.array([[3.0, 0, 0], [-3, 0, 0], [0, 4, 0], [0, -4, 0]])
    assert largest_distance(points) == 4
    assert two_s_of_points(points) == pytest.approx(2 * np.sqrt(50 / 3))
    assert half_range(points) == 4
    assert farthest_pair(points) == 8


def test_many_spheres_at_once_are_those_one_by_one(rng):
    sets = rng.normal(size=(20, 5, 3))
    each = [circumscribed_sphere(one).diameter_mm for one in sets]
    np.testing.assert_array_equal(circumscribed_diameters(sets), each)


def test_what_is_common_moves_a_mean_and_what_is_new_averages_out():
    """Common 3 um, in each of four readings 8 um: 3 and 8 / sqrt(4); of a range, 0 and 8 sqrt(2)."""
    common, new = ErrorSource("common", np.full((1, 4), 0.003), 7), in_each("new", 0.008, (4,))
    mean = linear_budget(np.full(4, 0.25), [common, new])
    assert [one.u for one in mean.contributions] == pytest.approx([0.003, 0.004])
    assert [one.dof for one in mean.contributions] == [7, np.inf]
    readings = np.array([-1.0, 0.1, 0.2, 1.0])
    drawn = drawn_budget(readings, value_range, [common, new])
    assert drawn.contributions[0].u == pytest.approx(0, abs=1e-12)
    assert drawn.u == pytest.approx(0.008 * np.sqrt(2), rel=0.07)


def test_2s_and_2rms_of_an_arm_far_worse_than_its_set_up():
    """To first order 2 u / sqrt(n - 1) and 2 u / sqrt(n); 1000 draws know it to 2 %."""
    sources = [in_each("new", 0.001, WIDE.shape)]
    assert drawn_budget(WIDE, two_s, sources).u == pytest.approx(0.002 / np.sqrt(7), rel=0.07)
    assert drawn_budget(WIDE, two_rms, sources).u == pytest.approx(0.002 / np.sqrt(8), rel=0.07)


def test_u_of_a_perfect_arm_holds_what_its_set_up_makes(rng):
    """Readings that scatter by the set-up alone: their 2s of 2 um should be 0."""
    for one in 0.001 * rng.normal(size=(10, 20)):
        assert drawn_budget(one, two_s, [in_each("new", 0.001, (20,))]).expanded > two_s(one) * 0.85


def test_size_and_form_are_uncertain_as_refitted_spheres_scatter(rng):
    """A ball with the errors of an arm of 20 um, moved by 1 um at each touch: 300 fits; 4 % and 2 % of noise."""
    ball = example_artefacts(RANGE).spheres[0].model_copy(update={"form_mm": 0.0, "u_fixture_mm": 0.001})
    normals = hemisphere(25)
    points = 12.5 * normals + 0.02 * rng.normal(size=(25, 3))
    measured = SphereMeasurement(ball, points)
    fits = [fit_sphere(points + 0.001 * rng.normal(size=(25, 3))) for _ in range(300)]
    size = next(one.u for one in measured.size_budget(corrected=True).contributions if one.label == "fixture")
    assert 2 * np.std([one.radius_mm for one in fits]) == pytest.approx(size, rel=0.15)
    change = np.array([one.form_mm for one in fits]) - measured.fit.form_mm
    assert np.sqrt(np.mean(change**2)) == pytest.approx(measured.form_budget.u, rel=0.15)


def test_u_holds_what_artefacts_and_set_up_did(rng):
    """80 campaigns of 20 lengths of two calibrated ones, warm: 95.45 % of each test value, 99.9 % of the binomial."""
    bar = example_artefacts(RANGE).bars[0]
    held: dict[str, list[bool]] = {}
    for _ in range(80):
        arm = 0.02 * rng.normal(size=20)
        calibration, warmth, alpha = rng.normal(size=5), rng.normal(), rng.normal()
        rows = []
        for perfect in (True, False):
            lengths = []
            for i, error in enumerate(arm):
                one = bar.lengths[3 + i % 2]
                expansion = bar.expansion_per_K + (0 if perfect else bar.u_expansion_per_K * alpha)
                degC = 24.0 + (0 if perfect else bar.u_temperature_K * warmth)
                size = (one.length_mm + (0 if perfect else one.u_mm * calibration[3 + i % 2])) * (
                    1 + expansion * (degC - 20)
                )
                off = 0 if perfect else bar.u_fixture_mm * rng.normal() + bar.form_mm * rng.uniform(-0.5, 0.5, 2).sum()
                end = np.array([[size + error + off, 0.0, 0.0]])
                lengths.append(LengthMeasurement(bar, one, np.zeros((1, 3)), end, 24.0, position=str(i)))
            rows.append(volumetric(lengths, NO_LIMITS))
        for true, found in zip(*rows, strict=True):
            within = abs(abs(true.value) - abs(found.value)) <= found.uncertainty
            held.setdefault(found.label, []).append(within)
    for label, each in held.items():
        assert binom.ppf(0.0005, 80, 0.9545) <= sum(each) <= binom.ppf(0.9995, 80, 0.9545), label
