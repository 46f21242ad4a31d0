"""Texts of others, made printable: what a file or a device states acts on no terminal, page or document."""

from __future__ import annotations

import re

# Control characters but tab and line feed, marks that turn the direction of writing, separators of lines, and what XML
# or UTF-8 cannot hold.
_ACTS = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff\ufffe\uffff]"
)


def printable(text: str) -> str:
    """The text with escapes, as Python writes them, in place of characters that act instead of being shown."""
    return _ACTS.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def printable_name(text: str) -> str:
    """The text on one line: an escape also in place of a tab or line feed."""
    return printable(text).replace("\n", r"\n").replace("\t", r"\t")
