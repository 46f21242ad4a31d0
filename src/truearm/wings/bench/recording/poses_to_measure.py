"""Which pose comes next: the plan's in its order, or the one that adds most to what is known of the arm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from truearm.arm import Arm
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.bench.recording.learning import UNCHANGED, Learning
from truearm.wings.bench.recording.recording_event import Event
from truearm.wings.planning.designs.planned_readings import PlannedReadings
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
