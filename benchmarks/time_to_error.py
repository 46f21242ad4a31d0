"""How long a training takes to an error: the same task, the same error and the same clock for everyone.

The clock stands still while an error is evaluated: that is nobody's time. Needs NumPy alone, so that peers read it in
an environment of their own.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Task:
    """What to train and how it is judged.

    Attributes
    ----------
    sizes : (layers,) array
        Units of every layer: tanh in the hidden ones, a linear output.
    inputs, targets : (units, n) array
        Samples in columns, scaled to [-1, 1].
    test_inputs, test_targets : (units, m) array
        Samples to judge by, in the same scale.
    unit : (outputs,) array
        What an output of 1 is in the unit of the error.
    squared : bool
        Whether the error is the mean square (in squared units), not the mean of absolute values.
    start : (weights,) array
        Start weights: of each layer W (inputs + 1, outputs), row by row, the bias in the last row.
    """

    sizes: np.ndarray
    inputs: np.ndarray
    targets: np.ndarray
    test_inputs: np.ndarray
    test_targets: np.ndarray
    unit: np.ndarray
    squared: bool
    start: np.ndarray

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Shapes of the layers' W."""
        return [(int(m) + 1, int(n)) for m, n in zip(self.sizes[:-1], self.sizes[1:], strict=True)]

    def layers(self, weights: np.ndarray) -> list[np.ndarray]:
        """The layers' W as views into the vector of weights."""
        ends = np.cumsum([m * n for m, n in self.shapes])
        return [part.reshape(shape) for part, shape in zip(np.split(weights, ends[:-1]), self.shapes, strict=True)]

    def error(self, weights: np.ndarray) -> float:
        """Mean error of a coordinate on the test samples."""
        values, layers = self.test_inputs, self.layers(weights)
        for number, W in enumerate(layers, start=1):
            values = W[:-1].T @ values + W[-1][:, None]
            if number < len(layers):
                np.tanh(values, out=values)
        errors = self.unit[:, None] * (values - self.test_targets)
        return float(np.mean(errors**2 if self.squared else np.abs(errors)))

    def write(self, file: Path) -> None:
        """Write it for a peer."""
        np.savez(file, **vars(self))

    @classmethod
    def read(cls, file: Path) -> Task:
        """Read what `write` wrote."""
        with np.load(file, allow_pickle=False) as arrays:
            return cls(**{name: arrays[name] for name in arrays.files})


class Over(Exception):
    """The training may stop: its goal or its limit is reached."""


@dataclass(frozen=True)
class Curve:
    """How a training went.

    Attributes
    ----------
    seconds, errors : list of float
        Time of training and error after every epoch, the start first where the trainer shows it.
    end : str
        Why it ended.
    """

    seconds: list[float]
    errors: list[float]
    end: str

    @property
    def epochs(self) -> int:
        """Epochs seen."""
        return len(self.errors)

    def seconds_to(self, error: float) -> float | None:
        """Time to the first error at or below `error`, or None."""
        return next((s for s, e in zip(self.seconds, self.errors, strict=True) if e <= error), None)

    def best_by(self, seconds: float) -> float | None:
        """The smallest error up to a time, or None where no epoch was done by then."""
        return min((e for s, e in zip(self.seconds, self.errors, strict=True) if s <= seconds), default=None)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


@dataclass
class Watch:
    """Keeps time and errors of one training, and ends it.

    Parameters
    ----------
    task : Task
    goal : float
        An error at or below it ends the training.
    limit : float
        So does so much time of training [s].
    """

    task: Task
    goal: float
    limit: float
    _seconds: list[float] = field(default_factory=list)
    _errors: list[float] = field(default_factory=list)
    _trained: float = 0.0
    _since: float = 0.0

    def run(self, train: Callable[[Watch], str]) -> Curve:
        """Train until it is over; `train` calls `epoch` after each of its epochs and says why it stopped by itself."""
        self._since = time.perf_counter()
        try:
            end = train(self)
        except Over as over:
            end = str(over)
        return Curve(self._seconds, self._errors, end)

    def epoch(self, weights: Callable[[], np.ndarray]) -> None:
        """Stop the clock, evaluate the error of the weights, let the clock go on."""
        self._trained += time.perf_counter() - self._since
        error = self.task.error(weights())
        if not np.isfinite(error):
            raise Over("diverged")
        self._seconds.append(self._trained)
        self._errors.append(error)
        if error <= self.goal:
            raise Over("goal")
        if self._trained >= self.limit:
            raise Over("limit")
        self._since = time.perf_counter()

    def in_time(self) -> None:
        """For loops inside an epoch that need not end: stop at the limit."""
        if self._trained + time.perf_counter() - self._since > self.limit:
            raise Over("limit")

    def restart(self) -> None:
        """Forget the time so far: what came before was not training (imports, a compiler's work)."""
        self._trained, self._since = 0.0, time.perf_counter()
