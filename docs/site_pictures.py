"""Pictures that the program draws: while the site is built its gallery and front page, and those of the README."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing
from PIL import Image

import truearm as ta
from truearm.pages.drawings.arm_drawing import arm_figure, project
from truearm.pages.drawings.arm_scene import joint_frames
from truearm.pages.html import write_page
from truearm.pages.page import Page
from truearm.pages.plotting import Figure, figure_style
from truearm.verbs.record import Record


def house_style(gallery_conf: object, file_name: object) -> None:
    """Give the figures that an example draws by pyplot the style of the program's own."""
    del gallery_conf, file_name
    with figure_style():
        settings = dict(mpl.rcParams)
    dict.update(mpl.rcParams, settings)
    mpl.rcParams.update(
        {"figure.figsize": (6.4, 3.9), "figure.dpi": 130, "figure.autolayout": True, "text.parse_math": True}
    )


def record_figure(block: Any, block_vars: dict[str, Any], gallery_conf: object) -> str:
    """Save the first panel of what an example shows, for its card; the page shows the record with its whole figure."""
    del gallery_conf
    body = ast.parse(block.content).body
    if not body or not isinstance(body[-1], ast.Expr):
        return ""
    shown = block_vars["example_globals"].get("___")
    figure = shown.figure() if isinstance(shown, Record) else shown
    if isinstance(figure, Figure):
        replace(figure, panels=figure.panels[:1]).save(next(block_vars["image_path_iterator"]))
    return ""


def write_front_page(folder: Path) -> None:
    """Write the scene of the front page and the pictures of its doors."""
    folder.mkdir(parents=True, exist_ok=True)
    session = ta.simulate("measuring7", poses=400, strategy="measuring", preset="research", seed=1).session
    train, test = session.split(by="row", hold_out=0.5, seed=1)
    report = ta.report(ta.fit("measuring7", train, model="physical").model, test).page()
    (scene,) = (section for section in report.sections if section.scenes)
    write_page(Page("A measuring arm and its errors", sections=(scene,)), folder / "scene.html")
    pictures = {
        "technician": drawing_of(ta.load_arm("measuring7")),
        "robot": drawing_of(ta.load_arm("ur10")),
        "researcher": first_panel(report, "Error of each joint"),
        "python": first_panel(report, "Distribution and coordinates"),
    }
    for name, picture in pictures.items():
        picture.save(folder / f"{name}.png", dpi=110)


def drawing_of(arm: ta.Arm) -> Figure:
    """The drawing of an arm in its working pose."""
    chain = arm.chain
    return arm_figure(joint_frames(chain, arm.working), chain.tip_in_base(arm.working[None])[0])


def first_panel(page: Page, title: str) -> Figure:
    """The first panel of a section's first figure."""
    (section,) = (section for section in page.sections if section.title == title)
    figure = section.figures[0]
    return replace(figure, panels=figure.panels[:1])


# The README's picture, for light and for dark screens: `python docs/site_pictures.py` writes it -----------------------

ERROR_SCALE = 400  # of the arrows
_PAPERS = {"light": ("#ffffff", "#1a1a1a", "#c8ced6", "#d55e00"), "dark": ("#0d1117", "#e6edf3", "#4b5560", "#ff9a4d")}


def write_readme_pictures(folder: Path) -> None:
    """Draw the errors of the README's ten lines at the readings held out, by the nominal and by the identified arm."""
    arm = ta.load_arm("ur10")
    session = ta.simulate(arm, poses=300, strategy="measuring", seed=1).session
    train, test = session.split(by="row", hold_out=0.3, seed=1)
    nominal, identified = ta.fit(arm, train, model="nominal").model, ta.fit(arm, train).model
    tried = ta.evaluate(identified, test)
    frames = joint_frames(arm.chain, arm.working)
    path = project(np.vstack([frames[:, :3, 3], arm.chain.tip_in_base(arm.working[None])]))
    for paper, (back, ink, link, hue) in _PAPERS.items():
        drawing = Drawing(figsize=(8.6, 3.7), facecolor=back)
        for place, (title, model) in enumerate({"nominal arm": nominal, "identified arm": identified}.items()):
            axes = drawing.add_axes((0.01 + 0.5 * place, 0.0, 0.48, 0.88))
            axes.set_axis_off()
            axes.set_aspect("equal")
            axes.plot(*path.T, color=link, linewidth=9, solid_capstyle="round", solid_joinstyle="round")
            axes.plot(*path[:-1].T, "o", color=link, markeredgecolor=ink, markersize=9, markeredgewidth=0.8)
            at = project(test.points)
            off = project(ERROR_SCALE * (model.predict(test.angles) - test.points))
            style = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.006, "color": hue}
            axes.quiver(*at.T, *off.T, **style)
            axes.plot(*at.T, ".", color=ink, markersize=3)
            low, high = at.min(axis=0) - 160, at.max(axis=0) + 160
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
            mean = tried.errors["nominal" if place == 0 else "model"]["mean_mm"]
            drawing.text(
                0.03 + 0.5 * place, 0.9, f"{title}: mean error {mean:.3f} mm", color=ink, size=13, weight="bold"
            )
        drawing.text(0.03, 0.02, f"90 readings held out, errors {ERROR_SCALE} times enlarged", color=ink, size=9)
        canvas = FigureCanvasAgg(drawing)
        drawing.dpi = 150
        canvas.draw()
        few = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(64, dither=Image.Dither.NONE)
        few.save(folder / f"arm_and_errors_{paper}.png", optimize=True)


if __name__ == "__main__":
    write_readme_pictures(Path(__file__).parent)
