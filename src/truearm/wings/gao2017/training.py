"""One training of a network as the paper does it: its data, its settings, its result, and the file of the result."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from time import process_time
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError

from truearm import __version__
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file, check_writable
from truearm.files.file_reading import read_limited
from truearm.models.network import GRADIENT_TRAINERS, TRAINERS
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import MinMaxScaler, Perceptron, nguyen_widrow
from truearm.nets.training import Epoch, dividerand
from truearm.solve.threads import cores
from truearm.typing import FloatArray
from truearm.wings.gao2017.results import TIME_OVER
from truearm.wings.planning.designs.planned_readings import box
from truearm.wings.planning.virtual import Measurement, VirtualArm, load_preset

ProgressCallback = Callable[[float, str], None]
"""Called with the share of the work that is done, and a few words on its state."""

ARM = "gao2017"
N_EVALUATION_POSES = 2000
"""Further poses on which an error is evaluated, in addition to the few of the paper's test."""
TRAINING_STREAM, TEST_STREAM, EVALUATION_STREAM, OUTSIDE_STREAM, FINAL_TEST_STREAM = 0, 1, 3, 4, 5
"""Random streams of poses and noise of one seed; `truearm.wings.gao2017.demo` has 0 to 2."""
RECIPE = 2
"""Raised whenever the course of a training changes, so that no result of an older course is used for it."""
CURVE_POINTS = 60
"""The most points of a learning curve that are kept, evenly in the logarithm of the epoch."""
_LARGEST_RMS_MM = 1e12
LARGEST_FILE = 20_000_000  # bytes: a network of the paper takes less than one


@dataclass(frozen=True)
class Source:
    """The source of poses and points: a box of joint angles, and an arm.

    Attributes
    ----------
    half_width_deg : float
        Of the box about the working pose, in every joint.
    virtual : bool
        Whether to measure a virtual arm of the preset ``research``, another for every seed. Otherwise the points are
        exactly those of the paper's Table 1.
    """

    half_width_deg: float
    virtual: bool

    def data(self, n: int, *, seed: int, stream: int) -> tuple[FloatArray, FloatArray]:
        """Angles (n, 6) [rad] and points (n, 3) [mm]."""
        if self.virtual:
            readings = self.measurement(n, seed=seed, stream=stream).readings
            assert readings.points is not None  # a virtual reference measures every pose
            return readings.angles, readings.points
        angles = self._angles(n, stream_seed(seed, stream))
        return angles, load_arm(ARM).chain.tip_in_base(angles)

    def measurement(self, n: int, *, seed: int, stream: int) -> Measurement:
        """The virtual arm's readings in the box."""
        own = stream_seed(seed, stream)
        return virtual_arm(seed).measure(self._angles(n, own), seed=own)

    def _angles(self, n: int, seed: int) -> FloatArray:
        return box(load_arm(ARM), n, seed=seed, half_width=np.radians(self.half_width_deg)).angles


def stream_seed(seed: int, stream: int) -> int:
    """Seed of a random stream; those of one seed are neighbours, those of the next seed follow."""
    return 10 * seed + stream


@lru_cache(maxsize=16)
def virtual_arm(seed: int) -> VirtualArm:
    """The arm in place of the paper's: its nominal model has errors of the same size."""
    return VirtualArm.draw(load_arm(ARM), load_preset("research"), seed=seed)


@dataclass(frozen=True)
class Training:
    """All settings of a training.

    Attributes
    ----------
    source : Source
    n_train : int
        Poses, with those for validation and test.
    hidden : tuple of int
        Units of the hidden layers.
    activations : tuple of str
        Of the hidden layers.
    trainer : str
        One of `TRAINERS`.
    epochs : int
        Maximum.
    goal : float
        Mean squared error of the scaled outputs to stop at.
    validation_share : float
        Share of the poses for the validation stop; as many again are test data, as in MATLAB.
    time_limit_s : float or None
        Limit of the CPU time, which does not depend on what else the machine does as the passed time would.
    seed : int
        Of the poses, the division and the start weights.
    levels_mm : tuple of float
        Mean absolute coordinate errors on `N_EVALUATION_POSES` further poses whose first epoch is recorded.
    expected_epochs : int or None
        Epochs for the estimate of the time; None: `epochs`.
    """

    source: Source
    n_train: int
    hidden: tuple[int, ...]
    activations: tuple[str, ...]
    trainer: str
    epochs: int
    goal: float
    validation_share: float
    time_limit_s: float | None
    seed: int
    levels_mm: tuple[float, ...] = ()
    expected_epochs: int | None = None

    @property
    def network(self) -> Perceptron:
        """Its shape: six angles, the hidden layers, three coordinates."""
        return Perceptron((6, *self.hidden, 3), self.activations)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the program's version, the recipe and all settings that determine a complete training."""
        settings = asdict(self) | {"expected_epochs": None, "time_limit_s": None}
        return hashlib.sha256(json.dumps([__version__, RECIPE, settings]).encode()).hexdigest()

    @property
    def name(self) -> str:
        """A file name: readable settings, and enough of the fingerprint to distinguish all trainings."""
        layers = "-".join(map(str, self.hidden))
        kind = "experiment" if self.source.virtual else "simulation"
        return f"{kind}-{self.n_train}-{layers}-{self.trainer}-{self.seed}-{self.fingerprint[:12]}"

    @property
    def estimated_seconds(self) -> float:
        """Estimated time on two cores of a current machine [s]: 6e10 products a second, and the work for each pose.

        The limit is one of CPU time, of which two cores spend two seconds in a second.
        """
        fitted, weights = self.n_train * (1 - 2 * self.validation_share), self.network.n_weights
        if self.trainer in GRADIENT_TRAINERS:
            epoch = 1e-3 + 6 * fitted * weights / 1e10
        else:
            epoch = 1e-3 + 1.5e-6 * fitted + fitted * weights**2 / 6e10 + weights**3 / 1e11
        epochs = min(self.epochs, self.expected_epochs or self.epochs)
        return min(epochs * epoch, (self.time_limit_s or math.inf) / 2)


_Number = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
_Count = Annotated[int, Field(ge=0, le=10**9)]
_Seconds = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
_Rms = Annotated[float, Field(ge=0, le=_LARGEST_RMS_MM, allow_inf_nan=False)]
_Ends = Annotated[list[_Number], Field(min_length=1, max_length=100)]
_Text = Annotated[str, Field(max_length=1000)]


class _Schema(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Machine(_Schema):
    """Processor and programs of a machine."""

    cpu: _Text
    cores: _Count
    python: _Text
    numpy: _Text


class TrainingResult(_Schema):
    """Result of a training, as its file holds it.

    Attributes
    ----------
    fingerprint : str
        Of the training.
    epochs : int
        Done.
    seconds : float
        CPU time of all threads, without the evaluation on further poses.
    stop : str
        Why it ended, in MATLAB's words.
    machine : Machine
        Where it ran.
    ended : str
        Date and time, UTC.
    reached : tuple of (float, int, float)
        Each level that was reached, with the first epoch and time [s].
    angle_range, point_range : (list of float, list of float)
        Lower and upper ends of the angles [rad] and points [mm], which are scaled onto [-1, 1].
    limit_s : float or None
        The time limit that it ran under.
    weights : list of float
    curve : tuple of (int, float, float)
        The learning curve: epoch, time [s] without evaluations, and root mean square error of a coordinate on the
        fitted poses [mm]. Empty in results of earlier versions.
    """

    fingerprint: Annotated[str, Field(max_length=64)]
    epochs: _Count
    seconds: _Seconds
    stop: _Text
    machine: Machine
    ended: _Text
    reached: Annotated[tuple[tuple[_Number, _Count, _Seconds], ...], Field(max_length=100)]
    angle_range: tuple[_Ends, _Ends]
    point_range: tuple[_Ends, _Ends]
    limit_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    weights: Annotated[list[_Number], Field(max_length=1_000_000)]
    curve: Annotated[tuple[tuple[_Count, _Seconds, _Rms], ...], Field(max_length=1000)] = ()
    _training: Training = PrivateAttr()

    @property
    def training(self) -> Training:
        """What it is the result of."""
        return self._training

    @property
    def was_cut(self) -> bool:
        """Whether the time limit ended it before a stop of its own."""
        return self.stop == TIME_OVER

    @property
    def scales(self) -> tuple[MinMaxScaler, MinMaxScaler]:
        """Of the angles [rad] and of the points [mm]."""
        return MinMaxScaler(*map(np.array, self.angle_range)), MinMaxScaler(*map(np.array, self.point_range))

    def predict(self, angles: FloatArray) -> FloatArray:
        """Points (n, 3) [mm] at angles (n, 6) [rad]."""
        of_angles, of_points = self.scales
        outputs = self.training.network.outputs(np.array(self.weights), of_angles.scale(angles.T))
        return np.ascontiguousarray(of_points.unscale(outputs).T)

    def errors(self, n: int, stream: int) -> FloatArray:
        """Absolute errors of coordinates (n, 3) [mm] on further poses of the training's own source and seed."""
        angles, points = self.training.source.data(n, seed=self.training.seed, stream=stream)
        return np.abs(self.predict(angles) - points)

    @classmethod
    def read(cls, file: Path, training: Training) -> TrainingResult:
        """Read the result of a training."""

        def damaged(problem: str) -> InputError:
            return InputError(
                f"not the file of a finished training: {problem}", file=file, hint="delete it and run the command again"
            )

        try:
            kept = cls.model_validate_json(read_limited(file, limit_bytes=LARGEST_FILE))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, first["loc"]))
            raise damaged(f"{place}: {first['msg']}".removeprefix(": ")) from None
        if kept.fingerprint != training.fingerprint:
            raise damaged("its fingerprint is that of another training")
        if kept.epochs > training.epochs:
            raise damaged(f"expected at most {training.epochs} epochs, got {kept.epochs}")
        if any(level not in training.levels_mm or epoch > training.epochs for level, epoch, _ in kept.reached):
            raise damaged(f"expected levels of this training, reached within {training.epochs} epochs")
        if any(epoch > training.epochs for epoch, _, _ in kept.curve):
            raise damaged(f"expected a learning curve of at most {training.epochs} epochs")
        lengths = [len(ends) for ends in (*kept.angle_range, *kept.point_range)]
        if lengths != [6, 6, 3, 3] or len(kept.weights) != training.network.n_weights:
            raise damaged(f"expected {training.network.n_weights} weights and ranges of 6 and 3 numbers")
        if not all((scale.half_range > 0).all() for scale in kept.scales):
            raise damaged("expected ranges with the lower end first")
        kept._training = training
        return kept


def run_training(training: Training, folder: Path, progress: ProgressCallback) -> TrainingResult:
    """Train, or read the result of a training that has finished before: ``NAME.json`` in `folder`.

    A result that a lower time limit cut is replaced. An interrupted training starts again.

    Raises
    ------
    InputError
        If the file is damaged, or of another training; before the training if it cannot be written.
    """
    file = folder / f"{training.name}.json"
    if file.exists():
        found = TrainingResult.read(file, training)
        if not found.was_cut or (found.limit_s or math.inf) >= (training.time_limit_s or math.inf):
            return found
    check_writable(file)
    result = _train(training, progress)
    with atomic_file(file, read=lambda beside: TrainingResult.read(beside, training)) as beside:
        beside.write_text(result.model_dump_json() + "\n", encoding="utf-8", newline="\n")
    return result


def machine_data() -> Machine:
    """Processor and programs of this machine."""
    cpu, info = platform.processor() or platform.machine(), Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8", errors="replace").splitlines()
        cpu = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), cpu)
    return Machine(cpu=cpu, cores=cores(), python=platform.python_version(), numpy=version("numpy"))


def _train(training: Training, progress: ProgressCallback) -> TrainingResult:
    angles, points = training.source.data(training.n_train, seed=training.seed, stream=TRAINING_STREAM)
    angle_scale = MinMaxScaler.of(angles.T, what="the angle of joint")
    point_scale = MinMaxScaler.of(points.T, what="coordinate")
    inputs, targets = angle_scale.scale(angles.T), point_scale.scale(points.T)
    share, network = training.validation_share, training.network
    division = dividerand(len(angles), train=1 - 2 * share, validation=share, test=share, seed=training.seed)
    fit, validation, _ = (
        FitProblem(network, inputs[:, part], targets[:, part]) if len(part) else None for part in division
    )
    assert fit is not None  # dividerand leaves samples to train on

    many_angles, many_points = training.source.data(N_EVALUATION_POSES, seed=training.seed, stream=EVALUATION_STREAM)
    many_inputs = angle_scale.scale(many_angles.T)
    reached: dict[float, tuple[int, float]] = {}
    evaluation_seconds = 0.0
    curve: list[tuple[int, float, float]] = []

    def evaluate(epoch: Epoch) -> None:
        # The evaluation is no part of the training, but the trainer's clock includes all evaluations before this one.
        nonlocal evaluation_seconds
        begun, seconds = process_time(), epoch.seconds - evaluation_seconds
        missing = [level for level in training.levels_mm if level not in reached]
        if missing:
            predicted = point_scale.unscale(network.outputs(epoch.weights(), many_inputs)).T
            error = float(np.abs(predicted - many_points).mean())
            reached.update({level: (epoch.epoch, max(seconds, 0.0)) for level in missing if error <= level})
        limit = training.time_limit_s or math.inf
        rms = math.sqrt(epoch.perf * float(np.mean(point_scale.half_range**2)))
        if rms < _LARGEST_RMS_MM:  # neither infinite nor undefined
            curve.append((epoch.epoch, max(seconds, 0.0), rms))
        progress(max(epoch.epoch / training.epochs, epoch.seconds / limit), f"epoch {epoch.epoch}, {rms:.4f} mm rms")
        evaluation_seconds += process_time() - begun

    weights, record = TRAINERS[training.trainer](
        fit,
        nguyen_widrow(network, seed=training.seed),
        validation=validation,
        epochs=training.epochs,
        goal=training.goal,
        time=training.time_limit_s or math.inf,
        clock=process_time,
        callback=evaluate,
    )
    result = TrainingResult(
        fingerprint=training.fingerprint,
        epochs=len(record.perf) - 1,
        seconds=max(float(record.time[-1]) - evaluation_seconds, 0.0),
        stop=record.stop,
        machine=machine_data(),
        ended=datetime.now(UTC).isoformat(timespec="seconds"),
        reached=tuple((level, *when) for level, when in sorted(reached.items())),
        angle_range=(angle_scale.lower.tolist(), angle_scale.upper.tolist()),
        point_range=(point_scale.lower.tolist(), point_scale.upper.tolist()),
        limit_s=training.time_limit_s,
        weights=weights.tolist(),
        curve=_thinned(curve),
    )
    result._training = training
    return result


def _thinned(curve: list[tuple[int, float, float]]) -> tuple[tuple[int, float, float], ...]:
    """At most `CURVE_POINTS` points of a learning curve, with the first and the last."""
    kept = np.unique(np.geomspace(1, max(len(curve), 1), CURVE_POINTS).round().astype(int)) - 1
    return tuple(curve[i] for i in kept if i < len(curve))
