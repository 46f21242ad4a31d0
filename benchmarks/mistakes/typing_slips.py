"""Angles and points with a slip of the keyboard."""

from __future__ import annotations

import truearm as ta
from benchmarks.mistakes import mistake, right
from truearm.arm import Arm
from truearm.readings import Session


def readings(arm: str = "ur10", *, poses: int = 60, seed: int = 1) -> Session:
    """Readings of a virtual arm with points."""
    return ta.simulate(arm, poses=poses, seed=seed).session


def fitted(session: Session, arm: str | Arm = "ur10") -> str:
    """What a person sees of a kinematic fit."""
    return str(ta.fit(arm, session, model="kinematic"))


@right("60 readings of a UR10 as they were measured", unsaid="contradict|gross error")
def plain_session() -> str:
    return fitted(readings())


@mistake("a slip of the keyboard: two digits of a point exchanged, 9 mm in y", said=r"outlier: reading 18, error 9\.0")
def exchanged_digits() -> str:
    frame = readings().to_frame()
    frame.loc[17, "y_mm"] += 9.0
    return fitted(ta.Session.from_frame(frame))
