"""Two bars of the same nominal length that were exchanged: which certificate the measured lengths fit, with odds.

An arm's error of scale makes all lengths too long or too short alike, and does not change how two bars differ. So of
two measured bars the odds are those of Student's t for the difference of their mean deviations, as named and exchanged,
with the scatter from position to position. If another bar of the file was measured in place of the one that the points
name, they come from the deviations against the limit, taken as two standard deviations with few degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import hypot, log1p

import numpy as np

from truearm.typing import FloatArray
from truearm.verification.standards.artefacts import Artefacts, CalibratedBar, CalibratedLength
from truearm.verification.standards.measurands import LengthMeasurement
from truearm.verification.standards.specification import Specification

# Calibrated lengths that differ by less than this share have the same nominal length.
SAME_NOMINAL = 1e-3
# Chosen here: bars are exchanged where that explains the lengths this many times better.
ODDS = 1e5
# Degrees of freedom of a limit as a measure of an arm's errors: with 9, these odds begin at 4.5 times the limit.
LIMIT_DOF = 9.0


def exchanged_bars(
    lengths: Sequence[LengthMeasurement],
    artefacts: Artefacts,
    specification: Specification,
    symbol: str,
    *,
    opposite: bool,
) -> tuple[str, str, float] | None:
    """Return two bars whose exchange explains measured lengths `ODDS` times better or more, and the odds.

    Parameters
    ----------
    lengths : sequence of LengthMeasurement
        Those of one test.
    artefacts : Artefacts
    specification : Specification
    symbol : str
        Of the limit.
    opposite : bool
        Whether the ends are faces touched from opposite sides.

    Returns
    -------
    (str, str, float) or None
        The bar that the points name, the one whose certificate fits, and the odds.
    """
    corrected = specification.corrected_to_20_degC
    of_bar: dict[str, list[LengthMeasurement]] = {}
    for one in lengths:
        of_bar.setdefault(one.bar.name, []).append(one)

    def deviations(measured: Sequence[LengthMeasurement], other: CalibratedBar) -> FloatArray | None:
        """Mean deviation at each position as named, and by the other certificate (n, 2) [mm]; None: other lengths.

        Where the other bar was not measured, in units of half the limit; None without a limit.
        """
        places: dict[str, list[tuple[float, float]]] = {}
        for one in measured:
            there = _same_nominal(one.length, other)
            limit = specification.limit(symbol, one.length.length_mm)
            unit = 1.0 if other.name in of_bar else (limit or 0.0) / 2
            unaligned = opposite and other.u_alignment_mm is None and one.bar.u_alignment_mm is not None
            if there is None or not unit or unaligned:
                return None
            both = (one, replace(one, bar=other, length=there))
            own, fits = (each.error(opposite=opposite, corrected=corrected) for each in both)
            sign = np.sign(there.length_mm - one.length.length_mm)  # lengths may differ either way
            places.setdefault(one.position, []).append((sign * own / unit, sign * fits / unit))
        return np.array([np.mean(at, axis=0) for at in places.values()])

    best: tuple[str, str, float] | None = None
    for name, measured in of_bar.items():
        for other in artefacts.bars:
            if other.name == name or (by_other := deviations(measured, other)) is None:
                continue
            if other.name in of_bar:
                back = deviations(of_bar[other.name], measured[0].bar)
                odds = 1.0 if back is None else _odds_of_two(by_other, back, measured[0], of_bar[other.name][0])
            else:
                as_named, exchanged = by_other.mean(axis=0)
                odds = _odds(as_named, exchanged, LIMIT_DOF)
            if odds >= ODDS and (best is None or odds > best[2]):
                best = name, other.name, odds
    return best


def _same_nominal(length: CalibratedLength, other: CalibratedBar) -> CalibratedLength | None:
    """The length of another bar with the same nominal value and another calibrated one."""
    nearest = min(other.lengths, key=lambda one: abs(one.length_mm - length.length_mm))
    off = abs(nearest.length_mm - length.length_mm)
    return nearest if 0 < off <= SAME_NOMINAL * length.length_mm else None


def _odds_of_two(first: FloatArray, second: FloatArray, one: LengthMeasurement, other: LengthMeasurement) -> float:
    """Odds of two measured bars: their deviations have opposite signs where they are exchanged, and none else."""
    dof = len(first) + len(second) - 2
    if dof < 1:
        return 1.0
    scatter = sum(((each[:, 0] - each[:, 0].mean()) ** 2).sum() for each in (first, second)) / dof
    u = hypot(one.length.u_mm, other.length.u_mm, one.bar.u_fixture_mm, other.bar.u_fixture_mm)
    spread = np.sqrt(scatter * (1 / len(first) + 1 / len(second)) + u**2)
    as_named, exchanged = (first.mean(axis=0) + second.mean(axis=0)) / spread
    return _odds(as_named, exchanged, dof)


def _odds(as_named: float, exchanged: float, dof: float) -> float:
    """Ratio of the densities of Student's t at two normalized deviations."""
    return float(np.exp(min((dof + 1) / 2 * (log1p(as_named**2 / dof) - log1p(exchanged**2 / dof)), 700.0)))
