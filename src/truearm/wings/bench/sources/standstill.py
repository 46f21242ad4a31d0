"""Standstill: a reading is the mean of the samples while no joint moves, taken once until the arm moves again.

With it stands the direction of each joint's last movement, on which backlash and friction depend (hysteresis).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from math import radians

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.bench.sources.sample import Sample


class LastMovement:
    """The sign of each joint's last movement: -1, 1, or 0 as long as it has not moved.

    Attributes
    ----------
    signs : (n_joints,) array
    """

    def __init__(self, angles_rad: FloatArray) -> None:
        self.signs: FloatArray = np.zeros(len(angles_rad))
        self._extreme = angles_rad

    def add(self, angles_rad: FloatArray, least: FloatArray) -> None:
        """Take in the next angles; a joint turns round when it comes back by more than `least` [rad, or mm]."""
        moved = angles_rad - self._extreme
        has_moved = np.abs(moved) > least
        self.signs = np.where(has_moved, np.sign(moved), self.signs)
        self._extreme = np.where(has_moved | (moved * self.signs > 0), angles_rad, self._extreme)


LEAST_SAMPLES = 3
MOST_SAMPLES = 10_000  # in a window; a device that sends more is noise
LEAST_KEPT = 64
MOVED = 10  # spreads between a reading and the pose from which the next is taken


@dataclass(frozen=True)
class StandstillRule:
    """When an arm stands still.

    Attributes
    ----------
    window_s : float
        For so long [s] ...
    spread_rad, spread_mm : float
        ... the largest and the smallest angle of every joint differ by no more than this; of a sliding joint, its
        displacements.

    Raises
    ------
    InputError
        If one of them is not positive.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.StandstillRule(window_s=1.0).window_s
    1.0
    """

    window_s: float = 0.5
    spread_rad: float = radians(0.05)
    spread_mm: float = 0.05

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < 1e3:
                raise InputError(f"expected a positive {name}, got {value}")


@dataclass(frozen=True, eq=False)
class TakenReading:
    """The mean of the samples of a window.

    Attributes
    ----------
    start_s, end_s : float
        Times of the first and the last sample.
    joint_angles_rad, joint_std_rad : (n_joints,) array
        Mean and standard deviation [rad, or mm]; NaN of a single sample.
    directions : (n_joints,) array
        Sign of each joint's last movement: -1, 1, or 0 if it is not known.
    n : int
        Number of samples.
    tip_in_reference_mm : (3,) array, optional
        Mean of the points of these samples.
    temperature_degC : float, optional
    columns : mapping of str to float
    """

    start_s: float
    end_s: float
    joint_angles_rad: FloatArray
    joint_std_rad: FloatArray
    directions: FloatArray
    n: int
    tip_in_reference_mm: FloatArray | None
    temperature_degC: float | None
    columns: Mapping[str, float]


class Standstill:
    """The samples of the last window, and whether a reading was taken at this pose.

    Parameters
    ----------
    rule : StandstillRule
    prismatic : tuple of int
        Numbers of the joints that slide.

    Attributes
    ----------
    is_still : bool
        Whether the samples fill the window and no joint moves in it.
    """

    def __init__(self, rule: StandstillRule, prismatic: tuple[int, ...] = ()) -> None:
        self._rule, self._prismatic = rule, [number - 1 for number in prismatic]
        self._window: deque[Sample] = deque(maxlen=MOST_SAMPLES)
        self._taken_at: FloatArray | None = None
        self._movement: LastMovement | None = None
        self._stated: FloatArray | None = None
        self._angles, self._n_angles = np.empty((0, 0)), 0  # by joint of the window, which ends there, and before it
        self.is_still = False

    def add(self, sample: Sample) -> None:
        """Take in the next sample. A gap of a window's length, or a clock that jumps, starts a new one."""
        window = self._window
        if window:
            gap_s = sample.time_s - window[-1].time_s
            if not 0 <= gap_s <= self._rule.window_s:
                window.clear()
        if not window:
            self._angles, self._n_angles = np.empty((len(sample.joint_angles_rad), 0)), 0
        if self._movement is None:
            self._movement = LastMovement(sample.joint_angles_rad)
            self._allowed = np.full(len(sample.joint_angles_rad), self._rule.spread_rad)
            self._allowed[self._prismatic] = self._rule.spread_mm
        self._keep(sample.joint_angles_rad)
        window.append(sample)
        self._stated = sample.directions
        self._movement.add(sample.joint_angles_rad, self._allowed)
        while len(window) > 1 and sample.time_s - window[1].time_s >= self._rule.window_s:
            window.popleft()
        moved = self._taken_at is not None and np.abs(sample.joint_angles_rad - self._taken_at) > MOVED * self._allowed
        if np.any(moved):
            self._taken_at = None
        self.is_still = self._stands()

    def _keep(self, angles_rad: FloatArray) -> None:
        """Keep the angles of the window as one array: at a thousand samples a second, to gather them takes longest."""
        if self._n_angles == self._angles.shape[1]:
            before, n = self._angles[:, self._n_angles - len(self._window) :], len(self._window)
            self._angles = np.empty((len(angles_rad), LEAST_KEPT + 2 * n))
            self._angles[:, :n], self._n_angles = before, n
        self._angles[:, self._n_angles] = angles_rad
        self._n_angles += 1

    def _stands(self) -> bool:
        window = self._window
        if len(window) < LEAST_SAMPLES or window[-1].time_s - window[0].time_s < self._rule.window_s:
            return False
        angles = self._angles[:, self._n_angles - len(window) : self._n_angles]
        return bool((angles.max(axis=1) - angles.min(axis=1) <= self._allowed).all())

    @property
    def window_s(self) -> tuple[float, float]:
        """Times of the first and the last sample of the window [s]."""
        return self._window[0].time_s, self._window[-1].time_s

    @property
    def mean_rad(self) -> FloatArray:
        """(n_joints,) Mean of the window [rad, or mm]."""
        return self.mean([*self._window]).joint_angles_rad

    @property
    def is_new(self) -> bool:
        """Whether no reading was taken since the arm moved."""
        return self._taken_at is None

    def taken(self) -> TakenReading:
        """The mean of the window, which counts as taken until the arm moves."""
        reading = self.mean([*self._window])
        self._taken_at = reading.joint_angles_rad
        return reading

    def last(self) -> TakenReading:
        """The last sample alone: a reading of an arm that moves."""
        return self.mean([self._window[-1]])

    @property
    def directions(self) -> FloatArray:
        """(n_joints,) Sign of each joint's last movement."""
        assert self._movement is not None  # there was a sample
        return self._movement.signs if self._stated is None else self._stated

    def mean(self, samples: list[Sample]) -> TakenReading:
        """The mean of samples."""
        first = samples[0].joint_angles_rad
        angles = np.array([one.joint_angles_rad for one in samples]) - first  # equal samples have exactly their mean
        points = [one.tip_in_reference_mm for one in samples if one.tip_in_reference_mm is not None]
        temperatures = [one.temperature_degC for one in samples if one.temperature_degC is not None]
        n = len(samples)
        return TakenReading(
            samples[0].time_s,
            samples[-1].time_s,
            first + angles.mean(axis=0),
            angles.std(axis=0, ddof=1) if n > 1 else np.full(angles.shape[1], np.nan),
            self.directions,
            n,
            points[0] + np.mean(np.array(points) - points[0], axis=0) if points else None,
            float(np.mean(temperatures)) if temperatures else None,
            {name: float(np.mean([one.columns[name] for one in samples])) for name in samples[-1].columns},
        )
