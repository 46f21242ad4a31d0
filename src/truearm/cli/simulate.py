"""``truearm simulate``: readings of a virtual arm."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truearm.cli.console import Json, print_json, print_line, progress

if TYPE_CHECKING:
    from truearm.arm.arm import Arm
    from truearm.identification.planning.sampling import Poses
    from truearm.identification.virtual import Measurement, VirtualArm
    from truearm.readings import Lengths


# Standard uncertainty that a certificate states of a bar's length [mm].
BAR_U_MM = 0.005


def simulate(
    arm: Annotated[
        str, typer.Argument(metavar="ARM", help="A name from `truearm arms`, or an arm (.toml) or URDF file.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Session file to write (.csv or .parquet).")],
    poses: Annotated[int, typer.Option("--poses", max=10_000_000, help="Number of readings.")] = 200,
    strategy: Annotated[
        str,
        typer.Option("--strategy", help="Where to put the joints: box, sobol-box, uniform, sobol, measuring or seat."),
    ] = "box",
    preset: Annotated[
        str, typer.Option("--preset", help="How wrong the arm is: research, shop or perfect.")
    ] = "research",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the poses and the noise.")] = 0,
    arm_seed: Annotated[
        int, typer.Option("--arm-seed", min=0, help="Of the arm's own errors: same seed, same arm.")
    ] = 0,
    seats: Annotated[int | None, typer.Option("--seats", help="Number of seats (3); strategy seat only.")] = None,
    bars: Annotated[
        int, typer.Option("--bars", min=0, help="Places of a bar with a seat at each end, besides; strategy seat only.")
    ] = 0,
    bar_mm: Annotated[float, typer.Option("--bar-mm", help="Length of the bar from seat to seat.")] = 500.0,
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
        bool, typer.Option("--reference/--no-reference", help="Whether a reference instrument saw the tip (x, y, z).")
    ] = True,
    as_json: Json = False,
) -> None:
    """Measure with a virtual arm, whose errors are known.

    The readings are written as a session file. Two sessions of one arm have the same --arm-seed and different --seed.

    --strategy seat --no-reference is what is done without an instrument: the tip is held in seats in many poses, shared
    out evenly among them. --bars 2 lays a bar with two seats in two places more; what its certificate states of its
    length, true but for its uncertainty of 0.005 mm, goes to the file of --lengths.
    """
    from truearm.arm.catalogue import load_arm
    from truearm.errors import InputError
    from truearm.files.atomic_write import atomic_file, check_writable
    from truearm.identification.virtual import VirtualArm, load_preset
    from truearm.readings import write_lengths
    from truearm.readings.files import check_session_path, write_session

    nominal, magnitudes = load_arm(arm), load_preset(preset)
    check_session_path(out)
    if bool(bars) != (lengths is not None):
        raise InputError("--bars and --lengths belong together", hint="--bars 2 --lengths lengths.csv")
    if lengths is not None:
        if lengths.resolve() == out.resolve():
            raise InputError("--out and --lengths are the same file", file=lengths)
        check_writable(lengths)
    with progress(f"measuring {poses} poses"):
        if bars:
            taken = _with_bars(nominal, strategy, poses, seed=seed, seats=seats, bars=bars, bar_mm=bar_mm)
        else:
            taken = _poses(nominal, strategy, poses, seed=seed, seats=seats, half_width_deg=half_width_deg)
        virtual = VirtualArm.draw(nominal, magnitudes, seed=arm_seed)
        measured = virtual.measure(
            taken.angles, seed=seed, seat=taken.seat, seat_points=taken.seat_points, reference=reference
        )
        certificate = _certificate(bars, bar_mm, seed=arm_seed) if bars else None
        if lengths is None or certificate is None:
            write_session(measured.readings, out)
        else:
            # Both or none, as they belong together.
            with atomic_file(out) as session:
                write_session(measured.readings, session)
                write_lengths(certificate, lengths)
        result = _result(virtual, measured, taken, out=out, strategy=strategy, seed=seed)
    if as_json:
        print_json(result)
    else:
        _tell(result, taken)
        if certificate is not None:
            stated = f"{certificate.length_mm[0]:.4f} mm, u = {BAR_U_MM} mm"
            print_line(f"{lengths}: length of the bar by its certificate, {stated}, at {bars} place{'s' * (bars > 1)}")


def _poses(nominal: Arm, strategy: str, n: int, *, seed: int, seats: int | None, half_width_deg: float | None) -> Poses:
    from difflib import get_close_matches
    from math import radians

    from truearm.errors import InputError
    from truearm.identification.planning.sampling import STRATEGIES

    if strategy not in STRATEGIES:
        close = get_close_matches(strategy, STRATEGIES, n=1)
        raise InputError(
            f"expected a strategy out of {', '.join(STRATEGIES)}, got {strategy!r}",
            hint=f"--strategy {close[0]}" if close else None,
        )
    options: dict[str, Any] = {}
    if half_width_deg is not None:
        if not strategy.endswith("box"):
            raise InputError(f"--half-width-deg is for the strategies box and sobol-box, not for {strategy}")
        options["half_width"] = radians(half_width_deg)
    if seats is not None:
        if strategy != "seat":
            raise InputError(f"--seats is for the strategy seat, not for {strategy}", hint="--strategy seat")
        options["seats"] = seats
    return STRATEGIES[strategy](nominal, n, seed=seed, **options)


def _with_bars(nominal: Arm, strategy: str, n: int, *, seed: int, seats: int | None, bars: int, bar_mm: float) -> Poses:
    """Poses in seats and in both seats of a bar at its places, as many in each seat."""
    import numpy as np

    from truearm.errors import InputError
    from truearm.identification.planning.candidates import bar_places
    from truearm.identification.planning.sampling import Poses, seat

    if strategy != "seat":
        raise InputError(f"--bars is for the strategy seat, not for {strategy}", hint="--strategy seat")
    single = 3 if seats is None else seats
    each = n // (single + 2 * bars)
    if single < 1 or each < 1:
        raise InputError(f"expected at least one pose a seat, got {n} poses for {single} seats and {bars} bars")
    found = bar_places(nominal, bars, length_mm=bar_mm, poses=each, seed=seed)
    assert found.seat is not None
    assert found.seat_points is not None
    alone = seat(nominal, n - len(found.angles), seed=seed, seats=single)
    assert alone.seat is not None
    assert alone.seat_points is not None
    rejected = Counter(alone.rejected) + Counter(found.rejected)
    return Poses(
        np.concatenate([alone.angles, found.angles]),
        dict(rejected),
        np.concatenate([alone.seat, found.seat]),
        np.concatenate([alone.seat_points, found.seat_points]),
    )


def _certificate(bars: int, bar_mm: float, *, seed: int) -> Lengths:
    """What is stated of the bar's length, the same at all its places; it does not grow."""
    import numpy as np

    from truearm.readings import Lengths

    stated = round(bar_mm + BAR_U_MM * np.random.default_rng([seed, *b"bar"]).standard_normal(), 4)
    ends = [np.array([f"B{place}{end}" for place in range(1, bars + 1)]) for end in "ab"]
    return Lengths(
        ends[0],
        ends[1],
        np.full(bars, stated),
        np.full(bars, BAR_U_MM),
        artefact=np.full(bars, f"bar {bar_mm:g}"),
        expansion_per_K=np.zeros(bars),
        u_expansion_per_K=np.zeros(bars),
    )


def _result(
    virtual: VirtualArm, measured: Measurement, taken: Poses, *, out: Path, strategy: str, seed: int
) -> dict[str, Any]:
    return {
        "session": str(out),
        "arm": virtual.nominal.name,
        "preset": virtual.preset.name,
        "arm_seed": virtual.seed,
        "strategy": strategy,
        "seed": seed,
        "n": len(measured),
        "rejected": dict(taken.rejected),
        "nominal": virtual.nominal_error(measured),
        "noise_floor": None if measured.readings.points is None else virtual.noise_floor(measured),
    }


def _tell(result: dict[str, Any], taken: Poses) -> None:
    from truearm.identification.planning.sampling.measuring import describe_rejections

    print_line(
        f"{result['session']}: {result['n']} readings of virtual arm {result['arm']}, "
        f"preset {result['preset']}, arm seed {result['arm_seed']}"
    )
    if taken.rejected:
        print_line(f"rejected: {describe_rejections(taken.rejected)}")
    for label, key in (("nominal error", "nominal"), ("noise floor", "noise_floor")):
        if result[key] is not None:
            mean, largest = result[key]["mean_abs_coordinate_mm"], result[key]["max_abs_coordinate_mm"]
            print_line(f"{label} of a coordinate: {mean:.4f} mm on average, {largest:.4f} mm at most")
