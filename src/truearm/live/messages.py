"""The messages between the server and the page: JSON objects, each with the name of its class as `message`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from truearm.files.delimited import MAX_NAME

# To the page ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ReadingPoint:
    """A reading as the page draws it.

    Attributes
    ----------
    tip_mm : sequence of 3 floats
        The tip of the drawn arm at its angles, in the frame of the drawing [mm].
    joints : sequence of float
        Joint angles [deg, or mm of sliding joints].
    residual_mm : float, optional
        Distance of the measured point from the model's; None without a model or a point.
    """

    tip_mm: Sequence[float]
    joints: Sequence[float]
    residual_mm: float | None


@dataclass(frozen=True)
class Role:
    """The first message: what the client may do, and which run of the server it speaks with."""

    may_command: bool
    run: str


@dataclass(frozen=True)
class Said:
    """An event of the recording, as `truearm record --headless` prints it.

    Attributes
    ----------
    event : mapping
    reading : ReadingPoint, optional
        Of the event ``reading``.
    aim_pivots : sequence of float, optional
        Of the event ``next``: the values of the drawn arm's pivots at the plan's next pose [deg, or mm].
    """

    event: Mapping[str, Any]
    reading: ReadingPoint | None = None
    aim_pivots: Sequence[float] | None = None


@dataclass(frozen=True)
class State:
    """What a client that has just come must know, and every client when another model is in force.

    Attributes
    ----------
    drawn : mapping
        The arm: its `mechanism` and `lines` as of a scene, and whether it `is_identified`.
    readings : sequence of ReadingPoint
    learned, next : Said, optional
        The last events of these kinds.
    ended : str
        That the recording has ended.
    """

    drawn: Mapping[str, Any]
    readings: Sequence[ReadingPoint]
    learned: Said | None
    next: Said | None
    ended: str


@dataclass(frozen=True)
class Pose:
    """The arm at one moment.

    Attributes
    ----------
    joints, pivots : sequence of float
        Joint angles, and those of the drawn arm's pivots, which differ where joints are coupled [deg, or mm].
    tip_in_base_mm : sequence of 3 floats
        By the nominal arm [mm].
    corrected_mm, U_mm : sequence of 3 floats, optional
        The tip by the model, in the frame of the reference, and its expanded uncertainties (k = 2) [mm].
    not_corrected : str
        Why the model gives none.
    outside_training, is_still : bool
    to_go : sequence of float, optional
        How far each joint is from the plan's next pose [deg, or mm].
    temperature_degC : float, optional
    """

    joints: Sequence[float]
    pivots: Sequence[float]
    tip_in_base_mm: Sequence[float]
    corrected_mm: Sequence[float] | None
    U_mm: Sequence[float] | None
    not_corrected: str
    outside_training: bool
    is_still: bool
    to_go: Sequence[float] | None
    temperature_degC: float | None


@dataclass(frozen=True)
class Refused:
    """What one client asked for was not done."""

    text: str


Message = Role | State | Said | Pose | Refused


def encode(message: Message) -> str:
    """The message as JSON."""
    name = type(message).__name__.lower()
    return json.dumps({"message": name, **asdict(message)}, allow_nan=False, separators=(",", ":"))


# From the page -------------------------------------------------------------------------------------------------------


class Command(BaseModel):
    """What a person asks for; only the first client may.

    Attributes
    ----------
    command : str
        A command of `truearm record --headless`; the page does not end the recording.
    text : str
        The name of the seat, the point, or the joint angles to which a virtual arm is steered [deg, or mm].
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    command: Literal["take", "take moving", "undo", "seat", "point", "skip", "refit", "save", "steer"]
    text: Annotated[str, Field(max_length=MAX_NAME)] = ""

    @property
    def line(self) -> str:
        """The command as `Recording.on_command` takes it."""
        return f"{self.command} {self.text}".strip()
