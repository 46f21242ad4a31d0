"""What readings say of their tips, as identification takes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.estimation.alignment import place_base_coarsely, rms_distance_from_line
from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.estimation.orientations import Orientations, orient_flange_coarsely
from truearm.identification.estimation.outliers import constraint_residuals
from truearm.identification.estimation.references import Points, Reference, Seats, StatedLength, seats_of
from truearm.identification.estimation.surfaces import Lines, Planes, Spheres, lines_of, planes_of, spheres_of
from truearm.identification.terms import ArmState, Term
from truearm.identification.terms.catalogue import tool_rotation
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.readings.thermal_expansion import thermal_expansion_of
from truearm.typing import FloatArray, IntArray, NameArray

# Share of the reach by which points must be spread to both sides of a line.
MIN_POINT_SPREAD = 1e-3
# Share by which a stated length or distance may differ from that of the arm as drawn. Real arms are within a hundredth
# of their drawings; radii in place of distances, other units and other seats are not.
MAX_SIZE_ERROR = 0.05
# Readings that it takes to find a surface.
MIN_READINGS_ON = {"sphere": Spheres.least, "plane": Planes.least, "line": Lines.least}


def state_of(
    arm: Arm,
    readings: Session,
    *,
    temperature_degC: float | None = None,
    columns: Mapping[str, float] | None = None,
    direction: float | None = None,
) -> ArmState:
    """State of the arm at readings; where they have no temperature, column or directions, the given ones stand in."""
    n = len(readings)
    temperature = readings.temperature_degC
    if temperature is None and temperature_degC is not None:
        temperature = np.full(n, temperature_degC)
    given = {name: np.full(n, value) for name, value in (columns or {}).items()}
    directions = readings.directions
    if directions is None and direction is not None:
        directions = np.full(readings.angles.shape, direction)
    return ArmState.of(
        arm,
        readings.angles,
        temperature_degC=temperature,
        directions=directions,
        columns=given | dict(readings.columns),
        session=readings.session,
    )


def references_of(readings: Session, lengths: Lengths | None) -> list[Reference]:
    """References of the readings, one of a kind.

    Lengths are as long as they are at the temperature of the readings in their seats, where their expansion is known.
    A seat with one reading, or one pose again and again, and no known length says nothing and is left out; so are
    lengths between other seats, and surfaces of fewer readings without a point than it takes to find them (see
    `surfaces_with_too_few_readings`).

    A reading whose tip was held in a seat while an instrument saw it says both: where the tip was, but for the
    instrument's noise, and that it was where the seat's other readings were, but for the touch. Both count, each kind
    with the noise that is found of it.

    Raises
    ------
    InputError
        If there is nothing.
    """
    found: list[Reference] = []
    seen = np.flatnonzero(readings.has_point)
    if len(seen):
        assert readings.points is not None
        std = None if readings.point_std is None else readings.point_std[seen]
        found.append(Points(seen, readings.points[seen], std))
    seat = readings.seat
    held = np.flatnonzero(seat != "") if seat is not None else np.zeros(0, dtype=np.intp)
    if len(held):
        assert seat is not None
        between = _between(lengths, readings, held)
        ends = [name for row in between for name in row[:2]]
        held = held[np.isin(seat[held], np.array([*_in_poses(readings, held), *ends], dtype=seat.dtype))]
        if len(held):
            found.append(seats_of(held, seat[held], between))
    surfaces: dict[str, Callable[[IntArray, NameArray], Reference]] = {
        "sphere": lambda rows, names: spheres_of(rows, names, _radii(readings, rows)),
        "plane": planes_of,
        "line": lines_of,
    }
    too_few = surfaces_with_too_few_readings(readings)
    for kind, made in surfaces.items():
        touched = _touched(readings, kind)
        few = [name for one, name, _ in too_few if one == kind]
        names = getattr(readings, kind)
        touched = touched[~np.isin(names[touched], few)] if len(touched) else touched
        if len(touched):
            found.append(made(touched, names[touched]))
    turned = rows_with_orientation(readings)
    if len(turned):
        found.append(Orientations(turned, _orientations(readings, turned)))
    if not found:
        raise InputError(
            "expected reference points (x_mm, y_mm, z_mm), seats of two readings or more, spheres of four, planes of "
            "three, lines of two or orientations to learn from, the readings have none",
            file=readings.file,
        )
    return found


def check_sizes(
    readings: Session,
    lengths: Lengths | None,
    references: Sequence[Reference],
    fit_nominal: Callable[[Sequence[Reference]], IdentificationResult],
    state: ArmState,
) -> None:
    """Check that known lengths and distances are about those of the arm as drawn.

    Points show when an arm is described wrongly. Seats and surfaces agree with an arm of any size, and a length in
    another unit would make one that is as much larger, without a sign of it.

    Parameters
    ----------
    readings : Session
    lengths : Lengths, optional
    references : sequence of Reference
        Of both.
    fit_nominal : callable
        Gives the arm as drawn with base and tip identified from references.
    state : ArmState
        Of the readings.

    Raises
    ------
    InputError
        If the arm as drawn, identified without them, has another length by a share of more than `MAX_SIZE_ERROR`
        beyond three standard deviations.
    """
    bare = [_without_sizes(reference) for reference in references]
    if all(one is reference for one, reference in zip(bare, references, strict=True)):
        return
    told = constraint_residuals(fit_nominal(bare), state, bare, references)
    assert told is not None  # some are without what they state
    drawn, stated = told.values.T
    most = MAX_SIZE_ERROR * stated + 3 * np.sqrt(told.covariance.diagonal() + told.std**2)
    excess = np.abs(told.residuals) / most
    worst = int(np.argmax(excess))
    if excess[worst] > 1:
        of_sphere = told.names[worst].startswith("distance")
        raise InputError(
            f"expected a {told.names[worst]} of about {drawn[worst]:.4g} mm, as the arm as drawn has it, "
            f"got {stated[worst]:.6g} mm",
            file=readings.file if of_sphere or lengths is None else lengths.file,
            column="sphere_distance_mm" if of_sphere else "length_mm",
            hint="(D + d) / 2 of sphere and ball, the distance of the centres, not the radius; its unit; the arm"
            if of_sphere
            else "the unit of the length, the names of its two seats, the arm",
        )


def _without_sizes(reference: Reference) -> Reference:
    """A reference without lengths and distances; itself if it has none."""
    if isinstance(reference, Seats) and reference.lengths:
        return replace(reference, lengths=())
    if isinstance(reference, Spheres) and reference.radii:
        return replace(reference, radii=())
    return reference


def surfaces_with_too_few_readings(readings: Session) -> list[tuple[str, str, int]]:
    """Surfaces that are left out: kind, name, and readings without a point, fewer than it takes to find it."""
    found = []
    for kind, least in MIN_READINGS_ON.items():
        touched = _touched(readings, kind)
        if len(touched):
            names, counts = np.unique(getattr(readings, kind)[touched], return_counts=True)
            found += [(kind, str(name), int(n)) for name, n in zip(names, counts, strict=True) if n < least]
    return found


def _touched(readings: Session, kind: str) -> IntArray:
    """Readings on a kind of surface that have no point, which would count instead."""
    names = getattr(readings, kind)
    if names is None:
        return np.zeros(0, dtype=np.intp)
    return np.flatnonzero((names != "") & ~readings.has_point)


def check_spread(readings: Session, arm: Arm) -> None:
    """Check that reference points say where the base stands.

    Raises
    ------
    InputError
        If they lie on a line, or nearly so: the arm may turn about it.
    """
    if readings.points is None:
        return
    seen = readings.points[readings.has_point]
    off = rms_distance_from_line(seen)
    if off < MIN_POINT_SPREAD * arm.chain.reach:
        raise readings.error(
            f"the {len(seen)} reference points lie within {off:.3g} mm of a line, about which the base may turn unseen",
            hint="points spread over an area, or a base that stays (--free tip)",
        )


def rows_with_orientation(readings: Session) -> IntArray:
    """Readings whose flange's orientation a reference saw."""
    if readings.quaternion is None:
        return np.zeros(0, dtype=np.intp)
    return np.flatnonzero(np.isfinite(readings.quaternion).all(axis=1))


def roughly_aligned_chain(arm: Arm, readings: Session, free: tuple[str, ...]) -> Chain:
    """The arm's chain, as a whole and with its tool, put roughly to where the readings saw it."""
    chain = place_base_coarsely(arm.chain, readings, free)
    turned = rows_with_orientation(readings)
    return (
        orient_flange_coarsely(chain, readings.angles[turned], _orientations(readings, turned))
        if len(turned)
        else chain
    )


def tool_terms(arm: Arm, readings: Session) -> list[Term]:
    """The tool's rotation on the flange, where orientations see it."""
    return tool_rotation(arm.chain) if len(rows_with_orientation(readings)) else []


def _orientations(readings: Session, rows: IntArray) -> FloatArray:
    assert readings.quaternion is not None
    return np.asarray(Rotation.from_quat(readings.quaternion[rows], scalar_first=True).as_matrix())


def _in_poses(readings: Session, held: IntArray) -> list[str]:
    """Seats that were held in two or more states of the arm; in one and the same, all its tips are one."""
    assert readings.seat is not None
    names, seat = np.unique(readings.seat[held], return_inverse=True)
    state = [readings.angles, *readings.columns.values()]
    state += [values for values in (readings.temperature_degC, readings.directions) if values is not None]
    different = np.unique(np.column_stack([seat, *(values[held] for values in state)]), axis=0)
    return [str(name) for name in names[np.bincount(different[:, 0].astype(np.intp)) > 1]]


def _radii(readings: Session, rows: IntArray) -> list[tuple[str, float, float]]:
    """Effective radii of the spheres of readings `rows`, where they are known, and their uncertainties."""
    if readings.sphere_distance is None:
        return []
    assert readings.sphere is not None  # no distance without one
    known = rows[~np.isnan(readings.sphere_distance[rows, 0])]
    names, first = np.unique(readings.sphere[known], return_index=True)
    return [(str(name), *readings.sphere_distance[known[i]].tolist()) for name, i in zip(names, first, strict=True)]


def _between(lengths: Lengths | None, readings: Session, held: IntArray) -> list[StatedLength]:
    """The lengths whose two seats are among those of readings `held`, as long as they are at their temperature."""
    assert readings.seat is not None
    seat, degC = readings.seat[held], readings.temperature_degC
    here = None if lengths is None else lengths.within(seat.tolist())
    if here is None:
        return []
    growth = thermal_expansion_of(here, seat, None if degC is None else degC[held])
    # Thermometer and coefficient err alike wherever a thing of that material stands; the least known place counts.
    expansion = np.full(len(here), np.nan) if here.expansion_per_K is None else here.expansion_per_K
    growth_std = np.array([growth.u[expansion == one].max(initial=0.0) for one in expansion])
    material = [f"lengths of {one:g} per K" if u else "" for one, u in zip(expansion, growth_std, strict=True)]
    names = ("seat_a", "seat_b", "length_mm", "u_mm", "artefact", "u_place_mm")
    columns = [getattr(here, name).tolist() for name in names]
    return list(zip(*columns, growth.factor.tolist(), material, growth_std.tolist(), strict=True))
