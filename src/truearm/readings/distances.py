"""Distances of the tip: from the centre of a touched sphere, and to a fixed point (an anchor) at an unknown place.

A draw-wire encoder, or a ball bar with one end on a fixed ball, measures how far the tip is from its anchor. All
distances to one anchor have one error in common, the offset: the zero of the wire, the certificate of the bar.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from truearm.findings import Finding
from truearm.readings.readings import Measurements, Readings
from truearm.typing import BoolArray

# Standard uncertainty of an offset that is not stated [mm]: the zero of a wire is set by eye.
OFFSET_STD_MM = 1.0
# Distances that differ by a smaller share are those of a bar: they do not determine the offset.
EQUAL_SHARE = 0.05


def rows_with_distance(readings: Measurements) -> BoolArray:
    """(n,) Whether each reading has a distance to an anchor."""
    return np.zeros(len(readings), bool) if readings.distance_mm is None else ~np.isnan(readings.distance_mm)


def offset_std(readings: Measurements, name: str) -> float:
    """Standard uncertainty of the offset of the distances to an anchor [mm]."""
    if readings.u_offset_mm is None or readings.anchor is None:
        return OFFSET_STD_MM
    return float(readings.u_offset_mm[readings.anchor == name][0])


def bars_without_certificate(readings: Readings) -> Iterator[Finding]:
    """Anchors whose distances are nearly equal, as those of a bar, without a stated uncertainty of the offset."""
    if readings.distance_mm is None or readings.u_offset_mm is not None:
        return
    assert readings.anchor is not None  # checked by the session
    known = rows_with_distance(readings)
    names = [str(name) for name in np.unique(readings.anchor[known])]
    values = [readings.distance_mm[known & (readings.anchor == name)] for name in names]
    for name, some in zip(names, values, strict=True):
        if np.ptp(some) < EQUAL_SHARE * some.mean():
            said = (
                f"The distances to anchor {name} are nearly equal, as those of a bar, and their common uncertainty is "
                f"assumed to be {OFFSET_STD_MM:g} mm, which leaves the size of the arm open: state u_offset_mm."
            )
            yield Finding("bar", said, {"u_offset_mm": OFFSET_STD_MM})
