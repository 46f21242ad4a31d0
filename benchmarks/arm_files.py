"""Arm files: planted mistakes that the doctor shall name, angles in files of UR robots, the picture of the axes."""

from __future__ import annotations

import importlib.util
import itertools
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from scipy.spatial.transform import Rotation

import truearm as ta
from benchmarks.rows import RowResult, Rows, Target
from truearm.arm import Arm, Chain, chain_from_dh, load_arm
from truearm.arm.denavit_hartenberg import DHTable
from truearm.arm.description_mistakes import Interpretation, Mistake, likely_mistakes
from truearm.arm.kinematics_yaml import read_ur_kinematics
from truearm.arm.rigid_motions import frame_from_xyz_rpy, screw_x, screw_z
from truearm.arm.urdf import Ends, find_ends
from truearm.arm.urdf_tree import UrdfTree
from truearm.errors import InputError
from truearm.files.foreign_documents import parse_xml
from truearm.identification.judgement.description_check import DescriptionCheck, check_description
from truearm.identification.references.reference_table import reference_table
from truearm.pages.palette import GREY, INK, NAVY, ORANGE, TEAL
from truearm.pages.plotting import Figure, figure_style, make_panel
from truearm.readings import Lengths, Session
from truearm.typing import FloatArray

ROWS = Rows()

# Planted mistakes in arm files and tables of readings -----------------------------------------------------------------

READINGS = 60
# Arm, preset of its errors, strategy of the poses.
ARMS = (
    ("gao2017", "research", "box"),
    ("gao2017", "research", "uniform"),
    ("measuring7", "shop", "measuring"),
    ("measuring7", "worn", "uniform"),
    ("ur10", "shop", "measuring"),
    ("ur5", "research", "box"),
    ("panda", "research", "uniform"),
    ("wam", "shop", "uniform"),
)


def sessions(*, seats: bool, seed: int) -> Iterator[tuple[str, Arm, Session, Lengths | None]]:
    """Readings of virtual arms, with points or with seats and a bar."""
    kinds = {(name, preset): (name, preset, strategy) for name, preset, strategy in ARMS} if seats else {}
    for name, preset, strategy in kinds.values() or ARMS:
        arm = replace(load_arm(name), lower=None, upper=None)
        with_limits = load_arm(name)
        options = {"strategy": "seat", "seats": 3, "bars": 2, "reference": False} if seats else {"strategy": strategy}
        try:
            simulated = ta.simulate(with_limits, poses=READINGS, preset=preset, seed=seed, arm_seed=seed, **options)
        except InputError as error:
            print(f"{name} {preset}: {error}")
            continue
        yield f"{name} {preset}{'' if seats else ' ' + strategy}", arm, simulated.session, simulated.lengths


def planted(
    arm: Arm, session: Session, lengths: Lengths | None, mistake: Mistake
) -> tuple[Arm, Session, Lengths | None]:
    """Arm file and readings of a person who makes a mistake: without it they are right."""
    stated = Interpretation.stated(arm)
    mended = mistake.mend(stated)
    angles = np.linalg.solve(mended.angle_matrix, (session.angles - mended.angle_offset).T).T
    changes: dict[str, object] = {"angles": angles}
    if session.points is not None:
        points = session.points / mended.point_factor @ mended.points_turn  # it undoes itself
        changes["points"] = np.roll(points, mended.shift, axis=0)
        changes["point_std"] = None
    elif mended.shift:
        changes["seat"] = np.roll(session.seat, mended.shift)
    if mended.length_factor != 1 and lengths is not None:
        lengths = replace(lengths, length_mm=lengths.length_mm / mended.length_factor)
    table = wrong_table(stated.table, mended.table, mistake)
    wrong = replace(arm, chain=table.chain(), table=table)
    return wrong, replace(session, **changes), lengths


def wrong_table(right: DHTable, mended: DHTable, mistake: Mistake) -> DHTable:
    """The table that mending turns into the right one: exchanges undo themselves, factors do not."""
    if mistake.subject == "arm unit":
        factor = right.chain().reach / mended.chain().reach
        lengths = {name: factor * getattr(right, name) for name in ("a", "d", "b", "tip_in_flange")}
        frames = {name: getattr(right, name).copy() for name in ("base", "flange")}
        for frame in frames.values():
            frame[:3, 3] *= factor
        return replace(right, **lengths, **frames)
    if mistake.subject == "table angles":
        factor = np.abs(right.alpha).max() / np.abs(mended.alpha).max()
        return replace(right, alpha=factor * right.alpha, theta=factor * right.theta)
    return mended


def outcome(check: DescriptionCheck, mistake: Mistake) -> str:
    """What became of a planted mistake."""
    named = [name for one in check.findings for name in one.mistakes]
    aim = mistake.subject if mistake.subject == "convention" else mistake.description
    if any(("convention" in name) if aim == "convention" else name == aim for name in named):
        first = check.findings[0]
        return "named alone" if len(check.findings) == 1 else "named first" if aim in first.mistakes else "named beside"
    if not check.findings:
        return "not contradicted" if check.stated.is_usual else "nothing found"
    return "wrong proposal"


@ROWS.row("mistakes", quick={"every": 40})
def mistakes(seats: bool = False, every: int = 1) -> RowResult:
    """Planted mistakes in arm files and tables of readings: how often the doctor names them.

    Every mistake of `truearm.arm.description_mistakes` is planted, one at a time, into sessions of 60 readings with
    eight virtual arms, with `seats` of four arms with seats and a bar in place of points. A mistake that the readings
    do not contradict (the zero of joint 1 beside a free base) is counted apart.
    """
    table, whole = [], Counter[str]()
    for name, arm, session, lengths in sessions(seats=seats, seed=1):
        count, begun = Counter[str](), time.process_time()
        for mistake in likely_mistakes(arm, has_points=not seats, has_lengths=lengths is not None)[::every]:
            try:
                wrong, readings, between = planted(arm, session, lengths, mistake)
            except InputError:
                continue  # a length of kilometres
            count[outcome(check_description(wrong, reference_table(readings, between)), mistake)] += 1
        seconds = (time.process_time() - begun) / count.total()
        table.append({"arm": name, "n": count.total(), **count, "CPU s each": seconds})
        whole += count
    contradicted = whole.total() - whole["not contradicted"]
    named = sum(n for what, n in whole.items() if what.startswith("named"))
    note = f"{named} of {contradicted} mistakes that the readings contradict are named ({named / contradicted:.1%})"
    return RowResult(table, notes=[f"{note}; {whole['not contradicted']} others change nothing"])


@ROWS.row("right-arms", quick={"arms": 2})
def right_arms(arms: int = 100, seats: bool = False) -> RowResult:
    """False proposals of the doctor for right arms."""
    drawn = (one for seed in itertools.count(101) for one in sessions(seats=seats, seed=seed))
    table = []
    for name, arm, session, lengths in itertools.islice(drawn, arms):
        findings = check_description(arm, reference_table(session, lengths)).findings
        table += [{"arm": name, "proposed": str(one)} for one in findings[:1]]
    return RowResult(table, [Target(f"false proposals on {arms} right arms", len(table), 0)])


# Roll, pitch, yaw in kinematics files of UR robots --------------------------------------------------------------------

POSES = np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, 6))


class Constants(NamedTuple):
    """D-H constants of a controller [rad, m]."""

    theta: list[float]
    d: list[float]
    a: list[float]
    alpha: list[float]


# ruff: noqa: E501 (published numbers, a list of six a line)
ROBOTS = {
    "UR5": Constants(
        [-9.62699668632896e-06, -1.43707039992005, 2.02543119975016, -0.588254688694989, 4.13647390228702e-05, 8.1737464953645e-06],
        [0.0888794492754001, 574.241384579456, -507.363402098168, -66.7676839353205, 0.0949734691141216, 0.0825625014554953],
        [0.000279332356195598, -0.0566854832098269, -0.32646702272051, 1.49388687216263e-05, 2.23692592990586e-07, 0],
        [1.57033858830411, -0.000733893428160216, 0.00325607356326439, 1.57040005185553, -1.57101000328584, 0],
    ),
    "UR3": Constants(
        [9.14361764983717684e-08, 0.178461025123001604, 6.68283349819805572, -0.578116982609792496, 6.11299818305960363e-06, -5.03926212855332345e-07],
        [0.15199225352853909, 12.0620003757611567, 17.6719025641737275, -29.6216460369544869, 0.08532183538220463, 0.0821174204710821],
        [-0.000243788991999517813, -0.23983834581357648, -0.17874692154689506, 0.000107694612896758047, -0.000198736633205663144, 0],
        [1.5719524842607927, 0.0035851898103369975, 0.00392132336586574568, 1.5712029956830027, -1.572808030755058, 0],
    ),
    "UR10e": Constants(
        [-2.4147806894359e-07, 1.60233952386695, -1.68607190752171, 0.0837331147700119, -1.01260355871158e-07, 3.91986209186124e-08],
        [0.180539811714259, 439.140974079901, -446.027059806332, 7.0603368964236, 0.119811341150314, 0.115670917257426],
        [2.12234865571206e-05, 0.0193171326277006, -0.569251663611088, -4.61409023720934e-05, -6.39280053471802e-05, 0],
        [1.57014608044242, 0.0013941666682559, 0.00693818880325995, 1.56998468543761, -1.57038520649543, 0],
    ),
}  # fmt: skip


def links_of(robot: Constants, *, quadrants: bool) -> list[FloatArray]:
    """Poses of the links [m]: frames 2 and 3 slide along their axes to where the next axis crosses their xy plane.

    `quadrants`: whether the direction there is found in all four quadrants, as newer versions do.
    """
    own = [screw_z(theta, d) for theta, d in zip(robot.theta, robot.d, strict=True)]
    across = [screw_x(alpha, a) for alpha, a in zip(robot.alpha, robot.a, strict=True)]
    for i in (1, 2):
        passive = own[i] @ across[i]
        slide = passive[2, 3] / passive[2, 2]
        x, y, _ = passive[:3, 3] - slide * passive[:3, 2]
        turn = np.arctan2(-y, -x) if quadrants else np.arctan(y / x)
        after = screw_z(robot.theta[i] - turn, 0.0) @ screw_x(robot.alpha[i], 0.0)
        after[0, 3] = -np.hypot(x, y)
        own[i], across[i] = screw_z(turn, 0.0), after
        own[i + 1] = screw_z(0.0, slide) @ own[i + 1]
    return [own[0], *(across[i] @ own[i + 1] for i in range(5))]


def as_eigen_splits(link: FloatArray) -> FloatArray:
    """Roll, pitch, yaw of Rx Ry Rz with roll from 0 to pi, as Eigen's eulerAngles has it."""
    roll, pitch, yaw = Rotation.from_matrix(link[:3, :3]).as_euler("XYZ")
    return np.array([roll, pitch, yaw] if roll >= 0 else [roll + np.pi, np.pi - pitch, yaw + np.pi])


def errors_of(robot: Constants, *, quadrants: bool) -> dict[str, FloatArray]:
    """Distances [mm] of the file's tips from the controller's in both readings."""
    links = links_of(robot, quadrants=quadrants)
    end = screw_x(robot.alpha[5], 1000 * robot.a[5])
    a, d = 1000 * np.array(robot.a), 1000 * np.array(robot.d)
    true = chain_from_dh(a=a, d=d, alpha=robot.alpha, theta=robot.theta).tip_in_base(POSES)
    found = {}
    for reading in ("Rx Ry Rz", "URDF"):
        frames = []
        for link in links:
            rpy = as_eigen_splits(link)
            frame = frame_from_xyz_rpy(1000 * link[:3, 3], rpy)
            if reading == "Rx Ry Rz":
                frame[:3, :3] = Rotation.from_euler("XYZ", rpy).as_matrix()
            frames.append(frame)
        tips = Chain(np.array([*frames, end]), np.zeros(3)).tip_in_base(POSES)
        found[reading] = np.linalg.norm(tips - true, axis=1)
    return found


# URDFs of public collections -----------------------------------------------------------------------------------------

# Difference of two forward kinematics that is rounding [m].
SAME_M = 1e-7


def pinocchio_differs(path: Path, arm: Arm, ends: Ends) -> float:
    """Largest difference of an arm's tips from Pinocchio's at 20 poses [m]; joints beside the arm stay at zero."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(path))
    data, rng = model.createData(), np.random.default_rng(0)
    largest, body = 0.0, pinocchio.FrameType.BODY
    for _ in range(20):
        q, state = rng.uniform(-1, 1, arm.n_joints), pinocchio.neutral(model)
        for name, angle, slides in zip(arm.joint_names, q, arm.chain.is_prismatic, strict=True):
            joint = model.joints[model.getJointId(name)]
            state[joint.idx_q : joint.idx_q + joint.nq] = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
            q[arm.joint_names.index(name)] = angle * (1000 if slides else 1)
        pinocchio.framesForwardKinematics(model, data, state)
        at_base, at_tip = (data.oMf[model.getFrameId(link, body)] for link in (ends.base, ends.tip))
        tip_mm = 1000 * at_base.actInv(at_tip).translation
        largest = max(largest, float(np.abs(arm.chain.tip_in_base(q[None])[0] - tip_mm).max()) / 1000)
    return largest


@ROWS.row("urdf", quick={"folder": ""})
def urdf(folder: str = "") -> RowResult:
    """URDFs in a folder and below it: loaded by their file name alone, or refused and why; against Pinocchio.

    Where Pinocchio is installed, the tips of every arm are compared with its own.
    """
    counts, table, differ = Counter[str](), [], []
    for path in sorted(Path(folder).rglob("*.urdf")) if folder else ():
        try:
            arm, tree = load_arm(path), UrdfTree(parse_xml(path.read_bytes()))
        except InputError as error:
            said = str(error.problem)
            kind = next((kind for kind in ("arms could be meant", "no moving joint", "has no <") if kind in said), said)
            counts[kind] += 1
            continue
        counts["loaded"] += 1
        counts["loaded, with a remark on its tip"] += bool(arm.remarks)
        if importlib.util.find_spec("pinocchio") is not None:
            differ.append(pinocchio_differs(path, arm, find_ends(tree)))
    table = [{"what became of it": kind, "files": n} for kind, n in counts.most_common()]
    return RowResult(table, [Target(f"{len(differ)} arms against Pinocchio [m]", max(differ, default=None), SAME_M)])


@ROWS.row("ur-angles")
def ur_angles(files: tuple[str, ...] = ()) -> RowResult:
    """Roll, pitch, yaw of UR kinematics files, written as Rx Ry Rz, read as Rz Ry Rx: what that is worth.

    Robots whose controllers' constants are public: their files are computed as the driver's tool lays them out; forward
    kinematics of constants and file are compared in both readings over 2000 random poses. Of `files` the difference of
    the two readings.

    Sources of the constants: UR5 Universal_Robots_ROS_Driver 457; UR3 MyRobotLab/pyrobotlab 145, differences added to
    the nominal constants; UR10e the manual of ur_calibration.
    """
    table, targets = [], []
    for name, robot in ROBOTS.items():
        for version, quadrants in (("newer", True), ("older", False)):
            errors = errors_of(robot, quadrants=quadrants)
            for reading, off in errors.items():
                what = {"file": name, "versions": version, "read as": reading}
                table.append(what | {"mean [mm]": off.mean(), "max [mm]": off.max()})
            if quadrants:
                targets.append(Target(f"{name} as Rx Ry Rz [mm]", float(errors["Rx Ry Rz"].max()), 1e-8))
    for file in files:
        one, other = (
            read_ur_kinematics(Path(file), angles=angles).chain.tip_in_base(POSES) for angles in ("urdf", "controller")
        )
        off = np.linalg.norm(one - other, axis=1)
        table.append({"file": file, "read as": "either", "mean [mm]": off.mean(), "max [mm]": off.max()})
    return RowResult(table, targets)


# The picture of docs/describe-your-arm.md -----------------------------------------------------------------------------

ARM = "measuring7"
ARROW_MM = 170.0


def draw_arm(axes: Axes) -> None:
    """The arm in its working pose from the side: links, axes and lengths."""
    arm = load_arm(ARM)
    chain, frames = arm.chain, []
    frame = chain.fixed[0]
    for i, angle in enumerate(arm.working):
        frames.append(frame)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        frame = frame @ turn @ chain.fixed[i + 1]
    tip = frame[:3, :3] @ chain.tip_in_flange + frame[:3, 3]
    corners = np.array([one[:3, 3] for one in frames] + [tip])
    axes.plot(corners[:, 0], corners[:, 2], color=GREY, lw=7, solid_capstyle="round", alpha=0.45, zorder=1)
    axes.plot(*tip[[0, 2]], "o", color=TEAL, ms=7, zorder=4)
    axes.annotate("tip", tip[[0, 2]], xytext=(7, -4), textcoords="offset points", color=TEAL)
    for i, one in enumerate(frames):
        origin, z = one[[0, 2], 3], one[[0, 2], 2]
        draw_axis(axes, origin, z, f"J{i + 1}", across=bool(abs(one[1, 2]) > 0.5))
    for (a, b), words, offset in (
        ((0, 1), "d = 320", (10, -22)),
        ((2, 3), "d = 600", (-52, 16)),
        ((4, 5), "d = 470", (14, -6)),
        ((6, 7), "d + tip = 180", (-26, -24)),
    ):
        middle = corners[[a, b]][:, [0, 2]].mean(axis=0)
        axes.annotate(words, middle, xytext=offset, textcoords="offset points", color=INK)
    axes.set_aspect("equal")
    axes.set_title(f"{ARM} from the side [mm]")
    axes.set_xlim(-200, 1260)
    axes.set_ylim(-120, 1120)


def draw_axis(axes: Axes, origin: FloatArray, z: FloatArray, name: str, *, across: bool) -> None:
    """An axis in the picture as an arrow; one across it as a circle, with its point or its tail."""
    if across:
        axes.plot(*origin, "o", mfc="white", mec=ORANGE, mew=1.5, ms=11, zorder=3)
        axes.plot(*origin, "o", color=ORANGE, ms=3, zorder=4)
        axes.annotate(name, origin, xytext=(-20, -12), textcoords="offset points", color=ORANGE)
        return
    end = origin + ARROW_MM * z
    axes.annotate("", end, xytext=origin, arrowprops={"arrowstyle": "-|>", "color": NAVY, "lw": 1.6}, zorder=3)
    axes.annotate(name, end, xytext=(5, 5), textcoords="offset points", color=NAVY)


def draw_row(axes: Axes) -> None:
    """Two axes, their common normal, and the four numbers of a row, seen from obliquely above."""
    d, a, alpha = 1.0, 1.35, np.radians(55)
    points = {
        "below": [0, 0, -0.15],
        "start": [0, 0, 0],
        "normal": [0, 0, d],
        "above": [0, 0, d + 0.75],
        "next": [a, 0, d],
        "next end": [a, -0.95 * np.sin(alpha), d + 0.95 * np.cos(alpha)],
        "up": [a, 0, d + 0.8],
        "before": [0.75, 0.75, 0],
    }
    at = {name: (x + 0.42 * y, z + 0.30 * y) for name, (x, y, z) in points.items()}

    def arrow(start: str, end: str, colour: str) -> None:
        axes.annotate("", at[end], xytext=at[start], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8})

    arrow("below", "above", NAVY)
    arrow("next", "next end", NAVY)
    arrow("normal", "next", ORANGE)
    axes.plot(*zip(at["start"], at["before"], strict=True), ":", color=GREY)
    axes.plot(*zip(at["next"], at["up"], strict=True), ":", color=GREY)
    for name, words, offset, colour in (
        ("above", "axis i", (6, -4), NAVY),
        ("next end", "axis i + 1", (-62, 4), NAVY),
        ("before", "normal of the\nrow before", (4, -8), GREY),
    ):
        axes.annotate(words, at[name], xytext=offset, textcoords="offset points", color=colour)
    axes.text(-0.14, d / 2, "d", color=INK, ha="right", weight="bold")
    axes.text(a / 2, d + 0.06, "a", color=ORANGE, weight="bold")
    axes.text(0.38, 0.26, "theta", color=INK)
    axes.text(a + 0.06, d + 0.42, "alpha", color=INK)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title("From one axis to the next")
    axes.set_xlim(-0.35, 2.0)
    axes.set_ylim(-0.3, 2.0)


@ROWS.row("axes", is_long=True)
def axes(file: str = "axes_of_an_arm.png") -> RowResult:
    """Draw the axes and lengths of an arm, and the four numbers between two axes, into a file."""
    with figure_style():
        left, (of_arm,) = make_panel(3.7, 3.2)
        draw_arm(of_arm)
        right, (of_row,) = make_panel(3.2, 3.2)
        draw_row(of_row)
    figure = Figure((left, right), "Axes of an arm.", "Axes of an arm and one row of its table.", columns=2)
    figure.save(file)
    return RowResult(notes=[f"drawn into {file}"])
