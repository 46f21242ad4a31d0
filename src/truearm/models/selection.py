"""Model selection: the simplest model whose error on readings held out is within a standard error of the least.

Of few positions or seats it is the best one (`held_out_errors.selected`).

Models are compared in pairs on the same readings, all of them: an error that all share, such as a far-out pose, a seat
that is hard to predict or a gross error, cancels in the difference, which is at most the distance between the two
predictions. Differences are averaged by position or seat, without the tenth at either end, so that a few readings
decide nothing. A reading that a model takes for a gross error counts all the same: the model does not predict it.

What a person must know of a fitted model, and how well it explains the readings of its fit, comes with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from truearm.findings import Finding, format_mm
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.identification.identify import Progress
from truearm.identification.judgement.frame_changes import SessionChange, frame_changes
from truearm.identification.judgement.gross_errors import excluded_readings
from truearm.identification.judgement.held_out_errors import exceeds, group_means, selected, trimmed_mean
from truearm.identification.judgement.outliers import Outlier, length_outliers, outliers
from truearm.identification.judgement.reading_groups import reading_groups
from truearm.identification.judgement.stated_uncertainty import rounded_angles
from truearm.identification.references.orientations import LEVER_MM
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.references.session_frames import points_to_session_frames
from truearm.identification.terms import Term
from truearm.models.compensator import Compensator
from truearm.models.hybrid import HybridModel, moves
from truearm.models.identified_model import IdentifiedModel, KinematicModel, NominalModel, PhysicalModel, to_identified
from truearm.models.training_conditions import TrainingReadings
from truearm.readings.anchors import LEAST_COMPARED, distance_errors, has_located_anchor
from truearm.readings.point_errors import (
    LengthSummary,
    compare_errors,
    has_repeated_seat,
    length_errors,
    point_errors,
    seat_errors,
)
from truearm.readings.thermal_expansion import expanded_lengths
from truearm.typing import IntArray

# Root mean square of a coordinate that rounding to 0.01 mm leaves, as most pendants show it, with a quarter to spare
# [mm]. No arm is as near to its drawing: one that its maker compensated has 0.015.
OF_DRAWING = 1.25 * 0.01 / np.sqrt(12)
# No instrument repeats to that [mm], and so no measured point agrees with any arm.
OF_ANY_ARM = 1e-3


def calculated_points(
    readings: PreparedReadings, nominal: IdentificationResult, identified: IdentificationResult
) -> tuple[Finding, ...]:
    """That points agree with an arm as no measured ones do; nothing where they do not.

    Parameters
    ----------
    readings : PreparedReadings
    nominal, identified : IdentificationResult
        The nominal arm, and the one with its constants: controllers know those of their own arm.
    """
    if readings.points is None or nominal.references[0].kind != "point":
        return ()
    for name, fit, most in (("nominal", nominal, OF_DRAWING), ("identified", identified, OF_ANY_ARM)):
        residuals, freedom = fit.references[0].residuals, fit.residual_freedom(readings.references)
        if freedom >= residuals.size / 2 and (rms := float(np.sqrt((residuals**2).sum() / freedom))) <= most:
            said = (
                f"The points agree with the {name} arm to {rms:.1g} mm, their own rounding: they are calculated from "
                "the angles, as controllers do, not measured. What is fitted to them says nothing of the arm: name the "
                "columns of the instrument."
            )
            return (Finding("calculated points", said, {"rms_mm": rms}),)
    return ()


# With fewer readings the training error of a kinematic model says little: it determines some 27 constants.
FEW_READINGS = 50
# Scatter about the identified arm that is said: real arms under a tracker leave 0.05 to 0.3 mm of a coordinate.
SAID_SCATTER_MM, TRACKER_MM = 0.5, 0.05
# Scatter of orientations about an axis that is said: a marker of a laser tracker has 0.01.
SAID_SCATTER_DEG = 0.5


def model_findings(model: Compensator, arm_model: Compensator, readings: PreparedReadings) -> Iterator[Finding]:
    """What a person must know of a model that was fitted to readings, apart from what readings held out say.

    Parameters
    ----------
    model : Compensator
    arm_model : Compensator
        The model whose constants show how the readings scatter.
    readings : PreparedReadings
    """
    identified, arm = to_identified(model), model.identified_arm or model.nominal_
    yield from model.findings_
    yield from model.training_.still_joints(model.arm_.chain)
    yield from model.nominal_check_.findings()
    if (axis := model.nominal_check_.axis_scale) is not None:
        yield from axis.findings()
    # Without terms for them no model ignores them.
    yield from (one for one in readings.findings if identified is not None or one.what != "few readings on")
    if arm_model.arm.has_kinematics:
        yield from calculated_points(readings, arm_model.nominal_, arm_model.identified_arm or arm_model.nominal_)
    yield from _scatter(arm_model, readings)
    if model.identified_arm is not None:
        yield from rounded_angles(readings, model.identified_arm)
    if not arm.converged and model.arm.has_kinematics:
        said = "The fit has not converged: more readings, or poses that differ more from each other, may help."
        yield Finding("convergence", said)
    if model.kind not in ("nominal", "network") and (n := len(readings)) < FEW_READINGS:
        said = f"Only {n} readings: the training error says little. Use some {FEW_READINGS} or more."
        yield Finding("few readings", said, {"n": n})


def _scatter(model: Compensator, readings: PreparedReadings) -> Iterator[Finding]:
    """By how much readings scatter about the identified arm, where that is much and their uncertainty is not stated."""
    if (identified := model.identified_arm) is None:
        return
    of = identified.references[0]
    scatter = of.noise_std * float(np.sqrt(len(of.residuals)))
    if not model.identifies_constants:  # whose residuals are not noise; the check knows it where they are unusual
        scatter = model.nominal_check_.left.noise_mm
    if of.kind in ("point", "distance") and scatter >= SAID_SCATTER_MM and not readings.references[0].std.any():
        said = (
            f"These readings scatter by {format_mm(scatter)} about the identified arm; with a laser tracker it is "
            f"{TRACKER_MM:g} mm. The uncertainties contain it, and more readings average it."
        )
        yield Finding("scatter", said, {"scatter_mm": scatter})
    for part in identified.references:
        if part.kind == "orientation" and (turn := np.degrees(part.noise_std / LEVER_MM)) >= SAID_SCATTER_DEG:
            said = f"The orientations scatter by {turn:.2g} deg about each axis; they count by that beside the points."
            yield Finding("orientation scatter", said, {"scatter_deg": float(turn)})


def training_errors(model: Compensator, readings: TrainingReadings) -> Mapping[str, Any] | None:
    """Errors of the readings that took part, and of known lengths between their seats."""
    state, measured = model.state_in_training(readings), readings.measured
    if model.identified_arm is not None and len(excluded := excluded_readings(model.identified_arm)):
        kept = np.setdiff1d(np.arange(len(measured)), excluded)
        state, measured = state.rows(kept), measured.rows(kept)
    predicted = points_to_session_frames(model._tips(state), measured.session, model.session_frames_)
    if not model.arm.has_kinematics:
        assert measured.points is not None  # of a network
        return point_errors(predicted, measured.points)
    nominal = points_to_session_frames(model.nominal_.tips(state), measured.session, model.session_frames_)
    of_lengths: dict[str, LengthSummary] = {}
    known = None if readings.lengths is None or measured.seat is None else readings.lengths.within(measured.seat)
    if (there := expanded_lengths(known, measured)) is not None:
        assert measured.seat is not None
        own, drawn = (length_errors(points, measured.seat, there) for points in (predicted, nominal))
        of_lengths["lengths"] = LengthSummary.of(own, drawn, there.u_mm)
    if measured.points is not None:
        return {**compare_errors(predicted, nominal, measured.points), **of_lengths}
    if has_repeated_seat(measured):
        assert measured.seat is not None
        of_seats = seat_errors(predicted, measured.seat).items()
        return {name: value for name, value in of_seats if name != "seats"} | of_lengths
    if has_located_anchor(measured, LEAST_COMPARED):
        return dict(list(distance_errors(predicted, measured).items())[:4])
    return None


# Beside the nominal model, the simplest first.
CANDIDATES: dict[str, type[IdentifiedModel]] = {"kinematic": KinematicModel, "physical": PhysicalModel}

# What is selected.
SelectedModel: TypeAlias = IdentifiedModel | HybridModel


@dataclass(frozen=True)
class ModelScore:
    """Errors of a model on readings held out, those that are gross errors of the selected model apart.

    Attributes
    ----------
    name : str
    mean_mm, standard_error_mm : float
        Mean error of readings held out with their position or seat, and its standard error.
    p95_mm, max_mm : float
    excess_mm, excess_standard_error_mm : float
        Trimmed mean by how much the error exceeds that of the best model on the same readings, gross errors among them,
        and its standard error.
    n_excluded : int
        Readings that are gross errors of the selected model: omitted from mean, 95 % and maximum.
    n_effective : float
        Parameters that the readings determine.
    kept : bool
        Whether the model was selected.
    """

    name: str
    mean_mm: float
    standard_error_mm: float
    p95_mm: float
    max_mm: float
    excess_mm: float
    excess_standard_error_mm: float
    n_excluded: int
    n_effective: float
    kept: bool


class Selection(NamedTuple):
    """A model, those that it was compared with, and what a person must know of it.

    Attributes
    ----------
    model : Compensator
        Fitted to all readings; without an arm one that knows none.
    table : tuple of ModelScore
        All candidates, the simplest first; empty where no reading could be held out, and the nominal arm is kept.
    why_no_hybrid : str or None
        Why the hybrid model is not among them; None where it is.
    changes : tuple of SessionChange
        What changed during the sessions, by the residuals of the arm with the most terms.
    arm_model : Compensator
        The model whose constants show how the readings scatter: the selected one, of a nominal or hybrid model the
        kinematic one; the nominal model where no other was fitted.
    findings : tuple of Finding
        What a person must know of the model.
    training : dict or None
        Errors on the readings, without those excluded as gross errors: of points, or of the scatter in seats, or of
        distances to anchors; None without any of these.
    outliers : tuple of Outlier
        Readings whose residual is too large, the largest first; rows are those of the readings.
    length_outliers : tuple of Outlier
        Known lengths that contradict the other data.
    """

    model: Compensator
    table: tuple[ModelScore, ...]
    why_no_hybrid: str | None
    changes: tuple[SessionChange, ...]
    arm_model: Compensator
    findings: tuple[Finding, ...]
    training: Mapping[str, Any] | None
    outliers: tuple[Outlier, ...]
    length_outliers: tuple[Outlier, ...]


def select_model(
    nominal: NominalModel,
    readings: TrainingReadings,
    *,
    progress: Progress | None = None,
    residual: bool = True,
    terms: Sequence[Term] = (),
) -> Selection:
    """Fit the kinematic and the physical model, and the hybrid model if it may win, and keep one or the nominal model.

    Which one is kept is said by `selected`: the simplest within a standard error of the best, of few groups the best.

    The hybrid model comes last: it is kept only where its error is smaller than that of the physical model by more than
    a standard error. It must first win a heat (O. Maron, A. W. Moore, "Hoeffding races", NIPS 6 (1994) 59): it is
    fitted if the lead of the first of its networks over the best model, on its fold, would decide on all folds, and so
    would that of a network on the readings measured last: a gain that sits in the order of the readings has no use
    afterwards. Where something changed during a session (`frame_changes`), its networks would learn when: it is not
    fitted.

    Parameters
    ----------
    nominal : NominalModel
        Fitted to the readings; the others have its arm and free parts.
    readings : TrainingReadings
    progress : callable, optional
        Called with the steps done and a note.
    residual : bool
        Whether the physical model may have a residual process.
    terms : sequence of Term
        Of the user's own, offered to the physical model.

    Returns
    -------
    Selection

    Raises
    ------
    InputError
        As `fit_readings`.
    """

    def report(name: str, done: int) -> Progress:
        return lambda _, note: None if progress is None else progress(done, f"{name}: {note}")

    if not len(nominal.held_out_.rows):
        return _selection(nominal, nominal, readings, nominal=nominal, changes=_changes(nominal, readings))
    models = _fitted_arms(nominal, readings, report, residual=residual, terms=terms)
    compared: dict[str, SelectedModel] = {**models}
    hybrid, arm_model = HybridModel(nominal.arm, free=nominal.free), models["kinematic"]
    changes = _changes(list(models.values())[-1], readings)
    why_no_hybrid = _why_no_hybrid(hybrid, arm_model, readings, compared, changes)
    if why_no_hybrid is None:
        compared["hybrid"] = hybrid.learn(readings, progress=report("hybrid", len(models)), nominal=arm_model)
    table = _scores(compared)
    kept = next(score.name for score in table if score.kept)
    shows = models["physical" if kept == "physical" else "kinematic"]
    return _selection(
        compared[kept], shows, readings, nominal=nominal, table=table, why_no_hybrid=why_no_hybrid, changes=changes
    )


def _fitted_arms(
    nominal: NominalModel, readings: TrainingReadings, report: Callable[[str, int], Progress], **of_physical: Any
) -> dict[str, IdentifiedModel]:
    """The nominal model and the candidates by their names, each fitted beside the one before it."""
    models: dict[str, IdentifiedModel] = {"nominal": nominal}
    for name, kind in CANDIDATES.items():
        model = kind(nominal.arm, free=nominal.free, **(of_physical if name == "physical" else {}))
        models[name] = model.learn(readings, progress=report(name, len(models)), nominal=list(models.values())[-1])
    return models


def fit_chosen(
    chosen: Compensator, nominal: NominalModel | None, readings: TrainingReadings, *, progress: Progress | None
) -> Selection:
    """The model that a person chose, compared with no other; without a nominal model a network, which needs none."""
    if nominal is None:
        fitted = chosen.learn(readings, progress=progress)
        return _selection(fitted, fitted, readings)
    fitted = nominal
    if chosen.kind != "nominal":
        # A model without weights of outliers places its own nominal arm.
        fitted = chosen.learn(readings, progress=progress, nominal=nominal if chosen.robust else None)
    arm_model = fitted
    if fitted.identified_arm is None:
        # A network has no residuals of a rigid frame: those of the arm's constants show what changed.
        arm_model = KinematicModel(nominal.arm, free=nominal.free).learn(readings, nominal=nominal)
    return _selection(fitted, arm_model, readings, nominal=nominal, changes=_changes(arm_model, readings))


def _changes(model: Compensator, readings: TrainingReadings) -> tuple[SessionChange, ...]:
    assert model.identified_arm is not None
    return tuple(frame_changes(model.identified_arm, readings))


def _selection(
    model: Compensator,
    arm_model: Compensator,
    readings: TrainingReadings,
    *,
    nominal: NominalModel | None = None,
    table: tuple[ModelScore, ...] = (),
    why_no_hybrid: str | None = None,
    changes: tuple[SessionChange, ...] = (),
) -> Selection:
    """A model that is kept, with all that a person must know of it."""
    identified, arm = to_identified(model.judged()), model.identified_arm
    found = [*model_findings(model, arm_model, readings), *held_out_findings(model, nominal)]
    if why_no_hybrid is not None:
        found.append(Finding("hybrid model", f"The hybrid model was not compared: {why_no_hybrid}."))
    causes = [Finding("change", str(one), {"shift_mm": one.change.shift_mm}) for one in changes]
    if not causes and arm_model.identified_arm is not None:
        causes = [*reading_groups(arm_model.identified_arm, readings)]
    if causes:  # of scatter that the stated uncertainty does not have
        found = [one for one in found if one.what != "stated uncertainty" or one.numbers["stated_over_scatter"] > 1]
    found += causes
    return Selection(
        model,
        table,
        why_no_hybrid,
        changes,
        arm_model,
        tuple(found),
        training_errors(model, readings),
        () if arm is None else tuple(outliers(arm)),
        ()
        if identified is None
        else tuple(length_outliers(identified.fit_, model.state_in_training(readings), readings.references)),
    )


def held_out_findings(model: Compensator, nominal: NominalModel | None) -> Iterator[Finding]:
    """What readings held out say against a model."""
    if nominal is None:
        said = (
            "Without an arm nothing is compared with nominal points, and no change during the readings is looked for."
        )
        yield Finding("no arm", said)
    elif not len(nominal.held_out_.rows):
        kept = "; the nominal arm is kept, --model kinematic fits the others" if model.kind == "nominal" else ""
        said = f"No reading can be held out of the others, so models cannot be compared{kept}: measure more poses."
        yield Finding("held-out errors", said)
    elif (worse := worse_than_nominal(model, nominal)) is not None:
        own, drawn = map(format_mm, worse)
        said = (
            f"{own} on readings held out, the nominal arm {drawn}: these readings do not show what the {model.kind} "
            "model learned from them. Use the nominal arm (--model auto selects the better one), or measure more poses."
        )
        yield Finding("held-out errors", said, dict(zip(("model_mm", "nominal_mm"), worse, strict=True)))


def worse_than_nominal(model: Compensator, nominal: NominalModel) -> tuple[float, float] | None:
    """Mean errors of a model and of the nominal arm, where the model's is larger by more than a standard error [mm].

    Without those that are gross errors of the model; None elsewhere.
    """
    own, drawn = on_common_readings({"model": model, "nominal": nominal}).values()
    if not len(own.rows):
        return None
    if not exceeds(group_means(own), group_means(drawn)):
        return None
    counted = np.isin(own.rows, model.held_out_.rows)
    return own.select(counted).mean_mm, drawn.select(counted).mean_mm


def _scores(models: dict[str, SelectedModel]) -> tuple[ModelScore, ...]:
    """Errors on the readings that are held out of all models, by the one standard error rule."""
    compared = on_common_readings(models)
    errors = {name: group_means(part) for name, part in compared.items()}
    kept, best = selected(errors, len(np.unique(next(iter(compared.values())).group)))
    excess = {name: trimmed_mean(of - errors[best]) for name, of in errors.items()}
    excluded = excluded_readings(models[kept].fit_)
    shown = {name: part.select(~np.isin(part.rows, excluded)) for name, part in compared.items()}
    return tuple(
        ModelScore(
            name,
            part.mean_mm,
            part.standard_error_mm,
            float(np.quantile(part.errors_mm, 0.95)),
            float(part.errors_mm.max()),
            *excess[name],
            len(excluded),
            models[name].n_effective_,
            name == kept,
        )
        for name, part in shown.items()
    )


def _why_no_hybrid(
    hybrid: HybridModel,
    arm_model: IdentifiedModel,
    readings: TrainingReadings,
    models: dict[str, SelectedModel],
    changes: tuple[SessionChange, ...],
) -> str | None:
    """Why the hybrid model is not fitted; None if it applies and its first network is well ahead of the best model."""
    n_weights = (2 * readings.arm.n_joints + 1) * hybrid.hidden[0] + 3 * (hybrid.hidden[0] + 1)
    used = arm_model.held_out_
    for excludes, reason in (
        (readings.lengths is not None, "its networks do not learn from lengths"),
        (any(one.kind == "pose" for one in readings.references), "its networks learn points, and these are poses"),
        (not readings.has_point.all(), "its networks need a reference point at every reading"),
        (bool(readings.frames), "its networks learn in one frame, and the sessions have one each"),
        (len(readings.tips) > 1, "its networks learn one tip"),
        (3 * len(used.rows) < n_weights, f"{len(used.rows)} readings are too few for its {n_weights} weights"),
        (bool(changes), "its networks would learn what changed during the session, as if it came with the poses"),
        (len(np.unique(used.group)) < 2, "readings of one position cannot be held out"),
        (not moves(readings.state.angles[used.rows], readings.arm.chain.is_prismatic), "no joint moves"),
    ):
        if excludes:
            return reason
    for latest, reason in (
        (False, "its first network was no better"),
        (True, "its network was no better on the readings measured last, which it had not learned"),
    ):
        one = hybrid.held_out_by_one_member(readings, arm_model, latest=latest)
        common = reduce(np.intersect1d, [one.rows, *(model.held_out_.rows for model in models.values())])
        if not len(common):
            return "no reading is held out of all models"
        held_out = {name: _on_rows(model.held_out_, common) for name, model in models.items()}
        best = min(held_out.values(), key=lambda part: trimmed_mean(group_means(part))[0])
        excess, error = trimmed_mean(group_means(_on_rows(one, common)) - group_means(best))
        # On all folds the standard error of the same lead would be smaller by the root of their number.
        if not excess + error / np.sqrt(hybrid.n_members) < 0:
            return reason
    return None


def _on_rows(held_out: HeldOutReadings, rows: IntArray) -> HeldOutReadings:
    """Some held-out readings, sorted."""
    order = np.argsort(held_out.rows)
    return held_out.select(order[np.isin(held_out.rows[order], rows)])


def on_common_readings(models: Mapping[str, Compensator]) -> dict[str, HeldOutReadings]:
    """The readings that were held out of every model, sorted; those that are gross errors of one are among them."""
    every = {name: model.held_out_.and_also(model.held_out_gross_) for name, model in models.items()}
    common = reduce(np.intersect1d, [part.rows for part in every.values()])
    return {name: _on_rows(part, common) for name, part in every.items()}
