"""Orders of harmonics: which of them the angles of a joint can determine, and their bands."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from truearm.identification.terms.term import SkippedTerm
from truearm.typing import FloatArray

# A joint that moved by less than a quarter of a harmonic's period shows at most its slope.
LEAST_PHASE = np.pi / 2


def determined_orders(joint: int, angles: FloatArray, highest: int) -> tuple[set[int], list[SkippedTerm]]:
    """Orders of harmonics that the angles of a joint can determine, and the skipped ones."""
    moved, n_angles = _on_the_circle(angles, LEAST_PHASE / 2 / highest)
    # Half a period between neighbours, less rounding: above it a harmonic is indistinguishable from a lower order.
    widest = 0.999 * np.pi * (n_angles - 1)
    orders = range(1, highest + 1)
    slow = [k for k in orders if k * moved < LEAST_PHASE]
    fast = [k for k in orders if k not in slow and k * moved > widest]
    lost = [
        SkippedTerm(f"J{joint} {orders_name(orders)}", reason)
        for orders, reason in (
            (slow, f"J{joint} moved by only {np.degrees(moved):.3g} deg"),
            (fast, f"J{joint} has readings at only {n_angles} angles"),
        )
        if orders
    ]
    return set(orders) - {*slow, *fast}, lost


def _on_the_circle(angles: FloatArray, apart: float) -> tuple[float, int]:
    """The arc on which all angles lie [rad], and how many there are: those closer than `apart` to one count with it.

    Harmonics know neither turns nor zeros of a joint, so the count begins behind the widest gap.
    """
    if not len(angles):
        return 0.0, 0
    ordered = np.sort(np.mod(angles, 2 * np.pi))
    gaps = np.diff(ordered, append=ordered[0] + 2 * np.pi)
    widest = int(gaps.argmax())
    along = np.concatenate([[0.0], np.cumsum(np.roll(gaps, -widest - 1)[:-1])])
    return 2 * np.pi - float(gaps[widest]), count_apart(along, apart)


def count_apart(values: FloatArray, apart: float) -> int:
    """Count sorted values; values closer than `apart` to the first of them count as one."""
    n = at = 0
    while at < len(values):
        n, at = n + 1, int(values.searchsorted(values[at] + apart, side="right"))
    return n


def bands(highest: int) -> list[tuple[int, ...]]:
    """1 to 2, 3 to 4, 5 to 8, ... up to the highest."""
    ends = [0, *(2**i for i in range(1, max(highest, 1).bit_length() + 1))]
    found = [tuple(range(low + 1, min(high, highest) + 1)) for low, high in pairwise(ends)]
    return [band for band in found if band]


def orders_name(orders: Sequence[int]) -> str:
    """Orders in words."""
    return f"orders {orders[0]} to {orders[-1]}" if len(orders) > 1 else f"order {orders[0]}"
