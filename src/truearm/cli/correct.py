"""``truearm correct``: joint targets that bring the arm where it should be."""

from __future__ import annotations

from math import radians
from pathlib import Path
from typing import Annotated, Literal

import typer

from truearm.cli.console import (
    Json,
    ModelFile,
    check_output_is_not_input,
    numbers_of,
    print_line,
    print_record,
    progress,
)


def correct(
    model: ModelFile,
    targets: Annotated[
        Path,
        typer.Argument(
            metavar="TARGETS", help="Table of targets, .csv: joints, or poses of the tip with start joints."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="File to write: .csv, or by --as .script, .mod, .dat, .ls.")],
    direction: Annotated[
        Literal["command", "feedback"],
        typer.Option("--direction", help="command: what to send to the controller; feedback: what its encoders mean."),
    ] = "command",
    language: Annotated[
        Literal["urscript", "rapid", "krl", "fanuc"] | None,
        typer.Option("--as", help="Write the targets in a robot language instead of a table."),
    ] = None,
    fanuc_j3: Annotated[
        Literal["coupled", "independent"] | None,
        typer.Option(
            "--fanuc-j3",
            help="With --as fanuc: J3 as the teach pendant shows it (coupled with J2), or as in the model.",
        ),
    ] = None,
    frame: Annotated[
        Literal["reference", "base"],
        typer.Option("--frame", help="Frame of poses: that of the model's points, or the arm's own base frame."),
    ] = "reference",
    tool: Annotated[
        str | None,
        typer.Option(
            "--tool",
            metavar="X,Y,Z[,R,P,Y]",
            help="Tip in the flange [mm] and roll, pitch, yaw [deg], in place of the tip in the readings.",
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option("--start", metavar="Q1,Q2,..", help="Start joints [deg, mm] of all poses, if the table has none."),
    ] = None,
    tip: Annotated[str | None, typer.Option("--tip", help="Name of the tip, of a model with several.")] = None,
    untrained: Annotated[
        Literal["refuse", "accept"],
        typer.Option("--untrained", help="Targets outside the trained range: refuse them, or correct and flag them."),
    ] = "refuse",
    uncertainty: Annotated[
        bool, typer.Option(help="Compute the uncertainty of the tip; without it correction is faster.")
    ] = True,
    as_json: Json = False,
) -> None:
    """Correct the joint targets of a robot program.

    The arm then goes where the program says.

    Columns of the table, as in docs/correct.md: joints q1_deg .. (or q1_rad; q1_mm for a sliding joint); for poses also
    x_mm, y_mm, z_mm with qw .. qz, rx_deg .. rz_deg (rotation vector), roll_deg, pitch_deg, yaw_deg or r11 .. r33. The
    file written has the same joint columns, and for each target a status: ok, or the reason for which it was refused.

    Exit code 0: all targets corrected; 1: some refused; 3: none corrected, nothing written.
    """
    from truearm.files.atomic_write import check_writable
    from truearm.workflows.correct import FANUC_J3_TEXT, check_output
    from truearm.workflows.correct import correct as correct_targets
    from truearm.workflows.inputs import to_model_of_tip

    check_output(out, language, fanuc_j3)
    check_output_is_not_input(out, model, targets)
    check_writable(out)
    with progress(f"correcting {targets.name}"):
        fitted = to_model_of_tip(model, tip)
        corrected = correct_targets(
            fitted,
            targets,
            direction=direction,
            frame=frame,
            tool=_tool_of(tool),
            start=_start_of(start, fitted.arm.chain.is_prismatic.tolist()),
            untrained=untrained,
            uncertainty=uncertainty,
        )
        n_refused = int(corrected.refused.sum())
        any_good = n_refused < len(corrected.refused)
        if any_good:
            corrected.save(out, language=language, fanuc_j3=fanuc_j3)
    print_record(corrected, as_json=as_json, files={"targets": out if any_good else None})
    if fanuc_j3 is not None and any_good and not as_json:
        print_line(FANUC_J3_TEXT[fanuc_j3])
    raise typer.Exit(0 if not n_refused else 1 if any_good else 3)


def _tool_of(option: str | None) -> list[float] | None:
    """The option --tool in mm and rad."""
    if option is None:
        return None
    numbers = numbers_of(option, "--tool", "0,0,120")
    return numbers[:3] + [radians(q) for q in numbers[3:]]


def _start_of(option: str | None, slides: list[bool]) -> list[float] | None:
    """The option --start in rad, and mm of sliding joints."""
    if option is None:
        return None
    numbers = numbers_of(option, "--start", "0,-90,90,0,90,0")
    return [q if i < len(slides) and slides[i] else radians(q) for i, q in enumerate(numbers)]
