"""What arms of a type teach about the next one: virtual fleets with planted means and scatters, and real arms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from benchmarks.rows import RowResult, Rows, Target
from truearm.arm import Arm, load_arm
from truearm.identification.terms.type_prior import TypePrior
from truearm.models import KinematicModel
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.fleet.type_prior import LearnedTypePrior, learned_from, linearised_arm
from truearm.wings.importing import datasets
from truearm.wings.planning.simulate import strategy_poses
from truearm.wings.planning.virtual import VirtualArm, load_preset

ROWS = Rows()
NOMINAL = "ur10"
FLEET_READINGS, TEST_READINGS = 60, 200
LEVEL = 0.95


class Kind(NamedTuple):
    """A type of virtual arms: the preset of all effects but the constants, their bias and scatter, the instrument.

    Biases and scatters are standard deviations of every constant of the joints: bias once for the type, scatter for
    each arm.
    """

    preset: str
    bias_mm: float
    bias_mrad: float
    scatter_mm: float
    scatter_mrad: float
    reference_mm: float

    def nominal_as_built(self) -> Arm:
        """The typical arm of the type."""
        rng, arm = np.random.default_rng(1), load_arm(NOMINAL)
        motions = np.zeros((arm.chain.n_places, 6))
        motions[1:-1, :3] = 1e-3 * self.bias_mrad * rng.standard_normal((arm.n_joints, 3))
        motions[1:-1, 3:] = self.bias_mm * rng.standard_normal((arm.n_joints, 3))
        return replace(arm, chain=arm.chain.with_motions(motions))

    def draw(self, seed: int) -> VirtualArm:
        """An arm of the type."""
        preset = replace(
            load_preset(self.preset),
            name="type",
            length_std_mm=self.scatter_mm,
            angle_std_deg=float(np.degrees(1e-3 * self.scatter_mrad)),
            reference_std_mm=self.reference_mm,
            nominal_mean_mm=0.0,
            nominal_max_mm=0.0,
        )
        return VirtualArm.draw(self.nominal_as_built(), preset, seed=seed)


KINDS = {
    "measuring arm, tracker": Kind("shop", 0.4, 1.0, 0.003, 0.003, 0.003),
    "robot, tight type, tracker": Kind("research", 0.4, 1.0, 0.05, 0.1, 0.03),
    "robot, tight type, camera": Kind("research", 0.4, 1.0, 0.05, 0.1, 0.3),
    "robot, scatter as of UR10e, tracker": Kind("research", 0.4, 1.0, 0.15, 0.5, 0.03),
    "robot, scatter as of UR10e, camera": Kind("research", 0.4, 1.0, 0.15, 0.5, 0.3),
}
NOTHING_IN_COMMON = Kind("research", 0.0, 0.0, 0.6, 1.5, 0.03)


def measured(virtual: VirtualArm, n: int, seed: int, strategy: str = "uniform") -> Session:
    """Readings of a virtual arm."""
    poses = strategy_poses(virtual.nominal, strategy, n, seed=seed, seats=None, half_width_deg=None)
    return virtual.measure(poses.angles, seed=seed).readings


def fleet_prior(kind: Kind, n_arms: int, first_seed: int = 0) -> LearnedTypePrior:
    """What a fleet learns."""
    arm = load_arm(NOMINAL)
    seeds = range(first_seed, first_seed + n_arms)
    arms = {str(i): linearised_arm(arm, measured(kind.draw(i), FLEET_READINGS, 10_000 + i)) for i in seeds}
    return learned_from(arm, arms)


def errors(
    kind: Kind, prior: TypePrior | None, n_readings: int, seed: int, strategy: str
) -> tuple[float, float, float]:
    """Of a new arm from few readings: mean error [mm], share inside 95 % ellipsoids, mean stated u [mm]."""
    arm, virtual = load_arm(NOMINAL), kind.draw(seed)
    model = KinematicModel(arm)
    prepared = model.prepare(measured(virtual, n_readings, 20_000 + seed, strategy))
    model.learn(replace(prepared, prior=prior))
    angles = measured(virtual, TEST_READINGS, 30_000 + seed).angles
    points, covariance = model.predict(angles, return_cov=True)
    off = points - virtual.true_tip(angles)
    squares = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0])
    u = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 3)
    return float(np.linalg.norm(off, axis=1).mean()), float((squares < chi2.ppf(LEVEL, 3)).mean()), float(u.mean())


def compared(kind: Kind, prior: TypePrior | None, n_readings: int, new: int, strategy: str = "uniform") -> FloatArray:
    """(6,) means over new arms: error, coverage and u without the prior, then with it."""
    found = [
        [value for one in (None, prior) for value in errors(kind, one, n_readings, seed, strategy)]
        for seed in range(900, 900 + new)
    ]
    return np.asarray(found).mean(axis=0)


def _row(kind: str, n_arms: int, n_readings: int, learned: LearnedTypePrior, found: FloatArray) -> dict[str, Any]:
    return {
        "type": kind,
        "arms": n_arms,
        "readings": n_readings,
        "kept": learned.helps,
        "held out says": ", ".join(f"{one.error_ratio:.2f}" for one in learned.prior.gains),
        "without [mm]": float(found[0]),
        "with [mm]": float(found[3]),
        "ratio": float(found[3] / found[0]),
        "coverage without, with [%]": f"{100 * found[1]:.1f}, {100 * found[4]:.1f}",
    }


@ROWS.row("fleets", quick={"arms": (5,), "new": 1, "kinds": ("measuring arm, tracker",)}, is_long=True)
def fleets(
    arms: tuple[int, ...] = (5, 20, 100),
    readings: tuple[int, ...] = (8, 12, 20),
    new: int = 12,
    kinds: tuple[str, ...] = tuple(KINDS),
    strategy: str = "uniform",
) -> RowResult:
    """A new arm of a type with a biased drawing, from few readings, with the prior of 5, 20 and 100 arms.

    Its readings are those of a `strategy`: anywhere (uniform), or within 20 degrees of a working pose (box). Its errors
    are those anywhere.
    """
    table = []
    for name in kinds:
        for n in arms:
            learned = fleet_prior(KINDS[name], n)
            used = learned.prior if learned.helps else None
            table += [_row(name, n, m, learned, compared(KINDS[name], used, m, new, strategy)) for m in readings]
    at20 = [row["ratio"] for row in table if (row["arms"], row["readings"]) == (20, 20)]
    best = min(at20, default=None)
    return RowResult(table, [Target("error of the next arm after 20 readings, 20 arms, best type", best, 0.6)])


@ROWS.row("nothing", quick={"fleets": 1, "arms": (5,), "new": 1}, is_long=True)
def nothing(
    arms: tuple[int, ...] = (5, 20), fleets: int = 5, readings: tuple[int, ...] = (20,), new: int = 6
) -> RowResult:
    """A fleet with nothing in common: whether a prior is kept by chance, and what it then does."""
    table, ratios = [], []
    for n in arms:
        for i in range(fleets):
            learned = fleet_prior(NOTHING_IN_COMMON, n, 1000 * (i + 1))
            used = learned.prior if learned.helps else None
            for m in readings:
                found = compared(NOTHING_IN_COMMON, used, m, new)
                table.append(_row(f"nothing in common, fleet {i + 1}", n, m, learned, found))
                ratios.append(found[3] / found[0])
    return RowResult(table, [Target("largest ratio of the errors", float(max(ratios)), 1.01)])


@ROWS.row("readings", quick={"readings": (10,), "fleet": 5, "new": 1}, is_long=True)
def by_readings(
    readings: tuple[int, ...] = (8, 10, 12, 15, 20, 30, 40, 60),
    fleet: int = 20,
    new: int = 8,
    kind: str = "robot, tight type, camera",
) -> Iterator[dict[str, Any]]:
    """Error and stated uncertainty by number of readings, without and with the prior."""
    learned = fleet_prior(KINDS[kind], fleet)
    used = learned.prior if learned.helps else None
    for n in readings:
        found = compared(KINDS[kind], used, n, new)
        yield {
            "readings": n,
            "error without, with [mm]": f"{found[0]:.3f}, {found[3]:.3f}",
            "u without, with [mm]": f"{found[2]:.3f}, {found[5]:.3f}",
        }


@ROWS.row("panda", quick={})
def panda() -> RowResult:
    """Three real Franka Pandas, a ball in sockets: what each gains from the two others."""
    arm, names = load_arm("panda"), [f"mukca-panda_{i}" for i in (1, 2, 3)]
    linearise = partial(linearised_arm, arm)
    arms = {name: linearise(datasets.load_readings(name), datasets.load_lengths(name)) for name in names}
    learned = learned_from(arm, arms)
    table = [{"readings": g.n_readings, "ratio": g.error_ratio, "u": g.error_ratio_u} for g in learned.prior.gains]
    return RowResult(table, notes=[learned.summary()])
