"""Columns of times: seconds of several units, clocks, dates, and pairs of seconds and nanoseconds."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from truearm.typing import FloatArray, NameArray
from truearm.wings.importing.tables.table import Table
from truearm.wings.importing.tables.units import canonical_unit, conversion

TIME = re.compile(
    r"(^|[^a-z])(time|times|timestamp|stamp|t|zeit|datum|date|datetime|uhrzeit|clock|elapsed|时间)([^a-z]|$)|timestamp"
    r"|^(secs?|seconds|millis|milliseconds|micros|nanos)$"
)
WHOLE = re.compile(r"(^|[^a-z])(secs?|seconds|tv_sec)$")
REST = re.compile(r"(^|[^a-z])(nanosecs?|nsecs?|nanoseconds|nanos|tv_nsec)$")
# An epoch of Unix in 2001 .. 2096, and steps of logs whose samples come regularly, 2 Hz to 2 kHz [s].
EPOCH, REGULAR = (1e9, 4e9), (5e-4, 0.5)
CLOCK, TWELVE = "%H:%M:%S.%f", "%I:%M:%S.%f %p"
DATES = ("%d.%m.%Y", "%Y/%m/%d", "%m/%d/%Y", "%d/%m/%Y")
FORMATS = ("ISO8601", CLOCK, *(f"{date} {clock}" for date in DATES for clock in (CLOCK, TWELVE)))
DAY = 86400.0


@dataclass(frozen=True, eq=False)
class Times:
    """Times of the rows of a table.

    Attributes
    ----------
    seconds : (n,) array
        On the table's own clock; dates count from 1970.
    columns : tuple of int
        The columns that hold them.
    assumed : tuple of str
        What was recognised.
    """

    seconds: FloatArray
    columns: tuple[int, ...]
    assumed: tuple[str, ...]


def time_columns(table: Table) -> tuple[int, ...]:
    """Indices of the columns that hold times."""
    found = [i for i, name in enumerate(table.names) if TIME.search(_plain(name)) or _is_text_of_times(table, i)]
    pairs = [i for pair in _pairs(table) for i in pair]
    return tuple(sorted({*found, *pairs}))


def time_of(table: Table) -> Times | None:
    """The times of the rows of a table; None if no column holds any.

    Raises
    ------
    InputError
        If they go back, or their unit is not clear; with the place.
    """
    for whole, rest in _pairs(table):
        seconds = table.numbers(whole) + 1e-9 * table.numbers(rest)
        return _rising(table, seconds, (whole, rest), f"times from {table.names[whole]} and {table.names[rest]}")
    columns = time_columns(table)
    text = [i for i in columns if table.columns[i].dtype.kind == "U"]
    for chosen in ([text] if len(text) == 2 else []) + [[i] for i in text]:
        words = [np.char.strip(np.asarray(table.columns[i], dtype=np.str_)) for i in chosen]
        joined = words[0] if len(words) == 1 else np.char.add(np.char.add(words[0], " "), words[1])
        if (read := _read_dates(joined)) is not None:
            return _rising(table, read, tuple(chosen), f"times from {' and '.join(table.names[i] for i in chosen)}")
    for i in columns:
        if table.columns[i].dtype.kind == "f":
            return _numeric(table, i)
    return None


def _numeric(table: Table, i: int) -> Times:
    values, name = table.numbers(i), table.names[i]
    said = f"times from {name}"
    last = re.split(r"[^a-zµμ]+", name.casefold().strip(" ])"))[-1]
    factor = _factor(table.units[i]) or _factor(last)
    if factor is None:
        unit = _unit_by_size(values)
        said, factor = f"{said}, taken as {unit}", _factor(unit)
    return _rising(table, values * (factor or 1.0), (i,), said)


def _factor(written: str) -> float | None:
    """How many seconds a written unit is; None if it is no unit of time."""
    found = conversion(canonical_unit(written.casefold()) or "", "s")
    return found and found[0]


def _unit_by_size(values: FloatArray) -> str:
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    sizes = [(float(np.median(known)), EPOCH)] if len(known) else []
    if len(steps) >= 50 and np.median(np.abs(steps - np.median(steps))) < 0.2 * np.median(steps):
        sizes.append((float(np.median(steps)), REGULAR))
    for size, (low, high) in sizes:
        for k, unit in enumerate(("s", "ms", "us", "ns")):
            if low <= size * 1e-3**k < high:
                return unit
    return "s"


def _rising(table: Table, seconds: FloatArray, columns: tuple[int, ...], said: str) -> Times:
    known = np.flatnonzero(np.isfinite(seconds))
    back = np.flatnonzero(np.diff(seconds[known]) < 0)
    if len(back):
        raise table.error(
            "the time goes back from the row before",
            int(known[back[0] + 1]),
            column=columns[0],
            hint="sort the rows by time, or split the file where the clock was set",
        )
    return Times(seconds, columns, (said,))


def _pairs(table: Table) -> list[tuple[int, int]]:
    """Pairs of columns of whole seconds and nanoseconds, as messages of ROS have them."""
    names = [_plain(name) for name in table.names]
    rests = {REST.sub("", name): i for i, name in enumerate(names) if REST.search(name)}
    return [
        (i, rests[WHOLE.sub("", name)])
        for i, name in enumerate(names)
        if WHOLE.search(name) and not REST.search(name) and WHOLE.sub("", name) in rests
    ]


def _is_text_of_times(table: Table, i: int) -> bool:
    column = table.columns[i]
    if column.dtype.kind != "U" or not len(column):
        return False
    return bool(re.match(r"^\s*(\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[ T]+)?\d{1,2}:\d{2}:\d{2}", str(column[0])))


def _read_dates(words: NameArray) -> FloatArray | None:
    """Seconds since 1970, or since midnight (continued over the next); None where a cell is no time."""
    import pandas as pd

    plain = pd.Series(words).str.replace(r"(:\d{2}:\d{2})[,:](\d+)", r"\1.\2", regex=True)
    plain = plain.str.replace(r"(:\d{2}:\d{2})(?![.\d])", r"\1.0", regex=True)
    for form in FORMATS:
        if form == "ISO8601" and not plain.str.match(r"\d{4}-").all():
            continue
        try:
            read = pd.to_datetime(plain, format=form, utc=True)
        except (ValueError, OverflowError):
            continue
        seconds = ((read - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=1)).to_numpy(dtype=float)
        if form == CLOCK:
            seconds = seconds + DAY * np.cumsum(np.diff(seconds, prepend=seconds[:1]) < -DAY / 2)
        return np.asarray(seconds, dtype=float)
    return None


def _plain(name: str) -> str:
    return name.strip().casefold()
