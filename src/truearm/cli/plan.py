"""``truearm plan``: which poses to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from truearm.cli.console import ARM_HELP, Json, check_page_path, is_given, numbers_of, print_record, progress

# What the plan of an interim check takes; all else belongs to calibrations.
FOR_CHECKS = ("arm", "artefact", "out", "length", "sphere", "table", "avoid", "seed", "as_json")


def plan(
    context: typer.Context,
    arm: Annotated[str, typer.Argument(metavar="ARM|MODEL", help=f"{ARM_HELP} Or a model file.")],
    artefact: Annotated[
        Literal["seat", "bar", "tracker", "check"],
        typer.Option("--artefact", help="What the poses are measured with; check: the routine of an interim check."),
    ],
    out: Annotated[Path, typer.Option("--out", help="Session file to fill in, .csv; must be new.")],
    poses: Annotated[int, typer.Option("--poses", min=1, max=500, help="Number of readings.")] = 50,
    page: Annotated[Path | None, typer.Option("--page", help="Page with pictures to write, .html.")] = None,
    seats: Annotated[
        int | None,
        typer.Option("--seats", min=1, max=200, help="Number of seats, or of places of the bar (one for 10 poses)."),
    ] = None,
    length: Annotated[float | None, typer.Option("--length", help="Length of the bar, between its seats [mm].")] = None,
    sphere: Annotated[
        float | None, typer.Option("--sphere", help="With --artefact check: diameter of a sphere [mm].")
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option("--noise", help="Standard deviation of a coordinate [mm] (that of the model, or 0.02)."),
    ] = None,
    strategy: Annotated[
        Literal["i-optimal", "d-optimal", "technician", "random"],
        typer.Option("--strategy", help="How the poses are chosen."),
    ] = "i-optimal",
    terms: Annotated[
        Literal["physical", "constants"] | None,
        typer.Option("--terms", help="What is to be identified of an arm (physical). A model has its own terms."),
    ] = None,
    session: Annotated[
        Path | None,
        typer.Option("--session", help="Session measured already that is not the training session of the model."),
    ] = None,
    volume: Annotated[
        str | None,
        typer.Option(
            "--volume",
            help="Where the arm is to be used: NEAR,FAR,LOW,HIGH [mm] from its shoulder and HALF_ANGLE [deg].",
        ),
    ] = None,
    table: Annotated[
        str | None,
        typer.Option(
            "--table",
            help="Where seats and bars can stand: height Z of the table above the base (0), or Z,X0,X1,Y0,Y1 [mm].",
        ),
    ] = None,
    avoid: Annotated[
        list[str] | None,
        typer.Option(
            "--avoid",
            help="Box X0,X1,Y0,Y1,Z0,Z1 [mm] in which neither arm nor artefact is in any pose; between poses nothing "
            "is checked; repeatable.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")] = 0,
    as_json: Json = False,
) -> None:
    """Plan the poses that determine an arm best.

    The result is a session file with the joint angles to aim at in columns of notes. Fill in the readings of the
    encoders (and, with a tracker, the points) and give the file to truearm fit. For a bar, the file of its lengths is
    written beside it.

    i-optimal: smallest uncertainty of a point in the volume. d-optimal: smallest overall uncertainty of the parameters.
    technician: poses as a person chooses them who measures parts. random: random poses. All four are compared.

    With a model instead of an arm: the poses that come next.

    --artefact check: the routine of an interim check (truearm check), ten readings in a cone, with --length four in
    each seat of a bar, with --sphere nine on a sphere.
    """
    from truearm.arm.catalogue import arm_path
    from truearm.errors import InputError
    from truearm.files.atomic_write import check_new_form
    from truearm.identification.planning.proposal import STRATEGIES
    from truearm.workflows.plan import plan as planned
    from truearm.workflows.plan import template_files

    around: dict[str, Any] = {
        "table": None if table is None else numbers_of(table, "--table", "-40,200,900,-400,400"),
        "avoid": [numbers_of(box, "--avoid", "0,200,-300,300,0,900") for box in avoid or ()],
    }
    if artefact == "check":
        _check_is_of_a_check(context)
        _plan_check(arm, out, length_mm=length, sphere_mm=sphere, seed=seed, as_json=as_json, **around)
        return
    if sphere is not None:
        raise InputError("--sphere applies to --artefact check only", hint="omit it")
    for file in template_files(out, artefact):
        check_new_form(file, holds="readings")
    if page is not None:
        check_page_path(page, arm_path(arm), *([] if session is None else [session]))
    with progress("planning", total=len(STRATEGIES)) as tell:
        result = planned(
            arm,
            artefact,
            poses=poses,
            seats=seats,
            length_mm=length,
            noise_mm=noise,
            strategy=strategy,
            terms=terms,
            session=session,
            volume=None if volume is None else numbers_of(volume, "--volume", "300,800,-200,400,60"),
            **around,
            seed=seed,
            progress=tell,
        )
        if page is not None:
            tell(len(STRATEGIES), "drawing the page")
            result.save_page(page)
        files = dict(zip(("session", "lengths"), result.save(out), strict=False)) | (
            {} if page is None else {"page": page}
        )
    print_record(result, as_json=as_json, files=files)


def _check_is_of_a_check(context: typer.Context) -> None:
    """Refuse options that a routine of an interim check has not."""
    from truearm.errors import InputError

    for parameter in context.command.params:
        if is_given(context, parameter.name or "") and parameter.name not in FOR_CHECKS:
            raise InputError(f"{parameter.opts[0]} does not apply to --artefact check", hint="omit it")


def _plan_check(arm: str, out: Path, *, as_json: bool, **options: Any) -> None:
    from truearm.files.atomic_write import check_new_form
    from truearm.workflows.plan import plan_check

    check_new_form(out, holds="readings")
    result = plan_check(arm, **options)
    files = dict(zip(("session", "lengths"), result.save(out), strict=False))
    print_record(result, as_json=as_json, files=files)
