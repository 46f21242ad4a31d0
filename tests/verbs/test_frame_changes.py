"""A fit says what changed at which line and what to do; followed, it is silent, and the arm is as good as without."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.models.selection import CANDIDATES
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


def test_a_step_that_does_not_matter_is_not_said():
    """Of 3000 readings a step of 0.003 mm is clear, where the residuals are 0.02 mm: no session is divided for it."""
    warming = ta.simulate("ur10", poses=3000, seed=11).session
    assert ta.fit("ur10", warming, model="kinematic").frame_changes == ()


@pytest.mark.parametrize("model", ["hybrid", pytest.param("network", marks=pytest.mark.weekly)])
def test_networks_do_not_hide_a_move(moved, model):
    """They have no frame of their own: the arm fitted beside them shows it."""
    options = {"hidden": (4,), "epochs": 3}
    (change,) = ta.fit("gao2017", moved, model=model, **options).frame_changes
    assert change.change.row == ROW


def test_a_joint_that_slipped_is_named_and_its_readings_after_it_are_used():
    """Its zero changed by 0.05 degrees: two sessions would not help, the readings of one side do."""
    good = ta.simulate("ur5", poses=90, preset="shop", seed=2).session
    angles = good.angles.copy()
    angles[40:, 2] -= np.radians(0.05)
    result = ta.fit("ur5", replace(good, angles=angles), model="kinematic")
    (change,) = result.frame_changes
    assert change.change.what == "the zero of joint 3"
    assert change.change.row == 40
    assert np.degrees(change.change.motion[0]) == pytest.approx(0.05, abs=0.003)
    said = str(change)
    assert "The zero of joint 3 moved between reading 40 and reading 41" in said
    assert "with the readings from reading 41 on alone" in said
    after = good.rows(np.arange(40, 90))
    followed = ta.fit("ur5", replace(after, angles=angles[40:]), model="kinematic")
    assert followed.frame_changes == ()
    assert followed.model.residual_std_ < 0.2 * result.model.residual_std_ or followed.model.residual_std_ < 0.02


def test_the_base_about_joint_1_or_its_zero_is_named_as_both_and_two_sessions_help():
    """The same motion of every point: that names in the column session do not help was said of it."""
    good = ta.simulate("ur5", poses=90, preset="shop", seed=2).session
    turned = np.array([[1.0, -1e-3, 0.0], [1e-3, 1.0, 0.0], [0.0, 0.0, 1.0]])
    points = good.points.copy()
    points[40:] = points[40:] @ turned.T
    result = ta.fit("ur5", replace(good, points=points), model="kinematic")
    (change,) = result.frame_changes
    assert change.change.row == 40
    said = str(change)
    assert "or the zero of joint 1 (no reading shows which), moved between reading 40 and reading 41" in said
    assert "by 0.057" in said
    assert "Enter one name up to reading 40 and another from reading 41 in the column session" in said
    names = np.where(np.arange(90) < 40, "a", "b")
    followed = ta.fit("ur5", replace(good, points=points, session=names), model="kinematic")
    assert followed.frame_changes == ()
    assert len(result.outliers) > 20 > 2 > len(followed.outliers)  # one side was excluded


def test_distances_that_are_10_mm_longer_from_a_row_on_are_named():
    """A wire that was hooked in otherwise; a good session of wires is not questioned."""
    options = {"preset": "printed", "anchors": 3, "reference": False, "strategy": "uniform", "seed": 5}
    good = ta.simulate("so101", poses=40, **options).session
    assert ta.fit("so101", good, model="kinematic").frame_changes == ()
    longer = replace(good, distance_mm=good.distance_mm + 10.0 * (np.arange(len(good)) >= 60))
    (change,) = ta.fit("so101", longer, model="kinematic").frame_changes
    assert change.change.row == 60
    assert "The zero of the distances, or an anchor or the base" in str(change)
    assert change.change.shift_mm == pytest.approx(10.0, abs=2.0)  # the anchors' places take some of it


def test_auto_offers_no_hybrid_where_something_changed(monkeypatch):
    """And says why: its networks would learn when it was."""
    monkeypatch.delitem(CANDIDATES, "physical")  # quicker
    good = ta.simulate("gao2017", poses=150, preset="shop", strategy="uniform", seed=3).session
    points = good.points.copy()
    points[75:] += [1.0, 0.0, 0.0]
    result = ta.fit("gao2017", replace(good, points=points))
    assert result.model_name != "hybrid"
    assert any("would learn what changed during the session" in remark for remark in result.remarks)
    assert [change.change.row for change in result.frame_changes] == [75]
