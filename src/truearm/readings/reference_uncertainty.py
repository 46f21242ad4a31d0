"""Errors of a reference instrument that readings share: its scale, and what repeats of a position have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from truearm.typing import FloatArray

if TYPE_CHECKING:
    from truearm.readings.session import Session

# Columns of the session file, and the largest value of each: a tenth of a per cent and a millimetre are no reference.
SHARED_UNCERTAINTIES = {"u_scale_ppm": 1000.0, "u_common_mm": 1.0}
PPM = 1e-6


def check_shared_uncertainties(readings: Session) -> None:
    """Check the uncertainties of the reference that readings share.

    Raises
    ------
    InputError
        If one is negative, not finite or too large, differs within a session, or the readings have no points.
    """
    sessions = np.full(len(readings), "") if readings.session is None else readings.session
    for name, largest in SHARED_UNCERTAINTIES.items():
        values = getattr(readings, name)
        if values is None or not len(values):
            continue
        column = None if readings.file is None else name
        odd = ~((values >= 0) & (values <= largest))
        if odd.any():
            row = int(np.argmax(odd))
            raise readings.error(
                f"expected {name} from 0 to {largest:g}, got {values[row]:g}",
                row,
                column=column,
                hint="state a standard uncertainty (k = 1) in the unit of the name",
            )
        first = np.unique(sessions, return_index=True, return_inverse=True)
        different = values != values[first[1]][first[2]]
        if different.any():
            row = int(np.argmax(different))
            raise readings.error(
                f"expected one {name} in all readings of a session, got {values[row]:g} beside "
                f"{values[first[1]][first[2]][row]:g}",
                row,
                column=column,
                hint="it belongs to the instrument, not to a reading; another instrument is another session",
            )


def common_variance_of_repeats(readings: Session) -> tuple[FloatArray, FloatArray]:
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


def scale_errors(readings: Session, *, is_frame_free: bool) -> FloatArray:
    """Errors of the points by one standard uncertainty of the reference's scale, (n, 3) [mm].

    The scale is about the mean of a session's points, where the frame is free: the readings then define it. Otherwise
    it is about the origin. The errors of several sessions are one error, that of one instrument.
    """
    out = np.zeros((len(readings), 3))
    if readings.u_scale_ppm is None or readings.points is None:
        return out
    sessions = np.full(len(readings), "") if readings.session is None else readings.session
    for name in np.unique(sessions):
        rows = np.flatnonzero((sessions == name) & readings.has_point)
        if len(rows):
            centre = readings.points[rows].mean(axis=0) if is_frame_free else np.zeros(3)
            out[rows] = PPM * readings.u_scale_ppm[rows, None] * (readings.points[rows] - centre)
    return out
