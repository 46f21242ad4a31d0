"""Joints in files of other programs: found, corrected in place and nothing else, refused where they are not clear."""

import json
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

import truearm as ta
from refusals import refuses
from truearm.wings.exports.targets.joint_files import tables
from truearm.wings.exports.targets.joint_files.joint_file import places_of

Q = np.random.default_rng(3).uniform(-0.8, 0.8, (4, 5)).round(4)
NAMES = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")


@pytest.fixture(scope="module")
def model() -> ta.KinematicModel:
    nominal = ta.load_arm("so101")
    q = np.random.default_rng(0).uniform(-1, 1, (60, 5))
    motions = np.random.default_rng(1).normal(size=(nominal.chain.n_places, 6)) * ([2e-3] * 3 + [0.3] * 3)
    return ta.KinematicModel(nominal).fit(q, nominal.chain.with_motions(motions).tip_in_base(q))


@pytest.fixture(scope="module")
def unchanged() -> ta.NominalModel:
    """A model that equals the nominal arm."""
    nominal = ta.load_arm("so101")
    q = np.random.default_rng(0).uniform(-1, 1, (60, 5))
    return ta.NominalModel(nominal).fit(q, nominal.chain.tip_in_base(q))


def degrees(values: np.ndarray) -> list[list[float]]:
    return np.degrees(values).round(5).tolist()


def trajectory() -> str:
    """A message with comments, the joints in another order, numbers in several notations, and more than positions."""
    text = "# plan 7\r\nheader: {frame_id: ''}\r\njoint_names: [J2, J1, J3, J5, J4]\r\npoints:\r\n"
    for row in Q[:, [1, 0, 2, 4, 3]].tolist():
        text += f"- positions: {row}  # here\r\n  velocities: [0.0, 0, 0, 0, 0]\r\n  time_from_start: {{sec: 1}}\r\n"
    return text


def gcode() -> str:
    lines = ["%", "G21 (all joints J1=1)"]
    for row in degrees(Q):
        lines.append("N10 G1 " + " ".join(f"J{i}={angle:+.5f}" for i, angle in enumerate(row, 1)) + " F100 ; J2=0")
    return "\r\n".join([*lines, "M30", ""])


def lettered() -> str:
    return "\n".join("G1 " + " ".join(f"{c}{v:.4f}" for c, v in zip("ABCUV", row, strict=True)) for row in degrees(Q))


def lerobot_csv() -> str:
    rows = [",".join(map(str, [0.1, *row, 33, '"a, b"'])) for row in degrees(Q)]
    return "\n".join([f"timestamp,{','.join(f'{name}.pos' for name in NAMES)},gripper.pos,remark", *rows, ""])


def list_csv() -> str:
    rows = [f'{i},"{[*row, 33]}"' for i, row in enumerate(degrees(Q))]
    return "\n".join(["frame_index,action", *rows, ""])


def ros_csv() -> str:
    rows = [";".join(map(str, [1, *row])) for row in Q[:, ::-1].tolist()]
    return "\n".join(["time;J5;J4;J3;J2;J1", *rows, ""])


FILES = {
    "t.yaml": (trajectory, None),
    "j.nc": (gcode, None),
    "a.ngc": (lettered, None),
    "l.csv": (lerobot_csv, "deg"),
    "list.csv": (list_csv, "deg"),
    "r.csv": (ros_csv, "rad"),
}


def without_numbers(text: str) -> str:
    return "".join("#" if c in "0123456789.+-eE" else c for c in text).replace("#", "")


@pytest.mark.parametrize("name", FILES)
def test_joints_are_corrected_in_place_and_nothing_else(model, tmp_path, name):
    made, unit = FILES[name]
    (tmp_path / name).write_bytes(made().encode())
    corrected = ta.correct(model, tmp_path / name, angle_unit=unit)
    np.testing.assert_allclose(corrected.targets.joints, Q, rtol=0, atol=1e-6)
    plain = ta.correct(model, Q)
    np.testing.assert_allclose(corrected.joints, plain.joints, rtol=0, atol=1e-6)
    out = tmp_path / f"out{(tmp_path / name).suffix}"
    corrected.save(out)
    text = out.read_bytes().decode()
    kept = "".join(line for line in text.splitlines(keepends=True) if "truearm command" not in line)
    assert without_numbers(kept) == without_numbers(made())
    for fixed in ("33", "F100", "sec: 1", "[0.0, 0, 0, 0, 0]", "; J2=0", "J1=1)", "plan 7"):
        assert (fixed in kept) == (fixed in made())
    again = out if kept != text else None
    # The joints that were written, to a tenth of a thousandth of a degree, in the file's unit.
    if again is None:
        assert any("cannot refuse" in block for block in corrected.blocks())
        out.write_text(text.replace("action", "observation.state"))
        np.testing.assert_allclose(
            ta.correct(model, out, angle_unit=unit, direction="feedback").joints, Q, rtol=0, atol=5e-6
        )
    else:
        refuses("corrected already", ta.correct, model, out)
        back = ta.correct(model, out, direction="feedback")
        np.testing.assert_allclose(back.targets.joints, plain.joints, rtol=0, atol=2e-6)
        np.testing.assert_allclose(back.joints, Q, rtol=0, atol=5e-6)
        back.save(tmp_path / f"back{out.suffix}")
        assert "truearm" not in (tmp_path / f"back{out.suffix}").read_bytes().decode()


@pytest.mark.parametrize("name", FILES)
def test_a_model_that_is_the_nominal_arm_changes_no_number(unchanged, tmp_path, name):
    made, unit = FILES[name]
    (tmp_path / name).write_bytes(made().encode())
    out = tmp_path / f"out{(tmp_path / name).suffix}"
    ta.correct(unchanged, tmp_path / name, angle_unit=unit, untrained="accept").save(out)
    lines = out.read_bytes().decode().splitlines(keepends=True)
    assert "".join(line for line in lines if "truearm command" not in line) == made()


def test_joints_that_are_known_by_numbers_alone_are_said(model, tmp_path):
    (tmp_path / "t.yaml").write_text(trajectory())
    assert "by the numbers" not in str(ta.correct(model, tmp_path / "t.yaml", untrained="accept"))
    (tmp_path / "t.yaml").write_text(re.sub(r"J(\d)", r"arm_a\1", trajectory()))
    said = "Joints, by the numbers in their names: arm_a1, arm_a2, arm_a3, arm_a4, arm_a5."
    assert said in str(ta.correct(model, tmp_path / "t.yaml", untrained="accept"))


def test_a_dataset_of_lerobot_keeps_its_columns_types_and_metadata(model, tmp_path):
    state = np.hstack([np.degrees(Q), np.full((4, 1), 33.0)]).astype(np.float32)
    fixed, loose = pa.list_(pa.float32(), 6), pa.list_(pa.float32())
    table = pa.table(
        {
            "observation.state": pa.array(state.tolist(), type=loose),
            "action": pa.array(state.tolist(), type=fixed),
            "timestamp": np.arange(4) / 30,
        }
    ).replace_schema_metadata({b"huggingface": b"{}"})
    pq.write_table(table, tmp_path / "d.parquet")
    corrected = ta.correct(model, tmp_path / "d.parquet", angle_unit="deg")
    corrected.save(tmp_path / "c.parquet")
    found = pq.read_table(tmp_path / "c.parquet")
    assert found.schema.equals(table.schema)
    assert found.schema.metadata[b"huggingface"] == b"{}"
    assert found["observation.state"].equals(table["observation.state"])
    action = np.array(found["action"].to_pylist())
    np.testing.assert_allclose(np.radians(action[:, :5]), ta.correct(model, Q).joints, rtol=0, atol=1e-6)  # float32
    assert (action[:, 5] == 33).all()
    refuses("corrected already", ta.correct, model, tmp_path / "c.parquet", angle_unit="deg")
    # What the motors read is another column.
    read = ta.correct(model, tmp_path / "c.parquet", angle_unit="deg", direction="feedback")
    read.save(tmp_path / "f.parquet")
    assert pq.read_table(tmp_path / "f.parquet")["action"].equals(found["action"])


def test_ticks_stay_whole_numbers(model, tmp_path):
    from test_lerobot_motors import calibration

    (tmp_path / "cal.json").write_text(calibration())
    (tmp_path / "t.csv").write_text(",".join(NAMES) + "\n2000,2100,1900,2100,2000\n")
    ta.correct(
        model, tmp_path / "t.csv", angle_unit="counts", motors=str(tmp_path / "cal.json"), untrained="accept"
    ).save(tmp_path / "o.csv")
    ticks = (tmp_path / "o.csv").read_text().splitlines()[1].split(",")
    assert all(tick.isdecimal() for tick in ticks)
    assert max(abs(int(tick) - was) for tick, was in zip(ticks, (2000, 2100, 1900, 2100, 2000), strict=True)) < 20


def test_a_path_is_written_whole_or_not_at_all(model, tmp_path, truearm, refused):
    model.save(tmp_path / "m.truearm")
    far = trajectory().replace(str(float(Q[2, 0])), "2.9")
    (tmp_path / "t.yaml").write_text(far)
    ran = truearm("correct", tmp_path / "m.truearm", tmp_path / "t.yaml", "--out", tmp_path / "o.yaml")
    assert ran.code == 3
    assert "refused: line 11: " in ran.out
    assert "Nothing is written" in ran.out
    assert not (tmp_path / "o.yaml").exists()
    (tmp_path / "t.yaml").write_text(trajectory())
    command = ["correct", tmp_path / "m.truearm", tmp_path / "t.yaml", "--out"]
    refused([*command, tmp_path / "o.yaml", "--as", "rapid"], "--as does not apply to joints in a file of another")
    refused([*command, tmp_path / "o.csv"], ".yaml")
    refused([*command, tmp_path / "t.yaml"], "would be overwritten")
    (tmp_path / "mine.yaml").write_text("a: 1\n")
    refused([*command, tmp_path / "mine.yaml"], "does not say that truearm has written it")
    for _ in range(2):  # its own is replaced
        assert truearm(*command, tmp_path / "o.yaml").code == 0
    assert yaml.safe_load((tmp_path / "o.yaml").read_text())["joint_names"] == ["J2", "J1", "J3", "J5", "J4"]
    (tmp_path / "p.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n0,0,0,0,0\n")
    refused(
        ["correct", tmp_path / "m.truearm", tmp_path / "p.csv", "--angle-unit", "deg", "--out", tmp_path / "o.csv"],
        "--angle-unit applies to tables of LeRobot and ROS only",
    )


def test_json_under_the_name_of_yaml_is_marked(model, tmp_path):
    """Also where a list is at the top: a line of comment before it is YAML."""
    message = {"joint_names": ["J1", "J2", "J3", "J4", "J5"], "points": [{"positions": Q[0].tolist()}]}
    for document in (message, {"goal": {"trajectory": message}}, [message, message]):
        (tmp_path / "t.yaml").write_text(json.dumps(document))
        ta.correct(model, tmp_path / "t.yaml").save(tmp_path / "o.yaml")
        assert type(yaml.safe_load((tmp_path / "o.yaml").read_text())) is type(document)
        refuses("corrected already", ta.correct, model, tmp_path / "o.yaml")
    (tmp_path / "t.json").write_text(json.dumps(message))
    refuses("ends in .yaml", ta.correct, model, tmp_path / "t.json")


def test_the_order_of_joints_is_that_of_their_names():
    so101, ur10 = ta.load_arm("so101"), ta.load_arm("ur10")
    assert places_of(["joint_3", "joint_1", "joint_2", "joint_5", "joint_4"], so101) == [1, 2, 0, 4, 3]
    shown = ["elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint", "wrist_1_joint", "wrist_2_joint"]
    assert places_of([*shown, "wrist_3_joint"], ur10) == [2, 1, 0, 3, 4, 5]
    assert places_of(list("abcde"), so101) is None
    # An arm without parallel axes has none of a UR's names.
    assert places_of([*shown, "wrist_3_joint"], ta.load_arm("irb120")) is None
    assert places_of(["J1", "J1", "J2", "J3", "J4"], so101) is None


BAD = {
    "unknown.yaml": (
        "joint_names: [a, b, c, d, e]\npoints:\n- positions: [1, 2, 3, 4, 5]\n",
        "expected joints J1, J2, J3, J4, J5, got a, b, c, d, e",
    ),
    "nameless.yaml": ("joint_names: []\npoints: []\n", "got none"),
    "lacks.yaml": ("joint_names: [J1, J2, J3, J5, J6]\npoints: []\n", "J4 missing, J6 unknown"),
    "message.json": ('{"joint_names": [], "points": []}', "no place to say that a file is corrected.*yaml"),
    "lacks.csv": ("shoulder_pan.pos,shoulder_lift.pos,wrist_flex.pos\n1,2,3\n", "elbow_flex, wrist_roll missing"),
    "read.csv": ('observation.state\n"[1,2,3,4,5]"\n', "is about action.*Try: --direction feedback"),
    "read_each.csv": (",".join(f"observation.state.{name}" for name in NAMES) + "\n1,2,3,4,5\n", "is about action"),
    "short.yaml": ("joint_names: [J1, J2, J3, J4, J5]\npoints:\n- positions: [1, 2]\n", "expected 5 positions, got 2"),
    "words.yaml": ("joint_names: [J1, J2, J3, J4, J5]\npoints: [[1, 2, x, 4, 5]]\n", "as a finite number"),
    "bomb.yaml": ("a: &a [1]\nb: *a\n", "anchors"),
    "deep.yaml": ("[" * 50 + "]" * 50, "levels"),
    "none.yaml": ("a: 1\n", "expected a trajectory"),
    "latin.yaml": ("# \u00e9\n", "expected UTF-8"),
    "some.nc": ("G1 J1=1 J2=2\n", "expected all 5 joints of the arm"),
    "xyz.nc": ("G1 X1 A1 B2 C3 U4 V5\n", "no other axes"),
    "increments.nc": ("G91\nG1 J1=1 J2=2 J3=3 J4=4 J5=5\n", "G91 changes what joints mean"),
    "exponent.nc": ("G1 J1=1e1 J2=2 J3=3 J4=4 J5=5\n", "line 1: .* as plain numbers, .*got J1=1e1"),
    "exponent_of_letters.nc": ("G1 A1E1 B2 C3 U4 V5\n", "got A1E1"),
    "sum.nc": ("G1 J1=1 + 2 J2=2 J3=3 J4=4 J5=5\n", r"got J1=1[.]"),
    "variables.nc": ("G1 A1 B2 C3 U4 V5\nG1 A#1 B[2+#5] C=3 U-#4 V5\n", r"line 2: .*got A#1, B\[2\+#5\], C=3, U-#4"),
    "variables_of_joints.nc": ("G1 J1=#1 J2=2 J3=3 J4=4 J5=5\n", "got J1=#1"),
    "cartesian.nc": ("G1 J1=1 J2=2 J3=3 J4=4 J5=5\nG1 X100 Y50 Z20\n", "line 2: .*got X100, Y50, Z20"),
    "twice.nc": ("G1 A1 A2 B2 C3 U4 V5\n", "got A, A, B, C, U, V"),
    "tenth.nc": ("G1 J1=1 J2=2 J3=3 J4=4 J5=5 J10=6\n", "got J10=6"),
    "empty.nc": ("M30\n", "expected lines with joints"),
    "unit.csv": ("J1,J2,J3,J4,J5\n1,2,3,4,5\n", "do not say their unit"),
    "cells.csv": (",".join(NAMES) + "\n1,2,3,4\n", "do not say their unit"),
    "broken.parquet": ("PAR1 no", "cannot be read as Parquet"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_not_clear_is_refused(model, tmp_path, name):
    text, said = BAD[name]
    (tmp_path / name).write_bytes(text.encode("latin-1"))
    error = refuses(said, ta.correct, model, tmp_path / name)
    assert error.file == tmp_path / name


@pytest.mark.parametrize(
    ("name", "text", "unit", "said"),
    [
        ("a.nc", "G1 J1=1 J2=2 J3=3 J4=4 J5=5\n", "rad", "--angle-unit rad does not apply: joints in .nc are in deg"),
        ("t.yaml", trajectory(), "deg", "are in rad"),
        ("two.csv", f'action\n"{[1.0] * 12}"\n', "deg", "expected 5 or 6 numbers of one arm in action, got 12"),
        ("ticks.csv", ",".join(NAMES) + "\n1,2,3,4,5\n1,2,2048,4,5\n", "deg", "line 3: expected elbow_flex from -180"),
    ],
)
def test_a_unit_that_numbers_or_the_format_contradict_is_refused(model, tmp_path, name, text, unit, said):
    (tmp_path / name).write_text(text)
    refuses(said, ta.correct, model, tmp_path / name, angle_unit=unit)


def test_columns_of_what_was_read_are_no_commands(model, tmp_path):
    header = [f"{what}.{name}.pos" for what in ("observation.state", "action") for name in NAMES]
    row = [*[0] * 5, *degrees(Q)[0]]
    (tmp_path / "t.csv").write_text(f"{','.join(header)}\n{','.join(map(str, row))}\n")
    for direction, expected in (("command", Q[0]), ("feedback", np.zeros(5))):
        found = ta.correct(model, tmp_path / "t.csv", angle_unit="deg", direction=direction, untrained="accept")
        np.testing.assert_allclose(found.targets.joints[0], expected, rtol=0, atol=1e-6)
        assert any(f"{header[0 if direction == 'feedback' else 5]}," in block for block in found.blocks())


def test_the_folder_of_a_data_set_is_answered_with_its_file(model, tmp_path, refused):
    (tmp_path / "ds" / "meta").mkdir(parents=True)
    (tmp_path / "ds" / "meta" / "info.json").write_text("{}")
    model.save(tmp_path / "m.truearm")
    command = ["correct", tmp_path / "m.truearm", tmp_path / "ds", "--out", tmp_path / "o.csv"]
    refused(command, "episode_000000.parquet")
    refused([*command, "--subdivide", "50mm"], "expected a number of mm")


@pytest.mark.parametrize(
    "line", ["G1A1B-2.5C+3U.4V5F100", "N1 G1 A 1 B 2 C 3, U 4 V 5 E6 O<a1> #1=A", "g1 a1 b2 c3 u4 v5 m3"]
)
def test_words_of_gcode_need_no_spaces(unchanged, tmp_path, line):
    (tmp_path / "a.nc").write_text(f"M6 T1\n{line}\n")
    assert len(ta.correct(unchanged, tmp_path / "a.nc", untrained="accept").targets) == 1


OLD = ",".join(f"main_{name}" for name in NAMES)
TWICE = ",".join((*NAMES, "action.shoulder_pan.pos"))


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (OLD, r"before it changed the zeros.*backward_compatibility/replay\.py"),
        (TWICE, "the columns shoulder_pan, action.shoulder_pan.pos are the same joint"),
        *(
            (",".join(name.format(i) for i in range(1, 6)), "do not say that they are positions")
            for name in (
                "joint{}_vel",
                "J{}_torque",
                "joint_{}_effort",
                "j{}.current",
                "f{}",
                "a_dot{}",
                "tau_{}",
                "vel_joint{}_raw",
            )
        ),
    ],
)
def test_columns_that_are_no_positions_are_refused(model, tmp_path, header, said):
    (tmp_path / "t.csv").write_text(f"{header}\n{','.join('1' * len(header.split(',')))}\n")
    refuses(said, ta.correct, model, tmp_path / "t.csv", angle_unit="deg")


@pytest.mark.parametrize(
    "name",
    [
        "J{}",
        "joint_{}",
        "r2_j{}",
        "panda_joint{}",
        "lbr_A{}.pos",
        "q{}",
        "joint{}_pos",
        "joint{}/position",
        "position[{}]",
        "arm.joint {} deg",
    ],
)
def test_columns_of_positions_are_joints(unchanged, tmp_path, name):
    (tmp_path / "t.csv").write_text(",".join(name.format(i) for i in range(1, 6)) + "\n1,2,3,4,5\n")
    done = ta.correct(unchanged, tmp_path / "t.csv", angle_unit="deg", untrained="accept")
    np.testing.assert_allclose(np.degrees(done.targets.joints), [[1, 2, 3, 4, 5]], rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "inside", "end"), [("percent", "0", "100"), ("counts", "2047", "3147"), ("deg", "0", "96.7")]
)
def test_a_correction_that_lerobot_cuts_off_is_said(model, tmp_path, unit, inside, end):
    from test_lerobot_motors import calibration

    motors = json.loads(calibration())
    for motor in motors.values():
        motor |= {"range_min": 947, "range_max": 3147, "drive_mode": 0}
    (tmp_path / "cal.json").write_text(json.dumps(motors))
    rows = [
        ",".join([inside] * 5),
        ",".join([inside, inside, end, inside, inside]),
        ",".join([inside, inside, f"{2 * float(inside) - float(end):g}", inside, inside]),
    ]
    (tmp_path / "t.csv").write_text("\n".join([",".join(NAMES), *rows, ""]))
    options = {"angle_unit": unit, "motors": str(tmp_path / "cal.json"), "untrained": "accept"}
    done = ta.correct(model, tmp_path / "t.csv", **options)
    count = int((np.abs(np.degrees(done.joints)) > 1100.5 / 4095 * 360).any(axis=1).sum())  # half a tick beyond
    assert count, np.degrees(done.joints)
    said = "\n".join(done.blocks())
    assert f"{count} of 3 targets are beyond the range of a motor after the correction, first line" in said
    read = ta.correct(model, tmp_path / "t.csv", direction="feedback", **options)
    assert "range of a motor" not in "\n".join(read.blocks())


def test_a_data_set_with_old_motors_is_refused(model, tmp_path):
    file = tmp_path / "data" / "chunk-000" / "episode_000000.parquet"
    for folder in (file.parent, tmp_path / "meta"):
        folder.mkdir(parents=True)
    pq.write_table(pa.table({"action": pa.array([[1.0, 2, 3, 4, 5, 6]])}), file)
    info = tmp_path / "meta" / "info.json"
    info.write_text(json.dumps({"names": NAMES}))
    assert len(ta.correct(model, file, angle_unit="deg", untrained="accept").targets) == 1
    info.write_text(json.dumps({"names": [f"main_{name}" for name in NAMES]}))
    refuses("before it changed the zeros", ta.correct, model, file, angle_unit="deg")


def test_a_small_parquet_file_that_is_large_is_refused(model, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MAX_CELLS", 2**17)
    monkeypatch.setattr(tables, "MAX_BYTES", 2**22)
    n = 2**17 + 1
    long = pa.ListArray.from_arrays(pa.array([0, n], pa.int32()), pa.array(np.zeros(n, dtype=np.float32)))
    pq.write_table(pa.table({"action": long}), tmp_path / "cells.parquet", compression="zstd")
    wide = {"action": pa.array([[1.0] * 6]), "z": pa.array(["x" * (2**22 + 1)])}
    pq.write_table(pa.table(wide), tmp_path / "bytes.parquet", compression="zstd", write_statistics=False)
    often = pa.DictionaryArray.from_arrays(pa.array(np.zeros(300, dtype=np.int32)), pa.array(["x" * 20_000]))
    repeated = {"action": pa.array([[1.0] * 6] * 300), "z": often}
    pq.write_table(pa.table(repeated), tmp_path / "of_one.parquet", store_schema=False, dictionary_pagesize_limit=2**30)
    refuses("at most .* bytes without", ta.correct, model, tmp_path / "of_one.parquet", angle_unit="deg")
    for name in ("cells", "bytes"):
        assert (tmp_path / f"{name}.parquet").stat().st_size < 100_000
        refuses(
            f"expected at most .* {name} without", ta.correct, model, tmp_path / f"{name}.parquet", angle_unit="deg"
        )


def test_letters_are_names_of_six_joints(tmp_path):
    arm = ta.load_arm("xarm7")
    q = np.random.default_rng(0).uniform(-1, 1, (30, 7))
    model = ta.NominalModel(arm).fit(q, arm.chain.tip_in_base(q))
    (tmp_path / "a.nc").write_text("G1 A1 B2 C3 U4 V5 W6\n")
    refuses("expected J1=10 J2=-20 .., the 7 joints of the arm", ta.correct, model, tmp_path / "a.nc")


def test_rows_that_lack_a_joint_are_refused(model, tmp_path):
    header = ",".join(NAMES)
    for row, said in (("1,2,3,4", "expected 5 cells, got 4"), ("1,2,3,x,5", "expected 5 numbers of joints, got 4")):
        (tmp_path / "t.csv").write_text(f"{header}\n1,2,3,4,5\n{row}\n")
        assert refuses(said, ta.correct, model, tmp_path / "t.csv", angle_unit="deg").line == 3
    ur10 = ta.load_arm("ur10")
    q = np.random.default_rng(0).uniform(-1, 1, (30, 6))
    other = ta.KinematicModel(ur10).fit(q, ur10.chain.tip_in_base(q))
    refuses("expected the model of an SO-100 or SO-101", ta.correct, other, tmp_path / "t.csv", angle_unit="deg")
