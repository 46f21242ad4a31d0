"""Thermal expansion of artefacts: certificates state lengths at 20 degC, readings find them as warm as they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.readings.lengths import Lengths
from truearm.readings.readings import BoolArray, FloatArray, NameArray

REFERENCE_DEGC = 20.0
"""Temperature at which lengths are stated (ISO 1)."""

ARTEFACT_U_K = 0.5
"""Standard uncertainty by which an artefact has not the temperature that the session states [K].

That is the arm's. An artefact that lay beside it for some hours is taken to be within a kelvin of it.
"""

STEEL_PER_K = 1.15e-5
"""Thermal expansion of steel [1/K], of which most artefacts are."""


@dataclass(frozen=True, eq=False)
class Growth:
    """How much longer artefacts are where they stand than at 20 degC.

    Attributes
    ----------
    known : (m,) bool array
        Whether the expansion of the artefact and the temperature at its readings are known; nothing grows else.
    factor : (m,) array
        ``1 + alpha (T - 20 degC)``.
    u_temperature : (m,) array
        Its standard uncertainty from the artefact's temperature, which is not quite that at the readings.
    u_expansion : (m,) array
        Its standard uncertainty from the coefficient (GUM H.1.3).
    """

    known: BoolArray
    factor: FloatArray
    u_temperature: FloatArray
    u_expansion: FloatArray


def growth_at(lengths: Lengths, temperature_degC: npt.ArrayLike) -> Growth:
    """How much longer lengths are at temperatures (m,) of their artefacts [degC], or at one of all; NaN: not known."""
    m = len(lengths)
    warmer = np.broadcast_to(np.asarray(temperature_degC, dtype=float) - REFERENCE_DEGC, m)
    if lengths.expansion_per_K is None or lengths.u_expansion_per_K is None:
        return Growth(np.zeros(m, dtype=bool), np.ones(m), np.zeros(m), np.zeros(m))
    known = np.isfinite(lengths.expansion_per_K) & np.isfinite(warmer)
    expansion, u_expansion, warmer = np.where(known, [lengths.expansion_per_K, lengths.u_expansion_per_K, warmer], 0.0)
    return Growth(known, 1 + expansion * warmer, np.abs(expansion) * ARTEFACT_U_K, u_expansion * np.abs(warmer))


def growth_of(lengths: Lengths, seat: NameArray, temperature_degC: FloatArray | None) -> Growth:
    """How much longer lengths are at the mean temperature of the readings in their two seats.

    Parameters
    ----------
    lengths : Lengths
        Each has readings in both of its seats.
    seat : (n,) array of str
        The seat of each reading; empty where there is none.
    temperature_degC : (n,) array or None
        Temperature at each reading.
    """
    if lengths.expansion_per_K is None or temperature_degC is None:
        return growth_at(lengths, np.nan)
    ends = zip(lengths.seat_a, lengths.seat_b, strict=True)
    return growth_at(lengths, [temperature_degC[(seat == a) | (seat == b)].mean() for a, b in ends])
