"""Known lengths between seats, as a calibrated bar or a plate states them, and their small file."""

from __future__ import annotations

import csv
import difflib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import check_names, quoted_cell, read_columns, read_sheet
from truearm.typing import FloatArray, NameArray

ENDS = ("seat_a", "seat_b")
NUMBERS = ("length_mm", "u_mm")
ARTEFACT, PLACE = "artefact", "u_place_mm"
EXPANSION = ("expansion_per_K", "u_expansion_per_K")

PLACE_U_MM = 0.001
"""Standard uncertainty by which an artefact's length differs from place to place where nobody says better [mm].

A ball comes back to a good cone within about that. It is less than arms repeat to, so that it matters little to what
they are found to be.
"""


@dataclass(frozen=True, eq=False)
class Lengths:
    """Lengths between the centres of seats, one row each.

    Rows with the same artefact are about one length of one artefact, put to several places under one certificate: its
    error is the same in all of them, however many they are. Other rows are independent of each other.

    Parameters
    ----------
    seat_a, seat_b : (m,) array of str
        Names of the two seats.
    length_mm : (m,) array
        Length between them [mm].
    u_mm : (m,) array
        Its standard uncertainty [mm].
    artefact : (m,) array of str, optional
        The artefact that has this length; empty where it is in one place only.
    u_place_mm : (m,) array, optional
        Standard uncertainty of how the length differs from place to place, by how the tip sits, by temperature and
        setting up [mm]; it comes on top of `u_mm`. NaN, or none given: `PLACE_U_MM` for rows with an artefact, nothing
        for others.
    expansion_per_K, u_expansion_per_K : (m,) array or None
        Coefficient of thermal expansion of the artefact and its standard uncertainty [1/K]; NaN where not known, None
        where known of none.
    file : Path, optional
        Where the lengths were read from; it serves messages.
    first_line : int, optional
        The line of the first length in `file`, counted from 1.

    Raises
    ------
    InputError
        If there is no length, shapes do not fit each other, a name is empty, the two seats of a row are one, a length
        or an uncertainty is not positive and finite, an expansion is that of no material or stands without its
        uncertainty, two rows state the length between the same seats, or rows of one artefact differ in length, `u_mm`
        or expansion.
    """

    seat_a: NameArray
    seat_b: NameArray
    length_mm: FloatArray
    u_mm: FloatArray
    artefact: NameArray = field(default_factory=lambda: np.zeros(0, np.str_))
    u_place_mm: FloatArray = field(default_factory=lambda: np.zeros(0))
    expansion_per_K: FloatArray | None = None
    u_expansion_per_K: FloatArray | None = None
    file: Path | None = None
    first_line: int | None = None

    def __post_init__(self) -> None:
        n = np.size(self.seat_a)
        for name, nothing in ((ARTEFACT, ""), (PLACE, np.nan)):
            if not np.size(getattr(self, name)):
                object.__setattr__(self, name, np.full(n, nothing))
        for names, kind in (((*ENDS, ARTEFACT), np.str_), ((*NUMBERS, PLACE, *EXPANSION), float)):
            for name in names:
                if getattr(self, name) is None:
                    continue
                value = np.asarray(getattr(self, name), dtype=kind)
                if value.shape != np.shape(self.seat_a) or value.ndim != 1:
                    raise InputError(f"expected one {name} for each length, got shape {value.shape}")
                object.__setattr__(self, name, value)
        if not len(self):
            raise InputError("expected one or more lengths, got none", file=self.file)
        for name in ENDS:
            if (empty := getattr(self, name) == "").any():
                raise self.error("expected the name of a seat, got an empty cell", int(np.argmax(empty)), column=name)
        if (same := self.seat_a == self.seat_b).any():
            row = int(np.argmax(same))
            raise self.error(
                f"expected a length between two seats, got {quoted_cell(str(self.seat_a[row]))} twice",
                row,
                column="seat_b",
            )
        for name in NUMBERS:
            values = getattr(self, name)
            if (bad := ~(np.isfinite(values) & (values > 0))).any():
                row = int(np.argmax(bad))
                what = "length" if name == "length_mm" else "standard uncertainty"
                raise self.error(f"expected a positive {what}, got {values[row]:.6g} mm", row, column=name)
        self._check_expansions()
        self._check_places()
        self._check_once()

    def __len__(self) -> int:
        return len(self.seat_a)

    def between(self, seats: Iterable[str]) -> Lengths:
        """Select the lengths between `seats`, those of one session.

        A length of which neither seat is among them belongs to another part of the measurements (one that was held
        out to test on) and is left out.

        Raises
        ------
        InputError
            If only one of the two seats of a length is among them, or no length is between them.
        """
        known = sorted(set(seats) - {""})
        here = np.stack([np.isin(self.seat_a, known), np.isin(self.seat_b, known)])
        if (lone := here.any(axis=0) & ~here.all(axis=0)).any():
            row = int(np.argmax(lone))
            end = ENDS[int(np.argmin(here[:, row]))]
            raise self._unknown(str(getattr(self, end)[row]), row, end, known)
        found = self.within(known)
        if found is None:
            raise self._unknown(str(self.seat_a[0]), 0, ENDS[0], known)
        return found

    def within(self, seats: Iterable[str]) -> Lengths | None:
        """Select the lengths of which both seats are among `seats`, some of the session's; None if there are none."""
        known = sorted(set(seats))
        which = np.isin(self.seat_a, known) & np.isin(self.seat_b, known)
        if not which.any():
            return None
        if which.all():
            return self
        return Lengths(
            self.seat_a[which],
            self.seat_b[which],
            self.length_mm[which],
            self.u_mm[which],
            self.artefact[which],
            self.u_place_mm[which],
            None if self.expansion_per_K is None else self.expansion_per_K[which],
            None if self.u_expansion_per_K is None else self.u_expansion_per_K[which],
        )

    def error(self, problem: str, row: int, *, column: str | None = None, hint: str | None = None) -> InputError:
        """Make an error that knows these lengths' file, and the line of `row` (counted from 0)."""
        if self.first_line is None:
            return InputError(f"length {row + 1}: {problem}", file=self.file, column=column, hint=hint)
        return InputError(problem, file=self.file, line=self.first_line + row, column=column, hint=hint)

    def _check_expansions(self) -> None:
        """Check that an expansion is one of a material, and stands with its uncertainty."""
        known = []
        # Of carbon fibre, glass ceramics, steel, brass, aluminium: nobody calibrates plastics.
        for name, low, high in zip(EXPANSION, (-1e-5, 0.0), (5e-5, 1e-5), strict=True):
            values = np.full(len(self), np.nan) if getattr(self, name) is None else getattr(self, name)
            known.append(~np.isnan(values))
            if (bad := known[-1] & ~((values >= low) & (values <= high))).any():
                row = int(np.argmax(bad))
                raise self.error(
                    f"expected {low:g} to {high:g} per K, got {values[row]:g}",
                    row,
                    column=name,
                    hint="steel has 1.15e-05 per K: 11.5 micrometres per metre and kelvin",
                )
        if (lone := known[0] != known[1]).any():
            row = int(np.argmax(lone))
            empty = EXPANSION[int(known[0][row])]
            raise self.error(f"{' and '.join(EXPANSION)} belong together, got no {empty}", row, column=empty)
        if not known[0].any():
            for name in EXPANSION:
                object.__setattr__(self, name, None)

    def _check_places(self) -> None:
        """Check the rows of each artefact, and set the uncertainty of a place where none is given."""
        artefact, place = self.artefact, self.u_place_mm
        place = np.where(np.isnan(place), np.where(artefact != "", PLACE_U_MM, 0.0), place)
        if (bad := ~(np.isfinite(place) & ((place > 0) | ((place == 0) & (artefact == ""))))).any():
            row = int(np.argmax(bad))
            raise self.error(
                f"expected a positive standard uncertainty of a place, got {place[row]:.6g} mm",
                row,
                column=PLACE,
                hint=f"nothing, which stands for {PLACE_U_MM:g} mm where an artefact is named",
            )
        object.__setattr__(self, PLACE, place)
        first: dict[str, int] = {}
        for row, name in enumerate(artefact.tolist()):
            before = first.setdefault(name, row)
            for column in (*NUMBERS, *EXPANSION) if name else ():
                values = getattr(self, column)
                if values is not None and not np.array_equal(values[row], values[before], equal_nan=True):
                    raise self.error(
                        f"{quoted_cell(name)} has {column} {values[before]:.9g} in {self._where(before)}, "
                        f"got {values[row]:.9g}",
                        row,
                        column=column,
                        hint="one length of an artefact has one certificate; give another length another name",
                    )

    def _check_once(self) -> None:
        pairs: dict[tuple[str, ...], int] = {}
        for row, pair in enumerate(zip(self.seat_a.tolist(), self.seat_b.tolist(), strict=True)):
            first = pairs.setdefault(tuple(sorted(pair)), row)
            if first != row:
                raise self.error(
                    f"the length between {quoted_cell(pair[0])} and {quoted_cell(pair[1])} stands in {self._where(first)} already",
                    row,
                    hint="state it once, with the uncertainty of the mean if it was measured several times",
                )

    def _where(self, row: int) -> str:
        return f"length {row + 1}" if self.first_line is None else f"line {self.first_line + row}"

    def _unknown(self, name: str, row: int, column: str, known: list[str]) -> InputError:
        close = difflib.get_close_matches(name, known, n=1)
        hint = close[0] if close else "the names of seats as the session has them"
        if hint.strip() == name.strip():
            hint = f"{quoted_cell(hint)}: one of the two has a blank before or behind it"
        return self.error(f"the session has no seat {quoted_cell(name)}", row, column=column, hint=hint)


def read_lengths(path: str | Path, *, seats: Iterable[str] | None = None) -> Lengths:
    """Read a file of lengths (docs/session-file.md): CSV with the columns ``seat_a, seat_b, length_mm, u_mm``.

    Columns ``artefact``, ``u_place_mm``, ``expansion_per_K`` and ``u_expansion_per_K`` may be there besides; empty
    cells in them are as if there were none.

    Parameters
    ----------
    path : path
        As the session file in CSV: comma, decimal point, UTF-8. Columns whose name starts with ``note`` are not read.
    seats : iterable of str, optional
        The session's seats: only the lengths between them, see `Lengths.between`.

    Raises
    ------
    InputError
        If anything is not as the format demands: the file, the line and the column, and what to try.
    """
    path = Path(path)
    sheet = read_sheet(path)
    wanted, further = (*ENDS, *NUMBERS), (ARTEFACT, PLACE, *EXPANSION)
    check_names(sheet, wanted, further)
    at = {name: sheet.names.index(name) for name in (*wanted, *further) if name in sheet.names}
    numeric = [name for name in (*NUMBERS, PLACE, *EXPANSION) if name in at]
    numbers, names = read_columns(
        sheet,
        [at[name] for name in numeric],
        [at[name] for name in (*ENDS, ARTEFACT) if name in at],
        optional=[at[name] for name in numeric if name not in NUMBERS],
    )
    columns = dict(zip(numeric, numbers.T, strict=True))
    lengths = Lengths(
        names[0],
        names[1],
        columns["length_mm"],
        columns["u_mm"],
        artefact=names[2] if ARTEFACT in at else np.zeros(0, np.str_),
        u_place_mm=columns.get(PLACE, np.zeros(0)),
        expansion_per_K=columns.get(EXPANSION[0]),
        u_expansion_per_K=columns.get(EXPANSION[1]),
        file=path,
        first_line=sheet.first_line,
    )
    return lengths if seats is None else lengths.between(seats)


def write_lengths(lengths: Lengths, path: str | Path) -> None:
    """Write a file of lengths; a failed run leaves none, or the one that was there.

    Raises
    ------
    InputError
        If the file name does not end in ``.csv``, the file cannot be written, or a name holds a line break.
    """
    path = Path(path)
    if path.suffix != ".csv":
        raise InputError(f"expected a file name that ends in .csv, got {path.name!r}", file=path)
    columns: list[str] = [*ENDS, *NUMBERS]
    if (lengths.artefact != "").any() or lengths.u_place_mm.any():
        columns += [ARTEFACT, PLACE]
    if lengths.expansion_per_K is not None:
        columns += EXPANSION
    for column in (*ENDS, ARTEFACT):
        for name in getattr(lengths, column).tolist():
            if any(sign in name for sign in "\n\r\0"):
                what = "an artefact" if column == ARTEFACT else "a seat"
                raise InputError(f"{what} must be one line of text, got {quoted_cell(name)}", file=path, column=column)
    table = [getattr(lengths, name).tolist() for name in columns]
    for i, column in enumerate(columns):  # nothing is written as nothing
        if column == PLACE:
            table[i] = [u or "" for u in table[i]]
        elif column in EXPANSION:
            table[i] = ["" if value != value else value for value in table[i]]
    with atomic_file(path) as beside, beside.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*table, strict=True))
