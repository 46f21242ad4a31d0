"""The constrained draw of geometry, taken to first order and along chords, is that of exact motions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from truearm.arm.catalogue import load_arm
from truearm.wings.planning.virtual import PRESETS, VirtualArm
from truearm.wings.planning.virtual.arm import TESTS, _test_of, box_sample, to_mean
from truearm.wings.planning.virtual.error_model import draw_geometry
from truearm.wings.planning.virtual.state import random_stream

RESEARCH = PRESETS["research"]


def errors_of_nominal(arm: VirtualArm) -> np.ndarray:
    """In the box of the constraint, (m, 3) [mm], pose by pose from the drawing and the true function."""
    width = np.radians(RESEARCH.constraint_half_width_deg)
    angles = box_sample(arm.nominal, TESTS * RESEARCH.constraint_poses, half_width_rad=width)
    return arm.true_tip(angles) - arm.nominal.chain.tip_in_base(angles)


@pytest.mark.parametrize(("name", "seed"), [("gao2017", 0), ("measuring7", 7)])
def test_the_draw_kept_is_one_of_the_stream_at_the_scale_that_a_root_finder_gives(name, seed):
    arm = VirtualArm.draw(load_arm(name), RESEARCH, seed=seed)
    kept = arm.systematic.geometry
    stream = random_stream("arm", seed, "geometry")
    for _ in range(1000):
        drawn = draw_geometry(arm.nominal.chain, RESEARCH, stream)
        scale = (drawn * kept).sum() / (drawn * drawn).sum()
        if np.abs(kept - scale * drawn).max() < 1e-12:
            break
    else:
        pytest.fail("none of 1000 draws")

    def excess(scale: float) -> float:
        scaled = VirtualArm(arm.nominal, RESEARCH, arm.systematic.with_geometry(scale * drawn), seed)
        return float(np.abs(errors_of_nominal(scaled)).mean()) - RESEARCH.nominal_mean_mm

    # Three digits a round, from three: 1e-9, and some for arms that bend the errors more.
    assert scale == pytest.approx(brentq(excess, 0.5 * scale, 2 * scale, xtol=1e-13), rel=1e-8)
    maxima = np.abs(errors_of_nominal(arm)).reshape(TESTS, -1).max(axis=1)
    assert np.abs(maxima - RESEARCH.nominal_max_mm).max() <= RESEARCH.nominal_max_tolerance_mm + 1e-8


def test_an_arm_is_that_of_its_seed_whatever_was_drawn_before():
    """What is kept from draw to draw serves the same drawing and preset again, and no other, to the last bit."""
    arm, warm = load_arm("gao2017"), replace(RESEARCH, temperature_degC=RESEARCH.temperature_degC + 10)
    draws = [(arm, RESEARCH, 1), (arm, RESEARCH, 2), (arm, RESEARCH, 1), (arm, warm, 1), (load_arm("ur5"), warm, 1)]
    _test_of.cache_clear()
    kept = [VirtualArm.draw(nominal, preset, seed=seed).systematic.geometry for nominal, preset, seed in draws]
    assert (_test_of.cache_info().hits, _test_of.cache_info().misses) == (2, 3)
    for (nominal, preset, seed), constants in zip(draws, kept, strict=True):
        _test_of.cache_clear()
        np.testing.assert_array_equal(VirtualArm.draw(nominal, preset, seed=seed).systematic.geometry, constants)
    assert (kept[1] != kept[0]).any()
    assert (kept[3] != kept[0]).any()


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.99), st.integers(1, 4))
def test_scaled_errors_have_the_mean_asked_for(seed, share, k):
    rng = np.random.default_rng(seed)
    others, geometric = rng.standard_normal(40), 10.0 ** rng.uniform(-3, 3) * rng.standard_normal((k, 40))
    others *= share / np.abs(others).mean()
    scale, errors = to_mean(others, geometric, 1.0)
    assert (scale > 0).all()
    # The last step is 1e-6 of the scale at most, and may cross kinks by as much: 1e-12 for each.
    assert np.abs(errors).mean(axis=1) == pytest.approx(np.ones(k), abs=1e-9)
    assert errors == pytest.approx(others + scale[:, None] * geometric, abs=1e-12)


def test_errors_that_are_too_large_without_geometry_leave_numbers_all_the_same():
    rng = np.random.default_rng(0)
    scale, errors = to_mean(2.0 + rng.random(40), rng.standard_normal((3, 40)), 1.0)
    assert np.isfinite(scale).all()
    assert np.isfinite(errors).all()
