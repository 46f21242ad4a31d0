"""Copies of measurements are found wherever they were moved, and noise is never taken for one."""

import datetime
from dataclasses import replace

import numpy as np
import pytest

from truearm.wings.laboratory.standards.copied_points import find_copy, find_repeated, find_shared
from truearm.wings.laboratory.standards.measured_points import PointGroup
from truearm.wings.laboratory.standards.positions import about_z, hemisphere

DAY = datetime.date(2026, 11, 3)


def lengths(rng, *, noise_mm=0.001, n=10, decimals=6, along=None):
    """Two bars' volumetric points: `n` positions of each length, anywhere or all along one direction."""
    for length in (900.0, 1700.0):
        for position in range(n):
            direction = rng.normal(size=3) if along is None else np.array(along, float)
            direction /= np.linalg.norm(direction)
            at = rng.uniform(-300, 300, 3)
            for end, point in (("A", at), ("B", at + length * direction)):
                keys = {"length": f"{length:g}", "position": f"{length:g}/{position}", "end": end}
                points = np.round(point + noise_mm * rng.normal(size=(1, 3)), decimals)
                yield PointGroup("bar", keys, points, 20.0, 0.0, DAY)


def moved(groups, rng, decimals=6):
    """Every length turned and moved on its own."""
    motions = {}
    for one in groups:
        turn, by = motions.setdefault(
            one.keys["position"], (np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3))
        )
        yield PointGroup(one.artefact, one.keys, np.round(one.points @ turn + by, decimals), 20.0, 0.0, DAY)


def balls(rng, turned, *, noise_mm=0.001, decimals=5):
    for i, turn in enumerate(turned):
        points = (12.5 * hemisphere(25)) @ about_z(turn).T + [300.0 * i, 100, 0] + noise_mm * rng.normal(size=(25, 3))
        yield PointGroup("ball", {"position": str(i)}, np.round(points, decimals), 20.0, 0.0, DAY)


def test_positions_that_are_turned_copies_of_one_are_found_by_the_number_of_equal_lengths(rng):
    true = list(lengths(rng))
    assert find_copy(true) is None
    first = {(one.keys["length"], one.keys["end"]): one.points for one in reversed(true)}
    copies = [PointGroup("bar", one.keys, first[one.keys["length"], one.keys["end"]], 20.0, 0.0, DAY) for one in true]
    assert find_copy(list(moved(copies, rng)))[1] == "18 of 20 measured lengths are to 20 nm as another one"


@pytest.mark.parametrize("decimals", [3, 4, 6])
@pytest.mark.parametrize("along", [None, (0, 1, 0)])
def test_noise_is_no_copy_however_the_coordinates_are_rounded(decimals, along):
    """Noise of 1 um, the least of any arm; along an axis, rounded lengths are equal by chance."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        assert find_copy(list(lengths(rng, decimals=decimals, along=along))) is None
        assert find_copy(list(balls(rng, (0, 0, 90), decimals=decimals))) is None


def test_points_as_found_are_compared_with_those_as_left_moved_or_turned(rng):
    left, other = list(lengths(rng)), list(lengths(rng))
    assert find_copy(other, left) is None
    by_5_mm = [PointGroup("bar", one.keys, one.points + 5.0, 20.0, 0.0, DAY) for one in left]
    assert find_copy(by_5_mm, left)[1].endswith("to 20 nm as length 900, position 900/0")
    assert find_copy(list(moved(left, rng)), left)[1] == "the test has 20 lengths to 20 nm as the test"
    (one,), (two,) = balls(rng, (0,)), balls(rng, (0,))
    assert find_copy([one], [two]) is None
    turned = PointGroup("ball", one.keys, np.round(one.points @ about_z(20), 5), 20.0, 0.0, DAY)
    assert find_copy([turned], [one]) is not None


def test_a_copy_in_another_order_is_found_and_noise_in_any_order_is_none():
    """25 points on a ball and 10 in a seat: what they have in common does not depend on their order."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        (one,), (other,) = balls(rng, (0,)), balls(rng, (30,))
        shuffled = PointGroup("ball", other.keys, one.points[rng.permutation(25)] + 4.0, 20.0, 0.0, DAY)
        assert "in another order" in find_copy([shuffled], [one])[1]
        assert find_copy([other], [one]) is None
        seats = [
            PointGroup("seat", {"position": str(i)}, rng.normal(0, 0.001, (10, 3)).round(5) + 300.0 * i, 20.0, 0.0, DAY)
            for i in range(3)
        ]
        assert find_copy(seats) is None
        for decimals in (2, 3, 4):  # rounded points are equal by chance
            rounded = [
                PointGroup("seat", one.keys, one.points.round(decimals), 20.0, 0.0, DAY, lines=tuple(range(10)))
                for one in seats
            ]
            assert find_repeated(rounded) is None


def seats(rng, of_seat, *, decimals=6, n=10):
    """Ten seats of ten points that `of_seat` scatters [mm]."""
    for i in range(n):
        points = np.round(of_seat(rng) + 300.0 * i + rng.uniform(-1, 1, 3), decimals)
        yield PointGroup("seat", {"position": str(i)}, points, 20.0, 0.0, DAY, lines=tuple(range(10 * i, 10 * i + 10)))


def on_grid(step_mm):
    """Points with a scatter of 10 um that are on an oblique grid, another one in every seat."""

    def of_seat(rng):
        counts = np.round(rng.normal(0, 0.01, (10, 3)) / step_mm)
        return counts * step_mm @ np.linalg.qr(rng.normal(size=(3, 3)))[0]

    return of_seat


@pytest.mark.parametrize(
    ("of_seat", "decimals"),
    [
        (on_grid(0.01), 6),
        (on_grid(0.02), 6),
        (on_grid(0.01), 3),
        (lambda rng: rng.normal(0, (0.02, 0.0005, 0.0005), (10, 3)), 3),
        (lambda rng: rng.normal(0, (0.01, 0.0002, 0.0002), (10, 3)), 3),
    ],
)
def test_points_that_are_equal_by_coarse_digits_or_encoders_are_not_refused(of_seat, decimals):
    """On an oblique grid as coarse as the scatter, and where the scatter has one direction: up to 2 in 100 remarked."""
    found = [find_repeated(list(seats(np.random.default_rng(i), of_seat, decimals=decimals))) for i in range(100)]
    assert not any(one and one[2] for one in found)
    assert sum(one is not None for one in found) <= 2


@pytest.mark.parametrize(
    ("copied", "source", "certain"),
    [([4], [3], True), ([4, 5], [3, 3], True), ([14], [3], True), ([4, 5, 6], [0, 1, 2], True), ([7], [2], False)],
    ids=["bounce", "bounce of two", "other seat", "block", "one row of a seat"],
)
@pytest.mark.parametrize("scatter_mm", [0.01, (0.02, 0.0005, 0.0005)])
def test_copies_that_no_grid_explains_are_certain_where_rows_follow_or_seats_differ(
    copied, source, certain, scatter_mm
):
    for seed in range(10):
        groups = list(seats(np.random.default_rng(seed), lambda rng: rng.normal(0, scatter_mm, (10, 3))))
        points = np.concatenate([one.points for one in groups])
        points[copied] = points[source]
        groups = [replace(one, points=points[10 * i : 10 * i + 10]) for i, one in enumerate(groups)]
        _, said, is_certain = find_repeated(groups)
        assert said.startswith(f"position {copied[0] // 10}: the point of line {copied[0]} has the same coordinates as")
        assert is_certain == certain


def test_a_run_that_is_the_mean_of_two_others_was_not_measured():
    """Wherever it was moved; that three runs scatter about each other is no mean."""
    rng = np.random.default_rng(4)

    def runs(third):
        first, second = (one.points for one in balls(rng, (0, 0)))
        return [
            PointGroup("ball", {"repeat": str(i)}, points.round(5), 20.0, 0.0, DAY)
            for i, points in enumerate((first, second, third(first, second)), start=1)
        ]

    own = next(balls(rng, (0,))).points
    assert find_copy(runs(lambda first, second: own)) is None
    assert (
        find_copy(runs(lambda first, second: (first + second) / 2))[1]
        == "repeat 3 is to 20 nm the mean of repeat 1 and repeat 2"
    )
    assert find_copy(runs(lambda first, second: (first + second) / 2 + 3.0)) is not None
    assert find_copy(runs(lambda first, second: 0.3 * first + 0.7 * second)) is None


def test_points_of_one_test_are_not_those_of_another(rng):
    """Lengths between balls and between opposite faces; a group of an articulation out of the points of a probing."""
    uni, bi = list(lengths(rng)), list(lengths(rng))
    assert find_shared(bi, uni) is None
    moved_on = [PointGroup("bar", one.keys, one.points + 2.0, 20.0, 0.0, DAY) for one in uni]
    assert find_shared(moved_on, uni) is not None
    (probing,) = balls(rng, (0,))
    group = PointGroup("ball", {"position": "1", "group": "A"}, probing.points[[0, 4, 9, 14, 19]], 20.0, 0.0, DAY)
    assert (
        find_shared([group], [probing])[1] == "position 1, group A has 5 points with the same coordinates as position 0"
    )
    assert find_shared([next(balls(rng, (0,)))], [probing]) is None
