"""Files that a verb writes: none of those it has read, and whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from truearm.errors import InputError
from truearm.files.atomic_write import check_new_file, check_writable, is_same_file

if TYPE_CHECKING:
    from truearm.arm import Arm

T = TypeVar("T")
REPLACE = "another name, or --force to replace it"


def check_output_is_not_input(out: str | Path, *inputs: str | Path | None) -> None:
    """Check that a file to write is none of those that are read: readings cannot be measured again.

    Raises
    ------
    InputError
        If `out` is one of `inputs`, or would be one of the session files in a folder of them; those that are None are
        not given.
    """
    if any(is_same_file(out, path) for path in inputs if path is not None):
        raise InputError("the output file is an input file and would be overwritten", file=out, hint="another name")
    for folder in (Path(path) for path in inputs if path is not None and Path(path).is_dir()):
        _check_not_of_session(Path(out), folder)


def _check_not_of_session(out: Path, folder: Path) -> None:
    from truearm.readings.large_sessions import SUFFIXES, session_files  # no small session waits for these

    belongs = out.suffix.lower() in SUFFIXES and Path(os.path.realpath(out)).is_relative_to(os.path.realpath(folder))
    if belongs or any(is_same_file(out, file) for file in session_files(folder)):
        raise InputError("the output file would be one of the readings in the folder", file=out, hint="another folder")


def check_output(
    out: str | Path,
    *inputs: str | Path | None,
    endings: tuple[str, ...] = (),
    read: Callable[[Path], object] | None = None,
) -> None:
    """Check, before long work, that a file can be written that a command can make again.

    Parameters
    ----------
    out : path
    *inputs : path
        What the command reads; None is not given.
    endings : tuple of str
        Of the name; any by default.
    read : callable, optional
        The reader of such files: what it cannot read is another file, and is not replaced.

    Raises
    ------
    InputError
        If the name ends in none of `endings`, is one of `inputs`, or cannot be written; if another file has it.
    """
    out = Path(out)
    if endings and out.suffix not in endings:
        raise InputError(f"expected a file name that ends in {' or '.join(endings)}, got {out.name!r}", file=out)
    check_output_is_not_input(out, *inputs)
    check_writable(out)
    if read is not None and out.exists():
        _read_own(out, read, "another name")


def _read_own(out: Path, read: Callable[[Path], T], hint: str) -> T:
    """What is in a file that is to be replaced."""
    try:
        return read(out)
    except InputError as error:
        problem = f"the file exists already, and is not one that this command writes ({error.problem})"
        raise InputError(problem, file=out, hint=hint) from None


def check_new_output(out: str | Path, *inputs: str | Path | None, force: bool, endings: tuple[str, ...] = ()) -> None:
    """Check, before long work, a file of what people type or measure: it replaces no file, without `force`.

    Raises
    ------
    InputError
        As `check_output`, also with `force`; without it if the file exists.
    """
    check_output_is_not_input(out, *inputs)
    check_new_file(out, force=force, endings=endings)


def check_model_output(out: str | Path, arm: Arm | None, *inputs: str | Path | None, force: bool) -> None:
    """Check a model to be written: it replaces a model of the same arm, and nothing else, without `force`.

    Parameters
    ----------
    out : path
    arm : Arm, optional
        Of the model; None if that is not known yet.
    *inputs : path
    force : bool

    Raises
    ------
    InputError
        As `check_output`, also with `force`; without it if the file exists and is none of this arm's models, or is
        damaged.
    """
    from truearm.models.arm_check import other_arm

    out = Path(out)
    check_output(out, *inputs)
    if force or not out.exists():
        return
    status = out.stat()
    kept = _arm_of_model(out, (status.st_ino, status.st_mtime_ns, status.st_size))
    if arm is not None and (difference := other_arm(kept, arm)):
        raise InputError(f"the file has a model of another arm: {difference}", file=out, hint=REPLACE)


@lru_cache(maxsize=1)
def _arm_of_model(out: Path, status: tuple[int, ...]) -> Arm:
    """The arm of a model that is to be replaced; after the fit it is read again if its file has another status."""
    from truearm.models.model_file import load_model

    del status
    return _read_own(out, load_model, REPLACE).arm_  # all of it: the damaged file of some arm is not of this arm
