"""Errors without reference points: scatter of predicted points in seats, and lengths between seats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, TypedDict

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.readings.lengths import Lengths
from truearm.readings.readings import Measurements
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
