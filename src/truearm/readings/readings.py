"""Readings of an arm: joint angles and what is known of the tip at each, in rad and mm, checked when they are made."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from truearm.acceptance import contradict
from truearm.errors import InputError
from truearm.readings.pose_errors import PoseErrors
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray

# Columns with one name a reading, in the order of the session file; the first of them name what the tip touched, or
# the fixed point from which its distance was measured.
TOUCHED = ("seat", "sphere", "plane", "line", "anchor")
NAMED = (*TOUCHED, "tip", "position", "session", "serial_number")

# Blanks between two digits separate numbers: 1 1 is no 11.
_BLANKS = re.compile(r"(?<!\d)[\s_]+|[\s_]+(?!\d)")

# Mass that the flange carries [kg].
PAYLOAD = "payload_kg"
# No arm carries more [kg]; a mass in grams does exceed it.
LARGEST_PAYLOAD_KG = 1e4
# Names of further columns of numbers, such as the torque of a joint (load_1_Nm).
LOAD = re.compile(rf"load_[\w.-]+|{PAYLOAD}")

# Columns with the sign of each joint's last movement: this and the joint's number.
DIRECTION = "direction_"


ABSOLUTE_ZERO_DEGC = -273.15

# No coordinate or uncertainty is larger [mm], whatever the frame: a thousand kilometres. Beyond, squares overflow.
LARGEST_MM = 1e9

# A sphere of known size: distance of the tip's centre from the sphere's at a touch, and its standard uncertainty.
SPHERE_DISTANCE = ("sphere_distance_mm", "u_sphere_distance_mm")
# Distance to an anchor, its standard uncertainty, and that of the offset which all distances to the anchor share.
ANCHOR_DISTANCE = ("distance_mm", "u_distance_mm", "u_offset_mm")

# Columns of the session file, and the largest value of each: a tenth of a per cent and a millimetre are no reference.
SHARED_UNCERTAINTIES = {"u_scale_ppm": 10_000.0, "u_common_mm": 1.0}

# What may be stated beside the angles, in fields of their own.
_BESIDE_ANGLES = (
    *("points", "point_std", "temperature_degC", "quaternion", "sphere_distance", "directions"),
    *(*SHARED_UNCERTAINTIES, *ANCHOR_DISTANCE, *NAMED),
)


def folded_name(name: str) -> str:
    """A name in lower case and without blanks: equal for names that differ in those only."""
    return _BLANKS.sub("", name).casefold()


class NamedRows:
    """Rows that messages name, by their lines in a file or by number; a rule refuses the first that breaks it."""

    row_name: ClassVar[str] = "reading"
    file: Path | None
    numbers: IntArray | None
    by_line: bool

    def called(self, row: int) -> str:
        """Name row `row` (counted from 0) for a person: ``line 14``, without a file ``reading 12``."""
        return f"{'line' if self.by_line else self.row_name} {cast(IntArray, self.numbers)[row]}"

    def error(
        self, problem: str, row: int | None = None, *, column: str | None = None, hint: str | None = None
    ) -> InputError:
        """Make an error that states the file, and the line of `row` (counted from 0) or its number."""
        name = None if row is None or self.by_line else self.called(row)
        line = None if row is None else self.line_of(row)
        return InputError(problem, file=self.file, line=line, column=column, hint=hint, row=name)

    def refuse(
        self, bad: BoolArray, problem: str, *got: Any, column: str | None = None, hint: str | None = None
    ) -> None:
        """Raise an `error` of the first row that is `bad`, (n,) or (n, k); `problem` shows what it has in `got`."""
        if bad.any():
            row = int(np.argwhere(bad)[0, 0])
            shown = (each[row].tolist() if isinstance(each, np.ndarray) else each[row] for each in got)
            said = problem.format(*shown) if got else problem
            raise self.error(said, row, column=column, hint=hint)

    def contradict(
        self, problem: str, row: int | None = None, *, column: str | None = None, hint: str | None = None
    ) -> None:
        """Refuse readings that are contradicted with this `error`, unless a person accepts it; see `contradict`."""
        contradict(self.error(problem, row, column=column, hint=hint))

    def line_of(self, row: int) -> int | None:
        """Return the line of row `row` (counted from 0) in `file`; None if rows are not lines."""
        return int(cast(IntArray, self.numbers)[row]) if self.by_line else None


@dataclass(frozen=True, eq=False)
class Measured(NamedRows):
    """What was measured at readings whose angles are known to be right, to compare the points of a model with.

    Attributes are those of a `truearm.readings.session.Session`.
    """

    angles: FloatArray
    points: FloatArray | None
    session: NameArray | None
    seat: NameArray | None
    anchor: NameArray | None
    distance_mm: FloatArray | None
    u_offset_mm: FloatArray | None
    u_scale_ppm: FloatArray | None
    temperature_degC: FloatArray | None
    file: Path | None
    numbers: IntArray | None
    by_line: bool

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def has_point(self) -> BoolArray:
        """(n,) Whether each reading has a reference point."""
        return points_there(self.points, len(self))

    def rows(self, which: IntArray) -> Self:
        """Some of the readings."""
        of_each = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        chosen: dict[str, Any] = {name: value[which] for name, value in of_each.items()}
        return replace(self, **chosen)


def points_there(points: FloatArray | None, n: int) -> BoolArray:
    """(n,) Whether there is a point (n, 3) at each reading."""
    return np.zeros(n, bool) if points is None else ~np.isnan(points[:, 0])


@dataclass(frozen=True, eq=False)
class Readings(NamedRows):
    """The readings of a `truearm.readings.session.Session`, which describes the fields: their data and their checks."""

    # Temperatures of an arm in use [degC]; others are of another scale, or lost their decimal point.
    coldest_degC: ClassVar[float] = -50.0
    warmest_degC: ClassVar[float] = 100.0
    # A load may have any unit, but its square must be a number.
    largest_load: ClassVar[float] = 1e100
    # An angle may pass its limit by this much [rad or mm]: rounding, not a wrong angle.
    limit_tolerance: ClassVar[float] = 1e-6
    # An angle beyond this [rad or mm] is no angle, whatever the arm allows: 160,000 turns, a kilometre of rail.
    largest_angle: ClassVar[float] = 1e6
    # A quaternion's length may differ from 1 by this much, the effect of rounding to two decimals; it is normalized.
    quaternion_tolerance: ClassVar[float] = 0.01
    angles: FloatArray
    points: FloatArray | None = None
    point_std: FloatArray | None = None
    seat: NameArray | None = None
    position: NameArray | None = None
    session: NameArray | None = None
    serial_number: NameArray | None = None
    temperature_degC: FloatArray | None = None
    quaternion: FloatArray | None = None
    sphere: NameArray | None = None
    plane: NameArray | None = None
    line: NameArray | None = None
    sphere_distance: FloatArray | None = None
    anchor: NameArray | None = None
    distance_mm: FloatArray | None = None
    u_distance_mm: FloatArray | None = None
    u_offset_mm: FloatArray | None = None
    tip: NameArray | None = None
    directions: FloatArray | None = None
    u_scale_ppm: FloatArray | None = None
    u_common_mm: FloatArray | None = None
    columns: Mapping[str, FloatArray] = field(default_factory=dict)
    file: Path | None = None
    angle_columns: tuple[str, ...] | None = None
    numbers: IntArray | None = None
    by_line: bool = False
    unfilled: tuple[str, ...] = ()
    n_repeats: IntArray | None = None
    repeat_std_mm: float = 0.0
    stride: float = 1.0
    pose_errors: PoseErrors | None = None

    def __post_init__(self) -> None:
        angles = np.asarray(self.angles, dtype=float)
        if angles.ndim != 2 or angles.shape[1] < 1:
            raise InputError(f"expected angles of shape (n, n_joints), got {angles.shape}")
        object.__setattr__(self, "angles", angles)
        n = len(angles)
        numbers = np.arange(1, n + 1) if self.numbers is None else np.asarray(self.numbers, dtype=np.intp)
        if numbers.shape != (n,):
            raise InputError(f"expected numbers of shape {(n,)}, got {numbers.shape}")
        object.__setattr__(self, "numbers", numbers)
        stated = vars(self)
        # Angles alone, as in predictions one by one: checks of all that may be beside them take a tenth of the time.
        if not self.columns and all(stated[name] is None for name in _BESIDE_ANGLES) and np.isfinite(angles).all():
            return
        for name, shape in (
            ("points", (n, 3)),
            ("point_std", (n, 3)),
            ("temperature_degC", (n,)),
            ("quaternion", (n, 4)),
            ("sphere_distance", (n, 2)),
            ("directions", angles.shape),
            *((name, (n,)) for name in (*SHARED_UNCERTAINTIES, *ANCHOR_DISTANCE)),
        ):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _shaped(value, shape, name))
        for name in NAMED:
            value = getattr(self, name)
            if value is not None:
                value = np.asarray(value, dtype=np.str_)
                if value.shape != (n,):
                    raise InputError(f"expected {name} of shape {(n,)}, got {value.shape}")
                object.__setattr__(self, name, value)
        if bad := [name for name in self.columns if not LOAD.fullmatch(name)]:
            raise InputError(f"expected names of further columns such as load_1_Nm, got {bad[0]!r}")
        object.__setattr__(self, "columns", {k: _shaped(v, (n,), k) for k, v in self.columns.items()})
        self._check_numbers()
        self._check_std()
        self._check_directions()
        _check_shared_uncertainties(self)
        _check_sphere_distances(self)
        _check_anchor_distances(self)
        self._check_tips()
        self._settle_quaternion()
        if n and not self.has_point.any():
            object.__setattr__(self, "points", None)
            object.__setattr__(self, "point_std", None)

    def _check_numbers(self) -> None:
        """Finite everywhere; points, their uncertainties and quaternions may be missing, but only whole."""
        plain = {"angles": self.angles, "temperature_degC": self.temperature_degC, **self.columns}
        for name, value in plain.items():
            if value is not None:
                self.refuse(~np.isfinite(value), f"expected finite numbers in {name}, got {{}}", value)
        whole = {
            "points": "x, y and z",
            "point_std": "sx, sy and sz",
            "quaternion": "w, x, y and z",
            "sphere_distance": "distance and uncertainty",
        }
        for name, parts in whole.items():
            value = getattr(self, name)
            if value is None or np.isfinite(value).all():
                continue
            bad = np.isinf(value).any(axis=1) | (np.isnan(value).any(axis=1) & ~np.isnan(value).all(axis=1))
            if bad.any():
                row = int(np.argmax(bad))
                what = "expected finite numbers" if np.isinf(value[row]).any() else f"expected {parts} or none of them"
                raise self.error(
                    f"{what} in {name}, got {value[row].tolist()}",
                    row,
                    hint="fill in what is missing, or leave all of them out",
                )
        self._check_sizes()
        self._check_payload()
        self._check_temperature()

    def _check_sizes(self) -> None:
        """Refuse numbers so large that they are no lengths, and that later arithmetic would overflow."""
        sizes = dict.fromkeys(("points", "point_std", "sphere_distance", *ANCHOR_DISTANCE), (LARGEST_MM, " mm"))
        for name, (largest, unit) in (sizes | dict.fromkeys(self.columns, (self.largest_load, ""))).items():
            value = self.columns.get(name, getattr(self, name, None))
            if value is not None and (far := np.abs(value) > largest).any():
                row = int(np.argwhere(far)[0, 0])
                got = np.atleast_1d(value[row])[np.atleast_1d(far[row])][0]
                raise self.error(
                    f"expected numbers up to {largest:g}{unit} in {name}, got {got:g}{unit}",
                    row,
                    hint="check the unit and the decimal sign",
                )

    def _check_payload(self) -> None:
        if (kg := self.columns.get(PAYLOAD)) is not None:
            problem = f"expected a payload of 0 to {LARGEST_PAYLOAD_KG:g} kg, got {{:g}} kg"
            hint = "state the mass on the flange in kg; 0 without a payload"
            self.refuse((kg < 0) | (kg > LARGEST_PAYLOAD_KG), problem, kg, column=PAYLOAD, hint=hint)

    def _check_temperature(self) -> None:
        if self.temperature_degC is None:
            return
        degC, column = self.temperature_degC, "temperature_degC"
        hint = "check the temperature, or delete its column"
        self.refuse(degC < ABSOLUTE_ZERO_DEGC, "{:g} degC is below absolute zero", degC, column=column, hint=hint)
        problem = f"expected a temperature of {self.coldest_degC:g} to {self.warmest_degC:g} degC, got {{:g}} degC"
        hint = "state it in degC: kelvin less 273.15, or (degrees Fahrenheit - 32) / 1.8"
        self.refuse((degC < self.coldest_degC) | (degC > self.warmest_degC), problem, degC, column=column, hint=hint)

    def _check_std(self) -> None:
        if self.point_std is None:
            return
        if self.points is None:
            raise self.error("point_std needs points: without a reference point it has no meaning")
        what = np.where(self.has_point, "a point without one", "one without a point")
        problem = "expected a standard uncertainty where there is a point and only there, got {}"
        hint = "leave the uncertainties out of the file if they are not all known"
        self.refuse(np.isnan(self.point_std[:, 0]) == self.has_point, problem, what, hint=hint)
        problem = "standard uncertainties must be positive, got {} mm"
        hint = "leave the uncertainties out of the file if they are not known"
        self.refuse(self.point_std <= 0, problem, self.point_std, hint=hint)

    def _check_directions(self) -> None:
        if self.directions is None:
            return
        odd = (np.abs(self.directions) != 1) & (self.directions != 0)
        if odd.any():
            row, joint = np.argwhere(odd)[0].tolist()
            raise self.error(
                f"expected a direction of movement as -1, 0 or 1, got {self.directions[row, joint]:g} for J{joint + 1}",
                row,
                column=f"{DIRECTION}{joint + 1}",
                hint="give the sign of the joint's last movement before the reading; 0 if it is not known",
            )

    def _check_tips(self) -> None:
        """A tip of every reading, or of none."""
        if self.tip is None or (self.tip != "").all():
            return
        hint = "name the tip of all readings, or remove the column if there is one tip"
        problem = "expected the tip of every reading, got none"
        self.refuse((self.tip == "") & (self.tip != "").any(), problem, column="tip", hint=hint)
        object.__setattr__(self, "tip", None)

    def _settle_quaternion(self) -> None:
        """Make quaternions exactly of length 1, or None where no reading has one."""
        if self.quaternion is None or not len(self):
            return
        length = np.linalg.norm(self.quaternion, axis=1)
        if np.isnan(length).all():
            object.__setattr__(self, "quaternion", None)
            return
        off = np.abs(length - 1)
        problem = "expected a quaternion of length 1, got length {:.6g}"
        hint = "give an orientation as w, x, y, z; the scalar part w comes first"
        self.refuse(off > self.quaternion_tolerance, problem, length, hint=hint)
        # A normalized one stays as it is, to the last bit.
        rounded = (off > 1e-12)[:, None]
        settled = np.where(rounded, self.quaternion / length[:, None], self.quaternion)
        object.__setattr__(self, "quaternion", settled)

    def __repr__(self) -> str:
        file = f", {self.file.name}" if self.file else ""
        return f"{type(self).__name__}({len(self)} readings of {self.n_joints} joints{file})"

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.angles.shape[1])

    @property
    def has_point(self) -> BoolArray:
        """(n,) Whether each reading has a reference point."""
        return points_there(self.points, len(self))

    @property
    def measured(self) -> Measured:
        """What models are compared with."""
        return Measured(**{one.name: getattr(self, one.name) for one in fields(Measured)})

    @property
    def averaged_mm2(self) -> FloatArray:
        """(n,) by how much the variance of a coordinate is less than that of one reading, as means have it [mm^2]."""
        return np.zeros(len(self)) if self.n_repeats is None else self.repeat_std_mm**2 * (1 - 1 / self.n_repeats)

    def rows(self, which: npt.ArrayLike) -> Self:
        """Select readings by `which` (indices, slice or mask); each keeps its number or line."""
        index: Any = which if isinstance(which, slice) else np.asarray(which)
        chosen: dict[str, Any] = {
            f.name: getattr(self, f.name)[index] for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)
        }
        columns = {name: values[index] for name, values in self.columns.items()}
        errors = None if self.pose_errors is None else self.pose_errors.rows(index)
        return replace(self, **chosen, columns=columns, pose_errors=errors)


def _check_shared_uncertainties(readings: Readings) -> None:
    """Check the uncertainties of the reference that readings share.

    Raises
    ------
    InputError
        If one is negative, not finite or too large, differs within a session, or the readings have no points.
    """
    sessions = np.full(len(readings), "") if readings.session is None else readings.session
    for name, largest in SHARED_UNCERTAINTIES.items():
        values = getattr(readings, name)
        if values is None or not len(values):
            continue
        problem = f"expected {name} from 0 to {largest:g}, got {{:g}}"
        hint = "state a standard uncertainty (k = 1) in the unit of the name"
        readings.refuse(~((values >= 0) & (values <= largest)), problem, values, column=name, hint=hint)
        _, first, group = np.unique(sessions, return_index=True, return_inverse=True)
        of_first = values[first][group]
        problem = f"expected one {name} in all readings of a session, got {{:g}} beside {{:g}}"
        hint = "it belongs to the instrument, not to a reading; another instrument is another session"
        readings.refuse(values != of_first, problem, values, of_first, column=name, hint=hint)


def _check_sphere_distances(readings: Readings) -> None:
    """Distances from spheres: positive, of readings that touch one, the same for all of a sphere.

    Raises
    ------
    InputError
        With the reading and the column.
    """
    distances = readings.sphere_distance
    if distances is None:
        return
    known = ~np.isnan(distances[:, 0])
    if not known.any():
        object.__setattr__(readings, "sphere_distance", None)
        return
    touched = np.zeros(len(readings), bool) if readings.sphere is None else readings.sphere != ""
    for bad, said in (
        (known & (distances <= 0).any(axis=1), "expected a positive distance and uncertainty"),
        (known & ~touched, "expected the name of the sphere to which the distance refers, got none"),
    ):
        readings.refuse(bad, said, column=SPHERE_DISTANCE[0])
    assert readings.sphere is not None  # touched
    for name in np.unique(readings.sphere[known]):
        of_sphere = readings.sphere == name
        first = int(np.argmax(of_sphere & known))
        readings.refuse(
            of_sphere & (distances != distances[first]).any(axis=1),
            f"expected the same distance from sphere {str(name)!r} in all of its readings, but "
            f"{readings.called(first)} has another",
            column=SPHERE_DISTANCE[0],
            hint="fill it in for all of them; with another ball on the stylus use another name of the sphere",
        )


def _check_anchor_distances(readings: Readings) -> None:
    """Distances to anchors: positive, each with its anchor, with uncertainties for all of them or none.

    Raises
    ------
    InputError
        With the reading and the column.
    """
    n = len(readings)
    distance, u, u_offset = (getattr(readings, name) for name in ANCHOR_DISTANCE)
    if distance is None or not (known := ~np.isnan(distance)).any():
        _refuse_without_distance(readings)
        for name in ANCHOR_DISTANCE:
            object.__setattr__(readings, name, None)
        return
    anchor = np.full(n, "") if readings.anchor is None else readings.anchor
    rules: list[tuple[str, BoolArray, str, str | None]] = [
        ("distance_mm", known & ~(distance > 0), "expected a positive distance", "omit the reading"),
        ("anchor", known & (anchor == ""), "expected the name of the anchor of the distance, got none", None),
        ("distance_mm", ~known & (anchor != ""), "expected the distance to the anchor, got none", None),
    ]
    for name, values in (("u_distance_mm", u), ("u_offset_mm", u_offset)):
        if values is not None:
            stated = ~np.isnan(values)
            every = "state a standard uncertainty (k = 1) of every distance, or omit the column"
            rules += [
                (name, known & ~stated, f"expected {name} of the distance, got none", every),
                (name, stated & ~known, f"expected {name} only where there is a distance", every),
                (name, stated & ~(values > 0), f"expected a positive {name}", every),
            ]
    for column, bad, said, hint in rules:
        readings.refuse(bad, said, column=column, hint=hint)
    if u_offset is not None:
        _check_one_offset(readings, anchor, u_offset, known)


def _refuse_without_distance(readings: Readings) -> None:
    for name in ("anchor", *ANCHOR_DISTANCE[1:]):
        values = getattr(readings, name)
        if values is not None:
            stated = values != "" if name == "anchor" else ~np.isnan(values)
            problem = f"expected the column distance_mm beside {name}, got no distance"
            readings.refuse(stated, problem, column=name, hint="distance_mm: distance of the tip from the anchor")


def _check_one_offset(readings: Readings, anchor: NameArray, u_offset: FloatArray, known: BoolArray) -> None:
    for name in np.unique(anchor[known]):
        rows = np.flatnonzero(known & (anchor == name))
        different = u_offset[rows] != u_offset[rows[0]]
        if different.any():
            row = int(rows[np.argmax(different)])
            raise readings.error(
                f"expected one u_offset_mm for all distances to anchor {str(name)!r}, got {u_offset[row]:g} beside "
                f"{u_offset[rows[0]]:g}",
                row,
                column="u_offset_mm",
                hint="it is the uncertainty of the error that they share; another instrument is another anchor",
            )


def _shaped(value: npt.ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    array = np.asarray(value, dtype=float)
    if array.shape != shape:
        raise InputError(f"expected {name} of shape {shape}, got {array.shape}")
    return array


# What a model is compared with.
Measurements: TypeAlias = "Readings | Measured"
