"""The best rigid stand-in of a model: the arm whose constants alone come nearest to the model's points.

Harmonics and deflections have no place in a URDF or a table of constants, and the constants that were identified
beside them mean little alone. So constants of all places are identified again, from the model's own points over a
region. Their priors are around the nominal arm, and the evidence determines their scales: combinations that the region
does not determine stay nominal, whatever the prior's size was at the start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from truearm.acceptance import contradict
from truearm.arm import Arm, Chain
from truearm.errors import InputError
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.judgement.nominal_check import MAX_NOMINAL_ERROR
from truearm.identification.references.prepared_readings import MIN_ROWS
from truearm.identification.references.reading_references import roughly_aligned_chain
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, Term, constants
from truearm.models import Compensator
from truearm.models.compensator import FREE_PARTS
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.exports.targets.manifest import ExportLoss, stated_text

# More poses of a region change the constants by less than they are worth (UR10: 500 poses 0.38, 8000 poses 0.37 mm).
MAX_POSES = 5000
TRAINING_REGION = "training readings"
# The loss is that of poses held out: each of so many parts of a region in turn.
N_PARTS = 5
TermsOf = Callable[[Chain, tuple[str, ...]], list[Term]]
"""The constants of a chain that may differ, beside the parts that are free."""

# Rotations about the axis of joint 1 and translations along it are those of the base.
_ALONG_Z = {(0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class RigidArm:
    """An arm whose constants stand in for a model.

    Attributes
    ----------
    model : Compensator
    arm : Arm
        In its own base frame. Its flange is nominal, its tip the identified one. The motion before joint 1 is nominal
        too, if the model identified its base.
    nominal : Arm
        The nominal arm that its constants are nearest to.
    T_reference_base : (4, 4) array
        The arm's base frame in the frame of the model's points, translation in mm. The unit matrix if the model did not
        identify the base: then base frame and reference frame are one, and the arm's base contains what differs.
    fit : IdentificationResult
        Identification of the constants from the model's points; its covariance is that of the stand-in.
    poses : (n, n_joints) array
        Of the region [rad, or mm].
    region : str
        The poses in words.
    points : (n, 3) array
        Of the model at the poses [mm].
    start : Chain
        The nominal one with the model's base and tip.
    free : tuple of str
        The parts that the model identified.
    terms : list of Term
        The constants that were identified.
    """

    model: Compensator
    arm: Arm
    nominal: Arm
    T_reference_base: FloatArray
    fit: IdentificationResult
    poses: FloatArray
    region: str
    points: FloatArray
    start: Chain
    free: tuple[str, ...]
    terms: list[Term]

    @cached_property
    def loss(self) -> ExportLoss:
        """What is lost over the region, at poses held out."""
        _, covariances = self.model.predict(self.poses, return_cov=True)
        exported = _held_out_errors(self.fit, self.start, self.terms, self.poses, self.points)
        return ExportLoss(
            nominal_mm=float(np.linalg.norm(self.start.tip_in_base(self.poses) - self.points, axis=1).mean()),
            exported_mm=float(exported.mean()),
            model_mm=float(np.sqrt(np.trace(covariances, axis1=1, axis2=2).mean())),
            exported_max_mm=float(exported.max()),
            region=stated_text(self.region),
            n_poses=len(self.poses),
        )

    def in_reference_frame(self) -> Arm:
        """The arm with the frame of the model's points as its base frame."""
        turn = self.T_reference_base[:3, :3]
        return replace(
            self.arm,
            chain=self.arm.chain.with_reference_frame(self.T_reference_base),
            gravity_in_base=turn @ self.arm.gravity_direction,
        )


def best_rigid_arm(
    model: Compensator,
    angles: npt.ArrayLike | None = None,
    *,
    region: str = "",
    nominal: Arm | None = None,
    terms_of: TermsOf | None = None,
) -> RigidArm:
    """Identify the constants of the rigid arm that is nearest to a model over a region.

    Parameters
    ----------
    model : Compensator
        Fitted, of any kind. Temperature and loads are the means of its training.
    angles : (n, n_joints) array, optional
        Poses of the region [rad, or mm]; by default the sample of the training readings. Of more than `MAX_POSES` as
        many, evenly spaced in their order.
    region : str
        The poses in words.
    nominal : Arm, optional
        Another description of the same arm, to whose frames and constants the stand-in is nearest; by default the arm
        for which the model was fitted. Its base and its tip are placed where the model's points have them.
    terms_of : callable, optional
        What may differ from the nominal arm: `all_constants` by default.

    Raises
    ------
    InputError
        If the model keeps no sample and no poses are given; if poses are fewer than `MIN_ROWS`, not of this arm or
        mostly beyond its limits; if the nominal arm is another one.
    """
    arm = model.arm_ if nominal is None else nominal
    poses, words = _region(model, angles, region)
    points = model.predict(poses)
    start, free = _placed(model, arm, poses, points)
    terms = (terms_of or all_constants)(start, free)
    fit = _fitted(start, terms, poses, points)
    chain = fit.chain
    T_reference_base = np.eye(4)
    if "base" in free:
        T_reference_base = chain.fixed[0] @ np.linalg.inv(arm.chain.fixed[0])
        chain = Chain(
            np.concatenate([arm.chain.fixed[:1], chain.fixed[1:]]), chain.tip_in_flange, chain.prismatic, chain.coupling
        )
    kind = type(model).__name__.removesuffix("Model").lower()
    title = f"{arm.title}, constants refitted to a {kind} model".strip(", ")
    rigid = replace(arm, chain=chain, title=title, serial_number=model.arm_.serial_number or arm.serial_number)
    return RigidArm(model, rigid, arm, T_reference_base, fit, poses, words, points, start, free, terms)


def _fitted(start: Chain, terms: list[Term], poses: FloatArray, points: FloatArray) -> IdentificationResult:
    """Constants identified from the model's points at the poses."""
    references = [Points(np.arange(len(poses)), points)]
    return identify(start, ArmState(start, poses), terms, references, robust=False)


def _held_out_errors(
    fit: IdentificationResult, start: Chain, terms: list[Term], poses: FloatArray, points: FloatArray
) -> FloatArray:
    """Distances (n,) [mm] from the points of constants that were identified from the other parts of the region.

    At the poses of a fit its own distances are too small, by much where the poses are few. Equal poses are in one part.
    """
    distinct, group = np.unique(poses, axis=0, return_inverse=True)
    part = group.ravel() % min(N_PARTS, len(distinct))
    errors: FloatArray = np.linalg.norm(fit.chain.tip_in_base(poses) - points, axis=1)
    if len(distinct) <= MIN_ROWS:  # nothing determines constants from fewer
        return errors
    for held_out in (part == k for k in np.unique(part)):
        chain = _fitted(start, terms, poses[~held_out], points[~held_out]).chain
        errors[held_out] = np.linalg.norm(chain.tip_in_base(poses[held_out]) - points[held_out], axis=1)
    return errors


def _region(model: Compensator, angles: npt.ArrayLike | None, region: str) -> tuple[FloatArray, str]:
    """Poses (n, n_joints) of the region, and the region in words."""
    if angles is None:
        sample = model.training_.angle_sample
        if sample is None:
            raise InputError(
                "the model file keeps no poses of its training: it was written by an earlier version",
                hint="give the region: --region with the training session, or fit the model again",
            )
        return sample, region or TRAINING_REGION
    poses = np.asarray(angles, dtype=float)
    n_joints = model.arm_.n_joints
    if poses.ndim != 2 or poses.shape[1] != n_joints or len(poses) < MIN_ROWS or not np.isfinite(poses).all():
        raise InputError(
            f"expected a region of {MIN_ROWS} or more poses of {n_joints} joints, finite, in rad or mm, "
            f"got an array of shape {poses.shape}"
        )
    if len(poses) > MAX_POSES:
        poses = poses[np.linspace(0, len(poses) - 1, MAX_POSES).round().astype(int)]
    return poses, region or "stated poses"


def _placed(model: Compensator, nominal: Arm, poses: FloatArray, points: FloatArray) -> tuple[Chain, tuple[str, ...]]:
    """The nominal chain with base and tip identified, and the parts that are free."""
    if same_chain(nominal.chain, model.arm_.chain):
        return _with_nominal_flange(model.nominal_.chain, nominal.chain), model.free_
    start, arm = nominal.chain, model.arm_
    if start.n_joints != arm.n_joints or (start.is_prismatic != arm.chain.is_prismatic).any():
        raise InputError(
            f"the arm {nominal.name!r} has {_joints(start)}, the model's arm {arm.name!r} {_joints(arm.chain)}",
            hint="choose the chain by its links: FILE.urdf:BASE:TIP",
        )
    rough = roughly_aligned_chain(nominal, Session(poses, points), FREE_PARTS)
    terms = constants(start, free=FREE_PARTS, angle_std=0.0, length_std=0.0)
    placed = _fitted(rough, terms, poses, points).chain
    error = float(np.linalg.norm(placed.tip_in_base(poses) - points, axis=1).mean())
    if error > MAX_NOMINAL_ERROR * start.reach:
        contradict(
            InputError(
                f"the arm {nominal.name!r} misses the model's points by {error:.4g} mm on average: "
                f"it is not the arm {arm.name!r}, or its joints have other zeros or directions"
            )
        )
    return placed, FREE_PARTS


def same_chain(one: Chain, other: Chain) -> bool:
    """Whether two descriptions give the same frames, to the rounding of printed angles."""
    return (
        one.n_joints == other.n_joints
        and (one.is_prismatic == other.is_prismatic).all()
        and np.allclose(one.fixed, other.fixed, rtol=0, atol=1e-9)
        and np.allclose(one.tip_in_flange, other.tip_in_flange, rtol=0, atol=1e-9)
        and np.allclose(
            one.by_encoders(np.eye(one.n_joints)), other.by_encoders(np.eye(one.n_joints)), rtol=0, atol=1e-9
        )
    )


def _with_nominal_flange(chain: Chain, nominal: Chain) -> Chain:
    """The chain with the nominal flange and the same tips, where a tool's rotation turned the flange."""
    turn = nominal.fixed[-1, :3, :3].T @ chain.fixed[-1, :3, :3]
    fixed = chain.fixed.copy()
    fixed[-1, :3, :3] = nominal.fixed[-1, :3, :3]
    return Chain(fixed, turn @ chain.tip_in_flange, chain.prismatic, chain.coupling)


def all_constants(chain: Chain, free: tuple[str, ...]) -> list[Term]:
    """Constants of all places, without those that a motion of the base or the tip replaces.

    Motions after the last joint move the tip as translations of the tip do: the flange stays nominal.
    """
    return [
        term
        for term in constants(chain, free=free)
        if term.place != chain.n_joints
        and not (term.place == 1 and term.direction in _ALONG_Z)
        and not term.group.startswith("equivalent to a free")
    ]


def zeros_alone(chain: Chain, free: tuple[str, ...]) -> list[Term]:
    """The zeros of the joints, and the parts that are free."""
    return [term for term in all_constants(chain, free) if term.group in (*free, "joint offsets")]


def _joints(chain: Chain) -> str:
    n_sliding = int(chain.is_prismatic.sum())
    return f"{chain.n_joints} joints" + (f", {n_sliding} of them sliding" if n_sliding else "")
