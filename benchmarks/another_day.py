"""Is the stated uncertainty right on another day? Virtual arms, learned from readings of one, two or four days.

    python benchmarks/another_day.py [--arms 24] [--readings 80] [--preset shop] [--json]

Each arm is measured at the poses of a person, as many readings in all, spread over the days in the same set-up. From
one day to the next its ball cages start elsewhere, which no reading of a single day shows. The models then predict
other poses, on a day from which they did not learn, at the mean temperature and with no word on directions of movement.
Counted are coordinates within 1.96 stated standard uncertainties, where no joint is away from the training angles.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from machine import arguments_of, print_json, print_table, say_machine
from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel, PhysicalModel
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.identification.planning.sampling.measuring import measuring_poses
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.readings import Session

DAYS = (1, 2, 4)
MODELS: dict[str, type[IdentifiedModel]] = {"kinematic": KinematicModel, "physical": PhysicalModel}
TESTED = 600
# Days are numbered from 0, and none is the same in two arms.
SEEDS_A_DAY = 100_000
LAST_DAY = 999


def taken(virtual: VirtualArm, n_readings: int, n_days: int) -> Session:
    """Readings of some days in one set-up."""
    angles = np.array_split(measuring_poses(virtual.nominal, n_readings, seed=virtual.seed).angles, n_days)
    seed = virtual.seed
    days = [virtual.measure(poses, seed=seed + SEEDS_A_DAY * day).readings for day, poses in enumerate(angles)]
    names = ("angles", "points", "point_std", "temperature_degC", "directions")
    return Session(**{name: np.concatenate([getattr(day, name) for day in days]) for name in names})


def on_another_day(model: IdentifiedModel, virtual: VirtualArm) -> dict[str, float]:
    """Root mean square error and stated standard uncertainty of a coordinate [mm], and the share within 95 %."""
    seed = virtual.seed + SEEDS_A_DAY * LAST_DAY
    angles = measuring_poses(virtual.nominal, TESTED, seed=seed).angles
    angles = angles[~model.outside_training(angles)]
    day = virtual.measure(angles, seed=seed, temperature_degC=model.training_.temperature_degC.mean, reference=False)
    points, covariance = model.predict_readings(replace(day.readings, directions=None), return_cov=True)
    off, std = points - day.true_tips, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return {
        "rms_mm": float(np.sqrt((off**2).mean())),
        "stated_mm": float(np.sqrt((std**2).mean())),
        "in_95_percent": float((np.abs(off) < 1.96 * std).mean()),
    }


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--arms", type=int, default=24, help="virtual arms, 24 by default")
    parser.add_argument("--readings", type=int, default=80, help="readings each is identified from, 80 by default")
    parser.add_argument("--preset", default="shop")
    options = parser.parse_args()
    arm, preset = load_arm("gao2017"), load_preset(options.preset)
    found: dict[str, list[dict[str, float]]] = {f"{name}, {days}": [] for name in MODELS for days in DAYS}
    for seed in range(options.arms):
        virtual = VirtualArm.draw(arm, preset, seed=seed)
        for days in DAYS:
            readings = taken(virtual, options.readings, days)
            for name, kind in MODELS.items():
                model = kind(arm).fit_readings(readings)
                found[f"{name}, {days}"].append(on_another_day(model, virtual))
    if options.json:
        print_json({"arms": found}, [])
        return
    say_machine()
    print(f"\n{options.arms} arms gao2017, preset {options.preset}, {options.readings} readings each: a later day\n")
    rows = []
    for label, each in found.items():
        rms, stated = (np.sqrt(np.mean([one[name] ** 2 for one in each])) for name in ("rms_mm", "stated_mm"))
        share = np.array([one["in_95_percent"] for one in each])
        told = f"{share.mean():.1%} +- {share.std() / np.sqrt(len(share)):.1%}"
        rows.append([*label.split(", "), f"{rms:.4f}", f"{stated:.4f}", told])
    print_table(["model", "days", "error, rms [mm]", "stated, rms [mm]", "within 95 %"], rows)


if __name__ == "__main__":
    main()
