"""Phrases and cells of the reproduction's page: rows by number, ranges, parts that were not run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from truearm.number_format import format_count, format_in_text, format_number
from truearm.pages.page import Cell
from truearm.pages.plotting import Figure

COMMAND = "truearm reproduce gao2017"
SHARES_NOTE = (
    "trainlm fits 70 % of the poses (15 % for validation, 15 % are MATLAB's test set), varpro fits all of them."
)
"""Stated wherever the two are compared."""


@dataclass(frozen=True)
class MissingPart:
    """A part of the reproduction that was not run, and the option of the command that runs it."""

    what: str
    option: str

    def __str__(self) -> str:
        return f"{self.what} is not part of this run. To make it: {COMMAND} {self.option}"


CUT = "cut"
"""Marks a result with a training that the time limit ended."""


def mark_cut(text: str, n_cut: int | bool) -> str:
    """A label, marked if the time limit ended a training that its number comes from."""
    return f"{text} ({CUT})" if n_cut else text


def cut_note(n_cut: int) -> str:
    """A sentence on trainings that the time limit ended; empty without any."""
    if not n_cut:
        return ""
    return (
        f" The time limit ended {format_count(n_cut, 'training')} of these before a stop of its own: what it would "
        "have reached is not known."
    )


def format_row_numbers(numbers: Iterable[int]) -> str:
    """Numbers of rows: rows 1, 6 to 8 and 11."""
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


def format_degrees(angle: float) -> str:
    """An angle [deg] in a sentence."""
    return format_in_text(round(angle, 9) + 0.0, unit="deg")


def range_cell(values: Sequence[float]) -> str | None:
    """The least and the largest in a cell that stays on one line; None for a single value."""
    if len(values) == 1:
        return None
    return f"{format_number(min(values))}\u2013\u2060{format_number(max(values))}"  # \u2060: no break after the dash


def as_count(value: float) -> Cell:
    """A number without a fraction as a count, which a table shows without decimals."""
    return int(value) if value.is_integer() else value


def with_figure_number(number: int, figure: Figure) -> Figure:
    """A figure whose caption names its number in the paper."""
    return replace(figure, caption=f"Figure {number} of the paper, reproduced. {figure.caption}")
