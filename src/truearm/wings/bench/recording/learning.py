"""Learning while measuring: how well the arm is known after each reading, and which pose would add most."""

from __future__ import annotations

from collections.abc import Iterator
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
from truearm.typing import FloatArray, NameArray
from truearm.wings.bench.recording.recording_event import Event
from truearm.wings.planning.designs.candidates import seat_poses, tracker_poses, volume_poses
from truearm.wings.planning.designs.exchange import DesignProblem, DOptimality, IOptimality, decreases, greedy
from truearm.wings.planning.designs.factors import moment_matrix
from truearm.wings.planning.designs.information import tip_jacobian
from truearm.wings.planning.designs.plan import NOISE_MM
from truearm.wings.planning.designs.prior import identified_prior, nominal_prior
from truearm.wings.planning.designs.proposal import VOLUME_POSES
from truearm.wings.planning.designs.sequential_update import Estimate, held_readings, updated_estimate

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
                without_unshown_signs(self._model.fit_)[0],
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
        self._n_seen, self._trained_on, self._doubted = 0, 0, list[int]()

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
        readings = session.rows(learned)
        if (held_readings(readings)[1] | readings.has_point).any():
            n_in_prior = int((learned < self._trained_on).sum())
            self.estimate = updated_estimate(
                self._prior, readings, self._state(readings), self.estimate, n_in_prior=n_in_prior
            )
            self._doubted = [row for row in self._doubted if self._misfits(session, row)]  # others are learned next
        else:
            self.estimate = self._before
        after_mm = self.uncertainty_mm
        if not isclose(after_mm, before_mm, rel_tol=UNCHANGED):
            yield learned_event(before_mm, after_mm)

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
