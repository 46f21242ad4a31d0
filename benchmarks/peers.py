"""The side of other packages: runs in a Python that has them, and reads a task; needs NumPy alone besides.

    PYTHON benchmarks/peers.py PEER TASK.npz [GOAL LIMIT]

prints the answer as JSON. pybotics and robotkinecal solve the tasks of ``python -m benchmarks calibration_peers``, the
others those of ``trainer``: each is called as its documentation says, in float64, from the same start weights, on the
same samples. The clock stands still while an error is evaluated: that is nobody's time.
"""

from __future__ import annotations

import copy
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Task:
    """What to train and how it is judged.

    Attributes
    ----------
    sizes : (layers,) array
        Units of every layer: tanh in the hidden ones, a linear output.
    inputs, targets : (units, n) array
        Samples in columns, scaled to [-1, 1].
    test_inputs, test_targets : (units, m) array
        Samples to judge by, in the same scale.
    unit : (outputs,) array
        What an output of 1 is in the unit of the error.
    squared : bool
        Whether the error is the mean square (in squared units), not the mean of absolute values.
    start : (weights,) array
        Start weights: of each layer W (inputs + 1, outputs), row by row, the bias in the last row.
    """

    sizes: np.ndarray
    inputs: np.ndarray
    targets: np.ndarray
    test_inputs: np.ndarray
    test_targets: np.ndarray
    unit: np.ndarray
    squared: bool
    start: np.ndarray

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Shapes of the layers' W."""
        return [(int(m) + 1, int(n)) for m, n in zip(self.sizes[:-1], self.sizes[1:], strict=True)]

    def layers(self, weights: np.ndarray) -> list[np.ndarray]:
        """The layers' W as views into the vector of weights."""
        ends = np.cumsum([m * n for m, n in self.shapes])
        return [part.reshape(shape) for part, shape in zip(np.split(weights, ends[:-1]), self.shapes, strict=True)]

    def error(self, weights: np.ndarray) -> float:
        """Mean error of a coordinate on the test samples."""
        values, layers = self.test_inputs, self.layers(weights)
        for number, W in enumerate(layers, start=1):
            values = W[:-1].T @ values + W[-1][:, None]
            if number < len(layers):
                np.tanh(values, out=values)
        errors = self.unit[:, None] * (values - self.test_targets)
        return float(np.mean(errors**2 if self.squared else np.abs(errors)))


class Over(Exception):
    """The training may stop: its goal or its limit is reached."""


@dataclass(frozen=True)
class Curve:
    """How a training went.

    Attributes
    ----------
    seconds, errors : list of float
        Time of training and error after every epoch, the start first where the trainer shows it.
    end : str
        Why it ended.
    """

    seconds: list[float]
    errors: list[float]
    end: str

    @property
    def epochs(self) -> int:
        """Epochs seen."""
        return len(self.errors)

    def seconds_to(self, error: float) -> float | None:
        """Time to the first error at or below `error`, or None."""
        return next((s for s, e in zip(self.seconds, self.errors, strict=True) if e <= error), None)

    def best_by(self, seconds: float) -> float | None:
        """The smallest error up to a time, or None where no epoch was done by then."""
        return min((e for s, e in zip(self.seconds, self.errors, strict=True) if s <= seconds), default=None)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


@dataclass
class Watch:
    """Keeps time and errors of one training, and ends it.

    Parameters
    ----------
    task : Task
    goal : float
        An error at or below it ends the training.
    limit : float
        So does so much time of training [s].
    """

    task: Task
    goal: float
    limit: float
    _seconds: list[float] = field(default_factory=list)
    _errors: list[float] = field(default_factory=list)
    _trained: float = 0.0
    _since: float = 0.0

    def run(self, train: Callable[[Watch], str]) -> Curve:
        """Train until it is over; `train` calls `epoch` after each of its epochs and says why it stopped by itself."""
        self._since = time.perf_counter()
        try:
            end = train(self)
        except Over as over:
            end = str(over)
        return Curve(self._seconds, self._errors, end)

    def epoch(self, weights: Callable[[], np.ndarray]) -> None:
        """Stop the clock, evaluate the error of the weights, let the clock go on."""
        self._trained += time.perf_counter() - self._since
        error = self.task.error(weights())
        if not np.isfinite(error):
            raise Over("diverged")
        self._seconds.append(self._trained)
        self._errors.append(error)
        if error <= self.goal:
            raise Over("goal")
        if self._trained >= self.limit:
            raise Over("limit")
        self._since = time.perf_counter()

    def in_time(self) -> None:
        """For loops inside an epoch that need not end: stop at the limit."""
        if self._trained + time.perf_counter() - self._since > self.limit:
            raise Over("limit")

    def restart(self) -> None:
        """Forget the time so far: what came before was not training (imports, a compiler's work)."""
        self._trained, self._since = 0.0, time.perf_counter()


# Trainers of networks -------------------------------------------------------------------------------------------------


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


TRAINERS: dict[str, tuple[str, Callable[[Task, Watch], str]]] = {
    "torch-lm": ("torch-levenberg-marquardt", torch_lm),
    "torch-lm, as published": ("torch-levenberg-marquardt", torch_lm_published),
    "optimistix": ("optimistix", optimistix_lm),
    "pyrenn": ("pyrenn", pyrenn_lm),
    "scikit-learn L-BFGS": ("scikit-learn", sklearn_lbfgs),
}


def trained(name: str, task: Task, goal: float, limit: float) -> dict[str, Any]:
    """The curve of a trainer."""
    package, train = TRAINERS[name]
    return {"version": version(package), **Watch(task, goal, limit).run(lambda watch: train(task, watch)).as_dict()}


# Calibration of robots ------------------------------------------------------------------------------------------------


def pybotics(task: dict[str, np.ndarray]) -> dict[str, Any]:
    """Fit the six joint offsets, test them."""
    from pybotics.optimization import OptimizationHandler, compute_absolute_errors, optimize_accuracy
    from pybotics.robot import Robot
    from scipy.optimize import least_squares

    n_train, angles, positions = int(task["n_train"]), task["angles"], task["positions"]
    robot = Robot.from_parameters(task["table"])
    sought = np.zeros(task["table"].shape, dtype=bool)
    sought[:, 2] = True  # theta
    handler = OptimizationHandler(robot, kinematic_chain_mask=sought.ravel())
    start = handler.generate_optimization_vector()
    begun = time.perf_counter()
    result = least_squares(optimize_accuracy, start, args=(handler, angles[:n_train], positions[:n_train]))
    seconds = time.perf_counter() - begun
    handler.apply_optimization_vector(result.x)
    errors = compute_absolute_errors(angles[n_train:], positions[n_train:], handler.robot)
    return {
        "version": version("pybotics"),
        "seconds": seconds,
        "evaluations": int(result.nfev),
        "jacobians": int(result.njev),
        "offsets_rad": (result.x - start).tolist(),
        "test_mean_mm": float(errors.mean()),
    }


def robotkinecal(task: dict[str, np.ndarray]) -> dict[str, Any]:
    """Identify the screws and the flange of a Panda, predict the test poses."""
    import roboticstoolbox as rtb
    from robotkinecal import SerialRobotKineCal
    from spatialmath import SE3

    np.random.seed(0)  # noqa: NPY002 - the bases of its parameters are drawn by the global generator
    peer = SerialRobotKineCal(rtb.models.Panda(), "panda_link8")
    seen = list(task["points"])
    if task["full"]:
        seen = [SE3.Rt(R, point, check=False) for R, point in zip(task["R"], task["points"], strict=True)]
    peer.set_observations(list(task["angles"]), seen)
    said = StringIO()
    begun, begun_cpu = time.perf_counter(), time.process_time()
    with redirect_stdout(said):
        result = peer.solve()
    seconds, cpu_seconds = time.perf_counter() - begun, time.process_time() - begun_cpu
    told = re.search(r"rank of regressor is (\d+)/(\d+)", said.getvalue())
    return {
        "version": version("robotkinecal"),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "iterations": result.nb_iterations_executed,
        "rank": int(told[1]) if told else peer.N_PARAMS,
        "of": peer.N_PARAMS,
        "test_points": [peer.forward_kinematics(8, q).t.tolist() for q in task["test"]],
    }


CALIBRATIONS = {"pybotics": pybotics, "robotkinecal": robotkinecal}


def answer_of(python: str, peer: str, task: dict[str, Any], *limits: float) -> dict[str, Any]:
    """What a peer makes of a task in its own Python; ``{"failed": ...}`` with its last words if it cannot."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "task.npz"
        np.savez(file, **task)
        command = [python, __file__, peer, str(file), *map(str, limits)]
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        return {"failed": ran.stderr.strip().rpartition("\n")[2]}
    return json.loads(ran.stdout.strip().rpartition("\n")[2])


def main() -> None:
    """Let one peer work."""
    peer, file, *limits = sys.argv[1:]
    with np.load(file, allow_pickle=False) as arrays:
        task = {name: arrays[name] for name in arrays.files}
    if peer in CALIBRATIONS:
        answer = CALIBRATIONS[peer](task)
    else:
        answer = trained(peer, Task(**task), *map(float, limits))
    print(json.dumps(answer, allow_nan=False))


if __name__ == "__main__":
    main()
