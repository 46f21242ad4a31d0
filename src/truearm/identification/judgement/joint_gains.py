"""Whether the angles of joints are wrong in proportion: servos, potentiometers, encoders with a wrong count.

Geared encoders of robots have no such error, and a term for it would take what other causes explain. It is offered
where readings ask for it: of the residuals that no constants of the arm explain, the gains are estimated by least
squares. They must explain a good part of them, and one must be significant and larger than what eccentricity imitates.

Servos differ from each other. A gain that all joints have alike is a unit or a factor of all angles, as of gon read as
degrees or a wrong count of a turn, and is refused.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.findings import Finding
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.judgement.structure import contrasts
from truearm.identification.references.references import Reference
from truearm.identification.terms import ArmState, Term
from truearm.identification.terms.catalogue import JOINT_GAINS, gains
from truearm.readings.readings import Measurements

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
