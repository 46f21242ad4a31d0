"""Which column of a foreign table holds what, as a person states it or as the names tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Self

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
