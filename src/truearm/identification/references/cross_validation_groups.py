"""Groups of readings that cross-validation holds out together: positions, seats, regions of the joint space."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial.distance import cdist

from truearm.arm.chain import Chain
from truearm.identification.sampling import farthest_points
from truearm.identification.terms import ArmState
from truearm.readings.checks import has_reference
from truearm.readings.repeats import readings_of_one_pose
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray, IntArray

# Readings of one place are held out in this many regions of the joint space, of two readings or more on average.
REGIONS = 12
# Farthest distance of a tip of the nominal arm from the mean tip, as a share of the reach, at readings of one place.
# Within a tenth of the reach loads and lever arms hardly differ.
PLACE_RADIUS = 0.1
# Iterations of k-means from starts that are already apart.
MEANS_ROUNDS = 10


def is_in_one_place(has_point: BoolArray, state: ArmState) -> bool:
    """Whether all readings are of one place, and none `has_point` (n,) of a reference instrument.

    The tip then hardly moved: seats of one place, a small sphere. No reading shows what the terms do elsewhere.
    """
    if has_point.any():
        return False
    tips = state.chain.tip_in_base(state.angles)
    farthest = np.linalg.norm(tips - tips.mean(axis=0), axis=1).max()
    return bool(farthest <= PLACE_RADIUS * state.chain.reach)


def cross_validation_groups(readings: Session, sessions: Iterable[str] = ()) -> IntArray:
    """(n,) numbers of the groups that a fair test keeps together.

    A reading's group is its position; without one, its seat; without both, its pose: distances to several
    anchors, several tips and directions of approach in one pose are together. A column that would put all readings
    into one group, but for those that show nothing, is ignored, and so is one that would put all points of one of
    `sessions` into one group, as nothing else would determine its frame. See `joint_space_regions` for readings of one
    place.
    """
    n = len(readings)
    group = readings_of_one_pose(readings)
    shows = has_reference(readings)
    if readings.seat is not None:  # a reading alone in a seat shows nothing without a point
        _, seat, count = np.unique(readings.seat, return_inverse=True, return_counts=True)
        shows &= readings.has_point | (readings.seat == "") | (count[seat] > 1)
    in_one_frame = [(readings.session == name) & readings.has_point for name in sessions]
    for start, names in ((n, readings.seat), (2 * n, readings.position)):
        if names is not None:
            named = np.where(names != "", start + np.unique(names, return_inverse=True)[1], group)
            for rows in (shows, *in_one_frame):
                if len(np.unique(named[rows])) == 1:
                    named[rows] = group[rows]
            group = named
    return np.unique(group, return_inverse=True)[1].astype(np.intp)


def joint_space_regions(angles: FloatArray, chain: Chain) -> IntArray:
    """(n,) numbers of up to `REGIONS` regions of the joint space: means of k, from readings far from one another.

    Seats of one place are as far apart as the poses in them differ, not as their names. Readings of neighbouring poses
    have nearly the same error, and a test that keeps one of two neighbours is too easy (D. R. Roberts and others,
    "Cross-validation strategies for data with temporal, spatial, hierarchical, or phylogenetic structure", Ecography 40
    (2017) 913). Angles are compared on the circle, so neither turns nor zeros of the joints matter; displacements in
    units of their range.

    Parameters
    ----------
    angles : (n, n_joints) array
        [rad, or mm].
    chain : Chain
    """
    sliding: BoolArray = chain.is_prismatic
    displacements = angles[:, sliding]
    width = np.ptp(displacements, axis=0)
    turning = angles[:, ~sliding]
    at = np.hstack([np.cos(turning), np.sin(turning), displacements / np.where(width > 0, width, 1.0)])
    n = min(REGIONS, len(at) // 2)
    centres = at[farthest_points(at, n)] if n > 1 else at[:0]
    if len(np.unique(centres, axis=0)) < 2:
        return np.arange(len(at), dtype=np.intp)
    for _ in range(MEANS_ROUNDS):
        region = np.unique(cdist(at, centres).argmin(axis=1), return_inverse=True)[1]
        centres = np.stack([np.bincount(region, column) / np.bincount(region) for column in at.T], axis=1)
    return np.asarray(region, dtype=np.intp)
