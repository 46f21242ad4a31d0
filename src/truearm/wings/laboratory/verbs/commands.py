"""The commands of the laboratory but verify: task, measure and check."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_output_is_not_input
from truearm.wings.laboratory import FeatureKind

if TYPE_CHECKING:
    from truearm.wings.laboratory.verbs.check import CheckResult, WithdrawalResult

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


@options.of_verb("truearm.wings.laboratory.verbs.measure:measure")
def measure(
    verb: Any, model: options.ModelFile, session: options.SessionFile, as_json: options.Json = False, **given: Any
) -> None:
    """Measure a length, sphere, plane, circle, cylinder or cone.

    It is fitted to the compensated points of the readings. Each name in the column seat is a feature of its own, of
    lengths an end; without names all readings are of one feature. Of each two spheres or circles the distance of their
    centres is measured too, of planes, cylinders and cones distance and angle. The uncertainty is that of the arm, by
    the simulation of `truearm task` at the measured poses, together with the scatter of the points.
    """
    with progress(f"measuring a {given['feature']}", total=given["n_arms"]) as tell:
        result = verb(model, session, **given, progress=tell)
    print_record(result, as_json=as_json)


CheckedSession = Annotated[
    Path | None, Argument(metavar="SESSION", help="Session file, .csv or .parquet; none with --withdraw.")
]
RetiredOption = Annotated[
    list[str] | None, Option(help="Artefact that was repaired or replaced, and is no longer assessed.")
]
WithdrawOption = Annotated[
    str | None, Option("--withdraw", metavar="NUMBER|DATE", help="Withdraw a wrong check; it stays in the history.")
]
ReasonOption = Annotated[str | None, Option(help="With --withdraw: what was wrong with it.")]


def check(
    context: typer.Context,
    model: options.ModelFile,
    history: Annotated[Path, Option(help="File of the checks so far, .sqlite; the first check creates it.")],
    session: CheckedSession = None,
    lengths: options.LengthsFile = None,
    retired: RetiredOption = None,
    mpe: options.MpeFile = None,
    date: options.Date = None,
    page: options.Page = None,
    withdrawn: WithdrawOption = None,
    reason: ReasonOption = None,
    accept: options.AcceptOption = None,
    as_json: options.Json = False,
) -> None:
    """Check whether the arm is still as it was identified.

    A few readings in a seat, in both seats of a bar, on a sphere. Scatter, length error, form and diameter are added to
    the history and charted: is it time to recalibrate, and since when? The result on an artefact stays valid while the
    artefact is not measured. A session that is in the history already is not added again; the last one is completed
    if it comes with more, such as --lengths.

    --withdraw 12 --reason "the ball was dirty", without a session: check 12 no longer counts. It stays in the history
    with the reason, and on the page (--page), struck through. Exit code 0.

    Exit code 0: no need; 1: recalibrate; 3: undecided (repeat the check), or not enough checks.
    """
    from truearm.wings.laboratory.verbs.check import check as checked
    from truearm.wings.laboratory.verbs.check import withdraw_check

    if withdrawn is not None:
        stated = needed_reason(context, reason)
        check_page_path(page, model, history)
        print_withdrawal(withdraw_check(model, history, withdrawn, reason=stated), page, as_json=as_json)
        return
    file = needed_session(context, session, "truearm check MODEL SESSION --history HISTORY")
    files = (model, file, lengths, mpe)
    check_output_is_not_input(history, *files)
    check_page_path(page, *files, history)
    given: dict[str, Any] = {"lengths": lengths, "specification": mpe, "retired": retired or ()}
    print_check(lambda: checked(model, file, history, **given, date=date, accept=accept), file, page, as_json=as_json)


def needed_reason(context: typer.Context, reason: str | None) -> str:
    """The reason of a withdrawal, with which no option of a check is given."""
    options.refuse_typed(
        context, ("session", "lengths", "retired", "mpe", "date", "accept"), "does not apply to --withdraw"
    )
    if reason is None:
        raise InputError("--withdraw needs --reason as well", hint='--reason "the ball was dirty"')
    return reason


def needed_session(context: typer.Context, session: Path | None, hint: str) -> Path:
    """The session of a check, with which no option of a withdrawal is given."""
    options.refuse_typed(context, ["reason"], "applies to --withdraw only")
    if session is None:
        raise InputError("the session is missing", hint=hint)
    return session


def print_check(checked: Callable[[], CheckResult], session: Path, page: Path | None, *, as_json: bool) -> None:
    """Make a check, write its page, print it, and exit with what it says."""
    from truearm.wings.laboratory.monitor.assessment import RecalibrationAdvice

    with progress(f"checking {session.name}"):
        result = checked()
        if page is not None:
            result.save_page(page)
    print_record(result, as_json=as_json, files={"page": page})
    raise typer.Exit({RecalibrationAdvice.NO: 0, RecalibrationAdvice.YES: 1}.get(result.recalibrate, 3))


def print_withdrawal(result: WithdrawalResult, page: Path | None, *, as_json: bool) -> None:
    """Print a withdrawal, and write its page."""
    if page is not None and result.assessment is not None:
        result.save_page(page)
    print_record(result, as_json=as_json, files={"page": None if result.assessment is None else page})
