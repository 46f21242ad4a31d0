"""Trials: models fitted to some readings of a person's own, and the points that they predict of others.

A finished trial is one file. After an interruption the same command resumes with the next one.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from time import process_time
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from truearm import __version__
from truearm.arm import Arm
from truearm.compensation.models import Compensator, NetworkModel
from truearm.compensation.models.training_conditions import fingerprint
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import read_limited
from truearm.papers.gao2017.training import LARGEST_FILE, ProgressCallback
from truearm.readings.session import Session
from truearm.typing import FloatArray

# Raised whenever the course of a trial changes, so that no result of an older course is used for it.
RECIPE = 1

Fit = Callable[[str, Session], Compensator]
"""Fits a model of the arm, by its name, to readings."""


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
    learning_rate : float or None
        Of gradient descent; None: the trainer has none.
    epochs : int
        Maximum.
    """

    hidden: tuple[int, ...]
    trainer: str = "varpro"
    goal: float = 0.0
    learning_rate: float | None = None
    epochs: int = 200

    def model(self, arm: Arm, *, seed: int) -> NetworkModel:
        """The network, not yet trained."""
        options: dict[str, Any] = {name: value for name, value in vars(self).items() if value is not None}
        if self.trainer == "trainbr":  # the evidence stops it, and validation data would only be lost to it
            options["validation"] = 0.0
        return NetworkModel(arm, seed=seed, **options)

    def n_weights(self, n_joints: int) -> int:
        """Number of weights with biases."""
        return sum((before + 1) * after for before, after in pairwise((n_joints, *self.hidden, 3)))

    def __str__(self) -> str:
        return "-".join(map(str, self.hidden))


@dataclass(frozen=True, eq=False)
class Trial:
    """One fit and one prediction.

    Attributes
    ----------
    what : NetworkSetting or str
        A network, or the name of a model of the arm.
    train, tested : Session
        Readings to learn from, and to predict.
    arm : Arm
    seed : int
        Of a network's start weights.
    free : tuple of str
        What is unknown of the placement of the arm.
    """

    what: NetworkSetting | str
    train: Session
    tested: Session
    arm: Arm
    seed: int = 0
    free: tuple[str, ...] = ()

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the version, the recipe, the readings and all settings that determine the prediction."""
        if isinstance(self.what, str):
            setting: object = [self.what, self.free, asdict(self.arm)]
        else:
            setting = [vars(self.what), self.seed]
        readings = fingerprint(self.train), fingerprint(self.tested)
        text = json.dumps([__version__, RECIPE, setting, readings], default=np.ndarray.tolist)
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def name(self) -> str:
        """A file name: the model, and enough of the fingerprint to distinguish all trials."""
        return f"own-{self.what}-{len(self.train)}-{self.fingerprint[:12]}"

    @property
    def estimated_seconds(self) -> float:
        """Rough time [s], to divide a progress bar by."""
        n = len(self.train)
        if isinstance(self.what, str):
            return 0.005 * n
        weights = self.what.n_weights(self.train.n_joints)
        return self.what.epochs / 2 * (1e-3 + n * weights**2 / 6e10 + weights**3 / 1e11)


_Number = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
_Text = Annotated[str, Field(max_length=4000)]


class TrialResult(BaseModel):
    """What a trial gave, and its file.

    Attributes
    ----------
    fingerprint : str
        Of the trial.
    predicted : list of (float, float, float)
        Points of the readings that it did not learn from [mm].
    epochs : int or None
        Of a network.
    seconds : float
        CPU time of the fit.
    refused : str
        Why there is no model; empty where there is one.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    fingerprint: Annotated[str, Field(max_length=64)]
    predicted: Annotated[list[tuple[_Number, _Number, _Number]], Field(max_length=1_000_000)]
    epochs: Annotated[int, Field(ge=0, le=10**9)] | None = None
    seconds: Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
    refused: _Text = ""

    @property
    def points(self) -> FloatArray:
        """(n, 3) predicted points [mm]."""
        return np.array(self.predicted, dtype=float).reshape(-1, 3)


def run_trial(trial: Trial, folder: Path, fit: Fit, progress: ProgressCallback) -> TrialResult:
    """Fit and predict, or read the result of a trial that has finished before: ``NAME.json`` in `folder`.

    A model of the arm that these readings do not determine has a result without points.

    Raises
    ------
    InputError
        If the readings cannot train a network, or the file is damaged or cannot be written.
    """
    file = folder / f"{trial.name}.json"
    if file.exists():
        return _read(file, trial)
    begun, refused, epochs, points = process_time(), "", None, np.zeros((0, 3))
    if isinstance(trial.what, NetworkSetting):
        most = trial.what.epochs
        network = trial.what.model(trial.arm, seed=trial.seed)
        network.fit_readings(trial.train, progress=lambda epoch, note: progress(epoch / most, note))
        epochs, points = network.record_.num_epochs, network.predict_readings(trial.tested)
    else:
        try:
            points = fit(trial.what, trial.train).predict_readings(trial.tested)
        except InputError as error:
            refused = error.problem[:4000]
    result = TrialResult(
        fingerprint=trial.fingerprint,
        predicted=[(x, y, z) for x, y, z in points.tolist()],
        epochs=epochs,
        seconds=process_time() - begun,
        refused=refused,
    )
    with atomic_file(file) as beside:
        beside.write_text(result.model_dump_json() + "\n", encoding="utf-8", newline="\n")
    return result


def claim_folder(folder: Path, readings: Session) -> None:
    """Write down whose trials a folder holds: a file ``readings-SHA256.txt``.

    Raises
    ------
    InputError
        If they are of other readings.
    """
    own = folder / f"readings-{fingerprint(readings)[:32]}.txt"
    others = [file for file in folder.glob("readings-*.txt") if file != own]
    if others:
        of = read_limited(others[0], limit_bytes=10_000).decode("utf-8", "replace").strip()
        raise readings.error(
            f"the finished trainings in {folder} are of other readings ({of}), or the file has changed since",
            hint="another folder (--out), or delete this one",
        )
    with atomic_file(own) as beside:
        beside.write_text(f"{len(readings)} readings of {readings.file or 'no file'}\n", encoding="utf-8")


def _read(file: Path, trial: Trial) -> TrialResult:
    try:
        kept = TrialResult.model_validate_json(read_limited(file, limit_bytes=LARGEST_FILE))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        problem = f"{'.'.join(map(str, first['loc']))}: {first['msg']}".removeprefix(": ")
    else:
        if kept.fingerprint == trial.fingerprint and len(kept.predicted) == (0 if kept.refused else len(trial.tested)):
            return kept
        problem = "it is of another training, or lacks points"
    hint = "delete it and run the command again"
    raise InputError(f"not the file of a finished training: {problem}", file=file, hint=hint)
