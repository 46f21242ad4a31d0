"""Readings of an arm: joint angles and what is known of the tip at each."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray, NameArray

# Columns with one name a reading, in the order of the session file; the first of them name what the tip was on.
TOUCHED = ("seat", "sphere", "plane", "line")
NAMED = (*TOUCHED, "position", "session")

# Names of further columns of numbers, such as the torque of a joint (load_1_Nm).
LOAD = re.compile(r"load_[\w.-]+")

# A sphere whose size is known: how far the tip's centre is from the sphere's where it touches, and how surely.
SPHERE_DISTANCE = ("sphere_distance_mm", "u_sphere_distance_mm")

# Columns with the sign of each joint's last movement: this and the joint's number.
DIRECTION = "direction_"

# A quaternion's length may differ from 1 by this much: what rounding to two decimals leaves. It is made 1 then.
QUATERNION_TOLERANCE = 0.01


@dataclass(frozen=True, eq=False)
class Session:
    """Readings of an arm, one row each.

    Parameters
    ----------
    angles : (n, n_joints) array
        Joint angles as read [rad], or displacements of sliding joints [mm]. They may pass a full turn.
    points : (n, 3) array, optional
        The tip as a reference instrument saw it, in the reference's frame [mm]. A row of NaN: the instrument did not
        see that reading. None where it saw no reading at all.
    point_std : (n, 3) array, optional
        Standard uncertainties of `points` along its axes [mm]; NaN where there is no point.
    seat : (n,) array of str, optional
        Name of the seat that held the tip; the same name is the same, unknown point. Empty: no seat.
    position : (n,) array of str, optional
        Name of the position that the reading aimed at. Readings of one position are neighbours: a fair split into
        training and test keeps them together.
    session : (n,) array of str, optional
        Name of the set-up (base and reference unmoved) in which the reading was taken.
    temperature_degC : (n,) array, optional
        Temperature of the arm [degC].
    quaternion : (n, 4) array, optional
        Orientation of the flange in the reference's frame, a unit quaternion w, x, y, z. A row of NaN: not measured.
    sphere, plane, line : (n,) array of str, optional
        Name of the surface (line) that the tip touched; the same name is the same, unknown one. Empty: none.
    sphere_distance : (n, 2) array, optional
        Distance of the tip's centre from the centre of the sphere that it touches, where that is known, and its
        standard uncertainty [mm]: half of both diameters together for a ball on a stylus. A row of NaN: not known. The
        same in all readings of a sphere.
    directions : (n, n_joints) array, optional
        Sign of each joint's last movement before the reading: -1, 1, or 0 where it is not known.
    columns : mapping of str to (n,) array, optional
        Further columns of numbers by their name, which starts with ``load_``: torque or load of a joint.
    file : Path, optional
        Where the readings were read from; it serves messages.
    angle_columns : tuple of str, optional
        Names of the angle columns in `file`. In a session file they end in the column's unit.
    first_line : int, optional
        The line of the first reading in `file`, counted from 1; None where rows are not lines (Parquet).

    Raises
    ------
    InputError
        If lengths do not fit each other, a number is not finite, a point or a quaternion is there in part, a
        quaternion is not of length 1, a direction is not -1, 0 or 1, or distances from a sphere are not positive or
        differ.
    """

    angles: FloatArray
    points: FloatArray | None = None
    point_std: FloatArray | None = None
    seat: NameArray | None = None
    position: NameArray | None = None
    session: NameArray | None = None
    temperature_degC: FloatArray | None = None
    quaternion: FloatArray | None = None
    sphere: NameArray | None = None
    plane: NameArray | None = None
    line: NameArray | None = None
    sphere_distance: FloatArray | None = None
    directions: FloatArray | None = None
    columns: Mapping[str, FloatArray] = field(default_factory=dict)
    file: Path | None = None
    angle_columns: tuple[str, ...] | None = None
    first_line: int | None = None

    def __post_init__(self) -> None:
        angles = np.asarray(self.angles, dtype=float)
        if angles.ndim != 2 or angles.shape[1] < 1:
            raise InputError(f"expected angles of shape (n, n_joints), got {angles.shape}")
        object.__setattr__(self, "angles", angles)
        n = len(angles)
        for name, shape in (
            ("points", (n, 3)),
            ("point_std", (n, 3)),
            ("temperature_degC", (n,)),
            ("quaternion", (n, 4)),
            ("sphere_distance", (n, 2)),
            ("directions", angles.shape),
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
        self._check_spheres()
        self._settle_quaternion()
        if n and not self.has_point.any():
            object.__setattr__(self, "points", None)
            object.__setattr__(self, "point_std", None)

    def _check_numbers(self) -> None:
        """Finite everywhere; points, their uncertainties and quaternions may be missing, but only whole."""
        plain = {"angles": self.angles, "temperature_degC": self.temperature_degC, **self.columns}
        for name, value in plain.items():
            if value is not None and not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise self.error(f"expected finite numbers in {name}, got {value[row]} in {self.label(row)}", row)
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
                    f"{what} in {name}, got {value[row].tolist()}{self._where(row)}",
                    row,
                    hint="fill in what is missing, or leave all of them out",
                )

    def _check_std(self) -> None:
        if self.point_std is None:
            return
        if self.points is None:
            raise self.error("point_std needs points: there is no reference to be uncertain")
        odd = np.isnan(self.point_std[:, 0]) == self.has_point
        if odd.any():
            row = int(np.argmax(odd))
            what = "a point without one" if self.has_point[row] else "one without a point"
            raise self.error(
                f"expected a standard uncertainty where there is a point and only there, got {what}{self._where(row)}",
                row,
                hint="leave the uncertainties out of the file if they are not all known",
            )
        if (self.point_std <= 0).any():
            row = int(np.argwhere(self.point_std <= 0)[0, 0])
            raise self.error(
                f"standard uncertainties must be positive, got {self.point_std[row].tolist()} mm in {self.label(row)}",
                row,
                hint="leave the uncertainties out of the file if they are not known",
            )

    def _check_directions(self) -> None:
        if self.directions is None:
            return
        odd = ~np.isin(self.directions, (-1.0, 0.0, 1.0))
        if odd.any():
            row, joint = np.argwhere(odd)[0].tolist()
            raise self.error(
                f"expected a direction of movement as -1, 0 or 1, got {self.directions[row, joint]:g} for joint "
                f"{joint + 1}{self._where(row)}",
                row,
                column=None if self.first_line is None else f"{DIRECTION}{joint + 1}",
                hint="the sign of the joint's last movement before the reading; 0 where it is not known",
            )

    def _check_spheres(self) -> None:
        """Distances from spheres: positive, of readings that touch one, the same for all of a sphere."""
        if self.sphere_distance is None:
            return
        known = ~np.isnan(self.sphere_distance[:, 0])
        if not known.any():
            object.__setattr__(self, "sphere_distance", None)
            return
        touched = np.zeros(len(self), bool) if self.sphere is None else self.sphere != ""
        for bad, said in (
            (known & (self.sphere_distance <= 0).any(axis=1), "expected a positive distance and uncertainty"),
            (known & ~touched, "expected the name of the sphere that the distance is from, got none"),
        ):
            if bad.any():
                row = int(np.argmax(bad))
                column = None if self.first_line is None else SPHERE_DISTANCE[0]
                raise self.error(f"{said}{self._where(row)}", row, column=column)
        assert self.sphere is not None  # touched
        for name in np.unique(self.sphere[known]):
            rows = np.flatnonzero(self.sphere == name)
            first = rows[known[rows]][0]
            same = (self.sphere_distance[rows] == self.sphere_distance[first]).all(axis=1)
            if not same.all():
                row = int(rows[np.argmin(same)])
                raise self.error(
                    f"expected the same distance from sphere {str(name)!r} in all of its readings, got another than in "
                    f"{self.label(int(first))}{self._where(row)}",
                    row,
                    column=None if self.first_line is None else SPHERE_DISTANCE[0],
                    hint="fill it in for all of them; with another ball on the stylus, another name of the sphere",
                )

    def _settle_quaternion(self) -> None:
        """Make quaternions exactly of length 1, or None where no reading has one."""
        if self.quaternion is None or not len(self):
            return
        length = np.linalg.norm(self.quaternion, axis=1)
        if np.isnan(length).all():
            object.__setattr__(self, "quaternion", None)
            return
        off = np.abs(length - 1)
        if np.nanmax(off) > QUATERNION_TOLERANCE:
            row = int(np.nanargmax(off > QUATERNION_TOLERANCE))
            raise self.error(
                f"expected a quaternion of length 1, got length {length[row]:.6g}{self._where(row)}",
                row,
                hint="an orientation as w, x, y, z; the scalar part w comes first",
            )
        # One that is right already stays as it is, to the last bit.
        rounded = (off > 1e-12)[:, None]
        settled = np.where(rounded, self.quaternion / length[:, None], self.quaternion)
        object.__setattr__(self, "quaternion", settled)

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.angles.shape[1])

    @property
    def has_point(self) -> BoolArray:
        """(n,) Whether each reading has a reference point."""
        return np.zeros(len(self), bool) if self.points is None else ~np.isnan(self.points[:, 0])

    def label(self, row: int) -> str:
        """Name the reading in row `row` (counted from 0) for a message: its line in the file, or its number."""
        return f"reading {row + 1}" if self.first_line is None else f"line {self.first_line + row}"

    def _where(self, row: int) -> str:
        """Name the row within a message that does not begin with its line."""
        return f" in {self.label(row)}" if self.first_line is None else ""

    def error(
        self, problem: str, row: int | None = None, *, column: str | None = None, hint: str | None = None
    ) -> InputError:
        """Make an error that knows these readings' file, and the line of `row` (counted from 0)."""
        line = None if row is None or self.first_line is None else self.first_line + row
        return InputError(problem, file=self.file, line=line, column=column, hint=hint)

    def rows(self, which: npt.ArrayLike) -> Session:
        """Select readings by `which` (indices, slice or mask). They no longer know their file."""
        index: Any = which
        chosen = {
            f.name: getattr(self, f.name)[index] for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)
        }
        columns = {name: values[index] for name, values in self.columns.items()}
        return replace(self, **chosen, columns=columns, file=None, first_line=None)


def _shaped(value: npt.ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    array = np.asarray(value, dtype=float)
    if array.shape != shape:
        raise InputError(f"expected {name} of shape {shape}, got {array.shape}")
    return array
