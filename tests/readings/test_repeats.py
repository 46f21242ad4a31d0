"""Laws of repeats: readings of one pose count once, as their mean; what is stated otherwise is no repeat."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.readings import Session
from truearm.readings.repeats import merge_repeats, readings_of_one_pose, rounding_steps

POSES, TIMES = 20, 3


def session(within: float = 0.001, order: str = "in turn", **more: object) -> Session:
    """Poses read three times, one after the other or in three rounds; points scatter within a pose [mm]."""
    rng = np.random.default_rng(1)
    pose = np.repeat(np.arange(POSES), TIMES) if order == "in turn" else np.tile(np.arange(POSES), TIMES)
    angles = rng.uniform(-2, 2, (POSES, 6))[pose] + rng.normal(0, 5e-6 if within else 0, (POSES * TIMES, 6))
    points = rng.uniform(-500, 500, (POSES, 3))[pose] + within * rng.normal(size=(POSES * TIMES, 3))
    return Session(angles, points=points, position=np.char.add("P", pose.astype(str)), **more)


@pytest.mark.parametrize("order", ["in turn", "in rounds"])
def test_repeats_are_their_mean_and_keep_the_first_line(order):
    given = session(order=order)
    merged = merge_repeats(given)
    assert merged.count.tolist() == [TIMES] * POSES
    rows = np.arange(POSES * TIMES).reshape(POSES, TIMES) if order == "in turn" else np.arange(60).reshape(3, 20).T
    assert merged.first.tolist() == rows[:, 0].tolist()
    np.testing.assert_allclose(merged.readings.points, given.points[rows].mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(merged.readings.angles, given.angles[rows].mean(axis=1), atol=1e-15)
    assert [merged.readings.called(0), merged.readings.called(1)] == [given.called(row) for row in rows[:2, 0]]
    assert 0.0007 < merged.scatter_mm < 0.0013  # 40 degrees of freedom
    unnamed = merge_repeats(replace(given, position=None))
    np.testing.assert_array_equal(unnamed.readings.points, merged.readings.points)


def test_copies_are_the_readings_once_to_the_last_digit():
    given = session(within=0.0)
    merged = merge_repeats(given)
    np.testing.assert_array_equal(merged.readings.points, given.points[::TIMES])
    np.testing.assert_array_equal(merged.readings.angles, given.angles[::TIMES])
    assert merged.scatter_mm == 0


def test_readings_without_repeats_stay_the_same_object():
    given = session().rows(slice(None, None, TIMES))
    merged = merge_repeats(given)
    assert merged.readings is given
    assert merged.first.tolist() == list(range(POSES))


def test_a_mean_averages_the_scatter_and_not_the_rest_of_a_stated_uncertainty():
    given = session(point_std=np.full((POSES * TIMES, 3), 0.005))
    merged = merge_repeats(given)
    w = merged.scatter_mm
    np.testing.assert_allclose(merged.readings.point_std, np.sqrt(0.005**2 - w**2 + w**2 / TIMES))
    honest = merge_repeats(session(0.005, point_std=np.full((POSES * TIMES, 3), 0.001)))
    np.testing.assert_allclose(honest.readings.point_std, 0.001 / np.sqrt(TIMES))


EACH = np.tile(np.arange(TIMES), POSES)
OTHERWISE = {
    "direction": {"directions": np.repeat(np.where(EACH == 0, -1.0, 1.0)[:, None], 6, axis=1)},
    "session": {"session": np.where(EACH == 0, "A", "B")},
    "tip": {"tip": np.where(EACH == 0, "ball", "cone")},
    "temperature": {"temperature_degC": np.where(EACH == 0, 20.0, 23.0) + 0.01 * EACH},
    "load": {"columns": {"load_1_Nm": np.where(EACH == 0, 1.0, 5.0)}},
    "anchor": {"anchor": np.where(EACH == 0, "A", "B"), "distance_mm": 500 + 1e-4 * EACH, "points": None},
    "seat": {"seat": np.where(EACH == 0, "A", "B"), "points": None},
}


@pytest.mark.parametrize("what", OTHERWISE)
def test_what_is_stated_otherwise_is_no_repeat_but_held_out_together(what):
    given = replace(session(), **OTHERWISE[what])
    merged = merge_repeats(given)
    assert np.bincount(merged.count, minlength=4).tolist() == [0, POSES, POSES, 0]
    assert len(np.unique(readings_of_one_pose(given))) == POSES
    train, test = given.split(by="row", hold_out=0.5, seed=0)
    assert len(train) == len(test) == POSES * TIMES / 2


def test_a_seat_touched_from_several_poses_is_no_repeat():
    given = session().rows(slice(None, None, TIMES))
    assert merge_repeats(replace(given, points=None, seat=np.full(POSES, "A"))).count.max() == 1


def test_the_odd_one_of_three_stands_alone_and_two_that_disagree_do_too():
    given = session()
    points = given.points.copy()
    points[4] += 0.5  # of three
    merged = merge_repeats(replace(given, points=points))
    odd = merged.first.tolist().index(4)
    np.testing.assert_array_equal(merged.readings.points[odd], points[4])
    np.testing.assert_allclose(merged.readings.points[1], points[[3, 5]].mean(axis=0), atol=1e-12)
    assert (len(merged.count), merged.scatter_mm < 0.0013) == (POSES + 1, True)
    two = replace(given, points=points).rows(np.setdiff1d(np.arange(POSES * TIMES), [5]))
    assert len(merge_repeats(two).count) == POSES + 1


def test_repeats_of_a_camera_are_merged_however_they_scatter():
    assert len(merge_repeats(session(within=2.0)).count) == POSES


@pytest.mark.parametrize("row", [POSES, POSES + 10, 2 * POSES])
def test_rounds_between_which_the_frame_moved_are_not_averaged(row):
    """What moved is then found in the order of the readings, as without repeats."""
    given = session(order="in rounds")
    points = given.points.copy()
    points[row:, 1] += 0.2
    assert len(merge_repeats(replace(given, points=points)).count) == POSES * TIMES
    in_turn = session()
    points = in_turn.points.copy()
    points[30:, 1] += 0.2
    assert len(merge_repeats(replace(in_turn, points=points)).count) == POSES


def test_a_slow_scan_is_no_chain_of_repeats():
    """Readings nearer than noise to the one before are of the pose that began, not of one long pose."""
    angles = np.linspace(0, 0.01, 201)[:, None] * np.ones(2)  # steps of 5e-5 rad
    assert merge_repeats(Session(angles, points=1000 * np.ones((201, 3)))).count.max() <= 3


def test_the_mean_of_quaternions_does_not_depend_on_their_sign():
    q = np.array([[1.0, 0.001, 0, 0], [-1.0, -0.003, 0, 0]])
    merged = merge_repeats(Session(np.ones((2, 3)), quaternion=q))
    np.testing.assert_allclose(merged.readings.quaternion, [[1, 0.002, 0, 0]], atol=1e-5)


def test_a_pose_that_settles_is_merged_as_long_as_nothing_moves_between_poses():
    """An arm that sags by 0.03 mm from the first repeat to the third does so at every pose."""
    given = session(0.003)
    sagging = replace(given, points=given.points - np.array([0, 0, 0.015]) * EACH[:, None])
    assert (len(merge_repeats(sagging).count), merge_repeats(sagging).n_changed) == (POSES, 0)


def test_rounds_of_runs_are_merged_run_by_run_where_the_frame_moved_between_them():
    one = session()
    two = np.concatenate([np.arange(len(one))] * 2)
    points = one.points[two] + np.array([0.2, 0, 0]) * (np.arange(len(two)) >= len(one))[:, None]
    merged = merge_repeats(replace(one.rows(two), points=points, position=None))
    assert (merged.count.tolist(), merged.n_changed) == ([TIMES] * (2 * POSES), POSES)


def test_a_gross_error_hides_no_move_between_rounds():
    given = session(order="in rounds")
    points = given.points.copy()
    points[POSES:, 0] += 0.5
    points[2 * POSES + 3] += 30
    assert merge_repeats(replace(given, points=points)).n_changed == POSES


N_ROUND, CHAIN = 120, ta.load_arm("ur10").chain


def two_rounds(seed: int, noise: float, moved: str) -> Session:
    """Poses of an arm read twice; between the rounds the tip was re-seated, or nothing was."""
    rng, chain = np.random.default_rng(seed), CHAIN
    angles = rng.uniform(-2, 2, (N_ROUND, 6))
    tips = chain.tip_in_base(angles)
    off = np.array([0.5, 0.3, 0.0]) if moved == "tip" else np.zeros(3)
    again = chain.with_tip(chain.tip_in_flange + off).tip_in_base(angles)
    points = np.concatenate([tips, again]) + noise * rng.normal(size=(2 * N_ROUND, 3))
    return Session(np.concatenate([angles, angles]), points=points)


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_a_tip_that_was_seated_again_between_rounds_is_not_averaged_away(noise):
    assert [merge_repeats(two_rounds(seed, noise, "tip")).n_changed for seed in range(5)] == [N_ROUND] * 5


@pytest.mark.parametrize("noise", [0.02, 1.0])
def test_noise_between_rounds_is_no_change(noise):
    assert not any(merge_repeats(two_rounds(seed, noise, "nothing")).n_changed for seed in range(20))


def test_a_load_of_noise_prevents_nothing_and_one_that_is_changed_does():
    given, rng = session(), np.random.default_rng(2)
    noise = merge_repeats(replace(given, columns={"load_1_Nm": rng.normal(size=POSES * TIMES)}))
    assert len(noise.count) < 1.3 * POSES
    changed = np.tile([0.0, 5.0, 5.0], POSES) + 0.1 * rng.normal(size=POSES * TIMES)
    assert len(merge_repeats(replace(given, columns={"load_1_Nm": changed})).count) == 2 * POSES


def test_a_few_poses_of_a_camera_that_were_read_often_are_merged():
    rng, pose = np.random.default_rng(3), np.repeat(np.arange(4), 10)
    angles, points = rng.uniform(-2, 2, (4, 6))[pose], rng.uniform(-500, 500, (4, 3))[pose]
    noisy = points + 0.5 * rng.normal(size=points.shape)
    assert len(merge_repeats(Session(angles, points=noisy)).count) == 4
    noisy[7] += 30
    assert merge_repeats(Session(angles, points=noisy)).count.tolist() == [9, 1, 10, 10, 10]


def test_angles_that_flicker_by_their_last_digit_are_of_one_pose_and_their_mean_has_as_many():
    rng, pose, step = np.random.default_rng(4), np.repeat(np.arange(POSES), TIMES), np.radians(0.01)
    angles = step * (np.round(rng.uniform(-2, 2, (POSES, 6)) / step)[pose] + rng.integers(0, 2, (POSES * TIMES, 6)))
    merged = merge_repeats(Session(angles, points=rng.uniform(-500, 500, (POSES, 3))[pose]))
    assert merged.count.tolist() == [TIMES] * POSES
    np.testing.assert_allclose(rounding_steps(merged.readings.angles), step, rtol=1e-6)


def test_poses_are_looked_for_once(monkeypatch):
    readings = session()
    found = [readings_of_one_pose(readings, exactly=exactly) for exactly in (False, True)]
    monkeypatch.setattr("truearm.readings.repeats._of_near_angles", None)
    assert readings_of_one_pose(readings) is found[0]
    assert readings_of_one_pose(readings, exactly=True) is found[1]
