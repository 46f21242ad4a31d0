"""An arm without a drawing: circle point analysis of arms whose constants are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import truearm as ta
from benchmarks.rows import RowResult, Rows
from truearm.arm import Arm, load_arm
from truearm.arm.chain import Chain
from truearm.arm.nearest_table import nearest_table
from truearm.models import KinematicModel
from truearm.pages.plotting import Figure, figure_style, make_panel
from truearm.typing import FloatArray
from truearm.wings.planning.arm_from_circles import CircleArm, constants_of

ROWS = Rows()
ARMS = ("ur10", "panda", "gao2017", "measuring7", "wam")
# Of the target, so that it is off the axis of the last joint.
TOOL_MM = np.array([80.0, 20.0, 30.0])


def planted(name: str, seed: int, *, angle_std: float = 1e-3, length_std_mm: float = 0.3) -> tuple[Chain, FloatArray]:
    """An arm of the catalogue with errors of its constants, somewhere before an instrument, and a pose to stand in."""
    rng, arm = np.random.default_rng(seed), load_arm(name)
    fixed = arm.chain.fixed.copy()
    for F in fixed:
        F[:3, :3] = F[:3, :3] @ Rotation.from_rotvec(rng.normal(0, angle_std, 3)).as_matrix()
        F[:3, 3] += rng.normal(0, length_std_mm, 3)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-2000, 2000, 3)
    fixed[0] = place @ fixed[0]
    return Chain(fixed, arm.chain.tip_in_flange + TOOL_MM, arm.chain.prismatic), arm.working


def swept(
    chain: Chain,
    stand: FloatArray,
    seed: int,
    *,
    points: int = 8,
    arc_deg: float = 40.0,
    noise_mm: float = 0.02,
    wobble: float = 0.0,
) -> ta.Session:
    """Each joint alone over an arc, or 200 mm, the others as still as `wobble` [rad]."""
    rng = np.random.default_rng(seed)
    angles = np.repeat([stand], points * len(stand), axis=0)
    for j, slides in enumerate(chain.is_prismatic):
        ends = (0, 200) if slides else np.radians([-arc_deg / 2, arc_deg / 2])
        angles[j * points : (j + 1) * points, j] += np.linspace(*ends, points)
    angles = angles + rng.normal(0, wobble, angles.shape)
    return ta.Session(angles, chain.tip_in_base(angles) + rng.normal(0, noise_mm, (len(angles), 3)))


def standardized(found: CircleArm, chain: Chain) -> FloatArray:
    """Errors of the constants over their standard uncertainties, of all that are no convention."""
    true = nearest_table(chain, found.estimated.axes.chain(), convention=found.table.convention)
    uncertain = found.std > 0
    return np.asarray((constants_of(found.table) - constants_of(true))[uncertain] / found.std[uncertain])


@ROWS.row("coverage", quick={"seeds": 2, "arms": ("ur10",)})
def coverage(
    arms: tuple[str, ...] = ARMS, seeds: int = 50, points: int = 8, arc_deg: float = 40.0, noise_mm: float = 0.02
) -> RowResult:
    """Constants of planted arms against their stated uncertainty, from circles one at a time."""
    table = []
    for name in arms:
        errors, spread = [], []
        for seed in range(seeds):
            chain, stand = planted(name, seed)
            found = ta.arm_from_circles(swept(chain, stand, seed, points=points, arc_deg=arc_deg, noise_mm=noise_mm))
            errors.append(standardized(found, chain))
            spread.append([found.u("a").max(), np.degrees(found.u("alpha").max())])
        z = np.concatenate(errors)
        largest = np.median(spread, axis=0)
        table.append({
            "arm": name,
            "constants": len(z),
            "within U (k = 2) [%]": 100 * float((np.abs(z) < 2).mean()),
            "rms of error / u": float(np.sqrt((z**2).mean())),
            "largest u of a [mm], median": float(largest[0]),
            "largest u of alpha [deg], median": float(largest[1]),
        })  # fmt: skip
    return RowResult(table)


@ROWS.row("drawing", quick={"seeds": 1, "arms": ("gao2017",)})
def drawing(arms: tuple[str, ...] = ARMS, seeds: int = 3, readings: int = 100) -> RowResult:
    """Held-out error of kinematic fits with the measured arm, the true one and that of the catalogue as the drawing."""
    table = []
    for name in arms:
        means: dict[str, list[float]] = {"measured": [], "true": [], "catalogue": []}
        for seed in range(seeds):
            chain, stand = planted(name, seed)
            measured = ta.arm_from_circles(swept(chain, stand, seed)).arm
            arm, rng = load_arm(name), np.random.default_rng(seed)
            lower, upper = np.clip(arm.limits.T, -2.5, 2.5)
            angles = rng.uniform(lower, upper, (2 * readings, arm.n_joints))
            points = chain.tip_in_base(angles) + rng.normal(0, 0.02, (len(angles), 3))
            for what, known in (("measured", measured), ("true", Arm("true", chain)), ("catalogue", arm)):
                model = KinematicModel(replace(known, name=what)).fit(angles[:readings], points[:readings])
                off = np.linalg.norm(model.predict(angles[readings:]) - points[readings:], axis=1)
                means[what].append(float(off.mean()))
        table.append({"arm": name} | {f"{what} [mm]": float(np.mean(of)) for what, of in means.items()})
    return RowResult(table)


@ROWS.row("figure", is_long=True)
def figure(file: str = "circles_of_an_arm.png", arm: str = "gao2017") -> RowResult:
    """Draw the circles of an arm and the axes found, seen from the side and from above, into a file."""
    chain = load_arm(arm).chain
    stand = load_arm(arm).working
    moved = Chain(chain.fixed, chain.tip_in_flange + TOOL_MM, chain.prismatic)
    session = swept(moved, stand, 1, points=12, arc_deg=90.0)
    assert session.points is not None
    found = ta.arm_from_circles(session)
    with figure_style():
        panels = []
        for across, up in ((0, 2), (0, 1)):
            panel, (drawn,) = make_panel(3.9, 3.3)
            panels.append(panel)
            for circle in found.circles:
                own = session.points[circle.rows]
                (line,) = drawn.plot(own[:, across], own[:, up], "o-", ms=3, lw=1, label=f"J{circle.joint + 1}")
                end = circle.point + 250 * np.outer([-1, 1], circle.direction)
                drawn.plot(end[:, across], end[:, up], "--", lw=1, color=line.get_color())
                drawn.plot(*circle.point[[across, up]], "+", color=line.get_color())
            drawn.set_aspect("equal", adjustable="datalim")
            drawn.set_title(f"{'xyz'[up]} over {'xyz'[across]} [mm]")
        drawn.legend(fontsize="small")
    Figure(tuple(panels), "Circles of an arm.", "Circles of joints and axes found.", columns=2).save(file)
    return RowResult(notes=[f"drawn into {file}"])
