"""One statistic of a whole check: how far all its readings lie from the mean of those in the same poses before.

The errors of an arm make a pattern over the poses of a check: each reading deviates from its seat or its sphere in a
way of its own. Scatter, length error, form and diameter are what little of it a standard asks for; two arms of one type
may agree in all of them to within their limits, and their patterns still differ by twice what an arm repeats to.

With the pattern ``d_i`` of check i and the mean ``m`` of the n patterns before, ``w_i = (d_i - m) / sqrt(1 + 1/n)`` are
the recursive residuals of a constant (R. L. Brown, J. Durbin, J. M. Evans, J. Royal Statistical Society B 37 (1975) 149
[recalled]): independent and of one covariance as long as nothing changes, whatever that covariance is. So their mean
squares are independent values of one distribution, and a control chart of scatters applies to them. Hotelling's
statistic needs the covariance of sixty coordinates, which ten checks do not show.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import ndtri

from truearm.typing import FloatArray, IntArray
from truearm.wings.laboratory.monitor.control_chart import ControlChart, ControlRules, control_chart
from truearm.wings.laboratory.monitor.interim_check import CheckValue, InterimCheck

SAME_POSE = 0.35
"""The largest difference of a joint between two readings that are compared: 20 deg, or 0.35 m of a joint that slides.

A person who takes the same poses again is off by ten degrees; an error of one or two cycles a turn hardly changes.
"""

LEAST_READINGS = 6
"""Readings in poses of earlier checks with which a whole check is compared; with fewer it is not."""

SEEN = 0.9
"""The probability with which a change of the stated size is seen."""


@dataclass(frozen=True, eq=False)
class WholeCheck:
    """The differences of whole checks from those before them, and their chart.

    Attributes
    ----------
    values : tuple of CheckValue
        Root mean square over the readings [mm].
    checks : tuple of int
        The checks that have a value: those with readings in the poses of earlier ones.
    chart : ControlChart
        Of the values.
    """

    values: tuple[CheckValue, ...]
    checks: tuple[int, ...]
    chart: ControlChart

    @property
    def seen_mm(self) -> float | None:
        """The change that the last value would have shown with the probability `SEEN`; None of too few checks [mm].

        Root mean square over the readings, of what moves them against each other. A change delta adds its square to the
        mean square, whose scatter is that of the earlier checks: of ``nu`` degrees of freedom, with variance
        ``2 s^4 / nu (1 + 2 delta^2 / s^2)`` (noncentral chi-square).
        """
        chart = self.chart
        if not chart.enough:
            return None
        unchanged = ~chart.out_of_limits[:-1]
        squares = chart.values[:-1][unchanged][: int(chart.n_before[-1])] ** 2
        mean, n = float(squares.mean()), len(squares)
        spread = float(ndtri(SEEN)) ** 2 * float(squares.var(ddof=1)) / mean  # z^2 2 s^2 / nu
        beyond = float(chart.upper[-1]) ** 2 - mean
        # (delta^2 - beyond)^2 = spread (s^2 + 2 delta^2), the larger root
        half = beyond + spread
        added = half + np.sqrt(max(half**2 - beyond**2 + spread * mean, 0.0))
        return float(np.sqrt(added * (1 + 1 / (n + 1))))


def whole_check(
    checks: Sequence[InterimCheck], rules: Sequence[ControlRules], days: Sequence[float]
) -> WholeCheck | None:
    """Compare each check as a whole with those before it.

    A check whose value has changed does not enter the mean of those after it.

    Parameters
    ----------
    checks : sequence of InterimCheck
        In the order of their dates; withdrawn ones do not count.
    rules : sequence of ControlRules
        Of the chart, for each check.
    days : sequence of float
        Times of the checks [d].

    Returns
    -------
    WholeCheck or None
        None where no check has readings in the poses of an earlier one.
    """
    readings = {i: _by_artefact(check) for i, check in enumerate(checks) if check.withdrawn is None}
    changed: set[int] = set()
    while True:
        values = _differences(readings, changed)
        if not values:
            return None
        at = list(values)
        chart = control_chart(
            [values[i].value_mm for i in at],
            u=np.zeros(len(at)),
            rules=[rules[i] for i in at],
            days=[days[i] for i in at],
            scale=True,
        )
        beyond = {at[j] for j in np.flatnonzero(chart.out_of_limits)} - changed
        after = set() if chart.change_index is None else set(at[chart.change_index :]) - changed
        if not beyond and not after:
            return WholeCheck(tuple(values.values()), tuple(at), chart)
        # What comes after a change was compared with a mean that contains it: judged again without.
        changed |= after or {min(beyond)}


class _Readings(NamedTuple):
    """Readings on an artefact: poses (n, k) [rad, m] and deviations (n, 3) [mm], and of how many each is the mean."""

    poses: FloatArray
    deviations: FloatArray
    counts: FloatArray


def _by_artefact(check: InterimCheck) -> dict[str, _Readings]:
    found = {}
    for artefact in dict.fromkeys(one.artefact for one in check.readings):
        readings = [one for one in check.readings if one.artefact == artefact]
        poses, deviations = (np.array([getattr(one, part) for one in readings]) for part in ("pose", "deviation_mm"))
        found[artefact] = _Readings(poses, deviations, np.ones(len(readings)))
    return found


def _differences(checks: Mapping[int, Mapping[str, _Readings]], changed: Collection[int]) -> dict[int, CheckValue]:
    """The value of each check that can be compared, by its number."""
    before: dict[str, _Readings] = {}
    found = {}
    for i, check in checks.items():
        residuals = []
        for artefact, readings in check.items():
            known = before.get(artefact)
            if known is None or known.poses.shape[1] != readings.poses.shape[1]:
                if known is None and i not in changed:
                    before[artefact] = readings
                continue
            here, there = _same_poses(readings.poses, known.poses)
            away = readings.deviations[here] - known.deviations[there]
            counts = known.counts[there, None]
            if len(here):
                # The mean over all readings of a seat or a sphere is zero; over some of them it is no difference.
                scaled = away / np.sqrt(1 + 1 / counts)
                residuals.append(scaled - scaled.mean(axis=0))
            if i not in changed:
                deviations, n = known.deviations.copy(), known.counts.copy()
                deviations[there] += away / (counts + 1)
                n[there] += 1
                new = _Readings(*(np.delete(part, here, axis=0) for part in readings))
                before[artefact] = _Readings(*map(np.concatenate, zip((known.poses, deviations, n), new, strict=True)))
        if (m := sum(map(len, residuals))) >= LEAST_READINGS:
            rms = float(np.sqrt(sum(float((one**2).sum()) for one in residuals) / m))
            found[i] = CheckValue("difference", "", rms, 0.0, 0.0, m)
    return found


def _same_poses(here: FloatArray, there: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows of two sets of poses that are the same pose, in pairs that are nearest in all."""
    turned = here[:, None] - there
    apart = np.abs(turned - 2 * np.pi * np.round(turned / (2 * np.pi))).max(axis=2)
    rows, columns = linear_sum_assignment(np.minimum(apart, 2 * SAME_POSE))
    same = apart[rows, columns] <= SAME_POSE
    return rows[same], columns[same]
