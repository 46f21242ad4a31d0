"""Drawings of the arm: its links and joint axes in space, and the Denavit-Hartenberg frames at each joint.

The view is orthographic, so that lengths of one direction are comparable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.number_format import format_in_text, format_number
from truearm.pages.palette import FAINT, INK, LIMIT, NAVY, ORANGE, SOFT
from truearm.pages.plotting import Figure, figure_style, join_phrases
from truearm.typing import FloatArray

_AZIMUTH_DEG, _ELEVATION_DEG = -122.0, 16.0
_X, _Z, _Y = ORANGE, NAVY, LIMIT
_LINK, _EDGE, _JOINT = FAINT, LIMIT, SOFT
_NEAR = 0.12  # of the arm's length: frames closer than this are drawn in one detail
_LETTER_IN, _LINE_IN = 0.082, 0.15  # room for a letter of a label


def arm_figure(frames: FloatArray, tip: FloatArray, *, sliding: Sequence[bool] = ()) -> Figure:
    """Draw the arm: links, joint axes with their positive direction, tip, and a scale.

    Parameters
    ----------
    frames : (n_joints + 1, 4, 4) array
        Frames at a pose, the base first [mm], such as those of Denavit and Hartenberg; joint i turns about, or slides
        along, z of the frame before it.
    tip : (3,) array
        The tip in the base frame [mm].
    sliding : sequence of bool
        Which joints slide; none by default.
    """
    joints = len(frames) - 1
    reach = _reach(frames, tip)
    slides = [*sliding] or [False] * joints
    with figure_style():
        drawing = _whole(frames, tip, reach, slides)
    kinds = f"{joints} joints, {sum(slides)} of them sliding" if any(slides) else f"{joints} revolute joints"
    summary = f"{kinds}, {format_number(round(reach))} mm from the base to the tip along the links"
    place = ", ".join(f"{axis} {format_number(round(value))}" for axis, value in zip("xyz", tip, strict=True))
    return Figure(
        (drawing,),
        caption=f"The arm to scale, {summary}. Dash-dotted lines are the axes of the joints J1 to J{joints}, "
        f"arrows their positive direction; x and y are axes of the base frame. The tip is at {place} mm.",
        alt=f"Drawing of an arm in space: {summary}, with the axes of its joints J1 to J{joints}. The tip is at "
        f"{place} mm.",
    )


def frame_figure(frames: FloatArray, tip: FloatArray) -> Figure:
    """Draw the Denavit-Hartenberg frames, each group of neighbours as a detail.

    Parameters
    ----------
    frames, tip
        As in `arm_figure`.
    """
    groups = _groups(frames, _reach(frames, tip))
    with figure_style():
        panels = tuple(_detail(frames, tip, group) for group in groups)
    summary = join_phrases((f"frame{'s' * (len(group) > 1)} {_numbers(group)}" for group in groups), most=6)
    return Figure(
        panels,
        caption=f"The Denavit-Hartenberg frames, one detail for neighbours, each with its own scale ({summary}). "
        "Frame 0 is the base; joint i turns about z of frame i \u2212 1 and moves frame i. The y axes are not "
        "labelled; all frames are right-handed.",
        alt=f"{len(groups)} enlarged details of the arm with coordinate frames 0 to {len(frames) - 1}: {summary}.",
        columns=2 if len(panels) > 1 else 1,
    )


@dataclass(eq=False)
class _View:
    """Axes with the lines and labels that are drawn on them [mm in the view]."""

    axes: Axes
    per_in: float
    occupied: list[FloatArray] = field(default_factory=list)
    labels: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)

    def line(self, points: npt.ArrayLike, *, colour: str, width: float, dash: object = "-", layer: int = 2) -> None:
        """Draw a polyline through points in space (n, 3)."""
        flat = project(points)
        style = {"solid_capstyle": "round", "solid_joinstyle": "round"} if dash == "-" else {}
        self.axes.plot(*flat.T, color=colour, linewidth=width, linestyle=dash, zorder=layer, **style)  # type: ignore[arg-type]
        self.occupy(flat)

    def occupy(self, flat: FloatArray) -> None:
        """Mark a polyline (n, 2) as occupied."""
        for start, end in pairwise(flat):
            n = max(2, int(np.linalg.norm(end - start) / (0.04 * self.per_in)))
            self.occupied.append(start + np.linspace(0, 1, n)[:, None] * (end - start))

    def arrow(self, start: FloatArray, end: FloatArray, *, colour: str, width: float) -> None:
        """Draw an arrow from a point in space to another."""
        flat = project([start, end])
        self.axes.annotate(
            "",
            xy=flat[1],
            xytext=flat[0],
            arrowprops={
                "arrowstyle": "-|>,head_width=0.18,head_length=0.36",
                "color": colour,
                "linewidth": width,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            zorder=6,
        )
        self.occupy(flat)

    def label(self, text: str, point: FloatArray, *, colour: str = INK, bold: bool = False) -> None:
        """Write beside a point in space, where the label covers the least."""
        at = project([point])[0]
        half = 0.5 * np.array([_LETTER_IN * len(text) + 0.04, _LINE_IN]) * self.per_in
        dots = np.concatenate(self.occupied) if self.occupied else np.empty((0, 2))
        low, high = np.array([self.axes.get_xlim(), self.axes.get_ylim()]).T

        def cost(centre: FloatArray) -> float:
            covered = np.count_nonzero((np.abs(dots - centre) < half + 0.02 * self.per_in).all(axis=1))
            on = sum(bool((np.abs(other - centre) < half + size).all()) for other, size in self.labels)
            outside = bool(((centre - half < low) | (centre + half > high)).any())
            return covered + 50.0 * on + 200.0 * outside + 2.0 * float(np.linalg.norm(centre - at)) / self.per_in

        turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        ways = np.column_stack([np.cos(turns), np.sin(turns)])
        # At the distance where the label just clears the point, and farther; farther ones cost more.
        centres = [
            at + way * (float(np.abs(way) @ half) + gap * self.per_in) for gap in (0.05, 0.14, 0.26) for way in ways
        ]
        best = min(centres, key=cost)
        self.labels.append((best, half))
        self.axes.text(
            float(best[0]),
            float(best[1]),
            text,
            ha="center",
            va="center",
            color=colour,
            weight="bold" if bold else "normal",
            zorder=8,
        )


def project(points: npt.ArrayLike) -> FloatArray:
    """Project points in space (n, 3) onto the view (n, 2)."""
    a, e = math.radians(_AZIMUTH_DEG), math.radians(_ELEVATION_DEG)
    right = [-math.sin(a), math.cos(a), 0.0]
    up = [-math.sin(e) * math.cos(a), -math.sin(e) * math.sin(a), math.cos(e)]
    flat: FloatArray = np.asarray(points, dtype=float) @ np.array([right, up]).T
    return flat


def _reach(frames: FloatArray, tip: FloatArray) -> float:
    path = np.vstack([*_links(frames), _link(frames[-1], tip)])
    return max(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()), 1.0)


def _links(frames: FloatArray) -> list[FloatArray]:
    """Each link as points in space: along the joint axis first, then across to the next frame."""
    return [_link(before, after[:3, 3]) for before, after in pairwise(frames)]


def _link(frame: FloatArray, end: FloatArray) -> FloatArray:
    start, axis = frame[:3, 3], frame[:3, 2]
    return np.array([start, start + axis * (axis @ (end - start)), end])


def _whole(frames: FloatArray, tip: FloatArray, reach: float, sliding: Sequence[bool]) -> Drawing:
    size = 0.11 * reach
    around = np.vstack([frames[:, :3, 3] + s * frames[:, :3, 2] * 1.15 * size for s in (-0.6, 1)] + [tip[None]])
    base = frames[0, :3, 3] + 0.9 * size * np.vstack([frames[0, :3, :3].T, -frames[0, :3, :3].T[:2]])
    view, drawing = _paper(np.vstack([around, base]), width_in=5.6, margin_in=0.34, largest_in=4.9)
    _floor(view, frames[0], 0.62 * size)
    _tubes(view, frames, tip, width=8.0)
    for frame, slides in zip(frames[:-1], sliding, strict=True):
        origin, axis = frame[:3, 3], frame[:3, 2]
        view.line([origin - 0.17 * size * axis, origin + 0.17 * size * axis], colour=_JOINT, width=10.5, layer=4)
        view.line(
            [origin - 0.7 * size * axis, origin + 1.25 * size * axis],
            colour=_Z,
            width=0.9,
            dash=(0, (7, 2, 1.5, 2)),
            layer=5,
        )
        if slides:
            view.arrow(origin + 0.8 * size * axis, origin + 1.15 * size * axis, colour=_Z, width=1.2)
        else:
            _turn(view, frame, origin + 1.02 * size * axis, 0.2 * size)
    for k, (letter, colour) in enumerate(zip("xyz", (_X, _Y, _Z), strict=True)):
        if letter == "z":
            continue  # the axis of the first joint is drawn there
        end = frames[0, :3, 3] + 0.8 * size * frames[0, :3, k]
        view.arrow(frames[0, :3, 3], end, colour=colour, width=1.3)
    view.axes.plot(*project([tip]).T, marker="o", markersize=5.5, color=INK, zorder=7)
    for i, frame in enumerate(frames[:-1], start=1):
        view.label(f"J{i}", frame[:3, 3] + 1.25 * size * frame[:3, 2], colour=_Z, bold=True)
    for k, letter in enumerate("xy"):
        view.label(letter, frames[0, :3, 3] + 0.8 * size * frames[0, :3, k], colour=(_X, _JOINT)[k], bold=True)
    view.label("tip", tip, bold=True)
    _lengths(view, frames, tip, reach)
    _scale_bar(view, _round_length(0.22 * reach))
    return drawing


def _lengths(view: _View, frames: FloatArray, tip: FloatArray, reach: float) -> None:
    """Write the length of every long straight piece beside its centre."""
    for link in [*_links(frames), _link(frames[-1], tip)]:
        for start, end in pairwise(link):
            length = float(np.linalg.norm(end - start))
            if length > 0.05 * reach or (
                length > 0.03 * reach and np.linalg.norm(project([end - start])) > 0.03 * reach
            ):
                view.label(f"{format_in_text(round(length, 1))} mm", (start + end) / 2, colour=_JOINT)


def _detail(frames: FloatArray, tip: FloatArray, group: Sequence[int]) -> Drawing:
    origins = frames[group, :3, 3]
    with_tip = group[-1] == len(frames) - 1
    shown = np.vstack([origins, tip[None]]) if with_tip else origins
    spread = max(float(np.ptp(project(shown), axis=0).max()), 1.0)
    size = max(0.62 * spread, 0.04 * _reach(frames, tip))
    corners = np.concatenate([frames[group, :3, 3] + size * frames[group, :3, k] for k in range(3)])
    view, drawing = _paper(np.vstack([shown, corners]), width_in=4.3, margin_in=0.42, largest_in=3.4, title=True)
    _tubes(view, frames, tip, width=9.0)
    # A later frame at nearly the same place is drawn smaller, so that both are distinguishable.
    close = {
        i: any(np.linalg.norm(frames[j, :3, 3] - frames[i, :3, 3]) < 0.4 * size for j in group if j < i) for i in group
    }
    ends = {i: frames[i, :3, 3] + size * (0.72 if close[i] else 1.0) * frames[i, :3, :3].T for i in group}
    for k, colour, width in ((1, _Y, 1.0), (0, _X, 1.7), (2, _Z, 1.7)):
        for i in group:
            view.arrow(frames[i, :3, 3], ends[i][k], colour=colour, width=width)
    view.axes.plot(*project(origins).T, marker="o", markersize=4.5, color=INK, linestyle="none", zorder=7)
    for i in group:
        view.label(f"x{i}", ends[i][0], colour=_X, bold=True)
        view.label(f"z{i}", ends[i][2], colour=_Z, bold=True)
    if with_tip:
        view.axes.plot(*project([tip]).T, marker="o", markersize=6, color=INK, zorder=7)
        view.label("tip", tip, bold=True)
    _scale_bar(view, _round_length(0.9 * view.per_in))
    drawing.text(0.02, 0.985, f"frame{'s' * (len(group) > 1)} {_numbers(group)}", va="top", fontsize=9, weight="bold")
    return drawing


def _paper(
    points: FloatArray, *, width_in: float, margin_in: float, largest_in: float, title: bool = False
) -> tuple[_View, Drawing]:
    """Axes without frame, on one scale, around points in space with a margin."""
    flat = project(points)
    low, high = flat.min(axis=0), flat.max(axis=0)
    top_in, foot_in = 0.2 if title else 0.05, 0.2
    per_in = max(
        (high[0] - low[0]) / (width_in - 2 * margin_in), (high[1] - low[1]) / (largest_in - 2 * margin_in), 1e-6
    )
    height_in = (high[1] - low[1]) / per_in + 2 * margin_in + top_in + foot_in
    drawing = Drawing(figsize=(width_in, height_in))
    axes = drawing.add_axes((0, foot_in / height_in, 1, 1 - (top_in + foot_in) / height_in))
    middle = (low + high) / 2
    span = np.array([width_in, height_in - top_in - foot_in]) * per_in / 2
    axes.set_xlim(middle[0] - span[0], middle[0] + span[0])
    axes.set_ylim(middle[1] - span[1], middle[1] + span[1])
    axes.axis("off")
    return _View(axes, float(per_in)), drawing


def _tubes(view: _View, frames: FloatArray, tip: FloatArray, *, width: float) -> None:
    pieces = _links(frames)
    for piece in pieces:
        view.line(piece, colour=_EDGE, width=width + 1.2, layer=2)
    stylus = _link(frames[-1], tip)
    view.line(stylus, colour=_EDGE, width=0.4 * width + 1.2, layer=2)
    for piece in pieces:
        view.line(piece, colour=_LINK, width=width, layer=3)
    view.line(stylus, colour=_LINK, width=0.4 * width, layer=3)


def _floor(view: _View, frame: FloatArray, radius: float) -> None:
    """Draw the base as a disc in the plane of x and y."""
    turns = np.linspace(0, 2 * np.pi, 61)
    circle = frame[:3, 3] + radius * (np.cos(turns)[:, None] * frame[:3, 0] + np.sin(turns)[:, None] * frame[:3, 1])
    view.axes.fill(*project(circle).T, facecolor=FAINT, edgecolor=LIMIT, linewidth=0.8, zorder=1)


def _turn(view: _View, frame: FloatArray, centre: FloatArray, radius: float) -> None:
    """Draw the positive rotation about z as three quarters of a circle with an arrow head."""
    turns = np.linspace(0.3, 0.3 + 1.5 * np.pi, 40)
    arc = centre + radius * (np.cos(turns)[:, None] * frame[:3, 0] + np.sin(turns)[:, None] * frame[:3, 1])
    view.line(arc[:-3], colour=_Z, width=1.0, layer=6)
    view.arrow(arc[-5], arc[-1], colour=_Z, width=0.8)


def _scale_bar(view: _View, length: float) -> None:
    right = view.axes.get_xlim()[1]
    foot = view.axes.get_ylim()[0] + 0.06 * view.per_in
    start = right - 0.25 * view.per_in - length
    view.axes.plot([start, start + length], [foot, foot], color=INK, linewidth=2, solid_capstyle="butt", clip_on=False)
    view.axes.text(
        start + length / 2, foot - 0.06 * view.per_in, f"{length:g} mm", ha="center", va="top", clip_on=False
    )


def _round_length(about: float) -> float:
    """A round length: 1, 2 or 5 times a power of ten, at most `about`."""
    power = 10.0 ** math.floor(math.log10(about))
    return max(step * power for step in (1, 2, 5) if step * power <= about * 1.0001)


def _groups(frames: FloatArray, reach: float) -> list[list[int]]:
    groups = [[0]]
    for i in range(1, len(frames)):
        apart = float(np.linalg.norm(frames[i, :3, 3] - frames[i - 1, :3, 3]))
        if apart < _NEAR * reach:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _numbers(group: Sequence[int]) -> str:
    if len(group) > 2:
        return f"{group[0]} to {group[-1]}"
    return " and ".join(map(str, group))
