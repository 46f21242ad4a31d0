"""Thermal expansion of artefacts: certificates state lengths at 20 degC, readings are made at other temperatures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt

from truearm.acceptance import contradict
from truearm.readings.lengths import Lengths
from truearm.readings.readings import Measurements
from truearm.typing import BoolArray, FloatArray, NameArray

REFERENCE_DEGC = 20.0
"""Temperature at which lengths are stated (ISO 1)."""

UNSTATED_U_K = 3.0
"""The same if the session states no temperature and 20 degC is assumed [K]: rooms of 15 to 25 degC, rectangular."""

STEEL_PER_K = 1.15e-5
"""Thermal expansion of steel [1/K], of which most artefacts are."""


@dataclass(frozen=True, eq=False)
class ThermalExpansion:
    """Expansion of artefacts at the temperature of the readings, relative to 20 degC.

    Attributes
    ----------
    known : (m,) bool array
        Whether the expansion of the artefact and the temperature at its readings are known; if not, its length is not
        changed.
    factor : (m,) array
        ``1 + alpha (T - 20 degC)``.
    u_temperature : (m,) array
        Its standard uncertainty from the artefact's temperature; 0 where no expansion is known.
    u_expansion : (m,) array
        Its standard uncertainty from the coefficient (GUM H.1.3).
    """

    # Calibrated artefacts are not used at other temperatures: such numbers have another unit.
    coldest_degC: ClassVar[float] = 0.0
    warmest_degC: ClassVar[float] = 45.0
    # Of an artefact's temperature if the session states that of the arm: an artefact that was beside the arm for some
    # hours is assumed to be within a kelvin of it.
    artefact_u_K: ClassVar[float] = 0.5
    known: BoolArray
    factor: FloatArray
    u_temperature: FloatArray
    u_expansion: FloatArray

    @property
    def u(self) -> FloatArray:
        """(m,) standard uncertainties of the factors."""
        return np.hypot(self.u_temperature, self.u_expansion)

    @classmethod
    def at(
        cls, lengths: Lengths, temperature_degC: npt.ArrayLike, u_temperature_K: npt.ArrayLike = artefact_u_K
    ) -> Self:
        """Expansion of lengths at temperatures (m,) of their artefacts [degC], or at one of all; NaN: not known.

        Raises
        ------
        InputError
            If a temperature of a length with a known expansion is not one of a workshop.
        """
        m = len(lengths)
        degC = np.broadcast_to(np.asarray(temperature_degC, dtype=float), m)
        if lengths.expansion_per_K is None or lengths.u_expansion_per_K is None:
            return cls(np.zeros(m, dtype=bool), np.ones(m), np.zeros(m), np.zeros(m))
        expands = np.isfinite(lengths.expansion_per_K)
        known = expands & np.isfinite(degC)
        if (wrong := known & ((degC < cls.coldest_degC) | (degC > cls.warmest_degC))).any():
            row = int(np.argmax(wrong))
            contradict(
                lengths.error(
                    f"expected the readings in its seats at {cls.coldest_degC:g} to {cls.warmest_degC:g} degC, "
                    f"got {degC[row]:.6g}",
                    row,
                    hint="state temperature_degC of the session in degC, not in K (less 273.15) or degrees Fahrenheit",
                )
            )
        expansion, u_expansion = np.where(expands, [lengths.expansion_per_K, lengths.u_expansion_per_K], 0.0)
        warmer = np.where(known, degC - REFERENCE_DEGC, 0.0)
        u_K = np.where(known, u_temperature_K, UNSTATED_U_K)
        return cls(known, 1 + expansion * warmer, np.abs(expansion) * u_K, u_expansion * np.abs(warmer))


def thermal_expansion_of(lengths: Lengths, seat: NameArray, temperature_degC: FloatArray | None) -> ThermalExpansion:
    """Expansion of lengths at the temperature of the readings in their two seats.

    The temperature of an artefact is the mean of its two ends; half their difference is its uncertainty.

    Parameters
    ----------
    lengths : Lengths
        Each has readings in both of its seats.
    seat : (n,) array of str
        The seat of each reading; empty if there is none.
    temperature_degC : (n,) array or None
        Temperature at each reading.

    Raises
    ------
    InputError
        As `ThermalExpansion.at`.
    """
    if lengths.expansion_per_K is None or temperature_degC is None:
        return ThermalExpansion.at(lengths, np.nan)
    ends = np.array(
        [[temperature_degC[seat == name].mean() for name in names] for names in (lengths.seat_a, lengths.seat_b)]
    )
    return ThermalExpansion.at(
        lengths, ends.mean(axis=0), np.hypot(ThermalExpansion.artefact_u_K, np.abs(ends[0] - ends[1]) / 2)
    )


def at_measured_temperature(lengths: Lengths, seat: NameArray, temperature_degC: FloatArray | None) -> Lengths:
    """Return lengths and their uncertainties at the temperature of the readings in their seats."""
    growth = thermal_expansion_of(lengths, seat, temperature_degC)
    return Lengths(
        lengths.seat_a,
        lengths.seat_b,
        lengths.length_mm * growth.factor,
        np.hypot(lengths.u_mm, lengths.length_mm * growth.u),
        u_place_mm=lengths.u_place_mm,
    )


def expanded_lengths(lengths: Lengths | None, session: Measurements) -> Lengths | None:
    """Lengths at the temperature of the readings in their seats."""
    if lengths is None or session.seat is None:
        return None
    return at_measured_temperature(lengths, session.seat, session.temperature_degC)
