"""Lengths and shapes fitted to measured points, with the uncertainty that the arm gives them.

The method is that of a task (`task.py`, JCGM 101:2008), at the measured poses: arms are drawn
from the posterior of the model, every point is moved by the errors of such an arm, and the feature is fitted again.
What all points share then cancels out as it does in the measurement: errors of the base do not change a diameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from truearm.errors import InputError
from truearm.solve.linear_algebra import covariance_factor
from truearm.typing import FloatArray, IntArray
from truearm.wings.laboratory.shapes.least_squares_shapes import (
    fit_circle,
    fit_cone,
    fit_cylinder,
    fit_plane,
    fit_sphere,
)
from truearm.wings.laboratory.shapes.orthogonal_regression import ShapeFit
from truearm.wings.laboratory.shapes.relations import (
    Located,
    across_axis,
    between_centres,
    between_planes,
    located,
    turn,
)
from truearm.wings.laboratory.tasks.estimate import expanded_uncertainty
from truearm.wings.laboratory.tasks.features import MIN_POINTS
from truearm.wings.laboratory.tasks.sampled_arms import PosteriorDistribution

_POINT = ("point_x_mm", "point_y_mm", "point_z_mm")
_AXIS = ("axis_x", "axis_y", "axis_z")
_CENTRE = ("centre_x_mm", "centre_y_mm", "centre_z_mm")
_NORMAL = ("normal_x", "normal_y", "normal_z")
QUANTITIES = {
    "length": (),
    "sphere": ("diameter_mm", *_CENTRE),
    "plane": (*_POINT, *_NORMAL),
    "circle": ("diameter_mm", *_CENTRE, *_NORMAL),
    "cylinder": ("diameter_mm", *_POINT, *_AXIS),
    "cone": ("angle_deg", "apex_x_mm", "apex_y_mm", "apex_z_mm", *_AXIS),
}
# Of each two shapes: the distance of centres, axes or planes, and the angle of axes or normals.
RELATIONS = {
    "length": ("length_mm",),
    "sphere": ("length_mm",),
    "plane": ("distance_mm", "angle_deg"),
    "circle": ("length_mm",),
    "cylinder": ("distance_mm", "angle_deg"),
    "cone": ("length_mm", "angle_deg"),
}
_FITS: dict[str, Callable[[FloatArray], ShapeFit]] = {
    "sphere": fit_sphere, "plane": fit_plane, "circle": fit_circle, "cylinder": fit_cylinder, "cone": fit_cone,
}  # fmt: skip
_FREE = {"sphere": 4, "plane": 3, "circle": 6, "cylinder": 5, "cone": 6}
_BETWEEN = {"plane": between_planes, "cylinder": across_axis}


@dataclass(frozen=True)
class MeasuredQuantity:
    """A quantity of a feature with its uncertainty.

    Attributes
    ----------
    name : str
        With its unit; a component of a normal has none.
    value : float
    u : float
        Standard uncertainty, in the same unit; of the scatter as it was estimated.
    expanded : float
        Expanded uncertainty U, which 95 % of the errors do not exceed in size. It knows that few points show their
        scatter only roughly.
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
    kind : MeasuredKind
    name : str
        Of the seat, or of the two ends of a length; empty where the readings have no names.
    n_points : int
    quantities : tuple of MeasuredQuantity
        The first one is what the feature is measured for.
    form_mm : float or None
        Largest minus smallest distance of the points from the shape [mm]; errors of the arm add to it, and form
        between the points is not seen. None of a length.
    """

    kind: str
    name: str
    n_points: int
    quantities: tuple[MeasuredQuantity, ...]
    form_mm: float | None


@dataclass(frozen=True, eq=False)
class _Shape:
    """A fitted shape.

    Attributes
    ----------
    parameters : (p,) array
        Place, direction if there is one, and size if there is one; of a length the end.
    covariance : (p, p) array
        Of them, by the scatter of the points about the shape.
    freedom : int
        Degrees of freedom of that scatter; 0 if the points do not show it.
    form_mm : float or None
    variance : float
        Of that scatter [mm^2]; NaN if the points do not show it.
    """

    parameters: FloatArray
    covariance: FloatArray
    freedom: int
    form_mm: float | None
    variance: float


def measure_features(
    errors: PosteriorDistribution,
    kind: str,
    points: FloatArray,
    angles: FloatArray,
    groups: Mapping[str, IntArray],
    shared: FloatArray,
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
    kind : MeasuredKind
    points : (n, 3) array
        Compensated points in the frame of the model's reference [mm].
    angles : (n, n_joints) array
        Measured joint angles [rad, or mm].
    groups : mapping of str to array of int
        Rows of the points of each feature; of lengths those of each end.
    shared : (k, n, 3) array
        Displacements of the points by k further independent causes of variance one, such as the temperature [mm].
    tip_diameter_mm : float
        Of the stylus tip: a sphere is touched from outside, a circle is a bore.
    n_arms, seed : int
        Number of arms to draw, and the seed.
    progress : callable, optional
        Called with the number of arms done.

    Returns
    -------
    list of MeasuredFeature
        One for each group, and one for each two of them: distance of ends, centres, axes or planes, angle of axes or
        planes.

    Raises
    ------
    InputError
        If a feature has too few points, they do not determine it, or the stylus tip is larger than it or changes no
        feature of that kind.
    """
    _check_groups(kind, groups)
    _check_has_size(kind, tip_diameter_mm)
    rows = list(groups.values())
    shapes = [_fit(kind, points[part]) for part in rows]
    given = [shape.parameters for shape in shapes]
    approach = np.zeros(points.shape)
    for part, at in zip(rows, given, strict=True):
        approach[part] = _approach(kind, points[part], at, points.mean(axis=0)) @ errors.R_base_reference.T
    errors = replace(errors, approach=approach)
    measured = _values(kind, given, given, tip_diameter_mm)
    _check_tip_fits(kind, measured, groups, tip_diameter_mm)
    seeds = np.random.SeedSequence(seed).generate_state(n_arms, np.uint64).tolist()
    drawn = [np.empty((n_arms, len(one))) for one in given]
    variances = np.empty((n_arms, len(shapes)))
    for i, arm_seed in enumerate(seeds):
        moved = _moved_points(points, errors, angles, shared, arm_seed)
        fitted = [_fit(kind, moved[part], like=one) for part, one in zip(rows, given, strict=True)]
        for out, one in zip(drawn, fitted, strict=True):
            out[i] = one.parameters
        variances[i] = [one.variance for one in fitted]
        if progress is not None:
            progress(i + 1, "")
    rest = _unexplained_scatter(np.array([shape.variance for shape in shapes]), variances.mean(axis=0))
    roots = [share * covariance_factor(shape.covariance).T for share, shape in zip(rest, shapes, strict=True)]
    draws, wide = np.empty((n_arms, len(measured))), np.empty((n_arms, len(measured)))
    for i, arm_seed in enumerate(seeds):
        rng = np.random.default_rng([8, arm_seed])
        scatter = [_scatter(root, shape.freedom, rng) for root, shape in zip(roots, shapes, strict=True)]
        for values, which in ((draws, 0), (wide, 1)):
            parameters = [one[i] + off[which] for one, off in zip(drawn, scatter, strict=True)]
            values[i] = _values(kind, parameters, given, tip_diameter_mm)
    return _features(kind, groups, shapes, measured, draws.std(axis=0, ddof=1), wide)


def _has_size(kind: str) -> bool:
    """Whether the first quantity of a feature is a diameter, which a stylus tip changes."""
    return QUANTITIES[kind][:1] == ("diameter_mm",)


def _check_has_size(kind: str, tip_diameter_mm: float) -> None:
    if tip_diameter_mm and not _has_size(kind):
        raise InputError(
            f"a stylus tip changes spheres and bores only; of a {kind} all quantities are those of the tip's centre",
            hint="leave the tip diameter out; distances of two faces of a block are larger by it, of a slot smaller",
        )


def _check_tip_fits(kind: str, measured: FloatArray, groups: Mapping[str, IntArray], tip_diameter_mm: float) -> None:
    """Refuse a tip that is larger than a feature; `measured` are the values of all quantities."""
    if _has_size(kind) and (small := measured[:: len(QUANTITIES[kind])][: len(groups)] <= 0).any():
        name = list(groups)[int(small.argmax())]
        raise InputError(
            f"the stylus tip of {tip_diameter_mm:g} mm is larger than the {kind} {name!r}", hint="its diameter in mm"
        )


def _moved_points(
    points: FloatArray, errors: PosteriorDistribution, angles: FloatArray, shared: FloatArray, arm_seed: int
) -> FloatArray:
    """(n, 3) points as a drawn arm measures them [mm]; see `measure_features`."""
    arm, rng = errors.draw(arm_seed), np.random.default_rng([7, arm_seed])
    off_in_base = arm.systematic(angles) + arm.random(angles, rng)
    moved: FloatArray = points + off_in_base @ errors.R_base_reference
    moved += np.einsum("k,knc->nc", rng.standard_normal(len(shared)), shared)
    return moved


def _approach(kind: str, points: FloatArray, parameters: FloatArray, middle: FloatArray) -> FloatArray:
    """(n, 3) direction in which a tip touches points: along the normal of the shape, of ends away from the middle."""
    if kind == "plane":
        return np.broadcast_to(parameters[3:6], points.shape)
    away = points - (middle if kind == "length" else parameters[:3])
    axis = parameters[3:6] if kind in ("circle", "cylinder", "cone") else np.zeros(3)
    return np.asarray(away - np.outer(away @ axis, axis))


def _unexplained_scatter(seen: FloatArray, with_arms: FloatArray) -> FloatArray:
    """Share of the points' scatter, as standard deviations, that the drawn errors of the arm do not show already.

    Parameters
    ----------
    seen, with_arms : (k,) array
        Variance of the points about each shape, and its mean with the errors of drawn arms added.
    """
    arms = np.maximum(with_arms - seen, 0.0)
    share = np.divide(arms, seen, out=np.ones_like(seen), where=seen > 0)
    return np.asarray(np.sqrt(np.clip(1 - share, 0.0, 1.0)))


def _scatter(root: FloatArray, freedom: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Errors of a shape's parameters by the scatter of its points; and the same as wide as few points know it.

    The scatter was estimated with few degrees of freedom: Student's t in place of a normal distribution (JCGM 101:2008,
    6.4.9).
    """
    off = root @ rng.standard_normal(len(root))
    return off, off * (np.sqrt(freedom / rng.chisquare(freedom)) if freedom else 1.0)


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


def _fit(kind: str, points: FloatArray, like: FloatArray | None = None) -> _Shape:
    """Fit one shape; its direction to the side of that of `like`, as small errors may change its sign."""
    n = len(points)
    if kind == "length":
        middle = points.mean(axis=0)
        freedom = 3 * (n - 1)
        variance = float(((points - middle) ** 2).sum() / freedom) if freedom else np.nan
        return _Shape(middle, np.nan_to_num(variance) / n * np.eye(3), freedom, None, variance)
    fit = _FITS[kind](points)
    at, _ = located(fit)
    size = getattr(fit, "half_angle_rad" if kind == "cone" else "radius_mm", None)
    parameters = np.array([*at.place, *(() if kind == "sphere" else at.direction), *(() if size is None else (size,))])
    form = float(np.ptp(fit.residuals[:, 0])) if kind == "circle" else fit.form_mm
    if like is not None and kind != "sphere" and parameters[3:6] @ like[3:6] < 0:
        parameters[3:6] *= -1
    return _Shape(parameters, fit.covariance, fit.residuals.size - _FREE[kind], form, fit.std_mm**2)


def _values(
    kind: str, shapes: Sequence[FloatArray], measured: Sequence[FloatArray], tip_diameter_mm: float
) -> FloatArray:
    """Values of the quantities of all shapes in the order of `QUANTITIES`, then the `RELATIONS` of each two.

    Angles are those between the sides of `measured` that make them acute.
    """
    larger = {"sphere": -tip_diameter_mm, "circle": tip_diameter_mm, "cylinder": tip_diameter_mm}.get(kind, 0.0)
    values: list[FloatArray] = []
    if kind == "plane":
        values += shapes
    elif kind != "length":
        unit = np.degrees(2.0) if kind == "cone" else 2.0
        values += [np.array([unit * shape[-1] + larger, *shape[:-1]]) for shape in shapes]
    for (a, b), (c, d) in zip(combinations(shapes, 2), combinations(measured, 2), strict=True):
        side = -1.0 if c[3:6] @ d[3:6] < 0 else 1.0
        two = Located(a[:3], a[3:6]), Located(b[:3], side * b[3:6])
        values.append(np.array([np.linalg.norm(_BETWEEN.get(kind, between_centres)(*two))]))
        if "angle_deg" in RELATIONS[kind]:
            values.append(np.degrees([np.linalg.norm(turn(*two))]))
    return np.concatenate(values)


def _features(
    kind: str,
    groups: Mapping[str, IntArray],
    shapes: Sequence[_Shape],
    measured: FloatArray,
    u: FloatArray,
    draws: FloatArray,
) -> list[MeasuredFeature]:
    """The features in the order of `_values`."""
    expanded = expanded_uncertainty((draws - measured).T)
    results = zip(measured.tolist(), u.tolist(), expanded.tolist(), strict=True)
    sizes = {name: len(rows) for name, rows in groups.items()}
    found = []
    for name, shape in zip(groups, shapes, strict=True):
        quantities = tuple(MeasuredQuantity(quantity, *next(results)) for quantity in QUANTITIES[kind])
        if quantities:
            found.append(MeasuredFeature(kind, name, sizes[name], quantities, shape.form_mm))
    for a, b in combinations(groups, 2):
        related = tuple(MeasuredQuantity(quantity, *next(results)) for quantity in RELATIONS[kind])
        called = "length" if len(related) == 1 else f"{kind}s"
        found.append(MeasuredFeature(called, f"{a} to {b}", sizes[a] + sizes[b], related, None))
    return found
