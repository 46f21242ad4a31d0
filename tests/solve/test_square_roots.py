"""Square roots of covariances: of whole rank, and singular."""

import numpy as np
import pytest

from truearm.solve.square_roots import covariance_factor


@pytest.mark.parametrize("rank", [0, 1, 2, 4])
def test_the_square_of_a_factor_is_the_covariance(rng, rank):
    """In units that differ by 10^6; to the rounding of doubles, and its root where the matrix is singular."""
    units = np.array([1e-3, 1.0, 1e3, 1.0])
    half = rng.normal(size=(rank, 4)) * units
    found = covariance_factor(half.T @ half)
    np.testing.assert_allclose(
        found.T @ found / units / units[:, None], half.T @ half / units / units[:, None], atol=1e-7
    )
