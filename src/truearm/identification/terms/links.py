"""Physics of an arm's links: gravity loads of the joints, and thermal expansion."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_banded

from truearm.arm.arm import LinkMasses
from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import cos_sin, cross, cross_matrix, turn_matrices
from truearm.errors import InputError
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2]."""

STANDARD_GRAVITY_IN_BASE = (0.0, 0.0, -STANDARD_GRAVITY)
"""The same in the base frame of an upright arm."""


class Material(NamedTuple):
    """Prior of the thermal expansion of the links of an arm, about zero.

    Attributes
    ----------
    name : str
    common_per_K, own_per_K : float
        Standard deviation of what all links have in common, and of each about it [1/K].
    """

    name: str
    common_per_K: float
    own_per_K: float

    def covariance(self, n_links: int) -> FloatArray:
        """Covariance (n_links, n_links) of the expansion of links [1/K^2]."""
        return self.common_per_K**2 * np.ones((n_links, n_links)) + self.own_per_K**2 * np.eye(n_links)


# Carbon fibre -0.5e-6 to 2e-6/K; steel 11.5e-6/K, aluminium 23e-6/K. Of arms whose material is not known each is half.
MATERIALS = (Material("carbon fibre", 1.5e-6, 1e-6), Material("metal", 17e-6, 6e-6))
UNKNOWN_MATERIAL = Material(
    "unknown",
    float(np.sqrt(np.mean([material.common_per_K**2 for material in MATERIALS]))),
    float(np.sqrt(np.mean([material.own_per_K**2 for material in MATERIALS]))),
)


def link_vectors(chain: Chain) -> FloatArray:
    """Return the links of the chain as vectors in the places where they start.

    Link 0 is the stand, from the base frame's origin to joint 1 along the axes of place 0; link i goes from joint i to
    joint i + 1 along the axes of place i; the last one ends at the tip.

    Returns
    -------
    (n_joints + 1, 3) array
        [mm].
    """
    vectors = chain.fixed[:, :3, 3].copy()
    vectors[0] = chain.fixed[0, :3, :3].T @ vectors[0]  # place 0 is after F0 and has its axes
    vectors[-1] += chain.fixed[-1, :3, :3] @ chain.tip_in_flange
    return vectors


def growth_motions(chain: Chain, temperature_degC: npt.ArrayLike) -> FloatArray:
    """Return the translations of links with unit expansion coefficient: ``(T - 20 degC)`` times the link vector.

    Multiply that of link i by its coefficient [1/K] and apply it at place i.

    Parameters
    ----------
    chain : Chain
        Nominal kinematics.
    temperature_degC : (n,) or (n, n_joints + 1) array
        Temperature of the arm, or of each link [degC].

    Returns
    -------
    (n, n_joints + 1, 3) array
        [mm K].

    Raises
    ------
    InputError
        If the shape of the temperatures does not match.
    """
    temperature = np.asarray(temperature_degC, dtype=float)
    n_links = chain.n_joints + 1
    if temperature.ndim == 1:
        temperature = temperature[:, None]
    if temperature.ndim != 2 or temperature.shape[1] not in (1, n_links):
        raise InputError(f"expected temperatures of shape (n,) or (n, {n_links}), got {temperature.shape}")
    return (temperature - REFERENCE_DEGC)[:, :, None] * link_vectors(chain)


def link_temperatures(air_degC: FloatArray, lag_s: npt.ArrayLike, *, interval_s: float) -> FloatArray:
    """Temperatures that follow the air with first-order lags, starting in equilibrium.

    Parameters
    ----------
    air_degC : (n,) array
        Air at each reading [degC].
    lag_s : (n_links,) array
        Time constants [s]; 0: no lag.
    interval_s : float
        Time between readings [s].

    Returns
    -------
    (n, n_links) array
        [degC].
    """
    out = np.empty((len(air_degC), len(np.asarray(lag_s))))
    for link, lag in enumerate(np.asarray(lag_s, dtype=float)):
        memory = float(np.exp(-interval_s / lag)) if lag > 0 else 0.0
        # T_k - memory T_{k-1} = (1 - memory) air_k, relative to the air at the first reading.
        bands = np.stack([np.ones(len(air_degC)), np.full(len(air_degC), -memory)])
        out[:, link] = air_degC[0] + solve_banded((1, 0), bands, (1 - memory) * (air_degC - air_degC[0]))
    return out


class GravityLoads(NamedTuple):
    """Loads of the joints at each pose.

    Attributes
    ----------
    torque_in_joint : (n, n_joints, 3) array
        Torque about the origin of joint i by the weight of all links outward of it, along the axes of place i [N m].
    force_in_joint : (n, n_joints, 3) array
        That weight, along the same axes [N].
    """

    torque_in_joint: FloatArray
    force_in_joint: FloatArray


def uniform_links(chain: Chain, *, kg_per_m: float) -> LinkMasses:
    """Masses of an arm whose masses are unknown: straight links of uniform mass per length.

    Link i is the straight line from joint i to joint i + 1 (the last one to the tip). Counterweights, springs, encoders
    and the hand that guides the arm are not included.
    """
    vectors = link_vectors(chain)[1:]
    return LinkMasses(kg_per_m * 1e-3 * np.linalg.norm(vectors, axis=1), vectors / 2)


def gravity_torques(
    chain: Chain, angles: npt.ArrayLike, links: LinkMasses, *, gravity_in_base: npt.ArrayLike = STANDARD_GRAVITY_IN_BASE
) -> FloatArray:
    """Gravity torque vector at every joint, (n, n_joints, 3) [N m]; see `gravity_loads`."""
    return gravity_loads(chain, angles, links, gravity_in_base=gravity_in_base).torque_in_joint


def loads_per_kg_at_tip(chain: Chain, angles: npt.ArrayLike, *, gravity_in_base: npt.ArrayLike) -> GravityLoads:
    """Gravity loads of every joint by a mass of 1 kg at the nominal tip, along the axes of the joints' places.

    Torques are in N m per kg, forces in N per kg. See `gravity_loads`.
    """
    n = chain.n_joints
    at_tip = link_vectors(chain)[-1]
    last = np.arange(n) == n - 1
    return gravity_loads(
        chain, angles, LinkMasses(last.astype(float), last[:, None] * at_tip), gravity_in_base=gravity_in_base
    )


def gravity_loads(
    chain: Chain, angles: npt.ArrayLike, links: LinkMasses, *, gravity_in_base: npt.ArrayLike = STANDARD_GRAVITY_IN_BASE
) -> GravityLoads:
    """Gravity loads of every joint, at the nominal pose.

    ``M_i = sum_k m_k (c_k - o_i) x g`` over the links ``k >= i``. The component along a joint's own axis is
    the load of its drive, brake or counterbalance; in a joint moved by hand it causes no bending.

    Parameters
    ----------
    chain : Chain
        Nominal kinematics.
    angles : (n, n_joints) array
        Joint angles [rad], or displacements of sliding joints [mm].
    links : LinkMasses
        Masses of the links, for example `uniform_links`.
    gravity_in_base : (3,) array
        Acceleration of free fall along the base frame's axes [m/s^2]; downwards along z by default.

    Raises
    ------
    InputError
        If the number of masses is not that of the joints, or gravity is not three finite numbers.
    """
    gravity = np.asarray(gravity_in_base, dtype=float)
    if gravity.shape != (3,) or not np.isfinite(gravity).all():
        raise InputError(f"gravity must be three finite numbers in m/s^2, got {gravity_in_base!r}")
    if len(links.mass_kg) != chain.n_joints:
        raise InputError(f"expected {chain.n_joints} link masses, one a joint, got {len(links.mass_kg)}")
    q = np.ascontiguousarray(chain.joint_angles(np.asarray(angles, dtype=float)).T)
    slides = chain.is_prismatic.tolist()
    turn = np.where(chain.is_prismatic[:, None], 0.0, q) if chain.has_slides else q
    mass_outward, local = _fixed_moments(chain, links)
    if q.shape[1] == 1 and not chain.has_slides:
        force, torque = _along_places(chain.fixed[:-1, :3, :3] @ turn_matrices(*cos_sin(turn)), gravity, local)
    else:
        force, first_moments = np.empty((2, len(q), 3, q.shape[1]))
        outward, inward = _steps(chain, *cos_sin(turn))
        # From the base to the last joint: gravity along the axes of each place.
        along = np.repeat(gravity[:, None], q.shape[1], axis=1)
        for i in range(chain.n_joints):
            force[i] = along = outward(i, along)
        # And back: the sum of m (c - o_i) over the links outward, along the same axes [kg mm].
        first_moment = np.zeros((3, q.shape[1]))
        for i in reversed(range(chain.n_joints)):
            first_moment += local[i, :, None]
            first_moments[i] = first_moment
            if slides[i]:  # a prismatic joint has moved its place off the end of the link
                first_moment[2] += mass_outward[i] * q[i]
            first_moment = inward(i, first_moment)
        torque = cross(first_moments.transpose(1, 0, 2), force.transpose(1, 0, 2)).transpose(1, 0, 2)
    torque *= 1e-3  # mm to m
    force *= mass_outward[:, None, None]
    return GravityLoads(torque.transpose(2, 0, 1), force.transpose(2, 0, 1))


@lru_cache(maxsize=64)
def _fixed_moments(chain: Chain, links: LinkMasses) -> tuple[FloatArray, FloatArray]:
    """Mass (n_joints,) of the links from joint i on [kg], and first moment (n_joints, 3) fixed in its place [kg mm].

    The moment is that of the link itself and of the load at its far end.
    """
    vectors, mass_outward = link_vectors(chain), np.cumsum(links.mass_kg[::-1])[::-1]
    own = links.mass_kg[:, None] * links.centre_in_joint_mm
    return mass_outward, (mass_outward - links.mass_kg)[:, None] * vectors[1:] + own


def _along_places(R: FloatArray, gravity: FloatArray, local: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gravity and the torque of the first moments outward of each place (n_joints, 3, 1) by it, of a single pose.

    By products of all places, of the turns (n_joints, 3, 3) from one to the next and the moments fixed in them: the
    number of operations counts.
    """
    for before, own in pairwise(R):
        own[:] = before.dot(own)
    outward = (R @ local[:, :, None])[::-1].cumsum(axis=0)[::-1]
    torque, back = cross_matrix(outward[:, :, 0]) @ gravity, R.transpose(0, 2, 1)
    return back @ gravity[:, None], back @ torque[:, :, None]


_Step = Callable[[int, FloatArray], FloatArray]


def _steps(chain: Chain, cos: FloatArray, sin: FloatArray) -> tuple[_Step, _Step]:
    """Functions that turn vectors (3, n) to the axes of the place of joint i, counted from 0, and back.

    They come from, and go back to, the axes of the place before it, or of the base frame.
    """
    fixed = chain.fixed[:-1, :3, :3]
    return (
        lambda i, v: _about_z(fixed[i].T.dot(v), cos[i], -sin[i]),
        lambda i, v: fixed[i].dot(_about_z(v, cos[i], sin[i])),
    )


def _about_z(v: FloatArray, cos: FloatArray, sin: FloatArray) -> FloatArray:
    """Turn vectors (3, n) about z."""
    out = np.empty_like(v)
    np.multiply(cos, v[0], out=out[0])
    out[0] -= sin * v[1]
    np.multiply(sin, v[0], out=out[1])
    out[1] += cos * v[1]
    out[2] = v[2]
    return out
