"""Distances of the tip: from the centre of a touched sphere, and to a fixed point (an anchor) at an unknown place.

A draw-wire encoder, or a ball bar with one end on a fixed ball, measures how far the tip is from its anchor. All
distances to one anchor have one error in common, the offset: the zero of the wire, the certificate of the bar.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from truearm.typing import BoolArray, FloatArray, NameArray

if TYPE_CHECKING:
    from truearm.readings.session import Session

# A sphere of known size: distance of the tip's centre from the sphere's at a touch, and its standard uncertainty.
SPHERE_DISTANCE = ("sphere_distance_mm", "u_sphere_distance_mm")
# Distance to an anchor, its standard uncertainty, and that of the offset which all distances to the anchor share.
ANCHOR_DISTANCE = ("distance_mm", "u_distance_mm", "u_offset_mm")

# Standard uncertainty of an offset that is not stated [mm]: the zero of a wire is set by eye.
OFFSET_STD_MM = 1.0
# Distances that differ by a smaller share are those of a bar: they do not determine the offset.
EQUAL_SHARE = 0.05


def check_sphere_distances(readings: Session) -> None:
    """Distances from spheres: positive, of readings that touch one, the same for all of a sphere.

    Raises
    ------
    InputError
        With the reading and the column.
    """
    distances = readings.sphere_distance
    if distances is None:
        return
    known = ~np.isnan(distances[:, 0])
    if not known.any():
        object.__setattr__(readings, "sphere_distance", None)
        return
    column = None if readings.file is None else SPHERE_DISTANCE[0]
    touched = np.zeros(len(readings), bool) if readings.sphere is None else readings.sphere != ""
    for bad, said in (
        (known & (distances <= 0).any(axis=1), "expected a positive distance and uncertainty"),
        (known & ~touched, "expected the name of the sphere to which the distance refers, got none"),
    ):
        if bad.any():
            raise readings.error(said, int(np.argmax(bad)), column=column)
    assert readings.sphere is not None  # touched
    for name in np.unique(readings.sphere[known]):
        rows = np.flatnonzero(readings.sphere == name)
        first = rows[known[rows]][0]
        same = (distances[rows] == distances[first]).all(axis=1)
        if not same.all():
            raise readings.error(
                f"expected the same distance from sphere {str(name)!r} in all of its readings, but "
                f"{readings.called(int(first))} has another",
                int(rows[np.argmin(same)]),
                column=column,
                hint="fill it in for all of them; with another ball on the stylus use another name of the sphere",
            )


def check_anchor_distances(readings: Session) -> None:
    """Distances to anchors: positive, each with its anchor, with uncertainties for all of them or none.

    Raises
    ------
    InputError
        With the reading and the column.
    """
    n = len(readings)
    distance, u, u_offset = (getattr(readings, name) for name in ANCHOR_DISTANCE)
    if distance is None or not (known := ~np.isnan(distance)).any():
        _refuse_without_distance(readings)
        for name in ANCHOR_DISTANCE:
            object.__setattr__(readings, name, None)
        return
    anchor = np.full(n, "") if readings.anchor is None else readings.anchor
    rules: list[tuple[str, BoolArray, str, str | None]] = [
        ("distance_mm", known & ~(distance > 0), "expected a positive distance", "omit the reading"),
        ("anchor", known & (anchor == ""), "expected the name of the anchor of the distance, got none", None),
        ("distance_mm", ~known & (anchor != ""), "expected the distance to the anchor, got none", None),
    ]
    for name, values in (("u_distance_mm", u), ("u_offset_mm", u_offset)):
        if values is not None:
            stated = ~np.isnan(values)
            every = "state a standard uncertainty (k = 1) of every distance, or omit the column"
            rules += [
                (name, known & ~stated, f"expected {name} of the distance, got none", every),
                (name, stated & ~known, f"expected {name} only where there is a distance", every),
                (name, stated & ~(values > 0), f"expected a positive {name}", every),
            ]
    for column, bad, said, hint in rules:
        if bad.any():
            row = int(np.argmax(bad))
            raise readings.error(said, row, column=None if readings.file is None else column, hint=hint)
    if u_offset is not None:
        _check_one_offset(readings, anchor, u_offset, known)


def _refuse_without_distance(readings: Session) -> None:
    for name in ("anchor", *ANCHOR_DISTANCE[1:]):
        values = getattr(readings, name)
        stated = None if values is None else values != "" if name == "anchor" else ~np.isnan(values)
        if stated is not None and stated.any():
            raise readings.error(
                f"expected the column distance_mm beside {name}, got no distance",
                int(np.argmax(stated)),
                column=None if readings.file is None else name,
                hint="distance_mm: distance of the tip from the anchor",
            )


def _check_one_offset(readings: Session, anchor: NameArray, u_offset: FloatArray, known: BoolArray) -> None:
    for name in np.unique(anchor[known]):
        rows = np.flatnonzero(known & (anchor == name))
        different = u_offset[rows] != u_offset[rows[0]]
        if different.any():
            row = int(rows[np.argmax(different)])
            raise readings.error(
                f"expected one u_offset_mm for all distances to anchor {str(name)!r}, got {u_offset[row]:g} beside "
                f"{u_offset[rows[0]]:g}",
                row,
                column=None if readings.file is None else "u_offset_mm",
                hint="it is the uncertainty of the error that they share; another instrument is another anchor",
            )


def rows_with_distance(readings: Session) -> BoolArray:
    """(n,) Whether each reading has a distance to an anchor."""
    return np.zeros(len(readings), bool) if readings.distance_mm is None else ~np.isnan(readings.distance_mm)


def offset_std(readings: Session, name: str) -> float:
    """Standard uncertainty of the offset of the distances to an anchor [mm]."""
    if readings.u_offset_mm is None or readings.anchor is None:
        return OFFSET_STD_MM
    return float(readings.u_offset_mm[readings.anchor == name][0])


def bars_without_certificate(readings: Session) -> list[str]:
    """Anchors whose distances are nearly equal, as those of a bar, without a stated uncertainty of the offset."""
    if readings.distance_mm is None or readings.u_offset_mm is not None:
        return []
    assert readings.anchor is not None  # checked by the session
    known = rows_with_distance(readings)
    names = [str(name) for name in np.unique(readings.anchor[known])]
    values = [readings.distance_mm[known & (readings.anchor == name)] for name in names]
    return [name for name, some in zip(names, values, strict=True) if np.ptp(some) < EQUAL_SHARE * some.mean()]
