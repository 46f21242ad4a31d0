"""XML of other programs: parsed without document types, with the line of every fault."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from xml.parsers import expat

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray

# Blank lines in front of the declaration, which XML does not permit there.
_BLANK_FIRST = re.compile(rb"\A(\xef\xbb\xbf)?(\s+)(<\?xml\s[^>]{,1000}\?>)")


class Element(ET.Element):
    """An element that knows its place in the file.

    Attributes
    ----------
    line : int
        Line of its start tag, from 1.
    start : int
        Byte at which its start tag begins.
    end : int
        Byte at which its end tag begins; of an element without content (``<a/>``) the byte after it.
    """

    line: int
    start: int
    end: int


def parse_xml(content: bytes) -> Element:
    """Parse XML without document types, so that no entity can expand or reach another file; blanks may precede it."""
    content = _BLANK_FIRST.sub(rb"\1\3\2", content)  # places and lines of all elements stay
    parser = expat.ParserCreate()

    def element(tag: str, attributes: dict[str, str]) -> Element:
        made = Element(tag, attributes)
        made.line, made.start = parser.CurrentLineNumber, parser.CurrentByteIndex
        return made

    def finish(tag: str) -> None:
        finished = builder.end(tag)
        assert isinstance(finished, Element)
        finished.end = parser.CurrentByteIndex

    def refuse(*_: object) -> None:
        raise InputError("truearm reads no XML with a DOCTYPE or ENTITY", line=parser.CurrentLineNumber)

    builder = ET.TreeBuilder(element_factory=element)
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = finish
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(f"not valid XML: {expat.errors.messages[error.code]}", line=error.lineno) from None
    except (LookupError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"not valid XML: {error}") from None
    root = builder.close()
    assert isinstance(root, Element)
    return root


def children(element: ET.Element, tag: str) -> list[Element]:
    """List the element's own children with a tag."""
    return [found for found in element if found.tag == tag and isinstance(found, Element)]


def child(element: Element, tag: str) -> Element | None:
    """Return the element's only child with a tag, or None; refuse a second one."""
    found = children(element, tag)
    if len(found) > 1:
        raise InputError(f"expected one <{tag}>, got {len(found)}", line=found[1].line)
    return found[0] if found else None


def attribute(element: Element, name: str) -> str:
    """Return an attribute that must be present and not empty."""
    value = element.get(name, "")
    if not value:
        raise InputError(f"<{element.tag}> has no {name!r}", line=element.line)
    return value


def float_attribute(element: Element, name: str, what: str, count: int) -> FloatArray:
    """Return `count` finite numbers of an attribute; `what` names the object in a message."""
    text = attribute(element, name)
    try:
        array = np.array([float(word) for word in text.split()])
    except ValueError:
        array = np.empty(0)
    if array.shape != (count,) or not np.isfinite(array).all():
        expected = f"{count} finite numbers" if count > 1 else "a finite number"
        raise InputError(f"{what}: expected {expected} in {name}, got {text[:80]!r}", line=element.line)
    return array
