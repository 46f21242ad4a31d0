"""Two logs of one run joined by time: offset and drift from motion, readings from standstills."""

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.wings.importing.foreign.clock_offset import (
    Log,
    _line,
    _offset_of_move,
    clock_offset,
    common_times,
    robust_mean,
    standstills,
)
from truearm.wings.importing.foreign.joined_logs import join_tables
from truearm.wings.importing.tables.table import Table

ARM = ta.load_arm("ur5")
OFFSET, DRIFT = 73.4, 40e-6


def table(names, *columns, units=None):
    return Table(tuple(names), units or ("",) * len(names), columns, np.arange(2, 2 + len(columns[0])))


class Motion:
    """Moves of minimum jerk from rest to rest between random poses."""

    def __init__(self, poses=9, seed=1, *, speed=1.0, rounds=1, rest=(1.2, 2.4)):
        rng = np.random.default_rng(seed)
        poses = ARM.working + rng.uniform(-0.8, 0.8, (poses, 6))
        rests = np.tile(rng.uniform(*rest, len(poses)), rounds)
        self.poses = np.tile(poses, (rounds, 1))
        self.lasts = 1.875 * np.abs(np.diff(self.poses, axis=0)).max(axis=1) / speed
        self.starts = np.cumsum(rests)[:-1] + np.r_[0.0, np.cumsum(self.lasts)[:-1]]
        self.end = self.starts[-1] + self.lasts[-1] + rests[-1]

    def angles(self, t):
        k = np.clip(np.searchsorted(self.starts, t, side="right") - 1, 0, len(self.starts) - 1)
        s = np.clip((t - self.starts[k]) / self.lasts[k], 0.0, 1.0)
        return self.poses[k] + (s**3 * (10 - 15 * s + 6 * s**2))[:, None] * (self.poses[k + 1] - self.poses[k])

    def logs(self, *, first=0.0, joint_rate=125.0, tip_rate=50.0, span=None, noise=0.02, seed=2, ripple=0.0):
        """Joints from the time `first` on, points over `span`; the points' clock is slow, by OFFSET in their middle."""
        rng = np.random.default_rng(seed)
        t = np.arange(first, self.end, 1 / joint_rate)
        low, high = span or (0.5, self.end - 0.7)
        true = np.arange(low, high, 1 / tip_rate)
        shown = true.mean() - OFFSET + (true - true.mean()) / (1 + DRIFT)
        tips = ARM.forward(self.angles(true)).tip_in_base + noise * rng.standard_normal((len(true), 3))
        q = self.angles(t) + ripple * rng.standard_normal((len(t), 6))
        joints = table(["time", "q1", "q2", "q3", "q4", "q5", "q6"], t, *q.T)
        return joints, table(["t", "x", "y", "z"], shown, *tips.T)


def with_points(points, values):
    return table(points.names, points.columns[0], *values.T)


def values_of(joined):
    q = np.stack([joined.numbers(i) for i in range(1, 7)], axis=1)
    return q, np.stack([joined.numbers(i) for i in range(-3, 0)], axis=1)


def assert_readings(joined, motion, *, readings, angle=1e-4, tip=0.02):
    """Each reading is a pose that was planted, with its tip."""
    q, p = values_of(joined)
    assert len(q) == readings
    off = np.abs(q[:, None] - motion.poses).max(axis=2)
    assert off.min(axis=1).max() < angle
    tips = ARM.forward(motion.poses[off.argmin(axis=1)]).tip_in_base
    assert np.abs(p - tips).max() < tip


# Offset and drift ----------------------------------------------------------------------------------------------------


def test_offset_and_drift_are_those_planted_within_their_uncertainty():
    motion = Motion(12, 1)
    joints, points = motion.logs()
    joined = join_tables(joints, points, "time")
    clock = joined.clock
    planted = OFFSET + DRIFT * (clock.at_s - points.columns[0].mean())
    assert abs(clock.offset_s - planted) < 3 * clock.u_offset_s
    assert clock.u_offset_s < 0.0005
    assert abs(clock.drift - DRIFT) < 4 * clock.u_drift
    assert clock.n_moves == 11
    assert_readings(joined, motion, readings=12)
    stated = f"(its times {clock.offset_s:+.4f} s, u {clock.u_offset_s:.5f} s; drift"
    assert any(stated in said and "ppm" in said for said in joined.assumed)


def size_in_u(errors, u):
    """Root mean square of errors over that of their stated standard uncertainties."""
    return float(np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(u))))


def test_planted_offsets_scatter_as_the_uncertainty_says():
    """Fifty runs of three moves: 0.8 to 1.25 times the stated uncertainty; such a ratio is known to 10 %."""
    found = []
    for seed in range(50):
        motion = Motion(4, seed)
        joints, points = motion.logs(seed=seed, tip_rate=25.0)
        logs = (Log(t, np.stack(values, axis=1), np.arange(len(t))) for t, *values in (joints.columns, points.columns))
        rests = np.stack([np.r_[0.0, motion.starts + motion.lasts], np.r_[motion.starts, motion.end]], axis=1)
        clock = clock_offset(*logs, rests, given_s=OFFSET + 0.05)
        planted = OFFSET + DRIFT * (clock.at_s - points.columns[0].mean())
        found.append((clock.offset_s - planted, clock.u_offset_s))
    assert 0.8 < size_in_u(*zip(*found, strict=True)) < 1.25


@pytest.mark.parametrize("stated_ms", [0.1, 1.0])
def test_a_line_through_moves_is_as_uncertain_as_they_scatter(stated_ms):
    """Five moves with errors of 1 ms, of which they state a tenth, or all: three degrees of freedom.

    Of 300 lines the ratio is known to 5 %; where the moves state all, a scatter that is larger by chance adds to it.
    """
    rng, at = np.random.default_rng(0), np.linspace(0.0, 100.0, 5)
    u = np.full(5, 1e-3 * stated_ms)
    lines = [_line(at, 0.5 + 1e-4 * (at - 50) + 1e-3 * rng.normal(size=5), u) for _ in range(300)]
    assert 0.85 < size_in_u([one.offset_s - 0.5 for one in lines], [one.u_offset_s for one in lines]) < 1.1
    assert 0.85 < size_in_u([one.drift - 1e-4 for one in lines], [one.u_drift for one in lines]) < 1.1


@pytest.mark.parametrize(("rate", "rest", "alike", "n"), [(10.0, 0.2, 0.0, 120), (50.0, 1.0, 0.6, 60)])
def test_a_single_move_is_as_uncertain_as_its_samples_say(rate, rest, alike, n):
    """Few samples, of which the polynomial takes a third, and many whose errors resemble those of their neighbours.

    Of so many moves the ratio is known to 7 and 9 %.
    """
    rng, found = np.random.default_rng(1), []
    t = np.arange(0.0, 1.2 + 2 * rest, 0.002)

    def way(t):
        s = np.clip((t - rest) / 1.2, 0.0, 1.0)
        return (s**3 * (10 - 15 * s + 6 * s**2))[:, None]

    for _ in range(n):
        at = np.arange(rng.uniform(0, 1 / rate), t[-1], 1 / rate)
        errors = rng.normal(size=(len(at), 3))
        for i in range(1, len(at)):
            errors[i] = alike * errors[i - 1] + np.sqrt(1 - alike**2) * errors[i]
        tip = way(at) * [100.0, 200.0, -100.0] + 0.1 * errors
        logs = Log(t, way(t), np.arange(len(t))), Log(at, tip, np.arange(len(at)))
        _, shift, u, _ = _offset_of_move(*logs, 0.0, np.array([0.0, rest]), np.array([1.2 + rest, t[-1]]))
        found.append((shift, u))
    assert 0.85 < size_in_u(*zip(*found, strict=True)) < 1.17


def test_clocks_may_be_hours_apart_and_count_in_other_units():
    joints, points = Motion().logs()
    epoch = Table(
        points.names, ("ms", "", "", ""), (1.7e12 + 1e3 * points.columns[0], *points.columns[1:]), points.lines
    )
    far, near = (join_tables(joints, one, "time").clock for one in (epoch, points))
    assert far.offset_s + 1.7e9 == pytest.approx(near.offset_s, abs=1e-4)
    assert far.drift == pytest.approx(near.drift, abs=1e-6)


def test_points_in_metres_and_joints_in_counts_give_the_same_readings():
    motion = Motion(6)
    joints, points = motion.logs()
    counts = table(joints.names, joints.columns[0], *[np.round(c * 2**16 / 6.283185) for c in joints.columns[1:]])
    metres = with_points(points, np.stack(points.columns[1:], axis=1) / 1000)
    joined = join_tables(counts, metres, "time", point_unit_mm=1000.0)
    q, p = values_of(joined)
    plain_q, plain_p = values_of(join_tables(joints, points, "time"))
    assert np.abs(q * 6.283185 / 2**16 - plain_q).max() < 1e-4
    assert np.abs(1000 * p - plain_p).max() < 0.01


def test_a_log_that_starts_in_motion_and_a_tracker_that_starts_late():
    motion = Motion()
    joints, points = motion.logs(first=motion.starts[0] + 0.5, span=(motion.starts[1] + 0.3, motion.starts[6] + 0.2))
    joined = join_tables(joints, points, "time")
    assert abs(joined.clock.offset_s - OFFSET) < 0.01
    assert_readings(joined, motion, readings=5)


@pytest.mark.parametrize(("speed", "ripple"), [(0.15, 0.0), (1.0, 1e-4), (1.0, 5e-4)])
def test_slow_robots_and_joints_that_tremble(speed, ripple):
    motion = Motion(6, speed=speed)
    joined = join_tables(*motion.logs(ripple=ripple), "time")
    assert abs(joined.clock.offset_s - OFFSET) < 3 * joined.clock.u_offset_s
    assert_readings(joined, motion, readings=6, angle=1e-4 + ripple)


def test_moves_by_way_of_other_poses():
    """The joints do not go straight, so that how far they have come is the length of their path."""
    motion = Motion(8)
    straight = motion.angles

    def bent(t):
        q = straight(t)
        k = np.clip(np.searchsorted(motion.starts, t, side="right") - 1, 0, len(motion.starts) - 1)
        s = np.clip((t - motion.starts[k]) / motion.lasts[k], 0.0, 1.0)
        return q + (np.sin(np.pi * s) ** 4)[:, None] * [0.3, -0.5, 0.4, 0.0, 0.0, 0.0]

    motion.angles = bent
    joined = join_tables(*motion.logs(), "time")
    assert abs(joined.clock.offset_s - OFFSET) < max(0.05, 3 * joined.clock.u_offset_s)
    assert_readings(joined, motion, readings=8)


def test_a_single_move_gives_an_offset_and_no_drift():
    motion = Motion(2, 3)
    joined = join_tables(*motion.logs(), "time")
    assert abs(joined.clock.offset_s - OFFSET) < 0.01
    assert joined.clock.drift == 0
    assert_readings(joined, motion, readings=2)


@pytest.mark.parametrize("lost", [0.0, np.nan, -9999.0, "held"])
def test_a_lost_target_is_no_point(lost):
    motion = Motion()
    joints, points = motion.logs()
    tips = np.stack(points.columns[1:], axis=1)
    t = points.columns[0] + OFFSET
    for start in motion.starts[[1, 4, 5]]:
        gone = np.flatnonzero((t > start + 0.1) & (t < start + 0.7))
        tips[gone] = tips[gone[0] - 1] if lost == "held" else lost
    joined = join_tables(joints, with_points(points, tips), "time")
    assert abs(joined.clock.offset_s - OFFSET) < 0.01
    assert_readings(joined, motion, readings=9)
    assert any("without a point skipped" in said for said in joined.assumed)


def test_a_target_that_is_held_through_a_standstill_gives_no_reading():
    motion = Motion()
    joints, points = motion.logs()
    tips, t = np.stack(points.columns[1:], axis=1), points.columns[0] + OFFSET
    gone = np.flatnonzero((t > motion.starts[3] + 0.2) & (t < motion.starts[4] + 0.5))
    tips[gone] = tips[gone[0]]
    joined = join_tables(joints, with_points(points, tips), "time")
    assert_readings(joined, motion, readings=8)
    assert "1 more of the joints alone skipped" in joined.assumed


def test_angles_that_are_written_within_a_turn():
    motion = Motion(6)
    joints, points = motion.logs()
    shifted = np.degrees(joints.columns[6]) + 180 - np.degrees(motion.poses[2, 5])  # a pose at the end of the turn
    shifted = (shifted + 0.001 * np.random.default_rng(1).standard_normal(len(shifted)) + 180) % 360 - 180
    degrees = [np.degrees(c) for c in joints.columns[1:6]]
    joined = join_tables(table(joints.names, joints.columns[0], *degrees, shifted), points, "time")
    assert len(joined) == 6
    assert abs(abs(joined.numbers(6)[2]) - 180) < 0.01


# What cannot be known ------------------------------------------------------------------------------------------------


def test_a_program_that_repeats_is_asked_and_settled_by_the_option():
    motion = Motion(4, rounds=3)
    joints, points = motion.logs()
    caught = refuses(r"the motion repeats: 73\.\d s or .* Try: --time-offset 73\.", join_tables, joints, points, "time")
    assert caught.hint.count("--time-offset") == 2
    joined = join_tables(joints, points, "time", time_offset_s=73.0)
    assert abs(joined.clock.offset_s - OFFSET) < 0.01
    assert_readings(joined, motion, readings=12)


def test_logs_of_two_runs_are_refused():
    joints, _ = Motion(9, 1).logs()
    _, points = Motion(9, 2).logs()
    refuses(r"motion of the points does not match .*--time-offset", join_tables, joints, points, "time")
    _, later = Motion(9, 3).logs(span=(20.0, 24.0))
    refuses(r"has 1 whole moves of 8: too few .*--time-offset", join_tables, joints, later, "time")


def test_a_robot_that_never_rests_is_refused_with_its_longest_rest():
    with pytest.raises(InputError, match=r"no standstill of 0.5 s: .* for 0\.\d+ s at most.*--still"):
        join_tables(*Motion(rest=(0.2, 0.3)).logs(), "time")


def test_short_rests_are_used_if_the_option_says_so():
    motion = Motion(rest=(0.3, 0.4))
    joined = join_tables(*motion.logs(span=(0.0, motion.end)), "time", standstill_s=0.2)
    assert_readings(joined, motion, readings=9, tip=0.04)


def test_a_table_without_times_is_refused_with_the_other_ways():
    joints, points = Motion(3).logs()
    bare = Table(("x", "y", "z"), ("",) * 3, points.columns[1:], points.lines)
    refuses(r"no column holds times; the columns are x, y, z. Try: --by row", join_tables, joints, bare, "time")


# Single points -------------------------------------------------------------------------------------------------------


def single_points(motion, seed=4):
    rng = np.random.default_rng(seed)
    ends = np.r_[motion.starts, motion.end]
    at = ends - rng.uniform(0.2, 0.8, len(ends))
    return table(["time", "x", "y", "z"], at - OFFSET, *ARM.forward(motion.angles(at)).tip_in_base.T)


def test_single_points_lie_in_standstills():
    motion = Motion(15)
    joints, _ = motion.logs()
    joined = join_tables(joints, single_points(motion), "time")
    assert abs(joined.clock.offset_s - OFFSET) < 3 * joined.clock.u_offset_s
    assert_readings(joined, motion, readings=15)


def test_single_points_at_equal_steps_are_asked():
    rests = np.arange(0.0, 60.0, 5.0)
    t = np.arange(0.0, 62.0, 0.01)
    q = np.interp(t, np.sort(np.r_[rests, rests + 3.0]), np.repeat(np.arange(12.0), 2))
    points = table(["time", "x", "y", "z"], rests[2:9] + 1.0, *np.random.default_rng(1).normal(size=(3, 7)))
    refuses(r"at several offsets: 7 of 7 at .* --time-offset", join_tables, table(["time", "q1"], t, q), points, "time")
    joined = join_tables(table(["time", "q1"], t, q), points, "time", time_offset_s=0.0)
    np.testing.assert_allclose(joined.numbers(1), np.arange(2.0, 9.0), atol=1e-6)


def test_poses_that_the_program_wrote_down_lie_in_standstills_of_the_tip():
    motion = Motion(15)
    _, points = motion.logs()
    rng = np.random.default_rng(4)
    at = np.r_[motion.starts, motion.end][:-1] - rng.uniform(0.2, 0.8, 14)
    joints = table(["time", *(f"q{i}" for i in range(1, 7))], at, *motion.angles(at).T)
    joined = join_tables(joints, points, "time")
    assert abs(joined.clock.offset_s - OFFSET) < 3 * joined.clock.u_offset_s
    assert_readings(joined, motion, readings=14)
    assert any("14 rows in standstills of the other file" in said for said in joined.assumed)
    refuses(r"both tables have single rows, .* Try: --by row", join_tables, joints, single_points(motion), "time")


def test_time_stamps_of_whole_seconds():
    motion = Motion(8)
    joints, points = motion.logs()
    whole = table(points.names, np.floor(points.columns[0]), *points.columns[1:])
    joined = join_tables(joints, whole, "time")
    assert abs(joined.clock.offset_s - OFFSET) < 0.1
    assert_readings(joined, motion, readings=8)


def test_an_offset_that_is_stated_wrong_is_refused():
    joints, points = Motion(9).logs()
    with pytest.raises(InputError, match="at an offset of 60.0 s their moves do not begin and end together"):
        join_tables(joints, points, "time", time_offset_s=60.0)


def test_joints_that_never_move_are_named():
    joints, points = Motion(3).logs()
    still = table(joints.names, joints.columns[0], *np.ones((6, len(joints))))
    refuses("the joints never move", join_tables, still, points, "time")


# Standstills ---------------------------------------------------------------------------------------------------------


def test_standstills_of_a_hand_made_log():
    t = np.arange(0.0, 6.0, 0.01)
    value = np.interp(t, [1.0, 2.0, 3.5, 5.5], [0.0, 10.0, 10.0, 30.0])[:, None]  # 20 mm in two seconds
    value[50] += 5.0  # a stray sample
    found = standstills(Log(t, value, np.arange(len(t))), 0.2, 0.4)
    np.testing.assert_allclose(found, [[0.0, 1.02], [1.98, 3.52], [5.48, 5.99]], atol=0.03)
    assert len(standstills(Log(t, value, np.arange(len(t))), 0.2, 1.2)) == 1


def test_common_times_are_the_longest_of_each_standstill():
    first, second = np.array([[0.0, 4.0], [5.0, 6.0]]), np.array([[1.0, 1.5], [2.0, 5.2]])
    assert common_times(first, second, 0.4).tolist() == [[2.0, 4.0]]


def test_mean_without_a_stray_sample_and_with_the_correlation_of_neighbours():
    rng = np.random.default_rng(5)
    values = rng.standard_normal((400, 3))
    values[7] = 100.0
    mean, u, n = robust_mean(values)
    assert n >= 396
    assert np.abs(mean).max() < 0.2
    assert u == pytest.approx(np.sqrt(3 / 400), rel=0.15)
    drifting = np.zeros((4000, 3))  # a first autoregressive process, of variance 1 / (1 - 0.8^2)
    for i in range(1, 4000):
        drifting[i] = 0.8 * drifting[i - 1] + rng.standard_normal(3)
    assert robust_mean(drifting)[1] == pytest.approx(np.sqrt(3 / 4000) / (1 - 0.8), rel=0.1)
    assert robust_mean(np.ones((4, 3)))[1] == 0
