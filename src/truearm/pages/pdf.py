"""A page as a PDF/A-3 file for A4: sheets with number and page count, tables that continue, fonts and files inside.

The document is written by fpdf2 in its PDF/A-3B mode (ISO 19005-3:2012, level B): fonts embedded, colours by an sRGB
profile, XMP metadata, attached files with their relationship, no encryption and no script. The font is DejaVu Sans,
which matplotlib brings along, so that no font of the system is needed.
"""

from __future__ import annotations

import datetime
import io
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

from truearm.errors import InputError, MissingTool
from truearm.files.atomic_write import atomic_file
from truearm.pages.html import FormattedTable, format_cell, grid_of_rows, grid_of_table, paragraphs
from truearm.pages.page import Column, LabelledValue, Page, PageVerdict, Section
from truearm.pages.palette import BAD, DOUBTFUL, FAINT, GOOD, INK, PAPER, SOFT
from truearm.pages.paper import Paper
from truearm.pages.plotting import Figure, pixels_of

MARGIN_MM, TOP_MM, BOTTOM_MM = 18.0, 24.0, 20.0
WIDTH_MM = 210.0 - 2 * MARGIN_MM
HEIGHT_MM = 297.0 - TOP_MM - BOTTOM_MM
# Room that a heading needs below it, or it moves to the next sheet.
KEPT_MM = 32.0
SMALL, TEXT, HEADING, TITLE = 7.5, 9.0, 11.5, 17.0  # pt
_FONT = "DejaVu"
_STATES = {"good": (GOOD, "\u2713"), "doubtful": (DOUBTFUL, "?"), "bad": (BAD, "\u2717"), "none": (INK, "")}
_WASH = {"good": "#eaf6ec", "doubtful": "#fdf4dd", "bad": "#fdeceb", "none": "#f6f7f8"}
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
        If the font has no glyph for a character, or the logo cannot be drawn.
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
            cells = tuple((format_cell(name), format_cell(value)) for name, value in page.facts)
            sheets.heading("Files and programs")
            sheets.table(FormattedTable((Column(""), Column("")), cells), size=SMALL)
        sheets.signatures()
        sheets.stamp()
        return sheets.output(page)
    finally:
        sheets.close()


def _fpdf() -> Any:
    try:
        return import_module("fpdf")
    except ImportError:
        raise MissingTool(
            "PDF files are written by the package fpdf2, which is not installed", hint="pip install 'truearm[pdf]'"
        ) from None


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
        self.pdf.set_margins(MARGIN_MM, TOP_MM, MARGIN_MM)
        self.pdf.set_auto_page_break(True, margin=BOTTOM_MM)
        self.pdf.set_line_width(0.2)
        self.pdf.add_page()

    # Text ------------------------------------------------------------------------------------------------------------

    def text(
        self, text: str, size: float = TEXT, *, bold: bool = False, colour: str = INK, gap_mm: float = 1.6
    ) -> None:
        """A paragraph over the whole width."""
        self._style(size, bold=bold, colour=colour)
        self.pdf.multi_cell(WIDTH_MM, self._line(size), self.known(text), align="L", new_x="LMARGIN", new_y="NEXT")
        self.pdf.set_y(self.pdf.get_y() + gap_mm)

    def known(self, text: str) -> str:
        """The text, if the font has all its characters: a missing glyph would be lost, and PDF/A forbids it."""
        glyphs = self.pdf.fonts[_FONT.lower()].cmap
        text = text.replace("\u202f", "\u00a0").replace("\n", " ")
        if missing := list(dict.fromkeys(sign for sign in text if ord(sign) not in glyphs)):
            raise InputError(
                f"the font of the PDF has no glyph for {' '.join(missing[:5])} in {text!r:.80}",
                hint="write the text in Latin, Greek or Cyrillic letters",
            )
        return text

    def heading(self, title: str, size: float = HEADING) -> None:
        """A heading, on the next sheet if little room is left on this one."""
        self.keep(KEPT_MM)
        self.pdf.set_y(self.pdf.get_y() + 3.0)
        self.text(title, size, bold=True, gap_mm=1.2)

    def keep(self, height_mm: float) -> None:
        """Start the next sheet unless this one has room for a height."""
        if self.pdf.will_page_break(height_mm):
            self.pdf.add_page()

    # Parts -----------------------------------------------------------------------------------------------------------

    def first(self, page: Page) -> None:
        """Letterhead, title, verdict and key numbers of the first sheet."""
        self._letterhead()
        self.text(page.title, TITLE, bold=True, gap_mm=1.0)
        if page.subtitle:
            self.text(page.subtitle, TEXT, colour=SOFT, gap_mm=2.5)
        if page.verdict is not None:
            self._verdict(page.verdict)
        if page.summary:
            self._summary(page.summary)

    def section(self, section: Section) -> None:
        """A section: verdict, text, rows, tables, figures."""
        self.heading(section.title)
        if section.verdict is not None:
            self._verdict(section.verdict)
        for paragraph in paragraphs(section.text):
            self.text(paragraph)
        if section.rows:
            self.table(grid_of_rows(section.rows))
        for table in section.tables:
            self.table(grid_of_table(table))
        for figure in section.figures:
            self._figure(figure)

    def table(self, grid: FormattedTable, *, size: float = 8.0) -> None:
        """A table that continues on the next sheet, with its heads again."""
        if grid.caption:
            self.keep(KEPT_MM)
            self.text(grid.caption, SMALL, colour=SOFT, gap_mm=0.8)
        rows = [[self._cell(grid, row, at) for at in range(len(grid.heads))] for row in grid.rows]
        heads = [f"{head.heading} [{head.unit}]" if head.unit else head.heading for head in grid.heads]
        with_head = any(heads) or len(heads) != 2
        states = grid.states or ("none",) * len(rows)
        for row, state in zip(rows, states, strict=True):
            row[0] = f"{_STATES[state][1]} {row[0]}".strip()
        self._style(size)
        widths = self._widths([heads, *rows]) if with_head else (_ENTRY_MM, WIDTH_MM - _ENTRY_MM)
        with self.pdf.table(
            borders_layout="HORIZONTAL_LINES",
            col_widths=widths,
            text_align=["RIGHT" if numeric else "LEFT" for numeric in grid.numeric],
            v_align="TOP",
            align="LEFT",
            width=sum(widths),
            line_height=self._line(size),
            padding=(0.5, 1.0),
            first_row_as_headings=with_head,
            num_heading_rows=int(with_head),
            headings_style=self._face(emphasis="BOLD"),
        ) as table:
            if with_head:
                table.row([self.known(head) for head in heads])
            for cells, state in zip(rows, states, strict=True):
                colour = _rgb(_STATES[state][0] if state in ("bad", "doubtful") else INK)
                table.row(cells, style=self._face(color=colour))
        self.pdf.set_y(self.pdf.get_y() + 2.5)

    def signatures(self) -> None:
        """Place, date and a line for each person who signs."""
        if not self.paper.signatures:
            return
        rows = -(-len(self.paper.signatures) // 2)
        self.keep(12.0 + 26.0 * rows)
        self.heading("Signature" if len(self.paper.signatures) == 1 else "Signatures")
        self.text(f"{self.paper.date.isoformat()}", gap_mm=0.0)
        top, half = self.pdf.get_y(), WIDTH_MM / 2
        for at, person in enumerate(self.paper.signatures):
            left, y = MARGIN_MM + half * (at % 2), top + 26.0 * (at // 2) + 16.0
            self.pdf.set_draw_color(*_rgb(INK))
            self.pdf.line(left, y, left + half - 12.0, y)
            self._style(SMALL, colour=SOFT)
            self.pdf.set_xy(left, y + 1.0)
            self.pdf.multi_cell(half - 12.0, self._line(SMALL), self.known(person), align="L")
        self.pdf.set_xy(MARGIN_MM, top + 26.0 * rows)

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
            pdf.set_xy(MARGIN_MM, 10.0)
            pdf.cell(WIDTH_MM, 4.0, self.known(self.paper.heading), align="L")
            pdf.set_xy(MARGIN_MM, 297.0 - 13.0)
            pdf.cell(WIDTH_MM, 4.0, self.known(self.paper.heading), align="L")
            pdf.set_xy(MARGIN_MM, 297.0 - 13.0)
            pdf.cell(WIDTH_MM, 4.0, f"page {number} of {pages}", align="R")
            if self.paper.mark:
                self._mark()

    def output(self, page: Page) -> bytes:
        """Metadata and attached files; then the bytes."""
        pdf, paper = self.pdf, self.paper
        issued = datetime.datetime.combine(paper.date, datetime.time(), datetime.UTC)
        subject = f"{paper.heading}. {paper.mark}".strip()
        pdf.set_title(page.title)
        pdf.set_author(paper.issuer[0])
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
        self.text(self.paper.issuer[0], TEXT + 1, bold=True, gap_mm=0.3)
        for line in self.paper.issuer[1:]:
            self.text(line, SMALL, colour=SOFT, gap_mm=0.0)
        bottom = self.pdf.get_y()
        if self.paper.logo is not None:
            bottom = max(bottom, self._logo(top))
        self.pdf.set_draw_color(*_rgb(INK))
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
        self.pdf.set_fill_color(*_rgb(_WASH[verdict.state]))
        self.pdf.rect(MARGIN_MM, top, WIDTH_MM, height + 6.0, style="F")
        self.pdf.set_fill_color(*_rgb(colour))
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

    def _figure(self, figure: Figure) -> None:
        from PIL import Image

        pixels = pixels_of(figure)
        picture = Image.fromarray(pixels[:, :, :3])
        height, width = pixels.shape[:2]
        shown = min(WIDTH_MM, (HEIGHT_MM - 20.0) * width / height)
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

    def _cell(self, grid: FormattedTable, row: tuple[Any, ...], at: int) -> str:
        """A cell as text; spaces as wide as digits bring decimal points below each other."""
        cell = row[at]
        text = self.known(cell.text)
        if not cell.is_number:
            return text
        room = grid.decimal_widths[at]
        if not cell.fraction:
            return text + (_POINT_SPACE + _FIGURE_SPACE * (room - 1) if room else "")
        return text + _FIGURE_SPACE * (room - len(cell.fraction))

    def _widths(self, rows: list[list[str]]) -> tuple[float, ...]:
        """Widths of columns: the widest cell of each, or what is left for those with long texts [mm]."""
        needed = [max(self.pdf.get_string_width(row[at]) * 1.12 + 3.0 for row in rows) for at in range(len(rows[0]))]
        fair = WIDTH_MM / len(needed)
        if sum(needed) > WIDTH_MM:
            fixed = sum(width for width in needed if width <= fair)
            long = sum(width for width in needed if width > fair)
            share = (WIDTH_MM - fixed) / long
            needed = [width if width <= fair else max(width * share, 12.0) for width in needed]
        stretched = min(WIDTH_MM / sum(needed), 1.3)
        return tuple(width * stretched for width in needed)

    def _style(self, size: float, *, bold: bool = False, colour: str = INK) -> None:
        self.pdf.set_font(_FONT, "B" if bold else "", size)
        self.pdf.set_text_color(*_rgb(colour))
        self.pdf.set_draw_color(*_rgb(FAINT))
        self.pdf.set_fill_color(*_rgb(PAPER))

    @staticmethod
    def _line(size: float) -> float:
        """Height of a line [mm] of a font size [pt]."""
        return size * 25.4 / 72 * 1.3


def _metadata(title: str, author: str, subject: str, issued: datetime.datetime) -> str:
    """The XMP metadata, as in the document's information; fpdf2's own would contain the time of writing."""
    title, author, subject = map(escape, (title, author, subject))
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


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
