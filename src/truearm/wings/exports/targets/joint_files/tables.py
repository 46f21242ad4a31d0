"""Tables with a column for each joint, or with lists of joints: LeRobot's datasets, and CSV of ROS's joints."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError, extra_module
from truearm.readings.columns import ANGLE
from truearm.typing import FloatArray
from truearm.wings.exports.targets import TargetDirection
from truearm.wings.exports.targets.joint_files.joint_file import (
    JointFile,
    Span,
    check_not_corrected,
    edited,
    places_of,
    turning_scale,
)
from truearm.wings.exports.targets.lerobot_motors import MOTORS, JointValues, joint_values, motors_and_arm

# Of LeRobot's datasets: what the motors should do, and what they did.
COMMANDED, READ = "action", "observation.state"
TITLE = "table of joints"
MAX_CELLS = 2**25
_BEFORE = re.compile(r"^(?:main_|(?:action|observation\.state)\.)*|(?:\.pos|/position)$")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
SEPARATORS = ",;\t"
# Of a value whose last digit is that of the encoder: no decimals [rad].
_WHOLE = 1e-9
_METADATA = "truearm "  # and the column of lists


def list_column(names: Sequence[str], direction: TargetDirection) -> str | None:
    """The column of LeRobot's lists that a direction is about; None without one."""
    wanted = (COMMANDED, READ) if direction == "command" else (READ,)
    return next((name for name in wanted if name in names), None)


def motor_columns(names: Sequence[str], lists: str) -> list[str] | None:
    """Columns of LeRobot's motors, base to tip: one each, or the first numbers of its lists; None without them."""
    plain = [_BEFORE.sub("", name) for name in names]
    for found in (plain, names):
        if all(motor in found for motor in MOTORS):
            return [names[list(found).index(motor)] for motor in MOTORS]
    of_lists = [f"{lists}[{i}]" for i in range(len(MOTORS))]
    return of_lists if set(of_lists) <= set(names) else None


class _Meaning:
    """Which columns of a table are joints, and the scale of their values."""

    def __init__(
        self, names: Sequence[str], arm: Arm, direction: TargetDirection, unit: str | None, motors: str
    ) -> None:
        self.list_name = list_column(names, direction)
        plain = [_BEFORE.sub("", name) for name in names]
        of_motors = motor_columns(names, "")
        is_lerobot = self.list_name is not None or of_motors is not None
        self.columns: list[int] = []
        if self.list_name is not None:
            self.columns = [list(names).index(self.list_name)]
        elif of_motors is not None:
            self.columns = [list(names).index(name) for name in of_motors]
        elif set(arm.joint_names) <= set(plain):
            self.columns = [plain.index(name) for name in arm.joint_names]
        elif not any(map(ANGLE.fullmatch, names)) and (places := places_of(plain, arm)) is not None:
            self.columns = places
        self.scale: JointValues
        if not self.columns:
            return
        if is_lerobot:
            if arm.n_joints != len(MOTORS):
                raise InputError(f"expected the model of an SO-100 or SO-101, got one of {arm.name!r}")
            calibration, stated = motors_and_arm(motors)
            self.scale = joint_values(unit, calibration, stated or arm.name)
        elif unit in ("deg", "rad"):
            self.scale = turning_scale(arm, unit)
        else:
            raise InputError(
                "the columns of joints do not say their unit", hint="--angle-unit deg or rad (sliding joints mm or m)"
            )


def read_csv(content: bytes, arm: Arm, direction: TargetDirection, unit: str | None, motors: str) -> JointFile | None:
    """The joints of a text table; None if its header names none, so that it is another table.

    Raises
    ------
    InputError
        If the unit is not stated, or a row has no number for a joint.
    """
    text = content.decode("latin-1")
    head = text[: text.find("\n") + 1 or len(text)]
    separator = max(SEPARATORS, key=head.count)
    mark = "\u00ef\u00bb\u00bf"  # the byte order mark, as Latin-1 has it
    names = [text[start:stop].removeprefix(mark).strip('" ') for start, stop in _cells(head, separator)[0]]
    meaning = _Meaning(names, arm, direction, unit, motors)
    if not meaning.columns:
        return None
    check_not_corrected(text, direction)
    values: list[list[float]] = []
    spans: list[list[Span]] = []
    for line, cells in enumerate(_cells(text, separator)[1:], start=2):
        if len(cells) == 1 and not text[slice(*cells[0])].strip():
            continue
        if len(cells) <= max(meaning.columns):
            raise InputError(f"expected {len(names)} cells, got {len(cells)}", line=line)
        found = [
            Span(cells[column].start + one.start(), cells[column].start + one.end())
            for column in meaning.columns
            for one in _NUMBER.finditer(text[slice(*cells[column])])
        ][: arm.n_joints if meaning.list_name else None]
        if len(found) != arm.n_joints:
            raise InputError(f"expected {arm.n_joints} numbers of joints, got {len(found)}", line=line)
        spans.append(found)
        values.append([float(text[slice(*span)]) for span in found])
    if not values:
        raise InputError("expected at least one row of joints, got none")
    before = np.array(values)
    digits = np.full(arm.n_joints, _WHOLE) if unit == "counts" else meaning.scale.gain

    def written(after: FloatArray, _: str) -> bytes:
        return edited(text, spans, before, after, digits).encode("latin-1")

    return JointFile(TITLE, before, meaning.scale, written)


def _cells(text: str, separator: str) -> list[list[Span]]:
    """Where the cells of each line stand."""
    cell = re.compile(rf'("(?:[^"]|"")*"|[^{separator}\r\n"]*)({separator}|\r?\n|\Z)')
    rows: list[list[Span]] = [[]]
    for found in cell.finditer(text):
        rows[-1].append(Span(*found.span(1)))
        if found[2] in ("\n", "\r\n"):
            rows.append([])
        elif not found[2]:
            break
    return rows


def read_parquet(path: Path, arm: Arm, direction: TargetDirection, unit: str | None, motors: str) -> JointFile:
    """The joints of a Parquet file, of LeRobot's datasets or with a column for each joint.

    Raises
    ------
    InputError
        If it is damaged or too large, has no such columns, or as `read_csv`.
    """
    hint = "pip install 'truearm[parquet]', or save it as CSV"
    pa, pq = (extra_module(name, "Parquet needs the package pyarrow", hint) for name in ("pyarrow", "pyarrow.parquet"))
    try:
        size = pq.read_metadata(path)
        if size.num_rows * size.num_columns > MAX_CELLS:
            raise InputError(f"expected at most {MAX_CELLS} cells, got {size.num_rows * size.num_columns}")
        table = pq.ParquetFile(path).read()
    except InputError:
        raise
    except Exception as error:  # it can be damaged in many ways
        raise InputError(f"the file cannot be read as Parquet ({str(error)[:80]})") from None
    metadata = table.schema.metadata or {}
    meaning = _Meaning(table.column_names, arm, direction, unit, motors)
    if not meaning.columns:
        raise InputError(
            f"expected columns of joints, got {', '.join(table.column_names)[:200]}",
            hint=f"{READ} of LeRobot, or a column for each joint by its name",
        )
    key = f"{_METADATA}{meaning.list_name or ''}".encode()
    done = metadata.get(key, b"").decode("latin-1")
    check_not_corrected(done, direction)
    columns = [_numbers(table, i) for i in meaning.columns]
    before = np.hstack([one[:, : arm.n_joints] for one in columns])
    if not len(before) or before.shape[1] != arm.n_joints or not np.isfinite(before).all():
        raise InputError(f"expected {arm.n_joints} numbers of joints in every row")

    def written(after: FloatArray, words: str) -> bytes:
        made = table
        given, replaced = 0, []
        for numbers in columns:
            width = min(numbers.shape[1], arm.n_joints)
            replaced.append(np.hstack([after[:, given : given + width], numbers[:, width:]]))
            given += width
        for i, numbers in zip(meaning.columns, replaced, strict=True):
            made = made.set_column(i, made.schema.field(i), _as_before(pa, made.schema.field(i).type, numbers))
        kept = {name: value for name, value in metadata.items() if name != key}
        made = made.replace_schema_metadata(kept if done else kept | {key: words.encode()})
        stream = io.BytesIO()
        pq.write_table(made, stream)
        return stream.getvalue()

    return JointFile(TITLE, before, meaning.scale, written)


def _numbers(table: Any, column: int) -> FloatArray:
    """(n, k) numbers of a column: of lists as many as each of them has."""
    cells = table.column(column).to_pylist()
    try:
        rows = np.array([cell if isinstance(cell, list) else [cell] for cell in cells], dtype=float)
    except (TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim != 2:
        name = table.column_names[column]
        raise InputError(f"expected numbers, or lists of one length, in the column {name[:60]!r}")
    return rows


def _as_before(pa: Any, kind: Any, numbers: FloatArray) -> Any:
    rows = numbers[:, 0].tolist() if not hasattr(kind, "value_type") else numbers.tolist()
    return pa.array(rows).cast(kind) if not hasattr(kind, "value_type") else pa.array(rows, type=kind)
