"""Two logs of one run joined by time: error of the clocks' offset and drift, and of the readings."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import truearm as ta
from benchmarks.rows import RowResult, Rows
from truearm.errors import InputError
from truearm.pages.palette import NAVY, ORANGE
from truearm.pages.plotting import Figure, figure_style, make_panel
from truearm.typing import FloatArray
from truearm.wings.importing.foreign.joined_logs import join_tables
from truearm.wings.importing.tables.table import Table

ROWS = Rows()


@dataclass(frozen=True)
class Run:
    """How a robot was moved, and both instruments recorded it."""

    poses: int = 60
    joint_rate: float = 125.0
    tip_rate: float = 50.0
    noise_mm: float = 0.02
    offset_s: float = 73.4
    drift: float = 40e-6
    reach_deg: float = 60.0  # of each joint about the working pose
    speed: float = 1.0  # of the fastest joint [rad/s]
    rest_s: tuple[float, float] = (1.5, 3.0)
    same_duration: bool = False  # all moves last equally long
    repeats: int = 1  # of the program
    lost: float = 0.0  # share of the moves at which the tracker loses its target
    quantum_deg: float = 0.0  # step of the encoders
    ripple_deg: float = 0.0  # noise of the joints
    vibration_mm: float = 0.0  # of the tip at 9 Hz, dying away within 0.3 s of a move's end
    late_start_s: float = 20.0  # the tracker starts so much later, and ends so much earlier


def virtual_logs(run: Run, seed: int = 0) -> tuple[Table, Table, FloatArray, FloatArray]:
    """Logs of a virtual UR5's moves of minimum jerk between poses, and the poses with their tips."""
    rng = np.random.default_rng(seed)
    simulated = ta.simulate("ur5", poses=run.poses, half_width_deg=run.reach_deg, seed=seed, arm_seed=seed)
    poses = np.tile(simulated.session.angles, (run.repeats, 1))
    span = np.abs(np.diff(poses, axis=0)).max(axis=1)
    lasts = np.full(len(span), 2.0) if run.same_duration else 1.875 * span / run.speed
    rests = rng.uniform(*run.rest_s, run.poses)
    rests = np.full(len(poses), rests[0]) if run.same_duration else np.tile(rests, run.repeats)
    starts = np.cumsum(rests)[:-1] + np.r_[0.0, np.cumsum(lasts)[:-1]]
    end = starts[-1] + lasts[-1] + rests[-1]

    def angles_at(t: FloatArray) -> FloatArray:
        k = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(starts) - 1)
        s = np.clip((t - starts[k]) / lasts[k], 0.0, 1.0)
        s = s**3 * (10 - 15 * s + 6 * s**2)
        return poses[k] + s[:, None] * (poses[k + 1] - poses[k])

    def tips_at(t: FloatArray) -> FloatArray:
        tips = np.concatenate(
            [simulated.virtual.true_tip(angles_at(part)) for part in np.array_split(t, 1 + len(t) // 4000)]
        )
        k = np.clip(np.searchsorted(starts + lasts, t, side="right") - 1, 0, None)
        since = t - (starts + lasts)[k]
        shake = np.where(since > 0, np.exp(-np.maximum(since, 0) / 0.3) * np.sin(2 * np.pi * 9 * since), 0.0)
        return np.asarray(tips + run.vibration_mm * shake[:, None])

    t = np.arange(0.0, end, 1 / run.joint_rate)
    q = angles_at(t) + np.radians(run.ripple_deg) * rng.standard_normal((len(t), poses.shape[1]))
    if run.quantum_deg:
        q = np.radians(run.quantum_deg) * np.round(q / np.radians(run.quantum_deg))
    true = np.arange(run.late_start_s, end - run.late_start_s, 1 / run.tip_rate)
    tips = tips_at(true) + run.noise_mm * rng.standard_normal((len(true), 3))
    middle = float(true.mean())
    shown = middle - run.offset_s + (true - middle) / (1 + run.drift)
    for start in rng.choice(starts, round(run.lost * len(starts)), replace=False):
        tips[(true > start) & (true < start + 0.8)] = 0.0
    names = ("time_s", *(f"q{i + 1}" for i in range(poses.shape[1])))
    joints = table(names, [t, *q.T])
    return (
        joints,
        table(("time_s", "x_mm", "y_mm", "z_mm"), [shown, *tips.T]),
        poses,
        tips_at(np.append(starts, end) - 1e-3),
    )


def table(names: tuple[str, ...], columns: list[FloatArray]) -> Table:
    """A table of numbers."""
    return Table(names, ("",) * len(names), tuple(columns), np.arange(2, len(columns[0]) + 2))


def errors_of(run: Run, seed: int, **options: Any) -> dict[str, float]:
    """Join the logs of a run and compare with what was planted."""
    joints, points, poses, tips = virtual_logs(run, seed)
    joined = join_tables(joints, points, "time", **options)
    clock = joined.clock
    assert clock is not None
    true = run.offset_s + run.drift * (clock.at_s - points.numbers(0).mean())
    q, p = (np.stack([joined.numbers(i) for i in some], axis=1) for some in (range(1, 7), range(-3, 0)))
    nearest = np.argmin(np.abs(q[:, None] - poses).max(axis=2), axis=1)
    return {
        "offset_ms": 1e3 * (clock.offset_s - true),
        "u_ms": 1e3 * clock.u_offset_s,
        "drift_ppm": 1e6 * (clock.drift - run.drift),
        "u_ppm": 1e6 * clock.u_drift,
        "readings": len(joined),
        "angle_deg": float(np.degrees(np.abs(q - poses[nearest]).max())),
        "tip_mm": float(np.sqrt(((p - tips[nearest]) ** 2).mean())),
    }


def rms(values: FloatArray) -> str:
    """Root mean square, as the table has it."""
    return f"{np.sqrt(np.mean(values**2)):.2f}"


KINDS = {
    "as recorded by a UR5 and a tracker": Run(),
    "moves of equal duration": Run(same_duration=True),
    "tracker at 10 Hz": Run(tip_rate=10.0),
    "log at 500 Hz, tracker at 1 kHz": Run(joint_rate=500.0, tip_rate=1000.0, poses=25),
    "camera: 0.2 mm of noise, 30 Hz": Run(tip_rate=30.0, noise_mm=0.2),
    "encoders of 12 bit": Run(quantum_deg=360 / 4096),
    "ripple of 0.01 degrees": Run(ripple_deg=0.01),
    "tip shakes by 0.5 mm": Run(vibration_mm=0.5),
    "tracker loses a third of the moves": Run(lost=0.33),
    "joints go up to 150 degrees from the working pose": Run(reach_deg=150.0),
    "slow: 0.1 rad/s": Run(speed=0.1, poses=20),
    "8 poses": Run(poses=8, late_start_s=2.0),
    "2 poses": Run(poses=2, late_start_s=0.5),
}


@ROWS.row("clocks", quick={"seeds": 1}, is_long=True)
def clocks(seeds: int = 20) -> Iterator[dict[str, Any]]:
    """Error of offset and drift over their stated standard uncertainties, and errors of readings."""
    for kind, run in KINDS.items():
        found, refused = [], 0
        for seed in range(seeds):
            try:
                found.append(errors_of(run, seed))
            except InputError as error:
                refused += 1
                print(f"{kind}, seed {seed}: {error}")
        row: dict[str, Any] = {"runs": kind, "refused": refused}
        if found:
            of = {name: np.array([one[name] for one in found]) for name in found[0]}
            row |= {
                "u offset [ms]": f"{np.median(of['u_ms']):.2g}",
                "rms error/u": rms(of["offset_ms"] / of["u_ms"]),
                "drift u [ppm]": f"{np.median(of['u_ppm']):.2g}" if of["u_ppm"].all() else "-",
                "drift rms error/u": rms(of["drift_ppm"] / of["u_ppm"]) if of["u_ppm"].all() else "-",
                "readings": f"{np.mean(of['readings']):.1f}",
                "angle [deg]": f"{np.max(of['angle_deg']):.2g}",
                "tip rms [mm]": f"{np.sqrt(np.mean(of['tip_mm'] ** 2)):.2g}",
            }
        yield row


EXAMPLE = Run(poses=60, reach_deg=70.0, late_start_s=-4.0, vibration_mm=0.2, ripple_deg=0.0005, lost=0.1)


@ROWS.row("files", is_long=True)
def files(folder: str = ".") -> RowResult:
    """Write robot.csv and tracker.csv of docs/two-logs.md, and draw the two speeds into two-logs.png."""
    joints, points, _, _ = virtual_logs(EXAMPLE, 1)
    names = ["timestamp", *(f"actual_q_{i}" for i in range(6))]
    data = np.stack([joints.numbers(i) for i in range(7)], axis=1) + [5211.008, *[0.0] * 6]
    np.savetxt(
        f"{folder}/robot.csv", data, fmt=["%.3f", *["%.6f"] * 6], delimiter=",", header=",".join(names), comments=""
    )
    start = datetime.datetime(2026, 5, 11, 9, 14, 3)
    shown = points.numbers(0) - points.numbers(0)[0]
    with open(f"{folder}/tracker.csv", "w", encoding="cp1252", newline="\r\n") as file:
        file.write("Zeit;X [mm];Y [mm];Z [mm]\n")
        for t, *tip in zip(shown, *(points.numbers(i) for i in (1, 2, 3)), strict=True):
            stamp = (start + datetime.timedelta(seconds=float(t))).strftime("%d.%m.%Y %H:%M:%S.%f")[:-3]
            file.write(
                ";".join([stamp, *(f"{value:.4f}" for value in tip)]).replace(".", ",").replace(",", ".", 2) + "\n"
            )
    picture(joints, points, f"{folder}/two-logs.png")
    return RowResult(notes=[f"robot.csv, tracker.csv and two-logs.png in {folder}"])


def picture(joints: Table, points: Table, file: str) -> None:
    """Draw the speeds of joints and tip over their own clocks, and over one."""
    clock = join_tables(joints, points, "time").clock
    assert clock is not None
    with figure_style():
        panels = []
        for title, shift in (("Each on its own clock", 0.0), ("After alignment", 1.0)):
            panel, (axes,) = make_panel(5.4, 2.0)
            for one, last, name, color in ((joints, 7, "joints", NAVY), (points, 4, "tip", ORANGE)):
                t = one.numbers(0)
                values = np.stack([one.numbers(i) for i in range(1, last)], axis=1)
                values[(values == 0).all(axis=1)] = np.nan
                speed = np.linalg.norm(values[10:] - values[:-10], axis=1) / (t[10:] - t[:-10])
                at = t[5:-5] if one is joints else t[5:-5] + shift * (clock.to_joints(t[5:-5]) - t[5:-5])
                axes.plot(at, speed / np.nanquantile(speed, 0.995), color=color, label=name, linewidth=0.9)
            axes.set_xlim(100, 160)
            axes.set_xlabel("time of the joints' clock [s]" if shift else "time as recorded [s]")
            axes.set_title(f"{title}: speed / fastest")
            axes.legend(loc="upper right")
            panels.append(panel)
        alt = "Speeds of joints and tip before and after alignment."
        Figure(tuple(panels), "Speeds of two logs.", alt, columns=1).save(file)
