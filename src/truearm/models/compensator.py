"""What every model of an arm has in common: the scikit-learn contract, on joint angles and tip positions."""

from __future__ import annotations

import hashlib
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, Self, overload

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identify.points import PointFit, fit_points, placed_roughly
from truearm.readings.readings import Readings
from truearm.terms import FREE_BASE, FREE_TIP

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

FREE_PARTS = ("base", "tip")
# Share of the reach by which an arm as drawn may miss its readings. Ten times what the kinematic model expects of its
# constants (3 mrad, 3 mm) stays below; another arm, a wrong unit or a wrong sign does not.
MOST_NOMINAL_ERROR = 0.05
# Rows that determine base (6) and tip (3): 3 coordinates each, and one row to spare.
MIN_ROWS = 4


class Compensator(RegressorMixin, BaseEstimator, ABC):  # type: ignore[misc]
    """Base of the models: from joint angles to the tip's coordinates.

    A model says how it learns (`_identify`), predicts (`_tips`) and how sure it is (`_covariance`); checking,
    book-keeping and the nominal arm to compare with are the same for all.

    Attributes
    ----------
    nominal_ : PointFit
        The nominal arm with only the free parts (base, tip) fitted to the same readings: what there was before.
    angle_ranges_ : (n_joints, 2) array
        Smallest and largest training angle of every joint [rad, or mm].
    n_train_ : int
        Training readings.
    data_fingerprint_ : str
        SHA-256 of the training angles and points.
    fit_seconds_ : float
        Time `fit` took [s].
    """

    arm: Arm
    free: tuple[str, ...]
    robust: bool = True

    def fit(self, X: npt.ArrayLike, y: npt.ArrayLike) -> Self:
        """Learn from joint angles and reference points.

        Parameters
        ----------
        X : (n, n_joints) array
            Joint angles [rad], displacements of sliding joints [mm].
        y : (n, 3) array
            The tip in the frame of the reference [mm].

        Raises
        ------
        InputError
            If shapes do not fit the arm, numbers are not finite, or the readings are too few.
        """
        angles, points = validate_data(
            self, X, y, multi_output=True, y_numeric=True, dtype=np.float64, ensure_min_samples=MIN_ROWS
        )
        if np.ndim(points) != 2 or points.shape[1] != 3:
            raise InputError(f"expected points of shape (n, 3), x y z in mm, got {np.shape(points)}")
        return self.fit_readings(Readings(angles, np.asarray(points, dtype=float)))

    def fit_readings(
        self,
        readings: Readings,
        *,
        progress: Callable[[int, str], None] | None = None,
        checkpoint: Path | None = None,
    ) -> Self:
        """Learn from readings with reference points and, where known, their uncertainties.

        Parameters
        ----------
        readings : Readings
        progress : callable, optional
            Told the steps done and how it stands.
        checkpoint : path, optional
            Folder where a network's training keeps what it has reached, made if it is not there. A later fit with the
            same data and options goes on from it and comes to the same model as without the stop. Whoever asked for it
            removes it when the model is safe. The other models are quick and keep nothing.

        Raises
        ------
        InputError
            As `fit`; also if the readings have no reference points, or the folder holds trainings of other data or
            options.
        """
        arm = self._checked_arm()
        if readings.n_joints != arm.n_joints:
            raise InputError(
                f"expected readings of {arm.n_joints} joints for arm {arm.name!r}, got {readings.n_joints}"
            )
        if readings.points is None:
            raise InputError(
                "expected reference points (x_mm, y_mm, z_mm) to learn from, the readings have none",
                file=readings.file,
            )
        if not readings.has_point.all():
            raise readings.error(
                f"expected a reference point at every reading, {int((~readings.has_point).sum())} of {len(readings)}"
                " have none",
                hint="readings.rows(readings.has_point) has the others",
            )
        if len(readings) < MIN_ROWS:
            raise InputError(f"expected {MIN_ROWS} or more readings, got {len(readings)}", file=readings.file)
        begun = time.perf_counter()
        self.n_features_in_ = readings.n_joints
        self.nominal_ = self._fit_nominal(readings)
        self._identify(readings, readings.points, progress or _silent, checkpoint)
        self.angle_ranges_ = np.stack([readings.angles.min(axis=0), readings.angles.max(axis=0)], axis=1)
        self.n_train_ = len(readings)
        self.data_fingerprint_ = fingerprint(readings.angles, readings.points)
        self.fit_seconds_ = time.perf_counter() - begun
        return self

    @overload
    def predict(self, X: npt.ArrayLike, *, return_cov: Literal[False] = False) -> FloatArray: ...

    @overload
    def predict(self, X: npt.ArrayLike, *, return_cov: Literal[True]) -> tuple[FloatArray, FloatArray]: ...

    def predict(self, X: npt.ArrayLike, *, return_cov: bool = False) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Corrected coordinates.

        Parameters
        ----------
        X : (n, n_joints) array
            Joint angles [rad], displacements of sliding joints [mm].
        return_cov : bool
            Whether to give the uncertainty too.

        Returns
        -------
        points : (n, 3) array
            The tip in the frame of the reference [mm].
        covariance : (n, 3, 3) array, if `return_cov`
            Of the tip [mm^2]; a reference point compared with it has its own uncertainty besides. Holds within the
            training ranges: see `outside_training`.
        """
        angles = self._checked_angles(X)
        points = self._tips(angles)
        return (points, self._covariance(angles)) if return_cov else points

    def predict_nominal(self, angles: npt.ArrayLike) -> FloatArray:
        """(n, 3) what the nominal arm gives, with the free parts fitted to the same training readings [mm]."""
        return self.nominal_.chain.tip_in_base(self._checked_angles(angles))

    def outside_training(self, angles: npt.ArrayLike) -> BoolArray:
        """(n,) True where a joint is beyond the angles it was trained on: the model has not seen such poses."""
        angles = self._checked_angles(angles)
        lower, upper = self.angle_ranges_.T
        return np.asarray(((angles < lower) | (angles > upper)).any(axis=1))

    def __sklearn_tags__(self) -> Any:
        """Many outputs, never one; and a poor score on data that no arm could have made."""
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True
        tags.target_tags.multi_output = True
        tags.target_tags.single_output = False
        return tags

    def _check_options(self) -> None:
        """Refuse options that no fit could follow."""
        unknown = set(self.free) - set(FREE_PARTS)
        if unknown:
            raise InputError(f"expected free parts among {list(FREE_PARTS)}, got {sorted(unknown)}")

    @abstractmethod
    def _identify(
        self, readings: Readings, points: FloatArray, progress: Callable[[int, str], None], checkpoint: Path | None
    ) -> None:
        """Learn from readings and their points (n, 3) [mm]; `nominal_` is there already. See `fit_readings`."""

    @abstractmethod
    def _tips(self, angles: FloatArray) -> FloatArray:
        """Tips (n, 3) [mm] at checked angles."""

    @abstractmethod
    def _covariance(self, angles: FloatArray) -> FloatArray:
        """Their covariances (n, 3, 3) [mm^2]."""

    def _checked_arm(self) -> Arm:
        if not isinstance(self.arm, Arm):
            raise InputError(f"expected an Arm, got {type(self.arm).__name__}", hint="truearm.arm.load('gao2017')")
        self._check_options()
        return self.arm

    def _checked_angles(self, angles: npt.ArrayLike) -> FloatArray:
        check_is_fitted(self)
        return np.asarray(validate_data(self, angles, reset=False, dtype=np.float64))

    def _fit_nominal(self, readings: Readings) -> PointFit:
        """The nominal chain with base and tip, as far as they are free, fitted to the readings."""
        chain, points = self.arm.chain, readings.points
        assert points is not None
        if "base" in self.free:
            chain = placed_roughly(chain, readings.angles, points)
        prior_std = with_free_parts(np.zeros((chain.n_places, 6)), self.free)
        return fit_points(
            chain, readings.angles, points, prior_std=prior_std, point_std=readings.point_std, robust=self.robust
        )


def with_free_parts(prior_std: FloatArray, free: tuple[str, ...]) -> FloatArray:
    """Prior standard deviations (n_places, 6) [rad, mm] with base and tip as good as unknown where they are free."""
    prior_std = prior_std.copy()
    if "base" in free:
        prior_std[0] = FREE_BASE
    if "tip" in free:
        prior_std[-1, 3:] = FREE_TIP
    return prior_std


def _silent(done: int, note: str) -> None:
    """Tell nobody."""


def fingerprint(angles: FloatArray, points: FloatArray) -> str:
    """SHA-256 of angles and points as little-endian doubles, row by row."""
    digest = hashlib.sha256()
    for array in (angles, points):
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()


def chain_covariance(fit: PointFit, angles: FloatArray) -> FloatArray:
    """(n, 3, 3) covariance of predicted points [mm^2]: of the identified motions, plus what they leave unexplained."""
    out = np.empty((len(angles), 3, 3))
    size = fit.motions.size
    for rows, _, by_motion in fit.chain.small_motions_by_chunk(angles):
        columns = by_motion.reshape(size, 3, -1)
        spread = (fit.covariance @ columns.reshape(size, -1)).reshape(columns.shape)
        out[rows] = np.einsum("pin,pjn->nij", columns, spread)
    out = (out + out.transpose(0, 2, 1)) / 2  # equal but for rounding
    return out + fit.noise_std**2 * np.eye(3)
