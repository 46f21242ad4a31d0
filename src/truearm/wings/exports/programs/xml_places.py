"""Elements of an XML text with the places of their attributes, so that only those bytes need to change."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from truearm.errors import InputError
from truearm.wings.exports.programs.number_texts import six_numbers
from truearm.wings.exports.programs.program import Lines, Number

# Levels of a program: each node of PolyScope's tree takes two, and a waypoint some more.
MAX_DEPTH = 500
# What does not end reaches to the end of the text: to look for its end once is enough.
_TAG = re.compile(
    r"<!--.*?(?:-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)|<\?.*?(?:\?>|\Z)"
    r"|<(/?)([\w.:-]+)((?:\s+[\w.:-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*(/?)>",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"([\w.:-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_STEP = re.compile(r"([\w.:-]+)(?:\[(\d+)\])?")


@dataclass(eq=False)
class Node:
    """An element: its attributes with their places, and its children."""

    tag: str
    start: int
    parent: Node | None
    attributes: dict[str, tuple[int, str]] = field(default_factory=dict)
    children: list[Node] = field(default_factory=list)

    def walk(self) -> Iterator[Node]:
        """Yield the element and all below it, in the order of the text."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting += reversed(node.children)

    @cached_property
    def by_tag(self) -> dict[str, list[Node]]:
        """The children by their names, once all are read."""
        found: defaultdict[str, list[Node]] = defaultdict(list)
        for one in self.children:
            found[one.tag].append(one)
        return dict(found)

    def child(self, tag: str) -> Node | None:
        """The first child of a name; if it refers to an earlier node, that one."""
        return self.by_tag[tag][0].resolved() if tag in self.by_tag else None

    def resolved(self) -> Node | None:
        """The node, or the earlier one that it refers to (XStream's relative path); None if there is none."""
        chain, node = [self], self.referred
        while node is not None and node is not chain[-1]:
            chain.append(node)
            node = node.referred
        for one in chain:
            one.referred = node
        return node

    @cached_property
    def referred(self) -> Node | None:
        """The node, or the one that its own reference names."""
        if "reference" not in self.attributes:
            return self
        node: Node | None = self
        for step in self.attributes["reference"][1].split("/"):
            if node is None:
                return None
            if step == "..":
                node = node.parent
                continue
            named = _STEP.fullmatch(step)
            same = node.by_tag.get(named[1], []) if named else []
            k = int(named[2] or 1) if named else 0
            node = same[k - 1] if 0 < k <= len(same) else None
        return None if node is None or node.start >= self.start else node  # earlier ones only: no circle

    def inside(self, tag: str) -> bool:
        """Whether an element of a name is around it."""
        node = self.parent
        while node is not None and node.tag != tag:
            node = node.parent
        return node is not None

    def text(self, name: str) -> str:
        """An attribute, empty without it."""
        return self.attributes.get(name, (0, ""))[1]

    def numbers(self, name: str) -> list[Number] | None:
        """The six numbers of an attribute."""
        start, text = self.attributes.get(name, (0, ""))
        return six_numbers(text, start)


def parse_nodes(data: bytes) -> Node:
    """The elements of an XML text with their places. No entity is expanded, no file read.

    Raises
    ------
    InputError
        If an element does not end: the program is truncated; if elements are nested too deep.
    """
    text = data.decode("latin-1")
    node = root = Node("", 0, None)
    depth = 0
    for found in _TAG.finditer(text):
        if found[2] is None:
            continue
        if found[1]:
            if node.parent is None or node.tag != found[2]:
                raise InputError(f"</{found[2]}> ends no open element", line=Lines(data)(found.start()))
            node = node.parent
            depth -= 1
            continue
        made = Node(found[2], found.start(), node)
        for one in _ATTRIBUTE.finditer(text, found.start(3), found.end(3)):
            group = 2 if one[2] is not None else 3
            made.attributes[one[1]] = (one.start(group), one[group])
        node.children.append(made)
        if not found[4]:
            node = made
            depth += 1
            if depth > MAX_DEPTH:
                raise InputError(f"expected at most {MAX_DEPTH} levels of elements", line=Lines(data)(node.start))
    if node is not root or not root.children:
        raise InputError(
            f"<{node.tag}> does not end: the program is truncated" if node is not root else "it has no element",
            line=Lines(data)(node.start),
        )
    return root
