"""`record`: a replayed session comes back; plans, seats, undo, typed points and a second instrument."""

import json
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.wings.bench.recording.record_readings import record
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.sources import Notice, Sample, Source, StandstillRule

RULE = StandstillRule(window_s=0.2)


def stops(*poses, start_s=0.0, points=None, button=False):
    """Samples of stops of half a second at 20 Hz."""
    for number, pose in enumerate(poses):
        for k in range(10):
            point = None if points is None else np.asarray(points[number], dtype=float)
            time_s = start_s + (10 * number + k) / 20
            yield Sample(time_s, np.asarray(pose, dtype=float), point, is_button_pressed=button and k > 5)


def source(*samples, **keys):
    return Source("test", lambda: iter(samples), **keys)


def kinds(events):
    return [event.kind for event in events]


def fed(recording, samples):
    return [event for sample in samples for event in recording.on_sample(sample)]


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A plan of six poses in two seats of an arm, in each of which the hand turns."""
    path = tmp_path_factory.mktemp("plan") / "plan.csv"
    poses = [[f"{60 * (k // 3)}", "1", "2", "3", "4", f"{20 * (k % 3) + 5}"] for k in range(6)]
    head = [*(f"q{j}_deg" for j in range(1, 7)), "seat", "note", *(f"note_q{j}_deg" for j in range(1, 7))]
    rows = [[*[""] * 6, f"S{k // 3 + 1}", f"tip in seat S{k // 3 + 1}", *pose] for k, pose in enumerate(poses)]
    path.write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    return path, np.radians(np.array(poses, dtype=float))


def test_a_replayed_session_comes_back(tmp_path):
    session = ta.simulate("ur10", poses=12, seed=3).session
    session.save(tmp_path / "simulated.csv")
    events = [*record(f"replay:{tmp_path / 'simulated.csv'}@max", tmp_path / "out.csv", arm="ur10")]
    again = ta.read_session(tmp_path / "out.csv")
    # A stop may begin with the end of the movement to it, within the spread of a standstill.
    assert again.angles == pytest.approx(session.angles, abs=StandstillRule().spread_rad)
    assert np.median(np.abs(again.angles - session.angles)) < 1e-12
    assert again.points == pytest.approx(session.points, abs=1e-9)
    assert again.directions.tolist() == session.directions.tolist()
    assert again.temperature_degC == pytest.approx(session.temperature_degC)
    # The first point says where the base is, and nothing of the arm.
    assert kinds(events) == ["ready", "reading", *["reading", "learned"] * 11, "notice", "end"]
    for event in events:
        json.dumps(event.to_dict(), allow_nan=False)


def test_a_plan_names_seats_and_says_what_comes_next_and_is_continued(tmp_path, planned):
    plan, poses = planned
    out = tmp_path / "out.csv"
    first = [*record(source(*stops(*poses[:4])), out, arm="ur10", plan=plan, rule=RULE)]
    said = [event.text for event in first if event.kind == "next"]
    assert said[0] == "next: pose 1 of 6, tip in seat S1; J1 0, J2 1, J3 2, J4 3, J5 4, J6 5 deg; 6 to go"
    assert said[-1].startswith("next: pose 5 of 6, tip in seat S2; J1 60,")
    assert [event.values["note_pose"] for event in first if event.kind == "reading"] == ["1", "2", "3", "4"]
    second = [*record(source(*stops(*poses[4:])), out, arm="ur10", plan=plan, rule=RULE)]
    assert second[0].text.endswith("after 4 readings before")
    assert second[-2].text == "the plan is done"
    rested = [*record(source(*stops(poses[5] + 1.0)), out, arm="ur10", plan=plan, rule=RULE)]
    assert rested[-2].text == "still, and not taken: the plan is done; take further readings by key"
    assert ta.read_session(out).seat.tolist() == ["S1"] * 3 + ["S2"] * 3


def test_an_undone_pose_comes_next_again_and_a_skipped_one_does_not(tmp_path, planned):
    plan, poses = planned
    arm = ta.load_arm("ur10")
    recording = Recording(source(), tmp_path / "out.csv", arm=arm, plan=plan, rule=RULE)
    *_, taken, _, _ = fed(recording, stops(*poses[:2]))
    assert recording.next_pose == 3
    undone, learned, following = recording.on_command("undo")
    assert kinds([undone, learned, following]) == ["undone", "learned", "next"]
    assert {name: undone.values[name] for name, value in taken.values.items() if value != ""}.items() <= (
        taken.values.items()  # numbers as numbers
    )
    assert recording.next_pose == 2
    assert kinds(recording.on_command("skip")) == ["next"]
    assert recording.next_pose == 3
    assert recording.to_go() == pytest.approx([0, 0, 0, 0, 0, 20])
    far = fed(recording, stops(poses[5], start_s=2.0))
    assert [event.text for event in far] == [
        "still, and not taken: J1 is 60 deg from pose 3; take it by key, or skip the pose"
    ]
    recording.close()


@pytest.mark.parametrize(("named", "on"), [("S9", "key"), ("", "key"), ("", "still")])
def test_a_reading_at_another_pose_than_the_plans_has_no_seat_until_it_is_named(tmp_path, planned, named, on):
    plan, poses = planned
    recording = Recording(source(), tmp_path / "out.csv", arm="ur10", plan=plan, rule=RULE, on=on)
    [*recording.on_command("take")]
    fed(recording, stops(poses[0]))
    for number, elsewhere in enumerate([poses[4], poses[1] + [0, 0.2, 0, 0, 0, 0]]):  # its joints; its tip alone
        assert kinds(recording.on_command("take"))[1:] == []
        taken, *_ = fed(recording, stops(elsewhere, start_s=number + 1.0))
        assert "kept without a seat" in taken.text
        assert recording.rows[-1]["seat"] == recording.rows[-1]["note_pose"] == ""
        assert recording.next_pose == 2
        if named:
            assert recording.on_command(f"seat {named}").__next__().text == f"reading {number + 2} is in seat {named}"
            assert recording.rows[-1]["seat"] == named
    assert recording.seat == "", "the next readings have the seats of the plan"
    [*recording.on_command("take")]
    assert "pose 2 of 6, seat S1" in fed(recording, stops(poses[1], start_s=3.0))[0].text
    recording.close()
    seats = ta.read_session(tmp_path / "out.csv").seat
    assert seats.tolist() == ["S1", named, named, "S1"]


def test_of_an_arm_whose_zeros_are_far_off_each_seat_is_asked_for_once(tmp_path):
    arm = ta.load_arm("ur10")
    recording = Recording(source(), tmp_path / "out.csv", arm=arm, seat="A", on="key", rule=RULE)
    texts = []
    for number, shift in enumerate([0.0, 0.3, 0.2, -0.1]):  # of the tip, by some 200 mm
        [*recording.on_command("take")]
        texts += [fed(recording, stops(arm.working + [shift, 0, 0, 0, 0, 0], start_s=number))[-1].text]
        if number == 1:
            [*recording.on_command("seat A")]
    recording.close()
    assert ["kept" in text for text in texts] == [False, True, False, False], texts
    assert ta.read_session(tmp_path / "out.csv").seat.tolist() == ["A"] * 4


def test_a_seat_that_a_person_names_counts_wherever_the_plan_is(tmp_path, planned):
    plan, poses = planned
    recording = Recording(source(), tmp_path / "out.csv", arm="ur10", plan=plan, rule=RULE, on="key", seat="mine")
    [*recording.on_command("take")]
    taken = next(event for event in fed(recording, stops(poses[4])) if event.kind == "reading")
    assert "kept without the names of the plan: J1 is 60 deg from pose 1" in taken.text
    assert (recording.rows[-1]["seat"], recording.rows[-1]["note_pose"]) == ("mine", "")
    recording.close()


def test_where_no_pose_is_next_none_is_skipped(tmp_path):
    recording = Recording(source(), tmp_path / "out.csv", rule=RULE)
    assert [event.text for event in recording.on_command("skip")] == [
        "there is no next pose to skip: start with --plan PLAN, or --rank"
    ]


def test_without_seat_and_reference_it_is_said_what_fit_needs(tmp_path):
    ready, *_ = record(source(*stops([0.0, 1.0])), tmp_path / "a.csv", rule=RULE)
    assert "fit needs the seat's name (--seat NAME" in ready.text
    ready, *_ = record(source(*stops([0.0, 1.0])), tmp_path / "b.csv", rule=RULE, seat="A")
    assert "fit needs" not in ready.text


def test_a_reading_has_the_direction_of_each_joints_last_movement(tmp_path):
    poses = [0.0, 1.0, 5.0], [0.5, 1.0, 4.0], [0.4, 1.0, 4.0]
    [*record(source(*stops(*poses)), tmp_path / "out.csv", rule=RULE)]
    assert ta.read_session(tmp_path / "out.csv").directions.tolist() == [[0, 0, 0], [1, 0, -1], [-1, 0, -1]]


def test_an_arm_that_rests_beside_its_seat_is_no_reading(tmp_path):
    arm = ta.load_arm("ur10")
    recording = Recording(source(), tmp_path / "out.csv", arm=arm, seat="A", rule=RULE)
    at = arm.working
    assert kinds(fed(recording, stops(at))) == ["ready", "reading"]
    (said,) = fed(recording, stops(at + 0.3, start_s=0.5))
    assert "mm from the readings in seat A; take it by key, or name another seat" in said.text
    wrist = np.array([0, 0, 0, 0, 0, 0.3])
    assert kinds(fed(recording, stops(at + wrist, start_s=1.0))) == ["reading", "learned"]
    assert kinds(recording.on_command("seat B")) == ["notice"]
    assert kinds(fed(recording, stops(at + 0.3, start_s=1.5))) == ["reading"]
    recording.close()


def test_a_reading_on_key_waits_for_the_standstill(tmp_path):
    recording = Recording(source(), tmp_path / "out.csv", on="key", rule=RULE, seat="A")
    assert kinds(fed(recording, stops([0.0]))) == ["ready"]
    assert kinds(recording.on_command("take")) == []
    assert kinds(fed(recording, stops([0.0], start_s=0.5))) == ["reading"]
    moving = [Sample(1 + k / 20, np.array([0.1 * k])) for k in range(10)]
    assert kinds(recording.on_command("seat B")) == ["notice"]
    fed(recording, moving)
    assert kinds(recording.on_command("take")) == ["notice"]
    assert kinds(fed(recording, stops([0.9], start_s=1.5))) == ["reading"]
    (moving,) = recording.on_command("take moving")
    assert moving.kind == "reading"
    json.dumps(moving.to_dict(), allow_nan=False)
    recording.close()
    session = ta.read_session(tmp_path / "out.csv")
    assert session.seat.tolist() == ["A", "B", "B"]
    assert (tmp_path / "out.csv").read_text().splitlines()[-1].split(",")[2] == "1"


def test_the_button_of_the_arm_takes_one_reading(tmp_path):
    recording = Recording(source(), tmp_path / "out.csv", on="key", rule=RULE)
    assert kinds(fed(recording, stops([0.0], [0.5], button=True))) == ["ready", "reading", "reading"]
    recording.close()


def test_a_typed_point_belongs_to_one_reading(tmp_path):
    recording = Recording(source(), tmp_path / "out.csv", reference="typed", rule=RULE)
    assert kinds(fed(recording, stops([0.0]))) == ["ready", "notice"]
    assert kinds(recording.on_command("point 1 2")) == ["refused"]
    assert kinds(recording.on_command("point 1 2 nan")) == ["refused"]
    assert kinds(recording.on_command("point 1, 2.5, -3")) == ["notice"]
    assert kinds(fed(recording, stops([0.0], start_s=0.5))) == ["reading"]
    assert kinds(fed(recording, stops([0.5], start_s=1.0))) == ["notice"]
    fed(recording, [Sample(1.5, np.array([0.6]))])
    assert next(recording.on_command("point 1 2 3")).text.startswith("type the point while the arm")
    recording.close()
    assert ta.read_session(tmp_path / "out.csv").points.tolist() == [[1, 2.5, -3]]


@pytest.mark.parametrize("device_hz", [20, 24, 37, 50, 125, 500])
def test_the_angles_come_as_often_as_asked_for_whatever_the_rate_of_the_device(tmp_path, device_hz):
    samples = (Sample(k / device_hz, np.zeros(2)) for k in range(10 * device_hz))
    events = [*record(source(*samples), tmp_path / "out.csv", on="key", samples_hz=20)]
    assert kinds(events).count("sample") == pytest.approx(200, abs=1)


def test_angles_are_events_as_often_as_asked(tmp_path):
    events = [*record(source(*stops([0.0], [0.5])), tmp_path / "out.csv", rule=RULE, samples_hz=5)]
    samples = [event.to_dict() for event in events if event.kind == "sample"]
    assert [one["time_s"] for one in samples] == pytest.approx([0, 0.2, 0.4, 0.6, 0.8], abs=0.06)
    assert [one["is_still"] for one in samples] == [False, True, True, False, True]
    assert samples[-1]["q1_deg"] == pytest.approx(np.degrees(0.5))


def test_a_second_instrument_is_paired_by_time(tmp_path):
    tracker = Source("tracker", lambda: iter(()), has_points=True)
    recording = Recording(source(), tmp_path / "out.csv", reference=tracker, rule=RULE)

    def seen(start_s, point, end_s):
        for k in range(int((end_s - start_s) * 50)):
            recording.on_reference(Sample(start_s + k / 50, np.empty(0), np.asarray(point, dtype=float)))

    seen(-1.0, [9, 9, 9], -0.01)  # before the standstill
    assert kinds(fed(recording, stops([0.0]))) == ["ready"]
    seen(0.5, [1, 2, 3], 1.0)
    assert kinds(fed(recording, stops([0.0], start_s=0.5))) == ["reading"]
    seen(1.0, [1, 2, 3], 1.2)
    seen(1.2, [1, 2, 5], 2.5)  # the reflector moves while the arm stands
    events = fed(recording, [*stops([0.5], start_s=1.0), *stops([0.5], start_s=1.5), *stops([0.5], start_s=2.0)])
    assert kinds(events) == ["reading"]
    recording.close()
    points = ta.read_session(tmp_path / "out.csv").points
    assert points.tolist() == [[1, 2, 3], [1, 2, 5]]


def test_a_second_instrument_that_is_silent_is_said(tmp_path):
    tracker = Source("tracker", lambda: iter(()), has_points=True)
    recording = Recording(source(), tmp_path / "out.csv", reference=tracker, rule=RULE)
    events = fed(recording, [sample for k in range(6) for sample in stops([0.0], start_s=0.5 * k)])
    assert [event.text for event in events[1:]] == ["tracker gives no point while the arm stands still"]
    assert kinds(recording.on_command("take moving")) == ["refused"]
    recording.close()


@pytest.mark.parametrize(
    ("own", "text"),
    [
        ((True, False), "paired by arrival"),
        ((False, True), "paired by arrival"),
        ((True, True), ""),
        ((False, False), ""),
    ],
)
def test_of_two_clocks_arrival_pairs(tmp_path, own, text):
    arm_s, tracker_s = (1e6, 0.0) if own[0] != own[1] else (0.0, 0.0)
    over = threading.Event()

    def paced(start_s, **values):
        begun_s = time.monotonic()
        while not over.is_set():
            yield Sample(start_s + time.monotonic() - begun_s, values.get("joints", np.empty(0)), values.get("point"))
            time.sleep(0.005)

    arm = Source("arm", lambda: paced(arm_s, joints=np.zeros(2)), has_own_clock=own[0])
    seen = Source("seen", lambda: paced(tracker_s, point=np.ones(3)), has_points=True, has_own_clock=own[1])
    said = []
    for event in record(arm, tmp_path / "out.csv", reference=seen, rule=RULE):
        said.append(event)
        if event.kind == "reading":
            over.set()
    assert any(text in event.text for event in said if event.kind == "notice") == bool(text)
    assert ta.read_session(tmp_path / "out.csv").points.tolist() == [[1, 1, 1]]


def test_clocks_that_never_meet_are_said(tmp_path):
    tracker = Source("tracker", lambda: iter(()), has_points=True)
    recording = Recording(source(), tmp_path / "out.csv", reference=tracker, rule=RULE)
    recording.on_reference(Sample(5e4, np.empty(0), np.zeros(3)))
    events = fed(recording, [sample for k in range(6) for sample in stops([0.0], start_s=0.5 * k)])
    (said,) = (event.text for event in events if event.kind == "notice")
    assert said.endswith("its last one is of another time: it sees no target, or its clock is another")
    recording.close()


def test_a_clock_that_jumps_is_said_once_and_nothing_is_averaged_over_it(tmp_path):
    recording = Recording(source(has_own_clock=True), tmp_path / "out.csv", rule=RULE)
    back = fed(recording, [*stops([0.0], start_s=100.0), *stops([0.0], start_s=0.0)])
    assert [event.text for event in back if event.kind == "notice"] == [
        "the clock of test jumps by -100 s; the standstill begins again"
    ]
    assert kinds(fed(recording, stops([0.0], start_s=-5.0))) == []  # said a moment ago
    recording.close()
    ahead = Recording(source(has_own_clock=True), tmp_path / "ahead.csv", rule=RULE)
    said = fed(ahead, [*stops([0.0]), *stops([9.0], start_s=500.0)])
    assert [event.text for event in said if event.kind == "notice"] == [
        "the clock of test jumps by +500 s; the standstill begins again"
    ]
    assert kinds(said).count("reading") == 2
    ahead.close()


def test_a_clock_that_stands_still_is_said_and_its_samples_are_no_reading(tmp_path, monkeypatch):
    monkeypatch.setattr("truearm.wings.bench.recording.recording.CLOCK_STANDS_S", 0.0)
    frozen = [Sample(7.0, np.zeros(2))] * 42
    recording = Recording(source(has_own_clock=True), tmp_path / "out.csv", rule=RULE, seat="A")
    assert [event.text for event in fed(recording, frozen) if event.kind != "ready"] == [
        "the clock of test stands still: start the device, or its sending, again"
    ]
    recording.close()
    resting = Recording(source(has_own_clock=True), tmp_path / "resting.csv", rule=RULE, seat="A")
    assert kinds(fed(resting, stops([0.0, 0.0], [0.0, 0.0]))) == ["ready", "reading"]
    resting.close()


@pytest.mark.parametrize("column", ["q2_deg", "x_mm", "temperature_degC", "direction_1"])
@pytest.mark.parametrize("cell", ["", "nan", "1e999", "ten"])
def test_a_number_that_a_person_broke_is_named(tmp_path, column, cell):
    samples = [Sample(k / 20, np.zeros(2), np.ones(3), temperature_degC=20.0) for k in range(10)]
    out = tmp_path / "out.csv"
    [*record(source(*samples, has_points=True), out, rule=RULE, seat="A")]
    head, row = (line.split(",") for line in out.read_text().splitlines())
    row[head.index(column)] = cell
    out.write_text(f"{','.join(head)}\n{','.join(row)}\n")
    again = record(source(*samples, has_points=True), out, rule=RULE, seat="A")
    if column == "temperature_degC" and cell == "":  # it is not stated
        *_, end = again
        assert end.values["readings"] == 2
    else:
        refuses(rf"out\.csv, line 2, column '{column}': expected a number, got", next, again)


def test_sliding_joints_are_in_mm(tmp_path):
    [*record(source(*stops([0.5, 120.0]), prismatic=(2,)), tmp_path / "out.csv", rule=RULE)]
    session = ta.read_session(tmp_path / "out.csv")
    assert session.angle_columns == ("q1_deg", "q2_mm")
    assert session.angles.tolist() == [[pytest.approx(0.5), 120.0]]


def test_what_does_not_fit_is_refused(tmp_path, planned):
    with pytest.raises(InputError, match="gives 2 joints, arm 'ur10' has 6"):
        [*record(source(*stops([0, 0])), tmp_path / "a.csv", arm="ur10")]
    refuses("a plan needs the arm", record, source(), tmp_path / "a.csv", plan=planned[0])
    refuses("measures no points", record, source(), tmp_path / "a.csv", reference=source())
    with pytest.raises(InputError, match="gives no joint angles"):
        [*record(source(Sample(0.0, np.empty(0))), tmp_path / "a.csv")]
    refuses("expected a source", record, "teapot:1", tmp_path / "a.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_source_that_fails_ends_the_recording_with_its_error(tmp_path):
    def samples():
        yield Notice("connected")
        raise InputError("the device is of another kind")

    with pytest.raises(InputError, match="another kind"):
        [*record(Source("test", samples), tmp_path / "a.csv")]


def test_commands_come_in_while_samples_do(tmp_path):
    def commands():
        yield "nonsense"
        yield "end"

    def samples():
        k = 0
        while True:
            yield Sample(k / 20, np.zeros(1))
            k += 1

    events = [*record(Source("test", samples), tmp_path / "a.csv", commands=commands())]
    assert kinds(events)[-1] == "end"
    assert "refused" in kinds(events)


def test_the_corrected_tip_is_that_of_predict(tmp_path):
    session = ta.simulate("ur10", poses=40, seed=1).session
    model = ta.fit("ur10", session, model="kinematic").model
    samples = stops(*session.angles[:3])
    events = [*record(source(*samples), tmp_path / "out.csv", model=model, rule=RULE, samples_hz=5)]
    shown = [event.to_dict() for event in events if event.kind == "sample"]
    angles = np.radians([[one[f"q{joint}_deg"] for joint in range(1, 7)] for one in shown])
    points, covariances = model.predict(angles, return_cov=True)
    assert [one["corrected_mm"] for one in shown] == [pytest.approx(point, abs=1e-9) for point in points]
    u_mm = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert [one["U_mm"] for one in shown] == [pytest.approx(2 * u, rel=1e-9) for u in u_mm]
    assert all(one["is_trained"] for one in shown)
    assert "U (k = 2) 0." in shown[0]["text"]


def test_a_view_may_ask_for_the_corrected_tip_while_the_file_is_opened(tmp_path):
    session = ta.simulate("ur10", poses=40, seed=1).session
    model = ta.fit("ur10", session, model="nominal").model
    with pytest.raises(InputError, match="the arm 'ur5' has other kinematics than the arm of the model, 'ur10'"):
        Recording(source(), tmp_path / "out.csv", arm="ur5", model=model)
    recording = Recording(source(), tmp_path / "out.csv", arm="ur10", model=model, rule=RULE)
    assert recording.corrected() is None
    events = recording.on_sample(Sample(0.0, session.angles[0]))
    assert next(events).kind == "ready"
    assert recording.corrected() is not None
    recording.close()


def test_where_the_model_cannot_correct_it_says_why(tmp_path):
    session = ta.simulate("ur10", poses=40, seed=1).session
    model = ta.fit("ur10", session, model="nominal").model
    events = [*record(source(*stops([9.0] * 6)), tmp_path / "out.csv", model=model, rule=RULE, samples_hz=5)]
    shown = next(event.to_dict() for event in events if event.kind == "sample")
    assert "corrected_mm" not in shown
    assert "limit" in shown["text"]


def test_a_sample_of_another_number_of_joints_is_said_and_ignored(tmp_path):
    recording = Recording(source(), tmp_path / "out.csv", arm=ta.load_arm("ur10"), samples_hz=20, rule=RULE)
    events = fed(recording, [*stops(np.zeros(6)), *stops(np.zeros(5), start_s=0.5), *stops(np.ones(6), start_s=1.0)])
    assert [event.text for event in events if event.kind == "notice"] == ["test gives 5 joints in place of 6; ignored"]
    assert recording.n_readings == 2
    recording.close()


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"columns": {"payload_kg": -5.0}}, "payload of 0 to"),
        ({"temperature_degC": 900.0}, "temperature of -50 to 100 degC, got 900 degC"),
    ],
)
def test_what_no_fit_would_take_is_no_reading(tmp_path, stated, said):
    recording = Recording(source(), tmp_path / "s.csv", rule=RULE)
    samples = [replace(one, **stated) for one in stops([10.0, 20.0], [30.0, 40.0])]
    events = fed(recording, samples)
    refused = [event for event in events if event.kind == "refused"]
    assert len(refused) == 2
    assert said in refused[0].text
    assert recording.n_readings == 0


def test_fahrenheit_is_said_when_it_is_recorded(tmp_path):
    recording = Recording(source(), tmp_path / "s.csv", rule=RULE)
    events = fed(recording, [replace(one, temperature_degC=68.0) for one in stops([10.0, 20.0])])
    assert any("68 degrees Fahrenheit are 20.0 degC" in event.text for event in events)
    assert recording.n_readings == 1
