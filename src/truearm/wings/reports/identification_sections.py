"""Sections of a page about an identified arm: uncertainty, outliers, joint errors; then terms and identifiability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import FixedLocator, MaxNLocator

from truearm.identification.estimation.diagnostics import identifiability
from truearm.identification.judgement.held_out_errors import HeldOutErrors
from truearm.identification.judgement.outliers import Outlier, outliers
from truearm.models import Compensator, IdentifiedModel
from truearm.models.identified_model import to_identified
from truearm.models.uncertainty import UncertaintyBudget, uncertainty_budget
from truearm.number_format import format_count, format_number, format_percent, format_uncertainty
from truearm.pages.drawings.joint_figures import joint_matrix, joint_names
from truearm.pages.page import Column, LabelledValue, Section, Table
from truearm.pages.palette import LIMIT
from truearm.pages.plotting import (
    Figure,
    Style,
    figure_style,
    join_phrases,
    make_panel,
    set_log_scale,
    shorten,
    styles_of,
)
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.reports.term_effects import Effect, JointError, effects, joint_error

# Groups with fewer determined coefficients count as pruned.
LEAST_DETERMINED = 0.5
MOST_NAMED = 20
# Points of the curve of a joint for each wave of the highest order.
POINTS_PER_WAVE = 10
_LEVEL = format_percent(UncertaintyBudget.level)


Budgets = Mapping[str, tuple[UncertaintyBudget, tuple[Outlier, ...]]]


def identified_budgets(models: Mapping[str, Compensator], session: Session) -> Budgets:
    """Uncertainty budget, and readings that contradict it, of every identified model among some models of one arm."""
    return {name: uncertainty_budget(model, session) for name, model in _identified(models).items()}


def identification_sections(
    models: Mapping[str, Compensator], session: Session, budgets: Budgets | None = None
) -> list[Section]:
    """Sections about the identified models among some models of one arm; none for the others.

    Parameters
    ----------
    models : mapping of str to Compensator
        By their names on the page.
    session : Session
        The readings of the page.
    budgets : mapping, optional
        From `identified_budgets`, if they are there already.
    """
    identified = _identified(models)
    budgets = identified_budgets(models, session) if budgets is None else budgets
    titles = {name: name if len(identified) > 1 else "" for name in identified}
    uncertainty, unidentifiable, outlying = [], [], []
    terms: list[Section | None] = []
    for name, model in identified.items():
        budget, on_page = budgets[name]
        groups = identifiability(model.fit_).unidentifiable
        uncertainty.append(uncertainty_section(budget, model.held_out_errors_, name=titles[name]))
        if (process := model.residual_process_) is not None:
            terms.append(Section(_titled("Residual process", titles[name]), str(process)))
        terms.append(terms_section(effects(model.fit_, model.state(session)), name=titles[name]))
        unidentifiable.append(
            unidentifiable_section(
                model.excluded_terms_, [(one.constants, one.status) for one in groups], name=titles[name]
            )
        )
        outlying.append(outlier_section(_outliers(model, session, on_page), name=titles[name]))
    joint_errors = joint_errors_section(
        {name: _joint_errors(model, session) for name, model in identified.items()},
        session.angles,
        next(iter(models.values())).arm.joint_names,
        styles=styles_of(["nominal", *(n for n, model in models.items() if model.kind != "nominal")]),
    )
    sections = [*uncertainty, *terms, joint_errors, *unidentifiable, *outlying]
    return [section for section in sections if section is not None]


def _identified(models: Mapping[str, Compensator]) -> dict[str, IdentifiedModel]:
    return {
        name: identified
        for name, model in models.items()
        if (identified := to_identified(model)) is not None and model.kind != "nominal"
    }


def uncertainty_section(budget: UncertaintyBudget, held_out: HeldOutErrors | None, *, name: str = "") -> Section:
    """The uncertainty budget of a coordinate (JCGM 100), and the errors of the readings held out.

    Parameters
    ----------
    budget : UncertaintyBudget
    held_out : HeldOutErrors, optional
        None where no readings could be held out.
    name : str
        Of the model, where there are several.
    """
    expanded = f"U = {format_uncertainty(budget.expanded_mm)} mm (k = {budget.coverage_factor:g})"
    text = (
        f"The expanded uncertainty of a coordinate is {expanded}: the combined standard uncertainty times the coverage "
        f"factor k = {budget.coverage_factor:g}, for a coverage probability of about {_LEVEL} where errors are "
        "normally distributed (JCGM 100:2008, 6.3.3). A point in space lies with that probability in an ellipsoid "
        f"whose half axes are {budget.ellipsoid_factor:.2f} standard uncertainties long.\n\n"
        "The uncertainty of the arm's parameters causes the same error in the same pose every time: it cancels between "
        "neighbouring points, and it grows outside the measured range. The residual part is noise and effects that the "
        "model has no term for; it is estimated from readings held out, so that ellipsoids have the stated coverage. "
        "Values are root mean squares over the readings of this page."
    )
    if budget.is_relative:
        text += (
            "\n\nAn arm that was identified from seats has its own frame, whose place is arbitrary. The uncertainties "
            "are those of coordinates relative to each other, after a frame was fitted to the points of this page."
        )
    if budget.n_points:
        share = budget.n_covered / budget.n_points
        text += (
            f"\n\nCoverage: {format_percent(share)} of the {format_count(budget.n_points, 'reading')} of this page lie "
            f"in their {_LEVEL} ellipsoids, which include the reference's own uncertainty where it is stated."
        )
    rows = [
        LabelledValue("standard uncertainty of a coordinate from the arm's parameters", budget.of_parameters_mm, "mm"),
        LabelledValue("standard uncertainty of a coordinate, residual", budget.unexplained_mm, "mm"),
        LabelledValue("combined standard uncertainty u of a coordinate", budget.combined_mm, "mm"),
        LabelledValue("largest combined standard uncertainty on this page", budget.largest_mm, "mm"),
        LabelledValue(
            f"expanded uncertainty U of a coordinate, k = {budget.coverage_factor:g}", budget.expanded_mm, "mm"
        ),
        LabelledValue(
            f"half axis of a point's {_LEVEL} ellipsoid, {budget.ellipsoid_factor:.2f} u", budget.ellipsoid_mm, "mm"
        ),
    ]
    if held_out is not None:
        held = f"{format_count(held_out.n, 'reading')} held out in {format_count(held_out.n_groups, 'group')}"
        if held_out.n_excluded:
            held += f", without {format_count(held_out.n_excluded, 'gross error')}"
        known = held_out.standard_error_mm if np.isfinite(held_out.standard_error_mm) else None
        rows += [
            LabelledValue(f"mean error of {held}", held_out.mean_mm, "mm", known),
            LabelledValue(f"{_LEVEL} of these errors below", held_out.p95_mm, "mm"),
            LabelledValue("largest of these errors", held_out.max_mm, "mm"),
        ]
    return Section(_titled("Uncertainty", name), text, rows=tuple(rows), folded=True)


def terms_section(found: Sequence[Effect], *, name: str = "") -> Section | None:
    """Terms of the arm: offered and determined coefficients, and their size. None where none was determined.

    Parameters
    ----------
    found : sequence of Effect
    name : str
        Of the model, where there are several.
    """
    kept = [effect for effect in found if effect.determined >= LEAST_DETERMINED]
    if not kept:
        return None
    pruned = [effect.group for effect in found if effect.determined < LEAST_DETERMINED]
    table = Table(
        columns=Column.of(
            "group of terms",
            "offered",
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
        caption="Groups of terms that the readings determined; root mean squares over the readings of this page",
    )
    n_offered, n_determined = sum(effect.offered for effect in found), sum(effect.determined for effect in found)
    text = (
        f"The readings determined {format_number(round(n_determined))} of {format_number(n_offered)} coefficients. A "
        "term is a small motion at a place of the arm, as a function of joint angles, weight or temperature. Rotation "
        "and shift are the size of the motions at their places. The last column is the motion of the tip, without the "
        "part that a free base and tip absorb; groups with similar effects may cancel each other."
    )
    if pruned:
        text += f"\n\nOffered and pruned: {'; '.join(pruned)}."
    return Section(_titled("Terms of the arm", name), text, tables=(table,), folded=True)


def joint_errors_section(
    errors: Mapping[str, Sequence[JointError]],
    angles: npt.ArrayLike,
    names: Sequence[str],
    *,
    styles: Mapping[str, Style] | None = None,
) -> Section | None:
    """Figures of every joint's own error. None where no joint has a significant one.

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
        "Encoder and gear turn about the same axis, so the figures show the sum of their errors. Its mean is part of "
        "the joint offset and not shown.",
        figures=(joint_error_figure(errors, angles, names=names, styles=styles),),
        folded=True,
    )


def unidentifiable_section(
    excluded: Sequence[tuple[str, str]], unidentifiable: Sequence[tuple[Sequence[str], str]], *, name: str = ""
) -> Section | None:
    """Constants that are not identifiable from the readings, and terms that were not offered. None without any.

    Parameters
    ----------
    excluded : sequence of (str, str)
        Terms, each with the reason.
    unidentifiable : sequence of (sequence of str, str)
        Constants, alone or in combinations, that are not identifiable, each with how much of them is known.
    name : str
        Of the model, where there are several.
    """
    tables = []
    if unidentifiable:
        rows = tuple((", ".join(names), known) for names, known in unidentifiable)
        tables.append(Table(Column.of("constants", "known"), rows, "Constants that are not identifiable"))
    if excluded:
        rows = tuple((term, reason) for term, reason in excluded)
        tables.append(Table(Column.of("term", "reason"), rows, "Terms that were not offered"))
    if not tables:
        return None
    return Section(
        _titled("Not identifiable from these readings", name),
        "These parameters stay near their nominal values, by their prior. Where that matters for a coordinate, its "
        "uncertainty includes it. Some constants are identifiable only as a sum. How the sum is split does not "
        "affect the tip position.",
        tables=tuple(tables),
        folded=True,
    )


def outlier_section(found: Mapping[str, Sequence[Outlier]], *, name: str = "") -> Section | None:
    """Outliers, the largest first. None where there are none.

    Parameters
    ----------
    found : mapping of str to sequence of Outlier
        By the readings they are among, in words.
    name : str
        Of the model, where there are several.
    """
    if not any(found.values()):
        return None
    tables = tuple(
        Table(
            (Column("reading"), Column("error", "mm", 3), Column("normalized residual", digits=2)),
            tuple(
                (far.name + ", excluded" * far.is_excluded, far.error_mm, far.normalized_residual)
                for far in among[:MOST_NAMED]
            ),
            f"{format_count(len(among), 'outlier')} among {which}"
            + (f", the {MOST_NAMED} largest" if len(among) > MOST_NAMED else ""),
        )
        for which, among in found.items()
        if among
    )
    return Section(
        _titled("Outliers", name),
        "Check these readings for a ball that was not seated, a hidden target or a wrong name. Outliers have a smaller "
        "weight in the identification; excluded readings are gross errors and took no part in it.",
        tables=tables,
        folded=True,
    )


def _joint_errors(model: IdentifiedModel, session: Session) -> list[JointError]:
    """The own errors of the rotary joints over the trained range."""
    found = []
    for joint in (np.flatnonzero(~model.arm.chain.is_prismatic) + 1).tolist():
        angles = session.angles[:, joint - 1]
        highest = joint_error(model.fit_, joint, angles[:1], mean_at=angles[:1]).orders.max(initial=1)
        low, high = model.angle_ranges_[joint - 1]
        n_points = max(int(POINTS_PER_WAVE * highest * (high - low) / (2 * np.pi)), 100)
        found.append(joint_error(model.fit_, joint, np.linspace(low, high, n_points), mean_at=angles))
    return found


def _outliers(model: IdentifiedModel, session: Session, on_page: Sequence[Outlier]) -> dict[str, Sequence[Outlier]]:
    """Outliers among the training readings and, where these are others, among the readings of the page."""
    training = outliers(model.fit_)
    if model.is_trained_on(session):
        return {"the training readings": [outlier.located(session) for outlier in training]}
    return {"the training readings": training, "the readings of this page": [one.located(session) for one in on_page]}


def _titled(title: str, name: str) -> str:
    return f"{title}: {name}" if name else title


ARCSEC = float(np.degrees(1.0) * 3600)  # of a radian
COVERAGE_FACTOR = 1.96  # 95 % of a normal distribution
_LABELLED = 3  # orders with the best known amplitudes
_SMALLEST = 0.003  # smallest amplitude that is drawn, as a share of the largest


def joint_error_figure(
    errors: Mapping[str, Sequence[JointError]],
    angles: npt.ArrayLike,
    *,
    names: Sequence[str] | None = None,
    styles: Mapping[str, Style] | None = None,
) -> Figure:
    """Draw the own errors of joints, two panels per joint: against its angle, and by order.

    Parameters
    ----------
    errors : mapping of str to sequence of JointError
        For each model, at least one of them significant; joints without a significant error are not drawn.
    angles : (n, joints) array
        Joint angles of the readings, to show their distribution [rad].
    names : sequence of str, optional
        Of the joints; J1, J2, ... by default.
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    read = joint_matrix(angles)
    names = joint_names(names, read.shape[1])
    by_joint: dict[int, dict[str, JointError]] = {}
    for model, found in errors.items():
        for error in found:
            if any(other.is_significant for every in errors.values() for other in every if other.joint == error.joint):
                by_joint.setdefault(error.joint, {})[model] = error
    pens = styles_of(errors, styles)
    several = len(errors) > 1
    with figure_style():
        panels = tuple(
            drawing
            for joint in sorted(by_joint)
            for drawing in (
                _curves(by_joint[joint], pens, read[:, joint - 1], names[joint - 1], named=several),
                _spectra(by_joint[joint], pens, names[joint - 1]),
            )
        )
    sizes = [
        f"{shorten(names[joint - 1])} "
        + ", ".join(
            f"{_rms(error)} arcsec{f' ({shorten(model)})' if several else ''}" for model, error in found.items()
        )
        for joint, found in sorted(by_joint.items())
    ]
    none = [shorten(name) for joint, name in enumerate(names, 1) if joint not in by_joint]
    without = f" {', '.join(none)}: no error larger than its uncertainty." if none else ""
    return Figure(
        panels,
        caption="Rotation of each joint minus the encoder's reading, against the joint angle and by order (periods in "
        f"a full turn{'' if several else '; the best known are labelled'}). Bands and whiskers are 95 % intervals. The "
        "grey area shows where the readings were; the band widens outside. 10 arcsec move a point 1 m away by "
        "0.048 mm. Where a joint did not make a full turn, neighbouring orders are not identifiable one by one: the "
        "curve is known better than its orders." + without,
        alt=f"Error of {len(by_joint)} joints about their own axes against their angles, and its amplitude by order. "
        f"Root mean square: {join_phrases(sizes, most=8)}.",
        columns=2,
    )


def _rms(error: JointError) -> str:
    return format_number(error.rms * ARCSEC, digits=2)


def _curves(
    errors: Mapping[str, JointError], pens: Mapping[str, Style], read: FloatArray, name: str, *, named: bool
) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 2.0)
    largest = max(float(np.abs(error.error).max()) for error in errors.values()) * ARCSEC or 1e-6
    for model, error in errors.items():
        pen, at, middle = pens[model], np.degrees(error.angles), error.error * ARCSEC
        half = COVERAGE_FACTOR * error.std * ARCSEC
        axes.fill_between(at, middle - half, middle + half, color=pen.colour, alpha=0.22, linewidth=0)
        axes.plot(at, middle, color=pen.colour, linestyle=pen.dash, linewidth=1.0)
    axes.set_xlim(
        min(float(np.degrees(error.angles.min())) for error in errors.values()),
        max(float(np.degrees(error.angles.max())) for error in errors.values()),
    )
    axes.set_ylim(-1.5 * largest, 1.25 * largest)
    _histogram(axes, np.degrees(read))
    axes.axhline(0, color=LIMIT, linewidth=0.6, zorder=1)
    sizes = [f"{_rms(error)}{f' ({shorten(model)})' if named else ''}" for model, error in errors.items()]
    axes.set_title(f"{shorten(name, longest=14)}: {', '.join(sizes)} arcsec rms")
    axes.set(xlabel="joint angle [deg]", ylabel="error [arcsec]")
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 1.5, 3, 4.5, 6, 9, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    return drawing


def _histogram(axes: Axes, read: FloatArray) -> None:
    """Draw the distribution of the readings, as a low histogram on the lower edge."""
    left, right = axes.get_xlim()
    counts, edges = np.histogram(read, np.linspace(left, right, 121))
    if counts.any():
        low, high = axes.get_ylim()
        height = 0.12 * (high - low) * np.sqrt(counts / counts.max())
        axes.stairs(low + height, edges, baseline=low, fill=True, color=LIMIT, alpha=0.55, zorder=2, linewidth=0)


def _spectra(errors: Mapping[str, JointError], pens: Mapping[str, Style], name: str) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 2.0)
    highest = max(float(error.amplitudes.max(initial=0.0)) for error in errors.values()) * ARCSEC or 1e-6
    floor = _SMALLEST * highest
    tops = [highest]
    for i, (model, error) in enumerate(errors.items()):
        at = error.orders * 1.015 ** (i - (len(errors) - 1) / 2)  # side by side
        high, half = error.amplitudes * ARCSEC, COVERAGE_FACTOR * error.amplitudes_std * ARCSEC
        seen = high > floor
        axes.vlines(at, np.maximum(high - half, floor), high + half, color=pens[model].colour, linewidth=0.6, alpha=0.4)
        axes.scatter(at[seen], high[seen], s=5, color=pens[model].colour, linewidths=0, zorder=3)
        tops += (high + half).tolist()
        for order in _best_known(error) if len(errors) == 1 else ():
            label = str(error.orders[order])
            place = (float(at[order]), float(high[order] + half[order]))
            axes.annotate(label, place, xytext=(0, 2), textcoords="offset points", ha="center", fontsize=7.5)
    set_log_scale(axes, "x", 0.85, 1.18 * max(int(error.orders.max(initial=2)) for error in errors.values()))
    axes.xaxis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, 50, 100, 200, 500]))
    set_log_scale(axes, "y", floor, 1.6 * max(tops))
    axes.set_title(f"{shorten(name, longest=14)} by order")
    axes.set(xlabel="order: periods in a full turn", ylabel="amplitude [arcsec]")
    return drawing


def _best_known(error: JointError) -> list[int]:
    """Rows of the best known amplitudes, none beside another: there is no room for two labels."""
    chosen: list[int] = []
    for i in np.argsort(-error.amplitudes / np.maximum(error.amplitudes_std, 1e-12), kind="stable").tolist():
        apart = all(abs(np.log(error.orders[i] / error.orders[j])) > 0.2 for j in chosen)
        if len(chosen) < _LABELLED and apart and error.amplitudes[i] > COVERAGE_FACTOR * error.amplitudes_std[i]:
            chosen.append(i)
    return chosen
