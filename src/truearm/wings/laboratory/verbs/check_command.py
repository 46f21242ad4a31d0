"""``truearm check``: an interim check in a history of checks, which shows whether the arm has changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_output_is_not_input

if TYPE_CHECKING:
    from truearm.wings.laboratory.verbs.check import CheckResult, WithdrawalResult

CheckedSession = Annotated[
    Path | None, Argument(metavar="SESSION", help="Session file, .csv or .parquet; none with --withdraw.")
]
RetiredOption = Annotated[
    list[str] | None, Option(help="Artefact that was repaired or replaced, and is no longer assessed.")
]
WithdrawOption = Annotated[
    str | None, Option("--withdraw", metavar="NUMBER|DATE", help="Withdraw a wrong check; it stays in the history.")
]
ReasonOption = Annotated[str | None, Option(help="With --withdraw: what was wrong with it.")]


def check(
    context: typer.Context,
    model: options.ModelFile,
    history: Annotated[Path, Option(help="File of the checks so far, .sqlite; the first check creates it.")],
    session: CheckedSession = None,
    lengths: options.LengthsFile = None,
    retired: RetiredOption = None,
    mpe: options.MpeFile = None,
    date: options.Date = None,
    page: options.Page = None,
    withdrawn: WithdrawOption = None,
    reason: ReasonOption = None,
    accept: options.AcceptOption = None,
    as_json: options.Json = False,
) -> None:
    """Check whether the arm is still as it was identified.

    A few readings in a seat, in both seats of a bar, on a sphere. Scatter, length error, form and diameter are added to
    the history and charted: is it time to recalibrate, and since when? The result on an artefact stays valid while the
    artefact is not measured. A session that is in the history already is not added again; the last one is completed
    if it comes with more, such as --lengths.

    --withdraw 12 --reason "the ball was dirty", without a session: check 12 no longer counts. It stays in the history
    with the reason, and on the page (--page), struck through. Exit code 0.

    Exit code 0: no need; 1: recalibrate; 3: undecided (repeat the check), or not enough checks.
    """
    from truearm.wings.laboratory.verbs.check import check as checked
    from truearm.wings.laboratory.verbs.check import withdraw_check

    if withdrawn is not None:
        stated = needed_reason(context, reason)
        check_page_path(page, model, history)
        print_withdrawal(withdraw_check(model, history, withdrawn, reason=stated), page, as_json=as_json)
        return
    file = needed_session(context, session, "truearm check MODEL SESSION --history HISTORY")
    files = (model, file, lengths, mpe)
    check_output_is_not_input(history, *files)
    check_page_path(page, *files, history)
    given: dict[str, Any] = {"lengths": lengths, "specification": mpe, "retired": retired or ()}
    print_check(lambda: checked(model, file, history, **given, date=date, accept=accept), file, page, as_json=as_json)


def needed_reason(context: typer.Context, reason: str | None) -> str:
    """The reason of a withdrawal, with which no option of a check is given."""
    options.refuse_typed(
        context, ("session", "lengths", "retired", "mpe", "date", "accept"), "does not apply to --withdraw"
    )
    if reason is None:
        raise InputError("--withdraw needs --reason as well", hint='--reason "the ball was dirty"')
    return reason


def needed_session(context: typer.Context, session: Path | None, hint: str) -> Path:
    """The session of a check, with which no option of a withdrawal is given."""
    options.refuse_typed(context, ["reason"], "applies to --withdraw only")
    if session is None:
        raise InputError("the session is missing", hint=hint)
    return session


def print_check(checked: Callable[[], CheckResult], session: Path, page: Path | None, *, as_json: bool) -> None:
    """Make a check, write its page, print it, and exit with what it says."""
    from truearm.wings.laboratory.monitor.assessment import RecalibrationAdvice

    with progress(f"checking {session.name}"):
        result = checked()
        if page is not None:
            result.save_page(page)
    print_record(result, as_json=as_json, files={"page": page})
    raise typer.Exit({RecalibrationAdvice.NO: 0, RecalibrationAdvice.YES: 1}.get(result.recalibrate, 3))


def print_withdrawal(result: WithdrawalResult, page: Path | None, *, as_json: bool) -> None:
    """Print a withdrawal, and write its page."""
    if page is not None and result.assessment is not None:
        result.save_page(page)
    print_record(result, as_json=as_json, files={"page": None if result.assessment is None else page})
