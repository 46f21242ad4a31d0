"""`simulate_images`: images of a board and joint angles, of a virtual arm with a camera."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file, check_new_file
from truearm.readings import Session, write_session
from truearm.typing import FloatArray, IntArray
from truearm.verbs.inputs import ArmLike, to_arm
from truearm.verbs.record import Record, number_of
from truearm.wings.camera.boards import Board, named_board
from truearm.wings.camera.image_files import COLUMN
from truearm.wings.camera.lenses import Lens
from truearm.wings.camera.patterns import Pattern, pattern_of
from truearm.wings.camera.virtual_cell import Seen, VirtualCell, board_for, working_lens
from truearm.wings.planning.virtual.arm import VirtualArm

MOST_POSES = 1000
# Focal length over the width of the image: 50 deg from side to side.
FOCAL_SHARE = 1.09375
# Places along each side of a pixel, at which the pattern is looked up.
ALONG = 4
# Grey values of ink, paper and what is behind the board.
INK, PAPER, BEHIND = 30.0, 215.0, 120.0
# White paper around the pattern [mm].
MARGIN_MM = 10.0
# Of a usual industrial camera: standard deviations of blur [px] and noise [grey values].
BLUR_PX, NOISE = 0.7, 2.0
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False, repr=False)
class ImageSimulation(Record):
    """Images of a board that a virtual arm moves before a camera, or a camera before a board.

    Attributes
    ----------
    cell : VirtualCell
        Arm, camera and board, with what nobody can know of real ones.
    seen : Seen
        Joint angles, and the true poses of the board.
    seed : int
    blur_px, noise : float
        Of the images: standard deviations of blur [px] and noise [grey values].
    """

    cell: VirtualCell
    seen: Seen
    seed: int
    blur_px: float
    noise: float

    @property
    def session(self) -> Session:
        """The joint angles that a user of the arm gets."""
        return self.seen.readings

    @property
    def board(self) -> Board:
        """The board, as it is stated."""
        return self.cell.board

    def image_names(self) -> list[str]:
        """Names of the images, one for each reading."""
        n = len(self.session)
        return [f"image_{number:0{len(str(n))}d}.png" for number in range(1, n + 1)]

    def save(self, path: str | Path, *, progress: Callable[[int, str], None] | None = None) -> None:
        """Write the joint angles to `path`, and the images to a folder beside it: joints.csv, joints-images.

        Both appear whole or not at all.

        Raises
        ------
        InputError
            If the name does not end in .csv, the folder exists, or something cannot be written.
        """
        from PIL import Image

        path = Path(path)
        folder = images_folder(path)
        check_images_folder(path)
        renderer = Renderer(pattern_of(self.board), self.cell.lens, self.blur_px, self.noise)
        with TemporaryDirectory(prefix=".truearm-part-", dir=folder.parent) as beside:
            made = Path(beside, "images")
            made.mkdir()
            for i, (name, T) in enumerate(zip(self.image_names(), self._board_poses(), strict=True)):
                image = renderer.image(T, seed=self.seed + 1_000_003 * i, scale=self.cell.scale)
                Image.fromarray(image).save(made / name, compress_level=1)  # noise hardly compresses
                if progress is not None:
                    progress(i + 1, name)
            with atomic_file(path) as table:
                self._write_joints(table)
                os.replace(made, folder)

    def summary(self) -> str:
        """The answer in one sentence: how many images of which arm and board."""
        virtual = self.cell.virtual
        where = "on the flange" if self.cell.is_in_hand else "beside the arm"
        return (
            f"{number_of(len(self.session), 'image')} of board {self.board.name} by a camera {where}: virtual arm "
            f"{virtual.nominal.name}, preset {virtual.preset.name}, arm seed {virtual.seed}."
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        lens = self.cell.lens
        yield f"The camera has {lens.width} x {lens.height} px and a focal length of {lens.fx:.0f} px."

    def _json(self) -> object:
        lens = self.cell.lens
        return {
            "summary": self.summary(),
            "arm": self.cell.virtual.nominal.name,
            "preset": self.cell.virtual.preset.name,
            "arm_seed": self.cell.virtual.seed,
            "seed": self.seed,
            "n": len(self.session),
            "board": self.board.name,
            "eye_in_hand": self.cell.is_in_hand,
            "true_intrinsics": dict(zip(lens.names, lens.intrinsics.tolist(), strict=True)),
        }

    def _board_poses(self) -> Iterator[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
        """True poses of the board's own frame in the camera; the cell has those of its middle."""
        for T in self.seen.T_camera_board:
            own = T.copy()
            own[:3, 3] -= self.cell.scale * T[:3, :3] @ self.cell.middle
            yield own

    def _write_joints(self, path: Path) -> None:
        """The session with the name of each reading's image as a note."""
        write_session(self.session, path)
        rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        for row, name in zip(rows, [COLUMN, *self.image_names()], strict=True):
            writer.writerow([*row, name])
        path.write_text(out.getvalue(), encoding="utf-8")


def images_folder(path: Path) -> Path:
    """Where the images are written whose joint angles are in `path`."""
    return path.with_name(f"{path.stem}-images")


def check_images_folder(path: Path) -> None:
    """Check, before long work, that joints and images can be written.

    Raises
    ------
    InputError
        If the name does not end in .csv, or the folder of the images exists.
    """
    if path.suffix.lower() != ".csv":
        raise InputError(f"expected a file name that ends in .csv, got {path.name!r}", file=path)
    folder = images_folder(path)
    if folder.exists():
        raise InputError("the folder of the images exists already", file=folder, hint="another name for --out")


def simulate_images(
    arm: ArmLike,
    *,
    poses: int = 60,
    board: str | Board | None = None,
    eye_in_hand: bool = False,
    preset: str = "research",
    seed: int = 0,
    arm_seed: int = 0,
    size_px: tuple[int, int] = (1280, 1024),
    blur_px: float = BLUR_PX,
    noise: float = NOISE,
) -> ImageSimulation:
    """Measure with a virtual arm and a camera, whose errors are known.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm: an `Arm`, a name of `list_arms`, or an arm file or URDF.
    poses : int
        Number of poses, an image each, in which the camera sees most of the board.
    board : str, optional
        Its text, see `draw_board`; by default a ChArUco board of 88 corners, a fifth of the arm's reach wide.
    eye_in_hand : bool
        The camera is on the flange and the board stands. By default the camera stands and the board is on the flange.
    preset : {"research", "shop", "worn", "printed", "perfect"}
        How large the errors of the arm are.
    seed : int
        Of the poses, of where camera and board are, and of the noise.
    arm_seed : int
        Seed of the arm's errors: same seed, same arm.
    size_px : (int, int)
        Width and height of the images.
    blur_px, noise : float
        Standard deviations of the blur [px] and of the noise [grey values] of the images.

    Returns
    -------
    ImageSimulation

    Raises
    ------
    InputError
        If the camera sees the board in too few poses, or the board cannot be drawn.

    Examples
    --------
    >>> import truearm as ta
    >>> cell = ta.simulate_images("ur5", poses=3, size_px=(640, 512))
    >>> cell.save("joints.csv")
    >>> cell.image_names()
    ['image_1.png', 'image_2.png', 'image_3.png']
    """
    if not 1 <= poses <= MOST_POSES:
        raise InputError(f"expected 1 to {MOST_POSES} poses with a camera, got {poses}", hint="--poses 60")
    nominal = to_arm(arm)
    shown = board_for(nominal) if board is None else named_board(board) if isinstance(board, str) else board
    pattern_of(shown)  # refuses what cannot be drawn, before long work
    lens = working_lens(*size_px, FOCAL_SHARE * size_px[0])
    virtual = VirtualArm.draw(nominal, preset, seed=arm_seed)
    cell = VirtualCell.around(virtual, lens, shown, in_hand=eye_in_hand, seed=seed)
    return ImageSimulation(cell, cell.measure(poses, seed=seed, std_px=0.0), seed, blur_px, noise)


def write_simulation(
    arm: str,
    out: Path,
    *,
    instrument: str,
    force: bool,
    progress: Callable[[int, str], None],
    poses: int | None = None,
    **options: object,
) -> tuple[ImageSimulation, dict[str, Path]]:
    """What ``truearm simulate --instrument`` does with a camera: the record, and what was written.

    Parameters
    ----------
    instrument : {"camera", "camera-in-hand"}
    poses : int, optional
        As of `simulate_images`.
    """
    check_images_folder(out)
    check_new_file(out, force=force)
    given = options if poses is None else {"poses": poses, **options}
    made = simulate_images(arm, eye_in_hand=instrument == "camera-in-hand", **given)  # type: ignore[arg-type]
    made.save(out, progress=progress)
    return made, {"joints": out, "images": images_folder(out)}


@dataclass(frozen=True, eq=False)
class Renderer:
    """Images of a pattern through a camera.

    Attributes
    ----------
    pattern : Pattern
    lens : Lens
    blur_px : float
        Standard deviation of the blur [px].
    noise : float
        Standard deviation of the noise [grey values].
    """

    pattern: Pattern
    lens: Lens
    blur_px: float = BLUR_PX
    noise: float = NOISE

    def image(self, T_camera_board: FloatArray, *, seed: int, scale: float = 1.0) -> Image:
        """The image (height, width) of the board at a pose (4, 4) in the camera [mm].

        Parameters
        ----------
        T_camera_board : (4, 4) array
            Of the board's own frame.
        seed : int
            Of the noise.
        scale : float
            True size of the board over the stated one.
        """
        from scipy.ndimage import gaussian_filter

        exact = np.full((self.lens.height, self.lens.width), BEHIND)
        T = T_camera_board
        back = np.linalg.inv(np.column_stack([scale * T[:3, 0], scale * T[:3, 1], T[:3, 3]]))
        rows, columns = self._box(T, scale)
        directions, by_u, by_v = (part[:, rows, columns] for part in self._directions)
        if directions.size:
            offsets, greys = (np.arange(ALONG) + 0.5) / ALONG - 0.5, self._cells[2]
            first, *others = (
                self._cell(back, directions + du * by_u + dv * by_v)
                for du in offsets[[0, -1]]
                for dv in offsets[[0, -1]]
            )
            mean = greys[first]
            mixed = np.logical_or.reduce([one != first for one in others])
            directions, by_u, by_v = directions[:, mixed], by_u[:, mixed], by_v[:, mixed]
            places = (directions + du * by_u + dv * by_v for du in offsets for dv in offsets)
            mean[mixed] = sum(greys[self._cell(back, place)] for place in places) / ALONG**2
            exact[rows, columns] = mean
        blurred = gaussian_filter(exact, self.blur_px, mode="nearest") if self.blur_px > 0 else exact
        noise = self.noise * np.random.default_rng([seed, *b"image"]).standard_normal(exact.shape)
        return np.clip(np.round(blurred + noise), 0, 255).astype(np.uint8)

    @cached_property
    def _cells(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Edges of the paper and its pattern along x and y [mm], and the grey values of the cells, in one row."""
        x, y = (
            np.concatenate([[-MARGIN_MM], edges, [size + MARGIN_MM]])
            for edges, size in zip(self.pattern.edges, self.pattern.size_mm, strict=True)
        )
        greys = np.full((len(y) + 1, len(x) + 1), BEHIND)
        middles = np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2)
        greys[1:-1, 1:-1] = np.where(self.pattern.is_black(*middles), INK, PAPER)
        return x, y, greys.ravel()

    def _cell(self, back: FloatArray, directions: FloatArray) -> IntArray:
        """Cells of the sheet in directions (2, ..), -1 where no board is; `back` maps (x, y, 1) to its plane."""
        u, v, w = (row[0] * directions[0] + row[1] * directions[1] + row[2] for row in back)
        with np.errstate(divide="ignore", invalid="ignore"):
            on_board = np.stack([u / w, v / w])
        sx, sy = self.pattern.on_sheet(on_board.reshape(2, -1)).reshape(on_board.shape)
        x, y, _ = self._cells
        found = np.searchsorted(y, sy) * (len(x) + 1) + np.searchsorted(x, sx)
        return np.where(w > 0, found, -1)  # the last cell is no paper either

    def _box(self, T: FloatArray, scale: float) -> tuple[slice, slice]:
        """Rows and columns of the image that may show the sheet: all of them if a part of it is behind the camera."""
        lens, (width, height) = self.lens, self.pattern.size_mm
        low, high = -MARGIN_MM, np.array([width, height]) + MARGIN_MM
        share = np.linspace(0, 1, 30)
        sides = [np.stack([low + share * (high[0] - low), np.full(30, y)]) for y in (low, high[1])]
        sides += [np.stack([np.full(30, x), low + share * (high[1] - low)]) for x in (low, high[0])]
        sheet = np.concatenate(sides, axis=1) - self.pattern.origin_mm[:, None]
        sheet[1] *= -1 if self.pattern.y_is_up else 1
        points = T[:3, :2] @ (scale * sheet) + T[:3, 3:4]
        pixels = lens.project(points)
        if np.isnan(pixels).any():
            return slice(0, lens.height), slice(0, lens.width)
        first, last = np.floor(pixels.min(axis=1)) - 10, np.ceil(pixels.max(axis=1)) + 11
        (left, top), (right, bottom) = (
            np.clip(e, 0, [lens.width, lens.height]).astype(int).tolist() for e in (first, last)
        )
        return slice(top, bottom), slice(left, right)

    @cached_property
    def _directions(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Directions (2, height, width) of the pixels, and what they change by from a pixel to the next."""
        v, u = np.mgrid[: self.lens.height, : self.lens.width].astype(float)
        found = self.lens.normalized(np.stack([u.ravel(), v.ravel()])).reshape(2, *u.shape)
        by_v, by_u = (np.asarray(np.gradient(found, axis=axis)) for axis in (1, 2))
        return found, by_u, by_v
