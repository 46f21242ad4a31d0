"""The columns of a session in CSV, Parquet and data frames: their names state the units, and no unit is guessed."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.delimited import MAX_NAME, check_header, quoted_cell
from truearm.readings.readings import (
    ANCHOR_DISTANCE,
    DIRECTION,
    LOAD,
    NAMED,
    PAYLOAD,
    SHARED_UNCERTAINTIES,
    SPHERE_DISTANCE,
    Readings,
)
from truearm.typing import FloatArray, IntArray, NameArray

if TYPE_CHECKING:
    import pandas as pd

AngleUnit = Literal["deg", "rad"]

TEMPERATURE = "temperature_degC"

# To the units of the house: rad and mm.
FACTOR = {"deg": np.pi / 180, "rad": 1.0, "mm": 1.0, "m": 1000.0}

# No arm has a thousand joints, and `int` takes 4300 digits at most.
ANGLE = re.compile(r"q([1-9]\d{0,2})_(deg|rad|mm)")
QUATERNION = ("quat_w", "quat_x", "quat_y", "quat_z")
_DIRECTION = re.compile(DIRECTION + r"([1-9]\d{0,2})")
_POINT = re.compile(r"(s?[xyz])_(mm|m)")
_Key = TypeVar("_Key", int, str)


@dataclass(frozen=True)
class Columns:
    """Which columns of a session file hold what; `numbers` in the order of the fields."""

    angles: tuple[str, ...]
    points: tuple[str, ...] = ()
    point_std: tuple[str, ...] = ()
    quaternion: tuple[str, ...] = ()
    sphere_distance: tuple[str, ...] = ()
    anchor_distance: tuple[str, ...] = ()
    temperature: tuple[str, ...] = ()
    directions: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    words: tuple[str, ...] = ()

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the columns that hold numbers."""
        return self.angles + self.optional + self.temperature + self.directions + self.shared + self.loads

    @property
    def optional(self) -> tuple[str, ...]:
        """Names of the number columns in which a reading's cells may all be empty."""
        return self.points + self.point_std + self.quaternion + self.sphere_distance + self.anchor_distance


def unit_of(column: str) -> str:
    """Return the unit that a column's name ends in."""
    return column.rpartition("_")[2]


def recognise_columns(
    names: Sequence[str], *, file: Path | None, line: int | None, n_joints: int | None = None
) -> Columns:
    """Sort the columns of a session by what they hold.

    Raises
    ------
    InputError
        If a column is unknown, has no unit, is repeated or is missing.
    """
    check_header(names, file=file, line=line)
    with InputError.of_file(file, line):
        return _sorted(names, n_joints)


def _sorted(names: Sequence[str], n_joints: int | None) -> Columns:
    angles: dict[int, str] = {}
    points: dict[str, str] = {}
    together: dict[str, str] = {}
    directions: dict[int, str] = {}
    loads, words = [], []
    for name in names:
        if match := ANGLE.fullmatch(name):
            _once(angles, int(match[1]), name)
        elif match := _POINT.fullmatch(name):
            _once(points, match[1], name)
        elif name in QUATERNION or name in SPHERE_DISTANCE:
            together[name] = name
        elif match := _DIRECTION.fullmatch(name):
            directions[int(match[1])] = name
        elif LOAD.fullmatch(name):
            loads.append(name)
        elif name in NAMED:
            words.append(name)
        elif name not in (TEMPERATURE, *SHARED_UNCERTAINTIES, *ANCHOR_DISTANCE) and not name.startswith("note"):
            raise InputError(f"unknown column {quoted_cell(name)}", column=name, hint=_meant(name, names))
    joints = _joints(angles, n_joints)
    return Columns(
        joints,
        _together("xyz", points),
        _std(points),
        _together(QUATERNION, together),
        _together(SPHERE_DISTANCE, together),
        tuple(name for name in ANCHOR_DISTANCE if name in names),
        (TEMPERATURE,) if TEMPERATURE in names else (),
        _directions(directions, len(joints)),
        tuple(name for name in SHARED_UNCERTAINTIES if name in names),
        tuple(loads),
        tuple(words),
    )


def fields_of_columns(
    columns: Columns, numbers: FloatArray, words: Sequence[NameArray], *, file: Path | None, lines: IntArray | None
) -> dict[str, Any]:
    """Fields of readings in rad and mm from the values of `columns.numbers` and `columns.words`, and their lines."""
    references = (columns.points, columns.point_std, columns.quaternion, columns.sphere_distance)
    groups = (
        columns.angles,
        *references,
        columns.anchor_distance,
        columns.temperature,
        columns.directions,
        columns.shared,
    )
    parts = np.split(numbers, np.cumsum([len(group) for group in groups]), axis=1)
    for names, part in zip(groups[1:5], parts[1:5], strict=True):
        _check_whole(names, part, file=file, lines=lines)
    with np.errstate(over="ignore"):  # the session refuses what is infinite
        angles, points, std = (
            part * [FACTOR[unit_of(name)] for name in names] for part, names in zip(parts, groups[:3], strict=False)
        )
    quaternion, sphere_distance, anchor_distance, temperature, directions, shared, loads = parts[3:]
    fields: dict[str, Any] = {
        "angles": angles,
        "points": points if columns.points else None,
        "point_std": std if columns.point_std else None,
        "temperature_degC": temperature[:, 0] if columns.temperature else None,
        "quaternion": quaternion if columns.quaternion else None,
        "sphere_distance": sphere_distance if columns.sphere_distance else None,
        "directions": directions if columns.directions else None,
        "columns": dict(zip(columns.loads, loads.T, strict=True)),
        "file": file,
        "angle_columns": columns.angles,
        "numbers": lines,
        "by_line": lines is not None,
    }
    fields |= zip(columns.shared, shared.T, strict=True)
    fields |= zip(columns.anchor_distance, anchor_distance.T, strict=True)
    fields |= zip(columns.words, words, strict=True)
    return fields


def fields_of_frame(frame: pd.DataFrame, *, file: Path | None = None, n_joints: int | None = None) -> dict[str, Any]:
    """Fields of the readings in a data frame with the columns of the session file (see `Session.from_frame`)."""
    for name in frame.columns:
        if not isinstance(name, str):
            raise InputError(f"expected names of columns such as q1_deg, got {quoted_cell(name)}", file=file)
    columns = recognise_columns(list(frame.columns), file=file, line=None, n_joints=n_joints)
    if not len(frame):
        raise InputError("expected at least one reading, got none", file=file)
    numbers = [frame_numbers(frame[c], c, file=file, optional=c in columns.optional) for c in columns.numbers]
    words = [frame_words(frame[c], c, file=file) for c in columns.words]
    return fields_of_columns(columns, np.stack(numbers, axis=1), words, file=file, lines=None)


def data_frame(columns: Mapping[str, Any]) -> pd.DataFrame:
    """A DataFrame with these columns; words are str objects, as pandas reads them from a file."""
    import pandas as pd

    return pd.DataFrame({
        name: values.tolist() if getattr(getattr(values, "dtype", None), "kind", "") == "U" else values
        for name, values in columns.items()
    })  # fmt: skip


def session_columns(
    session: Readings, prismatic: npt.ArrayLike | None = None, angle_unit: AngleUnit | None = None
) -> dict[str, FloatArray | NameArray]:
    """Lay out a session in the columns of the session file, in their order."""
    table: dict[str, FloatArray | NameArray] = {}
    for i, unit in enumerate(_units(session, prismatic, angle_unit)):
        table[f"q{i + 1}_{unit}"] = session.angles[:, i] / FACTOR[unit]
    for prefix, values in (("", session.points), ("s", session.point_std)):
        if values is not None:
            table |= {f"{prefix}{axis}_mm": values[:, k] for k, axis in enumerate("xyz")}
    if session.quaternion is not None:
        table |= {name: session.quaternion[:, k] for k, name in enumerate(QUATERNION)}
    for name in NAMED:
        if (words := getattr(session, name)) is not None:
            table[name] = words
    if session.sphere_distance is not None:
        table |= {name: session.sphere_distance[:, k] for k, name in enumerate(SPHERE_DISTANCE)}
    table |= {name: values for name in ANCHOR_DISTANCE if (values := getattr(session, name)) is not None}
    if session.temperature_degC is not None:
        table[TEMPERATURE] = session.temperature_degC
    if session.directions is not None:
        table |= {f"{DIRECTION}{i + 1}": session.directions[:, i] for i in range(session.n_joints)}
    table |= {name: values for name in SHARED_UNCERTAINTIES if (values := getattr(session, name)) is not None}
    table.update(session.columns)
    return table


def _units(session: Readings, prismatic: npt.ArrayLike | None, angle_unit: AngleUnit | None) -> list[str]:
    """Choose the unit in which each joint is written."""
    if angle_unit not in (None, "deg", "rad"):
        raise InputError(f"expected the angle unit deg or rad, got {quoted_cell(angle_unit)}")
    known = [ANGLE.fullmatch(name) for name in session.angle_columns or ()]
    units = [match[2] if match else "deg" for match in known] or ["deg"] * session.n_joints
    if angle_unit is not None:
        units = ["mm" if unit == "mm" else angle_unit for unit in units]
    if prismatic is not None:
        slides = np.asarray(prismatic, dtype=bool)
        if slides.shape != (session.n_joints,):
            raise InputError(f"expected {session.n_joints} joint types, got shape {slides.shape}")
        turning = [angle_unit or "deg" if unit == "mm" else unit for unit in units]
        units = ["mm" if slide else unit for slide, unit in zip(slides, turning, strict=True)]
    return units


def frame_numbers(column: pd.Series[Any], name: str, *, file: Path | None = None, optional: bool = False) -> FloatArray:
    """Return a column of a data frame as finite floats; in an `optional` one NaN for what is missing."""
    from pandas.api.types import infer_dtype

    kind = infer_dtype(column, skipna=True)
    if kind not in ("floating", "integer", "mixed-integer-float") and not (optional and kind == "empty"):
        raise InputError(f"expected numbers, got a column of type {kind}", file=file, column=name)
    values: FloatArray = column.to_numpy(dtype=float, na_value=np.nan)
    # Frames and Parquet files have either an empty cell or NaN for what is missing.
    good = np.isfinite(values) | (np.isnan(values) & optional)
    if not good.all():
        row = int(np.argmin(good))
        got = "an empty cell" if np.isnan(values[row]) else repr(float(values[row]))
        raise InputError(f"expected a finite number, got {got}", file=file, row=f"reading {row + 1}", column=name)
    return values


def frame_words(column: pd.Series[Any], name: str, *, file: Path | None = None) -> NameArray:
    """Return a column of a data frame as names, empty for what is missing."""
    from pandas.api.types import infer_dtype

    kind = infer_dtype(column.astype(object), skipna=True)  # object: what categories stand for
    if kind not in ("string", "empty"):
        hint = f"frame[{name!r}].astype(str)" if file is None else None
        raise InputError(f"expected names (text), got a column of type {kind}", file=file, column=name, hint=hint)
    missing = column.isna().to_numpy()
    cells = ["" if gone else cell for cell, gone in zip(column.tolist(), missing.tolist(), strict=True)]
    for row, cell in enumerate(cells):
        if len(cell) > MAX_NAME:
            problem = f"expected a name of at most {MAX_NAME} characters, got one of {len(cell)}"
            raise InputError(problem, file=file, row=f"reading {row + 1}", column=name)
        if not cell.isprintable() and {"\0", "\n", "\r"} & set(cell):
            problem = "expected a name on one line, got control characters"
            raise InputError(problem, file=file, row=f"reading {row + 1}", column=name)
    return np.array(cells, dtype=np.str_)


def _check_whole(names: Sequence[str], values: FloatArray, *, file: Path | None, lines: IntArray | None) -> None:
    """Refuse a row (n, len(names)) of which only some cells are empty."""
    missing = np.isnan(values)
    partly = missing.any(axis=1) & ~missing.all(axis=1)
    if partly.any():
        row = int(np.argmax(partly))
        raise InputError(
            "expected a number as in the columns that go with it, got an empty cell",
            file=file,
            line=None if lines is None else int(lines[row]),
            row=f"reading {row + 1}" if lines is None else None,
            column=names[int(np.argmax(missing[row]))],
            hint=f"fill it in, or leave {', '.join(names)} empty together",
        )


def _once(found: dict[_Key, str], key: _Key, name: str) -> None:
    if key in found:
        raise InputError(
            f"{found[key]} and {name} are the same quantity in two units",
            column=name,
            hint="delete one of the two columns",
        )
    found[key] = name


def _joints(found: dict[int, str], n_joints: int | None) -> tuple[str, ...]:
    if not found:
        raise InputError(
            "expected joint angles in columns q1_deg, q2_deg, .. (or q1_rad, ..; q1_mm for a sliding joint), got none",
            hint="`truearm import` for tables with other column names",
        )
    last = max(found)
    shown = ", ".join(found[i] for i in sorted(found))
    for i in range(1, last + 1):
        if i not in found:
            raise InputError(
                f"the column of joint {i} is missing: expected q{i}_deg, q{i}_rad or q{i}_mm, got {shown}",
                hint="name the joints 1, 2, 3, .. from the base to the tip",
            )
    if n_joints is not None and last != n_joints:
        raise InputError(
            f"expected {n_joints} joints, got {last} (q1 .. q{last})", hint="check that the file belongs to this arm"
        )
    return tuple(found[i] for i in range(1, last + 1))


def _directions(found: dict[int, str], n_joints: int) -> tuple[str, ...]:
    """One for each joint, or none."""
    if found and sorted(found) != list(range(1, n_joints + 1)):
        shown = ", ".join(found[i] for i in sorted(found))
        raise InputError(
            f"expected a direction of movement for each of {n_joints} joints, direction_1 .. direction_{n_joints}, "
            f"got {shown}",
            column=found[max(found)],
            hint="0 for a joint whose last movement is not known",
        )
    return tuple(found[i] for i in sorted(found))


def _together(keys: Sequence[str], found: dict[str, str]) -> tuple[str, ...]:
    """Return the columns of all `keys`, or none of them."""
    missing = [key for key in keys if key not in found]
    if len(missing) == len(keys):
        return ()
    if missing:
        present = ", ".join(found[key] for key in keys if key in found)
        unit = found[next(key for key in keys if key in found)].partition("_")[2] if len(keys) == 3 else ""
        name = f"{missing[0]}_{unit}" if unit else missing[0]
        raise InputError(f"the column {name} is missing beside {present}", hint="all of them, or none")
    return tuple(found[key] for key in keys)


def _std(found: dict[str, str]) -> tuple[str, ...]:
    std = _together(("sx", "sy", "sz"), found)
    if std and "x" not in found:
        raise InputError(f"{std[0]} .. are uncertainties of a reference point, but x_mm, y_mm and z_mm are missing")
    return std


def _meant(name: str, names: Sequence[str]) -> str:
    """Return the name that was probably meant; of a table without joints the command that reads other tables."""
    plain = name.lower().replace(" ", "_").strip("_")
    if match := re.fullmatch(r"(?:q|j|joint|theta|angle|axis|a)_?0*(\d{1,3})(?:\D.*)?", plain):
        q = f"q{int(match[1]) or 1}"
        return f"{q}_deg or {q}_rad ({q}_mm for a sliding joint): the name of a column states its unit"
    if match := re.fullmatch(r"(?:q|quat|quaternion)_?([wxyz])", plain):
        return f"quat_{match[1]}: the orientation as a unit quaternion, w first"
    if re.match(r"(load|torque|tau|moment|current)s?_?\d*(_|$)", plain):
        return "load_1_Nm or the like: loads of joints have names of letters, digits and _ that start with load_"
    if re.match(r"(payload|mass|weight)s?(_|$)", plain):
        return f"{PAYLOAD}: the mass that the flange carries"
    if match := re.fullmatch(r"dir(?:ection)?s?_?(?:of_)?(?:q|j|joint)?_?0*(\d{1,3})", plain):
        return f"{DIRECTION}{int(match[1]) or 1}: the sign of the joint's last movement, -1, 0 or 1"
    if match := re.fullmatch(r"(s|u|std|sigma)?_?([xyz])(?:_.*)?", plain):
        axis = ("s" if match[1] else "") + match[2]
        return f"{axis}_mm or {axis}_m: the name of a column states its unit"
    if re.match(r"t(emp.*)?(_|$)", plain):
        return f"{TEMPERATURE}: the name of a column states its unit"
    close = difflib.get_close_matches(
        plain, [*NAMED, TEMPERATURE, *SPHERE_DISTANCE, *ANCHOR_DISTANCE, *SHARED_UNCERTAINTIES], n=1
    )
    if not close and not any(map(ANGLE.fullmatch, names)):
        return "truearm import TABLE --out session.csv reads the tables of other programs"
    return close[0] if close else "delete the column, or let its name start with 'note' if it is a remark"
