"""A plan as a session file to fill in, and the file of the lengths of its bar."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from truearm.arm import Arm
from truearm.files.atomic_write import atomic_file
from truearm.readings import Lengths
from truearm.typing import FloatArray, NameArray
from truearm.wings.planning.designs.candidates import Candidates
from truearm.wings.planning.designs.planned_readings import AIM
from truearm.wings.planning.designs.proposal import LENGTH_U_MM


def lengths_path(plan: str | Path) -> Path:
    """The file of the lengths that belongs to the file of a plan."""
    plan = Path(plan)
    return plan.with_name(f"{plan.stem}-lengths.csv")


def write_template(arm: Arm, poses: Candidates, path: str | Path) -> None:
    """Write poses as a session file to fill in.

    The angles to aim at are in columns of notes. The columns of the readings are empty, and a fit refuses the file
    before they are filled in: otherwise it would identify the nominal arm.

    Parameters
    ----------
    arm : Arm
    poses : Candidates
        In the order of measurement.
    path : path
        A file that exists is replaced.
    """
    names = {} if poses.seat is None else {"seat": poses.seat}
    if poses.length_mm is not None:
        names["position"] = place_names(poses)
    write_aims(arm, poses.angles, path, names=names, notes=notes(poses), points=poses.seat is None)


def write_aims(
    arm: Arm,
    angles: FloatArray,
    path: str | Path,
    *,
    names: Mapping[str, NameArray],
    notes: Sequence[str],
    points: bool = False,
) -> None:
    """Write angles to aim at as a session file to fill in.

    Parameters
    ----------
    arm : Arm
    angles : (n, n_joints) array
        In the order of measurement [rad, or mm].
    path : path
        A file that exists is replaced.
    names : mapping of str to (n,) array of str
        Columns of names, such as ``seat``.
    notes : sequence of str
        An instruction for each reading.
    points : bool
        Whether there are columns for reference points.
    """
    joints = [f"q{number}_{unit}" for number, unit in enumerate(arm.joint_units, start=1)]
    measured = [*joints, *(("x_mm", "y_mm", "z_mm") if points else ())]
    aims = np.where(arm.chain.is_prismatic, angles, np.degrees(angles)).tolist()
    rows: list[list[str]] = [[*measured, *names, "note", *(f"{AIM}{joint}" for joint in joints)]]
    for row, (note, aim) in enumerate(zip(notes, aims, strict=True)):
        named = [column[row] for column in names.values()]
        rows.append([*[""] * len(measured), *named, note, *(f"{angle:.1f}" for angle in aim)])
    _write_rows(path, rows)


def write_bar_lengths(poses: Candidates, path: str | Path) -> None:
    """Write the length of the bar at each of its places for a fit: one artefact with one certificate."""
    assert poses.length_mm is not None  # a bar has a length
    write_length_rows(bars(poses), poses.length_mm, LENGTH_U_MM, path)


def write_length_rows(ends: Sequence[tuple[str, str]], length_mm: float, u_mm: float, path: str | Path) -> None:
    """Write the planned length of a bar between pairs of seats, to be replaced by that of its certificate."""
    note = (
        "as planned; enter length and standard uncertainty from the certificate of the bar, and its expansion if known"
    )
    stated = f"{length_mm:g}", f"{u_mm:g}", f"bar {length_mm:g}", "", "", note
    _write_rows(path, [Lengths.form_columns, *((*pair, *stated) for pair in ends)])


def _write_rows(path: str | Path, rows: Iterable[Sequence[str]]) -> None:
    with atomic_file(path) as beside, beside.open("w", encoding="utf-8", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(rows)


def bars(poses: Candidates) -> list[tuple[str, str]]:
    """The two seats of every place of the bar at which both are used."""
    assert poses.seat is not None  # a bar has seats
    names = place_names(poses)
    found = [np.unique(poses.seat[names == name]).tolist() for name in dict.fromkeys(names.tolist())]
    return [(ends[0], ends[1]) for ends in found if len(ends) == 2]


def place_names(poses: Candidates) -> NameArray:
    """Name of the place of each reading: its seat, or the common part of the names of a bar's seats."""
    assert poses.seat is not None  # poses in seats
    return poses.seat if poses.length_mm is None else np.array([name[:-1] for name in poses.seat.tolist()])


def continue_seat_numbers(poses: Candidates, used: Iterable[str]) -> Candidates:
    """Number the places in the order of the poses, after the seats already used: the same name is the same seat."""
    if poses.seat is None:
        return poses
    letter = poses.seat[0][0]
    numbers = (re.fullmatch(rf"{letter}([0-9]{{1,9}})[ab]?", name) for name in used)
    numbers_used = [int(match[1]) for match in numbers if match]
    places = place_names(poses)
    number = {
        name: max(numbers_used, default=0) + count for count, name in enumerate(dict.fromkeys(places.tolist()), start=1)
    }
    named = [
        f"{letter}{number[place]}{seat[len(place) :]}"
        for place, seat in zip(places.tolist(), poses.seat.tolist(), strict=True)
    ]
    return replace(poses, seat=np.array(named))


def notes(poses: Candidates) -> list[str]:
    """Instruction for each pose."""
    if poses.seat is None:
        return ["tip visible to the tracker"] * len(poses.angles)
    instructions, before = [], ""
    places, points = place_names(poses), places_of_seats(poses)
    for row, seat in enumerate(poses.seat.tolist()):
        if places[row] == before:
            instructions.append(f"tip in seat {seat}")
            continue
        before = str(places[row])
        ends = dict.fromkeys(poses.seat[places == before].tolist())
        where = "; ".join("{} at x {:.0f} y {:.0f} z {:.0f} mm".format(end, *points[end]) for end in sorted(ends))
        what = "fix the seat" if poses.length_mm is None else "fix the bar"
        instructions.append(f"{what}, {where}; tip in seat {seat}")
    return instructions


def places_of_seats(poses: Candidates) -> dict[str, FloatArray]:
    """The point (3,) of each seat [mm], in the order of use."""
    assert poses.seat is not None  # poses in seats
    assert poses.seat_points is not None
    return {name: poses.seat_points[int(np.argmax(poses.seat == name))] for name in dict.fromkeys(poses.seat.tolist())}
