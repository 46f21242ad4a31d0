"""Features: what is made of points that are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.errors import InputError
from truearm.wings.laboratory.tasks import features
from truearm.wings.laboratory.tasks.feature_postures import feature_postures, middle_of

AT = np.array([700.0, 100.0, 300.0])
ALL = {
    "length": features.length_at(AT, [0, 1, 0], 200.0, points=4),
    "sphere": features.sphere(AT, 25.0),
    "plane": features.plane(AT, [0, 0, 1], 120.0, points=23),
    "circle": features.circle(AT, [0, 0, 1], 40.0, points=9),
    "cylinder": features.cylinder(AT, [0, 0, 1], 40.0, 30.0, points=12),
    "cone": features.cone(AT, [0, 0, 1], 40.0, np.radians(60.0), points=12),
    "distance": features.plane_distance(AT, [0, 1, 0], 100.0, 40.0, points=18),
    "angle": features.plane_angle(AT, [1, 0, 0], np.radians(90.0), 40.0, points=18),
}


@pytest.mark.parametrize("feature", ALL.values(), ids=ALL)
def test_a_perfect_measurement_has_no_error(feature):
    assert np.abs(feature.errors(feature.points)).max() < 1e-9  # mm, rounding of coordinates of a metre
    assert np.linalg.norm(feature.approach, axis=1) == pytest.approx(np.ones(len(feature.points)))


@pytest.mark.parametrize("name", ["length", "sphere", "circle", "cylinder", "distance"])
def test_an_arm_that_measures_too_large_does_so_with_sizes(name):
    feature = ALL[name]
    nominal = feature.quantities[0].nominal_mm
    assert feature.errors(feature.points * 1.001)[0] == pytest.approx(0.001 * nominal, rel=1e-9)


@settings(max_examples=20)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    shift=st.tuples(*[st.floats(-100, 100)] * 3),
    seed=st.integers(0, 1000),
    name=st.sampled_from(["length", "sphere", "circle", "distance"]),
)
def test_sizes_and_forms_do_not_depend_on_where_the_part_is(turn, shift, seed, name):
    feature = ALL[name]
    points = feature.points + 0.01 * np.random.default_rng(seed).standard_normal(feature.points.shape)
    moved = Rotation.from_rotvec(turn).apply(points - AT) + AT + shift
    assert feature.errors(moved) == pytest.approx(feature.errors(points), abs=1e-7)  # mm


def test_flatness_is_the_range_across_the_plate():
    feature = ALL["plane"]
    points = feature.points.copy()
    bowed = 0.02 * ((points[:, 0] - AT[0]) / 60) ** 2  # one arch: no plane takes part of it but its mean
    points[:, 2] += bowed
    assert feature.errors(points)[0] == pytest.approx(np.ptp(bowed), rel=0.05)


def test_the_direction_of_a_plate_is_its_tilt_over_its_size():
    feature = ALL["plane"]
    tilted = Rotation.from_rotvec([3e-4, -4e-4, 0]).apply(feature.points - AT) + AT
    flatness, direction = feature.errors(tilted)
    assert flatness == pytest.approx(0, abs=1e-9)
    assert direction == pytest.approx(5e-4 * 120, rel=1e-6)


def test_the_angle_of_two_faces_and_of_a_cone_is_a_deviation_over_their_size():
    """Faces opened by 0.2 mrad; a cone whose radii grow by a share of 0.1 % of the tangent."""
    feature = ALL["angle"]
    points = feature.points.copy()
    points[:9] = Rotation.from_rotvec([-2e-4, 0, 0]).apply(points[:9] - AT) + AT
    assert abs(feature.errors(points)[0]) == pytest.approx(2e-4 * 40.0, rel=1e-6)
    cone = ALL["cone"]
    wider = AT + (cone.points - AT) * [1.001, 1.001, 1.0]
    turned = 2 * (np.arctan(1.001 * np.tan(np.radians(30))) - np.radians(30))
    height = 10.0 / np.tan(np.radians(30))
    assert cone.errors(wider)[0] == pytest.approx(height * turned, rel=1e-6)


@pytest.mark.parametrize("name", ["cylinder", "distance"])
def test_a_turned_part_is_seen_in_its_direction_alone(name):
    feature = ALL[name]
    turned = feature.errors(Rotation.from_rotvec([3e-4, -4e-4, 0]).apply(feature.points - AT) + AT)
    size, form = turned[0], turned[1]
    assert size == pytest.approx(0, abs=1e-9)
    assert form == pytest.approx(0, abs=1e-9)
    if name == "cylinder":
        assert turned[2] == pytest.approx(5e-4 * 30.0, rel=1e-6)


def test_the_ends_of_a_length_are_means_of_their_points():
    feature = features.length([[0, 0, 0], [100, 0, 0]], points=4)
    points = feature.points.copy()
    points[3, 0] += 0.02
    assert feature.errors(points)[0] == pytest.approx(0.01)


def test_a_ball_is_touched_all_over_its_upper_half():
    normals = (ALL["sphere"].points - AT) / 12.5
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(25))
    assert (normals[:, 2] > 0).all()
    # Even over a hemisphere: the mean of the normals is half of a unit vector upwards.
    assert normals.mean(axis=0) == pytest.approx([0, 0, 0.5], abs=0.02)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: features.length([[0, 0, 0], [0, 0, 0]]), "distance of the two ends of 1 mm or more, got 0"),
        (lambda: features.length([[0.1, 0, 0.3], [0.6, 0, 0.3]]), "got 0.5. Try: state it in mm"),
        (lambda: features.length_at(AT, [0, 0, 1], 0.5), "length of 1 mm or more, got 0.5. Try: state it in mm"),
        (lambda: features.plane(AT, [0, 0, 1], 0.2), "size of 1 mm or more"),
        (lambda: features.length([[0, 0, 0], [1, 0, 0]], points=3), "even number"),
        (lambda: features.length([[0, 0], [1, 0]]), "two ends"),
        (lambda: features.length_at(AT, [0, 0, 0], 100), "direction"),
        (lambda: features.length_at([1, np.nan, 0], [0, 0, 1], 100), "place"),
        (lambda: features.sphere(AT, 0), "diameter of 1 mm or more"),
        (lambda: features.sphere(AT, np.inf), "diameter of 1 mm or more"),
        (lambda: features.sphere(AT, 25, points=4), "5 to 1000 points"),
        (lambda: features.plane(AT, [0, 0, 1], 100, points=3), "4 to 1000 points"),
        (lambda: features.cone(AT, [0, 0, 1], 20, 4.0), "angle of a cone of 1 to 179 deg"),
        (lambda: features.plane_angle(AT, [0, 0, 1], 0.0, 20), "angle of two planes of 1 to 179 deg"),
        (lambda: features.plane_distance(AT, [0, 0, 1], 20, 20, points=9), "even number of points for two planes"),
        (lambda: features.circle(AT, [0, 0, 1], -3), "diameter of 1 mm or more"),
    ],
)
def test_features_that_are_none_are_refused(make, said):
    refuses(said, make)


@pytest.mark.parametrize("name", ["gao2017", "measuring7"])
def test_the_arm_is_held_with_its_tip_on_the_points(name):
    arm = load_arm(name)
    middle, across = middle_of(arm)
    feature = features.length_at(middle, across, 300.0)
    ways = feature_postures(arm, feature, 10, seed=1)
    assert len(ways) == 10
    tips = arm.chain.tip_in_base(ways.reshape(-1, arm.n_joints)).reshape(10, 2, 3)
    assert np.abs(tips - feature.points).max() < 1e-5  # mm
    lower, upper = arm.limits.T
    assert ((ways > lower) & (ways < upper)).all()
    assert np.degrees(ways.std(axis=0)).max() > 10
    assert np.array_equal(ways, feature_postures(arm, feature, 10, seed=1))


def test_what_the_arm_does_not_reach_is_refused_with_where_it_would():
    arm = load_arm("measuring7")
    caught = refuses("does not reach", feature_postures, arm, features.sphere([5000, 0, 0], 25.0), 5, seed=0)
    assert "in front of the shoulder" in caught.hint
    with pytest.raises(InputError, match="does not reach .* Try: state its place in mm: 600,0,300, not 0.6,0,0.3"):
        feature_postures(arm, features.length_at([0.6, 0.0, 0.3], [0, 1, 0], 500.0), 5, seed=0)
    refuses("turning joints|five joints", feature_postures, load_short(), features.sphere(AT, 25.0), 5, seed=0)


def load_short():
    """An arm of three joints."""
    from truearm.arm.arm import Arm
    from truearm.arm.chain import Chain

    return Arm("short", Chain(load_arm("gao2017").chain.fixed[:4], np.array([0.0, 0.0, 50.0])))
