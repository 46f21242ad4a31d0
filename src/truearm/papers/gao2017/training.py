"""One training of a network as the founding paper does it: its data, its settings, what came of it, and its file."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from truearm import __version__
from truearm.arm import load_arm
from truearm.compensation.nets.checkpoint import Checkpoint
from truearm.compensation.nets.nguyen_widrow import nguyen_widrow
from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.perceptron import Perceptron
from truearm.compensation.nets.scaling import MinMaxScaler
from truearm.compensation.nets.train_varpro import train_varpro
from truearm.compensation.nets.traingd import traingd
from truearm.compensation.nets.traingdx import traingdx
from truearm.compensation.nets.training import Epoch, TrainingRecord, dividerand
from truearm.compensation.nets.trainlm import trainlm
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.identification.planning.sampling import box
from truearm.identification.virtual import Measurement, VirtualArm, load_preset
from truearm.solve.threads import cores
from truearm.typing import FloatArray

# Told the share of a training that is done, and a few words on how it stands.
ProgressCallback = Callable[[float, str], None]

ARM = "gao2017"
N_EVALUATION_POSES = 2000
"""Further poses that an error is judged by, beside the few that the paper tested on."""
TRAINING_STREAM, TEST_STREAM, EVALUATION_STREAM, OUTSIDE_STREAM, FINAL_TEST_STREAM = 0, 1, 3, 4, 5
"""Streams of poses and noise of one seed; `truearm.workflows.demo` has 0 to 2."""
RECIPE = 1
"""Raised whenever the course of a training changes, so that no result of an older course is taken for one of it."""
LARGEST_FILE = 20_000_000  # bytes: a network of the paper takes less than one


@dataclass(frozen=True)
class Source:
    """Where poses and points come from: a box of joint angles, and an arm.

    Attributes
    ----------
    half_width_deg : float
        Of the box about the working pose, in every joint.
    virtual : bool
        Whether a virtual arm of the preset ``research`` is measured, another for every seed. Else the points are those
        of the paper's Table 1, exactly.
    """

    half_width_deg: float
    virtual: bool

    def data(self, n: int, *, seed: int, stream: int) -> tuple[FloatArray, FloatArray]:
        """Angles (n, 6) [rad] and points (n, 3) [mm]."""
        if self.virtual:
            readings = self.measurement(n, seed=seed, stream=stream).readings
            assert readings.points is not None  # a virtual reference sees every pose
            return readings.angles, readings.points
        angles = self._angles(n, _own(seed, stream))
        return angles, load_arm(ARM).chain.tip_in_base(angles)

    def measurement(self, n: int, *, seed: int, stream: int) -> Measurement:
        """The virtual arm's readings in the box."""
        own = _own(seed, stream)
        return virtual_arm(seed).measure(self._angles(n, own), seed=own)

    def _angles(self, n: int, seed: int) -> FloatArray:
        return box(load_arm(ARM), n, seed=seed, half_width=np.radians(self.half_width_deg)).angles


def _own(seed: int, stream: int) -> int:
    # Streams of one seed are neighbours, those of the next begin after them, as in `truearm.workflows.demo`.
    return 10 * seed + stream


@lru_cache(maxsize=16)
def virtual_arm(seed: int) -> VirtualArm:
    """The arm that stands in for the paper's: its nominal model errs as much."""
    return VirtualArm.draw(load_arm(ARM), load_preset("research"), seed=seed)


@dataclass(frozen=True)
class Training:
    """All that the result of a training depends on, but the time limit and the machine's speed.

    Attributes
    ----------
    source : Source
    n_train : int
        Poses, those set aside included.
    hidden : tuple of int
        Units of the hidden layers.
    activations : tuple of str
        Of the hidden layers.
    trainer : str
        ``"varpro"``, or MATLAB's ``"trainlm"``, ``"traingd"``, ``"traingdx"``.
    epochs : int
        At most so many.
    goal : float
        Mean squared error of the scaled outputs to stop at.
    set_aside : float
        Share of the poses that validation stops by; as many again are set aside as test data, as MATLAB does.
    time_limit_s : float or None
        MATLAB's ``time``.
    seed : int
        Of the poses, the division and the start weights.
    levels_mm : tuple of float
        Mean absolute coordinate errors on `N_EVALUATION_POSES` further poses that the first epoch is wanted of.
    expected_epochs : int or None
        After so many it is expected to stop, to plan by; None: after `epochs`.
    """

    source: Source
    n_train: int
    hidden: tuple[int, ...]
    activations: tuple[str, ...]
    trainer: str
    epochs: int
    goal: float
    set_aside: float
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
        """SHA-256 of the program's version, the recipe and all settings but what is expected."""
        settings = asdict(self) | {"expected_epochs": None}
        return hashlib.sha256(json.dumps([__version__, RECIPE, settings]).encode()).hexdigest()

    @property
    def name(self) -> str:
        """A name for files: what a person looks for, and enough of the fingerprint to tell all trainings apart."""
        layers = "-".join(map(str, self.hidden))
        kind = "experiment" if self.source.virtual else "simulation"
        return f"{kind}-{self.n_train}-{layers}-{self.trainer}-{self.seed}-{self.fingerprint[:12]}"

    @property
    def estimated_seconds(self) -> float:
        """Time on two cores of a present machine [s], to plan by: 6e10 products a second, and what goes with a pose."""
        fitted, weights = self.n_train * (1 - 2 * self.set_aside), self.network.n_weights
        if self.trainer in GRADIENT_TRAINERS:
            epoch = 1e-3 + 6 * fitted * weights / 1e10
        else:
            epoch = 1e-3 + 1.5e-6 * fitted + fitted * weights**2 / 6e10 + weights**3 / 1e11
        epochs = min(self.epochs, self.expected_epochs or self.epochs)
        return min(epochs * epoch, self.time_limit_s or math.inf)


# Their default learning rate, 0.01, is that of the paper's rows.
GRADIENT_TRAINERS = {"traingd": traingd, "traingdx": traingdx}


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """What came of a training.

    Attributes
    ----------
    training : Training
    epochs : int
        Done, whichever of them had the weights that were kept.
    seconds : float
        Without those of the tests on further poses that went along.
    stop : str
        Why it ended, in MATLAB's words.
    machine : dict
        What it ran on: cpu, cores, python, numpy.
    ended : str
        Date and time, UTC.
    reached : dict of float to (int, float)
        The epoch and the time [s] at which each of the training's levels was reached; no entry where it was not.
    weights : (n_weights,) array
    angle_scale, point_scale : MinMaxScaler
        Angles [rad] and points [mm] onto [-1, 1].
    """

    training: Training
    epochs: int
    seconds: float
    stop: str
    machine: dict[str, Any]
    ended: str
    reached: dict[float, tuple[int, float]]
    weights: FloatArray
    angle_scale: MinMaxScaler
    point_scale: MinMaxScaler

    def predict(self, angles: FloatArray) -> FloatArray:
        """Points (n, 3) [mm] at angles (n, 6) [rad]."""
        outputs = self.training.network.outputs(self.weights, self.angle_scale.scale(angles.T))
        return np.ascontiguousarray(self.point_scale.unscale(outputs).T)

    def errors(self, n: int, stream: int) -> FloatArray:
        """Absolute errors of coordinates (n, 3) [mm] on further poses of the training's own source and seed."""
        angles, points = self.training.source.data(n, seed=self.training.seed, stream=stream)
        return np.abs(self.predict(angles) - points)


def run_training(training: Training, folder: Path, tell: ProgressCallback) -> TrainingResult:
    """Train, go on with a training that was stopped, or read what a finished one left.

    A finished training leaves ``NAME.json`` in `folder`; one that was stopped leaves ``NAME.checkpoint`` and, of the
    tests on further poses, ``NAME.reached.json``.

    Raises
    ------
    InputError
        If a file in `folder` is damaged, or of another training.
    """
    finished, watch_file = folder / f"{training.name}.json", folder / f"{training.name}.reached.json"
    if finished.exists():
        return _Finished.read(finished, training)
    checkpoint = Checkpoint(folder / f"{training.name}.checkpoint", training.fingerprint)
    watched = _Watched()
    if watch_file.exists() and checkpoint.file.exists():
        kept = _read(_Kept, watch_file, training)
        watched = _Watched(kept.levels(), kept.watched)

    def keep() -> None:
        _write(
            _Kept(fingerprint=training.fingerprint, reached=_listed(watched.reached), watched=watched.seconds),
            watch_file,
        )

    done = _train(training, checkpoint, watched, keep, tell)
    _write(_Finished.of(done), finished)
    for left in (checkpoint.file, watch_file):
        left.unlink(missing_ok=True)
    return done


def machine_data() -> dict[str, Any]:
    """What the times are taken on."""
    cpu, info = platform.processor() or platform.machine(), Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8", errors="replace").splitlines()
        cpu = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), cpu)
    return {"cpu": cpu, "cores": cores(), "python": platform.python_version(), "numpy": version("numpy")}


@dataclass
class _Watched:
    """Levels reached so far, and the time that the tests on further poses took [s]."""

    reached: dict[float, tuple[int, float]] = field(default_factory=dict)
    seconds: float = 0.0


def _train(
    training: Training, checkpoint: Checkpoint, watched: _Watched, keep: Callable[[], None], tell: ProgressCallback
) -> TrainingResult:
    angles, points = training.source.data(training.n_train, seed=training.seed, stream=TRAINING_STREAM)
    angle_scale = MinMaxScaler.of(angles.T, what="the angle of joint")
    point_scale = MinMaxScaler.of(points.T, what="coordinate")
    inputs, targets = angle_scale.scale(angles.T), point_scale.scale(points.T)
    share, network = training.set_aside, training.network
    division = dividerand(len(angles), train=1 - 2 * share, validation=share, test=share, seed=training.seed)
    fit, validation, _ = (
        FitProblem(network, inputs[:, part], targets[:, part]) if len(part) else None for part in division
    )
    assert fit is not None  # dividerand leaves samples to train on

    many_angles, many_points = training.source.data(N_EVALUATION_POSES, seed=training.seed, stream=EVALUATION_STREAM)
    many_inputs = angle_scale.scale(many_angles.T)

    def watch(epoch: Epoch) -> None:
        # A test is no part of the training: the trainer's clock has run through all before this one.
        begun, seconds = perf_counter(), epoch.seconds - watched.seconds
        sought = [level for level in training.levels_mm if level not in watched.reached]
        if sought:
            found = point_scale.unscale(network.outputs(epoch.weights(), many_inputs)).T
            error = float(np.abs(found - many_points).mean())
            new = {level: (epoch.epoch, max(seconds, 0.0)) for level in sought if error <= level}
            if new:
                watched.reached.update(new)
                keep()
        limit = training.time_limit_s or math.inf
        rms = math.sqrt(epoch.perf * float(np.mean(point_scale.half_range**2)))
        tell(max(epoch.epoch / training.epochs, epoch.seconds / limit), f"epoch {epoch.epoch}, {rms:.4f} mm rms")
        watched.seconds += perf_counter() - begun

    try:
        weights, record = _run(training, fit, validation, watch, checkpoint)
    except (KeyboardInterrupt, SystemExit):
        keep()
        raise
    return TrainingResult(
        training,
        epochs=len(record.perf) - 1,
        seconds=max(float(record.time[-1]) - watched.seconds, 0.0),
        stop=record.stop,
        machine=machine_data(),
        ended=datetime.now(UTC).isoformat(timespec="seconds"),
        reached=watched.reached,
        weights=weights,
        angle_scale=angle_scale,
        point_scale=point_scale,
    )


def _run(
    training: Training,
    fit: FitProblem,
    validation: FitProblem | None,
    watch: Callable[[Epoch], None],
    checkpoint: Checkpoint,
) -> tuple[FloatArray, TrainingRecord]:
    trainers = {"varpro": train_varpro, "trainlm": trainlm, **GRADIENT_TRAINERS}
    return trainers[training.trainer](
        fit,
        nguyen_widrow(training.network, seed=training.seed),
        validation=validation,
        epochs=training.epochs,
        goal=training.goal,
        time=training.time_limit_s or math.inf,
        callback=watch,
        checkpoint=checkpoint,
    )


# Files ---------------------------------------------------------------------------------------------------------------

_Number = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
_Count = Annotated[int, Field(ge=0, le=10**9)]
_Seconds = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
_Ends = Annotated[list[_Number], Field(min_length=1, max_length=100)]
_Text = Annotated[str, Field(max_length=1000)]


class _Machine(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    cpu: _Text
    cores: _Count
    python: _Text
    numpy: _Text


class _Kept(BaseModel):
    """What the tests on further poses found; of a training that was stopped, all that is kept beside its checkpoint."""

    model_config = ConfigDict(extra="forbid", strict=True)

    fingerprint: Annotated[str, Field(max_length=64)]
    reached: Annotated[list[tuple[_Number, _Count, _Seconds]], Field(max_length=100)]
    watched: _Seconds

    def levels(self) -> dict[float, tuple[int, float]]:
        return {level: (epoch, seconds) for level, epoch, seconds in self.reached}


class _Finished(_Kept):
    """A finished training."""

    epochs: _Count
    seconds: _Seconds
    stop: _Text
    machine: _Machine
    ended: _Text
    angle_range: tuple[_Ends, _Ends]
    point_range: tuple[_Ends, _Ends]
    weights: Annotated[list[_Number], Field(max_length=1_000_000)]

    @classmethod
    def of(cls, done: TrainingResult) -> _Finished:
        return cls(
            fingerprint=done.training.fingerprint,
            reached=_listed(done.reached),
            watched=0.0,
            epochs=done.epochs,
            seconds=done.seconds,
            stop=done.stop,
            machine=_Machine(**done.machine),
            ended=done.ended,
            angle_range=_range_of(done.angle_scale),
            point_range=_range_of(done.point_scale),
            weights=done.weights.tolist(),
        )

    @classmethod
    def read(cls, file: Path, training: Training) -> TrainingResult:
        kept = _read(cls, file, training)
        angle_scale, point_scale = (MinMaxScaler(*map(np.array, ends)) for ends in (kept.angle_range, kept.point_range))
        lengths = [len(ends) for ends in (*kept.angle_range, *kept.point_range)]
        if lengths != [6, 6, 3, 3] or len(kept.weights) != training.network.n_weights:
            raise _damaged(file, f"expected {training.network.n_weights} weights and ranges of 6 and 3 numbers")
        if not ((angle_scale.half_range > 0).all() and (point_scale.half_range > 0).all()):
            raise _damaged(file, "expected ranges with the lower end first")
        if kept.epochs > training.epochs:
            raise _damaged(file, f"expected at most {training.epochs} epochs, got {kept.epochs}")
        return TrainingResult(
            training,
            epochs=kept.epochs,
            seconds=kept.seconds,
            stop=kept.stop,
            machine=kept.machine.model_dump(),
            ended=kept.ended,
            reached=kept.levels(),
            weights=np.array(kept.weights),
            angle_scale=angle_scale,
            point_scale=point_scale,
        )


K = TypeVar("K", bound=_Kept)


def _read(kind: type[K], file: Path, training: Training) -> K:
    if not file.is_file():
        raise _damaged(file, "expected a file")
    with file.open("rb") as stream:
        data = stream.read(LARGEST_FILE + 1)
    if len(data) > LARGEST_FILE:
        raise _damaged(file, f"expected at most {LARGEST_FILE} bytes")
    try:
        kept = kind.model_validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise _damaged(file, f"{'.'.join(map(str, first['loc']))}: {first['msg']}".removeprefix(": ")) from None
    if kept.fingerprint != training.fingerprint:
        raise _damaged(file, "its fingerprint is that of another training")
    if any(level not in training.levels_mm or epoch > training.epochs for level, epoch, _ in kept.reached):
        raise _damaged(file, f"expected levels of this training, reached within {training.epochs} epochs")
    return kept


def _write(kept: _Kept, file: Path) -> None:
    with atomic_file(file) as beside:
        beside.write_text(kept.model_dump_json() + "\n", encoding="utf-8", newline="\n")


def _damaged(file: Path, problem: str) -> InputError:
    return InputError(f"not what a training leaves: {problem}", file=file, hint="delete it; the training is run again")


def _listed(reached: dict[float, tuple[int, float]]) -> list[tuple[float, int, float]]:
    return [(level, epoch, seconds) for level, (epoch, seconds) in sorted(reached.items())]


def _range_of(scale: MinMaxScaler) -> tuple[list[float], list[float]]:
    return scale.lower.tolist(), scale.upper.tolist()
