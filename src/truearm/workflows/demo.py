"""Error of an arm before and after compensation, shown on a virtual arm: the experiment of ``truearm demo``.

The sizes are those of Gao, Zhang, San, Wu, Wang, "Modeling and Error Compensation of Robotic Articulated Arm Coordinate
Measuring Machines Using BP Neural Network", Complexity 2017, article 5156264, section 4: 3000 poses train a network of
30 and 30 units, 200 further poses test it. The paper describes its arm only by the nominal parameters (Table 1) and the
error of the nominal model; the virtual arm of the preset ``research`` has errors of that size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from truearm.arm import load_arm
from truearm.compensation.models import Compensator, KinematicModel, NetworkModel, NominalModel
from truearm.identification.planning.sampling import STRATEGIES
from truearm.identification.virtual import Measurement, VirtualArm, load_preset
from truearm.readings import ErrorComparison, compare_errors

# Mean and maximum absolute error of a coordinate [mm] in the paper: nominal parameters, and the network of row 4 of
# Table 4, on 200 further poses.
PAPER_NOMINAL_MM = (0.4492, 0.8978)
PAPER_NETWORK_MM = (0.0136, 0.0873)

AnyArray = npt.NDArray[Any]


@dataclass(frozen=True)
class Settings:
    """Size of the experiment.

    Attributes
    ----------
    n_train, n_test : int
        Poses.
    hidden : tuple of int
        Units of the hidden layers of the network.
    epochs : int
        Of the training. On ten virtual arms the mean error after them is 0.0083 to 0.0091 mm, the largest of 200
        poses 0.039 to 0.080 mm (the paper's network: 0.0136 and 0.0873 mm).
    """

    n_train: int = 3000
    n_test: int = 200
    hidden: tuple[int, ...] = (30, 30)
    epochs: int = 150


PAPER_SETTINGS = Settings()
QUICK_SETTINGS = Settings(n_train=1500, hidden=(20, 20), epochs=120)


@dataclass(frozen=True, eq=False)
class Experiment:
    """Readings of a virtual arm and the models fitted to them.

    Attributes
    ----------
    arm : VirtualArm
    training : Measurement
        Readings in the box of joint angles.
    tests : dict of str to Measurement
        ``"box"``: further poses in the same box; ``"measuring"``: poses of everyday measuring, far outside it.
    models : dict of str to Compensator
        Fitted to `training`: nominal, network, kinematic.
    """

    arm: VirtualArm
    training: Measurement
    tests: dict[str, Measurement]
    models: dict[str, Compensator]

    def predicted(self, test: str) -> dict[str, AnyArray]:
        """Points (n, 3) of every model on a test [mm]."""
        angles = self.tests[test].readings.angles
        return {name: model.predict(angles) for name, model in self.models.items()}

    def deviations(self, test: str) -> dict[str, AnyArray]:
        """Predicted minus reference points (n, 3) of every model on a test [mm]."""
        points = self.tests[test].readings.points
        assert points is not None  # a virtual reference sees every pose
        return {name: predicted - points for name, predicted in self.predicted(test).items()}

    def errors(self, test: str) -> dict[str, ErrorComparison]:
        """Errors of every model on a test."""
        readings = self.tests[test].readings
        assert readings.points is not None  # a virtual reference sees every pose
        nominal = self.models["nominal"].predict(readings.angles)
        return {name: compare_errors(points, nominal, readings.points) for name, points in self.predicted(test).items()}

    def summary(self) -> dict[str, Any]:
        """The results as ``summary.json`` has them."""
        outside = self.errors("measuring")
        return {
            "arm": self.arm.nominal.name,
            "seed": self.arm.seed,
            "noise_floor": dict(self.arm.noise_floor(self.tests["box"])),
            "models": {
                name: {
                    **errors,
                    "fit_seconds": self.models[name].fit_seconds_,
                    "n_train": self.models[name].n_train_,
                    "outside": dict(outside[name]),
                }
                for name, errors in self.errors("box").items()
            },
        }


def experiment(
    *, seed: int, settings: Settings = PAPER_SETTINGS, progress: Callable[[int, str], None] | None = None
) -> Experiment:
    """Measure with a virtual arm, fit three models, and measure test readings.

    The reference measures points in the base frame of the arm, as in the paper, so that nothing is fitted to the nominal
    model.

    Parameters
    ----------
    seed : int
        Of the errors of the arm, the poses, the noise and the start weights; each has a random stream of its own.
    settings : Settings
    progress : callable, optional
        Called with each epoch of the network's training and its error in words.
    """
    nominal = load_arm("gao2017")
    arm = VirtualArm.draw(nominal, load_preset("research"), seed=seed)

    def measured(strategy: str, n: int, stream: int) -> Measurement:
        # Streams of one experiment are neighbours, those of the next seed begin after them.
        own = 10 * seed + stream
        return arm.measure(STRATEGIES[strategy](nominal, n, seed=own).angles, seed=own)

    training = measured("box", settings.n_train, 0)
    tests = {"box": measured("box", settings.n_test, 1), "measuring": measured("measuring", settings.n_test, 2)}
    models: dict[str, Compensator] = {
        "nominal": NominalModel(nominal, free=()),
        "network": NetworkModel(
            nominal, free=(), hidden=settings.hidden, epochs=settings.epochs, validation=0.0, seed=seed
        ),
        "kinematic": KinematicModel(nominal, free=()),
    }
    for name, model in models.items():
        model.fit_readings(training.readings, progress=progress if name == "network" else None)
    return Experiment(arm, training, tests, models)
