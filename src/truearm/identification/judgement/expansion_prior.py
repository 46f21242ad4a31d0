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
  show says nothing about the growth by ten. The mean temperature of the links is uncertain likewise. In air that drifts
  so fast that links may be farther behind, the temperatures that links of several time constants had are the
  hypotheses instead, and readings weigh them too (`truearm.identification.judgement.thermal_lag`).

Lengths are those at the mean temperature of the training, which readings determine; from there they grow. To have the
constants of the chain at 20 degC, each link has, beside its growth ``c (T - 20 degC)``, a constant
``-c (mean - 20 degC)`` along the same direction.

Other inputs that were the same at all readings (a load, a direction of movement) have terms with their prior too: the
tip moves by them where they differ.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.thermal_lag import (
    N_DRIFTS,
    TIME_CONSTANTS,
    LinkHistory,
    link_histories,
    most_lag_K,
)
from truearm.identification.terms.basis import Constant, Temperature
from truearm.identification.terms.links import MATERIALS, UNKNOWN_MATERIAL
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import BoolArray, FloatArray, IntArray

# By how much links may be behind the thermometer, root mean square over a session [K].
LAG_K = 1.0
# Where links may have changed by less than this share, what readings show is as well another drift: nothing of growth.
LEAST_SHARE = 0.5
# Lags between none and that which are summed over.
N_LAGS = 12
# Behind the group of terms of which the readings show nothing.
NOT_LEARNED = ", not learned"
# Values of functions in training that count as zero, in their unit.
LEAST_VALUE = 1e-9
# Smaller shares of a prior's precision are rounding.
ROUNDING = 1e-9
# Hypotheses of a smaller share of the evidence are no part of the mixture.
LEAST_WEIGHT = 1e-6


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Moments over k hypotheses, each a material and a history of the links, of what independent causes do.

    Attributes
    ----------
    weight : (k,) array
        By evidence.
    gains : list of (n_others, n) array
        Change of the other coefficients by growth, of the histories that differ in it.
    gain_of : (k,) int array
        Which of these.
    causes : (k, 3 n, n) array
        What the causes do: to growth as training shows it, to the growth c of each link, and to
        ``-c (temperature - 20 degC)``.
    means, covariances : (k, n) and (k, n, n) arrays
        Of the causes, as the readings left them.
    rest : (k, 2 n, 2 n) array
        Covariance of the latter two that no reading shows.
    as_others : (n_others, d) array
        What a drift of base and tip does to the other coefficients.
    drifts : (k, d, courses) array
        Drifts by causes of variance one.
    warmer : (k,) array
        Mean temperature of the links above 20 degC.
    """

    weight: FloatArray
    gains: list[FloatArray]
    gain_of: IntArray
    causes: FloatArray
    means: FloatArray
    covariances: FloatArray
    rest: FloatArray
    as_others: FloatArray
    drifts: FloatArray
    warmer: FloatArray

    @property
    def mean(self) -> FloatArray:
        """(n_others + 2 n,) of the other coefficients and the latter two."""
        mean, n = np.zeros(len(self.as_others) + 2 * self.means.shape[1]), self.means.shape[1]
        for moved, weight, gain, _ in self._by_gain():
            mean[: -2 * n] += gain @ (weight @ moved[:, :n])
            mean[-2 * n :] += weight @ moved[:, n:]
        return mean

    @property
    def mean_degC(self) -> float:
        """Mean temperature of the links."""
        return REFERENCE_DEGC + float(self.weight @ self.warmer)

    @property
    def effective(self) -> float:
        """Number of determined growths."""
        return float(self.weight @ (self.means.shape[1] - np.trace(self.covariances, axis1=1, axis2=2)))

    @property
    def products(self) -> tuple[FloatArray, FloatArray]:
        """(n_others + 2 n, q) matrices A and B with ``A B^T`` likewise the covariance, but for `hidden`."""
        mean, n = self.mean, self.means.shape[1]
        left, right = [], []
        for moved, weight, gain, of in self._by_gain():
            along = np.zeros((len(mean), 3 * n))
            along[: -2 * n, :n], along[-2 * n :, n:] = gain, np.eye(2 * n)
            typical = weight @ moved / weight.sum()
            about, causes = moved - typical, self.causes[of]
            weighed = weight[:, None, None] * (causes @ self.covariances[of])
            small = np.tensordot(weighed, causes, axes=((0, 2), (0, 2)))
            off = (along @ typical - mean)[:, None]
            left += [along @ (small + (about.T * weight) @ about), weight.sum() * off]
            right += [along, off]
        drifts = np.concatenate([self.as_others, np.zeros((2 * n, self.as_others.shape[1]))])
        left.append(drifts @ np.einsum("k,kdc,kec->de", self.weight, self.drifts, self.drifts))
        return np.hstack(left), np.hstack([*right, drifts])

    @property
    def hidden(self) -> FloatArray:
        """(2 n, 2 n) covariance of the latter two that no reading shows."""
        return np.tensordot(self.weight, self.rest, axes=1)

    def _by_gain(self) -> Iterator[tuple[FloatArray, FloatArray, FloatArray, BoolArray]]:
        """Of each gain the mean motions by the causes, the weights, the gain, and which hypotheses have it."""
        moved = np.einsum("kab,kb->ka", self.causes, self.means)
        for number, gain in enumerate(self.gains):
            if (of := self.gain_of == number).any():
                yield moved[of], self.weight[of], gain, of


def at_mean_temperature(state: ArmState, mean_degC: float | None = None) -> ArmState:
    """The state with temperatures about 20 degC instead of about their mean, or that given: lengths are those there."""
    degC = state.temperature_degC
    if degC is None:
        return state
    return replace(state, temperature_degC=degC - (degC.mean() if mean_degC is None else mean_degC) + REFERENCE_DEGC)


def with_material_prior(fit: IdentificationResult, state: ArmState, *, widened: float = 1.0) -> IdentificationResult:
    """Exchange the prior of the thermal expansion.

    A covariance that was widened widens what the readings say of the growth, and not its prior; the estimates are those
    before.

    Parameters
    ----------
    fit : IdentificationResult
        Identified from the state of `at_mean_temperature`.
    state : ArmState
        Of the readings, with their true temperatures.
    widened : float
        Factor by which the covariance of `fit` was widened.

    Returns
    -------
    IdentificationResult
        For true temperatures. Itself if it has no thermal terms. Under repeatability conditions growth remains that by
        the thermometer, as identified: the links follow it as they did.
    """
    grows, terms = _coefficients_of_growth(fit.perturbed_chain)
    if not len(grows) or state.temperature_degC is None:
        return fit
    others, p = np.setdiff1d(np.arange(len(fit.coefficients)), grows), len(fit.coefficients)
    of_growth = fit.covariance[np.ix_(grows, grows)]
    lag_K = max(LAG_K, most_lag_K(state.temperature_degC, state.session, state.stride))
    mean_degC, spread = float(state.temperature_degC.mean()), float(state.temperature_degC.std())
    by_points, lags, u_K = [part.kind for part in fit.references] == ["point"], lag_K > LAG_K, min(lag_K, spread)
    if by_points:
        by_readings = fit.under_repeatability_conditions().covariance / widened
        taus = TIME_CONSTANTS if lags else np.zeros(0)
        histories = link_histories(fit, by_readings, state, grows, others, taus)
    else:
        gain = np.asarray(np.linalg.solve(of_growth, fit.covariance[np.ix_(grows, others)]).T)
        information, right = _likelihood(of_growth / widened, fit.coefficients[grows], fit.prior_std[grows])
        none = np.zeros((0, 1 + len(grows))), np.zeros((len(others), N_DRIFTS))
        histories = [LinkHistory(information, right, gain, *none, mean_degC)]
    gain = histories[0].gain  # with the temperatures and terms by which the arm was identified
    if by_points and lags:
        u_K = 0.0
    else:
        histories = [one for each in histories for one in _shown_in_part(each, lag_K / spread)]
    new = _mixture(histories)
    wide = new if widened == 1 else _mixture(histories, widened)
    # The others, growth, and constants that take the lengths to 20 degC.
    n, mean, beyond = len(others), new.mean, p + np.arange(len(grows))
    mean[:n] += fit.coefficients[others] - gain @ fit.coefficients[grows]
    order = np.argsort(np.concatenate([others, grows, beyond]))
    without = np.concatenate([gain, np.zeros((2 * len(grows), len(grows)))])
    left, right = (np.hstack(both)[order] for both in zip(wide.products, (-without @ of_growth, without), strict=True))
    x, covariance, both = mean[order], left @ right.T, np.concatenate([grows, beyond])
    covariance[np.ix_(both, both)] += wide.hidden
    covariance[p:, p:] += u_K**2 * (covariance[np.ix_(grows, grows)] + np.outer(x[grows], x[grows]))
    new_of_growth = covariance[grows, :p], covariance[:p, grows]  # copies
    covariance[:p, :p] += fit.covariance
    covariance[grows, :p], covariance[:p, grows] = new_of_growth
    covariance = (covariance + covariance.T) / 2
    prior_std = fit.prior_std.copy()
    prior_std[grows] = np.sqrt(UNKNOWN_MATERIAL.covariance(len(grows)).diagonal())
    groups = tuple(
        replace(group, effective=new.effective) if group.name == terms[0].group else group for group in fit.groups
    )
    exchanged = replace(fit, coefficients=x[:p], prior_std=prior_std, groups=groups)
    of_constants = np.hypot(new.mean_degC - REFERENCE_DEGC, u_K) * prior_std[grows]
    warmer = np.full(len(grows), mean_degC - REFERENCE_DEGC)
    same = None if (before := fit.repeatability_covariance) is None else _with_constants(before, grows, warmer)
    return _extended(exchanged, _constants(terms), x[p:], of_constants, covariance, same)


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
    terms = [(replace(term, group=term.group + NOT_LEARNED), value) for term, value in terms]
    added, first, same = [term for term, _ in terms], len(fit.coefficients), fit.repeatability_covariance
    prior = np.diag([float(term.prior_stds[0]) ** 2 for term in added])
    grows = np.flatnonzero([isinstance(term.basis, Temperature) for term in added])
    prior[np.ix_(grows, grows)] = UNKNOWN_MATERIAL.covariance(len(grows))
    sizes = Counter(term.group for term in added)
    groups = (TermGroupResult(name, n, 0.0, 1.0) for name, n in sizes.items())
    both = block_diag(fit.covariance, prior), None if same is None else block_diag(same, prior)
    whole = _extended(fit, added, np.zeros(len(added)), np.sqrt(prior.diagonal()), *both)
    whole = replace(whole, groups=(*fit.groups, *groups))
    return _relative(whole, [(term, k, value) for k, (term, value) in enumerate(terms, first)])


def _shown_in_part(history: LinkHistory, most: float) -> list[LinkHistory]:
    """Histories of links that are behind by any share up to `most`, all as probable."""
    least = max(1 - most, LEAST_SHARE)
    seen = min((1 - LEAST_SHARE) / most, 1.0)
    shares = 1 - (1 - least) * (np.arange(N_LAGS) + 0.5) / N_LAGS
    weighed = [(share, seen / N_LAGS) for share in shares.tolist()] + [(0.0, 1 - seen)] * (seen < 1)
    return [history._replace(share=share, log_evidence=history.log_evidence + np.log(w)) for share, w in weighed]


def _extended(
    fit: IdentificationResult,
    terms: list[Term],
    x: FloatArray,
    prior_std: FloatArray,
    covariance: FloatArray,
    repeatability_covariance: FloatArray | None,
) -> IdentificationResult:
    """The fit with further terms; the covariances are those of all coefficients."""
    return replace(
        fit,
        perturbed_chain=PerturbedChain(fit.perturbed_chain.chain, (*fit.perturbed_chain.terms, *terms)),
        coefficients=np.concatenate([fit.coefficients, x]),
        covariance=covariance,
        repeatability_covariance=repeatability_covariance,
        prior_std=np.concatenate([fit.prior_std, prior_std]),
    )


def _relative(fit: IdentificationResult, terms: list[tuple[Term, int, float]]) -> IdentificationResult:
    """Give terms, each with its coefficient x, a constant beside them: together they are x times (function - value)."""
    terms = [one for one in terms if abs(one[2]) > LEAST_VALUE]
    own = np.array([k for _, k, _ in terms], dtype=np.intp)
    values, same = np.array([value for _, _, value in terms]), fit.repeatability_covariance
    both = _with_constants(fit.covariance, own, values), None if same is None else _with_constants(same, own, values)
    constants = _constants([term for term, _, _ in terms])
    return _extended(fit, constants, -values * fit.coefficients[own], np.abs(values) * fit.prior_std[own], *both)


def _with_constants(covariance: FloatArray, own: IntArray, values: FloatArray) -> FloatArray:
    """The covariance of coefficients x and of ``-values`` times those of the `own` columns."""
    across = -covariance[:, own] * values
    below = np.outer(values, values) * covariance[np.ix_(own, own)]
    return np.block([[covariance, across], [across.T, below]])


def _constants(terms: list[Term]) -> list[Term]:
    """Constants along the same directions, relative to which terms move the tip."""
    return [replace(term, name=f"{term.name}, from the training on", basis=Constant()) for term in terms]


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


def _mixture(histories: Sequence[LinkHistory], widened: float = 1.0) -> _Mixture:
    """The hypotheses of materials and histories, weighed by their evidence.

    Where links changed by a share a of a history, training shows ``a c`` of the expansion c, of each link with some
    slack. Both are sums of independent causes, of which the readings determine some.
    """
    n, every = len(histories[0].right), len(MATERIALS) * list(histories)

    def of_each(name: str) -> FloatArray:
        return np.array([getattr(one, name) for one in every], dtype=float)

    prior = np.repeat([material.covariance(n) for material in MATERIALS], len(histories), axis=0)
    half = np.linalg.cholesky(prior + of_each("slack")[:, None, None] ** 2 * np.eye(n) * prior)
    shown = of_each("share")[:, None, None] * half
    across = shown.transpose(0, 2, 1)
    matrix = across @ of_each("information") @ shown / widened + np.eye(n)
    covariance = np.asarray(np.linalg.inv(matrix), dtype=float)
    right = (across @ of_each("right")[:, :, None])[:, :, 0] / widened
    mean = (covariance @ right[:, :, None])[:, :, 0]
    logs = of_each("log_evidence") + 0.5 * ((right * mean).sum(axis=1) - np.linalg.slogdet(matrix)[1])
    weight = np.exp(logs - logs.max())
    weight /= weight.sum()
    likely = np.flatnonzero(weight > LEAST_WEIGHT)
    shown, mean, warmer = shown[likely], mean[likely], of_each("mean_degC")[likely] - REFERENCE_DEGC
    grown = np.linalg.solve(half[likely], prior[likely]).transpose(0, 2, 1)
    left = prior[likely] - grown @ grown.transpose(0, 2, 1)
    sizes = np.array([[np.ones_like(warmer), -warmer], [-warmer, warmer**2]])
    by_growth = np.concatenate([np.ones((len(likely), 1)), (shown @ mean[:, :, None])[:, :, 0]], axis=1)
    drift = (of_each("drift")[likely] @ by_growth[:, :, None]).reshape(len(likely), -1, N_DRIFTS)
    gains = {id(one.gain): one.gain for one in histories}
    return _Mixture(
        weight[likely],
        list(gains.values()),
        np.array([list(gains).index(id(every[i].gain)) for i in likely.tolist()]),
        np.concatenate([shown, grown, -warmer[:, None, None] * grown], axis=1),
        mean,
        covariance[likely],
        np.einsum("ijk,kab->kiajb", sizes, left).reshape(len(likely), 2 * n, 2 * n),
        histories[0].as_others,
        np.asarray(drift.transpose(0, 2, 1)),
        warmer,
    )
