"""Forward kinematics and derivatives, us a pose, beside Pinocchio's own loop. One thread, one run.

    python benchmarks/kinematics.py [--json] [--poses N]

Pinocchio works pose by pose, so its loop runs in Python; the time of an empty loop over the same rows is taken off.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")  # before NumPy is loaded

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from machine import Target, options_of, print_json, say_machine, say_targets, times_of
from truearm.arm import Chain, load_arm, write_urdf

ARM = "ur10"


def best_us(work: Callable[[], object], n: int, *, repeats: int = 7) -> float:
    """Shortest of some runs [us a pose]: what the machine can do when nothing else disturbs it."""
    return times_of(work, runs=repeats).shortest / n * 1e6


def ours(chain: Chain, angles: np.ndarray) -> dict[str, float]:
    """Time each of our four ways through the chain [us a pose]."""
    n = len(angles)

    def all_chunks() -> None:
        for _ in chain.tip_derivatives_by_chunk(angles):
            pass

    return {
        "tip_in_base": best_us(lambda: chain.tip_in_base(angles), n),
        "pose": best_us(lambda: chain.pose(angles), n),
        "tip_derivatives_by_chunk": best_us(all_chunks, n),
        "tip_derivatives": best_us(lambda: chain.tip_derivatives(angles), n),
    }


def pinocchios(angles: np.ndarray) -> dict[str, float]:
    """Time Pinocchio on the same arm [us a pose]; nothing where it is not installed."""
    try:
        import pinocchio
    except ImportError:
        return {}
    with tempfile.TemporaryDirectory() as folder:
        write_urdf(load_arm(ARM), Path(folder) / "arm.urdf")
        model = pinocchio.buildModelFromUrdf(str(Path(folder) / "arm.urdf"))
    data = model.createData()
    tip = model.getFrameId("tip")
    n = len(angles)
    rows = list(angles)

    def empty() -> None:
        for _ in rows:
            pass

    def forward() -> None:
        step = pinocchio.forwardKinematics
        for q in rows:
            step(model, data, q)

    def placed() -> None:
        step = pinocchio.framesForwardKinematics
        for q in rows:
            step(model, data, q)

    def regressor() -> None:
        step, then = pinocchio.forwardKinematics, pinocchio.computeFrameKinematicRegressor
        frame = pinocchio.LOCAL_WORLD_ALIGNED
        for q in rows:
            step(model, data, q)
            then(model, data, tip, frame)

    loop = best_us(empty, n, repeats=3)
    timed = {
        "pinocchio forwardKinematics": forward,
        "pinocchio framesForwardKinematics": placed,
        "pinocchio with computeFrameKinematicRegressor": regressor,
    }
    return {name: best_us(work, n, repeats=3) - loop for name, work in timed.items()}


def targets_of(us: dict[str, float]) -> list[Target]:
    """What to reach: two times, and to be ahead of Pinocchio where it is installed."""
    targets = [
        Target("pose [us]", us["pose"], 0.7),
        Target("derivatives by all six motions at all places [us]", us["tip_derivatives"], 3.0),
    ]
    if "pinocchio forwardKinematics" in us:
        forward = us["pinocchio forwardKinematics"] / us["pose"]
        derivative = us["pinocchio with computeFrameKinematicRegressor"] / us["tip_derivatives"]
        targets.append(
            Target("pinocchio's forward kinematics, called from Python, over ours", forward, 1.0, good="above")
        )
        targets.append(Target("pinocchio's kinematic regressor of the tip over ours", derivative, 1.0, good="above"))
    return targets


def main() -> None:
    """Measure and print."""
    options = options_of(__doc__, poses=100_000)
    arm = load_arm(ARM)
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (options.poses, arm.n_joints))
    us = ours(arm.chain, angles) | pinocchios(angles)
    if options.json:
        print_json({"arm": ARM, "poses": options.poses, "us_per_pose": us}, targets_of(us))
        return
    say_machine()
    print(f"{options.poses} poses of {ARM}, one thread\n")
    print(f"{'':46} us/pose")
    for name, value in us.items():
        print(f"{name:46} {value:7.3f}")
    say_targets(targets_of(us))


if __name__ == "__main__":
    main()
