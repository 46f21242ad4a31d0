"""``truearm task``: the uncertainty of a measured feature, and whether the arm is good enough for a tolerance."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from zipfile import is_zipfile

import typer

from truearm.cli.console import Json, check_page_path, print_json, print_line, print_table, progress, version_row

if TYPE_CHECKING:
    from truearm.arm import Arm
    from truearm.verification.tasks.features import Feature
    from truearm.verification.tasks.sampled_arms import ArmDistribution
    from truearm.verification.tasks.task import Estimate, Fitness, TaskResult


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
        typer.Argument(metavar="MODEL|PRESET", help="A model file, or how wrong a virtual arm is: shop, research."),
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
            help="Middle of the feature, X,Y,Z [mm] in the arm's base frame; by default the middle of where a person "
            "works. Given twice: the two seats of a length.",
        ),
    ] = None,
    along: Annotated[
        str | None,
        typer.Option("--along", help="Direction X,Y,Z of a length (across the front), normal of a plate or bore (up)."),
    ] = None,
    points: Annotated[
        int | None, typer.Option("--points", help="In all: 25, of a length 2, half of them at each end.")
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option("--tolerance", parser=width, help="Width of the tolerance zone [mm]: 0.1 for +-0.05 mm."),
    ] = None,
    spec: Annotated[
        Path | None, typer.Option("--spec", help="An arm's specification instead: the limits it promises, .toml.")
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
            help="Of a model: measured standard deviation of a coordinate, the point taken again in the same pose "
            "[mm]; else nothing counts as random, and means of many points are stated too uncertain.",
        ),
    ] = None,
    arms: Annotated[int, typer.Option("--arms", help="Number of arms to draw.")] = 1000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of all that is drawn.")] = 0,
    report: Annotated[Path | None, typer.Option("--report", help="Page to write, .html.")] = None,
    as_json: Json = False,
) -> None:
    """Tell how well an arm measures a length or a shape.

    And whether it is good enough for a tolerance. Many arms are drawn that may be the one in question, and each
    measures the feature: errors of the arm once, random ones at each point. With a model: as its readings left the arm
    open. With a preset: any arm like that. With --spec: any arm that keeps what its maker promises, its worst test
    result half to all of the limit.

    Exit code with --tolerance, 0: good enough; 1: not; 3: only with guard bands. Without, 0.
    """
    from truearm.errors import InputError

    if report is not None:
        check_page_path(report, *[Path(path) for path in (what, spec, arm) if path is not None])
    if tolerance is not None and not (isfinite(tolerance) and tolerance > 0):
        raise InputError(f"--tolerance expects a width above zero in mm, got {tolerance}", hint="0.1 for +-0.05 mm")
    with progress(f"measuring a {feature}", total=arms) as tell:
        from truearm.verification.tasks.specification_sheet import SpecificationDistribution, share_of_limit
        from truearm.verification.tasks.task import fitness, simulate_measurements

        errors, about = _errors(what, spec, arm, repeatability)
        measured = _feature(
            feature,
            errors.arm,
            sizes={"length": length, "diameter": diameter, "size": size},
            at=at,
            along=along,
            points=points,
        )
        nominal = measured.quantities[0].nominal_mm
        if tolerance is not None and 0 < nominal <= tolerance:
            raise InputError(
                f"--tolerance expects a width in mm below the {nominal:g} mm that are measured, got {tolerance:g}",
                hint="0.05 for 50 micrometres",
            )
        share = share_of_limit if isinstance(errors, SpecificationDistribution) else None
        found = simulate_measurements(errors, measured, n_arms=arms, seed=seed, share_of_limit=share, progress=tell)
        fit = None if tolerance is None else fitness(found.estimates[0], tolerance)
        remarks = [*_remarks(errors, found), *assumptions(errors)]
        if found.at_limit is not None:
            remarks.append(
                f"Of arms that just keep the limits, U = {found.at_limit.expanded_mm:.4f} mm: to buy by, take it."
            )
        if report is not None:
            from truearm.pages.html import write_page
            from truearm.verification.tasks.task_page import task_page

            facts = _facts(errors, about, found, seed)
            write_page(task_page(found, fit, about=about, remarks=remarks, facts=facts), report)
    if as_json:
        print_json(_result(found, fit, about, remarks, errors))
    else:
        _tell(found, fit, about, remarks)
        if report is not None:
            print_line(f"{report}: the result with a picture of its distribution")
    if fit is not None:
        raise typer.Exit(CODES[fit.answer.value])


def _errors(
    what: str | None, spec: Path | None, arm: str | None, repeatability: float | None
) -> tuple[ArmDistribution, str]:
    """The arms that may be the one in question, and what is known of it in a few words."""
    from truearm.arm import load_arm
    from truearm.compensation.models.model_file import load_model
    from truearm.errors import InputError
    from truearm.identification.virtual.presets import PRESETS, load_preset
    from truearm.verification.tasks.sampled_arms import PosteriorDistribution, PresetDistribution

    if (what is None) == (spec is None):
        raise InputError(
            "expected a model, a preset or --spec, one of them", hint=f"a model file, {', '.join(PRESETS)}, or --spec"
        )
    if what is not None and Path(what).is_file() and is_zipfile(what):
        if arm is not None:
            raise InputError("--arm is for a preset or --spec; a model has its own", file=what)
        try:
            return PosteriorDistribution(load_model(what), repeatability), f"the model {Path(what).name}"
        except InputError as error:
            raise error.in_file(what) from None
    if repeatability is not None:
        raise InputError("--repeatability is for a model; a preset or specification says how points scatter")
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
            hint="truearm fit makes a model file" if not Path(what).exists() else "a file that truearm fit wrote",
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


def assumptions(errors: ArmDistribution) -> list[str]:
    """What a result rests on, in sentences."""
    from truearm.verification.tasks.sampled_arms import PosteriorDistribution
    from truearm.verification.tasks.specification_sheet import BEST_SHARE, LEAST_SHARE, TRIES, SpecificationDistribution

    perfect = "The part is perfect and at 20 degC; its temperature and its form are uncertainties besides."
    if isinstance(errors, PosteriorDistribution):
        if errors.repeatability_mm is None:
            random = "No repeatability is given, so all that the model leaves unexplained counts as the same at the "
            random += "same pose: for means of many points that errs to the safe side."
        else:
            random = f"Random error of a coordinate: {errors.random_std_mm:.4f} mm, as given."
        return [
            random,
            f"Unexplained, but the same at the same pose: {errors.field_std_mm:.4f} mm.",
            "The arm is at the mean temperature of the model's readings.",
            perfect,
        ]
    if isinstance(errors, SpecificationDistribution):
        limits = ", ".join(errors.specification.limits)
        assumed = (
            f"Assumed: their worst result is {BEST_SHARE:.0%} to 100% of its limit; an arm with another below "
            f"{LEAST_SHARE:.0%} is drawn again, up to {TRIES} times."
        )
        return [f"Arms drawn keep {limits}.", assumed, perfect]
    return [perfect]


def _remarks(errors: ArmDistribution, found: TaskResult) -> list[str]:
    from truearm.verification.tasks.sampled_arms import PosteriorDistribution

    if not isinstance(errors, PosteriorDistribution):
        return []
    outside = errors.model.outside_training(found.angles.reshape(-1, errors.arm.n_joints)).mean()
    if outside < 0.005:
        return []
    return [f"{outside:.0%} of the poses are away from those that the model learned from; it may be worse there."]


def _facts(errors: ArmDistribution, about: str, found: TaskResult, seed: int) -> list[tuple[str, str]]:
    arm = errors.arm
    return [
        ("known of the arm", about),
        ("arm", f"{arm.name}: {arm.title}. {arm.source}"),
        ("arms drawn", f"{found.n_arms}, seed {seed}"),
        ("ways to hold the arm", str(len(found.angles))),
        version_row(),
    ]


def _result(
    found: TaskResult, fit: Fitness | None, about: str, remarks: list[str], errors: ArmDistribution
) -> dict[str, Any]:
    from truearm.verification.tasks.task import COVERAGE_PROBABILITY

    return {
        "feature": found.feature.name,
        "known_of_the_arm": about,
        "arm": errors.arm.name,
        "points_mm": found.feature.points.tolist(),
        "n_arms": found.n_arms,
        "level": COVERAGE_PROBABILITY,
        "quantities": [_for_machines(one) for one in found.estimates],
        "expanded_at_limit_mm": None if found.at_limit is None else found.at_limit.expanded_mm,
        "tolerance": None
        if fit is None
        else {
            "tolerance_mm": fit.tolerance_mm,
            "answer": fit.answer.value,
            "ratio": fit.ratio if isfinite(fit.ratio) else None,
            "left_mm": fit.acceptance_zone_mm,
        },
        "remarks": remarks,
    }


def _for_machines(estimate: Estimate) -> dict[str, Any]:
    low, high = estimate.interval_mm
    of_draws = estimate.standard_errors
    return {
        "name": estimate.quantity.name,
        "nominal_mm": estimate.quantity.nominal_mm,
        "bias_mm": estimate.bias_mm,
        "u_mm": estimate.u_mm,
        "u_of_arm_mm": estimate.u_systematic_mm,
        "u_of_points_mm": estimate.u_random_mm,
        "interval_mm": [low, high],
        "expanded_mm": estimate.expanded_mm,
        "standard_errors_mm": {
            "bias": of_draws.bias_mm,
            "u": of_draws.u_mm,
            "low": of_draws.low_mm,
            "high": of_draws.high_mm,
            "expanded": of_draws.expanded_mm,
        },
    }


def _tell(found: TaskResult, fit: Fitness | None, about: str, remarks: list[str]) -> None:
    from truearm.verification.tasks.task import advice, describe_fitness

    print_line(f"{found.feature.name}, by {about}: errors of {found.n_arms} drawn arms")
    rows = []
    for one in found.estimates:
        low, high = one.interval_mm
        rows.append(
            [
                one.quantity.name,
                f"{one.bias_mm:+.4f}",
                f"{one.u_mm:.4f}",
                f"{low:+.4f} to {high:+.4f}",
                f"{one.u_systematic_mm:.4f}",
                f"{one.u_random_mm:.4f}",
            ]
        )
    print_table(["quantity", "bias [mm]", "u [mm]", "95 % of errors [mm]", "u of arm", "u of points"], rows)
    of_draws = found.estimates[0].standard_errors
    print_line(
        f"known by the number of draws to: bias {of_draws.bias_mm:.4f}, u {of_draws.u_mm:.4f}, ends "
        f"{of_draws.low_mm:.4f} and {of_draws.high_mm:.4f} mm (standard errors, {found.estimates[0].quantity.name})"
    )
    print_line(advice(found))
    for remark in remarks:
        print_line(remark)
    if fit is not None:
        print_line(describe_fitness(found.estimates[0], fit))
