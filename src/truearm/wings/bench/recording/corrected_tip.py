"""The corrected tip of a connected arm, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.errors import InputError
from truearm.models import Compensator
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.bench.sources import Sample

COVERAGE_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class CorrectedTip:
    """Where a model says that the tip is.

    Attributes
    ----------
    tip_in_reference_mm : (3,) array
    U_mm : (3,) array
        Expanded uncertainties of its coordinates, k = 2 [mm].
    is_trained : bool
        Whether all inputs are within the trained range.
    """

    tip_in_reference_mm: FloatArray
    U_mm: FloatArray
    is_trained: bool

    def __str__(self) -> str:
        x, y, z = self.tip_in_reference_mm
        outside = "" if self.is_trained else ", outside the trained range"
        return f"x {x:.3f}  y {y:.3f}  z {z:.3f} mm, U (k = 2) {self.U_mm.max():.3f} mm{outside}"


def corrected_tip(model: Compensator, sample: Sample, directions: FloatArray) -> CorrectedTip | str:
    """The tip at a sample, with its temperature and loads; or why there is none.

    Parameters
    ----------
    model : Compensator
    sample : Sample
        Of the arm that the model is of.
    directions : (n_joints,) array
        Sign of each joint's last movement: -1, 1, or 0; an unknown one takes time, for its uncertainty.
    """
    temperature = None if sample.temperature_degC is None else np.array([sample.temperature_degC])
    known = {name: np.array([value]) for name, value in sample.columns.items() if name in model.training_.columns}
    try:
        readings = Session(
            sample.joint_angles_rad[None], temperature_degC=temperature, directions=directions[None], columns=known
        )
        (tip,) = corrected_tips(model, readings)
    except InputError as error:
        return error.problem
    return tip


def corrected_tips(model: Compensator, readings: Session) -> list[CorrectedTip]:
    """The tip at each reading.

    Raises
    ------
    InputError
        If the readings lack what the model needs, or are of another arm.
    """
    at = model.checked(readings)
    points, covariances = model.predict_readings(at, return_cov=True)
    U_mm = COVERAGE_FACTOR * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    return [*map(CorrectedTip, points, U_mm, (~model.outside_training(at)).tolist())]
