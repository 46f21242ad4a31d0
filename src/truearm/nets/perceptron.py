"""The multilayer perceptron: layers of weights, all connected, and activation functions under MATLAB's names.

Derivatives of the functions come from their values, as a network has them at hand. Start weights are those of Nguyen
and Widrow. ``mapminmax`` scales every row onto [-1, 1], and back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
from array_api_compat import array_namespace

from truearm.errors import InputError
from truearm.solve.linear_algebra import Array, as_array_like
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class MinMaxScaler:
    """The affine map that takes `lower` to -1 and `upper` to 1, row by row.

    Attributes
    ----------
    lower, upper : (k,) array
        In the units of the data.
    """

    lower: FloatArray
    upper: FloatArray

    @classmethod
    def of(cls, data: FloatArray, *, what: str) -> Self:
        """The map of the range of `data` (k, n), samples in columns.

        Raises
        ------
        InputError
            If a row is constant: it has no range. MATLAB's ``mapminmax`` lets such a row through unscaled.
        """
        lower, upper = data.min(axis=1), data.max(axis=1)
        if not (lower < upper).all():
            row = int(np.argmin(lower < upper))
            raise InputError(
                f"{what} {row + 1} is {lower[row]:.6g} in all {data.shape[1]} samples: a network cannot learn from it",
                hint="leave it out, or collect readings in which it varies",
            )
        return cls(lower, upper)

    @property
    def half_range(self) -> FloatArray:
        """(k,) data units per scaled unit."""
        return (self.upper - self.lower) / 2

    def scale(self, data: FloatArray) -> FloatArray:
        """Data (k, n) onto [-1, 1] (beyond it for data beyond the range)."""
        return (data - (self.lower + self.half_range)[:, None]) / self.half_range[:, None]

    def unscale(self, scaled: FloatArray) -> FloatArray:
        """Scaled values (k, n) back in data units."""
        return scaled * self.half_range[:, None] + (self.lower + self.half_range)[:, None]


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


@dataclass(frozen=True)
class Activation:
    """An activation function.

    Attributes
    ----------
    value : callable
        Of the net input.
    derivative : callable
        By the net input, computed from the value.
    net_range : (float, float) or None
        Net inputs where the function is not saturated (Nguyen-Widrow); None for a linear function.
    output_range : (float, float) or None
        Values it can take; None for all.
    """

    value: Callable[[Array], Array]
    derivative: Callable[[Array], Array]
    net_range: tuple[float, float] | None
    output_range: tuple[float, float] | None


def _tanh(net: Array) -> Array:
    return array_namespace(net).tanh(net)


def _logistic(net: Array) -> Array:
    # Through tanh: no overflow for large negative net inputs.
    return 0.5 + 0.5 * _tanh(0.5 * net)


ACTIVATIONS: dict[str, Activation] = {
    "tansig": Activation(_tanh, lambda a: 1 - a * a, (-2.0, 2.0), (-1.0, 1.0)),
    "logsig": Activation(_logistic, lambda a: a * (1 - a), (-4.0, 4.0), (0.0, 1.0)),
    "purelin": Activation(lambda net: net, lambda a: array_namespace(a).ones_like(a), None, None),
}


@dataclass(frozen=True)
class Perceptron:
    """The shape of a network: ``h_0`` the inputs, ``h_{l+1} = phi_l(W_l^T [h_l; 1])``, the last layer is linear.

    Weights travel as one vector: the layers' ``W_l`` ``(n_l + 1, n_{l+1})`` one after the other, row by row, the bias
    in the last row.

    Parameters
    ----------
    sizes : tuple of int
        Units of every layer, inputs first, outputs last: ``(6, 30, 30, 3)``.
    hidden : tuple of str
        Activation of every hidden layer: tansig, logsig or purelin.

    Raises
    ------
    InputError
        If there is no hidden layer, a layer is empty, or an activation is unknown.
    """

    sizes: tuple[int, ...]
    hidden: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.sizes) < 3 or min(self.sizes) < 1:
            raise InputError(f"a network needs inputs, one or more hidden layers and outputs, got sizes {self.sizes}")
        if len(self.hidden) != len(self.sizes) - 2:
            raise InputError(f"{len(self.sizes) - 2} hidden layers need as many activations, got {list(self.hidden)}")
        for name in self.hidden:
            if name not in ACTIVATIONS:
                raise InputError(f"unknown activation {name!r}", hint=", ".join(ACTIVATIONS))

    @classmethod
    def with_layers(
        cls, n_inputs: int, hidden: Sequence[int], n_outputs: int, *, activation: str = "tansig"
    ) -> Perceptron:
        """A network with one activation in all hidden layers."""
        return cls((n_inputs, *hidden, n_outputs), (activation,) * len(hidden))

    @property
    def activations(self) -> tuple[Activation, ...]:
        """The activation of every layer of weights, the linear output layer included."""
        return tuple(ACTIVATIONS[name] for name in (*self.hidden, "purelin"))

    @property
    def shapes(self) -> tuple[tuple[int, int], ...]:
        """Shapes of the layers' ``W_l``."""
        return tuple((m + 1, n) for m, n in zip(self.sizes[:-1], self.sizes[1:], strict=True))

    @property
    def n_weights(self) -> int:
        """Number of weights and biases."""
        return sum(m * n for m, n in self.shapes)

    def layers(self, weights: Array) -> list[Array]:
        """The layers' ``W_l`` as views into the vector `weights` (n_weights,)."""
        xp, parts, start = array_namespace(weights), [], 0
        for m, n in self.shapes:
            parts.append(xp.reshape(weights[start : start + m * n], (m, n)))
            start += m * n
        return parts

    def forward(self, weights: npt.ArrayLike, inputs: Array) -> list[Array]:
        """Values of every layer, laid out (units, samples): the inputs first, the outputs last.

        Parameters
        ----------
        weights : (n_weights,) array
        inputs : (n_inputs, n) array
            Samples in columns; of NumPy or PyTorch, and so are the values.
        """
        return self.through(self.layers(as_array_like(weights, inputs)), inputs)

    def through(self, layers: Sequence[Array], inputs: Array) -> list[Array]:
        """The same from the layers' ``W_l``, which lie where the inputs do."""
        values = [inputs]
        for W, activation in zip(layers, self.activations, strict=True):
            net = W[:-1, :].T @ values[-1]
            net += W[-1, :][:, None]
            values.append(activation.value(net))
        return values

    def outputs(self, weights: npt.ArrayLike, inputs: Array) -> Array:
        """(n_outputs, n) outputs for inputs (n_inputs, n)."""
        return self.forward(weights, inputs)[-1]
