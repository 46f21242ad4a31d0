"""The network model of the founding paper: straight from joint angles to coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.models.compensator import Compensator
from truearm.nets.lm import train_lm
from truearm.nets.nguyen_widrow import nguyen_widrow
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron
from truearm.nets.scaling import MinMax
from truearm.nets.trainbr import BayesianRecord, trainbr
from truearm.nets.training import Epoch, TrainingRecord, dividerand
from truearm.nets.trainlm import trainlm
from truearm.readings.readings import Readings

FloatArray = npt.NDArray[np.float64]
TRAINERS = ("lm", "trainlm", "trainbr")


class NetworkModel(Compensator):
    """A multilayer perceptron from joint angles to coordinates, as Gao et al. (2017) train it.

    It knows nothing of kinematics: it needs thousands of readings and holds only within their joint ranges.

    Parameters
    ----------
    arm : Arm
        Serves the comparison with the nominal arm only.
    hidden : tuple of int
        Units of the hidden layers.
    activation : str
        ``"tansig"``, ``"logsig"`` or ``"purelin"``.
    trainer : str
        ``"lm"`` (variable projection and Nielsen's damping), or as MATLAB's ``"trainlm"`` or ``"trainbr"`` (Bayesian
        regularisation: slower, but no overfitting where readings are few).
    epochs : int
        At most so many.
    goal : float
        Mean squared error of scaled outputs at which to stop.
    validation : float
        Share of the readings set aside; training stops when the error on them grows, and the best weights are kept.
    max_fail : int
        Epochs in a row without a better validation error that stop it; ``"trainbr"`` does not stop so.
    seed : int
        Of the start weights and the division.
    free : tuple of str
        Of the nominal arm to compare with, as in `NominalModel`.

    Attributes
    ----------
    network_ : Perceptron
    weights_ : (n_weights,) array
    angle_scale_, point_scale_ : MinMax
        Angles [rad] and points [mm] onto [-1, 1].
    record_ : TrainingRecord
    residual_covariance_ : (3, 3) array
        Mean product of residuals [mm^2]: on validation data where there are any, else on the training data, with the
        freedom that the weights took accounted for.
    basis_covariance_ : (units + 1, units + 1) array
        Inverse Gram matrix of the last hidden layer on the training data.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        hidden: tuple[int, ...] = (30, 30),
        activation: str = "tansig",
        trainer: str = "lm",
        epochs: int = 200,
        goal: float = 0.0,
        validation: float = 0.15,
        max_fail: int = 10,
        seed: int = 0,
        free: tuple[str, ...] = ("base", "tip"),
    ) -> None:
        self.arm = arm
        self.hidden = hidden
        self.activation = activation
        self.trainer = trainer
        self.epochs = epochs
        self.goal = goal
        self.validation = validation
        self.max_fail = max_fail
        self.seed = seed
        self.free = free

    def _identify(self, readings: Readings, points: FloatArray, progress: Callable[[int, str], None]) -> None:
        self.network_ = Perceptron.with_layers(readings.n_joints, self.hidden, 3, activation=self.activation)
        self.angle_scale_ = MinMax.of(readings.angles.T, what="the angle of joint")
        self.point_scale_ = MinMax.of(points.T, what="coordinate")
        inputs, targets = self.angle_scale_.scaled(readings.angles.T), self.point_scale_.scaled(points.T)
        train, validation, _ = dividerand(
            len(points), train=1 - self.validation, validation=self.validation, test=0, seed=self.seed
        )
        training = FitProblem(self.network_, inputs[:, train], targets[:, train])
        if self.trainer != "trainbr" and not len(validation) and training.n_errors <= self.network_.n_weights:
            raise InputError(
                f"{len(points)} readings give {training.n_errors} coordinates for {self.network_.n_weights} weights: "
                "the network would repeat them, and nothing would tell how wrong it is elsewhere",
                hint="set readings aside (validation=0.15), trainbr, more readings, or fewer hidden units",
            )
        aside = FitProblem(self.network_, inputs[:, validation], targets[:, validation]) if len(validation) else None
        scale = float(np.sqrt(np.mean(self.point_scale_.half_range**2)))

        def tell(state: Epoch) -> None:
            rms = scale * np.sqrt(state.perf)
            progress(state.epoch, f"epoch {state.epoch}, rms error {rms:.4g} mm")

        self._train(training, aside, tell)
        self._measure_uncertainty(readings.angles, points, train, validation if len(validation) else train)

    def _train(self, training: FitProblem, aside: FitProblem | None, tell: Callable[[Epoch], None]) -> None:
        self.record_: TrainingRecord
        start = nguyen_widrow(self.network_, seed=self.seed)
        epochs, goal, max_fail = self.epochs, self.goal, self.max_fail
        if self.trainer == "trainbr":
            self.weights_, self.record_ = trainbr(
                training, start, validation=aside, epochs=epochs, goal=goal, callback=tell
            )
            return
        train = train_lm if self.trainer == "lm" else trainlm
        self.weights_, self.record_ = train(
            training, start, validation=aside, epochs=epochs, goal=goal, max_fail=max_fail, callback=tell
        )

    def _check_options(self) -> None:
        super()._check_options()
        if self.trainer not in TRAINERS:
            raise InputError(f"expected a trainer among {list(TRAINERS)}, got {self.trainer!r}")
        if not isinstance(self.hidden, tuple | list) or not all(isinstance(n, int | np.integer) for n in self.hidden):
            raise InputError(f"expected hidden layers as whole numbers, such as (30, 30), got {self.hidden!r}")
        if self.epochs < 1 or self.max_fail < 1 or not 0 <= self.validation < 1 or not self.goal >= 0:
            raise InputError(
                "expected epochs and max_fail of 1 or more, validation from 0 to below 1 and goal of 0 or more, got "
                f"{self.epochs}, {self.max_fail}, {self.validation}, {self.goal}"
            )

    def _measure_uncertainty(
        self, angles: FloatArray, points: FloatArray, train: npt.NDArray[np.intp], judge: npt.NDArray[np.intp]
    ) -> None:
        residuals = self._tips(angles[judge]) - points[judge]
        # Judged by its own training data a network looks too good: each weight in use took a coordinate's freedom.
        in_use = self.record_.gamk[-1] if isinstance(self.record_, BayesianRecord) else self.network_.n_weights
        free_share = max(1 - in_use / residuals.size, 1e-3) if judge is train else 1.0
        self.residual_covariance_ = residuals.T @ residuals / (len(residuals) * free_share)
        basis = self._basis(angles[train])
        gram = basis.T @ basis
        # A thousandth of a reading in every direction keeps the inverse finite where hidden units have become alike.
        self.basis_covariance_ = np.linalg.inv(gram + 1e-3 * np.eye(len(gram)))

    def _tips(self, angles: FloatArray) -> FloatArray:
        inputs = self.angle_scale_.scaled(angles.T)
        return np.asarray(self.point_scale_.restored(self.network_.outputs(self.weights_, inputs)).T)

    def _basis(self, angles: FloatArray) -> FloatArray:
        last_hidden = self.network_.forward(self.weights_, self.angle_scale_.scaled(angles.T))[-2]
        return np.concatenate([last_hidden, np.ones((1, last_hidden.shape[1]))]).T

    def _covariance(self, angles: FloatArray) -> FloatArray:
        """Residual covariance, grown by the leverage of the last hidden layer (a Bayesian linear output layer).

        Hidden units saturate, so that it does not grow without bound far outside: such rows are flagged instead.
        """
        basis = self._basis(angles)
        leverage = np.einsum("ni,ij,nj->n", basis, self.basis_covariance_, basis)
        return np.asarray((1 + leverage)[:, None, None] * self.residual_covariance_)
