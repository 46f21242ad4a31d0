"""Small motions of an arm with given errors in a given state: every class of error adds to the motion at its place."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from truearm.arm.chain import CHUNK, Chain
from truearm.terms import gravity_loads, growth_motions, harmonics
from truearm.virtual.state import State
from truearm.virtual.systematic import BEARING_ORDERS, ENCODER_ORDERS, OWN_AXIS, Systematic

FloatArray = npt.NDArray[np.float64]


def true_tips(chain: Chain, systematic: Systematic, angles: FloatArray, state: State) -> FloatArray:
    """Where the tip of the arm with these errors is, (n, 3) [mm]: the nominal chain with exactly composed motions."""
    tips = np.empty((len(angles), 3))
    for rows in _chunks(len(angles)):
        part = motions(chain, systematic, angles[rows], state.rows(rows))
        tips[rows] = chain.tip_in_base(angles[rows], part)
    return tips


def motions(chain: Chain, systematic: Systematic, angles: FloatArray, state: State) -> FloatArray:
    """Motions at every place, (n, n_places, 6) [rad, mm]. Classes at one place add up before they are composed."""
    out = np.zeros((chain.n_places, 6, len(angles)))  # by component, as the chain works
    out += systematic.constants[:, :, None]
    joints = out[1:-1]
    _encoders(joints, systematic, angles)
    _bearings(joints, systematic, angles)
    _gravity(joints, chain, systematic, angles)
    _temperature(out[:-1], chain, systematic, state)
    out[-1, 3:] += systematic.tip_mm_per_N * state.force_in_flange_N.T
    _history(joints, systematic, angles, state)
    return out.transpose(2, 0, 1)


def _encoders(joints: FloatArray, systematic: Systematic, angles: FloatArray) -> None:
    if systematic.encoder.any():
        joints[:, OWN_AXIS] += np.einsum("njkc,jkc->jn", harmonics(angles, ENCODER_ORDERS), systematic.encoder)


def _bearings(joints: FloatArray, systematic: Systematic, angles: FloatArray) -> None:
    if systematic.bearing.any():
        n_joints = len(joints)
        basis = harmonics(angles, BEARING_ORDERS).transpose(1, 0, 2, 3).reshape(n_joints, len(angles), -1)
        joints += (basis @ systematic.bearing.reshape(n_joints, -1, 6)).transpose(0, 2, 1)


def _gravity(joints: FloatArray, chain: Chain, systematic: Systematic, angles: FloatArray) -> None:
    if systematic.load_to_motion.any():
        found = gravity_loads(chain, angles, systematic.masses, gravity_in_base=systematic.gravity_in_base)
        loads = np.concatenate(found, axis=2)
        joints += systematic.load_to_motion @ loads.transpose(1, 2, 0)


def _temperature(links: FloatArray, chain: Chain, systematic: Systematic, state: State) -> None:
    if systematic.expansion_per_K.any():
        growth = growth_motions(chain, state.link_temperature_degC).transpose(1, 2, 0)
        links[:, 3:] += systematic.expansion_per_K[:, None, None] * growth


def _history(joints: FloatArray, systematic: Systematic, angles: FloatArray, state: State) -> None:
    """Add what is no function of the angles alone: hysteresis and the ball cages."""
    joints[:, OWN_AXIS] += systematic.hysteresis[:, None] * state.direction.T
    if systematic.cage.any():
        cage_angle = systematic.cage_ratio * angles + state.cage_phase
        basis = harmonics(cage_angle, [1])[:, :, 0].transpose(1, 0, 2)
        joints += (basis @ systematic.cage).transpose(0, 2, 1)


def _chunks(n: int) -> Iterator[slice]:
    for start in range(0, n, CHUNK):
        yield slice(start, min(start + CHUNK, n))
