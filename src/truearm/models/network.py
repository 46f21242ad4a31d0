"""The network model of Gao et al. (2017): from joint angles to coordinates, without kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.identify import Found, Progress
from truearm.identification.judgement.repeating_residuals import UNKNOWN_SHARE, of_one_reading
from truearm.identification.references.prepared_readings import MIN_ROWS, PreparedReadings
from truearm.identification.references.reading_references import check_points_of_one_tip
from truearm.identification.terms import ArmState
from truearm.models.compensator import CheckedReadings, Compensator
from truearm.models.estimator import check_network_options
from truearm.nets.levenberg_marquardt import BayesianRecord, train_varpro, trainbr, trainlm
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import MinMaxScaler, Perceptron, nguyen_widrow
from truearm.nets.traingd import AdaptiveRecord, traingd, traingdx
from truearm.nets.training import Epoch, TrainingRecord, dividerand
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray

Training: TypeAlias = Callable[..., tuple[FloatArray, TrainingRecord]]
GRADIENT_TRAINERS: dict[str, Training] = {"traingd": traingd, "traingdx": traingdx}
TRAINERS: dict[str, Training] = {"varpro": train_varpro, "trainlm": trainlm, "trainbr": trainbr, **GRADIENT_TRAINERS}


@dataclass(frozen=True, eq=False)
class Member:
    """A trained network of an ensemble.

    Attributes
    ----------
    weights : (n_weights,) array
    basis_covariance : (units + 1, units + 1) array
        Inverse Gram matrix of the last hidden layer on the member's training data.
    start : int
        Which of its starts was kept, counted from 0.
    record : TrainingRecord
        Record of the kept training.
    """

    weights: FloatArray
    basis_covariance: FloatArray
    start: int
    record: TrainingRecord | BayesianRecord | AdaptiveRecord


class NetworkModel(Compensator):
    """Multilayer perceptrons from joint angles to coordinates, as Gao et al. (2017) train them.

    They use no kinematics, so they need thousands of readings and are valid only within their joint ranges.

    Parameters
    ----------
    arm : Arm
        Used only for the comparison with the nominal arm.
    hidden : tuple of int
        Units of the hidden layers.
    activation : str
        ``"tansig"``, ``"logsig"`` or ``"purelin"``.
    trainer : str
        ``"varpro"`` (variable projection and Nielsen's damping), or as MATLAB's ``"trainlm"``, ``"trainbr"`` (Bayesian
        regularisation: slower, but no overfitting where readings are few), ``"traingd"`` or ``"traingdx"`` (gradient
        descent: thousands of epochs for a rough fit; here because others report it).
    epochs : int
        Maximum epochs per training run.
    goal : float
        Mean squared error of scaled outputs at which to stop.
    learning_rate : float
        Step of ``"traingd"`` and ``"traingdx"`` for a unit of the gradient; the other trainers have none.
    validation : float
        Share of the readings used for validation; training stops when their error grows, and the best weights are kept.
    max_fail : int
        Epochs in a row without a better validation error that stop it; ``"trainbr"`` does not stop so.
    n_restarts : int
        Trainings of a member, each from start weights of its own. The one with the smallest validation error is kept,
        the smallest training error without validation data.
    n_members : int
        Networks of the ensemble, each with start weights and a division into training and validation data of its own.
        Their mean is the prediction.
    seed : int
        Of start weights and divisions. One network draws the same whatever the number of members and restarts.
    free : tuple of str
        Of the nominal arm to compare with, as in `NominalModel`.

    Attributes
    ----------
    network_ : Perceptron
        The shape of all members.
    members_ : tuple of Member
    record_ : TrainingRecord
        Of the first member.
    angle_scale_, point_scale_ : MinMaxScaler
        Angles of the joints that are read [rad] and points [mm] onto [-1, 1].
    residual_covariance_ : (3, 3) array
        Mean product of a member's residuals [mm^2] on its validation data, without the share that the scatter of the
        members explains; without validation data on the training data, with the freedom that the weights took
        accounted for.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=60).session
    >>> model = ta.NetworkModel(ta.load_arm("ur10"), hidden=(3,), epochs=5).fit(session.angles, session.points)
    >>> model.predict(session.angles).shape
    (60, 3)
    """

    kind: ClassVar[str] = "network"
    outside_note: ClassVar[str] = ": do not rely on their points"

    network_: Perceptron
    members_: tuple[Member, ...]
    angle_scale_: MinMaxScaler
    point_scale_: MinMaxScaler
    residual_covariance_: FloatArray

    def __init__(
        self,
        arm: Arm,
        *,
        hidden: tuple[int, ...] = (30, 30),
        activation: str = "tansig",
        trainer: str = "varpro",
        epochs: int = 200,
        goal: float = 0.0,
        learning_rate: float = 0.01,
        validation: float = 0.15,
        max_fail: int = 10,
        n_restarts: int = 1,
        n_members: int = 1,
        seed: int = 0,
        free: tuple[str, ...] = ("base", "tip"),
    ) -> None:
        self.arm = arm
        self.hidden = hidden
        self.activation = activation
        self.trainer = trainer
        self.epochs = epochs
        self.goal = goal
        self.learning_rate = learning_rate
        self.validation = validation
        self.max_fail = max_fail
        self.n_restarts = n_restarts
        self.n_members = n_members
        self.seed = seed
        self.free = free

    @property
    def record_(self) -> TrainingRecord:
        """The training of the first member, MATLAB's ``tr``."""
        return self.members_[0].record

    def facts(self) -> dict[str, Any]:
        """See `Compensator.facts`: the training of each member, that of the start that was kept, counted from 1."""
        members = [
            {
                "start": member.start + 1,
                "epochs": member.record.num_epochs,
                "best_epoch": member.record.best_epoch,
                "stop": member.record.stop,
                "seconds": float(member.record.time[-1]),
            }
            for member in self.members_
        ]
        return {"network": {"trainer": self.trainer, "members": members}}

    def member_scatter(self, angles: npt.ArrayLike) -> FloatArray:
        """(n, 3, 3) covariance of the members' points about their mean [mm^2]; zero where there is one member.

        Small within the training readings, large where they do not determine the prediction.
        """
        return self._scatter(self._checked_angles(angles).session.angles)

    def _check_references(self, readings: Session, lengths: Lengths | None) -> None:
        if lengths is not None:
            raise InputError(
                "a network learns from points only, and lengths between seats were given",
                hint="fit it without lengths, or fit a kinematic or physical model",
            )
        check_points_of_one_tip(readings)
        assert readings.points is not None  # checked
        _check_motion(self.arm, readings, readings.points)

    def _fit(self, readings: PreparedReadings, placed: Found, simpler: Compensator | None, progress: Progress) -> None:
        del placed, simpler
        self._train(readings, progress)

    def _train(self, readings: PreparedReadings, progress: Progress) -> None:
        if self.session_frames_:
            raise readings.measured.error(
                f"the readings are of {len(self.session_frames_)} sessions, each in its own frame, and a network "
                "learns one frame",
                column="session",
                hint="use the readings of one session (truearm split --by session), or a physical model",
            )
        points = readings.points
        assert points is not None  # checked
        angles = readings.state.angles.compress(self.arm_.chain.is_read, axis=1)
        self.network_ = Perceptron.with_layers(angles.shape[1], self.hidden, 3, activation=self.activation)
        self.angle_scale_ = MinMaxScaler.of(angles.T, what="the angle of joint")
        self.point_scale_ = MinMaxScaler.of(points.T, what="coordinate")
        inputs, targets = self._inputs(readings.state.angles), self.point_scale_.scale(points.T)
        members, judges = [], []
        for number in range(self.n_members):
            train, aside, _ = dividerand(
                len(points), train=1 - self.validation, validation=self.validation, test=0, seed=self._stream(number, 0)
            )
            training = FitProblem(self.network_, inputs[:, train], targets[:, train])
            validation = FitProblem(self.network_, inputs[:, aside], targets[:, aside]) if len(aside) else None
            if validation is None:
                self._check_enough(training, readings)
            start, weights, record = self._trained(number, training, validation, progress)
            with one_blas_thread():
                members.append(Member(weights, self._basis_covariance(weights, training.inputs), start, record))
            judges.append(train if validation is None else aside)
        self.members_ = tuple(members)
        with one_blas_thread():
            found = self._residual_covariance(readings.state.angles, points, judges, apart=len(aside) > 0)
        before = np.trace(found) / 3
        variance, self.repeating_share_ = of_one_reading(before, UNKNOWN_SHARE, readings)
        self.residual_covariance_ = found + (variance - before) * np.eye(3)

    def _trained(
        self, number: int, training: FitProblem, validation: FitProblem | None, progress: Progress
    ) -> tuple[int, FloatArray, TrainingRecord]:
        """The best of a member's starts: its number, the weights and the record."""
        options = {"validation": validation, "epochs": self.epochs, "goal": self.goal}
        if self.trainer != "trainbr":  # stopped by the evidence, never by validation data
            options["max_fail"] = self.max_fail
        if self.trainer in GRADIENT_TRAINERS:
            options["lr"] = self.learning_rate
        least, best = np.inf, None
        for restart in range(self.n_restarts):
            weights = nguyen_widrow(self.network_, seed=self._stream(number, restart))
            weights, record = TRAINERS[self.trainer](
                training,
                weights,
                callback=self._epoch_callback(number * self.n_restarts + restart, progress),
                **options,
            )
            error = float((record.perf if validation is None else record.vperf)[record.best_epoch])
            if best is None or error < least:
                least, best = error, (restart, weights, record)
        assert best is not None  # one start at least
        return best

    def _epoch_callback(self, done: int, progress: Progress) -> Callable[[Epoch], None]:
        """Progress of a training after `done` others: errors in mm instead of scaled squares."""
        scale = float(np.sqrt(np.mean(self.point_scale_.half_range**2)))
        n_trainings = self.n_members * self.n_restarts
        first = f"training {done + 1}/{n_trainings}, " if n_trainings > 1 else ""

        def report(state: Epoch) -> None:
            note = f"{first}epoch {state.epoch}, rms error {scale * np.sqrt(state.perf):.3g} mm"
            if np.isfinite(state.vperf):
                note += f", validation {scale * np.sqrt(state.vperf):.3g} mm"
            if np.isfinite(state.mu):
                note += f", mu {state.mu:.0e}"
            progress(done * self.epochs + state.epoch, note)

        return report

    def _stream(self, member: int, restart: int) -> int:
        """The seed of a start, or of a member's division (restart 0); that of the first is `seed` itself."""
        if member == restart == 0:
            return int(self.seed)
        words = np.random.SeedSequence([int(self.seed), member, restart]).generate_state(2, np.uint64)
        return int(words[0]) << 64 | int(words[1])

    def _check_enough(self, training: FitProblem, readings: PreparedReadings) -> None:
        """Refuse a network that can fit every reading exactly, without validation data."""
        if self.trainer != "trainbr" and training.n_errors <= self.network_.n_weights:
            raise readings.measured.error(
                f"{training.inputs.shape[1]} readings give {training.n_errors} coordinates for "
                f"{self.network_.n_weights} weights: the network would fit them exactly, and its error elsewhere "
                "would be unknown",
                hint="use validation data (validation=0.15), trainbr, more readings, fewer units or a kinematic model",
            )

    def _check_options(self) -> None:
        super()._check_options()
        if self.trainer not in TRAINERS:
            raise InputError(f"expected a trainer among {list(TRAINERS)}, got {self.trainer!r}")
        check_network_options(self, epochs=1, max_fail=1, n_restarts=1, n_members=1, seed=0)
        if not 0 <= self.validation < 1:
            raise InputError(f"expected validation, a share of the readings, from 0 to below 1, got {self.validation}")
        if not 0 <= self.goal < np.inf:
            raise InputError(f"expected goal, a mean squared error of scaled outputs, of 0 or more, got {self.goal}")
        if not 0 < self.learning_rate < np.inf:
            raise InputError(f"expected a learning rate above 0, got {self.learning_rate}")

    def _residual_covariance(
        self, angles: FloatArray, points: FloatArray, judges: list[IntArray], *, apart: bool
    ) -> FloatArray:
        """Residual covariance of a member on its judging readings, in excess of the members' scatter."""
        parts = []
        for member, rows in zip(self.members_, judges, strict=True):
            residuals = self._points(member, self._inputs(angles[rows])) - points[rows]
            squares = residuals.T @ residuals / len(rows)
            if len(rows) < MIN_ROWS:  # too few for three directions
                squares = np.trace(squares) / 3 * np.eye(3)
            parts.append(squares if apart else squares / self._free_share(member, residuals.size))
        covariance = np.mean(parts, axis=0)
        if apart and self.n_members > 1:
            scatter = self._scatter(angles)
            known = np.mean([np.trace(scatter[rows].mean(axis=0)) for rows in judges]) / np.trace(covariance)
            # Were it all scatter, the mean of the members would still err by their share.
            covariance = covariance * max(1 - known, 1 / self.n_members)
        return np.asarray(covariance)

    def _free_share(self, member: Member, n_coordinates: int) -> float:
        """Degrees of freedom that the weights leave, as a share of the training coordinates."""
        in_use = member.record.gamk[-1] if isinstance(member.record, BayesianRecord) else self.network_.n_weights
        return max(1 - in_use / n_coordinates, 1e-3)

    def _basis_covariance(self, weights: FloatArray, inputs: FloatArray) -> FloatArray:
        basis = self._basis(weights, inputs)
        gram = basis.T @ basis
        # A thousandth of a reading in every direction keeps the inverse finite where hidden units have become alike.
        return np.asarray(np.linalg.inv(gram + 1e-3 * np.eye(len(gram))))

    def _inputs(self, angles: FloatArray) -> FloatArray:
        """(n_inputs, n) scaled angles of the joints that are read: not of those that only mimic others."""
        return self.angle_scale_.scale(angles.compress(self.arm_.chain.is_read, axis=1).T)

    def _basis(self, weights: FloatArray, inputs: FloatArray) -> FloatArray:
        """(n, units + 1) last hidden layer and bias at scaled inputs (n_inputs, n)."""
        last_hidden = self.network_.forward(weights, inputs)[-2]
        return np.concatenate([last_hidden, np.ones((1, last_hidden.shape[1]))]).T

    def _points(self, member: Member, inputs: FloatArray) -> FloatArray:
        """(n, 3) a member's points [mm] at scaled inputs (n_inputs, n)."""
        return np.asarray(self.point_scale_.unscale(self.network_.outputs(member.weights, inputs)).T)

    def _tips(self, state: ArmState) -> FloatArray:
        return self._mean(state.angles)

    def _mean(self, angles: FloatArray) -> FloatArray:
        """(n, 3) mean of the members' points [mm]."""
        inputs = self._inputs(angles)
        return np.asarray(np.mean([self._points(member, inputs) for member in self.members_], axis=0))

    def _scatter(self, angles: FloatArray) -> FloatArray:
        out = np.zeros((len(angles), 3, 3))
        if len(self.members_) > 1:
            inputs = self._inputs(angles)
            mean = self._mean(angles)
            for member in self.members_:
                off = self._points(member, inputs) - mean
                out += off[:, :, None] * off[:, None, :]
            out /= len(self.members_) - 1
        return out

    def _covariance_parts(self, at: CheckedReadings) -> tuple[FloatArray, FloatArray]:
        """Uncertainty of the weights, and the residual covariance of members.

        The first is the second, times the leverage of the last hidden layers, and the members' scatter. The leverage is
        that of a Bayesian linear output layer. Hidden units saturate, so that it does not grow without bound far
        outside; the scatter does not include the error that all members share. Such rows are flagged instead.
        """
        angles = at.session.angles
        inputs = self._inputs(angles)
        leverage = np.zeros(len(angles))
        for member in self.members_:
            basis = self._basis(member.weights, inputs)
            leverage += np.einsum("ni,ij,nj->n", basis, member.basis_covariance, basis) / len(self.members_)
        residual = np.broadcast_to(self.residual_covariance_, (len(angles), 3, 3))
        of_parameters = leverage[:, None, None] * residual + self._scatter(angles)
        return of_parameters, self.share_of_mean(at.session)[:, None, None] * residual


def _check_motion(arm: Arm, readings: Session, points: FloatArray) -> None:
    """Refuse an input or output without a range to scale."""
    for joint, values in enumerate(readings.angles.T):
        if values.min() == values.max() and arm.chain.is_read[joint]:
            name, unit = arm.joint_names[joint], "mm" if arm.chain.is_prismatic[joint] else "rad"
            raise readings.error(
                f"joint {name} is at {values[0]:.6g} {unit} in all {len(readings)} readings: a network cannot learn "
                "from a joint that does not move",
                column=None if readings.angle_columns is None else readings.angle_columns[joint],
                hint='measure readings in which it moves, or describe it as type = "fixed" in the arm file',
            )
    for axis, values in zip("xyz", points.T, strict=True):
        if values.min() == values.max():
            raise readings.error(
                f"the coordinate {axis} is {values[0]:.6g} mm in all {len(readings)} readings: a network has nothing "
                "to learn from it",
                hint="measure readings outside this plane, or use the kinematic model",
            )
