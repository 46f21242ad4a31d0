"""Start weights by Nguyen and Widrow: the units' active regions spread evenly over the layer's input range."""

from __future__ import annotations

import numpy as np

from truearm.nets.perceptron import Perceptron
from truearm.typing import FloatArray


def nguyen_widrow(network: Perceptron, *, seed: int) -> FloatArray:
    """Start weights for inputs in [-1, 1].

    A hidden layer of S units with R inputs gets weight vectors of random direction and length ``0.7 S^(1/R)`` and
    biases spread evenly over plus or minus that length, scaled to the activation's unsaturated range; the output
    layer gets uniform random numbers in [-1, 1]. As MATLAB's ``initnw``, whose random stream it does not share.

    Source: D. Nguyen, B. Widrow, "Improving the learning speed of 2-layer neural networks by choosing initial values of
    the adaptive weights", IJCNN 1990, vol. 3, 21-26.

    Parameters
    ----------
    network : Perceptron
    seed : int

    Returns
    -------
    (n_weights,) array
    """
    rng = np.random.default_rng([seed, *b"nguyen-widrow"])
    weights = np.empty(network.n_weights)
    input_range: tuple[float, float] | None = (-1.0, 1.0)
    for W, activation in zip(network.layers(weights), network.activations, strict=True):
        n_inputs, n_units = W.shape[0] - 1, W.shape[1]
        if activation.net_range is None or input_range is None:
            W[:] = rng.uniform(-1, 1, W.shape)
        else:
            directions = rng.uniform(-1, 1, (n_inputs, n_units))
            directions /= np.linalg.norm(directions, axis=0)
            length = 0.7 * n_units ** (1 / n_inputs)
            spread = np.linspace(-1, 1, n_units) if n_units > 1 else np.zeros(1)
            W[:-1] = length * directions
            W[-1] = length * spread * np.where(directions[0] < 0, -1, 1)
            _onto(W, input_range, activation.net_range)
        input_range = activation.output_range
    return weights


def _onto(W: FloatArray, input_range: tuple[float, float], net_range: tuple[float, float]) -> None:
    """Rescale, in place, a layer made for inputs and net inputs in [-1, 1]."""
    low, high = net_range
    W *= (high - low) / 2
    W[-1] += (high + low) / 2
    low, high = input_range
    W[-1] -= W[:-1].sum(axis=0) * (high + low) / (high - low)
    W[:-1] *= 2 / (high - low)
