"""What tips are uncertain by where a reading does not state what the terms depend on.

A quantity that is not stated has its mean, and its variance goes through its derivative into that of the tip, as by the
law of propagation of uncertainty (JCGM 100:2008, 5.1.2).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.terms.basis import Constant, GravityTorque, Harmonics, InSession
from truearm.identification.terms.state import ArmState
from truearm.typing import FloatArray

OF_ANGLES = (Constant, GravityTorque, Harmonics, InSession)
"""Bases that depend on nothing that may not be stated."""


def half_tip_difference(fit: IdentificationResult, low: ArmState, high: ArmState) -> FloatArray:
    """(n, 3) half the way of the tips from one state to another [mm]; zeros where no term depends on what differs."""
    bases = [term.basis for term in fit.perturbed_chain.terms if not isinstance(term.basis, OF_ANGLES)]
    if all(np.array_equal(basis.values(low), basis.values(high)) for basis in bases):
        return np.zeros((len(low), 3))
    return np.asarray(fit.tips(high) - fit.tips(low)) / 2


def direction_effects(fit: IdentificationResult, state: ArmState) -> FloatArray:
    """Give what directions of movement do to the tips that the state does not know, those that are 0.

    Returns
    -------
    (n_joints, n, 3) array
        By joint the tip with direction 1 less that half way between 1 and -1 [mm]. Both are as likely, so it is the
        standard deviation too.
    """
    out = np.zeros((state.chain.n_joints, len(state), 3))
    if state.directions is None:
        return out
    rows = np.flatnonzero((state.directions == 0).any(axis=1))
    open_at = state.rows(rows)
    assert open_at.directions is not None
    for joint, effect in enumerate(out):
        low, high = open_at.directions.copy(), open_at.directions.copy()
        unknown = low[:, joint] == 0
        low[unknown, joint], high[unknown, joint] = -1.0, 1.0
        effect[rows] = half_tip_difference(fit, replace(open_at, directions=low), replace(open_at, directions=high))
    return out
