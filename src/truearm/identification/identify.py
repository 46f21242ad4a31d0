"""Identify: from the readings of a session to what they say of an arm, step by step.

The page to read first. Readings are prepared once (`PreparedReadings`); then, in this order,

1. `place`: base and tip of the nominal arm, as far as they are free,
2. `judge_description`: whether the readings can be of an arm like that,
3. `estimate_without_gross_errors`: the terms offered, by evidence, without readings that are gross errors,
4. `unexplained`: what remains at readings held out, and how it varies over the joint space; `LengthScale`: whether
   all lengths differ alike, as by a reference of a wrong size,
5. `what_may_change`: what another day, unlearned states and the scale of the reference add to the uncertainty.

Each step takes records and returns one; nothing is kept beside them. `identify_offered` and `identify_physical` go
through 3 to 5 with the terms of the kinematic and the physical model; `identify_nominal` judges the arm as placed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from truearm.arm.arm import with_zeros
from truearm.findings import Finding
from truearm.identification.estimation.identification import identify, with_few_changed
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.propagation import response_to_errors, with_shared_error
from truearm.identification.estimation.residual_variance import (
    LEAST_FREEDOM,
    NONE_HELD_OUT,
    HeldOutReadings,
    VarianceFunction,
    conformal_residual_variance,
    few_readings_factor,
    fit_variance_function,
)
from truearm.identification.estimation.tip_offsets import what_tips_show
from truearm.identification.judgement.cross_validation import (
    IN_LENGTH,
    birge_ratio,
    compared_kinds,
    cross_validate_by_group,
)
from truearm.identification.judgement.day_to_day import day_to_day_terms, on_another_day, without_own_days
from truearm.identification.judgement.expansion_prior import (
    at_mean_temperature,
    with_material_prior,
    with_unlearned_terms,
)
from truearm.identification.judgement.gross_errors import (
    LEAST_READINGS,
    excluded_readings,
    has_gross_errors,
    identify_without_gross_errors,
    median_distance,
    nearer_half,
    own_variance,
)
from truearm.identification.judgement.held_out_errors import HeldOutErrors, predicted_by_refits
from truearm.identification.judgement.joint_gains import common_gain, gains_asked, identified_gains, refuse_common_gain
from truearm.identification.judgement.joint_signs import signs_not_shown, unshown_signs, with_unshown_signs
from truearm.identification.judgement.length_scale import LengthScale, axis_scale, reference_scale_variance, refuse_axis
from truearm.identification.judgement.missing_terms import (
    added_covariance,
    missing_terms,
    with_covariance,
    with_missing_terms,
)
from truearm.identification.judgement.nominal_check import (
    NominalCheck,
    check_nominal_arm,
    check_sizes,
    refuse_implausible,
)
from truearm.identification.judgement.outer_regions import growing_outside
from truearm.identification.judgement.repeating_residuals import (
    UNKNOWN_SHARE,
    Repeating,
    of_one_reading,
    repeating_residuals,
)
from truearm.identification.judgement.residual_process import (
    ResidualProcess,
    add_residual_process,
    improvement,
    with_unspanned,
)
from truearm.identification.judgement.stated_uncertainty import (
    as_stated,
    check_stated_uncertainty,
    unlike_stated_uncertainty,
)
from truearm.identification.judgement.tails import tail_freedom
from truearm.identification.references.prepared_readings import MIN_ROWS, PreparedReadings
from truearm.identification.references.reading_references import without_sizes
from truearm.identification.references.references import Reference
from truearm.identification.references.session_frames import places_the_frame, session_frame_terms
from truearm.identification.references.tips import further_tip_terms
from truearm.identification.sampling import joint_travel_limits, spread_angles
from truearm.identification.terms import (
    ArmState,
    Constant,
    InSession,
    SkippedTerm,
    Term,
    candidate_terms,
    constants,
    directions,
)
from truearm.identification.terms.basis import Temperature
from truearm.identification.terms.catalogue import JOINT_COMPLIANCE, OWN_AXIS, unlearned_terms
from truearm.readings.checks import check_scale
from truearm.readings.reference_uncertainty import PPM
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray

# Share of the error at held-out readings of one place that all terms together may leave: with three quarters of its
# variance explained, little remains that could be different elsewhere.
MAX_SHARE_LEFT = 0.5
# Share of the expected squared error over the workspace that the compliance of joints must not exceed: a gain of a few
# per cent is within what this estimate is good for.
MAX_EXPECTED_SHARE = 0.9
# Standard errors by which a residual process is clearly worse in stretches of a session.
CLEAR = 3.0
# Poses drawn within the limits of the joints for the expected error over the workspace.
WORKSPACE_POSES = 200
# Share of the median distance of the nominal arm below which that of a fit to the nearer half shows that gross errors
# drew the arm to themselves.
MAX_TRIMMED_SHARE = 0.5
# Prior standard deviation of a zero of an arm whose zeros are off [rad].
OPEN_ZERO_STD = np.radians(10.0)

Progress: TypeAlias = Callable[[int, str], None]
Complete: TypeAlias = Callable[[IdentificationResult, ArmState, float], IdentificationResult]


class Found(NamedTuple):
    """Identified terms, and the readings as predicted by an arm that was identified without them."""

    fit: IdentificationResult
    held_out: HeldOutReadings


class Start(NamedTuple):
    """Weights (n,) of the readings to start from, 0 for gross errors; and an arm, if one is known."""

    weights: FloatArray
    arm: IdentificationResult | None = None


@dataclass(frozen=True, eq=False)
class Unexplained:
    """What an identified arm leaves unexplained.

    Attributes
    ----------
    residual_std_mm : float
        Standard deviation of a coordinate of one reading, root mean square over the joint space [mm].
    variance_function : VarianceFunction
        Share of its square at other angles.
    tail_freedom : float
        Degrees of freedom of the tails of the held-out deviations; infinite where they are too few.
    repeating_share : float
        Share of the residual variance that is the same at the same pose; 1/2 where it is not known.
    hysteresis : (2, n_joints) array
        See `Repeating`; empty where it was not estimated.
    """

    residual_std_mm: float
    variance_function: VarianceFunction
    tail_freedom: float
    repeating_share: float = UNKNOWN_SHARE
    hysteresis: FloatArray = field(default_factory=lambda: np.zeros((2, 0)))

    def widened(self, factor: float) -> Unexplained:
        """With `factor` times the variance."""
        return replace(self, residual_std_mm=self.residual_std_mm * float(np.sqrt(factor)))

    def of_one_reading(self, readings: PreparedReadings) -> Unexplained:
        """Of one reading, where these are means of repeats."""
        variance, share = of_one_reading(self.residual_std_mm**2, self.repeating_share, readings)
        return replace(self, residual_std_mm=float(np.sqrt(variance)), repeating_share=share)


@dataclass(frozen=True, eq=False)
class Identification:
    """What readings say of an arm, and what that is worth.

    Attributes
    ----------
    fit : IdentificationResult
        The identified chain and terms.
    by_readings : IdentificationResult
        The same by these readings and priors alone, before `what_may_change`.
    excluded_terms : tuple of SkippedTerm
        Terms that the readings could not show, and why.
    held_out : HeldOutReadings
        The readings as predicted by an arm that was identified without their position or seat; gross errors, which
        took no part in the identification, are not among them.
    held_out_gross : HeldOutReadings
        The gross errors, predicted in the same way.
    held_out_distances : HeldOutReadings
        Likewise distances, where `held_out` are points or seats; empty where it is of distances itself.
    held_out_errors : HeldOutErrors or None
        Their errors in short; None where no readings could be held out.
    judge : callable
        Works `unexplained` out.
    tail_freedom : float
        See `Unexplained`.
    birge_ratio : float
        Factor by which standard deviations of the posterior are raised, from the readings held out.
    residual_process : ResidualProcess or None
        What is known of the residual process; None where there is none.
    length_scale : LengthScale or None
        By what share all lengths differ from the drawing alike; None where the readings determine none.
    unexplained : callable
        Works out what the arm leaves unexplained, which only an arm that is kept needs: outer regions of the readings
        are held out for it.
    findings : tuple of Finding
        What a person must know of it.
    """

    fit: IdentificationResult
    by_readings: IdentificationResult
    excluded_terms: tuple[SkippedTerm, ...]
    held_out: HeldOutReadings
    held_out_gross: HeldOutReadings
    held_out_distances: HeldOutReadings
    held_out_errors: HeldOutErrors | None
    tail_freedom: float
    birge_ratio: float
    residual_process: ResidualProcess | None
    length_scale: LengthScale | None
    unexplained: Callable[[], Unexplained]
    findings: tuple[Finding, ...]


# The nominal arm -----------------------------------------------------------------------------------------------------


def place(readings: PreparedReadings) -> IdentificationResult:
    """Place the nominal arm: its free parts identified from the readings.

    Raises
    ------
    InputError
        If a known length or distance is far from that of the nominal arm.
    """
    fit_nominal = partial(_identify_terms, readings, _nominal_terms(readings))
    check_sizes(readings.measured, readings.lengths, readings.references, fit_nominal, readings.state)
    return fit_nominal(readings.references)


def place_without_gross_errors(readings: PreparedReadings) -> Found:
    """Place the nominal arm, and judge readings that would draw it to themselves; none are held out if not robust."""
    nominal = place(readings)
    if not readings.robust:
        return Found(nominal, NONE_HELD_OUT)
    terms, n = _nominal_terms(readings), len(readings)
    weights = nearer_half(nominal, n)
    trimmed = nominal
    if not weights.all():
        trimmed = _identify_terms(readings, terms, readings.references, weights=weights, start=nominal)
    if median_distance(trimmed) < MAX_TRIMMED_SHARE * median_distance(nominal):
        weights = nearer_half(trimmed, n)
    else:
        held_out = cross_validate(readings, nominal)
        if not has_gross_errors(nominal, held_out):
            return Found(nominal, held_out)
        weights = np.ones(n)
    return estimate_without_gross_errors(readings, terms, Start(weights))


def compare_with_nominal(readings: PreparedReadings, nominal: IdentificationResult) -> NominalCheck:
    """Compare the error of the nominal arm, placed as `nominal`, with the usual one; see `check_nominal_arm`.

    Zeros that are off hide what else is wrong: mistakes and scales are judged about the arm with its zeros in place.
    """
    references = [without_sizes(reference) for reference in readings.references]
    every = constants(readings.arm.chain, free=readings.free)
    check = check_nominal_arm(
        readings.arm,
        nominal,
        readings.state,
        references,
        every,
        partial(_identify_terms, readings, references=references),
        readings.table,
        readings.free,
    )
    if check.shows_zeros and check.identified is not None:
        readings = _with_zeros(readings, np.array(check.identified.every_zero))
        fit = _identify_terms(readings, _with_open_zeros(readings), references)
        turned = fit.perturbed_chain.constant_motions(fit.coefficients)[1:-1, OWN_AXIS]
        readings = _with_zeros(readings, np.where(readings.arm.chain.is_prismatic, 0.0, turned))
        every = constants(readings.arm.chain, free=readings.free)
        nominal = _identify_terms(readings, _nominal_terms(readings), references)
        fit = _identify_terms(readings, _with_open_zeros(readings), references)
        check = check.about(fit, readings.arm, references, readings.table)
    if readings.frames:  # the axes of a session are not those of its file
        return check
    return replace(check, axis_scale=axis_scale(nominal, readings.state, references, every))


def _with_zeros(readings: PreparedReadings, zeros: FloatArray) -> PreparedReadings:
    """The readings as of an arm with zeros (n_joints,) added to its own."""
    placed = with_zeros(replace(readings.arm, chain=readings.chain), zeros).chain
    return replace(readings, arm=with_zeros(readings.arm, zeros), chain=placed)


def _with_open_zeros(readings: PreparedReadings) -> list[Term]:
    """The constants with zeros of which little is known: lengths do not take what zeros may explain."""
    return [
        replace(term, prior_std=OPEN_ZERO_STD, learn=False) if term.group == "joint offsets" else term
        for term in constants(readings.arm.chain, free=readings.free)
    ]


def judge_description(readings: PreparedReadings, nominal: IdentificationResult) -> NominalCheck:
    """Refuse readings that no arm of these kinematics, placed as `nominal`, can have made: a wrong unit, sign or arm.

    Raises
    ------
    InputError
        With the mistakes that are likely.
    """
    every = constants(readings.arm.chain, free=readings.free)
    references = [without_sizes(reference) for reference in readings.references]
    check_scale(readings.measured, nominal.tips(readings.state))
    check = compare_with_nominal(readings, nominal)
    refuse_common_gain(check.common_gain, readings.measured)
    refuse_implausible(check, readings.arm, readings.measured)
    refuse_axis(check.axis_scale, readings.measured)
    check_stated_uncertainty(readings.measured, nominal, references, partial(_identify_terms, readings, every))
    return check


# The identified arms -------------------------------------------------------------------------------------------------


def identify_nominal(readings: PreparedReadings, placed: Found) -> Identification:
    """The nominal arm as it was placed, with what it leaves unexplained."""
    if not len(placed.held_out.rows):
        placed = Found(placed.fit, cross_validate(readings, placed.fit))
    return _concluded(_at_mean_temperature(readings), placed, same_every_day=True)


def identify_offered(
    readings: PreparedReadings,
    terms: Sequence[Term],
    excluded: Sequence[SkippedTerm],
    known: Sequence[IdentificationResult],
    progress: Progress | None = None,
) -> Identification:
    """Identify the terms offered.

    Parameters
    ----------
    readings : PreparedReadings
    terms : sequence of Term
    excluded : sequence of SkippedTerm
        Terms that are not offered, and why.
    known : sequence of IdentificationResult
        Arms that were identified from the same readings before; their gross errors are excluded at first.
    progress : callable, optional
    """
    readings = _at_mean_temperature(readings)
    terms = [*terms, *day_to_day_terms(readings.arm.chain, readings.days)]
    start = Start(_weights_without(readings, known))
    found = estimate_without_gross_errors(readings, terms, start, progress)
    if gains := gains_asked(found.fit, readings.state, readings.references, terms):
        terms = [*terms, *gains]
        found = estimate_without_gross_errors(readings, terms, start, progress)
    return _concluded(readings, found, tuple(excluded), missing=_with_missing_terms(readings, found.fit, terms))


def _with_missing_terms(
    readings: PreparedReadings, fit: IdentificationResult, terms: Sequence[Term]
) -> IdentificationResult | None:
    """The arm with the terms that its model does not have; None where too few readings would show them."""
    weights = np.ones(len(readings))
    weights[excluded_readings(fit)] = 0.0
    offered = [*terms, *missing_terms(readings.state, readings.free)]
    if not readings.has_point.any():
        offered = [term for term in offered if not places_the_frame(term)]
    complete = _identify_terms(readings, offered, readings.references, weights=weights, start=fit, about=fit)
    return None if complete.residual_freedom(readings.references) < LEAST_FREEDOM else complete


def identify_physical(
    readings: PreparedReadings,
    known: Sequence[IdentificationResult],
    *,
    highest: int,
    residual: bool = True,
    further: Sequence[Term] = (),
    has_constants: bool = False,
    progress: Progress | None = None,
) -> Identification:
    """Identify every term that the readings can determine.

    All terms are offered; from readings of one place those are kept that are likely to hold elsewhere. What a term
    explains in one place need not be its own: harmonics, wobble and bending share it in a way that fits nowhere else.
    All are kept if they explain most of the error there. Otherwise the compliance of joints is tried alone: it has few
    coefficients, and is the same everywhere (A. Klimchik, B. Furet, S. Caro, A. Pashkevich, "Identification of the
    manipulator stiffness model parameters in industrial environment", Mech. Mach. Theory 90 (2015) 1). It is kept if
    the expected error over the whole workspace is smaller with it.

    Parameters
    ----------
    readings : PreparedReadings
    known : sequence of IdentificationResult
        As in `identify_offered`.
    highest : int
        Highest order of the harmonics offered about a joint's own axis.
    residual : bool
        Whether a residual process is offered.
    further : sequence of Term
        Offered beside those of the catalogue.
    has_constants : bool
        Whether the constants are among the arms that are known.
    progress : callable, optional
    """
    readings = _at_mean_temperature(readings)
    terms, skipped = candidate_terms(readings.state, free=readings.free, highest=highest)
    terms += [*further, *day_to_day_terms(readings.arm.chain, readings.days)]
    start = Start(_weights_without(readings, known))
    if has_constants:
        start = Start(start.weights, known[-1])
    elif readings.robust:
        start = _from_constants(readings, start)
    if (simpler := start.arm) is not None:
        terms += _gains_beside(terms, simpler, readings)
    estimate = partial(estimate_without_gross_errors, readings, start=start, progress=progress)
    everything, process = estimate(terms), None
    if everything.fit.residual_freedom(readings.references) < LEAST_FREEDOM:
        # The terms pass through the readings: neither their sizes nor the noise mean anything.
        skipped.append(SkippedTerm("terms that depend on the pose", "there are too few readings"))
        found = estimate(_rigid(terms))
    elif readings.in_one_place:
        found, lost = _likely_elsewhere(readings, terms, everything, estimate)
        skipped += lost
    else:
        found = everything
        if residual:
            rigid = {*further, *_rigid(terms)}
            same_in_every_pose = [term for term in terms if term in rigid]
            found, process, lost = _with_residual_process(readings, same_in_every_pose, everything, simpler, estimate)
            skipped = [*lost, *skipped]
    return _concluded(readings, found, tuple(skipped), process, complete=_with_all_states, rigid=simpler)


def _with_residual_process(
    readings: PreparedReadings,
    rigid_terms: list[Term],
    everything: Found,
    simpler: IdentificationResult | None,
    estimate: Callable[[list[Term]], Found],
) -> tuple[Found, ResidualProcess | None, list[SkippedTerm]]:
    """A residual process in place of the terms that depend on the pose, or beside them, or none.

    What cables or a soft mount do is of no single joint. Of few readings many terms of one joint each take a part of
    it, in a way that fits nowhere else, and leave too little for a process to be seen by. So where the terms do not
    explain most of the error, the process is tried in their place first, and kept if it predicts held-out readings
    better than they do.

    Parameters
    ----------
    readings : PreparedReadings
    rigid_terms : list of Term
        Those that do not depend on the pose.
    everything : Found
        With all terms.
    simpler : IdentificationResult or None
        The arm's constants, where they are known.
    estimate : callable
        Identifies terms.
    """
    add = partial(add_residual_process, data=readings, cross_validate=partial(cross_validate, readings))
    rest = median_distance(simpler or estimate(rigid_terms).fit)
    few_explained = _typical_error(everything.held_out) > MAX_SHARE_LEFT * rest
    if few_explained and _may_replace(readings, rigid_terms, everything, simpler):
        found, process = add(estimate(rigid_terms))
        if process is not None and improvement(everything.held_out, found[1])[0] > 0:
            why = "a residual process in their place predicts held-out readings better"
            return Found(*found), process, [SkippedTerm("terms that depend on the pose", why)]
    found, process = add(everything)
    return Found(*found), process, []


def _may_replace(
    readings: PreparedReadings, rigid_terms: list[Term], everything: Found, simpler: IdentificationResult | None
) -> bool:
    """Whether a residual process may predict better than the terms that depend on the pose: see stretches of many."""
    if readings.stretches is None:
        return True
    some, rows = readings.stretches
    some = replace(some, state=readings.state.rows(rows), prior=readings.prior)
    start = Start(_weights_without(readings, [everything.fit])[rows], simpler)
    rigid = estimate_without_gross_errors(some, rigid_terms, start)
    (_, with_process), process = add_residual_process(rigid, some, partial(cross_validate, some))
    there = everything.held_out.select(np.isin(everything.held_out.rows, rows))
    gain, error = improvement(replace(there, rows=np.searchsorted(rows, there.rows)), with_process)
    return process is not None and gain > -CLEAR * error


def _likely_elsewhere(
    readings: PreparedReadings, terms: Sequence[Term], everything: Found, estimate: Callable[[list[Term]], Found]
) -> tuple[Found, list[SkippedTerm]]:
    """Of terms identified in one place those that are likely to hold elsewhere; see `identify_physical`."""
    rigid_terms = _rigid(terms)
    elastic_terms = [*rigid_terms, *(term for term in terms if term.group == JOINT_COMPLIANCE)]
    rigid = estimate(rigid_terms)
    if _typical_error(everything.held_out) <= MAX_SHARE_LEFT * _typical_error(rigid.held_out):
        return everything, []
    elastic = estimate(elastic_terms)
    angles = readings.state.angles
    ranges = np.stack([angles.min(axis=0), angles.max(axis=0)], axis=1)
    ends = joint_travel_limits(readings.arm, slides=ranges)
    poses = spread_angles(*ends, WORKSPACE_POSES, seed=0)
    state = at_mean_temperature(readings.typical_state(poses))
    least = MAX_EXPECTED_SHARE * rigid.fit.expected_square_error(state)
    is_better = elastic.fit.expected_square_error(state) < least
    what = "terms other than joint compliance" if is_better else "terms that depend on the pose"
    why = "readings of one place do not show whether they hold elsewhere"
    return elastic if is_better else rigid, [SkippedTerm(what, why)]


# The steps -----------------------------------------------------------------------------------------------------------


def estimate_without_gross_errors(
    readings: PreparedReadings, terms: Sequence[Term], start: Start, progress: Progress | None = None
) -> Found:
    """Identify terms, and hold readings out; where outliers get a smaller weight, without gross errors."""
    if not readings.has_point.any():
        terms = [term for term in terms if not places_the_frame(term)]
    if not readings.robust:
        fit = _identify_terms(readings, terms, readings.references, progress=progress, start=start.arm)
        return Found(fit, cross_validate(readings, fit))

    def identified(weights: FloatArray, before: IdentificationResult | None) -> IdentificationResult:
        if before and (found := with_few_changed(before, readings.state, readings.references, weights)) is not None:
            return found
        return _identify_terms(
            readings, terms, readings.references, progress=progress, weights=weights, start=before or start.arm
        )

    return Found(*identify_without_gross_errors(identified, partial(cross_validate, readings), start.weights))


def cross_validate(
    readings: PreparedReadings, fit: IdentificationResult, kinds: Sequence[str] | None = None
) -> HeldOutReadings:
    """Predict readings by an arm that was identified without their group: position, seat, or region of the joints."""
    held_out = cross_validate_by_group(fit, readings.state, readings.references, readings.groups, kinds)
    return with_unspanned(held_out, fit, readings.state)


def unexplained(fit: IdentificationResult, held_out: HeldOutReadings, angles: FloatArray) -> Unexplained:
    """Estimate what an arm leaves unexplained, from readings held out, at angles (n, n_joints) of all readings."""
    noise_variance = fit.references[0].noise_std ** 2
    informative = held_out.select_informative(own_variance(fit.references, held_out.rows))
    if len(informative.rows) < MIN_ROWS:
        flat = VarianceFunction.flat(angles.shape[1])
        return Unexplained(float(np.sqrt(noise_variance)), flat, float("inf"))
    # Of few readings all may lie within the uncertainty of the parameters, which itself rests on the noise.
    return unexplained_at(informative, angles, least=noise_variance)


def unexplained_at(held_out: HeldOutReadings, angles: FloatArray, *, least: float = 0.0) -> Unexplained:
    """Estimate what readings held out leave unexplained; `least` is the least variance [mm^2]."""
    function = fit_variance_function(held_out, angles)
    scaled = held_out.scaled(freedom=function.share(angles[held_out.rows]))
    variance = max(conformal_residual_variance(scaled), least)
    tails = tail_freedom(scaled, variance) if len(held_out.rows) >= LEAST_READINGS else float("inf")
    return Unexplained(float(np.sqrt(variance)), function, tails)


def what_may_change(
    readings: PreparedReadings,
    fit: IdentificationResult,
    widened: float,
    *,
    same_every_day: bool,
    complete: Complete | None,
    wider: IdentificationResult,
) -> IdentificationResult:
    """Add to the uncertainty what the readings do not show: other days, unlearned states, the reference's scale.

    `widened` is the factor by which the covariance was raised for few readings; `complete` adds states that no reading
    had; `wider` is the arm with the error of the terms that the model does not have, or itself.
    """
    scale = response_to_errors(fit, readings.state, readings.references, readings.scale_errors)
    fit = wider if widened == 1 else replace(wider, covariance=widened * wider.covariance)
    if not same_every_day:
        fit = on_another_day(fit)
    if complete is not None:
        fit = complete(fit, readings.state_as_read, widened)
    return without_own_days(with_shared_error(fit, scale))


def _gains_beside(terms: Sequence[Term], simpler: IdentificationResult, readings: PreparedReadings) -> list[Term]:
    """Gains of joints that the readings ask for, beside what other terms explain."""
    # What a joint bends by its torque looks like a gain where it leans from upright.
    compliance = (term for term in terms if term.group == JOINT_COMPLIANCE)
    absorbed = [*constants(readings.state.chain, free=readings.free), *compliance]
    return gains_asked(simpler, readings.state, readings.references, absorbed)


def _concluded(
    readings: PreparedReadings,
    found: Found,
    excluded: tuple[SkippedTerm, ...] = (),
    process: ResidualProcess | None = None,
    *,
    same_every_day: bool = False,
    complete: Complete | None = None,
    missing: IdentificationResult | None = None,
    rigid: IdentificationResult | None = None,
) -> Identification:
    """What identified terms are worth: steps 4 and 5; `rigid` is the arm with its constants alone."""
    fit, held_out = found
    refuse_common_gain(common_gain(fit), readings.measured)
    is_excluded = np.isin(held_out.rows, excluded_readings(fit))
    kept, distances = held_out.select(~is_excluded), NONE_HELD_OUT
    if held_out.n_coordinates > 1 and any(part.kind == "distance" for part in readings.references):
        distances = _as_refitted(readings, fit, cross_validate(readings, fit, IN_LENGTH), IN_LENGTH)
    kept = _as_refitted(readings, fit, kept, compared_kinds(fit.references))
    added, known, wider = None, kept, fit
    if missing is not None:
        wider = with_missing_terms(fit, missing)
        added = added_covariance(fit, wider, readings.state)
        known = with_covariance(kept, added)
    rest = unexplained(missing or fit, known, readings.state.angles)
    used = ~np.isin(np.arange(len(readings)), excluded_readings(fit))
    birge = birge_ratio(fit.references, kept.rows, rest.residual_std_mm)
    # Few residuals determine the noise only roughly.
    freedom = fit.residual_freedom(readings.references)
    widened = few_readings_factor(freedom)

    @one_blas_thread()
    def judged() -> Unexplained:
        function = growing_outside(
            rest.variance_function, rest.residual_std_mm**2, fit, readings.state, readings.references, used, added
        )
        grown = replace(rest, variance_function=function)
        share, hysteresis = _repeating(readings, wider, grown, used)
        whole = replace(grown, repeating_share=share, hysteresis=hysteresis)
        return whole.widened(widened).of_one_reading(readings)

    signs = []
    if not same_every_day:
        every = constants(readings.state.chain, free=readings.free)
        signs = unshown_signs(fit, readings.state, readings.references, every, rigid)
    stated = 0.0 if readings.measured.u_scale_ppm is None else PPM * float(readings.measured.u_scale_ppm.max())
    reference_variance = reference_scale_variance(fit, readings.references) + stated**2
    whole = what_may_change(readings, fit, widened, same_every_day=same_every_day, complete=complete, wider=wider)
    whole = with_unshown_signs(whole, signs)
    scale = LengthScale.of(fit, freedom, widened * birge**2, reference_variance=reference_variance)
    return Identification(
        whole,
        wider,
        excluded,
        kept,
        held_out.select(is_excluded),
        distances,
        HeldOutErrors.of(kept, n_excluded=int(is_excluded.sum())),
        rest.tail_freedom,
        birge,
        process,
        scale,
        judged,
        _findings(whole, readings, scale),
    )


def _findings(arm: IdentificationResult, readings: PreparedReadings, scale: LengthScale | None) -> tuple[Finding, ...]:
    """What a person must know of an identified arm."""
    return (
        *identified_gains(arm),
        *signs_not_shown(arm),
        *what_tips_show(arm, readings.tips),
        *unlike_stated_uncertainty(as_stated(arm, readings.references)),
        *(() if scale is None else scale.findings(readings.arm)),
    )


def _repeating(readings: PreparedReadings, fit: IdentificationResult, rest: Unexplained, used: BoolArray) -> Repeating:
    """What of the residuals comes back, by the readings with points."""
    angles, rows = readings.state.angles, np.flatnonzero(used & readings.has_point)
    if readings.points is None or readings.point_std is None:
        point_variance = np.zeros(len(rows))
    else:
        point_variance = (readings.point_std[rows] ** 2).mean(axis=1)
    points = np.zeros((0, 3)) if readings.points is None else readings.points[rows]
    variance = rest.residual_std_mm**2 * rest.variance_function.share(angles[rows])
    moved = readings.state.directions
    if moved is None:  # a sample has not the order of all readings
        moved = directions(angles) if readings.state.stride == 1 else np.zeros_like(angles)
    return repeating_residuals(fit, readings.state.rows(rows), moved[rows], points, point_variance, variance)


def _as_refitted(
    readings: PreparedReadings, fit: IdentificationResult, held_out: HeldOutReadings, kinds: Sequence[str]
) -> HeldOutReadings:
    """Held-out readings; see `predicted_by_refits`."""

    def identified(weights: FloatArray) -> IdentificationResult:
        # Not from `fit`, which knows the readings: where it passes through all of them, it would stay there.
        of, at, references = fit.perturbed_chain, readings.state, readings.references
        return identify(of.chain, at, of.terms, references, robust=readings.robust, reading_weights=weights)

    freedom = fit.residual_freedom(readings.references)
    return predicted_by_refits(held_out, fit, kinds, identified, len(readings), freedom=freedom)


def _with_all_states(fit: IdentificationResult, state: ArmState, widened: float) -> IdentificationResult:
    """The result at true temperatures, with what the readings left open of the terms of the physical model."""
    fit = with_material_prior(fit, state, widened=widened)
    return with_unlearned_terms(fit, unlearned_terms(state))


def _from_constants(readings: PreparedReadings, start: Start) -> Start:
    """A start from the arm's constants alone: with all terms, some gross errors could explain each other."""
    rigid = estimate_without_gross_errors(readings, constants(readings.state.chain, free=readings.free), start).fit
    weights = start.weights.copy()
    weights[excluded_readings(rigid)] = 0.0
    return Start(weights, rigid)


def _identify_terms(
    readings: PreparedReadings,
    terms: Sequence[Term],
    references: Sequence[Reference],
    *,
    progress: Progress | None = None,
    weights: FloatArray | None = None,
    start: IdentificationResult | None = None,
    about: IdentificationResult | None = None,
) -> IdentificationResult:
    """Terms, and beside them those of the tool and of the sessions' frames, identified from references."""
    arm, chain = readings.arm, readings.chain
    if readings.prior is not None:
        chain, terms = readings.prior.applied(chain, terms)
    return identify(
        chain,
        readings.state,
        [
            *terms,
            *readings.tool,
            *session_frame_terms(arm.chain, readings.frames),
            *further_tip_terms(arm.chain, readings.tips),
        ],
        references,
        robust=readings.robust,
        reading_weights=weights,
        start=start,
        about=about,
        progress=progress,
    )


def _nominal_terms(readings: PreparedReadings) -> list[Term]:
    return constants(readings.arm.chain, free=readings.free, angle_std=0.0, length_std=0.0)


def _rigid(terms: Sequence[Term]) -> list[Term]:
    return [term for term in terms if isinstance(term.basis, Constant | InSession | Temperature)]


def _at_mean_temperature(readings: PreparedReadings) -> PreparedReadings:
    """Lengths are then those at the mean temperature of the readings; `_with_all_states` takes them to 20 degC."""
    return replace(readings, state=at_mean_temperature(readings.state))


def _weights_without(readings: PreparedReadings, known: Sequence[IdentificationResult]) -> FloatArray:
    """(n,) weights: 0 for the gross errors of arms that were identified before, which may come back."""
    weights = np.ones(len(readings))
    for fit in known:
        weights[excluded_readings(fit)] = 0.0
    return weights


def _typical_error(held_out: HeldOutReadings) -> float:
    """Median error [mm], which gross errors hardly change."""
    return float(np.median(held_out.errors_mm)) if len(held_out.rows) else float("inf")
