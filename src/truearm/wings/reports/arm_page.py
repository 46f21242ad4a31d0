"""The page of an arm: a drawing to be turned, a slider for each joint, the tip's coordinates, and the tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.arm import Arm, DHTable
from truearm.arm.rigid_motions import xyz_rpy_from_frame
from truearm.number_format import RoundedNumber, format_count, format_in_text, format_number, show_mm
from truearm.pages.drawings.arm_drawing import arm_figure
from truearm.pages.drawings.arm_scene import arm_mechanism, joint_frames
from truearm.pages.page import Column, Page, PageVerdict, Section, Table
from truearm.pages.scene import Scene
from truearm.typing import FloatArray

_DECIMALS = 4  # of a constant; finer ones are of no meaning
_CHECKS = (
    "Does the file describe your arm? Type the joint angles that your arm displays, and compare the tip's coordinates "
    "with those that it displays or that you measure from its base. Then turn one joint at a time: the drawing must "
    "turn the same way. An arrow shows the positive direction of each joint."
)


def arm_page(arm: Arm, table: DHTable, *, facts: Sequence[tuple[str, str]] = (), is_identified: bool = False) -> Page:
    """The page of an arm.

    Parameters
    ----------
    arm : Arm
    table : DHTable
        Its constants.
    facts : sequence of (str, str)
        Versions and sources, below the arm's own.
    is_identified : bool
        Whether it is the arm of a model, whose base is in the frame of the reference.
    """
    own = (("arm", arm.title), ("source", arm.source), ("serial number", arm.serial_number or "not stated"))
    return Page(
        title=f"{arm.name}: the arm that the model identified" if is_identified else f"{arm.name}: the arm in its file",
        verdict=PageVerdict(_answer(arm), detail="" if is_identified else _CHECKS),
        sections=(
            Section("Move it", scenes=(_scene(arm, from_origin=not is_identified),)),
            Section("Constants", tables=(_constants(arm, table), _limits(arm))),
            Section("Frames and masses", _frames_text(arm), tables=_details(arm), folded=True),
        ),
        facts=(*own, *facts),
    )


def _answer(arm: Arm) -> str:
    x, y, z = (format_number(round(one)) for one in arm.chain.tip_in_base(arm.working[None])[0].tolist())
    slides = int(arm.chain.is_prismatic.sum())
    kinds = f", {slides} of them sliding" if slides else ""
    return (
        f"{arm.name} has {format_count(arm.n_joints, 'joint')}{kinds}. In its working pose the tip is at "
        f"x {x}, y {y}, z {z} mm; it reaches at most {show_mm(round(arm.chain.reach))} from joint 1."
    )


def _scene(arm: Arm, *, from_origin: bool) -> Scene:
    tip = arm.chain.tip_in_base(arm.working[None])[0]
    still = arm_figure(joint_frames(arm.chain, arm.working), tip, sliding=arm.chain.is_prismatic.tolist())
    return Scene(
        label=f"The arm {arm.name} in space, in its working pose at first: links, joint axes and tip",
        unit="mm",
        still=still,
        mechanism=arm_mechanism(arm, controls=True, from_origin=from_origin),
    )


def _constants(arm: Arm, table: DHTable) -> Table:
    shown = table.used_columns()
    kind = "modified (Craig)" if table.convention == "mdh" else "standard"
    heads = (Column("joint"), *(Column(name, unit) for name, unit in (one.split("_") for one in shown)))
    names = [f"J{i + 1}" for i in range(arm.n_joints)]
    return _table(heads, names, list(shown.values()), f"Denavit-Hartenberg constants, {kind}")


def _limits(arm: Arm) -> Table:
    rows = []
    for i, (joint, unit) in enumerate(zip(arm.joint_labels, arm.joint_units, strict=True)):
        scale = 1.0 if unit == "mm" else np.degrees(1.0)
        low, high, working = (round(scale * float(value), 6) for value in (*arm.limits[i], arm.working[i]))
        ends = [f"{format_in_text(end, digits=4)} {unit}" if np.isfinite(end) else "none" for end in (low, high)]
        rows.append(
            (joint, "slides" if unit == "mm" else "turns", *ends, f"{format_in_text(working, digits=4)} {unit}")
        )
    heads = Column.of("joint", "kind", "lower limit", "upper limit", "working pose")
    return Table(heads, tuple(rows), "Joints")


def _frames_text(arm: Arm) -> str:
    x, y, z = (format_in_text(float(one), digits=4) for one in arm.chain.tip_in_flange)
    gravity = ", ".join(format_in_text(float(one), digits=4) for one in arm.gravity_direction)
    return (
        "Each fixed motion leads from one joint's frame to the next: a shift, and roll, pitch and yaw about the fixed "
        f"axes x, y and z. The tip is at {x}, {y}, {z} mm in the frame after the last one. Direction of gravity in the "
        f"base frame: {gravity}."
    )


def _details(arm: Arm) -> tuple[Table, ...]:
    n = arm.n_joints
    places = ["before J1", *(f"J{i} to J{i + 1}" for i in range(1, n)), f"after J{n}"]
    motions = [xyz_rpy_from_frame(frame) for frame in arm.chain.fixed]
    numbers = np.array([[*xyz, *np.degrees(rpy)] for xyz, rpy in motions])
    heads = [Column("motion"), *(Column(name, "mm") for name in "xyz")]
    heads += [Column(name, "deg") for name in ("roll", "pitch", "yaw")]
    frames = _table(heads, places, list(numbers.T), "Fixed motions between the joints")
    if arm.masses is None:
        return (frames,)
    links = [f"link of J{i + 1}" for i in range(n)]
    heads = [Column("link"), Column("mass", "kg"), *(Column(f"centre {axis}", "mm") for axis in "xyz")]
    caption = "Masses of the links; centres in the frame of the joint that moves the link"
    return frames, _table(heads, links, [arm.masses.mass_kg, *arm.masses.centre_in_joint_mm.T], caption)


def _column(values: FloatArray) -> list[RoundedNumber]:
    """Constants to as many decimals as they have, four at most: they are stated, not measured."""
    exact = (d for d in range(_DECIMALS) if np.abs(values - values.round(d)).max() < 10.0 ** -(_DECIMALS + 2))
    decimals = next(exact, _DECIMALS)
    return [RoundedNumber(float(value) + 0.0, 10.0 ** (1 - decimals)) for value in values]


def _table(heads: Sequence[Column], names: Sequence[str], columns: Sequence[FloatArray], caption: str) -> Table:
    rows = zip(names, *map(_column, columns), strict=True)
    return Table(tuple(heads), tuple(rows), caption)
