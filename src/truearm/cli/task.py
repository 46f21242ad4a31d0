"""``truearm task``: the uncertainty of a measured feature, and whether the arm is good enough for a tolerance."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal
from zipfile import is_zipfile

import typer

from truearm.cli.console import Json, check_page_path, print_json, print_line, print_table, progress, version_row

if TYPE_CHECKING:
    from truearm.arm import Arm
    from truearm.verification.tasks.features import Feature
    from truearm.verification.tasks.sampled_arms import ArmDistribution
    from truearm.verification.tasks.task import TaskAssessment, TaskResult


CODES = {"yes": 0, "no": 1, "only with guard bands": 3}
# The generic measuring arm, of a size with the presets.
ARM = "measuring7"


def millimetres(text: str) -> float:
    """A number of an option, in mm."""
    return _number(text, "a number in mm with a decimal point, as 0.2")


def width(text: str) -> float:
    """The width of a tolerance [mm]."""
    return _number(text, "its width in mm with a decimal point, 0.2 for +-0.1 mm")


def _number(text: str, expected: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"expected {expected}, got {text!r}") from None


def task(
    what: Annotated[
        str | None,
        typer.Argument(metavar="MODEL|PRESET", help="A model file, or the preset of a virtual arm: shop, research."),
    ] = None,
    feature: Annotated[
        Literal["length", "sphere", "plane", "circle"], typer.Option("--feature", help="What is measured.")
    ] = "length",
    length: Annotated[float | None, typer.Option("--length", parser=millimetres, help="Of a length [mm].")] = None,
    diameter: Annotated[
        float | None, typer.Option("--diameter", parser=millimetres, help="Of a ball or bore [mm].")
    ] = None,
    size: Annotated[
        float | None, typer.Option("--size", parser=millimetres, help="Of a square plate, its side [mm].")
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            "--at",
            help="Middle of the feature, X,Y,Z [mm] in the arm's base frame; by default the middle of the volume in which a "
            "person works. Given twice: the two seats of a length.",
        ),
    ] = None,
    along: Annotated[
        str | None,
        typer.Option("--along", help="Direction X,Y,Z of a length (across the front), normal of a plate or bore (up)."),
    ] = None,
    points: Annotated[
        int | None, typer.Option("--points", help="Number of points: 25; of a length 2, half at each end.")
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option("--tolerance", parser=width, help="Width of the tolerance zone [mm]: 0.1 for +-0.05 mm."),
    ] = None,
    spec: Annotated[
        Path | None, typer.Option("--spec", help="Specification of the arm (limits, .toml) instead of a model.")
    ] = None,
    arm: Annotated[
        str | None,
        typer.Option("--arm", help=f"Nominal arm of a preset or a specification: a name or a file ({ARM})."),
    ] = None,
    repeatability: Annotated[
        float | None,
        typer.Option(
            "--repeatability",
            parser=millimetres,
            help="With a model: standard deviation of a coordinate when the same point is measured again in the same "
            "pose [mm]. Without it no error counts as random, and means of many points get too large an uncertainty.",
        ),
    ] = None,
    arms: Annotated[int, typer.Option("--arms", help="Number of arms to draw.")] = 1000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")] = 0,
    report: Annotated[Path | None, typer.Option("--report", help="Page to write, .html.")] = None,
    as_json: Json = False,
) -> None:
    """Estimate how well an arm measures a length or a shape.

    With --tolerance, also decide whether the arm is fit for it. truearm draws many arms that may be the one in question;
    each measures the feature, with systematic errors drawn once per arm and random errors drawn per point. With a model:
    arms from its posterior. With a preset: virtual arms. With --spec: arms whose worst test result is half to all of its
    limit.

    Exit code with --tolerance, 0: fit; 1: not fit; 3: only with guard bands. Without, 0.
    """
    from truearm.errors import InputError

    if report is not None:
        check_page_path(report, *[Path(path) for path in (what, spec, arm) if path is not None])
    if tolerance is not None and not (isfinite(tolerance) and tolerance > 0):
        raise InputError(f"--tolerance expects a width above zero in mm, got {tolerance}", hint="0.1 for +-0.05 mm")
    with progress(f"measuring a {feature}", total=arms) as tell:
        from truearm.verification.tasks.task import assess_task

        errors, source = _errors(what, spec, arm, repeatability)
        measured = _feature(
            feature,
            errors.arm,
            sizes={"length": length, "diameter": diameter, "size": size},
            at=at,
            along=along,
            points=points,
        )
        found = assess_task(errors, measured, tolerance_mm=tolerance, n_arms=arms, seed=seed, progress=tell)
        if report is not None:
            from truearm.pages.html import write_page
            from truearm.verification.tasks.task_page import task_page

            write_page(task_page(found, source=source, facts=_facts(errors, source, found.result, seed)), report)
    if as_json:
        print_json({"source": source, **found.to_dict()})
    else:
        _tell(found, source)
        if report is not None:
            print_line(f"{report}: the result with a figure of its distribution")
    if found.fitness is not None:
        raise typer.Exit(CODES[found.fitness.answer.value])


def _errors(
    what: str | None, spec: Path | None, arm: str | None, repeatability: float | None
) -> tuple[ArmDistribution, str]:
    """The distribution of the errors of the arm, and its source in a few words."""
    from truearm.arm import load_arm
    from truearm.compensation.models.model_file import load_model
    from truearm.errors import InputError
    from truearm.identification.virtual.presets import PRESETS, load_preset
    from truearm.verification.tasks.sampled_arms import PosteriorDistribution, PresetDistribution

    if (what is None) == (spec is None):
        raise InputError(
            "expected one of a model, a preset and --spec", hint=f"a model file, {', '.join(PRESETS)}, or --spec"
        )
    if what is not None and Path(what).is_file() and is_zipfile(what):
        if arm is not None:
            raise InputError("--arm is for a preset or --spec; a model has its own arm", file=what)
        try:
            return PosteriorDistribution(load_model(what), repeatability), f"the model {Path(what).name}"
        except InputError as error:
            raise error.in_file(what) from None
    if repeatability is not None:
        raise InputError("--repeatability is for a model; a preset or a specification has its own random errors")
    if spec is not None:
        from truearm.verification.standards.specification import read_specification
        from truearm.verification.tasks.specification_sheet import SpecificationDistribution

        promised, nominal = read_specification(spec), load_arm(ARM if arm is None else arm)
        try:
            return SpecificationDistribution(
                nominal, promised
            ), f"the specification of {promised.name}, arm {nominal.name}"
        except InputError as error:
            raise error.in_file(spec) from None
    assert what is not None
    if what not in PRESETS:
        raise InputError(
            f"expected a model file or a preset ({', '.join(PRESETS)}), got {what!r}",
            hint="truearm fit writes a model file" if not Path(what).exists() else "use a file that truearm fit wrote",
        )
    nominal = load_arm(ARM if arm is None else arm)
    return PresetDistribution(nominal, load_preset(what)), f"the preset {what}, arm {nominal.name}"


def _feature(
    kind: Literal["length", "sphere", "plane", "circle"],
    arm: Arm,
    *,
    sizes: dict[str, float | None],
    at: list[str] | None,
    along: str | None,
    points: int | None,
) -> Feature:
    from truearm.errors import InputError
    from truearm.verification.tasks import features
    from truearm.verification.tasks.feature_postures import middle_of

    places = [numbers("--at", text) for text in at or []]
    seats = kind == "length" and len(places) == 2
    wanted = {"length": "length", "sphere": "diameter", "plane": "size", "circle": "diameter"}[kind]
    for name, value in sizes.items():
        if value is not None and (name != wanted or seats):
            raise InputError(f"--{name} is not for {'a length between two seats' if seats else f'a {kind}'}")
    if len(places) > 1 + (kind == "length"):
        raise InputError(f"expected --at once, for a length once or twice, got it {len(places)} times")
    if along is not None and (seats or kind == "sphere"):
        raise InputError(f"--along is not for {'a length between two seats' if seats else 'a ball'}")
    n = (2 if kind == "length" else 25) if points is None else points
    if seats:
        return features.length(places, points=n)
    value = sizes[wanted]
    if value is None:
        raise InputError(f"expected --{wanted} of the {kind} in mm", hint=f"--{wanted} 100")
    middle, across = middle_of(arm)
    place = places[0] if places else middle
    direction = None if along is None else numbers("--along", along)
    if kind == "length":
        return features.length_at(place, across if direction is None else direction, value, points=n)
    if kind == "sphere":
        return features.sphere(place, value, points=n)
    make = features.plane if kind == "plane" else features.circle
    return make(place, features.UP if direction is None else direction, value, points=n)


def numbers(option: str, text: str) -> list[float]:
    """Three numbers of an option."""
    from truearm.errors import InputError

    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) != 3 or not all(map(isfinite, found)):
        raise InputError(f"{option} expects three numbers X,Y,Z, got {text!r}", hint=f"{option} 600,0,300")
    return found


def _facts(errors: ArmDistribution, source: str, found: TaskResult, seed: int) -> list[tuple[str, str]]:
    arm = errors.arm
    return [
        ("source of the errors", source),
        ("arm", f"{arm.name}: {arm.title}. {arm.source}"),
        ("arms drawn", f"{found.n_arms}, seed {seed}"),
        ("sets of postures", str(len(found.angles))),
        version_row(),
    ]


def _tell(found: TaskAssessment, source: str) -> None:
    from truearm.verification.tasks.fitness import describe_fitness

    result = found.result
    first = result.estimates[0]
    if found.fitness is not None:
        print_line(describe_fitness(first, found.fitness))
    print_line(f"{result.feature.name}, by {source}: errors of {result.n_arms} drawn arms")
    rows = []
    for one in result.estimates:
        low, high = one.interval_mm
        rows.append(
            [
                one.quantity.name,
                _signed(one.bias_mm),
                f"{one.u_mm:.4f}",
                f"{_signed(low)} to {_signed(high)}",
                f"{one.u_systematic_mm:.4f}",
                f"{one.u_random_mm:.4f}",
            ]
        )
    print_table(["quantity", "bias [mm]", "u [mm]", "95 % of errors [mm]", "u systematic", "u random"], rows)
    of_draws = first.standard_errors
    print_line(
        f"standard errors due to the number of draws ({first.quantity.name}): bias {of_draws.bias_mm:.4f}, u "
        f"{of_draws.u_mm:.4f}, ends of the interval {of_draws.low_mm:.4f} and {of_draws.high_mm:.4f} mm"
    )
    print_line(found.advice)
    for remark in found.remarks:
        print_line(remark)


def _signed(value: float) -> str:
    """A number with sign and four decimals; zero as 0."""
    return f"{value:+.4f}" if round(value, 4) else "0"
