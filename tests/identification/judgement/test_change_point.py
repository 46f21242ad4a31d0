"""What changes during a session is found, with its kind, row and size; where nothing changes nothing is said."""

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.judgement import change_point
from truearm.identification.judgement.change_point import (
    CLEAR_ODDS,
    NEIGHBOURS,
    SIGNIFICANCE,
    _best,
    _Course,
    _explained,
    _limit_probability,
    _log_likelihoods,
    _long_run_ratio,
    _margin,
    _p_value,
    _Readings,
    _steps,
    _whitened,
    rigid_motions,
    session_changes,
)

STD = 0.01  # mm


def session(n: int, seed: int, *, regions: bool = False):
    """Angles, points and pure noise of a session; with `regions` the poses are measured region by region."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-1, 1, (n, 6))
    if regions:
        angles = angles[np.argsort(angles[:, 0])]
    points = 500 * np.stack([np.cos(angles[:, 0]), np.sin(angles[:, 1]), angles[:, 2]], axis=1)
    return angles, points, STD * rng.standard_normal((n, 3))


def examined(angles, points, residuals):
    """The one change of the frame, of residuals about the mean, as a free base leaves them; None if there is none."""
    n = len(points)
    motions, weights = {"frame": rigid_motions(points)}, np.full((n, 3), STD**-2)
    found = session_changes(angles, motions, residuals - residuals.mean(axis=0), weights, np.arange(n))
    assert len(found) <= 1
    return found[0] if found else None


@pytest.mark.parametrize("n", [40, 150])
def test_good_sessions_are_left_alone(n):
    alarms = sum(examined(*session(n, seed)) is not None for seed in range(150))
    # 150 sessions at 0.2 % each: three alarms or more have a probability of 0.4 %.
    assert SIGNIFICANCE == 0.002
    assert alarms <= 2


@pytest.mark.parametrize(("freedom", "statistic", "probability"), [(1, 8.85, 0.05), (1, 12.35, 0.01)])
def test_the_limit_has_the_published_critical_values(freedom, statistic, probability):
    """Andrews (1993), table 1, a trimming of 0.15; his own are simulated, to 2 digits of a probability."""
    assert _limit_probability(statistic, freedom, 0.15) == pytest.approx(probability, rel=0.1)


@pytest.mark.parametrize("step", [0.0, 0.3])
def test_the_limit_decides_as_random_orders_do(monkeypatch, step):
    """Of scores with a step of so many standard deviations; 0.3 is five of the mean of each part."""
    scores = np.random.default_rng(3).standard_normal((1200, 4))
    scores[500:, 0] += step
    white = [_whitened(scores - scores.mean(axis=0)), _whitened(scores[:, :1] - scores[:, :1].mean(axis=0))]
    by_limit = _p_value(white)
    monkeypatch.setattr(change_point, "LIMIT_READINGS", 10_000)
    monkeypatch.setattr(change_point, "NO_DOUBT", 0.0)
    by_orders = _p_value(white)
    assert (by_limit is None) == (by_orders is None) == (step == 0.0)


def test_heavy_tails_and_gross_errors_are_no_change():
    alarms = 0
    for seed in range(40):
        angles, points, _ = session(60, seed)
        residuals = STD * np.random.default_rng(seed).standard_t(2, (60, 3))
        alarms += examined(angles, points, residuals) is not None
    assert alarms <= 1


@pytest.mark.parametrize(("n", "row"), [(60, 20), (60, 33), (300, 290 - 150)])
def test_a_step_is_found_with_its_row_and_size(n, row):
    angles, points, residuals = session(n, 1)
    moved = np.array([0.03, -0.02, 0.01])
    residuals[row:] -= moved  # predicted less measured
    found = examined(angles, points, residuals)
    assert found.kind == "step"
    assert found.first_row <= row <= found.last_row
    assert abs(found.row - row) <= 1
    # 20 readings on the smaller side: six components of a hundredth each over the root of 20.
    assert found.shift_mm == pytest.approx(np.linalg.norm(moved), abs=3 * STD * np.sqrt(6 / 20))
    assert found.p_value <= SIGNIFICANCE


def test_of_many_readings_an_even_selection_shows_the_same_step(monkeypatch):
    angles, points, residuals = session(600, 1)
    residuals[233:] += [0.03, -0.02, 0.01]
    monkeypatch.setattr(change_point, "MOST_READINGS", 150)
    change = examined(angles, points, residuals)
    assert abs(change.row - 233) <= 8  # two readings of the selection
    assert change.shift_mm == pytest.approx(np.sqrt(14) * 0.01, rel=0.1)


def test_a_rotation_of_the_tracker_is_a_step_too():
    angles, points, residuals = session(100, 2)
    turn = np.array([0.0, 1e-4, 0.0])
    away = points - points.mean(axis=0)
    residuals[50:] -= np.cross(turn, away)[50:]
    found = examined(angles, points, residuals)
    assert abs(found.row - 50) <= 1
    assert found.shift_mm == pytest.approx(np.sqrt((np.cross(turn, away) ** 2).sum(axis=1).mean()), rel=0.3)


def test_a_motion_in_proportion_to_the_row_is_a_drift():
    angles, points, residuals = session(200, 3)
    residuals -= np.linspace(0, 1, 200)[:, None] * [0.05, 0.0, 0.0]
    found = examined(angles, points, residuals)
    assert found.kind == "drift"
    assert found.shift_mm == pytest.approx(0.05, abs=0.02)
    assert (found.first_row, found.last_row) == (0, 199)


def test_a_step_among_gross_errors_is_found():
    """Their weights are small, as a robust fit gives them."""
    angles, points, residuals = session(100, 4)
    weights = np.full((100, 3), STD**-2)
    residuals[::9] += 5.0
    weights[::9] = 0.0
    residuals[40:] -= [0.04, 0.0, 0.0]
    (found,) = session_changes(angles, {"frame": rigid_motions(points)}, residuals, weights, np.arange(100))
    assert abs(found.row - 40) <= 1


def test_errors_of_the_pose_are_no_change_though_poses_are_ordered():
    """A model misses five deviations, smoothly with J1, and J1 was moved from one end to the other."""
    for seed in range(5):
        angles, points, residuals = session(300, seed, regions=True)
        residuals[:, 0] += 5 * STD * np.sin(2 * angles[:, 0])
        assert examined(angles, points, residuals) is None
    # The same order does not hide a step at poses that are alike on both sides.
    angles, points, residuals = session(300, 0)
    residuals[:, 0] += 5 * STD * np.sin(2 * angles[:, 0])
    residuals[100:] -= [0.05, 0.0, 0.0]
    assert abs(examined(angles, points, residuals).row - 100) <= 3


@pytest.mark.parametrize("repeats", [3, 12])
def test_poses_that_are_read_several_times_count_once(repeats):
    """Compared with its own repeats no reading shows a step, and what the model misses at a pose is no step."""
    angles, points, noise = session(60 * repeats, 0)
    poses = np.repeat(np.arange(60), repeats)
    angles, points = angles[poses] + 1e-4 * np.hstack([noise, noise]), points[poses]
    missed = STD * np.random.default_rng(1).standard_normal((60, 3))[poses]
    assert examined(angles, points, noise + missed) is None
    step = 30 * repeats
    noise[step:] -= [0.05, 0.0, 0.0]
    found = examined(angles, points, noise + missed)
    assert found.kind == "step"
    assert found.first_row <= step <= found.last_row
    assert abs(found.row - step) <= repeats
    ramp = noise - np.linspace(0, 1, len(noise))[:, None] * [0.3, 0.0, 0.0]
    assert examined(angles, points, ramp).last_row == 60 * repeats - 1


@pytest.mark.parametrize("seed", range(50))
def test_a_pose_is_what_follows_near_its_first_reading(seed):
    """A chain of small motions is no pose: reading by reading, each is compared with the first of its pose."""
    rng = np.random.default_rng(seed)
    angles = rng.choice([0.0, 0.3, 0.6, 0.9, 5.0], (int(rng.integers(1, 40)), 2)) * 3e-3
    near, first = max(0.01 * float(angles.std(axis=0).max()), change_point.STILL_ANGLE), []
    for row, at in enumerate(angles):
        if not first or (np.abs(at - angles[first[-1]]) > near).any():
            first.append(row)
    n = len(angles)
    readings = _Readings(angles, {}, np.zeros((n, 3)), np.ones((n, 3)), np.arange(n))
    np.testing.assert_array_equal(readings.less_repeats().rows, first)


def test_too_few_readings_say_nothing():
    angles, points, residuals = session(16, 0)
    residuals[8:] += 1.0
    assert examined(angles, points, residuals) is None


def test_points_that_never_vary_say_nothing():
    angles, points, _ = session(40, 0)
    assert examined(angles, points, np.zeros((40, 3))) is None


# An arm of six joints: which of its parts changed --------------------------------------------------------------------

CHAIN = load_arm("ur5").chain


def arm_session(n: int, seed: int):
    """Angles, motions of the points by all that may change, and pure noise."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-2, 2, (n, 6))
    pose, jacobian = CHAIN.pose_jacobians(angles)
    zeros = {f"J{joint + 1}": jacobian[:, :3, [joint]] for joint in range(6)}
    motions = {"frame": rigid_motions(pose.tip_in_base), "tip": pose.R_base_tip, **zeros}
    return angles, motions, STD * rng.standard_normal((n, 3))


def changes_of(angles, motions, residuals):
    n = len(angles)
    return session_changes(angles, motions, residuals, np.full((n, 3), STD**-2), np.arange(n))


@pytest.mark.parametrize("what", ["J2", "J3", "J4", "tip", "frame"])
def test_the_part_that_changed_is_named_with_its_size(what):
    angles, motions, residuals = arm_session(80, 5)
    planted = {"frame": [0.0, 2e-4, 0.0, 0.05, 0.0, 0.0], "tip": [0.03, 0.05, 0.0]}.get(what, [4e-4])
    after = np.arange(80) >= 33
    residuals -= after[:, None] * (motions[what] @ planted)
    (found,) = changes_of(angles, motions, residuals)
    assert (found.kind, found.what) == ("step", what)
    assert found.odds[what] > CLEAR_ODDS / (1 + CLEAR_ODDS)
    assert abs(found.row - 33) <= 1
    # 33 readings on one side at 0.01 mm each; a motion of one unit moves the points by this.
    unit = np.sqrt((motions[what] ** 2).sum(axis=1).mean(axis=0))
    np.testing.assert_allclose(found.motion * unit, planted * unit, atol=5 * STD / np.sqrt(33))


def test_two_moves_are_both_found():
    angles, motions, residuals = arm_session(150, 6)
    for row, moved in ((50, [0.3, 0.0, 0.0]), (100, [0.0, 0.3, 0.0])):
        residuals[row:] -= moved
    first, second = changes_of(angles, motions, residuals)
    assert (first.what, first.row) == ("frame", 50)
    assert (second.what, second.row) == ("frame", 100)


@pytest.mark.parametrize(
    ("seed", "moves"),
    [
        (23, {35: [0.01, 0.0, 0.0], 120: [0.012, 0.01, 0.0], 150: [0.0, -0.012, 0.012]}),
        (16, {100: [0.03, 0.0, 0.0], 115: [-0.02, 0.02, 0.0], 180: [0.0, -0.02, 0.0]}),
    ],
)
def test_each_of_several_changes_is_the_most_likely_one_beside_the_others(seed, moves):
    """What one of them explains is not counted for the kind of another; the last one found is moved too."""
    angles, motions, residuals = arm_session(300, seed)
    for row, moved in moves.items():
        residuals[row:] -= moved
    both = {what: motions[what] for what in ("frame", "tip")}
    at, margin = _Readings(angles, both, residuals, np.full((300, 3), STD**-2), np.arange(300)), _margin(300)
    found, _ = _steps(at, margin)
    assert len(found) > 1
    for number, one in enumerate(found):
        assert one == _best(at, found[:number] + found[number + 1 :], margin, steps=True)[0]


def test_a_slip_about_the_first_axis_is_a_motion_of_the_frame_too():
    """A small one: the odds say that both explain it."""
    angles, motions, residuals = arm_session(60, 7)
    residuals[30:] -= (motions["J1"] @ [4e-5])[30:]
    for found in changes_of(angles, motions, residuals):
        assert found.odds["J1"] + found.odds.get("frame", 0.0) > 0.9


def test_the_kind_that_is_named_is_the_first_of_its_odds():
    """Two joints slip within three readings: the likeliest row is one of J2, all rows together say J3."""
    angles, motions, residuals = arm_session(84, 87)
    course = np.interp(np.arange(84), [27, 28, 29, 30], [0.0, 0.2, 0.6, 1.0])
    residuals += course[:, None] * (motions["J2"] @ [1e-5] + motions["J3"] @ [1.7e-5])
    (found,) = changes_of(angles, motions, residuals)
    assert list(found.odds) == ["J3", "J2"]
    assert found.what == "J3"
    assert found.first_row <= found.row <= found.last_row


def test_an_axis_that_is_not_measured_does_not_count():
    """Whatever stands there: the step is that of the other two axes, with the same odds."""
    angles, motions, residuals = arm_session(80, 5)
    residuals[33:] -= motions["J3"][33:] @ [4e-4]
    weights = np.full((80, 3), STD**-2)
    weights[:, 2] = 0.0
    changes = []
    for height in (0.0, 7.0):
        residuals[:, 2] = height
        changes += session_changes(angles, motions, residuals, weights, np.arange(80))
    one, other = changes
    assert (one.kind, one.what, one.row) == ("step", "J3", 33)
    assert one.odds["J3"] > CLEAR_ODDS / (1 + CLEAR_ODDS)
    # A thousandth of the stated uncertainty of J3, 1e-2 mm over 500 mm and the root of 80.
    np.testing.assert_allclose([one.odds["J3"], *one.motion], [other.odds["J3"], *other.motion], atol=2e-9)


def test_good_sessions_of_an_arm_are_left_alone():
    assert sum(bool(changes_of(*arm_session(50, seed))) for seed in range(100, 160)) <= 1


def test_a_reading_is_no_neighbour_of_itself(rng):
    """Nor where so many repeat it exactly that a search need not name it."""
    angles = np.concatenate([np.tile(rng.normal(size=(2, 3)), (15, 1)), rng.normal(size=(20, 3))])
    at = _Readings(angles, {}, np.zeros((50, 3)), np.ones((50, 3)), np.arange(50))
    assert at.nearest.shape == (50, NEIGHBOURS)
    assert not (at.nearest == np.arange(50)[:, None]).any()
    assert all(len(set(row)) == NEIGHBOURS for row in at.nearest.tolist())


def test_the_long_run_variance_is_that_of_bartletts_kernel(rng):
    white = np.cumsum(rng.standard_normal((216, 3)), axis=0) + rng.standard_normal((216, 3))
    plain, lags = (white**2).sum(axis=0), 6  # the cube root of 216
    weighed = sum((1 - lag / (lags + 1)) * (white[lag:] * white[:-lag]).sum(axis=0) for lag in range(1, lags + 1))
    np.testing.assert_allclose(_long_run_ratio(white), 1 + 2 * weighed / plain, rtol=1e-12)


def test_residuals_less_what_is_smooth_are_those_of_least_squares(rng):
    angles, weights, residuals = rng.uniform(-1, 1, (200, 3)), rng.uniform(0.5, 2, (200, 3)), rng.normal(size=(200, 3))
    at = _Readings(np.concatenate([angles, angles[:8]]), {}, *(np.r_[of, of[:8]] for of in (residuals, weights)), None)
    smooth, root = at._smooth[0].T, np.sqrt(at.weights.mean(axis=1))[:, None]
    plain = at.residuals - smooth @ np.linalg.lstsq(root * smooth, root * at.residuals, rcond=1e-9)[0]
    # Normal equations of a condition of 1e9 at most: seven digits remain.
    np.testing.assert_allclose(at.less_smooth(at.residuals), plain, atol=1e-7)


@pytest.mark.parametrize("n_poses", [5, 10])
def test_where_poses_repeat_constant_motions_leave_rounding_that_explains_nothing(n_poses, rng):
    """Every reading has eight others of its own pose: constant motions have no differences from these."""
    angles, motions, residuals = arm_session(400, 4)
    order = rng.integers(0, n_poses, 400)
    angles, motions = angles[order], {what: of[order] for what, of in motions.items()}
    residuals[133:] -= [0.03, 0.0, 0.0]
    at = _Readings(angles, motions, residuals, np.full((400, 3), STD**-2), np.arange(400))
    found = _log_likelihoods(at, [], 20, steps=True)
    contrast = at.contrast.toarray()
    target = (contrast @ residuals).ravel()

    def share_left(what, step):
        moved = np.tensordot(contrast, (np.arange(400) >= step)[:, None, None] * motions[what], 1).reshape(1200, -1)
        moved /= np.maximum(np.linalg.norm(moved, axis=0), 1e-9)
        return ((target - moved @ np.linalg.lstsq(moved, target, rcond=1e-7)[0]) ** 2).sum() / (target @ target)

    steps = range(20, 381, 30)
    frame, tip = (np.array([share_left(what, step) for step in steps]) for what in ("frame", "tip"))
    # The number of independent coordinates is the same at every step; 6 motions cost more than 3.
    freedom = 2 * (found["frame"][::30] - found["tip"][::30] + 1.5 * np.log(400)) / np.log(tip / frame)
    np.testing.assert_allclose(freedom, freedom[0], rtol=1e-6)


@pytest.mark.parametrize("alike", [True, False])
def test_the_likelihood_of_each_step_is_that_of_its_least_squares(alike, rng):
    """Beside a change that is known, of weights that differ by axis or not; residuals differ from those at like poses.

    The rows near the known change too, where little of another is left.
    """
    angles, motions, residuals = arm_session(60, 8)
    del motions["J6"]  # it moves nothing
    residuals[25:] -= [0.1, 0.0, 0.0]
    weights = np.repeat(rng.uniform(0.5, 2, (60, 1)), 3, axis=1) if alike else rng.uniform(0.5, 2, (60, 3))
    at = _Readings(angles, motions, residuals, weights / STD**2, np.arange(60))
    others = [_Course("frame", 25), _Course("tip", 40)]
    found = _log_likelihoods(at, others, 8, steps=True)
    root, contrast = np.sqrt(at.weights), at.contrast.toarray()

    def squares(courses):
        moving = [one.over(60)[:, None, None] * motions[one.what] for one in courses]
        columns = np.concatenate([at.together, *moving], axis=2)
        columns /= np.linalg.norm(columns, axis=(0, 1))
        moved = (root[:, :, None] * np.tensordot(contrast, columns, 1)).reshape(180, -1)
        target = (root * (contrast @ residuals)).ravel()
        return ((target - moved @ np.linalg.lstsq(moved, target, rcond=1e-7)[0]) ** 2).sum()

    for what, of in found.items():
        plain = np.log([squares([*others, _Course(what, step)]) for step in range(8, 53)])
        slope = (of.max() - of.min()) / (plain.max() - plain.min())  # half the number of independent coordinates
        np.testing.assert_allclose(of - of[0], -slope * (plain - plain[0]), atol=1e-6 * slope)


def test_what_motions_explain_does_not_depend_on_their_units(rng):
    """Nor on motions of which nothing is left beside the others."""
    columns = rng.normal(size=(5, 40, 4))
    columns[:, :, 3] = columns[:, :, 0] - columns[:, :, 2]
    columns *= [1.0, 1e4, 1e-4, 1.0]
    target = rng.normal(size=(5, 40))
    gram, right = np.einsum("nip,niq->pqn", columns, columns), np.einsum("nip,ni->pn", columns, target)
    plain = [
        ((of @ np.linalg.lstsq(of, one, rcond=None)[0]) ** 2).sum()
        for of, one in zip(columns[:, :, :3], target, strict=True)
    ]
    np.testing.assert_allclose(_explained(gram, right, np.einsum("ppn->pn", gram).copy()), plain, rtol=1e-9)
