"""``truearm demo``: an arm's error before and after compensation, without an arm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truearm.cli.console import Json, print_json, print_line, print_table, progress

if TYPE_CHECKING:
    from truearm.pages.page import Page
    from truearm.workflows.demo import Experiment


def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for the report, a picture and the figures.")] = Path(
        "truearm-demo"
    ),
    seed: Annotated[int, typer.Option("--seed", min=0, help="Another arm, other poses, other noise.")] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Half of the poses and a smaller network.")] = False,
    as_json: Json = False,
) -> None:
    """See an arm's error before and after compensation.

    Repeats the founding paper's experiment on a virtual measuring arm: 3000 poses in a box of joint angles teach a
    network (the paper's 30-30) and identify a kinematic model; both are tested on 200 further poses of the box, and on
    200 poses of everyday measuring, which reach far outside it.
    """
    import json

    import numpy as np

    from truearm.compensation.models.error_figures import before_after
    from truearm.errors import InputError
    from truearm.files.atomic_write import atomic_file
    from truearm.pages.html import render
    from truearm.pages.plotting import save_png
    from truearm.workflows.demo import PAPER_SETTINGS, QUICK_SETTINGS, experiment

    if out.exists() and not out.is_dir():
        raise InputError("expected a folder to write to, got a file", file=out)
    _check_folder(out)
    settings = QUICK_SETTINGS if quick else PAPER_SETTINGS
    with progress("measuring, fitting", total=settings.epochs) as tell:
        done = experiment(seed=seed, settings=settings, progress=tell)
    with progress("drawing the report"):
        summary = done.summary()
        distances = {name: np.linalg.norm(errors, axis=1) for name, errors in done.deviations("box").items()}
        picture = before_after(distances)
        files = {
            "report.html": render(demo_page(done, quick=quick)),
            "summary.json": json.dumps(summary, indent=2, allow_nan=False) + "\n",
        }
    # All that takes time is done: an interruption before this leaves no folder behind.
    out.mkdir(parents=True, exist_ok=True)
    save_png(picture, out / "before_after.png")
    for name, text in files.items():
        with atomic_file(out / name) as beside:
            beside.write_text(text, encoding="utf-8", newline="\n")
    if as_json:
        print_json(summary)
    else:
        _say(summary, out)


def _check_folder(out: Path) -> None:
    """Check, before long work, that a folder can be written to, or made where it is not there yet."""
    from truearm.files.atomic_write import check_writable

    if out.is_dir():
        for name in ("report.html", "summary.json", "before_after.png"):
            check_writable(out / name)
        return
    there = next(folder for folder in out.absolute().parents if folder.exists())
    check_writable(there / out.absolute().relative_to(there).parts[0])


def _say(summary: dict[str, Any], out: Path) -> None:
    from truearm.workflows.demo import PAPER_NETWORK_MM

    floor = summary["noise_floor"]
    rows = [
        [
            name,
            f"{m['mean_abs_coordinate_mm']:.4f}",
            f"{m['max_abs_coordinate_mm']:.4f}",
            f"{m['removed_percent']:.1f}" if name != "nominal" else "",
            f"{m['outside']['mean_abs_coordinate_mm']:.4f}",
            f"{m['outside']['max_abs_coordinate_mm']:.4f}",
            f"{m['fit_seconds']:.1f}",
        ]
        for name, m in summary["models"].items()
    ]
    rows.append(
        [
            "noise floor",
            f"{floor['mean_abs_coordinate_mm']:.4f}",
            f"{floor['max_abs_coordinate_mm']:.4f}",
            "",
            "",
            "",
            "",
        ]
    )
    n_train, n = summary["models"]["network"]["n_train"], summary["models"]["network"]["n"]
    print_line(
        f"Virtual arm {summary['arm']}, seed {summary['seed']}: {n_train} poses to learn from, {n} + {n} to test on."
    )
    print_line(
        "Absolute error of a coordinate [mm], in the box of joint angles learned from, and in everyday measuring:"
    )
    print_table(["model", "mean", "max", "removed %", "outside mean", "outside max", "fit s"], rows)
    print_line(
        f"The paper's network, on its own arm: mean {PAPER_NETWORK_MM[0]}, max {PAPER_NETWORK_MM[1]}, 97 % removed."
    )
    print_line("The network holds only inside the box it learned; the kinematic model holds outside it too.")
    print_line(f"Look at {out / 'report.html'}; the figures are in {out / 'summary.json'}.")


def demo_page(done: Experiment, *, quick: bool) -> Page:
    """The report of the demo: the box in full, the poses outside it as a table."""
    from truearm.cli.report import compared, facts
    from truearm.compensation.models.comparison_page import comparison_page, error_table
    from truearm.pages.page import Section

    readings = done.tests["box"].readings
    floor = done.arm.noise_floor(done.tests["box"])["mean_abs_coordinate_mm"]
    outside = Section(
        "Outside what was learned",
        "Poses of everyday measuring reach far beyond the box of joint angles that the models learned from. A network "
        "knows nothing there. The kinematic model describes the arm itself: its constants hold everywhere, and what it "
        "leaves over (encoder harmonics, bending) is what its kind of model does not describe.",
        tables=(
            error_table(
                {name: dict(errors) for name, errors in done.errors("measuring").items()},  # type: ignore[arg-type]
                caption="Errors on poses of everyday measuring, none of them learned from",
            ),
        ),
    )
    page_facts = [
        ("experiment", f"virtual arm, preset {done.arm.preset.name}, seed {done.arm.seed}{', quick' if quick else ''}"),
        ("noise floor", f"{floor:.4f} mm mean absolute coordinate error: no model can be better"),
        *facts(done.models, readings),
    ]
    return comparison_page(
        compared(done.models, readings),
        title="A measuring arm before and after compensation",
        subtitle="The experiment of Gao et al. (Complexity 2017, 5156264) on a virtual arm that errs as theirs did",
        facts=page_facts,
        floor=dict(done.arm.noise_floor(done.tests["box"])),  # type: ignore[arg-type]
        more=(outside,),
    )
