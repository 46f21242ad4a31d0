"""Transfer of a model to a new set-up: base and tip are re-identified from a few readings."""

from __future__ import annotations

import copy
import hashlib
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from truearm.compensation.models.arm_check import check_readings_of, with_serial_number
from truearm.compensation.models.compensator import FREE_PARTS, Compensator
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.errors import InputError
from truearm.identification.estimation.consider_parameters import consider_update
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import NONE_HELD_OUT
from truearm.identification.judgement.description_check import explaining
from truearm.identification.judgement.nominal_check import (
    NominalCheck,
    refuse_implausible,
    typical_error,
    usual_nominal_error,
)
from truearm.identification.judgement.residual_process import transfer_improvement, without_process
from truearm.identification.references.alignment import align
from truearm.identification.references.prepared_readings import check_enough, lengths_in_seats
from truearm.identification.references.reading_references import check_spread, references_of, without_sizes
from truearm.identification.references.session_frames import rough_session_frames, to_first_session_frame
from truearm.identification.references.tips import check_tips, tip_names
from truearm.identification.terms import constants
from truearm.readings.checks import check_sessions
from truearm.readings.distances import rows_with_distance
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray

Model = TypeVar("Model", bound=Compensator)

# Numbers go into a reading's identifier as multiples of this [rad, mm]: angles read from a file differ by 1e-12.
ID_RESOLUTION = 1e-9


def refit(
    model: Model,
    readings: Session,
    *,
    free: tuple[str, ...] = ("base", "tip"),
    lengths: Lengths | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> Model:
    """Transfer a model to a new set-up: another place of the tracker, another probe.

    Only the position of the base and of the tip is identified from the new readings, of which there must be four or
    more. All other parameters keep their values; their uncertainty propagates into base and tip as that of consider
    parameters (`truearm.identification.estimation.consider_parameters`). Where points place the base, a residual
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
    Compensator
        Of the same class. `residual_std_` is that of `model`, or larger if the new readings say so (see
        `consider_update`). `held_out_` is empty; `training_` keeps the angles and temperatures that the arm was
        identified at, with the fingerprint of the new readings.

    Raises
    ------
    InputError
        If the model is a network, the readings do not fit the arm or are too few, or the base is kept and points are of
        a session that the model was not trained on.
    """
    model._check_fitted()
    if not isinstance(model, IdentifiedModel):
        raise InputError(
            f"expected a nominal, kinematic or physical model, got a {type(model).__name__}: what its networks learned "
            "holds for one base and tip",
            hint="fit the network or the hybrid model to the new readings, or refit a physical model",
        )
    ids, whole = _reading_ids(readings), readings
    readings, free, lengths, is_new_tip = _checked(model, readings, free, lengths)
    begun = time.perf_counter()
    new: Model = copy.copy(model)
    assert isinstance(new, IdentifiedModel)
    new.training_ = model.training_.after_transfer(whole, lengths)
    new.session_frames_ = {} if "base" in free else model.session_frames_
    readings = to_first_session_frame(readings, new.session_frames_)
    state = new.state(readings)
    references = references_of(readings, lengths)
    terms = constants(model.arm_.chain, free=free, angle_std=0.0, length_std=0.0)

    def transfer(fit: IdentificationResult, unexplained_std: float) -> IdentificationResult:
        chain = fit.perturbed_chain.chain
        if "base" in free:
            seen = readings.has_point
            assert readings.points is not None
            chain = chain.with_reference_frame(align(fit.tips(state.rows(seen)), readings.points[seen]))
        return consider_update(
            fit,
            chain,
            state,
            terms,
            references,
            unexplained_std=unexplained_std,
            robust=model.robust,
            progress=progress,
        )

    new.nominal_ = transfer(model.nominal_, model.nominal_.references[0].noise_std)
    new.fit_ = transfer(model.fit_, model.residual_std_)
    process, unexplained_std = model.residual_process_, model.residual_std_
    if process is not None and process.is_kept and "base" in free:
        unexplained_without = max(process.residual_std_without_mm, model.residual_std_)
        without = transfer(without_process(model.fit_), unexplained_without)
        improvement = transfer_improvement(new.fit_, without, terms, readings, state, references)
        new.residual_process_ = process.after_transfer(*improvement)
        if not new.residual_process_.is_kept:
            new.fit_, unexplained_std = without, unexplained_without
    elif process is not None:
        new.residual_process_ = process.after_transfer_untested()
    # The identified arm explains what is unusual of the nominal one.
    bare = [without_sizes(reference) for reference in references]
    usual = usual_nominal_error(model.arm_, new.nominal_, state, bare, constants(model.arm_.chain, free=free))
    new.nominal_check_ = NominalCheck(typical_error(new.fit_), usual)
    with explaining(model.arm_, readings, lengths=lengths, free=free):
        refuse_implausible(new.nominal_check_, model.arm_, readings, new.nominal_.tips(state))
    new.residual_std_ = max(unexplained_std, new.fit_.references[0].noise_std)
    new.free_, new.tips_ = free, tip_names(whole) if is_new_tip else model.tips_
    new.held_out_, new.held_out_distances_, new.held_out_errors_ = NONE_HELD_OUT, NONE_HELD_OUT, None
    new.refit_reading_ids_ = np.concatenate([model.refit_reading_ids_, ids])
    new.fit_seconds_ = time.perf_counter() - begun
    return new


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


def used_in_refit(model: Compensator, readings: Session) -> BoolArray:
    """(n,) True for readings from which base and tip were re-identified: they are no independent test."""
    ids = model.refit_reading_ids_ if isinstance(model, IdentifiedModel) else np.zeros(0)
    if not len(ids):
        return np.zeros(len(readings), dtype=bool)
    return np.isin(_reading_ids(readings), ids)


def _reading_ids(readings: Session) -> FloatArray:
    """(n,) a whole number below 2**52 for every reading: first bits of the SHA-256 of what was measured."""
    numbers = [readings.angles]
    if readings.points is not None:
        numbers.append(np.nan_to_num(readings.points))
    rows = np.round(np.hstack(numbers) / ID_RESOLUTION).astype("<i8")
    seat = np.full(len(readings), "") if readings.seat is None else readings.seat
    if readings.anchor is not None:
        seat = np.char.add(seat, readings.anchor)
    names = [name.encode() for name in seat.tolist()]
    # Only where there are any: identifiers in older files stay valid.
    if readings.distance_mm is not None:
        for i in np.flatnonzero(rows_with_distance(readings)):
            names[i] += b" at " + np.round(readings.distance_mm[i] / ID_RESOLUTION).astype("<i8").tobytes()
    if readings.tip is not None:
        names = [name + b" of " + tip.encode() for name, tip in zip(names, readings.tip.tolist(), strict=True)]
    digests = (hashlib.sha256(row.tobytes() + name) for row, name in zip(rows, names, strict=True))
    return np.array([int.from_bytes(digest.digest()[:8], "little") >> 12 for digest in digests], dtype=float)
