"""Training: MATLAB's stops one by one, its record, scaling, start and division."""

import inspect
import itertools
import time

import numpy as np
import pytest

from refusals import refuses
from truearm.nets.levenberg_marquardt import LevenbergMarquardtOptions, train_varpro, trainlm
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import ACTIVATIONS, MinMaxScaler, Perceptron, nguyen_widrow


@pytest.fixture
def wave():
    """y = sin(3 x) on [-1, 1], a 1-8-1 network and its start."""
    x = np.linspace(-1, 1, 120)[None]
    network = Perceptron.with_layers(1, (8,), 1)
    return FitProblem(network, x, np.sin(3 * x)), nguyen_widrow(network, seed=0)


def halves(problem):
    def part(start):
        columns = slice(start, None, 2)
        return FitProblem(
            problem.network,
            np.ascontiguousarray(problem.inputs[:, columns]),
            np.ascontiguousarray(problem.targets[:, columns]),
        )

    return part(0), part(1)


@pytest.fixture
def noisy(wave):
    """The wave with noise of 0.2, training and validation data taken in turn."""
    problem, _ = wave
    rng = np.random.default_rng(0)
    return halves(FitProblem(problem.network, problem.inputs, problem.targets + rng.normal(0, 0.2, (1, 120))))


# MATLAB's documented stops (mathworks.com/help/deeplearning/ref/trainlm.html), one by one ----------------------------


def test_defaults_are_matlabs():
    parameters = inspect.signature(LevenbergMarquardtOptions).parameters.values()
    assert {p.name: p.default for p in parameters if p.default is not p.empty and p.default is not None} == {
        "epochs": 1000, "goal": 0, "max_fail": 6, "min_grad": 1e-7, "mu": 1e-3, "mu_dec": 0.1, "mu_inc": 10,
        "mu_max": 1e10, "time": float("inf"), "clock": time.perf_counter,
    }  # fmt: skip


def test_stop_when_the_maximum_number_of_epochs_is_reached(wave):
    for epochs in (0, 1, 4):
        _, record = trainlm(*wave, epochs=epochs)
        assert record.stop == "Maximum epoch reached."
        assert record.num_epochs == epochs


def test_stop_when_the_maximum_amount_of_time_is_exceeded(wave):
    looks = itertools.count()
    _, record = trainlm(*wave, time=20.0, clock=lambda: float(next(looks)))  # a second passes at every look
    assert record.stop == "Maximum time elapsed."
    assert record.time[-1] >= 20 > record.time[-2]


def test_stop_when_performance_is_at_the_goal(wave):
    _, record = trainlm(*wave, goal=1e-6)
    assert record.stop == "Performance goal met."
    assert record.perf[-1] <= 1e-6 < record.perf[-2]


def test_stop_when_the_gradient_falls_below_min_grad(wave):
    _, record = trainlm(*wave, min_grad=1e-3)
    assert record.stop == "Minimum gradient reached."
    assert record.gradient[-1] <= 1e-3 < record.gradient[:-1].min()


def test_stop_when_mu_exceeds_mu_max(wave):
    """A goal of nothing on noisy data: at the minimum no step lowers the error, and mu rises to its limit."""
    training, _ = wave
    few = FitProblem(training.network, training.inputs[:, ::8], np.cos(40 * training.inputs[:, ::8]))
    weights, record = trainlm(few, wave[1], min_grad=0.0, mu_max=1e3)
    assert record.stop == "Maximum MU reached."
    assert record.mu[-1] >= 1e3 > record.mu[-2]
    assert record.perf[-1] == record.perf[-2]  # that epoch found nothing
    assert record.best_epoch == record.num_epochs - 1
    assert few.mean_square(weights) == pytest.approx(record.perf[-1], rel=1e-12)


def test_stop_when_the_validation_error_has_risen_max_fail_times(wave, noisy):
    training, validation = noisy
    for max_fail in (1, 3, 6):
        _, record = trainlm(training, wave[1], validation=validation, max_fail=max_fail)
        assert record.stop == "Validation stop."
        assert record.val_fail[-1] == max_fail > record.val_fail[-2]
        since = record.vperf[record.best_epoch + 1 :]
        assert (since > record.vperf[record.best_epoch]).sum() == max_fail


def test_stop_by_the_user(wave):
    def interrupt(epoch):
        if epoch.epoch == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        trainlm(*wave, callback=interrupt)


def test_where_several_stops_hold_the_first_in_matlabs_order_is_named(wave, noisy):
    training, validation = noisy
    everything = {"goal": 1e9, "epochs": 0, "time": 0.0, "min_grad": 1e9, "mu": 1e11}
    for name, sentence in (
        ("goal", "Performance goal met."),
        ("epochs", "Maximum epoch reached."),
        ("time", "Maximum time elapsed."),
        ("min_grad", "Minimum gradient reached."),
        ("mu", "Maximum MU reached."),
    ):
        assert trainlm(training, wave[1], validation=validation, **everything)[1].stop == sentence
        del everything[name]
    _, record = trainlm(training, wave[1], validation=validation)
    assert record.stop == "Validation stop."
    _, record = trainlm(training, wave[1], validation=validation, epochs=record.num_epochs)
    assert record.stop == "Maximum epoch reached."


# The record tr -------------------------------------------------------------------------------------------------------


def test_validation_stop_restores_the_best_weights(wave, noisy):
    _, start = wave
    training, validation = noisy
    weights, record = trainlm(training, start, validation=validation, test=validation, max_fail=6)
    assert record.stop == "Validation stop."
    assert record.val_fail[-1] == 6
    assert validation.mean_square(weights) == pytest.approx(record.vperf.min(), rel=1e-12)
    assert record.best_epoch == int(record.vperf.argmin())
    np.testing.assert_allclose(record.tperf, record.vperf)
    assert (np.diff(record.perf) < 0).all()


def test_the_record_has_an_entry_for_every_epoch(wave):
    problem, start = wave
    _, record = trainlm(problem, start, epochs=5)
    lengths = {len(getattr(record, n)) for n in ("perf", "vperf", "tperf", "mu", "gradient", "val_fail", "time")}
    assert lengths == {6}
    assert record.num_epochs == 5
    assert record.mu[0] == pytest.approx(1e-3, rel=1e-12)  # rounding
    assert np.isnan(record.vperf).all()
    # each epoch's damping is the last one's times a whole power of ten
    powers = np.log10(record.mu[1:] / record.mu[:-1])
    np.testing.assert_allclose(powers, np.round(powers), atol=1e-9)


def test_the_damping_is_added_to_the_matrix_of_the_mean_square(wave):
    """A step is ``-(J^T J / n + mu I)^-1 J^T e / n``, as MATLAB computes it for ``mse``; J by difference quotients."""
    problem, start = wave
    weights, record = trainlm(problem, start, epochs=1)
    mu, h = record.mu[1] / 0.1, 1e-6

    def errors(x):
        return problem.network.outputs(x, problem.inputs).ravel() - problem.targets.ravel()

    J = np.transpose([(errors(start + h * unit) - errors(start - h * unit)) / (2 * h) for unit in np.eye(len(start))])
    n, e = len(J), errors(start)
    step = -np.linalg.solve(J.T @ J / n + mu * np.eye(len(start)), J.T @ e / n)
    # Difference quotients are accurate to 1e-9, and mu bounds what the solution makes of that.
    np.testing.assert_allclose(weights - start, step, atol=1e-6)


def test_the_gradient_is_that_of_the_mean_square(wave):
    problem, start = wave
    _, record = trainlm(problem, start, epochs=0)
    h = 1e-6
    numeric = [
        (problem.mean_square(start + h * e) - problem.mean_square(start - h * e)) / (2 * h) for e in np.eye(len(start))
    ]
    assert record.gradient[0] == pytest.approx(np.linalg.norm(numeric), rel=1e-6)


def test_projection_needs_fewer_epochs(wave):
    problem, start = wave
    _, faithful = trainlm(problem, start, goal=1e-6, epochs=500)
    weights, ours = train_varpro(problem, start, goal=1e-6, epochs=500)
    assert ours.stop == faithful.stop == "Performance goal met."
    assert len(ours.perf) < len(faithful.perf)
    assert problem.mean_square(weights) <= 1e-6


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"goal": 0.05}, "Performance goal met."),
        ({"epochs": 3}, "Maximum epoch reached."),
        ({"time": 0.0}, "Maximum time elapsed."),
        ({"epochs": 2000}, "The cost has settled."),
    ],
)
def test_each_stop_of_projection(noisy, options, sentence):
    x, y = noisy[0].inputs, noisy[0].targets
    few = FitProblem(Perceptron.with_layers(1, (3,), 1), x, y)
    weights, record = train_varpro(few, nguyen_widrow(few.network, seed=0), **options)
    assert record.stop == sentence
    assert few.mean_square(weights) == pytest.approx(record.perf[-1], rel=1e-9)


def test_projection_with_validation_keeps_the_best(wave, noisy):
    _, start = wave
    training, validation = noisy
    weights, record = train_varpro(training, start, validation=validation, test=validation, max_fail=5)
    assert validation.mean_square(weights) == pytest.approx(record.vperf.min(), rel=1e-9)
    np.testing.assert_array_equal(record.tperf, record.vperf)


def test_training_is_repeatable(wave):
    problem, start = wave
    once, twice = (trainlm(problem, start, epochs=10)[0] for _ in range(2))
    np.testing.assert_array_equal(once, twice)


def test_mapminmax_maps_the_range_and_back():
    data = np.array([[1.0, 3, 2], [-5, 5, 0]])
    scale = MinMaxScaler.of(data, what="input")
    np.testing.assert_array_equal(scale.scale(data), [[-1, 1, 0], [-1, 1, 0]])
    np.testing.assert_allclose(scale.unscale(scale.scale(data)), data, rtol=1e-15)
    refuses("input 2 is 7 in all 3 samples", MinMaxScaler.of, np.array([[1.0, 2, 3], [7, 7, 7]]), what="input")


@pytest.mark.parametrize("name", ["tansig", "logsig", "purelin"])
def test_activations_against_difference_quotients_and_matlabs_values(name):
    activation = ACTIVATIONS[name]
    net = np.array([-700.0, -2, -0.5, 0, 0.5, 2, 700])
    h = 1e-6  # central: truncation 1e-12, rounding 1e-10
    quotient = (activation.value(net + h) - activation.value(net - h)) / (2 * h)
    np.testing.assert_allclose(activation.derivative(activation.value(net)), quotient, atol=1e-7)
    # MATLAB's documented formulas: 2/(1+exp(-2n))-1 and 1/(1+exp(-n))
    at_half = {"tansig": 2 / (1 + np.exp(-1)) - 1, "logsig": 1 / (1 + np.exp(-0.5)), "purelin": 0.5}[name]
    assert activation.value(np.array([0.5]))[0] == pytest.approx(at_half, rel=1e-14)


def test_start_spreads_active_regions_over_the_input_range():
    network = Perceptron.with_layers(2, (40, 10), 3)
    first, second, last = network.layers(nguyen_widrow(network, seed=3))
    # tansig is active for |net| < 2: weight length 0.7 S^(1/R) per unit of half the active range.
    np.testing.assert_allclose(np.linalg.norm(first[:-1], axis=0), 2 * 0.7 * 40**0.5, rtol=1e-12)
    assert np.abs(first[-1]).max() <= 2 * 0.7 * 40**0.5 + 1e-9
    # every unit's centre, where the net input is 0, is no further from the origin than the range's end
    distance = np.abs(first[-1]) / np.linalg.norm(first[:-1], axis=0)
    assert distance.max() <= 1 + 1e-12
    np.testing.assert_allclose(np.linalg.norm(second[:-1], axis=0), 2 * 0.7 * 10 ** (1 / 40), rtol=1e-12)
    assert np.abs(last).max() <= 1


def test_start_for_logsig_is_centred_on_its_outputs():
    """Inputs of the second layer lie in [0, 1]: their middle is to it what 0 is in [-1, 1]."""
    network = Perceptron.with_layers(1, (5, 4), 1, activation="logsig")
    _, second, _ = network.layers(nguyen_widrow(network, seed=1))
    middle = second[:-1].sum(axis=0) * 0.5 + second[-1]
    length = 0.7 * 4 ** (1 / 5)
    np.testing.assert_allclose(np.sort(np.abs(middle)), np.sort(np.abs(4 * length * np.linspace(-1, 1, 4))), rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Perceptron((6, 3), ()), "hidden layer"),
        (lambda: Perceptron((6, 0, 3), ("tansig",)), "sizes"),
        (lambda: Perceptron((6, 5, 3), ("relu",)), "unknown activation 'relu'. Try: tansig, logsig, purelin"),
        (lambda: Perceptron((6, 5, 3), ("tansig", "tansig")), "as many activations"),
    ],
)
def test_impossible_networks_are_refused(make, message):
    refuses(message, make)


def test_weights_travel_as_one_vector():
    network = Perceptron.with_layers(6, (30, 30), 3)
    assert network.n_weights == 7 * 30 + 31 * 30 + 31 * 3 == 1233
    weights = np.arange(1233.0)
    assert np.concatenate([W.ravel() for W in network.layers(weights)]).tolist() == weights.tolist()


@pytest.mark.parametrize("train", [train_varpro, trainlm])
def test_a_start_that_saturates_every_unit_is_no_error(wave, train):
    """Slopes of exactly zero: nothing to learn from, and no damping measured by them."""
    problem, start = wave
    start = np.concatenate([np.repeat([1e3, 5e3], 8), start[16:]])  # weights and biases of the eight hidden units
    weights, record = train(problem, start, epochs=5)
    assert np.isfinite(weights).all()
    assert np.isfinite(record.perf).all()
