"""``truearm fetch``: published readings of a real arm as a session file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from truearm.verbs import options
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.outputs import check_new_output


def fetch(
    name: Annotated[str, Argument(metavar="[NAME]", help="A name from the list.", show_default=False)] = "",
    out: Annotated[Path | None, Option(help="Session file to write; NAME.csv by default.")] = None,
    force: options.Force = False,
) -> None:
    """Get the published readings of a real arm.

    The readings are downloaded once, checked against the published files, and written as a session file. Where lengths
    between its seats are known, they are written beside it, to OUT-lengths.csv. Without a name, the sets are listed.
    """
    from truearm.readings import check_session_path
    from truearm.verbs.record import TextTable
    from truearm.wings.importing.datasets import DATASETS, load_lengths
    from truearm.wings.importing.fetch import fetch as fetch_readings

    if not name:
        rows = [[name, entry.title, entry.arm] for name, entry in DATASETS.items()]
        print_line(str(TextTable(["name", "set", "arm"], rows, left_aligned=(0, 1, 2))))
        return
    path = out or Path(f"{name}.csv")
    beside = path.with_name(f"{path.stem}-lengths.csv")
    files = {"session": path} | ({"lengths": beside} if load_lengths(name) else {})
    check_session_path(path)
    for written in files.values():
        check_new_output(written, force=force)
    with progress(f"fetching {name}"):
        published = fetch_readings(name)
        published.save(path, lengths=files.get("lengths"))
    print_record(published, files=files)
