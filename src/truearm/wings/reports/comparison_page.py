"""The page that compares models of an arm on one set of readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from truearm.models.uncertainty import UncertaintyBudget
from truearm.number_format import format_count, format_percent, format_uncertainty, show_mm
from truearm.pages.drawings.arm_scene import readings_scene
from truearm.pages.drawings.error_figures import (
    before_after,
    coordinates_by_reading,
    error_distribution,
    errors_by_reading,
)
from truearm.pages.drawings.joint_figures import error_against_joint, joint_ranges
from truearm.pages.drawings.workspace_figures import error_in_workspace, workspace
from truearm.pages.page import Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.scene import Mechanism
from truearm.solve.sums import design_effect
from truearm.typing import FloatArray

# Share of the readings in their 95 % ellipsoids from which the stated uncertainty counts as confirmed: readings of one
# position err alike, so that of a few hundred the share scatters by some percent.
LEAST_COVERAGE = 0.9
# Standard uncertainties of a mean difference of errors by which an error must fall.
SURE = 2.0
ERROR_COLUMNS = (
    ("mean_mm", "mean distance", "mm"),
    ("rms_mm", "rms distance", "mm"),
    ("p95_mm", "95 % of distances below", "mm"),
    ("max_mm", "largest distance", "mm"),
    ("mean_abs_coordinate_mm", "mean |coordinate|", "mm"),
    ("max_abs_coordinate_mm", "largest |coordinate|", "mm"),
    ("removed_percent", "reduction", "%"),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedReadings:
    """Readings of a session, and their points by several models.

    Attributes
    ----------
    angles : (n, n_joints) array
        [rad], or [mm] for sliding joints.
    predicted : mapping of str to (n, 3) array
        By each model [mm]; the first is the state before compensation.
    joint_names : sequence of str
    lower, upper : (n_joints,) array
        Joint limits, infinite where there is none.
    sliding : sequence of bool
    reading_names : sequence of str
        Of the readings, such as their lines in the file; numbers by default.
    mechanism : Mechanism, optional
        The arm that the interactive view brings to a reading.
    """

    angles: FloatArray
    predicted: Mapping[str, FloatArray]
    joint_names: Sequence[str]
    lower: FloatArray
    upper: FloatArray
    sliding: Sequence[bool]
    reading_names: Sequence[str] = ()
    mechanism: Mechanism | None = None

    def in_space(
        self,
        title: str,
        points: FloatArray,
        distances: Mapping[str, FloatArray],
        *,
        shown: str,
        what: str,
        names: Sequence[str],
        std_mm: FloatArray | None = None,
    ) -> Section:
        """The section with the readings as a scene, see `readings_scene`; `names` are those of readings without any."""
        scene = readings_scene(
            points,
            distances,
            self.angles,
            what=what,
            names=self.reading_names or names,
            joint_names=self.joint_names,
            sliding=self.sliding,
            still=error_in_workspace(points, distances[shown], name=shown),
            shown=shown,
            std_mm=std_mm,
            mechanism=self.mechanism,
        )
        return Section(title, scenes=(scene,))

    def measured_range(self, points: FloatArray) -> Section:
        """The section with the ranges of the joints and of the tip."""
        ranges = joint_ranges(
            self.angles, names=self.joint_names, lower=self.lower, upper=self.upper, sliding=self.sliding
        )
        return Section(
            "Measured range",
            "Joint positions and tip positions of the readings. A model is valid only in the range it was trained on.",
            figures=(ranges, workspace(points)),
            folded=True,
        )

    def by_joint(self, distances: Mapping[str, FloatArray], text: str) -> Section:
        """The section with the errors against the position of each joint."""
        figure = error_against_joint(self.angles, distances, names=self.joint_names, sliding=self.sliding)
        return Section("Errors by joint position", text, figures=(figure,), folded=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelComparison(ComparedReadings):
    """Points of a session by the reference and by several models.

    Attributes
    ----------
    points : (n, 3) array
        By the reference [mm].
    errors : mapping of str to mapping
        The figures of `ERROR_COLUMNS` for each model, and its number of readings `n`.
    std_mm : mapping of str to (n,) array
        Standard uncertainty of a coordinate at each reading, of the models that state one.
    """

    points: FloatArray
    errors: Mapping[str, Mapping[str, float]]
    std_mm: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def before(self) -> str | None:
        """The state before compensation, the first of `errors`; None for models without a nominal arm."""
        first = next(iter(self.errors))
        return first if "removed_percent" in self.errors[first] else None


def comparison_page(
    compared: ModelComparison,
    *,
    title: str,
    subtitle: str,
    facts: Sequence[tuple[str, str]],
    remarks: Sequence[str] = (),
    floor: Mapping[str, float] | None = None,
    more: Sequence[Section] = (),
    verdict: PageVerdict | None = None,
) -> Page:
    """The page: the verdict, the readings in space, errors before and after compensation; then the details, folded.

    Parameters
    ----------
    compared : ModelComparison
    title, subtitle : str
    facts : sequence of (str, str)
        Versions and fingerprints of the data.
    remarks : sequence of str
        Reservations: training readings on the page, readings outside the trained range.
    floor : mapping, optional
        The figures of `ERROR_COLUMNS` and `n` of an arm without systematic errors, where they are known.
    more : sequence of Section
        Further sections, before the details.
    verdict : PageVerdict, optional
        From `comparison_verdict`; without one the page states the errors and judges nothing.
    """
    return Page(
        title=title,
        subtitle=subtitle,
        verdict=verdict or PageVerdict(error_sentence(compared)),
        summary=_summary(compared),
        sections=(
            _in_space(compared),
            _result(compared, remarks, floor),
            *more,
            compared.measured_range(compared.points),
            _by_coordinate(compared),
            compared.by_joint(
                _distances(compared), "Distances have no sign: a periodic error shows twice its frequency."
            ),
        ),
        facts=tuple(facts),
    )


def error_table(errors: Mapping[str, Mapping[str, float]], *, caption: str) -> Table:
    """The error figures of several models, a row each."""
    first = next(iter(errors))
    return Table(
        columns=Column.of(
            "model", *(Column(heading, unit, 4 if unit == "%" else 3) for _, heading, unit in ERROR_COLUMNS), "readings"
        ),
        rows=tuple(
            (
                name,
                *(
                    None
                    if key not in figures_of or (key, name) == ("removed_percent", first)
                    else float(figures_of[key])
                    for key, _, _ in ERROR_COLUMNS
                ),
                int(figures_of["n"]),
            )
            for name, figures_of in errors.items()
        ),
        caption=caption,
    )


def _distances(compared: ModelComparison) -> dict[str, FloatArray]:
    return {name: np.linalg.norm(points - compared.points, axis=1) for name, points in compared.predicted.items()}


def _best(compared: ModelComparison) -> str:
    return min(compared.errors, key=lambda name: compared.errors[name]["mean_mm"])


def error_sentence(compared: ModelComparison) -> str:
    """The answer a reader came for, in a sentence."""
    mean = {name: errors["mean_mm"] for name, errors in compared.errors.items()}
    before = None if compared.before is None else mean[compared.before]
    sentence = improvement_sentence("Mean error", before, mean[_best(compared)])
    p95 = compared.errors[_best(compared)]["p95_mm"]
    n = format_count(len(compared.points), "reading")
    return f"{sentence} 95 % of the errors of {n} are below {show_mm(p95)}."


def comparison_verdict(
    compared: ModelComparison, budgets: Mapping[str, UncertaintyBudget], *, doubts: Mapping[str, str] | None = None
) -> PageVerdict:
    """The accuracy of a model on these readings, and its uncertainty.

    Good: compensation reduces the error of readings that took no part in training by more than the uncertainty of the
    difference, and the uncertainty that the model states covers them. Doubtful: it may be chance, they are training
    readings or may be, or the stated uncertainty is too small for them.

    Parameters
    ----------
    compared : ModelComparison
    budgets : mapping of str to UncertaintyBudget
        Of the models that state an uncertainty.
    doubts : mapping of str to str, optional
        Models that were trained on these readings, or may have been, each with a sentence that says so.
    """
    best, before = _best(compared), compared.before
    if before is not None and not compared.errors[best]["mean_mm"] < compared.errors[before]["mean_mm"]:
        return PageVerdict(error_sentence(compared), "bad", "Do not use this model for these readings.")
    details: list[str] = []
    state: State = "good"
    if before is not None:
        distances = _distances(compared)
        gains = distances[before] - distances[best]
        if not gains.mean() > SURE * _u_of_mean(gains):
            state = "doubtful"
            details.append("The error does not fall by more than the uncertainty of that difference.")
    if doubts and best in doubts:
        state = "doubtful"
        details.append(doubts[best])
    if (budget := budgets.get(best)) is not None:
        u = format_uncertainty(budget.expanded_mm)
        details.append(f"Expanded uncertainty of a coordinate by {best}: U = {u} mm (k = {budget.coverage_factor:g}).")
        if budget.n_points:
            details.append(
                f"{format_percent(budget.coverage)} of the readings lie in the ellipsoids that should hold "
                f"{format_percent(UncertaintyBudget.level)}."
            )
            if budget.coverage < LEAST_COVERAGE:
                state = "doubtful"
                details.append("The stated uncertainty is too small for these readings.")
    return PageVerdict(error_sentence(compared), state, " ".join(details))


def _u_of_mean(values: FloatArray) -> float:
    """Standard uncertainty of the mean of values in the order of their readings, of which neighbours are alike."""
    n, variance = len(values), float(values.var(ddof=1)) if len(values) > 1 else np.inf
    if not 0 < variance < np.inf:
        return variance
    off = values - values.mean()
    return float(np.sqrt(variance / n * design_effect(off[:, None], np.array([[1 / (n * variance)]]), n).factor))


def _in_space(compared: ModelComparison) -> Section:
    best = _best(compared)
    return compared.in_space(
        "Where the errors are",
        compared.points,
        _distances(compared),
        shown=best,
        what="error",
        names=[f"reading {i + 1}" for i in range(len(compared.points))],
        std_mm=compared.std_mm.get(best),
    )


def improvement_sentence(what: str, before_mm: float | None, after_mm: float) -> str:
    """Say how large an error is after compensation, and how many times smaller than before if that is known."""
    if before_mm is None:
        return f"{what} {show_mm(after_mm)}."
    if not after_mm < before_mm:
        return f"{what} {show_mm(before_mm)}; compensation does not reduce it."
    if before_mm < 1.05 * after_mm:
        return f"{what} {show_mm(after_mm)}, as large as before ({show_mm(before_mm)})."
    factor = f"{before_mm / after_mm:.2g}" if before_mm < 100 * after_mm else "over 100"
    return f"{what} {show_mm(after_mm)}, {factor} times smaller than before ({show_mm(before_mm)})."


def _summary(compared: ModelComparison) -> tuple[LabelledValue, ...]:
    before, best = compared.before, _best(compared)
    rows = [LabelledValue(f"mean error, {name}", compared.errors[name]["mean_mm"], "mm") for name in [before] if name]
    if best != before:
        rows += [
            LabelledValue(f"mean error, {best}", compared.errors[best]["mean_mm"], "mm"),
            LabelledValue(f"largest error, {best}", compared.errors[best]["max_mm"], "mm"),
        ]
    if before not in (None, best):
        removed = compared.errors[best]["removed_percent"]
        rows.append(LabelledValue("reduction of the mean coordinate error", removed, "%"))
    return tuple(rows)


def _result(compared: ModelComparison, remarks: Sequence[str], floor: Mapping[str, float] | None) -> Section:
    distances = _distances(compared)
    table = error_table(
        {**compared.errors, **({} if floor is None else {"noise floor": floor})},
        caption="Errors on the readings of this page",
    )
    text = (
        "An error is the difference between a model's point and the reference point of the same reading. Distances "
        "are in space; a coordinate is one of x, y, z."
    )
    if compared.before is not None:
        text += " The reduction is that of the nominal arm's mean absolute coordinate error."
    return Section(
        "Errors" if compared.before is None else "Error before and after",
        "\n\n".join([*remarks, text]),
        figures=(before_after(distances),),
        tables=(table,),
    )


def _by_coordinate(compared: ModelComparison) -> Section:
    errors = {name: points - compared.points for name, points in compared.predicted.items()}
    return Section(
        "Distribution and coordinates",
        figures=(
            error_distribution(_distances(compared)),
            errors_by_reading(errors),
            coordinates_by_reading(compared.points, compared.predicted),
        ),
        folded=True,
    )
