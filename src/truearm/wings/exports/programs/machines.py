"""Arms as the targets of a program move them: six axes, also on a rail under the robot, or the four of a SCARA.

The rail is the first joint of the model and an external axis of the program; it stays where the program has it. The
axes of a SCARA are parallel: it cannot tilt its flange, so that a target has a position and a turn about them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from truearm.arm import Arm, Chain
from truearm.arm.rigid_motions import inverse, motion
from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray
from truearm.wings.exports.programs.branches import (
    QUANTITIES,
    ParallelAxes,
    Screws,
    inverse_branches,
    polished,
    quantities_of,
)
from truearm.wings.exports.programs.program import Language

_SIX, _FOUR = 6, 4


@dataclass(frozen=True, eq=False)
class Machine:
    """An arm and the language of its controller.

    Attributes
    ----------
    arm : Arm
        Of the model: the drawing and the limits.
    controller : Chain
        Of the controller, to its flange.
    language : Language
    axes_of : Screws or ParallelAxes
        Of the robot at the zeros of its joints, in the frame of its carriage.
    has_rail : bool
        Whether the first joint is a rail under the robot.
    """

    arm: Arm
    controller: Chain
    language: Language
    axes_of: Screws | ParallelAxes
    has_rail: bool

    @classmethod
    def of(cls, arm: Arm, controller: Chain, language: Language) -> Machine:
        """An arm with a language.

        Raises
        ------
        InputError
            If the programs of the language are not those of such an arm.
        """
        chain = arm.chain
        has_rail = chain.n_joints == _SIX + 1 and bool(chain.is_prismatic[0]) and chain.coupling is None
        robot = _without_rail(chain) if has_rail else chain
        found = Screws.of(robot) or ParallelAxes.of(robot)
        if found is None or robot.n_joints not in language.n_axes:
            raise InputError(
                "programs are corrected for arms of 6 turning joints, also on a rail, and those of Fanuc for SCARA "
                f"arms: {arm.name!r} is none",
                hint="a table of joint targets",
            )
        return cls(arm, controller, language, found, has_rail)

    @cached_property
    def robot(self) -> Chain:
        """The drawing without the rail."""
        return _without_rail(self.arm.chain) if self.has_rail else self.arm.chain

    @property
    def n_axes(self) -> int:
        """Number of joints that a target states."""
        return self.robot.n_joints

    @property
    def locked(self) -> BoolArray:
        """(n_joints,) joints that a correction does not move."""
        return np.arange(self.arm.n_joints) < self.has_rail

    def joints(self, axes: FloatArray, rail: FloatArray) -> FloatArray:
        """Joints (n, n_joints) of the model from axes (n, n_axes) of the controller [rad, or mm] and the rail (n,)."""
        joints = self.language.model_joints(self.robot, axes)
        return np.column_stack([rail, joints]) if self.has_rail else joints

    def axes(self, joints: FloatArray) -> FloatArray:
        """Axes (.., n_axes) as the controller counts them, of joints (.., n_joints)."""
        robot = joints[..., int(self.has_rail) :].reshape(-1, self.n_axes)
        return self.language.controller_joints(self.robot, robot).reshape(*joints.shape[:-1], self.n_axes)

    def branches(self, flange: FloatArray, rail: FloatArray) -> FloatArray:
        """Joints (n, n_branches, n_joints) that bring the flange to poses (n, 4, 4); NaN where one does not exist."""
        if self.has_rail:
            slides = motion(np.broadcast_to(np.eye(3), (len(rail), 3, 3)), np.outer(rail, [0.0, 0.0, 1.0]))
            flange = inverse(self.arm.chain.fixed[0] @ slides) @ flange
        if isinstance(self.axes_of, ParallelAxes):
            return self.axes_of.branches(flange)
        found = inverse_branches(self.robot, self.axes_of, flange)
        if not self.has_rail:
            return found
        on_rail = np.broadcast_to(rail[:, None, None], (*found.shape[:2], 1))
        return np.concatenate([on_rail, found], axis=2)

    def polished(self, flange: FloatArray, joints: FloatArray) -> FloatArray:
        """Joints (n, n_joints) after Newton's steps to flange poses (n, 4, 4); NaN where one is not reached."""
        turns = self.axes_of.axes[:1] if isinstance(self.axes_of, ParallelAxes) else np.eye(3)
        return polished(self.controller, flange, joints, turns=turns, locked=self.locked)

    def quantities(self, joints: FloatArray) -> FloatArray:
        """What configurations are stated by, in the order of `QUANTITIES`, of joints (.., n_joints)."""
        axes = self.axes(joints)
        if isinstance(self.axes_of, ParallelAxes):
            found = np.zeros((*joints.shape[:-1], len(QUANTITIES)))
            found[..., : self.n_axes] = np.where(self.robot.is_prismatic, axes, np.degrees(axes))
            return found
        return quantities_of(self.axes_of, self.robot.joint_angles(joints[..., int(self.has_rail) :]), axes)


def _without_rail(chain: Chain) -> Chain:
    """The chain of the joints after the first, in the frame of the carriage."""
    return Chain(chain.fixed[1:], chain.tip_in_flange, chain.is_prismatic[1:])
