"""Images of a printed board through a camera: for virtual cells and for tests of the detection.

Each pixel is the mean of the pattern at 4 x 4 places, found by the inverse of the camera model; the pattern is exact to
its edges. Then the image is blurred as by a lens, and has the noise of a sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray
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
            offsets = (np.arange(ALONG) + 0.5) / ALONG - 0.5
            total = np.zeros(directions.shape[1:])
            for du in offsets:
                for dv in offsets:
                    total += self._grey(back, directions + du * by_u + dv * by_v)
            exact[rows, columns] = total / ALONG**2
        blurred = gaussian_filter(exact, self.blur_px, mode="nearest") if self.blur_px > 0 else exact
        noise = self.noise * np.random.default_rng([seed, *b"image"]).standard_normal(exact.shape)
        return np.clip(np.round(blurred + noise), 0, 255).astype(np.uint8)

    def _grey(self, back: FloatArray, directions: FloatArray) -> FloatArray:
        """Grey values of the sheet in directions (2, h, w); `back` maps (x, y, 1) to the board's plane."""
        x, y, w = (row[0] * directions[0] + row[1] * directions[1] + row[2] for row in back)
        with np.errstate(divide="ignore", invalid="ignore"):
            on_board = np.stack([x / w, y / w])
        on_board[:, ~(w > 0)] = np.nan  # NaN: the direction shows no board, or is none
        sx, sy = self.pattern.on_sheet(on_board.reshape(2, -1)).reshape(on_board.shape)
        width, height = self.pattern.size_mm
        on_paper = (np.abs(sx - width / 2) < width / 2 + MARGIN_MM) & (np.abs(sy - height / 2) < height / 2 + MARGIN_MM)
        return np.where(on_paper, np.where(self.pattern.is_black(sx, sy), INK, PAPER), BEHIND)

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
