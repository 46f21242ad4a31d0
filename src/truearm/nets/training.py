"""Common parts of the trainers: options, state after an epoch, the record of a training, division of samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from time import perf_counter
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.nets.normal_equations import FitProblem
from truearm.solve.least_squares_problem import MarquardtDamping
from truearm.solve.stop_criteria import BestPoint, MaxEpochs, MaxSeconds, OptimizerState, StopCriterion, ValidationStop
from truearm.typing import FloatArray, IntArray

Record = TypeVar("Record", bound="TrainingRecord")


class TrainingLog:
    """Record of a training, epoch by epoch.

    Parameters
    ----------
    training : FitProblem
    options : TrainingOptions
    full_weights : callable, optional
        All weights from the solver's parameters, where these are not all.

    Attributes
    ----------
    half : float
        Half the number of errors: cost = half * mse.
    """

    def __init__(
        self,
        training: FitProblem,
        options: TrainingOptions,
        full_weights: Callable[[FloatArray], FloatArray] | None = None,
    ) -> None:
        self.half = training.n_errors / 2
        self._options, self._full_weights = options, full_weights
        self._rows: list[dict[str, float]] = []
        self._best: BestPoint | None = None
        self._stop = ""
        self._watch: ValidationStop | None = None
        if (validation := options.validation) is not None:
            max_fail = getattr(options, "max_fail", np.inf)
            self._watch = ValidationStop(lambda x: validation.mean_square(self._weights_at(x)), max_fail)

    def stops(self, goal: StopCriterion, *others: StopCriterion) -> list[StopCriterion]:
        """The stops in MATLAB's order: goal, epochs, time, others, and the validation stop if there are such data."""
        limits: list[StopCriterion] = [MaxEpochs(self._options.epochs), MaxSeconds(self._options.time)]
        return [goal, *limits, *others, *([] if self._watch is None else [self._watch])]

    def keep(
        self, state: OptimizerState, *, perf: float, gradient: float, mu: float | None = None, **more: float
    ) -> None:
        """Record the state after an epoch, once the stops were asked; `mu` where the trainer counts it otherwise.

        `more` are entries that only the trainer's own record has.
        """
        mu = state.mu if mu is None else mu
        if self._watch is None:
            vperf, val_fail = np.nan, 0
            best = self._best
            self._best = BestPoint(state.epoch, state.x, perf) if best is None else best.updated_with(state, perf)
        else:
            assert self._watch.best is not None  # asked before
            vperf, self._best = self._watch.last_error, self._watch.best
            val_fail = self._best.failures
        tperf = np.nan if self._options.test is None else self._options.test.mean_square(self._weights_at(state.x))
        if self._options.callback is not None:
            weights = partial(self._all_weights, state.x)
            self._options.callback(Epoch(state.epoch, perf, vperf, mu, gradient, val_fail, state.seconds, weights))
        row = {"perf": perf, "vperf": vperf, "tperf": tperf, "mu": mu, "gradient": gradient, "val_fail": val_fail}
        self._rows.append(row | {"time": state.seconds} | more)
        self._stop = "" if state.reason is None else state.reason.text

    def record_lm_epoch(self, state: OptimizerState, *, mu: float | None = None) -> None:
        """Record a state of Levenberg-Marquardt on the errors alone."""
        self.keep(state, perf=state.cost / self.half, gradient=state.gradient_norm / self.half, mu=mu)

    def best_weights(self) -> FloatArray:
        """All weights (n_weights,) of the best epoch by the validation error, or by `perf` without validation data."""
        assert self._best is not None  # the start is recorded at least
        return self._all_weights(self._best.x)

    def record(self, cls: type[Record]) -> Record:
        """The training's record, of class `cls`."""
        assert self._best is not None
        columns: dict[str, Any] = {
            name: np.array([row[name] for row in self._rows], dtype=np.intp if name == "val_fail" else float)
            for name in self._rows[0].keys() & {field.name for field in fields(cls)}
        }
        return cls(**columns, best_epoch=self._best.epoch, stop=self._stop)

    def _weights_at(self, x: FloatArray) -> FloatArray:
        return x if self._full_weights is None else self._full_weights(x)

    def _all_weights(self, x: FloatArray) -> FloatArray:
        return x.copy() if self._full_weights is None else self._full_weights(x)


@dataclass(frozen=True, eq=False)
class Epoch:
    """State of a training after an epoch.

    Attributes
    ----------
    epoch : int
        Epochs done; 0 is the start.
    perf, vperf : float
        Mean squared error of scaled outputs on training and validation data; NaN where there are none.
    mu : float
        Damping; NaN where there is none.
    gradient : float
        Norm of the gradient, as the trainer's record has it.
    val_fail : int
        Validation failures since the best epoch.
    seconds : float
        Time of training so far [s].
    weights : callable
        Returns all weights (n_weights,) of this epoch.
    """

    epoch: int
    perf: float
    vperf: float
    mu: float
    gradient: float
    val_fail: int
    seconds: float
    weights: Callable[[], FloatArray]


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainingRecord:
    """What a training did, under MATLAB's names; every array has an entry for each epoch, the start first.

    Attributes
    ----------
    perf, vperf, tperf : (epochs + 1,) array
        Mean squared error of scaled outputs on training, validation and test data; NaN where there are none.
    mu : (epochs + 1,) array
        Damping; NaN where there is none.
    gradient : (epochs + 1,) array
        Norm of the gradient of `perf` by the weights.
    val_fail : (epochs + 1,) array
        Validation failures since the best epoch.
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

    @property
    def num_epochs(self) -> int:
        """Epochs done."""
        return len(self.perf) - 1


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainingOptions:
    """Options that all trainers have, under MATLAB's names.

    Parameters
    ----------
    validation, test : FitProblem, optional
        The same network on other samples; without `validation` there is no validation stop.
    epochs : int
        Maximum.
    goal : float
        Mean squared error of scaled outputs to stop at.
    time : float
        Maximum [s].
    clock : callable
        Returns the seconds that `time` and the record count: passed time, or `time.process_time`.
    callback : callable, optional
        Called after every epoch, and at the start.

    Raises
    ------
    InputError
        If an option can never be meant: below zero, NaN, no whole number where one is needed.
    """

    validation: FitProblem | None = None
    test: FitProblem | None = None
    epochs: int = 1000
    goal: float = 0.0
    time: float = float("inf")
    clock: Callable[[], float] = perf_counter
    callback: Callable[[Epoch], None] | None = None

    def __post_init__(self) -> None:
        for name, least in (("epochs", 0), ("max_fail", 1)):
            value = getattr(self, name, least)
            if not isinstance(value, int | np.integer) or value < least:
                raise InputError(f"expected {name} as a whole number of {least} or more, got {value!r}")
        for name in ("goal", "time", "min_grad"):
            if not getattr(self, name, 0.0) >= 0:
                raise InputError(f"expected {name} of 0 or more, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class DampedOptions(TrainingOptions):
    """Options of trainers that damp their steps by Marquardt's rule.

    Parameters
    ----------
    min_grad : float
        Norm of the gradient to stop at.
    mu, mu_dec, mu_inc, mu_max : float
        Damping, its factors after a step that lowered the cost and after one that did not, and its limit.
    """

    min_grad: float = 1e-7
    mu: float = 1e-3
    mu_dec: float = 0.1
    mu_inc: float = 10.0
    mu_max: float = 1e10

    def damping(self, unit: float = 1.0) -> MarquardtDamping:
        """The rule, with the damping in multiples of a unit."""
        return MarquardtDamping(unit * self.mu, self.mu_dec, self.mu_inc, unit * self.mu_max)


def checked_start(training: FitProblem, weights: npt.ArrayLike, options: TrainingOptions) -> FloatArray:
    """The start weights (n_weights,) as doubles.

    Raises
    ------
    InputError
        If they are not finite numbers, one for each weight of the network; or validation or test data are for another
        network.
    """
    network = training.network
    start = np.array(weights, dtype=float)
    if start.shape != (network.n_weights,):
        sizes = "-".join(map(str, network.sizes))
        raise InputError(f"expected {network.n_weights} start weights for a {sizes} network, got shape {start.shape}")
    if not np.isfinite(start).all():
        raise InputError("expected start weights that are finite numbers, got NaN or infinity")
    for what in ("validation", "test"):
        if (problem := getattr(options, what)) is not None and problem.network != network:
            raise InputError(f"expected {what} data of the network in training, got those of another network")
    return start


def dividerand(
    n: int, *, train: float = 0.7, validation: float = 0.15, test: float = 0.15, seed: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Indices of a random division of n samples into training, validation and test data.

    The shares are taken relative to their sum, as in MATLAB; 1, 0, 0 trains on everything.

    Raises
    ------
    InputError
        If a share is negative, or no samples remain to train on.
    """
    shares = np.array([train, validation, test], dtype=float)
    if (shares < 0).any() or not np.isfinite(shares).all() or shares.sum() <= 0:
        raise InputError(f"expected shares of training, validation and test data of 0 or more, got {shares.tolist()}")
    n_validation, n_test = (int(np.floor(n * float(share) + 0.5)) for share in shares[1:] / shares.sum())
    if n - n_validation - n_test < 1:
        raise InputError(f"no samples remain to train on: {n} in all, {n_validation} to validate, {n_test} to test")
    order = np.random.default_rng([seed, *b"dividerand"]).permutation(n)
    parts = np.split(order, [n - n_validation - n_test, n - n_test])
    return np.sort(parts[0]), np.sort(parts[1]), np.sort(parts[2])
