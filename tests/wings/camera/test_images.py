"""Poses and intrinsics by the corners of images: derivatives, the eliminated form against the plain one, truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truearm.errors import InputError
from truearm.wings.camera.boards import aprilgrid, charuco
from truearm.wings.camera.images import Images, adjust, first_poses, guess_lens, linearise
from truearm.wings.camera.lenses import Lens

BROWN = Lens(1280, 1024, 1400.0, 1403.0, 647.0, 507.0, "brown", [-0.12, 0.08, 4e-4, -3e-4, 0.01])
FISHEYE = Lens(1280, 1024, 700.0, 702.0, 640.0, 500.0, "fisheye", [0.05, -0.01, 0.003, 0.0])
BOARD = charuco(12, 9, 20.0, 15.0)
CORNERS = BOARD.points - BOARD.points.mean(axis=0)
STD_PX = 0.2


def poses(n: int, seed: int = 1, tilt: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    turned = Rotation.from_rotvec(rng.uniform(-tilt, tilt, (n, 3)) * [1, 1, 4])
    return turned.as_matrix(), rng.uniform([-90, -60, 450], [90, 60, 800], (n, 3))


def pixels_of(lens: Lens, corners: np.ndarray, R: np.ndarray, t: np.ndarray, scale: float = 1.0) -> np.ndarray:
    points = scale * np.einsum("mij,cj->mic", R, corners) + t[:, :, None]
    return np.stack([lens.project(one) for one in points])


def images(
    n: int = 8,
    lens: Lens = BROWN,
    corners: np.ndarray = CORNERS,
    std_px: float = STD_PX,
    u: float = np.inf,
    u_scale: float = 0.0,
    seed: int = 1,
) -> tuple[Images, np.ndarray, np.ndarray]:
    R, t = poses(n, seed)
    exact = pixels_of(lens, corners, R, t)
    noise = std_px * np.random.default_rng([seed, 5]).standard_normal(exact.shape)
    seen = np.random.default_rng([seed, 6]).uniform(size=(n, 1, len(corners))) < 0.9
    n_lens = len(lens.intrinsics)
    return Images.of_one(corners, np.where(seen, exact + noise, np.nan), lens, np.full(n_lens, u), u_scale), R, t


def of_two_cameras(m: int = 8) -> tuple[Images, Images, Images]:
    """Images of two boards by two cameras, in turns, and those of each camera alone; `m` of each."""
    grid = aprilgrid(4, 4, 40.0, 12.0).points
    boards = CORNERS, grid - grid.mean(axis=0)
    one, other = (
        images(m, lens, corners, std_px=std, seed=seed)[0]
        for lens, corners, std, seed in ((BROWN, boards[0], 0.2, 1), (FISHEYE, boards[1], 0.5, 2))
    )
    pixels = np.full((2 * m, 2, max(map(len, boards))), np.nan)
    pixels[::2, :, : len(boards[0])], pixels[1::2, :, : len(boards[1])] = one.pixels, other.pixels
    which = np.tile([0, 1], m)
    both = Images(
        boards,
        pixels,
        (BROWN, FISHEYE),
        (*one.u_intrinsics, *other.u_intrinsics),
        np.array([0.0, 0.0]),
        which,
        which,
        ("left", "right"),
        ("A", "B"),
    )
    return both, one, other


def test_cameras_that_share_no_board_are_adjusted_as_each_alone():
    both, *alone = of_two_cameras()
    found = adjust(both, *first_poses(both))
    for k, of in enumerate(alone):
        one = adjust(of, *first_poses(of))
        assert np.allclose(found.t[k::2], one.t, atol=1e-5)  # mm; steps end at a ten-thousandth of a standard deviation
        assert found.std_px[k] == pytest.approx(one.std_px[0], rel=1e-6)
        assert np.allclose(found.covariance[k::2], one.covariance, rtol=1e-4)
        own = both.intrinsics[k]
        assert np.allclose(found.unknowns[own], one.unknowns, atol=1e-3)
        assert np.allclose(found.u_unknowns[own], one.u_unknowns, rtol=1e-4)


@pytest.mark.parametrize("of_what", [BROWN, FISHEYE, "two"])
def test_derivatives_are_those_of_a_difference_quotient(of_what):
    if of_what == "two":
        of = replace(of_two_cameras(2)[0], u_scale=np.array([0.002, 0.001]))
        R, t = first_poses(of)
    else:
        of, R, t = images(3, of_what, u_scale=0.002)
    x = np.random.default_rng(2).normal(0, 0.3, len(of.units))
    at = linearise(of, R, t, x)
    step = 1e-5
    for k in range(len(x)):
        one = step * np.eye(len(x))[k]
        up, down = (linearise(of, R, t, x + sign * one).residuals for sign in (1, -1))
        # Pixels per unit, whose second derivatives are some hundred: the quotient is right to 1e-5.
        assert np.allclose(at.by_unknown[:, :, k], (up - down) / (2 * step), rtol=1e-6, atol=2e-5)
    for k in range(6):
        one = step * np.eye(6)[k]
        ends = [
            linearise(of, Rotation.from_rotvec(sign * one[3:]).as_matrix() @ R, t + sign * one[:3], x).residuals
            for sign in (1, -1)
        ]
        assert np.allclose(at.by_pose[:, :, k], (ends[0] - ends[1]) / (2 * step), rtol=1e-6, atol=1e-4)


def test_the_eliminated_equations_are_those_of_all_parameters_at_once():
    of, _R, _t = images(6, u=5.0, u_scale=0.002)
    found = adjust(of, *first_poses(of))
    at = linearise(of, found.R, found.t, found.unknowns)
    m, a = len(of), len(of.units)
    # No residual of this noise exceeds three standard deviations by so much that its weight would matter.
    J = np.zeros((at.residuals.size, 6 * m + a))
    for i in range(m):
        rows = slice(i * at.residuals.shape[1], (i + 1) * at.residuals.shape[1])
        J[rows, 6 * i : 6 * i + 6], J[rows, 6 * m :] = at.by_pose[i], at.by_unknown[i]
    length = np.linalg.norm(at.residuals.reshape(m, 2, -1), axis=1) / np.sqrt(2)
    weights = np.sqrt(np.minimum(1, 3 * found.std_px / np.maximum(length, 1e-9)))
    J *= np.repeat(weights[:, None], 2, axis=1).reshape(-1, 1) / found.std_px
    matrix = J.T @ J
    matrix[6 * m :, 6 * m :] += np.diag(of.precision)
    plain = np.linalg.inv(matrix)
    unknowns = np.linalg.inv(found.root.T @ found.root)
    assert np.allclose(unknowns, plain[6 * m :, 6 * m :], rtol=1e-6)
    of_first = found.covariance[0] + found.by_unknown[0] @ unknowns @ found.by_unknown[0].T
    assert np.allclose(of_first, plain[:6, :6], rtol=1e-6, atol=1e-12)
    assert np.abs(found.offset).max() < 1e-3  # at the minimum, in standard deviations


@pytest.mark.parametrize("lens", [BROWN, FISHEYE])
def test_planted_intrinsics_and_poses_are_found_within_their_uncertainty(lens):
    of, R, t = images(40, lens)
    start = guess_lens(CORNERS, of.pixels, (lens.width, lens.height)) if lens is BROWN else lens
    of = replace(of, lenses=(start,))
    found = adjust(of, *first_poses(of))
    assert found.settled
    off = (lens.intrinsics - of.values(found.unknowns)[0][0].intrinsics) / np.append(
        np.ones(4), np.full(len(of.units) - 4, 1e-3)
    )
    whitened = found.root @ off
    # Chi-squared of 8 or 9 coefficients: 30 is exceeded once in two thousand.
    assert whitened @ whitened < 30
    assert found.std_px == pytest.approx(STD_PX, rel=0.05)
    covariance = found.covariance + found.by_unknown @ np.linalg.inv(
        found.root.T @ found.root
    ) @ found.by_unknown.transpose(0, 2, 1)
    turn = Rotation.from_matrix(found.R @ R.transpose(0, 2, 1)).as_rotvec()
    error = np.concatenate([found.t - t, turn], axis=1)
    squares = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    assert 3.5 < squares.mean() < 9  # six on average; the images share the camera's error


def test_a_board_that_is_tilted_the_other_way_is_not_taken_for_the_right_one():
    of, R, _t = images(60, u=0.0)
    found = first_poses(of)
    turn = Rotation.from_matrix(found[0] @ R.transpose(0, 2, 1)).magnitude()
    assert np.degrees(turn).max() < 1.0


def test_a_board_that_is_not_flat_has_poses_too():
    corners = np.random.default_rng(4).uniform(-80, 80, (40, 3))
    of, _R, t = images(5, corners=corners, u=0.0)
    found = adjust(of, *first_poses(of))
    assert np.abs(found.t - t).max() < 1.0  # mm; a millimetre in 600 is 1.5 px


def test_corners_by_other_detectors_have_any_numbers():
    board = aprilgrid(6, 6, 30.0, 9.0)
    of, _R, t = images(5, corners=board.points - board.points.mean(axis=0), u=0.0)
    assert np.abs(first_poses(of)[1] - t).max() < 1.0


def test_a_gross_corner_moves_its_image_by_little():
    of, _R, _t = images(5, u=0.0)
    right = adjust(of, *first_poses(of))
    pixels = of.pixels.copy()
    row = int(np.flatnonzero(of.seen[0])[3])
    pixels[0, :, row] += [40.0, -25.0]
    wrong = adjust(replace(of, pixels=pixels), *first_poses(replace(of, pixels=pixels)))
    moved = np.abs(wrong.t[0] - right.t[0]) / np.sqrt(np.diag(right.covariance[0])[:3])
    assert moved.max() < 2.0  # standard deviations


def test_stated_intrinsics_are_kept_as_far_as_they_are_known():
    of, _R, _t = images(8, u=0.0)
    assert not len(adjust(of, *first_poses(of)).unknowns)
    off = Lens(1280, 1024, 1428.0, 1431.0, 647.0, 507.0, "brown", BROWN.coefficients)
    held = replace(of, lenses=(off,), u_intrinsics=(np.full(9, 1e-3),))
    assert np.abs(adjust(held, *first_poses(held)).unknowns[:4]).max() < 0.1  # px
    free = replace(of, lenses=(off,), u_intrinsics=(np.full(9, np.inf),))
    assert free.values(adjust(free, *first_poses(free)).unknowns)[0][0].fx == pytest.approx(1400.0, abs=15.0)


def test_images_from_the_front_show_no_focal_length():
    _R, t = poses(6, tilt=1e-6)
    with pytest.raises(InputError, match="focal length"):
        guess_lens(CORNERS, pixels_of(BROWN, CORNERS, np.tile(np.eye(3), (6, 1, 1)), t), (1280, 1024))


def test_an_image_with_three_corners_has_no_pose():
    of, _, _ = images(2)
    pixels = of.pixels.copy()
    pixels[0, :, 3:] = np.nan
    with pytest.raises(InputError, match="4 or more corners"):
        first_poses(replace(of, pixels=pixels))
