"""Options of the commands: those that several share, what their texts mean, and those from the signature of a verb.

A command and its verb say the same once (`of_verb`).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from functools import cache, wraps
from importlib import import_module
from importlib.util import find_spec
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional, get_origin, get_type_hints

import typer
from typer import Argument, Option
from typer.core import TyperGroup

from truearm.choices import Conditions, Convention, Limits, ModelName
from truearm.errors import InputError

if TYPE_CHECKING:
    from truearm.solve.executors import Executor

ARM_HELP = "A name from `truearm arms`, an arm file (.toml), or a URDF or MJCF with its links: r.urdf, r.urdf:BASE:TIP."
KINDS: dict[str, Any] = {"bool": bool, "int": int, "float": float, "str": str}
# Options of how a command runs and prints: the last of its help.
LAST = ("force", "workers", "scheduler", "details", "as_json")


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
FittedModelOut = Annotated[
    Path | None, Option(help="Where a model fitted to the readings is saved; replaces one of the same arm.")
]
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
AngleUnit = Annotated[
    str | None,
    Option(
        "--angle-unit",
        help="deg, rad, gon, counts, mm or m (sliding), percent (LeRobot): one, or one a joint, separated by commas.",
    ),
]
MotorsFile = Annotated[
    str | None,
    Option(
        "--motors",
        metavar="[ARM:]FILE",
        help="LeRobot's calibration of the motors, .json; so100: before it, or alone, for an SO-100.",
    ),
]
# How it runs, and what is printed.
Details = Annotated[
    bool, Option("--details", help="Print groups of terms, what is not identifiable, and terms not offered too.")
]
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
    "angle_unit": AngleUnit,
    "arm": ArmOption,
    "artefacts": ArtefactsFile,
    "conditions": ConditionsOption,
    "convention": ConventionOption,
    "free": FreeOption,
    "lengths": LengthsFile,
    "limits": LimitsOption,
    "motors": MotorsFile,
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


def with_shared(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command with the options of a dataclass in place of its parameter that is one.

    Commands share options by such a class: each attribute is one, with its help.
    """
    parameters = signature(command, eval_str=True).parameters.values()
    (shared,) = (one for one in parameters if is_dataclass(one.annotation))
    kinds = get_type_hints(shared.annotation, include_extras=True)
    group = [one.replace(annotation=kinds[name]) for name, one in signature(shared.annotation).parameters.items()]

    @wraps(command)
    def with_options(**given: Any) -> None:
        of_group = {one.name: given.pop(one.name) for one in group}
        command(**{shared.name: shared.annotation(**of_group)}, **given)

    listed = [each for one in parameters for each in (group if one is shared else [one])]
    by_name = [one.replace(kind=Parameter.KEYWORD_ONLY) for one in listed]
    with_options.__signature__ = Signature(by_name)  # type: ignore[attr-defined]
    return with_options


@dataclass(frozen=True)
class of_verb:
    """Give a command the options of a verb: the command states only what is its own.

    The command is called with the verb before its own arguments, and with the options of the verb in its
    ``**options``, by their names in the verb. They are the parameters of the verb with a default that the command
    itself does not have: numbers, words and choices with the help of the verb's docstring, others as `BY_NAME` has
    them.

    Parameters
    ----------
    place : str
        Module and name of the verb, ``truearm.verbs.refit:refit``. Its source is read when this command is asked for,
        and it is imported when the command runs: help comes without NumPy and its like.
    omit : tuple of str
        Parameters of the verb that are no options.
    called : mapping of str to str
        Options whose name is not that of the parameter without ``n_`` and ``_mm``.
    within : mapping of str to (int, int or None)
        The least and the greatest number of a parameter, where more would take hours or all memory.
    """

    place: str
    omit: tuple[str, ...] = ()
    called: Mapping[str, str] = field(default_factory=dict)
    within: Mapping[str, tuple[int, int | None]] = field(default_factory=dict)

    def __call__(self, command: Callable[..., None]) -> Callable[[], None]:
        """Return what stands for the command in lists, which name it only; `Group` completes it."""

        @wraps(command)
        def named() -> None:
            """Stand for the command."""

        named.__signature__ = Signature()  # type: ignore[attr-defined]
        named.with_options = cache(lambda: self.complete(command))  # type: ignore[attr-defined]
        return named

    def complete(self, command: Callable[..., None]) -> Callable[..., None]:
        """Return the command with the options of its verb in place of ``**options``."""
        module, _, name = self.place.partition(":")
        _, *own, _ = signature(command, eval_str=True).parameters.values()

        @wraps(command)
        def with_options(**given: Any) -> None:
            command(getattr(import_module(module), name), **given)

        verb = Source.of(module, name)
        of_the_verb = self._options(verb, {*(one.name for one in own), *self.omit, "executor", "progress"})
        ordered = sorted([*own, *of_the_verb], key=lambda one: one.name in LAST)
        by_name = [one.replace(kind=Parameter.KEYWORD_ONLY) for one in ordered]
        with_options.__signature__ = Signature(by_name)  # type: ignore[attr-defined]
        return with_options

    def _options(self, verb: Source, without: set[str]) -> Iterator[Parameter]:
        described = parameters_described(verb.text)
        for one in verb.parameters():
            if one.name in without:
                continue
            option = BY_NAME.get(one.name) or self._option(one, verb, described.get(one.name, ""))
            default = ",".join(one.default) if isinstance(one.default, tuple) else one.default
            yield one.replace(annotation=option, default=default)

    def _option(self, one: Parameter, verb: Source, words: str) -> Any:
        """The annotation of an option: a number, a word, a choice or a switch."""
        name = one.annotation.removesuffix(" | None")
        kind = KINDS.get(name) or verb.named(name)
        assert kind in KINDS.values() or get_origin(kind) is Literal, f"{one}: an option of the command's own"
        option = "--" + one.name.removeprefix("n_").removesuffix("_mm").replace("_", "-")
        option = self.called.get(one.name, option)
        if kind is bool and one.default is not False:
            option += f"/--no-{option.removeprefix('--')}"
        least, greatest = self.within.get(one.name, (None, None))
        info = Option(option, help=words, min=least, max=greatest)
        return Annotated[kind if one.default is not None else Optional[kind], info]  # noqa: UP045


@dataclass(frozen=True)
class Source:
    """A function as its source states it, without an import of its module.

    Attributes
    ----------
    module : str
    tree : ast.Module
        Of the module.
    function : ast.FunctionDef
    """

    module: str
    tree: ast.Module
    function: ast.FunctionDef

    @classmethod
    def of(cls, module: str, name: str) -> Source:
        """Read the source of a function."""
        place = find_spec(module)
        assert place is not None
        assert place.origin is not None
        tree = ast.parse(Path(place.origin).read_text(encoding="utf-8"))
        (function,) = (one for one in tree.body if isinstance(one, ast.FunctionDef) and one.name == name)
        return cls(module, tree, function)

    @property
    def text(self) -> str:
        """The docstring."""
        return ast.get_docstring(self.function) or ""

    def parameters(self) -> Iterator[Parameter]:
        """The parameters with a default, their annotations as text."""
        of, first = self.function.args, len(self.function.args.args) - len(self.function.args.defaults)
        defaults = [*zip(of.args[first:], of.defaults, strict=True), *zip(of.kwonlyargs, of.kw_defaults, strict=True)]
        for one, default in defaults:
            if default is not None and one.annotation is not None:
                value = self.named(default.id) if isinstance(default, ast.Name) else ast.literal_eval(default)
                kind = ast.unparse(one.annotation).strip("'")
                yield Parameter(one.arg, Parameter.KEYWORD_ONLY, default=value, annotation=kind)

    def named(self, name: str) -> Any:
        """What a name of the module stands for, from where it comes from."""
        taken = (one for one in self.tree.body if isinstance(one, ast.ImportFrom))
        home = next((one.module for one in taken if name in (it.name for it in one.names)), self.module)
        return getattr(import_module(home or self.module), name)


class Group(TyperGroup):
    """Commands that get the options of their verbs when they are asked for."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command, see click."""
        command = super().get_command(ctx, cmd_name)
        complete = getattr(getattr(command, "callback", None), "with_options", None)
        if complete is None:
            return command
        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        app.command(cmd_name)(complete())
        return typer.main.get_command(app)


def parameters_described(docstring: str) -> dict[str, str]:
    """What a docstring says of each parameter, as plain text."""
    found = re.search(r"^Parameters\n-+\n(.*?)(?:\n\n\S|\Z)", docstring, flags=re.MULTILINE | re.DOTALL)
    described: dict[str, str] = {}
    for names, words in re.findall(r"^(\S.*?) : .*\n((?:    .*\n?)+)", found[1] if found else "", flags=re.MULTILINE):
        plain = re.sub(r"``\"?(.*?)\"?``", r"\1", words).replace("`", "")
        described |= dict.fromkeys(names.split(", "), " ".join(plain.split()))
    return described
