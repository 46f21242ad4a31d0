"""The error that a model of constants makes by the terms that it does not have."""

import numpy as np
import pytest

from truearm.arm import Arm, load_arm
from truearm.arm.denavit_hartenberg import chain_from_dh
from truearm.identification.estimation.identification import identify, linearised_about
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.missing_terms import SUFFIX, missing_terms, with_missing_terms
from truearm.identification.references.reading_references import references_of
from truearm.identification.terms import ArmState, constants
from truearm.models import KinematicModel
from truearm.models.uncertainty import UncertaintyBudget
from truearm.readings import Session
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import VirtualArm, load_preset

ARM = load_arm("gao2017")


@pytest.fixture(scope="module")
def virtual():
    return VirtualArm.draw(ARM, load_preset("shop"), seed=0)


@pytest.fixture(scope="module")
def model(virtual):
    return KinematicModel(ARM).fit_readings(
        virtual.measure(measuring_poses(ARM, 120, seed=1000).angles, seed=0).readings
    )


def test_points_are_those_of_the_constants_and_the_spread_holds_far_away(virtual, model):
    """Poses drawn within the limits: 42 % of 300 readings' models before; here one arm of 120 readings."""
    lower, upper = np.clip(ARM.limits.T, -np.pi, np.pi)
    far = virtual.measure(np.random.default_rng(0).uniform(lower, upper, (200, ARM.n_joints)), seed=0)
    points, covariance = model.predict_readings(far.readings, return_cov=True)
    np.testing.assert_array_equal(points, model.fit_.chain.tip_in_base(far.readings.angles))
    off = points - far.true_tips
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    assert (squares < UncertaintyBudget.ellipsoid_factor**2).mean() > 0.92
    assert np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / (off**2).sum(axis=1).mean()) < 1.6


@pytest.mark.parametrize("kinds", [("revolute", "revolute"), ("revolute", "prismatic")])
def test_spread_is_as_large_as_the_error_of_an_arm_whose_axes_are_parallel(kinds):
    """Base and tip are known along the axes by their sum alone: of rigid arms 10 and 27 times the error before.

    Root mean squares of 200 readings of 0.02 mm; their ratio is known to 1/sqrt(6 * 50), and of 60 readings that an arm
    was identified by to 10 %: a third either way.
    """
    rng = np.random.default_rng(0)
    chain = chain_from_dh(a=[400, 350], alpha=[0, 0], d=[0, 0], kinds=kinds, tip_in_flange=(30, 20, 40))
    own = constants(chain, free=(), angle_std=1e-3, length_std=0.5)
    std = np.concatenate([term.prior_stds for term in own])
    true = PerturbedChain(chain, tuple(own)).with_constants(std * rng.standard_normal(len(std)))
    angles = rng.uniform((-2, -2), (2, 2 if kinds[1] == "revolute" else 300), (260, 2))
    points = true.tip_in_base(angles) + 0.02 * rng.standard_normal((260, 3))
    model = KinematicModel(Arm("planar", chain)).fit_readings(Session(angles[:60], points[:60]))
    predicted, covariance = model.predict(angles[60:], return_cov=True)
    error = (predicted - points[60:]).std()
    assert 0.67 < np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / 3) / error < 1.33


def test_they_count_as_no_parameters(model):
    groups = [group for group in model.fit_.groups if group.name.endswith(SUFFIX)]
    assert groups
    assert not any(group.effective for group in groups)
    added = model.fit_.columns_of(lambda term: term.group.endswith(SUFFIX))
    assert not model.fit_.coefficients[added].any()


def test_the_second_moment_is_about_the_constants():
    """By hand: covariance C of the complete arm plus the product of the difference of both means with itself."""
    rng = np.random.default_rng(1)
    angles = ARM.working + 0.8 * rng.uniform(-1, 1, (60, ARM.n_joints))
    state = ArmState.of(ARM, angles)
    points = ARM.chain.tip_in_base(angles) + 0.02 * rng.standard_normal((60, 3))
    references = references_of(Session(angles, points, np.full((60, 3), 0.02)), None)
    own = constants(ARM.chain)
    fit = identify(ARM.chain, state, own, references)
    offered = [*own, *missing_terms(state, ("base", "tip"))]
    complete = identify(ARM.chain, state, offered, references)
    about, after = (
        identify(ARM.chain, state, offered, references, start=fit, about=fit),
        linearised_about(fit, identify(ARM.chain, state, offered, references, start=fit), state, references),
    )
    np.testing.assert_array_equal(about.covariance, after.covariance)
    np.testing.assert_array_equal(about.coefficients, after.coefficients)
    wider = with_missing_terms(fit, complete)
    of = {
        t: (complete.coefficients[c], complete.covariance.diagonal()[c])
        for t, c in zip(complete.perturbed_chain.terms, complete.perturbed_chain.columns, strict=True)
    }
    before = dict(zip(fit.perturbed_chain.terms, fit.perturbed_chain.columns, strict=True))
    for term, columns in zip(wider.perturbed_chain.terms, wider.perturbed_chain.columns, strict=True):
        mean, variance = of.get(term, (0.0, 0.0))
        x = fit.coefficients[before[term]] if term in before else 0.0
        np.testing.assert_allclose(wider.covariance.diagonal()[columns], variance + (mean - x) ** 2, rtol=1e-9)
    np.testing.assert_array_equal(wider.tips(state), fit.tips(state))
