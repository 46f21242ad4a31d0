"""``truearm check``: an interim check in a history of checks, which shows whether the arm has changed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from truearm.cli.console import check_output_is_not_input, check_page_path, print_record, progress
from truearm.cli.options import AcceptOption, Json, LengthsFile, ModelFile, refuse_typed
from truearm.errors import InputError


def check(
    context: typer.Context,
    model: ModelFile,
    history: Annotated[Path, Option(help="File of the checks so far, .sqlite; the first check creates it.")],
    session: Annotated[
        Path | None, Argument(metavar="SESSION", help="Session file, .csv or .parquet; none with --withdraw.")
    ] = None,
    lengths: LengthsFile = None,
    retired: Annotated[
        list[str] | None, Option(help="Artefact that was repaired or replaced, and is no longer assessed.")
    ] = None,
    mpe: Annotated[Path | None, Option(help="The arm's specification: limits for the values, .toml.")] = None,
    date: Annotated[
        str | None, Option(help="Date of the check: 2026-11-03 or 2026-11-03T08:30; now by default.")
    ] = None,
    report: Annotated[Path | None, Option(help="Page with the trend charts to write, .html.")] = None,
    withdrawn: Annotated[
        str | None, Option("--withdraw", metavar="NUMBER|DATE", help="Withdraw a wrong check; it stays in the history.")
    ] = None,
    reason: Annotated[str | None, Option(help="With --withdraw: what was wrong with it.")] = None,
    accept: AcceptOption = None,
    as_json: Json = False,
) -> None:
    """Check whether the arm is still as it was identified.

    A few readings in a seat, in both seats of a bar, on a sphere. Scatter, length error, form and diameter are added to
    the history and charted: is it time to recalibrate, and since when? The result on an artefact stays valid while the
    artefact is not measured. A session that is in the history already is not added again; the last one is completed
    if it comes with more, such as --lengths.

    --withdraw 12 --reason "the ball was dirty", without a session: check 12 no longer counts. It stays in the history
    with the reason, and on the page (--report), struck through. Exit code 0.

    Exit code 0: no need; 1: recalibrate; 3: undecided (repeat the check), or not enough checks.
    """
    if withdrawn is not None:
        refuse_typed(
            context, ("session", "lengths", "retired", "mpe", "date", "accept"), "does not apply to --withdraw"
        )
        _withdraw(model, history, withdrawn, reason, report=report, as_json=as_json)
        return
    refuse_typed(context, ["reason"], "applies to --withdraw only")
    if session is None:
        raise InputError("the session is missing", hint="truearm check MODEL SESSION --history HISTORY")
    from truearm.verification.monitor.assessment import RecalibrationAdvice
    from truearm.workflows.check import check as checked

    files = (model, session, lengths, mpe)
    check_output_is_not_input(history, *files)
    check_page_path(report, *files, history)
    with progress(f"checking {session.name}"):
        options: dict[str, Any] = {"lengths": lengths, "specification": mpe, "retired": retired or ()}
        result = checked(model, session, history, **options, date=date, accept=accept)
        if report is not None:
            result.save_page(report)
    print_record(result, as_json=as_json, files={"page": report})
    raise typer.Exit({RecalibrationAdvice.NO: 0, RecalibrationAdvice.YES: 1}.get(result.recalibrate, 3))


def _withdraw(
    model: Path, history: Path, which: str, reason: str | None, *, report: Path | None, as_json: bool
) -> None:
    from truearm.workflows.check import withdraw_check

    if reason is None:
        raise InputError("--withdraw needs --reason as well", hint='--reason "the ball was dirty"')
    check_page_path(report, model, history)
    result = withdraw_check(model, history, which, reason=reason)
    if report is not None and result.assessment is not None:
        result.save_page(report)
    print_record(result, as_json=as_json, files={"page": None if result.assessment is None else report})
