"""The results of a reproduction, as the page shows them and ``reproduction.json`` has them.

Lengths in mm, times in s; None for a part that was not run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Literal

from truearm.typing import FloatArray
from truearm.wings.gao2017.tables import ModelErrors, PaperRow

Method = Literal["trainlm", "varpro"]
METHODS: tuple[Method, Method] = ("trainlm", "varpro")
"""The paper's own trainings by MATLAB's rules (gradient descent in two rows of Table 3), and truearm's trainer."""

MODELS = ("kinematic", "hybrid", "physical")
"""Models of the arm that are identified from the readings of the networks."""

SKIPPED, FITTED_BOX, CUT_SHORT = "skipped", "used to fit the box", "stopped by the time limit"
"""Verdicts that are no judgement of a row."""
GOAL_MET, TIME_OVER = "Performance goal met.", "Maximum time elapsed."
"""Stops of a training, in MATLAB's words; the time limit is ours."""


@dataclass(frozen=True)
class Run:
    """One random start of a training.

    Attributes
    ----------
    seed, epochs : int
    seconds : float
        CPU time.
    stop : str
        Why it ended, in MATLAB's words.
    mean_mm, max_mm : float
        Absolute error of a coordinate on as many poses as the paper tested.
    mean_many_mm, max_many_mm : float
        On 2000 further poses.
    seconds_to_paper, epochs_to_paper : float, int or None
        When the error first was at or below the mean error of the paper.
    curve : tuple of (int, float, float)
        Epoch, CPU time [s] and root mean square error on the fitted poses [mm]; empty where it was not kept.
    """

    seed: int
    epochs: int
    seconds: float
    stop: str
    mean_mm: float
    max_mm: float
    mean_many_mm: float
    max_many_mm: float
    seconds_to_paper: float | None
    epochs_to_paper: int | None
    curve: tuple[tuple[int, float, float], ...] = ()

    @property
    def was_cut(self) -> bool:
        """Whether the time limit ended it."""
        return self.stop == TIME_OVER


@dataclass(frozen=True)
class TrainerResult:
    """All starts of one trainer for a row of a table.

    Attributes
    ----------
    trainer : str
    runs : tuple of Run
    median : dict of str to float
        Over the starts, of each number of `Run`.
    range_mm : (float, float)
        Least and largest `mean_many_mm`.
    time_limit_s : float or None
        The limit that stopped a start; None if it stopped none.
    """

    trainer: str
    runs: tuple[Run, ...]
    median: dict[str, float]
    range_mm: tuple[float, float]
    time_limit_s: float | None

    @classmethod
    def of(cls, trainer: str, runs: Sequence[Run], *, time_limit_s: float | None) -> TrainerResult:
        """Summarize the starts."""
        keys = ("epochs", "seconds", "mean_mm", "max_mm", "mean_many_mm", "max_many_mm")
        many = [run.mean_many_mm for run in runs]
        medians = {key: float(median(getattr(run, key) for run in runs)) for key in keys}
        return cls(trainer, tuple(runs), medians, (min(many), max(many)), time_limit_s)

    @property
    def n_cut(self) -> int:
        """Number of starts that the time limit ended."""
        return sum(run.was_cut for run in self.runs)

    @property
    def seconds_to_paper(self) -> list[float]:
        """Times of the starts that reached the mean error of the paper."""
        return [run.seconds_to_paper for run in self.runs if run.seconds_to_paper is not None]

    @property
    def reaches_paper_error(self) -> bool:
        """Whether at least half of the starts reached the mean error of the paper."""
        return 2 * len(self.seconds_to_paper) >= len(self.runs)


@dataclass(frozen=True)
class RowResult:
    """A row of a table of the paper and its trainings.

    Attributes
    ----------
    paper : PaperRow
        As printed.
    activation : str
        Of the hidden units.
    same_training_as : int or None
        The row whose training by MATLAB's rules this row shares.
    results : dict of str to TrainerResult or None
    ratio : dict of str to float or None
        Median mean error by the paper's.
    verdict : dict of str to str or None
        None for a training that another row has already.
    note : str or None
    """

    paper: PaperRow
    activation: str
    same_training_as: int | None
    results: dict[Method, TrainerResult | None]
    ratio: dict[Method, float | None]
    verdict: dict[Method, str | None]
    note: str | None

    @property
    def verdicts(self) -> dict[Method, str]:
        """Verdicts of the trainings that were run, without those of another row."""
        return {name: verdict for name, verdict in self.verdict.items() if verdict and self.results[name] is not None}

    @property
    def timed(self) -> bool:
        """Whether a time to the paper's error is meaningful: gradient descent does not come near it."""
        return self.paper.trainer == "trainlm"


@dataclass(frozen=True)
class FinalTestRun:
    """The final test on one virtual arm: errors of the nominal arm, networks and models, and the noise floor."""

    seed: int
    errors: dict[str, ModelErrors]
    noise_floor_mm: float


@dataclass(frozen=True)
class FinalTestResult:
    """The final test of the paper (nominal and network), and ours on several virtual arms."""

    poses: int
    paper: dict[str, ModelErrors]
    runs: tuple[FinalTestRun, ...]

    def of(self, model: str) -> list[ModelErrors]:
        """Errors of a model on every virtual arm that it was fitted to."""
        return [run.errors[model] for run in self.runs if model in run.errors]

    def n_cut(self, model: str) -> int:
        """Number of arms on which the time limit ended the training of a network."""
        return sum(one.was_cut for one in self.of(model))

    def models(self) -> dict[str, list[ModelErrors]]:
        """Errors of the fitted models that were run."""
        return {name: errors for name in (*METHODS, *MODELS) if (errors := self.of(name))}


@dataclass(frozen=True)
class LearningRate:
    """Rows of the paper that differ in the learning rate only, and the one training that they share.

    `n_cut` of its starts were ended by the time limit; so in the other claims.
    """

    rates: tuple[float, ...]
    rows: tuple[int, ...]
    mean_mm: float
    paper_mean_mm: tuple[float, ...]
    n_cut: int = 0


@dataclass(frozen=True)
class Scatter:
    """One training from many random starts, and the paper's rows that differ only in settings without effect."""

    what: str
    mean_mm: tuple[float, ...]
    mean_many_mm: tuple[float, ...]
    relative_spread: float
    paper_rows: tuple[int, ...]
    paper_rows_mean_mm: tuple[float, ...]
    paper_relative_spread: float
    n_cut: int = 0


@dataclass(frozen=True)
class BoxStudy:
    """Mean errors of rows of Table 2 in boxes of several half-widths, and the paper's values, by row."""

    half_width_deg: tuple[float, ...]
    mean_mm: dict[int, tuple[float, ...]]
    paper_mean_mm: dict[int, float]
    n_cut: int = 0


@dataclass(frozen=True)
class OutsideErrors:
    """Median errors by the distance outside the training box, and the 95th percentile of the network."""

    distance_deg: tuple[float, ...]
    median_mm: dict[str, tuple[float, ...]]
    varpro_p95_mm: tuple[float, ...]
    n_cut: int = 0


@dataclass(frozen=True)
class Claims:
    """Experiments on the paper's claims about settings."""

    learning_rate: LearningRate | None = None
    scatter: Scatter | None = None
    boxes: BoxStudy | None = None
    outside: OutsideErrors | None = None


@dataclass(frozen=True, eq=False)
class ArmPose:
    """The arm at a pose: joint angles, (7, 4, 4) frames of the joints by Denavit and Hartenberg, the tip."""

    angles_deg: FloatArray
    frames: FloatArray
    tip_mm: FloatArray


@dataclass(frozen=True, eq=False)
class Predictions:
    """Joint angles (n, 6), true coordinates (n, 3) and those that each network predicts."""

    angles_deg: FloatArray
    points_mm: FloatArray
    predicted_mm: dict[str, FloatArray]

    def deviations(self) -> dict[str, FloatArray]:
        """Predicted minus true coordinates (n, 3)."""
        return {name: predicted - self.points_mm for name, predicted in self.predicted_mm.items()}


@dataclass(frozen=True, eq=False)
class FigureData:
    """Data of the paper's figures: 1 and 2 (arm), 3 (network), 4, 6 (nominal), 7 and 8 (network)."""

    arm: ArmPose | None = None
    network: tuple[int, ...] | None = None
    figure_4: Predictions | None = None
    figure_6: Predictions | None = None
    figure_7: Predictions | None = None
    figure_8: Predictions | None = None


@dataclass(frozen=True)
class Boxes:
    """Half-widths of the boxes of joint angles, and how they were chosen."""

    simulation_deg: float
    experiment_deg: float
    how: str


@dataclass(frozen=True, eq=False)
class Reproduction:
    """All results of a reproduction.

    Attributes
    ----------
    truearm : str
        Version.
    machines : list of dict
        Where the trainings ran: cpu, cores, python, numpy.
    trained : (str, str) or None
        Date and time of the first and last end of a training, UTC.
    quick : bool
    skipped : list of str
        Parts that a quick run skipped.
    training_seconds : float
    rule : str
        Of the verdicts.
    boxes : Boxes
    tables : dict of int to tuple of RowResult or None
    final_test : FinalTestResult or None
    claims : Claims
    figures : FigureData
    """

    truearm: str
    machines: list[Mapping[str, str | int]]
    trained: tuple[str, str] | None
    quick: bool
    skipped: list[str]
    training_seconds: float
    rule: str
    boxes: Boxes
    tables: dict[int, tuple[RowResult, ...] | None]
    final_test: FinalTestResult | None
    claims: Claims
    figures: FigureData

    def rows(self) -> list[RowResult]:
        """The rows of all tables that were run."""
        return [row for rows in self.tables.values() for row in rows or ()]


def trained(rows: Sequence[RowResult], name: Method) -> Iterator[tuple[RowResult, TrainerResult]]:
    """The rows that a trainer was run for, each with its result."""
    for row in rows:
        result = row.results[name]
        if result is not None:
            yield row, result
