"""From targets to corrected joints: the controller's arm, the model, and the controller's arm again."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Arm, Chain
from truearm.arm.rigid_motions import inverse, motion
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray
from truearm.wings.exports.programs.branches import (
    QUANTITIES,
    ParallelAxes,
    Screws,
    inverse_branches,
    polished,
    quantities_of,
)
from truearm.wings.exports.programs.frames_file import FramesFile
from truearm.wings.exports.programs.numbers import NOT_THERE, angles_of
from truearm.wings.exports.programs.program import Condition, Language, Move, MoveKind, Target
from truearm.wings.exports.targets import TargetDirection, Untrained
from truearm.wings.exports.targets.correction import correct_targets
from truearm.wings.exports.targets.pose_models import with_tool
from truearm.wings.exports.targets.targets import Targets

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


# A target is printed with two or three decimals: its joints may be this far across a border [deg, mm].
_ACROSS = 0.05
_TURNS = np.array([0, 1, -1, 2, -2])
_SAME = np.radians(0.1)


def nominal_joints(machine: Machine, targets: Sequence[Target], rail: FloatArray) -> tuple[FloatArray, list[str]]:
    """Joints of the controller's arm at Cartesian targets.

    Parameters
    ----------
    machine : Machine
    targets : sequence of Target
        Cartesian ones, with both frames.
    rail : (n,) array
        Where the rail under the robot is; of no effect without one [mm].

    Returns
    -------
    (n, n_joints) array
        Of the model [rad, or mm]; NaN where there is a reason.
    list of str
        Why a target has no joints; empty for those that have.
    """
    n, arm = len(targets), machine.arm
    works, poses, tools = (
        np.array([getattr(target, name) for target in targets]) for name in ("T_base_work", "pose", "T_flange_tool")
    )
    flange = works @ poses @ inverse(tools)
    branches = machine.branches(flange, rail)
    low, high = np.full((2, n, len(QUANTITIES)), [[[-np.inf]], [[np.inf]]])
    near, stated = np.full((n, machine.n_axes), np.nan), np.zeros(n, dtype=bool)
    for row, target in enumerate(targets):
        for condition in target.conditions:
            at = QUANTITIES.index(condition.quantity)
            low[row, at], high[row, at] = condition.low, condition.high
        if target.near is not None:
            near[row] = target.near
        stated[row] = bool(target.conditions) or target.near is not None
    turned, off, far = _with_turns(machine, branches, (low, high), near)
    exists = np.isfinite(branches).all(axis=2)
    limits = arm.limits.T
    beyond = (turned < limits[0] - Session.limit_tolerance) | (turned > limits[1] + Session.limit_tolerance)
    inside: BoolArray = exists & ~beyond.any(axis=2)
    fits = inside & (off <= _ACROSS)
    rank = np.where(fits, off + np.where(np.isfinite(far), far, 0.0) * 1e3, np.inf)
    rows, best = np.arange(n), rank.argmin(axis=1)
    joints = turned[rows, best]
    rivals = fits & (np.abs(_wrapped(turned - joints[:, None])).max(axis=2) > _SAME)
    rivals &= np.isnan(near).any(axis=1)[:, None] & ((off == 0) | (off[rows, best] > 0)[:, None])
    rows_of = (exists, inside, fits, rivals, stated[:, None])
    reasons = [_reason(*row) for row in np.stack([np.any(one, axis=1) for one in rows_of], axis=1).tolist()]
    good = np.array([not reason for reason in reasons], dtype=bool)
    joints[good] = machine.polished(flange[good], joints[good])
    for row in np.flatnonzero(good & np.isnan(joints).any(axis=1)).tolist():
        reasons[row] = "out of reach of the controller's own kinematics"
    joints[[bool(reason) for reason in reasons]] = np.nan
    return joints, reasons


def _with_turns(
    machine: Machine, branches: FloatArray, bounds: tuple[FloatArray, FloatArray], near: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Branches in the turns that fit best, how far they are from what is stated [deg, mm], and from joints nearby."""
    low, high = (bound[:, None] for bound in bounds)
    limits, turning, n_axes = machine.arm.limits.T, ~machine.arm.chain.is_prismatic, machine.n_axes
    found, least = branches.copy(), np.full(branches.shape, np.inf)
    with np.errstate(invalid="ignore"):
        for turn in 2 * np.pi * _TURNS:
            joints = branches + turn * turning
            counted = machine.axes(joints)
            degrees = np.degrees(counted)
            off = np.maximum(np.maximum(low[..., :n_axes] - degrees, degrees - high[..., :n_axes]), 0.0)
            beyond = np.maximum(np.maximum(limits[0] - joints, joints - limits[1]), 0.0)
            # What is stated counts most, then the limits, then joints nearby, then the fewest turns.
            beside = np.nan_to_num(np.abs(counted - near[:, None]))
            cost = 1e3 * beyond + 1e-3 * abs(turn)
            cost[..., int(machine.has_rail) :] += 1e6 * off + beside
            better = cost < least
            found, least = np.where(better, joints, found), np.where(better, cost, least)
        counted, quantities = machine.axes(found), machine.quantities(found)
        off = np.maximum(np.maximum(low - quantities, quantities - high), 0.0).max(axis=2)
    away = np.abs(counted - near[:, None])[..., ~machine.robot.is_prismatic]  # mm and rad do not compare
    return found, off, away.max(axis=2)


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray(np.remainder(angle + np.pi, 2 * np.pi) - np.pi)


# What the targets of another robot are, too.
ROBOT = "check its tool, its work frame and the robot"
NO_POSTURE = "no posture within the limits has its configuration"


def _reason(exists: bool, inside: bool, fits: bool, rivals: bool, stated: bool) -> str:
    if not exists:
        return f"out of reach of the nominal arm: {ROBOT}"
    if not inside:
        return f"only reached beyond a joint limit: {ROBOT}"
    if not fits:
        return f"{NO_POSTURE}: {ROBOT}"
    if rivals and stated:
        return "several postures have its configuration"
    return "its configuration is not stated: --start states joints nearby" if rivals else ""


# Straight moves that are looked at between their ends: the longest.
N_MOVES = 200
_SHARES = (0.25, 0.5, 0.75)
_SIGNS = ("shoulder", "elbow", "J5")
_BORDER = 1.0  # of a configuration [deg, mm]


class PathEnds(NamedTuple):
    """The ends of a move by their numbers, and its line."""

    start: int
    end: int
    line: int


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
    stated : FramesFile
        The rail under the robot, if the model has one, and inputs of the model.
    """

    model: Compensator
    language: Language
    controller: Chain | None
    direction: TargetDirection
    untrained: Untrained
    stated: FramesFile = field(default_factory=FramesFile)

    @cached_property
    def machine(self) -> Machine:
        """The arm as targets move it."""
        return Machine.of(self.model.arm_, self.chain, self.language)

    @property
    def chain(self) -> Chain:
        """The controller's arm, to its flange."""
        chain = self.model.arm_.chain if self.controller is None else self.controller
        return chain.with_tip(np.zeros(3))

    def nominal(
        self, targets: Sequence[Target], start: FloatArray | None, moves: Sequence[Move] = ()
    ) -> tuple[FloatArray, list[str]]:
        """Joints (n, 6) of the controller's arm at targets, as the model counts them, and why a target has none.

        A straight move keeps the configuration: a target that states none has that of the target that the arm comes
        from. Only where that is not known, `start` chooses it.
        """
        before = _predecessors(targets, moves)
        given = [
            replace(target, near=start) if _is_open(target) and row not in before else target
            for row, target in enumerate(targets)
        ]
        first = [row for row in range(len(targets)) if row not in before]
        joints, reasons = np.full((len(targets), self.model.arm_.n_joints), np.nan), [""] * len(targets)
        self._solve(given, first, joints, reasons)
        if not before:
            return joints, reasons
        signs, roots = self._signs(joints), _roots(before)
        for row, root in roots.items():
            given[row] = replace(targets[row], **({"conditions": signs[root]} if signs[root] else {"near": start}))
        self._solve(given, list(roots), joints, reasons)
        self._unwind(joints, reasons, {row: before[row] for row, root in roots.items() if signs[root]})
        return joints, reasons

    def _signs(self, joints: FloatArray) -> list[tuple[Condition, ...]]:
        """The configurations of joints as conditions; empty where they are not known, or near a border."""
        values = self.machine.quantities(joints)
        signs: list[tuple[Condition, ...]] = []
        for row in values[:, [QUANTITIES.index(name) for name in _SIGNS]].tolist():
            conditions = tuple(Condition.sign(name, negative=not q > 0) for name, q in zip(_SIGNS, row, strict=True))
            signs.append(conditions if min(map(abs, row)) > _BORDER else ())
        return signs

    def _unwind(self, joints: FloatArray, reasons: list[str], before: Mapping[int, int]) -> None:
        """Turn the joints of targets on a path into those nearest to the target before; of `before` the first first."""
        low, high = self.model.arm_.limits.T
        whole = np.where(self.model.arm_.chain.is_prismatic, np.inf, 2 * np.pi)
        last: dict[int, int | None] = {}
        for row, one in before.items():
            near = last[row] = one if not reasons[one] else last.get(one)
            if near is None or reasons[row]:
                continue
            turns = np.round((joints[row] - joints[near]) / whole)
            joints[row] -= np.where(turns, turns * whole, 0.0)
            if ((joints[row] < low - Session.limit_tolerance) | (joints[row] > high + Session.limit_tolerance)).any():
                reasons[row] = "the straight move to it leads beyond a joint limit"
                joints[row] = np.nan

    def _solve(self, targets: Sequence[Target], rows: Sequence[int], joints: FloatArray, reasons: list[str]) -> None:
        """Write the joints of some targets, and why one has none."""
        if self.machine.has_rail:
            for row in rows:
                if np.isnan(self._rail(targets[row])):
                    reasons[row] = f"its external axis {self.stated.rail}, the rail under the robot, is not stated"
            rows = [row for row in rows if not reasons[row]]
        plain = [row for row in rows if targets[row].joints is not None]
        if plain:
            counted = np.array([targets[row].joints for row in plain])
            joints[plain] = self.machine.joints(counted, self._rails(targets, plain))
        poses = [row for row in rows if targets[row].joints is None]
        if poses:
            some = [targets[row] for row in poses]
            joints[poses], why = nominal_joints(self.machine, some, self._rails(targets, poses))
            for row, reason in zip(poses, why, strict=True):
                reasons[row] = reason

    def _rail(self, target: Target) -> float:
        """Where the rail is at a target [mm]; NaN if that is not stated."""
        value = target.external[self.stated.rail - 1].value if len(target.external) >= self.stated.rail else np.nan
        return value if abs(value) < NOT_THERE else np.nan

    def _rails(self, targets: Sequence[Target], rows: Sequence[int]) -> FloatArray:
        return np.array([self._rail(targets[row]) if self.machine.has_rail else 0.0 for row in rows])

    def corrected(
        self, targets: Sequence[Target], nominal: FloatArray, reasons: list[str]
    ) -> tuple[FloatArray, FloatArray]:
        """Corrected joints (n, 6), and how far the tip moves (n,) [mm]; writes the reasons of what is refused."""
        corrected, shifts = np.full_like(nominal, np.nan), np.zeros(len(nominal))
        for rows, equipped in self._by_tool(targets, reasons):
            found = correct_targets(
                equipped,
                self.targets_of(nominal[rows]),
                direction=self.direction,
                untrained=self.untrained,
                uncertainty=False,
                locked=self.machine.locked,
            )
            corrected[rows], shifts[rows] = found.joints, found.shift_mm
            for row, reason in zip(rows, found.reasons, strict=True):
                reasons[row] = reason
        return corrected, shifts

    def targets_of(self, joints: FloatArray) -> Targets:
        """Joint targets (n, n_joints) with the inputs of the model that are stated."""
        inputs = {"payload_kg": self.stated.payload_kg, "temperature_degC": self.stated.temperature_degC}
        columns = {name: np.full(len(joints), value) for name, value in inputs.items() if value is not None}
        return replace(Targets.of_joints(joints), temperature_degC=columns.pop("temperature_degC", None), loads=columns)

    def flange(self, joints: FloatArray) -> FloatArray:
        """(n, 4, 4) flange in the base of the arm."""
        return motion(*self.chain.pose(joints))

    def poses(self, targets: Sequence[Target], joints: FloatArray) -> list[FloatArray | None]:
        """The tool in the work frame at joints of every target; None where the target does not state both frames."""
        frames = [(one.T_base_work, one.T_flange_tool) for one in targets]
        return [
            None if work is None or tool is None else inverse(work) @ flange @ tool
            for (work, tool), flange in zip(frames, self.flange(joints), strict=True)
        ]

    def _by_tool(self, targets: Sequence[Target], reasons: Sequence[str]) -> Iterator[tuple[list[int], Compensator]]:
        """Targets by their tools, each with the model that has it; without any, with the tip of the readings.

        Joints without a tool of their own, or with several, have one of the program: their correction is that of all.
        """
        tools = [target.T_flange_tool for target in targets]
        some = next((tool for tool in tools if tool is not None), None)
        groups: defaultdict[bytes, list[int]] = defaultdict(list)
        for row, tool in enumerate(tools):
            if not reasons[row]:
                groups[b"" if tool is None else tool.tobytes()].append(row)
        for rows in groups.values():
            tool = some if tools[rows[0]] is None else tools[rows[0]]
            if tool is None:
                yield rows, self.model
            else:
                rpy = np.radians(angles_of(tool[:3, :3], (0.0, 0.0, 0.0)))
                yield rows, with_tool(self.model, np.concatenate([tool[:3, 3], rpy]))

    def bend(
        self, targets: Sequence[Target], ends: Sequence[PathEnds], nominal: FloatArray, corrected: FloatArray
    ) -> tuple[float, int] | None:
        """How far the tip leaves the straight line between two corrected ends.

        Parameters
        ----------
        targets : sequence of Target
        ends : sequence of PathEnds
        nominal, corrected : (n, 6) array
            Of the targets; NaN where they are not corrected.

        Returns
        -------
        (float, int) or None
            The largest distance [mm], and the line of its move; None where no such move is between corrected targets.
        """
        before, after = (self.tools(targets, joints) for joints in (nominal, corrected))
        lengths = [np.linalg.norm(before[a, :3, 3] - before[b, :3, 3]) for a, b, _ in ends]
        longest = [ends[i] for i in np.argsort(lengths)[::-1] if np.isfinite(lengths[i]) and lengths[i] > 0]
        between, places, lines = [], [], []
        for a, b, line in longest[:N_MOVES]:
            if targets[b].T_flange_tool is None or targets[a].T_flange_tool is not targets[b].T_flange_tool:
                continue
            for share in _SHARES:
                between.append(self.between(targets[b], nominal[[a, b]], before[[a, b]], share))
                places.append(after[a, :3, 3] + share * (after[b, :3, 3] - after[a, :3, 3]))
                lines.append(line)
        if not between:
            return None
        joints, reasons = self.nominal(between, None)
        bent, _ = self.corrected(between, joints, reasons)
        away = np.linalg.norm(self.tools(between, bent)[:, :3, 3] - np.array(places), axis=1)
        if not np.isfinite(away).any():
            return None
        row = int(np.nanargmax(away))
        return float(away[row]), lines[row]

    def between(self, end: Target, joints: FloatArray, tools: FloatArray, share: float) -> Target:
        """A target on the straight line to another one, in the base of the arm; `tools` (2, 4, 4) are its ends."""
        near = joints[0] + share * (joints[1] - joints[0])
        counted = self.machine.axes(near)
        pose = _between(tools[0], tools[1], share)
        return replace(end, joints=None, pose=pose, T_base_work=np.eye(4), near=counted, conditions=())

    def tools(self, targets: Sequence[Target], joints: FloatArray) -> FloatArray:
        """(n, 4, 4) tools of the controller's arm in its base."""
        tools = [np.eye(4) if target.T_flange_tool is None else target.T_flange_tool for target in targets]
        return self.flange(joints) @ np.array(tools).reshape(-1, 4, 4)


def ends_of(moves: Sequence[Move]) -> list[PathEnds]:
    """The ends of all straight and circular moves between two targets of the program."""
    return [ends for ends, _ in straight_moves(moves, ("linear", "circular"))]


def straight_moves(moves: Sequence[Move], kinds: Sequence[MoveKind] = ("linear",)) -> Iterator[tuple[PathEnds, Move]]:
    """Moves between two targets of the program, with their ends."""
    for last, move in pairwise(moves):
        if move.kind in kinds and last.target is not None and move.target is not None:
            yield PathEnds(last.target, move.target, move.line), move


def _is_open(target: Target) -> bool:
    """Whether nothing states the configuration of a pose."""
    return target.joints is None and not target.conditions and target.near is None


def _predecessors(targets: Sequence[Target], moves: Sequence[Move]) -> dict[int, int]:
    """Targets that state no configuration, and the one target from which straight moves lead to each."""
    found: defaultdict[int, set[int | None]] = defaultdict(set)
    for last, move in pairwise([Move(0, "joint", None), *moves]):
        if move.target is not None and _is_open(targets[move.target]) and last.target != move.target:
            found[move.target].add(last.target if move.follows and move.kind != "joint" else None)
    return {row: one for row, (one, *more) in found.items() if one is not None and not more}


def _roots(before: Mapping[int, int]) -> dict[int, int]:
    """The first target of the path to every target, those nearer to it first; of a circle one of its own."""
    found: dict[int, int] = {}
    for row in before:
        path: dict[int, None] = {}
        at = row
        while at in before and at not in found and at not in path:
            path[at] = None
            at = before[at]
        found |= dict.fromkeys(reversed(path), found.get(at, at))
    return found


def _between(T: FloatArray, T_end: FloatArray, share: float) -> FloatArray:
    """A pose between two on a straight move."""
    turn = Rotation.from_matrix(T_end[:3, :3] @ T[:3, :3].T).as_rotvec()
    R = Rotation.from_rotvec(share * turn).as_matrix() @ T[:3, :3]
    return motion(R, T[:3, 3] + share * (T_end[:3, 3] - T[:3, 3]))
