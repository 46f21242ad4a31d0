"""Identification: estimate the coefficients of an arm's terms from readings with references.

Maximum a posteriori by Gauss-Newton on exact kinematics. The prior scale of every group of terms and the noise of every
kind of reference maximise the evidence; large residuals get less weight, as under a density with long tails. All four
depend on each other and are estimated in rounds (`truearm.identification.estimation.rounds`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.estimation.group_scales import is_fast, with_uncertain_scales, without_negligible
from truearm.identification.estimation.identification_result import IdentificationResult, ReferenceFit, TermGroupResult
from truearm.identification.estimation.linearisation import (
    UNKNOWN_STD,
    eliminate_unknowns,
    grouped_equations,
    linearised,
)
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.estimation.residual_variance import huber_weights
from truearm.identification.estimation.rounds import Rounds
from truearm.identification.references.references import Points, Reference
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.solve.group_evidence import GroupedPrior
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray

MOST_ROUNDS = 40
# Readings of a sample: so many at least, and so many a coefficient.
LEAST_SAMPLE, SAMPLE_PER_COEFFICIENT = 1000, 8
# A start that knows a smaller share of the coefficients saves fewer rounds than such a sample.
LEAST_KNOWN = 0.5
# A sample with a larger share of the readings costs more than the rounds that it saves.
MOST_SHARE = 0.25
# Readings that are excluded from so small a share, or come back, change the arm by one step.
MOST_CHANGED = 1e-4
# One in so many readings, and no fewer than the sample, show which of many groups are pruned. Where that is much more
# than the sample, they are one between it and all, from which all need fewer rounds.
STEP_SHARE = 16


def grouped_prior(terms: Sequence[Term], n_unknowns: int) -> tuple[GroupedPrior, tuple[str, ...]]:
    """The prior of all coefficients and unknowns at the start values of the scales, and the names of the groups.

    Raises
    ------
    InputError
        If terms of one group disagree whether the evidence determines its scale.
    """
    names = tuple(dict.fromkeys(term.group for term in terms))
    learned: dict[str, bool] = {}
    for term in terms:
        if learned.setdefault(term.group, term.learn) != term.learn:
            raise InputError(f"the terms of group {term.group!r} must have the same value of learn")
    ratio = np.concatenate([*(term.prior_stds for term in terms), np.full(n_unknowns, UNKNOWN_STD)])
    group = np.concatenate(
        [*(np.full(term.n_coefficients, names.index(term.group)) for term in terms), np.full(n_unknowns, len(names))]
    ).astype(np.intp)
    prior = GroupedPrior(ratio, group, np.ones(len(names) + 1), np.array([*learned.values(), False]))
    return prior, names


def identify(
    chain: Chain,
    state: ArmState,
    terms: Sequence[Term],
    references: Sequence[Reference],
    *,
    robust: bool = True,
    reading_weights: FloatArray | None = None,
    start: IdentificationResult | None = None,
    about: IdentificationResult | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> IdentificationResult:
    """Identify terms from readings.

    Parameters
    ----------
    chain : Chain
        The nominal chain, roughly placed in the frame of the references.
    state : ArmState
        Of all readings.
    terms : sequence of Term
    references : sequence of Reference
        At least one, and one of each kind, as the noise is estimated by kind.
    robust : bool
        Whether large residuals get less weight.
    reading_weights : (n,) array, optional
        Weights of the readings from 0 to 1, times the robust ones. A reading of weight 0 is excluded: only its residual
        is computed.
    start : IdentificationResult, optional
        Of some of the terms from the same references: fewer rounds are needed from there.
    about : IdentificationResult, optional
        Likewise: coefficients and covariance are then those of the linearisation about it (`linearised_about`).
    progress : callable, optional
        Called with the number of rounds and the status.

    Returns
    -------
    IdentificationResult

    Raises
    ------
    InputError
        If there are no references, or two of a kind; if weights are not one a reading, from 0 to 1; or if a term's
        place is beyond the chain.
    """
    weights = np.ones(len(state)) if reading_weights is None else reading_weights
    _check_problem(chain, terms, references, weights, len(state))
    given = [weights[reference.rows] for reference in references]
    perturbed_chain = PerturbedChain(chain, tuple(terms))
    problem, unknowns = initial_problem(perturbed_chain, state, references)
    x = np.concatenate([np.zeros(perturbed_chain.n_coefficients), unknowns])
    prior, groups = grouped_prior(terms, len(unknowns))
    sampled = None
    if start is None or len(start.coefficients) < LEAST_KNOWN * perturbed_chain.n_coefficients:
        sampled = _start_by_sample(chain, state, terms, references, reading_weights, start, robust=robust)
        start = start if sampled is None else sampled
    if start is not None:
        x, prior = started_at(start, perturbed_chain, prior, groups)
    offered = dict(zip(groups, np.bincount(prior.group).tolist(), strict=False))  # the last group are the unknowns
    fast, some = is_fast(terms, groups, state), None
    if sampled is not None and fast.any():  # matrices of all that is offered are costly
        used = np.flatnonzero(given[0] > 0)
        some = select_evenly(used, max(sample_size(len(x)), len(used) // STEP_SHARE))
    rounds = Rounds(problem, given, x, prior, groups, fast, robust=robust, some=some)
    if sampled is not None:  # of the same terms: the noise of the first round is compared with that of the sample
        rounds.noise = np.array([part.noise_std**2 for part in sampled.references])
    n_rounds = _converge(rounds, progress)
    found = _result(rounds, offered, state, n_rounds, about)
    return found if about is None else linearised_about(about, found, state, references)


def _converge(rounds: Rounds, progress: Callable[[int, str], None] | None) -> int:
    """Improve until converged; the number of rounds."""
    for n_rounds in range(1, MOST_ROUNDS + 1):
        rounds.weigh()
        if progress is not None:
            progress(n_rounds, f"noise: {rounds.noise_text}")
        rounds.improve()
        if rounds.converged:
            break
    return n_rounds


def _check_problem(
    chain: Chain, terms: Sequence[Term], references: Sequence[Reference], weights: FloatArray, n_readings: int
) -> None:
    kinds = [reference.kind for reference in references]
    if not kinds or len(set(kinds)) < len(kinds):
        raise InputError(f"expected references, one of a kind, got {kinds or 'none'}")
    for term in terms:
        term.check_place(chain)
    if weights.shape != (n_readings,) or not ((weights >= 0) & (weights <= 1)).all():
        raise InputError(f"expected weights of {n_readings} readings, from 0 to 1, got {weights!r:.60}")


def _start_by_sample(
    chain: Chain,
    state: ArmState,
    terms: Sequence[Term],
    references: Sequence[Reference],
    reading_weights: FloatArray | None,
    start: IdentificationResult | None,
    *,
    robust: bool,
) -> IdentificationResult | None:
    """The result of a sample of many points, from which all of them need fewer rounds; None of few."""
    points = references[0]
    if len(references) > 1 or not isinstance(points, Points):
        return None
    used = np.arange(len(points.rows)) if reading_weights is None else np.flatnonzero(reading_weights[points.rows] > 0)
    n_sample = sample_size(sum(term.n_coefficients for term in terms))
    if n_sample <= MOST_SHARE * (len(used) // STEP_SHARE):
        n_sample = len(used) // STEP_SHARE  # which starts from a sample itself
    if n_sample > MOST_SHARE * len(used):
        return None
    chosen = select_evenly(used, n_sample)
    rows = points.rows[chosen]
    return identify(
        chain,
        state.rows(rows),
        terms,
        [replace(points.select(chosen), rows=np.arange(n_sample))],
        robust=robust,
        reading_weights=None if reading_weights is None else reading_weights[rows],
        start=start,
    )


def sample_size(n_coefficients: int) -> int:
    """Number of readings of a sample that stands for many."""
    return max(LEAST_SAMPLE, SAMPLE_PER_COEFFICIENT * n_coefficients)


def select_evenly(rows: IntArray, n: int) -> IntArray:
    """Return n of the rows, evenly spaced."""
    return np.asarray(rows[np.linspace(0, len(rows) - 1, n).astype(np.intp)])


def initial_problem(
    perturbed_chain: PerturbedChain, state: ArmState, references: Sequence[Reference]
) -> tuple[SmallMotionProblem, FloatArray]:
    """The problem with references initialised at the nominal arm, and start values of the unknowns."""
    rough = perturbed_chain.chain.tip_in_base(state.angles).T
    laid = [reference.initialise(rough[:, reference.rows]) for reference in references]
    problem = SmallMotionProblem(perturbed_chain, state, tuple(reference for reference, _ in laid))
    return problem, np.concatenate([np.zeros(0), *(unknowns for _, unknowns in laid)])


def started_at(
    start: IdentificationResult, perturbed_chain: PerturbedChain, prior: GroupedPrior, groups: tuple[str, ...]
) -> tuple[FloatArray, GroupedPrior]:
    """Parameters and scales of a result for some of the terms; further terms are zero, at the start of their scale.

    So are groups that the evidence pruned: other readings, or more of them, may show them.
    """
    chain = start.perturbed_chain
    known = {term: start.coefficients[own] for term, own in zip(chain.terms, chain.columns, strict=True)}
    x = np.concatenate(
        [
            *(known.get(term, np.zeros(term.n_coefficients)) for term in perturbed_chain.terms),
            start.parameters[len(start.coefficients) :],
        ]
    )
    scale = {group.name: group.scale for group in start.groups}
    learned = np.array([*(scale.get(name) or 1.0 for name in groups), 1.0])
    return x, replace(prior, scale=np.where(prior.learned, learned, prior.scale))


def linearised_about(
    at: IdentificationResult, result: IdentificationResult, state: ArmState, references: Sequence[Reference]
) -> IdentificationResult:
    """A result with the coefficients and covariance of the linearisation about another arm, under its own priors.

    Two arms that differ by decimetres along what the readings hardly show, as base and tip do along parallel axes, fit
    them alike; but derivatives differ, and the covariance of one is none of the other's.

    Parameters
    ----------
    at, result : IdentificationResult
        Of some of the same terms, from the same readings.
    state, references
        Of the identification.
    """
    problem, _ = initial_problem(result.perturbed_chain, state, references)
    prior, names = grouped_prior(result.perturbed_chain.terms, problem.n_parameters - len(result.coefficients))
    x, prior = started_at(at, result.perturbed_chain, prior, names)
    stds = np.concatenate([result.prior_std, prior.ratio[len(result.coefficients) :]])
    prior = replace(prior, ratio=stds, scale=np.ones(len(prior.scale)))
    weights = [part.weights for part in result.references]
    with one_blas_thread():
        reduced = eliminate_unknowns(*linearised(problem, x, weights), x)
        n_residuals = sum(part.residuals.size for part in result.references)
        found = grouped_equations(reduced, x, n_residuals).posterior(prior.subset(reduced.kept))
    n = len(result.coefficients)
    return replace(result, coefficients=found.x[:n], covariance=found.covariance[:n, :n])


def with_few_changed(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], weights: FloatArray
) -> IdentificationResult | None:
    """The result with weights (n,) that exclude a few of many points more, or less: one step, by their pulls alone.

    None where that would not do: there are other references, weights between 0 and 1, or more than `MOST_CHANGED`.
    Scales, noise and covariance are kept: they change by no larger share.
    """
    (part, *others), x = fit.references, fit.coefficients
    given = weights[part.rows]
    changed = np.flatnonzero((given > 0) != (part.robust_weight > 0))
    if others or part.kind != "point" or not np.isin(given, (0, 1)).all() or len(changed) > MOST_CHANGED * len(given):
        return None
    variance = (part.std[:, changed] ** 2 + part.noise_std**2).T
    robust_weight = part.robust_weight.copy()
    robust_weight[changed] = given[changed] * huber_weights(part.residuals[:, changed].T, variance)
    new = replace(part, robust_weight=robust_weight)
    pulls = ((new.weights**2 - part.weights**2) * part.residuals)[:, changed]
    x = x - fit.covariance @ fit.perturbed_chain.gradient(state.rows(part.rows[changed]), x, pulls)
    (residuals,) = initial_problem(fit.perturbed_chain, state, references)[0].residuals(x)
    return replace(fit, coefficients=x, references=(replace(new, residuals=residuals),))


def _result(
    rounds: Rounds, offered: dict[str, int], state: ArmState, n_rounds: int, about: IdentificationResult | None
) -> IdentificationResult:
    """The result of all rounds, with the covariance at the final parameters where none about an arm is asked for."""
    problem, n_residuals, noise_std = rounds.problem, rounds.n_residuals, float(np.sqrt(rounds.noise.min()))
    prior = with_uncertain_scales(rounds.prior, rounds.effective)
    prior = without_negligible(prior, problem.perturbed_chain, state, noise_std, n_residuals)
    effective = np.where(prior.scale > 0, rounds.effective, 0.0)
    x = np.where(prior.active, rounds.x, 0.0)
    residuals = rounds.residuals if (x == rounds.x).all() else problem.residuals(x)
    covariance, step = _covariance(rounds, x, prior) if about is None else (np.zeros((len(x), len(x))), None)
    perturbed_chain, groups = problem.perturbed_chain, list(offered)
    kept = tuple(term for term in perturbed_chain.terms if prior.scale[groups.index(term.group)] > 0)
    active = np.flatnonzero(prior.active[: perturbed_chain.n_coefficients])
    return IdentificationResult(
        PerturbedChain(perturbed_chain.chain, kept),
        x[active],
        covariance if len(active) == len(x) else covariance[np.ix_(active, active)],
        (prior.ratio * prior.scale[prior.group])[active],
        tuple(
            TermGroupResult(name, n, float(effective[i]), float(prior.scale[i]))
            for i, (name, n) in enumerate(offered.items())
        ),
        reference_fits(
            problem,
            x,
            residuals,
            np.sqrt(rounds.noise),
            rounds.robust_weights,
            [np.sqrt(of.T) for of in rounds.known],
            None if step is None else problem.changes(x, step, residuals),
        ),
        rounds.converged,
        n_rounds,
    )


@one_blas_thread()
def _covariance(rounds: Rounds, x: FloatArray, prior: GroupedPrior) -> tuple[FloatArray, FloatArray | None]:
    """Posterior covariance of the parameters at `x`, and of points alone the step to the minimum of the linearisation.

    It is the last one, if that was there. The covariance is that of raised scales, the minimum that of the scales by
    which the parameters were identified.
    """
    is_last, of_points = np.array_equal(x, rounds.linearised_at), rounds.problem.has_points_alone and len(x) > 0
    if not is_last:
        rounds.weigh()
        rounds.reduced = eliminate_unknowns(*linearised(rounds.problem, x, rounds.weights), x)
    equations, kept = grouped_equations(rounds.reduced, x, rounds.n_residuals), rounds.reduced.kept
    covariance = equations.posterior(prior.subset(kept)).covariance
    if is_last or not of_points:
        return covariance, rounds.step if of_points else None
    own = replace(rounds.prior, scale=np.where(prior.scale > 0, rounds.prior.scale, 0.0))
    return covariance, equations.posterior(own.subset(kept)).x - x


def reference_fits(
    problem: SmallMotionProblem,
    x: FloatArray,
    residuals: Sequence[FloatArray],
    noise_std: FloatArray,
    robust_weights: Sequence[FloatArray],
    known_std: Sequence[FloatArray] | None = None,
    to_minimum: Sequence[FloatArray] | None = None,
) -> tuple[ReferenceFit, ...]:
    """The references at parameters `x`, with their residuals there, the noise of each and the weights of its readings.

    `known_std` (k, m) are the standard uncertainties of their residuals; those stated by default.
    """
    found = []
    for i, (reference, residual) in enumerate(zip(problem.references, residuals, strict=True)):
        unknowns = dict(zip(reference.unknowns, x[problem.unknowns_of(i)].tolist(), strict=True))
        found.append(
            ReferenceFit(
                reference.kind,
                reference.rows,
                residual,
                reference.std if known_std is None else known_std[i],
                float(noise_std[i]),
                robust_weights[i],
                _artefact(problem, i, x),
                unknowns,
                reference.repeat_variance,
                None if to_minimum is None else to_minimum[i],
            )
        )
    return tuple(found)


def _artefact(problem: SmallMotionProblem, which: int, x: FloatArray) -> IntArray:
    """(m,) index of the artefact of each reading: readings that share unknowns share it."""
    reference = problem.references[which]
    if not reference.unknowns:
        return np.zeros(len(reference.rows), dtype=np.intp)
    if reference.uses_orientation:
        first = problem.linearised(x)[which].unknown[0]
    else:
        of_coefficients = x[: problem.perturbed_chain.n_coefficients]
        tips = problem.perturbed_chain.tips(problem.state.rows(reference.rows), of_coefficients)
        first = reference.linearised(tips.T, x[problem.unknowns_of(which)], slice(None)).unknown[0]
    return np.unique(first, return_inverse=True)[1].astype(np.intp)
