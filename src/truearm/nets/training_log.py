"""Record of a training, epoch by epoch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any, TypeVar

import numpy as np

from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import Epoch, TrainingOptions, TrainingRecord
from truearm.solve import BestPoint, MaxEpochs, MaxSeconds, OptimizerState, StopCriterion, ValidationStop
from truearm.typing import FloatArray

Record = TypeVar("Record", bound=TrainingRecord)


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
