"""The picture of docs/describe-your-arm.md: the axes and lengths of an arm, and the four numbers between two axes.

python benchmarks/axes_of_an_arm.py docs/axes_of_an_arm.png
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.axes import Axes

from truearm.arm import load_arm
from truearm.pages.palette import GREY, INK, NAVY, ORANGE, TEAL
from truearm.pages.plotting import Figure, figure_style, make_panel, save_figure
from truearm.typing import FloatArray

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


def main() -> None:
    """Draw the picture into the file that is named."""
    with figure_style():
        left, (of_arm,) = make_panel(3.7, 3.2)
        draw_arm(of_arm)
        right, (of_row,) = make_panel(3.2, 3.2)
        draw_row(of_row)
    save_figure(
        Figure((left, right), "Axes of an arm.", "Axes of an arm and one row of its table.", columns=2), sys.argv[1]
    )


if __name__ == "__main__":
    main()
