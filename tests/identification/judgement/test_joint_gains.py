"""Gains of joints: found to the noise on an arm with servos, never asked for on an arm without such errors."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm import chain_from_dh
from truearm.identification.judgement.joint_gains import identified_gains
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.terms.catalogue import JOINT_COMPLIANCE, JOINT_GAINS, gains, gravity

NOISE_MM = 1.0
GAINS = np.array([0.012, -0.03, 0.02, -0.005, 0.025])


def hobby_arm(*, upright: bool = False) -> ta.Arm:
    """Five servos, a reach of 400 mm; its links are level, or upright, where its angles are zero. It errs by cm."""
    chain = chain_from_dh(
        a=[0, 120, 120, 0, 0],
        d=[80, 0, 0, 0, 70],
        alpha=np.radians([90, 0, 0, 90, 0]),
        theta=np.radians([0, 90 * upright, 0, 90, 0]),
        tip_in_flange=[20.0, 0.0, 90.0],
    )
    return ta.Arm("hobby", chain, lower=np.full(5, -1.7), upper=np.full(5, 1.7), nominal_error_mm=20.0)


def readings(gain, *, n=60, seed=1):
    rng = np.random.default_rng(seed)
    arm = hobby_arm()
    angles = rng.uniform(-1.6, 1.6, (n + 200, 5))
    zeros = rng.normal(0, 0.01, 5)
    points = arm.chain.tip_in_base((1 + gain) * angles + zeros)
    measured = points + rng.normal(0, NOISE_MM, points.shape)
    return arm, ta.Session(angles[:n], measured[:n]), ta.Session(angles[n:], points[n:])


def has_gains(model):
    return any(term.group == JOINT_GAINS for term in model.fit_.perturbed_chain.terms)


def mean_error(model, session):
    return np.linalg.norm(model.predict(session.angles) - session.points, axis=1).mean()


def test_an_arm_with_gains_ends_at_the_noise(tmp_path):
    arm, training, test = readings(GAINS)
    result = ta.fit(arm, training, model="kinematic")
    fit = result.model.fit_
    found = {
        term.name: (fit.coefficients[columns[0]], np.sqrt(fit.covariance[columns[0], columns[0]]))
        for term, columns in zip(fit.perturbed_chain.terms, fit.perturbed_chain.columns, strict=True)
        if term.group == JOINT_GAINS
    }
    for joint in (2, 3, 4):  # the first and the last trade with base and tip
        value, std = found[f"J{joint} gain"]
        assert abs(value - GAINS[joint - 1]) < 4 * std < 0.02
    assert mean_error(result.model, test) < NOISE_MM  # of 3 coordinates the noise is 1.6 mm
    (found,) = identified_gains(fit)
    assert found in result.findings
    assert "J2 by -3" in str(found)
    assert round(found.numbers["J2_percent"]) == -3
    sent = ta.correct(result.model, training.angles[2:5] / 2)
    assert not sent.refused.any(), sent.reasons
    exported = ta.export(result.model, tmp_path / "m.json")  # which reads the file again at its check poses
    assert exported.format == "json"


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.weekly)])
def test_an_arm_without_gains_has_none(seed):
    arm, training, _ = readings(np.zeros(5), seed=seed)
    assert not has_gains(ta.KinematicModel(arm).fit_readings(training))


def test_joints_that_give_way_have_no_gains_in_a_model_that_bends():
    """Upright links lean, and their joints give way in proportion: a gain of a rigid arm, and none of a soft one."""
    arm = hobby_arm(upright=True)
    angles = np.random.default_rng(4).uniform(-1.0, 1.0, (60, 5))
    exact = ta.Session(angles, arm.chain.tip_in_base(angles))
    state = PreparedReadings.of(arm, exact, None, free=("base", "tip"), robust=True).state
    sag = np.zeros_like(angles)
    for joint in (2, 3):
        (term,) = (one for one in gravity(arm.chain, joint) if one.group == JOINT_COMPLIANCE)
        torque = term.basis.values(state)[0]
        sag[:, joint - 1] = 0.03 * torque / np.abs(torque).max()
    points = arm.chain.tip_in_base(angles + sag) + np.random.default_rng(5).normal(0, 0.3, (60, 3))
    soft = ta.Session(angles, points)
    assert has_gains(ta.KinematicModel(arm).fit_readings(soft))
    assert not has_gains(ta.PhysicalModel(arm, highest=4).fit_readings(soft))
    assert has_gains(ta.PhysicalModel(hobby_arm(), highest=4).fit_readings(readings(GAINS)[1]))


@pytest.mark.parametrize("preset", ["research", "worn"])
def test_a_measuring_arm_has_none(preset):
    session = ta.simulate("gao2017", poses=60, preset=preset, seed=2, strategy="uniform").session
    assert not has_gains(ta.KinematicModel(ta.load_arm("gao2017")).fit_readings(session))


ALL_JOINTS = "all joints turn by {} times their stated angles: that is a unit or a factor of all angles"


@pytest.mark.parametrize(
    ("factor", "hint"),
    [
        (0.9, "the angles may be in gon, 400 a turn: truearm import --angle-unit gon"),
        (1 / 0.9, "the angles may be in deg, stated in gon: truearm import --angle-unit deg"),
        pytest.param(1 / 1.02, "multiplied by 0.980 they fit the drawing", marks=pytest.mark.weekly),
        (1 / 0.985, "multiplied by 1.015 they fit the drawing"),  # the nominal arm misses by what arms may miss
    ],
)
def test_one_gain_of_all_joints_is_no_gain_of_servos(factor, hint):
    arm = replace(ta.load_arm("ur10"), lower=None, upper=None)
    session = ta.simulate(arm, poses=60, preset="research", seed=2, strategy="uniform").session
    scaled = ta.Session(session.angles / factor, session.points)
    caught = refuses(ALL_JOINTS.format(f"{factor:.3f}"), ta.KinematicModel(arm).fit_readings, scaled)
    assert hint in caught.hint
    assert ("gon" in hint) == ("gon" in caught.hint)
    if "gon" in hint:
        with ta.accepting("the encoder is of another gear"):
            assert has_gains(ta.KinematicModel(arm).fit_readings(scaled))


def test_gon_are_named_by_the_doctor_and_refused_by_a_fit_without_gains():
    session = ta.simulate("gao2017", poses=20, preset="research", seed=2, strategy="uniform").session
    in_gon = ta.Session(session.angles / 0.9, session.points)
    assert str(ta.diagnose("gao2017", in_gon)).startswith("all angles are in gon, stated in deg: ")
    refuses(ALL_JOINTS.format("0.900"), ta.fit, "gao2017", in_gon, model="nominal")


@pytest.mark.parametrize(
    "gain",
    [
        [0.012, 0.03, 0.02, 0.005, 0.025],  # all of one sign
        [0.02, 0.02, 0.02, 0.028, 0.012],  # as servos of one make
        [0.03, 0.03, -0.03, 0.03, 0.03],  # one is mounted the other way round
    ],
)
def test_servos_that_differ_are_fitted(gain):
    arm, training, test = readings(np.array(gain))
    model = ta.KinematicModel(arm).fit_readings(training)
    assert has_gains(model)
    assert mean_error(model, test) < NOISE_MM


def test_gains_are_of_joints_that_turn_and_moved():
    arm, training, _ = readings(GAINS)
    still = replace(training, angles=training.angles * [1, 1, 0, 1, 1])
    prepared = PreparedReadings.of(arm, still, None, free=("base", "tip"), robust=True)
    assert [term.name for term in gains(prepared.state)] == ["J1 gain", "J2 gain", "J4 gain", "J5 gain"]
    assert all(term.basis.values(prepared.state).mean() == pytest.approx(0, abs=1e-3) for term in gains(prepared.state))
