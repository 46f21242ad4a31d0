"""XML files in PDF files: the one that is attached, or a refusal in words."""

import io

import pytest

from refusals import refuses
from truearm.errors import MissingTool
from truearm.wings.laboratory.signatures.pdf_attachments import attached_xml, is_pdf

pypdf = pytest.importorskip("pypdf", reason="pip install truearm[pdf] reads PDF files")


def pdf(*attachments, password=None):
    """A sheet with files attached."""
    writer = pypdf.PdfWriter()
    writer.add_blank_page(100, 100)
    for name, content in attachments:
        writer.add_attachment(name, content)
    if password is not None:
        writer.encrypt(password, algorithm="RC4-128")
    file = io.BytesIO()
    writer.write(file)
    return file.getvalue()


def test_the_one_xml_file_is_returned():
    content = pdf(("readme.txt", b"no"), ("Certificate.XML", b"<a/>"))
    assert is_pdf(content)
    assert not is_pdf(b"<a/>")
    assert attached_xml(content, limit_bytes=10) == b"<a/>"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (pdf(), "expected one XML file attached to the PDF file, got 0; nothing is attached"),
        (pdf(("a.csv", b"1")), "got 0; attached are 'a.csv'"),
        (pdf(("a.xml", b"1"), ("b\x1b[2J.xml", b"2")), r"got 2; attached are 'a\.xml', 'b\\x1b\[2J\.xml'"),
        (pdf(("a.xml", b"<a/>" * 10)), "the attached XML file is larger than 1e-05 MB"),
        (pdf(("a.xml", b"<a/>"), password="secret"), "the PDF file cannot be read"),
        (b"%PDF-1.7\n", "the PDF file cannot be read"),
        (pdf(("a.xml", b"<a/>"))[:300], "the PDF file cannot be read"),
    ],
)
def test_other_files_are_refused(content, said, capfd):
    refuses(said, attached_xml, content, limit_bytes=10)
    assert capfd.readouterr() == ("", "")


def test_a_file_that_grows_without_end_is_refused():
    """100 MB of zeros in 100 kB: pypdf stops before."""
    packed = pdf(("a.xml", bytes(100_000_000)))
    assert b"FlateDecode" in packed or len(packed) > 10_000_000
    refuses("cannot be read|larger than", attached_xml, packed, limit_bytes=10_000_000)


def test_without_the_package_the_message_says_how_to_get_it(without_extras):
    with pytest.raises(MissingTool, match=r"pip install 'truearm\[pdf\]'"):
        attached_xml(pdf(), limit_bytes=10)
