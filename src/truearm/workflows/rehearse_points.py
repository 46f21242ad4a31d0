"""`rehearse_points`: take the points of a verification with a virtual arm."""

from __future__ import annotations

from pathlib import Path

from truearm.identification.virtual import VirtualArm, load_preset
from truearm.solve.threads import one_blas_thread
from truearm.verification.standards.points_form import read_planned_points
from truearm.verification.tasks.rehearsed_points import rehearse_points as measure_points
from truearm.workflows.inputs import ArmLike, to_arm
from truearm.workflows.simulate import SimulationResult
from truearm.workflows.verify import ArtefactsLike, to_artefacts


@one_blas_thread()
def rehearse_points(
    arm: ArmLike,
    points: str | Path,
    artefacts: ArtefactsLike,
    *,
    preset: str = "research",
    seed: int = 0,
    arm_seed: int = 0,
) -> SimulationResult:
    """Take the points of a verification with a virtual arm: joint angles, as a person records them with a real one.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm: an `Arm`, a name of `list_arms`, or an arm file or URDF.
    points : path
        Points to measure, written by `operator_sheet`.
    artefacts : Artefacts or path
        Certificates of the artefacts; the virtual ones deviate within their uncertainty and are at 20 degC.
    preset : {"research", "shop", "worn", "perfect"}
        How large the errors of the arm are.
    seed : int
        Of poses, artefacts and noise.
    arm_seed : int
        Of the arm's errors.

    Returns
    -------
    SimulationResult
        A reading for each point, in the order of the file.

    Raises
    ------
    InputError
        If the file has no planned points, an artefact has no certificate, or the arm does not reach all points.

    Examples
    --------
    >>> import truearm as ta
    >>> plan = ta.load_verification_plan("asme-b89.4.22")
    >>> on_a_sphere = plan.model_copy(update={"single_point": None, "volumetric": None})
    >>> sheet = ta.operator_sheet(on_a_sphere)
    >>> sheet.save_points("points.csv")
    >>> len(ta.rehearse_points("measuring7", "points.csv", sheet.sheet.artefacts, preset="shop").session)
    27
    """
    nominal = to_arm(arm)
    planned = read_planned_points(points)
    virtual = VirtualArm.draw(nominal, load_preset(preset), seed=arm_seed)
    measured = measure_points(virtual, planned, to_artefacts(artefacts), seed=seed)
    return SimulationResult(
        virtual=virtual,
        measurement=measured,
        lengths=None,
        strategy=f"points of {Path(points).name}",
        seed=seed,
        rejected={},
        nominal_error=virtual.nominal_error(measured),
        noise_floor=None,
    )
