"""An error that all readings share: its effect on the coefficients, and the covariance that it adds."""

from dataclasses import replace

import numpy as np

from truearm.arm import load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.propagation import response_to_errors, with_shared_error
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, constants


def test_a_shared_error_adds_the_square_of_what_it_does_to_the_coefficients(rng):
    """A scale of 10^-4: by the dense derivatives, Sigma J^T W e; terms that were added since do not respond."""
    arm = load_arm("ur3e")
    angles = rng.uniform(-1.5, 1.5, (40, arm.n_joints))
    state, points = ArmState.of(arm, angles), arm.chain.tip_in_base(angles) + rng.normal(0, 0.05, (40, 3))
    references = [Points(np.arange(40), points)]
    fit = identify(arm.chain, state, constants(arm.chain, free=()), references, robust=False)
    errors = 1e-4 * points
    columns = np.concatenate([c for _, _, c in fit.perturbed_chain.derivatives(state, fit.coefficients)], axis=2)
    expected = fit.covariance @ np.einsum("pcn,cn->p", columns, fit.references[0].weights ** 2 * errors.T)
    response = response_to_errors(fit, state, references, np.pad(errors, ((0, 0), (0, 1))))
    np.testing.assert_allclose(response, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert not response_to_errors(fit, state, references, np.zeros((40, 4))).any()

    first, shared = response[:5], np.zeros(fit.covariance.shape)
    shared[:5, :5] = np.outer(first, first)
    same = replace(fit, repeatability_covariance=0.5 * fit.covariance)
    for one in (fit, same):
        found = with_shared_error(one, first)
        np.testing.assert_allclose(found.covariance - fit.covariance, shared, atol=1e-12 * fit.covariance.max())
    np.testing.assert_allclose(
        found.repeatability_covariance, 0.5 * fit.covariance + shared, atol=1e-12 * fit.covariance.max()
    )
    assert with_shared_error(fit, np.zeros(5)) is fit
