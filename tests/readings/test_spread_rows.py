"""A few readings, spread over the positions or in a few seats."""

import numpy as np

from refusals import refuses
from truearm.readings import Session, stratified_rows


def readings(n, **names):
    rng = np.random.default_rng(0)
    points = names.pop("points", rng.normal(size=(n, 3)))
    return Session(rng.normal(size=(n, 2)), points, **{k: np.array(v) for k, v in names.items()})


def test_one_of_each_position_before_a_second_of_any():
    position = [f"P{i}" for i in range(6) for _ in range(i + 1)]
    given = readings(21, position=position)
    for n in (1, 4, 6, 9, 21):
        rows = stratified_rows(given, n, seed=3)
        assert len(rows) == n
        assert (np.diff(rows) > 0).all()
        counts = np.unique(given.position[rows], return_counts=True)[1]
        assert len(counts) == min(n, 6)
    assert sorted(given.position[stratified_rows(given, 6, seed=1)]) == sorted(set(position))


def test_the_seed_decides():
    given = readings(200)
    assert stratified_rows(given, 20, seed=1).tolist() == stratified_rows(given, 20, seed=1).tolist()
    assert stratified_rows(given, 20, seed=1).tolist() != stratified_rows(given, 20, seed=2).tolist()


def test_only_readings_with_points_where_there_are_any():
    points = np.random.default_rng(0).normal(size=(30, 3))
    points[10:] = np.nan
    given = readings(30, points=points, seat=["S"] * 30)
    assert stratified_rows(given, 10, seed=0).tolist() == list(range(10))
    refuses("from 1 to the 10 readings with reference points, got 11", stratified_rows, given, 11, seed=0)


def test_readings_in_seats_come_several_to_a_seat():
    given = readings(60, points=None, seat=[f"S{i % 10}" for i in range(60)])
    counts = np.unique(given.seat[stratified_rows(given, 12, seed=0)], return_counts=True)[1]
    assert counts.tolist() == [6, 6]
    counts = np.unique(given.seat[stratified_rows(given, 60, seed=0)], return_counts=True)[1]
    assert len(counts) == 10
    # Seats of two readings: more of them.
    pairs = readings(20, points=None, seat=[f"S{i // 2}" for i in range(20)])
    assert len(stratified_rows(pairs, 9, seed=0)) == 9


def test_more_than_there_are_or_none():
    for n in (0, -1, 8):
        refuses(rf"from 1 to the 7 readings with reference points, got {n}", stratified_rows, readings(7), n, seed=0)
    refuses("0 readings with a seat", stratified_rows, readings(7, points=None), 2, seed=0)
