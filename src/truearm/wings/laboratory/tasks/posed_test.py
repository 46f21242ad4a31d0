"""Joint angles for the points of a standard's test."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.sampling import farthest_points
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.wings.laboratory.standards.artefacts import Artefacts, example_artefacts
from truearm.wings.laboratory.standards.layout import Placement, lay_out_tests
from truearm.wings.laboratory.standards.specification import Specification, example_specification
from truearm.wings.laboratory.standards.verification_plan import VerificationPlan
from truearm.wings.planning.designs.sampling import check_five_rotary_joints, inner_limits, postures, reach
from truearm.wings.planning.designs.workspace import azimuth_of, stance, within_cone

# Spread of the postures from group to group, and within a group: swing of the elbow, roll of the handle.
SWING_DEG, ROLL_DEG, WITHIN_DEG, NEAR_DEG = 35.0, 60.0, 3.0, 45.0
# Allowed angle of the stylus to the planned direction in successive tries.
LEANS_DEG = (0.0,) * 6 + (15.0,) * 6 + (30.0,) * 6 + (45.0,) * 6 + (60.0,) * 12
# In a seat: angle of the stylus, distance of postures from the working pose per joint; candidates per point, tries.
SEAT_LEAN_DEG, SEAT_SWING_DEG, SEAT_POOL, SEAT_TRIES = 60.0, 100.0, 10, 10
# Without a specification, the measuring range is the largest of these shares of the links' length that is reached.
RANGE_SHARES = (1.0, 0.9, 0.8, 0.7, 0.6)
# First word of the stream, different from those of the arms' own errors.
_POSES = 4


@dataclass(frozen=True, eq=False)
class PosedTest:
    """A layout with joint angles for each of its points, solved once for the nominal arm.

    Attributes
    ----------
    arm : Arm
    placements : tuple of Placement
    angles : (n, n_joints) array
        Poses with the nominal tip on the points, placement by placement [rad].
    placement : (n,) array of int
        Placement of each pose.
    """

    arm: Arm
    placements: tuple[Placement, ...]
    angles: FloatArray
    placement: IntArray

    @property
    def points(self) -> FloatArray:
        """The nominal points, (n, 3) [mm]."""
        return np.concatenate([one.points for one in self.placements])


def pose(layout: Sequence[Placement], arm: Arm, *, seed: int) -> PosedTest:
    """Solve for joint angles at every point of a layout.

    The points of one group have nearly the same posture, different for each group, about the working pose turned to the
    artefact. The points of one seat have postures as different as possible, the stylus within 60 deg of the seat's
    axis. Elsewhere the stylus points against the planned approach; if no posture allows that, it leans up to 60 deg.

    Parameters
    ----------
    layout : sequence of Placement
    arm : Arm
        Base z up, at least five rotary joints.
    seed : int

    Raises
    ------
    InputError
        If the arm has too few joints, or does not reach some points; the message names them and the reasons.
    """
    check_five_rotary_joints(arm)
    rng = np.random.default_rng([_POSES, seed])
    layout = tuple(layout)
    sizes = np.array([len(one.points) for one in layout])
    placement = np.repeat(np.arange(len(layout)), sizes)
    angles = np.full((len(placement), arm.n_joints), np.nan)
    free = np.array([one.test != "single_point" for one in layout])
    base = stance(arm)
    points = np.concatenate([one.points for one in layout])
    beyond = np.linalg.norm(points - base.shoulder_in_base, axis=1) > base.reach_mm
    unreached = Counter((int(i), "beyond the arm's links") for i in placement[beyond])
    if not unreached:
        for i in np.flatnonzero(~free):
            found = _seat_postures(layout[i], arm, rng)
            if found is None:
                unreached[int(i), "too few postures"] = len(layout[i].points)
            else:
                angles[placement == i] = found
        unreached += _reach_groups(layout, arm, angles, placement, free[placement], rng)
    if unreached:
        raise InputError(
            f"arm {arm.name!r} does not reach {unreached.total()} of {len(placement)} points: "
            f"{_unreached(layout, unreached)}",
            hint=f"use a smaller measuring range (at most twice the reach of {base.reach_mm:.0f} mm), or a plan of "
            "your own (truearm verify plan) without these places: fewer positions, or required = false",
        )
    return PosedTest(arm, layout, angles, placement)


def pose_test(
    arm: Arm, plan: VerificationPlan, *, artefacts: Artefacts | None, specification: Specification | None, seed: int
) -> tuple[Specification, Artefacts, PosedTest]:
    """The test with poses for an arm, with examples for what is not given.

    The measuring range is that of the specification; without one, the largest in which the arm reaches all points.

    Parameters
    ----------
    arm : Arm
    plan : VerificationPlan
    artefacts : Artefacts or None
    specification : Specification or None
    seed : int

    Raises
    ------
    InputError
        If the arm does not reach all points.
    """
    check_five_rotary_joints(arm)
    where = stance(arm)
    for share in RANGE_SHARES:
        whole = 2 * share * where.reach_mm
        # In round numbers, as on data sheets.
        limits = specification or example_specification(100 * int(whole / 100) or whole)
        certified = artefacts or example_artefacts(limits.measuring_range_mm)
        shoulder_mm = float(where.shoulder_in_base[2])
        layout = lay_out_tests(plan, certified, limits.measuring_range_mm, shoulder_mm=shoulder_mm)
        try:
            return limits, certified, pose(layout, arm, seed=seed)
        except InputError as error:
            if specification is not None:
                hint = f"{error.hint}; without a specification, truearm looks for a range that the arm reaches"
                raise InputError(error.problem, hint=hint) from None
            if share == RANGE_SHARES[-1] or where.reach_mm == 0:
                raise
    raise AssertionError("the last share returns or raises")


def _unreached(layout: Sequence[Placement], unreached: Mapping[tuple[int, str], int]) -> str:
    """Describe the tests that are not reached, with positions and reasons; lengths and groups if others are reached."""
    out = []
    for test in dict.fromkeys(one.test for one in layout):
        why: Counter[str] = Counter()
        for (i, reason), count in unreached.items():
            if layout[i].test == test:
                why[reason] += count
        if not why:
            continue
        parts = [test]
        for key in ("position", "length", "group"):
            planned = dict.fromkeys(one.keys[key] for one in layout if one.test == test and key in one.keys)
            here = {layout[i].keys.get(key) for i, _ in unreached if layout[i].test == test}
            named = [value for value in planned if value in here]
            if len(named) == 1 or len(named) < len(planned):
                parts.append(f"{key} {' '.join(named)}")
            elif planned and key == "position":
                parts.append(f"all {len(planned)} positions")
        reasons = [f"{reason} ({count} x)" if count > 1 else reason for reason, count in why.items()]
        out.append(f"{', '.join(parts)}: {', '.join(reasons)}")
    return "; ".join(out)


def _seat_postures(one: Placement, arm: Arm, rng: np.random.Generator) -> FloatArray | None:
    """Postures with the tip in a seat, as different as possible, (k, n_joints) [rad]; None if there are too few."""
    k = len(one.points)
    m = SEAT_POOL * k
    tips, axes, base = np.tile(one.at, (m, 1)), np.tile(-one.approach[0], (m, 1)), stance(arm)
    good = np.empty((0, arm.n_joints))
    for _ in range(SEAT_TRIES):
        posture = arm.working + np.radians(SEAT_SWING_DEG) * rng.uniform(-1, 1, (m, arm.n_joints))
        posture[:, 0] += azimuth_of(tips, base)
        leaning = within_cone(axes, half_angle_rad=np.radians(SEAT_LEAN_DEG), rng=rng)
        angles, reason = reach(arm, tips, leaning, np.clip(posture, *inner_limits(arm)))
        good = np.concatenate([good, angles[reason == ""]])
        if len(good) >= 3 * k:
            break
    return good[farthest_points(good, k)] if len(good) >= k else None


def _reach_groups(
    layout: tuple[Placement, ...],
    arm: Arm,
    angles: FloatArray,
    placement: IntArray,
    free: BoolArray,
    rng: np.random.Generator,
) -> Counter[tuple[int, str]]:
    """Fill in angles row by row; return the numbers of unreached points by placement and reason."""
    if not free.any():
        return Counter()
    points = np.concatenate([one.points for one in layout])
    approach = np.concatenate([one.approach for one in layout])
    middles = np.stack([one.at for one in layout])
    base, limits = stance(arm), inner_limits(arm)
    why = np.full(len(points), "", dtype=object)
    sizes = np.bincount(placement, minlength=len(layout))
    # Range of the joints within a group whose points were all reached at once.
    spread = np.where(np.bincount(placement, free, len(layout)) > 0, np.inf, 0.0)
    for before, lean in zip((0.0, *LEANS_DEG), LEANS_DEG, strict=False):
        if lean > before:  # complete groups stay: the stylus is better in its planned direction
            spread[np.isfinite(spread)] = 0.0
        rows = np.flatnonzero((spread > np.radians(NEAR_DEG))[placement])
        if not len(rows):
            break
        drawn = postures(arm, middles, base, swing_std_deg=SWING_DEG, roll_std_deg=ROLL_DEG, rng=rng)
        near = drawn[placement[rows]] + np.radians(WITHIN_DEG) * rng.standard_normal((len(rows), arm.n_joints))
        axes = -approach[rows]
        if lean > 0:
            axes = within_cone(axes, half_angle_rad=np.radians(lean), rng=rng)
        found, reason = reach(arm, points[rows], axes, np.clip(near, *limits))
        got = reason == ""
        why[rows[~got]] = reason[~got]
        for i in np.flatnonzero(np.bincount(placement[rows], got, len(layout)) == sizes):
            if (range_of_group := np.ptp(found[placement[rows] == i], axis=0).max(initial=0.0)) < spread[i]:
                spread[i], angles[placement == i] = range_of_group, found[placement[rows] == i]
        first = got & np.isnan(angles[rows, 0])
        angles[rows[first]] = found[first]
    remaining = np.flatnonzero(free & np.isnan(angles[:, 0]))
    return Counter((int(placement[row]), str(why[row])) for row in remaining)
