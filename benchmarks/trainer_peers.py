"""The peers' side of `trainer.py`: runs in a Python with the packages of `peers.txt`, prints a curve as JSON.

    python trainer_peers.py PEER TASK.npz GOAL LIMIT

Each peer is called as its documentation says, in float64, from the same start weights, on the same samples.
"""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np

from time_to_error import Task, Watch


def torch_network(task: Task, dtype: object) -> object:
    """The task's network in PyTorch, at its start weights."""
    import torch

    modules: list[torch.nn.Module] = []
    for W in task.layers(task.start):
        linear = torch.nn.Linear(W.shape[0] - 1, W.shape[1], dtype=dtype)
        with torch.no_grad():
            linear.weight.copy_(torch.from_numpy(W[:-1].T.copy()))
            linear.bias.copy_(torch.from_numpy(W[-1].copy()))
        modules += [linear, torch.nn.Tanh()]
    return torch.nn.Sequential(*modules[:-1])


def torch_weights(model: object) -> np.ndarray:
    """A PyTorch network's weights in our order."""
    parts = []
    for layer in model:
        if hasattr(layer, "weight"):
            weight, bias = layer.weight.detach().double().numpy(), layer.bias.detach().double().numpy()
            parts.append(np.concatenate([weight.T, bias[None]]).ravel())
    return np.concatenate(parts)


def torch_lm(task: Task, watch: Watch) -> str:
    """torch-levenberg-marquardt on all samples at once, by Cholesky: the fastest of its ways to solve."""
    import torch
    import torch_levenberg_marquardt as tlm

    model = torch_network(task, torch.float64)
    inputs, targets = (torch.from_numpy(a.T.copy()) for a in (task.inputs, task.targets))
    begin = partial(tlm.training.LevenbergMarquardtModule, loss_fn=tlm.loss.MSELoss(), solve_method="cholesky")
    begin(copy.deepcopy(model)).training_step(inputs, targets)  # the first one loads parts of PyTorch
    module, stop = begin(model), False
    watch.restart()
    while not stop:
        _, _, stop, _ = module.training_step(inputs, targets)
        watch.epoch(lambda: torch_weights(model))
    return "its damping's maximum"


def torch_lm_published(task: Task, watch: Watch) -> str:
    """The package's own example: float32, PyTorch's start weights, shuffled batches of 1000, plain solve."""
    import torch
    import torch_levenberg_marquardt as tlm

    torch.manual_seed(int(1e6 * abs(task.start[-1])))  # another start for each of the task's starts
    model = torch_network(task, torch.float32)
    for layer in model:
        if hasattr(layer, "reset_parameters"):
            layer.reset_parameters()
    inputs, targets = (torch.from_numpy(a.T.astype(np.float32)) for a in (task.inputs, task.targets))
    begin = partial(tlm.training.LevenbergMarquardtModule, loss_fn=tlm.loss.MSELoss(), solve_method="solve")
    begin(copy.deepcopy(model)).training_step(inputs[:1000], targets[:1000])  # the first one loads parts of PyTorch
    module, stop = begin(model), False
    watch.restart()
    while not stop:
        for batch in torch.randperm(len(inputs)).split(1000):
            _, _, stop, _ = module.training_step(inputs[batch], targets[batch])
        watch.epoch(lambda: torch_weights(model))
    return "its damping's maximum"


def optimistix_lm(task: Task, watch: Watch) -> str:
    """Optimistix' LevenbergMarquardt step by step, by Cholesky, which is faster here than its default, QR."""
    import equinox as eqx
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import lineax as lx
    import optimistix as optx

    inputs, targets = jnp.asarray(task.inputs), jnp.asarray(task.targets)

    def residuals(weights: jax.Array, args: object) -> tuple[jax.Array, None]:
        del args
        values, start = inputs, 0
        for number, (m, n) in enumerate(task.shapes, start=1):
            W = weights[start : start + m * n].reshape(m, n)
            values = W[:-1].T @ values + W[-1][:, None]
            values = jnp.tanh(values) if number < len(task.shapes) else values
            start += m * n
        return (values - targets).ravel(), None

    solver = optx.LevenbergMarquardt(rtol=1e-12, atol=1e-12, linear_solver=lx.Normal(lx.Cholesky()))
    weights, tags = jnp.asarray(task.start), frozenset()
    out = jax.eval_shape(residuals, weights, None)
    state = solver.init(residuals, weights, None, {}, *out, tags)
    step = eqx.filter_jit(lambda y, state: solver.step(residuals, y, None, {}, state, tags)[:2])
    jax.block_until_ready(step(weights, state)[0])
    watch.restart()
    while not bool(state.terminate):
        weights, state = step(weights, state)
        jax.block_until_ready(state.y_eval)
        watch.epoch(lambda weights=weights: np.asarray(weights))
    return "its tolerance"


def pyrenn_lm(task: Task, watch: Watch) -> str:
    """Pyrenn's train_LM; it calls RTRL for the Jacobian once at the start and after every epoch."""
    import pyrenn

    net = pyrenn.CreateNN([int(size) for size in task.sizes])
    # Its order: each layer's weights (outputs, inputs) column by column, which is ours, then the bias.
    net["w"] = task.start.copy()
    jacobian, cost = pyrenn.RTRL, pyrenn.calc_error

    def watched_jacobian(net: dict, data: dict) -> object:
        watch.epoch(lambda: net["w"])
        return jacobian(net, data)

    def watched_cost(net: dict, data: dict) -> object:
        watch.in_time()  # at a minimum it raises its damping for ever
        return cost(net, data)

    pyrenn.RTRL, pyrenn.calc_error = watched_jacobian, watched_cost
    watch.restart()
    pyrenn.train_LM(task.inputs, task.targets, net, k_max=10**6, E_stop=0.0)
    return "its end"


def sklearn_lbfgs(task: Task, watch: Watch) -> str:
    """MLPRegressor by L-BFGS, begun anew where it stops by itself, until that no longer helps."""
    from sklearn.neural_network import MLPRegressor

    class Watched(MLPRegressor):
        best, improved = np.inf, 0

        def _initialize(self, y: np.ndarray, layer_units: list[int], dtype: object) -> None:
            super()._initialize(y, layer_units, dtype)
            layers = task.layers(task.start)
            self.coefs_, self.intercepts_ = [W[:-1].copy() for W in layers], [W[-1].copy() for W in layers]

        def _loss_grad_lbfgs(self, *args: object) -> object:
            loss, gradient = super()._loss_grad_lbfgs(*args)
            if loss < self.best:
                self.best = loss
                self.improved += 1
                if self.improved % 10 == 0:  # looking each time would cost more than the training
                    watch.epoch(self.weights)
            watch.in_time()
            return loss, gradient

        def weights(self) -> np.ndarray:
            layers = zip(self.coefs_, self.intercepts_, strict=True)
            return np.concatenate([np.concatenate([W, b[None]]).ravel() for W, b in layers])

    model = Watched(
        hidden_layer_sizes=tuple(int(size) for size in task.sizes[1:-1]),
        activation="tanh",
        solver="lbfgs",
        alpha=0.0,
        tol=0.0,
        max_iter=10**7,
        max_fun=10**8,
        warm_start=True,
    )
    inputs, targets = task.inputs.T.copy(), task.targets.T.copy()
    if targets.shape[1] == 1:
        targets = targets.ravel()
    watch.restart()
    while True:
        before = model.best
        model.fit(inputs, targets)
        if model.best > before * (1 - 1e-6):
            return "no more progress"


PEERS: dict[str, tuple[str, Callable[[Task, Watch], str]]] = {
    "torch-lm": ("torch-levenberg-marquardt", torch_lm),
    "torch-lm, as published": ("torch-levenberg-marquardt", torch_lm_published),
    "optimistix": ("optimistix", optimistix_lm),
    "pyrenn": ("pyrenn", pyrenn_lm),
    "scikit-learn L-BFGS": ("scikit-learn", sklearn_lbfgs),
}


def main() -> None:
    """Train one peer."""
    peer, file, goal, limit = sys.argv[1:]
    package, train = PEERS[peer]
    task = Task.read(Path(file))
    curve = Watch(task, float(goal), float(limit)).run(lambda watch: train(task, watch))
    print(json.dumps({"version": version(package), **curve.as_dict()}, allow_nan=False))


if __name__ == "__main__":
    main()
