"""``truearm report``: models of an arm compared on a session, as a page to show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truearm.cli.console import check_apart, progress, say

if TYPE_CHECKING:
    from truearm.models import Compensator
    from truearm.readings import Readings
    from truearm.report.comparison import Compared


def report(
    files: Annotated[list[Path], typer.Argument(metavar="MODEL... SESSION", help="Model files, then a session file.")],
    out: Annotated[Path, typer.Option("--out", help="Page to write, .html.")],
    title: Annotated[str, typer.Option("--title", help="Title of the page.")] = "",
) -> None:
    """Compare models on readings, as a page to show.

    The page is one HTML file that needs nothing beside it. The readings must have reference points.
    """
    from zipfile import is_zipfile

    from truearm.cli.predict import load_with_reference, without_served
    from truearm.errors import InputError
    from truearm.models.file import load_model
    from truearm.report.comparison import comparison_page
    from truearm.report.html import write_page
    from truearm.writing import check_writable

    *paths, session = files
    if paths and all(is_zipfile(path) for path in files):
        raise InputError(
            "expected a session file after the model files, got a model file",
            file=session,
            hint=f"truearm report {' '.join(str(path) for path in files)} SESSION --out {out}",
        )
    if not paths:
        raise InputError(
            "expected one or more model files, then a session file", hint="truearm report MODEL SESSION --out FILE"
        )
    if out.suffix not in (".html", ".htm"):
        raise InputError(f"expected a file name that ends in .html, got {out.name!r}", file=out)
    check_apart(out, *files)
    check_writable(out)
    with progress("drawing the report"):
        first, readings = load_with_reference(paths[0], session, purpose="compare with")
        # The others are of the same arm, or `compared` refuses them: the readings are checked once for all.
        models = dict(zip(_names(paths), [first, *map(load_model, paths[1:])], strict=True))
        readings, n_served = without_served(list(models.values()), readings)
        page = comparison_page(
            compared(models, readings),
            title=title or f"{first.arm.name}: error before and after compensation",
            subtitle=f"{len(readings)} readings of {session.name}",
            facts=facts(models, readings),
            remarks=[f"{name}: {remark}" for name, model in models.items() for remark in remarks(model, readings)],
        )
        write_page(page, out)
    if n_served:
        say(f"{n_served} readings served to refit a model and are left out")
    say(f"{out}: {len(models)} model{'s' * (len(models) > 1)} compared on {len(readings)} readings")


def compared(models: dict[str, Compensator], readings: Readings) -> Compared:
    """What the models make of the readings, each beside its own nominal arm; the first one's stands for all."""
    import numpy as np

    from truearm.errors import InputError
    from truearm.models import NominalModel
    from truearm.readings import compared_errors
    from truearm.report.comparison import Compared

    first = next(iter(models.values()))
    arm, points = first.arm, readings.points
    assert points is not None  # checked by the caller
    for name, model in models.items():
        if model.arm.name != arm.name or not np.array_equal(model.arm.chain.fixed, arm.chain.fixed):
            raise InputError(
                f"expected models of one arm, but {name!r} is of {model.arm.name!r}, not the first one's arm"
            )
        if tuple(model.free) != tuple(first.free):
            raise InputError(
                f"expected models with the same --free, but {name!r} has {list(model.free)}, "
                f"the first {list(first.free)}",
                hint="a report for each",
            )
    nominal = first.predict_nominal(readings.angles)
    predicted, errors = {"nominal": nominal}, {"nominal": compared_errors(nominal, nominal, points)}
    for name, model in models.items():
        if not isinstance(model, NominalModel):  # it is the first row already
            predicted[name] = model.predict_readings(readings)
            errors[name] = compared_errors(predicted[name], model.predict_nominal(readings.angles), points)
    lower, upper = arm.limits.T
    return Compared(
        angles=readings.angles,
        points=points,
        predicted=predicted,
        errors={name: dict(e) for name, e in errors.items()},  # type: ignore[arg-type]
        joint_names=arm.joint_names,
        lower=lower,
        upper=upper,
        sliding=arm.chain.slides.tolist(),
    )


def remarks(model: Compensator, readings: Readings) -> list[str]:
    """What must be known of a model before its errors on these readings are believed."""
    from truearm.models.compensator import MOST_NOMINAL_ERROR, fingerprint
    from truearm.readings import errors_of

    said = []
    if readings.points is not None:
        missed = errors_of(model.predict_nominal(readings.angles), readings.points)["mean_mm"]
        if missed > MOST_NOMINAL_ERROR * model.arm.chain.reach:
            said.append(
                f"The nominal arm misses these points by {missed:.0f} mm: probably they are of another arm or set-up, "
                "or a unit, sign or zero is wrong. Check the session."
            )
    outside = int(model.outside_training(readings.angles).sum())
    if outside:
        said.append(f"{outside} of {len(readings)} readings have a joint away from the training angles.")
    if readings.points is not None and fingerprint(readings) == model.data_fingerprint_:
        said.append("These are the readings it learned from: an honest test needs others (truearm split).")
    return said


def facts(models: dict[str, Compensator], readings: Readings) -> list[tuple[str, str]]:
    """What a page about models rests on."""
    import numpy
    import scipy

    from truearm import __version__
    from truearm.models.compensator import fingerprint

    assert readings.points is not None  # checked by the caller
    rows = [
        (f"model {name}", f"{model.n_train_} training readings, fingerprint {model.data_fingerprint_}")
        for name, model in models.items()
    ]
    rows.append(("readings of this page", f"fingerprint {fingerprint(readings)}"))
    rows.append(("fingerprint", "SHA-256 of angles [rad] and points [mm] as little-endian doubles, and seats"))
    arm = next(iter(models.values())).arm
    rows.append(("arm", f"{arm.name}: {arm.title}. {arm.source}"))
    rows.append(("versions", f"truearm {__version__}, NumPy {numpy.__version__}, SciPy {scipy.__version__}"))
    return rows


def _names(paths: list[Path]) -> list[str]:
    """A short, different name for each model: its file's stem, or its path where that is taken."""
    stems = [path.stem for path in paths]
    return [str(path) if stems.count(path.stem) > 1 or path.stem == "nominal" else path.stem for path in paths]
