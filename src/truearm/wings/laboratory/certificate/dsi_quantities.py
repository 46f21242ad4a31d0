r"""Quantities of the D-SI (Digital System of Units, EMPIR SmartCom) as they stand in certificates of any laboratory.

Read are ``si:real``, ``si:constant``, ``si:list``, ``si:hybrid`` and ``si:realListXMLList``, with the uncertainties of
schemas 1.x and 2.x (``expandedUnc``, ``coverageInterval``) and of 2.2 (``measurementUncertaintyUnivariate``). An
uncertainty, factor or unit that a list states once applies to all its values. Values keep their written digits.
"""

from __future__ import annotations

import re
import unicodedata
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from decimal import Decimal

from truearm.errors import InputError
from truearm.wings.laboratory.certificate.administrative_data import xml_text

SI = "{https://ptb.de/si}"
MOST_VALUES = 10_000  # of one quantity
MOST_TEXT = 500  # characters of a name
LARGEST_EXPONENT = 30  # of ten, in numbers and units
_PREFIXES = {"pico": -12, "nano": -9, "micro": -6, "milli": -3, "centi": -2, "deci": -1, "kilo": 3, "mega": 6}
_BASES = {"metre": 0, "meter": 0, "kelvin": 0, "degreecelsius": 0, "one": 0, "percent": -2, "ppm": -6}
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
_TOKEN = re.compile(r"\\([a-zA-Z]+)(?:\\tothe\{([+-]?\d{1,3})\})?")
_EXPANDED, _STANDARD = ("uncertainty", "valueExpandedMU"), ("standardUnc", "valueStandardMU")


@dataclass(frozen=True)
class DsiUnit:
    r"""A unit as a power of ten times base units: ``\micro\metre`` is -6 and ``{"metre": 1}``."""

    exponent: int
    dimensions: tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class MeasuredValue:
    r"""A value of a quantity with its uncertainty, as written.

    Attributes
    ----------
    value : Decimal
    unit : str
        In the form of the D-SI, such as ``\milli\metre``.
    expanded, factor, probability : Decimal or None
        Expanded uncertainty, coverage factor and coverage probability.
    standard : Decimal or None
        Standard uncertainty, where that is stated.
    distribution, label : str or None
    """

    value: Decimal
    unit: str
    expanded: Decimal | None = None
    factor: Decimal | None = None
    probability: Decimal | None = None
    standard: Decimal | None = None
    distribution: str | None = None
    label: str | None = None

    @property
    def u(self) -> Decimal | None:
        """Standard uncertainty: the stated one, or U / k; None where neither is stated."""
        if self.standard is not None or self.expanded is None or not self.factor:
            return self.standard
        return self.expanded / self.factor

    def __str__(self) -> str:
        parts = [f"{self.label}: " if self.label else "", f"{self.value} {self.unit}"]
        if self.expanded is not None:
            parts.append(f", U = {self.expanded}{'' if self.factor is None else f' (k = {self.factor})'}")
        elif self.standard is not None:
            parts.append(f", u = {self.standard}")
        return "".join(parts)

    def scale_to(self, dimensions: dict[str, int]) -> int | None:
        """The power of ten by which the unit exceeds base units of these dimensions; None if it has others."""
        unit = parse_unit(self.unit)
        return unit.exponent if unit is not None and dict(unit.dimensions) == dimensions else None


def parse_unit(text: str) -> DsiUnit | None:
    r"""Return a unit of the D-SI of metres, kelvins, degrees Celsius and numbers; None for any other.

    Examples
    --------
    >>> from truearm.wings.laboratory.certificate.dsi_quantities import parse_unit
    >>> parse_unit(r"\micro\metre")
    DsiUnit(exponent=-6, dimensions=(('metre', 1),))
    >>> parse_unit(r"\micro\metre\per\metre\per\kelvin") == parse_unit(r"\micro\kelvin\tothe{-1}")
    True
    >>> parse_unit(r"\kilogram") is None
    True
    """
    tokens = list(_TOKEN.finditer(text))
    if not tokens or "".join(one[0] for one in tokens) != text:
        return None
    exponent, sign, prefix, powers = 0, 1, 0, dict[str, int]()
    for token in tokens:
        word, power = token[1], int(token[2] or 1)
        if word == "per":
            sign = -1
        elif word in _PREFIXES:
            prefix = _PREFIXES[word]
        elif word in _BASES:
            base = "metre" if word == "meter" else word
            exponent += sign * power * (prefix + _BASES[word])
            if base not in ("one", "percent", "ppm"):
                powers[base] = powers.get(base, 0) + sign * power
            sign, prefix = 1, 0
        else:
            return None
    if abs(exponent) > LARGEST_EXPONENT:
        return None
    return DsiUnit(exponent, tuple(sorted((base, power) for base, power in powers.items() if power)))


def read_values(element: ET.Element) -> tuple[MeasuredValue, ...]:
    """Return the values of a quantity; none if it is text, complex, or without a number.

    Of a hybrid, which states one quantity in several units, the first one with a unit of `parse_unit` is read.

    Raises
    ------
    InputError
        If numbers, units or uncertainties cannot be read, or do not belong to each other.
    """
    for kind in element:
        name = kind.tag.removeprefix(SI)
        if kind.tag == f"{SI}hybrid":
            alternatives = [read for child in kind if (read := _of_form(child))]
            known = [one for one in alternatives if parse_unit(one[0].unit) is not None]
            return (known or alternatives or [()])[0]
        if kind.tag == f"{SI}list":
            found = tuple(one for child in kind.iter(f"{SI}real") for one in _of_form(child))
            _check_count(len(found), name)
            return found
    forms = [values for kind in element if (values := _of_form(kind))]
    if len(forms) > 1:
        raise InputError(f"expected one value or list, got {len(forms)}")
    return forms[0] if forms else ()


def _of_form(element: ET.Element) -> tuple[MeasuredValue, ...]:
    """The values of one real, constant or list."""
    name = element.tag.removeprefix(SI)
    if name not in ("real", "constant", "realListXMLList"):
        return ()
    fields: dict[str, str] = {}
    for child in element.iter():
        tag, text = child.tag.removeprefix(SI).removesuffix("XMLList"), (child.text or "").strip()
        if child is not element and text:
            if tag in fields:
                raise InputError(f"<si:{name}> states <si:{tag}> twice")
            fields[tag] = text
    if not fields.get("value") or not fields.get("unit"):
        raise InputError(f"<si:{name}> has no {'unit' if fields.get('value') else 'value'}")
    listed = {tag: text.split() if name.endswith("XMLList") else [text] for tag, text in fields.items()}
    count = len(listed["value"])
    _check_count(count, name)

    def of_all(*tags: str) -> list[str | None]:
        given = next((listed[tag] for tag in tags if tag in listed), [])
        if len(given) not in (0, 1, count):
            raise InputError(f"<si:{name}>: {count} values, {len(given)} entries of {tags[0]}")
        return [*given] * count if len(given) == 1 else [*given] or [None] * count

    values = map(number, listed["value"])
    numbers = (_EXPANDED, ("coverageFactor",), ("coverageProbability",), _STANDARD)
    columns = [[None if text is None else number(text) for text in of_all(*tags)] for tags in numbers]
    texts = [[text and clean(text) for text in of_all(tag)] for tag in ("unit", "distribution", "label")]
    return tuple(
        MeasuredValue(value, unit or "", expanded, factor, probability, standard, distribution, label)
        for value, expanded, factor, probability, standard, unit, distribution, label in zip(
            values, *columns, *texts, strict=True
        )
    )


def _check_count(count: int, name: str) -> None:
    if count > MOST_VALUES:
        raise InputError(f"<si:{name}> has {count} values; truearm reads {MOST_VALUES} at most")


def clean(text: str) -> str:
    """A text of a file of others in one line, without control characters, and of limited length."""
    plain = "".join(" " if unicodedata.category(sign) in ("Cc", "Cf", "Zl", "Zp") else sign for sign in text[:10_000])
    return xml_text(plain)[:MOST_TEXT]


def number(text: str) -> Decimal:
    """Read a decimal number of a certificate; refuse what is no number of XML Schema, or beyond 1e30."""
    value = Decimal(text) if len(text) < 100 and _NUMBER.fullmatch(text) else Decimal("NaN")
    if not value.is_finite() or abs(value.adjusted()) > LARGEST_EXPONENT:
        raise InputError(f"expected a number, got {text[:80]!r}")
    return value
