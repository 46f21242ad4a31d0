"""Change of an arm's constants between two models of it: by how much, with which uncertainty, and what it does to tips.

Both models are replaced by their best rigid arms over the same poses, written as tables in the same branch of the
nominal one. So parameters that the poses do not separate are treated alike, and show no change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtri

from truearm.arm import Chain
from truearm.arm.rigid_motions import motion
from truearm.errors import InputError
from truearm.models import IdentifiedModel
from truearm.models.compensator import FREE_PARTS
from truearm.readings import Session
from truearm.solve.distributions import chi2_quantile
from truearm.typing import FloatArray
from truearm.wings.exports.formats.constants_table import (
    NOMINAL,
    NOT_IDENTIFIABLE,
    ConstantsTable,
    Unit,
    constants_table,
)
from truearm.wings.exports.formats.rigid_arm import best_rigid_arm

# Probability that any constant of an unchanged arm counts as changed, and that its tips do.
FALSE_ALARM = 0.05
# A displacement below this is the rounding of the arithmetic [mm].
ROUNDING_MM = 1e-6
# Poses inside both trained ranges are used alone if they are this share of all.
LEAST_COMMON_SHARE = 0.5


@dataclass(frozen=True)
class ConstantChange:
    """The change of one constant.

    Attributes
    ----------
    place, name : str
        As in `ArmConstant`.
    unit : {"rad", "mm"}
    nominal, old, new : float
    change : float
        New less old; of the base's rotation vector the small turn about the old base's axes.
    u_old, u_new : float
        Standard uncertainties.
    coverage_factor : float
        Standard uncertainties that a change must exceed to count.
    tip_mm : float
        Mean displacement of the tip by this change alone, base and tip aligned [mm].
    is_determined : bool
        Whether the readings of both models determine it, or U is below the standard deviation before any readings:
        the evidence of a right arm shrinks that until they tell no more, although the constant is known.
    """

    place: str
    name: str
    unit: Unit
    nominal: float
    old: float
    new: float
    change: float
    u_old: float
    u_new: float
    coverage_factor: float
    tip_mm: float
    is_determined: bool

    @property
    def U(self) -> float:
        """Expanded uncertainty of the change, ``k sqrt(u_old^2 + u_new^2)`` (JCGM 100:2008, 5.1.2 and 6.2.1)."""
        return float(self.coverage_factor * np.hypot(self.u_old, self.u_new))

    @property
    def is_changed(self) -> bool:
        """Whether the change exceeds its expanded uncertainty."""
        return abs(self.change) > self.U


@dataclass(frozen=True)
class TipDisplacement:
    """Displacements of the tip from one model to another, base and tip aligned [mm].

    Attributes
    ----------
    mean_mm, max_mm, rms_mm : float
        Over the poses.
    limit_mm : float
        What the root mean square of an unchanged arm exceeds with a probability of `FALSE_ALARM`, by the uncertainties
        of both models.
    n_poses : int
    region : {"both", "either"}
        Whether the poses are in the trained range of both models, or of one of them.
    """

    mean_mm: float
    max_mm: float
    rms_mm: float
    limit_mm: float
    n_poses: int
    region: Literal["both", "either"]

    @property
    def is_significant(self) -> bool:
        """Whether the uncertainties do not explain it."""
        return self.rms_mm > max(self.limit_mm, ROUNDING_MM)


@dataclass(frozen=True)
class ArmChange:
    """What changed between two models of an arm.

    Attributes
    ----------
    constants : tuple of ConstantChange
        Constants inside the arm that both tables have, from base to tip. A base or tip that is known in both models
        is inside the arm.
    displacement : TipDisplacement
    base_shift_mm, base_turn_rad : float or None
        How far the base moved in the frame of the models' points; None if it is inside the arm.
    tip_shift_mm : (3,) tuple of float or None
        How far the tip moved along the axes of the nominal flange; None if it is inside the arm.
    """

    constants: tuple[ConstantChange, ...]
    displacement: TipDisplacement
    base_shift_mm: float | None
    base_turn_rad: float | None
    tip_shift_mm: tuple[float, ...] | None


def constants_change(old: IdentifiedModel, new: IdentifiedModel) -> ArmChange:
    """The change of an arm's constants from an old model to a new one.

    A change counts if it exceeds k standard uncertainties ``sqrt(u_old^2 + u_new^2)``. With
    ``2 Phi(k) - 1 = (1 - 0.05)^(1/m)`` no more than 5 % of unchanged arms have any of m changes, however the normal
    errors are correlated (Z. Sidak, J. Am. Stat. Assoc. 62 (1967) 626).

    The errors of both models are taken as independent. What the priors contribute they have in common: both keep
    constants that the readings hardly determine near the nominal arm. So the uncertainty of such a change is too large
    rather than too small (the term of the correlation in JCGM 100:2008, 5.2.2, would reduce it). Likewise the
    uncertainty of the best rigid arm, which is in both, is partly that of the same poses.

    Parameters
    ----------
    old, new : IdentifiedModel
        Fitted, of one tip each, with the same nominal chain.

    Raises
    ------
    InputError
        If a model keeps no poses of its training.
    """
    poses, region = _poses_of_both(old, new)
    free = [part for part in FREE_PARTS if part in old.free_ or part in new.free_]
    tables = [constants_table(model, best_rigid_arm(model, poses), free=free) for model in (old, new)]
    before, after = tables
    chain = before.identified.chain()
    alignment = _alignment(chain, poses, free)
    base, tip = before.identified.base, before.identified.tip_in_flange
    turn = after.identified.base @ np.linalg.inv(base) if "base" in free else np.eye(4)
    shift = after.identified.tip_in_flange - tip if "tip" in free else np.zeros(3)
    return ArmChange(
        _constant_changes(before, after, free, poses, alignment),
        _displacement(old, new, turn, chain.pose(poses).R_base_tip @ shift, poses, alignment, region),
        float(np.linalg.norm(after.identified.base[:3, 3] - base[:3, 3])) if "base" in free else None,
        float(Rotation.from_matrix(turn[:3, :3]).magnitude()) if "base" in free else None,
        tuple(shift.tolist()) if "tip" in free else None,
    )


def _poses_of_both(old: IdentifiedModel, new: IdentifiedModel) -> tuple[FloatArray, Literal["both", "either"]]:
    """Distinct training poses (n, n_joints) of both models, if most are inside both trained ranges only those."""
    samples = [model.training_.angle_sample for model in (old, new)]
    kept = [sample for sample in samples if sample is not None]
    if len(kept) < len(samples):
        raise InputError(
            "a model file keeps no poses of its training: it was written by an earlier version",
            hint="fit the model again",
        )
    poses = np.unique(np.concatenate(kept), axis=0)
    common = poses[~(old.outside_training(poses) | new.outside_training(poses))]
    return (common, "both") if len(common) >= LEAST_COMMON_SHARE * len(poses) else (poses, "either")


def _alignment(chain: Chain, poses: FloatArray, free: Sequence[str]) -> FloatArray:
    """(3 n, k) orthonormal displacements of tips by small motions of the free parts."""
    by_motion = chain.tip_derivatives(poses).motion_jacobian
    parts = {"base": by_motion[:, 0], "tip": by_motion[:, -1, 3:]}
    columns = [parts[part].transpose(0, 2, 1).reshape(3 * len(poses), -1) for part in free]
    return np.linalg.qr(np.hstack(columns))[0] if columns else np.zeros((3 * len(poses), 0))


def _aligned(displacements: FloatArray, alignment: FloatArray) -> FloatArray:
    """Displacements (k, n, 3) without what small motions of the free parts explain, by least squares."""
    flat = displacements.reshape(len(displacements), alignment.shape[0])
    return np.asarray((flat - (flat @ alignment) @ alignment.T).reshape(displacements.shape))


def _displacement(
    old: IdentifiedModel,
    new: IdentifiedModel,
    turn: FloatArray,
    shift: FloatArray,
    poses: FloatArray,
    alignment: FloatArray,
    region: Literal["both", "either"],
) -> TipDisplacement:
    """Displacements of whole models' tips, with the base of the old one turned (4, 4) and its tip shifted (n, 3)."""
    back, readings = turn[:3, :3], Session(poses)  # to the old frame: x @ back
    moved = (new.predict(poses) - turn[:3, 3]) @ back - old.predict(poses) - shift
    errors = [
        old.birge_ratio_ * old.shared_displacements(readings),
        new.birge_ratio_ * new.shared_displacements(readings) @ back,
    ]
    aligned = _aligned(np.concatenate([moved[None], *errors]), alignment)
    sizes = np.linalg.norm(aligned[0], axis=1)
    flat = aligned[1:].reshape(-1, 3 * len(poses))
    rms = float(np.sqrt((sizes**2).mean()))
    limit = float(np.sqrt(_square_limit(flat) / len(poses)))
    return TipDisplacement(float(sizes.mean()), float(sizes.max()), rms, limit, len(poses), region)


def _square_limit(errors: FloatArray) -> float:
    """What the sum of squares of errors (m,), by k independent causes (k, m), exceeds with `FALSE_ALARM`.

    By a chi-squared variable of the same mean and variance (F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110).
    """
    products = errors @ errors.T if len(errors) < errors.shape[1] else errors.T @ errors
    mean, squares = float(np.trace(products)), float((products**2).sum())
    if not squares:
        return 0.0
    freedom = mean**2 / squares
    return mean / freedom * chi2_quantile(1 - FALSE_ALARM, freedom)


def _constant_changes(
    before: ConstantsTable, after: ConstantsTable, free: Sequence[str], poses: FloatArray, alignment: FloatArray
) -> tuple[ConstantChange, ...]:
    """Changes of the constants inside the arm that are not held in both tables."""
    pairs = [
        (was, now)
        for was, now in zip(before.constants, after.constants, strict=True)
        if was.place not in free and (was.std > 0 or now.std > 0) and not (was.status == now.status == NOMINAL)
    ]
    if not pairs:
        return ()
    k = float(ndtri((1 + (1 - FALSE_ALARM) ** (1 / len(pairs))) / 2))
    turn = Rotation.from_matrix(before.identified.base[:3, :3].T @ after.identified.base[:3, :3]).as_rotvec()
    tips, found = before.identified.chain().tip_in_base(poses), []
    for was, now in pairs:
        change = now.identified - was.identified
        if was.place == "base" and was.unit == "rad":
            change = float(turn["xyz".index(was.name[-1])])
        chain = _with_change(before, was.place, was.name, change)
        moved = _aligned((chain.tip_in_base(poses) - tips)[None], alignment)[0]
        tip_mm = float(np.linalg.norm(moved, axis=1).mean())
        values = (was.nominal, was.identified, now.identified, change, was.std, now.std, k, tip_mm)
        one = ConstantChange(was.place, was.name, was.unit, *values, is_determined=True)
        is_known = before.largest_prior[one.unit] >= one.U
        found.append(replace(one, is_determined=is_known or NOT_IDENTIFIABLE not in (was.status, now.status)))
    return tuple(found)


def _with_change(table: ConstantsTable, place: str, name: str, change: float) -> Chain:
    """The chain of a table with one constant changed."""
    dh = table.identified
    if place == "tip":
        return replace(dh, tip_in_flange=dh.tip_in_flange + change * np.eye(3)["xyz".index(name)]).chain()
    if place == "base":
        axis = change * np.eye(3)["xyz".index(name[-1])]
        turned = dh.base @ motion(Rotation.from_rotvec(axis).as_matrix(), np.zeros(3))
        return replace(dh, base=turned if len(name) > 1 else motion(np.eye(3), axis) @ dh.base).chain()
    row = table.joint_names.index(place)
    changes: dict[str, Any] = {name: getattr(dh, name) + change * (np.arange(len(dh.a)) == row)}
    return replace(dh, **changes).chain()
