"""Sentences that several records share: sizes of errors, comparisons with the nominal arm."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from truearm.findings import format_mm as format_mm
from truearm.readings import LengthSummary

# Outliers and other details that are printed one by one; `to_dict` has all of them.
MAX_PRINTED = 6
# Of an uncertainty under repeatability conditions.
SAME_DAY = "on the day and in the set-up of the training"


def listed(label: str, items: Sequence[object], what: str, n: int | None = None) -> list[str]:
    """One sentence for each of the first `MAX_PRINTED` items, and one for the number of the others.

    Of `n` in all the items may be the largest alone.
    """
    lines = [f"{label}: {item}" for item in items[:MAX_PRINTED]]
    if more := len(items) - MAX_PRINTED if len(items) > MAX_PRINTED else 0:
        lists = "all" if n is None or n == len(items) else f"the {len(items)} largest of {n}"
        lines.append(f"{label}: {more} more {what} (--json or to_dict() lists {lists})")
    return lines


def number_of(n: int, noun: str = "reading") -> str:
    """A number of things: 1 reading, 2 readings; plain digits, where pages group them (`format_count`)."""
    return f"{n} {noun}{'s' * (n != 1)}"


def agree(n: int, of_many: str) -> str:
    """A verb for a number of things: is, was, has; "are", "were", "have" of many."""
    return {"are": "is", "were": "was", "have": "has"}[of_many] if n == 1 else of_many


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


def with_lengths(sentence: str, compared: str, lengths: LengthSummary | None) -> str:
    """A sentence without its end, how that compares with the nominal arm, and known lengths: first if they are worse.

    An arm that measures lengths worse than the drawing is not better, however well its points agree with each other.
    """
    if lengths is None:
        return f"{sentence}{compared}"
    of = f"argest error of {number_of(lengths.n, 'length')} {format_mm(lengths.largest_mm)}"
    nominal = "" if isnan(lengths.nominal_mm) else f" (nominal arm {format_mm(lengths.nominal_mm)})"
    if lengths.is_worse:
        return (
            f"L{of}, worse than the nominal arm ({format_mm(lengths.nominal_mm)}); {sentence[0].lower()}{sentence[1:]}"
        )
    return f"{sentence}{compared}; l{of}{nominal}"


def _times(ratio: float) -> str:
    return f"{ratio:.0f} times" if ratio >= 9.5 else f"{ratio:.1f} times"


def describe_effective_number(number: float, n: int, is_settled: bool) -> str:
    """How many independent readings correlated ones are worth, as the beginning of a sentence."""
    if number > 0.99 * n:
        found = "have independent errors" if is_settled else "count as independent (too few to show like errors)"
        return f"Consecutive readings (in the order of the rows) {found}"
    digits = max(len(str(int(number))) - 3, 0)
    more = "" if is_settled else " (or fewer: there are too few to show all of their correlation)"
    return (
        f"Consecutive readings (in the order of the rows) have like errors: {n} are worth {round(number, -digits):.0f} "
        f"independent ones{more}"
    )
