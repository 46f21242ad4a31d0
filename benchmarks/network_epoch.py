"""One evaluation of a network's normal equations, factored as we do it and from the dense Jacobian. One run.

    python benchmarks/network_epoch.py [--json] [--runs N]

The dense way builds the Jacobian by backpropagation of every output and multiplies it with itself by the BLAS, on all
cores, as a symmetric product. Flops count multiplications and additions of the matrix products alone.
"""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import Any

import numpy as np

from machine import options_of, say_json, say_machine, say_table, times_of_each
from truearm.nets.nguyen_widrow import nguyen_widrow
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron

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


def factored_flops(network: Perceptron, n: int) -> int:
    """Flops of the products of pairs: symmetric blocks by their upper triangles."""
    pairs, shapes = 0, network.shapes
    last, n_outputs = len(shapes) - 1, shapes[-1][1]
    for high, (inputs_high, units_high) in enumerate(shapes):
        for low, (inputs_low, units_low) in enumerate(shapes[: high + 1]):
            if low == last:
                pairs += inputs_high**2
            elif high == last:
                pairs += inputs_low * inputs_high * units_low * n_outputs
            elif low == high:
                pairs += (inputs_low * (inputs_low + 1) // 2) * (units_low * (units_low + 1) // 2)
            else:
                pairs += inputs_low * inputs_high * units_low * units_high
    return 2 * n * pairs


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


def main() -> None:
    """Measure and print."""
    options = options_of(__doc__, runs=7)
    found = [compared(sizes, n, runs=options.runs) for sizes, n in CASES]
    if options.json:
        say_json({"cases": found}, [])
        return
    say_machine()
    print(f"\nOne evaluation, shortest of {options.runs} runs (median) [ms]; dense on {os.cpu_count()} BLAS threads\n")
    ms = "{shortest:.0f} ({median:.0f})"
    rows = []
    for case in found:
        timed = {
            name: ms.format(**{k: 1e3 * case[name][k] for k in ("shortest", "median")})
            for name in ("factored", "dense_jacobian", "dense_product")
        }
        dense = case["dense_jacobian"]["shortest"] + case["dense_product"]["shortest"]
        rows.append(
            [
                f"{case['network']}, {case['poses']} poses",
                *timed.values(),
                f"{dense / case['factored']['shortest']:.1f}",
                f"{case['factored_flops']:.1e} / {case['dense_flops']:.1e}",
                f"{case['jacobian_bytes'] / 1e6:.0f} MB",
                f"{case['largest_relative_difference']:.0e}",
            ]
        )
    columns = ["network", "factored", "dense: Jacobian", "J^T J", "times as long", "flops, factored / dense"]
    say_table([*columns, "Jacobian", "difference"], rows)


if __name__ == "__main__":
    main()
