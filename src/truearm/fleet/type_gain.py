"""Whether what arms of a type have in common helps the next arm: each arm is held out, and predicted from few readings.

From a few readings of an arm its constants are estimated twice: with the prior of the type as the other arms show it,
and with that of any arm. What counts is the error at its other readings, beyond that of the arm as all of its readings
show it: noise, and what no constant explains, are in both. All is to first order, on the normal equations of each arm,
so that no arm is fitted again.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.type_scatter import ReadingEquations, TypeScatter, type_scatter
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.terms import Term
from truearm.identification.terms.type_prior import HeldOutGain
from truearm.typing import FloatArray

# Readings of an arm that is held out from which the others are predicted; these are as many at least.
FEW = (10, 20)
LEAST_ARMS = 3
# Arms are held out one by one, or in so many parts.
MOST_PARTS = 20
# A prior is kept if the error falls, of which one can be as sure as this, and grows by no larger share anywhere.
CONFIDENCE, MOST_GROWTH = 0.95, 0.01


@dataclass(frozen=True, eq=False)
class ArmEquations:
    """The readings of one arm: the first few, the next few, and all others, in random order."""

    parts: tuple[ReadingEquations, ...]

    @classmethod
    def of(cls, fit: IdentificationResult, offered: Sequence[Term], readings: PreparedReadings) -> ArmEquations:
        """Those of readings from which an arm was identified by the terms offered."""
        n = len(readings.session)
        rank = np.random.default_rng(0).permutation(n)
        limits = [0, *(few for few in FEW if 2 * few <= n), n]
        parts = (
            ReadingEquations.of(fit, offered, readings.state, readings.references, (rank >= low) & (rank < high))
            for low, high in itertools.pairwise(limits)
        )
        return cls(tuple(parts))

    @property
    def all(self) -> ReadingEquations:
        """Of all readings."""
        return reduce(add, self.parts)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms of the arm."""
        return self.parts[0].terms

    @property
    def coefficients(self) -> list[str]:
        """Name of the term of each coefficient."""
        return [term.name for term in self.terms for _ in range(term.n_coefficients)]


class TypeEstimate(NamedTuple):
    """Constants of a type, what their prior gains on arms held out, and what they are without each part held out.

    Arm i is of part ``i % len(parts)``.
    """

    scatter: TypeScatter
    gains: tuple[HeldOutGain, ...]
    parts: tuple[TypeScatter, ...] = ()

    @property
    def helps(self) -> bool:
        """Whether the prior of the type is better than that of any arm."""
        logs = [(np.log(one.error_ratio), one.error_ratio_u / one.error_ratio, one.n_arms) for one in self.gains]
        falls = any(log < -student.ppf(CONFIDENCE, n - 1) * u for log, u, n in logs)
        return bool(falls and all(one.error_ratio <= 1 + MOST_GROWTH for one in self.gains))


def estimate_type(
    arms: Sequence[ArmEquations], terms: Sequence[Term], *, progress: Callable[[int, str], None] | None = None
) -> TypeEstimate:
    """Estimate what arms of a type have in common, and what that gains.

    Parameters
    ----------
    arms : sequence of ArmEquations
    terms : sequence of Term
        The p constants of the type (`truearm.identification.terms.type_prior.type_constants`).
    progress : callable, optional
        Called with the number of parts held out and a note.

    Raises
    ------
    InputError
        If there are fewer than `LEAST_ARMS` arms, or too few readings of them to hold any out.
    """
    names = [term.name for term in terms]
    enough = [one for one in arms if len(one.parts) > 1]
    if len(enough) < LEAST_ARMS:
        raise InputError(
            f"expected {LEAST_ARMS} arms or more of the type with {2 * FEW[0]} readings each, got {len(enough)}"
        )
    equations = [one.all.of_terms(np.isin(one.coefficients, names)) for one in arms]
    whole, n_parts = type_scatter(equations, terms), min(len(arms), MOST_PARTS)
    logs: dict[int, list[float]] = {}
    without: list[TypeScatter] = []
    for part in range(n_parts):
        others = [one for i, one in enumerate(equations) if i % n_parts != part]
        found = type_scatter(others, terms, start=whole)
        without.append(found)
        for arm in arms[part::n_parts]:
            for few, log_ratio in _log_ratios(arm, names, found).items():
                logs.setdefault(few, []).append(log_ratio)
        if progress is not None:
            progress(part + 1, f"arms held out: {part + 1} of {n_parts} parts")
    gains = tuple(_gain(few, np.array(found)) for few, found in logs.items() if len(found) >= LEAST_ARMS)
    return TypeEstimate(whole, gains, tuple(without))


def _log_ratios(arm: ArmEquations, names: Sequence[str], found: TypeScatter) -> dict[int, float]:
    """By number of readings the logarithm of the ratio of the errors at the others, with the prior and without."""
    values = {name: (m, s) for name, m, s in zip(names, found.mean, found.arm_std, strict=True)}
    mean = np.array([values.get(name, (0.0,))[0] for name in arm.coefficients])
    terms = [
        replace(term, prior_std=float(values[term.name][1])) if term.name in values else term for term in arm.terms
    ]
    nowhere, whole = np.zeros(len(mean)), arm.all
    best = whole.most_probable(arm.terms, nowhere)
    ratios = {}
    for i, few in enumerate(FEW[: len(arm.parts) - 1], 1):
        known, rest = reduce(add, arm.parts[:i]), reduce(add, arm.parts[i:])
        least = rest.square(best)
        without, with_prior = (
            # An error below that of the constants themselves is chance.
            max(rest.square(x) - least, float(len(names)))
            for x in (known.most_probable(arm.terms, nowhere), known.most_probable(terms, mean))
        )
        ratios[few] = float(np.log(with_prior / without)) / 2
    return ratios


def _gain(n_readings: int, logs: FloatArray) -> HeldOutGain:
    ratio = float(np.exp(logs.mean()))
    u = ratio * float(logs.std(ddof=1)) / np.sqrt(len(logs))
    return HeldOutGain(n_readings=n_readings, n_arms=len(logs), error_ratio=ratio, error_ratio_u=float(u))
