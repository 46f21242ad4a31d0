"""What stands between the cells of a text, and its lines split by it."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from truearm.wings.importing.tables.cells import is_number

SEPARATORS = {"\t": "tabs", ";": "semicolons", "|": "pipes", ",": "commas", " ": "blanks"}
_ROWS = 2000  # from which unequal numbers of cells are seen
WIDE_BLANKS = "  "
_WIDE_BLANKS = re.compile(r"\t+| {2,}")
_BLANKS = re.compile(r"[ \t]+")
_THOUSANDS = re.compile(r"\s*(?:[+-]?[1-9]\d{0,2}|\d{3}),\d{3}(?!\d)")
# Other ways to write the names, where their line has not as many cells as the rows.
_OF_NAMES = tuple(map(re.compile, (r"[ \t]+", r"\t+|[ \t]{2,}", r"\s*,\s*", r"\s*;\s*", r"\s*\|\s*")))


@dataclass(frozen=True)
class Splitting:
    """How lines become cells.

    Attributes
    ----------
    separator : str
        One character; a blank stands for one blank or tab or more, two for two or more.
    cuts : tuple of int, optional
        Where the columns begin, of a text with columns of fixed width.
    paired : bool
        Whether commas also stand within the numbers, so that every two cells are one.
    grouped : int
        How many cells a row has, if the separator also groups digits; 0 if not.
    """

    separator: str
    cuts: tuple[int, ...] = ()
    paired: bool = False
    grouped: int = 0

    def split(self, lines: Sequence[str]) -> list[list[str]]:
        """Split lines into their cells; in cells that are not quoted blanks stay.

        Raises
        ------
        csv.Error
            If a line cannot be split.
        """
        if self.cuts:
            ends = [*self.cuts[1:], None]
            return [[line[a:b].strip() for a, b in zip(self.cuts, ends, strict=True)] for line in lines]
        if self.separator == WIDE_BLANKS:
            return [_WIDE_BLANKS.split(line.strip()) for line in lines]
        if self.grouped:
            rows = replace(self, grouped=0).split(lines)
            return [self._with_thousands(row) if len(row) > self.grouped else row for row in rows]
        if self.separator == " ":
            if any('"' in line for line in lines):
                stripped = (_BLANKS.sub(" ", line).strip(" ") for line in lines)
                return list(csv.reader(stripped, delimiter=" ", skipinitialspace=True))
            return [line.split() if line.isascii() else _BLANKS.split(line.strip(" \t")) for line in lines]
        rows = list(csv.reader(lines, delimiter=self.separator, skipinitialspace=True))
        if self.paired:
            return [[f"{a},{b}" for a, b in zip(row[::2], row[1::2], strict=False)] for row in rows]
        return rows

    def _with_thousands(self, row: list[str]) -> list[str]:
        """Join cells such as 1 and 234.5, if as many as the row has too many can be."""
        within = [bool(_THOUSANDS.match(f"{a},{b}")) for a, b in pairwise(row)]
        if sum(within) != len(row) - self.grouped:
            return row
        cells = row[:1]
        for joins, cell in zip(within, row[1:], strict=True):
            cells[-1:] = [cells[-1] + self.separator + cell] if joins else [cells[-1], cell]
        return cells

    def strip(self, lines: Sequence[str]) -> list[list[str]]:
        """Split lines into cells without blanks around them."""
        return [[cell.strip() for cell in row] for row in self.split(lines)]

    def split_names(self, line: str, row: Sequence[str], width: int) -> list[str]:
        """Cells of a line above the rows, by another separator if `row` has not a name for each of `width` columns."""
        if len(row) != width or self.cuts:
            for pattern in _OF_NAMES:
                if len(cells := pattern.split(line.strip())) == width and not any(map(is_number, cells)):
                    return [cell.strip().strip('"') for cell in cells]
        return list(row)


def recognise_separator(lines: Sequence[str]) -> str:
    """Return the separator by which most cells of `lines` are numbers, as many in each line."""
    return max(SEPARATORS, key=lambda separator: round(_fitness(lines, separator), 2))


def stands_between_wide_blanks(lines: Sequence[str]) -> bool:
    """Whether all lines have as many cells between two blanks or more, and not between any: names have blanks."""
    wide, any_blank = ({len(row) for row in Splitting(blanks).strip(lines)} for blanks in (WIDE_BLANKS, " "))
    return len(wide) == 1 and len(any_blank) > 1 and max(wide) > 2


def recognise_fixed_width(lines: Sequence[str]) -> tuple[int, ...]:
    """Where the columns begin, if rows that blanks separate have unequal numbers of cells; else nothing."""
    sample = [i for i, line in enumerate(lines[:_ROWS]) if sum(map(is_number, line.split())) > 1]
    counts = {len(lines[i].split()) for i in sample}
    if len(counts) < 2 or any("\t" in lines[i] for i in sample):
        return ()
    rows = [line for line in lines[sample[0] :] if line[0] == " " or is_number(line.split()[-1])]
    filled = np.zeros(max(map(len, rows), default=0) + 1, bool)
    for line in rows:
        filled[: len(line)] |= np.frombuffer(line.encode("utf-32-le"), np.uint32) != ord(" ")
    # A column ends behind its last letter in any line.
    begins = [0, *(np.flatnonzero(filled[:-1] & ~filled[1:])[:-1] + 1).tolist()]
    return tuple(begins) if len(begins) >= max(counts) else ()


def _fitness(lines: Sequence[str], separator: str) -> float:
    """The share of numbers among the cells, in lines that have as many cells as most."""
    rows = Splitting(separator).strip([line for line in lines if len(line) < csv.field_size_limit()])
    numbers: Counter[int] = Counter()
    cells: Counter[int] = Counter()
    for row in rows:
        n = sum(map(is_number, row))
        if n:
            numbers[len(row)] += n
            cells[len(row)] += sum(map(bool, row))
    if not numbers:
        return 0.0
    width = max(numbers, key=lambda length: numbers[length])
    fitting, of_all = cells[width], sum(cells.values())
    return numbers[width] / fitting * (0.5 + 0.5 * fitting / of_all) * (1.0 if width > 1 else 0.5)
