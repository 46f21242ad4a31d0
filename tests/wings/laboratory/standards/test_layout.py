"""Where artefacts stand and are touched: as many as planned, within reach, as asked for."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import InputError
from truearm.wings.laboratory.standards.artefacts import Artefacts, example_artefacts
from truearm.wings.laboratory.standards.layout import lay_out_tests, select_lengths
from truearm.wings.laboratory.standards.measured_points import KEY_COLUMNS, MeasuredPoints, PointGroup
from truearm.wings.laboratory.standards.point_checks import SAME_PLACE_MM
from truearm.wings.laboratory.standards.positions import directions, hemisphere, seat_normal
from truearm.wings.laboratory.standards.specification import example_specification
from truearm.wings.laboratory.standards.verification import verify
from truearm.wings.laboratory.standards.verification_plan import PLANS, load_verification_plan

RANGE = 2500.0


def laid_out(name="iso10360-12", artefacts=None):
    return lay_out_tests(load_verification_plan(name), artefacts or example_artefacts(RANGE), RANGE)


def as_measured(layout, artefacts):
    """The nominal points, as if a perfect arm had shown them."""
    dates = {one.name: one.date for kind in (artefacts.spheres, artefacts.bars, artefacts.seats) for one in kind}
    return MeasuredPoints.of(
        (one.test, PointGroup(one.artefact, dict(one.keys), one.points, 20.0, 0.0, dates[one.artefact]))
        for one in layout
    )


def edited(name, **tests):
    """A plan with numbers of its tests changed: ``probing=dict(positions=3)``."""
    raw = load_verification_plan(name).model_dump()
    for test, numbers in tests.items():
        for key, value in numbers.items():
            if isinstance(raw[test][key], dict):
                raw[test][key]["value"] = value
            else:
                raw[test][key] = value
    return type(load_verification_plan(name)).model_validate(raw)


@pytest.mark.parametrize("name", PLANS)
@pytest.mark.parametrize("measuring_range_mm", [1000.0, 2500.0])
def test_a_perfect_arm_at_the_nominal_points_conforms(name, measuring_range_mm):
    """Every count and length is what the plan, the certificates and `verify` want; what is left is rounding."""
    artefacts, specification = example_artefacts(measuring_range_mm), example_specification(measuring_range_mm)
    layout = lay_out_tests(load_verification_plan(name), artefacts, measuring_range_mm)
    found = verify(
        as_measured(layout, artefacts),
        plan=load_verification_plan(name),
        artefacts=artefacts,
        specification=specification,
    )
    assert found.verdict.value == "conform"
    assert max(abs(row.value) for row in found.rows) < 1e-9


def test_other_counts_are_laid_out_too():
    """More points, groups, positions and repeats than the standards have, and opposite faces."""
    plan = edited(
        "iso10360-12",
        probing={"points": 12, "positions": 3},
        articulation={"groups": 7, "points": 6, "positions": 3},
        uni={"lengths": 3, "positions": 15, "repeats": 1},
        bi={"required": True, "lengths": 1, "positions": 2, "repeats": 2},
    )
    artefacts = example_artefacts(RANGE)
    layout = lay_out_tests(plan, artefacts, RANGE)
    found = verify(
        as_measured(layout, artefacts), plan=plan, artefacts=artefacts, specification=example_specification(RANGE)
    )
    assert found.verdict.value == "conform"
    assert len({tuple(one.at.round(6)) for one in layout if one.test == "uni" and one.keys["end"] == "A"}) == 15
    faces = {one.keys["end"]: one.normals[0] for one in layout if one.test == "bi" and one.keys["position"] == "1"}
    assert faces["A"] @ faces["B"] == pytest.approx(-1)
    # Without a stated alignment, three points on each face.
    bars = (artefacts.bars[0].model_copy(update={"u_alignment_mm": None}),)
    guided = artefacts.model_copy(update={"bars": bars})
    layout = lay_out_tests(plan, guided, RANGE)
    assert {len(one.points) for one in layout if one.test == "bi"} == {3}
    (row,) = (
        one
        for one in verify(
            as_measured(layout, guided), plan=plan, artefacts=guided, specification=example_specification(RANGE)
        ).rows
        if one.label.startswith("E_Bi")
    )
    assert abs(row.value) < 1e-9


@pytest.mark.parametrize("name", PLANS)
def test_points_are_within_reach_and_directions_are_unit_vectors(name):
    shoulder = np.array([0, 0, 0.25 * RANGE / 2])
    for one in laid_out(name):
        assert set(one.keys) == set(KEY_COLUMNS[one.test])
        assert (np.linalg.norm(one.points - shoulder, axis=1) < 0.9 * RANGE / 2).all()
        for directions_ in (one.normals, one.approach):
            assert directions_.shape == one.points.shape
            assert np.linalg.norm(directions_, axis=1) == pytest.approx(1)
        # The stylus is never in the artefact: it comes from outside, at most square to the surface.
        assert ((one.normals * one.approach).sum(axis=1) > -1e-12).all()


def bar_of(*lengths_mm):
    """The example's artefacts with other lengths on the bar."""
    whole = example_artefacts(RANGE)
    one = whole.bars[0].lengths[0]
    lengths = tuple(one.model_copy(update={"name": f"L{i}", "length_mm": mm}) for i, mm in enumerate(lengths_mm))
    return Artefacts(
        spheres=whole.spheres, bars=(whole.bars[0].model_copy(update={"lengths": lengths}),), seats=whole.seats
    )


def least_apart(layout, test, step_mm=None):
    """How far the farther end moves at least between two positions of a length, its ends in either order [mm]."""
    ends = {}
    for one in layout:
        if one.test == test and one.keys.get("repeat", "1") == "1":
            at = one.at if step_mm is None else step_mm * (one.at / step_mm).round()
            ends.setdefault((one.keys["length"], one.keys["position"]), []).append(at)
    apart = [
        min(max(np.linalg.norm(a - c), np.linalg.norm(b - d)), max(np.linalg.norm(a - d), np.linalg.norm(b - c)))
        for (length, at), (a, b) in ends.items()
        for (other, there), (c, d) in ends.items()
        if length == other and at < there
    ]
    return min(apart)


@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize(
    ("name", "test", "positions"),
    [("asme-b89.4.22", "volumetric", 20), ("iso10360-12", "uni", 7), ("iso10360-12", "uni", 20)],
)
@settings(max_examples=8)
@given(reach_mm=st.floats(300.0, 3000.0), share=st.floats(0.05, 1.36), shoulder_mm=st.floats(-100.0, 800.0))
def test_no_two_positions_of_a_length_are_one_place(name, test, positions, n, reach_mm, share, shoulder_mm):
    """Nor when an operator goes by the sheet, which rounds x, y and z to 10 mm."""
    changed = {"lengths": n, "positions": positions}
    shares = {"shortest_share": 0.0, "shortest_most_share": 1.0, "longest_share": 0.0, "longest_most_share": 1.0}
    fields = type(getattr(load_verification_plan(name), test)).model_fields
    changed |= {key: share for key, share in shares.items() if key in fields}
    artefacts = bar_of(*(share * reach_mm * np.linspace(1.0, 0.2, n)))
    layout = lay_out_tests(edited(name, **{test: changed}), artefacts, 2 * reach_mm, shoulder_mm=shoulder_mm)
    assert len({one.keys["position"] for one in layout if one.test == test}) == positions
    assert least_apart(layout, test) >= SAME_PLACE_MM
    assert least_apart(layout, test, step_mm=10.0) >= SAME_PLACE_MM
    far = [np.linalg.norm(one.at - [0, 0, shoulder_mm]) for one in layout if one.test == test]
    assert max(far) < 0.9 * reach_mm


def test_one_bar_of_one_length_takes_all_places_of_the_volumetric_test():
    """Place 8 came again as 16, turned end for end, and 13 as 18: `verify` refuses a place that comes twice."""
    plan, artefacts = edited("asme-b89.4.22", volumetric={"lengths": 1}), bar_of(1500.0125)
    found = verify(
        as_measured(lay_out_tests(plan, artefacts, RANGE), artefacts),
        plan=plan,
        artefacts=artefacts,
        specification=example_specification(RANGE),
    )
    assert found.verdict.value == "conform"


def test_a_bar_turned_end_for_end_is_at_one_position():
    layout, artefacts = laid_out(), example_artefacts(RANGE)
    of = {(one.test, *one.keys.values()): one.points for one in layout}
    end = list(next(one for one in layout if one.test == "uni").keys).index("end") + 1

    def turned(one):
        key = [one.test, *one.keys.values()]
        if one.test != "uni" or one.keys["position"] != "2":
            return one
        key[list(one.keys).index("position") + 1], key[end] = "1", "AB"[one.keys["end"] == "A"]
        return replace(one, points=of[tuple(key)])

    with pytest.raises(InputError, match=r"position 2.* are 0 mm apart: one position, not two"):
        verify(
            as_measured(map(turned, layout), artefacts),
            plan=load_verification_plan("iso10360-12"),
            artefacts=artefacts,
            specification=example_specification(RANGE),
        )


def test_a_missing_position_is_named_with_those_that_were_measured():
    artefacts = example_artefacts(RANGE)
    measured = [one for one in laid_out() if (one.test, one.keys["position"]) != ("probing", "2")]
    with pytest.raises(InputError, match="'probing': the plan asks for 2 positions, got 1: '1'"):
        verify(
            as_measured(measured, artefacts),
            plan=load_verification_plan("iso10360-12"),
            artefacts=artefacts,
            specification=example_specification(RANGE),
        )


def test_the_plans_as_they_come_take_the_first_lines():
    """Neither 20 positions of two lengths nor 7 of five leave a line out: numbers from when none was ever left out."""
    starts = {
        (one.test, one.keys["position"]): one.at
        for name in PLANS
        for one in laid_out(name)
        if one.keys.get("end") == "A"
    }
    assert starts["uni", "7"] == pytest.approx([-48.805991, 932.689467, -178.247729])
    assert starts["volumetric", "19"] == pytest.approx([433.359528, 433.359528, -14.927416])
    assert starts["volumetric", "20"] == pytest.approx([382.144921, 382.144921, -429.413094])


def test_order_is_that_of_an_operator():
    """No artefact goes back to a place where it stood before; both tests on a sphere are done before it moves."""
    stations = [
        tuple(one.at.round(6)) if one.test in ("probing", "articulation") else (one.test, one.keys["position"])
        for one in laid_out()
    ]
    changes = [one for one, before in zip(stations, [None, *stations], strict=False) if one != before]
    assert len(changes) == len(set(changes)) == 2 + 7


def test_lengths_begin_at_one_ball_and_are_as_calibrated():
    for position in "1234567":
        here = [one for one in laid_out() if one.test == "uni" and one.keys["position"] == position]
        assert len({tuple(one.at.round(9)) for one in here if one.keys["end"] == "A"}) == 1
        ends = {(one.keys["length"], one.keys["end"]): one.at for one in here}
        along = ends["1700", "B"] - ends["1700", "A"]
        for length in ("150", "450", "900", "1300", "1700"):
            assert ends[length, "B"] - ends[length, "A"] == pytest.approx(float(length) * along / 1700)


def test_the_groups_of_an_articulation_come_from_apart():
    from_ = directions(5, 0.3)
    cosines = from_ @ from_.T
    assert cosines[~np.eye(5, dtype=bool)].max() < np.cos(np.radians(39))
    assert from_[1] @ [-np.cos(0.3), -np.sin(0.3), 0] > 0.8  # the second from where the arm stands
    assert (from_[:, 2] > 0.49).all()  # none from below


@pytest.mark.parametrize("n", [5, 9, 25, 12, 40])
def test_points_lie_evenly_over_the_hemisphere(n):
    points = hemisphere(n)
    assert len(points) == n
    assert np.linalg.norm(points, axis=1) == pytest.approx(1)
    assert points[0].tolist() == [0, 0, 1]
    assert (points[:, 2] > -1e-12).all()
    assert np.linalg.norm(points[:, :2].mean(axis=0)) < 0.1  # no side is preferred
    if n == 25:
        polar = np.degrees(np.arccos(np.clip(points[:, 2], -1, 1))).round(6)
        assert Counter(polar.tolist()) == {0.0: 1, 22.5: 4, 45.0: 8, 67.5: 4, 90.0: 8}
        cosines = points @ points.T - 2 * np.eye(25)
        assert np.degrees(np.arccos(cosines.max())) > 20  # no two near each other


def test_lengths_are_spread_from_the_shortest_to_the_longest():
    artefacts = example_artefacts(RANGE)
    bar = artefacts.bars[0]
    many = tuple(
        bar.lengths[0].model_copy(update={"name": f"{mm}", "length_mm": float(mm)}) for mm in range(100, 1800, 50)
    )
    artefacts = Artefacts(bars=(bar.model_copy(update={"lengths": many}),))
    chosen = select_lengths(artefacts, "uni", load_verification_plan("iso10360-12").uni, RANGE)
    assert [length.length_mm for _, length in chosen] == [100, 500, 900, 1350, 1750]
    chosen = select_lengths(artefacts, "volumetric", load_verification_plan("asme-b89.4.22").volumetric, RANGE)
    assert [length.length_mm / 1250 for _, length in chosen] == pytest.approx([0.625, 1.35], abs=0.03)


def test_seats_of_bars_look_across_them():
    for along in np.random.default_rng(0).normal(size=(50, 3)):
        unit = along / np.linalg.norm(along)
        assert seat_normal(unit, np.array([500.0, 200.0, 0.0])) @ unit == pytest.approx(0, abs=1e-12)
    assert seat_normal(np.array([0.0, 0.0, 1.0]), np.array([500.0, 0.0, 0.0])) == pytest.approx([-1, 0, 0])


def without(kind, **changes):
    whole = example_artefacts(RANGE)
    return Artefacts(**{name: () if name == kind else getattr(whole, name) for name in ("spheres", "bars", "seats")})


@pytest.mark.parametrize(
    ("plan", "artefacts", "problem"),
    [
        ("iso10360-12", without("spheres"), "'probing' needs a sphere of 10 to 51 mm"),
        ("iso10360-12", without("bars"), "'uni' needs 5 calibrated lengths, the file of artefacts has 0"),
        ("asme-b89.4.22", without("seats"), "'single_point' needs a seat"),
        ("iso10360-12", example_artefacts(1000.0), "asks for 1650 mm or more, 66% of the measuring range"),
    ],
)
def test_artefacts_that_do_not_serve_are_refused(plan, artefacts, problem):
    assert refuses(problem, lay_out_tests, load_verification_plan(plan), artefacts, RANGE).hint


def test_a_length_without_a_position_is_refused():
    plan = edited("iso10360-12", uni={"longest_share": 0.0})
    with pytest.raises(InputError, match="has no position before an arm with a reach of 900 mm"):
        lay_out_tests(plan, example_artefacts(RANGE), 1800.0)
    plan = edited("asme-b89.4.22", volumetric={"lengths": 1, "positions": 1000})
    refused = refuses(
        r"has \d+ positions 30 mm apart .* 1000 mm, the plan asks for 1000", lay_out_tests, plan, bar_of(1500.0), 2000.0
    )
    assert "reduce the positions" in refused.hint
    refuses("positive measuring range", lay_out_tests, plan, example_artefacts(RANGE), float("nan"))
    nothing = edited(
        "asme-b89.4.22", **{test: {"required": False} for test in ("effective_diameter", "single_point", "volumetric")}
    )
    refuses("requires no test", lay_out_tests, nothing, example_artefacts(RANGE), RANGE)


def test_groups_from_memory_are_checked():
    good = laid_out()[0]
    group = as_measured([good], example_artefacts(RANGE)).tests["probing"][0]
    for test, changed, problem in (
        ("probbing", group, "unknown test"),
        ("articulation", group, "has the keys position, group, got position"),
        ("probing", PointGroup("ball", group.keys, group.points[:0], 20.0, 0.0, group.date), "finite points"),
        ("probing", PointGroup("ball", group.keys, group.points * np.nan, 20.0, 0.0, group.date), "finite points"),
    ):
        refuses(problem, MeasuredPoints.of, [(test, changed)])
