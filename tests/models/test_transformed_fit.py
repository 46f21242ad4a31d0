"""A physical model does not depend on the way to its sums: Fourier transforms or products of matrices."""

import numpy as np
import pytest

import truearm as ta
from truearm.identification.estimation import covariance_root, problem


def test_points_and_uncertainties_are_the_same_by_transforms_and_by_products(monkeypatch: pytest.MonkeyPatch):
    session = ta.simulate("ur10", poses=80, seed=3).session
    at = ta.simulate("ur10", poses=50, seed=4).session.angles
    found = []
    for transformed in (True, False):
        calls = []

        def is_cheaper(*of: object, transformed: bool = transformed, calls: list[object] = calls) -> bool:
            calls.append(of)
            return transformed

        for module in (problem, covariance_root):
            monkeypatch.setattr(module, "is_cheaper", is_cheaper)
        model = ta.PhysicalModel(ta.load_arm("ur10"), highest=16, residual=False).fit_readings(session)
        assert calls  # there are series of harmonics
        found.append(model.predict(at, return_cov=True))
    (points, covariances), (expected, of_products) = found
    u = np.sqrt(np.trace(of_products, axis1=1, axis2=2))
    # The rounding of the sums, through all rounds of the fit, is 1e-10 of u here.
    assert (np.linalg.norm(points - expected, axis=1) / u).max() < 1e-6
    np.testing.assert_allclose(np.trace(covariances, axis1=1, axis2=2) / u**2, 1, atol=2e-6)
