"""MATLAB's ``trainlm``: Levenberg-Marquardt training with its names, defaults and stops."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import Epoch, TrainingRecord, epoch_of, training_record
from truearm.solve import (
    Classical,
    DampingLimit,
    Epochs,
    Goal,
    Gradient,
    Seconds,
    State,
    Stop,
    Validation,
    levenberg_marquardt,
)
from truearm.solve.threads import one_blas_thread

FloatArray = npt.NDArray[np.float64]


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
    callback: Callable[[Epoch], None] | None = None,
) -> tuple[FloatArray, TrainingRecord]:
    """Train a network's weights.

    Parameters
    ----------
    training, validation, test : FitProblem
        The same network on different samples; without `validation` there is no validation stop.
    weights : (n_weights,) array
        Where to start.
    epochs, goal, max_fail, min_grad, mu, mu_dec, mu_inc, mu_max, time
        As in MATLAB. `goal` is a mean squared error of scaled outputs, `min_grad` a norm of its gradient, `time` is
        in seconds. The damping `mu` stands beside ``J^T J`` of the scaled errors, summed over samples and outputs.
    callback : callable, optional
        Told how it goes after every epoch, and at the start.

    Returns
    -------
    weights : (n_weights,) array
        Those of the best validation epoch, or the last ones without validation data.
    record : TrainingRecord
    """
    half = training.n_errors / 2  # cost = half * mse
    watch = None if validation is None else Validation(validation.mean_square, max_fail)
    tests: list[float] = []

    def keep_test_error(state: State) -> None:
        tests.append(np.nan if test is None else test.mean_square(state.x))
        if callback is not None:
            callback(epoch_of(state, training.n_errors, watch, lambda: state.x))

    stops: list[Stop] = [
        Goal(goal * half),
        Epochs(epochs),
        Seconds(time),
        Gradient(min_grad * half),
        DampingLimit(),
    ]
    with one_blas_thread():
        result = levenberg_marquardt(
            training,
            weights,
            damping=Classical(mu, mu_dec, mu_inc, mu_max),
            stops=stops if watch is None else [*stops, watch],
            callback=keep_test_error,
        )
    kept = result.x if watch is None or watch.best_x is None else watch.best_x
    return kept, training_record(result, training.n_errors, watch, np.array(tests))
