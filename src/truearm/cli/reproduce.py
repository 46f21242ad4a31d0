"""``truearm reproduce``: the tables and figures of a paper beside their reproduction."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

from truearm.cli.console import print_json, print_line, print_status, progress
from truearm.cli.options import Json

STEPS = 10_000  # of the bar


def reproduce(
    paper: Annotated[Literal["gao2017"], Argument(metavar="PAPER", help="The paper: gao2017.")],
    table: Annotated[int | None, Option(metavar="2|3|4", help="One table only.")] = None,
    figure: Annotated[int | None, Option(metavar="1..8", help="One figure only, also as figure-N.png.")] = None,
    everything: Annotated[bool, Option("--all", help="All of it: an hour and a quarter on two cores.")] = False,
    quick: Annotated[
        bool, Option("--quick", help="One start a row, long trainings skipped: minutes; alone: --all.")
    ] = False,
    time_limit: Annotated[
        float | None,
        Option(metavar="SECONDS", help="CPU time of one training, 400 by default; inf: no limit, many hours."),
    ] = None,
    out: Annotated[Path, Option(metavar="DIR", help="Folder for the page and the trainings.")] = Path(
        "truearm-gao2017"
    ),
    as_json: Json = False,
) -> None:
    """Reproduce the tables and figures of a paper.

    Trains every row of the paper's tables by MATLAB's rules (trainlm) and by truearm's own trainer (varpro), and
    compares the results with the printed numbers. Finished trainings stay in the folder: after an
    interruption the same command resumes with the next one.
    """
    from truearm.errors import InputError
    from truearm.workflows.reproduce import reproduce as reproduced

    if sum((table is not None, figure is not None, everything)) > 1:
        raise InputError("expected one of --table, --figure and --all, got more")
    if table is None and figure is None and not everything and not quick:
        raise InputError(
            "expected what to reproduce, got neither --table nor --figure nor --all",
            hint="--quick, which takes minutes; --all takes an hour and a quarter",
        )
    try:
        with progress("reproducing", total=STEPS) as tell:
            result = reproduced(
                paper,
                table=table,
                figure=figure,
                quick=quick,
                time_limit=time_limit,
                folder=out,
                progress=lambda share, note: tell(round(STEPS * share), note),
            )
    except (KeyboardInterrupt, SystemExit):
        print_status(f"truearm: finished trainings are in {out / 'runs'}; the same command resumes with the next one")
        raise
    with progress("drawing the page"):
        numbers, page, *pictures = result.save(out)
    if as_json:
        print_json(result.to_dict())
        return
    print_line(str(result))
    picture = "".join(f", the picture in {file}" for file in pictures)
    print_line(f"The page is {page}; the numbers are in {numbers}{picture}.")
