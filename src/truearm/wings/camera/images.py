"""Images of boards by cameras: poses of the boards, the cameras' intrinsics, and how both err together.

The residual of a corner is ``pi(K, R s b + t) - y`` [px], with the corner b about the middle of the board, the scale s
of the board and the pose (R, t) of its middle in the camera. In the Gauss-Newton matrix of all images the poses are
blocks of their own: they are eliminated (Schur complement), so that the cost is linear in the images. What remains of
the common unknowns (intrinsics of every camera, scale of every board) is what the pixels say of them, whatever the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.wings.camera.lenses import Lens

# Corners that determine a pose (6 numbers of 8) and leave something to judge it by.
LEAST_CORNERS = 4
# Residuals of corners beyond this many standard deviations get less weight, as under a density with long tails.
HUBER_STDS = 3.0
# A corner beyond is a gross error [standard deviations of a coordinate]; no detector is better than the least [px].
GROSS_STDS, LEAST_GROSS_PX = 8.0, 0.5
LEAST_STD_PX = 0.005
MOST_STEPS = 40
# The last step changes no pose by more than this share of its uncertainty.
SETTLED = 1e-4
# Intrinsics that nobody stated: distortion beyond this is another lens [1].
WIDE_COEFFICIENT = 1.0
# Units of the unknowns, so that all are of similar size: px, and thousandths.
PER_MILLE = 1e-3
# Standard errors by which one over the square of a focal length is above zero.
CLEAR = 4.0


@dataclass(frozen=True, eq=False)
class Images:
    """Corners of a board in each of m images, and what is stated of boards and cameras.

    Attributes
    ----------
    corners : tuple of (c, 3) array
        Of every board the positions of its corners about its middle [mm].
    pixels : (m, 2, k) array
        NaN where a corner is not seen [px]; k corners of the board with most.
    lenses : tuple of Lens
        Of every camera, as stated, or a first guess.
    u_intrinsics : tuple of (p,) array
        Standard uncertainties of the stated intrinsics; 0 keeps one as it is, infinite ones are not known.
    u_scale : (b,) array
        Relative standard uncertainty of the size of every board.
    camera, board : (m,) int array
        Of every image.
    cameras, boards : tuple of str
        Their names.
    """

    corners: tuple[FloatArray, ...]
    pixels: FloatArray
    lenses: tuple[Lens, ...]
    u_intrinsics: tuple[FloatArray, ...]
    u_scale: FloatArray
    camera: IntArray
    board: IntArray
    cameras: tuple[str, ...] = ("camera",)
    boards: tuple[str, ...] = ("board",)

    @classmethod
    def of_one(
        cls, corners: FloatArray, pixels: FloatArray, lens: Lens, u_intrinsics: FloatArray, u_scale: float
    ) -> Images:
        """Of one board by one camera."""
        one = np.zeros(len(pixels), np.intp)
        return cls((corners,), pixels, (lens,), (u_intrinsics,), np.array([u_scale]), one, one)

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def seen(self) -> BoolArray:
        """(m, k) Whether each corner is seen."""
        return np.asarray(~np.isnan(self.pixels[:, 0]))

    @cached_property
    def corners_of_images(self) -> FloatArray:
        """(m, k, 3) positions of the corners of each image; zero beyond those of its board."""
        out = np.zeros((len(self.corners), self.pixels.shape[2], 3))
        for own, corners in zip(out, self.corners, strict=True):
            own[: len(corners)] = corners
        return np.asarray(out[self.board])

    @cached_property
    def intrinsics(self) -> tuple[slice, ...]:
        """Of every camera the places of its intrinsics among all intrinsics and scales."""
        ends = np.cumsum([0, *map(len, self.u_intrinsics)]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @cached_property
    def free(self) -> BoolArray:
        """(n,) Which intrinsics of all cameras, and last the scales of all boards, are unknown."""
        return np.concatenate([*self.u_intrinsics, self.u_scale]) > 0

    @cached_property
    def units(self) -> FloatArray:
        """(a,) units of the unknowns."""
        of_lenses = [unit for u in self.u_intrinsics for unit in [1.0] * 4 + [PER_MILLE] * (len(u) - 4)]
        return np.array(of_lenses + [PER_MILLE] * len(self.u_scale))[self.free]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, with units."""
        labels = [f"{label} [{'1e-3' if unit == PER_MILLE else 'px'}]" for label, unit in zip(
            np.array(self.labels)[self.free].tolist(), self.units, strict=True)]  # fmt: skip
        return tuple(labels)

    @property
    def labels(self) -> tuple[str, ...]:
        """(n,) names of all intrinsics and scales; with those of camera and board where there are several."""
        several = len(self.cameras) > 1, len(self.boards) > 1
        lenses = [f"{name} of {camera}" if several[0] else name
                  for camera, lens in zip(self.cameras, self.lenses, strict=True) for name in lens.names]  # fmt: skip
        return (*lenses, *(f"size of {board if several[1] else 'the board'}" for board in self.boards))

    @cached_property
    def precision(self) -> FloatArray:
        """(a,) one over the variances of the stated values, in the units of the unknowns."""
        wide = [np.append(np.full(4, np.inf), np.full(len(u) - 4, WIDE_COEFFICIENT)) for u in self.u_intrinsics]
        known = [np.minimum(u, most) for u, most in zip(self.u_intrinsics, wide, strict=True)]
        return np.asarray((self.units / np.concatenate([*known, self.u_scale])[self.free]) ** 2)

    def u_of(self, covariance: FloatArray) -> FloatArray:
        """(n,) standard uncertainties of all intrinsics and scales by the covariance of the unknowns; 0 as stated."""
        u = np.zeros(len(self.free))
        u[self.free] = np.sqrt(np.diag(covariance)) * self.units
        return u

    def rows(self, which: BoolArray | IntArray) -> Images:
        """Some of the images."""
        return replace(self, pixels=self.pixels[which], camera=self.camera[which], board=self.board[which])

    def kept(self) -> Images:
        """The same with intrinsics and sizes as they are stated."""
        return replace(self, u_intrinsics=tuple(map(np.zeros_like, self.u_intrinsics)), u_scale=0.0 * self.u_scale)

    def values(self, unknowns: FloatArray) -> tuple[tuple[Lens, ...], FloatArray]:
        """Cameras and scales of the boards (b,) by the unknowns (a,): changes of what is stated."""
        change = np.zeros(len(self.free))
        change[self.free] = unknowns * self.units
        lenses = zip(self.lenses, self.intrinsics, strict=True)
        return tuple(lens.with_intrinsics(lens.intrinsics + change[own]) for lens, own in lenses), 1.0 + change[
            len(change) - len(self.u_scale) :
        ]


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals of all corners at poses and unknowns, and their derivatives; zero where a corner is not seen.

    Attributes
    ----------
    residuals : (m, k) array
        [px], k of two coordinates a corner.
    by_pose : (m, k, 6) array
        By a displacement of the board's middle [mm] and a rotation about it on the left [rad], in the camera's axes.
    by_unknown : (m, k, a) array
    """

    residuals: FloatArray
    by_pose: FloatArray
    by_unknown: FloatArray


def linearise(images: Images, R: FloatArray, t: FloatArray, unknowns: FloatArray) -> Linearised:
    """Residuals and derivatives at poses (m, 3, 3), (m, 3) and unknowns (a,)."""
    lenses, scales = images.values(unknowns)
    scale = scales[images.board]
    turned = np.einsum("mij,mkj->imk", R, images.corners_of_images)
    points = scale[:, None] * turned + t.T[:, :, None]
    m, c = points.shape[1:]
    pixels, by_point = np.empty((m, 2, c)), np.empty((2, 3, m, c))
    by_unknown = np.zeros((2, len(images.free), m, c))
    for k, (lens, own) in enumerate(zip(lenses, images.intrinsics, strict=True)):
        rows = np.flatnonzero(images.camera == k)
        at, of_point, of_lens = lens.project_with_derivatives(points[:, rows].reshape(3, -1))
        pixels[rows] = at.reshape(2, len(rows), c).transpose(1, 0, 2)
        by_point[:, :, rows] = of_point.reshape(2, 3, len(rows), c)
        by_unknown[:, own, rows] = of_lens.reshape(2, -1, len(rows), c)
    seen = images.seen
    residuals = np.where(seen[:, None], pixels - images.pixels, 0.0)
    by_point = np.where(seen, by_point, 0.0)
    by_turn = scale[:, None] * np.cross(
        turned, by_point, axisa=0, axisb=1, axisc=1
    )  # w . (x cross g) = g . (w cross x)
    by_unknown[:, len(images.free) - len(scales) + images.board, np.arange(m)] = (by_point * turned).sum(axis=1)
    by_pose = np.concatenate([by_point, by_turn], axis=1)
    by_unknown = np.where(seen, by_unknown, 0.0)[:, images.free] * images.units[:, None, None]
    return Linearised(
        residuals.reshape(m, -1),
        by_pose.transpose(2, 0, 3, 1).reshape(m, 2 * c, 6),
        by_unknown.transpose(2, 0, 3, 1).reshape(m, 2 * c, len(images.units)),
    )


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Poses and unknowns of least squares, by the pixels and what is stated, and what the pixels say of them.

    Attributes
    ----------
    R, t : (m, 3, 3), (m, 3) array
        Pose of the board's middle in the camera [mm].
    unknowns : (a,) array
    residuals : (m, 2, c) array
        [px]; NaN where a corner is not seen.
    std_px : (k,) array
        Standard deviation of a coordinate of a corner in the images of every camera.
    covariance : (m, 6, 6) array
        Of the poses, at given unknowns.
    by_unknown : (m, 6, a) array
        By how much the poses of least squares move with the unknowns.
    root, offset : (b, a), (b,) array
        ``root @ (change of the unknowns) + offset`` has mean zero and unit covariance by pixels and stated values.
    settled : bool
    """

    R: FloatArray
    t: FloatArray
    unknowns: FloatArray
    residuals: FloatArray
    std_px: FloatArray
    covariance: FloatArray
    by_unknown: FloatArray
    root: FloatArray
    offset: FloatArray
    settled: bool

    @property
    def rms_px(self) -> FloatArray:
        """(m,) root mean square residual of a coordinate of each image."""
        return np.asarray(np.sqrt(np.nanmean(self.residuals**2, axis=(1, 2))))

    @property
    def u_unknowns(self) -> FloatArray:
        """(a,) standard uncertainties of the unknowns by the pixels and what is stated."""
        return np.asarray(np.linalg.norm(np.linalg.pinv(self.root), axis=1))


def adjust(
    images: Images, R: FloatArray, t: FloatArray, unknowns: FloatArray | None = None, *, keep: bool = False
) -> Adjustment:
    """Adjust poses and unknowns to the pixels, from poses near the right ones.

    Parameters
    ----------
    images : Images
    R, t : (m, 3, 3), (m, 3) array
        Start of the poses.
    unknowns : (a,) array, optional
        Start of the unknowns; as stated by default.
    keep : bool
        Whether the unknowns stay where they are, and only the poses are adjusted.
    """
    x = np.zeros(len(images.units)) if unknowns is None else unknowns
    is_settled, damping, before = False, 0.0, np.inf
    last = R, t, x
    for _ in range(MOST_STEPS):
        linear = linearise(images, R, t, x)
        _, weights = _weights(images, linear.residuals)
        cost = float((weights * linear.residuals**2).sum()) + float(images.precision @ x**2)
        if not np.isfinite(cost) or (cost > 1.5 * before and damping < 1e6):  # too far: back, and a shorter step
            damping = max(100 * damping, 1e-3)
            R, t, x = last
            before = np.inf
            continue
        sums = _Sums.of(linear, weights)
        step, of_poses = sums.step(images.precision, x, damping, keep=keep)
        last, before, damping = (R, t, x), cost, damping / 10 if damping > 1e-8 else 0.0
        x = x + step
        R = Rotation.from_rotvec(of_poses[:, 3:]).as_matrix() @ R
        t = t + of_poses[:, :3]
        if damping == 0 and np.einsum("mi,mij,mj->m", of_poses, sums.poses, of_poses).max() < SETTLED**2 * 6:
            is_settled = True
            break
    linear = linearise(images, R, t, x)
    std, weights = _weights(images, linear.residuals)
    sums = _Sums.of(linear, weights)
    covariance = np.asarray(np.linalg.inv(sums.poses))
    by_unknown = -covariance @ sums.coupling
    matrix = sums.unknowns + np.einsum("mia,mib->ab", sums.coupling, by_unknown) + np.diag(images.precision)
    gradient = sums.gradient + np.einsum("mia,mi->a", by_unknown, sums.of_poses) + images.precision * x
    values, vectors = np.linalg.eigh(matrix) if len(x) else (np.zeros(0), np.zeros((0, 0)))
    told = values > 1e-12 * values.max(initial=0.0)
    root = (np.sqrt(np.maximum(values, 0.0)) * vectors)[:, told].T
    offset = (vectors.T @ gradient)[told] / np.sqrt(values[told])
    residuals = np.where(images.seen[:, None], linear.residuals.reshape(images.pixels.shape), np.nan)
    return Adjustment(R, t, x, residuals, std, covariance, by_unknown, root, offset, is_settled)


def _weights(images: Images, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Standard deviation of a coordinate of each camera (k,), and weights of the residuals (m, 2 c) [1/px^2]."""
    stds, weights = np.full(len(images.cameras), LEAST_STD_PX), np.zeros(residuals.shape)
    seen = np.repeat(images.seen[:, None], 2, axis=1).reshape(residuals.shape)
    for k, own in enumerate(images.intrinsics):
        rows = images.camera == k
        if rows.any():
            n_scales = int((images.u_scale[np.unique(images.board[rows])] > 0).sum())
            n_unknowns = int(images.free[own].sum()) + n_scales
            stds[k], factor = _robust(residuals[rows], seen[rows], n_unknowns)
            weights[rows] = factor / stds[k] ** 2
    return stds, weights


def _robust(residuals: FloatArray, seen: BoolArray, n_unknowns: int) -> tuple[float, FloatArray]:
    """Standard deviation of a coordinate, and Huber's weights of the corners (m, k)."""
    freedom = max(int(seen.sum()) - 6 * len(residuals) - n_unknowns, 1)
    spent = np.sqrt(seen.sum() / freedom)
    std = max(1.4826 * float(np.median(np.abs(residuals[seen]))) * spent, LEAST_STD_PX)
    m, k = residuals.shape
    length = np.linalg.norm(residuals.reshape(m, 2, -1), axis=1) / np.sqrt(2)
    cut = HUBER_STDS * std
    weights = np.repeat((cut / np.maximum(length, cut))[:, None], 2, axis=1).reshape(m, k)
    # Among corners that are no gross errors the mean square is the sharper estimate.
    good = seen & (weights == 1)
    squares = float((residuals[good] ** 2).sum())
    sharp = np.sqrt(squares / max(int(good.sum()) * freedom / seen.sum(), 1.0))
    return max(float(sharp), LEAST_STD_PX), weights * seen


@dataclass(frozen=True, eq=False)
class _Sums:
    """Normal equations of all images: blocks of the poses, the unknowns, and their coupling."""

    poses: FloatArray
    coupling: FloatArray
    unknowns: FloatArray
    of_poses: FloatArray
    gradient: FloatArray

    @classmethod
    def of(cls, linear: Linearised, weights: FloatArray) -> _Sums:
        weighted = linear.by_pose.transpose(0, 2, 1) * weights[:, None]
        by, r = linear.by_unknown, linear.residuals
        flat = by.reshape(by.shape[0] * by.shape[1], by.shape[2])
        return cls(
            weighted @ linear.by_pose,
            weighted @ by,
            (flat * weights.reshape(-1, 1)).T @ flat,
            (weighted @ r[:, :, None])[:, :, 0],
            flat.T @ (weights * r).ravel(),
        )

    def step(
        self, precision: FloatArray, x: FloatArray, damping: float, *, keep: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Steps of the unknowns (a,) and of the poses (m, 6)."""
        blocks = self.poses * (1 + damping * np.eye(6))
        inverse = np.linalg.inv(blocks)
        step = np.zeros(len(x))
        if len(x) and not keep:
            along = inverse @ self.coupling
            matrix = self.unknowns * (1 + damping * np.eye(len(x))) + np.diag(precision)
            matrix -= np.einsum("mia,mib->ab", self.coupling, along)
            right = self.gradient + precision * x - np.einsum("mia,mi->a", along, self.of_poses)
            size = np.sqrt(np.maximum(matrix.diagonal(), np.finfo(float).tiny))
            step = -np.linalg.lstsq(matrix / np.outer(size, size), right / size, rcond=1e-12)[0] / size
        return step, -(inverse @ (self.of_poses + self.coupling @ step)[:, :, None])[:, :, 0]


def first_poses(images: Images) -> tuple[FloatArray, FloatArray]:
    """Poses of the board from each image alone: (m, 3, 3), (m, 3) [mm].

    Of a flat board by a homography (Z. Zhang, IEEE PAMI 22 (2000) 1330). A flat board that is tilted the other way
    looks much alike (D. Oberkampf, D. F. DeMenthon, L. S. Davis, CVIU 63 (1996) 495): both poses are adjusted to the
    pixels, and the nearer one is taken.

    Raises
    ------
    InputError
        If an image has fewer than four corners, or the corners are on a line.
    """
    R, t = np.empty((len(images), 3, 3)), np.empty((len(images), 3))
    for i, (pixels, seen, corners) in enumerate(zip(images.pixels, images.seen, images.corners_of_images, strict=True)):
        if seen.sum() < LEAST_CORNERS:
            raise InputError(f"expected {LEAST_CORNERS} or more corners in an image, got {int(seen.sum())}")
        lens = images.lenses[images.camera[i]]
        seen = seen & np.isfinite(lens.normalized(np.nan_to_num(pixels))).all(axis=0)
        R[i], t[i] = _first_pose(corners[seen], lens.normalized(pixels[:, seen]))
    fixed = images.kept()
    found = [adjust(fixed, R, t)]
    # The other tilt: the normal of the board mirrored about the line of sight.
    sight = t / np.linalg.norm(t, axis=1, keepdims=True)
    normal = found[0].R[:, :, 2]
    axis = np.cross(normal, sight)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = 2 * np.arctan2(sine, np.abs((normal * sight).sum(axis=1, keepdims=True)))
    towards = np.sign((normal * sight).sum(axis=1, keepdims=True))
    turn = Rotation.from_rotvec(towards * angle * axis / np.maximum(sine, 1e-12)).as_matrix()
    found.append(adjust(fixed, turn @ found[0].R, found[0].t))
    rms = np.stack([one.rms_px for one in found])
    other = rms[1] < rms[0]
    return np.where(other[:, None, None], found[1].R, found[0].R), np.where(other[:, None], found[1].t, found[0].t)


def _first_pose(corners: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pose from corners (n, 3) and their directions (2, n), the board's plane being that of its two largest axes."""
    middle = corners.mean(axis=0)
    _, spread, axes = np.linalg.svd(corners - middle, full_matrices=True)
    if len(spread) < 2 or spread[1] < 1e-3 * spread[0]:
        raise InputError("the corners that an image shows are on a line")
    axes = axes * np.sign(np.linalg.det(axes))
    flat = (corners - middle) @ axes.T
    if abs(spread[2]) < 1e-2 * spread[0] or len(corners) < 6:
        H = _projection(flat[:, :2], directions.T)
        H = H / np.sqrt(np.linalg.norm(H[:, 0]) * np.linalg.norm(H[:, 1])) * (np.sign(H[2, 2]) or 1.0)
        columns = np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])])
        translation = H[:, 2]
    else:
        P = _projection(flat, directions.T)
        P = P / np.cbrt(np.linalg.det(P[:, :3]))
        columns, translation = P[:, :3], P[:, 3]
    u, _, v = np.linalg.svd(columns)
    R = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v @ axes
    return R, translation - R @ middle


def _projection(points: FloatArray, seen: FloatArray) -> FloatArray:
    """(3, k + 1) homography of a plane (n, 2), or projection from space (n, 3), to an image (n, 2).

    By the least singular value of scaled equations.
    """
    (A, of_a), (B, of_b) = map(_scaled, (points, seen))
    zero = np.zeros_like(A)
    rows = [np.hstack([A, zero, -B[:, :1] * A]), np.hstack([zero, A, -B[:, 1:2] * A])]
    found = np.linalg.svd(np.concatenate(rows))[2][-1].reshape(3, -1)
    return np.asarray(np.linalg.inv(of_b) @ found @ of_a)


def _scaled(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Homogeneous coordinates (n, k + 1) about their mean, of unit size, and the matrix that makes them."""
    k, centre = points.shape[1], points.mean(axis=0)
    size = np.sqrt(((points - centre) ** 2).sum(axis=1).mean() / k) or 1.0
    T = np.eye(k + 1)
    T[:k, :k] /= size
    T[:k, k] = -centre / size
    return np.column_stack([points, np.ones(len(points))]) @ T.T, T


def homography_misfit(corners: FloatArray, pixels: FloatArray) -> float:
    """How far corners (c, 3) of a flat board are from their best homography to pixels (m, 2, k), over their spread.

    The median of the images with twice as many corners as a homography needs; 0 without one.
    """
    found = []
    for image in pixels[:, :, : len(corners)]:
        shown = ~np.isnan(image[0])
        if shown.sum() < 2 * LEAST_CORNERS:
            continue
        at = corners[shown, :2]
        A, off = np.column_stack([at, np.ones(len(at))]) @ _projection(at, image[:, shown].T).T, image[:, shown].T
        left = A[:, :2] / A[:, 2:] - off
        found.append(float(np.sqrt((left**2).sum() / ((off - off.mean(axis=0)) ** 2).sum())))
    return float(np.median(found)) if found else 0.0


def guess_lens(corners: FloatArray, pixels: FloatArray, size_px: Sequence[int]) -> Lens:
    """A lens without distortion whose centre is that of the image, by homographies of flat boards.

    The corners are those of all images (c, 3), or of each (m, c, 3).

    Each homography h of a plane has ``h1^T W h2 = 0`` and ``h1^T W h1 = h2^T W h2`` with ``W = K^-T K^-1`` (Zhang 2000,
    eqs. 3 and 4): linear in one over the squares of the focal lengths.

    Raises
    ------
    InputError
        If the images do not show a focal length: they all see the board from the front.
    """
    width, height = size_px
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    left, right = [], []
    for image, own in zip(pixels, np.broadcast_to(corners, (len(pixels), *corners.shape[-2:])), strict=True):
        seen = ~np.isnan(image[0])
        H = _projection(own[seen, :2], image[:, seen].T - centre)
        a, b = H[:, 0] / np.linalg.norm(H[:, 0]), H[:, 1] / np.linalg.norm(H[:, 0])
        left += [[a[0] * b[0], a[1] * b[1]], [a[0] ** 2 - b[0] ** 2, a[1] ** 2 - b[1] ** 2]]
        right += [-a[2] * b[2], b[2] ** 2 - a[2] ** 2]
    A, y = np.array(left), np.array(right)
    one = A.sum(axis=1)
    alike = float(one @ y / (one @ one))
    left_over = y - alike * one
    if alike <= CLEAR * np.sqrt(left_over @ left_over / max(len(y) - 1, 1) / (one @ one)):
        raise InputError(
            "the images do not show the focal length of the camera: they see the board from the front",
            hint="state the intrinsics, or take images in which the board is tilted by 20 to 40 deg",
        )
    found = np.linalg.lstsq(A, y, rcond=None)[0]
    if not ((found > 0.5 * alike) & (found < 2 * alike)).all():  # of both alone they are not well determined
        found = np.full(2, alike)
    fx, fy = (1 / np.sqrt(found)).tolist()
    return Lens(width, height, fx, fy, *centre.tolist())
