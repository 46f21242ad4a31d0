"""Joint zeros of an identified arm: how far its table is from the drawing, and the drawing with other zeros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.arm.nearest_table import drawn_convention, drawn_table, nearest_table
from truearm.arm.rigid_motions import screw_z
from truearm.typing import FloatArray

COLUMNS = ("theta", "alpha", "beta", "a", "d", "b")


def table_changes(chain: Chain, arm: Arm, *, free: Sequence[str] = ("base", "tip")) -> dict[str, FloatArray]:
    """By how much the constants of an identified chain differ from those of the drawing, row by row.

    What no reading of the tip separates from a free base or tip, as the zero of the first joint and of the last, does
    not differ (see `nearest_table`).

    Parameters
    ----------
    chain : Chain
        The identified one.
    arm : Arm
        The nominal one.
    free : sequence of str
        Which of ``"base"`` and ``"tip"`` are unknown.

    Returns
    -------
    dict of str to (n_joints,) array
        theta, alpha, beta [rad], a, d, b [mm].

    Raises
    ------
    InputError
        If an axis is far from that of the drawing.
    """
    convention = drawn_convention(arm.chain)
    found, drawn = nearest_table(chain, arm.chain, convention=convention, free=free), drawn_table(arm.chain, convention)
    return {name: getattr(found, name) - getattr(drawn, name) for name in COLUMNS}


def joint_zeros(chain: Chain, arm: Arm, *, free: Sequence[str] = ("base", "tip")) -> FloatArray:
    """(n_joints,) what is to be added to the angles of a nominal arm, or to its thetas [rad; of sliding joints mm, d].

    Parameters and errors are those of `table_changes`.
    """
    changes = table_changes(chain, arm, free=free)
    return np.where(arm.chain.is_prismatic, changes["d"], changes["theta"])


def with_zeros(arm: Arm, zeros: FloatArray) -> Arm:
    """The nominal arm with zeros (n_joints,) added to its own [rad; of sliding joints mm]; all else is unchanged."""
    fixed = arm.chain.fixed.copy()
    for joint, (zero, slides) in enumerate(zip(zeros.tolist(), arm.chain.is_prismatic, strict=True), 1):
        fixed[joint] = screw_z(*((0.0, zero) if slides else (zero, 0.0))) @ fixed[joint]
    return replace(arm, chain=replace(arm.chain, fixed=fixed), table=None)
