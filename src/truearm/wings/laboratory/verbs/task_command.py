"""``truearm task``: the uncertainty of a measured feature, and whether the arm is good enough for a tolerance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.wings.laboratory import FeatureKind

CODES = {"yes": 0, "no": 1, "only with guard bands": 3}


@options.of_verb("truearm.wings.laboratory.verbs.task:task", omit=("size_mm", "second"))
def task(
    verb: Any,
    what: Annotated[
        str | None, Argument(metavar="MODEL|PRESET", help="A model file, or a preset of virtual arms: shop, research.")
    ] = None,
    feature: Annotated[FeatureKind, Option(help="What is measured.")] = "length",
    length: Annotated[float | None, Option(help="Nominal length, or distance of two planes [mm].")] = None,
    diameter: Annotated[float | None, Option(help="Diameter of a sphere, circle, cylinder or cone [mm].")] = None,
    size: Annotated[float | None, Option(help="Side of a square plane; of a distance of two planes 50 [mm].")] = None,
    depth: Annotated[float | None, Option(help="Depth of a cylinder (50) [mm].")] = None,
    angle: Annotated[float | None, Option(help="Angle of a cone or of two planes (90) [deg].")] = None,
    at: Annotated[
        list[str] | None,
        Option(
            help="Middle of the feature X,Y,Z [mm] in the arm's base frame, by default of the working volume; given "
            "twice: both seats of a length."
        ),
    ] = None,
    along: Annotated[
        str | None,
        Option(help="Direction X,Y,Z of a length (across the front), normal of a plane, axis (up), edge of an angle."),
    ] = None,
    specification: options.MpeFile = None,
    page: options.Page = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Estimate the uncertainty of measuring a length or a shape.

    With --tolerance, also decide whether the arm is fit for it. truearm draws many arms that may be the one in
    question; each measures the feature, with systematic errors drawn once per arm and random errors drawn per point.
    With a model: arms from its posterior. With a preset: virtual arms. With --mpe, a specification: arms whose worst
    test result is half to all of its limit. Without --arm, a preset or a specification is of the arm measuring7.

    Exit code with --tolerance, 0: fit; 1: not fit; 3: only with guard bands. Without, 0.
    """
    check_page_path(page, what, specification, given["arm"])
    sizes = _sizes(feature, {"length": length, "diameter": diameter, "size": size, "depth": depth, "angle": angle})
    with progress(f"measuring a {feature}", total=given["n_arms"]) as tell:
        direction = None if along is None else _vector("--along", along)
        of_feature = {"at": _places(feature, at or []), "along": direction, "second": sizes[1]}
        source = _source(what, specification)
        result = verb(source, feature, sizes[0], **of_feature, **given, progress=tell)
        if page is not None:
            result.save_page(page)
    print_record(result, as_json=as_json, files={"page": page})
    if result.fitness is not None:
        raise typer.Exit(CODES[result.fitness.answer.value])


def _source(what: str | None, spec: Path | None) -> str | Path:

    stated = [one for one in (what, spec) if one is not None]
    if len(stated) != 1:
        raise InputError(
            "expected one of a model, a preset and --mpe",
            hint="a model file, perfect, research, shop, worn, printed, or --mpe",
        )
    return stated[0]


def _sizes(feature: str, sizes: dict[str, float | None]) -> tuple[float | None, float | None]:
    """Both sizes of a feature out of its options."""
    from truearm.wings.laboratory.tasks.feature_postures import SECOND_SIZES, SIZES

    first, second = SIZES[feature], SECOND_SIZES.get(feature, ("", 0.0))[0]
    for name, value in sizes.items():
        if value is not None and name not in (first, second):
            known = f"--{first} and --{second}" if second else f"--{first}"
            raise InputError(f"--{name} does not apply to a {feature}", hint=known)
    return sizes[first], sizes.get(second)


def _places(feature: str, texts: list[str]) -> list[float] | list[list[float]] | None:
    """One place, or both ends of a length."""
    places = [_vector("--at", text) for text in texts]
    if len(places) > 1 + (feature == "length"):
        raise InputError(f"expected --at once, for a length once or twice, got it {len(places)} times")
    return places if len(places) == 2 else places[0] if places else None


def _vector(option: str, text: str) -> list[float]:
    """Three finite numbers."""
    from math import isfinite

    numbers = options.numbers_of(text, option, "600,0,300")
    if len(numbers) != 3 or not all(map(isfinite, numbers)):
        raise InputError(f"{option} expects three numbers X,Y,Z, got {text!r}", hint=f"{option} 600,0,300")
    return numbers
