"""What every verb returns: a record that reads as text in a terminal, as HTML in a notebook, as JSON for machines.

Several records share sentences: sizes of errors, comparisons with the nominal arm.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from datetime import date
from decimal import Decimal
from enum import Enum
from html import escape
from math import isfinite, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from truearm.errors import InputError
from truearm.findings import format_mm
from truearm.printable_text import printable

if TYPE_CHECKING:
    import pandas as pd

    from truearm.readings import LengthSummary
    from truearm.typing import FloatArray

# Outliers and other details that are printed one by one; `to_dict` has all of them.
MAX_PRINTED = 6
# Of an uncertainty under repeatability conditions.
SAME_DAY = "on the day and in the set-up of the training"
# Sentences and tables that a notebook shows; those for experts come after them and are folded.
N_OPEN = 5


class Figure(Protocol):
    """What a record draws."""

    def save(self, path: str | Path) -> None:
        """Write it as a file."""

    def _repr_html_(self) -> str:
        """It, as notebooks show it."""


@dataclass(frozen=True)
class TextTable:
    """A table of formatted cells; the columns in `left_aligned` are aligned left, the others right.

    Parameters
    ----------
    columns : sequence of str
        Headings.
    rows : sequence of sequences of str
        One cell a column.
    left_aligned : tuple of int
        Columns of words, counted from 0.
    """

    columns: Iterable[str]
    rows: Iterable[Iterable[str]]
    left_aligned: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "columns", tuple(self.columns))
        object.__setattr__(self, "rows", tuple(tuple(row) for row in self.rows))

    def __str__(self) -> str:
        lines = [[*map(printable, cells)] for cells in (self.columns, *self.rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return "\n".join(
            "  ".join(
                cell.ljust(width) if i in self.left_aligned else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        )

    def to_html(self) -> str:
        """The table as an HTML element."""

        def row(cells: Iterable[str], tag: str) -> str:
            parts = (
                f'<{tag} style="text-align:{"left" if i in self.left_aligned else "right"}">{escape(cell)}</{tag}>'
                for i, cell in enumerate(cells)
            )
            return f"<tr>{''.join(parts)}</tr>"

        body = "".join(row(cells, "td") for cells in self.rows)
        return f"<table><thead>{row(self.columns, 'th')}</thead><tbody>{body}</tbody></table>"


class Record(ABC):
    """Result of a verb. A subclass is a frozen dataclass and describes itself for people in `blocks`.

    ``print(record)`` prints what the command prints, a notebook shows the same sentences and tables and, where it
    helps, a figure; `to_dict` is what ``--json`` prints, from the values that a subclass names in ``_json``.
    """

    @abstractmethod
    def blocks(self) -> Iterable[str | TextTable]:
        """Sentences and tables in reading order; the first sentence is the answer that a person came for."""

    def details(self) -> Iterable[str | TextTable]:
        """What only experts ask for: commands print it with ``--details``, a notebook folds it; none by default."""
        return ()

    def to_dict(self) -> dict[str, Any]:
        """The result for machines: strings, numbers, lists and dictionaries only, ready for JSON."""
        plain: dict[str, Any] = to_plain(self._json())
        return plain

    @abstractmethod
    def _json(self) -> object:
        """What `to_dict` makes plain: values by their names in JSON, or a dataclass."""

    def _named(self, *names: str) -> dict[str, Any]:
        """The attributes of these names: those whose name in JSON is the same."""
        return {name: getattr(self, name) for name in names}

    def figure(self) -> Figure | None:
        """The figure that a notebook shows below the text, of the errors that the result has; none by default."""
        if not (errors := self._errors_mm()):
            return None
        from truearm.pages.drawings.error_figures import error_distribution

        return error_distribution(errors)

    def _errors_mm(self) -> Mapping[str, FloatArray]:
        """The errors of each model that the figure shows, distances [mm]."""
        return {}

    def save_figure(self, path: str | Path) -> None:
        """Write the figure as a file for a text or a talk.

        Parameters
        ----------
        path : path
            ``.svg``, ``.pdf`` or ``.png``.

        Raises
        ------
        InputError
            If this result has no figure, the name has another ending, or the file cannot be written.
        """
        figure = self.figure()
        if figure is None:
            raise InputError(f"a {type(self).__name__} has no figure here")
        figure.save(path)

    def __str__(self) -> str:
        return printable("\n".join(map(str, self.blocks())))

    def __repr__(self) -> str:
        first = printable(str(next(iter(self.blocks()), "")))
        return f"<{type(self).__name__}: {first.splitlines()[0]}>"

    def _repr_html_(self) -> str:
        parts = [
            printable(block.to_html() if isinstance(block, TextTable) else f"<p>{escape(block)}</p>")
            for block in (*self.blocks(), *self.details())
        ]
        if len(parts) > N_OPEN + 1:
            details = "".join(parts[N_OPEN:])
            parts[N_OPEN:] = [f"<details><summary>{len(parts) - N_OPEN} more remarks</summary>{details}</details>"]
        if (figure := self.figure()) is not None:
            parts.append(figure._repr_html_())
        return "".join(parts)


class TableRecord(Record):
    """A result that is a table: `to_frame` returns it as a DataFrame."""

    @abstractmethod
    def columns(self) -> Mapping[str, Any]:
        """The columns of `to_frame` by name, each with one value a row.

        The name of a quantity ends in its unit (``u_mm``); where the rows differ in theirs, a column ``unit`` has it.
        """

    def to_frame(self) -> pd.DataFrame:
        """The result as a DataFrame; the names of its columns state the units."""
        from truearm.readings.columns import data_frame

        return data_frame(self.columns())


def columns_of(rows: Iterable[Any]) -> dict[str, list[Any]]:
    """The columns of rows, each a mapping or a dataclass; lists and mappings in a row are no cells and have none."""
    plain = [to_plain(row) for row in rows]
    names = dict.fromkeys(name for row in plain for name in row)
    nested = {name for row in plain for name, value in row.items() if isinstance(value, list | dict)}
    return {name: [row.get(name) for row in plain] for name in names if name not in nested}


def to_plain(value: Any) -> Any:
    """A value for JSON: dataclasses and mappings as dictionaries, arrays as lists, dates as ISO 8601, NaN as None."""
    if isinstance(value, float | Decimal):  # most values are numbers
        return float(value) if isfinite(value) else None
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Enum):
        return to_plain(value.value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, date):
        return value.isoformat()
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return to_plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [to_plain(item) for item in value]
    return value


def format_fixed(value: float, decimals: int = 4, *, sign: bool = False) -> str:
    """A number with fixed decimals; a zero has no sign."""
    text = f"{value:+.{decimals}f}" if sign else f"{value:.{decimals}f}"
    return text.lstrip("+-") if not text.strip("+-0.") else text


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


def _times(ratio: float) -> str:
    return f"{ratio:.0f} times" if ratio >= 9.5 else f"{ratio:.1f} times"
