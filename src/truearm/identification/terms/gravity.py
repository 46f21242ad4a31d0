"""Gravity loads of the joints of an arm."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.arm.chain import Chain
from truearm.arm.masses import LinkMasses
from truearm.errors import InputError
from truearm.identification.terms.thermal import link_vectors
from truearm.typing import FloatArray

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2]."""

STANDARD_GRAVITY_IN_BASE = (0.0, 0.0, -STANDARD_GRAVITY)
"""The same in the base frame of an upright arm."""


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
    chain: Chain,
    angles: npt.ArrayLike,
    links: LinkMasses,
    *,
    gravity_in_base: npt.ArrayLike = STANDARD_GRAVITY_IN_BASE,
) -> FloatArray:
    """Gravity torque vector at every joint, (n, n_joints, 3) [N m]; see `gravity_loads`."""
    return gravity_loads(chain, angles, links, gravity_in_base=gravity_in_base).torque_in_joint


def gravity_loads(
    chain: Chain,
    angles: npt.ArrayLike,
    links: LinkMasses,
    *,
    gravity_in_base: npt.ArrayLike = STANDARD_GRAVITY_IN_BASE,
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
    n = len(np.asarray(angles))
    torque, force = np.empty((2, chain.n_joints, 3, n))
    for rows, _, motion_jacobian in chain.tip_derivatives_by_chunk(angles):
        slide = _slide(chain, np.asarray(angles, dtype=float)[rows])
        _loads_into(chain, links, gravity, motion_jacobian[:, 3:], slide, torque[..., rows], force[..., rows])
    return GravityLoads(torque.transpose(2, 0, 1), force.transpose(2, 0, 1))


def _loads_into(
    chain: Chain,
    links: LinkMasses,
    gravity: FloatArray,
    axes: FloatArray,
    slide: FloatArray | None,
    torque: FloatArray,
    force: FloatArray,
) -> None:
    """Write the loads, from the axes of the places in the base frame, (n_places, 3 axes, 3 components, m)."""
    vectors = link_vectors(chain)
    by_gravity = np.cross(np.eye(3), gravity).T  # v -> v x g as a matrix
    mass_outward = 0.0
    first_moment = np.zeros((3, axes.shape[-1]))  # sum of m (c - o_i) in the base frame [kg mm]
    for i in range(chain.n_joints, 0, -1):
        # The load at the far end of the link and the link itself: one vector fixed in place i.
        local = mass_outward * vectors[i] + links.mass_kg[i - 1] * links.centre_in_joint_mm[i - 1]
        first_moment += np.tensordot(local, axes[i], axes=1)
        mass_outward += float(links.mass_kg[i - 1])
        torque_in_base = 1e-3 * np.tensordot(by_gravity, first_moment, axes=1)  # mm to m
        np.sum(axes[i] * torque_in_base, axis=1, out=torque[i - 1])
        force[i - 1] = np.tensordot(axes[i], mass_outward * gravity, axes=(1, 0))
        if slide is not None:  # joint i's moving frame has slid away from link i - 1's end
            first_moment += mass_outward * slide[i - 1] * axes[i, 2]


def _slide(chain: Chain, angles: FloatArray) -> FloatArray | None:
    """Displacements of prismatic joints, (n_joints, m) [mm]; None if all joints are revolute."""
    assert chain.prismatic is not None  # set in Chain
    return np.where(chain.prismatic, angles, 0.0).T if chain.prismatic.any() else None
