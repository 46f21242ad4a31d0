"""The page of a plan: predicted uncertainty, places of the artefact, ranges of the joints, limitations, each pose.

The poses stand one by one, in space, as a list, and as cards to print with a small drawing of the arm each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.arm import Arm
from truearm.number_format import format_count, format_number, show_mm
from truearm.pages.cards import Card, CardSet
from truearm.pages.drawings.arm_scene import arm_mechanism, joint_columns
from truearm.pages.drawings.joint_figures import joint_ranges
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, Table
from truearm.pages.palette import INK, LIMIT, NAVY, ORANGE, PAPER
from truearm.pages.plotting import Figure, figure_style, make_panel, make_view, set_log_scale, styles_of
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.typing import FloatArray
from truearm.wings.planning.designs import Strategy
from truearm.wings.planning.designs.candidates import Candidates
from truearm.wings.planning.designs.plan import SessionPlan
from truearm.wings.planning.designs.proposal import CalibrationPlan, Proposal
from truearm.wings.planning.designs.template import bars, notes, place_names, places_of_seats
from truearm.wings.planning.designs.tour import joint_moves
from truearm.wings.planning.designs.workspace import joint_origins, stance

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


_MOST_ARMS = 40  # drawn in one figure

CRITERIA = {
    "i-optimal": "smallest uncertainty of a point in the volume",
    "d-optimal": "smallest overall parameter uncertainty",
    "technician": "poses as a person chooses them who measures parts",
    "random": "random poses",
}


def plan_page(planned: SessionPlan, *, facts: Sequence[tuple[str, str]] = ()) -> Page:
    """Lay out the plan of a session.

    Parameters
    ----------
    planned : SessionPlan
    facts : sequence of (str, str)
        Inputs of the plan, as label and value.
    """
    plan, poses = planned.plan, planned.poses
    artefact = {"tracker": "with a tracker", "seat": "in seats", "bar": "with a bar"}[plan.artefact.kind]
    apart = ", apart from the scale" if plan.artefact.kind == "seat" else ""
    return Page(
        title=f"{plan.arm.name}: {format_count(len(poses), 'pose')} to measure {artefact}",
        subtitle=f"{planned.strategy}: {CRITERIA[planned.strategy]}.",
        summary=(
            LabelledValue(f"uncertainty in the volume after these poses{apart}", planned.after_mm, "mm"),
            LabelledValue("before", planned.before_mm, "mm"),
            LabelledValue("poses", len(poses)),
        ),
        sections=(
            _gain(plan, apart),
            _where(plan, poses),
            _how(plan, poses),
            Section("What this plan cannot determine", "\n\n".join(planned.limitations)),
            poses_section(plan.arm, poses),
            _observability(plan),
        ),
        facts=tuple(facts),
        verdict=PageVerdict(
            f"{format_count(len(poses), 'pose')} bring the uncertainty of a point{apart} to "
            f"{show_mm(planned.after_mm)}.",
            detail=f"Before, it is {show_mm(planned.before_mm)}. Three-dimensional root mean square in the volume, "
            "as predicted for the nominal arm.",
        ),
    )


def course_figure(proposals: Mapping[Strategy, Proposal]) -> Figure:
    """Draw the uncertainty in the volume against the number of poses, one line per strategy."""
    pens = styles_of(proposals)
    with figure_style():
        drawing, (axes,) = make_panel(5.4, 3.4)
        lowest, highest, most = np.inf, 0.0, 1
        for name, proposal in proposals.items():
            counts, rms = proposal.counts[1:], proposal.rms_mm[1:]
            pen = pens[name]
            axes.plot(counts, rms, color=pen.colour, linestyle=pen.dash, marker=pen.marker, markersize=3, label=name)
            lowest, highest, most = min(lowest, rms.min()), max(highest, rms.max()), max(most, int(counts[-1]))
        set_log_scale(axes, "y", lowest / 1.3, highest * 1.3)
        set_log_scale(axes, "x", 0.95, most * 1.1 if most > 1 else 2)
        axes.set(xlabel="poses", ylabel="uncertainty [mm]")
        axes.legend(loc="lower left")
    ends = "; ".join(f"{name} {show_mm(float(p.rms_mm[-1]))}" for name, p in proposals.items())
    return Figure(
        (drawing,),
        caption="Predicted uncertainty of a point in the volume, three-dimensional root mean square, against the "
        f"number of poses, each strategy in the order of its own plan. With all poses: {ends}.",
        alt=f"Falling curves of the uncertainty against the number of poses. With all poses: {ends}.",
    )


def places_figure(plan: CalibrationPlan, poses: Candidates) -> Figure:
    """Draw seats, bars or tips in the volume, from above and from the side."""
    tips = plan.arm.chain.tip_in_base(plan.volume)
    with figure_style():
        panels = tuple(_view(plan, tips, side=side) for side in (False, True))
        for (_, axes, view), side in zip(panels, (False, True), strict=True):
            axes.scatter(*_flat(view, tips), s=5, color=LIMIT, alpha=0.5, linewidths=0, zorder=1)
            _arm(axes, view, plan, plan.arm.working, colour=LIMIT, width=2.2)
            if poses.seat is None:
                axes.scatter(
                    *_flat(view, plan.arm.chain.tip_in_base(poses.angles)), s=9, color=NAVY, linewidths=0, zorder=4
                )
            else:
                _artefacts(axes, view, poses, label=not side or len(set(place_names(poses).tolist())) < 9)
    what = {
        "tracker": "Dark dots: the tip at the poses to measure.",
        "seat": "Orange: the seats.",
        "bar": "Orange: the bar at its places.",
    }[plan.artefact.kind]
    return Figure(
        tuple(drawing for drawing, _, _ in panels),
        caption=f"{what} Pale dots: tips in the volume, in poses of a person who measures there. Grey: the nominal arm "
        "in its working pose. Coordinates in the base frame; ahead points to the middle of the volume.",
        alt=f"The volume from above and from the side. {what}",
        columns=2,
    )


def poses_figure(plan: CalibrationPlan, angles: FloatArray) -> Figure:
    """Draw the arm at the poses, from above and from the side."""
    shown = angles[np.unique(np.linspace(0, len(angles) - 1, _MOST_ARMS).round().astype(int))]
    tips = plan.arm.chain.tip_in_base(shown)
    with figure_style():
        panels = tuple(_view(plan, joint_origins(plan.arm.chain, shown).reshape(-1, 3), side=s) for s in (False, True))
        for _, axes, view in panels:
            for pose in shown:
                _arm(axes, view, plan, pose, colour=NAVY, width=0.7, alpha=0.45)
            axes.scatter(*_flat(view, tips), s=7, color=ORANGE, linewidths=0, zorder=4)
    number = format_count(len(shown), "pose")
    return Figure(
        tuple(drawing for drawing, _, _ in panels),
        caption=f"The arm in {len(shown)} of {format_number(len(angles))} poses, as lines from joint to joint. "
        "Orange: the tip.",
        alt=f"The arm in {number}, from above and from the side, as lines from joint to joint.",
        columns=2,
    )


def _gain(plan: CalibrationPlan, apart: str) -> Section:
    rows = tuple((name, CRITERIA[name], float(proposal.rms_mm[-1])) for name, proposal in plan.proposals.items())
    columns = Column.of("strategy", "criterion", "uncertainty after [mm]")
    return Section(
        "What these poses bring",
        "truearm predicts the uncertainty of a point from the nominal arm, the prior knowledge of its terms and the "
        f"noise of a coordinate ({show_mm(plan.prior.noise_mm)}). It is the uncertainty of points relative to each "
        f"other{apart}. Effects without a term are not included.",
        figures=(course_figure(plan.proposals),),
        tables=(Table(columns, rows, "All strategies, with the same number of poses."),),
    )


def _observability(plan: CalibrationPlan) -> Section:
    rows = []
    for name, proposal in plan.proposals.items():
        result = proposal.observability
        indices = [getattr(result, f"o{number}") for number in range(1, 6)]
        rows.append((name, *indices, f"{result.rank}\u00a0of\u00a0{result.n_parameters}"))
    columns = Column.of("strategy", *(Column(f"O{number}") for number in range(1, 6)), "rank")
    return Section(
        "Observability indices",
        "O1 to O5 are the observability indices of the terms, from the new poses alone; each coefficient is scaled by "
        "its prior standard deviation. Larger is better. The rank is the number of identifiable combinations of the "
        "coefficients; the others do not move the tip, or only together with these.",
        tables=(Table(columns, tuple(rows), "All strategies, with the same number of poses."),),
        folded=True,
    )


def _where(plan: CalibrationPlan, poses: Candidates) -> Section:
    text = {
        "tracker": "The tip is in the volume in every pose. Check that the tracker sees it there.",
        "seat": "Fix each seat near its place in the figure; a few centimetres do not matter. It must not move while "
        "you measure in it.",
        "bar": "Fix the bar near its places in the figure; a few centimetres do not matter. It must not move while you "
        "measure at one place.",
    }[plan.artefact.kind]
    tables = () if poses.seat is None else (_places_table(poses),)
    return Section(
        "Where to put the artefact" if poses.seat is not None else "Where the tip is",
        text,
        figures=(places_figure(plan, poses),),
        tables=tables,
    )


def _places_table(poses: Candidates) -> Table:
    rows = tuple(
        (name, *point.round().astype(int).tolist(), int(np.sum(poses.seat == name)))
        for name, point in places_of_seats(poses).items()
    )
    columns = Column.of("seat", "x [mm]", "y [mm]", "z [mm]", "poses")
    return Table(columns, rows, "Seats in the base frame, in the order of use.")


def _how(plan: CalibrationPlan, poses: Candidates) -> Section:
    arm = plan.arm
    lower, upper = arm.limits.T
    caption = f"Range of each joint over {format_count(len(poses.angles), 'pose')}."
    slides = arm.chain.is_prismatic.tolist()
    ranges = joint_ranges(poses.angles, lower=lower, upper=upper, sliding=slides, caption=caption)
    return Section(
        "Poses",
        "Move near each pose; a few degrees do not matter. Write down what the encoders read. The poses respect the "
        "joint limits and keep all joints above the table. Collisions of the arm with itself are not checked.",
        scenes=(poses_scene(arm, poses, poses_figure(plan, poses.angles)),),
        figures=(ranges,),
    )


def _flat(view: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    across, up = view @ points.T
    return across, up


def _view(plan: CalibrationPlan, points: FloatArray, *, side: bool) -> tuple[Drawing, Axes, FloatArray]:
    """A view of the points, the base and the working pose."""
    seen = [points, joint_origins(plan.arm.chain, plan.arm.working[None])[0], np.zeros((1, 3))]
    view = _views(plan.arm)[0] if side else np.eye(3)[:2]
    flat = view @ np.concatenate(seen).T
    labels, title = (("ahead [mm]", "z [mm]"), "from the side") if side else (("x [mm]", "y [mm]"), "from above")
    return *make_view((4.6, 3.9), flat.min(axis=1), flat.max(axis=1), labels=labels, title=title), view


def _arm(
    axes: Axes,
    view: FloatArray,
    plan: CalibrationPlan,
    pose: FloatArray,
    *,
    colour: str,
    width: float,
    alpha: float = 1.0,
) -> None:
    """Draw the arm as a line from joint to joint."""
    chain = plan.arm.chain
    line = np.concatenate([np.zeros((1, 3)), joint_origins(chain, pose[None])[0], chain.tip_in_base(pose[None])])
    axes.plot(*_flat(view, line), color=colour, linewidth=width, alpha=alpha, solid_joinstyle="round", zorder=2)


def _artefacts(axes: Axes, view: FloatArray, poses: Candidates, *, label: bool) -> None:
    points = places_of_seats(poses)
    ends = bars(poses) if poses.length_mm is not None else []
    for one, other in ends:
        axes.plot(*_flat(view, np.stack([points[one], points[other]])), color=ORANGE, linewidth=2.4, zorder=3)
    axes.scatter(
        *_flat(view, np.stack(list(points.values()))), s=24, color=ORANGE, edgecolors=PAPER, linewidths=0.6, zorder=4
    )
    if label:
        marks = {one[:-1]: (points[one] + points[other]) / 2 for one, other in ends} if ends else points
        for name, at in marks.items():
            axes.annotate(name, tuple(view @ at), xytext=(4, 4), textcoords="offset points", color=INK, zorder=6)
