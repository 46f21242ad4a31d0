"""The tests of the standards on cases worked by hand; artefacts' temperatures, uncertainties; what they refuse."""

import datetime

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere
from truearm.wings.laboratory.standards.artefacts import CalibratedBar, CalibratedLength, CalibratedSphere, Seat
from truearm.wings.laboratory.standards.asme_b89_4_22 import SeatPoints, effective_diameter, single_point, volumetric
from truearm.wings.laboratory.standards.decision import Verdict
from truearm.wings.laboratory.standards.iso10360_12 import l_dia, length_errors, p_form, p_size
from truearm.wings.laboratory.standards.measurands import LengthMeasurement, SphereMeasurement, check_spread
from truearm.wings.laboratory.standards.positions import hemisphere
from truearm.wings.laboratory.standards.specification import Specification

CALIBRATED = {
    "certificate": "K-1",
    "date": datetime.date(2026, 1, 1),
    "expires": datetime.date(2027, 1, 1),
    "form_mm": 0.0,
    "u_fixture_mm": 0.0,
}
EXPANDING = {"expansion_per_K": 1e-5, "u_expansion_per_K": 1e-6, "u_temperature_K": 0.5}
BALL = CalibratedSphere(name="ball", diameter_mm=30.0, u_diameter_mm=0.0005, **EXPANDING, **CALIBRATED)
LONG = CalibratedLength(name="1000", length_mm=1000.0, u_mm=0.001)
SHORT = CalibratedLength(name="100", length_mm=100.0, u_mm=0.001)
BAR = CalibratedBar(name="bar", lengths=(SHORT, LONG), **EXPANDING, **CALIBRATED)
CONE = Seat(name="cone", **CALIBRATED | {"u_fixture_mm": 0.001})


def specified(**limits_um):
    names = {name.replace("__", "."): {"B_um": limit} for name, limit in limits_um.items()}
    return Specification(name="arm", source="test", measuring_range_mm=1500, limits=names)


NO_LIMITS = specified()


def octahedron(radius, middle=(0.0, 0.0, 0.0)):
    return np.asarray(middle) + radius * np.concatenate([np.eye(3), -np.eye(3)])


def ball(radius, *, where="", degC=20.0, tip_mm=0.0, middle=(0.0, 0.0, 0.0), sphere=BALL):
    return SphereMeasurement(sphere, octahedron(radius, middle), degC, tip_mm, where)


def bar(start, end, *, length=LONG, position="1", repeat="1", degC=20.0, tip_mm=0.0, symbol="E_Uni"):
    start, end = np.atleast_2d(start), np.atleast_2d(end)
    return LengthMeasurement(BAR, length, start, end, degC, tip_mm, position, repeat, symbol)


def straight(length_mm, **others):
    """Measured along a skew line from somewhere."""
    start = np.array([300.0, -200, 50])
    return bar(start, start + length_mm * np.array([2.0, 3, 6]) / 7, **others)


# ISO 10360-12 --------------------------------------------------------------------------------------------------------


def test_probing_size_is_signed_and_the_worst_position_counts():
    row = p_size([ball(15.002, where="position 1"), ball(14.995, where="position 2")], specified(P_Size__Sph__1x25=15))
    assert row.value == pytest.approx(-0.010, abs=1e-12)
    assert (row.where, row.limit, row.verdict) == ("position 2", 0.015, Verdict.CONFORM)
    # Diameter 0.0005, 30 mm x 1e-5 x 0.5 K: no other line is there.
    assert row.uncertainty == pytest.approx(2 * np.hypot(0.0005, 0.00015), rel=1e-12)


def test_a_tip_is_taken_off_and_a_warm_ball_is_brought_to_20_degrees():
    warm = ball(15.0 * (1 + 1e-5 * 10) + 1.5, degC=30.0, tip_mm=3.0)
    assert p_size([warm], NO_LIMITS).value == pytest.approx(0, abs=1e-12)
    as_it_is = Specification(name="a", source="b", measuring_range_mm=1000, corrected_to_20_degC=False, limits={})
    assert p_size([warm], as_it_is).value == pytest.approx(30 * 1e-4, abs=1e-12)
    # 30 mm x 10 K x 1e-6 per K comes in with the correction and goes with it.
    assert [one.label for one in p_size([warm], NO_LIMITS).budget.contributions].count("expansion of the artefact") == 1
    assert p_size([warm], as_it_is).uncertainty == pytest.approx(0.001, rel=1e-12)


def test_probing_form_is_the_thickness_of_the_shell():
    points = np.concatenate([octahedron(15.01), octahedron(14.99)])
    rough = BALL.model_copy(update={"form_mm": 0.002, "u_form_mm": 0.0005, "u_fixture_mm": 0.001})
    row = p_form([SphereMeasurement(rough, points, where="position 1"), ball(15.0)], specified(P_Form__Sph__1x25=30))
    assert row.value == pytest.approx(0.02, abs=1e-11)
    labels = ["form of the artefact", "calibration of the form", "fixture"]
    assert [one.label for one in row.budget.contributions] == labels
    assert row.verdict is Verdict.CONFORM


def test_location_is_the_smallest_sphere_about_the_centres():
    """Centres on an equilateral triangle of side 0.03 mm: circumscribed 0.03 x 2 / sqrt 3, farthest apart 0.03."""
    corners = 0.03 / np.sqrt(3) * np.array([[1, 0, 0], [-0.5, np.sqrt(0.75), 0], [-0.5, -np.sqrt(0.75), 0]])
    good = [ball(15, middle=[800, 0, 0], where="position 1")] * 5
    bad = [
        ball(r, middle=c, where="position 2")
        for r, c in zip((15, 15.1, 14.9, 15, 15), [*corners, [0] * 3, [0] * 3], strict=True)
    ]
    location, farthest = l_dia([good, bad], specified(L_Dia__5x5=30))
    assert location.value == pytest.approx(0.06 / np.sqrt(3), abs=1e-11)
    assert farthest.value == pytest.approx(0.03, abs=1e-11)
    assert (location.where, location.verdict, farthest.verdict) == ("position 2", Verdict.NOT_CONFORM, None)


def test_location_compares_places_that_each_may_have_moved():
    """Two places of a fixture's u each are apart by sqrt(2) u: beside it the form, by hand.

    A form of 0.002 mm puts each of six points off by 0.002 / sqrt(12), and their centre by 1 / sqrt(2) of that.
    """
    loose = BALL.model_copy(update={"form_mm": 0.002, "u_fixture_mm": 0.003})
    groups = [ball(15, middle=[800 + 0.01 * i, 0, 0], sphere=loose) for i in range(5)]
    location, farthest = l_dia([groups], NO_LIMITS)
    assert location.uncertainty == pytest.approx(2 * np.sqrt(0.002**2 / 12 + 2 * 0.003**2), rel=0.06)
    assert farthest.uncertainty == pytest.approx(location.uncertainty, rel=0.02)


def test_lengths_one_row_each_and_the_worst_of_all_positions():
    limit = {"A_um": 10, "K_mm_per_um": 100, "B_um": 18}
    spec = Specification(name="arm", source="test", measuring_range_mm=1500, limits={"E_Uni": limit})
    rows = length_errors(
        [
            straight(100.005, length=SHORT, position="1"),
            straight(99.99, length=SHORT, position="2", repeat="3"),
            straight(1000.012, position="1"),
            straight(1000.009, position="2"),
        ],
        spec,
    )
    assert [row.label for row in rows] == ["E_Uni, 100", "E_Uni, 1000"]
    np.testing.assert_allclose([row.value for row in rows], [-0.010, 0.012], atol=1e-10)
    np.testing.assert_allclose([row.limit for row in rows], [0.011, 0.018])  # 10 + 100/100; 10 + 1000/100 is over 18
    assert rows[0].where == "position 2, repeat 3"
    # 1000 mm x 1e-5 x 0.5 K = 0.005 mm, calibration 0.001 mm.
    assert rows[1].uncertainty == pytest.approx(2 * np.hypot(0.005, 0.001), rel=1e-12)
    assert [row.verdict for row in rows] == [Verdict.UNDECIDED, Verdict.UNDECIDED]


def test_a_warm_bar_is_brought_to_20_degrees():
    row = length_errors([straight(1000.0 * (1 + 1e-5 * 5), degC=25.0)], NO_LIMITS)[0]
    assert row.value == pytest.approx(0, abs=1e-10)
    # L alpha u(T), L (T - 20) u(alpha), calibration.
    assert row.uncertainty == pytest.approx(2 * np.sqrt(0.005**2 + 0.005**2 + 0.001**2), rel=1e-12)


def test_ends_on_balls_are_centres_of_spheres():
    one = bar(octahedron(10.0, [5, 6, 7]), octahedron(10.2, [1005.01, 6, 7]))
    assert length_errors([one], NO_LIMITS)[0].value == pytest.approx(0.01, abs=1e-10)
    refuses(
        "end A: expected one point, or 5 and more", length_errors, [bar(octahedron(10)[:3], [[1000, 0, 0]])], NO_LIMITS
    )


def cap(n, polar_deg, radius=10.0):
    """Points evenly over the cap of a ball that ends so far from its pole, (n, 3), on a spiral."""
    z = 1 - (1 - np.cos(np.radians(polar_deg))) * np.linspace(0, 1, n)
    turn, level = 2.4 * np.arange(n), np.sqrt(1 - z * z)
    return radius * np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


@pytest.mark.parametrize("n", [5, 9, 25])
def test_points_on_a_ball_must_tell_its_middle(n):
    """Accepted is what is all over its half, wherever that looks; refused a cap of 20 deg, and a point twice."""
    turned = np.linalg.qr(np.random.default_rng(n).normal(size=(3, 3)))[0]
    for points in (hemisphere(n), cap(n, 90), cap(n, 75)):
        check_spread([500.0, 80, -7] + 12.5 * points @ turned, n)
    for polar in (10, 20, 45):
        refuses("lie so close together on the ball", check_spread, cap(n, polar) @ turned, n)
    twice = hemisphere(n)
    twice[-1] = twice[1]
    refuses("the same coordinates", check_spread, twice, n)


def test_how_much_less_a_cap_tells_is_what_simulated_fits_scatter_by():
    """A law of the fit's covariance: 300 fits with 1 um of noise; their rms is known to about 4 %."""
    rng = np.random.default_rng(3)
    scatter = []
    for points in (hemisphere(9), cap(9, 45, 1.0)):
        found = [fit_sphere(10 * points + 1e-3 * rng.normal(size=(9, 3))) for _ in range(300)]
        states = np.array([[*one.centre, one.radius_mm] for one in found])
        scatter.append(np.sqrt(np.linalg.eigvalsh(np.cov(states.T))[-1]))
    refuses(r"5\.1 times more uncertain", check_spread, cap(9, 45), 9)
    assert scatter[1] / scatter[0] == pytest.approx(5.1, rel=0.15)


def test_a_bar_whose_balls_were_touched_on_a_cap_is_refused():
    with pytest.raises(InputError, match="length '1000', position 1, repeat 1, end B: the points lie so close"):
        length_errors([bar(octahedron(10), cap(5, 15) + [1000.0, 0, 0])], NO_LIMITS)


def test_between_faces_the_distance_is_along_the_normal_and_the_tip_goes_off():
    face = np.array([[0.0, 0, 0], [0, 10, 0], [0, 0, 10]])
    opposite = np.array([[1003.0, 5, 3], [1003.0, 2, 4]])
    one = bar(face, opposite, tip_mm=3.0, symbol="E_Bi")
    assert length_errors([one], NO_LIMITS)[0].value == pytest.approx(0, abs=1e-10)
    refuses(
        "one point on either face, or three and more",
        length_errors,
        [bar(face[:2], opposite[:2], symbol="E_Bi")],
        NO_LIMITS,
    )
    with pytest.raises(InputError, match="not across the length"):
        length_errors(
            [bar(np.array([[0.0, 0, 0], [5, 10, 0], [0, 0, 10]]), opposite, tip_mm=3.0, symbol="E_Bi")], NO_LIMITS
        )
    along = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0]])  # a plane that contains the length: no normal along it
    refuses(
        "not across the length",
        length_errors,
        [bar(along, along + [1003.0, 0, 0], tip_mm=3.0, symbol="E_Bi")],
        NO_LIMITS,
    )


def test_both_faces_of_a_length_have_the_form_of_the_bar():
    """Each touch is off by up to half the form, uniformly: u = 0.006 / sqrt(12) mm each, sqrt(2) of that for both."""
    rough = BAR.model_copy(update={"form_mm": 0.006, "u_form_mm": 0.0012})
    one = LengthMeasurement(rough, LONG, np.zeros((1, 3)), np.array([[1000.0, 0, 0]]))
    u = {line.label: line.u for row in length_errors([one] * 3, NO_LIMITS) for line in row.budget.contributions}
    assert u["form of the artefact"] == pytest.approx(0.006 / np.sqrt(6), rel=1e-12)
    assert u["calibration of the form"] == pytest.approx(0.0012 / np.sqrt(6), rel=1e-12)


ALIGNED = BAR.model_copy(update={"u_alignment_mm": np.sqrt(2.0)})  # rms distance beside each other 2 mm


def test_single_points_on_opposite_faces_need_their_alignment():
    """Touched 2 mm beside the opposite point, 100 mm are sqrt(10004) = 100.019998 mm, less s^2 / L = 2 / 100."""
    ends = np.array([[0.0, 0, 0]]), np.array([[100.0, 2.0, 0]])
    refuses(
        "2 mm beside make 100 mm longer by 0.02 mm",
        length_errors,
        [LengthMeasurement(BAR, SHORT, *ends, symbol="E_Bi")],
        NO_LIMITS,
    )
    (row,) = length_errors([LengthMeasurement(ALIGNED, SHORT, *ends, symbol="E_Bi")], NO_LIMITS)
    assert row.value == pytest.approx(-2e-6, abs=1e-7)
    assert row.budget.contributions[-1].label == "alignment of opposite points"
    assert row.budget.contributions[-1].u == pytest.approx(0.02, rel=1e-12)
    # With three points on a face there is no slant: 2 mm beside change nothing.
    face = np.array([[0.0, 5, 5], [0, -5, 5], [0, 0, -5]])
    (plane,) = length_errors(
        [LengthMeasurement(ALIGNED, SHORT, face, face + [100.0, 2.0, 0], symbol="E_Bi")], NO_LIMITS
    )
    assert plane.value == pytest.approx(0, abs=1e-10)
    assert len(plane.budget.contributions) == len(row.budget.contributions) - 1


def test_the_alignment_subtracts_the_average_and_states_the_scatter(rng):
    """4000 pairs of points of a perfect arm: mean and standard deviation of the error to 5 % of s^2 / L = 0.02 mm."""
    beside = np.sqrt(2.0) * rng.standard_normal((4000, 2))
    errors = [
        LengthMeasurement(ALIGNED, SHORT, np.zeros((1, 3)), np.array([[100.0, y, z]]), symbol="E_Bi").error(
            corrected=False
        )
        for y, z in beside
    ]
    assert np.mean(errors) == pytest.approx(0, abs=0.001)
    assert np.std(errors) == pytest.approx(0.02, rel=0.05)


def test_a_set_measured_again_counts_instead_where_the_plan_tolerates_it():
    def runs(*errors):
        return [straight(1000 + error, repeat=str(i + 1)) for i, error in enumerate(errors)]

    spec, good = specified(E_Uni=40), (0.0, 0.0, 0.0)
    assert length_errors(runs(0, 0.09, 0), spec)[0].verdict is Verdict.NOT_CONFORM
    row, count = length_errors(runs(0, 0.09, 0, *good), spec, tolerated_sets=1)
    assert (row.verdict, count.value, count.where) == (Verdict.CONFORM, 1, "of 1")
    # Two values outside, or one in the second runs, or more sets than tolerated: they count.
    assert length_errors(runs(0.09, 0.09, 0, *good), spec, tolerated_sets=1)[0].verdict is Verdict.NOT_CONFORM
    assert length_errors(runs(0, 0.09, 0, 0, 0.09, 0), spec, tolerated_sets=1)[0].verdict is Verdict.NOT_CONFORM
    assert length_errors(runs(0, 0.09, 0, *good), spec, tolerated_sets=0)[0].verdict is Verdict.NOT_CONFORM
    elsewhere = [
        LengthMeasurement(BAR, LONG, one.start, one.end, 20, 0, "2", one.repeat) for one in runs(0.09, 0, 0, *good)
    ]
    assert length_errors(runs(0, 0.09, 0, *good) + elsewhere, spec, tolerated_sets=1)[0].verdict is Verdict.NOT_CONFORM


# ASME B89.4.22 -------------------------------------------------------------------------------------------------------


def test_effective_diameter_is_the_worst_run():
    row = effective_diameter(
        [ball(15.001), ball(14.996, where="repeat 2"), ball(15.0)], specified(EffectiveDiameter=20)
    )
    assert (row.value, row.where) == (pytest.approx(-0.008, abs=1e-12), "repeat 2")


def test_single_point_articulation_by_hand():
    """Four points at 3, 3 and 4, 4 um from their mean: s^2 = (9 + 9 + 16 + 16) / 3."""
    points = np.array([[800.003, 0, 0], [799.997, 0, 0], [800, 0.004, 0], [800, -0.004, 0]])
    largest, two_s, half = single_point([SeatPoints(CONE, points, "position far")], specified(SPAT__Max=10, SPAT__2s=5))
    assert largest.value == pytest.approx(0.004, abs=1e-12)
    assert two_s.value == pytest.approx(2 * np.sqrt(50 / 3) * 1e-3, abs=1e-12)
    assert half.value == pytest.approx(0.004, abs=1e-12)
    assert [row.verdict for row in (largest, two_s, half)] == [Verdict.CONFORM, Verdict.NOT_CONFORM, None]
    # The standard deviation of 2s is 2 u sqrt(3 - 3/4) / sqrt(3) to first order; the seat moves by u = 1 um.
    assert two_s.uncertainty == pytest.approx(2 * 0.002 / np.sqrt(3), rel=0.15)
    refuses("two points or more", single_point, [SeatPoints(CONE, points[:1])], NO_LIMITS)


def test_volumetric_by_hand():
    """Deviations 10, 20, -30 um: mean 0; 2s = 2 sqrt(1400 / 2); 2RMS = 2 sqrt(1400 / 3); range 50."""
    lengths = [straight(1000 + 1e-3 * d, position=str(i)) for i, d in enumerate((10, 20, -30))]
    rows = {row.label: row for row in volumetric(lengths, specified(Volumetric__Max=25, Volumetric__2s=80))}
    for label, value in {
        "Volumetric.Max": -30,
        "Volumetric.2s": 2 * np.sqrt(700),
        "Volumetric.2RMS": 2 * np.sqrt(1400 / 3),
        "Volumetric, range": 50,
        "Volumetric, mean": 0,
    }.items():
        assert rows[label].value == pytest.approx(1e-3 * value, abs=1e-9), label
    assert rows["Volumetric.Max"].verdict is Verdict.UNDECIDED  # 30 - 10.2 um is below 25
    assert rows["Volumetric.2s"].verdict is Verdict.CONFORM
    # Calibration and temperature are common to all readings: they move the mean, and not the scatter nor the range.
    assert rows["Volumetric, mean"].uncertainty == pytest.approx(rows["Volumetric.Max"].uncertainty)
    assert rows["Volumetric.2s"].uncertainty == pytest.approx(0, abs=1e-12)
    assert rows["Volumetric, range"].uncertainty == pytest.approx(0, abs=1e-12)
    assert rows["Volumetric.2RMS"].limit is None
    refuses("two measured lengths", volumetric, lengths[:1], NO_LIMITS)
