"""The tests of a plan: groups of points are checked and handed to the functions of the standards.

Where two bars of the same nominal length may have been exchanged, odds state which certificate the lengths fit.

An arm's error of scale makes all lengths too long or too short alike, and does not change how two bars differ. So of
two measured bars the odds are those of Student's t for the difference of their mean deviations, as named and exchanged,
with the scatter from position to position. If another bar of the file was measured in place of the one that the points
name, they come from the deviations against the limit, taken as two standard deviations with few degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import hypot, log1p

import numpy as np

from truearm.acceptance import contradict
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards import asme_b89_4_22, blunders, iso10360_12
from truearm.wings.laboratory.standards.artefacts import Artefacts, CalibratedBar, CalibratedLength
from truearm.wings.laboratory.standards.decision import ConformityResult, DecisionRule, Verdict
from truearm.wings.laboratory.standards.measurands import LengthMeasurement
from truearm.wings.laboratory.standards.measured_points import PointGroup
from truearm.wings.laboratory.standards.point_checks import SAME_PLACE_MM, PointChecks, sphere_centres, split_groups
from truearm.wings.laboratory.standards.specification import Specification
from truearm.wings.laboratory.standards.verification_plan import (
    Articulation,
    EffectiveDiameter,
    LengthTest,
    PlannedTest,
    Probing,
    SinglePoint,
    Volumetric,
)

# Calibrated lengths that differ by less than this share have the same nominal length.
SAME_NOMINAL = 1e-3
# Chosen here: bars are exchanged where that explains the lengths this many times better.
ODDS = 1e5
# Degrees of freedom of a limit as a measure of an arm's errors: with 9, these odds begin at 4.5 times the limit.
LIMIT_DOF = 9.0


def exchanged_bars(
    lengths: Sequence[LengthMeasurement], artefacts: Artefacts, specification: Specification
) -> tuple[str, str, float] | None:
    """Return two bars whose exchange explains measured lengths `ODDS` times better or more, and the odds.

    Parameters
    ----------
    lengths : sequence of LengthMeasurement
        Those of one test.
    artefacts : Artefacts
    specification : Specification

    Returns
    -------
    (str, str, float) or None
        The bar that the points name, the one whose certificate fits, and the odds.
    """
    of_bar: dict[str, list[LengthMeasurement]] = {}
    for one in lengths:
        of_bar.setdefault(one.bar.name, []).append(one)

    best: tuple[str, str, float] | None = None
    for name, measured in of_bar.items():
        for other in artefacts.bars:
            theirs = of_bar.get(other.name)
            by_other = _deviations_by(other, measured, specification, in_limits=theirs is None)
            if other.name == name or by_other is None:
                continue
            if theirs is not None:
                back = _deviations_by(measured[0].bar, theirs, specification, in_limits=False)
                odds = 1.0 if back is None else _odds_of_two(by_other, back, measured[0], theirs[0])
            else:
                as_named, exchanged = by_other.mean(axis=0)
                odds = _odds(as_named, exchanged, LIMIT_DOF)
            if odds >= ODDS and (best is None or odds > best[2]):
                best = name, other.name, odds
    return best


def _deviations_by(
    other: CalibratedBar, measured: Sequence[LengthMeasurement], specification: Specification, *, in_limits: bool
) -> FloatArray | None:
    """Mean deviation at each position as named, and by another certificate (n, 2) [mm]; None: other lengths.

    With `in_limits` in units of half the limit; None where there is none.
    """
    places: dict[str, list[tuple[float, float]]] = {}
    for one in measured:
        there = _same_nominal(one.length, other)
        unit = (specification.limit(one.symbol, one.length.length_mm) or 0.0) / 2 if in_limits else 1.0
        unaligned = one.opposite and other.u_alignment_mm is None and one.bar.u_alignment_mm is not None
        if there is None or not unit or unaligned:
            return None
        both = (one, replace(one, bar=other, length=there))
        own, fits = (each.error(corrected=specification.corrected_to_20_degC) for each in both)
        sign = np.sign(there.length_mm - one.length.length_mm)  # lengths may differ either way
        places.setdefault(one.position, []).append((sign * own / unit, sign * fits / unit))
    return np.array([np.mean(at, axis=0) for at in places.values()])


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


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The evaluation of a test of a verification.

    Attributes
    ----------
    checks : PointChecks
        Of the test; suspected blunders and exchanged ends become remarks of it.
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}
    """

    checks: PointChecks
    specification: Specification
    rule: DecisionRule

    def rows(self, test: PlannedTest) -> list[ConformityResult]:
        """Evaluate the test; return its test values with their verdicts."""
        rows, blunders_of = self._evaluate(test)
        # Only where a value does not conform, and the points come from a file.
        if self.checks.measured.file is not None and any(row.verdict not in (Verdict.CONFORM, None) for row in rows):
            self.checks.remarks.extend(blunders_of)
        self.checks.check_in_range()
        return rows

    def _evaluate(self, test: PlannedTest) -> tuple[list[ConformityResult], Iterable[str]]:
        """The test values, and the blunders that are suspected: they are looked for as they are asked for."""
        if isinstance(test, Probing | EffectiveDiameter):
            return self._sizes(test)
        if isinstance(test, Articulation):
            return self._articulation(test)
        if isinstance(test, SinglePoint):
            return self._single_point(test)
        assert isinstance(test, LengthTest | Volumetric)
        return self._lengths(test)

    def _sizes(self, test: Probing | EffectiveDiameter) -> tuple[list[ConformityResult], Iterable[str]]:
        checks = self.checks
        key, planned = ("position", test.positions) if isinstance(test, Probing) else ("repeat", test.repeats)
        checks.split(key, planned.value)
        spheres = [checks.sphere(group, test) for group in checks.groups]
        checks.check_no_copies()
        if isinstance(test, Probing):
            checks.check_apart(checks.groups, sphere_centres(spheres), spheres[0].sphere.diameter_mm)
            size = iso10360_12.p_size(spheres, self.specification, rule=self.rule)
            rows = [size, iso10360_12.p_form(spheres, self.specification, rule=self.rule)]
        else:
            rows = [asme_b89_4_22.effective_diameter(spheres, self.specification, rule=self.rule)]
        return rows, blunders.on_spheres(checks.name, checks.groups, spheres, rows[0])

    def _articulation(self, test: Articulation) -> tuple[list[ConformityResult], Iterable[str]]:
        checks = self.checks
        positions = checks.split("position", test.positions.value)
        measured = []
        for position, members in positions.items():
            what = f"groups at position {position}"
            checks.check_count(members[0], what, split_groups(members, "group"), test.groups.value)
            spheres = [checks.sphere(group, test, where=f"position {position}") for group in members]
            reach = spheres[0].sphere.diameter_mm
            for group, one in zip(members, spheres, strict=True):
                away = float(((one.fit.centre - spheres[0].fit.centre) ** 2).sum() ** 0.5)
                if away > reach:
                    raise checks.error(
                        f"the sphere is {away:.4g} mm away from that of the first group, more than its diameter",
                        group,
                        "measure all groups of a position on one sphere that stays in place",
                    )
            measured.append(spheres)
        checks.check_no_copies()
        firsts = [members[0] for members in positions.values()]
        checks.check_apart(firsts, sphere_centres([one[0] for one in measured]), measured[0][0].sphere.diameter_mm)
        rows = iso10360_12.l_dia(measured, self.specification, rule=self.rule)
        found = (blunders.in_groups(checks.name, *at) for at in zip(positions.values(), measured, strict=True))
        return rows, chain.from_iterable(found)

    def _single_point(self, test: SinglePoint) -> tuple[list[ConformityResult], Iterable[str]]:
        checks, groups = self.checks, self.checks.groups
        checks.split("position", test.positions.value)
        seats = []
        for group in groups:
            checks.check_points(group, test.points.value)
            checks.check_not_frozen(group)
            seat = checks.artefact(checks.artefacts.seat, group)
            seats.append(asme_b89_4_22.SeatPoints(seat, group.points, group.where))
        checks.check_no_copies()
        checks.check_apart(groups, np.array([[group.points.mean(axis=0)] for group in groups]), SAME_PLACE_MM)
        checks.check_seats_spread(test.spread_share.value)
        rows = asme_b89_4_22.single_point(seats, self.specification, rule=self.rule)
        return rows, blunders.in_seats(checks.name, groups)

    def _lengths(self, test: LengthTest | Volumetric) -> tuple[list[ConformityResult], Iterable[str]]:
        checks, groups = self.checks, self.checks.groups
        pairs = checks.lengths()
        lengths = [one for one, _ in pairs]
        by_length, positions = split_groups(groups, "artefact", "length"), test.positions.value
        checks.check_count(groups[0], "lengths", by_length, test.lengths.value)
        if isinstance(test, LengthTest):
            self._check_repeats(test, by_length.values())
        else:  # positions are planned in all
            checks.check_count(groups[0], "measured lengths", len(pairs), positions)
            positions //= test.lengths.value
        checks.check_bars_apart(min(test.directions.value, positions))
        if isinstance(test, LengthTest):
            checks.check_bars_stay(pairs)
        checks.check_sizes(test, lengths)
        self._check_bars_not_exchanged(pairs)
        if isinstance(test, LengthTest):
            sets = {"repeats": test.repeats.value, "tolerated_sets": test.tolerated_sets.value}
            rows = iso10360_12.length_errors(lengths, self.specification, **sets, rule=self.rule)
        else:
            rows = asme_b89_4_22.volumetric(lengths, self.specification, rule=self.rule)
        return rows, blunders.in_lengths(pairs, self.specification)

    def _check_repeats(self, test: LengthTest, by_length: Iterable[list[PointGroup]]) -> None:
        """Check that each length was measured at as many positions, and there as often, as planned."""
        repeats = test.repeats.value
        for members in by_length:
            what = f"positions of length {members[0].keys['length']}"
            by_position = split_groups(members, "position")
            self.checks.check_count(members[0], what, by_position, test.positions.value)
            for at in by_position.values():
                runs = sorted(int(str(repeat)) for repeat in split_groups(at, "repeat"))
                whole = list(range(1, repeats + 1))
                again = list(range(1, 2 * repeats + 1)) if test.tolerated_sets.value else whole
                if runs not in (whole, again):
                    raise self.checks.error(
                        f"expected repeats 1 to {repeats}, got {', '.join(map(str, runs))}",
                        at[0],
                        "measure the missing repeats, and number them 1, 2, ..",
                        where=f"length {at[0].keys['length']}, position {at[0].keys['position']}",
                    )

    def _check_bars_not_exchanged(self, pairs: Sequence[tuple[LengthMeasurement, PointGroup]]) -> None:
        """Refuse lengths that another bar of the same nominal length explains by far better."""
        lengths, artefacts = [one for one, _ in pairs], self.checks.artefacts
        if self.checks.measured.file is None or len(artefacts.bars) < 2:
            return
        found = exchanged_bars(lengths, artefacts, self.specification)
        if found is not None:
            named, fits, odds = found
            problem = (
                f"{lengths[0].symbol}: the lengths measured on {named!r} are those of {fits!r} by the certificates: "
                f"exchanged bars explain them better, with odds of {odds:.1g} to 1"
            )
            first = next(group for one, group in pairs if one.bar.name == named)
            hint = (
                "compare the serial numbers on the bars with their certificates (column artefact_serial_number), and "
                "correct the column artefact or the calibrated lengths"
            )
            contradict(self.checks.measured.error(problem, first, hint=hint))
