"""A virtual robot cell: a virtual arm, a camera and a board, and what the camera sees, whose truth is known.

*Eye to hand*: the camera stands and the board is on the flange; *eye in hand*: the camera is on the flange and the
board stands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Arm, load_arm
from truearm.arm.rigid_motions import motion
from truearm.errors import InputError
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray
from truearm.wings.camera.boards import Board, charuco
from truearm.wings.camera.lenses import Lens
from truearm.wings.camera.observations import PixelObservations
from truearm.wings.planning.virtual.arm import VirtualArm

# The camera looks from this distance, in widths of the board.
DISTANCE_WIDTHS = 3.0
# Joints about the working pose [rad]; the last one, which only turns the view, more freely.
HALF_WIDTH_RAD, LAST_RAD = np.radians([55.0, 120.0]).tolist()
# The board is seen within this angle of its normal, and in the image by this share of its corners.
MAX_TILT_DEG, LEAST_SHARE = 60.0, 0.7
# Of nearer boards corners are not sharp, of farther ones they are few pixels apart [of the distance at work].
NEAREST, FARTHEST = 1 / 2, 5 / 3
BATCH, BATCHES = 4000, 100


@dataclass(frozen=True, eq=False)
class VirtualCell:
    """A virtual arm with a camera and a board.

    Attributes
    ----------
    virtual : VirtualArm
    lens : Lens
        The true one.
    board : Board
        As it is stated.
    scale : float
        True size of the board over the stated one.
    T_world_fixed : (4, 4) array
        Of the camera (eye to hand) or the board's middle (eye in hand) in the arm's base [mm].
    T_flange_mounted : (4, 4) array
        Of the board's middle or the camera on the nominal flange.
    is_in_hand : bool
    """

    virtual: VirtualArm
    lens: Lens
    board: Board
    scale: float
    T_world_fixed: FloatArray
    T_flange_mounted: FloatArray
    is_in_hand: bool

    @classmethod
    def around(
        cls, virtual: VirtualArm, lens: Lens, board: Board, *, in_hand: bool, seed: int, scale: float = 1.0
    ) -> VirtualCell:
        """A camera that looks at a board from `DISTANCE_WIDTHS` of it when the arm is in its working pose."""
        rng, width = np.random.default_rng([seed, 71]), max(board.size_mm)
        turn, shift, view = rng.normal(0, 0.2, 3), rng.normal(0, 0.2 * width, 3), rng.normal(0, 0.2, 3)
        shift = shift + [0.3 * width, 0, 0.3 * width]
        return cls._standing(
            virtual, lens, board, in_hand, scale, DISTANCE_WIDTHS * width, mount=(turn, shift), view=view
        )

    @classmethod
    def upright(
        cls, virtual: VirtualArm, lens: Lens, board: Board, *, in_hand: bool, distance_mm: float
    ) -> VirtualCell:
        """A camera that looks straight at a board, which is in the middle of the image in the working pose."""
        no_turn, shift = np.zeros(3), np.array([0.0, 0.0, 0.3 * max(board.size_mm)])
        return cls._standing(virtual, lens, board, in_hand, 1.0, distance_mm, mount=(no_turn, shift), view=no_turn)

    @classmethod
    def _standing(
        cls,
        virtual: VirtualArm,
        lens: Lens,
        board: Board,
        in_hand: bool,
        scale: float,
        distance_mm: float,
        *,
        mount: tuple[FloatArray, FloatArray],
        view: FloatArray,
    ) -> VirtualCell:
        mounted, camera_board = np.eye(4), np.eye(4)
        front = Rotation.from_rotvec([0.0 if in_hand else np.pi, 0.0, 0.0])  # the board's z axis points into the board
        mounted[:3, :3], mounted[:3, 3] = (front * Rotation.from_rotvec(mount[0])).as_matrix(), mount[1]
        arm = virtual.nominal
        at_work = motion(*arm.chain.with_tip(np.zeros(3)).pose(arm.working[None]))[0] @ mounted
        camera_board[:3, :3], camera_board[2, 3] = Rotation.from_rotvec(view).as_matrix(), distance_mm
        between = camera_board if in_hand else np.linalg.inv(camera_board)
        return cls(virtual, lens, board, scale, at_work @ between, mounted, in_hand)

    @property
    def middle(self) -> FloatArray:
        """(3,) Middle of the board's corners in its frame [mm]."""
        return middle_of(self.board.points)

    @property
    def _front(self) -> FloatArray:
        """(4,) Signs of the columns of a pose: the y and z axes of an AprilTag grid point up and out of the board."""
        return np.array([1.0, -1.0, -1.0, 1.0]) if self.board.kind == "aprilgrid" else np.ones(4)

    def T_camera_board(self, angles: FloatArray, motions: FloatArray | None = None) -> FloatArray:
        """(n, 4, 4) poses of the board's middle in the camera; of the nominal arm without motions."""
        flange = motion(*self.virtual.nominal.chain.with_tip(np.zeros(3)).pose(angles, motions))
        standing = np.linalg.inv(self.T_world_fixed) @ (flange @ self.T_flange_mounted)
        seen = np.linalg.inv(standing) if self.is_in_hand else standing
        return np.asarray(seen * self._front)

    def project(self, T_camera_board: FloatArray) -> FloatArray:
        """(n, 2, c) pixels of the corners; NaN where they are not in the image."""
        corners = self.scale * (self.board.points - self.middle)
        points = np.einsum("nij,cj->inc", T_camera_board[:, :3, :3], corners) + T_camera_board[:, :3, 3].T[:, :, None]
        flat = points.reshape(3, -1)
        pixels = np.where(self.lens.sees(flat), self.lens.project(flat), np.nan)
        return pixels.reshape(2, len(T_camera_board), len(corners)).transpose(1, 0, 2)

    def poses(self, n: int, *, seed: int) -> FloatArray:
        """(n, n_joints) poses within the limits, with the board in view.

        Raises
        ------
        InputError
            If there are not as many.
        """
        arm, rng = self.virtual.nominal, np.random.default_rng([seed, 72])
        half = np.full(arm.n_joints, HALF_WIDTH_RAD)
        half[-1] = LAST_RAD
        lower, upper = (np.clip(arm.working + sign * half, *arm.limits.T) for sign in (-1, 1))
        found = np.zeros((0, arm.n_joints))
        for _ in range(BATCHES):
            angles = rng.uniform(lower, upper, (BATCH, arm.n_joints))
            angles = angles[self._in_view(self.T_camera_board(angles))]
            if len(angles):  # a person sees the arm as it is
                angles = angles[self._in_view(self.T_camera_board(angles, self.virtual.motions(angles)))]
            found = np.concatenate([found, angles])
            if len(found) >= n:
                return found[:n]
        raise InputError(f"the camera sees the board in {len(found)} of {BATCH * BATCHES} poses only, {n} are needed")

    def _in_view(self, T_camera_board: FloatArray) -> BoolArray:
        sight = T_camera_board[:, :3, 3] / np.linalg.norm(T_camera_board[:, :3, 3], axis=1, keepdims=True)
        usual = float(np.linalg.norm(self.T_camera_board(self.virtual.nominal.working[None])[0, :3, 3]))
        near = (T_camera_board[:, 2, 3] > NEAREST * usual) & (T_camera_board[:, 2, 3] < FARTHEST * usual)
        faces = (sight * (T_camera_board * self._front)[:, :3, 2]).sum(axis=1)
        found: BoolArray = near & (faces > np.cos(np.radians(MAX_TILT_DEG)))
        share = (~np.isnan(self.project(T_camera_board[found])[:, 0])).mean(axis=1)
        found[found] = share >= LEAST_SHARE
        return found

    def table(self, n: int, *, seed: int, std_px: float = 0.2) -> tuple[Session, PixelObservations]:
        """Joints and corners of images at n poses, as people have them."""
        seen = self.measure(n, seed=seed, std_px=std_px)
        sizes = {"camera": (self.lens.width, self.lens.height)}
        return seen.readings, replace(table_of(seen.pixels, self.board), sizes_px=sizes)

    def measure(self, n: int, *, seed: int, std_px: float) -> Seen:
        """Images at n poses: what the arm reads, and pixels with noise."""
        measured = self.virtual.measure(self.poses(n, seed=seed), seed=seed, reference=False)
        motions = self.virtual.motions(measured.true_angles, measured.state)
        true = self.T_camera_board(measured.true_angles, motions)
        rng = np.random.default_rng([seed, 73])
        exact = self.project(true)
        return Seen(measured.readings, exact + std_px * rng.standard_normal(exact.shape), true)


@dataclass(frozen=True, eq=False)
class Seen:
    """What a virtual cell measured.

    Attributes
    ----------
    readings : Session
        Angles, temperatures and directions, without points.
    pixels : (n, 2, c) array
        [px]; NaN where a corner is not in the image.
    T_camera_board : (n, 4, 4) array
        True poses of the board's middle [mm].
    """

    readings: Session
    pixels: FloatArray
    T_camera_board: FloatArray


def table_of(pixels: FloatArray, board: Board) -> PixelObservations:
    """The table of corners of images (n, 2, c), one of every reading."""
    reading, corner = np.nonzero(~np.isnan(pixels[:, 0]))
    names = np.char.add("image ", (reading + 1).astype(np.str_))
    one = np.full(len(reading), "camera"), np.full(len(reading), board.name)
    return PixelObservations(reading + 1, names, *one, board.corners[corner], pixels[reading, :, corner])


def small_cell(name: str, *, seed: int, preset: str = "research", in_hand: bool = False) -> VirtualCell:
    """A virtual cell of an arm of the catalogue with a usual lens and a board that fits it."""
    arm = load_arm(name)
    virtual = VirtualArm.draw(arm, preset, seed=seed)
    return VirtualCell.around(virtual, working_lens(), board_for(arm), in_hand=in_hand, seed=seed)


def middle_of(points: FloatArray) -> FloatArray:
    """(3,) middle of the corners of a board: the point whose position images show best [mm]."""
    return np.asarray(points.mean(axis=0))


def working_lens(width: int = 1280, height: int = 1024, focal_px: float = 1400.0) -> Lens:
    """A usual lens with some distortion, its centre beside that of the image."""
    return Lens(
        width,
        height,
        focal_px,
        1.002 * focal_px,
        width / 2 + 7.0,
        height / 2 - 5.0,
        "brown",
        [-0.12, 0.08, 4e-4, -3e-4, 0.01],
    )


def board_for(arm: Arm) -> Board:
    """A ChArUco board of 88 corners, about a fifth of the arm's reach wide."""
    side = float(np.round(0.2 * arm.chain.reach / 12, 1))
    return charuco(12, 9, side, round(0.75 * side, 2))
