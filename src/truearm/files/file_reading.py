"""Bounded reads: every file that a user names is checked for its kind and its size before it is read.

A text is decoded by its byte order mark, else by the one of a few encodings that its bytes fit.
"""

from __future__ import annotations

import codecs
import errno
import re
import stat
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from truearm.errors import InputError

# What spreadsheets under Windows write where they are not asked for UTF-8.
WINDOWS = "cp1252"
CHINESE = "gb18030"

_MARKS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_SAMPLE = 4096
_NOT_ASCII = re.compile(rb"[\x80-\xff]+")


def recognise_encoding(data: bytes) -> str:
    """Return the encoding of a text: UTF-8, UTF-16, GB18030 or cp1252.

    Notes
    -----
    In Chinese text of GB18030 the usual characters are pairs of bytes from A1 on (GB 2312; the first up to D7), so runs
    of such bytes are even. In cp1252 an accented letter or a degree sign mostly stands alone, and small letters with
    accents begin at E0.
    """
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            return encoding
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        zeros = data[first:_SAMPLE:2]
        if zeros and zeros.count(0) > 0.9 * len(zeros):
            return encoding
    try:
        data.decode()
    except UnicodeDecodeError:
        runs = _NOT_ASCII.findall(data)
        leads = [byte for run in runs for byte in run[::2]]
        in_pairs = all(len(run) % 2 == 0 and min(run) >= 0xA1 for run in runs)
        return CHINESE if in_pairs and sum(byte <= 0xD7 for byte in leads) > 0.8 * len(leads) else WINDOWS
    return "utf-8"


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
