"""The search for a network on readings of a person's own: a grid of settings, and a cross-validation.

The paper varies the amount of data, the goal, the learning rate and the units, and keeps the network with the smallest
error on further poses (Tables 2 to 4). Here further poses are those of a fold of a cross-validation, so that every
reading is tested once: readings of one position or pose are in one fold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

from truearm.arm import Arm
from truearm.compensation.models import NetworkModel
from truearm.compensation.models.model_file import load_model, save_model
from truearm.errors import InputError
from truearm.identification.judgement.cross_validation_groups import cross_validation_groups
from truearm.number_format import format_number
from truearm.papers.gao2017.tables import FINAL_TEST
from truearm.papers.gao2017.training import GRADIENT_TRAINERS, ProgressCallback
from truearm.papers.gao2017.trials import Fit, NetworkSetting, Trial, TrialResult, run_trial
from truearm.readings.session import Session
from truearm.typing import FloatArray, IntArray

LEVELS_MM = tuple(FINAL_TEST["network"].over_mm)
"""The lengths above which the paper counts errors of coordinates."""
NORMAL_SHARE = math.erf(math.sqrt(2))
"""Share of a normal distribution within two standard deviations, 95.4 %."""
# Structures of the paper's tables, those of few weights first.
STRUCTURES = ((10,), (20,), (10, 10), (50,), (20, 20), (30, 30), (40, 40), (50, 50))
LEAST_TRIED = 3
# Share of the readings that a training fits; the others are its validation data.
FITTED = 0.85


@dataclass(frozen=True)
class SearchGrid:
    """What is tried: every combination of the settings, then the best of them with fewer readings.

    Attributes
    ----------
    hidden : tuple of tuple of int
        Units of the hidden layers; empty: those of `STRUCTURES` with no more weights than coordinates to fit.
    trainer : tuple of str
        As in `NetworkModel`.
    goal : tuple of float
        Mean squared error of scaled outputs to stop at; 0: validation data alone end a training.
    learning_rate : tuple of float
        Of ``traingd`` and ``traingdx``; the Levenberg-Marquardt trainers have none.
    amount : tuple of int
        Numbers of training readings; empty: an eighth, a quarter and a half.
    epochs : int
        Maximum of a training.
    folds : int
        Of the cross-validation.
    seed : int
        Of folds and start weights.
    """

    hidden: tuple[tuple[int, ...], ...] = ()
    trainer: tuple[str, ...] = ("varpro",)
    goal: tuple[float, ...] = (0.0,)
    learning_rate: tuple[float, ...] = ()
    amount: tuple[int, ...] = ()
    epochs: int = 200
    folds: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        if self.learning_rate and not set(self.trainer) <= GRADIENT_TRAINERS.keys():
            raise InputError(
                f"a learning rate belongs to gradient descent, got the trainers {', '.join(self.trainer)}: the "
                "Levenberg-Marquardt method has a damping in its place",
                hint=f"no learning rate, or the trainers {' and '.join(GRADIENT_TRAINERS)} alone",
            )
        if self.folds < 2 or min(self.amount, default=1) < 1:
            raise InputError(f"expected 2 folds or more and amounts of 1 or more, got {self.folds}, {self.amount}")

    def settings(self, n_readings: int, n_joints: int) -> tuple[NetworkSetting, ...]:
        """The networks to try, those of few weights first."""
        coordinates = 3 * FITTED * n_readings * (1 - 1 / self.folds)
        weights = {hidden: NetworkSetting(hidden).n_weights(n_joints) for hidden in self.hidden or STRUCTURES}
        structures = sorted(weights, key=lambda hidden: weights[hidden])
        if not self.hidden:
            structures = structures[: max(LEAST_TRIED, sum(n <= coordinates for n in weights.values()))]
        return tuple(
            NetworkSetting(hidden, trainer, goal, rate, self.epochs)
            for hidden in structures
            for trainer in self.trainer
            for goal in self.goal
            for rate in self.learning_rate or (None,)
        )

    def quick(self) -> SearchGrid:
        """Three folds, and where none are named the three smallest structures."""
        return replace(self, folds=min(self.folds, 3), hidden=self.hidden or STRUCTURES[:LEAST_TRIED])


@dataclass(frozen=True)
class CoordinateErrors:
    """Absolute errors of single coordinates, as the paper states them.

    Attributes
    ----------
    n : int
        Readings; three coordinates each.
    mean_mm, rms_mm, p95_mm, max_mm : float
        The 95 % quantile is that of the coordinates.
    two_sigma_mm : float
        Twice the root mean square error, which counts a common offset too.
    over_mm : dict of float to int
        Coordinates with an error above each length [mm].
    mean_distance_mm : float
        Mean distance of the points.
    """

    n: int
    mean_mm: float
    rms_mm: float
    p95_mm: float
    max_mm: float
    two_sigma_mm: float
    over_mm: dict[float, int]
    mean_distance_mm: float

    @classmethod
    def of(cls, deviations: FloatArray) -> CoordinateErrors:
        """Of deviations (n, 3) [mm]."""
        errors = np.abs(deviations)
        rms, over = float(np.sqrt((errors**2).mean())), {level: int((errors > level).sum()) for level in LEVELS_MM}
        mean, p95, largest = float(errors.mean()), float(np.quantile(errors, 0.95)), float(errors.max())
        distance = float(np.linalg.norm(errors, axis=1).mean())
        return cls(len(errors), mean, rms, p95, largest, 2 * rms, over, distance)

    def two_sigma_sentence(self) -> str:
        """The paper's statement, by count and by the root mean square."""
        level, within = LEVELS_MM[0], 1 - self.over_mm[LEVELS_MM[0]] / (3 * self.n)
        counts = " and ".join(f"by more than {length:g} mm in {n}" for length, n in self.over_mm.items())
        by_count, by_rms = ("yes" if good else "no" for good in (within >= NORMAL_SHARE, self.two_sigma_mm <= level))
        return (
            f"Of {3 * self.n} coordinates the network errs {counts} (the paper's lengths; of its 600 coordinates 13 "
            f"and 3). Is 2 sigma below {level:g} mm? By count {by_count}: {100 * within:.1f} % are within it (of a "
            f"normal distribution {100 * NORMAL_SHARE:.1f} % within 2 sigma). By twice the root mean square error "
            f"{by_rms}: {format_number(self.two_sigma_mm)} mm. 95 % are within {format_number(self.p95_mm)} mm."
        )


@dataclass(frozen=True, eq=False)
class SettingResult:
    """A row of the search: a network and its errors on readings that it did not learn from.

    Attributes
    ----------
    setting : NetworkSetting
    n_weights, n_train : int
        Training readings of a fold, the mean.
    errors : CoordinateErrors
        Of all folds together.
    fold_mean_mm : tuple of float
        Mean error of each fold, which has a random start of its own.
    epochs : float
        Median.
    seconds : float
        CPU time of all folds.
    """

    setting: NetworkSetting
    n_weights: int
    n_train: int
    errors: CoordinateErrors
    fold_mean_mm: tuple[float, ...]
    epochs: float
    seconds: float


def fold_rows(groups: IntArray, folds: int, seed: int) -> tuple[IntArray, ...]:
    """Rows of each fold, whole groups (n,) at a time."""
    fold = np.random.default_rng([seed, *b"folds"]).permutation(int(groups.max()) + 1) % folds
    return tuple(np.flatnonzero(fold[groups] == k) for k in range(folds))


@dataclass
class CrossValidation:
    """Runs trials one after the other, and tells the share of the estimated time that is over.

    Parameters
    ----------
    arm : Arm
    readings : Session
        All with points.
    grid : SearchGrid
    fit : callable
    free : tuple of str
        What is unknown of the placement of the arm.
    folder : path
        Has a file for every finished trial.
    progress : callable, optional
    total : float
        Estimated time of all trials [s].

    Raises
    ------
    InputError
        If there are fewer positions or poses than two a fold.
    """

    arm: Arm
    readings: Session
    grid: SearchGrid
    fit: Fit
    free: tuple[str, ...]
    folder: Path
    progress: ProgressCallback | None = None
    total: float = 1.0

    def __post_init__(self) -> None:
        self.groups = cross_validation_groups(self.readings)
        self.n_groups, folds = len(np.unique(self.groups)), self.grid.folds
        if self.n_groups < 2 * folds:
            raise self.readings.error(
                f"expected {2 * folds} positions or poses for a cross-validation of {folds} folds, got {self.n_groups}",
                hint="measure more poses: a network needs hundreds, a kinematic model some twenty",
            )
        self.folds = fold_rows(self.groups, folds, self.grid.seed)
        self.done = 0.0

    def trials(self, what: NetworkSetting | str, amount: int | None = None) -> list[Trial]:
        """A trial for each fold; `amount` readings at most are learned, whole groups in random order."""
        place = np.random.default_rng([self.grid.seed, *b"amount"]).permutation(self.n_groups)[self.groups]
        found = []
        for k, held_out in enumerate(self.folds):
            rows = np.setdiff1d(np.arange(len(self.readings)), held_out)
            rows = np.sort(rows[np.argsort(place[rows], kind="stable")[:amount]])
            train, tested = self.readings.rows(rows), self.readings.rows(held_out)
            found.append(Trial(what, train, tested, self.arm, self.grid.seed + k, self.free))
        return found

    def predict(
        self, what: NetworkSetting | str, note: str, *, amount: int | None = None, test: Session | None = None
    ) -> tuple[FloatArray, list[TrialResult]]:
        """(n, 3) points of the test by a model of all readings, or of all readings, each without its fold [mm]."""
        if test is None:
            trials, rows = self.trials(what, amount), self.folds
        else:
            trials, rows = [Trial(what, self.readings, test, self.arm, free=self.free)], (np.arange(len(test)),)
        results, points = [], np.full((sum(map(len, rows)), 3), np.nan)
        for k, (trial, where) in enumerate(zip(trials, rows, strict=True), 1):
            label = note if test is not None else f"{note}, fold {k}"
            tell = self.teller(trial, label)
            result = run_trial(trial, self.folder, self.fit, tell)
            tell(1.0, "")
            self.done += trial.estimated_seconds
            results.append(result)
            if not result.refused:
                points[where] = result.points
        return points, results

    def teller(self, trial: Trial, label: str) -> ProgressCallback:
        """Progress within a trial as a share of all."""
        before, own = self.done, trial.estimated_seconds

        def tell(part: float, note: str) -> None:
            if self.progress is not None:
                self.progress(min((before + own * part) / self.total, 1.0), f"{label} {note}")

        return tell

    def result(self, setting: NetworkSetting, amount: int | None = None) -> tuple[SettingResult, FloatArray]:
        """Errors of a network over all folds, and the points [mm] that it predicts of each reading without its fold."""
        of = "" if amount is None else f" of {amount} readings"
        points, results = self.predict(setting, f"{setting} {setting.trainer}{of}", amount=amount)
        deviations = points - np.asarray(self.readings.points)
        n_train = round(len(self.readings) * (1 - 1 / len(self.folds)))
        row = SettingResult(
            setting,
            setting.n_weights(self.readings.n_joints),
            n_train if amount is None else amount,
            CoordinateErrors.of(deviations),
            tuple(float(np.abs(deviations[rows]).mean()) for rows in self.folds),
            float(median(one.epochs or 0 for one in results)),
            sum(one.seconds for one in results),
        )
        return row, points

    def final_network(self, setting: NetworkSetting) -> NetworkModel:
        """The network trained on all readings, or the one that has been trained before: a model file in the folder."""
        trial = Trial(setting, self.readings, self.readings, self.arm, self.grid.seed)
        file, tell = self.folder / f"{trial.name}.truearm", self.teller(trial, f"{setting}, all readings,")
        if file.exists():
            found = load_model(file)
            assert isinstance(found, NetworkModel)  # by its name
            return found
        network = setting.model(self.arm, seed=self.grid.seed)
        network.fit_readings(self.readings, progress=lambda epoch, note: tell(epoch / setting.epochs, note))
        save_model(network, file)
        return network
