"""`find_corners`: the corners of a board in the images that belong to readings of an arm."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from truearm.errors import InputError
from truearm.identification.references.prepared_readings import MIN_ROWS
from truearm.verbs.inputs import SessionLike, to_session
from truearm.verbs.outputs import check_output
from truearm.verbs.record import Record, number_of
from truearm.wings.camera.boards import Board, named_board
from truearm.wings.camera.detection import Detection, Detector, Image, SeenImage
from truearm.wings.camera.image_files import images_of_readings, list_images, read_image
from truearm.wings.camera.lenses import Lens, read_camera
from truearm.wings.camera.observations import PixelObservations

if TYPE_CHECKING:
    from truearm.pages.page import Page
    from truearm.wings.camera.images import Adjustment

# Images that the text lists with their problem.
LISTED = 5
# Width of the small images of the page [px].
THUMBNAIL_PX = 256


@dataclass(frozen=True, eq=False, repr=False)
class CornersResult(Record):
    """Corners of a board in images.

    Attributes
    ----------
    board : Board
    images : tuple of SeenImage
        One for each reading that has an image.
    size_px : (int, int)
        Width and height of the images.
    camera : Lens or None
        As stated.
    remarks : tuple of str
        What was assumed.
    camera_name : str
        In the table.
    """

    board: Board
    images: tuple[SeenImage, ...]
    size_px: tuple[int, int]
    camera: Lens | None
    remarks: tuple[str, ...]
    camera_name: str = "camera"

    @cached_property
    def pixels(self) -> PixelObservations:
        """The table of all corners."""
        parts = [
            PixelObservations(
                np.full(n, image.reading),
                np.full(n, image.name),
                np.full(n, self.camera_name),
                np.full(n, self.board.name),
                image.detection.corners,
                image.detection.pixels,
                sizes_px={self.camera_name: self.size_px},
            )
            for image in self.images
            if (n := len(image.detection))
        ]
        return PixelObservations.joined(parts)

    @property
    def n_found(self) -> int:
        """Number of images that show the board."""
        return sum(len(image.detection) > 0 for image in self.images)

    @property
    def u_px(self) -> float:
        """Median standard uncertainty of a coordinate of a corner by the noise of the images [px]."""
        return float(np.median(np.concatenate([image.detection.u_px for image in self.images])))

    @cached_property
    def adjusted(self) -> Adjustment | None:
        """Poses of the board and the camera, by the corners alone; None where they do not determine the camera."""
        from truearm.wings.camera.images import Images, adjust, first_poses, guess_lens

        corners = self.board.points - self.board.points.mean(axis=0)
        found = [image for image in self.images if len(image.detection)]
        pixels = np.full((len(found), 2, len(self.board)), np.nan)
        for i, image in enumerate(found):
            pixels[i][:, np.searchsorted(self.board.corners, image.detection.corners)] = image.detection.pixels.T
        try:
            lens = self.camera or guess_lens(corners, pixels, self.size_px)
            u = np.full(len(lens.intrinsics), np.inf)
            images = Images.of_one(corners, pixels, lens, u, self.board.u_scale)
            return adjust(images, *first_poses(images))
        except InputError:
            return None

    def save(self, path: str | Path) -> None:
        """Write the table of pixels; it appears whole or not at all."""
        self.pixels.save(path)

    def save_page(self, path: str | Path) -> None:
        """Write a page that shows the images with their corners and residuals."""
        from truearm.pages.html import write_page

        write_page(self.page(), path)

    def page(self) -> Page:
        """The page that `save_page` writes."""
        from truearm.wings.camera.corners_page import corners_page

        return corners_page(
            self.images,
            self.adjusted,
            board=self.board.name,
            size_px=self.size_px,
            said=self.summary(),
            assumed=self.remarks,
        )

    def summary(self) -> str:
        """The answer in one sentence: how many corners in how many images."""
        n = number_of(len(self.pixels), "corner")
        return f"{n} of board {self.board.name} in {self.n_found} of {number_of(len(self.images), 'image')}."

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        if self.adjusted is not None:
            yield (
                f"They scatter by {self.adjusted.std_px[0]:.3f} px about the poses of the board that fit best; the "
                f"noise of the images explains {self.u_px:.3f} px."
            )
        else:
            yield f"By the noise of the images a coordinate has a standard uncertainty of {self.u_px:.3f} px."
        yield from self.remarks
        if self.board.has_two_readings:
            yield (
                f"Half a turn maps board {self.board.name} onto itself: an image does not tell which is which. Use a "
                "chessboard with one side odd and one even, or a ChArUco board."
            )
        partial = sum(0 < len(image.detection) < len(self.board) for image in self.images)
        if partial:
            yield f"{partial} of these images show{'s' * (partial == 1)} a part of the board only."
        missed = [image for image in self.images if image.detection.problem]
        for image in missed[:LISTED]:
            yield f"{image.name} (reading {image.reading}) is not used: {image.detection.problem}."
        if len(missed) > LISTED:
            yield f"{number_of(len(missed) - LISTED, 'image')} more are not used."

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "board": self.board.name,
            "size_px": self.size_px,
            "n": len(self.pixels),
            **self._named("n_found", "u_px", "remarks"),
            "std_px": None if self.adjusted is None else float(self.adjusted.std_px[0]),
            "images": [
                {
                    "reading": image.reading,
                    "image": image.name,
                    "corners": len(image.detection),
                    "problem": image.detection.problem or None,
                }
                for image in self.images
            ],
        }


def find_corners(
    session: SessionLike,
    images: str | Path,
    *,
    board: str | Board,
    camera: str | Path | Lens | None = None,
    camera_name: str = "camera",
    progress: Callable[[int, str], None] | None = None,
) -> CornersResult:
    """Find the corners of a board in the images that belong to the readings of an arm.

    Parameters
    ----------
    session : Session, DataFrame, str or Path
        The joint angles, a row for each image. In a CSV file the column ``note_image`` has the names of the images;
        without it, image k in the order of their names belongs to row k.
    images : path
        Folder with the images: PNG, JPEG, BMP, TIFF or PGM, all of one camera.
    board : str
        Its text, as ``charuco:8x11,15mm,11mm``, or ``NAME=TEXT``: what the table calls it; see `draw_board`.
    camera : path, optional
        The camera's intrinsics (camera_info of ROS, .yaml); they are not needed to find corners, and checked.
    camera_name : str
        What the table calls the camera, where there are several.
    progress : callable, optional
        Called with the number of images that are done and a note.

    Returns
    -------
    CornersResult

    Raises
    ------
    InputError
        If images and readings do not go together, the images have several sizes or another than the camera's, or fewer
        than four show the board.

    Examples
    --------
    >>> import truearm as ta
    >>> cell = ta.simulate_images("ur5", poses=4, board="charuco:7x6,40mm,30mm", size_px=(640, 512))
    >>> cell.save("joints.csv")
    >>> found = ta.find_corners("joints.csv", "joints-images", board=cell.board)
    >>> found.n_found
    4
    """
    board = named_board(board) if isinstance(board, str) else board
    lens = read_camera(camera) if isinstance(camera, str | Path) else camera
    detector = Detector(board)
    paired, assumed = images_of_readings(session, list_images(images), len(to_session(session)))
    seen: list[SeenImage] = []
    size: tuple[int, int] | None = None
    for number, path in enumerate(paired, start=1):
        if path is None:
            continue
        image = read_image(path)
        width, height = image.shape[1], image.shape[0]
        if size is not None and size != (width, height):
            raise InputError(
                f"the image is {width} x {height} px, those before {size[0]} x {size[1]} px",
                file=path,
                hint="images of one camera at one resolution, uncropped",
            )
        if lens is not None and (lens.width, lens.height) != (width, height):
            raise InputError(
                f"the image is {width} x {height} px, the camera's file is of {lens.width} x {lens.height} px",
                file=path,
                hint="the intrinsics of this resolution, or none: truearm fit-images finds them",
            )
        size = width, height
        shrink = max(1, int(np.ceil(width / THUMBNAIL_PX)))
        seen.append(SeenImage(number, path.name, detector.find(image), _reduced(image, shrink), shrink))
        if progress is not None:
            progress(len(seen), path.name)
    if size is None:
        raise InputError("no reading has an image", file=images)
    remarks = [assumed] if assumed else []
    seen, same = _same_variant(seen)
    if same:
        remarks.append(f"The board is another variant: {same}.")
    if (n := sum(len(one.detection) > 0 for one in seen)) < MIN_ROWS:
        why = next((f": {one.name}, {one.detection.problem}" for one in seen if one.detection.problem), "")
        raise InputError(f"{number_of(n, 'image')} of {len(seen)} show board {board.name}, expected {MIN_ROWS}{why}")
    return CornersResult(board, tuple(seen), size, lens, tuple(remarks), camera_name)


def _reduced(image: Image, k: int) -> Image:
    """The image with the mean of each k x k pixels in their place."""
    rows, columns = (n // k for n in image.shape)
    means = image[: rows * k, : columns * k].reshape(rows, k, columns, k).mean(axis=(1, 3))
    return np.asarray(means, dtype=np.uint8)


def _same_variant(seen: list[SeenImage]) -> tuple[list[SeenImage], str]:
    """The images with one variant of the board, that of most of them, and its name."""
    names = [one.detection.variant for one in seen if len(one.detection)]
    most = max(set(names), key=names.count, default="")
    other = Detection(problem="it shows another variant of the board than most images")
    is_other = [len(one.detection) > 0 and one.detection.variant != most for one in seen]
    return [replace(one, detection=other) if bad else one for one, bad in zip(seen, is_other, strict=True)], most


def check_corners_output(out: Path, page: Path | None, *inputs: str | Path | None) -> None:
    """Check, before long work, that the table and the page can be written and replace nothing that is read."""
    from truearm.wings.camera.observations import read_pixels

    check_output(out, *inputs, endings=(".csv",), read=read_pixels)
    if page is not None:
        check_output(page, *inputs, endings=(".html",))
