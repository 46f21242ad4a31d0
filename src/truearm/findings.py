"""Findings: what a person must know of a result, found where it is judged, carried with it, said by its record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import floor, log10
from typing import Literal, TypeAlias, get_args

# What findings are of, in the order in which a record says them.
# fmt: off
What: TypeAlias = Literal[
    "acceptance", "hand-eye", "arm", "type prior", "calculated points", "joint gains", "joint sign", "scatter",
    "what limits", "orientation scatter", "unfilled rows", "joint limits", "no reference", "training readings",
    "lengths", "similar names", "single seats", "rounds", "repeats", "no arm", "held-out errors", "rounded angles",
    "few readings on", "session frames", "tips", "bar", "size", "still joint", "convergence", "stated uncertainty",
    "nominal arm", "length scale", "axis scale", "temperature order", "few readings", "hybrid model", "change",
    "nominal error", "trained range", "angles", "payload", "acceptance in the fit", "base", "known readings",
    "regressor", "file",
]
# fmt: on
_ORDER = {what: number for number, what in enumerate(get_args(What))}


@dataclass(frozen=True)
class Finding:
    """What a person must know of a result.

    Attributes
    ----------
    what : str
        What it is of, as ``"scatter"``: the same word wherever it is found.
    sentence : str
        What a record says.
    numbers : dict of str to float
        The numbers in it, by names with their units.
    """

    what: What
    sentence: str
    numbers: Mapping[str, float] = field(default_factory=dict, hash=False)

    def __str__(self) -> str:
        return self.sentence


NO_FINDINGS: tuple[Finding, ...] = ()


def in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings in the order in which a record says them; those of one thing stay in theirs."""
    return tuple(sorted(findings, key=lambda one: _ORDER[one.what]))


def shortened(findings: Iterable[Finding], most: int) -> tuple[Finding, ...]:
    """The first `most` findings of each thing, and how many others parts of a session have."""
    by_what: dict[What, list[Finding]] = {}
    for one in findings:
        by_what.setdefault(one.what, []).append(one)
    kept: list[Finding] = []
    for what, found in by_what.items():
        kept += found[:most]
        if n := len(found[most:]):
            kept.append(Finding(what, f"And {n} other remarks on {what} in other parts of the session.", {"n": n}))
    return tuple(kept)


def format_mm(value: float) -> str:
    """A length in mm with two significant digits, and no digit below 10 nm."""
    decimals = 2 if value <= 0 else min(max(1 - floor(log10(value)), 0), 5)
    return f"{value:.{decimals}f} mm"


def findings_of(what: What, sentences: Iterable[object]) -> tuple[Finding, ...]:
    """One finding for each sentence."""
    return tuple(Finding(what, str(one)) for one in sentences)
