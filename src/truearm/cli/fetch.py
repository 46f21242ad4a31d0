"""``truearm fetch``: a published set of a real arm as a session file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truearm.cli.console import progress, say, say_table


def fetch(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="A name from the list.", show_default=False)] = "",
    out: Annotated[Path | None, typer.Option("--out", help="Session file to write; NAME.csv by default.")] = None,
    show: Annotated[bool, typer.Option("--list", help="List the sets, and stop; so does no NAME.")] = False,
) -> None:
    """Get the published readings of a real arm.

    They are downloaded once, checked against the published files, and written as a session file.
    """
    from truearm import datasets
    from truearm.errors import InputError
    from truearm.readings import check_session_path, write_session

    if show or not name:
        say_table(["name", "set", "arm"], [[n, s.title, s.arm] for n, s in datasets.SETS.items()], left=(0, 1, 2))
        return
    path = out or Path(f"{name}.csv")
    if out is None and path.exists():
        raise InputError("the file exists already", file=path, hint=f"--out {path} to replace it")
    check_session_path(path)
    with progress(f"getting {name}"):
        readings = datasets.load(name)
        data_set = datasets.SETS[name]
        write_session(readings, path, angle_unit=data_set.angle_unit)
    source = data_set.source
    say(f"{path}: {len(readings)} readings of {readings.n_joints} joints, nominal arm {data_set.arm}.")
    repository = datasets.UPSTREAM[source].rpartition("/")[0]
    say(f"From github.com/{repository} (MIT licence). Cite: {datasets.CITATION[source]}.")
