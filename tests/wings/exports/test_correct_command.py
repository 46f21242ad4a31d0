"""``truearm correct``: the table, the program, the exit code; wrong input writes nothing."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import truearm as ta
from refusals import refuses
from truearm.wings.exports.targets.manifest import read_manifest
from truearm.wings.exports.targets.pose_models import reference_from_base

# Joints are printed to 12 digits, in degrees.
PRINTED_DEG = 1e-9


PROGRAMS = [(None, "csv"), ("urscript", "script"), ("rapid", "mod"), ("krl", "dat"), ("fanuc", "ls")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, ur10_model):
    """A model of a virtual UR10 in a program of five targets."""
    folder = tmp_path_factory.mktemp("correct")
    ur10_model.save(folder / "m.truearm")
    low, high = ur10_model.angle_ranges_.T
    joints = np.degrees((low + high) / 2 + 0.2 * (high - low) * np.random.default_rng(0).uniform(-1, 1, (5, 6)))
    frame = pd.DataFrame(joints, columns=[f"q{i}_deg" for i in range(1, 7)])
    frame.insert(0, "name", ["a", "b", "=c", "d", "e"])
    frame.to_csv(folder / "program.csv", index=False)
    beyond = frame.copy()
    beyond.loc[1, "q1_deg"] = np.degrees(high[0]) + 40
    beyond.to_csv(folder / "beyond.csv", index=False)
    beyond.loc[[1]].to_csv(folder / "only-beyond.csv", index=False)
    return folder


def table(path):
    return pd.read_csv(path, comment="#")


def run_correct(truearm, folder, name, out, *options):
    return truearm("correct", folder / "m.truearm", folder / name, "--out", out, *options)


def test_the_table_has_the_joints_of_the_input_and_says_its_direction(truearm, folder, tmp_path):
    ran = run_correct(truearm, folder, "program.csv", tmp_path / "c.csv")
    assert ran.code == 0, ran.err
    assert ran.out.startswith("5 of 5 targets corrected; largest change 0.")
    assert "direction command: send these joints" in ran.out
    found, program = table(tmp_path / "c.csv"), pd.read_csv(folder / "program.csv")
    joints = [f"q{i}_deg" for i in range(1, 7)]
    assert list(found)[:8] == ["name", *joints, "direction"]  # as in the input
    assert list(found["name"]) == ["a", "b", "'=c", "d", "e"]  # no formula
    assert set(found["direction"]) == {"command"}
    assert set(found["status"]) == {"ok"}
    expected = ta.correct(folder / "m.truearm", np.radians(program[joints].to_numpy()))
    np.testing.assert_allclose(found[joints], np.degrees(expected.joints), atol=PRINTED_DEG)
    np.testing.assert_allclose(found["u_mm"], expected.u_mm, rtol=1e-9)


def test_the_file_carries_check_poses_that_a_model_confirms(truearm, folder, tmp_path):
    for direction in ("command", "feedback"):
        out = tmp_path / f"{direction}.csv"
        assert run_correct(truearm, folder, "program.csv", out, "--direction", direction).code == 0
        manifest, model = read_manifest(out), ta.load_model(folder / "m.truearm")
        assert (manifest.direction, manifest.provenance.arm) == (direction, "ur10")
        corrected = np.array([pose.corrected_joints for pose in manifest.check_poses])
        assert corrected.shape == (5, 6)
        machine, nominal = (corrected, manifest.joints) if direction == "command" else (manifest.joints, corrected)
        np.testing.assert_allclose(model.predict(machine), manifest.tips, atol=manifest.tolerance_mm)
        np.testing.assert_allclose(model.predict_nominal(nominal), manifest.tips, atol=manifest.tolerance_mm)


TAMPERINGS = {
    "another number": lambda lines: ".1".join("\n".join(lines).rsplit(".", 1)).split("\n"),
    "a row less": lambda lines: lines[:-2] + lines[-1:],
    "the manifest alone": lambda lines: lines[:1],
    "code before the manifest": lambda lines: ["halt " + lines[0], *lines[1:]],
    "a line more": lambda lines: [*lines, "halt"],
}


def test_check_poses_in_the_base_frame_are_those_in_the_reference_frame():
    """The reference stands aside and a quarter turn about the arm: every pose is moved back by both."""
    session = ta.simulate("ur10", poses=40, seed=1).session
    points = session.points @ [[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]] + [500.0, -200, 30]
    model = ta.fit("ur10", replace(session, points=points), model="nominal").model
    tips = {
        frame: ta.correct(model, session.angles[:1], frame=frame).manifest("csv").tips
        for frame in ("reference", "base")
    }
    back = np.linalg.inv(reference_from_base(model))
    assert abs(back[0, 1]) > 0.99
    np.testing.assert_allclose(tips["base"], tips["reference"] @ back[:3, :3].T + back[:3, 3], atol=1e-9)


@pytest.mark.parametrize(("language", "suffix"), PROGRAMS)
def test_the_check_finds_targets_that_were_changed(folder, tmp_path, language, suffix):
    model = ta.load_model(folder / "m.truearm")
    out = tmp_path / f"p.{suffix}"
    j3 = "independent" if language == "fanuc" else None
    ta.correct(model, folder / "beyond.csv", uncertainty=False).save(out, language=language, fanuc_j3=j3)
    assert ta.check_export(model, out).agrees
    lines = out.read_text(encoding="utf-8").splitlines()
    out.write_bytes("\r\n".join([*lines, ""]).encode())  # as another system or an editor ends lines
    assert ta.check_export(model, out).agrees
    for what, change in TAMPERINGS.items():
        out.write_text("\n".join([*change(lines), ""]), encoding="utf-8")
        (finding,) = [one for one in ta.check_export(model, out).findings if one.what == "content"]
        assert (finding.outcome, finding.detail) == ("differs", "the file was changed after it was written"), what


def test_the_check_refuses_a_file_that_does_not_say_what_was_written(folder, tmp_path):
    model = ta.load_model(folder / "m.truearm")
    record = ta.correct(model, folder / "program.csv", uncertainty=False)
    (tmp_path / "c.csv").write_text(f"# {record.manifest('joint targets (csv)').line()}\nq1_deg\n1\n")
    (finding,) = [one for one in ta.check_export(model, tmp_path / "c.csv").findings if one.what == "content"]
    assert finding.outcome == "differs"


def test_feedback_of_what_was_sent_is_the_program(truearm, folder, tmp_path):
    assert run_correct(truearm, folder, "program.csv", tmp_path / "sent.csv").code == 0
    joints = [f"q{i}_deg" for i in range(1, 7)]
    table(tmp_path / "sent.csv")[joints].to_csv(tmp_path / "read.csv", index=False)
    truearm(
        "correct", folder / "m.truearm", tmp_path / "read.csv", "--out", tmp_path / "f.csv", "--direction", "feedback"
    ).done()
    program = pd.read_csv(folder / "program.csv")[joints]
    np.testing.assert_allclose(table(tmp_path / "f.csv")[joints], program, atol=1e-7)  # 1e-9 rad and print


def test_refused_targets_are_empty_with_a_reason_and_an_exit_code(truearm, folder, tmp_path):
    ran = run_correct(truearm, folder, "beyond.csv", tmp_path / "c.csv")
    assert ran.code == 1
    assert "refused: b: outside the trained range (J1)" in ran.out
    found = table(tmp_path / "c.csv")
    assert found.loc[1, "status"] == "outside the trained range (J1)"
    assert found.loc[1, [f"q{i}_deg" for i in range(1, 7)]].isna().all()
    assert found.loc[1, "inside_training"] == 0
    accepted = run_correct(truearm, folder, "beyond.csv", tmp_path / "c.csv", "--untrained", "accept")
    assert accepted.code == 0
    assert "1 corrected targets are outside the trained range" in accepted.out


def test_where_none_is_corrected_nothing_is_written(truearm, folder, tmp_path):
    none = run_correct(truearm, folder, "only-beyond.csv", tmp_path / "c.csv")
    assert none.code == 3
    assert none.out.startswith("None of 1 targets corrected: there is nothing to write.")
    assert "send these joints" not in none.out
    assert "written to" not in none.out
    assert not list(tmp_path.iterdir())
    as_json = run_correct(truearm, folder, "only-beyond.csv", tmp_path / "c.csv", "--json")
    assert as_json.code == 3
    assert "file" not in json.loads(as_json.out)
    refuses("nothing to write", ta.correct(folder / "m.truearm", folder / "only-beyond.csv").save, tmp_path / "c.csv")
    assert not list(tmp_path.iterdir())


def test_other_columns_keep_their_place_and_content(truearm, folder, tmp_path):
    program = pd.read_csv(folder / "program.csv")
    program = program[["q2_deg", "name", "q1_deg", "q3_deg", "q4_deg", "q5_deg", "q6_deg"]]
    program.insert(2, "note on site", ["left", "=1+1", "a, b", "", "x"])
    program["temperature_degC"] = [20.0, 20.5, 21.0, 21.0, 20.0]
    program.to_csv(tmp_path / "p.csv", index=False)
    ran = run_correct(truearm, folder, tmp_path / "p.csv", tmp_path / "c.csv")
    assert ran.code == 0, ran.err
    found = pd.read_csv(tmp_path / "c.csv", comment="#", keep_default_na=False)
    assert list(found)[: program.shape[1] + 2] == [*program, "direction", "status"]
    assert list(found["note on site"]) == ["left", "'=1+1", "a, b", "", "x"]
    assert list(found["temperature_degC"]) == list(program["temperature_degC"])
    plain = ta.correct(folder / "m.truearm", program[sorted(program)].drop(columns=["note on site"]))
    np.testing.assert_allclose(np.radians(found[[f"q{i}_deg" for i in range(1, 7)]]), plain.joints, atol=1e-11)
    frame = ta.correct(folder / "m.truearm", program.assign(notes=[1, None, 2.5, "a\nb", "c"])).to_frame()
    assert list(frame)[: program.shape[1] + 1] == [*program, "notes"]
    assert list(frame["notes"]) == ["1", "", "2.5", "a b", "c"]


def test_poses_pass_through_beside_their_joints(folder):
    model = ta.load_model(folder / "m.truearm")
    start = np.radians(pd.read_csv(folder / "program.csv").iloc[0, 1:].to_numpy(dtype=float))
    tip = model.nominal_.chain.pose(start[None]).tip_in_base[0]
    table = pd.DataFrame([["p", *tip / 1000]], columns=["name", "x_m", "y_m", "z_m"])
    frame = ta.correct(model, table, start=start).to_frame()
    assert list(frame)[:11] == [*(f"q{i}_deg" for i in range(1, 7)), "name", "x_m", "y_m", "z_m", "direction"]
    np.testing.assert_array_equal(frame.loc[0, ["x_m", "y_m", "z_m"]].to_numpy(dtype=float), tip / 1000)


def test_json_has_the_summary_and_the_refusals(truearm, folder, tmp_path):
    ran = run_correct(truearm, folder, "beyond.csv", tmp_path / "c.csv", "--json", "--no-uncertainty")
    result = json.loads(ran.out)
    assert ran.code == 1
    assert (result["n_targets"], result["n_corrected"], result["direction"]) == (5, 4, "command")
    assert result["refused"] == [{"target": 2, "name": "b", "reason": "outside the trained range (J1)"}]
    assert result["median_u_mm"] is None
    assert result["file"] == str(tmp_path / "c.csv")


@pytest.mark.parametrize(("language", "suffix"), PROGRAMS[1:])
def test_a_program_has_check_poses_and_its_direction(truearm, folder, tmp_path, language, suffix):
    out = tmp_path / f"p.{suffix}"
    j3 = ["--fanuc-j3", "coupled"] if language == "fanuc" else []
    ran = run_correct(truearm, folder, "beyond.csv", out, "--as", language, *j3)
    assert ran.code == 1, ran.err
    text = out.read_text(encoding="utf-8")
    assert read_manifest(out).format == language
    assert "direction command: send these joints" in text
    assert "2 b: REFUSED, outside the trained range (J1)" in text


def test_poses_with_one_start_and_a_tool(truearm, folder, tmp_path):
    model = ta.load_model(folder / "m.truearm")
    start = np.radians(pd.read_csv(folder / "program.csv").iloc[0, 1:].to_numpy(dtype=float))
    pose = model.nominal_.chain.pose(start[None])
    columns = dict(zip(["x_mm", "y_mm", "z_mm"], pose.tip_in_base.T + [[5.0], [0.0], [0.0]], strict=True))
    pd.DataFrame(columns).to_csv(tmp_path / "poses.csv", index=False)
    ran = truearm(
        "correct",
        folder / "m.truearm",
        tmp_path / "poses.csv",
        "--out",
        tmp_path / "c.csv",
        "--start",
        ",".join(map(str, np.degrees(start))),
        "--tool",
        "0,0,1,0,0,30",
    ).done()
    assert "Positions without orientations" in ran.out
    assert "# tool in the flange: 0, 0, 1 mm, roll pitch yaw 0, 0, 30 deg" in (tmp_path / "c.csv").read_text()
    sent = np.radians(table(tmp_path / "c.csv")[[f"q{i}_deg" for i in range(1, 7)]].to_numpy())
    assert np.abs(sent - start).max() < 0.1


BAD = [
    (["program.csv", "c.txt"], "ends in .csv"),
    (["program.csv", "c.script"], "--as urscript"),
    (["program.csv", "c.csv", "--as", "rapid"], "ends in .mod"),
    (["program.csv", "c.csv", "--tool", "1,2"], "expected a tool"),
    (["program.csv", "c.csv", "--tool", "1,2,x"], "--tool expects numbers"),
    (["program.csv", "c.csv", "--start", "0,0,0,0,0,0"], "start joints are given twice"),
    (["missing.csv", "c.csv"], "does not exist"),
    (["missing.mod", "c.mod"], "missing.mod: the file does not exist"),
    (["m.truearm", "c.csv"], "got a model file"),
    (["program.csv", "no/such/c.csv"], "does not exist"),
]


@pytest.mark.parametrize(("arguments", "message"), BAD)
def test_wrong_input_gets_one_line_and_writes_nothing(truearm, folder, tmp_path, snapshot, arguments, message):
    before = snapshot(tmp_path)
    name, out, *options = arguments
    ran = run_correct(truearm, folder, name, tmp_path / out, *options)
    assert ran.code == 2
    assert message in ran.err
    assert ran.err.count("\n") == 1
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad\n" + "90,80,70,60,50,40\n" * 2, "outside its limits"),
        ("q1_deg,q2_deg\n1,2\n", "expected 6 joints"),
        ("q1_mm,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n1,2,3,4,5,6\n", "expected deg or rad, got mm"),
        ("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n1,2,3,4,5,NaN\n", "line 2, column 'q6_deg': expected a finite"),
    ],
)
def test_a_table_of_another_arm_or_unit_is_refused(refused, folder, tmp_path, text, message):
    (tmp_path / "targets.csv").write_text(text)
    refused(["correct", folder / "m.truearm", tmp_path / "targets.csv", "--out", tmp_path / "c.csv"], message)


def test_a_corrected_file_is_not_corrected_again(truearm, refused, folder, tmp_path):
    assert run_correct(truearm, folder, "program.csv", tmp_path / "once.csv").code == 0
    refused(
        ["correct", folder / "m.truearm", tmp_path / "once.csv", "--out", tmp_path / "twice.csv"], "corrected already"
    )
    once = table(tmp_path / "once.csv")
    refuses("corrected already", ta.correct, folder / "m.truearm", once)
    assert not (tmp_path / "twice.csv").exists()


def test_the_record_for_notebooks_and_machines(folder):
    record = ta.correct(folder / "m.truearm", pd.read_csv(folder / "beyond.csv"))
    assert str(record).splitlines()[0] == record.summary() == record.to_dict()["summary"]
    assert repr(record).startswith("<CorrectedTargets: 4 of 5 targets corrected")
    json.dumps(record.to_dict(), allow_nan=False)
    assert list(record.refused) == [False, True, False, False, False]


def test_a_fanuc_program_says_how_it_counts_j3_and_is_not_written_without(truearm, folder, tmp_path):
    """Coupled: the forearm of the UR10, whose axes of J2 and J3 point the same way, turns by J2 + J3."""
    ran = run_correct(truearm, folder, "program.csv", tmp_path / "c.ls", "--as", "fanuc")
    assert (ran.code, "state which one to write, coupled or independent" in ran.err) == (2, True)
    assert not (tmp_path / "c.ls").exists()
    ran = run_correct(truearm, folder, "program.csv", tmp_path / "c.csv", "--fanuc-j3", "coupled")
    assert (ran.code, "applies to targets for it only" in ran.err) == (2, True)
    found = {}
    for j3 in ("coupled", "independent"):
        out = tmp_path / f"{j3}.ls"
        ran = run_correct(truearm, folder, "program.csv", out, "--as", "fanuc", "--fanuc-j3", j3)
        assert ran.code == 0
        said = ran.out.splitlines()[-1]
        assert said.startswith("J3 is counted from the ")
        assert said in out.read_text()
        found[j3] = np.array(re.findall(r"J\d= (\S+) deg", out.read_text()), dtype=float).reshape(-1, 6)
    expected = found["independent"].copy()
    expected[:, 2] += expected[:, 1]
    np.testing.assert_allclose(found["coupled"], expected, atol=2e-6)  # deg, printed to 1e-6
