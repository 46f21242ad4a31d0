"""Change of the frame during a session: a tracker that was pushed, a base that moved or creeps.

Each reading's residual r is projected on the six small rigid motions of the reference frame about the centroid of the
points, with the reading's Jacobian B and weights W: scores ``s = B^T W r``. If nothing moved, their order says nothing.
Their cumulated sums, centred, whitened by the scores' own covariance and scaled by ``t (1 - t)`` at a share t of the
readings, are the score statistics of a step there; the largest is the sup-LM statistic of D. W. K. Andrews, "Tests for
parameter instability and structural change with unknown change point", Econometrica 61 (1993) 821. Its distribution if
nothing changed is that over random orders of the same scores: no normality is assumed, and no number of readings.

What a model does not explain depends on the pose, and poses are often measured region by region. From each score the
mean of those at the most similar poses is therefore subtracted: a change counts only where poses before and after it
are alike. Readings that repeat a pose one after the other count as one, their mean: compared with each other they would
hide every change between poses. It must also be there in residuals less a cubic function of each joint. Consecutive
readings of like poses have like residuals; the statistic is divided by the ratio of long-run and plain variance (W. K.
Newey, K. D. West, Econometrica 55 (1987) 703) of the scores without the step.

A step that explains less than a motion proportional to the row is a drift. The confidence interval of the row is that
of J. Bai, "Estimation of a change point in multiple regression models", Rev. Econ. Stat. 79 (1997) 551.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from truearm.arm.rigid_motions import cross_matrix
from truearm.typing import FloatArray, IntArray

# A session of good readings is questioned once in five hundred.
SIGNIFICANCE = 0.002
N_ORDERS = 1999
# Smaller statistics are not examined further: some good session in ten has a larger one.
LEAST_STATISTIC = 19.0
# Readings on both sides of a step, at least: so many, and this share.
LEAST_READINGS, LEAST_SHARE = 8, 0.05
# With fewer readings for each function of the joints these would explain a step too.
READINGS_PER_FUNCTION = 4
# Similar poses that a reading is compared with.
NEIGHBOURS = 8
# Consecutive readings are of one pose if no joint differs by more: as a share of its scatter, or in rad and mm.
SAME_SHARE, SAME_ANGLE = 0.01, 1e-3
# Half width of a 95 % interval of the row, by the step's squared signal-to-noise ratio of one reading (Bai 1997).
HALF_WIDTH = 11.0


@dataclass(frozen=True)
class FrameChange:
    """The frame of the reference moved between two readings, or slowly.

    Attributes
    ----------
    kind : {"step", "drift"}
    row : int
        First row of the readings after the step; of a drift the row in its middle.
    first_row, last_row : int
        95 % interval of that row.
    shift_mm : float
        Root mean square distance by which the points moved; of a drift from the first to the last reading [mm].
    p_value : float
        Probability of a change as clear as this if nothing moved.
    """

    kind: Literal["step", "drift"]
    row: int
    first_row: int
    last_row: int
    shift_mm: float
    p_value: float


def frame_change(
    angles: FloatArray,
    points: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    rows: IntArray,
    *,
    seed: int = 0,
) -> FrameChange | None:
    """Test whether the frame of the reference moved during a session.

    Parameters
    ----------
    angles : (n, n_joints) array
        Of the readings, in the order in which they were measured [rad, or mm].
    points : (n, 3) array
        Of the same readings [mm].
    residuals : (n, 3) array
        Of the same readings, any constant motion being identified [mm].
    weights : (n, 3) array
        One over their variances, times robust weights [1/mm^2].
    rows : (n,) int array
        Rows of the readings in the session.
    seed : int
        Of the random orders.

    Returns
    -------
    FrameChange or None
        None if the order of the residuals is what chance gives.
    """
    last_row = rows[-1] if len(rows) else 0
    angles, points, residuals, weights, rows = _less_repeats(angles, points, residuals, weights, rows)
    n = len(points)
    margin = max(LEAST_READINGS, int(np.ceil(LEAST_SHARE * n)))
    if n < 2 * margin + 1:
        return None
    motions = _rigid_motions(points)
    found = []
    # As they are, and without what is smooth in the joints: each alone leaves some errors of the pose.
    for some in (residuals, _less_smooth(residuals, weights, angles)):
        scores = np.einsum("nij,ni->nj", motions, weights * some)
        outcome = _step(_whitened(_less_those_of_like_poses(scores, angles)), margin, seed)
        if outcome is None:
            return None
        found.append(outcome)
    step, p_value = max(found, key=lambda outcome: outcome[1])
    change = _describe(motions, weights, residuals, rows, step, p_value)
    return replace(change, last_row=int(last_row)) if change.kind == "drift" else change


def _less_repeats(
    angles: FloatArray, points: FloatArray, residuals: FloatArray, weights: FloatArray, rows: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
    """The same arrays with the mean of readings that repeat a pose one after the other, and the first row of each."""
    near = np.maximum(SAME_SHARE * angles.std(axis=0), SAME_ANGLE) if len(angles) else np.zeros(0)
    starts: list[int] = []
    for row, at in enumerate(angles):
        if not starts or (np.abs(at - angles[starts[-1]]) > near).any():
            starts.append(row)
    if len(starts) == len(angles):
        return angles, points, residuals, weights, rows

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(values, starts) / np.diff([*starts, len(angles)])[:, None])

    weight = mean(weights)
    weighted = np.divide(mean(weights * residuals), weight, out=np.zeros_like(weight), where=weight > 0)
    return mean(angles), mean(points), weighted, weight, rows[starts]


def _step(white: FloatArray, margin: int, seed: int) -> tuple[int, float] | None:
    """Number of readings before the clearest step, and its p-value; None if it is not significant."""
    n = len(white)
    if white.shape[1] == 0:
        return None
    cut = slice(margin, n - margin + 1)
    step = margin + int(np.argmax(_statistics(white)[cut]))
    within = _without_step(white, step)
    largest = float((np.cumsum(white, axis=0)[step - 1] ** 2 / _long_run_ratio(within)).sum() * n / (step * (n - step)))
    if largest < LEAST_STATISTIC:
        return None
    p_value = _p_value(largest, _whitened(within), cut, seed)
    return None if p_value > SIGNIFICANCE else (step, p_value)


def _rigid_motions(points: FloatArray) -> FloatArray:
    """(n, 3, 6) displacements of the points by rotations about their centroid [mm/rad] and translations."""
    away = points - points.mean(axis=0)
    turns = np.stack([-cross_matrix(one) for one in away])
    return np.concatenate([turns, np.broadcast_to(np.eye(3), turns.shape)], axis=2)


def _standardized(angles: FloatArray) -> FloatArray:
    scatter = angles.std(axis=0)
    return np.asarray((angles - angles.mean(axis=0)) / np.where(scatter > 0, scatter, 1.0))


def _less_smooth(residuals: FloatArray, weights: FloatArray, angles: FloatArray) -> FloatArray:
    """Residuals less a cubic function of each joint; as they are where too few readings would determine it."""
    z = _standardized(angles)
    smooth = np.hstack([np.ones((len(z), 1)), z, z**2, z**3])
    if len(z) < READINGS_PER_FUNCTION * smooth.shape[1]:
        return residuals
    root = np.sqrt(weights.mean(axis=1))[:, None]
    fitted = np.linalg.lstsq(root * smooth, root * residuals, rcond=1e-9)[0]
    return np.asarray(residuals - smooth @ fitted)


def _less_those_of_like_poses(scores: FloatArray, angles: FloatArray) -> FloatArray:
    """Scores less the mean of those at the most similar poses, and less their own mean."""
    scaled = _standardized(angles)
    k = min(NEIGHBOURS, len(angles) - 1)
    near = np.asarray(cKDTree(scaled).query(scaled, k=k + 1)[1])[:, 1:]
    contrasts = scores - scores[near].mean(axis=1)
    return np.asarray(contrasts - contrasts.mean(axis=0))


def _whitened(scores: FloatArray) -> FloatArray:
    """Scores with a unit covariance; directions that do not vary are omitted."""
    scaled = scores / np.maximum(scores.std(axis=0), np.finfo(float).tiny)
    values, axes = np.linalg.eigh(scaled.T @ scaled / len(scores))
    varies = values > 1e-9
    return np.asarray(scaled @ (axes[:, varies] / np.sqrt(values[varies])))


def _statistics(white: FloatArray) -> FloatArray:
    """(n + 1,) the statistic of a step after each number of readings; infinite weights at the ends are zero."""
    n = len(white)
    before = np.arange(1, n)
    inner = (np.cumsum(white, axis=0)[:-1] ** 2).sum(axis=1) * n / (before * (n - before))
    return np.concatenate([[0.0], inner, [0.0]])


def _without_step(white: FloatArray, step: int) -> FloatArray:
    """Scores less the means of both parts."""
    return np.concatenate([part - part.mean(axis=0) for part in (white[:step], white[step:])])


def _long_run_ratio(white: FloatArray) -> FloatArray:
    """Long-run over plain variance of each column, 1 or more: Bartlett's kernel over the cube root of n lags."""
    n = len(white)
    plain = (white**2).mean(axis=0)
    lags = max(1, int(np.ceil(n ** (1 / 3))))
    long_run = plain.copy()
    for lag in range(1, lags + 1):
        long_run += 2 * (1 - lag / (lags + 1)) * (white[lag:] * white[:-lag]).sum(axis=0) / n
    return np.asarray(np.maximum(long_run / plain, 1.0))


def _p_value(largest: float, white: FloatArray, cut: slice, seed: int) -> float:
    """Share of random orders of the scores whose largest statistic is no smaller."""
    rng, exceeded = np.random.default_rng(seed), 0
    for _ in range(N_ORDERS):
        exceeded += bool(_statistics(white[rng.permutation(len(white))])[cut].max() >= largest)
        if exceeded > SIGNIFICANCE * (N_ORDERS + 1):  # it cannot become significant any more
            break
    return (exceeded + 1) / (N_ORDERS + 1)


def _describe(
    motions: FloatArray, weights: FloatArray, residuals: FloatArray, rows: IntArray, step: int, p_value: float
) -> FrameChange:
    """Size and kind of a significant change."""
    n = len(rows)
    after = (np.arange(n) >= step).astype(float)
    ramp = np.linspace(0.0, 1.0, n)
    moved, gain = _motion_along(after, motions, weights, residuals)
    drifted, gain_of_drift = _motion_along(ramp, motions, weights, residuals)
    if gain_of_drift > gain:
        shift = float(np.sqrt(((motions @ drifted) ** 2).sum(axis=1).mean()))
        return FrameChange("drift", int(rows[n // 2]), int(rows[0]), int(rows[-1]), shift, p_value)
    away = motions @ moved
    left = residuals + (after - after.mean())[:, None] * away
    # Noise as it is: stated weights may be wrong by a factor.
    noise = (weights * left**2).sum() / (3 * n)
    signal = max(float((weights * away**2).sum(axis=1).mean() / max(noise, np.finfo(float).tiny)), 1e-6)
    wide = int(min(HALF_WIDTH / signal, n)) + 1
    ends = rows[max(step - wide, 0)], rows[min(step + wide, n - 1)]
    shift = float(np.sqrt((away**2).sum(axis=1).mean()))
    return FrameChange("step", int(rows[step]), int(ends[0]), int(ends[1]), shift, p_value)


def _motion_along(
    course: FloatArray, motions: FloatArray, weights: FloatArray, residuals: FloatArray
) -> tuple[FloatArray, float]:
    """Rigid motion (6,) that explains residuals (predicted less measured) by its course, and the gain of chi-square.

    A constant motion is identified beside it, as the base is.
    """
    both = np.concatenate([motions, -course[:, None, None] * motions], axis=2)
    root = np.sqrt(weights)
    design, target = (root[:, :, None] * both).reshape(-1, 12), (root * residuals).ravel()
    scale = np.maximum(np.linalg.norm(design, axis=0), np.finfo(float).tiny)
    found = np.linalg.lstsq(design / scale, target, rcond=1e-9)[0]
    gain = float(target @ target - ((target - design / scale @ found) ** 2).sum())
    return found[6:] / scale[6:], gain
