"""Poses of a simulated session: by a sampling strategy, or in seats and at places of a bar, with its certificate."""

from __future__ import annotations

from collections import Counter
from difflib import get_close_matches
from math import radians
from typing import Any

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.readings import Lengths
from truearm.wings.planning.designs.candidates import bar_places
from truearm.wings.planning.designs.sampling import STRATEGIES, Poses, seat

# Standard uncertainty that the certificate of a bar states for its length [mm].
BAR_U_MM = 0.005


def strategy_poses(
    arm: Arm, strategy: str, n: int, *, seed: int, seats: int | None, half_width_deg: float | None
) -> Poses:
    """Poses by the strategy of a name, with the number of seats or the half width of the box where it has them.

    Raises
    ------
    InputError
        If there is no such strategy, or a parameter does not apply to it.
    """
    if strategy not in STRATEGIES:
        close = get_close_matches(strategy, STRATEGIES, n=1)
        raise InputError(
            f"expected a strategy out of {', '.join(STRATEGIES)}, got {strategy!r}",
            hint=f"strategy {close[0]}" if close else None,
        )
    options: dict[str, Any] = {}
    if half_width_deg is not None:
        if not strategy.endswith("box"):
            raise InputError(f"a half width is for the strategies box and sobol-box, not for {strategy}")
        options["half_width"] = radians(half_width_deg)
    if seats is not None:
        if strategy != "seat":
            raise InputError(f"seats are for the strategy seat, not for {strategy}", hint="strategy seat")
        options["seats"] = seats
    return STRATEGIES[strategy](arm, n, seed=seed, **options)


def poses_with_bars(
    arm: Arm, strategy: str, n: int, *, seed: int, seats: int | None, bars: int, bar_mm: float
) -> Poses:
    """Poses in single seats and in both seats of a bar at its places, as many in each seat.

    Raises
    ------
    InputError
        If the strategy is another than seat, or there are fewer poses than seats.
    """
    if strategy != "seat":
        raise InputError(f"bars are for the strategy seat, not for {strategy}", hint="strategy seat")
    single = 3 if seats is None else seats
    each = n // (single + 2 * bars)
    if single < 1 or each < 1:
        raise InputError(f"expected at least one pose a seat, got {n} poses for {single} seats and {bars} bars")
    on_bars = bar_places(arm, bars, length_mm=bar_mm, poses=each, seed=seed)
    in_seats = seat(arm, n - len(on_bars.angles), seed=seed, seats=single)
    parts = (in_seats, on_bars)
    assert all(part.seat is not None and part.seat_points is not None for part in parts)
    return Poses(
        np.concatenate([part.angles for part in parts]),
        dict(Counter(in_seats.rejected) + Counter(on_bars.rejected)),
        np.concatenate([part.seat for part in parts if part.seat is not None]),
        np.concatenate([part.seat_points for part in parts if part.seat_points is not None]),
    )


def bar_certificate(bars: int, bar_mm: float, *, seed: int) -> Lengths:
    """What is stated for the length of the bar, the same at all its places; it does not expand."""
    stated = round(bar_mm + BAR_U_MM * np.random.default_rng([seed, *b"bar"]).standard_normal(), 4)
    ends = [np.array([f"B{place}{end}" for place in range(1, bars + 1)]) for end in "ab"]
    return Lengths(
        ends[0],
        ends[1],
        np.full(bars, stated),
        np.full(bars, BAR_U_MM),
        artefact=np.full(bars, f"bar {bar_mm:g}"),
        expansion_per_K=np.zeros(bars),
        u_expansion_per_K=np.zeros(bars),
    )
