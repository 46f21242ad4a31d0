"""Claims of the founding paper that no table of it tests, on a virtual arm with its error. One run.

    python benchmarks/paper_claims.py [--json] [--claims conditions,everyday,poses] [--train N] [--epochs N]

conditions: a network and models of the arm are trained at 20 degC and 2 N and tested warm, with another measuring
force, and on a tilted arm; beside them a network and models that are given the temperature. everyday: both are trained
on poses of everyday measuring instead of a box. poses: the network of 20-20 units of the simulation with more and more
poses. Errors are absolute errors of one coordinate on 1000 further poses; nobody adapts to a test.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np

from machine import arguments_of, print_json, print_table, say_machine
from truearm.arm import load_arm
from truearm.compensation.models import Compensator, HybridModel, KinematicModel, PhysicalModel
from truearm.compensation.nets.nguyen_widrow import nguyen_widrow
from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.perceptron import Perceptron
from truearm.compensation.nets.scaling import MinMaxScaler
from truearm.compensation.nets.train_varpro import train_varpro
from truearm.identification.planning.sampling import box, measuring_poses
from truearm.identification.virtual import Measurement, VirtualArm, load_preset
from truearm.papers.gao2017.training_plan import EXPERIMENT, SIMULATION
from truearm.readings import Session
from truearm.typing import FloatArray

N_TEST = 1000
WARM_DEGC, SPAN_DEGC, STRONG_N, TILT_DEG = 28.0, (15.0, 30.0), 6.0, 90.0
NUMBERS_OF_POSES = (1000, 3000, 9000, 18000)
ARM = load_arm("gao2017")


@dataclass(frozen=True)
class DirectNetwork:
    """The paper's network: coordinates from the angles, and from the temperature where it is an input."""

    network: Perceptron
    weights: FloatArray
    inputs: Callable[[Session], FloatArray]
    scales: tuple[MinMaxScaler, MinMaxScaler]

    @classmethod
    def trained(
        cls, readings: Session, *, hidden: tuple[int, ...], epochs: int, with_temperature: bool = False
    ) -> DirectNetwork:
        """Train on all readings by variable projection."""

        def inputs(session: Session) -> FloatArray:
            given = [session.angles.T]
            if with_temperature:
                assert session.temperature_degC is not None  # the virtual arm measures it
                given.append(session.temperature_degC[None])
            return np.concatenate(given)

        x, points = inputs(readings), points_of(readings)
        scales = MinMaxScaler.of(x, what="input"), MinMaxScaler.of(points.T, what="coordinate")
        network = Perceptron.with_layers(len(x), hidden, 3)
        problem = FitProblem(network, scales[0].scale(x), scales[1].scale(points.T))
        weights, _ = train_varpro(problem, nguyen_widrow(network, seed=0), epochs=epochs)
        return cls(network, weights, inputs, scales)

    def predict_readings(self, readings: Session) -> FloatArray:
        """Points (n, 3) [mm]."""
        outputs = self.network.outputs(self.weights, self.scales[0].scale(self.inputs(readings)))
        return np.asarray(self.scales[1].unscale(outputs).T)


def points_of(readings: Session) -> FloatArray:
    """Reference points, which a virtual reference has of every pose."""
    assert readings.points is not None
    return readings.points


def fitted(readings: Session, *, epochs: int) -> dict[str, DirectNetwork | Compensator]:
    """The paper's network and the models of the arm, fitted to the same readings; prints the CPU time of each."""
    made: dict[str, Callable[[], DirectNetwork | Compensator]] = {
        "network": lambda: DirectNetwork.trained(readings, hidden=(30, 30), epochs=epochs),
        "kinematic": lambda: KinematicModel(ARM, free=()).fit_readings(readings),
        "hybrid": lambda: HybridModel(ARM, free=()).fit_readings(readings),
        "physical": lambda: PhysicalModel(ARM, free=()).fit_readings(readings),
    }
    models = {}
    for name, fit in made.items():
        begun = process_time()
        models[name] = fit()
        print(f"  {name}: {process_time() - begun:.1f} s of CPU time", flush=True)
    return models


def mean_errors(models: dict[str, Any], tests: dict[str, Measurement]) -> dict[str, dict[str, float]]:
    """Mean absolute coordinate error [mm] of every model on every test."""
    return {
        name: {
            what: float(np.abs(model.predict_readings(test.readings) - points_of(test.readings)).mean())
            for what, test in tests.items()
        }
        for name, model in models.items()
    }


def research_arm() -> VirtualArm:
    """The arm of the experiment, seed 0."""
    return VirtualArm.draw(ARM, load_preset("research"), seed=0)


def in_box(n: int, *, seed: int, half_width_deg: float = EXPERIMENT.half_width_deg) -> FloatArray:
    """Angles (n, 6) [rad] in the box of the experiment."""
    return box(ARM, n, seed=seed, half_width=np.radians(half_width_deg)).angles


def conditions(*, n_train: int, epochs: int) -> dict[str, dict[str, float]]:
    """Errors of models that were trained at 20 degC and 2 N, and of models that are given the temperature."""
    arm, angles, test = research_arm(), in_box(n_train, seed=0), in_box(N_TEST, seed=1)
    strong = replace(arm, preset=replace(arm.preset, force_mean_N=STRONG_N))
    tilt = np.radians(TILT_DEG)
    down = np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    wall = replace(arm, nominal=replace(arm.nominal, gravity_in_base=down))
    tests = {
        "20 degC, 2 N": arm.measure(test, seed=1),
        f"{WARM_DEGC:g} degC": arm.measure(test, seed=1, temperature_degC=WARM_DEGC),
        f"{STRONG_N:g} N": strong.measure(test, seed=1),
        "on a wall": wall.measure(test, seed=1),
    }
    errors = mean_errors(fitted(arm.measure(angles, seed=0).readings, epochs=epochs), tests)
    slow = np.linspace(*SPAN_DEGC, n_train)  # a day that warms up
    taught = arm.measure(angles, seed=0, temperature_degC=slow).readings
    models = {
        "network, temperature": DirectNetwork.trained(taught, hidden=(30, 30), epochs=epochs, with_temperature=True),
        "hybrid, temperature": HybridModel(ARM, free=()).fit_readings(taught),
        "physical, temperature": PhysicalModel(ARM, free=()).fit_readings(taught),
    }
    return errors | mean_errors(models, tests)


def everyday(*, n_train: int, epochs: int) -> dict[str, dict[str, float]]:
    """Errors in everyday poses of models that were trained there."""
    arm = research_arm()
    readings = arm.measure(measuring_poses(ARM, n_train, seed=0).angles, seed=0).readings
    tests = {
        "everyday poses": arm.measure(measuring_poses(ARM, N_TEST, seed=1).angles, seed=1),
        "the box": arm.measure(in_box(N_TEST, seed=1), seed=1),
    }
    return mean_errors(fitted(readings, epochs=epochs), tests)


def numbers_of_poses() -> dict[str, dict[str, float]]:
    """Errors on training and further poses of 20-20 units in the simulation, by the number of training poses."""
    found = {}
    for n in NUMBERS_OF_POSES:
        sets = {}
        for what, size, seed in (("training poses", n, 0), ("further poses", 2000, 1)):
            angles = in_box(size, seed=seed, half_width_deg=SIMULATION.half_width_deg)
            sets[what] = Session(angles, points=ARM.chain.tip_in_base(angles))
        network = DirectNetwork.trained(sets["training poses"], hidden=(20, 20), epochs=60)
        found[str(n)] = {
            what: float(np.abs(network.predict_readings(readings) - points_of(readings)).mean())
            for what, readings in sets.items()
        }
    return found


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--claims", default="conditions,everyday,poses", help="some of them")
    parser.add_argument("--train", type=int, default=3000, help="training poses, 3000 by default")
    parser.add_argument("--epochs", type=int, default=150, help="of the network, 150 by default")
    options = parser.parse_args()
    if not options.json:
        say_machine()
    works: dict[str, Callable[[], dict[str, dict[str, float]]]] = {
        "conditions": lambda: conditions(n_train=options.train, epochs=options.epochs),
        "everyday": lambda: everyday(n_train=options.train, epochs=options.epochs),
        "poses": numbers_of_poses,
    }
    found = {}
    for name in options.claims.split(","):
        found[name] = works[name]()
        if not options.json:
            columns = list(next(iter(found[name].values())))
            print(f"\n{name}: mean absolute error of a coordinate [mm]")
            rows = [[label, *(f"{errors[c]:.4f}" for c in columns)] for label, errors in found[name].items()]
            print_table(["", *columns], rows)
    if options.json:
        print_json(found, [])


if __name__ == "__main__":
    main()
