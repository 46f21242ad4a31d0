"""The same training on another library's arrays: PyTorch on the CPU stands for a GPU."""

from __future__ import annotations

import numpy as np
import pytest

from truearm.nets.lm import train_lm
from truearm.nets.nguyen_widrow import nguyen_widrow
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron
from truearm.nets.trainlm import trainlm
from truearm.nets.variable_projection import ProjectedProblem
from truearm.solve.arrays import add_product, add_to_diagonal, cholesky_solved, placed_like, to_numpy, whitened

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
    np.testing.assert_allclose(theirs.completed(hidden), ours.completed(hidden), atol=1e-8)
    gram = ours.normal_equations(hidden).gram
    np.testing.assert_allclose(to_numpy(theirs.normal_equations(hidden).gram), gram, atol=1e-9 * np.abs(gram).max())


@pytest.mark.parametrize("train", [train_lm, trainlm])
def test_a_training_goes_the_same_way(train):
    """Ten epochs: rounding has grown by then, but not to a millionth of the error."""
    numpy, tensors, weights = both()
    (_, ours), (_, theirs) = (train(problem, weights, epochs=10) for problem in (numpy, tensors))
    np.testing.assert_allclose(theirs.perf, ours.perf, rtol=1e-6)


def test_products_are_added_in_place():
    rng = np.random.default_rng(0)
    total, left, right = rng.normal(size=(5, 7)), rng.normal(size=(5, 11)), rng.normal(size=(7, 11))
    expected = total + left @ right.T
    for kind in (np.array, torch.tensor):
        sums = kind(total)
        add_product(sums, kind(left), kind(right))
        np.testing.assert_allclose(to_numpy(sums), expected, atol=1e-13)
        shifted = kind(total[:, :5])
        add_to_diagonal(shifted, 2.0)
        np.testing.assert_array_equal(to_numpy(shifted), total[:, :5] + 2 * np.eye(5))


def test_cholesky_is_the_same():
    rng = np.random.default_rng(0)
    root, right = rng.normal(size=(6, 6)), rng.normal(size=(6, 2))
    matrix = root @ root.T + np.eye(6)
    for kind in (np.array, torch.tensor):
        for column in (right, right[:, 0]):
            solution = to_numpy(cholesky_solved(kind(matrix), kind(column)))
            np.testing.assert_allclose(matrix @ solution, column, atol=1e-12)
        half = to_numpy(whitened(kind(matrix), kind(right)))
        np.testing.assert_allclose(half.T @ half, right.T @ np.linalg.solve(matrix, right), atol=1e-12)
        assert cholesky_solved(kind(-matrix), kind(right)) is None
        assert whitened(kind(-matrix), kind(right)) is None


def test_vectors_are_placed_and_fetched():
    tensor = placed_like(np.arange(3.0), torch.zeros(1, dtype=torch.float64))
    assert torch.is_tensor(tensor)
    np.testing.assert_array_equal(to_numpy(tensor), [0, 1, 2])
