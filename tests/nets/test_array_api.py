"""The same training on another library's arrays: PyTorch on the CPU stands for a GPU."""

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.nets.levenberg_marquardt import ProjectedProblem, train_varpro, trainlm
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron, nguyen_widrow
from truearm.solve.linear_algebra import as_array_like, to_numpy

torch = pytest.importorskip("torch", reason="PyTorch is an extra: pip install 'truearm[torch]'")


def both(sizes=(4, 6, 5, 3), activation="tansig", n=300):
    network = Perceptron.with_layers(sizes[0], sizes[1:-1], sizes[-1], activation=activation)
    rng = np.random.default_rng(2)
    inputs, targets = rng.uniform(-1, 1, (sizes[0], n)), rng.uniform(-1, 1, (sizes[-1], n))
    numpy = FitProblem(network, inputs, targets)
    return numpy, FitProblem(network, torch.asarray(inputs), torch.asarray(targets)), nguyen_widrow(network, seed=2)


@pytest.mark.parametrize("activation", ["tansig", "logsig", "purelin"])
@pytest.mark.parametrize("sizes", [(3, 5, 2), (4, 6, 5, 3), (2, 4, 4, 4, 1)])
def test_equations_are_the_same(sizes, activation):
    """To rounding: sums of 300 products in another order."""
    numpy, tensors, weights = both(sizes, activation)
    ours, theirs = numpy.normal_equations(weights), tensors.normal_equations(weights)
    assert torch.is_tensor(theirs.gram)
    assert isinstance(theirs.gradient, np.ndarray)
    np.testing.assert_allclose(to_numpy(theirs.gram), ours.gram, atol=1e-12 * np.abs(ours.gram).max())
    np.testing.assert_allclose(theirs.gradient, ours.gradient, atol=1e-12 * np.abs(ours.gradient).max())
    assert theirs.cost == pytest.approx(ours.cost, rel=1e-12)
    assert tensors.cost(weights) == pytest.approx(ours.cost, rel=1e-12)
    cost, gradient = tensors.gradient(weights)
    assert cost == pytest.approx(ours.cost, rel=1e-12)
    np.testing.assert_allclose(gradient, ours.gradient, atol=1e-12 * np.abs(ours.gradient).max())


def test_steps_are_the_same():
    numpy, tensors, weights = both()
    ours, theirs = numpy.normal_equations(weights), tensors.normal_equations(weights)
    step = ours.damped_step(0.1)
    np.testing.assert_allclose(theirs.damped_step(0.1), step, atol=1e-10 * np.abs(step).max())
    assert theirs.predicted_decrease(step) == pytest.approx(ours.predicted_decrease(step), rel=1e-10)
    assert theirs.damped_step(-1e6) is None


def test_projection_is_the_same():
    numpy, tensors, weights = both()
    ours, theirs = ProjectedProblem(numpy), ProjectedProblem(tensors)
    hidden = weights[: ours.n_hidden_weights]
    np.testing.assert_allclose(theirs.full_weights(hidden), ours.full_weights(hidden), atol=1e-8)
    gram = ours.normal_equations(hidden).gram
    np.testing.assert_allclose(to_numpy(theirs.normal_equations(hidden).gram), gram, atol=1e-9 * np.abs(gram).max())


@pytest.mark.parametrize("train", [train_varpro, trainlm])
def test_a_training_goes_the_same_way(train):
    """Ten epochs: rounding has grown by then, but not to a millionth of the error."""
    numpy, tensors, weights = both()
    (_, ours), (_, theirs) = (train(problem, weights, epochs=10) for problem in (numpy, tensors))
    np.testing.assert_allclose(theirs.perf, ours.perf, rtol=1e-6)


def test_vectors_are_placed_and_fetched():
    tensor = as_array_like(np.arange(3.0), torch.zeros(1, dtype=torch.float64))
    assert torch.is_tensor(tensor)
    np.testing.assert_array_equal(to_numpy(tensor), [0, 1, 2])


def test_single_precision_and_two_libraries_are_refused():
    network = Perceptron.with_layers(2, (3,), 1)
    x, y = np.zeros((2, 5)), np.zeros((1, 5))
    with pytest.raises(InputError, match=r"expected inputs of double precision .*got torch.float32.*double\(\)"):
        FitProblem(network, torch.zeros(2, 5), torch.asarray(y))
    for inputs, targets in ((torch.asarray(x), y), (x, torch.asarray(y))):
        refuses("inputs and targets of one library on one device", FitProblem, network, inputs, targets)
