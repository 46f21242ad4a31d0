"""`truearm plan`: from an arm or a model to a session to fill in, its page, and what it says."""

import csv
import json

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.models.model_file import load_model
from truearm.readings import Lengths, Session, write_lengths, write_session
from truearm.wings.planning.designs import proposal
from truearm.wings.planning.virtual import VirtualArm, load_preset

pytestmark = pytest.mark.usefixtures("undrawn", "quick_plans")

QUICK = ("--terms", "constants")


def aims(path):
    """Angles aimed at [rad] and seats of a template."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    joints = [name for name in rows[0] if name.startswith("note_q")]
    angles = np.radians([[float(row[name]) for name in joints] for row in rows])
    return angles, np.array([row["seat"] for row in rows]) if "seat" in rows[0] else None


def test_the_first_line_of_a_plan_is_its_uncertainty(truearm, tmp_path):
    out = tmp_path / "plan.csv"
    ran = truearm("plan", "gao2017", "--artefact", "tracker", "--poses", 12, *QUICK, "--out", out).done()
    lines = ran.out.splitlines()
    assert lines[0].startswith("Uncertainty of a point in the volume after 12 poses with a tracker: ")
    assert lines[0].endswith("mm (root mean square; noise of a coordinate 0.02 mm)")
    assert lines[1].startswith("From pose to pose the joint that turns most turns by ")
    assert [line[0] for line in lines[2:-6]] == ["-"] * len(lines[2:-6])
    assert any(line.startswith("- Not identifiable from this plan: ") for line in lines[2:-6])
    assert [line.split()[0] for line in lines[-6:-1]] == ["strategy", "i-optimal", "d-optimal", "technician", "random"]
    assert [line.endswith("  chosen") for line in lines[-5:-1]] == [True, False, False, False]
    assert lines[-1] == f"session written to {out}"
    angles, seat = aims(out)
    assert angles.shape == (12, 6)
    assert seat is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.csv"]


def test_json_has_the_files_and_all_strategies(truearm, tmp_path):
    out = tmp_path / "plan.csv"
    arguments = ["plan", "gao2017", "--artefact", "bar", "--bar", 250, "--poses", 9, "--seats", 2, *QUICK]
    ran = truearm(*arguments, "--strategy", "random", "--page", tmp_path / "plan.html", "--out", out, "--json").done()
    found = json.loads(ran.out)
    assert found["file"] == str(out)
    assert found["lengths_file"] == str(tmp_path / "plan-lengths.csv")
    assert found["page_file"] == str(tmp_path / "plan.html")
    assert (found["arm"], found["artefact"], found["strategy"], found["n"]) == ("gao2017", "bar", "random", 9)
    assert found["places"] == 2
    assert list(found["strategies"]) == ["i-optimal", "d-optimal", "technician", "random"]
    drawn = found["strategies"]["random"]
    assert found["after_mm"] == drawn["after_mm"] == drawn["course"]["rms_mm"][-1]
    assert found["before_mm"] == drawn["course"]["rms_mm"][0]
    assert drawn["course"]["n"][-1] == 9
    assert set(drawn) == {
        "after_mm",
        "mean_joint_move_deg",
        "course",
        "o1",
        "o2",
        "o3",
        "o4",
        "o5",
        "rank",
        "n_parameters",
    }
    assert found["limitations"]
    assert (tmp_path / "plan.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan-lengths.csv", "plan.csv", "plan.html"]


def test_a_filled_plan_improves_on_the_nominal_arm_without_a_reference_instrument(truearm, tmp_path):
    """The whole way, with a virtual arm in the place of a real one."""
    plan, session, lengths, model = (tmp_path / name for name in ("p.csv", "s.csv", "p-lengths.csv", "m.truearm"))
    ran = truearm("plan", "gao2017", "--artefact", "bar", "--bar", 300, "--poses", 40, *QUICK, "--out", plan).done()
    angles, seat = aims(plan)
    arm = load_arm("gao2017")
    virtual = VirtualArm.draw(arm, load_preset("research"), seed=3)
    # The aims are rounded: the bar is where the first pose in a seat has the tip, its ends 300 mm apart.
    points = np.empty((len(angles), 3))
    for name in dict.fromkeys(seat.tolist()):
        points[seat == name] = arm.chain.tip_in_base(angles[seat == name][:1])
    measured = virtual.measure(angles, seed=4, seat=seat, seat_points=points, reference=False).readings
    write_session(measured, session)
    ends = sorted({name[:-1] for name in seat.tolist()})
    true = [np.linalg.norm(points[seat == f"{place}a"][0] - points[seat == f"{place}b"][0]) for place in ends]
    a, b = np.array([[f"{place}a", f"{place}b"] for place in ends]).T
    assert true == pytest.approx(np.full(len(ends), 300.0), abs=5)
    write_lengths(Lengths(a, b, np.array(true), np.full(len(ends), 0.005)), lengths)
    ran = truearm("fit", session, "--arm", "gao2017", "--model", "kinematic", "--lengths", lengths, "--out", model)
    assert ran.code == 0, ran.err
    # More for this model: seats of other names, so that both sessions may go into one.
    ran = truearm("plan", model, "--artefact", "bar", "--bar", 300, "--poses", 4, "--out", tmp_path / "more.csv").done()
    assert not set(aims(tmp_path / "more.csv")[1].tolist()) & set(seat.tolist())
    there = proposal.volume_poses(arm, 60, seed=9)
    # Lengths between points of the volume: no seat tells where the base is.
    true, found, nominal = (
        np.linalg.norm(tips[:, None] - tips, axis=2)
        for tips in (virtual.true_tip(there), load_model(model).predict(there), arm.chain.tip_in_base(there))
    )
    # The rest is what a kinematic model has no terms for. Plans that differ in the last bit of one pose leave 0.32 and
    # 0.53 of the nominal error of this arm.
    assert np.abs(found - true).mean() < 0.7 * np.abs(nominal - true).mean()


def test_the_next_poses_after_those_of_a_model(truearm, made, tmp_path):
    model = made / "kinematic.truearm"
    arguments = ["--artefact", "tracker", "--poses", 5, "--json"]
    ran = truearm("plan", model, *arguments, "--out", tmp_path / "a.csv").done()
    after_model = json.loads(ran.out)
    drawn = json.loads(truearm("plan", "gao2017", *arguments, *QUICK, "--out", tmp_path / "b.csv").out)
    # 300 readings are behind it.
    assert after_model["before_mm"] < 0.02 * drawn["before_mm"]
    assert after_model["after_mm"] < after_model["before_mm"]
    assert after_model["noise_mm"] != drawn["noise_mm"] == 0.02
    louder = json.loads(truearm("plan", model, *arguments, "--noise", 0.5, "--out", tmp_path / "c.csv").out)
    assert louder["noise_mm"] == 0.5
    assert louder["after_mm"] > after_model["after_mm"]


def test_readings_measured_already_count_and_new_seats_get_new_names(truearm, tmp_path):
    arguments = ["plan", "gao2017", "--artefact", "seat", "--seats", 2, "--poses", 20, *QUICK, "--json"]
    first = json.loads(truearm(*arguments, "--out", tmp_path / "a.csv").out)
    angles, seat = aims(tmp_path / "a.csv")
    assert sorted(set(seat.tolist())) == ["S1", "S2"]
    write_session(Session(angles, seat=seat), tmp_path / "measured.csv")
    then = json.loads(truearm(*arguments, "--session", tmp_path / "measured.csv", "--out", tmp_path / "b.csv").out)
    # The aims are rounded to a tenth of a degree.
    assert then["before_mm"] == pytest.approx(first["after_mm"], rel=0.05)
    assert then["after_mm"] < first["after_mm"]
    assert sorted(set(aims(tmp_path / "b.csv")[1].tolist())) == ["S3", "S4"]


def test_a_smaller_volume_has_a_smaller_uncertainty(truearm, tmp_path):
    arguments = ["plan", "gao2017", "--artefact", "tracker", "--poses", 12, *QUICK, "--json"]
    found = [
        json.loads(truearm(*arguments, *volume, "--out", tmp_path / f"{i}.csv").out)
        for i, volume in enumerate(([], ["--volume", "500,600,-100,100,20"]))
    ]
    # Points near one another: what moves all of them alike does not matter.
    for what in ("before_mm", "after_mm"):
        assert found[1][what] < found[0][what]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nobody", "--artefact", "tracker"], "there is no arm 'nobody'"),
        (["gao2017", "--artefact", "bar"], "--bar 500"),
        (["gao2017", "--artefact", "bar", "--bar", "-3"], "positive length"),
        (["gao2017", "--artefact", "bar", "--bar", "nan"], "positive length"),
        (["gao2017", "--artefact", "seat", "--bar", "300"], "--artefact bar"),
        (["gao2017", "--artefact", "tracker", "--seats", "3"], "seat and bar"),
        (["gao2017", "--artefact", "seat", "--seats", "9", "--poses", "5"], "--poses 18"),
        (["gao2017", "--artefact", "tracker", "--noise", "0"], "positive noise"),
        (["gao2017", "--artefact", "tracker", "--volume", "1,2,3"], "NEAR,FAR,LOW,HIGH"),
        (["gao2017", "--artefact", "tracker", "--volume", "600,500,-1,1,20"], "NEAR,FAR,LOW,HIGH"),
        (["gao2017", "--artefact", "tracker", "--volume", "1,nan,-1,1,20"], "NEAR,FAR,LOW,HIGH"),
        (["gao2017", "--artefact", "tracker", "--poses", "0"], "--poses"),
        (["gao2017", "--artefact", "stick"], "stick"),
        (["gao2017", "--artefact", "tracker", "--strategy", "best"], "best"),
        (["gao2017", "--artefact", "tracker", "--page", "plan.pdf"], r".html"),
        (["gao2017", "--artefact", "tracker", "--session", "nothing.csv"], "nothing.csv"),
    ],
)
def test_an_impossible_plan_is_refused_in_one_line(truearm, snapshot, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    ran = truearm("plan", *arguments, "--out", "plan.csv")
    assert ran.code == 2
    assert ran.out == ""
    assert said in ran.err
    assert len(ran.err.splitlines()) == 1
    assert snapshot(tmp_path) == {}


def test_unsuitable_models_and_sessions_are_refused(refused, made, snapshot, tmp_path):
    out = ["--artefact", "tracker", "--poses", 4, "--out", tmp_path / "plan.csv"]
    for arguments, said in (
        ([made / "network.truearm", *out], "a network has no terms"),
        ([made / "kinematic.truearm", *QUICK, *out], "a model has its own"),
        ([made / "kinematic.truearm", "--session", made / "train.csv", *out], "identified from these readings"),
        ([made / "kinematic.truearm", "--session", made / "angles.csv", *out], "points or seats"),
        ([made / "kinematic.truearm", "--session", made / "wam.csv", *out], "expected 6 joints"),
    ):
        refused(["plan", *arguments], said)
    assert snapshot(tmp_path) == {}


def test_an_existing_file_is_not_overwritten(truearm, refused, snapshot, tmp_path):
    (tmp_path / "plan.csv").write_text("readings")
    (tmp_path / "other-lengths.csv").write_text("certificate")
    before = snapshot(tmp_path)
    bar = ["--artefact", "bar", "--bar", 250, "--poses", 8, *QUICK]
    for out in ("plan.csv", "other.csv"):
        refused(["plan", "gao2017", *bar, "--out", tmp_path / out], "the file exists already")
    page = ["--artefact", "tracker", "--session", tmp_path / "t.html", "--page", tmp_path / "t.html"]
    (tmp_path / "t.html").write_text("readings")
    assert "would be overwritten" in truearm("plan", "gao2017", *page, "--out", tmp_path / "new.csv").err
    (tmp_path / "t.html").unlink()
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("at", ["select_candidates", "volume_poses"])
def test_an_interrupted_plan_writes_nothing(truearm, snapshot, tmp_path, monkeypatch, at):
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(proposal, at, interrupted)
    page = ["--page", tmp_path / "plan.html"]
    ran = truearm("plan", "gao2017", "--artefact", "tracker", "--poses", 5, *page, "--out", tmp_path / "plan.csv")
    assert ran.code == 130
    assert ran.err == "truearm: interrupted\n"
    assert snapshot(tmp_path) == {}
