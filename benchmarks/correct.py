"""Corrected joint targets: what reaches the target, on a real arm and on virtual ones, how fast and in how many steps.

The UR10 series A is split and fitted as in docs/ur10.md (physical model, half a minute); ``--model`` reads that model
from a file instead. A measured point of a test position is the target, with the orientation that the model has there;
the joints that were there are the answer. Virtual arms are fitted to `readings` readings and commanded to new targets.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.held_out import split
from benchmarks.rows import RowResult, Rows, Target, cpu_seconds_of
from truearm.arm import Arm, Chain, Pose, load_arm
from truearm.models import Compensator, PhysicalModel, load_model
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.exports.targets.correction import correct_targets, task_of
from truearm.wings.exports.targets.inverse import solve_poses
from truearm.wings.exports.targets.pose_models import nominal_poses, poses_of
from truearm.wings.exports.targets.targets import Targets
from truearm.wings.planning.virtual import VirtualArm

ROWS = Rows()
# Recorded joints are not where the search starts.
START_OFF_RAD = 0.05
# Jacobians of the guide's test positions have a condition of 5 to 60; near singularities it is above 100.
EVERYDAY = 100.0
SILENT = {"untrained": "accept", "uncertainty": False}


@cache
def real_arm(file: str | None) -> tuple[Compensator, Session]:
    """The guide's model of the UR10, and the test positions that it has not seen."""
    arm, train, test = split("ur10-a", 1)
    return (PhysicalModel(arm).fit_readings(train) if file is None else load_model(Path(file))), test


@ROWS.row("measured-points")
def measured_points(model: str | None = None) -> RowResult:
    """UR10 series A, measured points as targets: distance of the joints found from the true ones, at the tip."""
    fitted, test = real_arm(model)
    every, joints = np.arange(len(test)), test.angles
    R = poses_of(fitted, test).pose(joints, every).R_base_tip
    start = joints + np.random.default_rng(0).uniform(-START_OFF_RAD, START_OFF_RAD, joints.shape)
    targets = Targets(start, test.points, R, temperature_degC=test.temperature_degC)
    found = correct_targets(fitted, targets, **SILENT)
    chain, good = fitted.nominal_.chain, ~found.refused
    there = chain.tip_in_base(joints)
    nominal = solve_poses(task_of(fitted, nominal_poses(fitted), Pose(R, test.points)), start)
    table = []
    for name, solved in (("corrected", found.joints), ("nominal arm's inverse kinematics", nominal.angles)):
        errors = np.linalg.norm(chain.tip_in_base(solved[good]) - there[good], axis=1)
        spread = {"mean [mm]": errors.mean(), "95 % [mm]": np.quantile(errors, 0.95), "max [mm]": errors.max()}
        table.append({"joints": name, "n": len(test), "refused": int(found.refused.sum()), **spread})
    mean = float(table[0]["mean [mm]"])
    return RowResult(table, [Target("UR10 series A, joints of measured points, at the tip, mean [mm]", mean, 0.060)])


@ROWS.row("steps", quick={"targets": 500})
def steps(targets: int = 10_000, model: str | None = None) -> RowResult:
    """Speed without uncertainties, share of targets within 1e-9 rad of their solution after four steps, and back."""
    fitted, test = real_arm(model)
    low, high = fitted.angle_ranges_.T
    random = np.random.default_rng(0).uniform(low, high, (targets, len(low)))
    table = []
    for what, joints in (("random in the trained range", random), ("test positions", test.angles)):
        given = Targets.of_joints(joints)
        seconds = cpu_seconds_of(lambda given=given: correct_targets(fitted, given, **SILENT))
        found = correct_targets(fitted, given, **SILENT)
        good = ~found.refused
        everyday = good & (found.condition < EVERYDAY)
        nominal = nominal_poses(fitted).pose(joints, np.arange(len(joints)))
        task = task_of(fitted, poses_of(fitted, given.session(joints)), nominal)
        after_4 = np.abs(solve_poses(task, joints, max_steps=4).angles - found.joints).max(axis=1) <= 1e-9
        back = correct_targets(fitted, Targets.of_joints(found.joints[everyday]), direction="feedback", **SILENT)
        table.append({
            "targets": what,
            "n": len(joints),
            "CPU [s]": seconds,
            "corrected": int(good.sum()),
            "in 4 steps": float(after_4[good].mean()),
            "condition < 100": int(everyday.sum()),
            "of these in 4 steps": float(after_4[everyday].mean()),
            "there and back [rad]": float(np.nanmax(np.abs(back.joints - joints[everyday]))),
        })  # fmt: skip
    back = max(row["there and back [rad]"] for row in table)
    judged = [
        Target(f"{targets} targets, physical model, no uncertainties, CPU [s]", table[0]["CPU [s]"], 2.0),
        Target("test positions within 1e-9 rad after 4 steps", table[1]["in 4 steps"], 0.999, "above"),
        Target("random targets, condition < 100, the same", table[0]["of these in 4 steps"], 0.999, "above"),
        Target("there and back, condition < 100 [rad]", back, 1e-9),
    ]
    return RowResult(table, judged)


def on_a_rail() -> Arm:
    """A UR10 on a rail of two metres."""
    chain = load_arm("ur10").chain
    onto_rail = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
    fixed = np.concatenate([onto_rail[None], (np.linalg.inv(onto_rail) @ chain.fixed[0])[None], chain.fixed[1:]])
    low, high = np.array([0.0] + [-6.3] * 6), np.array([2000.0] + [6.3] * 6)
    working = np.array([1000.0, *load_arm("ur10").working])
    slides = [True] + [False] * 6
    return Arm("ur10-on-a-rail", Chain(fixed, np.zeros(3), slides), lower=low, upper=high, working_pose=working)


class ArmOnARail:
    """A virtual UR10 whose base slides: its errors, and a rail that is turned by 0.3 and 0.2 mrad."""

    def __init__(self, preset: str) -> None:
        self.nominal = on_a_rail()
        self.virtual = VirtualArm.draw(load_arm("ur10"), preset, seed=1)

    def true_tip(self, joints: FloatArray) -> FloatArray:
        """(n, 3) true tips [mm]."""
        tips = self.virtual.true_tip(joints[:, 1:])
        return tips + joints[:, :1] * [1.0, 3e-4, -2e-4]

    def measure(self, joints: FloatArray, *, seed: int) -> Session:
        """Readings with the noise of encoders and of a tracker."""
        readings = self.virtual.measure(joints[:, 1:], seed=seed).readings
        noise = readings.points - self.virtual.true_tip(joints[:, 1:])
        return Session(np.column_stack([joints[:, 0], readings.angles]), self.true_tip(joints) + noise)


def closed_loop(name: str, preset: str, n_readings: int, n_targets: int) -> dict[str, float]:
    """Command corrected joints and measure where the tip goes [mm]."""
    if name == "rail":
        arm_on_rail = ArmOnARail(preset)
        arm, true_tip = arm_on_rail.nominal, arm_on_rail.true_tip
    else:
        arm = load_arm(name)
        virtual = VirtualArm.draw(arm, preset, seed=1)
        true_tip = virtual.true_tip
    rng = np.random.default_rng(2)
    half = np.where(arm.chain.is_prismatic, 900.0, 1.2)
    low, high = np.maximum(arm.lower, arm.working - half), np.minimum(arm.upper, arm.working + half)
    joints = rng.uniform(low, high, (n_readings, arm.n_joints))
    readings = arm_on_rail.measure(joints, seed=3) if name == "rail" else virtual.measure(joints, seed=3).readings
    model = PhysicalModel(arm).fit_readings(replace(readings, directions=None))
    planned = rng.uniform(low, high, (n_targets, arm.n_joints))
    found = correct_targets(model, Targets.of_joints(planned), untrained="accept", uncertainty=False)
    good = ~found.refused
    wanted = model.nominal_.chain.tip_in_base(planned[good])
    sent, without = true_tip(found.joints[good]), true_tip(planned[good])
    own = np.linalg.norm(model.predict(found.joints[good]) - sent, axis=1).mean()
    error = np.linalg.norm(sent - wanted, axis=1).mean()
    return {
        "without_mm": float(np.linalg.norm(without - wanted, axis=1).mean()),
        "commanded_mm": float(error),
        "model_mm": float(own),
        "ratio": float(error / own),
        "refused": int(found.refused.sum()),
    }


@ROWS.row("closed-loop", quick={"readings": 100, "presets": ("shop",), "arms": ("ur10", "rail")})
def closed_loops(
    readings: int = 3000,
    presets: tuple[str, ...] = ("shop", "research"),
    arms: tuple[str, ...] = ("ur10", "wam", "rail"),
) -> RowResult:
    """Virtual arms commanded to corrected joints, distance from 500 targets, mean [mm]."""
    table, targets = [], []
    for preset in presets:
        for name in arms:
            found = closed_loop(name, preset, readings, 500)
            table.append({"arm": f"{name}, {preset}", **found})
            targets.append(Target(f"closed loop, {name}, {preset}: error / model's own", found["ratio"], 1.1))
    return RowResult(table, targets)
