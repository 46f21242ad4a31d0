"""`report`: models of an arm compared on a session, as a page to show; with the arm's constants beside the drawing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from truearm.acceptance import acceptance_remarks, accepting, accepts
from truearm.errors import InputError
from truearm.models import Compensator, IdentifiedModel, NominalModel
from truearm.number_format import RoundedNumber, format_number
from truearm.pages.drawings.page_record import PageRecord, check_page_path, input_files
from truearm.pages.page import Cell, Column, Page, Section, Table
from truearm.readings import Lengths, Session, seat_errors
from truearm.readings.files import is_large
from truearm.readings.large_sessions import LargeSession
from truearm.readings.thermal_expansion import expanded_lengths
from truearm.solve.threads import one_blas_thread
from truearm.verbs.evaluate import AnyModelLike, Regressors, evaluate, is_regressor, regressor_remark
from truearm.verbs.inputs import (
    LengthsLike,
    SessionLike,
    evaluation_findings,
    model_of_tip_of,
    tested_readings,
    to_model,
    to_model_and_session,
    with_reference,
)
from truearm.verbs.record import TableRecord, TextTable, columns_of, number_of
from truearm.wings.exports.formats.constants_table import NOMINAL, ArmConstant, ConstantsTable, constants_table
from truearm.wings.exports.formats.rigid_arm import best_rigid_arm
from truearm.wings.exports.targets.manifest import ExportLoss
from truearm.wings.reports.comparison import compare_in_seats, compare_models, one_arm, page_facts
from truearm.wings.reports.comparison_page import (
    ModelComparison,
    comparison_page,
    comparison_verdict,
    improvement_sentence,
)
from truearm.wings.reports.identification_sections import identification_sections, identified_budgets
from truearm.wings.reports.seat_page import SeatComparison, seats_page, seats_sentence

# Rotations of an arm are stated in degrees; their changes are thousandths of one.
DEG = math.degrees(1)
SIGNIFICANT = 2.0  # standard uncertainties of a change
MOST_SHOWN = 8


def constants_section(
    table: ConstantsTable, loss: ExportLoss, *, reach_mm: float, name: str = "", folded: bool = False
) -> Section:
    """The constants of an arm beside the drawing, with their changes and standard uncertainties.

    Parameters
    ----------
    table : ConstantsTable
    loss : ExportLoss
        Of the arm with these constants alone.
    reach_mm : float
        Of the arm: what a rotation moves.
    name : str
        Of the model, where there are several.
    folded : bool
        Whether the section shows its title only.
    """
    rows = [_row(one) for one in table.constants]
    columns = Column.of(
        "constant",
        Column("nominal", digits=7),
        Column("identified", digits=7),
        Column("change", digits=3),
        Column("standard uncertainty", digits=2),
        "unit",
        "status",
    )
    changed = _changed(table, reach_mm)
    short = Table(
        columns[:-1],
        tuple(rows[i][:-1] for i in changed[:MOST_SHOWN]),
        f"{len(changed)} of {len(rows)} constants differ from the drawing by more than twice their standard uncertainty"
        + (f"; the {MOST_SHOWN} with the largest effect at full reach" if len(changed) > MOST_SHOWN else ""),
    )
    shown = Table(
        columns,
        tuple(rows),
        f"All constants of the best rigid arm, {'modified ' if table.identified.convention == 'mdh' else ''}"
        "Denavit-Hartenberg, in the branch of the nominal table",
        folded=True,
    )
    # Below a nanometre is the rounding of the arithmetic.
    exported, nominal = (
        "less than 0.000001" if error < 1e-6 else format_number(error, digits=2)
        for error in (loss.exported_mm, loss.nominal_mm)
    )
    text = (
        "Of all arms with constants alone, without harmonics and gravity, this one comes nearest to the model: over "
        f"the {loss.region}, held out, it differs from the model by {exported} mm on average, the nominal arm by "
        f"{nominal} mm. "
        "Angles are in the nominal branch; nearly parallel axes have beta, a rotation about y, and keep d. A constant "
        "that is identifiable only as a sum stays nominal, and the other part of the sum takes the change. One with "
        "the status nominal is held: nothing that the model has learned moves it."
    )
    title = "Constants: drawn and identified"
    return Section(f"{title}: {name}" if name else title, text, tables=(short, shown), folded=folded)


def _row(one: ArmConstant) -> tuple[Cell, ...]:
    factor, unit = (DEG, "deg") if one.unit == "rad" else (1.0, "mm")
    u, drawn = factor * one.std, factor * one.nominal
    if one.status == NOMINAL:  # what is held differs from the drawing by rounding at most
        return f"{one.place} {one.name}", drawn, drawn, None, None, unit, one.status
    identified, change = (RoundedNumber(factor * value, u) for value in (one.identified, one.change))
    return f"{one.place} {one.name}", drawn, identified, change, u or None, unit, one.status


def _changed(table: ConstantsTable, reach_mm: float) -> list[int]:
    """Rows of the arm's own constants with a significant change, the one with the largest effect first."""
    effect = {
        i: abs(one.change) * (reach_mm if one.unit == "rad" else 1.0)
        for i, one in enumerate(table.constants)
        if one.place not in ("base", "tip") and one.std > 0 and abs(one.change) > SIGNIFICANT * one.std
    }
    return sorted(effect, key=lambda i: -effect[i])


def constants_sections(models: Mapping[str, Compensator]) -> list[Section]:
    """Constants beside the drawing of every identified arm whose file keeps poses of its training."""
    identified = {
        name: model
        for name, model in models.items()
        if isinstance(model, IdentifiedModel)
        and not isinstance(model, NominalModel)
        and model.training_.angle_sample is not None
    }
    sections = []
    for name, model in identified.items():
        rigid = best_rigid_arm(model)
        title = name if len(identified) > 1 else ""
        table, reach = constants_table(model, rigid), model.arm.chain.reach
        sections.append(
            constants_section(table, rigid.loss, reach_mm=reach, name=title, folded=name != list(identified)[-1])
        )
    return sections


_HEADS = {"mean_mm": "mean [mm]", "rms_mm": "rms [mm]", "p95_mm": "95 % [mm]", "max_mm": "max [mm]"}


@dataclass(frozen=True, eq=False, repr=False)
class ReportResult(TableRecord, PageRecord):
    """Models of one arm compared on the readings of a session.

    Attributes
    ----------
    models : mapping of str to Compensator
        Models of truearm by their names on the page.
    regressors : mapping of str to regressor
        The user's own, by their names on the page.
    session : Session
        The readings of the comparison.
    lengths : Lengths or None
        Known lengths between seats of a session without reference points.
    errors : mapping of str to mapping
        Errors [mm] of the nominal arm, each model and each regressor: mean, 95 % quantile and maximum of the distances
        from the reference points or, without them, mean, root mean square and maximum of those from the mean of the
        seat.
    title : str
        Title of the page.
    input_remarks : tuple of str
        What was ignored of session and lengths.
    comparison : ModelComparison or SeatComparison
        Points of the readings by the reference and by every model.
    files : tuple of Path
        The files that were read.
    accept : str or None
        Why the readings are right where models would refuse them.
    accepted : tuple of str
        What that overrode.
    of_large : tuple of str
        That the readings are a sample of a large session, and the errors of all of it.
    """

    models: Mapping[str, Compensator]
    regressors: Regressors
    session: Session
    lengths: Lengths | None
    errors: Mapping[str, Mapping[str, float]]
    title: str
    input_remarks: tuple[str, ...]
    comparison: ModelComparison | SeatComparison
    files: tuple[Path, ...] = ()
    accept: str | None = None
    accepted: tuple[str, ...] = ()
    of_large: tuple[str, ...] = ()

    @property
    def page_remarks(self) -> list[str]:
        """What a reader must know of each model before the errors are believed."""
        with accepting(self.accept):
            remarks = {name: _remarks(model, self.session) for name, model in self.models.items()}
        remarks |= {name: [regressor_remark(one)] for name, one in self.regressors.items()}
        return [f"{name}: {remark}" for name, of_model in remarks.items() for remark in of_model]

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was ignored, and what a reader must know of each model before the errors are believed."""
        return (*self.of_large, *self.accepted, *self.input_remarks, *self.page_remarks)

    def page(self) -> Page:
        """Errors before and after compensation; for identified arms uncertainty, terms and errors of the joints."""
        with accepting(self.accept):
            return self._page()

    def _page(self) -> Page:
        models, session = dict(self.models), self.session
        layout: dict[str, Any] = {
            "title": self.title or f"{one_arm(models).arm.name}: error before and after compensation",
            "subtitle": f"{number_of(len(session))} of {session.file.name if session.file else 'a session'}",
            "facts": page_facts(models, session, self.regressors),
            "remarks": [*self.of_large, *self.accepted, *self.page_remarks],
        }
        both = identified_budgets(models, session)
        layout["more"] = [*constants_sections(models), *identification_sections(models, session, both)]
        if isinstance(self.comparison, SeatComparison):
            return seats_page(self.comparison, **layout)
        budgets = {name: budget for name, (budget, _) in both.items()}
        compared = replace(self.comparison, std_mm={name: budget.std_mm for name, budget in budgets.items()})
        trained = "These are the training readings of the model; errors of other readings are larger (split)."
        doubts = {name: trained for name, model in models.items() if model.is_trained_on(session)}
        doubts |= {name: f"{name}: {regressor_remark(one)}" for name, one in self.regressors.items()}
        verdict = comparison_verdict(compared, budgets, doubts=doubts)
        return comparison_page(compared, verdict=verdict, **layout)

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        what = "Mean error" if self.session.points is not None else "Mean distance from the mean of the seat"
        mean = {name: errors["mean_mm"] for name, errors in self.errors.items()}
        n = len(self.models) + len(self.regressors)
        if isinstance(self.comparison, SeatComparison):
            sentence = seats_sentence(what, mean, self.comparison)
        else:
            sentence = improvement_sentence(what, mean.get("nominal"), min(mean.values()))
        sentence = sentence.replace("\N{NARROW NO-BREAK SPACE}", " ")  # of pages: in a terminal nobody searches for it
        models = f"{number_of(n, 'model')} compared on {number_of(len(self.session))}"
        yield f"{models}: {sentence[0].lower()}{sentence[1:]}"
        heads = [_HEADS[key] for key in next(iter(self.errors.values()))]
        rows = [[name, *(f"{value:.4f}" for value in errors.values())] for name, errors in self.errors.items()]
        yield TextTable(["model", *heads], rows)
        yield from self.remarks

    def columns(self) -> dict[str, list[Any]]:
        """A row for the nominal arm and for each model: its errors."""
        return columns_of({"model": name} | dict(errors) for name, errors in self.errors.items())

    def _json(self) -> object:
        arm = one_arm(dict(self.models)).arm.name
        return {"arm": arm, "n_readings": len(self.session), **self._named("errors", "remarks")}


@one_blas_thread()
@accepts
def report(
    models: AnyModelLike | Sequence[AnyModelLike] | Mapping[str, AnyModelLike],
    session: SessionLike,
    path: str | Path | None = None,
    *,
    lengths: LengthsLike | None = None,
    title: str = "",
    accept: str | None = None,
) -> ReportResult:
    """Compare models of one arm on a session, as a page to show.

    Parameters
    ----------
    models : model, path or regressor, or a sequence or mapping of them
        Models of one arm, with the same free parts, or their files. Beside them regressors of the user's own, as in
        `evaluate`; one of the models must be truearm's, which knows the arm. The keys of a mapping are the names on the
        page.
    session : Session, DataFrame or path
        Readings with reference points, or in seats. Of a large session, a folder of files or one beyond 512 MiB, the
        page shows an evenly spaced sample, and has the errors of all reference points as sums.
    path : path, optional
        Page to write, ``.html``; see also `ReportResult.save_page`.
    lengths : Lengths or path, optional
        Known lengths between the seats of a session without reference points.
    title : str
        Title of the page.
    accept : str, optional
        Why the readings are right where they would be refused as contradicted: the reason and what it overrode are
        kept (docs/imperfect-readings.md).

    Returns
    -------
    ReportResult

    Raises
    ------
    InputError
        If there is nothing to compare with, no model is truearm's, the models are not of one arm, a regressor cannot
        predict the readings, or the page cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import truearm as ta
    >>> train, test = (ta.simulate("gao2017", poses=60, seed=seed).session for seed in (1, 2))
    >>> model = ta.KinematicModel(ta.load_arm("gao2017"), free=()).fit_readings(train)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result = ta.report(model, test, f"{folder}/page.html")
    >>> list(result.errors)
    ['nominal', 'kinematic']
    """
    given = _by_name(models)
    files = input_files(*given.values(), session, lengths)
    check_page_path(path, *files)
    regressors = {name: one for name, one in given.items() if is_regressor(one)}
    own = [(name, one) for name, one in given.items() if name not in regressors]
    if not own:
        raise InputError(
            "expected at least one model of truearm, which knows the arm and its nominal points, got regressors only",
            hint='the nominal arm beside them: ta.fit(arm, train, model="nominal").model',
        )
    (first_name, first_model), *others = own
    large = LargeSession.open(str(session)) if is_large(session) else None
    first, readings = to_model_and_session(first_model, session if large is None else large.sample())
    n_sample = len(readings)
    compared = with_reference(readings, first.arm)
    if lengths is not None and compared.session.points is not None:
        raise InputError(
            "lengths are for a session without reference points, and this one has them",
            file=lengths if isinstance(lengths, str | Path) else None,
            hint="truearm evaluate MODEL SESSION --lengths LENGTHS",
        )
    # The other models are of the same arm, or `one_arm` refuses them: one check of the readings is enough.
    fitted = {first_name: first} | {name: to_model(model) for name, model in others}
    fitted = {name: model_of_tip_of(model, compared.session) for name, model in fitted.items()}
    one_arm(fitted)
    tested = tested_readings(compared, readings, lengths, *fitted.values())
    readings, known = tested.session, expanded_lengths(tested.lengths, tested.session)
    comparison: ModelComparison | SeatComparison
    if readings.points is not None:
        comparison = compare_models(fitted, readings, regressors)
    else:
        comparison = compare_in_seats(fitted, readings, regressors, known)
    result = ReportResult(
        fitted,
        regressors,
        readings,
        known,
        _errors(comparison),
        title,
        tuple(map(str, tested.findings)),
        comparison,
        files,
        accept,
        acceptance_remarks(accept),
        () if large is None else tuple(_of_large(large, n_sample, fitted, comparison, accept)),
    )
    if path is not None:
        result.save_page(path)
    return result


def _of_large(
    large: LargeSession,
    n_sample: int,
    models: Mapping[str, Compensator],
    comparison: ModelComparison | SeatComparison,
    accept: str | None,
) -> Iterator[str]:
    """What the page of a sample shows of a large session, and the errors of all its reference points."""
    if n_sample == len(large):
        return
    yield f"Figures and tables are of {n_sample} of {len(large)} readings, evenly spaced in their order."
    if isinstance(comparison, ModelComparison):
        for name, model in models.items():
            errors = evaluate(model, large.path, accept=accept).errors["model"]
            sizes = f"95 % below {errors['p95_mm']:.4f} mm, the largest {errors['max_mm']:.4f} mm"
            yield f"{name}, all {errors['n']} readings: mean error {errors['mean_mm']:.4f} mm, {sizes}."


def _by_name(models: AnyModelLike | Sequence[AnyModelLike] | Mapping[str, AnyModelLike]) -> dict[str, AnyModelLike]:
    """Models by a short, unique name: kind, class, or stem of the file, or its path where the stem is not unique."""
    if isinstance(models, Mapping):
        return dict(models)
    # A pipeline and a forest are sequences as well, of their parts.
    is_one = isinstance(models, str) or hasattr(models, "predict")
    listed: list[Any] = list(models) if isinstance(models, Iterable) and not is_one else [models]
    if not listed:
        raise InputError("expected one or more models", hint="report(model, session)")
    stems = [Path(one).stem if isinstance(one, str | Path) else _kind(one) for one in listed]
    names = []
    for i, (one, stem) in enumerate(zip(listed, stems, strict=True)):
        is_path = isinstance(one, str | Path)
        unique = stems.count(stem) == 1 and not (stem == "nominal" and is_path)
        names.append(stem if unique else str(one) if is_path else f"{stem} {i + 1}")
    return dict(zip(names, listed, strict=True))


def _kind(model: object) -> str:
    name = type(model).__name__
    return name.removesuffix("Model").lower() if isinstance(model, Compensator) else name


def _errors(comparison: ModelComparison | SeatComparison) -> dict[str, dict[str, float]]:
    """Figures of the errors of the nominal arm and of each model [mm]."""
    if isinstance(comparison, ModelComparison):
        return {
            name: {key: float(errors[key]) for key in ("mean_mm", "p95_mm", "max_mm")}
            for name, errors in comparison.errors.items()
        }
    whole = {name: seat_errors(points, comparison.seat) for name, points in comparison.predicted.items()}
    return {
        name: {"mean_mm": one["seat_mean_mm"], "rms_mm": one["seat_rms_mm"], "max_mm": one["seat_max_mm"]}
        for name, one in whole.items()
    }


def _remarks(model: Compensator, session: Session) -> list[str]:
    at = model.checked(session)
    nominal = model.predict_nominal_readings(at) if model.arm_.has_kinematics else None
    return [str(one) for one in evaluation_findings(at, nominal)]
