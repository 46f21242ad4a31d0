"""Laws of distances in sessions: what is refused, where it is named, and what a file keeps."""

from pathlib import Path

import numpy as np
import pytest

from refusals import refuses
from truearm.readings import Session, read_session, stratified_rows, write_session
from truearm.readings.anchors import bars_without_certificate, distance_errors, has_located_anchor, offset_std
from truearm.readings.checks import check_sessions
from truearm.readings.repeats import merge_repeats

HEAD = "q1_deg,q2_deg,anchor,distance_mm,u_distance_mm,u_offset_mm\n"
ROW = "10,20,wire,500,0.05,0.5\n"


def read(text: str, folder: Path) -> Session:
    (folder / "session.csv").write_text(text)
    return read_session(folder / "session.csv")


BAD = {
    "distance without an anchor": ("11,20,,500,0.05,0.5", "anchor", "expected the name of the anchor"),
    "anchor without a distance": ("11,20,wire,,,", "distance_mm", "expected the distance to the anchor"),
    "no distance at all": ("11,20,wire,0,0.05,0.5", "distance_mm", "expected a positive distance"),
    "negative distance": ("11,20,wire,-3,0.05,0.5", "distance_mm", "expected a positive distance"),
    "missing uncertainty": ("11,20,wire,500,,0.5", "u_distance_mm", "expected u_distance_mm of the distance, got none"),
    "uncertainty of nothing": ("11,20,,,0.05,", "u_distance_mm", "only where there is a distance"),
    "uncertainty of zero": ("11,20,wire,500,0,0.5", "u_distance_mm", "expected a positive u_distance_mm"),
    "negative uncertainty": ("11,20,wire,500,-1,0.5", "u_distance_mm", "expected a positive u_distance_mm"),
    "missing offset": ("11,20,wire,500,0.05,", "u_offset_mm", "expected u_offset_mm of the distance, got none"),
    "two offsets": ("11,20,wire,500,0.05,0.6", "u_offset_mm", "expected one u_offset_mm for all distances to"),
    "text": ("11,20,wire,half a metre,0.05,0.5", "distance_mm", "expected a number"),
}


@pytest.mark.parametrize("case", BAD)
def test_every_bad_row_is_named_by_line_and_column(case: str, tmp_path: Path) -> None:
    row, column, said = BAD[case]
    error = refuses(said, read, HEAD + ROW + row + "\n", tmp_path)
    assert (error.line, error.column) == (3, column)


def test_columns_that_need_a_distance_are_refused_without_one(tmp_path: Path) -> None:
    for column, cell in (("anchor", "wire"), ("u_distance_mm", "0.1"), ("u_offset_mm", "0.1")):
        error = refuses("expected the column distance_mm", read, f"q1_deg,{column}\n1,{cell}\n", tmp_path)
        assert (error.line, error.column) == (2, column)


def test_a_distance_in_metres_is_not_guessed(tmp_path: Path) -> None:
    error = refuses("unknown column 'distance_m'", read, "q1_deg,anchor,distance_m\n1,A,0.5\n", tmp_path)
    assert error.hint == "distance_mm"


@pytest.mark.parametrize("name", ["session.csv", "session.parquet"])
def test_a_file_keeps_distances_to_the_last_digit(name: str, tmp_path: Path) -> None:
    session = Session(
        np.array([[0.1], [0.2], [0.3]]),
        anchor=["A", "", "B"],
        distance_mm=[500 / 3, np.nan, 200 / 7],
        u_distance_mm=[0.1, np.nan, 0.2],
        u_offset_mm=[1.0, np.nan, 2.0],
    )
    write_session(session, tmp_path / name)
    found = read_session(tmp_path / name)
    assert found.anchor is not None
    assert found.anchor.tolist() == ["A", "", "B"]
    for column in ("distance_mm", "u_distance_mm", "u_offset_mm"):
        np.testing.assert_array_equal(getattr(found, column), getattr(session, column))
    assert Session.from_frame(session.to_frame()).distance_mm is not None


def test_empty_columns_of_distances_are_none() -> None:
    session = Session(np.zeros((2, 1)), anchor=["", ""], distance_mm=[np.nan, np.nan], u_offset_mm=[np.nan, np.nan])
    assert session.distance_mm is None
    assert session.u_offset_mm is None


def test_one_pose_with_several_wires_is_no_repeat_and_the_same_distance_twice_is() -> None:
    angles = np.repeat(np.random.default_rng(1).uniform(-1, 1, (4, 2)), 2, axis=0)
    several = Session(angles, anchor=["A", "B"] * 4, distance_mm=np.arange(500.0, 508.0))
    assert merge_repeats(several).count.tolist() == [1] * 8
    disagreeing = Session(angles, anchor=["A"] * 8, distance_mm=several.distance_mm)
    assert merge_repeats(disagreeing).count.tolist() == [1] * 8
    copies = Session(angles, anchor=["A"] * 8, distance_mm=np.repeat(np.arange(4.0) + 1, 2))
    merged = merge_repeats(copies)
    assert merged.count.tolist() == [2] * 4
    assert merged.readings.distance_mm is not None
    assert merged.readings.distance_mm.tolist() == [1.0, 2.0, 3.0, 4.0]


def test_an_anchor_stands_in_one_session() -> None:
    session = Session(np.zeros((2, 1)), anchor=["A", "A"], distance_mm=[1.0, 2.0], session=["May", "June"])
    refuses("anchor 'A' is in session 'May' and in session 'June'", check_sessions, session)


def test_distances_of_a_bar_need_a_stated_offset() -> None:
    bar = Session(np.zeros((3, 1)), anchor=["A"] * 3, distance_mm=[500.0, 500.1, 499.9])
    (found,) = bars_without_certificate(bar)
    assert "The distances to anchor A are nearly equal, as those of a bar" in str(found)
    assert offset_std(bar, "A") == 1.0
    stated = Session(np.zeros((3, 1)), anchor=["A"] * 3, distance_mm=bar.distance_mm, u_offset_mm=[0.002] * 3)
    assert not list(bars_without_certificate(stated))
    assert offset_std(stated, "A") == 0.002


def test_some_rows_are_spread_over_the_anchors() -> None:
    angles = np.repeat(np.arange(4.0), 3)[:, None]
    session = Session(angles, anchor=["A", "B", "C"] * 4, distance_mm=np.arange(1.0, 13.0))
    rows = stratified_rows(session, 5, seed=1)
    assert session.anchor is not None
    assert np.unique(session.anchor[rows], return_counts=True)[1].tolist() == [2, 2, 2]
    assert not np.isin(angles[rows], np.delete(angles, rows)).any()  # whole poses
    train, test = session.split(by="row", hold_out=0.5, seed=0)
    assert len(train) == len(test) == 6
    assert not np.isin(train.angles, test.angles).any()
    refuses("from 1 to the 12 readings with a seat or a distance, got 13", stratified_rows, session, 13, seed=1)


def test_errors_of_distances_are_zero_for_the_true_points_and_list_every_reading() -> None:
    rng = np.random.default_rng(2)
    points, anchor = rng.uniform(-400, 400, (12, 3)), np.array([900.0, 100.0, -50.0])
    distance = np.linalg.norm(points - anchor, axis=1) + 0.3
    names = ["A"] * 9 + ["B"] * 3  # three distances do not locate an anchor
    session = Session(np.zeros((12, 1)), anchor=names, distance_mm=distance, u_offset_mm=np.full(12, 5.0))
    assert has_located_anchor(session)
    found = distance_errors(points, session)
    # The prior of the offset draws it by some per cent of 0.3 mm.
    assert found["distance_max_mm"] < 0.02
    assert [one["reading"] for one in found["distances"]] == [f"reading {i}" for i in range(1, 10)]
    assert found["anchors"][0]["x_mm"] == pytest.approx(900, abs=0.5)
    refuses("8 or more distances to an anchor", distance_errors, points[2:], session.rows(slice(2, 12)))


def test_errors_of_few_distances_are_as_large_as_those_of_many() -> None:
    rng = np.random.default_rng(8)
    square = []
    for _ in range(40):
        points = rng.uniform(-400, 400, (8, 3))
        distance = np.linalg.norm(points - [900.0, 100.0, -50.0], axis=1) + rng.normal(0, 0.05, 8)
        found = distance_errors(points, Session(np.zeros((8, 1)), anchor=["A"] * 8, distance_mm=distance))
        square.append(found["distance_rms_mm"] ** 2)
    # Four unknowns leave half of the squares; 160 degrees of freedom know the root to 6 per cent.
    assert np.sqrt(np.mean(square)) == pytest.approx(0.05, rel=0.2)
