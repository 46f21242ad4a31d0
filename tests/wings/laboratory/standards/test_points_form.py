"""Laws of the points to fill in: every planned point once, filled in order, all or none."""

import csv
import datetime

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.wings.laboratory.standards.artefacts import example_artefacts
from truearm.wings.laboratory.standards.layout import lay_out_tests
from truearm.wings.laboratory.standards.measured_points import SIZE_TESTS, read_points
from truearm.wings.laboratory.standards.points_form import fill_points_form, read_planned_points, write_points_form
from truearm.wings.laboratory.standards.verification_plan import load_verification_plan

RANGE_MM = 2500.0
DAY = datetime.date(2026, 10, 20)


@pytest.fixture(scope="module")
def layout():
    return lay_out_tests(load_verification_plan("asme-b89.4.22"), example_artefacts(RANGE_MM), RANGE_MM)


@pytest.fixture(scope="module")
def planned(layout):
    return np.concatenate([one.points for one in layout])


@pytest.fixture
def form(layout, tmp_path):
    write_points_form(layout, tmp_path / "points.csv", tip_diameter_mm=6.0)
    return tmp_path / "points.csv"


def test_a_form_has_every_point_of_the_layout_in_its_order(form, layout):
    read = read_planned_points(form)
    assert [(one.test, one.artefact, one.keys) for one in read] == [
        (one.test, one.artefact, one.keys) for one in layout
    ]
    for one, placed in zip(read, layout, strict=True):
        assert one.points == pytest.approx(placed.points, abs=5e-4)  # rounded to a micrometre
        assert one.approach == pytest.approx(placed.approach, abs=2e-3)
        assert one.tip_mm == (6.0 if one.test == "effective_diameter" else 0.0)


def test_a_form_asks_for_the_serial_number_of_each_artefact(form, planned):
    """As typed beside one artefact, it is that of its group; the head and all rows have as many cells."""
    rows = list(csv.reader(form.read_text().splitlines()))
    assert {len(row) for row in rows} == {len(rows[0])}
    at = rows[0].index("artefact_serial_number")
    rows[1][at] = "K-17"
    with form.open("w", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(rows)
    fill_points_form(form, planned, day=DAY, artefact_degC=20.5)
    groups = [group for test in read_points(form).tests.values() for group in test]
    assert [group.serial_number for group in groups].count("K-17") == 1


def test_a_filled_form_is_a_file_of_points(form, planned, layout):
    assert fill_points_form(form, planned, day=DAY, artefact_degC=20.5) == len(planned)
    measured = read_points(form)
    groups = [group for test in measured.tests.values() for group in test]
    assert sum(len(group.points) for group in groups) == len(planned)
    assert {group.date for group in groups} == {DAY}
    for test, members in measured.tests.items():
        placed = [one for one in layout if one.test == test]
        for group, one in zip(members, placed, strict=True):
            assert group.points == pytest.approx(one.points, abs=1e-6)
        assert np.isnan(members[0].degC) if test == "single_point" else members[0].degC == 20.5


def test_a_session_of_two_days_fills_the_rest_with_its_own_day(form, planned):
    lines = form.read_text(encoding="utf-8").splitlines()
    form.write_text("\n".join(lines[:31]) + "\n", encoding="utf-8")
    fill_points_form(form, planned[:30], day=datetime.date(2026, 10, 19), artefact_degC=20.0)
    form.write_text(form.read_text(encoding="utf-8") + "\n".join(lines[31:]) + "\n", encoding="utf-8")
    assert fill_points_form(form, planned[30:], day=DAY, artefact_degC=20.0) == len(planned) - 30
    assert [line.split(",")[2] for line in form.read_text(encoding="utf-8").splitlines()[30:32]] == [
        "2026-10-19",
        "2026-10-20",
    ]


@pytest.mark.parametrize("lost", [12, 40, 80])
def test_the_missing_point_is_named(form, planned, lost):
    before = form.read_bytes()
    caught = refuses(None, fill_points_form, form, np.delete(planned, lost, axis=0), day=DAY)
    assert f"expected {len(planned)} readings" in str(caught)
    found = caught.line - 2
    # Points of one seat are one place: which of them is missing, no distance tells.
    assert np.linalg.norm(planned[found] - planned[lost]) < 1e-6
    assert form.read_bytes() == before


def test_a_reading_too_many_is_named(form, planned):
    twice = np.insert(planned, 30, planned[30] + 0.02, axis=0)
    refuses(r"reading 3[12] is likely one too many", fill_points_form, form, twice, day=DAY)


def test_points_in_reverse_order_or_shifted_by_one_are_refused(form, planned):
    before = form.read_bytes()
    refuses("is not at its place in the plan", fill_points_form, form, planned[::-1], day=DAY)
    shifted = np.insert(np.delete(planned, 12, axis=0), 90, planned[90], axis=0)  # one missed, another taken twice
    assert 12 + 2 <= refuses("is not at its place in the plan", fill_points_form, form, shifted, day=DAY).line <= 90 + 2
    assert form.read_bytes() == before


def test_points_taken_by_hand_in_another_frame_are_at_their_places(form, planned):
    by_hand = planned[:, [1, 2, 0]] + 500 + np.random.default_rng(0).normal(0, 2.0, planned.shape)
    assert fill_points_form(form, by_hand, day=DAY, artefact_degC=20.0) == len(planned)


def test_artefacts_in_exchanged_places_are_told_by_the_positions_of_their_points(form, planned, layout):
    """Two seats, or two bars of one length, measured in the order of another plan; all a hand's breadth off."""
    rng = np.random.default_rng(4)
    starts = np.cumsum([0, *(len(one.points) for one in layout)])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    places = [(one.test, one.keys.get("length"), one.keys.get("position")) for one in layout]
    by = {place: 25 * rng.normal(size=3) for place in places}  # the artefacts' places [mm]
    each = [planned[a:b] + by[place] for a, b, place in zip(starts, starts[1:], places, strict=False)]
    seats = [i for i, one in enumerate(layout) if one.test == "single_point"]
    bars = [i for i, one in enumerate(layout) if one.test == "volumetric" and one.keys["length"] == "1700"]
    for pairs in ([(seats[0], seats[2])], [(bars[0], bars[4]), (bars[1], bars[5])]):
        swapped = list(each)
        for i, j in pairs:
            swapped[i], swapped[j] = each[j], each[i]
        with pytest.raises(InputError, match=r"and where the plan has .* exchanged with .*Try: bring the"):
            fill_points_form(form, np.concatenate(swapped) @ turn, day=DAY)
    fill_points_form(form, np.concatenate(each) @ turn, day=DAY, artefact_degC=20.0)


def test_a_form_saved_with_semicolons_and_decimal_commas_is_filled_alike(form, planned):
    lines = form.read_text(encoding="utf-8").splitlines()
    assert '"' not in "".join(lines)
    form.write_text("\n".join(line.replace(",", ";").replace(".", ",") for line in lines), encoding="utf-8")
    assert fill_points_form(form, planned, day=DAY, artefact_degC=20.5) == len(planned)
    assert f"{planned[0, 0]:.6f};{planned[0, 1]:.6f}".replace(".", ",") in form.read_text(encoding="utf-8")
    measured = read_points(form)
    points = np.concatenate([group.points for test in measured.tests.values() for group in test])
    assert np.sort(points, axis=0) == pytest.approx(np.sort(planned, axis=0), abs=1e-6)
    assert len(np.concatenate([one.points for one in read_planned_points(form)])) == len(planned)


def test_far_too_few_readings_are_counted_only(form, planned):
    caught = refuses(f"expected {len(planned)} readings .* got 5", fill_points_form, form, planned[:5], day=DAY)
    assert "likely" not in str(caught)


def test_a_filled_form_is_not_filled_again(form, planned):
    fill_points_form(form, planned, day=DAY, artefact_degC=20.0)
    refuses("all points have coordinates already", fill_points_form, form, planned, day=DAY)


def test_a_form_without_the_temperature_that_its_tests_need_is_not_filled(form, planned, layout):
    before = form.read_text(encoding="utf-8")
    needing = dict.fromkeys(one.test for one in layout if one.test in SIZE_TESTS)
    said = rf"temperature of the artefacts is missing in \d+ rows .*\({', '.join(needing)}\).*--artefact-temperature"
    assert refuses(said, fill_points_form, form, planned, day=DAY).column == "artefact_degC"
    assert form.read_text(encoding="utf-8") == before
    # Filled in elsewhere, without temperatures: what is missing is not a new form.
    fill_points_form(form, planned, day=DAY, artefact_degC=21.25)
    form.write_text(form.read_text(encoding="utf-8").replace(",21.25,", ",,"), encoding="utf-8")
    with pytest.raises(InputError, match="temperature of the artefacts is missing.*enter it in the file"):
        fill_points_form(form, planned, day=DAY, artefact_degC=20.0)


def test_temperatures_typed_into_a_form_suffice(form, planned):
    rows = list(csv.reader(form.read_text().splitlines()))
    at = rows[0].index("artefact_degC")
    for row in rows[1:]:
        row[at] = "20.75"
    with form.open("w", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(rows)
    assert fill_points_form(form, planned, day=DAY) == len(planned)
    assert {group.degC for test in read_points(form).tests.values() for group in test} == {20.75}


def test_a_point_on_a_surface_needs_the_diameter_of_the_tip(layout, planned, tmp_path):
    path = tmp_path / "points.csv"
    write_points_form(layout, path)
    refuses(r"tip_diameter_mm.*the diameter of the tip is missing", fill_points_form, path, planned, day=DAY)


def test_a_form_overwrites_no_points(form, layout):
    refuses("the file exists already", write_points_form, layout, form)
    refuses(r"ends in \.csv", write_points_form, layout, form.with_suffix(".txt"))
    refuses("stylus tip", write_points_form, layout, form.with_name("new.csv"), tip_diameter_mm=500)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("tip_diameter_mm", "note_tip", 1), "tip_diameter_mm is missing"),
        (lambda t: t.replace("effective_diameter,", "efective,", 1), "unknown test 'efective'"),
        (lambda t: t.replace("0.000,0.000,1.000", "0.000,0.000,2.000", 1), "direction of length 1"),
        (lambda t: t.replace("note_from_x", "note_x", 1), "got no column note_from_x"),
    ],
)
def test_a_file_that_is_no_form_is_refused(form, change, message):
    form.write_text(change(form.read_text(encoding="utf-8")), encoding="utf-8")
    refuses(message, read_planned_points, form)


@pytest.mark.parametrize("options", [{"artefact_degC": 68.0}, {"day": datetime.date(2999, 1, 1)}])
def test_an_implausible_day_or_temperature_is_refused(form, planned, options):
    refuses(None, fill_points_form, form, planned, **{"day": DAY, **options})
