"""What a fit and a prediction demand of readings, checked before anything is computed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from truearm.readings.lengths import ENDS, Lengths
from truearm.readings.session import TOUCHED, Session
from truearm.typing import BoolArray, FloatArray

# An angle may pass its limit by this much [rad or mm]: rounding, not a wrong angle.
LIMIT_TOLERANCE = 1e-6

# An angle beyond this [rad or mm] is no angle, whatever the arm allows: 160,000 turns, a kilometre of rail.
MOST_ANGLE = 1e6

# What a session is.
MOVED = "between which the base or the reference moved"

# Temperatures at which nobody measures with an arm [degC]: such numbers are kelvin, Fahrenheit or misprints.
ABSOLUTE_ZERO_DEGC, COLDEST_DEGC, WARMEST_DEGC = -273.15, -50.0, 100.0

# Two points of an arm are at most two reaches apart; an unknown tip may add to that.
MOST_REACHES = 4.0


def check_fit(
    readings: Session,
    *,
    joint_names: Sequence[str],
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    min_rows: int,
    prismatic: npt.ArrayLike | None = None,
    relations: bool = False,
) -> None:
    """Check that a model of an arm can be fitted to readings.

    Parameters
    ----------
    readings : Session
        Angles and reference points, or other references.
    joint_names : sequence of str
        The arm's joints, base to tip.
    lower, upper : (n_joints,) array
        Joint limits [rad, or mm for sliding joints]; infinite where there is none.
    min_rows : int
        The fewest readings with a reference that the model can be fitted to.
    prismatic : (n_joints,) bool array, optional
        Which joints slide; none by default. Only messages need it.
    relations : bool
        Whether the model learns from seats, spheres, planes, lines and orientations too; by default it needs a
        reference point at every reading.

    Raises
    ------
    InputError
        If the number of joints is wrong, references are missing, there are too few readings, a joint, the whole arm or
        the reference never moves, an angle is outside its limits, or a reading stands twice.
    """
    _check_joints(readings, joint_names)
    known = has_reference(readings) if relations else readings.has_point
    if not known.any():
        raise readings.error(
            "the readings have no reference points, and a fit needs them"
            if not relations
            else "the readings have no reference at all (points, seats, spheres, planes, lines, orientations)",
            hint="add columns x_mm, y_mm, z_mm with the tip as a reference instrument saw it"
            + (", or a column seat with the names of seats" if relations else ""),
        )
    if not (known.all() or relations):
        row = int(np.argmin(known))
        raise readings.error(
            f"{int((~known).sum())} of {len(readings)} readings have no reference point, the first of them"
            f" {readings.label(row)}, and this model learns from points alone",
            row,
            hint="leave these readings out, or take a model that learns from seats",
        )
    if (n := int(known.sum())) < min_rows:
        raise readings.error(
            f"expected at least {min_rows} readings, got {n}",
            hint="measure more poses, spread over all joints",
        )
    _check_limits(readings, joint_names, lower, upper, prismatic)
    _check_motion(readings, joint_names)
    _check_reference(readings)
    _check_copies(readings)


def has_reference(readings: Session) -> BoolArray:
    """(n,) Whether something is known of the tip at each reading: a point, an orientation, a seat or a surface."""
    known = readings.has_point
    if readings.quaternion is not None:
        known |= ~np.isnan(readings.quaternion[:, 0])
    for name in TOUCHED:
        if (names := getattr(readings, name)) is not None:
            known |= names != ""
    return known


def check_angles(
    readings: Session,
    *,
    joint_names: Sequence[str],
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    prismatic: npt.ArrayLike | None = None,
) -> None:
    """Check that an arm can take the angles of readings: the number of joints and their limits.

    Parameters are those of `check_fit`.

    Raises
    ------
    InputError
        If the number of joints is wrong or an angle is outside its limits.
    """
    _check_joints(readings, joint_names)
    _check_limits(readings, joint_names, lower, upper, prismatic)


def check_reach(readings: Session, *, reach: float) -> None:
    """Check that one arm can have been at all reference points, wherever it stands.

    Parameters
    ----------
    readings : Session
        With reference points, or without: then there is nothing to check.
    reach : float
        Of the arm [mm].

    Raises
    ------
    InputError
        If a point lies farther from the middle of all of its session than `MOST_REACHES` reaches.
    """
    if readings.points is None:
        return
    off = np.zeros(len(readings))
    session = np.full(len(readings), "") if readings.session is None else readings.session
    for name in np.unique(session[readings.has_point]):
        rows = (session == name) & readings.has_point
        off[rows] = np.abs(readings.points[rows] - np.median(readings.points[rows], axis=0)).max(axis=1)
    far = off > MOST_REACHES * reach
    if not far.any():
        return
    row = int(np.argmax(far))
    where = f" of {readings.label(row)}" if readings.first_line is None else ""
    raise readings.error(
        f"the reference point{where} lies {off[row]:.4g} mm from the middle of all, farther than an arm with a reach of"
        f" {reach:.4g} mm can be ({int(far.sum())} of {int(readings.has_point.sum())} readings)",
        row,
        hint="check the unit of the points, or delete the reading",
    )


def check_temperatures(readings: Session) -> None:
    """Check that temperatures are those of an arm in degrees Celsius.

    Raises
    ------
    InputError
        If one is below absolute zero, or outside `COLDEST_DEGC` to `WARMEST_DEGC`.
    """
    degC = readings.temperature_degC
    if degC is None or not (wrong := ~((degC >= COLDEST_DEGC) & (degC <= WARMEST_DEGC))).any():
        return
    row = int(np.argmax(wrong))
    where = f" in {readings.label(row)}" if readings.first_line is None else ""
    raise readings.error(
        f"expected a temperature from {COLDEST_DEGC:g} to {WARMEST_DEGC:g} degC, got {degC[row]:.6g} degC{where}"
        + (", below absolute zero" if degC[row] < ABSOLUTE_ZERO_DEGC else "")
        + f" ({int(wrong.sum())} of {len(readings)} readings)",
        row,
        column="temperature_degC",
        hint="degrees Celsius: subtract 273.15 from kelvin; (F - 32) / 1.8 of degrees Fahrenheit",
    )


def check_sessions(readings: Session, lengths: Lengths | None = None, *, own_frame: bool = False) -> None:
    """Check that nothing is said to be one place in two sessions, between which the base or the reference moved.

    Parameters
    ----------
    readings : Session
    lengths : Lengths, optional
        Known lengths between seats of the readings.
    own_frame : bool
        Whether reference points, if there are any, are in the arm's own frame: then the base stood in all sessions
        where they say.

    Raises
    ------
    InputError
        If a seat or a surface has readings in two sessions, or a length is between seats of two.
    """
    if readings.session is None or (own_frame and readings.has_point.any()):
        return
    session_of = {kind: _session_of(readings, kind) for kind in TOUCHED}["seat"]
    if lengths is None:
        return
    for row, ends in enumerate(zip(*(getattr(lengths, end).tolist() for end in ENDS), strict=True)):
        sessions = [session_of[end] for end in ends if end in session_of]
        if len(set(sessions)) > 1:
            a, b = (f"seat {end!r} is in {_set_up(session)}" for end, session in zip(ends, sessions, strict=True))
            raise lengths.error(
                f"{a}, {b}, {MOVED}",
                row,
                column=ENDS[1],
                hint="lengths between seats of one session; one name of the session if nothing moved",
            )


def _session_of(readings: Session, kind: str) -> dict[str, str]:
    """The session of every seat or surface, which is one."""
    names, sessions = getattr(readings, kind), readings.session
    found: dict[str, str] = {}
    if names is None or sessions is None:
        return found
    for row in np.flatnonzero(names != "").tolist():
        name, session = str(names[row]), str(sessions[row])
        if found.setdefault(name, session) != session:
            where = f", in {readings.label(row)}," if readings.first_line is None else ""
            raise readings.error(
                f"{kind} {name!r} is in {_set_up(found[name])} and{where} in {_set_up(session)}, {MOVED}",
                row,
                column=kind,
                hint=f"another name for the {kind} in each session; one name of the session if nothing moved",
            )
    return found


def _set_up(session: str) -> str:
    return f"session {session!r}" if session else "a reading that names no session"


def _check_joints(readings: Session, joint_names: Sequence[str]) -> None:
    if readings.n_joints != len(joint_names):
        raise readings.error(
            f"expected {len(joint_names)} joints ({', '.join(joint_names)}), got {readings.n_joints}",
            hint="check that the readings belong to this arm",
        )


def _check_limits(
    readings: Session,
    joint_names: Sequence[str],
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    prismatic: npt.ArrayLike | None,
) -> None:
    low, high = np.maximum(lower, -MOST_ANGLE), np.minimum(upper, MOST_ANGLE)
    slides = np.zeros(readings.n_joints, bool) if prismatic is None else np.asarray(prismatic, dtype=bool)
    outside = (readings.angles < low - LIMIT_TOLERANCE) | (readings.angles > high + LIMIT_TOLERANCE)
    if not outside.any():
        return
    row, joint = (int(i) for i in np.argwhere(outside)[0])
    unit, factor = ("mm", 1.0) if slides[joint] else ("deg", 180 / np.pi)
    value, least, most = (f"{factor * v:.6g}" for v in (readings.angles[row, joint], low[joint], high[joint]))
    count = int(outside.any(axis=1).sum())
    where = f" in {readings.label(row)}" if readings.first_line is None else ""
    raise readings.error(
        f"{joint_names[joint]} is at {value} {unit}{where}, outside its limits {least} .. {most} {unit}"
        f" ({count} of {len(readings)} readings are outside the limits of a joint)",
        row,
        column=_column(readings, joint),
        hint="check the unit, sign and zero of the angles, or the limits in the arm file",
    )


def _check_motion(readings: Session, joint_names: Sequence[str]) -> None:
    still = np.ptp(readings.angles, axis=0) == 0 if len(readings) > 1 else np.zeros(readings.n_joints, bool)
    if still.all() and len(readings) > 1:
        raise readings.error(
            f"all {len(readings)} readings have the same angles, so the arm cannot be identified",
            hint="measure poses spread over all joints",
        )
    if still.any():
        joint = int(np.argmax(still))
        raise readings.error(
            f"{joint_names[joint]} never moves in the {len(readings)} readings, so its errors cannot be identified",
            column=_column(readings, joint),
            hint='move it; if the joint is locked by design, describe it as type = "fixed" in the arm file'
            " and leave its column out",
        )


def _check_reference(readings: Session) -> None:
    if readings.points is None or len(readings) < 2:
        return
    if (np.ptp(readings.points, axis=0) == 0).all():  # never so where a point is missing
        raise readings.error(
            f"all {len(readings)} readings have the same reference point, though the joints move",
            hint="check the columns of the reference; readings of one seat need another seat beside it",
        )


def _check_copies(readings: Session) -> None:
    """Refuse the same angles with the same reference: no arm and no tracker repeats to the last digit."""
    import pandas as pd

    parts: list[FloatArray] = [readings.angles]
    for values in (readings.points, readings.quaternion):
        if values is not None:  # what is missing equals what is missing
            parts += [np.nan_to_num(values), np.isnan(values[:, :1]).astype(float)]
    for name in TOUCHED:
        if (names := getattr(readings, name)) is not None:
            parts.append(np.unique(names, return_inverse=True)[1].astype(float)[:, None])
    table: FloatArray = np.hstack(parts)
    copies = pd.DataFrame(table).duplicated().to_numpy()
    if not copies.any():
        return
    second = int(np.argmax(copies))
    first = int(np.argmax((table == table[second]).all(axis=1)))
    count = int(copies.sum())
    more = f"; {count} readings are such copies" if count > 1 else ""
    raise readings.error(
        f"{readings.label(first)} and {readings.label(second)} are the same reading to the last digit"
        f" (angles and reference){more}",
        second,
        hint="delete the copies: they would count twice, and be in training and test at once",
    )


def _column(readings: Session, joint: int) -> str | None:
    return None if readings.angle_columns is None else readings.angle_columns[joint]
