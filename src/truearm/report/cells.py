"""Tables and rows brought into one form: text, and numbers that line up on their decimal point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from truearm.report.page import Cell, Column, Row, Table
from truearm.report.quantities import Rounded, format_given, format_number, format_uncertainty


@dataclass(frozen=True)
class Shown:
    """A cell as the page shows it; a number is parted at its decimal point."""

    text: str
    whole: str = ""
    fraction: str = ""

    @property
    def is_number(self) -> bool:
        """Whether the cell lines up with its column."""
        return bool(self.whole)


NOTHING = Shown("\u2013")


@dataclass(frozen=True)
class Grid:
    """Cells in rows under their column heads."""

    heads: tuple[Column, ...]
    rows: tuple[tuple[Shown, ...], ...]
    caption: str = ""
    to_fill: bool = False

    @property
    def numeric(self) -> tuple[bool, ...]:
        """For each column, whether it has a number."""
        if not self.rows:
            return (False,) * len(self.heads)
        return tuple(any(cell.is_number for cell in column) for column in zip(*self.rows, strict=True))

    @property
    def groups(self) -> tuple[tuple[Column, int], ...]:
        """Heads in a row, each with the number of columns below it; a column without a group stands alone."""
        heads: list[tuple[Column, int]] = []
        for head in self.heads:
            if heads and head.group and heads[-1][0].group == head.group:
                heads[-1] = (heads[-1][0], heads[-1][1] + 1)
            else:
                heads.append((head, 1))
        return tuple(heads)

    @property
    def room(self) -> tuple[int, ...]:
        """For each column, the room right of the decimal point, in characters."""
        if not self.rows:
            return (0,) * len(self.heads)
        return tuple(max(len(cell.fraction) for cell in column) for column in zip(*self.rows, strict=True))


def shown(value: Cell, *, uncertainty: float | None = None, digits: int = 3) -> Shown:
    """Give a cell as the page shows it; nothing is a dash."""
    if value is None:
        return NOTHING
    if isinstance(value, str):
        return Shown(value)
    if isinstance(value, Rounded):
        uncertainty, value = value.uncertainty, value.value
    return _parted(format_number(value, uncertainty=uncertainty, digits=digits))


def grid_of_table(table: Table) -> Grid:
    """Give a table's cells as the page shows them, each with the digits of its column."""
    rows = tuple(
        tuple(shown(cell, digits=column.digits) for column, cell in zip(table.columns, row, strict=True))
        for row in table.rows
    )
    return Grid(table.columns, rows, table.caption, table.to_fill)


def grid_of_rows(rows: Sequence[Row]) -> Grid:
    """Give rows as a table: quantity, value, what is known of uncertainty and limit, unit."""
    with_uncertainty = any(row.uncertainty is not None for row in rows)
    with_limit = any(row.limit is not None for row in rows)
    heads, cells = [Column("quantity"), Column("value")], [_of_row(row) for row in rows]
    keep = [0, 1]
    if with_uncertainty:
        heads.append(Column("standard uncertainty"))
        keep.append(2)
    if with_limit:
        heads.append(Column("limit"))
        keep.append(3)
    heads.append(Column("unit"))
    keep.append(4)
    return Grid(tuple(heads), tuple(tuple(row[i] for i in keep) for row in cells))


def _of_row(row: Row) -> tuple[Shown, ...]:
    uncertainty = NOTHING if row.uncertainty is None else _parted(format_uncertainty(row.uncertainty))
    limit = NOTHING if row.limit is None else _parted(format_given(row.limit))
    value = shown(row.value, uncertainty=row.uncertainty)
    return Shown(row.label), value, uncertainty, limit, Shown(row.unit or "")


def _parted(number: str) -> Shown:
    whole, point, fraction = number.partition(".")
    return Shown(number, whole, point + fraction)
