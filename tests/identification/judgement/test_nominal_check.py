"""A wrong sign, order, zero or unit is refused at every door; an arm that is merely inaccurate is not."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm import Arm, Chain, load_arm
from truearm.arm.arm_files import read_arm, write_arm
from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.nominal_check import MAX_RATIO, IdentifiedConstants, usual_error
from truearm.identification.references.reading_references import check_spread, references_of, state_of
from truearm.identification.terms import constants
from truearm.models import KinematicModel, NominalModel, load_model
from truearm.models.refit import refit
from truearm.readings import Session
from truearm.wings.planning.designs.sampling import STRATEGIES
from truearm.wings.planning.virtual import VirtualArm

# Without joint limits, which find many mistakes.
ARM = replace(load_arm("gao2017"), lower=None, upper=None)
REFUSED = "misses its references by .* of another arm, or the arm is described wrongly"


@pytest.fixture(scope="module")
def session() -> Session:
    readings = VirtualArm.draw(ARM, "research", seed=1).measure(STRATEGIES["box"](ARM, 40, seed=1).angles, seed=1)
    return Session(readings.readings.angles, readings.readings.points)


def with_sign(session: Session, joint: int) -> Session:
    return replace(session, angles=session.angles * np.where(np.arange(6) == joint - 1, -1.0, 1.0))


def with_zero(session: Session, joint: int, degrees: float) -> Session:
    return replace(session, angles=session.angles + np.radians(degrees) * (np.arange(6) == joint - 1))


def test_the_usual_error_is_what_constants_of_the_prior_cause(session):
    """Against nominal fits of arms whose constants are drawn from the prior, a hundredth in size: then linear."""
    free, all_constants = ("base", "tip"), constants(ARM.chain)
    learned = [term for term in all_constants if term.group not in free]
    nominal = NominalModel(ARM).fit_readings(session)
    bare = replace(session, points=nominal.predict(session.angles))
    fit = NominalModel(ARM).fit_readings(bare).nominal_
    state = state_of(ARM, bare)
    usual = usual_error(fit, state, references_of(bare, None), learned)
    chain = PerturbedChain(fit.chain, tuple(learned))
    std = np.concatenate([term.prior_stds for term in learned])
    rng, squares = np.random.default_rng(0), []
    for _ in range(15):
        tips = chain.tips(state, 0.01 * std * rng.standard_normal(len(std)))
        drawn = NominalModel(ARM).fit_readings(replace(bare, points=tips)).nominal_
        squares.append((drawn.references[0].residuals ** 2).sum(axis=0).mean())
    # 15 arms of some ten directions that matter: the root mean square is known to 7 %; 3 sigma.
    assert np.sqrt(np.mean(squares)) / 0.01 == pytest.approx(usual, rel=0.2)


def test_a_right_arm_misses_by_less_than_usual(session):
    check = KinematicModel(ARM).fit_readings(session).nominal_check_
    assert check.ratio < 0.2
    assert check.is_usual
    assert check.findings() == ()


MISTAKES = {
    "sign 5": lambda s: with_sign(s, 5),
    "3 and 4": lambda s: replace(s, angles=s.angles[:, [0, 1, 3, 2, 4, 5]]),
    "zero -90": lambda s: with_zero(s, 3, -90),
    "left-handed": lambda s: replace(s, points=s.points * [-1, 1, 1]),
    "feet": lambda s: replace(s, points=s.points / 304.8),
}
FURTHER = {  # of the same kinds
    "sign 6": lambda s: with_sign(s, 6),
    "5 and 6": lambda s: replace(s, angles=s.angles[:, [0, 1, 2, 3, 5, 4]]),
    "zero 90": lambda s: with_zero(s, 5, 90),
    "zero 100": lambda s: with_zero(s, 4, 100),
    "signs": lambda s: replace(s, angles=-s.angles),
}


@pytest.mark.parametrize("name", [*MISTAKES, *(pytest.param(name, marks=pytest.mark.weekly) for name in FURTHER)])
def test_a_mistake_is_refused(session, name):
    wrong = (MISTAKES | FURTHER)[name](session)
    refuses(f"{REFUSED}|spread over", NominalModel(ARM).fit, wrong.angles, wrong.points)


def test_a_mistake_is_refused_at_every_door(session):
    wrong = with_sign(session, 5)
    refuses(REFUSED, KinematicModel(ARM).fit, wrong.angles, wrong.points)
    for model in ("nominal", "kinematic"):
        refuses(REFUSED, ta.fit, ARM, wrong, model=model)


@pytest.mark.parametrize(
    ("unit", "mm", "option"), [("m", 1e3, "m"), ("cm", 10.0, "cm"), ("inch", 25.4, "in"), ("um", 1e-3, "um")]
)
def test_another_unit_of_the_points_is_named(session, unit, mm, option):
    said = rf"the points may be in {unit}: convert them to mm, or state it \(truearm import --point-unit {option}\)"
    refuses(said, NominalModel(ARM).fit, session.angles, session.points / mm)


def test_the_unit_of_points_is_asked_before_their_spread_to_both_sides_of_a_line(session):
    """All of an arm's points in m are within a millimetre or two of any line; others on a line are said to be."""
    small = replace(session, points=session.points / 1e3)
    caught = refuses("reference points spread over", check_spread, small, ARM)
    assert "may be in m:" in caught.hint
    assert "import --point-unit" in caught.hint
    along = session.points.copy()
    along[:, 1:] = 0.0
    refuses(r"of a line.*measure points spread over an area", check_spread, replace(session, points=along), ARM)


def test_degrees_are_refused(session):
    refuses("misses its references", KinematicModel(ARM).fit, np.degrees(session.angles), session.points)


def test_a_column_that_stands_still_while_the_joint_moved_is_refused(session):
    """It looks like noise; a joint that is locked indeed leaves none, and is fitted."""
    angles = session.angles.copy()
    angles[:, 3] = angles[0, 3]
    caught = refuses("misses its references", ta.fit, ARM, replace(session, angles=angles), model="kinematic")
    assert "J4 did not move by the readings" in caught.hint


def test_a_base_that_is_stated_to_be_known_is_not_half_a_metre_away(session):
    """Its constants would explain it."""
    with pytest.raises(InputError, match="misses its references .* the base, which is stated to be known, 500 mm"):
        ta.fit(ARM, replace(session, points=session.points + [500.0, 0.0, 0.0]), free=(), model="kinematic")


def test_zeros_off_by_five_degrees_are_identified_and_named(session):
    result = ta.fit(ARM, with_zero(session, 4, 5.0), model="kinematic")
    assert result.nominal.nominal_check_.ratio > MAX_RATIO
    said = " ".join(result.remarks)
    assert "times as much as nominal arms usually do" in said
    assert "add to their theta: J4 -4.99 deg" in said, said
    assert result.model.held_out_.mean_mm < 0.05


def test_zeros_that_the_fit_finds_are_no_contradiction(session):
    """An encoder was changed, a servo horn is a tooth on. The first zero is the base's, the last is the tip's."""
    off = np.radians(20.0) * np.array([0.3, -1, 0.8, 1, -0.9, 0.4])
    wrong = replace(session, angles=session.angles - off)
    result = ta.fit(ARM, wrong, model="kinematic")
    found = result.nominal.nominal_check_.identified.zeros
    assert list(found) == ["J2", "J3", "J4", "J5"]
    for zero, joint in zip(found.values(), (1, 2, 3, 4), strict=True):
        assert zero[0] == pytest.approx(off[joint], abs=np.radians(0.3))  # ten times the arm's own errors
    assert result.held_out_mm[0] < 0.05
    again = ta.fit(result.arm_with_zeros(), wrong, model="kinematic")
    assert again.nominal.nominal_check_.is_usual
    assert again.held_out_mm[0] == pytest.approx(result.held_out_mm[0], rel=0.05)


def test_a_column_that_was_homed_elsewhere_is_identified_in_mm():
    """J2 lifts the arm after J1; its zero is a length of d, and the twist about it is no zero."""
    arm = load_arm("ur5")
    fixed = np.insert(arm.chain.fixed, 1, np.eye(4), axis=0)
    fixed[1, :3, 0:3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # the column stands across the axis of J1
    arm = Arm("torso", Chain(fixed, arm.chain.tip_in_flange, np.arange(7) == 1))
    angles = np.random.default_rng(1).uniform(-1.5, 1.5, (60, 7)) * np.where(np.arange(7) == 1, 100.0, 1.0)
    points = arm.chain.tip_in_base(angles + 100.0 * (np.arange(7) == 1))
    points += 0.05 * np.random.default_rng(2).standard_normal(points.shape)
    check = KinematicModel(arm).fit(angles, points).nominal_check_
    assert check.ratio > MAX_RATIO
    assert list(check.identified.zeros) == ["J2"]
    zero, u = check.identified.zeros["J2"]
    assert abs(zero - 100.0) < max(4 * u, 0.5)
    assert "add to their d: J2 +100 mm" in str(check.identified)


def test_noise_is_said_and_no_contradiction():
    """A camera in place of a tracker, and nothing stated: the scatter is the first remark."""
    arm, noise_mm = replace(load_arm("ur5"), lower=None, upper=None), 3.0
    readings = ta.simulate(arm, poses=80, seed=3).session
    points = readings.points + noise_mm * np.random.default_rng(5).standard_normal((80, 3))
    result = ta.fit(arm, Session(readings.angles, points), model="kinematic")
    assert result.nominal.nominal_check_.ratio > MAX_RATIO
    assert "scatter by" in result.remarks[0]
    assert "laser tracker it is 0.05 mm" in result.remarks[0]
    scatter = float(result.remarks[0].split("scatter by ")[1].split()[0])
    assert scatter == pytest.approx(noise_mm * np.sqrt(3), rel=0.2)


def test_noise_hides_no_mistake(session):
    points = session.points + 10.0 * np.random.default_rng(5).standard_normal(session.points.shape)
    for spoil, name in (
        (with_sign, "sign of J4 reversed"),
        (lambda s, j: with_zero(s, j, 90), "zero of J4 off by -90"),
    ):
        caught = refuses(REFUSED, KinematicModel(ARM).fit_readings, spoil(replace(session, points=points), 4))
        assert f"put this right: {name}" in caught.hint


def test_readings_of_other_poses_are_refused(session, rng):
    refuses(REFUSED, KinematicModel(ARM).fit_readings, replace(session, points=session.points[rng.permutation(40)]))


def in_a_cube(arm: Arm, n: int, side_mm: float) -> Session:
    """Readings whose points lie in a cube about the tip of the working posture."""
    angles = arm.working + np.random.default_rng(2).uniform(-1, 1, (30_000, 6))
    off = arm.chain.tip_in_base(angles) - arm.chain.tip_in_base(arm.working[None])
    angles = angles[(np.abs(off) < side_mm / 2).all(axis=1)][:n]
    assert len(angles) == n
    return VirtualArm.draw(arm, "shop", seed=2).measure(angles, seed=2).readings


def test_points_close_together_in_another_order_are_no_noise():
    """Their scatter is a small share of the reach; that of an honest camera is a small share of the cube too."""
    arm = replace(load_arm("ur10"), lower=None, upper=None)
    readings, rng = in_a_cube(arm, 28, 220.0), np.random.default_rng(2)
    camera = Session(readings.angles, readings.points + 10 * rng.standard_normal(readings.points.shape))
    shuffled = replace(camera, points=readings.points[rng.permutation(28)])
    model = NominalModel(arm).fit_readings(camera)
    assert model.nominal_check_.ratio > MAX_RATIO
    assert model.nominal_check_.left.noise_mm == pytest.approx(10 * np.sqrt(3), rel=0.3)
    refuses(REFUSED, NominalModel(arm).fit_readings, shuffled)
    refuses(REFUSED, refit, model, shuffled)


def test_where_base_and_tip_absorb_every_constant_nothing_is_judged(rng):
    """One joint: noise alone remains. With the base as stated its constants count."""
    fixed = np.tile(np.eye(4), (2, 1, 1))
    fixed[1, :3, 3] = [20, 0, 100]
    arm = Arm("wheel", Chain(fixed, np.array([200.0, 0, 50.0])))
    angles = rng.uniform(-2, 2, (40, 1))
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 0.01, (40, 3))
    model = KinematicModel(arm).fit(angles, points)
    assert model.nominal_check_.usual_mm == np.inf
    assert model.nominal_check_.is_plausible
    assert 0 < KinematicModel(arm, free=()).fit(angles, points).nominal_check_.usual_mm < np.inf


def test_the_stated_uncertainty_is_part_of_the_usual_error(session):
    bare, stated = (
        NominalModel(ARM).fit_readings(replace(session, point_std=std)).nominal_check_.usual_mm
        for std in (None, np.full(session.points.shape, 0.3))
    )
    assert stated == pytest.approx(np.hypot(bare, 0.3 * np.sqrt(3)), rel=1e-3)


def test_gross_errors_do_not_condemn_an_arm(session):
    points = session.points.copy()
    points[::20] += 100.0
    assert KinematicModel(ARM).fit(session.angles, points).nominal_check_.is_usual


@pytest.mark.parametrize(
    ("size", "seed"), [(1.0, 1), *(pytest.param(*one, marks=pytest.mark.weekly) for one in ((100.0, 2), (1000.0, 1)))]
)
def test_a_fifth_of_gross_errors_leaves_the_arm_as_without_them(size, seed):
    """All in one direction, as of a target that was moved: Huber's weights alone take them for honest."""
    angles = STRATEGIES["uniform"](ARM, 40, seed=seed).angles
    readings = VirtualArm.draw(ARM, "shop", seed=seed).measure(angles, seed=seed).readings
    bad = np.random.default_rng(seed).permutation(40)[:8]
    points, rest = readings.points.copy(), np.delete(np.arange(40), bad)
    points[bad] += size / np.sqrt(3)
    for kind in (NominalModel, KinematicModel):
        model, without = kind(ARM).fit(angles, points), kind(ARM).fit(angles[rest], readings.points[rest])
        assert model.nominal_check_.is_usual
        expected, covariance = without.predict(angles, return_cov=True)
        off = (model.predict(angles) - expected) ** 2
        assert (off.sum(axis=1) / np.trace(covariance, axis1=1, axis2=2)).mean() < 0.2**2  # of the uncertainty


def test_an_arm_may_state_that_it_is_inaccurate(session, tmp_path):
    """The way for who knows better: the same statement serves the arm file and both doors, and is kept."""
    wrong = with_zero(session, 4, 20.0)
    write_arm(replace(ARM, nominal_error_mm=40.0), tmp_path / "arm.toml")
    arm = read_arm(tmp_path / "arm.toml")
    assert arm.nominal_error_mm == 40.0
    model = KinematicModel(arm).fit_readings(wrong)
    assert model.held_out_.mean_mm < 0.05
    model.save(tmp_path / "m.truearm")
    assert load_model(tmp_path / "m.truearm").arm_.nominal_error_mm == 40.0


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_a_nominal_error_is_a_length(value):
    refuses("expected nominal_error_mm of 0 or more", replace, ARM, nominal_error_mm=value)


def test_a_transfer_refuses_them_too(session):
    model = KinematicModel(ARM).fit_readings(with_zero(session, 4, 5.0))
    moved = replace(session, points=session.points + [100.0, 50.0, 0.0])
    assert refit(model, with_zero(moved, 4, 5.0)).nominal_check_.is_usual
    refuses(REFUSED, refit, model, with_sign(with_zero(moved, 4, 5.0), 6))


def test_constants_that_do_not_differ_are_not_named():
    """Rounding, such as theta of J2 +6.7e-38 deg, is no difference."""
    rng = np.random.default_rng(4)
    angles = ARM.working + 0.8 * rng.uniform(-1, 1, (30, ARM.n_joints))
    points = ARM.chain.tip_in_base(angles) + rng.normal(0, 0.02, (30, 3))
    fit = NominalModel(ARM).fit(angles, points).nominal_
    same = replace(fit, coefficients=np.full(len(fit.coefficients), 1e-40))
    found = IdentifiedConstants.of(same, ARM, ("base", "tip"))
    assert (found.largest, str(found)) == ("", "They are those of the arm file.")
