"""`rehearse`: carry out a plan with a virtual arm before anyone touches a real one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from truearm.errors import InputError
from truearm.identification.planning.planned_readings import PlannedReadings, read_planned
from truearm.identification.planning.template import lengths_path
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.identification.virtual.rehearsal import carry_out, move_set_up
from truearm.readings import Lengths, read_lengths
from truearm.solve.threads import one_blas_thread
from truearm.workflows.inputs import ArmLike, to_arm
from truearm.workflows.simulate import SimulationResult


@one_blas_thread()
def rehearse(
    arm: ArmLike,
    plan: str | Path,
    *,
    preset: str = "research",
    seed: int = 0,
    arm_seed: int = 0,
    lengths: str | Path | None = None,
    moved: bool = False,
) -> SimulationResult:
    """Carry out a plan of `plan` with a virtual arm: the readings, and the lengths of the bar.

    Seats, bar and sphere stand where the plan puts them, and the arm goes near the planned poses. What a person writes
    down at a real arm (angles, names of seats and places) is in the session.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm that the plan was made for: an `Arm`, a name of `list_arms`, or an arm file or URDF.
    plan : path
        File of the plan. Columns that were filled in already are not read.
    preset : {"research", "shop", "worn", "perfect"}
        How large the errors of the arm are.
    seed : int
        Of the noise; another one for another day.
    arm_seed : int
        Of the arm's errors and of the errors of certificates.
    lengths : path, optional
        Known lengths between seats; by default the file that `plan` wrote beside the plan, if there is one.
    moved : bool
        Whether the reference instrument stands elsewhere, to rehearse a `refit`; a plan with a tracker only.

    Returns
    -------
    SimulationResult

    Raises
    ------
    InputError
        If the plan is of another arm, the file of lengths is of another plan, or a plan with a bar has none.

    Examples
    --------
    >>> import truearm as ta
    >>> _ = ta.plan("gao2017", "tracker", poses=4, terms="constants").save("plan.csv")
    >>> rehearsal = ta.rehearse("gao2017", "plan.csv", preset="shop")
    >>> len(rehearsal.session)
    4
    """
    nominal = to_arm(arm)
    planned = read_planned(plan, nominal)
    virtual = VirtualArm.draw(nominal, load_preset(preset), seed=arm_seed)
    known = _lengths_of(planned, lengths)
    measured = carry_out(virtual, planned, seed=seed, lengths=known)
    if moved:
        measured = move_set_up(measured, seed=seed)
    return SimulationResult(
        virtual=virtual,
        measurement=measured,
        lengths=known,
        strategy=f"plan {planned.file.name}",
        seed=seed,
        rejected={},
        nominal_error=virtual.nominal_error(measured),
        noise_floor=None if measured.readings.points is None or moved else virtual.noise_floor(measured),
    )


def _lengths_of(planned: PlannedReadings, given: str | Path | None) -> Lengths | None:
    """The lengths between the seats of a plan, as certificates of virtual artefacts that do not expand."""
    beside = lengths_path(planned.file)
    file = given if given is not None else beside if beside.is_file() else None
    if file is None:
        if planned.position is not None and (planned.position != "").any():
            raise InputError(
                f"{beside.name} is missing beside the plan: a bar without its length",
                file=planned.file,
                hint="copy it there; truearm plan wrote it with the plan",
            )
        return None
    if planned.seat is None:
        raise InputError("lengths are between seats, and the plan has none", file=file, hint="omit them")
    found = read_lengths(file, seats=[name for name in planned.seat.tolist() if name])
    none = np.zeros(len(found))
    return replace(found, expansion_per_K=none, u_expansion_per_K=none.copy(), file=None, numbers=None, by_line=False)
