"""Whether `measure` holds what it says: U of measured features against true errors of virtual arms.

    python benchmarks/measured_features.py [--arms 40] [--readings 80] [--preset shop] [--model kinematic] [--jobs 2]
        [--json]

Each virtual arm is measured at random poses of a person, with a reference point at each, and identified. On another day
it touches a ball, a bore, a plate and the two ends of a length, held in six ways; `truearm.measure` is given the joint
angles alone. Counted is how often the error of the first quantity (of a plate the height of its middle) is no larger
than U, of ways of which less than a fifth of the poses are outside the trained range.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

import truearm as ta
from another_day import taken
from machine import arguments_of, print_json, print_table, say_machine, say_targets
from task_uncertainty import AWAY, SEED_OF_WAYS, away_from, coverage
from truearm.compensation.models import MODELS
from truearm.compensation.models.compensator import Compensator
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.typing import FloatArray
from truearm.verification.tasks.feature_postures import feature_postures, middle_of
from truearm.verification.tasks.features import UP, Feature, circle, length_at, plane, sphere

WAYS = 6
FEATURES = ("length", "sphere", "plane", "circle")


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--arms", type=int, default=40, help="virtual arms, 40 by default")
    parser.add_argument("--readings", type=int, default=80, help="readings each is identified from, 80 by default")
    parser.add_argument("--arm", default="gao2017")
    parser.add_argument("--preset", default="shop")
    parser.add_argument("--model", default="kinematic", choices=["kinematic", "physical"])
    parser.add_argument("--jobs", type=int, default=2, help="arms at once, 2 by default")
    options = parser.parse_args()
    begun = time.perf_counter()
    trial = Trial(options.arm, options.preset, options.readings, options.model)
    with ProcessPoolExecutor(options.jobs) as pool:
        found = list(pool.map(trial.on_one_arm, range(options.arms)))
    rows = {kind: np.concatenate([one[kind] for one in found]) for kind in FEATURES}
    targets = [coverage(kind, (np.abs(each[:, 0]) <= each[:, 1]).mean(), "least", 0.93) for kind, each in rows.items()]
    if options.json:
        print_json({"rows": {kind: each.tolist() for kind, each in rows.items()}}, targets)
        return
    say_machine()
    print(f"{options.arms} arms {options.arm}, preset {options.preset}, {options.readings} readings each, "
          f"model {options.model}, {time.perf_counter() - begun:.0f} s")  # fmt: skip
    columns = ["feature", "measured", "error not above U", "error, rms [mm]", "u, rms [mm]", "U, rms [mm]"]
    print_table(columns, [[kind, *_cells(each)] for kind, each in rows.items()])
    say_targets(targets)


@dataclass(frozen=True)
class Trial:
    """Of what arm, preset and model; by name, as each process loads them itself."""

    arm: str
    preset: str
    n_readings: int
    model: str

    def on_one_arm(self, seed: int) -> dict[str, FloatArray]:
        """Errors, U and u (m, 3) [mm] of each feature, measured in several ways."""
        arm = ta.load_arm(self.arm)
        virtual = VirtualArm.draw(arm, load_preset(self.preset), seed=seed)
        model = MODELS[self.model](arm).fit_readings(taken(virtual, self.n_readings, 1))
        found = {}
        for kind, feature in features_of(arm).items():
            ways = feature_postures(arm, feature, WAYS, seed=SEED_OF_WAYS)
            ways = ways[away_from(model, ways) < AWAY]
            rows = [self.measured(virtual, model, kind, feature, way, seed + 100 * i) for i, way in enumerate(ways)]
            found[kind] = np.reshape(rows, (-1, 3))
        return found

    def measured(
        self, virtual: VirtualArm, model: Compensator, kind: str, feature: Feature, way: FloatArray, seed: int
    ) -> list[float]:
        """Error, U and u [mm] of the first quantity of a feature; of a plate of the height of its middle."""
        touched = virtual.measure(
            way,
            seed=SEED_OF_WAYS + seed,
            seat_points=feature.points,
            temperature_degC=model.training_.temperature_degC.mean,
            reference=False,
        )
        half = len(feature.points) // 2
        names = np.array(["A"] * half + ["B"] * half) if kind == "length" else None
        session = replace(touched.readings, directions=None, seat=names)
        quantity = (
            ta.measure(model, session, kind, n_arms=400, seed=seed).features[0].quantities[2 if kind == "plane" else 0]
        )
        true = feature.points[:, 2].mean() if kind == "plane" else feature.quantities[0].nominal_mm
        return [quantity.value - true, quantity.expanded, quantity.u]


def features_of(arm: ta.Arm) -> dict[str, Feature]:
    """The features, in front of the arm."""
    middle, across = middle_of(arm)
    return {
        "length": length_at(middle, across, 500.0, points=10),
        "sphere": sphere(middle, 25.0),
        "plane": plane(middle, UP, 200.0),
        "circle": circle(middle, UP, 50.0),
    }


def _cells(each: FloatArray) -> list[str]:
    share = (np.abs(each[:, 0]) <= each[:, 1]).mean()
    rms = np.sqrt((each**2).mean(axis=0))
    return [f"{len(each)}", f"{share:.3f}", *(f"{value:.4f}" for value in rms[[0, 2, 1]])]


if __name__ == "__main__":
    main()
