"""Whether task uncertainties hold what they say: 95 % intervals of features against true errors of virtual arms.

    python benchmarks/task_uncertainty.py [--arms 500] [--readings 80] [--preset shop] [--model kinematic] [--days 1]
        [--jobs 2] [--json]

Each virtual arm is measured at random poses of a person, with a reference point at each, on one day or several (see
another_day.py), and identified. The model then states the uncertainty (`truearm.verification.tasks`, 1000 drawn arms)
of lengths of two points, 50 mm and 1 m, of a length of forty points, a ball, a plate that lies and one that faces
the arm; no
repeatability is given. On a day of its own the virtual arm measures each in 40 ways of holding it, at the mean
temperature of its readings, and its model, which is not told from which side its joints came, compensates. Counted is
how often the error lies in the interval, and how often it is no larger than U: of a form, which errors make too large,
that is what a decision rests on. The latter also of those ways alone of which less than a fifth of the poses are away
from what the model learned from; of others the program says that it may be worse.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from another_day import taken
from machine import Target, arguments_of, print_json, print_table, say_machine, say_targets
from truearm.arm import load_arm
from truearm.compensation.models import MODELS
from truearm.compensation.models.compensator import Compensator
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.typing import FloatArray
from truearm.verification.tasks.feature_postures import feature_postures, middle_of
from truearm.verification.tasks.features import UP, Feature, length_at, plane, sphere
from truearm.verification.tasks.sampled_arms import PosteriorDistribution
from truearm.verification.tasks.task import N_POSTURES, simulate_measurements

# Of these the intervals shall be no wider than needed, too.
TWO_POINTS = ("50 mm", "1 m")
AWAY = 0.2
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
    parser.add_argument("--days", type=int, default=1, help="days on which they are taken, 1 by default")
    parser.add_argument("--jobs", type=int, default=2, help="arms at once, 2 by default")
    options = parser.parse_args()
    begun = time.perf_counter()
    trial = Trial(options.arm, options.preset, options.readings, options.days, options.model)
    seeds = range(options.first, options.first + options.arms)
    with ProcessPoolExecutor(options.jobs) as pool:
        found = list(pool.map(trial.on_one_arm, seeds))
    rows = {name: np.array([one[name] for one in found]) for name in found[0]}
    targets = [coverage(name, each[:, 0].mean(), "least", 0.93) for name, each in rows.items() if name in TWO_POINTS]
    targets += [coverage(name, each[:, 0].mean(), "most", 0.97) for name, each in rows.items() if name in TWO_POINTS]
    targets += [coverage(name, of_near(each), "least", 0.93) for name, each in rows.items() if name not in TWO_POINTS]
    if options.json:
        print_json({"rows": {name: each.tolist() for name, each in rows.items()}}, targets)
        return
    say_machine()
    print(
        f"{options.arms} arms {options.arm}, preset {options.preset}, {options.readings} readings each, "
        f"days {options.days}, model {options.model}, {time.perf_counter() - begun:.0f} s; "
        "shares with their standard errors between arms"
    )
    columns = [
        "feature",
        "in the interval",
        "not above U",
        "of near ways",
        "error, rms [mm]",
        "stated, rms [mm]",
        "U, rms [mm]",
    ]
    print_table(columns, [[name, *told(each)] for name, each in rows.items()])
    say_targets(targets)


@dataclass(frozen=True)
class Trial:
    """Of what arm, preset and model; by name, as each process loads them itself."""

    arm: str
    preset: str
    n_readings: int
    n_days: int
    model: str

    def on_one_arm(self, seed: int) -> dict[str, FloatArray]:
        """Measure and identify one arm; a row of numbers for each feature."""
        arm = load_arm(self.arm)
        virtual = VirtualArm.draw(arm, load_preset(self.preset), seed=seed)
        model = MODELS[self.model](arm).fit_readings(taken(virtual, self.n_readings, self.n_days))
        found = {}
        for name, (feature, ways) in measured_on(self.arm).items():
            true = true_errors(virtual, model, feature, ways, seed=SEED_OF_WAYS + seed)
            stated = simulate_measurements(PosteriorDistribution(model), feature, seed=seed).estimates[0]
            low, high = stated.interval_mm
            inside = ((true >= low) & (true <= high)).mean()
            within = np.abs(true) <= stated.expanded_mm
            near = away_from(model, ways) < AWAY
            rms = np.sqrt((true**2).mean()), np.hypot(stated.u_mm, stated.bias_mm)
            found[name] = np.array([inside, within.mean(), near.sum(), (near & within).sum(), *rms, stated.expanded_mm])
        return found


@cache
def measured_on(arm_name: str) -> dict[str, tuple[Feature, FloatArray]]:
    """The features where a person works, and the ways (m, k, n_joints) of holding each."""
    arm = load_arm(arm_name)
    middle, across = middle_of(arm)
    front = np.cross(across, UP)
    features = {
        "50 mm": length_at(middle, across, 50.0),
        "1 m": length_at(middle, across, 1000.0),
        "500 mm, 40 points": length_at(middle, across, 500.0, points=40),
        "ball 25 mm": sphere(middle, 25.0),
        "plate 200 mm, lying": plane(middle, UP, 200.0),
        "plate 200 mm, facing": plane(middle, front, 200.0),
    }
    return {
        name: (feature, feature_postures(arm, feature, N_POSTURES, seed=SEED_OF_WAYS))
        for name, feature in features.items()
    }


def coverage(name: str, share: float, side: str, limit: float) -> Target:
    """What a share over all arms shall come to."""
    return Target(f"coverage of {name} at {side}", float(share), limit, "above" if side == "least" else "below")


def true_errors(
    virtual: VirtualArm, model: Compensator, feature: Feature, ways: FloatArray, *, seed: int
) -> FloatArray:
    """Errors (m,) [mm] of what an arm measures and its model compensates, in m ways (m, k, n_joints)."""
    assert isinstance(model, IdentifiedModel)
    poses = ways.reshape(-1, ways.shape[2])
    taken = virtual.measure(poses, seed=seed, temperature_degC=model.training_.temperature_degC.mean, reference=False)
    untold = replace(taken.readings, directions=None)
    off = (model.predict_readings(untold) - taken.true_tips).reshape(-1, len(feature.points), 3)
    return np.array([feature.errors(feature.points + one)[0] for one in off])


def away_from(model: Compensator, ways: FloatArray) -> FloatArray:
    """Share (m,) of the poses of each way that are away from those that the model learned from."""
    return model.outside_training(ways.reshape(-1, ways.shape[2])).reshape(len(ways), -1).mean(axis=1)


def of_near(each: FloatArray) -> float:
    """Share of errors no larger than U over all ways that are near, of all arms: some arm may have none."""
    return float(each[:, 3].sum() / each[:, 2].sum())


def told(each: FloatArray) -> list[str]:
    """A row's cells: shares with their standard errors, and root mean squares."""
    shares = [f"{one.mean():.3f} +- {one.std() / np.sqrt(len(one)):.3f}" for one in each[:, :2].T]
    return [*shares, f"{of_near(each):.3f}", *(f"{value:.4f}" for value in np.sqrt((each[:, 4:] ** 2).mean(axis=0)))]


if __name__ == "__main__":
    main()
