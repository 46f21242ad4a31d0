"""Figures that are sums over parts of a session: records that are added field by field, in the order of the parts.

Quantiles follow from counts in bins whose limits grow by a constant factor: C. Masson, J. E. Rim, H. K. Lee, "DDSketch:
a fast and fully-mergeable quantile sketch with relative-error guarantees", Proc. VLDB Endow. 12 (2019) 2195.

How many independent readings correlated ones are worth follows from sums over blocks. Consecutive readings of a moving
arm have residuals alike. The covariance of a sum over them, such as the gradient of a least-squares cost, is then
larger than that of as many independent ones, by the design effect (L. Kish, "Survey Sampling", 1965, section 8.2). Sums
over blocks of consecutive readings are nearly independent of each other if the blocks are much longer than the
correlation; the length follows from the readings: blocks are joined in pairs until the effect no longer grows
(H. Flyvbjerg, H. G. Petersen, "Error estimates on averages of correlated data", J. Chem. Phys. 91 (1989) 461). Of a
gradient it includes how the derivatives change along the readings (K.-Y. Liang, S. L. Zeger, "Longitudinal data
analysis using generalized linear models", Biometrika 73 (1986) 13).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self, TypeVar

import numpy as np

from truearm.typing import FloatArray, IntArray

T = TypeVar("T")

# What parts say that is kept.
MAX_KEPT = 6
# Relative accuracy of a quantile.
ACCURACY = 1e-3
# Smaller and larger numbers are counted as these.
SMALLEST, LARGEST = 1e-9, 1e9
# Consecutive readings of the shortest block of a long session.
BLOCK = 1024
# With fewer blocks their scatter is not known.
LEAST_BLOCKS = 8
# Blocks of a short session: their length is doubled twice.
SHORT_BLOCKS = 4 * LEAST_BLOCKS
SHORTEST = 32
# Growth from one length to its double that counts, in standard errors.
SIGNIFICANT = 2.0

_JOINED = "joined"
_LOG_GROWTH = np.log((1 + ACCURACY) / (1 - ACCURACY))
_N_BINS = 2 + int(np.log(LARGEST / SMALLEST) / _LOG_GROWTH)


def joined(by: Callable[[Any, Any], Any]) -> dict[str, Any]:
    """Metadata of a field of `Sums` that is no sum: a function of both values joins them, such as the larger one."""
    return {_JOINED: by}


def one_below_the_other(a: FloatArray, b: FloatArray) -> FloatArray:
    """The rows of both arrays."""
    return np.concatenate([a, b])


def different(a: tuple[T, ...], b: tuple[T, ...]) -> tuple[T, ...]:
    """What parts say, once each."""
    return tuple(dict.fromkeys((*a, *b)))


def first_different(a: tuple[T, ...], b: tuple[T, ...]) -> tuple[T, ...]:
    """The first different of what parts say, `MAX_KEPT` of them."""
    return different(a, b)[:MAX_KEPT]


@dataclass(frozen=True, eq=False)
class Sums:
    """Base of dataclasses whose fields are sums: numbers, arrays, such records, or all of these by name."""

    def __add__(self, other: Self) -> Self:
        """Figures of both."""
        return type(self)(
            **{
                one.name: one.metadata.get(_JOINED, _added)(getattr(self, one.name), getattr(other, one.name))
                for one in fields(self)
            }
        )


def _added(a: Any, b: Any) -> Any:
    if not isinstance(a, Mapping):
        return a + b
    return {**a, **{name: a[name] + value if name in a else value for name, value in b.items()}}


@dataclass(frozen=True, eq=False)
class QuantileSketch(Sums):
    """Counts of numbers in bins.

    Parameters
    ----------
    counts : (n_bins,) int array
    """

    counts: IntArray = field(default_factory=lambda: np.zeros(_N_BINS, np.int64))

    @classmethod
    def of(cls, values: FloatArray) -> QuantileSketch:
        """Count values (n,) of 0 or more."""
        logs = np.log(np.clip(values, SMALLEST, LARGEST) / SMALLEST)
        bins = (logs / _LOG_GROWTH).astype(np.intp)
        return cls(np.bincount(bins, minlength=_N_BINS).astype(np.int64))

    def quantile(self, share: float) -> float:
        """The value below which a share of the numbers lies, as `numpy.quantile`, to `ACCURACY`; NaN without numbers.

        Between two numbers it is interpolated: the median of two is their mean.
        """
        total = np.cumsum(self.counts)
        if not total[-1]:
            return float("nan")
        place = share * (total[-1] - 1)
        both = np.searchsorted(total, [np.floor(place), np.ceil(place)], side="right")
        lower, upper = SMALLEST * np.exp((both + 0.5) * _LOG_GROWTH)
        return float(lower + (place - np.floor(place)) * (upper - lower))


@dataclass(frozen=True, eq=False)
class DesignEffect:
    """By how much the gradient of correlated readings scatters more than that of independent ones.

    Attributes
    ----------
    factor : float
        1 or more: n readings are worth n / factor independent ones, on average over what they determine.
    scatter : (p, p) array
        Covariance of the gradient as its blocks show it, direction by direction; zeros where there are too few.
    n_blocks, n_block : int
        Number of the blocks from which both follow, and of the consecutive readings of each.
    is_settled : bool
        Whether longer blocks would show no more; otherwise there are too few, and the factor may be larger.
    is_by_poses : bool
        Whether the factor is that of errors that come back with their poses, of which blocks show less.
    """

    factor: float
    scatter: FloatArray
    n_blocks: int
    n_block: int
    is_settled: bool
    is_by_poses: bool = False


def design_effect(
    scores: FloatArray, covariance: FloatArray, n_readings: int, n_determined: float | None = None
) -> DesignEffect:
    """Design effect of a gradient that is a sum of scores.

    Parameters
    ----------
    scores : (n_blocks, p) array
        Sums over blocks of about equal numbers of consecutive readings, in their order.
    covariance : (p, p) array
        Of the estimates, were the readings independent; it may contain a prior.
    n_readings : int
        In all blocks.
    n_determined : float, optional
        How many estimates the readings determine, rather than a prior; all by default.
    """
    n_determined = n_determined or float(len(covariance))
    found: DesignEffect | None = None
    length = n_readings / max(len(scores), 1)
    while (n := len(scores)) >= LEAST_BLOCKS:
        centred = scores - scores.mean(axis=0)
        scatter = centred.T @ centred * (n / (n - 1))
        factor = float((scatter * covariance).sum()) / n_determined
        if found is not None and factor - found.factor < SIGNIFICANT * factor * np.sqrt(2 / (n * n_determined)):
            return replace(found, factor=max(factor, found.factor, 1.0), is_settled=True)
        found = DesignEffect(factor, scatter, n, round(length), False)
        pairs = scores[: n // 2 * 2]
        scores, length = pairs[::2] + pairs[1::2], 2 * length
    if found is None:
        return DesignEffect(1.0, np.zeros_like(covariance), n, round(length), False)
    return replace(found, factor=max(found.factor, 1.0))


def block_starts(n: int, n_session: int | None = None) -> IntArray:
    """First rows of the blocks of n consecutive readings; the last block is longer than the others.

    Parameters
    ----------
    n : int
    n_session : int, optional
        Readings of the session, of which these are a part; n by default. A short one has shorter blocks than `BLOCK`.
    """
    n_session = n if n_session is None else n_session
    block = min(max(n_session // SHORT_BLOCKS, SHORTEST), BLOCK)
    return np.arange(0, max(n - block + 1, 1), block)
