"""Files of robots and boards mean what their programs write, and the transforms that are written what theirs read."""

import json

import numpy as np
import pytest
import yaml
from hand_eye_cells import make_cell
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.acceptance import Contradiction
from truearm.arm.rigid_motions import inverse, motion
from truearm.errors import InputError
from truearm.wings.camera.mounts import write_transforms
from truearm.wings.camera.pose_files import read_samples

BOTH = pytest.mark.parametrize("eye_in_hand", [False, True])
MM = 1e-3  # files have all digits: what is left is rounding


def quaternions(T):
    return Rotation.from_matrix(T[:, :3, :3]).as_quat()


def ros(T):
    return [
        {
            "translation": dict(zip("xyz", t.tolist(), strict=True)),
            "rotation": dict(zip("xyzw", q.tolist(), strict=True)),
        }
        for t, q in zip(T[:, :3, 3] / 1000, quaternions(T), strict=True)
    ]


def same(found, cell):
    exact = cell.hand_eye()
    for one, other in ((found.camera, exact.camera), (found.board, exact.board)):
        assert np.abs(one.T_parent_child - other.T_parent_child).max() < MM
        assert one.parent == other.parent


def metres(T):
    out = T.copy()
    out[:, :3, 3] /= 1000
    return out


@BOTH
@pytest.mark.parametrize("stated", [True, False])
def test_samples_of_easy_handeye2(eye_in_hand, stated, tmp_path):
    """Eye on base has the base in the effector; the demo files do not state where the camera is."""
    cell = make_cell(1, 15, eye_in_hand=eye_in_hand)
    robot = cell.flange if eye_in_hand else inverse(cell.flange)
    pairs = zip(ros(robot), ros(cell.seen), strict=True)
    kind = ("eye_in_hand" if eye_in_hand else "eye_on_base") if stated else ""
    content = {"parameters": {"calibration_type": kind}, "samples": [{"robot": r, "tracking": t} for r, t in pairs]}
    file = tmp_path / "calib.samples"
    file.write_text(yaml.safe_dump(content))
    found = ta.hand_eye(file, eye_in_hand=None if stated else eye_in_hand)
    same(found, cell)
    assert found.eye_in_hand == eye_in_hand


@BOTH
def test_an_option_against_what_the_samples_state_is_refused(eye_in_hand, tmp_path):
    """With poses of the base in the effector the other place of the camera fits as well: nothing else shows it."""
    cell = make_cell(1, 15, eye_in_hand=eye_in_hand)
    robot = cell.flange if eye_in_hand else inverse(cell.flange)
    pairs = zip(ros(robot), ros(cell.seen), strict=True)
    kind, where = ("eye_in_hand", "on the flange") if eye_in_hand else ("eye_on_base", "beside the robot")
    content = {"parameters": {"calibration_type": kind}, "samples": [{"robot": r, "tracking": t} for r, t in pairs]}
    file = tmp_path / "calib.samples"
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(Contradiction, match=f"calib.samples: the samples say that the camera is {where}"):
        ta.hand_eye(file, eye_in_hand=not eye_in_hand)
    same(ta.hand_eye(file, eye_in_hand=eye_in_hand), cell)


def test_samples_that_do_not_state_the_camera_are_said_to_be_taken_as_standing(tmp_path):
    cell = make_cell(1, 15)
    content = {
        "samples": [{"robot": r, "tracking": t} for r, t in zip(ros(inverse(cell.flange)), ros(cell.seen), strict=True)]
    }
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(content))
    found = ta.hand_eye(tmp_path / "a.yaml")
    same(found, cell)
    assert "taken to stand" in str(found)


def test_samples_of_easy_handeye_of_ros_1(tmp_path):
    cell = make_cell(1, 15, eye_in_hand=True)
    content = {
        "camera_marker_samples": {"transforms": ros(cell.seen)},
        "hand_world_samples": {"transforms": ros(cell.flange)},
    }
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(content))
    same(ta.hand_eye(tmp_path / "a.yaml", eye_in_hand=True), cell)


@BOTH
@pytest.mark.parametrize("form", ["pairs", "flat", "named", "yaml"])
def test_pairs_of_moveit(eye_in_hand, form, tmp_path):
    cell = make_cell(1, 15, eye_in_hand=eye_in_hand)
    pairs = [[F.tolist(), C.tolist()] for F, C in zip(metres(cell.flange), metres(cell.seen), strict=True)]
    flat = [[np.ravel(one).tolist() for one in pair] for pair in pairs]
    named = [{"effector_wrt_world": F, "object_wrt_sensor": C} for F, C in flat]
    content = {"pairs": pairs, "flat": flat, "named": named, "yaml": named}[form]
    file = tmp_path / ("a.yaml" if form == "yaml" else "a.json")
    file.write_text(json.dumps(content) if form != "yaml" else yaml.safe_dump(content))
    same(ta.hand_eye(file, eye_in_hand=eye_in_hand), cell)


def test_poses_of_industrial_calibration_beside_a_table_of_the_board(tmp_path):
    cell = make_cell(1, 15, eye_in_hand=True)
    (tmp_path / "poses").mkdir()
    flange = metres(cell.flange)
    entries = []
    for k, (t, q) in enumerate(zip(flange[:, :3, 3], quaternions(flange), strict=True)):
        named = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), [*t.tolist(), *q.tolist()], strict=True))
        (tmp_path / "poses" / f"{k}.yaml").write_text(yaml.safe_dump(named))
        entries.append({"image": f"images/{k}.png", "pose": f"poses/{k}.yaml"})
    (tmp_path / "cal_data.yaml").write_text(yaml.safe_dump({"data": entries}))
    np.savetxt(tmp_path / "board.txt", np.hstack([cell.seen[:, :3, 3], quaternions(cell.seen)]))
    found = ta.hand_eye(tmp_path / "board.txt", tmp_path / "cal_data.yaml", eye_in_hand=True, unit="mm")
    same(found, cell)


@pytest.mark.parametrize("form", ["matrices", "vectors", "motions"])
def test_arrays_of_opencv(form, tmp_path):
    cell = make_cell(1, 15, eye_in_hand=True)
    arrays = {}
    for name, T in (("gripper2base", cell.flange), ("target2cam", cell.seen)):
        if form == "motions":
            arrays[f"T_{name}"] = T
        else:
            R = T[:, :3, :3]
            arrays[f"R_{name}"] = R if form == "matrices" else Rotation.from_matrix(R).as_rotvec()[:, :, None]
            arrays[f"t_{name}"] = T[:, :3, 3, None]
    np.savez(tmp_path / "a.npz", **arrays)
    found = ta.hand_eye(tmp_path / "a.npz", eye_in_hand=True, unit="mm", robot_unit="mm")
    same(found, cell)
    with pytest.raises(InputError, match="the unit of the positions of the robot is not stated") as error:
        ta.hand_eye(tmp_path / "a.npz", eye_in_hand=True, unit="mm")
    assert "--robot-unit mm or --robot-unit m" in error.value.hint


def test_arrays_with_objects_are_refused(tmp_path):
    """They would be unpickled."""
    np.savez(tmp_path / "a.npz", R_gripper2base=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="the file is no npz with arrays of numbers"):
        read_samples(tmp_path / "a.npz")


def write_table(path, columns, *, header=True, separator=","):
    names, values = list(columns), np.column_stack(list(columns.values()))
    lines = [separator.join(map(repr, row)) for row in values.tolist()]
    path.write_text("\n".join([*([separator.join(names)] if header else []), *lines]) + "\n")


def columns_of(T, prefix="", unit="mm"):
    t = T[:, :3, 3] / (1000 if unit == "m" else 1)
    named = {f"{prefix}{axis}_{unit}": t[:, k] for k, axis in enumerate("xyz")}
    return named | {f"{prefix}{name}": q for name, q in zip(("qx", "qy", "qz", "qw"), quaternions(T).T, strict=True)}


@pytest.mark.parametrize("prefix", ["flange_", "tcp_", "robot_"])
@pytest.mark.parametrize("unit", ["mm", "m"])
def test_tables_with_both_sides(prefix, unit, tmp_path):
    cell = make_cell(1, 15)
    write_table(tmp_path / "a.csv", columns_of(cell.seen, "board_", unit) | columns_of(cell.flange, prefix, unit))
    same(ta.hand_eye(tmp_path / "a.csv"), cell)


def test_a_table_of_the_board_and_one_of_joints_in_either_order(tmp_path):
    cell = make_cell(1, 15)
    write_table(tmp_path / "board.csv", columns_of(cell.seen))
    write_table(tmp_path / "joints.csv", {f"q{k + 1}_deg": np.degrees(q) for k, q in enumerate(cell.joints.T)})
    one = ta.hand_eye(tmp_path / "board.csv", tmp_path / "joints.csv", arm="ur10")
    other = ta.hand_eye(tmp_path / "joints.csv", tmp_path / "board.csv", arm="ur10")
    assert np.array_equal(one.camera.T_parent_child, other.camera.T_parent_child)
    assert np.abs(one.camera.T_parent_child - cell.camera).max() < MM


@pytest.mark.parametrize("separator", [" ", ",", ";", "\t"])
@pytest.mark.parametrize("width", [7, 12, 16])
def test_tables_without_names(separator, width, tmp_path):
    cell = make_cell(1, 15)
    for name, T in (("board", cell.seen), ("robot", cell.flange)):
        numbers = np.hstack([T[:, :3, 3], quaternions(T)]) if width == 7 else T.reshape(15, 16)[:, :width]
        write_table(
            tmp_path / f"{name}.txt", {str(k): x for k, x in enumerate(numbers.T)}, header=False, separator=separator
        )
    found = ta.hand_eye(
        tmp_path / "board.txt",
        tmp_path / "robot.txt",
        unit="mm",
        robot_unit="mm",
        rotation="xyzw" if width == 7 else None,
        robot_rotation="xyzw" if width == 7 else None,
    )
    same(found, cell)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("a,b\n1,2\n", "expected columns of poses or joints"),
        ("q1_deg,q2_deg\n1,2\n3,4\n", "expected poses of the board in the camera, got none"),
        ("x_mm,y_mm,z_mm,qx,qy,qz,qw\n1,2,3,0,0,0,1\n", "expected joints or poses of the flange, got none"),
        ("x_mm,y_mm,z_mm,qx,qy,qz,qw\n1,2,x,0,0,0,1\n", "expected a number"),
    ],
)
def test_tables_that_lack_something_are_refused(content, said, tmp_path):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(InputError, match=said):
        ta.hand_eye(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.json", "[[1, 2]]", "expected two 4 x 4 motions in pair 1"),
        ("a.json", "{", "the file is no JSON"),
        ("a.json", "[]", "expected pairs of motions, got none"),
        ("a.yaml", "samples: [{robot: {translation: {x: 1}}}]", "tracking"),
        ("a.yaml", "a: 1", "expected samples or poses, got another YAML file"),
        ("a.npz", "PK", "expected"),
    ],
)
def test_broken_files_are_refused(name, content, said, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=said):
        read_samples(tmp_path / name)


def test_sides_of_different_number_are_refused():
    cell = make_cell(1, 15)
    with pytest.raises(InputError, match="got 15 poses of the board and 14 of the robot"):
        ta.hand_eye(cell.seen, cell.flange[1:])


def test_quaternions_that_are_none_are_refused(tmp_path):
    cell = make_cell(1, 15)
    table = columns_of(cell.seen) | columns_of(cell.flange, "flange_")
    table["qx"] = table["qx"] + 0.5
    write_table(tmp_path / "a.csv", table)
    with pytest.raises(InputError, match="the rotations of the board are no rotations as quaternions"):
        ta.hand_eye(tmp_path / "a.csv")


# What is written ------------------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("format", ["ros-transform", "easy-handeye", "yaml"])
def test_written_transforms_are_those_that_were_found(eye_in_hand, format, tmp_path):
    found = make_cell(1, 15, eye_in_hand=eye_in_hand, noise=(0.05, 0.2)).hand_eye()
    file = tmp_path / "out"
    write_transforms(file, found.camera, found.board, format=format, frames=("base", "tool0", "cam"))
    text = file.read_text()
    parent = "tool0" if eye_in_hand else "base"
    if format == "ros-transform":
        words = text.splitlines()[1].split()
        values = dict(zip(words[4::2], words[5::2], strict=True))
        t = [float(values[f"--{name}"]) for name in "xyz"]
        q = [float(values[f"--q{name}"]) for name in "xyzw"]
        assert (values["--frame-id"], values["--child-frame-id"]) == (parent, "cam")
    else:
        content = yaml.safe_load(text)
        if format == "easy-handeye":
            assert content["parameters"]["calibration_type"] == ("eye_in_hand" if eye_in_hand else "eye_on_base")
            one = content["transform"]
        else:
            one = content["transforms"][0]
            assert (one["frame_id"], one["child_frame_id"]) == (parent, "cam")
            assert len(content["transforms"]) == 4
            assert one["U_position_m"] == pytest.approx(found.camera.U_mm / 1000, abs=1e-9)
        t, q = ([one[part][name] for name in names] for part, names in (("translation", "xyz"), ("rotation", "xyzw")))
    T = motion(Rotation.from_quat(q).as_matrix(), 1000 * np.array(t))
    assert np.abs(T - found.camera.T_parent_child).max() < 1e-5  # nine decimals of a metre


def test_names_of_frames_are_words(tmp_path):
    found = make_cell(1, 15).hand_eye()
    with pytest.raises(InputError, match="expected names of base, flange and camera"):
        write_transforms(tmp_path / "a", found.camera, found.board, format="yaml", frames=("a", "b c", "d"))
    assert not (tmp_path / "a").exists()
