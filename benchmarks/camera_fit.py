"""Arm, camera and board from corners in images: virtual cells against their truth and against OpenCV."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import truearm as ta
from benchmarks.rows import RowResult, Rows, Target
from truearm.arm.rigid_motions import inverse, motion
from truearm.choices import ModelName
from truearm.typing import FloatArray
from truearm.wings.camera.fit_images import ImageFit
from truearm.wings.camera.images import Images, adjust, first_poses
from truearm.wings.camera.mounts import mounts, small_motion
from truearm.wings.camera.virtual_cell import Seen, VirtualCell, board_for, small_cell, table_of, working_lens
from truearm.wings.planning.virtual import VirtualArm

ROWS = Rows()
ARMS = ("ur5", "ur10", "panda", "so101")
PRESETS = {"so101": "printed"}
FRESH = 200
STD_PX = 0.2
METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
OTHERS = {
    "rms_mm": "rms [mm]",
    "p95_mm": "95 % [mm]",
    "coverage": "positions inside",
    "rms_deg": "rms [deg]",
    "p95_deg": "95 % [deg]",
    "orientation_coverage": "orientations inside",
}
MODES = {"camera beside the robot": False, "camera on the flange": True}


@dataclass(frozen=True, eq=False)
class Fitted:
    """A virtual cell, its images, and what was identified from them."""

    cell: VirtualCell
    seen: Seen
    found: ImageFit
    cpu_s: float

    @classmethod
    def of(cls, name: str, seed: int, images: int, *, in_hand: bool, model: ModelName) -> Fitted:
        """Of an arm of the catalogue; intrinsics and the board's size are free."""
        cell = small_cell(name, seed=seed, preset=PRESETS.get(name, "research"), in_hand=in_hand)
        seen = cell.measure(images, seed=100 + seed, std_px=STD_PX)
        pixels = table_of(seen.pixels, cell.board)
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = ta.fit_images(name, seen.readings, pixels, board=cell.board, eye_in_hand=in_hand, model=model)
        return cls(cell, seen, found, time.process_time() - start)

    def fresh(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """New poses (n, n_joints), true poses of the board in the camera there, and true tips (n, 3) [mm]."""
        angles = self.cell.poses(FRESH, seed=9000 + self.cell.virtual.seed)
        T = self.cell.T_camera_board(angles, self.cell.virtual.motions(angles))
        tips = (inverse(T) @ np.append(tip_in_camera(self.found), 1.0))[:, :3] if self.cell.is_in_hand else T[:, :3, 3]
        return angles, T, tips

    def true_camera(self) -> FloatArray:
        """(4, 4) The camera in the base or on the flange, in the frames of `truearm.wings.camera.mounts`."""
        cell, nominal = self.cell, self.cell.virtual.nominal.chain
        of_poses = cell.virtual.motions(self.seen.readings.angles).mean(axis=0)
        chain = nominal.with_tip(np.zeros(3)).with_motions(of_poses).with_reference_frame(inverse(cell.T_world_fixed))
        in_base, on_flange = mounts(chain, nominal)
        return on_flange @ cell.T_flange_mounted if cell.is_in_hand else in_base


def tip_in_camera(found: ImageFit) -> FloatArray:
    """(3,) The tip of a camera on the flange [mm]."""
    return found.poses.T_child_tip["camera"][:3, 3]


def left_mm(tips: FloatArray, true: FloatArray, T: FloatArray) -> float:
    """Mean distance of tips from the true ones after the best base and tip [mm]."""
    return float(left_of(tips, true, T).mean())


def left_of(tips: FloatArray, true: FloatArray, T: FloatArray) -> FloatArray:
    """(n,) distances of tips from the true ones after the best base and tip, to first order [mm]."""
    R = T[:, :3, :3]
    axes = np.stack([np.cross(axis, tips) for axis in np.eye(3)], axis=2) / 1000
    J = np.concatenate([np.tile(np.eye(3), (len(tips), 1, 1)), axes, R, R.transpose(0, 2, 1)], axis=2).reshape(-1, 12)
    y = (true - tips).ravel()
    return np.asarray(np.linalg.norm((y - J @ np.linalg.lstsq(J, y, rcond=None)[0]).reshape(-1, 3), axis=1))


@ROWS.row("arms", quick={"arms": ("ur5",), "units": 1, "images": 20})
def arms(arms: tuple[str, ...] = ARMS, units: int = 3, images: int = 60, model: str = "auto") -> RowResult:
    """Error of the arm at 200 new poses, and of the nominal arm, both with the best hand-eye; intrinsics are free."""
    table: list[dict[str, Any]] = []
    for name in arms:
        for mode, in_hand in MODES.items():
            errors, seconds, off = [], [], []
            for seed in range(1, units + 1):
                one = Fitted.of(name, seed, images, in_hand=in_hand, model=model)  # type: ignore[arg-type]
                angles, T, tips = one.fresh()
                assert one.found.fitted is not None
                assert one.found.fitted.nominal is not None
                errors.append(
                    [left_mm(of.predict(angles), tips, T) for of in (one.found.fitted.model, one.found.fitted.nominal)]
                )
                seconds.append(one.cpu_s)
                off.append(np.abs(one.found.lenses[0].fx - one.cell.lens.fx) / one.cell.lens.fx)
            identified, nominal = np.mean(errors, axis=0).tolist()
            table.append(
                {
                    "arm": name,
                    "set-up": mode,
                    "nominal [mm]": round(nominal, 3),
                    "identified [mm]": round(identified, 3),
                    "ratio": round(identified / nominal, 3),
                    "focal length off [%]": round(100 * float(np.mean(off)), 3),
                    "CPU [s]": round(float(np.median(seconds)), 2),
                }
            )
    return RowResult(table, [Target("largest ratio of an arm and a set-up", max(row["ratio"] for row in table), 0.3)])


@ROWS.row("cost", quick={"units": 1, "images": 20})
def cost(units: int = 3, images: int = 60) -> RowResult:
    """CPU time of images with free intrinsics, from the pixels to the transforms, of one model and of auto."""
    table: list[dict[str, Any]] = []
    models: tuple[ModelName, ...] = ("kinematic", "auto")
    for name in ARMS:
        median = {
            model: np.median([
                Fitted.of(name, seed, images, in_hand=in_hand, model=model).cpu_s
                for seed in range(1, units + 1)
                for in_hand in MODES.values()
            ])
            for model in models
        }  # fmt: skip
        table.append({"arm": name} | {f"{model}, median CPU [s]": round(float(s), 2) for model, s in median.items()})
    return RowResult(
        table,
        [
            Target(
                f"{images} images, intrinsics free, {model} model, CPU [s]",
                max(row[f"{model}, median CPU [s]"] for row in table),
                3.0,
            )
            for model in models
        ],
    )


@ROWS.row("coverage", quick={"units": 1, "images": 20})
def coverage(units: int = 5, images: int = 60, model: str = "kinematic") -> RowResult:
    """Truth in the stated 95 % regions: tips at 200 new poses of every arm, and the pose of the camera."""
    table, inside, cameras = [], [], []
    for name in ARMS:
        for mode, in_hand in MODES.items():
            of_tips, of_camera = [], []
            for seed in range(1, units + 1):
                one = Fitted.of(name, 20 + seed, images, in_hand=in_hand, model=model)  # type: ignore[arg-type]
                angles, _, tips = one.fresh()
                assert one.found.fitted is not None
                predicted, covariance = one.found.fitted.model.predict(angles, return_cov=True)
                off = predicted - tips
                squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
                of_tips.append(float((squares < chi2.ppf(0.95, 3)).mean()))
                camera = one.found.camera
                of_pose = small_motion(camera.T_parent_child, one.true_camera())
                of_camera.append(float(of_pose @ np.linalg.solve(camera.covariance, of_pose) < chi2.ppf(0.95, 6)))
            table.append(
                {
                    "arm": name,
                    "set-up": mode,
                    "arms": units,
                    "tips inside [%]": round(100 * float(np.mean(of_tips)), 1),
                    "camera poses inside [%]": round(100 * float(np.mean(of_camera)), 1),
                }
            )
            inside += of_tips
            cameras += of_camera
    return RowResult(
        table,
        [
            Target(f"tips in their 95 % regions, {len(inside)} arms [%]", 100 * float(np.mean(inside)), 93, "above"),
            Target(f"camera poses in theirs, {len(cameras)} arms [%]", 100 * float(np.mean(cameras)), 93, "above"),
        ],
    )


@ROWS.row("other-images", quick={"arms": ("ur5",), "units": 1, "images": 20})
def other_images(arms: tuple[str, ...] = ARMS, units: int = 3, images: int = 60, model: str = "kinematic") -> RowResult:
    """Errors of the board in as many images that are not in the fit, and the share in the stated 95 % regions."""
    table: list[dict[str, Any]] = []
    for name in arms:
        for mode, in_hand in MODES.items():
            found = []
            for seed in range(21, 21 + units):
                cell = small_cell(name, seed=seed, preset=PRESETS.get(name, "research"), in_hand=in_hand)
                session, pixels = cell.table(images, seed=seed, std_px=STD_PX)
                others = cell.table(images, seed=1000 + seed, std_px=STD_PX)
                fitted = ta.fit_images(
                    name, session, pixels, board=cell.board, eye_in_hand=in_hand, model=model, test=others
                )
                assert fitted.test is not None
                found.append(fitted.test.to_dict())
            means = {what: round(float(np.mean([one[key] for one in found])), 3) for key, what in OTHERS.items()}
            table.append({"arm": name, "set-up": mode} | means)
    return RowResult(
        table,
        [
            Target(f"{what} in their 95 % regions [%]", 100 * float(np.mean([row[key] for row in table])), 93, "above")
            for what, key in (("positions", OTHERS["coverage"]), ("orientations", OTHERS["orientation_coverage"]))
        ],
    )


@ROWS.row("distances", quick={"units": 1, "images": 20, "distances_m": (0.6,)})
def distances(
    units: int = 3, images: int = 60, model: str = "auto", distances_m: tuple[float, ...] = (0.3, 0.6, 1.0)
) -> RowResult:
    """Error of the tip by a camera beside the robot, by its resolution and how far away the board is: rms, 95 %.

    At 200 new poses within 60 deg of the working pose, in view or not, with the best base and tip; the board is a fifth
    of the arm's reach wide, with 88 corners of 0.2 px. A tracker: as many points of 0.03 mm among such poses.
    """
    table: list[dict[str, Any]] = []
    for name in ("ur5", "so101"):
        for camera, width, height in (("1.3 Mpx", 1280, 1024), ("5 Mpx", 2592, 1944)):
            lens, board = working_lens(width, height, 1400 * width / 1280), board_for(ta.load_arm(name))
            errors: dict[str, list[FloatArray]] = {}
            for seed in range(1, units + 1):
                virtual = VirtualArm.draw(ta.load_arm(name), PRESETS.get(name, "research"), seed=seed)
                angles, others = (
                    within_60_deg(virtual.nominal, FRESH, seed),
                    within_60_deg(virtual.nominal, images, -seed),
                )
                for m in distances_m:
                    cell = VirtualCell.upright(virtual, lens, board, in_hand=False, distance_mm=1000 * m)
                    session, pixels = cell.table(images, seed=100 + seed, std_px=STD_PX)
                    T = cell.T_camera_board(angles, virtual.motions(angles))
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")
                        found = ta.fit_images(name, session, pixels, board=board, model=model)  # type: ignore[arg-type]
                    assert found.fitted is not None
                    left = left_of(found.fitted.model.predict(angles), T[:, :3, 3], T)
                    errors.setdefault(f"{m:g} m [mm]", []).append(left)
                measured = virtual.measure(others, seed=seed, reference=False)
                moved = virtual.motions(measured.true_angles, measured.state)
                points = cell.T_camera_board(measured.true_angles, moved)[:, :3, 3]
                points += 0.03 * np.random.default_rng(seed).standard_normal(points.shape)
                tracked = ta.fit(name, replace(measured.readings, points=points), model=model)  # type: ignore[arg-type]
                errors.setdefault("tracker [mm]", []).append(left_of(tracked.model.predict(angles), T[:, :3, 3], T))
            table.append({"arm": name, "camera": camera} | {of: _rms_and_95(one) for of, one in errors.items()})
    return RowResult(table)


def within_60_deg(arm: ta.Arm, n: int, seed: int) -> FloatArray:
    """(n, n_joints) poses about the working pose, within the limits."""
    lower, upper = (np.clip(arm.working + sign * np.radians(60), *arm.limits.T) for sign in (-1, 1))
    return np.random.default_rng([abs(seed), int(seed > 0)]).uniform(lower, upper, (n, arm.n_joints))


def _rms_and_95(errors: list[FloatArray]) -> str:
    all_of_them = np.concatenate(errors)
    return f"{np.sqrt((all_of_them**2).mean()):.2g}, {np.quantile(all_of_them, 0.95):.2g}"


@ROWS.row("opencv", quick={"arms": ("ur5",), "units": 1, "images": 20})
def opencv(arms: tuple[str, ...] = ARMS, units: int = 3, images: int = 60, model: str = "kinematic") -> RowResult:
    """Where 60 new images see the board, against where it is predicted, mean distance; OpenCV's best of five methods.

    OpenCV: `calibrateCamera` on the same images, `solvePnP`, and `calibrateHandEye` with poses of the nominal arm; the
    best method is that with the smallest error on the new images.
    """
    table: list[dict[str, Any]] = []
    for name in arms:
        for mode, in_hand in MODES.items():
            errors = np.array([_against(name, seed, images, in_hand, model) for seed in range(1, units + 1)])
            ours, theirs = errors.mean(axis=0).tolist()
            table.append(
                {
                    "arm": name,
                    "set-up": mode,
                    "OpenCV [mm]": round(theirs, 3),
                    "truearm [mm]": round(ours, 3),
                    "ratio": round(ours / theirs, 3),
                }
            )
    return RowResult(table, [Target("largest ratio of an arm and a set-up", max(row["ratio"] for row in table), 0.5)])


def _against(name: str, seed: int, images: int, in_hand: bool, model: str) -> tuple[float, float]:
    """Mean distance of the board's position in new images from the predicted one, ours and OpenCV's [mm]."""
    one = Fitted.of(name, seed, images, in_hand=in_hand, model=model)  # type: ignore[arg-type]
    cell, found = one.cell, one.found
    angles = cell.poses(60, seed=5000 + seed)
    pixels = cell.project(cell.T_camera_board(angles, cell.virtual.motions(angles)))
    assert found.fitted is not None
    corners = found.board_scales[0] * (cell.board.points - cell.middle)
    of = Images.of_one(corners, pixels, found.lenses[0], np.zeros(9), 0.0)
    seen = adjust(of, *first_poses(of))
    tips = found.fitted.model.predict(angles)
    if in_hand:  # the tip is a point before the camera, in the board
        points = (seen.R.transpose(0, 2, 1) @ (tip_in_camera(found) - seen.t)[:, :, None])[:, :, 0]
    else:
        points = seen.t
    ours = float(np.linalg.norm(tips - points, axis=1).mean())
    return ours, _of_opencv(one, angles, pixels)


def _of_opencv(one: Fitted, angles: FloatArray, pixels: FloatArray) -> float:
    cv2 = import_module("cv2")
    cell, corners = one.cell, (one.cell.board.points - one.cell.middle).astype(np.float32)
    pairs = [(corners[known], image.T[known].astype(np.float32)) for image, known in _known(one.seen.pixels)]
    _, K, D, rotations, translations = cv2.calibrateCamera(*zip(*pairs, strict=True), (1280, 1024), None, None)
    C = motion(Rotation.from_rotvec(np.array(rotations)[:, :, 0]).as_matrix(), np.array(translations)[:, :, 0])
    chain = cell.virtual.nominal.chain.with_tip(np.zeros(3))
    F, new = (motion(*chain.pose(joints)) for joints in (one.seen.readings.angles, angles))
    A, of_new = (F, new) if cell.is_in_hand else (inverse(F), inverse(new))
    seen = []
    for image, known in _known(pixels):
        _, r, t = cv2.solvePnP(corners[known], image.T[known].astype(np.float64), K, D)
        seen.append(motion(Rotation.from_rotvec(r[:, 0]).as_matrix(), t[:, 0]))
    best = np.inf
    for method in METHODS:
        R, t = cv2.calibrateHandEye(
            A[:, :3, :3], A[:, :3, 3], C[:, :3, :3], C[:, :3, 3], method=getattr(cv2, f"CALIB_HAND_EYE_{method}")
        )
        if not np.isfinite(R).all():
            continue
        X = motion(R, t[:, 0])
        board = A @ X @ C
        mean = motion(Rotation.from_matrix(board[:, :3, :3]).mean().as_matrix(), board[:, :3, 3].mean(axis=0))
        predicted = inverse(of_new @ X) @ mean
        best = min(best, float(np.linalg.norm((predicted - np.array(seen))[:, :3, 3], axis=1).mean()))
    return best


def _known(pixels: FloatArray) -> list[tuple[FloatArray, Any]]:
    return [(image, ~np.isnan(image[0])) for image in pixels]
