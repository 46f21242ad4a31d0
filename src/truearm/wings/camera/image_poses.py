"""Poses of a board that images show beside the joints, as one reading each, with errors that belong together.

*Eye to hand*: the reference's frame is that of the camera, the tip is the middle of the board. *Eye in hand*: the frame
is that of the board, from its middle, and the tip is the point on the camera's axis as far away as the board usually
is: there the camera's position and tilt are known best.

An image has six residuals, not two for each corner: its corners determine a pose, with the covariance that they give
it, and what the arm does that no term describes moves all of them together. To first order in the camera's intrinsics
and the size of the board that is the same as all pixels at once, with the arm's own errors beside them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Arm
from truearm.arm.rigid_motions import cross_matrix
from truearm.identification.estimation.common_errors import settled_pose_errors
from truearm.readings import Session
from truearm.readings.pose_errors import PoseErrors
from truearm.typing import FloatArray, IntArray
from truearm.wings.camera.closed_form import motion
from truearm.wings.camera.images import Adjustment, Images, adjust

# Rounds in which the arm and the camera are fitted in turn, before the fit of the arm proper.
ROUNDS = 2


@dataclass(frozen=True, eq=False, kw_only=True)
class ImagePoses:
    """Poses of a board by images at readings of an arm.

    Attributes
    ----------
    readings : Session
        Angles, and what else is known, of n readings.
    rows : (m,) int array
        The readings with an image.
    images : Images
        Of these.
    adjusted : Adjustment
    is_in_hand : bool
        Whether the camera is on the flange.
    depth_mm : float
        Eye in hand: how far before the camera the tip is; 0 eye to hand.
    lever_mm, arm_std_mm : float
        See `truearm.readings.pose_errors.PoseErrors`.
    """

    readings: Session
    rows: IntArray
    images: Images
    adjusted: Adjustment
    is_in_hand: bool
    depth_mm: float = 0.0
    lever_mm: float = PoseErrors.lever_mm
    arm_std_mm: float = 0.0

    @property
    def T_camera_board(self) -> FloatArray:
        """(m, 4, 4) poses of the board's middle [mm]."""
        return motion(self.adjusted.R, self.adjusted.t)

    @property
    def centre(self) -> FloatArray:
        """(3,) The tip in the frame of the camera, or of the board's middle [mm]."""
        return np.array([0.0, 0.0, self.depth_mm])

    def select(self, which: IntArray) -> ImagePoses:
        """Those of some of the images; what all of them say of the camera stays."""
        a = self.adjusted
        some = replace(
            a,
            R=a.R[which],
            t=a.t[which],
            residuals=a.residuals[which],
            covariance=a.covariance[which],
            by_unknown=a.by_unknown[which],
        )
        return replace(self, rows=self.rows[which], images=self.images.rows(which), adjusted=some)

    def session(self) -> Session:
        """The readings with the poses as points and quaternions, and their errors."""
        adjusted, R, t = self.adjusted, self.adjusted.R, self.adjusted.t
        by_pose = np.tile(np.eye(6), (len(R), 1, 1))
        points, turned = t, R
        if self.is_in_hand:
            turned, apart = R.transpose(0, 2, 1), self.centre - t
            points = (turned @ apart[:, :, None])[:, :, 0]
            by_pose[:, :3, :3], by_pose[:, 3:, 3:] = -turned, -turned
            by_pose[:, :3, 3:] = turned @ cross_matrix(apart)
        covariance = by_pose @ adjusted.covariance @ by_pose.transpose(0, 2, 1)
        n, a = len(self.readings), adjusted.by_unknown.shape[2]
        errors = PoseErrors(
            covariance=self._at_rows(0.5 * (covariance + covariance.transpose(0, 2, 1)), np.zeros((n, 6, 6))),
            by_common=self._at_rows(by_pose @ adjusted.by_unknown, np.zeros((n, 6, a))),
            common=self.images.names,
            root=adjusted.root,
            offset=adjusted.offset,
            lever_mm=self.lever_mm,
            arm_std_mm=self.arm_std_mm,
        )
        std = np.sqrt(np.diagonal(covariance[:, :3, :3], axis1=1, axis2=2))
        quaternion = Rotation.from_matrix(turned).as_quat(scalar_first=True)
        return replace(
            self.readings,
            points=self._at_rows(points, np.full((n, 3), np.nan)),
            point_std=self._at_rows(std, np.full((n, 3), np.nan)),
            quaternion=self._at_rows(quaternion, np.full((n, 4), np.nan)),
            pose_errors=errors,
        )

    def _at_rows(self, values: FloatArray, of_all: FloatArray) -> FloatArray:
        of_all[self.rows] = values
        return of_all

    def settled(self, arm: Arm, free: tuple[str, ...]) -> ImagePoses:
        """The same about the camera that arm and images show together, with the sizes of the arm's own errors."""
        poses = self
        for _ in range(ROUNDS):
            common, lever, std = settled_pose_errors(poses.session(), arm, free, poses.lever_mm)
            unknowns = poses.adjusted.unknowns + common
            adjusted = adjust(poses.images, poses.adjusted.R, poses.adjusted.t, unknowns, keep=True)
            poses = replace(poses, adjusted=adjusted, lever_mm=lever, arm_std_mm=std)
        return poses
