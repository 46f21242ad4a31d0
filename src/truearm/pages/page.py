"""The parts of a page: verdict, key numbers, sections of text, rows, figures and tables, data and settings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from truearm.errors import InputError
from truearm.number_format import RoundedNumber, format_exact, format_number, format_uncertainty
from truearm.pages.cards import CardSet
from truearm.pages.plotting import Figure
from truearm.pages.scene import Scene


@dataclass(frozen=True)
class FormattedCell:
    """A cell as the page shows it; a number is split at its decimal point."""

    text: str
    whole: str = ""
    fraction: str = ""
    page: str = ""  # a page beside this one, to which the cell links
    remark: str = ""  # below the text, in the first column of a table

    @property
    def is_number(self) -> bool:
        """Whether the cell is aligned with the numbers of its column."""
        return bool(self.whole)


EMPTY_CELL = FormattedCell("\u2013")


Cell = str | int | float | RoundedNumber | FormattedCell | None
State = Literal["good", "doubtful", "bad", "withdrawn", "none"]


@dataclass(frozen=True)
class PageVerdict:
    """The answer that a reader came for, shown first and large, with a sign for its state.

    Parameters
    ----------
    sentence : str
        The verdict in words, or the one number in a sentence; it must be understood without its colour.
    state : {"good", "doubtful", "bad", "none"}
        Colour and sign: green tick, amber question mark, red cross; none is a statement that judges nothing.
    detail : str
        What to do next, or the condition under which the verdict is valid.
    """

    sentence: str
    state: State = "none"
    detail: str = ""


@dataclass(frozen=True)
class LabelledValue:
    """One result: a quantity with its value.

    Parameters
    ----------
    label : str
        The quantity.
    value : float, int or str
        An int is a count; a str is shown unchanged.
    unit : str
        The unit of value, uncertainty and limit.
    uncertainty : float, optional
        Standard uncertainty; it determines how many digits of the value are shown.
    limit : float, optional
        The largest permitted value. It is only shown; the page makes no decision.
    state : {"good", "doubtful", "bad", "none"}
        Colour and sign of the value.
    """

    label: str
    value: Cell
    unit: str = ""
    uncertainty: float | None = None
    limit: float | None = None
    state: State = "none"

    def __post_init__(self) -> None:
        _check(self.value, f"row {self.label!r}")
        _check(self.uncertainty, f"uncertainty of row {self.label!r}")
        _check(self.limit, f"limit of row {self.label!r}")


@dataclass(frozen=True)
class Column:
    """The head of a column: its heading, its unit, and the significant digits of its numbers.

    Neighbouring columns of one `group` have a common head, which then shows their unit.
    """

    heading: str
    unit: str = ""
    digits: int = 3
    group: str = ""

    @staticmethod
    def of(*heads: str | Column) -> tuple[Column, ...]:
        """Columns of headings with their units in brackets, such as ``mean error [mm]``; columns stay as they are."""
        split = (head if isinstance(head, Column) else head.rstrip("]").partition(" [") for head in heads)
        return tuple(one if isinstance(one, Column) else Column(one[0], one[2]) for one in split)


@dataclass(frozen=True)
class Table:
    """A table; every row has one cell a column: text, a number, a count (int), or None for an empty cell.

    A `RoundedNumber` is shown to the decimal of its uncertainty, whatever the digits of its column are. Columns without
    any heading have no head. A `fillable` table has room to write by hand. `states` gives rows a colour and a sign, one
    state a row. A `folded` table shows its caption only, until a reader opens it; on paper it is open. Of a `filtered`
    table those rows are shown that have the words which a reader types, the first `SHOWN_ROWS` of them.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str
    fillable: bool = False
    states: tuple[State, ...] = ()
    folded: bool = False
    filtered: bool = False

    def __post_init__(self) -> None:
        for number, row in enumerate(self.rows, start=1):
            if len(row) != len(self.columns):
                raise InputError(
                    f"expected {len(self.columns)} cells in row {number} of the table {self.caption!r}, got {len(row)}"
                )
            for column, cell in zip(self.columns, row, strict=True):
                _check(cell, f"row {number} of the table {self.caption!r}", column=column.heading)

    @property
    def title(self) -> str:
        """The first sentence of the caption, which a folded table shows."""
        return self.caption.partition(". ")[0]

    @property
    def note(self) -> str:
        """The caption after its first sentence."""
        return self.caption.partition(". ")[2]

    @property
    def groups(self) -> tuple[tuple[Column, int], ...]:
        """Heads in a row, each with the number of columns below it."""
        heads: list[tuple[Column, int]] = []
        for head in self.columns:
            if heads and head.group and heads[-1][0].group == head.group:
                heads[-1] = (heads[-1][0], heads[-1][1] + 1)
            else:
                heads.append((head, 1))
        return tuple(heads)

    @cached_property
    def cells(self) -> tuple[tuple[FormattedCell, ...], ...]:
        """The cells as the page shows them, each with the digits of its column."""
        return tuple(
            tuple(format_cell(cell, digits=column.digits) for column, cell in zip(self.columns, row, strict=True))
            for row in self.rows
        )

    @property
    def numeric(self) -> tuple[bool, ...]:
        """For each column, whether it has a number."""
        return tuple(any(row[k].is_number for row in self.cells) for k in range(len(self.columns)))

    @property
    def decimal_widths(self) -> tuple[int, ...]:
        """For each column, the room right of the decimal point, in characters."""
        return tuple(max((len(row[k].fraction) for row in self.cells), default=0) for k in range(len(self.columns)))


@dataclass(frozen=True)
class Section:
    """A chapter of the page: its verdict, text, scenes, figures, rows, tables and cards, in this order.

    An empty line in `text` starts a paragraph.

    A `folded` section shows its title only, until a reader opens it; on paper it is open.
    """

    title: str
    text: str = ""
    rows: tuple[LabelledValue, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    folded: bool = False
    verdict: PageVerdict | None = None
    scenes: tuple[Scene, ...] = ()
    cards: CardSet | None = None


@dataclass(frozen=True)
class Page:
    """The whole page.

    Parameters
    ----------
    title, subtitle : str
        The subject.
    summary : tuple of LabelledValue
        The few numbers that answer the reader's question, shown large at the top.
    sections : tuple of Section
        In their order on the page.
    facts : tuple of (str, str)
        Data and settings behind the page: versions, fingerprint of the data; folded on a screen.
    verdict : PageVerdict, optional
        What a reader came for; the first line of the page.
    overview : FormattedCell, optional
        Link to the page that lists this one.
    mark : str
        Across every sheet of paper; on a screen the verdict says it.
    """

    title: str
    subtitle: str = ""
    summary: tuple[LabelledValue, ...] = ()
    sections: tuple[Section, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    verdict: PageVerdict | None = None
    overview: FormattedCell | None = None
    mark: str = ""


def _check(cell: object, place: str, *, column: str | None = None) -> None:
    if isinstance(cell, RoundedNumber):
        _check(cell.uncertainty, place, column=column)
        cell = cell.value
    if cell is None or isinstance(cell, str | int | np.integer | FormattedCell):
        return
    if isinstance(cell, float | np.floating) and math.isfinite(cell):
        return
    raise InputError(
        f"expected a finite number or text in {place}, got {cell!r}", column=column, hint="use None for no value"
    )


def format_cell(value: Cell, *, uncertainty: float | None = None, digits: int = 3) -> FormattedCell:
    """A cell as the page shows it; an empty one is a dash."""
    if value is None:
        return EMPTY_CELL
    if isinstance(value, FormattedCell):
        return value
    if isinstance(value, str):
        return FormattedCell(value)
    if isinstance(value, RoundedNumber):
        uncertainty, value = value.uncertainty, value.value
    return _split(format_number(value, uncertainty=uncertainty, digits=digits))


def table_of_rows(rows: Sequence[LabelledValue]) -> Table:
    """Rows as a table: quantity, value, uncertainty and limit if any row has one, unit."""
    columns: dict[str, list[Cell]] = {
        "quantity": [row.label for row in rows],
        "value": [format_cell(row.value, uncertainty=row.uncertainty) for row in rows],
        "standard uncertainty": [
            EMPTY_CELL if row.uncertainty is None else _split(format_uncertainty(row.uncertainty)) for row in rows
        ],
        "limit": [EMPTY_CELL if row.limit is None else _split(format_exact(row.limit)) for row in rows],
        "unit": [row.unit for row in rows],
    }
    for optional in ("standard uncertainty", "limit"):
        if all(cell == EMPTY_CELL for cell in columns[optional]):
            del columns[optional]
    states = tuple(row.state for row in rows)
    return Table(Column.of(*columns), tuple(zip(*columns.values(), strict=True)), "", states=states)


def _split(number: str) -> FormattedCell:
    whole, point, fraction = number.partition(".")
    return FormattedCell(number, whole, point + fraction)
