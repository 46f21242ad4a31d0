"""Style and size of every figure, and its conversion to SVG, PDF and PNG.

A figure is a row of small panels, not one wide picture: the page sets them side by side on a screen or on paper and
one below the other on a telephone, and the lettering stays readable on each.

The axes of a panel are matplotlib's own, but one tick is drawn at every place of its axis: matplotlib makes five
objects for each tick and lays out its label three times, which takes a quarter of the time of a page.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from html import escape
from itertools import cycle
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.backends import backend_mixed, backend_pdf
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing
from matplotlib.image import imsave
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from matplotlib.transforms import blended_transform_factory

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.pages.palette import FAINT, GREY, INK, LIMIT, NAVY, OLIVE, ORANGE, PURPLE, TEAL, with_variables
from truearm.typing import FloatArray


class PanelAxes(Axes):
    """Axes with one tick on each axis."""

    def _init_axis(self) -> None:
        self.xaxis, self.yaxis = _PanelXAxis(self), _PanelYAxis(self)
        for side in ("bottom", "top"):
            self.spines[side].register_axis(self.xaxis)
        for side in ("left", "right"):
            self.spines[side].register_axis(self.yaxis)

    def place_labels(self, *, left_in: float, bottom_in: float) -> None:
        """Set the labels of the axes at fixed distances from the left and the lower edge of the drawing [inch].

        The labels of neighbouring panels are then aligned however long the numbers are.
        """
        drawing = self.get_figure()
        assert drawing is not None
        inches = drawing.dpi_scale_trans
        self.xaxis.set_label_coords(0.5, bottom_in, transform=blended_transform_factory(self.transAxes, inches))
        self.yaxis.set_label_coords(left_in, 0.5, transform=blended_transform_factory(inches, self.transAxes))


class _PanelAxis(Axis):
    axis_name: str

    def reset_ticks(self) -> None:
        super().reset_ticks()
        self.minorTicks: list[Any] = []  # otherwise matplotlib makes the first one, which no panel shows

    def draw(self, renderer: RendererBase) -> None:
        if not self.get_visible():
            return
        places = np.asarray(self.get_majorticklocs(), dtype=np.float64)
        formatter = self.get_major_formatter()
        texts = formatter.format_ticks(list(places))
        # A figure that styles its ticks one by one, or shows others than these, has them drawn one by one.
        if len(self.majorTicks) > 1 or not isinstance(self.get_minor_locator(), NullLocator) or formatter.get_offset():
            super().draw(renderer)
            return
        along = self.get_transform().transform(places)
        low, high = np.sort(self.get_transform().transform(np.asarray(self.get_view_interval())))
        margin = 1e-10 * (high - low)  # a tick at the end of the axis is drawn although it is rounded
        shown = np.flatnonzero((along >= low - margin) & (along <= high + margin))
        if shown.size:
            self._draw_ticks(places[shown], [texts[i] for i in shown], renderer)
        self.label.draw(renderer)
        self.stale = False

    def _draw_ticks(self, places: FloatArray, texts: list[str], renderer: RendererBase) -> None:
        """Draw the grid as one line with gaps, the marks as markers of one line, and the labels one by one."""
        (tick,) = self.majorTicks
        n, horizontal = len(places), self.axis_name == "x"
        for line, across in ((tick.gridline, (0.0, 1.0, np.nan)), (tick.tick1line, (0.0,)), (tick.tick2line, (1.0,))):
            if line.get_visible():
                points = np.repeat(places, len(across)), np.tile(across, n)
                line.set_data(*points if horizontal else points[::-1])
                line.draw(renderer)
        for label in (tick.label1, tick.label2):
            if label.get_visible():
                for place, text in zip(places, texts, strict=True):
                    (label.set_x if horizontal else label.set_y)(place)
                    label.set_text(text)
                    label.draw(renderer)


class _PanelXAxis(_PanelAxis, XAxis):
    pass


class _PanelYAxis(_PanelAxis, YAxis):
    pass


# Without types of their own.
_mixed: Any = backend_mixed
_pdf: Any = backend_pdf

LEFT_IN = 0.75  # room for a label and for numbers such as -0.0005
RASTER_FROM = 1000  # number of dots from which a layer is a bitmap instead of one element a dot
_RASTER_DPI = 160  # sharp at the width the page shows a panel, also on paper
_MARGIN_PT = 4  # around a figure in a file of its own: labels reach to the edge of a panel
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
    "axes.titley": 1.0,  # not where the tick labels leave room: they are below, and to look takes a fifth of the time
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
    "pdf.fonttype": 42,  # TrueType: publishers refuse the other kind
    "text.parse_math": False,  # a dollar sign in a name is a dollar sign
}


@dataclass(frozen=True)
class Figure:
    """Panels that are seen together, with a caption.

    Parameters
    ----------
    panels : tuple of matplotlib.figure.Figure
        At least one.
    caption, alt : str
        Text below the figure; and text in its place for readers who do not see it.
    columns : int
        Panels side by side on a wide page, 1 to 3.
    light_paper : bool
        Whether it stays on white paper on a dark screen: it has colours that mean numbers, dark for large ones.
    """

    panels: tuple[Drawing, ...]
    caption: str
    alt: str
    columns: int = 1
    light_paper: bool = False

    def _repr_html_(self) -> str:
        """The panels and their caption, as notebooks show them."""
        drawings = (svg_element(panel, f"{id(self)}-{i}-") for i, panel in enumerate(self.panels))
        caption = f"<figcaption>{escape(self.caption)}</figcaption>"
        return f'<figure style="max-width:60em">{"".join(drawings)}{caption}</figure>'

    def save(self, path: str | Path, *, dpi: int = 200) -> None:
        """Write it as a picture or as a drawing that stays sharp in print.

        Parameters
        ----------
        path : path
            ``.png``, ``.svg`` or ``.pdf``, the panels in rows as on a wide page.
        dpi : int
            Of a ``.png``, and of the layers of many dots in the others.

        Raises
        ------
        InputError
            If the name has another ending, or the file cannot be written.
        """
        path = Path(path)
        writers: dict[str, Callable[[Figure, Path, int], None]] = {
            ".png": _write_png,
            ".svg": _write_svg,
            ".pdf": _write_pdf,
        }
        if path.suffix not in writers:
            raise InputError(f"expected a file name that ends in {', '.join(writers)}, got {path.name!r}", file=path)
        with atomic_file(path) as beside:
            writers[path.suffix](self, beside, dpi)


@dataclass(frozen=True)
class Style:
    """How one series is drawn in every figure; marker and dash distinguish it in black and white."""

    colour: str
    marker: str
    dash: Any  # as matplotlib takes it


_PENS = (
    Style(ORANGE, "o", "-"),
    Style(NAVY, "s", "-"),
    Style(PURPLE, "^", "--"),
    Style(TEAL, "D", "-."),
    Style(GREY, "v", ":"),
    Style(OLIVE, "P", (0, (6, 1, 1, 1, 1, 1))),
)


def styles_of(names: Iterable[str], styles: Mapping[str, Style] | None = None) -> dict[str, Style]:
    """Assign a style to each series, in the order of `names`; one that is in `styles` keeps it.

    Call it once with all series of a page and pass the result to every figure: a series then has one colour
    throughout, also in figures that show only some of them.
    """
    names = list(names)
    if styles is not None:
        missing = [name for name in names if name not in styles]
        if missing:
            raise InputError(f"expected a style for every series, got none for {missing[0]!r}")
        return {name: styles[name] for name in names}
    return dict(zip(names, cycle(_PENS), strict=False))


@cache
def _settings() -> dict[str, Any]:
    """All settings of matplotlib in the style of the pages."""
    settings: Any = mpl.rcParams
    with mpl.rc_context():
        mpl.rcdefaults()
        settings.update(_STYLE)
        return dict(settings)


@contextmanager
def figure_style() -> Iterator[None]:
    """Draw in the style of the pages, whatever the user's own matplotlib settings are."""
    settings: Any = mpl.rcParams
    with mpl.rc_context(), warnings.catch_warnings():
        dict.update(settings, _settings())  # without the checks of each, which a page would repeat a hundred times
        # A name may have letters that the font lacks; in an SVG the reader's own font shows them.
        warnings.filterwarnings("ignore", message=r"Glyph \d+ .* missing from font")
        yield


def make_panel(width_in: float, height_in: float, *, rows: int = 1, top_in: float = 0.26) -> tuple[Drawing, list[Axes]]:
    """Panel with `rows` axes one above the other; the margins are the same in every panel."""
    drawing = Drawing(figsize=(width_in, height_in))
    axes = drawing.subplots(rows, 1, sharex=True, squeeze=False, subplot_kw={"axes_class": PanelAxes})[:, 0]
    drawing.subplots_adjust(
        left=LEFT_IN / width_in,
        right=1 - 0.12 / width_in,
        bottom=0.44 / height_in,
        top=1 - top_in / height_in,
        hspace=0.16,
    )
    for each in axes:
        each.set_title("")  # takes the height of the style
        each.place_labels(left_in=0.15, bottom_in=0.169)
    return drawing, list(axes)


def make_view(
    size_in: tuple[float, float], low: FloatArray, high: FloatArray, *, labels: Iterable[str], title: str
) -> tuple[Drawing, Axes]:
    """Make a view of a plane, with one scale across and up, and a cross at its origin.

    Parameters
    ----------
    size_in : (float, float)
        Width and height [in].
    low, high : (2,) array
        Ends of what is seen [mm].
    labels : two str
        Across and up, with units.
    title : str

    Returns
    -------
    drawing : matplotlib Figure
    axes : PanelAxes
    """
    drawing, room = Drawing(figsize=size_in), np.array(size_in) - [0.94, 0.74]
    axes = PanelAxes(drawing, (0.78 / size_in[0], 0.46 / size_in[1], *(room / size_in)))
    drawing.add_axes(axes)
    axes.place_labels(left_in=0.22, bottom_in=0.189)
    middle, half = (low + high) / 2, 0.54 * max(*(high - low) / room, 1.0) * room
    across, up = labels
    axes.set(xlabel=across, ylabel=up, title=title, aspect="equal")
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    if (np.abs(middle) < half).all():
        axes.plot(0, 0, marker="+", markersize=9, markeredgewidth=1.2, color=INK, zorder=5)
    return drawing, axes


def dot_style(n: int, area: float) -> dict[str, Any]:
    """How `n` dots are drawn that together have an area [pt^2]: the more, the smaller and the paler."""
    many = n > RASTER_FROM
    return {"s": min(max(area / n, 1.2), 9.0), "alpha": 0.3 if many else 0.7, "linewidths": 0, "rasterized": many}


def set_log_scale(axes: Axes, which: str, low: float, high: float) -> None:
    """Set a logarithmic scale from `low` to `high` on an axis ("x" or "y"), labelled with plain numbers."""
    getattr(axes, f"set_{which}scale")("log")
    axis = getattr(axes, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 400 * low else (1,), numticks=20))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())  # a tick is five drawn objects, and there would be dozens
    getattr(axes, f"set_{which}lim")(low, high)


def shorten(name: object, *, longest: int = 26) -> str:
    """A name for a figure: one line, printable, at most `longest` letters."""
    text = "".join(sign if sign.isprintable() else "\ufffd" for sign in str(name)) or "(no name)"
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def join_phrases(phrases: Iterable[str], *, most: int = 4) -> str:
    """Join phrases with semicolons; of a long list the first ones."""
    phrases = list(phrases)
    more = f"; and {len(phrases) - most} more" if len(phrases) > most else ""
    return "; ".join(phrases[:most]) + more


def svg_element(drawing: Drawing, prefix: str) -> str:
    """A drawing as an SVG element of a page; every id in it starts with `prefix`."""
    root = _parsed_svg(drawing, _RASTER_DPI)
    _for_html(root, prefix)
    return ElementTree.tostring(root, encoding="unicode", short_empty_elements=True)


def pixels_of(figure: Figure, *, dpi: int = 200) -> npt.NDArray[np.uint8]:
    """A figure as a picture (height, width, 4), its panels in rows as on a wide page."""
    with figure_style():
        pictures = [_pixels(drawing, dpi) for drawing in figure.panels]
    rows = [pictures[i : i + figure.columns] for i in range(0, len(pictures), figure.columns)]
    return _stacked([_stacked(row, axis=1) for row in rows], axis=0)


def _write_png(figure: Figure, path: Path, dpi: int) -> None:
    unsigned: Any = {"Software": None}
    imsave(path, pixels_of(figure, dpi=dpi), format="png", dpi=dpi, metadata=unsigned)


def _write_svg(figure: Figure, path: Path, dpi: int) -> None:
    whole = ElementTree.Element(f"{_SVG}svg", {"version": "1.1"})
    left = top = width = row_height = 0.0
    for i, drawing in enumerate(figure.panels):
        if i % figure.columns == 0:
            left, top, row_height = 0.0, top + row_height, 0.0
        panel = _parsed_svg(drawing, dpi)
        _prefix_ids(panel, f"p{i}-")
        _, _, w, h = map(float, panel.get("viewBox", "").split())
        panel.attrib |= {
            "x": f"{left:g}",
            "y": f"{top:g}",
            "width": f"{w:g}",
            "height": f"{h:g}",
            "overflow": "visible",
        }
        whole.append(panel)
        left, row_height = left + w, max(row_height, h)
        width = max(width, left)
    height = top + row_height
    m = _MARGIN_PT
    width, height = width + 2 * m, height + 2 * m
    whole.attrib |= {"width": f"{width:g}pt", "height": f"{height:g}pt", "viewBox": f"{-m} {-m} {width:g} {height:g}"}
    ElementTree.ElementTree(whole).write(path, encoding="utf-8", xml_declaration=True)


def _write_pdf(figure: Figure, path: Path, dpi: int) -> None:
    """One sheet; each panel is drawn in a frame of its own, as the canvas of matplotlib knows one drawing only."""
    undated: Any = {"CreationDate": None, "Creator": None, "Producer": None}
    m = _MARGIN_PT / 72
    sizes = np.array([drawing.get_size_inches() for drawing in figure.panels]) + 2 * m
    rows = [range(i, min(i + figure.columns, len(sizes))) for i in range(0, len(sizes), figure.columns)]
    heights = [sizes[row, 1].max() for row in rows]
    file = _pdf.PdfFile(path, metadata=undated)
    with figure_style():
        file.newPage(max(sizes[row, 0].sum() for row in rows), sum(heights))
        for k, row in enumerate(rows):
            lower = sum(heights[k:])
            for i in row:
                left = sizes[row.start : i, 0].sum() + m
                _draw_in_pdf(file, figure.panels[i], (72 * left, 72 * (lower - sizes[i, 1] + m)), dpi)
        file.finalize()
        file.close()


def _draw_in_pdf(file: Any, drawing: Drawing, at_pt: tuple[float, float], dpi: int) -> None:
    """Draw a panel with its lower left corner at a place of the sheet."""
    (width, height), usual = drawing.get_size_inches(), drawing.dpi
    drawing.set_dpi(72)  # a unit of the sheet is a point
    try:
        file.output(_pdf.Op.gsave)
        file.output(1, 0, 0, 1, *at_pt, _pdf.Op.concat_matrix)
        of_sheet = _pdf.RendererPdf(file, dpi, height, width)
        renderer = _mixed.MixedModeRenderer(drawing, width, height, dpi, of_sheet)
        drawing.draw(renderer)
        renderer.finalize()
        file.output(_pdf.Op.grestore)
    finally:
        drawing.set_dpi(usual)


def _parsed_svg(drawing: Drawing, dpi: int) -> ElementTree.Element:
    buffer = io.StringIO()
    no_date: Any = {"Date": None}
    with figure_style():
        drawing.savefig(buffer, format="svg", dpi=dpi, metadata=no_date)
    return ElementTree.fromstring(buffer.getvalue())  # noqa: S314, matplotlib wrote it


def _prefix_ids(root: ElementTree.Element, prefix: str) -> None:
    """Start every id with a prefix, so that it is unique beside those of other panels."""
    for element in root.iter():
        for key, value in element.attrib.items():
            if key == "id":
                element.set(key, f"{prefix}{value}")
            elif key == f"{_XLINK}href" and value.startswith("#"):
                element.set(key, f"#{prefix}{value[1:]}")
            else:
                element.set(key, _URL.sub(lambda found: f"url(#{prefix}{found[1]})", value))


_SVG, _XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
ElementTree.register_namespace("", _SVG[1:-1])
ElementTree.register_namespace("xlink", _XLINK[1:-1])
_URL = re.compile(r"url\(#([^)]+)\)")


def _for_html(root: ElementTree.Element, prefix: str) -> None:
    """Convert matplotlib's SVG for HTML: no namespaces, no metadata, unique ids and only those that are used."""
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
    """Move the style that all dots of a layer share to the layer; it halves the size of the page."""
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
            value = _URL.sub(lambda found: f"url(#{prefix}{found[1]})", value)
            yield key, with_variables(value) if key in ("style", "fill", "stroke") else value


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
    """Join pictures along an axis; smaller ones are padded with white."""
    across = max(picture.shape[1 - axis] for picture in pictures)
    filled = []
    for picture in pictures:
        widths = [(0, 0), (0, 0), (0, 0)]
        widths[1 - axis] = (0, across - picture.shape[1 - axis])
        filled.append(np.pad(picture, widths, constant_values=255))
    return np.concatenate(filled, axis=axis)
