"""Files of a bounded size: an arm is a page of text, so a longer file is something else."""

from __future__ import annotations

from pathlib import Path

from truearm.errors import InputError


def read_limited(path: str | Path, *, limit_bytes: int) -> bytes:
    """Read a file of at most `limit_bytes`.

    Raises
    ------
    InputError
        If the file is missing, a folder, not readable, or longer than that.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(limit_bytes + 1)  # the size on disk may lie: pipes, growing files
    except FileNotFoundError:
        raise InputError("there is no such file", file=path) from None
    except IsADirectoryError:
        raise InputError("expected a file, got a folder", file=path) from None
    except OSError as error:
        raise InputError(f"the file cannot be read ({error.strerror})", file=path) from None
    if len(content) > limit_bytes:
        raise InputError(f"expected at most {limit_bytes / 1e6:g} MB, got a longer file", file=path)
    return content
