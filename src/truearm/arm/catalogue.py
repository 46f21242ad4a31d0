"""Arms in the box, each a file in ``arms/`` that says where its numbers come from."""

from __future__ import annotations

import difflib
from importlib import resources
from pathlib import Path

from truearm.arm.arm import Arm
from truearm.arm.arm_files import read_arm
from truearm.errors import InputError

_SUFFIXES = (".toml", ".urdf")


def arm_names() -> tuple[str, ...]:
    """Give the names of the arms in the box, in alphabetical order."""
    return tuple(sorted(_files()))


def load_arm(name: str) -> Arm:
    """Load an arm of the box by its name.

    Raises
    ------
    InputError
        If there is no arm of this name; with the names there are.
    """
    files = _files()
    if name not in files:
        close = difflib.get_close_matches(name.lower(), files, n=1, cutoff=0.5)
        raise InputError(
            f"there is no arm {name!r} in the catalogue; it has {', '.join(sorted(files))}",
            hint=close[0] if close else "the path of an arm file (.toml) or a URDF (.urdf)",
        )
    with resources.as_file(files[name]) as path:
        return read_arm(path)


def resolve_arm(text: str | Path) -> Arm:
    """Load an arm by what a user typed: a name of the catalogue, or the path of an arm file or a URDF.

    What ends in ``.toml`` or ``.urdf``, or holds a path separator, is a path.

    Raises
    ------
    InputError
        If there is no such arm or file, or the file is not what it must be.
    """
    path = Path(text)
    if isinstance(text, Path) or path.suffix.lower() in _SUFFIXES or len(path.parts) > 1:
        return read_arm(path)
    return load_arm(text)


def _files() -> dict[str, resources.abc.Traversable]:
    folder = resources.files("truearm.arm") / "arms"
    entries = (entry for entry in folder.iterdir() if entry.name.endswith(_SUFFIXES))
    return {entry.name.rpartition(".")[0]: entry for entry in entries}
