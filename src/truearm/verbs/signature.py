"""Options of a command from the signature of its verb, so that both say the same once."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import wraps
from importlib import import_module
from importlib.util import find_spec
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, Optional, get_origin

import typer
from typer import Option
from typer.core import TyperGroup

from truearm.verbs.options import BY_NAME

KINDS: dict[str, Any] = {"bool": bool, "int": int, "float": float, "str": str}
# Options of how a command runs and prints: the last of its help.
LAST = ("force", "workers", "scheduler", "details", "as_json")


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
        named.with_options = lambda: self.complete(command)  # type: ignore[attr-defined]
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
