"""The log of a training: record, callback, checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import partial
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from truearm.compensation.nets.checkpoint import RESTART_HINT, Checkpoint, TrainingSnapshot
from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.training import Epoch, TrainingRecord
from truearm.errors import InputError
from truearm.solve import BestPoint, MarquardtDamping, NielsenDamping, OptimizerState, StopCriterion, ValidationStop
from truearm.typing import FloatArray

COLUMNS = ("perf", "vperf", "tperf", "mu", "gradient", "val_fail", "time")
Record = TypeVar("Record", bound=TrainingRecord)


@dataclass(frozen=True, eq=False)
class _EpochState:
    """State of a training after an epoch; replaced as a whole, so that an interrupt never sees a part of it."""

    n_rows: int
    x: FloatArray
    memory: FloatArray
    best: BestPoint
    stop: str


class TrainingLog:
    """Keeps the record of a training, calls back after every epoch, writes the checkpoint and resumes from it.

    The training runs in its context: at an interrupt (Ctrl-C, kill) the checkpoint is written first.

    Parameters
    ----------
    trainer : str
        Which trainer keeps it.
    start : (p,) array
        The solver's parameters at the start.
    training, validation, test : FitProblem
        As the trainer was given them.
    epochs : int
        Maximum number of epochs.
    max_fail : float
        Of the validation stop.
    n_memory : int
        Numbers that the solver remembers in addition to its parameters.
    extra : tuple of str
        Columns of the record that only this trainer has.
    full_weights : callable, optional
        All weights from the solver's parameters, where these are not all.
    callback : callable, optional
        Called after every epoch.
    checkpoint : Checkpoint, optional

    Attributes
    ----------
    resumed : dict or None
        The last row of the record that the checkpoint held, by name; None where the training begins.

    Raises
    ------
    InputError
        If the checkpoint's file is damaged or of another training.
    """

    def __init__(
        self,
        trainer: str,
        start: FloatArray,
        training: FitProblem,
        validation: FitProblem | None,
        test: FitProblem | None,
        *,
        epochs: int,
        max_fail: float = float("inf"),
        n_memory: int,
        extra: tuple[str, ...] = (),
        full_weights: Callable[[FloatArray], FloatArray] | None = None,
        callback: Callable[[Epoch], None] | None,
        checkpoint: Checkpoint | None,
    ) -> None:
        self.start = start
        self.half = training.n_errors / 2  # cost = half * mse
        self._trainer, self._columns = trainer, COLUMNS + extra
        self._test, self._completed, self._callback, self._checkpoint = test, full_weights, callback, checkpoint
        self.resumed: dict[str, float] | None = None
        self._rows: list[tuple[float, ...]] = []
        self._last: _EpochState | None = None
        self._written = time.perf_counter()
        self._watch: ValidationStop | None = None
        if validation is not None:
            self._watch = ValidationStop(lambda x: validation.mean_square(self._weights_at(x)), max_fail)
        if checkpoint is not None:
            saved = checkpoint.read(
                trainer, most_rows=epochs + 1, n_columns=len(self._columns), n=len(start), n_memory=n_memory
            )
            if saved is not None:
                self._take_up(saved)

    @property
    def stops(self) -> list[StopCriterion]:
        """The validation stop, if there are validation data."""
        return [] if self._watch is None else [self._watch]

    @property
    def ended(self) -> bool:
        """Whether the training has come to its end."""
        return self._last is not None and self._last.stop != ""

    @property
    def x(self) -> FloatArray:
        """The solver's parameters as they are."""
        return self.start if self._last is None else self._last.x

    @property
    def epoch(self) -> int:
        """Epochs done."""
        return len(self._rows) - 1

    @property
    def memory(self) -> FloatArray:
        """What else the solver remembered after the last epoch."""
        return np.empty(0) if self._last is None else self._last.memory

    def lm_start(self, damping: MarquardtDamping | NielsenDamping) -> FloatArray | OptimizerState:
        """Start of Levenberg-Marquardt, or the state to resume from."""
        if (row := self.resumed) is None:
            return self.start
        try:
            damping = type(damping)(*self.memory.tolist())
        except InputError as error:
            raise self.damaged(error.problem) from None
        return OptimizerState(
            epoch=self.epoch,
            x=self.x,
            cost=np.nan,  # the solver works out these three again
            previous_cost=np.nan,
            gradient_norm=np.nan,
            seconds=row["time"],
            damping=damping,
        )

    def keep(
        self,
        state: OptimizerState,
        *,
        perf: float,
        gradient: float,
        memory: npt.ArrayLike,
        extra: tuple[float, ...] = (),
    ) -> None:
        """Take in the state after an epoch, once the stops were asked."""
        before = None if self._last is None else self._last.best
        if self._watch is None:
            vperf = np.nan
            best = BestPoint(state.epoch, state.x, perf) if before is None else before.updated_with(state, perf)
        else:
            assert self._watch.best is not None  # asked before
            vperf, best = self._watch.last_error, self._watch.best
        val_fail = 0 if self._watch is None else best.failures
        tperf = np.nan if self._test is None else self._test.mean_square(self._weights_at(state.x))
        if self._callback is not None:
            # Before the epoch is recorded: if the callback is interrupted, it is called again after a resume.
            weights = partial(self._all_weights, state.x)
            self._callback(Epoch(state.epoch, perf, vperf, state.mu, gradient, val_fail, state.seconds, weights))
        self._rows.append((perf, vperf, tperf, state.mu, gradient, val_fail, state.seconds, *extra))
        reason = "" if state.reason is None else state.reason.text
        self._last = _EpochState(len(self._rows), state.x, np.array(memory, dtype=float), best, reason)
        now = time.perf_counter()
        if self._checkpoint is not None and (reason or now - self._written >= self._checkpoint.seconds):
            self._write()
            self._written = time.perf_counter()

    def record_lm_epoch(self, state: OptimizerState) -> None:
        """Take in a state of Levenberg-Marquardt on the errors alone."""
        perf, gradient = state.cost / self.half, state.gradient_norm / self.half
        self.keep(state, perf=perf, gradient=gradient, memory=damping_memory(state))

    def best_weights(self) -> FloatArray:
        """All weights (n_weights,) of the best epoch by the validation error, or by `perf` without validation data."""
        assert self._last is not None  # the start is kept at least
        return self._all_weights(self._last.best.x)

    def record(self, cls: type[Record]) -> Record:
        """The training's record, of class `cls`."""
        assert self._last is not None
        columns: dict[str, Any] = dict(zip(self._columns, np.array(self._rows, dtype=float).T.copy(), strict=True))
        columns["val_fail"] = columns["val_fail"].astype(np.intp)
        return cls(**columns, best_epoch=self._last.best.epoch, stop=self._last.stop)

    def damaged(self, problem: str) -> InputError:
        """An error about the checkpoint's file."""
        return InputError(problem, file=None if self._checkpoint is None else self._checkpoint.file, hint=RESTART_HINT)

    def __enter__(self) -> TrainingLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, KeyboardInterrupt | SystemExit):
            self._write()

    def _write(self) -> None:
        if self._checkpoint is None or self._last is None:
            return
        last = self._last
        rows = np.array(self._rows[: last.n_rows], dtype=float)
        self._checkpoint.write(
            self._trainer, TrainingSnapshot(rows, last.x, last.memory, last.best.x, last.best.epoch, last.stop)
        )

    def _take_up(self, saved: TrainingSnapshot) -> None:
        columns = dict(zip(self._columns, saved.rows.T, strict=True))
        judged = columns["perf" if self._watch is None else "vperf"]
        needed = [judged, *(column for name, column in columns.items() if name not in ("vperf", "tperf", "mu"))]
        if not len(saved.rows) or not all(np.isfinite(column).all() for column in needed):
            raise self.damaged("the checkpoint's record is empty or has numbers that are not finite")
        failures = int(columns["val_fail"][-1])
        best = BestPoint(saved.best_epoch, saved.best_x, float(judged[saved.best_epoch]), failures)
        if self._watch is not None:
            self._watch.best = best
        self._rows = [tuple(row) for row in saved.rows.tolist()]
        self.resumed = dict(zip(self._columns, self._rows[-1], strict=True))
        self._last = _EpochState(len(self._rows), saved.x, saved.memory, best, saved.stop)

    def _weights_at(self, x: FloatArray) -> FloatArray:
        return x if self._completed is None else self._completed(x)

    def _all_weights(self, x: FloatArray) -> FloatArray:
        return x.copy() if self._completed is None else self._completed(x)


def damping_memory(state: OptimizerState) -> tuple[float, ...]:
    """The numbers of a state's damping rule, as `TrainingLog.lm_start` takes them up."""
    assert isinstance(state.damping, MarquardtDamping | NielsenDamping)
    return tuple(map(float, astuple(state.damping)))
