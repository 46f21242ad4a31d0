"""``truearm reproduce``: the tables and figures of a paper beside their reproduction."""

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
        bool, typer.Option("--quick", help="One start a row, long trainings skipped: minutes; alone: --all.")
    ] = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the page and the trainings.")] = Path(
        "truearm-gao2017"
    ),
    as_json: Json = False,
) -> None:
    """Reproduce the tables and figures of a paper.

    Trains every row of the paper's tables by MATLAB's rules (trainlm) and by truearm's own trainer (varpro), and
    compares the results with the printed numbers. Finished trainings stay in the folder: after an
    interruption the same command resumes with the next one.
    """
    del paper  # there is one
    import json

    from truearm.errors import InputError
    from truearm.files.atomic_write import atomic_file, check_writable
    from truearm.pages.html import render
    from truearm.pages.plotting import save_png
    from truearm.papers.gao2017.reproduction import reproduce as reproduced
    from truearm.papers.gao2017.reproduction_page import paper_figure, reproduction_page
    from truearm.papers.gao2017.training_plan import FULL_EFFORT, PARTS, QUICK_EFFORT
    from truearm.workflows.record import to_plain

    parts = _parts(PARTS, table=table, figure=figure, everything=everything, quick=quick)
    if out.exists() and not out.is_dir():
        raise InputError("expected a folder to write to, got a file", file=out)
    runs = out / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    # A part has file names of its own, so that it does not replace the page of everything.
    stem = parts[0].replace(" ", "-") if len(parts) == 1 else "reproduction"
    files = [out / f"{stem}{kind}" for kind in (".json", ".html", *([".png"] if figure else []))]
    for file in files:
        check_writable(file)
    try:
        with progress("reproducing", total=STEPS) as tell:
            results = reproduced(
                parts,
                effort=QUICK_EFFORT if quick else FULL_EFFORT,
                folder=runs,
                progress=lambda share, note: tell(round(STEPS * share), note),
            )
    except (KeyboardInterrupt, SystemExit):
        print_status(f"truearm: finished trainings are in {runs}; the same command resumes with the next one")
        raise
    with progress("drawing the page"):
        page = reproduction_page(results)
        html = render(page)
    picture = None if figure is None else paper_figure(page, figure)
    if picture is not None:
        save_png(picture, files[2])
    found = to_plain(results)
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
        print_line("trainlm fits 70 % of the poses (15 % for validation, 15 % for test), varpro fits all of them.")
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
    for part in found["skipped"]:
        print_line(f"skipped: {part}")
    pictures = "".join(f", the picture in {file}" for file in files[2:])
    print_line(f"The page is {files[1]}; the numbers are in {files[0]}{pictures}.")


def _lines(row: Mapping[str, Any]) -> list[list[str]]:
    paper = row["paper"]
    network = "-".join(map(str, paper["hidden"]))
    lines = [[str(paper["row"]), network, "paper", f"{paper['mean_mm']:.4g}", "", *_effort(paper), "", ""]]
    for method, one in row["results"].items():
        verdict = row["verdict"][method] or ""
        if one is None:
            lines.append(["", "", method, "", "", "", "", "", verdict])
            continue
        if not verdict and row["same_training_as"]:
            verdict = f"as row {row['same_training_as']}"
        low, high = one["range_mm"]
        spread = f"[{low:.3g}, {high:.3g}]" if len(one["runs"]) > 1 else ""
        mean, ratio = one["median"]["mean_many_mm"], row["ratio"][method]
        lines.append(["", "", one["trainer"], f"{mean:.4g}", spread, *_effort(one["median"]), f"{ratio:.2f}", verdict])
    return lines


def _effort(result: Mapping[str, Any]) -> list[str]:
    return [f"{result['epochs']:.0f}", f"{result['seconds']:.1f}"]


def _say_final(test: Mapping[str, Any]) -> None:
    print_line(f"Final test: {test['poses']} further poses of each arm, absolute error of a coordinate [mm]")
    arms = {"paper": test["paper"], **{f"seed {run['seed']}": run["errors"] for run in test["runs"]}}
    rows = []
    for arm, models in arms.items():
        for i, (model, errors) in enumerate(models.items()):
            over = [str(count) for count in errors["over_mm"].values()]
            compensated = ["", "", ""] if model == "nominal" else [*over, f"{errors['removed_percent']:.1f}"]
            size = [f"{errors['mean_mm']:.4f}", f"{errors['max_mm']:.4f}"]
            rows.append(["" if i else arm, model, *size, *compensated])
    print_table(["arm", "model", "mean", "max", "> 0.05", "> 0.08", "removed %"], rows, left_aligned=(0, 1))
    print_line("")
