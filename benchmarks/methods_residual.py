"""Methods of the literature on the residuals of an identified arm, for `methods.py`; tuned on the training readings."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.cluster import KMeans
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.model_selection import GroupKFold
from sklearn.multioutput import MultiOutputRegressor

from truearm.nets.levenberg_marquardt import trainbr
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron, nguyen_widrow
from truearm.typing import FloatArray, IntArray

INNER_FOLDS = 3
INNER_ROWS = 3000  # for tuning; the chosen method is fitted to all readings
GP_ROWS, GP_ROWS_FOR_SCALES = 1500, 500
SWARM, ROUNDS, PSO_ROWS = 30, 200, 1000

Regressor = Any
Maker = Callable[..., Regressor]


def tuned(make: Maker, choices: Iterable[dict[str, Any]], X: FloatArray, r: FloatArray, group: IntArray) -> Regressor:
    """Fit the choice with the smallest mean error by cross-validation within the training readings, by group."""
    rng = np.random.default_rng(0)
    rows = np.sort(rng.choice(len(X), min(INNER_ROWS, len(X)), replace=False))
    choices = list(choices)
    if len(choices) > 1:
        folds = list(GroupKFold(INNER_FOLDS).split(rows, groups=group[rows]))
        best, least = choices[0], np.inf
        for choice in choices:
            errors = [
                np.linalg.norm(make(**choice).fit(X[rows[a]], r[rows[a]]).predict(X[rows[b]]) - r[rows[b]], axis=1)
                for a, b in folds
            ]
            mean = float(np.concatenate(errors).mean())
            if mean < least:
                best, least = choice, mean
        choices = [best]
    return make(**choices[0]).fit(X, r)


@dataclass
class Ridge:
    """Ridge regression on features of standardised inputs; `features` is set up by `fit`."""

    units: int
    ridge: float

    def fit(self, X: FloatArray, r: FloatArray) -> Ridge:
        """Fit the output weights in closed form."""
        self.centre, self.spread = X.mean(axis=0), np.maximum(X.std(axis=0), 1e-6)
        Z = (X - self.centre) / self.spread
        self.prepare(Z)
        H = self.features(Z)
        self.weights = np.linalg.solve(H.T @ H + self.ridge * len(H) * np.eye(H.shape[1]), H.T @ r)
        return self

    def predict(self, X: FloatArray) -> FloatArray:
        """Predict residuals [mm]."""
        return np.asarray(self.features((X - self.centre) / self.spread) @ self.weights)

    def prepare(self, Z: FloatArray) -> None:
        """Set up the features."""
        raise NotImplementedError

    def features(self, Z: FloatArray) -> FloatArray:
        """(n, units) features."""
        raise NotImplementedError


class ExtremeLearningMachine(Ridge):
    """A hidden layer with random weights (G.-B. Huang and others, Neurocomputing 70 (2006) 489)."""

    def prepare(self, Z: FloatArray) -> None:
        """Draw the hidden layer."""
        rng = np.random.default_rng(0)
        self.inner = rng.normal(size=(Z.shape[1], self.units)) / np.sqrt(Z.shape[1])
        self.bias = rng.uniform(-1, 1, self.units)

    def features(self, Z: FloatArray) -> FloatArray:
        """(n, units) values of the hidden layer."""
        return np.asarray(np.tanh(Z @ self.inner + self.bias))


class RadialBasisNetwork(Ridge):
    """Gaussians about centres of k-means, as wide as the centres' typical distance (J. Moody, C. Darken, 1989)."""

    def prepare(self, Z: FloatArray) -> None:
        """Place the centres."""
        self.centres = KMeans(min(self.units, len(Z) // 2), n_init=1, random_state=0, max_iter=30).fit(Z)
        self.centres = self.centres.cluster_centers_
        apart = np.linalg.norm(self.centres[:, None] - self.centres[None], axis=2)
        self.width = 2 * np.median(np.sort(apart, axis=1)[:, 1])

    def features(self, Z: FloatArray) -> FloatArray:
        """(n, units) values of the Gaussians."""
        squares = (Z**2).sum(axis=1)[:, None] - 2 * Z @ self.centres.T + (self.centres**2).sum(axis=1)
        return np.asarray(np.exp(-squares / (2 * self.width**2)))


class GaussianProcess:
    """scikit-learn's process: a length scale for each input and noise by marginal likelihood, on a subset of rows."""

    def fit(self, X: FloatArray, r: FloatArray) -> GaussianProcess:
        """Find scales on `GP_ROWS_FOR_SCALES` readings, and condition on `GP_ROWS`."""
        rng = np.random.default_rng(0)
        rows = rng.permutation(len(X))[:GP_ROWS]
        self.centre, self.spread = X.mean(axis=0), np.maximum(X.std(axis=0), 1e-6)
        self.scale = float(np.sqrt((r**2).mean()))
        Z, y = (X - self.centre) / self.spread, r / self.scale
        kernel = ConstantKernel(1.0, (1e-3, 1e3)) * RBF(np.full(X.shape[1], 3.0), (0.2, 300.0))
        kernel = kernel + WhiteKernel(0.1, (1e-6, 10.0))
        few = rows[:GP_ROWS_FOR_SCALES]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a scale at its bound: an input without effect
            found = GaussianProcessRegressor(kernel, random_state=0).fit(Z[few], y[few])
        self.process = GaussianProcessRegressor(found.kernel_, optimizer=None).fit(Z[rows], y[rows])
        return self

    def predict(self, X: FloatArray) -> FloatArray:
        """Predict residuals [mm]."""
        return np.asarray(self.scale * self.process.predict((X - self.centre) / self.spread))

    def std(self, X: FloatArray) -> FloatArray:
        """(n, 3) standard deviations, noise included [mm]."""
        return np.asarray(self.scale * self.process.predict((X - self.centre) / self.spread, return_std=True)[1])


class BoostedTrees:
    """scikit-learn's histogram gradient boosting, one ensemble for each coordinate."""

    def __init__(self, **options: Any) -> None:
        self.trees = MultiOutputRegressor(HistGradientBoostingRegressor(random_state=0, **options))

    def fit(self, X: FloatArray, r: FloatArray) -> BoostedTrees:
        """Fit to all readings."""
        self.trees.fit(X, r)
        return self

    def predict(self, X: FloatArray) -> FloatArray:
        """Predict residuals [mm]."""
        return np.asarray(self.trees.predict(X))


@dataclass
class SmallNetwork:
    """One network on scaled angles: 6-15-3 by `trainbr`, or with its weights found by a particle swarm."""

    units: int = 15
    by: str = "trainbr"

    def fit(self, X: FloatArray, r: FloatArray) -> SmallNetwork:
        """Train on all readings."""
        self.middle = (X.max(axis=0) + X.min(axis=0)) / 2
        self.half = np.maximum(np.ptp(X, axis=0) / 2, 1e-6)
        self.scale = 3 * float(np.sqrt((r**2).mean()))
        self.network = Perceptron.with_layers(X.shape[1], (self.units,), 3)
        problem = FitProblem(self.network, ((X - self.middle) / self.half).T, r.T / self.scale)
        if self.by == "trainbr":
            self.weights, _ = trainbr(problem, nguyen_widrow(self.network, seed=0), epochs=100)
        else:
            self.weights = swarm_minimum(self.network, problem.inputs, problem.targets)
        return self

    def predict(self, X: FloatArray) -> FloatArray:
        """Predict residuals [mm]."""
        return np.asarray(self.scale * self.network.outputs(self.weights, ((X - self.middle) / self.half).T).T)


def swarm_minimum(network: Perceptron, inputs: FloatArray, targets: FloatArray) -> FloatArray:
    """Weights by a global-best particle swarm with constriction (M. Clerc, J. Kennedy, IEEE TEC 6 (2002) 58)."""
    rng = np.random.default_rng(0)
    rows = rng.permutation(inputs.shape[1])[:PSO_ROWS]
    x = np.stack([nguyen_widrow(network, seed=i) for i in range(SWARM)])
    v = np.zeros_like(x)

    def costs(x: FloatArray) -> FloatArray:
        return np.array([((network.outputs(one, inputs[:, rows]) - targets[:, rows]) ** 2).mean() for one in x])

    own, least = x.copy(), costs(x)
    for _ in range(ROUNDS):
        best = own[np.argmin(least)]
        pull = rng.random(x.shape) * (own - x) + rng.random(x.shape) * (best - x)
        v = 0.7298 * v + 1.49618 * pull
        x = x + v
        cost = costs(x)
        better = cost < least
        own[better], least[better] = x[better], cost[better]
    return np.asarray(own[np.argmin(least)])


CHOICES: dict[str, tuple[Maker, list[dict[str, Any]]]] = {
    "network": (SmallNetwork, [{"units": 15}]),
    "ELM": (ExtremeLearningMachine, [{"units": n, "ridge": a} for n in (50, 150, 400) for a in (1e-6, 1e-4, 1e-2)]),
    "RBF network": (RadialBasisNetwork, [{"units": n, "ridge": a} for n in (30, 100, 300) for a in (1e-6, 1e-4, 1e-2)]),
    "Gaussian process": (GaussianProcess, [{}]),
    "boosted trees": (
        BoostedTrees,
        [{"learning_rate": 0.05, "max_iter": n, "max_leaf_nodes": k} for n in (50, 200) for k in (8, 31)],
    ),
    "PSO network": (SmallNetwork, [{"units": n, "by": "swarm"} for n in (4, 8)]),
}
"""What is fitted to residuals, and between what cross-validation chooses."""
