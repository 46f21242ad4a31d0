"""Options of the commands that take readings of a connected arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from inspect import Parameter, Signature, signature
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

from typer import Option

from truearm.verbs import options
from truearm.wings.bench.recording import TakeOn

if TYPE_CHECKING:
    from truearm.wings.bench.recording.recording import Recording

SOURCE_HELP = "Where the angles come from: KIND:ADDRESS, as truearm sources lists them."
OUT_HELP = "Session file, .csv; one with the same columns is continued."


@dataclass(frozen=True)
class SharedOptions:
    """The options that these commands share: each attribute is one, with its help."""

    source: Annotated[str, Option(help=SOURCE_HELP)]
    out: Annotated[Path, Option(help=OUT_HELP)]
    plan: options.PlanFile = None
    rank: Annotated[
        bool, Option("--rank", help="Next is the pose that adds most: of the plan, or without one of all in reach.")
    ] = False
    arm: options.ArmOption = None
    model: Annotated[
        Path | None, Option("--model-file", help="Model file: shows the corrected tip with its uncertainty.")
    ] = None
    out_model: Annotated[
        Path | None, Option(help="Where a model fitted to the readings is saved; replaces one of the same arm.")
    ] = None
    reference: Annotated[
        str | None, Option(help="What measures the tip, if not the source: another source, paired by time, or typed.")
    ] = None
    on: Annotated[TakeOn, Option(help="Take a reading at every standstill, or by key or the arm's button.")] = "still"
    seat: Annotated[str, Option(help="Name of the seat of the first readings; by default the plan's.")] = ""
    still: options.Still = 0.5
    spread: Annotated[float, Option(help="By how much a joint moves at most in that time [deg].")] = 0.05
    spread_mm: Annotated[float, Option(help="By how much a sliding joint moves at most [mm].")] = 0.05

    def recording(self, samples_hz: float) -> Recording:
        """The recording of these options; its samples are events `samples_hz` times a second."""
        from truearm.wings.bench.recording.recording import Recording
        from truearm.wings.bench.sources import StandstillRule

        stated = {one.name: getattr(self, one.name) for one in fields(self)}
        still, spread, spread_mm = (stated.pop(name) for name in ("still", "spread", "spread_mm"))
        rule = StandstillRule(still, radians(spread), spread_mm)
        return Recording(**stated, rule=rule, samples_hz=samples_hz)


def takes_readings(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the options of its first parameter, a `SharedOptions`, in place of it."""
    first, *own = signature(command, eval_str=True).parameters.values()
    described = get_type_hints(first.annotation, include_extras=True)
    shared = [one.replace(annotation=described[name]) for name, one in signature(first.annotation).parameters.items()]

    @wraps(command)
    def with_options(**stated: Any) -> None:
        command(first.annotation(**{one.name: stated.pop(one.name) for one in shared}), **stated)

    by_name = [one.replace(kind=Parameter.KEYWORD_ONLY) for one in (*shared, *own)]
    with_options.__signature__ = Signature(by_name)  # type: ignore[attr-defined]
    return with_options
