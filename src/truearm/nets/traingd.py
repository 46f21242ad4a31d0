"""MATLAB's ``traingd``: gradient descent with its names, defaults and stops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from truearm.errors import InputError
from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import TrainingOptions, TrainingRecord, checked_start
from truearm.nets.training_log import TrainingLog
from truearm.solve import CostGoal, LearningRate, MinGradient, gradient_descent
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class DescentOptions(TrainingOptions):
    """Options of `traingd`, as MATLAB's.

    Parameters
    ----------
    lr : float
        The step for a unit of the gradient of the mean squared error of scaled outputs.
    max_fail : int
        Validation failures since the best epoch that end it.
    min_grad : float
        Norm of the gradient to stop at.
    """

    lr: float = 0.01
    max_fail: int = 6
    min_grad: float = 1e-5


@dataclass(frozen=True, eq=False)
class MeanSquareProblem:
    """MATLAB's ``mse`` of a network's scaled outputs, as a problem in its weights."""

    fit: FitProblem

    def gradient(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Mean squared error, and its gradient (n_weights,), at weights `x` (n_weights,)."""
        cost, gradient = self.fit.gradient(x)
        half = self.fit.n_errors / 2
        return cost / half, gradient / half


def traingd(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, TrainingRecord]:
    """Train a network's weights by ``weights - lr * gradient of the mean squared error``.

    It takes very many epochs; it is here because others report it. It ends, asked in this order after every epoch,
    when `perf` is at `goal`, after `epochs`, after `time`, when `gradient` is at `min_grad`, and when the validation
    error was above its best `max_fail` times. An error that grows beyond all bounds ends it too.

    Source: defaults and stops as https://www.mathworks.com/help/deeplearning/ref/traingd.html has them.

    Parameters and results are those of `trainlm`, with options of `DescentOptions`; `mu` of the record is NaN.
    """
    chosen = DescentOptions(**options)
    if not 0 < chosen.lr < float("inf"):
        raise InputError(f"expected a learning rate lr above zero, got {chosen.lr}")
    log = descend(training, weights, chosen, LearningRate(chosen.lr))
    return log.best_weights(), log.record(TrainingRecord)


def descend(training: FitProblem, weights: FloatArray, options: DescentOptions, rate: LearningRate) -> TrainingLog:
    """The log of a training by gradient descent."""
    start, log = checked_start(training, weights, options), TrainingLog(training, options)
    with one_blas_thread():
        gradient_descent(
            MeanSquareProblem(training),
            start,
            rate=rate,
            stops=log.stops(CostGoal(options.goal), MinGradient(options.min_grad)),
            callback=lambda state: log.keep(state, perf=state.cost, gradient=state.gradient_norm, lr=state.rate),
            clock=options.clock,
        )
    return log
