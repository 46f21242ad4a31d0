"""``truearm report``: models of an arm compared on a session, as a page to show."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.pages import FigureFormat
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_record, progress


@options.of_verb("truearm.wings.reports.report:report", omit=("path",))
def report(
    verb: Any,
    context: typer.Context,
    files: Annotated[list[Path], Argument(metavar="MODEL... SESSION", help="Model files, then a session file.")],
    page: Annotated[Path, Option(help="Page to write, .html.")],
    figures: Annotated[Path | None, Option(help="Folder for every figure of the page as a file of its own.")] = None,
    form: Annotated[FigureFormat | None, Option("--figures-as", help="Format of --figures; svg by default.")] = None,
    **given: Any,
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

    *models, session = files
    if models and all(map(is_model_file, files)):
        raise InputError(
            "expected a session file after the model files, got a model file",
            file=session,
            hint=f"truearm report {' '.join(str(path) for path in files)} SESSION --page {page}",
        )
    if not models:
        raise InputError(
            "expected one or more model files, then a session file", hint="truearm report MODEL SESSION --page FILE"
        )
    if figures is None:
        options.refuse_typed(context, ["form"], "is for the files of --figures", hint="--figures FOLDER")
    check_page_path(page, *files, given["lengths"])
    if figures is not None:
        make_folder(figures)
    with progress("drawing the report"):
        result = verb(models, session, page, **given)
        if figures is not None:
            result.save_figures(figures, ending=f".{form or 'svg'}")
    print_record(result, files={"page": page, "figures": figures})
