"""Repeats: readings of one pose, and one reading in place of those that only repeat each other.

What an arm does wrong at a pose it does at every reading there: repeats show how an instrument scatters, and nothing of
other poses. Counted as readings of their own they pass their small scatter off as that between poses. So readings that
differ in nothing that is stated are merged into their mean, of standard uncertainty ``s / sqrt(k)`` for k readings that
scatter by s (JCGM 100:2008, 4.2.3). What they have in common with the instrument's error at this place stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from truearm.readings.readings import SHARED_UNCERTAINTIES, TOUCHED, Readings
from truearm.typing import BoolArray, FloatArray, IntArray

Kept = TypeVar("Kept", bound=Readings)

# Angles of one pose differ by no more: the noise of encoders, and what a drive leaves when it returns (a UR10: 4e-5 rad
# in half, 1e-4 in nine tenths of its returns). In rad, or of a sliding joint mm, and as a share of the joint's range.
SAME_ANGLE, SAME_SHARE = 1e-4, 1e-5
# Links may be so far behind a thermometer [K], as `identification.judgement.expansion_prior` has it.
SAME_KELVIN = 1.0
# Measured torques of a joint that stands still differ by some per cent of their range.
SAME_LOAD_SHARE = 0.05
# A repeat that is off by more standard deviations of repeats, or by this [mm], is not merged: a slipped tip, whose
# reading is then judged by itself. Trackers and probing tips repeat to a few micrometres.
MAX_STDS, MAX_OFF_MM = 10.0, 0.02
# A mean change from first to last readings of so many standard errors is none of chance [1].
MAX_ERRORS = 6.0
# Poses that were read several times, from which the standard deviation of repeats is known to a factor of two.
LEAST_REPEATED = 5


@dataclass(frozen=True, eq=False)
class MergedReadings(Generic[Kept]):
    """Readings of which each stands for those that it repeats.

    Attributes
    ----------
    readings : Readings
        The means of repeats, numbered as the first of each.
    first : (n,) int array
        Its row in the readings as given.
    count : (n,) int array
        How many readings each stands for.
    scatter_mm : float
        Standard deviation of a coordinate or a distance within a pose [mm]; 0 without repeats, or if they are copies.
    """

    readings: Kept
    first: IntArray
    count: IntArray
    scatter_mm: float


def readings_of_one_pose(readings: Readings, *, exactly: bool = False) -> IntArray:
    """(n,) numbers of the poses of readings: those with the same angles, `exactly` or but for noise, are together.

    They may be distances to several anchors, several tips, two directions of approach, or repeats. The number of a pose
    is the row of its first reading.
    """
    angles, n = readings.angles, len(readings)
    if exactly or n < 2:
        _, first, pose = np.unique(angles, axis=0, return_index=True, return_inverse=True)
        return np.asarray(first[pose.reshape(-1)])
    from scipy.spatial import cKDTree

    scaled = angles / np.maximum(SAME_ANGLE, SAME_SHARE * np.ptp(angles, axis=0))
    kept, same = np.unique(scaled, axis=0, return_index=True, return_inverse=True)[1:]
    order = np.argsort(kept)
    group = np.arange(len(kept))
    near: dict[int, list[int]] = {}
    for a, b in np.sort(cKDTree(scaled[kept[order]]).query_pairs(1.0, p=np.inf, output_type="ndarray"), axis=1):
        near.setdefault(int(a), []).append(int(b))
    for one in sorted(near):  # those near the first of a pose, not near each other in a chain
        if group[one] == one:
            group[[other for other in near[one] if group[other] == other]] = one
    rank = np.empty(len(kept), dtype=np.intp)
    rank[order] = np.arange(len(kept))
    return np.asarray(kept[order][group[rank[same.reshape(-1)]]])


def merge_repeats(readings: Kept) -> MergedReadings[Kept]:
    """Merge readings of one pose that are stated alike and agree, each pose into their mean.

    Readings at other temperatures, with other loads, directions of movement or tips, or of other sessions, are no
    repeats. A reading that is far from the median of its pose is left alone, and so are two that disagree; and
    all of them if the frame moved between rounds through the poses.
    """
    n = len(readings)
    group = _stated_alike(readings, readings_of_one_pose(readings))
    if len(np.unique(group)) < n:
        group = _agreeing(readings, group)
    first, member, count = np.unique(group, return_inverse=True, return_counts=True)[:3]
    if len(first) == n:
        return MergedReadings(readings, np.arange(n), np.ones(n, dtype=np.intp), 0.0)
    values = _measured(readings)
    off = values - _means(values, first, member)[member]
    scatter = float(np.sqrt((off**2).sum() / max(off.shape[1] * (n - len(first)), 1)))
    return MergedReadings(_merged(readings, first, member, scatter), first, count, scatter)


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
    changing = [(values, SAME_LOAD_SHARE * float(np.ptp(values))) for values in readings.columns.values()]
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


def _agreeing(readings: Readings, group: IntArray) -> IntArray:
    """Groups without the readings that do not agree with most of their group, which are alone."""
    values, several = _measured(readings), [rows for rows in _rows_of(group) if len(rows) > 1]
    if _moved(values, several):
        return np.arange(len(group))
    stds = [float(np.sqrt(values[rows].var(axis=0, ddof=1).mean())) for rows in several] if values.size else []
    most = max(MAX_OFF_MM, MAX_STDS * float(np.median(stds)) if len(stds) >= LEAST_REPEATED else 0.0)
    found = group.copy()
    for rows in several:
        off = np.linalg.norm(values[rows] - np.median(values[rows], axis=0), axis=1)
        agree: BoolArray = off <= most
        if 2 * agree.sum() <= len(rows):
            agree = np.zeros(len(rows), dtype=bool)
        found[rows[agree]] = rows[agree].min(initial=len(group))
        found[rows[~agree]] = rows[~agree]
    return found


def _moved(values: FloatArray, several: Sequence[IntArray]) -> bool:
    """Whether the last reading of each pose differs from its first by the same on average.

    The base or the reference then moved between rounds through the poses. Means would hide it.
    """
    changes = np.array([values[rows[-1]] - values[rows[0]] for rows in several])
    if len(changes) < LEAST_REPEATED or not changes.size:
        return False
    mean, error = changes.mean(axis=0), changes.std(axis=0, ddof=1) / np.sqrt(len(changes))
    return bool(np.linalg.norm(mean) > MAX_OFF_MM and (np.abs(mean) > MAX_ERRORS * error).any())


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

    names = {"angles": mean, "points": mean, "point_std": mean_std, "temperature_degC": mean, "quaternion": mean_turn}
    names |= {"distance_mm": mean, "u_distance_mm": mean_std}
    stated = {name: getattr(readings, name) for name in names}
    changed: dict[str, Any] = {name: names[name](values) for name, values in stated.items() if values is not None}
    columns = {name: mean(values) for name, values in readings.columns.items()}
    return replace(readings.rows(first), **changed, columns=columns)


def _means(values: FloatArray, first: IntArray, member: IntArray) -> FloatArray:
    """Means of groups, as the first of each and the mean of the differences from it: of copies exactly the first."""
    more = values - values[first][member]
    count = np.bincount(member).reshape(-1, *[1] * (values.ndim - 1))
    total = np.zeros((len(first), *values.shape[1:]))
    np.add.at(total, member, more)
    return np.asarray(values[first] + total / count)


def _rows_of(group: IntArray) -> list[IntArray]:
    """The rows of each group, rising."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
