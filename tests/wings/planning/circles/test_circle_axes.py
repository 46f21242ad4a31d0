"""Circle point analysis: circles of hand, derivatives, planted arms within their stated uncertainty, refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from refusals import refuses
from truearm.arm import Arm, load_arm, read_arm, write_arm
from truearm.arm.chain import Chain
from truearm.arm.nearest_table import nearest_table
from truearm.wings.planning.arm_from_circles import constants_of
from truearm.wings.planning.circles import Axes, direction_std, joint_circles

circles = pytest.importorskip("benchmarks.circles", reason="benchmarks are not beside the tests")
planted, standardized, swept = circles.planted, circles.standardized, circles.swept


@pytest.mark.parametrize(
    ("name", "convention"), [("ur10", "dh"), ("panda", "mdh"), ("gao2017", "dh"), ("measuring7", "mdh"), ("wam", "dh")]
)
def test_constants_are_those_planted_within_their_uncertainty(name, convention):
    found = []
    for seed in range(2):
        chain, stand = planted(name, seed)
        measured = ta.arm_from_circles(swept(chain, stand, seed, wobble=2e-3), convention=convention)
        found.append(standardized(measured, chain))
        assert measured.estimated.residual_std_mm == pytest.approx(0.02, rel=0.3)
    assert 0.6 < np.sqrt(np.mean(np.square(found))) < 1.4
    assert np.mean(np.abs(found) < 2) > 0.85


@pytest.mark.parametrize("convention", ["dh", "mdh"])
def test_an_exact_arm_is_found_exactly_and_its_file_moves_alike(tmp_path, convention):
    chain, stand = planted("ur10", 1)
    measured = ta.arm_from_circles(swept(chain, stand, 1, noise_mm=0.0), convention=convention)
    measured.save(tmp_path / "my-arm.toml")
    read = read_arm(tmp_path / "my-arm.toml")
    assert read.table.beta.any()  # two pairs of nearly parallel axes
    angles = np.random.default_rng(1).uniform(-2, 2, (20, 6))
    base = measured.table.base
    in_instrument = read.chain.tip_in_base(angles) @ base[:3, :3].T + base[:3, 3]
    np.testing.assert_allclose(in_instrument, chain.tip_in_base(angles), atol=1e-6)
    write_arm(read, tmp_path / "again.toml", convention=convention)
    np.testing.assert_allclose(read_arm(tmp_path / "again.toml").chain.fixed, read.chain.fixed, atol=1e-12)


def test_a_rail_and_joints_that_stand_elsewhere_in_each_circle():
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[0, :3, :3] = Rotation.from_euler("x", -90, degrees=True).as_matrix()
    fixed[1, :3, :3] = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    fixed[2, :3, :3] = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    fixed[2, :3, 3] = [100, 0, 400]
    chain = Chain(fixed, [600.0, 30.0, 20.0], [True, False, False])
    rng = np.random.default_rng(3)
    parts = []
    for joint in (2, 0, 1, 1):
        stand = np.tile(rng.uniform(-1, 1, 3) * [300, 1, 1], (9, 1))
        stand[:, joint] += np.linspace(0, 300, 9) if joint == 0 else np.linspace(-0.5, 0.5, 9)
        parts.append(stand)
    angles = np.concatenate(parts)
    points = chain.tip_in_base(angles) + rng.normal(0, 0.01, (36, 3))
    session = ta.Session(angles, points, angle_columns=("q1_mm", "q2_deg", "q3_deg"))
    measured = ta.arm_from_circles(session)
    assert [circle.joint for circle in measured.circles] == [0, 1, 1, 2]
    np.testing.assert_array_equal(measured.arm.chain.is_prismatic, [True, False, False])
    elsewhere = rng.uniform(-1, 1, (10, 3)) * [500, 2, 2]
    there = measured.estimated.axes.targets(elsewhere)[0]
    np.testing.assert_allclose(there, chain.tip_in_base(elsewhere), atol=0.2)
    base = measured.table.base
    of_file = measured.arm.chain.tip_in_base(elsewhere) @ base[:3, :3].T + base[:3, 3]
    np.testing.assert_allclose(of_file, there, atol=1e-8)


def test_a_circle_by_hand():
    turns = np.radians([0, 30, 60, 90, 120, 150])
    points = np.stack([5 + 100 * np.cos(turns), -2 + 100 * np.sin(turns), np.full(6, 7.0)], axis=1)
    (up,) = joint_circles(ta.Session(turns[:, None], points), np.array([False])).circles
    np.testing.assert_allclose(up.direction, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(up.point, [5, -2, 7], atol=1e-9)
    assert up.radius_mm == pytest.approx(100)
    # The other sign of the encoder is the other direction of the axis.
    (down,) = joint_circles(ta.Session(-turns[:, None], points), np.array([False])).circles
    np.testing.assert_allclose(down.direction, [0, 0, -1], atol=1e-12)


def test_derivatives_are_difference_quotients(rng):
    slides = np.array([False, True, False])
    directions = Rotation.random(3, rng=rng).as_matrix()[:, 2]
    axes = Axes(
        rng.normal(0, 1, 3),
        directions,
        rng.normal(0, 300, (3, 3)),
        slides,
        rng.normal(0, 300, 3),
        np.array([True, True, True]),
    )
    angles = axes.pose + rng.normal(0, 1, (5, 3))
    _, by_step, by_gain = axes.targets(angles)
    for k, step in enumerate(1e-6 * np.eye(axes.n_parameters)):
        quotient = (axes.moved(step).targets(angles)[0] - axes.moved(-step).targets(angles)[0]) / 2e-6
        np.testing.assert_allclose(by_step[:, :, k], quotient, atol=1e-4)
    for k, gain in enumerate(1e-6 * np.eye(3)):
        further, less = (axes.pose + (1 + sign * gain) * (angles - axes.pose) for sign in (1, -1))
        quotient = (axes.targets(further)[0] - axes.targets(less)[0]) / 2e-6
        np.testing.assert_allclose(by_gain[:, :, 2 - k], quotient, atol=1e-4)


def test_the_measured_arm_is_as_good_a_drawing_as_the_true_one(rng):
    chain, stand = planted("gao2017", 2)
    measured = ta.arm_from_circles(swept(chain, stand, 2, arc_deg=60))
    angles = rng.uniform(-1.5, 1.5, (60, 6))
    points = chain.tip_in_base(angles) + rng.normal(0, 0.02, (60, 3))
    train, test = ta.Session(angles[:40], points[:40]), ta.Session(angles[40:], points[40:])
    models = [ta.KinematicModel(arm).fit_readings(train) for arm in (measured.arm, Arm("true", chain))]
    means = [np.linalg.norm(model.predict(test.angles) - test.points, axis=1).mean() for model in models]
    assert means[0] < 1.2 * means[1]


@pytest.fixture(scope="module")
def circles():
    chain, stand = planted("gao2017", 4)
    return chain, swept(chain, stand, 4, points=12, arc_deg=60)


def refused(session, match, **options):
    caught = refuses(match, ta.arm_from_circles, session, **options)
    assert caught.hint
    return caught


def marked(session, joint, tmp_path):
    """Measure an arm of which one joint fails: the text and the file say so, and the others are as they are."""
    measured = ta.arm_from_circles(session)
    (reason,) = measured.failed.values()
    assert list(measured.failed) == [joint]
    n, name = measured.arm.n_joints, f"J{joint + 1}"
    text = str(measured)
    assert text.startswith(f"{name} not measured: an arm of {n - 1} of {n} joints")
    assert f"{name} is not measured. " in text
    assert f"; {name}" in measured.arm.title
    assert measured.arm.title.endswith(" not measured")
    measured.save(tmp_path / "my-arm.toml")
    written = (tmp_path / "my-arm.toml").read_text(encoding="utf-8")
    assert f'# not measured: {reason}\nname = "{name}"' in written
    # In the poses that were measured the file moves as the arm does, whatever the axis of that joint.
    used = np.concatenate([circle.rows for circle in measured.circles if circle.joint != joint])
    base, tips = measured.table.base, read_arm(tmp_path / "my-arm.toml").chain.tip_in_base(session.angles[used])
    np.testing.assert_allclose(tips @ base[:3, :3].T + base[:3, 3], session.points[used], atol=0.15)  # mm; noise 0.02
    return reason


ALL = ("a", "d", "alpha", "theta")


@pytest.mark.parametrize("convention", ["dh", pytest.param("mdh", marks=pytest.mark.weekly)])
@pytest.mark.parametrize(
    ("joint", "unknown", "others"),
    [
        (0, {"dh": {1: ("a", "alpha"), 2: ("d", "theta")}, "mdh": {2: ALL}}, ["the base frame"]),
        (1, {"dh": {1: ("a", "alpha"), 2: ALL, 3: ("d", "theta")}, "mdh": {2: ALL, 3: ALL}}, ["the base frame"]),
        (3, {"dh": {3: ALL, 4: ALL, 5: ("d", "theta")}, "mdh": {3: ("d", "theta"), 4: ALL, 5: ALL}}, []),
        (4, {"dh": {4: ALL, 5: ALL}, "mdh": {4: ("d", "theta"), 5: ALL, 6: ("a", "alpha")}}, ["the tip"]),
        (5, {"dh": {5: ALL}, "mdh": {5: ("d", "theta"), 6: ("a", "alpha")}}, ["the tip"]),
    ],
)
def test_what_depends_on_a_joint_that_failed_is_not_measured_and_the_rest_is_as_planted(
    circles, convention, joint, unknown, others, tmp_path
):
    chain, session = circles
    measured = ta.arm_from_circles(session.rows(np.arange(72) // 12 != joint), convention=convention)
    found = measured.to_dict()
    for row in range(6):
        names = unknown[convention].get(row + 1, ())
        for column in ("a_mm", "d_mm", "alpha_deg", "theta_deg"):
            is_unknown = column.partition("_")[0] in names
            assert (found[column][row] is None) == is_unknown, (row + 1, column)
            assert (found[f"u_{column}"][row] is None) == is_unknown
    assert (found["tip_mm"] == found["u_tip_mm"] == [None] * 3) == ("the tip" in others)
    assert (found["base_in_instrument"] is None) == ("the base frame" in others)
    assert [row for row in range(6) if found["u_gains"][row] is None] == [joint]
    assert [row for row in range(6) if found["gains"][row] is None] == [joint]
    measured.save(tmp_path / "mine.toml")
    written, text = (tmp_path / "mine.toml").read_text(encoding="utf-8"), str(measured)
    for what in others:
        assert f"# {what}: not measured, as J{joint + 1} is not" in written
        assert f"; {what}" in text
        assert what.removeprefix("the ") in measured.arm.title
    for row, names in unknown[convention].items():
        assert f"{', '.join(names)} of J{row}" in text
        if row != joint + 1:
            assert f'# {", ".join(names)}: not measured, as J{joint + 1} is not\nname = "J{row}"' in written
    assert ("The base frame is that of joint 1" in text) == ("the base frame" not in others)
    assert not any(name.startswith(f"J{joint + 1} ") for name in measured.near_round_values())
    # Every constant that is stated is that of the planted arm, within what it states.
    true = nearest_table(chain, ta.arm_from_circles(session).estimated.axes.chain(), convention=convention)
    known = np.isfinite(measured.std) & (measured.std > 0)
    # The side of a common normal is a convention, which follows that of the joint before.
    off = np.abs(np.abs(constants_of(measured.table)) - np.abs(constants_of(true)))[known] / measured.std[known]
    assert off.max() < 5  # some 25 Gaussian errors


def test_the_heights_of_parallel_axes_depend_on_the_joint_before_them(tmp_path):
    """J2, J3 and J4 of a UR10 are nearly parallel: J1's axis gives the height at which their distances are taken."""
    chain, stand = planted("ur10", 1)
    found = ta.arm_from_circles(swept(chain, stand, 1, points=12, arc_deg=60).rows(np.r_[12:72])).to_dict()
    assert [row + 1 for row in range(6) if found["d_mm"][row] is None] == [4]
    assert [row + 1 for row in range(6) if found["a_mm"][row] is None] == [1, 2, 3]


def test_circles_between_which_a_joint_that_failed_moved_name_it_first(circles):
    chain, session = circles
    angles = session.angles.copy()
    angles[:, 3] += np.repeat([0.0, 0.8, -0.6, 0.0, 1.1, -0.9], 12)
    angles = angles[np.arange(72) // 12 != 3]
    fault = refused(ta.Session(angles, chain.tip_in_base(angles)), "^J4 is not measured and stood at several angles")
    assert "J4 has no circle" in str(fault)
    assert fault.hint.startswith("move J4 alone")
    # Where it stood still, the base that moved is said besides.
    rest = session.rows(np.arange(72) // 12 != 3)
    points = rest.points.copy()
    points[24:] += [30.0, -20.0, 10.0]
    refused(ta.Session(rest.angles, points), "^J4 has no circle.*; the circles scatter .* not of one arm")


def test_a_joint_without_circle_is_marked_and_the_others_are_written(circles, tmp_path):
    session = circles[1]
    assert "J4 has no circle" in marked(session.rows(np.r_[0:36, 48:72]), 3, tmp_path)


def test_the_first_joint_may_fail(circles, tmp_path):
    assert "J1 has no circle" in marked(circles[1].rows(np.r_[12:72]), 0, tmp_path)


def test_two_joints_that_move_together_are_named(circles, tmp_path):
    chain, session = circles
    angles = session.angles.copy()
    angles[24:36, 1] += np.radians(np.linspace(0, 40, 12))
    assert "together with J2" in marked(ta.Session(angles, chain.tip_in_base(angles)), 2, tmp_path)


def test_a_target_on_the_axis_of_the_last_joint_needs_an_offset(circles, tmp_path):
    chain, session = circles
    on_axis = Chain(chain.fixed, [0.0, 0.0, 50.0])
    flat = np.array(on_axis.fixed)
    flat[-1] = np.eye(4)
    on_axis = Chain(flat, [0.0, 0.0, 50.0])
    points = on_axis.tip_in_base(session.angles) + np.random.default_rng(1).normal(0, 0.02, session.points.shape)
    reason = marked(ta.Session(session.angles, points), 5, tmp_path)
    assert "from the axis of J6" in reason
    assert "off that axis" in reason


@pytest.mark.parametrize(("points", "span_deg"), [(12, 60.0), (8, 120.0)])
def test_the_radius_that_a_plan_asks_for_gives_the_direction_that_it_says(points, span_deg):
    planned = ta.plan_circles(1, points=points, span_deg=span_deg, noise_mm=0.5)
    radius, rng = planned.radius_needed(1.0), np.random.default_rng(5)
    circle = radius * np.stack([np.cos(planned.turns), np.sin(planned.turns), 0 * planned.turns], axis=1)
    tilts = []
    for _ in range(400):
        session = ta.Session(planned.turns[:, None], circle + rng.normal(0, 0.5, circle.shape))
        (found,) = joint_circles(session, np.array([False])).circles
        tilts.append(found.direction[:2])
    # Standard deviation across the least certain direction; 400 draws show it to 4 %.
    largest = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(tilts).T))[-1])
    assert np.degrees(largest) == pytest.approx(1.0, rel=0.12)
    assert direction_std(planned.turns, 0.5, radius) == pytest.approx(np.radians(1.0))


def test_a_plan_says_its_radii(tmp_path):
    planned = ta.plan_circles(5, noise_mm=1.0)
    assert planned.radius_needed(1.0) == pytest.approx(2 * planned.radius_needed(2.0))
    assert planned.radius_needed(1.0, span_deg=120) < 0.3 * planned.radius_needed(1.0)
    saved = planned.save(tmp_path / "circles.csv")
    assert f"--from-circles {tmp_path / 'circles.csv'} --out" in str(saved)
    assert "FILE" not in str(planned)
    assert planned.to_dict()["turns_deg"][0] == -30.0
    assert f"the target {planned.radius_needed(2.0):.0f} mm or more" in (tmp_path / "circles.csv").read_text("utf-8")
    refuses("uncertainty of a coordinate", ta.plan_circles, 5, noise_mm=0.0)


def test_an_arc_that_is_too_short_for_its_noise_and_a_session_without_points_are_refused(circles):
    refuses("points of circles", ta.arm_from_circles, ta.Session(circles[1].angles))
    chain, stand = circles[0], load_arm("gao2017").working
    refused(swept(chain, stand, 1, points=6, arc_deg=12, noise_mm=1.0), "is uncertain by")


def test_a_base_that_moved_between_circles_is_a_contradiction(circles):
    session = circles[1]
    points = session.points.copy()
    points[24:] += [30.0, -20.0, 10.0]
    refused(ta.Session(session.angles, points), "not of one arm")


@pytest.mark.parametrize(("gain", "is_refused"), [(1.005, False), (1.15, True)])
def test_a_gain_is_said_and_an_implausible_one_refused(gain, is_refused):
    chain, stood = planted("ur10", 4)
    session = swept(chain, stood, 4, points=12, arc_deg=60)
    angles = session.angles.copy()
    stand = angles[0, 2]
    angles[:, 2] = stand + (angles[:, 2] - stand) / gain
    turned = ta.Session(angles, session.points)
    if is_refused:
        refused(turned, "J3 moves by 1.1. times its angles")
        assert "a trial" in ta.arm_from_circles(turned, accept="a trial").arm.source
    else:
        (said,) = ta.arm_from_circles(turned).remarks
        assert said.startswith("J3 moves by 1.005 times")


def test_constants_near_round_values_are_named_and_kept():
    chain, stand = planted("gao2017", 1, angle_std=0.0, length_std_mm=0.0)
    measured = ta.arm_from_circles(swept(chain, stand, 5, points=12, arc_deg=60))
    named = measured.near_round_values()
    assert sum("alpha" in one for one in named) >= 3
    assert np.ptp(np.degrees(measured.table.alpha) % 90) > 0
    text = "\n".join(map(str, measured.blocks()))
    assert "not put in place of what was measured" in text


def test_readings_in_no_circle_are_ignored_and_counted(circles):
    chain, session = circles
    more = np.concatenate([session.angles, np.random.default_rng(2).uniform(-1, 1, (4, 6))])
    points = np.concatenate([session.points, chain.tip_in_base(more[-4:])])
    measured = ta.arm_from_circles(ta.Session(more, points))
    assert measured.remarks == ("4 readings in no circle, ignored.",)
