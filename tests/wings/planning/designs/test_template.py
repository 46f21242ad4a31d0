"""The session to fill in: no fit takes it empty, filled in it is a session; names of seats go on from those taken."""

import csv

import numpy as np
import pytest
from test_candidates import gantry

from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.readings import read_lengths, read_session
from truearm.wings.planning.designs.candidates import bar_places, seat_poses, tracker_poses
from truearm.wings.planning.designs.sampling import Sector
from truearm.wings.planning.designs.template import (
    bars,
    continue_seat_numbers,
    notes,
    place_names,
    write_bar_lengths,
    write_template,
)

ARM = load_arm("gao2017")


@pytest.fixture(scope="module")
def seats():
    return seat_poses(ARM, seats=2, poses=3, seed=0)


@pytest.fixture(scope="module")
def places():
    return bar_places(ARM, 2, length_mm=250.0, poses=2, seed=0).split_into_poses()


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def filled(path, out, **values):
    """The template with the angles aimed at as those read, and other columns as given."""
    rows = table(path)
    for number, row in enumerate(rows):
        row |= {name: row[f"note_{name}"] for name in row if f"note_{name}" in row}
        row |= {name: value[number] for name, value in values.items()}
    with out.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return out


def test_an_empty_template_is_no_session(tmp_path, seats):
    for name, poses in (("seats", seats), ("tracker", tracker_poses(ARM, 3, seed=0))):
        write_template(ARM, poses, tmp_path / f"{name}.csv")
        refuses("none of . rows has a number.*fill in what was measured", read_session, tmp_path / f"{name}.csv")


def test_filled_in_it_is_the_session_of_the_plan(tmp_path, seats):
    write_template(ARM, seats, tmp_path / "plan.csv")
    readings = read_session(filled(tmp_path / "plan.csv", tmp_path / "filled.csv"), n_joints=6)
    # Aims have one decimal of a degree.
    assert np.degrees(readings.angles) == pytest.approx(np.degrees(seats.angles), abs=0.0501)
    assert readings.seat.tolist() == seats.seat.tolist()
    assert readings.points is None
    assert readings.position is None


def test_a_trackers_template_has_room_for_points(tmp_path):
    poses = tracker_poses(ARM, 4, seed=0)
    write_template(ARM, poses, tmp_path / "plan.csv")
    xyz = {name: ["1.5", "2.5", "3.5", "4.5"] for name in ("x_mm", "y_mm", "z_mm")}
    readings = read_session(filled(tmp_path / "plan.csv", tmp_path / "filled.csv", **xyz))
    assert readings.points[:, 0].tolist() == [1.5, 2.5, 3.5, 4.5]
    assert readings.seat is None


def test_sliding_joints_are_in_mm(tmp_path):
    arm = gantry()
    poses = tracker_poses(arm, 2, seed=0, sector=Sector(0.1, 1.0, -1.0, 1.0, 90))
    write_template(arm, poses, tmp_path / "plan.csv")
    row = table(tmp_path / "plan.csv")[1]
    assert [name for name in row if name.startswith("q")] == ["q1_mm", "q2_deg", "q3_deg"]
    assert float(row["note_q1_mm"]) == pytest.approx(poses.angles[1, 0], abs=0.0501)


def test_a_bars_places_stay_together_and_have_their_length(tmp_path, places):
    write_template(ARM, places, tmp_path / "plan.csv")
    write_bar_lengths(places, tmp_path / "lengths.csv")
    readings = read_session(filled(tmp_path / "plan.csv", tmp_path / "filled.csv"))
    assert readings.position.tolist() == ["B1"] * 4 + ["B2"] * 4
    lengths = read_lengths(tmp_path / "lengths.csv", seats=readings.seat.tolist())
    assert lengths.seat_a.tolist() == ["B1a", "B2a"]
    assert lengths.seat_b.tolist() == ["B1b", "B2b"]
    assert lengths.length_mm.tolist() == [250.0, 250.0]
    assert lengths.artefact.tolist() == ["bar 250", "bar 250"]


def test_a_bar_with_one_end_used_has_no_length(places):
    one_end = places.split_into_poses(np.flatnonzero(places.seat != "B2b"))
    assert bars(one_end) == [("B1a", "B1b")]
    assert place_names(one_end).tolist() == ["B1"] * 4 + ["B2"] * 2


def test_what_to_do_is_said_once_a_place(seats, places):
    said = notes(seats)
    x, y, z = seats.seat_points[3]
    assert said[3] == f"fix the seat, S2 at x {x:.0f} y {y:.0f} z {z:.0f} mm; tip in seat S2"
    assert said[4] == "tip in seat S2"
    assert sum("fix the bar, B" in phrase for phrase in notes(places)) == 2


def test_places_are_numbered_in_the_order_of_the_poses_and_on_from_those_taken(seats, places):
    turned = seats.split_into_poses([5, 3, 0, 1])
    assert continue_seat_numbers(turned, ()).seat.tolist() == ["S1", "S1", "S2", "S2"]
    # Only names of this kind count; 10^5000 is a name too.
    taken = ["S2", "S7", "B40a", "S1x", "cone", "", "S" + "9" * 5000]
    assert continue_seat_numbers(turned, taken).seat.tolist() == ["S8", "S8", "S9", "S9"]
    assert continue_seat_numbers(places.split_into_poses([5, 7, 0]), ["B3a", "S9"]).seat.tolist() == [
        "B4a",
        "B4b",
        "B5a",
    ]
    tracker = tracker_poses(ARM, 2, seed=0)
    assert continue_seat_numbers(tracker, ["S1"]) is tracker
