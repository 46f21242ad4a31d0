"""Tables and rows brought into one form: text, and numbers that line up on their decimal point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from truearm.pages.number_format import RoundedNumber, format_exact, format_number, format_uncertainty
from truearm.pages.page import Cell, Column, LabelledValue, Table


@dataclass(frozen=True)
class FormattedCell:
    """A cell as the page shows it; a number is parted at its decimal point."""

    text: str
    whole: str = ""
    fraction: str = ""

    @property
    def is_number(self) -> bool:
        """Whether the cell lines up with its column."""
        return bool(self.whole)


EMPTY_CELL = FormattedCell("\u2013")


@dataclass(frozen=True)
class FormattedTable:
    """Cells in rows under their column heads."""

    heads: tuple[Column, ...]
    rows: tuple[tuple[FormattedCell, ...], ...]
    caption: str = ""
    fillable: bool = False

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
    def decimal_widths(self) -> tuple[int, ...]:
        """For each column, the room right of the decimal point, in characters."""
        if not self.rows:
            return (0,) * len(self.heads)
        return tuple(max(len(cell.fraction) for cell in column) for column in zip(*self.rows, strict=True))


def format_cell(value: Cell, *, uncertainty: float | None = None, digits: int = 3) -> FormattedCell:
    """Give a cell as the page shows it; nothing is a dash."""
    if value is None:
        return EMPTY_CELL
    if isinstance(value, str):
        return FormattedCell(value)
    if isinstance(value, RoundedNumber):
        uncertainty, value = value.uncertainty, value.value
    return _parted(format_number(value, uncertainty=uncertainty, digits=digits))


def grid_of_table(table: Table) -> FormattedTable:
    """Give a table's cells as the page shows them, each with the digits of its column."""
    rows = tuple(
        tuple(format_cell(cell, digits=column.digits) for column, cell in zip(table.columns, row, strict=True))
        for row in table.rows
    )
    return FormattedTable(table.columns, rows, table.caption, table.fillable)


def grid_of_rows(rows: Sequence[LabelledValue]) -> FormattedTable:
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
    return FormattedTable(tuple(heads), tuple(tuple(row[i] for i in keep) for row in cells))


def _of_row(row: LabelledValue) -> tuple[FormattedCell, ...]:
    uncertainty = EMPTY_CELL if row.uncertainty is None else _parted(format_uncertainty(row.uncertainty))
    limit = EMPTY_CELL if row.limit is None else _parted(format_exact(row.limit))
    value = format_cell(row.value, uncertainty=row.uncertainty)
    return FormattedCell(row.label), value, uncertainty, limit, FormattedCell(row.unit or "")


def _parted(number: str) -> FormattedCell:
    whole, point, fraction = number.partition(".")
    return FormattedCell(number, whole, point + fraction)
