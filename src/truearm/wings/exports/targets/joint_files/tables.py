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
from truearm.files.file_reading import read_limited
from truearm.readings.columns import ANGLE
from truearm.typing import FloatArray
from truearm.wings.exports.targets import TargetDirection
from truearm.wings.exports.targets.joint_files.joint_file import (
    JointFile,
    Span,
    check_not_corrected,
    edited,
    known_names,
    places_of,
    turning_scale,
    wrong_names,
)
from truearm.wings.exports.targets.lerobot_motors import (
    MOTORS,
    JointValues,
    Motors,
    check_motor_values,
    joint_values,
    motors_and_arm,
    sent_range,
)

# Of LeRobot's datasets: what the motors should do, and what they did.
COMMANDED, READ = "action", "observation.state"
# The name of a motor before LeRobot changed the zeros.
_OLD = f"main_{MOTORS[0]}"
TITLE = "table of joints"
MAX_CELLS = 2**23
# Without compression.
MAX_BYTES = 2**28
_BEFORE = re.compile(r"^(?:action|observation\.state)\.|(?:\.pos|/position)$")
# Names with a joint's number that are not of velocities, currents, or forces.
_OF_POSITION = re.compile(
    r"(?:.*[^a-z])?(?:q|j|a|joint|axis|theta|pos|position|angle)s?[^a-z\d]?\d+\W*(?:[^a-z]?(?:pos|position|angle|deg|rad))*",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
SEPARATORS = ",;\t"
# Of a value whose last digit is that of the encoder: no decimals [rad].
_WHOLE = 1e-9
NO_MARK = "A CSV file has no place to say that it is corrected: truearm cannot refuse to correct it again."
_METADATA = "truearm "  # and the column of lists


def plain_names(names: Sequence[str], lists: str) -> list[str]:
    """Names of columns without what stands before and behind a joint's name; empty for those of the other lists."""
    other = READ if lists == COMMANDED else COMMANDED
    return ["" if f"{name}.".startswith(f"{other}.") else _BEFORE.sub("", name) for name in names]


def motor_columns(names: Sequence[str], lists: str) -> list[str] | None:
    """Columns of LeRobot's motors, base to tip: one each, or the first numbers of its lists; None without them.

    Raises
    ------
    InputError
        If the lists have other numbers than those of one arm, two columns are the same motor, or the motors have the
        names of before LeRobot changed their zeros.
    """
    plain = plain_names(names, lists)
    if _OLD in plain:
        raise _before_the_change()
    if set(MOTORS) <= set(plain):
        return [names[i] for i in columns_of(MOTORS, plain, names)]
    count = sum(bool(re.fullmatch(rf"{re.escape(lists)}\[\d+\]", name)) for name in names)
    if count:
        check_list_length(lists, count)
    return [f"{lists}[{i}]" for i in range(len(MOTORS))] if count else None


def _before_the_change() -> InputError:
    return InputError(
        f"{_OLD} .. are of LeRobot before it changed the zeros and the unit of the joints",
        hint="convert them as LeRobot's examples/backward_compatibility/replay.py does",
    )


def columns_of(joints: Sequence[str], plain: Sequence[str], names: Sequence[str]) -> list[int]:
    """Where joints stand among plain names; refused if two columns are the same joint."""
    for joint in joints:
        if plain.count(joint) > 1:
            same = [name for name, one in zip(names, plain, strict=True) if one == joint]
            raise InputError(f"the columns {', '.join(same)[:200]} are the same joint", hint="delete all but one")
    return [plain.index(joint) for joint in joints]


def check_list_length(name: str, count: int) -> None:
    """Check that lists are of the motors of one arm, with or without its gripper.

    Raises
    ------
    InputError
    """
    if count not in (len(MOTORS), len(MOTORS) + 1):
        raise InputError(
            f"expected 5 or 6 numbers of one arm in {name}, got {count}: they do not say which are the arm's",
            hint="a table with a column for each joint, shoulder_pan.pos and so on, of one arm",
        )


class _Meaning:
    """Which columns of a table are joints, the scale of their values, and what is said of it."""

    def __init__(
        self, names: Sequence[str], arm: Arm, direction: TargetDirection, unit: str | None, motors: str
    ) -> None:
        lists = COMMANDED if direction == "command" else READ
        other = READ if direction == "command" else COMMANDED
        self.list_name = lists if lists in names else None
        plain = plain_names(names, lists)
        of_motors = motor_columns(names, lists)
        if self.list_name is None and of_motors is None and any(f"{name}.".startswith(f"{other}.") for name in names):
            raise InputError(
                f"--direction {direction} is about {lists}, and the table has {other} only",
                hint=f"--direction {'feedback' if lists == COMMANDED else 'command'}, or rename {other} to {lists} if "
                "its numbers are that",
            )
        is_lerobot = self.list_name is not None or of_motors is not None
        self.columns: list[int] = []
        if self.list_name is not None:
            self.columns = [list(names).index(self.list_name)]
        elif of_motors is not None:
            self.columns = [list(names).index(name) for name in of_motors]
        elif set(arm.joint_names) <= set(plain):
            self.columns = columns_of(arm.joint_names, plain, names)
        elif not any(map(ANGLE.fullmatch, names)) and (places := places_of(plain, arm)) is not None:
            if not (
                any(set(known) <= set(plain) for known in known_names(arm)) or all(map(_OF_POSITION.fullmatch, plain))
            ):
                raise InputError(
                    f"the columns {', '.join(names)[:200]} do not say that they are positions of joints",
                    hint="if they are, give them such names as joint1, joint2",
                )
            self.columns = places
        self.scale: JointValues
        self._unit = unit if is_lerobot else None
        self._motors: Motors | None = None
        self.sent: tuple[FloatArray, FloatArray] | None = None
        if not self.columns:
            # Most joints of the arm: a table of joints that lacks one.
            known = [name for name in plain if any(name in names for names in known_names(arm))]
            is_other = any(map(ANGLE.fullmatch, names)) or len(known) < arm.n_joints // 2 + 1
            if not is_other and (error := wrong_names(known, arm)):
                raise error
            return
        of_lists = f"the first {arm.n_joints} numbers of " * (self.list_name is not None)
        self.said = f"Joints: {of_lists}{', '.join(names[i] for i in self.columns)} ({unit})."
        if is_lerobot:
            if arm.n_joints != len(MOTORS):
                raise InputError(f"expected the model of an SO-100 or SO-101, got one of {arm.name!r}")
            self._motors, stated = motors_and_arm(motors)
            self.scale = joint_values(unit, self._motors, stated or arm.name)
            if unit is not None and self._motors is not None and direction == "command":
                self.sent = sent_range(unit, self._motors)
        elif motors:
            raise InputError("--motors is of LeRobot's columns, and these are others", hint="omit it")
        elif unit in ("deg", "rad"):
            self.scale = turning_scale(arm, unit)
        else:
            raise InputError(
                "the columns of joints do not say their unit", hint="--angle-unit deg or rad (sliding joints mm or m)"
            )

    def check(self, values: FloatArray, rows: Sequence[str]) -> None:
        """Check that values of LeRobot can be in their unit; see `check_motor_values`."""
        if self._unit is not None:
            check_motor_values(values, rows, unit=self._unit, motors=self._motors)


def read_csv(content: bytes, arm: Arm, direction: TargetDirection, unit: str | None, motors: str) -> JointFile | None:
    """The joints of a text table; None if its header names none, so that it is another table.

    Raises
    ------
    InputError
        If the unit is not stated, or a row has no number for a joint.
    """
    text = content.decode("latin-1")
    if text.startswith("#"):  # a table of targets
        return None
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
    rows: list[str] = []
    for line, cells in enumerate(_cells(text, separator)[1:], start=2):
        if len(cells) == 1 and not text[slice(*cells[0])].strip():
            continue
        if len(cells) <= max(meaning.columns):
            raise InputError(f"expected {len(names)} cells, got {len(cells)}", line=line)
        found = [
            Span(cells[column].start + one.start(), cells[column].start + one.end())
            for column in meaning.columns
            for one in _NUMBER.finditer(text[slice(*cells[column])])
        ]
        if meaning.list_name:
            check_list_length(meaning.list_name, len(found))
            found = found[: arm.n_joints]
        if len(found) != arm.n_joints:
            raise InputError(f"expected {arm.n_joints} numbers of joints, got {len(found)}", line=line)
        spans.append(found)
        rows.append(f"line {line}")
        values.append([float(text[slice(*span)]) for span in found])
    if not values:
        raise InputError("expected at least one row of joints, got none")
    before = np.array(values)
    meaning.check(before, rows)
    digits = np.full(arm.n_joints, _WHOLE) if unit == "counts" else meaning.scale.gain

    def written(after: FloatArray, _: str) -> bytes:
        return edited(text, spans, before, after, digits).encode("latin-1")

    return JointFile(TITLE, before, meaning.scale, written, rows, (meaning.said, NO_MARK), meaning.sent)


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
        table = _read_table(pa, pq.ParquetFile(path))
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
    for info in (parent / "meta" / "info.json" for parent in path.absolute().parents[:3]):
        # A data set names the numbers of its lists beside them.
        if info.is_file() and f'"{_OLD}"'.encode() in read_limited(info, limit_bytes=MAX_BYTES):
            raise _before_the_change()
    key = f"{_METADATA}{meaning.list_name or ''}".encode()
    done = metadata.get(key, b"").decode("latin-1")
    check_not_corrected(done, direction)
    columns = [_numbers(table, i) for i in meaning.columns]
    if meaning.list_name:
        check_list_length(meaning.list_name, columns[0].shape[1])
    before = np.hstack([one[:, : arm.n_joints] for one in columns])
    rows = [f"row {i + 1}" for i in range(len(before))]
    if not len(before) or before.shape[1] != arm.n_joints or not np.isfinite(before).all():
        bad = np.flatnonzero(~np.isfinite(before).all(axis=1))
        raise InputError(
            f"expected {arm.n_joints} numbers of joints in every row", row=rows[bad[0]] if len(bad) else None
        )
    meaning.check(before, rows)

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

    return JointFile(TITLE, before, meaning.scale, written, rows, (meaning.said,), meaning.sent)


def _read_table(pa: Any, file: Any) -> Any:
    """The table of a file; refused if it is large without its compression, in which repeated cells take no bytes."""
    groups = [file.metadata.row_group(i) for i in range(file.metadata.num_row_groups)]
    chunks = [group.column(i) for group in groups for i in range(group.num_columns)]
    _check_size("cells", sum(chunk.num_values for chunk in chunks), MAX_CELLS)
    _check_size("bytes", sum(group.total_byte_size for group in groups), MAX_BYTES)
    # A text that is stored once can stand in every row; it is no longer than what is stored.
    longest = max((one.total_uncompressed_size for one in chunks if one.physical_type == "BYTE_ARRAY"), default=1)
    size, batches = 0, []
    for batch in file.iter_batches(batch_size=min(max(MAX_BYTES // max(longest, 1), 1), 2**16)):
        size += batch.nbytes
        _check_size("bytes", size, MAX_BYTES)
        batches.append(batch)
    return pa.Table.from_batches(batches, schema=file.schema_arrow)


def _check_size(what: str, size: int, limit: int) -> None:
    if size > limit:
        raise InputError(f"expected at most {limit} {what} without compression, got {size}", hint="split the file")


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
