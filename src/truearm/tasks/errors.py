"""What a point measured with an arm is wrong by: systematic errors of the arm and random ones of the point, apart.

Two points taken in nearly the same pose share the systematic errors and differ by the random ones. A length, a diameter
or a form depends on that: who draws all errors anew at each point makes short lengths too uncertain, and averages too
sure (J. Sladek, "Coordinate Metrology", Springer 2016, on virtual measuring machines; the separation of the two is the
usual one of repeatability conditions, JCGM 200:2012, 2.20). So an arm is drawn first, and then its points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.virtual.arm import VirtualArm
from truearm.virtual.presets import Preset
from truearm.virtual.state import State, at_rest, hand_forces, mean_hand_force
from truearm.virtual.systematic import ARCSEC

FloatArray = npt.NDArray[np.float64]

# First word of the streams that a session's slow state is drawn from, so that it shares nothing with an arm's errors.
_SESSION = 3


class DrawnArm(Protocol):
    """One arm that may be the user's."""

    def systematic(self, angles: FloatArray) -> FloatArray:
        """Errors (n, 3) of the shown coordinates [mm] at angles (n, n_joints) [rad]: the same at the same pose."""

    def random(self, angles: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Errors (n, 3) [mm] at angles (n, n_joints) [rad] that are drawn anew for every point."""


class ArmErrors(Protocol):
    """The arms that may be the user's, by what is known of it."""

    @property
    def arm(self) -> Arm:
        """The nominal arm, for which poses are found."""

    def draw(self, seed: int) -> DrawnArm:
        """Draw one of them; the same seed gives the same arm."""


@dataclass(frozen=True, eq=False)
class PresetErrors:
    """Virtual arms of a preset: the arm shows what its nominal chain gives at the angles that its encoders read.

    Systematic are the geometry, encoders, bearings, gravity, the growth at the temperature of the session and where the
    ball cages stand in it. Random are the noise and steps of the encoders, the direction from which a joint came
    (hysteresis), the force of the hand, and the contact (`Preset.seat_std_mm`). The mean force is none of it: as the
    stylus is qualified under it, the deflection is part of the tip's offset.

    Parameters
    ----------
    arm : Arm
        Turning joints only.
    preset : Preset
    """

    arm: Arm
    preset: Preset

    def draw(self, seed: int) -> DrawnPreset:
        """Draw a virtual arm and the state of a session.

        Raises
        ------
        InputError
            As `VirtualArm.draw`.
        """
        return DrawnPreset(VirtualArm.draw(self.arm, self.preset, seed=seed), _session(self.arm, self.preset, seed))


@dataclass(frozen=True, eq=False)
class DrawnPreset:
    """A virtual arm in one session.

    Parameters
    ----------
    virtual : VirtualArm
    session : State
        Of one reading: temperatures of the links, mean force, phases of the ball cages.
    """

    virtual: VirtualArm
    session: State

    @cached_property
    def _shown(self) -> Chain:
        """The chain of the maker's program, its stylus qualified under the mean force."""
        chain = self.virtual.nominal.chain
        deflection = self.virtual.systematic.tip_mm_per_N * mean_hand_force(self.virtual.preset)
        return chain.with_tip(chain.tip_in_flange + deflection)

    def systematic(self, angles: FloatArray) -> FloatArray:
        """See `DrawnArm`."""
        n = len(angles)
        state = State(
            np.zeros(angles.shape),
            np.broadcast_to(self.session.link_temperature_degC, (n, angles.shape[1] + 1)),
            np.broadcast_to(self.session.force_in_flange_N, (n, 3)),
            self.session.cage_phase,
        )
        return self._shown.tip_in_base(angles) - self.virtual.true_tip(angles, state)

    def random(self, angles: FloatArray, rng: np.random.Generator) -> FloatArray:
        """See `DrawnArm`; to first order in the errors, which turn joints by microradians.

        A hand never takes a pose to an encoder's step, so what the steps leave out is even over one of them.
        """
        preset, n = self.virtual.preset, len(angles)
        by_motion = self._shown.small_motions(angles).by_motion
        read = preset.encoder_noise_arcsec * ARCSEC * rng.standard_normal(angles.shape)
        if preset.encoder_counts > 0:
            read += 2 * np.pi / preset.encoder_counts * rng.uniform(-0.5, 0.5, angles.shape)
        came_from = np.where(rng.random(angles.shape) < 0.5, -1.0, 1.0)
        read -= self.virtual.systematic.hysteresis * came_from
        force = hand_forces(preset, n, rng) - mean_hand_force(preset)
        pushed = self.virtual.systematic.tip_mm_per_N * force
        contact = preset.seat_std_mm * rng.standard_normal((n, 3))
        errors: FloatArray = (
            np.einsum("njc,nj->nc", by_motion[:, 1:-1, 2], read)
            - np.einsum("nkc,nk->nc", by_motion[:, -1, 3:], pushed)
            - contact
        )
        return errors


def _session(arm: Arm, preset: Preset, seed: int) -> State:
    """State of a session of minutes, in which a room that warms and cools over hours stands still."""
    rng = np.random.default_rng([_SESSION, seed])
    rest = at_rest(arm.chain, 1, temperature_degC=preset.temperature_degC)
    # A link follows a swing of the air with less amplitude and later (first-order lag, as `link_temperatures`).
    w_lag = 2 * np.pi / preset.temperature_period_s * preset.lag_s
    swing = np.sin(rng.uniform(0, 2 * np.pi) - np.arctan(w_lag)) / np.hypot(1, w_lag)
    return State(
        rest.direction,
        rest.link_temperature_degC + preset.temperature_swing_K * swing,
        np.broadcast_to(mean_hand_force(preset), (1, 3)),
        rng.uniform(0, 2 * np.pi, arm.n_joints),
    )
