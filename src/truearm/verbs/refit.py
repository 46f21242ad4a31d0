"""Refit: transfer a model to a new set-up of its arm."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearm.acceptance import acceptance_remarks, accepts
from truearm.errors import InputError
from truearm.findings import format_mm
from truearm.identification.judgement.outliers import Outlier, outliers
from truearm.models.compensator import Compensator
from truearm.models.identified_model import IdentifiedModel
from truearm.models.refit import refit as refit_model
from truearm.readings import Session, stratified_rows
from truearm.readings.repeats import merge_repeats
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import (
    LengthsLike,
    Limits,
    ModelLike,
    SessionLike,
    check_has_reference,
    session_lengths,
    to_free_parts,
    to_model_and_session,
    within_limits,
)
from truearm.verbs.record import Record, format_fixed, listed


@one_blas_thread()
@accepts
def refit(
    model: ModelLike,
    session: SessionLike,
    *,
    free: Iterable[str] = ("base", "tip"),
    n_readings: int | None = None,
    seed: int = 0,
    lengths: LengthsLike | None = None,
    limits: Limits = "skip",
    accept: str | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> RefitResult:
    """Transfer a model to a new set-up: identify base and tip again, update the arm.

    The tracker was moved or the probe was changed. Four or more readings determine where base and tip are now; they
    also move the arm's identified coefficients, within their uncertainty and what is usual between set-ups.

    Parameters
    ----------
    model : Compensator, str or Path
        A fitted model or its file. It stays as it is.
    session : Session, DataFrame, str or Path
        Readings of the new set-up, with reference points, seats or distances to anchors.
    free : iterable of {"base", "tip"}
        What is new.
    n_readings : int, optional
        Use this many of the readings, of as many positions as possible; all by default. `evaluate` skips them.
    seed : int
        Of the choice of readings.
    lengths : Lengths, str or Path, optional
        Known lengths between seats of the session.
    limits : {"skip", "ignore"}
        Skip the readings beyond a joint limit, or use them.
    accept : str, optional
        Why the readings are right where they would be refused as contradicted: the reason and what it overrode are
        kept (docs/imperfect-readings.md).
    progress : callable, optional
        Called with the number of rounds done and a note.

    Returns
    -------
    RefitResult

    Raises
    ------
    InputError
        If the model is a network, nothing is free, or the readings are too few or of another arm.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=60, seed=1).session
    >>> first = ta.fit("ur10", session, model="kinematic")
    >>> ta.refit(first.model, session, n_readings=10).n_used
    10
    """
    parts = to_free_parts(free)
    if not parts:
        raise InputError("expected base or tip to be free: else nothing is new", hint="--free base,tip")
    known, given = to_model_and_session(model, session)
    allowed = within_limits(given, known.arm, limits)
    check_has_reference(allowed.session, known.arm, purpose="refit to")
    n_allowed = len(allowed.session)
    rows = np.arange(n_allowed) if n_readings is None else stratified_rows(allowed.session, n_readings, seed=seed)
    used = allowed.session if n_readings is None else allowed.session.rows(rows)
    between, of_lengths = session_lengths(lengths, given, used)
    new = refit_model(known, used, free=parts, lengths=between, progress=progress)
    of_means = allowed.rows[rows[merge_repeats(used).first]]
    _, covariance = new.predict_readings(new.at(allowed.session), return_cov=True)
    return RefitResult(
        model=new,
        session=given,
        n_used=len(used),
        residual_std_before_mm=known.facts()["residual_std_mm"],
        median_u_mm=float(np.median(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))),
        outliers=tuple(outlier.located(given, of_means) for outlier in outliers(new.fit_)),
        remarks=(
            *acceptance_remarks(accept),
            *map(str, (*allowed.findings, *of_lengths)),
            *_remarks(known, new, parts, len(used), len(given)),
        ),
    )


def _remarks(
    known: Compensator, new: IdentifiedModel, free: tuple[str, ...], n_used: int, n_given: int
) -> Iterator[str]:
    yield from known.doubts()
    if "base" in free and "base" not in new.free_:
        yield "The base stays where it was: only reference points determine it."
    if n_used < n_given:
        yield f"evaluate skips these {n_used} readings and tests on the others of this session."


@dataclass(frozen=True, eq=False, repr=False)
class RefitResult(Record):
    """A model in a new set-up.

    Attributes
    ----------
    model : IdentifiedModel
        The new model.
    session : Session
        Of the new set-up.
    n_used : int
        Number of its readings that were used.
    residual_std_before_mm : float
        Residual standard deviation of the model before [mm]; the new one is ``model.residual_std_``.
    median_u_mm : float
        Median standard uncertainty of a coordinate over the session [mm].
    outliers : tuple of Outlier
        Readings whose residual is too large, the largest first.
    remarks : tuple of str

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=60, seed=1).session
    >>> model = ta.fit("ur10", session, model="kinematic").model
    >>> ta.refit(model, session, free=["tip"]).to_dict()["free"]
    ['tip']
    """

    model: IdentifiedModel
    session: Session
    n_used: int
    residual_std_before_mm: float
    median_u_mm: float
    outliers: tuple[Outlier, ...]
    remarks: tuple[str, ...]

    def save(self, path: str | Path) -> None:
        """Write the model to a file (see `load_model`)."""
        self.model.save(path)

    def summary(self) -> str:
        """The answer in one sentence: the uncertainty in the new set-up."""
        of = f"{self.n_used} of {len(self.session)}" if self.n_used < len(self.session) else f"{self.n_used}"
        return (
            f"Standard uncertainty of a coordinate {format_mm(self.median_u_mm)} in the new set-up (median; "
            f"{' and '.join(self.model.free_)} of {self.model.arm.name} from {of} readings)."
            + (f" {process}" if (process := self.model.residual_process_) is not None else "")
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        now, before = self.model.residual_std_, self.residual_std_before_mm
        line = f"residual standard deviation: {format_fixed(now)} mm of a coordinate, unexplained by the model"
        if now > before:
            yield f"{line}; {format_fixed(before)} mm before: the new readings scatter more"
        else:
            yield f"{line}, as before"
        yield from listed("outlier", self.outliers, "readings")
        yield from self.remarks

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "free": self.model.free_,
            "n_used": self.n_used,
            "n_readings": len(self.session),
            "fit_seconds": self.model.fit_seconds_,
            "residual_std_mm": self.model.residual_std_,
            **self._named("residual_std_before_mm", "median_u_mm"),
            "residual_process": self.model.residual_process_,
            "outliers": self.outliers,
            "accepted": self.model.accepted_,
            "remarks": self.remarks,
        }
