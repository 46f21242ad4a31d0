"""`rehearse`: a plan, or the points of a verification, with a virtual arm before anyone touches a real one."""

from __future__ import annotations

from pathlib import Path

from truearm.errors import InputError
from truearm.identification.planning.planned_readings import read_planned
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.identification.virtual.rehearsal import carry_out, lengths_of, move_set_up
from truearm.solve.threads import one_blas_thread
from truearm.verification.standards.points_form import read_planned_points
from truearm.verification.tasks.rehearsed_points import rehearse_points
from truearm.workflows.inputs import ArmLike, to_arm
from truearm.workflows.simulate import SimulationResult
from truearm.workflows.verify import ArtefactsLike, to_artefacts


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
    artefacts: ArtefactsLike | None = None,
) -> SimulationResult:
    """Measure with a virtual arm what a plan of `plan` or the points of `operator_sheet` ask for.

    Seats, bar and sphere stand where the plan puts them, and the arm goes near the planned poses. What a person writes
    down at a real arm (angles, names of seats and places) is in the session. Of the points of a verification it has a
    reading for each point, in the order of the file.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm that the plan was made for: an `Arm`, a name of `list_arms`, or an arm file or URDF.
    plan : path
        File of the plan, of which columns that were filled in already are not read; or, with `artefacts`, the points to
        measure of a verification, written by `OperatorSheetResult.save_points`.
    preset : {"research", "shop", "worn", "perfect"}
        How large the errors of the arm are.
    seed : int
        Of the noise, and of poses and artefacts of a verification; another one for another day.
    arm_seed : int
        Of the arm's errors and of the errors of a plan's certificates.
    lengths : path, optional
        Known lengths between seats; by default the file that `plan` wrote beside the plan, if there is one.
    moved : bool
        Whether the reference instrument stands elsewhere, to rehearse a `refit`; a plan with a tracker only.
    artefacts : Artefacts or path, optional
        Of the points of a verification: certificates of the artefacts; the virtual ones deviate within their
        uncertainty and are at 20 degC.

    Returns
    -------
    SimulationResult

    Raises
    ------
    InputError
        If the plan is of another arm, the file of lengths is of another plan, a plan with a bar has none, an artefact
        has no certificate, or the arm does not reach all points.

    Examples
    --------
    >>> import truearm as ta
    >>> _ = ta.plan("gao2017", "tracker", poses=4, terms="constants").save("plan.csv")
    >>> rehearsal = ta.rehearse("gao2017", "plan.csv", preset="shop")
    >>> len(rehearsal.session)
    4
    >>> plan = ta.load_verification_plan("asme-b89.4.22")
    >>> on_a_sphere = plan.model_copy(update={"single_point": None, "volumetric": None})
    >>> sheet = ta.operator_sheet(on_a_sphere)
    >>> sheet.save_points("points.csv")
    >>> len(ta.rehearse("measuring7", "points.csv", artefacts=sheet.sheet.artefacts, preset="shop").session)
    27
    """
    nominal = to_arm(arm)
    virtual = VirtualArm.draw(nominal, load_preset(preset), seed=arm_seed)
    if artefacts is not None:
        if lengths is not None or moved:
            raise InputError("lengths and moved are for a plan of readings, not for the points of a verification")
        measured = rehearse_points(virtual, read_planned_points(plan), to_artefacts(artefacts), seed=seed)
        return SimulationResult.of(virtual, measured, strategy=f"points of {Path(plan).name}", seed=seed)
    planned = read_planned(plan, nominal)
    known = lengths_of(planned, lengths)
    measured = carry_out(virtual, planned, seed=seed, lengths=known)
    if moved:
        measured = move_set_up(measured, seed=seed)
    return SimulationResult.of(
        virtual, measured, lengths=known, strategy=f"plan {planned.file.name}", seed=seed, moved=moved
    )
