"""A standard's test, simulated with many arms: which results the arms reach.

The points of a layout are posed once for the nominal arm. Each arm measures them with its systematic errors in these
poses and random errors at each point, on artefacts whose true sizes are drawn within their certificates.
`truearm.wings.laboratory.standards.verification.verify` judges the points like those of a file.

A rehearsal has the points of a test taken by one virtual arm: joint angles as a person would record them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truearm.errors import InputError
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere
from truearm.wings.laboratory.standards.artefacts import Artefacts, CalibratedBar, CalibratedSphere, Seat
from truearm.wings.laboratory.standards.coordinate_origin import VIRTUAL_ARM, CoordinateOrigin
from truearm.wings.laboratory.standards.decision import ConformityResult, DecisionRule, Verdict
from truearm.wings.laboratory.standards.layout import Placement
from truearm.wings.laboratory.standards.measured_points import MeasuredPoints, PointGroup
from truearm.wings.laboratory.standards.points_form import ON_SURFACES, PlannedPoints
from truearm.wings.laboratory.standards.specification import Specification
from truearm.wings.laboratory.standards.verification import Verification, verify
from truearm.wings.laboratory.standards.verification_plan import VerificationPlan
from truearm.wings.laboratory.tasks.posed_test import PosedTest, pose
from truearm.wings.laboratory.tasks.sampled_arms import ArmDistribution, ArmSample
from truearm.wings.planning.virtual import Measurement, VirtualArm

MAX_ARMS = 100_000
# First word of the stream, different from those of the arms' own errors.
_POINTS = 5


def simulate_verification(
    errors: ArmDistribution,
    posed: PosedTest,
    *,
    plan: VerificationPlan,
    artefacts: Artefacts,
    specification: Specification,
    n_arms: int,
    seed: int,
    rule: DecisionRule | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[Verification, ...]:
    """Simulate a verification test with many arms.

    Parameters
    ----------
    errors : ArmDistribution
        Errors that the arms may have.
    posed : PosedTest
    plan, artefacts, specification, rule
        As of `verify`.
    n_arms : int
        Number of arms to draw.
    seed : int
        No two seeds share an arm.
    progress : callable, optional
        Called with the number of arms done.

    Returns
    -------
    tuple of Verification
        One per arm.

    Raises
    ------
    InputError
        As `verify`, which refuses an arm with errors so large that artefacts are confused.
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
            hint = (
                error.hint if error.hint and "artefact's name" not in error.hint else "use an arm with smaller errors"
            )
            raise InputError(f"virtual arm {i + 1}: {error.problem}", hint=hint) from None
        out.append(found)
        if progress is not None:
            progress(i + 1)
    return tuple(out)


def simulate_points(sample: ArmSample, posed: PosedTest, artefacts: Artefacts, *, seed: int) -> MeasuredPoints:
    """Simulate the points that one arm measures.

    The artefacts are drawn within their certificates. Sizes and temperatures are normal with the stated standard
    uncertainties, once for each artefact; the error of the fixture is drawn for each group. Each point deviates from a
    perfect ball by up to half the form deviation, uniformly, and that of a seat in each direction. Single points on
    opposite faces lie beside each other by the stated alignment. The temperature is 20 degC.
    """
    rng = np.random.default_rng([_POINTS, seed])
    true = true_points(posed.placements, artefacts, rng)
    shown = np.concatenate(true) + sample.systematic(posed.angles) + sample.random(posed.angles, rng)
    each = np.split(shown, np.cumsum([len(one) for one in true])[:-1])
    dates = {one.name: one.date for one in artefacts.all}
    return MeasuredPoints.of(
        (
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
        ),
        origin=CoordinateOrigin(VIRTUAL_ARM),
    )


def true_points(placements: Sequence[Placement], artefacts: Artefacts, rng: np.random.Generator) -> list[FloatArray]:
    """True points of each placement, (k, 3) [mm]: artefacts deviate within their certificates."""
    known = {one.name: one for one in artefacts.all}
    growth = {
        name: 0.0 if isinstance(one, Seat) else one.expansion_per_K * one.u_temperature_K * rng.standard_normal()
        for name, one in known.items()
    }
    diameters = {one.name: one.diameter_mm + one.u_diameter_mm * rng.standard_normal() for one in artefacts.spheres}
    # True length minus certificate value.
    excess = {
        (bar.name, length.name): length.length_mm * growth[bar.name] + length.u_mm * rng.standard_normal()
        for bar in artefacts.bars
        for length in bar.lengths
    }
    starts = {_pair(one): one.at for one in placements if one.keys.get("end") == "A"}
    out = []
    for one in placements:
        artefact = known[one.artefact]
        ends = 2 if "end" in one.keys else 1  # the error of a length is shared by its ends
        middle = one.at + artefact.u_fixture_mm / np.sqrt(ends) * rng.standard_normal(3)
        if isinstance(artefact, CalibratedSphere):
            radius = diameters[artefact.name] / 2 * (1 + growth[artefact.name])
            off = artefact.form_mm * rng.uniform(-0.5, 0.5, (len(one.points), 1))
            out.append(middle + (radius + off) * one.normals)
            continue
        if one.keys.get("end") == "B":
            along = one.at - starts[_pair(one)]
            along = along / np.linalg.norm(along)
            middle = middle + excess[one.artefact, one.keys["length"]] * along
            if one.test == "bi" and len(one.points) == 1 and isinstance(artefact, CalibratedBar):
                beside = (artefact.u_alignment_mm or 0.0) * rng.standard_normal(3)
                middle = middle + beside - (beside @ along) * along
        out.append(middle + one.points - one.at + artefact.form_mm * rng.uniform(-0.5, 0.5, (len(one.points), 3)))
    return out


def _pair(one: Placement) -> tuple[str, ...]:
    """Key of a measured length, common to its two ends."""
    return (one.test, one.artefact, *(value for key, value in one.keys.items() if key != "end"))


@dataclass(frozen=True)
class ResultDistribution:
    """Distribution of one row of the test over the arms.

    Attributes
    ----------
    label : str
    unit : str
    median, quantile_95 : float
        Median and 95 % quantile of the magnitude of the test value.
    limit : float or None
    conform, not_conform, undecided : float
        Shares of the arms; all 0 without a limit.
    """

    label: str
    unit: str
    median: float
    quantile_95: float
    limit: float | None
    conform: float
    not_conform: float
    undecided: float


def result_distributions(verifications: Sequence[Verification]) -> tuple[ResultDistribution, ...]:
    """Distributions of the rows of a test over the arms."""
    labels = Counter(row.label for row in verifications[0].rows)
    return tuple(
        _distribution(rows, labels[rows[0].label] > 1)
        for rows in zip(*(one.rows for one in verifications), strict=True)
    )


def verdict_shares(verifications: Sequence[Verification]) -> Mapping[Verdict, float]:
    """Shares of the arms by their verdict on the whole test."""
    return {verdict: sum(one.verdict is verdict for one in verifications) / len(verifications) for verdict in Verdict}


def proportion_interval(count: int, n: int) -> tuple[float, float]:
    """95 % confidence interval of a proportion of which n draws show `count`.

    Source: Clopper and Pearson, Biometrika 26 (1934), 404: at the bounds, as many or more, or as few or fewer, have a
    probability of 2.5 %; they are quantiles of beta distributions.

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


# First word of the stream, different from those of other draws.
_ARTEFACTS = 6


def rehearse_points(
    virtual: VirtualArm, planned: Sequence[PlannedPoints], artefacts: Artefacts, *, seed: int
) -> Measurement:
    """Measure the planned points of a test with a virtual arm.

    The artefacts deviate within their certificates and are at 20 degC. The centre of the stylus tip is half its
    diameter away from a touched surface.

    Parameters
    ----------
    virtual : VirtualArm
    planned : sequence of PlannedPoints
        Of the whole file.
    artefacts : Artefacts
        Certificates of the artefacts.
    seed : int
        Of poses, artefacts and noise.

    Returns
    -------
    Measurement
        One reading for each point, in the order of the file, without reference points.

    Raises
    ------
    InputError
        If an artefact has no certificate, or the arm does not reach all points.
    """
    layout = [_placement(one, artefacts) for one in planned]
    posed = pose(layout, virtual.nominal, seed=seed)
    true = true_points(layout, artefacts, np.random.default_rng([_ARTEFACTS, seed]))
    tips = np.concatenate(
        [
            points + (one.tip_mm / 2 if one.test in ON_SURFACES else 0.0) * placed.normals
            for points, one, placed in zip(true, planned, layout, strict=True)
        ]
    )
    order = np.argsort(np.concatenate([one.rows for one in planned]), kind="stable")
    return virtual.measure(posed.angles[order], seed=seed, seat_points=tips[order], reference=False)


def _placement(one: PlannedPoints, artefacts: Artefacts) -> Placement:
    """The group as a layout has it: with the centre of its ball and the normals of the surface."""
    known = {a.name: a for a in artefacts.all}
    if one.artefact not in known:
        raise InputError(
            f"the file of artefacts has no {one.artefact!r}", hint=f"one of {', '.join(known)}, or --artefacts FILE"
        )
    at, normals = _centre(one)
    return Placement(one.test, one.artefact, one.keys, one.points, normals, at, one.approach)


def _centre(one: PlannedPoints) -> tuple[FloatArray, FloatArray]:
    """Centre of a ball and normals of its surface; of a seat or face the point and the direction to the stylus."""
    if len(one.points) < 5 or np.ptp(one.points, axis=0).max() == 0:
        return one.points.mean(axis=0), one.approach
    centre = fit_sphere(one.points, std_mm=1.0).centre
    away = one.points - centre
    return centre, away / np.linalg.norm(away, axis=1, keepdims=True)
