"""The terms of an arm: what is known to make one differ from its drawing.

The standard deviations here are where evidence starts from, of the size found on industrial and measuring arms.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from truearm.arm.chain import Chain
from truearm.arm.masses import LinkMasses
from truearm.errors import InputError
from truearm.identification.terms.basis import (
    AXES,
    Basis,
    Column,
    Constant,
    Direction,
    GravityTorque,
    Harmonics,
    Temperature,
)
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.identification.terms.thermal import link_vectors
from truearm.typing import FloatArray

# What is free still has a prior, wide beyond any workshop: on an arm of few joints a shift of the base may look like
# one of the tip, and then it decides.
FREE_BASE = (1.0, 1.0, 1.0, 1e4, 1e4, 1e4)  # rad, mm
FREE_TIP = 1e3  # mm
FREE_TOOL = 1.0  # rad

OWN_AXIS = 2  # rotation about z among a motion's six components
# Beyond 101, the ratio of the strain-wave gears common in robots: one period a turn of the wave generator.
HIGHEST_ORDER_OFFERED = 110
OWN_AXIS_STD = 2e-4  # rad
# Periods in a turn over which encoders with gratings or poles of powers of two interpolate.
INTERPOLATION_ORDERS = (128, 256, 512)
INTERPOLATION_STD = 2e-5  # rad
WOBBLE_ORDERS = (1, 2)
WOBBLE_ANGLE_STD, WOBBLE_LENGTH_STD = 5e-4, 0.2  # rad, mm; at order 1
GRAVITY_STD = 2e-5  # rad/(N m)
GROWTH_STD = 1e-5  # 1/K: steel 1.2e-5, aluminium 2.3e-5, carbon fibre 1e-6
HYSTERESIS_STD = {"turns": 5e-5, "slides": 0.02}  # rad, mm
COLUMN_STD = {"turns": 1e-4, "slides": 0.05}  # rad, mm, by a column's spread

# Cosine of the angle between a component and a joint's axis from which on one does as the other.
AS_GOOD_AS_ALONG = 0.99

# A joint that moved by less than a quarter of a harmonic's period shows a slope of it at most.
LEAST_PHASE = np.pi / 2


class SkippedTerm(NamedTuple):
    """A term not offered.

    Attributes
    ----------
    name : str
    reason : str
        What the readings lack.
    """

    name: str
    reason: str


def constants(
    chain: Chain, *, free: tuple[str, ...] = ("base", "tip"), angle_std: float = 3e-3, length_std: float = 3.0
) -> list[Term]:
    """Constant motions of all places: lengths, offsets, twists and zeros of the joints, base and tip.

    What a free base or tip can make up for, as a shift along the last joint's axis, keeps its prior too: readings tell
    it together with that only, or by traces of other terms, and must not size the other lengths by them.

    Parameters
    ----------
    chain : Chain
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown altogether: their priors are wide and stay.
    angle_std, length_std : float
        Prior standard deviation of the others' rotations [rad] and shifts [mm]; 0 leaves them out.

    Raises
    ------
    InputError
        If something else than base and tip is to be free.
    """
    unknown = set(free) - {"base", "tip"}
    if unknown:
        raise InputError(f"expected free parts among ['base', 'tip'], got {sorted(unknown)}")
    terms = []
    for place in range(chain.n_places):
        part = place_name(chain, place)
        for component in range(3 if part == "tip" else 0, 6):  # turning about the tip moves nothing
            turns = component < 3
            if part in free:
                std, group = FREE_BASE[component] if part == "base" else FREE_TIP, part
            else:
                std = angle_std if turns else length_std
                group = (
                    "joint zeros" if component == OWN_AXIS else "axis directions" if turns else "lengths and offsets"
                )
                for other in free:
                    if (place, component) in _made_up_for(chain, other):
                        group = f"what a free {other} makes up for"
            if std != 0:
                name = f"{part} {_component_name(component)}"
                learn = group in ("joint zeros", "axis directions", "lengths and offsets")
                terms.append(Term(name, place, _unit(component), Constant(), group, std, learn=learn))
    return terms


def _made_up_for(chain: Chain, part: str) -> set[tuple[int, int]]:
    """Constants (place, component) that a motion of base or tip does the same as."""
    if part == "base":
        return {(1, OWN_AXIS), (1, OWN_AXIS + 3)}
    n = chain.n_joints
    along_last = np.abs(chain.fixed[n - 1, :3, 2]) > AS_GOOD_AS_ALONG
    return {(n, c) for c in range(3, 6)} | {(n - 1, 3 + int(c)) for c in np.flatnonzero(along_last) if n > 1}


def base_terms(chain: Chain) -> list[Term]:
    """The six motions of a base of which nothing is known."""
    return [term for term in constants(chain, free=("base",), angle_std=0.0, length_std=0.0) if term.place == 0]


def tool_rotation(chain: Chain) -> list[Term]:
    """Rotation of the tool on the flange, free altogether; only references that see orientations need it."""
    tip = chain.n_places - 1
    return [
        Term(f"tip {_component_name(component)}", tip, _unit(component), Constant(), "tool", FREE_TOOL, learn=False)
        for component in range(3)
    ]


def own_axis(chain: Chain, joint: int, *, highest: int = HIGHEST_ORDER_OFFERED) -> list[Term]:
    """Rotation about a joint's own axis by harmonics of its angle: encoder, gear, what turns with the joint.

    Orders stand in bands, 1 to 2, 3 to 4, 5 to 8 and so on, each a group with a scale of its own, which the joints of
    an arm share: they are of one make. Together they are a Gaussian process on the circle with a staircase as spectrum,
    and the evidence of each step decides how far up the orders go. No terms for a sliding joint.

    Parameters
    ----------
    chain : Chain
    joint : int
        Counted from 1.
    highest : int
        Highest order.
    """
    return [_own_axis_band(joint, band, band) for band in _bands(highest) if _turns(chain, joint)]


def interpolation(chain: Chain, joint: int, orders: tuple[int, ...] = INTERPOLATION_ORDERS) -> list[Term]:
    """Rotation about a joint's own axis by the sub-divisional error of its encoder, one term for each order.

    An encoder reads its grating's periods whole and interpolates between them, with an error that repeats with the
    period. Each order is a group, which the joints of an arm share. No terms for a sliding joint.

    Parameters
    ----------
    chain : Chain
    joint : int
        Counted from 1.
    orders : tuple of int
        Periods in a turn.
    """
    if not _turns(chain, joint):
        return []
    return [
        Term(
            f"J{joint} interpolation, order {k}",
            joint,
            _unit(OWN_AXIS),
            Harmonics(joint, (k,)),
            f"interpolation, order {k}",
            INTERPOLATION_STD,
        )
        for k in orders
    ]


def wobble(chain: Chain, joint: int, orders: tuple[int, ...] = WOBBLE_ORDERS) -> list[Term]:
    """Tilt and run-out of a joint: the five motions besides its own, by low harmonics of its angle.

    No terms for a sliding joint.
    """
    if not _turns(chain, joint):
        return []
    terms = []
    for component in range(6):
        if component != OWN_AXIS:
            turns = component < 3
            std = WOBBLE_ANGLE_STD if turns else WOBBLE_LENGTH_STD
            terms.append(
                Term(
                    f"J{joint} wobble, {_component_name(component)}",
                    joint,
                    _unit(component),
                    Harmonics(joint, orders),
                    f"wobble, {'rotations' if turns else 'shifts'}",
                    tuple(std / k for k in orders for _ in range(2)),
                )
            )
    return terms


def gravity(chain: Chain, joint: int, *, links: LinkMasses | None = None) -> list[Term]:
    """Rotations of a joint by the torque of the weight there: bending of links and joints, give of drives.

    Parameters
    ----------
    chain : Chain
    joint : int
        Counted from 1; 0 is the base, which tilts by what joint 1 carries.
    links : LinkMasses, optional
        The masses the torques will be reckoned with. Without them the terms' names say that weights are taken as
        uniform.
    """
    if joint:
        _turns(chain, joint)
    guess = "" if links is not None else " (weights taken as uniform)"
    return [
        Term(
            f"{place_name(chain, joint)} {_component_name(about)} by the weight's torque about {AXES[axis]}{guess}",
            joint,
            _unit(about),
            GravityTorque(joint, axis),
            "give of the drives" if about == axis == OWN_AXIS else "bending",
            GRAVITY_STD,
        )
        for about in range(3)
        for axis in range(3)
    ]


def thermal(chain: Chain) -> list[Term]:
    """Growth of the stand and of every link along itself; the coefficient is its expansion [1/K]."""
    return [
        Term(
            f"growth of {f'link {i}' if i else 'the stand'} with temperature",
            i,
            (0.0, 0.0, 0.0, *vector.tolist()),
            Temperature(i),
            "thermal growth",
            GROWTH_STD,
        )
        for i, vector in enumerate(link_vectors(chain))
        if vector.any()
    ]


def hysteresis(chain: Chain, joint: int) -> list[Term]:
    """Motion about, or along, a joint's own axis by the direction it came from: backlash, friction's wind-up."""
    component, how = _own_motion(chain, joint)
    name, group = f"J{joint} hysteresis", f"hysteresis of what {how}"
    return [Term(name, joint, _unit(component), Direction(joint), group, HYSTERESIS_STD[how])]


def column(chain: Chain, joint: int, name: str, *, prior_std: float) -> list[Term]:
    """Motion about, or along, a joint's own axis in proportion to a column of the session, such as the joint's torque.

    Parameters
    ----------
    chain : Chain
    joint : int
        Counted from 1.
    name : str
        The column. It has a group of its own, as its unit may be any.
    prior_std : float
        [rad, of a sliding joint mm, per unit of the column].
    """
    component, _ = _own_motion(chain, joint)
    title = f"J{joint} {_component_name(component)} by {name}"
    return [Term(title, joint, _unit(component), Column(name), name, prior_std)]


def candidate_terms(
    state: ArmState, *, free: tuple[str, ...] = ("base", "tip"), highest: int = HIGHEST_ORDER_OFFERED
) -> tuple[list[Term], list[SkippedTerm]]:
    """Offer all terms that the readings allow, and say which they do not.

    A harmonic is left out where the joint moved by less than a quarter of its period, or where the joint's angles stand
    half a period apart or more, so that it could not be told from a lower one. A function that is the same at
    every reading is left out as it cannot be told from a constant.

    Parameters
    ----------
    state : ArmState
        Of the readings to learn from.
    free : tuple of str
        As in `constants`.
    highest : int
        Highest order about the joints' own axes.

    Returns
    -------
    terms : list of Term
    left_out : list of SkippedTerm
    """
    chain, joints = state.chain, range(1, state.chain.n_joints + 1)
    left_out: list[SkippedTerm] = []
    terms = constants(chain, free=free)
    wobbles: list[Term] = []
    for joint in joints:
        if chain.is_prismatic[joint - 1]:
            left_out.append(SkippedTerm(f"J{joint} harmonics", f"J{joint} slides"))
            continue
        shown, lost = _shown_orders(joint, state.angles[:, joint - 1], max(highest, *WOBBLE_ORDERS))
        left_out += lost
        for band in _bands(highest):
            if kept := tuple(k for k in band if k in shown):
                terms.append(_own_axis_band(joint, kept, band))
        # Few sets of readings are fine enough for these; that they are not is no news.
        fine, _ = _shown_orders(joint, state.angles[:, joint - 1], INTERPOLATION_ORDERS[-1])
        terms += interpolation(chain, joint, tuple(k for k in INTERPOLATION_ORDERS if k in fine))
        if kept := tuple(k for k in WOBBLE_ORDERS if k in shown):
            wobbles += wobble(chain, joint, kept)
    terms += wobbles
    offered = [term for joint in range(chain.n_joints + 1) for term in gravity(chain, joint, links=state.links)]
    if state.temperature_degC is None:
        left_out.append(SkippedTerm("thermal growth", "the readings have no temperature"))
    else:
        offered += thermal(chain)
    if state.directions is None:
        left_out.append(SkippedTerm("hysteresis", "the joints' directions of movement are not known"))
    else:
        offered += [term for joint in joints for term in hysteresis(chain, joint)]
    offered += _loads(state, left_out)
    return terms + list(_varying(offered, state, left_out)), left_out


def place_name(chain: Chain, place: int) -> str:
    """Name of a place: base, J1 to Jn, tip."""
    return "base" if place == 0 else "tip" if place == chain.n_joints + 1 else f"J{place}"


def _shown_orders(joint: int, angles: FloatArray, highest: int) -> tuple[set[int], list[SkippedTerm]]:
    """Which harmonics a joint's angles can show, and which not."""
    moved = float(np.ptp(angles)) if len(angles) else 0.0
    if moved >= 2 * np.pi:
        angles = np.mod(angles, 2 * np.pi)
    n_angles = _count_apart(angles, LEAST_PHASE / 2 / highest)
    # Half a period between neighbours, but for rounding: from there on a harmonic looks like one of lower order.
    widest = 0.999 * np.pi * (n_angles - 1)
    orders = range(1, highest + 1)
    slow = [k for k in orders if k * moved < LEAST_PHASE]
    fast = [k for k in orders if k not in slow and k * min(moved, 2 * np.pi) > widest]
    lost = [
        SkippedTerm(f"J{joint} {_orders_name(orders)}", reason)
        for orders, reason in (
            (slow, f"J{joint} moved by {np.degrees(moved):.3g} deg only"),
            (fast, f"J{joint} stood at {n_angles} angles only"),
        )
        if orders
    ]
    return set(orders) - {*slow, *fast}, lost


def _count_apart(values: FloatArray, apart: float) -> int:
    """Count values, those closer than `apart` to the first of them as one."""
    values, n, at = np.sort(values), 0, 0
    while at < len(values):
        n, at = n + 1, int(np.searchsorted(values, values[at] + apart, side="right"))
    return n


def _loads(state: ArmState, left_out: list[SkippedTerm]) -> Iterator[Term]:
    """Terms by the columns whose names say which joint's load they are, ``load_2_Nm``."""
    for name, values in state.columns.items():
        joint = int(found[1]) if (found := re.match(r"load_(\d{1,3})(?:_|$)", name)) else 0
        if not 1 <= joint <= state.chain.n_joints:
            left_out.append(SkippedTerm(name, "its name does not say which joint it acts on"))
            continue
        _, how = _own_motion(state.chain, joint)
        spread = float(np.std(values)) if len(values) else 0.0
        yield from column(state.chain, joint, name, prior_std=COLUMN_STD[how] / (spread or 1.0))


def _varying(terms: Iterable[Term], state: ArmState, left_out: list[SkippedTerm]) -> Iterator[Term]:
    """Pass on the terms whose function changes from reading to reading."""
    varies: dict[Basis, bool] = {}
    for term in terms:
        if term.basis not in varies:
            values = term.basis.values(state)
            size = max(1.0, float(np.abs(values).max(initial=0.0)))
            varies[term.basis] = values.size > 0 and bool(np.ptp(values) > 1e-9 * size)  # more than rounding
            if not varies[term.basis]:
                left_out.append(SkippedTerm(term.basis.labels()[0], "it is the same at every reading"))
        if varies[term.basis]:
            yield term


def _own_axis_band(joint: int, orders: tuple[int, ...], band: tuple[int, ...]) -> Term:
    name = f"J{joint} own axis, {_orders_name(orders)}"
    group = f"own axis, {_orders_name(band)}"
    return Term(name, joint, _unit(OWN_AXIS), Harmonics(joint, orders), group, OWN_AXIS_STD)


def _bands(highest: int) -> list[tuple[int, ...]]:
    """1 to 2, 3 to 4, 5 to 8, ... up to the highest."""
    ends = [0, *(2**i for i in range(1, max(highest, 1).bit_length() + 1))]
    bands = [tuple(range(low + 1, min(high, highest) + 1)) for low, high in pairwise(ends)]
    return [band for band in bands if band]


def _orders_name(orders: Sequence[int]) -> str:
    return f"orders {orders[0]} to {orders[-1]}" if len(orders) > 1 else f"order {orders[0]}"


def _turns(chain: Chain, joint: int) -> bool:
    """Whether a joint of the chain, counted from 1, turns."""
    if not 1 <= joint <= chain.n_joints:
        raise InputError(f"expected a joint from 1 to {chain.n_joints}, got {joint}")
    return not chain.is_prismatic[joint - 1]


def _own_motion(chain: Chain, joint: int) -> tuple[int, str]:
    """Component of a motion that the joint itself makes, and whether it turns or slides."""
    return (OWN_AXIS, "turns") if _turns(chain, joint) else (OWN_AXIS + 3, "slides")


def _unit(component: int) -> tuple[float, ...]:
    return tuple(float(i == component) for i in range(6))


def _component_name(component: int) -> str:
    return f"rotation about {AXES[component]}" if component < 3 else f"shift along {AXES[component - 3]}"
