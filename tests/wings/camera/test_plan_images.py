"""Plans of images: the board is in view, the poses tell more than others, and the sheet leads to a fit."""

import csv

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.errors import InputError
from truearm.wings.camera.boards import parse_board
from truearm.wings.camera.plan_images import CORNER_STD_PX, _noise_of_corners
from truearm.wings.camera.virtual_cell import VirtualCell, working_lens
from truearm.wings.planning.virtual import PRESETS, VirtualArm

BOARD = "charuco:8x11,15mm,11mm"


@pytest.fixture(scope="module", params=[False, True], ids=["eye to hand", "eye in hand"])
def planned(request):
    return ta.plan_images("ur5", board=BOARD, poses=12, distance_mm=400, eye_in_hand=request.param, seed=1)


def test_the_board_is_in_view_in_every_pose_and_within_the_limits(planned):
    pixels = planned.cell.project(planned.cell.T_camera_board(planned.angles))
    assert ((~np.isnan(pixels[:, 0])).mean(axis=1) >= 0.7).all()
    limits = planned.cell.virtual.nominal.limits
    assert ((planned.angles >= limits[:, 0]) & (planned.angles <= limits[:, 1])).all()
    assert planned.distance_mm.min() > 180
    assert np.degrees(planned.tilt_rad).max() <= 60
    assert len(np.unique(planned.angles, axis=0)) == 12


def test_at_the_start_the_board_is_upright_in_the_middle_of_the_image_at_its_distance(planned):
    cell = planned.cell
    at_start = cell.T_camera_board(cell.virtual.nominal.working[None])[0]
    np.testing.assert_allclose(at_start[:3, 3], [0, 0, 400], atol=1e-9)  # mm
    np.testing.assert_allclose(at_start[:3, :3], np.eye(3), atol=1e-12)


def test_more_images_and_chosen_ones_know_more():
    few, more = (ta.plan_images("ur5", board=BOARD, poses=n, distance_mm=400, seed=1).after_mm for n in (8, 24))
    assert more < few


def test_the_noise_of_a_board_is_that_which_corners_with_noise_give():
    """Against poses fitted to corners with noise: 300 draws know a standard deviation to 4 %."""
    board = parse_board(BOARD)
    virtual = VirtualArm.draw(ta.load_arm("ur5"), PRESETS["perfect"], seed=0)
    cell = VirtualCell.upright(virtual, working_lens(), board, in_hand=False, distance_mm=400)
    angles = cell.poses(1, seed=3)
    T = cell.T_camera_board(angles)[0]
    corners = board.points - cell.middle

    def pixels(step: np.ndarray) -> np.ndarray:
        turned = Rotation.from_rotvec(step[3:]).as_matrix() @ T[:3, :3]
        return cell.lens.project((corners @ turned.T).T + (T[:3, 3] + step[:3])[:, None]).ravel()

    h = np.array([1e-3] * 3 + [1e-6] * 3)  # mm, rad: central differences to 1e-6
    seen = ~np.isnan(cell.project(T[None])[0].ravel())
    J = np.stack([(pixels(d) - pixels(-d))[seen] / (2 * size) for d, size in zip(np.diag(h), h, strict=True)], axis=1)
    noise = CORNER_STD_PX * np.random.default_rng(0).standard_normal((300, int(seen.sum())))
    off = np.linalg.lstsq(J, noise.T, rcond=None)[0][:3]
    assert _noise_of_corners(cell, angles) == pytest.approx(np.sqrt((off**2).mean()), rel=0.15)


def test_the_sheet_is_a_session_to_fill_in(truearm, tmp_path):
    out = tmp_path / "joints.csv"
    ran = truearm("plan-images", "ur5", "--board", BOARD, "--poses", "6", "--distance", "400", "--out", out).done()
    assert "after 6 images" in ran.out
    rows = list(csv.reader(out.read_text().splitlines()))
    assert rows[0][:6] == [f"q{i}_deg" for i in range(1, 7)]
    assert len(rows) == 7
    assert rows[1][6].startswith("image 1: board ")
    with pytest.raises(InputError):
        ta.read_session(out)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"poses": 3}, "expected 6 to 300 poses"),
        ({"start": [0.0, 1.0]}, "expected 6 finite joints at the start, got 2"),
        ({"start": [0.0, 0, 0, 0, 0, 99.0]}, "beyond their limits"),
        ({"distance_mm": 3.0}, "expected a distance from"),
        ({"board": "charuco:8x11"}, "expected charuco"),
    ],
)
def test_what_does_not_fit_is_refused(options, says):
    with pytest.raises(InputError, match=says):
        ta.plan_images("ur5", **options)
