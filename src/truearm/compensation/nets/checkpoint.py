"""The checkpoint file from which an interrupted training resumes.

An uncompressed npz archive without pickles: ``about`` (JSON as bytes) and arrays of doubles. It is written whole or not
at all, and checked before a number of it is used.
"""

from __future__ import annotations

import io
import math
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file, check_writable
from truearm.typing import FloatArray

FORMAT = 1
RESTART_HINT = "delete it to start the training from the beginning"
MAX_ABOUT = 1 << 16  # bytes: a fingerprint and a sentence


class _About(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    format: int
    trainer: str
    fingerprint: str
    best_epoch: Annotated[int, Field(ge=0)]
    stop: str


@dataclass(frozen=True, eq=False)
class TrainingSnapshot:
    """A training after an epoch: enough to go on from.

    Attributes
    ----------
    rows : (epochs + 1, columns) array
        The record so far, a row an epoch, the start first.
    x : (p,) array
        The solver's parameters.
    memory : (m,) array
        What else the solver remembers: damping, or rate and momentum.
    best_x : (p,) array
        Parameters of the best epoch.
    best_epoch : int
    stop : str
        Why the training ended; empty while it runs.
    """

    rows: FloatArray
    x: FloatArray
    memory: FloatArray
    best_x: FloatArray
    best_epoch: int
    stop: str


@dataclass(frozen=True)
class Checkpoint:
    """Where a training is kept so that it can be stopped and gone on with.

    If `file` exists, a trainer resumes from it, to the same weights and record (but for `time`) as without the stop,
    bit for bit; a finished training's file gives its end at once. Whoever makes the checkpoint removes the file.

    Parameters
    ----------
    file : path
        Its folder must exist.
    fingerprint : str
        Of everything that the training's course depends on: data, start weights, options. A file with another one is
        refused.
    seconds : float
        The file is written when so much time has passed since the last time, at an epoch's end; at the training's
        end; and when it is interrupted (Ctrl-C, and
        kill where the program makes a SystemExit of it).

    Raises
    ------
    InputError
        If `file` cannot be written, or `seconds` is negative.
    """

    file: Path
    fingerprint: str
    seconds: float = 10.0

    def __post_init__(self) -> None:
        if not self.seconds >= 0:
            raise InputError(f"expected 0 s or more between checkpoints, got {self.seconds}")
        check_writable(self.file)

    def write(self, trainer: str, saved: TrainingSnapshot) -> None:
        """Write what `trainer` saved.

        Raises
        ------
        TruearmError
            If the system refuses: no permission, disk full.
        """
        about = _About(
            format=FORMAT,
            trainer=trainer,
            fingerprint=self.fingerprint,
            best_epoch=saved.best_epoch,
            stop=saved.stop,
        )
        arrays = {"rows": saved.rows, "x": saved.x, "memory": saved.memory, "best_x": saved.best_x}
        with atomic_file(self.file) as beside, zipfile.ZipFile(beside, "w") as archive:
            archive.writestr("about.npy", _bytes(np.frombuffer(about.model_dump_json().encode(), dtype=np.uint8)))
            for name, array in arrays.items():
                archive.writestr(f"{name}.npy", _bytes(np.ascontiguousarray(array, dtype="<f8")))

    def read(self, trainer: str, *, most_rows: int, n_columns: int, n: int, n_memory: int) -> TrainingSnapshot | None:
        """What `trainer` saved; None if there is no file.

        Parameters
        ----------
        trainer : str
        most_rows, n_columns, n, n_memory : int
            Sizes: maximum number of rows; columns; parameters; numbers of the solver's memory.

        Raises
        ------
        InputError
            If the file is damaged, foreign, or of another training.
        """
        try:
            with zipfile.ZipFile(self.file) as archive:
                return self._saved(archive, trainer, (most_rows, n_columns), n, n_memory)
        except FileNotFoundError:
            return None
        except InputError as error:
            raise InputError(error.problem, file=self.file, hint=RESTART_HINT) from None
        except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, LookupError, ValueError, struct.error) as error:
            raise InputError(
                f"expected the checkpoint of a training, got something else or a damaged one ({error})",
                file=self.file,
                hint=RESTART_HINT,
            ) from None

    def _saved(
        self, archive: zipfile.ZipFile, trainer: str, rows: tuple[int, int], n: int, n_memory: int
    ) -> TrainingSnapshot:
        names = ["about.npy", "best_x.npy", "memory.npy", "rows.npy", "x.npy"]
        if sorted(archive.namelist()) != names:
            raise InputError(f"expected a checkpoint, with {', '.join(names)}, got another archive")
        try:
            about = _About.model_validate_json(_array(archive, "about", "|u1", (MAX_ABOUT,)).tobytes())
        except ValidationError as error:
            first = error.errors()[0]
            raise InputError(f"'about' is not that of a checkpoint: {first['loc']}, {first['msg']}") from None
        if about.format != FORMAT:
            raise InputError(f"expected a checkpoint of format {FORMAT}, got {about.format}")
        if about.trainer != trainer or about.fingerprint != self.fingerprint:
            raise InputError("the checkpoint is of another training: other data, options or trainer")
        saved = TrainingSnapshot(
            rows=_array(archive, "rows", "<f8", rows),
            x=_array(archive, "x", "<f8", (n,), exact=True),
            memory=_array(archive, "memory", "<f8", (n_memory,), exact=True),
            best_x=_array(archive, "best_x", "<f8", (n,), exact=True),
            best_epoch=about.best_epoch,
            stop=about.stop,
        )
        if saved.rows.shape[1] != rows[1] or not saved.best_epoch < len(saved.rows):
            raise InputError(f"expected rows of {rows[1]} numbers up to the best epoch, got {saved.rows.shape}")
        if not all(np.isfinite(array).all() for array in (saved.x, saved.memory, saved.best_x)):
            raise InputError("the checkpoint has numbers that are not finite")
        return saved


def _bytes(array: npt.NDArray[np.float64] | npt.NDArray[np.uint8]) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array, version=(1, 0), allow_pickle=False)
    return stream.getvalue()


def _array(
    archive: zipfile.ZipFile, name: str, dtype: str, most: tuple[int, ...], *, exact: bool = False
) -> FloatArray:
    """An array of at most (or exactly) the shape `most`. Its header is checked before memory is allocated."""
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type != zipfile.ZIP_STORED or info.file_size > np.dtype(dtype).itemsize * math.prod(most) + 1024:
        raise InputError(f"the array {name} is compressed or larger than this training needs")
    data = archive.read(info)
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise InputError(f"expected the array {name} in format 1.0, got {version}")
    shape, fortran, found = np.lib.format.read_array_header_1_0(stream)
    rest = data[stream.tell() :]
    fits = shape == most if exact else len(shape) == len(most) and all(map(int.__le__, shape, most))
    if found != np.dtype(dtype) or fortran or not fits or len(rest) != found.itemsize * math.prod(shape):
        raise InputError(
            f"expected the array {name} as {dtype} of {'' if exact else 'up to '}{most}, got {found}, {shape}"
        )
    return np.frombuffer(rest, dtype=dtype).reshape(shape).copy()
