"""Connected arms: kills while readings are taken; the time of a corrected tip; hours of samples with a page."""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import signal
import socket
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from itertools import islice
from math import radians
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

import truearm as ta
from benchmarks.rows import RowResult, Rows, Target
from truearm.identification.references.alignment import align
from truearm.identification.terms import ArmState
from truearm.readings import read_session
from truearm.typing import FloatArray
from truearm.wings.bench.recording.learning import Learning, PosesToMeasure
from truearm.wings.bench.recording.model_in_force import corrected_tip
from truearm.wings.bench.recording.record_readings import record
from truearm.wings.bench.sources import Sample, Source, StandstillRule
from truearm.wings.planning.designs.candidates import volume_poses
from truearm.wings.planning.designs.sampling import inner_limits, measuring_poses
from truearm.wings.planning.designs.workspace import Sector, in_sector, is_above_table, stance
from truearm.wings.planning.virtual import VirtualArm

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


def _whole_readings(out: Path) -> int:
    """Number of readings in the whole lines of a file: a kill may cut the last one short, not acknowledged then."""
    content = out.read_bytes() if out.exists() else b""
    lines = content[: content.rfind(b"\n") + 1]
    if lines.count(b"\n") < 2:
        return 0
    whole = out.with_name("whole.csv")
    whole.write_bytes(lines)
    return len(read_session(whole))


@ROWS.row(
    "kills",
    "kill -9 at random moments while readings are taken: acknowledged readings that are not in the file",
    quick={"n": 3},
)
def kills(n: int = 50) -> RowResult:
    """Each kill continues the file of the one before."""
    moments, lost, more, acknowledged = random.Random(1), 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "session.csv"
        before = 0
        for _ in range(n):
            said = _killed_once(out, moments.randint(0, 40), moments.uniform(0, 0.01))
            now = _whole_readings(out)
            lost += max(0, before + said - now)
            more += max(0, now - before - said)
            before, acknowledged = now, acknowledged + said
    row: dict[str, Any] = {"kills": n, "acknowledged": acknowledged, "lost": lost, "written, not acknowledged": more}
    # 0 to 40 before a kill, 20 in the mean: a child that acknowledges nothing could lose nothing.
    targets = [
        Target("acknowledged readings lost", lost, 0),
        Target("acknowledged a kill", acknowledged / n, 10, "above"),
    ]
    return RowResult([row], targets)


@ROWS.row(
    "tip",
    "corrected tip of a sample with its covariance, physical model of 200 readings, 99 % of samples",
    quick={"n": 20, "readings": 60},
)
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


# With a page ----------------------------------------------------------------------------------------------------------

COUNT_RAD, SECOND_RAD = 1e-8, 1e-3  # of J5 a packet, of J6 a second: a sample says which it is, and when it was sent


def _controller(pipe: Connection, rate_hz: float, seconds: float) -> None:
    """A Universal Robots controller in a process of its own: says its port, the start, how many packets it has sent."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        pipe.send(server.getsockname()[1])
        robot, _ = server.accept()
    robot.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    answers = {"V": b"\1", "O": b"\7VECTOR6D,VECTOR6D,DOUBLE", "S": b"\1"}
    with robot, robot.makefile("rb") as stream:
        kind = ""
        while kind != "S":
            size, number = struct.unpack(">HB", stream.read(3))
            stream.read(size - 3)
            kind = chr(number)
            robot.sendall(struct.pack(">HB", 3 + len(answers[kind]), number) + answers[kind])
        start_s, n = time.monotonic(), 0
        pipe.send(start_s)
        while (sent_s := time.monotonic() - start_s) < seconds:
            angles = 0.5, -1.5, 1.5, 0.2, COUNT_RAD * n, SECOND_RAD * sent_s
            robot.sendall(struct.pack(">HBB13d", 108, ord("U"), 7, *angles, *[30.0] * 6, 2.0))
            n += 1
            time.sleep(max(0.0, start_s + n / rate_hz - time.monotonic()))
    pipe.send(n)


def _page(pipe: Connection, url: str, take_every: int) -> None:
    """What a page does, in a process of its own: says when each pose arrived, and its J6.

    It asks for a reading every so many poses; never if that is 0.
    """
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    arrived: list[tuple[float, float]] = []
    with connect(f"ws{url.removeprefix('http')}live", proxy=None) as stream, suppress(ConnectionClosed):
        pipe.send("connected")
        for text in stream:
            message = json.loads(text)
            if message["message"] == "pose":
                arrived.append((time.monotonic(), message["joints"][5]))
                if take_every and len(arrived) % take_every == 0:
                    stream.send(json.dumps({"command": "take"}))
    pipe.send(arrived)


@dataclass
class _Watched:
    """A source whose samples are counted, and what the process needs meanwhile, once a second."""

    source: Source
    n: int = 0
    missing: int = 0
    memory_mb: list[float] = field(default_factory=list)
    handles: list[int] = field(default_factory=list)

    def samples(self) -> Iterator[Any]:
        """The samples, until the connection is lost."""
        last: float | None = None
        for one in self.source.samples():
            if isinstance(one, Sample):
                count = one.joint_angles_rad[4] / COUNT_RAD
                self.n, self.missing = self.n + 1, self.missing + (0 if last is None else round(count - last) - 1)
                last = count
            elif self.n:
                return
            yield one

    def watch(self, ends: threading.Event) -> None:
        """Note memory and file handles until the end."""
        page = os.sysconf("SC_PAGE_SIZE")
        while not ends.wait(1.0):
            self.memory_mb.append(int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]) * page / 1e6)
            self.handles.append(len(os.listdir("/proc/self/fd")))

    def growth_percent(self) -> float:
        """Of the memory, from the mean of the second tenth of the time to that of the last."""
        tenth = max(1, len(self.memory_mb) // 10)
        return 100 * (float(np.mean(self.memory_mb[-tenth:]) / np.mean(self.memory_mb[tenth : 2 * tenth])) - 1)


def _shown(watched: _Watched, *, take_every: int = 0, **options: Any) -> tuple[list[tuple[float, float]], int]:
    """Record a source with a page; when each pose arrived there and its J6, and the number of readings taken."""
    spawn, ends = multiprocessing.get_context("spawn"), threading.Event()
    here, there = spawn.Pipe()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        source = Source("watched", watched.samples, has_points=watched.source.has_points)
        events = ta.live(source, Path(folder) / "session.csv", port=0, **options)
        page = spawn.Process(target=_page, args=(there, next(events).values["url"], take_every))
        page.start()
        stack.callback(page.join)
        here.recv()
        watching = threading.Thread(target=watched.watch, args=(ends,))
        watching.start()
        stack.callback(watching.join)
        stack.callback(ends.set)
        readings = sum(event.kind == "reading" for event in events)
        arrived: list[tuple[float, float]] = here.recv()
    return arrived, readings


@ROWS.row(
    "stream",
    "RTDE at 500 samples a second, corrected tip, page at 20 frames a second: loss, delay, memory",
    quick={"seconds": 3.0, "readings": 60},
)
def stream(seconds: float = 300.0, readings: int = 200) -> RowResult:
    """The delay is from the packet of the controller to the message at the page, which are processes of their own."""
    session = ta.simulate("ur10", poses=readings, seed=1).session
    model = ta.fit("ur10", session, model="physical").model
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    controller = spawn.Process(target=_controller, args=(there, 500.0, seconds))
    controller.start()
    watched = _Watched(ta.open_source(f"rtde:127.0.0.1:{here.recv()}@500"))
    cpu_s = time.process_time()
    arrived, _ = _shown(watched, model=model)
    cpu_s = time.process_time() - cpu_s
    start_s, sent = here.recv(), here.recv()
    controller.join()
    delays = [1e3 * (at_s - start_s - radians(j6_deg) / SECOND_RAD) for at_s, j6_deg in arrived]
    median, slow = (float(value) for value in np.percentile(delays, [50, 99]))
    row: dict[str, Any] = {
        "seconds": seconds,
        "packets": sent,
        "lost": sent - watched.n + watched.missing,
        "frames a second": len(arrived) / seconds,
        "delay, median [ms]": median,
        "99 % below [ms]": slow,
        "memory [MB]": watched.memory_mb[-1],
        "growth [%]": watched.growth_percent(),
        "handles": f"{watched.handles[0]} to {watched.handles[-1]}",
        "CPU [%]": 100 * cpu_s / seconds,
    }
    return RowResult(
        [row],
        [
            Target("packets lost", row["lost"], 0),
            Target("growth of memory [%]", row["growth [%]"], 2.0),
            Target("delay with a page, 99 % below [ms]", slow, 5.0),
        ],
    )


@ROWS.row(
    "day",
    "eight hours of the virtual arm at 20 samples a second, as fast as they are taken, with a page",
    quick={"hours": 0.3},
)
def day(hours: float = 8.0) -> RowResult:
    """The number of samples is that of the hours; the page asks for a reading every second of its own.

    Readings stay in memory, for the page, and are learned: their part of the growth is in it.
    """
    n, arm = round(hours * 3600 * 20), ta.open_source("virtual:ur10@max")
    watched = _Watched(Source("virtual", lambda: islice(arm.samples(), n)))
    start_s = time.process_time()
    arrived, readings = _shown(watched, take_every=20, arm="ur10", on="key")
    row: dict[str, Any] = {
        "samples": watched.n,
        "frames": len(arrived),
        "readings": readings,
        "CPU [s]": time.process_time() - start_s,
        "memory [MB]": watched.memory_mb[-1],
        "growth [%]": watched.growth_percent(),
        "handles": f"{watched.handles[0]} to {watched.handles[-1]}",
    }
    more = watched.handles[-1] - watched.handles[0]
    return RowResult(
        [row],
        [
            Target("samples lost", n - watched.n, 0),
            Target("readings a second of the page", readings / (len(arrived) / 20), 0.8, "above"),
            Target("growth of memory [%]", row["growth [%]"], 2.0),
            Target("more handles", more, 0),
        ],
    )


@ROWS.row(
    "learn",
    "what a reading adds, and which of 200 poses comes next, 200 readings, physical model",
    quick={"n": 3, "readings": 60},
)
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
        row: dict[str, Any] = {"known before": known, "parameters": m}
        for what, times in (("update", updates), ("ranking", rankings)):
            row |= {f"{what}, median [ms]": float(np.median(times)), f"{what}, slowest [ms]": max(times)}
        rows.append(row)
    slowest = [max(row[f"{what}, slowest [ms]"] for row in rows) for what in ("update", "ranking")]
    return RowResult(
        rows, [Target("slowest update [ms]", slowest[0], 50.0), Target("slowest ranking [ms]", slowest[1], 300.0)]
    )


WALK_DEG, WALK_JOINTS = 30.0, (1, 2, 3)  # a technician's next pose: so many joints, moved by so much (normal)


def _walk(arm: ta.Arm, n: int, seed: int) -> FloatArray:
    """Poses of a technician without a plan: from the working pose on, one to three joints at a time.

    The tip stays in front of the arm and above the table, as in `truearm.wings.planning.designs.sampling`.
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


@ROWS.row(
    "guided",
    "readings to the same uncertainty, the next pose ranked against a technician's own choice",
    quick={"seeds": 1, "readings": 12},
)
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
if not Path("/proc/self/statm").exists():
    del ROWS["stream"], ROWS["day"]  # nothing says what a process needs
