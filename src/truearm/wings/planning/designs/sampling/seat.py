"""Poses with the tip in a seat and joint angles as different as possible."""

from __future__ import annotations

from collections import Counter

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.sampling import farthest_points
from truearm.typing import FloatArray, NameArray
from truearm.wings.planning.designs.poses import Poses, checked_count, checked_seed
from truearm.wings.planning.designs.sampling.measuring import (
    ROLL_STD_DEG,
    SWING_STD_DEG,
    check_five_rotary_joints,
    inner_limits,
    postures,
    reach,
)
from truearm.wings.planning.designs.sampling.workspace import (
    Sector,
    Stance,
    azimuth_of,
    draw_points,
    stance,
    within_cone,
)

SEAT_SECTOR = Sector(near=0.35, far=0.75, low=-0.25, high=0.25, half_angle_deg=60.0)
"""Seats are on the table or on posts, where the arm has room to turn about them."""

# Largest angle of the stylus to the vertical, and that of a technician's.
CONE_RAD, TECHNICIAN_CONE_RAD = np.radians([60.0, 40.0]).tolist()
SWING_RAD = float(np.radians(100.0))  # largest distance of postures from the working pose, per joint
POOL = 5  # candidates per pose, of which the most different are chosen
SPARE_SEATS = 20
NOT_REACHED, TOO_FEW = "seat not reached in a posture", "seat reached in too few postures"


def seat(arm: Arm, n: int, *, seed: int, seats: int | npt.ArrayLike = 3) -> Poses:
    """Poses with the tip in seats: all motion is null-space motion, as in a single-point articulation test.

    Many poses are found for each seat, with the stylus within 60 deg of the vertical and postures within 100 deg of the
    working pose turned to the seat, 2 deg within the limits. Those farthest from one another are chosen.

    Parameters
    ----------
    arm : Arm
        Base z up, at least five joints.
    n : int
        Number of poses, distributed evenly over the seats.
    seed : int
    seats : int or (n_seats, 3) array
        Number of seats, placed well apart in front of the arm, or their positions in the base frame [mm].

    Returns
    -------
    Poses
        Seat by seat, named S1, S2, ..., with the points of the seats.

    Raises
    ------
    InputError
        If the arm has too few joints, there are more seats than poses, or a seat is not reached in enough postures.
    """
    check_five_rotary_joints(arm)
    rng = np.random.default_rng(checked_seed(seed))
    where = stance(arm)
    given = None if isinstance(seats, int | np.integer) else checked_points(seats)
    n_seats = checked_count(int(seats), "seats") if given is None else len(given)  # type: ignore[arg-type]
    counts = _shares(checked_count(n), n_seats)
    rejected: Counter[str] = Counter()
    held: list[tuple[FloatArray, FloatArray]] = []
    for point in _apart(where, n_seats + SPARE_SEATS, rng) if given is None else given:
        angles = _postures_in(arm, point, counts[len(held)], where, rejected, rng)
        if angles is not None:
            held.append((point, angles))
        elif given is not None:
            raise InputError(
                f"fewer than {counts[len(held)]} postures reach the seat at {np.round(point, 1).tolist()} mm",
                hint=f"place the seat about {0.5 * where.reach_mm:.0f} mm in front of the shoulder, or use fewer poses",
            )
        else:
            rejected[TOO_FEW] += 1
        if len(held) == n_seats:
            return _in_order(held, rejected)
    raise InputError(f"arm {arm.name!r} reaches only {len(held)} of {n_seats} seats in enough postures")


def _postures_in(
    arm: Arm, point: FloatArray, n: int, where: Stance, rejected: Counter[str], rng: np.random.Generator
) -> FloatArray | None:
    """Find n postures with the tip at a point, (n, n_joints) [rad], or None."""
    angles, reason = reach_in_seats(arm, point[None], n, where, rng)
    good = angles[reason == ""]
    rejected[NOT_REACHED] += len(angles) - len(good)
    return good[farthest_points(good, n)] if len(good) >= n else None


def reach_in_seats(
    arm: Arm, points: FloatArray, n: int, where: Stance, rng: np.random.Generator, *, technician: bool = False
) -> tuple[FloatArray, NameArray]:
    """Postures with the tip in seats, more than `POOL` times n for each of the points, and why some failed.

    As `reach`. A technician's stylus and joints are as in `measuring_poses`; a seat faces up.
    """
    tips = np.repeat(points, POOL * n + 20, axis=0)
    cone = TECHNICIAN_CONE_RAD if technician else CONE_RAD
    axes = within_cone(np.tile([0.0, 0.0, -1.0], (len(tips), 1)), half_angle_rad=cone, rng=rng)
    if technician:
        return reach(
            arm, tips, axes, postures(arm, tips, where, swing_std_deg=SWING_STD_DEG, roll_std_deg=ROLL_STD_DEG, rng=rng)
        )
    posture = arm.working + rng.uniform(-SWING_RAD, SWING_RAD, (len(tips), arm.n_joints))
    posture[:, 0] += azimuth_of(tips, where)
    return reach(arm, tips, axes, np.clip(posture, *inner_limits(arm)))


def _apart(where: Stance, n: int, rng: np.random.Generator) -> FloatArray:
    """Points in the sector, each as far as possible from those before it."""
    pool = draw_points(where, 10 * n, sector=SEAT_SECTOR, rng=rng)
    return pool[farthest_points(pool, n)]


def _shares(n: int, n_seats: int) -> list[int]:
    if n_seats > n:
        raise InputError(f"expected at least one pose per seat, got {n} poses for {n_seats} seats")
    return [n // n_seats + (i < n % n_seats) for i in range(n_seats)]


def checked_points(seats: npt.ArrayLike) -> FloatArray:
    """Check positions of seats, (n_seats, 3) [mm]."""
    points = np.asarray(seats, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 1 or not np.isfinite(points).all():
        raise InputError(
            f"expected a number of seats or their finite points (n_seats, 3) in mm, got shape {points.shape}"
        )
    return points


def _in_order(held: list[tuple[FloatArray, FloatArray]], rejected: Counter[str]) -> Poses:
    return Poses(
        np.concatenate([angles for _, angles in held]),
        dict(+rejected),
        np.concatenate([np.full(len(angles), f"S{i}") for i, (_, angles) in enumerate(held, start=1)]),
        np.concatenate([np.tile(point, (len(angles), 1)) for point, angles in held]),
    )
