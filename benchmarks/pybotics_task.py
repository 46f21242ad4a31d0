"""pybotics' own calibration example, solved by `identify`; beside pybotics itself if its Python is named. One run.

    python benchmarks/pybotics_task.py [--json] [--seed N] [--runs N] [--peer PYTHON]

The task (``examples/calibration.ipynb`` of pybotics 3): a UR10 as modified D-H table whose six joint offsets are off by
up to +-0.1 deg, 1000 random poses with exact positions, 700 to learn from, 300 to test, the six offsets sought. Both
solve the same numbers. pybotics needs NumPy below 2, so it gets an environment of its own:

    python3.11 -m venv pybotics-env && pybotics-env/bin/pip install 'pybotics==3.1.2' 'numpy<2'
    python benchmarks/pybotics_task.py --peer pybotics-env/bin/python

The tip lies on the sixth axis: positions say nothing of the sixth offset, and both leave it where it was.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from machine import Target, Times, arguments_of, print_json, say_machine, say_targets, times_of
from truearm.arm import Chain, chain_from_mdh
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, Constant, Term

# The table of pybotics' predefined UR10: alpha [rad], a [mm], theta [rad], d [mm].
UR10_MDH = np.array(
    [
        [0, 0, 0, 118],
        [np.pi / 2, 0, np.pi, 0],
        [0, 612.7, 0, 0],
        [0, 571.6, 0, 163.9],
        [-np.pi / 2, 0, 0, 115.7],
        [np.pi / 2, 0, np.pi, 92.2],
    ]
)
N_TRAIN, N_TEST = 700, 300
LARGEST_OFFSET = np.radians(0.1)
# How far joint offsets are expected from zero [rad]: wide beside what was planted, so that the prior does not matter.
PRIOR = 0.01


@dataclass(frozen=True)
class Task:
    """Poses (n, 6) [rad], the true positions (n, 3) [mm], and the offsets (6,) that were planted [rad]."""

    angles: np.ndarray
    positions: np.ndarray
    offsets: np.ndarray


def nominal_chain(offsets: np.ndarray | float = 0.0) -> Chain:
    """The UR10, its joints off by `offsets` [rad]."""
    alpha, a, theta, d = UR10_MDH.T
    return chain_from_mdh(a=a, d=d, alpha=alpha, theta=theta + offsets)


def make_task(seed: int) -> Task:
    """Plant offsets, draw poses, compute where the tip truly is."""
    rng = np.random.default_rng(seed)
    offsets = rng.uniform(-LARGEST_OFFSET, LARGEST_OFFSET, 6)
    angles = rng.uniform(-np.pi, np.pi, (N_TRAIN + N_TEST, 6))
    return Task(angles, nominal_chain(offsets).tip_in_base(angles), offsets)


def solved(task: Task) -> IdentificationResult:
    """The six offsets, as rotations about the joints' own axes, from the training poses."""
    chain = nominal_chain()
    about_z = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    offsets = [Term(f"J{i} offset", i, about_z, Constant(), "offsets", PRIOR, learn=False) for i in range(1, 7)]
    references = [Points(np.arange(N_TRAIN), task.positions[:N_TRAIN])]
    return identify(chain, ArmState(chain, task.angles[:N_TRAIN]), offsets, references)


def test_mean(chain: Chain, task: Task) -> float:
    """Mean error on the test poses [mm]."""
    tips = chain.tip_in_base(task.angles[N_TRAIN:])
    return float(np.linalg.norm(tips - task.positions[N_TRAIN:], axis=1).mean())


def pybotics_answer(python: Path, task: Task) -> dict[str, Any]:
    """What pybotics makes of the same numbers, in its own Python."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "task.npz"
        np.savez(file, table=UR10_MDH, angles=task.angles, positions=task.positions, n_train=N_TRAIN)
        peer = Path(__file__).with_name("pybotics_peer.py")
        ran = subprocess.run([python, peer, file], capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        raise SystemExit(f"{python} {peer.name} failed:\n{ran.stderr}")
    return json.loads(ran.stdout)


def main() -> None:
    """Solve, compare and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--seed", type=int, default=0, help="0 by default")
    parser.add_argument("--runs", type=int, default=21, help="21 by default")
    parser.add_argument("--peer", type=Path, help="a Python that has pybotics 3.1.2")
    options = parser.parse_args()
    task = make_task(options.seed)
    times = times_of(lambda: solved(task), runs=options.runs)
    fit = solved(task)
    found = answer(fit, task, times)
    if options.peer:
        peer = pybotics_answer(options.peer, task)
        peer["largest_offset_error_rad"] = offset_error(np.array(peer["offsets_rad"]), task)
        found["pybotics"] = peer | {"times_as_long": peer["seconds"] / times.median}
    targets = [
        Target("fit of 700 poses, median [s]", times.median, 0.05),
        Target("test mean [mm]", found["test_mean_mm"], 1e-5),
        Target("largest error of an offset that positions determine [rad]", found["largest_offset_error_rad"], 1e-9),
    ]
    if options.json:
        print_json(found, targets)
    else:
        say(found)
        say_targets(targets)


def answer(fit: IdentificationResult, task: Task, times: Times) -> dict[str, Any]:
    """What we found, as figures."""
    offsets, std = fit.coefficients, np.sqrt(fit.covariance.diagonal())
    return {
        "seconds": asdict(times),
        "test_mean_before_mm": test_mean(nominal_chain(), task),
        "test_mean_mm": test_mean(fit.chain, task),
        "planted_rad": task.offsets.tolist(),
        "offsets_rad": offsets.tolist(),
        "offset_std_rad": std.tolist(),
        "largest_offset_error_rad": offset_error(offsets, task),
    }


def offset_error(offsets: np.ndarray, task: Task) -> float:
    """Largest error of the five offsets that positions determine [rad]."""
    return float(np.abs(offsets - task.offsets)[:5].max())


def say(found: dict[str, Any]) -> None:
    """Print what was found."""
    say_machine()
    seconds = found["seconds"]
    print(f"\nfit of {N_TRAIN} poses: {seconds['shortest'] * 1e3:.1f} ms, median of {seconds['runs']} runs", end=" ")
    print(f"{seconds['median'] * 1e3:.1f} ms")
    print(f"test mean of {N_TEST} poses: {found['test_mean_before_mm']:.4f} mm -> {found['test_mean_mm']:.2g} mm\n")
    print("joint   planted [rad]     found [rad]       standard uncertainty [rad]")
    rows = zip(found["planted_rad"], found["offsets_rad"], found["offset_std_rad"], strict=True)
    for joint, (planted, offset, std) in enumerate(rows, start=1):
        print(f"{joint:5}   {planted:+.12f}   {offset:+.12f}   {std:.1e}")
    print("The tip lies on axis 6: positions do not determine its offset, and its uncertainty stays that of the prior.")
    if "pybotics" in found:
        peer = found["pybotics"]
        print(f"\npybotics {peer['version']}: {peer['seconds']:.2f} s, {peer['evaluations']} evaluations and", end=" ")
        print(f"{peer['jacobians']} difference-quotient Jacobians, test mean {peer['test_mean_mm']:.2g} mm,", end=" ")
        print(f"offsets to {peer['largest_offset_error_rad']:.1g} rad: {peer['times_as_long']:.0f} times as long")


if __name__ == "__main__":
    main()
