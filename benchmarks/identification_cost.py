"""Row of `identification.py` on cost: time and memory of 12,000 readings x 1,500 terms, and growth with the readings.

    python identification_cost.py N_READINGS

prints what one identification took, in a process of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

import numpy as np

from growth import peak_bytes
from identification_row import Row
from machine import Target
from truearm.arm import load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, Term, candidate_terms

READINGS = (1500, 3000, 6000, 12_000, 24_000)
JUDGED = 12_000
HIGHEST = 104  # of the harmonics about six axes: 1,500 coefficients in all, or a few more
NOISE_MM = 0.03


def terms_of(state: ArmState) -> list[Term]:
    """All candidates of a UR10 with harmonics up to a high order."""
    return candidate_terms(state, highest=HIGHEST)[0]


def one(n: int) -> dict[str, Any]:
    """Identify a planted arm from n readings."""
    rng = np.random.default_rng(0)
    chain = load_arm("ur10").chain
    # As the first three quarters of a turn: joints of real arms do not go all the way round.
    state = ArmState(chain, rng.uniform(-0.75 * np.pi, 0.75 * np.pi, (n, chain.n_joints)))
    terms = terms_of(state)
    perturbed_chain = PerturbedChain(chain, tuple(terms))
    std = np.concatenate([term.prior_stds for term in terms])
    planted = rng.standard_normal(len(std)) * np.where(std > 0.5, 0.0, 0.3 * std)
    points = perturbed_chain.tips(state, planted) + NOISE_MM * rng.standard_normal((n, 3))
    before = peak_bytes()
    begun, cpu = time.perf_counter(), time.process_time()
    fit = identify(chain, state, terms, [Points(np.arange(n), points)])
    seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
    return {
        "readings": n,
        "coefficients": perturbed_chain.n_coefficients,
        "seconds": seconds,
        "cpu_seconds": cpu,
        "rounds": fit.rounds,
        "converged": bool(fit.converged),
        "noise_mm": fit.references[0].noise_std,
        "before_bytes": before,
        "peak_bytes": peak_bytes(),
    }


def cost(seeds: int) -> Row:
    """Time, memory and growth."""
    del seeds
    each = []
    for n in READINGS:
        ran = subprocess.run([sys.executable, __file__, str(n)], stdout=subprocess.PIPE, text=True, check=True)
        each.append(json.loads(ran.stdout))
    cells = [
        [
            str(e["readings"]),
            str(e["coefficients"]),
            f"{e['seconds']:.1f}",
            f"{e['cpu_seconds']:.1f}",
            f"{e['rounds']}{'' if e['converged'] else ' (not settled)'}",
            f"{e['cpu_seconds'] / e['rounds']:.2f}",
            f"{e['peak_bytes'] / 1e6:.0f}",
            f"{e['noise_mm']:.4f}",
        ]
        for e in each
    ]
    judged = next(e for e in each if e["readings"] == JUDGED)
    large = [e for e in each if e["readings"] >= 3000]
    exponent = np.polyfit(
        np.log([e["readings"] for e in large]), np.log([e["cpu_seconds"] / e["rounds"] for e in large]), 1
    )[0]
    name = f"{JUDGED} readings x {judged['coefficients']} coefficients"
    targets = [
        Target(f"{name}: time [s]", judged["seconds"], 10),
        Target(f"{name}: peak memory of the process [MB]", judged["peak_bytes"] / 1e6, 500),
        Target("growth of a round with the readings, exponent", float(exponent), 1.0),
    ]
    columns = ["readings", "coefficients", "s", "CPU s", "rounds", "CPU s a round", "peak MB", "noise found [mm]"]
    note = f"A planted UR10 whose tips have noise of {NOISE_MM} mm in every coordinate; time with evidence, all rounds."
    return Row("Time and memory, each in a process of its own", columns, cells, targets, {"runs": each}, [note])


if __name__ == "__main__":
    print(json.dumps(one(int(sys.argv[1]))))
