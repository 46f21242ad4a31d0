"""The ten mistakes of `hand-eye`: each is planted, and named before any fit."""

import sys

import numpy as np
import pytest
from hand_eye_cells import make_cell
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.arm.rigid_motions import inverse, motion
from truearm.errors import Contradiction, InputError
from truearm.wings.camera.closed_form import closed_form, refined
from truearm.wings.camera.pose_files import described

HALF = motion(Rotation.from_rotvec([0, 0, np.pi]).as_matrix(), np.zeros(3))
BOTH = pytest.mark.parametrize("eye_in_hand", [False, True])


def cell_of(eye_in_hand=False, **options):
    """As cameras are: 0.05 deg and 0.3 mm of noise, on an arm with errors."""
    return make_cell(7, 24, eye_in_hand=eye_in_hand, **{"errors": (5e-4, 0.3), "noise": (0.05, 0.3), **options})


def said(found):
    return " ".join(map(str, found.findings))


@BOTH
def test_a_camera_that_is_elsewhere_is_named(eye_in_hand):
    cell = cell_of(eye_in_hand)
    option = "--no-eye-in-hand" if not eye_in_hand else "--eye-in-hand"
    with pytest.raises(Contradiction, match="with the camera (on|beside)") as error:
        ta.hand_eye(cell.seen, cell.flange, eye_in_hand=not eye_in_hand)
    assert option in error.value.hint


@BOTH
@pytest.mark.parametrize("of", ["board", "robot"])
def test_inverted_poses_are_named_and_inverted_when_asked(eye_in_hand, of):
    cell = cell_of(eye_in_hand)
    seen, flange = (inverse(one) if name == of else one for name, one in (("board", cell.seen), ("robot", cell.flange)))
    with pytest.raises(Contradiction, match="the poses of robot or board are inverted") as error:
        ta.hand_eye(seen, flange, eye_in_hand=eye_in_hand)
    assert "--invert board" in error.value.hint
    found = ta.hand_eye(seen, flange, eye_in_hand=eye_in_hand, invert=of)
    assert np.abs(found.camera.T_parent_child - cell.hand_eye().camera.T_parent_child).max() < 1e-6  # mm; rounding


@BOTH
@pytest.mark.parametrize(("of", "word"), [("board", "board"), ("robot", "robot")])
def test_transposed_rotations_are_named(eye_in_hand, of, word):
    cell = cell_of(eye_in_hand)
    poses = {"board": cell.seen.copy(), "robot": cell.flange.copy()}
    poses[of][:, :3, :3] = poses[of][:, :3, :3].transpose(0, 2, 1)
    with pytest.raises(Contradiction, match=f"the rotations of the {word} are transposed"):
        ta.hand_eye(poses["board"], poses["robot"], eye_in_hand=eye_in_hand)


@pytest.mark.parametrize("eye_in_hand", [False, pytest.param(True, marks=pytest.mark.weekly)])
def test_boards_seen_half_turned_are_named_and_ignored(eye_in_hand):
    cell = cell_of(eye_in_hand)
    seen = cell.seen.copy()
    rows = [2, 9, 17]
    seen[rows] = seen[rows] @ HALF
    found = cell.with_seen(seen).hand_eye(joints=True)
    assert "half turned about its z axis: image 3, image 10, image 18" in said(found)
    assert found.n_used == 21
    without = cell.hand_eye(joints=True)
    off = found.camera.position_mm - without.camera.position_mm
    assert np.abs(off).max() < without.camera.U_mm


def test_too_many_half_turned_boards_are_refused():
    cell = cell_of()
    seen = cell.seen.copy()
    seen[:10] = seen[:10] @ HALF
    with pytest.raises(
        Contradiction, match="10 images of 24 contradict the others: the board was seen half turned"
    ) as e:
        cell.with_seen(seen).hand_eye()
    assert (e.value.hint or "").startswith("remove these rows, or use a ChArUco board")


@pytest.mark.parametrize("size", [0.4, 0.9, 1.1, 2.5])
@BOTH
def test_another_size_of_the_board_is_named_with_its_size(eye_in_hand, size):
    cell = cell_of(eye_in_hand)
    seen = cell.seen.copy()
    seen[:, :3, 3] /= size
    with pytest.raises(Contradiction, match="times the size that its poses have") as error:
        cell.with_seen(seen).hand_eye()
    stated = float(error.value.hint.split("--board-size ")[1].split()[0])
    assert stated == pytest.approx(size, rel=0.02)
    found = cell.with_seen(seen).hand_eye(board_size=size)
    assert np.abs(found.camera.position_mm - cell.hand_eye().camera.position_mm).max() < 1e-6  # mm


def test_metres_taken_for_millimetres_are_named():
    cell = cell_of()
    seen = cell.seen.copy()
    seen[:, :3, 3] /= 1000
    with pytest.raises(Contradiction, match="mm taken for m") as error:
        cell.with_seen(seen).hand_eye()
    assert "--board-size 1000 corrects" in (error.value.hint or "")


def test_a_slightly_larger_board_is_said_and_goes_on():
    cell = cell_of(errors=(5e-5, 0.03), noise=(0.02, 0.05))
    seen = cell.seen.copy()
    seen[:, :3, 3] /= 1.01
    assert "The arm's lengths say that the board is 1.01 " in said(cell.with_seen(seen).hand_eye())


@BOTH
def test_images_of_other_poses_are_named_and_ignored(eye_in_hand):
    cell = cell_of(eye_in_hand)
    seen, rng = cell.seen.copy(), np.random.default_rng(3)
    turned = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (3, 3))).as_matrix()
    seen[[1, 8, 20]] = motion(turned, np.zeros(3)) @ seen[[1, 8, 20]]
    found = cell.with_seen(seen).hand_eye()
    assert "he image is of another pose, or was taken while the arm moved: image 2, image 9, image 21" in said(found)


def test_exchanged_images_are_named():
    cell = cell_of()
    seen = cell.seen.copy()
    seen[[4, 12]] = seen[[12, 4]]
    assert "exchanged among these: image 5, image 13" in said(cell.with_seen(seen).hand_eye())


@pytest.mark.parametrize("shift", [1, -2])
def test_images_that_are_shifted_against_the_poses_are_named(shift):
    cell = cell_of()
    first = {1: "the first image has no pose", -2: "the first 2 poses have no image"}[shift]
    with pytest.raises(InputError, match=f"rows? (earlier|later) they agree.*pair each pose .*: {first}"):
        cell.with_seen(np.roll(cell.seen, shift, axis=0)).hand_eye()


def test_an_image_whose_board_was_moved_is_ignored():
    cell = cell_of()
    seen = cell.seen.copy()
    seen[6, :3, 3] += [0, 40, 0]
    found = cell.with_seen(seen).hand_eye(joints=True)
    assert "positions are gross errors: 1 image (image 7)" in said(found)


FORMS = {
    "wxyz": lambda R: R.as_quat(scalar_first=True),
    "xyzw": lambda R: R.as_quat(),
    "rotvec:rad": lambda R: R.as_rotvec(),
    "rotvec:deg": lambda R: R.as_rotvec(degrees=True),
    "ZYX:deg": lambda R: R.as_euler("ZYX", degrees=True),
    "xyz:rad": lambda R: R.as_euler("xyz"),
    "ZYZ:deg": lambda R: R.as_euler("ZYZ", degrees=True),
}


def write_board(path, seen, form):
    numbers = FORMS[form](Rotation.from_matrix(seen[:, :3, :3]))
    names = ["rx", "ry", "rz"] if numbers.shape[1] == 3 else ["qx", "qy", "qz", "qw"]
    rows = np.hstack([seen[:, :3, 3], numbers])
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    path.write_text("\n".join([",".join(["x_mm", "y_mm", "z_mm", *names]), *lines]) + "\n")


@pytest.mark.parametrize("form", [form for form in FORMS if form not in ("wxyz", "xyzw")])
def test_the_form_of_rotations_that_is_not_stated_is_found(form, tmp_path):
    cell = cell_of()
    write_board(tmp_path / "board.csv", cell.seen, form)
    found = ta.hand_eye(tmp_path / "board.csv", cell.flange)
    assert f"are read as {described(form)}: of " in said(found)
    assert np.abs(found.camera.position_mm - cell.hand_eye().camera.position_mm).max() < 1e-3  # mm


@pytest.mark.parametrize(
    ("true", "stated"), [("ZYX:deg", "xyz:deg"), ("rotvec:rad", "xyz:rad"), ("xyz:rad", "ZYX:rad")]
)
def test_another_form_than_stated_is_named(true, stated, tmp_path):
    cell = cell_of()
    write_board(tmp_path / "board.csv", cell.seen, true)
    with pytest.raises(Contradiction, match=described(true)) as error:
        ta.hand_eye(tmp_path / "board.csv", cell.flange, rotation=stated)
    assert f"--rotation {true}" in error.value.hint


def test_quaternions_in_another_order_than_their_columns_are_named(tmp_path):
    cell = cell_of()
    write_board(tmp_path / "board.csv", cell.seen, "wxyz")
    with pytest.raises(Contradiction, match="with quaternions in the order w, x, y, z") as error:
        ta.hand_eye(tmp_path / "board.csv", cell.flange)
    assert "--rotation wxyz" in error.value.hint
    assert ta.hand_eye(tmp_path / "board.csv", cell.flange, rotation="wxyz").n_used == 24


@BOTH
def test_poses_that_turn_about_one_axis_are_refused_with_the_axis(eye_in_hand):
    """An arm of four axes, or a flange that was turned about the vertical only."""
    rng = np.random.default_rng(2)
    flange = motion(
        Rotation.from_rotvec(rng.uniform(-2, 2, (15, 1)) * [0, 0, 1.0]).as_matrix(), rng.normal(size=(15, 3))
    )
    flange[:, :3, 3] *= 200
    camera, board = make_cell(0, 4).camera, make_cell(0, 4).board
    seen = inverse(camera) @ (inverse(flange) if eye_in_hand else flange) @ board
    with pytest.raises(InputError, match=r"turn about one axis, \(0.00, 0.00, 1.00\) of the (base|flange)"):
        ta.hand_eye(seen, flange, eye_in_hand=eye_in_hand)


@pytest.mark.parametrize("focal", [0.9, 1.05])
def test_a_wrong_focal_length_is_said(focal):
    """Distances along the axis are off, those across it are not."""
    cell = cell_of(errors=(5e-5, 0.03), noise=(0.02, 0.1))
    seen = cell.seen.copy()
    seen[:, 2, 3] *= focal
    assert "the focal length is wrong, or of another resolution" in said(cell.with_seen(seen).hand_eye(accept="a test"))


def test_a_frame_that_is_no_optical_frame_is_said():
    cell = cell_of()
    link = np.array([[0, 0, 1.0, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # camera_link from optical
    seen = cell.seen.copy()
    ahead = make_cell(7, 24).seen
    ahead[:, :3, 3] = [0, 0, 900] + 0.2 * (seen[:, :3, 3] - seen[:, :3, 3].mean(axis=0))
    assert "camera_link" in said(cell.with_seen(link @ seen).hand_eye()) or seen[:, 2, 3].mean() < 0


def test_poses_of_a_tool_beside_joints_are_named(tmp_path):
    cell = cell_of(errors=(1e-5, 0.01))
    table = table_with_both(tmp_path, cell, tool=np.tile([0, 0, 110.0], (24, 1)))
    assert "are of a tool at (0.0, 0.0, 110.0) mm on the flange" in said(table)


def test_a_tool_that_changed_between_rows_is_named(tmp_path):
    cell = cell_of(errors=(1e-5, 0.01))
    tool = np.tile([0, 0, 110.0], (24, 1))
    tool[20:] = [0, 0, 250.0]
    assert "The tool of the controller was another one at 4 images: line 22, line 23" in said(
        table_with_both(tmp_path, cell, tool)
    )


def table_with_both(folder, cell, tool):
    file = folder / "samples.csv"
    tcp = cell.flange @ motion(np.eye(3), tool)
    names = [f"q{i}_rad" for i in range(1, 7)]
    names += ["x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"]
    names += [f"tcp_{name}" for name in ("x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw")]
    parts = [cell.joints]
    for T in (cell.seen, tcp):
        parts += [T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()]
    lines = [",".join(map(repr, row)) for row in np.hstack(parts).tolist()]
    file.write_text("\n".join([",".join(names), *lines]) + "\n")
    return ta.hand_eye(file, arm=cell.arm)


def test_the_other_tilt_of_a_single_marker_is_named():
    cell = cell_of()
    seen = cell.seen.copy()
    for row in (3, 11):
        line = seen[row, :3, 3] / np.linalg.norm(seen[row, :3, 3])
        seen[row, :3, :3] = Rotation.from_rotvec(np.pi * line).as_matrix() @ seen[row, :3, :3] @ HALF[:3, :3]
    assert "with the other tilt (a single marker has two): image 4, image 12" in said(cell.with_seen(seen).hand_eye())


def test_an_error_of_the_arm_is_not_left_to_the_camera():
    cell = make_cell(8, 40, errors=(2e-3, 1.0), noise=(0.02, 0.1))
    alone, identified = cell.hand_eye(joints=True).held_out_mm
    assert identified < 0.3 * alone


def test_what_fits_in_no_way_is_refused_and_goes_on_with_a_reason():
    cell = cell_of()
    seen = cell.seen.copy()
    seen[:, :3, 3] = np.random.default_rng(1).uniform(-500, 500, (24, 3))
    with pytest.raises(Contradiction, match="the turns agree"):
        cell.with_seen(seen).hand_eye()
    found = cell.with_seen(seen).hand_eye(accept="to see the rest")
    assert "Accepted (to see the rest)" in said(found)
    assert isinstance(found.camera.T_parent_child, np.ndarray)


def test_a_result_stays_where_its_images_cannot_be_judged_again(monkeypatch):
    """With a zero 8 deg off right images look as if they were of another pose; the fit that would use them fails."""
    cell, fits = make_cell(0, 24, errors=(5e-4, 0.3), noise=(0.05, 0.3)), iter([ta.fit])

    def first_only(*args, **options):
        if (one := next(fits, None)) is None:
            raise InputError("expected 6 joints")
        return one(*args, **options)

    monkeypatch.setattr(sys.modules[ta.hand_eye.__module__], "fit", first_only)
    found = ta.hand_eye(cell.seen, cell.joints + np.radians([0, 8, 0, 0, 0, 0]), arm=cell.arm)
    assert found.n_used < 24
    assert "could not be judged again by the zeros found: expected 6 joints; those ignored stay so." in said(found)


@pytest.mark.parametrize("joints", [False, True])
def test_images_of_other_poses_that_are_accepted_are_all_used_and_said(joints):
    """Two of them alone turn about one axis; with the joints the fit itself accepts more."""
    cell = cell_of(True)
    found = cell.with_seen(cell.seen[::-1]).hand_eye(joints=joints, model="nominal", accept="to see the rest")
    assert found.interpretation.turn_deg > 5
    assert len(found.interpretation.rows) == 24
    assert "robot and camera turn differently" in said(found)
    assert "Accepted (to see the rest): " in said(found)
    assert "Nothing had to be accepted" not in said(found)


@pytest.mark.parametrize("n", [4, 9])
def test_few_images_leave_the_arm_nominal(n):
    found = make_cell(1, n, noise=(0.02, 0.1)).hand_eye(joints=True)
    assert "too few to identify the arm" in said(found)
    assert found.fitted.model_name == "nominal"
    assert f"Only {n} images: U comes from their scatter" in said(make_cell(1, n, noise=(0.02, 0.1)).hand_eye())


@BOTH
@pytest.mark.parametrize("of", ["board", "camera"])
@pytest.mark.parametrize("joints", [False, True])
def test_a_camera_or_board_that_moved_between_two_images_is_named(eye_in_hand, of, joints):
    """By 5 mm, beside an arm with errors of some 1 mm; with the joints the row of the image is that of the file."""
    cell = make_cell(7, 40, eye_in_hand=eye_in_hand, errors=(5e-4, 0.3), noise=(0.05, 0.3))
    assert "moved between" not in said(cell.hand_eye(joints=joints))
    seen, by = cell.seen.copy(), motion(np.eye(3), np.array([5.0, 0, 0]))
    seen[22:] = seen[22:] @ by if of == "board" else by @ seen[22:]
    between = "reading 22 and reading 23" if joints else "image 22 and image 23"
    found = said(cell.with_seen(seen).hand_eye(joints=joints))
    assert f"moved between {between}" in found
    assert f"he {of}" in found.partition(" moved between")[0].rpartition(". ")[2] + "he"
    with_names = "column session, and fit again" in found
    assert not with_names


def test_a_step_between_images_of_other_poses_may_be_the_arms():
    """In the order of the first joint poses tell the images after it; in a random order they do not."""
    cell = make_cell(7, 40, errors=(5e-4, 0.3), noise=(0.05, 0.3))
    for order, doubted in ((np.arange(40), False), (np.argsort(cell.joints[:, 0]), True)):
        flange, seen = cell.flange[order], cell.seen[order]
        seen[22:] = motion(np.eye(3), np.array([15.0, 0, 0])) @ seen[22:]
        found = said(ta.hand_eye(seen, flange))
        assert "moved between" in found
        assert (", or the arm errs so at other poses: give the images" in found) == doubted


def test_joints_of_another_sign_are_named():
    cell = cell_of()
    joints = cell.joints * [1, 1, -1, 1, 1, 1]
    with pytest.raises(Contradiction, match="turn differently") as error:
        ta.hand_eye(cell.seen, joints, arm=cell.arm)
    assert error.value.hint.startswith("put this right: sign of J3 reversed (")


@pytest.mark.parametrize(
    ("factor", "said"), [(1e-3, "mm from the camera, as if m were taken"), (1e3, "as if mm were taken for m")]
)
def test_one_wrong_unit_of_both_sides_is_refused(factor, said):
    cell = cell_of()
    seen, flange = cell.seen.copy(), cell.flange.copy()
    for one in (seen, flange):
        one[:, :3, 3] *= factor
    with pytest.raises(Contradiction, match=said):
        ta.hand_eye(seen, flange)


@BOTH
def test_a_left_handed_frame_of_the_robot_is_named(eye_in_hand):
    cell, mirror = cell_of(eye_in_hand), np.diag([1.0, -1.0, 1.0, 1.0])
    with pytest.raises(Contradiction, match="if one axis of the robot's poses, or the images, are mirrored"):
        ta.hand_eye(cell.seen, mirror @ cell.flange @ mirror, eye_in_hand=eye_in_hand)


def test_a_tool_of_the_controller_that_changed_is_no_other_size_of_the_board():
    cell = make_cell(7, 40, errors=(5e-4, 0.3), noise=(0.05, 0.3))
    flange = cell.flange.copy()
    flange[22:] = flange[22:] @ motion(np.eye(3), np.array([0, 0, 120.0]))
    found = said(ta.hand_eye(cell.seen, flange))
    assert "The board (or the controller's tool) moved between image 22 and image 23, by 1" in found


@pytest.mark.parametrize("joints", [False, True])
def test_three_images_are_too_few(joints):
    with pytest.raises(InputError, match="expected 4 images or more, got 3"):
        make_cell(1, 3).hand_eye(joints=joints)


def test_a_board_that_makes_all_lengths_of_the_arm_wrong_is_said_as_its_size():
    cell = cell_of()
    seen = cell.seen.copy()
    seen[:, :3, 3] /= 1.03
    with pytest.raises(InputError, match=r"the board is 1.03\d* times the size that its poses have") as error:
        cell.with_seen(seen).hand_eye(joints=True)
    assert "--board-size 1.03" in error.value.hint


def test_images_of_two_places_of_the_board_in_turn_are_named():
    cell = cell_of()
    seen = cell.seen.copy()
    seen[1::2] = seen[1::2] @ motion(Rotation.from_rotvec([0.3, 0.5, -0.4]).as_matrix(), np.array([90.0, 0, 0]))
    with pytest.raises(
        Contradiction, match="12 of 24 images agree with each other, and so do the others: image"
    ) as error:
        cell.with_seen(seen).hand_eye()
    assert error.value.hint.startswith("are there two boards, or two places of one?")


def test_joints_without_names_and_a_rotation_before_its_position_have_a_remedy(tmp_path):
    cell = cell_of()
    turns = Rotation.from_matrix(cell.seen[:, :3, :3]).as_rotvec()
    for name, columns in (("seen", [cell.seen[:, :3, 3], turns]), ("turned", [turns, cell.seen[:, :3, 3]])):
        np.savetxt(tmp_path / f"{name}.txt", np.hstack(columns), delimiter=",")
    np.savetxt(tmp_path / "joints.txt", np.degrees(cell.joints), delimiter=",")
    with pytest.raises(InputError) as error:
        ta.hand_eye(tmp_path / "seen.txt", tmp_path / "joints.txt", unit="mm", arm="ur10")
    assert "joints have names, q1_deg or q1_rad" in error.value.hint
    with pytest.raises(InputError, match="rotations of the board are no rotations as quaternions"):
        ta.hand_eye(tmp_path / "seen.txt", cell.joints, unit="mm", arm="ur10", rotation="xyzw")
    with pytest.raises(InputError, match="rotations of the board are no rotations") as error:
        ta.hand_eye(tmp_path / "turned.txt", cell.flange, unit="mm")
    assert "a position comes before its rotation" in error.value.hint


@BOTH
def test_right_images_of_an_arm_whose_zeros_are_off_are_used(eye_in_hand):
    """Of 24 some look as of another pose, with a zero 6 deg off; with 14 deg so many do that they are refused."""
    cell = cell_of(eye_in_hand)
    for off_deg in (6, 14):
        joints = cell.joints + np.radians([0, 0, off_deg, 0, 0, 0])
        found = ta.hand_eye(cell.seen, joints, arm=cell.arm, eye_in_hand=eye_in_hand)
        assert found.n_used == 24
        assert "Zeros of joints are off, add to their theta: J3 -" in said(found)
        assert "another pose" not in said(found)


def test_a_far_board_scatters_as_far_boards_do_and_a_near_one_does_not():
    """The noise of a distance grows with its square: off by eight times the usual, a far image is no gross error."""
    cell = make_cell(3, 40, noise=(0.02, 0.1))
    away = np.linalg.norm(cell.seen[:, :3, 3], axis=1)
    usual = np.median(refined_alone(cell).held_out_mm)
    for row, is_used in ((away.argmax(), True), (away.argmin(), False)):
        seen = cell.seen.copy()
        seen[row, :3, 3] *= 1 + 7.5 * usual / away[row]
        assert refined_alone(cell.with_seen(seen)).rows[row] == is_used


def refined_alone(cell):
    return refined(cell.flange, cell.seen, closed_form(cell.flange, cell.seen, sized=False))
