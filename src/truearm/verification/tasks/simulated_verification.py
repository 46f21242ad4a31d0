"""A standard's test taken by virtual arms, to see what an arm would pass.

The points of a layout are posed once for the nominal arm. Each virtual arm then shows them with its systematic errors
at these poses and random ones at each point, on artefacts whose true sizes are drawn within their certificates; what it
shows is judged by `truearm.verification.standards.verification.verify`, as points from a file are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.planning.sampling.measuring import check_five_rotary_joints, inner_limits, postures, reach
from truearm.identification.planning.sampling.seat import farthest_points
from truearm.identification.planning.sampling.workspace import azimuth_of, stance, within_cone
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray
from truearm.verification.standards.artefacts import Artefacts, CalibratedBar, CalibratedSphere, Seat
from truearm.verification.standards.decision import ConformityResult, DecisionRule, Verdict
from truearm.verification.standards.layout import Placement
from truearm.verification.standards.measured_points import MeasuredPoints, PointGroup
from truearm.verification.standards.specification import Specification
from truearm.verification.standards.verification import Verification, verify
from truearm.verification.standards.verification_plan import VerificationPlan
from truearm.verification.tasks.sampled_arms import ArmDistribution, ArmSample

# A group is taken in one posture: the elbow swings and the handle rolls from group to group, little within one.
SWING_DEG, ROLL_DEG, WITHIN_DEG, NEAR_DEG = 35.0, 60.0, 3.0, 45.0
# The stylus may lean off the wanted direction, the more the longer no pose is found.
LEANS_DEG = (0.0,) * 6 + (15.0,) * 6 + (30.0,) * 6 + (45.0,) * 6 + (60.0,) * 12
# In a seat: postures from the working pose at most so far, joint by joint; candidates a point, and how often again.
SEAT_LEAN_DEG, SEAT_SWING_DEG, SEAT_POOL, SEAT_TRIES = 60.0, 100.0, 10, 10
MAX_ARMS = 100_000
# Kept apart from the streams of the arms' own errors.
_POSES, _POINTS = 4, 5


@dataclass(frozen=True, eq=False)
class PosedTest:
    """A layout with joint angles for each of its points, found once for the nominal arm.

    Attributes
    ----------
    arm : Arm
    placements : tuple of Placement
    angles : (n, n_joints) array
        Poses that put the nominal tip on the points, placement by placement [rad].
    placement : (n,) array of int
        Which placement each belongs to.
    """

    arm: Arm
    placements: tuple[Placement, ...]
    angles: FloatArray
    placement: npt.NDArray[np.intp]

    @property
    def points(self) -> FloatArray:
        """The nominal points, (n, 3) [mm]."""
        return np.concatenate([one.points for one in self.placements])


def pose(layout: Sequence[Placement], arm: Arm, *, seed: int) -> PosedTest:
    """Find joint angles for every point of a layout.

    The points of one group are taken in nearly one posture, another for each group, about the working pose turned to
    the artefact; the points of one seat in postures as different as can be, the stylus within 60 deg of its axis.
    Elsewhere the stylus points against the wanted approach; where no posture allows that, it leans up to 60 deg off it.

    Parameters
    ----------
    layout : sequence of Placement
    arm : Arm
        Base z up, at least five turning joints.
    seed : int

    Raises
    ------
    InputError
        If the arm has too few joints, or points are not reached: which, and why.
    """
    check_five_rotary_joints(arm)
    rng = np.random.default_rng([_POSES, seed])
    layout = tuple(layout)
    sizes = np.array([len(one.points) for one in layout])
    placement = np.repeat(np.arange(len(layout)), sizes)
    angles = np.full((len(placement), arm.n_joints), np.nan)
    free = np.array([one.test != "single_point" for one in layout])
    stands = stance(arm)
    points = np.concatenate([one.points for one in layout])
    beyond = np.linalg.norm(points - stands.shoulder_in_base, axis=1) > stands.reach_mm
    missed = Counter((int(i), "beyond the arm's links") for i in placement[beyond])
    if not missed:
        for i in np.flatnonzero(~free):
            found = _in_seat(layout[i], arm, rng)
            if found is None:
                missed[int(i), "too few postures"] = len(layout[i].points)
            else:
                angles[placement == i] = found
        missed += _posed(layout, arm, angles, placement, free[placement], rng)
    if missed:
        raise InputError(
            f"arm {arm.name!r} does not reach {missed.total()} of {len(placement)} points: {_told(layout, missed)}",
            hint=f"a smaller measuring range (the links from its shoulder on add up to {stands.reach_mm:.0f} mm, "
            "twice that is the most), or a plan of your own (--print-plan) without these places: fewer positions, or "
            "required = false",
        )
    return PosedTest(arm, layout, angles, placement)


def _told(layout: Sequence[Placement], missed: Mapping[tuple[int, str], int]) -> str:
    """Which tests are out of reach, at which positions and why; lengths and groups where others are reached."""
    out = []
    for test in dict.fromkeys(one.test for one in layout):
        why: Counter[str] = Counter()
        for (i, reason), count in missed.items():
            if layout[i].test == test:
                why[reason] += count
        if not why:
            continue
        words = [test]
        for key in ("position", "length", "group"):
            planned = dict.fromkeys(one.keys[key] for one in layout if one.test == test and key in one.keys)
            those = {layout[i].keys.get(key) for i, _ in missed if layout[i].test == test}
            named = [value for value in planned if value in those]
            if len(named) == 1 or len(named) < len(planned):
                words.append(f"{key} {' '.join(named)}")
            elif planned and key == "position":
                words.append(f"all {len(planned)} positions")
        reasons = [f"{reason} ({count} x)" if count > 1 else reason for reason, count in why.items()]
        out.append(f"{', '.join(words)}: {', '.join(reasons)}")
    return "; ".join(out)


def _in_seat(one: Placement, arm: Arm, rng: np.random.Generator) -> FloatArray | None:
    """Postures with the tip in a seat, as different as can be, (k, n_joints) [rad]; None if they are too few."""
    k = len(one.points)
    m = SEAT_POOL * k
    tips, axes, stands = np.tile(one.at, (m, 1)), np.tile(-one.approach[0], (m, 1)), stance(arm)
    good = np.empty((0, arm.n_joints))
    for _ in range(SEAT_TRIES):
        posture = arm.working + np.radians(SEAT_SWING_DEG) * rng.uniform(-1, 1, (m, arm.n_joints))
        posture[:, 0] += azimuth_of(tips, stands)
        leaning = within_cone(axes, half_angle_rad=np.radians(SEAT_LEAN_DEG), rng=rng)
        angles, reason = reach(arm, tips, leaning, np.clip(posture, *inner_limits(arm)))
        good = np.concatenate([good, angles[reason == ""]])
        if len(good) >= 3 * k:
            break
    return good[farthest_points(good, k)] if len(good) >= k else None


def _posed(
    layout: tuple[Placement, ...],
    arm: Arm,
    angles: FloatArray,
    placement: npt.NDArray[np.intp],
    free: npt.NDArray[np.bool_],
    rng: np.random.Generator,
) -> Counter[tuple[int, str]]:
    """Fill in angles row by row; which points are left, by placement and reason, with their number."""
    if not free.any():
        return Counter()
    points = np.concatenate([one.points for one in layout])
    approach = np.concatenate([one.approach for one in layout])
    middles = np.stack([one.at for one in layout])
    stands, limits = stance(arm), inner_limits(arm)
    why = np.full(len(points), "", dtype=object)
    sizes = np.bincount(placement, minlength=len(layout))
    # How far the joints move within a group whose points were all reached at once.
    spread = np.where(np.bincount(placement, free, len(layout)) > 0, np.inf, 0.0)
    for before, lean in zip((0.0, *LEANS_DEG), LEANS_DEG, strict=False):
        if lean > before:  # what is whole stays: the stylus is better where it is wanted
            spread[np.isfinite(spread)] = 0.0
        rows = np.flatnonzero((spread > np.radians(NEAR_DEG))[placement])
        if not len(rows):
            break
        drawn = postures(arm, middles, stands, swing_std_deg=SWING_DEG, roll_std_deg=ROLL_DEG, rng=rng)
        near = drawn[placement[rows]] + np.radians(WITHIN_DEG) * rng.standard_normal((len(rows), arm.n_joints))
        axes = -approach[rows]
        if lean > 0:
            axes = within_cone(axes, half_angle_rad=np.radians(lean), rng=rng)
        found, reason = reach(arm, points[rows], axes, np.clip(near, *limits))
        got = reason == ""
        why[rows[~got]] = reason[~got]
        for i in np.flatnonzero(np.bincount(placement[rows], got, len(layout)) == sizes):
            if (range_of_group := np.ptp(found[placement[rows] == i], axis=0).max(initial=0.0)) < spread[i]:
                spread[i], angles[placement == i] = range_of_group, found[placement[rows] == i]
        first = got & np.isnan(angles[rows, 0])
        angles[rows[first]] = found[first]
    left = np.flatnonzero(free & np.isnan(angles[:, 0]))
    return Counter((int(placement[row]), str(why[row])) for row in left)


def simulate_verification(
    errors: ArmDistribution,
    posed: PosedTest,
    *,
    plan: VerificationPlan,
    artefacts: Artefacts,
    specification: Specification,
    n_arms: int,
    seed: int,
    rule: DecisionRule = "iso14253-1",
    progress: Callable[[int], None] | None = None,
) -> tuple[Verification, ...]:
    """Take a test with virtual arms.

    Parameters
    ----------
    errors : ArmDistribution
        What the arms may be wrong by.
    posed : PosedTest
    plan, artefacts, specification, rule
        As of `verify`.
    n_arms : int
        How many arms are drawn.
    seed : int
        Which: no two seeds share an arm.
    progress : callable, optional
        Told the number of arms done.

    Returns
    -------
    tuple of Verification
        One an arm.

    Raises
    ------
    InputError
        As `verify`; it cannot judge an arm that errs so much that an artefact seems to be another.
    """
    if not 1 <= n_arms <= MAX_ARMS:
        raise InputError(f"expected 1 to {MAX_ARMS} virtual arms, got {n_arms}")
    out = []
    for i in range(n_arms):
        own = MAX_ARMS * seed + i
        points = simulate_points(errors.draw(own), posed, artefacts, seed=own)
        try:
            found = verify(points, plan=plan, artefacts=artefacts, specification=specification, rule=rule)
        except InputError as error:
            hint = error.hint if error.hint and "artefact's name" not in error.hint else "an arm that errs less"
            raise InputError(f"virtual arm {i + 1}: {error.problem}", hint=hint) from None
        out.append(found)
        if progress is not None:
            progress(i + 1)
    return tuple(out)


def simulate_points(drawn: ArmSample, posed: PosedTest, artefacts: Artefacts, *, seed: int) -> MeasuredPoints:
    """The points that one virtual arm shows.

    The artefacts are as their certificates allow. Sizes and temperatures are drawn as normal with the stated standard
    uncertainties, once for each artefact; the fixture's, so that a length or a place in one direction errs by it, for
    each group; and each point lies off a perfect ball by up to half the form deviation, evenly, as a seat does in each
    direction. All stands at 20 degC, as thermometers show it.
    """
    rng = np.random.default_rng([_POINTS, seed])
    true = _true_points(posed.placements, artefacts, rng)
    shown = np.concatenate(true) + drawn.systematic(posed.angles) + drawn.random(posed.angles, rng)
    each = np.split(shown, np.cumsum([len(one) for one in true])[:-1])
    dates = {one.name: one.date for one in _all(artefacts)}
    return MeasuredPoints.of(
        (
            one.test,
            PointGroup(
                artefact=one.artefact,
                keys=dict(one.keys),
                points=points,
                degC=REFERENCE_DEGC,
                tip_mm=0.0,
                date=dates[one.artefact],
            ),
        )
        for one, points in zip(posed.placements, each, strict=True)
    )


def _true_points(placements: Sequence[Placement], artefacts: Artefacts, rng: np.random.Generator) -> list[FloatArray]:
    """Where the points of each placement truly are, (k, 3) [mm]."""
    known = {one.name: one for one in _all(artefacts)}
    growth = {
        name: 0.0 if isinstance(one, Seat) else one.expansion_per_K * one.u_temperature_K * rng.standard_normal()
        for name, one in known.items()
    }
    diameters = {one.name: one.diameter_mm + one.u_diameter_mm * rng.standard_normal() for one in artefacts.spheres}
    # By how much a length is longer than its certificate says.
    longer = {
        (bar.name, length.name): length.length_mm * growth[bar.name] + length.u_mm * rng.standard_normal()
        for bar in artefacts.bars
        for length in bar.lengths
    }
    starts = {_pair(one): one.at for one in placements if one.keys.get("end") == "A"}
    out = []
    for one in placements:
        artefact = known[one.artefact]
        ends = 2 if "end" in one.keys else 1  # each end has its share
        middle = one.at + artefact.u_fixture_mm / np.sqrt(ends) * rng.standard_normal(3)
        if isinstance(artefact, CalibratedSphere):
            radius = diameters[artefact.name] / 2 * (1 + growth[artefact.name])
            off = artefact.form_mm * rng.uniform(-0.5, 0.5, (len(one.points), 1))
            out.append(middle + (radius + off) * one.normals)
            continue
        if one.keys.get("end") == "B":
            along = one.at - starts[_pair(one)]
            middle = middle + longer[one.artefact, one.keys["length"]] * along / np.linalg.norm(along)
        out.append(middle + artefact.form_mm * rng.uniform(-0.5, 0.5, (len(one.points), 3)))
    return out


def _pair(one: Placement) -> tuple[str, ...]:
    """What both ends of a measured length have in common."""
    return (one.test, one.artefact, *(value for key, value in one.keys.items() if key != "end"))


def _all(artefacts: Artefacts) -> tuple[CalibratedSphere | CalibratedBar | Seat, ...]:
    return (*artefacts.spheres, *artefacts.bars, *artefacts.seats)


@dataclass(frozen=True)
class ResultDistribution:
    """How one row of the test is distributed over the virtual arms.

    Attributes
    ----------
    label : str
    unit : str
    median, high : float
        Of the test value's magnitude over the arms: half of them, and 95 % of them have less.
    limit : float or None
    conform, not_conform, undecided : float
        Shares of the arms; all 0 where there is no limit.
    """

    label: str
    unit: str
    median: float
    high: float
    limit: float | None
    conform: float
    not_conform: float
    undecided: float


def result_distributions(found: Sequence[Verification]) -> tuple[ResultDistribution, ...]:
    """The rows of a test over the arms that took it."""
    labels = Counter(row.label for row in found[0].rows)
    return tuple(
        _distribution(rows, labels[rows[0].label] > 1) for rows in zip(*(one.rows for one in found), strict=True)
    )


def verdict_shares(found: Sequence[Verification]) -> Mapping[Verdict, float]:
    """Shares of the arms by the verdict of the whole test."""
    return {verdict: sum(one.verdict is verdict for one in found) / len(found) for verdict in Verdict}


def proportion_interval(count: int, n: int) -> tuple[float, float]:
    """Between which bounds a share lies of which n draws show `count`, with 95 % confidence.

    Source: Clopper and Pearson, Biometrika 26 (1934), 404: each bound is the share from which as many or more, or as
    few or fewer, come with 2.5 %; they are quantiles of beta distributions.

    Parameters
    ----------
    count, n : int

    Returns
    -------
    low, high : float
    """
    from scipy.stats import beta

    low = float(beta.ppf(0.025, count, n - count + 1)) if count > 0 else 0.0
    return low, float(beta.ppf(0.975, count + 1, n - count)) if count < n else 1.0


def _distribution(rows: Sequence[ConformityResult], at_places: bool) -> ResultDistribution:
    sizes = np.abs([row.value for row in rows])
    conform, not_conform, undecided = (
        sum(row.verdict is verdict for row in rows) / len(rows)
        for verdict in (Verdict.CONFORM, Verdict.NOT_CONFORM, Verdict.UNDECIDED)
    )
    return ResultDistribution(
        f"{rows[0].label}, {rows[0].where}" if at_places else rows[0].label,
        rows[0].unit,
        float(np.median(sizes)),
        float(np.quantile(sizes, 0.95)),
        rows[0].limit,
        conform,
        not_conform,
        undecided,
    )
