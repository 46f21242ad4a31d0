"""The search for a network on readings of a person's own: a grid of settings, and a cross-validation.

The paper varies the amount of data, the goal, the learning rate and the units, and keeps the network with the smallest
error on further poses (Tables 2 to 4). Here further poses are those of a fold of a cross-validation, so that every
reading is tested once: readings of one position or pose are in one fold. A finished training is a model file: after an
interruption the same command resumes with the next one.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

from truearm import __version__
from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.references.cross_validation_groups import cross_validation_groups
from truearm.models import Compensator, NetworkModel, load_model
from truearm.models.arm_check import arm_of_readings
from truearm.models.network import GRADIENT_TRAINERS
from truearm.models.training_conditions import fingerprint
from truearm.nets.perceptron import Perceptron
from truearm.number_format import format_number
from truearm.readings import Session
from truearm.typing import FloatArray, IntArray
from truearm.wings.gao2017.tables import FINAL_TEST
from truearm.wings.gao2017.training import RECIPE, ProgressCallback

LEVELS_MM = tuple(FINAL_TEST["network"].over_mm)
"""The lengths above which the paper counts errors of coordinates."""
NORMAL_SHARE = math.erf(math.sqrt(2))
"""Share of a normal distribution within two standard deviations, 95.4 %."""
# Structures of the paper's tables, those of few weights first.
STRUCTURES = ((10,), (20,), (10, 10), (50,), (20, 20), (30, 30), (40, 40), (50, 50))
LEAST_TRIED = 3
# Share of the readings that a training has as validation data; it fits the others.
VALIDATION = 0.15


@dataclass(frozen=True)
class NetworkSetting:
    """What the paper varies from row to row of its tables.

    Attributes
    ----------
    hidden : tuple of int
        Units of the hidden layers.
    trainer : str
    goal : float
        Mean squared error of scaled outputs to stop at; 0: the validation data end a training.
    epochs : int
        Maximum.
    learning_rate : float
        Of gradient descent; the other trainers have none.
    """

    hidden: tuple[int, ...]
    trainer: str = "varpro"
    goal: float = 0.0
    epochs: int = 200
    learning_rate: float = 0.01

    def model(self, arm: Arm, *, seed: int, free: tuple[str, ...] = ("base", "tip")) -> NetworkModel:
        """The network, not yet trained."""
        # The evidence stops trainbr, and validation data would only be lost to it.
        validation = 0.0 if self.trainer == "trainbr" else VALIDATION
        return NetworkModel(arm, validation=validation, seed=seed, free=free, **vars(self))

    @property
    def training(self) -> str:
        """The trainer, and its learning rate if it has one."""
        return f"{self.trainer} {self.learning_rate:g}" if self.trainer in GRADIENT_TRAINERS else self.trainer

    def n_weights(self, n_joints: int) -> int:
        """Number of weights with biases."""
        return Perceptron.with_layers(n_joints, self.hidden, 3, activation="tansig").n_weights

    def __str__(self) -> str:
        return "-".join(map(str, self.hidden))


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

    def settings(self, n_readings: int, n_joints: int) -> tuple[NetworkSetting, ...]:
        """The networks to try."""
        coordinates = 3 * (1 - VALIDATION) * n_readings * (1 - 1 / self.folds)
        hidden = self.hidden or [
            one
            for k, one in enumerate(STRUCTURES)
            if k < LEAST_TRIED or NetworkSetting(one).n_weights(n_joints) <= coordinates
        ]
        found = [
            NetworkSetting(units, trainer, goal, self.epochs, rate)
            for units in hidden
            for trainer in self.trainer
            for goal in self.goal
            for rate in self.learning_rate or (NetworkSetting.learning_rate,)
        ]
        return tuple(dict.fromkeys(found))

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
    mean_mm, p95_mm, max_mm : float
    two_sigma_mm : float
        Twice the root mean square error, which counts a common offset too.
    over_mm : dict of float to int
        Coordinates with an error above each length [mm].
    """

    n: int
    mean_mm: float
    p95_mm: float
    max_mm: float
    two_sigma_mm: float
    over_mm: dict[float, int]

    @classmethod
    def of(cls, deviations: FloatArray) -> CoordinateErrors:
        """Of deviations (n, 3) [mm]."""
        errors = np.abs(deviations)
        over = {level: int((errors > level).sum()) for level in LEVELS_MM}
        two_sigma = 2 * float(np.sqrt((errors**2).mean()))
        mean, p95, largest = float(errors.mean()), float(np.quantile(errors, 0.95)), float(errors.max())
        return cls(len(errors), mean, p95, largest, two_sigma, over)

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
    """Trains networks one after the other, and tells the share of the estimated time that is over.

    Parameters
    ----------
    readings : Session
        All with points.
    grid : SearchGrid
    folder : path
        Has a model file for every finished training.
    progress : callable, optional
    total : float
        Estimated time of all trainings [s].

    Raises
    ------
    InputError
        If there are fewer positions or poses than two a fold.
    """

    readings: Session
    grid: SearchGrid
    folder: Path
    progress: ProgressCallback | None = None
    total: float = 1.0
    done: float = 0.0

    def __post_init__(self) -> None:
        self.groups, folds = cross_validation_groups(self.readings), self.grid.folds
        self.n_groups = int(self.groups.max()) + 1
        if folds < 2:
            raise InputError(f"expected 2 folds or more, got {folds}")
        if self.n_groups < 2 * folds:
            raise self.readings.error(
                f"expected {2 * folds} positions or poses for a cross-validation of {folds} folds, got {self.n_groups}",
                hint="measure more poses: a network needs hundreds, a kinematic model some twenty",
            )
        self.folds = fold_rows(self.groups, folds, self.grid.seed)
        # Networks of the folds know no arm, so that the same trainings serve with and without its description.
        self.no_arm = arm_of_readings(self.readings)

    def seconds(self, setting: NetworkSetting, n: int) -> float:
        """Rough time of a training with n readings [s], to divide a progress bar by."""
        weights = setting.n_weights(self.readings.n_joints)
        return setting.epochs / 2 * (1e-3 + n * weights**2 / 6e10 + weights**3 / 1e11)

    def tell(self, seconds: float, note: str) -> None:
        """Tell the share of the time that is over after more seconds."""
        if self.progress is not None:
            self.progress(min((self.done + seconds) / self.total, 1.0), note)

    def held_out(self, learn: Callable[[int, Session], Compensator], amount: int | None = None) -> FloatArray:
        """(n, 3) points of the readings by a model of the others [mm]; `learn` gets the number of the fold and these.

        Of an amount that is given, whole groups in random order are learned.
        """
        place = np.random.default_rng([self.grid.seed, *b"amount"]).permutation(self.n_groups)[self.groups]
        points = np.full((len(self.readings), 3), np.nan)
        for k, fold in enumerate(self.folds):
            rows = np.setdiff1d(np.arange(len(self.readings)), fold)
            rows = np.sort(rows[np.argsort(place[rows], kind="stable")[:amount]])
            points[fold] = learn(k, self.readings.rows(rows)).predict_readings(self.readings.rows(fold))
        return points

    def result(self, setting: NetworkSetting, amount: int | None = None) -> tuple[SettingResult, FloatArray]:
        """Errors of a network over all folds, and the points [mm] that it predicts of each reading without its fold."""
        networks: list[NetworkModel] = []

        def learn(k: int, train: Session) -> NetworkModel:
            note = f"{setting} {setting.trainer}, {len(train)} readings, fold {k + 1}"
            networks.append(self.network(setting.model(self.no_arm, seed=self.grid.seed + k), setting, train, note))
            return networks[-1]

        points = self.held_out(learn, amount)
        deviations = points - np.asarray(self.readings.points)
        row = SettingResult(
            setting,
            setting.n_weights(self.readings.n_joints),
            amount or round(len(self.readings) * (1 - 1 / len(self.folds))),
            CoordinateErrors.of(deviations),
            tuple(float(np.abs(deviations[rows]).mean()) for rows in self.folds),
            float(median(one.record_.num_epochs for one in networks)),
            sum(float(one.record_.time[-1]) for one in networks),
        )
        return row, points

    def network(self, network: NetworkModel, setting: NetworkSetting, train: Session, note: str) -> NetworkModel:
        """Train a network, or read the one that has been trained before.

        Raises
        ------
        InputError
            If the readings cannot train it, or its file is damaged or cannot be written.
        """
        own, seconds = fingerprint(train), self.seconds(setting, len(train))
        course = [__version__, RECIPE, vars(setting), network.seed, network.free, asdict(network.arm), own]
        digest = hashlib.sha256(json.dumps(course, default=np.ndarray.tolist).encode()).hexdigest()
        file = self.folder / f"own-{setting}-{len(train)}-{digest[:12]}.truearm"
        if file.exists():
            network = _read(file, setting, own)
        else:
            most = setting.epochs
            network.fit_readings(train, progress=lambda e, text: self.tell(seconds * e / most, f"{note}, {text}"))
            network.save(file)
        self.done += seconds
        self.tell(0.0, note)
        return network


def _read(file: Path, setting: NetworkSetting, own: str) -> NetworkModel:
    hint = "delete it and run the command again"
    try:
        found = load_model(file)
    except InputError as error:
        raise InputError(f"not the file of a finished training: {error.problem}", file=file, hint=hint) from None
    if not isinstance(found, NetworkModel) or (found.data_fingerprint_, found.hidden) != (own, setting.hidden):
        raise InputError("not the file of this training: it is of another one", file=file, hint=hint)
    return found
