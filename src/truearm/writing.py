"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from truearm.errors import InputError


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Give a path beside `path` to write to; rename it to `path` only if the block ends without an exception.

    A reader never sees half a file, and an interrupted run (Ctrl-C, kill, full disk) leaves what stood
    there before.

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
        If the folder does not exist, is not writable, or `path` is a folder.
    """
    path = Path(path)
    folder = check_writable(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=folder)
    except PermissionError:
        raise InputError(f"no permission to write in the folder {folder}", file=path) from None
    os.close(handle)
    beside = Path(name)
    try:
        yield beside
        # mkstemp makes files only their owner may read; a new file gets what the umask says instead.
        umask = os.umask(0)
        os.umask(umask)
        beside.chmod(0o666 & ~umask)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def check_writable(path: str | Path) -> Path:
    """Check, before long work, that a file can be written; give its folder.

    Raises
    ------
    InputError
        If the folder does not exist or `path` is a folder.
    """
    path = Path(path)
    folder = path.parent
    if not folder.is_dir():
        raise InputError(f"the folder {folder} does not exist", file=path, hint=f"mkdir -p {folder}")
    if path.is_dir():
        raise InputError("expected the name of a file to write, got a folder", file=path, hint=f"{path / 'NAME'}")
    return folder
