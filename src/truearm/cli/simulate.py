"""``truearm simulate``: readings of a virtual arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truearm.cli.console import ARM_HELP, Json, print_record, progress


def simulate(
    arm: Annotated[str, typer.Argument(metavar="ARM", help=ARM_HELP)],
    out: Annotated[Path, typer.Option("--out", help="Session file to write (.csv or .parquet).")],
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
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the poses and the noise.")] = 0,
    arm_seed: Annotated[
        int, typer.Option("--arm-seed", min=0, help="Of the arm's own errors: same seed, same arm.")
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
        Path | None, typer.Option("--lengths", help="File to write the bar's length to, .csv, for truearm fit.")
    ] = None,
    half_width_deg: Annotated[
        float | None,
        typer.Option(
            "--half-width-deg", help="Of the box about the working pose (20); strategies box and sobol-box only."
        ),
    ] = None,
    reference: Annotated[
        bool,
        typer.Option("--reference/--no-reference", help="Whether a reference instrument measures the tip (x, y, z)."),
    ] = True,
    as_json: Json = False,
) -> None:
    """Measure with a virtual arm, whose errors are known.

    The readings are written as a session file. Two sessions of one arm have the same --arm-seed and different --seed.

    --strategy seat --no-reference simulates a measurement without an instrument: the tip is held in seats, in as many
    poses in each. --bars 2 adds a bar with two seats at two places; the length that its certificate states, with a
    standard uncertainty of 0.005 mm, is written to the file of --lengths. --anchors 3 --no-reference simulates three
    draw-wire encoders.
    """
    from truearm.errors import InputError
    from truearm.files.atomic_write import check_writable, is_same_file
    from truearm.readings import check_session_path
    from truearm.workflows.simulate import simulate as simulate_readings

    check_session_path(out)
    if bool(bars) != (lengths is not None):
        raise InputError("--bars and --lengths belong together", hint="--bars 2 --lengths lengths.csv")
    if lengths is not None:
        if is_same_file(lengths, out):
            raise InputError("--out and --lengths are the same file", file=lengths)
        check_writable(lengths)
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
