"""From four readings on a fit goes as far as they show, and every kind of reading is compared."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import truearm as ta
from truearm.errors import InputError
from truearm.wings.planning.virtual import VirtualArm, load_preset


@pytest.mark.parametrize("model", ["auto", "nominal", "kinematic", "physical"])
def test_three_readings_are_refused_with_what_to_do(model):
    with pytest.raises(InputError, match="expected at least 4 readings, got 3") as refused:
        ta.fit("ur5", ta.simulate("ur5", poses=3).session, model=model)
    assert "measure more poses" in refused.value.hint


@pytest.mark.parametrize(("n", "least", "gain"), [(4, 0.9, 1.01), pytest.param(8, 0.8, 0.6, marks=pytest.mark.weekly)])
def test_few_readings_are_fitted_as_far_as_they_show(n, least, gain):
    """Never far worse than the drawing, here at clean poses of the trained range, and covered."""
    ratios, covered = [], []
    for seed in range(3):
        found = ta.fit("ur5", ta.simulate("ur5", poses=n, seed=seed, arm_seed=seed).session)
        test = ta.simulate("ur5", poses=200, seed=seed + 100, arm_seed=seed)
        inside = np.flatnonzero(~found.model.outside_training(test.session.angles))
        at, tips = test.session.rows(inside), test.measurement.true_tips[inside]
        points, covariance = found.model.predict_readings(at, return_cov=True)
        off, of_nominal = points - tips, found.nominal.predict_readings(at) - tips
        ratios.append(np.linalg.norm(off, axis=1).mean() / np.linalg.norm(of_nominal, axis=1).mean())
        squares = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0])
        covered.append((squares < chi2.ppf(0.95, 3)).mean())
        assert found.held_out_mm is not None
        assert len(found.comparison) == 3
    assert np.exp(np.mean(np.log(ratios))) <= gain
    assert np.mean(covered) >= least


@pytest.mark.parametrize(
    "kind", ["line", *(pytest.param(one, marks=pytest.mark.weekly) for one in ("sphere", "plane"))]
)
def test_models_are_compared_on_surfaces(kind):
    """On two of each the model of the true arm wins; the errors are distances from the surface."""
    arm = ta.load_arm("ur10")
    virtual, rng = VirtualArm.draw(arm, load_preset("research"), seed=1), np.random.default_rng(1)
    n, name = 30, np.array(["A", "B"] * 15)
    centres = arm.chain.tip_in_base(arm.working + 0.3 * rng.uniform(-1, 1, (2, 6)))[np.arange(n) % 2]
    offset = rng.uniform(-80, 80, (n, 3)) * {"plane": (1, 1, 0), "line": (1, 0, 0)}.get(kind, (1, 1, 1))
    if kind == "sphere":
        offset *= 60 / np.linalg.norm(offset, axis=1, keepdims=True)
    angles = arm.working + 0.4 * rng.uniform(-1, 1, (n, 6))
    measured = virtual.measure(angles, seed=1, seat_points=centres + offset, reference=False).readings
    found = ta.fit(arm, replace(measured, **{kind: name}))
    own, nominal = found.held_out_mm
    assert found.model_name in ("kinematic", "physical")
    assert own < 0.7 * nominal
    assert found.model.held_out_.n_coordinates == (2 if kind == "line" else 1)
    assert len(found.model.held_out_.rows) == n
    assert "Mean error of a distance" in found.summary()


def test_where_nothing_can_be_held_out_the_nominal_arm_is_kept_with_a_word():
    """Four touches of one sphere: three locate no sphere."""
    arm = ta.load_arm("ur5")
    angles = arm.working + 0.2 * np.random.default_rng(0).uniform(-1, 1, (4, 6))
    found = ta.fit(arm, ta.Session(angles, sphere=np.full(4, "S")))
    assert found.model_name == "nominal"
    assert found.comparison == ()
    assert any("No reading can be held out" in remark for remark in found.remarks)
