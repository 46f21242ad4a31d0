"""Carry out a plan with a virtual arm: seats, bars and spheres stand where the plan puts them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from truearm.arm import Chain
from truearm.errors import InputError
from truearm.readings import Lengths, Session, read_lengths
from truearm.typing import FloatArray, NameArray
from truearm.wings.planning.designs.planned_readings import PlannedReadings
from truearm.wings.planning.designs.template import lengths_path
from truearm.wings.planning.virtual.arm import Measurement, VirtualArm
from truearm.wings.planning.virtual.state import random_stream

# A plan whose aims in one seat are farther apart is of another arm [mm]: angles are rounded to 0.1 deg.
FARTHEST_MM = 25.0
# Aims of a plan and length of the bar agree to this share, or the file of lengths is of another plan.
SAME_SHARE = 0.05
# Spread of the places of a reference instrument in a new set-up [mm]; its azimuth is arbitrary.
SHIFT_MM = 300.0
# Steps until all lengths are met, what counts as met [mm], and the smallest share of a singular value.
_STEPS, _EXACT_MM, _RANK = 30, 1e-10, 1e-6
# Standard uncertainties that lengths may contradict each other by.
_WITHIN = 5.0


def carry_out(
    virtual: VirtualArm, planned: PlannedReadings, *, seed: int, lengths: Lengths | None = None
) -> Measurement:
    """Measure the readings of a plan with a virtual arm.

    Each seat is where the aims of its readings have the nominal tip, on average, and each sphere where theirs are
    best on a sphere. Seats are moved as little as possible until all lengths between them are the true ones: the
    certificate's, with an error within its standard uncertainty that is the same at all places of one artefact. The
    artefacts do not expand. Without seats and spheres a reference instrument measures the tip.

    Parameters
    ----------
    virtual : VirtualArm
        The error of a certificate follows from the seed of the arm: the same bar each time.
    planned : PlannedReadings
    seed : int
        Of everything random in this session.
    lengths : Lengths, optional
        Known lengths between seats of the plan.

    Raises
    ------
    InputError
        If the aims in one seat or at the ends of a length do not fit together: the plan is of another arm.
    """
    if planned.seat is None and planned.sphere is None:
        return virtual.measure(planned.angles, seed=seed)
    places = touched_points(virtual.nominal.chain, planned, _true_lengths(lengths, seed=virtual.seed))
    measured = virtual.measure(planned.angles, seed=seed, seat=planned.seat, seat_points=places, reference=False)
    return replace(measured, readings=replace(measured.readings, sphere=planned.sphere, position=planned.position))


def lengths_of(planned: PlannedReadings, given: str | Path | None) -> Lengths | None:
    """The lengths between the seats of a plan, as certificates of virtual artefacts that do not expand.

    Parameters
    ----------
    planned : PlannedReadings
    given : path or None
        Their file; by default the one beside the plan, if there is one.

    Raises
    ------
    InputError
        If a bar has no length, or the plan has no seats.
    """
    beside = lengths_path(planned.file)
    file = given if given is not None else beside if beside.is_file() else None
    if file is None:
        if planned.position is not None and (planned.position != "").any():
            raise InputError(
                f"{beside.name} is missing beside the plan: a bar without its length",
                file=planned.file,
                hint="copy it there; truearm plan wrote it with the plan",
            )
        return None
    if planned.seat is None:
        raise InputError("lengths are between seats, and the plan has none", file=file, hint="omit them")
    found = read_lengths(file, seats=[name for name in planned.seat.tolist() if name])
    none = np.zeros(len(found))
    return replace(found, expansion_per_K=none, u_expansion_per_K=none.copy(), file=None, numbers=None, by_line=False)


def touched_points(chain: Chain, planned: PlannedReadings, lengths: Lengths | None = None) -> FloatArray:
    """Where the tip is in each reading of a plan with seats and spheres, (n, 3) in the base frame [mm].

    Raises
    ------
    InputError
        As `carry_out`.
    """
    tips = chain.tip_in_base(planned.angles)
    out = np.empty_like(tips)
    for name in _names(planned.seat):
        rows = planned.rows_of(name)
        out[rows] = tips[rows].mean(axis=0)
        _check_near(planned, name, np.linalg.norm(tips[rows] - out[rows], axis=1))
    if lengths is not None:
        _move_to_lengths(out, planned, lengths)
    for name in _names(planned.sphere):
        rows = planned.rows_of(name, "sphere")
        centre, radius = _sphere(tips[rows], planned, name)
        if planned.tip_sphere_mm is not None and np.isfinite(stated_mm := planned.tip_sphere_mm[rows][0]):
            radius = float(stated_mm) / 2  # that of aims rounded to 0.1 deg is half a millimetre off
        away = tips[rows] - centre
        distance = np.linalg.norm(away, axis=1, keepdims=True)
        _check_near(planned, name, np.abs(distance - radius).ravel())
        out[rows] = centre + radius * away / distance
    return out


def _move_to_lengths(places: FloatArray, planned: PlannedReadings, lengths: Lengths) -> None:
    """Move seats in `places` (n, 3) as little as possible, until all lengths between them are the stated ones.

    Gauss-Newton steps of the smallest norm: lengths that share a seat are met together.
    """
    names = list(dict.fromkeys([*lengths.seat_a.tolist(), *lengths.seat_b.tolist()]))
    rows = [planned.rows_of(name) for name in names]
    at = np.array([places[touched][0] for touched in rows])
    a, b = (np.array([names.index(name) for name in ends.tolist()]) for ends in (lengths.seat_a, lengths.seat_b))
    apart = np.linalg.norm(at[b] - at[a], axis=1)
    if (other := np.abs(apart - lengths.length_mm) > SAME_SHARE * lengths.length_mm).any():
        i = int(np.argmax(other))
        raise InputError(
            f"the plan has seats {names[a[i]]} and {names[b[i]]} {apart[i]:.1f} mm apart, the file of lengths states "
            f"{lengths.length_mm[i]:.1f} mm",
            file=planned.file,
            hint="give the file of lengths that truearm plan wrote with this plan",
        )
    each = np.arange(len(a))
    for _ in range(_STEPS):
        along = at[b] - at[a]
        apart = np.linalg.norm(along, axis=1, keepdims=True)
        J = np.zeros((len(a), len(names), 3))
        J[each, b], J[each, a] = along / apart, -along / apart
        short = lengths.length_mm - apart.ravel()
        if np.abs(short).max() < _EXACT_MM:
            break
        at = at + np.linalg.lstsq(J.reshape(len(a), -1), short, rcond=_RANK)[0].reshape(at.shape)
    # Lengths in a line contradict each other within their certificates.
    if (np.abs(short) > np.maximum(_WITHIN * lengths.u_mm, 1e3 * _EXACT_MM)).any():
        i = int(np.argmax(np.abs(short)))
        raise InputError(
            f"the lengths contradict each other: {names[a[i]]} to {names[b[i]]} is off by {abs(short[i]):.3f} mm",
            file=lengths.file or planned.file,
            hint="check the lengths between seats that share a seat",
        )
    for touched, place in zip(rows, at, strict=True):
        places[touched] = place


def move_set_up(measured: Measurement, *, seed: int) -> Measurement:
    """The measurement as a reference instrument sees it that stands elsewhere: other reference points.

    Raises
    ------
    InputError
        If the readings have no reference points.
    """
    readings = measured.readings
    if readings.points is None:
        raise InputError(
            "a new set-up is seen by a reference instrument; this plan is measured in seats",
            hint="plan it with --artefact tracker",
        )
    stream = random_stream("session", seed, "set-up")
    azimuth, shift = stream.uniform(0, 2 * np.pi), SHIFT_MM * stream.standard_normal(3)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    moved: Session = replace(readings, points=readings.points @ turn.T + shift)
    return replace(measured, readings=moved)


def _true_lengths(lengths: Lengths | None, *, seed: int) -> Lengths | None:
    """The true lengths of virtual artefacts: certificates err within their uncertainty, each artefact by one error."""
    if lengths is None:
        return None
    stream = random_stream("arm", seed, "certificates")
    names = [name or f"{a} to {b}" for name, a, b in zip(lengths.artefact, lengths.seat_a, lengths.seat_b, strict=True)]
    errors = {name: stream.standard_normal() for name in dict.fromkeys(names)}
    return replace(lengths, length_mm=lengths.length_mm + lengths.u_mm * np.array([errors[name] for name in names]))


def _sphere(tips: FloatArray, planned: PlannedReadings, name: str) -> tuple[FloatArray, float]:
    """Centre and radius of the sphere through tips, by least squares of ``2 c p + r^2 - c^2 = p^2``."""
    middle = tips.mean(axis=0)
    away = tips - middle
    found, _, rank, _ = np.linalg.lstsq(np.column_stack([2 * away, np.ones(len(away))]), (away**2).sum(axis=1))
    if rank < 4:
        raise InputError(
            f"the aims of sphere {name!r} determine no sphere: expected four or more, not in one plane",
            file=planned.file,
            hint="give the file that truearm plan wrote",
        )
    return middle + found[:3], float(np.sqrt(found[3] + found[:3] @ found[:3]))


def _check_near(planned: PlannedReadings, name: str, distances: FloatArray) -> None:
    if distances.max() > FARTHEST_MM:
        raise InputError(
            f"an aim of {name} is {distances.max():.0f} mm away from the others of {name}",
            file=planned.file,
            hint="give the arm that the plan was made for",
        )


def _names(column: NameArray | None) -> list[str]:
    return [] if column is None else [name for name in dict.fromkeys(column.tolist()) if name]
