"""What poses beside the joints that lead to them show: another order, convention or unit of numbers, another tool."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Pose
from truearm.arm.rigid_motions import inverse
from truearm.errors import InputError
from truearm.findings import format_mm
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.targets.inverse import turn_between
from truearm.wings.exports.targets.manifest import Frame
from truearm.wings.exports.targets.pose_models import nominal_poses, reference_from_base
from truearm.wings.exports.targets.targets import Targets

# By how much positions in m, cm, inches or um would have to be multiplied, and those in mm that are said to be in m.
OTHER_UNITS = (1000.0, 10.0, 25.4, 0.001)
# Numbers mean another thing if with it they are so much nearer to where their start joints are.
FAR_NEARER = 5.0
# So far from the start joints, orientations are none that the joints lead to; so near they are [rad].
_ANOTHER_TURN, _THE_TURN = np.radians(5.0), np.radians(1.0)
# Another tool shifts all targets alike along the axes of the tip: by so much at least, the same within so much [mm].
_ANOTHER_TOOL_MM, _SAME_MM = 5.0, 1.0
# Start joints that only choose the configuration are so far from their targets: share of the reach, and turn [rad].
_ROUGH_SHARE, _ROUGH_TURN = 0.05, np.radians(10.0)


def poses_at_start(model: Compensator, targets: Targets, frame: Frame) -> Pose:
    """Poses of the nominal arm at the start joints, in the frame of the targets."""
    R, tips = nominal_poses(model).pose(targets.joints, np.arange(len(targets)))
    T = inverse(reference_from_base(model)) if frame == "base" else np.eye(4)
    return Pose(T[:3, :3] @ R, tips @ T[:3, :3].T + T[:3, 3])


def check_orientations(model: Compensator, targets: Targets, frame: Frame) -> None:
    """Refuse orientations that are those at their start joints if their numbers mean another thing than stated.

    Raises
    ------
    InputError
    """
    if targets.rotations is None or targets.orientations is None or not targets.joint_columns:
        return
    R = poses_at_start(model, targets, frame).R_base_tip
    away = _median_turn(R, targets.rotations)
    if away < _ANOTHER_TURN:
        return
    found = {said: _median_turn(R, other) for said, other in _other_meanings(*targets.orientations)}
    said = min(found, key=found.__getitem__)
    if found[said] < min(_THE_TURN, away / FAR_NEARER):
        raise InputError(
            f"the orientations are {np.degrees(away):.3g} deg from those at their start joints, and only "
            f"{np.degrees(found[said]):.2g} deg if {said}",
            file=targets.file,
            hint="write them as the names of the columns say (docs/correct.md), or omit the columns of joints: --start",
        )


def _other_meanings(what: str, numbers: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """What else the numbers of orientations (n, k), angles in rad, may be."""
    if what == "a quaternion":
        yield "the columns are qx, qy, qz, qw in this order", Rotation.from_quat(numbers).as_matrix()
    elif what == "a rotation matrix":
        yield "the matrices are transposed", numbers.reshape(-1, 3, 3).swapaxes(1, 2)
    else:
        is_vector = what == "a rotation vector"
        for unit, factor in (("rad", np.degrees(1.0)), ("deg", np.radians(1.0))):
            scaled = factor * numbers
            as_stated = Rotation.from_rotvec(scaled) if is_vector else Rotation.from_euler("xyz", scaled)
            yield f"they are in {unit}", as_stated.as_matrix()
        if is_vector:
            yield "they are roll, pitch, yaw", Rotation.from_euler("xyz", numbers).as_matrix()
        else:
            yield "they are a rotation vector", Rotation.from_rotvec(numbers).as_matrix()
        yield "they turn about z, the new y and the new x (A, B, C)", Rotation.from_euler("ZYX", numbers).as_matrix()
        yield "they turn about x, the new y and the new z", Rotation.from_euler("XYZ", numbers).as_matrix()


def _median_turn(R: FloatArray, R_target: FloatArray) -> float:
    return float(np.median(np.linalg.norm(turn_between(R, R_target), axis=1)))


def doubts_about_poses(model: Compensator, targets: Targets, frame: Frame, *, all_refused: bool) -> Iterator[str]:
    """That targets are far from where their own start joints are, and what explains it: another unit, another tool."""
    assert targets.tips is not None  # only of poses
    at_start, tips = poses_at_start(model, targets, frame), targets.tips
    away = {f: float(np.median(np.linalg.norm(f * tips - at_start.tip_in_base, axis=1))) for f in (1.0, *OTHER_UNITS)}
    factor, mm = min(away, key=away.__getitem__), away[1.0]
    said = f"The targets are {format_mm(mm)} from the tips at their start joints"
    if (all_refused or targets.joint_columns) and FAR_NEARER * away[factor] < mm:
        yield (
            f"{said}, and times {factor:g} only {format_mm(away[factor])}: check the unit in the names of the columns."
        )
        return
    other: Frame = "reference" if frame == "base" else "base"
    there = poses_at_start(model, targets, other).tip_in_base
    mm_there = float(np.median(np.linalg.norm(tips - there, axis=1)))
    if (all_refused or targets.joint_columns) and FAR_NEARER * mm_there < mm and mm > _SAME_MM:
        name = "the arm's base" if other == "base" else "the reference"
        yield f"{said}, and as poses in the frame of {name} only {format_mm(mm_there)}: check --frame {other}."
        return
    if not targets.joint_columns:  # one start for all
        return
    shift = np.einsum("nij,ni->nj", at_start.R_base_tip, tips - at_start.tip_in_base)
    usual = np.median(shift, axis=0)
    turn = 0.0 if targets.rotations is None else _median_turn(at_start.R_base_tip, targets.rotations)
    if len(tips) > 2 and mm > _ANOTHER_TOOL_MM and np.abs(shift - usual).max() < _SAME_MM:
        x, y, z = (usual.round(1) + 0.0).tolist()
        yield f"{said}, at each by {x}, {y}, {z} mm along the axes of the tip: check the tool (--tool)."
    elif mm > _ROUGH_SHARE * model.arm_.chain.reach or turn > _ROUGH_TURN:
        both = said if targets.rotations is None else f"{said} and turned by {np.degrees(turn):.3g} deg"
        yield (
            f"{both} (median): right if those only choose the configuration; otherwise check the tool, the frame and "
            "the arm."
        )
