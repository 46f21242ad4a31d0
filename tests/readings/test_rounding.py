"""Laws of rounding: the step of the angles is found whatever its unit, and none where there is none."""

import numpy as np
import pytest

from truearm.readings.repeats import LEAST_STEP, MOST_STEPS, _possible, _sharpened, rounding_steps

STEPS = {
    "0.1 deg": np.radians(0.1),
    "0.01 deg": np.radians(0.01),
    "a third of a degree": np.radians(1 / 3),
    "1 mrad": 1e-3,
    "14 bits": 2 * np.pi / 2**14,
    "17 bits": 2 * np.pi / 2**17,
}


@pytest.mark.parametrize("offset", [0.0, 0.1234])
@pytest.mark.parametrize("n", [40, 700])
@pytest.mark.parametrize("name", STEPS)
def test_every_step_is_found(name, n, offset, rng):
    step = STEPS[name]
    angles = offset + step * np.round(rng.uniform(-2, 2, (n, 6)) / step)
    np.testing.assert_allclose(rounding_steps(angles), step, rtol=1e-6)


@pytest.mark.parametrize("name", STEPS)
def test_counts_that_are_written_with_six_decimals_are_found(name, rng):
    step = STEPS[name]
    angles = np.radians(np.round(np.degrees(step * np.round(rng.uniform(-2, 2, (150, 6)) / step)), 6))
    np.testing.assert_allclose(rounding_steps(angles), step, rtol=1e-5)


@pytest.mark.parametrize("n", [2, 9, 12, 100, 3000])
def test_angles_that_are_not_rounded_have_no_step(n, rng):
    assert not rounding_steps(rng.uniform(-2, 2, (n, 6))).any()


def test_each_joint_has_its_own_and_that_of_a_plan_is_none(rng):
    angles = rng.uniform(-90, 90, (100, 4))
    angles[:, 0] = np.round(angles[:, 0], 2)
    angles[:, 1] = 5 * np.round(angles[:, 1] / 5)
    angles[:, 2] = 30.0
    assert np.degrees(rounding_steps(np.radians(angles))).round(9).tolist() == [0.01, 0.0, 0.0, 0.0]


def test_a_sliding_joint_has_steps_of_millimetres(rng):
    angles = np.stack([np.round(rng.uniform(0, 800, 60), 1), rng.uniform(-2, 2, 60)], axis=1)
    np.testing.assert_allclose(rounding_steps(angles, np.array([True, False])), [0.1, 0.0], rtol=1e-9)
    assert rounding_steps(5 * np.round(angles / 5), np.array([True, True])).tolist() == [0, 0]


@pytest.mark.parametrize(
    "scatter", [0.0, pytest.param(0.03, marks=pytest.mark.weekly), pytest.param(0.1, marks=pytest.mark.weekly), 0.5]
)
@pytest.mark.parametrize("n", [10, 60, 3000])
def test_only_steps_that_all_values_refuse_are_left_out_by_a_few(n, scatter, rng):
    for step in 10 ** rng.uniform(-4.5, -2, 10):
        values = np.unique(step * (np.round(rng.uniform(-2, 2, n) / step) + scatter * rng.standard_normal(n)))
        steps = np.diff(values).min() / np.arange(1, MOST_STEPS + 1)
        steps, from_first = steps[steps >= LEAST_STEP], values - values[0]
        plain = [one for one in steps if _sharpened(one, from_first)]
        assert set(plain) <= set(_possible(steps, from_first))
