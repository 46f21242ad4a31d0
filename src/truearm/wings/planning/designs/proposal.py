"""Proposals of poses and places of the artefact, by each strategy, with their predicted uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import ceil, degrees
from typing import Any, get_args

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.references.alignment import rigid_motions
from truearm.typing import FloatArray, IntArray
from truearm.wings.planning.designs import ArtefactKind, Strategy
from truearm.wings.planning.designs.candidates import (
    ON_A_TABLE,
    Candidates,
    NearbyPoses,
    bar_places,
    seat_poses,
    supports_technician_poses,
    tracker_poses,
    volume_poses,
)
from truearm.wings.planning.designs.coordinate_exchange import shorten_path
from truearm.wings.planning.designs.exchange import OPTIMAL, DesignProblem, project_out, select_candidates
from truearm.wings.planning.designs.information import design_problem, tip_jacobian
from truearm.wings.planning.designs.observability import Observability, observability
from truearm.wings.planning.designs.planned_readings import checked_count, checked_seed
from truearm.wings.planning.designs.prior import Prior
from truearm.wings.planning.designs.tour import mean_joint_move, order_of_few_moves
from truearm.wings.planning.designs.workspace import Sector, Surroundings

Progress = Callable[[int, str], None]

STRATEGIES: tuple[Strategy, ...] = get_args(Strategy)
"""Smallest uncertainty in the volume; smallest confidence ellipsoid; poses of a person who measures; random poses."""

LENGTH_U_MM = 0.005
"""Assumed standard uncertainty of the length of a bar [mm]."""

VOLUME_POSES = 200
# Candidates per pose; with a tracker half of them are a technician's.
_PER_POSE, _FEWEST = 8, 300
_PER_POSE_IN_SEAT, _MOST_SPARE = 4, 60
# Candidate places per place.
_PER_PLACE = 3
# Share of a column's length, and of the longest over their priors, below which the rest of a column is rounding.
_GONE = 1e-9
# Numbers of poses at which the uncertainty is calculated.
_COURSE = 24


@dataclass(frozen=True)
class Artefact:
    """The artefact or instrument of a session.

    Parameters
    ----------
    kind : {"tracker", "seat", "bar"}
    places : int
        Number of seats, or of places of the bar.
    length_mm : float, optional
        Length between the two seats of a bar.

    Raises
    ------
    InputError
        If a bar has no length, or another artefact has one.
    """

    kind: ArtefactKind
    places: int = 0
    length_mm: float | None = None

    def __post_init__(self) -> None:
        if self.kind == "bar" and self.length_mm is None:
            raise InputError("a bar needs the length between its seats in mm", hint="--bar 500")
        if self.kind != "bar" and self.length_mm is not None:
            raise InputError(f"a length applies to the artefact bar only, not to {self.kind}", hint="--artefact bar")
        if self.kind == "tracker" and self.places:
            raise InputError("a number of seats applies to the artefacts seat and bar only, not to tracker")
        if self.kind != "tracker":
            checked_count(self.places, "places")

    @property
    def seats(self) -> int:
        """Number of seats of all places."""
        return self.places * (2 if self.kind == "bar" else 1)


@dataclass(frozen=True, eq=False)
class Proposal:
    """Poses by one strategy.

    Attributes
    ----------
    poses : Candidates
        Each a candidate, in the order of measurement: place by place and seat by seat, and so that the joints move
        little from pose to pose.
    counts : (m,) int array
        Numbers of poses, from 0 to all.
    rms_mm : (m,) array
        Uncertainty of a point in the volume after that number of poses, three-dimensional root mean square; with
        seats, apart from the scale, which they do not determine.
    observability : Observability
        Of the terms by these poses alone; each coefficient is scaled by its prior standard deviation.
    mean_move : float
        Mean over the moves from pose to pose of the largest move of a joint [rad].
    """

    poses: Candidates
    counts: IntArray
    rms_mm: FloatArray
    observability: Observability
    mean_move: float

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as plain data."""
        return {
            "after_mm": float(self.rms_mm[-1]),
            "mean_joint_move_deg": degrees(self.mean_move),
            "course": {"n": self.counts.tolist(), "rms_mm": self.rms_mm.tolist()},
            **{f"o{i}": getattr(self.observability, f"o{i}") for i in range(1, 6)},
            "rank": self.observability.rank,
            "n_parameters": self.observability.n_parameters,
        }


@dataclass(frozen=True, eq=False)
class CalibrationPlan:
    """The proposals of all strategies, and their inputs.

    Attributes
    ----------
    arm : Arm
    prior : Prior
        Knowledge before the session.
    artefact : Artefact
    volume : (n, n_joints) array
        Poses of the later use of the arm.
    proposals : mapping of str to Proposal
        By strategy.
    """

    arm: Arm
    prior: Prior
    artefact: Artefact
    volume: FloatArray
    proposals: Mapping[Strategy, Proposal]


def propose(
    arm: Arm,
    prior: Prior,
    artefact: Artefact,
    n: int,
    *,
    volume: Sector | None = None,
    surroundings: Surroundings = ON_A_TABLE,
    to_measure: Strategy | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> CalibrationPlan:
    """Propose the next poses by every strategy.

    With a seat or a bar, the places are chosen first, each with its most different poses; then the poses in the chosen
    places. Random poses and a technician's are in random places.

    Parameters
    ----------
    arm : Arm
        Base z up.
    prior : Prior
        Knowledge of the arm before the session.
    artefact : Artefact
    n : int
        Number of poses; two and more for each seat.
    volume : Sector, optional
        Where the arm is to be used, by default `Sector()`. With a tracker, a technician's poses are there too; other
        poses may be anywhere in the sector in which the arm works.
    surroundings : Surroundings
        The table that carries the artefacts, and boxes to avoid.
    to_measure : str, optional
        The strategy whose poses are to be measured, none by default. If it is one of `OPTIMAL`, its poses are exchanged
        for others a short way apart (see `tour`).
    seed : int
        Seed of all random choices.
    progress : callable, optional
        Called with the number of strategies done and a note.

    Returns
    -------
    CalibrationPlan
        Without a technician's poses if the arm cannot choose the direction of its stylus.

    Raises
    ------
    InputError
        If there are too few poses for the seats, or the arm does not reach enough places or poses.
    """
    checked_seed(seed)
    if checked_count(n) < 2 * artefact.seats:
        raise InputError(
            f"expected two poses or more for each of {artefact.seats} seats, got {n} in all",
            hint=f"use --poses {2 * artefact.seats}, or fewer seats",
        )
    volume = volume or Sector()
    report = progress or (lambda _done, _note: None)
    report(0, "poses in the volume")
    there = volume_poses(arm, VOLUME_POSES, seed=seed + 1, sector=volume)
    report(0, "candidate poses")
    chooser = _Chooser(arm, prior, artefact, n, there, surroundings, seed)
    pool = chooser.pool(volume)
    proposals: dict[Strategy, Proposal] = {}
    for number, strategy in enumerate(STRATEGIES):
        if strategy != "technician" or supports_technician_poses(arm):
            of_one = partial(report, number)
            within = volume if strategy == to_measure and strategy in OPTIMAL else None
            proposals[strategy] = _proposed(chooser, pool, strategy, within, of_one)
    return CalibrationPlan(arm, prior, artefact, there, proposals)


def _proposed(
    chooser: _Chooser, pool: Candidates, strategy: Strategy, shortened_in: Sector | None, report: Callable[[str], None]
) -> Proposal:
    """The poses of a strategy in an order of few moves; with a sector, shortened as they are the ones to measure."""

    def tell(what: str, done: int, total: int) -> None:
        report(f"{strategy}: {what} {done} of {total}")

    report(strategy)
    chosen = chooser.choose(pool, strategy, tell)
    chosen = chosen.split_into_poses(order_of_few_moves(chooser.arm, chosen.angles, chosen.seat))
    return chooser.proposal(chosen if shortened_in is None else chooser.shorten(chosen, shortened_in, tell))


@dataclass(frozen=True, eq=False)
class _Chooser:
    """Chooses poses by a strategy; holds all other inputs."""

    arm: Arm
    prior: Prior
    artefact: Artefact
    n: int
    volume: FloatArray
    surroundings: Surroundings
    seed: int

    @property
    def per_seat(self) -> int:
        """Poses in each seat, rounded up."""
        return ceil(self.n / self.artefact.seats)

    def pool(self, volume: Sector) -> Candidates:
        """Candidate poses, in more places than will be chosen."""
        if self.artefact.kind == "tracker":
            found = tracker_poses(self.arm, max(_PER_POSE * self.n, _FEWEST), seed=self.seed)
            assert found.technician is not None  # tracker_poses says so
            if volume != Sector() and found.technician.any():
                # A technician measures in the volume; other poses may be anywhere.
                angles = found.angles.copy()
                n_there = int(found.technician.sum())
                angles[found.technician] = volume_poses(self.arm, n_there, seed=self.seed, sector=volume)
                found = replace(found, angles=angles)
            return self._free(found)
        per_seat = min(_PER_POSE_IN_SEAT * self.per_seat, self.per_seat + _MOST_SPARE)
        return self._in_places(_PER_PLACE * self.artefact.places, per_seat, technician=False)

    def _free(self, found: Candidates) -> Candidates:
        """Poses of a tracker plan in which the arm is in no box, enough for each strategy."""
        free = self.surroundings.leaves_free(self.arm.chain, found.angles)
        assert found.technician is not None  # tracker_poses says so
        for technician in set(found.technician.tolist()):
            if (n := int((free & (found.technician == technician)).sum())) < self.n:
                raise InputError(
                    f"only {n} of {self.n} poses leave the table and the boxes free",
                    hint="check --table-top and --avoid",
                )
        return found if free.all() else found.split_into_poses(np.flatnonzero(free))

    def choose(self, pool: Candidates, strategy: Strategy, tell: Callable[[str, int, int], None]) -> Candidates:
        """Poses by a strategy, place by place and seat by seat."""
        if self.artefact.kind == "tracker":
            assert pool.technician is not None  # tracker_poses says so
            which = np.arange(len(pool))
            if strategy in ("technician", "random"):
                which = np.flatnonzero(pool.technician == (strategy == "technician"))
            return pool.split_into_poses(which[self._choose(pool.split_into_poses(which), self.n, strategy, tell)])
        if strategy == "technician":
            found = self._in_places(self.artefact.places, self.per_seat, technician=True).split_into_poses()
            return found.split_into_poses(_shared_out(found, self.n))
        places = self._places(pool, strategy, tell)
        assert pool.place is not None  # poses in seats
        there = pool.split_into_poses(np.concatenate([np.flatnonzero(pool.place == place) for place in places]))
        rows = self._choose(there, self.n, strategy, tell)
        assert there.place is not None
        assert there.seat is not None
        rank = {place: number for number, place in enumerate(places)}
        order = [(rank[place], seat) for place, seat in zip(there.place[rows].tolist(), there.seat[rows], strict=True)]
        return there.split_into_poses(rows[sorted(range(self.n), key=order.__getitem__)])

    def shorten(self, poses: Candidates, volume: Sector, tell: Callable[[str, int, int], None]) -> Candidates:
        """Poses a short way apart, at hardly more uncertainty."""

        def factors(angles: FloatArray) -> FloatArray:
            jacobian = tip_jacobian(self._prior.perturbed_chain, self._prior.state(angles))[1]
            return np.asarray(jacobian / self._prior.noise_mm)

        return shorten_path(
            self.arm,
            poses,
            self._problem(poses),
            factors,
            NearbyPoses(self.arm, self.surroundings, volume),
            seed=self.seed,
            progress=lambda done, total: tell("shorten the moves", done, total),
        )

    def proposal(self, poses: Candidates) -> Proposal:
        """Predicted uncertainty of poses, in their order."""
        problem = self._problem(poses)
        counts = np.unique(np.concatenate([[0], np.geomspace(1, self.n, _COURSE).round()])).astype(np.intp)
        rms = np.sqrt([problem.variance(range(count)) for count in counts])
        J = information_rows(self.prior, poses)
        std = np.sqrt(self.prior.covariance.diagonal())
        moved = mean_joint_move(self.arm, poses.angles)
        return Proposal(poses, counts, rms, observability(J * std, n_poses=self.n), moved)

    def _places(self, pool: Candidates, strategy: Strategy, tell: Callable[[str, int, int], None]) -> list[int]:
        """Places of the artefact, the most useful first, judged by the most different poses in each."""
        assert pool.seat is not None  # poses in seats
        _, first = np.unique(pool.seat, return_index=True)
        rows = np.concatenate([np.arange(start, start + self.per_seat) for start in np.sort(first)])
        by_place = pool.split_into_poses(rows).group_by_place()
        return [int(place) for place in self._choose(by_place, self.artefact.places, strategy, tell)]

    def _choose(
        self, candidates: Candidates, n: int, strategy: Strategy, tell: Callable[[str, int, int], None]
    ) -> IntArray:
        if strategy not in OPTIMAL:
            return np.random.default_rng(self.seed).permutation(len(candidates))[:n]
        return select_candidates(self._problem(candidates), n, strategy=strategy, progress=tell)

    @cached_property
    def _prior(self) -> Prior:
        """Of all that the readings determine apart from seats: the frame of a tracker too."""
        return self.prior.with_frame() if self.artefact.kind == "tracker" else self.prior

    def _problem(self, candidates: Candidates) -> DesignProblem:
        return problem_of(self._prior, candidates, self.volume, scale=self.artefact.kind == "seat")

    def _in_places(self, places: int, per_seat: int, *, technician: bool) -> Candidates:
        options = {"poses": per_seat, "seed": self.seed, "technician": technician, "surroundings": self.surroundings}
        if self.artefact.length_mm is not None:
            return bar_places(self.arm, places, length_mm=self.artefact.length_mm, **options)  # type: ignore[arg-type]
        return seat_poses(self.arm, seats=places, **options)  # type: ignore[arg-type]


def information_rows(prior: Prior, poses: Candidates) -> FloatArray:
    """Information of poses about the terms alone, as rows (m, p) over their noise.

    The frame of a tracker and the positions of seats are eliminated: they are estimated from the same readings.
    """
    tips, jacobian = tip_jacobian(prior.perturbed_chain, prior.state(poses.angles))
    J = jacobian.reshape(3 * len(tips), -1) / prior.noise_mm
    if poses.seat is None:
        rows = project_out(J, rigid_motions(tips))
    else:  # as in `design_problem`; its target is not used
        problem = problem_of(prior, poses.group_by_place(), poses.angles)
        rows = problem.factors.reshape(-1, problem.factors.shape[2])
        if poses.length_mm is not None:  # the length of the bar is estimated too, with its certificate as prior
            certificate = np.zeros((1, rows.shape[1]))
            certificate[0, -1] = 1 / LENGTH_U_MM
            rows = np.concatenate([rows, certificate])
        rows = project_out(rows[:, : J.shape[1]], rows[:, J.shape[1] :])
    if not len(rows):  # too few poses for any information
        return np.zeros((1, J.shape[1]))
    # What moves all points alike, or none, has zero information but for rounding, which is removed.
    size = np.linalg.norm(rows, axis=0)
    scaled = size * np.sqrt(prior.covariance.diagonal())
    gone = (size < _GONE * np.linalg.norm(J, axis=0)) | (scaled < _GONE * scaled.max())
    return np.where(gone, 0.0, rows)


def problem_of(prior: Prior, poses: Candidates, volume: FloatArray, *, scale: bool = False) -> DesignProblem:
    """The `design_problem` of what is known, candidates and poses (n, n_joints) of later use."""
    return design_problem(
        prior.perturbed_chain,
        poses,
        prior.state(poses.angles),
        prior.state(volume),
        prior_precision=prior.precision,
        noise_mm=prior.noise_mm,
        length_u_mm=LENGTH_U_MM,
        scale=scale,
    )


def _shared_out(poses: Candidates, n: int) -> IntArray:
    """Rows of n poses, distributed as evenly as possible over the seats, place by place."""
    assert poses.seat is not None  # poses in seats
    _, seat = np.unique(poses.seat, return_inverse=True)
    turn = np.array([(seat[:row] == seat[row]).sum() for row in range(len(seat))])
    return np.sort(np.argsort(turn, kind="stable")[:n])
