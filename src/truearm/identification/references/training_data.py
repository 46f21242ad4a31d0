"""What all identifications of a fit learn from: the readings in one frame, the state of the arm, the references."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Self

from truearm.arm.arm import Arm
from truearm.identification.references.reading_references import references_of, state_of
from truearm.identification.references.references import Reference
from truearm.identification.references.session_frames import to_first_session_frame
from truearm.identification.terms import ArmState
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.typing import FloatArray


class TrainingData(NamedTuple):
    """A session prepared once for all identifications of a fit.

    Attributes
    ----------
    session : Session
        All readings in one frame.
    state : ArmState
        State of the arm at them.
    references : list of Reference
        Of the readings and the lengths.
    lengths : Lengths or None
        Known lengths between their seats.
    """

    session: Session
    state: ArmState
    references: list[Reference]
    lengths: Lengths | None

    @classmethod
    def of(
        cls,
        arm: Arm,
        readings: Session,
        lengths: Lengths | None,
        *,
        frames: Mapping[str, FloatArray],
    ) -> Self:
        """Prepare readings of an arm, each session in its own frame (see `rough_session_frames`)."""
        session = to_first_session_frame(readings, frames)
        return cls(session, state_of(arm, session), references_of(session, lengths), lengths)
