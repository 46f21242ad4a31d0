"""``truearm split``: a fair split of a session file into training and test."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

from typer import Option

from truearm.errors import InputError
from truearm.verbs import options
from truearm.verbs.console import print_line, progress
from truearm.verbs.outputs import check_new_output


def split(
    session: options.SessionFile,
    train: Annotated[Path, Option(help="Session file to write the training readings to.")],
    test: Annotated[Path, Option(help="Session file to write the held-out readings to.")],
    by: Annotated[str, Option(help="What stays together: position, seat, session or row.")] = "position",
    share: Annotated[float, Option("--hold-out", help="Share of the groups to hold out.")] = 0.3,
    seed: options.Seed = 0,
    force: options.Force = False,
) -> None:
    """Split a session into training and test readings.

    Readings of one position (seat, session) are neighbours and stay together, or the test would be too easy. Columns
    of notes are not copied.

    A folder of session files, or a file beyond 512 MB, is read part by part; by row, 8192 consecutive readings stay
    together.
    """
    from truearm.files.atomic_write import atomic_file, is_same_file
    from truearm.files.table_writer import table_writer
    from truearm.readings import check_session_path, read_session, write_session
    from truearm.readings.files import is_large
    from truearm.readings.large_sessions import LargeSession, held_out_rows
    from truearm.readings.session import SplitBy

    if is_same_file(train, test):
        raise InputError("--train and --test are the same file", file=train)
    for path in (train, test):
        check_session_path(path)
        check_new_output(path, session, force=force)
    counts = [0, 0]
    with progress(f"splitting {session.name}") as update:
        # Both or none: a new training file beside an old test file would share readings with it.
        if is_large(session):
            large = LargeSession.open(session)
            held = held_out_rows(large, by=by, fraction=share, seed=seed)
            with table_writer(train) as append_train, table_writer(test) as append_test:
                for part in large.parts:
                    for readings in part.sessions():
                        is_held = held(readings, sum(counts))
                        for i, (append, rows) in enumerate(((append_train, ~is_held), (append_test, is_held))):
                            if rows.any():
                                append(large.table(readings.rows(rows)))
                                counts[i] += int(rows.sum())
                        update(sum(counts), f"{sum(counts)} of {len(large)} readings")
        else:
            parts = read_session(session).split(by=cast(SplitBy, by), hold_out=share, seed=seed)
            with atomic_file(train) as new_train, atomic_file(test) as new_test:
                for i, (path, one) in enumerate(zip((new_train, new_test), parts, strict=True)):
                    write_session(one, path)
                    counts[i] = len(one)
    for path, n in zip((train, test), counts, strict=True):
        print_line(f"{path}: {n} of {sum(counts)} readings")
