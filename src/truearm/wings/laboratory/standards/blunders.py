"""Blunders: mistakes of the operator that no arm makes, reported as remarks beside the verdict.

The verdict does not change, as the program cannot be certain. A remark on a length or size far beyond its limit names
the number to check; a remark on a single deviating point, or group of points, names its line in the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere
from truearm.wings.laboratory.shapes.minimum_zone import circumscribed_sphere
from truearm.wings.laboratory.standards.decision import ConformityResult
from truearm.wings.laboratory.standards.measurands import LengthMeasurement, SphereMeasurement
from truearm.wings.laboratory.standards.measured_points import PointGroup, join_names
from truearm.wings.laboratory.standards.specification import Specification

# Chosen here: an arm out of adjustment exceeds its limits by some times; 20 times 0.02 to 0.05 mm, 0.4 to 1 mm, is due
# to a mistyped number or another artefact.
FAR_BEYOND = 20.0
# A point is a single outlier if the scatter of the others without it falls to this share.
ALONE = 0.1
# Smaller distances are ignored [mm]: of equal points each would be an outlier.
LEAST_MM = 0.001
# Few points may agree without one by chance. With these numbers of points and equal noise, fewer than 1 in 1000
# simulated groups had a single outlier: 0.5 in 1000 balls of 9 points (of 8: 3.3), 0.6 in 1000 seats of 6 whose points
# scatter along one line and a fiftieth as far across it (of 5: 3.6), 0.2 in 1000 of 5 groups whose centres scatter a
# tenth as far across (a fiftieth: 1.5; of 4 and a fiftieth: 15). Of 5 seats or groups that scatter alike in all
# directions none.
LEAST_ON_BALL, LEAST_IN_SEAT, LEAST_GROUPS = 9, 6, 5


def on_spheres(
    test: str, groups: Sequence[PointGroup], spheres: Sequence[SphereMeasurement], size: ConformityResult
) -> Iterator[str]:
    """Report single points off a ball; if there are none, a size (the row `size`) far beyond its limit."""
    clean = True
    for group, one in zip(groups, spheres, strict=True):
        away = np.abs(np.linalg.norm(one.points - one.fit.centre, axis=1) - one.fit.radius_mm)
        i = _single_outlier(one.points, away, lambda some: fit_sphere(some).form_mm, least=LEAST_ON_BALL)
        if i is not None:
            clean = False
            rest = fit_sphere(np.delete(one.points, i, axis=0))
            off = abs(float(np.linalg.norm(one.points[i] - rest.centre)) - rest.radius_mm)
            yield (
                f"test {test!r}, {group.where}: only the point of line {group.lines[i]} deviates, by {off:.2g} mm "
                f"from the sphere of the others, whose form is {rest.form_mm:.4f} mm; measure the position again"
            )
    if clean and size.limit is not None and abs(size.value) > FAR_BEYOND * size.limit:
        yield (
            f"{_beyond(size.label, size.value, size.limit)}; check diameter_mm of {spheres[0].sphere.name!r}, and "
            f"whether the points are compensated or need tip_diameter_mm"
        )


def in_groups(test: str, groups: Sequence[PointGroup], spheres: Sequence[SphereMeasurement]) -> Iterator[str]:
    """Report a group of an articulation whose sphere deviates from those of all others at its position."""
    centres = np.array([one.fit.centre for one in spheres])
    away = _from_mean(centres)
    i = _single_outlier(centres, away, lambda some: circumscribed_sphere(some).diameter_mm, least=LEAST_GROUPS)
    if i is not None:
        yield (
            f"test {test!r}, {groups[i].where} (line {groups[i].line}): only its sphere deviates, by {away[i]:.2g} mm "
            f"from the mean of all groups; measure the group again"
        )


def in_seats(test: str, groups: Sequence[PointGroup]) -> Iterator[str]:
    """Report single deviating points in a seat."""
    for group in groups:
        away = _from_mean(group.points)
        i = _single_outlier(group.points, away, lambda some: float(_from_mean(some).max()), least=LEAST_IN_SEAT)
        if i is not None:
            yield (
                f"test {test!r}, {group.where}: only the point of line {group.lines[i]} deviates, by "
                f"{away[i]:.2g} mm from the mean of all points; measure the position again"
            )


def in_lengths(pairs: Sequence[tuple[LengthMeasurement, PointGroup]], specification: Specification) -> Iterator[str]:
    """Report lengths with errors far beyond those of any arm.

    Parameters
    ----------
    pairs : sequence of (LengthMeasurement, PointGroup)
        The measured lengths, each with the points of end A.
    specification : Specification
    """
    errors = [one.error(corrected=specification.corrected_to_20_degC) for one, _ in pairs]
    by_length: dict[tuple[str, str], list[int]] = {}
    for i, (one, _) in enumerate(pairs):
        by_length.setdefault((one.bar.name, one.length.name), []).append(i)
    for members in by_length.values():
        first = pairs[members[0]][0]
        size = first.length.length_mm
        limit = specification.limit(first.symbol, size)
        if limit is None or not (far := [i for i in members if abs(errors[i]) > FAR_BEYOND * limit]):
            continue
        problem = _beyond(f"{first.symbol}, {first.length.name}", max((errors[i] for i in far), key=abs), limit)
        if len(far) == len(members):
            yield (
                f"{problem}, and so are all measurements of this length; check length_mm = {size:.10g} of "
                f"{first.bar.name!r}, and the names of its lengths in the points"
            )
        else:
            runs = join_names([f"{pairs[i][1].where} (line {pairs[i][1].line})" for i in far], "; ")
            lone = any(len(end) == 1 for i in far for end in (pairs[i][0].start, pairs[i][0].end))
            ends = ", and that single points are seats or centres of balls, not points on a ball" if lone else ""
            yield f"{problem}; check {runs}{ends}"


def _beyond(label: str, value: float, limit: float) -> str:
    return f"{label}: {value:+.4f} mm is {abs(value) / limit:.0f} times the limit: probably a blunder"


def _single_outlier(
    points: FloatArray, away: FloatArray, spread: Callable[[FloatArray], float], *, least: int
) -> int | None:
    """The index of a single outlier among points (n, 3), the farthest by `away` (n,); None if there is none."""
    i = int(away.argmax())
    if len(points) >= least and away[i] > LEAST_MM and spread(np.delete(points, i, axis=0)) <= ALONE * spread(points):
        return i
    return None


def _from_mean(points: FloatArray) -> FloatArray:
    """Distances (n,) of points from their mean [mm]."""
    return np.asarray(np.linalg.norm(points - points.mean(axis=0), axis=1))
