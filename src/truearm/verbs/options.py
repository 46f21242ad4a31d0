"""Options and arguments that several commands share, and what their texts mean."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from truearm.choices import Conditions, Convention, Limits, ModelName
from truearm.errors import InputError

if TYPE_CHECKING:
    from truearm.solve.executors import Executor

ARM_HELP = "A name from `truearm arms`, an arm file (.toml), or a URDF with its links: r.urdf, r.urdf:BASE:TIP."


def numbers_of(text: str, option: str, example: str) -> list[float]:
    """The numbers of an option, separated by commas.

    Raises
    ------
    InputError
        If one of them is no number.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(
            f"{option} expects numbers separated by commas, got {text!r}", hint=f"{option} {example}"
        ) from None


def free_parts(text: str) -> tuple[str, ...]:
    """The free parts that --free names.

    Raises
    ------
    InputError
        If one of them is neither base nor tip.
    """
    parts = () if text.strip() == "none" else tuple(part.strip() for part in text.split(","))
    if not set(parts) <= {"base", "tip"}:
        raise InputError(f"--free expects base, tip, base,tip or none, got {text!r}", hint="--free base,tip")
    return parts


# Arguments. One name is one thing: commands take an option that several have from here, or from their room.
ArmArgument = Annotated[str, Argument(metavar="ARM", help=ARM_HELP)]
ModelFile = Annotated[Path, Argument(metavar="MODEL", help="Model file.")]
SessionFile = Annotated[Path, Argument(metavar="SESSION", help="Session file, .csv or .parquet.")]
# Files that are read.
ArmOption = Annotated[str | None, Option("--arm", help=f"Nominal arm. {ARM_HELP}")]
ArtefactsFile = Annotated[Path | None, Option("--artefacts", help="Certificates of the artefacts, .toml.")]
LengthsFile = Annotated[Path | None, Option(help="File of known lengths between the session's seats, .csv.")]
MpeFile = Annotated[Path | None, Option("--mpe", help="The arm's specification: limits and measuring range, .toml.")]
PlanFile = Annotated[Path | None, Option(help="Plan of the poses: the file of truearm plan, .csv.")]
PriorFile = Annotated[Path | None, Option(help="What arms of this type have in common: file of truearm fleet prior.")]
ReadSession = Annotated[Path | None, Option("--session", help="Session file, .csv or .parquet.")]
# Files that are written.
ModelOut = Annotated[Path, Option("--out", help="Model file to write; the usual ending is .truearm.")]
ArmOut = Annotated[Path | None, Option("--apply", help="Arm file to write with what was found, .toml or .urdf.")]
Page = Annotated[Path | None, Option("--page", help="Page to write, .html.")]
Force = Annotated[
    bool, Option("--force", help="Replace what is kept: what people wrote, measured or issued, another arm's model.")
]
# What is computed, and how.
AcceptOption = Annotated[
    str | None,
    Option("--accept", metavar="REASON", help="Go on where readings contradict arm or model; the reason is kept."),
]
ConditionsOption = Annotated[
    Conditions,
    Option(
        help="Conditions of the uncertainty: any day (reproducibility), or the day and set-up of the training readings "
        "(repeatability)."
    ),
]
ConventionOption = Annotated[Convention, Option(help="Table of constants: Denavit-Hartenberg or modified.")]
ArtefactTemperature = Annotated[float | None, Option(help="Temperature of the artefacts [degC].")]
Date = Annotated[str | None, Option(help="Day, 2026-11-03; also with the time, 2026-11-03T08:30; now by default.")]
FreeOption = Annotated[
    str,  # of which the parser makes the parts
    Option(
        "--free",
        parser=free_parts,
        metavar="PARTS",
        help="What is unknown of the placement: base,tip, or base or tip alone.",
    ),
]
LimitsOption = Annotated[Limits, Option(help="Readings beyond a joint limit: skip them, or use them.")]
ModelOption = Annotated[ModelName | None, Option("--model", help="Kind of model.")]
Seed = Annotated[int, Option(min=0, help="Seed of all random numbers.")]
Still = Annotated[float, Option("--still", help="For how long the arm stands still at a reading [s].")]
SerialNumber = Annotated[str | None, Option("--serial-number", help="Serial number of the arm.")]
TipName = Annotated[str | None, Option("--tip", help="Name of the tip, of a model with several.")]
# How it runs, and what is printed.
Json = Annotated[bool, Option("--json", help="Print the result as JSON for machines.")]
Quick = Annotated[bool, Option("--quick", help="A smaller task, in minutes.")]
WorkersOption = Annotated[
    int | None, Option("--workers", min=1, help="Processes of this machine; without it, one task at a time.")
]
SchedulerOption = Annotated[
    str | None, Option("--scheduler", metavar="ADDRESS", help="Dask cluster: address of its scheduler.")
]
# Parameters of verbs that are options wherever a verb has them.
BY_NAME: dict[str, Any] = {
    "accept": AcceptOption,
    "arm": ArmOption,
    "artefacts": ArtefactsFile,
    "conditions": ConditionsOption,
    "convention": ConventionOption,
    "free": FreeOption,
    "lengths": LengthsFile,
    "limits": LimitsOption,
    "prior": PriorFile,
    "quick": Quick,
    "seed": Seed,
    "serial_number": SerialNumber,
    "session": ReadSession,
    "standstill_s": Still,
    "specification": MpeFile,
    "tip": TipName,
}
PLURALS = {"applies": "apply", "does": "do", "it": "them"}


def typed_options(context: typer.Context) -> dict[str, str]:
    """The options and arguments that a person typed, by the names of their parameters; others have their default."""
    sources = {one: context.get_parameter_source(one.name or "") for one in context.command.params}
    return {
        one.name or "": one.opts[0] if one.opts[0].startswith("-") else f"a {one.name}"
        for one, source in sources.items()
        if source is not None and source.name == "COMMANDLINE"
    }


def refuse_typed(context: typer.Context, names: Iterable[str], rule: str, *, hint: str = "omit it") -> None:
    """Refuse the options of these parameters: they would have no effect.

    Parameters
    ----------
    context : typer.Context
    names : iterable of str
    rule, hint : str
        For one option, such as ``applies to --into only``; of several, the sentence is put in the plural.

    Raises
    ------
    InputError
        If a person typed some: their names and the rule.
    """
    typed = [option for name, option in typed_options(context).items() if name in set(names)]
    if len(typed) > 1:
        typed = [f"{', '.join(typed[:-1])} and {typed[-1]}"]
        rule, hint = (re.sub(r"\b(applies|does|it)\b", lambda word: PLURALS[word[0]], text) for text in (rule, hint))
    if typed:
        raise InputError(f"{typed[0]} {rule}", hint=hint)


def executor_of(context: typer.Context, session: Path, workers: int | None, scheduler: str | None) -> Executor | None:
    """Who computes the parts of a large session; of another one, --workers and --scheduler are refused."""
    from truearm.readings.files import is_large  # no help waits for it

    if is_large(session):
        from truearm.solve.executors import chosen_executor  # no small session waits for it

        return chosen_executor(workers, scheduler)
    rule = "applies to large sessions only: folders of session files, and files beyond 512 MB"
    refuse_typed(context, ("workers", "scheduler"), rule)
    return None
