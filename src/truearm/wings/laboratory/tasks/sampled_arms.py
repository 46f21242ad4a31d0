"""Arms drawn at random: systematic errors of each arm, and random errors of each point.

Two points measured in nearly the same pose share the systematic errors and differ by the random ones. Lengths,
diameters and forms depend on that: if all errors were drawn at each point, the uncertainty of short lengths would be
too large and that of averages too small (J. Sladek, "Coordinate Metrology", Springer 2016, on virtual measuring
machines; repeatability conditions: JCGM 200:2012, 2.20). Therefore an arm is drawn first, then its points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from typing import Protocol, TypeVar, cast

import numpy as np

from truearm.arm import Arm, Chain
from truearm.errors import InputError
from truearm.identification.judgement.repeating_residuals import JointProcess
from truearm.identification.terms import ArmState, Basis, InducedProcess
from truearm.models import Compensator, IdentifiedModel
from truearm.models.identified_model import require_identified, to_identified
from truearm.readings import Session
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.solve.linear_algebra import covariance_factor
from truearm.typing import FloatArray
from truearm.wings.planning.virtual.arm import VirtualArm
from truearm.wings.planning.virtual.error_model import error_model, tip_compliance
from truearm.wings.planning.virtual.presets import ARCSEC, Preset
from truearm.wings.planning.virtual.state import hand_forces, mean_hand_force, virtual_state

# First words of the streams, different from those of an arm's own errors.
_SESSION, _POSTERIOR = 3, 4
_WAVES = 64
# Displacements of tips up to this are calculated to first order.
LINEAR_MM = 0.3
_KEPT = 400  # results at sets of poses

_Of = TypeVar("_Of")


class ArmSample(Protocol):
    """One arm that may be the user's."""

    def systematic(self, angles: FloatArray) -> FloatArray:
        """Errors (n, 3) of the coordinates [mm] at angles (n, n_joints) [rad]: the same in the same pose."""

    def random(self, angles: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Errors (n, 3) [mm] at angles (n, n_joints) [rad] that are drawn for every point."""


class ArmDistribution(Protocol):
    """The distribution of arms that may be the user's."""

    @property
    def arm(self) -> Arm:
        """The nominal arm, whose poses are used."""

    def draw(self, seed: int) -> ArmSample:
        """Draw one of them; the same seed gives the same arm."""


def _kept_by_pose(method: Callable[[_Of, FloatArray], FloatArray]) -> Callable[[_Of, FloatArray], FloatArray]:
    """Keep results of a method at angles (n, n_joints) for the other arms of a task, which share its sets of poses."""

    @wraps(method)
    def kept(of: _Of, angles: FloatArray) -> FloatArray:
        results = vars(of).setdefault("_kept", {})
        key = method.__name__, angles.tobytes()
        if key not in results:
            if len(results) >= _KEPT:
                results.clear()
            results[key] = method(of, angles)
        return cast(FloatArray, results[key])

    return kept


@dataclass(frozen=True, eq=False)
class PresetDistribution:
    """Virtual arms of a preset, without compensation: coordinates are those of the nominal chain at the encoder angles.

    Systematic errors: geometry, encoders, bearings, gravity, thermal growth and phases of the ball cages in the
    session. Random errors: noise and steps of the encoders, direction of the last movement (hysteresis), force of the
    hand, and contact (`Preset.seat_std_mm`). The mean force causes no error: the stylus is qualified under it.

    Parameters
    ----------
    arm : Arm
        Rotary joints only.
    preset : Preset
    """

    arm: Arm
    preset: Preset

    def draw(self, seed: int) -> PresetSample:
        """Draw a virtual arm and the state of a session.

        Raises
        ------
        InputError
            As `VirtualArm.draw`.
        """
        virtual = VirtualArm.draw(self.arm, self.preset, seed=seed)
        rng = np.random.default_rng([_SESSION, seed])
        # A link follows a swing of the air with a smaller amplitude and a phase lag (first order, as
        # `link_temperatures`). Within a session of minutes, a room that warms and cools over hours is constant.
        w_lag = 2 * np.pi / self.preset.temperature_period_s * self.preset.lag_s
        swing = np.sin(rng.uniform(0, 2 * np.pi) - np.arctan(w_lag)) / np.hypot(1, w_lag)
        temperature = self.preset.temperature_degC + self.preset.temperature_swing_K * swing
        return PresetSample(self, virtual, float(temperature), rng.uniform(0, 2 * np.pi, self.arm.n_joints))

    @_kept_by_pose
    def values(self, angles: FloatArray) -> FloatArray:
        """Values of the basis functions of all arms at angles (n, n_joints), as `SystematicErrors.in_session` needs."""
        state = virtual_state(self.arm, self.preset, angles, link_temperature_degC=REFERENCE_DEGC + 1)
        return error_model(self.arm, self.preset).perturbed_chain.values(state)


@dataclass(frozen=True, eq=False)
class PresetSample:
    """A virtual arm in one session.

    Parameters
    ----------
    distribution : PresetDistribution
    virtual : VirtualArm
    temperature_degC : float
        Of all links in the session.
    cage_phase : (n_joints,) array
        Of the ball cages in the session [rad].
    """

    distribution: PresetDistribution
    virtual: VirtualArm
    temperature_degC: float
    cage_phase: FloatArray

    @cached_property
    def _shown(self) -> Chain:
        """The chain of the maker's program, its stylus qualified under the mean force."""
        chain, preset = self.virtual.nominal.chain, self.virtual.preset
        return chain.with_tip(chain.tip_in_flange + tip_compliance(preset) * mean_hand_force(preset))

    @cached_property
    def _hysteresis(self) -> FloatArray:
        """(n_joints,) rotation of each joint by the direction of its last movement [rad]."""
        coefficients = self.virtual.systematic.of_group("hysteresis")
        return coefficients if len(coefficients) else np.zeros(self.virtual.nominal.n_joints)

    def systematic(self, angles: FloatArray) -> FloatArray:
        """See `ArmSample`."""
        perturbed_chain = self.virtual.perturbed_chain
        coefficients = self.virtual.systematic.in_session(self.temperature_degC, self.cage_phase)
        true_tips = perturbed_chain.tips_from_values(angles, self.distribution.values(angles), coefficients)
        return self._shown.tip_in_base(angles) - true_tips

    def random(self, angles: FloatArray, rng: np.random.Generator) -> FloatArray:
        """See `ArmSample`; to first order in the errors, which turn joints by microradians.

        No hand places a joint to an encoder step, so the error of quantisation is uniform over one step.
        """
        preset, n = self.virtual.preset, len(angles)
        motion_jacobian = self._shown.tip_derivatives(angles).motion_jacobian
        read = preset.encoder_noise_arcsec * ARCSEC * rng.standard_normal(angles.shape)
        if preset.encoder_counts > 0:
            read += 2 * np.pi / preset.encoder_counts * rng.uniform(-0.5, 0.5, angles.shape)
        direction = np.where(rng.random(angles.shape) < 0.5, -1.0, 1.0)
        read -= self._hysteresis * direction
        deflection = tip_compliance(preset) * (hand_forces(preset, n, rng) - mean_hand_force(preset))
        contact = preset.seat_std_mm * rng.standard_normal((n, 3))
        errors: FloatArray = (
            np.einsum("njc,nj->nc", motion_jacobian[:, 1:-1, 2], read)
            - np.einsum("nkc,nk->nc", motion_jacobian[:, -1, 3:], deflection)
            - contact
        )
        return errors


@dataclass(frozen=True, eq=False)
class PosteriorDistribution:
    """Arms drawn from the posterior of a model.

    Systematic errors are drawn once per arm: the coefficients of the model's terms, from their posterior (see
    `birge_ratio`). The residual errors of held-out readings (`residual_std_`) have two parts:

    - random: the repeatability, if it was measured. It contains the noise of encoders, hand and contact. Otherwise
      what the readings show (`truearm.identification.judgement.repeating_residuals`).
    - systematic in a pose: the rest, drawn once per arm as smooth functions of each joint's angle. Half of its
      variance acts like small rotations of the joints, as errors of encoders do; half is isotropic, for bearings and
      bending together.

    Both vary with the pose by the model's variance function (`variance_function_`).

    Hysteresis is systematic too: each joint reaches the points of one side of a feature in the same direction, those of
    the other side in the opposite one, and the compensation assumes the mean of both. With ``directions_given`` what is
    identified of it is compensated. What is not (`hysteresis_`) is drawn once per arm.

    Parameters
    ----------
    model : Compensator
        Nominal, kinematic or physical. A task is simulated at the mean temperature of its readings.
    repeatability_mm : float, optional
        Standard deviation of a coordinate when a point is measured again in the same pose, reached in the same
        direction [mm].
    directions_given : bool
        Whether the model receives every joint's last direction of movement at every point.
    readings : Session, optional
        Readings at whose poses and in whose conditions arms are drawn, in place of the mean ones; with the directions
        of all joints if they are given.
    approach : (n, 3) array, optional
        Direction in the arm's base frame in which the tip reaches each point, in place of that from their middle.

    Raises
    ------
    InputError
        If the model is a network, or the repeatability is negative, not finite, or larger than the model's residual
        standard deviation.
    """

    model: Compensator
    repeatability_mm: float | None = None
    directions_given: bool = False
    readings: Session | None = None
    approach: FloatArray | None = None

    def __post_init__(self) -> None:
        model = require_identified(
            self.model,
            "a model with a network has no terms with a posterior for it: it states the uncertainty of a point, but "
            "not how errors of two points correlate",
            hint="use a kinematic or physical model of the same readings",
        )
        given = self.repeatability_mm
        if given is not None and not 0 <= given < np.inf:
            raise InputError(f"expected a repeatability of zero or more in mm, got {given}")
        if given is not None and given > 1.5 * model.residual_std_:
            raise InputError(
                f"a repeatability of {given:.4g} mm contradicts the model, whose residual standard deviation is "
                f"{model.residual_std_:.4g} mm",
                hint="state the standard deviation of a coordinate in mm, not a range",
            )

    @property
    def arm(self) -> Arm:
        """See `ArmDistribution`."""
        return self.identified.arm_

    @property
    def random_std_mm(self) -> float:
        """Standard deviation of the random error of a coordinate [mm]: the repeatability, or what readings show."""
        if self.repeatability_mm is not None:
            return self.repeatability_mm
        return self.identified.residual_std_ * float(np.sqrt(1 - self.identified.repeating_share_))

    @property
    def field_std_mm(self) -> float:
        """Standard deviation of the residual errors that repeat in the same pose [mm]."""
        return float(np.sqrt(max(self.identified.residual_std_**2 - self.random_std_mm**2, 0.0)))

    @property
    def birge_ratio(self) -> float:
        """Factor of the standard deviations of the posterior (Birge ratio).

        The posterior rests on the stated uncertainty of the reference and on the residuals of the training readings.
        Held-out readings scatter by more, because terms follow the noise and missing effects repeat; the posterior is
        widened accordingly.
        """
        return self.identified.birge_ratio_

    def draw(self, seed: int) -> PosteriorSample:
        """Draw an arm from the posterior."""
        rng = np.random.default_rng([_POSTERIOR, seed])
        fit = self.identified.fit_
        shift = self.birge_ratio * self._root.T @ rng.standard_normal(len(fit.coefficients))
        field = PoseField.of_joints(self.arm.chain, rng)
        of_processes = [PoseField.draw(self.arm.chain, _process_order(term.basis), rng) for term, _ in fit.processes]
        other_way = rng.random() < 0.5
        mean, std = self.uncorrected_hysteresis
        lag = mean + std * rng.standard_normal(self.arm.n_joints)
        return PosteriorSample(self, shift, field, tuple(of_processes), lag, -1.0 if other_way else 1.0)

    def state(self, angles: FloatArray) -> ArmState:
        """State at poses (n, n_joints) [rad], otherwise that of `readings`, or the mean one of the training readings.

        With ``directions_given``, the last movement of each joint has one direction or the other.
        """
        if self.readings is not None:
            return self.identified.state(replace(self.readings, angles=angles))
        direction = None
        if self.directions_given:
            direction = np.random.default_rng(0).choice([-1.0, 1.0], angles.shape)
        return self.identified.state(Session(angles, directions=direction))

    @_kept_by_pose
    def hysteresis(self, angles: FloatArray) -> FloatArray:
        """(n_joints, n, 3) errors at poses (n, n_joints) by the unknown direction of each joint [mm]."""
        return self.identified.fit_.direction_effects(self.state(angles)) @ self.R_base_reference.T

    @_kept_by_pose
    def directions(self, angles: FloatArray) -> FloatArray:
        """(n, n_joints) direction in which each joint reaches poses (n, n_joints), by the smallest move of all."""
        chain, along = self.arm.chain, self.approach
        if along is None:
            tips = chain.tip_in_base(angles)
            along = tips - tips.mean(axis=0)
        moves = np.linalg.pinv((JointProcess(chain).radians[:, None] * self.own_motions(angles)).transpose(0, 2, 1))
        return np.asarray(np.sign((moves @ along[:, :, None])[:, :, 0]))

    @property
    def uncorrected_hysteresis(self) -> FloatArray:
        """(2, n_joints) mean and standard deviation of what the model does not correct [rad or mm]."""
        known = self.identified.hysteresis_
        return known if known.size else np.zeros((2, self.arm.n_joints))

    @_kept_by_pose
    def own_motions(self, angles: FloatArray) -> FloatArray:
        """(n, n_joints, 3) displacement by each joint along its own coordinate at poses [mm/rad or mm/mm]."""
        return JointProcess(self.arm.chain).own_motions(angles)

    def scatter_std(self, angles: FloatArray) -> FloatArray:
        """(n, 1) standard deviation of the random error of a coordinate at poses (n, n_joints) [mm].

        The repeatability is that in one direction of movement; the residuals are of both.
        """
        variance = (self.random_std_mm * self.relative_std(angles)) ** 2
        if self.repeatability_mm is None:
            square = (self.uncorrected_hysteresis**2).sum(axis=0)
            variance = variance - ((self.own_motions(angles) ** 2).mean(axis=2) @ square)[:, None]
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def relative_std(self, angles: FloatArray) -> FloatArray:
        """(n, 1) residual standard deviation at poses (n, n_joints), relative to its mean."""
        shares: FloatArray = np.sqrt(self.identified.variance_function_.share(angles))[:, None]
        return shares

    @_kept_by_pose
    def displacements(self, angles: FloatArray) -> FloatArray:
        """(n, n_joints + 3, 3) displacements of `JointProcess`, times the residual standard deviation at poses."""
        return (
            self.field_std_mm
            * self.relative_std(angles)[:, :, None]
            * JointProcess(self.arm.chain).unit_displacements(angles)
        )

    @_kept_by_pose
    def unspanned(self, angles: FloatArray) -> FloatArray:
        """(k, n, 3) displacements by what each process does between and beyond its inducing points [mm]."""
        return self.birge_ratio * (
            self.identified.fit_.unspanned_displacements(self.state(angles)) @ self.R_base_reference.T
        )

    def tip_shift(self, angles: FloatArray, shift: FloatArray) -> FloatArray:
        """Tips (n, 3) with the identified coefficients minus those with coefficients shifted by `shift` [mm].

        To first order, like the posterior: coefficients that compensate each other to that order may each be
        milliradians off, and their exact composition would contradict the readings. Where tips move far, as with an
        unknown reference frame, the composition is exact, because lengths must not grow.
        """
        fit = self.identified.fit_
        first: FloatArray = -np.einsum("pcn,p->nc", self._derivatives(angles), shift)
        if np.abs(first).max(initial=0.0) < LINEAR_MM:
            return first
        state = self.state(angles)
        return fit.tips(state) - fit.perturbed_chain.tips(state, fit.coefficients + shift)

    @_kept_by_pose
    def _derivatives(self, angles: FloatArray) -> FloatArray:
        """(n_coefficients, 3, n) derivatives of tips."""
        fit = self.identified.fit_
        pieces = fit.perturbed_chain.derivatives(self.state(angles), fit.coefficients)
        return np.concatenate([columns for _, _, columns in pieces], axis=2)

    @cached_property
    def R_base_reference(self) -> FloatArray:
        """(3, 3) rotation of errors from the frame of the model's reference into the arm's base frame."""
        R_reference_base = self.identified.fit_.chain.fixed[0, :3, :3] @ self.arm.chain.fixed[0, :3, :3].T
        return np.asarray(R_reference_base.T)

    @property
    def identified(self) -> IdentifiedModel:
        """The model, which has terms."""
        model = to_identified(self.model)
        assert model is not None  # checked
        return model

    @cached_property
    def _root(self) -> FloatArray:
        return covariance_factor(self.identified.fit_.covariance)


@dataclass(frozen=True, eq=False)
class PosteriorSample:
    """An arm drawn from a model's posterior.

    Parameters
    ----------
    errors : PosteriorDistribution
    shift : (n_coefficients,) array
        Coefficients of this arm minus the identified ones [rad or mm per unit of the basis].
    field : PoseField
        Errors without a term, in units of `PosteriorDistribution.displacements`.
    of_processes : tuple of PoseField
        By process what it does between its inducing points, in units of `PosteriorDistribution.unspanned`: as large as
        stated at every pose, and as smooth as the process.
    lag : (n_joints,) array
        Hysteresis that the model does not correct [rad or mm].
    side : float
        1, or -1 where all joints move opposite to `PosteriorDistribution.directions`.
    """

    errors: PosteriorDistribution
    shift: FloatArray
    field: PoseField
    of_processes: tuple[PoseField, ...]
    lag: FloatArray
    side: float

    def systematic(self, angles: FloatArray) -> FloatArray:
        """See `ArmSample`."""
        of_terms = self.errors.tip_shift(angles, self.shift) @ self.errors.R_base_reference.T
        of_field: FloatArray = np.einsum("nki,nk->ni", self.errors.displacements(angles), self.field.at(angles))
        for unspanned, field in zip(self.errors.unspanned(angles), self.of_processes, strict=True):
            of_field = of_field + unspanned * field.at(angles)
        effects = self.errors.hysteresis(angles).transpose(1, 0, 2) + self.lag[:, None] * self.errors.own_motions(
            angles
        )
        of_direction = (self.side * self.errors.directions(angles))[:, None] @ effects
        return np.asarray(of_terms + of_field - of_direction[:, 0])

    def random(self, angles: FloatArray, rng: np.random.Generator) -> FloatArray:
        """See `ArmSample`."""
        return np.asarray(self.errors.scatter_std(angles) * rng.standard_normal((len(angles), 3)))


@dataclass(frozen=True, eq=False)
class PoseField:
    """Smooth random functions of the joints' angles, with a full turn as their period.

    Gaussian processes with covariance ``exp(-c sum_i (1 - cos(q_i - q_i')))`` over all joints or one, drawn as a sum of
    waves: the Fourier coefficients of ``exp(c (cos d - 1))`` are the probabilities of a whole number k that is the
    difference of two Poisson numbers of mean c/2 (J. G. Skellam, J. R. Stat. Soc. 109 (1946) 296), so whole wave
    numbers drawn by it have that covariance on average (A. Rahimi, B. Recht, "Random features for large-scale kernel
    machines", NIPS 2007).
    A prismatic joint that moves by a third of the arm's reach counts as turned by one radian.

    Parameters
    ----------
    waves : (m, n_joints) array
        Radians of a wave by a joint's radian, or mm.
    cosine, sine : (m, k) array
        Amplitudes of k functions.
    """

    waves: FloatArray
    cosine: FloatArray
    sine: FloatArray

    @classmethod
    def draw(cls, chain: Chain, order: float, rng: np.random.Generator) -> PoseField:
        """Draw a function of all joints of standard deviation 1; c is the square of `order`."""
        waves = _orders(order, (_WAVES, chain.n_joints), rng) / JointProcess(chain).radians
        return cls(waves, *(rng.standard_normal((2, _WAVES, 1)) / np.sqrt(_WAVES)))

    @classmethod
    def of_joints(cls, chain: Chain, rng: np.random.Generator) -> PoseField:
        """Draw a function of each joint, and three that are sums of functions of all joints, in units of each std."""
        n = chain.n_joints
        own = np.repeat(np.eye(n), _WAVES, axis=0)
        waves = own * _orders(JointProcess.order, (len(own), 1), rng) / JointProcess(chain).radians
        size = np.concatenate([own, np.full((len(own), 3), 1 / np.sqrt(n))], axis=1) / np.sqrt(_WAVES)
        return cls(waves, *(size * rng.standard_normal((2, *size.shape))))

    def at(self, angles: FloatArray) -> FloatArray:
        """Values (n, k) at angles (n, n_joints)."""
        phase = angles @ self.waves.T
        values: FloatArray = np.cos(phase) @ self.cosine + np.sin(phase) @ self.sine
        return values


def _orders(order: float, shape: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """Whole orders of waves, of this root mean square."""
    return np.asarray(rng.poisson(order**2 / 2, shape) - rng.poisson(order**2 / 2, shape), dtype=float)


def _process_order(basis: Basis) -> float:
    """Order of waves with the covariance of a process: 1 over the length scale of its turning joints."""
    assert isinstance(basis, InducedProcess)
    scales = [scale for joint, scale in enumerate(basis.length_scales, 1) if joint not in basis.sliding]
    return 1 / min(scales, default=1.0)
