"""One program at a time writes a file: an exclusive lock on it, which ends when its handle is closed."""

from __future__ import annotations

import errno
import os
import sys

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
