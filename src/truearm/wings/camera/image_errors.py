"""Errors of boards in images that are not in a fit: where they are seen, against where they are predicted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.rigid_motions import cross_matrix, inverse, motion
from truearm.findings import Finding, format_mm
from truearm.models import IdentifiedModel
from truearm.typing import BoolArray, FloatArray
from truearm.verbs.record import Record, TextTable, format_fixed, number_of
from truearm.wings.camera.cell_images import CellImages
from truearm.wings.camera.cell_poses import CellPoses
from truearm.wings.camera.images import adjust, first_poses

LEVEL = 0.95


@dataclass(frozen=True, eq=False, repr=False)
class ImageErrors(Record):
    """Errors of boards in images that are not in the fit.

    Attributes
    ----------
    names : tuple of str
        Of the images.
    position_mm, orientation_deg : (n, 3) array
        Of the middle of the board, and of a rotation of it: predicted less seen.
    alone_mm, alone_deg : (n, 3) array
        The same with the arm as it is drawn.
    position_inside, orientation_inside : (n,) bool array
        Whether an error is in its 95 % region.
    findings : tuple of Finding
    """

    names: tuple[str, ...]
    position_mm: FloatArray
    orientation_deg: FloatArray
    alone_mm: FloatArray
    alone_deg: FloatArray
    position_inside: BoolArray
    orientation_inside: BoolArray
    findings: tuple[Finding, ...]

    @classmethod
    def of(
        cls,
        model: IdentifiedModel,
        nominal: IdentifiedModel,
        fitted: CellPoses,
        unknowns: FloatArray,
        covariance: FloatArray,
        cell: CellImages,
    ) -> ImageErrors:
        """Of the images of a cell.

        Parameters
        ----------
        model, nominal : IdentifiedModel
            The identified arm, and the nominal one at the same place.
        fitted : CellPoses
            What they were fitted to.
        unknowns : (a,) array
            Intrinsics and sizes of the boards.
        covariance : (n + a, n + a) array
            Of the coefficients of the model and of these.
        cell : CellImages
        """
        kept = cell.images.kept()
        images = replace(cell.images, u_intrinsics=fitted.images.u_intrinsics, u_scale=fitted.images.u_scale)
        start = first_poses(replace(kept, lenses=fitted.images.values(unknowns)[0]))
        poses = replace(
            fitted,
            readings=cell.readings,
            rows=cell.rows,
            images=images,
            adjusted=adjust(images, *start, unknowns, keep=True),
        ).named()
        errors, known = _errors(model, poses, covariance)
        alone = _errors(nominal, poses, None)[0]
        limit = model.ellipsoid_factor(LEVEL) ** 2
        inside = [
            np.einsum("ni,nij,nj->n", errors[:, one], np.linalg.inv(known[:, one, one]), errors[:, one]) <= limit
            for one in (slice(0, 3), slice(3, 6))
        ]
        names = tuple(map(cell.called, range(len(cell.rows))))
        return cls(
            names=names,
            position_mm=errors[:, :3],
            orientation_deg=np.degrees(errors[:, 3:]),
            alone_mm=alone[:, :3],
            alone_deg=np.degrees(alone[:, 3:]),
            position_inside=inside[0],
            orientation_inside=inside[1],
            findings=cell.findings,
        )

    def summary(self) -> str:
        """The answer in one sentence."""
        mean, alone = (
            format_mm(float(np.linalg.norm(one, axis=1).mean())) for one in (self.position_mm, self.alone_mm)
        )
        return (
            f"In {number_of(len(self.names), 'image')} that are not in the fit the board is where it is predicted to "
            f"{mean} (mean); by hand-eye alone to {alone}."
        )

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        own, alone = self._statistics().values()
        yield TextTable(("board", "hand-eye alone", "model"), [
            (name, format_fixed(alone[name]), format_fixed(value)) for name, value in own.items()
        ])  # fmt: skip
        position, orientation = (100 * float(one.mean()) for one in (self.position_inside, self.orientation_inside))
        yield (
            f"{position:.1f} % of the positions and {orientation:.1f} % of the orientations are inside their stated "
            f"{100 * LEVEL:.0f} % regions."
        )
        yield from map(str, self.findings)

    def _statistics(self) -> dict[str, dict[str, float]]:
        found: dict[str, dict[str, float]] = {}
        for arm, mm, deg in (
            ("model", self.position_mm, self.orientation_deg),
            ("alone", self.alone_mm, self.alone_deg),
        ):
            of = found.setdefault(arm, {})
            for unit, errors in (("mm", mm), ("deg", deg)):
                size = np.linalg.norm(errors, axis=1)
                of[f"mean_{unit}"], of[f"rms_{unit}"] = float(size.mean()), float(np.sqrt((size**2).mean()))
                of[f"p95_{unit}"], of[f"max_{unit}"] = float(np.quantile(size, LEVEL)), float(size.max())
        return found

    def _json(self) -> object:
        statistics = self._statistics()
        return {
            "summary": self.summary(),
            "n": len(self.names),
            **statistics["model"],
            "hand_eye_alone": statistics["alone"],
            "coverage": float(self.position_inside.mean()),
            "orientation_coverage": float(self.orientation_inside.mean()),
            "findings": [str(one) for one in self.findings],
        }


def _errors(model: IdentifiedModel, poses: CellPoses, joint: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Errors (n, 6) of the boards' middles [mm] and orientations [rad], and their covariance (n, 6, 6).

    An error of the cameras moves what is seen, and the arm with it: both are uncertain together. The covariance is
    without that of the arm and the cameras where none is given.
    """
    fit, at = model.fit_, model.at(poses.session().rows(poses.rows))
    pose, J = fit.perturbed_chain.pose_by_coefficients(at.state, fit.coefficients)
    frames = np.stack([model.session_frames_.get(name, np.eye(4)) for name in poses.standing])
    predicted, (seen, by_pose) = inverse(frames) @ motion(pose.R_base_tip, pose.tip_in_base), poses.tips()
    turn = Rotation.from_matrix(predicted[:, :3, :3] @ seen[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    errors = np.concatenate([predicted[:, :3, 3] - seen[:, :3, 3], turn], axis=1)
    covariance = by_pose @ poses.adjusted.covariance @ by_pose.transpose(0, 2, 1)
    if joint is not None:
        J = np.concatenate([frames[:, :3, :3].transpose(0, 2, 1) @ part for part in (J[:, :3], J[:, 3:])], axis=1)
        both = np.concatenate([J, -by_pose @ poses.adjusted.by_unknown], axis=2)
        own = model.covariance_parts(at)[1]
        covariance += both @ joint @ both.transpose(0, 2, 1)
        covariance[:, :3, :3] += own
        covariance[:, 3:, 3:] += np.trace(own, axis1=1, axis2=2)[:, None, None] / 3 / poses.lever_mm**2 * np.eye(3)
    # From the tip to the middle of the board, which of a camera on the flange is the origin of the frame.
    in_hand = poses.in_hand[poses.images.camera][:, None]
    lever = np.where(in_hand, 0.0, poses.adjusted.t) - seen[:, :3, 3]
    D = np.tile(np.eye(6), (len(lever), 1, 1))
    D[:, :3, 3:] = -cross_matrix(lever)
    return np.einsum("nij,nj->ni", D, errors), D @ covariance @ D.transpose(0, 2, 1)
