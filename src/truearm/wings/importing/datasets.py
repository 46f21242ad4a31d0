"""Real arms measured by others: joint angles with an external reference, from their public repositories.

The files are not part of this package. truearm searches the folder named by the environment variable ``TRUEARM_DATA``,
then ``../shared/datasets`` beside the working directory or the checkout; otherwise it downloads them once, at a pinned
commit. Their checksums must always fit (``datasets.sha256`` beside this file).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from truearm.errors import InputError
from truearm.readings import Lengths, Session
from truearm.readings.columns import AngleUnit
from truearm.wings.importing.foreign.table_columns import JointScale, TableColumns
from truearm.wings.importing.foreign.tables import import_table

Source = Literal["ipa_ur10_leica", "tsinghua_ur5_wam", "mukca_ball_socket"]
MukcaRobot: TypeAlias = Literal["panda_1", "panda_2", "panda_3", "dinova_1"]

# Where each folder comes from: https://github.com/<repository>, at this commit. All three are under the MIT licence.
UPSTREAM: dict[Source, str] = {
    "ipa_ur10_leica": "christianlandgraf/ipa-robot-accuracy/507fba69bdaf6c43c2faf306e70a7e37c5e39b89",
    "tsinghua_ur5_wam": "pauljac7700/serial_robots_datasets/759068d85a8b95183cd71ff96d9dfc5173bc57fc",
    "mukca_ball_socket": "platonics-delft/kinematics_calibration/05a05ab4cbbe328c8f5bfcc76479c752ed07b82e",
}

CITATION: dict[Source, str] = {
    "ipa_ur10_leica": "Landgraf, Ernst, Schleth, Fabritius, Huber, IEEE CASE 2021, pp. 468-474",
    "tsinghua_ur5_wam": "Jacobi, thesis, Tsinghua University, 2025",
    "mukca_ball_socket": "Franzese, Spahn, Kober, Della Santina, arXiv 2503.12584",
}

_RAW = "https://raw.githubusercontent.com"

_UR_JOINTS = tuple(f"{j}_joint" for j in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))


@dataclass(frozen=True)
class DataSet:
    """A published set of readings.

    Attributes
    ----------
    source : str
        Its folder, and the key of `UPSTREAM` and `CITATION`.
    path : str
        Its file in the folder, or a folder of files.
    title : str
        Arm, number of readings and reference, in a few words.
    arm : str
        Name of the nominal arm in the catalogue.
    angle_unit : {"deg", "rad"}
        The unit in which it was published.
    load : callable
        Function that reads it.
    lengths : callable, optional
        Function that returns the known lengths between its seats.
    """

    source: Source
    path: str
    title: str
    arm: str
    angle_unit: AngleUnit
    load: Callable[[], Session]
    lengths: Callable[[], Lengths] | None = None


def load_readings(name: str) -> Session:
    """Load a set by its name in `DATASETS`."""
    return _named(name).load()


def load_lengths(name: str) -> Lengths | None:
    """Load the known lengths between the seats of a set, by its name in `DATASETS`; None if there are none."""
    lengths = _named(name).lengths
    return None if lengths is None else lengths()


def load_ur10_leica(series: Literal["A", "B"]) -> Session:
    """Load the UR10 measured by a laser tracker (Fraunhofer IPA).

    Parameters
    ----------
    series : {"A", "B"}
        A: 11911 readings at 619 goal positions with many orientations each, July 2020. B: 1495 readings at 154 goal
        positions with about 10 joint configurations each, November 2020, with standard uncertainties.

    Returns
    -------
    Session
        Joint angles, points in the tracker's frame, temperature; `position` is the goal x, y, z [m].
    """
    if series not in ("A", "B"):
        raise InputError(f"expected series A or B, got {series!r}")
    columns = TableColumns(
        _UR_JOINTS,
        [f"measurement_{axis}" for axis in "xyz"],
        [f"measurement_std_{axis}" for axis in "xyz"] if series == "B" else (),
        temperature="measurement_temperature",
        position=[f"Goal {axis}" for axis in "xyz"],
    )
    return import_table(
        fetch(f"ur10-{series.lower()}"),
        columns,
        JointScale("rad"),
        separator=";",
        decimal=",",
        session_name=f"series {series}",
    )


def load_ur5() -> Session:
    """Load the UR5 measured by a laser tracker (Tsinghua University): 1000 readings, each its own position.

    The publisher gives differences from the targets without their sign; here they are added, as for the WAM.

    Returns
    -------
    Session
        Commanded angles; points in the base frame of the nominal robot.
    """
    return _load_tsinghua("ur5", 6)


def load_wam() -> Session:
    """Load the Barrett WAM measured by a laser tracker (Tsinghua University): 216 readings, each its own position.

    The publisher gives differences from the targets without their sign; added, they let the arm sag, as it must.

    Returns
    -------
    Session
        Commanded angles; points in the base frame of the nominal robot.
    """
    return _load_tsinghua("wam", 7)


def load_mukca(robot: MukcaRobot, *positions: str) -> Session:
    """Load a hand-guided ball held in sockets (TU Delft, MUKCa): angles and seats, no reference points.

    The two sockets of one tool position are 50 mm apart: `load_mukca_lengths`.

    Parameters
    ----------
    robot : {"panda_1", "panda_2", "panda_3", "dinova_1"}
        Franka (7 joints), or Kinova Gen3 lite (6 joints).
    *positions : str
        Tool positions, such as ``front``; all of the robot's by default.

    Returns
    -------
    Session
        `seat` is ``robot/position/hole_0`` or ``hole_1``, `position` is ``robot/position``.
    """
    folder = fetch(f"mukca-{robot}")
    n_joints = 6 if robot.startswith("dinova") else 7
    columns = TableColumns([str(i + 1) for i in range(n_joints)])
    angles, seats = [], []
    for position in _tool_positions(robot, positions):
        for hole in ("hole_0", "hole_1"):
            part = import_table(folder / position / f"{hole}.csv", columns, JointScale("rad"), header=False)
            angles.append(part.angles)
            seats += [f"{robot}/{position}/{hole}"] * len(part)
    return Session(
        np.concatenate(angles), seat=np.array(seats), position=np.array([s.rpartition("/")[0] for s in seats])
    )


def load_mukca_lengths(robot: MukcaRobot, *positions: str) -> Lengths:
    """Return the distance between the two sockets of every tool position of `load_mukca`: 50 mm.

    The publisher states no uncertainty. The sockets are in one 3D-printed part; a standard uncertainty of
    `MUKCA_U_MM` is assumed, and it is the same part at every position.
    """
    chosen = [f"{robot}/{position}" for position in _tool_positions(robot, positions)]
    n = len(chosen)
    hole_0, hole_1 = (np.array([f"{position}/{hole}" for position in chosen]) for hole in ("hole_0", "hole_1"))
    part = np.full(n, "printed part")
    return Lengths(hole_0, hole_1, np.full(n, MUKCA_LENGTH_MM), np.full(n, MUKCA_U_MM), artefact=part)


# Distance of the sockets as published, and the standard uncertainty of a printed part: our assumption.
MUKCA_LENGTH_MM = 50.0
MUKCA_U_MM = 0.1

_MUKCA: tuple[tuple[MukcaRobot, str, str], ...] = (
    ("panda_1", "Franka Panda, 182 readings", "panda"),
    ("panda_2", "Franka Panda, 559 readings", "panda"),
    ("panda_3", "Franka Panda, 387 readings", "panda"),
    ("dinova_1", "Kinova Gen3 lite, 137 readings", "gen3lite"),
)

DATASETS: dict[str, DataSet] = {
    "ur10-a": DataSet(
        "ipa_ur10_leica",
        "Series_A/measurements_grid.csv",
        "UR10, 11911 readings, laser tracker",
        "ur10",
        "rad",
        partial(load_ur10_leica, "A"),
    ),
    "ur10-b": DataSet(
        "ipa_ur10_leica",
        "Series_B/measurements_joint_configurations.csv",
        "UR10, 1495 readings, laser tracker",
        "ur10",
        "rad",
        partial(load_ur10_leica, "B"),
    ),
    "ur5": DataSet(
        "tsinghua_ur5_wam",
        "UR5/3D_UR5_uncalibrated_grid_cleaned.csv",
        "UR5, 1000 readings, laser tracker",
        "ur5",
        "deg",
        load_ur5,
    ),
    "wam": DataSet(
        "tsinghua_ur5_wam",
        "WAM/3D_WAM_uncalibrated_grid_cleaned.csv",
        "Barrett WAM, 216 readings, laser tracker",
        "wam",
        "deg",
        load_wam,
    ),
    **{
        f"mukca-{robot}": DataSet(
            "mukca_ball_socket",
            f"data/{robot}",
            f"{title}, a ball in sockets",
            arm,
            "rad",
            partial(load_mukca, robot),
            partial(load_mukca_lengths, robot),
        )
        for robot, title, arm in _MUKCA
    },
}


def find_local(name: str) -> Path | None:
    """Find a set on this computer, without downloading it.

    Returns
    -------
    Path or None
        Its file, or its folder of files.

    Raises
    ------
    InputError
        If the name is unknown, or a file is there but differs from the published one.
    """
    data_set = _named(name)
    for root in [*_local_folders(), _cache()]:
        folder = root / data_set.source
        if all((folder / path).is_file() for path in _files(data_set)):
            for path, checksum in _files(data_set).items():
                _check(folder / path, checksum)
            return folder / data_set.path
    return None


def fetch(name: str) -> Path:
    """Find a set, or download it once to the user's cache folder.

    Returns
    -------
    Path
        Its file, or its folder of files, with the published checksums.

    Raises
    ------
    InputError
        If the name is unknown, a file differs from the published one, or the download fails.
    """
    found = find_local(name)
    if found is not None:
        return found
    data_set = _named(name)
    for path, checksum in _files(data_set).items():
        _download(data_set.source, path, checksum)
    return _cache() / data_set.source / data_set.path


def _named(name: str) -> DataSet:
    if name not in DATASETS:
        raise InputError(f"there is no data set {name!r}", hint=", ".join(DATASETS))
    return DATASETS[name]


def _load_tsinghua(name: str, n_joints: int) -> Session:
    path, targets = fetch(name), ("x_t", "y_t", "z_t")
    joints = [f"joint_{i + 1}" for i in range(n_joints)]
    target = import_table(path, TableColumns(joints, targets, position=targets), JointScale("deg"), point_unit="mm")
    off = import_table(path, TableColumns(joints, ("x_dif", "y_dif", "z_dif")), JointScale("deg"), point_unit="mm")
    assert target.points is not None
    assert off.points is not None
    # The publisher does not say the sign of the differences. Added to the target, they let the cable-driven WAM sag,
    # as gravity demands.
    return replace(target, points=target.points + off.points)


def _tool_positions(robot: MukcaRobot, chosen: Sequence[str]) -> Sequence[str]:
    """The tool positions chosen, or all that the robot has."""
    present = sorted({path.split("/")[-2] for path in _files(_named(f"mukca-{robot}"))})
    if unknown := [p for p in chosen if p not in present]:
        raise InputError(f"{robot} has no tool position {unknown[0]!r}", hint=f"one of {', '.join(present)}")
    return chosen or present


@cache
def _registry() -> dict[str, str]:
    """Read the checksums of all files by their path, as `sha256sum` writes and checks them."""
    text = resources.files("truearm.wings.importing").joinpath("datasets.sha256").read_text(encoding="utf-8")
    lines = (line.split(maxsplit=1) for line in text.splitlines())
    return {path: checksum for checksum, path in lines}


def _files(data_set: DataSet) -> dict[str, str]:
    """List a set's files, relative to its source, with their checksums."""
    start = f"{data_set.source}/"
    own = {path.removeprefix(start): checksum for path, checksum in _registry().items() if path.startswith(start)}
    return {p: c for p, c in own.items() if p == data_set.path or p.startswith(f"{data_set.path}/")}


def _local_folders() -> list[Path]:
    folders = []
    if named := os.environ.get("TRUEARM_DATA"):
        if not Path(named).is_dir():
            raise InputError(
                "TRUEARM_DATA names a folder that does not exist",
                file=named,
                hint="unset TRUEARM_DATA or create the folder",
            )
        folders.append(Path(named))
    checkout = next((p for p in Path(__file__).resolve().parents if (p / "pyproject.toml").is_file()), None)
    for beside in (Path.cwd(), checkout):
        if beside is not None:
            folders.append(beside.parent / "shared" / "datasets")
    return folders


def _cache() -> Path:
    import pooch

    return Path(pooch.os_cache("truearm"))


def _check(path: Path, checksum: str) -> None:
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() == checksum:
        return
    unix = content.replace(b"\r\n", b"\n")
    endings = (unix, unix.replace(b"\n", b"\r\n"))
    only_endings = any(hashlib.sha256(c).hexdigest() == checksum for c in endings)
    raise InputError(
        "the file differs from the published one" + (" in its line ends" if only_endings else ""),
        file=path,
        hint="delete the file; truearm then downloads it again",
    )


def _download(source: Source, path: str, checksum: str) -> None:
    """Download one file to the cache; pooch writes beside, checks and renames."""
    import pooch

    url = f"{_RAW}/{UPSTREAM[source]}/{path}"
    target = _cache() / source / path
    pooch.get_logger().setLevel("WARNING")
    try:
        pooch.retrieve(url, known_hash=f"sha256:{checksum}", fname=target.name, path=target.parent)
    except ValueError:
        raise InputError(
            f"the download from {url} differs from the published file",
            hint="try again later; a proxy may have answered",
        ) from None
    except OSError as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{url} cannot be downloaded ({reason[:200]})",
            hint=f"download it elsewhere, save it as DIR/{source}/{path} and set TRUEARM_DATA=DIR",
        ) from None
