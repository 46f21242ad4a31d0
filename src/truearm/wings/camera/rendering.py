"""Images of a printed board through a camera: for virtual cells and for tests of the detection.

Each pixel is the mean of the pattern at 4 x 4 places, found by the inverse of the camera model; the pattern is exact to
its edges. Where the outermost of these places are in one cell between its edges, so are all. Then the image is blurred
as by a lens, and has the noise of a sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray, IntArray
from truearm.wings.camera.lenses import Lens
from truearm.wings.camera.patterns import Pattern

# Places along each side of a pixel, at which the pattern is looked up.
ALONG = 4
# Grey values of ink, paper and what is behind the board.
INK, PAPER, BEHIND = 30.0, 215.0, 120.0
# White paper around the pattern [mm].
MARGIN_MM = 10.0
# Of a usual industrial camera: standard deviations of blur [px] and noise [grey values].
BLUR_PX, NOISE = 0.7, 2.0
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Renderer:
    """Images of a pattern through a camera.

    Attributes
    ----------
    pattern : Pattern
    lens : Lens
    blur_px : float
        Standard deviation of the blur [px].
    noise : float
        Standard deviation of the noise [grey values].
    """

    pattern: Pattern
    lens: Lens
    blur_px: float = BLUR_PX
    noise: float = NOISE

    def image(self, T_camera_board: FloatArray, *, seed: int, scale: float = 1.0) -> Image:
        """The image (height, width) of the board at a pose (4, 4) in the camera [mm].

        Parameters
        ----------
        T_camera_board : (4, 4) array
            Of the board's own frame.
        seed : int
            Of the noise.
        scale : float
            True size of the board over the stated one.
        """
        from scipy.ndimage import gaussian_filter

        exact = np.full((self.lens.height, self.lens.width), BEHIND)
        T = T_camera_board
        back = np.linalg.inv(np.column_stack([scale * T[:3, 0], scale * T[:3, 1], T[:3, 3]]))
        rows, columns = self._box(T, scale)
        directions, by_u, by_v = (part[:, rows, columns] for part in self._directions)
        if directions.size:
            offsets, greys = (np.arange(ALONG) + 0.5) / ALONG - 0.5, self._cells[2]
            first, *others = (
                self._cell(back, directions + du * by_u + dv * by_v)
                for du in offsets[[0, -1]]
                for dv in offsets[[0, -1]]
            )
            mean = greys[first]
            mixed = np.logical_or.reduce([one != first for one in others])
            directions, by_u, by_v = directions[:, mixed], by_u[:, mixed], by_v[:, mixed]
            places = (directions + du * by_u + dv * by_v for du in offsets for dv in offsets)
            mean[mixed] = sum(greys[self._cell(back, place)] for place in places) / ALONG**2
            exact[rows, columns] = mean
        blurred = gaussian_filter(exact, self.blur_px, mode="nearest") if self.blur_px > 0 else exact
        noise = self.noise * np.random.default_rng([seed, *b"image"]).standard_normal(exact.shape)
        return np.clip(np.round(blurred + noise), 0, 255).astype(np.uint8)

    @cached_property
    def _cells(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Edges of the paper and its pattern along x and y [mm], and the grey values of the cells, in one row."""
        x, y = (
            np.concatenate([[-MARGIN_MM], edges, [size + MARGIN_MM]])
            for edges, size in zip(self.pattern.edges, self.pattern.size_mm, strict=True)
        )
        greys = np.full((len(y) + 1, len(x) + 1), BEHIND)
        middles = np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2)
        greys[1:-1, 1:-1] = np.where(self.pattern.is_black(*middles), INK, PAPER)
        return x, y, greys.ravel()

    def _cell(self, back: FloatArray, directions: FloatArray) -> IntArray:
        """Cells of the sheet in directions (2, ..), -1 where no board is; `back` maps (x, y, 1) to its plane."""
        u, v, w = (row[0] * directions[0] + row[1] * directions[1] + row[2] for row in back)
        with np.errstate(divide="ignore", invalid="ignore"):
            on_board = np.stack([u / w, v / w])
        sx, sy = self.pattern.on_sheet(on_board.reshape(2, -1)).reshape(on_board.shape)
        x, y, _ = self._cells
        found = np.searchsorted(y, sy) * (len(x) + 1) + np.searchsorted(x, sx)
        return np.where(w > 0, found, -1)  # the last cell is no paper either

    def _box(self, T: FloatArray, scale: float) -> tuple[slice, slice]:
        """Rows and columns of the image that may show the sheet: all of them if a part of it is behind the camera."""
        lens, (width, height) = self.lens, self.pattern.size_mm
        low, high = -MARGIN_MM, np.array([width, height]) + MARGIN_MM
        share = np.linspace(0, 1, 30)
        sides = [np.stack([low + share * (high[0] - low), np.full(30, y)]) for y in (low, high[1])]
        sides += [np.stack([np.full(30, x), low + share * (high[1] - low)]) for x in (low, high[0])]
        sheet = np.concatenate(sides, axis=1) - self.pattern.origin_mm[:, None]
        sheet[1] *= -1 if self.pattern.y_is_up else 1
        points = T[:3, :2] @ (scale * sheet) + T[:3, 3:4]
        pixels = lens.project(points)
        if np.isnan(pixels).any():
            return slice(0, lens.height), slice(0, lens.width)
        first, last = np.floor(pixels.min(axis=1)) - 10, np.ceil(pixels.max(axis=1)) + 11
        (left, top), (right, bottom) = (
            np.clip(e, 0, [lens.width, lens.height]).astype(int).tolist() for e in (first, last)
        )
        return slice(top, bottom), slice(left, right)

    @cached_property
    def _directions(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Directions (2, height, width) of the pixels, and what they change by from a pixel to the next."""
        v, u = np.mgrid[: self.lens.height, : self.lens.width].astype(float)
        found = self.lens.normalized(np.stack([u.ravel(), v.ravel()])).reshape(2, *u.shape)
        by_v, by_u = (np.asarray(np.gradient(found, axis=axis)) for axis in (1, 2))
        return found, by_u, by_v
