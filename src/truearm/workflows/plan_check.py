"""`plan_check`: the routine of an interim check, the same every time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

from truearm.arm import Arm
from truearm.compensation.models import Compensator
from truearm.identification.planning.check_routine import CheckRoutine, check_routine
from truearm.identification.planning.tour import mean_joint_move
from truearm.solve.threads import one_blas_thread
from truearm.workflows.plan import arm_or_model, to_surroundings
from truearm.workflows.record import Record


@dataclass(frozen=True, eq=False, repr=False)
class CheckPlan(Record):
    """The poses of an interim check.

    Attributes
    ----------
    routine : CheckRoutine
    """

    routine: CheckRoutine

    def save(self, path: str | Path) -> tuple[Path, ...]:
        """Write the session to fill in and, with a bar, the file of its length beside it; see `CheckRoutine.save`."""
        return self.routine.save(path)

    @property
    def artefacts(self) -> tuple[str, ...]:
        """Seats and sphere, in the order of the routine."""
        names = [*self.routine.seat.tolist(), *self.routine.sphere.tolist()]
        return tuple(dict.fromkeys(name for name in names if name))

    def blocks(self) -> Iterator[str]:
        """See `Record`."""
        yield f"Interim check of {len(self.routine.angles)} readings: {', '.join(self.artefacts)}."
        move = degrees(mean_joint_move(self.routine.arm, self.routine.angles))
        yield f"From pose to pose the joint that turns most turns by {move:.0f} deg on average."

    def to_dict(self) -> dict[str, Any]:
        """See `Record`."""
        return {
            "arm": self.routine.arm.name,
            "n": len(self.routine.angles),
            "artefacts": list(self.artefacts),
            "mean_joint_move_deg": degrees(mean_joint_move(self.routine.arm, self.routine.angles)),
        }


@one_blas_thread()
def plan_check(
    arm: Arm | Compensator | str | Path,
    *,
    length_mm: float | None = None,
    sphere_mm: float | None = None,
    table: Sequence[float] | None = None,
    avoid: Sequence[Sequence[float]] = (),
    seed: int = 0,
) -> CheckPlan:
    """Plan an interim check: ten poses in a cone, four in each seat of a bar, nine points on a sphere.

    Parameters
    ----------
    arm : Arm, model, str or path
        Name, arm file or URDF of an arm, or its model (file).
    length_mm : float, optional
        Length of a bar between its seats [mm]; without it the check has no bar.
    sphere_mm : float, optional
        Diameter of a sphere [mm]; without it the check has no sphere.
    table, avoid
        As of `plan`.
    seed : int
        Seed of all random numbers.

    Returns
    -------
    CheckPlan

    Raises
    ------
    InputError
        If the arm does not reach an artefact.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.plan_check("measuring7", length_mm=400).artefacts
    ('cone', 'bar A', 'bar B')
    """
    subject, _ = arm_or_model(arm)
    nominal = subject if isinstance(subject, Arm) else subject.arm_
    around = to_surroundings(table, avoid)
    return CheckPlan(check_routine(nominal, length_mm=length_mm, sphere_mm=sphere_mm, surroundings=around, seed=seed))
