"""MATLAB's ``trainlm``: Levenberg-Marquardt training with its names, defaults and stops."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.training import Epoch, TrainingRecord, check_stops, checked_start
from truearm.compensation.nets.training_log import TrainingLog
from truearm.solve import (
    CostGoal,
    DampingLimit,
    MarquardtDamping,
    MaxEpochs,
    MaxSeconds,
    MinGradient,
    OptimizerState,
    levenberg_marquardt,
)
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray


def trainlm(
    training: FitProblem,
    weights: FloatArray,
    *,
    validation: FitProblem | None = None,
    test: FitProblem | None = None,
    epochs: int = 1000,
    goal: float = 0.0,
    max_fail: int = 6,
    min_grad: float = 1e-7,
    mu: float = 1e-3,
    mu_dec: float = 0.1,
    mu_inc: float = 10.0,
    mu_max: float = 1e10,
    time: float = float("inf"),
    clock: Callable[[], float] = perf_counter,
    callback: Callable[[Epoch], None] | None = None,
) -> tuple[FloatArray, TrainingRecord]:
    """Train a network's weights.

    It ends, asked in this order after every epoch, when `perf` is at `goal`, after `epochs`, after `time`, when
    `gradient` is at `min_grad`, when `mu` is at `mu_max`, and when the validation error was above its best `max_fail`
    times. With more weights than errors it still trains: the damping chooses among the weights that fit alike.

    Parameters
    ----------
    training, validation, test : FitProblem
        The same network on different samples; without `validation` there is no validation stop.
    weights : (n_weights,) array
        Where to start.
    epochs, goal, max_fail, min_grad, mu, mu_dec, mu_inc, mu_max, time
        As in MATLAB. `goal` is a mean squared error of scaled outputs, `min_grad` a norm of its gradient, `time` is
        in seconds. The damping `mu` is added to ``J^T J / n`` of the n scaled errors, as MATLAB's is for ``mse``.
    clock : callable
        Returns the seconds that `time` and the record count: passed time, or `time.process_time`.
    callback : callable, optional
        Called after every epoch, and at the start.

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
    start = checked_start(training, weights, validation, test)
    check_stops(epochs=epochs, goal=goal, time=time, min_grad=min_grad, max_fail=max_fail)
    # (J^T J / n + mu I) step = -J^T e / n, multiplied by n.
    n = training.n_errors
    damping = MarquardtDamping(n * mu, mu_dec, mu_inc, n * mu_max)
    log = TrainingLog(
        training,
        validation,
        test,
        max_fail=max_fail,
        callback=callback,
    )

    def keep(state: OptimizerState) -> None:
        log.record_lm_epoch(state, mu=state.mu / n)

    with one_blas_thread():
        levenberg_marquardt(
            training,
            start,
            damping=damping,
            stops=[
                CostGoal(goal * log.half),
                MaxEpochs(epochs),
                MaxSeconds(time),
                MinGradient(min_grad * log.half),
                DampingLimit(),
                *log.stops,
            ],
            callback=keep,
            clock=clock,
        )
    return log.best_weights(), log.record(TrainingRecord)
