"""Features of a part: their measured points, and the evaluation of the points by least-squares shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.verification.shapes.circle import fit_circle
from truearm.verification.shapes.plane import fit_plane
from truearm.verification.shapes.sphere import fit_sphere

UP = np.array([0.0, 0.0, 1.0])
# A smaller size was probably meant in metres.
MIN_MM = 1.0
MAX_POINTS = 1000
# One more than the parameters of the shape, so that there is a form deviation.
MIN_POINTS = {"length": 2, "sphere": 5, "plane": 4, "circle": 5}
_GOLDEN_RAD = float(np.pi * (3 - np.sqrt(5)))


class FeatureQuantity(NamedTuple):
    """A measured quantity of a feature.

    Attributes
    ----------
    name : str
    nominal_mm : float
        Zero of a deviation of form or direction.
    is_form : bool
        Whether it is a deviation of form or direction, never negative: errors add to it, its tolerance is one-sided.
    """

    name: str
    nominal_mm: float
    is_form: bool = False


@dataclass(frozen=True, eq=False)
class Feature:
    """A feature of a perfect part.

    Attributes
    ----------
    name : str
        Kind and sizes.
    points : (n, 3) array
        Measured points in the arm's base frame [mm].
    approach : (n, 3) array
        Unit vectors from which the stylus approaches.
    quantities : tuple of FeatureQuantity
        A tolerance refers to the first.
    evaluate : callable
        From points (n, 3) [mm] to the value of each quantity [mm].
    """

    name: str
    points: FloatArray
    approach: FloatArray
    quantities: tuple[FeatureQuantity, ...]
    evaluate: Callable[[FloatArray], tuple[float, ...]]

    def errors(self, points: FloatArray) -> FloatArray:
        """Evaluated minus nominal values, (n_quantities,) [mm], of points measured (n, 3) [mm]."""
        return np.array(self.evaluate(points)) - [quantity.nominal_mm for quantity in self.quantities]


def length(ends: npt.ArrayLike, *, points: int = 2) -> Feature:
    """Distance of two places, each the mean of half of the points, measured from above.

    Parameters
    ----------
    ends : (2, 3) array
        [mm]
    points : int
        Number of points, half of them at each end, each in its own posture.
    """
    placed = np.asarray(ends, dtype=float)
    if placed.shape != (2, 3) or not np.isfinite(placed).all():
        raise InputError(f"expected the two ends of a length, (2, 3) in mm, got shape {placed.shape}")
    nominal = _size(float(np.linalg.norm(placed[1] - placed[0])), "distance of the two ends")
    n = _checked(points, "length")
    if n % 2:
        raise InputError(f"expected an even number of points for a length, half of them at each end, got {n}")

    def evaluate(measured: FloatArray) -> tuple[float]:
        return (float(np.linalg.norm(measured[n // 2 :].mean(axis=0) - measured[: n // 2].mean(axis=0))),)

    return Feature(
        f"length of {nominal:g} mm", np.repeat(placed, n // 2, axis=0), np.tile(UP, (n, 1)),
        (FeatureQuantity("length", nominal),), evaluate,
    )  # fmt: skip


def length_at(at: npt.ArrayLike, along: npt.ArrayLike, length_mm: float, *, points: int = 2) -> Feature:
    """A length about its middle `at` (3,) [mm], along a direction (3,)."""
    half = _size(length_mm, "length") / 2 * unit(along)
    middle = _place(at)
    return length([middle - half, middle + half], points=points)


def sphere(at: npt.ArrayLike, diameter_mm: float, *, points: int = 25) -> Feature:
    """Diameter and form of a ball, measured uniformly over its upper half.

    The stylus approaches between the surface normal and straight above, since a ball is not accessible from all sides.
    The form deviation is that of the least-squares sphere: largest minus smallest distance from its centre.
    """
    diameter, n = _size(diameter_mm, "diameter"), _checked(points, "sphere")
    # Uniform over a hemisphere: equally spaced heights, each turned by the golden angle.
    height = 1 - (np.arange(n) + 0.5) / n
    turn = _GOLDEN_RAD * np.arange(n)
    across = np.sqrt(1 - height**2)
    normals = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    approach = normals + UP

    def evaluate(measured: FloatArray) -> tuple[float, float]:
        fitted = fit_sphere(measured)
        return 2 * fitted.radius_mm, fitted.form_mm

    return Feature(
        f"ball of {diameter:g} mm diameter, {n} points",
        _place(at) + diameter / 2 * normals,
        approach / np.linalg.norm(approach, axis=1, keepdims=True),
        (FeatureQuantity("diameter", diameter), FeatureQuantity("form", 0.0, is_form=True)),
        evaluate,
    )


def plane(at: npt.ArrayLike, normal: npt.ArrayLike, size_mm: float, *, points: int = 25) -> Feature:
    """Flatness and direction of a square plate, measured in rows over all of it.

    Flatness is that of the least-squares plane: largest minus smallest distance from it. The direction is relative to
    the arm's frame: the angle between measured and true normal, as a deviation over the size of the plate.
    """
    size, n = _size(size_mm, "size"), _checked(points, "plane")
    across, along, up = _frame(unit(normal))
    rows = np.array_split(np.arange(n), max(2, round(np.sqrt(n))))
    places = [
        (x, y)
        for row, y in zip(rows, np.linspace(-0.5, 0.5, len(rows)), strict=True)
        for x in (np.linspace(-0.5, 0.5, len(row)) if len(row) > 1 else [0.0])
    ]
    flat = size * np.array(places)

    def evaluate(measured: FloatArray) -> tuple[float, float]:
        fitted = fit_plane(measured)
        off = fitted.normal - (fitted.normal @ up) * up
        return fitted.form_mm, size * float(np.arcsin(min(1.0, float(np.linalg.norm(off)))))

    return Feature(
        f"plate of {size:g} x {size:g} mm, {n} points",
        _place(at) + flat @ np.stack([across, along]),
        np.tile(up, (n, 1)),
        (FeatureQuantity("flatness", 0.0, is_form=True), FeatureQuantity("direction", 0.0, is_form=True)),
        evaluate,
    )


def circle(at: npt.ArrayLike, axis: npt.ArrayLike, diameter_mm: float, *, points: int = 25) -> Feature:
    """Diameter and roundness of a bore, measured around at one height with the stylus along its axis."""
    diameter, n = _size(diameter_mm, "diameter"), _checked(points, "circle")
    across, along, up = _frame(unit(axis))
    turn = 2 * np.pi * np.arange(n) / n

    def evaluate(measured: FloatArray) -> tuple[float, float]:
        fitted = fit_circle(measured)
        in_plane = fitted.residuals[:, 0]
        return 2 * fitted.radius_mm, float(np.ptp(in_plane))

    return Feature(
        f"bore of {diameter:g} mm diameter, {n} points",
        _place(at) + diameter / 2 * (np.outer(np.cos(turn), across) + np.outer(np.sin(turn), along)),
        np.tile(up, (n, 1)),
        (FeatureQuantity("diameter", diameter), FeatureQuantity("roundness", 0.0, is_form=True)),
        evaluate,
    )


def unit(direction: npt.ArrayLike) -> FloatArray:
    """A direction (3,) of length one."""
    given = np.asarray(direction, dtype=float)
    size = float(np.linalg.norm(given)) if given.shape == (3,) and np.isfinite(given).all() else 0.0
    if not 0 < size < np.inf:
        raise InputError(f"expected a direction as three numbers, not all zero, got {np.ravel(given).tolist()}")
    return given / size


def _frame(up: FloatArray) -> FloatArray:
    """(3, 3) right-handed unit vectors as rows, the last of them given."""
    across = np.cross(np.eye(3)[np.abs(up).argmin()], up)
    across = across / np.linalg.norm(across)
    return np.stack([across, np.cross(up, across), up])


def _place(at: npt.ArrayLike) -> FloatArray:
    given = np.asarray(at, dtype=float)
    if given.shape != (3,) or not np.isfinite(given).all():
        raise InputError(f"expected a place as three finite coordinates in mm, got {np.ravel(given).tolist()}")
    return given


def _size(size_mm: float, what: str) -> float:
    if not MIN_MM <= size_mm < np.inf:
        raise InputError(
            f"expected a {what} of {MIN_MM:g} mm or more, got {size_mm:g}", hint="state it in mm: half a metre is 500"
        )
    return float(size_mm)


def _checked(points: int, kind: str) -> int:
    if not MIN_POINTS[kind] <= points <= MAX_POINTS:
        raise InputError(f"expected {MIN_POINTS[kind]} to {MAX_POINTS} points of a {kind}, got {points}")
    return points
