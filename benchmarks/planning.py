"""Accuracy against the number of poses, by the strategy that chose them: readings of virtual arms, simulated.

    python benchmarks/planning.py [--draws 2] [--figure FILE.png] [--json]

For every number of poses the plans are made once for each nominal arm (`truearm.identification.planning`, terms
physical). Arms with the errors of the preset research are then measured at these poses, a physical model is
identified, and its points at poses
spread over the volume are compared with the true ones, after the frame is fitted. Tracker: points with noise, base and
tip free. Bar: tips in its two seats, at places in turn, and its length; no point is ever seen.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from machine import arguments_of, print_json, print_table, say_machine
from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel, PhysicalModel
from truearm.identification.planning.prior import nominal_prior
from truearm.identification.planning.proposal import LENGTH_U_MM, STRATEGIES, Artefact, CalibrationPlan, propose
from truearm.identification.planning.template import bars
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.pages.plotting import Figure, figure_style, make_panel, save_figure, set_log_scale, styles_of
from truearm.readings import Lengths
from truearm.typing import FloatArray

ARMS = ("measuring7", "gao2017", "ur10")
ARTEFACTS = ("tracker", "bar")
POSES = (10, 20, 30, 50, 100)
NOISE_MM, BAR_MM, POSES_A_PLACE = 0.02, 400.0, 20
MODELS = {"physical": PhysicalModel, "kinematic": KinematicModel}


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--draws", type=int, default=2, help="virtual arms of each drawing, 2 by default")
    parser.add_argument("--figure", type=Path, help="picture to draw, .png")
    options = parser.parse_args()
    begun = time.perf_counter()
    rows = [row for artefact in ARTEFACTS for arm in ARMS for n in POSES for row in rows_of(arm, artefact, n, options)]
    found = {"rows": rows, "seconds": time.perf_counter() - begun}
    if options.figure is not None:
        save_figure(figure(rows), options.figure)
    if options.json:
        print_json(found, [])
        return
    say_machine()
    for artefact in ARTEFACTS:
        print(f"\n{artefact}: error in the volume, rms [mm], median and range of {options.draws * len(ARMS)} arms")
        print_table(
            ["poses", *STRATEGIES],
            [[str(n), *(told(rows, artefact, n, strategy) for strategy in STRATEGIES)] for n in POSES],
        )
        kinematic = [f"{np.median(errors(rows, artefact, 50, name, of='kinematic')):.4f}" for name in STRATEGIES]
        print(f"a kinematic model of 50 poses: {', '.join(kinematic)}")
    print(f"\n{found['seconds']:.0f} s")


def rows_of(name: str, artefact: str, n: int, options: Any) -> list[dict[str, Any]]:
    """Errors of all arms of one drawing, by every strategy."""
    arm = load_arm(name)
    bar = artefact == "bar"
    held = Artefact("bar", max(1, round(n / POSES_A_PLACE)), BAR_MM) if bar else Artefact("tracker")
    plan = propose(arm, nominal_prior(arm, noise_mm=NOISE_MM), held, n, seed=0)
    rows = []
    for draw in range(options.draws):
        virtual = VirtualArm.draw(arm, load_preset("research"), seed=draw)
        for strategy, proposal in plan.proposals.items():
            row = {"arm": name, "draw": draw, "artefact": artefact, "poses": n, "strategy": strategy}
            row["predicted_mm"] = float(proposal.rms_mm[-1])
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
    for name, kind in MODELS.items():
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


def told(rows: list[dict[str, Any]], artefact: str, n: int, strategy: str) -> str:
    """Median and range in a cell."""
    found = errors(rows, artefact, n, strategy)
    return f"{np.median(found):.3f} ({min(found):.3f} to {max(found):.3f})"


def figure(rows: list[dict[str, Any]]) -> Figure:
    """Error against the number of poses: medians as lines, single arms as dots."""
    pens = styles_of(STRATEGIES)
    everything = [row["physical_rms_mm"] for row in rows]
    panels = []
    with figure_style():
        for artefact in ARTEFACTS:
            drawing, (axes,) = make_panel(4.6, 3.4)
            for strategy, pen in pens.items():
                by_n = [errors(rows, artefact, n, strategy) for n in POSES]
                axes.plot(
                    POSES,
                    [np.median(found) for found in by_n],
                    color=pen.colour,
                    linestyle=pen.dash,
                    marker=pen.marker,
                    markersize=4,
                    label=strategy,
                )
                for n, found in zip(POSES, by_n, strict=True):
                    axes.scatter([n] * len(found), found, s=4, color=pen.colour, alpha=0.4, linewidths=0)
            set_log_scale(axes, "x", 9, 110)
            set_log_scale(axes, "y", 0.9 * min(everything), 1.1 * max(everything))
            axes.set(xlabel="poses", ylabel="error in the volume, rms [mm]", title=artefact)
            axes.legend(loc="upper right")
            panels.append(drawing)
    said = "Error in the volume against the number of poses, by strategy."
    return Figure(tuple(panels), caption=said, alt=said, columns=2)


if __name__ == "__main__":
    main()
