"""Readings of an arm: joint angles and what is known of the tip at each."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError

FloatArray = npt.NDArray[np.float64]
NameArray = npt.NDArray[np.str_]

# Columns with one name a reading, in the order of the session file.
NAMED = ("seat", "position", "session")


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of an arm, one row each.

    Parameters
    ----------
    angles : (n, n_joints) array
        Joint angles as read [rad], or displacements of sliding joints [mm]. They may pass a full turn.
    points : (n, 3) array, optional
        The tip as a reference instrument saw it, in the reference's frame [mm].
    point_std : (n, 3) array, optional
        Standard uncertainties of `points` along its axes [mm].
    seat : (n,) array of str, optional
        Name of the seat that held the tip; the same name is the same, unknown point. Empty: no seat.
    position : (n,) array of str, optional
        Name of the position that the reading aimed at. Readings of one position are neighbours: a fair split into
        training and test keeps them together.
    session : (n,) array of str, optional
        Name of the set-up (base and reference unmoved) in which the reading was taken.
    temperature_degC : (n,) array, optional
        Temperature of the arm [degC].
    file : Path, optional
        Where the readings were read from; it serves messages.
    angle_columns : tuple of str, optional
        Names of the angle columns in `file`. In a session file they end in the column's unit.
    first_line : int, optional
        The line of the first reading in `file`, counted from 1; None where rows are not lines (Parquet).

    Raises
    ------
    InputError
        If lengths do not fit each other or a number is not finite.
    """

    angles: FloatArray
    points: FloatArray | None = None
    point_std: FloatArray | None = None
    seat: NameArray | None = None
    position: NameArray | None = None
    session: NameArray | None = None
    temperature_degC: FloatArray | None = None
    file: Path | None = None
    angle_columns: tuple[str, ...] | None = None
    first_line: int | None = None

    def __post_init__(self) -> None:
        angles = np.asarray(self.angles, dtype=float)
        if angles.ndim != 2 or angles.shape[1] < 1:
            raise InputError(f"expected angles of shape (n, n_joints), got {angles.shape}")
        object.__setattr__(self, "angles", angles)
        n = len(angles)
        for name, shape in (("points", (n, 3)), ("point_std", (n, 3)), ("temperature_degC", (n,))):
            value = getattr(self, name)
            if value is not None:
                value = np.asarray(value, dtype=float)
                if value.shape != shape:
                    raise InputError(f"expected {name} of shape {shape}, got {value.shape}")
                object.__setattr__(self, name, value)
        for name in NAMED:
            value = getattr(self, name)
            if value is not None:
                value = np.asarray(value, dtype=np.str_)
                if value.shape != (n,):
                    raise InputError(f"expected {name} of shape {(n,)}, got {value.shape}")
                object.__setattr__(self, name, value)
        for name in ("angles", "points", "point_std", "temperature_degC"):
            value = getattr(self, name)
            if value is not None and not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise self.error(f"expected finite numbers in {name}, got {value[row]} in {self.called(row)}", row)
        if self.point_std is not None and not (self.point_std > 0).all():
            row = int(np.argwhere(self.point_std <= 0)[0, 0])
            raise self.error(
                f"standard uncertainties must be positive, got {self.point_std[row].tolist()} mm in {self.called(row)}",
                row,
                hint="leave the uncertainties out of the file if they are not known",
            )

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.angles.shape[1])

    def called(self, row: int) -> str:
        """Name the reading in row `row` (counted from 0) for a message: its line in the file, or its number."""
        return f"reading {row + 1}" if self.first_line is None else f"line {self.first_line + row}"

    def error(
        self, problem: str, row: int | None = None, *, column: str | None = None, hint: str | None = None
    ) -> InputError:
        """Make an error that knows these readings' file, and the line of `row` (counted from 0)."""
        line = None if row is None or self.first_line is None else self.first_line + row
        return InputError(problem, file=self.file, line=line, column=column, hint=hint)

    def rows(self, which: npt.ArrayLike) -> Readings:
        """Select readings by `which` (indices, slice or mask). They no longer know their file."""
        chosen = {
            f.name: getattr(self, f.name)[which] for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)
        }
        return replace(self, **chosen, file=None, first_line=None)
