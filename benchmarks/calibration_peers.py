"""Calibrations as pybotics and robotkinecal do them; beside them if a Python that has them is named.

Both solve the same numbers. They need NumPy below 2, so each gets an environment of its own::

    python3.11 -m venv pybotics-env && pybotics-env/bin/pip install 'pybotics==3.1.2' 'numpy<2'
    python -m benchmarks calibration_peers pybotics --peer pybotics-env/bin/python

    python3.11 -m venv rkc-env && rkc-env/bin/pip install 'robotkinecal==0.1.0' 'numpy<2'
    python -m benchmarks calibration_peers robotkinecal --peer rkc-env/bin/python

Without ``--peer`` both rows run truearm alone: ranks, coverage and times.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from benchmarks.peers import answer_of
from benchmarks.rows import RowResult, Rows, Target, cpu_seconds_of, times_of, times_of_each
from truearm.arm import Chain, chain_from_mdh, load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.references.orientations import Orientations
from truearm.identification.references.references import Points, Reference
from truearm.identification.terms import ArmState, Constant, Term, constants
from truearm.identification.terms.catalogue import tool_rotation
from truearm.wings.planning.designs.observability import rank_and_gap

ROWS = Rows()

# pybotics: joint offsets of a UR10 ------------------------------------------------------------------------------------

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
class OffsetTask:
    """Poses (n, 6) [rad], the true positions (n, 3) [mm], and the offsets (6,) that were planted [rad]."""

    angles: np.ndarray
    positions: np.ndarray
    offsets: np.ndarray


def nominal_chain(offsets: np.ndarray | float = 0.0) -> Chain:
    """The UR10, its joints off by `offsets` [rad]."""
    alpha, a, theta, d = UR10_MDH.T
    return chain_from_mdh(a=a, d=d, alpha=alpha, theta=theta + offsets)


def offset_task(seed: int) -> OffsetTask:
    """Plant offsets, draw poses, compute where the tip truly is."""
    rng = np.random.default_rng(seed)
    offsets = rng.uniform(-LARGEST_OFFSET, LARGEST_OFFSET, 6)
    angles = rng.uniform(-np.pi, np.pi, (N_TRAIN + N_TEST, 6))
    return OffsetTask(angles, nominal_chain(offsets).tip_in_base(angles), offsets)


def offsets_solved(task: OffsetTask) -> IdentificationResult:
    """The six offsets, as rotations about the joints' own axes, from the training poses."""
    chain = nominal_chain()
    about_z = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    offsets = [Term(f"J{i} offset", i, about_z, Constant(), "offsets", PRIOR, learn=False) for i in range(1, 7)]
    references = [Points(np.arange(N_TRAIN), task.positions[:N_TRAIN])]
    return identify(chain, ArmState(chain, task.angles[:N_TRAIN]), offsets, references)


def test_mean(chain: Chain, task: OffsetTask) -> float:
    """Mean error on the test poses [mm]."""
    tips = chain.tip_in_base(task.angles[N_TRAIN:])
    return float(np.linalg.norm(tips - task.positions[N_TRAIN:], axis=1).mean())


def offset_error(offsets: np.ndarray, task: OffsetTask) -> float:
    """Largest error of the five offsets that positions determine [rad]."""
    return float(np.abs(offsets - task.offsets)[:5].max())


@ROWS.row("pybotics", quick={"runs": 1})
def pybotics(seed: int = 0, runs: int = 21, peer: str | None = None) -> RowResult:
    """The calibration example of pybotics (``examples/calibration.ipynb`` of pybotics 3).

    A UR10 as modified D-H table whose six joint offsets are off by up to +-0.1 deg, 1000 random poses with exact
    positions, 700 to learn from, 300 to test, the six offsets sought. The tip lies on the sixth axis: positions say
    nothing of the sixth offset, and both leave it where it was.
    """
    task = offset_task(seed)
    times = times_of(lambda: offsets_solved(task), runs=runs)
    fit = offsets_solved(task)
    mean, off = test_mean(fit.chain, task), offset_error(fit.coefficients, task)
    std = np.sqrt(fit.covariance.diagonal())
    planted = zip(task.offsets.tolist(), fit.coefficients.tolist(), std.tolist(), strict=True)
    table = [
        {"joint": i, "planted [rad]": f"{a:+.12f}", "found [rad]": f"{b:+.12f}", "u [rad]": u}
        for i, (a, b, u) in enumerate(planted, start=1)
    ]
    targets = [
        Target("fit of 700 poses, median [s]", times.median, 0.05),
        Target("test mean [mm]", mean, 1e-5),
        Target("largest error of an offset that positions determine [rad]", off, 1e-9),
    ]
    notes = [
        f"fit of {N_TRAIN} poses: {1e3 * times.shortest:.1f} ms, median of {runs} runs {1e3 * times.median:.1f} ms",
        f"test mean of {N_TEST} poses: {test_mean(nominal_chain(), task):.4f} mm -> {mean:.2g} mm",
        "Positions do not determine the offset of joint 6: its uncertainty stays that of the prior.",
    ]
    if peer:
        given = {"table": UR10_MDH, "angles": task.angles, "positions": task.positions, "n_train": N_TRAIN}
        answer = answer_of(peer, "pybotics", given)
        if "failed" in answer:
            answer["see"] = "--help, how to install it"
        else:
            answer["largest offset error [rad]"] = offset_error(np.array(answer.pop("offsets_rad")), task)
            answer["times as long"] = answer["seconds"] / times.median
        notes.append(f"pybotics: {answer}")
    return RowResult(table, targets, notes)


# robotkinecal: all constants of a Panda -------------------------------------------------------------------------------

ANGLE_STD, LENGTH_STD = 1e-3, 0.5  # rad, mm; of every component of every joint
POINT_NOISE, TURN_NOISE = 0.02, 2e-5  # mm, rad
LEVEL = 0.95
STEP = 1e-5  # rad, mm
TASKS = {"100 poses": (100, True), "200 poses": (200, True), "200 positions": (200, False)}


@dataclass(frozen=True)
class PoseTask:
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


def pose_task(name: str, seed: int) -> PoseTask:
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
    return PoseTask(angles[:n], R.as_matrix(), points, angles[n:], truth, full)


def terms_of(task: PoseTask) -> list[Term]:
    """All constants, base and tip free; with orientations the tool's as well."""
    chain = nominal()
    return [*constants(chain), *(tool_rotation(chain) if task.full else [])]


def references_of(task: PoseTask) -> list[Reference]:
    """What was seen."""
    rows = np.arange(len(task.angles))
    return [Points(rows, task.points), *([Orientations(rows, task.R)] if task.full else [])]


def pose_solved(task: PoseTask) -> IdentificationResult:
    """The arm, from its drawing."""
    return identify(nominal(), ArmState(nominal(), task.angles), terms_of(task), references_of(task))


def rank(task: PoseTask) -> tuple[int, float]:
    """Combinations of constants that the readings tell about the arm as drawn, and the gap to those they do not."""
    perturbed_chain = PerturbedChain(nominal(), tuple(terms_of(task)))
    problem = SmallMotionProblem(perturbed_chain, ArmState(nominal(), task.angles), tuple(references_of(task)))
    # By difference quotients, as nothing else needs the Jacobian as a matrix: exact to 1e-9 of a column.
    by = [
        [(a - b) / (2 * STEP) for a, b in zip(problem.residuals(step), problem.residuals(-step), strict=True)]
        for step in STEP * np.eye(problem.n_parameters)
    ]
    jacobian = np.array([np.concatenate([each.ravel() for each in column]) for column in by]).T
    length = np.linalg.norm(jacobian, axis=0)
    return rank_and_gap(np.linalg.svd(jacobian[:, length > 0] / length[length > 0], compute_uv=False))


def errors(found: IdentificationResult, task: PoseTask) -> np.ndarray:
    """(N_TEST, 3) errors of tips in new poses [mm]."""
    return found.tips(ArmState(nominal(), task.test)) - task.truth.tip_in_base(task.test)


def covered(found: IdentificationResult, task: PoseTask) -> float:
    """Share of new tips within the ellipsoid of their stated covariance."""
    error = errors(found, task)
    inverse = np.linalg.inv(found.tip_covariance(ArmState(nominal(), task.test)))
    return float((np.einsum("ni,nij,nj->n", error, inverse, error) < chi2.ppf(LEVEL, 3)).mean())


def robotkinecal_answer(python: str, task: PoseTask) -> dict[str, Any]:
    """What robotkinecal makes of the same numbers, in metres."""
    to_link8 = Rotation.from_euler("z", 45, degrees=True).as_matrix()  # ours is turned with the hand
    readings = {"angles": task.angles, "R": task.R @ to_link8, "points": task.points / 1e3, "full": task.full}
    answer = answer_of(python, "robotkinecal", readings | {"test": task.test})
    if "failed" in answer:
        return {"readings": f"  robotkinecal: {answer['failed']}; --help says how to install it"}
    error = 1e3 * np.array(answer["test_points"]) - task.truth.tip_in_base(task.test)
    return {
        "readings": f"  robotkinecal {answer['version']}",
        "median [ms]": 1e3 * answer["seconds"],
        "CPU [ms]": 1e3 * answer["cpu_seconds"],
        "rank": f"{answer['rank']} of {answer['of']}",
        "after": float(np.linalg.norm(error, axis=1).mean()),
    }


@ROWS.row("robotkinecal", quick={"runs": 1, "arms": 2})
def robotkinecal(seed: int = 0, runs: int = 21, arms: int = 60, peer: str | None = None) -> RowResult:
    """A Panda from 100 or 200 full poses and from 200 positions, as robotkinecal does it.

    Every joint is off by random motions, 1 mrad and 0.5 mm in each component; the flange is seen with noise of 20 um
    and 20 urad. Both solve from the drawing. The flange's origin lies on the seventh axis, so positions leave two of
    the 4 x 7 + 3 combinations open that they would tell of another arm: the rank is that at the drawing. Coverage is
    that of true tips of drawn arms, in new poses, by the 95 % ellipsoids of their stated covariance.
    """
    tasks = {name: pose_task(name, seed) for name in TASKS}
    works = {name: lambda task=task: pose_solved(task) for name, task in tasks.items()}
    times = times_of_each(works, runs=runs)
    table, targets = [], []
    for name, task in tasks.items():
        found = pose_solved(task)
        (told, gap), of = rank(task), 4 * 7 + (6 if task.full else 3)
        drawn = [pose_task(name, seed + 1 + i) for i in range(arms)]
        coverage = float(np.mean([covered(pose_solved(each), each) for each in drawn]))
        before = nominal().tip_in_base(task.test) - task.truth.tip_in_base(task.test)
        # A busy machine stretches processor time less than the clock's.
        cpu = float(np.median([cpu_seconds_of(works[name]) for _ in range(runs)]))
        table.append({
            "readings": name,
            "shortest [ms]": 1e3 * times[name].shortest,
            "median [ms]": 1e3 * times[name].median,
            "CPU [ms]": 1e3 * cpu,
            "rank": f"{told} of {of}",
            "gap": gap,
            "test before [mm]": float(np.linalg.norm(before, axis=1).mean()),
            "after": float(np.linalg.norm(errors(found, task), axis=1).mean()),
            "coverage": coverage,
        })  # fmt: skip
        table += [robotkinecal_answer(peer, task)] if peer else []
        targets += [
            Target(f"{name}: fit, median [CPU s]", cpu, 0.1),
            Target(f"{name}: rank off what geometry says", abs(told - (of if task.full else of - 2)), 0),
            Target(f"{name}: coverage of {LEVEL:.0%} ellipsoids", coverage, 0.93, "above"),
            Target(f"{name}: the same", coverage, 0.97),
        ]
    return RowResult(table, targets)
