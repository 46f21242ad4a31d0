"""The performance tests of ASME B89.4.22 for articulated arms with contact probes, one function each.

The text of the standard was not available: published abstracts confirm its three tests, their evaluation is recalled.
The numbers of points, positions and runs are in the test plan.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.artefacts import Seat
from truearm.wings.laboratory.standards.decision import ConformityResult, DecisionRule, assess_conformity, worst_result
from truearm.wings.laboratory.standards.measurands import (
    LengthMeasurement,
    SphereMeasurement,
    length_sources,
    worst_size_error,
)
from truearm.wings.laboratory.standards.propagation import (
    Statistic,
    drawn_budget,
    half_range,
    largest_distance,
    linear_budget,
    two_rms,
    two_s,
    two_s_of_points,
    value_range,
)
from truearm.wings.laboratory.standards.specification import Specification

SEAT_STATISTICS: Mapping[str, Statistic] = {
    "SPAT.Max": largest_distance,
    "SPAT.2s": two_s_of_points,
    "SPAT, half range of the worst coordinate": half_range,
}
"""Test values of the points in a seat."""

DEVIATION_STATISTICS: Mapping[str, Statistic] = {
    "Volumetric.2s": two_s,
    "Volumetric.2RMS": two_rms,
    "Volumetric, range": value_range,
}
"""Test values of the deviations of lengths."""


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

    The seat may move by u_fixture in each direction at each point, and its form puts the tip off: the uncertainty of
    each of the three is that of its own statistic (`decision`).

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
        shape = one.points.shape
        sources = [*one.seat.form_sources(shape), one.seat.fixture_source(shape)]
        for label, statistic in SEAT_STATISTICS.items():
            value, limit = float(statistic(one.points)), specification.limit(label)
            budget = drawn_budget(one.points, statistic, sources)
            rows.append(assess_conformity(label, value, budget, limit, rule=rule, where=one.where))
    return rows


def volumetric(
    lengths: Sequence[LengthMeasurement], specification: Specification, *, rule: DecisionRule = "iso14253-1:2017"
) -> list[ConformityResult]:
    """Volumetric performance: deviations of a bar's lengths throughout the volume.

    With ``D_j = L_j - L_cal,j``: the largest magnitude; ``2 s`` about their mean, divisor n - 1; ``2 RMS`` about zero,
    divisor n, which contains the scale error; their range and mean, which have no limit. Recalled, not
    confirmed: the divisors, two lengths, twenty positions in all.

    The uncertainty of each is that of its own statistic (`decision`); that of the largest is that of its reading.

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
    deviation = np.array([one.error(corrected=corrected) for one in lengths])
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
    sources = length_sources(lengths, corrected=corrected)
    rows = [largest]
    for symbol, statistic in DEVIATION_STATISTICS.items():
        budget = drawn_budget(deviation, statistic, sources)
        rows.append(
            assess_conformity(symbol, float(statistic(deviation)), budget, specification.limit(symbol), rule=rule)
        )
    mean = linear_budget(np.full(len(lengths), 1 / len(lengths)), sources)
    rows.append(assess_conformity("Volumetric, mean", float(deviation.mean()), mean, None, rule=rule))
    return rows
