"""Whether a residual process is the arm's: readings of a new set-up, compared in the frame that they determine."""

from __future__ import annotations

import numpy as np

from truearm.arm import load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.judgement.residual_process import _only_frame_uncertain
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, constants


def test_a_frame_of_which_all_is_free_is_as_uncertain_as_the_whole_arm(rng):
    """Where the free terms are all that the readings determine, their covariance is the posterior: to 0.1 %."""
    arm = load_arm("ur3e")
    angles = rng.uniform(-1.5, 1.5, (40, arm.n_joints))
    state, points = ArmState.of(arm, angles), arm.chain.tip_in_base(angles) + rng.normal(0, 0.05, (40, 3))
    fit = identify(arm.chain, state, constants(arm.chain, free=()), [Points(np.arange(40), points)], robust=False)
    found = _only_frame_uncertain(fit, list(fit.perturbed_chain.terms), state).covariance
    std = np.sqrt(fit.covariance.diagonal())
    np.testing.assert_allclose(found / np.outer(std, std), fit.covariance / np.outer(std, std), atol=1e-3)
