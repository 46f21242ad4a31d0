"""A page as HTML that needs nothing but itself: no script, no file beside it, no network."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from pathlib import Path

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure as Drawing

from truearm.files.atomic_write import atomic_file
from truearm.pages.cells import EMPTY_CELL, format_cell, grid_of_rows, grid_of_table
from truearm.pages.number_format import format_exact, format_uncertainty
from truearm.pages.page import Page
from truearm.pages.plotting import svg_element


def render(page: Page) -> str:
    """Give the page as one HTML document. The same page gives the same bytes."""
    style = Markup(_package_text("page.css"))  # noqa: S704, our own file
    html = _template().render(page=page, style=style)
    # Neither a NUL nor half a surrogate pair, which a name may bring along, can stand in a page.
    return html.replace("\x00", "\ufffd").encode("utf-8", "replace").decode("utf-8")


def write_page(page: Page, path: str | Path) -> None:
    """Write the page to `path`, whole or not at all.

    Raises
    ------
    InputError
        If the folder does not exist or is not writable.
    """
    html = render(page)
    with atomic_file(path) as beside:
        beside.write_text(html, encoding="utf-8", newline="\n")


def paragraphs(text: str) -> list[str]:
    """Part a text at its empty lines."""
    # Not split(): it would part at the spaces that keep a number and its unit on one line.
    parts = text.replace("\r\n", "\n").split("\n\n")
    return [re.sub(r"[ \t\n]+", " ", part.strip()) for part in parts if part.strip()]


def _picture(drawing: Drawing, prefix: str) -> Markup:
    return Markup(svg_element(drawing, prefix))  # noqa: S704, the XML writer has escaped every name in it


def _package_text(name: str) -> str:
    return files("truearm.pages").joinpath(name).read_text(encoding="utf-8")


@cache
def _template() -> jinja2.Template:
    house = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    house.globals.update(
        picture=_picture,
        paragraphs=paragraphs,
        format_cell=format_cell,
        nothing=EMPTY_CELL,
        given=format_exact,
        uncertainty=format_uncertainty,
        grid_of_table=grid_of_table,
        grid_of_rows=grid_of_rows,
    )
    return house.from_string(_package_text("page.html.j2"))
