"""Units that the lines above a table state in words: Units: Inches, all coordinates in metres."""

from __future__ import annotations

import re

from truearm.files.tables.table import Table
from truearm.files.tables.units import canonical_unit

_LENGTHS = ("mm", "m", "cm", "um", "in")
_MAX_BYTES = 65_536
_WORD = re.compile(
    r"\b(inch(?:es)?|zoll|centimet(?:er|re)s?|millimet(?:er|re)s?|met(?:er|re)s?|micromet(?:er|re)s?|microns?)\b"
    r"|\b(?:units?|einheit(?:en)?|unit\u00e9s?|unidades|lengths?|coordinates?)\b\W{1,3}(?:in\W+)?(mm|cm|m|um|\u00b5m|in)\b",
    re.IGNORECASE,
)


def length_unit_above(table: Table) -> str | None:
    """Return the one unit of length that titles and comments above a table of text name; None of none or several."""
    first = table.header_line or (int(table.lines[0]) if len(table) else 1)
    if table.file is None or table.place != "line" or first < 2:
        return None
    with table.file.open("rb") as file:
        text = file.read(_MAX_BYTES).replace(b"\0", b"").decode("utf-8", "replace")
    above = "\n".join(text.splitlines()[: first - 1])
    words = {(match[1] or match[2]).casefold().replace("zoll", "inch") for match in _WORD.finditer(above)}
    units = {canonical_unit(word) for word in words} & {*_LENGTHS}
    return units.pop() if len(units) == 1 else None
