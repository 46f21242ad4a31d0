"""Laws of the observability indices: published definitions on hand-solved cases, scaling, rank with its gap."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from truearm.arm.chain import Chain
from truearm.wings.planning.designs.observability import observability, rank_and_gap


def test_the_indices_of_a_case_solved_by_hand():
    found = observability(np.diag([8.0, 1.0, 2.0, 4.0]), n_poses=4)
    assert found.o1 == pytest.approx(2 ** ((3 + 0 + 1 + 2) / 4) / 2)  # fourth root of 64, over sqrt(4)
    assert found.o2 == 1 / 8
    assert found.o3 == 1.0
    assert found.o4 == 1 / 8
    assert found.o5 == pytest.approx(1 / (1 / 8 + 1 / 4 + 1 / 2 + 1))
    assert (found.rank, found.n_parameters, found.gap) == (4, 4, 1.0)  # of columns of unit length


def test_two_links_in_a_plane():
    """Lengths of a two-link arm with unit links: the tip's columns are (cos q1, sin q1) and (cos q12, sin q12).

    Their Gram matrix is [[1, cos q2], [cos q2, 1]] for one pose: eigenvalues 1 +- cos q2, best with the elbow at a
    right angle, as Borm and Menq find for planar arms.
    """

    def at(q1, q2):
        J = np.array([[np.cos(q1), np.cos(q1 + q2)], [np.sin(q1), np.sin(q1 + q2)]])
        return observability(J, n_poses=1)

    for q2 in (0.4, 1.0, np.pi / 2):
        found = at(0.3, q2)
        assert found.singular_values**2 == pytest.approx([1 + np.cos(q2), 1 - np.cos(q2)])
        assert found.o1 == pytest.approx(np.sqrt(np.sin(q2)))
    assert at(0.3, 0.0).rank == 1


@given(arrays(float, (7, 3), elements=st.floats(-10, 10)), st.floats(0.1, 100))
@settings(max_examples=50)
def test_a_sharper_instrument_scales_all_indices_but_the_inverse_condition_number(J, factor):
    J = J + 20 * np.eye(7, 3)  # far from singular
    one, other = observability(J, n_poses=7), observability(factor * J, n_poses=7)
    assert one.rank == other.rank == 3
    assert other.o2 == pytest.approx(one.o2)
    for index in ("o1", "o3", "o4", "o5"):
        assert getattr(other, index) == pytest.approx(factor * getattr(one, index))


def test_measuring_everything_again_gains_what_the_papers_say():
    """Every pose taken four times doubles the singular values; O1 is per pose and stays."""
    J = np.random.default_rng(0).standard_normal((12, 5))
    once, four = observability(J, n_poses=4), observability(np.tile(J, (4, 1)), n_poses=16)
    assert four.o1 == pytest.approx(once.o1)
    assert four.o2 == pytest.approx(once.o2)
    for index in ("o3", "o4", "o5"):
        assert getattr(four, index) == pytest.approx(2 * getattr(once, index))


def test_indices_are_over_what_can_be_identified():
    J = np.diag([4.0, 2.0, 1.0])[:, [0, 1, 2, 2]]  # the last two parameters only together
    found = observability(J, n_poses=1)
    assert found.rank == 3
    assert found.gap > 1e12
    assert found.o3 == pytest.approx(np.sqrt(2))
    assert found.o2 == pytest.approx(np.sqrt(2) / 4)


def test_fewer_rows_than_parameters():
    found = observability(np.array([[3.0, 4.0]]), n_poses=1)
    assert found.singular_values == pytest.approx([5.0, 0.0])
    assert (found.rank, found.o3) == (1, pytest.approx(5.0))


def test_nothing_seen():
    found = observability(np.zeros((3, 2)), n_poses=1)
    assert (found.rank, found.gap, found.o1, found.o2, found.o3, found.o4, found.o5) == (0, np.inf, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("values", "rank", "gap"),
    [
        ([1.0, 1e-3, 1e-15], 2, 1e11),
        ([1.0, 1e-3, 0.0, 0.0], 2, 1e11),
        ([5.0], 1, 1.0),
        (10.0 ** -np.arange(17), 14, 10.0),  # no gap: fourteen decades above rounding
        ([1.0, 1e-3], 2, 1e3),
    ],
)
def test_rank_rests_on_the_largest_gap(values, rank, gap):
    found = rank_and_gap(np.array(values))
    assert found[0] == rank
    assert found[1] == pytest.approx(gap)


def test_the_rank_does_not_depend_on_units_of_parameters():
    rng = np.random.default_rng(1)
    J = rng.standard_normal((40, 6))
    J[:, 5] = J[:, 0] - J[:, 1]
    for units in (np.ones(6), 10.0 ** np.array([0, 6, -3, 4, -6, 0])):
        found = observability(J * units, n_poses=40)
        assert found.rank == 5
        assert found.gap > 1e8


@pytest.mark.parametrize("n", [2, 4, 6])
def test_points_tell_4n_plus_3_combinations_of_a_generic_arm(n):
    """With the base free: the 4 n - 3 that points tell of the arm itself, and the base's six."""
    rng = np.random.default_rng(n)
    fixed = np.tile(np.eye(4), (n + 1, 1, 1))
    fixed[:, :3, :3] = Rotation.random(n + 1, rng=rng).as_matrix()
    fixed[:, :3, 3] = rng.uniform(-300, 300, (n + 1, 3))
    J = (
        Chain(fixed, [40, 30, 200]).tip_derivatives(rng.uniform(-np.pi, np.pi, (40, n))).motion_jacobian
    )  # (m, places, 6, 3)
    found = observability(J.transpose(0, 3, 1, 2).reshape(120, -1), n_poses=40)
    assert found.rank == 4 * n + 3
    assert found.gap > 1e6
