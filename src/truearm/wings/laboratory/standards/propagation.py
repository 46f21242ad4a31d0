"""The uncertainty of a test value from the statistic that it is: artefact and set-up, propagated through it.

A test value is a number made of many readings: a mean, a range, 2s, the diameter of a sphere. What is wanted is its
difference from the value that *the same readings* would have given with a perfect artefact and a perfect set-up. The
errors of the arm are in both: they are what the test is about (ISO 14253-5, ISO 23165 [recalled]). Some errors of
artefact and set-up are common to many readings, such as the calibration of a length, and leave a range or 2s of
readings of that length as they are; others, such as the fixture, are new in each reading and average out of a mean.

A linear statistic has a closed form (JCGM 100:2008, 5.1.2). The others are carried out on drawn readings (JCGM
101:2008, 7), from a fixed seed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import hypot, inf

import numpy as np

from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.decision import Budget, Contribution

Statistic = Callable[[FloatArray], FloatArray]
"""A test value of readings: (m, n) or (m, n, 3) in, (m,) out [mm]."""

DRAWS = 1000
"""Draws of all errors: their root mean square is known to 2.2 %."""

_SEED = 20


@dataclass(frozen=True, eq=False)
class ErrorSource:
    """A cause of errors in artefact or set-up, and what it does to each reading of a test.

    Attributes
    ----------
    label : str
        Its line in the budget.
    effects : (k, n) or (k, n, 3) array
        The errors of n readings by each of k independent standard deviations [mm]: one row for an error that all
        readings have in common, a diagonal for one that is new in each.
    dof : float
        Degrees of freedom of its standard uncertainty.
    """

    label: str
    effects: FloatArray
    dof: float = inf


def in_each(label: str, u: float | FloatArray, shape: tuple[int, ...]) -> ErrorSource:
    """A source that is new in each of readings of a shape, (n,) or (n, 3), with standard uncertainty u [mm]."""
    size = int(np.prod(shape))
    return ErrorSource(label, np.diag(np.broadcast_to(u, shape).ravel()).reshape(size, *shape))


def linear_budget(weights: FloatArray, sources: Sequence[ErrorSource]) -> Budget:
    """Return the budget of a weighted sum of readings, exactly.

    Parameters
    ----------
    weights : (n,) array
        Of the readings: (1,) for a single reading, 1/n each for their mean.
    sources : sequence of ErrorSource
    """
    return Budget(tuple(Contribution(one.label, hypot(*(one.effects @ weights)), one.dof) for one in sources))


def drawn_budget(readings: FloatArray, statistic: Statistic, sources: Sequence[ErrorSource]) -> Budget:
    """Return the budget of any statistic of readings, by drawing the errors.

    Parameters
    ----------
    readings : (n,) or (n, 3) array
        As measured [mm].
    statistic : callable
        The test value of (m, n) or (m, n, 3) readings, (m,) [mm].
    sources : sequence of ErrorSource

    Notes
    -----
    The standard uncertainty is the root mean square of the change of the value, and so contains its bias: errors of
    artefact and set-up make a range, a scatter or a maximum larger on average. The value itself is not corrected, as
    the standards define it by the readings (JCGM 100:2008, F.2.4.5 [recalled], for a correction that is not applied).

    The readings scatter by the arm *and* by artefact and set-up. Before the errors are drawn the readings are drawn
    towards their mean, until their variance is what it would be without: an arm that is hardly worse than its set-up
    would otherwise have too small an uncertainty.

    The lines of the budget are the root mean squares of each source alone, times one factor, so that their squares add
    to that of all together.

    Examples
    --------
    >>> import numpy as np
    >>> common = ErrorSource("calibration", np.full((1, 3), 0.010))
    >>> deviations = np.array([0.01, 0.02, -0.03])
    >>> f"{drawn_budget(deviations, value_range, [common]).u:.4f}"  # it moves both ends of the range
    '0.0000'
    """
    rng = np.random.default_rng(_SEED)
    errors = [np.tensordot(rng.standard_normal((DRAWS, len(one.effects))), one.effects, 1) for one in sources]
    if not errors:
        return Budget()
    together: FloatArray = np.sum(errors, axis=0)
    middle = readings.mean(axis=0)
    own, added = float(((readings - middle) ** 2).sum()), float(together.var(axis=1).sum() / DRAWS * len(readings))
    without = middle + np.sqrt(max(0.0, 1 - added / own) if own > 0 else 0.0) * (readings - middle)
    reference = statistic(without[None])

    def rms(error: FloatArray) -> float:
        if not error.any():
            return 0.0
        return float(np.sqrt(((statistic(without + error) - reference) ** 2).mean()))

    alone = [rms(one) for one in errors]
    factor = rms(together) / hypot(*alone) if any(alone) else 0.0
    return Budget(tuple(Contribution(one.label, factor * u, one.dof) for one, u in zip(sources, alone, strict=True)))


# Statistics that test plans name; the last axis is that of the readings.


def value_range(deviations: FloatArray) -> FloatArray:
    """The range: the largest less the smallest."""
    return np.asarray(np.ptp(deviations, axis=-1))


def two_s(deviations: FloatArray) -> FloatArray:
    """``2 s`` about their mean, divisor n - 1."""
    return np.asarray(2 * deviations.std(axis=-1, ddof=1))


def two_rms(deviations: FloatArray) -> FloatArray:
    """``2 RMS`` about zero, divisor n: it contains the scale error."""
    return np.asarray(2 * np.sqrt((deviations**2).mean(axis=-1)))


def _distances(points: FloatArray) -> FloatArray:
    """Distances of points (.., n, 3) from their mean, (.., n)."""
    away = points - points.mean(axis=-2, keepdims=True)
    return np.asarray(np.sqrt(np.einsum("...c,...c", away, away)))


def largest_distance(points: FloatArray) -> FloatArray:
    """The largest distance of points (.., n, 3) from their mean."""
    return np.asarray(_distances(points).max(axis=-1))


def two_s_of_points(points: FloatArray) -> FloatArray:
    """``2 s`` with ``s^2 = sum d^2 / (n - 1)`` of the distances d of points (.., n, 3) from their mean."""
    return np.asarray(2 * np.sqrt((_distances(points) ** 2).sum(axis=-1) / (points.shape[-2] - 1)))


def half_range(points: FloatArray) -> FloatArray:
    """Half the range of the worst coordinate of points (.., n, 3)."""
    return np.asarray(np.ptp(points, axis=-2).max(axis=-1) / 2)


def farthest_pair(points: FloatArray) -> FloatArray:
    """The largest distance between two of points (.., n, 3)."""
    away = points[..., :, None, :] - points[..., None, :, :]
    return np.asarray(np.sqrt(np.einsum("...c,...c", away, away).max(axis=(-2, -1))))
