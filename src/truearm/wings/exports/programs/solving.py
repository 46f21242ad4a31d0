"""From targets to corrected joints: the controller's arm, the model, and the controller's arm again."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Chain
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.programs.branches import N_JOINTS
from truearm.wings.exports.programs.configurations import nominal_joints
from truearm.wings.exports.programs.orientations import angles_of
from truearm.wings.exports.programs.program import Language, Move, Target, transform
from truearm.wings.exports.targets import TargetDirection, Untrained
from truearm.wings.exports.targets.correction import correct_targets
from truearm.wings.exports.targets.pose_models import with_tool
from truearm.wings.exports.targets.targets import Targets

# Straight moves that are looked at between their ends: the longest.
N_MOVES = 200
_SHARES = (0.25, 0.5, 0.75)


@dataclass(frozen=True, eq=False)
class Solver:
    """Corrects targets of one program.

    Attributes
    ----------
    model : Compensator
        Its nominal arm is the controller's.
    language : Language
    controller : Chain or None
        Kinematics of the controller, if they are not those of the drawing.
    direction : {"command", "feedback"}
    untrained : {"refuse", "accept"}
    """

    model: Compensator
    language: Language
    controller: Chain | None
    direction: TargetDirection
    untrained: Untrained

    @property
    def chain(self) -> Chain:
        """The controller's arm, to its flange."""
        chain = self.model.arm_.chain if self.controller is None else self.controller
        return chain.with_tip(np.zeros(3))

    def nominal(self, targets: Sequence[Target], start: FloatArray | None) -> tuple[FloatArray, list[str]]:
        """Joints (n, 6) of the controller's arm at targets, as the model counts them, and why a target has none."""
        joints, reasons = np.full((len(targets), N_JOINTS), np.nan), [""] * len(targets)
        plain = [row for row, target in enumerate(targets) if target.joints is not None]
        if plain:
            counted = np.array([targets[row].joints for row in plain])
            joints[plain] = self.language.model_joints(self.model.arm_.chain, counted)
        poses = [row for row, target in enumerate(targets) if target.joints is None]
        if poses:
            some = [targets[row] for row in poses]
            joints[poses], why = nominal_joints(self.model.arm_, self.chain, self.language, some, start)
            for row, reason in zip(poses, why, strict=True):
                reasons[row] = reason
        return joints, reasons

    def corrected(
        self, targets: Sequence[Target], nominal: FloatArray, reasons: list[str]
    ) -> tuple[FloatArray, FloatArray]:
        """Corrected joints (n, 6), and how far the tip moves (n,) [mm]; writes the reasons of what is refused."""
        corrected, shifts = np.full_like(nominal, np.nan), np.zeros(len(nominal))
        for rows, equipped in self._by_tool(targets, reasons):
            wanted, direction = Targets.of_joints(nominal[rows]), self.direction
            found = correct_targets(equipped, wanted, direction=direction, untrained=self.untrained, uncertainty=False)
            corrected[rows], shifts[rows] = found.joints, found.shift_mm
            for row, reason in zip(rows, found.reasons, strict=True):
                reasons[row] = reason
        return corrected, shifts

    def flange(self, joints: FloatArray) -> FloatArray:
        """(n, 4, 4) flange in the base of the arm."""
        T = np.tile(np.eye(4), (len(joints), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = self.chain.pose(joints)
        return T

    def _by_tool(self, targets: Sequence[Target], reasons: Sequence[str]) -> Iterator[tuple[list[int], Compensator]]:
        """Targets by their tools, each with the model that has it; without one, with the tip of the readings."""
        groups: defaultdict[bytes, list[int]] = defaultdict(list)
        for row, target in enumerate(targets):
            if not reasons[row]:
                groups[b"" if target.T_flange_tool is None else target.T_flange_tool.tobytes()].append(row)
        for rows in groups.values():
            tool = targets[rows[0]].T_flange_tool
            if tool is None:
                yield rows, self.model
            else:
                rpy = np.radians(angles_of(tool[:3, :3], (0.0, 0.0, 0.0)))
                yield rows, with_tool(self.model, np.concatenate([tool[:3, 3], rpy]))

    def bend(
        self, targets: Sequence[Target], moves: Sequence[Move], nominal: FloatArray, corrected: FloatArray
    ) -> tuple[float, int] | None:
        """How far the tip leaves straight and circular moves between two corrected ends.

        Parameters
        ----------
        targets : sequence of Target
        moves : sequence of Move
        nominal, corrected : (n, 6) array
            Of the targets; NaN where they are not corrected.

        Returns
        -------
        (float, int) or None
            The largest distance [mm], and the line of its move; None where no such move is between corrected targets.
        """
        ends = []
        for last, move in pairwise(moves):
            if move.kind != "joint" and last.target is not None and move.target is not None:
                ends.append((last.target, move.target, move.line))
        before, after = (self._tools(targets, joints) for joints in (nominal, corrected))
        lengths = [np.linalg.norm(before[a, :3, 3] - before[b, :3, 3]) for a, b, _ in ends]
        longest = [ends[i] for i in np.argsort(lengths)[::-1] if np.isfinite(lengths[i]) and lengths[i] > 0]
        worst: tuple[float, int] | None = None
        between, places, lines = [], [], []
        for a, b, line in longest[:N_MOVES]:
            tool = targets[b].T_flange_tool
            if tool is None or targets[a].T_flange_tool is not tool:
                continue
            for share in _SHARES:
                near = nominal[a] + share * (nominal[b] - nominal[a])
                counted = self.language.controller_joints(self.model.arm_.chain, near[None])[0]
                pose = _between(before[a], before[b], share)
                between.append(Target("", line, {}, pose=pose, T_flange_tool=tool, T_base_work=np.eye(4), near=counted))
                places.append(after[a, :3, 3] + share * (after[b, :3, 3] - after[a, :3, 3]))
                lines.append(line)
        if not between:
            return None
        joints, reasons = self.nominal(between, None)
        bent, _ = self.corrected(between, joints, reasons)
        away = np.linalg.norm(self._tools(between, bent)[:, :3, 3] - np.array(places), axis=1)
        if np.isfinite(away).any():
            row = int(np.nanargmax(away))
            worst = float(away[row]), lines[row]
        return worst

    def _tools(self, targets: Sequence[Target], joints: FloatArray) -> FloatArray:
        """(n, 4, 4) tools of the controller's arm in its base."""
        tools = [np.eye(4) if target.T_flange_tool is None else target.T_flange_tool for target in targets]
        return self.flange(joints) @ np.array(tools).reshape(-1, 4, 4)


def check_joints_of_model(model: Compensator) -> None:
    """Refuse an arm whose programs cannot be corrected.

    Raises
    ------
    InputError
    """
    chain = model.arm_.chain
    if chain.n_joints != N_JOINTS or chain.is_prismatic.any():
        raise InputError(
            f"programs are corrected for arms of {N_JOINTS} turning joints, and {model.arm_.name!r} is none",
            hint="a table of joint targets",
        )


def _between(T: FloatArray, T_end: FloatArray, share: float) -> FloatArray:
    """A pose between two on a straight move."""
    turn = Rotation.from_matrix(T_end[:3, :3] @ T[:3, :3].T).as_rotvec()
    R = Rotation.from_rotvec(share * turn).as_matrix() @ T[:3, :3]
    return transform(R, T[:3, 3] + share * (T_end[:3, 3] - T[:3, 3]))
