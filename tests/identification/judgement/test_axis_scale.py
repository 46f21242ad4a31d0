"""The scale of one axis of the reference: found within its uncertainty, refused, and not seen where there is none."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm import Arm
from truearm.arm.denavit_hartenberg import chain_from_dh
from truearm.identification.judgement.length_scale import NOISE_MM, SHARE_STD, AxisScale, likeliest_axis


@pytest.fixture(scope="module")
def session():
    return ta.simulate("ur10", poses=100, seed=1).session


def stretched(session, axis, share):
    return replace(session, points=session.points * (1 + share * np.eye(3)["xyz".index(axis)]))


@pytest.mark.parametrize(("axis", "share"), [("x", 0.05), ("y", -0.01), ("z", 0.005)])
def test_one_axis_that_is_too_long_is_refused_with_its_scale(session, axis, share):
    longer = "longer" if share > 0 else "shorter"
    error = refuses(f"% {longer} along {axis} than", ta.fit, "ur10", stretched(session, axis, share), model="nominal")
    assert error.column == f"{axis}_mm"
    factor = float(error.hint.split("divided by ")[1].split()[0])
    assert factor == pytest.approx(1 + share, abs=1e-4 + 0.01 * abs(share))  # the arm has some of its own


def test_accepted_it_is_kept_with_the_model(session):
    found = ta.fit("ur10", stretched(session, "z", 0.01), model="kinematic", accept="a short table")
    assert "along z than along the other axes" in str(found.model.accepted_[0])


def test_a_small_one_is_said():
    session = ta.simulate("ur5e", poses=60, preset="shop", seed=1).session
    found = ta.fit("ur5e", stretched(session, "y", 7e-4), model="nominal")
    said = [one for one in found.findings if one.what == "axis scale"]
    assert len(said) == 1
    assert said[0].numbers["share"] == pytest.approx(7e-4, abs=2e-4)


@pytest.mark.parametrize(("arm", "preset"), [("ur10", "research"), ("gao2017", "printed")])
def test_no_axis_is_named_of_an_arm_that_yields(arm, preset):
    readings = ta.simulate(arm, poses=100, preset=preset, strategy="measuring", seed=2).session
    found = ta.fit(arm, readings, model="nominal")
    assert not [one for one in found.findings if one.what == "axis scale"]


def test_it_is_found_beside_gross_errors(session):
    points = stretched(session, "z", 0.01).points
    points[::10] += 100.0
    found = ta.fit("ur10", replace(session, points=points), model="nominal", accept="to see it").model.nominal_check_
    assert found.axis_scale.is_clear
    assert found.axis_scale.share == pytest.approx(0.01, abs=3e-4)


def test_the_scale_of_a_slide_is_none_of_the_reference(rng):
    """A lead screw is 0.5 % longer than its drawing: the slide of a SCARA is along z at all poses."""
    kinds = ("revolute", "revolute", "prismatic")
    arm = Arm("scara", chain_from_dh(a=[325, 275, 0], alpha=[0, np.pi, 0], d=[200, 0, 0], kinds=kinds))
    angles = rng.uniform((-1.5, -1.5, 0), (1.5, 2, 200), (80, 3))
    read = angles / np.where(arm.chain.is_prismatic, 1.005, 1.0)
    points = arm.chain.tip_in_base(angles) + 0.02 * rng.normal(size=(80, 3))
    assert not ta.fit(arm, ta.Session(read, points), model="nominal").model.nominal_check_.axis_scale.is_clear


def test_a_share_that_explains_little_is_not_clear():
    sure = AxisScale("z", 0.01, 1e-5, noise_mm=0.08, noise_without_mm=0.1, log_odds=35.0)
    assert not sure.is_clear  # 36 % of the variance
    assert replace(sure, log_odds=45.0).is_clear  # nothing else does that
    assert replace(sure, noise_mm=0.07).is_clear  # 51 %


def test_of_several_sessions_the_axes_are_not_those_of_one_file(session):
    names = np.where(np.arange(len(session)) < 50, "monday", "tuesday")
    both = replace(stretched(session, "z", 0.01), session=names)
    assert ta.fit("ur10", both, model="nominal").model.nominal_check_.axis_scale is None


def problem(share, seed):
    """Residuals of random free and uncertain parts, with a known noise and a share of z."""
    rng = np.random.default_rng(seed)
    points = 300 * rng.normal(size=(40, 3))
    by_free, by_constant = rng.normal(size=(40, 3, 9)), 0.3 * rng.normal(size=(40, 3, 12))
    residuals = by_free @ rng.normal(size=9) + by_constant @ rng.normal(size=12) + 0.05 * rng.normal(size=(40, 3))
    residuals[:, 2] += share * (points[:, 2] - points[:, 2].mean())
    points += residuals  # from the tips
    return residuals, points, by_free, by_constant


def test_it_is_the_plain_generalised_least_squares_estimate():
    residuals, points, by_free, by_constant = problem(2e-3, seed=0)
    found = likeliest_axis(residuals, points, by_free, by_constant)
    K, X = by_constant.reshape(120, -1), by_free.reshape(120, -1)
    along = np.zeros((40, 3))
    tips = points - residuals
    along[:, 2] = tips[:, 2] - tips[:, 2].mean()

    def log_likelihood(noise, further):
        V = noise**2 * np.eye(120) + K @ K.T + SHARE_STD**2 * further * np.outer(along, along)
        inverse = np.linalg.inv(V)
        P = inverse - inverse @ X @ np.linalg.solve(X.T @ inverse @ X, X.T @ inverse)
        r = residuals.ravel()
        logs = np.linalg.slogdet(V)[1] + np.linalg.slogdet(X.T @ inverse @ X)[1]
        return -0.5 * (logs + r @ P @ r), P

    with_axis, without = ([log_likelihood(noise, k)[0] for noise in NOISE_MM] for k in (1, 0))
    assert (found.axis, found.noise_mm) == ("z", NOISE_MM[np.argmax(with_axis)])
    assert found.noise_without_mm == NOISE_MM[np.argmax(without)]
    assert found.log_odds == pytest.approx(max(with_axis) - max(without), abs=1e-5)  # rounding of determinants
    _, P = log_likelihood(found.noise_mm, 0)
    information = along.ravel() @ P @ along.ravel() + SHARE_STD**-2
    assert found.u == pytest.approx(information**-0.5, rel=1e-7)
    assert found.share == pytest.approx(along.ravel() @ P @ residuals.ravel() / information, rel=1e-7)


def test_planted_scales_are_within_their_uncertainty():
    off = [(found.share - 1e-3) / found.u for found in (likeliest_axis(*problem(1e-3, seed)) for seed in range(40))]
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.3  # of 40: 1 +- 0.11


def test_too_few_readings_show_none():
    residuals, points, by_free, by_constant = problem(0.0, seed=0)
    assert likeliest_axis(residuals[:6], points[:6], by_free[:6], by_constant[:6]) is None
