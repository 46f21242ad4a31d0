"""Poses of boards that images show beside the joints, as one reading each, with errors that belong together.

*Eye to hand*: the reference's frame is that of the camera, and the board is on the flange. *Eye in hand*: the frame is
that of the board, from its middle, and the camera is on the flange. So what stands, a camera or a board, is a frame of
readings, and what the flange carries, a board or a camera, is a tip. All of these tips are one point of the flange: the
middle of the boards on it and, of a camera, of the point on its axis as far away as boards usually were, where its
position and tilt are known best.

An image has six residuals, not two for each corner: its corners determine a pose, with the covariance that they give
it, and what the arm does that no term describes moves all of them together. To first order in the cameras' intrinsics
and the sizes of the boards that is the same as all pixels at once, with the arm's own errors beside them. Images of one
reading share the arm's error: each has as many times its variance as there are images.

Images that are not in a fit show where boards are seen, against where they are predicted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Arm
from truearm.arm.rigid_motions import cross_matrix, inverse, motion
from truearm.findings import Finding, format_mm
from truearm.identification.estimation.common_errors import settled_pose_errors
from truearm.models import IdentifiedModel
from truearm.readings import Session
from truearm.readings.pose_errors import PoseErrors
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray
from truearm.verbs.record import Record, TextTable, format_fixed, number_of
from truearm.wings.camera.cell_images import CellImages
from truearm.wings.camera.images import Adjustment, Images, adjust, first_poses

# Rounds in which the arm and the cameras are fitted in turn, before the fit of the arm proper.
ROUNDS = 2


@dataclass(frozen=True, eq=False, kw_only=True)
class CellPoses:
    """Poses of boards by images at readings of an arm.

    Attributes
    ----------
    readings : Session
        Angles, and what else is known, of n readings.
    rows : (m,) int array
        The readings with an image.
    images : Images
        Of these.
    adjusted : Adjustment
    in_hand : (k,) bool array
        Whether each camera is on the flange.
    T_child_tip : mapping of str to (4, 4) array
        By the name of what the flange carries, board or camera, the tip in its frame, with the axes of all tips on the
        nominal arm [mm].
    lever_mm, arm_std_mm : float
        See `truearm.readings.pose_errors.PoseErrors`.
    """

    readings: Session
    rows: IntArray
    images: Images
    adjusted: Adjustment
    in_hand: BoolArray
    T_child_tip: dict[str, FloatArray]
    lever_mm: float = PoseErrors.lever_mm
    arm_std_mm: float = 0.0

    @property
    def carried(self) -> tuple[str, ...]:
        """(m,) what the flange carries of camera and board of every image; the other one stands."""
        return self._names(self.in_hand[self.images.camera])

    @property
    def standing(self) -> tuple[str, ...]:
        """(m,) the other one."""
        return self._names(~self.in_hand[self.images.camera])

    def _names(self, is_camera: BoolArray) -> tuple[str, ...]:
        of = self.images
        both = zip(is_camera.tolist(), of.camera.tolist(), of.board.tolist(), strict=True)
        return tuple(of.cameras[k] if camera else of.boards[b] for camera, k, b in both)

    def pairs(self) -> Iterator[tuple[str, str, BoolArray]]:
        """What is carried, what stands, and the images (m,) of both, of every camera with every board that it sees."""
        carried, standing = np.array(self.carried), np.array(self.standing)
        for one, other in dict.fromkeys(zip(self.carried, self.standing, strict=True)):
            yield one, other, (carried == one) & (standing == other)

    @property
    def T_camera_board(self) -> FloatArray:
        """(m, 4, 4) poses of the boards' middles [mm]."""
        return motion(self.adjusted.R, self.adjusted.t)

    def named(self) -> CellPoses:
        """The same with the names of what stands as sessions of the readings, and of what is carried as tips."""
        n_standing = len(self.images.cameras) + len(self.images.boards) - len(self.T_child_tip)
        session = self._column(self.readings.session, self.standing, n_standing)
        tip = self._column(self.readings.tip, self.carried, len(self.T_child_tip))
        return replace(self, readings=replace(self.readings, session=session, tip=tip))

    def _column(self, given: NameArray | None, names: tuple[str, ...], n: int) -> NameArray | None:
        """A column of the readings as it is given, with the names at the images where there are `n` of them."""
        if n == 1:
            return given
        column = np.full(len(self.readings), names[0], object) if given is None else given.astype(object)
        column[self.rows] = names
        return column.astype(np.str_)

    @property
    def n_images(self) -> int:
        """Number of images, of which one may show several boards."""
        return len(np.unique(np.stack([self._numbers, self.images.camera]), axis=1).T)

    @property
    def _numbers(self) -> IntArray:
        assert self.readings.numbers is not None
        return self.readings.numbers[self.rows]

    def select(self, which: IntArray) -> CellPoses:
        """Those of some of the images; what all of them say of the cameras stays."""
        parts = ("R", "t", "residuals", "covariance", "by_unknown")
        some = replace(self.adjusted, **{name: getattr(self.adjusted, name)[which] for name in parts})
        return replace(self, rows=self.rows[which], images=self.images.rows(which), adjusted=some)

    def tips(self) -> tuple[FloatArray, FloatArray]:
        """(m, 4, 4) poses of the tip in what stands [mm], and by those of the board in the camera (m, 6, 6)."""
        in_hand = self.in_hand[self.images.camera][:, None, None]
        seen = self.T_camera_board
        T_child_tip = np.stack([self.T_child_tip[name] for name in self.carried])
        T = np.where(in_hand, inverse(seen), seen) @ T_child_tip
        # Where the tip is that is carried, from the origin of what moves: the board's, or the camera's board.
        apart = np.where(in_hand[:, 0], T_child_tip[:, :3, 3] - seen[:, :3, 3], 0.0)
        lever = (seen[:, :3, :3] @ T_child_tip[:, :3, 3:])[:, :, 0]
        by_pose = np.tile(np.eye(6), (len(T), 1, 1))
        by_pose[:, :3, 3:] = -cross_matrix(lever)
        back = seen[:, :3, :3].transpose(0, 2, 1)
        of_camera = np.zeros((len(T), 6, 6))
        of_camera[:, :3, :3] = of_camera[:, 3:, 3:] = -back
        of_camera[:, :3, 3:] = back @ cross_matrix(apart)
        return T, np.where(in_hand, of_camera, by_pose)

    def session(self) -> Session:
        """The readings with the poses as points and quaternions, and their errors."""
        T, by_pose = self.tips()
        covariance = by_pose @ self.adjusted.covariance @ by_pose.transpose(0, 2, 1)
        covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
        std = np.sqrt(np.diagonal(covariance[:, :3, :3], axis1=1, axis2=2))
        own = self.arm_std_mm * np.repeat([1.0, 1.0 / self.lever_mm], 3)
        shared = self._images_of_the_reading() - 1
        n, a = len(self.readings), self.adjusted.by_unknown.shape[2]
        errors = PoseErrors(
            covariance=self._at_rows(covariance + shared[:, None, None] * np.diag(own**2), np.zeros((n, 6, 6))),
            by_common=self._at_rows(by_pose @ self.adjusted.by_unknown, np.zeros((n, 6, a))),
            common=self.images.names,
            root=self.adjusted.root,
            offset=self.adjusted.offset,
            lever_mm=self.lever_mm,
            arm_std_mm=self.arm_std_mm,
        )
        quaternion = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True)
        return replace(
            self.readings,
            points=self._at_rows(T[:, :3, 3], np.full((n, 3), np.nan)),
            point_std=self._at_rows(std, np.full((n, 3), np.nan)),
            quaternion=self._at_rows(quaternion, np.full((n, 4), np.nan)),
            pose_errors=errors,
        )

    def _images_of_the_reading(self) -> IntArray:
        """(m,) number of images of the reading of every image."""
        _, which, n = np.unique(self._numbers, return_inverse=True, return_counts=True)
        return np.asarray(n[which])

    def _at_rows(self, values: FloatArray, of_all: FloatArray) -> FloatArray:
        of_all[self.rows] = values
        return of_all

    def settled(self, arm: Arm, free: tuple[str, ...]) -> CellPoses:
        """The same about the cameras that arm and images show together, with the sizes of the arm's own errors."""
        poses = self
        for _ in range(ROUNDS):
            common, lever, std = settled_pose_errors(poses.session(), arm, free, poses.lever_mm)
            poses = replace(poses.about(poses.adjusted.unknowns + common), lever_mm=lever, arm_std_mm=std)
        return poses

    def about(self, unknowns: FloatArray) -> CellPoses:
        """The same with other intrinsics and sizes."""
        adjusted = adjust(self.images, self.adjusted.R, self.adjusted.t, unknowns, keep=True)
        return replace(self, adjusted=adjusted)


LEVEL = 0.95
# From so many images on, and where it leaves so many times less, a camera or board is said to be at another place.
LEAST_IMAGES, LEAST_LESS = 4, 4.0


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
        errors, known, predicted, seen = _errors(model, poses, covariance)
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
            findings=(*cell.findings, *_other_places(poses, predicted, seen, inside[0])),
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


def _other_places(poses: CellPoses, predicted: FloatArray, seen: FloatArray, inside: BoolArray) -> Iterator[Finding]:
    """That what stands, or what the flange carries, is at another place than in the fit, by poses (n, 4, 4)."""
    for carried, standing, own in poses.pairs():
        if own.sum() < LEAST_IMAGES or 2 * inside[own].sum() > own.sum():
            continue
        P, S = predicted[own], seen[own]
        before = float(np.linalg.norm(P[:, :3, 3] - S[:, :3, 3], axis=1).mean())
        turned = Rotation.from_matrix(P[:, :3, :3] @ S[:, :3, :3].transpose(0, 2, 1)).mean()
        on_flange = Rotation.from_matrix(S[:, :3, :3].transpose(0, 2, 1) @ P[:, :3, :3]).mean()
        found = []
        for name, where, turn, apart in (
            (standing, "stands", turned, P[:, :3, 3] - turned.apply(S[:, :3, 3])),
            (
                carried,
                "sits on the flange",
                on_flange,
                np.einsum("nji,nj->ni", S[:, :3, :3], P[:, :3, 3] - S[:, :3, 3]),
            ),
        ):
            shift = apart.mean(axis=0)
            left = float(np.linalg.norm(apart - shift, axis=1).mean())
            found.append((left, name, where, float(np.linalg.norm(shift)), float(np.degrees(turn.magnitude()))))
        left, name, where, mm, deg = min(found)
        if LEAST_LESS * left < before:
            said = (
                f"The {name} {where} {format_mm(mm)} and {deg:.3g} deg from its place in the fit: with that "
                f"{format_mm(left)} remain of {format_mm(before)}. Put it back, or fit images from there."
            )
            yield Finding("hand-eye", said, {"moved_mm": mm, "turned_deg": deg})


def _errors(
    model: IdentifiedModel, poses: CellPoses, joint: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Errors (n, 6) of the boards' middles [mm] and orientations [rad], their covariance (n, 6, 6), and poses.

    The poses (n, 4, 4) are those of the tip in what stands, predicted and seen.

    An error of the cameras moves what is seen, and the arm with it: both are uncertain together. The covariance is
    without that of the arm and the cameras where none is given.
    """
    fit, at = model.fit_, model.at(poses.session().rows(poses.rows))
    pose, J = fit.perturbed_chain.pose_by_coefficients(at.state, fit.coefficients)
    frames = np.stack([model.session_frames_.get(name, np.eye(4)) for name in poses.standing])
    predicted, (seen, by_pose) = inverse(frames) @ motion(*pose), poses.tips()
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
    return np.einsum("nij,nj->ni", D, errors), D @ covariance @ D.transpose(0, 2, 1), predicted, seen
