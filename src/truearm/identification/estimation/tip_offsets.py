"""Several tips in an identified arm: where they are on the flange, and the arm of one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.errors import InputError
from truearm.findings import Finding
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.tips import listed_tips
from truearm.identification.terms import Constant, OfTip
from truearm.typing import FloatArray

# Three tips are in a line where the third is nearer to it than this share of their distance.
IN_LINE_SHARE = 0.05
# Tips less apart than this many standard deviations are not distinguished.
COVERAGE = 3.0


def tip_offsets(fit: IdentificationResult, tips: tuple[str, ...]) -> FloatArray:
    """(n_tips, 3) offsets of the tips from the first, along the axes of the flange [mm]."""
    offsets = dict.fromkeys(tips, np.zeros(3))
    for term, columns in zip(fit.perturbed_chain.terms, fit.perturbed_chain.columns, strict=True):
        if isinstance(term.basis, OfTip):
            shift = fit.coefficients[columns[0]] * np.array(term.direction[3:])
            offsets[term.basis.name] = offsets[term.basis.name] + shift
    return np.stack(list(offsets.values())) if offsets else np.zeros((0, 3))


def what_tips_show(fit: IdentificationResult, tips: tuple[str, ...]) -> tuple[Finding, ...]:
    """What several tips determine together; nothing for one."""
    if len(tips) < 2:
        return ()
    offsets = tip_offsets(fit, tips)
    apart = offsets - offsets.mean(axis=0)
    across = np.linalg.svd(apart, compute_uv=False)
    is_plane = len(tips) > 2 and across[1] > IN_LINE_SHARE * across[0]
    farthest = float(np.linalg.norm(offsets[:, None] - offsets, axis=2).max())
    said = f"The model has {len(tips)} tips ({listed_tips(tips)}), "
    if farthest <= COVERAGE * _largest_offset_std(fit):
        said += "in one place within their uncertainty: their points show no rotation of the flange."
    else:
        said += f"up to {farthest:.1f} mm apart. "
        said += (
            "Three of them are not in a line: their points determine the orientation of the flange."
            if is_plane
            else "They are in a line: no point shows a rotation of the flange about it."
        )
    return (Finding("tips", said, {"n": len(tips), "farthest_mm": farthest}),)


def _largest_offset_std(fit: IdentificationResult) -> float:
    """Largest standard deviation of the offset of a tip along a direction of the flange [mm]."""
    variances = fit.covariance.diagonal()[
        fit.columns_of(lambda term: isinstance(term.basis, OfTip) and any(term.direction[3:]))
    ]
    return float(np.sqrt(variances.max(initial=0.0)))


def of_one_tip(fit: IdentificationResult, name: str, tips: tuple[str, ...]) -> IdentificationResult:
    """The result with the offset of one tip as constants; those of the others are integrated out.

    Raises
    ------
    InputError
        If it is none of the tips.
    """
    if name not in tips:
        raise InputError(
            f"expected a tip of the model ({listed_tips(tips)}), got {name!r}"
            if tips
            else f"the model has one tip without a name, got {name!r}",
            hint="tips are named in the column tip of the training session",
        )
    kept = fit.select(lambda term: not isinstance(term.basis, OfTip) or term.basis.name == name)
    terms = (
        replace(term, basis=Constant()) if isinstance(term.basis, OfTip) else term
        for term in kept.perturbed_chain.terms
    )
    return replace(kept, perturbed_chain=PerturbedChain(fit.perturbed_chain.chain, tuple(terms)))
