"""Checks of measured points before a test is evaluated: numbers, certificates, positions, copies, plausible sizes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from math import isnan
from typing import TypeVar

import numpy as np

from truearm.acceptance import contradict
from truearm.errors import InputError
from truearm.files.delimited import quoted_cell
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.artefacts import Artefact, Artefacts, CalibratedBar, CalibratedSphere
from truearm.wings.laboratory.standards.copied_points import find_copy, find_repeated, find_shared
from truearm.wings.laboratory.standards.layout import length_fault
from truearm.wings.laboratory.standards.measurands import (
    LengthMeasurement,
    SphereMeasurement,
    check_pattern,
    check_spread,
)
from truearm.wings.laboratory.standards.measured_points import (
    ENDS,
    KEY_COLUMNS,
    MAX_TEMPERATURE_SPREAD_K,
    MeasuredPoints,
    PointGroup,
    join_names,
)
from truearm.wings.laboratory.standards.specification import MEASURING_RANGE
from truearm.wings.laboratory.standards.verification_plan import (
    EVEN,
    Articulation,
    EffectiveDiameter,
    LengthTest,
    Probing,
    Volumetric,
)

A = TypeVar("A", bound=Artefact)

# Of the limit of a length's error, by the test.
LENGTH_SYMBOLS = {"uni": "E_Uni", "bi": "E_Bi", "volumetric": "Volumetric.Max"}
# A size or length that differs from the calibrated one by more than this share belongs to another artefact or unit.
SAME_SHARE = 0.05
# Two positions of a seat, or of both ends of a bar, that are nearer than this are the same [mm]: chosen here.
SAME_PLACE_MM = 10.0
# Makers round the measuring range, often to 0.1 m: points this much farther apart do not contradict it.
RANGE_MARGIN = 1.03
# A thermometer without an uncertainty contradicts nothing while thermal expansion is corrected over less [K].
MOST_K_EXACT = 1.0
# Directions of a bar at two positions that are nearer than this are one [deg]: chosen here.
ANOTHER_DIRECTION_DEG = 30.0
# Runs of a length at one position whose ends are farther apart are at two positions [mm]: a ball or face is smaller.
MOVED_MM = 50.0


@dataclass(frozen=True, eq=False)
class PointChecks:
    """The measured groups of a test as measurands of the standards, with every check on the way.

    Points that come from no file are calculated by a program: they are not checked for copies.
    """

    name: str
    measured: MeasuredPoints
    artefacts: Artefacts
    measuring_range_mm: float
    remarks: list[str]

    @property
    def groups(self) -> tuple[PointGroup, ...]:
        """The measured groups of the test."""
        return self.measured.tests[self.name]

    def error(self, problem: str, group: PointGroup, hint: str | None, *, where: str | None = None) -> InputError:
        """Return an error of a group of the test, that says where: by default the group's place, "" says none."""
        places = (f"test {self.name!r}", group.where if where is None else where)
        return self.measured.error(f"{', '.join(filter(None, places))}: {problem}", group, hint=hint)

    def sphere(
        self, group: PointGroup, test: Probing | Articulation | EffectiveDiameter, where: str = ""
    ) -> SphereMeasurement:
        """Return a measured sphere; refuse another number of points than planned, and points of another sphere."""
        self.check_points(group, test.points.value)
        sphere = self.artefact(self.artefacts.sphere, group)
        if not test.smallest_sphere_mm.value <= sphere.diameter_mm <= test.largest_sphere_mm.value:
            raise self.error(
                f"the plan asks for a sphere of {test.smallest_sphere_mm.value:g} to "
                f"{test.largest_sphere_mm.value:g} mm, {sphere.name!r} has {sphere.diameter_mm:g} mm",
                group,
                "use another sphere, or correct the plan by your copy of the standard",
                where="",
            )
        degC = 20.0 if isnan(group.degC) else group.degC  # a position needs no temperature
        measured = SphereMeasurement(sphere, group.points, degC, group.tip_mm, where or group.where)
        try:
            check_spread(group.points, test.points.value)
            diameter = measured.diameter_mm
            if test.pattern.value == EVEN:
                check_pattern(group.points, measured.fit.centre, test.points.value)
        except InputError as error:
            raise self.error(error.problem, group, error.hint) from None
        self._check_plausible(group, diameter, sphere.diameter_mm)
        return measured

    def lengths(self) -> list[tuple[LengthMeasurement, PointGroup]]:
        """Return the measured lengths, each with the group of its end A."""
        pairs = []
        keys = [key for key in KEY_COLUMNS[self.name] if key != "end"]
        for members in split_groups(self.groups, "artefact", *keys).values():
            ends = {group.keys["end"]: group for group in members}
            if len(ends) != 2:
                missing = "B" if "A" in ends else "A"
                hint = f"measure end {missing}, and check the column end"
                raise self.error(f"end {missing} is missing", members[0], hint)
            start, end = ends["A"], ends["B"]
            bar = self.artefact(self.artefacts.bar, start)
            self.artefact(self.artefacts.bar, end)  # its own date counts
            if abs(start.degC - end.degC) > MAX_TEMPERATURE_SPREAD_K:
                raise self.error(
                    f"end A was at {start.degC:g} degC, end B at {end.degC:g} degC: the length has no definite "
                    "temperature",
                    end,
                    "measure the length again when the temperature of the artefact is stable",
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
                    LENGTH_SYMBOLS[self.name],
                )
                distance = one.distance_mm
            except InputError as error:
                raise self.error(error.problem, start, error.hint, where="") from None
            if start.tip_mm != end.tip_mm:
                hint = "measure both ends with one tip, or correct tip_diameter_mm"
                raise self.error("the ends have different tip diameters", end, hint)
            self._check_plausible(start, distance, one.length.length_mm)
            pairs.append((one, start))
        self.check_no_copies()
        return pairs

    def check_sizes(self, test: LengthTest | Volumetric, lengths: Sequence[LengthMeasurement]) -> None:
        """Check that the sizes of the lengths are the planned shares of the measuring range."""
        sizes = {(one.bar.name, one.length.name): one.length.length_mm for one in lengths}
        if fault := length_fault(self.name, test, list(sizes.values()), self.measuring_range_mm):
            raise self.measured.error(fault[0], self.groups[0], hint=fault[1])

    def check_in_range(self) -> None:
        """Check that the places of a test fit into the measuring range: an arm does not reach farther."""
        places = np.array([group.points.mean(axis=0) for group in self.groups])
        most = RANGE_MARGIN * self.measuring_range_mm
        if np.linalg.norm(np.ptp(places, axis=0)) <= most:  # the diagonal of the box around them
            return
        for group, place in zip(self.groups, places, strict=True):
            away = np.linalg.norm(places - place, axis=1)
            if away.max() > most:
                other = self.groups[int(away.argmax())]
                problem = (
                    f"points that are {away.max():.5g} mm apart, more than the measuring range of "
                    f"{self.measuring_range_mm:g} mm"
                )
                hint = f"correct measuring_range_mm of the specification: {MEASURING_RANGE}"
                both = " and ".join(dict.fromkeys((group.where, other.where)))
                contradict(self.error(problem, group, hint, where=both))
                return

    def check_bars_apart(self, directions: int) -> None:
        """Check that each position of a length is a different one, and that its directions are as many as planned."""
        for members in split_groups(self.groups, "artefact", "length").values():
            positions = list(split_groups(members, "position").values())
            places = np.array(
                [
                    [next(one.points.mean(axis=0) for one in at if one.keys["end"] == end) for end in ENDS]
                    for at in positions
                ]
            )
            self.check_apart([at[0] for at in positions], places, SAME_PLACE_MM)
            along = places[:, 1] - places[:, 0]
            if (n := _count_directions(along)) < directions:
                raise self.error(
                    f"the plan asks for {directions} directions of the bar, {ANOTHER_DIRECTION_DEG:g} deg apart or "
                    f"more; its {len(positions)} positions had {n}",
                    members[0],
                    "place the bar along, across, upright and obliquely, or correct directions in the plan by your "
                    "copy of the standard",
                    where=f"length {members[0].keys['length']}",
                )

    def check_seats_spread(self, share: float) -> None:
        """Check that the seats are spread over the planned share of the measuring range."""
        at = np.array([group.points.mean(axis=0) for group in self.groups])
        spread, needed = float(np.linalg.norm(at[:, None] - at, axis=2).max()), share * self.measuring_range_mm
        if len(at) > 1 and spread < needed:
            raise self.error(
                f"the farthest two positions are {spread:.4g} mm apart, the plan asks for {needed:.4g} mm or more, "
                f"{share:.0%} of the measuring range",
                self.groups[0],
                "measure near, in the middle and far in the reach, or correct spread_share in the plan by your copy of "
                "the standard",
                where="",
            )

    def check_bars_stay(self, pairs: Sequence[tuple[LengthMeasurement, PointGroup]]) -> None:
        """Check that a length does not move between runs; remark runs with exchanged ends."""
        if self.measured.file is None:
            return
        firsts: dict[tuple[str, str, str], FloatArray] = {}
        turned = []
        for one, group in pairs:
            ends = np.array([one.start.mean(axis=0), one.end.mean(axis=0)])
            first = firsts.setdefault((one.bar.name, one.length.name, one.position), ends)
            away, away_turned = (float(np.linalg.norm(some - first, axis=1).max()) for some in (ends, ends[::-1]))
            if min(away, away_turned) > MOVED_MM:
                hint = "keep the bar in place for all runs of a position; check the position, and x, y and z"
                raise self.error(f"an end is {away:.4g} mm away from its place in the first run", group, hint)
            if away > MOVED_MM:
                turned.append(group.where)
        if turned:
            self.remarks.append(
                f"test {self.name!r}: ends A and B are exchanged compared with the first run, without effect on the "
                f"length: {join_names(turned, '; ')}"
            )

    def check_no_copies(self) -> None:
        """Check that no measurement is a copy of another one, moved or not, nor one of another test."""
        if self.measured.file is None:
            return
        groups, found = self.groups, find_copy(self.groups)
        if found is None and "end" not in groups[0].keys and (repeated := find_repeated(groups)) is not None:
            group, said, certain = repeated  # lengths may share an end
            if certain:
                found = group, said
            else:
                self.remarks.append(f"test {self.name!r}: {said}; measure it again if it is a copy")
        for other in takewhile(lambda one: one != self.name, self.measured.tests):
            if found is None and (found := find_shared(groups, self.measured.tests[other])) is not None:
                found = found[0], f"{found[1]} of test {other!r}"
        if found is not None:
            hint = "measure it again; if the coordinates are rounded, write them with more digits"
            contradict(self.error(f"{found[1]}: a copy", found[0], hint, where=""))

    def check_not_frozen(self, group: PointGroup) -> None:
        """Check that most points in a seat are not the same point.

        Rounded coordinates repeat by chance: of ten points with a noise of 10 um, written to 0.01 mm, at most two are
        the same in half of the seats, and never more than four in 4000 simulated ones.
        """
        if self.measured.file is None:
            return
        _, which, counts = np.unique(group.points, axis=0, return_inverse=True, return_counts=True)
        if 2 * counts.max() > len(group.points):
            same = (which == counts.argmax()).ravel()
            first, *rest = (f"line {line}" for line, one in zip(group.lines, same, strict=True) if one)
            raise self.error(
                f"the point of {first} is repeated in {join_names(rest)}, to the last digit: copies, or a program that "
                "sent an old point again",
                group,
                "measure the position again; if the coordinates are rounded, write them with more digits",
            )

    def check_apart(self, groups: Sequence[PointGroup], places: FloatArray, nearest_mm: float) -> None:
        """Check that positions differ: at least one of the k points of each, (n, k, 3), by `nearest_mm`."""
        for i in range(1, len(places)):
            away = [
                np.sqrt(((places[:i] - ends) ** 2).sum(axis=2)).max(axis=1) for ends in (places[i], places[i, ::-1])
            ]
            apart = np.minimum(*away)  # a bar turned end for end is at the same position
            near = int(apart.argmin())
            if apart[near] < nearest_mm:
                one, other = groups[near], groups[i]
                problem = f"{one.where} and {other.where} are {apart[near]:.2g} mm apart: one position, not two"
                raise self.error(problem, other, "move the artefact between positions", where="")

    def artefact(self, look_up: Callable[[str], A], group: PointGroup) -> A:
        """Look an artefact up; check its serial number, and that its certificate was valid on the group's date."""
        try:
            artefact = look_up(group.artefact)
            artefact.check_valid(group.date)
        except InputError as error:
            raise self.measured.error(error.problem, group, hint=error.hint) from None
        if isinstance(artefact, CalibratedSphere | CalibratedBar) and artefact.expansion_per_K:
            keys = [one for one in ("u_temperature_K", "u_expansion_per_K") if not getattr(artefact, one)]
            if keys and abs(group.degC - REFERENCE_DEGC) > MOST_K_EXACT:  # never of NaN, where it needs none
                away = f"measured more than {MOST_K_EXACT:g} K from 20 degC"
                problem = f"{' = 0, '.join(keys)} = 0 of {artefact.name!r}, {away}"
                hint = "enter what the thermometer and the expansion coefficient are uncertain by: 0.3 K, 1e-6 per K"
                contradict(self.measured.error(problem, group, hint=hint))
        if group.serial_number and artefact.serial_number is None:
            said = (
                f"the serial number {group.serial_number!r} that the points state of {artefact.name!r} was not "
                "compared: the file of artefacts states none"
            )
            self.remarks.extend([said] if said not in self.remarks else [])
        if group.serial_number and artefact.serial_number not in (None, group.serial_number):
            others = [one.name for one in self.artefacts.all if one.serial_number == group.serial_number]
            raise self.measured.error(
                f"points on {artefact.name!r}, which has the serial number {artefact.serial_number!r} by the file of "
                f"artefacts; here it is {group.serial_number!r}" + (f", that of {others[0]!r}" if others else ""),
                group,
                hint="check the columns artefact and artefact_serial_number, and that artefacts were not exchanged",
            )
        return artefact

    def _check_plausible(self, group: PointGroup, measured: float, calibrated: float) -> None:
        if abs(measured - calibrated) <= SAME_SHARE * calibrated:
            return
        hint = "check the artefact's name, and whether points are compensated or need tip_diameter_mm"
        for unit, factor in (("inches", 25.4), ("centimetres", 10.0), ("metres", 1000.0)):
            if abs(measured * factor - calibrated) <= SAME_SHARE * calibrated:
                hint = f"convert the points to mm: they seem to be in {unit}"
        problem = f"measured {measured:.5g} mm, the calibrated value of {group.artefact!r} is {calibrated:.5g} mm"
        raise self.error(problem, group, hint)

    def check_points(self, group: PointGroup, planned: int) -> None:
        """Check the number of points of a group."""
        self.check_count(group, f"points at {group.where}", len(group.points), planned)

    def split(self, key: str, planned: int) -> dict[str | tuple[str, ...], list[PointGroup]]:
        """Return the groups of each position or repeat; check their number, and that each is on one artefact."""
        by_key = split_groups(self.groups, key)
        self.check_count(self.groups[0], f"{key}s", by_key, planned)
        for members in by_key.values():
            for group in members:
                if group.artefact != members[0].artefact:
                    problem = f"points on {members[0].artefact!r} and on {group.artefact!r}"
                    hint = "measure one artefact at a position; check the column artefact"
                    raise self.error(problem, group, hint)
        return by_key

    def check_count(
        self, group: PointGroup, what: str, counted: int | Collection[str | tuple[str, ...]], planned: int
    ) -> None:
        """Check a number, or the number of names; a message lists them."""
        n = counted if isinstance(counted, int) else len(counted)
        if n == planned:
            return
        names = [] if isinstance(counted, int) else [one if isinstance(one, str) else " ".join(one) for one in counted]
        hint = "measure those that are missing" if n < planned else "remove those that are too many"
        raise self.error(
            f"the plan asks for {planned} {what}, got {n}"
            + (f": {join_names([quoted_cell(one) for one in names])}" if names else ""),
            group,
            f"{hint}, or change the plan (truearm verify plan) if your contract says so",
            where="",
        )


def sphere_centres(spheres: Sequence[SphereMeasurement]) -> FloatArray:
    """The centres of spheres, (n, 1, 3) [mm]."""
    return np.array([[one.fit.centre] for one in spheres])


def split_groups(groups: Iterable[PointGroup], *keys: str) -> dict[str | tuple[str, ...], list[PointGroup]]:
    """Groups by the values of some keys, in the order of the file."""
    by_key: dict[str | tuple[str, ...], list[PointGroup]] = {}
    for group in groups:
        values = tuple(group.artefact if key == "artefact" else group.keys[key] for key in keys)
        by_key.setdefault(values[0] if len(values) == 1 else values, []).append(group)
    return by_key


def _count_directions(along: FloatArray) -> int:
    """Number of directions (n, 3), either way, that are `ANOTHER_DIRECTION_DEG` apart: always the farthest one next."""
    cosines = np.abs((units := along / np.linalg.norm(along, axis=1, keepdims=True)) @ units.T)
    nearest, n = cosines[0], 1
    while (far := int(nearest.argmin())) >= 0 and nearest[far] <= np.cos(np.radians(ANOTHER_DIRECTION_DEG)):
        nearest, n = np.maximum(nearest, cosines[far]), n + 1
    return n
