"""Errors of a reference instrument that readings share: its scale, and what repeats of a position have in common."""

from __future__ import annotations

import numpy as np

from truearm.readings.readings import Readings
from truearm.typing import FloatArray

PPM = 1e-6


def common_variance_of_repeats(readings: Readings) -> tuple[FloatArray, FloatArray]:
    """Variance of the error that all readings of a position share, and what their number adds to it.

    The mean of m repeats of standard uncertainty s with a common error u has the variance ``s^2 / m + u^2``: as many
    independent ones with ``s^2 + m u^2`` each (block covariance, JCGM 100:2008, 5.2.2 for correlation 1 of that part).

    Returns
    -------
    variance : (n,) array
        u^2 [mm^2].
    of_repeats : (n,) array
        ``(m - 1) u^2`` [mm^2]; zero for a reading without a position.
    """
    n = len(readings)
    if readings.u_common_mm is None:
        return np.zeros(n), np.zeros(n)
    variance, repeats = readings.u_common_mm**2, np.ones(n)
    if readings.position is not None:
        seen = readings.has_point
        sessions = np.full(n, "") if readings.session is None else readings.session
        group = np.unique(np.stack([sessions, readings.position], axis=1), axis=0, return_inverse=True)[1].reshape(n)
        repeats = np.where(readings.position != "", np.bincount(group, seen)[group], 1.0)
    return variance, np.maximum(repeats - 1, 0.0) * variance


def reference_covariance(readings: Readings, *, is_frame_free: bool) -> FloatArray:
    """Covariance of the reference points, (n, 3, 3) [mm^2]: their own, that of their position, that of the scale."""
    own = np.zeros((len(readings), 3)) if readings.point_std is None else readings.point_std**2
    common = common_variance_of_repeats(readings)[0]
    scale = scale_errors(readings, is_frame_free=is_frame_free)[:, :3]
    return (own + common[:, None])[:, :, None] * np.eye(3) + scale[:, :, None] * scale[:, None]


def scale_errors(readings: Readings, *, is_frame_free: bool) -> FloatArray:
    """Errors of x, y, z and the distance by one standard uncertainty of the reference's scale, (n, 4) [mm].

    The scale is about the mean of a session's points, where the frame is free: the readings then define it. Otherwise
    it is about the origin. The errors of several sessions are one error, that of one instrument.
    """
    out = np.zeros((len(readings), 4))
    if readings.u_scale_ppm is None:
        return out
    if readings.distance_mm is not None:
        out[:, 3] = PPM * readings.u_scale_ppm * np.nan_to_num(readings.distance_mm)
    if readings.points is None:
        return out
    sessions = np.full(len(readings), "") if readings.session is None else readings.session
    for name in np.unique(sessions):
        rows = np.flatnonzero((sessions == name) & readings.has_point)
        if len(rows):
            centre = readings.points[rows].mean(axis=0) if is_frame_free else np.zeros(3)
            out[rows, :3] = PPM * readings.u_scale_ppm[rows, None] * (readings.points[rows] - centre)
    return out
