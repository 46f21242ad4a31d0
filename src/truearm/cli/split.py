"""``truearm split``: a fair split of a session file into training and test."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

import typer

from truearm.cli.console import say


def split(
    session: Annotated[Path, typer.Argument(help="Session file.")],
    train: Annotated[Path, typer.Option("--train", help="Session file to write the training readings to.")],
    test: Annotated[Path, typer.Option("--test", help="Session file to write the held out readings to.")],
    by: Annotated[str, typer.Option("--by", help="What stays together: position, seat, session or row.")] = "position",
    share: Annotated[float, typer.Option("--hold-out", help="Share of the groups to hold out.")] = 0.3,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same split.")] = 0,
) -> None:
    """Split readings into training and test, so that neighbours stay together."""
    from truearm.errors import InputError
    from truearm.readings import hold_out, read_session, write_session
    from truearm.readings.split import By

    if train.resolve() == test.resolve():
        raise InputError("--train and --test are the same file", file=train)
    readings = read_session(session)
    for path, part in zip((train, test), hold_out(readings, by=cast(By, by), fraction=share, seed=seed), strict=True):
        write_session(part, path)
        say(f"{path}: {len(part)} of {len(readings)} readings")
