"""Laws of the order of poses: every pose once, no improvement left, near the shortest, and never far from it."""

from itertools import permutations

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.wings.planning.designs.tour import joint_moves, mean_joint_move, order_of_few_moves, shortest_path


def distances(n, seed):
    points = np.random.default_rng(seed).uniform(size=(n, 6))
    return np.abs(points[:, None] - points).max(axis=-1)


def length(path, between):
    return between[path[:-1], path[1:]].sum()


@pytest.mark.parametrize("n", [1, 2, 3, 12, 40])
def test_every_point_is_visited_once(n):
    assert sorted(shortest_path(distances(n, 1)).tolist()) == list(range(n))


@pytest.mark.parametrize("seed", range(4))
def test_few_points_have_the_shortest_path(seed):
    between = distances(6, seed)
    shortest = min(length(np.array(path), between) for path in permutations(range(6)))
    # Local search may end above it; on such small problems it hardly ever does.
    assert length(shortest_path(between), between) <= 1.02 * shortest


def test_no_reversal_of_a_piece_shortens_the_path():
    between = distances(15, 3)
    path = shortest_path(between)
    for i in range(14):
        for j in range(i + 1, 15):
            turned = np.concatenate([path[:i], path[i : j + 1][::-1], path[j + 1 :]])
            assert length(turned, between) >= length(path, between) - 1e-9


def test_the_path_begins_near_where_it_comes_from():
    along = np.arange(5.0)
    between = np.abs(along[:, None] - along)
    assert shortest_path(between, first=4 - along).tolist() == [4, 3, 2, 1, 0]


def test_a_joint_without_limits_goes_the_shorter_way_round():
    arm = load_arm("measuring7")  # J1 turns without end, J2 from -120 to 120 deg
    start, end = np.zeros((2, 7))
    start[0], end[0] = np.radians([175.0, -175.0])
    assert np.degrees(joint_moves(arm, start, end)) == pytest.approx(10.0)
    start[1], end[1] = np.radians([100.0, -100.0])
    assert np.degrees(joint_moves(arm, start, end)) == pytest.approx(200.0)


def test_the_poses_of_a_seat_stay_together_and_the_seats_in_their_order():
    arm = load_arm("gao2017")
    rng = np.random.default_rng(0)
    angles, seat = rng.uniform(-1, 1, (20, 6)), np.repeat(["S2", "S1"], 10)
    order = order_of_few_moves(arm, angles, seat)
    assert seat[order].tolist() == seat.tolist()
    assert mean_joint_move(arm, angles[order]) < mean_joint_move(arm, angles)
    assert mean_joint_move(arm, angles[:1]) == 0.0
