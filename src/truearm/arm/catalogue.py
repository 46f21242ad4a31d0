"""Arms in the box, each a file in ``arms/`` that states where its numbers come from."""

from __future__ import annotations

import difflib
import re
from importlib import resources
from pathlib import Path

from truearm.arm.arm import Arm
from truearm.arm.arm_files import read_arm
from truearm.arm.urdf import read_urdf
from truearm.errors import InputError

_SUFFIXES = (".toml", ".urdf")
_FILE_SUFFIXES = (*_SUFFIXES, ".yaml", ".yml", ".xacro")
# A URDF with the links between which the arm is, either may be empty: robot.urdf:base_link:tool0
_WITH_LINKS = re.compile(r"(?P<file>.+\.urdf):(?P<base>[^:]*):(?P<tip>[^:]*)", re.IGNORECASE | re.DOTALL)


def list_arms() -> tuple[str, ...]:
    """Return the names of the arms in the catalogue, in alphabetical order.

    Examples
    --------
    >>> import truearm as ta
    >>> "ur10" in ta.list_arms()
    True
    """
    return tuple(sorted(_files()))


def load_arm(arm: str | Path, *, base: str | None = None, tip: str | None = None) -> Arm:
    """Load an arm: by its name in the catalogue, or from an arm file, a URDF or a UR's kinematics yaml.

    Parameters
    ----------
    arm : str or path
        A name of `list_arms`. What ends in ``.toml``, ``.urdf`` or ``.yaml``, holds a path separator or is a `Path` is
        a file. After a URDF may stand the links between which the arm is, as in ``robot.urdf:base_link:tool0``; without
        one of them (``robot.urdf::tool0``) it is found: the arm's ``remarks`` say where others were possible.
    base, tip : str, optional
        The links in place of those after the file's name; only of a URDF.

    Raises
    ------
    InputError
        If there is no such arm or file, the file breaks a rule of its format, or links are given for an arm that is no
        URDF.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.load_arm("ur10")
    Arm('ur10', 6 joints)
    """
    path, stated_base, stated_tip = split_links(arm)
    base, tip = base or stated_base, tip or stated_tip
    if base or tip:
        if path.suffix.lower() != ".urdf":
            raise InputError(f"only a URDF has links to choose as base and tip, got the arm {str(arm)!r}")
        return read_urdf(path, base=base, tip=tip)
    if isinstance(arm, Path) or path.suffix.lower() in _FILE_SUFFIXES or len(path.parts) > 1:
        return read_arm(path)
    arm, files = str(arm), _files()
    if arm not in files:
        close = difflib.get_close_matches(arm.lower(), files, n=1, cutoff=0.5)
        raise InputError(
            f"there is no arm {arm!r} in the catalogue; it has {', '.join(sorted(files))}",
            hint=close[0] if close else "give the path of an arm file (.toml) or a URDF (.urdf)",
        )
    with resources.as_file(files[arm]) as file:
        return read_arm(file)


def arm_path(arm: str | Path) -> Path:
    """The file of an arm as `load_arm` takes it, without links after its name; of a name, no file that exists."""
    return split_links(arm)[0]


def split_links(arm: str | Path) -> tuple[Path, str | None, str | None]:
    """File or name of an arm, and the base and tip links after it (``FILE.urdf:BASE:TIP``); None where not stated."""
    found = _WITH_LINKS.fullmatch(str(arm))
    if found is None:
        return Path(arm), None, None
    return Path(found["file"]), found["base"] or None, found["tip"] or None


def _files() -> dict[str, resources.abc.Traversable]:
    folder = resources.files("truearm.arm") / "arms"
    entries = (entry for entry in folder.iterdir() if entry.name.endswith(_SUFFIXES))
    return {entry.name.rpartition(".")[0]: entry for entry in entries}
