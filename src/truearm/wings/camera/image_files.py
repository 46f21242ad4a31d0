"""Image files as grey values, bounded before they are decoded; and which image belongs to which reading."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.delimited import quoted_cell, read_form
from truearm.files.file_reading import check_readable

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm")
# Only decoders of these are offered a file, whatever its name.
FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "PPM")
MAX_BYTES = 200_000_000
# 100 megapixels, more than any industrial camera; and as many images as a day gives.
MAX_PIXELS = 100_000_000
MOST_IMAGES = 5_000
# The column of the joints table with the name of the image of each reading; `fit` ignores notes.
COLUMN = "note_image"


def read_image(path: str | Path) -> npt.NDArray[np.uint8]:
    """Read an image as grey values (height, width), in the orientation of the sensor.

    Raises
    ------
    InputError
        If the file is missing, too large, no image of these formats, or broken.
    """
    from PIL import Image

    check_readable(path, limit_bytes=MAX_BYTES)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # bounded below
            with Image.open(path, formats=FORMATS) as picture:
                width, height = picture.size
                if width * height > MAX_PIXELS:
                    raise InputError(
                        f"expected an image of at most {MAX_PIXELS / 1e6:.0f} megapixels, got {width} x {height}"
                    )
                if picture.mode.startswith(("I", "F")):  # 10, 12 or 16 bits: what is white is not stated
                    values = np.asarray(picture, dtype=float)
                    brightest = float(values.max(initial=0.0))
                    grey = np.clip(values, 0, None) * (255 / brightest if brightest > 0 else 0)
                    return np.asarray(grey, dtype=np.uint8)
                return np.array(picture.convert("L"))
    except InputError as error:
        raise error.in_file(path) from None
    except Exception as error:  # decoders meet broken files with errors of many kinds
        reason = str(error).split("\n")[0].replace(str(path), Path(path).name)[:120] or type(error).__name__
        raise InputError(
            f"the image cannot be read ({reason})", file=path, hint="PNG, JPEG, BMP, TIFF or PGM"
        ) from None


def list_images(folder: str | Path) -> list[Path]:
    """The images in a folder, in the order in which people number them: ``2.png`` before ``10.png``.

    Raises
    ------
    InputError
        If it is no folder, or has no images or more than a day gives.
    """
    folder = Path(folder)
    if not folder.is_dir():
        got = "a file" if folder.exists() else "nothing of this name"
        raise InputError(f"expected a folder with images, got {got}", file=folder)
    found = sorted((path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES), key=_natural)
    if not found:
        raise InputError(f"the folder has no images ({', '.join(SUFFIXES)})", file=folder)
    if len(found) > MOST_IMAGES:
        raise InputError(f"expected at most {MOST_IMAGES} images, got {len(found)}", file=folder)
    return found


def images_of_readings(session: object, images: list[Path], n_readings: int) -> tuple[list[Path | None], str]:
    """The image of each reading, None without; and a sentence where it was assumed.

    Parameters
    ----------
    session : object
        Where the readings came from: in a CSV file the column ``note_image`` has the names of the images.
    images : list of Path
    n_readings : int

    Raises
    ------
    InputError
        If a name is of no image or stands twice, or there is no such column and the numbers differ.
    """
    if isinstance(session, str | Path) and Path(session).suffix.lower() == ".csv":
        sheet = read_form(session)
        if COLUMN in sheet.names:
            place = sheet.names.index(COLUMN)
            cells = [row[place].strip() for row in sheet.rows()]
            if len(cells) != n_readings:
                raise sheet.error(f"{len(cells)} rows, of which {n_readings} are readings", hint="delete empty rows")
            by_name = {path.stem: path for path in images} | {path.name: path for path in images}
            found: list[Path | None] = []
            for row, cell in enumerate(cells):
                path = by_name.get(cell.replace("\\", "/").rpartition("/")[2]) if cell else None
                if cell and path is None:
                    raise sheet.error(
                        f"there is no image {quoted_cell(cell)} in the folder",
                        row,
                        column=COLUMN,
                        hint="an empty cell, for a reading without an image",
                    )
                if path is not None and path in found:
                    raise sheet.error(f"the image {quoted_cell(cell)} stands here twice", row, column=COLUMN)
                found.append(path)
            return found, ""
    if len(images) != n_readings:
        raise InputError(
            f"{len(images)} images and {n_readings} readings: which image belongs to which reading is not known",
            file=images[0].parent,
            hint=f"a column {COLUMN} in the joints table, with the name of the image of each reading",
        )
    said = f"Image k is that of reading k, in the order of their names: {images[0].name} to {images[-1].name}."
    return [*images], said


def _natural(path: Path) -> list[tuple[int, str]]:
    parts = re.split(r"(\d+)", path.name.lower())
    return [(int(part), "") if part.isdecimal() and part.isascii() else (-1, part) for part in parts]
