"""The points of a task in the volume, coloured by their uncertainty, and the arm that measures them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.arm_scene import arm_mechanism
from truearm.compensation.models.workspace_figures import error_in_workspace
from truearm.pages.number_format import format_count, format_mm
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.verification.tasks.task import TaskEstimates


def task_scene(task: TaskEstimates, arm: Arm) -> Scene:
    """The points of the feature with the standard uncertainty of each, and the arm in the first set of postures.

    Parameters
    ----------
    task : TaskEstimates
    arm : Arm
        The nominal arm.
    """
    points, n = task.feature.points, len(task.feature.points)
    u = np.linalg.norm(task.point_u_mm, axis=1)
    worst = int(np.argmax(u))
    slides, postures = arm.chain.is_prismatic, task.angles[0]
    joints = np.where(slides, postures, np.degrees(postures)).T
    units = ["mm" if one else "deg" for one in slides]
    cloud = PointCloud(
        points,
        [f"point {number}" for number in range(1, n + 1)],
        [PointColumn("standard uncertainty u of the point", "mm", u)],
        [PointColumn(f"J{i}", unit, column) for i, (unit, column) in enumerate(zip(units, joints, strict=True), 1)],
        [PointColumn(f"u of {axis}", "mm", column) for axis, column in zip("xyz", task.point_u_mm.T, strict=True)],
        marked={worst: f"u = {format_mm(float(u[worst]))}"},
    )
    what = f"{format_count(n, 'point')} of the {task.feature.name} in space, coloured by standard uncertainty"
    caption = (
        "Standard uncertainty of the place of each point: the root of the sum of the squares of its three coordinates, "
        "over all drawn arms. On a screen a ring marks the largest. Errors that points share cancel in a length "
        "or a form, so the uncertainty of the feature does not follow from these alone. The arm is shown in one of the "
        "sets of postures."
    )
    still = error_in_workspace(points, u)
    return Scene(
        f"{what}; the arm goes to the point that is pointed at",
        "mm",
        replace(still, caption=caption, alt=f"{what}, in four views. Largest: {format_mm(float(u[worst]))}."),
        cloud=cloud,
        mechanism=arm_mechanism(arm, start=postures[worst], follows=[*range(arm.n_joints)]),
        lines=[points] if n == 2 else [],  # a length between two points
    )
