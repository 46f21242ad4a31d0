"""``truearm split``: a fair split of a session file into training and test."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

from typer import Option

from truearm.cli.console import check_new_file, check_output_is_not_input, print_line, progress
from truearm.cli.options import Force, SessionFile
from truearm.errors import InputError


def split(
    session: SessionFile,
    train: Annotated[Path, Option(help="Session file to write the training readings to.")],
    test: Annotated[Path, Option(help="Session file to write the held-out readings to.")],
    by: Annotated[str, Option(help="What stays together: position, seat, session or row.")] = "position",
    share: Annotated[float, Option("--hold-out", help="Share of the groups to hold out.")] = 0.3,
    seed: Annotated[int, Option(min=0, help="The same seed gives the same split.")] = 0,
    force: Force = False,
) -> None:
    """Split a session into training and test readings.

    Readings of one position (seat, session) are neighbours and stay together, or the test would be too easy. Columns
    of notes are not copied.
    """
    from truearm.files.atomic_write import atomic_file, is_same_file
    from truearm.readings import check_session_path, hold_out, read_session, write_session
    from truearm.readings.split import SplitBy

    if is_same_file(train, test):
        raise InputError("--train and --test are the same file", file=train)
    for path in (train, test):
        check_output_is_not_input(path, session)
        check_session_path(path)
        check_new_file(path, force=force)
    with progress(f"splitting {session.name}"):
        readings = read_session(session)
        parts = hold_out(readings, by=cast(SplitBy, by), fraction=share, seed=seed)
        # Both or none: a new training file beside an old test file would share readings with it.
        with atomic_file(train) as new_train, atomic_file(test) as new_test:
            for path, part in zip((new_train, new_test), parts, strict=True):
                write_session(part, path)
    for path, part in zip((train, test), parts, strict=True):
        print_line(f"{path}: {len(part)} of {len(readings)} readings")
