"""The hybrid model: an identified arm, and a committee of small networks for what its constants leave over."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.findings import Finding
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import HeldOutReadings, VarianceFunction
from truearm.identification.identify import Found, Progress, unexplained_at
from truearm.identification.judgement.held_out_errors import HeldOutErrors
from truearm.identification.references.prepared_readings import MIN_ROWS, PreparedReadings
from truearm.identification.references.reading_references import check_points_of_one_tip
from truearm.identification.terms import ArmState
from truearm.models.compensator import CheckedReadings, Compensator
from truearm.models.estimator import check_network_options
from truearm.models.identified_model import IdentifiedModel, KinematicModel, NominalModel
from truearm.models.training_conditions import LEAST_TURN, TrainingConditions, TrainingReadings
from truearm.nets.committee import Committee, train_committee, train_member
from truearm.nets.perceptron import MinMaxScaler, Perceptron
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray

# An input with a smaller range does not vary [rad of an angle, its cosine or sine; mm].
LEAST_RANGE = 1e-6
# A temperature with a smaller share of its variance between consecutive readings follows their order: a network would
# learn when a reading was measured. Virtual warming arms have 0.0003 to 0.002 in 100 to 200 readings; in a random order
# it is 1, to two over the root of the number.
LEAST_SHARE_BETWEEN = 0.5
ARM_MODELS: dict[str, type[IdentifiedModel]] = {"nominal": NominalModel, "kinematic": KinematicModel}
# Findings of the arm that its networks do not change.
OF_THE_CONSTANTS = ("joint gains", "joint sign", "length scale")
# Residuals of this many root mean squares are 1 as targets of the networks.
TARGET_STDS = 3.0
# Least root mean square of residuals [mm]: an arm that reproduces all points leaves nothing to scale by.
LEAST_RMS_MM = 1e-9


@dataclass(frozen=True, eq=False)
class ResidualInputs:
    """Cosine and sine of every angle, displacements, and the temperature, scaled to [-1, 1] over the training.

    The errors of a revolute joint repeat after a full turn; cosine and sine do too, angles do not. A joint that hardly
    moved in training is no input. Nor is a temperature that changed by less than thermometers differ, or one that
    follows the order of the readings (`follows_order`): it is a clock.

    Attributes
    ----------
    is_prismatic : (n_joints,) bool array
    kept : (k,) int array
        Which numbers of `_candidates` are inputs.
    scale : MinMaxScaler
        Of these.
    """

    is_prismatic: BoolArray
    kept: IntArray
    scale: MinMaxScaler

    @classmethod
    def of(cls, angles: FloatArray, temperature_degC: FloatArray | None, is_prismatic: BoolArray) -> Self:
        """Inputs of training readings.

        Parameters
        ----------
        angles : (n, n_joints) array
            [rad, or mm].
        temperature_degC : (n,) array or None
        is_prismatic : (n_joints,) bool array

        Raises
        ------
        InputError
            If no joint moved.
        """
        if not moves(angles, is_prismatic):
            raise InputError(
                "no joint moves by more than 1 degree in these readings: a network has nothing to learn from",
                hint="measure different poses",
            )
        of_joints = _of_joints(angles, is_prismatic)
        varies = (
            temperature_degC is not None
            and bool(np.ptp(temperature_degC) > TrainingConditions.temperature_tolerance_K)
            and not follows_order(temperature_degC)
        )
        candidates = _candidates(angles, temperature_degC, is_prismatic)
        kept = np.flatnonzero(np.append(of_joints, varies))
        return cls(is_prismatic, kept.astype(np.intp), MinMaxScaler.of(candidates[kept], what="input"))

    @property
    def n_inputs(self) -> int:
        """Number of inputs of the network."""
        return len(self.kept)

    @property
    def has_temperature(self) -> bool:
        """Whether the temperature is an input."""
        n_angles, n_slides = int((~self.is_prismatic).sum()), int(self.is_prismatic.sum())
        return bool((self.kept == 2 * n_angles + n_slides).any())

    def scaled(self, angles: FloatArray, temperature_degC: FloatArray | None) -> FloatArray:
        """(n_inputs, n) inputs of readings with angles (n, n_joints) [rad, or mm] and temperatures (n,)."""
        return self.scale.scale(_candidates(angles, temperature_degC, self.is_prismatic)[self.kept])


def follows_order(temperature_degC: FloatArray) -> bool:
    """Whether temperatures (n,) in the order of the readings are a smooth function of it.

    By the mean square of their successive differences over twice their variance: J. von Neumann, "Distribution of the
    ratio of the mean square successive difference to the variance", Ann. Math. Stat. 12 (1941) 367.
    """
    between = float((np.diff(temperature_degC) ** 2).mean())
    return between < 2 * LEAST_SHARE_BETWEEN * float(np.var(temperature_degC))


def clock(temperature_degC: FloatArray) -> tuple[Finding, ...]:
    """That temperatures are no input of networks, as they follow the order of the readings; else nothing."""
    said = "The temperature follows the order of the readings: networks would learn it as a clock. It is no input of "
    return (Finding("temperature order", f"{said}theirs."),) if follows_order(temperature_degC) else ()


def moves(angles: FloatArray, is_prismatic: BoolArray) -> bool:
    """Whether a joint moves enough in readings with angles (n, n_joints) [rad, or mm] to be an input."""
    return bool(_of_joints(angles, is_prismatic).any())


def _of_joints(angles: FloatArray, is_prismatic: BoolArray) -> BoolArray:
    """Which of the `_candidates` of the joints vary."""
    moved = np.ptp(angles, axis=0) > np.where(is_prismatic, LEAST_RANGE, LEAST_TURN)
    of_moved = np.concatenate([moved[~is_prismatic], moved[~is_prismatic], moved[is_prismatic]])
    return np.asarray(of_moved & (np.ptp(_candidates(angles, None, is_prismatic)[:-1], axis=1) > LEAST_RANGE))


def _candidates(angles: FloatArray, temperature_degC: FloatArray | None, is_prismatic: BoolArray) -> FloatArray:
    """All numbers that may be inputs, in rows: cosines, sines, displacements, temperature."""
    turns = angles[:, ~is_prismatic].T
    temperature = np.zeros(len(angles)) if temperature_degC is None else temperature_degC
    return np.vstack([np.cos(turns), np.sin(turns), angles[:, is_prismatic].T, temperature])


class HybridModel(Compensator):
    """An identified arm, and small networks for the residuals that its constants leave.

    The arm explains most of the error and is valid wherever the arm goes; the networks have little left to learn, so
    that a few hundred readings are enough. Outside the trained range the networks' part is no more than a guess of the
    size of the residuals there; such readings are flagged (`outside_training`).

    The networks are a committee: each is trained by Bayesian regularisation (`trainbr`) without one fold of the
    positions, and their mean corrects the arm. What each makes of its own fold gives held-out errors, and these the
    residual variance. Inputs are cosine and sine of the angles, and the temperature if the readings state it, unless it
    follows their order.

    Parameters
    ----------
    arm : Arm
    arm_model : {"kinematic", "nominal"}
        The identified arm whose residuals the networks learn.
    hidden : tuple of int
        Units of the hidden layers.
    epochs : int
        Maximum epochs of a network's training.
    n_members : int
        Number of networks and folds.
    seed : int
        Of the folds and the start weights.
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown, as in `KinematicModel`.

    Attributes
    ----------
    fit_ : IdentificationResult
        The identified arm, without the networks; its covariance is for the noise that they leave.
    inputs_ : ResidualInputs
    committee_ : Committee
    target_scale_mm_ : float
        Millimetres per unit of the networks' outputs.
    residual_std_ : float
        Standard deviation of a coordinate that the model does not explain [mm]: root mean square over the joint space.
    variance_function_ : VarianceFunction
        Share of its square at other angles.
    tail_freedom_ : float
        Degrees of freedom of the tails of the held-out deviations (`truearm.identification.judgement.gross_errors`).
    held_out_ : HeldOutReadings
        Training readings as predicted without their position: by the arm identified without it and by the network
        trained without it. Empty after reading a file.
    held_out_gross_ : HeldOutReadings
        The gross errors of the arm, corrected by a network that was trained without their position.
    held_out_errors_ : HeldOutErrors or None
        Their errors in short.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=60).session
    >>> model = ta.HybridModel(ta.load_arm("ur10"), hidden=(3,), epochs=5).fit_readings(session)
    >>> points, covariances = model.predict(session.angles, return_cov=True)
    >>> points.shape, covariances.shape
    ((60, 3), (60, 3, 3))
    """

    kind: ClassVar[str] = "hybrid"
    outside_note: ClassVar[str] = ": what its networks add there is a guess"

    fit_: IdentificationResult
    inputs_: ResidualInputs
    committee_: Committee
    target_scale_mm_: float
    residual_std_: float
    variance_function_: VarianceFunction
    tail_freedom_: float
    held_out_errors_: HeldOutErrors | None

    def __init__(
        self,
        arm: Arm,
        *,
        arm_model: str = "kinematic",
        hidden: tuple[int, ...] = (15,),
        epochs: int = 30,
        n_members: int = 5,
        seed: int = 0,
        free: tuple[str, ...] = ("base", "tip"),
    ) -> None:
        self.arm = arm
        self.arm_model = arm_model
        self.hidden = hidden
        self.epochs = epochs
        self.n_members = n_members
        self.seed = seed
        self.free = free

    def learn(
        self, readings: TrainingReadings, *, progress: Progress | None = None, nominal: Compensator | None = None
    ) -> Self:
        """See `Compensator.learn`; `nominal` may be the identified arm itself, fitted to the same readings."""
        begun = time.perf_counter()
        if nominal is None or nominal.kind != self.arm_model:
            nominal = ARM_MODELS[self.arm_model](self.arm, free=self.free).learn(readings, nominal=nominal)
        super().learn(readings, progress=progress, nominal=nominal)
        self.fit_seconds_ = time.perf_counter() - begun
        return self

    @property
    def identifies_constants(self) -> bool:
        """See `Compensator.identifies_constants`."""
        return super().identifies_constants and self.arm_model != "nominal"

    def facts(self) -> dict[str, Any]:
        """See `Compensator.facts`."""
        committee = self.committee_
        networks = {
            "arm_model": self.arm_model,
            "sizes": list(committee.network.sizes),
            "effective_weights": float(committee.effective.mean()),
            "epochs": committee.epochs.tolist(),
        }
        return {"network": networks, "residual_std_mm": self.residual_std_}

    @property
    def n_effective_(self) -> float:
        """Parameters that the readings determine: constants of the arm, and weights of one network."""
        return sum(group.effective for group in self.fit_.groups) + float(self.committee_.effective.mean())

    def member_scatter(self, readings: Session) -> FloatArray:
        """(n, 3, 3) covariance of the members' points about their mean [mm^2]."""
        return _scatter(self._corrections(self.checked(readings).state))

    def held_out_by_one_member(
        self, readings: PreparedReadings, arm_model: IdentifiedModel, *, latest: bool = False
    ) -> HeldOutReadings:
        """One fold of the readings, as predicted by a network that is trained without it.

        The first of `n_members` steps of a fit: it shows whether the others are worth their time.

        Parameters
        ----------
        readings : PreparedReadings
            Of one frame.
        arm_model : IdentifiedModel
            Fitted to these readings; an arm as `arm_model` names it.
        latest : bool
            Hold out the readings that were measured last, as many as in a fold, in place of the first fold: readings of
            their positions may have been learned, as time is what is held out.
        """
        self.arm_ = self._checked_arm()
        self.fit_ = arm_model.fit_
        learned = self._prepare_residuals(readings, arm_model)
        aside = learned.fold == 0
        if latest:
            aside = np.arange(len(aside)) >= len(aside) - int(aside.sum())
        weights, _ = train_member(
            learned.network, learned.inputs, learned.targets, ~aside, epochs=self.epochs, seed=[int(self.seed), 0]
        )
        corrections = learned.scale_mm * learned.network.outputs(weights, learned.inputs[:, aside]).T
        held_out = learned.held_out.select(aside)
        return replace(held_out, deviations=held_out.deviations + corrections)

    def _check_references(self, readings: Session, lengths: Lengths | None) -> None:
        del lengths
        check_points_of_one_tip(readings)

    def _fit(self, readings: PreparedReadings, placed: Found, simpler: Compensator | None, progress: Progress) -> None:
        del placed
        assert isinstance(simpler, IdentifiedModel)  # see `learn`
        self.fit_ = simpler.fit_
        self.findings_ = tuple(one for one in simpler.findings_ if one.what in OF_THE_CONSTANTS)
        learned = self._prepare_residuals(readings, simpler)
        self.inputs_, self.target_scale_mm_ = learned.of, learned.scale_mm
        degC = readings.state_as_read.temperature_degC
        if degC is not None and not self.inputs_.has_temperature:
            self.findings_ += clock(degC)
        n_folds = int(learned.fold.max()) + 1
        progress(0, f"network 1 of {n_folds}")
        self.committee_, outputs = train_committee(
            learned.network,
            learned.inputs,
            learned.targets,
            learned.fold,
            epochs=self.epochs,
            seed=int(self.seed),
            callback=lambda done: progress(done, f"network {min(done + 1, n_folds)} of {n_folds}"),
        )
        held_out = learned.held_out
        self.held_out_ = replace(held_out, deviations=held_out.deviations + learned.scale_mm * outputs.T)
        self.held_out_gross_ = self._corrected(simpler.held_out_gross_, readings, learned)
        n_excluded = 0 if simpler.held_out_errors_ is None else simpler.held_out_errors_.n_excluded
        self.held_out_errors_ = HeldOutErrors.of(self.held_out_, n_excluded=n_excluded)
        with one_blas_thread():
            corrections = learned.scale_mm * self.committee_.outputs(learned.inputs).transpose(0, 2, 1)
            self.fit_ = _with_noise_of(self.held_out_, simpler)
            self._estimate_residual_variance(readings, corrections, learned.fold)

    def _corrected(self, gross: HeldOutReadings, readings: PreparedReadings, learned: _Residuals) -> HeldOutReadings:
        """Deviations of the arm's gross errors, as a network leaves them that has not seen their position."""
        if not len(gross.rows):
            return gross
        unseen = dict(zip(learned.held_out.group.tolist(), learned.fold.tolist(), strict=True))
        member = [unseen.get(group, 0) for group in gross.group.tolist()]
        corrections = self._corrections(readings.state_as_read.rows(gross.rows))
        return replace(gross, deviations=gross.deviations + corrections[member, np.arange(len(member))])

    def _prepare_residuals(self, readings: PreparedReadings, arm_model: IdentifiedModel) -> _Residuals:
        """What the networks learn from readings in one frame: all but those that are gross errors of the arm."""
        held_out = arm_model.held_out_
        held_out = held_out.select(np.argsort(held_out.rows))
        rows, groups = held_out.rows, np.unique(held_out.group)
        if len(rows) < MIN_ROWS or len(groups) < 2:
            raise readings.measured.error(
                f"expected {MIN_ROWS} or more readings in two or more positions that the arm's constants explain, got "
                f"{len(rows)} in {len(groups)}",
                hint="measure more positions, or fit a kinematic model",
            )
        assert readings.points is not None  # checked
        used = readings.state_as_read.rows(rows)
        of = ResidualInputs.of(used.angles, used.temperature_degC, self.arm_.chain.is_prismatic)
        residuals = readings.points[rows] - arm_model.fit_.tips(used)
        scale_mm = TARGET_STDS * max(float(np.sqrt((residuals**2).mean())), LEAST_RMS_MM)
        order = np.random.default_rng([int(self.seed), *b"folds"]).permutation(len(groups))
        return _Residuals(
            Perceptron.with_layers(of.n_inputs, self.hidden, 3),
            of,
            of.scaled(used.angles, used.temperature_degC),
            residuals.T / scale_mm,
            scale_mm,
            held_out,
            (order % min(self.n_members, len(groups)))[np.searchsorted(groups, held_out.group)].astype(np.intp),
        )

    def _estimate_residual_variance(self, readings: PreparedReadings, corrections: FloatArray, fold: IntArray) -> None:
        """Residual variance by which 95 % ellipsoids of the committee contain 95 % of the held-out readings."""
        angles, rows = readings.state.angles, self.held_out_.rows
        share = np.sqrt(_share_of_mean(self.held_out_.deviations, corrections, fold))
        of_arm = self.fit_.tip_covariance(readings.state_as_read.rows(rows))
        of_points = np.zeros((len(rows), 3)) if readings.point_std is None else readings.point_std[rows] ** 2
        held_out = replace(
            self.held_out_,
            deviations=share * self.held_out_.deviations,
            covariance=of_points[:, :, None] * np.eye(3) + of_arm + _scatter(corrections),
        )
        found = unexplained_at(held_out, angles).of_one_reading(readings)
        self.residual_std_, self.variance_function_ = found.residual_std_mm, found.variance_function
        self.tail_freedom_, self.repeating_share_ = found.tail_freedom, found.repeating_share

    def _tips(self, state: ArmState) -> FloatArray:
        return np.asarray(self.fit_.tips(state) + self._corrections(state).mean(axis=0))

    def _corrections(self, state: ArmState) -> FloatArray:
        """(k, n, 3) what each network adds to the tips [mm]."""
        outputs = self.committee_.outputs(self.inputs_.scaled(state.angles, state.temperature_degC))
        return self.target_scale_mm_ * outputs.transpose(0, 2, 1)

    def _covariance_parts(self, at: CheckedReadings) -> tuple[FloatArray, FloatArray]:
        """Uncertainty of the arm's constants and scatter of the networks; residual variance and unstated temperature.

        The members are trained on overlapping readings and err alike, so that the scatter of one of them counts, not
        that of their mean.
        """
        state = at.state
        of_parameters = self.fit_.tip_covariance(state) + _scatter(self._corrections(state))
        variance = self.residual_std_**2 * self.variance_function_.share(state.angles) * self.share_of_mean(at.session)
        unexplained = variance[:, None, None] * np.eye(3)
        known = self.training_.temperature_degC
        if self.inputs_.has_temperature and at.session.temperature_degC is None and known is not None:
            assert state.temperature_degC is not None  # the mean of the training
            low, high = (
                self._corrections(state.at_temperature(state.temperature_degC + sign * known.std)).mean(axis=0)
                for sign in (-1.0, 1.0)
            )
            half = (high - low) / 2
            unexplained = unexplained + half[:, :, None] * half[:, None, :]
        return of_parameters, unexplained

    def _shared_displacements(self, at: CheckedReadings) -> FloatArray:
        # The networks' scatter counts as independent: it has no direction, and in the poses of a seat little in common.
        return self.fit_.tip_displacements(at.state)

    def _check_options(self) -> None:
        super()._check_options()
        if self.arm_model not in ARM_MODELS:
            raise InputError(f"expected arm_model among {list(ARM_MODELS)}, got {self.arm_model!r}")
        check_network_options(self, epochs=1, n_members=2, seed=0)


class _Residuals(NamedTuple):
    """What the networks of a fit learn from: scaled inputs and residuals (samples in columns), and their folds."""

    network: Perceptron
    of: ResidualInputs
    inputs: FloatArray
    targets: FloatArray
    scale_mm: float
    held_out: HeldOutReadings
    fold: IntArray


def _with_noise_of(held_out: HeldOutReadings, arm_model: IdentifiedModel) -> IdentificationResult:
    """The identified arm, its constants as uncertain as by the deviations that remain.

    Its posterior counts all of its residuals as noise. The networks remove most of them, and with them what the
    constants have wrong within the trained range.
    """
    remaining, square = float((held_out.deviations**2).mean()), float((arm_model.held_out_.deviations**2).mean())
    share = min(remaining / square, 1.0) if square > 0 else 1.0
    fit, same = arm_model.fit_, arm_model.fit_.repeatability_covariance
    return replace(
        fit, covariance=share * fit.covariance, repeatability_covariance=None if same is None else share * same
    )


def _scatter(corrections: FloatArray) -> FloatArray:
    """(n, 3, 3) variance of members' corrections (k, n, 3) about their mean, the same in all directions [mm^2].

    A few members do not determine a covariance: that of five has the shape of chance.
    """
    variance = corrections.var(axis=0, ddof=1).mean(axis=1)
    return np.asarray(variance[:, None, None] * np.eye(3))


def _share_of_mean(deviations: FloatArray, corrections: FloatArray, fold: IntArray) -> float:
    """Mean square error of the committee's mean at a new reading, as a share of that of one member.

    The mean square error of k members is that of their mean and their mean square distance from it (Krogh and
    Vedelsby's equation 5). At a held-out reading the distance of the member that has not seen it from the mean of the
    others, which have, estimates the latter.

    Parameters
    ----------
    deviations : (n, 3) array
        Of the members that have not seen the readings [mm].
    corrections : (k, n, 3) array
        Of all members [mm].
    fold : (n,) int array
        The member that has not seen each reading.
    """
    k = len(corrections)
    own = corrections[fold, np.arange(len(fold))]
    distance = own - (corrections.sum(axis=0) - own) / (k - 1)
    square = float((deviations**2).mean())
    if square == 0:
        return 1.0
    return max(1 - ((k - 1) / k) ** 2 * float((distance**2).mean()) / square, 1 / k)
