"""Columns that programs write: which of them hold joint angles, the tip, and what else belongs to a reading.

The names are those of the programs' own documentation and of public recordings: UR's RTDE (``actual_q_0``), KUKA's
system variables and RSI (``$AXIS_ACT.A1``, ``AIPos.A1``), ABB's RAPID (``rax_1``), ROS's JointState as rostopic, ros2
and PlotJuggler export it, libfranka's log (``state.q[0]``), Kinova's Kortex (``actuators[0].position``), Yaskawa's
joints S, L, U, R, B, T, OptiTrack Motive (rotation X, Y, Z, W, then position X, Y, Z), Vicon Nexus (TX, TY, TZ), and
laser trackers (X, Y, Z, ux, uy, uz).
"""

from __future__ import annotations

import re
import shlex
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, get_args

import numpy as np

from truearm.errors import InputError
from truearm.readings.readings import PAYLOAD
from truearm.typing import FloatArray, NameArray
from truearm.wings.importing.foreign.table_columns import JointUnit, TableColumns, is_other
from truearm.wings.importing.tables.table import columns_named
from truearm.wings.importing.tables.units import canonical_unit

# Four numbers in a row are a quaternion if their length is 1 in all rows, of more than this many, to rounding.
_UNIT_LENGTH, _FEW_ROWS = 1e-3, 2

# Units that a name may end in, among those that tables write.
_UNITS_OF_NAMES: tuple[str, ...] = ("deg", "rad", "gon", "mm", "m", "cm", "um", "in", "counts", "s")
_UNITS_OF_NAMES += ("degC", "degF", "K", "kg", "g", "Nm", "mNm", "A", "mA")

# Beside these, Grad are degrees; in English a grad is a gon.
_GERMAN = re.compile(r"winkel|achse|gelenk")

# Joints that have names instead of numbers, base to tip.
_NAMED_JOINTS = {
    "UR": ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"),
    "UR's pendant": ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3"),
    "AUBO": ("shoulder", "upperarm", "forearm", "wrist_1", "wrist_2", "wrist_3"),
    "Interbotix": ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate"),
    "LeRobot": ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
    "Baxter": ("s_0", "s_1", "e_0", "e_1", "w_0", "w_1", "w_2"),
    "myCobot": (*(f"joint_{i + 1}_to_joint_{i}" for i in range(1, 6)), "joint_6output_to_joint_6"),
    "Yaskawa": ("s", "l", "u", "r", "b", "t"),
    "Yaskawa of 7 axes": ("s", "l", "e", "u", "r", "b", "t"),
}
# Numbered joints: program, the unit that it fixes, and the name up to an end such as _pos. A program's own names win.
_NUMBERED_JOINTS = tuple(
    (
        program,
        unit,
        re.compile(rf"(?:(?P<before>.*)_)?(?:{name})_?(?P<i>\d+)(?:_[a-z])?(?:_?(?:pos|position|angle|value)|角度?)?"),
    )
    for program, unit, name in (
        ("UR RTDE", "rad", "actual_q"),
        ("KUKA", "deg", "(?:axis_act|axisact|aipos|e6axis)_a"),
        ("ABB", "deg", "rax"),
        ("Dobot", "deg", "q_?actual"),
        ("Doosan", "deg", "posj"),
        ("libfranka", "rad", "state_q"),
        ("Kinova Kortex", "deg", "actuators?"),
        ("ROS JointState", "rad", "(?:field|msg|joint_?states?)_position"),
        ("", "counts", "enc|encoder|counts?|ticks?|pulses?"),
        ("", None, "position"),
        ("", None, "q"),
        ("", None, "j|a|ax|joint|jnt|joint_?(?:angle|pos|position|value)s?|(?:joint|panda|fr3|iiwa)_[aj]"),
        ("", None, "theta|th|θ|angle|winkel|axis|axe|achse|gelenk|articulacion|关节|关节角|轴|関節|軸"),
    )
)

# What else of a reading is named when it is recognised.
BESIDE = ("position", "seat", "session", "temperature")

# Words beside a number that say what it is instead of a measured angle or a point.
_NOT_MEASURED = re.compile(
    r"(target|desired|des|d|calc|calculated|computed|model|cmd|command|commanded|goal|setpoint|set|nominal|nom|plan|planned|soll|aspos|home|max|min|limit)"
)
_OTHER_QUANTITY = re.compile(
    r"(tau|torques?|effort|currents?|temp|temperatures?|temper|vel|velocity|speed|qd|dq|acc|acceleration|force|load|"
    r"moment|voltage|power|mode|status|err|error|resid|residual|gyro|mag|motor|finger|gripper|knuckle|delta|diff|corr|"
    r"poscorr|normal|euler|rot|rotation|orientation|quat|quaternion|imu|linear|angular|twist|wrench|com|cog|[a-oq-su-z])"
)
_CONTROLLER = re.compile(
    r"(tcp|tcppose|flange|robot|controller|rist|rsol|pos_act|cart|cartesian|tool0|tool_pos|tool_position|ee|eef|fk|kin)"
)
_INSTRUMENT = re.compile(
    r"(tracker|lasertracker|leica|at9\d0|at40\d|lt|laser|vicon|mocap|optitrack|motive|faro|api|radian|vantage|camera|cmm|"
    r"photogrammetry|creaform|polyworks)"
)
_MEASURED = re.compile(r"meas|measured|measurement")
_ACTUAL = re.compile(rf"actual|act|ist|{_MEASURED.pattern}")
_STD = re.compile(r"u|s|std|sigma|unc|uncertainty|stdev")
# With * for the axis: of std_r* and std_rot_* the axis is one of rotation; of std_w_* it may be one of the world.
_TURNED = re.compile(r"(?<![^_])([rwabcq]\*|(rot|rotation|orientation|euler|quat|quaternion|angular|turn)\*?)(?![^_])")
_LETTER = re.compile(r"(?<![^_])[rwabcq](?![^_])")
_CAPITAL_U = re.compile(r"(?<![^\W_])U(?![^\W_xyzXYZ])")  # of an expanded uncertainty (JCGM 100, 6.2)
_AXIS = re.compile(r"(?P<before>[^\W\d_]*?)(?P<axis>[xyz])(?P<after>m|coord|pos|座標|坐标)?")
_OF_ROS = re.compile(r"field\.|/")  # as rostopic and PlotJuggler begin names
_QUATERNION = re.compile(r"(?:(?P<before>.*)_)?(?:q|quat|quaternion|orientation|rotation|rot)_?(?P<axis>[wxyz])")
_MATRIX = re.compile(r"(?:r|rot|rotation|t|m|matrix)_?([0-4])_?([0-4])")
_LOAD = re.compile(
    r"(?:.*_)?(?P<kind>tau_j|torque|effort|geartorque|joint_torque|actual_current|current)_?(?P<letter>a|j)?(?P<i>\d+)"
)
_SINGLE = {
    "temperature": r"(?:(?:air|ambient|arm|room|env|meas\w*)_)?(?:temp|temperature?|温度)(?:_(?:air|arm|degc))?",
    "payload": r"payload(?:_mass)?|nutzlast|traglast",
    "seat": r"seat|nest|socket|sitz|cup",
    "position": r"position|pose|pose_?id|pos_?id|position_?id",
    "session": r"session|set_?up",
    "serial_number": r"serial(?:_?(?:no|nr|number))?|seriennummer",
}


@dataclass(frozen=True)
class ProgramColumns:
    """Columns that were recognised: each by its name, or by its number where the name is not unique.

    Attributes
    ----------
    columns : TableColumns
        A quaternion is w first; Euler angles are roll, pitch and yaw.
    angle_units : tuple of str or None
        One a joint; None where neither the program nor the table fixes it.
    point_unit, orientation_unit : str, optional
        Where the table states them.
    orientation_order : str, optional
        Of Euler angles: ``xyz`` for roll, pitch and yaw about fixed axes.
    phrases : mapping of str to str
        What was recognised, to be printed, by the field of `columns`.
    remarks : tuple of str
        What looks like a reference and is none, or may mean two things; a sentence each.
    no_angles, no_points : InputError, optional
        Why columns that may be joint angles or reference points are not taken for them, where no others are.
    """

    columns: TableColumns
    angle_units: tuple[str | None, ...] = ()
    point_unit: str | None = None
    orientation_unit: str | None = None
    orientation_order: str | None = None
    phrases: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    no_angles: InputError | None = None
    no_points: InputError | None = None


@dataclass(frozen=True)
class _Name:
    """A column: what it is called in messages, its words without the unit, its unit, and its cells."""

    label: str
    stem: str
    unit: str | None
    written: str
    cells: FloatArray | NameArray | None = field(default=None, compare=False)


@dataclass(frozen=True)
class _Joints:
    """A run of joint angles."""

    program: str
    columns: tuple[_Name, ...]
    unit: str | None

    @property
    def is_program(self) -> bool:
        """Whether a program's own names fix the unit."""
        return bool(self.program and self.unit)


def split_unit(name: str, unit: str = "") -> tuple[str, str | None]:
    """Split a column's name into its words, in small letters and joined by _, and its unit.

    Examples
    --------
    >>> from truearm.wings.importing.foreign.program_columns import split_unit
    >>> split_unit("Joint 1 (deg)"), split_unit("tip_x_mm"), split_unit("q[0]", "rad")
    (('joint_1', 'deg'), ('tip_x', 'mm'), ('q_0', 'rad'))
    """
    text = unicodedata.normalize("NFC", name).casefold().strip().replace("º", "°")
    known = _unit_beside(text, unit)
    for pattern, is_name in (
        (r"(.*\S)\s*[\[({]\s*([^\[\](){}]*[^\[\](){}\d\s-])\s*[\])}]", False),
        (r"(.+?)\s*(?:[_\s/,.-]|\bin\b)+([^\W\d_]+|°c?)", True),
        (r"(.+\d)(°)", True),
    ):
        match = re.fullmatch(pattern, text)
        behind = _unit_beside(text, match[2]) if match and match[1].strip("_ ") else None
        if match and behind and (behind in _UNITS_OF_NAMES or not is_name):
            text, known = match[1], known or behind
            break
    return re.sub(r"[\W_]+", "_", text).strip("_"), known


def _unit_beside(text: str, written: str) -> str | None:
    unit = canonical_unit(written) or None
    return "deg" if unit == "grad" and _GERMAN.match(text) else unit


def recognise_program_columns(
    names: Sequence[str],
    units: Sequence[str] = (),
    stated: TableColumns | None = None,
    cells: Sequence[FloatArray | NameArray] = (),
) -> ProgramColumns:
    """Recognise the columns of known programs by their names, in whatever order they stand.

    Parameters
    ----------
    names, units, cells : sequence
        As `Table` has them: without its columns' cells a quaternion in numbers passes for four joints.
    stated : TableColumns, optional
        Columns that a person states: they are nothing else, and what they hold is not looked for.

    Examples
    --------
    >>> from truearm.wings.importing.foreign.program_columns import recognise_program_columns
    >>> found = recognise_program_columns([*(f"actual_q_{i}" for i in range(6)), "x_mm", "y_mm", "z_mm"])
    >>> found.phrases["angles"], found.phrases["points"]
    ('columns of UR RTDE: actual_q_0 .. actual_q_5 [rad]', 'points x_mm, y_mm, z_mm')
    """
    written = [unicodedata.normalize("NFC", name).strip() for name in names]
    of_table = [*units, *[""] * (len(names) - len(units))]
    known = stated or TableColumns()
    plain = [_without_number(name, written) for name in written]
    of_cells = [*cells, *[None] * (len(names) - len(cells))]
    taken = {i for column in known.all() for i in columns_named(names, column)}
    table = [
        _Name(
            name if name and written.count(name) == 1 else str(i + 1),
            *split_unit(plain[i], of_table[i]),
            plain[i],
            of_cells[i],
        )
        for i, name in enumerate(written)
        if i not in taken
    ]
    remarks: list[str] = []
    doubts: list[InputError] = []
    joints = None if known.angles else _chosen_joints(table, doubts)
    no_angles = doubts[0] if doubts and not joints else None
    remarks += [f"{doubt.problem}." for doubt in doubts if joints]
    free = [column for column in table if joints is None or column not in joints.columns]
    stated_angles = [split_unit(names[i])[0] for column in known.angles for i in columns_named(names, column)]
    of_angles = [column.stem for column in joints.columns] if joints else stated_angles
    found = _tip(free, remarks, of_angles, is_stated=bool(known.points))
    found |= _single(free, remarks)
    joints = _of_controller(joints, free)
    phrases: dict[str, str] = {}
    if joints:
        found["others"] |= _loads(free, joints)
        units_of = tuple(c.unit if c.unit in get_args(JointUnit) else joints.unit for c in joints.columns)
        found |= {"angles": _labels(joints.columns), "angle_units": units_of}
        unit = units_of[0] if len(set(units_of)) == 1 else None
        program = f"columns of {joints.program}: " * bool(joints.program)
        phrases["angles"] = program + _with_unit(_span(joints.columns), unit)
    if points := found.get("points"):
        phrases["points"] = _with_unit(f"points {', '.join(points)}", found["point_unit"])
    if std := found.get("point_std"):
        phrases["point_std"] = f"standard uncertainties {', '.join(std)}"
    if isinstance(found.get("position"), str):
        found["position"] = (found["position"],)
    for what in BESIDE:
        if at := found.get(what):
            phrases[what] = f"{what} {at if isinstance(at, str) else ', '.join(at)}"
    columns = TableColumns(**{f.name: found.pop(f.name) for f in fields(TableColumns) if f.name in found})
    return ProgramColumns(columns, **found, phrases=phrases, remarks=tuple(remarks), no_angles=no_angles)


def _without_number(name: str, names: Sequence[str]) -> str:
    """A name without the number by which pandas tells apart columns of one name: X.1 beside X."""
    base, point, number = name.rpartition(".")
    return base if point and number.isdecimal() and base in names else name


def _labels(columns: Iterable[_Name]) -> tuple[str, ...]:
    return tuple(column.label for column in columns)


def _with_unit(said: str, unit: str | None) -> str:
    """A phrase with the unit behind it, if its last name does not end in that."""
    return said if unit is None or split_unit(said)[1] == unit else f"{said} [{unit}]"


def _span(columns: Sequence[_Name]) -> str:
    """Names of columns that are numbered or not, for a message."""
    labels = _labels(columns)
    return f"{labels[0]} .. {labels[-1]}" if re.search(r"\d", labels[0]) else ", ".join(labels)


def _words_match(pattern: re.Pattern[str], text: str) -> bool:
    return bool(text) and (bool(pattern.fullmatch(text)) or any(pattern.fullmatch(word) for word in text.split("_")))


def _chosen_joints(table: Sequence[_Name], doubts: list[InputError]) -> _Joints | None:
    """The one run of measured joint angles; None if there is none. `doubts` say why columns are not taken for one."""
    runs = []
    for run in (*_numbered(table, doubts), *_named(table, doubts)):
        if not _is_quaternion(run):
            runs.append(run)
            continue
        problem = f"{_span(run.columns)} are no joint angles but a quaternion: its rows have the length 1"
        doubts.append(
            InputError(problem, hint=f"--orientation {_argument(run.columns)}, with --orientation-order wxyz or xyzw")
        )
    own = [run for run in runs if run.is_program] or runs
    if len(own) > 1:  # q1 .. q4 beside joints may be a quaternion
        own = [run for run in own if len(run.columns) != 4 or not run.columns[0].stem.startswith("q")] or own
    if len(own) > 1:
        both = " and ".join(_span(run.columns) for run in own)
        hint = f"--angles {_argument(own[0].columns)}"
        doubts.insert(0, InputError(f"two runs of columns may be the joint angles: {both}", hint=hint))
        return None
    return own[0] if own else None


def _of_controller(joints: _Joints | None, free: Sequence[_Name]) -> _Joints | None:
    """A1 .. A6 beside X, Y, Z, A, B, C are a KUKA's, J1 .. J6 beside X, Y, Z, W, P, R a Fanuc's: both in degrees."""
    pose = {column.stem for column in free}
    for program, letter, turned in (("KUKA", "a", {*"xyzabc"}), ("Fanuc", "j", {*"xyzwpr"})):
        if joints and not joints.is_program and turned <= pose and joints.columns[0].stem == f"{letter}1":
            return _Joints(program, joints.columns, "deg")
    return joints


def _is_quaternion(run: _Joints) -> bool:
    """Whether the rows of four columns all have the length 1, as those of no four joints have."""
    cells = [column.cells for column in run.columns]
    if len(cells) != 4 or any(one is None or one.dtype.kind != "f" for one in cells):
        return False
    rows = np.stack(cells, axis=1).astype(float)  # type: ignore[arg-type]
    rows = rows[~np.isnan(rows).any(axis=1)]
    return len(rows) > _FEW_ROWS and bool((np.abs(np.linalg.norm(rows, axis=1) - 1) < _UNIT_LENGTH).all())


def _numbered(table: Sequence[_Name], doubts: list[InputError]) -> list[_Joints]:
    runs = []
    taken: set[_Name] = set()
    for program, unit, pattern in _NUMBERED_JOINTS:
        groups: dict[tuple[str, str, int], dict[int, _Name]] = defaultdict(dict)
        for column in table:
            match = pattern.fullmatch(column.stem)
            if match is None or column in taken:
                continue
            before, i = match["before"] or "", int(match["i"])
            if not (_words_match(_NOT_MEASURED, before) or _words_match(_OTHER_QUANTITY, before)):
                end = column.stem[match.end("i") :]
                run = (column.stem[: match.start("i")], end if len(end) != len("_s") else "")
                again = next(n for n in range(len(table)) if i not in groups[*run, n])
                groups[*run, again][i] = column
        for numbers in groups.values():
            first, last = min(numbers), max(numbers)
            if first > 1 or len(numbers) < 2:
                continue
            columns = tuple(numbers[i] for i in sorted(numbers))
            if missing := sorted({*range(first, last + 1)} - numbers.keys()):
                doubts.append(_lacking(columns, re.sub(r"\d+(?=\D*$)", str(missing[0]), columns[0].written)))
                continue
            taken |= set(columns)
            if not program and all(re.search(r"[/.]position$", column.written) for column in columns):
                runs.append(_Joints("ROS JointState", columns, "rad"))
            else:
                runs.append(_Joints(program, columns, unit))
    return runs


def _lacking(columns: Sequence[_Name], lacks: str) -> InputError:
    """The error of columns that are joint angles but for one that is missing."""
    problem = f"{', '.join(_labels(columns))} may be joint angles, but {lacks} is missing"
    hint = f"export {lacks} too, or --angles {_argument(columns)} if the arm has no such joint"
    return InputError(problem, hint=hint)


def _argument(columns: Iterable[_Name]) -> str:
    """Names of columns as they are typed behind an option: quoted where they have a blank."""
    return shlex.quote(",".join(_labels(columns)))


def _named(table: Sequence[_Name], doubts: list[InputError]) -> list[_Joints]:
    runs, lacking = [], []
    for program, order in _NAMED_JOINTS.items():
        name = "|".join(sorted(order, key=len, reverse=True))
        before = r"(?:.*_)?" if len(order[0]) > 1 else ""
        pattern = re.compile(rf"{before}(?P<joint>{name})(?:_(?:joint|axis|achse))?(?:_(?:pos|position|angle|q))?")
        spaced = [re.sub(r"(?<=[a-z])(?=\d)", "_", column.stem) for column in table]  # wrist1 as wrist_1
        matches = [(pattern.fullmatch(stem), column) for stem, column in zip(spaced, table, strict=True)]
        found = [(match["joint"], column) for match, column in matches if match]
        columns = dict(found)
        if len(found) == len(columns) == len(order):
            ordered = tuple(columns[joint] for joint in order)
            is_ros = all("/position" in column.written or "_joint" in column.stem for column in ordered)
            runs.append(_Joints("ROS JointState" if is_ros else program, ordered, "rad" if is_ros else None))
        elif len(found) == len(columns) == len(order) - 1:
            (missing,) = {*order} - columns.keys()
            lacking.append((tuple(columns.values()), missing))
    whole = {column for run in runs for column in run.columns}
    for those, missing in sorted(lacking, key=lambda one: -len(one[0]))[:1]:
        if not whole.issuperset(those):
            doubts.append(_lacking(those, _written_alike(missing, those)))
    return [run for run in runs if not any({*run.columns} < {*other.columns} for other in runs)]


def _written_alike(joint: str, others: Sequence[_Name]) -> str:
    """The name of a joint as a program writes it that writes the others so: Wrist 2 beside Wrist 1."""
    spaced = joint if any("_" in one.written for one in others) else joint.replace("_", " ")
    return spaced.title() if all(one.written[0].isupper() for one in others) else spaced


def _tip(free: Sequence[_Name], remarks: list[str], of_angles: Sequence[str], *, is_stated: bool) -> dict[str, Any]:
    """Points, their uncertainties and orientations; where points are stated no others are looked for.

    `of_angles` are the words of the columns of the angles: what they call measured is the controller's measurement.
    """
    found: dict[str, Any] = _orientation(free, remarks)
    used = set(found.pop("used", ()))
    groups: dict[tuple[str, ...], dict[str, _Name]] = defaultdict(dict)
    of_array = Counter(re.sub(r"\[\d+\]$", "", column.written) for column in free)
    for column in free:
        words = column.stem.split("_")
        match = re.fullmatch(r"(.*)\[([0-2])\]", column.written)
        if match and of_array[match[1]] == 3:  # p[0], p[1], p[2] of an array
            words[-1] = "xyz"[int(match[2])]
        for k, word in enumerate(words):
            match = _AXIS.fullmatch(word)
            if match and column not in used:
                key = (*words[:k], f"{match['before']}*", *words[k + 1 :])
                again = next(str(n) for n in range(len(free)) if match["axis"] not in groups[(*key, str(n))])
                groups[(*key, again)][match["axis"]] = column
    own = {column.stem for column in free}
    of_controller = bool(of_angles) and ({"a", "b", "c"} <= own or {"w", "p", "r"} <= own or {"rx", "ry", "rz"} <= own)
    ranked: list[tuple[int, tuple[_Name, ...]]] = []
    actual: list[tuple[_Name, ...]] = []
    stds: dict[int, tuple[_Name, ...]] = {}  # of points, perhaps of orientations, of orientations
    for key, axes in groups.items():
        if len(axes) < 3:
            continue
        columns = tuple(axes[axis] for axis in "xyz")
        beside = "_".join(word.rstrip("*") for word in key[:-1] if word != "*")
        if _STD.fullmatch(beside) or any(_STD.fullmatch(w) for w in beside.split("_") if len(w) > 1):
            name = "_".join(key[:-1])
            stds[2 if _TURNED.search(name) else 1 if _LETTER.search(name) else 0] = columns
        elif _words_match(_CONTROLLER, beside) or beside == "tool" or (of_controller and not beside):
            remarks.append(
                f"{_span(columns)} are the controller's own pose, which is no reference. Use "
                f"--point {_argument(columns)} if an instrument measured them."
            )
        elif _words_match(_NOT_MEASURED, beside) and not _words_match(_OTHER_QUANTITY, beside):
            found.setdefault("position", _labels(columns))  # readings of one goal are neighbours
        elif not _words_match(_OTHER_QUANTITY, beside):
            of_instrument, measured = (_words_match(words, beside) for words in (_INSTRUMENT, _MEASURED))
            ranked.append((0 if of_instrument else 1 if measured else 2 if beside else 3, columns))
            actual += [columns] * _words_match(_ACTUAL, beside)
    # An instrument's points go before those of others, measured ones before those without a word; where the angles are
    # called measured as well, that says nothing. Any others beside each other are asked.
    said_of_angles = any(_words_match(_MEASURED, stem) for stem in of_angles)
    alike = {0: (0, 1), 1: (1, 2, 3) if said_of_angles else (1, 2), 2: (2, 3), 3: (3,)}
    first = min((rank for rank, _ in ranked), default=0)
    points = [] if is_stated else [columns for rank, columns in ranked if rank in alike[first]]
    if len(points) > 1:
        sets = "; ".join(", ".join(_labels(columns)) for columns in points)
        named = [columns for columns in points if columns in actual]
        if len(named) != 1 or any(_words_match(_ACTUAL, stem) for stem in of_angles):
            named = points
        options = [f"--point {_argument(columns)}" for columns in named]
        hint = options[0] if len(options) == 1 else f"{', or '.join(options)}: those that an instrument measured"
        found["no_points"] = InputError(f"{len(points)} sets of columns may be the points: {sets}", hint=hint)
        points = []
    if points:
        stated = {column.unit for column in points[0]}
        unit = stated.pop() if len(stated) == 1 else None
        if unit is None and all(_OF_ROS.match(column.written) for column in points[0]):
            unit = "m"  # as ROS has it (REP 103)
        found |= {"points": _labels(points[0]), "point_unit": unit}
        if stds and min(stds) < 2:
            found["point_std"] = _labels(stds[min(stds)])
        elif stds:
            remarks.append(
                f"{_span(stds[2])} are taken for standard deviations of orientations: not read. Use --point-std "
                f"{_argument(stds[2])} if they are those of the points."
            )
        if expanded := [name for name in found.get("point_std", ()) if _CAPITAL_U.search(name)]:
            remarks.append(
                f"{', '.join(expanded)} are read as standard uncertainties; a capital U often is an expanded one "
                "(k = 2). If so, halve them in the table."
            )
    own_pose = [column for column in free if re.fullmatch(r"(?:.*_)?(?:tcp_pose|o_t_ee)_?\d+", column.stem)]
    if own_pose:
        remarks.append(f"{_span(own_pose)} are the controller's own pose, which is no reference.")
    return found


def _orientation(free: Sequence[_Name], remarks: list[str]) -> dict[str, Any]:
    """Orientation columns, and which were used."""
    stems = [column.stem for column in free]
    if stems.count("x") == 2 and stems.count("w") == 1 and "z" in stems[: stems.index("w")]:  # Motive: rotation first
        at = stems.index("w")
        used = [free[at], *free[at - 3 : at]]
        return {"orientation": _labels(used), "used": used}
    groups: dict[str, dict[str, _Name]] = defaultdict(dict)
    for column in free:
        if match := _QUATERNION.fullmatch(column.stem):
            groups[match["before"] or ""][match["axis"]] = column
    whole = {b: axes for b, axes in groups.items() if len(axes) == 4 and not _words_match(_CONTROLLER, b)}
    if len(whole) == 1:
        used = [next(iter(whole.values()))[axis] for axis in "wxyz"]
        return {"orientation": _labels(used), "used": used}
    cells = {m.groups(): column for column in free if (m := _MATRIX.fullmatch(column.stem))}
    for base in (0, 1):
        rows = [[cells.get((str(i + base), str(j + base))) for j in range(3)] for i in range(3)]
        if all(all(row) for row in rows):
            used = [column for row in rows for column in row if column]
            return {"orientation": _labels(used), "used": used}
    turned = {column.stem: column for column in free}
    if {"roll", "pitch", "yaw"} <= turned.keys():
        used = [turned[name] for name in ("roll", "pitch", "yaw")]
        fixed = {"orientation_order": "xyz", "orientation_unit": used[0].unit}
        return {"orientation": _labels(used), "used": used, **fixed}
    if {"rx", "ry", "rz"} <= turned.keys():
        remarks.append(
            "rx, ry, rz may be a rotation vector or Euler angles: not read. Use --orientation rx,ry,rz with "
            "--orientation-unit, and --orientation-order for Euler angles."
        )
        return {"used": [turned[name] for name in ("rx", "ry", "rz")]}
    return {}


def _single(free: Sequence[_Name], remarks: list[str]) -> dict[str, Any]:
    """Columns of which a reading has one, such as its temperature; and those with the names of a session file."""
    others = {column.written: column.label for column in free if is_other(column.written)}
    found: dict[str, Any] = {}
    for what, pattern in _SINGLE.items():
        matching = [column for column in free if re.fullmatch(pattern, column.stem)]
        if what == "temperature" and len(matching) > 1:
            remarks.append(
                f"{', '.join(_labels(matching))} are several temperatures: none is read. "
                "Use --column temperature_degC=NAME."
            )
        elif matching:
            others.pop(matching[0].written, None)
            key = {"payload": PAYLOAD, "serial_number": "serial_number"}.get(what)
            (others if key else found)[key or what] = matching[0].label
    return {**found, "others": others}


def _loads(free: Sequence[_Name], joints: _Joints) -> dict[str, str]:
    """Loads of the joints, one each, by the names of a session file: torques [Nm] before currents [A]."""
    kinds: dict[str, dict[int, _Name]] = defaultdict(dict)
    for column in free:
        match = _LOAD.fullmatch(column.stem)
        if match and not _words_match(_NOT_MEASURED, column.stem):
            kinds["A" if "current" in match["kind"] else "Nm"].setdefault(int(match["i"]), column)
        for i, joint in enumerate(joints.columns):
            if column.stem == joint.stem.removesuffix("_position") + "_effort":
                kinds["Nm"][i] = column
    for unit in ("Nm", "A"):
        if len(kinds[unit]) == len(joints.columns) and min(kinds[unit]) < 2:
            ordered = [kinds[unit][i] for i in sorted(kinds[unit])]
            return {f"load_{i + 1}_{column.unit or unit}": column.label for i, column in enumerate(ordered)}
    return {}
