"""Features measured with a virtual arm: planted sizes are found within U; what does not fit is refused."""

import copy
import json
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import t as student_t

import truearm as ta
from refusals import refuses
from truearm.identification.terms import directions
from truearm.readings.session import Session
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_plane, fit_sphere
from truearm.wings.laboratory.tasks.feature_postures import feature_postures, middle_of
from truearm.wings.laboratory.tasks.features import UP, circle, cone, cylinder, length_at, plane, sphere
from truearm.wings.laboratory.tasks.measured_features import measure_features
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import VirtualArm, load_preset
from truearm.wings.planning.virtual.presets import ARCSEC


@pytest.fixture(scope="module")
def virtual():
    return VirtualArm.draw(ta.load_arm("gao2017"), load_preset("shop"), seed=1)


@pytest.fixture(scope="module")
def model(virtual):
    readings = virtual.measure(measuring_poses(virtual.nominal, 60, seed=1).angles, seed=1).readings
    return ta.KinematicModel(virtual.nominal).fit_readings(readings)


@pytest.fixture(scope="module")
def touch(virtual, model):
    """Readings with the tip of the virtual arm on the points of a feature."""

    def touched(feature, seat=None, seed=1):
        degC = model.training_.temperature_degC.mean
        angles = feature_postures(virtual.nominal, feature, 1, seed=seed)[0]
        taken = virtual.measure(
            angles, seed=50 + seed, seat_points=feature.points, temperature_degC=degC, reference=False
        )
        return replace(taken.readings, directions=None, seat=None if seat is None else np.array(seat))

    return touched


@pytest.fixture(scope="module")
def ball(touch, virtual):
    return touch(sphere(middle_of(virtual.nominal)[0], 25.0))


@pytest.mark.parametrize("kind", ["length", "sphere", "plane", "circle"])
def test_planted_features_are_found_within_their_uncertainty(model, touch, virtual, kind):
    middle, across = middle_of(virtual.nominal)
    if kind == "length":
        feature = length_at(middle, across, 300.0, points=8)
        session = touch(feature, ["A"] * 4 + ["B"] * 4)
        true = [300.0]
    else:
        feature = (
            sphere(middle, 40.0) if kind == "sphere" else {"circle": circle, "plane": plane}[kind](middle, UP, 40.0)
        )
        session = touch(feature)
        of_normal = {"sphere": [], "circle": [0, 0, 1], "plane": [0, 0, 1]}[kind]
        true = [*([] if kind == "plane" else [40.0]), *middle, *of_normal]
    found = ta.measure(model, session, kind, n_arms=100).features[0]
    assert (found.kind, found.n_points) == (kind, len(feature.points))
    for quantity, value in zip(found.quantities, true, strict=True):
        assert 0 < quantity.u <= quantity.expanded
        # The middle of a plate is the mean of its points, which the seats place with a scatter of their own.
        assert abs(quantity.value - value) <= 1.5 * quantity.expanded, quantity.name


def test_values_are_those_of_the_compensated_points_and_the_tip_is_compensated(model, ball, touch, virtual):
    found, enlarged = (ta.measure(model, ball, n_arms=100, tip_diameter_mm=d).features[0] for d in (0.0, 5.0))
    shape = fit_sphere(model.predict_readings(ball))
    # The same calls on the same numbers, whose last bit may hang on where they lie in memory.
    assert found.quantities[0].value == pytest.approx(2 * shape.radius_mm, abs=1e-9)
    assert found.form_mm == pytest.approx(shape.form_mm, abs=1e-9)
    assert enlarged.quantities[0].value == pytest.approx(found.quantities[0].value - 5.0, abs=1e-9)
    bore = touch(circle(middle_of(virtual.nominal)[0], UP, 50.0))
    plain, narrowed = (ta.measure(model, bore, "circle", n_arms=100, tip_diameter_mm=d).features[0] for d in (0.0, 5.0))
    assert narrowed.quantities[0].value == pytest.approx(plain.quantities[0].value + 5.0, abs=1e-9)


@dataclass(frozen=True)
class Errors:
    """Errors of arms that are known in advance: a motion of all points, of standard deviation one."""

    R_base_reference = np.eye(3)
    motion: np.ndarray
    repeatability_mm: float = 0.0
    approach: np.ndarray | None = None

    def draw(self, seed):
        return SimpleNamespace(
            systematic=lambda angles: np.random.default_rng(seed).standard_normal() * self.motion,
            random=lambda angles, rng: np.zeros((len(angles), 3)),
        )


@pytest.mark.parametrize("kind", ["sphere", pytest.param("circle", marks=pytest.mark.weekly), "length"])
def test_what_all_points_share_moves_the_place_and_a_scale_the_size(kind):
    feature = {"sphere": sphere([500.0, 0, 0], 50.0), "circle": circle([500.0, 0, 0], UP, 50.0)}.get(kind)
    points = np.array([[500.0, 0, 0], [550.0, 0, 0]]) if feature is None else feature.points
    half = len(points) // 2
    groups = (
        {"A": np.arange(half), "B": np.arange(half, len(points))} if feature is None else {"": np.arange(len(points))}
    )
    angles = np.zeros((len(points), 6))
    shifted, scaled = (
        measure_features(Errors(motion), kind, points, angles, groups, np.zeros((0, len(points), 3)), n_arms=400)[
            0
        ].quantities
        for motion in (np.tile([0.1, 0, 0], (len(points), 1)), 1e-4 * points)
    )
    # Rounding of 500 mm through a fit; 11 % is three standard deviations of a standard deviation of 400 draws.
    assert shifted[0].u < 1e-9
    assert scaled[0].u == pytest.approx(1e-4 * 50.0, rel=0.11)
    assert scaled[0].expanded == pytest.approx(1.96 * 1e-4 * 50.0, rel=0.13)
    for centre in shifted[1:2]:
        assert centre.u == pytest.approx(0.1, rel=0.11)


@pytest.mark.parametrize(
    ("kind", "n", "freedom"),
    [
        ("circle", 5, 4),
        *(pytest.param(one, 9, two, marks=pytest.mark.weekly) for one, two in (("sphere", 5), ("plane", 6))),
    ],
)
def test_few_points_show_their_scatter_by_students_distribution(kind, n, freedom, rng):
    feature = {"circle": circle, "plane": plane}[kind]([0, 0, 0], UP, 50.0, points=n) if kind != "sphere" else None
    feature = sphere([0, 0, 0], 50.0, points=n) if feature is None else feature
    points = feature.points + rng.normal(0, 0.01, (n, 3))
    none = np.zeros((0, n, 3))
    found = measure_features(
        Errors(np.zeros((n, 3))), kind, points, np.zeros((n, 6)), {"": np.arange(n)}, none, n_arms=1000
    )[0]
    which = 2 if kind == "plane" else 0  # of a plate the height
    quantity = found.quantities[which]
    # U is that of 1000 draws with heavy tails: 6 to 7 % of it; a normal distribution gives 20 to 29 % less.
    assert quantity.expanded / quantity.u == pytest.approx(float(student_t.ppf(0.975, freedom)), rel=0.15)


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("plane", {"distance_mm": 30.0, "angle_deg": 0.0}),
        ("cylinder", {"distance_mm": 30.0, "angle_deg": 0.0}),
        pytest.param("cone", {"length_mm": 30.0, "angle_deg": 0.0}, marks=pytest.mark.weekly),
    ],
)
def test_two_shapes_give_their_distance_and_angle(kind, names):
    """An arm without errors and perfect points: two shapes side by side or one above the other."""
    one = {
        "plane": plane([0, 0, 0], UP, 50.0),
        "cylinder": cylinder([0, 0, 0], UP, 20.0, 30.0),
        "cone": cone([0, 0, 0], UP, 20.0, np.pi / 2),
    }[kind].points
    points, n = np.concatenate([one, one + ([0, 0, 30] if kind == "plane" else [30, 0, 0])]), len(one)
    groups = {"A": np.arange(n), "B": np.arange(n, 2 * n)}
    perfect = Errors(np.zeros((2 * n, 3)))
    found = measure_features(perfect, kind, points, np.zeros((2 * n, 6)), groups, np.zeros((0, 2 * n, 3)), n_arms=100)
    assert [one.name for one in found] == ["A", "B", "A to B"]
    assert {one.name: one.value for one in found[2].quantities} == pytest.approx(names, abs=1e-8)
    if kind != "plane":
        assert found[0].quantities[0].value == pytest.approx(90.0 if kind == "cone" else 20.0)


def test_scatter_that_the_arm_explains_is_not_counted_twice(rng):
    """Points scatter by what the drawn arms scatter them: U is theirs alone; more scatter is added to it."""
    n = 200
    points = sphere([0, 0, 0], 50.0, points=n).points + rng.normal(0, 0.01, (n, 3))
    groups, none = {"": np.arange(n)}, np.zeros((0, n, 3))

    class Scattering(Errors):
        def draw(self, seed):
            own = np.random.default_rng(seed).normal(0, 0.01, (n, 3))
            return Errors(own).draw(seed)

    u = [
        measure_features(errors, "sphere", points, np.zeros((n, 6)), groups, none, n_arms=150)[0].quantities[0].u
        for errors in (Scattering(np.zeros((n, 3))), Errors(np.zeros((n, 3))))
    ]
    assert u[0] == pytest.approx(u[1], rel=0.25)  # each is that of one scatter of 0.01 mm; twice would be 1.41


@pytest.mark.parametrize("side", [1, pytest.param(-1, marks=pytest.mark.weekly)])
def test_u_of_a_bore_contains_hysteresis_that_the_order_of_the_training_shows(virtual, side):
    """Joints lag by 4 arcsec, at 0.8 m 0.016 mm, which no number of points averages."""
    arm = virtual.nominal
    lag = 4 * ARCSEC * np.array([1.0, 1, -1, 1, -1, 1])
    rng, learned = np.random.default_rng(2), measuring_poses(arm, 60, seed=2).angles
    points = arm.chain.tip_in_base(learned) + 0.005 * rng.standard_normal((60, 3))
    lagging = ta.KinematicModel(arm).fit_readings(Session(learned - lag * directions(learned), points=points))
    middle, _ = middle_of(arm)
    touched = feature_postures(arm, circle(middle, UP, 40.0), 1, seed=1)[0]
    own_axes = arm.chain.tip_derivatives(touched).motion_jacobian[:, 1:-1, 2].transpose(0, 2, 1)
    from_middle = np.linalg.pinv(own_axes) @ (arm.chain.tip_in_base(touched) - middle)[:, :, None]
    angles = touched - side * lag * np.sign(from_middle[:, :, 0])
    diameter = ta.measure(lagging, Session(angles), "circle", n_arms=100).features[0].quantities[0]
    without = copy.copy(lagging)
    without.hysteresis_ = np.zeros((2, 0))
    narrow = ta.measure(without, Session(angles), "circle", n_arms=100).features[0].quantities[0]
    assert narrow.expanded < abs(diameter.value - 40.0) <= diameter.expanded


def test_single_points_scatter_as_the_model_or_the_repeatability_says(model, touch, virtual):
    middle, across = middle_of(virtual.nominal)
    ends = touch(length_at(middle, across, 300.0, points=2), ["A", "B"])
    near = replace(ends, angles=ends.angles[[0, 0]])
    u = {}
    for name, repeatability in (("unseen", None), ("stated", 0.001)):
        u[name] = (
            ta.measure(model, near, "length", n_arms=400, repeatability_mm=repeatability).features[0].quantities[0].u
        )
    # Two points in one pose share all but their scatter; a length of zero is never below zero.
    assert u["stated"] < 0.003
    assert u["unseen"] > 0.4 * model.residual_std_


def test_the_conditions_of_the_readings_count(model, touch, virtual):
    middle, across = middle_of(virtual.nominal)
    here = touch(length_at(middle, across, 300.0, points=2), ["A", "B"])
    warm = replace(here, temperature_degC=here.temperature_degC + 15.0)
    u = [ta.measure(model, one, "length", n_arms=300).features[0].quantities[0].u for one in (here, warm)]
    assert u[1] > 1.5 * u[0]


def test_two_set_ups_have_no_frame_in_common(model, ball):
    half = len(ball) // 2
    both = replace(ball, session=np.array(["mon"] * half + ["tue"] * (len(ball) - half)))
    refuses("expected the readings of one session, got those of 2: mon, tue", ta.measure, model, both)
    alone = ta.measure(model, replace(ball, session=np.array(["mon"] * len(ball))), n_arms=100)
    plain = ta.measure(model, ball, n_arms=100)
    values = [[quantity.value for quantity in one.features[0].quantities] for one in (alone, plain)]
    np.testing.assert_allclose(*values, rtol=0, atol=1e-9)  # mm; the last bit may hang on where numbers lie in memory


def test_a_stylus_tip_larger_than_the_ball_is_refused(model, ball):
    refuses("the stylus tip of 5000 mm is larger than the sphere", ta.measure, model, ball, tip_diameter_mm=5000.0)


@pytest.mark.parametrize("kind", ["plane", "cone"])
def test_a_stylus_tip_that_would_change_nothing_is_refused(model, ball, kind):
    refuses("distances of two faces of a block are larger by it", ta.measure, model, ball, kind, tip_diameter_mm=6.0)


def test_two_balls_give_the_distance_of_their_centres(model, touch, virtual):
    middle, across = middle_of(virtual.nominal)
    parts = [
        touch(sphere(middle + away * across, 25.0, points=9), [name] * 9) for away, name in ((-150, "A"), (150, "B"))
    ]
    both = ta.Session(
        np.concatenate([part.angles for part in parts]), seat=np.concatenate([part.seat for part in parts])
    )
    *balls, length = ta.measure(model, both, n_arms=200).features
    assert [one.name for one in balls] == ["A", "B"]
    assert (length.kind, length.name, length.n_points) == ("length", "A to B", 18)
    assert abs(length.quantities[0].value - 300.0) <= length.quantities[0].expanded


def test_a_normal_between_two_axes_keeps_its_side(model, touch, virtual):
    """Its largest component decides the sign, and errors change which component that is."""
    session = touch(plane(middle_of(virtual.nominal)[0], [1.0, -1.0, 0.0], 100.0, points=9))
    normal = fit_plane(model.predict_readings(session)).normal
    assert abs(abs(normal[0]) - abs(normal[1])) < 0.01
    for quantity in ta.measure(model, session, "plane", n_arms=200).features[0].quantities[3:]:
        assert quantity.u < 0.01


def test_more_readings_without_a_name_are_said(model, touch, virtual):
    middle, across = middle_of(virtual.nominal)
    session = touch(length_at(middle, across, 300.0, points=4), ["A", "", "B", "B"])
    result = ta.measure(model, session, "length", n_arms=100)
    assert result.features[0].n_points == 3
    assert any("1 reading without a name" in remark for remark in result.remarks)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"feature": "torus"}, "feature out of length, sphere, plane, circle, cylinder, cone, got 'torus'"),
        ({"feature": "length"}, "expected the readings of two ends of a length, got those of one"),
        ({"tip_diameter_mm": -1.0}, "expected the diameter of the stylus tip, 0 mm or more"),
        ({"n_arms": 10}, "expected 100 to 100000 arms"),
        ({"seed": -1}, "seed must be"),
        ({"repeatability_mm": 9.0}, "contradicts the model"),
    ],
)
def test_what_does_not_fit_is_refused(model, ball, options, message):
    refuses(message, ta.measure, model, ball, **({"n_arms": 100} | options))


def test_too_few_readings_of_a_feature_are_refused_by_name(model, ball):
    four = replace(ball.rows(np.arange(4)), seat=np.array(["ball"] * 4))
    refuses("expected 5 readings or more of the sphere 'ball', got 4", ta.measure, model, four)


def test_a_network_does_not_know_how_errors_of_points_correlate(ball):
    train = ta.simulate("gao2017", poses=40, seed=1).session
    network = ta.NetworkModel(ta.load_arm("gao2017"), hidden=(3,), epochs=3, free=()).fit_readings(train)
    refuses("has no terms with a posterior", ta.measure, network, ball)


def to_nine_digits(text):
    """JSON without the last bits, which may hang on where numbers lie in memory."""
    return json.loads(text, parse_float=lambda number: f"{float(number):.9g}")


def test_both_doors_say_the_same(truearm, model, ball, tmp_path):
    model.save(tmp_path / "arm.truearm")
    ball.save(tmp_path / "ball.csv")
    record = ta.measure(tmp_path / "arm.truearm", tmp_path / "ball.csv", n_arms=100, seed=3)
    arguments = ["measure", tmp_path / "arm.truearm", tmp_path / "ball.csv", "--arms", 100, "--seed", 3]
    assert truearm(*arguments).done().out.strip() == str(record)
    told = truearm(*arguments, "--json").done().out
    assert to_nine_digits(told) == to_nine_digits(json.dumps(record.to_dict()))
    assert "Sphere: diameter 25.0" in str(record).splitlines()[0]
    refuses(r"ball\.csv: expected the readings of two ends", ta.measure, model, tmp_path / "ball.csv", "length")
