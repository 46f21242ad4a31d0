"""Identification: estimate the coefficients of an arm's terms from readings with references.

Maximum a posteriori by Gauss-Newton on exact kinematics. The prior scale of every group of terms and the noise of every
kind of reference maximise the evidence; large residuals get less weight, as under a density with long tails. All four
depend on each other and are estimated in rounds: weights and noise from the residuals, a linearisation, then scales and
parameters from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.estimation.group_scales import (
    WeighedEvidence,
    is_fast,
    weigh_evidence,
    with_uncertain_scales,
    without_invisible,
    without_negligible,
)
from truearm.identification.estimation.identification_result import (
    IdentificationResult,
    ReferenceFit,
    TermGroupResult,
)
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import ABSOLUTE, RELATIVE, SmallMotionProblem
from truearm.identification.estimation.references import Reference
from truearm.identification.estimation.residual_variance import FLOOR_MM2, huber_weights, paule_mandel_variance
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.solve import KnownStep, StepHalving, damped_step
from truearm.solve.arrowhead import Arrowhead, SchurComplement
from truearm.solve.group_evidence import GroupedEquations, GroupedPrior, Posterior
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

MOST_ROUNDS = 40
# The last step moves tips by a smaller share of their uncertainty; the noise is calm when it changes by less.
SETTLED_STEP = 0.05
CALM_NOISE, SAME_NOISE = 0.05, 1e-4
LEAST_NOISE = 1e-30
# Maximum halvings of a step until the cost does not rise by more than this share, its rounding.
MAX_HALVINGS = 7
COST_ROUNDING = 1e-9
# If no reference determines the size of the arm, it stays nominal, to this share.
SIZE_STD = 1e-6
# The problem is set up again without pruned terms if no larger share of the parameters remains.
MOST_ACTIVE = 0.7
# The prior of an artefact's unknowns is wider than any workshop [mm, or 1].
UNKNOWN_STD = 1e6


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
    progress : callable, optional
        Called with the number of rounds and the status.

    Returns
    -------
    IdentificationResult

    Raises
    ------
    InputError
        If there are no references, or two of a kind; if a reference has no readings, readings that are not in the
        state, or invalid uncertainties; if weights are not one a reading, from 0 to 1; or if a term's place is beyond
        the chain.
    """
    kinds = [reference.kind for reference in references]
    if not kinds or len(set(kinds)) < len(kinds):
        raise InputError(f"expected references, one of a kind, got {kinds or 'none'}")
    for term in terms:
        term.check_place(chain)
    for reference in references:
        _check_rows(reference, len(state))
    given = _checked_weights(reading_weights, references, len(state))
    n_residuals = sum(
        int((w > 0).sum()) * reference.n_residuals for w, reference in zip(given, references, strict=True)
    )
    perturbed_chain = PerturbedChain(chain, tuple(terms))
    problem, unknowns = initial_problem(perturbed_chain, state, references)
    n_coefficients = perturbed_chain.n_coefficients
    x = np.concatenate([np.zeros(n_coefficients), unknowns])
    prior, groups = grouped_prior(terms, len(x) - n_coefficients)
    if start is not None:
        x, prior = started_at(start, perturbed_chain, prior, groups)
    offered = dict(zip(groups, np.bincount(prior.group).tolist(), strict=False))  # the last group are the unknowns
    fast = is_fast(terms, groups, state)
    per_kind = np.zeros(len(references))
    noise_before, calm = np.full(len(references), np.inf), 0
    step_before, share = np.zeros(len(x)), 1.0
    residuals = problem.residuals(x)
    for n_rounds in range(1, MOST_ROUNDS + 1):
        noise, weights, robust_weights = _weights(problem.references, residuals, given, per_kind, robust=robust)
        if progress is not None:
            status = ", ".join(f"{kind} {np.sqrt(v):.4f} mm" for kind, v in zip(kinds, noise, strict=True))
            progress(n_rounds, f"noise: {status}")
        parts, whole = linearised(problem, x, weights)
        reduced = eliminate_unknowns(parts, whole, x)
        change = np.abs(noise - noise_before) / np.maximum(noise, LEAST_NOISE)
        was_calm = calm >= 1
        # A noise that repeats itself needs no second look, unless it is none.
        repeats = change.max() < SAME_NOISE and noise.min() > 2 * FLOOR_MM2
        calm = calm + (2 if repeats else 1) if change.max() < CALM_NOISE else 0
        if calm and not was_calm:
            prior = without_invisible(prior, whole.diagonal, n_residuals)
        # While the noise still falls, groups below it must not be pruned.
        prunable = fast if calm >= 2 else np.zeros_like(fast)
        with one_blas_thread():
            equations = _grouped_equations(reduced, x, n_residuals)
            found = weigh_evidence(equations, reduced.kept, prior, prunable, is_calm=calm >= 1)
        prior, effective = found.prior, found.effective
        if x[~prior.active].any():
            x = np.where(prior.active, x, 0.0)
            residuals = problem.residuals(x)
        step = reduced.step(found.x - x[reduced.kept])
        along = whole.times(step)
        # Rounding may make a tiny product negative.
        moved_by = np.sqrt(max(float(step @ along), 0.0) / max(float(effective.sum()) + reduced.n_determined, 1.0))
        back = float(along @ step_before) < 0
        share = max(share / 2, 0.1) if calm >= 2 and back else min(1.5 * share, 1.0)
        step_before = step
        cost, halving = _cost(problem, weights, prior), StepHalving(share, MAX_HALVINGS)
        x, residuals = take_step(problem, x, residuals, step, cost, halving)
        with one_blas_thread():
            per_kind = _effective_numbers(reduced, parts, equations, found)
        converged = calm >= 2 and moved_by < SETTLED_STEP
        noise_before = noise
        if converged:
            break
        prior = found.next
        problem, prior, x, step_before = _without_pruned(problem, groups, prior, x, step_before)
    prior = with_uncertain_scales(prior, effective)
    prior = without_negligible(prior, problem.perturbed_chain, state, float(np.sqrt(noise.min())), n_residuals)
    effective = np.where(prior.scale > 0, effective, 0.0)
    x = np.where(prior.active, x, 0.0)
    # If the readings leave a motion of decimetres open, the last step may still change the linearisation by more than
    # the noise: compute the covariance at the final parameters.
    parts, whole = linearised(problem, x, weights)
    reduced = eliminate_unknowns(parts, whole, x)
    with one_blas_thread():
        solution = _grouped_equations(reduced, x, n_residuals).posterior(prior.subset(reduced.kept))
    return _result(problem, x, prior, offered, solution, effective, noise, robust_weights, converged, n_rounds)


def initial_problem(
    perturbed_chain: PerturbedChain, state: ArmState, references: Sequence[Reference]
) -> tuple[SmallMotionProblem, FloatArray]:
    """The problem with references initialised at the nominal arm, and start values of the unknowns."""
    rough = perturbed_chain.tips(state, np.zeros(perturbed_chain.n_coefficients)).T
    laid = [reference.initialise(rough[:, reference.rows]) for reference in references]
    problem = SmallMotionProblem(perturbed_chain, state, tuple(reference for reference, _ in laid))
    return problem, np.concatenate([np.zeros(0), *(unknowns for _, unknowns in laid)])


def started_at(
    start: IdentificationResult, perturbed_chain: PerturbedChain, prior: GroupedPrior, groups: tuple[str, ...]
) -> tuple[FloatArray, GroupedPrior]:
    """Parameters and scales of a result for some of the terms; further terms are zero, at the start of their scale."""
    known_terms = start.perturbed_chain.terms
    ends = np.cumsum([term.n_coefficients for term in known_terms], dtype=np.intp)
    known = dict(zip(known_terms, np.split(start.coefficients, ends)[:-1], strict=True))  # after the last: none
    x = np.concatenate(
        [
            *(known.get(term, np.zeros(term.n_coefficients)) for term in perturbed_chain.terms),
            start.parameters[len(start.coefficients) :],
        ]
    )
    scale = {group.name: group.scale for group in start.groups}
    learned = np.array([*(scale.get(name, 1.0) for name in groups), 1.0])
    return x, replace(prior, scale=np.where(prior.learned, learned, prior.scale))


def _check_rows(reference: Reference, n: int) -> None:
    rows, std = reference.rows, reference.std
    if rows.ndim != 1 or not np.issubdtype(rows.dtype, np.integer) or not len(rows):
        raise InputError(f"expected the rows of one reading or more with a {reference.kind}, got {rows!r:.60}")
    if rows.min() < 0 or rows.max() >= n:
        raise InputError(f"expected a {reference.kind} in rows 0 to {n - 1}, got {rows.min()} to {rows.max()}")
    if std.shape != (reference.n_residuals, len(rows)) or not (np.isfinite(std) & (std >= 0)).all():
        raise InputError(f"expected finite standard uncertainties of a {reference.kind}, zero or more")


def _checked_weights(weights: FloatArray | None, references: Sequence[Reference], n: int) -> list[FloatArray]:
    """Weights (m,) of the readings of every reference."""
    if weights is None:
        return [np.ones(len(reference.rows)) for reference in references]
    if weights.shape != (n,) or not ((weights >= 0) & (weights <= 1)).all():
        raise InputError(f"expected weights of {n} readings, from 0 to 1, got {weights!r:.60}")
    return [weights[reference.rows] for reference in references]


def linearised(
    problem: SmallMotionProblem, x: FloatArray, weights: list[FloatArray]
) -> tuple[list[Arrowhead], Arrowhead]:
    """Normal equations of every reference, and their sum with the constraints."""
    parts, whole = problem.equations(x, weights)
    head, gradient = whole.head, whole.gradient
    if any(reference.kind in RELATIVE for reference in problem.references):
        size = problem.log_size_ratio_gradient(x)
        for part, reference in zip(parts, problem.references, strict=True):
            if reference.kind in RELATIVE:
                gradient = gradient - 2 * part.cost * size
        if _size_is_open(problem, x):
            of_coefficients = size[: len(head)]
            head = head + np.outer(of_coefficients, of_coefficients) / SIZE_STD**2
            gradient = gradient + size * problem.log_size_ratio(x) / SIZE_STD**2
    return parts, replace(whole, gradient=gradient, head=head)


def eliminate_unknowns(parts: Sequence[Arrowhead], whole: Arrowhead, x: FloatArray) -> SchurComplement:
    """Normal equations without the artefacts' unknowns.

    Unknowns without readings remain: lengths of artefacts, which couple the places of an artefact.
    """
    in_readings = np.concatenate([part.blocks.diagonal() for part in parts]) > 0
    return whole.eliminate(np.full(len(in_readings), UNKNOWN_STD**-2.0), x, shared=~in_readings)


def _without_pruned(
    problem: SmallMotionProblem, groups: tuple[str, ...], prior: GroupedPrior, x: FloatArray, step: FloatArray
) -> tuple[SmallMotionProblem, GroupedPrior, FloatArray, FloatArray]:
    """The problem, its prior, parameters and a step without pruned terms, where these are many."""
    active = np.flatnonzero(prior.active)
    if len(active) > MOST_ACTIVE * len(x):
        return problem, prior, x, step
    chain = problem.perturbed_chain
    kept = tuple(term for term in chain.terms if prior.scale[groups.index(term.group)] > 0)
    smaller = SmallMotionProblem(PerturbedChain(chain.chain, kept), problem.state, problem.references)
    return smaller, prior.subset(active), x[active], step[active]


def _grouped_equations(reduced: SchurComplement, x: FloatArray, n_residuals: int) -> GroupedEquations:
    right = reduced.gram @ x[reduced.kept] - reduced.gradient
    return GroupedEquations(reduced.gram, right, reduced.size, n_residuals)


def _effective_numbers(
    reduced: SchurComplement, parts: Sequence[Arrowhead], equations: GroupedEquations, found: WeighedEvidence
) -> FloatArray:
    """Number of parameters that each reference determines; that of one without unknowns follows from the variances."""
    if len(parts) == 1 and not parts[0].blocks.shape[0]:
        return np.array([found.effective.sum()])
    return reduced.traces(parts, equations.posterior(found.prior.subset(reduced.kept)).covariance)


def _size_is_open(problem: SmallMotionProblem, x: FloatArray) -> bool:
    """Whether no reference determines the size of the arm: neither points nor distances nor lengths nor radii."""
    constraints_of = [
        reference.constraints(x[problem.unknowns_of(i)]) for i, reference in enumerate(problem.references)
    ]
    return all(r.kind not in ABSOLUTE for r in problem.references) and all(
        constraints is None for constraints in constraints_of
    )


def _result(
    problem: SmallMotionProblem,
    x: FloatArray,
    prior: GroupedPrior,
    offered: dict[str, int],
    solution: Posterior,
    effective: FloatArray,
    noise: FloatArray,
    robust_weights: list[FloatArray],
    converged: bool,
    n_rounds: int,
) -> IdentificationResult:
    perturbed_chain, groups = problem.perturbed_chain, list(offered)
    kept = tuple(term for term in perturbed_chain.terms if prior.scale[groups.index(term.group)] > 0)
    active = np.flatnonzero(prior.active[: perturbed_chain.n_coefficients])
    return IdentificationResult(
        PerturbedChain(perturbed_chain.chain, kept),
        x[active],
        solution.covariance[np.ix_(active, active)],
        (prior.ratio * prior.scale[prior.group])[active],
        tuple(
            TermGroupResult(name, n, float(effective[i]), float(prior.scale[i]))
            for i, (name, n) in enumerate(offered.items())
        ),
        reference_fits(problem, x, np.sqrt(noise), robust_weights),
        bool(converged),
        n_rounds,
    )


def reference_fits(
    problem: SmallMotionProblem, x: FloatArray, noise_std: FloatArray, robust_weights: Sequence[FloatArray]
) -> tuple[ReferenceFit, ...]:
    """The references at parameters `x`, with the noise of each and the robust weights of its readings."""
    found = []
    for i, (reference, residual) in enumerate(zip(problem.references, problem.residuals(x), strict=True)):
        unknowns = dict(zip(reference.unknowns, x[problem.unknowns_of(i)].tolist(), strict=True))
        found.append(
            ReferenceFit(
                reference.kind,
                reference.rows,
                residual,
                reference.std,
                float(noise_std[i]),
                robust_weights[i],
                _artefact(problem, i, x),
                unknowns,
                reference.repeat_variance,
            )
        )
    return tuple(found)


def _artefact(problem: SmallMotionProblem, which: int, x: FloatArray) -> npt.NDArray[np.intp]:
    """(m,) index of the artefact of each reading: readings that share unknowns share it."""
    reference = problem.references[which]
    if not reference.unknowns:
        return np.zeros(len(reference.rows), dtype=np.intp)
    tips = problem.perturbed_chain.tips(problem.state.rows(reference.rows), x[: problem.perturbed_chain.n_coefficients])
    first = reference.linearised(tips.T, x[problem.unknowns_of(which)], slice(None)).unknown[0]
    return np.unique(first, return_inverse=True)[1].astype(np.intp)


def _weights(
    references: Sequence[Reference],
    residuals: list[FloatArray],
    given: list[FloatArray],
    effective: FloatArray,
    *,
    robust: bool,
) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
    """Noise variance of every reference, weights (k, m) of its residuals and robust weights (m,) of its readings.

    `given` are weights (m,) of the readings; those of weight 0 say nothing about the noise.
    """
    noise, weights, robust_weightss = np.empty(len(references)), [], []
    for i, (reference, residual) in enumerate(zip(references, residuals, strict=True)):
        known, used = reference.std.T**2, given[i] > 0
        used |= not used.any()
        noise[i] = paule_mandel_variance(residual.T[used], known[used], n_effective=float(effective[i]), robust=robust)
        variance = known + noise[i]
        robust_weights = given[i] * huber_weights(residual.T, variance) if robust else given[i]
        of_repeats = 0.0 if reference.repeat_variance is None else reference.repeat_variance
        weights.append(np.sqrt(robust_weights / (variance.T + of_repeats)))
        robust_weightss.append(robust_weights)
    return noise, weights, robust_weightss


def _cost(
    problem: SmallMotionProblem, weights: list[FloatArray], prior: GroupedPrior
) -> Callable[[FloatArray, list[FloatArray]], float]:
    """The cost of a round: half the sum of squares under its weights and priors, at parameters and their residuals."""

    def cost(x: FloatArray, residuals: list[FloatArray]) -> float:
        growth = problem.log_size_ratio(x)
        data = (growth / SIZE_STD) ** 2 if _size_is_open(problem, x) else 0.0
        for reference, w, r in zip(problem.references, weights, residuals, strict=True):
            data += float(((w * r) ** 2).sum()) * (np.exp(-2 * growth) if reference.kind in RELATIVE else 1.0)
        data += float((prior.precision[prior.active] * x[prior.active] ** 2).sum())
        return 0.5 * data + problem.constraints_cost(x)

    return cost


class _Residuals:
    """A cost of the least-squares loop that remembers the residuals of the point where it was evaluated last."""

    def __init__(self, problem: SmallMotionProblem, cost: Callable[[FloatArray, list[FloatArray]], float]) -> None:
        self._problem, self._cost = problem, cost
        self.residuals: list[FloatArray] = []

    def cost(self, x: FloatArray) -> float:
        self.residuals = self._problem.residuals(x)
        return self._cost(x, self.residuals)


def take_step(
    problem: SmallMotionProblem,
    x: FloatArray,
    residuals: list[FloatArray],
    step: FloatArray,
    cost: Callable[[FloatArray, list[FloatArray]], float],
    damping: StepHalving,
) -> tuple[FloatArray, list[FloatArray]]:
    """Take a step, halved until the cost of this round does not rise; returns the parameters and their residuals.

    Rounds are no epochs of one minimisation, as weights, noise and priors change between them: each takes one damped
    step of the least-squares loop.
    """
    before, trial = cost(x, residuals), _Residuals(problem, cost)
    epoch = damped_step(trial, x, KnownStep(before, step, COST_ROUNDING * before), damping)
    return (x, residuals) if epoch.trial is None else (epoch.trial.x, trial.residuals)
