"""The tests of a plan: groups of points are checked and handed to the functions of the standards.

Where two bars of the same nominal length may have been exchanged, odds state which certificate the lengths fit.

An arm's error of scale makes all lengths too long or too short alike, and does not change how two bars differ. So of
two measured bars the odds are those of Student's t for the difference of their mean deviations, as named and exchanged,
with the scatter from position to position. If another bar of the file was measured in place of the one that the points
name, they come from the deviations against the limit, taken as two standard deviations with few degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import hypot, log1p

import numpy as np

from truearm.acceptance import contradict
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards import asme_b89_4_22, blunders, iso10360_12
from truearm.wings.laboratory.standards.artefacts import Artefacts, CalibratedBar, CalibratedLength
from truearm.wings.laboratory.standards.decision import ConformityResult, DecisionRule, Verdict
from truearm.wings.laboratory.standards.measurands import LengthMeasurement
from truearm.wings.laboratory.standards.measured_points import MeasuredPoints, PointGroup
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
    of_bar: dict[str, list[LengthMeasurement]] = {}
    for one in lengths:
        of_bar.setdefault(one.bar.name, []).append(one)

    def deviations(measured: Sequence[LengthMeasurement], other: CalibratedBar) -> FloatArray | None:
        in_limits = None if other.name in of_bar else symbol
        return _deviations_by(other, measured, specification, in_limits, opposite=opposite)

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


def _deviations_by(
    other: CalibratedBar,
    measured: Sequence[LengthMeasurement],
    specification: Specification,
    in_limits: str | None,
    *,
    opposite: bool,
) -> FloatArray | None:
    """Mean deviation at each position as named, and by another certificate (n, 2) [mm]; None: other lengths.

    With the symbol of a limit, in units of half of it; None where there is none.
    """
    places: dict[str, list[tuple[float, float]]] = {}
    for one in measured:
        there = _same_nominal(one.length, other)
        unit = 1.0 if in_limits is None else (specification.limit(in_limits, one.length.length_mm) or 0.0) / 2
        unaligned = opposite and other.u_alignment_mm is None and one.bar.u_alignment_mm is not None
        if there is None or not unit or unaligned:
            return None
        both = (one, replace(one, bar=other, length=there))
        own, fits = (each.error(opposite=opposite, corrected=specification.corrected_to_20_degC) for each in both)
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


class Evaluation:
    """The evaluation of the tests of a verification.

    Parameters
    ----------
    measured : MeasuredPoints
    artefacts : Artefacts
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}

    Attributes
    ----------
    remarks : list of str
        Suspected blunders and exchanged ends, as they are found.
    """

    def __init__(
        self, measured: MeasuredPoints, artefacts: Artefacts, specification: Specification, rule: DecisionRule
    ) -> None:
        self.measured, self.specification, self.rule = measured, specification, rule
        self.remarks: list[str] = []
        self._checks = PointChecks(measured, artefacts, specification.measuring_range_mm, self.remarks)

    def rows_of(self, name: str, test: PlannedTest) -> list[ConformityResult]:
        """Evaluate one test; return its test values with their verdicts."""
        groups = self.measured.tests[name]
        rows = self._rows_of(name, groups, test)
        self._checks.check_in_range(name, groups)
        return rows

    def _rows_of(self, name: str, groups: Sequence[PointGroup], test: PlannedTest) -> list[ConformityResult]:
        if isinstance(test, Probing | EffectiveDiameter):
            return self._sizes(name, groups, test)
        if isinstance(test, Articulation):
            return self._articulation(name, groups, test)
        if isinstance(test, SinglePoint):
            return self._single_point(name, groups, test)
        if isinstance(test, LengthTest):
            return self._lengths(name, groups, test)
        assert isinstance(test, Volumetric)
        return self._volumetric(name, groups, test)

    def _sizes(
        self, name: str, groups: Sequence[PointGroup], test: Probing | EffectiveDiameter
    ) -> list[ConformityResult]:
        key, planned = ("position", test.positions) if isinstance(test, Probing) else ("repeat", test.repeats)
        self._checks.check_positions(name, groups, key, planned.value)
        spheres = [self._checks.sphere(name, group, test) for group in groups]
        self._checks.check_no_copies(name, groups)
        if isinstance(test, Probing):
            self._checks.check_apart(name, groups, sphere_centres(spheres), spheres[0].sphere.diameter_mm)
            size = iso10360_12.p_size(spheres, self.specification, rule=self.rule)
            rows = [size, iso10360_12.p_form(spheres, self.specification, rule=self.rule)]
        else:
            rows = [asme_b89_4_22.effective_diameter(spheres, self.specification, rule=self.rule)]
        if self._suspect(rows):
            self.remarks.extend(blunders.on_spheres(name, groups, spheres, rows[0]))
        return rows

    def _articulation(self, name: str, groups: Sequence[PointGroup], test: Articulation) -> list[ConformityResult]:
        positions = split_groups(groups, "position")
        self._checks.check_count(name, groups[0], "positions", positions, test.positions.value)
        measured = []
        for position, members in positions.items():
            self._checks.check_one_artefact(name, members)
            what = f"groups at position {position}"
            self._checks.check_count(name, members[0], what, split_groups(members, "group"), test.groups.value)
            spheres = [self._checks.sphere(name, group, test, where=f"position {position}") for group in members]
            reach = spheres[0].sphere.diameter_mm
            for group, one in zip(members, spheres, strict=True):
                away = float(((one.fit.centre - spheres[0].fit.centre) ** 2).sum() ** 0.5)
                if away > reach:
                    raise self.measured.error(
                        f"test {name!r}, {group.where}: the sphere is {away:.4g} mm away from that of the first group, "
                        f"more than its diameter",
                        group,
                        hint="measure all groups of a position on one sphere that stays in place",
                    )
            measured.append(spheres)
        self._checks.check_no_copies(name, groups)
        firsts = [members[0] for members in positions.values()]
        self._checks.check_apart(
            name, firsts, sphere_centres([one[0] for one in measured]), measured[0][0].sphere.diameter_mm
        )
        rows = iso10360_12.l_dia(measured, self.specification, rule=self.rule)
        if self._suspect(rows):
            for members, spheres in zip(positions.values(), measured, strict=True):
                self.remarks.extend(blunders.in_groups(name, members, spheres))
        return rows

    def _single_point(self, name: str, groups: Sequence[PointGroup], test: SinglePoint) -> list[ConformityResult]:
        self._checks.check_positions(name, groups, "position", test.positions.value)
        seats = []
        for group in groups:
            self._checks.check_points(name, group, test.points.value)
            self._checks.check_not_frozen(name, group)
            seat = self._checks.artefact(self._checks.artefacts.seat, group)
            seats.append(asme_b89_4_22.SeatPoints(seat, group.points, group.where))
        self._checks.check_no_copies(name, groups)
        self._checks.check_apart(
            name, groups, np.array([[group.points.mean(axis=0)] for group in groups]), SAME_PLACE_MM
        )
        self._checks.check_seats_spread(name, groups, test.spread_share.value)
        rows = asme_b89_4_22.single_point(seats, self.specification, rule=self.rule)
        if self._suspect(rows):
            self.remarks.extend(blunders.in_seats(name, groups))
        return rows

    def _lengths(self, name: str, groups: Sequence[PointGroup], test: LengthTest) -> list[ConformityResult]:
        repeats, positions = test.repeats.value, test.positions.value
        pairs = self._checks.lengths(name, groups)
        lengths = [one for one, _ in pairs]
        by_length = split_groups(groups, "artefact", "length")
        self._checks.check_count(name, groups[0], "lengths", by_length, test.lengths.value)
        for members in by_length.values():
            what = f"positions of length {members[0].keys['length']}"
            by_position = split_groups(members, "position")
            self._checks.check_count(name, members[0], what, by_position, positions)
            for at in by_position.values():
                runs = sorted(int(str(repeat)) for repeat in split_groups(at, "repeat"))
                whole = list(range(1, repeats + 1))
                again = list(range(1, 2 * repeats + 1)) if test.tolerated_sets.value else whole
                if runs not in (whole, again):
                    raise self.measured.error(
                        f"test {name!r}, length {at[0].keys['length']}, position {at[0].keys['position']}: expected "
                        f"repeats 1 to {repeats}, got {', '.join(map(str, runs))}",
                        at[0],
                        hint="measure the missing repeats, and number them 1, 2, ..",
                    )
        self._checks.check_bars_apart(name, groups, min(test.directions.value, positions))
        self._checks.check_bars_stay(name, pairs)
        self._checks.check_sizes(name, test, lengths, groups[0])
        self._check_bars_not_exchanged("E_Uni" if name == "uni" else "E_Bi", pairs, opposite=name == "bi")
        evaluate = iso10360_12.e_uni if name == "uni" else iso10360_12.e_bi
        rows = evaluate(
            lengths, self.specification, repeats=repeats, tolerated_sets=test.tolerated_sets.value, rule=self.rule
        )
        if self._suspect(rows):
            self._blunders_in_lengths("E_Uni" if name == "uni" else "E_Bi", pairs, opposite=name == "bi")
        return rows

    def _volumetric(self, name: str, groups: Sequence[PointGroup], test: Volumetric) -> list[ConformityResult]:
        pairs = self._checks.lengths(name, groups)
        self._checks.check_count(
            name, groups[0], "lengths", split_groups(groups, "artefact", "length"), test.lengths.value
        )
        self._checks.check_count(name, groups[0], "measured lengths", len(pairs), test.positions.value)
        each = test.positions.value // test.lengths.value  # positions are planned in all
        self._checks.check_bars_apart(name, groups, min(test.directions.value, each))
        self._checks.check_sizes(name, test, [one for one, _ in pairs], groups[0])
        self._check_bars_not_exchanged("Volumetric.Max", pairs, opposite=False)
        rows = asme_b89_4_22.volumetric([one for one, _ in pairs], self.specification, rule=self.rule)
        if self._suspect(rows):
            self._blunders_in_lengths("Volumetric.Max", pairs, opposite=False)
        return rows

    def _suspect(self, rows: Iterable[ConformityResult]) -> bool:
        """Whether to look for blunders: a value does not conform, and the points come from a file."""
        return self.measured.file is not None and any(row.verdict not in (Verdict.CONFORM, None) for row in rows)

    def _check_bars_not_exchanged(
        self, symbol: str, pairs: Sequence[tuple[LengthMeasurement, PointGroup]], *, opposite: bool
    ) -> None:
        """Refuse lengths that another bar of the same nominal length explains by far better."""
        lengths, artefacts = [one for one, _ in pairs], self._checks.artefacts
        if self.measured.file is None or len(artefacts.bars) < 2:
            return
        found = exchanged_bars(lengths, artefacts, self.specification, symbol, opposite=opposite)
        if found is not None:
            named, fits, odds = found
            problem = (
                f"{symbol}: the lengths measured on {named!r} are those of {fits!r} by the certificates: exchanged "
                f"bars explain them better, with odds of {odds:.1g} to 1"
            )
            first = next(group for one, group in pairs if one.bar.name == named)
            hint = (
                "compare the serial numbers on the bars with their certificates (column artefact_serial_number), and "
                "correct the column artefact or the calibrated lengths"
            )
            contradict(self.measured.error(problem, first, hint=hint))

    def _blunders_in_lengths(
        self, symbol: str, pairs: Sequence[tuple[LengthMeasurement, PointGroup]], *, opposite: bool
    ) -> None:
        corrected = self.specification.corrected_to_20_degC
        errors = [one.error(opposite=opposite, corrected=corrected) for one, _ in pairs]
        self.remarks.extend(blunders.in_lengths(symbol, pairs, errors, self.specification))
