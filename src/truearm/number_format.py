"""Numbers as metrology writes them: no more digits than their uncertainty supports; a zero has no sign."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from truearm.errors import InputError

THIN_SPACE = "\u202f"  # narrow, and never broken at the end of a line
MINUS = "\u2212"
TIMES = "\u00d7"
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PLAIN_EXPONENTS = range(-5, 7)  # outside, a power of ten reads better than a row of zeros


@dataclass(frozen=True)
class RoundedNumber:
    """A number that is shown to the decimal of the second significant digit of its uncertainty.

    Parameters
    ----------
    value : float
    uncertainty : float
        Standard or expanded; 0 if it is not known, and the number is then shown as one without uncertainty.
    """

    value: float
    uncertainty: float


def format_number(value: float, *, uncertainty: float | None = None, digits: int = 3) -> str:
    """A number to the decimal that its standard uncertainty supports, else to `digits` significant digits.

    Parameters
    ----------
    value : float or int
        An int is a count and is given in full.
    uncertainty : float, optional
        Standard uncertainty in the unit of `value`.
    digits : int
        Significant digits of a value without uncertainty. Digits before the decimal point are never rounded away.

    Raises
    ------
    InputError
        If `value` is not finite, or `uncertainty` is not finite or is negative.

    Notes
    -----
    Digits after JCGM 100:2008 (GUM), 7.2.6: two digits of the uncertainty are enough, and the value is rounded
    to be consistent with it. A thin space separates thousands from five digits on, ISO 80000-1, 7.3.1.
    """
    value = _finite(value)
    if isinstance(value, int):
        return _grouped(str(abs(value)), negative=value < 0)
    if uncertainty:
        return _fixed(value, 1 - _exponent(_not_negative(uncertainty), 2))
    if value == 0.0:
        return "0"
    exponent = _exponent(value, digits)
    if exponent not in _PLAIN_EXPONENTS:
        return _scientific(value, digits)
    return _fixed(value, max(digits - 1 - exponent, 0))


def format_in_text(value: float, *, unit: str = "", digits: int = 3) -> str:
    """A number as a sentence has it: to `digits` significant digits, but a whole number without decimals.

    No line break separates it from its unit.
    """
    value = float(value)
    text = format_number(value, digits=digits)
    if value.is_integer() and "." in text and TIMES not in text:
        text = text.partition(".")[0]
    return f"{text}{THIN_SPACE}{unit}" if unit else text


def show_mm(value: float) -> str:
    """A length [mm] in a sentence."""
    return format_in_text(value, unit="mm")


def format_percent(share: float) -> str:
    """A share of one in a sentence, in percent to a tenth."""
    return format_in_text(round(100 * share, 1), unit="%")


def format_uncertainty(uncertainty: float) -> str:
    """A standard uncertainty to two significant digits."""
    uncertainty = _not_negative(uncertainty)
    return _fixed(uncertainty, 1 - _exponent(uncertainty, 2)) if uncertainty else "0"


def format_exact(value: float) -> str:
    """A number that somebody chose, such as a limit, as it was chosen: 0.05 stays 0.05."""
    value = _finite(value)
    size = abs(value)
    text = str(size) if isinstance(size, int) else np.format_float_positional(size, trim="-")
    return _grouped(text, negative=value < 0)


def format_count(n: int, noun: str) -> str:
    """A number of things: 1 row, 2 rows."""
    return f"{format_number(n)} {noun}{'s' * (n != 1)}"


def capitalize(text: str) -> str:
    """A sentence with a capital; the rest stays as it is."""
    return text[:1].upper() + text[1:]


def _exponent(value: float, digits: int) -> int:
    """Power of ten of the leading digit after rounding: 0.0996 to two digits is 0.10, thus -1."""
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _fixed(value: float, decimals: int) -> str:
    rounded = round(value, decimals)
    return _grouped(f"{abs(rounded):.{max(decimals, 0)}f}", negative=rounded < 0)


def _scientific(value: float, digits: int) -> str:
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = str(int(exponent)).translate(_RAISED)
    return f"{mantissa.replace('-', MINUS)}{THIN_SPACE}{TIMES}{THIN_SPACE}10{power}"


def _grouped(text: str, *, negative: bool) -> str:
    whole, point, fraction = text.partition(".")
    if len(whole) > 4:
        whole = f"{int(whole):,}".replace(",", THIN_SPACE)
    return f"{MINUS if negative else ''}{whole}{point}{fraction}"


def _finite(value: object) -> int | float:
    if not isinstance(value, bool | np.bool_):
        if isinstance(value, int | np.integer):
            return int(value)
        if isinstance(value, float | np.floating) and math.isfinite(value):
            return float(value)
    raise InputError(f"expected a finite number, got {value!r}", hint="use None for no value")


def _not_negative(uncertainty: object) -> float:
    u = float(_finite(uncertainty))
    if u < 0:
        raise InputError(f"expected a standard uncertainty of zero or more, got {u:g}")
    return u
