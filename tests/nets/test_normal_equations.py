"""The factored normal equations against the dense Jacobian, and that against difference quotients."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.errors import InputError
from truearm.nets import normal_equations
from truearm.nets.levenberg_marquardt import ProjectedProblem
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron, nguyen_widrow


def dense_jacobian(network, weights, inputs):
    """(n_outputs * n, n_weights) by backpropagation of every output: the plain form."""
    values = network.forward(weights, inputs)
    layers, activations = network.layers(weights), network.activations
    n_outputs, n = values[-1].shape
    blocks = []
    D = np.broadcast_to(np.eye(n_outputs)[:, :, None], (n_outputs, n_outputs, n))  # by net input of the output layer
    for layer in range(len(layers) - 1, -1, -1):
        a = np.concatenate([values[layer], np.ones((1, n))])
        blocks.insert(0, np.einsum("in,okn->onik", a, D).reshape(n_outputs * n, -1))
        if layer:
            slope = activations[layer - 1].derivative(values[layer])
            D = np.einsum("kr,orn->okn", layers[layer][:-1], D) * slope
    return np.concatenate(blocks, axis=1)


def problem(sizes, activation, *, n=30, seed=0):
    network = Perceptron.with_layers(sizes[0], sizes[1:-1], sizes[-1], activation=activation)
    rng = np.random.default_rng(seed)
    weights = nguyen_widrow(network, seed=seed)
    return FitProblem(network, rng.uniform(-1, 1, (sizes[0], n)), rng.normal(size=(sizes[-1], n))), weights


sizes = st.lists(st.integers(1, 6), min_size=3, max_size=6)
activations = st.sampled_from(["tansig", "logsig", "purelin"])


@settings(max_examples=30)
@given(sizes, activations, st.integers(0, 1000))
def test_factored_equals_dense(sizes, activation, seed):
    fit, weights = problem(tuple(sizes), activation, seed=seed)
    J = dense_jacobian(fit.network, weights, fit.inputs)
    errors = (fit.network.outputs(weights, fit.inputs) - fit.targets).ravel()
    found = fit.normal_equations(weights)
    assert np.abs(found.gram - J.T @ J).max() <= 1e-10 * np.abs(J.T @ J).max()
    assert np.abs(found.gradient - J.T @ errors).max() <= 1e-10 * np.abs(J).max() * np.abs(errors).sum()
    assert found.cost == pytest.approx(0.5 * errors @ errors, rel=1e-12)
    assert found.cost == pytest.approx(fit.cost(weights), rel=1e-12)
    np.testing.assert_array_equal(found.gram, found.gram.T)


@pytest.mark.parametrize("activation", ["tansig", "logsig", "purelin"])
@pytest.mark.parametrize("sizes", [(2, 5, 3), (3, 4, 5, 2), (1, 3, 2, 4, 1)])
def test_dense_equals_difference_quotient(sizes, activation):
    fit, weights = problem(sizes, activation, n=5)
    J = dense_jacobian(fit.network, weights, fit.inputs)
    h = 1e-6  # central: truncation h^2 ~ 1e-12, rounding 1e-16 / h ~ 1e-10
    for p in range(len(weights)):
        step = np.zeros_like(weights)
        step[p] = h
        up, down = (fit.network.outputs(weights + sign * step, fit.inputs) for sign in (1, -1))
        np.testing.assert_allclose(J[:, p], ((up - down) / (2 * h)).ravel(), atol=2e-8)


def test_sums_do_not_depend_on_the_chunks(monkeypatch):
    fit, weights = problem((4, 7, 6, 3), "tansig", n=700)
    whole = fit.normal_equations(weights)
    monkeypatch.setattr(normal_equations, "MOST", 64)
    monkeypatch.setattr(normal_equations, "FEWEST", 64)
    pieces = fit.normal_equations(weights)
    np.testing.assert_allclose(pieces.gram, whole.gram, atol=1e-12 * np.abs(whole.gram).max())
    np.testing.assert_allclose(pieces.gradient, whole.gradient, atol=1e-11 * np.abs(whole.gradient).max())


def test_one_hand_made_neuron():
    """y = v tanh(w x + b) + c: J = [v s x, v s, t, 1] with t = tanh, s = 1 - t^2."""
    network = Perceptron.with_layers(1, (1,), 1)
    w, b, v, c, x, target = 0.7, -0.2, 1.5, 0.3, 0.9, 0.1
    t = np.tanh(w * x + b)
    row = np.array([v * (1 - t**2) * x, v * (1 - t**2), t, 1.0])
    found = FitProblem(network, np.array([[x]]), np.array([[target]])).normal_equations(np.array([w, b, v, c]))
    np.testing.assert_allclose(found.gram, np.outer(row, row), rtol=1e-14)
    np.testing.assert_allclose(found.gradient, row * (v * t + c - target), rtol=1e-14)


def test_projection_is_the_minimum_over_the_output_layer():
    fit, weights = problem((3, 5, 4, 2), "tansig", n=200)
    projected = ProjectedProblem(fit)
    hidden = weights[: projected.n_hidden_weights]
    completed = projected.full_weights(hidden)
    assert np.abs(fit.normal_equations(completed).gradient[len(hidden) :]).max() < 1e-10
    rng = np.random.default_rng(1)
    for _ in range(20):
        other = completed.copy()
        other[len(hidden) :] += 0.01 * rng.normal(size=len(completed) - len(hidden))
        assert fit.cost(other) > projected.cost(hidden)


def test_projected_gradient_equals_difference_quotient():
    fit, weights = problem((2, 4, 3, 2), "tansig", n=60)
    projected = ProjectedProblem(fit)
    hidden = weights[: projected.n_hidden_weights]
    gradient = projected.normal_equations(hidden).gradient
    h = 1e-5  # central: truncation h^2 = 1e-10, rounding 1e-16 cost / h ~ 1e-10
    for p in range(len(hidden)):
        step = np.zeros_like(hidden)
        step[p] = h
        quotient = (projected.cost(hidden + step) - projected.cost(hidden - step)) / (2 * h)
        assert gradient[p] == pytest.approx(quotient, abs=2e-7 * np.abs(gradient).max())


def test_projected_matrix_is_the_schur_complement():
    fit, weights = problem((3, 4, 3, 2), "logsig", n=100)
    projected = ProjectedProblem(fit)
    p = projected.n_hidden_weights
    J = dense_jacobian(fit.network, projected.full_weights(weights[:p]), fit.inputs)
    hidden, output = J[:, :p], J[:, p:]
    off = hidden - output @ np.linalg.lstsq(output, hidden)[0]  # columns with the output layer's space taken away
    gram = projected.normal_equations(weights[:p]).gram
    np.testing.assert_allclose(gram, off.T @ off, atol=1e-8 * np.abs(gram).max())


def test_projection_survives_hidden_units_that_are_alike():
    fit, weights = problem((2, 3, 1), "tansig", n=50)
    alike = weights.reshape(-1).copy()
    first = alike[:9].reshape(3, 3)
    first[:] = first[:, :1]
    assert np.isfinite(ProjectedProblem(fit).normal_equations(alike[:9]).gram).all()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_has_threads_of_its_own():
    """The threads of the parent's pool are not in the child, which would wait for them until the time limit."""
    script = """
import os, warnings
import numpy as np
from truearm.nets import normal_equations
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron

normal_equations.FLOPS_WORTH_THREADS = 0
rng = np.random.default_rng(0)
network = Perceptron.with_layers(2, (4,), 1)
fit = FitProblem(network, rng.uniform(-1, 1, (2, 3000)), rng.uniform(-1, 1, (1, 3000)))
weights = rng.normal(size=network.n_weights)
before = fit.normal_equations(weights)
warnings.simplefilter("ignore")  # to fork beside threads is what is tried here
child = os.fork()
if child == 0:
    os._exit(0 if (fit.normal_equations(weights).gram == before.gram).all() else 1)
assert os.waitpid(child, 0)[1] == 0
"""
    process = subprocess.Popen([sys.executable, "-c", script], start_new_session=True, stderr=subprocess.PIPE)
    try:
        _, errors = process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)  # parent and child
        raise
    assert process.returncode == 0, errors.decode()


@pytest.mark.parametrize("n", [1, 700, 5000])
@pytest.mark.parametrize("sizes", [(2, 5, 3), (6, 30, 30, 3), (2, 20, 20, 20, 1)])
def test_cost_and_equations_agree_to_the_last_bit(sizes, n):
    """Otherwise a step that changes nothing but rounding passes for one that lowers the cost."""
    fit, weights = problem(sizes, "tansig", n=n)
    assert fit.cost(weights) == fit.normal_equations(weights).cost
    projected = ProjectedProblem(fit)
    hidden = weights[: projected.n_hidden_weights]
    assert projected.cost(hidden) == projected.normal_equations(hidden).cost == fit.cost(projected.full_weights(hidden))


def test_sums_hold_no_more_at_once_however_many_the_chunks():
    """Results of chunks that are there at the same time: those of the groups, and one to be added."""
    alive = most = 0

    class Counted:
        def __init__(self):
            nonlocal alive, most
            alive += 1
            most = max(most, alive)

        def __del__(self):
            nonlocal alive
            alive -= 1

        def __add__(self, other):
            return Counted()

    fit, _ = problem((1, 1, 1), "tansig", n=5000)
    fit.summed(lambda columns: [Counted()], 10)
    assert most <= normal_equations.GROUPS + 3


def test_completed_weights_are_the_callers_own():
    fit, weights = problem((2, 4, 1), "tansig")
    projected = ProjectedProblem(fit)
    hidden = weights[: projected.n_hidden_weights]
    kept = projected.full_weights(hidden).copy()
    projected.full_weights(hidden)[:] = np.nan
    np.testing.assert_array_equal(projected.full_weights(hidden), kept)


@pytest.mark.parametrize("what", ["inputs", "targets"])
@pytest.mark.parametrize("dtype", [np.float32, np.int64, np.complex128, bool])
def test_numbers_that_are_no_doubles_are_refused(what, dtype):
    arrays = {"inputs": np.zeros((2, 5)), "targets": np.zeros((1, 5))}
    arrays[what] = arrays[what].astype(dtype)
    with pytest.raises(InputError, match=rf"expected {what} of double precision .*astype\(float\)"):
        FitProblem(Perceptron.with_layers(2, (3,), 1), **arrays)


@pytest.mark.parametrize("what", ["inputs", "targets"])
def test_what_is_no_array_is_refused(what):
    arrays = {"inputs": np.zeros((2, 5)), "targets": np.zeros((1, 5))}
    arrays[what] = arrays[what].tolist()
    with pytest.raises(InputError, match=f"expected {what} as an array of NumPy or PyTorch, got list"):
        FitProblem(Perceptron.with_layers(2, (3,), 1), **arrays)


@pytest.mark.parametrize("sizes", [(2, 4, 2), (3, 4, 3, 2)])
def test_bending_equals_differences_of_the_projected_errors(sizes):
    """J by central differences (h^2 = 1e-10), the second derivative along a short step too (its own differences reach
    a tenth of the step: (0.1 |step|)^2 / 12 of the fourth derivative, 1e-5 of it)."""
    fit, weights = problem(sizes, "tansig", n=40)
    projected = ProjectedProblem(fit)
    p = projected.n_hidden_weights
    x = weights[:p]
    step = 0.05 * np.random.default_rng(3).normal(size=p)

    def errors(x):
        return (fit.network.outputs(projected.full_weights(x), fit.inputs) - fit.targets).ravel()

    h = 1e-5
    J = np.stack([(errors(x + h * e) - errors(x - h * e)) / (2 * h) for e in np.eye(p)], axis=1)
    second = (errors(x + 0.01 * step) - 2 * errors(x) + errors(x - 0.01 * step)) / 0.01**2
    # What the output layer could take away does not count: of J only the part without it is kept.
    a = fit.network.forward(projected.full_weights(x), fit.inputs)[-2]
    A = np.concatenate([a, np.ones((1, a.shape[1]))]).T
    leaves = np.eye(len(A)) - A @ np.linalg.pinv(A)
    second = (second.reshape(sizes[-1], -1) @ leaves).ravel()
    expected = J.T @ second
    np.testing.assert_allclose(
        projected.second_directional_derivative(x, step), expected, atol=1e-3 * np.abs(expected).max()
    )
