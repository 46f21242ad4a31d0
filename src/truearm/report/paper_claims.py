"""What the claims of Gao et al. (2017) are worth, in sentences made from the findings, each with a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truearm.report.canvas import Style
from truearm.report.claims import (
    crossings,
    error_against_box,
    error_against_rate,
    error_outside,
    scatter_of_starts,
)
from truearm.report.page import Section
from truearm.report.quantities import format_given
from truearm.report.reproduced import Reproduced
from truearm.report.wording import NotRun, capitalised, counted, degrees, millimetres, rows_named


def learning_rate_section(found: Reproduced, *, styles: Mapping[str, Style]) -> Section | NotRun:
    """Say whether the learning rate matters."""
    title = "The learning rate"
    claim = found.claims.learning_rate
    if claim is None:
        return NotRun("What the learning rate does", "--table 2")
    rates = ", ".join(format_given(rate) for rate in sorted(claim.rates))
    if claim.identical:
        text = (
            f"It has no effect. Trained from one start at the rates {rates}, the network ends with the same mean error "
            f"to the last digit, {millimetres(claim.mean_mm[0])}. A step of the Levenberg-Marquardt method is settled "
            "by its damping; it has no learning rate, and trainlm takes none."
        )
    else:
        text = (
            f"Trained from one start at the rates {rates}, the network ends with mean errors from "
            f"{millimetres(min(claim.mean_mm))} to {millimetres(max(claim.mean_mm))}: not the same."
        )
    published = None
    if claim.paper_mean_mm is not None:
        published = (claim.rates, claim.paper_mean_mm)
        text += (
            f" The paper's rows at these rates differ, from {millimetres(min(claim.paper_mean_mm))} to "
            f"{millimetres(max(claim.paper_mean_mm))}; what else differs from run to run is the random start."
        )
    picture = error_against_rate(claim.rates, claim.mean_mm, published=published, style=styles["faithful"])
    return Section(title, text, figures=(picture,))


def scatter_section(found: Reproduced, *, styles: Mapping[str, Style]) -> Section | NotRun:
    """Set the paper's differences beside the scatter of random starts."""
    title = "The scatter of starts"
    claim = found.claims.scatter
    if claim is None:
        return NotRun("The scatter of starts", "--table 2")
    starts, published = np.array(claim.mean_mm), np.array(claim.paper_rows_mean_mm)
    inside = (published >= starts.min()) & (published <= starts.max())
    names = [None] * len(published) if claim.paper_rows is None else claim.paper_rows
    beyond = [
        millimetres(float(value)) + ("" if name is None else f" (row {name})")
        for value, name, within in zip(published, names, inside, strict=False)
        if not within
    ]
    of_rows = "" if claim.paper_rows is None else f" ({rows_named(claim.paper_rows)})"
    text = (
        f"{claim.what.strip().rstrip('.')}: mean errors from {millimetres(float(starts.min()))} to "
        f"{millimetres(float(starts.max()))}, median {millimetres(float(np.median(starts)))}, and nothing differs but "
        f"the random numbers. The paper's {counted(len(published), 'value')}{of_rows}, from "
        f"{millimetres(float(published.min()))} to {millimetres(float(published.max()))}, are put down to other goals "
        "and learning rates. "
    )
    if not beyond:
        text += "All of them lie within the range of the starts: random numbers alone make such differences."
    elif inside.any():
        text += (
            f"{int(inside.sum())} of them lie within the range of the starts: random numbers alone make such "
            f"differences. Outside it: {', '.join(beyond)}."
        )
    else:
        text += "None of them lies within the range of the starts."
    picture = scatter_of_starts(starts, published, name=claim.what, style=styles["faithful"])
    return Section(title, text, figures=(picture,))


def joint_ranges_section(found: Reproduced, *, styles: Mapping[str, Style]) -> Section:
    """Say how the joint ranges were fixed, and what follows if they are wrong."""
    title = "The joint ranges"
    chosen = found.boxes.simulation_deg
    limits = f"\u00b1{degrees(chosen)} in simulations, \u00b1{degrees(found.boxes.experiment_deg)} in the experiment"
    told = [f"Every joint is drawn evenly from a range about one working pose: {limits}. {found.boxes.how.strip()}"]
    claim = found.claims.boxes
    if claim is None:
        return Section(title, "\n\n".join([*told, str(NotRun("The study of boxes of other widths", "--all"))]))
    networks = {"row 1": (claim.row1_mean_mm, claim.paper_row1), "row 15": (claim.row15_mean_mm, claim.paper_row15)}
    for name, (errors, published) in networks.items():
        met = crossings(claim.half_width_deg, errors, published)
        places = " and ".join(f"\u00b1{degrees(place)}" for place in met)
        told.append(
            f"{capitalised(name)} of Table 2 has the paper's mean error, {millimetres(published)}, "
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


def _if_wrong(widths: Sequence[float], errors: Sequence[float], chosen: float, *, by: float = 5.0) -> str:
    """Tell the error in boxes somewhat narrower and wider, where they lie within what was tried."""
    order = np.argsort(widths)
    x, y = np.array(widths)[order], np.log(np.array(errors)[order])
    told = [
        f"{millimetres(float(np.exp(np.interp(width, x, y))))} at \u00b1{degrees(width)}"
        for width in (chosen - by, chosen, chosen + by)
        if x[0] <= width <= x[-1]
    ]
    return f" The error is {', '.join(told)}." if told else ""


def outside_section(found: Reproduced, *, styles: Mapping[str, Style]) -> Section | NotRun:
    """Say how the direct network fails outside its box."""
    title = "Outside the box"
    claim = found.claims.outside
    if claim is None:
        return NotRun("The error outside the box", "--table 4")
    order = np.argsort(claim.distance_deg)
    distance, median = np.array(claim.distance_deg)[order], np.array(claim.median_mm)[order]
    kinematic = np.array(claim.kinematic_mm)[order]
    worse = (
        [float(distance[0]), *crossings(distance, median, claim.nominal_mm)] if median[-1] > claim.nominal_mm else []
    )
    text = (
        "A direct network knows only the joint angles it was taught; beyond them it guesses. The median of its errors "
        f"is {millimetres(float(median[0]))} at {degrees(float(distance[0]))} outside the box and "
        f"{millimetres(float(median[-1]))} at {degrees(float(distance[-1]))}. "
    )
    text += (
        f"From {degrees(worse[-1])} on it errs by more than the uncompensated nominal arm, "
        f"{millimetres(claim.nominal_mm)} on average. "
        if worse
        else f"The uncompensated nominal arm errs by {millimetres(claim.nominal_mm)} on average. "
    )
    text += (
        f"A kinematic model identified from the same readings goes from {millimetres(float(kinematic[0]))} to "
        f"{millimetres(float(kinematic[-1]))}."
    )
    picture = error_outside(
        claim.distance_deg,
        (claim.median_mm, claim.p95_mm),
        {"nominal": [claim.nominal_mm] * len(claim.distance_deg), "kinematic": claim.kinematic_mm},
        styles=styles,
    )
    return Section(title, text, figures=(picture,))
