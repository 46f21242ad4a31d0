"""Consider update: identify a few parameters again, while all others keep their values and their uncertainty.

An arm was identified in one session; in a new session only its base and its tip are new. The other parameters are
*considered*: their posterior covariance P contributes to the covariance of a new residual,

    S = R + J P J^T        with R the noise and J the derivatives by all parameters,

and to the uncertainty of the new parameters, but the few new readings do not change them. The estimate is the frame in
which the unchanged arm fits the readings best: with A the columns of J of the free parameters, without prior, the gain
is ``K = (A^T R^-1 A)^-1 A^T R^-1``. (With S in place of R the frame has less variance, but residuals that resemble an
uncertain motion of the arm would be attributed to the arm; as the arm is not changed, they would remain in the tips.)
With E that places the free parameters among all parameters, the covariance afterwards is

    (I - E K J) P (I - E K J)^T + E K R K^T E^T        (Joseph's form, which holds for any gain),

in which the error of the frame compensates that of the arm, as far as the frame absorbed it. Source:
S. F. Schmidt, "Application of state-space methods to navigation problems", Advances in Control Systems 3 (1966) 293;
B. D. Tapley, B. E. Schutz, G. H. Born, "Statistical Orbit Determination", 2004, chapter 6.

An error of the reference that all readings share, the scale of a tracker, is considered too: no reading shows it, and
none of the coefficients stands for it. With the normal matrix ``Sigma^-1``, an error e of the points moves the
coefficients by ``g = Sigma J^T W e``; with its standard uncertainty in e their covariance is ``Sigma + g g^T`` (JCGM
100:2008, 5.2.2, for correlation 1). So the error of a predicted point is about that of the points around it, and
distances have the error of the scale.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from truearm.arm.chain import Chain
from truearm.identification.estimation.identification import reference_fits
from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.linearisation import UNKNOWN_STD, eliminate_unknowns
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.estimation.propagation import direction_effects
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
from truearm.solve import StepHalving
from truearm.solve.group_evidence import GroupedPrior, Posterior, posterior
from truearm.solve.square_roots import covariance_factor
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray

MOST_ROUNDS = 40
# The last step moves the new parameters by a smaller share of their uncertainty.
SETTLED_STEP = 0.01
SETTLED_NOISE = 0.02


def consider_update(
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
    """Identify a few constant terms from new readings and keep all other terms of a fit.

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
        Residual standard deviation of the fit [mm]. If ``r^T S^-1 r`` of the new residuals is larger than its
        expectation, their number less that of the free parameters, it is increased until it is not; it is never
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
    parameters = _FreeParameters(problem, free, x, known.prior_std[free])
    undirected = (direction_effects(fit, state) ** 2).sum(axis=0).mean(axis=1)
    stated = [reference.std**2 + undirected[reference.rows] for reference in problem.references]
    x, residuals = _near(parameters, x, stated, unexplained_std**2, robust=robust)

    root = covariance_factor(known.covariance)
    of_arm = [_arm_variance(perturbed_chain, state.rows(reference.rows), x[:n], root) for reference in references]
    variance, converged, nothing = unexplained_std**2, False, np.zeros((0, n))
    for n_rounds in range(1, MOST_ROUNDS + 1):
        weighed = _weighed(stated, residuals, variance, of_arm, robust=robust)
        left, found = parameters.at(x, weighed, nothing)
        x = x + left.step
        residuals = problem.residuals(x)
        if progress is not None:
            progress(n_rounds, f"noise: {np.sqrt(variance):.4f} mm")
        if left.size > SETTLED_STEP:
            continue
        of_noise, _ = parameters.at(x, weighed, root)
        freedom = max(weighed.freedom + parameters.n_constraints(x) - of_noise.n_determined, 1.0)
        grown = max(variance * (of_noise.square - weighed.excess) / freedom, unexplained_std**2)
        converged = abs(grown - variance) < SETTLED_NOISE * variance
        if converged:
            break
        variance = grown
    return IdentificationResult(
        perturbed_chain,
        x[:n],
        _joseph(root, free, left, found),
        known.prior_std,
        _groups(fit, terms, 1 - found.covariance.diagonal()[: len(free)] / parameters.prior_std**2),
        reference_fits(problem, x, np.full(len(references), np.sqrt(variance)), weighed.robust_weights),
        converged,
        n_rounds,
    )


class _ReducedSystem(NamedTuple):
    """Least-squares system of the free parameters, with the considered ones integrated out.

    `pull` is ``A^T R^-1 J`` of all coefficients, `square` the minimum of ``r^T S^-1 r``, `n_determined` the number of
    free parameters that the residuals determine, `step` the step to the minimum from the point of linearisation, and
    `size` its root mean square in standard uncertainties.
    """

    pull: FloatArray
    square: float
    n_determined: float
    step: FloatArray
    size: float


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
class _FreeParameters:
    """The free parameters: new coefficients, and unknowns of artefacts; all parameters have the `prior_mean`."""

    problem: SmallMotionProblem
    free: IntArray
    prior_mean: FloatArray
    prior_std: FloatArray

    def at(self, x: FloatArray, weighed: _Weighed, root: FloatArray) -> tuple[_ReducedSystem, Posterior]:
        """Linearise and solve for the free parameters, with considered parameters whose covariance has the `root`.

        With the root F, ``P = F^T F``, and the Gauss-Newton matrix G of all parameters, S^-1 enters by the factor of
        ``I + F G F^T``.
        """
        parts, whole = self.problem.equations(x, weighed.weights)
        n = root.shape[1]
        with one_blas_thread():
            reduced = eliminate_unknowns(parts, whole, x - self.prior_mean)
            gram, gradient = reduced.gram, reduced.gradient
            which = np.concatenate([self.free, np.arange(n, len(reduced.kept))])
            matrix = root @ gram[:n, :n] @ root.T
            matrix.flat[:: len(matrix) + 1] += 1.0
            lower = np.asarray(cholesky(matrix, lower=True)) if len(matrix) else matrix
            across = _by_factor(lower, root @ gram[:n, which])
            along = _by_factor(lower, root @ gradient[:n])
            own, downhill = gram[np.ix_(which, which)] - across.T @ across, gradient[which] - across.T @ along
            away = (x - self.prior_mean)[reduced.kept[which]]
            found = posterior(own, own @ away - downhill, self._prior(len(which)))
            of_sought = found.x - away
            of_kept = np.zeros(len(reduced.kept))
            of_kept[which] = of_sought
            # Solve for the artefacts jointly with the considered parameters, then keep the latter unchanged.
            considered = -(root.T @ _by_factor(lower, along + across @ of_sought, transposed=True))
            step = reduced.step(of_kept + np.concatenate([considered, np.zeros(len(reduced.kept) - n)]))
            step[reduced.kept] = of_kept
        length = max(float(of_sought @ own @ of_sought), 0.0)
        square = 2 * whole.cost - reduced.gain - float(along @ along) - length
        n_determined = reduced.n_determined + float(np.vdot(own, found.covariance))
        return _ReducedSystem(
            gram[which, :n], square, n_determined, step, float(np.sqrt(length / len(of_sought)))
        ), found

    def _prior(self, n: int) -> GroupedPrior:
        ratio = np.concatenate([self.prior_std, np.full(n - len(self.free), UNKNOWN_STD)])
        return GroupedPrior(ratio, np.zeros(n, dtype=np.intp), np.ones(1), np.zeros(1, dtype=bool))

    def n_constraints(self, x: FloatArray) -> int:
        """Number of constraints among the unknowns."""
        problem = self.problem
        found = [reference.constraints(x[problem.unknowns_of(i)]) for i, reference in enumerate(problem.references)]
        return sum(len(constraints.residuals) for constraints in found if constraints is not None)


def _near(
    parameters: _FreeParameters, x: FloatArray, stated: list[FloatArray], variance: float, *, robust: bool
) -> tuple[FloatArray, list[FloatArray]]:
    """Bring `x` near the minimum, as if the arm were known exactly; also return the residuals there."""
    problem = parameters.problem
    residuals = problem.residuals(x)
    for _ in range(MOST_ROUNDS):
        # Until then residuals are large for another reason than noise.
        typical = max([variance, *(float(np.median((r**2).mean(axis=0))) for r in residuals)])
        nothing = [np.zeros(r.shape[1]) for r in residuals]
        weighed = _weighed(stated, residuals, typical, nothing, robust=robust)
        left, _ = parameters.at(x, weighed, np.zeros((0, problem.perturbed_chain.n_coefficients)))
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
    stated: list[FloatArray],
    residuals: list[FloatArray],
    variance: float,
    of_arm: list[FloatArray],
    *,
    robust: bool,
) -> _Weighed:
    """Weights under a noise and the `stated` variances (k, m).

    Residuals are large compared with these and the variance by the uncertainty of the arm, `of_arm` (m,).
    """
    weights, robust_weights = [], []
    freedom = excess = 0.0
    for known, residual, arm in zip(stated, residuals, of_arm, strict=True):
        k, m = residual.shape
        noise = known + variance
        robust_weight = huber_weights(residual.T, (noise + arm).T) if robust else np.ones(m)
        weights.append(np.sqrt(robust_weight / noise))
        robust_weights.append(robust_weight)
        freedom += m * (expected_clipped_square(k) if robust else k)
        excess += huber_threshold_squared(k) * float((1 / robust_weight - 1).sum())
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


def _joseph(root: FloatArray, free: IntArray, left: _ReducedSystem, found: Posterior) -> FloatArray:
    """Covariance of all coefficients afterwards, symmetric and without negative variances by its form."""
    k = len(free)
    half = root.copy()
    half[:, free] -= root @ (found.covariance[:k] @ left.pull).T
    covariance = half.T @ half
    covariance[np.ix_(free, free)] += found.covariance[:k, :k]
    return (covariance + covariance.T) / 2


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


def response_to_point_errors(fit: IdentificationResult, state: ArmState, errors: FloatArray) -> FloatArray:
    """Change of the coefficients by errors of the points, to first order.

    Parameters
    ----------
    fit : IdentificationResult
        At the minimum, with the covariance of the readings.
    state : ArmState
        Of all n readings.
    errors : (n, 3) array
        Of the points, in the frame of the chain [mm].

    Returns
    -------
    (n_coefficients,) array
        Zeros if no reading has a point.
    """
    gradient = np.zeros(len(fit.coefficients))
    for reference in fit.references:
        if reference.kind == "point":
            pulls = np.zeros((3, len(state)))
            pulls[:, reference.rows] = reference.weights**2 * errors[reference.rows].T
            for rows, _, columns in fit.perturbed_chain.derivatives(state, fit.coefficients):
                gradient += np.tensordot(columns, pulls[:, rows], axes=2)
    return np.asarray(fit.covariance @ gradient)


def with_shared_error(fit: IdentificationResult, response: FloatArray) -> IdentificationResult:
    """Add the covariance of an error to which the first coefficients respond by `response` for a standard uncertainty.

    Terms that were added since do not respond.
    """
    if not response.any():
        return fit
    shared, k = np.outer(response, response), len(fit.coefficients) - len(response)
    shared, same = np.pad(shared, (0, k)), fit.repeatability_covariance
    return replace(
        fit,
        covariance=fit.covariance + shared,
        repeatability_covariance=None if same is None else same + shared,
    )
