"""The commands that say where to measure: plan and simulate."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer
from typer import Argument, Option

from truearm import wings
from truearm.errors import InputError
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_new_output
from truearm.wings.planning.designs import ArtefactKind, Strategy

if TYPE_CHECKING:
    from truearm.wings.planning.simulate import SimulationResult

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


WITHIN = {"poses": (0, 10_000_000), "anchors": (0, 100), "bars": (0, 1000)}
# Options that a plan states itself.
STATED_BY_A_PLAN = ("poses", "strategy", "seats", "bars", "bar_mm", "anchors", "half_width_deg", "no_reference")


@options.of_verb("truearm.wings.planning.simulate:simulate", omit=("reference",), within=WITHIN)
def simulate(
    verb: Any,
    context: typer.Context,
    arm: options.ArmArgument,
    out: Annotated[Path, Option(help="Session file to write, .csv or .parquet.")],
    plan: options.PlanFile = None,
    out_lengths: Annotated[Path | None, Option(help="File of the bar's length to write, .csv.")] = None,
    artefacts: options.ArtefactsFile = None,
    moved: Annotated[
        bool, Option("--moved", help="With --plan: the instrument stands elsewhere, to rehearse a refit.")
    ] = False,
    no_reference: Annotated[
        bool, Option("--no-reference", help="Without an instrument that measures the tip (x, y, z).")
    ] = False,
    instrument: Annotated[
        str | None, Option(help="In place of a tracker: camera (the board is on the flange), camera-in-hand.")
    ] = None,
    board: Annotated[str | None, Option(help="The board, as charuco:8x11,15mm,11mm; see truearm board.")] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Measure with a virtual arm, whose errors are known.

    The readings are written as a session file. Two sessions of one arm have the same --arm-seed and different --seed.

    --plan rehearses a plan of truearm plan: seats, bar and sphere stand where the plan puts them, and the session has
    all that a person would write down. The length of the bar is written beside it: out.csv, out-lengths.csv. With
    --artefacts it takes the points of a verification (truearm verify sheet): joint angles, one row for each point.

    --strategy seat --no-reference simulates a measurement without an instrument: the tip is held in seats, in as many
    poses in each. --bars 2 adds a bar with two seats at two places; the length that its certificate states, with a
    standard uncertainty of 0.005 mm, is written to the file of --out-lengths. --anchors 3 --no-reference simulates
    three draw-wire encoders.

    --instrument camera writes images of a board into a folder beside the joint angles: out.csv, out-images.
    """
    from truearm.arm.catalogue import arm_path

    if instrument is not None:
        draws = {name: given[name] for name in ("preset", "seed", "arm_seed")} | ({"board": board} if board else {})
        draws |= {"poses": given["poses"]} if "poses" in options.typed_options(context) else {}
        _take_images(context, arm, out, instrument, draws, force=force, as_json=as_json)
        return
    options.refuse_typed(context, ("board",), "applies to --instrument only")
    if plan is not None:
        options.refuse_typed(context, STATED_BY_A_PLAN, "does not apply to --plan: the plan states it")
        if artefacts is not None:
            options.refuse_typed(context, ("out_lengths", "moved"), "does not apply to the points of a verification")
        draws = {name: given[name] for name in ("preset", "seed", "arm_seed")} | {"moved": moved}
        result, files = _rehearse(arm, plan, out, lengths=out_lengths, artefacts=artefacts, force=force, **draws)
        print_record(result, as_json=as_json, files=files)
        return
    options.refuse_typed(context, ("moved", "artefacts"), "applies to --plan only")
    _check_outputs(out, out_lengths, given["bars"], arm_path(arm), force=force)
    with progress(f"measuring {given['poses']} poses"):
        result = verb(arm, reference=not no_reference, **given)
        result.save(out, lengths=out_lengths)
    print_record(result, as_json=as_json, files={"session": out, "lengths": out_lengths})


def _instrument(name: str) -> Any:
    """What measures with an instrument that a wing brings."""
    brought = wings.instruments()
    if name not in brought:
        raise InputError(f"expected an instrument out of {', '.join(brought) or 'none'}, got {name!r}")
    module, _, function = brought[name].partition(":")
    return getattr(import_module(module), function)


def _check_outputs(out: Path, lengths: Path | None, bars: int, arm_file: Path, *, force: bool) -> None:
    """Check, before long work, that the files can be written and belong to the options."""
    from truearm.files.atomic_write import is_same_file
    from truearm.readings import check_session_path

    check_session_path(out)
    if bool(bars) != (lengths is not None):
        raise InputError("--bars and --out-lengths belong together", hint="--bars 2 --out-lengths lengths.csv")
    if lengths is not None:
        if is_same_file(lengths, out):
            raise InputError("--out and --out-lengths are the same file", file=lengths)
        check_new_output(lengths, arm_file, force=force)
    check_new_output(out, arm_file, force=force)


def _rehearse(
    arm: str, plan: Path, out: Path, *, lengths: Path | None, artefacts: Path | None, force: bool, **given: Any
) -> tuple[SimulationResult, dict[str, Path | None]]:
    from truearm.arm.catalogue import arm_path
    from truearm.readings import check_session_path
    from truearm.wings.planning.designs.template import lengths_path
    from truearm.wings.planning.simulate import rehearse

    check_session_path(out)
    beside = lengths or lengths_path(out)
    for file in (out,) if artefacts is not None else (out, beside):
        check_new_output(file, arm_path(arm), plan, artefacts or lengths_path(plan), force=force)
    with progress(f"{'carrying out' if artefacts is None else 'taking the points of'} {plan.name}"):
        result = rehearse(arm, plan, artefacts=artefacts, **given)
        written = None if result.lengths is None else beside
        result.save(out, lengths=written)
    return result, {"session": out, "lengths": written}


def _take_images(
    context: typer.Context,
    arm: str,
    out: Path,
    instrument: str,
    draws: Mapping[str, Any],
    *,
    force: bool,
    as_json: bool,
) -> None:
    """Measure with a camera: images in place of the points of a tracker."""
    does_not_apply = ({*STATED_BY_A_PLAN} - {"poses"}) | {"plan", "out_lengths", "artefacts", "moved"}
    options.refuse_typed(context, does_not_apply, "does not apply to --instrument")
    with progress(f"taking images with a {instrument}") as step:
        record, files = _instrument(instrument)(arm, out, instrument=instrument, force=force, progress=step, **draws)
    print_record(record, as_json=as_json, files=files)
