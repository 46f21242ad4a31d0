"""What the server and its clients say to each other, as JSON.

On the WebSocket each message of the server has the name of its class as `message`. The HTTP operations take and answer
the others, and `/openapi.json` describes them from these classes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from truearm.files.delimited import MAX_NAME
from truearm.wings.bench.sources.joint_scale import MOST_JOINTS
from truearm.wings.bench.sources.line_pattern import LARGEST
from truearm.wings.exports.targets import Frame, TargetDirection, Untrained

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
    """What the client may do, and which run of the server it speaks with: the first message, and at every change.

    Attributes
    ----------
    may_command : bool
    is_asked : bool
        Whether another client asks for the command, which this one may give.
    asks : bool
        Whether this one asked.
    is_free : bool
        Whether no client commands: the next that asks does.
    run : str
    """

    may_command: bool
    is_asked: bool
    asks: bool
    is_free: bool
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
    learned, next, model : Said, optional
        The last events of these kinds.
    uncertainties_mm : sequence of (int, float)
        The number of readings, and how well the arm was known with them: the uncertainty of a point in the volume [mm].
    events : sequence of Said
        The last other events, the newest last.
    files : mapping of str to str
        What was written so far: ``session``, ``model``; and the ``plan``.
    ended : str
        That the recording has ended.
    """

    drawn: Mapping[str, Any]
    readings: Sequence[ReadingPoint]
    learned: Said | None
    next: Said | None
    model: Said | None
    uncertainties_mm: Sequence[tuple[int, float]]
    events: Sequence[Said]
    files: Mapping[str, str]
    ended: str


@dataclass(frozen=True)
class Tip:
    """Where the tip is at some joint angles.

    Attributes
    ----------
    tip_in_base_mm : sequence of 3 floats
        By the nominal arm [mm].
    corrected_mm, U_mm : sequence of 3 floats, optional
        By the model, in the frame of the reference, and its expanded uncertainties (k = 2) [mm].
    not_corrected : str
        Why the model gives none.
    outside_training : bool
        Whether an input is outside the trained range.
    """

    tip_in_base_mm: Sequence[float]
    corrected_mm: Sequence[float] | None
    U_mm: Sequence[float] | None
    not_corrected: str
    outside_training: bool


@dataclass(frozen=True)
class Pose(Tip):
    """The arm at one moment.

    Attributes
    ----------
    joints, pivots : sequence of float
        Joint angles, and those of the drawn arm's pivots, which differ where joints are coupled [deg, or mm].
    is_still : bool
    is_fitting : bool
        Whether a fit is under way.
    to_go : sequence of float, optional
        How far each joint is from the plan's next pose [deg, or mm].
    temperature_degC : float, optional
    """

    joints: Sequence[float]
    pivots: Sequence[float]
    is_still: bool
    is_fitting: bool
    to_go: Sequence[float] | None
    temperature_degC: float | None


@dataclass(frozen=True)
class Refused:
    """What a client asked for was not done, and why."""

    text: str


Message = Role | State | Said | Pose | Refused


def encode(message: Message) -> str:
    """The message as JSON."""
    name = type(message).__name__.lower()
    return json.dumps({"message": name, **vars(message)}, default=vars, allow_nan=False, separators=(",", ":"))


# From the page -------------------------------------------------------------------------------------------------------


class Command(BaseModel):
    """What a person asks for; only the client that commands may, and the others may ask it for the command.

    Attributes
    ----------
    command : str
        A command of `truearm record --headless`; the page does not end the recording. ``ask`` of a client that only
        shows: for the command; ``give``: to the client that asked last.
    text : str
        The name of the seat, the point, or the joint angles to which a virtual arm is steered [deg, or mm].
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    command: Literal["take", "take moving", "undo", "seat", "point", "skip", "refit", "save", "steer", "ask", "give"]
    text: Annotated[str, Field(max_length=MAX_NAME)] = ""

    @property
    def line(self) -> str:
        """The command as `Recording.on_command` takes it."""
        return f"{self.command} {self.text}".strip()


# Of the HTTP operations ----------------------------------------------------------------------------------------------

MOST_POSES = 100  # in one request

Number = Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Joints = Annotated[list[Number], Field(min_length=1, max_length=MOST_JOINTS)]
Point = Annotated[list[Number], Field(min_length=3, max_length=3)]


class AtJoints(BaseModel):
    """Joint angles, and what else acts on the arm there.

    Attributes
    ----------
    joints : list of lists of float
        One list a pose [deg, or mm of sliding joints].
    temperature_degC : float, optional
        Of the arm.
    loads : mapping of str to float
        payload_kg, or load_.. as the model was trained with.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    joints: Annotated[list[Joints], Field(min_length=1, max_length=MOST_POSES)]
    temperature_degC: Number | None = None
    loads: dict[str, Number] = {}


class Predict(AtJoints):
    """Asks where the tip is at joint angles."""


class Correct(AtJoints):
    """Asks which joint angles bring the tip where the nominal arm would have it, or what the encoders mean.

    Attributes
    ----------
    points_mm : list of lists of 3 floats, optional
        Where the tip is to be, in `frame` [mm]; `joints` are then where to start, and the orientation is that of the
        nominal arm there.
    direction : str
        command: the angles to send; feedback: the nominal angles of encoders that read `joints`.
    frame : str
        Of `points_mm`: that of the model's reference, or the arm's own base.
    untrained : str
        What to do with targets outside the trained range.
    """

    points_mm: Annotated[list[Point], Field(min_length=1, max_length=MOST_POSES)] | None = None
    direction: TargetDirection = "command"
    frame: Frame = "reference"
    untrained: Untrained = "refuse"


@dataclass(frozen=True)
class Predicted:
    """The answer to `Predict`, one tip a pose."""

    tips: Sequence[Tip]


@dataclass(frozen=True)
class CorrectedTarget:
    """One target of `Correct`.

    Attributes
    ----------
    joints : sequence of float, optional
        Corrected joint angles [deg, or mm of sliding joints]; None if the target is refused.
    refused : str
        Why.
    U_mm : sequence of 3 floats, optional
        Expanded uncertainties of the tip (k = 2) [mm].
    outside_training : bool
    """

    joints: Sequence[float] | None
    refused: str
    U_mm: Sequence[float] | None
    outside_training: bool


@dataclass(frozen=True)
class Corrected:
    """The answer to `Correct`, in the order of its targets."""

    targets: Sequence[CorrectedTarget]
