"""A Panda from full poses and from positions, as robotkinecal does it; beside it if its Python is named. One run.

    python benchmarks/robotkinecal_task.py [--json] [--seed N] [--runs N] [--arms N] [--peer PYTHON]

Every joint of a Franka Panda is off by random motions, 1 mrad and 0.5 mm in each component; its flange is seen in 100
or 200 poses, or in 200 positions, with noise of 20 um and 20 urad. Both solve the same numbers, from the drawing. The
flange's origin lies on the seventh axis, so positions leave two of the 4 x 7 + 3 combinations open that they would tell
of another arm: the rank is that at the drawing. Coverage is that of true tips, in new poses, by the 95 % ellipsoids of
their stated covariance.

robotkinecal needs NumPy below 2, so it gets an environment of its own:

    python3.11 -m venv rkc-env && rkc-env/bin/pip install 'robotkinecal==0.1.0' 'numpy<2'
    python benchmarks/robotkinecal_task.py --peer rkc-env/bin/python
"""

from __future__ import annotations

import json
import statistics
import subprocess
import tempfile
import time
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from machine import Target, arguments_of, print_json, print_table, say_machine, say_targets, times_of_each
from truearm.arm import Chain, load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.planning.observability import rank_and_gap
from truearm.identification.references.orientations import LEVER_MM, Orientations
from truearm.identification.references.references import Points, Reference
from truearm.identification.terms import ArmState, Term, constants
from truearm.identification.terms.catalogue import tool_rotation

ANGLE_STD, LENGTH_STD = 1e-3, 0.5  # rad, mm; of every component of every joint
POINT_NOISE, TURN_NOISE = 0.02, 2e-5  # mm, rad
N_TEST = 300
LEVEL = 0.95
TASKS = {"100 poses": (100, True), "200 poses": (200, True), "200 positions": (200, False)}


@dataclass(frozen=True)
class Task:
    """Readings (n, 7) [rad] with orientations (n, 3, 3) and points (n, 3) [mm], test poses, and the true chain."""

    angles: np.ndarray
    R: np.ndarray
    points: np.ndarray
    test: np.ndarray
    truth: Chain
    full: bool


@cache
def nominal() -> Chain:
    """The Panda to its flange, which is what robotkinecal's example measures."""
    return load_arm("panda").chain.with_tip([0.0, 0.0, 0.0])


def make_task(name: str, seed: int) -> Task:
    """Plant motions, draw poses, measure."""
    n, full = TASKS[name]
    rng, arm, chain = np.random.default_rng(seed), load_arm("panda"), nominal()
    motions = rng.normal(size=(chain.n_places, 6)) * ([ANGLE_STD] * 3 + [LENGTH_STD] * 3)
    motions[[0, -1]] = 0
    truth = chain.with_motions(motions)
    angles = rng.uniform(*arm.limits.T, (n + N_TEST, 7))
    pose = truth.pose(angles[:n])
    R = Rotation.from_matrix(pose.R_base_tip) * Rotation.from_rotvec(rng.normal(0, TURN_NOISE, (n, 3)))
    points = pose.tip_in_base + rng.normal(0, POINT_NOISE, (n, 3))
    return Task(angles[:n], R.as_matrix(), points, angles[n:], truth, full)


def terms_of(task: Task) -> list[Term]:
    """All constants, base and tip free; with orientations the tool's as well."""
    chain = nominal()
    return [*constants(chain), *(tool_rotation(chain) if task.full else [])]


def references_of(task: Task) -> list[Reference]:
    """What was seen."""
    rows = np.arange(len(task.angles))
    return [Points(rows, task.points), *([Orientations(rows, task.R)] if task.full else [])]


def solved(task: Task) -> IdentificationResult:
    """The arm, from its drawing."""
    return identify(nominal(), ArmState(nominal(), task.angles), terms_of(task), references_of(task))


def cpu_seconds(task: Task, *, runs: int) -> float:
    """Median processor time of a fit [s], which a busy machine stretches less than the clock's."""
    seconds = []
    for _ in range(runs):
        start = time.process_time()
        solved(task)
        seconds.append(time.process_time() - start)
    return statistics.median(seconds)


def rank(task: Task) -> tuple[int, float]:
    """Combinations of constants that the readings tell about the arm as drawn, and the gap to those they do not."""
    perturbed_chain = PerturbedChain(nominal(), tuple(terms_of(task)))
    problem = SmallMotionProblem(perturbed_chain, ArmState(nominal(), task.angles), tuple(references_of(task)))
    by = problem.jacobian(np.zeros(perturbed_chain.n_coefficients))
    jacobian = np.concatenate([each.reshape(len(each), -1) for each in by], axis=1).T
    length = np.linalg.norm(jacobian, axis=0)
    return rank_and_gap(np.linalg.svd(jacobian[:, length > 0] / length[length > 0], compute_uv=False))


def errors(found: IdentificationResult, task: Task) -> np.ndarray:
    """(N_TEST, 3) errors of tips in new poses [mm]."""
    return found.tips(ArmState(nominal(), task.test)) - task.truth.tip_in_base(task.test)


def covered(found: IdentificationResult, task: Task) -> float:
    """Share of new tips within the ellipsoid of their stated covariance."""
    error = errors(found, task)
    inverse = np.linalg.inv(found.tip_covariance(ArmState(nominal(), task.test)))
    return float((np.einsum("ni,nij,nj->n", error, inverse, error) < chi2.ppf(LEVEL, 3)).mean())


def robotkinecal_answer(python: Path, task: Task) -> dict[str, Any]:
    """What robotkinecal makes of the same numbers, in its own Python and in metres."""
    to_link8 = Rotation.from_euler("z", 45, degrees=True).as_matrix()  # ours is turned with the hand
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "task.npz"
        readings = {"angles": task.angles, "R": task.R @ to_link8, "points": task.points / 1e3, "full": task.full}
        np.savez(file, **readings, test=task.test)
        peer = Path(__file__).with_name("robotkinecal_peer.py")
        ran = subprocess.run([python, peer, file], capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        raise SystemExit(f"{python} {peer.name} failed:\n{ran.stderr}")
    answer = json.loads(ran.stdout.splitlines()[-1])
    tips = 1e3 * np.array(answer.pop("test_points"))
    error = tips - task.truth.tip_in_base(task.test)
    return answer | {"test_mean_mm": float(np.linalg.norm(error, axis=1).mean())}


def main() -> None:
    """Solve, compare and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--seed", type=int, default=0, help="0 by default")
    parser.add_argument("--runs", type=int, default=21, help="21 by default")
    parser.add_argument("--arms", type=int, default=60, help="arms drawn for the coverage; 60 by default")
    parser.add_argument("--peer", type=Path, help="a Python that has robotkinecal 0.1.0")
    options = parser.parse_args()
    tasks = {name: make_task(name, options.seed) for name in TASKS}
    times = times_of_each({name: lambda task=task: solved(task) for name, task in tasks.items()}, runs=options.runs)
    answers: dict[str, dict[str, Any]] = {}
    targets = []
    for name, task in tasks.items():
        found = solved(task)
        (told, gap), of = rank(task), 4 * 7 + (6 if task.full else 3)
        drawn = [make_task(name, options.seed + 1 + i) for i in range(options.arms)]
        coverage = float(np.mean([covered(solved(each), each) for each in drawn]))
        before = nominal().tip_in_base(task.test) - task.truth.tip_in_base(task.test)
        cpu = cpu_seconds(task, runs=options.runs)
        noise = {e.kind: e.noise_std for e in found.references}
        answers[name] = {
            "seconds": asdict(times[name]),
            "cpu_seconds": cpu,
            "rank": told,
            "of": of,
            "gap": gap,
            "test_mean_before_mm": float(np.linalg.norm(before, axis=1).mean()),
            "test_mean_mm": float(np.linalg.norm(errors(found, task), axis=1).mean()),
            "noise_mm": noise["point"],
            "noise_rad": noise["orientation"] / LEVER_MM if task.full else None,
            "coverage": coverage,
        }
        if options.peer:
            answers[name]["robotkinecal"] = robotkinecal_answer(options.peer, task)
        targets += [
            Target(f"{name}: fit, median [CPU s]", cpu, 0.1),
            Target(f"{name}: rank off what geometry says", abs(told - (of if task.full else of - 2)), 0),
            Target(f"{name}: coverage of {LEVEL:.0%} ellipsoids", coverage, 0.93, "above"),
            Target(f"{name}: the same", coverage, 0.97),
        ]
    if options.json:
        print_json(answers, targets)
    else:
        say(answers)
        say_targets(targets)


def say(answers: dict[str, dict[str, Any]]) -> None:
    """Print what was found."""
    say_machine()
    print()
    rows = []
    for name, found in answers.items():
        rows.append(
            [
                name,
                f"{found['seconds']['shortest'] * 1e3:.0f}",
                f"{found['seconds']['median'] * 1e3:.0f}",
                f"{found['cpu_seconds'] * 1e3:.0f}",
                f"{found['rank']} of {found['of']}",
                f"{found['test_mean_before_mm']:.3f}",
                f"{found['test_mean_mm']:.4f}",
                f"{found['coverage']:.3f}",
            ]
        )
        if "robotkinecal" in found:
            peer = found["robotkinecal"]
            rows.append(
                [
                    f"  robotkinecal {peer['version']}",
                    "",
                    f"{peer['seconds'] * 1e3:.0f}",
                    f"{peer['cpu_seconds'] * 1e3:.0f}",
                    f"{peer['rank']} of {peer['of']}",
                    "",
                    f"{peer['test_mean_mm']:.4f}",
                    "",
                ]
            )
    columns = ["readings", "shortest [ms]", "median", "CPU", "rank", "test before [mm]", "after", "coverage"]
    print_table(columns, rows)


if __name__ == "__main__":
    main()
