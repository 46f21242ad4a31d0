"""Plans: accuracy against the number of poses by the strategy that chose them, and how far the joints move."""

from __future__ import annotations

import time
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.held_out import IDENTIFIED
from benchmarks.rows import RowResult, Rows
from truearm.arm import load_arm
from truearm.pages.plotting import Figure, figure_style, make_panel, set_log_scale, styles_of
from truearm.readings import Lengths
from truearm.typing import FloatArray
from truearm.wings.planning.designs.prior import nominal_prior
from truearm.wings.planning.designs.proposal import LENGTH_U_MM, STRATEGIES, Artefact, CalibrationPlan, propose
from truearm.wings.planning.designs.template import bars
from truearm.wings.planning.virtual import VirtualArm, load_preset

ROWS = Rows()
ARMS = ("measuring7", "gao2017", "ur10")
ARTEFACTS = ("tracker", "bar")
POSES = (10, 20, 30, 50, 100)
NOISE_MM, BAR_MM, POSES_A_PLACE = 0.02, 400.0, 20


@ROWS.row("strategies", quick={"draws": 1, "arms": ("ur10",), "poses": (10,), "artefacts": ("tracker",)})
def strategies(
    draws: int = 2,
    arms: tuple[str, ...] = ARMS,
    poses: tuple[int, ...] = POSES,
    artefacts: tuple[str, ...] = ARTEFACTS,
    figure: str | None = None,
) -> RowResult:
    """Error in the volume by the number of poses and the strategy, rms [mm]: median and range of virtual arms.

    For every number of poses the plans are made once for each nominal arm (`truearm.wings.planning.designs`, terms
    physical). Arms with the errors of the preset research are then measured at these poses, a physical model is
    identified, and its points at poses spread over the volume are compared with the true ones, after the frame is
    fitted. Tracker: points with noise, base and tip free. Bar: tips in its two seats, at places in turn, and its
    length; no point is ever seen.
    """
    rows = [row for a in artefacts for arm in arms for n in poses for row in rows_of(arm, a, n, draws)]
    if figure:
        drawing_of(rows, poses).save(Path(figure))
    table = []
    for artefact in artefacts:
        for n, model in (*((n, "physical") for n in poses), (50, "kinematic")):
            row = {"artefact": artefact, "poses": n, "model": model}
            for strategy in STRATEGIES if n in poses else ():
                found = errors(rows, artefact, n, strategy, of=model)
                row[strategy] = f"{np.median(found):.3f} ({min(found):.3f} to {max(found):.3f})"
            table.append(row)
    return RowResult(table)


def rows_of(name: str, artefact: str, n: int, draws: int) -> list[dict[str, Any]]:
    """Errors of all arms of one drawing, by every strategy."""
    arm = load_arm(name)
    bar = artefact == "bar"
    held = Artefact("bar", max(1, round(n / POSES_A_PLACE)), BAR_MM) if bar else Artefact("tracker")
    plan = propose(arm, nominal_prior(arm, noise_mm=NOISE_MM), held, n, seed=0)
    rows = []
    for draw in range(draws):
        virtual = VirtualArm.draw(arm, load_preset("research"), seed=draw)
        for strategy in plan.proposals:
            row = {"artefact": artefact, "poses": n, "strategy": strategy}
            rows.append(row | errors_of(virtual, plan, strategy, seed=1 + draw))
    return rows


def errors_of(virtual: VirtualArm, plan: CalibrationPlan, strategy: str, *, seed: int) -> dict[str, float]:
    """Error in the volume of models identified from the poses of a strategy: rms and largest [mm]."""
    poses = next(proposal.poses for name, proposal in plan.proposals.items() if name == strategy)
    taken = virtual.measure(
        poses.angles, seed=seed, seat=poses.seat, seat_points=poses.seat_points, reference=poses.seat is None
    )
    lengths = None
    if poses.seat is not None and bars(poses):
        a, b = np.array(bars(poses)).T
        lengths = Lengths(a, b, np.full(len(a), BAR_MM), np.full(len(a), LENGTH_U_MM), np.full(len(a), "bar"))
    truth = virtual.true_tip(plan.volume)
    found = {}
    for name, kind in IDENTIFIED.items():
        model = kind(virtual.nominal).fit_readings(taken.readings, lengths=lengths)
        off = distances(model.predict(plan.volume), truth)
        found |= {f"{name}_rms_mm": float(np.sqrt(np.mean(off**2))), f"{name}_max_mm": float(off.max())}
    return found


def distances(points: FloatArray, truth: FloatArray) -> FloatArray:
    """(n,) distances once a rigid motion has brought the points as near as it can."""
    a, b = points - points.mean(axis=0), truth - truth.mean(axis=0)
    left, _, right = np.linalg.svd(a.T @ b)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return np.asarray(np.linalg.norm(a @ turn - b, axis=1))


def errors(rows: list[dict[str, Any]], artefact: str, n: int, strategy: str, *, of: str = "physical") -> list[float]:
    """Errors of all arms, rms [mm]."""
    wanted = (artefact, n, strategy)
    return [row[f"{of}_rms_mm"] for row in rows if (row["artefact"], row["poses"], row["strategy"]) == wanted]


def drawing_of(rows: list[dict[str, Any]], poses: tuple[int, ...]) -> Figure:
    """Error against the number of poses: medians as lines, single arms as dots."""
    pens = styles_of(STRATEGIES)
    everything = [row["physical_rms_mm"] for row in rows]
    panels = []
    with figure_style():
        for artefact in dict.fromkeys(row["artefact"] for row in rows):
            drawing, (axes,) = make_panel(4.6, 3.4)
            for strategy, pen in pens.items():
                by_n = [errors(rows, artefact, n, strategy) for n in poses]
                axes.plot(
                    poses,
                    [np.median(found) for found in by_n],
                    color=pen.colour,
                    linestyle=pen.dash,
                    marker=pen.marker,
                    markersize=4,
                    label=strategy,
                )
                for n, found in zip(poses, by_n, strict=True):
                    axes.scatter([n] * len(found), found, s=4, color=pen.colour, alpha=0.4, linewidths=0)
            set_log_scale(axes, "x", 9, 110)
            set_log_scale(axes, "y", 0.9 * min(everything), 1.1 * max(everything))
            axes.set(xlabel="poses", ylabel="error in the volume, rms [mm]", title=artefact)
            axes.legend(loc="upper right")
            panels.append(drawing)
    said = "Error in the volume against the number of poses, by strategy."
    return Figure(tuple(panels), caption=said, alt=said, columns=2)


# How far the joints move ----------------------------------------------------------------------------------------------

CASES = (
    ("measuring7", Artefact("bar", 3, BAR_MM), 60),
    ("measuring7", Artefact("bar", 2, BAR_MM), 40),
    ("measuring7", Artefact("seat", 5), 50),
    ("measuring7", Artefact("tracker"), 50),
    ("gao2017", Artefact("bar", 3, BAR_MM), 60),
    ("gao2017", Artefact("tracker"), 50),
    ("ur10", Artefact("tracker"), 50),
    ("ur10", Artefact("bar", 2, BAR_MM), 40),
)


@ROWS.row("moves", quick={"seeds": 1, "cases": 1})
def moves(seeds: int = 3, cases: int = len(CASES)) -> RowResult:
    """How far the joints move from pose to pose of a plan, and what shorter ways cost: uncertainty, error and time.

    Each plan is made twice: of the poses that were chosen for their uncertainty alone, in a short order, and with poses
    exchanged for others a short way apart. The move is that of the joint that turns most, the mean over the steps. A
    virtual arm with the errors of the preset research is measured at both and identified: its error in the volume is
    stated, root mean square.
    """
    return RowResult([moves_of(*case, seed) for case in CASES[-cases:] for seed in range(seeds)])


def moves_of(name: str, artefact: Artefact, n: int, seed: int) -> dict[str, Any]:
    """Moves without and with exchange, the ratio of the uncertainties, and the time that the exchange takes."""
    arm = load_arm(name)
    prior = nominal_prior(arm, noise_mm=NOISE_MM)
    begun = time.process_time()
    plan = propose(arm, prior, artefact, n, seed=seed)
    between = time.process_time()
    shortened = propose(arm, prior, artefact, n, to_measure="i-optimal", seed=seed)
    cpu_s = time.process_time() - between - (between - begun)
    chosen, short = (one.proposals["i-optimal"] for one in (plan, shortened))
    virtual = VirtualArm.draw(arm, load_preset("research"), seed=seed)
    before, after = (errors_of(virtual, one, "i-optimal", seed=1 + seed) for one in (plan, shortened))
    return {
        "arm": name,
        "artefact": artefact.kind,
        "poses": n,
        "seed": seed,
        "move [deg]": degrees(chosen.mean_move),
        "shortened [deg]": degrees(short.mean_move),
        "uncertainty": float(short.rms_mm[-1] / chosen.rms_mm[-1]),
        "error [mm]": before["physical_rms_mm"],
        "error shortened [mm]": after["physical_rms_mm"],
        "CPU [s]": cpu_s,
    }
