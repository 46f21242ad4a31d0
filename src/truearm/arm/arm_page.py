"""The page of an arm: a drawing to be turned, a slider for each joint, the tip's coordinates, and the tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.arm_drawing import arm_figure
from truearm.arm.arm_scene import arm_mechanism, joint_frames
from truearm.arm.denavit_hartenberg import DHTable
from truearm.arm.rigid_motions import xyz_rpy_from_frame
from truearm.pages.number_format import format_count, format_in_text, format_mm
from truearm.pages.page import Column, LabelledValue, Page, Section, Table
from truearm.pages.scene import Scene

_CHECKS = (
    "Does the file describe your arm? Read the joint angles that your arm displays, type them below, and compare the "
    "tip's coordinates with those that it displays or that you measure from its base. Then turn one joint of your arm "
    "at a time: its slider must move the drawing in the same direction. An arrow shows the positive direction of each "
    "joint."
)


def arm_page(arm: Arm, table: DHTable, *, facts: Sequence[tuple[str, str]] = ()) -> Page:
    """The page of an arm.

    Parameters
    ----------
    arm : Arm
    table : DHTable
        Its constants.
    facts : sequence of (str, str)
        Versions and sources, below the arm's own.
    """
    tip = arm.chain.tip_in_base(arm.working[None])[0]
    return Page(
        title=f"{arm.name}: the arm as its file describes it",
        subtitle=_answer(arm),
        summary=(
            LabelledValue("joints", arm.n_joints),
            LabelledValue("reach, at most", round(arm.chain.reach), "mm"),
            *(
                LabelledValue(f"tip {axis} in the working pose", round(float(value), 1), "mm")
                for axis, value in zip("xyz", tip, strict=True)
            ),
        ),
        sections=(
            Section("Turn it", _CHECKS, scenes=(_scene(arm),)),
            Section("Constants", tables=(_constants(arm, table), _limits(arm))),
            Section("Frames and masses", _frames_text(arm), tables=_details(arm), folded=True),
        ),
        facts=(("arm", arm.title), ("source", arm.source), ("serial number", arm.serial_number or "not stated"), *facts),
    )


def _answer(arm: Arm) -> str:
    slides = int(arm.chain.is_prismatic.sum())
    kinds = f", {slides} of them sliding" if slides else ""
    return (
        f"{format_count(arm.n_joints, 'joint')}{kinds}; the tip is at most {format_mm(round(arm.chain.reach))} from "
        "joint 1. Move the joints below and see where the tip goes."
    )


def _scene(arm: Arm) -> Scene:
    tip = arm.chain.tip_in_base(arm.working[None])[0]
    still = arm_figure(joint_frames(arm.chain, arm.working), tip, sliding=arm.chain.is_prismatic.tolist())
    return Scene(
        label=f"The arm {arm.name} in space, in its working pose at first: links, joint axes and tip",
        unit="mm",
        still=still,
        mechanism=arm_mechanism(arm, controls=True),
    )


def _constants(arm: Arm, table: DHTable) -> Table:
    columns = {
        "a": (table.a, "mm"),
        "d": (table.d, "mm"),
        "alpha": (np.degrees(table.alpha), "deg"),
        "theta": (np.degrees(table.theta), "deg"),
        "beta": (np.degrees(table.beta), "deg"),
        "b": (table.b, "mm"),
    }
    shown = {name: one for name, one in columns.items() if name not in ("beta", "b") or one[0].any()}
    rows = tuple(
        (f"J{i + 1}", *(round(float(values[i]), 6) + 0.0 for values, _ in shown.values())) for i in range(arm.n_joints)
    )
    kind = "modified (Craig)" if table.convention == "mdh" else "standard"
    heads = (Column("joint"), *(Column(name, unit, digits=6) for name, (_, unit) in shown.items()))
    return Table(heads, rows, f"Denavit-Hartenberg constants, {kind}")


def _limits(arm: Arm) -> Table:
    rows = []
    for i, name in enumerate(arm.joint_names):
        slides = arm.chain.is_prismatic[i]
        scale, unit = (1.0, "mm") if slides else (np.degrees(1.0), "deg")
        low, high, working = (scale * float(value) for value in (*arm.limits[i], arm.working[i]))
        ends = [f"{format_in_text(end, digits=4)} {unit}" if np.isfinite(end) else "none" for end in (low, high)]
        joint = f"J{i + 1}" if name == f"J{i + 1}" else f"J{i + 1} {name}"
        rows.append((joint, "slides" if slides else "turns", *ends, f"{format_in_text(working, digits=4)} {unit}"))
    heads = (Column("joint"), Column("kind"), Column("lower limit"), Column("upper limit"), Column("working pose"))
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
    rows = []
    for i, frame in enumerate(arm.chain.fixed):
        xyz, rpy = xyz_rpy_from_frame(frame)
        place = "before J1" if i == 0 else f"J{i} to J{i + 1}" if i < n else f"after J{n}"
        rows.append((place, *(round(float(one), 6) + 0.0 for one in (*xyz, *np.degrees(rpy)))))
    heads = [Column(name, unit, 6) for names, unit in (("xyz", "mm"), (("roll", "pitch", "yaw"), "deg")) for name in names]
    frames = Table((Column("motion"), *heads), tuple(rows), "Fixed motions between the joints")
    if arm.masses is None:
        return (frames,)
    masses = tuple(
        (f"link of J{i + 1}", float(mass), *(round(float(one), 3) + 0.0 for one in centre))
        for i, (mass, centre) in enumerate(zip(arm.masses.mass_kg, arm.masses.centre_in_joint_mm, strict=True))
    )
    columns = (Column("link"), Column("mass", "kg", 4), *(Column(f"centre {axis}", "mm", 4) for axis in "xyz"))
    return frames, Table(columns, masses, "Masses of the links; centres in the frame of the joint that moves the link")
