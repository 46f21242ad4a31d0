"""Rows of a foreign table that are no readings: targets that were lost, and statistics of the readings."""

from __future__ import annotations

import re

import numpy as np

from truearm.typing import BoolArray, FloatArray, NameArray

# What programs write for a point that they did not see, beside three zeros: all coordinates alike.
NO_POINT = [-1.0, -99.0, *(s * v for s in (-1.0, 1.0) for v in (999.0, 999.9, 999.99, 9999.0, 99999.0, 999999.0))]
# No tip is as far away [table's unit]; 9.9E+37 and 1e30 are "no value" of several instruments.
FAR_AWAY = 1e15
# Three equal coordinates so many times as large as others are no point either: -32768, 99999.9999, 1e7.
BEYOND_OTHERS = 8
# A point this near the origin makes another of three zeros possible [share of the largest distance].
NEAR_ORIGIN = 1e-3
# A row of statistics differs from those of the rows it sums up by its rounding [share of a column's standard
# deviation]; that a reading does so in all columns by chance is impossible for a handful of columns.
OF_A_STATISTIC = 1e-3
FEWEST_ROWS, FEWEST_COLUMNS, MOST_STATISTICS, MANY_ROWS = 4, 4, 8, 5000
# What a column says of a point that was not seen, and what such a column is called.
_STATUS = re.compile(
    r"(beam|target|tracker|point|meas\w*)?_?(status|state|valid|visible|quality|use|used|ok|flag|locked)", re.I
)
_LOST = (
    r"(?:(?:beam|target|tracker|point) )?(?:lost|occluded|hidden|not visible|verloren)|no (?:beam|target)"
    r"|ziel(?:verlust| verloren)"
)
_SAYS_LOST = re.compile(_LOST, re.I)
_NOT_SEEN = re.compile(rf"{_LOST}|invalid|bad|no|nok|not ok|false|0|ung\u00fcltig|nein|non|error|fail(?:ed)?", re.I)


def lost_targets(points: FloatArray) -> BoolArray:
    """(n,) Which of (n, 3) points are no points: three zeros away from all others, or a number that says so."""
    if not len(points):
        return np.zeros(0, bool)
    alike = np.all(points == points[:, :1], axis=1)
    said = alike & np.isin(points[:, 0], NO_POINT)
    usual = np.nanmedian(np.abs(points)) if np.isfinite(points).any() else np.inf
    far = (np.abs(points) > FAR_AWAY).any(axis=1) | (alike & (np.abs(points[:, 0]) > BEYOND_OTHERS * usual))
    zero = np.all(points == 0, axis=1)
    seen = np.linalg.norm(points[~(zero | said | far | np.isnan(points).any(axis=1))], axis=1)
    if not len(seen) or seen.min() < NEAR_ORIGIN * seen.max():
        zero[:] = False
    return np.asarray(said | far | zero)


def lost_zero(points: FloatArray) -> BoolArray:
    """(n,) Which of (n, 3) points are three zeros that are no point; of (n, 0) all."""
    return lost_targets(points) & (points == 0).all(axis=1) if points.size else np.ones(len(points), bool)


def is_status(name: str) -> bool:
    """Whether a column of this name says how a point was measured."""
    return _STATUS.fullmatch(re.sub(r"[\W_]+", "_", name.strip())) is not None


def not_seen(name: str, cells: NameArray) -> BoolArray:
    """(n,) Which cells of a column of this name say that the point was not seen, if fewer than half of them do."""
    words = _NOT_SEEN if is_status(name) else _SAYS_LOST
    different, which = np.unique(cells, return_inverse=True)
    said = np.array([words.fullmatch(cell.strip()) is not None for cell in different.tolist()], bool)[which]
    return said if 2 * np.count_nonzero(said) < len(said) else np.zeros(len(cells), bool)


def far_turned(values: FloatArray) -> BoolArray:
    """(n,) Which of (n, n_joints) rows of joint values hold one that is far beyond all others: a lost point or cell.

    Whatever the unit, a joint is not 15 times as far from zero as three quarters of all readings.
    """
    whole = values[~np.isnan(values).any(axis=1)]
    if len(whole) < FEWEST_ROWS:
        return np.zeros(len(values), bool)
    usual = np.quantile(np.abs(whole), 0.75, axis=0)
    return np.asarray((np.abs(values) > 15 * np.maximum(usual, 0.2 * usual.max())).any(axis=1))


def statistics_at_ends(numbers: FloatArray) -> BoolArray:
    """(n,) Which first or last of (n, k) rows hold means, standard deviations, limits or ranges of all others."""
    found = np.zeros(len(numbers), bool)
    for end in (slice(None), slice(None, None, -1)):  # at the head, then at the foot
        rows = numbers[end]
        # Of many rows the few at the end change little: the outermost tells whether to look at all.
        if len(rows) > MANY_ROWS and not _are_statistics(rows[:1], rows[1:], 30 * OF_A_STATISTIC):
            continue
        for n in range(min(MOST_STATISTICS, len(rows) - FEWEST_ROWS), 0, -1):
            if _are_statistics(rows[:n], rows[n:]):
                found[end][:n] = True
                break
    return found


def _are_statistics(few: FloatArray, rows: FloatArray, share: float = OF_A_STATISTIC) -> bool:
    if np.isnan(rows).any():
        rows = rows[~np.isnan(rows).any(axis=1)]
    if len(rows) < FEWEST_ROWS:
        return False
    spread = rows.std(axis=0)
    moves = spread > 0
    if np.count_nonzero(moves) < FEWEST_COLUMNS or np.isnan(few[:, moves]).any():
        return False
    low, high, mean = rows.min(axis=0), rows.max(axis=0), rows.mean(axis=0)
    std = rows.std(axis=0, ddof=1)
    of_rows = np.stack(
        [mean, spread, std, 2 * std, low, high, np.median(rows, axis=0), high - low, std / len(rows) ** 0.5]
    )
    off = np.abs(few[:, None] - of_rows)[:, :, moves]
    return bool((off <= share * spread[moves]).all(axis=2).any(axis=1).all())
