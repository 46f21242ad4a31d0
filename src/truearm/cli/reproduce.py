"""``truearm reproduce``: a paper's tables and figures, computed anew beside what it prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from truearm.cli.console import Json, print_json, print_line, print_status, print_table, progress

TABLE_HEADS = {
    2: "Table 2, simulation 1",
    3: "Table 3, simulation 2",
    4: "Table 4, experiment on virtual arms",
}
STEPS = 10_000  # of the bar


def reproduce(
    paper: Annotated[Literal["gao2017"], typer.Argument(metavar="PAPER", help="The paper: gao2017.")],
    table: Annotated[int | None, typer.Option("--table", metavar="2|3|4", help="One table only.")] = None,
    figure: Annotated[
        int | None, typer.Option("--figure", metavar="1..8", help="One figure only, also as figure-N.png.")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="All of it: about an hour on two cores.")] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="One start a row, long trainings left out: minutes; alone: --all.")
    ] = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the page and the trainings.")] = Path(
        "truearm-gao2017"
    ),
    as_json: Json = False,
) -> None:
    """Compute a paper's tables and figures anew.

    Every row of the paper's tables is trained as MATLAB would and by truearm's own trainer, and set beside the printed
    numbers. A training that was run stays in the folder: stopped, the same command goes on where it was.
    """
    del paper  # there is one
    import json

    from truearm.errors import InputError
    from truearm.files.atomic_write import atomic_file, check_writable
    from truearm.pages.html import render
    from truearm.pages.plotting import save_png
    from truearm.papers.gao2017.reproduction import reproduce as reproduced
    from truearm.papers.gao2017.reproduction_page import reproduction_page
    from truearm.papers.gao2017.training_plan import FULL_EFFORT, PARTS, QUICK_EFFORT

    parts = _parts(PARTS, table=table, figure=figure, everything=everything, quick=quick)
    if out.exists() and not out.is_dir():
        raise InputError("expected a folder to write to, got a file", file=out)
    runs = out / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    # A part has names of its own: it is not to take the place of the page of all.
    stem = parts[0].replace(" ", "-") if len(parts) == 1 else "reproduction"
    files = [out / f"{stem}{kind}" for kind in (".json", ".html", *([".png"] if figure else []))]
    for file in files:
        check_writable(file)
    try:
        with progress("reproducing", total=STEPS) as tell:
            found = reproduced(
                parts,
                effort=QUICK_EFFORT if quick else FULL_EFFORT,
                folder=runs,
                tell=lambda share, how: tell(round(STEPS * share), how),
            )
    except (KeyboardInterrupt, SystemExit):
        print_status(f"truearm: the same command goes on from what is in {runs}")
        raise
    with progress("drawing the page"):
        page = reproduction_page(found)
        html = render(page)
    for picture in (picture for section in page.sections for picture in section.figures if figure):
        if picture.caption.startswith(f"Figure {figure} "):
            save_png(picture, files[2])
    for file, text in zip(files, (json.dumps(found, indent=1, allow_nan=False) + "\n", html), strict=False):
        with atomic_file(file) as beside:
            beside.write_text(text, encoding="utf-8", newline="\n")
    if as_json:
        print_json(found)
    else:
        _say(found, files)


def _parts(
    known: Sequence[str], *, table: int | None, figure: int | None, everything: bool, quick: bool
) -> tuple[str, ...]:
    """What was asked for, as the reproduction names it."""
    from truearm.errors import InputError

    if sum((table is not None, figure is not None, everything)) > 1:
        raise InputError("expected one of --table, --figure and --all, got more")
    if table is None and figure is None:
        if not everything and not quick:
            raise InputError(
                "expected what to reproduce, got neither --table nor --figure nor --all",
                hint="--quick, which takes minutes; --all takes about an hour",
            )
        return tuple(known)
    part = f"table {table}" if figure is None else f"figure {figure}"
    if part not in known:
        kind, number = part.split()
        numbers = ", ".join(name.split()[1] for name in known if name.startswith(kind))
        raise InputError(f"expected --{kind} among {numbers}, got {number}")
    return (part,)


def _say(found: Mapping[str, Any], files: Sequence[Path]) -> None:
    if any(found["tables"].values()):
        print_line("trainlm fits 70 % of the poses (15 % stop it, 15 % are MATLAB's test set), lm fits all of them.")
    for number, head in TABLE_HEADS.items():
        rows = found["tables"][str(number)]
        if rows is not None:
            print_line(f"{head}: absolute error of a coordinate [mm], median over starts [least, largest]")
            print_table(
                ["row", "network", "by", "mean", "", "epochs", "s", "ratio", "verdict"],
                [line for row in rows for line in _lines(row)],
                left_aligned=(0, 1, 2, 4, 8),
            )
            print_line("")
    if found["final_test"] is not None:
        _say_final(found["final_test"])
    for part in found["left_out"]:
        print_line(f"left out: {part}")
    print_line(
        f"Look at {files[1]}; the numbers are in {files[0]}{''.join(f', the picture in {f}' for f in files[2:])}."
    )


def _lines(row: Mapping[str, Any]) -> list[list[str]]:
    paper, network = row["paper"], "-".join(map(str, row["hidden"]))
    lines = [
        [str(row["row"]), network, "paper", f"{paper['mean_mm']:.4g}", "", *_effort(paper), "", ""],
    ]
    for side, verdict in (("faithful", row["verdict"]), ("ours", row["verdict_ours"])):
        one = row[side]
        if one is None:
            lines.append(["", "", side, "", "", "", "", "", verdict or ""])
            continue
        low, high = one["range_mm"]
        spread = f"[{low:.3g}, {high:.3g}]" if len(one["runs"]) > 1 else ""
        mean, ratio = one["median"]["mean_many_mm"], row["ratio"][side]
        told = verdict or (f"as row {row['same_training_as']}" if row["same_training_as"] else "")
        lines.append(["", "", one["trainer"], f"{mean:.4g}", spread, *_effort(one["median"]), f"{ratio:.2f}", told])
    return lines


def _effort(result: Mapping[str, Any]) -> list[str]:
    return [f"{result['epochs']:.0f}", f"{result['seconds']:.1f}"]


def _say_final(test: Mapping[str, Any]) -> None:
    paper = test["paper"]
    print_line(f"Final test: {test['poses']} further poses of each arm, absolute error of a coordinate [mm]")
    rows = [
        ["paper", "nominal", f"{paper['nominal']['mean_mm']:.4f}", f"{paper['nominal']['max_mm']:.4f}", "", "", ""],
        ["", "network", *_compensated(paper["network"])],
    ]
    for run in test["runs"]:
        nominal = [f"{run['nominal']['mean_mm']:.4f}", f"{run['nominal']['max_mm']:.4f}"]
        rows.append([f"seed {run['seed']}", "nominal", *nominal, "", "", ""])
        rows += [["", model, *_compensated(run[model])] for model in ("faithful", "ours", "kinematic") if run[model]]
    print_table(["arm", "model", "mean", "max", "> 0.05", "> 0.08", "removed %"], rows, left_aligned=(0, 1))
    print_line("")


def _compensated(errors: Mapping[str, Any]) -> list[str]:
    return [
        f"{errors['mean_mm']:.4f}",
        f"{errors['max_mm']:.4f}",
        str(errors["over_0.05"]),
        str(errors["over_0.08"]),
        f"{errors['removed_percent']:.1f}",
    ]
