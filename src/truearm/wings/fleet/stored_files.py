"""Files of readings on this machine, or on shared or object storage by fsspec (``s3://bucket/a.csv``)."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import file_digest, sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import SplitResult, parse_qsl, urlsplit

from truearm.errors import InputError, MissingTool, TruearmError
from truearm.files.delimited import MAX_BYTES

# A file that changed in the last seconds may change once more without another time.
SETTLED_S = 3.0
COPIED_BYTES = 2**20
# Keys of a query that let whoever has the URL in: signatures of Amazon, Google and Azure, tokens, keys, passwords.
_SECRET = re.compile(
    "^(sig|auth|key|pwd|code)$|signature|token|secret|password|passwd|credential|apikey|accesskey"
).search
# What storages state of a file that changes with its content, in small letters alone.
_CHANGING = frozenset(("checksum", "contentmd5", "created", "digest", "etag", "generation", "lastmodified"))
_CHANGING |= {"md5", "md5hash", "modified", "mtime", "updated"}


class StorageError(TruearmError, OSError):
    """A storage that does not give a file."""


def is_url(name: str) -> bool:
    """Whether a file is not on this machine."""
    return "://" in name


def check_stored(name: str) -> None:
    """Check that a file exists, and that its URL, which is kept and shown, has no password.

    Raises
    ------
    InputError
        If it does not exist, or has a password.
    StorageError
        If the storage does not give it.
    MissingTool
        If the package for the URL is not installed.
    """
    if not is_url(name):
        if Path(name).is_dir():
            raise InputError(
                "expected a session of one file, got a folder",
                file=name,
                hint="a fleet takes one file of each arm; truearm fit reads a folder (a large session)",
            )
        if not Path(name).is_file():
            raise InputError("the file of the readings does not exist", file=name)
        return
    if "::" in name or _has_secret(urlsplit(name)):
        raise InputError(
            "expected a URL of one place, without a password, key or signature: it is written to the registry",
            hint="keys and passwords in the settings of fsspec, ~/.config/fsspec, or those of the storage",
        )
    _size(name)


def _has_secret(url: SplitResult) -> bool:
    """Whether a URL states a password, a token before its host, or a signature or key in its query.

    A name before the host of SSH and the like is a user; before one of the web there is none but for a token.
    """
    asked = {"".join(filter(str.isalnum, name.lower())) for name, _ in parse_qsl(url.query, keep_blank_values=True)}
    is_web = url.scheme.lower() in ("http", "https")
    return url.password is not None or (is_web and url.username is not None) or any(map(_SECRET, asked))


def stamp(name: str) -> tuple[str, bool]:
    """What changes when a file does, and whether it is old enough for that; raises OSError."""
    if is_url(name):
        with _reached(name):
            place, path = _place(name)
            said = sorted((key, str(value)) for key, value in place.info(path).items())
            changing = {"".join(filter(str.isalnum, key.lower())) for key, _ in said} & _CHANGING
            return sha256(repr(said).encode()).hexdigest(), bool(changing)
    found = Path(name).stat()
    return f"{found.st_size} {found.st_mtime_ns}", time.time() - found.st_mtime > SETTLED_S


def content_sha256(name: str) -> str:
    """The SHA-256 of a file; raises OSError."""
    if not is_url(name):
        with Path(name).open("rb") as file:
            return file_digest(file, "sha256").hexdigest()
    with _reached(name), _opened(name) as stream:
        return file_digest(stream, "sha256").hexdigest()


@contextmanager
def local_copy(name: str) -> Iterator[Path]:
    """The path of a file, or of a copy of one that is not on this machine while the block runs.

    Raises
    ------
    InputError
        If it is too large for a session.
    """
    if not is_url(name):
        yield Path(name)
        return
    if (size := _size(name) or 0) > MAX_BYTES:
        raise _too_large(name, f"{size >> 20} MiB")
    with TemporaryDirectory(prefix="truearm-") as folder:
        copy = Path(folder) / Path(urlsplit(name).path).name
        with copy.open("wb") as out, _reached(name), _opened(name) as stream:
            while out.tell() <= MAX_BYTES and (piece := stream.read(COPIED_BYTES)):
                out.write(piece)
        if copy.stat().st_size > MAX_BYTES:  # a storage need not state the size
            raise _too_large(name, "more")
        yield copy


def _too_large(name: str, size: str) -> InputError:
    return InputError(f"{name}: expected at most {MAX_BYTES >> 20} MiB, got {size}")


class FileHashes:
    """The SHA-256 of files: of those that are as they were, as it was kept.

    Parameters
    ----------
    kept : mapping of str to (str, str)
        Stamp and SHA-256 by name, see `stamp`; empty: every file is read.
    """

    def __init__(self, kept: dict[str, tuple[str, str]]) -> None:
        self._kept = kept
        self.new: dict[str, tuple[str, str]] = {}

    def sha256(self, name: str) -> str:
        """As `content_sha256`; raises OSError."""
        now, settled = stamp(name)
        before, digest = self.new.get(name) or self._kept.get(name, ("", ""))
        if before != now:
            digest = content_sha256(name)
            if settled:
                self.new[name] = now, digest
        return digest


@contextmanager
def _reached(name: str) -> Iterator[None]:
    """What goes wrong with a storage, as `StorageError`: each kind raises its own."""
    try:
        yield
    except ImportError as error:
        raise MissingTool(f"{name}: a package is not installed ({error})", hint="pip install it") from None
    except Exception as error:
        raise StorageError(f"{name}: the file cannot be reached ({error or type(error).__name__})") from None


def _place(name: str) -> tuple[Any, str]:
    """The storage of a URL, and the path in it."""
    import fsspec

    place, path = fsspec.core.url_to_fs(name)
    return place, path


def _size(name: str) -> int | None:
    """The size of a file, if its storage states one."""
    with _reached(name):
        place, path = _place(name)
        size: int | None = place.info(path).get("size")
        return size


def _opened(name: str) -> Any:
    """The file of a URL."""
    place, path = _place(name)
    return place.open(path, "rb")
