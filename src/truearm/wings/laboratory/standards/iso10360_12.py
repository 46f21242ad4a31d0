"""The tactile tests of ISO 10360-12 for articulated arms, one function each.

The text of the standard was not available; each function states its sources. The numbers of points, positions and runs
are in the test plan (`verification_plan`) and checked by `point_checks`; the functions accept any numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truearm.wings.laboratory.shapes.minimum_zone import circumscribed_diameters
from truearm.wings.laboratory.standards.decision import (
    Budget,
    ConformityResult,
    DecisionRule,
    Verdict,
    assess_conformity,
    worst_result,
)
from truearm.wings.laboratory.standards.measurands import LengthMeasurement, SphereMeasurement, worst_size_error
from truearm.wings.laboratory.standards.propagation import ErrorSource, drawn_budget, farthest_pair
from truearm.wings.laboratory.standards.specification import Specification


def p_size(
    spheres: Sequence[SphereMeasurement], specification: Specification, *, rule: DecisionRule = "iso14253-1:2017"
) -> ConformityResult:
    """Probing size error P_Size.Sph.1x25: diameter of the least-squares sphere less the calibrated one.

    The worst position counts. Source: Kreon's page on ISO 10360-12 (25 points, least-squares sphere, two
    positions, the worse one counts). Not confirmed: the sign, the permitted diameters of the sphere.

    Parameters
    ----------
    spheres : sequence of SphereMeasurement
        One for each position.
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}

    Returns
    -------
    ConformityResult
    """
    return worst_size_error("P_Size.Sph.1x25", spheres, specification, rule=rule)


def p_form(
    spheres: Sequence[SphereMeasurement], specification: Specification, *, rule: DecisionRule = "iso14253-1:2017"
) -> ConformityResult:
    """Probing form error P_Form.Sph.1x25: thickness of the least-squares shell with all points.

    The worst position counts. Source: Kreon's page on ISO 10360-12, in these words. Arguments as `p_size`.
    """
    limit = specification.limit("P_Form.Sph.1x25")
    return worst_result(
        [
            assess_conformity("P_Form.Sph.1x25", one.fit.form_mm, one.form_budget, limit, rule=rule, where=one.where)
            for one in spheres
        ]
    )


def l_dia(
    positions: Sequence[Sequence[SphereMeasurement]],
    specification: Specification,
    *,
    rule: DecisionRule = "iso14253-1:2017",
) -> list[ConformityResult]:
    """Articulated location error L_Dia.5x5: diameter of the smallest sphere that contains the centres of the groups.

    Each group's sphere is fitted with a free radius. Source: Kreon's page on ISO 10360-12 (five groups of five points,
    one direction of the stylus in each group). Not confirmed: minimum circumscribed sphere, number of positions.

    Parameters
    ----------
    positions : sequence of sequence of SphereMeasurement
        The groups of each position of the sphere.
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}

    Returns
    -------
    list of ConformityResult
        L_Dia of the worst position, and the largest distance between two centres there, which some programs print; it
        is never larger and has no limit.
    """
    limit = specification.limit("L_Dia.5x5")
    rows: list[ConformityResult] = []
    secondary: list[ConformityResult] = []
    for groups in positions:
        centres = np.stack([one.fit.centre for one in groups])
        where, sources = groups[0].where, _centre_sources(groups)
        for label, statistic, bound, into in (
            ("L_Dia.5x5", circumscribed_diameters, limit, rows),
            ("L_Dia.5x5, largest distance", farthest_pair, None, secondary),
        ):
            budget = drawn_budget(centres, statistic, sources)
            into.append(assess_conformity(label, float(statistic(centres)), budget, bound, rule=rule, where=where))
    worst = worst_result(rows)
    beside = secondary[rows.index(worst)]
    return [worst, replace(beside, individual=tuple(secondary))]


def _centre_sources(groups: Sequence[SphereMeasurement]) -> list[ErrorSource]:
    """What the sphere does to the centres of its groups: it may move between them, and its form moves each fit."""
    n = len(groups)
    alike = zip(*(one.centre_sources() for one in groups), strict=True)
    form = [
        ErrorSource(
            same[0].label,
            np.concatenate([np.einsum("kc,n->knc", one.effects, at) for one, at in zip(same, np.eye(n), strict=True)]),
        )
        for same in alike
    ]
    return [*form, groups[0].sphere.fixture_source((n, 3))]


def length_errors(
    lengths: Sequence[LengthMeasurement],
    specification: Specification,
    *,
    repeats: int = 3,
    tolerated_sets: int = 0,
    rule: DecisionRule = "iso14253-1:2017",
) -> list[ConformityResult]:
    """Length measurement errors E_Uni or E_Bi: measured less calibrated length.

    E_Uni has its ends touched from the same side: ball centre to ball centre, seat to seat, or between faces
    approached from the same side; the error of the stylus tip cancels. E_Bi has faces touched from opposite sides, and
    contains the error of the stylus tip. With three or more points on a face, its distance is that along the normal of
    their least-squares plane; with one on each, the budget contains their alignment. Source: ISO 10360-2's structure;
    not confirmed that part 12 has its lengths, positions and repeats, nor its tolerance of single values.

    Parameters
    ----------
    lengths : sequence of LengthMeasurement
        All of one symbol.
    specification : Specification
    repeats : int
        Number of runs in a set.
    tolerated_sets : int
        Number of sets (one length at one position) in which a single value may not conform, if the set is measured
        again; the second set counts then.
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}

    Returns
    -------
    list of ConformityResult
        One row for each length, the worst of its positions and repeats; and the number of sets measured again, if any
        is tolerated.
    """
    corrected = specification.corrected_to_20_degC

    def row(one: LengthMeasurement) -> ConformityResult:
        return assess_conformity(
            f"{one.symbol}, {one.length.name}",
            one.error(corrected=corrected),
            one.budget(corrected=corrected),
            specification.limit(one.symbol, one.length.length_mm),
            rule=rule,
            where=one.where,
        )

    sets: dict[tuple[str, ...], list[ConformityResult]] = {}
    for one in sorted(lengths, key=lambda one: int(one.repeat) if one.repeat.isdecimal() else 0):
        sets.setdefault((one.bar.name, one.length.name, one.position), []).append(row(one))
    again = 0
    counted: dict[tuple[str, ...], list[ConformityResult]] = {}
    measured: dict[tuple[str, ...], list[ConformityResult]] = {}
    for key, rows in sets.items():
        first, second = rows[:repeats], rows[repeats:]
        outside = sum(one.verdict not in (Verdict.CONFORM, None) for one in first)
        if outside == 1 and len(second) == repeats and again < tolerated_sets:
            first, second, again = second, [], again + 1
        counted.setdefault(key[:2], []).extend(first + second)
        measured.setdefault(key[:2], []).extend(rows)  # with the sets that were measured again and do not count
    results = [replace(worst_result(rows), individual=tuple(measured[key])) for key, rows in counted.items()]
    if tolerated_sets:
        label = f"{lengths[0].symbol}, sets measured again"
        results.append(ConformityResult(label, again, "", Budget(), None, None, f"of {len(sets)}"))
    return results
