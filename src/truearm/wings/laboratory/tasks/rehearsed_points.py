"""The points of a test, taken by a virtual arm: joint angles as a person would record them with a real one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere
from truearm.wings.laboratory.standards.artefacts import Artefacts
from truearm.wings.laboratory.standards.layout import Placement
from truearm.wings.laboratory.standards.points_form import ON_SURFACES, PlannedPoints
from truearm.wings.laboratory.tasks.posed_test import pose
from truearm.wings.laboratory.tasks.simulated_verification import true_points
from truearm.wings.planning.virtual import Measurement, VirtualArm

# First word of the stream, different from those of other draws.
_ARTEFACTS = 6


def rehearse_points(
    virtual: VirtualArm, planned: Sequence[PlannedPoints], artefacts: Artefacts, *, seed: int
) -> Measurement:
    """Measure the planned points of a test with a virtual arm.

    The artefacts deviate within their certificates and are at 20 degC. The centre of the stylus tip is half its
    diameter away from a touched surface.

    Parameters
    ----------
    virtual : VirtualArm
    planned : sequence of PlannedPoints
        Of the whole file.
    artefacts : Artefacts
        Certificates of the artefacts.
    seed : int
        Of poses, artefacts and noise.

    Returns
    -------
    Measurement
        One reading for each point, in the order of the file, without reference points.

    Raises
    ------
    InputError
        If an artefact has no certificate, or the arm does not reach all points.
    """
    layout = [_placement(one, artefacts) for one in planned]
    posed = pose(layout, virtual.nominal, seed=seed)
    true = true_points(layout, artefacts, np.random.default_rng([_ARTEFACTS, seed]))
    tips = np.concatenate(
        [
            points + (one.tip_mm / 2 if one.test in ON_SURFACES else 0.0) * placed.normals
            for points, one, placed in zip(true, planned, layout, strict=True)
        ]
    )
    order = np.argsort(np.concatenate([one.rows for one in planned]), kind="stable")
    return virtual.measure(posed.angles[order], seed=seed, seat_points=tips[order], reference=False)


def _placement(one: PlannedPoints, artefacts: Artefacts) -> Placement:
    """The group as a layout has it: with the centre of its ball and the normals of the surface."""
    known = {a.name: a for a in artefacts.all}
    if one.artefact not in known:
        raise InputError(
            f"the file of artefacts has no {one.artefact!r}", hint=f"one of {', '.join(known)}, or --artefacts FILE"
        )
    at, normals = _centre(one)
    return Placement(one.test, one.artefact, one.keys, one.points, normals, at, one.approach)


def _centre(one: PlannedPoints) -> tuple[FloatArray, FloatArray]:
    """Centre of a ball and normals of its surface; of a seat or face the point and the direction to the stylus."""
    if len(one.points) < 5 or np.ptp(one.points, axis=0).max() == 0:
        return one.points.mean(axis=0), one.approach
    centre = fit_sphere(one.points, std_mm=1.0).centre
    away = one.points - centre
    return centre, away / np.linalg.norm(away, axis=1, keepdims=True)
