"""What the verbs accept: objects or files, with the guards that both doors share.

The command line gives paths, so that messages name file, line and column; in Python objects serve as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from hashlib import file_digest, sha256
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from truearm.acceptance import accepted_in_fit
from truearm.arm import Arm, load_arm
from truearm.choices import Limits as Limits
from truearm.errors import InputError
from truearm.findings import Finding, findings_of, format_mm
from truearm.identification.judgement.description_check import explain_readings
from truearm.identification.judgement.nominal_check import MAX_NOMINAL_ERROR
from truearm.identification.references.prepared_readings import MIN_ROWS
from truearm.identification.references.reading_references import check_spread
from truearm.identification.references.tips import tip_names
from truearm.models import Compensator
from truearm.models.compensator import FREE_PARTS, CheckedReadings
from truearm.models.identified_model import to_identified
from truearm.models.model_archive import MODEL_BEGINS, begins_as_model, model_bytes
from truearm.models.model_file import load_model
from truearm.models.training_conditions import TrainingConditions
from truearm.readings import (
    Lengths,
    Session,
    check_reach,
    has_reference,
    has_repeated_seat,
    point_errors,
    read_lengths,
    read_session,
    seat_errors,
)
from truearm.readings.anchors import LEAST_COMPARED, LEAST_READINGS, distance_errors, has_located_anchor
from truearm.readings.checks import MAX_SKIPPED_SHARE, check_session_fits, frozen_joints, skip_not_of_arm
from truearm.readings.readings import PAYLOAD
from truearm.readings.repeats import MergedReadings, merge_repeats
from truearm.readings.session import doubtful_names
from truearm.readings.thermal_expansion import REFERENCE_DEGC, STEEL_PER_K, thermal_expansion_of
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.verbs.record import agree, number_of

if TYPE_CHECKING:
    import pandas as pd

ArmLike: TypeAlias = "Arm | str | Path"
SessionLike: TypeAlias = "Session | pd.DataFrame | str | Path"
ModelLike: TypeAlias = "Compensator | str | Path"
LengthsLike: TypeAlias = "Lengths | str | Path"

# A length with a larger relative uncertainty does not determine the size of an arm, or its uncertainty is in um.
MAX_RELATIVE_U = 0.005
# Lines that a remark names one by one.
MAX_NAMED = 6


class CheckedSession(NamedTuple):
    """The readings of a session that a verb uses, with what it did to select them.

    Attributes
    ----------
    session : Session
        The readings used.
    rows : (n,) array of int
        Their rows in the session as it was given, counted from 0.
    findings : tuple of Finding
        What was skipped, and why.
    n_training : int
        Training readings that were skipped.
    lengths : Lengths or None
        Known lengths between their seats.
    n_allowed : int
        Readings within the limits, training readings and repeats among them; 0 before repeats are looked for.
    merged : MergedReadings or None
        What stands for repeats.
    """

    session: Session
    rows: IntArray
    findings: tuple[Finding, ...]
    n_training: int = 0
    lengths: Lengths | None = None
    n_allowed: int = 0
    merged: MergedReadings[Session] | None = None


def to_arm(arm: ArmLike) -> Arm:
    """An arm as it is; one of the catalogue by its name; one from an arm file or a URDF by its path.

    Raises
    ------
    InputError
        If it is none of these, or cannot be read.
    """
    if isinstance(arm, Arm):
        return arm
    if not isinstance(arm, str | Path):
        raise InputError(
            f"expected an arm, got {type(arm).__name__}", hint="an Arm, a name of list_arms(), an arm file or a URDF"
        )
    return load_arm(arm)


def to_session(session: SessionLike, *, n_joints: int | None = None) -> Session:
    """A session as it is, from a DataFrame with the columns of a session file, or from a file.

    Raises
    ------
    InputError
        If it is none of these, or cannot be read.
    """
    if isinstance(session, Session):
        return session
    if isinstance(session, str | Path):
        return read_session(session, n_joints=n_joints)
    if not hasattr(session, "columns"):
        raise InputError(
            f"expected a session, got {type(session).__name__}",
            hint="a Session, a DataFrame or a session file; Session(angles, points) takes arrays in rad and mm",
        )
    return Session.from_frame(session)


def to_model_and_session(model: object, session: SessionLike) -> tuple[Compensator, Session]:
    """A model and a session of as many joints.

    Raises
    ------
    InputError
        If one of them cannot be read, or they are given the other way round.
    """
    if isinstance(session, str | Path) and is_model_file(session):
        raise InputError("expected a session file, got a model file", file=session, hint="give the model first")
    fitted = to_model(model)
    return fitted, to_session(session, n_joints=fitted.arm.n_joints)


def allowed_in_part(readings: Session, arm: Arm, limits: Limits, accept: str | None) -> CheckedSession:
    """The readings of a part within the joint limits, by `within_limits`.

    How many are beyond them is judged over all parts. Where a person accepts it, it is judged in each, to skip none.
    """
    allowed = within_limits(readings, arm, limits, most=1.0 if accept is None else MAX_SKIPPED_SHARE)
    return allowed._replace(findings=of_file(allowed.findings, readings.file))


def of_file(findings: Iterable[Finding], file: Path | None) -> tuple[Finding, ...]:
    """Findings of a part of a session; those that name lines name its file."""
    name, by_line = "" if file is None else f"{file.name}: ", ("joint limits", "unfilled rows")
    return tuple(replace(one, sentence=f"{name}{one}") if one.what in by_line else one for one in findings)


def is_model_file(path: str | Path) -> bool:
    """Whether a file begins as model files do, and not as other archives, such as workbooks."""
    if not Path(path).is_file():
        return False
    with Path(path).open("rb") as file:
        return begins_as_model(file.read(MODEL_BEGINS))


def to_model(model: object) -> Compensator:
    """A fitted model as it is, or from a model file.

    Raises
    ------
    InputError
        If it is not fitted, or cannot be read.
    """
    if isinstance(model, str | Path):
        return load_model(model)
    if not isinstance(model, Compensator):
        got = f"the class {model.__name__}" if isinstance(model, type) else type(model).__name__
        hint = "a fitted model or a model file; evaluate and report also take any fitted object with predict(angles)"
        raise InputError(f"expected a model, got {got}", hint=hint)
    if not hasattr(model, "arm_"):
        raise InputError(f"the {type(model).__name__} is not fitted", hint="fit it first: model.fit_readings(session)")
    return model


def model_file_fingerprint(model: ModelLike) -> str:
    """SHA-256 of the model file, or of that which a model writes: the same model gives the same file."""
    if isinstance(model, str | Path):
        with Path(model).open("rb") as stream:
            return file_digest(stream, "sha256").hexdigest()
    return sha256(model_bytes(model)).hexdigest()


def to_model_of_tip(model: ModelLike, tip: str | None = None) -> Compensator:
    """A fitted model that predicts one tip: its only one, or the one named.

    Raises
    ------
    InputError
        If the model has several tips and none is named, or none of that name.
    """
    fitted = to_model(model)
    if tip is not None:
        return fitted.with_tip(tip)
    if len(fitted.tips_) > 1:
        raise InputError(
            f"expected one tip, the model has {len(fitted.tips_)}: {', '.join(fitted.tips_[:MAX_NAMED])}",
            file=model if isinstance(model, str | Path) else None,
            hint=f"choose one: model.with_tip({fitted.tips_[0]!r}) in Python, --tip where the command has it",
        )
    return fitted


def model_of_tip_of(model: Compensator, readings: Session) -> Compensator:
    """The model of the one tip of the readings.

    Raises
    ------
    InputError
        If the readings are of several tips, or the model has several and they name none.
    """
    tips = tip_names(readings)
    if len(tips) > 1:
        raise readings.error(
            f"expected the readings of one tip, got those of {len(tips)}",
            column="tip",
            hint="one command for each tip; truearm evaluate compares all of them",
        )
    return to_model_of_tip(model, tips[0] if tips and len(model.tips_) > 1 else None)


def to_free_parts(free: Iterable[str]) -> tuple[str, ...]:
    """Check which parts are free: any of ``base`` and ``tip``."""
    parts = (free,) if isinstance(free, str) else tuple(free)
    if not set(parts) <= set(FREE_PARTS):
        raise InputError(f"expected free parts among base and tip, got {list(parts)}", hint="('base', 'tip')")
    return parts


def within_limits(
    session: Session, arm: Arm, limits: Limits = "skip", *, most: float = MAX_SKIPPED_SHARE
) -> CheckedSession:
    """Skip the readings beyond a joint limit, or use them all with ``"ignore"``.

    Raises
    ------
    InputError
        If the number of joints or the unit of one is not that of the arm, a temperature is that of no room, or more
        than a share `most` of the readings are beyond a limit.
    """
    if limits not in ("skip", "ignore"):
        raise InputError(f"expected limits 'skip' or 'ignore', got {limits!r}")
    rows, unfilled = np.arange(len(session)), unfilled_rows(session)
    slides = arm.chain.is_prismatic
    kept, skipped = skip_not_of_arm(session, arm.limits, n_joints=arm.n_joints, prismatic=slides, most=most)
    if limits == "ignore" or not skipped:
        return CheckedSession(session, rows, unfilled)
    beyond = [excess.row for excess in skipped]
    remark = (
        f"{len(beyond)} of {number_of(len(session))} {agree(len(beyond), 'are')} beyond a joint limit and "
        f"{agree(len(beyond), 'were')} skipped: "
        f"{join_labels(session, beyond)}."
    )
    found = Finding("joint limits", remark, {"n": len(beyond)})
    return CheckedSession(kept, np.setdiff1d(rows, beyond), (*unfilled, found))


def unfilled_rows(session: Session) -> tuple[Finding, ...]:
    """How many rows of the file are not filled in yet; nothing if none."""
    n = len(session.unfilled)
    if not n:
        return ()
    said = f"{n} of {n + len(session)} rows {agree(n, 'are')} not filled in yet (no number); ignored."
    return (Finding("unfilled rows", said, {"n": n}),)


def check_angles_fit(session: Session, arm: Arm) -> tuple[Finding, ...]:
    """Check that the angles can be of the arm; readings beyond a joint limit are named.

    Raises
    ------
    InputError
        As `within_limits`.
    """
    rows = within_limits(session, arm).rows
    if len(rows) == len(session):
        return unfilled_rows(session)
    beyond = np.setdiff1d(np.arange(len(session)), rows).tolist()
    readings_are = f"{len(beyond)} of {number_of(len(session))} {agree(len(beyond), 'are')}"
    said = f"{readings_are} beyond a joint limit: {join_labels(session, beyond)}."
    return (*unfilled_rows(session), Finding("joint limits", said, {"n": len(beyond)}))


def join_labels(session: Session, rows: list[int]) -> str:
    """Name readings by their lines, the first `MAX_NAMED` of them."""
    more = f" and {len(rows) - MAX_NAMED} more" if len(rows) > MAX_NAMED else ""
    return ", ".join(session.called(row) for row in rows[:MAX_NAMED]) + more


def check_has_reference(session: Session, arm: Arm | None, *, purpose: str, least: int = LEAST_READINGS) -> None:
    """Check that there is something to compare the points of a model with: reference points, seats or distances.

    Raises
    ------
    InputError
        If there is none of these, or the arm cannot reach a point.
    """
    has_seat = session.seat is not None and bool((session.seat != "").any())
    if session.points is None and not has_seat and not has_located_anchor(session, least):
        raise session.error(
            f"expected reference points, seats or {least} distances to an anchor to {purpose}, the session "
            "has none of these",
            hint="predict needs none",
        )
    if arm is not None and arm.has_kinematics:
        check_reach(session, reach=arm.chain.reach, sliding=arm.chain.is_prismatic)


def with_reference(session: Session, arm: Arm) -> CheckedSession:
    """Select the readings within the joint limits that have reference points; if there are none, those in seats.

    Raises
    ------
    InputError
        As `within_limits` and `check_has_reference`.
    """
    allowed = within_limits(session, arm)
    session = allowed.session
    check_has_reference(session, arm, purpose="compare with")
    useful, lack = session.has_point, "have no reference point"
    if not useful.any() and session.seat is not None:
        useful, lack = session.seat != "", "are in no seat"
    if not useful.any():
        raise session.error(
            "expected reference points or seats to compare with, the session has distances to anchors only",
            hint="truearm evaluate MODEL SESSION",
        )
    if useful.all():
        return allowed
    remark = f"{int((~useful).sum())} of {len(session)} readings {lack} and are skipped."
    found = (*allowed.findings, Finding("no reference", remark))
    return CheckedSession(session.rows(useful), allowed.rows[useful], found)


def session_lengths(
    lengths: LengthsLike | None, session: Session, used: Session | None = None
) -> tuple[Lengths | None, tuple[Finding, ...]]:
    """The lengths between seats of a session, and findings of those that are ignored.

    Parameters
    ----------
    lengths : Lengths, str, Path or None
    session : Session
        Names of seats are checked against all of its readings.
    used : Session, optional
        Those of its readings that are used; lengths between other seats are ignored.

    Raises
    ------
    InputError
        If the session has no seats, or a name is unknown.
    """
    if lengths is None:
        return None, ()
    file = lengths.file if isinstance(lengths, Lengths) else Path(lengths)
    if session.seat is None:
        raise InputError("lengths are between seats, and the session has none", file=file, hint="add a column seat")
    stated = lengths if isinstance(lengths, Lengths) else read_lengths(lengths)
    remarks = []
    if (large := stated.u_mm > MAX_RELATIVE_U * stated.length_mm).any():
        row, n_more = int(large.argmax()), int(large.sum()) - 1
        more = f" (and {number_of(n_more, 'more length')} with such an uncertainty)" if n_more else ""
        remarks.append(
            f"The standard uncertainty of the length in {stated.called(row)}, {stated.u_mm[row]:.4g} mm, is "
            f"{stated.u_mm[row] / stated.length_mm[row]:.1%} of it{more}: it says little about the size of the arm. "
            "Check its unit; 5 micrometres are 0.005 mm."
        )
    known: Lengths | None = stated.between([*session.seat.tolist(), *session.unfilled])
    if session.unfilled and used is None:
        used = session
    if known is not None and (n := len(stated) - len(known)):
        remarks.append(f"{n} of {len(stated)} lengths refer to seats that are not in this session; ignored.")
    if used is not None and used.seat is not None and known is not None:
        n_known = len(known)
        known = known.within(used.seat.tolist())
        if n := n_known - (0 if known is None else len(known)):
            remarks.append(f"{n} of {n_known} lengths refer to a seat without a reading that is used; ignored.")
    remarks += _unknown_expansion(known, session if used is None else used)
    return known, findings_of("lengths", remarks)


def _unknown_expansion(lengths: Lengths | None, session: Session) -> tuple[str, ...]:
    """Say which lengths are used as at 20 degC because a temperature or an expansion is missing, where it matters."""
    if lengths is None or session.seat is None:
        return ()
    degC = session.temperature_degC
    if degC is None:
        if lengths.expansion_per_K is None:
            return ()
        return (f"Lengths are used as at {REFERENCE_DEGC:g} degC: the session states no temperature.",)
    expansion = thermal_expansion_of(lengths, session.seat, degC)
    steel = np.abs(lengths.length_mm * STEEL_PER_K * (degC.mean() - REFERENCE_DEGC))
    unknown = ~expansion.known & (steel > lengths.u_mm)
    if not unknown.any():
        return ()
    remark = (
        f"{int(unknown.sum())} of {len(lengths)} lengths are used as at {REFERENCE_DEGC:g} degC; at the readings' "
        f"{degC.mean():.1f} degC steel differs by {steel[unknown].max():.4f} mm. State the columns expansion_per_K and "
        "u_expansion_per_K of the lengths."
    )
    return (remark,)


def without_training_readings(session: Session, *models: Compensator) -> tuple[Session, IntArray, tuple[Finding, ...]]:
    """Skip the readings that a model was fitted or refitted to: a test on them is not fair.

    Returns
    -------
    session : Session
        The others, and those of a fit of which the model knows a sample; all if there are none to compare with.
    rows : (n,) array of int
        Their rows in `session`.
    findings : tuple of Finding
    """
    known = np.any([model.skipped_in_tests(session) for model in models], axis=0)
    if known.all() or not known.any() or not _is_compared_as(session, others := session.rows(~known)):
        return session, np.arange(len(session)), ()
    return others, np.flatnonzero(~known), skipped_training(int(known.sum()), len(session))


def skipped_training(n_training: int, n: int) -> tuple[Finding, ...]:
    """That of `n` readings those of the training were skipped; nothing if there are none."""
    if not n_training:
        return ()
    are = agree(n_training, "are")
    remark = f"{n_training} of {n} {are} training readings of the model and {are} skipped: all figures are of others."
    return (Finding("training readings", remark, {"n": n_training}),)


def _is_compared_as(session: Session, some: Session) -> bool:
    """Whether some readings of a session have what its points are compared with: points, else seats or distances."""
    if session.has_point.any():
        return bool(some.has_point.any())
    return bool(has_reference(some).any()) and (some.seat is not None or has_located_anchor(some, LEAST_COMPARED))


def repeated_readings(used: CheckedSession, fitted: Compensator | None = None) -> Iterator[Finding]:
    """How many readings are repeats, and how these scatter; beside the poses about a model that was fitted to them."""
    if (merged := used.merged) is None:
        return
    if merged.n_changed:
        were = f"{number_of(merged.n_changed, 'pose')} {agree(merged.n_changed, 'were')}"
        said = (
            f"{were} read again in a later round and not merged with it: between the rounds they changed by more than "
            "noise. Something moved: the base, the reference, the tip or a joint."
        )
        yield Finding("rounds", said, {"n": merged.n_changed})
    n, several = int(merged.count.sum()), merged.count[merged.count > 1]
    if not len(several):
        return
    least, most = int(several.min()), int(several.max())
    times = f"{most} times" if least == most else f"{least} to {most} times"
    poses = number_of(len(several), "pose")
    told = f"{n} readings are {poses} read {times}"
    if len(several) < len(merged.count):
        told = f"{several.sum()} of {n} readings repeat each other: {poses} {agree(len(several), 'were')} read {times}"
    scatter = ""
    if merged.scatter_mm > 0:
        scatter = f" The repeats scatter by {format_mm(merged.scatter_mm)}"
        if fitted is not None and fitted.arm.has_kinematics:
            averaged = float(merged.readings.averaged_mm2.mean())
            of_one = fitted.facts().get("residual_std_mm")
            left = fitted.nominal_error() if of_one is None else np.sqrt(max(of_one**2 - averaged, 0.0))
            scatter += f", the poses by {format_mm(left)}"
        scatter += "."
    elif merged.readings.points is not None or merged.readings.distance_mm is not None:
        scatter = " Where they have coordinates or distances these agree to the last digit, as copies do."
    said = f"{told}; each counts as one reading, their mean, named by its first line.{scatter}"
    yield Finding("repeats", said, {"n": n, "scatter_mm": merged.scatter_mm})


def used_readings(
    given: Session, arm: Arm | None, *models: Compensator, limits: Limits = "skip", lengths: LengthsLike | None = None
) -> CheckedSession:
    """The readings that a test uses: those within the limits of the arm, repeats as one, and no training reading.

    Parameters
    ----------
    given : Session
    arm : Arm or None
        Without one there are no limits.
    *models : Compensator
        Models that are tested on them.
    limits : {"skip", "ignore"}
    lengths : Lengths, str, Path or None
        Names of seats are checked against all readings.

    Raises
    ------
    InputError
        As `within_limits`, `check_has_reference` and `session_lengths`.
    """
    if arm is None:
        allowed = CheckedSession(given, np.arange(len(given)), unfilled_rows(given))
    else:
        allowed = within_limits(given, arm, limits)
    check_has_reference(allowed.session, arm, purpose="evaluate against", least=LEAST_COMPARED)
    return tested_readings(allowed, given, lengths, *models)


def tested_readings(
    allowed: CheckedSession, given: Session, lengths: LengthsLike | None, *models: Compensator
) -> CheckedSession:
    """The `used_readings` of those that are within the limits: repeats as one, and no training reading.

    Raises
    ------
    InputError
        As `session_lengths`.
    """
    used = _selected(allowed, given, lengths, *models)
    return used._replace(findings=(*used.findings, *repeated_readings(used)))


def _selected(
    allowed: CheckedSession, given: Session, lengths: LengthsLike | None, *models: Compensator
) -> CheckedSession:
    others, rows = allowed.session, np.arange(len(allowed.session))
    of_training: tuple[Finding, ...] = ()
    if models:
        others, rows, of_training = without_training_readings(others, *models)
    merged = merge_repeats(others)
    used = merged.readings
    known, of_lengths = session_lengths(lengths, given, used)
    found = (*allowed.findings, *of_training, *of_lengths)
    at = allowed.rows[rows[merged.first]]
    return CheckedSession(used, at, found, len(allowed.rows) - len(rows), known, len(allowed.rows), merged)


def readings_to_fit(
    given: Session, arm: Arm, model: str, *, limits: Limits, lengths: LengthsLike | None, is_base_free: bool
) -> CheckedSession:
    """The readings that a model of a kind can be fitted to: those within the limits of the arm, repeats as one.

    Raises
    ------
    InputError
        As `within_limits`, `session_lengths`, `check_session_fits` and `check_spread`; or if they are enough only where
        those of one pose count more than once.
    """
    used = _selected(within_limits(given, arm, limits), given, lengths)
    n, reach = len(used.session), arm.chain.reach if arm.has_kinematics else None
    if n < MIN_ROWS <= used.n_allowed:
        raise given.error(
            f"expected at least {MIN_ROWS} poses, got {number_of(n, 'pose')} ({used.n_allowed} readings repeat them)",
            hint="measure more poses, spread over all joints",
        )
    slides = arm.chain.is_prismatic
    check_session_fits(used.session, model, n_joints=arm.n_joints, min_rows=MIN_ROWS, reach=reach, sliding=slides)
    if is_base_free:
        check_spread(used.session, arm)
    frozen = findings_of("still joint", frozen_joints(given, slides))
    return used._replace(findings=(*used.findings, *doubtful_names(given, used.lengths), *frozen))


def training_findings(model: Compensator, n_known: int, n: int) -> tuple[Finding, ...]:
    """That of `n` readings `n_known` are known from the fit of the model, or about as many times as it was a sample."""
    training, some, kept = model.training_, "", ""
    if training.readings_per_known > 1 and training.known is not None:
        n_known = min(round(training.readings_per_known * n_known), n)
        some, kept = "about ", f" (its file knows {training.known.n_of_fit} of {training.n_readings})"
    if n_known:
        are = agree(n_known, "are")
        said = f"{some}{n_known} of {n} {are} training readings of the model{kept}: a fair test needs others (split)."
        return (Finding("known readings", said, {"n": n_known}),)
    if training.known is None and (identified := to_identified(model)) is not None and identified.is_refitted:
        said = "An earlier version refitted the model: readings of that refit are not recognised. Refit it again."
        return (Finding("known readings", said),)
    return ()


def describe_outside(inputs: Mapping[str, BoolArray], training: TrainingConditions, session: Session) -> str:
    """How many readings are outside the trained range, and in which inputs; a sentence without its full stop."""
    rows = np.logical_or.reduce(list(inputs.values()))
    n = int(rows.sum())
    if list(inputs) == ["temperature"] and session.temperature_degC is not None:
        readings_are = f"{n} of {number_of(len(rows))} {agree(n, 'are')}"
        return f"{readings_are} {_kelvin(training, session.temperature_degC[rows])}"
    return count_outside({name: int(outside.sum()) for name, outside in inputs.items()}, n, len(rows))


def count_outside(inputs: Mapping[str, int], n_outside: int, n: int) -> str:
    """How many of `n` readings are outside the trained range, and in which inputs how many."""
    what = ", ".join(f"{name} {count}" for name, count in inputs.items())
    return f"{n_outside} of {number_of(n)} {agree(n_outside, 'are')} outside the trained range ({what})"


def _kelvin(training: TrainingConditions, degC: FloatArray) -> str:
    """By how much readings were warmer or colder than those of the training, in words."""
    known = training.temperature_degC
    lower, upper = (REFERENCE_DEGC, REFERENCE_DEGC) if known is None else (known.lower, known.upper)
    phrases = []
    for kelvin, word in ((degC - upper, "warmer"), (lower - degC, "colder")):
        if (kelvin > 0).any():
            least, most = f"{kelvin[kelvin > 0].min():.1f}", f"{kelvin.max():.1f}"
            phrases.append(f"{most if least == most else f'{least} to {most}'} K {word}")
    than = "than 20 degC; the training states no temperature" if known is None else "than the training"
    return f"{' or '.join(phrases)} {than}; all else is in the trained range"


def payload_findings(training: TrainingConditions, session: Session) -> tuple[Finding, ...]:
    """That a payload is not in the model, where only the session states one, or assumed, where only the training does.

    A payload that varied in the training has its share of the uncertainty (`unstated_input_covariances`).
    """
    if training.ignores_payload(session):
        remark = (
            f"The model was trained without {PAYLOAD}: neither the points nor their uncertainty contain it. Fit with "
            "that column (0 without a payload)."
        )
        return (Finding("payload", remark),)
    known = training.columns.get(PAYLOAD)
    if known is None or known.lower < known.upper or PAYLOAD in session.columns:
        return ()
    said = f"{PAYLOAD} is not stated: {known.mean:g} kg assumed, as in the training. The uncertainty contains no other "
    return (Finding("payload", f"{said}payload.", {"assumed_kg": known.mean}),)


def fit_findings(model: Compensator) -> tuple[Finding, ...]:
    """What was accepted in its fit; doubt about its arm; that its base is nominal without reference points."""
    of_fit = findings_of("acceptance in the fit", accepted_in_fit(model.accepted_))
    of_fit += findings_of("nominal arm", filter(None, [model.arm_doubt_]))
    if "base" not in model.free or not np.array_equal(model.nominal_.chain.fixed[0], model.arm_.chain.fixed[0]):
        return of_fit
    said = (
        "Coordinates are in the arm's own frame: the base is nominal, as the model was learned without reference "
        "points. truearm refit MODEL FILE --free base places it from four or more points."
    )
    return (*of_fit, Finding("base", said))


def nominal_error_findings(model: Compensator, error_mm: float, of: str = "points") -> tuple[Finding, ...]:
    """A finding where the nominal arm misses references by so much that they are of another set-up, arm or unit."""
    if error_mm <= MAX_NOMINAL_ERROR * model.arm.chain.reach:
        return ()
    moved = "If reference or base moved, transfer the model to the new set-up (refit); otherwise check the session"
    if of != "points":
        moved = "Check that the readings of one name are of one place, and the session"
    said = f"The nominal arm misses these {of} by {error_mm:.0f} mm. {moved} for another arm, unit, sign or zero."
    return (Finding("nominal error", said, {"error_mm": error_mm}),)


def _missed_by(nominal: FloatArray, session: Session) -> tuple[float, str] | None:
    """Mean error of nominal points (n, 3) [mm], and of what; None without a reference."""
    if session.points is not None:
        return point_errors(nominal, session.points)["mean_mm"], "points"
    if session.seat is not None and has_repeated_seat(session):
        return seat_errors(nominal, session.seat)["seat_mean_mm"], "seats"
    if has_located_anchor(session, LEAST_COMPARED):
        return distance_errors(nominal, session)["distance_mean_mm"], "distances"
    return None


def evaluation_findings(at: CheckedReadings, nominal: FloatArray | None) -> Iterator[Finding]:
    """What a person must know of a model before the errors on these readings are believed.

    Parameters
    ----------
    at : CheckedReadings
    nominal : (n, 3) array or None
        Points of the nominal arm there [mm]; None without an arm.
    """
    model, session, _ = at
    training, slides = model.training_, model.arm_.chain.is_prismatic
    if nominal is not None and (missed := _missed_by(nominal, session)) is not None:
        found = nominal_error_findings(model, *missed)
        yield from found
        if found and (explained := explain_readings(model.arm_, session)) is not None:
            yield Finding("nominal error", f"{explained[0].upper()}{explained[1:]}.")
    if inputs := training.outside(session, slides):
        yield Finding("trained range", f"{describe_outside(inputs, training, session)}.")
    yield from payload_findings(training, session)
    yield from fit_findings(model)
    yield from training_findings(model, int(training.among(session, slides).sum()), len(session))
