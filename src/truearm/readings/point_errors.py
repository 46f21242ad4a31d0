"""Errors of predicted points, against reference points, in seats, and of the lengths between seats.

Against reference points they are distances, and single coordinates as in the paper; over parts of a session they follow
from sums. Without reference points they are the scatter of predicted points in seats, and errors of lengths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Self, TypedDict

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.readings.lengths import Lengths
from truearm.readings.readings import Measurements
from truearm.solve.sums import QuantileSketch, Sums, block_starts, design_effect, joined, one_below_the_other
from truearm.typing import FloatArray, IntArray, NameArray


class OneSeat(TypedDict):
    """Distances of a seat's points from their mean [mm]."""

    mean_mm: float
    rms_mm: float
    max_mm: float
    n: int


class SeatErrors(TypedDict):
    """Distances of points from the mean of their seat [mm]: over all seats, and seat by seat."""

    seat_mean_mm: float
    seat_rms_mm: float
    seat_max_mm: float
    n_in_seats: int
    seats: dict[str, OneSeat]


@dataclass(frozen=True)
class LengthSummary:
    """How well an arm measures known lengths, beside the nominal arm.

    Attributes
    ----------
    n : int
        Number of lengths.
    largest_mm, nominal_mm : float
        Largest error by the arm, and by the nominal one [mm]; NaN without one.
    is_worse : bool
        Whether the arm's errors are larger (root mean square), by more than the lengths' expanded uncertainty.
    """

    n: int
    largest_mm: float
    nominal_mm: float
    is_worse: bool

    @classmethod
    def of(cls, errors: npt.ArrayLike, nominal: npt.ArrayLike | None, u_mm: npt.ArrayLike) -> Self:
        """Of errors (m,) of lengths by an arm and by the nominal one, and the lengths' standard uncertainties [mm]."""
        own = np.asarray(errors, dtype=float)
        drawn = np.full(len(own), np.nan) if nominal is None else np.asarray(nominal, dtype=float)
        rms, drawn_rms, u = (float(np.sqrt(np.mean(np.square(one)))) for one in (own, drawn, u_mm))
        return cls(len(own), float(np.abs(own).max()), float(np.abs(drawn).max()), rms > drawn_rms + 2 * u)


def has_repeated_seat(session: Measurements) -> bool:
    """Whether a seat has two readings or more, so that its points can be compared with each other."""
    if session.seat is None:
        return False
    return bool(np.unique(session.seat[session.seat != ""], return_counts=True)[1].max(initial=0) > 1)


def seat_errors(points: npt.ArrayLike, seat: npt.ArrayLike) -> SeatErrors:
    """Distance of each predicted point to the mean of its seat.

    These are scatter only: an error that shifts all points of a seat alike has no effect, and few points in a seat
    pull their mean (of n points with independent errors, the mean square is smaller by the factor 1 - 1/n).

    Parameters
    ----------
    points : (n, 3) array
        Predicted tips [mm].
    seat : (n,) array of str
        The seat of each; empty if there is none. A seat with one reading is ignored.

    Returns
    -------
    SeatErrors
        `n_in_seats` is the number of points counted; `seats` has the seats by name.

    Raises
    ------
    InputError
        If shapes do not fit, or no seat has two readings.
    """
    points, seat = _checked(points, seat)
    names, group, means = _seat_means(points, seat)
    rows = seat != ""
    counts = np.bincount(group, minlength=len(names))
    distances = np.linalg.norm(points[rows] - means[group], axis=1)
    several = counts[group] > 1
    if not several.any():
        raise InputError(
            "expected a seat with two or more readings, got none",
            hint="give readings of one seat the same name in the column seat",
        )
    table = {str(name): _summary(distances[group == i]) for i, name in enumerate(names) if counts[i] > 1}
    whole = _summary(distances[several])
    return SeatErrors(
        seat_mean_mm=whole["mean_mm"],
        seat_rms_mm=whole["rms_mm"],
        seat_max_mm=whole["max_mm"],
        n_in_seats=whole["n"],
        seats=table,
    )


def length_errors(points: npt.ArrayLike, seat: npt.ArrayLike, lengths: Lengths) -> FloatArray:
    """Distance between the mean points of two seats, less the known length between them.

    Parameters
    ----------
    points : (n, 3) array
        Predicted tips [mm].
    seat : (n,) array of str
        The seat of each; empty if there is none. A seat with one reading is enough here.
    lengths : Lengths
        The known lengths; those between other seats are refused (`Lengths.between` selects).

    Returns
    -------
    (m,) array
        Too long is positive [mm], one for each of `lengths`.

    Raises
    ------
    InputError
        If shapes do not fit, or a length ends at a seat without readings.
    """
    points, seat = _checked(points, seat)
    names, _, means = _seat_means(points, seat)
    if len(lengths.between(names)) < len(lengths):
        row = int(np.argmin(np.isin(lengths.seat_a, names)))
        raise lengths.error(f"the readings have no seat {str(lengths.seat_a[row])!r}", row, column="seat_a")
    a, b = (np.searchsorted(names, ends) for ends in (lengths.seat_a, lengths.seat_b))
    return np.asarray(np.linalg.norm(means[a] - means[b], axis=1) - lengths.length_mm)


def _checked(points: npt.ArrayLike, seat: npt.ArrayLike) -> tuple[FloatArray, NameArray]:
    points, seat = np.asarray(points, dtype=float), np.asarray(seat, dtype=np.str_)
    if points.ndim != 2 or points.shape[1] != 3 or seat.shape != points.shape[:1]:
        raise InputError(f"expected points (n, 3) and a seat for each, got shapes {points.shape} and {seat.shape}")
    return points, seat


def _seat_means(points: FloatArray, seat: NameArray) -> tuple[NameArray, IntArray, FloatArray]:
    """Names of the seats in order, the number of each seated reading's seat, and the seats' mean points."""
    rows = seat != ""
    names, group = np.unique(seat[rows], return_inverse=True)
    counts = np.bincount(group, minlength=len(names))
    sums = np.stack([np.bincount(group, points[rows, k], minlength=len(names)) for k in range(3)], axis=1)
    return names, group, sums / np.maximum(counts, 1)[:, None]


def _summary(distances: FloatArray) -> OneSeat:
    return OneSeat(
        mean_mm=float(distances.mean()),
        rms_mm=float(np.sqrt(np.mean(distances**2))),
        max_mm=float(distances.max()),
        n=len(distances),
    )


class PointErrors(TypedDict):
    """Errors of points [mm]."""

    mean_mm: float
    rms_mm: float
    p95_mm: float
    max_mm: float
    mean_abs_coordinate_mm: float
    max_abs_coordinate_mm: float
    n: int


class ErrorComparison(PointErrors):
    """Errors, and the share of the nominal arm's error that was removed [%]."""

    removed_percent: float


def point_errors(predicted: FloatArray, points: FloatArray) -> PointErrors:
    """Errors of predicted points against reference points.

    Parameters
    ----------
    predicted, points : (n, 3) array
        [mm]. Rows of `points` that are NaN (no reference point) are ignored.

    Returns
    -------
    PointErrors
        `mean_mm`, `rms_mm`, `p95_mm`, `max_mm` of the distances; `mean_abs_coordinate_mm`, `max_abs_coordinate_mm` of
        single coordinates, the measure of Gao et al. (2017), section 4; `n` the readings counted.
    """
    known = ~np.isnan(points).all(axis=1)
    if not known.any():
        raise InputError("expected one or more readings to evaluate, got none")
    residuals = (predicted - points)[known]
    distances = np.linalg.norm(residuals, axis=1)
    return PointErrors(
        mean_mm=float(distances.mean()),
        rms_mm=float(np.sqrt(np.mean(distances**2))),
        p95_mm=float(np.percentile(distances, 95)),
        max_mm=float(distances.max()),
        mean_abs_coordinate_mm=float(np.abs(residuals).mean()),
        max_abs_coordinate_mm=float(np.abs(residuals).max()),
        n=len(residuals),
    )


def compare_errors(predicted: FloatArray, nominal: FloatArray, points: FloatArray) -> ErrorComparison:
    """Errors of predicted points, with the share of the nominal ones' mean absolute coordinate error removed.

    The share is the paper's "97 %": 100 (1 - 0.0136 / 0.4492). It is 0 where the nominal arm has no error.
    """
    errors = point_errors(predicted, points)
    return ErrorComparison(**errors, removed_percent=removed_percent(errors, point_errors(nominal, points)))


def removed_percent(own: Mapping[str, Any], nominal: Mapping[str, Any]) -> float:
    """The share of the nominal arm's mean absolute coordinate error that a model removed, of errors of both."""
    before = float(nominal["mean_abs_coordinate_mm"])
    return 100 * (1 - float(own["mean_abs_coordinate_mm"]) / before) if before > 0 else 0.0


@dataclass(frozen=True, eq=False)
class PointErrorSums(Sums):
    """Sums over readings with reference points.

    Attributes
    ----------
    n : int
    distance, squared : float
        Sums of the distances [mm] and of their squares [mm^2].
    largest : float
        The largest distance [mm].
    coordinate, largest_coordinate : float
        Sum of the absolute errors of coordinates, and the largest [mm].
    sketch : QuantileSketch
        Of the distances.
    of_blocks : (k, 2) array
        Number of readings and sum of the distances of blocks of consecutive readings.
    """

    n: int = 0
    distance: float = 0.0
    squared: float = 0.0
    largest: float = field(default=0.0, metadata=joined(max))
    coordinate: float = 0.0
    largest_coordinate: float = field(default=0.0, metadata=joined(max))
    sketch: QuantileSketch = field(default_factory=QuantileSketch)
    of_blocks: FloatArray = field(default_factory=partial(np.zeros, (0, 2)), metadata=joined(one_below_the_other))

    @classmethod
    def of(cls, predicted: FloatArray, points: FloatArray, n_session: int | None = None) -> PointErrorSums:
        """Sums over points (n, 3), a part of a session; rows of `points` that are NaN (no point) are ignored [mm]."""
        errors = (predicted - points)[~np.isnan(points).all(axis=1)]
        if not len(errors):
            return cls()
        distances, sizes = np.linalg.norm(errors, axis=1), np.abs(errors)
        starts = block_starts(len(errors), n_session)
        counts = np.diff(np.append(starts, len(errors)))
        return cls(
            len(errors),
            float(distances.sum()),
            float(distances @ distances),
            float(distances.max()),
            float(sizes.sum()),
            float(sizes.max()),
            QuantileSketch.of(distances),
            np.stack([counts, np.add.reduceat(distances, starts)], axis=1),
        )

    def errors(self) -> PointErrors:
        """The errors as `point_errors` gives them; the 95 % quantile to 0.1 %.

        Raises
        ------
        InputError
            If no reading has a reference point.
        """
        if not self.n:
            raise InputError("expected one or more readings to evaluate, got none")
        return PointErrors(
            mean_mm=self.distance / self.n,
            rms_mm=float(np.sqrt(self.squared / self.n)),
            p95_mm=self.sketch.quantile(0.95),
            max_mm=self.largest,
            mean_abs_coordinate_mm=self.coordinate / (3 * self.n),
            max_abs_coordinate_mm=self.largest_coordinate,
            n=self.n,
        )

    def effective_number(self) -> tuple[float, bool]:
        """Independent readings of whose distances the mean would be known as well, and whether that is settled."""
        mean = self.distance / self.n
        variance = max(self.squared / self.n - mean**2, 1e-30)
        scores = self.of_blocks[:, 1] - mean * self.of_blocks[:, 0]
        effect = design_effect(scores[:, None], np.array([[1 / (self.n * variance)]]), self.n)
        return self.n / effect.factor, effect.is_settled

    def standard_error_mm(self) -> float:
        """Standard error of the mean distance, by the effective number of readings [mm]."""
        mean = self.distance / self.n
        return float(np.sqrt(max(self.squared / self.n - mean**2, 0.0) / self.effective_number()[0]))
