"""A plan read back: the joint angles to aim at, and what the tip touches there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearm.arm import Arm
from truearm.files.delimited import Sheet, read_columns
from truearm.files.spreadsheet_forms import read_form
from truearm.typing import BoolArray, FloatArray, NameArray

AIM = "note_"
"""Columns with the angle to aim at begin with this, followed by the name of the joint's column."""
TIP_SPHERE = "note_tip_sphere_mm"
"""Column with the diameter of the sphere that the centre of the tip is on."""


@dataclass(frozen=True, eq=False)
class PlannedReadings:
    """The readings of a plan, before anything is measured.

    Attributes
    ----------
    angles : (n, n_joints) array
        To aim at [rad, or mm for sliding joints].
    seat, sphere : (n,) array of str, optional
        Name of the seat or sphere that the tip touches; empty where there is none.
    position : (n,) array of str, optional
        Name of the place of the artefact.
    file : Path
    note : (n,) array of str, optional
        Instruction for each reading.
    tip_sphere_mm : (n,) array, optional
        Diameter of the sphere that the centre of the tip is on; NaN where there is none [mm].
    """

    angles: FloatArray
    seat: NameArray | None
    sphere: NameArray | None
    position: NameArray | None
    file: Path
    note: NameArray | None = None
    tip_sphere_mm: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.angles)

    def rows_of(self, name: str, kind: str = "seat") -> BoolArray:
        """(n,) Whether a reading touches the seat or sphere of this name."""
        names = self.seat if kind == "seat" else self.sphere
        return np.zeros(len(self), bool) if names is None else names == name


def read_planned(path: str | Path, arm: Arm) -> PlannedReadings:
    """Read the file of a plan (`write_template`); what was filled in already is not read.

    Parameters
    ----------
    path : path
    arm : Arm
        The arm that the plan is for.

    Raises
    ------
    InputError
        If the file is no plan, is the plan of an arm with other joints, or a number is none, an angle far outside the
        limits of its joint or a diameter not positive.
    """
    sheet = read_form(Path(path))
    columns = _aim_columns(sheet, arm)
    touched = [name for name in ("seat", "sphere", "position", "note") if name in sheet.names]
    diameters = [sheet.names.index(name) for name in sheet.names if name == TIP_SPHERE]
    numbers, words = read_columns(
        sheet,
        [*map(sheet.names.index, columns), *diameters],
        list(map(sheet.names.index, touched)),
        optional=diameters,
    )
    numbers, tip_sphere_mm = numbers[:, : len(columns)], numbers[:, len(columns) :].ravel() if diameters else None
    if tip_sphere_mm is not None and (tip_sphere_mm <= 0).any():
        row = int(np.argmax(tip_sphere_mm <= 0))
        raise sheet.error(f"expected a diameter, got {tip_sphere_mm[row]:g}", row, column=TIP_SPHERE)
    angles = np.where(arm.chain.is_prismatic, numbers, np.radians(numbers))
    # Aims are rounded to a tenth; more than that beyond a limit is another arm.
    slack = np.where(arm.chain.is_prismatic, 1.0, np.radians(1.0))
    beyond = (angles < arm.limits[:, 0] - slack) | (angles > arm.limits[:, 1] + slack)
    if beyond.any():
        row, joint = (int(i) for i in np.argwhere(beyond)[0])
        raise sheet.error(
            f"joint J{joint + 1} of arm {arm.name!r} does not reach {numbers[row, joint]:g}",
            row,
            column=columns[joint],
            hint="give the arm that the plan was made for",
        )
    return PlannedReadings(
        angles, **_touched(sheet, dict(zip(touched, words, strict=True))), file=sheet.file, tip_sphere_mm=tip_sphere_mm
    )


def _aim_columns(sheet: Sheet, arm: Arm) -> list[str]:
    """Names of the columns with the angles to aim at, joint by joint."""
    columns = [f"{AIM}q{joint}_{unit}" for joint, unit in enumerate(arm.joint_units, start=1)]
    found = [name for name in sheet.names if name.startswith(f"{AIM}q")]
    if not found:
        raise sheet.error(
            f"expected a plan with the angles to aim at in {columns[0]}, .., got none",
            hint="the points of a verification need --artefacts"
            if "test" in sheet.names
            else "give the file that truearm plan wrote",
        )
    if found != columns:
        raise sheet.error(
            f"expected angles to aim at in {columns[0]} to {columns[-1]} for arm {arm.name!r}, got {found[0]} to "
            f"{found[-1]}",
            hint="give the arm that the plan was made for",
        )
    return columns


def _touched(sheet: Sheet, words: dict[str, NameArray]) -> dict[str, NameArray | None]:
    """Seat, sphere and position; every reading of a plan with seats touches one thing."""
    kinds = [words[name] for name in ("seat", "sphere") if name in words]
    if kinds:
        count = sum((names != "").astype(int) for names in kinds)
        if (wrong := count != 1).any():
            row = int(np.argmax(wrong))
            what = "neither a seat nor a sphere" if count[row] == 0 else "a seat and a sphere"
            raise sheet.error(f"expected a seat or a sphere, got {what}", row, column="seat")
    return {name: words.get(name) for name in ("seat", "sphere", "position", "note")}
