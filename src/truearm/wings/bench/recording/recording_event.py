"""What a recording says: events, for people and for machines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from truearm.verbs.record import to_plain

Kind = Literal["ready", "sample", "reading", "undone", "learned", "next", "enough", "model", "notice", "refused", "end"]


@dataclass(frozen=True)
class Event:
    """Something that a recording says.

    Attributes
    ----------
    kind : {"ready", "sample", "reading", "undone", "learned", "next", "enough", "model", "notice", "refused", "end"}
        ``reading``: it is in the file. ``learned``: how well the arm is known with it. ``next``: the pose that comes
        next. ``enough``: further readings would add little. ``model``: another one is in force. ``refused``: what a
        person asked for was not done.
    text : str
        In one sentence.
    values : mapping of str to object
        For machines; the keys state their units.
    """

    kind: Kind
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The event for machines: its kind, its text and its values."""
        plain: dict[str, Any] = to_plain({"event": self.kind, "text": self.text, **self.values})
        return plain
