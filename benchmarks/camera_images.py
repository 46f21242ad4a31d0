"""Corners in rendered images: how far they are from the true ones, how long they take, and what an arm loses by it."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import truearm as ta
from benchmarks.camera_fit import left_mm
from benchmarks.rows import RowResult, Rows, Target
from truearm.typing import FloatArray
from truearm.wings.camera.boards import Board, parse_board
from truearm.wings.camera.detection import Detector, Image
from truearm.wings.camera.image_files import read_image
from truearm.wings.camera.patterns import opencv, opencv_dictionary
from truearm.wings.camera.simulate_images import ImageSimulation
from truearm.wings.camera.virtual_cell import table_of

ROWS = Rows()
BOARDS = ("charuco:12x9,20mm,15mm", "chessboard:11x8,20mm", "aprilgrid:6x4,32mm,9.6mm")
# Blur [px] and noise [grey values] of a good camera, a usual one, and a poor one.
CAMERAS = {"good": (0.5, 1.0), "usual": (0.7, 2.0), "poor": (1.2, 5.0)}


def rendered(made: ImageSimulation) -> list[Image]:
    """The images of a simulation, by way of its files."""
    with tempfile.TemporaryDirectory() as folder:
        made.save(Path(folder, "joints.csv"))
        return [read_image(Path(folder, "joints-images", name)) for name in made.image_names()]


def theirs(board: Board, image: Image) -> tuple[Any, FloatArray]:
    """Corners of OpenCV alone: `detectBoard`, `findChessboardCornersSB`, `detectMarkers` with its refinement."""
    cv2 = opencv()
    if board.kind == "charuco":
        dictionary = opencv_dictionary(board.dictionary)
        of = cv2.aruco.CharucoBoard((board.across, board.down), board.side_mm, board.marker_mm, dictionary)
        pixels, corners, _, _ = cv2.aruco.CharucoDetector(of).detectBoard(image)
        return ([], np.zeros((0, 2))) if corners is None else (corners.ravel(), pixels.reshape(-1, 2))
    if board.kind == "chessboard":
        found, pixels = cv2.findChessboardCornersSB(image, (board.across, board.down))
        return (board.corners, pixels.reshape(-1, 2)) if found else ([], np.zeros((0, 2)))
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    tags, numbers, _ = cv2.aruco.ArucoDetector(opencv_dictionary(board.dictionary), settings).detectMarkers(image)
    if numbers is None:
        return [], np.zeros((0, 2))
    return (4 * numbers + np.arange(4)).ravel(), np.array(tags).reshape(-1, 4, 2)[:, ::-1].reshape(-1, 2)


def rms_px(errors: list[FloatArray]) -> float:
    """Root mean square of a coordinate."""
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) if errors else float("nan")


@ROWS.row("corners", quick={"images": 3, "boards": BOARDS[:1], "cameras": ("usual",)})
def corners(
    boards: tuple[str, ...] = BOARDS, cameras: tuple[str, ...] = tuple(CAMERAS), images: int = 20, arm: str = "ur5"
) -> RowResult:
    """Corners in rendered images of 1280 x 1024 px against the true ones, and those of OpenCV alone in them."""
    table: list[dict[str, Any]] = []
    opencv().setNumThreads(1)
    for text in boards:
        for camera in cameras:
            blur, noise = CAMERAS[camera]
            made = ta.simulate_images(arm, poses=images, board=text, seed=3, blur_px=blur, noise=noise)
            exact = made.cell.project(made.seen.T_camera_board)
            detector, ours, others, seconds = Detector(parse_board(text)), [], [], []
            for pixels, image in zip(exact, rendered(made), strict=True):
                start = time.process_time()
                found = detector.find(image)
                seconds.append(time.process_time() - start)
                ours.append(found.pixels - pixels[:, found.corners].T)
                numbers, of_opencv = theirs(made.board, image)
                far = of_opencv - pixels[:, np.asarray(numbers, dtype=int)].T
                if made.board.kind == "chessboard" and len(far):  # it may begin at either end
                    far = min(far, of_opencv[::-1] - pixels.T, key=lambda one: float(np.abs(one).sum()))
                others.append(far)
            whole = np.concatenate(ours)
            n_far = int((np.abs(whole) > 0.5).any(axis=1).sum())
            table.append(
                {
                    "board": text.partition(":")[0],
                    "camera": f"{camera}: blur {blur:g} px, noise {noise:g}",
                    "images found": f"{sum(len(one) > 0 for one in ours)} of {images}",
                    "corners": len(whole),
                    "rms [px]": round(rms_px(ours), 3),
                    "over 0.5 px": n_far,
                    "OpenCV rms [px]": round(rms_px(others), 3),
                    "CPU an image [s]": round(float(np.median(seconds)), 3),
                }
            )
    return RowResult(
        table,
        [
            Target(
                "largest rms of a coordinate, ChArUco [px]",
                max(r["rms [px]"] for r in table if r["board"] == "charuco"),
                0.1,
            ),
            Target("CPU of an image of 1280 x 1024 px [s]", max(row["CPU an image [s]"] for row in table), 0.15),
        ],
    )


@ROWS.row("chain", quick={"images": 12, "model": "kinematic"})
def chain(arm: str = "ur5", images: int = 60, units: int = 2, model: str = "kinematic") -> RowResult:
    """Arm and camera from rendered images, and from the true corners with as much noise as the detector has.

    The error is that of the arm at 200 new poses with the best base and tip.
    """
    table = []
    for seed in range(1, units + 1):
        made = ta.simulate_images(arm, poses=images, seed=seed, arm_seed=seed)
        cell = made.cell
        with tempfile.TemporaryDirectory() as folder:
            made.save(Path(folder, "joints.csv"))
            found = ta.find_corners(Path(folder, "joints.csv"), Path(folder, "joints-images"), board=made.board)
        exact = table_of(cell.project(made.seen.T_camera_board), made.board)
        true = {(r, c): p for r, c, p in zip(exact.reading.tolist(), exact.corner.tolist(), exact.pixels, strict=True)}
        pairs = zip(found.pixels.reading.tolist(), found.pixels.corner.tolist(), found.pixels.pixels, strict=True)
        errors = np.array([p - true[r, c] for r, c, p in pairs if (r, c) in true])
        std = float(1.4826 * np.median(np.abs(errors)))
        rng = np.random.default_rng(seed)
        noisy = cell.project(made.seen.T_camera_board)
        noisy = noisy + std * rng.standard_normal(noisy.shape)
        angles = cell.poses(200, seed=9000 + seed)
        T = cell.T_camera_board(angles, cell.virtual.motions(angles))
        row: dict[str, Any] = {
            "unit": seed,
            "images": found.n_found,
            "corners": len(found.pixels),
            "noise [px]": round(std, 4),
        }
        for what, pixels in (("true corners", table_of(noisy, made.board)), ("rendered", found.pixels)):
            fitted = ta.fit_images(arm, made.session, pixels, board=made.board, model=model)  # type: ignore[arg-type]
            assert fitted.fitted is not None
            row[f"{what} [mm]"] = round(left_mm(fitted.fitted.model.predict(angles), T[:, :3, 3], T), 4)
        table.append(row)
    of = [np.mean([row[f"{what} [mm]"] for row in table]) for what in ("true corners", "rendered")]
    return RowResult(table, [Target("error by rendered images over that by true corners", float(of[1] / of[0]), 1.1)])
