"""The demonstration of a connected arm: a virtual one with planted errors, a tracker, and a plan, in a folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from truearm.arm import load_arm
from truearm.typing import FloatArray
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.sources import Source
from truearm.wings.bench.sources.replay import virtual_arm
from truearm.wings.planning.plan import plan
from truearm.wings.planning.virtual import VirtualArm

DEMO_ARM, PRESET, SEED = "ur10", "research", 1
POSES = 30
TRACKER_STD_MM = 0.02
# Where the tracker has the arm's base: turned by a quarter, and somewhere else.
T_TRACKER_BASE = np.array([[0.0, -1.0, 0.0, 1500.0], [1.0, 0.0, 0.0, 300.0], [0.0, 0.0, 1.0, -400.0], [0, 0, 0, 1.0]])


def demo_recording(
    folder: Path, *, samples_hz: float = 0.0, progress: Callable[[int, str], None] | None = None
) -> Recording:
    """A recording of a virtual arm that is steered.

    Parameters
    ----------
    folder : Path
        Where the plan, the session and the model are written.
    samples_hz : float
        As of `record`.
    progress : callable, optional
        As of `plan`.
    """
    plan_file = folder / "plan.csv"
    plan(DEMO_ARM, "tracker", poses=POSES, noise_mm=TRACKER_STD_MM, seed=SEED, progress=progress).save(plan_file)
    return Recording(
        demo_source(),
        folder / "session.csv",
        arm=DEMO_ARM,
        plan=plan_file,
        rank=True,
        out_model=folder / "arm.truearm",
        samples_hz=samples_hz,
    )


def demo_source(seed: int = SEED) -> Source:
    """A virtual arm with errors, which a tracker measures in a frame of its own."""
    arm = load_arm(DEMO_ARM)
    virtual, noise = VirtualArm.draw(arm, PRESET, seed=seed), np.random.default_rng(seed)

    def measured_tip(angles: FloatArray) -> FloatArray:
        tip = virtual.true_tip(angles[None])[0] + TRACKER_STD_MM * noise.standard_normal(3)
        return np.asarray(T_TRACKER_BASE[:3, :3] @ tip + T_TRACKER_BASE[:3, 3])

    return virtual_arm(arm, measured_tip=measured_tip, is_at_rest=True)
