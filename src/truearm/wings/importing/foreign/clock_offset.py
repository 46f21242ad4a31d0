"""Offset and drift between the clocks of two logs of one motion, from the motion.

Speeds of the joints and of the tip are correlated over all offsets at once, for the parts where both logs have samples
(masked normalized correlation by FFT: D. Padfield, IEEE Trans. Image Process. 21 (2012) 2706). Then each move by
itself: from one standstill to the next the tip is a smooth function of how far the joints have come, at the offset at
which a polynomial describes it best. A line through these offsets is offset and drift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray, IntArray

# Samples of the running median, which removes a stray sample, and the width of noise that it leaves: the range of a
# window of it, in standard deviations of single samples.
MEDIAN_SAMPLES, NOISE_RANGE = 5, 4.0
# A stray sample lies so many standard deviations from the median of its standstill.
STRAY_STDS = 5.0
# Standard deviation of normal numbers over their median magnitude.
OVER_MEDIAN = 1.4826


@dataclass(frozen=True, eq=False)
class Log:
    """Samples in the order of time, without those that were lost.

    Attributes
    ----------
    times : (n,) array
        Rising [s].
    values : (n, k) array
        Joint angles, or coordinates of the tip.
    rows : (n,) int array
        Where each sample stands in its table.
    """

    times: FloatArray
    values: FloatArray
    rows: IntArray

    @property
    def step(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else np.inf

    def noise(self) -> FloatArray:
        """(k,) standard deviations of single samples while nothing moves, with the steps in which they are written."""
        if len(self.times) < 10:
            return np.zeros(self.values.shape[1])
        second = np.diff(self.values, n=2, axis=0) / np.sqrt(6.0)
        length = max(5, len(second) // 200)
        blocks = second[: len(second) // length * length].reshape(-1, length, second.shape[1])
        return np.asarray(np.quantile(np.sqrt((blocks**2).mean(axis=1)), 0.2, axis=0))

    def smoothed(self) -> FloatArray:
        """Values by a running median."""
        from scipy.ndimage import median_filter

        return np.asarray(median_filter(self.values, size=(MEDIAN_SAMPLES, 1), mode="nearest"))


def standstills(log: Log, span: float | FloatArray, seconds: float) -> FloatArray:
    """Find the times in which all values stay within a span.

    Parameters
    ----------
    log : Log
    span : float or (k,) array
        In the unit of the values; what the noise of samples spans is added.
    seconds : float
        Least duration.

    Returns
    -------
    (m, 2) array
        First and last time of each [s]. A gap between samples of half of `seconds` ends a standstill.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    n = len(log.times)
    width = max(2, round(seconds / log.step) + 1) if n > 1 else 2
    if n < width:
        return np.empty((0, 2))
    values = log.smoothed()
    origin = -((width - 1) // 2)  # of filters that look at the window from a sample on
    first = slice(0, n - width + 1)
    top = maximum_filter1d(values, width, axis=0, origin=origin)
    ranges = (top - minimum_filter1d(values, width, axis=0, origin=origin))[first]
    lasts = log.times[width - 1 :] - log.times[first]
    still = (ranges <= span + NOISE_RANGE * log.noise()).all(axis=1) & (lasts <= 1.5 * seconds)
    covered = np.zeros(n + 1, dtype=np.intp)
    np.add.at(covered, np.flatnonzero(still), 1)
    np.add.at(covered, np.flatnonzero(still) + width, -1)
    inside: BoolArray = np.cumsum(covered[:n]) > 0
    gap = np.diff(log.times, prepend=log.times[0]) > max(0.5 * seconds, 1.5 * log.step)
    starts = np.flatnonzero(inside & (~np.r_[False, inside[:-1]] | gap))
    ends = np.flatnonzero(inside & (~np.r_[inside[1:], False] | np.r_[gap[1:], False]))
    return np.stack([log.times[starts], log.times[ends]], axis=1)


def common_times(first: FloatArray, second: FloatArray, seconds: float) -> FloatArray:
    """The longest time of each standstill in `first` that is also one in `second`, of some seconds at least."""
    found = []
    for start, end in first.tolist():
        near = second[(second[:, 1] > start) & (second[:, 0] < end)]
        both = np.clip(near, start, end)
        if len(both) and (longest := both[np.argmax(both[:, 1] - both[:, 0])])[1] - longest[0] >= seconds:
            found.append(longest)
    return np.array(found).reshape(-1, 2)


def robust_mean(values: FloatArray) -> tuple[FloatArray, float, int]:
    """Mean of samples (n, k) without stray ones; its standard uncertainty by their scatter, and how many it is of.

    The uncertainty is the root sum of squares over the k values. Neighbouring samples are alike, so n samples count as
    ``n (1 - r) / (1 + r)``, with the correlation r of samples next to each other (G. V. Bayley, J. M. Hammersley,
    J. R. Stat. Soc. Suppl. 8 (1946) 184, for errors of the first autoregressive kind).
    """
    off = np.abs(values - np.median(values, axis=0))
    limit = STRAY_STDS * OVER_MEDIAN * np.median(off, axis=0)
    kept = values[(off <= np.maximum(limit, np.finfo(float).eps * np.abs(values).max())).all(axis=1)]
    kept = kept if 2 * len(kept) > len(values) else values
    mean = kept.mean(axis=0)
    away = kept - mean
    total = float((away**2).sum())
    n = len(kept)
    if n < 2 or total == 0:
        return mean, 0.0, n
    r = min(max(float((away[1:] * away[:-1]).sum()) / total, 0.0), 1 - 2 / n) if n > 2 else 0.0
    return mean, float(np.sqrt(total / (n - 1) / (n * (1 - r) / (1 + r)))), n


# Grid of the speeds [s], and the most points on it.
GRID_S, MOST_POINTS = 0.05, 2**20
# Least correlation of speeds that is a match; least share of a log's motion (squared speed) that overlaps the other's.
LEAST_CORRELATION, LEAST_MOTION = 0.6, 0.3
# Peaks of the correlation that are compared, the least of them, and how many moves of each are looked at.
MOST_PEAKS, LEAST_PEAK, FEW_MOVES = 8, 0.1, 8
# An offset is excluded if it has less than a share of the moves of another; if its moves, or from some time on [s]
# their own offsets, differ so many times as much; or if the correlation of another is better by so much in log
# likelihood, with a normal error for each move: odds of 20 to 1.
LEAST_SHARE, DIFFER, EQUAL_S, EXCLUDED = 0.25, 3.0, 0.01, 3.0
# At no offset do the logs match if offsets of neighbouring moves differ by more [s].
UNEQUAL_S = 0.2
# Fewer moves may match others than their own, unless the joints made no more.
FEWEST_MOVES = 3
# Offsets tried around the coarse one [s], in steps; degree of the tip along a move; most moves, and samples of each.
SEARCH_S, STEP_S, DEGREE, MOST_MOVES, MOST_SAMPLES = 1.0, 0.08, 12, 200, 300
# A move counts if the points have this share of its samples at least: without its ends it fits at any offset. The tip
# moves as the joints do if the polynomial leaves less than a share of how far it goes.
COMPLETE, MISFIT = 0.9, 0.02
# Joints that deviate by more from a straight line, as a share of its length, take a bent path; its steps [s].
BENT, PATH_STEP_S = 0.05, 0.04
# Moves from which a drift is estimated, and standard deviations beyond which a move's offset is not used.
LEAST_MOVES, STRAY_MOVE_STDS = 5, 4.0


@dataclass(frozen=True)
class ClockOffset:
    """Offset and drift of two clocks: ``t_joints = t_points + offset_s + drift (t_points - at_s)``.

    Attributes
    ----------
    offset_s, u_offset_s : float
        With its standard uncertainty; 0 where the offset was given.
    drift, u_drift : float
        Seconds per second.
    at_s : float
        Time of the points' clock at which the offset is stated, where it does not depend on the drift [s].
    n_moves : int
        Moves from which they were estimated.
    """

    offset_s: float
    u_offset_s: float = 0.0
    drift: float = 0.0
    u_drift: float = 0.0
    at_s: float = 0.0
    n_moves: int = 0

    def to_joints(self, times: FloatArray) -> FloatArray:
        """Times of the points' clock on the joints' clock [s]."""
        return times + self.offset_s + self.drift * (times - self.at_s)


def clock_offset(joints: Log, points: Log, still: FloatArray, given_s: float | None = None) -> ClockOffset:
    """Estimate offset and drift of two logs of one motion.

    Parameters
    ----------
    joints, points : Log
        Their clocks need have nothing in common but the rate.
    still : (m, 2) array
        Standstills of the joints, on their clock [s].
    given_s : float, optional
        The offset, if it is known to within a second.

    Raises
    ------
    InputError
        If the motions do not match, or match at several offsets.
    """
    coarse = _most_likely(joints, points, still) if given_s is None else given_s
    moves = _moves_at(joints, points, coarse, still, MOST_MOVES)
    alike = moves[moves[:, 3] < MISFIT]
    unequal = float(np.median(np.abs(np.diff(moves[:, 1])))) if len(moves) > 2 else 0.0
    if len(alike) < len(moves) / 2 or unequal > UNEQUAL_S:
        raise _no_match(f"at an offset of {coarse:.1f} s their moves do not begin and end together")
    if not len(alike):
        return ClockOffset(coarse, 0.0 if given_s is not None else SEARCH_S / 2, at_s=float(points.times.mean()))
    clock = _line(*alike[:, :3].T)
    return replace(clock, offset_s=coarse + clock.offset_s)


def _most_likely(joints: Log, points: Log, still: FloatArray) -> float:
    """The coarse offset [s]: of those at which the speeds correlate, that at which the moves agree too."""
    found, unlike = [], []
    for offset, r in _correlated(joints, points):
        moves = _moves_at(joints, points, offset, still, FEW_MOVES)
        start, end = points.times[[0, -1]] + offset
        n_moves = int(((still[:-1, 1] > start) & (still[1:, 0] < end)).sum())
        n_moves = len(moves) if n_moves <= FEW_MOVES else n_moves  # of few those that both logs have
        found.append((-0.5 * np.log1p(-(min(r, 0.9999) ** 2)), offset, n_moves))
        misfit, unequal = moves[:, 3], np.abs(np.diff(moves[:, 1]))
        unlike.append((np.median(misfit) if len(moves) else 1.0, np.median(unequal) if len(moves) > 1 else 0.0))
    if not found:
        raise _no_match(f"at no offset do their speeds correlate by {LEAST_CORRELATION:g} or more")
    if min(unequal for _, unequal in unlike) > UNEQUAL_S:
        raise _no_match("at no offset do their moves begin and end together")
    most = max(n for *_, n in found)
    several = [one for one, (*_, n) in zip(unlike, found, strict=True) if n >= LEAST_SHARE * most]
    limit = DIFFER * np.maximum(np.min(several, axis=0), [0.0, EQUAL_S])
    is_alike = [n >= LEAST_SHARE * most and (one <= limit).all() for one, (*_, n) in zip(unlike, found, strict=True)]
    found = [one for one, alike in zip(found, is_alike, strict=True) if alike] or found
    best = max(found, key=lambda one: one[0] * one[2])
    rivals = [one[1] for one in found if one != best and one[2] * (best[0] - one[0]) < EXCLUDED]
    if rivals:
        raise InputError(
            f"the motion repeats: {best[1]:.1f} s or {rivals[0]:.1f} s may be to be added to the times of the points",
            hint=f"--time-offset {best[1]:.1f} or --time-offset {rivals[0]:.1f}; logs that start and end at rest, at "
            "other times than the program, leave one",
        )
    if best[2] < min(FEWEST_MOVES, len(still) - 1):
        raise InputError(
            f"the points' log has {best[2]} whole moves of {len(still) - 1}: too few to be certain of an offset",
            hint=f"--time-offset {best[1]:.1f} if that is right: what to add to the times of the points",
        )
    return best[1]


def _moves_at(joints: Log, points: Log, coarse: float, still: FloatArray, most: int) -> FloatArray:
    """(m, 4) moves between standstills that both logs have, as `_offset_of_move` has them; no more than `most`."""
    start, end = points.times[[0, -1]] + coarse
    pairs = [pair for pair in pairwise(still) if pair[0][1] > start and pair[1][0] < end]
    chosen = pairs[:: max(1, -(-len(pairs) // most))]
    found = [_offset_of_move(joints, points, coarse, *pair) for pair in chosen]
    return np.array([one for one in found if one is not None]).reshape(-1, 4)


def _line(at: FloatArray, offset: FloatArray, u: FloatArray) -> ClockOffset:
    """Fit offset and drift; moves scatter by their uncertainties and by what these leave unexplained."""
    kept = np.ones(len(at), dtype=bool)
    for _ in range(5):
        n = int(kept.sum())
        n_free = n - (2 if n >= LEAST_MOVES else 1)
        variance = u**2 + _unexplained(at[kept], offset[kept], u[kept] ** 2, n_free)
        middle, value, drift, lever = _weighted_line(at[kept], offset[kept], 1 / variance[kept])
        left = offset - value - drift * (at - middle)
        limit = STRAY_MOVE_STDS * max(OVER_MEDIAN * float(np.median(np.abs(left))), float(np.median(u)))
        again = np.abs(left) <= limit
        if n < LEAST_MOVES or again.sum() < LEAST_MOVES or (again == kept).all():
            break
        kept = again
    u_value, u_drift = (1 / variance[kept]).sum() ** -0.5, lever**-0.5 if drift else 0.0
    return ClockOffset(value, float(u_value), drift, float(u_drift), middle, n)


def _weighted_line(at: FloatArray, offset: FloatArray, w: FloatArray) -> tuple[float, float, float, float]:
    """Mean time, offset there, drift, and the weighted sum of squared levers; no drift of few moves."""
    middle = float(at[0] + np.average(at - at[0], weights=w))  # dates count 1e9 seconds
    away, value = at - middle, float(np.average(offset, weights=w))
    lever = float((w * away**2).sum())
    return middle, value, float((w * away * offset).sum()) / lever if len(at) >= LEAST_MOVES else 0.0, lever


def _unexplained(at: FloatArray, offset: FloatArray, variance: FloatArray, n_free: int) -> float:
    """Variance to add to those of the moves so that they explain the scatter about the line [s^2].

    Source: R. C. Paule, J. Mandel, J. Res. Natl. Bur. Stand. 87 (1982) 377.
    """
    from scipy.optimize import brentq

    def excess(more: float) -> float:
        w = 1 / (variance + more)
        middle, value, drift, _ = _weighted_line(at, offset, w)
        return float((w * (offset - value - drift * (at - middle)) ** 2).sum()) - n_free

    if n_free < 1 or excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 0.0, ((offset - offset.mean()) ** 2).sum() / n_free + variance.max()))


def _offset_of_move(
    joints: Log, points: Log, coarse: float, before: FloatArray, after: FloatArray
) -> tuple[float, float, float, float] | None:
    """Time on the points' clock, offset beyond the coarse one, its uncertainty [s], and misfit of one move.

    None where the points' log has too few samples of it.
    """
    from scipy.optimize import minimize_scalar

    start, end = float(before[1]), float(after[0])
    first, last = max(start - SEARCH_S / 2, before.mean()), min(end + SEARCH_S / 2, after.mean())
    a, b = np.searchsorted(points.times, [first - coarse, last - coarse])
    every = max(1, int(b - a) // MOST_SAMPLES)
    tip, times = points.values[a:b:every], points.times[a:b:every] + coarse
    n_moving = int(((times > start) & (times < end)).sum())
    if n_moving < 8 or b - a < COMPLETE * (last - first) / points.step:
        return None
    rows = slice(*np.searchsorted(joints.times, [first, last]))
    q, t = joints.values[rows], joints.times[rows]
    from_q, to_q = q[t <= start].mean(axis=0), q[t >= end].mean(axis=0)
    chord = to_q - from_q
    way = (q - from_q) @ chord / max(float(chord @ chord), np.finfo(float).tiny)
    if np.linalg.norm(q - from_q - way[:, None] * chord, axis=1).max() > BENT * np.linalg.norm(chord):
        # By way of other poses: the length of the path, over steps that are longer than what noise adds.
        nodes = np.r_[0 : len(q) - 1 : max(1, round(PATH_STEP_S / joints.step)), len(q) - 1]
        length = np.cumsum(np.r_[0.0, np.linalg.norm(np.diff(q[nodes], axis=0), axis=1)])
        way = np.interp(t, t[nodes], length / length[-1])
    degree = min(DEGREE, n_moving // 4)

    def left(shift: float) -> FloatArray:
        design = np.polynomial.legendre.legvander(2 * np.interp(times + shift, t, way) - 1, degree)
        gram = design.T @ design
        gram[np.diag_indices(degree + 1)] *= 1 + 1e-9  # all samples may be of one place
        return np.asarray(tip - design @ np.linalg.solve(gram, design.T @ tip))

    def squares(shift: float) -> float:
        return float((left(shift) ** 2).sum())

    shifts = np.arange(-SEARCH_S, SEARCH_S + STEP_S / 2, STEP_S)
    best = float(shifts[np.argmin([squares(shift) for shift in shifts])])
    near = (best - STEP_S, best + STEP_S)
    shift = float(minimize_scalar(squares, bounds=near, method="bounded", options={"xatol": 1e-6}).x)
    e = left(shift)
    least, h = max(float((e**2).sum()), np.finfo(float).tiny), STEP_S / 8
    bend = (squares(shift + h) + squares(shift - h) - 2 * least) / h**2
    # Where the polynomial does not follow the tip, errors of neighbours are alike: by r, with the share of it that the
    # polynomial takes away.
    r = min(max(float((e[1:] * e[:-1]).sum()) / least + (degree + 1) / len(times), 0.0), 0.99)
    variance = least / max(e.size - 3 * (degree + 1) - 1, 1) * (1 + r) / (1 - r)
    u = max(float(np.sqrt(2 * variance / bend)), 1e-6) if bend > 0 else SEARCH_S
    is_inside = abs(best) < SEARCH_S - STEP_S / 2 and u < SEARCH_S
    misfit = float(np.sqrt(least / len(times)) / np.linalg.norm(np.ptp(tip, axis=0))) if is_inside else 1.0
    return float(times.mean() - coarse), shift, u, misfit


# Offset of the whole motion ------------------------------------------------------------------------------------------


def _correlated(joints: Log, points: Log) -> list[tuple[float, float]]:
    """Offsets at which the speeds of two logs correlate, to the grid [s], the most likely first, and how much."""
    from scipy.ndimage import maximum_filter1d

    longest = max(np.ptp(joints.times), np.ptp(points.times))
    grid = max(GRID_S, 2 * joints.step, 2 * points.step, longest / MOST_POINTS)
    v, w = _squared_speeds(joints, grid), _squared_speeds(points, grid).sum(axis=1)
    std = joints.values.std(axis=0)
    scale = np.maximum(std, 0.01 * std.max())
    r, overlap, share = _masked_correlation(np.sqrt((v / scale**2).sum(axis=1)), np.sqrt(w))
    r = np.where(share >= LEAST_MOTION, np.clip(r, 0.0, 0.9999), 0.0)
    highest = maximum_filter1d(r, 2 * max(1, round(SEARCH_S / grid)) + 1)
    peaks = np.flatnonzero((r >= LEAST_PEAK) & (r == highest))
    merit = -overlap[peaks] * np.log1p(-(r[peaks] ** 2))  # log likelihood of normal errors
    lags = peaks[np.argsort(-merit)[:MOST_PEAKS]] - len(w) + 1
    start = joints.times[0] - points.times[0]
    found = [(float(start + lag * grid), _weighted_correlation(v, w, lag)) for lag in lags.tolist()]
    return [one for one in found if one[1] >= LEAST_CORRELATION]


def _no_match(seen: str) -> InputError:
    return InputError(
        f"the motion of the points does not match that of the joints: {seen}",
        hint="check that both logs are of one run; if their clocks are known, state --time-offset SECONDS, which is "
        "added to the times of the points",
    )


def _squared_speeds(log: Log, grid: float) -> FloatArray:
    """(n, k) squared speed of each value on a grid of times from the first sample on; NaN where samples lack."""
    place = ((log.times - log.times[0]) / grid).astype(np.intp)
    count = np.bincount(place)
    sums = np.stack([np.bincount(place, weights=column) for column in (log.values - log.values.mean(axis=0)).T], axis=1)
    mean = np.full(sums.shape, np.nan)
    mean[count > 0] = sums[count > 0] / count[count > 0, None]
    speed = np.full(mean.shape, np.nan)
    speed[1:-1] = ((mean[2:] - mean[:-2]) / (2 * grid)) ** 2
    return speed


def _masked_correlation(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Correlation of a with b at all lags, on how many points each, and with which share of motion.

    The lag of index i is ``i - len(b) + 1``: b[0] lies at a[lag].
    """
    length = len(a) + len(b) - 1
    size = 1 << (length - 1).bit_length()

    def with_each(x: FloatArray, y: FloatArray) -> FloatArray:
        product = np.fft.rfft(x, size) * np.fft.rfft(y[::-1], size)
        return np.asarray(np.fft.irfft(product, size)[:length])

    in_a, in_b = np.isfinite(a).astype(float), np.isfinite(b).astype(float)
    # Speeds over their root mean square: rounding of the transforms is then small beside one.
    a, b = (np.nan_to_num(x / np.sqrt(np.nanmean(x**2))) for x in (a, b))
    n = np.maximum(with_each(in_a, in_b), 1.0)
    sum_a, sum_b = with_each(a, in_b), with_each(in_a, b)
    square_a, square_b = with_each(a**2, in_b), with_each(in_a, b**2)
    spread = np.maximum(square_a - sum_a**2 / n, 1e-3) * np.maximum(square_b - sum_b**2 / n, 1e-3)
    share = np.maximum(square_a / (a**2).sum(), square_b / (b**2).sum())
    return (with_each(a, b) - sum_a * sum_b / n) / np.sqrt(spread), n, share


def _weighted_correlation(v: FloatArray, w: FloatArray, lag: int) -> float:
    """Correlation of the tip's speed with that of joints, each with the lever that explains the tip best."""
    from scipy.optimize import nnls

    first, last = max(0, lag), min(len(v), len(w) + lag)
    v, w = v[first:last], w[first - lag : last - lag]
    known = np.isfinite(v).all(axis=1) & np.isfinite(w)
    v, w = v[known], w[known]
    lever = nnls(v, w)[0]
    a, b = np.sqrt(v @ lever), np.sqrt(w)
    if not a.std() or not b.std():
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


# Points without motion -----------------------------------------------------------------------------------------------


def offset_of_points(times: FloatArray, still: FloatArray) -> ClockOffset:
    """Offset at which single points lie in standstills of the joints.

    Parameters
    ----------
    times : (n,) array
        On the points' clock [s].
    still : (m, 2) array
        Standstills of the joints, on their clock [s].
    """
    chosen: IntArray = np.unique(np.linspace(0, len(times) - 1, min(len(times), 500)).astype(np.intp))
    enter, leave = (np.subtract.outer(still[:, side], times[chosen]).reshape(-1) for side in (0, 1))
    at = np.concatenate([enter, leave])
    order = np.lexsort((np.repeat([0, 1], len(enter)), at))
    count = np.cumsum(np.repeat([1, -1], len(enter))[order])
    at = at[order]
    best, least = int(count.max(initial=0)), 3
    if best < max(least, 0.9 * len(chosen)):
        raise _no_match(f"at no offset do more than {best} of {len(chosen)} single rows lie in standstills")
    high = count >= best - len(chosen) // 20
    starts = np.flatnonzero(high & ~np.r_[False, high[:-1]])
    middles = [_middle(at, count, start, high) for start in starts.tolist()]
    if len(middles) > 1:
        middles.sort(key=lambda one: (-one[2], abs(one[0])))
        (one, _, n), (other, _, m) = middles[:2]
        raise InputError(
            f"single rows lie in standstills of the other file at several offsets: {n} of {len(chosen)} at {one:.1f} s"
            f", {m} at {other:.1f} s",
            hint=f"--time-offset {one:.1f} or --time-offset {other:.1f}: what to add to the times of the points",
        )
    return ClockOffset(middles[0][0], middles[0][1], at_s=float(times.mean()))


def _middle(at: FloatArray, count: IntArray, start: int, high: BoolArray) -> tuple[float, float, int]:
    """Middle of the offsets at which most points fit, the standard uncertainty of a uniform distribution, how many."""
    rest = np.flatnonzero(~high[start:])
    stop = start + int(rest[0]) if len(rest) else len(high) - 1
    most = int(count[start:stop].max())
    inside = start + np.flatnonzero(count[start:stop] == most)
    low, top = float(at[inside[0]]), float(at[inside[-1] + 1])
    return (low + top) / 2, (top - low) / np.sqrt(12.0), most
