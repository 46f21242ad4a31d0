"""Points of a shape, checked, about their mean and in units of their spread."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray

# Spreads below this share of the largest count as zero: points on a line, in a plane.
NOTHING = 1e-9


class NormalisedPoints(NamedTuple):
    """Points about their mean, in units of their spread.

    Attributes
    ----------
    points : (n, 3) array
        Their mean is 0, the mean of their squared lengths 1.
    middle : (3,) array
        Where the mean was [mm].
    scale : float
        The unit [mm].
    rounding : float
        What the rounding of the given coordinates is in that unit.
    """

    points: FloatArray
    middle: FloatArray
    scale: float
    rounding: float

    @property
    def nothing(self) -> float:
        """Spreads up to here, in units of the largest, count as none."""
        return max(NOTHING, 16 * self.rounding)


def normalise_points(points: npt.ArrayLike, *, least: int, shape: str) -> NormalisedPoints:
    """Check points (n, 3) [mm], move them to their mean and scale them to unit spread.

    Raises
    ------
    InputError
        If they are not (n, 3) finite numbers, are fewer than `least`, or all in one place.
    """
    given = np.asarray(points, dtype=float)
    if given.ndim != 2 or given.shape[1] != 3:
        raise InputError(f"expected points of a {shape} as an array (n, 3), got shape {given.shape}")
    if not np.isfinite(given).all():
        row = int(np.argmin(np.isfinite(given).all(axis=1)))
        raise InputError(f"expected finite coordinates of a {shape}, got {given[row].tolist()} at point {row + 1}")
    if len(given) < least:
        raise InputError(f"expected {least} points or more for a {shape}, got {len(given)}", hint="measure more points")
    largest = np.abs(given).max()
    unit = float(largest) or 1.0  # neither squares of huge numbers nor of tiny ones
    centred = given / unit
    middle = centred.mean(axis=0)
    centred = centred - middle
    rest = centred.mean(axis=0)  # what the rounding of the mean of far-away points leaves
    centred, middle = centred - rest, unit * (middle + rest)
    spread = float(np.sqrt((centred**2).sum(axis=1).mean()))
    if spread <= 16 * np.finfo(float).eps:
        raise InputError(
            f"expected points all over a {shape}, got {len(given)} in one place", hint="measure points farther apart"
        )
    scale = spread * unit
    return NormalisedPoints(centred / spread, middle, scale, float(np.finfo(float).eps * largest / scale))


def frame_across(normal: NormalisedPoints, where: str) -> tuple[FloatArray, FloatArray]:
    """Return `principal_axes` of points that lie in a plane by and large, such as ``all round a circle``.

    Raises
    ------
    InputError
        If they lie on a line, or spread as far across every plane as along it.
    """
    spreads, axes = principal_axes(normal)
    if spreads[1] - spreads[2] <= normal.nothing * spreads[0]:
        what = "on a line" if spreads[1] <= normal.nothing * spreads[0] else "with equal spreads in two directions"
        raise InputError(
            f"expected points {where}, got points {what}: they determine no plane", hint=f"measure points {where}"
        )
    return spreads, axes


def principal_axes(normal: NormalisedPoints) -> tuple[FloatArray, FloatArray]:
    """Return the spreads (3,) of the points, largest first, and the right-handed frame (3, 3) of their axes."""
    n = len(normal.points)
    three = np.concatenate([normal.points, np.zeros((max(3 - n, 0), 3))])  # rows of zeros change neither
    _, spreads, axes = np.linalg.svd(three, full_matrices=False)
    spreads = spreads / np.sqrt(n)
    frame = axes.T.copy()
    frame[:, 1] *= np.sign(np.linalg.det(frame))
    return spreads, frame
