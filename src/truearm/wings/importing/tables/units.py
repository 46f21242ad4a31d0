"""Units as tables write them: in a row below the names, behind a name, or behind a number."""

from __future__ import annotations

import re

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
