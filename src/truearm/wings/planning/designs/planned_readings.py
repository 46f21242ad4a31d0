"""Poses in the order of measurement: of a box, of the whole ranges, or of a plan that is read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.delimited import Sheet, read_columns, read_form
from truearm.identification.sampling import joint_travel_limits, spread_angles
from truearm.typing import BoolArray, FloatArray, NameArray

HALF_WIDTH_RAD = float(np.radians(20.0))
"""Box of the experiment of Gao et al. 2017, inferred: their network has the stated error in a box of this size."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses in the order of measurement.

    Attributes
    ----------
    angles : (n, n_joints) array
        Inside the joint limits [rad, or mm for prismatic joints].
    rejected : mapping of str to int
        Number of rejected candidates, by reason.
    seat : (n,) array of str, optional
        The seat that holds the tip.
    seat_points : (n, 3) array, optional
        Position of that seat in the base frame [mm]; the nominal tip is in it.
    """

    angles: FloatArray
    rejected: Mapping[str, int] = field(default_factory=dict)
    seat: NameArray | None = None
    seat_points: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.angles)


def checked_count(n: int, what: str = "poses") -> int:
    """Check a number of poses, seats or places."""
    if n < 1:
        raise InputError(f"expected at least one of {what}, got {n}")
    return n


def checked_seed(seed: int) -> int:
    """Check a seed."""
    if seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed}")
    return seed


def box(arm: Arm, n: int, *, seed: int, half_width: npt.ArrayLike = HALF_WIDTH_RAD, sobol: bool = False) -> Poses:
    """Poses about the working pose, each joint uniform within `half_width` and its limits.

    Parameters
    ----------
    arm : Arm
    n : int
        Number of poses.
    seed : int
    half_width : float or (n_joints,) array
        [rad, or mm of sliding joints]. Of one number for all, sliding joints take their whole travel.
    sobol : bool
        Scrambled Sobol points, which cover the box more evenly, instead of independent ones.

    Raises
    ------
    InputError
        If a number is out of bounds, or the travel of a sliding joint is asked for that has no limits.
    """
    half = np.asarray(half_width, dtype=float)
    if half.shape not in ((), (arm.n_joints,)) or not (np.isfinite(half) & (half > 0)).all():
        raise InputError(f"expected one positive half-width or {arm.n_joints}, got {half_width!r}")
    if half.ndim == 0 and arm.chain.is_prismatic.any():
        half = np.where(arm.chain.is_prismatic, np.inf, half)
        joint_travel_limits(arm)  # which refuses a slide without ends
    lower, upper = arm.limits.T
    return Poses(
        _between(
            np.maximum(lower, arm.working - half), np.minimum(upper, arm.working + half), n, seed=seed, sobol=sobol
        )
    )


def uniform(arm: Arm, n: int, *, seed: int, sobol: bool = False, slides: FloatArray | None = None) -> Poses:
    """Poses uniform over the ranges of all joints; joints without limits over one full turn.

    Parameters
    ----------
    arm : Arm
    n : int
        Number of poses.
    seed : int
    sobol : bool
        Scrambled Sobol points, which cover the ranges more evenly, instead of independent ones.
    slides : (n_joints, 2) array, optional
        Lower and upper ends of prismatic joints without limits [mm].

    Raises
    ------
    InputError
        If a number is out of bounds, or a prismatic joint has no limits and none are stated.
    """
    return Poses(_between(*joint_travel_limits(arm, slides=slides), n, seed=seed, sobol=sobol))


def _between(lower: FloatArray, upper: FloatArray, n: int, *, seed: int, sobol: bool) -> FloatArray:
    return spread_angles(lower, upper, checked_count(n), seed=checked_seed(seed), sobol=sobol)


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
        sheet, [*map(sheet.names.index, columns), *diameters], list(map(sheet.names.index, touched)), optional=diameters
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
