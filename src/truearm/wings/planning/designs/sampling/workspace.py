"""The volume in which a person works with an arm: the front sector, seen from the shoulder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from truearm.arm import Arm, Chain
from truearm.errors import InputError
from truearm.identification.terms import link_vectors
from truearm.typing import BoolArray, FloatArray


@dataclass(frozen=True)
class Sector:
    """The sector in which parts are measured, relative to the reach.

    Parameters
    ----------
    near, far : float
        Horizontal distance from the shoulder.
    low, high : float
        Height above the shoulder.
    half_angle_deg : float
        To both sides of the front, the azimuth of the tip in the working pose.
    """

    near: float = 0.30
    far: float = 0.85
    low: float = -0.30
    high: float = 0.40
    half_angle_deg: float = 60.0


@dataclass(frozen=True, eq=False)
class Stance:
    """Shoulder, reach and front of an arm.

    Attributes
    ----------
    shoulder_in_base : (3,) array
        Origin of joint 2 at the working pose (of joint 1 if there is no other) [mm].
    reach_mm : float
        Sum of the links from the shoulder to the tip.
    front_rad : float
        Azimuth of the working pose's tip about the shoulder.
    """

    shoulder_in_base: FloatArray
    reach_mm: float
    front_rad: float


def stance(arm: Arm) -> Stance:
    """Find shoulder, reach and front of an arm that stands upright (base z up)."""
    chain = arm.chain
    shoulder = joint_origins(chain, arm.working[None])[0, :2][-1]
    reach = float(np.linalg.norm(link_vectors(chain)[min(2, chain.n_joints) :], axis=1).sum())
    ahead = chain.tip_in_base(arm.working[None])[0] - shoulder
    return Stance(shoulder, reach, float(np.arctan2(ahead[1], ahead[0])))


def joint_origins(chain: Chain, angles: FloatArray) -> FloatArray:
    """Origins of the joints, (n, n_joints, 3) [mm] in the base frame."""
    angles, out = chain.joint_angles(angles), np.empty((len(angles), chain.n_joints, 3))
    out[:, 0] = chain.fixed[0, :3, 3]
    for i in range(1, chain.n_joints):  # the chain cut at the next joint has its tip there
        out[:, i] = Chain(chain.fixed[: i + 1], np.zeros(3), chain.is_prismatic[:i]).tip_in_base(angles[:, :i])
    return out


def is_above_table(chain: Chain, angles: FloatArray, tips: FloatArray) -> BoolArray:
    """(n,) Whether no joint is below the table, at the height of the base, or of the tip (n, 3) if that is lower."""
    return np.asarray(joint_origins(chain, angles)[:, :, 2].min(axis=1) >= np.minimum(tips[:, 2], 0.0))


def draw_points(where: Stance, n: int, *, sector: Sector, rng: np.random.Generator) -> FloatArray:
    """Draw points uniform in the volume of the sector, (n, 3) [mm] in the base frame."""
    # Uniform over an area between two radii: the square of the radius is uniform.
    radius = where.reach_mm * np.sqrt(rng.uniform(sector.near**2, sector.far**2, n))
    azimuth = where.front_rad + np.radians(rng.uniform(-sector.half_angle_deg, sector.half_angle_deg, n))
    height = where.reach_mm * rng.uniform(sector.low, sector.high, n)
    return where.shoulder_in_base + np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height])


def azimuth_of(points: FloatArray, where: Stance) -> FloatArray:
    """Azimuths of points as seen from the shoulder, from the front, (n,) [rad] in -pi .. pi."""
    ahead = points - where.shoulder_in_base
    return (np.arctan2(ahead[:, 1], ahead[:, 0]) - where.front_rad + np.pi) % (2 * np.pi) - np.pi


def in_sector(points: FloatArray, where: Stance, sector: Sector) -> BoolArray:
    """(n,) Whether points (n, 3) of the base frame [mm] are in a sector."""
    ahead = (points - where.shoulder_in_base) / where.reach_mm
    radius = np.hypot(ahead[:, 0], ahead[:, 1])
    return np.asarray(
        (radius >= sector.near)
        & (radius <= sector.far)
        & (ahead[:, 2] >= sector.low)
        & (ahead[:, 2] <= sector.high)
        & (np.abs(azimuth_of(points, where)) <= np.radians(sector.half_angle_deg))
    )


def within_cone(axes: FloatArray, *, half_angle_rad: float, rng: np.random.Generator) -> FloatArray:
    """Draw directions uniform in the cones about unit vectors `axes` (n, 3)."""
    n = len(axes)
    cosine = rng.uniform(np.cos(half_angle_rad), 1.0, n)
    turn = rng.uniform(0, 2 * np.pi, n)
    sine = np.sqrt(1 - cosine**2)
    first = np.cross(axes, np.eye(3)[np.abs(axes).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axes, first)
    out: FloatArray = (
        cosine[:, None] * axes + (sine * np.cos(turn))[:, None] * first + (sine * np.sin(turn))[:, None] * second
    )
    return out


def sector_of(volume_mm: Sequence[float], arm: Arm) -> Sector:
    """The sector of an arm from nearest and farthest distance, lowest and highest height [mm] and half angle [deg].

    Raises
    ------
    InputError
        If these are not five numbers of a volume.
    """
    numbers = tuple(map(float, volume_mm))
    near, far, low, high, half_angle_deg = numbers if len(numbers) == 5 else (0.0,) * 5
    if not (all(map(isfinite, numbers)) and 0 <= near < far and low < high and 0 < half_angle_deg <= 180):
        raise InputError(
            "the volume needs five numbers NEAR,FAR,LOW,HIGH,HALF_ANGLE: distances and heights in mm, each the smaller "
            f"first, and an angle in deg; got {','.join(f'{number:g}' for number in numbers)}",
            hint="300,800,-200,400,60",
        )
    reach = stance(arm).reach_mm
    return Sector(near / reach, far / reach, low / reach, high / reach, half_angle_deg)
