"""Corrected joint targets: inverse compensation in both directions, target by target, with a reason for every refusal.

``command``: what to send so that the arm goes where the nominal arm would go, or to a pose: solve
``model(q_command) = nominal(q)``. ``feedback``: what the encoders mean: solve
``nominal(q_nominal) = model(q_encoder)``. Each is the inverse of the other. The nominal arm is the one whose base and
tip were identified from the same readings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from truearm.arm import InverseKinematicsResult, Pose
from truearm.errors import InputError
from truearm.findings import format_mm
from truearm.models import Compensator
from truearm.models.training_conditions import TOGETHER
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.verbs.inputs import payload_findings
from truearm.wings.exports.targets import TargetDirection, Untrained
from truearm.wings.exports.targets.inverse import (
    MAX_CONDITION,
    MAX_STEPS,
    PoseTask,
    follow,
    freedom,
    keeps_configuration,
    scaled_jacobian,
    solve_poses,
    turn_between,
)
from truearm.wings.exports.targets.manifest import Frame, check_joints
from truearm.wings.exports.targets.pose_models import (
    JOINTS_OF_A_POSE,
    PoseModel,
    nominal_poses,
    poses_of,
    reference_from_base,
    turns_of,
)
from truearm.wings.exports.targets.targets import Targets

# A correction, apart from joint offsets, is some mrad; more [rad] is a pose near a singular one, or a mistake.
MAX_CORRECTION = 0.1
# Arms of fewer than six joints keep a few mrad of their own errors in the orientation; more [rad] they cannot reach.
MAX_TURN_OFF = np.radians(0.5)
# Training poses that show the usual change.
_USUAL_POSES = 100
# What an input that is not stated adds to the uncertainty of a coordinate counts from here on: a robot repeats to that.
_COUNTS_MM = 0.02
# Steps of a correction: three are usual; targets that need more are beyond the reach.
CORRECTION_STEPS = 10
# From this condition on a stretched arm and a singular wrist look alike: a step no longer tells what is missing.
NEAR_SINGULAR = 100.0


@dataclass(frozen=True, eq=False)
class Correction:
    """Corrected joints of targets, row by row.

    Attributes
    ----------
    joints : (n, n_joints) array
        [rad, or mm]; NaN for refused targets.
    reasons : tuple of str
        Why a target was refused; empty for corrected ones.
    distance_mm, angle_rad : (n,) array
        Distance of the tip, and rotation of the flange, from the target after correction. On arms of fewer than six
        joints the rotation cannot be corrected.
    steps : (n,) int array
        Newton steps of the correction.
    margins : (n, n_joints) array
        Distance of each joint of the machine (sent, or read) from its nearer limit [rad, or mm]; infinite without
        limits, negative beyond them.
    condition : (n,) array
        Condition of the Jacobian, with a radian as long as a third of the reach.
    outside : (n,) bool array
        Whether the joints, the machine's and the nominal arm's, or another input are outside the trained range.
    change : (n, n_joints) array
        Corrected joints minus the nominal arm's joints for the same pose, or minus those read [rad, or mm].
    shift_mm : (n,) array
        Distance by which the correction moves the tip [mm].
    covariances : (n, 3, 3) array
        Of the tip [mm^2]; NaN for refused targets, or if not asked for.
    """

    joints: FloatArray
    reasons: tuple[str, ...]
    distance_mm: FloatArray
    angle_rad: FloatArray
    steps: IntArray
    margins: FloatArray
    condition: FloatArray
    outside: BoolArray
    change: FloatArray
    shift_mm: FloatArray
    covariances: FloatArray

    @property
    def refused(self) -> BoolArray:
        """(n,) whether a target was refused."""
        return np.array([bool(reason) for reason in self.reasons])


class _Solved(NamedTuple):
    """Solutions with what they are compared with: joints of the machine, and joints before the correction."""

    solution: InverseKinematicsResult
    target: Pose
    machine_joints: FloatArray
    before: FloatArray
    another_configuration: BoolArray


def correct_targets(
    model: Compensator,
    targets: Targets,
    *,
    direction: TargetDirection = "command",
    frame: Frame = "reference",
    untrained: Untrained = "refuse",
    uncertainty: bool = True,
    locked: BoolArray | None = None,
) -> Correction:
    """Correct targets by a fitted model.

    Parameters
    ----------
    model : Compensator
        Fitted; with another tool, see `truearm.wings.exports.targets.pose_models.with_tool`.
    targets : Targets
    direction : {"command", "feedback"}
        What to send, or what the encoders mean.
    frame : {"reference", "base"}
        Of poses: that of the model's points, or the arm's own base frame.
    untrained : {"refuse", "accept"}
        What to do with targets outside the trained range.
    uncertainty : bool
        Whether to compute covariances of the tip, which takes most of the time.
    locked : (n_joints,) bool array, optional
        Joints that stay where they are, as a rail that the program moves.

    Raises
    ------
    InputError
        If the targets are not those of the arm, poses are given as feedback, or an option is unknown.
    """
    _check_option("direction", direction, ("command", "feedback"))
    _check_option("frame", frame, ("reference", "base"))
    _check_option("untrained", untrained, ("refuse", "accept"))
    targets.check(model.arm_)
    if direction == "feedback" and targets.kind != "joints":
        raise InputError(
            f"the direction feedback turns encoder angles into nominal joints, and these targets are {targets.kind}",
            file=targets.file,
            hint="give the angles that the encoders read, or use the direction command",
        )
    locked = locked if locked is not None and locked.any() else None
    if direction == "feedback":
        solved = _feedback(model, targets, locked=locked)
    else:
        solved = _command(model, targets, frame=frame, locked=locked)
    return _judged(model, targets, solved, direction=direction, untrained=untrained, uncertainty=uncertainty)


def input_remarks(model: Compensator, readings: Session, how: str) -> Iterator[str]:
    """What is assumed of inputs of the model that targets do not state, if it counts, and `how` they are stated."""
    yield from map(str, payload_findings(model.training_, readings))
    some = readings.rows(np.arange(len(readings))[:: -(-len(readings) // _USUAL_POSES)])
    sizes = {
        name: float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / 3))
        for name, covariance in model.unstated_input_covariances(some).items()
        if name == "temperature" or name in model.training_.columns
    }
    names = {"temperature": "temperature_degC"}
    large = [f"{names.get(one, one)} ({format_mm(mm)} of uncertainty)" for one, mm in sizes.items() if mm > _COUNTS_MM]
    if large:
        yield f"Taken at the training mean, as the targets do not state it: {', '.join(large)}. State it {how}."


def task_of(model: Compensator, poses: PoseModel, target: Pose) -> PoseTask:
    """The task to reach poses with a model, or its nominal arm."""
    chain = model.arm_.chain
    reach = max(chain.reach, model.nominal_.chain.reach, 3.0)
    return PoseTask(poses, target, chain.is_prismatic, reach / 3, turns_of(model.nominal_.chain))


def _command(model: Compensator, targets: Targets, *, frame: Frame, locked: BoolArray | None = None) -> _Solved:
    nominal, every = nominal_poses(model), np.arange(len(targets))
    target, before = nominal.pose(targets.joints, every), targets.joints
    another = np.zeros(len(targets), dtype=bool)
    if targets.tips is not None:
        at_start, target = target, _in_reference(model, targets, target, frame)
        task = task_of(model, nominal, target)
        if targets.rotations is not None:  # with fewer than six joints the nearest in the sense of least squares
            task = replace(task, turns=np.eye(3))
        before, another = _nominal_joints(task, targets.joints, at_start)
    poses = poses_of(model, targets.session(before))
    task = _holding(task_of(model, poses, target), before, locked)
    found = solve_poses(task, before, max_steps=CORRECTION_STEPS)
    if task.hold is not None and locked is None:
        found = _within_limits(model, task, found)
    return _Solved(found, target, found.angles, before, another)


def _nominal_joints(task: PoseTask, start: FloatArray, at_start: Pose) -> tuple[FloatArray, BoolArray]:
    """Joints of the nominal arm in the configuration and turns of the start; whether only another one was found."""
    found = solve_poses(task, start, max_steps=MAX_STEPS)
    joints = _turns_kept(task, start, found.angles)
    another = found.reached & ~keeps_configuration(task, start, joints)
    rows = np.flatnonzero(another)
    if len(rows):
        again, kept = follow(task.rows(rows), start[rows], Pose(*(part[rows] for part in at_start)))
        good = rows[kept]
        joints[good] = _turns_kept(task, start[good], again.angles[kept])
        another[good] = False
    return joints, another


def _turns_kept(task: PoseTask, start: FloatArray, joints: FloatArray) -> FloatArray:
    """The same joints in the turns nearest to the start: whole turns are no motion."""
    turns = np.round((joints - start) / (2 * np.pi)) * (2 * np.pi)
    return joints - np.where(task.prismatic, 0.0, turns)


def _feedback(model: Compensator, targets: Targets, *, locked: BoolArray | None = None) -> _Solved:
    encoder, every = targets.joints, np.arange(len(targets))
    poses = poses_of(model, targets.session(encoder))
    target = poses.pose(encoder, every)
    task = _holding(task_of(model, nominal_poses(model), target), encoder, locked)
    if task.hold is not None:
        task = replace(task, free=freedom(scaled_jacobian(replace(task, model=poses), encoder)))
    found = solve_poses(task, encoder, max_steps=CORRECTION_STEPS)
    return _Solved(found, target, encoder, encoder, np.zeros(len(targets), dtype=bool))


def _within_limits(model: Compensator, task: PoseTask, found: InverseKinematicsResult) -> InverseKinematicsResult:
    """Solve targets of a redundant arm beyond a limit again, with those joints at their limits, where that is possible.

    A rail at its end stays there; the other joints take over its share.
    """
    lower, upper = model.arm_.limits.T
    beyond = (found.angles < lower - Session.limit_tolerance) | (found.angles > upper + Session.limit_tolerance)
    rows = np.flatnonzero(beyond.any(axis=1) & found.reached)
    if not len(rows):
        return found
    part = task.rows(rows)
    assert part.hold is not None  # the task of a redundant arm
    at_limits = np.clip(found.angles[rows], lower, upper)
    part = replace(part, hold=np.where(beyond[rows], at_limits, part.hold), locked=beyond[rows])
    again = solve_poses(part, at_limits, max_steps=CORRECTION_STEPS)
    inside = (again.angles >= lower - Session.limit_tolerance) & (again.angles <= upper + Session.limit_tolerance)
    good = again.reached & inside.all(axis=1)
    return found.replaced(rows[good], again.rows(good))


def _holding(task: PoseTask, joints: FloatArray, locked: BoolArray | None) -> PoseTask:
    """The task, holding joints if the poses leave them freedom, and those that must not move."""
    held = replace(task, hold=joints) if joints.shape[1] > task.width else task
    return held if locked is None else replace(held, locked=np.broadcast_to(locked, joints.shape))


def _in_reference(model: Compensator, targets: Targets, at_start: Pose, frame: Frame) -> Pose:
    """Poses of the targets in the frame of the reference; positions have the nominal arm's orientation at the start."""
    assert targets.tips is not None  # only of poses
    T = reference_from_base(model) if frame == "base" else np.eye(4)
    tips = targets.tips @ T[:3, :3].T + T[:3, 3]
    rotations = at_start.R_base_tip if targets.rotations is None else T[:3, :3] @ targets.rotations
    return Pose(rotations, tips)


def _judged(
    model: Compensator,
    targets: Targets,
    solved: _Solved,
    *,
    direction: TargetDirection,
    untrained: Untrained,
    uncertainty: bool,
) -> Correction:
    """Every target with its figures, and the reasons of those that are refused."""
    found, machine, arm = solved.solution, solved.machine_joints, model.arm_
    lower, upper = arm.limits.T
    margins = np.minimum(machine - lower, upper - machine)
    change, condition = found.angles - solved.before, found.condition
    readings = targets.session(machine)
    planned = targets.session(solved.before if direction == "command" else found.angles)
    inputs = _inputs_outside(model, readings, planned)
    outside = np.logical_or.reduce([np.zeros(len(targets), dtype=bool), *inputs.values()])
    reasons = np.full(len(targets), "", dtype=object)

    def refuse(rows: BoolArray, reason: list[str]) -> None:
        open_rows = rows & (reasons == "")
        reasons[open_rows] = np.array(reason, dtype=object)[open_rows[rows]]

    bad = ~found.reached
    refuse(bad, _unreached(found, bad))
    angle = _angle(model, readings, solved, direction=direction)
    if targets.kind == "poses":
        bad = (angle > MAX_TURN_OFF) & (arm.n_joints < JOINTS_OF_A_POSE)
        refuse(bad, [f"orientation out of reach: {np.degrees(turn):.2g} deg remain" for turn in angle[bad]])
    bad = solved.another_configuration
    refuse(bad, ["another configuration than the start joints"] * int(bad.sum()))
    bad = condition > MAX_CONDITION
    refuse(bad, [f"singular: condition {number:.2g}" for number in condition[bad]])
    excess = _excess(model, change, direction=direction)
    bad = excess.max(axis=1) > MAX_CORRECTION
    refuse(bad, _too_large(change[bad], excess[bad], condition[bad]))
    if direction == "command":
        bad = (margins < -Session.limit_tolerance).any(axis=1)
        refuse(bad, _beyond(model, machine[bad], margins[bad]))
    if untrained == "refuse":
        refuse(outside, _untrained(inputs, outside))
    good = reasons == ""
    covariances = np.full((len(targets), 3, 3), np.nan)
    if uncertainty and good.any():
        covariances[good] = model.predict_readings(model.at(readings.rows(good)), return_cov=True)[1]
    nominal, every = nominal_poses(model), np.arange(len(targets))
    there = nominal.pose(found.angles, every)
    return Correction(
        joints=np.where(good[:, None], found.angles, np.nan),
        reasons=tuple(reasons.tolist()),
        distance_mm=found.distance_mm,
        angle_rad=angle,
        steps=found.steps,
        margins=margins,
        condition=condition,
        outside=outside,
        change=change,
        shift_mm=np.linalg.norm(there.tip_in_base - nominal.pose(solved.before, every).tip_in_base, axis=1),
        covariances=covariances,
    )


def _inputs_outside(model: Compensator, readings: Session, planned: Session) -> dict[str, BoolArray]:
    """Inputs outside the trained range of targets, corrected (`readings`) and as they were `planned`.

    A correction of some mrad does not lead out of the training: joints at the edge of the range are inside. Programs go
    to places between the training poses: there the stated uncertainty says what is known.
    """
    slides = model.arm_.chain.is_prismatic
    before = model.training_.outside(planned, slides)
    return {
        name: rows & before[name]
        for name, rows in model.training_.outside(readings, slides).items()
        if name in before and name != TOGETHER
    }


def _angle(model: Compensator, readings: Session, solved: _Solved, *, direction: TargetDirection) -> FloatArray:
    """(n,) rotation of the flange from the target [rad]; on arms of fewer than six joints it was not solved for."""
    found = solved.solution
    if model.arm_.n_joints >= JOINTS_OF_A_POSE:
        return found.angle_rad
    poses = nominal_poses(model) if direction == "feedback" else poses_of(model, readings)
    there = poses.pose(found.angles, np.arange(len(found.angles)))
    return np.asarray(np.linalg.norm(turn_between(there.R_base_tip, solved.target.R_base_tip), axis=1))


def _excess(model: Compensator, change: FloatArray, *, direction: TargetDirection) -> FloatArray:
    """(n, n_joints) size of the change of turning joints, beyond what is usual where it is large [rad].

    Usual is the middle 90 % at training poses: an arm with a large joint offset is corrected by as much everywhere.
    """
    turning = ~model.arm_.chain.is_prismatic
    size = np.abs(change) * turning
    if not (size > MAX_CORRECTION).any():
        return size
    low, high = usual_change(model, direction=direction)
    return np.asarray(np.minimum(size, np.maximum(low - change, change - high) * turning))


def usual_change(model: Compensator, *, direction: TargetDirection) -> FloatArray:
    """(2, n_joints) ends of the middle 90 % of the changes of joints at training poses [rad, or mm]; zeros without."""
    sample = model.training_.angle_sample
    trained = check_joints(model) if sample is None else sample
    some = Targets.of_joints(trained[:: -(-len(trained) // _USUAL_POSES)])
    there = _feedback(model, some) if direction == "feedback" else _command(model, some, frame="reference")
    reached = there.solution.reached
    if not reached.any():
        return np.zeros((2, model.arm_.n_joints))
    return np.asarray(np.quantile((there.solution.angles - there.before)[reached], (0.05, 0.95), axis=0))


def _unreached(found: InverseKinematicsResult, bad: BoolArray) -> list[str]:
    return [
        f"out of reach{f' or singular (condition {condition:.2g})' if condition > NEAR_SINGULAR else ''}: "
        f"{distance:.3g} mm and {np.degrees(angle):.2g} deg remain"
        for distance, angle, condition in zip(
            found.distance_mm[bad], found.angle_rad[bad], found.condition[bad], strict=True
        )
    ]


def _too_large(change: FloatArray, excess: FloatArray, condition: FloatArray) -> list[str]:
    found = []
    for row, over, number in zip(change, excess, condition, strict=True):
        joint = int(over.argmax())
        found.append(
            f"correction of J{joint + 1} by {np.degrees(row[joint]):.3g} deg exceeds the usual by more than "
            f"{np.degrees(MAX_CORRECTION):.1f} deg: wrong zero, sign or arm, or near-singular (condition {number:.2g})"
        )
    return found


def _beyond(model: Compensator, joints: FloatArray, margins: FloatArray) -> list[str]:
    limits, slides = model.arm_.limits, model.arm_.chain.is_prismatic
    found = []
    for q, margin in zip(joints, margins, strict=True):
        i = int(margin.argmin())
        unit, factor = ("mm", 1.0) if slides[i] else ("deg", 180 / np.pi)
        limit = limits[i, 0] if q[i] < limits[i, 0] else limits[i, 1]
        found.append(
            f"at a limit: J{i + 1} would be at {factor * q[i]:.6g} {unit}, {-factor * margin[i]:.3g} {unit} beyond its "
            f"limit {factor * limit:.6g} {unit}"
        )
    return found


def _untrained(inputs: dict[str, BoolArray], outside: BoolArray) -> list[str]:
    return [
        f"outside the trained range ({', '.join(name for name, rows in inputs.items() if rows[row])})"
        for row in np.flatnonzero(outside)
    ]


def _check_option(name: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise InputError(f"expected {name} {' or '.join(known)}, got {value!r}")
