"""The commands that report: arms, compare and report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from truearm.choices import Convention
from truearm.errors import InputError
from truearm.pages import FigureFormat
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.outputs import check_new_output


def arms(
    context: typer.Context,
    arm: Annotated[
        str, Argument(metavar="[ARM]", help=f"{options.ARM_HELP} Or a model file.", show_default=False)
    ] = "",
    out: Annotated[Path | None, Option(help="Arm file to write, .toml or .urdf.")] = None,
    page: options.Page = None,
    convention: options.ConventionOption = "dh",
    readings: options.ReadSession = None,
    lengths: options.LengthsFile = None,
    search: Annotated[str, Option(help="List only the arms whose name or title has these words.")] = "",
    free: options.FreeOption = "base,tip",
    apply: options.ArmOut = None,
    from_circles: Annotated[
        Path | None, Option(help="A session in which each joint in turn moves alone: measure an arm without a drawing.")
    ] = None,
    circles_plan: Annotated[
        int | None, Option(metavar="N", help="Write the session of --from-circles to fill in, for N joints, to --out.")
    ] = None,
    points: Annotated[int, Option(help="With --circles-plan: points of each circle.")] = 12,
    span: Annotated[
        float, Option(help="With --circles-plan: from the first to the last angle of a circle [deg].")
    ] = 60,
    noise: Annotated[float, Option(help="Standard deviation of a coordinate [mm].")] = 1.0,
    accept: options.AcceptOption = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """List the arms known by name, or print or write one.

    Without a name: the list, with --search those of a maker or type. With a name, also as its maker writes it: the
    constants of the nominal arm. With a model file: the identified arm, with base and tip in the frame of the
    reference. With a name and --out: an arm file, to edit into your own arm's, or to use elsewhere. With --page: a page
    on which the arm is turned with the mouse and its joints are moved, to see whether a file describes an arm.
    With --session: what is wrong where arm and readings contradict each other, with --free as in truearm fit. Nothing
    is changed; --apply writes the arm without the mistake to a new file.
    With --from-circles: an arm without a drawing, measured by the circles that its joints describe one by one.
    Exit code 1: a joint is not measured, and the arm file marks it.
    """
    if circles_plan is None:
        options.refuse_typed(context, ("points", "span", "noise"), "applies to --circles-plan only")
    if from_circles is None:
        options.refuse_typed(context, ("accept",), "applies to --from-circles only")
    if from_circles is not None or circles_plan is not None:
        of_name = ("arm", "page", "readings", "lengths", "free", "apply")
        options.refuse_typed(context, of_name, "does not apply to --from-circles and --circles-plan")
    if from_circles is not None and circles_plan is not None:
        raise InputError("--circles-plan writes the file that --from-circles reads", hint="one of them at a time")
    if circles_plan is not None:
        _plan_circles(out, circles_plan, points, span, noise, force=force, as_json=as_json)
    elif from_circles is not None:
        _measure(from_circles, out, convention, accept, force=force, as_json=as_json)
    elif readings is not None or lengths is not None or apply is not None:
        nominal, session = _of_nominal_arm(arm, readings, out, page)
        _diagnose(nominal, session, lengths, free, apply, force=force, as_json=as_json)
    elif search and arm:
        raise InputError("--search needs no name of an arm", hint=f"truearm arms --search '{search}'")
    elif arm:
        _describe(arm, out, page, convention, force=force, as_json=as_json)
    else:
        _list(search, out, page, as_json=as_json)


def _list(search: str, out: Path | None, page: Path | None, *, as_json: bool) -> None:
    from truearm.wings.reports.arms import catalogue

    if out is not None or page is not None:
        option, file = ("--page", "arm.html") if out is None else ("--out", "my-arm.toml")
        raise InputError(f"{option} needs the name of an arm", hint=f"truearm arms gao2017 {option} {file}")
    print_record(catalogue(search), as_json=as_json)


def _describe(
    arm: str, out: Path | None, page: Path | None, convention: Convention, *, force: bool, as_json: bool
) -> None:
    """Print an arm, or write it to a file."""
    from truearm.arm import write_arm
    from truearm.arm.catalogue import arm_path
    from truearm.verbs.inputs import is_model_file
    from truearm.wings.reports.arms import describe_arm

    if out is not None and is_model_file(arm):
        raise InputError(
            "the constants of a model mean little without its other terms",
            file=arm,
            hint=f"truearm export {arm} --out {out}: constants refitted to the whole model",
        )
    check_page_path(page, arm_path(arm))
    if out is not None:
        check_new_output(out, arm_path(arm), force=force)
    description = describe_arm(arm, convention=convention)
    if page is not None:
        description.save_page(page)
    if out is not None:
        write_arm(description.arm, out, convention=convention)
        print_line(f"{out}: {description.arm.name}, {description.arm.n_joints} joints")
    if out is None or page is not None:
        print_record(description, as_json=as_json, files={"page": page})


def _of_nominal_arm(arm: str, readings: Path | None, out: Path | None, page: Path | None) -> tuple[str, Path]:
    """The arm and the session of a diagnosis; what does not go with it is refused."""
    from truearm.verbs.inputs import is_model_file

    if readings is None or not arm or out is not None or page is not None or is_model_file(arm):
        name = arm if arm and not is_model_file(arm) else "my-arm.toml"
        raise InputError(
            "--session needs a nominal arm, without --out and --page; --lengths and --apply need --session",
            hint=f"truearm arms {name} --session {readings or 'session.csv'}",
        )
    return arm, readings


def _diagnose(
    arm: str, readings: Path, lengths: Path | None, free: Any, apply: Path | None, *, force: bool, as_json: bool
) -> None:
    """Say which mistake explains the readings; write the arm without it to a new file."""
    from truearm.arm import write_arm
    from truearm.arm.catalogue import arm_path
    from truearm.verbs.diagnose import diagnose

    if apply is not None:
        check_new_output(apply, readings, arm_path(arm), lengths, force=force, endings=(".toml",))
    found = diagnose(arm, readings, lengths=lengths, free=free)
    if apply is not None:
        write_arm(found.mended_arm(), apply)
    print_record(found, as_json=as_json, files={"arm": apply})


def _plan_circles(
    out: Path | None, n_joints: int, points: int, span: float, noise: float, *, force: bool, as_json: bool
) -> None:
    """The session to fill in: each joint in turn at its angles, the others at zero."""
    from truearm.wings.planning.arm_from_circles import plan_circles

    if out is None:
        raise InputError("--circles-plan needs --out", hint=f"truearm arms --circles-plan {n_joints} --out circles.csv")
    planned = plan_circles(n_joints, points=points, span_deg=span, noise_mm=noise).save(out, force=force)
    print_record(planned, as_json=as_json, files={"session": out})


def _measure(
    circles: Path, out: Path | None, convention: Convention, accept: str | None, *, force: bool, as_json: bool
) -> None:
    """The arm of a session of circles, printed and, with --out, written; exit code 1 if a joint is not measured."""
    from truearm.wings.planning.arm_from_circles import arm_from_circles

    if out is not None:
        check_new_output(out, circles, force=force, endings=(".toml", ".urdf"))
    name = "my-arm" if out is None else out.stem
    measured = arm_from_circles(circles, name=name, convention=convention, accept=accept)
    if out is not None:
        measured.save(out)
    print_record(measured, as_json=as_json, files={"arm": out})
    if measured.failed:
        raise typer.Exit(1)


@options.of_verb("truearm.wings.reports.compare:compare")
def compare(
    verb: Any,
    old: Annotated[Path, Argument(metavar="OLD", help="Model file of the arm before.")],
    new: Annotated[Path, Argument(metavar="NEW", help="Model file of the same arm, fitted again.")],
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Compare two models of one arm: which constants changed.

    After a year, a crash or a repair the arm was fitted again, to new readings. A constant changed if its values differ
    by more than the uncertainties of both models explain. The tip's displacement is that inside the arm: a base or a
    tip that was free in the fit is aligned first and reported apart.

    Nominal, kinematic and physical models of the same arm file can be compared.
    """
    with progress(f"comparing {old.name} and {new.name}"):
        change = verb(old, new, **given)
    print_record(change, as_json=as_json)


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
