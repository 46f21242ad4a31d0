"""The kinematics that a controller computes with, where they are not the drawing's: a robot's factory calibration."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Chain, read_ur_kinematics
from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.programs.program import Surroundings, inverse
from truearm.wings.exports.targets.pose_models import reference_from_base

# Joints and pose of a point have twelve decimals; another tool or other kinematics are some tenths of a millimetre off.
AGREE_MM, AGREE_DEG = 0.01, 0.005
# A factory calibration moves the flange by some millimetres; another type of robot is some centimetres off.
MOST_MM = 30.0
NOMINAL = "nominal"
NOT_STATED = (
    "the program does not have the kinematics of its controller: state in --frames controller = "
    '"my_robot_calibration.yaml", or "nominal" for a robot without a factory calibration'
)


class StatedKinematics(NamedTuple):
    """The kinematics of a UR's controller as a person states them; the chain None is that of the drawing."""

    is_stated: bool
    chain: Chain | None

    @classmethod
    def of(cls, beside: Surroundings) -> StatedKinematics:
        """What the file of ``--frames`` states."""
        stated = beside.frames.controller
        if stated is None or stated == NOMINAL:
            return cls(stated is not None, None)
        folder = Path() if beside.file is None else beside.file.parent
        return cls(True, read_ur_kinematics(folder / stated, angles="controller").chain)


def disagreement(controller: Chain | None, joints: FloatArray, flange: FloatArray) -> str | None:
    """How far the joints of a point are from its pose, if that is more than rounding; None if not, or not known."""
    if controller is None:
        return None
    pose = controller.pose(joints[None])
    away = float(np.linalg.norm(pose.tip_in_base[0] - flange[:3, 3]))
    turn = float(np.degrees(Rotation.from_matrix(pose.R_base_tip[0].T @ flange[:3, :3]).magnitude()))
    if away < AGREE_MM and turn < AGREE_DEG:
        return None
    return f"its joints and its pose disagree by {away:.3g} mm and {turn:.2g} deg: another tool, or other kinematics"


def with_controller(model: Compensator, controller: Chain) -> Compensator:
    """A fitted model whose nominal arm is the controller's; base and tip are those identified with the drawing.

    Raises
    ------
    InputError
        If the controller's arm is not that of the model.
    """
    drawn, nominal = model.arm_.chain, model.nominal_.chain
    poses = np.outer([0.0, 0.5, -1.0], np.ones(drawn.n_joints))
    plain = Chain(drawn.fixed, np.zeros(3), coupling=drawn.coupling)
    away = np.linalg.norm(plain.pose(poses).tip_in_base - controller.pose(poses).tip_in_base, axis=1).max()
    if away > MOST_MM:
        raise InputError(
            f"the kinematics of the controller are {away:.0f} mm from those of {model.arm_.name!r}",
            hint="give the model of the robot of this program, with its arm in the controller's base frame",
        )
    fixed = controller.fixed.copy()
    fixed[0] = reference_from_base(model) @ fixed[0]
    fixed[-1] = fixed[-1] @ inverse(drawn.fixed[-1]) @ nominal.fixed[-1]
    chain = Chain(fixed, nominal.tip_in_flange, coupling=drawn.coupling)
    equipped = copy.copy(model)
    equipped.nominal_ = replace(model.nominal_.select(lambda _: False), perturbed_chain=PerturbedChain(chain, ()))
    return equipped
