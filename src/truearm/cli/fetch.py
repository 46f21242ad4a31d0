"""``truearm fetch``: a published set of a real arm as a session file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truearm.cli.console import print_line, print_table, progress


def fetch(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="A name from the list.", show_default=False)] = "",
    out: Annotated[Path | None, typer.Option("--out", help="Session file to write; NAME.csv by default.")] = None,
    show: Annotated[bool, typer.Option("--list", help="List the sets, and stop; so does no NAME.")] = False,
) -> None:
    """Get the published readings of a real arm.

    They are downloaded once, checked against the published files, and written as a session file. Where lengths between
    its seats are known, they are written beside it, to OUT-lengths.csv.
    """
    from truearm import datasets
    from truearm.errors import InputError
    from truearm.files.atomic_write import atomic_file, check_writable
    from truearm.readings import check_session_path, write_lengths, write_session

    if show or not name:
        print_table(
            ["name", "set", "arm"], [[n, s.title, s.arm] for n, s in datasets.DATASETS.items()], left_aligned=(0, 1, 2)
        )
        return
    path = out or Path(f"{name}.csv")
    beside = path.with_name(f"{path.stem}-lengths.csv")
    lengths = datasets.load_lengths(name)
    for written in (path, beside) if lengths else (path,):
        if out is None and written.exists():
            raise InputError("the file exists already", file=written, hint=f"--out {path} to replace it")
    check_session_path(path)
    check_writable(beside)
    with progress(f"getting {name}"):
        readings = datasets.load_readings(name)
        data_set = datasets.DATASETS[name]
        # Both or none, as they belong together.
        with atomic_file(path) as session:
            write_session(readings, session, angle_unit=data_set.angle_unit)
            if lengths:
                write_lengths(lengths, beside)
    source = data_set.source
    print_line(f"{path}: {len(readings)} readings of {readings.n_joints} joints, nominal arm {data_set.arm}.")
    if lengths:
        print_line(f"{beside}: {len(lengths)} lengths between its seats; their uncertainty is our assumption.")
    repository = datasets.UPSTREAM[source].rpartition("/")[0]
    print_line(f"From github.com/{repository} (MIT licence). Cite: {datasets.CITATION[source]}.")
