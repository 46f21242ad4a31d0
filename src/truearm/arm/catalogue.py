"""Arms in the box, each a file in ``arms/`` that states where its numbers come from."""

from __future__ import annotations

import difflib
from importlib import resources
from pathlib import Path

from truearm.arm.arm import Arm
from truearm.arm.arm_files import read_arm
from truearm.errors import InputError

_SUFFIXES = (".toml", ".urdf")


def list_arms() -> tuple[str, ...]:
    """Return the names of the arms in the catalogue, in alphabetical order.

    Examples
    --------
    >>> import truearm as ta
    >>> "ur10" in ta.list_arms()
    True
    """
    return tuple(sorted(_files()))


def load_arm(arm: str | Path) -> Arm:
    """Load an arm: by its name in the catalogue, or from an arm file or a URDF.

    Parameters
    ----------
    arm : str or path
        A name of `list_arms`. What ends in ``.toml`` or ``.urdf``, holds a path separator or is a `Path` is a file.

    Raises
    ------
    InputError
        If there is no such arm or file, or the file breaks a rule of its format.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.load_arm("ur10")
    Arm('ur10', 6 joints)
    """
    path = Path(arm)
    if isinstance(arm, Path) or path.suffix.lower() in _SUFFIXES or len(path.parts) > 1:
        return read_arm(path)
    files = _files()
    if arm not in files:
        close = difflib.get_close_matches(arm.lower(), files, n=1, cutoff=0.5)
        raise InputError(
            f"there is no arm {arm!r} in the catalogue; it has {', '.join(sorted(files))}",
            hint=close[0] if close else "give the path of an arm file (.toml) or a URDF (.urdf)",
        )
    with resources.as_file(files[arm]) as file:
        return read_arm(file)


def _files() -> dict[str, resources.abc.Traversable]:
    folder = resources.files("truearm.arm") / "arms"
    entries = (entry for entry in folder.iterdir() if entry.name.endswith(_SUFFIXES))
    return {entry.name.rpartition(".")[0]: entry for entry in entries}
