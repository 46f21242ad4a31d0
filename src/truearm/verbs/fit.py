"""Fit: identify an arm from the readings of a session."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truearm.acceptance import acceptance_remarks, accepts
from truearm.arm import Arm
from truearm.arm.arm import joint_zeros, with_zeros
from truearm.choices import ModelName
from truearm.errors import Contradiction, InputError
from truearm.findings import Finding, findings_of, format_mm, in_order
from truearm.identification.estimation.diagnostics import identifiability
from truearm.identification.judgement.frame_changes import SessionChange
from truearm.identification.judgement.outliers import Outlier
from truearm.identification.references.distances import is_offset
from truearm.identification.terms.type_prior import TypePrior, read_type_prior
from truearm.models import MODELS, Compensator, NominalModel
from truearm.models.arm_check import WAYS_TO_AN_ARM, arm_of_readings, with_serial_number
from truearm.models.identified_model import IdentifiedModel, to_identified
from truearm.models.selection import ModelScore, fit_chosen, on_common_readings, select_model
from truearm.readings import Session
from truearm.readings.files import is_large
from truearm.readings.repeats import readings_of_one_pose
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.verbs.inputs import (
    ArmLike,
    LengthsLike,
    Limits,
    SessionLike,
    readings_to_fit,
    repeated_readings,
    to_arm,
    to_free_parts,
    to_session,
)
from truearm.verbs.record import Record, TextTable, compare_with_nominal, format_fixed, listed, with_lengths

if TYPE_CHECKING:
    from truearm.solve.executors import Executor
    from truearm.verbs.fit_sums import AllReadings

# Models that identify no constants, and take no type prior.
WITHOUT_CONSTANTS = frozenset({"nominal", "network"})
# Groups of terms that are printed, those with most determined coefficients.
MAX_GROUPS = 8
# Readings in memory that are fitted at once: of more, a sample and sums give the same arm in less time.
MOST_AT_ONCE = 100_000
# What a reading may have instead of a point alone, or beside it.
BESIDE_POINTS = (
    *("seat", "quaternion", "sphere", "plane", "line", "anchor"),
    *("tip", "session", "u_common_mm", "pose_errors"),
)


@one_blas_thread()
@accepts
def fit(
    arm: ArmLike | None,
    session: SessionLike,
    *,
    model: ModelName = "auto",
    lengths: LengthsLike | None = None,
    free: Iterable[str] = ("base", "tip"),
    limits: Limits = "skip",
    prior: TypePrior | str | Path | None = None,
    accept: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, str], None] | None = None,
    **options: Any,
) -> FitResult:
    """Identify an arm: fit a model to the readings of a session.

    Of a session in parts (docs/large-sessions.md) an evenly spaced sample is fitted: it shows whether the readings are
    of the arm, which model and which terms, what it leaves unexplained and where. The coefficients of a nominal,
    kinematic or physical model and their covariance are then those of all readings, by sums over the parts.

    Parameters
    ----------
    arm : Arm, str, Path or None
        The nominal arm: an `Arm`, a name of `list_arms`, or an arm file or URDF. None for a network, which needs none:
        the number and kind of the joints, and all ranges, are those of the readings.
    session : Session, DataFrame, str or Path
        Readings with reference points, seats, distances to anchors or surfaces. A folder of files, or a file beyond
        512 MiB, is read part by part; more than 100,000 readings in memory with points alone are in parts too (with
        temperatures, of nominal and kinematic models).
    model : {"auto", "nominal", "kinematic", "physical", "network", "hybrid"}
        ``"auto"`` fits the first three, and the hybrid model where it may win, and selects the simplest whose mean
        error on held-out readings is within one standard error of the smallest; of fewer than ten positions or
        seats the best. See `NominalModel`, `KinematicModel`,
        `PhysicalModel`, `NetworkModel` and `HybridModel`.
    lengths : Lengths, str or Path, optional
        Known lengths between seats of the session.
    free : iterable of {"base", "tip"}
        What is unknown of the placement of the nominal arm; empty if points are in its base frame and its tip is known.
    limits : {"skip", "ignore"}
        Skip the readings beyond a joint limit, or use them.
    prior : TypePrior, str or Path, optional
        What arms of this type have in common, or its file (docs/type-prior.md): the constants of the arm are then
        expected about the mean of its type, within the scatter of its type, and not about the nominal arm. An arm that
        the prior was learned from gets that of the others.
    accept : str, optional
        Why the readings are right where they would be refused as contradicted: the reason and what it overrode are
        kept (docs/imperfect-readings.md).
    executor : Executor, optional
        Who sums over the parts; this process by default. The model does not depend on it.
    progress : callable, optional
        Called with the number of steps done, of files in parts that of their readings, and a note.
    **options
        Of the model's class (`KinematicModel`, `PhysicalModel`, `HybridModel`, `NetworkModel`), such as
        ``hidden=(50, 50)`` for a network or ``terms``, terms of your own for the physical model; with ``"auto"`` only
        ``residual`` and ``terms``.

    Returns
    -------
    FitResult

    Raises
    ------
    InputError
        If the readings are too few, of another arm, in another unit, or do not determine the model; if the prior is of
        another nominal arm; if most readings of one file of several are gross errors.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> result = ta.fit("ur10", session, model="kinematic")
    >>> result.model.predict(session.angles).shape
    (40, 3)
    """
    _check_choice(model, options, has_arm=arm is not None)
    parts, known_arm = to_free_parts(free), None if arm is None else to_arm(arm)
    n_joints = None if known_arm is None else known_arm.n_joints
    work = partial(_fit, known_arm, model=model, free=parts, limits=limits, lengths=lengths, prior=prior, accept=accept)
    given = session if is_large(session) else to_session(session, n_joints=n_joints)
    if isinstance(given, Session) and not _is_summed(given, model, lengths, options):
        return work(given, progress=progress, **options)
    from truearm.readings.large_sessions import LargeSession  # no small session waits for these
    from truearm.verbs.fit_sums import check_lengths_in_sample, fit_all

    of_sample = progress and (lambda _, note: progress(0, f"sample: {note}"))
    if isinstance(given, Session):
        large = LargeSession.of(given, executor=executor, progress=progress and (lambda _, note: progress(0, note)))
    else:
        large = LargeSession.open(given, n_joints=n_joints, executor=executor, progress=progress)
    sample = large.sample()
    if lengths is not None:
        check_lengths_in_sample(lengths, sample, large)
    try:
        found = work(sample, progress=of_sample, **options)
    except Contradiction as error:
        if len({part.file for part in large.parts}) == 1:
            raise
        hint = "fit each file alone: one of them may differ from the others, in its units or its arm"
        raise error.with_hint(f"{error.hint}; or {hint}" if error.hint else hint) from None
    new, every = fit_all(found.model, found.session, found.n_readings, large, limits, accept)
    if isinstance(given, Session):
        if every.why_of_sample:
            return work(given, progress=progress, **options)
        rows = np.searchsorted(np.asarray(given.numbers), np.asarray(sample.numbers))
        outliers = (one if one.row is None else replace(one, row=int(rows[one.row])) for one in found.outliers)
        found = replace(found, outliers=tuple(outliers))
    others = (one for one in found.findings if one.what != "acceptance")
    findings = in_order((*findings_of("acceptance", acceptance_remarks(accept)), *others))
    return replace(found, model=new, n_readings=len(large), all_readings=every, findings=findings)


def _fit(
    known_arm: Arm | None,
    given: Session,
    *,
    model: ModelName,
    free: tuple[str, ...],
    limits: Limits,
    lengths: LengthsLike | None,
    prior: TypePrior | str | Path | None,
    accept: str | None,
    progress: Callable[[int, str], None] | None,
    **options: Any,
) -> FitResult:
    """Fit a model to a session in memory."""
    nominal_arm = with_serial_number(known_arm or arm_of_readings(given), given)
    # Options are checked before anything is computed.
    chosen = None if model == "auto" else MODELS[model](nominal_arm, free=free, **options)
    of_type = None if prior is None else _checked_prior(prior, known_arm, model, nominal_arm.serial_number)
    used = readings_to_fit(given, nominal_arm, model, limits=limits, lengths=lengths, is_base_free="base" in free)
    nominal = None if known_arm is None else NominalModel(nominal_arm, free=free)
    first = chosen or nominal
    assert first is not None  # a network without an arm is chosen
    readings = first.prepare(used.session, used.lengths)
    if nominal is not None:
        nominal.learn(readings)
    readings = replace(readings, prior=of_type)
    if chosen is None and nominal is not None:
        learned = select_model(nominal, readings, progress=progress, **options)
    else:
        learned = fit_chosen(first, nominal, readings, progress=progress)
    expected = [] if of_type is None else [f"Constants are expected as the type has them: {of_type}."]
    found = (
        *findings_of("acceptance", acceptance_remarks(accept)),
        *findings_of("arm", nominal_arm.remarks),
        *findings_of("type prior", expected),
        *used.findings,
        *repeated_readings(used, learned.model),
        *learned.findings,
    )
    return FitResult(
        model=learned.model,
        comparison=learned.table,
        session=used.session,
        n_readings=used.n_allowed,
        training=learned.training,
        nominal=nominal,
        outliers=tuple(one.located(given, used.rows) for one in learned.outliers),
        length_outliers=learned.length_outliers,
        frame_changes=learned.changes,
        findings=in_order(found),
    )


def _is_summed(session: Session, model: ModelName, lengths: LengthsLike | None, options: Mapping[str, Any]) -> bool:
    """Whether a session in memory is as long as one in parts, and all that is fitted are sums over its points."""
    if len(session) <= MOST_AT_ONCE or model in ("network", "hybrid") or "terms" in options or lengths is not None:
        return False
    numbers = np.asarray(session.numbers)
    is_in_order, is_robust = bool((np.diff(numbers) > 0).all()), options.get("robust", True)
    return is_in_order and is_robust and all(getattr(session, name) is None for name in BESIDE_POINTS)


def _check_choice(model: ModelName, options: Mapping[str, Any], *, has_arm: bool) -> None:
    """Refuse a model that there is not, options that it does not take, and one without the arm that it needs."""
    if model not in ("auto", *MODELS):
        raise InputError(f"expected a model among auto, {', '.join(MODELS)}, got {model!r}")
    if model == "auto" and (foreign := sorted(options.keys() - {"residual", "terms"})):
        raise InputError(f"options {foreign} belong to one model, got model 'auto'", hint="name the model")
    if not has_arm and model != "network":
        raise InputError(f"model {model!r} needs the nominal arm", hint=f"--arm ARM: {WAYS_TO_AN_ARM}")
    if "terms" in options and model not in ("auto", "kinematic", "physical"):
        raise InputError(f"expected a model that identifies terms, got {model!r}", hint="model='physical'")
    if not isinstance(options.get("terms", ()), Sequence):
        raise InputError(f"expected a sequence of terms, got {options['terms']!r:.60}", hint="terms=[term]")


def _checked_prior(prior: TypePrior | str | Path, arm: Arm | None, model: ModelName, serial_number: str) -> TypePrior:
    """A type prior that a model can use, of this nominal arm, without what the arm's own readings say."""
    if arm is None or model in WITHOUT_CONSTANTS:
        raise InputError(f"a {model} model identifies no constants, and takes no type prior", hint="--model kinematic")
    found = prior if isinstance(prior, TypePrior) else read_type_prior(prior)
    with InputError.of_file(None if isinstance(prior, TypePrior) else prior):
        found.check_arm(arm)
        return found.without(serial_number)


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Record):
    """A fitted model, how well it predicts readings, and what a person must know about it.

    Attributes
    ----------
    model : Compensator
        The fitted model; of ``"auto"`` the selected one.
    comparison : tuple of ModelScore
        Of ``"auto"``: each candidate's error on held-out readings; else empty.
    session : Session
        The training readings that were used, those that repeat each other merged into their mean; of a session in
        parts the sample. What follows is of these.
    n_readings : int
        Their number before that; of a session in parts that of all.
    training : dict or None
        Errors on them, without those excluded as gross errors: of points, or of the scatter in seats, or of distances
        to anchors; None without any of these.
    nominal : NominalModel or None
        The nominal arm with base and tip fitted to the same readings; None without an arm.
    outliers : tuple of Outlier
        Training readings whose residual is too large, the largest first.
    length_outliers : tuple of Outlier
        Known lengths that contradict the other data.
    frame_changes : tuple of SessionChange
        What changed during a session: the base or the reference, the tip, the zero of a joint.
    findings : tuple of Finding
        What a person must know of it: what was skipped or ignored, and warnings.
    all_readings : AllReadings or None
        Of a session in parts: what is by all readings.

    Examples
    --------
    >>> import truearm as ta
    >>> result = ta.fit("ur10", ta.simulate("ur10", poses=40, seed=1).session, model="nominal")
    >>> sorted(result.to_dict())[:4]
    ['accepted', 'arm', 'comparison', 'fit_seconds']
    """

    model: Compensator
    comparison: tuple[ModelScore, ...]
    session: Session
    n_readings: int
    training: Mapping[str, Any] | None
    nominal: NominalModel | None
    outliers: tuple[Outlier, ...]
    length_outliers: tuple[Outlier, ...]
    frame_changes: tuple[SessionChange, ...]
    findings: tuple[Finding, ...]
    all_readings: AllReadings | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """The findings in words."""
        return tuple(map(str, self.findings))

    @property
    def of_sample(self) -> FitResult | None:
        """Of a session in parts: the same of the sample alone, with the model of all readings."""
        every = self.all_readings
        return None if every is None else replace(self, n_readings=every.n_sample, all_readings=None)

    @property
    def model_name(self) -> str:
        """``"nominal"``, ``"kinematic"``, ``"physical"``, ``"network"`` or ``"hybrid"``."""
        return self.model.kind

    @property
    def identifies_constants(self) -> bool:
        """Whether the constants of the arm were identified, its joint zeros among them."""
        return self.model.identifies_constants

    @property
    def held_out_mm(self) -> tuple[float, float] | None:
        """Mean error on held-out readings, of the model and of the nominal arm [mm]; None where none were held out.

        Without those that are gross errors of the model.
        """
        if self.all_readings is not None and (found := self.all_readings.held_out_mm) is not None:
            return found
        if self.nominal is None or not len(self.model.held_out_.rows) or not len(self.nominal.held_out_.rows):
            return None
        nominal = on_common_readings({"model": self.model, "nominal": self.nominal})["nominal"]
        taken = np.isin(nominal.rows, self.model.held_out_.rows)
        return self.model.held_out_.mean_mm, nominal.select(taken).mean_mm

    @property
    def held_out_distances(self) -> dict[str, float] | None:
        """Errors of held-out distances to anchors beside points or seats [mm]; None where there are none."""
        if not len(self.model.held_out_distances_.rows):
            return None
        errors = self.model.held_out_distances_.errors_mm
        mean, p95, largest = float(errors.mean()), float(np.quantile(errors, 0.95)), float(errors.max())
        return {"mean_mm": mean, "p95_mm": p95, "max_mm": largest, "n": len(errors)}

    def arm_with_zeros(self) -> Arm:
        """The nominal arm with the joint zeros that were identified; all else is nominal.

        The zero of the first joint and of the last stay, as far as no reading tells them from the place of a free base
        and tip. `truearm.arm.write_arm` writes it.

        Raises
        ------
        InputError
            If the model identifies no zeros.
        """
        fit = self.model.identified_arm
        if fit is None or not self.identifies_constants:
            of = "that was kept " * (fit is not None and bool(self.comparison))
            raise InputError(f"a {self.model_name} model {of}identifies no joint zeros", hint="model='kinematic'")
        zeros = joint_zeros(fit.chain, self.model.arm_, free=self.model.free)
        summed = None if self.all_readings is None else self.all_readings.total
        n = len(self.session) if summed is None else summed.sums.n
        source = f"{self.model.arm_.source}; joint zeros identified from {n} readings".strip("; ")
        source = "; ".join([source, *map(str, self.model.accepted_)])
        return replace(with_zeros(self.model.arm_, zeros), source=source)

    def save(self, path: str | Path) -> None:
        """Write the model to a file (see `load_model`)."""
        self.model.save(path)

    def summary(self) -> str:
        """The answer in one sentence: the mean error, and how it compares with the nominal arm."""
        read, every = f"{self.n_readings} readings", self.all_readings
        if every is None and self.n_readings > len(self.session):
            read += f", repeats merged into {len(self.session)}"
        about = f" ({self.model_name} model of {self.model.arm.name}, {read})."
        identified = to_identified(self.model)
        if identified is not None and identified.residual_process_ is not None:
            about += f" {identified.residual_process_}"
        if self.held_out_mm is not None:
            error, nominal = self.held_out_mm
            compared = "" if self.model_name == "nominal" else compare_with_nominal(error, nominal)
            in_seats = self.session.seat is not None and not self.session.has_point.any()
            of = "error of a distance" if self.model.held_out_.n_coordinates < 3 else "error"
            of = "distance from the mean of the seat" if in_seats else of
            lengths = None if self.training is None else self.training.get("lengths")
            what = "held-out readings" + " of the sample" * (every is not None and bool(every.why_of_sample))
            return with_lengths(f"Mean {of} {format_mm(error)} on {what}", compared, lengths) + about
        if self.training is not None and "mean_mm" in self.training:
            mean = self.training["mean_mm"]
            compared = "" if self.nominal is None else compare_with_nominal(mean, self.nominal.nominal_error())
            return f"Mean error {format_mm(mean)} on the training readings{compared}{about}"
        return f"Residual standard deviation {format_mm(self.model.facts()['residual_std_mm'])} of a coordinate{about}"

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        if self.all_readings is not None and self.of_sample is not None:
            yield from self.all_readings.sentences(self.model, len(self.session))
            yield "Of the sample:"
            yield from self.of_sample.blocks()
            return
        yield "Next: test the model on readings that it was not fitted to (truearm evaluate)."
        yield from self.remarks
        yield from listed("outlier", self.outliers, "readings")
        yield from listed("contradictory length", [_describe_length(one) for one in self.length_outliers], "lengths")
        if self.comparison:
            yield _comparison_table(self.comparison)
            if n_excluded := self.comparison[0].n_excluded:
                yield f"mean, 95 % and max without {n_excluded} readings that are gross errors of the selected model"
        compare = self.nominal is not None and self.model_name != "nominal"
        yield from _training_lines(self.training, compare=compare)
        if self.held_out_distances is not None:
            mean, largest = self.held_out_distances["mean_mm"], self.held_out_distances["max_mm"]
            yield f"error of a distance to an anchor, held out: mean {mean:.4f} mm, maximum {largest:.4f} mm"
        yield from _fact_lines(self.model.facts())
        if (identified := to_identified(self.model)) is not None:
            yield from (_describe_own(**one) for one in own_coefficients(identified))

    def details(self) -> Iterator[str | TextTable]:
        """See `Record.details`: groups of terms, what is not identifiable, and terms that were not offered."""
        if (identified := to_identified(self.model)) is not None:
            yield from _term_lines(identified)

    def _json(self) -> object:
        names = ("mean_mm", "nominal_mean_mm")
        held_out = None if self.held_out_mm is None else dict(zip(names, self.held_out_mm, strict=True))
        if self.all_readings is not None and self.of_sample is not None:
            said = {"summary": self.summary(), "model": self.model_name, "n_readings": self.n_readings}
            of_all = {"n_sample": len(self.session), **self.all_readings.to_json(), "held_out": held_out}
            return said | of_all | {"sample": self.of_sample.to_dict()}
        found: dict[str, Any] = {
            "summary": self.summary(),
            "model": self.model_name,
            "arm": self.model.arm.name,
            "n_readings": self.n_readings,
            "n_poses": len(np.unique(readings_of_one_pose(self.session))),
            "fit_seconds": self.model.fit_seconds_,
            "held_out": held_out,
            "accepted": self.model.accepted_,
            **self._named("held_out_distances", "training", "comparison", "outliers", "length_outliers"),
            **self._named("frame_changes", "remarks"),
        }
        found |= self.model.facts()
        if (identified := to_identified(self.model)) is not None:
            found["residual_process"] = identified.residual_process_
            found["groups"] = identified.fit_.groups
            found["skipped_terms"] = identified.excluded_terms_
            found["length_scale"] = identified.length_scale_
            if identified.terms:
                found["own_terms"] = own_coefficients(identified)
            found["identifiability"] = identifiability(identified.fit_)
        return found

    def _errors_mm(self) -> Mapping[str, FloatArray]:
        if self.held_out_mm is None or self.nominal is None or self.model_name == "nominal":
            return {}
        return {"nominal": self.nominal.held_out_.errors_mm, self.model_name: self.model.held_out_.errors_mm}


def _comparison_table(comparison: tuple[ModelScore, ...]) -> TextTable:
    return TextTable(
        ("held-out error [mm]", "mean", "95 %", "max", "above the best", "standard error", "parameters", ""),
        (
            (
                score.name,
                format_fixed(score.mean_mm),
                format_fixed(score.p95_mm),
                format_fixed(score.max_mm),
                format_fixed(score.excess_mm),
                format_fixed(score.excess_standard_error_mm),
                f"{score.n_effective:.0f}",
                "selected" if score.kept else "",
            )
            for score in comparison
        ),
        left_aligned=(0, 7),
    )


def _training_lines(errors: Mapping[str, Any] | None, *, compare: bool) -> Iterator[str]:
    if errors is None:
        return
    if "seat_mean_mm" in errors:
        mean, largest = errors["seat_mean_mm"], errors["seat_max_mm"]
        yield f"training error, distance from the mean of the seat: mean {mean:.4f} mm, maximum {largest:.4f} mm"
        return
    if "distance_mean_mm" in errors:
        mean, largest = errors["distance_mean_mm"], errors["distance_max_mm"]
        yield f"training error of a distance to an anchor: mean {mean:.4f} mm, maximum {largest:.4f} mm"
        return
    line = f"training error: mean {errors['mean_mm']:.4f} mm, maximum {errors['max_mm']:.4f} mm"
    if compare and (removed := errors["removed_percent"]) < 0:
        line += f" ({1 - removed / 100:.1f} times the nominal error)"
    elif compare:
        line += f" ({removed:.1f} % of the nominal mean absolute coordinate error removed)"
    yield line


def _fact_lines(facts: Mapping[str, Any]) -> Iterator[str]:
    """The networks of a model, and what it leaves unexplained."""
    networks = facts.get("network", {})
    members = networks.get("members", ())
    for number, one in enumerate(members, 1):
        who = f"member {number}, start {one['start']}" if len(members) > 1 else "training"
        yield f"{who}: {one['stop'].rstrip('.')} after {one['epochs']} epochs, best epoch {one['best_epoch']}"
    if "arm_model" in networks:
        sizes, epochs = "-".join(map(str, networks["sizes"])), networks["epochs"]
        yield (
            f"{len(epochs)} networks {sizes} on the residuals of the {networks['arm_model']} model: "
            f"{networks['effective_weights']:.0f} effective weights each, {max(epochs)} epochs"
        )
    if "residual_std_mm" in facts:
        scatter = "; the scatter of its networks comes on top" if networks else ""
        std = format_fixed(facts["residual_std_mm"])
        yield f"residual standard deviation: {std} mm of a coordinate, unexplained by the model{scatter}"


def _describe_length(outlier: Outlier) -> str:
    if is_offset(outlier.name):
        return (
            f"{outlier.name}: {-outlier.error_mm:.3f} mm, {outlier.normalized_residual:.0f} standard uncertainties: "
            "if the zero of the wire is unknown, state a larger u_offset_mm"
        )
    than = "exceeds" if outlier.error_mm > 0 else "is smaller than"
    return (
        f"{outlier.name}: certificate value {than} the value implied by the other data by "
        f"{abs(outlier.error_mm):.3f} mm ({outlier.normalized_residual:.0f} standard uncertainties)"
    )


def own_coefficients(model: IdentifiedModel) -> list[dict[str, Any]]:
    """The coefficients of the terms of the user's own that a model was fitted with, and their standard uncertainty.

    Rad, or mm, for a function of one (see `Term.direction`). Both are zero where the readings show nothing of the
    term's group. A term of several functions has a name for each.
    """
    fit, found = model.fit_, []
    u = np.sqrt(fit.covariance.diagonal())
    identified = list(zip(fit.perturbed_chain.terms, fit.perturbed_chain.columns, strict=True))
    for term in model.terms:
        # By the term, not its name, which another term may have.
        columns = next((columns for one, columns in identified if one == term), None)
        for i, label in enumerate(term.labels):
            at = 0.0 if columns is None else fit.coefficients[columns][i].item()
            found.append({"name": label, "coefficient": at, "u": 0.0 if columns is None else u[columns][i].item()})
    return found


def _describe_own(name: str, coefficient: float, u: float) -> str:
    if not u:
        return f"{name}: pruned, these readings show nothing of it"
    return f"{name}: {coefficient:.3g}, standard uncertainty {u:.2g}"


def _term_lines(model: IdentifiedModel) -> Iterator[str]:
    """The groups of terms that the readings determine, those that they do not, and terms that were not offered."""
    groups = model.fit_.groups
    if len(groups) > 5:
        kept = sorted((group for group in groups if group.effective >= 0.5), key=lambda group: -group.effective)
        names = ", ".join(f"{group.name} ({group.effective:.0f})" for group in kept[:MAX_GROUPS])
        pruned = len(groups) - len(kept)
        yield f"terms with most determined coefficients: {names}; {pruned} of {len(groups)} groups were pruned"
    # What no readings determine is no fault of these.
    open_ones = [str(one) for one in identifiability(model.fit_).unidentifiable if one.at_other_poses]
    yield from listed("not identifiable from these readings", open_ones, "combinations")
    yield from listed("not offered", [f"{term.name}, as {term.reason}" for term in model.excluded_terms_], "terms")
