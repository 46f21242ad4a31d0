"""A page as a PDF/A-3 file for A4: sheets with number and page count, tables that continue, fonts and files inside.

The document is written by fpdf2 in its PDF/A-3B mode (ISO 19005-3:2012, level B): fonts embedded, colours by an sRGB
profile, XMP metadata, attached files with their relationship, no encryption and no script. The font is DejaVu Sans,
which matplotlib brings along, so that no font of the system is needed.
"""

from __future__ import annotations

import datetime
import io
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.extra_packages import extra_module
from truearm.pages.html import paragraphs
from truearm.pages.page import (
    Column,
    LabelledValue,
    Page,
    PageVerdict,
    Section,
    State,
    Table,
    format_cell,
    table_of_rows,
)
from truearm.pages.palette import BAD, DOUBTFUL, FAINT, GOOD, INK, PAPER, SOFT, channels
from truearm.pages.paper import Paper
from truearm.pages.plotting import Figure, pixels_of
from truearm.printable_text import printable

MARGIN_MM, TOP_MM, BOTTOM_MM = 18.0, 24.0, 20.0
WIDTH_MM = 210.0 - 2 * MARGIN_MM
HEIGHT_MM = 297.0 - TOP_MM - BOTTOM_MM
# Room that a heading needs below it, or it moves to the next sheet.
KEPT_MM = 32.0
# Tables up to this height are not divided between sheets.
WHOLE_MM = 80.0
# A figure is drawn smaller, down to this share, if it fits on the sheet then; else it waits for the next sheet.
SMALLEST_SHARE = 0.6
# A title of more letters is set in the size of a heading.
LONG_TITLE = 60
SMALL, TEXT, HEADING, TITLE = 7.5, 9.0, 11.5, 17.0  # pt
_FONT = "DejaVu"
_STATES = {"good": (GOOD, "\u2713"), "doubtful": (DOUBTFUL, "?"), "bad": (BAD, "\u2717"), "none": (INK, "")}
_WASH = {"good": "#eaf6ec", "doubtful": "#fdf4dd", "bad": "#fdeceb", "none": "#f6f7f8"}
_PAD_MM, _AFTER_NUMBER_MM = 1.0, 3.0  # beside the text of a cell; before a text that follows a number
_LONGEST_WORD_MM = 40.0  # longer ones are divided where columns are narrow
_ENTRY_MM = 48.0  # the first column of a table without heads: what the entry is
_FIGURE_SPACE, _POINT_SPACE = "\u2007", "\u2008"  # as wide as a digit, as wide as a point


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
        If fpdf2 is not installed.
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
        If fpdf2 is not installed.
    """
    _fpdf()


def pdf_bytes(page: Page, paper: Paper) -> bytes:
    """The content of the file, see `write_pdf`."""
    sheets = _Sheets(paper)
    try:
        sheets.first(page)
        for section in page.sections:
            sheets.section(section)
        if page.facts:
            # Names of files are not the author's to change: characters that the font lacks are escaped.
            facts = tuple(tuple(map(sheets.escaped, fact)) for fact in page.facts)
            sheets.heading("Files and programs", kept_mm=min(WHOLE_MM, 12.0 + 5.0 * len(facts)))
            sheets.table(Table((Column(""), Column("")), facts, ""), size=SMALL)
        sheets.waiting_figures()
        sheets.signatures()
        sheets.stamp()
        return sheets.output(page)
    finally:
        sheets.close()


def _fpdf() -> Any:
    return extra_module("fpdf", "writing PDF files needs the package fpdf2", "pip install 'truearm[pdf]'")


class _Sheets:
    """The sheets of a document while they are filled."""

    def __init__(self, paper: Paper) -> None:
        import matplotlib

        fpdf = _fpdf()
        self.paper, self._face = paper, fpdf.fonts.FontFace
        self.pdf = fpdf.FPDF(enforce_compliance="PDF/A-3B")
        fonts = Path(matplotlib.get_data_path(), "fonts", "ttf")
        self.pdf.add_font(_FONT, "", fonts / "DejaVuSans.ttf")
        self.pdf.add_font(_FONT, "B", fonts / "DejaVuSans-Bold.ttf")
        self._glyphs = set.intersection(*(set(font.cmap) for font in self.pdf.fonts.values()))
        self._waiting: list[Figure] = []
        self.pdf.set_margins(MARGIN_MM, TOP_MM, MARGIN_MM)
        self.pdf.set_auto_page_break(True, margin=BOTTOM_MM)
        self.pdf.set_line_width(0.2)
        self.pdf.add_page()

    # Text ------------------------------------------------------------------------------------------------------------

    def text(
        self,
        text: str,
        size: float = TEXT,
        *,
        bold: bool = False,
        colour: str = INK,
        gap_mm: float = 1.6,
        width_mm: float = WIDTH_MM,
    ) -> None:
        """A paragraph over the whole width."""
        self._style(size, bold=bold, colour=colour)
        self.pdf.multi_cell(width_mm, self._line(size), self.known(text), align="L", new_x="LMARGIN", new_y="NEXT")
        self.pdf.set_y(self.pdf.get_y() + gap_mm)

    def known(self, text: str) -> str:
        """The text, if the font has all its characters: a missing glyph would be lost, and PDF/A forbids it."""
        text = printable(text).replace("\u202f", "\u00a0").replace("\n", " ").replace("\u00ad", "")
        if missing := list(dict.fromkeys(sign for sign in text if not self._has(sign))):
            raise InputError(
                f"the font of the PDF has no glyph for {' '.join(missing[:5])} in {text!r:.80}",
                hint="write the text in Latin, Greek or Cyrillic letters",
            )
        return text

    def escaped(self, text: str) -> str:
        """The text with escapes, as Python writes them, in place of characters that the font lacks."""
        return "".join(
            sign if sign == "\u202f" or self._has(sign) else sign.encode("unicode_escape").decode() for sign in text
        )

    def _has(self, sign: str) -> bool:
        """Whether the font has a character, plain and bold; the writer would drop a soft hyphen."""
        return ord(sign) in self._glyphs and sign != "\u00ad"

    def heading(self, title: str, *, kept_mm: float = KEPT_MM) -> None:
        """A heading, on the next sheet if less room than `kept_mm` is left on this one."""
        self.keep(kept_mm)
        self.pdf.set_y(self.pdf.get_y() + 3.0)
        self.text(title, HEADING, bold=True, gap_mm=1.2)

    def keep(self, height_mm: float) -> None:
        """Start the next sheet unless this one has room for a height."""
        if self.pdf.will_page_break(height_mm):
            self.pdf.add_page()
            self.waiting_figures()

    # Parts -----------------------------------------------------------------------------------------------------------

    def first(self, page: Page) -> None:
        """Letterhead, title, verdict and key numbers of the first sheet."""
        self._letterhead()
        self.text(page.title, TITLE if len(page.title) <= LONG_TITLE else HEADING, bold=True, gap_mm=1.0)
        if page.subtitle:
            self.text(page.subtitle, TEXT, colour=SOFT, gap_mm=2.5)
        if page.verdict is not None:
            self._verdict(page.verdict)
        if page.summary:
            self._summary(page.summary)

    def section(self, section: Section) -> None:
        """A section: verdict, text, rows, tables, figures."""
        if self._waiting and self.pdf.get_y() < TOP_MM + HEIGHT_MM / 2:  # a table has begun a sheet
            self.waiting_figures()
        self.heading(section.title, kept_mm=self._beginning_of(section))
        if section.verdict is not None:
            self._verdict(section.verdict)
        for paragraph in paragraphs(section.text):
            self.text(paragraph)
        if section.rows:
            self.table(table_of_rows(section.rows))
        for table in section.tables:
            self.table(table)
        for figure in section.figures:
            self._figure(figure)

    def _beginning_of(self, section: Section) -> float:
        """Height that a section's heading needs below it [mm]: its text and a table that is not divided, if short."""
        tables = [*([table_of_rows(section.rows)] if section.rows else []), *section.tables]
        if section.figures and not (section.text or tables or section.verdict):
            return 14.0 + SMALLEST_SHARE * _height(pixels_of(section.figures[0], dpi=20))
        if section.verdict is not None or not tables:
            return KEPT_MM
        self._style(TEXT)
        texts = [self._lines(self.known(one), WIDTH_MM) for one in paragraphs(section.text)]
        height = 10.0 + sum(texts) * self._line(TEXT) + 1.6 * len(texts) + self._layout(tables[0], 8.0).kept_mm
        return height if height <= WHOLE_MM else KEPT_MM

    def table(self, grid: Table, *, size: float = 8.0) -> None:
        """A table that continues on the next sheet, with its heads again, unless it is short."""
        layout = self._layout(grid, size)
        self.keep(layout.kept_mm)
        if grid.caption:
            self.text(grid.caption, SMALL, colour=SOFT, gap_mm=0.8)
        self._style(size)
        with self.pdf.table(
            borders_layout="HORIZONTAL_LINES",
            col_widths=layout.widths,
            text_align=["RIGHT" if numeric else "LEFT" for numeric in grid.numeric],
            v_align="TOP",
            align="LEFT",
            width=min(sum(layout.widths), WIDTH_MM),
            line_height=self._line(size),
            first_row_as_headings=bool(layout.heads),
            num_heading_rows=int(bool(layout.heads)),
            headings_style=self._face(emphasis="BOLD"),
        ) as table:
            if layout.heads:
                layout.fill(table.row(), layout.heads)
            for cells, state in layout.rows:
                colour = channels(_STATES[state][0] if state in ("bad", "doubtful") else INK)
                layout.fill(table.row(style=self._face(color=colour)), cells)
        self.pdf.set_y(self.pdf.get_y() + 2.5)

    def _layout(self, grid: Table, size: float) -> _TableLayout:
        """Measure a table; rows higher than a sheet are divided into several."""
        rows = [[self._cell(grid, row, at) for at in range(len(grid.columns))] for row in grid.cells]
        heads = [self.known(f"{head.heading} [{head.unit}]" if head.unit else head.heading) for head in grid.columns]
        if not any(heads) and len(heads) == 2:
            heads = []
        states: Sequence[State] = grid.states or ["none"] * len(rows)
        for row, state in zip(rows, states, strict=True):
            row[0] = f"{_STATES[state][1]} {row[0]}".strip()
        numeric = grid.numeric
        left = tuple(
            _AFTER_NUMBER_MM if at and numeric[at - 1] and not numeric[at] else _PAD_MM for at in range(len(numeric))
        )
        self._style(size, bold=True)  # a little wider than the plain font, in which the rows are written
        widths = self._widths([*([heads] if heads else []), *rows], numeric, left) if heads else (
            _ENTRY_MM, WIDTH_MM - _ENTRY_MM
        )  # fmt: skip
        line = self._line(size)
        most = int((HEIGHT_MM - WHOLE_MM / 2) / line)  # below heads of some lines
        divided: list[tuple[list[str], State]] = []
        height = 0.0
        if heads:
            height = line * max(self._lines(text, w, p) for text, w, p in zip(heads, widths, left, strict=True))
        self._style(size)
        for row, state in zip(rows, states, strict=True):
            lines = [self._wrapped(text, w, p) for text, w, p in zip(row, widths, left, strict=True)]
            tallest = max(map(len, lines))
            height += min(tallest, most) * line + 1.0
            for begin in range(0, tallest, most) if tallest > most else ():
                divided.append((["\n".join(one[begin : begin + most]) for one in lines], state))
            if tallest <= most:
                divided.append((row, state))
        caption = 0.0
        if grid.caption:
            self._style(SMALL)
            caption = self._lines(self.known(grid.caption), WIDTH_MM) * self._line(SMALL) + 0.8
        kept = caption + height + 2.0
        return _TableLayout(tuple(heads), divided, widths, left, kept if kept <= WHOLE_MM else KEPT_MM + caption)

    def signatures(self) -> None:
        """Place, date and a line for each person who signs."""
        if not self.paper.signatures:
            return
        half = WIDTH_MM / 2
        self._style(SMALL)
        people = [self._wrapped(self.known(person), half - 12.0) for person in self.paper.signatures]
        pairs = [people[at : at + 2] for at in range(0, len(people), 2)]
        heights = [max(26.0, 20.0 + max(map(len, pair)) * self._line(SMALL)) for pair in pairs]
        self.heading("Signature" if len(people) == 1 else "Signatures", kept_mm=16.0 + heights[0])
        self.text(f"{self.paper.date.isoformat()}", gap_mm=0.0)
        for pair, height in zip(pairs, heights, strict=True):
            self.keep(height)
            top = self.pdf.get_y()
            for at, lines in enumerate(pair):
                left, y = MARGIN_MM + half * at, top + 16.0
                self.pdf.set_draw_color(*channels(INK))
                self.pdf.line(left, y, left + half - 12.0, y)
                self._style(SMALL, colour=SOFT)
                self.pdf.set_xy(left, y + 1.0)
                self.pdf.multi_cell(half - 12.0, self._line(SMALL), "\n".join(lines), align="L")
            self.pdf.set_xy(MARGIN_MM, top + height)

    # Every sheet -----------------------------------------------------------------------------------------------------

    def stamp(self) -> None:
        """Head, foot and mark of every sheet, now that their number is known."""
        pdf, pages = self.pdf, self.pdf.pages_count
        pdf.set_auto_page_break(False)
        for number in range(1, pages + 1):
            pdf.page = number
            # The sheet was left with another font than the one that fpdf2 holds as set.
            pdf.current_font_is_set_on_page = False
            self._style(SMALL, colour=SOFT)
            count = f"page {number} of {pages}"
            heading = self._shortened(self.known(self.paper.heading), WIDTH_MM - pdf.get_string_width(count) - 8.0)
            for y in (10.0, 297.0 - 13.0):
                pdf.set_xy(MARGIN_MM, y)
                pdf.cell(WIDTH_MM, 4.0, heading, align="L")
            pdf.set_xy(MARGIN_MM, 297.0 - 13.0)
            pdf.cell(WIDTH_MM, 4.0, count, align="R")
            if self.paper.mark:
                self._mark()

    def output(self, page: Page) -> bytes:
        """Metadata and attached files; then the bytes."""
        pdf, paper = self.pdf, self.paper
        issued = datetime.datetime.combine(paper.date, datetime.time(), datetime.UTC)
        subject = f"{paper.heading}. {paper.mark}".strip()
        pdf.set_title(printable(page.title))
        pdf.set_author(printable(paper.issuer[0]))
        pdf.set_subject(subject)
        pdf.set_lang("en")
        pdf.set_creation_date(issued)
        pdf.set_xmp_metadata(_metadata(page.title, paper.issuer[0], subject, issued))
        for one in paper.attachments:
            pdf.embed_file(
                bytes=one.content,
                basename=one.name,
                mime_type=one.mime_type,
                desc=one.description,
                associated_file_relationship=one.relationship,
                modification_date=issued,
                compress=True,
            )
        return bytes(pdf.output())

    def close(self) -> None:
        """Close the files of the fonts; fpdf2 itself does so only for a whole document."""
        for font in self.pdf.fonts.values():
            font.close()

    # Helpers ---------------------------------------------------------------------------------------------------------

    def _letterhead(self) -> None:
        top = self.pdf.get_y()
        width = WIDTH_MM - (54.0 if self.paper.logo is not None else 0.0)
        self.text(self.paper.issuer[0], TEXT + 1, bold=True, gap_mm=0.3, width_mm=width)
        for line in self.paper.issuer[1:]:
            self.text(line, SMALL, colour=SOFT, gap_mm=0.0, width_mm=width)
        bottom = self.pdf.get_y()
        if self.paper.logo is not None:
            bottom = max(bottom, self._logo(top))
        self.pdf.set_draw_color(*channels(INK))
        self.pdf.line(MARGIN_MM, bottom + 2.0, MARGIN_MM + WIDTH_MM, bottom + 2.0)
        self.pdf.set_y(bottom + 6.0)

    def _logo(self, top: float) -> float:
        """Draw the logo at the right, at most 50 mm x 18 mm; return its lower end [mm]."""
        assert self.paper.logo is not None
        try:
            self.pdf.image(
                io.BytesIO(self.paper.logo.content), x=MARGIN_MM + WIDTH_MM - 50.0, y=top, w=50.0, h=18.0,
                keep_aspect_ratio=True,
            )  # fmt: skip
        except Exception as error:  # the SVG reader has many ways to fail on a strange file
            raise InputError(f"the logo cannot be drawn ({error})", hint="save it as PNG") from None
        return top + 18.0

    def _verdict(self, verdict: PageVerdict) -> None:
        """The verdict in a box, in words, with its sign."""
        colour, sign = _STATES[verdict.state]
        sentence, detail = self.known(f"{sign} {verdict.sentence}".strip()), self.known(verdict.detail)
        self._style(HEADING, bold=True, colour=colour)
        inner = WIDTH_MM - 8.0
        lines = len(self.pdf.multi_cell(inner, self._line(HEADING), sentence, dry_run=True, output="LINES"))
        height = lines * self._line(HEADING)
        if detail:
            self._style(TEXT)
            more = len(self.pdf.multi_cell(inner, self._line(TEXT), detail, dry_run=True, output="LINES"))
            height += more * self._line(TEXT) + 0.8
        self.keep(height + 8.0)
        top = self.pdf.get_y()
        self.pdf.set_fill_color(*channels(_WASH[verdict.state]))
        self.pdf.rect(MARGIN_MM, top, WIDTH_MM, height + 6.0, style="F")
        self.pdf.set_fill_color(*channels(colour))
        self.pdf.rect(MARGIN_MM, top, 1.4, height + 6.0, style="F")
        self._style(HEADING, bold=True, colour=colour)
        self.pdf.set_xy(MARGIN_MM + 4.5, top + 3.0)
        self.pdf.multi_cell(inner, self._line(HEADING), sentence, align="L", new_x="LEFT", new_y="NEXT")
        if detail:
            self._style(TEXT)
            self.pdf.set_xy(MARGIN_MM + 4.5, self.pdf.get_y() + 0.8)
            self.pdf.multi_cell(inner, self._line(TEXT), detail, align="L", new_x="LEFT", new_y="NEXT")
        self.pdf.set_xy(MARGIN_MM, top + height + 9.0)

    def _summary(self, values: tuple[LabelledValue, ...]) -> None:
        """The key numbers side by side, each above its label."""
        width, top, bottom = WIDTH_MM / len(values), self.pdf.get_y(), 0.0
        for at, one in enumerate(values):
            number = format_cell(one.value, uncertainty=one.uncertainty).text
            self.pdf.set_xy(MARGIN_MM + at * width, top)
            self._style(13.0, bold=True, colour=_STATES[one.state][0])
            number = self.known(f"{number} {one.unit}".strip())
            self.pdf.multi_cell(width - 4.0, 6.0, number, align="L", new_x="LEFT", new_y="NEXT")
            self._style(SMALL, colour=SOFT)
            self.pdf.multi_cell(
                width - 4.0, self._line(SMALL), self.known(one.label), align="L", new_x="LEFT", new_y="NEXT"
            )
            bottom = max(bottom, self.pdf.get_y())
        self.pdf.set_xy(MARGIN_MM, bottom + 2.0)

    def waiting_figures(self) -> None:
        """Draw the figures for which sheets before had no room."""
        waiting, self._waiting = self._waiting, []
        for figure in waiting:
            self._figure(figure, may_wait=False)

    def _figure(self, figure: Figure, *, may_wait: bool = True) -> None:
        """Draw a figure, smaller if it fits then; else it waits for the next sheet, so that this one is filled."""
        from PIL import Image

        pixels = pixels_of(figure)
        picture = Image.fromarray(pixels[:, :, :3])
        height, width = pixels.shape[:2]
        shown = _height(pixels) * width / height
        room = (TOP_MM + HEIGHT_MM - self.pdf.get_y() - 16.0) * width / height
        if SMALLEST_SHARE * shown <= room:
            shown = min(shown, room)
        elif may_wait:
            self._waiting.append(figure)
            return
        self.keep(shown * height / width + 10.0)
        self.pdf.image(picture, w=shown, alt_text=figure.alt)
        self.pdf.set_y(self.pdf.get_y() + 1.0)
        self.text(figure.caption, SMALL, colour=SOFT, gap_mm=3.0)

    def _mark(self) -> None:
        """The mark across the sheet, light enough to read through."""
        pdf = self.pdf
        with pdf.local_context(fill_opacity=0.16):
            self._style(40.0, bold=True, colour=BAD)
            text = self.known(self.paper.mark)
            pdf.set_font_size(40.0 * 235.0 / pdf.get_string_width(text))
            with pdf.rotation(54.7, 105.0, 148.5):
                pdf.text(105.0 - pdf.get_string_width(text) / 2, 152.0, text)

    def _cell(self, grid: Table, row: tuple[Any, ...], at: int) -> str:
        """A cell as text; spaces as wide as digits bring decimal points below each other."""
        cell = row[at]
        text = self.known(cell.text)
        if not cell.is_number:
            return text
        room = grid.decimal_widths[at]
        if not cell.fraction:
            return text + (_POINT_SPACE + _FIGURE_SPACE * (room - 1) if room else "")
        return text + _FIGURE_SPACE * (room - len(cell.fraction))

    def _widths(self, rows: list[list[str]], numeric: Sequence[bool], left: Sequence[float]) -> tuple[float, ...]:
        """Widths of columns: the widest cell of each, or the longest word and a share of what is left [mm]."""
        columns = list(zip(*rows, strict=True))
        padding = [one + _PAD_MM + 1.0 for one in left]
        needed = [max(map(self.pdf.get_string_width, cells)) + p for cells, p in zip(columns, padding, strict=True)]
        if sum(needed) > WIDTH_MM:
            least = [
                width if is_number else min(width, self._longest_word(cells) + p)
                for width, is_number, cells, p in zip(needed, numeric, columns, padding, strict=True)
            ]
            if sum(least) >= WIDTH_MM:
                needed = [width * WIDTH_MM / sum(least) for width in least]
            else:
                # By the root: of two long texts, the one four times as long gets twice the room, and stands on more
                # lines.
                more = [sqrt(many - few) for few, many in zip(least, needed, strict=True)]
                needed = [
                    few + (WIDTH_MM - sum(least)) * part / sum(more) for few, part in zip(least, more, strict=True)
                ]
        stretched = min(WIDTH_MM / sum(needed), 1.3)
        return tuple(width * stretched for width in needed)

    def _longest_word(self, cells: Sequence[str]) -> float:
        """Width of the longest word of some cells, at most `_LONGEST_WORD_MM`."""
        words = (word for cell in cells for word in cell.split(" "))
        return float(min(max(map(self.pdf.get_string_width, words), default=0.0), _LONGEST_WORD_MM))

    def _wrapped(self, text: str, width_mm: float, left_mm: float = _PAD_MM) -> list[str]:
        """The lines of a text between the padding of a cell, in the font that is set."""
        if self.pdf.get_string_width(text) < width_mm - left_mm - _PAD_MM:
            return [text]
        padding = (0.0, _PAD_MM, 0.0, left_mm)
        lines = self.pdf.multi_cell(width_mm, 4.0, text, align="L", dry_run=True, output="LINES", padding=padding)
        return list(lines) or [""]

    def _lines(self, text: str, width_mm: float, left_mm: float = _PAD_MM) -> int:
        return len(self._wrapped(text, width_mm, left_mm))

    def _shortened(self, text: str, width_mm: float) -> str:
        """The text, its end replaced by an ellipsis where it is wider, in the font that is set."""
        if self.pdf.get_string_width(text) <= width_mm:
            return text
        while text and self.pdf.get_string_width(f"{text}\u2026") > width_mm:
            text = text[:-1]
        return f"{text}\u2026"

    def _style(self, size: float, *, bold: bool = False, colour: str = INK) -> None:
        self.pdf.set_font(_FONT, "B" if bold else "", size)
        self.pdf.set_text_color(*channels(colour))
        self.pdf.set_draw_color(*channels(FAINT))
        self.pdf.set_fill_color(*channels(PAPER))

    @staticmethod
    def _line(size: float) -> float:
        """Height of a line [mm] of a font size [pt]."""
        return size * 25.4 / 72 * 1.3


@dataclass(frozen=True)
class _TableLayout:
    """A measured table: texts, widths of columns and paddings left of the texts [mm], and the room it begins in."""

    heads: tuple[str, ...]
    rows: list[tuple[list[str], State]]
    widths: tuple[float, ...]
    left: tuple[float, ...]
    kept_mm: float

    def fill(self, row: Any, cells: Sequence[str]) -> None:
        """Write cells into a row."""
        for text, left in zip(cells, self.left, strict=True):
            row.cell(text, padding=(0.5, _PAD_MM, 0.5, left))


def _height(pixels: npt.NDArray[np.uint8]) -> float:
    """Height of a picture over the whole width, at most that of a sheet [mm]."""
    height, width = pixels.shape[:2]
    return float(min(WIDTH_MM * height / width, HEIGHT_MM - 20.0))


def _metadata(title: str, author: str, subject: str, issued: datetime.datetime) -> str:
    """The XMP metadata, as in the document's information; fpdf2's own would contain the time of writing."""
    title, author, subject = (escape(printable(text)) for text in (title, author, subject))
    date = issued.isoformat(timespec="seconds")
    return f"""<x:xmpmeta xmlns:x="adobe:ns:meta/">
  <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:dc="http://purl.org/dc/elements/1.1/"
    xmlns:xmp="http://ns.adobe.com/xap/1.0/" xmlns:pdfaid="http://www.aiim.org/pdfa/ns/id/">
    <rdf:Description rdf:about="" xmp:CreateDate="{date}" xmp:ModifyDate="{date}" xmp:MetadataDate="{date}">
      <pdfaid:part>3</pdfaid:part>
      <pdfaid:conformance>B</pdfaid:conformance>
      <dc:title><rdf:Alt><rdf:li xml:lang="x-default">{title}</rdf:li></rdf:Alt></dc:title>
      <dc:creator><rdf:Seq><rdf:li>{author}</rdf:li></rdf:Seq></dc:creator>
      <dc:description><rdf:Alt><rdf:li xml:lang="x-default">{subject}</rdf:li></rdf:Alt></dc:description>
    </rdf:Description>
  </rdf:RDF>
</x:xmpmeta>"""
