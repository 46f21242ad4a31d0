"""Pages as PDF/A-3: valid, the same on every sheet, whole or not at all; and logos that do no harm."""

import datetime
import io
import re
import zlib

import numpy as np
import pytest
from matplotlib.figure import Figure as Drawing
from PIL import Image

from refusals import refuses
from truearm.errors import InputError, MissingTool
from truearm.number_format import RoundedNumber
from truearm.pages import pdf
from truearm.pages.page import Column, LabelledValue, Page, PageVerdict, Section, Table
from truearm.pages.pdf import Attachment, Paper, pdf_bytes, read_logo, write_pdf
from truearm.pages.plotting import Figure

pytest.importorskip("typst", reason="pip install truearm[pdf] writes PDF files")
pypdf = pytest.importorskip("pypdf", reason="pip install truearm[pdf] reads PDF files")
pikepdf = pytest.importorskip("pikepdf", reason="pip install pikepdf[pdfa] checks PDF files")

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 4"><circle cx="2" cy="2" r="2" fill="#12407a"/></svg>'
XML = b"<certificate>" + b"0" * 500 + b"</certificate>"


def made_up_page():
    drawing = Drawing(figsize=(4, 2))
    drawing.add_subplot().plot([0, 1], [0, 1])
    rows = tuple((f"row {i}", RoundedNumber(i / 7, 0.01), i) for i in range(90))
    table = Table(
        (Column("name"), Column("value", "mm"), Column("n")), rows, "Many rows.", states=("bad", *["none"] * 89)
    )
    return Page(
        "Document 7 \u2212 \u00b5m \u2264 \u03b1",
        "About something.",
        (LabelledValue("count", 3),),
        (
            Section("Values", "One.\n\nTwo.", figures=(Figure((drawing,), "A line.", "a line"),), tables=(table,)),
            Section("Folded", "It is open on paper.", folded=True),
        ),
        (("file", "SHA-256 0"),),
        PageVerdict("Not good enough.", "bad", "Measure again."),
    )


def made_up_paper(**changes):
    attachment = Attachment("data.xml", XML, "application/xml", "the data")
    given = {"heading": "Document 7", "issuer": ("Somebody", "Somewhere"), "date": datetime.date(2026, 11, 5)}
    return Paper(**given | {"mark": "a draft", "signatures": ("A", "B", "C"), "attachments": (attachment,)} | changes)


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pdf")
    (folder / "logo.svg").write_text(SVG)
    write_pdf(made_up_page(), made_up_paper(logo=read_logo(folder / "logo.svg")), folder / "page.pdf")
    return folder / "page.pdf"


def findings_of_a_judge(path):
    """What pikepdf's judge finds, but for what it does not know.

    It judges neither attached files nor CIDSets, expects level B of a document of level A, an array in place of a
    reference to one, and does not know the XMP namespaces that ISO 19005-3, 6.6.2.3, permits: those of XMP itself
    (the number of pages), and the description of others.
    """
    pdfa = pytest.importorskip("pikepdf.pdfa", reason="pip install pikepdf[pdfa] checks PDF files")
    unknown = re.compile(
        r"xmpTPg|pdfa(Extension|Schema|Property)\b|conformance is 'A', expected 'B'|^'\d+ 0 R' is not valid"
    )
    found = pdfa.validate_written(path, "3b").findings
    return [one for one in found if one.kind != "unsupported" and not unknown.search(one.message)]


def test_a_judge_of_pdf_a_finds_nothing_but_what_it_does_not_know(document):
    assert findings_of_a_judge(document) == []


def test_the_attached_file_is_the_source_of_the_document(document):
    with pikepdf.open(document) as pdf:
        (related,) = pdf.Root.AF
        assert related.AFRelationship == "/Source"
        assert (str(related.F), str(related.UF), str(related.Desc)) == ("data.xml", "data.xml", "the data")
        stream = related.EF.F
        assert (stream.Subtype, stream.read_bytes()) == ("/application/xml", XML)
        assert "/ModDate" in stream.Params
        assert pdf.Root.Names.EmbeddedFiles.Names[1].objgen == related.objgen


def test_it_states_what_it_is_and_brings_its_fonts_and_colours(document):
    with pikepdf.open(document) as pdf:
        meta = pdf.open_metadata()
        assert (meta["pdfaid:part"], meta["pdfaid:conformance"]) == ("3", "A")
        assert (meta["dc:title"], meta["dc:creator"]) == (made_up_page().title, ["Somebody"])
        (intent,) = pdf.Root.OutputIntents
        assert intent.S == "/GTS_PDFA1"
        assert intent.DestOutputProfile.N == 3
        assert not pdf.is_encrypted
        assert "/AA" not in pdf.Root
        assert "/OpenAction" not in pdf.Root
        assert pdf.Root.MarkInfo.Marked
        fonts = [
            one for one in pdf.objects if isinstance(one, pikepdf.Dictionary) and one.get("/Type") == "/FontDescriptor"
        ]
        assert len(fonts) == 2
        assert all("/FontFile2" in font for font in fonts)
        assert not any(isinstance(one, pikepdf.Dictionary) and "/JS" in one for one in pdf.objects)
        a4 = [round(side * 25.4 / 72) for side in (595.28, 841.89)]
        assert {tuple(round(float(side) * 25.4 / 72) for side in page.mediabox[2:]) for page in pdf.pages} == {
            tuple(a4)
        }


def sheets_of(content):
    """The text of each sheet."""
    return [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(content)).pages]


def test_every_sheet_has_the_number_the_count_and_the_mark(document):
    sheets = sheets_of(document.read_bytes())
    assert len(sheets) > 2
    for number, sheet in enumerate(sheets, start=1):
        assert f"page {number} of {len(sheets)}" in sheet
        assert sheet.count("Document 7") >= 2
        assert "a draft" in sheet
    assert "Not good enough." in sheets[0]
    assert sum("value [mm]" in sheet for sheet in sheets) > 1  # heads are repeated
    text = "".join(sheets)
    assert {f"row {i}" for i in range(90)} <= set(re.findall(r"row \d+", text))
    assert "It is open on paper." in text


def test_a_heading_stays_with_its_figure(tmp_path):
    drawing = Drawing(figsize=(4, 5.6))
    filled = Section("Filled", "\n\n".join(["A line of text."] * 26))
    tall = Section("Drawn", figures=(Figure((drawing,), "Tall.", "tall"),))
    sections = (filled, Section("A heading alone"), tall)
    page = Page("A title", "", (), sections, (), PageVerdict("A verdict.", "bad", ""))
    sheets = sheets_of(pdf_bytes(page, made_up_paper(signatures=())))
    assert ["A heading alone" in sheet for sheet in sheets] == [True, False]
    assert ["Drawn" in sheet for sheet in sheets] == [False, True]
    for number, sheet in enumerate(sheets, start=1):
        assert f"page {number} of 2" in sheet
        assert sheet.count("Document 7") >= 2


def test_the_same_page_gives_the_same_bytes():
    page = Page("title", sections=(Section("a", "b"),))
    assert pdf_bytes(page, made_up_paper(attachments=())) == pdf_bytes(page, made_up_paper(attachments=()))


def test_a_character_without_a_glyph_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(InputError, match="the font of the PDF has no glyph for \u682a \u5f0f in '\u682a\u5f0f'"):
        write_pdf(Page("title", sections=(Section("\u682a\u5f0f"),)), made_up_paper(), tmp_path / "page.pdf")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="no glyph for \uf400"):  # the font has it, and PDF/A forbids it
        pdf_bytes(Page("title", sections=(Section("\uf400"),)), made_up_paper())


def test_names_of_files_with_other_characters_are_escaped(tmp_path):
    facts = (
        ("\u6d4b.csv", "SHA-256 1"),
        ("\uf400.csv", "SHA-256 4"),
        ("a\nb\u00ad.csv", "SHA-256 2"),
        ("bad\udcff.csv", "SHA-256 3"),
    )
    text = "".join(sheets_of(pdf_bytes(Page("Title", facts=facts), made_up_paper())))
    for name in ("\\u6d4b.csv", "\\uf400.csv", "a\\nb\\xad.csv", "bad\\udcff.csv"):
        assert name in text


def test_long_texts_neither_overlap_nor_are_refused(tmp_path):
    number = "Document " + "0123456789" * 20
    people = tuple(f"{letter}, " + "head of everything " * 40 for letter in "ABC")
    rows = (("x" * 150, RoundedNumber(1.0, 0.1), "very long words " * 400, "short"), ("last", None, "", "end"))
    columns = (Column("name"), Column("value", "mm"), Column("text"), Column("text"))
    page = Page(number, sections=(Section("Values", tables=(Table(columns, rows, ""),)),))
    paper = made_up_paper(heading=number, signatures=people, issuer=("Somebody " * 60, "Somewhere"), mark="")
    sheets = sheets_of(pdf_bytes(page, paper))
    assert sum(len(re.findall(r"\bvery\b", sheet)) for sheet in sheets) == 400  # a row higher than a sheet continues
    for at, sheet in enumerate(sheets, start=1):
        first, last = sheet.strip().splitlines()[0], sheet.strip().splitlines()[-1]
        assert first.startswith("Document 0123")
        assert first.endswith("\u2026")
        assert re.fullmatch(rf"Document [0-9]+\u2026 +page {at} of {len(sheets)}", last.strip())
    end = next(sheet for sheet in sheets if "Signatures" in sheet)
    assert end.count("everything") == 120
    # The lower line of signatures is below the names of the upper one.
    assert end.index("C, head") > [found.end() for found in re.finditer("everything", end)][79]


def test_a_figure_without_room_waits_and_the_sheet_is_filled(tmp_path):
    drawing = Drawing(figsize=(6, 5))
    drawing.add_subplot().plot([0, 1], [0, 1])
    lines = Table((Column("n"), Column("square")), tuple((str(i), str(i * i)) for i in range(36)), "")
    page = Page(
        "Title",
        sections=(
            Section("First", tables=(lines,), figures=(Figure((drawing,), "A figure.", "a line"),)),
            *(Section(f"Section {i}", "Text of a few words.") for i in range(8)),
        ),
    )
    one, two, *_ = sheets_of(pdf_bytes(page, made_up_paper(mark="")))
    assert "Section 1" in one
    assert "A figure." not in one
    assert two.index("A figure.") < two.index("Section")


def test_without_the_package_the_message_says_how_to_get_it(tmp_path, without_extras):
    with pytest.raises(MissingTool, match=r"pip install 'truearm\[pdf\]'"):
        write_pdf(made_up_page(), made_up_paper(), tmp_path / "page.pdf")
    assert list(tmp_path.iterdir()) == []


# Logos ---------------------------------------------------------------------------------------------------------------


def png(width=20, height=10):
    out = io.BytesIO()
    Image.fromarray(np.full((height, width, 4), 200, dtype=np.uint8)).save(out, "PNG")
    return out.getvalue()


def test_a_png_with_transparency_keeps_the_file_valid(tmp_path):
    (tmp_path / "logo.png").write_bytes(png())
    logo = read_logo(tmp_path / "logo.png")
    assert logo.kind == "png"
    write_pdf(Page("title"), made_up_paper(logo=logo, attachments=()), tmp_path / "page.pdf")
    assert findings_of_a_judge(tmp_path / "page.pdf") == []


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "expected a logo, PNG or SVG"),
        (b"\xff\xd8\xff\xe0 JFIF", "expected a logo, PNG or SVG"),
        (b"<html/>", "expected a logo, PNG or SVG"),
        (png()[:60], "the PNG cannot be read"),
        (SVG.replace("<svg", "<!DOCTYPE svg [<!ENTITY a 'b'>]><svg").encode(), "DOCTYPE"),
        (SVG.replace("<circle", '<image href="http://x.example/a.png"/><circle').encode(), "contains <image>"),
        (SVG.replace("<circle", "<script>1</script><circle").encode(), "contains <script>"),
        (SVG.replace("<circle", "<text>a</text><circle").encode(), "contains <text>"),
        (SVG.replace("<circle", '<circle onload="a()"').encode(), "refers to another file or a script"),
        (
            SVG.replace('fill="#12407a"', 'fill="url(http://x.example/a)"').encode(),
            "refers to another file or a script",
        ),
        (SVG.replace('fill="#12407a"', 'href="file:///etc/hosts"').encode(), "refers to another file or a script"),
    ],
)
def test_other_logos_are_refused(tmp_path, content, said):
    (tmp_path / "logo").write_bytes(content)
    assert refuses(said, read_logo, tmp_path / "logo").file == tmp_path / "logo"


def test_large_logos_are_refused_before_they_are_unpacked(tmp_path, monkeypatch):
    (tmp_path / "logo.png").write_bytes(png())
    monkeypatch.setattr(pdf, "MAX_LOGO_PIXELS", 19)
    refuses("20 x 10 pixels, more than 19", read_logo, tmp_path / "logo.png")
    monkeypatch.setattr(pdf, "MAX_LOGO_BYTES", 10)
    refuses("larger than", read_logo, tmp_path / "logo.png")


def test_a_logo_that_states_too_many_pixels_is_refused_unopened(tmp_path):
    chunk = b"IHDR" + (60000).to_bytes(4, "big") * 2 + bytes([8, 2, 0, 0, 0])
    png = b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    (tmp_path / "logo.png").write_bytes(png)
    refuses("60000 x 60000 pixels", read_logo, tmp_path / "logo.png")
    (tmp_path / "logo.png").write_bytes(png[:12])
    refuses("PNG cannot be read", read_logo, tmp_path / "logo.png")
