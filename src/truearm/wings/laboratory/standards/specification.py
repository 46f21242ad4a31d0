"""The specification of an arm: its measuring range and its limits by symbol.

The file (TOML, docs/verification.md) states limits in micrometres with the length in millimetres, as data sheets do:
``+-(A + L/K)``, ``+-B``, or ``+-min(A + L/K, B)`` (the forms of ISO 10360-1 and -2, recalled). A name or a title must
not claim a verdict, which is the result of the test, or another standard.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan
from pathlib import Path
from types import MappingProxyType
from typing import Self

from pydantic import Field, field_validator, model_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Name, NotNegative, Positive, Real, read_document
from truearm.wings.laboratory.standards.measured_points import CONDITIONS, PointGroup

# Chosen here: thermometers of the room and of the artefacts that are farther apart contradict each other [K].
APART_K = 0.5


class RatedRange(Document):
    """The range of a rated condition; one end may be missing."""

    min: Real | None = None
    max: Real | None = None

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.min is None and self.max is None:
            raise InputError("expected min, max or both, got none", hint="write { min = 18, max = 22 }")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise InputError(f"min = {self.min:g} is larger than max = {self.max:g}", hint="exchange the two")
        return self

    def contains(self, low: float, high: float) -> bool:
        """Whether all values between two are in the range."""
        return (-inf if self.min is None else self.min) <= low and high <= (inf if self.max is None else self.max)

    def describe(self, unit: str) -> str:
        """The range in words: ``18 to 22 degC``, ``30 min or more``."""
        if self.min is None:
            return f"{self.max:g} {unit} or less"
        return f"{self.min:g} {unit} or more" if self.max is None else f"{self.min:g} to {self.max:g} {unit}"


@dataclass(frozen=True)
class ConditionResult:
    """A rated condition and what was measured.

    Attributes
    ----------
    name, unit : str
    rated : RatedRange
    measured : (float, float) or None
        The lowest and the highest value; None if it is stated nowhere.
    missing : str
        What to fill in where a group of points does not state the condition, nor the room; empty if all do.
    """

    name: str
    unit: str
    rated: RatedRange
    measured: tuple[float, float] | None
    missing: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the condition was met; None if nothing contradicts it, but it is not stated for all points."""
        if self.measured is not None and not self.rated.contains(*self.measured):
            return False
        return None if self.missing else True

    def __str__(self) -> str:
        rated = f"rated {self.rated.describe(self.unit)}"
        if self.measured is None:
            return f"{self.name} ({rated})"
        low, high = self.measured
        values = " to ".join(dict.fromkeys((f"{low:.4g}", f"{high:.4g}")))
        some = " at some of the points" if self.missing else ""
        return f"{self.name} {values} {self.unit}{some}, {rated}"


def compare_conditions(
    rated: Mapping[str, RatedRange],
    groups: Sequence[PointGroup],
    room: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> tuple[ConditionResult, ...]:
    """Compare the conditions of measured groups with the rated ones.

    The artefacts have the temperature of the air after some hours: where the temperature of the air is rated, theirs is
    compared too. What is stated of the room, lowest and highest, holds for all groups; what one group states holds for
    that group only.
    """
    results = []
    for key, limits in rated.items():
        name, unit, *_ = CONDITIONS[key]
        stated = [group.conditions[key] for group in groups if key in group.conditions]
        if key in room:
            stated.append(room[key])
        measured = (min(low for low, _ in stated), max(high for _, high in stated)) if stated else None
        by_artefact = key == "air_degC"
        degC = [group.degC for group in groups if by_artefact and not isnan(group.degC)]
        whole = key in room or all(
            key in group.conditions or (by_artefact and not isnan(group.degC)) for group in groups
        )
        if degC:
            results.append(ConditionResult("temperature of the artefacts", unit, limits, (min(degC), max(degC))))
        if measured is not None or not whole:
            results.append(ConditionResult(name, unit, limits, measured, "" if whole else _where_to_state(key)))
    return tuple(results)


def _where_to_state(key: str) -> str:
    room = " or relative_humidity_percent of the room" if key == "humidity_percent" else ""
    return f"fill in the column {key} of the points{room}"


def describe_disagreement(air: tuple[float, float] | None, artefacts: tuple[float, float] | None) -> str | None:
    """Say by how much artefacts were outside the stated range of the air, whose temperature they have after hours.

    Parameters
    ----------
    air, artefacts : (float, float) or None
        Lowest and highest temperature [degC]; None where none is stated.

    Returns
    -------
    str or None
        None if the ranges agree to `APART_K`.
    """
    if air is None or artefacts is None:
        return None
    apart = max(air[0] - artefacts[0], artefacts[1] - air[1])
    if apart <= APART_K:
        return None
    room, bodies = (" to ".join(dict.fromkeys(f"{one:g}" for one in pair)) for pair in (air, artefacts))
    return (
        f"the air was stated at {room} degC, the artefacts at {bodies} degC, up to {apart:.2g} K outside: artefacts "
        "that have stood in the room for hours have its temperature; check both thermometers, or state the whole range "
        "of the room"
    )


_VERDICT = re.compile(
    r"\b(?:conform(?:s|ed|ing|ity|ance)?|compl(?:y|ies|ied|iant|iance)|pass(?:es|ed)?|certified|approved|meets|"
    r"fulfils)\b",
    re.IGNORECASE,
)
_STANDARD = re.compile(r"\b(?:ISO|IEC|EN|DIN|ASME|ANSI|VDI|VDE|BS|JIS|JJF|GB)\b[A-Z/ ]*[ -]?[A-Z]?\d[\d.\-]*\d")


def check_no_verdict(text: str) -> str:
    """Return a name or title that states no verdict.

    Raises
    ------
    InputError
        If it does.
    """
    if (found := _VERDICT.search(text)) is not None:
        raise InputError(
            f"expected what is tested, got {text!r:.80}, which says {found[0]!r}",
            hint="leave the verdict out: it is the result of the test",
        )
    return text


def named_standards(text: str) -> list[str]:
    """The standards that a text names, without their years."""
    return [one[0] for one in _STANDARD.finditer(text)]


# The names of the results of the tests, without the index that standards add (":0:Tact.AArm"); each with its test, and
# the example limit of an arm with a measuring range of 2.5 m, chosen here [um].
SYMBOLS: Mapping[str, tuple[str, float]] = {
    "P_Size.Sph.1x25": ("probing", 25.0),
    "P_Form.Sph.1x25": ("probing", 40.0),
    "L_Dia.5x5": ("articulation", 50.0),
    "E_Uni": ("uni", 60.0),
    "E_Bi": ("bi", 70.0),
    "EffectiveDiameter": ("effective_diameter", 25.0),
    "SPAT.Max": ("single_point", 40.0),
    "SPAT.2s": ("single_point", 50.0),
    "Volumetric.Max": ("volumetric", 60.0),
    "Volumetric.2s": ("volumetric", 60.0),
    "Volumetric.2RMS": ("volumetric", 60.0),
}

# Other numbers are in another unit: limits [um], K [mm/um] (1 is a millimetre per metre), measuring range [mm].
LEAST_UM, MOST_UM = 0.5, 10_000.0
LEAST_K = 1.0
LEAST_RANGE_MM = 100.0

# What it is, where the key is missing or too small.
MEASURING_RANGE = "the diameter of the sphere in which the arm measures, twice its reach: 2500 for 2.5 m"


class Limit(Document):
    """A maximum permissible error or limit.

    Attributes
    ----------
    A_um : float
        [um]
    K_mm_per_um : float
        The length in mm divided by K is in um.
    B_um : float
        [um]
    """

    A_um: NotNegative | None = None
    K_mm_per_um: Positive | None = None
    B_um: Positive | None = None

    @model_validator(mode="after")
    def _one_of_the_forms(self) -> Self:
        if (self.A_um is None) != (self.K_mm_per_um is None):
            raise InputError(
                "A_um and K_mm_per_um belong together",
                hint="add the missing one, or write B_um for a limit without a length",
            )
        if self.A_um is None and self.B_um is None:
            raise InputError(
                "expected B_um, or A_um and K_mm_per_um, or all three; got none", hint="add the limit in um"
            )
        for name, given in (("A_um", self.A_um), ("B_um", self.B_um)):
            if given is not None and given and not LEAST_UM <= given <= MOST_UM:
                size = "small" if given < LEAST_UM else "large"
                raise InputError(
                    f"expected {name} in micrometres, got {given:g}, too {size} for any arm",
                    hint="write 15 for 0.015 mm",
                )
        if self.K_mm_per_um is not None and self.K_mm_per_um < LEAST_K:
            raise InputError(
                f"expected K_mm_per_um, millimetres of length for a micrometre, got {self.K_mm_per_um:g}",
                hint="write 80 for L/80, or for 12.5 um per metre",
            )
        return self

    def at(self, length_mm: float | None) -> float:
        """Return the limit [mm] at a length; None for a test without a length.

        Raises
        ------
        InputError
            If the limit needs a length and there is none.
        """
        forms = [] if self.B_um is None else [self.B_um]
        if self.A_um is not None and self.K_mm_per_um is not None:
            if length_mm is None:
                raise InputError(
                    "this test has no length, and its limit depends on one", hint="write B_um, not A_um and K_mm_per_um"
                )
            forms.append(self.A_um + length_mm / self.K_mm_per_um)
        return min(forms) / 1000


class Specification(Document):
    """An arm's specification.

    Attributes
    ----------
    name, source : str
        The arm, and the source of the limits.
    measuring_range_mm : float
        Diameter of the sphere in which it measures, twice its reach from the shoulder [mm].
    corrected_to_20_degC : bool
        Whether the limits apply to lengths corrected to 20 degC by the artefact's temperature, as usual.
    rated_conditions : dict of str to RatedRange
        Outside which the limits do not apply, by the names of `CONDITIONS`; empty where none are stated.
    limits : dict of str to Limit
        By symbol.

    Examples
    --------
    >>> import truearm as ta
    >>> specification = ta.simulate_verification("perfect", n_arms=1).specification
    >>> specification.measuring_range_mm > 0
    True
    """

    name: Name
    source: Name
    measuring_range_mm: Positive = Field(description=MEASURING_RANGE)
    corrected_to_20_degC: bool = True
    rated_conditions: dict[str, RatedRange] = Field(default_factory=dict)
    limits: dict[str, Limit]

    @field_validator("rated_conditions")
    @classmethod
    def _known_conditions(cls, given: dict[str, RatedRange]) -> dict[str, RatedRange]:
        for name, rated in given.items():
            if name not in CONDITIONS:
                raise InputError(f"unknown condition {name!r:.80}", hint=f"use one of {', '.join(CONDITIONS)}")
            _, unit, least, most = CONDITIONS[name]
            if (rated.max is not None and rated.max < least) or (rated.min is not None and rated.min > most):
                raise InputError(
                    f"{name} is {rated.describe(unit)}: no measurement is, from {least:g} to {most:g} {unit}",
                    hint="check the unit, which is in the name",
                )
        return given

    @field_validator("name")
    @classmethod
    def _claims_nothing(cls, name: str) -> str:
        return check_no_verdict(name)

    @field_validator("measuring_range_mm")
    @classmethod
    def _in_mm(cls, given: float) -> float:
        if given < LEAST_RANGE_MM:
            raise InputError(f"expected the measuring range in mm, got {given:g}", hint=f"write {MEASURING_RANGE}")
        return given

    @field_validator("limits", mode="before")
    @classmethod
    def _in_quotes(cls, limits: object) -> object:
        """Refuse symbols without quotes: TOML reads a dot in them as a table in a table."""
        for key, table in limits.items() if isinstance(limits, dict) else ():
            symbol = str(key)
            while inner := [(k, t) for k, t in table.items() if isinstance(t, dict)] if isinstance(table, dict) else []:
                symbol, table = f"{symbol}.{inner[0][0]}", inner[0][1]
            if symbol != key:
                raise InputError(f"{symbol:.80} has no quotes", hint=f'write "{symbol:.80}" = {{ .. }}')
        return limits

    @field_validator("limits")
    @classmethod
    def _known_symbols(cls, limits: dict[str, Limit]) -> dict[str, Limit]:
        by_symbol: dict[str, Limit] = {}
        for written, limit in limits.items():
            symbol = written.partition(":")[0]
            if symbol not in SYMBOLS:
                close = difflib.get_close_matches(symbol, SYMBOLS, n=1)
                raise InputError(
                    f"unknown symbol {written!r:.80}", hint=f"use {close[0] if close else ', '.join(SYMBOLS)}"
                )
            if symbol in by_symbol:
                raise InputError(f"the limit of {symbol} is given twice", hint="remove one of them")
            by_symbol[symbol] = limit
        return by_symbol

    def limit(self, symbol: str, length_mm: float | None = None) -> float | None:
        """Return the limit [mm] of a symbol, at a length where it depends on one; None where none is stated."""
        stated = self.limits.get(symbol)
        try:
            return None if stated is None else stated.at(length_mm)
        except InputError as error:
            raise InputError(f"limits.{symbol}: {error.problem}", hint=error.hint) from None


def read_specification(path: str | Path) -> Specification:
    r"""Read a file of limits.

    Raises
    ------
    InputError
        If the file is missing or breaks a rule of its format.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> about = 'name = "arm"\nsource = "data sheet"\nmeasuring_range_mm = 2500\n'
    >>> _ = Path("mpe.toml").write_text(about + '[limits]\n"P_Form.Sph.1x25" = { B_um = 30 }\n')
    >>> ta.read_specification("mpe.toml").measuring_range_mm
    2500.0
    """
    return read_document(path, Specification)


def example_specification(measuring_range_mm: float) -> Specification:
    """Return example limits, proportional to the measuring range."""
    share = measuring_range_mm / 2500.0
    return Specification(
        name=f"example, measuring range {measuring_range_mm:.5g} mm",
        source="example limits of truearm",
        measuring_range_mm=measuring_range_mm,
        rated_conditions={"air_degC": RatedRange(min=15.0, max=25.0)},
        limits={symbol: Limit(B_um=round(share * limit, 1)) for symbol, (_, limit) in SYMBOLS.items()},
    )
