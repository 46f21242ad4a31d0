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
from truearm.solve.square_roots import covariance_factor
from truearm.typing import FloatArray, IntArray
from truearm.verification.shapes.circle import fit_circle
from truearm.verification.shapes.plane import fit_plane
from truearm.verification.shapes.sphere import fit_sphere
from truearm.verification.tasks.estimate import shortest_interval
from truearm.verification.tasks.features import MIN_POINTS
from truearm.verification.tasks.sampled_arms import PosteriorDistribution

_CENTRE = ("centre_x_mm", "centre_y_mm", "centre_z_mm")
_NORMAL = ("normal_x", "normal_y", "normal_z")
QUANTITIES = {
    "length": (),
    "sphere": ("diameter_mm", *_CENTRE),
    "plane": ("point_x_mm", "point_y_mm", "point_z_mm", *_NORMAL),
    "circle": ("diameter_mm", *_CENTRE, *_NORMAL),
}


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
        Expanded uncertainty U: the end of the shortest 95 % interval of the errors that is farther from zero. It knows
        that few points show their scatter only roughly.
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
        Of a length the end, of a sphere centre and radius, of a plane point and normal, of a circle centre, normal and
        radius.
    covariance : (p, p) array
        Of them, by the scatter of the points about the shape.
    freedom : int
        Degrees of freedom of that scatter; 0 if the points do not show it.
    form_mm : float or None
    """

    parameters: FloatArray
    covariance: FloatArray
    freedom: int
    form_mm: float | None


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
    kind : {"length", "sphere", "plane", "circle"}
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
        One for each group and, of spheres and circles, the distance of each two centres; of lengths one for each two
        ends.

    Raises
    ------
    InputError
        If a feature has too few points, they do not determine it, or the stylus tip is larger than it.
    """
    _check_groups(kind, groups)
    rows = list(groups.values())
    shapes = [_fit(kind, points[part]) for part in rows]
    roots = [covariance_factor(shape.covariance).T for shape in shapes]
    measured = _values(kind, [shape.parameters for shape in shapes], tip_diameter_mm)
    if kind in ("sphere", "circle") and (small := measured[:: len(QUANTITIES[kind])][: len(rows)] <= 0).any():
        name = list(groups)[int(small.argmax())]
        raise InputError(
            f"the stylus tip of {tip_diameter_mm:g} mm is larger than the {kind} {name!r}", hint="its diameter in mm"
        )
    # What a single point of an end scatters is not seen; the model states what it does not explain.
    unseen = errors.field_std_mm if errors.repeatability_mm is None else 0.0
    draws, wide = np.empty((n_arms, len(measured))), np.empty((n_arms, len(measured)))
    for i, arm_seed in enumerate(np.random.SeedSequence(seed).generate_state(n_arms, np.uint64).tolist()):
        drawn, rng = errors.draw(arm_seed), np.random.default_rng([7, arm_seed])
        off_in_base = drawn.systematic(angles) + drawn.random(angles, rng)
        moved = points + off_in_base @ errors.R_base_reference
        moved += np.einsum("k,knc->nc", rng.standard_normal(len(shared)), shared)
        fitted = [_fit(kind, moved[part], like=shape.parameters) for part, shape in zip(rows, shapes, strict=True)]
        scatter = [_scatter(root, shape.freedom, unseen, rng) for root, shape in zip(roots, shapes, strict=True)]
        for out, which in ((draws, 0), (wide, 1)):
            parameters = [one.parameters + off[which] for one, off in zip(fitted, scatter, strict=True)]
            out[i] = _values(kind, parameters, tip_diameter_mm)
        if progress is not None:
            progress(i + 1, "")
    return _features(kind, groups, shapes, measured, draws.std(axis=0, ddof=1), wide)


def _scatter(
    root: FloatArray, freedom: int, unseen_mm: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Errors of a shape's parameters by the scatter of its points; and the same as wide as few points know it.

    The scatter was estimated with few degrees of freedom: Student's t in place of a normal distribution (JCGM 101:2008,
    6.4.9).
    """
    z = rng.standard_normal(len(root))
    if not freedom:
        return (unseen_mm * z,) * 2
    off = root @ z
    return off, off * np.sqrt(freedom / rng.chisquare(freedom))


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
    """Fit one shape; its normal to the side of that of `like`, as small errors may change the sign that is chosen."""
    n = len(points)
    if kind == "length":
        middle = points.mean(axis=0)
        freedom = 3 * (n - 1)
        std = float(np.sqrt(((points - middle) ** 2).sum() / freedom)) if freedom else 0.0
        return _Shape(middle, std**2 / n * np.eye(3), freedom, None)
    if kind == "sphere":
        ball = fit_sphere(points)
        return _Shape(np.array([*ball.centre, ball.radius_mm]), ball.covariance, n - 4, ball.form_mm)
    if kind == "plane":
        plate = fit_plane(points)
        parameters, freedom, form = np.array([*plate.point, *plate.normal]), n - 3, plate.form_mm
        covariance = plate.covariance
    else:
        bore = fit_circle(points)
        parameters, freedom = np.array([*bore.centre, *bore.normal, bore.radius_mm]), 2 * n - 6
        covariance, form = bore.covariance, float(np.ptp(bore.residuals[:, 0]))
    if like is not None and parameters[3:6] @ like[3:6] < 0:
        parameters[3:6] *= -1
    return _Shape(parameters, covariance, freedom, form)


def _values(kind: str, shapes: Sequence[FloatArray], tip_diameter_mm: float) -> FloatArray:
    """Values of the quantities of all shapes in the order of `QUANTITIES`, then the distances of each two centres."""
    enlarged = {"sphere": -tip_diameter_mm, "circle": tip_diameter_mm}.get(kind, 0.0)
    values: list[FloatArray] = []
    if kind == "plane":
        values += shapes
    elif kind != "length":
        values += [np.array([2 * shape[-1] + enlarged, *shape[:-1]]) for shape in shapes]
    if kind != "plane":
        values.append(np.array([np.linalg.norm(b[:3] - a[:3]) for a, b in combinations(shapes, 2)]))
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
    low, high = shortest_interval(np.sort((draws - measured).T))
    expanded = np.maximum(np.abs(low), np.abs(high))
    results = zip(measured.tolist(), u.tolist(), expanded.tolist(), strict=True)
    sizes = {name: len(rows) for name, rows in groups.items()}
    found = []
    for name, shape in zip(groups, shapes, strict=True):
        quantities = tuple(MeasuredQuantity(quantity, *next(results)) for quantity in QUANTITIES[kind])
        if quantities:
            found.append(MeasuredFeature(kind, name, sizes[name], quantities, shape.form_mm))
    for a, b in combinations(groups, 2) if kind != "plane" else ():
        length = MeasuredQuantity("length_mm", *next(results))
        found.append(MeasuredFeature("length", f"{a} to {b}", sizes[a] + sizes[b], (length,), None))
    return found
