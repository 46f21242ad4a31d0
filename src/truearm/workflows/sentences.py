"""Sentences that several records share: sizes of errors, comparisons with the nominal arm, outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10
from typing import Protocol

from truearm.readings import Session
from truearm.typing import IntArray

# Outliers and other details that are printed one by one; `to_dict` has all of them.
MAX_PRINTED = 6


class _Outlier(Protocol):
    @property
    def row(self) -> int: ...
    @property
    def error_mm(self) -> float: ...
    @property
    def normalized_residual(self) -> float: ...


@dataclass(frozen=True)
class ReadingOutlier:
    """A reading whose residual is too large for the noise.

    Attributes
    ----------
    row : int
        Its row in the session, counted from 0.
    line : int or None
        Its line in the session's file, counted from 1; None without a file.
    error_mm : float
        Length of its residual [mm].
    normalized_residual : float
        That length over the root mean square that the noise makes expected.
    """

    row: int
    line: int | None
    error_mm: float
    normalized_residual: float

    def __str__(self) -> str:
        name = f"reading {self.row + 1}" if self.line is None else f"line {self.line}"
        return f"{name}, error {self.error_mm:.3f} mm, normalized residual {self.normalized_residual:.0f}"


def reading_outliers(outliers: Sequence[_Outlier], session: Session, rows: IntArray) -> tuple[ReadingOutlier, ...]:
    """Outliers among the readings `rows` of a session, with their lines in its file."""

    def located(outlier: _Outlier) -> ReadingOutlier:
        row = int(rows[outlier.row])
        line = None if session.first_line is None else session.first_line + row
        return ReadingOutlier(row, line, outlier.error_mm, outlier.normalized_residual)

    return tuple(map(located, outliers))


def listed(label: str, items: Sequence[object], what: str) -> list[str]:
    """One sentence for each of the first `MAX_PRINTED` items, and one for the number of the others."""
    lines = [f"{label}: {item}" for item in items[:MAX_PRINTED]]
    if more := len(items) - MAX_PRINTED if len(items) > MAX_PRINTED else 0:
        lines.append(f"{label}: {more} more {what} (--json or to_dict() lists all)")
    return lines


def format_mm(value: float) -> str:
    """A length in mm with two significant digits, and no digit below 10 nm."""
    decimals = 2 if value <= 0 else min(max(1 - floor(log10(value)), 0), 5)
    return f"{value:.{decimals}f} mm"


def compare_with_nominal(error: float, nominal: float) -> str:
    """How an error compares with that of the nominal arm, as the end of a sentence."""
    if not error > 0 or not nominal > 0:
        return ""
    ratio = nominal / error
    if ratio >= 1.05:
        return f", {_times(ratio)} smaller than the nominal arm"
    if ratio > 0.95:
        return ", no smaller than the nominal arm"
    return f", {_times(1 / ratio)} larger than the nominal arm"


def _times(ratio: float) -> str:
    return f"{ratio:.0f} times" if ratio >= 9.5 else f"{ratio:.1f} times"
