"""What the cell of a table can be: a number in any notation, no value, or words; and the units that tables write."""

from __future__ import annotations

import re
import unicodedata
from typing import NamedTuple

# What is written (without case), by what it means.
_WRITTEN = {
    "deg": "deg degs degree degrees ° º 度",
    "rad": "rad rads radian radians",
    "gon": "gon gons gradian gradians",
    "grad": "grad",  # degrees in German, gon in English
    "mm": "mm millimeter millimeters millimetre millimetres millimetri",
    "um": "um µm μm micron microns micrometer micrometers micrometre",
    "cm": "cm centimeter centimeters centimetre",
    "m": "m meter meters metre metres",
    "in": 'in inch inches " ″',
    "ft": "ft foot feet",
    "km": "km",
    "counts": "count counts cts inc increments ticks steps pulse pulses",
    "degC": "degc °c ℃ c celsius",
    "degF": "degf °f ℉ f fahrenheit",
    "s": "s sec secs second seconds sek",
    "ms": "ms msec millis millisecond milliseconds",
    "us": "us µs μs usec micros microseconds",
    "ns": "ns nsec nanos nanoseconds",
    "min": "min",
    "h": "h",
    "kg": "kg",
    "g": "g gram grams",
    "lb": "lb lbs",
    "N": "n",
    "Nm": "nm n·m n*m",
    "mNm": "mnm",
    "deg/s": "deg/s °/s",
    "rad/s": "rad/s",
    "mm/s": "mm/s",
    "m/s": "m/s",
    "K": "k kelvin",
    "Hz": "hz",
    "A": "a amp ampere",
    "mA": "ma",
    "V": "v",
    "%": "%",
    "": "- -- 1 none unitless n/a",
}
_MEANING = {written: unit for unit, all_written in _WRITTEN.items() for written in all_written.split()}
_MEANING["n/a"] = ""
# Units of one quantity, as multiples of the first one; and what that is where another unit is zero.
_QUANTITIES: tuple[dict[str, float], ...] = (
    {"mm": 1.0, "m": 1000.0, "um": 0.001, "in": 25.4, "cm": 10.0},
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    {"degC": 1.0, "K": 1.0, "degF": 5 / 9},
    {"kg": 1.0, "g": 0.001, "lb": 0.45359237},
    {"Nm": 1.0, "mNm": 0.001},
    {"A": 1.0, "mA": 0.001},
)
_AT_ZERO = {"K": -273.15, "degF": -160 / 9}
# Behind a name without brackets only what cannot be a part of the name itself: X_m may be "measured".
_BEHIND = ["deg", "degrees", "°", "rad", "radians", "mm", "um", "µm", "μm", "counts", "degC", "°C", "inch"]
_IN_NAME = re.compile(
    r".*\S\s*(?:[\[(<{]\s*(?P<within>[^\[\](){}<>]{1,20}?)\s*[\])>}]"
    r"|\s*[/,]\s*(?P<divided>[^\W\d_]{1,12}|°|°C)"
    rf"|[\s_.](?P<behind>{'|'.join(_BEHIND)}))",
    re.IGNORECASE,
)


def canonical_unit(written: str) -> str | None:
    """The usual sign of a unit (``deg`` of ``°`` or ``Degrees``); empty for none, None if it is unknown.

    Examples
    --------
    >>> canonical_unit("Degrees"), canonical_unit("[mm]"), canonical_unit("furlong")
    ('deg', 'mm', None)
    """
    text = written.strip()
    return _MEANING.get(text.casefold(), _MEANING.get(_within_brackets(text).casefold()))


def conversion(unit: str, to: str) -> tuple[float, float] | None:
    """Factor and offset that turn a number of one unit into one of another; None if they measure different things.

    Examples
    --------
    >>> conversion("m", "mm"), conversion("K", "degC"), conversion("kg", "mm")
    ((1000.0, 0.0), (1.0, -273.15), None)
    """
    units = next((units for units in _QUANTITIES if unit in units and to in units), {unit: 1.0})
    if to not in units:
        return None
    return units[unit] / units[to], (_AT_ZERO.get(unit, 0.0) - _AT_ZERO.get(to, 0.0)) / units[to]


def unit_in_name(name: str) -> str:
    """The unit that a column's name states, as it is written; empty if it states none.

    Examples
    --------
    >>> [unit_in_name(name) for name in ("J1 [deg]", "X (mm)", "q1_rad", "X/mm", "X_m", "time")]
    ['deg', 'mm', 'rad', 'mm', '', '']
    """
    match = _IN_NAME.fullmatch(name.strip())
    written = next((part for part in match.groups() if part), "") if match else ""
    return written if canonical_unit(written) else ""


def name_without_unit(name: str) -> str:
    """A column's name without the unit in brackets behind it.

    Examples
    --------
    >>> name_without_unit("J1 [deg]"), name_without_unit("q1_deg")
    ('J1', 'q1_deg')
    """
    return re.sub(r"\s*[\[(<{][^\[\](){}<>]*[\])>}]$", "", name) if unit_in_name(name) else name


def units_of_row(cells: list[str]) -> tuple[str, ...] | None:
    """The units of a row in which every cell that is not empty is one, without brackets; None if it is none.

    Examples
    --------
    >>> units_of_row(["[deg]", "", "mm"]), units_of_row(["X", "Y"])
    (('deg', '', 'mm'), None)
    """
    filled = [cell for cell in cells if cell]
    if not any(canonical_unit(cell) for cell in filled) or any(canonical_unit(cell) is None for cell in filled):
        return None
    return tuple(_within_brackets(cell) if canonical_unit(cell) else "" for cell in cells)


def _within_brackets(text: str) -> str:
    return re.sub(r"^[\[(<{]\s*|\s*[\])>}]$", "", text)


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
