"""``truearm report``: models of an arm compared on a session, as a page to show."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.pages import FigureFormat
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs.console import print_record, progress
from truearm.verbs.options import AcceptOption, refuse_typed


def report(
    context: typer.Context,
    files: Annotated[list[Path], Argument(metavar="MODEL... SESSION", help="Model files, then a session file.")],
    out: Annotated[Path, Option(help="Page to write, .html.")],
    title: Annotated[str, Option(help="Title of the page.")] = "",
    lengths: Annotated[
        Path | None, Option(help="File of known lengths between the seats of a session without points, .csv.")
    ] = None,
    figures: Annotated[Path | None, Option(help="Folder for every figure of the page as a file of its own.")] = None,
    form: Annotated[
        FigureFormat | None,
        Option("--figures-as", help="What the files of --figures are; svg by default."),
    ] = None,
    accept: AcceptOption = None,
) -> None:
    """Compare models on readings, as a page to show.

    Errors before and after compensation; for identified arms their uncertainty, their terms, the error of each joint,
    and what is not identifiable. The page is one HTML file that needs nothing beside it. The readings must have
    reference points, or seats.

    Of a folder of session files, or a file beyond 512 MB, the page shows an evenly spaced sample of 20000 readings, and
    has the errors of all (docs/large-sessions.md).
    """
    from truearm.pages.drawings.page_record import make_folder
    from truearm.verbs.inputs import is_model_file
    from truearm.wings.reports.report import report as reported

    *models, session = files
    if models and all(map(is_model_file, files)):
        raise InputError(
            "expected a session file after the model files, got a model file",
            file=session,
            hint=f"truearm report {' '.join(str(path) for path in files)} SESSION --out {out}",
        )
    if not models:
        raise InputError(
            "expected one or more model files, then a session file", hint="truearm report MODEL SESSION --out FILE"
        )
    if figures is None:
        refuse_typed(context, ["form"], "is for the files of --figures", hint="--figures FOLDER")
    check_page_path(out, *files, lengths)
    if figures is not None:
        make_folder(figures)
    with progress("drawing the report"):
        result = reported(models, session, out, lengths=lengths, title=title, accept=accept)
        if figures is not None:
            result.save_figures(figures, ending=f".{form or 'svg'}")
    print_record(result, files={"page": out, "figures": figures})
