"""`plan_images`: poses at which a camera sees a board, chosen for what they tell of the arm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.atomic_write import check_new_file
from truearm.readings import Session
from truearm.readings.columns import session_columns
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.verbs.inputs import ArmLike, to_arm
from truearm.verbs.record import TableRecord
from truearm.wings.camera.boards import Board, named_board
from truearm.wings.camera.images import Images, linearise
from truearm.wings.camera.lenses import Lens, read_camera
from truearm.wings.camera.virtual_cell import DISTANCE_WIDTHS, VirtualCell, board_for, working_lens
from truearm.wings.planning.designs.candidates import Candidates
from truearm.wings.planning.designs.exchange import select_candidates
from truearm.wings.planning.designs.plan import NOISE_MM
from truearm.wings.planning.designs.planned_readings import uniform
from truearm.wings.planning.designs.prior import nominal_prior
from truearm.wings.planning.designs.proposal import VOLUME_POSES, problem_of
from truearm.wings.planning.designs.template import write_aims
from truearm.wings.planning.designs.tour import order_of_few_moves
from truearm.wings.planning.virtual import PRESETS, VirtualArm

LEAST_POSES, MOST_POSES = 6, 300
PER_POSE, FEWEST = 8, 300
# Of a corner, as detectors find it [px].
CORNER_STD_PX = 0.2


@dataclass(frozen=True, eq=False, repr=False)
class ImagePlan(TableRecord):
    """Poses for images of a board, in the order of measuring.

    Attributes
    ----------
    cell : VirtualCell
        Arm, camera and board as they are assumed to stand.
    angles : (n, n_joints) array
        To aim at [rad, or mm for sliding joints].
    noise_mm : float
        Standard deviation of a coordinate of the board in an image: of the corners, and of what no constant describes.
    before_mm, after_mm : float
        Uncertainty of a point of the workspace before and after, three-dimensional root mean square [mm].
    """

    cell: VirtualCell
    angles: FloatArray
    noise_mm: float
    before_mm: float
    after_mm: float

    @property
    def distance_mm(self) -> FloatArray:
        """(n,) distance of the board's middle from the camera [mm]."""
        return np.asarray(np.linalg.norm(self._board[:, :3, 3], axis=1))

    @property
    def tilt_rad(self) -> FloatArray:
        """(n,) angle between the line of sight and the board's normal [rad]."""
        along = (self._board[:, :3, 3] * self._board[:, :3, 2]).sum(axis=1) / self.distance_mm
        return np.asarray(np.arccos(np.clip(along, -1, 1)))

    @property
    def turned_rad(self) -> float:
        """Largest turn of the board between two images [rad]."""
        R = Rotation.from_matrix(self._board[:, :3, :3])
        return float(max((one.inv() * R).magnitude().max() for one in R))

    @property
    def _board(self) -> FloatArray:
        return self.cell.T_camera_board(self.angles)

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the session file to fill in: the joints as they are read, a row for each image.

        Raises
        ------
        InputError
            If the name does not end in .csv, or the file exists and `force` is not set.
        """
        check_new_file(path, force=force, endings=(".csv",))
        about = zip(self.distance_mm.tolist(), np.degrees(self.tilt_rad).tolist(), strict=True)
        notes = [f"image {i}: board {d:.0f} mm away, tilted by {tilt:.0f} deg" for i, (d, tilt) in enumerate(about, 1)]
        write_aims(self.cell.virtual.nominal, self.angles, path, names={}, notes=notes)

    def summary(self) -> str:
        """The answer in one sentence."""
        return (
            f"Uncertainty of a point of the workspace after {len(self.angles)} images: {self.after_mm:.3g} mm, before "
            f"{self.before_mm:.3g} mm (root mean square, up to the camera's place; noise of the board's place "
            f"{self.noise_mm:.2g} mm)."
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        low, high = self.distance_mm.min(), self.distance_mm.max()
        tilts = np.degrees([self.tilt_rad.min(), self.tilt_rad.max()])
        yield (
            f"The board is {low:.0f} to {high:.0f} mm from the camera, tilted by {tilts[0]:.0f} to {tilts[1]:.0f} deg "
            f"and turned by up to {np.degrees(self.turned_rad):.0f} deg."
        )
        start = ", ".join(
            f"{value:.0f}"
            for value in np.where(self._arm.chain.is_prismatic, self._arm.working, np.degrees(self._arm.working))
        )
        yield (
            f"Assumed: at joints {start} the board is in the middle of the image, upright to the camera. Take images "
            "where most of the board is sharp, and leave out a pose that the cell does not allow: nothing is checked."
        )

    @property
    def _arm(self) -> Arm:
        return self.cell.virtual.nominal

    def columns(self) -> dict[str, Any]:
        """See `TableRecord.columns`."""
        joints = session_columns(Session(self.angles), prismatic=self._arm.chain.is_prismatic)
        return {**joints, "distance_mm": self.distance_mm, "tilt_deg": np.degrees(self.tilt_rad)}

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "arm": self._arm.name,
            "board": self.cell.board.name,
            "eye_in_hand": self.cell.is_in_hand,
            "n": len(self.angles),
            "noise_mm": self.noise_mm,
            "before_mm": self.before_mm,
            "after_mm": self.after_mm,
            "distance_mm": self.distance_mm,
            "tilt_deg": np.degrees(self.tilt_rad),
        }


@one_blas_thread()
def plan_images(
    arm: ArmLike,
    *,
    board: str | Board | None = None,
    camera: str | Path | Lens | None = None,
    eye_in_hand: bool = False,
    poses: int = 30,
    start: npt.ArrayLike | None = None,
    distance_mm: float | None = None,
    seed: int = 0,
) -> ImagePlan:
    """Plan the poses of images that determine arm and camera: the board in view, tilted, near and far.

    Of poses in which the camera sees the board those are chosen that leave the smallest uncertainty of a point of the
    workspace (I-optimality, Fedorov's exchange; see `plan`), the constants of the arm and the camera's place being
    unknown.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm.
    board : str, optional
        Its text, see `draw_board`; by default a ChArUco board of a fifth of the arm's reach.
    camera : str, Path or Lens, optional
        Its intrinsics, a file of ROS's camera_info; by default 1280 x 1024 px with 49 deg from side to side.
    eye_in_hand : bool
        The camera is on the flange and the board stands. By default the camera stands and the board is on the flange.
    poses : int
        From 6 to 300.
    start : (n_joints,) array, optional
        Joints at which the board is in the middle of the image [rad, or mm for sliding joints]; by default the arm's
        working pose.
    distance_mm : float, optional
        Distance of the board from the camera there; by default three widths of the board.
    seed : int

    Returns
    -------
    ImagePlan

    Raises
    ------
    InputError
        If a number is out of bounds, or the camera sees the board in too few poses.

    Examples
    --------
    >>> import truearm as ta
    >>> plan = ta.plan_images("ur5", poses=20)
    >>> len(plan.angles), plan.after_mm < plan.before_mm / 2
    (20, True)
    """
    if not LEAST_POSES <= poses <= MOST_POSES:
        raise InputError(f"expected {LEAST_POSES} to {MOST_POSES} poses with a camera, got {poses}", hint="--poses 30")
    cell = _cell(to_arm(arm), board, camera, eye_in_hand, start, distance_mm)
    angles = cell.poses(max(PER_POSE * poses, FEWEST), seed=seed)
    # What stands in the reference's frame: the board's middle, or a point before the camera where the board is.
    tip = cell.T_flange_mounted[:3, 3].copy()
    if eye_in_hand:
        tip += cell.T_flange_mounted[:3, 2] * np.median(np.linalg.norm(cell.T_camera_board(angles)[:, :3, 3], axis=1))
    seen = replace(cell.virtual.nominal, chain=cell.virtual.nominal.chain.with_tip(tip))
    noise_mm = float(np.hypot(_noise_of_corners(cell, angles), NOISE_MM))
    prior = nominal_prior(seen, terms="constants", noise_mm=noise_mm).with_frame()
    volume = uniform(seen, VOLUME_POSES, seed=seed + 1).angles
    problem = problem_of(prior, Candidates(angles, np.arange(len(angles))), volume)
    chosen = select_candidates(problem, poses)
    before, after = (float(np.sqrt(problem.variance(rows))) for rows in (chosen[:0], chosen))
    return ImagePlan(cell, angles[chosen][order_of_few_moves(seen, angles[chosen])], noise_mm, before, after)


def _cell(
    arm: Arm,
    board: str | Board | None,
    camera: str | Path | Lens | None,
    eye_in_hand: bool,
    start: npt.ArrayLike | None,
    distance_mm: float | None,
) -> VirtualCell:
    """The cell without errors of the arm, its camera before the board at the start."""
    if start is not None:
        joints = np.asarray(start, dtype=float)
        if joints.shape != (arm.n_joints,) or not np.isfinite(joints).all():
            raise InputError(f"expected {arm.n_joints} finite joints at the start, got {joints.size}")
        if ((joints < arm.limits[:, 0]) | (joints > arm.limits[:, 1])).any():
            raise InputError("the joints at the start are beyond their limits", hint="--start: deg, or mm of slides")
        arm = replace(arm, working_pose=joints)
    shown = board_for(arm) if board is None else named_board(board) if isinstance(board, str) else board
    lens = camera if isinstance(camera, Lens) else working_lens() if camera is None else read_camera(camera)
    width = max(shown.size_mm)
    if distance_mm is not None and not 0.5 * width <= distance_mm <= 100 * width:
        raise InputError(
            f"expected a distance from {0.5 * width:.0f} to {100 * width:.0f} mm for a board of {width:.0f} mm, "
            f"got {distance_mm:g} mm"
        )
    virtual = VirtualArm.draw(arm, PRESETS["perfect"], seed=0)
    away = DISTANCE_WIDTHS * width if distance_mm is None else distance_mm
    return VirtualCell.upright(virtual, lens, shown, in_hand=eye_in_hand, distance_mm=away)


def _noise_of_corners(cell: VirtualCell, angles: FloatArray) -> float:
    """Root mean square uncertainty of a coordinate of the board's middle by the corners of one image [mm]."""
    T = cell.T_camera_board(angles)
    lens_is_known = np.zeros(len(cell.lens.intrinsics))
    images = Images.of_one(cell.board.points - cell.middle, cell.project(T), cell.lens, lens_is_known, 0.0)
    by_pose = linearise(images, T[:, :3, :3], T[:, :3, 3], np.zeros(0)).by_pose
    scale = np.linalg.norm(by_pose, axis=1)  # mm and rad
    by_pose /= scale[:, None]
    covariance = np.linalg.inv(by_pose.transpose(0, 2, 1) @ by_pose)
    variances = np.diagonal(covariance, axis1=1, axis2=2)[:, :3] / scale[:, :3] ** 2
    return CORNER_STD_PX * float(np.sqrt(variances.mean()))
