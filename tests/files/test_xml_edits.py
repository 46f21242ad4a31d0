"""Edits in place: what is set is read back by a parser, and every other byte stays."""

import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearm.files.foreign_documents import Element, parse_xml
from truearm.wings.exports.formats.urdf import set_attributes, start_tag, tag_text
from truearm.wings.exports.targets.edits import Edit, with_edits

VALUES = st.text(st.characters(blacklist_categories=("Cs", "Cc")), max_size=12)


@given(VALUES, VALUES)
def test_a_value_that_is_set_is_read_back(old, new):
    content = f"<a>t<b {tag_text('c', {'x': old, 'y': old})[3:-2]} />u</a>".encode()
    (element,) = parse_xml(content)
    edited = with_edits(content, [set_attributes(content, element.start, {"y": new, "z": new})])
    (after,) = ET.fromstring(edited)
    assert after.attrib == {"x": old, "y": new, "z": new}
    assert edited.startswith(b"<a>t<b x=")
    assert edited.endswith(b" />u</a>")


@pytest.mark.parametrize(
    ("tag", "edited"),
    [
        ("<a x='1'/>", '<a x="2"/>'),
        ("<a\n  x = '1'\ty='>'></a>", "<a\n  x=\"2\"\ty='>'></a>"),
        ("<a/>", '<a x="2"/>'),
        ("<a ></a>", '<a x="2" ></a>'),
        ("<a y=\" x='1' \"/>", '<a y=" x=\'1\' " x="2"/>'),
        ("<a ax='1' x='1'/>", "<a ax='1' x=\"2\"/>"),
    ],
)
def test_only_the_attribute_changes(tag, edited):
    content = tag.encode()
    assert with_edits(content, [set_attributes(content, 0, {"x": "2"})]) == edited.encode()


def test_elements_know_their_bytes():
    content = "<?xml version='1.0'?><ü>\n<a b='>'/>t<c>u</c ><!-- <a/> --></ü>".encode()
    root = parse_xml(content)
    a, c = root
    assert isinstance(a, Element)
    assert isinstance(c, Element)
    assert start_tag(content, a.start) == content[a.start : a.end] == b"<a b='>'/>"
    assert start_tag(content, c.start) == b"<c>"
    assert content[c.end :].startswith(b"</c >")
    assert content[root.end :] == "</ü>".encode()


def test_insertions_keep_their_order():
    assert with_edits(b"abc", [Edit(2, 2, b"x"), Edit(0, 1, b"-"), Edit(2, 2, b"y")]) == b"-bxyc"


def test_overlapping_edits_are_refused():
    with pytest.raises(ValueError, match="overlap at 1"):
        with_edits(b"abc", [Edit(1, 3, b"x"), Edit(0, 2, b"y")])


def test_long_gaps_take_no_longer_than_their_length():
    """A quarter of a megabyte of spaces: anything quadratic would take minutes."""
    gap = b" " * 250_000
    content = b"<a" + gap + b"x" + gap + b"='1'" + gap + b"y='2'" + gap + b"/>"
    edited = with_edits(content, [set_attributes(content, 0, {"x": "2", "z": "3"})])
    assert edited.endswith(b"y='2' z=\"3\"" + gap + b"/>")


@pytest.mark.parametrize("before", [b"\n", b"\xef\xbb\xbf \r\n\n"])
def test_blanks_in_front_of_the_declaration_move_no_place(before):
    """Some programs write an empty first line, which XML does not permit; lines and bytes stay those of the file."""
    content = before + b'<?xml version="1.0" encoding="utf-8"?>\n<a><b x="1"/></a>'
    (element,) = parse_xml(content)
    assert element.line == before.count(b"\n") + 2
    assert content[element.start :].startswith(b"<b")
