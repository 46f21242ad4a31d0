"""Whether a residual process is the arm's: readings of a new set-up, compared in the frame that they determine."""

from dataclasses import replace

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.judgement.residual_process import OF_ARM, OF_SESSION, ResidualProcess, _only_frame_uncertain
from truearm.identification.references.cross_validation_groups import PLACE_RADIUS, is_in_one_place
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, constants

PROCESS = ResidualProcess(OF_ARM, (1.0, 2.0), 1, 0.0, -3.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("owner", "improvement_mm", "is_kept"),
    [(OF_ARM, -0.9, True), (OF_ARM, -1.1, False), (OF_SESSION, 0.9, False), (OF_SESSION, 1.1, True)],
)
def test_a_process_of_the_arm_is_kept_in_doubt_and_one_of_a_session_is_not(owner, improvement_mm, is_kept):
    """By new readings that speak for or against it by some standard errors of 1 mm."""
    assert PROCESS.is_kept
    assert PROCESS.is_judged
    after = replace(PROCESS, belongs_to=owner).after_transfer(improvement_mm, 1.0)
    assert (after.is_kept, after.is_judged, after.improvement_mm) == (is_kept, True, improvement_mm)


def test_a_frame_of_which_all_is_free_is_as_uncertain_as_the_whole_arm(rng):
    """Where the free terms are all that the readings determine, their covariance is the posterior: to 0.1 %."""
    arm = load_arm("ur3e")
    angles = rng.uniform(-1.5, 1.5, (40, arm.n_joints))
    state, points = ArmState.of(arm, angles), arm.chain.tip_in_base(angles) + rng.normal(0, 0.05, (40, 3))
    fit = identify(arm.chain, state, constants(arm.chain, free=()), [Points(np.arange(40), points)], robust=False)
    found = _only_frame_uncertain(fit, list(fit.perturbed_chain.terms), state).covariance
    std = np.sqrt(fit.covariance.diagonal())
    np.testing.assert_allclose(found / np.outer(std, std), fit.covariance / np.outer(std, std), atol=1e-3)


@pytest.mark.parametrize(
    "changed",
    [
        {"belongs_to": "nobody"},
        {"n_points": 0},
        {"length_scales": (1.0,)},
        {"length_scales": (1.0, 0.0)},
        {"length_scales": (1.0, np.inf)},
        {"rms_mm": -1e-9},
        {"residual_std_without_mm": np.inf},
        {"standard_error_mm": -1e-9},
        {"evidence": np.nan},
        {"improvement_mm": -np.inf},
    ],
)
def test_a_process_that_no_fit_could_have_found_is_refused(changed):
    PROCESS.check(2)
    refuses("residual process", replace(PROCESS, **changed).check, 2)


@pytest.mark.parametrize(("share", "is_one_place"), [(0.9, True), (1.1, False)])
def test_tips_within_a_share_of_the_reach_are_at_one_place(share, is_one_place):
    """Two poses of an arm that turns about z alone: tips apart by twice that share of the reach."""
    arm = load_arm("ur3e")
    angles = np.zeros((2, arm.n_joints))
    radius = np.linalg.norm(arm.chain.tip_in_base(angles)[0, :2])
    angles[:, 0] = np.arcsin(share * PLACE_RADIUS * arm.chain.reach / radius) * np.array([1.0, -1.0])
    assert is_in_one_place(np.zeros(2, bool), ArmState.of(arm, angles)) == is_one_place
