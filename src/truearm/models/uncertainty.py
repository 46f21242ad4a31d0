"""The uncertainty budget of predicted points, and its check against reference points and orientations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.findings import Finding, format_mm
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.propagation import relative_covariance
from truearm.identification.judgement.outliers import Outlier
from truearm.identification.judgement.repeating_residuals import UNKNOWN_SHARE
from truearm.identification.references.alignment import align
from truearm.identification.references.orientations import LEVER_MM
from truearm.identification.references.reading_references import rows_with_orientation
from truearm.models.compensator import CheckedReadings, Compensator, ReadingsLike
from truearm.models.identified_model import IdentifiedModel, to_identified
from truearm.readings import Session
from truearm.readings.reference_uncertainty import reference_covariance
from truearm.solve.distributions import chi2_quantile
from truearm.typing import FloatArray

# Whitened length from which a reading is far off: of Gaussian ones, one in 10^13 is.
FAR_STDS = 8.0


@dataclass(frozen=True)
class UncertaintyBudget:
    """Standard uncertainties of a coordinate of a predicted point [mm], root mean square over readings and x, y, z.

    Attributes
    ----------
    of_parameters_mm : float
        From the uncertainty of the arm's parameters.
    unexplained_mm : float
        From the residual variance.
    combined_mm : float
        Of both.
    largest_mm : float
        The largest combined one of a coordinate at a reading.
    is_relative : bool
        Whether `of_parameters_mm` is that of coordinates relative to each other, after a frame was fitted to them: for
        an arm identified without points or orientations, whose frame is arbitrary, and readings without points.
    n_points : int
        Readings with reference points.
    n_covered : int
        Those that lie in their 95 % ellipsoids, the uncertainty of the reference included, with the one that its points
        share.
    n_covered_99 : int
        Those that lie in their 99 % ellipsoids, which follow the tails of the training readings.
    std_mm : (n,) array
        Combined standard uncertainty of a coordinate at each reading, root mean square over x, y, z.
    """

    of_parameters_mm: float
    unexplained_mm: float
    combined_mm: float
    largest_mm: float
    is_relative: bool
    # U = k u with k = 2 has a coverage probability of about 95 % for a coordinate (JCGM 100:2008, 6.3.3).
    coverage_factor: ClassVar[float] = 2.0
    level: ClassVar[float] = 0.95
    # Half axes, in standard uncertainties, of an ellipsoid with that coverage probability for a point.
    ellipsoid_factor: ClassVar[float] = float(np.sqrt(chi2_quantile(0.95, 3)))
    n_points: int
    n_covered: int
    n_covered_99: int = 0
    std_mm: FloatArray = field(default_factory=lambda: np.zeros(0), compare=False, repr=False)

    @property
    def coverage(self) -> float:
        """Share of the readings with reference points that lie in their 95 % ellipsoids; NaN without any."""
        return self.n_covered / self.n_points if self.n_points else np.nan

    @property
    def expanded_mm(self) -> float:
        """Expanded uncertainty of a coordinate, k = 2 [mm]."""
        return self.coverage_factor * self.combined_mm

    @property
    def ellipsoid_mm(self) -> float:
        """Half axis of the 95 % ellipsoid of a point with equal uncertainties in all directions [mm]."""
        return self.ellipsoid_factor * self.combined_mm


def uncertainty_budget(model: Compensator, readings: ReadingsLike) -> tuple[UncertaintyBudget, tuple[Outlier, ...]]:
    """Uncertainty budget of a model at the readings of a session, and the readings that contradict it.

    Parameters
    ----------
    model : Compensator
        Fitted.
    readings : Session or CheckedReadings

    Returns
    -------
    budget : UncertaintyBudget
    far : tuple of Outlier
        Those of more than eight standard deviations, the largest first.
    """
    at = model.checked(readings)
    readings = at.session
    of_parameters, unexplained = model.covariance_parts(at)
    seen = np.flatnonzero(readings.has_point)
    is_relative = False
    identified = to_identified(model)
    if identified is not None and not len(seen) and _frame_is_arbitrary(identified):
        is_relative = True
        of_parameters = relative_covariance(identified.fit_, at.state) + model.expansion_covariance(at)
    combined = of_parameters + unexplained
    times, errors = np.zeros(0), np.zeros(0)
    if len(seen):
        assert readings.points is not None
        deviations = model.predict_readings(at)[seen] - readings.points[seen]
        spread = combined[seen] + reference_covariance(readings, is_frame_free="base" in model.free_)[seen]
        times = np.sqrt((deviations[:, None] @ np.linalg.solve(spread, deviations[:, :, None]))[:, 0, 0])
        errors = np.linalg.norm(deviations, axis=1)
    budget = UncertaintyBudget(
        of_parameters_mm=_rms_std(of_parameters),
        unexplained_mm=_rms_std(unexplained),
        combined_mm=_rms_std(combined),
        largest_mm=float(np.sqrt(_variances(combined).max())),
        is_relative=is_relative,
        n_points=len(seen),
        n_covered=int((times < UncertaintyBudget.ellipsoid_factor).sum()),
        n_covered_99=int((times < model.ellipsoid_factor(0.99)).sum()),
        std_mm=np.sqrt(_variances(combined).mean(axis=1)),
    )
    beyond = np.flatnonzero(times > FAR_STDS)
    far = [
        Outlier.of_reading(int(seen[i]), float(errors[i]), float(times[i] / np.sqrt(3)), kind="prediction")
        for i in beyond[np.argsort(-times[beyond])]
    ]
    return budget, tuple(far)


# What a cause leaves of the deviations, at most, in stated standard uncertainties.
MOST_LEFT = 3.0


def why_most_are_outliers(
    budget: UncertaintyBudget, readings: Session, predicted: FloatArray, n_outliers: int
) -> Iterator[Finding]:
    """What explains that most readings are outliers; nothing where fewer are: these are single ones."""
    seen = np.flatnonzero(readings.has_point)
    if readings.points is None or 2 * n_outliers <= len(seen):
        return
    points, T = readings.points[seen], align(predicted[seen], readings.points[seen])
    moved = predicted[seen] @ T[:3, :3].T + T[:3, 3]
    away, left = moved - moved.mean(axis=0), points - moved
    scale = float((left * away).sum() / max((away**2).sum(), np.finfo(float).tiny))
    noise = 0.0 if readings.point_std is None else float((readings.point_std[seen] ** 2).mean())
    most = MOST_LEFT * np.hypot(budget.combined_mm, np.sqrt(noise))
    if np.sqrt((left**2).mean()) <= most:
        cause = "One motion of the base or the reference explains them (truearm refit transfers the model)"
    elif np.sqrt(((left - scale * away) ** 2).mean()) <= most:
        cause = f"The distances of the reference differ by {scale:+.2%} from the model's: check its scale"
    else:
        cause = "No motion of the base explains them: a zero or the tip changed, or the points err by more than stated"
    said = f"{n_outliers} of {len(seen)} readings are outliers. {cause}."
    yield Finding("change", said, {"n": n_outliers})


# Mean length of an error whose three coordinates have a standard deviation of 1 (Maxwell distribution).
MEAN_LENGTH = float(np.sqrt(8 / np.pi))
# Instruments of more show their own errors, not the arm's, as cameras and rulers do [mm, a coordinate].
POOR_INSTRUMENT_MM = 0.2
# Mean error that a statement explains over the one seen, from which the statement is too large: noise along one axis
# alone has a mean length 1.15 times smaller than that of equal coordinates, and lengths vary by 0.42 of their mean.
SHAPE_RATIO, LENGTH_VARIATION, SURE = 1.2, 0.42, 2.0
# So many times as many readings are considered.
MORE_READINGS = 4


def what_limits(
    budget: UncertaintyBudget, readings: Session, mean_error_mm: float, model: Compensator
) -> Iterator[Finding]:
    """Which of instrument, number of readings and arm has the largest part of an error under a poor instrument.

    The mean error on readings that are not those of the training has three independent parts: the instrument's own, as
    it is stated; that of the parameters, which falls with the square root of the number of training readings; and the
    rest, which no model of the arm explains. That is of the arm or of an instrument less certain than stated: what
    repeats at like poses is an arm's. Nothing is said of training readings, whose errors a fit has reduced.
    """
    if readings.point_std is None or budget.is_relative or not budget.n_points:
        return
    noise = float(np.sqrt((readings.point_std[readings.has_point] ** 2).mean()))
    if noise < POOR_INSTRUMENT_MM or model.trained_on(readings).any():
        return
    instrument, parameters = MEAN_LENGTH * noise, MEAN_LENGTH * budget.of_parameters_mm
    most = mean_error_mm * (SHAPE_RATIO + SURE * LENGTH_VARIATION / np.sqrt(budget.n_points))
    if instrument > most:
        said = (
            f"The stated uncertainty of the instrument, {format_mm(noise)} a coordinate, exceeds the errors seen: "
            f"state it smaller. A perfect arm would show a mean error of {format_mm(instrument)}, this one shows "
            f"{format_mm(mean_error_mm)}."
        )
        yield Finding("stated uncertainty", said, {"stated_mm": noise, "mean_error_mm": mean_error_mm})
        return
    explained, trained = float(np.hypot(instrument, parameters)), _training_size(model)
    if explained > most or trained is None:
        return
    # Parts whose squares add up to that of the mean error, also where that is below what is stated by chance.
    share = min(1.0, mean_error_mm / explained)
    instrument, parameters = share * instrument, share * parameters
    arm = float(np.sqrt(max(mean_error_mm**2 - instrument**2 - parameters**2, 0.0)))
    more = float(np.sqrt(instrument**2 + arm**2 + parameters**2 / MORE_READINGS))
    parts = {"instrument": instrument, "number of readings": parameters, "arm": arm}
    largest = max(parts, key=lambda name: parts[name])
    who, (n, what) = f"the {largest}", trained
    if largest == "arm":
        causes = who, "an instrument that is less certain than stated"
        who = ", or else ".join(causes if model.repeating_share_ >= UNKNOWN_SHARE else causes[::-1]) + ","
    said = (
        f"{who[0].upper()}{who[1:]} limits you: the instrument makes {format_mm(instrument)} of the mean error "
        f"({format_mm(noise)} a coordinate), the number of {what} readings ({n}) {format_mm(parameters)}, the "
        f"rest {format_mm(arm)}; {MORE_READINGS * n} readings would give {format_mm(more)}."
    )
    numbers = {f"{name.replace(' ', '_')}_mm": value for name, value in parts.items()}
    yield Finding("what limits", said, {**numbers, "with_more_readings_mm": more})


def _training_size(model: Compensator) -> tuple[int, str] | None:
    """Number of readings of the training, or of the refits of a model that was refitted; None if it is not known."""
    identified, known = to_identified(model), model.training_.known
    if identified is None or not identified.is_refitted:
        return model.n_train_, "training"
    return None if known is None else (known.n_refit, "refit")


def _frame_is_arbitrary(model: IdentifiedModel) -> bool:
    """Whether no reference in training determined the place of the arm's frame."""
    return not {"point", "pose", "orientation"} & {reference.kind for reference in model.fit_.references}


def _rms_std(covariance: FloatArray) -> float:
    return float(np.sqrt(_variances(covariance).mean()))


def _variances(covariance: FloatArray) -> FloatArray:
    return np.diagonal(covariance, axis1=1, axis2=2)


LEVEL = 0.95


class OrientationErrors(NamedTuple):
    """Angles between predicted and measured orientations (n,) [deg], and how many are in their 95 % regions."""

    model_deg: FloatArray
    nominal_deg: FloatArray
    coverage: float

    def statistics(self) -> dict[str, dict[str, float]]:
        """Mean, root mean square, 95 % and maximum, of the nominal arm and the model."""
        return {name: {"n_orientations": len(deg), "orientation_mean_deg": float(deg.mean()),
                       "orientation_rms_deg": float(np.sqrt((deg**2).mean())),
                       "orientation_p95_deg": float(np.quantile(deg, LEVEL)), "orientation_max_deg": float(deg.max())}
                for name, deg in (("nominal", self.nominal_deg), ("model", self.model_deg))}  # fmt: skip


def orientation_errors(at: CheckedReadings) -> OrientationErrors | None:
    """Those of a model at readings; None where it did not learn how the tool is turned, or readings have none.

    A tool of another session or tip may be turned anyhow: a model of several has none either.
    """
    model, quaternion = to_identified(at.model), at.session.quaternion
    rows = rows_with_orientation(quaternion)
    if model is None or quaternion is None or not len(rows) or model.session_frames_ or len(model.tips_) > 1:
        return None
    noise = [part.noise_std / LEVER_MM for part in model.fit_.references if part.kind == "orientation"]
    if not noise:
        return None
    state, measured = at.state.rows(rows), Rotation.from_quat(quaternion[rows], scalar_first=True)

    def turned(fit: IdentificationResult) -> FloatArray:
        R = fit.perturbed_chain.poses(state, fit.coefficients).R_base_tip
        return np.asarray((Rotation.from_matrix(R) * measured.inv()).as_rotvec())

    fit, turn = model.fit_, turned(model.fit_)
    by = fit.perturbed_chain.pose_by_coefficients(state, fit.coefficients)[1][:, 3:]
    covariance = by @ fit.covariance @ by.transpose(0, 2, 1) + noise[0] ** 2 * np.eye(3)
    squares = np.einsum("ni,nij,nj->n", turn, np.linalg.inv(covariance), turn)
    inside = float((squares <= model.ellipsoid_factor(LEVEL) ** 2).mean())
    own, nominal = (np.degrees(np.linalg.norm(one, axis=1)) for one in (turn, turned(model.nominal_)))
    return OrientationErrors(own, nominal, inside)
