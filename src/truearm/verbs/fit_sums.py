"""Fit a session in parts: a sample of its readings shows what to identify, sums over all of them how large it is."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from truearm.acceptance import accept_also, accepted, accepting, contradict, overridden
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.reading_sums import ReadingSums
from truearm.identification.from_sums import (
    Iterate,
    identified,
    improved,
    of_the_model_itself,
    shown_motions,
    without_part,
)
from truearm.identification.judgement.expansion_prior import at_mean_temperature
from truearm.identification.judgement.gross_errors import LEAST_READINGS, gross_error_limit
from truearm.identification.judgement.held_out_errors import HeldOutErrors
from truearm.identification.references.prepared_readings import tip_motions
from truearm.identification.references.reading_references import references_of
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState
from truearm.models import Compensator
from truearm.models.identified_model import IdentifiedModel, to_identified
from truearm.models.training_conditions import InputRange, TrainingConditions
from truearm.readings import Lengths, Session, read_lengths
from truearm.readings.large_sessions import LargeSession, Part
from truearm.readings.point_errors import PointErrorSums
from truearm.solve.sums import MAX_KEPT, DesignEffect, Sums, different, first_different, joined
from truearm.typing import FloatArray, IntArray
from truearm.verbs.inputs import LengthsLike, Limits, allowed_in_part, check_has_reference
from truearm.verbs.record import describe_effective_number, number_of

# Stretches of the session that are held out in turn.
FOLDS = 10
# Passes over the session. Two are the rule: the sample is near.
MAX_PASSES = 6
# Readings that differ by less are of one pose: a tenth of the period of the highest harmonics [rad; mm].
POSE_RAD, POSE_MM = 5e-3, 1.0


@dataclass(frozen=True, eq=False)
class Spread(Sums):
    """Number, sum, sum of squares, least and largest of values (n, k)."""

    n: int
    total: FloatArray
    squares: FloatArray
    least: FloatArray = field(metadata=joined(np.minimum))
    largest: FloatArray = field(metadata=joined(np.maximum))

    @classmethod
    def of(cls, values: FloatArray) -> Spread:
        """Those of values (n, k), or (n,)."""
        v = values.reshape(len(values), -1)
        return cls(len(v), v.sum(axis=0), (v**2).sum(axis=0), v.min(axis=0), v.max(axis=0))

    def limits(self) -> FloatArray:
        """(k, 2) the least and the largest."""
        return np.stack([self.least, self.largest], axis=1)

    def range(self) -> InputRange:
        """Of one input (k = 1)."""
        mean = float(self.total[0]) / self.n
        variance = max(float(self.squares[0]) / self.n - mean**2, 0.0)
        return InputRange(mean, variance, float(self.least[0]), float(self.largest[0]))


@dataclass(frozen=True, eq=False)
class FitSums(Sums):
    """Sums over the readings of parts.

    Attributes
    ----------
    n_read : int
        Readings, those without a point or beyond a joint limit among them.
    sums : ReadingSums
    of_pose : (n_poses,) int array
        Readings of each pose of the sample.
    inputs : dict of str to Spread
        Of ``"angles"`` and ``"directions"`` (of all joints), ``"temperature"`` and further columns.
    held_out, nominal : PointErrorSums
        Errors of the points as predicted without their stretch, and by the nominal arm; without gross errors.
    gross : tuple of str
        Names of the first gross errors.
    of_file, gross_of_file : dict of Path to int
        Readings with a point, and gross errors among them, by their file.
    overridden : tuple of str
        Contradictions that were accepted.
    """

    n_read: int
    sums: ReadingSums
    of_pose: IntArray
    inputs: Mapping[str, Spread] = field(default_factory=dict)
    held_out: PointErrorSums = field(default_factory=PointErrorSums)
    nominal: PointErrorSums = field(default_factory=PointErrorSums)
    gross: tuple[str, ...] = field(default=(), metadata=joined(first_different))
    of_file: Mapping[Path, int] = field(default_factory=dict)
    gross_of_file: Mapping[Path, int] = field(default_factory=dict)
    overridden: tuple[str, ...] = field(default=(), metadata=joined(different))


@dataclass(frozen=True, eq=False)
class AllReadings:
    """What a fit is that of all readings of a session in parts, beside that of a sample of them.

    Attributes
    ----------
    n_sample : int
        Readings of the sample that were fitted, before repeats are merged.
    why_of_sample : str
        Why the model is that of the sample; empty where it is identified from all readings.
    n_passes : int
        Passes over the session, beside the one that selects the sample.
    total : FitSums or None
    effect : DesignEffect or None
        By how much correlated readings are worth less.
    n_poses : float
        Number of poses.
    """

    n_sample: int
    why_of_sample: str
    n_passes: int = 0
    total: FitSums | None = None
    effect: DesignEffect | None = None
    n_poses: float = 0.0

    @property
    def held_out_mm(self) -> tuple[float, float] | None:
        """Mean error of the stretches that were held out, of the model and of the nominal arm [mm]."""
        if self.total is None or not self.total.held_out.n:
            return None
        return self.total.held_out.errors()["mean_mm"], self.total.nominal.errors()["mean_mm"]

    @property
    def n_effective(self) -> float | None:
        """Independent readings of the same worth for the coefficients; None where the model is that of the sample."""
        return None if self.total is None or self.effect is None else self.total.sums.n / self.effect.factor

    def sentences(self, model: Compensator, n_sample: int) -> Iterator[str]:
        """What of the model is of all readings, what of the `n_sample` of the sample, and what all are worth."""
        if self.total is None or self.effect is None or self.n_effective is None:
            yield (
                f"The model is that of {n_sample} readings, evenly spaced in the session, and not of all: "
                f"{self.why_of_sample}."
            )
            return
        used, gross = self.total.sums.n, self.total.sums.n_gross
        yield (
            f"Constants and their uncertainty are those of {used} readings, in {self.n_passes} passes; terms, growth "
            f"of links, what is unexplained and which readings are gross errors, those of {n_sample}, evenly spaced."
        )
        if not (identified_model := to_identified(model)) or not identified_model.fit_.converged:
            yield f"The constants still changed in pass {self.n_passes}: their uncertainty may be larger."
        said = describe_effective_number(self.n_effective, used, self.effect.is_settled)
        is_less = self.n_effective <= 0.99 * used
        if is_less and self.effect.is_by_poses:
            poses = f"about {self.n_poses:.0f} poses with their errors"
            said = f"{used} readings come back to {poses}, and are worth {self.n_effective:.0f} independent ones"
        yield f"{said}, which the uncertainty of the constants contains." if is_less else f"{said}."
        if gross:
            named, others = ", ".join(self.total.gross), " and others" * (gross > len(self.total.gross))
            yield f"{gross} readings are gross errors and were excluded: {named}{others}."
        if n := self.total.n_read - used - gross:
            yield f"{n} readings have no reference point, or are beyond a joint limit, and were skipped."

    def to_json(self) -> dict[str, Any]:
        """The figures by their names in JSON."""
        total, effect = self.total, self.effect
        return {
            "model_of_sample": self.why_of_sample or None,
            "n_passes": self.n_passes,
            "n_effective": self.n_effective,
            "n_used": None if total is None else total.sums.n,
            "n_gross": None if total is None else total.sums.n_gross,
            "n_block": None if effect is None else effect.n_block,
            "is_effective_number_settled": None if effect is None else effect.is_settled,
        }


def check_lengths_in_sample(lengths: LengthsLike, sample: Session, large: LargeSession) -> None:
    """Refuse known lengths between seats of which the sample of a session has no reading.

    Raises
    ------
    InputError
        If there are such, and the sample is not the whole session.
    """
    n = len(sample) + len(sample.unfilled)
    if n == len(large):
        return
    stated = lengths if isinstance(lengths, Lengths) else read_lengths(lengths)
    known = stated.within([] if sample.seat is None else [*sample.seat.tolist(), *sample.unfilled])
    if missing := len(stated) - (0 if known is None else len(known)):
        raise InputError(
            f"{missing} of {len(stated)} lengths are between seats that are not in the sample of {n} of {len(large)} "
            "readings, to which lengths are fitted",
            file=stated.file,
            hint="omit them, or fit a file of the readings in seats alone as a small session",
        )


def sums_of_readings(
    given: Session,
    part: Part,
    *,
    model: IdentifiedModel,
    at: Iterate,
    without_part: FloatArray | None,
    gross_limit: float,
    angle_std: FloatArray | None,
    limits: Limits,
    accept: str | None,
    n_session: int,
    poses: IntArray,
) -> FitSums:
    """Sums over some readings of a part.

    Predicted are those of a stretch by the coefficients `without_part`; from a whitened length of `gross_limit` on a
    reading is a gross error. Rounded angles have uncertainties `angle_std` (n_joints,). Readings of `poses` (n_poses,)
    are counted (`keys_of_poses`).
    """
    chain = model.fit_.perturbed_chain
    with accepting(accept):
        used = allowed_in_part(given, model.arm, limits, accept).session
        used = used.rows(used.has_point)
        if not len(used):
            none = ReadingSums.zero(chain.n_coefficients), np.zeros(len(poses), np.intp)
            return FitSums(len(given), *none, overridden=overridden())
        check_has_reference(used, model.arm, purpose="fit to")
        state, accepted_here = _mean_state(model, used), overridden()

    def complete(x: FloatArray) -> FloatArray:
        return np.pad(x, (0, chain.n_coefficients - len(x)))  # those of missing terms are zero

    points = _points_of(used)
    if angle_std is not None:
        by_rounding = (tip_motions(chain.chain, state.angles, angle_std) ** 2).sum(axis=0)
        points = replace(points, point_std=np.sqrt(points.std.T**2 + by_rounding))
    sums, gross = ReadingSums.of(chain, state, points, complete(at.x), at.noise_mm2, gross_limit, n_session)
    held_out = nominal = PointErrorSums()
    if without_part is not None:
        known = points.points.copy()
        known[gross] = np.nan
        held_out = PointErrorSums.of(chain.tips(state, complete(without_part)), known, n_session)
        nominal = PointErrorSums.of(model.nominal_.tips(state), known, n_session)
    names = tuple(f"{used.called(row)} of {part.file.name}" for row in gross[:MAX_KEPT].tolist())
    of_file = {part.file: len(used)}, {part.file: len(gross)}
    inputs = {"angles": used.angles, "directions": used.directions, "temperature": used.temperature_degC}
    spreads = {name: Spread.of(of) for name, of in (inputs | dict(used.columns)).items() if of is not None}
    keys = keys_of_poses(model, used)
    keys = keys[np.isin(keys, poses)]
    of_pose = np.bincount(np.searchsorted(poses, keys), minlength=len(poses))
    return FitSums(len(given), sums, of_pose, spreads, held_out, nominal, names, *of_file, accepted_here)


def keys_of_poses(model: IdentifiedModel, readings: Session) -> IntArray:
    """(n,) numbers that are equal for readings of one pose, by cells of `POSE_RAD` and `POSE_MM`."""
    cells = np.rint(readings.angles / np.where(model.arm_.chain.is_prismatic, POSE_MM, POSE_RAD)).astype(np.int64)
    return cells @ np.random.default_rng(0).integers(2**62, size=cells.shape[1])


def fit_all(
    model: Compensator, sample: Session, n_sample: int, large: LargeSession, limits: Limits, accept: str | None
) -> tuple[Compensator, AllReadings]:
    """The model of a sample by all readings of its session, where sums say it, and what is known of it then.

    The coefficients of a nominal, kinematic or physical model and their covariance are those of all readings, by sums
    over the parts, with the errors of stretches of the session that are held out in turn; models with networks or with
    a residual process stay those of the sample.

    Raises
    ------
    InputError
        If more than half of the readings of a file are gross errors, and of other files not.
    """
    of_sample, why_not = to_identified(model), _why_of_sample(model, sample)
    if of_sample is None or why_not:
        return model, AllReadings(n_sample, why_not)
    arm = of_sample.by_readings
    # The first pass is never the last: the missing terms, most of the work, are summed from the second on.
    first, later = (sent_model(of_sample, fit) for fit in (of_the_model_itself(arm), arm))
    gross = gross_error_limit(arm, of_sample.held_out_.and_also(of_sample.held_out_gross_))
    following = Iterate(first.fit_.coefficients, arm.references[0].noise_std ** 2)
    # By number of readings: a file may be much larger than others.
    starts = np.cumsum([0, *(part.n_readings for part in large.parts)])
    folds: list[int] = ((starts[:-1] + starts[1:]) * FOLDS // (2 * len(large))).tolist()
    by_fold: dict[int, FloatArray] = {}
    n_pass = 0
    work = partial(sums_of_readings, gross_limit=gross, limits=limits, accept=accept, n_session=len(large))
    used = sample.rows(sample.has_point)
    poses, of_row = np.unique(keys_of_poses(of_sample, used), return_inverse=True)
    work = partial(work, angle_std=_counted_rounding(of_sample, arm, sample), poses=poses)
    while n_pass < 2 or (n_pass < MAX_PASSES and not following.is_settled):
        at, n_pass, sent = following, n_pass + 1, later if n_pass else first
        works = [partial(work, model=sent, at=at, without_part=by_fold.get(fold)) for fold in folds]
        of_folds: dict[int, FitSums] = {}
        for fold, one in zip(folds, large.sums(works, f"pass {n_pass}: "), strict=True):
            of_folds[fold] = of_folds[fold] + one if fold in of_folds else one
        total = reduce(add, of_folds.values())
        if not total.sums.n:
            raise InputError(
                f"all {total.n_read} readings are gross errors of the model of {n_sample} of them",
                file=large.path,
                hint="fit a part of the readings alone",
            )
        if accept is None:
            _check_files(total)
        shown = shown_motions(arm, at, total.sums)
        following = improved(arm, at, total.sums, shown)
        # One of more than half of the readings is predicted by too few: held-out errors are those of the sample then.
        if max(one.sums.n for one in of_folds.values()) <= total.sums.n / 2:
            by_fold = {fold: without_part(arm, at, total.sums, one.sums, shown) for fold, one in of_folds.items()}
    if accept is not None:
        _check_files(total)
    accept_also(total.overridden)
    # Errors that repeat at a pose are not averaged by its readings. Of m of them the gradient has the covariance of
    # m + s m (m - 1) independent ones (L. Kish, "Survey Sampling", 1965, section 5.4), in the directions of that pose.
    of_instrument = float((_points_of(used).std ** 2).mean())
    share = of_sample.judged().repeating_share_ * at.noise_mm2 / (at.noise_mm2 + of_instrument)
    m = np.maximum(total.of_pose[of_row], 1)
    merged = np.ones(len(m)) if used.n_repeats is None else used.n_repeats
    again, octave = merged * (m - 1) * share * total.sums.n / merged.sum(), np.rint(np.log2(m))
    repeated, n_poses = np.zeros_like(total.sums.gram), total.sums.n * float((merged / m).sum() / merged.sum())
    for one in np.unique(octave[m > 1]):
        rows = np.flatnonzero((octave == one) & (m > 1))
        some = work(used.rows(rows), large.parts[0], model=later, at=at, without_part=None)
        repeated += again[rows].mean() * some.sums.gram
    whole, effect = identified(of_sample.fit_, arm, at, total.sums, following.x, repeated)
    whole = replace(whole, converged=following.is_settled, rounds=n_pass)
    new = copy.copy(of_sample)
    new.accepted_ = accepted(of_sample.accepted_)
    if doubt := of_sample.arm_doubt_:
        new.arm_doubt_ = f"By a sample of {n_sample} of {total.n_read} readings: {doubt}"
    new.fit_, new.training_ = whole, conditions_of_all(total.inputs, of_sample.training_)
    if new.kind == "nominal":
        new.nominal_ = whole
    new.held_out_errors_ = _held_out_errors(total, len(by_fold)) or of_sample.held_out_errors_
    return new, AllReadings(n_sample, "", n_pass, total, effect, n_poses)


def _points_of(readings: Session) -> Points:
    return next(one for one in references_of(readings, None) if isinstance(one, Points))


def _counted_rounding(model: IdentifiedModel, arm: IdentificationResult, sample: Session) -> FloatArray | None:
    """(n_joints,) uncertainties of rounded angles, where the sample shows that they are rounded."""
    stated = _points_of(sample.rows(sample.has_point)).std ** 2
    return model.training_.angle_std if (arm.references[0].std ** 2).sum() > (1 + 1e-9) * stated.sum() else None


def _mean_state(model: IdentifiedModel, readings: Session) -> ArmState:
    """State at readings, at temperatures about their mean in training."""
    trained = model.training_.temperature_degC
    return at_mean_temperature(model.at(readings).state, None if trained is None else trained.mean)


def conditions_of_all(inputs: Mapping[str, Spread], of_sample: TrainingConditions) -> TrainingConditions:
    """The conditions of all readings, where those of an evenly spaced sample are known.

    Gaps between the angles, temperatures of slow links, rounding and the fingerprint stay those of the sample.
    """
    directions = inputs.get("directions")
    return replace(
        of_sample,
        n_readings=inputs["angles"].n,
        angle_ranges=inputs["angles"].limits(),
        temperature_degC=None if of_sample.temperature_degC is None else inputs["temperature"].range(),
        columns={name: inputs[name].range() for name in of_sample.columns},
        direction_ranges=None if directions is None else directions.limits(),
    )


def _why_of_sample(model: Compensator, sample: Session) -> str:
    """Why a model stays that of the sample; nothing where it is identified from all readings."""
    if (identified_model := to_identified(model)) is None:
        return f"a {model.kind} model is not identified from sums over a session (--model physical is)"
    if [part.kind for part in identified_model.fit_.references] != ["point"]:
        return "sums over a session are of reference points alone"
    if model.session_frames_:
        return "the readings are of several sessions"
    if sample.u_common_mm is not None:
        return "the error that points of one position share (u_common_mm) is not summed"
    if identified_model.residual_process_ is not None:
        return "its residual process is not summed"
    if not identified_model.get_params().get("robust", True):
        return "sums over a session have robust weights"
    if not len(identified_model.fit_.coefficients):
        return "nothing of it is identified"
    return "terms of your own are not summed" if identified_model.terms else ""


def _check_files(total: FitSums) -> None:
    """Refuse a file that contradicts the others: it alone may be in other units, or of another arm.

    More than half of its readings are gross errors; a few readings show nothing.
    """
    wrong = [file for file, n in total.of_file.items() if 2 * total.gross_of_file[file] > max(n, LEAST_READINGS)]
    if wrong and len(wrong) < len(total.of_file):
        file, others = wrong[0], len(wrong) - 1
        wrong_file = InputError(
            f"{total.gross_of_file[file]} of {total.of_file[file]} readings are gross errors, and those of "
            f"{number_of(len(total.of_file) - len(wrong), 'other file')} are not"
            f"{f'; so are those of {others} more' * (others > 0)}",
            file=file,
            hint=f"fit {file.name} alone: it says what differs, its units or its arm",
        )
        contradict(wrong_file)


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
    if not (held_out := total.held_out).n:
        return None
    errors = held_out.errors()
    sizes = errors["mean_mm"], held_out.standard_error_mm(), errors["p95_mm"], errors["max_mm"]
    return HeldOutErrors(held_out.n, n_folds, *sizes, total.sums.n_gross)
