"""Changes of the frame during a session, as a fit reports them: the line, the size, and what to do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.judgement.change_point import FrameChange, frame_change
from truearm.identification.references.session_frames import to_first_session_frame
from truearm.readings.session import Session
from truearm.typing import FloatArray


@dataclass(frozen=True)
class SessionChange:
    """A change of the frame of the reference in a session.

    Attributes
    ----------
    session : str
        Name of the session; empty if the readings name none.
    change : FrameChange
        Its rows are those of the readings that were used.
    last_before, first_after : str
        The readings on both sides of a step, as ``line 152`` and ``line 153``; of a drift the first and the last.
    first, last : str
        The readings between which the step was, at 95 % confidence.
    """

    session: str
    change: FrameChange
    last_before: str
    first_after: str
    first: str
    last: str

    def __str__(self) -> str:
        change, where = self.change, f" in session {self.session}" if self.session else ""
        if change.kind == "drift":
            return (
                f"The base or the reference drifts{where}, by {change.shift_mm:.3f} mm or more from {self.last_before} "
                f"to {self.first_after}. Let both warm up and settle, or divide the readings into sessions of an hour "
                "by names in the column session."
            )
        return (
            f"The base or the reference moved{where} between {self.last_before} and {self.first_after}, by "
            f"{change.shift_mm:.3f} mm or more (95 % interval: {self.first} to {self.last}). Enter one name up to "
            f"{self.last_before} and another from {self.first_after} in the column session, and fit again."
        )


def frame_changes(
    fit: IdentificationResult, session_frames: Mapping[str, FloatArray], session: Session
) -> Iterator[SessionChange]:
    """Test every session of the readings of a fit for a change of its frame.

    Parameters
    ----------
    fit : IdentificationResult
    session_frames : mapping of str to (4, 4) array
        Frames of the sessions, as of the model.
    session : Session
        The readings, in the order in which they were measured; without points nothing is tested.
    """
    if not session.has_point.any():
        return
    part = next(one for one in fit.references if one.kind == "point")
    points = to_first_session_frame(session, session_frames).points
    assert points is not None
    names = np.full(len(session), "") if session.session is None else session.session
    order = np.argsort(part.rows)
    for name in np.unique(names[part.rows]):
        own = order[names[part.rows[order]] == name]
        rows = part.rows[own]
        change = frame_change(session.angles[rows], points[rows], part.residuals.T[own], part.weights.T[own] ** 2, rows)
        if change is not None:
            at = int(np.searchsorted(rows, change.row))
            sides = (rows[0], rows[-1]) if change.kind == "drift" else (rows[at - 1], rows[at])
            ends = change.first_row, change.last_row
            yield SessionChange(str(name), change, *(session.called(int(row)) for row in (*sides, *ends)))
