"""Which column of a foreign table holds what, and the scale of its joints: as a person states it, or by the names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Literal, Self, TypeVar, get_args

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import quoted_cell
from truearm.readings.columns import TEMPERATURE
from truearm.readings.readings import (
    ANCHOR_DISTANCE,
    DIRECTION,
    LOAD,
    NAMED,
    PAYLOAD,
    SHARED_UNCERTAINTIES,
    SPHERE_DISTANCE,
)
from truearm.typing import FloatArray

JointUnit = Literal["deg", "rad", "gon", "counts", "mm", "m"]
StatedUnit = JointUnit | Literal["percent"]  # of a range, with the calibration of motors
_T = TypeVar("_T")

_FACTORS = {"deg": np.pi / 180, "rad": 1.0, "gon": np.pi / 200, "mm": 1.0, "m": 1000.0, "counts": 2 * np.pi}

# No joint of an arm is three turns away from its zero: larger numbers are no radians [rad], those of more than three
# turns no degrees either, but counts [deg].
_LARGEST_RAD, _LARGEST_DEG = 6 * np.pi, 1080.0


@dataclass(frozen=True)
class JointScale:
    """Conversion of a table's joint values to angles: ``sign (value - zero) factor``, in rad (sliding joints in mm).

    Parameters
    ----------
    unit : str or sequence of str, optional
        ``deg``, ``rad``, ``gon``, ``counts`` of an encoder, or ``mm`` or ``m`` for a sliding joint; one for all joints
        or one each; ``percent`` of LeRobot with its calibration. By default what the table states or its numbers leave
        no doubt of.
    counts_per_turn : float or sequence, optional
        For ``counts``: how many make a full turn; one for all joints or one each.
    sign : sequence of {1, -1}, optional
        One a joint; all 1 by default.
    zero : sequence of float, optional
        The table's value where the angle is zero, in the table's unit, one a joint; all 0 by default.
    """

    unit: StatedUnit | Sequence[StatedUnit] | None = None
    counts_per_turn: float | Sequence[float] | None = None
    sign: Sequence[float] | None = None
    zero: Sequence[float] | None = None

    def units(self, n_joints: int) -> list[str]:
        """List the unit of each joint.

        Raises
        ------
        InputError
            If no unit is stated, one is unknown, or there are more or fewer than joints.
        """
        if self.unit is None:
            raise InputError("the unit of the joint angles is not stated", hint="--angle-unit deg or --angle-unit rad")
        units = [self.unit] if isinstance(self.unit, str) else list(self.unit)
        if "percent" in units:
            raise InputError("percent need LeRobot's calibration of this arm", hint="--motors CALIBRATION.json")
        if bad := [u for u in units if u not in get_args(JointUnit)]:
            raise InputError(
                f"unknown unit of angles {quoted_cell(bad[0])}", hint=f"one of {', '.join(get_args(JointUnit))}"
            )
        return [str(u) for u in _for_each(units, n_joints, "angle unit")]

    def to_angles(self, values: FloatArray) -> FloatArray:
        """Scale (n, n_joints) values of a table to angles [rad], or displacements of sliding joints [mm]."""
        n = values.shape[1]
        factor = np.array([_FACTORS[u] for u in self.units(n)])
        counted = np.array([unit == "counts" for unit in self.units(n)])
        if counted.any():
            factor = factor / np.where(counted, self._per_turn(n), 1.0)
        sign = np.ones(n) if self.sign is None else np.array(_each(self.sign, n, "sign"), dtype=float)
        if not np.isin(sign, (1, -1)).all():
            raise InputError(f"signs must be + or - for each joint, got {quoted_cell(self.sign)}")
        zero = np.zeros(n) if self.zero is None else np.array(_for_each(self.zero, n, "zero"), dtype=float)
        if not np.isfinite(zero).all():
            raise InputError(f"zeros must be finite numbers, got {quoted_cell(self.zero)}")
        return np.asarray(sign * (values - zero) * factor + 0.0)  # + 0.0: no "-0"

    def _per_turn(self, n: int) -> FloatArray:
        if self.counts_per_turn is None:
            raise InputError("encoder counts need the counts of a full turn", hint="--counts-per-turn 65536")
        given = np.atleast_1d(np.asarray(self.counts_per_turn, dtype=float)).tolist()
        counts = np.array(_for_each(given, n, "counts per turn"))
        if not (np.isfinite(counts) & (counts > 0)).all():
            raise InputError(f"counts per turn must be positive, got {quoted_cell(self.counts_per_turn)}")
        return counts


def certain_unit(values: FloatArray) -> JointUnit | None:
    """Return ``deg`` if (n, n_joints) joint values can be nothing else: several joints turn too far for radians."""
    largest = np.nanmax(np.abs(values), axis=0, initial=0.0)
    turns_far = np.count_nonzero(largest > _LARGEST_RAD) > len(largest) / 2
    return "deg" if turns_far and (largest < _LARGEST_DEG).all() else None


def _for_each(given: Sequence[_T], n: int, what: str) -> list[_T]:
    """Repeat one value for all joints, or return one for each."""
    return list(given) * n if len(given) == 1 else _each(given, n, what)


def _each(given: Sequence[_T], n: int, what: str) -> list[_T]:
    if len(given) != n:
        raise InputError(f"expected one {what} for each of the {n} joints, got {len(given)}")
    return list(given)


# Columns of the session file that hold numbers and that `TableColumns.others` may state, beside loads and directions.
OTHER_NUMBERS = (*SPHERE_DISTANCE, *ANCHOR_DISTANCE, *SHARED_UNCERTAINTIES, PAYLOAD)
# Those with a name a reading that have no field of their own.
OTHER_NAMES = tuple(name for name in NAMED if name not in ("seat", "session", "position"))


@dataclass(frozen=True)
class TableColumns:
    """Which column of a table holds what: each by its name in the header, or by its number counted from 1.

    Parameters
    ----------
    angles : sequence of str, optional
        One column a joint, base to tip.
    points, point_std : sequence of three str, optional
        Reference point and its standard uncertainties, x, y, z.
    seat, session, temperature : str, optional
        Temperature in degC.
    position : sequence of str
        One column, or several that together name the position a reading aimed at, as its goal x, y and z.
    orientation : sequence of str
        Orientation of the flange in the frame of the points: 3 columns of a rotation vector or of Euler angles, 4 of a
        quaternion, or 9, 12 or 16 of a matrix, row by row. A matrix of 12 or 16 has the point too, in its last column.
    others : mapping of str to str
        What else a session file can hold, by its column there (docs/session-file.md): ``tip``, ``anchor``,
        ``distance_mm``, ``sphere``, ``serial_number``, ``payload_kg``, ``load_1_Nm``, ``direction_1``, ..
    """

    angles: Sequence[str] = ()
    points: Sequence[str] = ()
    point_std: Sequence[str] = ()
    seat: str | None = None
    session: str | None = None
    temperature: str | None = None
    position: Sequence[str] = ()
    orientation: Sequence[str] = ()
    others: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("points", "point_std"):
            if len(getattr(self, name)) not in (0, 3):
                raise InputError(f"expected three columns (x, y, z) for {name}, got {len(getattr(self, name))}")
        if len(self.orientation) in (12, 16) and self.points:
            raise InputError("the points are given twice, by columns of their own and by the last column of a matrix")
        if self.angles and self.point_std and not self.coordinates:
            raise InputError("point_std needs points: without a reference point it has no meaning")
        for name in self.others:
            if not is_other(name):
                hint = f"one of {', '.join((*OTHER_NAMES, *OTHER_NUMBERS, 'load_..', f'{DIRECTION}1'))}"
                raise InputError(f"a session file has no column {quoted_cell(name)} to import to", hint=hint)

    @property
    def coordinates(self) -> Sequence[str]:
        """Columns of x, y, z of the tip: those of the points, or those that a matrix has; none without either."""
        has_them = len(self.orientation) in (12, 16)
        return [self.orientation[i] for i in (3, 7, 11)] if has_them else self.points

    def all(self) -> list[str]:
        """Every column that is read."""
        several = (*self.angles, *self.points, *self.point_std, *self.position, *self.orientation)
        single = (self.seat, self.session, self.temperature)
        return [*several, *(column for column in single if column), *self.others.values()]

    def or_else(self, known: TableColumns) -> Self:
        """Return these columns, and those of `known` for what is not stated here."""
        chosen = {f.name: getattr(self, f.name) or getattr(known, f.name) for f in fields(self)}
        if len(self.orientation) in (12, 16):
            chosen["points"] = ()
        if self.points and not self.point_std:
            chosen["point_std"] = ()  # those of other points
        return type(self)(**(chosen | {"others": {**known.others, **self.others}}))


def is_other(name: str) -> bool:
    """Whether a session file has a column of this name that `TableColumns.others` may state."""
    if name.startswith(DIRECTION):
        return name.removeprefix(DIRECTION).isdecimal()
    return name in (*OTHER_NAMES, *OTHER_NUMBERS) or (LOAD.fullmatch(name) is not None and name != TEMPERATURE)
