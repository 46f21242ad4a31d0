"""Bounded reads: every file that a user names is checked for its kind and its size before it is read."""

from __future__ import annotations

import errno
import stat
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from truearm.errors import InputError

T = TypeVar("T")


def check_readable(path: str | Path, *, limit_bytes: int, hint: str | None = None) -> None:
    """Check that `path` is an ordinary file of at most `limit_bytes`; devices and pipes may have no end.

    Parameters
    ----------
    path : path
    limit_bytes : int
    hint : str, optional
        What to do if the file is missing.

    Raises
    ------
    InputError
        If there is no such file, it is a folder, a device, a pipe or a socket, it is too large, or its links form a
        loop.
    """
    try:
        status = Path(path).stat()
    except FileNotFoundError:
        raise InputError("the file does not exist", file=path, hint=hint) from None
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL character
        raise access_error(path, error) from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError("expected a file, got a folder", file=path)
    if not stat.S_ISREG(status.st_mode):
        raise InputError(
            "expected a file, got a device, a pipe or a socket", file=path, hint="save the data to a file first"
        )
    if status.st_size > limit_bytes:
        raise _too_large(path, limit_bytes)


def read_limited(path: str | Path, *, limit_bytes: int, hint: str | None = None) -> bytes:
    """Read a file of at most `limit_bytes`.

    Raises
    ------
    InputError
        As `check_readable`, and if the system refuses to read the file.
    """
    check_readable(path, limit_bytes=limit_bytes, hint=hint)
    try:
        with Path(path).open("rb") as file:
            content = file.read(limit_bytes + 1)  # it may have grown since
    except OSError as error:
        raise access_error(path, error) from None
    if len(content) > limit_bytes:
        raise _too_large(path, limit_bytes)
    return content


def parse_file(path: str | Path, parse: Callable[[bytes], T], *, limit_bytes: int) -> T:
    """What `parse` makes of the content of a file of at most `limit_bytes`; its errors name the file."""
    content = read_limited(path, limit_bytes=limit_bytes)
    try:
        return parse(content)
    except InputError as error:
        raise error.in_file(path) from None


def utf8_text(content: bytes) -> str:
    """The text of a file in UTF-8; some editors write a byte order mark.

    Raises
    ------
    InputError
        If it is in another encoding; with the line.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError("expected UTF-8 text", line=line, hint="save the file as UTF-8") from None


def _too_large(path: str | Path, limit_bytes: int) -> InputError:
    return InputError(f"the file is larger than {limit_bytes / 1e6:.3g} MB, the limit for files of its kind", file=path)


def access_error(path: str | Path, error: OSError | ValueError, *, purpose: str = "read") -> InputError:
    """The message for a file that the system does not open; `purpose` is the participle of what is done with it."""
    if isinstance(error, OSError) and error.errno == errno.ELOOP:
        return InputError("the symbolic link leads back to itself", file=path)
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return InputError(f"the file cannot be {purpose} ({reason})", file=path)
