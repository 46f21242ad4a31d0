"""How an epoch of training grows with samples and weights, and what memory it needs. Part of `trainer.py`.

    python growth.py N_SAMPLES UNITS

prints the peak memory of its process, which evaluates the normal equations of 6-UNITS-UNITS-3 and trains an epoch.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from machine import times_of
from network_epoch import factored_flops
from truearm.compensation.nets.nguyen_widrow import nguyen_widrow
from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.perceptron import Perceptron
from truearm.compensation.nets.train_varpro import train_varpro
from truearm.compensation.nets.variable_projection import ProjectedProblem
from truearm.solve.threads import one_blas_thread

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
        assert step is not None  # MU is large enough
        problem.cost(x + 1e-6 * step)  # another point than the last one, whose output layer is kept

    with one_blas_thread():  # as `train_varpro` does
        times = times_of(work, runs=runs)
    flops = factored_flops(full.network, n) + len(x) ** 3 / 3  # Cholesky
    return {"samples": n, "weights": full.network.n_weights, "seconds": times.shortest, "flops": float(flops)}


def exponent(points: list[dict[str, Any]], of: str) -> float:
    """The power of `of` that fits the seconds best."""
    return float(np.polyfit(np.log([p[of] for p in points]), np.log([p["seconds"] for p in points]), 1)[0])


def growth(samples: list[int], units: list[int], *, units_fixed: int, samples_fixed: int) -> dict[str, Any]:
    """Epochs over numbers of samples and over widths of the layers."""
    by_samples = [epoch(units_fixed, n, runs=3 if n >= 100_000 else 7) for n in samples]
    by_weights = [epoch(width, samples_fixed, runs=5) for width in units]
    return {
        "by_samples": by_samples,
        "by_weights": by_weights,
        "exponent_in_samples": exponent(by_samples, "samples"),
        "exponent_in_samples_last_decade": exponent(
            [point for point in by_samples if point["samples"] >= samples[-1] / 10], "samples"
        ),
        "exponent_in_weights": exponent(by_weights, "weights"),
    }


def plot(found: dict[str, Any], file: Path) -> None:
    """Draw seconds against samples and weights, and what the flops predict at the rate of the largest epoch."""
    import matplotlib as mpl  # not in the process whose memory is measured
    from matplotlib.figure import Figure

    mpl.rcParams["svg.hashsalt"] = "growth"
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, key, of in zip(panels, ("by_samples", "by_weights"), ("samples", "weights"), strict=True):
        points = found[key]
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


def memory(n: int, units: int) -> dict[str, Any]:
    """Peak memory of a process of its own, see `main`."""
    ran = subprocess.run([sys.executable, __file__, str(n), str(units)], stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(ran.stdout)


def peak_bytes() -> int:
    """Largest memory that this process has had resident."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage on Linux also counts what the parent had when it started us
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return 1024 * int(line.split()[1])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def main() -> None:
    """Evaluate the normal equations once, train an epoch, tell the peak after each."""
    n, units = map(int, sys.argv[1:])
    imports = peak_bytes()
    problem = random_problem(units, n)
    data = peak_bytes()
    x = nguyen_widrow(problem.network, seed=0)
    problem.normal_equations(x)
    equations = peak_bytes()
    train_varpro(problem, x, epochs=1)
    found = {"imports": imports, "with_data": data, "with_equations": equations, "with_an_epoch": peak_bytes()}
    print(json.dumps({"samples": n, "weights": problem.network.n_weights, **found}))


if __name__ == "__main__":
    main()
