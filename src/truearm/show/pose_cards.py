"""The poses of a plan one by one: in space, as a list, and as cards to print with a small drawing of the arm each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from truearm.arm import Arm
from truearm.identification.planning.candidates import Candidates
from truearm.identification.planning.sampling.workspace import joint_origins, stance
from truearm.identification.planning.template import notes
from truearm.identification.planning.tour import joint_moves
from truearm.number_format import format_count
from truearm.pages.cards import Card, CardSet
from truearm.pages.page import Cell, Column, Section, Table
from truearm.pages.plotting import Figure
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.show.arm_scene import arm_mechanism, joint_columns
from truearm.typing import FloatArray

_MINUS = "\N{MINUS SIGN}"


def poses_section(arm: Arm, poses: Candidates) -> Section:
    """The poses in the order of measurement, as a list to tick and as cards."""
    units = arm.joint_units
    joints = (Column(f"J{joint}", unit) for joint, unit in enumerate(units, start=1))
    rows: Iterator[tuple[Cell, ...]] = (
        ("\u2610", number, what, *aim)
        for number, (what, aim) in enumerate(zip(notes(poses), _aims(arm, poses), strict=True), start=1)
    )
    table = Table(
        Column.of("done", "pose", "instruction", *joints),
        tuple(rows),
        "In the order of measurement; tick each reading that is written down.",
    )
    return Section("Pose by pose", tables=(table,), cards=pose_cards(arm, poses))


def pose_cards(arm: Arm, poses: Candidates) -> CardSet:
    """A card for each pose, with the arm from the side and from above, its front to the right in both."""
    units, seats = arm.joint_units, [""] * len(poses.angles) if poses.seat is None else poses.seat.tolist()
    aims, instructions = _aims(arm, poses), notes(poses)
    base = np.zeros((len(poses.angles), 1, 3))
    tips = arm.chain.tip_in_base(poses.angles)
    lines = np.concatenate([base, joint_origins(arm.chain, poses.angles), tips[:, None]], axis=1)
    cards = [
        Card(
            title=f"Pose {number}",
            place=seats[number - 1] and f"seat {seats[number - 1]}",
            text=f"{instructions[number - 1][0].upper()}{instructions[number - 1][1:]}.",
            values=[
                (f"J{joint}", f"{str(aim).replace('-', _MINUS)}\u00a0{unit}")
                for joint, (aim, unit) in enumerate(zip(aims[number - 1], units, strict=True), start=1)
            ],
            lines=[line @ axes.T for axes in _views(arm)],
        )
        for number, line in enumerate(lines, start=1)
    ]
    where = "the tip" if poses.seat is None else "the tip in its seat"
    return CardSet(
        title="Cards: a drawing of each pose",
        caption=f"Blue: the arm as lines from joint to joint. Orange: {where}. Grey: the pose before. Left from the "
        "side, right from above; the front of the arm is to the right in both. On paper there are at most eight on "
        "a sheet.",
        views=("from the side", "from above"),
        cards=cards,
    )


def poses_scene(arm: Arm, poses: Candidates, still: Figure) -> Scene:
    """The tips in space, coloured by how far the joints turn; the arm goes to the pose that a reader points at."""
    n = len(poses.angles)
    moves = joint_moves(arm, poses.angles[:-1], poses.angles[1:])
    cloud = PointCloud(
        arm.chain.tip_in_base(poses.angles),
        [f"pose {number}" for number in range(1, n + 1)],
        [PointColumn("largest turn of a joint since the pose before", "deg", np.degrees([0.0, *moves]))],
        joint_columns(arm.chain.joint_angles(poses.angles), arm.chain.is_prismatic),
        noun="pose",
    )
    follows = [*range(arm.n_joints)]
    label = f"{format_count(n, 'pose')} in space, coloured by the largest turn; the arm goes to the one pointed at"
    return Scene(label, "mm", still, cloud, arm_mechanism(arm, start=poses.angles[0], follows=follows))


def _views(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Directions to the right and up in the base frame, (2, 3) each: from the side, and from above."""
    front = stance(arm).front_rad
    ahead, left = [np.cos(front), np.sin(front), 0.0], [-np.sin(front), np.cos(front), 0.0]
    return np.array([ahead, [0.0, 0.0, 1.0]]), np.array([ahead, left])


def _aims(arm: Arm, poses: Candidates) -> list[list[int]]:
    """Joint positions in whole degrees or mm."""
    aims: list[list[int]] = (
        np.where(arm.chain.is_prismatic, poses.angles, np.degrees(poses.angles)).round().astype(int).tolist()
    )
    return aims
