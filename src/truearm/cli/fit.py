"""``truearm fit``: learn a model of an arm from a session."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from truearm.cli.console import ArmName, Json, check_apart, progress, say, say_json

if TYPE_CHECKING:
    from truearm.models import Compensator
    from truearm.readings import ComparedErrors, Readings

# Below so many readings a kinematic model's training error says little: it has some 50 constants, 27 of them
# determined.
FEW_READINGS = 50
# Share of the reach by which an arm as drawn misses its readings that is worth a question.
SUSPECT_NOMINAL_ERROR = 0.01


def fit(
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="Session file with reference points.")],
    arm: ArmName,
    model: Annotated[
        Literal["nominal", "kinematic", "network"], typer.Option("--model", help="What to fit: see above.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Model file to write; .truearm by custom.")],
    free: Annotated[
        str, typer.Option("--free", help="What is unknown of the nominal arm's place: base,tip or none.")
    ] = "base,tip",
    hidden: Annotated[str, typer.Option("--hidden", help="Network: units of the hidden layers.")] = "30,30",
    trainer: Annotated[
        Literal["lm", "trainlm", "trainbr"],
        typer.Option("--trainer", help="Network: ours, or as MATLAB's (trainbr: few readings)."),
    ] = "lm",
    epochs: Annotated[int, typer.Option("--epochs", min=1, help="Network: at most so many.")] = 200,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Network: of the start and the validation split.")] = 0,
    as_json: Json = False,
) -> None:
    """Identify an arm: fit a model to its readings.

    nominal: the arm as drawn; only where its base stands and its tip sits is fitted. kinematic: the true constants of
    every joint, base and tip as well; the one to use. network: the founding paper's, straight from angles to
    coordinates; needs thousands of readings and holds only among them.

    --free base,tip: the reference has a frame of its own and the tip's place on the flange is not known (a laser
    tracker). --free none: points are in the arm's base frame and the tip is as drawn.
    """
    from truearm.arm import arm_from
    from truearm.models import MODELS, NominalModel
    from truearm.models.compensator import MIN_ROWS
    from truearm.models.file import save_model
    from truearm.readings import check_fit, check_reach, read_session
    from truearm.writing import check_writable

    nominal = arm_from(arm)
    check_apart(out, session, Path(arm))
    check_writable(out)
    known: dict[str, Any] = {"free": free_parts(free)}
    options: dict[str, Any] = {}
    if model == "network":
        options = {"hidden": layer_sizes(hidden), "trainer": trainer, "epochs": epochs, "seed": seed}
    fitted = MODELS[model](nominal, **known, **options)
    with progress(f"reading {session.name}"):
        readings = read_session(session, n_joints=nominal.n_joints)
        lower, upper = nominal.limits.T
        check_fit(
            readings,
            joint_names=nominal.joint_names,
            lower=lower,
            upper=upper,
            min_rows=max(MIN_ROWS, ceil((4 * nominal.n_joints + 3) / 3)) if model == "kinematic" else MIN_ROWS,
            prismatic=nominal.chain.prismatic,
        )
        check_reach(readings, reach=nominal.chain.reach)
        if model == "network" and trainer != "trainbr":
            _check_enough(readings, options["hidden"])
    with progress(f"fitting {model}", total=epochs if model == "network" else None) as tell:
        as_drawn = NominalModel(nominal, **known).fit_readings(readings)
        _check_same_arm(as_drawn, readings)
        fitted.fit_readings(readings, progress=tell)
    save_model(fitted, out)
    _say_result(fitted, readings, model, out, as_json=as_json)


def _check_enough(readings: Readings, hidden: tuple[int, ...]) -> None:
    """Refuse a network with more weights than numbers to learn from: it would remember and know nothing."""
    from truearm.nets.perceptron import Perceptron

    n_weights = Perceptron.with_layers(readings.n_joints, hidden, 3).n_weights
    if 3 * len(readings) < n_weights:
        raise readings.error(
            f"a network of {n_weights} weights needs at least {ceil(n_weights / 3)} readings, got {len(readings)}",
            hint="more readings, a smaller --hidden, --trainer trainbr, or --model kinematic, which needs some 50",
        )


def _check_same_arm(as_drawn: Compensator, readings: Readings) -> None:
    """Refuse readings that no arm of this drawing can have made."""
    from truearm.models.compensator import MOST_NOMINAL_ERROR
    from truearm.readings import errors_of

    assert readings.points is not None  # checked before the fit
    mean = errors_of(as_drawn.predict(readings.angles), readings.points)["mean_mm"]
    arm = as_drawn.arm
    if not mean < MOST_NOMINAL_ERROR * arm.chain.reach:
        raise readings.error(
            f"the arm {arm.name!r} as drawn misses the reference points by {mean:.4g} mm on average"
            f" at a reach of {arm.chain.reach:.4g} mm: they are not of this arm, or it is described wrongly",
            hint="check --arm, the units, signs and zeros of the angles, the unit of the points, and --free",
        )


def free_parts(text: str) -> tuple[str, ...]:
    """The free parts that --free names."""
    from truearm.errors import InputError

    parts = () if text.strip() == "none" else tuple(part.strip() for part in text.split(","))
    if not set(parts) <= {"base", "tip"}:
        raise InputError(f"--free expects base, tip, base,tip or none, got {text!r}", hint="--free base,tip")
    return parts


def layer_sizes(text: str) -> tuple[int, ...]:
    """The hidden layers that --hidden names."""
    from truearm.errors import InputError

    parts = text.split(",")
    if not all(part.strip().isascii() and part.strip().isdecimal() and 0 < int(part) < 10_000 for part in parts):
        raise InputError(
            f"--hidden expects numbers of units from 1 to 9999, separated by commas, got {text!r}",
            hint="--hidden 30,30",
        )
    return tuple(int(part) for part in parts)


def _say_result(fitted: Compensator, readings: Readings, model: str, out: Path, *, as_json: bool) -> None:
    from truearm.readings import compared_errors, errors_of

    assert readings.points is not None  # checked before the fit
    errors = compared_errors(fitted.predict(readings.angles), fitted.predict_nominal(readings.angles), readings.points)
    if as_json:
        say_json({"model": model, "file": str(out), "fit_seconds": fitted.fit_seconds_, "training": errors})
        return
    say(f"{out}: {model} model of {fitted.arm.name} from {len(readings)} readings in {fitted.fit_seconds_:.1f} s")
    say(_sentence(errors, compare=model != "nominal"))
    if not getattr(fitted, "fit_", fitted.nominal_).converged:
        say("The fit has not settled: more readings, or poses more different from one another, may help.")
    if model == "kinematic" and len(readings) < FEW_READINGS:
        say(f"Only {len(readings)} readings: the training error says little. Some {FEW_READINGS} serve.")
    missed = errors_of(fitted.predict_nominal(readings.angles), readings.points)["mean_mm"]
    if missed > SUSPECT_NOMINAL_ERROR * fitted.arm.chain.reach:
        say(f"The arm as drawn misses the readings by {missed:.1f} mm on average: is --arm {fitted.arm.name} right?")
    say("These are the readings it learned from: judge it on others, with truearm evaluate.")


def _sentence(errors: ComparedErrors, *, compare: bool) -> str:
    said = f"training error: mean {errors['mean_mm']:.4f} mm, maximum {errors['max_mm']:.4f} mm"
    if not compare:
        return said
    removed = errors["removed_percent"]
    if removed < 0:
        return f"{said} ({1 - removed / 100:.1f} times the nominal error)"
    return f"{said} ({removed:.1f} % of the nominal coordinate error removed)"
