"""Distances of a virtual arm's tip from anchors, as of a draw-wire encoder at each of several fixed points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.errors import InputError
from truearm.identification.virtual.arm import Measurement
from truearm.identification.virtual.state import random_stream
from truearm.typing import FloatArray

# Standard uncertainty of a distance, and of the offset that all distances to an anchor share [mm]: a good wire, whose
# zero was set with a gauge.
DISTANCE_STD_MM = 0.05
OFFSET_STD_MM = 0.5
# Anchors stand around the base, at these shares of the reach: farther than the tip, low and high in turn.
DISTANCE_SHARE = 1.2
HEIGHT_SHARES = (-0.2, 0.4)


def place_anchors(n: int, *, reach: float) -> FloatArray:
    """(n, 3) places of anchors around the base of an arm, in its base frame [mm]."""
    turn = 2 * np.pi * np.arange(n) / max(n, 1) + 0.3
    height = np.resize(HEIGHT_SHARES, n)
    return reach * np.column_stack([DISTANCE_SHARE * np.cos(turn), DISTANCE_SHARE * np.sin(turn), height])


def measure_distances(measured: Measurement, anchors: FloatArray, *, seed: int) -> Measurement:
    """A measurement with distances: each pose as many times as there are anchors, with a distance to each.

    Parameters
    ----------
    measured : Measurement
        Of n poses. Points and seats stay with the first reading of each pose.
    anchors : (k, 3) array
        Places in the base frame [mm].
    seed : int
        Of noise and offsets.

    Returns
    -------
    Measurement
        Of n k readings; the names of the anchors are A1 to Ak.

    Raises
    ------
    InputError
        If there are no anchors, or the tip touches one.
    """
    n, k = len(measured), len(anchors)
    if k < 1:
        raise InputError("expected one or more anchors, got none")
    stream = random_stream("session", seed, "distances")
    offsets = OFFSET_STD_MM * stream.standard_normal(k)
    distance = np.linalg.norm(measured.true_tips[:, None] - anchors, axis=2) + offsets
    distance += DISTANCE_STD_MM * stream.standard_normal((n, k))
    if not (distance > 0).all():
        raise InputError("the tip touches an anchor: place anchors outside the reach of the arm")
    row, which = np.repeat(np.arange(n), k), np.tile(np.arange(k), n)
    readings, later = measured.readings.rows(row), which > 0
    points, std, seat = readings.points, readings.point_std, readings.seat  # copies: rows were repeated
    for values in (points, std):
        if values is not None:
            values[later] = np.nan
    if seat is not None:
        seat[later] = ""
    readings = replace(
        readings,
        points=points,
        point_std=std,
        seat=seat,
        anchor=np.array([f"A{i + 1}" for i in which]),
        distance_mm=distance.ravel(),
        u_distance_mm=np.full(n * k, DISTANCE_STD_MM),
        u_offset_mm=np.full(n * k, OFFSET_STD_MM),
        numbers=None,
    )
    return Measurement(readings, measured.true_angles[row], measured.true_tips[row], measured.state.rows(row))
