"""Functions of a joint's own angle and of the way it came."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray


def harmonics(angles: npt.ArrayLike, orders: Sequence[float]) -> FloatArray:
    """Cosine and sine of multiples of joint angles.

    Order 1 is what an eccentric grating does to an encoder, 2 a tilted or oval disc, 4 what four read heads leave;
    bearings show orders 1 and 2. Orders need not be whole: a ball cage turns at about 0.4 of the shaft. Whole
    orders repeat after a full turn, others go on with the angle's turns.

    Parameters
    ----------
    angles : (...) array
        [rad].
    orders : sequence of float
        The multiples k.

    Returns
    -------
    (..., n_orders, 2) array
        ``cos k q, sin k q`` for each order.
    """
    turns = np.asarray(angles, dtype=float)[..., None] * np.asarray(orders, dtype=float)
    return np.stack([np.cos(turns), np.sin(turns)], axis=-1)


def directions(angles: npt.ArrayLike) -> FloatArray:
    """Sign of each joint's last movement in a sequence of readings, (n, n_joints).

    A joint that stands still keeps its sign; before its first movement it counts as 0.
    """
    angles = np.asarray(angles, dtype=float)
    signs = np.sign(np.diff(angles, axis=0, prepend=angles[:1]))
    last_moved = np.where(signs != 0, np.arange(len(signs))[:, None], 0)
    return np.take_along_axis(signs, np.maximum.accumulate(last_moved, axis=0), axis=0)
