"""Options of the commands that take readings of a connected arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from inspect import Signature, signature
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from truearm.choices import TakeOn
from truearm.cli.options import ARM_HELP

if TYPE_CHECKING:
    from truearm.workflows.recording import Recording


@dataclass(frozen=True)
class SharedOptions:
    """The options that these commands share: each attribute is one, with its help."""

    source: Annotated[str, Option(help="Where the angles come from: KIND:ADDRESS, as truearm sources lists them.")]
    out: Annotated[Path, Option(help="Session file, .csv; one with the same columns is continued.")]
    plan: Annotated[Path | None, Option(help="Plan of truearm plan: seats, instructions, what remains.")] = None
    arm: Annotated[str | None, Option("--arm", help=ARM_HELP)] = None
    model: Annotated[Path | None, Option(help="Model file: shows the corrected tip with its uncertainty.")] = None
    reference: Annotated[
        str | None, Option(help="What measures the tip, if not the source: another source, paired by time, or typed.")
    ] = None
    on: Annotated[TakeOn, Option(help="Take a reading at every standstill, or by key or the arm's button.")] = "still"
    seat: Annotated[str, Option(help="Name of the seat of the first readings; by default the plan's.")] = ""
    still: Annotated[float, Option(help="For how long the arm stands still before a reading is taken [s].")] = 0.5
    spread: Annotated[float, Option(help="By how much a joint moves at most in that time [deg].")] = 0.05
    spread_mm: Annotated[float, Option(help="By how much a sliding joint moves at most [mm].")] = 0.05

    def recording(self, samples_hz: float) -> Recording:
        """The recording of these options; its samples are events `samples_hz` times a second."""
        from truearm.sources import StandstillRule
        from truearm.workflows.recording import Recording

        return Recording(
            self.source,
            self.out,
            plan=self.plan,
            arm=self.arm,
            model=self.model,
            reference=self.reference,
            on=self.on,
            seat=self.seat,
            rule=StandstillRule(self.still, radians(self.spread), self.spread_mm),
            samples_hz=samples_hz,
        )


def takes_readings(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the options of `SharedOptions` in place of its first parameter."""
    shared = signature(SharedOptions, eval_str=True).parameters
    _, *own = signature(command, eval_str=True).parameters.values()

    @wraps(command)
    def with_options(**given: Any) -> None:
        command(SharedOptions(**{name: given.pop(name) for name in shared}), **given)

    with_options.__signature__ = Signature([*shared.values(), *own])  # type: ignore[attr-defined]
    return with_options
