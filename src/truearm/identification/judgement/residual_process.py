"""The residual process of a physical model: whether it is kept, and whether it belongs to the arm or to the session.

It is proposed by evidence (`truearm.identification.estimation.residual_process`) and kept if held-out readings are
predicted better with it, by more than one standard error of the paired differences and a thousandth of their error.
Readings of one session do not show whether the arm or its set-up (reference instrument, reflector, stand, drift) causes
it: it belongs to the session so far. It belongs to the arm if a session is predicted better by the process of the
others: by holding sessions out, or by a transfer to a new set-up, which otherwise leaves it behind.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np

from truearm.errors import InputError
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_process import GROUP, propose_process
from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.identification.judgement.cross_validation import cross_validate_by_group
from truearm.identification.judgement.gross_errors import excluded_readings
from truearm.identification.judgement.held_out_errors import group_means, trimmed_mean
from truearm.identification.references.alignment import align
from truearm.identification.references.cross_validation_groups import cross_validation_groups
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.references.references import Reference
from truearm.identification.terms.kernel import InducedProcess
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray

# Readings of a session that can be held out, and of those that remain.
LEAST_SESSION = 20
# Share of the mean held-out error by which it predicts better at least: of many readings a standard error is smaller.
LEAST_GAIN = 1e-3
# Sessions are held out in so many parts at most: each is an identification with and one without the process.
MOST_FOLDS = 5
OF_ARM, OF_SESSION, OF_SESSIONS = "arm", "session", "sessions"
OWNERS = {
    OF_ARM: "It belongs to the arm: it also holds in sessions that it was not learned from.",
    OF_SESSION: "It belongs to this session so far: refit keeps it only if it holds in the new set-up.",
    OF_SESSIONS: "It belongs to the sessions of the training; whether it holds in another was not tested.",
}


@dataclass(frozen=True)
class ResidualProcess:
    """What a model knows of its residual process.

    Attributes
    ----------
    belongs_to : str
        ``"arm"`` where it was tested in sessions that it was not learned from, otherwise ``"session"``, that of the
        training, or ``"sessions"``, of which too few were large enough to be held out.
    length_scales : tuple of float
        Of the joints [rad, or mm].
    n_points : int
        Number of inducing points.
    rms_mm : float
        Root mean square of its translation at the training readings.
    evidence : float
        Logarithm of the evidence that it gains, less an allowance for its two hyperparameters.
    improvement_mm, standard_error_mm : float
        By how much the error of held-out readings is smaller with it, the trimmed mean over their groups, and its
        standard error; after a transfer those of the new readings.
    residual_std_without_mm : float
        Residual standard deviation of the model without it.
    is_kept : bool
        False after a transfer that left it behind.
    is_judged : bool
        False after a transfer that kept it untested, as it did not place the base by points.
    """

    belongs_to: str
    length_scales: tuple[float, ...]
    n_points: int
    rms_mm: float
    evidence: float
    improvement_mm: float
    standard_error_mm: float
    residual_std_without_mm: float
    is_kept: bool = True
    is_judged: bool = True

    def check(self, n_joints: int) -> None:
        """Check what a file states of a process.

        Raises
        ------
        InputError
            If a number is impossible, or the process belongs to neither an arm of `n_joints` nor a session.
        """
        sizes = (self.rms_mm, self.residual_std_without_mm)
        if self.belongs_to not in OWNERS or self.n_points < 1 or len(self.length_scales) != n_joints:
            raise InputError(f"expected a residual process of the arm or the session over {n_joints} joints")
        if not (
            all(0 <= size < np.inf for size in sizes) and min(self.length_scales) > 0 and self.standard_error_mm >= 0
        ):
            raise InputError("expected sizes of a residual process of 0 or more")
        if not np.isfinite([*self.length_scales, self.evidence, self.improvement_mm]).all():
            raise InputError("expected finite numbers of a residual process")

    def after_transfer(self, improvement_mm: float, standard_error_mm: float) -> ResidualProcess:
        """The same after a transfer, which predicts the new readings so much better with it, or worse.

        A process of the arm is kept unless they speak against it by more than one standard error, that of a session
        only if they speak for it.
        """
        least = -standard_error_mm if self.belongs_to == OF_ARM else standard_error_mm
        is_kept = improvement_mm > least
        return replace(
            self,
            belongs_to=OF_ARM if is_kept else self.belongs_to,
            improvement_mm=improvement_mm,
            standard_error_mm=standard_error_mm,
            is_kept=is_kept,
            is_judged=True,
        )

    def after_transfer_untested(self) -> ResidualProcess:
        """The same after a transfer whose readings cannot show whether it holds there."""
        return replace(self, is_judged=False) if self.is_kept else self

    def __str__(self) -> str:
        change = f"{abs(self.improvement_mm):.2g} mm (standard error {self.standard_error_mm:.1g} mm)"
        if not self.is_kept:
            return (
                f"The residual process was left behind: with it the readings of the new set-up are predicted "
                f"{change} {'better' if self.improvement_mm > 0 else 'worse'}."
            )
        owner = OWNERS[self.belongs_to]
        if not self.is_judged:
            owner = (
                "It was kept, but not judged in this transfer, which did not place the base by points: it is that of "
                "the former set-up."
            )
        return (
            f"Residual process, smooth errors that no term describes: {self.rms_mm:.2g} mm root mean square; with it "
            f"held-out readings are predicted {change} better. {owner}"
        )


def add_residual_process(
    found: tuple[IdentificationResult, HeldOutReadings],
    data: PreparedReadings,
    cross_validate: Callable[[IdentificationResult], HeldOutReadings],
) -> tuple[tuple[IdentificationResult, HeldOutReadings], ResidualProcess | None]:
    """Identify the residual process as well, and keep it if held-out readings are predicted better with it.

    Parameters
    ----------
    found : (IdentificationResult, HeldOutReadings)
        Without it.
    data : PreparedReadings
    cross_validate : callable
        Returns the held-out readings of an identification.

    Returns
    -------
    found, process
        With it; as given, and None, where it is not kept.
    """
    fit, held_out = found
    sessions = data.frames
    proposed = propose_process(fit, data.state)
    if proposed is None or proposed.gain <= 0:
        return found, None
    weights = np.ones(len(data))
    weights[excluded_readings(fit)] = 0.0
    extended = _identify(data, fit, [*fit.perturbed_chain.terms, *proposed.terms], weights)
    columns = process_columns(extended)
    if not columns.any():
        return found, None
    extended_held_out = cross_validate(extended)
    gain, error = improvement(held_out, extended_held_out)
    if not gain > max(error, LEAST_GAIN * held_out.mean_mm):
        return found, None
    belongs_to = OF_SESSION if len(sessions) < 2 else OF_SESSIONS
    if named := _separable_sessions(data, sessions):
        folds = [named[first::MOST_FOLDS] for first in range(min(MOST_FOLDS, len(named)))]
        between = [_held_out_sessions(data, fold, weights, (fit, extended)) for fold in folds]
        gain, error = trimmed_mean(np.concatenate(between))
        if not gain > error:
            return found, None
        belongs_to = OF_ARM
    basis = proposed.terms[0].basis
    assert isinstance(basis, InducedProcess)
    values = basis.values(data.state)
    by_axis = extended.coefficients[columns].reshape(3, -1) @ values
    process = ResidualProcess(
        belongs_to,
        basis.length_scales,
        basis.n_functions,
        float(np.sqrt((by_axis**2).sum(axis=0).mean())),
        proposed.gain,
        gain,
        error,
        fit.references[0].noise_std,
    )
    return (extended, extended_held_out), process


def process_columns(fit: IdentificationResult) -> BoolArray:
    """(n_coefficients,) coefficients of the residual process."""
    return fit.columns_of(lambda term: term.group == GROUP)


def without_process(fit: IdentificationResult) -> IdentificationResult:
    """The arm as identified if there were no such process: its posterior, given that the process is zero."""
    drop = process_columns(fit)
    if not drop.any():
        return fit
    keep = ~drop
    gain = np.linalg.solve(fit.covariance[np.ix_(drop, drop)], fit.covariance[np.ix_(drop, keep)]).T
    marginal = fit.select(lambda term: term.group != GROUP)
    return replace(
        marginal,
        coefficients=marginal.coefficients - gain @ fit.coefficients[drop],
        covariance=marginal.covariance - gain @ fit.covariance[np.ix_(drop, keep)],
        groups=tuple(group for group in fit.groups if group.name != GROUP),
    )


def with_unspanned(held_out: HeldOutReadings, fit: IdentificationResult, state: ArmState) -> HeldOutReadings:
    """Held-out readings with the covariance of points by what processes do between their inducing points."""
    if held_out.n_coordinates < 3:
        return held_out
    return replace(held_out, covariance=held_out.covariance + fit.unspanned_covariance(state.rows(held_out.rows)))


def transfer_improvement(
    with_process: IdentificationResult,
    without: IdentificationResult,
    free: list[Term],
    readings: Session,
    state: ArmState,
    references: list[Reference],
) -> tuple[float, float]:
    """By how much readings of a new set-up are predicted better with the process, and the standard error [mm].

    Both arms were placed in it by the readings; each reading is compared with the frame that the others determine.
    """
    group = cross_validation_groups(readings)
    judged = [
        cross_validate_by_group(_only_frame_uncertain(fit, free, state), state, references, group)
        for fit in (without, with_process)
    ]
    return improvement(*judged)


def _identify(
    data: PreparedReadings, start: IdentificationResult, terms: list[Term], weights: FloatArray
) -> IdentificationResult:
    """Identify terms from a start, with weights (n,) of the readings."""
    return identify(
        start.perturbed_chain.chain,
        data.state,
        terms,
        data.references,
        robust=data.robust,
        reading_weights=weights,
        start=start,
    )


def _only_frame_uncertain(fit: IdentificationResult, free: list[Term], state: ArmState) -> IdentificationResult:
    """The result with the covariance of its free terms, the last ones, by the readings alone."""
    points = next(part for part in fit.references if part.kind == "point")
    n, weights = sum(term.n_coefficients for term in free), points.weights
    matrix = np.diag(fit.prior_std[-n:] ** -2.0)
    for rows, _, columns in fit.perturbed_chain.derivatives(state.rows(points.rows), fit.coefficients):
        weighted = (columns[-n:] * weights[:, rows]).reshape(n, -1)
        matrix += weighted @ weighted.T
    covariance = np.zeros_like(fit.covariance)
    covariance[-n:, -n:] = np.linalg.inv(matrix)
    return replace(fit, covariance=covariance)


def improvement(before: HeldOutReadings, after: HeldOutReadings) -> tuple[float, float]:
    """Trimmed mean by which the errors of common readings fall, and its standard error [mm]."""
    common = np.intersect1d(before.rows, after.rows)
    means = []
    for held_out in (before, after):
        order = np.argsort(held_out.rows)
        means.append(group_means(held_out.select(order[np.isin(held_out.rows[order], common)])))
    return trimmed_mean(means[0] - means[1])


def _separable_sessions(readings: PreparedReadings, sessions: Collection[str]) -> list[str]:
    """Sessions with enough points to be held out, if others remain."""
    names = readings.state.session
    if names is None or len(sessions) < 2:
        return []
    counts = {name: int((readings.has_point & (names == name)).sum()) for name in sessions}
    named = [name for name, count in counts.items() if count >= LEAST_SESSION]
    return named if len(named) > 1 else []


def _held_out_sessions(
    data: PreparedReadings, names: list[str], weights: FloatArray, fits: Iterable[IdentificationResult]
) -> FloatArray:
    """By how much the readings of sessions are predicted better with the process of the others [mm], by group.

    The frame of each is fitted to the tips, as the other sessions do not know it.
    """
    session = data.state.session
    assert session is not None
    assert data.points is not None
    others = np.where(np.isin(session, names), 0.0, weights)
    is_seen = data.has_point & (weights > 0)
    of_each = [np.flatnonzero(is_seen & (session == name)) for name in names]
    means = []
    for fit in fits:
        found = _identify(data, fit, list(fit.perturbed_chain.terms), others)
        of_fit = []
        for seen in of_each:
            tips, points = found.tips(data.state.rows(seen)), data.points[seen]
            T = align(tips, points)
            errors = np.linalg.norm(tips @ T[:3, :3].T + T[:3, 3] - points, axis=1)
            group = np.unique(data.groups[seen], return_inverse=True)[1]
            of_fit.append(np.bincount(group, errors) / np.bincount(group))
        means.append(np.concatenate(of_fit))
    return np.asarray(means[0] - means[1])
