"""Candidates for a plan: poses with the tip in a seat, places of a bar, poses with a tracker.

A candidate is a pose, or an artefact at a place with all its poses. All candidates are feasible by hand: the tip is in
the seat, joints stay 2 deg within their limits, and no joint is below the table. Collisions of the arm with itself and
the line of sight of a tracker are not checked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.planning.sampling.measuring import (
    check_five_rotary_joints,
    inner_limits,
    measuring_poses,
    postures,
    reach,
)
from truearm.identification.planning.sampling.poses import checked_count, checked_seed, joint_travel_limits
from truearm.identification.planning.sampling.seat import (
    CONE_RAD,
    NOT_REACHED,
    POOL,
    SEAT_SECTOR,
    SWING_RAD,
    TOO_FEW,
    checked_points,
    farthest_points,
)
from truearm.identification.planning.sampling.surroundings import Surroundings
from truearm.identification.planning.sampling.workspace import (
    Sector,
    Stance,
    azimuth_of,
    draw_points,
    joint_origins,
    stance,
    within_cone,
)
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray

OUTSIDE, UNDER_TABLE, NO_ROOM = "tip outside the volume", "joint below the table", "bar not inside the volume"
IN_A_BOX, NO_TABLE = "arm in a box to avoid or in the table", "artefact not on the table, or in a box to avoid"
ON_A_TABLE = Surroundings()
"""The arm's base is on the table that carries the artefacts."""

_WHERE_TABLES_ARE = "check --table and --avoid: coordinates are from the centre of the base, x and y as in its arm file"
# Maximum draws of joint angles per pose; of a usual arm one in ten to one in a hundred is in the volume.
_DRAWS = 2000
_PLACES = 300  # maximum draws of places of a bar per place
_SPARE = 3  # seats and bars to try per seat or bar
# A technician's stylus and joints, as in `measuring_poses`; a seat faces up.
_CONE_DEG, _SWING_STD_DEG, _ROLL_STD_DEG = 40.0, 35.0, 60.0


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidates and the readings they consist of.

    Attributes
    ----------
    angles : (m, n_joints) array
        Of the readings, candidate by candidate [rad, or mm for sliding joints].
    candidate : (m,) int array
        The candidate that a reading belongs to, from 0.
    seat : (m,) array of str, optional
        The seat that holds the tip: S1, S2, ..., or B1a and B1b for the two of a bar at its first place.
    seat_points : (m, 3) array, optional
        Where that seat is in the base frame, by the nominal arm [mm].
    place : (m,) int array, optional
        The place of the artefact, from 0: one for each seat, or one for both seats of a bar.
    length_mm : float, optional
        Between the two seats of a bar [mm].
    technician : (m,) bool array, optional
        Poses as a person chooses them who measures parts (`sampling.measuring`). This is the strategy of Gao et al.
        2017: data "according to the actual measurement behaviour in the joint space".
    rejected : mapping of str to int
        Number of rejected poses and places, by reason.
    """

    angles: FloatArray
    candidate: IntArray
    seat: NameArray | None = None
    seat_points: FloatArray | None = None
    place: IntArray | None = None
    length_mm: float | None = None
    technician: BoolArray | None = None
    rejected: Mapping[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        """Number of candidates."""
        return int(self.candidate.max(initial=-1)) + 1

    def readings(self, chosen: npt.ArrayLike) -> IntArray:
        """Rows of `angles` that make up the chosen candidates, in the order chosen."""
        return np.concatenate(
            [np.zeros(0, np.intp), *(np.flatnonzero(self.candidate == row) for row in np.asarray(chosen).tolist())]
        )

    def split_into_poses(self, which: npt.ArrayLike | None = None) -> Candidates:
        """Make every reading a candidate of its own, all of them or those in rows `which`, in that order."""
        rows = np.arange(len(self.angles)) if which is None else np.asarray(which, dtype=np.intp)
        return replace(
            self,
            angles=self.angles[rows],
            candidate=np.arange(len(rows)),
            seat=None if self.seat is None else self.seat[rows],
            seat_points=None if self.seat_points is None else self.seat_points[rows],
            place=None if self.place is None else self.place[rows],
            technician=None if self.technician is None else self.technician[rows],
        )

    def group_by_place(self) -> Candidates:
        """Make every place of the artefact with all its poses one candidate, to choose between places."""
        if self.place is None:
            raise InputError("these candidates have no seats")
        _, first, which = np.unique(self.place, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))  # in the order of the readings
        return replace(self, candidate=rank[which].astype(np.intp))


def seat_poses(
    arm: Arm,
    *,
    seats: int | npt.ArrayLike,
    poses: int,
    seed: int,
    sector: Sector = SEAT_SECTOR,
    surroundings: Surroundings = ON_A_TABLE,
    technician: bool = False,
) -> Candidates:
    """Poses with the tip in seats, each a candidate.

    At least five times as many postures are found for each seat, with the stylus within 60 deg of the vertical and the
    joints within 100 deg of the working pose turned to the seat. Those farthest from one another are kept, the farthest
    first.

    Parameters
    ----------
    arm : Arm
        Base z up, at least five rotary joints.
    seats : int or (n_seats, 3) array
        Number of seats, placed well apart in the sector, or their positions in the base frame [mm].
    poses : int
        Candidates in each seat.
    seed : int
    sector : Sector
        Where seats may be.
    surroundings : Surroundings
        Table and boxes; for seats that truearm places, and for all poses.
    technician : bool
        Postures of a person who measures parts: stylus and joints as in `sampling.measuring`, without a choice.

    Raises
    ------
    InputError
        If the arm has too few joints, or a seat is not reached by enough postures.
    """
    check_five_rotary_joints(arm)
    rng, where, per_seat = np.random.default_rng(checked_seed(seed)), stance(arm), checked_count(poses)
    habits = _Habits(arm, where, surroundings, technician)
    rejected: Counter[str] = Counter()
    if isinstance(seats, int | np.integer):
        wanted = checked_count(int(seats), "seats")
        pool = _places_for_seats(where, 10 * _SPARE * wanted, sector, surroundings, rng, rejected)
        points = pool[farthest_points(pool, _SPARE * wanted)]
        held = _held_in_turn(habits, points[:, None], wanted, per_seat, rng, rejected)
        if len(held) < wanted:
            raise InputError(
                f"arm {arm.name!r} reaches only {len(held)} of {wanted} seats in {per_seat} postures each",
                hint="use fewer poses in a seat, or another sector",
            )
    else:
        points = checked_points(seats)
        held = _held_in_turn(habits, points[:, None], len(points), per_seat, rng, rejected)
        if len(held) < len(points):
            missed = min(set(range(len(points))) - {place for place, _ in held})
            raise InputError(
                f"fewer than {per_seat} postures reach the seat at {np.round(points[missed], 1).tolist()} mm",
                hint=f"place the seat about {0.5 * where.reach_mm:.0f} mm in front of the shoulder, or use fewer poses",
            )
    angles = np.concatenate([angles for _, (angles,) in held])
    return Candidates(
        angles,
        np.arange(len(angles)),
        np.repeat([f"S{count}" for count in range(1, len(held) + 1)], per_seat),
        np.repeat(points[[place for place, _ in held]], per_seat, axis=0),
        np.repeat(np.arange(len(held)), per_seat),
        technician=np.full(len(angles), technician),
        rejected=dict(+rejected),
    )


def bar_places(
    arm: Arm,
    n: int,
    *,
    length_mm: float,
    poses: int,
    seed: int,
    sector: Sector = SEAT_SECTOR,
    surroundings: Surroundings = ON_A_TABLE,
    technician: bool = False,
) -> Candidates:
    """Places of a bar with a seat at each end, in any direction, with poses in both seats.

    Parameters
    ----------
    arm : Arm
        Base z up, at least five rotary joints.
    n : int
        Number of places.
    length_mm : float
        Between the seats [mm].
    poses : int
        Number of poses in each seat, as different as possible.
    seed : int
    sector : Sector
        Region of both seats.
    surroundings : Surroundings
        Table and boxes.
    technician : bool
        As in `seat_poses`.

    Raises
    ------
    InputError
        If the arm has too few joints, the bar does not fit into the sector, or too few places are reached.
    """
    check_five_rotary_joints(arm)
    rng, where, per_seat = np.random.default_rng(checked_seed(seed)), stance(arm), checked_count(poses)
    if not (np.isfinite(length_mm) and length_mm > 0):
        raise InputError(f"expected the positive length of a bar in mm, got {length_mm}")
    rejected: Counter[str] = Counter()
    wanted = checked_count(n, "places")
    ends = _ends(where, _SPARE * wanted, length_mm, sector, surroundings, rng, rejected)
    held = _held_in_turn(_Habits(arm, where, surroundings, technician), ends, wanted, per_seat, rng, rejected)
    if len(held) < wanted:
        raise InputError(
            f"arm {arm.name!r} reaches only {len(held)} of {wanted} places of a bar of {length_mm:g} mm in {per_seat} "
            "postures at each end",
            hint="use a shorter bar, fewer poses at each end, or another sector",
        )
    names = [f"B{count}{end}" for count in range(1, wanted + 1) for end in "ab"]
    return Candidates(
        np.concatenate([angles for _, both in held for angles in both]),
        np.repeat(np.arange(wanted), 2 * per_seat),
        np.repeat(names, per_seat),
        np.repeat(ends[[place for place, _ in held]].reshape(-1, 3), per_seat, axis=0),
        np.repeat(np.arange(wanted), 2 * per_seat),
        technician=np.full(2 * per_seat * wanted, technician),
        length_mm=float(length_mm),
        rejected=dict(+rejected),
    )


def tracker_poses(arm: Arm, n: int, *, seed: int, sector: Sector | None = None) -> Candidates:
    """Poses with the tip in a volume, each a candidate.

    If the arm has five rotary joints, half of them are a technician's (see `volume_poses`). The others are
    uniform in the ranges of the joints.

    Parameters
    ----------
    arm : Arm
        Base z up.
    n : int
        Number of poses.
    seed : int
    sector : Sector, optional
        Where the tip is, that of `Sector()` by default.

    Raises
    ------
    InputError
        If too few joint angles move the tip there.
    """
    sector = sector or Sector()
    of_technician = checked_count(n) // 2 if supports_technician_poses(arm) else 0
    angles, rejected = _spread(arm, n - of_technician, sector, np.random.default_rng(checked_seed(seed)))
    if of_technician:
        angles = np.concatenate([volume_poses(arm, of_technician, seed=seed, sector=sector), angles])
    return Candidates(angles, np.arange(n), technician=np.arange(n) < of_technician, rejected=dict(+rejected))


def volume_poses(arm: Arm, n: int, *, seed: int, sector: Sector | None = None) -> FloatArray:
    """Poses of later use in a volume, at which the uncertainty is evaluated, (n, n_joints) [rad, or mm].

    A technician's poses (`sampling.measuring`); uniform joint angles for arms that cannot choose the stylus direction.
    """
    sector = sector or Sector()
    if supports_technician_poses(arm):
        return within_a_turn(arm, measuring_poses(arm, n, seed=seed, sector=sector).angles)
    return _spread(arm, checked_count(n), sector, np.random.default_rng(checked_seed(seed)))[0]


def supports_technician_poses(arm: Arm) -> bool:
    """Whether an arm can choose the direction of its stylus: five joints or more, all rotary."""
    return arm.n_joints >= 5 and not bool(arm.chain.is_prismatic.any())


@dataclass(frozen=True, eq=False)
class _Habits:
    """How poses in seats are found: for which arm, among which surroundings, and whether as a technician does."""

    arm: Arm
    where: Stance
    surroundings: Surroundings
    technician: bool


def _held_in_turn(
    habits: _Habits,
    places: FloatArray,
    wanted: int,
    per_seat: int,
    rng: np.random.Generator,
    rejected: Counter[str],
) -> list[tuple[int, list[FloatArray]]]:
    """The first `wanted` places (n, seats, 3) whose seats are all reached: number and (per_seat, n_joints) each."""
    held: list[tuple[int, list[FloatArray]]] = []
    at = 0
    while at < len(places) and len(held) < wanted:
        some = places[at : at + wanted - len(held)]
        found = _postures_in(habits, some.reshape(-1, 3), per_seat, rng, rejected)
        for count in range(len(some)):
            both = [angles for angles in found[count * some.shape[1] :][: some.shape[1]] if angles is not None]
            if len(both) == some.shape[1]:
                held.append((at + count, both))
            else:
                rejected[TOO_FEW] += 1
        at += len(some)
    return held


def _postures_in(
    habits: _Habits, points: FloatArray, n: int, rng: np.random.Generator, rejected: Counter[str]
) -> list[FloatArray | None]:
    """Find n postures with the tip at each of the points, (n, n_joints) [rad], or None if there are fewer."""
    arm, where, technician = habits.arm, habits.where, habits.technician
    m = POOL * n + 20
    tips = np.repeat(points, m, axis=0)
    down = np.tile([0.0, 0.0, -1.0], (len(tips), 1))
    if technician:
        axes = within_cone(down, half_angle_rad=np.radians(_CONE_DEG), rng=rng)
        posture = postures(arm, tips, where, swing_std_deg=_SWING_STD_DEG, roll_std_deg=_ROLL_STD_DEG, rng=rng)
    else:
        axes = within_cone(down, half_angle_rad=CONE_RAD, rng=rng)
        posture = arm.working + rng.uniform(-SWING_RAD, SWING_RAD, (len(tips), arm.n_joints))
        posture[:, 0] += azimuth_of(tips, where)
        posture = np.clip(posture, *inner_limits(arm))
    angles, reason = reach(arm, tips, axes, posture)
    angles = within_a_turn(arm, angles)
    rejected[NOT_REACHED] += int((reason != "").sum())
    free = habits.surroundings.leaves_free(arm.chain, angles)
    rejected[IN_A_BOX] += int(((reason == "") & ~free).sum())
    reason = np.where(free, reason, IN_A_BOX)
    found: list[FloatArray | None] = []
    for some, why in zip(np.split(angles, len(points)), np.split(reason, len(points)), strict=True):
        good = some[why == ""]
        if len(good) < n:
            found.append(None)
        else:
            found.append(good[:n] if technician else good[farthest_points(good, n)])
    return found


def _places_for_seats(
    where: Stance,
    n: int,
    sector: Sector,
    surroundings: Surroundings,
    rng: np.random.Generator,
    rejected: Counter[str],
) -> FloatArray:
    """Draw points of the sector on or above the table, (n, 3) [mm]."""
    found = np.zeros((0, 3))
    for _ in range(_PLACES):
        points = draw_points(where, n, sector=sector, rng=rng)
        held = surroundings.holds(points)
        rejected[NO_TABLE] += int((~held).sum())
        found = np.concatenate([found, points[held]])
        if len(found) >= n:
            return found[:n]
    raise InputError(
        "there is hardly a place for a seat: the table and the boxes leave none in front of the arm",
        hint=_WHERE_TABLES_ARE,
    )


def _ends(
    where: Stance,
    n: int,
    length_mm: float,
    sector: Sector,
    surroundings: Surroundings,
    rng: np.random.Generator,
    rejected: Counter[str],
) -> FloatArray:
    """Draw both ends of bars in the sector, uniform over places and directions, (n, 2, 3) [mm]."""
    found = np.zeros((0, 2, 3))
    for _ in range(_PLACES):
        first = draw_points(where, n, sector=sector, rng=rng)
        direction = rng.standard_normal((n, 3))
        second = first + length_mm * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        inside = in_sector(second, where, sector)
        rejected[NO_ROOM] += int((~inside).sum())
        held = surroundings.holds_bars(first, second)
        rejected[NO_TABLE] += int((inside & ~held).sum())
        inside &= held
        found = np.concatenate([found, np.stack([first, second], axis=1)[inside]])
        if len(found) >= n:
            return found[:n]
    raise InputError(
        f"a bar of {length_mm:g} mm hardly fits into the volume of an arm with a reach of {where.reach_mm:.0f} mm",
        hint=f"use a shorter bar, or another sector; {_WHERE_TABLES_ARE}",
    )


def _spread(arm: Arm, n: int, sector: Sector, rng: np.random.Generator) -> tuple[FloatArray, Counter[str]]:
    """Draw uniform joint angles with the tip in the sector and no joint below the table, (n, n_joints)."""
    where = stance(arm)
    (lower, upper), (low, high) = joint_travel_limits(arm), inner_limits(arm)
    lower, upper = np.maximum(lower, low), np.minimum(upper, high)
    rejected: Counter[str] = Counter()
    found = np.zeros((0, arm.n_joints))
    for _ in range(_DRAWS // 50):
        angles = within_a_turn(arm, rng.uniform(lower, upper, (50 * n, arm.n_joints)))
        tips = arm.chain.tip_in_base(angles)
        inside = in_sector(tips, where, sector)
        angles, tips = angles[inside], tips[inside]
        above = joint_origins(arm.chain, angles)[:, :, 2].min(axis=1) >= np.minimum(tips[:, 2], 0.0)
        rejected.update({OUTSIDE: int((~inside).sum()), UNDER_TABLE: int((~above).sum())})
        found = np.concatenate([found, angles[above]])
        if len(found) >= n:
            return found[:n], rejected
    raise InputError(
        f"found only {len(found)} of {n} poses of arm {arm.name!r} with the tip in the volume",
        hint="use a larger sector",
    )


def within_a_turn(arm: Arm, angles: FloatArray) -> FloatArray:
    """Reduce angles to half a turn about the working pose, within the limits: full turns give the same pose."""
    turned = (angles - arm.working + np.pi) % (2 * np.pi) - np.pi + arm.working
    lower, upper = inner_limits(arm)
    allowed = ~arm.chain.is_prismatic & (turned >= lower) & (turned <= upper)
    return np.asarray(np.where(allowed, turned, angles))


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
