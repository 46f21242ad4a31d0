"""Edits of an XML file in place: what is not edited stays as it is, byte for byte.

Parsers forget how a file was laid out. Here elements know their bytes (`truearm.files.xml_reader.Element`), and edits
replace ranges of them.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple
from xml.parsers import expat

# Spaces before a comment that are removed with it.
MAX_INDENT = 200
# A start tag: attribute values may hold ">".
_START_TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""")
_ATTRIBUTE = re.compile(rb"""(?P<name>[^\s="'<>/]+)\s*=\s*("[^"]*"|'[^']*')""")


class Edit(NamedTuple):
    """Bytes `start` to `stop` of a file, and what replaces them."""

    start: int
    stop: int
    replacement: bytes


def start_tag(content: bytes, start: int) -> bytes:
    """The start tag at a byte of well-formed XML, with its brackets."""
    found = _START_TAG.match(content, start)
    assert found is not None  # the parser found a tag here
    return found.group()


def set_attributes(content: bytes, start: int, attributes: Mapping[str, str]) -> Edit:
    """Set attributes of the element whose start tag begins at a byte; others keep their place and their form."""
    tag = start_tag(content, start)
    new = {name.encode(): assignment(name, value).encode() for name, value in attributes.items()}

    def replaced(found: re.Match[bytes]) -> bytes:
        return new.pop(found["name"], found.group())

    edited = _ATTRIBUTE.sub(replaced, tag)
    bracket = b"/>" if edited.endswith(b"/>") else b">"
    kept = edited.removesuffix(bracket).rstrip()
    added = b"".join(b" " + one for one in new.values())  # those that it did not have
    return Edit(start, start + len(tag), kept + added + edited[len(kept) :])


def assignment(name: str, value: str) -> str:
    """An attribute with its value, in characters that every encoding has."""
    return f'{name}="{html.escape(value)}"'.encode("ascii", "xmlcharrefreplace").decode()


def tag_text(tag: str, attributes: Mapping[str, str]) -> str:
    """An element without content."""
    return f"<{' '.join([tag, *(assignment(*both) for both in attributes.items())])}/>"


def comment_edits(content: bytes, is_meant: Callable[[str], bool]) -> list[Edit]:
    """Remove the comments of well-formed XML whose text is meant, with the line's start before them.

    A parser finds them: what looks like a comment in CDATA or in an attribute is none.
    """
    parser, edits = expat.ParserCreate(), []

    def found(text: str) -> None:
        if is_meant(text):
            start = parser.CurrentByteIndex
            stop = content.index(b"-->", start) + len(b"-->")
            indented = len(content[max(0, start - MAX_INDENT) : start].rstrip(b" \t")) + max(0, start - MAX_INDENT)
            for end in (b"\r\n", b"\n"):
                if content.endswith(end, 0, indented):
                    start = indented - len(end)
                    break
            edits.append(Edit(start, stop, b""))

    parser.CommentHandler = found
    parser.Parse(content, True)
    return edits


def apply_edits(content: bytes, edits: Iterable[Edit]) -> bytes:
    """The file with all edits made; their ranges do not overlap. Insertions at one place keep their order."""
    pieces, done = [], 0
    for edit in sorted(edits, key=lambda edit: (edit.start, edit.stop)):
        pieces += [content[done : edit.start], edit.replacement]
        done = edit.stop
    return b"".join([*pieces, content[done:]])
