"""``truearm plan``: which poses to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer
from typer import Argument, Option

from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_new_output
from truearm.wings.planning.designs import ArtefactKind, Strategy

# Options of a calibration that the plan of an interim check does not take.
NOT_FOR_CHECKS = ("poses", "page", "seats", "noise_mm", "strategy", "terms", "session", "volume", "accept")


@options.of_verb(
    "truearm.wings.planning.plan:plan", called={"length_mm": "--bar"}, within={"poses": (1, 500), "seats": (1, 200)}
)
def plan(
    verb: Any,
    context: typer.Context,
    arm: Annotated[str, Argument(metavar="ARM|MODEL", help=f"{options.ARM_HELP} Or a model file.")],
    artefact: Annotated[
        Literal[ArtefactKind, "check"],
        Option(help="What the poses are measured with; check: the routine of an interim check."),
    ],
    out: Annotated[Path, Option(help="Session file to fill in, .csv.")],
    page: options.Page = None,
    sphere: Annotated[float | None, Option(help="With --artefact check: diameter of a sphere [mm].")] = None,
    volume: Annotated[
        str | None,
        Option(help="Where the arm is to be used: NEAR,FAR,LOW,HIGH [mm] from its shoulder and HALF_ANGLE [deg]."),
    ] = None,
    table: Annotated[
        str | None,
        Option(
            "--table-top", help="Where seats and bars can stand: height Z above the base (0), or Z,X0,X1,Y0,Y1 [mm]."
        ),
    ] = None,
    avoid: Annotated[
        list[str] | None,
        Option(
            help="Box X0,X1,Y0,Y1,Z0,Z1 [mm] in which neither arm nor artefact is in any pose; between poses nothing "
            "is checked; repeatable."
        ),
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Plan the poses that determine an arm best.

    The result is a session file with the joint angles to aim at in columns of notes. Fill in the readings of the
    encoders (and, with a tracker, the points) and give the file to truearm fit. For a bar, the file of its lengths is
    written beside it.

    i-optimal: smallest uncertainty of a point in the volume. d-optimal: smallest overall uncertainty of the parameters.
    technician: poses as a person chooses them who measures parts. random: random poses. All four are compared.

    With a model instead of an arm: the poses that come next; --session: what was measured already and is not the
    training session of the model.

    --artefact check: the routine of an interim check (truearm check), ten readings in a cone, with --bar four in
    each seat of a bar, with --sphere nine on a sphere.
    """
    from truearm.arm.catalogue import arm_path
    from truearm.wings.planning.plan import template_files

    around: dict[str, Any] = {
        "table": None if table is None else options.numbers_of(table, "--table-top", "-40,200,900,-400,400"),
        "avoid": [options.numbers_of(box, "--avoid", "0,200,-300,300,0,900") for box in avoid or ()],
        "seed": given.pop("seed"),
    }
    if artefact == "check":
        options.refuse_typed(context, NOT_FOR_CHECKS, "does not apply to --artefact check")
        _plan_check(arm, out, length_mm=given["length_mm"], sphere_mm=sphere, force=force, as_json=as_json, **around)
        return
    options.refuse_typed(context, ["sphere"], "applies to --artefact check only")
    for file in template_files(out, artefact):
        check_new_output(file, arm_path(arm), given["session"], force=force, endings=(".csv",))
    check_page_path(page, arm_path(arm), given["session"])
    n_strategies = len(get_args(Strategy))
    with progress("planning", total=n_strategies) as tell:
        within = None if volume is None else options.numbers_of(volume, "--volume", "300,800,-200,400,60")
        result = verb(arm, artefact, **given, **around, volume=within, progress=tell)
        if page is not None:
            tell(n_strategies, "drawing the page")
            result.save_page(page)
        files = dict(zip(("session", "lengths"), result.save(out, force=force), strict=False))
    print_record(result, as_json=as_json, files={**files, "page": page})


def _plan_check(arm: str, out: Path, *, force: bool, as_json: bool, **given: Any) -> None:
    from truearm.arm.catalogue import arm_path
    from truearm.wings.planning.plan import plan_check

    check_new_output(out, arm_path(arm), force=force, endings=(".csv",))
    result = plan_check(arm, **given)
    files = dict(zip(("session", "lengths"), result.save(out, force=force), strict=False))
    print_record(result, as_json=as_json, files=files)
