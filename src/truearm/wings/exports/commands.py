"""The commands that write for other programs: correct and export."""

from __future__ import annotations

from math import radians
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.verbs import options
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.outputs import check_output as check_file
from truearm.wings.exports.formats import ExportFormat
from truearm.wings.exports.targets import FanucJ3, Frame, RobotLanguage

FrameOption = Annotated[
    Frame | None, Option(help="Frame of poses or of constants: that of the model's points, or the arm's own base.")
]


# What a program states itself, and what is of programs alone.
OF_TABLES = ("language", "fanuc_j3", "frame", "tool", "uncertainty", "conditions")
OF_PROGRAMS = ("frames", "diff", "subdivide")
# Of tables and poses; a file of another program has joints only, and is written as it is.
OF_POSES = ("language", "fanuc_j3", "frame", "start")
OF_JOINT_TABLES = ("angle_unit", "motors")


@options.of_verb("truearm.wings.exports.correct:correct")
def correct(
    verb: Any,
    context: typer.Context,
    model: options.ModelFile,
    targets: Annotated[
        Path, Argument(metavar="TARGETS", help="A robot program, or a table of targets: joints, or poses of the tip.")
    ],
    out: Annotated[Path, Option(help="File to write: a program; .csv, or by --as .script, .mod, .dat, .ls.")],
    language: Annotated[RobotLanguage | None, Option("--as", help="Format of --out.")] = None,
    fanuc_j3: Annotated[
        FanucJ3 | None,
        Option(help="With --as fanuc: J3 as the teach pendant shows it (coupled with J2), or as in the model."),
    ] = None,
    frame: FrameOption = "reference",
    tool: Annotated[
        str | None,
        Option(metavar="X,Y,Z[,R,P,Y]", help="Tip in the flange [mm] and roll, pitch, yaw [deg], for the model's tip."),
    ] = None,
    start: Annotated[
        str | None, Option(metavar="Q1,Q2,..", help="Start joints [deg, mm] of all poses, if the table has none.")
    ] = None,
    frames: Annotated[Path | None, Option(help="Tools and work frames of a program, .toml.")] = None,
    subdivide: Annotated[
        float | None, Option(metavar="MM", help="Of a program: add targets to straight moves, so far apart at most.")
    ] = None,
    diff: Annotated[bool, Option("--diff", help="Of a program: also list old and new targets.")] = False,
    tip: options.TipName = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Correct the joint targets of a robot program.

    The arm then goes where the program says. --as writes the targets in a robot language instead of a table. Targets
    outside the trained range are refused, or corrected and flagged: --untrained accept.

    Columns of the table, as in docs/correct.md: joints q1_deg .. (or q1_rad; q1_mm for a sliding joint); for poses also
    x_mm, y_mm, z_mm with qw .. qz, rx_deg .. rz_deg (rotation vector), roll_deg, pitch_deg, yaw_deg or r11 .. r33. The
    file written has the same joint columns, and for each target a status: ok, or the reason for which it was refused.

    Exit code 0: all targets corrected; 1: some refused; 3: none corrected, nothing written.
    """
    from truearm.verbs.inputs import to_model_of_tip
    from truearm.wings.exports.correct import FANUC_J3_TEXT, check_output, check_output_of, targets_of_joint_file
    from truearm.wings.exports.programs.correct_program import is_program
    from truearm.wings.exports.targets.lerobot_motors import check_no_data_set
    from truearm.wings.exports.targets.manifest import read_manifest

    check_no_data_set(targets)
    if is_program(targets):
        options.refuse_typed(context, (*OF_TABLES, *OF_JOINT_TABLES), "does not apply to a robot program")
        chosen = {"direction": given["direction"], "untrained": given["untrained"], "frames": frames}
        _correct_program(model, tip, targets, out, start, diff=diff, as_json=as_json, subdivide_mm=subdivide, **chosen)
    options.refuse_typed(context, OF_PROGRAMS, "applies to robot programs only")
    fitted = to_model_of_tip(model, tip)
    of_file = {name: given[name] for name in ("direction", *OF_JOINT_TABLES)}
    source = targets_of_joint_file(targets, fitted, **of_file)
    if source is None:
        options.refuse_typed(context, OF_JOINT_TABLES, "applies to tables of LeRobot and ROS only")
        check_output(out, language, fanuc_j3)
        check_file(out, model, targets, read=read_manifest)
    else:
        options.refuse_typed(context, OF_POSES, "does not apply to joints in a file of another program")
        check_output_of(out, targets)
    with progress(f"correcting {targets.name}"):
        start_joints = _start_of(start, fitted.arm.chain.is_prismatic.tolist())
        corrected = verb(fitted, source or targets, frame=frame, tool=_tool_of(tool), start=start_joints, **given)
        n_refused = int(corrected.refused.sum())
        any_good = n_refused < len(corrected.refused) if source is None else not n_refused
        if any_good:
            corrected.save(out, language=language, fanuc_j3=fanuc_j3)
    print_record(corrected, as_json=as_json, files={"targets": out if any_good else None})
    if fanuc_j3 is not None and any_good and not as_json:
        print_line(FANUC_J3_TEXT[fanuc_j3])
    raise typer.Exit(0 if not n_refused else 1 if any_good else 3)


def _correct_program(
    model: Path,
    tip: str | None,
    program: Path,
    out: Path,
    start: str | None,
    *,
    diff: bool,
    as_json: bool,
    frames: Path | None,
    **given: Any,
) -> NoReturn:
    """Correct a program and print what was done; exit with the code of the command."""
    from truearm.verbs.inputs import to_model_of_tip
    from truearm.wings.exports.programs.correct_program import correct_program, read_corrected
    from truearm.wings.exports.programs.program import N_AXES

    fitted = to_model_of_tip(model, tip)
    slides = fitted.arm_.chain.is_prismatic.tolist()
    joints = _start_of(start, slides[1:] if len(slides) > N_AXES else slides)  # without the rail under a robot
    check_file(out, program, frames, endings=(program.suffix,), read=read_corrected)
    with progress(f"correcting {program.name}"):
        corrected = correct_program(fitted, program, frames=frames, start=joints, **given)
        if corrected.changes:
            corrected.save(out)
    print_record(corrected, as_json=as_json, files={"program": out if corrected.changes else None})
    if diff and corrected.changes and not as_json:
        print_line(str(corrected.difference()))
    raise typer.Exit(3 if not corrected.changes else 0 if corrected.is_complete else 1)


def _tool_of(option: str | None) -> list[float] | None:
    """The option --tool in mm and rad."""
    if option is None:
        return None
    numbers = options.numbers_of(option, "--tool", "0,0,120")
    return numbers[:3] + [radians(q) for q in numbers[3:]]


def _start_of(option: str | None, slides: list[bool]) -> list[float] | None:
    """The option --start in rad, and mm of sliding joints."""
    if option is None:
        return None
    numbers = options.numbers_of(option, "--start", "0,-90,90,0,90,0")
    return [q if i < len(slides) and slides[i] else radians(q) for i, q in enumerate(numbers)]


@options.of_verb("truearm.wings.exports.export:export")
def export(
    verb: Any,
    model: options.ModelFile,
    out: Annotated[Path | None, Option(help="File to write; its ending states the format.")] = None,
    format: Annotated[ExportFormat | None, Option("--as", help="Format of --out.", show_default=False)] = None,
    region: Annotated[
        Path | None,
        Option(help="Session or targets: the poses at which a file of constants must be good; training poses."),
    ] = None,
    source: Annotated[
        str, Option("--original", help="The robot's own file, of which all else is kept: see docs/export.md.")
    ] = "",
    frame: FrameOption = None,
    check: Annotated[Path | None, Option(help="An exported file to compare with the model, in place of --out.")] = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Write a model as a file of another program.

    .c, .mjs, .onnx and .json hold the whole model. A URDF and tables of constants hold the rigid arm that is nearest to
    it over a region; what is lost is printed and stands in the file. Each file states its origin and has five check
    poses; --check FILE runs them (exit code 1: the file does not agree with the model; 3: nothing differs, but its
    content was not run). Constants are by default in the convention with the nominal arm's numbers, and from the
    arm's own base. --as states the format where the ending leaves it open.
    """
    from truearm.wings.exports.export import check_export

    if (out is None) == (check is None):
        raise InputError("expected one of --out and --check", hint="truearm export MODEL --out arm.urdf")
    if check is not None:
        found = check_export(model, check, tip=given["tip"])
        print_record(found, as_json=as_json)
        raise typer.Exit({"agrees": 0, "differs": 1, "not verified": 3}[found.verdict])
    assert out is not None
    with progress(f"exporting {model.name}"):
        result = verb(model, out, format=format, region=region, source=source or None, frame=frame, **given)
    print_record(result, as_json=as_json, files={result.format: out})
