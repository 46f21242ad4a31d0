"""A plan to measure by: places of the artefact and poses, by each strategy, and what they will tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, Literal

import numpy as np

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.estimation.alignment import rigid_motions
from truearm.identification.planning.candidates import (
    Candidates,
    bar_places,
    seat_poses,
    supports_technician_poses,
    tracker_poses,
    volume_poses,
)
from truearm.identification.planning.exchange import DesignProblem, project_out, select_candidates
from truearm.identification.planning.information import design_problem, tip_jacobian
from truearm.identification.planning.observability import Observability, observability
from truearm.identification.planning.prior import Prior
from truearm.identification.planning.sampling.poses import checked_count, checked_seed
from truearm.identification.planning.sampling.workspace import Sector
from truearm.typing import FloatArray, IntArray

Progress = Callable[[int, str], None]
Strategy = Literal["i-optimal", "d-optimal", "technician", "random"]

STRATEGIES: tuple[Strategy, ...] = ("i-optimal", "d-optimal", "technician", "random")
"""Least uncertainty in the volume; least confidence ellipsoid; poses as of a person who measures; poses drawn."""

LENGTH_U_MM = 0.005
"""Standard uncertainty of a bar's length that a plan reckons with [mm]."""

VOLUME_POSES = 200
# Poses to choose from, for each wanted: of a tracker's half are a technician's.
_PER_POSE, _FEWEST = 8, 300
_PER_POSE_IN_SEAT, _MOST_SPARE = 4, 60
# Places to choose from, for each wanted.
_PER_PLACE = 3
# Share of a column's length, and of the longest over their priors, below which what is left of a column is rounding.
_GONE = 1e-9
# Numbers of poses at which the course of the uncertainty is calculated.
_COURSE = 24


@dataclass(frozen=True)
class Artefact:
    """What readings are taken with.

    Parameters
    ----------
    kind : {"tracker", "seat", "bar"}
    places : int
        How many seats there are, or how many places the bar is put to.
    length_mm : float, optional
        Between the two seats of a bar.

    Raises
    ------
    InputError
        If a bar has no length, or something else has one.
    """

    kind: Literal["tracker", "seat", "bar"]
    places: int = 0
    length_mm: float | None = None

    def __post_init__(self) -> None:
        if self.kind == "bar" and self.length_mm is None:
            raise InputError("a bar has a length between its seats, in mm; none is given", hint="--length 500")
        if self.kind != "bar" and self.length_mm is not None:
            raise InputError(f"a length is for the artefact bar, not for {self.kind}", hint="--artefact bar")
        if self.kind == "tracker" and self.places:
            raise InputError("a number of seats is for the artefacts seat and bar, not for tracker")
        if self.kind != "tracker":
            checked_count(self.places, "places")

    @property
    def seats(self) -> int:
        """How many seats all places have."""
        return self.places * (2 if self.kind == "bar" else 1)


@dataclass(frozen=True, eq=False)
class Proposal:
    """Poses by one strategy.

    Attributes
    ----------
    poses : Candidates
        Each a candidate, in the order to take them: under a tracker the most useful first, with an artefact place after
        place and seat after seat.
    counts : (m,) int array
        Numbers of poses, from 0 to all.
    rms_mm : (m,) array
        Uncertainty of a point in the volume after so many, three-dimensional root mean square; with seats, apart from
        the scale, which they do not tell.
    observability : Observability
        Of the terms by these poses alone, each in units of how surely it was known before.
    """

    poses: Candidates
    counts: IntArray
    rms_mm: FloatArray
    observability: Observability

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as plain data."""
        return {
            "after_mm": float(self.rms_mm[-1]),
            "course": {"n": self.counts.tolist(), "rms_mm": self.rms_mm.tolist()},
            **{f"o{i}": getattr(self.observability, f"o{i}") for i in range(1, 6)},
            "rank": self.observability.rank,
            "n_parameters": self.observability.n_parameters,
        }


@dataclass(frozen=True, eq=False)
class CalibrationPlan:
    """What can be done, and what it will bring.

    Attributes
    ----------
    arm : Arm
    prior : Prior
        Before.
    artefact : Artefact
    volume : (n, n_joints) array
        Poses as the arm is to be used.
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
    seed: int = 0,
    progress: Progress | None = None,
) -> CalibrationPlan:
    """Propose the next poses by every strategy.

    With a seat or a bar, the places are chosen first, each with the poses in it that differ most; then the poses in the
    places chosen. Poses drawn and a technician's are in places drawn.

    Parameters
    ----------
    arm : Arm
        Base z up.
    prior : Prior
        What is known of it before.
    artefact : Artefact
    n : int
        Number of poses; two and more for each seat.
    volume : Sector, optional
        Where the arm is to be used, that of `Sector()` by default. There too are a technician's poses under a tracker;
        other poses may be anywhere in the sector that the arm works in.
    seed : int
        Of all that is drawn.
    progress : callable, optional
        Told the strategies done, and how it stands.

    Returns
    -------
    CalibrationPlan
        Without a technician's poses for an arm that cannot choose where its stylus points.

    Raises
    ------
    InputError
        If there are too few poses for the seats, or the arm does not reach enough places or poses.
    """
    checked_seed(seed)
    if checked_count(n) < 2 * artefact.seats:
        raise InputError(
            f"expected two poses or more for each of {artefact.seats} seats, got {n} in all",
            hint=f"--poses {2 * artefact.seats}, or fewer seats",
        )
    volume = volume or Sector()
    told = progress or _silent
    told(0, "poses in the volume")
    there = volume_poses(arm, VOLUME_POSES, seed=seed + 1, sector=volume)
    told(0, "poses to choose from")
    chooser = _Chooser(arm, prior, artefact, n, there, seed)
    pool = chooser.pool(volume)
    proposals: dict[Strategy, Proposal] = {}
    for number, strategy in enumerate(STRATEGIES):
        if strategy == "technician" and not supports_technician_poses(arm):
            continue

        def tell(what: str, done: int, total: int, number: int = number, strategy: Strategy = strategy) -> None:
            told(number, f"{strategy}: {what} {done} of {total}")

        told(number, strategy)
        proposals[strategy] = chooser.proposal(chooser.chosen(pool, strategy, tell))
    return CalibrationPlan(arm, prior, artefact, there, proposals)


@dataclass(frozen=True, eq=False)
class _Chooser:
    """Everything a choice depends on but the strategy."""

    arm: Arm
    prior: Prior
    artefact: Artefact
    n: int
    volume: FloatArray
    seed: int

    @property
    def per_seat(self) -> int:
        return ceil(self.n / self.artefact.seats)

    def pool(self, volume: Sector) -> Candidates:
        """Poses to choose from, in more places than are wanted."""
        if self.artefact.kind == "tracker":
            found = tracker_poses(self.arm, max(_PER_POSE * self.n, _FEWEST), seed=self.seed)
            assert found.technician is not None  # tracker_poses says so
            if volume != Sector() and found.technician.any():  # a technician measures there; others may be anywhere
                angles = found.angles.copy()
                n_there = int(found.technician.sum())
                angles[found.technician] = volume_poses(self.arm, n_there, seed=self.seed, sector=volume)
                found = replace(found, angles=angles)
            return found
        per_seat = min(_PER_POSE_IN_SEAT * self.per_seat, self.per_seat + _MOST_SPARE)
        return self._in_places(_PER_PLACE * self.artefact.places, per_seat, technician=False)

    def chosen(self, pool: Candidates, strategy: Strategy, tell: Callable[[str, int, int], None]) -> Candidates:
        """Poses by a strategy, in the order to take them."""
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

    def proposal(self, poses: Candidates) -> Proposal:
        """What poses will tell, in their order."""
        problem = self._problem(poses)
        counts = np.unique(np.concatenate([[0], np.geomspace(1, self.n, _COURSE).round()])).astype(np.intp)
        rms = np.sqrt([problem.variance(range(count)) for count in counts])
        J = information_rows(self.prior, poses)
        std = np.sqrt(self.prior.covariance.diagonal())
        return Proposal(poses, counts, rms, observability(J * std, n_poses=self.n))

    def _places(self, pool: Candidates, strategy: Strategy, tell: Callable[[str, int, int], None]) -> list[int]:
        """Places of the artefact, the most useful first; in each the poses that differ most stand for all."""
        assert pool.seat is not None  # poses in seats
        _, first = np.unique(pool.seat, return_index=True)
        rows = np.concatenate([np.arange(start, start + self.per_seat) for start in np.sort(first)])
        by_place = pool.split_into_poses(rows).group_by_place()
        return [int(place) for place in self._choose(by_place, self.artefact.places, strategy, tell)]

    def _choose(
        self, candidates: Candidates, n: int, strategy: Strategy, tell: Callable[[str, int, int], None]
    ) -> IntArray:
        optimal = strategy.endswith("optimal")
        if not optimal:
            return np.random.default_rng(self.seed).permutation(len(candidates))[:n]
        name = {"i-optimal": "I-optimal", "d-optimal": "D-optimal"}[strategy]
        return select_candidates(self._problem(candidates), n, strategy=name, progress=tell).rows

    def _problem(self, candidates: Candidates) -> DesignProblem:
        prior = self.prior.with_frame() if self.artefact.kind == "tracker" else self.prior
        return design_problem(
            prior.perturbed_chain,
            candidates,
            prior.state(candidates.angles),
            prior.state(self.volume),
            prior_precision=prior.precision,
            noise_mm=prior.noise_mm,
            length_u_mm=LENGTH_U_MM,
            scale=self.artefact.kind == "seat",
        )

    def _in_places(self, places: int, per_seat: int, *, technician: bool) -> Candidates:
        options = {"poses": per_seat, "seed": self.seed, "technician": technician}
        if self.artefact.length_mm is not None:
            return bar_places(self.arm, places, length_mm=self.artefact.length_mm, **options)  # type: ignore[arg-type]
        return seat_poses(self.arm, seats=places, **options)  # type: ignore[arg-type]


def information_rows(prior: Prior, poses: Candidates) -> FloatArray:
    """What poses tell of the terms alone, as rows (m, p) over their noise.

    The frame of a tracker and the places of seats are eliminated: they are found from the same readings.
    """
    state = prior.state(poses.angles)
    tips, jacobian = tip_jacobian(prior.perturbed_chain, state)
    J = jacobian.reshape(3 * len(state), -1) / prior.noise_mm
    if poses.seat is None:
        rows = project_out(J, rigid_motions(tips))
    else:  # as by `design_problem`, with a target that plays no part
        problem = design_problem(
            prior.perturbed_chain,
            poses.group_by_place(),
            state,
            state,
            prior_precision=prior.precision,
            noise_mm=prior.noise_mm,
            length_u_mm=LENGTH_U_MM,
        )
        rows = problem.factors.reshape(-1, problem.factors.shape[2])
        if poses.length_mm is not None:  # the bar's length is found too, and known before
            certificate = np.zeros((1, rows.shape[1]))
            certificate[0, -1] = 1 / LENGTH_U_MM
            rows = np.concatenate([rows, certificate])
        rows = project_out(rows[:, : J.shape[1]], rows[:, J.shape[1] :])
    if not len(rows):  # too few poses to tell anything
        return np.zeros((1, J.shape[1]))
    # What moves all points alike, or none, is gone but for rounding, which must not look like something told.
    size = np.linalg.norm(rows, axis=0)
    told = size * np.sqrt(prior.covariance.diagonal())
    gone = (size < _GONE * np.linalg.norm(J, axis=0)) | (told < _GONE * told.max())
    return np.where(gone, 0.0, rows)


def _shared_out(poses: Candidates, n: int) -> IntArray:
    """Rows of n poses, as evenly as can be among the seats, place after place."""
    assert poses.seat is not None  # poses in seats
    _, seat = np.unique(poses.seat, return_inverse=True)
    turn = np.array([(seat[:row] == seat[row]).sum() for row in range(len(seat))])
    return np.sort(np.argsort(turn, kind="stable")[:n])


def _silent(done: int, note: str) -> None:
    """Tell nobody."""
