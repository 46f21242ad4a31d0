"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from truearm.errors import InputError, TruearmError
from truearm.files.file_reading import access_error


@contextmanager
def atomic_file(path: str | Path) -> Iterator[Path]:
    """Yield a path beside `path` to write to; rename it to `path` only if the block ends without an exception.

    A reader never sees half a file, and an interrupted run (Ctrl-C, kill, full disk) leaves the
    previous file. If `path` is a symbolic link, the file it points to is written.

    Parameters
    ----------
    path : path
        The file to be written. Its folder must exist.

    Yields
    ------
    Path
        A new, empty file in the same folder, with the same suffix.

    Raises
    ------
    InputError
        As `check_writable`.
    TruearmError
        If the system refuses: no permission, disk full.
    """
    check_writable(path)
    target = Path(os.path.realpath(path))
    beside: Path | None = None
    try:
        # A short prefix: a name of the longest length that a file may have stays possible.
        handle, name = tempfile.mkstemp(prefix=f".{target.stem[:40]}-", suffix=target.suffix, dir=target.parent)
        beside = Path(name)
        os.close(handle)
        yield beside
        # mkstemp makes files only their owner may read: a replaced file keeps its rights, a new one gets the umask's.
        beside.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
        beside.replace(target)
    except OSError as error:
        raise TruearmError(f"{path}: the file cannot be written ({error.strerror or error})") from error
    finally:
        if beside is not None:
            beside.unlink(missing_ok=True)


def check_new_form(path: str | Path, *, holds: str, ending: str = ".csv") -> None:
    """Check, before long work, that a form to fill in can be written and overwrites no file: it may be filled in.

    Parameters
    ----------
    path : path
    holds : str
        What people enter in such a form, in the plural: readings, points.
    ending : str
        Of the name.

    Raises
    ------
    InputError
        If the name has another ending, the file exists, or its folder is not writable.
    """
    path = Path(path)
    if path.suffix != ending:
        raise InputError(f"expected a file name that ends in {ending}, got {path.name!r}", file=path)
    if path.exists():
        raise InputError(f"the file exists, and {holds} may be in it", file=path, hint="choose another name")
    check_writable(path)


def is_same_file(path: str | Path, other: str | Path) -> bool:
    """Whether two names are of one file. It need not exist, and its links may form a loop."""
    return os.path.realpath(path) == os.path.realpath(other)


def _umask() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return umask


def check_writable(path: str | Path) -> None:
    """Check, before long work, that a file can be written.

    Raises
    ------
    InputError
        If the folder does not exist or is not writable, `path` is a folder, a device or a protected file, or its links
        form a loop.
    """
    path = Path(path)
    folder = path.parent
    if not folder.is_dir():
        if folder.exists():
            raise InputError(f"{folder} is a file, not a folder", file=path)
        raise InputError(f"the folder {folder} does not exist", file=path, hint=f"mkdir -p {folder}")
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL character
        raise access_error(path, error, purpose="written") from None
    else:
        if stat.S_ISDIR(mode):
            raise InputError("expected the name of a file to write, got a folder", file=path, hint=f"{path / 'NAME'}")
        if not stat.S_ISREG(mode):
            raise InputError("expected the name of a file to write, got a device or a pipe", file=path)
        if not os.access(path, os.W_OK):
            raise InputError("the file is protected against writing", file=path, hint="another name")
    real_folder = Path(os.path.realpath(path)).parent
    if not os.access(real_folder, os.W_OK):
        raise InputError(f"no permission to write in the folder {real_folder}", file=path)
