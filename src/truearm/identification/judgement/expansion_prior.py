"""Thermal expansion with a prior that knows materials, and links that lag behind the thermometer.

Identification gives the growth of every link a wide prior of its own. That lets readings within a tenth of a kelvin
show expansions that no material has. This module exchanges that prior, on the linearisation at the minimum, for what is
known of arms, and states what remains uncertain:

- *Materials.* The links of an arm have a common expansion and differences from it, of covariance ``m^2 1 1^T + d^2 I``
  about zero. An arm is of carbon fibre or of metal, each as likely as the other before the readings, which weigh the
  two by their evidence: a mixture of normal distributions (A. Gelman and others, "Bayesian Data Analysis", 3rd ed.,
  2013, chapter 22). The mean is zero, so that an arm whose readings do not show its growth is not corrected for it.
- *Lag.* Links follow the air within minutes, so in training they changed by only a share of what the thermometer says.
  With temperatures of standard deviation s about their mean, and links up to `LAG_K` behind, the share lies anywhere
  between ``1 - LAG_K / s`` and 1, and shares below `LEAST_SHARE` count as 0: what readings within a tenth of a kelvin
  show says nothing about the growth by ten. The mean temperature of the links is uncertain likewise.

Lengths are those at the mean temperature of the training, which readings determine; from there they grow. To have the
constants of the chain at 20 degC, each link has, beside its growth ``c (T - 20 degC)``, a constant
``-c (mean - 20 degC)`` along the same direction.

Other inputs that were the same at all readings (a load, a direction of movement) have terms with their prior too: the
tip moves by them where they differ.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms.basis import Constant, Temperature
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.identification.terms.thermal import MATERIALS, UNKNOWN_MATERIAL
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray, IntArray

# By how much links may be behind the thermometer, root mean square over a session [K].
LAG_K = 1.0
# Where links may have changed by less than this share, what readings show is as well another drift: nothing of growth.
LEAST_SHARE = 0.5
# Lags between none and that which are summed over.
N_LAGS = 12
# Values of functions in training that count as zero, in their unit.
LEAST_VALUE = 1e-9
# Smaller shares of a prior's precision are rounding.
ROUNDING = 1e-9


class _Growth(NamedTuple):
    """Moments of the expansion, of what training shows of it, and between the two; number of determined ones."""

    expansion: FloatArray
    expansion_covariance: FloatArray
    shown: FloatArray
    shown_covariance: FloatArray
    across: FloatArray
    effective: float


def at_mean_temperature(state: ArmState) -> ArmState:
    """The state with temperatures about 20 degC instead of about their mean: its lengths are those at the mean."""
    degC = state.temperature_degC
    return state if degC is None else replace(state, temperature_degC=degC - degC.mean() + REFERENCE_DEGC)


def with_material_prior(
    fit: IdentificationResult, temperature_degC: FloatArray, *, widened: float = 1.0
) -> IdentificationResult:
    """Exchange the prior of the thermal expansion.

    A covariance that was widened widens what the readings say of the growth, and not its prior; the estimates are those
    before.

    Parameters
    ----------
    fit : IdentificationResult
        Identified from the state of `at_mean_temperature`.
    temperature_degC : (n,) array
        True temperatures of the readings [degC].
    widened : float
        Factor by which the covariance of `fit` was widened.

    Returns
    -------
    IdentificationResult
        For true temperatures. Itself if it has no thermal terms.
    """
    grows, terms = _coefficients_of_growth(fit.perturbed_chain)
    if not len(grows):
        return fit
    mean, spread = float(temperature_degC.mean()), float(temperature_degC.std())
    others = np.setdiff1d(np.arange(len(fit.coefficients)), grows)
    of_growth = fit.covariance[np.ix_(grows, grows)]
    information, right = _likelihood(of_growth / widened, fit.coefficients[grows], fit.prior_std[grows])
    lags_K = LAG_K * (np.arange(N_LAGS) + 0.5) / N_LAGS
    shares = 1 - lags_K / spread
    shares = np.where(shares < LEAST_SHARE, 0.0, shares)
    new, wide = _mixture(information, right, shares), _mixture(information / widened, right / widened, shares)
    gain = np.linalg.solve(of_growth, fit.covariance[np.ix_(grows, others)]).T
    x, covariance, prior_std = fit.coefficients.copy(), fit.covariance.copy(), fit.prior_std.copy()
    x[others] += gain @ (new.shown - fit.coefficients[grows])
    x[grows] = new.expansion
    covariance[np.ix_(others, others)] += gain @ (wide.shown_covariance - of_growth) @ gain.T
    covariance[np.ix_(others, grows)] = gain @ wide.across
    covariance[np.ix_(grows, others)] = covariance[np.ix_(others, grows)].T
    covariance[np.ix_(grows, grows)] = wide.expansion_covariance
    prior_std[grows] = np.sqrt(UNKNOWN_MATERIAL.covariance(len(grows)).diagonal())
    groups = tuple(
        replace(group, effective=new.effective) if group.name == terms[0].group else group for group in fit.groups
    )
    exchanged = replace(fit, coefficients=x, covariance=covariance, prior_std=prior_std, groups=groups)
    above = mean - REFERENCE_DEGC
    return _relative(
        exchanged, [(term, int(k), above) for term, k in zip(terms, grows, strict=True)], u=min(LAG_K, spread)
    )


def with_unlearned_terms(fit: IdentificationResult, terms: list[tuple[Term, float]]) -> IdentificationResult:
    """Add terms of which the readings show nothing, with their prior: links that grow, hysteresis, loads.

    Parameters
    ----------
    fit : IdentificationResult
    terms : list of (Term, float)
        Of one coefficient each, and the one value of their function in training, relative to which they move the tip.
    """
    if not terms:
        return fit
    added, first = [term for term, _ in terms], len(fit.coefficients)
    prior = np.diag([float(term.prior_stds[0]) ** 2 for term in added])
    grows = np.flatnonzero([isinstance(term.basis, Temperature) for term in added])
    prior[np.ix_(grows, grows)] = UNKNOWN_MATERIAL.covariance(len(grows))
    apart = np.zeros((len(added), first))
    sizes = Counter(term.group for term in added)
    groups = (TermGroupResult(f"{name}, not learned", n, 0.0, 1.0) for name, n in sizes.items())
    whole = _extended(fit, added, np.zeros(len(added)), np.sqrt(prior.diagonal()), apart.T, prior)
    whole = replace(whole, groups=(*fit.groups, *groups))
    return _relative(whole, [(term, k, value) for k, (term, value) in enumerate(terms, first)])


def _extended(
    fit: IdentificationResult,
    terms: list[Term],
    x: FloatArray,
    prior_std: FloatArray,
    across: FloatArray,
    covariance: FloatArray,
) -> IdentificationResult:
    """The fit with further terms; `across` is the covariance of its coefficients with theirs."""
    return replace(
        fit,
        perturbed_chain=PerturbedChain(fit.perturbed_chain.chain, (*fit.perturbed_chain.terms, *terms)),
        coefficients=np.concatenate([fit.coefficients, x]),
        covariance=np.block([[fit.covariance, across], [across.T, covariance]]),
        prior_std=np.concatenate([fit.prior_std, prior_std]),
    )


def _relative(
    fit: IdentificationResult, terms: list[tuple[Term, int, float]], *, u: float = 0.0
) -> IdentificationResult:
    """Give terms, each with its coefficient x, a constant beside them: together they are x times (function - value).

    `u` is the standard uncertainty of the value, the same error for all.
    """
    terms = [one for one in terms if abs(one[2]) > LEAST_VALUE or u > 0]
    own = [k for _, k, _ in terms]
    values = np.array([value for _, _, value in terms])
    across = -fit.covariance[:, own] * values
    of_own, x = fit.covariance[np.ix_(own, own)], fit.coefficients[own]
    below = np.outer(values, values) * of_own + u**2 * (of_own + np.outer(x, x))
    constants = [replace(term, name=f"{term.name}, from the training on", basis=Constant()) for term, _, _ in terms]
    prior_std = np.array([np.hypot(value, u) * fit.prior_std[k] for _, k, value in terms])
    return _extended(fit, constants, -values * x, prior_std, across, below)


def _coefficients_of_growth(chain: PerturbedChain) -> tuple[IntArray, list[Term]]:
    """Coefficients of the thermal terms, and these."""
    pairs = zip(chain.terms, chain.columns, strict=True)
    grows = [(term, columns[0]) for term, columns in pairs if isinstance(term.basis, Temperature)]
    return np.array([column for _, column in grows], dtype=np.intp), [term for term, _ in grows]


def _likelihood(covariance: FloatArray, x: FloatArray, prior_std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What the readings alone say of the growth x: information matrix L [K^2] and L x [K]."""
    values, vectors = np.linalg.eigh(covariance / np.outer(prior_std, prior_std))
    values = np.clip(values, ROUNDING, 1.0)
    by_prior = vectors / prior_std[:, None]
    information = (by_prior * (1 / values - 1)) @ by_prior.T
    return information, (by_prior / values) @ (vectors.T @ (x / prior_std))


def _mixture(information: FloatArray, right: FloatArray, shares: FloatArray) -> _Growth:
    """Moments of the growth over materials and shares, weighed by their evidence.

    Where links changed by a share a of what the thermometer says, training shows ``a c`` of the expansion c.
    """
    n, identity = len(right), np.eye(len(right))
    logs, means, covariances, determined, share = [], [], [], [], []
    for material in MATERIALS:
        half = np.linalg.cholesky(material.covariance(n))
        white, of_right = half.T @ information @ half, half.T @ right
        for a in shares:
            matrix = a**2 * white + identity
            inverse = np.linalg.inv(matrix)
            logs.append(0.5 * (a**2 * of_right @ inverse @ of_right - np.linalg.slogdet(matrix)[1]))
            means.append(half @ inverse @ (a * of_right))
            covariances.append(half @ inverse @ half.T)
            determined.append(n - np.trace(inverse))
            share.append(a)
    weight = np.exp(np.array(logs) - max(logs))
    weight /= weight.sum()
    both = np.hstack([means, np.array(share)[:, None] * means])
    centre = weight @ both
    scatter = np.einsum("h,hi,hj->ij", weight, both - centre, both - centre)
    for w, a, covariance in zip(weight, share, covariances, strict=True):
        scatter += w * np.kron([[1.0, a], [a, a**2]], covariance)
    return _Growth(
        centre[:n], scatter[:n, :n], centre[n:], scatter[n:, n:], scatter[n:, :n], float(weight @ determined)
    )
