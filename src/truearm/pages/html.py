"""A page as one HTML document that loads no other file, and has no script but that of its interactive scenes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure as Drawing

from truearm.files.atomic_write import atomic_file
from truearm.number_format import RoundedNumber, format_exact, format_number, format_uncertainty
from truearm.pages.page import Cell, Column, LabelledValue, Page, Section, State, Table
from truearm.pages.palette import style_rules
from truearm.pages.plotting import Figure, svg_element
from truearm.pages.scene import Scene, scene_script, script_hash

_PIXELS_PER_INCH = 140  # at most, where a panel has 8.5 points of lettering
_LONG_TEXT = 550  # letters from which a text is set in two columns where the page is wide
_BESIDE = 1000  # letters up to which a text stands beside its figure


def render(page: Page) -> str:
    """The page as one HTML document. The same page gives the same bytes."""
    # Right after the first scenes, which can then be turned before the browser has read the rest.
    script_after = next((section for section in page.sections if section.scenes), None)
    script = "" if script_after is None else scene_script()
    has_cards = any(section.cards for section in page.sections)
    sheets = ["page.css", *(["scene.css"] if script else []), *(["cards.css"] if has_cards else [])]
    html = _template().render(
        page=page,
        style=Markup(style_rules() + "".join(map(_package_text, sheets))),  # noqa: S704, our own files
        script=Markup(script),  # noqa: S704, our own file
        script_after=script_after,
        script_hash=script_hash() if script else "",
    )
    # HTML permits neither NUL nor half a surrogate pair, and a name may contain them.
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


# Cells ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FormattedCell:
    """A cell as the page shows it; a number is split at its decimal point."""

    text: str
    whole: str = ""
    fraction: str = ""

    @property
    def is_number(self) -> bool:
        """Whether the cell is aligned with the numbers of its column."""
        return bool(self.whole)


EMPTY_CELL = FormattedCell("\u2013")


@dataclass(frozen=True)
class FormattedTable:
    """Cells in rows under their column heads."""

    heads: tuple[Column, ...]
    rows: tuple[tuple[FormattedCell, ...], ...]
    caption: str = ""
    fillable: bool = False
    states: tuple[State, ...] = ()
    folded: bool = False

    @property
    def title(self) -> str:
        """The first sentence of the caption, which a folded table shows."""
        return self.caption.partition(". ")[0]

    @property
    def note(self) -> str:
        """The caption after its first sentence."""
        return self.caption.partition(". ")[2]

    @property
    def has_head(self) -> bool:
        """Whether any column has a heading."""
        return any(head.heading for head in self.heads)

    @property
    def numeric(self) -> tuple[bool, ...]:
        """For each column, whether it has a number."""
        return tuple(any(row[k].is_number for row in self.rows) for k in range(len(self.heads)))

    @property
    def groups(self) -> tuple[tuple[Column, int], ...]:
        """Heads in a row, each with the number of columns below it."""
        heads: list[tuple[Column, int]] = []
        for head in self.heads:
            if heads and head.group and heads[-1][0].group == head.group:
                heads[-1] = (heads[-1][0], heads[-1][1] + 1)
            else:
                heads.append((head, 1))
        return tuple(heads)

    @property
    def decimal_widths(self) -> tuple[int, ...]:
        """For each column, the room right of the decimal point, in characters."""
        return tuple(max((len(row[k].fraction) for row in self.rows), default=0) for k in range(len(self.heads)))


def format_cell(value: Cell, *, uncertainty: float | None = None, digits: int = 3) -> FormattedCell:
    """A cell as the page shows it; an empty one is a dash."""
    if value is None:
        return EMPTY_CELL
    if isinstance(value, str):
        return FormattedCell(value)
    if isinstance(value, RoundedNumber):
        uncertainty, value = value.uncertainty, value.value
    return _split(format_number(value, uncertainty=uncertainty, digits=digits))


def grid_of_table(table: Table) -> FormattedTable:
    """Format the cells of a table, each with the digits of its column."""
    rows = tuple(
        tuple(format_cell(cell, digits=column.digits) for column, cell in zip(table.columns, row, strict=True))
        for row in table.rows
    )
    return FormattedTable(table.columns, rows, table.caption, table.fillable, table.states, table.folded)


def grid_of_rows(rows: Sequence[LabelledValue]) -> FormattedTable:
    """Format rows as a table: quantity, value, uncertainty and limit if any row has one, unit."""
    columns = {
        "quantity": [FormattedCell(row.label) for row in rows],
        "value": [format_cell(row.value, uncertainty=row.uncertainty) for row in rows],
        "standard uncertainty": [
            EMPTY_CELL if row.uncertainty is None else _split(format_uncertainty(row.uncertainty)) for row in rows
        ],
        "limit": [EMPTY_CELL if row.limit is None else _split(format_exact(row.limit)) for row in rows],
        "unit": [FormattedCell(row.unit or "") for row in rows],
    }
    for optional in ("standard uncertainty", "limit"):
        if all(cell == EMPTY_CELL for cell in columns[optional]):
            del columns[optional]
    states = tuple(row.state for row in rows)
    return FormattedTable(tuple(map(Column, columns)), tuple(zip(*columns.values(), strict=True)), states=states)


def _split(number: str) -> FormattedCell:
    whole, point, fraction = number.partition(".")
    return FormattedCell(number, whole, point + fraction)


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
        grid_of_table=grid_of_table,
        grid_of_rows=grid_of_rows,
    )
    return environment.from_string(_package_text("page.html.j2"))
