"""Arms in the box, each a file in ``arms/`` that states where its numbers come from."""

from __future__ import annotations

import difflib
import re
import unicodedata
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.arm_files import read_arm
from truearm.errors import InputError

# With one of them begins the title of every arm that has a maker.
MAKERS = (
    "ABB, AUBO, Barrett, Denso, Dobot, Doosan, Elephant Robotics, Fanuc, Franka, Immersion, Interbotix, Kawasaki, "
    "Kinova, KUKA, Niryo, Stäubli, Techman, TheRobotStudio, UFACTORY, Universal Robots, Yaskawa"
)
# Characters at the end of a name in which one that is taken for another differs: ur10 and ur10e, ur5e and ur10e.
MOST_UNLIKE = 3
_SUFFIXES = (".toml", ".urdf")
_FILE_SUFFIXES = (*_SUFFIXES, ".yaml", ".yml", ".xacro", ".xml")
# A URDF or MJCF with the links between which the arm is, either may be empty: robot.urdf:base_link:tool0
_WITH_LINKS = re.compile(r"(?P<file>.+\.(?:urdf|xml)):(?P<base>[^:]*):(?P<tip>[^:]*)", re.IGNORECASE | re.DOTALL)
_TITLE = re.compile(r'\btitle ?= ?"([^"]*)"')  # of a TOML file and of a URDF


def list_arms(search: str = "") -> tuple[str, ...]:
    """Return the names of the arms in the catalogue, in alphabetical order.

    Parameters
    ----------
    search : str
        Words; only the arms whose name or title has all of them, whatever their case, blanks and dashes.

    Examples
    --------
    >>> import truearm as ta
    >>> "ur10" in ta.list_arms()
    True
    >>> ta.list_arms("kuka iiwa")
    ('iiwa14', 'iiwa7')
    """
    words = [_plain(word) for word in search.split()]
    if not words:
        return tuple(sorted(_files()))
    return tuple(name for name, title in _titles().items() if all(word in _plain(name + " " + title) for word in words))


def load_arm(arm: str | Path, *, base: str | None = None, tip: str | None = None) -> Arm:
    """Load an arm: by its name in the catalogue, or from an arm file, a URDF, an MJCF or a maker's kinematics yaml.

    Parameters
    ----------
    arm : str or path
        A name of `list_arms`, also as its maker writes it: ``"UR 5e"``, ``"KUKA KR 6 R900"``, ``"IRB 1200-5/0.9"``.
        What ends in ``.toml``, ``.urdf``, ``.xml`` (MJCF) or ``.yaml``, holds a path separator or is a `Path` is a
        file. After a URDF or MJCF may stand the links between which the arm is, as in ``robot.urdf:base_link:tool0``;
        without one of them (``robot.urdf::tool0``) it is found: the arm's ``remarks`` say where others were possible.
    base, tip : str, optional
        The links in place of those after the file's name; only of a URDF or MJCF.

    Raises
    ------
    InputError
        If there is no such arm or file, the file breaks a rule of its format, or links are given for an arm that is
        neither a URDF nor MJCF.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.load_arm("ur10")
    Arm('ur10', 6 joints)
    """
    path, stated_base, stated_tip = split_links(arm)
    base, tip = base or stated_base, tip or stated_tip
    if base or tip:
        if path.suffix.lower() not in (".urdf", ".xml"):
            raise InputError(f"only a URDF or MJCF has links to choose as base and tip, got the arm {str(arm)!r}")
        from truearm.arm import mjcf, urdf  # no arm of the catalogue waits for XML

        return (mjcf.read_mjcf if path.suffix.lower() == ".xml" else urdf.read_urdf)(path, base=base, tip=tip)
    name = None if isinstance(arm, Path) or path.suffix.lower() in _FILE_SUFFIXES else known_name(arm)
    if name is not None:
        return _of_catalogue(name)
    if isinstance(arm, Path) or path.suffix.lower() in _FILE_SUFFIXES or len(path.parts) > 1:
        return read_arm(path)
    known, plain = _known_names(), _plain(arm)
    longer = [one for one in known if plain and one.startswith(plain)]
    close = dict.fromkeys(known[one] for one in longer + difflib.get_close_matches(plain, known, n=6, cutoff=0.6))
    nearest = " or ".join(list(close)[:3])
    otherwise = "truearm arms lists all; or give the path of an arm file (.toml) or a URDF (.urdf)"
    raise InputError(
        f"there is no arm {arm!r} in the catalogue of {len(_files())} arms",
        hint=f"{nearest}; truearm arms lists all" if nearest else otherwise,
    )


@cache
def _of_catalogue(name: str) -> Arm:
    """An arm of the catalogue: one object, for which what follows from it is calculated once."""
    with resources.as_file(_files()[name]) as file:
        return read_arm(file)


def known_name(arm: str) -> str | None:
    """The name in the catalogue of an arm that may be written as its maker does; None if it is not there or a path."""
    if arm in _files():
        return arm
    without = re.sub(r"(?<=\w)/(?=\d)", "", arm)  # IRB 1200-5/0.9, M-710iC/50
    return None if "/" in without or "\\" in without else _known_names().get(_plain(without))


def similar_arms(arm: Arm) -> list[Arm]:
    """Other arms of the catalogue with joints like those of an arm and names like its name: ur10e beside ur10."""
    names = [name for name in _files() if name != arm.name and _is_like(name, arm.name)] if arm.name in _files() else []
    loaded = [_of_catalogue(name) for name in sorted(names)]
    return [one for one in loaded if np.array_equal(one.chain.is_prismatic, arm.chain.is_prismatic)]


def _is_like(name: str, other: str) -> bool:
    """Whether names differ in their last characters alone."""
    same = next((i for i, (a, b) in enumerate(zip(name, other, strict=False)) if a != b), min(len(name), len(other)))
    return same >= 2 and max(len(name), len(other)) - same <= MOST_UNLIKE


def maker_of(title: str) -> str:
    """The maker with whose name an arm's title begins; empty if with none."""
    return next((maker for maker in MAKERS.split(", ") if title.startswith(f"{maker} ")), "")


def arm_path(arm: str | Path) -> Path:
    """The file of an arm as `load_arm` takes it, without links after its name; of a name, no file that exists."""
    return split_links(arm)[0]


def split_links(arm: str | Path) -> tuple[Path, str | None, str | None]:
    """File or name of an arm, and the base and tip links after it (``FILE.urdf:BASE:TIP``); None where not stated."""
    found = _WITH_LINKS.fullmatch(str(arm))
    if found is None:
        return Path(arm), None, None
    return Path(found["file"]), found["base"] or None, found["tip"] or None


def _plain(text: str) -> str:
    """Letters and digits alone, small and without accents."""
    letters = unicodedata.normalize("NFKD", text).casefold()
    return "".join(letter for letter in letters if letter.isalnum())


@cache
def _known_names() -> dict[str, str]:
    """Every way to write an arm, plain: its name and the model that its title begins with, with and without maker."""
    found = {}
    for name, title in _titles().items():
        maker, model = maker_of(title), re.split(r"[,(;]| with ", title)[0]
        for written in (model.removeprefix(maker), model, f"{maker}{name}", name):
            found[_plain(written)] = name
    return found


@cache
def _titles() -> dict[str, str]:
    found = {name: _TITLE.search(file.read_text("utf-8")) for name, file in sorted(_files().items())}
    return {name: title[1] if title else "" for name, title in found.items()}


@cache
def _files() -> dict[str, resources.abc.Traversable]:
    folder = resources.files("truearm.arm") / "arms"
    entries = (entry for entry in folder.iterdir() if entry.name.endswith(_SUFFIXES))
    return {entry.name.rpartition(".")[0]: entry for entry in entries}
