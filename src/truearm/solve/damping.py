"""Damping rules: how much of a step to trust, adapted to how the last steps turned out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from truearm.errors import InputError
from truearm.solve.least_squares_problem import Linearisation, NormalEquations

SMALLEST = 1e-20
LARGEST = float(np.finfo(float).max)


class Damping(Protocol):
    """A damping parameter and the rule by which it changes. Rules are values: each change returns a new rule."""

    @property
    def mu(self) -> float:
        """The number added to the diagonal of ``J^T J``."""
        ...

    @property
    def share(self) -> float:
        """The fraction of the damped step to try."""
        ...

    @property
    def is_exhausted(self) -> bool:
        """Whether the rule has no further step to try."""
        ...

    def at_start(self, equations: NormalEquations) -> Self:
        """The rule at the start of a minimisation."""
        ...

    def after_success(self, gain: float) -> Self:
        """The rule after a step that lowered the cost by `gain` times what the quadratic model predicted."""
        ...

    def after_failure(self) -> Self:
        """The rule after a step that did not lower the cost."""
        ...


@dataclass(frozen=True)
class MarquardtDamping:
    """Marquardt's rule with the defaults of MATLAB's ``trainlm``: a fixed factor down, a fixed factor up.

    Source: D. W. Marquardt, J. SIAM 11 (1963) 431; M. T. Hagan, M. Menhaj, IEEE Trans. Neural Networks 5 (1994) 989.

    Parameters
    ----------
    mu, decrease, increase, maximum : float
        MATLAB's ``mu, mu_dec, mu_inc, mu_max``. A step is still tried at `maximum`, as in MATLAB.
    minimum : float
        The damping never falls below this value; from zero it could not grow again.
    """

    mu: float = 1e-3
    decrease: float = 0.1
    increase: float = 10.0
    maximum: float = 1e10
    minimum: float = SMALLEST
    share = 1.0

    def __post_init__(self) -> None:
        if not (self.mu > 0 and 0 < self.decrease < 1 < self.increase < float("inf") and self.maximum > 0):
            raise InputError(
                "expected mu > 0, 0 < mu_dec < 1, mu_inc > 1 and mu_max > 0, "
                f"got {self.mu}, {self.decrease}, {self.increase}, {self.maximum}"
            )

    @property
    def is_exhausted(self) -> bool:
        """Whether the damping is above its maximum."""
        return self.mu > min(self.maximum, LARGEST)

    def at_start(self, equations: Linearisation) -> MarquardtDamping:  # noqa: ARG002 - the start is a constant
        """The rule itself."""
        return self

    def after_success(self, gain: float) -> MarquardtDamping:  # noqa: ARG002 - any success counts
        """Damping times `decrease`."""
        return replace(self, mu=max(self.mu * self.decrease, self.minimum))

    def after_failure(self) -> MarquardtDamping:
        """Damping times `increase`."""
        return replace(self, mu=self.mu * self.increase)


@dataclass(frozen=True)
class NielsenDamping:
    """Nielsen's rule: the damping falls with the gain ratio and rises ever faster.

    Source: H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05, eq. 2.4; K. Madsen,
    H. B. Nielsen, O. Tingleff, "Methods for non-linear least squares problems" (2004), algorithm 3.16.

    Parameters
    ----------
    relative_start : float
        The first damping, relative to the largest diagonal element of ``J^T J`` (tau).
    mu, growth, maximum : float
        Damping, its factor at the next failure and its limit; set at the start and updated by every step.
    """

    relative_start: float = 1e-3
    mu: float = 0.0
    growth: float = 2.0
    maximum: float = float("inf")
    share = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.relative_start < float("inf"):
            raise InputError(f"expected a first damping above zero, got {self.relative_start}")
        if not (self.mu >= 0 and self.growth > 1 and self.maximum > 0):
            raise InputError(
                f"expected mu >= 0, growth > 1 and a maximum > 0, got {self.mu}, {self.growth}, {self.maximum}"
            )

    @property
    def is_exhausted(self) -> bool:
        """Whether the damping is above its maximum."""
        return self.mu > min(self.maximum, LARGEST)

    def at_start(self, equations: NormalEquations) -> NielsenDamping:
        """The rule with a damping in proportion to the size of ``J^T J``."""
        # The largest element is zero where every unit is saturated, or NaN; in this order `max` returns neither.
        largest = max(SMALLEST, float(equations.gram.diagonal().max()))
        return replace(self, mu=max(self.relative_start * largest, SMALLEST), growth=2.0, maximum=1e16 * largest)

    def after_success(self, gain: float) -> NielsenDamping:
        """Damping times ``max(1/3, 1 - (2 gain - 1)^3)``; never below 1e-20, as with `MarquardtDamping`."""
        factor = max(1 / 3, 1 - (2 * min(gain, 2.0) - 1) ** 3)
        return replace(self, mu=max(self.mu * factor, SMALLEST), growth=2.0)

    def after_failure(self) -> NielsenDamping:
        """Damping times 2, 4, 8, ... at consecutive failures."""
        return replace(self, mu=self.mu * self.growth, growth=2 * self.growth)


@dataclass(frozen=True)
class StepHalving:
    """No damping: the Gauss-Newton step, halved until it does not raise the cost.

    Parameters
    ----------
    share : float
        The fraction of the step to try next.
    max_halvings : int
        After this many halvings the rule has no further step to try.
    halvings : int
        Halvings since the last step that was accepted.
    """

    share: float = 1.0
    max_halvings: int = 40
    halvings: int = 0
    mu = 0.0

    @property
    def is_exhausted(self) -> bool:
        """Whether the step was halved more often than allowed."""
        return self.halvings > self.max_halvings

    def at_start(self, equations: Linearisation) -> StepHalving:  # noqa: ARG002 - the start is a constant
        """The rule itself."""
        return self

    def after_success(self, gain: float) -> StepHalving:  # noqa: ARG002 - any success counts
        """The full step again."""
        return replace(self, share=1.0, halvings=0)

    def after_failure(self) -> StepHalving:
        """Half the step."""
        return replace(self, share=self.share / 2, halvings=self.halvings + 1)
