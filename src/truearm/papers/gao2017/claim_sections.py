"""What the claims of Gao et al. (2017) are worth, in sentences made from the findings, each with a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truearm.pages.number_format import (
    capitalize,
    format_count,
    format_exact,
    format_in_text,
    format_mm,
    format_percent,
)
from truearm.pages.page import Section
from truearm.pages.plotting import Style
from truearm.papers.gao2017.claim_figures import (
    crossings,
    error_against_box,
    error_against_rate,
    error_outside,
    scatter_of_starts,
)
from truearm.papers.gao2017.phrases import USED_TO_FIX_BOX, MissingPart, format_degrees, format_row_numbers
from truearm.papers.gao2017.reproduction_file import ReproductionResult, TableRow


def learning_rate_section(found: ReproductionResult, *, styles: Mapping[str, Style]) -> Section | MissingPart:
    """Say that there is no learning rate."""
    claim = found.claims.learning_rate
    if claim is None:
        return MissingPart("What the learning rate does", "--table 2")
    rates = ", ".join(format_exact(rate) for rate in sorted(claim.rates))
    text = (
        "It has no effect, because there is none: a step of the Levenberg-Marquardt method is settled by its "
        f"damping, and trainlm takes no learning rate. The paper's {format_row_numbers(claim.rows)}, with the rates {rates}, "
        f"are one training. Here it ends with a mean error of {format_mm(claim.mean_mm)}, the median of its starts; "
        f"the paper's values go from {format_mm(min(claim.paper_mean_mm))} to "
        f"{format_mm(max(claim.paper_mean_mm))}."
    )
    picture = error_against_rate(claim.rates, claim.paper_mean_mm, claim.mean_mm, style=styles["faithful"])
    return Section("The learning rate", text, figures=(picture,))


def scatter_section(found: ReproductionResult, *, styles: Mapping[str, Style]) -> Section | MissingPart:
    """Set the spread of the paper's values beside that of random starts."""
    claim = found.claims.scatter
    if claim is None:
        return MissingPart("The scatter of starts", "--table 2")
    starts, many, published = claim.mean_mm, claim.mean_many_mm, claim.paper_rows_mean_mm
    text = (
        f"{claim.what.strip().rstrip('.')}: mean errors from {format_mm(min(starts))} to "
        f"{format_mm(max(starts))}, and nothing differs but the random numbers. From the least to the largest is "
        f"{format_percent(claim.relative_spread)} of the median. The paper's {format_count(len(published), 'value')} "
        f"({format_row_numbers(claim.paper_rows)}), from {format_mm(min(published))} to {format_mm(max(published))}, are "
        f"put down to other goals and learning rates; they spread over {format_percent(claim.paper_relative_spread)} of "
        "theirs. Only the spreads are compared: the level depends on the box. On 2000 poses the same starts go from "
        f"{format_mm(min(many))} to {format_mm(max(many))}; the rest is the choice of ten test poses."
    )
    picture = scatter_of_starts(starts, published, name=claim.what, style=styles["faithful"])
    return Section("The scatter of starts", text, figures=(picture,))


def joint_ranges_section(found: ReproductionResult, *, styles: Mapping[str, Style]) -> Section:
    """Say how the joint ranges were fixed, and what follows if they are wrong."""
    title = "The joint ranges"
    chosen = found.boxes.simulation_deg
    limits = f"\u00b1{format_degrees(chosen)} in simulations, \u00b1{format_degrees(found.boxes.experiment_deg)} in the experiment"
    told = [f"Every joint is drawn evenly from a range about one working pose: {limits}. {found.boxes.how.strip()}"]
    told += _what_remains(found.rows_by_table().get(2, []))
    claim = found.claims.boxes
    if claim is None:
        return Section(title, "\n\n".join([*told, str(MissingPart("The study of boxes of other widths", "--all"))]))
    networks = {"row 1": (claim.row1_mean_mm, claim.paper_row1), "row 15": (claim.row15_mean_mm, claim.paper_row15)}
    for name, (errors, published) in networks.items():
        met = crossings(claim.half_width_deg, errors, published)
        places = " and ".join(f"\u00b1{format_degrees(place)}" for place in met)
        told.append(
            f"{capitalize(name)} of Table 2 has the paper's mean error, {format_mm(published)}, "
            + (f"in a box of {places}." if met else "in none of the boxes tried.")
            + _if_wrong(claim.half_width_deg, errors, chosen)
        )
    picture = error_against_box(
        claim.half_width_deg,
        {name: errors for name, (errors, _) in networks.items()},
        {name: published for name, (_, published) in networks.items()},
        chosen=chosen,
        styles=styles,
    )
    return Section(title, "\n\n".join(told), figures=(picture,))


def _what_remains(rows: Sequence[TableRow]) -> list[str]:
    """Tell how well the rows that fixed the box agree with it."""
    fixed = [row.ratio["faithful"] for row in rows if row.verdict == USED_TO_FIX_BOX]
    ratios = [ratio for ratio in fixed if ratio]
    if not ratios:
        return []
    mean = format_in_text(float(np.exp(np.mean(np.log(ratios)))))
    told = (
        f"What remains: in this run the {format_count(len(ratios), 'row')} of Table 2 that fixed it err, faithful, by "
        f"{format_in_text(min(ratios))} to {format_in_text(max(ratios))} times the paper's average, {mean} times in "
        "the geometric mean."
    )
    return [told]


def _if_wrong(widths: Sequence[float], errors: Sequence[float], chosen: float, *, by: float = 5.0) -> str:
    """Tell the error in boxes somewhat narrower and wider, where they lie within what was tried."""
    order = np.argsort(widths)
    x, y = np.array(widths)[order], np.log(np.array(errors)[order])
    told = [
        f"{format_mm(float(np.exp(np.interp(width, x, y))))} at \u00b1{format_degrees(width)}"
        for width in (chosen - by, chosen, chosen + by)
        if x[0] <= width <= x[-1]
    ]
    return f" The error is {', '.join(told)}." if told else ""


def outside_section(found: ReproductionResult, *, styles: Mapping[str, Style]) -> Section | MissingPart:
    """Say how the direct network fails outside its box."""
    title = "Outside the box"
    claim = found.claims.outside
    if claim is None:
        return MissingPart("The error outside the box", "--table 4")
    order = np.argsort(claim.distance_deg)
    distance = np.array(claim.distance_deg)[order]
    lm, nominal, kinematic = (
        np.array(values)[order] for values in (claim.lm_median_mm, claim.nominal_median_mm, claim.kinematic_median_mm)
    )
    worse = [float(distance[0]), *crossings(distance, lm / nominal, 1.0)] if lm[-1] > nominal[-1] else []
    text = (
        "A direct network knows only the joint angles it was taught; beyond them it guesses. With the farthest joint "
        f"{format_degrees(float(distance[0]))} beyond the box the median of the errors of lm is {format_mm(float(lm[0]))}, "
        f"with it {format_degrees(float(distance[-1]))} beyond {format_mm(float(lm[-1]))}; of the uncompensated nominal "
        f"arm {format_mm(float(nominal[0]))} and {format_mm(float(nominal[-1]))}; of a kinematic model identified "
        f"from the same readings {format_mm(float(kinematic[0]))} and {format_mm(float(kinematic[-1]))}."
        + (f" From {format_degrees(worse[-1])} on lm errs by more than the nominal arm." if worse else "")
    )
    picture = error_outside(
        claim.distance_deg,
        (claim.lm_median_mm, claim.lm_p95_mm),
        {"nominal": claim.nominal_median_mm, "kinematic": claim.kinematic_median_mm},
        styles=styles,
    )
    return Section(title, text, figures=(picture,))
