"""Targets of a robot program: joints, or poses of the tip with start joints, and what else is known of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.readings import Session, check_angles, skip_beyond_limits
from truearm.typing import FloatArray, NameArray
from truearm.wings.exports.targets.joint_files.joint_file import JointFile

Kind = Literal["joints", "poses", "positions"]


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets, one a row.

    Parameters
    ----------
    joints : (n, n_joints) array
        Joint targets; of poses the start joints, which choose the configuration [rad, or mm].
    tips : (n, 3) array, optional
        Positions of the tip [mm].
    rotations : (n, 3, 3) array, optional
        Orientations of the flange or of the tool, axes as columns; only together with `tips`.
    joint_columns : tuple of str, optional
        Names of the joint columns in the file that they came from; in degrees by default.
    words : mapping of str to (n,) array of str
        Columns of names, which go with the targets.
    temperature_degC : (n,) array, optional
    directions : (n, n_joints) array, optional
        Sign of each joint's last movement.
    loads : mapping of str to (n,) array
    given : mapping of str to (n,) array
        Every column of the table, numbers and names, in its order and units.
    file : Path, optional
    first_line : int, optional
        Line of the first target in `file`.
    joint_file : JointFile, optional
        The file of another program that they came from, which takes corrected joints.
    """

    joints: FloatArray
    tips: FloatArray | None = None
    rotations: FloatArray | None = None
    joint_columns: tuple[str, ...] | None = None
    words: Mapping[str, NameArray] = field(default_factory=dict)
    temperature_degC: FloatArray | None = None
    directions: FloatArray | None = None
    loads: Mapping[str, FloatArray] = field(default_factory=dict)
    given: Mapping[str, FloatArray | NameArray] = field(default_factory=dict)
    file: Path | None = None
    first_line: int | None = None
    joint_file: JointFile | None = None

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def kind(self) -> Kind:
        """What they state: joints, poses or positions of the tip."""
        if self.tips is None:
            return "joints"
        return "positions" if self.rotations is None else "poses"

    @classmethod
    def of_joints(cls, joints: npt.ArrayLike) -> Targets:
        """Joint targets from an array (n, n_joints) [rad, or mm].

        Raises
        ------
        InputError
            If it has another number of dimensions, no row, or a number that is not finite.
        """
        try:
            values = np.array(joints, dtype=float)
        except (TypeError, ValueError):
            raise InputError(
                f"expected joint targets as an array of numbers, got {type(joints).__name__}",
                hint="an (n, n_joints) array in rad, a DataFrame, or a CSV file",
            ) from None
        if values.ndim != 2 or not values.size:
            raise InputError(
                f"expected joint targets of shape (n, n_joints), got {values.shape}",
                hint="joints[None] for a single one",
            )
        if not np.isfinite(values).all():
            row, joint = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
            raise InputError(
                f"expected a finite number, got {values[row, joint]} for J{joint + 1} of target {row + 1}",
                hint="skip refused targets: they have no joints",
            )
        return cls(values)

    def session(self, joints: FloatArray) -> Session:
        """Readings of the same inputs (temperature, loads, directions) at other joints."""
        return Session(
            joints,
            temperature_degC=self.temperature_degC,
            directions=self.directions,
            columns=dict(self.loads),
            file=self.file,
            angle_columns=self.joint_columns,
            numbers=None if self.first_line is None else np.arange(self.first_line, self.first_line + len(joints)),
            by_line=self.first_line is not None,
        )

    def label(self, row: int) -> str:
        """Name of a target in messages: that of the file, or its number."""
        for name in ("name", "target"):
            if name in self.words and self.words[name][row]:
                return str(self.words[name][row])
        return self.joint_file.rows[row] if self.joint_file else f"target {row + 1}"

    def check(self, arm: Arm) -> None:
        """Check that they can be targets of an arm.

        Raises
        ------
        InputError
            If the number of joints is not that of the arm, the unit of a joint is not one of its kind, a number can
            be no angle, or most joints are beyond the arm's limits: another unit, or another arm.
        """
        readings = self.session(self.joints)
        check_angles(readings, n_joints=arm.n_joints, prismatic=arm.chain.is_prismatic)
        if len(self) > 1:  # a single target beyond a limit is refused by itself
            skip_beyond_limits(readings, arm.limits, prismatic=arm.chain.prismatic)
        if self.tips is not None and np.abs(self.tips).max() > Session.largest_angle:
            row = int(np.abs(self.tips).max(axis=1).argmax())
            raise InputError(
                f"the position of {self.label(row)} is {np.abs(self.tips[row]).max():.6g} mm, which no arm reaches",
                file=self.file,
                line=None if self.first_line is None else self.first_line + row,
                hint="check the unit of the positions",
            )
