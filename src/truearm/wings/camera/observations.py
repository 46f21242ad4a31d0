"""Corners of boards in images, and their table: reading, image, camera, board, corner, u_px, v_px."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import MAX_BYTES, check_names, quoted_cell, read_columns, read_form, write_columns
from truearm.files.file_reading import check_readable
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray
from truearm.wings.camera.boards import whole_numbers
from truearm.wings.camera.lenses import LARGEST_PX

NUMBERS = ("reading", "corner", "u_px", "v_px")
SIZE = ("width_px", "height_px")
NAMES = ("image", "camera", "board")
FIELDS = ("reading", *NAMES, "corner", "pixels")


@dataclass(frozen=True, eq=False)
class PixelObservations:
    """Corners of boards as cameras saw them, a row each.

    Attributes
    ----------
    reading : (n,) int array
        Number of the reading in the session, counted from 1.
    image : (n,) array of str
        Name of the image; the rows of one image of a camera are of one reading.
    camera : (n,) array of str
    board : (n,) array of str
        Name of the board, or its text (see `truearm.wings.camera.boards.parse_board`).
    corner : (n,) int array
    pixels : (n, 2) array
        Column u to the right and row v down [px]; the centre of the first pixel is at (0, 0).
    file : Path or None
        Where they were read from, named in messages.
    sizes_px : mapping of str to (int, int)
        Width and height of the images of a camera, where they are known.

    Raises
    ------
    InputError
        If there is no row, a name is empty, a pixel is not finite or absurd, a corner stands twice in an image, or the
        rows of one image are of several readings.
    """

    reading: IntArray
    image: NameArray
    camera: NameArray
    board: NameArray
    corner: IntArray
    pixels: FloatArray
    file: Path | None = None
    sizes_px: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("reading", "corner", *NAMES):
            values = np.asarray(getattr(self, name), dtype=np.str_ if name in NAMES else np.intp)
            if values.shape != (len(self),):
                raise InputError(f"expected one {name} for each of {len(self)} pixels, got shape {values.shape}")
            object.__setattr__(self, name, values)
        if np.shape(self.pixels) != (len(self), 2):
            raise InputError(f"expected pixels (u, v), got an array of shape {np.shape(self.pixels)}")
        if not len(self):
            raise InputError("expected one or more corners, got none", file=self.file)
        self._check()

    def __len__(self) -> int:
        return len(self.reading)

    @property
    def images(self) -> tuple[str, ...]:
        """Names of the images, in the order of their first rows."""
        return tuple(dict.fromkeys(self.image.tolist()))

    @property
    def cameras_without_size(self) -> tuple[str, ...]:
        """Names of the cameras whose images have no known size."""
        return tuple(name for name in np.unique(self.camera).tolist() if name not in self.sizes_px)

    def of_image(self, image: str) -> PixelObservations:
        """The rows of one image."""
        return self.rows(self.image == image)

    def rows(self, chosen: BoolArray | IntArray) -> PixelObservations:
        """Some of the rows."""
        parts: dict[str, Any] = {name: getattr(self, name)[chosen] for name in FIELDS}
        return replace(self, **parts)

    @classmethod
    def joined(cls, parts: Sequence[PixelObservations]) -> PixelObservations:
        """The rows of several observations.

        Raises
        ------
        InputError
            If the images of one camera have several sizes.
        """
        columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS}
        sizes: dict[str, tuple[int, int]] = {}
        for part in parts:
            for name, size in part.sizes_px.items():
                if sizes.setdefault(name, size) != size:
                    here, there = (f"{width} x {height}" for width, height in (size, sizes[name]))
                    problem = f"the images of camera {name} are {here} px, and {there} px in another table"
                    hint = "give two cameras two names: truearm corners --camera-name"
                    raise InputError(problem, file=part.file, hint=hint)
        return cls(**columns, sizes_px=sizes)

    def check_readings(self, n: int) -> None:
        """Check that the rows are of `n` readings.

        Raises
        ------
        InputError
            If a number is beyond them.
        """
        self._refuse(self.reading > n, f"expected readings 1 to {n}, the rows of the joints table, got {{}}", "reading")

    def save(self, path: str | Path) -> None:
        """Write the table; the file appears whole or not at all."""
        columns = {name: getattr(self, name) for name in ("reading", *NAMES, "corner")}
        columns |= {name: np.round(self.pixels[:, k], 4) for k, name in enumerate(("u_px", "v_px"))}
        if not self.cameras_without_size:
            sizes = np.array([self.sizes_px[name] for name in self.camera.tolist()])
            columns |= dict(zip(SIZE, sizes.T, strict=True))
        with atomic_file(path, read=read_pixels) as part:
            write_columns(part, columns)

    def _check(self) -> None:
        self._refuse(self.reading < 1, "expected the number of a reading, counted from 1, got {}", "reading")
        for name in NAMES:
            self._refuse(getattr(self, name) == "", f"expected the name of the {name}, got an empty cell", name)
        for k, name in enumerate(("u_px", "v_px")):
            values = self.pixels[:, k]
            absurd = ~(np.abs(values) <= LARGEST_PX)
            self._refuse(absurd, f"expected pixels from -{LARGEST_PX} to {LARGEST_PX}, got {{}}", name, values)
        codes = [np.unique(values, return_inverse=True)[1] for values in (self.camera, self.image)]
        _, first, image = np.unique(np.stack(codes), axis=1, return_index=True, return_inverse=True)
        image = image.reshape(-1)
        others = self.reading != self.reading[first[image]]
        self._refuse(others, "expected one reading an image, got a second one, {}", "reading")
        keys = np.stack([image, np.unique(self.board, return_inverse=True)[1], self.corner])
        _, once = np.unique(keys, axis=1, return_index=True)
        twice = np.ones(len(self), bool)
        twice[once] = False
        self._refuse(twice, "corner {} stands twice in this image", "corner")

    def _refuse(self, bad: BoolArray, problem: str, column: str, values: object = None) -> None:
        """Raise an error for the first bad row, with its line if the rows are those of a file."""
        if not bad.any():
            return
        row = int(np.argmax(bad))
        got = np.asarray(getattr(self, column) if values is None else values)[row]
        text = quoted_cell(str(got)) if isinstance(got, str) else f"{got:g}"
        line = None if self.file is None else row + 2
        where = f"row {row + 1}" if line is None else None
        raise InputError(problem.format(text), file=self.file, line=line, row=where, column=column)


def read_pixels(path: str | Path) -> PixelObservations:
    """Read a table of pixels, of `truearm corners` or of another detector.

    Needed are reading, corner, u_px and v_px, and an image or a board where there are several: without the column
    ``image`` each reading is one, without ``camera`` there is one, and without ``board`` there is one. The size of the
    images is in the columns width_px and height_px, where it is known.

    Raises
    ------
    InputError
        If the file is no such table; with its line and column.
    """
    path = Path(path)
    check_readable(path, limit_bytes=MAX_BYTES)
    sheet = read_form(path)
    has_size = any(name in sheet.names for name in SIZE)
    numeric = (*NUMBERS, *SIZE) if has_size else NUMBERS
    check_names(sheet, numeric, NAMES if has_size else (*NAMES, *SIZE))
    words = [name for name in NAMES if name in sheet.names]
    places = [[sheet.names.index(name) for name in group] for group in (numeric, words)]
    numbers, texts = read_columns(sheet, places[0], places[1])
    names = dict(zip(words, texts, strict=True))
    reading = whole_numbers(numbers[:, 0], "reading", sheet.error)
    corner = whole_numbers(numbers[:, 1], "corner", sheet.error)
    image = names.get("image", np.char.add("reading ", reading.astype(np.str_)))
    camera, board = (names.get(name, np.full(len(reading), name)) for name in ("camera", "board"))
    sizes = _sizes(numbers[:, 4:], camera, sheet.error) if has_size else {}
    return PixelObservations(reading, image, camera, board, corner, numbers[:, 2:4], path, sizes)


def _sizes(numbers: FloatArray, camera: NameArray, error: Callable[..., InputError]) -> dict[str, tuple[int, int]]:
    """The size of the images of every camera, by columns (n, 2), which all rows of it share."""
    sizes = np.stack([whole_numbers(numbers[:, k], name, error) for k, name in enumerate(SIZE)], axis=1)
    names, first, of_row = np.unique(camera, return_index=True, return_inverse=True)
    wrong = (sizes != sizes[first][of_row]) | (sizes <= 0) | (sizes > LARGEST_PX)
    if wrong.any():
        row, k = np.argwhere(wrong)[0].tolist()
        raise error(f"expected one size of all images of a camera, got {sizes[row, k]}", row, column=SIZE[k])
    return {str(name): (int(width), int(height)) for name, (width, height) in zip(names, sizes[first], strict=True)}


def camera_files(path: Path, tables: Sequence[Path], stated: Mapping[str, str]) -> dict[str, Path]:
    """Files for the intrinsics of cameras by their names: ``camera.yaml`` of one, else ``camera-left.yaml`` and so on.

    Raises
    ------
    InputError
        If the size of the images of one is not known, which such a file needs, neither from the tables nor stated.
    """
    seen = PixelObservations.joined([read_pixels(table) for table in tables])
    names = np.unique(seen.camera).tolist()
    if missing := [] if "" in stated else [name for name in seen.cameras_without_size if name not in stated]:
        raise InputError(
            f"the size of the images{f' of camera {missing[0]}' if len(names) > 1 else ''} is not stated, and a "
            "camera's file needs it",
            file=tables[0],
            hint=f"add the columns {' and '.join(SIZE)}, or state the camera with --camera",
        )
    return {name: path.with_stem(f"{path.stem}-{name}") for name in names} if len(names) > 1 else {"camera": path}
