"""What the commands say: results on standard output, progress on standard error."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any

import typer

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON for machines.")]
ArmName = Annotated[str, typer.Option("--arm", help="A name from `truearm arms`, or an arm (.toml) or URDF file.")]


def say(text: str) -> None:
    """Print a line of the result."""
    typer.echo(text)


def say_json(result: Mapping[str, Any]) -> None:
    """Print a result for machines: JSON with numbers in full."""
    typer.echo(json.dumps(result, indent=2, allow_nan=False))


def say_table(columns: list[str], rows: list[list[str]], *, left: tuple[int, ...] = (0,)) -> None:
    """Print rows under column heads: the columns numbered in `left` to the left, the others to the right."""
    widths = [max(len(row[i]) for row in [columns, *rows]) for i in range(len(columns))]
    for row in [columns, *rows]:
        cells = [
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        typer.echo("  ".join(cells).rstrip())


@contextmanager
def progress(what: str, total: int | None = None) -> Iterator[Callable[[int, str], None]]:
    """Show a progress bar on standard error while the block runs, if a person watches.

    Parameters
    ----------
    what : str
        What is going on.
    total : int, optional
        Number of steps; unknown by default (the bar then only shows that something moves).

    Yields
    ------
    callable
        ``tell(done, note)``: the steps done so far, and a few words on how it stands.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    bar.disable = not bar.console.is_terminal
    with bar:
        task = bar.add_task(what, total=total, note="")
        yield lambda done, note: bar.update(task, completed=done, note=note)
