"""One program at a time writes a file: an exclusive lock on it, which ends when its handle is closed."""

from __future__ import annotations

import errno
import os
import sys

# What the systems say of a file that another handle has locked.
TAKEN = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
# The lock of Windows is one on bytes, which nobody else then reads: one far behind the end of the file.
LOCKED_BYTE = 2**30


def is_locked_by_another(handle: int) -> bool:
    """Lock an open file, unless another handle has: of another program, or of this one.

    A file system without locks counts as free.

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
        return error.errno in TAKEN
    return False
