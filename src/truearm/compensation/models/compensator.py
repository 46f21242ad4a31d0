"""What every model of an arm has in common: the scikit-learn contract, on joint angles and tip positions."""

from __future__ import annotations

import hashlib
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any, Literal, Self, overload

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from truearm.arm.arm import Arm
from truearm.compensation.models.reading_references import (
    check_sizes,
    references_of,
    roughly_aligned_chain,
    state_of,
    tool_terms,
)
from truearm.compensation.models.session_frames import (
    covariances_to_session_frames,
    points_to_session_frames,
    rough_session_frames,
    session_frame_terms,
    to_first_session_frame,
)
from truearm.compensation.models.training_range import find_angle_gaps, outside_ranges
from truearm.errors import InputError
from truearm.identification.estimation.identification import IdentificationResult, identify
from truearm.identification.estimation.references import Reference
from truearm.identification.terms import ArmState, Term, constants
from truearm.readings.checks import check_sessions
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray

FREE_PARTS = ("base", "tip")
# Share of the reach by which an arm as drawn may miss its readings. Ten times what the kinematic model expects of its
# constants (3 mrad, 3 mm) stays below; another arm, a wrong unit or a wrong sign does not.
MAX_NOMINAL_ERROR = 0.05
# Rows that determine base (6) and tip (3): 3 coordinates each, and one row to spare.
MIN_ROWS = 4


class Compensator(RegressorMixin, BaseEstimator, ABC):  # type: ignore[misc]
    """Base of the models: from joint angles to the tip's coordinates.

    A model says how it learns (`_identify`), predicts (`_tips`) and how sure it is (`_covariance`); checking,
    book-keeping and the nominal arm to compare with are the same for all.

    Attributes
    ----------
    nominal_ : IdentificationResult
        The nominal arm with only the free parts (base, tip) fitted to the same readings: what there was before.
    arm_ : Arm
        That it was fitted for.
    free_ : tuple of str
        The free parts that the readings can tell: without reference points the base is as drawn.
    session_frames_ : dict of str to (4, 4) array
        Of readings in several sessions, each with a frame of its own: by the session's name the rough motion that
        carries its points into the frame of the first (see `truearm.compensation.models.session_frames`). Empty where there was one.
    angle_ranges_ : (n_joints, 2) array
        Smallest and largest training angle of every joint [rad, or mm].
    angle_gaps_ : (k, 3) array
        Gaps between them: joint, begin and end (see `truearm.compensation.models.training_range`).
    n_train_ : int
        Training readings.
    data_fingerprint_ : str
        SHA-256 of the training readings (see `fingerprint`, and `is_trained_on` to compare with).
    lengths_fingerprint_ : str
        SHA-256 of the known lengths between their seats; empty without.
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
        return self.fit_readings(Session(angles, np.asarray(points, dtype=float)))

    def fit_readings(
        self,
        readings: Session,
        *,
        lengths: Lengths | None = None,
        progress: Callable[[int, str], None] | None = None,
        nominal: Compensator | None = None,
    ) -> Self:
        """Learn from readings: reference points and, where known, their uncertainties; seats and lengths between them.

        Parameters
        ----------
        readings : Session
            A network needs a reference point at every reading. The other models take what there is.
        lengths : Lengths, optional
            Known lengths between seats of the readings.
        progress : callable, optional
            Told the steps done and how it stands.
        nominal : Compensator, optional
            A model fitted to the same readings of the same arm, with the same free parts and lengths: its `nominal_`
            serves this one too and is not fitted again.

        Raises
        ------
        InputError
            As `fit`; also if the readings have nothing to learn from, a known length or distance is far from that of
            the arm as drawn (`check_sizes`), or `nominal` was fitted to something else.
        """
        arm = self._checked_arm()
        if readings.n_joints != arm.n_joints:
            raise InputError(
                f"expected readings of {arm.n_joints} joints for arm {arm.name!r}, got {readings.n_joints}"
            )
        if lengths is not None:
            if readings.seat is None:
                raise readings.error("lengths are between seats, and the readings name none", column="seat")
            lengths = lengths.between(readings.seat)
        check_sessions(readings, lengths, own_frame="base" not in self.free)
        n_known = self._check_references(readings, lengths)
        if n_known < MIN_ROWS:
            raise readings.error(f"expected {MIN_ROWS} or more readings with a reference, got {n_known}")
        begun = time.perf_counter()
        self.arm_ = arm
        self.n_features_in_ = readings.n_joints
        pointed = readings.has_point
        self.free_ = self.free if pointed.any() else tuple(part for part in self.free if part != "base")
        self.session_frames_ = rough_session_frames(arm, readings, self.free_)
        in_one_frame = to_first_session_frame(readings, self.session_frames_)
        self.data_fingerprint_ = fingerprint(readings)
        self.lengths_fingerprint_ = "" if lengths is None else fingerprint(lengths)
        self.nominal_ = self._fit_nominal(in_one_frame, lengths) if nominal is None else self._same_nominal(nominal)
        self._identify(in_one_frame, lengths, progress or _silent)
        self.angle_ranges_ = np.stack([readings.angles.min(axis=0), readings.angles.max(axis=0)], axis=1)
        self.angle_gaps_ = find_angle_gaps(readings.angles, arm.chain.is_prismatic)
        self.n_train_ = len(readings)
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
            The tip in the frame of the reference [mm], of several sessions that of the first.
        covariance : (n, 3, 3) array, if `return_cov`
            Of the tip [mm^2]; a reference point compared with it has its own uncertainty besides. See
            `outside_training` for where it was not learned.
        """
        return self.predict_readings(Session(self._checked_angles(X)), return_cov=return_cov)

    @overload
    def predict_readings(self, readings: Session, *, return_cov: Literal[False] = False) -> FloatArray: ...

    @overload
    def predict_readings(self, readings: Session, *, return_cov: Literal[True]) -> tuple[FloatArray, FloatArray]: ...

    @overload
    def predict_readings(
        self, readings: Session, *, return_cov: bool
    ) -> FloatArray | tuple[FloatArray, FloatArray]: ...

    def predict_readings(
        self, readings: Session, *, return_cov: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Corrected coordinates at readings, by their temperature, loads and directions too if the model knows them.

        Readings of a session that the model knows (`session_frames_`) come out in its frame, all others in the first's.
        `predict` takes temperature and loads as they were on average when the model learned, and directions of movement
        as half way between the two.
        """
        self._checked_angles(readings.angles)
        points = points_to_session_frames(self._tips(readings), readings, self.session_frames_)
        if not return_cov:
            return points
        of_parameters, unexplained = self.covariance_parts(readings)
        return points, of_parameters + unexplained

    def covariance_parts(self, readings: Session) -> tuple[FloatArray, FloatArray]:
        """Uncertainty of predicted points in its two parts.

        Returns
        -------
        of_parameters : (n, 3, 3) array
            What the readings left open [mm^2]: the same error at the same pose, every time. It grows away from where
            the model learned.
        unexplained : (n, 3, 3) array
            What the model cannot explain [mm^2]: noise, and effects it has no term for.
        """
        self._checked_angles(readings.angles)
        of_parameters, unexplained = self._covariance_parts(readings)
        frames = self.session_frames_
        return covariances_to_session_frames(of_parameters, readings, frames), covariances_to_session_frames(
            unexplained, readings, frames
        )

    def predict_nominal(self, angles: npt.ArrayLike) -> FloatArray:
        """(n, 3) what the nominal arm gives, with the free parts fitted to the same training readings [mm]."""
        return self.predict_nominal_readings(Session(self._checked_angles(angles)))

    def predict_nominal_readings(self, readings: Session) -> FloatArray:
        """(n, 3) the same at readings, in the frames of their sessions as by `predict_readings` [mm]."""
        self._checked_angles(readings.angles)
        tips = self.nominal_.tips(state_of(self.arm_, self._with_known_sessions(readings)))
        return points_to_session_frames(tips, readings, self.session_frames_)

    def _with_known_sessions(self, readings: Session) -> Session:
        """Readings without their sessions, if the model knows of none."""
        return readings if self.session_frames_ else replace(readings, session=None)

    def outside_training(self, angles: npt.ArrayLike) -> BoolArray:
        """(n,) True where a joint is away from the angles it was trained on: the model has not seen such poses."""
        return outside_ranges(self._checked_angles(angles), self.angle_ranges_, self.angle_gaps_)

    def is_trained_on(self, readings: Session) -> bool:
        """Whether these are the readings that the model was fitted to; whatever the version that fitted it."""
        return self.data_fingerprint_ in (fingerprint(readings), *_earlier_fingerprints(readings))

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

    def _check_references(self, readings: Session, lengths: Lengths | None) -> int:
        """Refuse readings from which this model cannot learn, and count those from which it can."""
        del lengths
        if not readings.has_point.any():
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
        return len(readings)

    @abstractmethod
    def _identify(
        self,
        readings: Session,
        lengths: Lengths | None,
        progress: Callable[[int, str], None],
    ) -> None:
        """Learn from readings; `nominal_` is there already. See `fit_readings`."""

    @abstractmethod
    def _tips(self, readings: Session) -> FloatArray:
        """Tips (n, 3) [mm] at checked readings."""

    @abstractmethod
    def _covariance_parts(self, readings: Session) -> tuple[FloatArray, FloatArray]:
        """See `covariance_parts`."""

    def _checked_arm(self) -> Arm:
        if not isinstance(self.arm, Arm):
            raise InputError(f"expected an Arm, got {type(self.arm).__name__}", hint="truearm.arm.load('gao2017')")
        self._check_options()
        return self.arm

    def _checked_angles(self, angles: npt.ArrayLike) -> FloatArray:
        check_is_fitted(self)
        return np.asarray(validate_data(self, angles, reset=False, dtype=np.float64))

    def _fit_nominal(self, readings: Session, lengths: Lengths | None) -> IdentificationResult:
        """The nominal chain with base and tip, as far as they are free, fitted to the readings."""
        terms = constants(self.arm_.chain, free=self.free_, angle_std=0.0, length_std=0.0)
        state, references = state_of(self.arm_, readings), references_of(readings, lengths)
        fit_nominal = partial(self._identify_terms, readings, state, terms)
        check_sizes(readings, lengths, references, fit_nominal, state)
        return fit_nominal(references)

    def _identify_terms(
        self,
        readings: Session,
        state: ArmState,
        terms: Sequence[Term],
        references: Sequence[Reference],
        progress: Callable[[int, str], None] | None = None,
    ) -> IdentificationResult:
        """Terms, and beside them those of the tool and of the sessions' frames, identified from references."""
        return identify(
            roughly_aligned_chain(self.arm_, readings, self.free_),
            state,
            [*terms, *tool_terms(self.arm_, readings), *session_frame_terms(self.arm_.chain, self.session_frames_)],
            references,
            robust=self.robust,
            progress=progress,
        )

    def _same_nominal(self, other: Compensator) -> IdentificationResult:
        """The nominal fit of another model, if it is what this one would find."""
        check_is_fitted(other)
        names = ("arm_", "free_", "robust", "data_fingerprint_", "lengths_fingerprint_")
        if other_than := [name for name in names if getattr(self, name) != getattr(other, name)]:
            raise InputError(
                "expected a model fitted to the same readings, lengths and arm with the same options, got one with "
                f"another {other_than[0].strip('_')}"
            )
        return other.nominal_


def _silent(done: int, note: str) -> None:
    """Tell nobody."""


def fingerprint(data: Session | Lengths) -> str:
    """SHA-256 of all that readings, or lengths, say.

    Their columns in the order of their names, each with its name and its shape before it; numbers as little-endian
    doubles, row by row, names of things as UTF-8 with a zero byte after each.
    """
    columns: dict[str, Any] = {field.name: getattr(data, field.name) for field in fields(data)}
    columns |= columns.pop("columns", {})
    digest = hashlib.sha256()
    for name, values in sorted(columns.items()):
        if not isinstance(values, np.ndarray):
            continue
        digest.update(f"{name} {values.shape}\0".encode())
        if values.dtype.kind == "U":
            digest.update("".join(f"{word}\0" for word in values.tolist()).encode())
        else:
            settled = np.where(np.isnan(values), np.nan, values) + 0.0  # one NaN and one zero of the many there are
            digest.update(np.ascontiguousarray(settled, dtype="<f8").tobytes())
    return digest.hexdigest()


def _earlier_fingerprints(readings: Session) -> Iterator[str]:
    """SHA-256 of readings as models of format 3 and before have it: of angles, points and seats, or without the seats.

    A model written again keeps what it was fitted with, so the format of its file does not say which it is.
    """
    digest = hashlib.sha256()
    for array in (readings.angles, readings.points):
        if array is not None:
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    yield digest.hexdigest()
    if readings.seat is not None:
        digest.update("\n".join(readings.seat.tolist()).encode())
        yield digest.hexdigest()
