"""The Gauss-Newton matrix of a perceptron without its Jacobian.

A column of the Jacobian is a product, ``dy_o / dW_l[i, k] = a_l[i] D_l[o, k]`` with ``a_l = [h_l; 1]`` and ``D_l`` the
derivative of the outputs by the net input of layer l + 1. So the matrix needs only sums over samples of products
of pairs,

    (J^T J)[(l, i, k), (m, j, r)] = sum_n a_l[i] a_m[j] G_lm[k, r],      G_lm = sum_o D_l[o, k] D_m[o, r],

in which the outputs are summed before the samples. Diagonal blocks are symmetric in (i, j) and in (k, r): only the
upper triangles of both are multiplied. Samples go in chunks; the sums over chunks are exact, so that memory does not
grow with the data.

Chunks are dealt to a fixed number of groups, which threads work off while the BLAS keeps to one thread each: the
result does not depend on how many threads there are.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.nets.perceptron import Perceptron
from truearm.solve import NormalEquations
from truearm.solve.threads import cores, one_blas_thread

FloatArray = npt.NDArray[np.float64]

# Samples multiplied together: the pairs of a 50-50 block then fill about 5 MB, which a cache of a few MB a core
# streams well, while the matrix products are long enough to run at full speed.
CHUNK = 256
# Each group holds sums as large as the matrix itself.
GROUPS = 4


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Least squares of a network's outputs against targets.

    Parameters
    ----------
    network : Perceptron
    inputs : (n_inputs, n) array
        Scaled inputs, samples in columns.
    targets : (n_outputs, n) array
        Scaled targets.
    """

    network: Perceptron
    inputs: FloatArray
    targets: FloatArray

    @property
    def n_errors(self) -> int:
        """Number of residuals: outputs times samples."""
        return self.targets.size

    def cost(self, x: FloatArray) -> float:
        """Half the sum of squared errors at weights `x` (n_weights,)."""
        total = 0.0
        for columns in _chunks(self.inputs.shape[1], 8 * CHUNK):
            errors = self.network.outputs(x, self.inputs[:, columns]) - self.targets[:, columns]
            total += float(np.vdot(errors, errors))
        return total / 2

    def mean_square(self, x: FloatArray) -> float:
        """MATLAB's ``mse`` of the scaled outputs."""
        return 2 * self.cost(x) / self.n_errors

    def normal_equations(self, x: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton matrix at weights `x` (n_weights,)."""
        chunks = list(_chunks(self.inputs.shape[1], CHUNK))
        groups = [chunks[start::GROUPS] for start in range(min(GROUPS, len(chunks)))]
        with one_blas_thread(), ThreadPoolExecutor(min(cores(), len(groups))) as pool:
            first, *others = pool.map(lambda group: self._sums(x, group), groups)
        for other in others:
            first.merge(other)
        return first.equations()

    def _sums(self, x: FloatArray, chunks: list[slice]) -> _Sums:
        sums, layers = _Sums(self.network), self.network.layers(x)
        for columns in chunks:
            values = self.network.forward(x, np.ascontiguousarray(self.inputs[:, columns]))
            sums.add(layers, values, values[-1] - self.targets[:, columns])
        return sums


class _Sums:
    """Sums over samples of a network's gradient and of the products of pairs that make its Gauss-Newton matrix."""

    def __init__(self, network: Perceptron) -> None:
        self.network = network
        self.cost = 0.0
        self.gradients = [np.zeros(shape) for shape in network.shapes]
        depth = len(network.shapes)
        self.blocks: dict[tuple[int, int], FloatArray | float] = {
            (low, high): 0.0 for high in range(depth) for low in range(high + 1)
        }

    def add(self, layers: list[FloatArray], values: list[FloatArray], errors: FloatArray) -> None:
        """Add a chunk: `values` of every layer (units, m) and output `errors` (n_outputs, m)."""
        self.cost += 0.5 * float(np.vdot(errors, errors))
        with_bias = [np.concatenate([h, np.ones((1, h.shape[1]))]) for h in values[:-1]]
        slopes = [
            activation.derivative(value)
            for activation, value in zip(self.network.activations[:-1], values[1:-1], strict=True)
        ]
        self._add_gradients(layers, with_bias, slopes, errors)
        self._add_output_blocks(layers, with_bias, slopes)
        self._add_hidden_blocks(layers, with_bias, slopes)

    def _add_gradients(
        self, layers: list[FloatArray], with_bias: list[FloatArray], slopes: list[FloatArray], errors: FloatArray
    ) -> None:
        back = errors
        for layer in range(len(layers) - 1, -1, -1):
            self.gradients[layer] += with_bias[layer] @ back.T
            if layer:
                back = slopes[layer - 1] * (layers[layer][:-1] @ back)

    def _add_output_blocks(
        self, layers: list[FloatArray], with_bias: list[FloatArray], slopes: list[FloatArray]
    ) -> None:
        """Blocks with the output layer, where D is the unit matrix and G_l,last = D_l^T."""
        last = len(layers) - 1
        n_outputs = layers[last].shape[1]
        self.blocks[last, last] += with_bias[last] @ with_bias[last].T
        # D transposed, (units, outputs, m), from the last hidden layer down.
        D = layers[last][:-1, :, None] * slopes[last - 1][:, None, :]
        for layer in range(last - 1, -1, -1):
            pairs = (with_bias[layer][:, None, :] * with_bias[last][None, :, :]).reshape(-1, D.shape[2])
            self.blocks[layer, last] += pairs @ D.reshape(-1, D.shape[2]).T
            if layer:
                carried = layers[layer][:-1] @ D.reshape(D.shape[0], -1)
                D = carried.reshape(-1, n_outputs, D.shape[2]) * slopes[layer - 1][:, None, :]

    def _add_hidden_blocks(
        self, layers: list[FloatArray], with_bias: list[FloatArray], slopes: list[FloatArray]
    ) -> None:
        """Blocks of hidden layers, G by recursion from the last one down."""
        last = len(layers) - 1
        W = layers[last][:-1]
        outer = W @ W.T
        m = slopes[0].shape[1]
        for high in range(last - 1, -1, -1):
            if high == last - 1:
                G = outer[:, :, None] * slopes[high][:, None, :]
                G *= slopes[high][None, :, :]
            else:
                # The diagonal G of the layer below from the one above: both sides go through the layer between.
                W_up = layers[high + 1][:-1]
                half = (W_up @ G.reshape(G.shape[0], -1)).reshape(-1, G.shape[1], m)
                G = np.matmul(W_up, half) * slopes[high][:, None, :]
                G *= slopes[high][None, :, :]
            self.blocks[high, high] += _upper_products(with_bias[high]) @ _upper(G).T
            across = G
            for low in range(high - 1, -1, -1):
                W_between = layers[low + 1][:-1]
                across = (W_between @ across.reshape(across.shape[0], -1)).reshape(-1, across.shape[1], m)
                across *= slopes[low][:, None, :]
                pairs = (with_bias[low][:, None, :] * with_bias[high][None, :, :]).reshape(-1, m)
                self.blocks[low, high] += pairs @ across.reshape(-1, m).T

    def merge(self, other: _Sums) -> None:
        """Add what another group of chunks came to."""
        self.cost += other.cost
        for gradient, more in zip(self.gradients, other.gradients, strict=True):
            gradient += more
        for block, sums in other.blocks.items():
            self.blocks[block] += sums

    def equations(self) -> NormalEquations:
        """The normal equations of all that was added."""
        shapes = self.network.shapes
        starts = np.cumsum([0, *(m * n for m, n in shapes)])
        gram = np.empty((starts[-1], starts[-1]))
        for (low, high), sums in self.blocks.items():
            rows = slice(starts[low], starts[low + 1])
            columns = slice(starts[high], starts[high + 1])
            block = self._block(low, high, np.asarray(sums))
            gram[rows, columns] = block
            if low != high:
                gram[columns, rows] = block.T
        return NormalEquations(self.cost, np.concatenate([g.ravel() for g in self.gradients]), gram)

    def _block(self, low: int, high: int, sums: FloatArray) -> FloatArray:
        """Products of pairs (i, j) x (k, r) put in the order of the weights, (i, k) x (j, r)."""
        (n_i, n_k), (n_j, n_r) = self.network.shapes[low], self.network.shapes[high]
        last = len(self.network.shapes) - 1
        if low == high == last:
            return np.asarray(np.kron(sums, np.eye(n_k)), dtype=float)
        if low == high:
            full = sums[_symmetric_index(n_i).ravel()[:, None], _symmetric_index(n_k).ravel()[None, :]]
        else:
            full = sums
        return np.asarray(full.reshape(n_i, n_j, n_k, n_r).transpose(0, 2, 1, 3).reshape(n_i * n_k, n_j * n_r))


def _upper_products(a: FloatArray) -> FloatArray:
    """Products ``a[i] a[j]``, i <= j, of the rows of `a` (k, m): (k (k + 1) / 2, m)."""
    k, m = a.shape
    out = np.empty((k * (k + 1) // 2, m))
    start = 0
    for i in range(k):
        np.multiply(a[i], a[i:], out=out[start : start + k - i])
        start += k - i
    return out


def _upper(G: FloatArray) -> FloatArray:
    """The upper triangle of `G` (k, k, m), row by row: (k (k + 1) / 2, m)."""
    k, _, m = G.shape
    out = np.empty((k * (k + 1) // 2, m))
    start = 0
    for i in range(k):
        out[start : start + k - i] = G[i, i:]
        start += k - i
    return out


def _symmetric_index(k: int) -> npt.NDArray[np.intp]:
    """(k, k) where a pair, in either order, stands in the upper triangle laid out row by row."""
    index = np.zeros((k, k), dtype=np.intp)
    rows, columns = np.triu_indices(k)
    index[rows, columns] = index[columns, rows] = np.arange(len(rows))
    return index


def _chunks(n: int, size: int) -> Iterator[slice]:
    for start in range(0, n, size):
        yield slice(start, min(start + size, n))
