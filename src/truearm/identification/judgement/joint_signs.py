"""Whether readings show the sign of a joint whose axis passes through the tip or near it.

Such a joint hardly moves the tip, so that an arm with its angle q reversed may explain the readings as well, with
constants that differ a little. The two are compared by the restricted likelihood of the residuals that the constants do
not affect, each with its own noise, as equally likely before. Unless the stated sign is clearly the better one, what
lies between the two enters the uncertainty and is not corrected: with probability p the constants differ by their
change, and the tip, at r from the axis in the frame of the joint, is at ``Rot(-2 q) r``. That is one cause of second
moment p. It hardly moves the tip where readings are, and by up to 2 r elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.special import expit

from truearm.findings import Finding
from truearm.identification.estimation.identification import linearised_about, select_evenly
from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.structure import Contrasts, contrasts
from truearm.identification.references.references import Reference
from truearm.identification.terms import ArmState, Expression, Formula, Term
from truearm.identification.terms.catalogue import LENGTH_STD, relative_size
from truearm.typing import FloatArray

GROUP, ALONG = "signs of joints, not learned", ", along the offset"
# Joints that move by less stand still, and need no sign [rad].
LEAST_TURN = np.radians(1.0)
# Root mean square by which a reversed sign moves the tip, in multiples of the usual error of a length, beyond which
# constants do not take it up: the nominal arm then misses the readings.
MOST_MOTION = 3.0
# Residuals that count as independent: what a model lacks depends on the pose, and does not average away. By all 280 of
# a Barrett WAM, whose cables stretch, the wrong sign of J7 would have odds of 1800 to 1; by these 15 to 1.
MOST_INDEPENDENT = 100
# Readings by which the offset of the tip is judged.
FEW = 1000
# Standard deviation of the noise; no arm repeats better [mm].
LEAST_NOISE_MM = 1e-3
# Odds of the reversed sign from which it is in the uncertainty, and the highest that are stated.
LEAST_ODDS, MOST_ODDS = 1 / 20, 1000.0


class UnshownSign(NamedTuple):
    """A joint that may be reversed: the changes of the coefficients of a fit by term, and the terms beside them."""

    changes: dict[Term, FloatArray]
    terms: tuple[Term, Term]


def unshown_signs(
    fit: IdentificationResult,
    state: ArmState,
    references: Sequence[Reference],
    constants: Sequence[Term],
    rigid: IdentificationResult | None = None,
) -> list[UnshownSign]:
    """The joints of which the readings do not show the sign, and whose sign moves the tip by more than they scatter.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of the readings.
    references : sequence of Reference
        Those of the identification.
    constants : sequence of Term
        All constants of the arm, with those of the free parts.
    rigid : IdentificationResult, optional
        The arm with its constants alone, where `fit` has harmonics: of such a joint they take up its wrong sign.
    """
    most = MOST_MOTION * LENGTH_STD * relative_size(fit.chain)
    some = state.rows(select_evenly(np.arange(len(state)), min(FEW, len(state))))
    offsets = _offsets(fit, some)
    left = cache(lambda arm, at: contrasts(arm, at, references, constants, []))
    judges = [(fit, LEAST_ODDS), *([] if rigid is None else [(rigid, 1 / LEAST_ODDS)])]
    n_constants = sum(term.n_coefficients for term in constants)
    found = []
    for joint in np.flatnonzero(~state.chain.is_prismatic).tolist():
        angles = some.joint_angles[:, joint]
        moved = 2 * np.sin(angles - angles.mean())[:, None] * offsets[:, joint]
        if np.ptp(angles) < LEAST_TURN or np.sqrt((moved**2).sum(axis=1).mean()) > most:
            continue
        turned = _reversed(state, joint)
        for judge, least in judges:
            other = left(judge, turned)
            if _is_surely_less(judge, other, n_constants, least):
                continue
            stated = left(judge, state)
            variances = [max(one.squares / max(stated.freedom, 1), LEAST_NOISE_MM**2) for one in (stated, other)]
            independent = min(stated.freedom, MOST_INDEPENDENT)
            log_odds = 0.5 * independent * float(np.log(variances[0] / variances[1]))
            if log_odds >= np.log(least):
                break
        else:
            continue
        mended = linearised_about(fit, fit, turned, references)
        offset = _offsets(mended, _reversed(some, joint))[:, joint].mean(axis=0)
        std = float(np.sqrt(expit(min(log_odds, np.log(MOST_ODDS)))))
        if 2 * std * np.linalg.norm(offset) > np.sqrt(min(variances)):
            change, chain = mended.coefficients - fit.coefficients, fit.perturbed_chain
            changes = {term: change[columns] for term, columns in zip(chain.terms, chain.columns, strict=True)}
            found.append(UnshownSign(changes, _terms(joint + 1, offset, std)))
    return found


def _is_surely_less(judge: IdentificationResult, other: Contrasts, n_constants: int, odds: float) -> bool:
    """Whether the odds of the reversed sign are less, by points, even if constants take up nothing of the stated one's.

    That needs no derivatives. Of the stated sign constants may take up some contrasts more, which leaves more variance.
    """
    squares = [one.robust_weight * one.residuals**2 for one in judge.references if one.kind == "point"]
    if len(squares) < len(judge.references) or other.freedom < MOST_INDEPENDENT + n_constants:
        return False
    most = sum(max(float(one.sum()), one.size * LEAST_NOISE_MM**2) for one in squares)
    least = other.squares * (other.freedom - n_constants) / other.freedom
    return bool(most < odds ** (2 / MOST_INDEPENDENT) * least)


def with_unshown_signs(fit: IdentificationResult, signs: Sequence[UnshownSign]) -> IdentificationResult:
    """The fit, which may have other terms beside those of the readings by now, with both signs in its covariances."""
    for sign in signs:
        chain = fit.perturbed_chain
        changes = [sign.changes.get(term, np.zeros(term.n_coefficients)) for term in chain.terms]
        stds = np.concatenate([term.prior_stds for term in sign.terms])
        cause = stds[0] * np.concatenate([*changes, np.ones(2)])
        cov, same = (
            None if one is None else block_diag(one, np.zeros((2, 2))) + np.outer(cause, cause)
            for one in (fit.covariance, fit.repeatability_covariance)
        )
        assert cov is not None
        fit = replace(
            fit,
            perturbed_chain=PerturbedChain(chain.chain, (*chain.terms, *sign.terms)),
            coefficients=np.concatenate([fit.coefficients, np.zeros(2)]),
            covariance=cov,
            repeatability_covariance=same,
            prior_std=np.concatenate([fit.prior_std, stds]),
        )
    return replace(fit, groups=(*fit.groups, TermGroupResult(GROUP, 2 * len(signs), 0.0, 1.0))) if signs else fit


def without_unshown_signs(fit: IdentificationResult) -> IdentificationResult:
    """The fit without the terms of signs."""
    groups = tuple(group for group in fit.groups if group.name != GROUP)
    return replace(fit.select(lambda term: term.group != GROUP), groups=groups)


def signs_not_shown(fit: IdentificationResult) -> Iterator[Finding]:
    """A finding for each joint whose sign the readings do not show."""
    for term in fit.perturbed_chain.terms:
        if term.group == GROUP and term.name.endswith(ALONG):
            joint, variance = term.name.split()[0], float(term.prior_stds[0] ** 2)
            odds = variance / (1 - variance)
            what = f"The sign of {joint} is not shown by these readings (odds of the reversed one "
            what += f"{odds:.2g} to 1)" if odds > 1 else f"1 to {1 / odds:.2g})"
            if odds * LEAST_ODDS > 1:
                what = f"{joint} seems to turn the other way (odds {odds:.0f} to 1)"
            what += (
                ": it hardly moves the tip, and the uncertainty contains both signs. Turn it by hand and compare its "
                f"sign with the drawing, or measure with a tip farther from its axis, or with {joint} turned further."
            )
            yield Finding("joint sign", what, {"odds": odds})


def _terms(joint: int, offset: FloatArray, std: float) -> tuple[Term, Term]:
    """``Rot(-2 q) r - r`` of the offset r (2,) [mm], for coefficients of 1."""
    (x, y), twice = offset.tolist(), 2 * Expression.angle(joint)
    return (
        Term(f"J{joint} reversed{ALONG}", joint, (0.0, 0.0, 0.0, x, y, 0.0), Formula((twice.cos() - 1,)), GROUP, std),
        Term(f"J{joint} reversed, across it", joint, (0.0, 0.0, 0.0, y, -x, 0.0), Formula((twice.sin(),)), GROUP, std),
    )


def _offsets(fit: IdentificationResult, state: ArmState) -> FloatArray:
    """(n, n_joints, 2) offset of the tip from the axes of the joints, along x and y of their places [mm]."""
    by_motion = fit.chain.tip_derivatives(state.angles).motion_jacobian[:, 1:-1]
    along, across = (np.einsum("njc,njc->nj", by_motion[:, :, 2], by_motion[:, :, axis]) for axis in (4, 3))
    return np.stack([along, -across], axis=-1)  # z x (p - o) = x e_y - y e_x


def _reversed(state: ArmState, joint: int) -> ArmState:
    """The readings with the angle of a joint, counted from 0, reversed."""
    by_joints = state.joint_angles.copy()
    by_joints[:, joint] *= -1
    return replace(state, angles=state.chain.by_encoders(by_joints))
