"""The commands of the core, each with the options of its verb: split, fit, refit, predict and evaluate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer
from typer import Argument, Option

from truearm.choices import Conditions, Trainer
from truearm.errors import InputError
from truearm.findings import Finding
from truearm.verbs import options
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.outputs import check_model_output, check_new_output

if TYPE_CHECKING:
    from truearm.verbs.fit import FitResult

# The models that have an option.
MODELS_OF: dict[str, tuple[str, ...]] = {
    "prior": ("auto", "kinematic", "physical", "hybrid"),
    "no_residual_process": ("auto", "physical"),
    "hidden": ("network", "hybrid"),
    "trainer": ("network",),
    "epochs": ("network", "hybrid"),
    "goal": ("network",),
    "validation": ("network",),
    "restarts": ("network",),
    "members": ("network", "hybrid"),
    "seed": ("network", "hybrid"),
    "arm_model": ("hybrid",),
    "apply": ("auto", "kinematic", "physical", "hybrid"),
}

# Parameters of a model whose name is not that of the option.
PARAMETERS = {"restarts": "n_restarts", "members": "n_members", "no_residual_process": "residual"}


def split(
    session: options.SessionFile,
    train: Annotated[Path, Option(help="Session file to write the training readings to.")],
    test: Annotated[Path, Option(help="Session file to write the held-out readings to.")],
    by: Annotated[str, Option(help="What stays together: position, seat, session or row.")] = "position",
    share: Annotated[float, Option("--hold-out", help="Share of the groups to hold out.")] = 0.3,
    seed: options.Seed = 0,
    force: options.Force = False,
) -> None:
    """Split a session into training and test readings.

    Readings of one position (seat, session) are neighbours and stay together, or the test would be too easy. Columns
    of notes are not copied.

    A folder of session files, or a file beyond 512 MB, is read part by part; by row, 8192 consecutive readings stay
    together.
    """
    from truearm.files.atomic_write import atomic_file, is_same_file
    from truearm.readings import check_session_path, read_session, write_session
    from truearm.readings.files import is_large, table_writer
    from truearm.readings.large_sessions import LargeSession, held_out_rows
    from truearm.readings.session import SplitBy

    if is_same_file(train, test):
        raise InputError("--train and --test are the same file", file=train)
    for path in (train, test):
        check_session_path(path)
        check_new_output(path, session, force=force)
    counts = [0, 0]
    with progress(f"splitting {session.name}") as update:
        # Both or none: a new training file beside an old test file would share readings with it.
        if is_large(session):
            large = LargeSession.open(session)
            held = held_out_rows(large, by=by, fraction=share, seed=seed)
            with table_writer(train) as append_train, table_writer(test) as append_test:
                for part in large.parts:
                    for readings in part.sessions():
                        is_held = held(readings, sum(counts))
                        for i, (append, rows) in enumerate(((append_train, ~is_held), (append_test, is_held))):
                            if rows.any():
                                append(large.table(readings.rows(rows)))
                                counts[i] += int(rows.sum())
                        update(sum(counts), f"{sum(counts)} of {len(large)} readings")
        else:
            parts = read_session(session).split(by=cast(SplitBy, by), hold_out=share, seed=seed)
            with atomic_file(train) as new_train, atomic_file(test) as new_test:
                for i, (path, one) in enumerate(zip((new_train, new_test), parts, strict=True)):
                    write_session(one, path)
                    counts[i] = len(one)
    for path, n in zip((train, test), counts, strict=True):
        print_line(f"{path}: {n} of {sum(counts)} readings")


@options.of_verb("truearm.verbs.evaluate:evaluate")
def evaluate(
    verb: Any,
    context: typer.Context,
    model: options.ModelFile,
    session: Annotated[
        Path,
        Argument(
            metavar="SESSION",
            help="Session file with reference points or seats, or folder of files; not the training session.",
        ),
    ],
    conditions: Annotated[
        Conditions | None,
        Option(
            help="Conditions of these readings: the day and set-up of the training (repeatability), or others "
            "(reproducibility). By default what the column session says."
        ),
    ] = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Test a model on readings it was not fitted to.

    The nominal arm is evaluated beside it, with base and tip (where they were free) fitted to the model's own training
    readings. Readings with a reference point are compared with it; readings in a seat with the mean of the points
    predicted there; the distance between two such means with the known length. Readings from which truearm refit
    identified base and tip are skipped. The coverage is stated for both conditions of the uncertainty, with the one
    that applies.

    A folder of session files, or a file beyond 512 MB, is read part by part, and --workers or --scheduler shares the
    parts out; only its reference points are compared (docs/large-sessions.md).
    """
    executor = options.executor_of(context, session, workers, scheduler)
    with progress(f"evaluating {session.name}") as update:
        evaluation = verb(model, session, conditions=conditions, **given, executor=executor, progress=update)
    print_record(evaluation, as_json=as_json)


@options.of_verb("truearm.verbs.predict:predict")
def predict(
    verb: Any,
    context: typer.Context,
    model: options.ModelFile,
    session: Annotated[
        Path,
        Argument(
            metavar="SESSION",
            help="Session file, or folder of files; its angles, and temperature, payload_kg, loads, directions and tip "
            "if there, are used.",
        ),
    ],
    out: Annotated[Path, Option(help="Table of points to write, .csv or .parquet.")],
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Compensate: turn joint angles into corrected coordinates.

    Columns of the table: x_mm, y_mm, z_mm in the frame of the reference, after a fit to several sessions in that of the
    reading's session; sx_mm, sy_mm, sz_mm their standard uncertainties (twice that is the expanded uncertainty, k = 2);
    outside_training 1 where a reading is outside the range that the model was trained on; names (seat, position, ..) as
    given.

    A folder of session files, or a file beyond 512 MB, is read part by part, and --workers or --scheduler shares the
    parts out (docs/large-sessions.md).
    """
    executor = options.executor_of(context, session, workers, scheduler)
    with progress(f"predicting {session.name}") as update:
        prediction = verb(model, session, out, **given, executor=executor, progress=update)
    print_record(prediction, as_json=as_json, files={"points": out})


@options.of_verb("truearm.verbs.refit:refit")
def refit(
    verb: Any,
    model: options.ModelFile,
    session: Annotated[
        Path, Argument(metavar="SESSION", help="Session file of the new set-up, with reference points or seats.")
    ],
    out: options.ModelOut,
    n_readings: Annotated[
        int | None, Option("--rows", min=1, help="Number of readings to use; all by default.")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Transfer a model to a new set-up of its arm.

    The tracker was moved, or the probe was changed: the arm stays as it was identified, with its uncertainty; only
    where its base and its tip are is fitted to the new readings. Four readings or more are needed.

    --rows 20 uses 20 readings, of as many positions as possible. The model file records which they were, and truearm
    evaluate skips them in the same session and tests on the others. --free tip: only the probe is new, as with a
    session that has seats and no reference points.
    """
    check_model_output(out, None, model, session, given["lengths"], force=force)
    with progress(f"refitting {model.name}") as report:
        result = verb(model, session, n_readings=n_readings, **given, progress=report)
        check_model_output(out, result.model.arm_, force=force)
        result.save(out)
    print_record(result, as_json=as_json, files={"model": out})


@options.of_verb("truearm.verbs.fit:fit")
def fit(
    verb: Any,
    context: typer.Context,
    session: Annotated[
        Path, Argument(metavar="SESSION", help="Session file with reference points or seats, or folder of files.")
    ],
    out: options.ModelOut,
    arm: options.ArmOption = None,
    model: options.ModelOption = "auto",
    no_residual_process: Annotated[
        bool, Option("--no-residual-process", help="Physical: without smooth errors that no term describes.")
    ] = False,
    hidden: Annotated[
        str | None, Option(help="Network, hybrid: units of the hidden layers; default 30,30 and 15.")
    ] = None,
    trainer: Annotated[
        Trainer,
        Option(help="Network: variable projection, or as in MATLAB (trainbr: few readings, after Foresee and Hagan)."),
    ] = "varpro",
    epochs: Annotated[
        int | None, Option(min=1, help="Network, hybrid: maximum epochs per training run; default 200 and 30.")
    ] = None,
    goal: Annotated[float, Option(min=0, help="Network: mean squared error of scaled outputs at which to stop.")] = 0.0,
    validation: Annotated[
        float, Option(min=0, max=1, help="Network: share of the readings held out to stop in time.")
    ] = 0.15,
    restarts: Annotated[int, Option(min=1, help="Network: starts of each run, of which the best is kept.")] = 1,
    members: Annotated[
        int | None, Option(min=1, help="Network, hybrid: networks, the mean of which predicts; default 1 and 5.")
    ] = None,
    seed: options.Seed = 0,
    arm_model: Annotated[
        Literal["kinematic", "nominal"], Option(help="Hybrid: the arm whose residuals the networks learn.")
    ] = "kinematic",
    apply: options.ArmOut = None,
    force: options.Force = False,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    details: options.Details = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Identify an arm: fit a model to its readings.

    nominal: the nominal arm; only where its base and its tip are is fitted. kinematic: the true constants of every
    joint, base and tip as well. physical: also what angles, weight and temperature do to the arm, as far as the
    readings show it. hybrid: the kinematic arm, and small networks on its residuals. auto (the default) fits the first
    three, and the hybrid where it may win, and selects the simplest that predicts held-out readings as well as the
    best. network: the founding paper's, straight from angles to coordinates; it needs no arm, but
    thousands of readings with points, and is valid only in the range it was trained on. --seed is of the starts of
    networks and of the splits of their readings.

    Without an instrument: name the seat of every reading in a column seat, and give the lengths between seats by
    --lengths (columns seat_a, seat_b, length_mm, u_mm). Without one length at least, the arm keeps its nominal size.

    --free base,tip: the reference has a frame of its own, and the position of the tip on the flange is not known (a
    laser tracker). --free none: points are in the arm's base frame and the tip is known. --apply writes
    the nominal arm with the joint zeros that were found to a new arm file.

    A folder of session files, or a file beyond 512 MB, is read part by part, and --workers or --scheduler shares the
    parts out: models with networks use 20000 readings, others all (docs/large-sessions.md).
    """
    from truearm.arm import load_arm
    from truearm.arm.catalogue import arm_path
    from truearm.readings.files import is_large

    check_options(context, model)
    files = session, None if arm is None else arm_path(arm), given["lengths"], given["prior"]
    check_model_output(out, None if arm is None else load_arm(arm), *files, force=force)
    if apply is not None:
        check_new_output(apply, *files, out, force=force, endings=(".toml", ".urdf"))
        check_table(arm, apply)
    total = 4 if model == "auto" else None
    if model == "network":
        total = (epochs or 200) * restarts * (members or 1)
    elif model == "hybrid":
        total = 5 if members is None else members
        if total < 2:
            raise InputError(f"expected --members of 2 or more for a hybrid model, got {total}", hint="--members 5")
    stated: dict[str, Any] = {"hidden": hidden and layer_sizes(hidden), "trainer": trainer, "epochs": epochs}
    stated |= {"goal": goal, "validation": validation, "restarts": restarts, "members": members, "seed": seed}
    stated |= {"arm_model": arm_model, "no_residual_process": False if no_residual_process else None}
    of_model = {name: value for name, value in stated.items() if value is not None and model in MODELS_OF[name]}
    given |= {"model": model} | {PARAMETERS.get(name, name): value for name, value in of_model.items()}
    executor = options.executor_of(context, session, workers, scheduler)
    with progress(f"fitting {model}", total=None if is_large(session) else total) as report:
        result = verb(arm, session, **given, executor=executor, progress=report)
        check_model_output(out, result.model.arm_, force=force)  # its readings may state a serial number
        result.save(out)
        result, apply = with_arm_file(result, apply, out)
    print_record(result, as_json=as_json, files={"model": out, "arm": apply}, details=details)


def check_table(arm: str | None, apply: Path) -> None:
    """Refuse before the fit an arm file that cannot hold the arm: its table."""
    from truearm.arm import dh_table, load_arm

    if arm is not None and apply.suffix == ".toml":
        dh_table(load_arm(arm).chain)


def with_arm_file(result: FitResult, file: Path | None, model_file: Path) -> tuple[FitResult, Path | None]:
    """Write an arm file with the identified zeros, after the model; none where none were identified, which is said.

    Raises
    ------
    InputError
        If the file cannot hold this arm.
    """
    from truearm.arm import write_arm

    if file is None:
        return result, None
    if not result.identifies_constants:
        why = f"{file} is not written: the nominal arm was kept, and no joint zeros were identified."
        return replace(result, findings=(*result.findings, Finding("file", why))), None
    try:
        write_arm(result.arm_with_zeros(), file)
    except InputError as error:
        written = f"the model is written to {model_file}"
        raise error.with_hint(f"{error.hint}; {written}" if error.hint else written) from None
    return result, file


def check_options(context: typer.Context, model: str | None) -> None:
    """Refuse options that the model does not have: it would not follow them."""
    for models in dict.fromkeys(MODELS_OF.values()):
        if model not in models:
            names = [name for name, of in MODELS_OF.items() if of == models]
            rule = f"applies to {' and '.join(models)} models only, got --model {model}"
            options.refuse_typed(context, names, rule, hint=f"omit it, or use --model {models[0]}")


def layer_sizes(text: str) -> tuple[int, ...]:
    """The hidden layers that --hidden names."""
    parts = text.split(",")
    if not all(part.strip().isascii() and part.strip().isdecimal() and 0 < int(part) < 10_000 for part in parts):
        raise InputError(
            f"--hidden expects numbers of units from 1 to 9999, separated by commas, got {text!r}",
            hint="--hidden 30,30",
        )
    return tuple(int(part) for part in parts)
