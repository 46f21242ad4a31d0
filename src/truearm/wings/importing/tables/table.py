"""A table of another program: named columns of numbers or text, with the place of every cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import quoted_cell
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.importing.tables.units import name_without_unit

Place = Literal["line", "row", "record"]


@dataclass(frozen=True)
class TableForm:
    """How a table is written, as far as a person states it; what is None is recognised.

    Parameters
    ----------
    separator, decimal, thousands : str, optional
        One character each; a blank as separator stands for one blank or more; empty thousands: none.
    header : bool, optional
        Whether a line names the columns; without, columns go by number.
    skip_lines : int, optional
        Lines (or rows of a sheet) above the header, or above the first row, that do not belong to the table.
    encoding : str, optional
        Any text encoding that Python knows.
    part : str, optional
        Which sheet of a workbook, array of an archive, or topic of a recording.
    """

    separator: str | None = None
    decimal: str | None = None
    thousands: str | None = None
    header: bool | None = None
    skip_lines: int | None = None
    encoding: str | None = None
    part: str | None = None


@dataclass(frozen=True, eq=False)
class Table:
    """Named columns of one length, as a file or a data frame has them; no meaning is given to them yet.

    Attributes
    ----------
    names : tuple of str
        Names of the columns, or ``1``, ``2``, .. where the file has none.
    units : tuple of str
        Unit of each column as the file writes it; empty where it states none.
    columns : tuple of (n,) arrays
        Numbers, NaN where a cell is empty or says that there is no value; or text, where a cell is no number.
    lines : (n,) int array
        Where each row stands in the file, counted from 1.
    place : {"line", "row", "record"}
        What `lines` count: lines of a text, rows of a sheet, records of an array or a log.
    file : Path, optional
        None for a data frame.
    header_line : int, optional
        Where the names stand.
    assumed : tuple of str
        What was recognised and may surprise, a phrase each, such as ``decimal comma``.
    questions : mapping of int to InputError
        Columns whose cells have two readings, and what a person must state before they are used.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: tuple[FloatArray | NameArray, ...]
    lines: IntArray
    place: Place = "line"
    file: Path | None = None
    header_line: int | None = None
    assumed: tuple[str, ...] = ()
    questions: Mapping[int, InputError] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.lines)

    def rows(self, chosen: IntArray | slice) -> Table:
        """Return a table of the rows `chosen`."""
        columns = tuple(column[chosen] for column in self.columns)
        return replace(self, columns=columns, lines=self.lines[chosen])

    def numbers(self, index: int) -> FloatArray:
        """Return a column as (n,) numbers, NaN where a cell is empty.

        Raises
        ------
        InputError
            If a cell holds text, or may be two numbers; with its place.
        """
        if index in self.questions:
            raise self.questions[index]
        column = self.columns[index]
        if column.dtype.kind == "f":
            return np.asarray(column, dtype=float)
        values = np.full(len(column), np.nan)
        for row, cell in enumerate(column.tolist()):
            if not cell.strip():
                continue
            try:
                values[row] = float(cell)
            except ValueError:
                values[row] = np.inf
            if np.isinf(values[row]) or "_" in cell:  # Python reads 1_000
                raise self.error(f"expected a number, got {quoted_cell(cell)}", row, column=index)
        return values

    def words(self, index: int) -> NameArray:
        """Return a column as (n,) text; whole numbers are written without a decimal point."""
        column = self.columns[index]
        if column.dtype.kind == "U":
            return np.asarray(column, dtype=np.str_)
        return np.array(["" if v != v else f"{v:.15g}" for v in column.tolist()], dtype=np.str_)

    def error(
        self, problem: str, row: int | None = None, *, column: int | None = None, hint: str | None = None
    ) -> InputError:
        """Make an error that states the file and the place of `row` (counted from 0), or of the header."""
        line = self.header_line if row is None else int(self.lines[row])
        name = None if column is None else self.names[column]
        if self.place == "line" or line is None:
            return InputError(problem, file=self.file, line=line, column=name, hint=hint)
        return InputError(problem, file=self.file, row=f"{self.place} {line}", column=name, hint=hint)

    def index(self, column: str) -> int:
        """Return the index of a column, given by its name, without its unit too, or by its number counted from 1.

        Raises
        ------
        InputError
            If there is none, or several have the name.
        """
        found, said = columns_named(self.names, column), quoted_cell(column.strip())
        if len(found) > 1:
            numbers = " and ".join(str(i + 1) for i in found)
            raise self.error(f"{said} names columns {numbers}", hint="give its number")
        if found:
            return found[0]
        hint = "give a column by its number if its name is hard to type"
        raise self.error(f"there is no column {said}; the columns are {listed(self.names)}", hint=hint)


def columns_named(names: Sequence[str], column: str) -> list[int]:
    """Indices of the columns that have a name, also in other case or without its unit, or else that number from 1."""
    name = column.strip()
    for form in (str, str.casefold, name_without_unit):
        if found := [i for i, n in enumerate(names) if form(n) == form(name)]:
            return found
    return [int(name) - 1] if name.isdecimal() and 1 <= int(name) <= len(names) else []


def unreadable(path: Path, what: str, error: BaseException, hint: str) -> InputError:
    """A file that a library cannot read, with the first line of its reason."""
    reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
    return InputError(f"expected {what}, got one that cannot be read ({reason})", file=path, hint=hint)


def listed(names: Sequence[str], most: int = 30) -> str:
    """Names of columns for a message, not too many."""
    if names[:1] == ("1",):
        return f"1 .. {len(names)}"
    text = ", ".join(name or "''" for name in names[:most])
    shortened = text if len(text) <= 600 else f"{text[:600]}.."
    return shortened + (f" and {len(names) - most} more" if len(names) > most else "")
