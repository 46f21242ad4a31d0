"""Changes during a session, as a fit reports them: what changed at which line, its size, and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult, ReferenceFit
from truearm.identification.judgement.change_point import CLEAR_ODDS, Change, rigid_motions, session_changes
from truearm.identification.references.orientations import Poses
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.references.references import Reference
from truearm.typing import FloatArray

# Gross errors are single readings: where most of so many in a row are, something changed.
IN_A_ROW = 9
# Thousands of readings show steps that do not matter, as the warmth of a day leaves: one of less than this share of the
# residuals' root mean square explains 1 % of its square at most, and following the advice would cost more.
LEAST_SHARE = 0.2
# Readings of a session that is part of one that drifts, and sessions at most: gao2017, 120 readings that drift by 1 mm,
# leave 0.030 mm at new poses, 0.023 in 2 sessions, 0.017 in 4, 0.015 in 8, and 0.015 without a drift.
READINGS_A_SESSION, MAX_SESSIONS = 15, 8
FRAME, TIP, ZERO = "the base or the reference", "the tip", "the zero of joint {}"
DISTANCES = "the zero of the distances, or an anchor or the base (distances do not show which),"
# A frame that turns about the axis of joint 1 moves all points as the zero of that joint does.
FRAME_OR_ZERO = "the base about the axis of joint 1, or the zero of joint 1 (no reading shows which),"


@dataclass(frozen=True)
class SessionChange:
    """A change during a session.

    Attributes
    ----------
    session : str
        Name of the session; empty if the readings name none.
    change : Change
        Its rows are those of the readings that were used.
    last_before, first_after : str
        The readings on both sides of a step, as ``line 152`` and ``line 153``; of a drift the first and the last.
    first, last : str
        The readings between which the step was, at 95 % confidence.
    n_sessions : int
        Of a drift: into how many sessions of `READINGS_A_SESSION` the readings may be divided.
    is_prismatic : bool
        Whether `change` is of the zero of a joint that slides.
    """

    session: str
    change: Change
    last_before: str
    first_after: str
    first: str
    last: str
    n_sessions: int = 1
    is_prismatic: bool = False

    def __str__(self) -> str:
        change, where = self.change, f" in session {self.session}" if self.session else ""
        size = f"by {change.shift_mm:.3f} mm or more"
        if change.kind == "drift":
            what = f"{self._named()} drifts{where}, {size} from {self.last_before} to {self.first_after}."
        else:
            what = (
                f"{self._named()} moved{where} between {self.last_before} and {self.first_after}, {size} (95 % "
                f"interval: {self.first} to {self.last}){self._turned()}."
            )
        return f"{what} {self._advice()}"

    @property
    def candidates(self) -> tuple[str, ...]:
        """What may have changed, the most probable first: one, if its odds are clear."""
        odds = self.change.odds
        return tuple(what for what, share in odds.items() if share * CLEAR_ODDS > odds[self.change.what])

    @property
    def _is_of_frame(self) -> bool:
        """Whether a name for the readings on each side cures it."""
        return {*self.candidates} <= {FRAME, ZERO.format(1)}

    def _named(self) -> str:
        first, *others = self.candidates
        share = self.change.odds[first]
        if not others or self._is_of_frame:
            first = FRAME if first == FRAME else FRAME_OR_ZERO if self._is_of_frame else first
            return first[0].upper() + first[1:]
        return f"One of these ({', '.join([first, *others])}; {first} with a probability of {share:.0%})"

    def _turned(self) -> str:
        """By how much the zero of a joint changed, if it is sure which one."""
        if (len(self.candidates) > 1 and not self._is_of_frame) or self.change.what in (FRAME, TIP, DISTANCES):
            return ""
        by, what = abs(float(self.change.motion[0])), "" if self._is_of_frame else "the joint "
        return f": {what}by {by:.4f} mm" if self.is_prismatic else f": {what}by {np.degrees(by):.4f} degrees"

    def _advice(self) -> str:
        if self.change.kind == "drift":
            advice = "Let the arm and the reference warm up and settle, and measure again."
            if self._is_of_frame and self.n_sessions > 1:
                advice += (
                    f" Until then, divide the readings in their order into {self.n_sessions} sessions of equal size, "
                    "by names in the column session."
                )
            return advice
        if self._is_of_frame:
            return (
                f"Enter one name up to {self.last_before} and another from {self.first_after} in the column session, "
                "and fit again."
            )
        return (
            f"Fit again with the readings from {self.first_after} on alone, which show the arm as it is now, or with "
            f"those up to {self.last_before}, as it was: names in the column session do not help."
        )


def frame_changes(fit: IdentificationResult, readings: PreparedReadings) -> Iterator[SessionChange]:
    """Test every session of the readings of a fit for a change.

    Parameters
    ----------
    fit : IdentificationResult
    readings : PreparedReadings
        In the order in which they were measured; without points, poses or distances nothing is tested.
    """
    both = zip(fit.references, readings.references, strict=True)
    found = next((one for one in both if one[0].kind in ("point", "pose", "distance")), None)
    if found is None:
        return
    part = _of_positions(*found)
    session, named = readings.measured, readings.measured.session
    names = np.full(len(session), "") if named is None else named
    order = np.argsort(part.rows)
    for name in np.unique(names[part.rows]):
        own = order[names[part.rows[order]] == name]
        rows = part.rows[own]
        angles = session.angles[rows]
        if readings.points is None or part.kind == "distance":
            motions = {DISTANCES: np.eye(3)[None, :, :1].repeat(len(rows), axis=0)}
        else:
            motions = _motions(fit, angles, readings.points[rows])
        robust = np.ones(len(part.rows))
        robust[own] = _of_single_errors(part.robust_weight[own])
        weights, residuals = (
            # A distance counts as one axis of a point of which the others were not measured.
            np.pad(values.T[own], [(0, 0), (0, 3 - len(values))])
            for values in (replace(part, robust_weight=robust).weights ** 2, part.residuals)
        )
        of_all_mm = np.sqrt(np.average((residuals**2).sum(axis=1), weights=part.robust_weight[own]))
        for change in session_changes(angles, motions, residuals, weights, rows):
            if change.shift_mm < LEAST_SHARE * of_all_mm:
                continue
            at = int(np.searchsorted(rows, change.row))
            sides = (rows[0], rows[-1]) if change.kind == "drift" else (rows[at - 1], rows[at])
            ends = change.first_row, change.last_row
            before, after, first, last = (session.called(int(row)) for row in (*sides, *ends))
            n_sessions = min(len(rows) // READINGS_A_SESSION, MAX_SESSIONS)
            slides = [ZERO.format(joint + 1) for joint in np.flatnonzero(fit.chain.is_prismatic)]
            yield SessionChange(str(name), change, before, after, first, last, n_sessions, change.what in slides)


def _of_positions(part: ReferenceFit, reference: Reference) -> ReferenceFit:
    """The residuals of poses by their positions along the axes of the reference; those of others as they are."""
    if not isinstance(reference, Poses):
        return part
    U = reference.principal_axes
    variance = np.einsum("mij,jm->im", U**2, part.std[:3] ** 2)
    return replace(part, residuals=np.einsum("mij,jm->im", U, part.residuals[:3]), std=np.sqrt(variance))


def _motions(fit: IdentificationResult, angles: FloatArray, points: FloatArray) -> dict[str, FloatArray]:
    """Displacements of the points by what may change: the frame, the tip, the zero of each joint."""
    pose, jacobian = fit.chain.pose_jacobians(angles)
    zeros = {ZERO.format(joint + 1): jacobian[:, :3, joint : joint + 1] for joint in range(angles.shape[1])}
    return {FRAME: rigid_motions(points), TIP: pose.R_base_tip, **zeros}


def _of_single_errors(robust_weight: FloatArray) -> FloatArray:
    """Robust weights (n,) of readings in their order; 1 where most of their neighbours have small ones too.

    If a frame moves, its readings on one side fit none on the other: a fit without gross errors excludes them.
    """
    excluded = robust_weight < 0.5
    near = np.ones(min(IN_A_ROW, len(robust_weight)))
    share = np.convolve(excluded, near, "same") / np.convolve(np.ones(len(excluded)), near, "same")
    return np.where(excluded & (share > 0.5), 1.0, robust_weight)
