"""A whole verification: the points against a test plan, the artefacts' certificates and the specification."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import quoted_cell
from truearm.typing import FloatArray
from truearm.verification.standards import asme_b89_4_22, blunders, iso10360_12
from truearm.verification.standards.artefacts import Artefact, Artefacts
from truearm.verification.standards.decision import (
    SIMPLE_RATIO,
    ConformityResult,
    DecisionRule,
    Verdict,
    overall_verdict,
    simple_applies,
)
from truearm.verification.standards.measurands import LengthMeasurement, SphereMeasurement, check_spread
from truearm.verification.standards.measured_points import (
    ENDS,
    KEY_COLUMNS,
    MAX_TEMPERATURE_SPREAD_K,
    MeasuredPoints,
    PointGroup,
    join_names,
)
from truearm.verification.standards.specification import SYMBOLS, Specification
from truearm.verification.standards.verification_plan import (
    CHECK_STANDARD,
    Articulation,
    EffectiveDiameter,
    LengthTest,
    PlannedTest,
    Probing,
    SinglePoint,
    VerificationPlan,
    Volumetric,
)

A = TypeVar("A", bound=Artefact)

# A size or length that is further from the calibrated one than this share is another artefact's, or in another unit.
SAME_SHARE = 0.05
# Two positions of a seat, or of both ends of a bar, that are nearer than this are one [mm]: chosen here.
SAME_PLACE_MM = 10.0
# Runs of a length at one position whose ends are farther apart are of two places [mm]: a ball or face is smaller.
MOVED_MM = 50.0


@dataclass(frozen=True, eq=False)
class Verification:
    """The outcome of a verification.

    Attributes
    ----------
    rows : tuple of ConformityResult
    verdict : Verdict
        Conform only where every row with a limit is.
    remarks : tuple of str
        What looks like a slip and not like an arm; what was not tested, limits of the specification included; and which
        numbers of the plan are recalled.
    """

    rows: tuple[ConformityResult, ...]
    verdict: Verdict
    remarks: tuple[str, ...]


def verify(
    measured: MeasuredPoints,
    *,
    plan: VerificationPlan,
    artefacts: Artefacts,
    specification: Specification,
    rule: DecisionRule = "iso14253-1",
) -> Verification:
    """Test points against a specification as a plan says.

    Raises
    ------
    InputError
        If points of a test are missing, too many or not of the plan; an artefact is unknown, its certificate does not
        serve on the day, or what was measured cannot be it; or nothing has a limit.
    """
    for name, groups in measured.tests.items():
        if name not in plan.tests:
            raise measured.error(f"the plan {plan.name!r} has no test {name!r}", groups[0], hint=", ".join(plan.tests))
    evaluation = _Evaluation(measured, artefacts, specification, rule)
    rows: list[ConformityResult] = []
    remarks: list[str] = []
    for name, test in plan.tests.items():
        if name in measured.tests:
            rows += evaluation.rows_of(name, test)
        elif test.required:
            raise measured.error(
                f"the points of test {name!r} are missing",
                hint=f"measure them, or take the test out of the plan {plan.name!r} if it is not agreed",
            )
        else:
            remarks.append(f"not tested: {name}")
    verdict = overall_verdict(rows)
    if verdict is None:
        raise InputError(
            f"the specification {specification.name!r} states no limit for what was tested",
            hint=f"under [limits], one of {', '.join(SYMBOLS)}",
        )
    remarks += _remarks(rows, plan, specification, rule, measured.tests)
    return Verification(tuple(rows), verdict, (*evaluation.remarks, *remarks))


def _remarks(
    rows: Sequence[ConformityResult],
    plan: VerificationPlan,
    specification: Specification,
    rule: DecisionRule,
    tested: Collection[str],
) -> list[str]:
    remarks = []
    if rule == "simple":
        remarks.append(
            f"simple acceptance: the uncertainty is left out where it is at most 1/{SIMPLE_RATIO:g} of the limit"
        )
        large = [one.label for one in rows if one.limit is not None and not simple_applies(one.uncertainty, one.limit)]
        if large:
            remarks.append(
                f"U is more than 1/{SIMPLE_RATIO:g} of the limit, simple acceptance does not apply, ISO 14253-1 "
                f"decides: {', '.join(dict.fromkeys(large))}"
            )
    if not specification.corrected_to_20_degC:
        remarks.append("lengths are not corrected to 20 degC, as the specification says")
    symbols = dict.fromkeys(row.label.partition(", ")[0] for row in rows)
    limited = {row.label.partition(", ")[0] for row in rows if row.limit is not None}
    if without := [symbol for symbol in symbols if symbol in SYMBOLS and symbol not in limited]:
        remarks.append(f"no limit is stated for: {', '.join(without)}")
    if untested := [symbol for symbol in SYMBOLS if symbol in specification.limits and symbol not in symbols]:
        remarks.append(f"limits stated, not tested: {', '.join(untested)}")
    recalled = [(key, f"{value:g}") for key, value, _ in plan.unconfirmed() if key.partition(".")[0] in tested]
    departing = [(key, f"{value:g} ({other:g})") for key, value, other in plan.changed_numbers()]
    remarks += _by_test(f"recalled, {CHECK_STANDARD}", recalled)
    remarks += _by_test(f"not as in truearm's plan after {plan.standard}", departing)
    return remarks


def _by_test(what: str, numbers: Iterable[tuple[str, str]]) -> list[str]:
    """A remark for each test on numbers of the plan, by their keys."""
    found: dict[str, list[str]] = {}
    for key, value in numbers:
        test, _, number = key.partition(".")
        found.setdefault(test, []).append(f"{number} = {value}")
    return [f"plan, {test}: {what}: {', '.join(told)}" for test, told in found.items()]


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """From groups of points to the functions of the standards, with every count checked on the way."""

    measured: MeasuredPoints
    artefacts: Artefacts
    specification: Specification
    rule: DecisionRule
    remarks: list[str] = field(default_factory=list)

    def rows_of(self, name: str, test: PlannedTest) -> list[ConformityResult]:
        """The rows of one test."""
        groups = self.measured.tests[name]
        if isinstance(test, Probing):
            self._count(name, groups, "position", test.positions.value)
            spheres = [self._sphere(name, group, test) for group in groups]
            self._no_copies(name, [[group] for group in groups])
            self._apart(name, groups, _middles(spheres), spheres[0].sphere.diameter_mm)
            size = iso10360_12.p_size(spheres, self.specification, rule=self.rule)
            form = iso10360_12.p_form(spheres, self.specification, rule=self.rule)
            if self._suspect([size, form]):
                self.remarks.extend(blunders.on_spheres(name, groups, spheres, size))
            return [size, form]
        if isinstance(test, Articulation):
            return self._articulation(name, groups, test)
        if isinstance(test, EffectiveDiameter):
            self._count(name, groups, "repeat", test.repeats.value)
            spheres = [self._sphere(name, group, test) for group in groups]
            self._no_copies(name, [[group] for group in groups])
            size = asme_b89_4_22.effective_diameter(spheres, self.specification, rule=self.rule)
            if self._suspect([size]):
                self.remarks.extend(blunders.on_spheres(name, groups, spheres, size))
            return [size]
        if isinstance(test, SinglePoint):
            return self._single_point(name, groups, test)
        if isinstance(test, LengthTest):
            return self._lengths(name, groups, test)
        assert isinstance(test, Volumetric)
        return self._volumetric(name, groups, test)

    def _articulation(self, name: str, groups: Sequence[PointGroup], test: Articulation) -> list[ConformityResult]:
        positions = _split(groups, "position")
        self._expect(name, groups[0], "positions", positions, test.positions.value)
        found = []
        for position, members in positions.items():
            self._one_artefact(name, members)
            what = f"groups at position {position}"
            self._expect(name, members[0], what, _split(members, "group"), test.groups.value)
            spheres = [self._sphere(name, group, test, where=f"position {position}") for group in members]
            reach = spheres[0].sphere.diameter_mm
            for group, one in zip(members, spheres, strict=True):
                away = float(((one.fit.centre - spheres[0].fit.centre) ** 2).sum() ** 0.5)
                if away > reach:
                    raise self.measured.error(
                        f"test {name!r}, {group.where}: its sphere is {away:.4g} mm from that of the first group, "
                        f"which is more than the sphere's diameter",
                        group,
                        hint="all groups of one position are taken on one sphere that stays in place",
                    )
            found.append(spheres)
        self._no_copies(name, [[group] for group in groups])
        firsts = [members[0] for members in positions.values()]
        self._apart(name, firsts, _middles([one[0] for one in found]), found[0][0].sphere.diameter_mm)
        rows = iso10360_12.l_dia(found, self.specification, rule=self.rule)
        if self._suspect(rows):
            for members, spheres in zip(positions.values(), found, strict=True):
                self.remarks.extend(blunders.in_groups(name, members, spheres))
        return rows

    def _single_point(self, name: str, groups: Sequence[PointGroup], test: SinglePoint) -> list[ConformityResult]:
        self._count(name, groups, "position", test.positions.value)
        seats = []
        for group in groups:
            self._points(name, group, test.points.value)
            self._not_frozen(name, group)
            seat = self._known(self.artefacts.seat, group)
            seats.append(asme_b89_4_22.SeatPoints(seat, group.points, group.where))
        self._no_copies(name, [[group] for group in groups])
        self._apart(name, groups, np.array([[group.points.mean(axis=0)] for group in groups]), SAME_PLACE_MM)
        rows = asme_b89_4_22.single_point(seats, self.specification, rule=self.rule)
        if self._suspect(rows):
            self.remarks.extend(blunders.in_seats(name, groups))
        return rows

    def _lengths(self, name: str, groups: Sequence[PointGroup], test: LengthTest) -> list[ConformityResult]:
        repeats, positions = test.repeats.value, test.positions.value
        pairs = self._pairs(name, groups)
        lengths = [one for one, _ in pairs]
        by_length = _split(groups, "artefact", "length")
        self._expect(name, groups[0], "lengths", by_length, test.lengths.value)
        for members in by_length.values():
            what = f"positions of length {members[0].keys['length']}"
            by_position = _split(members, "position")
            self._expect(name, members[0], what, by_position, positions)
            for at in by_position.values():
                runs = sorted(int(str(repeat)) for repeat in _split(at, "repeat"))
                whole = list(range(1, repeats + 1))
                again = list(range(1, 2 * repeats + 1)) if test.tolerated_sets.value else whole
                if runs not in (whole, again):
                    raise self.measured.error(
                        f"test {name!r}, length {at[0].keys['length']}, position {at[0].keys['position']}: expected "
                        f"repeats 1 to {repeats}, got {', '.join(map(str, runs))}",
                        at[0],
                    )
        self._bars_apart(name, groups)
        self._bars_stay(name, pairs)
        self._long_enough(name, lengths, groups[0], test.longest_share.value)
        evaluate = iso10360_12.e_uni if name == "uni" else iso10360_12.e_bi
        rows = evaluate(
            lengths, self.specification, repeats=repeats, tolerated_sets=test.tolerated_sets.value, rule=self.rule
        )
        if self._suspect(rows):
            self._blunders_in_lengths("E_Uni" if name == "uni" else "E_Bi", pairs, opposite=name == "bi")
        return rows

    def _volumetric(self, name: str, groups: Sequence[PointGroup], test: Volumetric) -> list[ConformityResult]:
        pairs = self._pairs(name, groups)
        self._expect(name, groups[0], "lengths", _split(groups, "artefact", "length"), test.lengths.value)
        self._expect(name, groups[0], "measured lengths", len(pairs), test.positions.value)
        self._bars_apart(name, groups)
        self._long_enough(name, [one for one, _ in pairs], groups[0], test.longest_share.value)
        rows = asme_b89_4_22.volumetric([one for one, _ in pairs], self.specification, rule=self.rule)
        if self._suspect(rows):
            self._blunders_in_lengths("Volumetric.Max", pairs, opposite=False)
        return rows

    def _suspect(self, rows: Iterable[ConformityResult]) -> bool:
        """Whether to look for slips: something does not conform, and people measured it."""
        return self.measured.file is not None and any(row.verdict not in (Verdict.CONFORM, None) for row in rows)

    def _blunders_in_lengths(
        self, symbol: str, pairs: Sequence[tuple[LengthMeasurement, PointGroup]], *, opposite: bool
    ) -> None:
        corrected = self.specification.corrected_to_20_degC
        errors = [one.error(opposite=opposite, corrected=corrected) for one, _ in pairs]
        self.remarks.extend(blunders.in_lengths(symbol, pairs, errors, self.specification))

    def _sphere(
        self, name: str, group: PointGroup, test: Probing | Articulation | EffectiveDiameter, where: str = ""
    ) -> SphereMeasurement:
        """A sphere's points, if they are as many as planned and can be that sphere's."""
        self._points(name, group, test.points.value)
        sphere = self._known(self.artefacts.sphere, group)
        if not test.smallest_sphere_mm.value <= sphere.diameter_mm <= test.largest_sphere_mm.value:
            raise self.measured.error(
                f"test {name!r}: the plan wants a sphere of {test.smallest_sphere_mm.value:g} to "
                f"{test.largest_sphere_mm.value:g} mm, {sphere.name!r} has {sphere.diameter_mm:g} mm",
                group,
                hint="another sphere, or the plan's numbers as your copy of the standard has them",
            )
        degC = 20.0 if group.degC != group.degC else group.degC  # no temperature is needed for a place
        found = SphereMeasurement(sphere, group.points, degC, group.tip_mm, where or group.where)
        try:
            check_spread(group.points, test.points.value)
            diameter = found.diameter_mm
        except InputError as error:
            raise self.measured.error(
                f"test {name!r}, {group.where}: {error.problem}", group, hint=error.hint
            ) from None
        self._plausible(name, group, diameter, sphere.diameter_mm)
        return found

    def _pairs(self, name: str, groups: Sequence[PointGroup]) -> list[tuple[LengthMeasurement, PointGroup]]:
        """Lengths from the groups of their ends, each with the group of end A."""
        found, taken = [], []
        for members in _split(groups, "artefact", *(key for key in KEY_COLUMNS[name] if key != "end")).values():
            ends = {group.keys["end"]: group for group in members}
            if len(ends) != 2:
                missing = "B" if "A" in ends else "A"
                raise self.measured.error(
                    f"test {name!r}, {members[0].where}: end {missing} is missing",
                    members[0],
                )
            start, end = ends["A"], ends["B"]
            bar = self._known(self.artefacts.bar, start)
            self._known(self.artefacts.bar, end)  # on its own day
            if abs(start.degC - end.degC) > MAX_TEMPERATURE_SPREAD_K:
                raise self.measured.error(
                    f"test {name!r}, {start.where}: end A was at {start.degC:g} degC, end B at {end.degC:g} degC: "
                    f"their mean tells nothing of the length",
                    end,
                    hint="measure the length again when the artefact keeps its temperature",
                )
            try:
                one = LengthMeasurement(
                    bar,
                    bar.length(start.keys["length"]),
                    start.points,
                    end.points,
                    (start.degC + end.degC) / 2,
                    start.tip_mm,
                    start.keys["position"],
                    start.keys.get("repeat", ""),
                )
                distance = one.distance_mm(opposite=name == "bi")
            except InputError as error:
                raise self.measured.error(f"test {name!r}: {error.problem}", start, hint=error.hint) from None
            if start.tip_mm != end.tip_mm:
                raise self.measured.error(f"test {name!r}, {start.where}: the ends have different tip diameters", end)
            self._plausible(name, start, distance, one.length.length_mm)
            found.append((one, start))
            taken.append((start, end))
        self._no_copies(name, taken)
        return found

    def _long_enough(self, name: str, lengths: Sequence[LengthMeasurement], group: PointGroup, share: float) -> None:
        """Check that the longest length is such a share of the measuring range."""
        longest = max(one.length.length_mm for one in lengths)
        needed = share * self.specification.measuring_range_mm
        if longest < needed:
            raise self.measured.error(
                f"test {name!r}: the longest length is {longest:.5g} mm, the plan wants {needed:.5g} mm or more, "
                f"{share:.0%} of the measuring range",
                group,
                hint="a longer bar, or longest_share in the plan as your copy of the standard has it",
            )

    def _bars_apart(self, name: str, groups: Sequence[PointGroup]) -> None:
        """Check that a length lies elsewhere at each position."""
        for members in _split(groups, "artefact", "length").values():
            positions = list(_split(members, "position").values())
            places = np.array(
                [
                    [next(one.points.mean(axis=0) for one in at if one.keys["end"] == end) for end in ENDS]
                    for at in positions
                ]
            )
            self._apart(name, [at[0] for at in positions], places, SAME_PLACE_MM)

    def _bars_stay(self, name: str, pairs: Sequence[tuple[LengthMeasurement, PointGroup]]) -> None:
        """Check that a length lies where it lay from run to run; runs with its ends the other way round are told."""
        if self.measured.file is None:  # laid out by a program
            return
        firsts: dict[tuple[str, str, str], FloatArray] = {}
        turned = []
        for one, group in pairs:
            ends = np.array([one.start.mean(axis=0), one.end.mean(axis=0)])
            first = firsts.setdefault((one.bar.name, one.length.name, one.position), ends)
            away, away_turned = (float(np.linalg.norm(some - first, axis=1).max()) for some in (ends, ends[::-1]))
            if min(away, away_turned) > MOVED_MM:
                raise self.measured.error(
                    f"test {name!r}, {group.where}: an end is {away:.4g} mm from where it was in the first run there",
                    group,
                    hint="the bar stays in place for all runs of a position: check the position, and x, y and z",
                )
            if away > MOVED_MM:
                turned.append(group.where)
        if turned:
            self.remarks.append(
                f"test {name!r}: ends A and B are the other way round than in the first run, which leaves the length "
                f"as it is: {join_names(turned, '; ')}"
            )

    def _no_copies(self, name: str, taken: Iterable[Sequence[PointGroup]]) -> None:
        """Check that no two things measured are bit for bit the same: noise does not repeat so often.

        Points that come from no file are computed, and may have no noise.
        """
        if self.measured.file is None:
            return
        seen: dict[bytes, PointGroup] = {}
        for groups in taken:
            first = seen.setdefault(b" ".join((group.points + 0.0).tobytes() for group in groups), groups[0])
            if first is not groups[0]:
                raise self.measured.error(
                    f"test {name!r}: {groups[0].where} has the same coordinates as {first.where}: a copy",
                    groups[0],
                    hint="measure it; if the coordinates are rounded, write them with more digits",
                )

    def _not_frozen(self, name: str, group: PointGroup) -> None:
        """Check that points in a seat are not mostly one and the same; as `_no_copies`, of a file only.

        Some are by chance where coordinates are rounded: of ten points with a noise of 10 um, written to 0.01 mm, at
        most two are the same in half of the seats, and never more than four in 4000 simulated ones.
        """
        if self.measured.file is None:
            return
        _, which, counts = np.unique(group.points, axis=0, return_inverse=True, return_counts=True)
        if 2 * counts.max() > len(group.points):
            same = (which == counts.argmax()).ravel()
            first, *rest = (f"line {line}" for line, one in zip(group.lines, same, strict=True) if one)
            raise self.measured.error(
                f"test {name!r}, {group.where}: the point of {first} stands in {join_names(rest)} too, to the last "
                "digit: copies, or a program that went on sending an old one",
                group,
                hint="measure the position again; if the coordinates are rounded, write them with more digits",
            )

    def _apart(self, name: str, groups: Sequence[PointGroup], places: FloatArray, nearest_mm: float) -> None:
        """Check that at each position an artefact stands elsewhere: one of its places (n, k, 3) is so far away."""
        for i in range(1, len(places)):
            away = [
                np.sqrt(((places[:i] - ends) ** 2).sum(axis=2)).max(axis=1) for ends in (places[i], places[i, ::-1])
            ]
            apart = np.minimum(*away)  # a bar turned end for end lies where it lay
            near = int(apart.argmin())
            if apart[near] < nearest_mm:
                one, other = groups[near], groups[i]
                raise self.measured.error(
                    f"test {name!r}: {one.where} and {other.where} are {apart[near]:.2g} mm apart: one place, not two",
                    other,
                    hint="move the artefact between positions; what is measured again in one place is no position",
                )

    def _known(self, look_up: Callable[[str], A], group: PointGroup) -> A:
        """An artefact whose certificate serves on the group's day."""
        try:
            artefact = look_up(group.artefact)
            artefact.check_valid(group.date)
        except InputError as error:
            raise self.measured.error(error.problem, group, hint=error.hint) from None
        return artefact

    def _plausible(self, name: str, group: PointGroup, found: float, calibrated: float) -> None:
        if abs(found - calibrated) <= SAME_SHARE * calibrated:
            return
        hint = "the artefact's name, and whether points are compensated or need tip_diameter_mm"
        for unit, factor in (("inches", 25.4), ("centimetres", 10.0), ("metres", 1000.0)):
            if abs(found * factor - calibrated) <= SAME_SHARE * calibrated:
                hint = f"the points seem to be in {unit}: convert them to mm"
        raise self.measured.error(
            f"test {name!r}, {group.where}: measured {found:.5g} mm where {group.artefact!r} has {calibrated:.5g} mm",
            group,
            hint=hint,
        )

    def _points(self, name: str, group: PointGroup, planned: int) -> None:
        self._expect(name, group, f"points at {group.where}", len(group.points), planned)

    def _count(self, name: str, groups: Sequence[PointGroup], key: str, planned: int) -> None:
        """Each position or repeat once, as many as planned."""
        self._expect(name, groups[0], f"{key}s", _split(groups, key), planned)
        for members in _split(groups, key).values():
            self._one_artefact(name, members)

    def _one_artefact(self, name: str, members: Sequence[PointGroup]) -> None:
        for group in members:
            if group.artefact != members[0].artefact:
                raise self.measured.error(
                    f"test {name!r}, {group.where}: points on {members[0].artefact!r} and on {group.artefact!r}", group
                )

    def _expect(
        self, name: str, group: PointGroup, what: str, found: int | Collection[str | tuple[str, ...]], planned: int
    ) -> None:
        """Check a number, or how many names there are, which are told."""
        n = found if isinstance(found, int) else len(found)
        if n == planned:
            return
        told = [] if isinstance(found, int) else [one if isinstance(one, str) else " ".join(one) for one in found]
        hint = "measure what is missing" if n < planned else "take out what is too much"
        raise self.measured.error(
            f"test {name!r}: the plan wants {planned} {what}, got {n}"
            + (f": {join_names([quoted_cell(one) for one in told])}" if told else ""),
            group,
            hint=f"{hint}, or change the plan (truearm verify --print-plan) if it is so agreed",
        )


def _middles(spheres: Sequence[SphereMeasurement]) -> FloatArray:
    """Their middles, (n, 1, 3) [mm]."""
    return np.array([[one.fit.centre] for one in spheres])


def _split(groups: Iterable[PointGroup], *keys: str) -> dict[str | tuple[str, ...], list[PointGroup]]:
    """Groups by the values of some keys, in the order of the file."""
    found: dict[str | tuple[str, ...], list[PointGroup]] = {}
    for group in groups:
        values = tuple(group.artefact if key == "artefact" else group.keys[key] for key in keys)
        found.setdefault(values[0] if len(values) == 1 else values, []).append(group)
    return found
