"""A fit says where the frame moved and what to enter; with two sessions it is silent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.readings import Session, write_session

N, ROW = 60, 28


@pytest.fixture(scope="module")
def moved() -> Session:
    session = ta.simulate("gao2017", poses=N, strategy="measuring", preset="shop", seed=3).session
    points = session.points.copy()
    points[ROW:] += [0.05, 0.0, 0.0]
    return Session(session.angles, points, point_std=session.point_std)


def test_a_moved_tracker_is_named_by_its_line(moved, tmp_path):
    write_session(moved, tmp_path / "s.csv")
    result = ta.fit("gao2017", tmp_path / "s.csv", model="kinematic")
    (change,) = result.frame_changes
    assert change.change.kind == "step"
    assert change.first_after == f"line {ROW + 2}"  # the first line names the columns
    said = " ".join(result.remarks)
    assert f"moved between line {ROW + 1} and line {ROW + 2}, by 0.0" in said
    assert "in the column session, and fit again" in said
    (as_data,) = result.to_dict()["frame_changes"]
    assert as_data["change"]["row"] == ROW
    # The shop's arm and its instrument scatter by some 0.005 mm; a free base takes half of the step.
    assert 0.03 < as_data["change"]["shift_mm"] < 0.07


def test_two_names_in_the_column_session_answer_it(moved):
    names = np.where(np.arange(N) < ROW, "morning", "noon")
    result = ta.fit("gao2017", replace(moved, session=names), model="kinematic")
    assert result.frame_changes == ()


def test_a_good_session_and_seats_say_nothing():
    good = ta.simulate("gao2017", poses=40, preset="shop", strategy="measuring", seed=1).session
    assert ta.fit("gao2017", good, model="nominal").frame_changes == ()
    seats = ta.simulate("gao2017", poses=40, preset="shop", strategy="seat", reference=False, seed=1).session
    assert ta.fit("gao2017", seats, model="nominal").frame_changes == ()
