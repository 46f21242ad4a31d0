"""The points of an interim check in space: the arm at its readings, coloured by deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truearm.models import Compensator
from truearm.number_format import format_count, show_mm
from truearm.pages.drawings.readings_scene import arm_at_readings, readings_scene
from truearm.pages.drawings.workspace_figures import error_in_workspace
from truearm.pages.page import Section
from truearm.readings import Lengths, Session
from truearm.typing import FloatArray
from truearm.wings.laboratory.monitor.interim_check import artefacts_of, interim_deviations


def check_section(model: Compensator, readings: Session, lengths: Lengths | None) -> Section | None:
    """The points of a check with how far each lies from its seat's mean, or from its sphere.

    Parameters
    ----------
    model : Compensator
    readings : Session
    lengths : Lengths or None
        Known lengths between the seats.

    Returns
    -------
    Section or None
        None where no seat has two readings, and there is no sphere.
    """
    points = model.predict_readings(readings)
    # Unexplained by the model: the other part of its uncertainty moves the points of a seat alike.
    _, unexplained = model.covariance_parts(readings)
    std_mm = np.sqrt(np.trace(unexplained, axis1=1, axis2=2) / 3)
    deviation = np.linalg.norm(interim_deviations(points, seat=readings.seat, sphere=readings.sphere), axis=1)
    rows = np.flatnonzero(np.isfinite(deviation))
    if not len(rows):
        return None
    artefacts = artefacts_of(readings.seat, readings.sphere, len(readings))
    worst = int(np.argmax(deviation[rows]))
    where = f"{readings.called(int(rows[worst]))}, {artefacts[rows[worst]]}"
    still = error_in_workspace(points[rows], deviation[rows])
    caption = (
        "Each point has the colour of its distance from the mean of its seat, or from the sphere through the points of "
        f"its sphere. On a screen a ring marks the largest, {show_mm(float(deviation[rows[worst]]))}: {where}."
    )
    mechanism = arm_at_readings({"": model}, readings)
    scene = readings_scene(
        points[rows],
        {"": deviation[rows]},
        readings.angles[rows],
        what="deviation",
        names=[f"{readings.called(row)}, {artefacts[row]}" for row in rows.tolist()],
        joint_names=model.arm.joint_names,
        sliding=model.arm.chain.is_prismatic.tolist(),
        still=replace(still, caption=caption, alt=f"{format_count(len(rows), 'point')} of the check. {caption}"),
        shown="",
        std_mm=std_mm[rows],
        mechanism=mechanism,
        lines=_bars(points, readings, lengths),
        marked={worst: str(artefacts[rows[worst]])},
    )
    return Section("The points of this check", scenes=(scene,))


def _bars(points: FloatArray, readings: Session, lengths: Lengths | None) -> Sequence[FloatArray]:
    """Lines between the means of seats whose distance is known."""
    seats = readings.seat
    if lengths is None or seats is None:
        return []
    pairs = zip(lengths.seat_a.tolist(), lengths.seat_b.tolist(), strict=True)
    ends = [[seats == one for one in pair] for pair in pairs]
    return [np.stack([points[rows].mean(axis=0) for rows in pair]) for pair in ends if all(rows.any() for rows in pair)]
