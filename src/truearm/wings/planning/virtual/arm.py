"""A virtual arm: a nominal arm with drawn errors, whose true tip positions are known.

Arms can be drawn whose nominal model has the errors of a known arm. NIST's constrained Monte Carlo (Phillips and
others) accepts those of many virtual machines whose simulated test gives the results of the real one. The test here is
that of Gao et al. 2017: errors of the nominal model in a box of poses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import ArmState, directions
from truearm.identification.terms.links import link_temperatures
from truearm.readings import PointErrors, Session, point_errors
from truearm.typing import FloatArray
from truearm.wings.planning.designs.planned_readings import checked_seed
from truearm.wings.planning.virtual.error_model import (
    SystematicErrors,
    draw_geometry,
    draw_systematic_errors,
    error_model,
)
from truearm.wings.planning.virtual.presets import ARCSEC, Preset, load_preset
from truearm.wings.planning.virtual.state import (
    air_temperatures,
    base_motions,
    given_temperatures,
    hand_forces,
    mean_hand_force,
    radian_of,
    random_stream,
    virtual_state,
    with_force,
)

TESTS = 30  # all must agree, since the maximum over 200 random poses scatters by some per cent
TRIES = 20_000
BATCH = 50
ROUNDS = 100  # usually four


@dataclass(frozen=True, eq=False)
class _Test:
    """The nominal model's test: poses, and what all arms of a preset share."""

    arm: Arm
    angles: FloatArray
    values: FloatArray  # of the basis functions of the error model at the poses
    nominal_tips: FloatArray  # (m, 3) [mm]
    by_constant: FloatArray  # (6 n_places, 3 m): errors by geometry, to first order

    def other_motions(self, systematic: SystematicErrors) -> FloatArray:
        """Motions (m, n_places, 6) of all errors but those of the geometry."""
        without = systematic.with_geometry(np.zeros((self.arm.chain.n_places, 6)))
        motions = without.model.perturbed_chain.motions(without.coefficients, self.values)
        return np.broadcast_to(motions, (*motions.shape[:2], len(self.angles))).transpose(2, 0, 1)

    def errors(self, motions: FloatArray) -> FloatArray:
        """Errors of the nominal model, (3 m,) [mm], with exact motions (m, n_places, 6)."""
        return (self.arm.chain.tip_in_base(self.angles, motions) - self.nominal_tips).reshape(-1)


def constrain_geometry(arm: Arm, systematic: SystematicErrors, preset: Preset, *, seed: int) -> SystematicErrors:
    """Replace the geometry by the first draw with the test results of the preset.

    Geometry is drawn repeatedly from the arm's stream. Each draw is scaled to the mean error of the preset and accepted
    if the maxima of thirty tests are then all within the preset's tolerance. Where the other classes alone exceed the
    mean error, as in heavy robots, the geometry is not scaled.

    Raises
    ------
    InputError
        If none of 20,000 draws is accepted.
    """
    test = _test_of(arm, preset)
    stream = random_stream("arm", seed, "geometry")
    motions = test.other_motions(systematic)
    others = test.errors(motions)
    if np.abs(others).mean() >= preset.nominal_mean_mm:  # a robot that bends more than a measuring arm errs in all
        return systematic
    for _ in range(TRIES // BATCH):
        batch = np.stack([draw_geometry(arm.chain, preset, stream) for _ in range(BATCH)])
        for few in (3, TESTS):  # most draws fail in the first tests
            batch = _likely(test, others, batch, preset, n_tests=few)
        for constants in batch:
            scaled, off = _scaled(test, motions, others, constants, preset)
            if off <= preset.nominal_max_tolerance_mm:
                return systematic.with_geometry(scaled)
    raise InputError(
        f"none of {TRIES} draws of arm {arm.name!r} has a mean error of {preset.nominal_mean_mm} mm and a maximum "
        f"error of {preset.nominal_max_mm} mm, as preset {preset.name!r} states",
        hint="use another nominal_max_mm, or a larger nominal_max_tolerance_mm",
    )


def box_sample(arm: Arm, n: int, *, half_width_rad: float) -> FloatArray:
    """Draw random poses about the working pose, inside the limits, the same in each call, (n, n_joints)."""
    half = half_width_rad * radian_of(arm.chain)
    lower, upper = np.maximum(arm.working - half, arm.limits[:, 0]), np.minimum(arm.working + half, arm.limits[:, 1])
    return np.random.default_rng([*b"constraint"]).uniform(lower, upper, (n, arm.n_joints))


@lru_cache(maxsize=1)  # many arms of one nominal arm are drawn in a row
def _test_of(arm: Arm, preset: Preset) -> _Test:
    n = TESTS * preset.constraint_poses
    angles = box_sample(arm, n, half_width_rad=np.radians(preset.constraint_half_width_deg))
    values = error_model(arm, preset).perturbed_chain.values(virtual_state(arm, preset, angles))
    small = arm.chain.tip_derivatives(angles)
    by_constant = np.ascontiguousarray(small.motion_jacobian.transpose(1, 2, 0, 3)).reshape(-1, 3 * n)
    return _Test(arm, angles, values, small.tip_in_base, by_constant)


def _likely(test: _Test, others: FloatArray, batch: FloatArray, preset: Preset, *, n_tests: int) -> FloatArray:
    """Keep the draws that pass `n_tests` to first order, accurate to some um, with a larger tolerance."""
    values = n_tests * preset.constraint_poses * 3
    geometric = batch.reshape(len(batch), len(test.by_constant)) @ test.by_constant[:, :values]
    scale, errors = to_mean(others[:values], geometric, preset.nominal_mean_mm)
    off = _off(errors, preset, n_tests=n_tests)
    return np.asarray((scale[:, None, None] * batch)[off <= 1.2 * preset.nominal_max_tolerance_mm])


def _scaled(
    test: _Test, motions: FloatArray, others: FloatArray, constants: FloatArray, preset: Preset
) -> tuple[FloatArray, float]:
    """Scale geometry to the mean error of the preset, with exact motions; also return the deviation of the maxima.

    Errors are linear between no geometry and that of the last round, up to the square of motions of milliradians: the
    first-order scale is accurate to three digits, and each round gains three more.
    """
    for _ in range(2):
        geometric = test.errors(motions + constants) - others
        scale, errors = to_mean(others, geometric[None], preset.nominal_mean_mm)
        constants = scale * constants
        off = float(_off(errors, preset, n_tests=TESTS)[0])
        if off > 1.01 * preset.nominal_max_tolerance_mm:  # further digits do not change that
            break
    return constants, off


def _off(errors: FloatArray, preset: Preset, *, n_tests: int) -> FloatArray:
    """Largest deviation of the maximum of a test from that of the preset, (k,) [mm], for errors (k, m) of k arms."""
    maxima = np.abs(errors).reshape(len(errors), n_tests, errors.shape[1] // n_tests).max(axis=2)
    return np.asarray(np.abs(maxima - preset.nominal_max_mm).max(axis=1))


def to_mean(others: FloatArray, geometric: FloatArray, mean: float) -> tuple[FloatArray, FloatArray]:
    """Scale errors of geometry (k, m) until, with the others (m,), their mean magnitude is `mean`.

    The mean magnitude is a convex function of the scale, below `mean` at 0. Newton's method from a scale that is too
    large converges to the only root above. If the others of a few tests leave no root, the scale is arbitrary.

    Returns
    -------
    scale : (k,) array
    errors : (k, m) array
        Sum of both errors at this scale.
    """
    size = np.abs(geometric).mean(axis=1)
    scale = (mean + np.abs(others).mean()) / size
    for _ in range(ROUNDS):
        errors = others + scale[:, None] * geometric
        slope = np.einsum("km,km->k", np.sign(errors), geometric) / len(others)
        step = (np.abs(errors).mean(axis=1) - mean) / np.maximum(slope, 1e-3 * size)
        scale = scale - step
        if (step <= 1e-6 * scale).all():  # piecewise linear, so after so small a step it has converged
            break
    return scale, others + scale[:, None] * geometric


SETTLING_STEPS = 12
SETTLED_MM = 1e-7
# Standard uncertainty of a distance, and of the offset that all distances to an anchor share [mm]: a good wire, whose
# zero was set with a gauge.
DISTANCE_STD_MM = 0.05
OFFSET_STD_MM = 0.5
# Anchors stand around the base, at these shares of the reach: farther than the tip, low and high in turn.
DISTANCE_SHARE = 1.2
HEIGHT_SHARES = (-0.2, 0.4)


@dataclass(frozen=True, eq=False)
class Measurement:
    """A session measured with a virtual arm, and the true values, which no real arm reveals.

    Attributes
    ----------
    readings : Session
        What a user gets: angles with noise and in encoder steps, reference points with noise, air temperature, and
        the direction of each joint's last movement.
    true_angles : (n, n_joints) array
        Angles before noise and quantisation [rad]; they include the encoders' systematic errors.
    true_tips : (n, 3) array
        True tip positions in the base frame [mm].
    state : ArmState
        Directions of movement, link temperatures and force at each reading.
    """

    readings: Session
    true_angles: FloatArray
    true_tips: FloatArray
    state: ArmState

    def __len__(self) -> int:
        return len(self.true_angles)


@dataclass(frozen=True, eq=False)
class VirtualArm:
    """An arm that differs from its nominal model by known errors.

    The true tip is the exact composition of the finite motions of all terms (`SystematicErrors`) with the nominal
    chain, at the angles that the encoders show without noise and steps. Systematic errors are drawn once per arm;
    `measure` draws the random ones for each reading.

    Parameters
    ----------
    nominal : Arm
        Nominal model; rotary joints only.
    preset : Preset
        Magnitudes of errors and noise.
    systematic : SystematicErrors
        The errors drawn for this arm.
    seed : int
        Seed of the draw.

    Examples
    --------
    >>> import truearm as ta
    >>> virtual = ta.simulate("ur10", poses=10, arm_seed=3).virtual
    >>> virtual.true_tip(virtual.nominal.working[None]).shape
    (1, 3)
    """

    nominal: Arm
    preset: Preset
    systematic: SystematicErrors
    seed: int

    @classmethod
    def draw(cls, nominal: Arm, preset: Preset | str, *, seed: int) -> VirtualArm:
        """Draw an arm's systematic errors; the same seed gives the same arm.

        Parameters
        ----------
        nominal : Arm
        preset : Preset or str
            Magnitudes, or the name of a preset of the package (`PRESETS`).
        seed : int

        Raises
        ------
        InputError
            If the preset's name is unknown, or its constraint cannot be met (see `Preset.nominal_mean_mm`).
        """
        preset = load_preset(preset) if isinstance(preset, str) else preset
        systematic = draw_systematic_errors(nominal, preset, seed=checked_seed(seed))
        if preset.nominal_mean_mm > 0:
            systematic = constrain_geometry(nominal, systematic, preset, seed=seed)
        return cls(nominal, preset, systematic, seed)

    @property
    def serial_number(self) -> str:
        """That of the nominal arm; without one, made of preset and seed: another draw is another unit."""
        return self.nominal.serial_number or f"virtual-{self.preset.name}-{self.seed}"

    @property
    def perturbed_chain(self) -> PerturbedChain:
        """The nominal chain with the terms of the errors."""
        return self.systematic.model.perturbed_chain

    def true_tip(self, angles: npt.ArrayLike, state: ArmState | None = None) -> FloatArray:
        """Return true tips (n, 3) [mm] at noiseless angles (n, n_joints) [rad].

        The other inputs are those of `state`, by default `resting`.
        """
        return self.perturbed_chain.tips(self._state_at(angles, state), self.systematic.coefficients)

    def motions(self, angles: npt.ArrayLike, state: ArmState | None = None) -> FloatArray:
        """Return the motions (n, n_places, 6) [rad, mm] that turn the nominal chain into this arm."""
        state = self._state_at(angles, state)
        chain = self.perturbed_chain
        motions = chain.motions(self.systematic.coefficients, chain.values(state))
        return np.broadcast_to(motions, (*motions.shape[:2], len(state))).transpose(2, 0, 1).copy()

    def resting(self, angles: npt.ArrayLike) -> ArmState:
        """State with mean force, at the preset's mean temperature, half way between the directions of movement."""
        return virtual_state(self.nominal, self.preset, self._checked(angles))

    def state(self, angles: npt.ArrayLike, *, seed: int, temperature_degC: npt.ArrayLike | None = None) -> ArmState:
        """State at each reading of a session, equal to that of `measure` with the same seed."""
        return self._session(self._checked(angles), seed, temperature_degC)[1]

    def measure(
        self,
        angles: npt.ArrayLike,
        *,
        seed: int,
        temperature_degC: npt.ArrayLike | None = None,
        seat: npt.ArrayLike | None = None,
        seat_points: npt.ArrayLike | None = None,
        session: str | None = None,
        reference: bool = True,
    ) -> Measurement:
        """Measure a session: one reading at each row of `angles`, in their order.

        Parameters
        ----------
        angles : (n, n_joints) array
            Angles before noise and quantisation [rad].
        seed : int
            Seed of everything random in this session. The arm's own errors do not depend on it.
        temperature_degC : float or (n,) array, optional
            Air temperature at the readings [degC]; by default the preset's slow swing.
        seat : (n,) array of str, optional
            Name of the seat that holds the tip.
        seat_points : (n, 3) array, optional
            Positions of those seats [mm]. The angles are then settled (see `settle`): the tip is in its seat up to the
            scatter of the seat.
        session : str, optional
            Name of this session in the readings.
        reference : bool
            Whether a reference instrument measures the tip: readings with or without points.
        """
        angles = self._checked(angles)
        air, state = self._session(angles, seed, temperature_degC)
        if seat_points is not None:
            scatter = self.preset.seat_std_mm * random_stream("session", seed, "seat").standard_normal((len(angles), 3))
            angles = self.settle(angles, np.asarray(seat_points, dtype=float) + scatter, state=state)
            state = replace(state, angles=angles)
        tips = self.true_tip(angles, state)
        readings = Session(
            self._read(angles, random_stream("session", seed, "encoder noise")),
            seat=None if seat is None else np.asarray(seat, dtype=np.str_),
            session=None if session is None else np.full(len(angles), session),
            temperature_degC=air,
            directions=state.directions,
            serial_number=np.full(len(angles), self.serial_number),
            angle_columns=tuple(f"q{i}_{unit}" for i, unit in enumerate(self.nominal.joint_units, start=1)),
        )
        if reference:
            readings = self._with_reference(readings, tips, random_stream("session", seed, "reference"))
        return Measurement(readings, angles, tips, state)

    def settle(self, angles: npt.ArrayLike, seat_points: npt.ArrayLike, *, state: ArmState | None = None) -> FloatArray:
        """Move the joints as little as possible until the true tip lies in its seat.

        Gauss-Newton with the nominal derivatives, whose relative error is below 1e-3: each step gains three digits.
        Joint limits are ignored, since the errors of an arm move a joint by a few mrad only.

        Parameters
        ----------
        angles : (n, n_joints) array
            Start, near the seats [rad].
        seat_points : (n, 3) array
            Positions of the seats in the base frame [mm].
        state : ArmState, optional
            `resting` by default.

        Returns
        -------
        (n, n_joints) array
            [rad].

        Raises
        ------
        InputError
            If a tip does not reach its seat.
        """
        angles = self._checked(angles).copy()
        seats = np.asarray(seat_points, dtype=float)
        if seats.shape != (len(angles), 3):
            raise InputError(f"expected a seat's point for each of {len(angles)} poses, got shape {seats.shape}")
        state, radian = self._state_at(angles, state), radian_of(self.nominal.chain)
        for _ in range(SETTLING_STEPS):
            gap = seats - self.true_tip(angles, state)
            if np.abs(gap).max(initial=0.0) < SETTLED_MM:
                return angles
            by_motions = self.nominal.chain.tip_derivatives(angles).motion_jacobian[:, 1:-1]
            own = np.where(self.nominal.chain.is_prismatic, 5, 2)
            own_axes = by_motions[:, np.arange(len(own)), own] * radian[:, None]
            # A new array: a state keeps what it has computed at its angles.
            by_encoders = self.nominal.chain.by_encoders(own_axes.transpose(0, 2, 1))
            angles = angles + radian * (np.linalg.pinv(by_encoders, rcond=1e-6) @ gap[:, :, None])[:, :, 0]
        distance = np.linalg.norm(gap, axis=1)
        worst = int(np.argmax(distance))
        raise InputError(
            f"pose {worst + 1} does not reach its seat: the tip stays {distance[worst]:.3g} mm away",
            hint="start from a pose whose nominal tip is nearer to the seat, with the arm not stretched out",
        )

    def noise_floor(self, measurement: Measurement) -> PointErrors:
        """Errors that no model can reduce: true tips at the measured angles against the reference points.

        The directions of movement, the link temperatures and the base are the true ones; the force is its mean.

        Raises
        ------
        InputError
            If the readings have no points.
        """
        readings = measurement.readings
        if readings.points is None:
            raise InputError("the noise floor needs reference points; these readings have none", hint="reference=True")
        expected = with_force(measurement.state, mean_hand_force(self.preset))
        return point_errors(self.true_tip(readings.angles, expected), readings.points)

    def nominal_error(self, measurement: Measurement) -> PointErrors:
        """Errors of the nominal model at the measured angles against the true tips."""
        tips = self.nominal.chain.tip_in_base(measurement.readings.angles)
        return point_errors(tips, measurement.true_tips)

    def _session(
        self, angles: FloatArray, seed: int, temperature_degC: npt.ArrayLike | None
    ) -> tuple[FloatArray, ArmState]:
        """Air temperature (n,) and state of a session."""
        n, preset = len(angles), self.preset
        if n == 0:
            raise InputError("expected at least one pose to measure, got none")
        checked_seed(seed)
        if temperature_degC is None:
            air = air_temperatures(n, preset, random_stream("session", seed, "air"))
        else:
            air = given_temperatures(temperature_degC, n)
        return air, virtual_state(
            self.nominal,
            preset,
            angles,
            directions=directions(angles),
            link_temperature_degC=link_temperatures(air, self.systematic.lag_s, interval_s=preset.reading_interval_s),
            force_in_flange_N=hand_forces(preset, n, random_stream("session", seed, "force")),
            cage_phase=random_stream("session", seed, "cage").uniform(0, 2 * np.pi, self.nominal.n_joints),
            base_motion=base_motions(n, preset, random_stream("session", seed, "base")),
        )

    def _read(self, angles: FloatArray, stream: np.random.Generator) -> FloatArray:
        """Angles as the encoders show them, with noise and in steps."""
        radian = radian_of(self.nominal.chain)
        noisy = angles + self.preset.encoder_noise_arcsec * ARCSEC * radian * stream.standard_normal(angles.shape)
        if self.preset.encoder_counts == 0:
            return noisy
        step = 2 * np.pi / self.preset.encoder_counts * radian
        return np.round(noisy / step) * step

    def _with_reference(self, readings: Session, tips: FloatArray, stream: np.random.Generator) -> Session:
        std = self.preset.reference_std_mm
        points = tips + std * stream.standard_normal(tips.shape)
        return replace(readings, points=points, point_std=np.full(tips.shape, std) if std > 0 else None)

    def _checked(self, angles: npt.ArrayLike) -> FloatArray:
        angles = np.asarray(angles, dtype=float)
        if angles.ndim != 2 or angles.shape[1] != self.nominal.n_joints or not np.isfinite(angles).all():
            raise InputError(f"expected finite angles of shape (n, {self.nominal.n_joints}), got shape {angles.shape}")
        return angles

    def _state_at(self, angles: npt.ArrayLike, state: ArmState | None) -> ArmState:
        angles = self._checked(angles)
        if state is None:
            return self.resting(angles)
        if len(state) != len(angles):
            raise InputError(f"expected the state of {len(angles)} readings, got that of {len(state)}")
        return state if state.angles is angles else replace(state, angles=angles)


def place_anchors(n: int, *, reach: float) -> FloatArray:
    """(n, 3) places of anchors around the base of an arm, in its base frame [mm]."""
    turn = 2 * np.pi * np.arange(n) / max(n, 1) + 0.3
    height = np.resize(HEIGHT_SHARES, n)
    return reach * np.column_stack([DISTANCE_SHARE * np.cos(turn), DISTANCE_SHARE * np.sin(turn), height])


def measure_distances(measured: Measurement, anchors: FloatArray, *, seed: int) -> Measurement:
    """A measurement with distances: each pose as many times as there are anchors, with a distance to each.

    Parameters
    ----------
    measured : Measurement
        Of n poses. Points and seats stay with the first reading of each pose.
    anchors : (k, 3) array
        Places in the base frame [mm].
    seed : int
        Of noise and offsets.

    Returns
    -------
    Measurement
        Of n k readings; the names of the anchors are A1 to Ak.

    Raises
    ------
    InputError
        If there are no anchors, or the tip touches one.
    """
    n, k = len(measured), len(anchors)
    if k < 1:
        raise InputError("expected one or more anchors, got none")
    stream = random_stream("session", seed, "distances")
    offsets = OFFSET_STD_MM * stream.standard_normal(k)
    distance = np.linalg.norm(measured.true_tips[:, None] - anchors, axis=2) + offsets
    distance += DISTANCE_STD_MM * stream.standard_normal((n, k))
    if not (distance > 0).all():
        raise InputError("the tip touches an anchor: place anchors outside the reach of the arm")
    row, which = np.repeat(np.arange(n), k), np.tile(np.arange(k), n)
    readings, later = measured.readings.rows(row), which > 0
    points, std, seat = readings.points, readings.point_std, readings.seat  # copies: rows were repeated
    for values in (points, std):
        if values is not None:
            values[later] = np.nan
    if seat is not None:
        seat[later] = ""
    readings = replace(
        readings,
        points=points,
        point_std=std,
        seat=seat,
        anchor=np.array([f"A{i + 1}" for i in which]),
        distance_mm=distance.ravel(),
        u_distance_mm=np.full(n * k, DISTANCE_STD_MM),
        u_offset_mm=np.full(n * k, OFFSET_STD_MM),
        numbers=None,
    )
    return Measurement(readings, measured.true_angles[row], measured.true_tips[row], measured.state.rows(row))
