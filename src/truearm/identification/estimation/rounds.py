"""The rounds of an identification: weights and noise, a linearisation, scales by evidence, and a damped step.

Weights and noise follow from the residuals, scales and parameters from a linearisation, and both change each other, so
rounds are no epochs of one minimisation: each takes one damped step of the least-squares loop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from truearm.identification.estimation.group_scales import (
    WeighedEvidence,
    scale_rounds,
    weigh_evidence,
    without_invisible,
)
from truearm.identification.estimation.linearisation import (
    SIZE_STD,
    eliminate_unknowns,
    grouped_equations,
    linearised,
    roughly_linearised,
    size_is_open,
)
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import RELATIVE, SmallMotionProblem
from truearm.identification.estimation.residual_variance import FLOOR_MM2, huber_weights, paule_mandel_variance
from truearm.identification.references.prepared_readings import residual_variance, tip_motions
from truearm.identification.references.references import Reference
from truearm.solve.arrowhead import Arrowhead, SchurComplement
from truearm.solve.group_evidence import GroupedEquations, GroupedPrior, LowRankPosterior, Posterior
from truearm.solve.least_squares import damped_step, step_in_valley
from truearm.solve.least_squares_problem import KnownStep, StepHalving
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray

# A step that would move tips by a smaller share of their uncertainty is not taken, so that residuals, weights and
# derivatives are those of one place: a root mean square, of which that of a single reading is some ten times at most.
SETTLED_STEP = 0.05
# After a smaller step, of points alone, derivatives hardly change: noise that still does settles without new ones.
STRAIGHT_STEP = 0.25
# Of fewer coefficients a linearisation costs next to nothing, and derivatives by some may depend on few others.
MANY_COEFFICIENTS, SETTLED_STEP_OF_FEW = 500, 0.01
# The noise is calm when it changes by less.
CALM_NOISE, SAME_NOISE = 0.05, 1e-4
LEAST_NOISE = 1e-30
# Steps that lead back are shortened unless each is this much smaller than the one before.
SHRINKING = 0.8
# Maximum halvings of a step until the cost does not rise by more than this share, its rounding.
MAX_HALVINGS = 7
COST_ROUNDING = 1e-9
# Share of the residuals that parameters may determine where the others show how large they are.
MOST_EFFECTIVE = 0.5
# A residual of more than five standard deviations, squared, says nothing of the variances.
MOST_SURPRISE = 25.0
# Angles with few digits are rounded unless residuals are more probable of exact ones by these odds: where noise hides
# it, both are nearly as probable, and the larger uncertainty is the safe one.
EXACT_ODDS = 20.0
# A step that lowers the cost by a smaller share of what its matrix predicts leads along a valley that bends.
LEAST_GAIN = 0.7
# The problem is set up again without pruned terms if no larger share of the parameters remains.
MOST_ACTIVE = 0.7


class Rounds:
    """Parameters, scales and noise, improved round by round.

    Parameters
    ----------
    problem : SmallMotionProblem
    given : list of (m,) array
        Weights of the readings of every reference from 0 to 1.
    x : (n_parameters,) array
        Start values [rad, mm per unit of the basis; mm].
    prior : GroupedPrior
    groups : tuple of str
        Names of the groups of terms.
    fast : (n_groups + 1,) bool array
        Groups that evidence may prune, see `group_scales.is_fast`.
    robust : bool
        Whether large residuals get less weight.
    some : (m,) int array, optional
        Points of which the matrix stands for that of all, until groups were pruned; then None.

    Attributes
    ----------
    residuals : list of (k, m) array
        Of every reference at the present parameters [mm].
    noise : (n_references,) array
        Variance of every reference [mm^2].
    known : list of (m, k) array
        Stated variances of the residuals beside it, with those by rounding of the angles [mm^2].
    weights : list of (k, m) array
        One over the standard deviations of the residuals [1/mm].
    robust_weights : list of (m,) array
        Of the readings, from 0 to 1.
    effective : (n_groups + 1,) array
        Number of parameters of every group that the readings determine.
    calm : int
        Rounds since the noise no longer changes.
    converged : bool
    linearised_at : (n_parameters,) array
        Parameters before the last step.
    step : (n_parameters,) array
        The last step; where the rounds converged it is not taken.
    reduced : SchurComplement
        The normal equations there, without the artefacts' unknowns.
    """

    def __init__(
        self,
        problem: SmallMotionProblem,
        given: list[FloatArray],
        x: FloatArray,
        prior: GroupedPrior,
        groups: tuple[str, ...],
        fast: BoolArray,
        *,
        robust: bool,
        some: IntArray | None = None,
    ) -> None:
        self.x, self.prior = x, prior
        self._groups, self._fast, self._robust = groups, fast, robust
        self.noise = np.full(len(problem.references), np.inf)
        self._per_reference = np.zeros(len(problem.references))
        self.step, self._moved_by, self._share = np.zeros(len(x)), 0.0, 1.0
        self.calm, self._was_calm, self.converged, self.some = 0, False, False, some
        self.problem, self._given = problem, given
        self.n_residuals = sum(
            int((w > 0).sum()) * reference.n_residuals for w, reference in zip(given, problem.references, strict=True)
        )
        self.residuals = problem.residuals(x)
        self.known = [reference.std.T**2 for reference in problem.references]
        self._by_rounding = _variances_by_rounding(problem, x)

    @property
    def noise_text(self) -> str:
        """Standard deviation of every reference in words."""
        of = zip(self.problem.references, self.noise, strict=True)
        return ", ".join(f"{reference.kind} {np.sqrt(variance):.4f} mm" for reference, variance in of)

    def weigh(self) -> None:
        """Noise and weights from the residuals."""
        before = self.noise
        if self._by_rounding is not None and self.calm < 2:
            self._settle_known(self._by_rounding)
        self.noise, self.weights, self.robust_weights = _weights(
            self.problem.references, self.residuals, self.known, self._given, self._per_reference, robust=self._robust
        )
        change = (np.abs(self.noise - before) / np.maximum(self.noise, LEAST_NOISE)).max()
        # A noise that repeats itself needs no second look, unless it is none.
        repeats = change < SAME_NOISE and self.noise.min() > 2 * FLOOR_MM2
        self.calm = self.calm + (2 if repeats else 1) if change < CALM_NOISE else 0

    def _settle_known(self, by_rounding: list[FloatArray]) -> None:
        """Whether the angles are rounded, or exact and only written so, as the residuals clearly say.

        The angles of a plan have few digits too. What rounding alone would do to the residuals they then do not show.
        Neither do residuals that are nearly as many parameters, before evidence has scaled these.
        """
        for i, (reference, residual) in enumerate(zip(self.problem.references, self.residuals, strict=True)):
            used = self._given[i] > 0
            stated, effective = reference.std.T**2, float(self._per_reference[i])
            if effective > MOST_EFFECTIVE * int(used.sum()) * reference.n_residuals:
                continue
            choices = (stated, stated + by_rounding[i].T)
            exact, rounded = (
                _surprise(residual.T[used], known[used], effective, robust=self._robust) for known in choices
            )
            self.known[i] = choices[0 if exact + 2 * np.log(EXACT_ODDS) < rounded else 1]

    def improve(self) -> None:
        """A linearisation, scales by its evidence, and a step."""
        problem, x = self.problem, self.x
        is_exact = self.some is None
        if self.some is None:
            parts, whole = linearised(problem, x, self.weights)
        else:
            whole = roughly_linearised(problem, x, self.weights[0], self.residuals[0], self.some)
            parts = [whole]
        reduced = eliminate_unknowns(parts, whole, x)
        self.linearised_at, self.reduced = x, reduced
        with one_blas_thread():
            equations = grouped_equations(reduced, x, self.n_residuals)
            found = self._weigh_evidence(equations, reduced, whole)
        self.prior, self.effective = found.prior, found.effective
        if x[~self.prior.active].any():
            x = np.where(self.prior.active, x, 0.0)
            self.residuals = problem.residuals(x)
        step = reduced.step(found.posterior.x - x[reduced.kept])
        along = whole.times(step)
        # Rounding may make a tiny product negative.
        n_effective = max(float(self.effective.sum()) + reduced.n_determined, 1.0)
        moved_by = float(np.sqrt(max(float(step @ along), 0.0) / n_effective))
        is_large = len(x) >= MANY_COEFFICIENTS
        settled = SETTLED_STEP if is_large else SETTLED_STEP_OF_FEW
        self.converged = bool(is_exact and self.calm >= 2 and moved_by < settled)
        with one_blas_thread():
            self._per_reference = _effective_numbers(reduced, parts, found)
        if self.converged:
            self.x, self.step = x, step
        else:
            self._take(step, along, x, moved_by, found.posterior)
            is_straight = is_large and is_exact and not self.calm and moved_by < STRAIGHT_STEP
            # Else it lowers residuals that parameters determine, and the noise to nothing before these count anew.
            if is_straight and problem.has_points_alone and n_effective <= MOST_EFFECTIVE * self.n_residuals:
                self._step_again(found.posterior)
        if self.calm >= 2:  # groups were pruned
            self.some = None
        if not self.converged:
            self.prior = found.next
            self._drop_pruned()

    def _weigh_evidence(
        self, equations: GroupedEquations, reduced: SchurComplement, whole: Arrowhead
    ) -> WeighedEvidence:
        """Scales on a linearisation; while the noise still falls, groups below it must not be pruned."""
        if self.calm and not self._was_calm:
            self.prior = without_invisible(self.prior, whole.diagonal, self.n_residuals)
        self._was_calm = self.calm >= 1
        prunable = self._fast if self.calm >= 2 else np.zeros_like(self._fast)
        first, calm = not self._moved_by, self.calm >= 1
        rounds = scale_rounds(len(reduced.kept), self.n_residuals, is_first=first, is_calm=calm)
        return weigh_evidence(equations, reduced.kept, self.prior, prunable, rounds=rounds)

    def _take(
        self,
        step: FloatArray,
        along: FloatArray,
        x: FloatArray,
        moved_by: float,
        posterior: Posterior | LowRankPosterior,
    ) -> None:
        """Take a step, shorter where steps turn back and do not shrink, and bent where residuals do.

        `along` is the Gauss-Newton matrix times the step, and `moved_by` its size as a share of the parameters'
        uncertainty.
        """
        back = float(along @ self.step) < 0 and moved_by > SHRINKING * self._moved_by
        self._share = max(self._share / 2, 0.1) if self.calm >= 2 and back else min(1.5 * self._share, 1.0)
        self.step, self._moved_by = step, moved_by
        cost, halving = _cost(self.problem, self.weights, self.prior), StepHalving(self._share, MAX_HALVINGS)
        here, before = self.residuals, cost(x, self.residuals)
        self.x, self.residuals = take_step(self.problem, x, here, step, cost, halving)
        active, after = self.prior.active, cost(self.x, self.residuals)
        predicted = 0.5 * float(step @ along + self.prior.precision[active] @ step[active] ** 2)
        is_bent = self._share == 1 and moved_by > SETTLED_STEP and before - after < LEAST_GAIN * predicted
        if is_bent and self.problem.has_points_alone:
            there = self._in_valley(x, here, step, posterior)
            residuals = self.problem.residuals(there)
            if cost(there, residuals) < after:
                self.x, self.residuals = there, residuals

    def _step_again(self, posterior: Posterior | LowRankPosterior) -> None:
        """Noise and weights from the residuals, and a step under them with the covariance of the last linearisation."""
        self.weigh()
        problem, active = self.problem, self.prior.active
        gradient = problem.gradient_of_points(self.x, self.weights[0] ** 2 * self.residuals[0])
        gradient[active] += self.prior.precision[active] * self.x[active]
        cost, halving = _cost(problem, self.weights, self.prior), StepHalving(1.0, MAX_HALVINGS)
        step = -posterior.times(gradient)
        self.x, self.residuals = take_step(problem, self.x, self.residuals, step, cost, halving)

    def _in_valley(
        self, x: FloatArray, here: list[FloatArray], step: FloatArray, posterior: Posterior | LowRankPosterior
    ) -> FloatArray:
        """The point to which `step_in_valley` leads, of points alone."""
        problem, weights, active = self.problem, self.weights[0], self.prior.active
        root = np.sqrt(self.prior.precision[active])

        def white(at: FloatArray, residuals: list[FloatArray]) -> FloatArray:
            return np.concatenate([(weights * residuals[0]).ravel(), root * at[active]])

        def solve(bent: FloatArray) -> FloatArray:
            pulls = weights * bent[: weights.size].reshape(weights.shape)
            return posterior.times(problem.gradient_of_points(x, pulls))

        end = x + step
        there = self.residuals if np.array_equal(self.x, end) else problem.residuals(end)
        with one_blas_thread():
            return x + step_in_valley(
                lambda at: white(at, problem.residuals(at)), solve, x, step, white(x, here), white(end, there)
            )

    def _drop_pruned(self) -> None:
        """Set up the problem without pruned terms, where these are many."""
        active = np.flatnonzero(self.prior.active)
        if len(active) > MOST_ACTIVE * len(self.x):
            return
        problem = self.problem
        chain = problem.perturbed_chain
        kept = tuple(term for term in chain.terms if self.prior.scale[self._groups.index(term.group)] > 0)
        self.problem = SmallMotionProblem(PerturbedChain(chain.chain, kept), problem.state, problem.references)
        self.prior, self.x, self.step = self.prior.subset(active), self.x[active], self.step[active]


def _effective_numbers(reduced: SchurComplement, parts: Sequence[Arrowhead], found: WeighedEvidence) -> FloatArray:
    """Number of parameters that each reference determines; that of one without unknowns follows from the variances."""
    if len(parts) == 1 and not parts[0].blocks.shape[0]:
        return np.array([found.effective.sum()])
    return reduced.traces(parts, found.posterior.covariance)


def _weights(
    references: Sequence[Reference],
    residuals: list[FloatArray],
    known: list[FloatArray],
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
        used = given[i] > 0
        used |= not used.any()
        noise[i] = paule_mandel_variance(
            residual.T[used], known[i][used], n_effective=float(effective[i]), robust=robust
        )
        variance = known[i] + noise[i]
        robust_weights = given[i] * huber_weights(residual.T, variance) if robust else given[i]
        of_repeats = 0.0 if reference.repeat_variance is None else reference.repeat_variance
        weights.append(np.sqrt(robust_weights / (variance.T + of_repeats)))
        robust_weightss.append(robust_weights)
    return noise, weights, robust_weightss


def _variances_by_rounding(problem: SmallMotionProblem, x: FloatArray) -> list[FloatArray] | None:
    """(k, m) variances of every reference's residuals by rounding of the angles; None where these are not rounded."""
    state = problem.state
    if state.angle_std is None:
        return None
    motions = tip_motions(problem.perturbed_chain.chain, state.angles, state.angle_std)
    parts = zip(problem.references, problem.linearised(x), strict=True)
    return [residual_variance(linear, motions[:, reference.rows]) for reference, linear in parts]


def _surprise(residuals: FloatArray, known: FloatArray, effective: float, *, robust: bool) -> float:
    """Minus twice the logarithm of the likelihood of residuals (m, k) of known variances and a noise beside them."""
    noise = paule_mandel_variance(residuals, known, n_effective=effective, robust=robust)
    variance = known + noise
    squares = residuals**2 * residuals.size / max(residuals.size - effective, 0.1 * residuals.size)
    return float((np.log(variance) + np.minimum(squares / variance, MOST_SURPRISE)).sum())


def _cost(
    problem: SmallMotionProblem, weights: list[FloatArray], prior: GroupedPrior
) -> Callable[[FloatArray, list[FloatArray]], float]:
    """The cost of a round: half the sum of squares under its weights and priors, at parameters and their residuals."""

    def cost(x: FloatArray, residuals: list[FloatArray]) -> float:
        growth = problem.log_size_ratio(x)
        data = (growth / SIZE_STD) ** 2 if size_is_open(problem, x) else 0.0
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
