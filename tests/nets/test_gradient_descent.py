"""Gradient descent on a parabola, every rule by hand."""

import numpy as np
import pytest

from truearm.errors import TruearmError
from truearm.nets.traingd import LearningRate, gradient_descent
from truearm.solve.stop_criteria import CostGoal, MaxEpochs, MaxSeconds, MinGradient


class Parabola:
    """x^2, summed."""

    def gradient(self, x):
        return float(x @ x), 2 * x


def descended(rate, epochs, start=(1.0,), stops=()):
    told = []
    last = gradient_descent(
        Parabola().gradient, start, rate=rate, stops=[*stops, MaxEpochs(epochs)], callback=told.append
    )
    assert told[-1] is last
    assert [state.epoch for state in told] == list(range(last.epoch + 1))
    return told


def test_steps_of_plain_descent():
    """x -> x - 0.1 * 2 x = 0.8 x."""
    told = descended(LearningRate(0.1), 3)
    np.testing.assert_allclose([state.x[0] for state in told], [1, 0.8, 0.64, 0.512], rtol=1e-15)
    np.testing.assert_allclose([state.cost for state in told], [1, 0.64, 0.4096, 0.262144], rtol=1e-15)
    np.testing.assert_allclose([state.gradient_norm for state in told], [2, 1.6, 1.28, 1.024], rtol=1e-15)
    assert [state.rate for state in told] == [0.1] * 4
    assert np.isnan(told[0].mu)


def test_momentum_carries_the_last_step_on():
    """First step -0.1 * 2; then 0.9 * -0.2 - 0.1 * 0.1 * 1.6 = -0.196; then 0.9 * -0.196 - 0.01 * 1.208."""
    told = descended(LearningRate(0.1, momentum=0.9), 3)
    np.testing.assert_allclose([state.x[0] for state in told], [1, 0.8, 0.604, 0.604 - 0.18848], rtol=1e-14)


ADAPTIVE = {"increase": 1.05, "decrease": 0.7, "max_cost_ratio": 1.04}


def test_a_lower_cost_raises_the_rate():
    """1 - 0.25 * 2 = 0.5; then 0.5 - 0.2625 * 1 = 0.2375."""
    told = descended(LearningRate(0.25, **ADAPTIVE), 2)
    np.testing.assert_allclose([state.rate for state in told], [0.25, 0.2625, 0.275625], rtol=1e-14)
    np.testing.assert_allclose([state.x[0] for state in told], [1, 0.5, 0.2375], rtol=1e-14)


def test_a_slightly_higher_cost_is_accepted_and_the_rate_is_kept():
    """1 - 1.005 * 2 = -1.01, cost 1.0201, within 4 %."""
    told = descended(LearningRate(1.005, **ADAPTIVE), 1)
    assert told[1].x[0] == pytest.approx(-1.01, rel=1e-14)
    assert told[1].rate == 1.005
    assert told[1].step_accepted


def test_a_higher_cost_is_refused_and_the_rate_and_momentum_are_cut():
    """1 - 1.05 * 2 = -1.1, cost 1.21: refused. Then 1 - 0.735 * 2 = -0.47, as a first step; then with momentum:
    0.9 * -1.47 + 0.1 * 0.77175 * 0.94."""
    told = descended(LearningRate(1.05, momentum=0.9, **ADAPTIVE), 3)
    assert (told[1].x[0], told[1].cost, told[1].step_accepted) == (1, 1, False)
    assert told[1].rate == pytest.approx(0.735, rel=1e-14)
    assert told[2].x[0] == pytest.approx(-0.47, rel=1e-14)
    assert told[2].rate == pytest.approx(0.735 * 1.05, rel=1e-14)
    # -0.47 - 1.323 + 0.0725445 = -1.72: refused too, as its cost is above 0.2209.
    assert told[3].x[0] == told[2].x[0]
    assert told[3].rate == pytest.approx(0.735 * 1.05 * 0.7, rel=1e-14)


def test_a_rate_too_large_ends_plain_descent_at_its_last_numbers():
    """x -> -199 x: after 22 epochs the cost is 1e101."""
    told = descended(LearningRate(100.0), 500)
    assert told[-1].reason.text == "The error has grown beyond all bounds: the learning rate is too large."
    assert told[-1].cost <= 1e100
    assert told[-1].epoch == 22
    assert told[-1].x[0] == told[-2].x[0]


@pytest.mark.parametrize(
    ("stop", "text"), [(CostGoal(0.3), "Performance goal met."), (MinGradient(1.1), "Minimum gradient reached.")]
)
def test_stops_are_asked_in_order_after_every_epoch(stop, text):
    told = descended(LearningRate(0.1), 50, stops=[stop])
    assert told[-1].reason.text == text
    assert told[-1].epoch == 3
    told = descended(LearningRate(0.1), 50, stops=[MaxSeconds(0.0), stop])
    assert (told[-1].reason.text, told[-1].epoch) == ("Maximum time elapsed.", 0)


def test_a_start_that_is_no_number_is_an_error():
    with pytest.raises(TruearmError, match="not a finite number"):
        gradient_descent(Parabola().gradient, [np.nan], rate=LearningRate(0.1), stops=[])


def test_the_clock_counts_the_evaluation_at_the_start():
    now = [0.0]

    class Slow(Parabola):
        def gradient(self, x):
            now[0] += 7.0
            return super().gradient(x)

    told = []
    gradient_descent(
        Slow().gradient, [1.0], rate=LearningRate(0.1), stops=[MaxEpochs(1)], callback=told.append, clock=lambda: now[0]
    )
    assert [state.seconds for state in told] == [7.0, 14.0]
