"""Known lengths between seats, from the certificate of a bar or a plate, and their file."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import check_names, quoted_cell, read_columns, read_form, write_columns
from truearm.readings.readings import LARGEST_MM, NamedRows, folded_name
from truearm.typing import FloatArray, IntArray, NameArray

if TYPE_CHECKING:
    import pandas as pd

ENDS = ("seat_a", "seat_b")
NUMBERS = ("length_mm", "u_mm")
ARTEFACT, PLACE = "artefact", "u_place_mm"
EXPANSION = ("expansion_per_K", "u_expansion_per_K")


@dataclass(frozen=True, eq=False)
class Lengths(NamedRows):
    """Lengths between the centres of seats, one row each.

    Rows with the same artefact are one length of one artefact at several places, under one certificate: its error is
    the same in all of them. Other rows are independent of each other.

    Parameters
    ----------
    seat_a, seat_b : (m,) array of str
        Names of the two seats.
    length_mm : (m,) array
        Length between them [mm].
    u_mm : (m,) array
        Its standard uncertainty [mm].
    artefact : (m,) array of str, optional
        The artefact that has this length; empty if it is at one place only.
    u_place_mm : (m,) array, optional
        Standard uncertainty of the difference of the length from place to place, due to the tip's seating,
        temperature and set-up [mm], in addition to `u_mm`. By default (also NaN) `default_u_place_mm` for rows with an
        artefact, zero for others.
    expansion_per_K, u_expansion_per_K : (m,) array or None
        Coefficient of thermal expansion of the artefact and its standard uncertainty [1/K]; NaN if not known, None if
        known of no row.
    file : Path, optional
        File of the lengths, named in messages.
    numbers : (m,) int array, optional
        Number of each length where it came from, counted from 1: its line in `file` if `by_line`. 1 .. m by default.
    by_line : bool
        Whether `numbers` are lines of `file`.

    Raises
    ------
    InputError
        If there is no length, shapes do not fit each other, a name is empty, the two seats of a row are the same, a
        length or an uncertainty is not positive and finite, an expansion is that of no material or lacks its
        uncertainty, two rows state the length between the same seats, or rows of one artefact differ in length, `u_mm`
        or expansion.

    Examples
    --------
    >>> import truearm as ta
    >>> lengths = ta.Lengths(["A"], ["B"], [500.0123], [0.0005])
    >>> lengths.to_frame().to_dict("records")
    [{'seat_a': 'A', 'seat_b': 'B', 'length_mm': 500.0123, 'u_mm': 0.0005}]
    """

    row_name: ClassVar[str] = "length"
    form_columns: ClassVar[tuple[str, ...]] = (*ENDS, *NUMBERS, ARTEFACT, *EXPANSION, "note")
    # Default standard uncertainty of the difference of an artefact's length between places. A ball returns to a
    # good cone within about that. It is less than the repeatability of arms, so that it has little effect on what is
    # identified.
    default_u_place_mm: ClassVar[float] = 0.001
    seat_a: NameArray
    seat_b: NameArray
    length_mm: FloatArray
    u_mm: FloatArray
    artefact: NameArray = field(default_factory=lambda: np.zeros(0, np.str_))
    u_place_mm: FloatArray = field(default_factory=lambda: np.zeros(0))
    expansion_per_K: FloatArray | None = None
    u_expansion_per_K: FloatArray | None = None
    file: Path | None = None
    numbers: IntArray | None = None
    by_line: bool = False

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
        numbers = np.arange(1, n + 1) if self.numbers is None else np.asarray(self.numbers, dtype=np.intp)
        object.__setattr__(self, "numbers", numbers)
        for name in ENDS:
            self.refuse(getattr(self, name) == "", "expected the name of a seat, got an empty cell", column=name)
        problem, twice = "expected a length between two seats, got {} twice", self.seat_a == self.seat_b
        self.refuse(twice, problem, [quoted_cell(name) for name in self.seat_a.tolist()], column="seat_b")
        for name, what in zip(NUMBERS, ("length", "standard uncertainty"), strict=True):
            values = getattr(self, name)
            bad, problem = ~((values > 0) & (values <= LARGEST_MM)), f"expected a positive {what}{{}}, got {{:.6g}} mm"
            self.refuse(bad, problem, _limits(values), values, column=name)
        self._check_expansions()
        self._check_places()
        self._check_once()

    def __len__(self) -> int:
        return len(self.seat_a)

    def between(self, seats: Iterable[str]) -> Lengths:
        """Select the lengths between `seats`, those of one session.

        Lengths with neither seat among them belong to another part of the measurements (held-out seats, for example)
        and are ignored.

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
        chosen: dict[str, Any] = {
            f.name: getattr(self, f.name)[which] for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)
        }
        return replace(self, **chosen)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame) -> Lengths:
        """Build lengths from a data frame with the columns of the file of lengths (docs/session-file.md).

        Parameters
        ----------
        frame : pandas.DataFrame
            ``seat_a``, ``seat_b``, ``length_mm``, ``u_mm`` and any of ``artefact``, ``u_place_mm``,
            ``expansion_per_K``, ``u_expansion_per_K``. Missing values are NaN or None. The index is not used.

        Raises
        ------
        InputError
            If a column is unknown or missing, or a value breaks a rule; with column and length.
        """
        from truearm.readings.columns import frame_numbers, frame_words

        known = (*ENDS, *NUMBERS, ARTEFACT, PLACE, *EXPANSION)
        for name in frame.columns:
            if name not in known and not str(name).startswith("note"):
                raise InputError(f"unknown column {quoted_cell(name)}", hint=", ".join(known))
        if missing := [name for name in (*ENDS, *NUMBERS) if name not in frame.columns]:
            raise InputError(f"the column {missing[0]} is missing", hint=", ".join((*ENDS, *NUMBERS)))
        read = {name: frame_words(frame[name], name) for name in (*ENDS, ARTEFACT) if name in frame.columns}
        numeric = [name for name in (*NUMBERS, PLACE, *EXPANSION) if name in frame.columns]
        return _of_columns(read | {n: frame_numbers(frame[n], n, optional=n not in NUMBERS) for n in numeric})

    def to_frame(self) -> pd.DataFrame:
        """Return a data frame with the columns of the file of lengths; ``Lengths.from_frame`` reads it back."""
        from truearm.readings.columns import data_frame

        return data_frame(_columns(self))

    def _check_expansions(self) -> None:
        """Check that an expansion is that of a material, and has an uncertainty."""
        known = []
        # From carbon fibre and glass ceramics to steel, brass and aluminium: nobody calibrates plastics.
        for name, low, high in zip(EXPANSION, (-1e-5, 0.0), (5e-5, 1e-5), strict=True):
            values = np.full(len(self), np.nan) if getattr(self, name) is None else getattr(self, name)
            known.append(~np.isnan(values))
            bad, problem = known[-1] & ~((values >= low) & (values <= high)), f"expected {low:g} to {high:g} per K"
            hint = "steel has 1.15e-05 per K: 11.5 micrometres per metre and kelvin"
            self.refuse(bad, problem + ", got {:g}", values, column=name, hint=hint)
        for name, there, other in zip(EXPANSION, known, reversed(known), strict=True):
            self.refuse(other & ~there, f"{' and '.join(EXPANSION)} belong together, got no {name}", column=name)
        if not known[0].any():
            for name in EXPANSION:
                object.__setattr__(self, name, None)

    def _check_places(self) -> None:
        """Check the rows of each artefact, and set the uncertainty of a place where none is given."""
        artefact, place = self.artefact, self.u_place_mm
        place = np.where(np.isnan(place), np.where(artefact != "", self.default_u_place_mm, 0.0), place)
        bad = ~((place <= LARGEST_MM) & ((place > 0) | ((place == 0) & (artefact == ""))))
        problem = "expected a positive standard uncertainty of a place{}, got {:.6g} mm"
        hint = f"leave the cell empty for the default, {self.default_u_place_mm:g} mm for a named artefact"
        self.refuse(bad, problem, _limits(place), place, column=PLACE, hint=hint)
        object.__setattr__(self, PLACE, place)
        first: dict[str, int] = {}
        for row, name in enumerate(artefact.tolist()):
            before = first.setdefault(name, row)
            for column in (*NUMBERS, *EXPANSION) if name else ():
                values = getattr(self, column)
                if values is not None and not np.array_equal(values[row], values[before], equal_nan=True):
                    raise self.error(
                        f"{quoted_cell(name)} has {column} {values[before]:.9g} in {self.called(before)}, "
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
                    f"the length between {quoted_cell(pair[0])} and {quoted_cell(pair[1])} is stated in "
                    f"{self.called(first)} already",
                    row,
                    hint="state it once, with the uncertainty of the mean if it was measured several times",
                )

    def _unknown(self, name: str, row: int, column: str, known: list[str]) -> InputError:
        alike = next((one for one in known if folded_name(one) == folded_name(name)), None)
        if alike is not None:
            hint = f"{quoted_cell(alike)}, the name in the session: the two differ in capitals or blanks only"
        else:
            close = difflib.get_close_matches(name, known, n=1)
            hint = close[0] if close else "use the names of seats as in the session"
        return self.error(f"the session has no seat {quoted_cell(name)}", row, column=column, hint=hint)


def _limits(values: FloatArray) -> list[str]:
    """What to say of values that are too large; of others nothing."""
    return [f" of at most {LARGEST_MM:g} mm" if LARGEST_MM < value < np.inf else "" for value in values.tolist()]


def read_lengths(path: str | Path, *, seats: Iterable[str] | None = None) -> Lengths:
    r"""Read a file of lengths (docs/session-file.md): CSV with the columns ``seat_a, seat_b, length_mm, u_mm``.

    Columns ``artefact``, ``u_place_mm``, ``expansion_per_K`` and ``u_expansion_per_K`` are optional, and so are their
    cells.

    Parameters
    ----------
    path : path
        As the session file in CSV. Columns whose name starts with ``note`` are not read.
    seats : iterable of str, optional
        The session's seats: only the lengths between them, see `Lengths.between`.

    Raises
    ------
    InputError
        If the file breaks a rule of the format; with file, line, column and what to do.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> _ = Path("lengths.csv").write_text("seat_a,seat_b,length_mm,u_mm\nA,B,500.0123,0.0005\n")
    >>> ta.read_lengths("lengths.csv").length_mm.tolist()
    [500.0123]
    """
    path = Path(path)
    sheet = read_form(path)
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
    text = [name for name in (*ENDS, ARTEFACT) if name in at]
    columns = dict(zip(text, names, strict=True)) | dict(zip(numeric, numbers.T, strict=True))
    lines = np.arange(len(numbers)) + sheet.first_line
    lengths = _of_columns(columns, file=path, numbers=lines, by_line=True)
    return lengths if seats is None else lengths.between(seats)


def _of_columns(columns: Mapping[str, FloatArray | NameArray], **source: Any) -> Lengths:
    """Build lengths from columns by their names, which are those of the fields."""
    values: dict[str, Any] = dict(columns)
    return Lengths(**values, **source)


def _columns(lengths: Lengths) -> dict[str, FloatArray | NameArray]:
    """Lay out lengths in the columns of their file; a default is empty."""
    names: list[str] = [*ENDS, *NUMBERS]
    if (lengths.artefact != "").any() or lengths.u_place_mm.any():
        names += [ARTEFACT, PLACE]
    if lengths.expansion_per_K is not None:
        names += EXPANSION
    columns = {name: getattr(lengths, name) for name in names}
    if PLACE in columns:
        columns[PLACE] = np.where(columns[PLACE] == 0, np.nan, columns[PLACE])
    return columns


def write_lengths(lengths: Lengths, path: str | Path) -> None:
    """Write a file of lengths; a failed run leaves none, or the previous one.

    Raises
    ------
    InputError
        If the file name does not end in ``.csv``, the file cannot be written, or a name holds a line break.
    """
    path = Path(path)
    if path.suffix != ".csv":
        raise InputError(f"expected a file name that ends in .csv, got {path.name!r}", file=path)
    for column in (*ENDS, ARTEFACT):
        for name in getattr(lengths, column).tolist():
            if any(sign in name for sign in "\n\r\0"):
                what = "an artefact" if column == ARTEFACT else "a seat"
                raise InputError(f"{what} must be one line of text, got {quoted_cell(name)}", file=path, column=column)
    with atomic_file(path, read=read_lengths) as beside:
        write_columns(beside, _columns(lengths))
