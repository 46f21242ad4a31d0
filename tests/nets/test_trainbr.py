"""Bayesian regularisation: derivative, evidence at work, stops and record."""

from __future__ import annotations

import numpy as np
import pytest

from truearm.nets.nguyen_widrow import nguyen_widrow
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron
from truearm.nets.trainbr import RegularisedProblem, trainbr
from truearm.nets.trainlm import trainlm
from truearm.solve.evidence import Evidence

NOISE = 0.1


@pytest.fixture
def noisy_wave(rng):
    """sin(3 x) with noise on 60 points, a 1-20-1 network (61 weights), and 200 exact points to judge by."""
    network = Perceptron.with_layers(1, (20,), 1)
    x, judge = np.sort(rng.uniform(-1, 1, 60))[None], np.linspace(-0.95, 0.95, 200)[None]
    training = FitProblem(network, x, np.sin(3 * x) + NOISE * rng.normal(size=x.shape))
    return training, FitProblem(network, judge, np.sin(3 * judge)), nguyen_widrow(network, seed=0)


def test_gradient_against_difference_quotient(noisy_wave):
    training, _, start = noisy_wave
    problem = RegularisedProblem(training, Evidence(0.3, 40.0, 0.0))
    equations = problem.normal_equations(start)
    assert equations.cost == pytest.approx(problem.cost(start), rel=1e-12)
    h = 1e-6  # central: truncation 1e-12, rounding 1e-16 cost / h ~ 1e-8
    for p, step in enumerate(h * np.eye(len(start))):
        quotient = (problem.cost(start + step) - problem.cost(start - step)) / (2 * h)
        assert equations.gradient[p] == pytest.approx(quotient, rel=1e-5, abs=1e-4)


def test_as_many_weights_as_data_do_not_overfit(noisy_wave):
    """Sixty-one weights on sixty points: least squares follows the noise, the evidence keeps a handful in use."""
    training, judge, start = noisy_wave
    regularised, record = trainbr(training, start, epochs=300)
    least_squares, _ = trainlm(training, start, epochs=300)
    assert judge.mean_square(regularised) < (NOISE / 2) ** 2  # between the points better than they are
    assert judge.mean_square(regularised) < judge.mean_square(least_squares) / 10
    assert 3 < record.gamk[-1] < 15


def test_the_noise_is_found(noisy_wave):
    training, _, start = noisy_wave
    _, record = trainbr(training, start, epochs=300)
    assert record.beta[-1] ** -0.5 == pytest.approx(NOISE, rel=0.3)  # sixty points: 9 % at one sigma


def test_the_record_follows_matlabs_names(noisy_wave):
    training, judge, start = noisy_wave
    weights, record = trainbr(training, start, validation=judge, epochs=12)
    assert record.stop == "Maximum epoch reached."
    names = ("perf", "vperf", "tperf", "mu", "gradient", "val_fail", "time", "gamk", "ssX", "alpha", "beta")
    assert {len(getattr(record, name)) for name in names} == {13}
    assert record.mu[0] == 5e-3
    assert record.gamk[0] == 61  # as if all were in use
    assert record.ssX[0] == pytest.approx(start @ start)
    assert record.perf[-1] == pytest.approx(training.mean_square(weights))
    assert record.vperf[-1] == pytest.approx(judge.mean_square(weights))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"goal": 1.0}, "Performance goal met."),
        ({"time": 0.0}, "Maximum time elapsed."),
        ({"min_grad": 1e9}, "Minimum gradient reached."),
        ({"mu": 1e11}, "Maximum MU reached."),
    ],
)
def test_each_stop(noisy_wave, options, sentence):
    training, _, start = noisy_wave
    if "goal" in options:
        start = 0.01 * start
    assert trainbr(training, start, **options)[1].stop == sentence


def test_fewer_data_than_weights_still_train(noisy_wave):
    training, judge, start = noisy_wave
    few = FitProblem(training.network, training.inputs[:, ::4].copy(), training.targets[:, ::4].copy())
    weights, record = trainbr(few, start, epochs=200)
    assert np.isfinite(weights).all()
    assert record.gamk[-1] < 15
    assert judge.mean_square(weights) < 0.1  # the wave itself has 0.5
