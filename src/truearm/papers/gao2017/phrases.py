"""Phrases of a page about a reproduced paper: numbers with their units, rows by number, and what was not run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truearm.pages.number_format import format_in_text, format_number
from truearm.pages.page import Cell
from truearm.pages.plotting import Figure

COMMAND = "truearm reproduce gao2017"


@dataclass(frozen=True)
class MissingPart:
    """A part of the reproduction that was not run, and the option of the command that makes it."""

    what: str
    option: str

    def __str__(self) -> str:
        return f"{self.what} is not part of this run; it is made by: {COMMAND} {self.option}"


def format_row_numbers(numbers: Iterable[int]) -> str:
    """Tell numbers of rows: rows 1, 6 to 8 and 11."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    by_run = [[f"{run[0]} to {run[-1]}"] if len(run) > 2 else [str(number) for number in run] for run in runs]
    parts = [part for run in by_run for part in run]
    text = parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
    return f"row{'s' * (sum(map(len, runs)) > 1)} {text}"


USED_TO_FIX_BOX = "used to fix the box"  # the verdict that is none

# Said wherever the two are compared.
TRAINING_SHARES_NOTE = (
    "Faithful fits 70 % of the poses (15 % stop it, 15 % are MATLAB's test set), lm fits all of them."
)


def format_degrees(angle: float) -> str:
    """Give an angle [deg] as a sentence has it."""
    return format_in_text(round(angle, 9) + 0.0, unit="deg")


def range_cell(values: Sequence[float]) -> str | None:
    """Give the least and the largest in a cell that stays on one line; nothing for a single value."""
    if len(values) == 1:
        return None
    return f"{format_number(min(values))}\u2013\u2060{format_number(max(values))}"  # \u2060: no break after the dash


def median_and_range(values: Sequence[float]) -> tuple[Cell, Cell]:
    """Give the median of values, and their range as `range_cell`."""
    return float(np.median(values)), range_cell(values)


def as_count(cell: Cell) -> Cell:
    """Give a number without a fraction as a count, so that a table shows it without decimals."""
    return int(cell) if isinstance(cell, float) and cell.is_integer() else cell


def with_figure_number(number: int, figure: Figure) -> Figure:
    """Say which figure of the paper a figure stands for, also in its caption."""
    return replace(figure, caption=f"Figure {number} of the paper, ours. {figure.caption}")
