"""Two tables joined into one: row by row, by the numbers of their rows, or by a column of names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import quoted_cell
from truearm.typing import FloatArray, IntArray
from truearm.wings.importing.foreign.clock_offset import ClockOffset
from truearm.wings.importing.foreign.time_columns import time_columns
from truearm.wings.importing.tables.table import Table, listed

# Names of columns that number the rows, and of columns that name them.
# fmt: off
NUMBERS = {"", "#", "no", "no.", "nr", "nr.", "n", "i", "idx", "index", "row", "number", "sample", "id", "seq",
           "unnamed: 0", "序号", "编号", "p", "pt", "point", "pose", "reading", "punkt"}
NAMES = {"name", "point", "pointname", "pose", "posename", "pt", "target", "label", "punkt", "pos", "position", "点名",
         "点号"}
# fmt: on
# Rows that repeat each other lie so much closer together than different ones, at least.
REPEATS = 0.02


@dataclass(frozen=True, eq=False)
class JoinedTable(Table):
    """A table of angles with the columns of a table of points beside it; faults name the file that has them.

    Attributes
    ----------
    points : Table
        Rows of the second table, one for each row of this one; its columns are the last ones here, under its own
        names or, where both have a name, with the stem of its file before it.
    clock : ClockOffset, optional
        Offset and drift of the clocks of two logs.
    """

    points: Table | None = None
    clock: ClockOffset | None = None

    def rows(self, chosen: IntArray | slice) -> JoinedTable:
        """Return a table of the rows `chosen`."""
        rows = super().rows(chosen)
        assert isinstance(rows, JoinedTable)
        assert self.points is not None
        return replace(rows, points=self.points.rows(chosen))

    def error(
        self, problem: str, row: int | None = None, *, column: int | None = None, hint: str | None = None
    ) -> InputError:
        """Make an error that states the file, and the place of `row` in it, of the table that has the column."""
        assert self.points is not None
        first = len(self.names) - len(self.points.names)
        if column is not None and column >= first:
            return self.points.error(problem, row, column=column - first, hint=hint)
        return super().error(problem, row, column=column, hint=hint)


def beside(joints: Table, points: Table, assumed: Sequence[str]) -> JoinedTable:
    """Put two tables of as many rows side by side."""
    known = {name.casefold() for name in joints.names}
    stem = points.file.stem if points.file is not None else "points"
    names = [f"{stem} {name}" if name.casefold() in known else name for name in points.names]
    if joints.names[:1] == points.names[:1] == ("1",):
        names = [str(len(known) + i + 1) for i in range(len(names))]
    return JoinedTable(
        (*joints.names, *names),
        (*joints.units, *points.units),
        (*joints.columns, *points.columns),
        joints.lines,
        joints.place,
        joints.file,
        joints.header_line,
        tuple(dict.fromkeys((*joints.assumed, *points.assumed, *assumed))),
        {**joints.questions, **{len(joints.names) + i: question for i, question in points.questions.items()}},
        points=points,
    )


# Row by row ----------------------------------------------------------------------------------------------------------


def join_by_row(joints: Table, points: Table) -> JoinedTable:
    """Join tables row by row, or by the numbers that both give their rows.

    Columns that number the rows and columns of times are no readings: they count for nothing but, where both tables
    number their rows with gaps or in another order, to find the rows of one number. A table that repeats each row of
    the other equally often is recognised where the repeats are visible.

    Raises
    ------
    InputError
        If the tables have unequal numbers of rows and nothing says which belong together.
    """
    numbers = [row_numbers(table) for table in (joints, points)]
    if numbers[0] is not None and numbers[1] is not None and not (_counts(numbers[0]) and _counts(numbers[1])):
        return _by_numbers(joints, points, numbers[0], numbers[1])
    n, m = len(joints), len(points)
    if n == m and (shared := _names_in_another_order(joints, points)):
        raise joints.error(
            f"columns {shared[0]} and {shared[1]} name the same rows in another order",
            hint=f"--by name, or --by '{shared[0]}={shared[1]}'",
        )
    if n == m and n > 0:
        return beside(joints, points, ("row by row",))
    if min(n, m) > 0 and max(n, m) % min(n, m) == 0 and (pattern := _repeats(joints if n > m else points, min(n, m))):
        several = np.arange(min(n, m))
        rows = np.repeat(several, max(n, m) // len(several)) if pattern == "rows" else np.resize(several, max(n, m))
        said = (
            f"each row of {named(points if n > m else joints)} for {max(n, m) // len(several)} rows of the other file"
        )
        pair = (joints, points.rows(rows)) if n > m else (joints.rows(rows), points)
        return beside(*pair, (said, "rows repeat each other one after the other" if pattern == "rows" else "in rounds"))
    less = joints if n < m else points
    raise less.error(
        f"{named(joints)} has {n} rows and {named(points)} {m}: {named(less)} lacks {abs(n - m)}, nothing says which",
        hint="--by name (a column names the poses in both files) or --by time (both have times)",
    )


def row_numbers(table: Table) -> IntArray | None:
    """The numbers that a table gives its rows, if a column does nothing else; None if there is none."""
    for i, column in numeric_columns(table).items():
        if len(column) < 2 or not _whole(column):
            continue
        is_named = table.names[i].strip().casefold() in NUMBERS and len(np.unique(column)) == len(column)
        if _counts(column) or is_named:
            return column.astype(np.intp)
    return None


def _counts(numbers: FloatArray | IntArray) -> bool:
    """Whether numbers only count the rows, from 0 or 1."""
    return bool(numbers[0] in (0, 1) and (np.diff(numbers) == 1).all())


def _by_numbers(joints: Table, points: Table, of_joints: IntArray, of_points: IntArray) -> JoinedTable:
    if (of_joints.min() == 0) != (of_points.min() == 0) and max(of_joints.max(), of_points.max()) < max(
        len(of_joints), len(of_points)
    ):  # one of them counts from 0, and nothing says which rows the other counts
        raise points.error(
            f"{named(joints)} numbers its rows from {of_joints.min()} to {of_joints.max()} and {named(points)} from "
            f"{of_points.min()} to {of_points.max()}: one may count from 0 and the other from 1",
            hint="number the rows of both files from 1, or name the column whose numbers are those of the other: "
            "--by COLUMN",
        )
    both, i, j = np.intersect1d(of_joints, of_points, return_indices=True)
    if not len(both):
        raise points.error(
            f"{named(joints)} numbers its rows from {of_joints.min()} to {of_joints.max()} and {named(points)} from "
            f"{of_points.min()} to {of_points.max()}: no number is in both",
            hint="--by time, or --by name",
        )
    order = np.argsort(i)
    said = ["rows by their numbers", *_only_in(joints, len(of_joints) - len(both), points, len(of_points) - len(both))]
    return beside(joints.rows(i[order]), points.rows(j[order]), said)


def _repeats(table: Table, n: int) -> str | None:
    """Whether rows repeat each other one after the other ("rows"), or in rounds through n rows ("rounds")."""
    times = time_columns(table)
    numbers = [c for i, c in numeric_columns(table).items() if i not in times and np.isfinite(c).all()]
    data = [column for column in numbers if not _counts(column)]
    if not data or n < 2:
        return None
    values = np.stack([c / max(float(np.ptp(c)), np.finfo(float).tiny) for c in data], axis=1)
    found = []
    for pattern, groups in (
        ("rows", values.reshape(n, -1, len(data))),
        ("rounds", values.reshape(-1, n, len(data)).swapaxes(0, 1)),
    ):
        within = np.ptp(groups, axis=1).max(axis=1)
        between = np.abs(np.diff(groups.mean(axis=1), axis=0)).max(axis=1)
        if within.max() <= REPEATS * np.median(between):
            found.append(pattern)
    return found[0] if len(found) == 1 else None


# By name -------------------------------------------------------------------------------------------------------------


def join_by_name(joints: Table, points: Table, columns: str | None = None) -> JoinedTable:
    """Join the rows of one name; differences of case and blanks do not count.

    Parameters
    ----------
    joints, points : Table
    columns : str, optional
        The column of names in both tables, or two as ``pose=point``; recognised by default.

    Raises
    ------
    InputError
        If no column of each holds the names of the other, or a name is on unequal numbers of rows.
    """
    if columns is not None:
        of_joints, _, of_points = columns.partition("=")
        i, j = joints.index(of_joints), points.index(of_points or of_joints)
    else:
        i, j = _columns_of_names(joints, points)
    first, second = ([_plain(name) for name in t.words(c).tolist()] for t, c in ((joints, i), (points, j)))
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(second):
        rows.setdefault(name, []).append(row)
    often, place, pairs = Counter(first), Counter[str](), []
    for row, name in enumerate(first):
        there = rows.get(name, []) if name else []
        if len(there) > 1 and often[name] not in (1, len(there)):
            raise joints.error(
                f"{quoted_cell(str(joints.words(i)[row]))} is on {often[name]} rows here and on {len(there)} in "
                f"{named(points)}: which rows belong together is not known",
                row, column=i, hint="as many rows of a name in both files, in the same order, or one in either",
            )  # fmt: skip
        if often[name] == len(there):
            there = [there[place[name]]]
            place[name] += 1
        pairs += [(row, other) for other in there]
    if not pairs:
        raise joints.error(
            f"column {joints.names[i]!r} and column {points.names[j]!r} of {named(points)} have no name in common",
            column=i, hint="--by COLUMN, or --by COLUMN=COLUMN where the names of the columns differ",
        )  # fmt: skip
    kept, other = np.array(pairs, dtype=np.intp).T
    said = [f"rows by the names in columns {joints.names[i]!r} and {points.names[j]!r}"]
    if set(np.char.strip(joints.words(i)[kept]).tolist()) != set(np.char.strip(points.words(j)[other]).tolist()):
        said.append("names that differ in case or blanks only are one name")
    lacking = [sum(name not in set(b) for name in a) for a, b in ((first, second), (second, first))]
    said += _only_in(joints, lacking[0], points, lacking[1])
    return beside(joints.rows(kept), points.rows(other), said)


def _names_in_another_order(joints: Table, points: Table) -> tuple[str, str] | None:
    """Columns of text that share most of their names, but not row by row."""
    for i, one in enumerate(joints.columns):
        for j, other in enumerate(points.columns):
            if one.dtype.kind != "U" or other.dtype.kind != "U" or len(set(one.tolist())) < 3:
                continue
            shared = len({*map(_plain, one.tolist())} & {*map(_plain, other.tolist())})
            in_order = sum(_plain(a) == _plain(b) for a, b in zip(one.tolist(), other.tolist(), strict=True))
            if 2 * shared > len(set(one.tolist())) and in_order < len(joints):
                return joints.names[i], points.names[j]
    return None


def _columns_of_names(joints: Table, points: Table) -> tuple[int, int]:
    found = []
    for i in _candidates(joints):
        for j in _candidates(points):
            one, two = ({_plain(w) for w in t.words(c).tolist()} - {""} for t, c in ((joints, i), (points, j)))
            found.append((len(one & two) / max(1, min(len(one), len(two))), min(len(one), len(two)), i, j))
    found.sort(reverse=True)
    if not found or found[0][0] < 0.5:
        raise points.error(
            f"no column holds names that are in both files; the columns are {listed(joints.names)} and "
            f"{listed(points.names)}",
            hint="--by COLUMN, or --by COLUMN=COLUMN where the names of the columns differ",
        )
    if len(found) > 1 and found[0][:2] == found[1][:2]:
        several = " or ".join(f"{joints.names[i]}={points.names[j]}" for _, _, i, j in found[:2])
        raise points.error(f"the names may be those of the columns {several}", hint=f"--by {several.split(' or ')[0]}")
    return found[0][2:]


def _candidates(table: Table) -> list[int]:
    """Columns of text that are no times, and columns of whole numbers whose name says that they name the rows."""
    times, whole = time_columns(table), [i for i, c in numeric_columns(table).items() if _whole(c)]
    named_so = [i for i in whole if table.names[i].strip().casefold().replace(" ", "") in NAMES | NUMBERS]
    text = [i for i, column in enumerate(table.columns) if column.dtype.kind == "U" and i not in times]
    return text + named_so


def numeric_columns(table: Table) -> dict[int, FloatArray]:
    """The columns of numbers, by their indices."""
    return {i: np.asarray(column, dtype=float) for i, column in enumerate(table.columns) if column.dtype.kind == "f"}


def _whole(column: FloatArray) -> bool:
    return bool(np.isfinite(column).all() and (column == np.round(column)).all() and np.abs(column).max() < 2**31)


def _plain(name: str) -> str:
    return "".join(name.split()).casefold()


def _only_in(joints: Table, n: int, points: Table, m: int) -> list[str]:
    return [f"{rows_said(k)} only in {named(table)} skipped" for table, k in ((joints, n), (points, m)) if k]


def rows_said(n: int) -> str:
    """A number of rows, for a sentence."""
    return f"{n} row{'' if n == 1 else 's'}"


def named(table: Table) -> str:
    """The name of a table's file, or what it is."""
    return table.file.name if table.file is not None else "the data frame"
