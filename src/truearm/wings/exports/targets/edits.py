"""Edits of a file: some of its parts replaced, everything else as it was."""

from __future__ import annotations

from collections.abc import Iterable
from typing import AnyStr, NamedTuple


class Edit(NamedTuple):
    """Bytes of a file to be replaced; ``start == end`` inserts."""

    start: int
    end: int
    text: bytes


def with_edits(content: AnyStr, edits: Iterable[tuple[int, int, AnyStr]]) -> AnyStr:
    """The content with all edits made, which must not overlap; insertions at one place keep their order."""
    parts: list[AnyStr] = []
    at = 0
    for start, end, text in sorted(edits, key=lambda edit: edit[:2]):
        if start < at:
            raise ValueError(f"edits overlap at {start}")
        parts += [content[at:start], text]
        at = end
    return content[:0].join(parts) + content[at:]
