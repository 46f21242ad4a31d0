"""An arm as the mechanism of an interactive scene, and readings in space: coloured by error, with the arm at one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm, Chain
from truearm.identification.references.tips import tip_names
from truearm.models import Compensator
from truearm.models.identified_model import to_identified
from truearm.pages.plotting import Figure
from truearm.pages.scene import Mechanism, PointCloud, PointColumn, Scene
from truearm.readings import Session
from truearm.typing import FloatArray

# What a slider spans of a joint that turns without limit; of one that slides, this share of the reach to each side.
_FULL_TURN_DEG, _SLIDE_OF_REACH = 360.0, 1.0
# A common normal farther away than so many link lengths: the axes are parallel but for rounding.
_FAR = 2.0
_SHORT_MM = 1e-6


def arm_mechanism(
    arm: Arm,
    *,
    start: npt.ArrayLike | None = None,
    controls: bool = False,
    follows: Sequence[int] | None = None,
    from_origin: bool = True,
) -> Mechanism:
    """The arm as a mechanism.

    Parameters
    ----------
    arm : Arm
    start : (n_joints,) array, optional
        Joint angles of the first view [rad, or mm for sliding joints]; the working pose by default.
    controls : bool
        Whether the scene has sliders.
    follows : sequence of int, optional
        See `Mechanism`.
    from_origin : bool
        Whether the drawing begins at the origin; else at joint 1, as of an arm in the frame of a reference instrument.
    """
    shown = arm.chain
    slides = shown.is_prismatic
    scale = np.where(slides, 1.0, np.degrees(1.0))
    values = shown.joint_angles(arm.working if start is None else np.asarray(start, dtype=float)) * scale
    own = np.eye(arm.n_joints) == (np.eye(arm.n_joints) if shown.coupling is None else shown.coupling)
    # Limits are those of encoders: of a coupled joint they say nothing.
    lower, upper = np.where(own.all(axis=1)[:, None], arm.limits, [-np.inf, np.inf]).T * scale
    span = np.where(slides, _SLIDE_OF_REACH * max(shown.reach, 1.0), _FULL_TURN_DEG)
    limited = np.isfinite(lower) & np.isfinite(upper)
    return Mechanism(
        fixed=shown.fixed,
        end=shown.tip_in_flange,
        links=[_base(shown, from_origin=from_origin), *_links(shown)],
        names=arm.joint_labels,
        units=arm.joint_units,
        lower=np.where(np.isfinite(lower), lower, np.minimum(values, 0.0) - span),
        upper=np.where(np.isfinite(upper), upper, np.maximum(values, 0.0) + span),
        limited=limited,
        start=values,
        end_name="tip",
        value_name="joint angle" if not slides.any() else "joint position",
        controls=controls,
        follows=follows,
    )


def joint_columns(angles: FloatArray, sliding: npt.ArrayLike, names: Sequence[str] | None = None) -> list[PointColumn]:
    """Joint angles (n, n_joints) [rad, or mm] as columns of a cloud [deg, or mm]; J1, J2, ... by default."""
    values = np.where(sliding, angles, np.degrees(angles)).T
    names = [f"J{i}" for i in range(1, len(values) + 1)] if names is None else names
    units = ["mm" if slides else "deg" for slides in np.asarray(sliding)]
    return [PointColumn(*one) for one in zip(names, units, values, strict=True)]


def joint_frames(chain: Chain, angles: npt.ArrayLike) -> FloatArray:
    """Frames (n_joints + 1, 4, 4) right before each joint at a pose (n_joints,), and that of the flange [rad, mm]."""
    frames = [chain.fixed[0]]
    for i, angle in enumerate(chain.joint_angles(np.asarray(angles, dtype=float))):
        moved = np.eye(4)
        if chain.is_prismatic[i]:
            moved[2, 3] = angle
        else:
            moved[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        frames.append(frames[-1] @ moved @ chain.fixed[i + 1])
    return np.array(frames)


def _base(chain: Chain, *, from_origin: bool) -> FloatArray:
    """From the base to joint 1, upwards first."""
    end = chain.fixed[0, :3, 3]
    return _without_short_pieces(np.array([np.zeros(3), [0, 0, end[2]], end] if from_origin else [end, end]))


def _links(chain: Chain) -> list[FloatArray]:
    """Each link in the frame after its joint: along its axis, along the common normal, along the next axis."""
    links = []
    for fixed in chain.fixed[1:-1]:
        end, axis = fixed[:3, 3], fixed[:3, 2]
        links.append(_without_short_pieces(np.array([np.zeros(3), *_feet(end, axis), end])))
    flange = chain.fixed[-1]
    tip = flange[:3, :3] @ chain.tip_in_flange + flange[:3, 3]
    links.append(_without_short_pieces(np.array([np.zeros(3), [0, 0, flange[2, 3]], flange[:3, 3], tip])))
    return links


def _feet(end: FloatArray, axis: FloatArray) -> list[FloatArray]:
    """Where the common normal of the z axis and a line meets both; of parallel lines the normal through the end."""
    sine = float(np.hypot(axis[0], axis[1]))
    if sine > _SHORT_MM:
        along = -float(axis[:2] @ end[:2]) / sine**2
        foot = end + along * axis
        if abs(along) + abs(float(foot[2])) < _FAR * float(np.linalg.norm(end)):
            return [np.array([0, 0, foot[2]]), foot]
    return [np.array([0, 0, end[2]])]


def _without_short_pieces(path: FloatArray) -> FloatArray:
    """The path without points that coincide with those before them; two points at least."""
    kept = [path[0]]
    kept += [point for point in path[1:-1] if np.linalg.norm(point - kept[-1]) > _SHORT_MM]
    if len(kept) > 1 and np.linalg.norm(path[-1] - kept[-1]) <= _SHORT_MM:
        kept.pop()
    return np.array([*kept, path[-1]])


def arm_at_readings(models: Mapping[str, Compensator], readings: Session) -> Mechanism | None:
    """The arm that the first identified model found, which goes to the reading that a reader points at.

    None without such a model, for coupled joints, whose readings are not their angles, and for readings of several
    sessions or tips, which have frames of their own.
    """
    several = len(tip_names(readings)) > 1 or (readings.session is not None and len(set(readings.session)) > 1)
    found = [one for one in map(to_identified, models.values()) if one is not None]
    if several or not found or found[0].arm.chain.coupling is not None:
        return None
    arm = replace(found[0].arm, chain=found[0].fit_.chain)
    return arm_mechanism(arm, start=readings.angles[0], follows=[*range(arm.n_joints)], from_origin=False)


def readings_scene(
    points: FloatArray,
    errors: Mapping[str, FloatArray],
    angles: FloatArray,
    *,
    what: str,
    names: Sequence[str],
    joint_names: Sequence[str],
    sliding: Sequence[bool],
    still: Figure,
    shown: str,
    std_mm: FloatArray | None = None,
    mechanism: Mechanism | None = None,
    lines: Sequence[FloatArray] = (),
    marked: Mapping[int, str] | None = None,
) -> Scene:
    """The readings as an interactive scene.

    Parameters
    ----------
    points : (n, 3) array
        Where they are drawn [mm].
    errors : mapping of str to (n,) array
        Of each model [mm], not negative; a single model needs no name (empty).
    angles : (n, n_joints) array
        [rad], or [mm] for sliding joints.
    what : str
        What the errors are: "error" or "distance from the seat's mean point".
    names : sequence of str
        Of the readings.
    joint_names, sliding
        Of the joints.
    still : Figure
        The figure on paper.
    shown : str
        The model whose errors colour the readings at first.
    std_mm : (n,) array, optional
        Standard uncertainty of a coordinate of the model that is shown.
    mechanism : Mechanism, optional
        From `arm_at_readings`.
    lines : sequence of (m, 3) arrays
        Lines between the readings, such as bars [mm].
    marked : mapping of int to str, optional
        Labels of readings that have a ring.
    """
    cloud = PointCloud(
        points,
        names,
        [PointColumn(_of(what, name), "mm", values) for name, values in errors.items()],
        joint_columns(angles, sliding, joint_names),
        [] if std_mm is None else [PointColumn(_of("u of a coordinate", shown), "mm", std_mm)],
        noun="reading",
        shown=list(errors).index(shown),
        marked={} if marked is None else marked,
    )
    label = f"{len(points)} readings in space, coloured by {what}; the arm goes to the reading that is pointed at"
    label = label if mechanism else label.partition(";")[0]
    return Scene(label, "mm", still, cloud=cloud, mechanism=mechanism, lines=lines)


def _of(what: str, model: str) -> str:
    return f"{what}, {model}" if model else what
