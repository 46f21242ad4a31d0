"""The page of hand-eye: the cell in space, every image with what it leaves, and the turns of robot and camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure as Drawing
from scipy.spatial.transform import Rotation

from truearm.arm import Arm
from truearm.arm.rigid_motions import inverse
from truearm.models import IdentifiedModel
from truearm.number_format import format_count, format_number
from truearm.pages.drawings.arm_drawing import project
from truearm.pages.drawings.arm_scene import arm_mechanism, joint_columns, joint_frames
from truearm.pages.drawings.page_record import arm_row, version_row
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.palette import FAINT, INK, LIMIT, NAVY, ORANGE
from truearm.pages.plotting import Figure, figure_style, make_panel
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.typing import FloatArray, IntArray
from truearm.wings.camera.interpretation import AGREES
from truearm.wings.camera.mounts import HandEyeByImages

# Boards or cameras that are outlined, and images of the picture of the turns: more hide each other.
MOST_OUTLINED, MOST_TURNS = 60, 200
# Half the side of an outline over the extent of the cell.
OUTLINE = 0.03
AS_IT_IS, IDENTIFIED = "arm as it is", "arm identified"
# Light where robot and camera agree, so that a wrong image is a dark cross.
_TURNS = LinearSegmentedColormap.from_list("turns", ["#ffffff", "#f0a04b", "#c5477a", "#1b0c3b"])


@dataclass(frozen=True, eq=False)
class _Left:
    """What images leave.

    Attributes
    ----------
    rows : (m,) int array
        The images that were used, counted from 0.
    mm : dict of str to (m,) array
        Distance of the board from where the other images put it, by the arm; NaN where it is not known.
    deg : dict of str to (m,) array
        Angle between its orientation and the one found.
    """

    rows: IntArray
    mm: dict[str, FloatArray]
    deg: dict[str, FloatArray]

    @classmethod
    def of(cls, found: HandEyeByImages) -> Self:
        """By hand-eye alone, and with the arm identified."""
        alone, used = found.alone, found.alone.rows
        A, C = found.interpretation.A[used], found.interpretation.C[used]
        mm, deg = {AS_IT_IS: alone.held_out_mm}, {AS_IT_IS: _angles((alone.X @ A @ alone.Y)[:, :3, :3], C[:, :3, :3])}
        model, readings = _identified(found), found.readings
        # Images of one pose were merged: what they leave is of their mean.
        if model is None or readings is None or model.kind == "nominal" or model.training_.n_readings != len(readings):
            return cls(found.interpretation.rows[used], mm, deg)
        for name, one in ((AS_IT_IS, found.fitted and found.fitted.nominal), (IDENTIFIED, model)):
            if isinstance(one, IdentifiedModel):
                mm[name] = np.full(len(readings), np.nan)
                for part in (one.held_out_, one.held_out_gross_):
                    mm[name][part.rows] = part.errors_mm
        pose = model.fit_.perturbed_chain.poses(model.state(readings), model.fit_.coefficients)
        seen = C[:, :3, :3].transpose(0, 2, 1) if found.eye_in_hand else C[:, :3, :3]
        deg[IDENTIFIED] = _angles(pose.R_base_tip, seen)
        return cls(found.interpretation.rows[used], mm, deg)


def _angles(R: FloatArray, S: FloatArray) -> FloatArray:
    """(n,) angles between rotations [deg]."""
    return np.degrees(Rotation.from_matrix(R.transpose(0, 2, 1) @ S).magnitude())


def _identified(found: HandEyeByImages) -> IdentifiedModel | None:
    model = None if found.fitted is None else found.fitted.model
    return model if isinstance(model, IdentifiedModel) else None


def hand_eye_page(found: HandEyeByImages) -> Page:
    """Lay out where the camera and the board are, and by which images."""
    left, (alone, identified) = _Left.of(found), found.held_out_mm
    n_ignored = found.n_images - found.n_used
    summary = [
        LabelledValue("U of the camera's position, k = 2", found.camera.U_mm, "mm"),
        LabelledValue("U of its orientation, k = 2", found.camera.U_deg, "deg"),
        LabelledValue(f"board on held-out images, {AS_IT_IS}", alone, "mm"),
    ]
    if IDENTIFIED in left.mm:
        summary.append(LabelledValue(f"the same, {IDENTIFIED}", identified, "mm"))
    facts = [("files", ", ".join(file.name for file in found.files) or "arrays"), version_row()]
    if found.fitted is not None:
        facts.insert(1, arm_row(found.fitted.model.arm_))
    ignored = f"{format_count(n_ignored, 'image')} of {found.n_images} ignored: " if n_ignored else ""
    detail = f"{ignored}they are the first in the table." if ignored else ""
    return Page(
        title=f"Hand-eye: the camera in the {found.camera.parent}",
        subtitle="Where camera and board are, from poses of the board and of the robot.",
        summary=tuple(summary),
        sections=(
            Section("The cell", scenes=(_scene(found, left),), tables=(_places(found),)),
            Section("What each image leaves", figures=(_left_figure(left),)),
            Section("The turns of robot and camera", figures=(_turn_figure(found),)),
            Section("Image by image", "\n\n".join(map(str, found.findings)), tables=(_table(found, left),)),
        ),
        facts=tuple(facts),
        verdict=PageVerdict(found.summary(), state="doubtful" if n_ignored else "none", detail=detail),
    )


# The cell in space ---------------------------------------------------------------------------------------------------


def _outline(kind: str, size: float) -> FloatArray:
    """A board as a square with a mark at its x axis, a camera as a pyramid to what it sees; in its own frame."""
    corners = size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]], dtype=float)
    if kind == "board":
        return np.concatenate([corners, [[0, 0, 0], [size, 0, 0]]])
    seen = 0.7 * corners + [0, 0, 1.6 * size]
    apex = np.zeros((1, 3))
    return np.concatenate([seen, apex, seen[1:2], seen[2:3], apex, seen[3:4]])


def _placed(T: FloatArray, outline: FloatArray) -> FloatArray:
    return np.asarray(outline @ T[:3, :3].T + T[:3, 3])


def _in_base(found: HandEyeByImages) -> tuple[FloatArray, FloatArray]:
    """What stands, (4, 4), and what the flange carries at every image, (m, 4, 4), in the base."""
    C = found.interpretation.C[found.alone.rows]
    if found.eye_in_hand:
        T = found.board.T_parent_child
        return T, T @ inverse(C)
    T = found.camera.T_parent_child
    return T, T @ C


def _arm(found: HandEyeByImages, T_base_standing: FloatArray) -> Arm | None:
    """The identified arm in the axes of its base, its tip where the board is, or the camera."""
    model = _identified(found)
    if model is None or model.arm_.chain.coupling is not None:
        return None
    chain = model.fit_.chain.with_reference_frame(T_base_standing)
    if found.eye_in_hand:  # the tip is a point before the camera
        chain = chain.with_tip(chain.tip_in_flange - found.interpretation.C[found.alone.rows, :3, 3].mean(axis=0))
    return replace(model.arm_, chain=chain)


def _scene(found: HandEyeByImages, left: _Left) -> Scene:
    standing, carried = _in_base(found)
    stands, moves = ("board", "camera") if found.eye_in_hand else ("camera", "board")
    points, arm = carried[:, :3, 3], _arm(found, standing)
    extent = float(np.ptp(np.concatenate([points, standing[None, :3, 3], np.zeros((1, 3))]), axis=0).max())
    size = OUTLINE * extent
    some = np.linspace(0, len(points) - 1, min(len(points), MOST_OUTLINED)).astype(int)
    outlines = [_placed(carried[i], _outline(moves, size)) for i in some.tolist()]
    lines = [*outlines, _placed(standing, _outline(stands, 2 * size))]
    lines += [np.stack([np.zeros(3), 3 * size * axis]) for axis in np.eye(3)] if arm is None else []
    columns = [
        PointColumn(f"{what}, {name}", unit, np.nan_to_num(values))
        for what, unit, by in (("position", "mm", left.mm), ("orientation", "deg", left.deg))
        for name, values in reversed(by.items())
    ]
    joints, mechanism = list[PointColumn](), None
    if arm is not None and found.readings is not None:
        angles = found.readings.angles
        joints = joint_columns(angles, arm.chain.is_prismatic, arm.joint_labels)
        mechanism = arm_mechanism(arm, start=angles[0], follows=[*range(arm.n_joints)])
    what = "the arm goes to the image that is pointed at" if mechanism else "axes are those of the base"
    caption = (
        f"The {stands}, large, and the {moves} at {format_count(len(points), 'image')}, in the base of the robot; "
        f"{what}. Colour: how far the board is from where the other images put it."
    )
    names = [found.names[row] for row in left.rows.tolist()]
    still = Figure((_still(arm, found, lines, points, columns[0]),), caption, f"Drawing of the cell. {caption}")
    cloud = PointCloud(points, names, columns, joints, noun="image")
    return Scene(caption.partition(".")[0], "mm", still, cloud=cloud, mechanism=mechanism, lines=lines)


def _still(
    arm: Arm | None, found: HandEyeByImages, lines: Sequence[FloatArray], points: FloatArray, shown: PointColumn
) -> Drawing:
    *outlines, standing = [project(line) for line in lines[: len(lines) - 3 * (arm is None)]]
    values = np.asarray(shown.values)
    with figure_style():
        drawing = Drawing(figsize=(6.4, 4.4))
        axes = drawing.add_axes((0.01, 0.01, 0.83, 0.98))
        axes.set(aspect="equal")
        axes.axis("off")
        if arm is not None and found.readings is not None:
            frames = joint_frames(arm.chain, found.readings.angles[0])
            tip = frames[-1, :3, :3] @ arm.chain.tip_in_flange + frames[-1, :3, 3]
            path = project(np.vstack([np.zeros(3), frames[:, :3, 3], tip]))
            axes.plot(*path.T, color=LIMIT, linewidth=7, solid_capstyle="round", solid_joinstyle="round", zorder=1)
            axes.plot(*path.T, color=FAINT, linewidth=5, solid_capstyle="round", solid_joinstyle="round", zorder=1.1)
        for line in outlines:
            axes.plot(*line.T, color=NAVY, linewidth=0.6, zorder=2)
        axes.plot(*standing.T, color=ORANGE, linewidth=1.6, zorder=3)
        limit = Normalize(0, max(float(values.max(initial=0.0)), 1e-12))
        across, up = project(points).T
        axes.scatter(across, up, c=values, s=14, norm=limit, cmap=_TURNS, edgecolors=INK, linewidths=0.4, zorder=4)
        axis = 0.1 * float(np.ptp(np.concatenate([project(points), standing])))
        for name, along in zip("xyz", np.eye(3), strict=True):
            ends = project(np.stack([np.zeros(3), axis * along]))
            axes.plot(*ends.T, color=INK, linewidth=1.2, zorder=5)
            axes.annotate(name, ends[1], xytext=(2, 2), textcoords="offset points", color=INK)
        stands = "board" if found.eye_in_hand else "camera"
        axes.annotate(
            stands, standing.max(axis=0), xytext=(3, 3), textcoords="offset points", color=ORANGE, weight="bold"
        )
        axes.annotate("base", (0, 0), xytext=(4, -12), textcoords="offset points", color=INK)
        bar = drawing.colorbar(ScalarMappable(limit, _TURNS), cax=drawing.add_axes((0.9, 0.2, 0.018, 0.6)))
        bar.ax.set_title(shown.unit, fontsize=8, fontweight="normal", loc="left")
    return drawing


def _places(found: HandEyeByImages) -> Table:
    columns = Column.of(
        "frame", "in", "x [mm]", "y [mm]", "z [mm]", "roll [deg]", "pitch [deg]", "yaw [deg]", "U [mm]", "U [deg]"
    )
    rows = tuple(one.cells() for one in found.transforms)
    return Table(columns, rows, "Where the frames are. U is that of the worst direction, k = 2.")


# Images --------------------------------------------------------------------------------------------------------------


def _left_figure(left: _Left) -> Figure:
    with figure_style():
        panels = tuple(
            _left_panel(left.rows + 1, by, f"{what} [{unit}]")
            for what, unit, by in (("position", "mm", left.mm), ("orientation", "deg", left.deg))
        )
    said = " and ".join(
        f"{format_number(float(np.nanmean(values)), digits=2)} mm with the {name}" for name, values in left.mm.items()
    )
    caption = (
        f"What the images leave of the board's position, each held out, {said} on average; and of its orientation. "
        "Orange: the arm as its controller has it. Blue: identified with the camera."
    )
    return Figure(panels, caption, f"Two plots against the number of the image. {caption}", columns=2)


def _left_panel(numbers: IntArray, by: dict[str, FloatArray], label: str) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 2.6)
    for (_, values), colour, marker in zip(by.items(), (ORANGE, NAVY), "os", strict=False):
        axes.vlines(numbers, 0, values, color=colour, linewidth=0.6)
        axes.plot(numbers, values, marker, color=colour, markersize=3.5, markeredgewidth=0)
    axes.set(xlabel="image", ylabel=label)
    axes.set_ylim(0, 1.06 * max(float(np.nanmax(values)) for values in by.values()) or 1.0)
    return drawing


def _turn_figure(found: HandEyeByImages) -> Figure:
    test = found.interpretation.test
    n = len(test.agree)
    some = np.linspace(0, n - 1, min(n, MOST_TURNS)).astype(int)
    top = 2 * test.tolerance_deg
    with figure_style():
        square = Drawing(figsize=(4.6, 3.9))
        axes = square.add_axes((0.12, 0.13, 0.68, 0.8))
        edges = (0.5, n + 0.5, n + 0.5, 0.5)
        axes.imshow(
            test.off_deg[np.ix_(some, some)], cmap=_TURNS, vmin=0, vmax=top, extent=edges, interpolation="nearest"
        )
        axes.grid(visible=False)
        axes.set(xlabel="image", ylabel="image", title="pair by pair")
        bar = square.colorbar(
            ScalarMappable(Normalize(0, top), _TURNS), cax=square.add_axes((0.84, 0.2, 0.025, 0.6)), extend="max"
        )
        bar.ax.set_title("deg", fontsize=8, fontweight="normal", loc="left")
        share, (axes,) = make_panel(4.6, 3.9)
        agreeing = 100 * _agreeing(found)
        for which, colour in ((test.agree, NAVY), (~test.agree, ORANGE)):
            axes.plot(np.flatnonzero(which) + 1, agreeing[which], "o", color=colour, markersize=3.5, markeredgewidth=0)
        axes.axhline(100 * AGREES, color=LIMIT, linewidth=1)
        axes.set(xlabel="image", ylabel="agrees with [%]", ylim=(0, 104))
    caption = (
        "By how much the turn from one image to another differs between robot and camera, whatever their mounts are. "
        f"It is {format_number(test.rms_deg, digits=2)} deg (root mean square); a pair agrees within "
        f"{format_number(test.tolerance_deg, digits=2)} deg. A wrong image is a dark cross; orange ones were ignored."
    )
    return Figure(
        (square, share),
        caption,
        f"A square of all pairs of images, and a plot by image. {caption}",
        columns=2,
        light_paper=True,
    )


def _agreeing(found: HandEyeByImages) -> FloatArray:
    """(n,) Share of the others with which an image agrees, of those that agree."""
    test = found.interpretation.test
    fits = (test.off_deg < test.tolerance_deg)[:, test.agree]
    return np.asarray((fits.sum(axis=1) - test.agree) / np.maximum(test.agree.sum() - test.agree, 1))


def _table(found: HandEyeByImages, left: _Left) -> Table:
    place = {row: i for i, row in enumerate(left.rows.tolist())}
    test, agreeing = found.interpretation.test, 100 * _agreeing(found)
    by = [(name, values) for name in left.mm for values in (left.mm[name], left.deg[name])]

    def rows() -> Iterator[tuple[Cell, ...]]:
        for row in order:
            off = [None if row not in place or np.isnan(values[place[row]]) else values[place[row]] for _, values in by]
            why = "" if row in place else "positions are gross errors" if test.agree[row] else "turns differ"
            yield row + 1, found.names[row], float(np.median(test.off_deg[row])), float(agreeing[row]), *off, why

    order = sorted(range(len(found.names)), key=lambda row: (row in place, row))
    heads = [
        Column("position [mm]" if i % 2 == 0 else "orientation [deg]", group=name) for i, (name, _) in enumerate(by)
    ]
    columns = (
        *Column.of("image", "in the file", "turns differ by [deg]", "agrees with [%]"),
        *heads,
        *Column.of("ignored, as"),
    )
    caption = (
        "Every image. How far the board is from where the other images put it; turns are compared with all others."
    )
    states: tuple[State, ...] = tuple("none" if row in place else "doubtful" for row in order)
    return Table(columns, tuple(rows()), caption, states=states)
