"""A page as a PDF/A-3 file for A4: sheets with number and page count, tables that continue, fonts and files inside.

Typst sets the sheets by `sheets.typ` and writes the document (ISO 19005-3:2012, level A: fonts embedded, colours by an
sRGB profile, XMP metadata, attached files with their relationship, headings and tables tagged, no encryption and no
script). The font is DejaVu Sans, which matplotlib brings along, so that no font of the system is needed.

What a document on paper has beside its page: number, letterhead, mark, signature lines, attached files, logo.
"""

from __future__ import annotations

import datetime
import io
import json
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal
from unicodedata import category

from truearm.errors import InputError, extra_module
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import read_limited
from truearm.pages.html import paragraphs
from truearm.pages.page import (
    Column,
    FormattedCell,
    LabelledValue,
    Page,
    PageVerdict,
    Section,
    State,
    Table,
    format_cell,
    table_of_rows,
)
from truearm.pages.palette import BAD, DOUBTFUL, FAINT, GOOD, INK, SOFT
from truearm.pages.plotting import Figure, pixels_of
from truearm.printable_text import printable

MAX_LOGO_BYTES = 2_000_000
MAX_LOGO_PIXELS = 4000  # of a side
# Shapes only: no text (its font would have to be embedded), no script, nothing that another file is loaded for.
_SHAPES = frozenset(
    {"svg", "g", "defs", "title", "desc", "path", "rect", "circle", "ellipse", "line", "polyline", "polygon"}
    | {"linearGradient", "radialGradient", "stop"}
)
_SVG = "{http://www.w3.org/2000/svg}"


@dataclass(frozen=True)
class Logo:
    """A checked picture; `kind` is that of its content, whatever the name of the file is."""

    content: bytes
    kind: Literal["png", "svg"]


@dataclass(frozen=True)
class Attachment:
    """A file inside the document: `relationship` as ISO 19005-3 has it, Source for that of which it is the picture."""

    name: str
    content: bytes
    mime_type: str
    description: str
    relationship: Literal["Source", "Data", "Supplement"] = "Source"


@dataclass(frozen=True)
class Paper:
    """A page on paper.

    Parameters
    ----------
    heading : str
        At the head of every sheet: the kind and the number of the document.
    issuer : tuple of str
        Name and address of who issues it, beside the logo.
    date : date
    mark : str
        Across every sheet; empty for none.
    signatures : tuple of str
        Below each signature line: name and function.
    attachments : tuple of Attachment
    logo : Logo, optional
    """

    heading: str
    issuer: tuple[str, ...]
    date: datetime.date
    mark: str = ""
    signatures: tuple[str, ...] = ()
    attachments: tuple[Attachment, ...] = ()
    logo: Logo | None = None


def read_logo(path: str | Path) -> Logo:
    """Read a logo: a PNG of at most 4000 x 4000 pixels, or an SVG of shapes, 2 MB at most.

    Raises
    ------
    InputError
        If the file is missing, too large, neither of both, or the SVG contains text, pictures, scripts or references.
    """
    with InputError.of_file(path):
        content = read_limited(path, limit_bytes=MAX_LOGO_BYTES)
        if content.startswith(b"\x89PNG\r\n\x1a\n"):
            _check_png(content)
            return Logo(content, "png")
        _check_svg(content)
        return Logo(content, "svg")


def _check_png(content: bytes) -> None:
    from PIL import Image, UnidentifiedImageError

    # Of the first chunk, IHDR (PNG specification, 11.2.1): before a library looks at the pixels.
    width, height = (int.from_bytes(content[at : at + 4], "big") for at in (16, 20))
    if max(width, height) > MAX_LOGO_PIXELS:
        raise InputError(
            f"the logo has {width} x {height} pixels, more than {MAX_LOGO_PIXELS} on a side",
            hint="make it smaller; 600 pixels are enough",
        )
    try:
        with Image.open(io.BytesIO(content), formats=["PNG"]) as picture:
            # A second IHDR chunk would replace the first.
            if picture.size != (width, height):
                raise ValueError("it states two sizes")
            picture.load()
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, SyntaxError, ValueError) as error:
        raise InputError(f"the PNG cannot be read ({error})", hint="save the logo again as PNG") from None


def _check_svg(content: bytes) -> None:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("expected a logo, PNG or SVG", hint="save it as PNG") from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("the SVG has a DOCTYPE or ENTITY; truearm refuses such files", hint="save it as plain SVG")
    try:
        root = ET.fromstring(text)  # noqa: S314, it has no document type
    except (ET.ParseError, ValueError):
        raise InputError("expected a logo, PNG or SVG", hint="save it as PNG") from None
    if root.tag != f"{_SVG}svg":
        raise InputError("expected a logo, PNG or SVG", hint="save it as PNG")
    for element in root.iter():
        name = str(element.tag).removeprefix(_SVG)
        if name not in _SHAPES:
            raise InputError(
                f"the SVG contains <{name:.40}>; a logo consists of shapes",
                hint="convert text and symbols to paths and save it as plain SVG, or as PNG",
            )
        for key, value in element.attrib.items():
            local = key.rpartition("}")[2].lower()
            if local == "href" or local.startswith("on") or re.search(r"url\(\s*[^#\s]", value):
                raise InputError(f"the SVG refers to another file or a script ({local})", hint="save it as PNG")


_STATES: dict[State, tuple[str, str]] = {
    "good": (GOOD, "\u2713"),
    "doubtful": (DOUBTFUL, "?"),
    "bad": (BAD, "\u2717"),
    "withdrawn": (SOFT, ""),
    "none": (INK, ""),
}
_WASH = {"good": "#eaf6ec", "doubtful": "#fdf4dd", "bad": "#fdeceb", "withdrawn": "#f6f7f8", "none": "#f6f7f8"}
_LONGEST_WORD = 40  # characters; longer ones may be divided between lines
_FIGURE_SPACE, _POINT_SPACE = "\u2007", "\u2008"  # as wide as a digit, as wide as a point
_DIVIDES = "\u200b"  # has no width and no glyph


def write_pdf(page: Page, paper: Paper, path: str | Path) -> None:
    """Write a page as PDF/A-3, whole or not at all; the same page gives the same bytes.

    Parameters
    ----------
    page : Page
        Folded parts are open; interactive scenes are not drawn, only their static figures.
    paper : Paper
    path : path

    Raises
    ------
    MissingTool
        If typst is not installed.
    InputError
        If the font has no glyph for a character outside the facts, or the logo cannot be drawn.
    """
    content = pdf_bytes(page, paper)
    with atomic_file(path) as beside:
        beside.write_bytes(content)


def check_pdf_writer() -> None:
    """Check, before long work, that PDF files can be written.

    Raises
    ------
    MissingTool
        If typst is not installed.
    """
    _typst()


def pdf_bytes(page: Page, paper: Paper) -> bytes:
    """The content of the file, see `write_pdf`."""
    typst = _typst()
    with TemporaryDirectory(prefix="truearm-pdf-") as folder:

        def kept(content: bytes, ending: str) -> str:
            path = Path(folder, f"{len(os.listdir(folder))}.{ending}")
            path.write_bytes(content)
            return path.name

        contents = _known(_contents(page, paper, kept)) | {"attachments": _attachments(paper, kept)}
        Path(folder, "page.json").write_text(json.dumps(contents), encoding="utf-8")
        sheets = Path(folder, "sheets.typ")
        sheets.write_bytes(files("truearm.pages").joinpath("sheets.typ").read_bytes())
        try:
            done: bytes = typst.compile(
                sheets, root=folder, font_paths=[_fonts()], ignore_system_fonts=True, pdf_standards="a-3a"
            )
        except typst.TypstError as error:
            if "SVG" not in error.message and "image" not in error.message:
                raise
            raise InputError(f"the logo cannot be drawn ({error.message})", hint="save it as PNG") from None
    return done


def _typst() -> Any:
    return extra_module("typst", "writing PDF files needs the package typst", "pip install 'truearm[pdf]'")


def _contents(page: Page, paper: Paper, kept: Callable[[bytes, str], str]) -> dict[str, Any]:
    """What `sheets.typ` sets: texts, colours, names of pictures."""
    # Names of files are not the author's to change: characters that the font lacks are escaped.
    facts = tuple(tuple(map(_escaped, fact)) for fact in page.facts)
    sections = [_section(section, kept) for section in page.sections]
    if facts:
        table = _table(Table((Column(""), Column("")), facts, ""), size=7.5)
        sections.append(
            {
                "title": "Files and programs",
                "is-empty": False,
                "verdict": None,
                "text": [],
                "tables": [table],
                "figures": [],
            }
        )
    return {
        "colours": [INK, SOFT, FAINT, BAD],
        "heading": paper.heading,
        "issuer": paper.issuer,
        "subject": f"{paper.heading}. {paper.mark}".strip(),
        "date": [paper.date.year, paper.date.month, paper.date.day],
        "issued": paper.date.isoformat(),
        "mark": paper.mark,
        "logo": paper.logo and kept(paper.logo.content, paper.logo.kind),
        "title": page.title,
        "subtitle": page.subtitle,
        "verdict": page.verdict and _verdict(page.verdict),
        "summary": [_key_number(one) for one in page.summary],
        "sections": sections,
        "signatures": paper.signatures,
    }


def _attachments(paper: Paper, kept: Callable[[bytes, str], str]) -> list[dict[str, str]]:
    return [
        {
            "name": one.name,
            "file": kept(one.content, "attached"),
            "relationship": one.relationship.lower(),
            "mime_type": one.mime_type,
            "description": one.description,
        }
        for one in paper.attachments
    ]


def _verdict(verdict: PageVerdict) -> dict[str, str]:
    colour, sign = _STATES[verdict.state]
    sentence = f"{sign} {verdict.sentence}".strip()
    return {"sentence": sentence, "detail": verdict.detail, "colour": colour, "wash": _WASH[verdict.state]}


def _key_number(one: LabelledValue) -> dict[str, str]:
    number = format_cell(one.value, uncertainty=one.uncertainty).text
    return {"number": f"{number} {one.unit}".strip(), "label": one.label, "colour": _STATES[one.state][0]}


def _section(section: Section, kept: Callable[[bytes, str], str]) -> dict[str, Any]:
    tables = [*([table_of_rows(section.rows)] if section.rows else []), *section.tables]
    text = paragraphs(section.text)
    # A figure for which a sheet has no room waits for the next one, so that this one is filled; not one that stands
    # alone below its heading.
    waits = bool(text or tables or section.verdict)
    return {
        "is-empty": not (waits or section.figures),
        "title": section.title,
        "verdict": section.verdict and _verdict(section.verdict),
        "text": text,
        "tables": [_table(table) for table in tables],
        "figures": [_figure(figure, kept) | {"waits": waits} for figure in section.figures],
    }


def _table(grid: Table, *, size: float = 8.0) -> dict[str, Any]:
    heads = [f"{head.heading} [{head.unit}]" if head.unit else head.heading for head in grid.columns]
    rows = []
    states: Sequence[State] = grid.states or ["none"] * len(grid.cells)
    for cells, state in zip(grid.cells, states, strict=True):
        colour, sign = _STATES[state]
        texts = [_aligned(cell, room) for cell, room in zip(cells, grid.decimal_widths, strict=True)]
        texts[0] = f"{sign} {texts[0]}".strip()
        rows.append({"cells": texts, "colour": colour if state in ("bad", "doubtful") else INK})
    shown = heads if any(heads) or len(heads) != 2 else []
    return {"caption": grid.caption, "heads": shown, "numeric": grid.numeric, "rows": rows, "size": size}


def _aligned(cell: FormattedCell, room: int) -> str:
    """A cell as text; spaces as wide as digits bring decimal points below each other."""
    if not cell.is_number:
        return cell.text
    if not cell.fraction:
        return cell.text + (_POINT_SPACE + _FIGURE_SPACE * (room - 1) if room else "")
    return cell.text + _FIGURE_SPACE * (room - len(cell.fraction))


def _figure(figure: Figure, kept: Callable[[bytes, str], str]) -> dict[str, Any]:
    from PIL import Image

    pixels, content = pixels_of(figure), io.BytesIO()
    Image.fromarray(pixels[:, :, :3]).save(content, "PNG")
    height, width = pixels.shape[:2]
    return {
        "file": kept(content.getvalue(), "png"),
        "ratio": height / width,
        "alt": figure.alt,
        "caption": figure.caption,
    }


# Characters ----------------------------------------------------------------------------------------------------------


def _known(value: Any) -> Any:
    """The contents, if the font has all their characters: a missing glyph would be lost, and PDF/A forbids it."""
    if isinstance(value, dict):
        return {name: _known(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_known(one) for one in value]
    if not isinstance(value, str):
        return value
    text = printable(value).replace("\u202f", "\u00a0").replace("\n", " ").replace("\u00ad", "")
    if missing := list(dict.fromkeys(sign for sign in text if not _has(sign))):
        raise InputError(
            f"the font of the PDF has no glyph for {' '.join(missing[:5])} in {text!r:.80}",
            hint="write the text in Latin, Greek or Cyrillic letters",
        )
    return re.sub(rf"(\S{{{_LONGEST_WORD}}})(?=\S)", rf"\1{_DIVIDES}", text)


def _escaped(text: str) -> str:
    """The text with escapes, as Python writes them, in place of characters that the font lacks."""
    return "".join(sign if sign == "\u202f" or _has(sign) else sign.encode("unicode_escape").decode() for sign in text)


def _has(sign: str) -> bool:
    """Whether the font has a character, plain and bold, that is seen and that PDF/A permits (none of private use)."""
    return ord(sign) in _glyphs() and sign != "\u00ad" and category(sign) != "Co"


@cache
def _glyphs() -> frozenset[int]:
    from matplotlib.ft2font import FT2Font

    faces = (FT2Font(str(_fonts() / name)) for name in ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf"))
    return frozenset.intersection(*(frozenset(face.get_charmap()) for face in faces))


def _fonts() -> Path:
    import matplotlib

    return Path(matplotlib.get_data_path(), "fonts", "ttf")
