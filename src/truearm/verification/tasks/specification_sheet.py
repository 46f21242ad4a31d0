"""Arms that keep a specification sheet: what is known of an arm if only its maker's promises are known.

Simulation by constraints: many virtual instruments are drawn, those are kept whose simulated test results agree with
what is known of the tests, and the task is simulated with the ones kept. Source: S. D. Phillips, B. Borchardt and
others, "The calculation of CMM measurement uncertainty via the method of simulation by constraints", Proc. ASPE 16
(1997) 443, recalled; the abstract of NIST says as much.

What stands behind it is chosen:

- Every class of error (`CLASSES`) has a size of its own, drawn evenly in the logarithm over a factor of `SPREAD` to
  both sides of the preset ``shop``.
- Nothing is known beforehand of the size of them all together. As errors are small, test results grow in proportion to
  it; so instead of drawing until one agrees, each drawn arm is given a size with which it does: its worst test result
  comes to a share of its limit, drawn evenly in the logarithm from `BEST_SHARE` to 1. The maker promises what all arms
  of the kind keep, and not far more.
- An arm is refused if another result is below `LEAST_SHARE` of its limit: nobody promises many times what the arm
  needs. If none of `TRIES` arms is better, the one of them that comes nearest is taken.

So only the worst result is near its limit, the others stay well below theirs; each limit that is stated besides makes
the arms better. An arm may be worse than most of these and keep its sheet: `share_of_limit` tells how far each is.

Test results are taken to first order at the poses of the standard's tests, which are found once (`standard_test.pose`),
on artefacts without errors.
"""

from __future__ import annotations

import datetime
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.planning.sampling.workspace import stance
from truearm.identification.virtual.error_model import (
    BEARINGS,
    CAGES,
    COMPLIANCE,
    DEFLECTION,
    ENCODERS,
    GEOMETRY,
    GROWTH,
    HYSTERESIS,
)
from truearm.identification.virtual.presets import SHOP, Preset
from truearm.typing import FloatArray
from truearm.verification.shapes.circumscribed_sphere import circumscribed_sphere
from truearm.verification.standards.artefacts import Artefacts
from truearm.verification.standards.layout import ZONES, Placement, lay_out_tests
from truearm.verification.standards.specification import Specification
from truearm.verification.standards.verification_plan import VerificationPlan, load_verification_plan
from truearm.verification.tasks.sampled_arms import ArmSample, PresetDistribution, PresetSample
from truearm.verification.tasks.simulated_verification import PosedTest, pose

# From errors (n, 3) [mm] at the poses of the tests to results over their limits, by symbol.
Judge = Callable[[FloatArray], dict[str, float]]

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
_TESTS = {
    "P_Size.Sph.1x25": ("iso10360-12", "probing"),
    "P_Form.Sph.1x25": ("iso10360-12", "probing"),
    "L_Dia.5x5": ("iso10360-12", "articulation"),
    "E_Uni": ("iso10360-12", "uni"),
    # The virtual arms' stylus has the diameter that it was qualified for, so both ways of probing err alike.
    "E_Bi": ("iso10360-12", "uni"),
    "EffectiveDiameter": ("asme-b89.4.22", "effective_diameter"),
    "SPAT.Max": ("asme-b89.4.22", "single_point"),
    "SPAT.2s": ("asme-b89.4.22", "single_point"),
    "Volumetric.Max": ("asme-b89.4.22", "volumetric"),
    "Volumetric.2s": ("asme-b89.4.22", "volumetric"),
    "Volumetric.2RMS": ("asme-b89.4.22", "volumetric"),
}
# An arm whose links reach farther than this many halves of the measuring range is not the sheet's.
_MOST_REACH = 1.8
_SHEET = 7  # first word of the streams drawn from here


@dataclass(frozen=True, eq=False)
class SpecificationDistribution:
    """Virtual arms that keep a specification, the worst result of each half to all of its limit.

    Parameters
    ----------
    arm : Arm
        Nominal, of the kind that the sheet is of: its joints and links say how errors add up.
    specification : Specification
        At least one limit.

    Raises
    ------
    InputError
        If no limit is stated, or the arm is not of the specification's measuring range.
    """

    arm: Arm
    specification: Specification

    def __post_init__(self) -> None:
        if not self.specification.limits:
            raise InputError("the specification states no limit", hint="E_Uni = { B_um = 50 } under [limits]")
        reach, half = stance(self.arm).reach_mm, self.specification.measuring_range_mm / 2
        if reach > _MOST_REACH * half:
            raise InputError(
                f"the links of arm {self.arm.name!r} reach {reach:.0f} mm from its shoulder, far beyond the measuring "
                f"range of {2 * half:.0f} mm (a diameter)",
                hint="--arm with an arm of the sheet's size",
            )
        # Posed at once, so that an arm that cannot take the tests is refused here.
        _ = self.posed

    @cached_property
    def posed(self) -> PosedTest:
        """The tests of all limits, each point with joint angles."""
        range_mm, shoulder = self.specification.measuring_range_mm, float(stance(self.arm).shoulder_in_base[2])
        placements: list[Placement] = []
        for name in dict.fromkeys(_TESTS[symbol][0] for symbol in self.specification.limits):
            plan = _required(load_verification_plan(name), {_TESTS[symbol] for symbol in self.specification.limits})
            placements += lay_out_tests(plan, _perfect(plan, range_mm), range_mm, shoulder_mm=shoulder)
        return pose(placements, self.arm, seed=0)

    def results(self, errors: FloatArray) -> dict[str, float]:
        """Test results over their limits by symbol, of errors (n, 3) [mm] at the poses of the tests."""
        found: dict[str, float] = {}
        for judge in self._judges:
            found |= judge(errors)
        return {symbol: found[symbol] for symbol in self.specification.limits}

    def draw(self, seed: int) -> SpecificationSample:
        """Draw an arm that keeps the specification."""
        rng = np.random.default_rng([_SHEET, seed])
        share = BEST_SHARE ** rng.random()
        nearest: tuple[float, PresetSample, dict[str, float]] | None = None
        for _ in range(TRIES):
            drawn = self._draw_arm(rng)
            found = self.results(drawn.systematic(self.posed.angles) + drawn.random(self.posed.angles, rng))
            even = min(found.values()) / max(found.values())
            if nearest is None or even > nearest[0]:
                nearest = even, drawn, found
            if even * share >= LEAST_SHARE:
                break
        assert nearest is not None
        _, drawn, found = nearest
        factor = share / max(found.values())
        return SpecificationSample(drawn, factor, {symbol: factor * ratio for symbol, ratio in found.items()})

    def _draw_arm(self, rng: np.random.Generator) -> PresetSample:
        """An arm of the shop preset with each class of errors larger or smaller."""
        groups: dict[str, float] = {}
        magnitudes: dict[str, float] = {}
        for in_class, at_points in CLASSES.values():
            factor = SPREAD ** rng.uniform(-1, 1)
            groups |= dict.fromkeys(in_class, factor)
            magnitudes |= {name: factor * getattr(SHOP, name) for name in at_points}
        sample = PresetDistribution(self.arm, SHOP).draw(int(rng.integers(2**62)))
        virtual = sample.virtual
        preset: Preset = replace(SHOP, name="shop, scaled", **magnitudes)  # type: ignore[arg-type]
        return replace(sample, virtual=replace(virtual, preset=preset, systematic=virtual.systematic.scaled(groups)))

    @cached_property
    def _judges(self) -> list[Judge]:
        """One a test."""
        starts = np.concatenate([[0], np.cumsum([len(one.points) for one in self.posed.placements])])
        by_test: dict[str, list[tuple[Placement, slice]]] = defaultdict(list)
        for i, one in enumerate(self.posed.placements):
            by_test[one.test].append((one, slice(int(starts[i]), int(starts[i + 1]))))
        makers: dict[str, Callable[[list[tuple[Placement, slice]]], Judge]] = {
            "probing": self._probing,
            "effective_diameter": self._effective_diameter,
            "articulation": self._articulation,
            "uni": self._lengths,
            "single_point": self._single_point,
            "volumetric": self._volumetric,
        }
        return [makers[test](placed) for test, placed in by_test.items()]

    def _over(self, symbol: str, value: float, length_mm: float | None = None) -> float:
        limit = self.specification.limit(symbol, length_mm)
        return np.inf if limit is None else value / limit

    def _stated(self, **values: float) -> dict[str, float]:
        """Those of the values that have a limit, over it; symbols have stops in place of underlines."""
        named = {name.replace("_", "."): value for name, value in values.items()}
        return {s: self._over(s, value) for s, value in named.items() if s in self.specification.limits}

    def _probing(self, placed: list[tuple[Placement, slice]]) -> Judge:
        spheres = [(_SphereErrors.of(one), rows) for one, rows in placed]

        def judge(errors: FloatArray) -> dict[str, float]:
            sizes = max(2 * abs(sphere.radius(errors[rows])) for sphere, rows in spheres)
            forms = max(sphere.form(errors[rows]) for sphere, rows in spheres)
            found = {"P_Size.Sph.1x25": sizes, "P_Form.Sph.1x25": forms}
            return {s: self._over(s, value) for s, value in found.items() if s in self.specification.limits}

        return judge

    def _effective_diameter(self, placed: list[tuple[Placement, slice]]) -> Judge:
        spheres = [(_SphereErrors.of(one), rows) for one, rows in placed]
        return lambda errors: self._stated(
            EffectiveDiameter=max(2 * abs(sphere.radius(errors[rows])) for sphere, rows in spheres)
        )

    def _articulation(self, placed: list[tuple[Placement, slice]]) -> Judge:
        at: dict[str, list[tuple[_SphereErrors, slice]]] = defaultdict(list)
        for one, rows in placed:
            at[one.keys["position"]].append((_SphereErrors.of(one), rows))

        def judge(errors: FloatArray) -> dict[str, float]:
            centres = [np.stack([sphere.centre(errors[rows]) for sphere, rows in groups]) for groups in at.values()]
            return {"L_Dia.5x5": self._over("L_Dia.5x5", max(2 * circumscribed_sphere(c).radius_mm for c in centres))}

        return judge

    def _lengths(self, placed: list[tuple[Placement, slice]]) -> Judge:
        bars = _Bars.of(placed)
        limits = {
            symbol: np.array([self.specification.limit(symbol, length) for length in bars.lengths_mm], dtype=float)
            for symbol in ("E_Uni", "E_Bi")
            if symbol in self.specification.limits
        }

        def judge(errors: FloatArray) -> dict[str, float]:
            sizes = np.abs(bars.deviations(errors))
            return {symbol: float((sizes / limit).max()) for symbol, limit in limits.items()}

        return judge

    def _single_point(self, placed: list[tuple[Placement, slice]]) -> Judge:
        def judge(errors: FloatArray) -> dict[str, float]:
            away = [errors[rows] - errors[rows].mean(axis=0) for _, rows in placed]
            squares = [(off**2).sum(axis=1) for off in away]
            return self._stated(
                SPAT_Max=max(float(np.sqrt(s.max())) for s in squares),
                SPAT_2s=max(2 * float(np.sqrt(s.sum() / (len(s) - 1))) for s in squares),
            )

        return judge

    def _volumetric(self, placed: list[tuple[Placement, slice]]) -> Judge:
        bars = _Bars.of(placed)

        def judge(errors: FloatArray) -> dict[str, float]:
            off = bars.deviations(errors)
            return self._stated(
                Volumetric_Max=float(np.abs(off).max()),
                Volumetric_2s=2 * float(off.std(ddof=1)),
                Volumetric_2RMS=2 * float(np.sqrt((off**2).mean())),
            )

        return judge


@dataclass(frozen=True, eq=False)
class SpecificationSample:
    """A virtual arm, its errors made so large that it keeps the sheet.

    Parameters
    ----------
    drawn : PresetSample
    factor : float
        By which all its errors are taken.
    results : dict of str to float
        Of its simulated tests, over their limits, by symbol.
    """

    drawn: PresetSample
    factor: float
    results: Mapping[str, float]

    def systematic(self, angles: FloatArray) -> FloatArray:
        """See `truearm.verification.tasks.sampled_arms.ArmSample`."""
        return self.factor * self.drawn.systematic(angles)

    def random(self, angles: FloatArray, rng: np.random.Generator) -> FloatArray:
        """See `truearm.verification.tasks.sampled_arms.ArmSample`."""
        return self.factor * self.drawn.random(angles, rng)


def share_of_limit(drawn: ArmSample) -> float:
    """The worst result of an arm drawn from a sheet over its limit: 1 for an arm that just keeps the sheet."""
    assert isinstance(drawn, SpecificationSample)
    return max(drawn.results.values())


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
        found = self.to_parameters @ along
        return float(np.ptp(along - self.normals @ found[:3]))


@dataclass(frozen=True, eq=False)
class _Bars:
    """Lengths between two ends, to first order: the difference of their errors along them.

    Attributes
    ----------
    ends : (m, 2) array of int
        Rows of either end; of one point each.
    along : (m, 3) array
        Unit vectors from the one to the other.
    lengths_mm : (m,) array
    """

    ends: npt.NDArray[np.intp]
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
        """Measured less true lengths (m,) [mm]."""
        found: FloatArray = np.einsum("mc,mc->m", self.along, errors[self.ends[:, 1]] - errors[self.ends[:, 0]])
        return found


def _required(plan: VerificationPlan, wanted: set[tuple[str, str]]) -> VerificationPlan:
    """A plan with the wanted tests alone, all of them required."""
    tests = {
        name: test.model_copy(update={"required": True}) if (plan.name, name) in wanted else None
        for name, test in plan.tests.items()
    }
    return plan.model_copy(update=tests)


def _perfect(plan: VerificationPlan, range_mm: float) -> Artefacts:
    """Artefacts without errors, of sizes that the plan wants."""
    lengths = [0.5 * float(np.mean(zone)) for zone in ZONES]
    if plan.uni is not None:
        n, longest = plan.uni.lengths.value, plan.uni.longest_share.value
        lengths = [float(share) for share in np.linspace(longest / n, longest, n)]
    day = datetime.date(2000, 1, 1)
    seat = {"certificate": "none", "date": day, "expires": day.replace(year=9999), "form_mm": 0.0, "u_fixture_mm": 0.0}
    still = {**seat, "expansion_per_K": 0.0, "u_expansion_per_K": 0.0, "u_temperature_K": 0.0}
    certified = [
        # A hair longer than the plan's share, which it must not miss by rounding.
        {"name": f"{i}", "length_mm": share * range_mm * (1 + 1e-9), "u_mm": 1e-9}
        for i, share in enumerate(lengths)
    ]
    return Artefacts.model_validate(
        {
            "spheres": [{"name": "ball", "diameter_mm": 25.0, "u_diameter_mm": 1e-9, **still}],
            "bars": [{"name": "bar", "lengths": certified, **still}],
            "seats": [{"name": "seat", **seat}],
        }
    )
