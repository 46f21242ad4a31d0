"""What a document on paper has beside its page: number, letterhead, mark, signature lines, attached files, logo."""

from __future__ import annotations

import datetime
import io
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from truearm.errors import InputError
from truearm.files.file_reading import read_limited

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
    try:
        content = read_limited(path, limit_bytes=MAX_LOGO_BYTES)
        if content.startswith(b"\x89PNG\r\n\x1a\n"):
            _check_png(content)
            return Logo(content, "png")
        _check_svg(content)
        return Logo(content, "svg")
    except InputError as error:
        raise error.in_file(path) from None


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
