"""What all trainers share: what they refuse, what they tell, how data are divided."""

import numpy as np
import pytest

from refusals import refuses
from truearm.nets.levenberg_marquardt import train_varpro, trainbr, trainlm
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron, nguyen_widrow
from truearm.nets.traingd import traingd, traingdx
from truearm.nets.training import dividerand

TRAINERS = [train_varpro, trainlm, trainbr, traingd, traingdx]
NETWORK = Perceptron.with_layers(1, (4,), 1)


@pytest.fixture
def wave():
    """y = sin(3 x) and a start: training, validation and test data taken in turn."""
    x = np.linspace(-1, 1, 60)[None]
    parts = [FitProblem(NETWORK, x[:, k::3].copy(), np.sin(3 * x[:, k::3])) for k in range(3)]
    return parts, nguyen_widrow(NETWORK, seed=0)


@pytest.mark.parametrize("trainer", TRAINERS)
def test_every_epoch_is_told_once_its_validation_error_is_known(wave, trainer):
    (training, validation, test), start = wave
    told = []
    weights, record = trainer(
        training, start, validation=validation, test=test, epochs=7, callback=lambda e: told.append((e, e.weights()))
    )
    epochs = [epoch for epoch, _ in told]
    assert [epoch.epoch for epoch in epochs] == list(range(record.num_epochs + 1))
    for name, values in (("seconds", record.time), *((n, getattr(record, n)) for n in ("perf", "vperf", "mu"))):
        np.testing.assert_array_equal([getattr(epoch, name) for epoch in epochs], values)
    np.testing.assert_array_equal([epoch.gradient for epoch in epochs], record.gradient)
    np.testing.assert_array_equal([epoch.val_fail for epoch in epochs], record.val_fail)
    assert (np.diff(record.time) >= 0).all()
    for k, (_, w) in enumerate(told):
        assert training.mean_square(w) == pytest.approx(record.perf[k], rel=1e-9)
        assert validation.mean_square(w) == pytest.approx(record.vperf[k], rel=1e-12)
        assert test.mean_square(w) == pytest.approx(record.tperf[k], rel=1e-12)
    np.testing.assert_array_equal(weights, told[record.best_epoch][1])


@pytest.mark.parametrize("trainer", TRAINERS)
def test_nothing_of_the_training_can_be_changed_through_what_it_tells(wave, trainer):
    (training, validation, _), start = wave
    before = start.copy()
    weights, _ = trainer(training, start, validation=validation, epochs=4)

    def spoil(epoch):
        epoch.weights()[:] = np.nan

    np.testing.assert_array_equal(trainer(training, start, validation=validation, epochs=4, callback=spoil)[0], weights)
    np.testing.assert_array_equal(start, before)


@pytest.mark.parametrize("trainer", TRAINERS)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": np.zeros(12)}, r"expected 13 start weights for a 1-4-1 network, got shape \(12,\)"),
        ({"weights": np.zeros((13, 1))}, "got shape"),
        ({"weights": np.full(13, np.nan)}, "start weights that are finite"),
        ({"validation": "other"}, "expected validation data of the network in training"),
        ({"test": "other"}, "expected test data of the network in training"),
        ({"epochs": -1}, "expected epochs as a whole number of 0 or more, got -1"),
        ({"epochs": 2.5}, "expected epochs as a whole number"),
        ({"goal": -1e-9}, "expected goal of 0 or more"),
        ({"goal": np.nan}, "expected goal of 0 or more, got nan"),
        ({"time": -1.0}, "expected time of 0 or more"),
        ({"max_fail": 0}, "expected max_fail as a whole number of 1 or more, got 0"),
        ({"min_grad": np.nan}, "expected min_grad of 0 or more"),
    ],
)
def test_what_can_never_be_meant_is_refused(wave, trainer, change, message):
    if (trainer is trainbr and "max_fail" in change) or (trainer is train_varpro and "min_grad" in change):
        return  # they have no such option
    (training, *_), start = wave
    other = FitProblem(Perceptron.with_layers(1, (5,), 1), training.inputs, training.targets)
    options = {"weights": start} | {k: other if isinstance(v, str) else v for k, v in change.items()}
    refuses(message, trainer, training, **options)


@pytest.mark.parametrize("trainer", TRAINERS)
def test_samples_on_another_librarys_arrays_train_alike(wave, trainer):
    torch = pytest.importorskip("torch", reason="PyTorch is an extra: pip install 'truearm[torch]'")
    (training, validation, _), start = wave

    def moved(problem):
        return FitProblem(NETWORK, torch.asarray(problem.inputs), torch.asarray(problem.targets))

    weights, record = trainer(training, start, validation=validation, epochs=4)
    there, record_there = trainer(moved(training), start, validation=moved(validation), epochs=4)
    assert isinstance(there, np.ndarray)
    np.testing.assert_allclose(there, weights, rtol=1e-6, atol=1e-8)  # rounding, grown over four steps
    np.testing.assert_allclose(record_there.vperf, record.vperf, rtol=1e-6)


@pytest.mark.parametrize("trainer", TRAINERS)
@pytest.mark.parametrize("n", [1, 2, 5])
def test_more_weights_than_errors_still_train(wave, trainer, n):
    (training, *_), start = wave
    few = FitProblem(NETWORK, training.inputs[:, :n].copy(), training.targets[:, :n].copy())
    weights, record = trainer(few, start, epochs=10)
    assert np.isfinite(weights).all()
    assert record.perf[record.best_epoch] <= record.perf[0]


def test_dividerand_divides_everything_once():
    train, validation, test = dividerand(101, seed=5)
    assert sorted([*train, *validation, *test]) == list(range(101))
    assert (len(validation), len(test)) == (15, 15)
    assert [len(part) for part in dividerand(30, seed=5)] == [20, 5, 5]  # 4.5 is rounded up, as in MATLAB
    everything, none, none_too = dividerand(10, train=1, validation=0, test=0, seed=5)
    assert len(everything) == 10
    assert len(none) == len(none_too) == 0
    refuses("no samples remain", dividerand, 3, train=0, validation=1, test=0, seed=0)
    refuses("shares", dividerand, 3, train=-1, seed=0)
