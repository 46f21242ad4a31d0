"""Whether task uncertainties hold what they say: 95 % intervals of lengths against true errors of virtual arms.

    python benchmarks/task_uncertainty.py [--arms 500] [--readings 80] [--preset shop] [--model kinematic] [--json]

Each virtual arm is measured at random poses of a person, with a reference point at each, and identified. The model then
states the uncertainty of a length of 50 mm and of 1 m (`truearm.tasks`, 1000 drawn arms); and the virtual arm measures
that length in 40 ways of holding it, at the mean temperature of its readings. Counted is how often the error of the
length, compensated by the model, lies in the interval.
"""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt

from machine import Target, arguments_of, say_json, say_machine, say_table
from truearm.arm import load
from truearm.models import MODELS
from truearm.models.compensator import Compensator
from truearm.models.identified import IdentifiedModel
from truearm.poses.measuring import measuring
from truearm.tasks.errors import ModelErrors
from truearm.tasks.features import Feature, length_at
from truearm.tasks.postures import held, middle_of
from truearm.tasks.task import WAYS, measured_by
from truearm.virtual import VirtualArm, load_preset

FloatArray = npt.NDArray[np.float64]

LENGTHS_MM = (50.0, 1000.0)
# Poses for the truth are other ones than the task's.
SEED_OF_WAYS = 1_000_000


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--arms", type=int, default=500, help="virtual arms, 500 by default")
    parser.add_argument("--first", type=int, default=0, help="seed of the first, 0 by default")
    parser.add_argument("--readings", type=int, default=80, help="readings each is identified from, 80 by default")
    parser.add_argument("--arm", default="gao2017")
    parser.add_argument("--preset", default="shop")
    parser.add_argument("--model", default="kinematic", choices=["kinematic", "physical"])
    options = parser.parse_args()
    begun = time.perf_counter()
    arm = load(options.arm)
    middle, across = middle_of(arm)
    features = [length_at(middle, across, length) for length in LENGTHS_MM]
    ways = [held(arm, feature, WAYS, seed=SEED_OF_WAYS) for feature in features]
    found: list[list[FloatArray]] = [[] for _ in features]
    for seed in range(options.first, options.first + options.arms):
        virtual = VirtualArm.draw(arm, load_preset(options.preset), seed=seed)
        readings = virtual.measure(measuring(arm, options.readings, seed=seed).angles, seed=seed).readings
        model = MODELS[options.model](arm).fit_readings(readings)
        for feature, angles, of_feature in zip(features, ways, found, strict=True):
            true = true_errors(virtual, model, feature, angles, seed=SEED_OF_WAYS + seed)
            stated = measured_by(ModelErrors(model), feature, seed=seed).estimates[0]
            low, high = stated.interval_mm
            inside = ((true >= low) & (true <= high)).mean()
            numbers = [inside, np.sqrt((true**2).mean()), stated.u_mm, stated.u_of_arm_mm, stated.u_of_points_mm]
            of_feature.append(np.array(numbers))
    rows = {length: np.array(each) for length, each in zip(LENGTHS_MM, found, strict=True)}
    targets = [
        Target(f"coverage of {length:g} mm at {side} {limit:.0%}", float(each[:, 0].mean()), limit, good)
        for length, each in rows.items()
        for side, limit, good in (("least", 0.93, "above"), ("most", 0.97, "below"))
    ]
    if options.json:
        say_json({"rows": {f"{k:g}": v.mean(axis=0).tolist() for k, v in rows.items()}}, targets)
        return
    say_machine()
    print(
        f"{options.arms} arms {options.arm}, preset {options.preset}, {options.readings} readings each, model "
        f"{options.model}, {time.perf_counter() - begun:.0f} s; coverage with its standard error between arms"
    )
    say_table(
        ["length [mm]", "coverage", "error, rms [mm]", "u stated, rms [mm]", "of arm [mm]", "of points [mm]"],
        [[f"{length:g}", *told(each)] for length, each in rows.items()],
    )


def true_errors(
    virtual: VirtualArm, model: Compensator, feature: Feature, ways: FloatArray, *, seed: int
) -> FloatArray:
    """Errors (m,) [mm] of a length measured by an arm and compensated by its model, in m ways (m, 2, n_joints)."""
    assert isinstance(model, IdentifiedModel)
    poses = ways.reshape(-1, ways.shape[2])
    taken = virtual.measure(poses, seed=seed, temperature_degC=model.temperature_degC_, reference=False)
    shown = model.predict_readings(taken.readings).reshape(-1, len(feature.points), 3)
    true = taken.true_tips.reshape(shown.shape)
    return np.array([feature.evaluate(s)[0] - feature.evaluate(t)[0] for s, t in zip(shown, true, strict=True)])


def told(each: FloatArray) -> list[str]:
    """A row's cells: coverage with its standard error, and root mean squares."""
    inside = each[:, 0]
    rms = np.sqrt((each[:, 1:] ** 2).mean(axis=0))
    return [f"{inside.mean():.3f} +- {inside.std() / np.sqrt(len(inside)):.3f}", *(f"{value:.4f}" for value in rms)]


if __name__ == "__main__":
    main()
