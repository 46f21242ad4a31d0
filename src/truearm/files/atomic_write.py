"""Files that appear whole or not at all, on the disk, and that their reader reads; a lock for one writer at a time."""

from __future__ import annotations

import errno
import os
import platform
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar
from zlib import crc32

from truearm.errors import InputError, ProgramFault, TruearmError
from truearm.files.file_reading import access_error

# What the systems say of a file that another handle has locked.
TAKEN = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
# The lock of Windows is one on bytes, which nobody else then reads: one far behind the end of the file.
LOCKED_BYTE = 2**30


def lock(handle: int) -> bool | None:
    """Lock an open file: whether it is locked now; False if another handle has it, None if the system has no locks.

    Parameters
    ----------
    handle : int
        As of `os.open`, for writing.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(handle, LOCKED_BYTE, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return False if error.errno in TAKEN else None
    return True


# How the name of a file begins that is not yet whole. Its writer has it locked: without a lock, its writer was killed.
PART = ".truearm-part-"

T = TypeVar("T")


@contextmanager
def atomic_file(path: str | Path, *, read: Callable[[Path], object] | None = None) -> Iterator[Path]:
    """Yield a path beside `path` to write to; rename it to `path` only if the block ends without an exception.

    A reader never sees half a file, and an interrupted run (Ctrl-C, kill, full disk, power cut) leaves the previous
    file: the content is on the disk before the name is. What a killed run left in the folder is removed. If `path` is
    a symbolic link, the file it points to is written. A path that another `atomic_file` yielded is written as it is:
    it appears with that one.

    Parameters
    ----------
    path : path
        The file to be written. Its folder must exist.
    read : callable, optional
        The reader of such files: what it cannot read is not written.

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
    ProgramFault
        If `read` cannot read what the block wrote; the previous file stays.
    """
    check_writable(path)
    target = Path(os.path.realpath(path))
    if target.name.startswith(PART):
        yield target
        read_back(read, target)
        return
    handle, beside = -1, None
    try:
        _remove_abandoned(target.parent)
        handle, beside = _new_part(target, Path(path).suffix)
        yield beside
        read_back(read, beside)
        # mkstemp makes files only their owner may read: a replaced file keeps its rights, a new one gets the umask's.
        with beside.open("rb+") as written:
            beside.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
            os.fsync(written.fileno())
        if os.name == "nt":  # it renames no open file
            os.close(handle)
            handle = -1
        beside.replace(target)
        entry_to_disk(target)
    except OSError as error:
        raise TruearmError(f"{path}: the file cannot be written ({error.strerror or error})") from error
    finally:
        if handle >= 0:
            os.close(handle)
        if beside is not None:
            beside.unlink(missing_ok=True)


def _own_parts() -> str:
    """How the names of parts of this computer begin: a lock of another one may not be seen here."""
    return f"{PART}{crc32(platform.node().encode()):08x}-"


def _new_part(target: Path, suffix: str) -> tuple[int, Path]:
    """A new file beside another, locked; where the system refuses locks, or has none, as it is."""
    for is_last in (False,) * 9 + (True,):
        # Part of the name: one of the longest length that a file may have stays possible.
        handle, name = tempfile.mkstemp(prefix=f"{_own_parts()}{target.stem[:40]}-", suffix=suffix, dir=target.parent)
        # Before the lock another writer may have taken it for abandoned. On Windows an open file is not removed, and
        # its lock would be one on bytes, which a large file reaches.
        if is_last or os.name == "nt" or (lock(handle) is not False and os.fstat(handle).st_nlink):
            break
        os.close(handle)
        Path(name).unlink(missing_ok=True)
    return handle, Path(name)


def _remove_abandoned(folder: Path) -> None:
    """Remove what killed writers left in a folder."""
    parts, own = [], _own_parts()
    with suppress(PermissionError), os.scandir(folder) as entries:  # a folder may be writable and not readable
        parts = [one.path for one in entries if one.name.startswith(own) and one.is_file(follow_symlinks=False)]
    for part in parts:
        with suppress(OSError):
            if os.name == "nt":  # it removes no open file
                os.unlink(part)
                continue
            handle = os.open(part, os.O_RDWR)
            try:
                if lock(handle):
                    os.unlink(part)
            finally:
                os.close(handle)


def read_back(read: Callable[[T], object] | None, written: T) -> None:
    """Read what is to be kept by the reader that will read it, if there is one, before it is.

    Raises
    ------
    ProgramFault
        If that cannot read it.
    """
    if read is None:
        return
    try:
        read(written)
    except OSError:
        raise
    except Exception as error:
        problem = error.problem if isinstance(error, InputError) else error
        raise ProgramFault(f"truearm cannot read back what it wrote ({problem}). Nothing was replaced") from error


def entry_to_disk(path: Path) -> None:
    """Write the name of a new file to the disk, which belongs to its folder; not every system has such a step."""
    if os.name == "posix":
        with suppress(OSError):  # the file is there
            folder = os.open(path.resolve().parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


def check_new_file(path: str | Path, *, force: bool = False, endings: tuple[str, ...] = ()) -> None:
    """Check, before long work, that a file of what people type or measure can be written, and replaces none.

    Parameters
    ----------
    path : path
    force : bool
        Whether a file that exists may be replaced.
    endings : tuple of str
        Of the name; any by default.

    Raises
    ------
    InputError
        If the name has another ending, the file exists, or its folder is not writable.
    """
    path = Path(path)
    if endings and path.suffix not in endings:
        raise InputError(f"expected a file name that ends in {' or '.join(endings)}, got {path.name!r}", file=path)
    check_writable(path)
    if path.exists() and not force:
        raise InputError("the file exists already", file=path, hint="another name, or --force to replace it")


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
