"""Robot cells with a camera whose mounts and poses are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import inverse, motion
from truearm.wings.camera.mounts import mounts


def frame(rpy_deg, xyz):
    return motion(Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix(), np.array(xyz, dtype=float))


@dataclass(frozen=True, eq=False)
class Cell:
    """Joints, flange in base, board in camera, and where camera and board are (in the flange's and base's axes)."""

    arm: ta.Arm
    joints: np.ndarray
    flange: np.ndarray
    seen: np.ndarray
    camera: np.ndarray
    board: np.ndarray
    eye_in_hand: bool

    def with_seen(self, seen):
        return replace(self, seen=seen)

    def hand_eye(self, *, joints=False, **options):
        robot = self.joints if joints else self.flange
        return ta.hand_eye(
            self.seen, robot, arm=self.arm if joints else None, eye_in_hand=self.eye_in_hand or None, **options
        )


# The flange points down; a camera on it sees a board below, with smaller movements.
MIDDLE = np.array([0.0, -1.2, 1.5, -1.9, -1.5, 0.0])
SPREAD = {False: np.array([0.6, 0.6, 0.6, 1.2, 1.2, 1.2]), True: np.array([0.25, 0.2, 0.2, 0.4, 0.4, 1.5])}


def make_cell(seed=0, n=20, *, eye_in_hand=False, errors=(0.0, 0.0), noise=(0.0, 0.0)):
    """A cell: errors of the arm's constants [rad, mm], noise of orientations [deg] and positions [mm]."""
    rng, arm = np.random.default_rng(seed), ta.load_arm("ur10")
    chain = arm.chain
    off = rng.normal(size=(chain.n_places, 6)) * np.repeat(errors, 3)
    off[[0, -1]] = 0.0
    true = chain.with_motions(off)
    joints = MIDDLE + rng.uniform(-1, 1, (n, 6)) * SPREAD[eye_in_hand]
    flange = flanges(true, joints)
    if eye_in_hand:
        camera = frame([3, -8, 40], [30, -60, 90])
        board = flanges(chain, MIDDLE[None])[0] @ camera @ frame([5, -4, 30], [-60, -50, 550])
        exact = inverse(camera) @ inverse(flange) @ board
    else:
        camera, board = frame([-110, 0, 90], [2200, 0, 600]), frame([20, -30, 70], [80, -40, 150])
        exact = inverse(camera) @ flange @ board
    turned = Rotation.from_rotvec(np.radians(noise[0]) * rng.normal(size=(n, 3))).as_matrix()
    seen = exact @ motion(turned, np.zeros((n, 3)))
    seen[:, :3, 3] += noise[1] * rng.normal(size=(n, 3))
    camera, board = in_axes_of_arm(true, arm, camera, board, eye_in_hand)
    return Cell(arm, joints, flange, seen, camera, board, eye_in_hand)


def flanges(chain, joints):
    pose = chain.pose(joints)
    return motion(pose.R_base_tip, pose.tip_in_base)


def in_axes_of_arm(true, arm, camera, board, eye_in_hand):
    """Camera and board in the base and the flange that readings of the true chain show."""
    standing, carried = (board, camera) if eye_in_hand else (camera, board)
    fixed = true.fixed.copy()
    fixed[0] = inverse(standing) @ fixed[0]
    fixed[-1] = fixed[-1] @ motion(carried[:3, :3], np.zeros(3))
    chain = Chain(fixed, carried[:3, :3].T @ carried[:3, 3], true.prismatic, true.coupling)
    in_base, on_flange = mounts(chain, arm.chain)
    return (on_flange, in_base) if eye_in_hand else (in_base, on_flange)
