"""What the tips of a session refer to, in the form in which many interpretations of an arm are compared.

Reference points where there are enough, else seats and the lengths between them; of one session and one tip, and at
most `MOST_READINGS` readings, evenly spaced: what people get wrong in an arm file shows in every reading.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truearm.arm.description_mistakes import Interpretation
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray, IntArray

MOST_READINGS = 60
# Fewer say nothing: base and tip have 9 parameters.
LEAST_READINGS = 8
# Share of the readings that every interpretation is fitted to and judged by.
SHARE = 0.75
# Rows by which references may be shifted against their readings.
SHIFTS = (1, -1)


@dataclass(frozen=True, eq=False)
class ReferenceTable:
    """What the readings refer to: reference points, or seats with lengths between them.

    Attributes
    ----------
    angles : (m, n_joints) array
        As stated [rad, or mm].
    points : dict of int to (m, 3) array
        Reference points by shift [mm, as stated]; empty with seats.
    seats : dict of int to (m,) int array
        Seat of each reading by shift; empty with points.
    lengths : (l, 4) array
        Seats a and b, length and standard uncertainty [mm, as stated]; none with points.
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown.
    """

    angles: FloatArray
    points: dict[int, FloatArray]
    seats: dict[int, IntArray]
    lengths: FloatArray
    free: tuple[str, ...] = ("base", "tip")

    @property
    def has_points(self) -> bool:
        """Whether the readings have reference points."""
        return bool(self.points)

    def of_readings(self, n: int) -> ReferenceTable:
        """The table of at most n of its readings, evenly spaced."""
        rows = np.unique(np.linspace(0, len(self.angles) - 1, min(n, len(self.angles))).round().astype(np.intp))
        points = {shift: points[rows] for shift, points in self.points.items()}
        seats = {shift: seats[rows] for shift, seats in self.seats.items()}
        return replace(self, angles=self.angles[rows], points=points, seats=seats)

    @property
    def n_kept(self) -> int:
        """Number of readings after trimming."""
        return int(np.ceil(SHARE * len(self.angles)))

    def points_of(self, one: Interpretation) -> FloatArray:
        """(m, 3) points by an interpretation [mm]."""
        return np.asarray(one.point_factor * self.points[one.shift] @ one.points_turn.T)


def reference_table(
    session: Session, lengths: Lengths | None = None, *, free: tuple[str, ...] = ("base", "tip")
) -> ReferenceTable | None:
    """The references of a session; None if there are too few.

    Parameters
    ----------
    session : Session
    lengths : Lengths, optional
        Known lengths between its seats.
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown. Without reference points the base is of no influence.
    """
    usable = _of_one(session)
    seen = np.flatnonzero(usable & session.has_point)
    if len(seen) >= LEAST_READINGS:
        assert session.points is not None
        rows, shifts = _rows_with_neighbours(seen)
        return ReferenceTable(
            session.angles[rows], {shift: session.points[rows + shift] for shift in shifts}, {}, np.zeros((0, 4)), free
        )
    if session.seat is None:
        return None
    names, seat, counts = np.unique(session.seat, return_inverse=True, return_counts=True)
    held = np.flatnonzero(usable & (session.seat != "") & (counts[seat] > 1))
    if len(held) < LEAST_READINGS:
        return None
    rows, shifts = _rows_with_neighbours(held)
    seats = {shift: seat[rows + shift] for shift in shifts}
    return ReferenceTable(session.angles[rows], {}, seats, _lengths_between(lengths, names.tolist(), seats[0]), free)


def _of_one(session: Session) -> BoolArray:
    """(n,) The readings of the session and the tip with the most readings."""
    usable = np.ones(len(session), dtype=bool)
    for names in (session.session, session.tip):
        if names is not None and len(names):
            values, counts = np.unique(names[usable], return_counts=True)
            usable &= names == values[np.argmax(counts)]
    return usable


def _rows_with_neighbours(rows: IntArray) -> tuple[IntArray, tuple[int, ...]]:
    """Evenly spaced rows, and by how many rows references can be shifted: all have neighbours, or none is asked."""
    inner = rows[np.isin(rows + 1, rows) & np.isin(rows - 1, rows)]
    is_whole = len(inner) >= max(SHARE * len(rows), LEAST_READINGS)
    chosen = inner if is_whole else rows
    spaced = np.linspace(0, len(chosen) - 1, min(len(chosen), MOST_READINGS)).round().astype(np.intp)
    return chosen[np.unique(spaced)], (0, *SHIFTS) if is_whole else (0,)


def _lengths_between(lengths: Lengths | None, names: list[str], seat: IntArray) -> FloatArray:
    """(l, 4) seats, length and uncertainty of the lengths whose seats have readings."""
    if lengths is None:
        return np.zeros((0, 4))
    number = {name: k for k, name in enumerate(names) if k in seat}
    ends = zip(lengths.seat_a.tolist(), lengths.seat_b.tolist(), strict=True)
    values = zip(lengths.length_mm.tolist(), lengths.u_mm.tolist(), strict=True)
    rows = [
        (number[a], number[b], *value)
        for (a, b), value in zip(ends, values, strict=True)
        if a in number and b in number
    ]
    return np.array(rows).reshape(-1, 4)
