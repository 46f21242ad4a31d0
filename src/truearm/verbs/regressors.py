"""Regressors of the user's own beside truearm's models: any object with `predict`, of scikit-learn or not.

In Python only: a file of such an object would be a pickle, which can run any code, and truearm opens none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, TypeAlias, TypeGuard

import numpy as np

from truearm.errors import InputError
from truearm.models import Compensator
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.verbs.inputs import ModelLike


class RegressorLike(Protocol):
    """A fitted object that predicts points [mm] of shape (n, 3) from joint angles [rad; mm] of shape (n, n_joints)."""

    def predict(self, X: Any, /) -> Any:
        """Points of the tip in the frame of the reference points it was fitted to."""


AnyModelLike: TypeAlias = "ModelLike | RegressorLike"
Regressors: TypeAlias = Mapping[str, RegressorLike]  # by their names


def is_regressor(model: object) -> TypeGuard[RegressorLike]:
    """Whether it is an object with `predict` and no model of truearm."""
    return callable(getattr(model, "predict", None)) and not isinstance(model, Compensator | type)


def predict_points(regressor: RegressorLike, readings: Session, *, name: str | None = None) -> FloatArray:
    """(n, 3) points of a regressor at the readings of a session [mm].

    It predicts from the joint angles. One that was fitted to a DataFrame predicts from the columns of
    `Session.to_frame` with the same names, which state their units.

    Raises
    ------
    InputError
        If it is not fitted, was fitted to other columns, or does not return a finite point for every reading.
    """
    name = name or type(regressor).__name__
    hint = f"fit {name} to the angles and points of a session: fit(train.angles, train.points)"
    X: Any = readings.angles.copy()  # its own, which it may change
    if (columns := getattr(regressor, "feature_names_in_", None)) is not None:
        X = readings.to_frame()
        if lacking := [str(column) for column in columns if column not in X]:
            raise readings.error(f"the session lacks a column {name} was fitted to", column=lacking[0], hint=hint)
        X = X[list(columns)]
    try:
        points = np.array(regressor.predict(X), dtype=float)
    except InputError:  # of a model of truearm inside it
        raise
    except (TypeError, ValueError) as error:  # such as scikit-learn's NotFittedError, or another number of joints
        reason = str(error).partition("\n")[0].rstrip(".")
        raise readings.error(f"{name} cannot predict these readings: {reason}", hint=hint) from error
    if points.shape != (len(readings), 3):
        n = len(readings)
        raise readings.error(f"expected x y z in mm from {name}, shape ({n}, 3), got {points.shape}", hint=hint)
    if not (finite := np.isfinite(points).all(axis=1)).all():
        raise readings.error(f"expected a finite point from {name}, got {points[~finite][0]}", int(finite.argmin()))
    return points


def regressor_remark(regressor: RegressorLike) -> str:
    """What a reader must know before the errors of a regressor are believed."""
    kind = type(regressor)
    return (
        f"This regressor of the user's own ({kind.__module__}.{kind.__qualname__}) states no uncertainty. truearm does "
        "not know its training readings: these readings may be among them, or outside their range."
    )
