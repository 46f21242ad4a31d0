"""How models do on readings that they have not seen: splits, errors and the ellipsoids of their uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import chi2

from truearm.arm import Arm, load_arm
from truearm.models import KinematicModel, NominalModel, PhysicalModel
from truearm.models.identified_model import IdentifiedModel
from truearm.readings import Session, point_errors
from truearm.typing import FloatArray
from truearm.wings.importing import datasets

IDENTIFIED: dict[str, type[IdentifiedModel]] = {"kinematic": KinematicModel, "physical": PhysicalModel}
MODELS: dict[str, type[IdentifiedModel]] = {"nominal": NominalModel, **IDENTIFIED}
HELD_OUT = 0.3
# What is held out of a set that a laser tracker measured: goal positions with all their readings, or readings.
SPLITS = {"ur10-a": "position", "ur10-b": "position", "ur5": "row", "wam": "row"}
LEVEL = float(chi2.ppf(0.95, 3))
FIGURES = ("mean_mm", "p95_mm", "max_mm")


def split(name: str, seed: int) -> tuple[Arm, Session, Session]:
    """Arm, training and test readings of a set with points."""
    train, test = datasets.load_readings(name).split(by=SPLITS[name], hold_out=HELD_OUT, seed=seed)
    return load_arm(datasets.DATASETS[name].arm), train, test


def three_figures(points: FloatArray, reference: FloatArray) -> dict[str, float]:
    """Mean, 95th percentile and maximum of the distances [mm]."""
    errors = point_errors(points, reference)
    return {name: float(errors[name]) for name in FIGURES}


def over_splits(splits: list[dict[str, float]]) -> dict[str, float]:
    """Means of the figures over splits, and the largest of the maxima."""
    mean = {name: float(np.mean([split[name] for split in splits])) for name in ("mean_mm", "p95_mm")}
    return mean | {"max_mm": max(split["max_mm"] for split in splits)}


def told(figures: dict[str, float], digits: int = 3) -> str:
    """Write mean / p95 / max."""
    return " / ".join(f"{figures[name]:.{digits}f}" for name in FIGURES)


def squares(deviations: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squared Mahalanobis lengths (n,) of deviations (n, 3)."""
    return np.einsum("ni,ni->n", deviations, np.linalg.solve(covariance, deviations[:, :, None])[:, :, 0])


def squared_lengths(points: FloatArray, covariance: FloatArray, test: Session) -> FloatArray:
    """Squared Mahalanobis lengths (n,) of predicted points, the reference's own uncertainty with them."""
    if test.point_std is not None:
        covariance = covariance + test.point_std[:, :, None] ** 2 * np.eye(3)
    return squares(points - test.points, covariance)


def on_readings(model: Any, test: Session) -> tuple[FloatArray, FloatArray]:
    """Predicted points, and which readings are in the 95 % ellipsoids."""
    points, covariance = model.predict_readings(test, return_cov=True)
    return points, squared_lengths(points, covariance, test) <= LEVEL


def mean_and_u(model: Any, test: Session) -> tuple[float, float]:
    """Mean distance from the points, and the stated standard uncertainty of a coordinate, root mean square [mm]."""
    points, covariance = model.predict_readings(test, return_cov=True)
    error = np.linalg.norm(points - test.points, axis=1).mean()
    return float(error), float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / 3))
