"""The commands of the paper: demo and reproduce."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer
from typer import Argument, Option

from truearm.choices import Trainer
from truearm.errors import InputError
from truearm.pages.drawings.page_record import check_folder
from truearm.verbs import options
from truearm.verbs.commands import layer_sizes
from truearm.verbs.console import print_json, print_line, print_status, progress


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


STEPS = 10_000  # of the bar
# Options of one use of the command.
OF_PAPER = ("table", "figure", "everything", "time_limit")
OF_READINGS = (
    "test", "arm", "free", "hidden", "trainer", "goal", "learning_rate", "epochs", "folds", "seed"
)  # fmt: skip


@options.of_verb("truearm.wings.gao2017.reproduce:reproduce", omit=("folder",))
def reproduce(
    verb: Any,
    context: typer.Context,
    paper: Annotated[Literal["gao2017"], Argument(metavar="PAPER", help="The paper: gao2017.")],
    everything: Annotated[bool, Option("--all", help="All of it: an hour and a quarter on two cores.")] = False,
    readings: options.ReadSession = None,
    test: Annotated[
        Path | None, Option("--test-session", help="Fresh readings to test on; else those held out of the folds.")
    ] = None,
    hidden: Annotated[
        list[str] | None, Option(metavar="20,20", help="Units of the hidden layers to try; repeat it for more.")
    ] = None,
    trainer: Annotated[
        list[str] | None, Option(help=f"Trainer to try ({', '.join(get_args(Trainer))}); repeat it for more.")
    ] = None,
    goal: Annotated[
        list[float] | None, Option(metavar="MSE", help="Goal to try, 0 (none) by default; repeat it for more.")
    ] = None,
    learning_rate: Annotated[
        list[float] | None,
        Option(metavar="RATE", help="Learning rate of traingd or traingdx to try; repeat it for more."),
    ] = None,
    epochs: Annotated[int, Option(min=1, help="Maximum epochs of a training of the search.")] = 200,
    folds: Annotated[int, Option(min=2, help="Folds of the cross-validation.")] = 5,
    seed: options.Seed = 0,
    out: Annotated[Path, Option(metavar="DIR", help="For the page and the trainings.")] = Path("truearm-gao2017"),
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Reproduce a paper, or follow its procedure on your readings.

    Trains every row of the paper's tables by MATLAB's rules (trainlm) and by truearm's own trainer (varpro), and
    compares the results with the printed numbers. Finished trainings stay in the folder: after an
    interruption the same command resumes with the next one.

    --session FILE: the paper's procedure on your arm. Networks of several structures and settings are tried by
    cross-validation; the one with the smallest error is trained on all readings, written as network.truearm and
    tested on fresh readings (--test-session), beside models of the arm (--arm, with --free as in truearm fit).

    --quick: one start a row, and long trainings are skipped; with --session three small networks.
    """
    if readings is not None:
        options.refuse_typed(context, OF_PAPER, "does not go with --session: it is of the paper's own arm")
        search: dict[str, Any] = {"hidden": tuple(map(layer_sizes, hidden or ())), "trainer": trainer or ("varpro",)}
        search |= {"goal": goal or (0.0,), "learning_rate": learning_rate or ()}
        search = {name: tuple(values) for name, values in search.items()}
        search |= {"epochs": epochs, "folds": folds, "seed": seed}
        _run(verb, paper, out, {**given, "readings": readings, "test": test, **search}, as_json=as_json)
        return
    options.refuse_typed(context, OF_READINGS, "applies to --session only")
    parts = sum((given["table"] is not None, given["figure"] is not None, everything))
    if parts > 1:
        raise InputError("expected one of --table, --figure and --all, got more")
    if not parts and not given["quick"]:
        raise InputError(
            "expected what to reproduce, got neither --table nor --figure nor --all",
            hint="--quick, which takes minutes; --all takes an hour and a quarter",
        )
    _run(verb, paper, out, given, as_json=as_json)


def _run(verb: Any, paper: Literal["gao2017"], out: Path, given: dict[str, Any], *, as_json: bool) -> None:
    """Run, write the files and print the result."""
    try:
        with progress("reproducing", total=STEPS) as tell:
            result = verb(paper, folder=out, progress=lambda share, note: tell(round(STEPS * share), note), **given)
    except (KeyboardInterrupt, SystemExit):
        print_status(f"truearm: finished trainings are in {out / 'runs'}; the same command resumes with the next one")
        raise
    with progress("drawing the page"):
        numbers, page, *others = result.save(out)
    if as_json:
        print_json(result.to_dict())
        return
    print_line(str(result))
    pictures = [str(file) for file in others if file.suffix == ".png"]
    more = [f"the model is {file}" for file in others if file.suffix == ".truearm"]
    more += [f"the picture{'s' * (len(pictures) > 1)} in {', '.join(pictures)}"] if pictures else []
    print_line(f"The page is {page}; {', '.join([f'the numbers are in {numbers}', *more])}.")
