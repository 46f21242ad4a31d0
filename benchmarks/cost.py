"""Cost of a fit as it grows: time and memory of an arm's identification, and of an epoch of a network.

An evaluation of a network's normal equations is compared with its products alone, those that the factored way cannot
avoid, by the same calls on pairs made beforehand; and with the dense way, which builds the Jacobian by backpropagation
of every output and multiplies it with itself by the BLAS, on all cores, as a symmetric product. Flops count
multiplications and additions of the matrix products alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.rows import RowResult, Rows, Target, own_process, peak_bytes, times_of, times_of_each
from truearm.nets.levenberg_marquardt import ProjectedProblem, train_varpro
from truearm.nets.normal_equations import GROUPS, FitProblem
from truearm.nets.perceptron import Perceptron, nguyen_widrow
from truearm.solve.linear_algebra import add_product
from truearm.solve.threads import cores, one_blas_thread

ROWS = Rows()

# Identification of an arm, each in a process of its own ---------------------------------------------------------------

READINGS = (1500, 3000, 6000, 12_000, 24_000)
JUDGED = 12_000
HIGHEST = 104  # of the harmonics about six axes: 1,500 coefficients in all, or a few more
NOISE_MM = 0.03


def planted(n: int, highest: int) -> tuple[Any, ...]:
    """Chain, state, terms and points of a planted UR10 that n readings measure."""
    # Here, as a process that measures the memory of a network imports none of it.
    from truearm.arm import load_arm
    from truearm.identification.estimation.perturbed_chain import PerturbedChain
    from truearm.identification.references.references import Points
    from truearm.identification.terms import ArmState, candidate_terms

    rng = np.random.default_rng(0)
    chain = load_arm("ur10").chain
    # As the first three quarters of a turn: joints of real arms do not go all the way round.
    state = ArmState(chain, rng.uniform(-0.75 * np.pi, 0.75 * np.pi, (n, chain.n_joints)))
    terms = candidate_terms(state, highest=highest)[0]
    std = np.concatenate([term.prior_stds for term in terms])
    errors = rng.standard_normal(len(std)) * np.where(std > 0.5, 0.0, 0.3 * std)
    points = PerturbedChain(chain, tuple(terms)).tips(state, errors) + NOISE_MM * rng.standard_normal((n, 3))
    return chain, state, terms, [Points(np.arange(n), points)]


def identification(n: int) -> dict[str, Any]:
    """Identify a planted arm from n readings."""
    from truearm.identification.estimation.identification import identify

    arm = planted(n, HIGHEST)
    begun, cpu = time.perf_counter(), time.process_time()
    fit = identify(*arm)
    seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
    return {
        "readings": n,
        "coefficients": sum(term.n_coefficients for term in arm[2]),
        "seconds": seconds,
        "cpu_seconds": cpu,
        "rounds": fit.rounds,
        "converged": bool(fit.converged),
        "noise_mm": fit.references[0].noise_std,
        "peak_MB": peak_bytes() / 1e6,
    }


@ROWS.row("identification", quick={"readings": (300, 600)})
def identifications(readings: tuple[int, ...] = READINGS) -> RowResult:
    """Identification with 1,500 terms, evidence and all rounds included."""
    each = [own_process(identification, n) for n in readings]
    for of in each:
        of["cpu_seconds a round"] = of["cpu_seconds"] / of["rounds"]
    large = [of for of in each if of["readings"] >= 3000] or each
    growth = exponent(large, "readings", "cpu_seconds a round")
    targets = [Target("growth of a round with the readings, exponent", growth, 1.0)]
    for of in each:
        if of["readings"] == JUDGED:
            name = f"{JUDGED} readings x {of['coefficients']} coefficients"
            targets.append(Target(f"{name}: time [s]", of["seconds"], 10))
            targets.append(Target(f"{name}: peak memory of the process [MB]", of["peak_MB"], 500))
    return RowResult(each, targets, [f"A planted UR10 whose tips have noise of {NOISE_MM} mm in every coordinate."])


@ROWS.row("regions", threads="one", quick={"poses": 600, "highest": 4})
def regions(poses: int = 5000, highest: int = HIGHEST) -> RowResult:
    """The ends of all joints of a planted UR10 held out, by normal equations and by the derivatives of every reading.

    Deviations and covariances by both are compared, in standard deviations of the prediction.
    """
    from truearm.identification.estimation.identification import identify
    from truearm.identification.judgement import cross_validation
    from truearm.identification.judgement.outer_regions import MOST_PREDICTED, outer_regions

    chain, state, terms, points = planted(poses, highest)
    fit = identify(chain, state, terms, points)
    ends = [rows for _, rows in outer_regions(state.angles, np.ones(poses, dtype=bool))]
    found, seconds = {}, {}
    for way in ("equations", "derivatives"):
        plain = patch.object(cross_validation._Minimum, "_without_data", return_value=None)
        with plain if way == "derivatives" else nullcontext():
            begun = time.process_time()
            found[way] = cross_validation.cross_validate_regions(fit, state, points, ends, MOST_PREDICTED)
            seconds[way] = time.process_time() - begun
    pairs = list(zip(found["equations"], found["derivatives"], strict=True))
    std = [np.sqrt(np.einsum("nii->n", one.covariance)) for _, one in pairs]
    shift = max(
        float((np.abs(a.deviations - b.deviations).max(axis=1) / s).max()) for (a, b), s in zip(pairs, std, strict=True)
    )
    wider = max(
        float((np.abs(a.covariance - b.covariance).max(axis=(1, 2)) / s**2).max())
        for (a, b), s in zip(pairs, std, strict=True)
    )
    table = [{"regions": len(ends), **{f"{way} [s]": of for way, of in seconds.items()}}]
    return RowResult(
        table,
        [
            Target(
                "ends of joints held out by normal equations, share of the CPU time by derivatives",
                seconds["equations"] / seconds["derivatives"],
                0.35,
            ),
            Target("by both, largest difference of a deviation held out [standard deviations]", shift, 0.01),
            # In single precision where a few in double agree to 1e-4.
            Target("by both, largest difference of a covariance held out, relative", wider, 1e-4),
        ],
    )


# An epoch of a network ------------------------------------------------------------------------------------------------

SAMPLES = (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
UNITS = (6, 12, 18, 25, 30, 40, 50, 60, 72)
MU = 1e-3  # any damping: the factor takes as long


def random_problem(units: int, n: int) -> FitProblem:
    """A 6-units-units-3 network and n samples."""
    network = Perceptron.with_layers(6, (units, units), 3)
    rng = np.random.default_rng(0)
    return FitProblem(network, rng.uniform(-1, 1, (6, n)), rng.uniform(-1, 1, (3, n)))


def epoch(units: int, n: int, *, runs: int) -> dict[str, Any]:
    """Time of an epoch of `lm`, equations, a damped step and its cost, and the flops it cannot avoid."""
    full = random_problem(units, n)
    problem = ProjectedProblem(full)
    x = nguyen_widrow(full.network, seed=0)[: problem.n_hidden_weights]

    def work() -> None:
        step = problem.normal_equations(x).damped_step(MU)
        problem.cost(x + 1e-6 * step)  # another point than the last one, whose output layer is kept

    with one_blas_thread():  # as `train_varpro` does
        times = times_of(work, runs=runs)
    flops = factored_flops(full.network, n) + len(x) ** 3 / 3  # Cholesky
    return {"samples": n, "weights": full.network.n_weights, "seconds": times.shortest, "flops": float(flops)}


def exponent(points: list[dict[str, Any]], of: str, seconds: str = "seconds") -> float:
    """The power of `of` that fits the seconds best."""
    x, y = (np.log([p[name] for p in points]) for name in (of, seconds))
    return float(np.polyfit(x, y, 1)[0])


@ROWS.row("epoch", quick={"samples": (300, 1000, 3000), "units": (4, 8), "units_fixed": 8, "samples_fixed": 300})
def epochs(
    samples: tuple[int, ...] = SAMPLES,
    units: tuple[int, ...] = UNITS,
    units_fixed: int = 30,
    samples_fixed: int = 9000,
    plot: str | None = None,
) -> RowResult:
    """An epoch of varpro, 6-units-units-3: normal equations, output layer eliminated, one step.

    `plot` is a file (.svg, .png) to draw the growth into.
    """
    by_samples = [epoch(units_fixed, n, runs=3 if n >= 100_000 else 7) for n in samples]
    by_weights = [epoch(width, samples_fixed, runs=5) for width in units]
    if plot:
        draw(by_samples, by_weights, Path(plot))
    last = exponent([point for point in by_samples if point["samples"] >= samples[-1] / 10], "samples")
    steepest = max(exponent(by_samples, "samples"), last)
    note = (
        f"exponent in samples {exponent(by_samples, 'samples'):.3f}, last decade {last:.3f}; "
        f"in weights {exponent(by_weights, 'weights'):.2f}"
    )
    target = Target("growth, exponent in samples, of all and of the last decade", steepest, 1.05)
    return RowResult([*by_samples, *by_weights], [target], [note])


def draw(by_samples: list[dict[str, Any]], by_weights: list[dict[str, Any]], file: Path) -> None:
    """Draw seconds against samples and weights, and what the flops predict at the rate of the largest epoch."""
    import matplotlib as mpl  # not in the process whose memory is measured
    from matplotlib.figure import Figure

    mpl.rcParams["svg.hashsalt"] = "growth"
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, points, of in zip(panels, (by_samples, by_weights), ("samples", "weights"), strict=True):
        x, seconds, flops = (np.array([p[name] for p in points]) for name in (of, "seconds", "flops"))
        rate = flops[-1] / seconds[-1]
        axes.loglog(x, flops / rate, color="0.6", label=f"predicted flops at {rate / 1e9:.3g} Gflop/s")
        axes.loglog(x, seconds, "o", color="C0", label="measured")
        other = "weights" if of == "samples" else "samples"
        axes.set(xlabel=f"{of}, with {points[0][other]} {other}")
        axes.grid(True, which="major", alpha=0.3)
        axes.legend(frameon=False)
    panels[0].set_ylabel("an epoch [s]")
    figure.savefig(file, dpi=150, metadata={"Date": None} if file.suffix == ".svg" else None)


def memory_of(n: int, units: int) -> dict[str, float]:
    """Peak memory of this process [MB] after evaluating the normal equations once, and after training an epoch."""
    found = {"after imports [MB]": peak_bytes() / 1e6}
    problem = random_problem(units, n)
    found["with data [MB]"] = peak_bytes() / 1e6
    x = nguyen_widrow(problem.network, seed=0)
    problem.normal_equations(x)
    found["normal equations [MB]"] = peak_bytes() / 1e6
    train_varpro(problem, x, epochs=1)
    return {"samples": n, "weights": problem.network.n_weights, **found, "an epoch [MB]": peak_bytes() / 1e6}


@ROWS.row("memory", quick={"samples": (2000, 20_000), "units_fixed": 8})
def memory(samples: tuple[int, ...] = (9000, 1_000_000), units_fixed: int = 50) -> RowResult:
    """Peak memory of a process of its own that trains 6-units-units-3."""
    table = [own_process(memory_of, n, units_fixed) for n in samples]
    what = "memory, peak with {samples} samples [MB]"
    return RowResult(table, [Target(what.format(**one), one["an epoch [MB]"], 400) for one in table])


# Normal equations of a network, three ways ----------------------------------------------------------------------------

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
            "products alone": bare_products(network, n, problem.chunk),
            "dense: Jacobian": lambda: dense_jacobian(network, weights, problem.inputs),
            "dense: product": lambda: J.T @ J,
        },
        runs=runs,
    )
    factored, products, jacobian, product = (t.shortest for t in times.values())
    dense_flops = network.sizes[-1] * n * network.n_weights * (network.n_weights + 1)
    return {
        "network": "-".join(map(str, sizes)),
        "poses": n,
        **{f"{name} [ms]": f"{1e3 * t.shortest:.0f} ({1e3 * t.median:.0f})" for name, t in times.items()},
        "/ products": factored / products,
        "/ dense": factored / (jacobian + product),
        "flops, factored / dense": f"{factored_flops(network, n):.1e} / {dense_flops:.1e}",
        "Jacobian [MB]": 8e-6 * sizes[-1] * n * network.n_weights,
        "difference": float(np.abs(gram - dense_gram).max() / np.abs(dense_gram).max()),
    }


@ROWS.row("normal-equations", quick={"runs": 1, "largest": 3000})
def normal_equations(runs: int = 7, largest: int = 9000) -> RowResult:
    """One evaluation of J^T J: factored, its products alone, dense; shortest of some runs (median)."""
    table = [compared(sizes, n, runs=runs) for sizes, n in CASES if n <= largest]
    last = table[-1]
    targets = [
        Target(f"{last['network']}: factored over its products alone", last["/ products"], 1.25),
        Target(f"{last['network']}: factored over dense", last["/ dense"], 0.35),
    ]
    return RowResult(table, targets)
