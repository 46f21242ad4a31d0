"""XML and YAML of other programs: no more of the languages than is needed, with the line of every fault.

XML is parsed without document types. YAML becomes a small tree of texts with their lines, of mappings, lists and
scalars. Anchors and aliases, by which a small file may stand for a large one, and tags, by which it may ask for
objects, are refused. Nothing is resolved: YAML 1.1 takes ``1e-05`` for text, ``190:20:30`` for a number and ``no`` for
a truth value.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.parsers import expat

import numpy as np

from truearm.errors import InputError
from truearm.files.file_reading import utf8_text
from truearm.typing import FloatArray

if TYPE_CHECKING:
    import yaml

# Levels of a file that describes an arm: root, links, their numbers; more is of another kind, or an attack.
MAX_DEPTH = 10
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d{1,4})?", re.ASCII)
_SHOWN = 60
# Blank lines in front of the declaration, which XML does not permit there.
_BLANK_FIRST = re.compile(rb"\A(\xef\xbb\xbf)?(\s+)(<\?xml\s[^>]{,1000}\?>)")


@dataclass(frozen=True)
class YamlNode:
    """A node of a YAML document.

    Attributes
    ----------
    line : int
        Where it begins, counted from 1.
    text : str or None
        Of a scalar, unresolved.
    entries : dict of str to YamlNode or None
        Of a mapping, in its order.
    items : list of YamlNode or None
        Of a list.
    span : tuple of int
        Where it begins in the text, without a byte order mark, and where it ends.
    """

    line: int
    text: str | None = None
    entries: dict[str, YamlNode] | None = None
    items: list[YamlNode] | None = field(default=None)
    span: tuple[int, int] = (0, 0)

    def mapping(self, what: str, *, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, YamlNode]:
        """The entries of a mapping with all of the required keys, and no others than these and the optional ones.

        Raises
        ------
        InputError
            If it is no mapping, or its keys are others.
        """
        if self.entries is None:
            raise InputError(
                f"expected {what} as a mapping of {', '.join(required)}, got {self._shown}", line=self.line
            )
        missing = [key for key in required if key not in self.entries]
        unknown = [key for key in self.entries if key not in (*required, *optional)]
        if missing or unknown:
            faults = [
                f"{', '.join(keys[:6])} {fault}" for keys, fault in ((missing, "missing"), (unknown, "unknown")) if keys
            ]
            raise InputError(
                f"expected {what} with the keys {', '.join(required)}; {', '.join(faults)[:200]}", line=self.line
            )
        return self.entries

    def number(self, what: str) -> float:
        """The finite number of a scalar.

        Raises
        ------
        InputError
            If it is anything else.
        """
        if self.text is not None and len(self.text) <= _SHOWN and _NUMBER.fullmatch(self.text):
            value = float(self.text)
            if math.isfinite(value):
                return value
        raise InputError(f"expected {what} as a finite number, got {self._shown}", line=self.line)

    @property
    def _shown(self) -> str:
        if self.entries is not None:
            return "a mapping"
        if self.items is not None:
            return "a list"
        return repr(self.text if self.text is None or len(self.text) <= _SHOWN else f"{self.text[:_SHOWN]}...")


def parse_yaml(content: bytes) -> YamlNode:
    """Parse the content of a YAML file with one document.

    Parameters
    ----------
    content : bytes
        UTF-8; bound its size before, by `truearm.files.file_reading.read_limited`.

    Raises
    ------
    InputError
        If it is not UTF-8 or not YAML, is empty, has several documents, anchors, aliases or tags, keys that are no text
        or stated twice, or more than `MAX_DEPTH` levels.
    """
    import yaml  # where it is used: few arms are read from YAML

    text = utf8_text(content)
    try:
        _check_events(text)
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        at = None if mark is None else mark.line + 1
        raise InputError(f"the file is not YAML ({error.problem or error.context})", line=at) from None
    except yaml.YAMLError as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"the file is not YAML ({reason})") from None
    if root is None:
        raise InputError("the file is empty")
    return _converted(root)


def _check_events(text: str) -> None:
    """Refuse what needs no place in a file of numbers, before the tree is built: the depth bounds its recursion."""
    import yaml

    depth = documents = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        line = 1 if event.start_mark is None else event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise InputError("anchors and aliases are not read", line=line, hint="write every number where it belongs")
        if (tag := getattr(event, "tag", None)) is not None:
            raise InputError(f"tags are not read, got {str(tag)[:_SHOWN]!r}", line=line, hint="remove the tag")
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise InputError("expected one document, got a second one", line=line)
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise InputError(f"expected at most {MAX_DEPTH} levels", line=line)
        if isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def _converted(node: yaml.Node) -> YamlNode:
    import yaml

    line = node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        return YamlNode(line, items=[_converted(item) for item in node.value])
    if not isinstance(node, yaml.MappingNode):
        return YamlNode(line, text=str(node.value), span=(node.start_mark.index, node.end_mark.index))
    entries: dict[str, YamlNode] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise InputError("expected keys as text", line=key.start_mark.line + 1)
        if key.value in entries:
            raise InputError(f"the key {key.value[:_SHOWN]!r} is stated twice", line=key.start_mark.line + 1)
        entries[key.value] = _converted(value)
    return YamlNode(line, entries=entries)


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
