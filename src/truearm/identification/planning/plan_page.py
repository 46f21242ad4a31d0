"""A plan as a page: what it will bring, where the artefact stands, how the joints move, and the poses one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing

from truearm.identification.planning.candidates import Candidates
from truearm.identification.planning.limitations import limitations
from truearm.identification.planning.proposal import CalibrationPlan, Proposal, Strategy
from truearm.identification.planning.sampling.workspace import joint_origins, stance
from truearm.identification.planning.template import bars, notes, place_names
from truearm.pages.figures import range_figure
from truearm.pages.number_format import capitalize, format_count, format_mm, format_number
from truearm.pages.page import Column, LabelledValue, Page, Section, Table
from truearm.pages.plotting import INK, LIMIT, Figure, Style, figure_style, make_panel, set_log_scale, styles_of
from truearm.typing import FloatArray

_WIDTH_IN, _HEIGHT_IN = 4.6, 3.9
_ORANGE, _NAVY = "#d9730d", "#12407a"
_MOST_ARMS = 40  # drawn on one another

ABOUT = {
    "i-optimal": "least uncertainty of a point in the volume",
    "d-optimal": "parameters known best, whatever they are good for",
    "technician": "poses as of a person who measures parts",
    "random": "poses drawn",
}


def plan_page(
    plan: CalibrationPlan, strategy: str, poses: Candidates, *, facts: Sequence[tuple[str, str]] = ()
) -> Page:
    """Lay out a plan.

    Parameters
    ----------
    plan : CalibrationPlan
    strategy : str
        The one whose poses are to be taken.
    poses : Candidates
        They, with their seats as the session names them.
    facts : sequence of (str, str)
        What the plan rests on.
    """
    chosen = next(proposal for name, proposal in plan.proposals.items() if name == strategy)
    artefact = {"tracker": "under a tracker", "seat": "with seats", "bar": "with a bar"}[plan.artefact.kind]
    apart = ", apart from the scale" if plan.artefact.kind == "seat" else ""
    return Page(
        title=f"{plan.arm.name}: {format_count(len(poses), 'pose')} to take {artefact}",
        subtitle=f"Chosen for {ABOUT[strategy]}.",
        summary=(
            LabelledValue(f"uncertainty in the volume before{apart}", float(chosen.rms_mm[0]), "mm"),
            LabelledValue("after these poses", float(chosen.rms_mm[-1]), "mm"),
            LabelledValue("poses", len(poses)),
        ),
        sections=(
            _gain(plan, strategy, apart),
            _where(plan, poses),
            _how(plan, poses),
            Section(
                "What these poses will not tell",
                "\n\n".join(f"{capitalize(phrase)}." for phrase in limitations(plan, chosen)),
            ),
            _one_by_one(plan, poses),
        ),
        facts=tuple(facts),
    )


def course_figure(proposals: Mapping[Strategy, Proposal]) -> Figure:
    """Draw the uncertainty in the volume against the number of poses, a line a strategy."""
    pens = styles_of(proposals)
    with figure_style():
        drawing, (axes,) = make_panel(5.4, 3.4)
        lowest, highest, most = np.inf, 0.0, 1
        for name, proposal in proposals.items():
            counts, rms = proposal.counts[1:], proposal.rms_mm[1:]
            _line(axes, counts, rms, pens[name], name)
            lowest, highest, most = min(lowest, rms.min()), max(highest, rms.max()), max(most, int(counts[-1]))
        set_log_scale(axes, "y", lowest / 1.3, highest * 1.3)
        set_log_scale(axes, "x", 0.95, most * 1.1 if most > 1 else 2)
        axes.set(xlabel="poses", ylabel="uncertainty [mm]")
        axes.legend(loc="lower left")
    ends = "; ".join(f"{name} {format_mm(float(p.rms_mm[-1]))}" for name, p in proposals.items())
    return Figure(
        (drawing,),
        caption="Predicted uncertainty of a point in the volume, three-dimensional root mean square, against the "
        f"number of poses, each strategy in the order of its own plan. At the end: {ends}.",
        alt=f"Falling curves of the uncertainty against the number of poses. At the end: {ends}.",
    )


def places_figure(plan: CalibrationPlan, poses: Candidates) -> Figure:
    """Draw seats, bars or tips in the volume, from above and from the side."""
    tips = plan.arm.chain.tip_in_base(plan.volume)
    with figure_style():
        panels = tuple(_view(plan, tips, side=side) for side in (False, True))
        for (_, axes, flat), side in zip(panels, (False, True), strict=True):
            axes.scatter(*flat(tips), s=5, color=LIMIT, alpha=0.5, linewidths=0, zorder=1)
            _arm(axes, flat, plan, plan.arm.working, colour=LIMIT, width=2.2)
            if poses.seat is None:
                axes.scatter(*flat(plan.arm.chain.tip_in_base(poses.angles)), s=9, color=_NAVY, linewidths=0, zorder=4)
            else:
                _artefacts(axes, flat, poses, label=not side or len(set(place_names(poses).tolist())) < 9)
    what = {
        "tracker": "Dark dots: the tip at the poses to take.",
        "seat": "Orange: the seats.",
        "bar": "Orange: the bar at its places.",
    }[plan.artefact.kind]
    return Figure(
        tuple(drawing for drawing, _, _ in panels),
        caption=f"{what} Pale dots: the volume, with the tip at poses of a person who measures there. Grey: the arm at "
        "its working pose, as drawn. Distances in the base frame; ahead is towards the middle of the volume.",
        alt=f"The volume from above and from the side. {what}",
        columns=2,
    )


def poses_figure(plan: CalibrationPlan, angles: FloatArray) -> Figure:
    """Draw the arm at the poses, from above and from the side."""
    shown = angles[np.unique(np.linspace(0, len(angles) - 1, _MOST_ARMS).round().astype(int))]
    tips = plan.arm.chain.tip_in_base(shown)
    with figure_style():
        panels = tuple(_view(plan, joint_origins(plan.arm.chain, shown).reshape(-1, 3), side=s) for s in (False, True))
        for _, axes, flat in panels:
            for pose in shown:
                _arm(axes, flat, plan, pose, colour=_NAVY, width=0.7, alpha=0.45)
            axes.scatter(*flat(tips), s=7, color=_ORANGE, linewidths=0, zorder=4)
    number = format_count(len(shown), "pose")
    return Figure(
        tuple(drawing for drawing, _, _ in panels),
        caption=f"The arm at {number} of the {format_number(len(angles))}, as lines from joint to joint. Orange: the "
        "tip.",
        alt=f"The arm at {number}, from above and from the side, as lines from joint to joint.",
        columns=2,
    )


def _gain(plan: CalibrationPlan, strategy: str, apart: str) -> Section:
    rows = []
    for name, proposal in plan.proposals.items():
        seen = proposal.observability
        indices = [getattr(seen, f"o{number}") for number in range(1, 6)]
        rows.append(
            (name, ABOUT[name], float(proposal.rms_mm[-1]), *indices, f"{seen.rank}\u00a0of\u00a0{seen.n_parameters}")
        )
    columns = [Column("strategy"), Column("what it seeks"), Column("uncertainty after", "mm")]
    columns += [Column(f"O{number}") for number in range(1, 6)]
    return Section(
        "What it will bring",
        "The uncertainty of a point is predicted before anything is measured, from the drawing, from what is known of "
        "the terms by which the arm may differ from it, and from the noise of a coordinate "
        f"({format_mm(plan.prior.noise_mm)}). It is that of points compared with each other{apart}; what no term "
        "describes is not in it.\n\n"
        f"These poses are {strategy}. O1 to O5 are observability indices of the terms by the new poses alone, in units "
        "of how surely each was known before; larger is better. The rank counts the combinations of the terms' "
        "coefficients that they determine; the others move nothing, or only together with these.",
        figures=(course_figure(plan.proposals),),
        tables=(Table((*columns, Column("rank")), tuple(rows), "Strategies compared, each with as many poses."),),
    )


def _where(plan: CalibrationPlan, poses: Candidates) -> Section:
    text = {
        "tracker": "The tip is in the volume at every pose. Whether the tracker sees it there must be tried.",
        "seat": "Each seat is fixed about where it is drawn; a few centimetres do not matter. It must not move while "
        "readings are taken in it.",
        "bar": "The bar is fixed about where it is drawn; a few centimetres do not matter. It must not move while "
        "readings are taken at one place.",
    }[plan.artefact.kind]
    tables = () if poses.seat is None else (_places_table(poses),)
    return Section("Where", text, figures=(places_figure(plan, poses),), tables=tables)


def _places_table(poses: Candidates) -> Table:
    assert poses.seat is not None
    assert poses.seat_points is not None
    rows = []
    for name in dict.fromkeys(poses.seat.tolist()):
        here = poses.seat == name
        x, y, z = poses.seat_points[int(np.argmax(here))].round().astype(int).tolist()
        rows.append((name, x, y, z, int(here.sum())))
    columns = (Column("seat"), Column("x", "mm"), Column("y", "mm"), Column("z", "mm"), Column("poses"))
    return Table(columns, tuple(rows), "Seats in the base frame, in the order to use them.")


def _how(plan: CalibrationPlan, poses: Candidates) -> Section:
    arm = plan.arm
    slides = arm.chain.is_prismatic
    scale = np.where(slides, 1.0, np.degrees(1.0))
    lower, upper = arm.limits.T * scale
    ranges = range_figure(
        poses.angles * scale,
        names=arm.joint_names,
        units=["mm" if slide else "deg" for slide in slides],
        lower=lower,
        upper=upper,
        label="joint position",
        caption=f"Range of each joint over {format_count(len(poses.angles), 'pose')}.",
    )
    return Section(
        "Poses",
        "Go near each pose; some degrees do not matter, but what is written down is what the encoders read. The "
        "limits are kept and no joint is below the table; that parts of the arm do not touch each other was not "
        "checked.",
        figures=(poses_figure(plan, poses.angles), ranges),
    )


def _one_by_one(plan: CalibrationPlan, poses: Candidates) -> Section:
    slides = plan.arm.chain.is_prismatic.tolist()
    aims = np.where(slides, poses.angles, np.degrees(poses.angles)).round().astype(int).tolist()
    units = ["mm" if slide else "deg" for slide in slides]
    joints = (Column(name, unit) for name, unit in zip(plan.arm.joint_names, units, strict=True))
    rows = ((number, what, *aim) for number, (what, aim) in enumerate(zip(notes(poses), aims, strict=True), start=1))
    table = Table((Column("pose"), Column("what to do"), *joints), tuple(rows), "In the order to take them.")
    return Section("Pose by pose", tables=(table,))


def _line(axes: Axes, x: Any, y: Any, pen: Style, name: str) -> None:
    axes.plot(x, y, color=pen.colour, linestyle=pen.dash, marker=pen.marker, markersize=3, label=name)


class _Flat:
    """From points in the base frame to a view: from above, or from the side with the front to the right."""

    def __init__(self, plan: CalibrationPlan, *, side: bool) -> None:
        front = stance(plan.arm).front_rad
        ahead = np.array([np.cos(front), np.sin(front), 0.0])
        self._axes = np.stack([ahead, [0.0, 0.0, 1.0]]) if side else np.eye(3)[:2]

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        across, up = self._axes @ points.T
        return across, up


def _view(plan: CalibrationPlan, points: FloatArray, *, side: bool) -> tuple[Drawing, Axes, _Flat]:
    """Axes with a margin about the points, the arm's base and its working pose, of one scale."""
    flat = _Flat(plan, side=side)
    drawing = Drawing(figsize=(_WIDTH_IN, _HEIGHT_IN))
    FigureCanvasAgg(drawing)
    width, height = 3.66, 3.16
    axes = drawing.add_axes((0.78 / _WIDTH_IN, 0.46 / _HEIGHT_IN, width / _WIDTH_IN, height / _HEIGHT_IN))
    working = joint_origins(plan.arm.chain, plan.arm.working[None])[0]
    seen = np.stack(flat(np.concatenate([points, working, np.zeros((1, 3))])))
    low, high = seen.min(axis=1), seen.max(axis=1)
    half = 1.08 * max((high[0] - low[0]) / width, (high[1] - low[1]) / height, 1.0) / 2
    middle = (low + high) / 2
    axes.set_xlim(middle[0] - half * width, middle[0] + half * width)
    axes.set_ylim(middle[1] - half * height, middle[1] + half * height)
    axes.set_aspect("equal")
    across, up = ("ahead [mm]", "z [mm]") if side else ("x [mm]", "y [mm]")
    axes.set(xlabel=across, ylabel=up, title="from the side" if side else "from above")
    axes.plot(*flat(np.zeros((1, 3))), marker="+", markersize=9, markeredgewidth=1.2, color=INK, zorder=5)
    return drawing, axes, flat


def _arm(
    axes: Axes, flat: _Flat, plan: CalibrationPlan, pose: FloatArray, *, colour: str, width: float, alpha: float = 1.0
) -> None:
    """Draw the arm as a line from joint to joint."""
    chain = plan.arm.chain
    line = np.concatenate([np.zeros((1, 3)), joint_origins(chain, pose[None])[0], chain.tip_in_base(pose[None])])
    axes.plot(*flat(line), color=colour, linewidth=width, alpha=alpha, solid_joinstyle="round", zorder=2)


def _artefacts(axes: Axes, flat: _Flat, poses: Candidates, *, label: bool) -> None:
    assert poses.seat is not None
    assert poses.seat_points is not None
    points = {
        name: poses.seat_points[int(np.argmax(poses.seat == name))] for name in dict.fromkeys(poses.seat.tolist())
    }
    ends = bars(poses) if poses.length_mm is not None else []
    for one, other in ends:
        axes.plot(*flat(np.stack([points[one], points[other]])), color=_ORANGE, linewidth=2.4, zorder=3)
    axes.scatter(
        *flat(np.stack(list(points.values()))), s=24, color=_ORANGE, edgecolors="white", linewidths=0.6, zorder=4
    )
    if label:
        marks = {one[:-1]: (points[one] + points[other]) / 2 for one, other in ends} if ends else points
        for name, (x, y) in zip(marks, zip(*flat(np.stack(list(marks.values()))), strict=True), strict=True):
            axes.annotate(name, (x, y), xytext=(4, 4), textcoords="offset points", color=INK, zorder=6)
