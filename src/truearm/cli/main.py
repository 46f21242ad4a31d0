"""The command line: one module a verb, which parses, calls and prints."""

from __future__ import annotations

import importlib
import sys

import typer

from truearm import __version__
from truearm.errors import TruearmError

# The order in which a newcomer meets them.
VERBS: tuple[tuple[str, str], ...] = (
    ("demo", "demo"),
    ("arms", "arms"),
    ("fetch", "fetch"),
    ("simulate", "simulate"),
    ("import", "import_table"),
    ("split", "split"),
    ("fit", "fit"),
    ("predict", "predict"),
    ("evaluate", "evaluate"),
    ("report", "report"),
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"truearm {__version__}")
        raise typer.Exit


def _about(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    """True coordinates from the joint angles of an articulated arm.

    Identify the arm from readings against something known, compensate its angles into corrected coordinates.
    """


def make_app() -> typer.Typer:
    """The command line with its verbs; a verb is the function of its module's name."""
    app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
    app.callback()(_about)
    for verb, module in VERBS:
        function = getattr(importlib.import_module(f"truearm.cli.{module}"), module)
        app.command(verb)(function)
    return app


def run(arguments: list[str] | None = None) -> None:
    """Run the command line: exit code 0 done, 2 wrong input (one line on standard error), 130 interrupted."""
    try:
        make_app()(arguments)
    except TruearmError as error:
        typer.echo(f"truearm: {error}", err=True)
        sys.exit(2)
