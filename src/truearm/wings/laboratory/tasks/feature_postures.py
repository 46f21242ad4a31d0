"""Postures of a person who measures a feature."""

from __future__ import annotations

from collections import Counter
from typing import get_args

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory import FeatureKind
from truearm.wings.laboratory.tasks import features
from truearm.wings.laboratory.tasks.features import UP, Feature, length, length_at
from truearm.wings.planning.designs.sampling import check_five_rotary_joints, describe_rejections, inner_limits, reach
from truearm.wings.planning.designs.workspace import Stance, azimuth_of, stance, within_cone

# The size of each kind of feature, and a second one with its default.
SIZES = {
    "length": "length", "sphere": "diameter", "plane": "size", "circle": "diameter", "cylinder": "diameter",
    "cone": "diameter", "distance": "length", "angle": "size",
}  # fmt: skip
SECOND_SIZES = {
    "cylinder": ("depth", 50.0),
    "distance": ("size", 50.0),
    "cone": ("angle", 90.0),
    "angle": ("angle", 90.0),
}

# A working model, as hardly anything has been published: from one measurement of the feature to the next the elbow
# swings by N(0, 35 deg), as in `truearm.wings.planning.designs.sampling`, and the stylus leans within 30
# deg; from point to point of one measurement by N(0, 10 deg) and within 10 deg more.
_SWING_RAD, _LEAN_RAD = np.radians(35.0), np.radians(30.0)
_SWING_OF_POINT_RAD, _LEAN_OF_POINT_RAD = np.radians(10.0), np.radians(10.0)
# If all coordinates are smaller [mm], they are probably in metres.
_METRES = 5.0
_ROUNDS = 6  # of drawing the missing sets of postures
_TRIES = 3  # per point, before a set of postures is rejected


def feature_postures(arm: Arm, feature: Feature, n: int, *, seed: int) -> FloatArray:
    """Joint angles with the nominal tip on a feature's points, in n sets of postures.

    Parameters
    ----------
    arm : Arm
        Base z up, at least five rotary joints.
    feature : Feature
    n : int
        Maximum number of sets: fewer if hardly any is feasible.
    seed : int

    Returns
    -------
    (m, k, n_joints) array
        For each of the k points [rad], m from 1 to n.

    Raises
    ------
    InputError
        If the arm has too few joints, or does not reach the feature.
    """
    check_five_rotary_joints(arm)
    rng = np.random.default_rng([5, seed])
    where, k = stance(arm), len(feature.points)
    found: list[FloatArray] = []
    rejected: Counter[str] = Counter()
    for _ in range(_ROUNDS):
        ways = n - sum(map(len, found))
        lean = within_cone(np.tile([0.0, 0.0, 1.0], (ways, 1)), half_angle_rad=_LEAN_RAD, rng=rng)
        approach = np.stack([_turned(feature.approach, one) for one in lean]).reshape(-1, 3)
        swing = np.repeat(_SWING_RAD * rng.standard_normal((ways, arm.n_joints)), k, axis=0)
        tips = np.tile(feature.points, (ways, 1))
        angles = np.empty((len(tips), arm.n_joints))
        reason = np.full(len(tips), "not tried")
        for _ in range(_TRIES):
            rows = np.flatnonzero(reason != "")
            if not len(rows):
                break
            axes = -within_cone(approach[rows], half_angle_rad=_LEAN_OF_POINT_RAD, rng=rng)
            posture = _postures(arm, tips[rows], where, swing[rows], rng)
            angles[rows], why = reach(arm, tips[rows], axes, posture)
            reason = reason.astype(object)
            reason[rows] = why
        reached = reason.reshape(ways, k) == ""
        good = reached.all(axis=1)
        found.append(angles.reshape(ways, k, -1)[good])
        rejected.update(str(one) for one in reason if one != "")
        if good.all() or not reached.any(axis=0).all():  # a point that no set reaches is out of reach
            break
    sets = np.concatenate(found)
    if not len(sets):
        hint = f"choose a place about {0.6 * where.reach_mm:.0f} mm in front of the shoulder, or another direction"
        if np.abs(feature.points.mean(axis=0)).max() < _METRES:
            hint = "state its place in mm: 600,0,300, not 0.6,0,0.3"
        raise InputError(
            f"arm {arm.name!r} does not reach all points of the {feature.name} in any posture: "
            f"{describe_rejections(rejected)}",
            hint=hint,
        )
    return sets


def middle_of(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Middle (3,) [mm] of the volume that a person works in, and the level direction (3,) across its front."""
    where = stance(arm)
    front = np.array([np.cos(where.front_rad), np.sin(where.front_rad), 0.0])
    return where.shoulder_in_base + where.reach_mm * (0.6 * front + [0.0, 0.0, 0.05]), np.cross(front, [0.0, 0.0, -1.0])


def place_feature(
    kind: FeatureKind,
    size_mm: float | None,
    arm: Arm,
    *,
    at: npt.ArrayLike | None = None,
    along: npt.ArrayLike | None = None,
    n_points: int | None = None,
    second: float | None = None,
) -> Feature:
    """A feature in front of an arm.

    Parameters
    ----------
    kind : FeatureKind
    size_mm : float or None
        Length, diameter, or side of a square plane [mm]; None of a length between two seats.
    arm : Arm
    at : (3,) or (2, 3) array, optional
        Middle of the feature, or the two seats of a length [mm], in the base frame; by default the middle of the volume
        in which a person works.
    along : (3,) array, optional
        Direction of a length, normal of a plane or circle.
    n_points : int, optional
    second : float, optional
        Depth of a cylinder, side of the planes of a distance (50 mm), angle of a cone or of two planes (90 deg).

    Raises
    ------
    InputError
        If a parameter is missing, or does not apply to the feature.
    """
    place = None if at is None else np.asarray(at, dtype=float)
    seats = kind == "length" and place is not None and place.shape == (2, 3)
    what = "a length between two seats" if seats else f"a {kind}"
    if kind not in get_args(FeatureKind):
        raise InputError(f"expected a feature out of {', '.join(get_args(FeatureKind))}, got {kind!r}")
    if place is not None and not seats and place.shape != (3,):
        raise InputError(f"expected one place X,Y,Z, for a length one or two; got shape {place.shape}")
    if along is not None and (seats or kind == "sphere"):
        raise InputError(f"a direction does not apply to {what}", hint="omit it")
    if second is not None and kind not in SECOND_SIZES:
        raise InputError(f"{what} has no second size", hint="omit it")
    n = {"length": 2, "distance": 24, "angle": 24}.get(kind, 25) if n_points is None else n_points
    if seats:
        assert place is not None
        if size_mm is not None:
            raise InputError(f"a size does not apply to {what}: it is the distance of the seats", hint="omit it")
        return length(place, points=n)
    if size_mm is None:
        raise InputError(f"the size of the {kind} is missing", hint=f"its {SIZES[kind]} in mm: 100")
    middle, across = middle_of(arm)
    place = middle if place is None else place
    return _placed(kind, size_mm, place, along, across, n, second)


def _placed(
    kind: FeatureKind,
    size_mm: float,
    place: FloatArray,
    along: npt.ArrayLike | None,
    across: FloatArray,
    n: int,
    second: float | None,
) -> Feature:
    """A feature of a size at a place, by default upright, or across the arm's reach."""
    if kind == "sphere":
        return features.sphere(place, size_mm, points=n)
    if kind == "length":
        return length_at(place, across if along is None else along, size_mm, points=n)
    if kind in ("plane", "circle"):
        make = features.plane if kind == "plane" else features.circle
        return make(place, UP if along is None else along, size_mm, points=n)
    other = SECOND_SIZES[kind][1] if second is None else second
    if kind == "cylinder":
        return features.cylinder(place, UP if along is None else along, size_mm, other, points=n)
    if kind == "cone":
        return features.cone(place, UP if along is None else along, size_mm, np.radians(other), points=n)
    if kind == "distance":
        return features.plane_distance(place, across if along is None else along, size_mm, other, points=n)
    edge = np.cross(across, UP) if along is None else along
    return features.plane_angle(place, edge, np.radians(other), size_mm, points=n)


def _postures(arm: Arm, tips: FloatArray, where: Stance, swing: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Nominal postures: the working pose turned to the tips and swung, (n, n_joints) [rad]."""
    out = arm.working + swing + _SWING_OF_POINT_RAD * rng.standard_normal(swing.shape)
    out[:, 0] += azimuth_of(tips, where)
    inside: FloatArray = np.clip(out, *inner_limits(arm))
    return inside


def _turned(directions: FloatArray, lean: FloatArray) -> FloatArray:
    """Directions (n, 3) turned by the shortest rotation from straight up to `lean`."""
    axis = np.array([-lean[1], lean[0], 0.0])
    # Rodrigues' formula with |axis| the sine of the angle.
    across = np.cross(axis, directions)
    turned: FloatArray = directions + across + np.cross(axis, across) / (1 + lean[2])
    return turned
