"""Laws of a plan read back: what was written comes back, and what is no plan of this arm is refused."""

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.wings.planning.designs.candidates import Candidates, bar_places
from truearm.wings.planning.designs.planned_readings import read_planned
from truearm.wings.planning.designs.template import write_template


@pytest.fixture(scope="module")
def arm():
    return load_arm("gao2017")


@pytest.fixture
def plan(arm, tmp_path):
    poses = bar_places(arm, 1, length_mm=300, poses=2, seed=0)
    write_template(arm, poses, tmp_path / "plan.csv")
    return poses, tmp_path / "plan.csv"


def test_the_poses_of_a_plan_come_back_to_a_tenth_of_a_degree(arm, plan):
    poses, path = plan
    planned = read_planned(path, arm)
    assert np.abs(np.degrees(planned.angles - poses.angles)).max() <= 0.05 + 1e-9  # rounded to 0.1 deg
    assert planned.seat.tolist() == poses.seat.tolist()
    assert set(planned.position.tolist()) == {"B1"}
    assert planned.sphere is None


def test_what_was_measured_already_is_not_read(arm, plan):
    _, path = plan
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[1] = lines[1].replace(",,,,,,", "1,2,3,4,5,6,", 1)
    path.write_text("\n".join(lines), encoding="utf-8")
    assert len(read_planned(path, arm)) == 4


def test_a_tracker_plan_has_nothing_to_touch(arm, tmp_path):
    write_template(arm, Candidates(arm.working[None], np.arange(1)), tmp_path / "plan.csv")
    planned = read_planned(tmp_path / "plan.csv", arm)
    assert planned.seat is None
    assert planned.sphere is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("q1_deg,x_mm\n1,2\n", "expected a plan with the angles to aim at in note_q1_deg"),
        ("test,note_x_mm\nuni,2\n", "expected a plan .* verification need --artefacts"),
        ("seat,note_q1_deg,note_q2_deg\nS1,1,2\n", "expected angles to aim at in note_q1_deg to note_q6_deg"),
        ("seat,HEADS\n,1,2,3,4,5,6\n", "line 2.*got neither a seat nor a sphere"),
        ("seat,sphere,HEADS\nS1,ball,1,2,3,4,5,6\n", "line 2.*got a seat and a sphere"),
        ("seat,HEADS\nS1,1,2,3,4,five,6\n", "line 2.*note_q5_deg.*expected a number"),
    ],
)
def test_a_file_that_is_no_plan_is_refused(arm, tmp_path, text, message):
    heads = ",".join(f"note_q{joint}_deg" for joint in range(1, 7))
    path = tmp_path / "plan.csv"
    path.write_text(text.replace("HEADS", heads), encoding="utf-8")
    refuses(message, read_planned, path, arm)


def test_an_aim_beyond_a_limit_is_another_arm(tmp_path):
    arm = load_arm("measuring7")
    angles = arm.working[None].copy()
    angles[0, 1] = np.radians(150)  # J2 ends at 120 deg
    write_template(arm, Candidates(angles, np.arange(1)), tmp_path / "plan.csv")
    with pytest.raises(
        InputError, match=r"line 2, column 'note_q2_deg': joint J2 of arm 'measuring7' does not reach 150"
    ):
        read_planned(tmp_path / "plan.csv", arm)
