"""Session transfer: the arm of a model in a new set-up, its base and tip identified anew from a few readings."""

from __future__ import annotations

import copy
import hashlib
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np
from sklearn.utils.validation import check_is_fitted

from truearm.compensation.models.compensator import FREE_PARTS, MIN_ROWS, Compensator
from truearm.compensation.models.identified_model import NONE_HELD_OUT, IdentifiedModel
from truearm.compensation.models.reading_references import check_spread, references_of
from truearm.compensation.models.session_frames import rough_session_frames, to_first_session_frame
from truearm.errors import InputError
from truearm.identification.estimation.alignment import align
from truearm.identification.estimation.consider_parameters import consider_update
from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.terms import constants
from truearm.readings.checks import check_sessions
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray

Model = TypeVar("Model", bound=Compensator)

# Numbers go into a reading's mark as multiples of this [rad, mm]: angles come back from a file to 1e-12 of their value.
MARKED_TO = 1e-9


def refit(
    model: Model,
    readings: Session,
    *,
    free: tuple[str, ...] = ("base", "tip"),
    lengths: Lengths | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> Model:
    """Take a model's arm to a new set-up: a tracker elsewhere, another probe.

    Only where the base stands and where the tip sits is identified from the new readings; four will do. All that was
    found of the arm keeps its values, and its uncertainty goes into that of base and tip, with which it is correlated
    from then on (`truearm.identification.estimation.consider_parameters`).

    Parameters
    ----------
    model : Compensator
        Fitted. It stays as it is.
    readings : Session
        Of the new set-up, with reference points, seats or surfaces; orientations are not used.
    free : tuple of str
        What is new: ``"base"``, ``"tip"`` or both. Without reference points the base stays where it was.
    lengths : Lengths, optional
        Known lengths between seats of the readings.
    progress : callable, optional
        Told the rounds done and how it stands.

    Returns
    -------
    Compensator
        Of the same class. `residual_std_` is that of `model`, or larger if the new readings say so (see
        `consider_update`). `held_out_` is empty; `angle_ranges_` and `n_train_` are those of the arm;
        `data_fingerprint_` is that of the new readings.

    Raises
    ------
    InputError
        If the model is a network, the readings do not fit the arm or are too few, or the base is to stay and points are
        of a session whose frame a model of several does not know.
    """
    check_is_fitted(model)
    if not isinstance(model, IdentifiedModel):
        raise InputError(
            "a network learns coordinates as a whole: it knows no base and no tip that could be identified anew",
            hint="fit a network to the new readings, or refit a physical model",
        )
    if not free or not set(free) <= set(FREE_PARTS):
        raise InputError(f"expected what is new among {list(FREE_PARTS)}, got {list(free)}")
    model._check_inputs(model.arm_, readings)
    marks, whole = _marks(readings), readings
    readings = replace(readings, quaternion=None)
    if lengths is not None:
        if readings.seat is None:
            raise readings.error("lengths are between seats, and the readings name none", column="seat")
        lengths = lengths.between(readings.seat)
    check_sessions(readings, lengths, own_frame=not {"base"} & {*free, *model.free})
    n_known = model._check_references(readings, lengths)
    if n_known < MIN_ROWS:
        raise readings.error(f"expected {MIN_ROWS} or more readings with a reference, got {n_known}")
    if not readings.has_point.any():
        free = tuple(part for part in free if part != "base")
        if not free:
            raise readings.error(
                "the base is where reference points say, and the readings have none", hint="--free tip"
            )
    elif "base" in free:
        check_spread(readings, model.arm)
        if rough_session_frames(model.arm, readings, free):
            raise readings.error(
                "a refit finds one frame, and the readings are of several sessions",
                column="session",
                hint="refit each by itself: truearm split --by session",
            )
    else:
        _check_known_sessions(model, readings)
    begun = time.perf_counter()
    new: Model = copy.copy(model)
    assert isinstance(new, IdentifiedModel)
    new.training_ = model.training_.after_transfer(whole, lengths)
    new.session_frames_ = {} if "base" in free else model.session_frames_
    readings = to_first_session_frame(readings, new.session_frames_)
    state = new.state(readings)
    references = references_of(readings, lengths)
    terms = constants(model.arm_.chain, free=free, angle_std=0.0, length_std=0.0)

    def anew(fit: IdentificationResult, unexplained_std: float) -> IdentificationResult:
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

    new.nominal_ = anew(model.nominal_, model.nominal_.references[0].noise_std)
    new._check_nominal(readings)
    new.fit_ = anew(model.fit_, model.residual_std_)
    new.residual_std_ = max(model.residual_std_, new.fit_.references[0].noise_std)
    new.free_ = free
    new.held_out_, new.held_out_errors_ = NONE_HELD_OUT, None
    new.refit_reading_ids_ = np.concatenate([model.refit_reading_ids_, marks])
    new.fit_seconds_ = time.perf_counter() - begun
    return new


def _check_known_sessions(model: Compensator, readings: Session) -> None:
    """Check that the points of a base that stays are in frames that the model knows, if it knows several."""
    known = list(model.session_frames_)
    session = np.full(len(readings), "") if readings.session is None else readings.session
    unknown = readings.has_point & ~np.isin(session, known)
    if known and unknown.any():
        row = int(np.argmax(unknown))
        raise readings.error(
            f"the model knows the frames of the sessions {', '.join(known)}, got a point "
            + (f"of session {str(session[row])!r}" if session[row] else "that names none"),
            row,
            column="session",
            hint="name the session of the model that the points are of; for a new set-up --free base,tip",
        )


def used_in_refit(model: Compensator, readings: Session) -> BoolArray:
    """(n,) True for the readings from which the model's base and tip were identified anew: no test is fair on them."""
    marks = model.refit_reading_ids_ if isinstance(model, IdentifiedModel) else np.zeros(0)
    if not len(marks):
        return np.zeros(len(readings), dtype=bool)
    return np.isin(_marks(readings), marks)


def _marks(readings: Session) -> FloatArray:
    """(n,) a whole number below 2**52 for every reading: the first bits of the SHA-256 of angles, point and seat."""
    numbers = [readings.angles]
    if readings.points is not None:
        numbers.append(np.nan_to_num(readings.points))
    rows = np.round(np.hstack(numbers) / MARKED_TO).astype("<i8")
    seat = np.full(len(readings), "") if readings.seat is None else readings.seat
    digests = (hashlib.sha256(row.tobytes() + name.encode()) for row, name in zip(rows, seat.tolist(), strict=True))
    return np.array([int.from_bytes(digest.digest()[:8], "little") >> 12 for digest in digests], dtype=float)
