"""Several tips on one flange: each has an offset of its own, all of them one arm.

The readings name their tip in the column `tip`. The tip named first takes the place of the arm file's tip; the others
have three more constants each, their offset from the first along the axes of the flange, with the prior of a free tip.
A model of several tips predicts for a named tip; `with_tip` makes it the model of one of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import Constant, OfTip, Term, constants
from truearm.readings.session import Session
from truearm.typing import FloatArray

GROUP = "further tips"
# Three tips are in a line where the third is nearer to it than this share of their distance.
IN_LINE_SHARE = 0.05
# Tips less apart than this many standard deviations are not distinguished.
COVERAGE = 3.0


def tip_names(readings: Session) -> tuple[str, ...]:
    """Names of the tips of a session in the order of its readings; empty if none is named."""
    return () if readings.tip is None else tuple(dict.fromkeys(readings.tip.tolist()))


def further_tip_terms(chain: Chain, tips: tuple[str, ...]) -> list[Term]:
    """Offsets of every tip but the first from the first, with the prior of a free tip."""
    place = chain.n_places - 1
    free = [term for term in constants(chain, free=("tip",), angle_std=0.0, length_std=0.0) if term.place == place]
    return [
        replace(term, name=f"{term.name}, tip {name}", basis=OfTip(name), group=GROUP)
        for name in tips[1:]
        for term in free
    ]


def free_tips(readings: Session, free: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the tips of a session, of which several must be unknown.

    Raises
    ------
    InputError
        If the tip is known: that of the arm file is only one.
    """
    tips = tip_names(readings)
    if len(tips) > 1 and "tip" not in free:
        raise readings.error(
            f"the readings have {len(tips)} tips, and a fit with a known tip has one",
            column="tip",
            hint="let the tip be free (--free base,tip), or fit the readings of one tip",
        )
    return tips


def check_tips(tips: tuple[str, ...], readings: Session) -> None:
    """Check that a model of these tips can predict the readings of a session.

    Raises
    ------
    InputError
        If the model has several and the session names none, or a name is unknown.
    """
    if readings.tip is None:
        if len(tips) > 1:
            raise readings.error(
                f"the model has {len(tips)} tips ({_listed(tips)}), and the readings name none",
                column=None if readings.file is None else "tip",
                hint=f"add the column tip; or choose one of them: model.with_tip({tips[0]!r}) in Python",
            )
        return
    known = tips or tip_names(readings)[:1]  # a model without a name has one tip
    unknown = ~np.isin(readings.tip, known)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise readings.error(
            f"expected a tip of the model ({_listed(tips)}), got {str(readings.tip[row])!r}"
            if tips
            else f"expected one tip, as the model has, got {str(readings.tip[row])!r} beside {known[0]!r}",
            row,
            column="tip",
            hint="correct the name; for a new tip fit again, or refit the model of one tip with --free tip",
        )


def tip_offsets(fit: IdentificationResult, tips: tuple[str, ...]) -> FloatArray:
    """(n_tips, 3) offsets of the tips from the first, along the axes of the flange [mm]."""
    offsets = dict.fromkeys(tips, np.zeros(3))
    start = 0
    for term in fit.perturbed_chain.terms:
        if isinstance(term.basis, OfTip):
            offsets[term.basis.name] = offsets[term.basis.name] + fit.coefficients[start] * np.array(term.direction[3:])
        start += term.n_coefficients
    return np.stack(list(offsets.values())) if offsets else np.zeros((0, 3))


def describe_tips(fit: IdentificationResult, tips: tuple[str, ...]) -> str | None:
    """What several tips determine together; None for one."""
    if len(tips) < 2:
        return None
    offsets = tip_offsets(fit, tips)
    apart = offsets - offsets.mean(axis=0)
    across = np.linalg.svd(apart, compute_uv=False)
    is_plane = len(tips) > 2 and across[1] > IN_LINE_SHARE * across[0]
    farthest = float(np.linalg.norm(offsets[:, None] - offsets, axis=2).max())
    if farthest <= COVERAGE * _largest_offset_std(fit):
        return (
            f"The model has {len(tips)} tips ({_listed(tips)}), in one place within their uncertainty: their points "
            "show no rotation of the flange."
        )
    shown = (
        "Three of them are not in a line: their points determine the orientation of the flange."
        if is_plane
        else "They are in a line: no point shows a rotation of the flange about it."
    )
    return f"The model has {len(tips)} tips ({_listed(tips)}), up to {farthest:.1f} mm apart. {shown}"


def _largest_offset_std(fit: IdentificationResult) -> float:
    """Largest standard deviation of the offset of a tip along a direction of the flange [mm]."""
    terms = fit.perturbed_chain.terms
    stops = np.cumsum([term.n_coefficients for term in terms]).tolist()
    columns = [stop - 1 for term, stop in zip(terms, stops, strict=True) if isinstance(term.basis, OfTip)]
    return float(np.sqrt(fit.covariance.diagonal()[columns].max(initial=0.0)))


def of_one_tip(fit: IdentificationResult, name: str, tips: tuple[str, ...]) -> IdentificationResult:
    """The result with the offset of one tip as constants; those of the others are integrated out.

    Raises
    ------
    InputError
        If it is none of the tips.
    """
    if name not in tips:
        raise InputError(
            f"expected a tip of the model ({_listed(tips)}), got {name!r}"
            if tips
            else f"the model has one tip without a name, got {name!r}",
            hint="tips are named in the column tip of the training session",
        )
    terms: list[Term] = []
    kept: list[int] = []
    start = 0
    for term in fit.perturbed_chain.terms:
        columns = range(start, start + term.n_coefficients)
        start = columns.stop
        if isinstance(term.basis, OfTip):
            if term.basis.name != name:
                continue
            term = replace(term, basis=Constant())
        terms.append(term)
        kept += columns
    return replace(
        fit,
        perturbed_chain=PerturbedChain(fit.perturbed_chain.chain, tuple(terms)),
        coefficients=fit.coefficients[kept],
        covariance=fit.covariance[np.ix_(kept, kept)],
        prior_std=fit.prior_std[kept],
    )


def _listed(tips: tuple[str, ...], most: int = 6) -> str:
    return ", ".join(tips[:most]) + (f" and {len(tips) - most} more" if len(tips) > most else "")
