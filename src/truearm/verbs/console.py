"""Output of the commands: results on standard output, progress on standard error."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import typer

from truearm.printable_text import printable
from truearm.verbs.record import Record


def print_line(text: str) -> None:
    """Print a line of the result."""
    typer.echo(printable(text))


def print_status(text: str) -> None:
    """Print a remark on progress; a closed terminal window is no error."""
    with suppress(OSError):
        typer.echo(printable(text), err=True)


def _silent(done: int, note: str) -> None:
    """No progress bar: standard error is no terminal."""


def print_json(result: Mapping[str, Any]) -> None:
    """Print a result for machines: JSON with numbers in full."""
    typer.echo(json.dumps(result, indent=2, allow_nan=False))


def print_record(
    record: Record,
    *,
    as_json: bool = False,
    files: Mapping[str, Path | None] | None = None,
    details: bool | None = None,
) -> None:
    """Print the result of a verb and the names of the files that were written, each with what it is.

    Parameters
    ----------
    record : Record
    as_json : bool
        As JSON: its `to_dict`, with the files before it.
    files : mapping of str to Path
        By what they hold, such as ``model`` or ``session``; JSON has the first as ``file``. None: not written.
    details : bool, optional
        With what only experts ask for; False says that there is more. None where the command has no ``--details``.
    """
    files = {what: path for what, path in (files or {}).items() if path is not None}
    if as_json:
        names = {"file" if i == 0 else f"{what}_file": str(path) for i, (what, path) in enumerate(files.items())}
        print_json({**names, **record.to_dict()})
        return
    print_line(str(record))
    lines = [] if details is None else [*map(str, record.details())]
    if lines and not details:
        lines = [f"--details adds {len(lines)} line{'s' * (len(lines) > 1)} for experts."]
    for line in lines:
        print_line(line)
    for what, path in files.items():
        print_line(f"{what.replace('_', ' ')} written to {path}")


@contextmanager
def progress(what: str, total: int | None = None) -> Iterator[Callable[[int, str], None]]:
    """Show a progress bar and the remaining time on standard error while the block runs, if that is a terminal.

    Parameters
    ----------
    what : str
        Label of the bar.
    total : int, optional
        Number of steps; unknown by default (the bar then shows activity only).

    Yields
    ------
    callable
        ``update(done, note)``: the number of steps done, and a note on the state.
    """
    if sys.stderr is None or not sys.stderr.isatty() or os.environ.get("TERM") in ("dumb", "unknown"):
        yield _silent
        return
    from rich.console import Console, RenderableType
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.text import Text

    class Bar(Progress):
        """A bar with the note on a line of its own below it: notes of a training are long."""

        def get_renderables(self) -> Iterator[RenderableType]:
            yield self.make_tasks_table(self.tasks)
            for task in self.tasks:
                if task.fields["note"]:
                    yield Text(f"  {task.fields['note']}", no_wrap=True, overflow="ellipsis")

    bar = Bar(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=None),
        TimeElapsedColumn(),
        TextColumn("" if total is None else "left"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        expand=True,
    )
    with bar:
        task = bar.add_task(printable(what), total=total, note="")
        yield lambda done, note: bar.update(task, completed=done, note=printable(note))
