"""Laws of table and boxes: an artefact stands on the table, and no link is in a box."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from refusals import refuses
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.wings.planning.designs.candidates import bar_places, seat_poses, tracker_poses
from truearm.wings.planning.designs.prior import nominal_prior
from truearm.wings.planning.designs.proposal import Artefact, propose
from truearm.wings.planning.designs.workspace import Box, Surroundings, joint_origins, surroundings_of

POST = Box((300.0, -80.0, 0.0), (420.0, 80.0, 500.0))


@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6))
@example([2.3e-309, 0.0, 0.0, 0.0, 0.0, 0.0])
def test_a_segment_cuts_a_box_where_one_of_its_points_is_inside(numbers):
    box = Box((-0.5, -0.4, -0.3), (0.5, 0.4, 0.3))
    start, end = np.array(numbers[:3]), np.array(numbers[3:])
    share = np.linspace(0, 1, 2001)[:, None]
    points = start + share * (end - start)
    inside = ((points >= box.low) & (points <= box.high)).all(axis=1).any()
    # Sampled points may miss a corner that is cut; none is inside where the segment does not cut.
    if inside:
        assert box.cuts(start, end)
    bigger = Box((-0.51, -0.41, -0.31), (0.51, 0.41, 0.31))
    near = ((points >= bigger.low) & (points <= bigger.high)).all(axis=1).any()
    if not near:
        assert not box.cuts(start, end)


@pytest.mark.parametrize("artefact", ["seat", "bar"])
def test_artefacts_stand_on_the_table_and_the_arm_stays_out_of_the_box(artefact):
    arm = load_arm("measuring7")
    around = Surroundings(50.0, (250.0, 950.0), (-450.0, 450.0), avoid=(POST,))
    if artefact == "seat":
        poses = seat_poses(arm, seats=3, poses=4, seed=0, surroundings=around)
    else:
        poses = bar_places(arm, 2, length_mm=400, poses=3, seed=0, surroundings=around)
    x, y, z = poses.seat_points.T
    assert z.min() >= 50.0
    assert x.min() >= 250.0
    assert x.max() <= 950.0
    assert np.abs(y).max() <= 450.0
    line = np.concatenate(
        [joint_origins(arm.chain, poses.angles)[:, 1:], arm.chain.tip_in_base(poses.angles)[:, None]], axis=1
    )
    points = line[:, :-1, None] + np.linspace(0, 1, 200)[:, None] * np.diff(line, axis=1)[:, :, None]
    assert not ((points >= POST.low) & (points <= POST.high)).all(axis=-1).any()


def test_nothing_beyond_the_shoulder_is_below_a_table_without_extent():
    arm = load_arm("gao2017")
    around = Surroundings(300.0)
    found = tracker_poses(arm, 40, seed=0)
    free = around.leaves_free(arm.chain, found.angles)
    beyond = np.concatenate(
        [joint_origins(arm.chain, found.angles)[:, 2:], arm.chain.tip_in_base(found.angles)[:, None]], axis=1
    )
    above = beyond[..., 2].min(axis=1) >= 299.0
    assert 0 < above.sum() < 40
    assert free.tolist() == above.tolist()
    # A table above the shoulder: the column comes up through it.
    high = Surroundings(500.0).leaves_free(arm.chain, found.angles)
    assert high.tolist() == (beyond[..., 2].min(axis=1) >= 499.0).tolist()


def test_a_plan_with_a_tracker_keeps_its_points_above_the_table():
    arm = load_arm("gen3lite")
    known = nominal_prior(arm, terms="constants", noise_mm=0.02)
    plan = propose(arm, known, Artefact("tracker"), 6, surroundings=Surroundings(250.0))
    for proposal in plan.proposals.values():
        assert arm.chain.tip_in_base(proposal.poses.angles)[:, 2].min() >= 249.0


def test_by_default_no_artefact_is_below_the_base():
    poses = seat_poses(load_arm("ur10"), seats=3, poses=3, seed=0)
    assert poses.seat_points[:, 2].min() >= 0.0


def test_a_table_out_of_reach_is_refused():
    with pytest.raises(InputError, match="hardly a place for a seat"):
        seat_poses(load_arm("gao2017"), seats=2, poses=2, seed=0, surroundings=Surroundings(5000.0))
    with pytest.raises(InputError, match="hardly fits"):
        bar_places(load_arm("gao2017"), 1, length_mm=300, poses=2, seed=0, surroundings=Surroundings(5000.0))


@pytest.mark.parametrize(
    ("table", "avoid", "message"),
    [
        ([0.0, 1.0], [], "a table needs its height"),
        ([0.0, 900.0, 200.0, -1.0, 1.0], [], "the smaller coordinates first"),
        ([float("nan")], [], "height of the table"),
        (None, [[0.0, 1.0]], "a box needs six numbers"),
        (None, [[0, 200, 300, -300, 0, 900]], "the smaller coordinates first"),
    ],
)
def test_ranges_the_wrong_way_round_are_refused(table, avoid, message):
    refuses(message, surroundings_of, table, avoid)
    refuses("an extent in x and y", Surroundings, 0.0, (0.0, 1.0))
