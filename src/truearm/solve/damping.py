"""Damping rules: how far a step may be trusted, learned from how the last ones turned out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

from truearm.errors import InputError
from truearm.solve.least_squares_problem import NormalEquations

SMALLEST = 1e-20


class Damping(Protocol):
    """A damping parameter and the rule by which it changes. Rules are values: a change gives a new one."""

    @property
    def mu(self) -> float:
        """What is added to the diagonal of ``J^T J``."""
        ...

    @property
    def maximum(self) -> float:
        """Above this the search for a better point is given up; at it one more step is tried, as in MATLAB."""
        ...

    def at_start(self, equations: NormalEquations) -> Self:
        """The rule at the start of a minimisation."""
        ...

    def after_success(self, gain: float) -> Self:
        """After a step that lowered the cost by `gain` times what the quadratic model promised."""
        ...

    def after_failure(self) -> Self:
        """After a step that did not lower the cost."""
        ...


@dataclass(frozen=True)
class MarquardtDamping:
    """Marquardt's rule with the defaults of MATLAB's ``trainlm``: a fixed factor down, a fixed factor up.

    Source: D. W. Marquardt, J. SIAM 11 (1963) 431; M. T. Hagan, M. Menhaj, IEEE Trans. Neural Networks 5 (1994) 989.

    Parameters
    ----------
    mu, decrease, increase, maximum : float
        MATLAB's ``mu, mu_dec, mu_inc, mu_max``.
    """

    mu: float = 1e-3
    decrease: float = 0.1
    increase: float = 10.0
    maximum: float = 1e10

    def __post_init__(self) -> None:
        if not (self.mu > 0 and 0 < self.decrease < 1 < self.increase < float("inf") and self.maximum > 0):
            raise InputError(
                "expected mu > 0, 0 < mu_dec < 1, mu_inc > 1 and mu_max > 0, "
                f"got {self.mu}, {self.decrease}, {self.increase}, {self.maximum}"
            )

    def at_start(self, equations: NormalEquations) -> MarquardtDamping:  # noqa: ARG002 - the start is a constant
        """The rule as it is."""
        return self

    def after_success(self, gain: float) -> MarquardtDamping:  # noqa: ARG002 - success is enough
        """Damping times `decrease`; never quite nothing, from which it could not grow again."""
        return replace(self, mu=max(self.mu * self.decrease, SMALLEST))

    def after_failure(self) -> MarquardtDamping:
        """Damping times `increase`."""
        return replace(self, mu=self.mu * self.increase)


@dataclass(frozen=True)
class NielsenDamping:
    """Nielsen's rule: down by the gain ratio, up ever faster.

    Source: H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05, eq. 2.4; K. Madsen,
    H. B. Nielsen, O. Tingleff, "Methods for non-linear least squares problems" (2004), algorithm 3.16.

    Parameters
    ----------
    relative_start : float
        The first damping, as a share of the largest diagonal element of ``J^T J`` (tau).
    mu, growth, maximum : float
        Damping, its factor at the next failure and its limit: set at the start, then by every step.
    """

    relative_start: float = 1e-3
    mu: float = 0.0
    growth: float = 2.0
    maximum: float = float("inf")

    def __post_init__(self) -> None:
        if not 0 < self.relative_start < float("inf"):
            raise InputError(f"expected a first damping above zero, got {self.relative_start}")
        if not (self.mu >= 0 and self.growth > 1 and self.maximum > 0):
            raise InputError(
                f"expected mu >= 0, growth > 1 and a maximum > 0, got {self.mu}, {self.growth}, {self.maximum}"
            )

    def at_start(self, equations: NormalEquations) -> NielsenDamping:
        """Damping measured by the size of ``J^T J``."""
        # Nothing at all where every unit is saturated, or NaN: in this order `max` takes neither.
        largest = max(SMALLEST, float(equations.gram.diagonal().max()))
        return replace(self, mu=max(self.relative_start * largest, SMALLEST), growth=2.0, maximum=1e16 * largest)

    def after_success(self, gain: float) -> NielsenDamping:
        """Damping times ``max(1/3, 1 - (2 gain - 1)^3)``; never quite nothing, as with `MarquardtDamping`."""
        factor = max(1 / 3, 1 - (2 * min(gain, 2.0) - 1) ** 3)
        return replace(self, mu=max(self.mu * factor, SMALLEST), growth=2.0)

    def after_failure(self) -> NielsenDamping:
        """Damping times 2, 4, 8, ... for failures in a row."""
        return replace(self, mu=self.mu * self.growth, growth=2 * self.growth)
