"""``truearm simulate``: readings of a virtual arm."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from truearm.cli.console import ARM_HELP, Force, Json, check_new_file, check_output, is_given, print_record, progress

# Options that a plan states itself.
STATED_BY_A_PLAN = ("poses", "strategy", "seats", "bars", "bar_mm", "anchors", "half_width_deg", "reference")


def simulate(
    context: typer.Context,
    arm: Annotated[str, typer.Argument(metavar="ARM", help=ARM_HELP)],
    out: Annotated[Path, typer.Option("--out", help="Session file to write (.csv or .parquet).")],
    plan: Annotated[
        Path | None,
        typer.Option(
            "--plan", help="Carry out this plan of truearm plan, or take these points of truearm verify --sheet, .csv."
        ),
    ] = None,
    poses: Annotated[
        int,
        typer.Option(
            "--poses", max=10_000_000, help="Number of poses; a reading each, with --anchors one for each anchor."
        ),
    ] = 200,
    strategy: Annotated[
        str,
        typer.Option("--strategy", help="Where to put the joints: box, sobol-box, uniform, sobol, measuring or seat."),
    ] = "box",
    preset: Annotated[
        str, typer.Option("--preset", help="Errors of the arm: research, shop, worn or perfect.")
    ] = "research",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the poses and the noise.")] = 0,
    arm_seed: Annotated[
        int, typer.Option("--arm-seed", min=0, help="Seed of the arm's own errors: same seed, same arm.")
    ] = 0,
    seats: Annotated[int | None, typer.Option("--seats", help="Number of seats (3); strategy seat only.")] = None,
    bars: Annotated[
        int, typer.Option("--bars", min=0, help="Places of a bar with a seat at each end; strategy seat only.")
    ] = 0,
    bar_mm: Annotated[float, typer.Option("--bar-mm", help="Length of the bar from seat to seat.")] = 500.0,
    anchors: Annotated[
        int,
        typer.Option(
            "--anchors",
            min=0,
            max=100,
            help="Fixed points around the arm: rows are poses times anchors, each with a distance.",
        ),
    ] = 0,
    lengths: Annotated[
        Path | None,
        typer.Option(
            "--lengths", help="File to write the bar's length to, .csv, for truearm fit; with --plan beside --out."
        ),
    ] = None,
    half_width_deg: Annotated[
        float | None,
        typer.Option(
            "--half-width-deg",
            help="Half width of the box about the working pose (20); strategies box and sobol-box only.",
        ),
    ] = None,
    reference: Annotated[
        bool,
        typer.Option("--reference/--no-reference", help="Whether a reference instrument measures the tip (x, y, z)."),
    ] = True,
    artefacts: Annotated[
        Path | None,
        typer.Option("--artefacts", help="With --plan and the points of a verification: their artefacts, .toml."),
    ] = None,
    moved: Annotated[
        bool,
        typer.Option("--moved", help="With --plan: the reference instrument stands elsewhere, to rehearse a refit."),
    ] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measure with a virtual arm, whose errors are known.

    The readings are written as a session file. Two sessions of one arm have the same --arm-seed and different --seed.

    --plan rehearses a plan of truearm plan: seats, bar and sphere stand where the plan puts them, and the session has
    all that a person would write down. The length of the bar is written beside it: out.csv, out-lengths.csv. With
    --artefacts it takes the points of a verification (truearm verify --sheet): joint angles, one row for each point.

    --strategy seat --no-reference simulates a measurement without an instrument: the tip is held in seats, in as many
    poses in each. --bars 2 adds a bar with two seats at two places; the length that its certificate states, with a
    standard uncertainty of 0.005 mm, is written to the file of --lengths. --anchors 3 --no-reference simulates three
    draw-wire encoders.
    """
    from truearm.workflows.simulate import simulate as simulate_readings

    if plan is not None:
        _check_leaves_to_plan(context)
        draws = {"preset": preset, "seed": seed, "arm_seed": arm_seed}
        _rehearse(
            arm, plan, out, lengths=lengths, moved=moved, artefacts=artefacts, force=force, as_json=as_json, **draws
        )
        return
    _check_outputs(out, lengths, bars, force=force, for_plans={"--moved": moved, "--artefacts": artefacts})
    with progress(f"measuring {poses} poses"):
        result = simulate_readings(
            arm,
            poses=poses,
            strategy=strategy,
            preset=preset,
            seed=seed,
            arm_seed=arm_seed,
            reference=reference,
            half_width_deg=half_width_deg,
            seats=seats,
            bars=bars,
            bar_mm=bar_mm,
            anchors=anchors,
        )
        result.save(out, lengths=lengths)
    print_record(result, as_json=as_json, files={"session": out} | ({} if lengths is None else {"lengths": lengths}))


def _check_outputs(out: Path, lengths: Path | None, bars: int, *, force: bool, for_plans: Mapping[str, object]) -> None:
    """Check, before long work, that the files can be written and belong to the options."""
    from truearm.errors import InputError
    from truearm.files.atomic_write import check_writable, is_same_file
    from truearm.readings import check_session_path

    check_session_path(out)
    for option, value in for_plans.items():
        if value:
            raise InputError(f"{option} applies to --plan only", hint="omit it")
    if bool(bars) != (lengths is not None):
        raise InputError("--bars and --lengths belong together", hint="--bars 2 --lengths lengths.csv")
    if lengths is not None:
        if is_same_file(lengths, out):
            raise InputError("--out and --lengths are the same file", file=lengths)
        check_writable(lengths)
    for file in (out, *([] if lengths is None else [lengths])):
        check_new_file(file, force=force)


def _check_leaves_to_plan(context: typer.Context) -> None:
    """Refuse options for what the plan states."""
    from truearm.errors import InputError

    for parameter in context.command.params:
        if parameter.name in STATED_BY_A_PLAN and is_given(context, parameter.name):
            raise InputError(f"{parameter.opts[0]} does not apply to --plan: the plan states it", hint="omit it")


def _rehearse(
    arm: str,
    plan: Path,
    out: Path,
    *,
    lengths: Path | None,
    artefacts: Path | None,
    force: bool,
    as_json: bool,
    **options: Any,
) -> None:
    from truearm.errors import InputError
    from truearm.identification.planning.template import lengths_path
    from truearm.readings import check_session_path
    from truearm.workflows.rehearse import rehearse

    if artefacts is not None and (lengths is not None or options["moved"]):
        option = "--lengths" if lengths is not None else "--moved"
        raise InputError(f"{option} does not apply to the points of a verification", hint="omit it")
    check_session_path(out)
    beside = lengths or lengths_path(out)
    for file in (out,) if artefacts is not None else (out, beside):
        check_output(file, plan, artefacts or lengths_path(plan))
        check_new_file(file, force=force)
    with progress(f"{'carrying out' if artefacts is None else 'taking the points of'} {plan.name}"):
        result = rehearse(arm, plan, artefacts=artefacts, **options)
        written = None if result.lengths is None else beside
        result.save(out, lengths=written)
    print_record(result, as_json=as_json, files={"session": out, "lengths": written})
