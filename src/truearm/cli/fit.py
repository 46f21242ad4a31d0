"""``truearm fit``: learn a model of an arm from a session."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import nullcontext
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from truearm.cli.console import ArmName, Json, check_apart, note, progress, say, say_json

if TYPE_CHECKING:
    from truearm.models import Compensator
    from truearm.models.network import Member
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
        Literal["lm", "trainlm", "trainbr", "traingd", "traingdx"],
        typer.Option("--trainer", help="Network: ours, or as MATLAB's (trainbr: few readings)."),
    ] = "lm",
    epochs: Annotated[int, typer.Option("--epochs", min=1, help="Network: at most so many a training.")] = 200,
    goal: Annotated[
        float, typer.Option("--goal", min=0, help="Network: mean squared error of scaled outputs at which to stop.")
    ] = 0.0,
    validation: Annotated[
        float,
        typer.Option("--validation", min=0, max=1, help="Network: share of the readings set aside to stop in time."),
    ] = 0.15,
    restarts: Annotated[
        int, typer.Option("--restarts", min=1, help="Network: starts of each training; the best is kept.")
    ] = 1,
    members: Annotated[
        int, typer.Option("--members", min=1, help="Network: so many networks, whose mean predicts.")
    ] = 1,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Network: of the starts and the validation splits.")] = 0,
    as_json: Json = False,
) -> None:
    """Identify an arm: fit a model to its readings.

    nominal: the arm as drawn; only where its base stands and its tip sits is fitted. kinematic: the true constants of
    every joint, base and tip as well; the one to use. network: the founding paper's, straight from angles to
    coordinates; needs thousands of readings and holds only among them.

    --free base,tip: the reference has a frame of its own and the tip's place on the flange is not known (a laser
    tracker). --free none: points are in the arm's base frame and the tip is as drawn.

    A network's training may be stopped (Ctrl-C, kill): what it has reached stays in the folder OUT.training, and the
    same command goes on from there to the same model. The folder is removed when the model is written.
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
        options = {"hidden": layer_sizes(hidden), "trainer": trainer, "epochs": epochs, "goal": goal, "seed": seed}
        options |= {"validation": validation, "n_restarts": restarts, "n_members": members}
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
    trains = model == "network"
    with (
        Kept(out) if trains else nullcontext() as kept,
        progress(f"fitting {model}", total=epochs * restarts * members if trains else None) as tell,
    ):
        as_drawn = NominalModel(nominal, **known).fit_readings(readings)
        _check_same_arm(as_drawn, readings)
        if kept is None:
            fitted.fit_readings(readings, progress=tell)
        else:
            fitted.fit_readings(readings, progress=kept.telling(tell), checkpoint=kept.folder)
        save_model(fitted, out)
    _say_result(fitted, readings, model, out, as_json=as_json)


class Kept:
    """The folder beside a model file where its training is kept while the block runs.

    An interrupted block leaves it, and the next one goes on from it; a block that comes to its end removes it.

    Parameters
    ----------
    out : Path
        The model file.

    Raises
    ------
    InputError
        If there is a file of that name; from the block, if the folder holds trainings of other readings or options.
    """

    def __init__(self, out: Path) -> None:
        from truearm.errors import InputError
        from truearm.models.network import checkpoints

        # The longest name that a file may have leaves no room for more.
        name = out.name if len(os.fsencode(out.name)) < 240 else out.name[:50]
        self.folder = out.with_name(f"{name}.training")
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError("expected a folder for the training, or none yet", file=self.folder, hint="another --out")
        self._found = bool(checkpoints(self.folder))

    def telling(self, tell: Callable[[int, str], None]) -> Callable[[int, str], None]:
        """`tell`, which first of all says that a training is gone on with."""

        def told(done: int, text: str) -> None:
            if self._found:
                note(f"going on with the training kept in {self.folder}")
                self._found = False
            tell(done, text)

        return told

    def __enter__(self) -> Kept:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        from truearm.errors import InputError
        from truearm.models.network import checkpoints, remove_checkpoints
        from truearm.nets.checkpoint import ANEW

        if error is None or not checkpoints(self.folder):
            remove_checkpoints(self.folder)
        elif isinstance(error, KeyboardInterrupt | SystemExit):
            note(f"the training so far is kept in {self.folder}: the same command goes on with it")
        elif isinstance(error, InputError) and error.file is not None and error.hint == ANEW:
            raise InputError(
                f"{error.file.name}: {error.problem}",
                file=self.folder,
                hint="the command that was stopped here, another --out, or delete the folder to begin anew",
            ) from None


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
    from truearm.models import NetworkModel
    from truearm.readings import compared_errors, errors_of

    assert readings.points is not None  # checked before the fit
    errors = compared_errors(fitted.predict(readings.angles), fitted.predict_nominal(readings.angles), readings.points)
    if as_json:
        told = {"model": model, "file": str(out), "fit_seconds": fitted.fit_seconds_, "training": errors}
        if isinstance(fitted, NetworkModel):
            told["network"] = {"trainer": fitted.trainer, "members": [_facts(member) for member in fitted.members_]}
        say_json(told)
        return
    say(f"{out}: {model} model of {fitted.arm.name} from {len(readings)} readings in {fitted.fit_seconds_:.1f} s")
    if isinstance(fitted, NetworkModel):
        for number, member in enumerate(fitted.members_, 1):
            facts = _facts(member)
            who = f"member {number}, start {facts['start']}" if len(fitted.members_) > 1 else "training"
            say(f"{who}: {facts['stop'].rstrip('.')} after {facts['epochs']} epochs, the best {facts['best_epoch']}")
    say(_sentence(errors, compare=model != "nominal"))
    if not getattr(fitted, "fit_", fitted.nominal_).converged:
        say("The fit has not settled: more readings, or poses more different from one another, may help.")
    if model == "kinematic" and len(readings) < FEW_READINGS:
        say(f"Only {len(readings)} readings: the training error says little. Some {FEW_READINGS} serve.")
    missed = errors_of(fitted.predict_nominal(readings.angles), readings.points)["mean_mm"]
    if missed > SUSPECT_NOMINAL_ERROR * fitted.arm.chain.reach:
        say(f"The arm as drawn misses the readings by {missed:.1f} mm on average: is --arm {fitted.arm.name} right?")
    say("These are the readings it learned from: judge it on others, with truearm evaluate.")


def _facts(member: Member) -> dict[str, Any]:
    """What became of a member's training: that of the start that was kept, starts counted from 1."""
    record = member.record
    assert record is not None  # just trained
    return {
        "start": member.start + 1,
        "epochs": record.num_epochs,
        "best_epoch": record.best_epoch,
        "stop": record.stop,
        "seconds": float(record.time[-1]),
    }


def _sentence(errors: ComparedErrors, *, compare: bool) -> str:
    said = f"training error: mean {errors['mean_mm']:.4f} mm, maximum {errors['max_mm']:.4f} mm"
    if not compare:
        return said
    removed = errors["removed_percent"]
    if removed < 0:
        return f"{said} ({1 - removed / 100:.1f} times the nominal error)"
    return f"{said} ({removed:.1f} % of the nominal coordinate error removed)"
