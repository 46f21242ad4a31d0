"""Joint angles in another unit, order or sign, where most are outside the trained range."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from truearm.models.training_conditions import TrainingConditions
from truearm.typing import BoolArray, FloatArray, IntArray

# Another unit, order or sign is likely where most poses as stated are outside, and most poses so read are inside.
MOST = 0.5
# Poses that are compared, evenly spaced.
MAX_COMPARED = 500


def doubt_about_angles(training: TrainingConditions, angles: FloatArray, prismatic: BoolArray) -> tuple[str, ...]:
    """That most poses (n, n_joints) are outside the trained range, and what may be wrong; nothing if most are inside.

    Parameters
    ----------
    training : TrainingConditions
    angles : (n, n_joints) array
        [rad, or mm].
    prismatic : (n_joints,) bool array
        Which joints slide.
    """
    outside = training.poses_outside(angles, prismatic)
    if outside.mean() <= MOST:
        return ()
    said = f"{outside.sum()} of {len(angles)} poses are outside the trained range"
    some = angles[np.linspace(0, len(angles) - 1, min(len(angles), MAX_COMPARED)).round().astype(int)]
    found = [(1 - training.poses_outside(q, prismatic).mean(), what) for what, q in _interpretations(some, prismatic)]
    share, what = max(found, key=lambda one: one[0])
    if share < MOST:
        return (f"{said}: the model was not fitted to such poses.",)
    return (f"{said}, and {share:.0%} would be inside if {what}.",)


def _interpretations(angles: FloatArray, prismatic: BoolArray) -> Iterator[tuple[str, FloatArray]]:
    """What else angles may be, the more likely before the less likely."""
    n, turning = angles.shape[1], np.flatnonzero(~prismatic)
    for unit, factor in (("rad", np.degrees(1.0)), ("deg", np.radians(1.0))):
        what = f"the angles were in {unit}: check the unit in the names of the columns"
        yield what, angles * np.where(prismatic, 1.0, factor)
    for number in sorted({1, 2, len(turning)}):
        for joints in combinations(turning.tolist(), number):
            names = "all joints" if number == n > 1 else " and ".join(f"J{joint + 1}" for joint in joints)
            yield f"{names} turned the other way: check the sign", angles * np.where(np.isin(range(n), joints), -1, 1)
    order: IntArray = np.arange(n)
    orders = {f"J{a + 1} and J{b + 1} were exchanged": _exchanged(order, a, b) for a, b in combinations(range(n), 2)}
    orders |= {"the joints were in reverse order": order[::-1], "the last joint came first": np.roll(order, 1)}
    orders |= {"the first joint came last": np.roll(order, -1)}
    for what, columns in orders.items():
        yield f"{what}: check the order of the columns", angles[:, columns]


def _exchanged(order: IntArray, a: int, b: int) -> IntArray:
    out = order.copy()
    out[[a, b]] = b, a
    return out
