"""References of a session, as identification uses them: points, seats, distances, surfaces, orientations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.findings import Finding
from truearm.identification.references.alignment import align, rms_distance_from_line
from truearm.identification.references.distances import Distances, distances_of
from truearm.identification.references.orientations import Orientations, Poses, orient_flange_coarsely
from truearm.identification.references.references import Points, Reference, Seats, StatedLength, seats_of
from truearm.identification.references.surfaces import Lines, Planes, Spheres, lines_of, planes_of, spheres_of
from truearm.identification.references.tips import tip_names
from truearm.identification.terms import ArmState, Basis, InSession, OfTip, Term
from truearm.identification.terms.catalogue import tool_rotation
from truearm.readings.checks import check_scale
from truearm.readings.lengths import Lengths
from truearm.readings.reference_uncertainty import common_variance_of_repeats
from truearm.readings.session import Session
from truearm.readings.thermal_expansion import thermal_expansion_of
from truearm.typing import FloatArray, IntArray, NameArray

# Share of the reach by which points must be spread to both sides of a line.
MIN_POINT_SPREAD = 1e-3
# Readings needed to locate an anchor or a surface.
MIN_READINGS_ON = {"anchor": Distances.least, "sphere": Spheres.least, "plane": Planes.least, "line": Lines.least}


def state_of(
    arm: Arm,
    readings: Session,
    *,
    temperature_degC: float | None = None,
    columns: Mapping[str, float] | None = None,
    direction: float | None = None,
) -> ArmState:
    """State of the arm at readings; the arguments replace a temperature, columns or directions that are not stated.

    With `columns`, other columns of the readings are ignored.
    """
    n = len(readings)
    temperature = readings.temperature_degC
    if temperature is None and temperature_degC is not None:
        temperature = np.full(n, temperature_degC)
    stated = dict(readings.columns)
    if columns is not None:
        stated = {name: stated.get(name, np.full(n, value)) for name, value in columns.items()}
    directions = readings.directions
    if directions is None and direction is not None:
        directions = np.full(readings.angles.shape, direction)
    return ArmState.of(
        arm,
        readings.angles,
        temperature_degC=temperature,
        directions=directions,
        columns=stated,
        session=readings.session,
        tip=readings.tip,
        stride=readings.stride,
    )


class Referenced(NamedTuple):
    """What an identification needs of readings in one frame.

    Attributes
    ----------
    session : Session
        With orientations as of one tool.
    references : list of Reference
    state : ArmState
    chain : Chain
        See `roughly_aligned_chain`.
    tool : list of Term
        See `tool_terms`.
    findings : tuple of Finding
        Of what has too few readings.
    """

    session: Session
    references: list[Reference]
    state: ArmState
    chain: Chain
    tool: list[Term]
    findings: tuple[Finding, ...]

    @classmethod
    def of(cls, arm: Arm, readings: Session, lengths: Lengths | None, free: tuple[str, ...]) -> Self:
        """Of readings whose points are in one frame; an arm without kinematics has no chain to place."""
        session = as_of_one_tool(arm, readings, free)
        references, state, chain, tool = (
            references_of(session, lengths),
            state_of(arm, session),
            arm.chain,
            list[Term](),
        )
        if arm.has_kinematics:
            chain, tool = roughly_aligned_chain(arm, session, free), tool_terms(arm, session)
        found = []
        for kind, name, n in surfaces_with_too_few_readings(readings):
            said = f"{kind} {name} has {n} usable readings; at least {MIN_READINGS_ON[kind]} are needed. Ignored."
            found.append(Finding("few readings on", said, {"n": n}))
        return cls(session, references, state, chain, tool, tuple(found))


def references_of(readings: Session, lengths: Lengths | None) -> list[Reference]:
    """References of the readings, one of a kind.

    Lengths are those at the temperature of the readings in their seats, where their expansion is known. Ignored are
    seats with one reading or one repeated pose and no known length, lengths between other seats, and surfaces and
    anchors with too few readings (see `surfaces_with_too_few_readings`).

    A reading in a seat that also has a reference point counts twice: as a point, with the noise of the instrument, and
    as a reading of its seat, with the noise of the contact.

    Raises
    ------
    InputError
        If the session has no reference.
    """
    references: list[Reference] = []
    seen = np.flatnonzero(readings.has_point)
    poses = poses_of(readings)
    if poses is not None:
        references.append(poses)
        seen = np.setdiff1d(seen, poses.rows)
    if len(seen):
        references.append(_points(readings, seen))
    seat = readings.seat
    held = np.flatnonzero(seat != "") if seat is not None else np.zeros(0, dtype=np.intp)
    if len(held):
        assert seat is not None
        between = _between(lengths, readings, held)
        ends = [name for row in between for name in row[:2]]
        held = held[np.isin(seat[held], np.array([*_in_poses(readings, held), *ends], dtype=seat.dtype))]
        if len(held):
            references.append(seats_of(held, seat[held], between))
    surfaces: dict[str, Callable[[IntArray, NameArray], Reference]] = {
        "anchor": lambda rows, _: distances_of(readings, rows),
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
            references.append(made(touched, names[touched]))
    turned = rows_with_orientation(readings.quaternion)
    if len(turned) and poses is None:
        references.append(Orientations(turned, _orientations(readings, turned)))
    if not references:
        raise InputError(
            "expected reference points (x_mm, y_mm, z_mm), seats of two readings or more, four distances to an anchor, "
            "spheres of four, planes of three, lines of two or orientations, the readings have none of these",
            file=readings.file,
        )
    return references


def poses_of(readings: Session) -> Poses | None:
    """The poses of readings whose points and orientations err together; None where no such errors are stated."""
    if readings.pose_errors is None:
        return None
    rows = np.intersect1d(np.flatnonzero(readings.has_point), rows_with_orientation(readings.quaternion))
    assert readings.points is not None
    return Poses(rows, readings.points[rows], _orientations(readings, rows), readings.pose_errors.rows(rows))


def _points(readings: Session, seen: IntArray) -> Points:
    """The points of readings `seen`, with the errors that repeats share."""
    assert readings.points is not None
    std = None if readings.point_std is None else readings.point_std[seen]
    if readings.u_common_mm is None or not readings.u_common_mm.any():
        return Points(seen, readings.points[seen], std)
    variance, of_repeats = (part[seen] for part in common_variance_of_repeats(readings))
    own = np.zeros((len(seen), 3)) if std is None else std**2
    return Points(seen, readings.points[seen], np.sqrt(own + variance[:, None]), of_repeats)


def without_sizes(reference: Reference) -> Reference:
    """A reference without lengths and distances; itself if it has none."""
    if isinstance(reference, Seats) and reference.lengths:
        return replace(reference, lengths=())
    if isinstance(reference, Spheres) and reference.radii:
        return replace(reference, radii=())
    return reference


def surfaces_with_too_few_readings(readings: Session) -> list[tuple[str, str, int]]:
    """Ignored anchors and surfaces: kind, name, and the number of readings, which is too small to locate it.

    Readings on surfaces count if they have no point.
    """
    ignored = []
    for kind, least in MIN_READINGS_ON.items():
        touched = _touched(readings, kind)
        if len(touched):
            names, counts = np.unique(getattr(readings, kind)[touched], return_counts=True)
            ignored += [(kind, str(name), int(n)) for name, n in zip(names, counts, strict=True) if n < least]
    return ignored


def _touched(readings: Session, kind: str) -> IntArray:
    """Readings of a kind of anchor or surface; of a surface those without a point: with one, only the point counts."""
    names = getattr(readings, kind)
    if names is None:
        return np.zeros(0, dtype=np.intp)
    if kind == "anchor":
        return np.flatnonzero(names != "")
    return np.flatnonzero((names != "") & ~readings.has_point)


def check_spread(readings: Session, arm: Arm) -> None:
    """Check that reference points determine the position of the base.

    Raises
    ------
    InputError
        If they lie on a line, or nearly so: a rotation about it is not identifiable; or if that is due to their unit,
        see `check_scale`.
    """
    if readings.points is None:
        return
    seen = readings.points[readings.has_point]
    off = rms_distance_from_line(seen)
    if off < MIN_POINT_SPREAD * arm.chain.reach:
        check_scale(readings, arm.chain.tip_in_base(readings.angles))  # points in m are all near to a line
        raise readings.error(
            f"the {len(seen)} reference points lie within {off:.3g} mm of a line: a rotation of the base about it "
            "is not identifiable",
            hint="measure points spread over an area, or keep the base (--free tip)",
        )


def check_points_of_one_tip(readings: Session) -> None:
    """Check that every reading has a reference point, and all of them one tip.

    Raises
    ------
    InputError
    """
    if len(tip_names(readings)) > 1:
        raise readings.error(
            "expected the readings of one tip: this model learns from angles and points alone",
            column="tip",
            hint="choose a kinematic or physical model, or the readings of one tip",
        )
    if not readings.has_point.any():
        raise InputError(
            "expected reference points (x_mm, y_mm, z_mm) to learn from, the readings have none", file=readings.file
        )
    if not readings.has_point.all():
        raise readings.error(
            f"expected a reference point at every reading, {int((~readings.has_point).sum())} of {len(readings)}"
            " have none",
            hint="readings.rows(readings.has_point) selects the others",
        )


def rows_with_orientation(quaternion: FloatArray | None) -> IntArray:
    """Readings with an orientation of the flange, of quaternions (n, 4)."""
    return np.zeros(0, dtype=np.intp) if quaternion is None else np.flatnonzero(np.isfinite(quaternion).all(axis=1))


def place_base_coarsely(chain: Chain, readings: Session, free: tuple[str, ...]) -> Chain:
    """The chain, placed by `align` so that its tips are nearest to the points of the readings, if its base is free."""
    if "base" not in free or readings.points is None:
        return chain
    seen = readings.has_point
    return chain.with_reference_frame(align(chain.tip_in_base(readings.angles[seen]), readings.points[seen]))


def roughly_aligned_chain(arm: Arm, readings: Session, free: tuple[str, ...]) -> Chain:
    """The arm's chain, its base and tool placed roughly where the readings have them."""
    chain = place_base_coarsely(arm.chain, readings, free)
    turned = rows_with_orientation(readings.quaternion)
    return (
        orient_flange_coarsely(chain, readings.angles[turned], _orientations(readings, turned))
        if len(turned)
        else chain
    )


def tool_terms(arm: Arm, readings: Session) -> list[Term]:
    """The rotation of the tracked tool on the flange, where orientations were measured: in every session, of every tip.

    Those of further sessions and tips differ from that of the first, of `as_of_one_tool`, by small rotations.
    """
    turned = rows_with_orientation(readings.quaternion)
    if not len(turned):
        return []
    # Poses with errors of their own are of one day: their frames are those of cameras, before which no tool changes.
    sessions = None if readings.pose_errors is not None else readings.session
    bases: list[Basis] = [InSession(name) for name in _further(sessions, turned)]
    bases += [OfTip(name) for name in _further(readings.tip, turned)]
    whole = tool_rotation(arm.chain)
    return [*whole, *(replace(one, name=f"{one.name}, {basis}", basis=basis) for basis in bases for one in whole)]


def _further(names: NameArray | None, rows: IntArray) -> list[str]:
    """Names of some readings but the first of them."""
    return [] if names is None else [name for name in list(dict.fromkeys(names[rows].tolist()))[1:] if name]


def as_of_one_tool(arm: Arm, readings: Session, free: tuple[str, ...]) -> Session:
    """Readings with the orientations that the tool of the first of them would have, roughly, by the nominal arm.

    A marker that is mounted again, in another session or on another tip, may be turned by any angle. Poses with errors
    of their own are those of one tool already.
    """
    if readings.pose_errors is not None:
        return readings
    turned = rows_with_orientation(readings.quaternion)
    names = [one[turned] for one in (readings.session, readings.tip) if one is not None]
    if not len(turned) or not names:
        return readings
    tool = np.unique(np.stack(names, axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    if not tool.any():
        return readings
    assert readings.quaternion is not None
    chain, measured = place_base_coarsely(arm.chain, readings, free), _orientations(readings, turned)
    in_flange = chain.pose(readings.angles[turned]).R_base_tip.transpose(0, 2, 1) @ measured
    on_flange = [Rotation.from_matrix(in_flange[tool == one]).mean().as_matrix() for one in range(tool.max() + 1)]
    back = np.stack([one.T @ on_flange[tool[0]] for one in on_flange])
    quaternion = readings.quaternion.copy()
    others = tool != tool[0]
    aligned = Rotation.from_matrix((measured @ back[tool])[others])
    quaternion[turned[others]] = aligned.as_quat(scalar_first=True)
    return replace(readings, quaternion=quaternion)


def _orientations(readings: Session, rows: IntArray) -> FloatArray:
    assert readings.quaternion is not None
    return np.asarray(Rotation.from_quat(readings.quaternion[rows], scalar_first=True).as_matrix())


def _in_poses(readings: Session, held: IntArray) -> list[str]:
    """Seats with readings in two or more states of the arm; in a single state the tip is the same."""
    assert readings.seat is not None
    names, seat = np.unique(readings.seat[held], return_inverse=True)
    state = [readings.angles, *readings.columns.values()]
    state += [values for values in (readings.temperature_degC, readings.directions) if values is not None]
    different = np.unique(np.column_stack([seat, *(values[held] for values in state)]), axis=0)
    return [str(name) for name in names[np.bincount(different[:, 0].astype(np.intp)) > 1]]


def _radii(readings: Session, rows: IntArray) -> list[tuple[str, float, float]]:
    """Known distances of the tip from the spheres' centres at readings `rows`, and their uncertainties."""
    if readings.sphere_distance is None:
        return []
    assert readings.sphere is not None  # no distance without one
    known = rows[~np.isnan(readings.sphere_distance[rows, 0])]
    names, first = np.unique(readings.sphere[known], return_index=True)
    return [(str(name), *readings.sphere_distance[known[i]].tolist()) for name, i in zip(names, first, strict=True)]


def _between(lengths: Lengths | None, readings: Session, held: IntArray) -> list[StatedLength]:
    """Lengths between two seats of the readings `held`, at the temperature of these readings."""
    assert readings.seat is not None
    seat, degC = readings.seat[held], readings.temperature_degC
    here = None if lengths is None else lengths.within(seat.tolist())
    if here is None:
        return []
    growth = thermal_expansion_of(here, seat, None if degC is None else degC[held])
    # Artefacts of one material share the errors of thermometer and coefficient; the largest uncertainty counts.
    expansion = np.full(len(here), np.nan) if here.expansion_per_K is None else here.expansion_per_K
    growth_std = np.array([growth.u[expansion == one].max(initial=0.0) for one in expansion])
    material = [f"lengths of {one:g} per K" if u else "" for one, u in zip(expansion, growth_std, strict=True)]
    names = ("seat_a", "seat_b", "length_mm", "u_mm", "artefact", "u_place_mm")
    columns = [getattr(here, name).tolist() for name in names]
    return list(zip(*columns, growth.factor.tolist(), material, growth_std.tolist(), strict=True))
