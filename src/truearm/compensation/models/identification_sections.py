"""Sections of a page about an identified arm: its uncertainty, its terms, its joints, what the readings left open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from truearm.compensation.models.identified_model import HeldOutErrors
from truearm.compensation.models.joint_error_figure import ARCSEC, joint_error_figure
from truearm.compensation.models.uncertainty import COVERAGE_FACTOR, ELLIPSOID_FACTOR, LEVEL, UncertaintyBudget
from truearm.identification.estimation.diagnostics import Effect, JointError
from truearm.identification.estimation.outliers import Outlier
from truearm.pages.number_format import format_count, format_number, format_percent, format_uncertainty
from truearm.pages.page import Column, LabelledValue, Section, Table
from truearm.pages.plotting import Style

# Groups of fewer determined coefficients were not needed.
LEAST_DETERMINED = 0.5
MOST_NAMED = 20
_LEVEL = format_percent(LEVEL)


def uncertainty_section(budget: UncertaintyBudget, held_out: HeldOutErrors | None, *, name: str = "") -> Section:
    """The uncertainty of a coordinate in the metrologist's form, and the readings held out that it rests on.

    Parameters
    ----------
    budget : UncertaintyBudget
    held_out : HeldOutErrors, optional
        None where no readings could be held out.
    name : str
        Of the model, where there are several.
    """
    expanded = f"U = {format_uncertainty(budget.expanded_mm)} mm (k = {COVERAGE_FACTOR:g})"
    text = (
        f"The expanded uncertainty of a coordinate is {expanded}. It is the combined standard uncertainty times the "
        f"coverage factor k = {COVERAGE_FACTOR:g} and holds a coordinate with a probability of about {_LEVEL} where "
        "errors are normally distributed (JCGM 100:2008, 6.3.3). A point in space lies with that probability in an "
        f"ellipsoid whose half axes are {ELLIPSOID_FACTOR:.2f} standard uncertainties long.\n\n"
        "What the readings left open of the arm is the same error in the same pose, every time: between neighbouring "
        "points it cancels, and it grows away from where the arm was measured. What the model cannot explain is noise "
        "and effects without a term; it is sized so that ellipsoids hold their share of readings held out. Values are "
        "the root mean square over the readings of this page."
    )
    if budget.is_relative:
        text += (
            "\n\nAn arm that was identified from seats has a frame of its own. Where coordinates are compared with "
            "each other its place does not matter: uncertainties are what is left when a frame is fitted to the points "
            "of this page."
        )
    if budget.n_points:
        share = budget.n_covered / budget.n_points
        text += (
            f"\n\nOf the {format_count(budget.n_points, 'reading')} of this page, {format_percent(share)} lie in their "
            f"ellipsoids of {_LEVEL}, the reference's own uncertainty included where it is known."
        )
    rows = [
        LabelledValue("standard uncertainty of a coordinate, of the arm's parameters", budget.of_parameters_mm, "mm"),
        LabelledValue("standard uncertainty of a coordinate, unexplained", budget.unexplained_mm, "mm"),
        LabelledValue("combined standard uncertainty u of a coordinate", budget.combined_mm, "mm"),
        LabelledValue("the largest of this page", budget.largest_mm, "mm"),
        LabelledValue(f"expanded uncertainty U of a coordinate, k = {COVERAGE_FACTOR:g}", budget.expanded_mm, "mm"),
        LabelledValue(
            f"half axis of a point's {_LEVEL} ellipsoid, {ELLIPSOID_FACTOR:.2f} u", budget.ellipsoid_mm, "mm"
        ),
    ]
    if held_out is not None:
        held = f"{format_count(held_out.n, 'reading')} held out in {format_count(held_out.n_groups, 'group')}"
        known = held_out.standard_error_mm if np.isfinite(held_out.standard_error_mm) else None
        rows += [
            LabelledValue(f"mean error of {held}", held_out.mean_mm, "mm", known),
            LabelledValue(f"{_LEVEL} of them below", held_out.p95_mm, "mm"),
            LabelledValue("the largest of them", held_out.max_mm, "mm"),
        ]
    return Section(_titled("Uncertainty", name), text, rows=tuple(rows))


def terms_section(found: Sequence[Effect], *, name: str = "") -> Section | None:
    """Which terms the arm has: how many were offered, how many told, and what they do. None where nothing was told.

    Parameters
    ----------
    found : sequence of Effect
    name : str
        Of the model, where there are several.
    """
    kept = [effect for effect in found if effect.determined >= LEAST_DETERMINED]
    if not kept:
        return None
    gone = [effect.group for effect in found if effect.determined < LEAST_DETERMINED]
    table = Table(
        columns=(
            Column("group of terms"),
            Column("offered"),
            Column("determined", digits=2),
            Column("rotation", "arcsec", 2),
            Column("shift", "mm", 2),
            Column("at the tip", "mm", 2),
        ),
        rows=tuple(
            (
                effect.group,
                effect.offered,
                effect.determined,
                None if effect.rotation_rad is None else effect.rotation_rad * ARCSEC,
                effect.shift_mm,
                effect.tip_mm,
            )
            for effect in kept
        ),
        caption="Groups of terms that the readings showed; sizes are root mean squares over the readings of this page",
    )
    n_offered, n_told = sum(effect.offered for effect in found), sum(effect.determined for effect in found)
    text = (
        "A term is a small motion at a place of the arm, shaped by a function of its angles, its weight or its "
        f"temperature. {format_number(n_offered)} coefficients were offered; the readings determined "
        f"{format_number(round(n_told))} of them. Rotation and shift are how large the motions at a place are. The "
        "last column is how far they move the tip, but for what base and tip take up where these are free; groups that "
        "act alike may each move it far and cancel."
    )
    if gone:
        text += f"\n\nNot needed: {'; '.join(gone)}."
    return Section(_titled("What the arm does", name), text, tables=(table,))


def joint_errors_section(
    errors: Mapping[str, Sequence[JointError]],
    angles: npt.ArrayLike,
    names: Sequence[str],
    *,
    styles: Mapping[str, Style] | None = None,
) -> Section | None:
    """The own error of every joint, drawn. None where the readings tell of none.

    Parameters
    ----------
    errors : mapping of str to sequence of JointError
        For each model.
    angles : (n, joints) array
        Of the readings [rad].
    names : sequence of str
        Of the joints.
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    if not any(error.is_significant for found in errors.values() for error in found):
        return None
    return Section(
        "Error of each joint",
        "Encoder and gear turn about the joint's axis together: what is seen here is the error of both. Its mean "
        "belongs to the joint's zero and is left out.",
        figures=(joint_error_figure(errors, angles, names=names, styles=styles),),
    )


def unidentifiable_section(
    left_out: Sequence[tuple[str, str]], untold: Sequence[tuple[Sequence[str], str]], *, name: str = ""
) -> Section | None:
    """What the readings do not tell: constants, and terms that were not offered. None where there is nothing to say.

    Parameters
    ----------
    left_out : sequence of (str, str)
        Terms, each with what the readings lack.
    untold : sequence of (sequence of str, str)
        Constants, alone or in combinations, that the readings left open, each with how much of them is known.
    name : str
        Of the model, where there are several.
    """
    tables = []
    if untold:
        rows = tuple((", ".join(names), known) for names, known in untold)
        tables.append(Table((Column("constants"), Column("known")), rows, "Constants that the readings left open"))
    if left_out:
        rows = tuple((term, f"as {reason}") for term, reason in left_out)
        tables.append(Table((Column("term"), Column("not offered")), rows, "Terms that these readings could not show"))
    if not tables:
        return None
    return Section(
        _titled("What is not determined", name),
        "What is not determined stays near its drawing, held there by what is known of arms beforehand. Where it "
        "matters for a coordinate, that coordinate's uncertainty says so. Of constants known only together a sum is "
        "known: where they move against each other no tip moves, and nothing is lost.",
        tables=tuple(tables),
    )


def outlier_section(found: Mapping[str, Sequence[Outlier]], *, name: str = "") -> Section | None:
    """Readings far off, the farthest first. None where there are none.

    Parameters
    ----------
    found : mapping of str to sequence of Outlier
        Which readings they are among, in words.
    name : str
        Of the model, where there are several.
    """
    if not any(found.values()):
        return None
    tables = tuple(
        Table(
            (Column("reading"), Column("error", "mm", 3), Column("times the usual", digits=2)),
            tuple((far.name, far.error_mm, far.normalized_residual) for far in among[:MOST_NAMED]),
            f"{format_count(len(among), 'reading')} far off among {which}"
            + (f", the {MOST_NAMED} farthest" if len(among) > MOST_NAMED else ""),
        )
        for which, among in found.items()
        if among
    )
    return Section(
        _titled("Readings far off", name),
        "Readings with a residual far beyond the usual weigh less when an arm is identified; none is thrown away. Look "
        "there for a slipped seat, a target that was hidden, a wrong name.",
        tables=tables,
    )


def _titled(title: str, name: str) -> str:
    return f"{title}: {name}" if name else title
