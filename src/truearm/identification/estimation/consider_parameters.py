"""A few parameters identified anew, while all others keep their values and their uncertainty.

An arm is known from one session, and a new one asks only where its base stands and its tip sits now. The other
parameters are *considered*: their posterior covariance P from before is part of what a new residual may be,

    S = R + J P J^T        with R the noise and J the derivatives by all parameters,

and part of how uncertain the new ones come out; but the few new readings do not change them. What serves is then the
frame in which the arm, as it is, meets the readings best: with A the columns of J that are sought anew, as if nothing
were known of them, the gain is ``K = (A^T R^-1 A)^-1 A^T R^-1``. (With S for R the frame itself has less variance, but
what looks like an uncertain motion of the arm is left to that; as the arm stays as it is, it stays in the tips.) With E
that puts the sought among all parameters, the covariance afterwards is

    (I - E K J) P (I - E K J)^T + E K R K^T E^T        (Joseph's form, which holds for any gain),

in which the error of the frame makes up for that of the arm, as far as the one took up the other. Source:
S. F. Schmidt, "Application of state-space methods to navigation problems", Advances in Control Systems 3 (1966) 293;
B. D. Tapley, B. E. Schutz, G. H. Born, "Statistical Orbit Determination", 2004, chapter 6.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from truearm.arm.chain import Chain
from truearm.identification.estimation.identification import (
    UNKNOWN_STD,
    IdentificationResult,
    TermGroupResult,
    eliminate_unknowns,
    reference_fits,
    take_step,
)
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.estimation.propagation import direction_effects
from truearm.identification.estimation.references import Reference
from truearm.identification.estimation.residual_variance import (
    expected_clipped_square,
    huber_threshold_squared,
    huber_weights,
)
from truearm.identification.terms.basis import Constant
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.solve import StepHalving
from truearm.solve.group_evidence import GroupedPrior, Posterior, posterior
from truearm.solve.square_roots import covariance_factor
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray

MOST_ROUNDS = 40
# A step is the last when it moves the new parameters by a smaller share of their uncertainty.
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
    """Identify a few constant terms from new readings, and keep all other terms of a fit.

    Parameters
    ----------
    fit : IdentificationResult
        The arm as it is known.
    chain : Chain
        Its chain, put roughly to where the new readings saw it.
    state : ArmState
        Of the new readings. What directions of movement leave open that it does not know is noise of theirs.
    terms : sequence of Term
        Constant, in place of those that the fit has at the same places along the same directions. Their priors are
        about where these are now.
    references : sequence of Reference
        Of the new readings, one of a kind.
    unexplained_std : float
        Standard deviation of a residual that neither the terms nor the references explain [mm], as it was before.
        Where ``r^T S^-1 r`` of the new residuals is larger than its expectation, their number less that of what was
        sought, it grows to where it is not; it never shrinks, as a few readings may agree by chance.
    robust : bool
        Whether far residuals weigh less.
    progress : callable, optional
        Told the rounds done and how it stands.

    Returns
    -------
    IdentificationResult
        The noise of its references is the one that was kept or found.
    """
    merged = _merged(fit, terms)
    perturbed_chain, n = PerturbedChain(chain, merged.terms), len(merged.x)
    rough = perturbed_chain.tips(state, merged.x).T
    started = [reference.initialise(rough[:, reference.rows]) for reference in references]
    problem = SmallMotionProblem(perturbed_chain, state, tuple(reference for reference, _ in started))
    x = np.concatenate([merged.x, *(unknowns for _, unknowns in started)])
    sought = _FreeParameters(problem, merged.anew, x, merged.prior_std[merged.anew])
    undirected = (direction_effects(fit, state) ** 2).sum(axis=0).mean(axis=1)
    stated = [reference.std**2 + undirected[reference.rows] for reference in problem.references]
    x, residuals = _near(sought, x, stated, unexplained_std**2, robust=robust)

    root = covariance_factor(merged.covariance)
    of_arm = [_arm_variance(perturbed_chain, state.rows(reference.rows), x[:n], root) for reference in references]
    variance, converged, nothing = unexplained_std**2, False, np.zeros((0, n))
    for n_rounds in range(1, MOST_ROUNDS + 1):
        weighed = _weighed(stated, residuals, variance, of_arm, robust=robust)
        left, found = sought.at(x, weighed, nothing)
        x = x + left.step
        residuals = problem.residuals(x)
        if progress is not None:
            progress(n_rounds, f"unexplained: {np.sqrt(variance):.4f} mm")
        if left.size > SETTLED_STEP:
            continue
        of_noise, _ = sought.at(x, weighed, root)
        freedom = max(weighed.freedom + sought.n_constraints(x) - of_noise.told, 1.0)
        grown = max(variance * (of_noise.square - weighed.beyond) / freedom, unexplained_std**2)
        converged = abs(grown - variance) < SETTLED_NOISE * variance
        if converged:
            break
        variance = grown
    return IdentificationResult(
        perturbed_chain,
        x[:n],
        _joseph(root, merged.anew, left, found),
        merged.prior_std,
        _groups(fit, terms, 1 - found.covariance.diagonal()[: len(merged.anew)] / sought.prior_std**2),
        reference_fits(problem, x, np.full(len(references), np.sqrt(variance)), weighed.trust),
        converged,
        n_rounds,
    )


class _Merged(NamedTuple):
    """Terms and coefficients of before, with those to be identified anew behind them."""

    terms: tuple[Term, ...]
    x: FloatArray
    covariance: FloatArray
    prior_std: FloatArray
    anew: IntArray


class _ReducedSystem(NamedTuple):
    """What the residuals say of the parameters sought, with the considered ones integrated out.

    `pull` is ``A^T R^-1 J`` of all coefficients, `square` the least ``r^T S^-1 r``. `told` counts what the residuals
    determine of what is sought, `step` leads there from where it was linearised, and `size` is its root mean square in
    standard uncertainties.
    """

    pull: FloatArray
    square: float
    told: float
    step: FloatArray
    size: float


class _Weighed(NamedTuple):
    """How much the residuals count.

    `weights` (k, m) and `trust` (m,) of every reference, `freedom` of all residuals, and `beyond`, which far ones add
    to the sum of squares beyond what they may.
    """

    weights: list[FloatArray]
    trust: list[FloatArray]
    freedom: float
    beyond: float


@dataclass(frozen=True, eq=False)
class _FreeParameters:
    """The parameters sought: new coefficients `anew`, and what is unknown of artefacts, about where all `prior_mean`."""

    problem: SmallMotionProblem
    anew: IntArray
    prior_mean: FloatArray
    prior_std: FloatArray

    def at(self, x: FloatArray, weighed: _Weighed, root: FloatArray) -> tuple[_ReducedSystem, Posterior]:
        """Linearise, and find them with considered parameters of the covariance that `root` is of.

        With the root F, ``P = F^T F``, and the Gauss-Newton matrix G of all parameters, S^-1 enters by the factor of
        ``I + F G F^T``.
        """
        parts, whole = self.problem.equations(x, weighed.weights)
        n = root.shape[1]
        with one_blas_thread():
            left = eliminate_unknowns(parts, whole, x - self.prior_mean)
            gram, gradient = left.gram, left.gradient
            which = np.concatenate([self.anew, np.arange(n, len(left.kept))])
            matrix = root @ gram[:n, :n] @ root.T
            matrix.flat[:: len(matrix) + 1] += 1.0
            lower = np.asarray(cholesky(matrix, lower=True)) if len(matrix) else matrix
            across = _by_factor(lower, root @ gram[:n, which])
            along = _by_factor(lower, root @ gradient[:n])
            own, downhill = gram[np.ix_(which, which)] - across.T @ across, gradient[which] - across.T @ along
            away = (x - self.prior_mean)[left.kept[which]]
            found = posterior(own, own @ away - downhill, self._prior(len(which)))
            of_sought = found.x - away
            of_kept = np.zeros(len(left.kept))
            of_kept[which] = of_sought
            # The artefacts lie where they do best together with the considered ones, which then stay all the same.
            considered = -(root.T @ _by_factor(lower, along + across @ of_sought, transposed=True))
            step = left.step(of_kept + np.concatenate([considered, np.zeros(len(left.kept) - n)]))
            step[left.kept] = of_kept
        length = max(float(of_sought @ own @ of_sought), 0.0)
        square = 2 * whole.cost - left.gain - float(along @ along) - length
        told = left.n_determined + float(np.vdot(own, found.covariance))
        return _ReducedSystem(gram[which, :n], square, told, step, float(np.sqrt(length / len(of_sought)))), found

    def _prior(self, n: int) -> GroupedPrior:
        ratio = np.concatenate([self.prior_std, np.full(n - len(self.anew), UNKNOWN_STD)])
        return GroupedPrior(ratio, np.zeros(n, dtype=np.intp), np.ones(1), np.zeros(1, dtype=bool))

    def n_constraints(self, x: FloatArray) -> int:
        """How many residuals there are among the unknowns alone."""
        problem = self.problem
        found = [reference.constraints(x[problem.unknowns_of(i)]) for i, reference in enumerate(problem.references)]
        return sum(len(constraints.residuals) for constraints in found if constraints is not None)


def _near(
    sought: _FreeParameters, x: FloatArray, stated: list[FloatArray], variance: float, *, robust: bool
) -> tuple[FloatArray, list[FloatArray]]:
    """Bring `x` near the minimum: downhill, as if the arm were known exactly; and the residuals there."""
    problem = sought.problem
    residuals = problem.residuals(x)
    for _ in range(MOST_ROUNDS):
        # Residuals are large for another reason than noise as yet.
        typical = max([variance, *(float(np.median((r**2).mean(axis=0))) for r in residuals)])
        nothing = [np.zeros(r.shape[1]) for r in residuals]
        weighed = _weighed(stated, residuals, typical, nothing, robust=robust)
        left, _ = sought.at(x, weighed, np.zeros((0, problem.perturbed_chain.n_coefficients)))
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
    """Weights under a noise and variances `stated` (k, m) besides.

    Residuals are far beside these and what the arm's uncertainty `of_arm` (m,) makes of them.
    """
    weights, trusts = [], []
    freedom = beyond = 0.0
    for known, residual, arm in zip(stated, residuals, of_arm, strict=True):
        k, m = residual.shape
        noise = known + variance
        trust = huber_weights(residual.T, (noise + arm).T) if robust else np.ones(m)
        weights.append(np.sqrt(trust / noise))
        trusts.append(trust)
        freedom += m * (expected_clipped_square(k) if robust else k)
        beyond += huber_threshold_squared(k) * float((1 / trust - 1).sum())
    return _Weighed(weights, trusts, freedom, beyond)


def _arm_variance(perturbed_chain: PerturbedChain, state: ArmState, x: FloatArray, root: FloatArray) -> FloatArray:
    """(m,) variance of a tip's coordinate by the arm's uncertainty, its mean over the three [mm^2]."""
    found = [
        ((root @ columns.reshape(len(columns), -1)) ** 2).sum(axis=0).reshape(columns.shape[1:]).mean(axis=0)
        for _, _, columns in perturbed_chain.derivatives(state, x)
    ]
    return np.concatenate(found)


def _merged(fit: IdentificationResult, anew: Sequence[Term]) -> _Merged:
    places = {(term.place, term.direction): i for i, term in enumerate(anew)}
    # Of every coefficient of before, where it stands now: among those kept, or from the end.
    where: list[int] = []
    kept: list[Term] = []
    n_kept = 0
    for term in fit.perturbed_chain.terms:
        i = places.get((term.place, term.direction)) if isinstance(term.basis, Constant) else None
        if i is not None:
            where.append(i - len(anew))
        else:
            where += range(n_kept, n_kept + term.n_coefficients)
            kept.append(term)
            n_kept += term.n_coefficients
    n = n_kept + len(anew)
    gather = np.zeros((n, len(where)))
    gather[np.array(where, dtype=np.intp) % n, np.arange(len(where))] = 1.0
    prior_std = gather @ fit.prior_std
    prior_std[n_kept:] = [term.prior_stds[0] for term in anew]
    return _Merged(
        (*kept, *anew), gather @ fit.coefficients, gather @ fit.covariance @ gather.T, prior_std, np.arange(n_kept, n)
    )


def _joseph(root: FloatArray, anew: IntArray, left: _ReducedSystem, found: Posterior) -> FloatArray:
    """Covariance of all coefficients afterwards, symmetric and without negative variances by its form."""
    k = len(anew)
    half = root.copy()
    half[:, anew] -= root @ (found.covariance[:k] @ left.pull).T
    covariance = half.T @ half
    covariance[np.ix_(anew, anew)] += found.covariance[:k, :k]
    return (covariance + covariance.T) / 2


def _by_factor(lower: FloatArray, right: FloatArray, *, transposed: bool = False) -> FloatArray:
    if not len(lower):  # LAPACK knows no matrices without rows
        return right
    matrix = lower.T if transposed else lower
    return np.asarray(solve_triangular(matrix, right, lower=not transposed, check_finite=False))


def _groups(fit: IdentificationResult, terms: Sequence[Term], determined: FloatArray) -> tuple[TermGroupResult, ...]:
    """Groups of before, and those of the new terms with what the new readings determine of them."""
    names = tuple(dict.fromkeys(term.group for term in terms))
    share = {name: [float(d) for t, d in zip(terms, determined, strict=False) if t.group == name] for name in names}
    old = tuple(group for group in fit.groups if group.name not in names)
    return old + tuple(
        TermGroupResult(name, len(part), float(np.clip(sum(part), 0, None)), 1.0) for name, part in share.items()
    )
