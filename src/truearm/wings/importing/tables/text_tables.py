"""Tables of text: what stands between the cells of their lines, and named columns of numbers or words.

The headers of LabVIEW's text files (.lvm) state how numbers are written: National Instruments, "Specification for the
LabVIEW Measurement File (.lvm)".
"""

from __future__ import annotations

import csv
import re
from bisect import bisect
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import MAX_BYTES, as_utf8, quoted_cell
from truearm.files.file_reading import read_limited, recognise_encoding
from truearm.wings.importing.tables.cell_rows import CellRows, table_of_rows
from truearm.wings.importing.tables.cells import is_number
from truearm.wings.importing.tables.layout import HEAD, Layout, recognise_layout, table_width
from truearm.wings.importing.tables.table import Table, TableForm

SEPARATORS = {"\t": "tabs", ";": "semicolons", "|": "pipes", ",": "commas", " ": "blanks"}
_ROWS = 2000  # from which unequal numbers of cells are seen
WIDE_BLANKS = "  "
_WIDE_BLANKS = re.compile(r"\t+| {2,}")
_BLANKS = re.compile(r"[ \t]+")
_GROUPED_BY_COMMAS = re.compile(r"\s*(?:[+-]?[1-9]\d{0,2}|\d{3}),\d{3}(?!\d)")
_COMMENT = re.compile(r"\s*(?:#(?!N/A|DIV)|%|//|!)+")
_SEPARATOR_LINE = re.compile(r"\"?sep=(.)\"?\s*", re.IGNORECASE)
# Around several numbers, with labels or not.
_BRACKETS = re.compile(r"[\[({]\s*(?:[\"']?[A-Za-z]\w*[\"']?:?\s+)?[+-]?[\d.]+\s*[,;\s]\s*[^\s\])}]")
_ASSIGNED = re.compile(r"^[^\[({]*(?::=|=|:)\s*(?=[\[({])")
_DIGITS = re.compile(r"[+-]?\d+")
_FRACTION = re.compile(r"^[^.,]*[.,]?")  # all before the decimals
_LONGEST_QUOTE = 20  # lines
_THOUSANDS = (".", ",", "'", "\u2019", " ", "\u00a0", "\u202f")
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
        within = [bool(_GROUPED_BY_COMMAS.match(f"{a},{b}")) for a, b in pairwise(row)]
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


@dataclass
class TextLines:
    """Lines of a text that may belong to a table.

    Attributes
    ----------
    lines : list of str
    numbers : list of int
        Where each stands in the file, counted from 1.
    comments : list of (int, str)
        Lines of remarks, without their mark.
    cut_off : bool
        Whether the last line has no end.
    separator : str, optional
        Stated by a person, or by the first line.
    assumed : list of str
    """

    lines: list[str]
    numbers: list[int]
    comments: list[tuple[int, str]]
    cut_off: bool
    separator: str | None
    assumed: list[str]


def read_text_table(path: Path, form: TableForm) -> Table:
    """Read a table of text; what `form` does not state is recognised.

    Raises
    ------
    InputError
        If the file is missing, too large, binary or no table, or a row does not fit; with the line and what to do.
    """
    _check_form(form)
    data = read_limited(path, limit_bytes=MAX_BYTES)
    encoding = form.encoding or recognise_encoding(data)
    text = as_utf8(data, path, encoding, hint="--encoding, such as cp1252, gb18030, shift_jis or utf-16").decode()
    del data
    found = _lines(text, form)
    if encoding != "utf-8" and form.encoding is None:
        found.assumed.insert(0, f"encoding {encoding}")
    del text
    try:
        return _table(found, path, form)
    except csv.Error as error:
        longest = max(range(len(found.lines)), key=lambda i: len(found.lines[i]))
        problem, hint = f"the line cannot be split into cells ({error})", 'close the quotation mark (")'
        raise InputError(problem, file=path, line=found.numbers[longest], hint=hint) from None


def _check_form(form: TableForm) -> None:
    separator, decimal = form.separator, form.decimal
    if separator is not None and (len(separator) != 1 or separator in '\r\n"' or separator.isalnum()):
        raise InputError(f"the separator must be one character such as , or ; got {quoted_cell(separator)}")
    if decimal not in (None, ".", ","):
        raise InputError(f"the decimal sign must be . or , got {quoted_cell(decimal)}")
    if form.thousands not in (None, "", *_THOUSANDS):
        hint = "--thousands ',' or '.', an apostrophe or a blank; '' for none"
        raise InputError(f"the thousands separator cannot be {quoted_cell(form.thousands)}", hint=hint)
    if decimal is not None and decimal == form.thousands:
        hint = f"--decimal '{decimal}' --thousands ''"
        raise InputError(f"the decimal sign and the thousands separator are both {decimal!r}", hint=hint)


def _table(found: TextLines, path: Path, form: TableForm) -> Table:
    splitting = _splitting(found, form)
    if splitting.separator != ";":
        _take_comments(found, re.compile(r"\s*;+"))
    _join_quoted(found, path, splitting)
    layout = recognise_layout(head := _head(found, splitting), form.header)
    are_paired = layout is not None and splitting.separator == "," and _are_paired(head, layout)
    if form.decimal == splitting.separator and not are_paired and not any('"' in line for line in found.lines[:HEAD]):
        problem, other = (
            f"the separator and the decimal sign are both {form.decimal!r}",
            {",": "."}.get(form.decimal, ","),
        )
        raise InputError(problem, file=path, hint=f"--separator ';', or --decimal {other}")
    if layout is None:
        line, hint = next(iter(found.numbers), None), "--skip-lines 0" if form.skip_lines else None
        raise InputError("expected rows of numbers, got none", file=path, line=line, hint=hint)
    if form.thousands == splitting.separator and (names := _n_names(head)):
        splitting = replace(splitting, grouped=names)
        found.assumed.append(f"thousands also between {SEPARATORS.get(form.thousands, form.thousands)}")
    elif are_paired:
        splitting = replace(splitting, paired=True)
        found.assumed.append("commas also within numbers")
    elif layout.header is None and form.header is not False:
        _insert_comments(found, splitting, layout)
    if found.comments:
        n = len(found.comments)
        found.assumed.append(f"{n} comment line{'s' * (n > 1)}")
    if found.cut_off and _is_cut_off(splitting.split(found.lines[-HEAD:]), len(layout.names)):
        found.assumed.append(f"line {found.numbers.pop()} is cut off: ignored")
        found.lines.pop()
    rows = CellRows(
        found.numbers,
        lambda start, stop: splitting.split(found.lines[start:stop]),
        _head(found, splitting, layout.first),
        may_be_short=bool(splitting.separator.strip(" ")),  # between blanks any cell may be missing
        point_is_decimal=splitting.separator == "," and not splitting.paired,
    )
    return table_of_rows(rows, path, form, "line", found.assumed)


def _head(found: TextLines, splitting: Splitting, names: int = 0) -> list[list[str]]:
    """Cells of the first lines without blanks; in the first of them, of names, no commas stand within cells."""
    lines = found.lines[:HEAD]
    rows = splitting.strip(lines)
    if splitting.paired:
        rows[:names] = replace(splitting, paired=False).strip(lines[:names])
    width = table_width(rows)
    return [splitting.split_names(line, row, width) for line, row in zip(lines, rows, strict=True)]


def _lines(text: str, form: TableForm) -> TextLines:
    """Lines that may belong to the table."""
    every = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    skipped, separator = form.skip_lines or 0, form.separator
    if match := _SEPARATOR_LINE.fullmatch(every[0]):
        skipped, separator = max(skipped, 1), separator or match[1]
    numbers = [i for i, line in enumerate(every, 1) if i > skipped and not _is_empty(line)]
    lines = every if len(numbers) == len(every) else [every[i - 1] for i in numbers]
    if lines and all(line[0] == "|" == line.rstrip()[-1] for line in lines):  # a table of Markdown
        lines = [line.rstrip()[1:-1] for line in lines]
    found = TextLines(lines, numbers, [], bool(every[-1].strip()), separator, [])
    _take_comments(found, _COMMENT)
    return found


def _is_empty(line: str) -> bool:
    """Whether a line holds nothing, or a ruler."""
    return not line.strip("-=+|:_* \t") and (not line.strip() or "---" in line or "===" in line)


def _take_comments(found: TextLines, mark: re.Pattern[str]) -> None:
    """Move lines that begin with a mark of comments to the comments."""
    match = mark.match
    if marked := [i for i, line in enumerate(found.lines) if line and not line[0].isalnum() and match(line)]:
        taken = set(marked)
        rest = (line for i, line in enumerate(found.lines) if i not in taken)
        if not any(is_number(cell) for line in islice(rest, HEAD) for cell in re.split(r"[,;\t| ]+", line)):
            return  # the mark belongs to the rows
        found.comments += [(found.numbers[i], mark.sub("", found.lines[i], count=1)) for i in marked]
        found.numbers = [number for i, number in enumerate(found.numbers) if i not in taken]
        found.lines = [line for i, line in enumerate(found.lines) if i not in taken]


def _insert_comments(found: TextLines, splitting: Splitting, layout: Layout) -> None:
    """Let comments above the first row that name columns or units be lines of the table."""
    above = [(n, line) for n, line in found.comments if n < found.numbers[layout.first]]
    width, chosen = len(layout.names), []
    for number, line in above:
        cells = splitting.split_names(line, splitting.strip([line])[0], width)
        if len(cells) == width and not any(map(is_number, cells)):
            chosen.append((number, line))
    for number, line in chosen[-2:]:
        found.comments.remove((number, line))
        at = bisect(found.numbers, number)
        found.numbers.insert(at, number)
        found.lines.insert(at, line)


def _splitting(found: TextLines, form: TableForm) -> Splitting:
    lines, n = found.lines, len(found.lines)
    sample = lines[:HEAD] + lines[max(HEAD, n - 20) :]
    if sum(bool(_BRACKETS.search(line)) for line in sample) > 0.8 * len(sample) > 0:
        found.lines[:] = map(_without_brackets, lines)
        sample = list(map(_without_brackets, sample))
        found.assumed.append("brackets around the numbers")
    separator = found.separator or recognise_separator(sample)
    if separator == " " and stands_between_wide_blanks(sample):
        separator = WIDE_BLANKS
    if separator == " " and (cuts := recognise_fixed_width(found.lines)):
        found.assumed.append("columns of fixed width")
        return Splitting(separator, cuts)
    if form.separator is None and separator != ",":
        found.assumed.append(SEPARATORS.get(separator[0], f"separator {separator}"))
    return Splitting(separator)


def _without_brackets(line: str) -> str:
    line = re.sub(r"[\])}]\s*,?\s*[\[({]", ",", _ASSIGNED.sub("", line))
    return re.sub(r"[\[\](){}]", "", line).strip().rstrip(";,")


def _join_quoted(found: TextLines, path: Path, splitting: Splitting) -> None:
    """Make one line of those between which a quoted cell goes on."""
    if splitting.separator[0] == " " or not any(line.count('"') % 2 for line in found.lines):
        return
    reader = csv.reader((f"{line}\n" for line in found.lines), delimiter=splitting.separator, skipinitialspace=True)
    lines, numbers, begin = [], [], 0
    for _ in reader:
        end = reader.line_num
        if end - begin > _LONGEST_QUOTE:
            line = found.numbers[begin]
            raise InputError("a quoted cell does not end", file=path, line=line, hint='close the quotation mark (")')
        lines.append(" ".join(found.lines[begin:end]))
        numbers.append(found.numbers[begin])
        begin = end
    found.lines, found.numbers = lines, numbers


def _are_paired(head: list[list[str]], layout: Layout) -> bool:
    """Whether commas stand between cells and within their numbers: every number is in two cells."""
    body, width = head[layout.first :], len(head[layout.first])
    if any(len(row) != width or not all(map(_DIGITS.fullmatch, row)) for row in body) or width % 2:
        return False
    fractions = [cell for row in body for cell in row[1::2]]
    if not all(map(str.isdecimal, fractions)):
        return False
    named = layout.unmatched is not None and 2 * len(head[layout.unmatched]) == width
    return named or any(cell[0] == "0" and len(cell) > 1 for cell in fractions)


def _n_names(head: list[list[str]]) -> int:
    """How many cells the line of names has; 0 if there is none."""
    return next((len(row) for row in reversed(head) if len(row) > 1 and not any(map(is_number, row))), 0)


def _is_cut_off(rows: list[list[str]], width: int) -> bool:
    """Whether the last row ends before the others do: it lacks cells, or decimals that all others have."""
    *others, last = rows
    full = [row for row in others if len(row) >= width]
    if len(last) < width:
        return len(full) == len(others) > 1
    if not any(row[width - 1].strip().endswith("0") for row in full):  # as many decimals as a number needs
        return False
    decimals = {len(_FRACTION.sub("", row[width - 1].strip())) for row in full[1:]}
    return len(full) > 3 and len(decimals) == 1 and len(_FRACTION.sub("", last[width - 1].strip())) < decimals.pop()


_END = "***End_of_Header***"


def read_labview_table(path: Path, form: TableForm) -> Table:
    """Read the rows below the last header of a LabVIEW file, with the separator and the decimal sign that it states.

    Raises
    ------
    InputError
        If it has several segments, each with a header of its own, or is no table below it.
    """
    lines = read_limited(path, limit_bytes=MAX_BYTES).decode("latin-1").splitlines()
    ends = [i for i, line in enumerate(lines) if line.strip().startswith(_END)]
    if not ends:
        raise InputError(f"expected the line {_END} of a LabVIEW file, got none", file=path)
    if len(ends) > 2:
        hint = "write the file with 'One header only', or save one segment"
        raise InputError(f"the file has {len(ends) - 1} segments", file=path, line=ends[2] + 1, hint=hint)
    stated = dict(line.split(maxsplit=1) for line in lines[: ends[0]] if len(line.split(maxsplit=1)) == 2)
    separator = {"Tab": "\t", "Comma": ","}.get(stated.get("Separator", ""))
    decimal = stated.get("Decimal_Separator", "").strip() or None
    form = replace(
        form,
        separator=form.separator or separator,
        decimal=form.decimal or decimal,
        skip_lines=ends[-1] + 1 if form.skip_lines is None else form.skip_lines,
    )
    return read_text_table(path, form)
