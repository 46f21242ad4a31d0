"""What a row of `identification.py` comes to, and the figures that several rows share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from machine import Target
from truearm.readings import point_errors
from truearm.typing import FloatArray

FIGURES = ("mean_mm", "p95_mm", "max_mm")


@dataclass(frozen=True)
class Row:
    """A row of the table of numbers to reach.

    Attributes
    ----------
    title : str
        What was done, in a line.
    columns : list of str
    cells : list of list of str
        A table of what was found.
    targets : list of Target
    found : dict
        The same as numbers.
    notes : list of str
        What the table does not say.
    """

    title: str
    columns: list[str]
    cells: list[list[str]]
    targets: list[Target]
    found: dict[str, Any]
    notes: list[str] = field(default_factory=list)


def three_figures(points: FloatArray, reference: FloatArray) -> dict[str, float]:
    """Mean, 95th percentile and maximum of the distances [mm]."""
    errors = point_errors(points, reference)
    return {name: float(errors[name]) for name in FIGURES}  # type: ignore[literal-required]


def over_splits(splits: Sequence[dict[str, float]]) -> dict[str, float]:
    """Means of the figures over splits, and the largest of the maxima."""
    mean = {name: float(np.mean([split[name] for split in splits])) for name in ("mean_mm", "p95_mm")}
    return mean | {"max_mm": max(split["max_mm"] for split in splits)}


def told(figures: dict[str, float], digits: int = 3) -> str:
    """Write mean / p95 / max."""
    return " / ".join(f"{figures[name]:.{digits}f}" for name in FIGURES)
