"""The Gauss-Newton matrix of a perceptron without its Jacobian.

A column of the Jacobian is a product, ``dy_o / dW_l[i, k] = a_l[i] D_l[o, k]`` with ``a_l = [h_l; 1]`` and ``D_l`` the
derivative of the outputs by the net input of layer l + 1. So the matrix needs only sums over samples of products
of pairs,

    (J^T J)[(l, i, k), (m, j, r)] = sum_n a_l[i] a_m[j] G_lm[k, r],      G_lm = sum_o D_l[o, k] D_m[o, r],

in which the outputs are summed before the samples. Three things make the sums small:

- diagonal blocks are symmetric in (i, j) and in (k, r): only the upper triangles of both are multiplied;
- between layers ``G_lm[k, r] = phi'_r sum_q W_m+1[r, q] G_l,m+1[k, q]``, from ``G_l,last = D_l^T`` down;
- at the last hidden layer ``D[o, k] = W[k, o] s[k]`` with slopes s: the weights W are the same for every sample and are
  multiplied in after the sum, so that only the pairs ``s[k] s[r]``, or s alone, are summed.

Samples go in chunks, so that memory does not grow with them. Chunks are dealt to a fixed number of groups, which
threads work off while the BLAS keeps to one thread each: the result does not depend on how many threads there are.

The samples may be arrays of NumPy or of PyTorch, on a GPU for instance; weights and gradients are NumPy vectors.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache, reduce
from typing import Any, NamedTuple, TypeVar

import numpy as np
from array_api_compat import array_namespace, device, is_numpy_array, is_torch_array

from truearm.errors import InputError
from truearm.nets.perceptron import Perceptron
from truearm.solve.least_squares_problem import NormalEquations
from truearm.solve.linear_algebra import Array, add_product, as_array_like, to_numpy
from truearm.solve.threads import cores, one_blas_thread
from truearm.typing import FloatArray, IntArray

P = TypeVar("P")
T = TypeVar("T")

# Bytes of the pairs that are multiplied together. In main memory they then stay near a core while the products are
# long enough for full speed; a GPU wants few large calls.
CHUNK_BYTES = 5 * 2**20
CHUNK_BYTES_ELSEWHERE = 2**28
FEWEST, MOST = 128, 1024  # samples of a chunk
# Each group holds sums about as large as a third of the matrix.
GROUPS = 4
VALUES_OF_A_PART = 8  # of a layer, whose rows of the matrix a thread fills in at a time
FLOPS_WORTH_THREADS = 2 * 10**8


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Least squares of a network's outputs against targets.

    Parameters
    ----------
    network : Perceptron
    inputs : (n_inputs, n) array
        Scaled inputs, samples in columns: doubles, of NumPy or PyTorch.
    targets : (n_outputs, n) array
        Scaled targets.

    Raises
    ------
    InputError
        If the shapes do not fit the network, there are no samples, a number is not finite or not a double, or inputs
        and targets are not of one library on one device.
    """

    network: Perceptron
    inputs: Array
    targets: Array
    # As many as threads were at work at once.
    _spaces: list[_Space] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        sizes = self.network.sizes
        for what, array, rows in (("inputs", self.inputs, sizes[0]), ("targets", self.targets, sizes[-1])):
            if not (is_numpy_array(array) or is_torch_array(array)):
                raise InputError(
                    f"expected {what} as an array of NumPy or PyTorch, got {type(array).__name__}",
                    hint="numpy.asarray(values, dtype=float)",
                )
            if array.ndim != 2 or array.shape[0] != rows or array.shape[1] < 1:
                raise InputError(
                    f"expected {what} of shape ({rows}, n), samples in columns, for a network of sizes {sizes}, got "
                    f"{tuple(array.shape)}"
                )
            xp = array_namespace(array)
            if array.dtype != xp.float64:
                raise InputError(
                    f"expected {what} of double precision (float64), got {array.dtype}: training would stall far above "
                    "the error it can reach",
                    hint="convert them: values.astype(float) in NumPy, values.double() in PyTorch",
                )
            if not bool(xp.all(xp.isfinite(array))):
                sample = int(xp.argmin(xp.astype(xp.all(xp.isfinite(array), axis=0), xp.int8)))
                raise InputError(f"expected finite {what}, got NaN or infinity in sample {sample + 1}")
        if is_numpy_array(self.inputs) != is_numpy_array(self.targets) or device(self.inputs) != device(self.targets):
            raise InputError(
                "expected inputs and targets of one library on one device, got "
                f"{type(self.inputs).__name__} on {device(self.inputs)} and {type(self.targets).__name__} on "
                f"{device(self.targets)}",
                hint="place the targets where the inputs are",
            )
        if self.inputs.shape[1] != self.targets.shape[1]:
            raise InputError(
                f"expected as many inputs as targets, got {self.inputs.shape[1]} and {self.targets.shape[1]} samples"
            )

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.inputs.shape[1])

    @property
    def n_errors(self) -> int:
        """Number of residuals: outputs times samples."""
        return int(self.targets.shape[0]) * self.n

    def cost(self, x: FloatArray) -> float:
        """Half the sum of squared errors at weights `x` (n_weights,): that of the normal equations, to the last bit.

        A step that changes nothing but rounding is then never taken for one that lowers the cost.
        """
        layers = self.network.layers(as_array_like(x, self.inputs))

        def squares(columns: slice) -> tuple[float]:
            errors = self.network.through(layers, self.inputs[:, columns])[-1] - self.targets[:, columns]
            return (float((errors * errors).sum()),)

        (total,) = self.summed(squares, self.chunk)
        return float(total) / 2

    def mean_square(self, x: FloatArray) -> float:
        """MATLAB's ``mse`` of the scaled outputs."""
        return 2 * self.cost(x) / self.n_errors

    def gradient(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Cost and its gradient (n_weights,) at weights `x` (n_weights,): a step of backpropagation."""
        layers = self.network.layers(as_array_like(x, self.inputs))

        def part(columns: slice) -> list[Any]:
            passed = _Pass(self.network, layers, self.inputs[:, columns], self.targets[:, columns])
            return [passed.cost, *passed.gradients(passed.errors)]

        cost, *gradients = self.summed(part)
        return cost, _as_vector(gradients)

    def backpropagate(self, x: FloatArray, outputs: Callable[[slice, Array], Array]) -> FloatArray:
        """``J^T v`` (n_weights,) at weights `x` (n_weights,).

        `outputs` gives v (n_outputs, m) of a chunk of samples from its slice and from what the output layer weighs, the
        values of the last hidden layer and ones.
        """
        layers = self.network.layers(as_array_like(x, self.inputs))

        def part(columns: slice) -> list[Array]:
            passed = _Pass(self.network, layers, self.inputs[:, columns], self.targets[:, columns])
            return passed.gradients(outputs(columns, passed.with_bias[-1]))

        return _as_vector(list(self.summed(part)))

    def normal_equations(self, x: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton matrix at weights `x` (n_weights,)."""
        layers = self.network.layers(as_array_like(x, self.inputs))

        def sums_of(group: list[slice]) -> _Sums:
            sums = _Sums(self.network, layers)
            try:
                space = self._spaces.pop()
            except IndexError:  # asked first, another thread may take the last one in between
                space = _Space()
            for columns in group:
                sums.add(self.inputs[:, columns], self.targets[:, columns], space)
            self._spaces.append(space)
            return sums

        first, *others = self.by_thread(sums_of, self._groups(self.chunk))
        while others:
            first.merge(others.pop(0))
        return first.equations(self.by_thread)

    def summed(self, work: Callable[[slice], Sequence[Any]], chunk: int | None = None) -> Sequence[Any]:
        """What `work` makes of chunks of samples, numbers or arrays, each added up; threads share the chunks.

        A chunk has `chunk` samples; by default as many as arithmetic without pairs of values is fast with.
        """
        size = chunk or (MOST if is_numpy_array(self.inputs) else self.chunk)
        groups = self.by_thread(lambda group: reduce(_added, map(work, group)), self._groups(size))
        return reduce(_added, groups)

    def _groups(self, size: int) -> list[list[slice]]:
        """Chunks of `size` samples, dealt to groups: the order of the sums, whatever the threads."""
        chunks = [slice(start, min(start + size, self.n)) for start in range(0, self.n, size)]
        return [chunks[start::GROUPS] for start in range(min(GROUPS, len(chunks)))]

    def by_thread(self, work: Callable[[P], T], parts: Sequence[P]) -> list[T]:
        """What `work` makes of every part, threads sharing them; in order."""
        # Other libraries have threads, or a GPU, of their own. Threads that do little hinder one another: each has to
        # wait for the interpreter after every array operation.
        with one_blas_thread():
            if len(parts) == 1 or not is_numpy_array(self.inputs) or self._flops < FLOPS_WORTH_THREADS:
                return [work(part) for part in parts]
            return list(_threads(cores()).map(work, parts))

    @property
    def _flops(self) -> int:
        """Of the products of pairs in one evaluation of the matrix."""
        return 2 * self.n * sum(left * right for left, right in (block.rows for block in _blocks(self.network)))

    @property
    def chunk(self) -> int:
        """Samples of a chunk: it depends on the network alone, and so does the order of the sums."""
        rows = max(sum(block.rows) for block in _blocks(self.network))
        if is_numpy_array(self.inputs):
            return int(np.clip(CHUNK_BYTES // (8 * rows), FEWEST, MOST))
        return max(CHUNK_BYTES_ELSEWHERE // (8 * rows), FEWEST)


@cache
def _threads(n: int) -> ThreadPoolExecutor:
    """Threads kept between evaluations: those of a small network are shorter than a thread's start."""
    return ThreadPoolExecutor(n, thread_name_prefix="samples")


if hasattr(os, "register_at_fork"):
    # A forked process has the pool, but none of its threads: work would wait for them for ever.
    os.register_at_fork(after_in_child=_threads.cache_clear)


class _Pass:
    """A chunk of samples through the network and back."""

    def __init__(self, network: Perceptron, layers: list[Array], inputs: Array, targets: Array) -> None:
        self.layers = layers
        self.last = len(layers) - 1
        xp = array_namespace(inputs)
        # A row of ones below the values of every layer, so that their products need no second look at the bias.
        ones = xp.ones((1, inputs.shape[1]), dtype=inputs.dtype, device=device(inputs))
        *values, outputs = network.through(layers, inputs)
        self.with_bias = [xp.concat([h, ones]) for h in values]
        self.slopes = [
            activation.derivative(h) for activation, h in zip(network.activations[:-1], values[1:], strict=True)
        ]
        self.errors = outputs - targets
        self.cost = 0.5 * float((self.errors * self.errors).sum())

    def gradients(self, back: Array) -> list[Array]:
        """``J^T`` times `back` (n_outputs, m), layer by layer: of the errors, the gradient of the cost."""
        found = []
        for layer in range(self.last, -1, -1):
            found.append(self.with_bias[layer] @ back.T)
            if layer:
                back = self.slopes[layer - 1] * (self.layers[layer][:-1, :] @ back)
        return found[::-1]

    def derivatives(self) -> list[Array]:
        """D of every hidden layer, (n_outputs, units, m): derivatives of the outputs by its net inputs."""
        found = [self.layers[self.last][:-1, :].T[:, :, None] * self.slopes[self.last - 1][None, :, :]]
        for layer in range(self.last - 1, 0, -1):
            found.append((self.layers[layer][:-1, :] @ found[-1]) * self.slopes[layer - 1][None, :, :])
        return found[::-1]


@dataclass(frozen=True)
class _Block:
    """A block of the matrix, layers low <= high, as the sum over samples of ``left @ right^T``."""

    low: int
    high: int
    rows: tuple[int, int]
    """Pairs of values on the left, pairs of derivatives on the right."""


def _blocks(network: Perceptron) -> list[_Block]:
    """The blocks with a hidden layer; that of the output layer with itself is the Gram matrix of its inputs."""
    shapes = network.shapes
    last = len(shapes) - 1
    found = []
    for high, (n_j, n_r) in enumerate(shapes):
        for low, (n_i, n_k) in enumerate(shapes[: min(high + 1, last)]):
            if low == high:
                rows = (n_i * (n_i + 1) // 2, n_k * (n_k + 1) // 2)
            elif high == last:
                rows = (n_i * n_j, n_k if low == last - 1 else n_k * n_r)
            else:
                rows = (n_i * n_j, n_k * n_r)
            found.append(_Block(low, high, rows))
    return found


class _Space:
    """Pairs of a chunk, written into the same arrays every time: fresh memory costs more than to multiply."""

    def __init__(self) -> None:
        self.arrays: dict[tuple[str, tuple[int, ...]], Array] = {}

    def products(self, a: Array, b: Array) -> Array:
        """Products ``a[i] b[j]`` of the rows of `a` (k, m) and `b` (l, m): (k l, m)."""
        (k, m), length = a.shape, b.shape[0]
        xp, out = array_namespace(a), self._array("pairs", (k * length, m), a)
        for i in range(k):
            xp.multiply(a[i, :], b, out=out[i * length : (i + 1) * length, :])
        return out

    def upper_products(self, what: str, D: Array) -> Array:
        """``sum_o D[o, k] D[o, r]``, k <= r, row by row, for D (o, k, m): (k (k + 1) / 2, m)."""
        n_outputs, k, m = D.shape
        xp, out, start = array_namespace(D), self._array(what, (k * (k + 1) // 2, m), D), 0
        for i in range(k):
            rows = out[start : start + k - i, :]
            if n_outputs == 1:
                xp.multiply(D[0, i, :], D[0, i:, :], out=rows)
            else:
                _sum_of_products(D[:, i, :], D[:, i:, :], rows)
            start += k - i
        return out

    def between(self, high: int, W: Array, G: Array, slopes: Array) -> Array:
        """``slopes[r] sum_q W[r, q] G[q, k]`` for every sample: (r, k, m) from W (r, q) and G (q, k, m)."""
        xp, out = array_namespace(G), self._array(f"between {high}", (W.shape[0], *G.shape[1:]), G)
        xp.matmul(W, xp.reshape(G, (G.shape[0], -1)), out=xp.reshape(out, (W.shape[0], -1)))
        out *= slopes[:, None, :]
        return out

    def _array(self, what: str, shape: tuple[int, ...], like: Array) -> Array:
        if (what, shape) not in self.arrays:
            self.arrays[what, shape] = array_namespace(like).empty(shape, dtype=like.dtype, device=device(like))
        return self.arrays[what, shape]


class _Sums:
    """Sums over samples of a network's gradient and of the products of pairs that make its Gauss-Newton matrix."""

    def __init__(self, network: Perceptron, layers: list[Array]) -> None:
        self.network, self.layers = network, layers
        self.last = len(layers) - 1
        self.cost = 0.0
        xp, where = array_namespace(layers[0]), device(layers[0])

        def zeros(shape: tuple[int, ...]) -> Array:
            return xp.zeros(shape, dtype=xp.float64, device=where)

        self.gradients = [zeros(shape) for shape in network.shapes]
        self.blocks = {(block.low, block.high): zeros(block.rows) for block in _blocks(network)}
        n_last = network.shapes[-1][0]
        self.blocks[self.last, self.last] = zeros((n_last, n_last))

    def add(self, inputs: Array, targets: Array, space: _Space) -> None:
        """Add a chunk: `inputs` (n_inputs, m) and `targets` (n_outputs, m), with `space` for its pairs."""
        passed = _Pass(self.network, self.layers, inputs, targets)
        self.cost += passed.cost
        for gradient, more in zip(self.gradients, passed.gradients(passed.errors), strict=True):
            gradient += more
        last, a, s, D = self.last, passed.with_bias, passed.slopes, passed.derivatives()
        add_product(self.blocks[last, last], a[last], a[last])
        for low in range(last):
            own = space.upper_products("values", a[low][None, ...])
            if low == last - 1:
                add_product(self.blocks[low, last], space.products(a[low], a[last]), s[low])
                add_product(self.blocks[low, low], own, space.upper_products("derivatives", s[low][None, ...]))
                continue
            add_product(self.blocks[low, last], space.products(a[low], a[last]), _rows(D[low]))
            add_product(self.blocks[low, low], own, space.upper_products("derivatives", D[low]))
            G = D[low]  # (units above, units of low, m)
            for high in range(last - 1, low, -1):
                G = space.between(high, self.layers[high + 1][:-1, :], G, s[high])
                add_product(self.blocks[low, high], space.products(a[low], a[high]), _rows(G))

    def merge(self, other: _Sums) -> None:
        """Add what another group of chunks came to."""
        self.cost += other.cost
        for gradient, more in zip(self.gradients, other.gradients, strict=True):
            gradient += more
        for block, sums in other.blocks.items():
            self.blocks[block] += sums

    def equations(self, by_thread: Callable[[Callable[[_Part], None], Sequence[_Part]], list[None]]) -> NormalEquations:
        """The normal equations of all that was added; its sums are used up. `by_thread` maps a function over parts."""
        shapes = self.network.shapes
        starts = np.cumsum([0, *(m * n for m, n in shapes)])
        xp, where = array_namespace(self.layers[0]), device(self.layers[0])
        gram = xp.empty((int(starts[-1]), int(starts[-1])), dtype=xp.float64, device=where)
        parts: list[_Part] = []
        for low, high in sorted(self.blocks):
            sums = self.blocks.pop((low, high))
            if low == high == self.last:  # the product of a matrix with itself is symmetric but for rounding
                sums = 0.5 * (sums + sums.T)
            rows = slice(int(starts[low]), int(starts[low + 1]))
            columns = slice(int(starts[high]), int(starts[high + 1]))
            mirrored = gram[columns, rows] if low != high else None
            n_i = shapes[low][0]
            for first in range(0, n_i, VALUES_OF_A_PART):
                values = range(first, min(first + VALUES_OF_A_PART, n_i))
                parts.append(_Part(low, high, sums, gram[rows, columns], mirrored, values))
        by_thread(self._fill, parts)
        return NormalEquations(self.cost, _as_vector(self.gradients), gram)

    def _fill(self, part: _Part) -> None:
        """Put sums of pairs (i, j) x (k, r) in the order of the weights, (i, k) x (j, r), for some of the values i."""
        low, high, sums, block, mirrored, values = part
        (n_i, n_k), (n_j, n_r) = self.network.shapes[low], self.network.shapes[high]
        xp, last = array_namespace(sums), self.last
        W = self.layers[last][:-1, :]
        own = slice(values.start * n_k, values.stop * n_k)
        if low == last:  # every output has the same matrix, and none in common with another
            block[own, :] = 0.0
            for o in range(n_k):
                block[own, :][o::n_k, o::n_k] = sums[values.start : values.stop, :]
        else:
            here = xp.reshape(block[own, :], (len(values), n_k, n_j, n_r), copy=False)
            if low == high:
                pairs_of_values = _placed_index(_symmetric_index(n_i)[values.start : values.stop].ravel(), sums)
                pairs_of_derivatives = _placed_index(_symmetric_index(n_k).ravel(), sums)
                found = _taken(_taken(sums, pairs_of_values, 0), pairs_of_derivatives, 1)
                found = xp.permute_dims(xp.reshape(found, (len(values), n_j, n_k, n_r)), (0, 2, 1, 3))
                _put(here, found, (W @ W.T)[:, None, :] if low == last - 1 else None)
            elif (low, high) == (last - 1, last):
                found = xp.reshape(sums[values.start * n_j : values.stop * n_j, :], (len(values), n_j, n_k))
                _put(here, xp.permute_dims(found, (0, 2, 1))[..., None], W[:, None, :])
            else:
                found = xp.reshape(sums[values.start * n_j : values.stop * n_j, :], (len(values), n_j, n_r, n_k))
                _put(here, xp.permute_dims(found, (0, 3, 1, 2)), None)
        if mirrored is not None:
            mirrored[:, own] = block[own, :].T


class _Part(NamedTuple):
    """Some rows of a block of the matrix, those of the values `values` of layer `low`, and where they come from."""

    low: int
    high: int
    sums: Array
    block: Array
    mirrored: Array | None
    values: range


def _put(block: Array, values: Array, factors: Array | None) -> None:
    """Write values, multiplied by factors, into a block: in one pass, as it is the memory that takes the time."""
    if factors is None:
        block[...] = values
    else:
        array_namespace(block).multiply(values, factors, out=block)


def _sum_of_products(left: Array, right: Array, out: Array) -> None:
    """``sum_o left[o] right[o, r]`` for every sample, (r, m) from (o, m) and (o, r, m), in one pass of the memory."""
    if is_numpy_array(left):
        np.einsum("om,orm->rm", left, right, out=out)
    else:
        out[...] = (left[:, None, :] * right).sum(axis=0)


def _taken(array: Array, index: Array, axis: int) -> Array:
    """Rows or columns of a matrix."""
    if is_numpy_array(array):
        return np.take(array, index, axis=axis, mode="clip")  # no index is beyond; not to look takes half of the time
    return array_namespace(array).take(array, index, axis=axis)


def _rows(pairs: Array) -> Array:
    """Pairs (k, l, m) one below the other: (k l, m)."""
    return array_namespace(pairs).reshape(pairs, (-1, pairs.shape[2]))


@cache
def _symmetric_index(k: int) -> IntArray:
    """(k, k) where a pair, in either order, stands in the upper triangle laid out row by row."""
    index = np.zeros((k, k), dtype=np.intp)
    rows, columns = np.triu_indices(k)
    index[rows, columns] = index[columns, rows] = np.arange(len(rows))
    return index


def _placed_index(index: IntArray, like: Array) -> Array:
    """An index on the device of `like`."""
    return array_namespace(like).asarray(index, device=device(like))


def _as_vector(layers: list[Array]) -> FloatArray:
    return np.concatenate([to_numpy(layer).ravel() for layer in layers])


def _added(one: Sequence[Any], other: Sequence[Any]) -> Sequence[Any]:
    return [left + right for left, right in zip(one, other, strict=True)]
