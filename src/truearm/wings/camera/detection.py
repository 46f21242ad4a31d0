"""Corners of a board in an image: found by OpenCV, then fitted to the grey values (`corner_fit`).

Corners of one board are a plane's: where a found corner is elsewhere than the others say, it is another one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.wings.camera.boards import Board
from truearm.wings.camera.patterns import opencv, opencv_dictionary

# Half the side of the largest window [px], and the least that a window must hold.
HALF_PX = 9
LEAST_HALF_PX = 2.0
# The blur of the two edges reaches into the window from what is beyond it [px].
REACH_OF_BLUR_PX = 1.5
STEPS = 15
SETTLED_PX = 1e-3
# A corner that moves farther is another one; edges with less contrast are none [px; grey values].
FARTHEST_PX = 2.5
LEAST_CONTRAST = 8.0
BLUR_PX = (0.3, 6.0)


@dataclass(frozen=True, eq=False)
class FittedCorners:
    """Corners of an image.

    Attributes
    ----------
    pixels : (n, 2) array
    u_px : (n,) array
        Standard uncertainty of a coordinate by the noise of the image.
    blur_px : (n,) array
        Standard deviation of the blur of the edges.
    found : (n,) bool array
        Whether the fit found a corner there.
    """

    pixels: FloatArray
    u_px: FloatArray
    blur_px: FloatArray
    found: BoolArray


def fit_corners(
    image: npt.NDArray[np.uint8], start: FloatArray, axes: FloatArray, reach_mm: float, *, is_marker: bool
) -> FittedCorners:
    """Fit the corners of an image.

    Parameters
    ----------
    image : (height, width) array
    start : (n, 2) array
        Where they are to a pixel or two.
    axes : (n, 2, 2) array
        How many pixels u, v the board's x and y axis move by there [px/mm]; the last index is the axis.
    reach_mm : float
        Distance along the axes to what is printed next.
    is_marker : bool
        Whether the corners are those of markers; else four squares meet in each.
    """
    base = np.round(start).astype(int)
    half = int(min(HALF_PX, np.ceil(1 + np.abs(axes).sum(axis=2).max() * reach_mm)))
    steps = np.arange(-half, half + 1)
    dv, du = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
    u, v = base[:, :1] + du, base[:, 1:] + dv
    height, width = image.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    grey = image[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(float)
    inside &= _within(start, axes, reach_mm, u, v)
    x = _start(start, axes, grey, inside, u, v, is_marker=is_marker)
    damping = np.full(len(x), 1e-3)
    residual, J = _model(x, grey, inside, u, v, is_marker=is_marker)
    cost = (residual**2).sum(axis=1)
    for _ in range(STEPS):
        normal = np.einsum("nmi,nmj->nij", J, J)
        size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-12))
        scaled = normal / (size[:, :, None] * size[:, None]) + damping[:, None, None] * np.eye(7)
        step = -np.linalg.solve(scaled, (np.einsum("nmi,nm->ni", J, residual) / size)[:, :, None])[:, :, 0] / size
        trial = x + step
        trial[:, 6] = np.clip(trial[:, 6], *np.log(BLUR_PX))
        new, J_new = _model(trial, grey, inside, u, v, is_marker=is_marker)
        new_cost = (new**2).sum(axis=1)
        better = new_cost <= cost
        x, residual = np.where(better[:, None], trial, x), np.where(better[:, None], new, residual)
        J, cost = np.where(better[:, None, None], J_new, J), np.where(better, new_cost, cost)
        damping = np.where(better, damping / 10, np.minimum(10 * damping, 1e3))
        if (np.abs(step[:, :2]).max(axis=1) < SETTLED_PX).all():
            break
    freedom = np.maximum(inside.sum(axis=1) - 7, 1)
    covariance = np.linalg.inv(np.einsum("nmi,nmj->nij", J, J) + 1e-9 * np.eye(7))[:, :2, :2]
    noise = np.sqrt(cost / freedom)
    u_px = noise * np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2))
    moved = np.linalg.norm(x[:, :2] - start, axis=1)
    found = (moved < FARTHEST_PX) & (np.abs(x[:, 5]) > np.maximum(LEAST_CONTRAST, 3 * noise)) & (u_px < 1.0)
    return FittedCorners(x[:, :2], u_px, np.exp(x[:, 6]), found)


def _within(start: FloatArray, axes: FloatArray, reach_mm: float, u: IntArray, v: IntArray) -> BoolArray:
    """Which pixels (n, m) are nearer to the corner than what is printed next, its blur included."""
    apart = np.stack([u - start[:, :1], v - start[:, 1:]], axis=2)
    on_board = np.einsum("nij,nmj->nmi", np.linalg.inv(axes), apart)  # [mm]
    per_mm = np.linalg.norm(axes, axis=1)[:, None]  # of each axis [px/mm]
    half = np.maximum(reach_mm * per_mm - REACH_OF_BLUR_PX, LEAST_HALF_PX)
    near: BoolArray = (np.abs(on_board) * per_mm <= half).all(axis=2)
    return near


def _start(
    start: FloatArray,
    axes: FloatArray,
    grey: FloatArray,
    inside: BoolArray,
    u: IntArray,
    v: IntArray,
    *,
    is_marker: bool,
) -> FloatArray:
    """Start (n, 7): corner, angles of the normals, mean and contrast, logarithm of the blur."""
    x = np.zeros((len(start), 7))
    x[:, :2] = start
    # The normal of an edge along one axis, towards the other.
    for k, (along, towards) in enumerate(((1, 0), (0, 1))):
        normal = np.stack([-axes[:, 1, along], axes[:, 0, along]], axis=1)
        sign = np.sign((normal * axes[:, :, towards]).sum(axis=1))
        x[:, 2 + k] = np.arctan2(sign * normal[:, 1], sign * normal[:, 0])
    x[:, 5] = 1.0
    shape = _model(x, np.zeros_like(grey), inside, u, v, is_marker=is_marker)[0]
    n = np.maximum(inside.sum(axis=1), 1)
    mean_grey, mean_shape = (np.where(inside, part, 0).sum(axis=1) / n for part in (grey, shape))
    a, b = (np.where(inside, part - mean[:, None], 0) for part, mean in ((grey, mean_grey), (shape, mean_shape)))
    x[:, 5] = (a * b).sum(axis=1) / np.maximum((b * b).sum(axis=1), 1e-9)
    x[:, 4] = mean_grey - x[:, 5] * mean_shape
    return x


def _model(
    x: FloatArray, grey: FloatArray, inside: BoolArray, u: IntArray, v: IntArray, *, is_marker: bool
) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, m) and derivatives (n, m, 7) by `_start`'s parameters; zero outside the windows."""
    from scipy.special import erf

    apart = np.stack([u - x[:, :1], v - x[:, 1:2]], axis=2)
    blur, b = np.exp(x[:, 6]), x[:, 5:6]
    scale, offset = (0.5, 0.5) if is_marker else (1.0, 0.0)
    turns = np.stack([np.stack([np.cos(x[:, k]), np.sin(x[:, k])], axis=1) for k in (2, 3)])  # (2, n, 2) normals
    across = np.stack([-turns[:, :, 1], turns[:, :, 0]], axis=2)
    s, by_angle = (np.einsum("nmi,kni->knm", apart, parts) / blur[:, None] for parts in (turns, across))
    g = offset + scale * erf(s / np.sqrt(2))
    slope = b * scale * np.sqrt(2 / np.pi) * np.exp(-0.5 * s * s) * g[::-1]
    J = np.empty((*grey.shape, 7))
    J[:, :, :2] = -np.einsum("knm,kni->nmi", slope, turns / blur[:, None])
    J[:, :, 2:4] = (slope * by_angle).transpose(1, 2, 0)
    J[:, :, 4], J[:, :, 5] = 1.0, g[0] * g[1]
    J[:, :, 6] = -(slope * s).sum(axis=0)
    residual = x[:, 4:5] + b * g[0] * g[1] - grey
    return np.where(inside, residual, 0.0), np.where(inside[:, :, None], J, 0.0)


Image = npt.NDArray[np.uint8]
# The least that determines a pose and leaves something to judge it by.
LEAST_CORNERS = 6
# Of another board that has the same markers fewer of them fit.
LEAST_SHARE = 0.6
# Chessboards are looked for in an image of at most this many pixels a side first.
SMALL_PX = 700
# A corner farther from where the others say it is, lens distortion included, is another one [share of a square].
ELSEWHERE_SHARE = 0.35
# Structures in the image finer than this blur [px] show that it is sharp; see `blur_of`.
BLURRED_PX = 2.2
# Of dictionaries of one kind the largest has the markers of the others.
DICTIONARIES = (
    *(f"{n}x{n}_1000" for n in (4, 5, 6, 7)),
    *(f"apriltag_{name}" for name in ("16h5", "25h9", "36h10", "36h11")),
)


@dataclass(frozen=True, eq=False)
class Detection:
    """What an image shows of a board.

    Attributes
    ----------
    corners : (n,) int array
        Their numbers, ascending; none if the board was not found.
    pixels : (n, 2) array
    u_px : (n,) array
        Standard uncertainty of a coordinate by the noise of the image.
    problem : str
        Why the board was not found; empty if it was.
    variant : str
        How the board differs from its text, where the image shows another one of the kind; empty without.
    """

    corners: IntArray = field(default_factory=lambda: np.zeros(0, np.intp))
    pixels: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    u_px: FloatArray = field(default_factory=lambda: np.zeros(0))
    problem: str = ""
    variant: str = ""

    def __len__(self) -> int:
        return len(self.corners)


@dataclass(frozen=True, eq=False)
class SeenImage:
    """An image and what was found in it.

    Attributes
    ----------
    reading : int
        Number of the reading, counted from 1.
    name : str
        Of the file.
    detection : Detection
    small : (h, w) array
        The image, reduced by a whole number.
    shrink : int
        That number.
    """

    reading: int
    name: str
    detection: Detection
    small: Image
    shrink: int


class Detector:
    """Finds a board in images.

    Parameters
    ----------
    board : Board

    Raises
    ------
    InputError
        If the board is a list of points, which only other detectors find.
    MissingTool
        If OpenCV is not installed.
    """

    def __init__(self, board: Board) -> None:
        if board.kind == "points":
            raise InputError(
                f"truearm finds no corners of {board.name}: what is printed around its points is not known",
                hint="find them by a program of your own and state them as a table (reading, corner, u_px, v_px)",
            )
        self.board = board
        self._cv2 = opencv()
        self._find: Callable[[Image], tuple[IntArray, FloatArray] | None] = {
            "charuco": self._charuco,
            "chessboard": self._chessboard,
            "aprilgrid": self._aprilgrid,
        }[board.kind]

    def find(self, image: Image) -> Detection:
        """Find the board in an image (height, width) of grey values."""
        found = self._find(image)
        if found is None and (other := self._other_variant(image)) is not None:
            return other
        if found is None:
            return Detection(problem=self._why_not(image))
        fitted = self._fitted(image, *found)
        if len(fitted) >= max(LEAST_CORNERS, LEAST_SHARE * len(found[0])):
            return fitted
        n, blur = len(found[0]), blur_of(image)
        if n >= LEAST_CORNERS:
            return Detection(problem=f"{n} corners, but not where the board has them: it is another board")
        why = f"; {_blurred(blur)}" if blur > BLURRED_PX else ""
        return Detection(
            problem=f"{n} corner{'s' * (n != 1)} of the board only, at least {LEAST_CORNERS} are needed{why}"
        )

    # How each kind is found: numbers and pixels of corners, or None ---------------------------------------------------

    def _charuco(self, image: Image) -> tuple[IntArray, FloatArray] | None:
        pixels, numbers, _, _ = self._charuco_detector.detectBoard(image)
        if numbers is None or not len(numbers):
            return None
        return numbers.ravel().astype(np.intp), pixels.reshape(-1, 2).astype(float)

    def _chessboard(self, image: Image) -> tuple[IntArray, FloatArray] | None:
        board, cv2 = self.board, self._cv2
        shrink = int(np.ceil(max(image.shape) / SMALL_PX))
        for k in dict.fromkeys((shrink, 1)):
            small = image if k == 1 else cv2.resize(image, None, fx=1 / k, fy=1 / k, interpolation=cv2.INTER_AREA)
            found, pixels = cv2.findChessboardCornersSB(small, (board.across, board.down))
            if found:
                break
        else:
            return None
        grid = (pixels.reshape(board.down, board.across, 2).astype(float) + 0.5) * k - 0.5
        right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if right[0] * down[1] - right[1] * down[0] < 0:  # seen from the front x, y turn as those of the image do
            grid = grid[::-1]
        if _is_half_turned(image, grid):
            grid = grid[::-1, ::-1]
        return board.corners, grid.reshape(-1, 2)

    def _aprilgrid(self, image: Image) -> tuple[IntArray, FloatArray] | None:
        for detector in self._tag_detectors:
            tags, numbers, _ = detector.detectMarkers(image)
            if numbers is None:
                continue
            numbers = numbers.ravel()
            known = numbers < self.board.across * self.board.down
            if (~known).sum() > 2:  # a false tag happens; more are those of a larger grid
                return None
            if not known.any():
                continue
            # OpenCV's corners run clockwise from the upper left one, Kalibr's counterclockwise from the lower left one.
            quads = np.array(tags, dtype=float).reshape(-1, 4, 2)[known][:, ::-1]
            corners = 4 * numbers[known].astype(np.intp)[:, None] + np.arange(4)
            if len(quads) < 2:
                return corners.ravel(), quads.reshape(-1, 2)
            # Generators of tags differ by quarter turns of what they print: the grid shows which is right.
            ways = [np.roll(quads, k, axis=1).reshape(-1, 2) for k in range(4)]
            misses = [float(np.median(self._elsewhere(corners.ravel(), way))) for way in ways]
            return corners.ravel(), ways[int(np.argmin(misses))]
        return None

    # What is made of it -----------------------------------------------------------------------------------------------

    def _fitted(self, image: Image, corners: IntArray, pixels: FloatArray) -> Detection:
        """The corners that are where a plane has them, fitted to the grey values."""
        if len(corners) < 4:
            return Detection()
        board = self.board
        good = self._elsewhere(corners, pixels) < ELSEWHERE_SHARE
        corners, pixels = corners[good], pixels[good]
        if len(corners) < 4:
            return Detection()
        axes = _axes_at(self._homography(corners, pixels), board.points_of(corners)[:, :2])
        reach = 0.45 * board.side_mm
        if board.kind == "charuco":
            reach = 0.5 * (board.side_mm - board.marker_mm)
        elif board.kind == "aprilgrid":
            reach = min(board.marker_mm, board.side_mm / (opencv_dictionary(board.dictionary).markerSize + 2))
            k = corners % 4  # the axes of a tag's corner point into the tag
            inwards = np.stack([np.where((k == 0) | (k == 3), 1, -1), np.where(k < 2, 1, -1)], axis=1)
            axes = axes * inwards[:, None, :]
        fitted = fit_corners(image, pixels, axes, reach, is_marker=board.kind == "aprilgrid")
        order = np.argsort(corners)
        order = order[fitted.found[order]]
        return Detection(corners[order], fitted.pixels[order], fitted.u_px[order])

    def _homography(self, corners: IntArray, pixels: FloatArray) -> FloatArray:
        points = self.board.points_of(corners)[:, :2]
        H, _ = self._cv2.findHomography(points, pixels, self._cv2.RANSAC, 3.0)
        return np.eye(3) if H is None else np.asarray(H, dtype=float)

    def _elsewhere(self, corners: IntArray, pixels: FloatArray) -> FloatArray:
        """How far corners are from where the plane of the others has them [share of a square or tag]."""
        H, points = self._homography(corners, pixels), self.board.points_of(corners)[:, :2]
        mapped = np.column_stack([points, np.ones(len(points))]) @ H.T
        with np.errstate(divide="ignore", invalid="ignore"):
            miss = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - pixels, axis=1)
            side = self.board.side_mm * np.sqrt(np.abs(np.linalg.det(_axes_at(H, points))))
            return np.asarray(np.nan_to_num(miss / side, nan=np.inf))

    def _other_variant(self, image: Image) -> Detection | None:
        """The same board by OpenCV's other pattern (before or after 4.6), which people cannot tell by its text."""
        board = self.board
        if board.kind != "charuco" or board.down % 2:
            return None
        other = Detector(replace(board, is_legacy=not board.is_legacy))
        found = other._charuco(image)
        if found is None or len(fitted := other._fitted(image, *found)) < LEAST_CORNERS:
            return None
        of = "before" if not board.is_legacy else "since"
        return replace(fitted, variant=f"its pattern is that of OpenCV {of} 4.6")

    # Why nothing was found --------------------------------------------------------------------------------------------

    def _why_not(self, image: Image) -> str:
        board = self.board
        if board.dictionary:
            seen, n_of_board = self._markers(image, board.dictionary), self._n_markers
            if len(beyond := seen[seen >= n_of_board]):
                return (
                    f"markers {int(seen.min())} to {int(beyond.max())} are in the image, the board has 0 to "
                    f"{n_of_board - 1}: it is a board of another size"
                )
            if len(seen) > 3:
                turned = f"{board.down}x{board.across}"
                return (
                    f"{len(seen)} markers of the board are in the image, but not where the board has them: it may be "
                    f"{turned}, or another board of the dictionary"
                )
            if len(seen):
                return f"{len(seen)} of {n_of_board} markers of the board only: too little of it is in the image"
            if other := self._other_dictionary(image):
                return f"the image has markers of dictionary {other}, the board those of {board.dictionary}"
        blur = blur_of(image)
        if blur > BLURRED_PX:
            return f"no board found; {_blurred(blur)}"
        if float(np.ptp(np.percentile(image, [1, 99]))) < 20:
            return "no board found; the image is too dark or too bright to show one"
        if board.kind == "chessboard":
            return (
                f"no board found: {board.across} x {board.down} inner corners must all be in the image (a board of as "
                f"many squares has {board.across - 1} x {board.down - 1})"
            )
        return "no board found: its markers are too small or not sharp, or not in the image"

    @property
    def _n_markers(self) -> int:
        return self.board.across * self.board.down // (2 if self.board.kind == "charuco" else 1)

    def _markers(self, image: Image, dictionary: str) -> IntArray:
        cv2 = self._cv2
        found = cv2.aruco.ArucoDetector(opencv_dictionary(dictionary), cv2.aruco.DetectorParameters())
        numbers = found.detectMarkers(image)[1]
        return np.zeros(0, np.intp) if numbers is None else numbers.ravel().astype(np.intp)

    def _other_dictionary(self, image: Image) -> str:
        """The dictionary with by far the most markers in the image, if there is one."""
        cells = self.board.dictionary.partition("_")[0]
        others = [name for name in DICTIONARIES if name.partition("_")[0] != cells or "apriltag" in name]
        counts = [len(np.unique(self._markers(image, name))) for name in others]
        best = int(np.argmax(counts))
        return others[best].replace("_1000", " (50 to 1000)") if counts[best] >= 4 else ""

    @cached_property
    def _charuco_detector(self) -> Any:
        board, aruco = self.board, self._cv2.aruco
        dictionary = opencv_dictionary(board.dictionary)
        theirs = aruco.CharucoBoard((board.across, board.down), board.side_mm, board.marker_mm, dictionary)
        theirs.setLegacyPattern(board.is_legacy)
        return aruco.CharucoDetector(theirs)

    @cached_property
    def _tag_detectors(self) -> list[Any]:
        """Detectors of tags with a border of one cell, and of two, as Kalibr prints them."""
        aruco, found = self._cv2.aruco, []
        for border in (1, 2):
            settings = aruco.DetectorParameters()
            settings.markerBorderBits = border
            found.append(aruco.ArucoDetector(opencv_dictionary(self.board.dictionary), settings))
        return found


def blur_of(image: Image) -> float:
    """Standard deviation of the blur [px] of the sharpest edges in an image, as of Gaussian edges.

    At the steepest place of an edge of height h that is blurred by s the slope is ``h / (s sqrt(2 pi))``. Of each of
    the tiles of the image the steepest slope and the range of grey values are taken, and the sharpest tenth of the
    tiles.
    """
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(image.astype(float), 0.7)  # noise has no edges
    dv, du = np.gradient(smooth)
    slope, size = np.hypot(du, dv), 32
    rows, columns = (n // size for n in image.shape)
    if not rows or not columns:
        return 0.0

    def tiles(values: FloatArray) -> FloatArray:
        cut = values[: rows * size, : columns * size].reshape(rows, size, columns, size)
        return cut.transpose(0, 2, 1, 3).reshape(rows * columns, -1)

    heights, steepest = np.ptp(tiles(smooth), axis=1), tiles(slope).max(axis=1)
    edged = heights > max(20.0, 0.3 * float(np.ptp(smooth)))
    if not edged.any():
        return 0.0
    blur = heights[edged] / (np.sqrt(2 * np.pi) * np.maximum(steepest[edged], 1e-9))
    return float(np.sqrt(max(np.percentile(blur, 10) ** 2 - 0.7**2, 0.0)))


def _blurred(blur_px: float) -> str:
    return f"the image is blurred (nothing in it is finer than {blur_px:.1f} px)"


def _is_half_turned(image: Image, grid: FloatArray) -> bool:
    """Whether the square beyond the first corner of a chessboard is white; black is the first one of the pattern.

    Boards with ``has_two_readings`` have black squares at both ends of the diagonal: they are left as they are.
    """
    inner = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    columns, rows = np.clip(np.round(inner), 0, np.array(image.shape)[::-1] - 1).astype(int).transpose(2, 0, 1)
    grey = image[rows, columns].astype(float)
    is_even: BoolArray = np.add.outer(np.arange(grey.shape[0]), np.arange(grey.shape[1])) % 2 == 0
    return bool(grey[is_even].mean() > grey[~is_even].mean())


def _axes_at(H: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 2, 2) derivatives of a homography at points (n, 2): pixels u, v by x, y [px/mm]."""
    mapped = np.column_stack([points, np.ones(len(points))]) @ H.T
    flat = mapped[:, :2] / mapped[:, 2:]
    return np.asarray((H[None, :2, :2] - flat[:, :, None] * H[None, 2:, :2]) / mapped[:, 2, None, None])
