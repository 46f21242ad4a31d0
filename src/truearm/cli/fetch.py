"""``truearm fetch``: a published set of a real arm as a session file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truearm.cli.console import say, say_table


def fetch(
    name: Annotated[str, typer.Argument(help="A name from `truearm fetch --list`.", show_default=False)] = "",
    out: Annotated[Path | None, typer.Option("--out", help="Session file to write; NAME.csv by default.")] = None,
    show: Annotated[bool, typer.Option("--list", help="List the sets, and stop.")] = False,
) -> None:
    """Write a real arm's published readings as a session file; they are downloaded once if need be."""
    from truearm import datasets
    from truearm.readings import write_session

    if show or not name:
        say_table(["name", "set", "arm"], [[n, s.title, s.arm] for n, s in datasets.SETS.items()])
        return
    readings = datasets.load(name)
    data_set = datasets.SETS[name]
    path = out or Path(f"{name}.csv")
    write_session(readings, path, angle_unit=data_set.angle_unit)
    source = data_set.source
    say(f"{path}: {len(readings)} readings of {readings.n_joints} joints, nominal arm {data_set.arm}.")
    repository = datasets.UPSTREAM[source].rpartition("/")[0]
    say(f"From github.com/{repository} (MIT licence). Cite: {datasets.CITATION[source]}.")
