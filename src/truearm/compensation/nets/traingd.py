"""MATLAB's ``traingd``: gradient descent with its names, defaults and stops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.training import Epoch, TrainingRecord, check_stops, checked_start
from truearm.compensation.nets.training_log import TrainingLog
from truearm.errors import InputError
from truearm.solve import CostGoal, DescentState, LearningRate, MaxEpochs, MaxSeconds, MinGradient, gradient_descent
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class MeanSquareProblem:
    """MATLAB's ``mse`` of a network's scaled outputs, as a problem in its weights."""

    fit: FitProblem

    def gradient(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Mean squared error, and its gradient (n_weights,), at weights `x` (n_weights,)."""
        cost, gradient = self.fit.gradient(x)
        half = self.fit.n_errors / 2
        return cost / half, gradient / half


def traingd(
    training: FitProblem,
    weights: FloatArray,
    *,
    validation: FitProblem | None = None,
    test: FitProblem | None = None,
    epochs: int = 1000,
    goal: float = 0.0,
    lr: float = 0.01,
    max_fail: int = 6,
    min_grad: float = 1e-5,
    time: float = float("inf"),
    clock: Callable[[], float] = perf_counter,
    callback: Callable[[Epoch], None] | None = None,
) -> tuple[FloatArray, TrainingRecord]:
    """Train a network's weights by ``weights - lr * gradient of the mean squared error``.

    It takes very many epochs; it is here because others report it. It ends, asked in this order after every epoch,
    when `perf` is at `goal`, after `epochs`, after `time`, when `gradient` is at `min_grad`, and when the validation
    error was above its best `max_fail` times. An error that grows beyond all bounds ends it too.

    Source: defaults and stops as https://www.mathworks.com/help/deeplearning/ref/traingd.html has them.

    Parameters
    ----------
    training, validation, test : FitProblem
        The same network on different samples; without `validation` there is no validation stop.
    weights : (n_weights,) array
        Where to start.
    epochs, goal, lr, max_fail, min_grad, time
        As in MATLAB. `goal` is a mean squared error of scaled outputs, `min_grad` a norm of its gradient, `lr` the
        step for a unit of it, `time` is in seconds.
    clock, callback
        As in `trainlm`.

    Returns
    -------
    weights : (n_weights,) array
        Those of the best validation epoch, or of the best `perf` without validation data.
    record : TrainingRecord
        Its `mu` is NaN.

    Raises
    ------
    InputError
        As `trainlm`.
    """
    if not 0 < lr < float("inf"):
        raise InputError(f"expected a learning rate lr above zero, got {lr}")
    start = checked_start(training, weights, validation, test)
    check_stops(epochs=epochs, goal=goal, time=time, min_grad=min_grad, max_fail=max_fail)
    log = TrainingLog(
        training,
        validation,
        test,
        max_fail=max_fail,
        callback=callback,
    )

    def keep(state: DescentState) -> None:
        log.keep(state, perf=state.cost, gradient=state.gradient_norm)

    with one_blas_thread():
        gradient_descent(
            MeanSquareProblem(training),
            start,
            rate=LearningRate(lr),
            stops=[CostGoal(goal), MaxEpochs(epochs), MaxSeconds(time), MinGradient(min_grad), *log.stops],
            callback=keep,
            clock=clock,
        )
    return log.best_weights(), log.record(TrainingRecord)
