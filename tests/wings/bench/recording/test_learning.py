"""Learning while measuring: what is said after each reading, of one that does not fit, and of which pose comes next."""

import numpy as np
import pytest

import truearm as ta
from truearm.errors import InputError
from truearm.readings import Session
from truearm.wings.bench.recording import learning as learning_module
from truearm.wings.bench.recording.learning import Learning, PosesToMeasure
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.sources import Sample, Source, StandstillRule
from truearm.wings.planning.designs import sequential_update
from truearm.wings.planning.designs.candidates import seat_poses, tracker_poses

RULE = StandstillRule(window_s=0.2)


@pytest.fixture(scope="module")
def arm():
    return ta.load_arm("ur10")


def texts(events, kind):
    return [event.text for event in events if event.kind == kind]


def stop(recording, pose, point=None, start_s=0.0):
    samples = [Sample(start_s + k / 20, np.asarray(pose), point) for k in range(10)]
    return [event for sample in samples for event in recording.on_sample(sample)]


def test_each_reading_lowers_the_uncertainty_and_one_that_is_taken_back_raises_it(arm, ur10_model):
    session = ta.simulate("ur10", poses=20, seed=2).session
    learning = Learning(arm, ur10_model)
    course = [learning.uncertainty_mm]
    for n in range(1, 21):
        assert not texts(learning.learn(session.rows(np.arange(n))), "notice")
        course.append(learning.uncertainty_mm)
    assert np.all(np.diff(course) < 0.02 * course[0])  # the noise may turn out larger
    assert course[-1] < 0.9 * course[0]
    (event,) = learning.learn(session.rows(np.arange(19)))
    assert event.values["after_mm"] > event.values["before_mm"] == pytest.approx(course[-1])


def test_a_reading_that_does_not_fit_is_said_and_not_learned_until_most_do_not(arm, ur10_model):
    session = ta.simulate("ur10", poses=20, seed=2).session
    points = session.points.copy()
    points[12] += [0.0, 2.0, 0.0]
    points[16:] += [0.0, 0.0, 3.0]
    wrong = ta.Session(session.angles, points=points)
    learning, said = Learning(arm, ur10_model), []
    for n in range(1, 21):
        events = [*learning.learn(wrong.rows(np.arange(n)))]
        said.append(texts(events, "notice"))
        assert not said[-1] or n == 19 or len(events) == 1
    assert [n for n, texts_ in enumerate(said, start=1) if texts_] == [13, 17, 18, 19]
    assert said[12][0].startswith("reading 13 does not fit: ")
    assert "it is in the file, and not learned" in said[12][0]
    assert said[18][0].endswith("3 of the last 5 do not, so that all are learned")


def test_of_a_model_only_the_readings_that_it_does_not_know_are_learned(arm, ur10_model, ur10_session):
    learning = Learning(arm, ur10_model, trained_on=60)
    before = learning.uncertainty_mm
    assert [*learning.learn(ur10_session)] == []
    assert learning.uncertainty_mm == pytest.approx(before)
    [*learning.learn(ur10_session.rows(np.arange(59)))]
    [*learning.learn(ur10_session)]  # a reading in place of one that was undone
    assert learning.uncertainty_mm < 0.9999 * before


def test_a_physical_model_starts_with_the_angle_errors_that_it_knows(arm):
    session = ta.simulate("ur10", poses=80, seed=1).session
    first, further = session.rows(np.arange(50)), session.rows(np.arange(50, 80))
    known = ta.fit("ur10", first, model="physical").model
    learning = Learning(arm, known)
    assert not texts(learning.learn(further.rows(np.arange(15))), "notice")
    residuals, covariances = learning.estimate.residuals(others := further.rows(np.arange(15, 30)), known.state(others))
    squares = np.einsum("nc,nc->n", residuals, np.linalg.solve(covariances, residuals[..., None])[..., 0])
    assert 1.0 < squares.mean() < 6.0
    assert learning.estimate.noise_mm < 1.5 * known.residual_std_


def test_in_a_long_session_a_reading_is_learned_mostly_without_the_others(arm, monkeypatch):
    session, of_all, anew = ta.simulate("ur10", poses=320, seed=1).session, learning_module.updated_estimate, []
    monkeypatch.setattr(
        learning_module, "updated_estimate", lambda *given, **more: anew.append(1) or of_all(*given, **more)
    )
    learning = Learning(arm)
    for n in range(300, 321):
        [*learning.learn(session.rows(np.arange(n)))]
    assert len(anew) <= 5


def test_it_is_enough_once(arm, ur10_model):
    session = ta.simulate("ur10", poses=60, seed=2).session
    learning = Learning(arm, ur10_model)
    [*learning.learn(session)]
    poses = session.angles[:20]
    assert [*learning.enough(poses[:11], None)] == []  # fewer gain little, however much is unknown
    (event,) = learning.enough(poses, None)
    assert event.text.startswith("enough: 12 more readings would gain ")
    assert 0 <= event.values["gain"] < 0.05
    assert [*learning.enough(poses, None)] == []
    assert [*Learning(arm).enough(poses, None)] == []  # of an arm of which nothing was measured


def test_enough_in_one_seat_names_it(arm):
    """Of an arm known to 0.6 mm, which another seat would show."""
    poses = seat_poses(arm, seats=1, poses=40, seed=1)
    learning = Learning(arm, has_points=False)
    [*learning.learn(Session(poses.angles, seat=poses.seat))]
    (event,) = learning.enough(poses.angles, poses.seat)
    assert event.text.startswith(f"enough: 12 more readings in seat {poses.seat[0]} would gain ")


def test_ranked_the_plan_goes_on_with_the_pose_that_gains_most_in_its_seat(tmp_path, arm):
    poses = seat_poses(arm, seats=2, poses=5, seed=1)
    head = [*(f"q{j}_deg" for j in range(1, 7)), "seat", "note", *(f"note_q{j}_deg" for j in range(1, 7))]
    rows = [
        [*[""] * 6, seat, "", *[f"{np.degrees(a):.1f}" for a in pose]]
        for seat, pose in zip(poses.seat, poses.angles, strict=True)
    ]
    plan = tmp_path / "plan.csv"
    plan.write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    orders = {}
    for rank in (False, True):
        recording = Recording(
            Source("test", lambda: iter(())), tmp_path / f"{rank}.csv", arm=arm, plan=plan, rule=RULE, rank=rank
        )
        order, start_s, gives = [], 0.0, []
        events = stop(recording, arm.working + 1.0)
        while (number := recording.next_pose) is not None:
            order.append(number)
            start_s += 0.5
            events = stop(recording, recording.aim_rad, start_s=start_s)
            gives += [event.values.get("would_give_mm") for event in events if event.kind == "next"]
        recording.close()
        orders[rank] = order
        assert gives[0] is not None
        assert gives[4] is None  # the first pose in the next seat adds nothing
    assert orders[False] == list(range(1, 11))
    assert orders[True] != orders[False]
    assert sorted(orders[True][:5]) == [1, 2, 3, 4, 5]


def test_where_nothing_says_where_the_tip_is_a_pose_adds_nothing(arm):
    learning = Learning(arm, has_points=False)
    poses = arm.working + np.linspace(0, 0.3, 4)[:, None]
    seat = np.array(["A", "A", "", ""])
    assert learning.after_mm(poses, None) == pytest.approx(learning.uncertainty_mm)
    assert learning.after_mm(poses, seat)[2:] == pytest.approx(learning.uncertainty_mm)


def test_without_a_plan_a_pose_that_the_arm_reaches_is_suggested(tmp_path, arm):
    chain = arm.chain
    recording = Recording(
        Source("test", lambda: iter(()), has_points=True), tmp_path / "out.csv", arm=arm, rule=RULE, rank=True
    )
    said = stop(recording, arm.working, chain.tip_in_base(arm.working[None])[0])
    nexts = [event for event in said if event.kind == "next"]
    assert nexts[-1].values["would_give_mm"] > 0
    assert nexts[-1].values["pose"] is None
    first = recording.aim_rad
    assert any(np.allclose(first, pose) for pose in tracker_poses(arm, 200, seed=1).angles)
    assert [event.kind for event in recording.on_command("skip")] == ["next"]
    assert not np.allclose(recording.aim_rad, first)
    recording.close()
    seats = Recording(Source("test", lambda: iter(())), tmp_path / "seat.csv", arm=arm, rule=RULE, rank=True, seat="A")
    assert texts(stop(seats, arm.working), "next")[0] == "next: any pose, in a seat or with a point"
    assert np.linalg.norm(np.subtract(*chain.tip_in_base([seats.aim_rad, arm.working]))) < 1.0
    seats.close()


def test_what_cannot_be_learned_ends_no_recording_and_can_be_undone(tmp_path, arm):
    recording = Recording(Source("test", lambda: iter(()), has_points=True), tmp_path / "out.csv", arm=arm, rule=RULE)
    said = stop(recording, arm.working, arm.chain.tip_in_base(arm.working[None])[0])
    said += stop(recording, arm.working + 0.3, np.full(3, 2e8), 10.0)
    said += recording.on_command("undo")
    said += stop(recording, arm.working + 0.6, arm.chain.tip_in_base(arm.working[None] + 0.6)[0], 20.0)
    recording.close()
    assert [event.kind for event in said] == ["ready", "reading", "reading", "notice", "undone", "reading", "learned"]
    assert said[3].text.startswith("what the readings say of the arm is not known: a chain's lengths must stay below")


def test_an_estimate_that_rounding_leaves_undefined_is_refused(arm, monkeypatch):
    def fail(*_, **__):
        raise np.linalg.LinAlgError("not positive definite")

    monkeypatch.setattr(sequential_update, "cho_factor", fail)
    with pytest.raises(InputError, match="the readings leave no estimate"):
        [*Learning(arm).learn(ta.simulate("ur10", poses=3, seed=2).session)]


def test_without_the_only_reading_it_is_as_before(tmp_path, arm):
    recording = Recording(Source("test", lambda: iter(()), has_points=True), tmp_path / "a.csv", arm=arm, rank=True)
    (first, *_) = (event for event in stop(recording, arm.working, np.array([1.0, 2.0, 3.0])) if event.kind == "next")
    [*recording.on_command("take moving")]
    undone, again = recording.on_command("undo")
    assert undone.kind == "undone"
    assert again.values == first.values
    recording.close()


def test_each_joint_of_the_next_pose_has_its_unit():
    poses = PosesToMeasure(None, None, is_ranked=False)
    assert poses.event([10.0, -20.0], ["deg", "deg"]).text == "next: J1 10, J2 -20 deg"
    assert poses.event([10.0, 250.0], ["deg", "mm"]).text == "next: J1 10 deg, J2 250 mm"


def test_ranking_needs_the_arm(tmp_path):
    with pytest.raises(InputError, match="the arm's kinematics are not known"):
        Recording(Source("test", lambda: iter(())), tmp_path / "out.csv", rank=True)
