"""Where in a file a table stands: lines above it, groups, names, units, rows, and a foot of means or remarks."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

from truearm.wings.importing.tables.cells import is_number, is_value, split_label
from truearm.wings.importing.tables.units import unit_in_name, units_of_row

Row = Sequence[str]

HEAD = 200  # rows from which the form of a table is recognised

# What a row of statistics begins with, without case and without what stands in brackets.
_STATISTICS = re.compile(
    r"(?:mean|average|avg|median|st\.? ?d(?:ev)?|standard|sd|sigma|rms|min(?:imum)?|max(?:imum)?|range|span|sum|total"
    r"|count|mittel(?:wert)?|standardabweichung|stabw|summe|anzahl|spannweite|moyenne|[ée]cart[- ]type|somme|media"
    r"|promedio|desviaci[óo]n|eof|end|平均值?|标准差|最大值|最小值)"
    r"(?: (?:values?|deviation|error|dev\.?|of .*|est[áa]ndar))?\s*(?:[.:=(\[].*)?",
    re.IGNORECASE,
)
_NAME = re.compile(r"\d{0,2}|[^\d.,+-].*")
_MOST_MISSING = 3  # cells at the end of all rows that the header names
_COUNTERS = re.compile(
    r"n[or]?\.?|#|id|i(?:ndex|dx)?|row|line|frame|point|pose|sample|num(?:ber)?|pos(?:ition)?", re.IGNORECASE
)
_GROUP_IDENTIFIERS = ("id", "type")  # rows of a head that name nothing a person would type


@dataclass(frozen=True)
class Layout:
    """Where in rows of cells a table stands.

    Attributes
    ----------
    names, units : tuple of str
        Of the columns; numbers from 1 where there are no names.
    header : int, optional
        Index of the row of names.
    first : int
        Index of the first row of the table.
    unit_row : int, optional
        Index of the row of units.
    group_rows : int
        How many rows above the names hold the names of groups.
    row_names : bool
        Whether the rows have a first cell that the header has not: it counts them.
    unmatched : int, optional
        Index of a row of names that has fewer cells than the rows.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    header: int | None
    first: int
    unit_row: int | None = None
    group_rows: int = 0
    row_names: bool = False
    unmatched: int | None = None


def recognise_layout(rows: Sequence[Row], header: bool | None = None) -> Layout | None:
    """Recognise the head of a table in its first rows; None if no row holds a number.

    Parameters
    ----------
    rows : sequence of sequence of str
        Cells without blanks around them.
    header : bool, optional
        Whether a row names the columns, where a person states it.
    """
    width = table_width(rows)
    if not width:
        return None
    rows = [_filled(row[:width], width) if len(row) > width and not any(row[width:]) else row for row in rows]
    # Names and units are no cells of the columns: of a table with few rows they are the most.
    numeric = numeric_columns(rows[next(i for i, row in enumerate(rows) if any(map(is_number, row))) :], width)
    first = _first_row(rows, numeric, width)
    if header and first == 0:
        first = 1
    above, unit_row = _names_and_units(rows[:first], width)
    longer = len(_trimmed(rows[above])) - width if above is not None else 0
    width += longer if 0 < longer <= _MOST_MISSING and header is not False else 0
    units = _filled(units_of_row(list(rows[unit_row])) or () if unit_row is not None else (), width)
    layout = Layout(tuple(str(i + 1) for i in range(width)), units, None, first, unit_row)
    if header and above is None:
        above = max(first - 1, 0)
    if header is False or above is None:
        return _with_labels(rows, layout)
    cells = list(rows[above])[:width]  # separators behind the last name name nothing
    if row_names := len(cells) == width - 1 and _has_row_names(cells, rows[first:], width):
        cells = ["", *cells]
    if len(cells) < width:
        return replace(layout, unmatched=above)
    names, groups = _with_groups(_filled(cells, width), rows[:above], width, shifted=row_names)
    units = tuple(unit or unit_in_name(name) for unit, name in zip(layout.units, names, strict=True))
    return replace(layout, names=names, units=units, header=above, group_rows=groups, row_names=row_names)


def _names_and_units(above: Sequence[Row], width: int) -> tuple[int | None, int | None]:
    """Indices of the rows of names and of units, among those above the first row of the table."""
    last = len(above) - 1
    for i in range(last, max(last - 3, -1), -1):  # below the units there may be remarks on the columns
        if len(_trimmed(above[i])) <= width and units_of_row(list(above[i])):
            if i and _names_columns(above[i - 1], width):
                return i - 1, i
            if i == last and "[" in "".join(above[i]):
                return None, i
    return (last, None) if above and _names_columns(above[last], width) else (None, None)


def table_width(rows: Sequence[Row]) -> int:
    """The number of columns that most numbers stand in."""
    numbers: Counter[int] = Counter()
    for row in rows:
        numbers[len(row)] += sum(map(is_number, row))
    if not any(numbers.values()):
        return 0
    width = max(numbers, key=lambda length: (numbers[length], length))
    return max(len(_trimmed(row)) for row in rows if len(row) <= width)


def numeric_columns(rows: Sequence[Row], width: int) -> list[int]:
    """Indices of the columns in which most cells of full rows are numbers."""
    full = [row for row in rows if len(row) == width]
    return [
        i
        for i in range(width)
        if (filled := [is_number(row[i]) for row in full if row[i]]) and sum(filled) >= len(filled) / 2
    ]


def foot_length(rows: Sequence[Row], numeric: Sequence[int], width: int) -> int:
    """How many of the last rows are statistics or remarks."""
    for n, row in enumerate(reversed(rows)):
        filled = [cell for cell in row if cell]
        is_remark = width > 2 and len(row) == 1 and not is_value(row[0])
        label = next((cell for cell in filled if not is_value(cell)), "")
        if not (is_remark or _STATISTICS.fullmatch(label) or is_text(row, numeric)):
            return n
    return 0  # a foot is not all there is: these are names


def is_text(row: Row, numeric: Sequence[int]) -> bool:
    """Whether words stand where numbers should, and no number."""
    cells = [row[i] for i in numeric if i < len(row) and row[i]]
    return bool(cells) and not any(is_value(cell) or is_number(cell) for cell in cells)


def _first_row(rows: Sequence[Row], numeric: Sequence[int], width: int) -> int:
    def fits(row: Row, share: float) -> bool:
        cells = [row[i] for i in numeric if i < len(row)]
        if any(not is_value(cell) and not is_number(cell) for cell in cells) and all(map(_NAME.fullmatch, cells)):
            return False  # names such as 1, 2, 3, X, Y, Z
        return len(_trimmed(row)) <= width and sum(map(is_number, cells)) >= max(1, share * len(numeric))

    first = next((i for i, row in enumerate(rows) if fits(row, 0.5)), 0)
    if _counts_columns(rows, first, width):
        return first + 1
    # Above the first full row there may be readings whose point was not seen.
    while (
        first and len(above := rows[first - 1]) == width and fits(above, 0) and all(is_value(above[i]) for i in numeric)
    ):
        first -= 1
    return first


def _counts_columns(rows: Sequence[Row], first: int, width: int) -> bool:
    """Whether a row is 0, 1, 2, .. or 1, 2, 3, .., as programs name columns that have no names."""
    rest = "".join("".join(row) for row in rows[first + 1 : first + 10])
    row = rows[first][1:] if rows[first][:1] == [""] else rows[first]  # above row names there is none
    counted = [[str(i + start) for i in range(len(row))] for start in (0, 1)]
    return width > 3 and list(row) in counted and ("." in rest or "," in rest)


def _names_columns(row: Row, width: int) -> bool:
    cells = row if len(row) <= width else _trimmed(row)
    words = [cell for cell in cells if cell and not is_number(cell)]
    enough = len(cells) in (width, width - 1) or len(words) >= max(2, width / 2)
    fits = enough and len(cells) <= width + _MOST_MISSING and not all(map(is_value, cells))
    return fits and (len(words) >= len(cells) / 2 or (bool(words) and all(map(_NAME.fullmatch, cells))))


def _has_row_names(names: Row, rows: Sequence[Row], width: int) -> bool:
    """Whether the first cells of full rows count them, but no name says that they do."""
    first = [row[0] for row in rows if len(row) == width]
    counted = [[str(i + start) for i in range(len(first))] for start in (0, 1)]
    return len(first) > 2 and first in counted and not _COUNTERS.fullmatch(names[0])


def _with_groups(
    names: tuple[str, ...], above: Sequence[Row], width: int, *, shifted: bool
) -> tuple[tuple[str, ...], int]:
    """Names that stand more than once get those of their groups in front of them; and how many rows these fill."""
    used = 0
    for n, row in enumerate(reversed(above), 1):
        counts = Counter(names)
        repeated = [counts[name] > 1 and bool(name) for name in names]
        if not any(repeated):
            break
        cells = [*([""] * shifted), *_trimmed(row)]
        if len(cells) > width or (sum(map(bool, cells)) < 2 and len(cells) < 2):
            break
        if next((cell for cell in cells if cell), "").casefold() in _GROUP_IDENTIFIERS:
            continue
        groups, current = [], ""
        for cell in _filled(cells, width):
            current = cell or current  # a group's name stands above the first of its columns
            groups.append(current)
        used = n
        names = tuple(
            f"{group} {name}" if more and group else name
            for group, name, more in zip(groups, names, repeated, strict=True)
        )
    return names, used


def _with_labels(rows: Sequence[Row], layout: Layout) -> Layout:
    """Names of a table without a header whose cells carry them: ``A1 -90.0``."""
    full = [row for row in rows[layout.first :] if len(row) == len(layout.names)]
    labels = [{split_label(cell)[0] for cell in column} for column in zip(*full, strict=True)] or [set()]
    names = [label.pop() if len(label) == 1 else "" for label in labels]
    return replace(layout, names=tuple(label or name for label, name in zip_longest(names, layout.names, fillvalue="")))


def _trimmed(row: Row) -> list[str]:
    return list(row[: max((i for i, cell in enumerate(row, 1) if cell), default=0)])


def _filled(cells: Sequence[str], width: int) -> tuple[str, ...]:
    return (*cells, *([""] * (width - len(cells))))
