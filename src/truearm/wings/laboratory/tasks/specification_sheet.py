"""Arms that conform to a specification sheet, if only the maker's limits are known.

Simulation by constraints: many virtual instruments are drawn, those are accepted whose simulated test results agree
with the known ones, and the task is simulated with these. Source: S. D. Phillips, B. Borchardt and others, "The
calculation of CMM measurement uncertainty via the method of simulation by constraints", Proc. ASPE 16 (1997) 443, from
memory; the abstract of NIST confirms it.

Assumptions:

- Every class of errors (`CLASSES`) has a magnitude of its own, log-uniform within a factor of `SPREAD` to both sides of
  the preset ``shop``.
- There is no prior knowledge of the common magnitude. Errors are small, so test results are proportional to it: instead
  of drawing until an arm agrees, each drawn arm is scaled until its worst test result is a share of its limit,
  log-uniform from `BEST_SHARE` to 1. The maker states limits that all arms of the type keep, and not far larger ones.
- An arm is rejected if another result is below `LEAST_SHARE` of its limit: nobody states limits far above the results.
  If all of `TRIES` arms are rejected, the nearest of them is used.

Only the worst result is therefore near its limit; each further limit improves the arms. An arm may be worse than most
of these and still conform: `share_of_limit` states the worst result of each.

Test results are to first order in the poses of the standards' tests, which are solved once (`posed_test`), on artefacts
without errors.

Errors of an arm are small: a least-squares sphere and a length are then linear in them, and many arms are judged by a
few matrix products.
"""

from __future__ import annotations

import datetime
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.typing import FloatArray, IntArray
from truearm.wings.laboratory.shapes.minimum_zone import circumscribed_diameters
from truearm.wings.laboratory.standards.artefacts import Artefacts
from truearm.wings.laboratory.standards.asme_b89_4_22 import DEVIATION_STATISTICS, SEAT_STATISTICS
from truearm.wings.laboratory.standards.layout import Placement, lay_out_tests
from truearm.wings.laboratory.standards.positions import ZONES
from truearm.wings.laboratory.standards.specification import SYMBOLS, Specification
from truearm.wings.laboratory.standards.verification_plan import PLANS, VerificationPlan, load_verification_plan
from truearm.wings.laboratory.tasks.posed_test import PosedTest, pose
from truearm.wings.laboratory.tasks.sampled_arms import ArmSample, PresetDistribution, PresetSample
from truearm.wings.planning.designs.workspace import stance
from truearm.wings.planning.virtual.error_model import (
    BEARINGS,
    CAGES,
    COMPLIANCE,
    DEFLECTION,
    ENCODERS,
    GEOMETRY,
    GROWTH,
    HYSTERESIS,
)
from truearm.wings.planning.virtual.presets import SHOP, Preset

# From errors (n, 3) [mm] in the poses of the tests to results over their limits, by symbol.
Judge = Callable[[FloatArray], dict[str, float]]
LENGTHS = ("E_Uni", "E_Bi")


@dataclass(frozen=True, eq=False)
class FirstOrderResults:
    """Test results relative to the limits of a specification.

    Parameters
    ----------
    specification : Specification
    placements : tuple of Placement
        Of all tests.
    """

    specification: Specification
    placements: tuple[Placement, ...]

    def __call__(self, errors: FloatArray) -> dict[str, float]:
        """Results over their limits by symbol, of errors (n, 3) [mm] in the poses of the tests."""
        results: dict[str, float] = {}
        for judge in self._judges:
            results |= judge(errors)
        # Lengths are over their limits already, each over its own.
        limits = {
            symbol: None if symbol in LENGTHS else self.specification.limit(symbol)
            for symbol in self.specification.limits
        }
        return {symbol: results[symbol] / (limit or 1.0) for symbol, limit in limits.items()}

    @cached_property
    def _judges(self) -> list[Judge]:
        """One per test."""
        by_test: dict[str, list[tuple[Placement, slice]]] = defaultdict(list)
        start = 0
        for one in self.placements:
            by_test[one.test].append((one, slice(start, start := start + len(one.points))))
        makers = {
            "probing": _probing,
            "effective_diameter": _effective_diameter,
            "articulation": _articulation,
            "uni": self._lengths,
            "single_point": _single_point,
            "volumetric": _volumetric,
        }
        return [makers[test](placed) for test, placed in by_test.items()]

    def _lengths(self, placed: list[tuple[Placement, slice]]) -> Judge:
        bars, stated = _Bars.of(placed), self.specification
        limits = {
            symbol: np.array([stated.limit(symbol, length) for length in bars.lengths_mm], dtype=float)
            for symbol in LENGTHS
            if symbol in stated.limits
        }

        def judge(errors: FloatArray) -> dict[str, float]:
            sizes = np.abs(bars.deviations(errors))
            return {symbol: float((sizes / limit).max()) for symbol, limit in limits.items()}

        return judge


def _probing(placed: list[tuple[Placement, slice]]) -> Judge:
    spheres = [(_SphereErrors.of(one), rows) for one, rows in placed]
    return lambda errors: {
        "P_Size.Sph.1x25": max(2 * abs(sphere.radius(errors[rows])) for sphere, rows in spheres),
        "P_Form.Sph.1x25": max(sphere.form(errors[rows]) for sphere, rows in spheres),
    }


def _effective_diameter(placed: list[tuple[Placement, slice]]) -> Judge:
    spheres = [(_SphereErrors.of(one), rows) for one, rows in placed]
    return lambda errors: {"EffectiveDiameter": max(2 * abs(sphere.radius(errors[rows])) for sphere, rows in spheres)}


def _articulation(placed: list[tuple[Placement, slice]]) -> Judge:
    at: dict[str, list[tuple[_SphereErrors, slice]]] = defaultdict(list)
    for one, rows in placed:
        at[one.keys["position"]].append((_SphereErrors.of(one), rows))

    def judge(errors: FloatArray) -> dict[str, float]:
        centres = np.array([[sphere.centre(errors[rows]) for sphere, rows in groups] for groups in at.values()])
        return {"L_Dia.5x5": float(circumscribed_diameters(centres).max())}

    return judge


def _single_point(placed: list[tuple[Placement, slice]]) -> Judge:
    return lambda errors: {
        symbol: max(float(statistic(errors[rows])) for _, rows in placed)
        for symbol, statistic in SEAT_STATISTICS.items()
    }


def _volumetric(placed: list[tuple[Placement, slice]]) -> Judge:
    bars = _Bars.of(placed)

    def judge(errors: FloatArray) -> dict[str, float]:
        off = bars.deviations(errors)
        others = {symbol: float(statistic(off)) for symbol, statistic in DEVIATION_STATISTICS.items()}
        return {"Volumetric.Max": float(np.abs(off).max()), **others}

    return judge


@dataclass(frozen=True, eq=False)
class _SphereErrors:
    """A least-squares sphere to first order: errors along the normals are ``n . dc + dr`` and residuals.

    Attributes
    ----------
    normals : (k, 3) array
    to_parameters : (4, k) array
        From errors along the normals to those of the centre and the radius.
    """

    normals: FloatArray
    to_parameters: FloatArray

    @classmethod
    def of(cls, placement: Placement) -> _SphereErrors:
        normals = placement.normals
        return cls(normals, np.linalg.pinv(np.column_stack([normals, np.ones(len(normals))])))

    def _along(self, errors: FloatArray) -> FloatArray:
        along: FloatArray = np.einsum("kc,kc->k", self.normals, errors)
        return along

    def centre(self, errors: FloatArray) -> FloatArray:
        return self.to_parameters[:3] @ self._along(errors)

    def radius(self, errors: FloatArray) -> float:
        return float(self.to_parameters[3] @ self._along(errors))

    def form(self, errors: FloatArray) -> float:
        along = self._along(errors)
        parameters = self.to_parameters @ along
        return float(np.ptp(along - self.normals @ parameters[:3]))


@dataclass(frozen=True, eq=False)
class _Bars:
    """Lengths between two ends, to first order: the difference of the errors of the ends along the length.

    Attributes
    ----------
    ends : (m, 2) array of int
        Rows of the two ends; one point each.
    along : (m, 3) array
        Unit vectors from the first end to the second.
    lengths_mm : (m,) array
    """

    ends: IntArray
    along: FloatArray
    lengths_mm: FloatArray

    @classmethod
    def of(cls, placed: Iterable[tuple[Placement, slice]]) -> _Bars:
        ends: dict[tuple[str, ...], dict[str, tuple[Placement, slice]]] = defaultdict(dict)
        for one, rows in placed:
            run = tuple(value for key, value in one.keys.items() if key != "end")
            ends[run][one.keys["end"]] = one, rows
        pairs = [(both["A"], both["B"]) for both in ends.values()]
        away = np.array([b.at - a.at for (a, _), (b, _) in pairs])
        lengths = np.linalg.norm(away, axis=1)
        first = np.array([[a.start, b.start] for (_, a), (_, b) in pairs], dtype=np.intp)
        return cls(first, away / lengths[:, None], lengths)

    def deviations(self, errors: FloatArray) -> FloatArray:
        """Measured minus true lengths (m,) [mm]."""
        deviations: FloatArray = np.einsum("mc,mc->m", self.along, errors[self.ends[:, 1]] - errors[self.ends[:, 0]])
        return deviations


BEST_SHARE, LEAST_SHARE = 0.5, 0.2
SPREAD = 5.0
TRIES = 20
# Classes of errors: groups of the virtual arm's terms, and magnitudes of the preset that are drawn at each point.
CLASSES: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "geometry": ((GEOMETRY,), ()),
    "encoders": ((ENCODERS,), ()),
    "bearings": ((BEARINGS,), ()),
    "compliance": ((COMPLIANCE,), ()),
    "thermal expansion": ((GROWTH,), ()),
    "hysteresis and ball cages": ((HYSTERESIS, CAGES), ()),
    "encoder noise": ((), ("encoder_noise_arcsec",)),
    "hand and contact": ((DEFLECTION,), ("tip_compliance_um_per_N", "seat_std_mm")),
}
# Largest reach of an arm of the sheet, over half the measuring range.
_MOST_REACH = 1.8
_SHEET = 7  # first word of the stream


@dataclass(frozen=True, eq=False)
class SpecificationDistribution:
    """Virtual arms that conform to a specification; the worst result of each is 50 % to 100 % of its limit.

    Parameters
    ----------
    arm : Arm
        Nominal arm of the sheet's type: its joints and links determine the propagation of errors.
    specification : Specification
        At least one limit.

    Raises
    ------
    InputError
        If no limit is stated, or the arm does not have the specification's measuring range.
    """

    arm: Arm
    specification: Specification

    def __post_init__(self) -> None:
        if not self.specification.limits:
            raise InputError("the specification states no limit", hint="add E_Uni = { B_um = 50 } under [limits]")
        reach, half = stance(self.arm).reach_mm, self.specification.measuring_range_mm / 2
        if reach > _MOST_REACH * half:
            raise InputError(
                f"the reach of arm {self.arm.name!r} from its shoulder, {reach:.0f} mm, is far larger than half the "
                f"measuring range of {2 * half:.0f} mm (a diameter)",
                hint="use --arm with an arm of the sheet's size",
            )
        # Solve the poses now, so that an arm that cannot reach the tests is refused here.
        _ = self.posed

    @cached_property
    def posed(self) -> PosedTest:
        """The tests of all limits, with joint angles for each point."""
        range_mm, shoulder = self.specification.measuring_range_mm, float(stance(self.arm).shoulder_in_base[2])
        placements: list[Placement] = []
        plans = {test: name for name in PLANS for test in load_verification_plan(name).tests}
        # The stylus of a virtual arm has its qualified diameter, so both ways of probing have the same errors.
        tests = ["uni" if symbol == "E_Bi" else SYMBOLS[symbol][0] for symbol in self.specification.limits]
        for name in dict.fromkeys(plans[test] for test in tests):
            plan = _required(load_verification_plan(name), set(tests))
            placements += lay_out_tests(plan, _perfect(plan, range_mm), range_mm, shoulder_mm=shoulder)
        return pose(placements, self.arm, seed=0)

    @cached_property
    def results(self) -> FirstOrderResults:
        """Test results over their limits, from errors (n, 3) [mm] in the poses of the tests."""
        return FirstOrderResults(self.specification, self.posed.placements)

    @cached_property
    def _shop(self) -> PresetDistribution:
        return PresetDistribution(self.arm, SHOP)

    def draw(self, seed: int) -> SpecificationSample:
        """Draw an arm that conforms to the specification."""
        rng = np.random.default_rng([_SHEET, seed])
        share = BEST_SHARE ** rng.random()
        nearest: tuple[float, PresetSample, dict[str, float]] | None = None
        for _ in range(TRIES):
            drawn = self._draw_arm(rng)
            results = self.results(drawn.systematic(self.posed.angles) + drawn.random(self.posed.angles, rng))
            evenness = min(results.values()) / max(results.values())
            if nearest is None or evenness > nearest[0]:
                nearest = evenness, drawn, results
            if evenness * share >= LEAST_SHARE:
                break
        assert nearest is not None
        _, drawn, results = nearest
        factor = share / max(results.values())
        return SpecificationSample(drawn, factor, {symbol: factor * ratio for symbol, ratio in results.items()})

    def _draw_arm(self, rng: np.random.Generator) -> PresetSample:
        """An arm of the shop preset with each class of errors larger or smaller."""
        groups: dict[str, float] = {}
        magnitudes: dict[str, float] = {}
        for in_class, at_points in CLASSES.values():
            factor = SPREAD ** rng.uniform(-1, 1)
            groups |= dict.fromkeys(in_class, factor)
            magnitudes |= {name: factor * getattr(SHOP, name) for name in at_points}
        sample = self._shop.draw(int(rng.integers(2**62)))
        virtual = sample.virtual
        preset: Preset = replace(SHOP, name="shop, scaled", **magnitudes)  # type: ignore[arg-type]
        return replace(sample, virtual=replace(virtual, preset=preset, systematic=virtual.systematic.scaled(groups)))


@dataclass(frozen=True, eq=False)
class SpecificationSample:
    """A virtual arm, its errors scaled until it conforms to the sheet.

    Parameters
    ----------
    drawn : PresetSample
    factor : float
        Scale of all its errors.
    results : dict of str to float
        Simulated test results over their limits, by symbol.
    """

    drawn: PresetSample
    factor: float
    results: Mapping[str, float]

    def systematic(self, angles: FloatArray) -> FloatArray:
        """See `truearm.wings.laboratory.tasks.sampled_arms.ArmSample`."""
        return self.factor * self.drawn.systematic(angles)

    def random(self, angles: FloatArray, rng: np.random.Generator) -> FloatArray:
        """See `truearm.wings.laboratory.tasks.sampled_arms.ArmSample`."""
        return self.factor * self.drawn.random(angles, rng)


def share_of_limit(drawn: ArmSample) -> float:
    """Worst test result over its limit of an arm drawn from a sheet: 1 for an arm at its limit."""
    assert isinstance(drawn, SpecificationSample)
    return max(drawn.results.values())


def _required(plan: VerificationPlan, wanted: set[str]) -> VerificationPlan:
    """A plan with the wanted tests only, all of them required."""
    tests = {
        name: test.model_copy(update={"required": True}) if name in wanted else None
        for name, test in plan.tests.items()
    }
    return plan.model_copy(update=tests)


def _perfect(plan: VerificationPlan, range_mm: float) -> Artefacts:
    """Artefacts without errors, of the sizes of the plan."""
    lengths = [0.5 * float(np.mean(zone)) for zone in ZONES]
    if plan.uni is not None:
        n, longest = plan.uni.lengths.value, plan.uni.longest_share.value
        shortest = min(longest / n, plan.uni.shortest_most_share.value * (1 - 1e-8))
        lengths = [float(share) for share in np.linspace(shortest, longest, n)]
    day = datetime.date(2000, 1, 1)
    seat = {"certificate": "none", "date": day, "expires": day.replace(year=9999), "form_mm": 0.0, "u_fixture_mm": 0.0}
    constant = {**seat, "expansion_per_K": 0.0, "u_expansion_per_K": 0.0, "u_temperature_K": 0.0}
    certified = [
        # Slightly longer than the plan's share, so that rounding does not make it too short or long.
        {"name": f"{i}", "length_mm": share * range_mm * (1 + 1e-9), "u_mm": 1e-9}
        for i, share in enumerate(lengths)
    ]
    return Artefacts.model_validate(
        {
            "spheres": [{"name": "ball", "diameter_mm": 25.0, "u_diameter_mm": 1e-9, **constant}],
            "bars": [{"name": "bar", "lengths": certified, **constant}],
            "seats": [{"name": "seat", **seat}],
        }
    )
