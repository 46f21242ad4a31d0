"""A virtual arm: a nominal arm with drawn errors, which can be measured with as often as one likes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.terms import directions
from truearm.identification.virtual.constrained import constrain_geometry
from truearm.identification.virtual.motions import motions, true_tips
from truearm.identification.virtual.presets import Preset
from truearm.identification.virtual.state import (
    VirtualArmState,
    air_temperatures,
    at_rest,
    given_temperatures,
    hand_forces,
    link_temperatures,
    mean_hand_force,
)
from truearm.identification.virtual.systematic import ARCSEC, RANDOM, SystematicErrors, draw_systematic_errors
from truearm.readings.point_errors import PointErrors, point_errors
from truearm.readings.session import Session
from truearm.typing import FloatArray

SETTLING_STEPS = 12
SETTLED_MM = 1e-7


@dataclass(frozen=True, eq=False)
class Measurement:
    """Readings of a virtual arm and what nobody can know of a real one.

    Attributes
    ----------
    readings : Session
        What a user gets: angles with noise and in encoder steps, reference points with noise, air temperature, and
        from which side each joint came.
    true_angles : (n, n_joints) array
        The angles before noise and quantisation [rad]; the encoders' systematic errors are in them.
    true_tips : (n, 3) array
        Where the tip was, in the base frame [mm].
    state : VirtualArmState
        Direction of movement, link temperatures and force at each reading.
    """

    readings: Session
    true_angles: FloatArray
    true_tips: FloatArray
    state: VirtualArmState

    def __len__(self) -> int:
        return len(self.true_angles)


@dataclass(frozen=True, eq=False)
class VirtualArm:
    """An arm that differs from its drawing in known ways.

    Its *true function* takes the angles that its encoders show, noise and steps apart, and composes a finite motion at
    every place of the nominal chain. Errors drawn once belong to the arm (`systematic`); `measure` draws the others
    anew for each reading.

    Parameters
    ----------
    nominal : Arm
        The drawing.
    preset : Preset
        Magnitudes of errors and noise.
    systematic : SystematicErrors
        The errors drawn for this arm.
    seed : int
        They were drawn from it.
    """

    nominal: Arm
    preset: Preset
    systematic: SystematicErrors
    seed: int

    @classmethod
    def draw(cls, nominal: Arm, preset: Preset, *, seed: int) -> VirtualArm:
        """Draw an arm's systematic errors; the same seed gives the same arm.

        Raises
        ------
        InputError
            If the arm has sliding joints, or the preset's constraint cannot be met (see `Preset.nominal_mean_mm`).
        """
        assert nominal.chain.prismatic is not None  # set in Chain
        if nominal.chain.prismatic.any():
            joint = nominal.joint_names[int(np.argmax(nominal.chain.prismatic))]
            raise InputError(f"a virtual arm has turning joints only, but {joint} of arm {nominal.name!r} slides")
        systematic = draw_systematic_errors(nominal, preset, seed=_checked_seed(seed))
        if preset.nominal_mean_mm > 0:
            systematic = constrain_geometry(nominal, systematic, preset, seed=seed)
        return cls(nominal, preset, systematic, seed)

    def true_tip(self, angles: npt.ArrayLike, state: VirtualArmState | None = None) -> FloatArray:
        """Where the tip is, (n, 3) [mm], at noiseless angles (n, n_joints) [rad]; `state` is `resting` by default."""
        angles = self._checked(angles)
        return true_tips(self.nominal.chain, self.systematic, angles, self._checked_state(state, len(angles)))

    def motions(self, angles: npt.ArrayLike, state: VirtualArmState | None = None) -> FloatArray:
        """Give the motions (n, n_places, 6) [rad, mm] that turn the nominal chain into this arm."""
        angles = self._checked(angles)
        return motions(self.nominal.chain, self.systematic, angles, self._checked_state(state, len(angles)))

    def resting(self, n: int) -> VirtualArmState:
        """State of n readings with the mean force, at the preset's mean temperature, between the two directions."""
        state = at_rest(self.nominal.chain, n, temperature_degC=self.preset.temperature_degC)
        return state.with_force(mean_hand_force(self.preset))

    def state(
        self, angles: npt.ArrayLike, *, seed: int, temperature_degC: npt.ArrayLike | None = None
    ) -> VirtualArmState:
        """State at each of a sequence of readings, as `measure` with the same seed meets it."""
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
        """Take readings, one at each row of `angles` and in their order.

        Parameters
        ----------
        angles : (n, n_joints) array
            Angles before noise and quantisation [rad].
        seed : int
            Of everything random in this session. The arm's own errors do not depend on it.
        temperature_degC : float or (n,) array, optional
            Air at the readings [degC]; by default the preset's slow swing.
        seat : (n,) array of str, optional
            Name of the seat that holds the tip.
        seat_points : (n, 3) array, optional
            Where those seats are [mm]. If given, the angles are first settled (see `settle`), so that the tip is in its
            seat but for the seat's own scatter.
        session : str, optional
            Name of this session in the readings.
        reference : bool
            Whether a reference instrument saw the tip: readings with or without points.
        """
        angles = self._checked(angles)
        air, state = self._session(angles, seed, temperature_degC)
        if seat_points is not None:
            scatter = self.preset.seat_std_mm * _stream(seed, "seat").standard_normal((len(angles), 3))
            angles = self.settle(angles, np.asarray(seat_points, dtype=float) + scatter, state=state)
        tips = self.true_tip(angles, state)
        readings = Session(
            self._read(angles, _stream(seed, "encoder noise")),
            seat=None if seat is None else np.asarray(seat, dtype=np.str_),
            session=None if session is None else np.full(len(angles), session),
            temperature_degC=air,
            directions=state.direction,
        )
        if reference:
            readings = self._referenced(readings, tips, _stream(seed, "reference"))
        return Measurement(readings, angles, tips, state)

    def settle(
        self, angles: npt.ArrayLike, seat_points: npt.ArrayLike, *, state: VirtualArmState | None = None
    ) -> FloatArray:
        """Move the joints as little as needed for the true tip to lie in its seat.

        Gauss-Newton with the nominal derivatives: they err by less than a per mil, so each step gains three digits.
        Joint limits are not watched, since a drawing's errors move a joint by a few mrad.

        Parameters
        ----------
        angles : (n, n_joints) array
            Near the seats [rad].
        seat_points : (n, 3) array
            [mm] in the base frame.
        state : VirtualArmState, optional
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
        state = self._checked_state(state, len(angles))
        for _ in range(SETTLING_STEPS):
            gap = seats - self.true_tip(angles, state)
            if np.abs(gap).max(initial=0.0) < SETTLED_MM:
                return angles
            own_axes = self.nominal.chain.tip_derivatives(angles).motion_jacobian[:, 1:-1, 2]
            angles += (np.linalg.pinv(own_axes.transpose(0, 2, 1), rcond=1e-6) @ gap[:, :, None])[:, :, 0]
        far = np.linalg.norm(gap, axis=1)
        worst = int(np.argmax(far))
        raise InputError(
            f"pose {worst + 1} does not settle in its seat: the tip stays {far[worst]:.3g} mm away",
            hint="a pose whose nominal tip is nearer to the seat, and not with the arm stretched out",
        )

    def noise_floor(self, measurement: Measurement) -> PointErrors:
        """Give what no model can beat: the true function at the measured angles against the reference points.

        The true function knows how each joint came and how warm each link was, and takes the mean force.

        Raises
        ------
        InputError
            If the readings have no points.
        """
        readings = measurement.readings
        if readings.points is None:
            raise InputError(
                "the noise floor needs reference points, and these readings have none", hint="reference=True"
            )
        expected = measurement.state.with_force(mean_hand_force(self.preset))
        return point_errors(self.true_tip(readings.angles, expected), readings.points)

    def nominal_error(self, measurement: Measurement) -> PointErrors:
        """Error of the nominal model at the measured angles against the true tips."""
        tips = self.nominal.chain.tip_in_base(measurement.readings.angles)
        return point_errors(tips, measurement.true_tips)

    def _session(
        self, angles: FloatArray, seed: int, temperature_degC: npt.ArrayLike | None
    ) -> tuple[FloatArray, VirtualArmState]:
        n, chain, preset = len(angles), self.nominal.chain, self.preset
        if n == 0:
            raise InputError("expected at least one pose to measure, got none")
        _checked_seed(seed)
        if temperature_degC is None:
            air = air_temperatures(n, preset, _stream(seed, "air"))
        else:
            air = given_temperatures(temperature_degC, n)
        return air, VirtualArmState(
            direction=directions(angles),
            link_temperature_degC=link_temperatures(air, self.systematic.lag_s, interval_s=preset.reading_interval_s),
            force_in_flange_N=hand_forces(preset, n, _stream(seed, "force")),
            cage_phase=_stream(seed, "cage").uniform(0, 2 * np.pi, chain.n_joints),
        )

    def _read(self, angles: FloatArray, stream: np.random.Generator) -> FloatArray:
        noisy = angles + self.preset.encoder_noise_arcsec * ARCSEC * stream.standard_normal(angles.shape)
        if self.preset.encoder_counts == 0:
            return noisy
        step = 2 * np.pi / self.preset.encoder_counts
        return np.round(noisy / step) * step

    def _referenced(self, readings: Session, tips: FloatArray, stream: np.random.Generator) -> Session:
        std = self.preset.reference_std_mm
        points = tips + std * stream.standard_normal(tips.shape)
        return replace(readings, points=points, point_std=np.full(tips.shape, std) if std > 0 else None)

    def _checked(self, angles: npt.ArrayLike) -> FloatArray:
        angles = np.asarray(angles, dtype=float)
        if angles.ndim != 2 or angles.shape[1] != self.nominal.n_joints or not np.isfinite(angles).all():
            raise InputError(f"expected finite angles of shape (n, {self.nominal.n_joints}), got shape {angles.shape}")
        return angles

    def _checked_state(self, state: VirtualArmState | None, n: int) -> VirtualArmState:
        if state is None:
            return self.resting(n)
        if len(state) != n:
            raise InputError(f"expected the state of {n} readings, got that of {len(state)}")
        return state


def _checked_seed(seed: int) -> int:
    if seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed}")
    return seed


def _stream(seed: int, what: str) -> np.random.Generator:
    """Give a stream of its own to every kind of randomness, so that one changed leaves the others as they were."""
    return np.random.default_rng([RANDOM, seed, *what.encode()])
