"""The parts of a page: verdict, key numbers, sections of text, rows, figures and tables, data and settings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from truearm.errors import InputError
from truearm.number_format import RoundedNumber
from truearm.pages.cards import CardSet
from truearm.pages.plotting import Figure
from truearm.pages.scene import Scene

Cell = str | int | float | RoundedNumber | None
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

    def __post_init__(self) -> None:
        if not self.sentence.strip():
            raise InputError("expected a verdict in words, got an empty sentence")


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
        if not self.label.strip():
            raise InputError("expected a label for every row, got an empty one")
        _check(self.value, f"row {self.label!r}")
        _check(self.uncertainty, f"uncertainty of row {self.label!r}")
        _check(self.limit, f"limit of row {self.label!r}")
        if self.uncertainty is not None and self.uncertainty < 0:
            raise InputError(f"expected an uncertainty of zero or more in row {self.label!r}, got {self.uncertainty}")


@dataclass(frozen=True)
class Column:
    """The head of a column: its heading, its unit, and the significant digits of its numbers.

    Neighbouring columns of one `group` have a common head, which then shows their unit.
    """

    heading: str
    unit: str = ""
    digits: int = 3
    group: str = ""


@dataclass(frozen=True)
class Table:
    """A table; every row has one cell a column: text, a number, a count (int), or None for an empty cell.

    A `RoundedNumber` is shown to the decimal of its uncertainty, whatever the digits of its column are. Columns without
    any heading have no head. A `fillable` table has room to write by hand. `states` gives rows a colour and a sign, one
    state a row. A `folded` table shows its caption only, until a reader opens it; on paper it is open.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str
    fillable: bool = False
    states: tuple[State, ...] = ()
    folded: bool = False

    def __post_init__(self) -> None:
        if not self.columns:
            raise InputError(f"expected a table with at least one column, got none in {self.caption!r}")
        if self.states and len(self.states) != len(self.rows):
            raise InputError(
                f"expected a state for each of {len(self.rows)} rows of the table {self.caption!r}, "
                f"got {len(self.states)}"
            )
        if self.folded and not self.caption.strip():
            raise InputError("expected a caption for a folded table, got an empty one")
        for number, row in enumerate(self.rows, start=1):
            if len(row) != len(self.columns):
                raise InputError(
                    f"expected {len(self.columns)} cells in row {number} of the table {self.caption!r}, got {len(row)}"
                )
            for column, cell in zip(self.columns, row, strict=True):
                _check(cell, f"row {number} of the table {self.caption!r}", column=column.heading)


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
    mark : str
        Across every sheet of paper; on a screen the verdict says it.
    """

    title: str
    subtitle: str = ""
    summary: tuple[LabelledValue, ...] = ()
    sections: tuple[Section, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    verdict: PageVerdict | None = None
    mark: str = ""


def _check(cell: object, place: str, *, column: str | None = None) -> None:
    if isinstance(cell, RoundedNumber):
        _check(cell.uncertainty, place, column=column)
        cell = cell.value
    if cell is None or isinstance(cell, str | int | np.integer):
        return
    if isinstance(cell, float | np.floating) and math.isfinite(cell):
        return
    raise InputError(
        f"expected a finite number or text in {place}, got {cell!r}", column=column, hint="use None for no value"
    )
