"""Gradient descent in networks: MATLAB's defaults, steps worked out by hand, stops and records."""

import inspect
import time

import numpy as np
import pytest

from refusals import refuses
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron
from truearm.nets.traingd import AdaptiveDescentOptions, DescentOptions, traingd, traingdx


@pytest.fixture
def one_unit():
    """y = w2 (w1 x + b1) + b2 at x = 1, target 1; begun at w1 = 0.5, b1 = 0, w2 = 1, b2 = 0."""
    network = Perceptron.with_layers(1, (1,), 1, activation="purelin")
    return FitProblem(network, np.array([[1.0]]), np.array([[1.0]])), np.array([0.5, 0, 1, 0])


def test_defaults_are_matlabs():
    """mathworks.com/help/deeplearning/ref/traingd.html and traingdx.html."""

    def defaults(options):
        parameters = inspect.signature(options).parameters.values()
        return {p.name: p.default for p in parameters if p.default is not p.empty and p.default is not None}

    common = {"epochs": 1000, "goal": 0, "lr": 0.01, "max_fail": 6, "min_grad": 1e-5, "time": float("inf")}
    common |= {"clock": time.perf_counter}
    assert defaults(DescentOptions) == common
    assert defaults(AdaptiveDescentOptions) == common | {"lr_inc": 1.05, "lr_dec": 0.7, "max_perf_inc": 1.04, "mc": 0.9}


@pytest.mark.parametrize(("trainer", "options"), [(traingd, {}), (traingdx, {"mc": 0.9}), (traingdx, {"mc": 0})])
def test_the_first_step_by_hand(one_unit, trainer, options):
    """e = 0.5 - 1, so mse = 0.25 and its gradient by (w1, b1, w2, b2) is 2 e (w2, w2, h, 1) = (-1, -1, -0.5, -1)."""
    problem, start = one_unit
    weights, record = trainer(problem, start, epochs=1, lr=0.1, **options)
    np.testing.assert_allclose(weights, [0.6, 0.1, 1.05, 0.1], rtol=1e-14)
    # y = 1.05 * 0.7 + 0.1 = 0.835, e = -0.165
    np.testing.assert_allclose(record.perf, [0.25, 0.165**2], rtol=1e-14)
    # 2 e (w2, w2, h, 1) = -0.33 (1.05, 1.05, 0.7, 1)
    np.testing.assert_allclose(record.gradient, [3.25**0.5, 0.33 * 3.695**0.5], rtol=1e-14)
    assert np.isnan(record.mu).all()
    assert record.num_epochs == record.best_epoch == 1


def test_the_second_step_of_traingdx_by_hand(one_unit):
    """lr is 0.105 now; the step is 0.9 of the last, (0.1, 0.1, 0.05, 0.1), and 0.1 lr of the new gradient."""
    problem, start = one_unit
    epochs = []
    kept, record = traingdx(problem, start, epochs=2, lr=0.1, callback=epochs.append)
    new = 0.33 * np.array([1.05, 1.05, 0.7, 1])
    expected = np.array([0.6, 0.1, 1.05, 0.1]) + 0.9 * np.array([0.1, 0.1, 0.05, 0.1]) + 0.1 * 0.105 * new
    np.testing.assert_allclose(epochs[2].weights(), expected, rtol=1e-14)
    # y = 1.0974255 * 0.8872765 + 0.193465: an error of 0.1672 after 0.165, its square 2.7 % more. lr stands.
    np.testing.assert_allclose(record.lr, [0.1, 0.105, 0.105], rtol=1e-14)
    assert record.perf[2] / record.perf[1] == pytest.approx(1.0266, abs=1e-4)
    np.testing.assert_array_equal(kept, epochs[1].weights())


def test_a_refused_step_of_traingdx_by_hand(one_unit):
    """With lr = 2 the first step leads to (2.5, 2, 2, 2): y = 11, mse 100, refused; lr is 1.4. So are those that
    follow, until the rate is small enough; no weight moves before."""
    problem, start = one_unit
    _, record = traingdx(problem, start, epochs=1, lr=2.0)
    np.testing.assert_allclose(record.lr, [2.0, 1.4], rtol=1e-14)
    np.testing.assert_array_equal(record.perf, [0.25, 0.25])
    _, record = traingdx(problem, start, epochs=12, lr=2.0)
    refused = int(np.argmax(record.perf < 0.25)) - 1
    np.testing.assert_allclose(record.lr[: refused + 1], 2 * 0.7 ** np.arange(refused + 1), rtol=1e-13)
    assert record.lr[refused + 1] == pytest.approx(1.05 * record.lr[refused], rel=1e-14)


@pytest.mark.parametrize("trainer", [traingd, traingdx])
@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"goal": 0.1}, "Performance goal met."),
        ({"epochs": 2}, "Maximum epoch reached."),
        ({"time": 0.0}, "Maximum time elapsed."),
        ({"min_grad": 1.0}, "Minimum gradient reached."),
    ],
)
def test_each_stop(one_unit, trainer, options, sentence):
    problem, start = one_unit
    weights, record = trainer(problem, start, **{"lr": 0.05, "epochs": 50, **options})
    assert record.stop == sentence
    assert problem.mean_square(weights) == pytest.approx(record.perf.min(), rel=1e-12)
    if "goal" in options:
        assert record.perf[-1] <= 0.1 < record.perf[-2]
    if "min_grad" in options:
        assert record.gradient[-1] <= 1.0 < record.gradient[-2]


@pytest.mark.parametrize("trainer", [traingd, traingdx])
def test_validation_stops_and_the_best_weights_are_kept(one_unit, trainer):
    """The validation target, 0.8, is passed on the way to 1."""
    problem, start = one_unit
    validation = FitProblem(problem.network, problem.inputs, np.array([[0.8]]))
    weights, record = trainer(problem, start, validation=validation, test=validation, lr=0.01, max_fail=3)
    assert record.stop == "Validation stop."
    assert record.val_fail[-3:].tolist() == [1, 2, 3]
    assert record.best_epoch == record.num_epochs - 3 == int(record.vperf.argmin())
    assert validation.mean_square(weights) == record.vperf.min()
    np.testing.assert_array_equal(record.tperf, record.vperf)


def test_without_validation_the_best_weights_by_perf_are_kept(one_unit):
    """A rate that oscillates ever more: perf grows again, the best epoch is an early one."""
    problem, start = one_unit
    weights, record = traingd(problem, start, lr=0.45, epochs=6)
    assert record.perf[-1] > record.perf.min()
    assert record.best_epoch == int(record.perf.argmin()) < record.num_epochs
    assert problem.mean_square(weights) == pytest.approx(record.perf.min(), rel=1e-12)


def test_a_rate_too_large_says_so(one_unit):
    problem, start = one_unit
    weights, record = traingd(problem, start, lr=50.0)
    assert "the learning rate is too large" in record.stop
    assert np.isfinite(weights).all()
    assert np.isfinite(record.perf).all()


@pytest.mark.parametrize(
    ("trainer", "options"),
    [
        (traingd, {"lr": 0.0}),
        (traingd, {"lr": np.nan}),
        (traingdx, {"lr": -1.0}),
        (traingdx, {"lr_inc": 0.9}),
        (traingdx, {"lr_dec": 1.0}),
        (traingdx, {"max_perf_inc": 0.9}),
        (traingdx, {"mc": 1.0}),
        (traingdx, {"mc": np.nan}),
    ],
)
def test_options_that_can_never_be_meant_are_refused(one_unit, trainer, options):
    refuses(r"expected .*lr.* got", trainer, *one_unit, **options)
