"""The page that compares models of an arm on one set of readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truearm.compensation.models.error_figures import (
    before_after,
    coordinates_by_reading,
    error_against_joint,
    error_distribution,
    errors_by_reading,
    joint_ranges,
)
from truearm.compensation.models.workspace_figures import error_in_workspace, workspace
from truearm.pages.page import Column, LabelledValue, Page, Section, Table
from truearm.pages.plotting import styles_of
from truearm.typing import FloatArray

ERROR_COLUMNS = (
    ("mean_mm", "mean distance", "mm"),
    ("rms_mm", "rms distance", "mm"),
    ("p95_mm", "95 % of distances below", "mm"),
    ("max_mm", "largest distance", "mm"),
    ("mean_abs_coordinate_mm", "mean |coordinate|", "mm"),
    ("max_abs_coordinate_mm", "largest |coordinate|", "mm"),
    ("removed_percent", "removed", "%"),
)


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Readings and what models made of them.

    Attributes
    ----------
    angles : (n, n_joints) array
        [rad], or [mm] for sliding joints.
    points : (n, 3) array
        By the reference [mm].
    predicted : mapping of str to (n, 3) array
        By each model [mm]; the first is the state before compensation.
    errors : mapping of str to mapping
        The figures of `ERROR_COLUMNS` for each model, and its number of readings `n`.
    joint_names : sequence of str
    lower, upper : (n_joints,) array
        Joint limits, infinite where there is none.
    sliding : sequence of bool
    """

    angles: FloatArray
    points: FloatArray
    predicted: Mapping[str, FloatArray]
    errors: Mapping[str, Mapping[str, float]]
    joint_names: Sequence[str]
    lower: FloatArray
    upper: FloatArray
    sliding: Sequence[bool]


def comparison_page(
    compared: ModelComparison,
    *,
    title: str,
    subtitle: str,
    facts: Sequence[tuple[str, str]],
    remarks: Sequence[str] = (),
    floor: Mapping[str, float] | None = None,
    more: Sequence[Section] = (),
) -> Page:
    """The page: what was measured, errors before and after, where they come from.

    Parameters
    ----------
    compared : ModelComparison
    title, subtitle : str
    facts : sequence of (str, str)
        What the page rests on: versions, fingerprints.
    remarks : sequence of str
        What a reader must know before the numbers: readings that a model learned from, or that lie beyond them.
    floor : mapping, optional
        The figures of `ERROR_COLUMNS` and `n` that no model can beat, where they are known.
    more : sequence of Section
        What else there is to say, before the details.
    """
    return Page(
        title=title,
        subtitle=subtitle,
        summary=_summary(compared),
        sections=(
            _result(compared, remarks, floor),
            *more,
            _measured(compared),
            _by_coordinate(compared),
            _by_cause(compared),
        ),
        facts=tuple(facts),
    )


def error_table(errors: Mapping[str, Mapping[str, float]], *, caption: str) -> Table:
    """The error figures of several models, a row each."""
    first = next(iter(errors))
    return Table(
        columns=(
            Column("model"),
            *(Column(heading, unit, 4 if unit == "%" else 3) for _, heading, unit in ERROR_COLUMNS),
            Column("readings"),
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


def _summary(compared: ModelComparison) -> tuple[LabelledValue, ...]:
    before, best = next(iter(compared.errors)), _best(compared)
    rows = [LabelledValue(f"mean error, {before}", compared.errors[before]["mean_mm"], "mm")]
    if best != before:
        rows += [
            LabelledValue(f"mean error, {best}", compared.errors[best]["mean_mm"], "mm"),
            LabelledValue(f"largest error, {best}", compared.errors[best]["max_mm"], "mm"),
            LabelledValue("removed of the mean coordinate error", compared.errors[best]["removed_percent"], "%"),
        ]
    return tuple(rows)


def _result(compared: ModelComparison, remarks: Sequence[str], floor: Mapping[str, float] | None) -> Section:
    distances = _distances(compared)
    table = error_table(
        {**compared.errors, **({} if floor is None else {"noise floor": floor})},
        caption="Errors on the readings of this page",
    )
    styles = styles_of(distances)
    return Section(
        "Error before and after",
        "\n\n".join(remarks)
        + ("\n\n" if remarks else "")
        + "Every reading has a point by the reference and one by each model; an error is what lies between them. "
        "Distances are in space, a coordinate is one of x, y, z. Removed is the share of the nominal arm's mean "
        "absolute coordinate error that is gone.",
        figures=(before_after(distances, styles=styles), error_distribution(distances, styles=styles)),
        tables=(table,),
    )


def _measured(compared: ModelComparison) -> Section:
    return Section(
        "What was measured",
        "Where the joints and the tip were. A model holds where readings like these have taught it.",
        figures=(
            joint_ranges(
                compared.angles,
                names=compared.joint_names,
                lower=compared.lower,
                upper=compared.upper,
                sliding=compared.sliding,
            ),
            workspace(compared.points),
        ),
    )


def _by_coordinate(compared: ModelComparison) -> Section:
    errors = {name: points - compared.points for name, points in compared.predicted.items()}
    styles = styles_of(errors)
    return Section(
        "Coordinate by coordinate",
        figures=(
            errors_by_reading(errors, styles=styles),
            coordinates_by_reading(compared.points, compared.predicted, styles=styles),
        ),
    )


def _by_cause(compared: ModelComparison) -> Section:
    distances = _distances(compared)
    best = _best(compared)
    return Section(
        "Where the error comes from",
        "Which joints and places the errors go with. Distances have no sign: a wave shows twice as often.",
        figures=(
            error_against_joint(
                compared.angles,
                distances,
                names=compared.joint_names,
                sliding=compared.sliding,
                styles=styles_of(distances),
            ),
            error_in_workspace(compared.points, distances[best], name=best),
        ),
    )
