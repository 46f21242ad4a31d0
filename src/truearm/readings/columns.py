"""The columns of a session file: their names carry the units, and nothing is guessed."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from truearm.errors import InputError
from truearm.readings.session import DIRECTION, LOAD, NAMED, SPHERE_DISTANCE

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
    temperature: tuple[str, ...] = ()
    directions: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    words: tuple[str, ...] = ()

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the columns that hold numbers."""
        return self.angles + self.optional + self.temperature + self.directions + self.loads

    @property
    def optional(self) -> tuple[str, ...]:
        """Names of the number columns in which a reading's cells may all be empty."""
        return self.points + self.point_std + self.quaternion + self.sphere_distance


def unit_of(column: str) -> str:
    """Read the unit that a column's name ends in."""
    return column.rpartition("_")[2]


def recognise_columns(names: Sequence[str], *, file: Path, line: int | None, n_joints: int | None = None) -> Columns:
    """Which of a file's columns hold what.

    Raises
    ------
    InputError
        If a column is unknown, has no unit, stands twice or is missing.
    """
    for i, name in enumerate(names):
        if not name:
            hint = "delete the column, or let its name start with 'note'"
            raise InputError("the column has no name", file=file, line=line, column=i + 1, hint=hint)
        if name in names[:i]:
            raise InputError("the column stands twice", file=file, line=line, column=name, hint="delete one of the two")
    angles: dict[int, str] = {}
    points: dict[str, str] = {}
    together: dict[str, str] = {}
    directions: dict[int, str] = {}
    loads, words = [], []
    for name in names:
        if match := ANGLE.fullmatch(name):
            _once(angles, int(match[1]), name, file, line)
        elif match := _POINT.fullmatch(name):
            _once(points, match[1], name, file, line)
        elif name in QUATERNION or name in SPHERE_DISTANCE:
            together[name] = name
        elif match := _DIRECTION.fullmatch(name):
            directions[int(match[1])] = name
        elif LOAD.fullmatch(name):
            loads.append(name)
        elif name in NAMED:
            words.append(name)
        elif name != TEMPERATURE and not name.startswith("note"):
            raise InputError(*_unknown(name), file=file, line=line, column=name, hint=_instead(name))
    joints = _joints(angles, file, line, n_joints)
    return Columns(
        joints,
        _together("xyz", points, file, line),
        _std(points, file, line),
        _together(QUATERNION, together, file, line),
        _together(SPHERE_DISTANCE, together, file, line),
        (TEMPERATURE,) if TEMPERATURE in names else (),
        _directions(directions, len(joints), file, line),
        tuple(loads),
        tuple(words),
    )


def _once(found: dict[_Key, str], key: _Key, name: str, file: Path, line: int | None) -> None:
    if key in found:
        raise InputError(
            f"{found[key]} and {name} are the same quantity in two units",
            file=file,
            line=line,
            column=name,
            hint="delete one of the two columns",
        )
    found[key] = name


def _joints(found: dict[int, str], file: Path, line: int | None, n_joints: int | None) -> tuple[str, ...]:
    if not found:
        raise InputError(
            "expected joint angles in columns q1_deg, q2_deg, .. (or q1_rad, ..; q1_mm for a sliding joint), got none",
            file=file,
            line=line,
            hint="`truearm import` for tables with other column names",
        )
    last = max(found)
    shown = ", ".join(found[i] for i in sorted(found))
    for i in range(1, last + 1):
        if i not in found:
            raise InputError(
                f"the column of joint {i} is missing: expected q{i}_deg, q{i}_rad or q{i}_mm, got {shown}",
                file=file,
                line=line,
                hint="name the joints 1, 2, 3, .. from the base to the tip",
            )
    if n_joints is not None and last != n_joints:
        raise InputError(
            f"expected {n_joints} joints, got {last} (q1 .. q{last})",
            file=file,
            line=line,
            hint="check that the file belongs to this arm",
        )
    return tuple(found[i] for i in range(1, last + 1))


def _directions(found: dict[int, str], n_joints: int, file: Path, line: int | None) -> tuple[str, ...]:
    """One for each joint, or none."""
    if found and sorted(found) != list(range(1, n_joints + 1)):
        shown = ", ".join(found[i] for i in sorted(found))
        raise InputError(
            f"expected a direction of movement for each of {n_joints} joints, direction_1 .. direction_{n_joints}, "
            f"got {shown}",
            file=file,
            line=line,
            column=found[max(found)],
            hint="0 for a joint whose last movement is not known",
        )
    return tuple(found[i] for i in sorted(found))


def _together(keys: Sequence[str], found: dict[str, str], file: Path, line: int | None) -> tuple[str, ...]:
    """Find the columns of all `keys`, or none of them."""
    missing = [key for key in keys if key not in found]
    if len(missing) == len(keys):
        return ()
    if missing:
        present = ", ".join(found[key] for key in keys if key in found)
        name = f"{missing[0]}_mm" if len(keys) == 3 else missing[0]
        raise InputError(f"the column {name} is missing beside {present}", file=file, line=line)
    return tuple(found[key] for key in keys)


def _std(found: dict[str, str], file: Path, line: int | None) -> tuple[str, ...]:
    std = _together(("sx", "sy", "sz"), found, file, line)
    if std and "x" not in found:
        raise InputError(
            f"{std[0]} .. are uncertainties of a reference point, but x_mm, y_mm and z_mm are missing",
            file=file,
            line=line,
        )
    return std


def _unknown(name: str) -> tuple[str]:
    shown = name if len(name) <= 40 else f"{name[:36]}..."
    return (f"unknown column {shown!r}",)


def _instead(name: str) -> str:
    """Find the name that was probably meant."""
    plain = name.lower().replace(" ", "_").strip("_")
    if match := re.fullmatch(r"(?:q|j|joint|theta|angle|axis|a)_?0*(\d{1,3})(?:\D.*)?", plain):
        q = f"q{int(match[1]) or 1}"
        return f"{q}_deg or {q}_rad ({q}_mm for a sliding joint): units stand in the names"
    if match := re.fullmatch(r"(?:q|quat|quaternion)_?([wxyz])", plain):
        return f"quat_{match[1]}: the orientation as a unit quaternion, w first"
    if re.match(r"(load|torque|tau|moment|current)s?_?\d*(_|$)", plain):
        return "load_1_Nm or the like: loads of joints have names of letters, digits and _ that start with load_"
    if match := re.fullmatch(r"dir(?:ection)?s?_?(?:of_)?(?:q|j|joint)?_?0*(\d{1,3})", plain):
        return f"{DIRECTION}{int(match[1]) or 1}: the sign of the joint's last movement, -1, 0 or 1"
    if match := re.fullmatch(r"(s|u|std|sigma)?_?([xyz])(?:_.*)?", plain):
        axis = ("s" if match[1] else "") + match[2]
        return f"{axis}_mm or {axis}_m: units stand in the names"
    if re.match(r"t(emp.*)?(_|$)", plain):
        return f"{TEMPERATURE}: units stand in the names"
    close = difflib.get_close_matches(plain, [*NAMED, TEMPERATURE, *SPHERE_DISTANCE], n=1)
    return close[0] if close else "delete the column, or let its name start with 'note' if it is a remark"
