"""The performance tests of ASME B89.4.22 for articulated arms with contact probes, one function each.

The text of the standard was not available: published abstracts confirm its three tests, their evaluation is recalled.
The numbers of points, positions and runs are in the test plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.verification.standards.artefacts import Seat
from truearm.verification.standards.decision import (
    Budget,
    ConformityResult,
    DecisionRule,
    assess_conformity,
    worst_result,
)
from truearm.verification.standards.measurands import LengthMeasurement, SphereMeasurement, worst_size_error
from truearm.verification.standards.specification import Specification


@dataclass(frozen=True, eq=False)
class SeatPoints:
    """Points of the tip's centre in one seat, with joint angles as different as possible.

    Attributes
    ----------
    seat : Seat
    points : (n, 3) array
        [mm]
    where : str
        The zone or position, as text.
    """

    seat: Seat
    points: FloatArray
    where: str = ""


def effective_diameter(
    runs: Sequence[SphereMeasurement], specification: Specification, *, rule: DecisionRule = "iso14253-1:2017"
) -> ConformityResult:
    """Effective diameter: the largest deviation of a run's least-squares diameter from the calibrated one.

    Recalled, not confirmed: nine points a run, three runs, the largest ``|D_i - D_cal|`` counts.

    Parameters
    ----------
    runs : sequence of SphereMeasurement
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}
    """
    return worst_size_error("EffectiveDiameter", runs, specification, rule=rule)


def single_point(
    seats: Sequence[SeatPoints], specification: Specification, *, rule: DecisionRule = "iso14253-1:2017"
) -> list[ConformityResult]:
    """Single-point articulation: distances of the points in one seat from their mean.

    With ``d_i = |p_i - mean p|``: the largest, and twice ``s = sqrt(sum d_i^2 / (n - 1))``. Recalled, not confirmed:
    the divisor of s, ten points a seat. The half range of each coordinate is a maker's field test (FARO's maintenance
    pages) and is printed too, without a limit.

    The uncertainty of all three is that of form and fixture of the seat, once. If the seat moves by u_fixture in each
    direction at each point, the largest and 2s change by about that (0.9 to 1.0 times u_fixture rms by simulation, for
    ten points of an arm that scatters more than the fixture); if it does not move, they change less.

    Parameters
    ----------
    seats : sequence of SeatPoints
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}

    Returns
    -------
    list of ConformityResult
        Three rows for each seat.

    Raises
    ------
    InputError
        If a seat has fewer than two points.
    """
    rows = []
    for one in seats:
        if len(one.points) < 2:
            raise InputError(
                f"{one.where}: expected two points or more in a seat, got {len(one.points)}",
                hint="measure more points in the seat",
            )
        away = one.points - one.points.mean(axis=0)
        distance = np.sqrt((away**2).sum(axis=1))
        s = np.sqrt((distance**2).sum() / (len(away) - 1))
        half = np.ptp(one.points, axis=0).max() / 2
        budget = Budget(one.seat.form_and_fixture())
        for label, symbol, value in (
            ("SPAT.Max", "SPAT.Max", distance.max()),
            ("SPAT.2s", "SPAT.2s", 2 * s),
            ("SPAT, half range of the worst coordinate", None, half),
        ):
            limit = None if symbol is None else specification.limit(symbol)
            rows.append(assess_conformity(label, float(value), budget, limit, rule=rule, where=one.where))
    return rows


def volumetric(
    lengths: Sequence[LengthMeasurement], specification: Specification, *, rule: DecisionRule = "iso14253-1:2017"
) -> list[ConformityResult]:
    """Volumetric performance: deviations of a bar's lengths throughout the volume.

    With ``D_j = L_j - L_cal,j``: the largest magnitude; ``2 s`` about their mean, divisor n - 1; ``2 RMS`` about zero,
    divisor n, which contains the scale error; their range and mean, which have no limit. Recalled, not
    confirmed: the divisors, two lengths, twenty positions in all.

    The uncertainty of 2s, 2RMS, range and mean is that of the most uncertain single deviation, times 2 for the first
    two: an upper bound.

    Parameters
    ----------
    lengths : sequence of LengthMeasurement
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}

    Raises
    ------
    InputError
        If there are fewer than two lengths.
    """
    if len(lengths) < 2:
        raise InputError(f"expected two measured lengths or more, got {len(lengths)}", hint="measure more lengths")
    corrected = specification.corrected_to_20_degC
    deviation = np.array([one.error(opposite=False, corrected=corrected) for one in lengths])
    budgets = [one.budget(corrected=corrected) for one in lengths]
    largest = worst_result(
        [
            assess_conformity(
                "Volumetric.Max",
                float(value),
                budget,
                specification.limit("Volumetric.Max", one.length.length_mm),
                rule=rule,
                where=f"{one.length.name}, {one.where}",
            )
            for one, value, budget in zip(lengths, deviation, budgets, strict=True)
        ]
    )
    widest = max(budgets, key=lambda budget: budget.expanded)
    twice = Budget(tuple(replace(one, u=2 * one.u) for one in widest.contributions))
    rows = [largest]
    for symbol, value in (
        ("Volumetric.2s", 2 * deviation.std(ddof=1)),
        ("Volumetric.2RMS", 2 * np.sqrt((deviation**2).mean())),
    ):
        rows.append(assess_conformity(symbol, float(value), twice, specification.limit(symbol), rule=rule))
    rows.append(assess_conformity("Volumetric, range", float(np.ptp(deviation)), widest, None, rule=rule))
    rows.append(assess_conformity("Volumetric, mean", float(deviation.mean()), widest, None, rule=rule))
    return rows
