"""Several cameras and boards in one fit: planted truth, the equations of all pixels, what is refused."""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.arm.rigid_motions import motion
from truearm.errors import InputError
from truearm.identification.references.reading_references import poses_of
from truearm.identification.references.session_frames import to_first_session_frame
from truearm.wings.camera.boards import charuco
from truearm.wings.camera.cell_images import NAMING
from truearm.wings.camera.fit_images import ImageFit, fit_images
from truearm.wings.camera.lenses import read_camera
from truearm.wings.camera.observations import PixelObservations
from truearm.wings.camera.virtual_cell import VirtualCell, small_cell, table_of, working_lens

BOARDS = {"A": charuco(12, 9, 20.4, 15.3), "B": charuco(10, 8, 18.0, 13.5)}
LENSES = {"left": working_lens(), "right": working_lens(1600, 1200, 1800.0)}
# Images of every camera with every board that it sees.
EACH = 16
# Of a planted number in its standard uncertainties: once in three thousand for each of some twenty.
MOST_U = 4.0


@cache
def cells(wrist: bool) -> dict[tuple[str, str], VirtualCell]:
    """A virtual UR5 with two boards on its flange and two cameras, or a camera that stands and one on the flange."""
    one = small_cell("ur5", seed=1)
    first = replace(one, lens=LENSES["left"], board=BOARDS["A"])
    if wrist:
        other = VirtualCell.around(one.virtual, LENSES["right"], BOARDS["B"], in_hand=True, seed=7)
        return {("left", "A"): first, ("right", "B"): other}
    turned = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    mounted = one.T_flange_mounted @ motion(turned, np.array([120.0, -60.0, 20.0]))
    beside = VirtualCell.around(one.virtual, LENSES["right"], BOARDS["B"], in_hand=False, seed=5).T_world_fixed
    second = replace(first, board=BOARDS["B"], T_flange_mounted=mounted)
    third = replace(second, lens=LENSES["right"], T_world_fixed=beside)
    return {("left", "A"): first, ("left", "B"): second, ("right", "B"): third}


def joined(of: dict[tuple[str, str], VirtualCell], seed: int = 20) -> tuple[ta.Session, PixelObservations]:
    """Joints and corners of all, each at poses of its own."""
    angles, parts = [], []
    for i, ((camera, board), cell) in enumerate(of.items()):
        session, pixels = cell.table(EACH, seed=seed + i)
        start = sum(map(len, angles))
        angles.append(session.angles)
        size = (cell.lens.width, cell.lens.height)
        names = np.char.add(f"{board} ", pixels.image)
        columns = {"camera": np.full(len(pixels), camera), "board": np.full(len(pixels), board), "image": names}
        parts.append(replace(pixels, reading=pixels.reading + start, **columns, sizes_px={camera: size}))
    return ta.Session(np.concatenate(angles)), PixelObservations.joined(parts)


@cache
def seen(wrist: bool, seed: int = 20) -> tuple[ta.Session, PixelObservations]:
    return joined(cells(wrist), seed)


@cache
def fitted(wrist: bool) -> ImageFit:
    """With other images as its test."""
    session, pixels = seen(wrist)
    hand = ["right"] if wrist else False
    test = seen(wrist, 60)
    return fit_images("ur5", session, pixels, board=BOARDS, eye_in_hand=hand, model="kinematic", test=test)


@pytest.mark.parametrize("wrist", [False, True])
def test_planted_cameras_and_boards_are_found_within_their_uncertainty(wrist):
    of, found = cells(wrist), fitted(wrist)
    assert found.n_used == EACH * len(of)
    for k, (name, lens) in enumerate(LENSES.items()):
        own = found.poses.images.intrinsics[k]
        u = found.u_intrinsics[own]
        assert (np.abs(found.lenses[k].intrinsics - lens.intrinsics) < MOST_U * u).all(), name
    assert (np.abs(found.board_scales - 1) < 3 * found.u_intrinsics[-2:]).all()
    places = {one.child: one for one in (*found.cameras, *found.boards)}
    for (camera, board), cell in of.items():
        to_corner = motion(np.eye(3), -cell.middle)
        standing, mounted = cell.T_world_fixed, cell.T_flange_mounted
        true = (mounted, standing @ to_corner) if cell.is_in_hand else (standing, mounted @ to_corner)
        for name, T in zip((camera, board), true, strict=True):
            off = np.linalg.norm(places[name].position_mm - T[:3, 3])
            assert off < 2.0 * places[name].U_mm + 0.5, (name, off, places[name].U_mm)


@pytest.mark.parametrize("wrist", [False, True])
def test_the_model_predicts_the_tip_before_every_camera(wrist):
    """Within the stated regions, at new poses, by the names of what stands and what is carried."""
    found = fitted(wrist)
    model = found.fitted.model
    for (camera, board), cell in cells(wrist).items():
        angles = cell.poses(100, seed=77)
        T = cell.T_camera_board(angles, cell.virtual.motions(angles))
        carried, standing, seen = (camera, board, np.linalg.inv(T)) if cell.is_in_hand else (board, camera, T)
        true = (seen @ np.append(found.poses.T_child_tip[carried][:3, 3], 1.0))[:, :3]
        at = ta.Session(angles, session=np.full(100, standing), tip=np.full(100, carried))
        tips, covariance = model.predict(at, return_cov=True)
        squares = np.einsum("ni,nij,nj->n", tips - true, np.linalg.inv(covariance), tips - true)
        # Chi-squared of three, once in a thousand: all poses share the errors of one camera and one size.
        assert np.median(squares) < 16.3


def in_one_image() -> tuple[ta.Session, PixelObservations]:
    """Both boards before the left camera at the same poses, and the images as often."""
    first, second, _ = cells(False).values()
    session, pixels = first.table(EACH, seed=20)
    other = second.project(second.T_camera_board(session.angles, second.virtual.motions(session.angles)))
    noise = 0.2 * np.random.default_rng(3).standard_normal(other.shape)
    corners = table_of(other + noise, second.board)
    parts = [replace(pixels, board=np.full(len(pixels), "A")), replace(corners, board=np.full(len(corners), "B"))]
    return session, PixelObservations.joined(parts)


def test_two_boards_in_one_image_share_the_error_of_the_arm():
    """They tell the camera's place hardly better than one board does: at most by the noise of the pixels."""
    session, pixels = in_one_image()
    alone = fit_images("ur5", session, pixels.rows(pixels.board == "A"), board=BOARDS["A"], model="kinematic")
    both = fit_images("ur5", session, pixels, board=BOARDS, model="kinematic")
    assert both.n_used == alone.n_used == EACH
    assert len(both.fitted.session) == 2 * EACH
    assert both.camera.U_mm > 0.7 * alone.camera.U_mm
    true = cells(False)["left", "B"]
    apart = true.T_flange_mounted[:3, 3] - true.T_flange_mounted[:3, :3] @ true.middle
    assert np.linalg.norm(both.boards[1].position_mm - apart) < 2.0 * both.boards[1].U_mm + 0.5


@pytest.mark.parametrize("wrist", [False, True])
def test_the_result_names_every_camera_and_board(wrist):
    found = fitted(wrist)
    text, said = str(found), found.to_dict()
    assert [one["child"] for one in said["transforms"][:4]] == ["left", "right", "A", "B"]
    assert [one.parent for one in found.cameras] == (["base", "flange"] if wrist else ["base", "base"])
    assert {"fx of left", "k1 of right"} <= said["intrinsics"].keys()
    assert said["board_scale"].keys() == {"A", "B"}
    assert "Camera left in the base is known to" in text
    assert "of camera right scatter by 0.2 px" in text


def without(of: PixelObservations, camera: str, board: str, n: int) -> PixelObservations:
    """Without images of a camera that show a board, but for the first n."""
    own = (of.camera == camera) & (of.board == board)
    kept = np.unique(of.reading[own])[:n]
    return of.rows(~own | np.isin(of.reading, kept))


def renamed(of: PixelObservations, camera: str, board: str, new: str) -> PixelObservations:
    own = (of.camera == camera) & (of.board == board)
    return replace(of, board=np.where(own, new, of.board))


@pytest.mark.parametrize(
    ("change", "options", "said", "hint"),
    [
        (lambda of: of, {"board": BOARDS["A"]}, "board without a name is stated, and the pixels are of A, B", "NAME="),
        (lambda of: of, {"board": {"A": BOARDS["A"]}}, "the pixels are of board 'B' too, which is not stated", "NAME="),
        (lambda of: of, {"camera": {"middle": LENSES["left"]}}, "camera 'middle' is stated, and the pixels", "NAME="),
        (lambda of: of, {"eye_in_hand": ["middle"]}, "camera 'middle' is stated", "--on-flange"),
        (lambda of: of, {"eye_in_hand": ["right"]}, "board B is seen by camera right on the flange and by left", "two"),
        (lambda of: without(of, "right", "B", 3), {}, "4 or more images by camera right that show a board", "more im"),
        (lambda of: renamed(of, "left", "B", "left"), {"board": {"A": BOARDS["A"], "B": BOARDS["B"], "left": BOARDS[
            "B"]}}, "'left' is the name of a camera and of a board", ""),
    ],
    ids=["no name", "board", "camera", "mount", "both mounts", "few", "one name for two"],
)  # fmt: skip
def test_what_contradicts_the_table_is_refused(change, options, said, hint):
    session, pixels = seen(False)
    with pytest.raises(InputError, match=said) as error:
        fit_images("ur5", session, change(pixels), model="kinematic", **{"board": BOARDS, **options})
    assert hint in (error.value.hint or "")


SMALL = BOARDS | {"B": replace(BOARDS["B"], points=0.8 * BOARDS["B"].points)}


@pytest.mark.parametrize(
    ("options", "said", "hint"),
    [
        ({}, "camera right, board B: the positions miss each other by", "--on-flange right; "),
        # Of one camera and board test_fit_images.py has them every day.
        *(
            pytest.param(*one, marks=pytest.mark.weekly)
            for one in (
                ({"eye_in_hand": True}, "camera left, board A: the posi", "--on-flange of the .* only, without left; "),
                ({"eye_in_hand": ["right"], "board": SMALL}, "camera right, board B: the board is 1.2", "meas"),
            )
        ),
    ],
    ids=["stands", "on the flange", "size"],
)
def test_messages_name_the_camera_and_the_board(options, said, hint):
    with pytest.raises(InputError, match=said) as error:
        fit_images("ur5", *seen(True), model="kinematic", **{"board": BOARDS, **options})
    assert re.match(hint, error.value.hint or ""), error.value.hint


def test_a_board_with_the_numbers_of_its_sides_exchanged_is_named():
    """Whatever it is called, and not taken for one that is seen from the front."""
    session, pixels = seen(False)
    turned = charuco(9, 12, 20.4, 15.3)
    said = f"board A: the corners do not lie .* of board {turned.name}, but as those of {BOARDS['A'].name}"
    with pytest.raises(InputError, match=said) as error:
        fit_images("ur5", session, pixels, board={"A": turned, "B": BOARDS["B"]}, model="kinematic")
    assert error.value.hint == f"--board A={BOARDS['A'].name}"


def test_tables_of_one_text_lead_to_names_for_boards():
    session, pixels = seen(False)
    text = replace(pixels, board=np.full(len(pixels), BOARDS["A"].name))
    with pytest.raises(InputError, match="board 'A' is stated") as error:
        fit_images("ur5", session, text, board=BOARDS)
    assert "truearm corners --board NAME=TEXT" in (error.value.hint or "")


def test_a_board_that_a_camera_hardly_sees_is_ignored():
    session, pixels = seen(False)
    found = fit_images("ur5", session, without(pixels, "left", "B", 2), board=BOARDS, model="kinematic")
    assert "Camera left sees board B in 2 images only; ignored." in map(str, found.findings)


def test_the_command_reads_a_table_of_each_camera(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    session, pixels = seen(True)
    session.save("joints.csv")
    for name in LENSES:
        pixels.rows(pixels.camera == name).save(f"{name}.csv")
    boards = [word for name, board in BOARDS.items() for word in ("--board", f"{name}={board.name}")]
    words = ["fit-images", "joints.csv", "left.csv", "right.csv", "--arm", "ur5", *boards, "--on-flange", "right"]
    new, others = seen(True, 60)
    new.save("other.csv")
    others.save("others.csv")
    words += ["--model", "kinematic", "--test-images", "other.csv", "others.csv", "--camera-out", "camera.yaml"]
    done = truearm(*words, "--out", "cell.truearm", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["n_images"] == json.loads(done.out)["test"]["n"] == 2 * EACH
    for name, lens in LENSES.items():
        assert read_camera(f"camera-{name}.yaml").width == lens.width
    words = ["fit-images", "joints.csv", "left.csv", "--arm", "ur5", "--board", "a=x", "--board", "a=y", "--out", "m"]
    refused = truearm(*words)
    assert "expected a name of its own before each of 2" in refused.err


def test_errors_of_poses_are_the_same_in_the_frame_of_another_camera():
    """The normalized squares of any errors, of poses that are brought into the frame of the first camera."""
    found = fitted(False)
    session, rng = found.poses.session(), np.random.default_rng(5)
    frames = found.fitted.model.session_frames_
    turned = to_first_session_frame(session, frames)
    before, after = poses_of(session), poses_of(turned)
    w, e = rng.normal(0, 1e-4, (3, len(before.rows))), rng.normal(0, 0.1, (3, len(before.rows)))
    common = rng.normal(0, 0.1, len(before.unknowns))
    R = np.stack([frames[name][:3, :3] for name in session.session])
    of_after = [np.einsum("nij,jn->in", R, one) for one in (w, e)]
    squares = []
    for poses, (turn, shift) in ((before, (w, e)), (after, of_after)):
        axes = Rotation.from_rotvec(turn.T).as_matrix() @ poses.R_reference_flange
        at = poses.linearised(poses.points.T + shift, common, slice(None), axes.transpose(1, 2, 0))
        squares.append(((at.residuals / poses.std) ** 2).sum(axis=0))
    assert np.allclose(*squares, rtol=1e-6)


def test_derivatives_of_poses_by_coefficients_are_those_of_a_difference_quotient():
    found = fitted(True)
    fit, at = found.fitted.model.fit_, found.fitted.model.at(found.poses.session().rows(np.arange(5)))
    chain, x = fit.perturbed_chain, fit.coefficients
    pose, by = chain.pose_by_coefficients(at.state, x)
    step = 1e-5
    for k in range(len(x)):
        up, down = (chain.poses(at.state, x + sign * step * np.eye(len(x))[k]) for sign in (1, -1))
        moved = (up.tip_in_base - down.tip_in_base) / (2 * step)
        turned = Rotation.from_matrix(up.R_base_tip @ down.R_base_tip.transpose(0, 2, 1)).as_rotvec() / (2 * step)
        size = 1 + np.abs(by[:, :, k]).max()
        assert np.allclose(by[:, :3, k], moved, atol=1e-6 * size)  # mm of some hundred to 1e-13, over the step
        assert np.allclose(by[:, 3:, k], turned, atol=1e-8 * size)
    assert np.allclose(pose.tip_in_base, chain.poses(at.state, x).tip_in_base, atol=1e-9)


@pytest.mark.parametrize("wrist", [False, True])
def test_errors_in_other_images_are_those_of_the_truth(wrist):
    """Of new images without noise, by the poses of the nominal arm and the true ones, through the found cameras."""
    found = fitted(wrist).test
    assert len(found.names) == EACH * len(cells(wrist))
    said = found.to_dict()
    assert 0.05 < said["mean_mm"] < 0.6 * said["hand_eye_alone"]["mean_mm"]
    assert said["mean_deg"] < said["hand_eye_alone"]["mean_deg"]
    # Stated on the safe side, as a few dozen images show little of the arm; of 60 or 90 images three in four at least.
    assert said["coverage"] > 0.75
    assert said["orientation_coverage"] > 0.75
    assert "inside their stated 95 % regions" in str(found)


def test_images_of_the_fit_are_no_test():
    session, pixels = seen(False)
    some = pixels.rows(pixels.reading < 9)
    with pytest.raises(InputError, match=r"the test has 8 images at joints of the fit: A image 1 \(reading 1\)"):
        fit_images("ur5", session, pixels, board=BOARDS, model="kinematic", test=(session, some))
    other = replace(some, board=np.full(len(some), "C"))
    with pytest.raises(InputError, match="board .C. is stated, and the pixels are of A, B"):
        fit_images("ur5", session, pixels, board=BOARDS, model="kinematic", test=(session, other))


@cache
def mounted_anew() -> tuple[ta.Session, PixelObservations]:
    """One board before two cameras, 30 mm along and 20 deg about its normal elsewhere before the second."""
    first = cells(False)["left", "A"]
    turned = Rotation.from_euler("z", 20, degrees=True).as_matrix()
    moved = first.T_flange_mounted @ motion(turned, np.array([30.0, 0.0, 0.0]))
    beside = VirtualCell.around(first.virtual, LENSES["right"], BOARDS["A"], in_hand=False, seed=5).T_world_fixed
    second = replace(first, lens=LENSES["right"], T_flange_mounted=moved, T_world_fixed=beside)
    return joined({("left", "A"): first, ("right", "A"): second})


def test_a_board_that_was_mounted_anew_between_two_cameras_is_two_boards():
    session, pixels = mounted_anew()
    said = "the board sits differently for camera left and for right: the images of each leave 0"
    with pytest.raises(InputError, match=said) as error:
        fit_images("ur5", session, pixels, board=BOARDS["A"], model="kinematic")
    assert f"give the two boards two names ({NAMING})" in (error.value.hint or "")
    found = fit_images("ur5", session, pixels, board=BOARDS["A"], model="kinematic", accept="to see")
    assert str(found.findings[0]).startswith("Accepted (to see): the board sits differently for camera left")
    assert "sits differently" in str(found.fitted.model.accepted_[0])
    two = replace(pixels, board=np.where(pixels.camera == "left", "A", "B"))
    assert (
        fit_images("ur5", session, two, board={"A": BOARDS["A"], "B": BOARDS["A"]}, model="kinematic").n_used
        == 2 * EACH
    )


def test_images_of_another_arm_name_it():
    session, pixels = seen(True)
    with pytest.raises(InputError, match="camera left, board A: the board is") as error:
        fit_images("ur10", session, pixels, board=BOARDS, eye_in_hand=["right"], model="kinematic")
    assert "put this right: the arm is ur5, not ur10 (" in (error.value.hint or "")
