"""``truearm fit``: learn a model of an arm from a session."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from truearm.cli.console import (
    ArmOption,
    Json,
    check_output_is_not_input,
    print_json,
    print_line,
    print_status,
    print_table,
    progress,
)

if TYPE_CHECKING:
    from truearm.arm import Arm
    from truearm.compensation.models import Compensator, NominalModel
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.compensation.models.network import Member
    from truearm.compensation.models.selection import ModelScore
    from truearm.identification.estimation.outliers import LengthOutlier
    from truearm.readings import ErrorComparison, Lengths, Session

# Below so many readings a kinematic model's training error says little: it has some 50 constants, 27 of them
# determined.
FEW_READINGS = 50
# Left-out terms and readings far off that are named one by one.
MOST_NAMED = 6
# A length that is known worse tells no arm's size, or its uncertainty is in micrometres.
MOST_U_SHARE = 0.005
# Share of the reach by which an arm as drawn misses its readings that is worth a question.
SUSPECT_NOMINAL_ERROR = 0.01


def fit(
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="Session file with reference points or seats.")],
    arm: ArmOption,
    out: Annotated[Path, typer.Option("--out", help="Model file to write; .truearm by custom.")],
    model: Annotated[
        Literal["auto", "nominal", "kinematic", "physical", "network"],
        typer.Option("--model", help="What to fit: see above."),
    ] = "auto",
    lengths: Annotated[
        Path | None, typer.Option("--lengths", help="File of known lengths between the session's seats, .csv.")
    ] = None,
    free: Annotated[
        str, typer.Option("--free", help="What is unknown of the nominal arm's place: base,tip or none.")
    ] = "base,tip",
    hidden: Annotated[str, typer.Option("--hidden", help="Network: units of the hidden layers.")] = "30,30",
    trainer: Annotated[
        Literal["varpro", "trainlm", "trainbr", "traingd", "traingdx"],
        typer.Option("--trainer", help="Network: ours, or as MATLAB's (trainbr: few readings)."),
    ] = "varpro",
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
    every joint, base and tip as well. physical: also what angles, weight and temperature do to the arm, as far as the
    readings show it. auto (the default) fits these three and keeps the simplest that predicts readings held out as well
    as the best. network: the founding paper's, straight from angles to coordinates; needs thousands of readings with
    points and holds only among them.

    Without an instrument: name the seat of every reading in a column seat, and give the lengths between seats by
    --lengths (columns seat_a, seat_b, length_mm, u_mm). One length at least, or the arm's size stays as drawn.

    --free base,tip: the reference has a frame of its own and the tip's place on the flange is not known (a laser
    tracker). --free none: points are in the arm's base frame and the tip is as drawn.
    """
    from truearm.arm import load_arm
    from truearm.compensation.models import MODELS, NetworkModel
    from truearm.compensation.models.model_file import save_model
    from truearm.compensation.models.reading_references import check_spread
    from truearm.compensation.models.selection import select_model
    from truearm.files.atomic_write import check_writable
    from truearm.readings import read_session

    nominal = load_arm(arm)
    check_output_is_not_input(out, session, Path(arm), *([] if lengths is None else [lengths]))
    check_writable(out)
    parts = free_parts(free)
    network = None
    if model == "network":
        options: dict[str, Any] = {"hidden": layer_sizes(hidden), "trainer": trainer, "epochs": epochs, "goal": goal}
        options |= {"seed": seed, "validation": validation, "n_restarts": restarts, "n_members": members}
        network = NetworkModel(nominal, free=parts, **options)
    with progress(f"reading {session.name}"):
        readings = read_session(session, n_joints=nominal.n_joints)
        _check(readings, nominal, relations=network is None, constants=model in ("kinematic", "physical"))
        known = None if lengths is None else lengths_of(lengths, readings)
        note_expansion(known, readings)
        if "base" in parts:
            check_spread(readings, nominal)
        as_drawn = _fitted_as_drawn(nominal, parts, readings, known)
    fitted: Compensator
    table: tuple[ModelScore, ...] = ()
    if network is not None:
        with progress("fitting network", total=epochs * restarts * members) as tell:
            network.fit_readings(
                readings,
                lengths=known,
                progress=tell,
                nominal=as_drawn,
            )
            fitted = network
            save_model(fitted, out)
    else:
        with progress(f"fitting {model}", total=3 if model == "auto" else None) as tell:
            if model == "auto":
                given: dict[str, Any] = {"free": parts, "lengths": known, "nominal": as_drawn}
                fitted, table = select_model(nominal, readings, progress=tell, **given)
            elif model == "nominal":
                fitted = as_drawn
            else:
                fitted = MODELS[model](nominal, free=parts)
                fitted.fit_readings(readings, lengths=known, progress=tell, nominal=as_drawn)
            save_model(fitted, out)
    _say_result(fitted, readings, table, out, lengths=known, as_json=as_json)


def _check(readings: Session, arm: Arm, *, relations: bool, constants: bool) -> None:
    from truearm.compensation.models.compensator import MIN_ROWS
    from truearm.readings import check_fit, check_reach

    lower, upper = arm.limits.T
    check_fit(
        readings,
        joint_names=arm.joint_names,
        lower=lower,
        upper=upper,
        min_rows=max(MIN_ROWS, ceil((4 * arm.n_joints + 3) / 3)) if constants else MIN_ROWS,
        prismatic=arm.chain.prismatic,
        relations=relations,
    )
    check_reach(readings, reach=arm.chain.reach)


def lengths_of(path: Path, readings: Session, used: Session | None = None) -> Lengths | None:
    """The lengths of a file that are between the session's seats, and between those of the readings used of it.

    Names are checked on all readings: those used need not be in all seats.
    """
    from truearm.errors import InputError
    from truearm.readings import read_lengths

    if readings.seat is None:
        raise InputError("lengths are between seats, and the session names none", file=path, hint="a column seat")
    stated = read_lengths(path)
    if (unsure := stated.u_mm > MOST_U_SHARE * stated.length_mm).any():
        row = int(unsure.argmax())
        raise stated.error(
            f"expected at most {MOST_U_SHARE:.1%} of the length, got {stated.u_mm[row]:.6g} mm",
            row,
            column="u_mm",
            hint="standard uncertainties in mm: 5 micrometres are 0.005",
        )
    known = stated.between(readings.seat.tolist())
    if len(known) < len(stated):
        left = len(stated) - len(known)
        print_status(f"{left} of {len(stated)} lengths are between seats that the session has not: left out")
    if used is None or used.seat is None:
        return known
    within = known.within(used.seat.tolist())
    if left := len(known) - (0 if within is None else len(within)):
        print_status(f"{left} of {len(known)} lengths are left out: none of the readings used is in one of their seats")
    return within


def as_measured(lengths: Lengths | None, readings: Session) -> Lengths | None:
    """Lengths as they are at the temperature of the readings, told where that is not known."""
    from truearm.readings.thermal_expansion import at_measured_temperature

    note_expansion(lengths, readings)
    if lengths is None or readings.seat is None:
        return None
    return at_measured_temperature(lengths, readings.seat, readings.temperature_degC)


def note_expansion(lengths: Lengths | None, readings: Session) -> None:
    """Tell of lengths that are taken as at 20 degC for want of a temperature or an expansion, where that matters."""
    import numpy as np

    from truearm.readings.thermal_expansion import REFERENCE_DEGC, STEEL_PER_K, thermal_expansion_of

    if lengths is None:
        return
    degC = readings.temperature_degC
    if degC is None:
        if lengths.expansion_per_K is not None:
            print_status(f"lengths are taken as at {REFERENCE_DEGC:g} degC: the session states no temperature")
        return
    assert readings.seat is not None  # checked by the caller
    growth = thermal_expansion_of(lengths, readings.seat, degC)
    steel = np.abs(lengths.length_mm * STEEL_PER_K * (degC.mean() - REFERENCE_DEGC))
    unknown = ~growth.known & (steel > lengths.u_mm)
    if unknown.any():
        print_status(
            f"{int(unknown.sum())} of {len(lengths)} lengths are taken as at {REFERENCE_DEGC:g} degC; at the readings' "
            f"{degC.mean():.1f} degC they differ by {steel[unknown].max():.4f} mm, if they are of steel: columns "
            "expansion_per_K and u_expansion_per_K of the lengths tell"
        )


def _fitted_as_drawn(arm: Arm, free: tuple[str, ...], readings: Session, lengths: Lengths | None) -> NominalModel:
    """The arm as drawn, put to the readings; refuse those that no arm of this drawing can have made."""
    from truearm.compensation.models import NominalModel
    from truearm.compensation.models.compensator import MAX_NOMINAL_ERROR

    as_drawn = NominalModel(arm, free=free).fit_readings(readings, lengths=lengths)
    mean = nominal_miss(as_drawn)
    if not mean < MAX_NOMINAL_ERROR * arm.chain.reach:
        raise readings.error(
            f"the arm {arm.name!r} as drawn misses its references by {mean:.4g} mm on average"
            f" at a reach of {arm.chain.reach:.4g} mm: the readings are not of this arm, or it is described wrongly",
            hint="check --arm, the units, signs and zeros of the angles, the unit of the points, and --free",
        )
    return as_drawn


def nominal_miss(fitted: Compensator) -> float:
    """Mean distance by which the arm as drawn misses the references it was put to [mm]."""
    import numpy as np

    residuals = [np.linalg.norm(reference.residuals, axis=0) for reference in fitted.nominal_.references]
    return float(np.concatenate(residuals).mean())


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


def _say_result(
    fitted: Compensator,
    readings: Session,
    table: tuple[ModelScore, ...],
    out: Path,
    *,
    lengths: Lengths | None,
    as_json: bool,
) -> None:
    from dataclasses import asdict

    from truearm.compensation.models import MODELS, KinematicModel, NetworkModel, NominalModel
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.compensation.models.reading_references import MIN_READINGS_ON, surfaces_with_too_few_readings
    from truearm.identification.estimation.identifiability import identifiability
    from truearm.identification.estimation.outliers import outliers
    from truearm.readings import compare_errors, seat_errors

    model = next(name for name, kind in MODELS.items() if type(fitted) is kind)
    errors = None
    predicted, nominal = fitted.predict_readings(readings), fitted.predict_nominal_readings(readings)
    if readings.points is not None:
        errors = compare_errors(predicted, nominal, readings.points)
    scatter = None
    if errors is None and readings.seat is not None:
        scatter = seat_errors(predicted, readings.seat)
    if as_json:
        told: dict[str, Any] = {"model": model, "file": str(out), "fit_seconds": fitted.fit_seconds_}
        told["training"] = errors or {k: v for k, v in (scatter or {}).items() if k != "seats"}
        if table:
            told["compared"] = [asdict(row) for row in table]
        if isinstance(fitted, NetworkModel):
            told["network"] = {"trainer": fitted.trainer, "members": [_facts(member) for member in fitted.members_]}
        if isinstance(fitted, IdentifiedModel):
            told["unexplained_std_mm"] = fitted.residual_std_
            told["groups"] = [asdict(group) for group in fitted.fit_.groups]
            told["left_out"] = [left_out._asdict() for left_out in fitted.excluded_terms_]
            told["identifiability"] = asdict(identifiability(fitted.fit_))
            told["outliers"] = [asdict(outlier) for outlier in outliers(fitted.fit_)]
            told["wrong_lengths"] = [asdict(wrong) for wrong in _wrong_lengths(fitted, readings, lengths)]
            told["too_few_on"] = [
                {"kind": k, "name": name, "readings": n} for k, name, n in surfaces_with_too_few_readings(readings)
            ]
        print_json(told)
        return
    if table:
        _say_table(table)
    print_line(
        f"{out}: {model} model of {fitted.arm.name} from {len(readings)} readings in {fitted.fit_seconds_:.1f} s"
    )
    if isinstance(fitted, NetworkModel):
        for number, member in enumerate(fitted.members_, 1):
            facts = _facts(member)
            who = f"member {number}, start {facts['start']}" if len(fitted.members_) > 1 else "training"
            print_line(
                f"{who}: {facts['stop'].rstrip('.')} after {facts['epochs']} epochs, the best {facts['best_epoch']}"
            )
    if errors is not None:
        print_line(_sentence(errors, compare=model != "nominal"))
    elif scatter is not None:
        said = f"mean {scatter['seat_mean_mm']:.4f} mm, maximum {scatter['seat_max_mm']:.4f} mm"
        print_line(f"training error, distance of points from the mean of their seat: {said}")
    if isinstance(fitted, IdentifiedModel):
        _say_identified(fitted, readings, lengths)
        few = surfaces_with_too_few_readings(readings)
        for kind, name, n in few[:MOST_NAMED]:
            print_line(
                f"left out: {kind} {name}, as {n} of its readings have no point and {MIN_READINGS_ON[kind]} find a {kind}"
            )
        if len(few) > MOST_NAMED:
            print_line(f"left out: {len(few) - MOST_NAMED} more (--json names all)")
    if fitted.session_frames_:
        first, *others = fitted.session_frames_
        print_line(
            f"A frame for each session: points are in that of {first}, those of {', '.join(others)} in their own."
        )
    if errors is None and lengths is None and readings.sphere_distance is None:
        print_line("No point and no length is known: the arm's size stays as drawn.")
    if not getattr(fitted, "fit_", fitted.nominal_).converged:
        print_line("The fit has not settled: more readings, or poses more different from one another, may help.")
    if not isinstance(fitted, NominalModel | NetworkModel) and len(readings) < FEW_READINGS:
        print_line(f"Only {len(readings)} readings: the training error says little. Some {FEW_READINGS} serve.")
    if isinstance(fitted, KinematicModel) or model == "physical":
        missed = nominal_miss(fitted)
        if missed > SUSPECT_NOMINAL_ERROR * fitted.arm.chain.reach:
            print_line(
                f"The arm as drawn misses the readings by {missed:.1f} mm on average: is --arm {fitted.arm.name} right?"
            )
    print_line("These are the readings it learned from: judge it on others, with truearm evaluate.")


def _say_table(table: tuple[ModelScore, ...]) -> None:
    rows = [
        [
            row.name,
            f"{row.mean_mm:.4f} +- {row.standard_error_mm:.4f}",
            f"{row.p95_mm:.4f}",
            f"{row.max_mm:.4f}",
            f"{row.n_effective:.0f}",
            "kept" if row.kept else "",
        ]
        for row in table
    ]
    print_table(["held out [mm]", "mean +- its error", "95 %", "max", "parameters", ""], rows)


def _wrong_lengths(fitted: IdentifiedModel, readings: Session, lengths: Lengths | None) -> list[LengthOutlier]:
    from truearm.compensation.models.reading_references import references_of
    from truearm.compensation.models.session_frames import to_first_session_frame
    from truearm.identification.estimation.outliers import length_outliers

    readings = to_first_session_frame(readings, fitted.session_frames_)
    return length_outliers(fitted.fit_, fitted.state(readings), references_of(readings, lengths))


def _say_identified(fitted: IdentifiedModel, readings: Session, lengths: Lengths | None) -> None:
    """What the model cannot explain, which groups of terms it has, and readings and lengths far off."""
    from truearm.identification.estimation.identifiability import identifiability
    from truearm.identification.estimation.outliers import outliers

    print_line(f"unexplained: {fitted.residual_std_:.4f} mm, standard deviation of a coordinate")
    if len(fitted.fit_.groups) > 5:
        found = [group for group in fitted.fit_.groups if group.effective >= 0.5]
        none = len(fitted.fit_.groups) - len(found)
        largest = sorted(found, key=lambda group: -group.effective)[:8]
        names = ", ".join(f"{group.name} ({group.effective:.0f})" for group in largest)
        print_line(
            f"terms with most determined coefficients: {names}; {none} of {len(fitted.fit_.groups)} groups not needed"
        )
    for left_out in fitted.excluded_terms_[:MOST_NAMED]:
        print_line(f"not offered: {left_out.name}, as {left_out.reason}")
    if len(fitted.excluded_terms_) > MOST_NAMED:
        print_line(f"not offered: {len(fitted.excluded_terms_) - MOST_NAMED} more (--json names all)")
    # What no readings tell is no fault of these.
    unidentifiable = [one for one in identifiability(fitted.fit_).unidentifiable if one.at_other_poses]
    if unidentifiable:
        more = f"; {len(unidentifiable) - 3} more (--json names all)" if len(unidentifiable) > 3 else ""
        print_line(f"not determined by these readings: {'; '.join(map(str, unidentifiable[:3]))}{more}")
    far = outliers(fitted.fit_)
    for outlier in far[:MOST_NAMED]:
        print_line(
            f"far off: {readings.label(outlier.row)}, {outlier.error_mm:.3f} mm, {outlier.normalized_residual:.0f} times the usual"
        )
    if len(far) > MOST_NAMED:
        print_line(f"far off: {len(far) - MOST_NAMED} more readings (--json names all)")
    wrong = _wrong_lengths(fitted, readings, lengths)
    for one in wrong[:MOST_NAMED]:
        print_line(
            f"far off: {one.name}, stated {abs(one.error_mm):.3f} mm too {'long' if one.error_mm > 0 else 'short'} "
            f"against all else, {one.normalized_residual:.0f} standard deviations"
        )
    if len(wrong) > MOST_NAMED:
        print_line(f"far off: {len(wrong) - MOST_NAMED} more lengths (--json names all)")


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


def _sentence(errors: ErrorComparison, *, compare: bool) -> str:
    said = f"training error: mean {errors['mean_mm']:.4f} mm, maximum {errors['max_mm']:.4f} mm"
    if not compare:
        return said
    removed = errors["removed_percent"]
    if removed < 0:
        return f"{said} ({1 - removed / 100:.1f} times the nominal error)"
    return f"{said} ({removed:.1f} % of the nominal coordinate error removed)"
