"""The contract of all models of an arm: scikit-learn regressors from joint angles to tip positions."""

from __future__ import annotations

import copy
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeAlias, cast, overload

import numpy as np
import numpy.typing as npt

from truearm.acceptance import Acceptance, accepted, accepted_in_fit, accepting_afresh
from truearm.arm.arm import Arm
from truearm.choices import Conditions
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.findings import NO_FINDINGS
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import NONE_HELD_OUT
from truearm.identification.estimation.tip_offsets import of_one_tip
from truearm.identification.identify import Found, Progress, judge_description, place
from truearm.identification.judgement.description_check import explaining
from truearm.identification.judgement.nominal_check import UNCHECKED
from truearm.identification.judgement.repeating_residuals import UNKNOWN_SHARE
from truearm.identification.judgement.stated_uncertainty import counts_rounding
from truearm.identification.judgement.tails import ellipsoid_factor
from truearm.identification.references.prepared_readings import MIN_ROWS, PreparedReadings
from truearm.identification.references.reading_references import state_of
from truearm.identification.references.session_frames import (
    covariances_to_session_frames,
    displacements_to_session_frames,
    points_to_session_frames,
)
from truearm.identification.references.tips import check_tips
from truearm.identification.terms import ArmState
from truearm.identification.terms.links import UNKNOWN_MATERIAL, link_vectors
from truearm.models.arm_check import (
    check_has_kinematics,
    check_readings_of,
    read_by,
    with_read_angles,
    with_serial_number,
)
from truearm.models.estimator import Regressor
from truearm.models.model_archive import model_bytes
from truearm.models.training_conditions import TrainingConditions, TrainingReadings
from truearm.readings.lengths import Lengths
from truearm.readings.repeats import merge_repeats
from truearm.readings.session import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray

FREE_PARTS = ("base", "tip")
# Share of readings from which on they are those of the training.
MOST_KNOWN = 0.5


class CheckedReadings(NamedTuple):
    """Readings that a model can predict, checked once (see `Compensator.checked`), and the state of the arm at them."""

    model: Compensator
    session: Session
    state: ArmState

    def rows(self, which: IntArray | BoolArray) -> CheckedReadings:
        """Some of the readings."""
        return CheckedReadings(self.model, self.session.rows(which), self.state.rows(which))


ReadingsLike: TypeAlias = Session | CheckedReadings


class Compensator(Regressor, ABC):
    """Base of the models: from joint angles to coordinates of the tip.

    A subclass defines how it learns (`_fit`), predicts (`_tips`) and how uncertain that is (`_covariance_parts`).
    Checks, training conditions, frames of sessions and the nominal arm to compare with are the same for all.

    Attributes
    ----------
    arm_ : Arm
        The arm it was fitted for.
    free_ : tuple of str
        The free parts that the readings determine: without reference points the base stays nominal.
    training_ : TrainingConditions
        What the training readings were: number, angles, temperature, loads, fingerprint.
    nominal_check_ : NominalCheck
        How far the nominal arm misses its readings, and how far nominal arms usually do; of the last `fit`, not in a
        model file.
    session_frames_ : dict of str to (4, 4) array
        For readings of several sessions, each with its own frame: by the session's name the rough rigid motion of its
        points into the frame of the first (see `session_frames`). Empty for one session.
    nominal_ : IdentificationResult
        The nominal arm with only the free parts (base, tip) identified from the same readings: the state before
        compensation.
    held_out_ : HeldOutReadings
        Training readings as predicted without their position or seat, if any; not in a model file.
    fit_seconds_ : float
        Duration of `fit` [s].
    tips_ : tuple of str
        Names of the tips on the flange, in the order of the readings (see `with_tip`); empty if none was named.
    accepted_ : tuple of Acceptance
        Contradictions in its readings that a person accepted (see `truearm.accepting`).
    arm_doubt_ : str
        What is doubtful about the nominal arm or its scale by the training readings; empty if nothing, and of older
        files.
    findings_ : tuple of Finding
        What a person must know of what was identified; not in a model file.
    repeating_share_ : float
        Share of the residual variance that is the same at the same pose; the rest is the noise of one reading
        (`truearm.identification.judgement.repeating_residuals`). 1/2 where it is not known, and of older files.
    """

    kind: ClassVar[str]
    # The reader of model files, which knows all models: `model_file` sets it.
    _load: ClassVar[Callable[[Path], object]]
    """Its name in a model file, and in the options of commands."""

    arm: Arm
    free: tuple[str, ...]
    robust: bool = True

    arm_: Arm
    free_: tuple[str, ...]
    training_: TrainingConditions
    session_frames_: dict[str, FloatArray]
    nominal_: IdentificationResult
    fit_seconds_: float
    tips_: tuple[str, ...] = ()
    accepted_: tuple[Acceptance, ...] = ()
    arm_doubt_: str = ""
    repeating_share_: float = UNKNOWN_SHARE

    tail_freedom_ = float("inf")
    nominal_check_ = UNCHECKED
    findings_ = NO_FINDINGS
    held_out_ = NONE_HELD_OUT
    held_out_gross_ = NONE_HELD_OUT
    held_out_distances_ = NONE_HELD_OUT

    outside_note: ClassVar[str] = ": their errors may be larger than stated"
    """What to make of points outside the trained range, whose standard uncertainty is ``u``."""

    @one_blas_thread()
    @accepting_afresh()
    def fit(self, X: npt.ArrayLike, y: npt.ArrayLike, sample_weight: npt.ArrayLike | None = None) -> Self:
        """Learn from joint angles and reference points.

        Parameters
        ----------
        X : (n, n_joints) array or DataFrame
            Joint angles [rad], displacements of sliding joints [mm].
        y : (n, 3) array
            The tip in the frame of the reference [mm].
        sample_weight : (n,) array, optional
            Weights proportional to one over the variance of a point; readings of weight 0 are not used.

        Raises
        ------
        InputError
            If shapes do not fit the arm, numbers are not finite, readings are too few, or the unit of angles or points
            cannot be right.
        """
        from sklearn.utils.validation import _check_sample_weight, validate_data

        angles, points = validate_data(
            self, X, y, multi_output=True, y_numeric=True, dtype=np.float64, ensure_min_samples=MIN_ROWS
        )
        if np.ndim(points) != 2 or points.shape[1] != 3:
            raise InputError(f"expected points of shape (n, 3), x y z in mm, got {np.shape(points)}")
        session = Session(angles, np.asarray(points, dtype=float))
        if sample_weight is None:
            return self.fit_readings(session)
        return self._fit_weighted(session, _check_sample_weight(sample_weight, X, ensure_non_negative=True))

    @one_blas_thread()
    @accepting_afresh()
    def fit_readings(
        self,
        readings: Session,
        *,
        lengths: Lengths | None = None,
        progress: Callable[[int, str], None] | None = None,
        nominal: Compensator | None = None,
    ) -> Self:
        """Learn from a session: reference points with their uncertainties, seats, surfaces, and lengths between seats.

        Parameters
        ----------
        readings : Session
            A network needs a reference point at every reading. The other models use every reference there is. Repeats
            of a pose are merged (`truearm.readings.repeats`): rows of what is held out are those of their means.
        lengths : Lengths, optional
            Known lengths between seats of the session.
        progress : callable, optional
            Called with the steps done and a note.
        nominal : Compensator, optional
            A simpler model fitted to the same readings of the same arm, with the same free parts and lengths: its
            `nominal_` is used and not fitted again, and the readings that it excludes are excluded at first.

        Raises
        ------
        InputError
            As `fit`; also if the readings have no reference, a known length or distance is far from that of the
            nominal arm (`check_sizes`), or `nominal` was fitted to something else.
        """
        arm = self._checked_arm()
        check_readings_of(arm, readings)
        with_serial_number(arm, readings)
        merged = merge_repeats(readings).readings
        return self.learn(self.prepare(merged, lengths), progress=progress, nominal=nominal).judged()

    def judged(self) -> Self:
        """Itself, with all worked out that `learn` leaves until it is asked for: only a model that is kept needs it."""
        return self

    def prepare(self, readings: Session, lengths: Lengths | None = None) -> TrainingReadings:
        """Readings whose angles were checked (`check_readings_of`), prepared to `learn` from; see `fit_readings`."""
        arm = self._checked_arm()
        self._check_references(readings, lengths)
        read = with_read_angles(arm, readings)
        return TrainingReadings.of(arm, read, lengths, free=self.free, robust=self.robust)

    @one_blas_thread()
    def learn(
        self,
        readings: TrainingReadings,
        *,
        progress: Callable[[int, str], None] | None = None,
        nominal: Compensator | None = None,
    ) -> Self:
        """Learn from readings that this or a simpler model has prepared; see `fit_readings`."""
        begun = time.perf_counter()
        self._set_conditions(readings)
        if nominal is None:
            with explaining(readings.arm, readings.table, readings.measured.file):
                placed = self._place(readings)
            if readings.arm.has_kinematics:
                self.nominal_check_ = judge_description(readings, placed.fit)
        else:
            placed, self.nominal_check_ = Found(self._nominal_of(nominal), NONE_HELD_OUT), nominal.nominal_check_
        self.nominal_ = placed.fit
        self._fit(readings, placed, nominal, progress or no_progress)
        check, scales = self.nominal_check_, [one for one in self.findings_ if one.what == "length scale"]
        scales += () if check.axis_scale is None else check.axis_scale.findings()
        self.arm_doubt_ = " ".join(filter(None, [check.doubt, *map(str, scales)]))
        self.accepted_ = accepted(() if nominal is None else nominal.accepted_)
        self._keep_rounding(readings)
        self.fit_seconds_ = time.perf_counter() - begun
        return self

    def doubts(self, which: str = "") -> tuple[str, ...]:
        """What whoever uses the model must know of its fit: what was accepted, and what is doubtful of its arm."""
        of_arm = [f"Of {which}: {self.arm_doubt_}" if which else self.arm_doubt_] if self.arm_doubt_ else []
        return (*accepted_in_fit(self.accepted_, which or "the model"), *of_arm)

    def under(self, conditions: Conditions) -> Self:
        """The model with the uncertainty of certain conditions; its points are the same.

        Parameters
        ----------
        conditions : {"reproducibility", "repeatability"}
            As fitted (JCGM 200:2012, 2.24): of any day on which the arm may be used, its bearings settled otherwise,
            its links behind the thermometer by up to a kelvin. Or (2.20) of the day and the set-up of the training
            readings, whose links follow the thermometer as they did. After a transfer, of a nominal model, of a network
            and of models from older files the two are one.

        Returns
        -------
        Compensator
            Itself where that makes no difference.
        """
        self._check_fitted()
        arm = self.identified_arm
        if conditions == "reproducibility" or arm is None or arm.repeatability_covariance is None:
            return self
        new: Any = copy.copy(self)
        new.fit_ = arm.under_repeatability_conditions()
        return cast("Self", new)

    @overload
    def predict(self, X: ReadingsLike | npt.ArrayLike, *, return_cov: Literal[False] = False) -> FloatArray: ...

    @overload
    def predict(
        self, X: ReadingsLike | npt.ArrayLike, *, return_cov: Literal[True]
    ) -> tuple[FloatArray, FloatArray]: ...

    def predict(
        self, X: ReadingsLike | npt.ArrayLike, *, return_cov: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Corrected coordinates.

        Parameters
        ----------
        X : (n, n_joints) array, DataFrame or Session
            Joint angles [rad], displacements of sliding joints [mm]. Of a session all that the model uses: see
            `predict_readings`.
        return_cov : bool
            Whether to return the covariance too.

        Returns
        -------
        points : (n, 3) array
            The tip in the frame of the reference [mm]; of several sessions, in that of the first.
        covariance : (n, 3, 3) array, if `return_cov`
            Of the tip [mm^2], without the uncertainty of a reference point to compare it with. See `outside_training`
            for readings outside the trained range.

        Raises
        ------
        InputError
            If numbers are not finite, or most angles lie outside the limits of their joints.
        """
        at = self._checked_angles(X)
        return self.predict_readings(at, return_cov=True) if return_cov else self.predict_readings(at)

    def checked(self, readings: ReadingsLike) -> CheckedReadings:
        """Readings of the arm that the model can predict; those that are checked already as they are.

        Every method below takes either. Checked once, they serve all of them.

        Raises
        ------
        InputError
            If the model is not fitted, or the readings are of another arm, mostly beyond the limits of a joint, far
            outside the trained range, or of a tip that it does not know.
        """
        if isinstance(readings, CheckedReadings):
            if readings.model is self:
                return readings
            readings = readings.session  # another model knows other tips and other mean loads
        self._check_fitted()
        check_readings_of(self.arm_, readings)
        return self.at(readings)

    def at(self, readings: Session) -> CheckedReadings:
        """Readings whose angles were checked (`check_readings_of`), if the model can predict them; see `checked`."""
        readings = read_by(self.arm_, readings)
        check_tips(self.tips_, readings)
        self.training_.refuse_far(readings, self.arm_.chain.is_prismatic)
        return CheckedReadings(self, readings, self.state(readings))

    def state(self, readings: Session) -> ArmState:
        """State of the arm at readings, as far as the model's terms depend on it.

        Temperatures and loads that the readings do not state are the mean of the training; directions of movement are
        half way between the two. `unstated_input_covariances` has the uncertainty of that.
        """
        temperature = self.training_.temperature_degC
        return state_of(
            self.arm_,
            # A model that was trained on one session knows no names of others.
            readings if self.session_frames_ or readings.session is None else replace(readings, session=None),
            temperature_degC=None if temperature is None else temperature.mean,
            columns={name: known.mean for name, known in self.training_.columns.items()},
            direction=0.0,
        )

    def state_in_training(self, readings: TrainingReadings) -> ArmState:
        """The `state` at the readings that it was fitted to."""
        state = readings.state_as_read
        directions = np.zeros(state.angles.shape) if state.directions is None else state.directions
        return replace(state, directions=directions, session=state.session if self.session_frames_ else None)

    @overload
    def predict_readings(self, readings: ReadingsLike, *, return_cov: Literal[False] = False) -> FloatArray: ...

    @overload
    def predict_readings(
        self, readings: ReadingsLike, *, return_cov: Literal[True]
    ) -> tuple[FloatArray, FloatArray]: ...

    @one_blas_thread()
    def predict_readings(
        self, readings: ReadingsLike, *, return_cov: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Corrected coordinates at the readings of a session, with its temperatures, loads and directions of movement.

        Readings of a session that the model was trained on (`session_frames_`) are predicted in its frame, all others
        in that of the first. `predict` of bare angles uses the mean temperature and loads of the training, and the
        middle between the two directions of movement.
        """
        at = self.checked(readings)
        tips, parts = self._tips_and_covariance_parts(at) if return_cov else (self._tips(at.state), None)
        points = points_to_session_frames(tips, at.session.session, self.session_frames_)
        return points if parts is None else (points, np.add(*self._completed(at, *parts)))

    @one_blas_thread()
    def covariance_parts(self, readings: ReadingsLike) -> tuple[FloatArray, FloatArray]:
        """Covariance of predicted points in its two parts.

        That of one reading, as a person measures it: of means of repeats (`truearm.readings.repeats`) that of the mean.

        Returns
        -------
        of_parameters : (n, 3, 3) array
            From the parameters that the readings did not determine [mm^2]: the same error at the same pose, every time.
            It grows outside the trained angles and temperatures.
        unexplained : (n, 3, 3) array
            From what the model does not explain [mm^2]: noise, effects without a term, inputs that are not stated.
        """
        at = self.checked(readings)
        return self._completed(at, *self._covariance_parts(at))

    def _completed(
        self, at: CheckedReadings, of_parameters: FloatArray, unexplained: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The parts of `_covariance_parts` with the expansion outside the trained temperatures, in session frames."""
        if (growth := self._expansion_displacements(at.session)).size:
            of_parameters = of_parameters + _covariances(growth)
        frames = self.session_frames_
        return covariances_to_session_frames(of_parameters, at.session.session, frames), covariances_to_session_frames(
            unexplained, at.session.session, frames
        )

    @one_blas_thread()
    def shared_displacements(self, readings: ReadingsLike) -> FloatArray:
        """Errors of predicted points that readings have in common, as far as the model knows them.

        The uncertainty of a distance between points, or of their scatter, needs the covariances between readings. The
        part `of_parameters` of `covariance_parts` is the sum of the products of these displacements, and of a rest that
        is taken as independent from reading to reading.

        Returns
        -------
        (k, n, 3) array
            Displacements of the points by k independent causes of variance one [mm]; k may be 0.
        """
        at = self.checked(readings)
        displacements = [self._shared_displacements(at), self._expansion_displacements(at.session)]
        return displacements_to_session_frames(np.concatenate(displacements), at.session.session, self.session_frames_)

    @property
    def identified_arm(self) -> IdentificationResult | None:
        """The identified arm in the model, with its residuals; None where there is none."""
        fit: IdentificationResult | None = getattr(self, "fit_", None)
        return fit

    @property
    def identifies_constants(self) -> bool:
        """Whether it has an arm of its own constants: not a network, nor a model with the nominal arm as it is."""
        return self.identified_arm is not None and self.kind != "nominal"

    def facts(self) -> dict[str, Any]:
        """What records state of the model, beside its errors and its terms."""
        return {}

    def unstated_input_covariances(self, readings: ReadingsLike) -> dict[str, FloatArray]:
        """Tip covariance from inputs of the terms that the readings do not state: none of a model without terms."""
        del readings
        return {}

    def ellipsoid_factor(self, level: float) -> float:
        """Half axis, in standard uncertainties, of the ellipsoid that contains a point with probability `level`.

        At 95 % it is 2.80, as for Gaussian errors, and beyond as much larger as the held-out readings scatter farther.
        """
        return ellipsoid_factor(level, freedom=self.tail_freedom_)

    def expansion_covariance(self, readings: ReadingsLike) -> FloatArray:
        """Covariance of the tip from growth of the arm outside the trained temperatures, where no term describes it.

        Base and tip were identified with the arm as long as it is at the trained temperatures; dT beyond them each link
        v is longer by alpha dT v. Its alpha has the prior of an arm of unknown material (`UNKNOWN_MATERIAL`): an
        uncorrected error (JCGM 100:2008, F.2.4.5) of standard uncertainty m that all links share, and d of each. With
        the tip at r = sum of all v: ``dT^2 (m^2 r r^T + d^2 sum v v^T)``. Where the training states no temperature, it
        is assumed to be 20 degC.

        Returns
        -------
        (n, 3, 3) array
            [mm^2]; zeros inside the temperatures that all links had in training, where the session states none, and of
            a model with terms for growth.
        """
        return _covariances(self._expansion_displacements(self.checked(readings).session))

    def _expansion_displacements(self, readings: Session) -> FloatArray:
        """(l, n, 3) the same as displacements of the tips by l independent expansions of variance one [mm]."""
        kelvin = self.training_.kelvin_beyond_links(readings)
        rows = np.flatnonzero(kelvin)
        if not len(rows) or self._has_thermal_terms():
            return np.zeros((0, len(readings), 3))
        jacobian = self.nominal_.chain.tip_derivatives(readings.angles[rows]).motion_jacobian
        links = np.einsum("li,nlix->lnx", link_vectors(self.arm_.chain), jacobian[:, :-1, 3:])
        shared = UNKNOWN_MATERIAL.common_per_K * links.sum(axis=0, keepdims=True)
        links = np.concatenate([UNKNOWN_MATERIAL.own_per_K * links, shared])
        out = np.zeros((len(links), len(readings), 3))
        out[:, rows] = kelvin[rows, None] * links
        return out

    def predict_nominal(self, angles: ReadingsLike | npt.ArrayLike) -> FloatArray:
        """(n, 3) tips of the nominal arm, its free parts identified from the same training readings [mm]."""
        return self.predict_nominal_readings(self._checked_angles(angles))

    @one_blas_thread()
    def predict_nominal_readings(self, readings: ReadingsLike) -> FloatArray:
        """(n, 3) the same at the readings of a session, in the frames of `predict_readings` [mm]."""
        check_has_kinematics(self.arm_, "nominal points need")
        at = self.checked(readings)
        return points_to_session_frames(self.nominal_.tips(at.state), at.session.session, self.session_frames_)

    def share_of_mean(self, readings: Session) -> FloatArray:
        """(n,) share of the residual variance of one reading that readings have: less than 1 for means of repeats."""
        if readings.n_repeats is None:
            return np.ones(len(readings))
        return np.asarray(self.repeating_share_ + (1 - self.repeating_share_) / readings.n_repeats)

    def nominal_error(self) -> float:
        """Mean distance of the nominal arm from the references of its training [mm]; NaN after reading a file."""
        residuals = [np.linalg.norm(reference.residuals, axis=0) for reference in self.nominal_.references]
        distances = np.concatenate(residuals)
        return float(distances.mean()) if len(distances) else float("nan")

    def outside_training(self, X: ReadingsLike | npt.ArrayLike) -> BoolArray:
        """(n,) True where an input of a session, or a joint angle (n, n_joints), lies outside the trained range."""
        session = self._session_of(X)
        none = np.zeros(len(session), dtype=bool)
        outside = self.training_.outside(session, self.arm_.chain.is_prismatic).values()
        return np.asarray(np.logical_or.reduce([none, *outside]))

    def inputs_outside_training(self, X: ReadingsLike | npt.ArrayLike) -> dict[str, BoolArray]:
        """Inputs outside the trained range, by name: J1 to Jn, temperature, further columns.

        See `TrainingConditions.outside`.
        """
        return self.training_.outside(self._session_of(X), self.arm_.chain.is_prismatic)

    def trained_on(self, readings: Session) -> BoolArray:
        """(n,) Which readings the model was fitted or refitted to, by what was measured: pose and reference.

        Of a fit to more than 500 readings as many are known, evenly spaced.
        """
        return self.training_.among(with_read_angles(self.arm_, readings), self.arm_.chain.is_prismatic)

    def skipped_in_tests(self, readings: Session) -> BoolArray:
        """(n,) The same, of a fit of which but a sample is known those of refits alone."""
        return self.training_.all_among(with_read_angles(self.arm_, readings), self.arm_.chain.is_prismatic)

    def is_trained_on(self, readings: Session) -> bool:
        """Whether the model was fitted or refitted to most of these readings."""
        return self.training_.readings_per_known * float(self.trained_on(readings).mean()) > MOST_KNOWN

    def with_tip(self, name: str) -> Self:
        """The model of one of its tips, which predicts it without a column `tip`."""
        new = copy.copy(self)
        new.tips_ = (name,)
        for part in ("nominal_", "fit_"):
            if hasattr(new, part):
                setattr(new, part, of_one_tip(getattr(self, part), name, self.tips_))
        return new

    def save(self, path: str | Path) -> None:
        """Write the fitted model to one file, whole or not at all; `truearm.models.load_model` reads it.

        Parameters
        ----------
        path : path
            Any name; ``.truearm`` is usual.

        Raises
        ------
        InputError, TruearmError
            If the model is not fitted, of a class of your own, or larger than a model file may be; if the file cannot
            be written.
        ProgramFault
            If `load_model` would refuse the file; a file of the name stays.
        """
        content = model_bytes(self)
        with atomic_file(path, read=type(self)._load) as beside:
            beside.write_bytes(content)

    @property
    def n_train_(self) -> int:
        """Number of training readings."""
        return self.training_.n_readings

    @property
    def angle_ranges_(self) -> FloatArray:
        """(n_joints, 2) smallest and largest training angle of every joint [rad, or mm]."""
        return self.training_.angle_ranges

    @property
    def data_fingerprint_(self) -> str:
        """SHA-256 of the readings it was fitted to last."""
        return self.training_.fingerprint

    @property
    def lengths_fingerprint_(self) -> str:
        """SHA-256 of the known lengths between their seats; empty without."""
        return self.training_.lengths_fingerprint

    def __sklearn_tags__(self) -> Any:
        """Three outputs, never one; and a poor score on data that no arm could have made."""
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True
        tags.target_tags.multi_output = True
        tags.target_tags.single_output = False
        return tags

    def _place(self, readings: PreparedReadings) -> Found:
        """The nominal arm, placed; readings are held out where its gross errors are judged."""
        return Found(place(readings), NONE_HELD_OUT)

    @abstractmethod
    def _fit(self, readings: PreparedReadings, placed: Found, simpler: Compensator | None, progress: Progress) -> None:
        """Learn from readings; `nominal_`, the arm `placed`, and `training_` are set. See `learn`.

        `simpler` is fitted to the same readings.
        """

    def _fit_weighted(self, readings: Session, weight: FloatArray) -> Self:
        """Learn from readings with points whose variances are as one over `weight` (n,); networks need equal ones."""
        if (weight == weight[0]).all():
            return self.fit_readings(readings)
        raise InputError(
            f"a {self.kind} model does not use sample_weight: its trainers minimise the mean square of all errors",
            hint="repeat readings, or weigh them in a kinematic or physical model",
        )

    @abstractmethod
    def _tips(self, state: ArmState) -> FloatArray:
        """(n, 3) tips [mm], in the frame of the first session."""

    @abstractmethod
    def _covariance_parts(self, at: CheckedReadings) -> tuple[FloatArray, FloatArray]:
        """See `covariance_parts`, without the expansion outside the trained temperatures."""

    def _tips_and_covariance_parts(self, at: CheckedReadings) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
        """`_tips` and `_covariance_parts`, which may depend on the same functions of the state."""
        return self._tips(at.state), self._covariance_parts(at)

    def _shared_displacements(self, at: CheckedReadings) -> FloatArray:
        """See `shared_displacements`, in the frame of the first session and without the expansion."""
        return np.zeros((0, len(at.session), 3))

    def _has_thermal_terms(self) -> bool:
        """Whether the model has learned how the arm grows with temperature."""
        return False

    def _check_options(self) -> None:
        """Refuse options that no fit could follow."""
        unknown = set(self.free) - set(FREE_PARTS)
        if unknown:
            raise InputError(f"expected free parts among {list(FREE_PARTS)}, got {sorted(unknown)}")

    def _check_references(self, readings: Session, lengths: Lengths | None) -> None:
        """Refuse readings from which this model cannot learn; by default every reference serves."""

    def _set_conditions(self, readings: TrainingReadings) -> None:
        """Keep what is known of readings before anything is identified from them."""
        arm = self.arm_ = readings.arm
        self.n_features_in_, self.tips_ = arm.n_joints, readings.tips
        self.free_, self.session_frames_ = readings.free, dict(readings.frames)
        self.training_ = readings.conditions

    def _keep_rounding(self, readings: PreparedReadings) -> None:
        """Keep the uncertainty of rounded angles, where the readings scatter as if they were rounded."""
        if self.identified_arm is not None and counts_rounding(readings, self.identified_arm):
            self.training_ = replace(self.training_, angle_std=readings.state.angle_std)

    def _checked_arm(self) -> Arm:
        if not isinstance(self.arm, Arm):
            raise InputError(f"expected an Arm, got {type(self.arm).__name__}", hint="load_arm(name or path) gives one")
        self._check_options()
        if self.kind != "network":
            check_has_kinematics(self.arm, f"a {self.kind} model needs")
        return self.arm

    def _session_of(self, X: ReadingsLike | npt.ArrayLike) -> Session:
        """Checked readings; of angles alone those far outside and of no tip too, which are judged and not predicted."""
        if isinstance(X, Session | CheckedReadings):
            return self.checked(X).session
        self._check_fitted()
        return with_read_angles(self.arm_, Session(self._checked_table(X)))

    def _checked_angles(self, angles: ReadingsLike | npt.ArrayLike) -> CheckedReadings:
        if isinstance(angles, Session | CheckedReadings):
            return self.checked(angles)
        self._check_fitted()
        return self.checked(Session(self._checked_table(angles)))

    def _nominal_of(self, other: Compensator) -> IdentificationResult:
        """The nominal fit of another model of the same readings with the same options."""
        other._check_fitted()
        names = ("arm_", "free_", "robust", "data_fingerprint_", "lengths_fingerprint_")
        if different := [name for name in names if getattr(self, name) != getattr(other, name)]:
            raise InputError(
                "expected a model fitted to the same readings, lengths and arm with the same options, got one with "
                f"another {different[0].strip('_')}"
            )
        return other.nominal_


def _covariances(displacements: FloatArray) -> FloatArray:
    """(n, 3, 3) of independent displacements (l, n, 3)."""
    return np.asarray(np.einsum("lnx,lny->nxy", displacements, displacements))


def no_progress(done: int, note: str) -> None:
    """Report nothing."""
