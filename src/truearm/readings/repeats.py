"""Repeats: readings of one pose, and one reading in place of those that only repeat each other.

What an arm does wrong at a pose it does at every reading there: repeats show how an instrument scatters, and nothing of
other poses. Counted as readings of their own they pass their small scatter off as that between poses. So readings that
differ in nothing that is stated are merged into their mean, of standard uncertainty ``s / sqrt(k)`` for k readings that
scatter by s (JCGM 100:2008, 4.2.3). What they have in common with the instrument's error at this place stays. The mean
knows k and s: a model states the uncertainty of one reading, and the mean of k has less of it (`averaged_mm2`).

Angles that are rounded, to the digits of a file, the counts of an encoder or of a controller's display, are whole steps
apart: the largest of which all differences between the values of a joint are multiples. An error of rounding to a step
s is uniform, of standard uncertainty ``s / sqrt(12)`` (JCGM 100:2008, F.2.2.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from truearm.readings.readings import PAYLOAD, SHARED_UNCERTAINTIES, TOUCHED, Readings
from truearm.typing import BoolArray, FloatArray, IntArray

Kept = TypeVar("Kept", bound=Readings)

# With fewer different values a step may be chance, or that of a plan.
LEAST_VALUES = 10
# Larger steps [rad; mm] are those of a plan: no encoder reads in whole degrees, and no scale of an axis above whole mm.
LARGEST_STEP, LARGEST_STEP_MM = 0.0175, 1.01
# Smaller ones are below the noise of any arm [rad; mm]: 3 um at the end of two metres, 0.5 um of an axis.
LEAST_STEP, LEAST_STEP_MM = 5e-6, 5e-4
# The nearest two values are no more steps apart: of forty values among a hundred thousand steps some sixty.
MOST_STEPS = 200
# Values differ from whole steps by up to this share of one, where counts were written in degrees with few decimals; by
# chance ten values would in one case of ten million.
MOST_OFF = 0.1
# A step becomes sharper from the nearest values to the farthest in so many turns.
REACHES = 12
# By this number of values steps are refused, all at once, before the others are tried on all values.
FEW = 40
# Angles of one pose differ by no more: the noise of encoders, and what a drive leaves when it returns (a UR10: 4e-5 rad
# in half, 1e-4 in nine tenths of its returns). In rad, or of a sliding joint mm, and as a share of the joint's range.
SAME_ANGLE, SAME_SHARE = 1e-4, 1e-5
# Links may be so far behind a thermometer [K], as `identification.judgement.expansion_prior` has it.
SAME_KELVIN = 1.0
# Measured torques of a joint that stands still differ by some per cent of their range, or by so many standard
# deviations of those at one pose. The range of k readings has a standard deviation of some 0.86 of theirs, for k from 2
# to 10.
SAME_LOAD_SHARE, LOAD_STDS, STD_OF_RANGE = 0.05, 4.0, 0.86
# Repeats whose digits flicker differ by one step of these, if no larger [rad]: 0.01 degrees. Larger steps are those of
# a scan.
MOST_FLICKER = 2e-4
# A repeat that is off by more standard deviations of repeats, or by this [mm], is not merged: a slipped tip, whose
# reading is then judged by itself. Trackers and probing tips repeat to a few micrometres.
MAX_STDS, MAX_OFF_MM = 10.0, 0.02
# A median change from the first round through the poses to the last of so many standard errors is none of chance,
# and changes at neighbouring poses are not alike by chance in one session of so many, as
# `identification.judgement.change_point` has it.
MAX_ERRORS, SIGNIFICANCE, N_SIGNS = 6.0, 0.002, 1999
# Readings beyond the first of each pose, from which the standard deviation of repeats is known to a factor of two; and
# poses of which the median change is known so.
LEAST_REPEATED = 5
# Standard deviation of normal numbers over their median magnitude, and of a median over that of a mean.
OVER_MEDIAN, MEDIAN_ERROR = 1.4826, 1.2533


def rounding_steps(angles: FloatArray, is_prismatic: BoolArray | None = None) -> FloatArray:
    """Step to which the angles of each joint are rounded [rad, or mm]; 0 where none is seen.

    Parameters
    ----------
    angles : (n, n_joints) array
        [rad, or mm], as they were read.
    is_prismatic : (n_joints,) bool array, optional
        Which joints slide; by default all turn.

    Examples
    --------
    >>> import numpy as np
    >>> angles = np.deg2rad(np.round(np.random.default_rng(1).uniform(-90, 90, (50, 2)), [1, 5]))
    >>> np.rad2deg(rounding_steps(angles)).round(6).tolist()
    [0.1, 0.0]
    """
    angles = np.asarray(angles)
    slides = np.zeros(angles.shape[1], dtype=bool) if is_prismatic is None else is_prismatic
    limits = [(LEAST_STEP_MM, LARGEST_STEP_MM) if one else (LEAST_STEP, LARGEST_STEP) for one in slides]
    return np.array([_step(np.unique(values), *of) for values, of in zip(angles.T, limits, strict=True)])


def _step(values: FloatArray, least: float, largest: float) -> float:
    """Common step of rising values; 0 if there is none."""
    differences: FloatArray = np.diff(values)
    differences = differences[differences > least]
    if len(values) < LEAST_VALUES or not len(differences):
        return 0.0
    from_first, nearest = values - values[0], float(differences.min())
    steps = nearest / np.arange(1, MOST_STEPS + 1)
    for one in _possible(steps[steps >= least], from_first):
        if step := _sharpened(float(one), from_first):
            return step if step <= largest else 0.0
    return 0.0


def _possible(steps: FloatArray, values: FloatArray) -> FloatArray:
    """Steps of which the first few values may be multiples; the others `_sharpened` refuses by these values alone."""
    few = values[:FEW]
    reaches = np.geomspace(np.maximum(10 * steps, values[1]), values[-1], REACHES)
    left, sharper = np.arange(len(steps)), steps
    refused = np.zeros(len(steps), dtype=bool)
    for reach in 1.0001 * reaches:
        within = reach[left] <= few[-1]
        left, sharper = left[within], sharper[within]
        near = np.where(few < reach[left, None], few, 0.0)
        multiples = np.round(near / sharper[:, None])
        sharpened = (near * multiples).sum(axis=1) / np.maximum((multiples**2).sum(axis=1), 1.0)
        sharper = np.where(sharpened > 0, sharpened, sharper)
        off = np.abs(near - sharper[:, None] * multiples).max(axis=1, initial=0.0) > (MOST_OFF + 1e-9) * sharper
        refused[left[off]] = True
        left, sharper = left[~off], sharper[~off]
    return steps[~refused]


def _sharpened(step: float, values: FloatArray) -> float:
    """A step near `step` of which all values, rising from 0, are multiples; 0 if there is none."""
    for reach in np.geomspace(max(10 * step, float(values[1])), float(values[-1]), REACHES):
        near = values[: np.searchsorted(values, 1.0001 * reach)]
        multiples = np.round(near / step)
        step = float(near @ multiples / max(float(multiples @ multiples), 1.0)) or step
        if np.abs(near - step * multiples).max() > MOST_OFF * step:
            return 0.0
    return step


@dataclass(frozen=True, eq=False)
class MergedReadings(Generic[Kept]):
    """Readings of which each stands for those that it repeats.

    Attributes
    ----------
    readings : Readings
        The means of repeats, numbered as the first of each; they know their number and scatter.
    first : (n,) int array
        Its row in the readings as given.
    count : (n,) int array
        How many readings each stands for.
    member : (n_given,) int array
        Of the readings as given the row of that which stands for them.
    scatter_mm : float
        Standard deviation of a coordinate or a distance within a pose [mm]; 0 without repeats, or if they are copies.
    n_changed : int
        Poses that were read again in a later round and are not merged with it, as something moved between the rounds.
    """

    readings: Kept
    first: IntArray
    count: IntArray
    member: IntArray
    scatter_mm: float
    n_changed: int = 0


def readings_of_one_pose(readings: Readings, *, exactly: bool = False) -> IntArray:
    """(n,) numbers of the poses of readings: those with the same angles, `exactly` or but for noise, are together.

    They may be distances to several anchors, several tips, two directions of approach, or repeats. The number of a pose
    is the row of its first reading. Looked for once: the readings keep them.
    """
    known = vars(readings).setdefault("_poses", {})
    if exactly not in known:
        known[exactly] = _first_rows(readings.angles) if exactly or len(readings) < 2 else _of_near_angles(readings)
    return np.asarray(known[exactly])


def _of_near_angles(readings: Readings) -> IntArray:
    angles = readings.angles
    tolerance = np.maximum(SAME_ANGLE, SAME_SHARE * np.ptp(angles, axis=0))
    pairs, order, kept, same = _close_pairs(angles, np.maximum(tolerance, 1.01 * MOST_FLICKER))
    if len(pairs):
        away = np.abs(angles[kept[order[pairs[:, 0]]]] - angles[kept[order[pairs[:, 1]]]])
        if (away > tolerance).any():  # rounding is looked for only where it matters
            steps = rounding_steps(angles)
            tolerance = np.maximum(tolerance, np.where(steps <= MOST_FLICKER, 1.01 * steps, 0.0))
        pairs = pairs[(away <= tolerance).all(axis=1)]
    group = np.arange(len(kept))
    near: dict[int, list[int]] = {}
    for a, b in np.sort(pairs, axis=1):
        near.setdefault(int(a), []).append(int(b))
    for one in sorted(near):  # those near the first of a pose, not near each other in a chain
        if group[one] == one:
            group[[other for other in near[one] if group[other] == other]] = one
    rank = np.empty(len(kept), dtype=np.intp)
    rank[order] = np.arange(len(kept))
    return np.asarray(kept[order][group[rank[same.reshape(-1)]]])


def _close_pairs(angles: FloatArray, tolerance: FloatArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Pairs of different angles within a tolerance, as numbers in the order of their first rows.

    Also that order, the first rows, and of each row the number of its angles.
    """
    from scipy.spatial import cKDTree

    kept, same = np.unique(angles, axis=0, return_index=True, return_inverse=True)[1:]
    order = np.argsort(kept)
    pairs = cKDTree((angles / tolerance)[kept[order]]).query_pairs(1.0, p=np.inf, output_type="ndarray")
    return pairs, order, kept, same


def merge_repeats(readings: Kept) -> MergedReadings[Kept]:
    """Merge readings of one pose that are stated alike and agree, each pose into their mean.

    Readings at other temperatures, with other loads, directions of movement or tips, or of other sessions, are no
    repeats. A reading that is far from the median of its pose is left alone, and so are two that disagree. If something
    moved between rounds through the poses, only readings of one round are merged.
    """
    n, pose, n_changed = len(readings), readings_of_one_pose(readings), 0
    group = _stated_alike(readings, pose)
    if readings.pose_errors is not None:  # whose errors a mean of poses would not have
        group = np.arange(n)
    if len(np.unique(group)) < n:
        # Readings at one pose without another pose between them are of one visit.
        visit = np.cumsum(np.diff(pose, prepend=pose[:1]) != 0)
        rounds = [rows for rows in _rows_of(group) if visit[rows[0]] != visit[rows[-1]]]
        if _moved(readings, [(rows[0], rows[np.argmax(visit[rows] == visit[rows[-1]])]) for rows in rounds]):
            n_changed, group = len(rounds), _first_rows(np.stack([group, visit], axis=1))
        group = _agreeing(readings, group)
    first, member, count = np.unique(group, return_inverse=True, return_counts=True)[:3]
    if len(first) == n:
        return MergedReadings(readings, np.arange(n), np.ones(n, dtype=np.intp), np.arange(n), 0.0, n_changed)
    values = _measured(readings)
    off = values - _means(values, first, member)[member]
    scatter = float(np.sqrt((off**2).sum() / max(off.shape[1] * (n - len(first)), 1)))
    merged = _merged(readings, first, member, scatter)
    if scatter > 0:  # copies say nothing of noise, and average none
        merged = replace(merged, n_repeats=count, repeat_std_mm=_unstated(readings, scatter))
    return MergedReadings(merged, first, count, member, scatter, n_changed)


def _stated_alike(readings: Readings, group: IntArray) -> IntArray:
    """Of the readings of each pose those that are stated alike; a group's number is its first row."""
    if len(np.unique(group)) == len(group):
        return group
    parts: list[FloatArray] = [group[:, None].astype(float)]
    for name in (*TOUCHED, "tip", "session"):
        if (names := getattr(readings, name)) is not None:
            parts.append(np.unique(names, return_inverse=True)[1][:, None].astype(float))
    for values in (readings.points, readings.quaternion, readings.distance_mm):
        if values is not None:
            parts.append(np.isnan(values.reshape(len(readings), -1)[:, :1]).astype(float))
    for values in (readings.directions, *(getattr(readings, name) for name in SHARED_UNCERTAINTIES)):
        if values is not None:
            parts.append(values.reshape(len(readings), -1))
    alike = np.unique(np.hstack(parts), axis=0, return_inverse=True)[1].reshape(-1)
    changing = [(values, _same_load(name, values, group)) for name, values in readings.columns.items()]
    if readings.temperature_degC is not None:
        changing.append((readings.temperature_degC, SAME_KELVIN))
    found = np.empty(len(alike), dtype=np.intp)
    for rows in _rows_of(alike):
        while len(rows):
            close = np.all([np.abs(values[rows] - values[rows[0]]) <= most for values, most in changing], axis=0)
            close = np.ones(len(rows), dtype=bool) & close
            found[rows[close]] = rows[0]
            rows = rows[~close]
    return found


def _same_load(name: str, values: FloatArray, pose: IntArray) -> float:
    """By how much a load differs between repeats, in its unit.

    Ranges within poses differ as the noise is large. Those of loads that were changed at each pose are alike, however
    large. A payload is known, not measured.
    """
    least = SAME_LOAD_SHARE * float(np.ptp(values))
    ranges = np.array([np.ptp(values[rows]) for rows in _rows_of(pose) if len(rows) > 1])
    if name == PAYLOAD or len(ranges) < LEAST_REPEATED:
        return least
    return max(least, LOAD_STDS * OVER_MEDIAN * float(np.median(np.abs(ranges - np.median(ranges)))) / STD_OF_RANGE)


def _agreeing(readings: Readings, group: IntArray) -> IntArray:
    """Groups without the readings that do not agree with most of their group, which are alone."""
    values, several = _measured(readings), [rows for rows in _rows_of(group) if len(rows) > 1]
    off = [values[rows] - np.median(values[rows], axis=0) for rows in several]
    most, n_further = MAX_OFF_MM, sum(len(rows) - 1 for rows in several)
    if values.size and n_further >= LEAST_REPEATED:
        freedom = n_further / (n_further + len(several))
        std = OVER_MEDIAN * float(np.median(np.abs(np.concatenate(off)))) / np.sqrt(freedom)
        most = max(most, MAX_STDS * std)
    found = group.copy()
    for rows, away in zip(several, off, strict=True):
        agree: BoolArray = np.linalg.norm(away, axis=1) <= most
        if 2 * agree.sum() <= len(rows):
            agree = np.zeros(len(rows), dtype=bool)
        found[rows[agree]] = rows[agree].min(initial=len(group))
        found[rows[~agree]] = rows[~agree]
    return found


def _moved(readings: Readings, rounds: Sequence[tuple[int, int]]) -> bool:
    """Whether poses changed between their rows in the first and in the last round by more than noise.

    The base, the reference, the tip or a joint's zero then moved, and means would hide it. Noise is as often positive
    as negative; such motions are alike at poses near each other in joint space, or at all.
    """
    values = _measured(readings)
    if len(rounds) < LEAST_REPEATED or not values.size:
        return False
    first, last = np.array(rounds).T
    changes = values[last] - values[first]
    middle = np.median(changes, axis=0)
    std = OVER_MEDIAN * np.median(np.abs(changes - middle))
    error = MEDIAN_ERROR * std / np.sqrt(len(changes))
    if np.linalg.norm(middle) > MAX_OFF_MM and (np.abs(middle) > MAX_ERRORS * error).any():
        return True
    length = np.linalg.norm(changes, axis=1, keepdims=True)
    # A gross error counts no more than two large changes.
    changes = changes * np.minimum(1.0, 2 * np.median(length) / np.maximum(length, np.finfo(float).tiny))
    near = _nearest(readings, first)
    alike = (changes * changes[near]).sum(axis=1)
    if alike.mean() <= MAX_OFF_MM**2:
        return False
    signs = np.random.default_rng(0).choice(np.array([-1.0, 1.0]), (N_SIGNS, len(changes)))
    by_chance = (signs * signs[:, near]) @ alike
    return bool((1 + (by_chance >= alike.sum()).sum()) / (1 + N_SIGNS) < SIGNIFICANCE)


def _nearest(readings: Readings, rows: IntArray) -> IntArray:
    """Of each of some rows the one of the others that is nearest in joint space, of the same anchor and tip."""
    from scipy.spatial import cKDTree

    parts = [readings.angles / np.maximum(np.ptp(readings.angles, axis=0), SAME_ANGLE)]
    for name in ("anchor", "tip"):
        if (names := getattr(readings, name)) is not None:
            parts.append(100.0 * np.unique(names, return_inverse=True)[1][:, None])
    at = np.hstack(parts)[rows]
    two = np.asarray(cKDTree(at).query(at, k=2)[1])
    return np.where(two[:, 0] == np.arange(len(rows)), two[:, 1], two[:, 0])


def _measured(readings: Readings) -> FloatArray:
    """(n, k) coordinates of points, or distances [mm], 0 where none was measured; k = 0 without any."""
    kinds = [readings.points, None if readings.distance_mm is None else readings.distance_mm[:, None]]
    return np.hstack([np.zeros((len(readings), 0)), *(np.nan_to_num(values) for values in kinds if values is not None)])


def _merged(readings: Kept, first: IntArray, member: IntArray, scatter: float) -> Kept:
    """The means of groups; their stated uncertainties as of a mean of readings that scatter so [mm]."""

    def mean(values: FloatArray) -> FloatArray:
        return _means(values, first, member)

    one_over = (1 / np.bincount(member))[:, None]

    def mean_std(std: FloatArray) -> FloatArray:
        random = np.minimum(std, scatter) ** 2
        return np.sqrt(mean(std**2 - random) + mean(random) * one_over.reshape(-1, *[1] * (std.ndim - 1)))

    def mean_turn(quaternion: FloatArray) -> FloatArray:
        against = (quaternion * quaternion[first][member]).sum(axis=1, keepdims=True) < 0  # q and -q are one rotation
        return mean(np.where(against, -quaternion, quaternion))

    def mean_angles(angles: FloatArray) -> FloatArray:
        """Rounded angles stay on their grid: half a step of it is their uncertainty."""
        means = mean(angles)
        if (means == angles[first]).all():
            return means
        step = rounding_steps(angles)
        on_grid = angles[first] + step * np.round((means - angles[first]) / np.where(step > 0, step, 1.0))
        return np.where(step > 0, on_grid, means)

    names = {
        "angles": mean_angles,
        "points": mean,
        "point_std": mean_std,
        "temperature_degC": mean,
        "quaternion": mean_turn,
    }
    names |= {"distance_mm": mean, "u_distance_mm": mean_std}
    stated = {name: getattr(readings, name) for name in names}
    changed: dict[str, Any] = {name: names[name](values) for name, values in stated.items() if values is not None}
    columns = {name: mean(values) for name, values in readings.columns.items()}
    return replace(readings.rows(first), **changed, columns=columns)


def _unstated(readings: Readings, scatter: float) -> float:
    """What the stated uncertainties do not contain of the scatter of repeats, as a standard deviation [mm]."""
    stated = [
        values[np.isfinite(values)]
        for values in (readings.point_std, readings.u_distance_mm)
        if values is not None and np.isfinite(values).any()
    ]
    known = (np.minimum(np.concatenate(stated), scatter) ** 2).mean() if stated else 0.0
    return float(np.sqrt(max(scatter**2 - known, 0.0)))


def _means(values: FloatArray, first: IntArray, member: IntArray) -> FloatArray:
    """Means of groups, as the first of each and the mean of the differences from it: of copies exactly the first."""
    more = values - values[first][member]
    count = np.bincount(member).reshape(-1, *[1] * (values.ndim - 1))
    total = np.zeros((len(first), *values.shape[1:]))
    np.add.at(total, member, more)
    return np.asarray(values[first] + total / count)


def _first_rows(labels: IntArray | FloatArray) -> IntArray:
    """(n,) the first row with the same labels (n, k)."""
    first, same = np.unique(labels, axis=0, return_index=True, return_inverse=True)[1:]
    return np.asarray(first[same.reshape(-1)])


def _rows_of(group: IntArray) -> list[IntArray]:
    """The rows of each group, rising."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
