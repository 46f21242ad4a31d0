"""The growth of the residual variance outside the trained range, from outer regions of it that are held out.

At either end of every joint, the readings of the outermost angles are predicted by an arm that was identified without
them, as if they had been outside of its training. A conformal estimate: the growth with which 95 % of these readings,
each region counting alike, lie in their ellipsoids. Readings of a region have errors in common (D. R. Roberts and
others, "Cross-validation strategies for data with temporal, spatial, hierarchical, or phylogenetic structure",
Ecography 40 (2017) 913), which single readings held out do not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from truearm.identification.estimation.extrapolation import STEEPEST_GROWTH, Extrapolation
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import LEVEL, HeldOutReadings, VarianceFunction
from truearm.identification.judgement.cross_validation import cross_validate_regions
from truearm.identification.judgement.gross_errors import own_variance
from truearm.identification.judgement.missing_terms import with_covariance
from truearm.identification.judgement.residual_process import with_unspanned
from truearm.identification.references.references import Reference
from truearm.identification.terms.state import ArmState
from truearm.solve.distributions import chi2_quantile
from truearm.typing import BoolArray, FloatArray

# Readings of an outer region, as a share of all: 30 of 200 readings, 10 to 30 degrees of a six-axis arm's joint.
OUTER_SHARE = 0.15
# Share of the readings at either end of a joint that may stand alone. One reading with the elbow turned over would else
# pass off half a turn between it and the others as trained.
OUTERMOST_SHARE = 0.02
# With fewer readings a region shows nothing, and with more than this share of all the others do not predict it: of
# joints with a few fixed angles.
LEAST_READINGS, MOST_SHARE = 5, 0.4
# Readings of a region that are predicted, at most. By their choice the growth of 12,000 readings scatters as by that of
# the regions, or less (0.1 to 0.2 of arms of 0.2 to 1); of 100 it would twice as much.
MOST_PREDICTED = 300
# Growth where no region can be judged, as of fewer than 28 readings [1/rad, or 1/range of a slide]: the largest with
# which 95 % of readings up to 0.6 rad outside are in their ellipsoids (24 readings of ur5, ur10, gao2017, panda, three
# arms each; kinematic models need 0 to 4, and their median is 0.3). It is a prior, not seen in the readings.
PRIOR_GROWTH = 4.0
# Steps of a bisection of the logarithm: to a share of 1e-4.
STEPS = 40


def outer_regions(angles: FloatArray, used: BoolArray) -> list[tuple[int, BoolArray]]:
    """The joint, and the (n,) readings of its outermost angles (n, n_joints), for either end of every joint.

    Of the `used` readings (n,) alone.
    """
    found = []
    for joint, at in enumerate(angles.T):
        low, high = np.quantile(at[used], [OUTER_SHARE, 1 - OUTER_SHARE])
        found += [(joint, rows & used) for rows in (at < low, at > high)]
    return [one for one in found if LEAST_READINGS <= one[1].sum() <= MOST_SHARE * used.sum()]


def growing_outside(
    function: VarianceFunction,
    variance: float,
    fit: IdentificationResult,
    state: ArmState,
    references: Sequence[Reference],
    used: BoolArray,
    added: FloatArray | None = None,
) -> VarianceFunction:
    """The variance function with its growth outside the range of the readings.

    Parameters
    ----------
    function : VarianceFunction
    variance : float
        Residual variance [mm^2].
    fit : IdentificationResult
        As identified from the readings.
    state, references
        Of the identification.
    used : (n,) bool array
        Readings that are not gross errors.
    added : (n, 3, 3) array, optional
        Covariance of the tips by the terms that the fit does not have, which grows by itself [mm^2].
    """
    angles, ranges = state.angles, _ranges(state.angles[used])
    whole = Extrapolation(ranges, state.chain.is_prismatic, PRIOR_GROWTH)
    regions = outer_regions(angles, used)
    judged: list[tuple[HeldOutReadings, FloatArray, FloatArray]] = []
    held_out_of = cross_validate_regions(fit, state, references, [rows for _, rows in regions], MOST_PREDICTED)
    for (joint, rows), found in zip(regions, held_out_of, strict=True):
        held_out = found.select_informative(own_variance(fit.references, found.rows))
        if added is not None:
            held_out = with_covariance(held_out, added)
        if len(held_out.rows) < LEAST_READINGS:
            continue
        without = ranges.copy()
        without[joint] = _ranges(angles[used & ~rows, joint, None])[0]
        own = replace(whole, ranges=without)
        # Others are inside. A slide counts in units of its whole range, as it does where the growth is applied.
        distance = own.distance(angles[held_out.rows]) * (own.unit / whole.unit)[joint]
        held_out, distance = held_out.select(distance > 0), distance[distance > 0]
        if len(held_out.rows) < LEAST_READINGS:
            continue
        at = angles[held_out.rows]
        part = variance * function.share(at) * held_out.freedom
        judged.append((with_unspanned(held_out, fit, state), part, distance))
    if judged:
        of_regions, variances, distances = zip(*judged, strict=True)
        together = reduce(HeldOutReadings.and_also, of_regions)
        excess = least_growth(together, np.concatenate(variances), np.concatenate(distances))
        weight = np.concatenate([np.full(len(one), 1 / len(one)) for one in distances])
        whole = replace(whole, growth=_weighted_quantile(excess, weight, LEVEL))
    return replace(function, beyond=whole)


def least_growth(held_out: HeldOutReadings, variance: FloatArray, distance: FloatArray) -> FloatArray:
    """(m,) the least growth by which the ellipsoid of each reading contains it; 0 where it does without.

    Parameters
    ----------
    held_out : HeldOutReadings
        m of them.
    variance, distance : (m,) array
        Residual variance without growth [mm^2], and how far they are outside of the others.
    """
    known, squares = held_out.along_axes
    radius = chi2_quantile(LEVEL, held_out.n_coordinates)

    def is_inside(growth: FloatArray) -> BoolArray:
        return np.asarray((squares / (known + variance * (1 + growth * distance))).sum(axis=0) <= radius)

    low, high = np.full(len(variance), np.log(1e-4)), np.full(len(variance), np.log(STEEPEST_GROWTH))
    for _ in range(STEPS):
        middle = (low + high) / 2
        inside = is_inside(np.exp(middle))
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    return np.where(is_inside(np.zeros(len(variance))), 0.0, np.exp(high))


def _weighted_quantile(values: FloatArray, weight: FloatArray, level: float) -> float:
    """The least value that a share `level` of the weights does not exceed."""
    order = np.argsort(values)
    below = np.cumsum(weight[order]) / weight.sum()
    return float(values[order][min(int(np.searchsorted(below, level)), len(values) - 1)])


def _ranges(angles: FloatArray) -> FloatArray:
    """(n_joints, 2) range of every joint, which a reading that stands alone ends no later than the others suggest.

    Not farther beyond the angle of the outermost readings' share than that is from the region's inner end.
    """
    shares = np.array([OUTERMOST_SHARE, OUTER_SHARE])
    low, inner_low = np.quantile(angles, shares, axis=0)
    high, inner_high = np.quantile(angles, 1 - shares, axis=0)
    ends = np.maximum(angles.min(axis=0), 2 * low - inner_low), np.minimum(angles.max(axis=0), 2 * high - inner_high)
    return np.stack(ends, axis=1)
