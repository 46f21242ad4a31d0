"""Lengths, spheres, planes and circles fitted to measured points, with the uncertainty that the arm gives them.

The method is that of a task (`truearm.verification.tasks.task`, JCGM 101:2008), at the measured poses: arms are drawn
from the posterior of the model, every point is moved by the errors of such an arm, and the feature is fitted again.
What all points share then cancels out as it does in the measurement: errors of the base do not change a diameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray, IntArray
from truearm.verification.shapes.circle import fit_circle
from truearm.verification.shapes.plane import fit_plane
from truearm.verification.shapes.sphere import fit_sphere
from truearm.verification.tasks.estimate import shortest_interval
from truearm.verification.tasks.features import MIN_POINTS
from truearm.verification.tasks.sampled_arms import PosteriorDistribution

_CENTRE = ("centre_x_mm", "centre_y_mm", "centre_z_mm")
_NORMAL = ("normal_x", "normal_y", "normal_z")
_POINT = ("point_x_mm", "point_y_mm", "point_z_mm")


@dataclass(frozen=True)
class MeasuredQuantity:
    """A quantity of a feature with its uncertainty.

    Attributes
    ----------
    name : str
        With its unit; a component of a normal has none.
    value : float
    u : float
        Standard uncertainty, in the same unit.
    expanded : float
        Expanded uncertainty U: the end of the shortest 95 % interval of the errors that is farther from zero.
    """

    name: str
    value: float
    u: float
    expanded: float


@dataclass(frozen=True)
class MeasuredFeature:
    """A feature fitted to measured points.

    Attributes
    ----------
    kind : {"length", "sphere", "plane", "circle"}
    name : str
        Of the seat, or of the two ends of a length; empty where the readings have no names.
    n_points : int
    quantities : tuple of MeasuredQuantity
        The first one is what the feature is measured for.
    form_mm : float or None
        Largest minus smallest distance of the points from the shape [mm]; errors of the arm add to it. None of a
        length.
    """

    kind: str
    name: str
    n_points: int
    quantities: tuple[MeasuredQuantity, ...]
    form_mm: float | None


@dataclass(frozen=True, eq=False)
class _Shape:
    """A fitted shape: values of its quantities, and the scatter of a coordinate about it [mm]; NaN if unknown."""

    names: tuple[str, ...]
    values: FloatArray
    std_mm: float
    form_mm: float | None
    centre: FloatArray | None = None
    normal: FloatArray | None = None


def measure_features(
    errors: PosteriorDistribution,
    kind: str,
    points: FloatArray,
    angles: FloatArray,
    groups: Mapping[str, IntArray],
    *,
    tip_diameter_mm: float = 0.0,
    n_arms: int = 1000,
    seed: int = 0,
    progress: Callable[[int, str], None] | None = None,
) -> list[MeasuredFeature]:
    """Fit features to measured points and propagate the errors that the arm may have.

    Parameters
    ----------
    errors : PosteriorDistribution
        Errors of the arm.
    kind : {"length", "sphere", "plane", "circle"}
    points : (n, 3) array
        Compensated points in the frame of the model's reference [mm].
    angles : (n, n_joints) array
        Measured joint angles [rad, or mm].
    groups : mapping of str to array of int
        Rows of the points of each feature; of lengths those of each end.
    tip_diameter_mm : float
        Of the stylus tip: a sphere is touched from outside, a circle is a bore.
    n_arms, seed : int
        Number of arms to draw, and the seed.
    progress : callable, optional
        Called with the number of arms done.

    Returns
    -------
    list of MeasuredFeature
        One for each group and, of spheres and circles, the distance of each two centres; of lengths one for each two
        ends.

    Raises
    ------
    InputError
        If a feature has too few points, or they do not determine it.
    """
    _check_groups(kind, groups)
    compensation = {"sphere": -tip_diameter_mm, "circle": tip_diameter_mm}.get(kind, 0.0)

    def fit(moved: FloatArray, like: Sequence[_Shape] | None = None) -> list[_Shape]:
        return [
            _fit(kind, moved[rows], compensation, None if like is None else like[i].normal)
            for i, rows in enumerate(groups.values())
        ]

    shapes = fit(points)
    # Scatter about the shape is what repeats in no pose: noise, the hand, form and dirt of the part.
    scatter = np.empty((len(points), 1))
    for shape, rows in zip(shapes, groups.values(), strict=True):
        scatter[rows] = np.nan_to_num(shape.std_mm)
    measured = _values(shapes)
    draws = np.empty((n_arms, len(measured)))
    for i, arm_seed in enumerate(np.random.SeedSequence(seed).generate_state(n_arms, np.uint64).tolist()):
        drawn, rng = errors.draw(arm_seed), np.random.default_rng([7, arm_seed])
        off_in_base = drawn.systematic(angles) + drawn.random(angles, rng)
        moved = points + off_in_base @ errors.R_base_reference + scatter * rng.standard_normal(points.shape)
        draws[i] = _values(fit(moved, shapes))
        if progress is not None:
            progress(i + 1, "")
    return _features(kind, groups, shapes, measured, draws)


def _check_groups(kind: str, groups: Mapping[str, IntArray]) -> None:
    if kind == "length" and len(groups) < 2:
        raise InputError(
            "expected the readings of two ends of a length, got those of one",
            hint="name the ends in the column seat: A in the rows of one end, B in those of the other",
        )
    least = 1 if kind == "length" else MIN_POINTS[kind]
    for name, rows in groups.items():
        if len(rows) < least:
            of = f" {name!r}" if name else ""
            raise InputError(f"expected {least} readings or more of the {kind}{of}, got {len(rows)}")


def _fit(kind: str, points: FloatArray, compensation_mm: float, towards: FloatArray | None) -> _Shape:
    """Fit one shape; its normal to the side of `towards`, as small errors may change the sign that is chosen."""
    if kind == "length":
        middle, n = points.mean(axis=0), len(points)
        std = float(np.sqrt(((points - middle) ** 2).sum() / (3 * (n - 1)))) if n > 1 else np.nan
        return _Shape((), np.empty(0), std, None, middle)
    if kind == "sphere":
        ball = fit_sphere(points)
        values = np.array([2 * ball.radius_mm + compensation_mm, *ball.centre])
        return _Shape(("diameter_mm", *_CENTRE), values, ball.std_mm, ball.form_mm, ball.centre)
    if kind == "plane":
        plate = fit_plane(points)
        normal = _to_the_side_of(towards, plate.normal)
        return _Shape(
            (*_POINT, *_NORMAL), np.array([*plate.point, *normal]), plate.std_mm, plate.form_mm, normal=normal
        )
    bore = fit_circle(points)
    normal = _to_the_side_of(towards, bore.normal)
    values = np.array([2 * bore.radius_mm + compensation_mm, *bore.centre, *normal])
    form = float(np.ptp(bore.residuals[:, 0]))
    return _Shape(("diameter_mm", *_CENTRE, *_NORMAL), values, bore.std_mm, form, bore.centre, normal)


def _to_the_side_of(towards: FloatArray | None, normal: FloatArray) -> FloatArray:
    return -normal if towards is not None and towards @ normal < 0 else normal


def _values(shapes: Sequence[_Shape]) -> FloatArray:
    """Values of all quantities of all shapes, then the distances of each two centres."""
    centres = [shape.centre for shape in shapes if shape.centre is not None]
    distances = [np.linalg.norm(b - a) for a, b in combinations(centres, 2)]
    return np.concatenate([*(shape.values for shape in shapes), np.array(distances)])


def _features(
    kind: str, groups: Mapping[str, IntArray], shapes: Sequence[_Shape], measured: FloatArray, draws: FloatArray
) -> list[MeasuredFeature]:
    """The features in the order of `_values`."""
    low, high = shortest_interval(np.sort((draws - measured).T))
    expanded = np.maximum(np.abs(low), np.abs(high))
    results = zip(measured.tolist(), draws.std(axis=0, ddof=1).tolist(), expanded.tolist(), strict=True)
    sizes = {name: len(rows) for name, rows in groups.items()}
    found = []
    for name, shape in zip(groups, shapes, strict=True):
        quantities = tuple(MeasuredQuantity(quantity, *next(results)) for quantity in shape.names)
        if quantities:
            found.append(MeasuredFeature(kind, name, sizes[name], quantities, shape.form_mm))
    for a, b in combinations(groups, 2) if kind != "plane" else ():
        length = MeasuredQuantity("length_mm", *next(results))
        found.append(MeasuredFeature("length", f"{a} to {b}", sizes[a] + sizes[b], (length,), None))
    return found
