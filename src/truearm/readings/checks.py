"""What a fit and a prediction require of a session, checked before anything is computed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.acceptance import contradict
from truearm.errors import InputError
from truearm.readings.anchors import LEAST_COMPARED, distance_errors, has_located_anchor
from truearm.readings.columns import ANGLE
from truearm.readings.lengths import ENDS, Lengths
from truearm.readings.readings import TOUCHED, Measurements
from truearm.readings.session import Session
from truearm.readings.thermal_expansion import ThermalExpansion
from truearm.typing import BoolArray, FloatArray

# Readings beyond the joint limits are skipped one by one up to this share; of more, angles or arm are wrong.
MAX_SKIPPED_SHARE = 0.5

BETWEEN_SESSIONS = "but the base or the reference moved between sessions"

# Two points of an arm are at most two reaches apart; an unknown tip may add to that.
MAX_REACHES = 4.0
# Factor by which reference points may spread more or less than the nominal tips. A tool that the arm file lacks changes
# the spread by less, another unit (cm, inch, m, um) by more.
MAX_SCALE = 8.0
# Units of length that points may be in by mistake [mm].
UNITS_MM = {"m": 1e3, "cm": 10.0, "inch": 25.4, "um": 1e-3}
# Poses in a row with one and the same angle of a joint, at least, and between which other joints move [rad, mm].
LEAST_FROZEN, MOVES, MOVES_MM = 6, np.radians(1.0), 5.0
# Share of poses that counts as most.
MOST_OF_ROWS = 0.8
# Times by which nominal tips miss distances less in their unit: of printed arms, whose drawings are the worst, 5 to 50.
LESS_MISSED = 4.0


@dataclass(frozen=True)
class LimitExcess:
    """A reading beyond the limits of a joint (the first such joint).

    Attributes
    ----------
    row : int
        Its row in the session, counted from 0.
    reading : str
        Its name, as ``line 14``.
    joint : str
        As ``J2``.
    value, lower, upper : float
        Angle and limits [`unit`].
    unit : {"deg", "mm"}
    """

    row: int
    reading: str
    joint: str
    value: float
    lower: float
    upper: float
    unit: str

    def __str__(self) -> str:
        return (
            f"{self.reading}: {self.joint} is at {self.value:.6g} {self.unit}, outside its limits "
            f"{self.lower:.6g} .. {self.upper:.6g} {self.unit}"
        )


def check_fit(session: Session, *, n_joints: int, min_rows: int, relations: bool = False) -> None:
    """Check that a model of an arm can be fitted to a session.

    Parameters
    ----------
    session : Session
        Angles and reference points, or other references.
    n_joints : int
        Number of joints of the arm.
    min_rows : int
        Smallest number of readings with a reference to which the model can be fitted.
    relations : bool
        Whether the model learns from seats, distances, spheres, planes, lines and orientations too; by default it needs
        a reference point at every reading.

    Raises
    ------
    InputError
        If the number of joints is wrong, references are missing, there are too few readings, the arm or the reference
        never moves.
    """
    check_angles(session, n_joints=n_joints)
    known = has_reference(session) if relations else session.has_point
    if not known.any():
        raise session.error(
            "the readings have no reference points, and a fit needs them"
            if not relations
            else "the readings have no reference at all (points, seats, distances, spheres, planes, lines, "
            "orientations)",
            hint="add columns x_mm, y_mm, z_mm with the tip as measured by a reference instrument"
            + (", or a column seat with the names of seats" if relations else ""),
        )
    if not (known.all() or relations):
        raise session.error(
            f"{int((~known).sum())} of {len(session)} readings have no reference point (this is the first of them), and"
            " this model learns from points alone",
            int(np.argmin(known)),
            hint="delete these readings, or choose a model that learns from seats",
        )
    if (n := int(known.sum())) < min_rows:
        raise session.error(
            f"expected at least {min_rows} readings, got {n}",
            hint="measure more poses, spread over all joints: base and tip alone take 4, some 10 show more of the arm",
        )
    _check_motion(session)
    _check_reference(session)


def check_session_fits(
    session: Session, model: str, *, n_joints: int, min_rows: int, reach: float | None, sliding: BoolArray
) -> None:
    """Check that a model of a kind can be fitted to the readings; `reach` is None where it is not known.

    Raises
    ------
    InputError
        As `check_fit` and `check_reach`; or if the readings have fewer residuals than the model needs: a distance has
        one, any other reference three.
    """
    check_fit(session, n_joints=n_joints, min_rows=min_rows, relations=model != "network")
    n_distances, n_anchors = 0, 0
    if session.distance_mm is not None and session.anchor is not None:
        there = ~np.isnan(session.distance_mm)
        n_distances, n_anchors = int(there.sum()), len(np.unique(session.anchor[there]))
    n_further = 0 if session.tip is None else len(np.unique(session.tip)) - 1
    of_unknowns = 4 * n_anchors + 3 * n_further
    others = has_reference(session, [name for name in TOUCHED if name != "anchor"])
    n_residuals = n_distances + 3 * int(others.sum())
    if model != "nominal" and of_unknowns and n_residuals < (least := 3 * min_rows + of_unknowns):
        raise session.error(
            f"{n_residuals} residuals (3 of a point, 1 of a distance) do not determine base and tip, {n_anchors} "
            f"anchors and {n_further} further tips: that takes {least}",
            hint="measure more poses, spread over all joints",
        )
    if reach is not None:
        check_reach(session, reach=reach, sliding=sliding)


def has_reference(session: Session, kinds: Sequence[str] = TOUCHED) -> BoolArray:
    """(n,) Whether each reading has a reference: a point, an orientation, or what it touched of these kinds."""
    known = session.has_point
    if session.quaternion is not None:
        known |= ~np.isnan(session.quaternion[:, 0])
    for name in kinds:
        if (names := getattr(session, name)) is not None:
            known |= names != ""
    return known


def serial_number_of(session: Session) -> str:
    """The serial number of the arm that was read; empty if none is stated.

    Raises
    ------
    InputError
        If the readings are of several arms; where that is accepted, the first number is theirs.
    """
    if session.serial_number is None:
        return ""
    stated = session.serial_number != ""
    if not stated.any():
        return ""
    first = str(session.serial_number[np.argmax(stated)])
    if (others := stated & (session.serial_number != first)).any():
        row = int(np.argmax(others))
        session.contradict(
            f"expected readings of one arm, got serial numbers {first!r} and {str(session.serial_number[row])!r}",
            row,
            column="serial_number",
            hint="one session file for each arm",
        )
    return first


def serial_number_of_all(stated: Collection[str], file: Path) -> str:
    """The serial number of the arm that all parts of a session were read from; empty if none states it.

    Raises
    ------
    InputError
        As `serial_number_of`.
    """
    first, *others = sorted(stated) or [""]
    if others:
        contradict(
            InputError(
                f"expected readings of one arm, got serial numbers {first!r} and {others[0]!r}",
                file=file,
                hint="one folder for each arm",
            )
        )
    return first


def check_angles(session: Session, *, n_joints: int, prismatic: npt.ArrayLike | None = None) -> None:
    """Check that a session has the arm's number of joints, and numbers that can be angles.

    Parameters
    ----------
    session : Session
    n_joints : int
    prismatic : (n_joints,) bool array, optional
        Which joints slide: the unit in a column's name must fit. Not checked by default.

    Raises
    ------
    InputError
        If the number of joints is wrong, the unit of a joint is not one of its kind, or an angle is beyond
        `Session.largest_angle`.
    """
    if session.n_joints != n_joints:
        raise session.error(
            f"expected {n_joints} joints (J1 .. J{n_joints}), got {session.n_joints}",
            hint="check that the readings belong to this arm",
        )
    if prismatic is not None:
        _check_units(session, np.asarray(prismatic, dtype=bool))
    if (absurd := np.abs(session.angles) > Session.largest_angle).any():
        row, joint = (int(i) for i in np.argwhere(absurd)[0])
        raise session.error(
            f"J{joint + 1} is at {session.angles[row, joint]:.6g} rad or mm, which no joint reaches",
            row,
            column=_column(session, joint),
            hint="check the unit of the angles",
        )


def _check_units(session: Session, prismatic: BoolArray) -> None:
    """Refuse a joint that turns in mm, and one that slides in deg or rad."""
    for column, slides in zip(session.angle_columns or (), prismatic.tolist(), strict=False):
        match = ANGLE.fullmatch(column)
        if match is not None and (match[2] == "mm") != slides:
            kind, units = ("slides", "mm") if slides else ("turns", "deg or rad")
            raise session.error(
                f"this joint {kind}: expected {units}, got {match[2]}",
                column=column,
                hint="check the arm, the order of the joints and the unit in the name of the column",
            )


def check_temperature(session: Session) -> None:
    """Check that readings are not as warm as no room is: their temperatures are on another scale.

    Raises
    ------
    InputError
        If one is `ThermalExpansion.warmest_degC` or more.
    """
    degC = session.temperature_degC
    if degC is None or not (warm := degC >= ThermalExpansion.warmest_degC).any():
        return
    row = int(np.argmax(warm))
    session.contradict(
        f"expected temperatures below {ThermalExpansion.warmest_degC:g} degC, got {degC[row]:g} degC "
        f"({int(warm.sum())} of {len(degC)} readings)",
        row,
        column="temperature_degC",
        hint=f"{degC[row]:g} degrees Fahrenheit are {(degC[row] - 32) / 1.8:.1f} degC: state degC",
    )


def frozen_joints(session: Session, slides: BoolArray) -> tuple[str, ...]:
    """Name joints whose angle is the same to the last digit in row after row, while the others move: a frozen encoder.

    Elsewhere the joint must take a new value in nearly every pose: programs that move some joints alone, or to the few
    values of a grid, keep the others still on purpose.
    """
    rows = np.flatnonzero(np.concatenate([[True], (np.diff(session.angles, axis=0) != 0).any(axis=1)]))
    angles, found = session.angles[rows], []
    moves = np.abs(np.diff(angles, axis=0)) > np.where(slides, MOVES_MM, MOVES)
    for joint, values in enumerate(angles.T):
        ends = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(rows)]])
        others = np.delete(moves, joint, axis=1).sum(axis=1) >= min(2, moves.shape[1] - 1)
        runs = [
            slice(start, stop)
            for start, stop in pairwise(ends)
            if stop - start >= LEAST_FROZEN and others[start : stop - 1].mean() > MOST_OF_ROWS
        ]
        outside = np.ones(len(rows), dtype=bool)
        for run in runs:
            outside[run] = False
        n = int(outside.sum())
        if not runs or 2 * n < len(rows) or len(np.unique(values[outside])) < MOST_OF_ROWS * n:
            continue
        for run in runs:
            at = f"{values[run.start]:.6g} mm" if slides[joint] else f"{np.degrees(values[run.start]):.6g} deg"
            first, last = (session.called(int(rows[row])) for row in (run.start, run.stop - 1))
            found.append(
                f"J{joint + 1} is {at} in all readings from {first} to {last}, to the last digit, while other joints "
                "move: its encoder or the record of it froze. Delete these readings, or measure them again."
            )
    return tuple(found)


def limit_excesses(
    session: Session, limits: npt.ArrayLike, *, prismatic: npt.ArrayLike | None = None
) -> tuple[LimitExcess, ...]:
    """List the readings beyond the limits of a joint.

    Parameters
    ----------
    session : Session
    limits : (n_joints, 2) array
        Lower and upper limit of each joint [rad, or mm for sliding joints]; infinite if there is none.
    prismatic : (n_joints,) bool array, optional
        Which joints slide; none by default. It decides the unit that is shown.
    """
    lower, upper = np.asarray(limits, dtype=float).T
    outside = (session.angles < lower - Session.limit_tolerance) | (session.angles > upper + Session.limit_tolerance)
    if not outside.any():
        return ()
    slides = np.zeros(session.n_joints, bool) if prismatic is None else np.asarray(prismatic, dtype=bool)
    found = []
    for row in np.flatnonzero(outside.any(axis=1)).tolist():
        joint = int(np.argmax(outside[row]))
        unit, factor = ("mm", 1.0) if slides[joint] else ("deg", 180 / np.pi)
        value, low, high = (float(factor * v) for v in (session.angles[row, joint], lower[joint], upper[joint]))
        found.append(LimitExcess(row, session.called(row), f"J{joint + 1}", value, low, high, unit))
    return tuple(found)


def skip_not_of_arm(
    session: Session, limits: npt.ArrayLike, *, n_joints: int, prismatic: BoolArray, most: float = MAX_SKIPPED_SHARE
) -> tuple[Session, tuple[LimitExcess, ...]]:
    """`skip_beyond_limits` of readings with the number of joints and the units of an arm, at temperatures of a room.

    Raises
    ------
    InputError
        As that, `check_angles` and `check_temperature`.
    """
    check_angles(session, n_joints=n_joints, prismatic=prismatic)
    check_temperature(session)
    return skip_beyond_limits(session, limits, prismatic=prismatic, most=most)


def skip_beyond_limits(
    session: Session, limits: npt.ArrayLike, *, prismatic: npt.ArrayLike | None = None, most: float = MAX_SKIPPED_SHARE
) -> tuple[Session, tuple[LimitExcess, ...]]:
    """Skip the readings beyond the limits of a joint.

    Parameters are those of `limit_excesses`, and the share `most` of the readings that may be skipped.

    Returns
    -------
    kept : Session
    skipped : tuple of LimitExcess

    Raises
    ------
    InputError
        If more than that, half by default, are beyond the limits: the unit, the zeros or the arm are wrong. Where that
        is accepted, none is skipped.
    """
    skipped = limit_excesses(session, limits, prismatic=prismatic)
    if not skipped:
        return session, ()
    first = skipped[0]
    if len(skipped) > most * len(session):
        session.contradict(
            f"{first.joint} is at {first.value:.6g} {first.unit}, outside its limits {first.lower:.6g} .. "
            f"{first.upper:.6g} {first.unit} ({len(skipped)} of {len(session)} readings are outside the limits of a "
            "joint)",
            first.row,
            column=_column(session, int(first.joint[1:]) - 1),
            hint="check the unit, sign and zero of the angles, or the limits in the arm file",
        )
        return session, ()
    kept = np.ones(len(session), bool)
    kept[[excess.row for excess in skipped]] = False
    return session.rows(kept), skipped


def check_reach(session: Session, *, reach: float, sliding: BoolArray | None = None) -> None:
    """Check that one arm can have reached all reference points, wherever its base is.

    Parameters
    ----------
    session : Session
        Without reference points there is nothing to check.
    reach : float
        Of the arm, with sliding joints at zero [mm].
    sliding : (n_joints,) bool array, optional
        Which joints slide: the arm reaches farther by their travel.

    Raises
    ------
    InputError
        If a point lies farther from the median of its session than `MAX_REACHES` reaches and the travel.
    """
    if session.points is None:
        return
    off = np.zeros(len(session))
    names = np.full(len(session), "") if session.session is None else session.session
    for name in np.unique(names[session.has_point]):
        rows = (names == name) & session.has_point
        off[rows] = np.abs(session.points[rows] - np.median(session.points[rows], axis=0)).max(axis=1)
    travel = 0.0
    if sliding is not None and len(sliding) == session.n_joints:
        travel = float(np.ptp(session.angles[:, sliding], axis=0).sum())
    far = off > MAX_REACHES * reach + travel
    if not far.any():
        return
    row = int(np.argmax(far))
    session.contradict(
        f"the reference point lies {off[row]:.4g} mm from the median of all, beyond an arm with a reach of"
        f" {reach:.4g} mm ({int(far.sum())} of {int(session.has_point.sum())} readings)",
        row,
        hint="check the unit of the points, or delete the reading",
    )


def check_scale(session: Measurements, tips: FloatArray) -> None:
    """Check that reference points are in the unit of the arm: they spread about as far as the nominal tips.

    Parameters
    ----------
    session : Session
        Without three reference points, or with all tips of a set-up within a millimetre, there is nothing to check.
    tips : (n, 3) array
        Tips of the nominal arm at the readings [mm].

    Raises
    ------
    InputError
        If the points spread `MAX_SCALE` times more or less than the tips, with the unit that would explain it.
    """
    spread, nominal = _spreads(session, tips)
    if nominal < 1 or spread == 0 or 1 / MAX_SCALE < spread / nominal < MAX_SCALE:  # repeats of one pose say nothing
        return
    session.contradict(
        f"the reference points spread over {spread:.3g} mm, the nominal tips of these readings over {nominal:.4g} mm",
        hint=remedy_of_unit(session, tips) or "check the unit of points and angles",
    )


def remedy_of_unit(session: Measurements, tips: FloatArray) -> str:
    """What to do where points or distances are likely in another unit than mm, by nominal tips (n, 3) [mm]; or ""."""
    if (unit := _likely_unit(session, tips)) is not None:
        option = "in" if unit == "inch" else unit
        return f"the points may be in {unit}: convert them to mm, or state it (truearm import --point-unit {option})"
    unit = _likely_unit_of_distances(session, tips)
    return "" if unit is None else f"the distances to anchors may be in {unit}: convert them to mm"


def _likely_unit(session: Measurements, tips: FloatArray) -> str | None:
    """The unit other than mm in which reference points would spread about as far as nominal tips (n, 3) [mm].

    None without three points, or if no unit explains the spread.
    """
    spread, nominal = _spreads(session, tips)
    if not (spread > 0 and nominal > 0):
        return None
    off = {unit: abs(np.log(factor * spread / nominal)) for unit, factor in UNITS_MM.items()}
    unit = min(off, key=off.__getitem__)
    return unit if off[unit] < min(np.log(2), abs(np.log(spread / nominal))) else None


def _likely_unit_of_distances(session: Measurements, tips: FloatArray) -> str | None:
    """The unit in which nominal tips (n, 3) [mm] miss distances `LESS_MISSED` times less than in mm, if any."""
    if not has_located_anchor(session, LEAST_COMPARED):
        return None
    units = {"mm": 1.0} | UNITS_MM
    missed = {unit: f * distance_errors(tips / f, session)["distance_rms_mm"] for unit, f in units.items()}
    unit = min(missed, key=missed.__getitem__)
    return unit if LESS_MISSED * missed[unit] < missed["mm"] else None


def _spreads(session: Measurements, tips: FloatArray) -> tuple[float, float]:
    """How far reference points and nominal tips (n, 3) spread about their means in every set-up [mm].

    0 and 0 without three points.
    """
    seen = session.has_point
    if session.points is None or seen.sum() < 3:
        return 0.0, 0.0
    placed = np.zeros(int(seen.sum()), int)
    if session.session is not None:
        placed = np.unique(session.session[seen], return_inverse=True)[1]
    counts = np.bincount(placed)[:, None]

    def spread(points: FloatArray) -> float:
        means = np.stack([np.bincount(placed, axis) for axis in points.T], axis=1) / counts
        return float(np.sqrt(((points - means[placed]) ** 2).sum() / len(points)))

    return spread(session.points[seen]), spread(tips[seen])


def check_sessions(session: Session, lengths: Lengths | None = None, *, own_frame: bool = False) -> None:
    """Check that no seat, surface or length extends over two sessions: the base or the reference moved between them.

    Parameters
    ----------
    session : Session
    lengths : Lengths, optional
        Known lengths between seats of the readings.
    own_frame : bool
        Whether reference points, if there are any, are in the arm's own frame: they then state where the base was in
        every session.

    Raises
    ------
    InputError
        If a seat or a surface has readings in two sessions, or a length is between seats of two.
    """
    if session.session is None or (own_frame and session.has_point.any()):
        return
    session_of = {kind: _session_of(session, kind) for kind in TOUCHED}["seat"]
    if lengths is None:
        return
    for row, ends in enumerate(zip(*(getattr(lengths, end).tolist() for end in ENDS), strict=True)):
        sessions = [session_of[end] for end in ends if end in session_of]
        if len(set(sessions)) > 1:
            a, b = (f"seat {end!r} is in {_set_up(name)}" for end, name in zip(ends, sessions, strict=True))
            raise lengths.error(
                f"{a}, {b}, {BETWEEN_SESSIONS}",
                row,
                column=ENDS[1],
                hint="state lengths between seats of one session; use one session name if nothing moved",
            )


def _session_of(session: Session, kind: str) -> dict[str, str]:
    """Return the one session of every seat or surface."""
    names, sessions = getattr(session, kind), session.session
    found: dict[str, str] = {}
    if names is None or sessions is None:
        return found
    for row in np.flatnonzero(names != "").tolist():
        name, where = str(names[row]), str(sessions[row])
        if found.setdefault(name, where) != where:
            raise session.error(
                f"{kind} {name!r} is in {_set_up(found[name])} and in {_set_up(where)}, {BETWEEN_SESSIONS}",
                row,
                column=kind,
                hint=f"name the {kind} differently in each session; use one session name if nothing moved",
            )
    return found


def _set_up(name: str) -> str:
    return f"session {name!r}" if name else "a reading that names no session"


def _check_motion(session: Session) -> None:
    if len(session) > 1 and not np.ptp(session.angles, axis=0).any():
        raise session.error(
            f"all {len(session)} readings have the same angles, so the arm cannot be identified",
            hint="measure poses spread over all joints",
        )


def _check_reference(session: Session) -> None:
    if session.points is None or len(session) < 2:
        return
    if (np.ptp(session.points, axis=0) == 0).all():  # never so where a point is missing
        raise session.error(
            f"all {len(session)} readings have the same reference point, though the joints move",
            hint="check the columns of the reference; readings in one seat need a second seat",
        )


def _column(session: Session, joint: int) -> str | None:
    return None if session.angle_columns is None else session.angle_columns[joint]
