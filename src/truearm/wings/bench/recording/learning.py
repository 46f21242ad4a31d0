"""Learning while measuring: how well the arm is known after each reading, and which pose comes next.

That is the plan's in its order, or the one that adds most to what is known of the arm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from math import isclose, sqrt

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.judgement.joint_signs import without_unshown_signs
from truearm.identification.terms import ArmState
from truearm.models import Compensator
from truearm.models.identified_model import to_identified
from truearm.readings import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.bench.recording.session_log import Event
from truearm.wings.planning.designs.candidates import seat_poses, tracker_poses, volume_poses
from truearm.wings.planning.designs.exchange import (
    DesignProblem,
    DOptimality,
    IOptimality,
    decreases,
    greedy,
    moment_matrix,
)
from truearm.wings.planning.designs.information import tip_jacobian
from truearm.wings.planning.designs.plan import NOISE_MM
from truearm.wings.planning.designs.planned_readings import PlannedReadings
from truearm.wings.planning.designs.prior import held_readings, identified_prior, nominal_prior
from truearm.wings.planning.designs.proposal import VOLUME_POSES
from truearm.wings.planning.designs.sequential_update import Estimate, updated_estimate, with_reading
from truearm.wings.planning.designs.tour import joint_moves

NEARLY_BEST = 0.8  # share of the largest gain; of the poses that gain as much the nearest comes next


class PosesToMeasure:
    """The poses that are left, and the next of them.

    Parameters
    ----------
    arm : Arm, optional
        Needed with a plan and for ranking.
    plan : PlannedReadings, optional
    is_ranked : bool
        Whether the next is the pose that adds most: of those left in the seat whose turn it is, or without a plan of
        the candidates of `Learning`.

    Attributes
    ----------
    would_give_mm : float, optional
        The uncertainty with a reading at the next pose; None where it would add nothing, or this is not known.
    """

    def __init__(self, arm: Arm | None, plan: PlannedReadings | None, *, is_ranked: bool) -> None:
        self._arm, self.plan, self._is_ranked = arm, plan, is_ranked
        self._done, self._skipped = set[str](), set[int]()
        self._angles: FloatArray | None = None if plan is None else plan.angles
        self._seat: NameArray | None = None if plan is None else plan.seat
        self._next: int | None = None
        self.would_give_mm: float | None = None

    @property
    def number(self) -> int | None:
        """Number of the plan's next pose, counted from 1; None without a plan or after its last."""
        return self._next if self.plan is not None else None

    @property
    def seat(self) -> str:
        """The plan's seat of the next pose; empty if there is none."""
        seat = None if self.plan is None else self.plan.seat
        return "" if seat is None or self.number is None else str(seat[self.number - 1])

    @property
    def aim_rad(self) -> FloatArray | None:
        """(n_joints,) angles of the next pose [rad, or mm]."""
        return None if self._angles is None or self._next is None else self._angles[self._next - 1]

    def skip(self) -> bool:
        """Do not come back to the next pose; whether there was one."""
        if self._next is None:
            return False
        self._skipped.add(self._next)
        return True

    def choose(self, done: set[str], learning: Learning | None, seat: str, now_rad: FloatArray) -> Iterator[Event]:
        """Choose the next pose.

        Parameters
        ----------
        done : set of str
            Numbers of the plan's poses that have a reading.
        learning : Learning, optional
        seat : str
            Of the next reading, where a person named it.
        now_rad : (n_joints,) array
            Where the arm is [rad, or mm].

        Yields
        ------
        Event
            ``enough``, once.
        """
        self._done = done
        if self.plan is None and self._is_ranked and learning is not None:
            self._angles, self._seat = learning.candidates(seat)
        left = self._left()
        self._next, self.would_give_mm = next(iter(left), None), None
        if learning is None or self._angles is None or self._next is None:
            return
        rows = np.array(left) - 1
        yield from learning.enough(self._angles[rows], None if self._seat is None else self._seat[rows])
        rows = self._in_turn(rows) if self._is_ranked else rows[:1]
        after_mm = learning.after_mm(self._angles[rows], None if self._seat is None else self._seat[rows])
        gains_mm = learning.uncertainty_mm - after_mm
        least_mm, best = UNCHANGED * learning.uncertainty_mm, 0
        if self._is_ranked and self._arm is not None and gains_mm.max() > least_mm:
            far = np.where(gains_mm >= NEARLY_BEST * gains_mm.max(), 0.0, np.inf)
            best = int(np.argmin(far + joint_moves(self._arm, now_rad, self._angles[rows])))
        self._next = int(rows[best]) + 1
        self.would_give_mm = float(after_mm[best]) if gains_mm[best] > least_mm else None

    def event(self, aims: Sequence[float] | None, units: Sequence[str]) -> Event:
        """The event ``next``.

        Parameters
        ----------
        aims : sequence of n_joints floats, optional
            The next pose in the units in which people read its joints; None where there is none.
        units : sequence of n_joints str
        """
        if aims is None:
            text = "the plan is done" if self.plan is not None else "next: any pose, in a seat or with a point"
            return Event("next", text, {"pose": None, "remaining": 0})
        own = [f" {unit}" if len(set(units)) > 1 else "" for unit in units]
        angles = ", ".join(
            f"J{joint} {aim:z.0f}{unit}" for joint, (aim, unit) in enumerate(zip(aims, own, strict=True), 1)
        )
        parts = [angles if own[0] else f"{angles} {units[0]}"]
        values: dict[str, object] = {"pose": self.number, "aim": aims}
        if self.plan is not None and self.number is not None:
            note = "" if self.plan.note is None else str(self.plan.note[self.number - 1])
            n_left = len(self._left())
            parts = [f"pose {self.number} of {len(self.plan)}{note and f', {note}'}", *parts, f"{n_left} to go"]
            values |= {"remaining": n_left, "instruction": note}
        if (mm := self.would_give_mm) is not None:
            parts.append(f"would leave an uncertainty of {mm:.3f} mm")
            values["would_give_mm"] = mm
        return Event("next", f"next: {'; '.join(parts)}", values)

    def _left(self) -> list[int]:
        n = 0 if self._angles is None else len(self._angles)
        return [k for k in range(1, n + 1) if str(k) not in self._done and k not in self._skipped]

    def _in_turn(self, rows: IntArray) -> IntArray:
        """The poses in the seat of the first, which a person finishes before the next."""
        return rows if self._seat is None else rows[self._seat[rows] == self._seat[rows[0]]]


# Square of a residual over its covariance, of three degrees of freedom: one right reading in 65,000 has more.
LARGEST_MISFIT = 25.0
FEWEST_TO_JUDGE = 4  # readings, before which none is said not to fit, and none to be enough
LATEST, AT_FAULT = 5, 3  # of so many of the latest readings that do not fit, what is known of the arm is at fault
AHEAD, LITTLE = 12, 0.05  # so many further readings that gain a smaller share are not worth it
UNCHANGED = 1e-4  # of the uncertainty, as after the first reading in a seat
CANDIDATES = 200  # poses of which the next is suggested where there is no plan
IN_A_SEAT = 40


def learned_event(before_mm: float, after_mm: float) -> Event:
    """The event that the uncertainty of a point in the volume was, and is now [mm]."""
    text = f"uncertainty of a point in the volume {before_mm:.3f} -> {after_mm:.3f} mm"
    return Event("learned", text, {"before_mm": before_mm, "after_mm": after_mm})


class Learning:
    """The estimate of an arm while a session grows.

    Parameters
    ----------
    arm : Arm
        With known kinematics.
    model : Compensator, optional
        What is known of it before; the priors of its terms by default.
    trained_on : int
        Number of readings of the session, from its first, that the model knows already.
    has_points : bool
        Whether the tip is measured; otherwise it is in seats.

    Attributes
    ----------
    arm : Arm
    estimate : Estimate

    Raises
    ------
    InputError
        If the arm takes too few of the poses at which its later use is judged.
    """

    @one_blas_thread()
    def __init__(
        self, arm: Arm, model: Compensator | None = None, *, trained_on: int = 0, has_points: bool = True
    ) -> None:
        found = None if model is None else to_identified(model)
        self.arm = arm
        self._model = None if found is None or found.kind == "nominal" else found
        if self._model is None:
            self._arm, self._prior = arm, nominal_prior(arm, noise_mm=NOISE_MM)
        else:
            self._arm, self._prior = identified_prior(
                self._model.arm_,
                without_unshown_signs(self._model.fit_),
                noise_mm=self._model.residual_std_,
                state=lambda angles: self._state(Session(angles)),
            )
        self._before = Estimate.before_readings(self._prior.with_frame() if has_points else self._prior)
        self.forget()
        self._trained_on = 0 if self._model is None else trained_on
        self._said_enough, self._has_points = False, has_points
        self._in_seats: dict[str, FloatArray] = {}
        # As of a plan: the errors at poses of the later use of the arm, whose coordinates are compared.
        poses = volume_poses(self._arm, VOLUME_POSES, seed=1)
        tips, jacobian = tip_jacobian(self._prior.perturbed_chain, self._prior.state(poses))
        self._target = moment_matrix(jacobian, tips, scale=not has_points)

    def _state(self, readings: Session) -> ArmState:
        return ArmState.of(self._arm, readings.angles) if self._model is None else self._model.state(readings)

    @property
    def uncertainty_mm(self) -> float:
        """Of a point in the volume, three-dimensional root mean square; with seats alone, apart from the scale."""
        return sqrt(self.estimate.variance(self._target))

    def forget(self) -> None:
        """Know what was known before the readings."""
        self.estimate = self._before
        self._n_seen, self._trained_on, self._doubted, self._learned = 0, 0, list[int](), np.arange(0)

    def learn(self, session: Session) -> Iterator[Event]:
        """Take in a session that has grown by a reading, or lost its last.

        Yields
        ------
        Event
            ``learned``, with the uncertainty before and after; a notice of a reading that does not fit, which is not
            learned.
        """
        is_longer, self._n_seen = len(session) == self._n_seen + 1, len(session)
        self._doubted = [row for row in self._doubted if row < len(session)]
        self._trained_on = min(self._trained_on, len(session))  # what comes in place of one that was undone is new
        before_mm = self.uncertainty_mm
        if is_longer and (doubt := self._doubt(session, len(session) - 1)):
            yield Event("notice", f"reading {len(session)} does not fit: {doubt}")
            if self._doubted:
                return
        learned = np.setdiff1d(np.arange(len(session)), self._doubted)
        if (estimate := self._with_last(session, learned)) is None:
            estimate, readings = self._before, session.rows(learned)
            if (held_readings(readings)[1] | readings.has_point).any():
                n_in_prior = int((learned < self._trained_on).sum())
                estimate = updated_estimate(
                    self._prior, readings, self._state(readings), self.estimate, n_in_prior=n_in_prior
                )
        self.estimate, self._learned = estimate, learned
        self._doubted = [row for row in self._doubted if self._misfits(session, row)]  # others are learned next
        after_mm = self.uncertainty_mm
        if not isclose(after_mm, before_mm, rel_tol=UNCHANGED):
            yield learned_event(before_mm, after_mm)

    def _with_last(self, session: Session, learned: IntArray) -> Estimate | None:
        """The estimate with the last reading alone; None where all must be learned together."""
        if not np.array_equal(self._learned, learned[:-1]) or len(session) <= self._trained_on:
            return None
        reading = session.rows([len(session) - 1])
        return with_reading(self._prior, reading, self._state(reading), self.estimate)

    def _doubt(self, session: Session, row: int) -> str:
        """Why a reading is not learned; empty if it is."""
        if row - len(self._doubted) < FEWEST_TO_JUDGE:
            return ""
        if not (text := self._misfits(session, row)):
            return ""
        self._doubted.append(row)
        if sum(one > row - LATEST for one in self._doubted) < AT_FAULT:
            return f"{text}; it is in the file, and not learned"
        self._doubted.clear()
        return f"{text}; {AT_FAULT} of the last {LATEST} do not, so that all are learned"

    def _misfits(self, session: Session, row: int) -> str:
        """How far a reading is from where the others have it, if that is too far."""
        reading = session.rows([row])
        for residual, covariance in zip(*self.estimate.residuals(reading, self._state(reading)), strict=True):
            if residual @ np.linalg.solve(covariance, residual) > LARGEST_MISFIT:
                distance_mm, u_mm = np.linalg.norm(residual), sqrt(np.trace(covariance))
                return (
                    f"{distance_mm:.3f} mm from where the others have it, with a standard uncertainty of {u_mm:.3f} mm"
                )
        return ""

    def after_mm(self, angles: FloatArray, seat: NameArray | None) -> FloatArray:
        """(n,) the uncertainty with a reading at each of n poses, in its seat or with a point [mm]."""
        problem = self._design(angles, seat)
        return np.sqrt(np.maximum(self.estimate.variance(self._target) - decreases(problem), 0.0))

    def _design(self, angles: FloatArray, seat: NameArray | None) -> DesignProblem:
        in_seats = np.full(len(angles), "") if seat is None else seat
        return self.estimate.design(self._prior.state(angles), None if self._has_points else in_seats, self._target)

    def candidates(self, seat: str) -> tuple[FloatArray | None, NameArray | None]:
        """Poses that the arm reaches, (n, n_joints), and their seat: of one that no reading was in, none are known."""
        if self._has_points:
            return self._anywhere, None
        if seat not in self._in_seats and (point := self.estimate.seat_points.get(seat)) is not None:
            with suppress(InputError):
                self._in_seats[seat] = seat_poses(self._arm, seats=point[None], poses=IN_A_SEAT, seed=1).angles
        poses = self._in_seats.get(seat)
        return poses, None if poses is None else np.full(len(poses), seat)

    @cached_property
    def _anywhere(self) -> FloatArray | None:
        with suppress(InputError):
            return tracker_poses(self._arm, CANDIDATES, seed=1).angles
        return None

    def enough(self, angles: FloatArray, seat: NameArray | None) -> Iterator[Event]:
        """Say once that the best `AHEAD` of n poses would gain little; of fewer it would be no wonder."""
        if self._said_enough or len(angles) < AHEAD or self._n_seen < FEWEST_TO_JUDGE:
            return
        problem = self._design(angles, seat)
        # Some poses are useful only together, as the first two in a seat, which the determinant shows.
        chosen = [greedy(problem, AHEAD, criterion) for criterion in (IOptimality(), DOptimality())]
        gain = 1 - sqrt(min(map(problem.variance, chosen))) / self.uncertainty_mm
        if gain < LITTLE:
            self._said_enough = True
            where = f" in seat {seat[0]}" if seat is not None and seat[0] and (seat == seat[0]).all() else ""
            text = f"enough: {AHEAD} more readings{where} would gain {100 * gain:.0f} %"
            yield Event("enough", text, {"n": AHEAD, "gain": gain})
