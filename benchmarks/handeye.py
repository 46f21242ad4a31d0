"""Hand-eye: camera and board of virtual cells, against their truth and against OpenCV."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import truearm as ta
from benchmarks.rows import RowResult, Rows, Target
from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import frame_from_xyz_rpy, inverse, motion
from truearm.typing import FloatArray
from truearm.wings.camera.closed_form import closed_form, refined
from truearm.wings.camera.hand_eye import HandEyeResult
from truearm.wings.camera.mounts import Transform, mounts, small_motion
from truearm.wings.planning.virtual import VirtualArm
from truearm.wings.planning.virtual.presets import RESEARCH, Preset

ROWS = Rows()
# Images that no fit has seen.
FRESH = 100
# Noise of a board's pose: as 88 corners with 0.2 px in a camera of 1280 x 1024 give it.
TURN_DEG, POSITION_MM = 0.05, 0.15
METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
# A research arm is turned by hand: one with gears that twist, heavier links and usual bearings.
GEARED = replace(
    RESEARCH,
    name="geared",
    joint_drive_arcsec_per_Nm=2.0,
    link_kg_per_m=5.0,
    bearing_tilt_std_arcsec=10.0,
    bearing_runout_std_um=5.0,
    nominal_mean_mm=0.0,
    nominal_max_mm=0.0,
)
MOUNTS = ("beside the robot", "on the flange")


@dataclass(frozen=True, eq=False)
class Cell:
    """Images of a virtual cell: joints, the flange by the nominal arm, the board in the camera, and the truth."""

    arm: ta.Arm
    joints: FloatArray
    flange: FloatArray
    seen: FloatArray
    exact: FloatArray
    camera: FloatArray
    board: FloatArray
    eye_in_hand: bool

    @property
    def carried(self) -> FloatArray:
        """A as in `closed_form`."""
        return inverse(self.flange) if self.eye_in_hand else self.flange


def looking(eye: FloatArray, target: FloatArray, roll: FloatArray) -> FloatArray:
    """(n, 4, 4) frames at eyes whose z axes lead to targets (n, 3), turned about them by roll (n,)."""
    z = target - eye
    z /= np.linalg.norm(z, axis=1)[:, None]
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x, axis=1)[:, None]
    R = np.stack([x, np.cross(z, x), z], axis=2) @ Rotation.from_rotvec(roll[:, None] * [0, 0, 1.0]).as_matrix()
    return motion(R, eye)


def cell(name: str, seed: int, n: int, *, eye_in_hand: bool, preset: str | Preset = "research") -> Cell:
    """A virtual arm with a camera: n images in which the board is seen, tilted up to 40 deg, and `FRESH` more."""
    rng, virtual = np.random.default_rng(seed), VirtualArm.draw(ta.load_arm(name), preset, seed=seed)
    arm, nominal = virtual.nominal, virtual.nominal.chain
    size = nominal.reach / 1500
    if eye_in_hand:
        camera = frame_from_xyz_rpy(np.array([30, -60, 90]) * size, np.radians([5, -8, 40]))
        board = frame_from_xyz_rpy(np.array([600, 150, 50]) * size, np.radians([180, 0, 30]))
    else:
        eye, middle = np.array([[1500, -300, 800]]) * size, np.array([[600, 100, 500]]) * size
        camera = looking(eye, middle, np.zeros(1))[0]
        board = frame_from_xyz_rpy(np.array([80, -40, 150]) * size, np.radians([20, -30, 70]))
    joints = np.zeros((0, arm.n_joints))
    while len(joints) < n + FRESH:
        wanted = _flanges(rng, n + FRESH, camera, board, size, eye_in_hand)
        tips = wanted[:, :3, 3] + wanted[:, :3, :3] @ nominal.tip_in_flange
        found = arm.inverse(tips, R_base_tip=wanted[:, :3, :3])
        joints = np.concatenate([joints, found.angles[found.reached]])
    joints = joints[: n + FRESH]
    plain = nominal.with_tip(np.zeros(3))
    errors = virtual.motions(joints)
    errors[:, -1] = 0.0  # of the tip, which is the board's place here
    true, by_drawing = (_frames(plain, joints, given) for given in (errors, None))
    exact = inverse(camera) @ (inverse(true) if eye_in_hand else true) @ board
    noise = np.radians(TURN_DEG) * rng.standard_normal((len(exact), 3))
    seen = exact @ motion(Rotation.from_rotvec(noise).as_matrix(), np.zeros((len(exact), 3)))
    seen[:, :3, 3] += POSITION_MM * size * rng.standard_normal((len(exact), 3))
    constant = virtual.perturbed_chain.with_constants(virtual.systematic.coefficients)
    return Cell(arm, joints, by_drawing, seen, exact, *_in_axes(constant, arm, camera, board, eye_in_hand), eye_in_hand)


def _frames(chain: Chain, joints: FloatArray, motions: FloatArray | None) -> FloatArray:
    pose = chain.pose(joints, motions)
    return motion(pose.R_base_tip, pose.tip_in_base)


def _flanges(
    rng: np.random.Generator, m: int, camera: FloatArray, board: FloatArray, size: float, eye_in_hand: bool
) -> FloatArray:
    """Flanges in the base at which the camera sees the board."""
    roll = rng.uniform(-1.5, 1.5, m)
    if eye_in_hand:
        away, around, tilt = rng.uniform(350, 700, m), rng.uniform(-np.pi, np.pi, m), rng.uniform(0.02, 0.7, m)
        target = board[:3, 3] + rng.uniform(-60, 60, (m, 3)) * [1, 1, 0] * size
        across = np.sin(tilt)[:, None] * np.stack([np.cos(around), np.sin(around), np.zeros(m)], axis=1)
        eye = target + size * away[:, None] * (across + np.cos(tilt)[:, None] * [0, 0, 1.0])
        return np.asarray(looking(eye, target, roll) @ inverse(camera))
    where = np.stack([rng.uniform(350, 900, m), rng.uniform(-400, 400, m), rng.uniform(250, 900, m)], axis=1) * size
    boards = looking(np.tile(camera[:3, 3], (m, 1)), where, roll)
    tilted = Rotation.from_rotvec(np.radians(25) * rng.standard_normal((m, 3))).as_matrix()
    return np.asarray(motion(boards[:, :3, :3] @ tilted, where) @ inverse(board))


def _in_axes(
    true: Chain, arm: ta.Arm, camera: FloatArray, board: FloatArray, eye_in_hand: bool
) -> tuple[FloatArray, FloatArray]:
    """Camera and board in the base and on the flange that readings of the true constants show."""
    standing, carried = (board, camera) if eye_in_hand else (camera, board)
    fixed = true.fixed.copy()
    fixed[0] = inverse(standing) @ fixed[0]
    fixed[-1] = fixed[-1] @ motion(carried[:3, :3], np.zeros(3))
    chain = Chain(fixed, carried[:3, :3].T @ carried[:3, 3], true.prismatic, true.coupling)
    in_base, on_flange = mounts(chain, arm.chain)
    return (on_flange, in_base) if eye_in_hand else (in_base, on_flange)


def is_within(found: Transform, true: FloatArray) -> bool:
    """Whether position and orientation are in their region of 95 %."""
    off = small_motion(found.T_parent_child, true)
    return bool(off @ np.linalg.solve(found.covariance, off) < chi2.ppf(0.95, 6))


def fresh_error(found: HandEyeResult, made: Cell, n: int) -> float:
    """Mean distance of the board from where it is predicted in the camera, in fresh images [mm]."""
    assert found.fitted is not None
    points = found.fitted.model.predict(made.joints[n:])
    seen = made.exact[n:]
    if not made.eye_in_hand:
        return float(np.linalg.norm(points - seen[:, :3, 3], axis=1).mean())
    # The tip is the point before the camera at which the boards were on average.
    used = made.seen[:n]
    centre = used[:, :3, 3].mean(axis=0)
    back = inverse(seen)
    return float(np.linalg.norm(points - back[:, :3, 3] - back[:, :3, :3] @ centre, axis=1).mean())


def alone_error(X: FloatArray, Y: FloatArray, made: Cell, n: int) -> float:
    """The same by two constant motions and the nominal arm."""
    return float(np.linalg.norm((X @ made.carried[n:] @ Y - made.exact[n:])[:, :3, 3], axis=1).mean())


def opencv_error(made: Cell, n: int) -> float:
    """The same by the best of OpenCV's `calibrateHandEye`; the board is where it is on average."""
    cv2 = import_module("cv2")
    A, C = inverse(made.carried[:n]), made.seen[:n]  # as for a camera on the flange, with the base's inverse beside it
    errors = []
    for method in METHODS:
        R, t = cv2.calibrateHandEye(
            list(A[:, :3, :3]),
            list(A[:, :3, 3]),
            list(C[:, :3, :3]),
            list(C[:, :3, 3]),
            method=getattr(cv2, f"CALIB_HAND_EYE_{method}"),
        )
        X = inverse(motion(R, t.ravel()))
        boards = A @ inverse(X) @ C
        if not (np.isfinite(boards).all() and np.linalg.det(R) > 0):
            continue
        Y = motion(Rotation.from_matrix(boards[:, :3, :3]).mean().as_matrix(), boards[:, :3, 3].mean(axis=0))
        errors.append(alone_error(X, Y, made, n))
    return min(errors)


@ROWS.row("cells", quick={"arms": 2}, is_long=True)
def cells(name: str = "ur10", arms: int = 40, images: int = 25, preset: str | Preset = "research") -> RowResult:
    """Camera and board of virtual cells: regions of 95 %, and the board's position in fresh images."""
    table, within = [], []
    for mount, eye_in_hand in zip(MOUNTS, (False, True), strict=True):
        rows = []
        for seed in range(arms):
            made = cell(name, seed, images, eye_in_hand=eye_in_hand, preset=preset)
            found = ta.hand_eye(made.seen[:images], made.joints[:images], arm=made.arm, eye_in_hand=eye_in_hand)
            A, C = made.carried[:images], made.seen[:images]
            alone = refined(A, C, closed_form(A, C, sized=False))
            off = small_motion(found.camera.T_parent_child, made.camera)
            rows.append([
                is_within(found.camera, made.camera),
                is_within(found.board, made.board),
                np.linalg.norm(off[:3]),
                found.camera.U_mm,
                np.degrees(np.linalg.norm(off[3:])),
                found.camera.U_deg,
                opencv_error(made, images),
                alone_error(alone.X, alone.Y, made, images),
                fresh_error(found, made, images),
            ])  # fmt: skip
        mean = np.mean(np.array(rows, dtype=float), axis=0)
        within.append(mean[:2])
        table.append({
            "camera": mount,
            "camera in its region [%]": 100 * mean[0],
            "board in its region [%]": 100 * mean[1],
            "camera off [mm]": mean[2],
            "U [mm]": mean[3],
            "camera off [deg]": mean[4],
            "U [deg]": mean[5],
            "OpenCV, best of five [mm]": mean[6],
            "hand-eye alone [mm]": mean[7],
            "with the arm identified [mm]": mean[8],
        })  # fmt: skip
    share = 100 * float(np.mean(within))
    return RowResult(
        table,
        [
            Target("poses of camera and board in their regions of 95 % [%], at least", share, 93.0, "above"),
            Target("the same, at most", share, 97.0),
            Target(
                "board in fresh images, over OpenCV's best",
                max(one["with the arm identified [mm]"] / one["OpenCV, best of five [mm]"] for one in table),
                0.5,
            ),
        ],
        [f"Fresh images: {FRESH} of each arm; mean distance of the board from where it is predicted."],
    )


@ROWS.row("more-images", quick={"arms": 1}, is_long=True)
def more_images(arms: int = 20, images: int = 60) -> RowResult:
    """The same with more images."""
    return cells(arms=arms, images=images)


@ROWS.row("geared", quick={"arms": 1}, is_long=True)
def geared(arms: int = 16, images: int = 25) -> RowResult:
    """The same of arms with elastic gears, heavier links and usual bearings."""
    found: RowResult = cells(arms=arms, images=images, preset=GEARED)
    return RowResult(found.table, found.targets[:1], found.notes)
