"""Tip poses of a fitted model and of its nominal arm, and their derivatives by the joints; tools in place of the tip.

The orientation is that of the flange's axes with all small motions, or of the tool's axes. A network knows no
orientation: it has that of the nominal arm, and the nominal arm's derivatives.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Chain, Pose
from truearm.arm.rigid_motions import motion
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import ArmState, Term
from truearm.models import Compensator
from truearm.models.identified_model import require_identified, to_identified
from truearm.readings import Session
from truearm.typing import FloatArray, IntArray

# Joints of fewer are too few for a position and an orientation.
JOINTS_OF_A_POSE = 6
_SCARA = 4  # joints, one of which slides
_PARALLEL = 1e-3  # axes of an identified arm, too [rad]


class PoseModel(Protocol):
    """Tip poses of an arm at targets: joints may change, whatever else a target states (temperature) remains."""

    def pose(self, joints: FloatArray, rows: IntArray, /) -> Pose:
        """Tip poses at joints (n, n_joints) of the targets `rows` (n,)."""
        ...

    def linearise(self, joints: FloatArray, rows: IntArray, /) -> tuple[Pose, FloatArray]:
        """Tip poses and their derivatives by the joints (n, 6, n_joints): translation [mm], then rotation [rad]."""
        ...


@dataclass(frozen=True, eq=False)
class ChainPoses:
    """Poses of a chain without small motions that depend on the arm's state: the nominal arm."""

    chain: Chain

    def pose(self, joints: FloatArray, rows: IntArray) -> Pose:
        """See `PoseModel`."""
        del rows
        return self.chain.pose(joints)

    def linearise(self, joints: FloatArray, rows: IntArray) -> tuple[Pose, FloatArray]:
        """See `PoseModel`."""
        del rows
        return self.chain.pose_jacobians(joints)


@dataclass(frozen=True, eq=False)
class IdentifiedPoses:
    """Poses of an identified chain with all its terms; `state` states their inputs at every target."""

    fit: IdentificationResult
    state: ArmState

    def pose(self, joints: FloatArray, rows: IntArray) -> Pose:
        """See `PoseModel`."""
        return self.fit.perturbed_chain.poses(replace(self.state.rows(rows), angles=joints), self.fit.coefficients)

    def linearise(self, joints: FloatArray, rows: IntArray) -> tuple[Pose, FloatArray]:
        """See `PoseModel`."""
        state = replace(self.state.rows(rows), angles=joints)
        return self.fit.perturbed_chain.pose_jacobians(state, self.fit.coefficients)


@dataclass(frozen=True, eq=False)
class PredictedPoses:
    """Tips of any model, with orientations and derivatives of its nominal arm."""

    model: Compensator
    nominal: ChainPoses

    def pose(self, joints: FloatArray, rows: IntArray) -> Pose:
        """See `PoseModel`."""
        return Pose(self.nominal.pose(joints, rows).R_base_tip, self._tips(joints))

    def linearise(self, joints: FloatArray, rows: IntArray) -> tuple[Pose, FloatArray]:
        """See `PoseModel`."""
        nominal, jacobian = self.nominal.linearise(joints, rows)
        return Pose(nominal.R_base_tip, self._tips(joints)), jacobian

    def _tips(self, joints: FloatArray) -> FloatArray:
        # The checks of `predict` judge readings by their majority; steps of a search are none.
        readings = Session(joints)
        return self.model._tips(self.model.state(readings))


def nominal_poses(model: Compensator) -> ChainPoses:
    """Poses of the nominal arm of a fitted model, base and tip identified from the same readings."""
    return ChainPoses(model.nominal_.chain)


def poses_of(model: Compensator, targets: Session) -> PoseModel:
    """Poses of a fitted model at targets; inputs that they do not state have their mean in training.

    Parameters
    ----------
    model : Compensator
    targets : Session
        Joints, and temperature, loads and directions of movement if stated.
    """
    if (identified := to_identified(model)) is not None:
        return IdentifiedPoses(identified.fit_, model.state(replace(targets, session=None)))
    return PredictedPoses(model, nominal_poses(model))


def reference_from_base(model: Compensator) -> FloatArray:
    """(4, 4) frame of the arm's own base in the frame of the reference, as the nominal arm has it; lengths in mm."""
    in_base = model.arm_.chain.fixed[0]
    return np.asarray(model.nominal_.chain.fixed[0] @ np.linalg.inv(in_base))


def turns_of(chain: Chain) -> FloatArray:
    """(k, 3) directions in the base about which an arm turns its flange wherever it is.

    All of an arm of six joints or more; of one of fewer the common direction of its axes (a SCARA), or none.
    """
    if chain.n_joints >= JOINTS_OF_A_POSE:
        return np.eye(3)
    axes = np.array([T[:3, 2] for T in accumulate(chain.fixed[:-1], np.matmul)])
    are_parallel = np.linalg.norm(np.cross(axes[0], axes), axis=1).max() < _PARALLEL
    is_scara = are_parallel and chain.is_prismatic.sum() == 1 and chain.n_joints == _SCARA
    return axes[:1] if is_scara else axes[:0]


def with_tool(model: Compensator, tool: FloatArray) -> Compensator:
    """A fitted model with another tool in place of the tip that it was trained with.

    The identified constants of the tip are dropped, and with them those of the last joints that only move the tip, as
    the readings determine no more than their sum: the flange is then where the nominal arm has it on the last joint's
    place. The uncertainty of the tip is that of the other parameters; the tool counts as exact.

    Parameters
    ----------
    model : Compensator
        A nominal, kinematic or physical model.
    tool : (6,) array
        Position of the tip in the flange's frame [mm], then roll, pitch, yaw of the tool's axes there [rad], as URDF
        has them.

    Raises
    ------
    InputError
        If the model is a network, which knows no other point than its tip.
    """
    identified = require_identified(
        model,
        "a network, and that of a hybrid model, has learned the tip that it was trained with, and no other tool",
        hint="omit the tool, or fit a kinematic or physical model",
    )
    R_flange_tool = Rotation.from_euler("xyz", tool[3:])
    motions = np.zeros((model.arm_.chain.n_places, 6))
    motions[-1, :3] = R_flange_tool.as_rotvec()
    equipped = copy.copy(identified)
    equipped.fit_ = _without_tip(identified.fit_, tool[:3], motions)
    equipped.nominal_ = _without_tip(model.nominal_, tool[:3], motions)
    return equipped


def _without_tip(fit: IdentificationResult, tip_in_flange: FloatArray, motions: FloatArray) -> IdentificationResult:
    """An identified chain without the terms of its tip, and with a tool.

    Along the axes of a SCARA the readings determine the sum of the heights of base and tip: the base takes that of the
    tip over.
    """
    tip_place = fit.perturbed_chain.chain.n_places - 1

    def is_kept(term: Term) -> bool:
        return term.place != tip_place and term.group != "equivalent to a free tip"

    kept, drawn = fit.select(is_kept), fit.perturbed_chain.chain
    chain = drawn.with_tip(tip_in_flange).with_motions(motions)
    if len(axis := turns_of(drawn)) == 1:
        frames = [np.eye(4), *accumulate(drawn.fixed, np.matmul)]  # of the places but the base, after their joints
        dropped = fit.select(lambda term: not is_kept(term))
        terms = dropped.perturbed_chain.terms
        along = [axis[0] @ frames[term.place][:3, :3] @ term.direction[3:] for term in terms]
        shift = np.repeat(along, [term.n_coefficients for term in terms]) @ dropped.coefficients
        chain = chain.with_reference_frame(motion(np.eye(3), shift * axis[0]))
    return replace(kept, perturbed_chain=PerturbedChain(chain, kept.perturbed_chain.terms))
