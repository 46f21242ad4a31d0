"""Distances of the tip from anchors, which are fixed points at unknown places, and from touched spheres.

A draw-wire encoder, or a ball bar with one end on a fixed ball, measures how far the tip is from its anchor. All
distances to one anchor have one error in common, the offset: the zero of the wire, the certificate of the bar. The
anchors are located by the distances.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, TypedDict

import numpy as np

from truearm.errors import InputError
from truearm.findings import Finding
from truearm.readings.readings import Measurements, Readings
from truearm.typing import BoolArray, FloatArray

# Standard uncertainty of an offset that is not stated [mm]: the zero of a wire is set by eye.
OFFSET_STD_MM = 1.0
# Distances that differ by a smaller share are those of a bar: they do not determine the offset.
EQUAL_SHARE = 0.05


def rows_with_distance(readings: Measurements) -> BoolArray:
    """(n,) Whether each reading has a distance to an anchor."""
    return np.zeros(len(readings), bool) if readings.distance_mm is None else ~np.isnan(readings.distance_mm)


def offset_std(readings: Measurements, name: str) -> float:
    """Standard uncertainty of the offset of the distances to an anchor [mm]."""
    if readings.u_offset_mm is None or readings.anchor is None:
        return OFFSET_STD_MM
    return float(readings.u_offset_mm[readings.anchor == name][0])


def bars_without_certificate(readings: Readings) -> Iterator[Finding]:
    """Anchors whose distances are nearly equal, as those of a bar, without a stated uncertainty of the offset."""
    if readings.distance_mm is None or readings.u_offset_mm is not None:
        return
    assert readings.anchor is not None  # checked by the session
    known = rows_with_distance(readings)
    names = [str(name) for name in np.unique(readings.anchor[known])]
    values = [readings.distance_mm[known & (readings.anchor == name)] for name in names]
    for name, some in zip(names, values, strict=True):
        if np.ptp(some) < EQUAL_SHARE * some.mean():
            said = (
                f"The distances to anchor {name} are nearly equal, as those of a bar, and their common uncertainty is "
                f"assumed to be {OFFSET_STD_MM:g} mm, which leaves the size of the arm open: state u_offset_mm."
            )
            yield Finding("bar", said, {"u_offset_mm": OFFSET_STD_MM})


# Readings that determine an anchor (3) and the offset (1), and readings whose distances are compared: twice as many.
LEAST_READINGS, LEAST_COMPARED = 4, 8
# Standard deviation of the deviations at first [mm]: nominal arms err by about as much. Then it is that of the
# deviations, which weighs them against the prior of the offset.
SEARCH_SCALE_MM, LEAST_SCALE_MM = 1.0, 1e-4
SCALE_ROUNDS, MOST_STEPS = 2, 50
GAUSSIAN_MEDIAN = 0.6745
# Smaller shares count as zero.
ROUNDING = 1e-9
# Deviations of more standard deviations count less.
MOST_DEVIATION = 3.0
# Tips nearer to a plane than this share of their spread leave two places for the anchor, one on each side.
FLAT_SHARE = 0.02


class AnchorPlace(NamedTuple):
    """Place of an anchor by distances from known tips.

    Attributes
    ----------
    place : (3,) array
        In the frame of the tips [mm].
    offset : float
        By which the stated distances are too long [mm].
    freedom : (m,) array
        Share of a distance's own variance in its deviation: 1 less its leverage.
    """

    place: FloatArray
    offset: float
    freedom: FloatArray


class DistanceFigures(TypedDict):
    """Mean, root mean square and maximum of the magnitudes of errors of distances [mm]."""

    distance_mean_mm: float
    distance_rms_mm: float
    distance_max_mm: float


class DistanceErrors(DistanceFigures):
    """Errors of distances to anchors [mm]: over all of them, anchor by anchor, and one by one."""

    n_distances: int
    anchors: list[dict[str, Any]]
    distances: list[dict[str, Any]]


def has_located_anchor(session: Measurements, least: int = LEAST_READINGS) -> bool:
    """Whether an anchor has enough distances: to locate it, or `LEAST_COMPARED` of them."""
    if session.anchor is None or session.distance_mm is None:
        return False
    known = ~np.isnan(session.distance_mm)
    return bool(known.any() and np.unique(session.anchor[known], return_counts=True)[1].max() >= least)


def distance_errors(points: FloatArray, session: Measurements) -> DistanceErrors:
    """Errors of the distances of points from anchors, each anchor located by least squares from its own distances.

    The four unknowns of an anchor take up a part of the errors; each is divided by the root of the share that is left,
    1 less its leverage, so that its expected square is that of an error from a known place.

    Parameters
    ----------
    points : (n, 3) array
        Predicted [mm].
    session : Session or Measured
        Of these n readings. Anchors with fewer than `LEAST_COMPARED` distances are ignored.

    Returns
    -------
    DistanceErrors
        `distance_mean_mm`, `distance_rms_mm`, `distance_max_mm` over all distances; for each of the `anchors` its
        place, offset and errors; each of the `distances` with its reading and its error, predicted less stated.

    Raises
    ------
    InputError
        If no anchor has enough distances.
    """
    known = rows_with_distance(session)
    assert session.anchor is not None  # checked by the caller
    assert session.distance_mm is not None
    anchors: list[dict[str, Any]] = []
    distances: list[dict[str, Any]] = []
    errors = [np.zeros(0)]
    for name in np.unique(session.anchor[known]).tolist():
        rows = np.flatnonzero(known & (session.anchor == name))
        if len(rows) < LEAST_COMPARED:
            continue
        stated = session.distance_mm[rows]
        found = locate_anchor(points[rows], stated, offset_std=offset_std(session, name))
        error = np.linalg.norm(points[rows] - found.place, axis=1) + found.offset - stated
        error /= np.sqrt(found.freedom)
        errors.append(error)
        x, y, z = found.place.tolist()
        place = {"x_mm": x, "y_mm": y, "z_mm": z, "offset_mm": found.offset}
        anchors.append({"anchor": name, "n": len(rows)} | place | dict(_figures(error)))
        distances += [
            {"reading": session.called(int(row)), "anchor": name, "distance_mm": float(d), "error_mm": float(e)}
            for row, d, e in zip(rows, stated, error, strict=True)
        ]
    whole = np.concatenate(errors)
    if not len(whole):
        raise session.error(f"expected {LEAST_COMPARED} or more distances to an anchor, got fewer", column="anchor")
    return {**_figures(whole), "n_distances": len(whole), "anchors": anchors, "distances": distances}


def _figures(errors: FloatArray) -> DistanceFigures:
    size = np.abs(errors)
    return DistanceFigures(
        distance_mean_mm=float(size.mean()),
        distance_rms_mm=float(np.sqrt((size**2).mean())),
        distance_max_mm=float(size.max()),
    )


def locate_anchor(tips: FloatArray, distances: FloatArray, *, offset_std: float) -> AnchorPlace:
    """Place of an anchor and offset of its distances, by multilateration from known tips.

    With the anchor a, ``|t|^2 - d^2 = 2 a t - |a|^2`` is linear in a and its last term; the least-squares solution, and
    for tips near a plane its mirror image, start an orthogonal regression in which large deviations count
    less.

    Parameters
    ----------
    tips : (m, 3) array
        [mm].
    distances : (m,) array
        As stated [mm].
    offset_std : float
        Prior standard deviation of the offset [mm].

    Returns
    -------
    AnchorPlace
        Of several minima the lowest; tips in a plane leave the side open.

    Raises
    ------
    InputError
        With fewer than `LEAST_READINGS` readings.
    """
    if len(tips) < LEAST_READINGS:
        raise InputError(f"expected {LEAST_READINGS} or more distances to an anchor, got {len(tips)}")
    from scipy.optimize import least_squares  # slow to import, and most sessions have no distances

    mean = tips.mean(axis=0)

    def deviations(x: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(tips - mean - x[:3], axis=1) + x[3] - distances)

    def derivatives(x: FloatArray, scale: float) -> FloatArray:
        away = mean + x[:3] - tips
        distance = np.linalg.norm(away, axis=1, keepdims=True)
        rows = np.column_stack([away / np.where(distance > 0, distance, 1.0), np.ones(len(tips))]) / scale
        return np.vstack([rows, [0.0, 0.0, 0.0, 1 / offset_std]])

    def minimum(start: FloatArray, scale: float) -> Any:
        def whitened(x: FloatArray) -> FloatArray:
            return np.append(deviations(x) / scale, x[3] / offset_std)

        def jacobian(x: FloatArray) -> FloatArray:
            return derivatives(x, scale)

        options: Any = {"loss": "soft_l1", "f_scale": MOST_DEVIATION, "x_scale": "jac", "max_nfev": MOST_STEPS}
        return least_squares(whitened, start, jacobian, **options)

    tried = [minimum(np.append(start, 0.0), SEARCH_SCALE_MM) for start in _linear_starts(tips - mean, distances)]
    x = min(tried, key=lambda one: float(one.cost)).x
    for _ in range(SCALE_ROUNDS):
        # The standard deviation of Gaussian deviations by their median magnitude.
        scale = float(np.median(np.abs(deviations(x)))) / GAUSSIAN_MEDIAN
        scale = float(np.clip(scale, LEAST_SCALE_MM, SEARCH_SCALE_MM))
        x = minimum(x, scale).x
    # The weights of the loss soft_l1, and 1 of the prior.
    weights = 1 / np.sqrt(1 + (np.append(deviations(x) / scale, 0.0) / MOST_DEVIATION) ** 2)
    return AnchorPlace(x[:3] + mean, float(x[3]), _freedom(np.sqrt(weights)[:, None] * derivatives(x, scale))[:-1])


def _freedom(A: FloatArray) -> FloatArray:
    """(n,) 1 less the leverages of the rows of a matrix."""
    U, size, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(np.maximum(1 - (U[:, size > ROUNDING * size[0]] ** 2).sum(axis=1), ROUNDING))


def _linear_starts(tips: FloatArray, distances: FloatArray) -> list[FloatArray]:
    """Start places of an anchor, for tips about their mean: one, or two on both sides of a plane."""
    square = (tips**2).sum(axis=1)
    spread = float(np.sqrt(square.mean())) or 1.0
    A = np.column_stack([2 * tips / spread, np.ones(len(tips))])
    *along, last = np.linalg.lstsq(A, (square - distances**2) / spread**2, rcond=1e-6)[0]
    place = spread * np.array(along)
    _, extent, axes = np.linalg.svd(tips / spread, full_matrices=False)
    if len(axes) < 3 or extent[2] > FLAT_SHARE * extent[0]:
        return [place, place - 2 * (place @ axes[-1]) * axes[-1]]
    # Tips in a plane determine the height only by the distance from the mean tip: |a|^2 = -last.
    normal = axes[2]
    within = place - (place @ normal) * normal
    height = np.sqrt(max(-float(last) * spread**2 - float(within @ within), (0.1 * spread) ** 2))
    return [within + height * normal, within - height * normal]
