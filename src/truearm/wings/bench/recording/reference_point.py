"""The point that the reference measures at a reading: by the source itself, a second instrument, or typed."""

from __future__ import annotations

from collections import deque

import numpy as np

from truearm.typing import FloatArray
from truearm.wings.bench.recording.session_log import Event
from truearm.wings.bench.sources import Sample, Source
from truearm.wings.bench.sources.standstill import TakenReading

TYPED = "typed"
LARGEST_SPREAD_MM = 0.1  # of a second instrument in the window of a reading
WAIT_S = 1.0  # the second instrument may lag behind the arm
MOST_SAMPLES = 10_000
LARGEST_NUMBER = 1e9  # mm, or deg


class ReferencePoint:
    """What measures the tip.

    Parameters
    ----------
    reference : Source or "typed", optional
        If not the source of the angles.
    """

    def __init__(self, reference: Source | str | None) -> None:
        self._reference = reference
        self._samples: deque[Sample] = deque(maxlen=MOST_SAMPLES)
        self._typed_mm: FloatArray | None = None

    def add(self, sample: Sample) -> None:
        """Take in a sample of the second instrument."""
        if sample.tip_in_reference_mm is not None:
            self._samples.append(sample)

    def forget(self) -> None:
        """Forget the typed point: it was of another standstill."""
        self._typed_mm = None

    def is_late(self, still_s: float) -> bool:
        """Whether the second instrument had its time in a standstill that lasts so long [s]."""
        return not isinstance(self._reference, Source) or still_s > WAIT_S

    def missing(self, window_s: tuple[float, float]) -> str:
        """Why there is no point for the samples of a window of time [s]; empty if there is."""
        if self._reference == TYPED and self._typed_mm is None:
            return "still: type the point"
        if isinstance(self._reference, Source):
            points = self._measured(window_s)
            if not len(points):
                away_s = self._samples[-1].time_s - window_s[1] if self._samples else 0.0
                differ = "; its last one is of another time: it sees no target, or its clock is another"
                return f"{self._reference.name} gives no point while the arm stands still" + differ * (
                    abs(away_s) > WAIT_S
                )
            if (spread := float(np.ptp(points, axis=0).max())) > LARGEST_SPREAD_MM:
                return f"{self._reference.name}: the points of this standstill differ by {spread:.3f} mm"
        return ""

    def of(self, reading: TakenReading) -> FloatArray | None:
        """(3,) the point of a reading [mm], if there is one."""
        if self._reference == TYPED:
            return self._typed_mm
        if isinstance(self._reference, Source):
            points = self._measured((reading.start_s, reading.end_s))
            return points.mean(axis=0) if len(points) else None
        return reading.tip_in_reference_mm

    def type(self, text: str, *, is_still: bool) -> Event:
        """Take the point that a person typed."""
        point = typed_numbers(text)
        if self._reference != TYPED:
            return Event("refused", "points are not typed here: start with --reference typed")
        if not is_still:
            return Event("refused", "type the point while the arm stands still: it is that of this standstill")
        if point.shape != (3,):
            return Event("refused", f"expected a point as three numbers in mm, got {text[:40]!a}")
        self._typed_mm = point
        return Event("notice", "point {:g} {:g} {:g} mm".format(*point))

    def _measured(self, window_s: tuple[float, float]) -> FloatArray:
        """(n, 3) points of the second instrument in a window of time [mm]."""
        start_s, end_s = window_s
        found = [one.tip_in_reference_mm for one in self._samples if start_s <= one.time_s <= end_s]
        return np.array(found).reshape(-1, 3)


def typed_numbers(text: str) -> FloatArray:
    """The numbers that a person typed; empty if one of the words is none, or absurdly large."""
    try:
        found = np.array([float(part) for part in text.replace(",", " ").split()])
    except ValueError:
        return np.empty(0)
    return found if (np.abs(found) < LARGEST_NUMBER).all() else np.empty(0)
