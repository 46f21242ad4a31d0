"""Connected arms: acknowledged readings survive the end of the program; the time of a corrected tip."""

from __future__ import annotations

import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import truearm as ta
from benchmarks.rows import RowResult, Rows, Target
from truearm.identification.planning.candidates import volume_poses
from truearm.identification.planning.sampling.measuring import inner_limits, measuring_poses
from truearm.identification.planning.sampling.workspace import Sector, in_sector, is_above_table, stance
from truearm.identification.references.alignment import align
from truearm.identification.terms import ArmState
from truearm.identification.virtual import VirtualArm
from truearm.readings import read_session
from truearm.sources import Sample, Source, StandstillRule
from truearm.typing import FloatArray
from truearm.workflows.corrected_tip import corrected_tip
from truearm.workflows.learning import Learning
from truearm.workflows.poses_to_measure import PosesToMeasure
from truearm.workflows.record_readings import record

ROWS = Rows()


def _restless() -> Iterator[Sample]:
    """An arm that stops at another pose a hundred times faster than a person could."""
    for k in range(10**9):
        yield Sample(k / 20, np.full(6, 0.5 * (k // 12 % 7)), np.arange(3.0) + k)


def _take_and_acknowledge(out: Path, writing: int) -> None:
    """What the child does until it is killed."""
    for event in record(Source("restless", _restless, has_points=True), out, rule=StandstillRule()):
        if event.kind == "reading":
            os.write(writing, b"+")


def _killed_once(out: Path, after: int, later_s: float) -> int:
    """Number of readings that a child acknowledged before it was killed, some time after a number of them."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            _take_and_acknowledge(out, writing)
        finally:
            os._exit(1)
    os.close(writing)
    acknowledged = 0
    while acknowledged < after:
        if not os.read(reading, 1):
            raise RuntimeError("the child ended by itself")
        acknowledged += 1
    time.sleep(later_s)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    while said := os.read(reading, 65536):
        acknowledged += len(said)
    os.close(reading)
    return acknowledged


@ROWS.row("kills", "kill -9 at random moments while readings are taken: acknowledged readings that are not in the file")
def kills(n: int = 50) -> RowResult:
    """Each kill continues the file of the one before."""
    moments, lost, more, acknowledged = random.Random(1), 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "session.csv"
        before = 0
        for _ in range(n):
            said = _killed_once(out, moments.randint(0, 40), moments.uniform(0, 0.01))
            now = len(read_session(out)) if out.exists() and out.read_bytes().count(b"\n") > 1 else 0
            lost += max(0, before + said - now)
            more += max(0, now - before - said)
            before, acknowledged = now, acknowledged + said
    row: dict[str, Any] = {"kills": n, "acknowledged": acknowledged, "lost": lost, "written, not acknowledged": more}
    return RowResult([row], [Target("acknowledged readings lost", lost, 0), Target("kills", n, n, "above")])


@ROWS.row("tip", "corrected tip of a sample with its covariance, physical model of 200 readings, 99 % of samples")
def tip(n: int = 500, readings: int = 200) -> RowResult:
    """CPU time of one thread, with the directions of movement known as a connected arm shows them, and unknown."""
    session = ta.simulate("ur10", poses=readings, seed=1).session
    model = ta.fit("ur10", session, model="physical").model
    rows: list[dict[str, Any]] = []
    for known, directions in (("known", np.ones(6)), ("unknown", np.zeros(6))):
        times = []
        for k in range(n):
            sample, start = Sample(0.0, session.angles[k % readings], temperature_degC=20.5), time.thread_time()
            corrected_tip(model, sample, directions)
            times.append(1e3 * (time.thread_time() - start))
        median, slow = np.percentile(times, [50, 99])
        rows.append({"directions": known, "median [ms]": float(median), "99 % below [ms]": float(slow)})
    return RowResult(rows, [Target("directions known, 99 % below [ms]", rows[0]["99 % below [ms]"], 5.0)])


@ROWS.row("learn", "what a reading adds, and which of 200 poses comes next, 200 readings, physical model")
def learn(n: int = 20, readings: int = 200) -> RowResult:
    """CPU time of one thread after a reading: the update, and the choice of the next pose with the look ahead."""
    session = ta.simulate("ur10", poses=readings + n, seed=1).session
    fitted = ta.fit("ur10", session.rows(np.arange(40)), model="physical").model
    arm, rows = ta.load_arm("ur10"), list[dict[str, Any]]()
    for known, model in (("nominal arm", None), ("physical model", fitted)):
        learning, poses = Learning(arm, model), PosesToMeasure(arm, None, is_ranked=True)
        [*learning.learn(session.rows(np.arange(readings)))]
        updates, rankings = [], []
        for k in range(readings, readings + n):
            start = time.thread_time()
            [*learning.learn(session.rows(np.arange(k + 1)))]
            updated = time.thread_time()
            [*poses.choose(set(), learning, "", session.angles[k])]
            updates.append(1e3 * (updated - start))
            rankings.append(1e3 * (time.thread_time() - updated))
        m = len(learning.estimate.parameters)
        rows.append(
            {"known before": known, "parameters": m, "update [ms]": max(updates[1:]), "ranking [ms]": max(rankings[1:])}
        )
    slowest = [max(row[name] for row in rows) for name in ("update [ms]", "ranking [ms]")]
    return RowResult(rows, [Target("update [ms]", slowest[0], 50.0), Target("ranking [ms]", slowest[1], 300.0)])


WALK_DEG, WALK_JOINTS = 30.0, (1, 2, 3)  # a technician's next pose: so many joints, moved by so much (normal)


def _walk(arm: ta.Arm, n: int, seed: int) -> FloatArray:
    """Poses of a technician without a plan: from the working pose on, one to three joints at a time.

    The tip stays in front of the arm and above the table, as in `truearm.identification.planning.sampling`.
    """
    random, where = np.random.default_rng(seed), stance(arm)
    lower, upper = inner_limits(arm)
    poses = [arm.working]
    while len(poses) < n:
        joints = random.permutation(arm.n_joints)[: random.choice(WALK_JOINTS)]
        pose = poses[-1].copy()
        pose[joints] += np.radians(WALK_DEG) * random.standard_normal(len(joints))
        tip = arm.chain.tip_in_base(pose[None])
        inside = in_sector(tip, where, Sector()) & is_above_table(arm.chain, pose[None], tip)
        if inside[0] and (pose > lower).all() and (pose < upper).all():
            poses.append(pose)
    return np.array(poses)


def _true_rms_mm(learning: Learning, virtual: VirtualArm, volume: FloatArray) -> float:
    """Error of the estimate's tips in the volume, after the frame is fitted, three-dimensional root mean square."""
    estimate = learning.estimate
    chain = estimate.perturbed_chain
    tips = chain.tips(ArmState.of(learning.arm, volume), estimate.parameters[: chain.n_coefficients])
    true = virtual.true_tip(volume)
    T = align(tips, true)
    return float(np.sqrt(((tips @ T[:3, :3].T + T[:3, 3] - true) ** 2).sum(axis=1).mean()))


def _listed(chosen: FloatArray) -> Callable[[Learning, int], FloatArray]:
    return lambda _, k: chosen[k]


def _ranked(arm: ta.Arm) -> Callable[[Learning, int], FloatArray]:
    """The pose that truearm says next; the first is the working pose."""
    poses = PosesToMeasure(arm, None, is_ranked=True)

    def next_pose(learning: Learning, k: int) -> FloatArray:
        if k == 0:
            return arm.working
        [*poses.choose(set(), learning, "", arm.working if poses.aim_rad is None else poses.aim_rad)]
        assert poses.aim_rad is not None
        return poses.aim_rad

    return next_pose


def _course(
    virtual: VirtualArm, next_pose: Callable[[Learning, int], FloatArray], volume: FloatArray, n: int
) -> FloatArray:
    """(n, 2) uncertainty and true error in the volume after each reading [mm]."""
    learning, taken, said = Learning(virtual.nominal), list[ta.Session](), []
    for k in range(n):
        taken.append(virtual.measure(next_pose(learning, k)[None], seed=1000 * virtual.seed + k).readings)
        points = [one.points for one in taken if one.points is not None]
        [*learning.learn(ta.Session(np.concatenate([one.angles for one in taken]), points=np.concatenate(points)))]
        said.append((learning.uncertainty_mm, _true_rms_mm(learning, virtual, volume)))
    return np.array(said)


@ROWS.row("guided", "readings to the same uncertainty, the next pose ranked against a technician's own choice")
def guided(seeds: int = 20, readings: int = 60, arm_name: str = "ur10") -> RowResult:
    """Virtual arms of the preset research under a tracker; the technician stops after some readings.

    A technician's own choice is a walk (see `_walk`), or the poses of a person who measures parts
    (`measuring_poses`). Counted are the readings until the uncertainty in the volume is that of the technician's last
    reading, and until the true error in the volume is.
    """
    arm = ta.load_arm(arm_name)
    volume = volume_poses(arm, 200, seed=2)
    shares: dict[tuple[str, str], list[float]] = {}
    for seed in range(1, seeds + 1):
        virtual = VirtualArm.draw(arm, "research", seed=seed)
        with_rank = _course(virtual, _ranked(arm), volume, readings)
        own = {"walk": _walk(arm, readings, seed), "measures parts": measuring_poses(arm, readings, seed=seed).angles}
        for name, chosen in own.items():
            without = _course(virtual, _listed(chosen), volume, readings)
            for column, what in enumerate(("uncertainty", "true error")):
                reached = np.flatnonzero(with_rank[:, column] <= without[-1, column])
                needed = reached[0] + 1 if len(reached) else readings
                shares.setdefault((name, what), []).append(needed / readings)
    table = [
        {
            "technician": name,
            "until the same": what,
            "readings, median [%]": 100 * float(np.median(found)),
            "least [%]": 100 * min(found),
            "most [%]": 100 * max(found),
        }
        for (name, what), found in shares.items()
    ]
    worst = max(float(np.median(found)) for (_, what), found in shares.items() if what == "uncertainty")
    return RowResult(table, [Target("readings to the same uncertainty, median [%]", 100 * worst, 60.0)])


if sys.platform == "win32":
    del ROWS["kills"]  # there is no fork
