"""Training by variable projection, with Nielsen's damping and geodesic acceleration.

The linear output layer is solved for at every step, only hidden weights are searched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from array_api_compat import array_namespace, device

from truearm.errors import TruearmError
from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import TrainingLog, TrainingOptions, TrainingRecord, checked_start
from truearm.solve import CostConverged, CostGoal, NormalEquations, levenberg_marquardt
from truearm.solve.linear_algebra import Array, add_to_diagonal, as_array_like, cholesky_solve, to_numpy, whiten
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
