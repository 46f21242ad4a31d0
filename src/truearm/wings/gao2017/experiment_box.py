"""The error of row 4 of Table 4 against the box of joint angles, and what the stops of the trainings say about the box.

The paper's training ran all 1000 epochs without meeting its goal, and its network errs by 0.0149 mm. A goal is a mean
squared error of outputs scaled to [-1, 1]: in mm it grows with the box. In a box in which a training that just met its
goal errs by more than the paper's network, the paper's training would have met it too. So that box, where the error of
`trainlm` at the goal is the paper's, is the widest that agrees with the stop of the paper.

The trainings take hours of CPU time. Their numbers are kept in ``experiment_box.json``, which
``python -m benchmarks paper box`` makes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median

import numpy as np
import numpy.typing as npt

from truearm.wings.gao2017.results import METHODS, Method

FILE = Path(__file__).with_name("experiment_box.json")


@dataclass(frozen=True)
class BoxRun:
    """A training of row 4 of Table 4 in a box.

    Attributes
    ----------
    half_width_deg : float
    method : {"trainlm", "varpro"}
    seed, epochs : int
    stop : str
        In MATLAB's words.
    mean_mm, max_mm : float
        Absolute error of a coordinate on 2000 further poses.
    seconds : float
        CPU time.
    """

    half_width_deg: float
    method: Method
    seed: int
    epochs: int
    stop: str
    mean_mm: float
    max_mm: float
    seconds: float


@dataclass(frozen=True)
class ExperimentBoxStudy:
    """The trainings, and how they were made."""

    how: str
    runs: tuple[BoxRun, ...]

    def of(self, method: Method) -> dict[float, tuple[BoxRun, ...]]:
        """The starts of a trainer by half-width, in order."""
        widths = sorted({run.half_width_deg for run in self.runs if run.method == method})
        return {
            width: tuple(run for run in self.runs if (run.method, run.half_width_deg) == (method, width))
            for width in widths
        }

    def median_mm(self, method: Method) -> dict[float, float]:
        """Median mean error of the starts by half-width."""
        return {width: float(median(run.mean_mm for run in runs)) for width, runs in self.of(method).items()}


@cache
def load_experiment_box() -> ExperimentBoxStudy:
    """The study that is kept with the program."""
    kept = json.loads(FILE.read_text(encoding="utf-8"))
    runs = tuple(BoxRun(**run) for run in kept["runs"])
    assert all(run.method in METHODS for run in runs)  # written by the benchmark
    return ExperimentBoxStudy(kept["how"], runs)


def widths_at(study: ExperimentBoxStudy, level_mm: float) -> list[float]:
    """Half-widths [deg] at which the median error of trainlm is `level_mm`, interpolated in its logarithm."""
    medians = study.median_mm("trainlm")
    return crossings([*medians], [*medians.values()], level_mm)


def crossings(x: npt.ArrayLike, y: npt.ArrayLike, level: float) -> list[float]:
    """Every x where a curve through points crosses a level, interpolated linearly in the logarithm of y."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    order = np.argsort(x)
    x, height = x[order], np.log(y[order] / level)
    places = [float(x[i]) for i in np.flatnonzero(height == 0)]
    for i in np.flatnonzero(height[:-1] * height[1:] < 0):
        places.append(float(x[i] + (x[i + 1] - x[i]) * height[i] / (height[i] - height[i + 1])))
    return sorted(places)
