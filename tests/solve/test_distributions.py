"""Chi-squared and F distributions are those of scipy.stats."""

import numpy as np
import pytest
from scipy import stats

from truearm.solve.distributions import (
    chi2_probability,
    chi2_probability_beyond,
    chi2_quantile,
    chi2_quantile_beyond,
    f_log_density,
    f_quantile,
)

# The same special functions: rounding of some operations.
ROUNDING = 1e-12


@pytest.mark.parametrize("freedom", [1, 3, 4.5, 200])
@pytest.mark.parametrize("p", [1e-6, 0.5, 0.95, 0.999])
def test_chi_squared(freedom, p):
    law = stats.chi2(freedom)
    assert chi2_quantile(p, freedom) == pytest.approx(law.ppf(p), rel=ROUNDING)
    assert chi2_quantile_beyond(p, freedom) == pytest.approx(law.isf(p), rel=ROUNDING)
    assert chi2_probability(10 * p, freedom) == pytest.approx(law.cdf(10 * p), rel=ROUNDING)
    assert chi2_probability_beyond(10 * p, freedom) == pytest.approx(law.sf(10 * p), rel=ROUNDING)


@pytest.mark.parametrize("freedom", [2.0, 7.3, 1000.0])
def test_f(freedom):
    x = np.array([1e-3, 0.4, 2.0, 90.0])
    np.testing.assert_allclose(f_log_density(x, 3, freedom), stats.f(3, freedom).logpdf(x), rtol=ROUNDING, atol=1e-12)
    for p in (0.05, 0.95, 0.99):
        assert f_quantile(p, 3, freedom) == pytest.approx(stats.f(3, freedom).ppf(p), rel=1e-9)
