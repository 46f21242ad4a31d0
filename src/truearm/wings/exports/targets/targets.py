"""Targets of a robot program: joints, or poses of the tip with start joints; also from tables, with their units."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.delimited import MAX_BYTES, check_header, quoted_cell, read_columns, read_form
from truearm.files.file_reading import read_limited
from truearm.readings import Session, check_angles, skip_beyond_limits
from truearm.readings.columns import ANGLE, FACTOR, TEMPERATURE, frame_numbers, frame_words, unit_of
from truearm.readings.readings import DIRECTION, LOAD, NAMED
from truearm.typing import FloatArray, NameArray
from truearm.wings.exports.targets.joint_files.joint_file import JointFile
from truearm.wings.exports.targets.manifest import MARKER

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["joints", "poses", "positions"]


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets, one a row.

    Parameters
    ----------
    joints : (n, n_joints) array
        Joint targets; of poses the start joints, which choose the configuration [rad, or mm].
    tips : (n, 3) array, optional
        Positions of the tip [mm].
    rotations : (n, 3, 3) array, optional
        Orientations of the flange or of the tool, axes as columns; only together with `tips`.
    orientations : (str, (n, k) array), optional
        By what the table states `rotations`, and its numbers, angles in rad.
    joint_columns : tuple of str, optional
        Names of the joint columns in the file that they came from; in degrees by default.
    words : mapping of str to (n,) array of str
        Columns of names, which go with the targets.
    temperature_degC : (n,) array, optional
    directions : (n, n_joints) array, optional
        Sign of each joint's last movement.
    loads : mapping of str to (n,) array
    given : mapping of str to (n,) array
        Every column of the table, numbers and names, in its order and units.
    file : Path, optional
    first_line : int, optional
        Line of the first target in `file`.
    joint_file : JointFile, optional
        The file of another program that they came from, which takes corrected joints.
    """

    joints: FloatArray
    tips: FloatArray | None = None
    rotations: FloatArray | None = None
    orientations: tuple[str, FloatArray] | None = None
    joint_columns: tuple[str, ...] | None = None
    words: Mapping[str, NameArray] = field(default_factory=dict)
    temperature_degC: FloatArray | None = None
    directions: FloatArray | None = None
    loads: Mapping[str, FloatArray] = field(default_factory=dict)
    given: Mapping[str, FloatArray | NameArray] = field(default_factory=dict)
    file: Path | None = None
    first_line: int | None = None
    joint_file: JointFile | None = None

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def kind(self) -> Kind:
        """What they state: joints, poses or positions of the tip."""
        if self.tips is None:
            return "joints"
        return "positions" if self.rotations is None else "poses"

    @classmethod
    def of_joints(cls, joints: npt.ArrayLike) -> Targets:
        """Joint targets from an array (n, n_joints) [rad, or mm].

        Raises
        ------
        InputError
            If it has another number of dimensions, no row, or a number that is not finite.
        """
        try:
            values = np.array(joints, dtype=float)
        except (TypeError, ValueError):
            raise InputError(
                f"expected joint targets as an array of numbers, got {type(joints).__name__}",
                hint="an (n, n_joints) array in rad, a DataFrame, or a CSV file",
            ) from None
        if values.ndim != 2 or not values.size:
            raise InputError(
                f"expected joint targets of shape (n, n_joints), got {values.shape}",
                hint="joints[None] for a single one",
            )
        if not np.isfinite(values).all():
            row, joint = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
            raise InputError(
                f"expected a finite number, got {values[row, joint]} for J{joint + 1} of target {row + 1}",
                hint="skip refused targets: they have no joints",
            )
        return cls(values)

    def session(self, joints: FloatArray) -> Session:
        """Readings of the same inputs (temperature, loads, directions) at other joints."""
        return Session(
            joints,
            temperature_degC=self.temperature_degC,
            directions=self.directions,
            columns=dict(self.loads),
            file=self.file,
            angle_columns=self.joint_columns,
            numbers=None if self.first_line is None else np.arange(self.first_line, self.first_line + len(joints)),
            by_line=self.first_line is not None,
        )

    def label(self, row: int) -> str:
        """Name of a target in messages: that of the file, or its number."""
        for name in ("name", "target"):
            if name in self.words and self.words[name][row]:
                return str(self.words[name][row])
        return self.joint_file.rows[row] if self.joint_file else f"target {row + 1}"

    def check(self, arm: Arm) -> None:
        """Check that they can be targets of an arm.

        Raises
        ------
        InputError
            If the number of joints is not that of the arm, the unit of a joint is not one of its kind, a number can
            be no angle, or most joints are beyond the arm's limits: another unit, or another arm.
        """
        readings = self.session(self.joints)
        check_angles(readings, n_joints=arm.n_joints, prismatic=arm.chain.is_prismatic)
        if len(self) > 1:  # a single target beyond a limit is refused by itself
            skip_beyond_limits(readings, arm.limits, prismatic=arm.chain.prismatic)
        if self.tips is not None and np.abs(self.tips).max() > Session.largest_angle:
            row = int(np.abs(self.tips).max(axis=1).argmax())
            raise InputError(
                f"the position of {self.label(row)} is {np.abs(self.tips[row]).max():.6g} mm, which no arm reaches",
                file=self.file,
                line=None if self.first_line is None else self.first_line + row,
                hint="check the unit of the positions",
            )


LABELS = ("name", "target")
_POSITION = ("x", "y", "z")
# The ways to state an orientation, by what they are called in messages; units as far as they have any.
_ORIENTATIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "a quaternion": (("qw", "qx", "qy", "qz"), ()),
    "a rotation vector": (("rx", "ry", "rz"), ("deg", "rad")),
    "roll, pitch, yaw": (("roll", "pitch", "yaw"), ("deg", "rad")),
    "a rotation matrix": (tuple(f"r{i}{j}" for i in "123" for j in "123"), ()),
}
_BY_UNIT = {
    **dict.fromkeys(_POSITION, ("mm", "m")),
    **{name: units for names, units in _ORIENTATIONS.values() for name in names if units},
}
_DIRECTION = re.compile(DIRECTION + r"([1-9]\d{0,2})")
# Printed with three digits, a matrix is still a rotation; more is another thing.
_ROUNDED = 1e-3
_MAX_TURN = 4 * np.pi  # [rad]; degrees read as radians are mostly more
EXPECTED = (
    "q1_deg .. (or q1_rad, ..; q1_mm for a sliding joint), for poses x_mm, y_mm, z_mm and qw .. qz, rx_deg .. rz_deg, "
    "roll_deg, pitch_deg, yaw_deg or r11 .. r33"
)


_Problem = Callable[..., InputError]
"""Makes an error that says what is wrong; in a column, at a row, with what to do."""


def read_targets(path: str | Path, *, start: npt.ArrayLike | None = None) -> Targets:
    """Read a CSV file of targets (docs/correct.md).

    Parameters
    ----------
    path : path
    start : (n_joints,) array, optional
        Start joints of all poses [rad, or mm], where the file has none.

    Raises
    ------
    InputError
        If the file breaks a rule of the format, or truearm has corrected it already; with file, line and column.
    """
    path = Path(path)
    first = read_limited(path, limit_bytes=MAX_BYTES)[:4096].decode("latin-1")
    if MARKER in first:
        raise _twice(path)
    sheet = read_form(path)
    numbers, words = _recognise(sheet.names, file=path, line=1)
    values, texts = read_columns(
        sheet, [sheet.names.index(name) for name in numbers], [sheet.names.index(name) for name in words]
    )
    columns = dict(zip(numbers, values.T, strict=True))
    named = dict(zip(words, texts, strict=True))
    return _targets(columns, named, sheet.names, start=start, file=path, first_line=sheet.first_line)


def targets_from_frame(frame: pd.DataFrame, *, start: npt.ArrayLike | None = None) -> Targets:
    """Targets from a data frame with the columns of the file; see `read_targets`."""
    for name in frame.columns:
        if not isinstance(name, str):
            raise InputError(f"expected names of columns such as q1_deg, got {quoted_cell(name)}")
    numbers, words = _recognise(list(frame.columns), file=None, line=None)
    if not len(frame):
        raise InputError("expected at least one target, got none")
    columns = {name: frame_numbers(frame[name], name) for name in numbers}
    texts = {name: _remarks(frame[name]) if _is_note(name) else frame_words(frame[name], name) for name in words}
    return _targets(columns, texts, list(frame.columns), start=start, file=None, first_line=None)


def _is_note(name: str) -> bool:
    return name.startswith("note")


def _remarks(column: pd.Series[Any]) -> NameArray:
    """Remarks of any type as text of one line."""
    missing = column.isna().tolist()
    cells = ["" if gone else " ".join(str(cell).split()) for cell, gone in zip(column.tolist(), missing, strict=True)]
    return np.array(cells, dtype=np.str_)


def _twice(file: Path | None) -> InputError:
    return InputError(
        "these targets are corrected already: correcting them twice would double the correction",
        file=file,
        hint="give the targets as planned; the other direction is --direction feedback on encoder angles",
    )


def _recognise(names: Sequence[str], *, file: Path | None, line: int | None) -> tuple[list[str], list[str]]:
    """Names of the columns of numbers and of words, notes among them; every other column is refused."""
    check_header(names, file=file, line=line)
    if {"direction", "status"} <= set(names):
        raise _twice(file)
    numbers, words = [], []
    units = {f"{name}_{unit}" for name, allowed in _BY_UNIT.items() for unit in allowed}
    plain = {name for axes, allowed in _ORIENTATIONS.values() if not allowed for name in axes}
    for name in names:
        if name in units | plain | {TEMPERATURE} or any(known.fullmatch(name) for known in (ANGLE, LOAD, _DIRECTION)):
            numbers.append(name)
        elif name in LABELS or name in NAMED or _is_note(name):
            words.append(name)
        else:
            raise InputError(
                f"unknown column {quoted_cell(name)}", file=file, line=line, column=name, hint=_meant(name)
            )
    return numbers, words


def _meant(name: str) -> str:
    base = name.lower()
    if match := re.fullmatch(r"(?:q|j|joint|axis|a)_?(\d{1,3})(?:_.*)?", base):
        return (
            f"q{int(match[1])}_deg, q{int(match[1])}_rad or q{int(match[1])}_mm: the name of a column states its unit"
        )
    stem = base.partition("_")[0]
    if stem in _BY_UNIT:
        return f"{' or '.join(f'{stem}_{unit}' for unit in _BY_UNIT[stem])}: the name of a column states its unit"
    return f"{EXPECTED}; remarks in columns whose names start with 'note'"


def _targets(
    columns: dict[str, FloatArray],
    words: dict[str, NameArray],
    names: Sequence[str],
    *,
    start: npt.ArrayLike | None,
    file: Path | None,
    first_line: int | None,
) -> Targets:
    line = None if first_line is None else first_line - 1

    def problem(text: str, column: str | None = None, hint: str | None = None, row: int | None = None) -> InputError:
        where = line if row is None or first_line is None else first_line + row
        reading = f"target {row + 1}" if row is not None and first_line is None else None
        return InputError(text, file=file, line=where, column=column, hint=hint, row=reading)

    n = len(next(iter(columns.values()))) if columns else 0
    joint_columns = _joint_columns(columns, problem)
    tips = _vector(columns, _POSITION, problem)
    orientations = _orientations(columns, problem)
    if orientations is not None and tips is None:
        raise problem(f"{orientations[0]} without a position", hint="add x_mm, y_mm, z_mm")
    if not joint_columns and tips is None:
        raise problem("expected targets, got no joints and no positions", hint=EXPECTED)
    if joint_columns:
        joints = np.stack([columns[c] * FACTOR[unit_of(c)] for c in joint_columns], axis=1)
        if start is not None:
            raise problem("start joints are given twice: in the file and as start", hint="omit one of them")
    else:
        joints = _start_for_all(start, n, problem)
    rotations = None if orientations is None else _rotations(*orientations, problem)
    directions = _directions(columns, joints.shape[1], problem)
    return Targets(
        joints,
        tips,
        rotations,
        orientations,
        joint_columns=joint_columns or None,
        words={name: texts for name, texts in words.items() if not _is_note(name)},
        temperature_degC=columns.get(TEMPERATURE),
        directions=directions,
        loads={name: values for name, values in columns.items() if LOAD.fullmatch(name)},
        given={name: (columns | words)[name] for name in names},
        file=file,
        first_line=first_line,
    )


def _start_for_all(start: npt.ArrayLike | None, n: int, problem: _Problem) -> FloatArray:
    if start is None:
        raise problem(
            "poses need start joints, which choose the configuration and the turns",
            hint="columns q1_deg .., or one for all: --start q1,q2,.. in deg (Python: start=[..] in rad)",
        )
    try:
        joints = np.array(start, dtype=float)
    except (TypeError, ValueError):
        joints = np.zeros((0, 0))
    if joints.ndim != 1 or not np.isfinite(joints).all():
        raise problem(f"expected start joints as finite numbers, one a joint, got {start!r:.60}")
    return np.tile(joints, (n, 1))


def _joint_columns(columns: dict[str, FloatArray], problem: _Problem) -> tuple[str, ...]:
    found: dict[int, str] = {}
    for name in columns:
        if match := ANGLE.fullmatch(name):
            number = int(match[1])
            if number in found:
                raise problem(f"{found[number]} and {name} are the same joint in two units", name, "delete one of them")
            found[number] = name
    if found and sorted(found) != list(range(1, len(found) + 1)):
        missing = next(i for i in range(1, len(found) + 2) if i not in found)
        raise problem(f"the column of joint {missing} is missing: expected q{missing}_deg, _rad or _mm")
    return tuple(found[number] for number in sorted(found))


def _vector(columns: Mapping[str, FloatArray], names: Sequence[str], problem: _Problem) -> FloatArray | None:
    """Columns that belong together, in rad and mm; None if there are none of them."""
    parts = []
    for name in names:
        found = [column for column in columns if _stem(column) == name]
        if len(found) > 1:
            raise problem(f"{found[0]} and {found[1]} are the same quantity in two units", found[1], "delete one")
        parts += found
    if not parts:
        return None
    if len(parts) < len(names):
        absent = next(name for name in names if name not in map(_stem, parts))
        raise problem(f"the column {absent} is missing beside {', '.join(parts)}", hint="all of them, or none")
    with np.errstate(over="ignore"):  # what becomes infinite is refused
        return np.stack([columns[c] * (FACTOR[unit_of(c)] if "_" in c else 1.0) for c in parts], axis=1)


def _orientations(columns: Mapping[str, FloatArray], problem: _Problem) -> tuple[str, FloatArray] | None:
    """What states the orientations, and its numbers (n, k), angles in rad; None if nothing does."""
    stated = [what for what, (names, _) in _ORIENTATIONS.items() if any(_stem(c) in names for c in columns)]
    if len(stated) > 1:
        raise problem(f"the orientation is stated twice: as {' and as '.join(stated)}", hint="keep one of them")
    vector = _vector(columns, _ORIENTATIONS[stated[0]][0], problem) if stated else None
    return None if vector is None else (stated[0], vector)


def _stem(column: str) -> str:
    """Name of a column without its unit; joints are none of these."""
    stem, _, unit = column.rpartition("_")
    return stem if stem in _BY_UNIT and unit in _BY_UNIT[stem] else column


def _rotations(what: str, vector: FloatArray, problem: _Problem) -> FloatArray:
    """(n, 3, 3) orientations; those printed with few digits are replaced by the nearest exact ones."""
    if what in ("a rotation vector", "roll, pitch, yaw"):
        if (np.abs(vector) > _MAX_TURN).any():
            row = int(np.abs(vector).max(axis=1).argmax())
            largest = np.degrees(np.abs(vector[row]).max())
            raise problem(
                f"expected {what} of at most two turns, got {largest:.6g} deg",
                hint="check the unit: deg or rad",
                row=row,
            )
        of = Rotation.from_rotvec(vector) if what == "a rotation vector" else Rotation.from_euler("xyz", vector)
        return np.asarray(of.as_matrix())
    if what == "a quaternion":
        with np.errstate(over="ignore"):
            length = np.linalg.norm(vector, axis=1)
        off = np.abs(length - 1)
        if (off > Session.quaternion_tolerance).any():
            row = int(off.argmax())
            raise problem(f"expected a unit quaternion, got one of length {length[row]:.6g}", row=row)
        return np.asarray(Rotation.from_quat(vector, scalar_first=True).as_matrix())
    R = vector.reshape(-1, 3, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.nan_to_num(np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)), nan=np.inf)
    off = np.where(np.linalg.det(np.clip(R, -2, 2)) > 0, off, np.inf)
    if (off > _ROUNDED).any():
        raise problem("expected a rotation matrix, got another matrix", "r11", row=int(off.argmax()))
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ Vt)


def _directions(columns: dict[str, FloatArray], n_joints: int, problem: _Problem) -> FloatArray | None:
    found = {int(match[1]): name for name in columns if (match := _DIRECTION.fullmatch(name))}
    if not found:
        return None
    if sorted(found) != list(range(1, n_joints + 1)):
        raise problem(
            f"expected a direction of movement for each of {n_joints} joints, got {', '.join(found.values())}"
        )
    return np.stack([columns[found[i]] for i in sorted(found)], axis=1)
