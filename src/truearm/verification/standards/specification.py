"""What an arm's specification permits: its measuring range and limits by symbol.

The file (TOML, docs/verification.md) states limits in micrometres with the length in millimetres, as data sheets do:
``+-(A + L/K)``, ``+-B``, or ``+-min(A + L/K, B)`` (the forms of ISO 10360-1 and -2, recalled).
"""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Self

from pydantic import field_validator, model_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Name, NotNegative, Positive, read_document

# By what the test functions call their results; the index that standards write after them (":0:Tact.AArm") is left out.
SYMBOLS = (
    "P_Size.Sph.1x25",
    "P_Form.Sph.1x25",
    "L_Dia.5x5",
    "E_Uni",
    "E_Bi",
    "EffectiveDiameter",
    "SPAT.Max",
    "SPAT.2s",
    "Volumetric.Max",
    "Volumetric.2s",
    "Volumetric.2RMS",
)

# Less is in another unit: a limit of an arm [um], a K [mm/um] (1 is a millimetre a metre), a measuring range [mm].
LEAST_UM = 0.5
LEAST_K = 1.0
LEAST_RANGE_MM = 100.0


class Limit(Document):
    """A maximum permissible error or limit.

    Attributes
    ----------
    A_um : float
        [um]
    K_mm_per_um : float
        The length in mm over K is in um.
    B_um : float
        [um]
    """

    A_um: NotNegative | None = None
    K_mm_per_um: Positive | None = None
    B_um: Positive | None = None

    @model_validator(mode="after")
    def _one_of_the_forms(self) -> Self:
        if (self.A_um is None) != (self.K_mm_per_um is None):
            raise InputError("A_um and K_mm_per_um belong together", hint="B_um alone for a limit without a length")
        if self.A_um is None and self.B_um is None:
            raise InputError("expected B_um, or A_um and K_mm_per_um, or all three; got none of them")
        for name, given in (("A_um", self.A_um), ("B_um", self.B_um)):
            if given is not None and 0 < given < LEAST_UM:
                raise InputError(
                    f"expected {name} in micrometres, got {given:g}, which no arm keeps", hint="0.015 mm are 15"
                )
        if self.K_mm_per_um is not None and self.K_mm_per_um < LEAST_K:
            raise InputError(
                f"expected K_mm_per_um, millimetres of length for a micrometre, got {self.K_mm_per_um:g}",
                hint="for L/80 it is 80; for 12.5 um a metre 80 too",
            )
        return self

    def at(self, length_mm: float | None) -> float:
        """The limit [mm] of a length; of a test without a length where that is None.

        Raises
        ------
        InputError
            If the limit needs a length and there is none.
        """
        among = [] if self.B_um is None else [self.B_um]
        if self.A_um is not None and self.K_mm_per_um is not None:
            if length_mm is None:
                raise InputError("this test has no length: its limit is B_um alone, not A_um + L / K_mm_per_um")
            among.append(self.A_um + length_mm / self.K_mm_per_um)
        return min(among) / 1000


class Specification(Document):
    """An arm's specification.

    Attributes
    ----------
    name, source : str
        The arm, and where the numbers come from.
    measuring_range_mm : float
        Diameter of its spherical reach [mm].
    corrected_to_20_degC : bool
        Whether the limits hold for lengths corrected to 20 degC for the artefact's temperature; as usual.
    limits : dict of str to Limit
        By symbol.
    """

    name: Name
    source: Name
    measuring_range_mm: Positive
    corrected_to_20_degC: bool = True
    limits: dict[str, Limit]

    @field_validator("measuring_range_mm")
    @classmethod
    def _in_mm(cls, given: float) -> float:
        if given < LEAST_RANGE_MM:
            raise InputError(f"expected the diameter of the reach in mm, got {given:g}", hint="2.5 m are 2500")
        return given

    @field_validator("limits", mode="before")
    @classmethod
    def _in_quotes(cls, limits: object) -> object:
        """To TOML a symbol with a dot is a table in a table, unless it stands in quotes."""
        for key, table in limits.items() if isinstance(limits, dict) else ():
            symbol = str(key)
            while inner := [(k, t) for k, t in table.items() if isinstance(t, dict)] if isinstance(table, dict) else []:
                symbol, table = f"{symbol}.{inner[0][0]}", inner[0][1]
            if symbol != key:
                raise InputError(f"{symbol:.80} stands without quotes", hint=f'"{symbol:.80}" = {{ .. }}')
        return limits

    @field_validator("limits")
    @classmethod
    def _known_symbols(cls, limits: dict[str, Limit]) -> dict[str, Limit]:
        found: dict[str, Limit] = {}
        for written, limit in limits.items():
            symbol = written.partition(":")[0]
            if symbol not in SYMBOLS:
                close = difflib.get_close_matches(symbol, SYMBOLS, n=1)
                raise InputError(f"unknown symbol {written!r:.80}", hint=close[0] if close else ", ".join(SYMBOLS))
            if symbol in found:
                raise InputError(f"the limit of {symbol} stands twice")
            found[symbol] = limit
        return found

    def limit(self, symbol: str, length_mm: float | None = None) -> float | None:
        """The limit [mm] of a symbol, at a length where it has one; None where none is stated."""
        stated = self.limits.get(symbol)
        try:
            return None if stated is None else stated.at(length_mm)
        except InputError as error:
            raise InputError(f"limits.{symbol}: {error.problem}") from None


def read_specification(path: str | Path) -> Specification:
    """Read a file of limits.

    Raises
    ------
    InputError
        If the file is missing or breaks a rule of its format.
    """
    return read_document(path, Specification)


def example_specification(measuring_range_mm: float) -> Specification:
    """Return example limits, chosen here and proportional to the measuring range."""
    share = measuring_range_mm / 2500.0
    micrometres = {
        "P_Size.Sph.1x25": 25.0,
        "P_Form.Sph.1x25": 40.0,
        "L_Dia.5x5": 50.0,
        "E_Uni": 60.0,
        "E_Bi": 70.0,
        "EffectiveDiameter": 25.0,
        "SPAT.Max": 40.0,
        "SPAT.2s": 50.0,
        "Volumetric.Max": 60.0,
        "Volumetric.2s": 60.0,
        "Volumetric.2RMS": 60.0,
    }
    return Specification(
        name=f"example, measuring range {measuring_range_mm:.5g} mm",
        source="example limits of truearm",
        measuring_range_mm=measuring_range_mm,
        limits={symbol: Limit(B_um=round(share * limit, 1)) for symbol, limit in micrometres.items()},
    )
