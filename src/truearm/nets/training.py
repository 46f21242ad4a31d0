"""What all trainers share: the record of a training, what is told after an epoch, the division of the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.solve import Result, State, Validation

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Epoch:
    """How a training stands after an epoch.

    Attributes
    ----------
    epoch : int
        Epochs done; 0 is the start.
    perf, vperf : float
        Mean squared error of scaled outputs on training and validation data; NaN where there are none.
    mu : float
        Damping; NaN where there is none.
    gradient : float
        Norm of the gradient of `perf` by the weights.
    val_fail : int
        Validation failures in a row.
    seconds : float
        Time of training so far [s].
    weights : callable
        Gives all weights (n_weights,) as they are now.
    """

    epoch: int
    perf: float
    vperf: float
    mu: float
    gradient: float
    val_fail: int
    seconds: float
    weights: Callable[[], FloatArray]


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


def epoch_of(state: State, n_errors: int, watch: Validation | None, weights: Callable[[], FloatArray]) -> Epoch:
    """What a trainer tells of the solver's state."""
    return Epoch(
        epoch=state.epoch,
        perf=2 * state.cost / n_errors,
        vperf=np.nan if watch is None else watch.errors[-1],
        mu=state.mu,
        gradient=2 * state.gradient_norm / n_errors,
        val_fail=0 if watch is None else watch.failures[-1],
        seconds=state.seconds,
        weights=weights,
    )


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
