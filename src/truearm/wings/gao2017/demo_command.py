"""``truearm demo``: an arm's error before and after compensation, without an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from truearm.pages.drawings.page_record import check_folder
from truearm.verbs import options
from truearm.verbs.console import print_json, print_line, progress


def demo(
    out: Annotated[Path, Option(help="Folder for the report, a picture and the numbers.")] = Path("truearm-demo"),
    seed: options.Seed = 0,
    quick: options.Quick = False,
    as_json: options.Json = False,
) -> None:
    """See an arm's error before and after compensation.

    Repeats the founding paper's experiment on a virtual measuring arm: 3000 poses in a box of joint angles train a
    network (the paper's 30-30, by another trainer than the paper's) and identify models of the arm; all are tested on
    200 further poses of the box, and on 200 poses of everyday measuring, far outside it.

    Another --seed is another arm, with other poses and other noise. --quick: half of the poses and a smaller network.
    """
    from truearm.wings.gao2017.demo import FILES, demo_epochs
    from truearm.wings.gao2017.demo import demo as run_demo

    check_folder(out, FILES)
    with progress("measuring, fitting", total=demo_epochs(quick=quick)) as report:
        result = run_demo(seed=seed, quick=quick, progress=report)
    with progress("drawing the report"):
        result.save(out)
    if as_json:
        print_json(result.to_dict())
        return
    print_line(str(result))
    print_line(f"Look at {out / 'report.html'}; the numbers are in {out / 'summary.json'}.")
