"""``truearm check``: an interim check in a history of checks, which shows whether the arm has changed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truearm.cli.console import (
    Json,
    SessionFile,
    check_output_is_not_input,
    check_page_path,
    print_record,
    progress,
)


def check(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file.")],
    session: SessionFile,
    history: Annotated[
        Path, typer.Option("--history", help="File of the checks so far, .sqlite; the first check creates it.")
    ],
    lengths: Annotated[
        Path | None, typer.Option("--lengths", help="File of known lengths between the session's seats, .csv.")
    ] = None,
    retired: Annotated[
        list[str] | None,
        typer.Option("--retired", help="Artefact that was repaired or replaced, and is no longer assessed."),
    ] = None,
    mpe: Annotated[
        Path | None, typer.Option("--mpe", help="The arm's specification: limits for the values, .toml.")
    ] = None,
    date: Annotated[
        str | None, typer.Option("--date", help="Date of the check: 2026-11-03 or 2026-11-03T08:30; now by default.")
    ] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Page with the trend charts to write, .html.")] = None,
    as_json: Json = False,
) -> None:
    """Check whether the arm is still as it was identified.

    A few readings in a seat, in both seats of a bar, on a sphere. Scatter, length error, form and diameter are added to
    the history and charted: is it time to recalibrate, and since when? The result on an artefact stays valid while the
    artefact is not measured. A session that is in the history already is not added again; the last one is completed
    if it comes with more, such as --lengths.

    Exit code 0: no need; 1: recalibrate; 3: inconclusive (repeat the check), or not enough checks.
    """
    from truearm.verification.monitor.assessment import RecalibrationAdvice
    from truearm.workflows.check import check as checked

    files = [model, session, *(path for path in (lengths, mpe) if path is not None)]
    check_output_is_not_input(history, *files)
    if report is not None:
        check_page_path(report, *files, history)
    with progress(f"checking {session.name}"):
        result = checked(model, session, history, lengths=lengths, specification=mpe, retired=retired or (), date=date)
        if report is not None:
            result.save_page(report)
    print_record(result, as_json=as_json, files={"page": report})
    raise typer.Exit({RecalibrationAdvice.NO: 0, RecalibrationAdvice.YES: 1}.get(result.recalibrate, 3))
