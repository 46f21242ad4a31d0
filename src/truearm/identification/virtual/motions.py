"""Small motions of an arm with given errors in a given state: every class of error adds to the motion at its place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from truearm.arm.chain import CHUNK, Chain
from truearm.arm.masses import LinkMasses
from truearm.identification.terms import gravity_loads, growth_motions, harmonics
from truearm.identification.virtual.state import VirtualArmState
from truearm.identification.virtual.systematic import BEARING_ORDERS, ENCODER_ORDERS, OWN_AXIS, SystematicErrors
from truearm.typing import FloatArray


def true_tips(chain: Chain, systematic: SystematicErrors, angles: FloatArray, state: VirtualArmState) -> FloatArray:
    """Where the tip of the arm with these errors is, (n, 3) [mm]: the nominal chain with exactly composed motions."""
    tips = np.empty((len(angles), 3))
    for rows in _chunks(len(angles)):
        part = motions(chain, systematic, angles[rows], state.rows(rows))
        tips[rows] = chain.tip_in_base(angles[rows], part)
    return tips


def motions(chain: Chain, systematic: SystematicErrors, angles: FloatArray, state: VirtualArmState) -> FloatArray:
    """Motions at every place, (n, n_places, 6) [rad, mm]."""
    functions = MotionFunctions(
        chain=chain,
        angles=angles,
        state=state,
        masses=systematic.masses,
        gravity_in_base=systematic.gravity_in_base,
        cage_ratio=systematic.cage_ratio,
    )
    return functions.motions(systematic)


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionFunctions:
    """What the coefficients of an arm's errors multiply, at given angles in a given state.

    The arms of one drawing share them. A function is evaluated when the first arm has coefficients for it.

    Attributes
    ----------
    chain : Chain
        The drawing.
    angles : (n, n_joints) array
        [rad].
    state : VirtualArmState
        Of n readings.
    masses : LinkMasses
    gravity_in_base : (3,) array
        [m/s^2].
    cage_ratio : float
        Turns of a ball cage in a turn of its joint.
    """

    chain: Chain
    angles: FloatArray
    state: VirtualArmState
    masses: LinkMasses
    gravity_in_base: FloatArray
    cage_ratio: float

    def motions(self, systematic: SystematicErrors) -> FloatArray:
        """Motions of an arm, (n, n_places, 6) [rad, mm]. Classes at one place add up before they are composed."""
        out = np.zeros((self.chain.n_places, 6, len(self.angles)))  # by component, as the chain works
        out += systematic.constants[:, :, None]
        joints = out[1:-1]
        if systematic.encoder.any():
            joints[:, OWN_AXIS] += (systematic.encoder.reshape(len(joints), 1, -1) @ self._encoder)[:, 0]
        if systematic.bearing.any():
            joints += systematic.bearing.reshape(len(joints), -1, 6).transpose(0, 2, 1) @ self._bearing
        if systematic.load_to_motion.any():
            joints += systematic.load_to_motion @ self._loads
        if systematic.expansion_per_K.any():
            out[:-1, 3:] += systematic.expansion_per_K[:, None, None] * self._growth
        out[-1, 3:] += systematic.tip_mm_per_N * self.state.force_in_flange_N.T
        # What is no function of the angles alone: hysteresis and the ball cages.
        joints[:, OWN_AXIS] += systematic.hysteresis[:, None] * self.state.direction.T
        if systematic.cage.any():
            joints += systematic.cage.transpose(0, 2, 1) @ self._cage
        return out.transpose(2, 0, 1)

    # Poses last.

    @cached_property
    def _encoder(self) -> FloatArray:
        return self._harmonics(self.angles, ENCODER_ORDERS)

    @cached_property
    def _bearing(self) -> FloatArray:
        return self._harmonics(self.angles, BEARING_ORDERS)

    @cached_property
    def _cage(self) -> FloatArray:
        return self._harmonics(self.cage_ratio * self.angles + self.state.cage_phase, (1,))

    @cached_property
    def _loads(self) -> FloatArray:
        """(n_joints, 6, n) torque [N m], then force [N]."""
        found = gravity_loads(self.chain, self.angles, self.masses, gravity_in_base=self.gravity_in_base)
        return np.ascontiguousarray(np.concatenate(found, axis=2).transpose(1, 2, 0))

    @cached_property
    def _growth(self) -> FloatArray:
        """(n_joints + 1, 3, n) [mm K]."""
        return np.ascontiguousarray(growth_motions(self.chain, self.state.link_temperature_degC).transpose(1, 2, 0))

    def _harmonics(self, angles: FloatArray, orders: tuple[int, ...]) -> FloatArray:
        """(n_joints, 2 n_orders, n) cosine and sine of each order."""
        found = harmonics(angles.T, orders)
        return np.ascontiguousarray(found.reshape(*found.shape[:2], -1).transpose(0, 2, 1))


def _chunks(n: int) -> Iterator[slice]:
    for start in range(0, n, CHUNK):
        yield slice(start, min(start + CHUNK, n))
