"""A term: one cause by which a real arm differs from its nominal model.

Of harmonics the angles of a joint determine some orders, which are offered in bands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.terms.basis import Basis, Formula, basis_from_data
from truearm.identification.terms.expression import Expression, plain
from truearm.typing import FloatArray

# A joint that moved by less than a quarter of a harmonic's period shows at most its slope.
LEAST_PHASE = np.pi / 2


@dataclass(frozen=True)
class Term:
    """Small motions at one place of a chain, along one direction, shaped by basis functions.

    The motion is ``direction * sum_k x_k basis_k(state)``; identification estimates the coefficients x. Their
    prior is normal with mean zero.

    Parameters
    ----------
    name : str
    place : int
        Where the motion acts, as in `truearm.arm.chain`: 0 the base, i joint i, n_joints + 1 the tip.
    direction : tuple of 6 floats
        Rotation along the place's x, y, z, then translation along them. (0, 0, 1, 0, 0, 0) turns about z, and the
        coefficients are in rad per unit of the basis; (0, 0, 0, 1, 0, 0) shifts along x, in mm per unit.
    basis : Basis or Expression
        An expression becomes a `Formula` of one function.
    group : str
        Terms of one group share the scale of their priors.
    prior_std : float or tuple of float
        Prior standard deviation of the coefficients, one for all or one for each. Within a group their ratios are
        fixed, and the evidence of the readings determines the common scale.
    learn : bool
        Whether the evidence scales the prior; False keeps the standard deviations.

    Raises
    ------
    InputError
        If a parameter is invalid.

    Examples
    --------
    >>> import truearm as ta
    >>> q3, about_z = ta.Expression.angle(3), (0, 0, 1, 0, 0, 0)
    >>> cable = ta.Term("J4 by its cable over J3", 4, about_z, 2 * q3 + q3**3, group="cable", prior_std=1e-5)
    >>> cable.basis.labels()
    ('2 * q3 + q3^3',)
    """

    name: str
    place: int
    direction: tuple[float, ...]
    basis: Basis
    group: str
    prior_std: float | tuple[float, ...]
    learn: bool = True

    def __post_init__(self) -> None:
        for what in ("name", "group"):
            if not isinstance(getattr(self, what), str) or not getattr(self, what):
                raise InputError(f"expected a term's {what} as text, got {getattr(self, what)!r:.60}")
        for what in ("place", "learn", "prior_std"):
            object.__setattr__(self, what, plain(getattr(self, what)))
        if not isinstance(self.place, int) or isinstance(self.place, bool) or self.place < 0:
            raise self._problem(f"expected a place of 0 or more, got {self.place!r:.60}")
        basis: object = self.basis
        if isinstance(basis, Expression):
            object.__setattr__(self, "basis", Formula((basis,)))
        if not isinstance(self.basis, Basis):
            raise self._problem(f"expected a basis, got {type(self.basis).__name__}")
        if not isinstance(self.learn, bool):
            raise self._problem(f"expected learn as true or false, got {self.learn!r:.60}")
        direction = self._numbers("direction", self.direction)
        if len(direction) != 6 or not any(direction):
            raise self._problem(f"expected a direction of 6 numbers, not all zero, got {self.direction!r:.60}")
        object.__setattr__(self, "direction", direction)
        one = isinstance(self.prior_std, int | float)
        prior_std = self._numbers("prior_std", (self.prior_std,) if one else self.prior_std)
        if min(prior_std, default=0.0) <= 0:
            raise self._problem(f"expected prior standard deviations above zero, got {self.prior_std!r:.60}")
        if not one and len(prior_std) != self.basis.n_functions:
            raise self._problem(
                f"expected {self.basis.n_functions} prior standard deviations, one a function, got {len(prior_std)}"
            )
        object.__setattr__(self, "prior_std", prior_std[0] if one else prior_std)

    @cached_property
    def n_coefficients(self) -> int:
        """Number of coefficients: one for each function of the basis."""
        return self.basis.n_functions

    @property
    def prior_stds(self) -> FloatArray:
        """(n_coefficients,) prior standard deviation of each coefficient."""
        return np.broadcast_to(np.asarray(self.prior_std, dtype=float), (self.n_coefficients,)).copy()

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each coefficient."""
        if self.n_coefficients == 1:
            return (self.name,)
        return tuple(f"{self.name}: {function}" for function in self.basis.labels())

    def check_place(self, chain: Chain) -> None:
        """Check that a chain has the place of the term.

        Raises
        ------
        InputError
            If its place is beyond the tip.
        """
        if self.place >= chain.n_places:
            raise self._problem(f"expected a place from 0 (base) to {chain.n_places - 1} (tip), got {self.place}")

    def as_data(self) -> dict[str, Any]:
        """Return the term as plain data: numbers, strings, lists and the data of the basis."""
        return {
            "name": self.name,
            "place": self.place,
            "direction": list(self.direction),
            "basis": self.basis.as_data(),
            "group": self.group,
            "prior_std": list(self.prior_std) if isinstance(self.prior_std, tuple) else self.prior_std,
            "learn": self.learn,
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Self:
        """Create a term from the data of `as_data`.

        Raises
        ------
        InputError
            If a field is missing, unknown or invalid.
        """
        names = [f.name for f in fields(cls)]
        if not isinstance(data, Mapping) or sorted(map(str, data)) != sorted(names):
            raise InputError(f"expected a term with {names}, got {data!r:.60}")
        prior_std = data["prior_std"]
        return cls(
            data["name"],
            data["place"],
            data["direction"],
            basis_from_data(data["basis"]),
            data["group"],
            tuple(prior_std) if isinstance(prior_std, list) else prior_std,
            data["learn"],
        )

    def _numbers(self, what: str, values: object) -> tuple[float, ...]:
        values = values.tolist() if isinstance(values, np.ndarray) else values
        if not isinstance(values, tuple | list) or not all(
            isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e300 for v in map(plain, values)
        ):
            raise self._problem(f"expected finite numbers as {what}, got {values!r:.60}")
        return tuple(float(v) for v in values)

    def _problem(self, problem: str) -> InputError:
        return InputError(f"term {self.name[:60]!r}: {problem}")


class SkippedTerm(NamedTuple):
    """A term that is not offered.

    Attributes
    ----------
    name : str
    reason : str
        What the readings lack for it.
    """

    name: str
    reason: str


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
    n, at, after = 0, 0, values.searchsorted(values + apart, side="right").tolist()
    while at < len(after):
        n, at = n + 1, after[at]
    return n


def bands(highest: int) -> list[tuple[int, ...]]:
    """1 to 2, 3 to 4, 5 to 8, ... up to the highest."""
    ends = [0, *(2**i for i in range(1, max(highest, 1).bit_length() + 1))]
    found = [tuple(range(low + 1, min(high, highest) + 1)) for low, high in pairwise(ends)]
    return [band for band in found if band]


def orders_name(orders: Sequence[int]) -> str:
    """Orders in words."""
    return f"orders {orders[0]} to {orders[-1]}" if len(orders) > 1 else f"order {orders[0]}"
