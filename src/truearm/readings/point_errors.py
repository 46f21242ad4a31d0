"""Errors of points against reference points: distances, and single coordinates as in the paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray


class PointErrors(TypedDict):
    """Errors of points [mm]."""

    mean_mm: float
    rms_mm: float
    p95_mm: float
    max_mm: float
    mean_abs_coordinate_mm: float
    max_abs_coordinate_mm: float
    n: int


class ErrorComparison(PointErrors):
    """Errors, and the share of the nominal arm's error that was removed [%]."""

    removed_percent: float


def point_errors(predicted: FloatArray, points: FloatArray) -> PointErrors:
    """Errors of predicted points against reference points.

    Parameters
    ----------
    predicted, points : (n, 3) array
        [mm]. Rows of `points` that are NaN (no reference point) are ignored.

    Returns
    -------
    PointErrors
        `mean_mm`, `rms_mm`, `p95_mm`, `max_mm` of the distances; `mean_abs_coordinate_mm`, `max_abs_coordinate_mm` of
        single coordinates, the measure of Gao et al. (2017), section 4; `n` the readings counted.
    """
    known = ~np.isnan(points).all(axis=1)
    if not known.any():
        raise InputError("expected one or more readings to evaluate, got none")
    residuals = (predicted - points)[known]
    distances = np.linalg.norm(residuals, axis=1)
    return PointErrors(
        mean_mm=float(distances.mean()),
        rms_mm=float(np.sqrt(np.mean(distances**2))),
        p95_mm=float(np.percentile(distances, 95)),
        max_mm=float(distances.max()),
        mean_abs_coordinate_mm=float(np.abs(residuals).mean()),
        max_abs_coordinate_mm=float(np.abs(residuals).max()),
        n=len(residuals),
    )


def compare_errors(predicted: FloatArray, nominal: FloatArray, points: FloatArray) -> ErrorComparison:
    """Errors of predicted points, with the share of the nominal ones' mean absolute coordinate error removed.

    The share is the paper's "97 %": 100 (1 - 0.0136 / 0.4492). It is 0 where the nominal arm has no error.
    """
    errors = point_errors(predicted, points)
    return ErrorComparison(**errors, removed_percent=removed_percent(errors, point_errors(nominal, points)))


def removed_percent(own: Mapping[str, Any], nominal: Mapping[str, Any]) -> float:
    """The share of the nominal arm's mean absolute coordinate error that a model removed, of errors of both."""
    before = float(nominal["mean_abs_coordinate_mm"])
    return 100 * (1 - float(own["mean_abs_coordinate_mm"]) / before) if before > 0 else 0.0
