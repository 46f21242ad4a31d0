"""A page as one HTML document that loads no other file, and has no script but that of its interactive scenes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure as Drawing

from truearm.files.atomic_write import atomic_file
from truearm.number_format import format_exact, format_uncertainty
from truearm.pages.page import EMPTY_CELL, Page, Section, format_cell, table_of_rows
from truearm.pages.palette import style_rules
from truearm.pages.plotting import Figure, svg_element
from truearm.pages.scene import Scene, scene_script, script_hash
from truearm.printable_text import printable

_PIXELS_PER_INCH = 140  # at most, where a panel has 8.5 points of lettering
_LONG_TEXT = 550  # letters from which a text is set in two columns where the page is wide
_BESIDE = 1000  # letters up to which a text stands beside its figure


def render(page: Page) -> str:
    """The page as one HTML document. The same page gives the same bytes."""
    # Right after the first scenes, which can then be turned before the browser has read the rest.
    script_after = next((section for section in page.sections if section.scenes), None)
    script = "" if script_after is None else scene_script()
    filtered = any(table.filtered for section in page.sections for table in section.tables)
    filter_script = _package_text("table_filter.mjs") if filtered else ""
    has_cards = any(section.cards for section in page.sections)
    sheets = ["page.css", *(["scene.css"] if script else []), *(["cards.css"] if has_cards else [])]
    sheets += ["table_filter.css"] if filtered else []
    html = _template().render(
        page=page,
        style=Markup(style_rules() + "".join(map(_package_text, sheets))),  # noqa: S704, our own files
        script=Markup(script),  # noqa: S704, our own file
        script_after=script_after,
        filter_script=Markup(filter_script),  # noqa: S704, our own file
        script_hashes=Markup(" ".join(f"'{script_hash(one)}'" for one in (script, filter_script) if one)),  # noqa: S704
    )
    return printable(html)


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
    """Split a text at its empty lines."""
    # Not split(): it would split at the spaces that keep a number and its unit on one line.
    parts = text.replace("\r\n", "\n").split("\n\n")
    return [re.sub(r"[ \t\n]+", " ", part.strip()) for part in parts if part.strip()]


def is_long(text: str) -> bool:
    """Whether a text fills two columns of a wide page."""
    return len(text) > _LONG_TEXT


def is_beside(section: Section) -> bool:
    """Whether the text of a section stands beside its figure on a wide page: a short text and one single panel."""
    alone = not section.scenes and 0 < len(section.text) <= _BESIDE
    return alone and [one.columns for one in section.figures] == [1]


def with_places(figures: Sequence[Figure]) -> list[tuple[Figure, str]]:
    """Each figure with its place: "full", "half" beside the neighbour of its kind, or "alone" beside its caption."""
    places: list[tuple[Figure, str]] = []
    for figure in figures:
        if figure.columns > 1:
            places.append((figure, "full"))
        elif places and places[-1][1] == "alone":
            places[-1:] = [(places[-1][0], "half"), (figure, "half")]
        else:
            places.append((figure, "alone"))
    return places


# The template --------------------------------------------------------------------------------------------------------


def _picture(drawing: Drawing, prefix: str) -> Markup:
    return Markup(svg_element(drawing, prefix))  # noqa: S704, the XML writer has escaped every name in it


def _scene_data(scene: Scene) -> Markup:
    return Markup(scene.to_json())  # noqa: S704, every sign of markup in it is an escape


def _widest(drawing: Drawing) -> str:
    """The largest width of a panel on a page: its lettering is then as large as the text."""
    return f"{drawing.get_figwidth() * _PIXELS_PER_INCH:.0f}px"


def _package_text(name: str) -> str:
    return files("truearm.pages").joinpath(name).read_text(encoding="utf-8")


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals.update(
        picture=_picture,
        scene_data=_scene_data,
        widest=_widest,
        paragraphs=paragraphs,
        is_long=is_long,
        is_beside=is_beside,
        with_places=with_places,
        format_cell=format_cell,
        empty=EMPTY_CELL,
        exact=format_exact,
        uncertainty=format_uncertainty,
        table_of_rows=table_of_rows,
    )
    return environment.from_string(_package_text("page.html.j2"))
