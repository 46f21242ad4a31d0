"""Candidates for a plan: poses with the tip in a seat, places of a bar, poses with a tracker.

A candidate is a pose, or an artefact at a place with all its poses. All candidates are feasible by hand: the tip is in
the seat, joints stay 2 deg within their limits, and no joint is below the table. Collisions of the arm with itself and
the line of sight of a tracker are not checked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm, solve_inverse_kinematics
from truearm.errors import InputError
from truearm.identification.sampling import farthest_points, joint_travel_limits
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray
from truearm.wings.planning.designs.planned_readings import checked_count, checked_seed
from truearm.wings.planning.designs.sampling import (
    CONE_RAD,
    NOT_REACHED,
    SEAT_SECTOR,
    TOO_FEW,
    check_five_rotary_joints,
    checked_points,
    inner_limits,
    measuring_poses,
    reach_in_seats,
)
from truearm.wings.planning.designs.workspace import (
    Sector,
    Stance,
    Surroundings,
    draw_points,
    in_sector,
    is_above_table,
    stance,
)

NO_ROOM = "bar not inside the volume"
IN_A_BOX, NO_TABLE = "arm in a box to avoid or in the table", "artefact not on the table, or in a box to avoid"
ON_A_TABLE = Surroundings()
"""The arm's base is on the table that carries the artefacts."""

_WHERE_TABLES_ARE = (
    "check --table-top and --avoid: coordinates are from the centre of the base, x and y as in its arm file"
)
# Maximum draws of joint angles per pose; of a usual arm one in ten to one in a hundred is in the volume.
_DRAWS = 2000
_PLACES = 300  # maximum draws of places of a bar per place
_SPARE = 3  # seats and bars to try per seat or bar


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
        Number of rejected poses in seats and of places, by reason.
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
        columns = {name: getattr(self, name) for name in ("angles", "seat", "seat_points", "place", "technician")}
        of_rows = {name: values[rows] for name, values in columns.items() if values is not None}
        return replace(self, candidate=np.arange(len(rows)), **of_rows)

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
    search = _Search.of(arm, poses, seed, sector, surroundings, technician=technician)
    if isinstance(seats, int | np.integer):
        wanted = checked_count(int(seats), "seats")
        pool = search.places_of_seats(10 * _SPARE * wanted)
        points = pool[farthest_points(pool, _SPARE * wanted)]
        held = search.reached(points[:, None], wanted)
        if len(held) < wanted:
            raise InputError(
                f"arm {arm.name!r} reaches only {len(held)} of {wanted} seats in {poses} postures each",
                hint="use fewer poses in a seat, or another sector",
            )
    else:
        points = checked_points(seats)
        held = search.reached(points[:, None], len(points))
        if len(held) < len(points):
            missed = min(set(range(len(points))) - {place for place, _ in held})
            reach_mm = search.where.reach_mm
            raise InputError(
                f"fewer than {poses} postures reach the seat at {np.round(points[missed], 1).tolist()} mm",
                hint=f"place the seat about {0.5 * reach_mm:.0f} mm in front of the shoulder, or use fewer poses",
            )
    names = [f"S{count}" for count in range(1, len(held) + 1)]
    return search.candidates(held, points[:, None], names).split_into_poses()


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
    search = _Search.of(arm, poses, seed, sector, surroundings, technician=technician)
    if not (np.isfinite(length_mm) and length_mm > 0):
        raise InputError(f"expected the positive length of a bar in mm, got {length_mm}")
    ends = search.places_of_bars(_SPARE * checked_count(n, "places"), length_mm)
    held = search.reached(ends, n)
    if len(held) < n:
        raise InputError(
            f"arm {arm.name!r} reaches only {len(held)} of {n} places of a bar of {length_mm:g} mm in {poses} "
            "postures at each end",
            hint="use a shorter bar, fewer poses at each end, or another sector",
        )
    names = [f"B{count}{end}" for count in range(1, n + 1) for end in "ab"]
    return replace(search.candidates(held, ends, names), length_mm=float(length_mm))


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
    angles = _spread(arm, n - of_technician, sector, np.random.default_rng(checked_seed(seed)))
    if of_technician:
        angles = np.concatenate([volume_poses(arm, of_technician, seed=seed, sector=sector), angles])
    return Candidates(angles, np.arange(n), technician=np.arange(n) < of_technician)


def volume_poses(arm: Arm, n: int, *, seed: int, sector: Sector | None = None) -> FloatArray:
    """Poses of later use in a volume, at which the uncertainty is evaluated, (n, n_joints) [rad, or mm].

    A technician's poses (`sampling.measuring`); uniform joint angles for arms that cannot choose the stylus direction.
    """
    sector = sector or Sector()
    if supports_technician_poses(arm):
        return within_a_turn(arm, measuring_poses(arm, n, seed=seed, sector=sector).angles)
    return _spread(arm, checked_count(n), sector, np.random.default_rng(checked_seed(seed)))


def supports_technician_poses(arm: Arm) -> bool:
    """Whether an arm can choose the direction of its stylus: five joints or more, all rotary."""
    return arm.n_joints >= 5 and not bool(arm.chain.is_prismatic.any())


@dataclass(frozen=True, eq=False)
class _Search:
    """Looks for places of seats that an arm reaches in `per_seat` postures each; counts what it rejects, by reason."""

    arm: Arm
    where: Stance
    per_seat: int
    rng: np.random.Generator
    sector: Sector
    surroundings: Surroundings
    technician: bool
    rejected: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(
        cls, arm: Arm, poses: int, seed: int, sector: Sector, surroundings: Surroundings, *, technician: bool
    ) -> _Search:
        check_five_rotary_joints(arm)
        rng = np.random.default_rng(checked_seed(seed))
        return cls(arm, stance(arm), checked_count(poses), rng, sector, surroundings, technician)

    def places_of_seats(self, n: int) -> FloatArray:
        """Draw points of the sector on or above the table, (n, 3) [mm]."""

        def draw() -> FloatArray:
            points = draw_points(self.where, n, sector=self.sector, rng=self.rng)
            held = self.surroundings.holds(points)
            self.rejected[NO_TABLE] += int((~held).sum())
            return points[held]

        problem = "there is hardly a place for a seat: the table and the boxes leave none in front of the arm"
        return _drawn(draw, n, _PLACES, problem, _WHERE_TABLES_ARE)

    def places_of_bars(self, n: int, length_mm: float) -> FloatArray:
        """Draw both ends of bars in the sector, uniform over places and directions, (n, 2, 3) [mm]."""

        def draw() -> FloatArray:
            first = draw_points(self.where, n, sector=self.sector, rng=self.rng)
            direction = self.rng.standard_normal((n, 3))
            second = first + length_mm * direction / np.linalg.norm(direction, axis=1, keepdims=True)
            inside = in_sector(second, self.where, self.sector)
            held = self.surroundings.holds_bars(first, second)
            self.rejected.update({NO_ROOM: int((~inside).sum()), NO_TABLE: int((inside & ~held).sum())})
            return np.stack([first, second], axis=1)[inside & held]

        room = f"the volume of an arm with a reach of {self.where.reach_mm:.0f} mm"
        hint = f"use a shorter bar, or another sector; {_WHERE_TABLES_ARE}"
        return _drawn(draw, n, _PLACES, f"a bar of {length_mm:g} mm hardly fits into {room}", hint)

    def reached(self, places: FloatArray, wanted: int) -> list[tuple[int, list[FloatArray]]]:
        """The first places (n, seats, 3) whose seats are all reached: number and (per_seat, n_joints) of each seat."""
        held: list[tuple[int, list[FloatArray]]] = []
        at = 0
        while at < len(places) and len(held) < wanted:
            some = places[at : at + wanted - len(held)]
            found = self._postures(some.reshape(-1, 3))
            for count in range(len(some)):
                both = [angles for angles in found[count * some.shape[1] :][: some.shape[1]] if angles is not None]
                if len(both) == some.shape[1]:
                    held.append((at + count, both))
                else:
                    self.rejected[TOO_FEW] += 1
            at += len(some)
        return held

    def _postures(self, points: FloatArray) -> list[FloatArray | None]:
        """Postures with the tip at each of the points, (per_seat, n_joints) [rad], or None if there are fewer."""
        arm, n = self.arm, self.per_seat
        angles, reason = reach_in_seats(arm, points, n, self.where, self.rng, technician=self.technician)
        angles = within_a_turn(arm, angles)
        reached, free = reason == "", self.surroundings.leaves_free(arm.chain, angles)
        self.rejected.update({NOT_REACHED: int((~reached).sum()), IN_A_BOX: int((reached & ~free).sum())})
        pairs = zip(np.split(angles, len(points)), np.split(reached & free, len(points)), strict=True)
        pools = [some[good] for some, good in pairs]
        return [
            None if len(pool) < n else pool[:n] if self.technician else pool[farthest_points(pool, n)] for pool in pools
        ]

    def candidates(self, held: list[tuple[int, list[FloatArray]]], places: FloatArray, names: list[str]) -> Candidates:
        """The places that were reached, each a candidate, with the names of their seats."""
        place = np.repeat(np.arange(len(held)), places.shape[1] * self.per_seat)
        return Candidates(
            np.concatenate([angles for _, seats in held for angles in seats]),
            place,
            np.repeat(names, self.per_seat),
            np.repeat(places[[number for number, _ in held]].reshape(-1, 3), self.per_seat, axis=0),
            place,
            technician=np.full(len(place), self.technician),
            rejected=dict(+self.rejected),
        )


def _drawn(draw: Callable[[], FloatArray], n: int, times: int, problem: str, hint: str) -> FloatArray:
    """N rows by as many draws as are needed; refused if `times` draws do not give as many."""
    found = draw()
    for _ in range(times - 1):
        if len(found) >= n:
            break
        found = np.concatenate([found, draw()])
    if len(found) < n:
        raise InputError(problem.replace("{}", str(len(found))), hint=hint)
    return found[:n]


def _spread(arm: Arm, n: int, sector: Sector, rng: np.random.Generator) -> FloatArray:
    """Draw uniform joint angles with the tip in the sector and no joint below the table, (n, n_joints)."""
    where = stance(arm)
    (lower, upper), (low, high) = joint_travel_limits(arm), inner_limits(arm)
    lower, upper = np.maximum(lower, low), np.minimum(upper, high)

    def draw() -> FloatArray:
        angles = within_a_turn(arm, rng.uniform(lower, upper, (50 * n, arm.n_joints)))
        tips = arm.chain.tip_in_base(angles)
        inside = in_sector(tips, where, sector)
        return angles[inside][is_above_table(arm.chain, angles[inside], tips[inside])]

    problem = f"found only {{}} of {n} poses of arm {arm.name!r} with the tip in the volume"
    return _drawn(draw, n, _DRAWS // 50, problem, "use a larger sector")


def within_a_turn(arm: Arm, angles: FloatArray) -> FloatArray:
    """Reduce angles to half a turn about the working pose, within the limits: full turns give the same pose."""
    turned = (angles - arm.working + np.pi) % (2 * np.pi) - np.pi + arm.working
    lower, upper = inner_limits(arm)
    allowed = ~arm.chain.is_prismatic & (turned >= lower) & (turned <= upper)
    return np.asarray(np.where(allowed, turned, angles))


@dataclass(frozen=True, eq=False)
class NearbyPoses:
    """Where a plan may have poses near joint angles that are wanted: the tip is in its seat, or in the volume.

    Parameters
    ----------
    arm : Arm
        Base z up.
    surroundings : Surroundings
        Table and boxes.
    volume : Sector
        Where poses may be without a seat; they may always be in `Sector()`.
    """

    arm: Arm
    surroundings: Surroundings
    volume: Sector

    def find(self, wanted: FloatArray, seat_points: FloatArray | None = None) -> tuple[FloatArray, BoolArray]:
        """Find poses near joint angles.

        Parameters
        ----------
        wanted : (m, n_joints) array
            [rad, or mm].
        seat_points : (m, 3) array, optional
            Where the tip must be in the base frame [mm].

        Returns
        -------
        angles : (m, n_joints) array
            With the tip in its seat, the nearest by inverse kinematics; without one, within the joint limits.
        allowed : (m,) bool array
            Whether such a pose may be in a plan.
        """
        lower, upper = inner_limits(self.arm)
        if seat_points is None:
            low, high = joint_travel_limits(self.arm)
            angles = np.clip(within_a_turn(self.arm, wanted), np.maximum(lower, low), np.minimum(upper, high))
            tips = self.arm.chain.tip_in_base(angles)
            allowed = in_sector(tips, self._stance, Sector()) | in_sector(tips, self._stance, self.volume)
        else:
            found = solve_inverse_kinematics(
                self.arm.chain, seat_points, start=np.clip(wanted, lower, upper), lower=lower, upper=upper
            )
            angles, tips = within_a_turn(self.arm, found.angles), seat_points
            stylus = self.arm.chain.pose(angles).R_base_tip[:, :, 2]
            at_a_limit = ((found.angles <= lower) | (found.angles >= upper)).any(axis=1)
            allowed = found.reached & ~at_a_limit & (stylus[:, 2] <= -np.cos(CONE_RAD))
        allowed &= is_above_table(self.arm.chain, angles, tips)
        return angles, np.asarray(allowed & self.surroundings.leaves_free(self.arm.chain, angles))

    @cached_property
    def _stance(self) -> Stance:
        return stance(self.arm)
