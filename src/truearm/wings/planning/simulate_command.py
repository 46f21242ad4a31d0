"""``truearm simulate``: readings of a virtual arm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.verbs.console import print_record, progress
from truearm.verbs.options import ARM_HELP, Force, Json, refuse_typed
from truearm.verbs.outputs import check_new_output

if TYPE_CHECKING:
    from truearm.wings.planning.simulate import SimulationResult

# Options that a plan states itself.
STATED_BY_A_PLAN = ("poses", "strategy", "seats", "bars", "bar_mm", "anchors", "half_width_deg", "reference")


def simulate(
    context: typer.Context,
    arm: Annotated[str, Argument(metavar="ARM", help=ARM_HELP)],
    out: Annotated[Path, Option(help="Session file to write (.csv or .parquet).")],
    plan: Annotated[
        Path | None,
        Option(help="Carry out this plan of truearm plan, or take these points of truearm verify sheet, .csv."),
    ] = None,
    poses: Annotated[
        int, Option(max=10_000_000, help="Number of poses; a reading each, with --anchors one for each anchor.")
    ] = 200,
    strategy: Annotated[
        str, Option(help="Where to put the joints: box, sobol-box, uniform, sobol, measuring or seat.")
    ] = "box",
    preset: Annotated[str, Option(help="Errors of the arm: research, shop, worn, printed or perfect.")] = "research",
    seed: Annotated[int, Option(min=0, help="Seed of the poses and the noise.")] = 0,
    arm_seed: Annotated[int, Option(min=0, help="Seed of the arm's own errors: same seed, same arm.")] = 0,
    seats: Annotated[int | None, Option(help="Number of seats (3); strategy seat only.")] = None,
    bars: Annotated[int, Option(min=0, help="Places of a bar with a seat at each end; strategy seat only.")] = 0,
    bar_mm: Annotated[float, Option(help="Length of the bar from seat to seat.")] = 500.0,
    anchors: Annotated[
        int,
        Option(min=0, max=100, help="Fixed points around the arm: rows are poses times anchors, each with a distance."),
    ] = 0,
    lengths: Annotated[
        Path | None, Option(help="File to write the bar's length to, .csv, for truearm fit; with --plan beside --out.")
    ] = None,
    half_width_deg: Annotated[
        float | None,
        Option(help="Half width of the box about the working pose (20); strategies box and sobol-box only."),
    ] = None,
    reference: Annotated[
        bool, Option("--reference/--no-reference", help="Whether a reference instrument measures the tip (x, y, z).")
    ] = True,
    artefacts: Annotated[
        Path | None, Option(help="With --plan and the points of a verification: their artefacts, .toml.")
    ] = None,
    moved: Annotated[
        bool, Option("--moved", help="With --plan: the reference instrument stands elsewhere, to rehearse a refit.")
    ] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measure with a virtual arm, whose errors are known.

    The readings are written as a session file. Two sessions of one arm have the same --arm-seed and different --seed.

    --plan rehearses a plan of truearm plan: seats, bar and sphere stand where the plan puts them, and the session has
    all that a person would write down. The length of the bar is written beside it: out.csv, out-lengths.csv. With
    --artefacts it takes the points of a verification (truearm verify sheet): joint angles, one row for each point.

    --strategy seat --no-reference simulates a measurement without an instrument: the tip is held in seats, in as many
    poses in each. --bars 2 adds a bar with two seats at two places; the length that its certificate states, with a
    standard uncertainty of 0.005 mm, is written to the file of --lengths. --anchors 3 --no-reference simulates three
    draw-wire encoders.
    """
    from truearm.arm.catalogue import arm_path
    from truearm.wings.planning.simulate import simulate as simulate_readings

    if plan is not None:
        refuse_typed(context, STATED_BY_A_PLAN, "does not apply to --plan: the plan states it")
        if artefacts is not None:
            refuse_typed(context, ("lengths", "moved"), "does not apply to the points of a verification")
        draws = {"preset": preset, "seed": seed, "arm_seed": arm_seed, "moved": moved}
        result, files = _rehearse(arm, plan, out, lengths=lengths, artefacts=artefacts, force=force, **draws)
        print_record(result, as_json=as_json, files=files)
        return
    refuse_typed(context, ("moved", "artefacts"), "applies to --plan only")
    _check_outputs(out, lengths, bars, arm_path(arm), force=force)
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
    print_record(result, as_json=as_json, files={"session": out, "lengths": lengths})


def _check_outputs(out: Path, lengths: Path | None, bars: int, arm_file: Path, *, force: bool) -> None:
    """Check, before long work, that the files can be written and belong to the options."""
    from truearm.files.atomic_write import is_same_file
    from truearm.readings import check_session_path

    check_session_path(out)
    if bool(bars) != (lengths is not None):
        raise InputError("--bars and --lengths belong together", hint="--bars 2 --lengths lengths.csv")
    if lengths is not None:
        if is_same_file(lengths, out):
            raise InputError("--out and --lengths are the same file", file=lengths)
        check_new_output(lengths, arm_file, force=force)
    check_new_output(out, arm_file, force=force)


def _rehearse(
    arm: str, plan: Path, out: Path, *, lengths: Path | None, artefacts: Path | None, force: bool, **options: Any
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
        result = rehearse(arm, plan, artefacts=artefacts, **options)
        written = None if result.lengths is None else beside
        result.save(out, lengths=written)
    return result, {"session": out, "lengths": written}
