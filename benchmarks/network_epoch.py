"""One evaluation of a network's normal equations: ours, its products alone, the dense Jacobian. One run.

    python benchmarks/network_epoch.py [--json] [--runs N]

The products alone are those that the factored way cannot avoid, by the same calls on pairs made beforehand.
The dense way builds the Jacobian by backpropagation of every output and multiplies it with itself by the BLAS, on all
cores, as a symmetric product. Flops count multiplications and additions of the matrix products alone.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import Any

import numpy as np

from machine import Target, options_of, print_json, print_table, say_machine, say_targets, times_of_each
from truearm.compensation.nets.nguyen_widrow import nguyen_widrow
from truearm.compensation.nets.normal_equations import GROUPS, FitProblem
from truearm.compensation.nets.perceptron import Perceptron
from truearm.solve.arrays import add_product
from truearm.solve.threads import cores, one_blas_thread

CASES = (((6, 30, 30, 3), 3000), ((6, 50, 50, 3), 9000))


def dense_jacobian(network: Perceptron, weights: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Derivatives of all outputs of all samples by all weights, (outputs * samples, weights)."""
    values, layers = network.forward(weights, inputs), network.layers(weights)
    n_outputs, n = values[-1].shape
    J = np.empty((n_outputs, n, network.n_weights))
    by_net = np.broadcast_to(np.eye(n_outputs)[:, None, :], (n_outputs, n, n_outputs))
    end = network.n_weights
    for layer in range(len(layers) - 1, -1, -1):
        start = end - layers[layer].size
        a = np.concatenate([values[layer], np.ones((1, n))]).T
        shape = (n_outputs, n, *layers[layer].shape)
        np.multiply(a[None, :, :, None], by_net[:, :, None, :], out=J[:, :, start:end].reshape(shape, copy=False))
        if layer:
            slope = network.activations[layer - 1].derivative(values[layer]).T
            by_net = (by_net @ layers[layer][:-1].T) * slope
        end = start
    return J.reshape(n_outputs * n, -1)


def products_of(network: Perceptron) -> list[tuple[int, int]]:
    """Rows (left, right) of the products of pairs that no evaluation can avoid, summed over samples."""
    shapes = network.shapes
    last = len(shapes) - 1
    products = [(shapes[last][0], shapes[last][0])]
    for low, (n_i, n_k) in enumerate(shapes[:last]):
        products.append((n_i * (n_i + 1) // 2, n_k * (n_k + 1) // 2))
        for high, (n_j, n_r) in enumerate(shapes[low + 1 :], start=low + 1):
            derivatives = n_k if (low, high) == (last - 1, last) else n_k * n_r
            products.append((n_i * n_j, derivatives))
    return products


def factored_flops(network: Perceptron, n: int) -> int:
    """Flops of the products of pairs: symmetric blocks by their upper triangles."""
    return sum(2 * n * left * right for left, right in products_of(network))


def bare_products(network: Perceptron, n: int, chunk: int) -> Callable[[], None]:
    """The products alone, on pairs that are there already: same shapes, same chunks, same threads."""
    rng = np.random.default_rng(0)
    sizes = [min(chunk, n - start) for start in range(0, n, chunk)]
    pairs = [tuple(rng.uniform(-1, 1, (rows, max(sizes))) for rows in product) for product in products_of(network)]
    groups = [sizes[start::GROUPS] for start in range(min(GROUPS, len(sizes)))]
    sums = [[np.zeros(product) for product in products_of(network)] for _ in groups]

    def work(group: int) -> None:
        for size in groups[group]:
            for (left, right), total in zip(pairs, sums[group], strict=True):
                add_product(total, left[:, :size], right[:, :size])

    pool = ThreadPoolExecutor(cores())  # kept from run to run, as ours is

    def all_groups() -> None:
        with one_blas_thread():
            list(pool.map(work, range(len(groups))))

    return all_groups


def dense_flops(network: Perceptron, n: int) -> int:
    """Flops of the symmetric product of the Jacobian with itself."""
    p = network.n_weights
    return network.sizes[-1] * n * p * (p + 1)


def compared(sizes: tuple[int, ...], n: int, *, runs: int) -> dict[str, Any]:
    """Times, flops and how far the two matrices differ."""
    network = Perceptron.with_layers(sizes[0], sizes[1:-1], sizes[-1])
    rng = np.random.default_rng(0)
    weights = nguyen_widrow(network, seed=0)
    problem = FitProblem(network, rng.uniform(-1, 1, (sizes[0], n)), rng.uniform(-1, 1, (sizes[-1], n)))
    gram = problem.normal_equations(weights).gram
    J = dense_jacobian(network, weights, problem.inputs)
    dense_gram = J.T @ J
    times = times_of_each(
        {
            "factored": lambda: problem.normal_equations(weights),
            "products": bare_products(network, n, problem.chunk),
            "dense_jacobian": lambda: dense_jacobian(network, weights, problem.inputs),
            "dense_product": lambda: J.T @ J,
        },
        runs=runs,
    )
    return {
        "network": "-".join(map(str, sizes)),
        "poses": n,
        **{name: asdict(t) for name, t in times.items()},
        "factored_flops": factored_flops(network, n),
        "dense_flops": dense_flops(network, n),
        "jacobian_bytes": 8 * sizes[-1] * n * network.n_weights,
        "largest_relative_difference": float(np.abs(gram - dense_gram).max() / np.abs(dense_gram).max()),
    }


def ratios_of(case: dict[str, Any]) -> tuple[float, float]:
    """Factored time over that of its products, and over that of the dense way; shortest of the runs."""
    factored, products, jacobian, product = (
        case[name]["shortest"] for name in ("factored", "products", "dense_jacobian", "dense_product")
    )
    return factored / products, factored / (jacobian + product)


def targets_of(found: list[dict[str, Any]]) -> list[Target]:
    """What the larger case has to reach."""
    over_products, over_dense = ratios_of(found[-1])
    return [
        Target(f"{found[-1]['network']}: factored over its products alone", over_products, 1.25),
        Target(f"{found[-1]['network']}: factored over dense", over_dense, 0.35),
    ]


def main() -> None:
    """Measure and print."""
    options = options_of(__doc__, runs=7)
    found = [compared(sizes, n, runs=options.runs) for sizes, n in CASES]
    if options.json:
        print_json({"cases": found}, targets_of(found))
        return
    say_machine()
    print(f"\nOne evaluation, shortest of {options.runs} runs (median) [ms]; dense on {os.cpu_count()} BLAS threads\n")
    ms = "{shortest:.0f} ({median:.0f})"
    rows = []
    for case in found:
        timed = [
            ms.format(**{k: 1e3 * case[name][k] for k in ("shortest", "median")})
            for name in ("factored", "products", "dense_jacobian", "dense_product")
        ]
        rows.append(
            [
                f"{case['network']}, {case['poses']} poses",
                *timed,
                *(f"{ratio:.2f}" for ratio in ratios_of(case)),
                f"{case['factored_flops']:.1e} / {case['dense_flops']:.1e}",
                f"{case['jacobian_bytes'] / 1e6:.0f} MB",
                f"{case['largest_relative_difference']:.0e}",
            ]
        )
    columns = ["network", "factored", "products alone", "dense: Jacobian", "J^T J", "/ products", "/ dense"]
    print_table([*columns, "flops, factored / dense", "Jacobian", "difference"], rows)
    say_targets(targets_of(found))


if __name__ == "__main__":
    main()
