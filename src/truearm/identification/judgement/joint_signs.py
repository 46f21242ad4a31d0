"""Whether readings show the sign of a joint whose axis passes through the tip or near it.

Such a joint hardly moves the tip, so that an arm with its angle q reversed may explain the readings as well, with
constants that differ a little. The two are compared by the restricted likelihood of the residuals that the constants do
not affect, each with its own noise, as equally likely before. Unless the stated sign is clearly the better one, what
lies between the two enters the uncertainty and is not corrected: with probability p the constants differ by their
change, and the tip, at r from the axis in the frame of the joint, is at ``Rot(-2 q) r``. That is one cause of second
moment p. It hardly moves the tip where readings are, and by up to 2 r elsewhere.

Whether the angles of joints are wrong in proportion: servos, potentiometers, encoders with a wrong count.

Geared encoders of robots have no such error, and a term for it would take what other causes explain. It is offered
where readings ask for it: of the residuals that no constants of the arm explain, the gains are estimated by least
squares. They must explain a good part of them, and one must be significant and larger than what eccentricity imitates.

Servos differ from each other. A gain that all joints have alike is a unit or a factor of all angles, as of gon read as
degrees or a wrong count of a turn, and is refused.
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
from truearm.identification.judgement.structure import contrasts
from truearm.identification.references.references import Reference
from truearm.identification.terms import ArmState, Expression, Formula, Term
from truearm.identification.terms.catalogue import JOINT_GAINS, LENGTH_STD, gains, relative_size
from truearm.readings.readings import Measurements
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
    found = []
    for joint in np.flatnonzero(~state.chain.is_prismatic).tolist():
        angles = some.joint_angles[:, joint]
        moved = 2 * np.sin(angles - angles.mean())[:, None] * offsets[:, joint]
        if np.ptp(angles) < LEAST_TURN or np.sqrt((moved**2).sum(axis=1).mean()) > most:
            continue
        turned = _reversed(state, joint)
        for judge, least in judges:
            stated, other = left(judge, state), left(judge, turned)
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


# The least gain that is asked for: an eccentric disc of 0.2 mrad, the typical one, imitates 0.0002; on virtual arms as
# from a workshop, and on a UR10 and a UR5 under a tracker, up to 0.0009 is significant.
LEAST_GAIN = 2e-3
# Share of the sum of squared residuals that gains may leave; the cables of a WAM, which stretch, leave 0.9.
MOST_LEFT = 0.7
# Beyond it an angle is in another unit or of another joint, which no gain mends.
MOST_GAIN = 0.2
# Standard deviations that it must be away from zero.
SIGNIFICANT = 5.0
# Gains are alike within this, or within standard uncertainties of their own; and they are refused from this size on.
SAME_GAIN, SURE, LEAST_COMMON = 2e-3, 3.0, 1e-2
# Joints, and at least half of all, whose gain is known so well: two servos may err alike by chance.
LEAST_KNOWN = 3
# Share within which a factor of all angles is that of gon.
NEAR_GON = 5e-3


def gains_asked(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], absorbed: Sequence[Term]
) -> list[Term]:
    """The gains of all joints, if the readings ask for one; else none.

    Parameters
    ----------
    fit : IdentificationResult
        An arm whose constants were identified from the readings.
    state : ArmState
        Of the readings.
    references : sequence of Reference
        Those of the identification.
    absorbed : sequence of Term
        The constants, and what else explains the residuals before gains do.
    """
    if known := [term for term in fit.perturbed_chain.terms if term.group == JOINT_GAINS]:
        return known
    offered = gains(state)
    if not offered:
        return []
    left = contrasts(fit, state, references, absorbed, offered)
    if left.freedom <= len(offered):
        return []
    values, vectors = np.linalg.eigh(left.gram)
    counts = values > np.finfo(float).eps * len(values) * values.max(initial=0.0)
    if not counts.all():
        return []  # some joint moved too little
    inverse = (vectors / values) @ vectors.T
    found = -inverse @ left.slope
    rest = max(left.squares + float(left.slope @ found), 0.0)
    std = np.sqrt(inverse.diagonal() * rest / (left.freedom - len(offered)))
    asked = (np.abs(found) > SIGNIFICANT * std) & (np.abs(found) >= LEAST_GAIN)
    is_asked = asked.any() and np.abs(found).max() <= MOST_GAIN and rest <= MOST_LEFT * left.squares
    return offered if is_asked else []


def identified_gains(fit: IdentificationResult) -> tuple[Finding, ...]:
    """The gains that were identified, in one sentence; nothing without any."""
    found = {name: 100 * gain for name, (gain, _) in _gains_of(fit).items()}
    said = ", ".join(f"{joint} by {percent:+.2g} %" for joint, percent in found.items())
    numbers = {f"{joint}_percent": percent for joint, percent in found.items()}
    whole = f"Angles are wrong in proportion, as those of servos are: {said}."
    return (Finding("joint gains", whole, numbers),) if found else ()


def common_gain(fit: IdentificationResult) -> float | None:
    """The gain that all joints have alike; None if they differ, or it is no larger than servos may have by chance."""
    gain, std = np.array(list(_gains_of(fit).values())).reshape(-1, 2).T
    known = std <= SAME_GAIN
    if known.sum() < max(LEAST_KNOWN, len(gain) / 2):
        return None
    common = float(np.median(gain[known]))
    alike = np.abs(gain - common) <= np.maximum(SAME_GAIN, SURE * std)
    return common if alike.all() and abs(common) >= LEAST_COMMON else None


def refuse_common_gain(gain: float | None, readings: Measurements) -> None:
    """Refuse angles with a `common_gain`.

    Raises
    ------
    InputError
        With the factor, and the unit that it is likely of.
    """
    if gain is None:
        return
    factor = 1 + gain
    hint = (
        f"check the unit, the counts per turn and the gear ratio by which all angles were converted: multiplied by "
        f"{factor:.3f} they fit the drawing"
    )
    if abs(factor / 0.9 - 1) <= NEAR_GON:
        hint = "the angles may be in gon, 400 a turn: truearm import --angle-unit gon; or " + hint
    elif abs(factor * 0.9 - 1) <= NEAR_GON:
        hint = "the angles may be in deg, stated in gon: truearm import --angle-unit deg; or " + hint
    readings.contradict(
        f"by these readings all joints turn by {factor:.3f} times their stated angles: that is a unit or a factor of "
        "all angles, and no error of servos, which differ from each other",
        hint=hint,
    )


def _gains_of(fit: IdentificationResult) -> dict[str, tuple[float, float]]:
    """The gain that was identified of each joint, and its standard uncertainty."""
    chain, std = fit.perturbed_chain, np.sqrt(np.maximum(fit.covariance.diagonal(), 0.0))
    return {
        term.name.removesuffix(" gain"): (float(fit.coefficients[columns[0]]), float(std[columns[0]]))
        for term, columns in zip(chain.terms, chain.columns, strict=True)
        if term.group == JOINT_GAINS
    }
