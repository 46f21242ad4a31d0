"""Transfer of a model to a new set-up: base and tip are re-identified from a few readings."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from truearm.acceptance import accepted
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import NONE_HELD_OUT
from truearm.identification.estimation.set_up_update import update_in_set_up
from truearm.identification.judgement.day_to_day import on_another_day
from truearm.identification.judgement.description_check import explaining
from truearm.identification.judgement.nominal_check import (
    NominalCheck,
    left_by,
    most_noise,
    refuse_implausible,
    typical_error,
    usual_nominal_error,
)
from truearm.identification.judgement.residual_process import ResidualProcess, transfer_improvement, without_process
from truearm.identification.references.alignment import align
from truearm.identification.references.prepared_readings import check_enough, lengths_in_seats
from truearm.identification.references.reading_references import check_spread, references_of, without_sizes
from truearm.identification.references.reference_table import reference_table
from truearm.identification.references.references import Reference
from truearm.identification.references.session_frames import rough_session_frames, to_first_session_frame
from truearm.identification.references.tips import check_tips, tip_names
from truearm.identification.terms import ArmState, Term, constants
from truearm.models.arm_check import check_readings_of, with_serial_number
from truearm.models.compensator import FREE_PARTS, Compensator
from truearm.models.identified_model import IdentifiedModel, require_identified
from truearm.readings.checks import check_scale, check_sessions
from truearm.readings.lengths import Lengths
from truearm.readings.repeats import merge_repeats
from truearm.readings.session import Session
from truearm.typing import FloatArray, IntArray

# References that compare the tips of readings; and three quarters of the root mean squares of three coordinates, or of
# one, lie within this many standard deviations.
COMPARED, OVER_STD = ("point", "pose", "seat", "distance"), 1.17
# Standard uncertainties by which a model misses the readings of another arm at least, and the share of the nominal
# arm's variance that it leaves of them: 0.6 to 3 of three other virtual UR10, 0.02 to 0.06 of the same arm; of printed
# arms, whose weight bends all alike, 0.5 to 1 and 0.2.
LEAST_U, MOST_LEFT = 3.0, 0.5


def refit(
    model: Compensator,
    readings: Session,
    *,
    free: tuple[str, ...] = ("base", "tip"),
    lengths: Lengths | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> IdentifiedModel:
    """Transfer a model to a new set-up: another place of the tracker, another probe.

    The position of the base and of the tip is identified from the new readings, of which there must be four or more;
    those that repeat each other count as one, their mean. The arm may have changed: its other parameters move within
    their uncertainty, and within what is usual between set-ups, as far as the readings ask for it
    (`truearm.identification.estimation.set_up_update`). Where points place the base, a residual
    process is kept if the new readings are predicted better with it; otherwise it was of the other set-up, and stays
    behind. Where the base is kept or no reading has a point, the process stays, and `residual_process_` says that it
    was not judged.

    Parameters
    ----------
    model : Compensator
        Fitted; it is not changed.
    readings : Session
        Of the new set-up, with reference points, seats or surfaces; orientations are not used.
    free : tuple of str
        What to re-identify: ``"base"``, ``"tip"`` or both. Without reference points the base keeps its position.
    lengths : Lengths, optional
        Known lengths between seats of the readings.
    progress : callable, optional
        Called with the rounds done and a note.

    Returns
    -------
    IdentifiedModel
        Of the same class. `residual_std_` is that of `model`, or larger if the new readings say so (see
        `update_in_set_up`). `held_out_` is empty; `training_` keeps the angles and temperatures that the arm was
        identified at, with the fingerprint of the new readings.

    Raises
    ------
    InputError
        If the model is a network, the readings do not fit the arm or are too few, or the base is kept and points are of
        a session that the model was not trained on.
    """
    model._check_fitted()
    known = require_identified(
        model,
        f"expected a nominal, kinematic or physical model, got a {type(model).__name__}: what its networks learned "
        "holds for one base and tip",
        hint="fit the network or the hybrid model to the new readings, or refit a physical model",
    )
    begun = time.perf_counter()
    readings = merge_repeats(readings).readings
    used, free, lengths, is_new_tip = _checked(known, readings, free, lengths)
    new = copy.copy(known)
    new.training_ = known.training_.after_transfer(readings, lengths)
    new.session_frames_ = {} if "base" in free else known.session_frames_
    used = to_first_session_frame(used, new.session_frames_)
    set_up = _SetUp(used, lengths, free, new.state(used), references_of(used, lengths))
    transfer = partial(_transferred, set_up, robust=known.robust, progress=progress)
    new.nominal_ = transfer(known.nominal_, known.nominal_.references[0].noise_std)
    # The readings are means of repeats: their residuals are less than those of one reading.
    averaged = float((1 - known.share_of_mean(used)).mean()) * known.residual_std_**2
    std = float(np.sqrt(known.residual_std_**2 - averaged))
    new.fit_, new.residual_process_, unexplained_std = _judge_process(known, std, set_up, transfer)
    # As it was learned: an arm that follows the new readings would follow wrong ones.
    placed = transfer(_known_exactly(known.fit_), std)
    new.nominal_check_ = _judge_set_up(new, placed, set_up)
    if known.fit_.repeatability_covariance is not None:
        new.fit_ = on_another_day(new.fit_)
    if (unexplained := max(unexplained_std, new.fit_.references[0].noise_std)) > std:
        new.residual_std_ = float(np.sqrt(unexplained**2 + averaged))
    new.free_, new.tips_ = free, tip_names(readings) if is_new_tip else known.tips_
    _refuse_another_arm(known, placed, new, set_up)
    new.variance_function_ = new.with_nominal_growth(new.variance_function_, new.residual_std_)
    new.held_out_, new.held_out_gross_, new.held_out_distances_ = NONE_HELD_OUT, NONE_HELD_OUT, NONE_HELD_OUT
    new.held_out_errors_, new.findings_ = None, ()
    new.accepted_ = accepted(known.accepted_)
    new.fit_seconds_ = time.perf_counter() - begun
    return new


class _SetUp(NamedTuple):
    """Readings of a new set-up in the frame of the model, with the state of its arm; and what they re-identify."""

    readings: Session
    lengths: Lengths | None
    free: tuple[str, ...]
    state: ArmState
    references: list[Reference]

    @property
    def terms(self) -> list[Term]:
        return constants(self.state.chain, free=self.free, angle_std=0.0, length_std=0.0)


def _transferred(
    set_up: _SetUp,
    fit: IdentificationResult,
    unexplained_std: float,
    *,
    robust: bool,
    progress: Callable[[int, str], None] | None,
) -> IdentificationResult:
    """An identified arm in the new set-up."""
    chain, state, readings = fit.perturbed_chain.chain, set_up.state, set_up.readings
    if "base" in set_up.free:
        seen = readings.has_point
        assert readings.points is not None
        chain = chain.with_reference_frame(align(fit.tips(state.rows(seen)), readings.points[seen]))
    return update_in_set_up(
        fit,
        chain,
        state,
        set_up.terms,
        set_up.references,
        unexplained_std=unexplained_std,
        robust=robust,
        progress=progress,
    )


def _judge_process(
    model: IdentifiedModel,
    std: float,
    set_up: _SetUp,
    transfer: Callable[[IdentificationResult, float], IdentificationResult],
) -> tuple[IdentificationResult, ResidualProcess | None, float]:
    """The arm in the new set-up; the residual process, if it holds there; and the residual standard deviation [mm].

    `std` is that of the model at such readings [mm].
    """
    process = model.residual_process_
    if process is None:
        return transfer(model.fit_, std), None, std
    if not process.is_kept or "base" not in set_up.free:
        return transfer(model.fit_, std), process.after_transfer_untested(), std
    std_without = max(process.residual_std_without_mm, std)
    # As they were learned: arms that had moved towards the new readings would predict these alike.
    placed = (
        transfer(_known_exactly(model.fit_), std),
        transfer(_known_exactly(without_process(model.fit_)), std_without),
    )
    process = process.after_transfer(
        *transfer_improvement(*placed, set_up.terms, set_up.readings, set_up.state, set_up.references)
    )
    if process.is_kept:
        return transfer(model.fit_, std), process, std
    return transfer(without_process(model.fit_), std_without), process, std_without


def _known_exactly(fit: IdentificationResult) -> IdentificationResult:
    """The same arm, which no reading changes."""
    return replace(fit, covariance=np.zeros_like(fit.covariance), prior_std=np.zeros_like(fit.prior_std))


def _judge_set_up(model: IdentifiedModel, placed: IdentificationResult, set_up: _SetUp) -> NominalCheck:
    """Refuse readings that are not of the arm; what is unusual of the nominal one, the `placed` arm explains."""
    arm, (readings, lengths, free, state, references) = model.arm_, set_up
    bare = [without_sizes(reference) for reference in references]
    usual = usual_nominal_error(arm, model.nominal_, state, bare, constants(arm.chain, free=free))
    check = NominalCheck(typical_error(placed), usual, most_noise_mm=most_noise(model.nominal_, state, arm.chain.reach))
    if not check.is_usual:
        check = replace(check, left=left_by(placed, state, bare, set_up.terms))
    with explaining(arm, reference_table(readings, lengths, free=free), readings.file):
        check_scale(readings, model.nominal_.tips(state))
        refuse_implausible(check, arm, readings)
    return check


def _refuse_another_arm(
    known: IdentifiedModel, placed: IdentificationResult, new: IdentifiedModel, set_up: _SetUp
) -> None:
    """Refuse readings in which the constants of a model leave most of the error of the nominal arm.

    `placed` is the known arm with base and tip identified from them. Constants of another arm explain nothing, those of
    a worn one most: it differs from itself by less than from the drawing. What the readings scatter by about the `new`
    arm is of their instrument, and counts for neither.
    """
    if not any(one.kind in COMPARED for one in placed.references):
        return
    readings, as_known = set_up.readings, copy.copy(known)
    as_known.tips_ = new.tips_
    variance = np.trace(sum(as_known.covariance_parts(readings)), axis1=1, axis2=2) / 3
    of_arm, of_nominal = (_coordinate_errors(fit) for fit in (placed, new.nominal_))
    rows, stated = (np.concatenate(parts) for parts in zip(*_rows_and_stated(placed), strict=True))
    n_u = _typical(of_arm / np.sqrt(variance[rows] + stated))
    noise = new.residual_std_**2 + float(np.median(stated))
    left, nominal = (max(_typical(errors) ** 2 - noise, 0.0) for errors in (of_arm, of_nominal))
    if n_u < LEAST_U or nominal < noise or left < MOST_LEFT * nominal:
        return
    readings.contradict(
        f"the constants of the model would have to move by {n_u:.0f} standard uncertainties: with base and tip "
        f"identified again it misses these readings by {np.sqrt(left):.2g} mm of a coordinate, and the nominal arm "
        f"misses them by {np.sqrt(nominal):.2g} mm",
        hint="check that they are of the arm that the model is of; after a crash or a repair, fit a new model",
    )


def _rows_and_stated(fit: IdentificationResult) -> list[tuple[IntArray, FloatArray]]:
    """Rows of the readings, and stated variances of a coordinate [mm^2], by reference."""
    return [(one.rows, (one.std**2).mean(axis=0)) for one in fit.references if one.kind in COMPARED]


def _coordinate_errors(fit: IdentificationResult) -> FloatArray:
    """(m,) root mean squares of the residuals of a reading [mm]."""
    return np.concatenate([np.sqrt((one.residuals**2).mean(axis=0)) for one in fit.references if one.kind in COMPARED])


def _typical(errors: FloatArray) -> float:
    """The standard deviation of a coordinate by the errors that three of four readings do not exceed."""
    return float(np.quantile(errors, 0.75)) / OVER_STD


def _checked(
    model: IdentifiedModel, readings: Session, free: tuple[str, ...], lengths: Lengths | None
) -> tuple[Session, tuple[str, ...], Lengths | None, bool]:
    """The readings without orientations, what they can re-identify, their lengths, and whether the tip is a new one."""
    if not free or not set(free) <= set(FREE_PARTS):
        raise InputError(f"expected what to re-identify among {list(FREE_PARTS)}, got {list(free)}")
    check_readings_of(model.arm_, readings)
    with_serial_number(model.arm_, readings)
    is_new_tip = "tip" in free and len(model.tips_) == len(tip_names(readings)) == 1
    if not is_new_tip:
        check_tips(model.tips_, readings)
    readings = replace(readings, quaternion=None)
    lengths = lengths_in_seats(readings, lengths)
    check_sessions(readings, lengths, own_frame=not {"base"} & {*free, *model.free})
    check_enough(references_of(readings, lengths), readings)
    if not readings.has_point.any():
        free = tuple(part for part in free if part != "base")
        if not free:
            raise readings.error(
                "the position of the base needs reference points, and the readings have none", hint="--free tip"
            )
    elif "base" in free:
        check_spread(readings, model.arm)
        if rough_session_frames(model.arm, readings, free):
            raise readings.error(
                "refit identifies one frame, and the readings are of several sessions",
                column="session",
                hint="refit each session separately: truearm split --by session",
            )
    else:
        _check_known_sessions(model, readings)
    return readings, free, lengths, is_new_tip


def _check_known_sessions(model: Compensator, readings: Session) -> None:
    """Check that points are in the frames of the model's sessions, if it has several and the base is kept."""
    known = list(model.session_frames_)
    session = np.full(len(readings), "") if readings.session is None else readings.session
    unknown = readings.has_point & ~np.isin(session, known)
    if known and unknown.any():
        row = int(np.argmax(unknown))
        raise readings.error(
            f"expected points of the sessions of the model ({', '.join(known)}), got a point "
            + (f"of session {str(session[row])!r}" if session[row] else "without a session"),
            row,
            column="session",
            hint="name the session that the points are of; for a new set-up use --free base,tip",
        )
