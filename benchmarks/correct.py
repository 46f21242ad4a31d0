"""Corrected joint targets: what reaches the target, on a real arm and on virtual ones, how fast and in how many steps.

    python benchmarks/correct.py [--json] [--readings N] [--targets N] [--model FILE]

The UR10 series A is split and fitted as in the README (physical model, half a minute); ``--model`` reads that model
from a file instead. A measured point of a test position is the target, with the orientation that the model has there;
the joints that were there are the answer. Virtual arms are fitted to `readings` readings and commanded to new targets.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from machine import Target, arguments_of, print_json, print_table, say_machine, say_targets
from truearm import datasets
from truearm.arm import Arm, Chain, Pose, load_arm
from truearm.compensation.models import Compensator, PhysicalModel, load_model
from truearm.compensation.targets.correction import correct_targets, task_of
from truearm.compensation.targets.inverse import solve_poses
from truearm.compensation.targets.pose_models import nominal_poses, poses_of
from truearm.compensation.targets.targets import Targets
from truearm.identification.virtual import VirtualArm
from truearm.readings import Session, hold_out
from truearm.typing import FloatArray

# Recorded joints are not where the search starts.
START_OFF_RAD = 0.05
# Jacobians of the README's test positions have a condition of 5 to 60; near singularities it is above 100.
EVERYDAY = 100.0


def real_arm(path: Path | None) -> tuple[Compensator, Session]:
    """The README's model of the UR10, and the test positions that it has not seen."""
    train, test = hold_out(datasets.load_readings("ur10-a"), by="position", fraction=0.3, seed=1)
    return (PhysicalModel(load_arm("ur10")).fit_readings(train) if path is None else load_model(path)), test


def measured_points_as_targets(model: Compensator, test: Session) -> dict[str, float]:
    """Distance of the joints found from those that were there, at the tip [mm]."""
    every, joints = np.arange(len(test)), test.angles
    R = poses_of(model, test).pose(joints, every).R_base_tip
    start = joints + np.random.default_rng(0).uniform(-START_OFF_RAD, START_OFF_RAD, joints.shape)
    targets = Targets(start, test.points, R, temperature_degC=test.temperature_degC)
    found = correct_targets(model, targets, untrained="accept", uncertainty=False)
    chain, good = model.nominal_.chain, ~found.refused
    there = chain.tip_in_base(joints)
    nominal = solve_poses(task_of(model, nominal_poses(model), Pose(R, test.points)), start)
    errors = np.linalg.norm(chain.tip_in_base(found.joints[good]) - there[good], axis=1)
    before = np.linalg.norm(chain.tip_in_base(nominal.joints[good]) - there[good], axis=1)
    return {
        "mean_mm": float(errors.mean()),
        "p95_mm": float(np.quantile(errors, 0.95)),
        "max_mm": float(errors.max()),
        "nominal_mean_mm": float(before.mean()),
        "n": len(test),
        "refused": int(found.refused.sum()),
    }


@dataclass(frozen=True)
class Speed:
    """Correction of many targets without uncertainties."""

    n: int
    cpu_s: float
    corrected: int
    everyday: int
    share_in_4_steps: float
    share_in_4_steps_everyday: float
    round_trip_rad: float


def speed(model: Compensator, joints: FloatArray) -> Speed:
    """CPU time, share of targets within 1e-9 rad of their solution after four steps, and the way there and back."""
    begun = time.process_time()
    found = correct_targets(model, Targets.of_joints(joints), untrained="accept", uncertainty=False)
    seconds = time.process_time() - begun
    good = ~found.refused
    everyday = good & (found.condition < EVERYDAY)
    targets = Targets.of_joints(joints)
    nominal = nominal_poses(model).pose(joints, np.arange(len(joints)))
    task = task_of(model, poses_of(model, targets.session(joints)), nominal)
    after_4 = np.abs(solve_poses(task, joints, max_steps=4).joints - found.joints).max(axis=1) <= 1e-9
    sent = Targets.of_joints(found.joints[everyday])
    back = correct_targets(model, sent, direction="feedback", untrained="accept", uncertainty=False)
    return Speed(
        len(joints),
        seconds,
        int(good.sum()),
        int(everyday.sum()),
        float(after_4[good].mean()),
        float(after_4[everyday].mean()),
        float(np.nanmax(np.abs(back.joints - joints[everyday]))),
    )


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


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--readings", type=int, default=3000)
    parser.add_argument("--targets", type=int, default=10_000)
    parser.add_argument("--model", type=Path)
    options = parser.parse_args()
    model, test = real_arm(options.model)
    real = measured_points_as_targets(model, test)
    low, high = model.angle_ranges_.T
    timed = speed(model, np.random.default_rng(0).uniform(low, high, (options.targets, len(low))))
    recorded = speed(model, test.angles)
    loops = {
        f"{name}, {preset}": closed_loop(name, preset, options.readings, 500)
        for preset in ("shop", "research")
        for name in ("ur10", "wam", "rail")
    }
    targets = [
        Target("UR10 series A, joints of measured points, at the tip, mean [mm]", real["mean_mm"], 0.060),
        Target(f"{options.targets} targets, physical model, no uncertainties, CPU [s]", timed.cpu_s, 2.0),
        Target("test positions within 1e-9 rad after 4 steps", recorded.share_in_4_steps, 0.999, "above"),
        Target("random targets, condition < 100, the same", timed.share_in_4_steps_everyday, 0.999, "above"),
        Target("there and back, condition < 100 [rad]", max(timed.round_trip_rad, recorded.round_trip_rad), 1e-9),
        *(Target(f"closed loop, {name}: error / model's own", loop["ratio"], 1.1) for name, loop in loops.items()),
    ]
    if options.json:
        found = {"real": real, "random": vars(timed), "recorded": vars(recorded), "closed_loop": loops}
        print_json(found, targets)
        return
    say_machine()
    print(f"\nUR10 series A, {real['n']} measured points as targets ({real['refused']} refused)")
    print(
        f"joints found, at the tip: mean {real['mean_mm']:.4f}, 95 % {real['p95_mm']:.4f}, max {real['max_mm']:.4f} mm"
    )
    print(f"by the nominal arm's inverse kinematics: mean {real['nominal_mean_mm']:.4f} mm")
    for what, one in (("random in the trained range", timed), ("test positions", recorded)):
        print(
            f"{one.n} targets, {what}: {one.cpu_s:.2f} s CPU, {one.corrected} corrected, {one.everyday} of them with a "
            f"condition below {EVERYDAY:.0f}; within 1e-9 rad after 4 steps: {one.share_in_4_steps:.2%} of all, "
            f"{one.share_in_4_steps_everyday:.2%} of these"
        )
    print(f"\nVirtual arms, {options.readings} readings, distance from 500 targets, mean [mm]\n")
    rows = [
        [name, *(f"{loop[key]:.4f}" for key in ("without_mm", "commanded_mm", "model_mm", "ratio"))]
        for name, loop in loops.items()
    ]
    print_table(["arm", "not corrected", "corrected", "model's own", "ratio"], rows)
    say_targets(targets)


if __name__ == "__main__":
    main()
