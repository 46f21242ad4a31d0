"""What the cell of a table can be: a number in any notation, no value, or words."""

from __future__ import annotations

import re
import unicodedata
from typing import NamedTuple

from truearm.wings.importing.tables.units import canonical_unit

_DASHES = str.maketrans("\u2010\u2011\u2012\u2013\u2014\u2015\u2212\u2019\u2018\u02bc\u00ba", "-------'''°")
_NO_VALUE = re.compile(
    r"-+|\*+|\?+|\.|_+|[+-]?nan(?:\(.*\))?|na|n/a|n\.a\.|#n/?a|#div/0!|#value!|#ref!|#num!|#name\?|#null!|null|none|nil"
    r"|[+-]?1\.#(?:qnan|ind|nan).*|<na>|missing|lost|occluded|invalid|#wert!|#zahl!|#bezug!|#nv|k\.a\.",
    re.IGNORECASE,
)
_PLAIN = r"(?:\d+[.,]?\d*|[.,]\d+)"
_GROUPED = r"\d{1,3}(?:(?P<group>[.,' ])\d{3})(?:(?P=group)\d{3})*(?:(?!(?P=group))[.,]\d*)?"
_LAKHS = r"\d{1,2}(?:,\d{2})+,\d{3}(?:\.\d*)?"  # 12,34,567.5 as India groups
_NUMBER = re.compile(rf"(?P<digits>[+-]?(?:{_PLAIN}|{_GROUPED}|{_LAKHS}))(?P<power>[eEdD][+-]?\d+)?")
_ANGLE = re.compile(
    r"(?P<sign>[+-]?)(?P<deg>\d{1,3})(?:\s*°\s*|\s+|\s*d\s*)(?P<min>[0-5]?\d)(?:\s*['\u2032m]\s*|\s+)"
    r"(?:(?P<sec>[0-5]?\d(?:[.,]\d*)?)\s*(?:\"|''|\u2033|\u2032\u2032|s)?)?"
)
_WITH_UNIT = re.compile(r"(?P<number>[+-]?[\d.,].*?)\s*(?P<unit>[^\W\d_][^\s\d]*|°|°C|\")")
_AS_TEXT = re.compile(r"=\"(.*)\"|'(.+)")
# ``A1 -90.0``; but ``Axis 1`` is a name.
_LABELLED = re.compile(
    r"[\"']?(?P<label>[^\W\d]\w*)[\"']?(?:\s*[:=]\s*(?P<stated>[+-]?\s*[\d.].*)|\s+(?P<plain>[+-]?\s*\d*[.,]\d.*))"
)
_LONGEST = 60  # characters of a number
# Units behind a number; of the others 3A and 5V may be names.
_UNITS = ("deg", "rad", "gon", "mm", "um", "cm", "m", "in", "degC", "counts", "s", "ms")
# One sign with three digits behind and one to three before: a decimal sign, or one between thousands.
DOUBTFUL = re.compile(r"[+-]?[1-9]\d{0,2}([.,])\d{3}")


class Cell(NamedTuple):
    """A cell that is no words.

    Attributes
    ----------
    digits : str
        The number as it is written, without a unit; empty where there is no value.
    unit : str
        As it is written in the cell.
    angle : float, optional
        The number in degrees, where it is written in degrees, minutes and seconds.
    """

    digits: str
    unit: str = ""
    angle: float | None = None


def clean(cell: str) -> str:
    """A cell with ASCII digits, signs and blanks, without what makes a spreadsheet keep a number as text."""
    if not cell.isascii():
        cell = unicodedata.normalize("NFKC", cell.translate(_DASHES)).translate(_DASHES)
    cell = cell.strip()
    if cell[:1] in "'=" and (match := _AS_TEXT.fullmatch(cell)):
        return match[1] or match[2]
    return cell


def parse_cell(cell: str) -> Cell | None:
    """What a cell holds; None if it is words.

    Examples
    --------
    >>> parse_cell("12.5 mm"), parse_cell("n/a"), parse_cell("point 3")
    (Cell(digits='12.5', unit='mm', angle=None), Cell(digits='', unit='', angle=None), None)
    >>> round(parse_cell("-12 30 36").angle, 6)
    -12.51
    """
    text = clean(cell[:_LONGEST])
    if len(cell) > _LONGEST and len(cell.strip()) > _LONGEST:
        return None
    if not text or _NO_VALUE.fullmatch(text):
        return Cell("")
    if text[0] in "+-":
        text = text[0] + text[1:].lstrip()
    if _NUMBER.fullmatch(text):
        return Cell(text)
    if match := _ANGLE.fullmatch(text):
        parts = (float((match[name] or "0").replace(",", ".")) for name in ("deg", "min", "sec"))
        size = sum(part / 60**power for power, part in enumerate(parts))
        return Cell(text, "deg", -size if match["sign"] == "-" else size)
    if (
        (match := _WITH_UNIT.fullmatch(text))
        and canonical_unit(match["unit"]) in _UNITS
        and _NUMBER.fullmatch(match["number"])
    ):
        return Cell(match["number"], match["unit"])
    return None


def is_number(cell: str) -> bool:
    """Whether a cell holds a number in any notation, with its name before it or not."""
    parsed = parse_cell(cell) or parse_cell(split_label(cell)[1])
    return parsed is not None and bool(parsed.digits)


def is_value(cell: str) -> bool:
    """Whether a cell holds a number or says that there is none."""
    return parse_cell(cell) is not None


def split_label(cell: str) -> tuple[str, str]:
    """Split ``A1 -90.0`` or ``J1=12.5 deg`` into the label and the number; no label if it is none."""
    match = _LABELLED.fullmatch(cell.strip())
    return (match["label"], match["stated"] or match["plain"]) if match else ("", cell)


def number_of(digits: str, thousands: str = "") -> float:
    """The number that is written; in doubt a sign of `thousands` groups digits, every other one is decimal.

    Examples
    --------
    >>> number_of("1.235"), number_of("1.235", "."), number_of("1.235,5"), number_of("1.0D+02"), number_of("1'234.5")
    (1.235, 1235.0, 1235.5, 100.0, 1234.5)
    """
    match = _NUMBER.fullmatch(digits)
    if match is None:
        raise ValueError(digits)
    number, power = match["digits"], match["power"] or ""
    if not power and (doubtful := DOUBTFUL.fullmatch(number)):
        number = number.replace(doubtful[1], "" if doubtful[1] in thousands else ".")
    else:
        signs = re.findall(r"[.,' ]", number)
        if len(signs) > 1 or (signs and signs[0] in "' "):
            last = signs[-1] if signs.count(signs[-1]) == 1 and signs[-1] in ".," else ""
            whole, _, fraction = number.rpartition(last) if last else (number, "", "")
            number = re.sub(r"[.,' ]", "", whole) + (f".{fraction}" if last else "")
        number = number.replace(",", ".")
    return float(number + re.sub("[dD]", "e", power))
