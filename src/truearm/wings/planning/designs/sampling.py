"""Sampling strategies for poses: each is a function of an arm, a number of poses and a seed.

Poses of a person who measures parts, or who holds the tip in a seat with joint angles as different as possible.

There is hardly any publication on how operators place the joints. This is a working model: targets in the front sector,
the stylus within a cone about the surface normal, which points up or sideways, and the elbow to either side, but not
below the table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm, solve_inverse_kinematics
from truearm.errors import InputError
from truearm.identification.sampling import farthest_points
from truearm.typing import BoolArray, FloatArray, NameArray
from truearm.wings.planning.designs.planned_readings import Poses, box, checked_count, checked_seed, uniform
from truearm.wings.planning.designs.workspace import (
    Sector,
    Stance,
    azimuth_of,
    draw_points,
    is_above_table,
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


END_STOP_MARGIN_RAD = float(np.radians(2.0))
"""Operators stay away from the end stops, where the tubes bend and no encoder measures it."""

TRIES_PER_POSE = 30
# Half angle of the cone of stylus directions, and the scatter of elbow and handle about the working pose.
CONE_DEG, SWING_STD_DEG, ROLL_STD_DEG = 40.0, 35.0, 60.0
# Share of the surfaces that face up.
FROM_ABOVE = 0.6
OUT_OF_REACH, AT_LIMIT, UNDER_TABLE = (
    "target not reached",
    "target reached at a joint limit only",
    "joint below the table",
)


def measuring_poses(arm: Arm, n: int, *, seed: int, sector: Sector | None = None) -> Poses:
    """Poses of a person who measures parts in front of an upright arm.

    Each pose has a target point, uniform in `sector`, and a surface normal: up with probability `FROM_ABOVE`, else
    sideways and not away from the arm. The stylus points against the normal up to an angle within the cone. The
    remaining freedom follows a posture drawn about the working pose turned to the target: the elbow swings by
    N(0, `SWING_STD_DEG`) and a freely turning handle (7 axes) rolls by N(0, `ROLL_STD_DEG`). Inverse kinematics solves
    for the angles, 2 deg within the limits; no joint may be below both base and target.

    Parameters
    ----------
    arm : Arm
        Base z up, at least five joints.
    n : int
        Number of poses.
    seed : int
    sector : Sector, optional
        Where the targets are.

    Returns
    -------
    Poses
        With the number of rejected targets, by reason.

    Raises
    ------
    InputError
        If the arm has too few joints, or thirty targets per pose do not give enough poses.
    """
    check_five_rotary_joints(arm)
    rng = np.random.default_rng(checked_seed(seed))
    where, sector = stance(arm), sector or Sector()
    accepted: list[FloatArray] = []
    rejected: Counter[str] = Counter()
    tries_left = TRIES_PER_POSE * checked_count(n)
    missing = n
    while missing and tries_left > 0:
        m = min(max(2 * missing, 50), tries_left)
        tips = draw_points(where, m, sector=sector, rng=rng)
        normals = surface_normals(tips, where, rng)
        axes = -within_cone(normals, half_angle_rad=np.radians(CONE_DEG), rng=rng)
        posture = postures(arm, tips, where, swing_std_deg=SWING_STD_DEG, roll_std_deg=ROLL_STD_DEG, rng=rng)
        angles, reason = reach(arm, tips, axes, posture)
        enough = _rows_until(reason == "", missing)
        rejected.update(reason[:enough][reason[:enough] != ""].tolist())
        accepted.append(angles[:enough][reason[:enough] == ""])
        missing -= len(accepted[-1])
        tries_left -= enough
    if missing:
        summary = f"arm {arm.name!r} takes only {n - missing} of {n} poses in {TRIES_PER_POSE * n} targets"
        raise InputError(f"{summary}: {describe_rejections(rejected)}", hint="use a nearer sector or the strategy box")
    return Poses(np.concatenate(accepted), dict(rejected))


def check_five_rotary_joints(arm: Arm) -> None:
    """Refuse an arm that cannot choose the direction of its stylus, or has prismatic joints."""
    if arm.n_joints < 5:
        raise InputError(
            f"a tip position and a stylus direction need five joints; arm {arm.name!r} has {arm.n_joints}",
            hint="use the strategy box or uniform",
        )
    if arm.chain.is_prismatic.any():
        joint = int(np.argmax(arm.chain.is_prismatic)) + 1
        raise InputError(
            f"postures need rotary joints; J{joint} of arm {arm.name!r} is prismatic", hint="use the strategy uniform"
        )


def surface_normals(tips: FloatArray, where: Stance, rng: np.random.Generator) -> FloatArray:
    """Draw normals of the measured surfaces: up, or sideways within 110 deg of the direction to the arm, (n, 3)."""
    back = np.arctan2(*(where.shoulder_in_base - tips)[:, 1::-1].T)
    azimuth = back + np.radians(rng.uniform(-110, 110, len(tips)))
    sideways = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(tips))])
    up = rng.random((len(tips), 1)) < FROM_ABOVE
    return np.where(up, np.array([0.0, 0.0, 1.0]), sideways)


def postures(
    arm: Arm, tips: FloatArray, where: Stance, *, swing_std_deg: float, roll_std_deg: float, rng: np.random.Generator
) -> FloatArray:
    """Draw nominal postures: the working pose, turned to the targets and swung at random, (n, n_joints) [rad]."""
    out = arm.working + np.radians(swing_std_deg) * rng.standard_normal((len(tips), arm.n_joints))
    out[:, 0] += azimuth_of(tips, where)
    if arm.n_joints > 6:
        out[:, -1] += np.radians(roll_std_deg) * rng.standard_normal(len(tips))
    return np.asarray(np.clip(out, *inner_limits(arm)))


def inner_limits(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Joint limits with a margin, so that no pose is at an end stop; the working pose is always inside."""
    lower, upper = arm.limits.T
    margin = np.where(arm.chain.is_prismatic, 0.0, END_STOP_MARGIN_RAD)
    return np.minimum(lower + margin, arm.working), np.maximum(upper - margin, arm.working)


def reach(arm: Arm, tips: FloatArray, axes: FloatArray, posture: FloatArray) -> tuple[FloatArray, NameArray]:
    """Angles that reach targets, and for each the reason of a failure, or an empty string."""
    lower, upper = inner_limits(arm)
    found = solve_inverse_kinematics(
        arm.chain, tips, start=posture, probe_axis_in_base=axes, posture=posture, lower=lower, upper=upper
    )
    at_limit = ((found.angles <= lower) | (found.angles >= upper)).any(axis=1)
    above = is_above_table(arm.chain, found.angles, tips)
    reason = np.where(~found.reached, np.where(at_limit, AT_LIMIT, OUT_OF_REACH), np.where(above, "", UNDER_TABLE))
    return found.angles, reason


def describe_rejections(rejected: Mapping[str, int]) -> str:
    """Describe the rejected poses in a few words."""
    return ", ".join(f"{count} x {reason}" for reason, count in sorted(rejected.items())) or "none rejected"


def _rows_until(good: BoolArray, wanted: int) -> int:
    """Count the rows up to and including the wanted-th good one; all if there are fewer."""
    places = np.flatnonzero(good)
    return int(places[wanted - 1]) + 1 if len(places) >= wanted else len(good)


STRATEGIES: Mapping[str, Callable[..., Poses]] = {
    "box": box,
    "uniform": uniform,
    "sobol-box": partial(box, sobol=True),
    "sobol": partial(uniform, sobol=True),
    "measuring": measuring_poses,
    "seat": seat,
}
"""Strategies by the names of the command line: ``STRATEGIES[name](arm, n, seed=seed)``."""
