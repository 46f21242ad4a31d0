"""Levenberg-Marquardt training: ``trainlm``, ``trainbr`` (regularised), and `train_varpro` by variable projection.

``trainlm`` and ``trainbr`` have MATLAB's names, defaults and stops. ``trainbr`` estimates the scales of parameters and
of noise from the data by evidence. With residuals r of precision beta and parameters x of prior precision alpha about
zero, the type-II likelihood is greatest where

    gamma = sum over i of 1 - alpha [(beta J^T J + alpha I)^-1]_ii,
    alpha = gamma / |x|^2,   beta = (n - gamma) / |r|^2.

MacKay's fixed point repeats this; gamma counts the parameters that the data, rather than the prior, determine. Source:
D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415, eqs. 4.8 to 4.10.

`train_varpro` solves for the linear output layer at every step and searches hidden weights only, with Nielsen's damping
and geodesic acceleration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from array_api_compat import array_namespace, device, is_numpy_array
from scipy.linalg import LinAlgError, cholesky
from scipy.linalg.lapack import dtrtri

from truearm.errors import TruearmError
from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import DampedOptions, TrainingLog, TrainingOptions, TrainingRecord, checked_start
from truearm.solve.least_squares import levenberg_marquardt
from truearm.solve.least_squares_problem import NormalEquations
from truearm.solve.linear_algebra import Array, add_to_diagonal, as_array_like, cholesky_solve, to_numpy, whiten
from truearm.solve.stop_criteria import CostConverged, CostGoal, DampingLimit, MinGradient, OptimizerState, StopReason
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

# A ridge on the output layer's Gram matrix, relative to its mean diagonal: hidden units that have become alike leave it
# singular to rounding, and any of their shares then fits as well. Where rounding still wins, a larger one follows.
RIDGES = (1e-14, 1e-12, 1e-10)
# Share of a step for differences along it: second ones lose 1e-16 / DIFFERENCE^2 of the errors, and take in
# DIFFERENCE^2 / 12 of the fourth derivative.
DIFFERENCE = 0.1
# Rows of the hidden weights' matrix that are eliminated together.
ROWS = 256


@dataclass(frozen=True)
class _Completed:
    """All weights for given hidden ones, and the cost there."""

    hidden: FloatArray
    weights: FloatArray
    cost: float


@dataclass(frozen=True, eq=False)
class ProjectedProblem:
    """A network's fit as a problem in its hidden weights alone.

    At hidden weights theta the output layer takes its least-squares value; the Gauss-Newton matrix is the Schur
    complement of the full one, and the gradient by the output layer is zero.

    Source: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; L. Kaufman, BIT 15 (1975) 49 (the approximation
    that drops the projector's second derivative); J. Sjoberg, M. Viberg, "Separable non-linear least-squares
    minimization", NNSP 1997 (for networks).

    Parameters
    ----------
    full : FitProblem
        The fit in all weights.
    """

    full: FitProblem
    # The point last asked for: a solver asks for its cost, then for its equations, then for its weights.
    _latest: list[_Completed] = field(default_factory=list, init=False, repr=False)

    @property
    def n_hidden_weights(self) -> int:
        """Number of weights below the output layer: the first ones of a network's weights."""
        m, n = self.full.network.shapes[-1]
        return self.full.network.n_weights - m * n

    def full_weights(self, hidden_weights: FloatArray) -> FloatArray:
        """All weights (n_weights,): the hidden ones given, with the output layer that fits best."""
        return self._completed(hidden_weights).weights.copy()

    def cost(self, x: FloatArray) -> float:
        """Half the sum of squared errors at hidden weights `x` with the best output layer."""
        return self._completed(x).cost

    def normal_equations(self, x: FloatArray) -> NormalEquations:
        """The equations in the hidden weights, the output layer eliminated."""
        full = self.full.normal_equations(self._completed(x).weights)
        p, n_outputs = len(x), self.full.network.shapes[-1][1]
        gram = full.gram[:p, :p]
        # All outputs have the same matrix, and none in common: its factor serves them one by one.
        inner = full.gram[p::n_outputs, p::n_outputs]
        coupling = [full.gram[p + o :: n_outputs, :p] for o in range(n_outputs)]
        half = _with_ridge(inner, lambda matrix: whiten(matrix, array_namespace(gram).concat(coupling, axis=1)))
        parts = [half[:, o * p : (o + 1) * p] for o in range(n_outputs)]

        def eliminate(start: int) -> None:
            for part in parts:
                gram[start : start + ROWS, :] -= part[:, start : start + ROWS].T @ part

        self.full.by_thread(eliminate, list(range(0, p, ROWS)))
        return NormalEquations(full.cost, full.gradient[:p], gram)

    def second_directional_derivative(self, x: FloatArray, step: FloatArray) -> FloatArray:
        """``J^T r''`` (p,) at hidden weights `x`, with the errors' second derivative along `step` (p,).

        By central differences of the errors, the output layer following. Of J only the part that leaves the output
        layer's space counts (Kaufman): so r'' is brought there first.
        """
        full = self.full
        here = self._completed(x).weights
        ahead, behind = (self._solved(x + sign * DIFFERENCE * step).weights for sign in (1, -1))

        seconds: dict[int, Array] = {}

        def products(columns: slice) -> tuple[Array, Array]:
            inputs, A = full.inputs[:, columns], self._basis(here, columns)
            sides = full.network.outputs(ahead, inputs) + full.network.outputs(behind, inputs)
            seconds[columns.start] = (sides - 2 * full.network.outputs(here, inputs)) / DIFFERENCE**2
            return A @ A.T, A @ seconds[columns.start].T

        gram, right = full.summed(products)
        W = _with_ridge(gram, lambda matrix: cholesky_solve(matrix, right))
        pulled = full.backpropagate(here, lambda columns, A: seconds[columns.start] - W.T @ A)
        return pulled[: len(x)]

    def _basis(self, weights: FloatArray, columns: slice) -> Array:
        """Values of the last hidden layer and ones (m, samples), what the output layer weighs."""
        last_hidden = self.full.network.forward(weights, self.full.inputs[:, columns])[-2]
        xp = array_namespace(last_hidden)
        ones = xp.ones((1, last_hidden.shape[1]), dtype=last_hidden.dtype, device=device(last_hidden))
        return xp.concat([last_hidden, ones])

    def _completed(self, hidden_weights: FloatArray) -> _Completed:
        if not (self._latest and np.array_equal(self._latest[0].hidden, hidden_weights)):
            self._latest[:] = [self._solved(hidden_weights)]
        return self._latest[0]

    def _solved(self, hidden_weights: FloatArray) -> _Completed:
        """The output layer by normal equations over all samples, then one refinement and the cost.

        The refinement brings back the digits that squaring the condition number cost.
        """
        full = self.full
        m, n_outputs = full.network.shapes[-1]
        weights = np.concatenate([hidden_weights, np.zeros(m * n_outputs)])
        W = np.zeros((m, n_outputs))

        def first(columns: slice) -> tuple[Array, Array]:
            A = self._basis(weights, columns)
            return A @ A.T, A @ full.targets[:, columns].T

        def second(columns: slice) -> tuple[Array]:
            A = self._basis(weights, columns)
            return (A @ (as_array_like(W.T, A) @ A - full.targets[:, columns]).T,)

        gram, right = full.summed(first)
        W = to_numpy(_with_ridge(gram, lambda matrix: cholesky_solve(matrix, right)))
        (left_over,) = full.summed(second)
        change = _with_ridge(gram, lambda matrix: cholesky_solve(matrix, -left_over))
        weights[len(hidden_weights) :] = (W + to_numpy(change)).ravel()
        return _Completed(hidden_weights.copy(), weights, full.cost(weights))


def _with_ridge(gram: Array, solved: Callable[[Array], Array | None]) -> Array:
    """What `solved` makes of a positive definite copy of `gram` (m, m), the output layer's Gram matrix."""
    xp = array_namespace(gram)
    diagonal = float(xp.linalg.trace(gram)) / gram.shape[0]
    for ridge in RIDGES:
        matrix = xp.asarray(gram, copy=True)
        add_to_diagonal(matrix, ridge * diagonal)
        solution = solved(matrix)
        if solution is not None and bool(xp.all(xp.isfinite(solution))):
            return solution
    raise TruearmError(
        "the output layer cannot be solved for: values of the last hidden layer are not finite, or too large"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class VariableProjectionOptions(TrainingOptions):
    """Options of `train_varpro`.

    Parameters
    ----------
    max_fail : int
        Validation failures since the best epoch that end it.
    """

    epochs: int = 200
    max_fail: int = 10


def train_varpro(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, TrainingRecord]:
    """Train a network whose output layer is linear: far fewer epochs than `trainlm` for the same error.

    The output layer is eliminated (`ProjectedProblem`), damping is Nielsen's, and steps are bent by their second
    derivative (geodesic acceleration, see `levenberg_marquardt`).

    It ends, asked in this order after every epoch, when `perf` is at `goal`, after `epochs`, after `time`, when an
    epoch lowers the error by less than 1e-8 of it, and when the validation error was above its best `max_fail` times.
    With more weights than errors it still trains, to a network that repeats them: set data aside for `validation`, or
    use `trainbr`.

    Parameters
    ----------
    training : FitProblem
    weights : (n_weights,) array
        Where to start; the output layer's share is not used.
    **options
        Those of `VariableProjectionOptions`.

    Returns
    -------
    weights : (n_weights,) array
        Those of the best validation epoch, or of the best `perf` without validation data.
    record : TrainingRecord
        Its `gradient` is that by the hidden weights.

    Raises
    ------
    InputError
        As `trainlm`.
    """
    chosen = VariableProjectionOptions(**options)
    start, problem = checked_start(training, weights, chosen), ProjectedProblem(training)
    log = TrainingLog(training, chosen, problem.full_weights)
    with one_blas_thread():
        levenberg_marquardt(
            problem,
            start[: problem.n_hidden_weights],
            stops=log.stops(CostGoal(chosen.goal * log.half), CostConverged(1e-8)),
            callback=log.record_lm_epoch,
            acceleration=problem.second_directional_derivative,
            clock=chosen.clock,
        )
        return log.best_weights(), log.record(TrainingRecord)


@dataclass(frozen=True, eq=False, kw_only=True)
class LevenbergMarquardtOptions(DampedOptions):
    """Options of `trainlm`, as MATLAB's.

    Parameters
    ----------
    max_fail : int
        Validation failures since the best epoch that end it.
    """

    max_fail: int = 6


def trainlm(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, TrainingRecord]:
    """Train a network's weights.

    It ends, asked in this order after every epoch, when `perf` is at `goal`, after `epochs`, after `time`, when
    `gradient` is at `min_grad`, when `mu` is at `mu_max`, and when the validation error was above its best `max_fail`
    times. With more weights than errors it still trains: the damping chooses among the weights that fit alike.

    Parameters
    ----------
    training : FitProblem
    weights : (n_weights,) array
        Where to start.
    **options
        Those of `LevenbergMarquardtOptions`. `min_grad` is a norm of the gradient of the mean squared error. The
        damping `mu` is added to ``J^T J / n`` of the n scaled errors, as MATLAB's is for ``mse``.

    Returns
    -------
    weights : (n_weights,) array
        Those of the best validation epoch, or of the best `perf` without validation data.
    record : TrainingRecord

    Raises
    ------
    InputError
        If weights, data or options do not fit together.
    """
    chosen = LevenbergMarquardtOptions(**options)
    start, n, log = checked_start(training, weights, chosen), training.n_errors, TrainingLog(training, chosen)
    with one_blas_thread():
        levenberg_marquardt(
            training,
            start,
            damping=chosen.damping(n),  # (J^T J / n + mu I) step = -J^T e / n, multiplied by n
            stops=log.stops(CostGoal(chosen.goal * log.half), MinGradient(chosen.min_grad * log.half), DampingLimit()),
            callback=lambda state: log.record_lm_epoch(state, mu=state.mu / n),
            clock=chosen.clock,
        )
    return log.best_weights(), log.record(TrainingRecord)


@dataclass(frozen=True)
class Evidence:
    """Precisions and the effective number of parameters.

    Attributes
    ----------
    alpha : float
        Prior precision of a parameter, one over its unit squared.
    beta : float
        Precision of a residual, one over its unit squared.
    gamma : float
        Effective number of parameters.
    """

    alpha: float
    beta: float
    gamma: float


def update_evidence(
    evidence: Evidence, *, gram: Array, parameter_squares: float, residual_squares: float, n_residuals: int
) -> Evidence:
    """One round of MacKay's fixed point.

    Parameters
    ----------
    evidence : Evidence
        Precisions so far.
    gram : (p, p) array
        ``J^T J`` of the unweighted residuals, of NumPy or PyTorch.
    parameter_squares, residual_squares : float
        ``|x|^2`` and ``|r|^2`` at or near the most probable parameters under `evidence`.
    n_residuals : int
        Number of residuals.

    Returns
    -------
    Evidence
        The precision is unchanged if all parameters, or all residuals, are zero.
    """
    p = gram.shape[0]
    gamma = float(np.clip(p - evidence.alpha * _trace_of_variances(evidence, gram), 0, p))
    # With as many parameters as data no freedom remains to estimate the noise: use a thousandth instead.
    freedom = max(n_residuals - gamma, 1e-3 * n_residuals)
    return Evidence(
        alpha=gamma / parameter_squares if parameter_squares > 0 and gamma > 0 else evidence.alpha,
        beta=freedom / residual_squares if residual_squares > 0 else evidence.beta,
        gamma=gamma,
    )


def _trace_of_variances(evidence: Evidence, gram: Array) -> float:
    """Trace of ``(beta J^T J + alpha I)^-1``."""
    if is_numpy_array(gram):
        precision = evidence.beta * gram
        add_to_diagonal(precision, evidence.alpha)
        try:
            # With A = L L^T the trace is the sum of squares of L^-1, which costs a sixth of the whole inverse.
            # Transposed, rows are the columns that LAPACK wants: there are no copies, which take half of the time.
            lower = cholesky(precision.T, lower=True, overwrite_a=True, check_finite=False)
            inverse, _ = dtrtri(lower, lower=1, overwrite_c=1)
            return float(np.vdot(inverse.T, inverse.T))
        except LinAlgError:  # rounding made eigenvalues of undetermined directions negative
            pass
    values = to_numpy(array_namespace(gram).linalg.eigvalsh(gram))
    return float((1 / (evidence.beta * np.maximum(values, 0) + evidence.alpha)).sum())


# Foresee and Hagan's start, alpha = 0 and beta = 1 of ``beta |e|^2 + alpha |w|^2``: the errors alone, with just enough
# beside them to tell apart what the data do not determine at all.
FIRST_ALPHA, FIRST_BETA = 1e-6, 2.0
# While an epoch lowers the cost by more than this share, the errors are not noise yet, but what is still to be learnt.
# Taken for noise they smooth the network flat, often for good: a sine ends as a line.
LEARNING = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class BayesianRecord(TrainingRecord):
    """A training record with the evidence after every epoch.

    Attributes
    ----------
    gamk : (epochs + 1,) array
        Effective number of weights.
    ssX : (epochs + 1,) array
        Sum of squared weights.
    alpha, beta : (epochs + 1,) array
        Precision of a weight and of a scaled error; MATLAB's are half of these.
    """

    gamk: FloatArray
    ssX: FloatArray
    alpha: FloatArray
    beta: FloatArray


@dataclass(frozen=True, eq=False)
class RegularisedEquations(NormalEquations):
    """The equations of errors and weights together, with those of the errors alone."""

    errors: NormalEquations


@dataclass(frozen=True, eq=False)
class RegularisedProblem:
    """A network's fit with a Gaussian prior on its weights: ``(beta |e|^2 + alpha |w|^2) / 2``."""

    fit: FitProblem
    evidence: Evidence

    def cost(self, x: FloatArray) -> float:
        """The cost at weights `x` (n_weights,)."""
        return self.evidence.beta * self.fit.cost(x) + 0.5 * self.evidence.alpha * float(x @ x)

    def normal_equations(self, x: FloatArray) -> RegularisedEquations:
        """Cost, gradient and Gauss-Newton matrix at weights `x` (n_weights,)."""
        return self.weighted(x, self.fit.normal_equations(x))

    def weighted(self, x: FloatArray, errors: NormalEquations) -> RegularisedEquations:
        """The equations at `x` from those of the errors alone."""
        alpha, beta = self.evidence.alpha, self.evidence.beta
        gram = beta * errors.gram
        add_to_diagonal(gram, alpha)
        cost = beta * errors.cost + 0.5 * alpha * float(x @ x)
        return RegularisedEquations(cost, beta * errors.gradient + alpha * x, gram, errors)


@dataclass(frozen=True, eq=False, kw_only=True)
class BayesianOptions(DampedOptions):
    """Options of `trainbr`, as MATLAB's."""

    mu: float = 5e-3


def trainbr(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, BayesianRecord]:
    """Train a network's weights, weighing errors against the size of the weights by the evidence.

    Every epoch is a Levenberg-Marquardt step on ``beta |e|^2 + alpha |w|^2``, then one round of MacKay's fixed point.
    The number of weights in use, `gamk`, converges by itself, so that no validation data are needed to stop in time.

    Source: F. D. Foresee, M. T. Hagan, "Gauss-Newton approximation to Bayesian learning", ICNN 1997, 1930-1935. As
    there the first step is on the errors alone; MATLAB begins as if all weights were in use. Unlike both, alpha and
    beta then stand while an epoch lowers the cost by over a tenth: MacKay's equations hold at the most probable
    weights, and far from them the network is easily smoothed flat.

    Parameters
    ----------
    training : FitProblem
        It may have fewer errors than weights: the prior determines what the data do not, and gamma stays below their
        number.
    weights : (n_weights,) array
        Where to start.
    **options
        Those of `BayesianOptions`. Validation and test data are only recorded: they stop nothing, as in MATLAB
        (``max_fail`` 0). `min_grad` is a norm of the gradient of the cost. The cost here is half of beta times the
        squared errors and so on, with a beta that is twice MATLAB's: the same `mu` damps half as much.

    Returns
    -------
    weights : (n_weights,) array
        Those of the last epoch.
    record : BayesianRecord
        `perf` is the mean squared error, without the weights' share; `gradient` that of the whole cost.

    Raises
    ------
    InputError
        As `trainlm`.
    """
    chosen = BayesianOptions(**options)
    start = checked_start(training, weights, chosen)
    rounds, log = _EvidenceRounds(training, start, chosen.goal), TrainingLog(training, chosen)
    with one_blas_thread():
        end = levenberg_marquardt(
            RegularisedProblem(training, rounds.evidence),
            start,
            damping=chosen.damping(),
            stops=log.stops(rounds.goal_met, MinGradient(chosen.min_grad), DampingLimit()),
            callback=lambda state: log.keep(state, gradient=state.gradient_norm, **rounds.entries()),
            update_problem=rounds.renewed,
            clock=chosen.clock,
        )
    record = log.record(BayesianRecord)
    return end.x.copy(), replace(record, best_epoch=record.num_epochs)


class _EvidenceRounds:
    """The evidence of a training, round by round, with the mean squared error and the sum of squared weights."""

    def __init__(self, training: FitProblem, start: FloatArray, goal: float) -> None:
        self.training, self.goal, self.n = training, goal, training.n_errors
        self.evidence = Evidence(FIRST_ALPHA, FIRST_BETA, gamma=float(len(start)))
        self.perf, self.squares, self.is_first = training.mean_square(start), float(start @ start), True

    @property
    def cost(self) -> float:
        """Twice the cost under the evidence so far."""
        return self.evidence.beta * self.n * self.perf + self.evidence.alpha * self.squares

    def renewed(self, x: FloatArray, equations: NormalEquations) -> tuple[RegularisedProblem, NormalEquations]:
        """The problem after an epoch, by a round of the fixed point unless the network is still learning."""
        assert isinstance(equations, RegularisedEquations)  # made by the problem below
        before = self.cost
        self.perf, self.squares = 2 * equations.errors.cost / self.n, float(x @ x)
        if self.is_first or self.cost >= (1 - LEARNING) * before:  # the first step gives alpha its scale
            self.evidence = update_evidence(
                self.evidence,
                gram=equations.errors.gram,
                parameter_squares=self.squares,
                residual_squares=self.n * self.perf,
                n_residuals=self.n,
            )
        self.is_first = False
        problem = RegularisedProblem(self.training, self.evidence)
        return problem, problem.weighted(x, equations.errors)

    def goal_met(self, state: OptimizerState) -> StopReason | None:  # noqa: ARG002 - the goal is of the errors alone, not of the cost
        """Stop when the mean squared error is at the goal."""
        return StopReason("Performance goal met.", True) if self.perf <= self.goal else None

    def entries(self) -> dict[str, float]:
        """Of the record, after an epoch."""
        alpha, beta, gamma = self.evidence.alpha, self.evidence.beta, self.evidence.gamma
        return {"perf": self.perf, "gamk": gamma, "ssX": self.squares, "alpha": alpha, "beta": beta}
