"""``truearm evaluate``: how far a model's points are from the reference, or from agreeing in their seats."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truearm.cli.console import Json, print_json, print_line, print_table, progress

if TYPE_CHECKING:
    from truearm.readings import Lengths, Session
    from truearm.typing import FloatArray


def evaluate(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file.")],
    session: Annotated[
        Path,
        typer.Argument(metavar="SESSION", help="Session file with reference points or seats the model has not seen."),
    ],
    lengths: Annotated[
        Path | None, typer.Option("--lengths", help="File of known lengths between the session's seats, .csv.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Test a model on readings it has not seen.

    Its errors are printed beside those of the nominal arm: the drawing, its base and tip (where they were free) fitted
    to the model's own training readings. Readings with a reference point are compared with it; readings in a seat with
    the mean of the points predicted there; the distance between two such means with the length that is known. Readings
    from which truearm refit took base and tip are left out.
    """
    from truearm.cli.fit import as_measured, lengths_of
    from truearm.cli.predict import check_reference, load_for, without_served
    from truearm.cli.report import remarks
    from truearm.compensation.models import NominalModel
    from truearm.readings import check_sessions, compare_errors, point_errors

    with progress(f"reading {session.name}"):
        fitted, readings = load_for(model, session)
        check_reference(readings, fitted, purpose="evaluate against", seats=True)
        whole = readings
        readings, n_served = without_served([fitted], whole)
        known = None if lengths is None else lengths_of(lengths, whole, readings)
        check_sessions(readings, known, own_frame="base" not in fitted.free)
        known = as_measured(known, readings)
    predicted = {"nominal": fitted.predict_nominal_readings(readings), "model": fitted.predict_readings(readings)}
    in_seats = {name: _in_seats(points, readings, known) for name, points in predicted.items()}
    errors = None
    if readings.points is not None:
        errors = compare_errors(predicted["model"], predicted["nominal"], readings.points)
    if as_json:
        left_out = {"n_left_out": n_served} if n_served else {}
        print_json({**(errors or {}), **in_seats["model"], **left_out})
        return
    if n_served:
        print_line(f"{n_served} readings served to refit the model and are left out")
    names = ["nominal"] if isinstance(fitted, NominalModel) else ["nominal", "model"]
    if readings.points is not None and errors is not None:
        of_points = {name: point_errors(predicted[name], readings.points) for name in names}
        _say_errors(f"{errors['n']} readings", {name: dict(found) for name, found in of_points.items()})
        if len(names) > 1:
            print_line(_compared(errors["removed_percent"]))
    in_seats = {name: in_seats[name] for name in names}
    if seats := in_seats["nominal"].get("seats"):
        _say_errors(f"{in_seats['nominal']['n_in_seats']} readings in {len(seats)} seats", in_seats)
    if known is not None:
        _say_lengths(known, in_seats)
    for remark in remarks(fitted, readings):
        print_line(remark)


def _in_seats(points: FloatArray, readings: Session, known: Lengths | None) -> dict[str, Any]:
    """Errors of predicted points in the session's seats, as far as it has seats with two readings, and of lengths."""
    import numpy as np

    from truearm.readings import length_errors, seat_errors

    found: dict[str, Any] = {}
    if readings.seat is None:
        return found
    several = np.unique(readings.seat[readings.seat != ""], return_counts=True)[1].max(initial=0) > 1
    if several or (readings.points is None and known is None):
        found |= seat_errors(points, readings.seat)
    if known is not None:
        errors = length_errors(points, readings.seat, known).tolist()
        rows = {name: getattr(known, name).tolist() for name in ("seat_a", "seat_b", "length_mm", "u_mm")}
        rows["length_error_mm"] = errors
        found["lengths"] = [dict(zip(rows, row, strict=True)) for row in zip(*rows.values(), strict=True)]
    return found


def _say_errors(head: str, columns: dict[str, dict[str, Any]]) -> None:
    first = next(iter(columns.values()))
    rows = [[name, *(f"{c[name]:.4f}" for c in columns.values())] for name in first if name.endswith("_mm")]
    print_table([head, *columns], rows)


def _say_lengths(known: Lengths, in_seats: dict[str, dict[str, Any]]) -> None:
    rows = [
        [f"{one['seat_a']} to {one['seat_b']}", f"{one['length_mm']:.4f}", f"{one['u_mm']:.4f}"]
        + [f"{found['lengths'][i]['length_error_mm']:+.4f}" for found in in_seats.values()]
        for i, one in enumerate(in_seats["nominal"]["lengths"])
    ]
    print_table([f"length_error_mm of {len(known)} lengths", "length_mm", "u_mm", *in_seats], rows)


def _compared(removed_percent: float) -> str:
    if -5 < removed_percent < 0:
        return "no better than the nominal arm"
    if removed_percent < 0:
        return f"worse than the nominal arm: {1 - removed_percent / 100:.1f} times its mean absolute coordinate error"
    return f"{removed_percent:.1f} % of the mean absolute coordinate error removed"
