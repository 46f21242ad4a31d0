"""Error of an arm before and after compensation, shown on a virtual arm: the experiment of ``truearm demo``.

The sizes are those of Gao, Zhang, San, Wu, Wang, "Modeling and Error Compensation of Robotic Articulated Arm Coordinate
Measuring Machines Using BP Neural Network", Complexity 2017, article 5156264, section 4: 3000 poses train a network of
30 and 30 units, 200 further poses test it. The paper describes its arm only by the nominal parameters (Table 1) and the
error of the nominal model; the virtual arm of the preset ``research`` has errors of that size.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np

from truearm.files.atomic_write import atomic_file
from truearm.models import Compensator, HybridModel, KinematicModel, NetworkModel, NominalModel, PhysicalModel
from truearm.models.uncertainty import uncertainty_budget
from truearm.pages.drawings.error_figures import before_after
from truearm.pages.drawings.page_record import check_folder
from truearm.pages.html import render
from truearm.pages.page import Page, Section
from truearm.readings import ErrorComparison, compare_errors
from truearm.typing import FloatArray
from truearm.verbs.record import Record, TextTable, format_fixed
from truearm.wings.gao2017.tables import FINAL_TEST
from truearm.wings.gao2017.training import TEST_STREAM, TRAINING_STREAM, Source, stream_seed, virtual_arm
from truearm.wings.gao2017.training_plan import EXPERIMENT
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import Measurement, VirtualArm
from truearm.wings.reports.comparison import compare_models, page_facts
from truearm.wings.reports.comparison_page import comparison_page, comparison_verdict, error_table, improvement_sentence

if TYPE_CHECKING:
    from truearm.pages.plotting import Figure

# Files of the folder that `DemoResult.save` writes.
FILES = ("report.html", "summary.json", "before_after.png")

# The network of this experiment is trained by truearm's own trainer on all poses. What the paper's trainer leaves of
# the errors of the arm of seed 0 on 200 further poses [mm]: the final test of ``truearm reproduce gao2017 --table 4``.
TRAINER = "varpro"
PAPER_TRAINER_MM = (0.0147, 0.1250)
PAPER_TRAINER_COMMAND = "truearm reproduce gao2017 --table 4"


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
        Of the training.
    half_width_deg : float
        Half the range of every joint.
    """

    n_train: int = 3000
    n_test: int = 200
    hidden: tuple[int, ...] = (30, 30)
    epochs: int = 150
    half_width_deg: float = EXPERIMENT.half_width_deg


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
        Fitted to `training`: nominal, network, kinematic, hybrid, physical.
    fit_cpu_seconds : dict of str to float
        CPU time of each fit, which does not depend on what else the machine does.
    """

    arm: VirtualArm
    training: Measurement
    tests: dict[str, Measurement]
    models: dict[str, Compensator]
    fit_cpu_seconds: dict[str, float]

    def predicted(self, test: str) -> dict[str, FloatArray]:
        """Points (n, 3) of every model on a test [mm]."""
        angles = self.tests[test].readings.angles
        return {name: model.predict(angles) for name, model in self.models.items()}

    def deviations(self, test: str) -> dict[str, FloatArray]:
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
            "network_trainer": {"name": TRAINER, "validation_share": 0.0, "test_share": 0.0},
            "network_by_papers_trainer": {
                "name": "trainlm",
                "validation_share": 0.15,
                "test_share": 0.15,
                "seed": 0,
                "mean_abs_coordinate_mm": PAPER_TRAINER_MM[0],
                "max_abs_coordinate_mm": PAPER_TRAINER_MM[1],
                "command": PAPER_TRAINER_COMMAND,
            },
            "models": {
                name: {
                    **errors,
                    "fit_seconds": self.models[name].fit_seconds_,
                    "fit_cpu_seconds": self.fit_cpu_seconds[name],
                    "n_train": self.models[name].n_train_,
                    "outside": dict(outside[name]),
                }
                for name, errors in self.errors("box").items()
            },
        }


def experiment(
    *, seed: int, settings: Settings = PAPER_SETTINGS, progress: Callable[[int, str], None] | None = None
) -> Experiment:
    """Measure with a virtual arm, fit the models, and measure test readings.

    The reference measures points in the base frame of the arm, as in the paper: the nominal model has nothing to fit.

    Parameters
    ----------
    seed : int
        Of the errors of the arm, the poses, the noise and the start weights; each has a random stream of its own.
    settings : Settings
    progress : callable, optional
        Called with each epoch of the network's training and its error in words.
    """
    arm, source, everyday = virtual_arm(seed), Source(settings.half_width_deg, virtual=True), stream_seed(seed, 2)
    nominal = arm.nominal
    training = source.measurement(settings.n_train, seed=seed, stream=TRAINING_STREAM)
    tests = {
        "box": source.measurement(settings.n_test, seed=seed, stream=TEST_STREAM),
        "measuring": arm.measure(measuring_poses(nominal, settings.n_test, seed=everyday).angles, seed=everyday),
    }
    models: dict[str, Compensator] = {
        "nominal": NominalModel(nominal, free=()),
        "network": NetworkModel(
            nominal, free=(), hidden=settings.hidden, trainer=TRAINER, epochs=settings.epochs, validation=0.0, seed=seed
        ),
        "kinematic": KinematicModel(nominal, free=()),
        "hybrid": HybridModel(nominal, free=(), seed=seed),
        "physical": PhysicalModel(nominal, free=()),
    }
    cpu_seconds = {}
    for name, model in models.items():
        begun = process_time()
        model.fit_readings(training.readings, progress=progress if name == "network" else None)
        cpu_seconds[name] = process_time() - begun
    return Experiment(arm, training, tests, models, cpu_seconds)


def demo(*, seed: int = 0, quick: bool = False, progress: Callable[[int, str], None] | None = None) -> DemoResult:
    """Repeat the founding paper's experiment on a virtual measuring arm, with another trainer of the network.

    3000 poses in a box of joint angles train a network (the paper's 30-30, by ``varpro`` on all poses, where the paper
    has ``trainlm`` with validation poses) and identify a kinematic, a hybrid and a physical model; all are tested on
    200 further poses of the box and on 200 of everyday measuring, far outside it.

    Parameters
    ----------
    seed : int
        Another arm, other poses, other noise.
    quick : bool
        Half of the poses and a smaller network.
    progress : callable, optional
        Called with the network's epoch and a note.
    """
    settings = QUICK_SETTINGS if quick else PAPER_SETTINGS
    return DemoResult(experiment(seed=seed, settings=settings, progress=progress), quick)


def trainer_sentence() -> str:
    """Which trainer the network of the experiment has, and what the paper's own leaves."""
    mean, largest = (f"{value:.4f}" for value in PAPER_TRAINER_MM)
    return (
        f"The trainer is not the paper's: {TRAINER}, on all poses. By the paper's own, trainlm with 15 % of the poses "
        f"for validation and 15 % for test, the network of 30-30 units has mean {mean}, max {largest} on the arm of "
        f"seed 0 ({PAPER_TRAINER_COMMAND})."
    )


def demo_epochs(*, quick: bool) -> int:
    """Number of training epochs, by which progress is counted."""
    return (QUICK_SETTINGS if quick else PAPER_SETTINGS).epochs


@dataclass(frozen=True, eq=False, repr=False)
class DemoResult(Record):
    """The paper's experiment on a virtual arm.

    Attributes
    ----------
    experiment : Experiment
        The arm, its readings and the models.
    quick : bool
    """

    experiment: Experiment
    quick: bool

    @cached_property
    def _numbers(self) -> dict[str, Any]:
        return self.experiment.summary()

    def _json(self) -> object:
        return self._numbers

    def summary(self) -> str:
        """The answer in the sentence of the page, and whose it is."""
        mean = {name: errors["mean_mm"] for name, errors in self._numbers["models"].items()}
        best = min(mean, key=mean.__getitem__)
        answer = improvement_sentence("Mean error", mean["nominal"], mean[best]).rstrip(".")
        return f"{answer}: {best} model of virtual arm {self._numbers['arm']}, seed {self._numbers['seed']}."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        models = self._numbers["models"]
        n_train, n = models["network"]["n_train"], models["network"]["n"]
        yield self.summary()
        yield f"{n_train} training poses; {n} test poses in the same box of joint angles, {n} of everyday work outside."
        yield "Distance from the reference point [mm]:"
        yield self._table()
        paper = FINAL_TEST["network"]
        own = (format_fixed(models["network"][f"{which}_abs_coordinate_mm"]) for which in ("mean", "max"))
        yield (
            f"The paper states errors of single coordinates: its network, on its own arm, mean {paper.mean_mm}, max "
            f"{paper.max_mm}, 97 % removed; this network mean {', max '.join(own)}."
        )
        yield trainer_sentence()
        yield (
            f"The network is valid only inside its box, {EXPERIMENT.half_width_deg:g} deg to each side, which the "
            "paper does not state; its error depends on that box."
        )
        yield "The models of the arm are valid outside it too, the hybrid without what its networks add."

    def _table(self) -> TextTable:
        rows = []
        for name, m in self._numbers["models"].items():
            parts = [m["mean_mm"], m["max_mm"]]
            outside = [m["outside"]["mean_mm"], m["outside"]["max_mm"]]
            removed = f"{m['removed_percent']:.1f}" if name != "nominal" else ""
            rows.append(
                [name, *map(format_fixed, parts), removed, *map(format_fixed, outside), f"{m['fit_cpu_seconds']:.1f}"]
            )
        floor = self._numbers["noise_floor"]
        mean, largest = format_fixed(floor["mean_mm"]), format_fixed(floor["max_mm"])
        rows.append(["noise floor", mean, largest, "", "", "", ""])
        return TextTable(["model", "mean", "max", "removed %", "outside mean", "outside max", "fit CPU s"], rows)

    def figure(self) -> Figure | None:
        """Errors before and after compensation."""
        return before_after(
            {name: np.linalg.norm(errors, axis=1) for name, errors in self.experiment.deviations("box").items()}
        )

    def page(self) -> Page:
        """The report: the box in full, the poses outside it as a table."""
        done = self.experiment
        session = done.tests["box"].readings
        floor = done.arm.noise_floor(done.tests["box"])
        outside = Section(
            "Outside the trained range",
            "Poses of everyday measuring are far outside the box of joint angles that the models were trained on. "
            "There the network is not valid. The kinematic and the physical model describe the arm itself and are "
            "valid everywhere; what remains with the kinematic one (encoder harmonics, bending) are effects that it "
            "has no terms for.",
            tables=(
                error_table(
                    {name: dict(errors) for name, errors in done.errors("measuring").items()},  # type: ignore[arg-type]
                    caption="Errors on poses of everyday measuring, none of them used for training",
                ),
            ),
        )
        preset, seed = done.arm.preset.name, done.arm.seed
        facts = [
            ("experiment", f"virtual arm, preset {preset}, seed {seed}{', quick' if self.quick else ''}"),
            ("noise floor", f"mean error {floor['mean_mm']:.4f} mm: no model can be better"),
            *page_facts(done.models, session, {}),
        ]
        budgets = {"physical": uncertainty_budget(done.models["physical"], session)[0]}
        compared = replace(
            compare_models(done.models, session, {}), std_mm={name: budget.std_mm for name, budget in budgets.items()}
        )
        return comparison_page(
            compared,
            verdict=comparison_verdict(compared, budgets),
            title="A measuring arm before and after compensation",
            subtitle="The experiment of Gao et al. (Complexity 2017, 5156264) on a virtual arm with such errors",
            facts=facts,
            remarks=(trainer_sentence(),),
            floor=dict(floor),  # type: ignore[arg-type]
            more=(outside,),
        )

    def save(self, folder: str | Path) -> None:
        """Write the report, the numbers and a picture to a folder, which is made where it does not exist."""
        folder = Path(folder)
        check_folder(folder, FILES)
        picture, texts = (
            self.figure(),
            {
                "report.html": render(self.page()),
                "summary.json": json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n",
            },
        )
        assert picture is not None
        # All that takes time is done: an interruption before this leaves no folder.
        folder.mkdir(parents=True, exist_ok=True)
        picture.save(folder / "before_after.png")
        for name, text in texts.items():
            with atomic_file(folder / name) as beside:
                beside.write_text(text, encoding="utf-8", newline="\n")
