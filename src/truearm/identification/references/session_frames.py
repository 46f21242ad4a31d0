"""Frames of sessions: base or reference moved between two set-ups, so each session has its own frame.

Terms are small motions, and two places of a tracker are metres apart. So the points of a further session are first
transformed into the frame of the first by a rough rigid motion, from the tips of the nominal arm; the rest are six
small motions of the base in that session, identified with all other terms. The model keeps the rough motions and
predicts points of a session in its own frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.references.alignment import align_robust, rms_distance_from_line
from truearm.identification.references.reading_references import MIN_POINT_SPREAD, rows_with_orientation
from truearm.identification.terms import Constant, InSession, Term, base_terms
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray, NameArray

Frames = Mapping[str, FloatArray]

MIN_POINTS = 3


def rough_session_frames(arm: Arm, readings: Session, free: tuple[str, ...]) -> dict[str, FloatArray]:
    """Rough frames of the sessions with reference points or orientations.

    Parameters
    ----------
    arm : Arm
    readings : Session
        Each session in its own frame.
    free : tuple of str
        Without ``"base"`` all points are in the arm's base frame.

    Returns
    -------
    dict of str to (4, 4) array
        By the session's name, in the order of the readings, the rigid motion of its points into the frame of the first
        [mm]. Empty for one session or none.

    Raises
    ------
    InputError
        If some readings with a point or orientation name a session and others do not, or a session has fewer than three
        points or all on a line.
    """
    seen = readings.has_point
    seen[rows_with_orientation(readings.quaternion)] = True
    if readings.session is None or "base" not in free or not seen.any():
        return {}
    names = list(dict.fromkeys(readings.session[seen].tolist()))
    if len(names) == 1:
        return {}
    if "" in names:
        problem = "expected the session of every reading with a reference point, got none"
        hint = "each session has its own frame: name all of them, or remove the column if there is one session"
        readings.refuse(seen & (readings.session == ""), problem, column="session", hint=hint)
    return dict(zip(names, _motions(arm, readings, names), strict=True))


def _motions(arm: Arm, readings: Session, names: list[str]) -> Iterator[FloatArray]:
    """Rigid motions (4, 4) of the sessions' points into the frame of the first."""
    assert readings.session is not None
    first = None
    for name in names:
        rows = np.flatnonzero((readings.session == name) & readings.has_point)
        points = np.zeros((0, 3)) if readings.points is None else readings.points[rows]
        if len(points) < MIN_POINTS or rms_distance_from_line(points) < MIN_POINT_SPREAD * arm.chain.reach:
            raise readings.error(
                f"session {name!r} has {len(points)} reference points, too few or on a line: the position of the "
                "base is not identifiable",
                hint="measure three points or more, spread over an area; or remove the session and use truearm refit",
            )
        placement = align_robust(arm.chain.tip_in_base(readings.angles[rows]), points)
        first = placement if first is None else first
        yield np.eye(4) if first is placement else first @ np.linalg.inv(placement)


def session_frame_terms(chain: Chain, frames: Frames) -> list[Term]:
    """Small motions of the base in every session but the first, with the prior of a free base."""
    return [
        replace(term, name=f"{term.name}, session {name}", basis=InSession(name), group="frames of further sessions")
        for name in list(frames)[1:]
        for term in base_terms(chain)
    ]


def in_one_frame(arm: Arm, readings: Session, free: tuple[str, ...]) -> tuple[Session, dict[str, FloatArray]]:
    """Readings in the frame of the first session, and the rough frames of all."""
    frames = rough_session_frames(arm, readings, free)
    return to_first_session_frame(readings, frames), frames


def to_first_session_frame(readings: Session, frames: Frames) -> Session:
    """Readings with points and orientations in the frame of the first session.

    Standard uncertainties that differ by axis are rotated too, without the correlations between the new axes.
    """
    if not frames:
        return readings
    points, std, quaternion = readings.points, readings.point_std, readings.quaternion
    errors = readings.pose_errors
    for rows, T in _by_session(readings.session, frames):
        R = T[:3, :3]
        if points is not None:
            points = points.copy() if points is readings.points else points
            points[rows] = points[rows] @ R.T + T[:3, 3]
        if std is not None:
            std = std.copy() if std is readings.point_std else std
            std[rows] = np.sqrt(std[rows] ** 2 @ (R**2).T)
        if quaternion is not None:
            quaternion = quaternion.copy() if quaternion is readings.quaternion else quaternion
            turned = np.flatnonzero(rows & np.isfinite(quaternion).all(axis=1))
            orientation = Rotation.from_matrix(R) * Rotation.from_quat(quaternion[turned], scalar_first=True)
            quaternion[turned] = orientation.as_quat(scalar_first=True)
        errors = None if errors is None else errors.turned(rows, R)
    return replace(readings, points=points, point_std=std, quaternion=quaternion, pose_errors=errors)


def points_to_session_frames(points: FloatArray, session: NameArray | None, frames: Frames) -> FloatArray:
    """Points (n, 3) [mm] from the frame of the first session into that of each reading's session, if known."""
    out = points
    for rows, T in _by_session(session, frames):
        out = out.copy() if out is points else out
        out[rows] = (points[rows] - T[:3, 3]) @ T[:3, :3]
    return out


def covariances_to_session_frames(covariance: FloatArray, session: NameArray | None, frames: Frames) -> FloatArray:
    """Covariances (n, 3, 3) [mm^2], rotated likewise."""
    out = covariance
    for rows, T in _by_session(session, frames):
        out = out.copy() if out is covariance else out
        out[rows] = T[:3, :3].T @ covariance[rows] @ T[:3, :3]
    return out


def displacements_to_session_frames(displacements: FloatArray, session: NameArray | None, frames: Frames) -> FloatArray:
    """Displacements (k, n, 3) [mm], rotated likewise."""
    out = displacements
    for rows, T in _by_session(session, frames):
        out = out.copy() if out is displacements else out
        out[:, rows] = displacements[:, rows] @ T[:3, :3]
    return out


def _by_session(session: NameArray | None, frames: Frames) -> Iterator[tuple[BoolArray, FloatArray]]:
    """Readings (n,) of every session but the first, and the rigid motion (4, 4) of its points."""
    for name in list(frames)[1:]:
        if session is not None and (rows := session == name).any():
            yield rows, frames[name]


def checked_frames(names: list[str], motions: FloatArray) -> dict[str, FloatArray]:
    """Frames from a file.

    Raises
    ------
    InputError
        If they are not rigid motions (k, 4, 4), the first is not the identity, or a name is there twice.
    """
    rigid = Chain(motions, np.zeros(3)).fixed
    if len(rigid) != len(names) or len(set(names)) != len(names) or (rigid[0] != np.eye(4)).any():
        raise InputError(f"expected a frame for each of {len(names)} sessions, the identity for the first")
    return dict(zip(names, rigid, strict=True))


def places_the_frame(term: Term) -> bool:
    """Whether a constant only places the arm's frame: its base, and offset and height of joint 1.

    Seats and lengths determine points relative to each other. The frame is then the arm's own, with the nominal axis
    and offset of joint 1 (L. J. Everett, T.-W. Hsu, "The theory of kinematic parameter identification for industrial
    robots", J. Dyn. Sys. Meas. Control 110 (1988) 96, on what a choice of frames leaves to identify).
    """
    along_own_axis = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return isinstance(term.basis, Constant) and (
        term.place == 0 or (term.place == 1 and term.direction in along_own_axis)
    )
