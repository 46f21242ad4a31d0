"""What changes from day to day: the ball cages of the bearings start elsewhere, joints and the base settle.

An arm was identified on one day and is used on another. Between them every joint tilts and runs out a little
differently, and the base moves against the reference: a variance component of its own, as in an analysis of variance by
days (ISO 5725-3:1994, clause 5: the intermediate precision), here of small motions. To the covariance P of the
constants it adds Q, as the prediction step of a Kalman filter does (R. E. Kalman, J. Basic Eng. 82 (1960) 35, eq. 24).
Readings of one day show nothing of its size, which is then that of good preloaded bearings and of a steady stand, once
for the day of the readings, whose motions are among the constants, and once for the day of use. Several sessions show
it of the joints: each has motions of its own, whose common size is estimated by evidence. Each has a frame of its own
too, so that none shows how the base moved.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from truearm.arm.chain import Chain
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms.basis import AXES, Constant, InSession
from truearm.identification.terms.catalogue import base_terms
from truearm.identification.terms.term import Term

# Standard deviation of a day's tilt of a joint about either normal of its axis: 0.25 arcsec. A ball cage changes the
# tilt of a bearing by a tenth of its wobble, of 2 to 20 arcsec in machine tools and less in measuring arms.
TILT_STD = 1.25e-6  # rad
# And of its shift along either, as a share of the reach: 0.45 um on an arm of 1.3 m.
SHIFT_SHARE = 3.5e-7
# Shift of a free base against the reference along each axis, as a share of the reach: 2 um on an arm of 1.3 m, the
# growth of 0.5 m of steel stand by 0.35 K, with which a screwed or magnetic mount settles alike. It tilts as a joint.
BASE_SHIFT_SHARE = 1.5e-6
GROUP = "from day to day"
# About x and y, along x and y: the motions of a joint other than its own and the one along its axis.
COMPONENTS = (0, 1, 3, 4)


def day_to_day_terms(chain: Chain, sessions: Iterable[str]) -> list[Term]:
    """Small motions of every joint in each of several sessions, with a common scale.

    Parameters
    ----------
    chain : Chain
    sessions : iterable of str
        Their names; of one session or none there is nothing to compare.
    """
    names = list(sessions)
    return [
        Term(
            f"J{joint} {'tilt about' if component < 3 else 'shift along'} {AXES[component % 3]}, session {name}",
            joint,
            tuple(float(component == i) for i in range(6)),
            InSession(name),
            GROUP,
            _std(chain, component),
        )
        for name in (names if len(names) > 1 else [])
        for joint in range(1, chain.n_joints + 1)
        for component in COMPONENTS
    ]


def on_another_day(fit: IdentificationResult) -> IdentificationResult:
    """The same arm with the uncertainty of its constants and free base on another day than those of its readings.

    The covariance before is that under repeatability conditions. Constants along a whole link, which go with its
    growth, are no motions of a joint.
    """
    chain, terms = fit.perturbed_chain.chain, fit.perturbed_chain.terms
    shown = [group.scale for group in fit.groups if group.name == GROUP and group.scale > 0]
    variance = shown[0] ** 2 if shown else 2.0
    of_joint = [np.sqrt(variance) * _std(chain, c) if c in COMPONENTS else 0.0 for c in range(6)]
    of_base = np.sqrt(2.0) * np.array([TILT_STD] * 3 + [BASE_SHIFT_SHARE * chain.reach] * 3)
    free_base = base_terms(chain)

    def added_variance(term: Term) -> float:
        if term in free_base:
            return float(((of_base * term.direction) ** 2).sum())
        is_motion = isinstance(term.basis, Constant) and max(map(abs, term.direction)) == 1
        moves = is_motion and 1 <= term.place <= chain.n_joints
        return float((np.multiply(of_joint, term.direction) ** 2).sum()) if moves else 0.0

    added = [added_variance(term) for term in terms]
    covariance = fit.covariance.copy()
    covariance.flat[:: len(covariance) + 1] += np.repeat(added, [term.n_coefficients for term in terms])
    return replace(fit, covariance=covariance, repeatability_covariance=fit.covariance)


def without_own_days(fit: IdentificationResult) -> IdentificationResult:
    """The same without the motions of its sessions: those of their days are not those of another.

    Last of all: what growth does to the other coefficients is known from the readings beside these motions alone.
    """
    return fit.select(lambda term: term.group != GROUP)


def _std(chain: Chain, component: int) -> float:
    """Standard deviation of a day's motion [rad, or mm]."""
    return TILT_STD if component < 3 else SHIFT_SHARE * chain.reach
