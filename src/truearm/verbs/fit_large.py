"""Fit a large session: a sample of its readings shows what to identify, and all of them, as sums, how large it is."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from truearm.acceptance import OVERRIDE, accepting
from truearm.arm import Arm
from truearm.choices import ModelName
from truearm.errors import Contradiction
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.reading_sums import ReadingSums
from truearm.identification.from_sums import Iterate, identified, improved, of_the_model_itself, without_part
from truearm.identification.judgement.gross_errors import LEAST_READINGS, gross_error_limit
from truearm.identification.judgement.held_out_errors import HeldOutErrors
from truearm.identification.judgement.joint_signs import with_unshown_signs, without_unshown_signs
from truearm.identification.references.reading_references import references_of
from truearm.identification.references.references import Points
from truearm.models.identified_model import IdentifiedModel, to_identified
from truearm.models.input_ranges import InputRanges
from truearm.readings import Session
from truearm.readings.large_sessions import LargeSession, Part
from truearm.readings.point_error_sums import PointErrorSums
from truearm.readings.reference_uncertainty import scale_errors
from truearm.solve.effective_number import DesignEffect
from truearm.solve.executors import Executor
from truearm.solve.sums import Sums, joined
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.verbs.fit import FitResult, fit
from truearm.verbs.inputs import ArmLike, Limits, check_has_reference, to_arm
from truearm.verbs.pass_over_parts import PartTask, allowed_in_part, pass_over_parts
from truearm.verbs.record import Record, TextTable
from truearm.verbs.sentences import compare_with_nominal, describe_effective_number, format_mm, number_of

# Stretches of the session that are held out in turn.
FOLDS = 10
# Passes over the session. Two are the rule: the sample is near.
MAX_PASSES = 6
# Gross errors of a part, and of all, that are named.
MAX_NAMED = 6


def first_names(a: tuple[str, ...], b: tuple[str, ...]) -> tuple[str, ...]:
    """The first names of both."""
    return (*a, *b)[:MAX_NAMED]


@dataclass(frozen=True, eq=False)
class FitSums(Sums):
    """Sums over the readings of parts.

    Attributes
    ----------
    n_read : int
        Readings, those without a point or beyond a joint limit among them.
    sums : ReadingSums
    inputs : InputRanges
    held_out, nominal : PointErrorSums
        Errors of the points as predicted without their stretch, and by the nominal arm; without gross errors.
    gross : tuple of str
        Names of the first gross errors.
    of_file, gross_of_file : dict of Path to int
        Readings with a point, and gross errors among them, by their file.
    """

    n_read: int
    sums: ReadingSums
    inputs: InputRanges = field(default_factory=InputRanges)
    held_out: PointErrorSums = field(default_factory=PointErrorSums)
    nominal: PointErrorSums = field(default_factory=PointErrorSums)
    gross: tuple[str, ...] = field(default=(), metadata=joined(first_names))
    of_file: Mapping[Path, int] = field(default_factory=dict)
    gross_of_file: Mapping[Path, int] = field(default_factory=dict)

    def files_in_error(self) -> list[Path]:
        """The files of which more than half of the readings are gross errors; a few readings show nothing."""
        return [file for file, n in self.of_file.items() if 2 * self.gross_of_file[file] > max(n, LEAST_READINGS)]


@dataclass(frozen=True)
class SumTask(PartTask[FitSums]):
    """What is summed over a part.

    Attributes
    ----------
    model : IdentifiedModel
        Of the sample.
    at : Iterate
    without_part : (p,) array or None
        Coefficients by the readings of other stretches, to predict these.
    gross : float
        Whitened length from which a reading is a gross error.
    limits : {"skip", "ignore"}
    accept : str or None
        Why readings that seem contradicted are right.
    n_session : int
        Readings of the session.
    """

    model: IdentifiedModel
    at: Iterate
    without_part: FloatArray | None
    gross: float
    limits: Limits
    accept: str | None
    n_session: int

    def sums(self, readings: Session, part: Part) -> FitSums:
        """See `PartTask.sums`."""
        with accepting(self.accept):
            used = allowed_in_part(readings, self.model.arm, self.limits, self.accept).session
            used = used.rows(used.has_point)
            if not len(used):
                return FitSums(len(readings), ReadingSums.zero(self.model.fit_.perturbed_chain.n_coefficients))
            check_has_reference(used, self.model.arm, purpose="fit to")
            return replace(self._sums_of(used, part.file), n_read=len(readings))

    def _sums_of(self, used: Session, file: Path) -> FitSums:
        chain, state = self.model.fit_.perturbed_chain, self.model.at(used).state

        def complete(x: FloatArray) -> FloatArray:
            return np.pad(x, (0, chain.n_coefficients - len(x)))  # those of missing terms are zero

        points = next(one for one in references_of(used, None) if isinstance(one, Points))
        at, n_session = self.at, self.n_session
        sums, gross = ReadingSums.of(chain, state, points, complete(at.x), at.noise_mm2, self.gross, n_session)
        held_out = nominal = PointErrorSums()
        if self.without_part is not None:
            known = points.points.copy()
            known[gross] = np.nan
            held_out = PointErrorSums.of(chain.tips(state, complete(self.without_part)), known, n_session)
            nominal = PointErrorSums.of(self.model.nominal_.tips(state), known, n_session)
        names = tuple(f"{used.called(row)} of {file.name}" for row in gross[:MAX_NAMED].tolist())
        ranges = InputRanges.of(used)
        return FitSums(len(used), sums, ranges, held_out, nominal, names, {file: len(used)}, {file: len(gross)})


@one_blas_thread()
def fit_large(
    arm: ArmLike | None,
    session: str | Path,
    *,
    model: ModelName = "auto",
    free: Iterable[str] = ("base", "tip"),
    limits: Limits = "skip",
    accept: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, str], None] | None = None,
    **options: Any,
) -> LargeFit:
    """Fit a model to a large session.

    An evenly spaced sample is fitted as a small session: it shows whether the readings are of the arm, which model and
    which terms, what it leaves unexplained and where. The coefficients of a nominal or kinematic model and their
    covariance are then those of all readings, by sums over its parts, with the errors of stretches of the session that
    are held out in turn; models of other kinds stay those of the sample.

    Parameters
    ----------
    arm, model, free, limits, accept, **options
        As of `fit`.
    session : str or Path
        One file, or a folder of files (`LargeSession`).
    executor : Executor, optional
        Who sums over the parts; this process by default. The model does not depend on it.
    progress : callable, optional
        Called with the number of readings done and a note.

    Returns
    -------
    LargeFit

    Raises
    ------
    InputError
        As `fit`; or if more than half of the readings of a file are gross errors, and of other files not.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> Path("line").mkdir()
    >>> for day in (1, 2):
    ...     ta.simulate("ur10", poses=30, seed=day).session.save(f"line/{day}.csv")
    >>> found = ta.fit_large("ur10", "line", model="nominal")
    >>> found.n_readings, found.model.kind
    (60, 'nominal')
    """
    known_arm = None if arm is None else to_arm(arm)
    large = LargeSession.open(session, n_joints=None if known_arm is None else known_arm.n_joints)

    def report(_: int, note: str) -> None:
        if progress is not None:
            progress(0, f"sample: {note}")

    report(0, "reading")
    sample = large.sample(executor=executor)
    options |= {"model": model, "free": free, "limits": limits, "accept": accept, "progress": report}
    found = _fit_sample(large, known_arm, sample, **options)
    if why_not := _why_of_sample(found):
        return LargeFit(found, len(large), why_not)
    identified_model = to_identified(found.model)
    assert identified_model is not None
    return _by_all_readings(found, identified_model, large, limits, accept, executor, progress)


def _why_of_sample(found: FitResult) -> str:
    """Why the model stays that of the sample; nothing where it is identified from all readings."""
    model = to_identified(found.model)
    if model is None or model.kind == "physical":
        return f"a {found.model_name} model is not identified from sums over a session (--model kinematic is)"
    if [part.kind for part in model.fit_.references] != ["point"]:
        return "sums over a session are of reference points alone"
    if model.session_frames_:
        return "the readings are of several sessions"
    return "terms of your own are not summed" if model.terms else ""


def _by_all_readings(
    found: FitResult,
    of_sample: IdentifiedModel,
    large: LargeSession,
    limits: Limits,
    accept: str | None,
    executor: Executor | None,
    progress: Callable[[int, str], None] | None,
) -> LargeFit:
    arm, signs = without_unshown_signs(of_sample.fit_)
    # The first pass is never the last: the missing terms, most of the work, are summed from the second on.
    first, later = (sent_model(of_sample, fit) for fit in (of_the_model_itself(arm), arm))
    gross = gross_error_limit(arm, of_sample.held_out_.and_also(of_sample.held_out_gross_))
    following = Iterate(first.fit_.coefficients, arm.references[0].noise_std ** 2)
    folds = [i * FOLDS // len(large.parts) for i in range(len(large.parts))]
    by_fold: dict[int, FloatArray] = {}
    n_pass = 0
    while n_pass < 2 or (n_pass < MAX_PASSES and not following.is_settled):
        at, n_pass, model = following, n_pass + 1, later if n_pass else first
        tasks = [SumTask(model, at, by_fold.get(fold), gross, limits, accept, len(large)) for fold in folds]
        of_folds: dict[int, FitSums] = {}
        passed = pass_over_parts(large, tasks, executor, progress, label=f"pass {n_pass}: ")
        for fold, one in zip(folds, passed, strict=True):
            of_folds[fold] = of_folds[fold] + one if fold in of_folds else one
        total = reduce(add, of_folds.values())
        if accept is None:
            _check_files(total)
        following = improved(arm, at, total.sums)
        if len(of_folds) > 1:
            by_fold = {fold: without_part(arm, at, total.sums, one.sums) for fold, one in of_folds.items()}
    sample = of_sample.at(found.session)
    errors = scale_errors(found.session, is_frame_free="base" in of_sample.free_)
    same = of_sample.kind == "nominal"
    whole, effect = identified(arm, at, total.sums, sample=sample.state, scale_errors=errors, same_every_day=same)
    whole = replace(with_unshown_signs(whole, signs), converged=following.is_settled, rounds=n_pass)
    new = copy.copy(of_sample)
    new.fit_, new.training_ = whole, total.inputs.conditions(of_sample.training_)
    if same:
        new.nominal_ = whole
    new.held_out_errors_ = _held_out_errors(total, len(by_fold)) or of_sample.held_out_errors_
    return LargeFit(replace(found, model=new), len(large), "", n_pass, total, effect)


def _check_files(total: FitSums) -> None:
    """Refuse a file that contradicts the others: it alone may be in other units, or of another arm."""
    wrong = total.files_in_error()
    if wrong and len(wrong) < len(total.of_file):
        file, others = wrong[0], len(wrong) - 1
        raise Contradiction(
            f"{total.gross_of_file[file]} of {total.of_file[file]} readings are gross errors, and those of "
            f"{number_of(len(total.of_file) - len(wrong), 'other file')} are not"
            f"{f'; so are those of {others} more' * (others > 0)}",
            file=file,
            hint=f"fit {file.name} alone: it says what differs, its units or its arm; {OVERRIDE}",
        )


def _fit_sample(large: LargeSession, arm: Arm | None, sample: Session, **options: Any) -> FitResult:
    """The fit of a sample of the session; of several files, one alone may be what it refuses."""
    try:
        return fit(arm, sample, **options)
    except Contradiction as error:
        if len({part.file for part in large.parts}) == 1:
            raise
        hint = "fit each file alone: one of them may differ from the others, in its units or its arm"
        raise error.with_hint(f"{error.hint}; or {hint}" if error.hint else hint) from None


def sent_model(model: IdentifiedModel, fit: IdentificationResult) -> IdentifiedModel:
    """The model with an arm, without what it keeps of its readings and uncertainty: it is sent with every part."""
    light = copy.copy(model)
    none = type(model).held_out_
    light.held_out_ = light.held_out_gross_ = light.held_out_distances_ = none
    light.fit_, light.nominal_ = (
        replace(one, references=(), covariance=np.zeros((0, 0)), repeatability_covariance=None)
        for one in (fit, model.nominal_)
    )
    return light


def _held_out_errors(total: FitSums, n_folds: int) -> HeldOutErrors | None:
    if not total.held_out.n:
        return None
    errors = total.held_out.errors()
    return HeldOutErrors(
        total.held_out.n,
        n_folds,
        errors["mean_mm"],
        total.held_out.standard_error_mm(),
        errors["p95_mm"],
        errors["max_mm"],
        total.sums.n_gross,
    )


@dataclass(frozen=True, eq=False, repr=False)
class LargeFit(Record):
    """A model fitted to a large session.

    Attributes
    ----------
    result : FitResult
        The fit of the sample; its model is that of all readings.
    n_readings : int
        Of the session.
    of_sample : str
        Why the model is that of the sample; empty where it is identified from all readings.
    n_passes : int
        Passes over the session, beside the one that selects the sample.
    total : FitSums or None
    effect : DesignEffect or None
        By how much correlated readings are worth less.
    """

    result: FitResult
    n_readings: int
    of_sample: str
    n_passes: int = 0
    total: FitSums | None = None
    effect: DesignEffect | None = None

    @property
    def model(self) -> Any:
        """The fitted model."""
        return self.result.model

    @property
    def held_out_mm(self) -> tuple[float, float] | None:
        """Mean error of the stretches that were held out, of the model and of the nominal arm [mm]."""
        if self.total is None or not self.total.held_out.n:
            return self.result.held_out_mm
        return self.total.held_out.errors()["mean_mm"], self.total.nominal.errors()["mean_mm"]

    @property
    def n_effective(self) -> float | None:
        """Independent readings of the same worth for the coefficients; None where the model is that of the sample."""
        if self.total is None or self.effect is None:
            return None
        return self.total.sums.n / self.effect.factor

    def save(self, path: str | Path) -> None:
        """Write the model to a file (see `load_model`)."""
        self.result.save(path)

    def summary(self) -> str:
        """The answer in one sentence: the mean error, and how it compares with the nominal arm."""
        of = f"{self.result.model_name} model of {self.model.arm.name}, {self.n_readings} readings"
        if self.held_out_mm is None:
            return f"Fitted ({of})."
        error, nominal = self.held_out_mm
        compared = "" if self.result.model_name == "nominal" else compare_with_nominal(error, nominal)
        what = "held-out readings of the sample" if self.of_sample else "held-out readings"
        return f"Mean error {format_mm(error)} on {what}{compared} ({of})."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        n_sample = len(self.result.session)
        if self.of_sample or self.total is None or self.effect is None or self.n_effective is None:
            yield (
                f"The model is that of {n_sample} readings, evenly spaced in the session, and not of all: "
                f"{self.of_sample}."
            )
        else:
            used = self.total.sums.n
            yield (
                f"Constants and their uncertainty are those of {used} readings, in {self.n_passes} passes; terms, what "
                f"is unexplained and which readings are gross errors, those of {n_sample} of them, evenly spaced."
            )
            if not self.model.fit_.converged:
                yield f"The constants still changed in pass {self.n_passes}: their uncertainty may be larger."
            said = describe_effective_number(self.n_effective, used, self.effect.is_settled)
            yield f"{said}." if self.effect.factor <= 1 else f"{said}, which the uncertainty of the constants contains."
            yield from self._skipped(self.total)
        yield "Of the sample:"
        yield from self.result.blocks()

    def details(self) -> Iterator[str | TextTable]:
        """See `Record.details`."""
        return self.result.details()

    def _skipped(self, total: FitSums) -> Iterator[str]:
        if n := total.sums.n_gross:
            named = ", ".join(total.gross)
            yield f"{n} readings are gross errors and were excluded: {named}{' and others' * (n > len(total.gross))}."
        if n := total.n_read - total.sums.n - total.sums.n_gross:
            yield f"{n} readings have no reference point, or are beyond a joint limit, and were skipped."

    def _json(self) -> object:
        total, effect = self.total, self.effect
        found: dict[str, Any] = {
            "summary": self.summary(),
            "model": self.result.model_name,
            "n_readings": self.n_readings,
            "n_sample": len(self.result.session),
            "model_of_sample": self.of_sample or None,
            "n_passes": self.n_passes,
            "n_effective": self.n_effective,
            "n_used": None if total is None else total.sums.n,
            "n_gross": None if total is None else total.sums.n_gross,
            "n_block": None if effect is None else effect.n_block,
            "is_effective_number_settled": None if effect is None else effect.is_settled,
            "held_out": None,
        }
        if self.held_out_mm is not None:
            found["held_out"] = dict(zip(("mean_mm", "nominal_mean_mm"), self.held_out_mm, strict=True))
        return {**found, "sample": self.result.to_dict()}
