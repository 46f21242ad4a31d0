"""What a reading does not state of the arm's condition is in the uncertainty of its point, and is said."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.models import KinematicModel, PhysicalModel
from truearm.models.model_file import load_model
from truearm.models.refit import refit
from truearm.readings import Session
from truearm.wings.laboratory.tasks.sampled_arms import PosteriorDistribution
from truearm.wings.planning.virtual import PRESETS, VirtualArm

ARM = load_arm("gao2017")


def poses(n, seed, half_width=0.8):
    return ARM.working + half_width * np.random.default_rng(seed).uniform(-1, 1, (n, 6))


@pytest.fixture(scope="module")
def hysteretic():
    """An arm with much hysteresis (20 arc seconds, 0.1 mm at the tip) and the model of 160 readings."""
    preset = replace(
        PRESETS["perfect"], length_std_mm=0.3, angle_std_deg=0.03, hysteresis_std_arcsec=20.0, reference_std_mm=0.01
    )
    virtual = VirtualArm.draw(ARM, preset, seed=5)
    readings = virtual.measure(poses(160, 6, 0.9), seed=7).readings
    return virtual, PhysicalModel(ARM, highest=2).fit_readings(readings)


def judged(model, readings, true):
    """Root mean square of the errors over that stated, and the share of coordinates within intervals of 95 %."""
    points, covariance = model.predict_readings(readings, return_cov=True)
    off = points - true
    stated = np.diagonal(covariance, axis1=1, axis2=2)
    return np.sqrt((off**2).sum() / stated.sum()), (off**2 < 1.96**2 * stated).mean()


def test_without_directions_the_hysteresis_is_in_the_uncertainty(hysteretic):
    virtual, model = hysteretic
    met = virtual.measure(poses(200, 8), seed=9)
    knowing = met.readings.rows(np.flatnonzero((met.readings.directions != 0).all(axis=1)))
    assert "directions of movement" not in model.unstated_input_covariances(knowing)
    size, share = judged(model, replace(met.readings, directions=None), met.true_tips)
    # 200 readings whose errors are alike by what few joints do: 10 %.
    assert size == pytest.approx(1.0, abs=0.2)
    # Each joint errs by one of two numbers, without tails: intervals may hold more than of Gaussian errors.
    assert share >= 0.93


def test_unknown_directions_are_the_tips_half_way_apart_joint_by_joint(hysteretic):
    """Of readings of which each knows other joints, in more than one chunk; one reading alone is the same."""
    _, model = hysteretic
    angles, directions = poses(700, 1), np.random.default_rng(2).integers(-1, 2, (700, 6)).astype(float)
    found = model.unstated_input_covariances(Session(angles, directions=directions))["directions of movement"]
    expected = np.zeros((700, 3, 3))
    for joint in range(6):
        ahead, back = directions.copy(), directions.copy()
        unknown = directions[:, joint] == 0
        ahead[unknown, joint], back[unknown, joint] = 1.0, -1.0
        both = [model.predict_readings(Session(angles, directions=way)) for way in (ahead, back)]
        half = np.where(unknown[:, None], both[0] - both[1], 0.0) / 2
        expected += half[:, :, None] * half[:, None]
    assert expected.max() > 1e-4
    # To first order in motions of 4e-4 rad; half a difference lacks the second, and the third is 1e-7 of it.
    off = {"rtol": 0, "atol": 1e-7 * expected.max()}
    np.testing.assert_allclose(found, expected, **off)
    assert not found[(directions != 0).all(axis=1)].any()
    alone = model.unstated_input_covariances(Session(angles[:1], directions=directions[:1]))["directions of movement"]
    np.testing.assert_allclose(alone, expected[:1], **off)


def test_without_a_temperature_or_load_its_training_variance_counts(tmp_path):
    """Base and tip as drawn; the arm grows by 20 ppm/K, and its load turns J1 by 0.1 mrad a newton metre."""
    rng = np.random.default_rng(3)

    def drawn(n, seed):
        angles, load, warm = poses(n, seed), rng.normal(2.0, 1.0, n), 24 + rng.normal(0, 3.0, n)
        turned = angles.copy()
        turned[:, 0] += 1e-4 * load
        growth = 1 + 2e-5 * (warm - 20)
        true = growth[:, None] * ARM.chain.tip_in_base(turned)
        return angles, true, warm, load

    angles, true, warm, load = drawn(200, 1)
    readings = Session(
        angles, true + rng.normal(0, 0.01, true.shape), temperature_degC=warm, columns={"load_1_Nm": load}
    )
    model = PhysicalModel(ARM, free=(), highest=1).fit_readings(readings)
    assert model.training_.temperature_degC.variance == pytest.approx(warm.var())
    assert model.training_.columns["load_1_Nm"].variance == pytest.approx(load.var())
    angles, true, warm, load = drawn(300, 2)
    known = {"temperature_degC": warm, "columns": {"load_1_Nm": load}}
    assert model.unstated_input_covariances(Session(angles, **known)) == {}
    model.save(tmp_path / "m")
    again = load_model(tmp_path / "m")
    for missing in ({"temperature_degC"}, {"columns"}, {"temperature_degC", "columns"}):
        lacking = Session(angles, **{name: value for name, value in known.items() if name not in missing})
        assert len(model.unstated_input_covariances(lacking)) == len(missing)
        size, share = judged(model, lacking, true)
        # Standard deviations of 200 and of 300: 6 %. The uncertainty allows for links behind the thermometer, which
        # these are not: a growth larger by up to a third, of a temperature whose scatter is 3 K.
        assert 0.6 < size < 1.15
        assert share > 0.91
        for name, part in model.unstated_input_covariances(lacking).items():
            np.testing.assert_array_equal(again.unstated_input_covariances(lacking)[name], part)


def test_a_model_without_such_terms_misses_nothing(real):
    rng = np.random.default_rng(1)
    model = KinematicModel(real.arm).fit_readings(real.points(40, rng, temperature_degC=20 + rng.normal(size=40)))
    assert model.training_.temperature_degC.variance > 0
    assert model.unstated_input_covariances(Session(real.arm.working[None])) == {}


def test_hysteresis_turns_with_the_side_of_a_feature_in_a_task_unless_directions_are_given(hysteretic):
    _, model = hysteretic
    assert not model.hysteresis_.any()  # it has terms
    angles, up = poses(20, 4), np.tile([0.0, 0.0, 1.0], (20, 1))
    told, from_below, from_above = (
        PosteriorDistribution(model, 0.0, directions_given=given, approach=side * up)
        for given, side in ((True, 1), (False, 1), (False, -1))
    )
    assert not told.hysteresis(angles).any()
    # As much by each joint as `predict` states of one reading. The base is as drawn: the frames are nearly parallel.
    each = from_below.hysteresis(angles)
    expected = model.unstated_input_covariances(Session(angles))["directions of movement"]
    found = np.einsum("jni,jnk->nik", each, each)
    assert np.abs(found - expected).max() < 0.01 * np.trace(expected, axis1=1, axis2=2).max()
    # The same at every point of an arm that is reached from one side, and the opposite from the other side.
    expected = np.einsum("nj,jni->ni", from_below.directions(angles), each)
    assert np.linalg.norm(expected, axis=1).max() > 0.1  # mm
    signs = []
    for seed in range(40):
        samples = [errors.draw(seed) for errors in (told, from_below, from_above)]
        assert not any(one.random(angles, np.random.default_rng(seed)).any() for one in samples)
        _, below, above = (one.systematic(angles) for one in samples)
        half = (below - above) / 2
        signs.append(np.sign((half * expected).sum()))
        np.testing.assert_allclose(half, signs[-1] * expected, atol=1e-9)
    # Which of the two is not known: 20 of 40, and three standard deviations.
    assert abs(sum(signs)) < 20


def test_a_refitted_model_states_the_same_of_a_task(tmp_path):
    """What is unexplained and how far the posterior is to be widened belong to the arm, not to the new set-up."""
    virtual = VirtualArm.draw(ARM, PRESETS["research"], seed=5)
    model = PhysicalModel(ARM, highest=8).fit_readings(virtual.measure(poses(60, 1, 0.9), seed=7).readings)
    assert model.birge_ratio_ > 1.05
    new = refit(model, virtual.measure(poses(20, 2, 0.9), seed=8).readings)
    assert new.birge_ratio_ == model.birge_ratio_
    new.save(tmp_path / "m")
    before, after, read = (PosteriorDistribution(each) for each in (model, new, load_model(tmp_path / "m")))
    assert after.birge_ratio == before.birge_ratio == read.birge_ratio
    # The new readings may say that more is unexplained, never less.
    assert before.field_std_mm <= after.field_std_mm < 1.2 * before.field_std_mm
    assert read.field_std_mm == after.field_std_mm


def test_a_refit_without_directions_does_not_take_hysteresis_for_what_is_unexplained(hysteretic):
    """It is in the uncertainty already, where directions are not given."""
    virtual, model = hysteretic
    readings = virtual.measure(poses(30, 18), seed=19).readings
    new = refit(model, replace(readings, directions=None))
    # The readings scatter by 0.1 mm, ten times what is unexplained; of 81 degrees of freedom 8 %, three times.
    assert new.residual_std_ < 4 * model.residual_std_
    met = virtual.measure(poses(200, 8), seed=9)
    size, _ = judged(new, replace(met.readings, directions=None), met.true_tips)
    assert size == pytest.approx(1.0, abs=0.25)
