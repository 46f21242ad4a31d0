"""Errors of a linear axis before joint 2, a rail that carries the arm: slow functions of its travel.

The carriage of a machine axis has six errors that depend on its position: positioning, straightness in two directions,
roll, pitch and yaw (ISO 230-1:2012, 3.4.2). Each is a Gaussian process of the travel: harmonics of a period twice as
long as the trained travel, so that its ends are independent of each other, as are the harmonics of a joint on a circle.
Beside them the scale of the axis is a term of its own, since a rack or a warm scale is longer throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.errors import InputError
from truearm.identification.terms.basis import Basis, Harmonics, JointNumber, Number, Orders, register_basis
from truearm.identification.terms.expression import Expression
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term, count_apart
from truearm.typing import FloatArray

# Starting values of the evidence, at order 1: guides that are screwed to a floor.
ROTATION_STD, STRAIGHTNESS_STD, POSITIONING_STD = 2e-4, 0.2, 0.1  # rad, mm, mm
SCALE_STD = 1e-4
# The shortest period is a sixth of the travel.
HIGHEST_ORDER = 12
# Positions that differ by less than this share of the travel are one.
LEAST_STEP = 0.01
PERIOD_OF_TRAVEL = 2.0
# A rail that moved by less was parked [mm]: its readings show the noise of its scale.
LEAST_TRAVEL_MM = 10.0


@register_basis
@dataclass(frozen=True)
class Travel(Basis):
    """Displacement of a sliding joint from a place [mm].

    Parameters
    ----------
    joint : int
        Counted from 1.
    from_mm : float
        The place.
    """

    joint: JointNumber
    from_mm: Number

    def labels(self) -> tuple[str, ...]:
        """One function."""
        return (f"travel of J{self.joint} from {self.from_mm:g} mm",)

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.angle(self.joint) - self.from_mm,)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) displacements [mm]."""
        return np.ascontiguousarray(_slide(state, self.joint) - self.from_mm)[None]


@register_basis
@dataclass(frozen=True)
class TravelHarmonics(Basis):
    """Cosine and sine of multiples of a sliding joint's travel: ``cos k u, sin k u, ..`` with u = 2 pi q / period.

    Parameters
    ----------
    joint : int
        Counted from 1.
    period_mm : float
        Of order 1.
    orders : tuple of int
        The multiples k, rising, from 1 to 1000.
    """

    joint: JointNumber
    period_mm: Number
    orders: Orders

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.period_mm <= 0:
            raise InputError(f"expected a period above 0 mm, got {self.period_mm:g}")
        Harmonics(self.joint, self.orders)  # which refuses orders that do not rise

    def labels(self) -> tuple[str, ...]:
        """Two functions for each order."""
        names = [f"travel of J{self.joint}, period {self.period_mm / k:.4g} mm" for k in self.orders]
        return tuple(f"{function} of {name}" for name in names for function in ("cos", "sin"))

    def expressions(self) -> tuple[Expression, ...]:
        """Two functions for each order."""
        turns = [k * (2 * np.pi / self.period_mm) * Expression.angle(self.joint) for k in self.orders]
        return tuple(function for turn in turns for function in (turn.cos(), turn.sin()))

    def values(self, state: ArmState) -> FloatArray:
        """(2 n_orders, n) cosines and sines."""
        turns = np.outer(self.orders, 2 * np.pi / self.period_mm * _slide(state, self.joint))
        out = np.empty((2 * len(self.orders), len(state)))
        out[::2], out[1::2] = np.cos(turns), np.sin(turns)
        return out

    def joint_slope(self, weights: FloatArray) -> tuple[int, FloatArray]:
        """As of `Harmonics`, per mm."""
        per_mm = 2 * np.pi / self.period_mm * np.array(self.orders, dtype=float)[:, None]
        out = np.empty_like(weights)
        out[::2], out[1::2] = per_mm * weights[1::2], -per_mm * weights[::2]
        return self.joint, out


def linear_axis(joint: int, travel_mm: FloatArray) -> list[Term]:
    """Scale, positioning, straightness, roll, pitch and yaw of a sliding joint.

    Orders go as far as the positions at which it stood can tell them apart: n positions, orders below n. There are none
    of a joint that moved by less than `LEAST_TRAVEL_MM`.

    Parameters
    ----------
    joint : int
        Counted from 1.
    travel_mm : (n,) array
        Displacements of the training readings [mm].
    """
    lower, upper = float(travel_mm.min()), float(travel_mm.max())
    if upper - lower < LEAST_TRAVEL_MM:
        return []
    n_positions = count_apart(np.sort(travel_mm), LEAST_STEP * (upper - lower))
    highest = min(HIGHEST_ORDER, n_positions - 1)
    scale = Travel(joint, round((lower + upper) / 2, 3))
    terms = [Term(f"J{joint} scale", joint, _unit(5), scale, "linear axis, scale", SCALE_STD)]
    if highest < 2:
        return terms  # two positions show their distance only
    orders = tuple(range(1, highest + 1))
    basis = TravelHarmonics(joint, round(PERIOD_OF_TRAVEL * (upper - lower), 3), orders)
    names = ("pitch or yaw about x", "pitch or yaw about y", "roll", "straightness along x", "straightness along y")
    for component, name in enumerate((*names, "positioning")):
        group = "rotations" if component < 3 else "straightness" if component < 5 else "positioning"
        std = ROTATION_STD if component < 3 else STRAIGHTNESS_STD if component < 5 else POSITIONING_STD
        by_function = tuple(std / k for k in orders for _ in range(2))
        terms.append(
            Term(f"J{joint} {name} by travel", joint, _unit(component), basis, f"linear axis, {group}", by_function)
        )
    return terms


def _unit(component: int) -> tuple[float, ...]:
    return tuple(float(i == component) for i in range(6))


def _slide(state: ArmState, joint: int) -> FloatArray:
    if not 1 <= joint <= state.chain.n_joints or not state.chain.is_prismatic[joint - 1]:
        raise InputError(f"expected a sliding joint, got J{joint}")
    return state.angles[:, joint - 1]
