"""Pictures that the program draws while the site is built: thumbnails of the gallery, the front page and its scene."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl

import truearm as ta
from truearm.pages.html import write_page
from truearm.pages.page import Page
from truearm.pages.plotting import Figure, figure_style
from truearm.show.arm_drawing import arm_figure
from truearm.show.arm_scene import joint_frames
from truearm.workflows.record import Record


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
