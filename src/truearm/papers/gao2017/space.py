"""The paper's arm in space, and the errors of the networks at the poses on which they were tested."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.arm import load_arm
from truearm.number_format import format_count
from truearm.pages.page import Section
from truearm.pages.plotting import Figure
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.papers.gao2017.results import METHODS, Predictions, Reproduction
from truearm.papers.gao2017.training import ARM
from truearm.show.arm_scene import arm_mechanism
from truearm.show.workspace_figures import error_in_workspace
from truearm.typing import FloatArray

IN_SPACE = "Where the networks err"


def tested_poses_section(results: Reproduction) -> Section | None:
    """The test poses in space: those of the final test, else those of Figure 4; None where neither was run."""
    figures = results.figures
    final = [one for one in (figures.figure_6, figures.figure_7) if one is not None]
    tested = final or [one for one in (figures.figure_4,) if one is not None]
    if not tested:
        return None
    what = "the final test on a virtual arm" if final else "the test of Table 2, row 1"
    poses = tested[0]
    distances = {name: np.linalg.norm(values, axis=1) for each in tested for name, values in each.deviations().items()}
    return Section(
        IN_SPACE,
        f"Error in space, predicted to true point, at {format_count(len(poses.points_mm), 'pose')} of {what}.",
        scenes=(_errors_scene(poses, distances),),
    )


def arm_scene(still: Figure) -> Scene:
    """The paper's arm alone, to be turned and moved.

    Parameters
    ----------
    still : Figure
        The paper's Figure 1.
    """
    arm = load_arm(ARM)
    return Scene(
        "The paper's arm in space: links, joint axes and tip", "mm", still, mechanism=arm_mechanism(arm, controls=True)
    )


def _errors_scene(poses: Predictions, distances: dict[str, FloatArray]) -> Scene:
    arm = load_arm(ARM)
    shown = next((name for name in reversed(METHODS) if name in distances), next(iter(distances)))
    points, errors = poses.points_mm, distances[shown]
    worst = int(np.argmax(errors))
    cloud = PointCloud(
        points,
        [f"pose {number}" for number in range(1, len(points) + 1)],
        [PointColumn(f"error, {name}", "mm", values) for name, values in distances.items()],
        [PointColumn(f"J{i}", "deg", column) for i, column in enumerate(poses.angles_deg.T, start=1)],
        noun="pose",
        shown=list(distances).index(shown),
        marked={worst: f"pose {worst + 1}"},
    )
    label = f"{format_count(len(points), 'pose')} in space, coloured by error; the arm goes to the one pointed at"
    still = error_in_workspace(points, errors, name=shown)
    caption = still.caption.partition(" Clusters of large errors")[0]
    return Scene(
        label,
        "mm",
        replace(still, caption=f"{caption} On a screen a ring marks the largest."),
        cloud=cloud,
        mechanism=arm_mechanism(arm, start=np.radians(poses.angles_deg[worst]), follows=[*range(arm.n_joints)]),
    )
