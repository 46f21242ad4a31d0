"""Scale of joint values: degrees, radians, millimetres or counts of an encoder become rad and mm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar, get_args

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import quoted_cell
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
