"""An identified arm in a new set-up: base and tip are new, and the arm is the old one, as far as it has not changed.

An arm was identified in one session. In a new one its base and tip are elsewhere, months may have passed, and its poses
are others. The coefficients of its terms have a normal prior about the identified x, the prediction step of a Kalman
filter (R. E. Kalman, J. Basic Eng. 82 (1960) 35, eq. 24):

    P + tau^2 D    with P their posterior covariance, and D the squares of their prior standard deviations.

A change between the set-ups is a share tau of the size that causes of its kind have in this arm: what moves the tip
much may change much. Base and tip have a flat prior. With J the derivatives of the residuals r by all coefficients, A
those of them by base and tip, R the noise and ``S = R + J (P + tau^2 D) J^T``, base and tip are the generalised least
squares of A under S, and what remains moves the arm by ``(P + tau^2 D) J^T S^-1`` times it: few readings move it
little, and many identify it again.

The share is most probable, by the restricted likelihood of the readings (D. A. Harville, Biometrika 61 (1974) 383),
under a log-normal prior about a tenth. With ``K = J^T (S^-1 - S^-1 A (A^T S^-1 A)^-1 A^T S^-1) J`` and the score
``s = J^T S^-1 r`` without base and tip, its derivative by ``log tau`` is ``tau^2 (s^T D s - tr D K)``, and its Fisher
information ``2 tau^4 |D^1/2 K D^1/2|^2``. For the covariance tau is raised to its root mean square, as the scales of
groups are. The noise is that of the arm before, or larger if the new readings scatter more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from truearm.arm.chain import Chain
from truearm.identification.estimation.group_scales import LOG_SPREAD
from truearm.identification.estimation.identification import reference_fits
from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.linearisation import UNKNOWN_STD, eliminate_unknowns
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.estimation.residual_variance import (
    expected_clipped_square,
    huber_threshold_squared,
    huber_weights,
)
from truearm.identification.estimation.rounds import take_step
from truearm.identification.references.references import Reference
from truearm.identification.terms.basis import Constant
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.solve.group_evidence import GroupedPrior, posterior
from truearm.solve.least_squares_problem import StepHalving
from truearm.solve.linear_algebra import covariance_factor
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray

MOST_ROUNDS = 40
# The last step moves the parameters by a smaller share of their uncertainty.
SETTLED_STEP = 0.01
SETTLED_NOISE = 0.02
SETTLED_SHARE = 0.05
# Groups of constants that do what a free base or tip does: these are new anyhow.
EQUIVALENT = "equivalent to a free"
# Median of the share by which causes change between set-ups before the readings speak, and the largest step of its
# logarithm. Its spread is that of any scale, a factor of 5. What changes by more than its causes are large is another
# arm, or its readings are wrong.
TYPICAL_SHARE, LARGEST_SHARE = 0.1, 1.0
LARGEST_STEP = 1.5


def update_in_set_up(
    fit: IdentificationResult,
    chain: Chain,
    state: ArmState,
    terms: Sequence[Term],
    references: Sequence[Reference],
    *,
    unexplained_std: float,
    robust: bool = True,
    progress: Callable[[int, str], None] | None = None,
) -> IdentificationResult:
    """Identify a few constant terms from new readings, and update all other terms of a fit.

    Parameters
    ----------
    fit : IdentificationResult
        The identified arm.
    chain : Chain
        Its chain, roughly placed in the frame of the new readings.
    state : ArmState
        Of the new readings. The effect of unknown directions of movement counts as noise.
    terms : sequence of Term
        Constant terms that replace those of the fit at the same places along the same directions. The means of their
        priors are the present values.
    references : sequence of Reference
        Of the new readings, one of a kind.
    unexplained_std : float
        Residual standard deviation of the fit [mm]. If the residuals of the updated arm are larger than that, by their
        number less that of the parameters that they determine, it is increased until they are not; it is never
        decreased, as a few readings may agree by chance.
    robust : bool
        Whether large residuals get less weight.
    progress : callable, optional
        Called with the number of rounds and the status.

    Returns
    -------
    IdentificationResult
        The noise of its references is the residual standard deviation, kept or increased.
    """
    known = _followed_by(fit, terms)
    n = len(known.coefficients)
    perturbed_chain, free = PerturbedChain(chain, known.perturbed_chain.terms), np.arange(n - len(terms), n)
    rough = perturbed_chain.tips(state, known.coefficients).T
    started = [reference.initialise(rough[:, reference.rows]) for reference in references]
    problem = SmallMotionProblem(perturbed_chain, state, tuple(reference for reference, _ in started))
    x = np.concatenate([known.coefficients, *(unknowns for _, unknowns in started)])
    parameters = _Parameters(problem, free, x, known.prior_std[free])
    undirected = (fit.direction_effects(state) ** 2).sum(axis=0).mean(axis=1)
    stated = [reference.std**2 + undirected[reference.rows] for reference in problem.references]
    x, residuals = _near(parameters, x, stated, unexplained_std**2, robust=robust)

    kept = np.ones(n)
    kept[free] = 0.0
    known_covariance = known.covariance * np.outer(kept, kept)
    size = np.where(known.columns_of(partial(_may_change, chain)), known.prior_std, 0.0)
    share, variance = _Share(), unexplained_std**2
    # A share that a gross error raised would excuse it: its residual is compared with an arm that changed as usual.
    usual = covariance_factor(known.covariance + np.diag((TYPICAL_SHARE * size) ** 2))
    of_arm = [_arm_variance(perturbed_chain, state.rows(part.rows), x[:n], usual) for part in problem.references]
    for n_rounds in range(1, MOST_ROUNDS + 1):
        root = covariance_factor(known_covariance + np.diag((share.typical * size) ** 2))
        weighed = _weighed(stated, residuals, variance, of_arm, robust=robust)
        update = parameters.at(x, weighed, root)
        x = x + update.step
        residuals = problem.residuals(x)
        if progress is not None:
            progress(n_rounds, f"noise: {np.sqrt(variance):.4f} mm")
        freedom = max(weighed.freedom + parameters.n_constraints(x) - update.n_determined, 1.0)
        grown = max(variance * (update.square - weighed.excess) / freedom, unexplained_std**2)
        newer = share.after(*update.evidence_of_change(size))
        converged = (
            update.size < SETTLED_STEP
            and abs(grown - variance) < SETTLED_NOISE * variance
            and abs(newer.log_ratio - share.log_ratio) < SETTLED_SHARE
        )
        if converged:
            break
        share, variance = newer, grown
    root = covariance_factor(known_covariance + np.diag((share.root_mean_square * size) ** 2))
    wide = parameters.at(x, weighed, root)
    determined = wide.free_covariance.diagonal()[: len(free)] / parameters.prior_std**2
    return IdentificationResult(
        perturbed_chain,
        x[:n],
        wide.covariance,
        known.prior_std,
        _groups(fit, terms, 1 - determined),
        reference_fits(problem, x, residuals, np.full(len(references), np.sqrt(variance)), weighed.robust_weights),
        converged,
        n_rounds,
    )


def _may_change(chain: Chain, term: Term) -> bool:
    """Whether a term is the arm's own: not base and tip, nor what does the same."""
    is_of_joint = 1 <= term.place <= chain.n_joints or not isinstance(term.basis, Constant)
    return is_of_joint and not term.group.startswith(EQUIVALENT)


@dataclass(frozen=True)
class _Share:
    """The share tau by which causes change: the logarithm of its ratio to the typical one, and the variance of that."""

    log_ratio: float = 0.0
    log_variance: float = 0.0

    @property
    def typical(self) -> float:
        return TYPICAL_SHARE * float(np.exp(self.log_ratio))

    @property
    def root_mean_square(self) -> float:
        return self.typical * float(np.exp(self.log_variance))

    def after(self, squares: float, expected: float, information: float) -> _Share:
        """A step of Fisher's scoring: squares of the score, their expectation, and its square, by D."""
        by_prior, tau2 = LOG_SPREAD**-2.0, self.typical**2
        variance = 1 / (2 * tau2**2 * information + by_prior)
        step = variance * (tau2 * (squares - expected) - by_prior * self.log_ratio)
        ratio = self.log_ratio + float(np.clip(step, -LARGEST_STEP, LARGEST_STEP))
        return _Share(min(ratio, float(np.log(LARGEST_SHARE / TYPICAL_SHARE))), variance)


@dataclass(frozen=True, eq=False)
class _Update:
    """The most probable parameters by linearised equations, and their covariance.

    Attributes
    ----------
    step : (p,) array
        From the point of linearisation.
    size : float
        Of the step of the free parameters, root mean square in standard uncertainties.
    square : float
        Sum of the squares of the weighted residuals afterwards.
    n_determined : float
        Number of parameters that the residuals determine.
    gram : (k, k) array
        Normal matrix of the residuals, of the coefficients and the free parameters.
    score : (n,) array
        Derivative of half the square afterwards by the coefficients, with the opposite sign.
    of_arm : (q, n) array
        Root of the covariance of the coefficients where the free parameters are given.
    lead : (n, m) array
        What the coefficients change by with the m free parameters.
    free_covariance : (m, m) array
        Of these.
    which : (m,) int array
        Their places among the k.
    """

    step: FloatArray
    size: float
    square: float
    n_determined: float
    gram: FloatArray
    score: FloatArray
    of_arm: FloatArray
    lead: FloatArray
    free_covariance: FloatArray
    which: IntArray

    @property
    def covariance(self) -> FloatArray:
        """(n, n) of the coefficients, symmetric and without negative variances by its form."""
        covariance = self.of_arm.T @ self.of_arm + self.lead @ self.free_covariance @ self.lead.T
        return np.asarray((covariance + covariance.T) / 2)

    def evidence_of_change(self, size: FloatArray) -> tuple[float, float, float]:
        """``s^T D s``, ``tr D K`` and ``|D^1/2 K D^1/2|^2`` for the `size` D^1/2 (n,) of changes."""
        n = len(size)
        seen = self.of_arm @ self.gram[:n]
        information = self.gram[:n, :n] - seen[:, :n].T @ seen[:, :n]
        of_free = self.gram[:n, self.which] - seen[:, :n].T @ seen[:, self.which]
        information -= of_free @ self.free_covariance @ of_free.T
        information *= np.outer(size, size)
        return float(((size * self.score) ** 2).sum()), float(np.trace(information)), float((information**2).sum())


class _Weighed(NamedTuple):
    """Weights of the residuals.

    `weights` (k, m) and `robust_weights` (m,) of every reference, `freedom` of all residuals, and `excess`, the part of
    the sum of squares of large residuals above their clipped size.
    """

    weights: list[FloatArray]
    robust_weights: list[FloatArray]
    freedom: float
    excess: float


@dataclass(frozen=True, eq=False)
class _Parameters:
    """All parameters with their `prior_mean`; the free ones are new coefficients, and unknowns of artefacts."""

    problem: SmallMotionProblem
    free: IntArray
    prior_mean: FloatArray
    prior_std: FloatArray

    def at(self, x: FloatArray, weighed: _Weighed, root: FloatArray) -> _Update:
        """Linearise and solve, with the `root` F of the prior covariance ``F^T F`` of the coefficients.

        With the Gauss-Newton matrix G of all parameters, S^-1 enters by the factor of ``I + F G F^T``.
        """
        parts, whole = self.problem.equations(x, weighed.weights)
        n = root.shape[1]
        with one_blas_thread():
            reduced = eliminate_unknowns(parts, whole, x - self.prior_mean)
            gram, away = reduced.gram, (x - self.prior_mean)[reduced.kept]
            right = gram @ away - reduced.gradient
            which = np.concatenate([self.free, np.arange(n, len(gram))])
            matrix = root @ gram[:n, :n] @ root.T
            matrix.flat[:: len(matrix) + 1] += 1.0
            lower = np.asarray(cholesky(matrix, lower=True)) if len(matrix) else matrix
            of_arm = _by_factor(lower, root)
            seen = of_arm @ gram[:n]
            across, along = seen[:, which], of_arm @ right[:n]
            own = gram[np.ix_(which, which)] - across.T @ across
            found = posterior(own, right[which] - across.T @ along, self._prior(len(which)))
            lead = -of_arm.T @ across
            lead[self.free, np.arange(len(self.free))] += 1.0
            off = np.zeros(len(gram))
            off[which] = found.x
            off[:n] = of_arm.T @ along + lead @ found.x
            of_kept = off - away
            score = (right - gram @ off)[:n]
        length = max(float(of_kept[which] @ own @ of_kept[which]), 0.0)
        square = 2 * whole.cost - reduced.gain + of_kept @ (2 * reduced.gradient + gram @ of_kept)
        of_free = own - (twice := _by_factor(lower, across, transposed=True)).T @ twice
        n_determined = reduced.n_determined + np.vdot(of_arm, seen[:, :n]) + np.vdot(of_free, found.covariance)
        return _Update(
            reduced.step(of_kept),
            float(np.sqrt(length / len(which))),
            float(square),
            float(n_determined),
            gram,
            score,
            of_arm,
            lead,
            found.covariance,
            which,
        )

    def _prior(self, n: int) -> GroupedPrior:
        ratio = np.concatenate([self.prior_std, np.full(n - len(self.free), UNKNOWN_STD)])
        return GroupedPrior(ratio, np.zeros(n, dtype=np.intp), np.ones(1), np.zeros(1, dtype=bool))

    def n_constraints(self, x: FloatArray) -> int:
        """Number of constraints among the unknowns."""
        problem = self.problem
        found = [reference.constraints(x[problem.unknowns_of(i)]) for i, reference in enumerate(problem.references)]
        return sum(len(constraints.residuals) for constraints in found if constraints is not None)


def _near(
    parameters: _Parameters, x: FloatArray, stated: list[FloatArray], variance: float, *, robust: bool
) -> tuple[FloatArray, list[FloatArray]]:
    """Bring `x` near the minimum, as if the arm were known exactly; also return the residuals there."""
    problem = parameters.problem
    residuals = problem.residuals(x)
    for _ in range(MOST_ROUNDS):
        # Until then residuals are large for another reason than noise.
        typical = max([variance, *(float(np.median((r**2).mean(axis=0))) for r in residuals)])
        nothing = [np.zeros(r.shape[1]) for r in residuals]
        weighed = _weighed(stated, residuals, typical, nothing, robust=robust)
        left = parameters.at(x, weighed, np.zeros((0, problem.perturbed_chain.n_coefficients)))
        x, residuals = take_step(
            problem, x, residuals, left.step, partial(_cost, problem, weighed), StepHalving(max_halvings=11)
        )
        if left.size < 1.0:
            break
    return x, residuals


def _cost(problem: SmallMotionProblem, weighed: _Weighed, x: FloatArray, residuals: list[FloatArray]) -> float:
    data = sum(float(((w * r) ** 2).sum()) for w, r in zip(weighed.weights, residuals, strict=True))
    return data / 2 + problem.constraints_cost(x)


def _weighed(
    stated: list[FloatArray], residuals: list[FloatArray], variance: float, of_arm: list[FloatArray], *, robust: bool
) -> _Weighed:
    """Weights under a noise and the `stated` variances (k, m).

    Residuals are large compared with these and the variance by the uncertainty of the arm, `of_arm` (m,).
    """
    weights, robust_weights = [], []
    freedom = excess = 0.0
    for known, residual, arm in zip(stated, residuals, of_arm, strict=True):
        k, m = residual.shape
        noise = known + variance
        # Squared, as an arm that follows the readings would follow a gross error: its pull falls with its size.
        robust_weight = huber_weights(residual.T, (noise + arm).T) ** 2 if robust else np.ones(m)
        weights.append(np.sqrt(robust_weight / noise))
        robust_weights.append(robust_weight)
        freedom += m * (expected_clipped_square(k) if robust else k)
        large = robust_weight < 1
        excess += float(((weights[-1] * residual)[:, large] ** 2).sum()) - huber_threshold_squared(k) * int(large.sum())
    return _Weighed(weights, robust_weights, freedom, excess)


def _arm_variance(perturbed_chain: PerturbedChain, state: ArmState, x: FloatArray, root: FloatArray) -> FloatArray:
    """(m,) variance of a tip's coordinate by the arm's uncertainty, its mean over the three [mm^2]."""
    found = [
        ((root @ columns.reshape(len(columns), -1)) ** 2).sum(axis=0).reshape(columns.shape[1:]).mean(axis=0)
        for _, _, columns in perturbed_chain.derivatives(state, x)
    ]
    return np.concatenate(found)


def _followed_by(fit: IdentificationResult, free: Sequence[Term]) -> IdentificationResult:
    """The fit with its coefficients in the order of the terms that stay, followed by the free ones."""
    places = {(term.place, term.direction): i for i, term in enumerate(free)}

    def is_replaced(term: Term) -> bool:
        return isinstance(term.basis, Constant) and (term.place, term.direction) in places

    replaced = fit.columns_of(is_replaced)
    kept = [term for term in fit.perturbed_chain.terms if not is_replaced(term)]
    n_kept = int((~replaced).sum())
    where = np.empty(len(replaced), dtype=np.intp)
    where[~replaced] = np.arange(n_kept)
    gone = filter(is_replaced, fit.perturbed_chain.terms)
    where[replaced] = [n_kept + places[term.place, term.direction] for term in gone]
    gather = np.zeros((n_kept + len(free), len(where)))
    gather[where, np.arange(len(where))] = 1.0
    prior_std = gather @ fit.prior_std
    prior_std[n_kept:] = [term.prior_stds[0] for term in free]
    return replace(
        fit,
        perturbed_chain=PerturbedChain(fit.perturbed_chain.chain, (*kept, *free)),
        coefficients=gather @ fit.coefficients,
        covariance=gather @ fit.covariance @ gather.T,
        prior_std=prior_std,
    )


def _by_factor(lower: FloatArray, right: FloatArray, *, transposed: bool = False) -> FloatArray:
    if not len(lower):  # LAPACK refuses matrices without rows
        return right
    matrix = lower.T if transposed else lower
    return np.asarray(solve_triangular(matrix, right, lower=not transposed, check_finite=False))


def _groups(fit: IdentificationResult, terms: Sequence[Term], determined: FloatArray) -> tuple[TermGroupResult, ...]:
    """Groups of the fit, and those of the new terms with the number that the new readings determine."""
    names = tuple(dict.fromkeys(term.group for term in terms))
    share = {name: [float(d) for t, d in zip(terms, determined, strict=False) if t.group == name] for name in names}
    old = tuple(group for group in fit.groups if group.name not in names)
    return old + tuple(
        TermGroupResult(name, len(part), float(np.clip(sum(part), 0, None)), 1.0) for name, part in share.items()
    )
