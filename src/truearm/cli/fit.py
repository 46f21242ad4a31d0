"""``truearm fit``: learn a model of an arm from a session."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from truearm.cli.console import ArmName, Json, progress, say, say_json

if TYPE_CHECKING:
    from truearm.models import Compensator
    from truearm.readings import ComparedErrors, Readings


def fit(
    session: Annotated[Path, typer.Argument(help="Session file with reference points.")],
    arm: ArmName,
    model: Annotated[Literal["nominal", "kinematic", "network"], typer.Option("--model", help="What to fit.")],
    out: Annotated[Path, typer.Option("--out", help="Model file to write.")],
    free: Annotated[
        str, typer.Option("--free", help="What is unknown of the nominal arm's place: base,tip or none.")
    ] = "base,tip",
    hidden: Annotated[str, typer.Option("--hidden", help="Network: units of the hidden layers.")] = "30,30",
    trainer: Annotated[
        Literal["lm", "trainlm"], typer.Option("--trainer", help="Network: ours, or as MATLAB's.")
    ] = "lm",
    epochs: Annotated[int, typer.Option("--epochs", min=1, help="Network: at most so many.")] = 200,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Network: of the start and the validation split.")] = 0,
    as_json: Json = False,
) -> None:
    """Identify an arm: fit a model to readings with reference points.

    --free base,tip: the reference has a frame of its own and the tip's place on the flange is not known (a laser
    tracker). --free none: points are in the arm's base frame and the tip is as drawn.
    """
    from truearm.arm import arm_from
    from truearm.models import MODELS
    from truearm.models.compensator import MIN_ROWS
    from truearm.models.file import save_model
    from truearm.readings import check_fit, read_session
    from truearm.writing import check_writable

    nominal = arm_from(arm)
    check_writable(out)
    readings = read_session(session, n_joints=nominal.n_joints)
    lower, upper = nominal.limits.T
    check_fit(
        readings,
        joint_names=nominal.joint_names,
        lower=lower,
        upper=upper,
        min_rows=MIN_ROWS,
        prismatic=nominal.chain.prismatic,
    )
    options: dict[str, object] = {"free": free_parts(free)}
    if model == "network":
        options |= {"hidden": layer_sizes(hidden), "trainer": trainer, "epochs": epochs, "seed": seed}
    fitted = MODELS[model](nominal, **options)
    with progress(f"fitting the {model} model", total=epochs if model == "network" else None) as tell:
        fitted.fit_readings(readings, progress=tell)
    save_model(fitted, out)
    _say_result(fitted, readings, model, out, as_json=as_json)


def free_parts(text: str) -> tuple[str, ...]:
    """The free parts that --free names."""
    return () if text.strip() == "none" else tuple(part.strip() for part in text.split(",") if part.strip())


def layer_sizes(text: str) -> tuple[int, ...]:
    """The hidden layers that --hidden names."""
    from truearm.errors import InputError

    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--hidden expects whole numbers separated by commas, got {text!r}", hint="--hidden 30,30"
        ) from None


def _say_result(fitted: Compensator, readings: Readings, model: str, out: Path, *, as_json: bool) -> None:
    from truearm.readings import compared_errors

    assert readings.points is not None  # checked before the fit
    errors = compared_errors(fitted.predict(readings.angles), fitted.predict_nominal(readings.angles), readings.points)
    if as_json:
        say_json({"model": model, "file": str(out), "fit_seconds": fitted.fit_seconds_, "training": errors})
        return
    say(f"{out}: {model} model of {fitted.arm.name} from {len(readings)} readings in {fitted.fit_seconds_:.1f} s")
    say(_sentence(errors))
    say("These are the readings it learned from: judge it on others, with truearm evaluate.")


def _sentence(errors: ComparedErrors) -> str:
    return (
        f"training error: mean {errors['mean_mm']:.4f} mm, maximum {errors['max_mm']:.4f} mm "
        f"({errors['removed_percent']:.1f} % of the nominal error removed)"
    )
