"""MATLAB's ``trainlm``: Levenberg-Marquardt training with its names, defaults and stops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.nets.normal_equations import FitProblem
from truearm.solve import (
    Classical,
    DampingLimit,
    Epochs,
    Goal,
    Gradient,
    Result,
    Seconds,
    State,
    Stop,
    Validation,
    levenberg_marquardt,
)
from truearm.solve.threads import one_blas_thread

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class TrainingRecord:
    """What a training did, under MATLAB's names; every array has an entry for each epoch, the start first.

    Attributes
    ----------
    perf, vperf, tperf : (epochs + 1,) array
        Mean squared error of scaled outputs on training, validation and test data; NaN where there are none.
    mu : (epochs + 1,) array
        Damping.
    gradient : (epochs + 1,) array
        Norm of the gradient of `perf` by the weights.
    val_fail : (epochs + 1,) array
        Validation failures in a row.
    time : (epochs + 1,) array
        Since the start [s].
    best_epoch : int
        The epoch whose weights were kept.
    stop : str
        Why it ended, in MATLAB's words.
    """

    perf: FloatArray
    vperf: FloatArray
    tperf: FloatArray
    mu: FloatArray
    gradient: FloatArray
    val_fail: IntArray
    time: FloatArray
    best_epoch: int
    stop: str


def dividerand(
    n: int, *, train: float = 0.7, validation: float = 0.15, test: float = 0.15, seed: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Indices of a random division of n samples into training, validation and test data.

    The shares are taken relative to their sum, as in MATLAB; 1, 0, 0 trains on everything.

    Raises
    ------
    InputError
        If a share is negative, or nothing is left to train on.
    """
    shares = np.array([train, validation, test], dtype=float)
    if (shares < 0).any() or not np.isfinite(shares).all() or shares.sum() <= 0:
        raise InputError(f"expected shares of training, validation and test data of 0 or more, got {shares.tolist()}")
    n_validation, n_test = (round(n * float(share)) for share in shares[1:] / shares.sum())
    if n - n_validation - n_test < 1:
        raise InputError(f"no samples left to train on: {n} in all, {n_validation} to validate, {n_test} to test")
    order = np.random.default_rng([seed, *b"dividerand"]).permutation(n)
    parts = np.split(order, [n - n_validation - n_test, n - n_test])
    return np.sort(parts[0]), np.sort(parts[1]), np.sort(parts[2])


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
    callback: Callable[[State], None] | None = None,
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
        Told the solver's state after every epoch.

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
            callback(state)

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


def training_record(result: Result, n_errors: int, watch: Validation | None, tperf: FloatArray) -> TrainingRecord:
    """The record of a minimisation of `n_errors` residuals; `watch` is the validation data's rule, if there was one."""
    half, n = n_errors / 2, len(result.history)
    return TrainingRecord(
        perf=np.array([state.cost for state in result.history]) / half,
        vperf=np.full(n, np.nan) if watch is None else np.array(watch.errors),
        tperf=tperf,
        mu=np.array([state.mu for state in result.history]),
        gradient=np.array([state.gradient_norm for state in result.history]) / half,
        val_fail=np.zeros(n, dtype=np.intp) if watch is None else np.array(watch.failures, dtype=np.intp),
        time=np.array([state.seconds for state in result.history]),
        best_epoch=result.epochs if watch is None else watch.best_epoch,
        stop=result.reason.text,
    )
