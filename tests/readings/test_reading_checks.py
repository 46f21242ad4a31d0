"""What a fit demands: a sentence that names the joint, the line, the column and the remedy."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import InputError
from truearm.readings import (
    Lengths,
    Session,
    check_angles,
    check_fit,
    check_reach,
    check_scale,
    check_sessions,
    has_reference,
    limit_excesses,
    read_session,
    skip_beyond_limits,
)
from truearm.readings.checks import frozen_joints, remedy_of_unit

LIMITS = np.radians([[-180.0, 180.0], [-90.0, 90.0]])
HEADER = "q1_deg,q2_deg,x_mm,y_mm,z_mm\n"
ROWS = ["10,20,1,2,3", "30,-40,4,5,6", "50,60,7,8,9"]


def session(folder, rows, header=HEADER):
    path = folder / "s.csv"
    path.write_text(header + "\n".join(rows) + "\n")
    return read_session(path)


def check(readings, *, min_rows=3, **options):
    check_fit(readings, n_joints=2, min_rows=min_rows, **options)


def refusal(readings, **options):
    caught = refuses(None, check, readings, **options)
    assert caught.file == readings.file
    return caught


def test_good_readings_pass(tmp_path):
    check(session(tmp_path, ROWS))
    check_angles(session(tmp_path, ROWS), n_joints=2)


def test_a_wrong_number_of_joints_is_refused(tmp_path):
    readings = session(tmp_path, ["1", "2"], header="q1_deg\n")
    assert "expected 2 joints (J1 .. J2), got 1" in refusal(readings).problem
    refuses("expected 2 joints", check_angles, readings, n_joints=2)


def test_missing_reference_points_are_said(tmp_path):
    error = refusal(session(tmp_path, ["1,2", "3,4"], header="q1_deg,q2_deg\n"))
    assert "no reference points" in error.problem
    assert "x_mm, y_mm, z_mm" in error.hint


SEATS = "q1_deg,q2_deg,x_mm,y_mm,z_mm,seat,sphere\n"
MIXED = ["10,20,1,2,3,,", "30,-40,,,,A,", "50,60,,,,A,", "60,70,,,,,ball"]


def test_a_model_of_points_alone_needs_one_at_every_reading(tmp_path):
    readings = session(tmp_path, MIXED, header=SEATS)
    error = refusal(readings)
    assert error.line == 3
    assert "3 of 4 readings have no reference point" in error.problem
    assert "learns from seats" in error.hint
    check(readings, relations=True)
    check(readings.rows(readings.has_point), min_rows=1)


def test_a_model_of_relations_needs_something_known_of_some_tips(tmp_path):
    readings = session(tmp_path, [*MIXED, "70,80,,,,,"], header=SEATS)
    assert has_reference(readings).tolist() == [True, True, True, True, False]
    check(readings, min_rows=4, relations=True)
    assert "expected at least 5 readings, got 4" in refusal(readings, min_rows=5, relations=True).problem
    error = refusal(session(tmp_path, ["1,2,", "3,4,"], header="q1_deg,q2_deg,seat\n"), relations=True)
    assert "no reference at all (points, seats" in error.problem
    assert "column seat" in error.hint
    turned = Session(np.zeros((2, 2)), quaternion=[[1, 0, 0, 0], [np.nan] * 4], line=np.array(["", ""]))
    assert has_reference(turned).tolist() == [True, False]


def test_seats_of_one_known_point_may_repeat_it(tmp_path):
    header = "q1_deg,q2_deg,x_mm,y_mm,z_mm,seat\n"
    check(session(tmp_path, ["10,20,1,2,3,A", "30,-40,1,2,3,A", "50,60,,,,A"], header=header), relations=True)


def test_too_few_poses_are_refused(tmp_path):
    error = refusal(session(tmp_path, ROWS), min_rows=8)
    assert "expected at least 8 readings, got 3" in error.problem
    assert "measure more poses" in error.hint


def test_a_few_readings_beyond_the_limits_are_skipped_and_named(tmp_path):
    readings = session(tmp_path, [*ROWS, "0,-100,1,1,1", "200,95,1,1,2"])
    kept, skipped = skip_beyond_limits(readings, LIMITS)
    np.testing.assert_array_equal(kept.angles, readings.angles[:3])
    assert [str(excess) for excess in skipped] == [
        "line 5: J2 is at -100 deg, outside its limits -90 .. 90 deg",
        "line 6: J1 is at 200 deg, outside its limits -180 .. 180 deg",
    ]
    assert [excess.row for excess in skipped] == [3, 4]


def test_what_is_left_after_skipping_keeps_its_lines(tmp_path):
    kept, _ = skip_beyond_limits(session(tmp_path, ["0,-100,1,1,1", *ROWS, ROWS[0]]), LIMITS)
    assert kept.called(0) == "line 3"
    assert kept.called(len(kept) - 1) == "line 6"


def test_an_arm_that_is_mostly_outside_its_limits_is_refused(tmp_path):
    readings = session(tmp_path, [ROWS[0], "0,-100,1,1,1", "200,95,1,1,2"])
    caught = refuses("J2 is at -100 deg, outside its limits -90 .. 90 deg", skip_beyond_limits, readings, LIMITS)
    assert (caught.line, caught.column) == (3, "q2_deg")
    assert "2 of 3 readings" in caught.problem
    assert "unit, sign and zero" in caught.hint


def test_limits_can_be_ignored(tmp_path):
    """The list without the refusal, for whoever knows that the limits are wrong."""
    assert len(limit_excesses(session(tmp_path, ["0,-100,1,1,1", "200,95,1,1,2"]), LIMITS)) == 2


def test_limits_of_a_sliding_joint_are_shown_in_mm():
    readings = Session([[0.0, 120.0], [1.0, 2.0]], np.eye(3)[:2])
    _, skipped = skip_beyond_limits(readings, [[-np.pi, np.pi], [0, 100.0]], prismatic=[False, True])
    assert str(skipped[0]) == "reading 1: J2 is at 120 mm, outside its limits 0 .. 100 mm"


def test_rounding_does_not_pass_a_limit():
    assert limit_excesses(Session([[np.pi * (1 + 1e-9), 0.1], [0.0, 0.2]]), LIMITS) == ()


def test_infinite_limits_are_no_limits():
    assert limit_excesses(Session([[900.0, 0.1], [0.0, 0.2]]), [[-np.inf, np.inf], [-2, 2]]) == ()


def test_readings_of_one_pose_are_refused(tmp_path):
    error = refusal(session(tmp_path, ["10,20,1,2,3", "10,20,4,5,6", "10,20,7,8,9"]))
    assert "all 3 readings have the same angles" in error.problem


def test_the_same_angles_may_be_measured_twice(tmp_path):
    check(session(tmp_path, [*ROWS, "10,20,1.001,2,3"]))


def test_readings_without_a_file_go_by_number():
    session = Session([[0.1, 0.2], [0.3, 0.4], [0.1, 0.2]], [[1, 2, 3], [4, 5, 6], [1e5, 2, 3]])
    caught = refuses(None, check_reach, session, reach=1000.0)
    error = caught
    assert "reading 3: the reference point lies" in str(error)
    assert error.line is None


def test_points_that_no_single_arm_can_have_touched(rng):
    """Points of an arm lie within two reaches of each other; a metre taken for a millimetre does not."""
    points = rng.uniform(-1000, 1000, (20, 3)) + [1e5, 0, 0]  # the frame may be anywhere
    angles = rng.uniform(-1, 1, (20, 2))
    check_reach(Session(angles, points), reach=1000.0)
    check_reach(Session(angles), reach=1000.0)
    points[3] = np.nan
    check_reach(Session(angles, points), reach=1000.0)
    points[7, 1] = 4.2e6
    with pytest.raises(InputError, match=r"4\.2e\+06 mm from the median of all.*1 of 19 readings"):
        check_reach(Session(angles, points), reach=1000.0)
    far = Session(angles, points, file=Path("s.csv"), numbers=np.arange(2, 22), by_line=True)
    caught = refuses(r"s\.csv, line 9: the reference point lies", check_reach, far, reach=1000.0)
    assert caught.hint == "check the unit of the points, or delete the reading"


def test_points_of_several_sessions_lie_together_session_by_session(rng):
    """A tracker may stand anywhere in the next session; a point far from its own session's is as wrong as ever."""
    points, angles = rng.uniform(-1000, 1000, (20, 3)), rng.uniform(-1, 1, (20, 2))
    points[12:] += 1e5
    session = np.where(np.arange(20) < 12, "May", "June")
    check_reach(Session(angles, points, session=session), reach=1000.0)
    session[12] = "May"
    with pytest.raises(InputError, match=r"reading 13: the reference point .*1 of 20 readings"):
        check_reach(Session(angles, points, session=session), reach=1000.0)


@settings(max_examples=30)
@given(st.lists(st.tuples(st.sampled_from("abcd "), st.sampled_from(["s", "t", ""])), min_size=1, max_size=8))
def test_a_place_is_of_one_session(rows):
    """Refused is what has a name in two sessions, to have none being one too, and nothing else."""
    names, session = (np.array([row[i].strip() for row in rows]) for i in (0, 1))
    in_two = any(len(set(session[names == name])) > 1 for name in set(names) - {""})
    for kind in ("seat", "sphere", "plane", "line"):
        readings = Session(np.zeros((len(rows), 2)), session=session, **{kind: names})
        if in_two:
            caught = refuses(
                f"{kind} '.*, but the base or the reference moved between sessions", check_sessions, readings
            )
            assert caught.column == kind
            assert f"name the {kind} differently" in caught.hint
        else:
            check_sessions(readings)
        check_sessions(replace(readings, session=None))
        check_sessions(replace(readings, points=np.zeros((len(rows), 3))), own_frame=True)
    with pytest.raises(InputError, match="seat") if in_two else nullcontext():  # without points nothing says where
        check_sessions(Session(np.zeros((len(rows), 2)), session=session, seat=names), own_frame=True)


def test_a_length_lies_within_a_session(tmp_path):
    seat, names = np.array(["a", "b", "c", "d"]), np.array(["s", "s", "t", ""])
    readings = Session(np.zeros((4, 2)), np.zeros((4, 3)), seat=seat, session=names)
    check_sessions(readings, Lengths(["a"], ["b"], [100.0], [0.01]))
    check_sessions(readings, Lengths(["x"], ["b"], [100.0], [0.01]))  # of another part of the measurements
    for other, said in (("c", "in session 't'"), ("d", "in a reading that names no session")):
        lengths = Lengths(["a", "a"], ["b", other], [100.0, 50], [0.01, 0.01])
        caught = refuses(
            f"length 2, .*seat 'a' is in session 's', seat '{other}' is {said}", check_sessions, readings, lengths
        )
        assert caught.hint.startswith("state lengths between seats of one session")
        check_sessions(readings, lengths, own_frame=True)
    readings = session(tmp_path, ["1,2,a,s", "3,4,b,s", "5,6,a,t"], header="q1_deg,q2_deg,seat,session\n")
    caught = refuses("and in session 't'", check_sessions, readings)
    assert (caught.line, caught.file) == (4, readings.file)


def test_no_joint_turns_without_end_however_free_it_is():
    readings = Session([[0.0], [1e7]])
    refuses("reading 2: J1 is at 1e.07 rad or mm, which no joint reaches", check_angles, readings, n_joints=1)


def test_a_reference_that_never_moves():
    readings = Session(np.linspace([0.0, 0.0], [1.0, 2.0], 6), np.full((6, 3), 5.0))
    with pytest.raises(InputError, match="all 6 readings have the same reference point, though the joints move"):
        check_fit(readings, n_joints=2, min_rows=4)


@pytest.mark.parametrize(("unit", "mm"), [("m", 1000.0), ("cm", 10.0), ("inch", 25.4), ("um", 0.001)])
def test_reference_points_in_another_unit_are_refused_with_that_unit(rng, unit, mm):
    tips = rng.normal(scale=400.0, size=(50, 3))
    session = Session(rng.uniform(-2, 2, (50, 6)), (tips + [800.0, 0.0, 300.0]) / mm)
    refuses(f"may be in {unit}:", check_scale, session, tips)


@pytest.mark.parametrize(("unit", "mm"), [("m", 1000.0), ("cm", 10.0), ("inch", 25.4)])
def test_distances_in_another_unit_have_it_as_their_remedy(rng, unit, mm):
    """Of pins around an arm whose nominal tips are off by 10 mm."""
    tips, pins = rng.normal(scale=200.0, size=(60, 3)), rng.normal(scale=300.0, size=(3, 3))
    distance = np.linalg.norm(tips + rng.normal(scale=10.0, size=(60, 3)) - np.repeat(pins, 20, axis=0), axis=1)
    given = {"anchor": np.repeat(["a", "b", "c"], 20), "distance_mm": distance / mm}
    session = Session(rng.uniform(-2, 2, (60, 6)), **given)
    assert f"distances to anchors may be in {unit}:" in remedy_of_unit(session, tips)
    assert remedy_of_unit(replace(session, distance_mm=distance), tips) == ""


def test_the_unit_shows_in_set_ups_that_are_far_apart(rng):
    tips = rng.normal(scale=400.0, size=(60, 3))
    set_up = np.repeat(["a", "b", "c"], 20)
    apart = np.repeat([[0.0, 0.0, 0.0], [3e3, 0.0, 0.0], [0.0, 9e3, 0.0]], 20, axis=0)
    angles = rng.uniform(-2, 2, (60, 6))
    check_scale(Session(angles, tips + apart, session=set_up), tips)
    with pytest.raises(InputError, match="may be in m:"):
        check_scale(Session(angles, (tips + apart) / 1000, session=set_up), tips)


def test_repeats_of_one_pose_do_not_say_a_unit(rng):
    tips = 1e-3 * rng.normal(size=(12, 3))
    check_scale(Session(rng.uniform(-2, 2, (12, 6)), 50 * tips), tips)


def test_reference_points_that_spread_about_as_far_as_the_tips_pass(rng):
    tips = rng.normal(scale=400.0, size=(50, 3))
    for factor in (0.3, 1.0, 3.0):
        check_scale(Session(rng.uniform(-2, 2, (50, 6)), factor * tips), tips)
    check_scale(Session(rng.uniform(-2, 2, (50, 6))), tips)


TURNING = np.zeros(6, dtype=bool)


def test_an_encoder_that_froze_for_some_readings_is_named_with_its_lines():
    """Every joint in turn, to the last digit; the same rows with noise of a millionth of a degree are readings."""
    angles = np.random.default_rng(1).uniform(-2, 2, (60, 6))
    assert frozen_joints(Session(angles, np.zeros((60, 3))), TURNING) == ()
    for joint in range(6):
        frozen = angles.copy()
        frozen[20:28, joint] = frozen[20, joint]
        (said,) = frozen_joints(Session(frozen, np.zeros((60, 3))), TURNING)
        at = np.degrees(frozen[20, joint])
        assert said.startswith(f"J{joint + 1} is {at:.6g} deg in all readings from reading 21 to reading 28, to the")
        frozen[:, joint] += 1e-8 * np.random.default_rng(2).normal(size=60)
        assert frozen_joints(Session(frozen, np.zeros((60, 3))), TURNING) == ()


def test_joints_that_a_program_keeps_still_are_no_frozen_encoders():
    """A grid of few values, joints that move one at a time, a locked joint, and poses read several times."""
    rng = np.random.default_rng(3)
    random = rng.uniform(-2, 2, (90, 6))
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 3)] * 4, [0.5], [0.1], indexing="ij"), axis=-1).reshape(-1, 6)
    grid[:, 5] = rng.uniform(-2, 2, len(grid))
    alone = np.repeat(rng.uniform(-2, 2, (1, 6)), 90, axis=0)
    for joint in range(6):
        alone[15 * joint : 15 * joint + 15, joint] = rng.uniform(-2, 2, 15)
    locked = random.copy()
    locked[:, 4] = 0.3
    for angles in (grid, alone, locked, np.repeat(random, 8, axis=0)):
        assert frozen_joints(Session(angles, np.zeros((len(angles), 3))), TURNING) == ()
