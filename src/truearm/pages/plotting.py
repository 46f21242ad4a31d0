"""Paper and pens of every figure: sizes, palette, and the way from a drawing to SVG and PNG.

A figure is a row of small panels, not one wide picture: the page sets them side by side on a screen or on paper and
one below the other on a telephone, and their lettering stays readable on each.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing
from matplotlib.image import imsave
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import blended_transform_factory

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.pages.number_format import format_number

INK, FAINT, LIMIT = "#1a1a1a", "#d9dce0", "#8a9099"
LEFT_IN = 0.68  # room for a label and for numbers such as -0.0005
RASTER_FROM = 1000  # from so many dots on, a layer of dots is a picture and not one element a dot
_RASTER_DPI = 160  # sharp at the width the page shows a panel, also on paper
_LINES = {"axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "lines.linewidth": 1.2}
_COLOURS = {"axes.edgecolor": LIMIT, "axes.labelcolor": INK, "text.color": INK, "grid.color": FAINT}
_STYLE: Any = {
    **_LINES,
    **_COLOURS,
    "font.family": "DejaVu Sans",  # comes with matplotlib, so that it draws alike everywhere
    "font.size": 8.5,
    "axes.labelsize": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.linewidth": 0.5,
    "xtick.color": LIMIT,
    "ytick.color": LIMIT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.fonttype": "none",  # text stays text: small, sharp, searchable
    "svg.hashsalt": "truearm",  # the same figure has the same bytes
    "text.parse_math": False,  # a dollar sign in a name is a dollar sign
}


@dataclass(frozen=True)
class Figure:
    """Panels that are seen together, with a caption that says what to see.

    Parameters
    ----------
    panels : tuple of matplotlib.figure.Figure
        At least one.
    caption, alt : str
        Below the figure; and in its place for those who do not see it.
    columns : int
        Panels side by side on a wide page, 1 to 3.
    number : int, optional
        Of the paper's figure that this one stands for.
    """

    panels: tuple[Drawing, ...]
    caption: str
    alt: str
    columns: int = 1
    number: int | None = None

    def __post_init__(self) -> None:
        if not self.panels:
            raise InputError("expected a figure with at least one panel, got none")
        if not self.alt.strip() or not self.caption.strip():
            raise InputError("expected a caption and an alternative text for every figure, got an empty one")
        if self.columns not in (1, 2, 3):
            raise InputError(f"expected 1, 2 or 3 columns of panels, got {self.columns}")


@dataclass(frozen=True)
class Style:
    """How one model is drawn in every figure; marker and dash tell it apart in black and white."""

    colour: str
    marker: str
    dash: Any  # as matplotlib takes it


# Orange, navy, purple: apart for every common colour blindness, and 59, 26 and 45 in lightness on grey paper.
_PENS = (
    Style("#d9730d", "o", "-"),
    Style("#12407a", "s", "-"),
    Style("#a8488f", "^", "--"),
    Style("#2f8f8b", "D", "-."),
    Style("#6b7078", "v", ":"),
    Style("#8a7a00", "P", (0, (6, 1, 1, 1, 1, 1))),
)


def styles_of(names: Iterable[str], styles: Mapping[str, Style] | None = None) -> dict[str, Style]:
    """Give each model its pen, in the order of `names`; one already in `styles` keeps it.

    Call it once with all models of a report and hand the result to every figure: a model then has one colour
    throughout, also in figures that leave another out.
    """
    names = list(names)
    if styles is not None:
        missing = [name for name in names if name not in styles]
        if missing:
            raise InputError(f"expected a style for every model, got none for {missing[0]!r}")
        return {name: styles[name] for name in names}
    return dict(zip(names, cycle(_PENS), strict=False))


@contextmanager
def figure_style() -> Iterator[None]:
    """Draw by the rules of the report, whatever the user's own matplotlib settings are."""
    with mpl.rc_context(), warnings.catch_warnings():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        # A name may hold letters the font has not got; in an SVG the reader's own font shows them.
        warnings.filterwarnings("ignore", message=r"Glyph \d+ .* missing from font")
        yield


def make_panel(width_in: float, height_in: float, *, rows: int = 1, top_in: float = 0.26) -> tuple[Drawing, list[Axes]]:
    """Make a panel with `rows` axes one above the other, on margins that are the same in every panel."""
    drawing = Drawing(figsize=(width_in, height_in))
    FigureCanvasAgg(drawing)
    axes = drawing.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    drawing.subplots_adjust(
        left=LEFT_IN / width_in,
        right=1 - 0.12 / width_in,
        bottom=0.44 / height_in,
        top=1 - top_in / height_in,
        hspace=0.16,
    )
    for each in axes:
        # At a fixed place, so that the labels of neighbouring panels stand in line however long the numbers are.
        each.yaxis.set_label_coords(
            0.11, 0.5, transform=blended_transform_factory(drawing.dpi_scale_trans, each.transAxes)
        )
    return drawing, list(axes)


def set_log_scale(axes: Axes, which: str, low: float, high: float) -> None:
    """Give an axis ("x" or "y") a logarithmic scale from `low` to `high`, labelled with plain numbers."""
    getattr(axes, f"set_{which}scale")("log")
    axis = getattr(axes, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 400 * low else (1,), numticks=20))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
    getattr(axes, f"set_{which}lim")(low, high)


def shorten(name: object, *, longest: int = 26) -> str:
    """Give a name fit for a figure: one line, printable, not too long."""
    text = "".join(sign if sign.isprintable() else "\ufffd" for sign in str(name)) or "(no name)"
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def join_phrases(told: Iterable[str], *, most: int = 4) -> str:
    """Join what is told of each model; of a long list the first ones."""
    told = list(told)
    more = f"; and {len(told) - most} more" if len(told) > most else ""
    return "; ".join(told[:most]) + more


def reading_count(count: int) -> str:
    """Give a number of readings in words fit for a caption."""
    return f"{format_number(count)} reading{'' if count == 1 else 's'}"


def svg_element(drawing: Drawing, prefix: str) -> str:
    """Give a drawing as an SVG element for the inside of a page; every id in it starts with `prefix`."""
    buffer = io.BytesIO()
    no_date: Any = {"Date": None}
    with figure_style():
        drawing.savefig(buffer, format="svg", dpi=_RASTER_DPI, metadata=no_date)
    root = ElementTree.fromstring(buffer.getvalue())  # noqa: S314, matplotlib wrote it
    _for_html(root, prefix)
    return ElementTree.tostring(root, encoding="unicode", short_empty_elements=True)


def save_png(figure: Figure, path: str | Path, *, dpi: int = 200) -> None:
    """Write a figure as a PNG picture, its panels in rows as on a wide page."""
    with figure_style():
        pictures = [_pixels(drawing, dpi) for drawing in figure.panels]
    rows = [pictures[i : i + figure.columns] for i in range(0, len(pictures), figure.columns)]
    whole = _stacked([_stacked(row, axis=1) for row in rows], axis=0)
    unsigned: Any = {"Software": None}
    with atomic_file(path) as beside:
        imsave(beside, whole, format="png", dpi=dpi, metadata=unsigned)


_SVG, _XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
_URL = re.compile(r"url\(#([^)]+)\)")


def _for_html(root: ElementTree.Element, prefix: str) -> None:
    """Bring matplotlib's SVG into the form HTML wants: no namespaces, no metadata, ids that are used and unique."""
    for parent in root.iter():
        for child in [c for c in parent if c.tag in (f"{_SVG}metadata", f"{_SVG}style") or not isinstance(c.tag, str)]:
            parent.remove(child)
        for child in [c for c in parent if c.tag == f"{_SVG}defs"]:
            if not any(isinstance(c.tag, str) and c.tag != f"{_SVG}style" for c in child):
                parent.remove(child)
    for group in root.iter(f"{_SVG}g"):
        _style_once(group)
    used = {name for element in root.iter() for name in _references(element)}
    for element in root.iter():
        element.tag = element.tag.removeprefix(_SVG)
        element.attrib = dict(_attributes(element, prefix, used))
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.set("aria-hidden", "true")


def _style_once(group: ElementTree.Element) -> None:
    """Say once for all dots of a layer what matplotlib says for each one; it halves the page."""
    dots = [child for child in group if child.tag == f"{_SVG}use"]
    styles = {dot.get("style") for dot in dots}
    if len(dots) > 1 and len(dots) == len(group) and len(styles) == 1 and "style" not in group.attrib:
        group.set("style", styles.pop() or "")
        for dot in dots:
            dot.attrib.pop("style", None)
    for dot in dots:
        for key in ("x", "y"):
            dot.set(key, f"{float(dot.get(key, 0)):.2f}")


def _references(element: ElementTree.Element) -> Iterator[str]:
    for key, value in element.attrib.items():
        if key == f"{_XLINK}href" and value.startswith("#"):
            yield value[1:]
        yield from _URL.findall(value)


def _attributes(element: ElementTree.Element, prefix: str, used: set[str]) -> Iterator[tuple[str, str]]:
    for key, value in element.attrib.items():
        if key == "id":
            if value in used:
                yield key, f"{prefix}{value}"
        elif key == f"{_XLINK}href":
            yield "href", f"#{prefix}{value[1:]}" if value.startswith("#") else value
        elif not key.startswith("{"):
            yield key, _URL.sub(lambda found: f"url(#{prefix}{found[1]})", value)


def _pixels(drawing: Drawing, dpi: int) -> npt.NDArray[np.uint8]:
    usual = drawing.dpi
    drawing.set_dpi(dpi)
    try:
        canvas: Any = FigureCanvasAgg(drawing)
        canvas.draw()
        return np.array(canvas.buffer_rgba())
    finally:
        drawing.set_dpi(usual)


def _stacked(pictures: list[npt.NDArray[np.uint8]], *, axis: int) -> npt.NDArray[np.uint8]:
    """Join pictures along an axis, smaller ones filled up with white."""
    across = max(picture.shape[1 - axis] for picture in pictures)
    filled = []
    for picture in pictures:
        widths = [(0, 0), (0, 0), (0, 0)]
        widths[1 - axis] = (0, across - picture.shape[1 - axis])
        filled.append(np.pad(picture, widths, constant_values=255))
    return np.concatenate(filled, axis=axis)
