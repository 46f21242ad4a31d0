"""The paper's procedure on readings of a person's own: choose a network by trying, train it, test it on fresh poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearm.arm import Arm
from truearm.compensation.models import NetworkModel
from truearm.identification.judgement.cross_validation_groups import cross_validation_groups
from truearm.identification.judgement.paired_comparison import exceeds
from truearm.number_format import format_count, format_number
from truearm.papers.gao2017.results import MODELS
from truearm.papers.gao2017.search import LEAST_TRIED, CoordinateErrors, CrossValidation, SearchGrid, SettingResult
from truearm.papers.gao2017.training import ProgressCallback
from truearm.papers.gao2017.trials import Fit
from truearm.readings.session import Session
from truearm.typing import FloatArray

SIMPLEST_FIRST = ("nominal", "kinematic", "physical", "hybrid", "network")
GAIN = 1.1  # of twice the readings, from which more are worth measuring


@dataclass(frozen=True, eq=False)
class Procedure:
    """Everything that the procedure found.

    Attributes
    ----------
    grid : SearchGrid
    n_readings, n_groups : int
        Training readings, and the positions or poses that the folds keep together.
    search : tuple of SettingResult
        Table 4 of this arm.
    amounts : tuple of SettingResult
        The chosen network with fewer readings, and last with all of a fold.
    chosen : SettingResult
    network : NetworkModel
        Trained on all readings.
    fresh : bool
        Whether readings of their own tested the models; else those that the folds held out.
    points : (n, 3) array
        Of the test [mm].
    predicted : dict of str to (n, 3) array
        By model [mm]: the network and, of an arm that is known, nominal, kinematic, hybrid and physical.
    errors : dict of str to CoordinateErrors
    n_outside : int
        Readings of the test outside the trained range.
    best : str or None
        The simplest model whose error exceeds the smallest by no more than a standard error; None without an arm.
    refused : dict of str to str
        Models that these readings do not determine, and why.
    """

    grid: SearchGrid
    n_readings: int
    n_groups: int
    search: tuple[SettingResult, ...]
    amounts: tuple[SettingResult, ...]
    chosen: SettingResult
    network: NetworkModel
    fresh: bool
    points: FloatArray
    predicted: dict[str, FloatArray]
    errors: dict[str, CoordinateErrors]
    n_outside: int
    best: str | None
    refused: dict[str, str]

    def test_phrase(self) -> str:
        """What the models were tested on."""
        n = len(self.points)
        return f"on {n} fresh readings" if self.fresh else f"on {n} readings that the cross-validation held out"

    def test_sentence(self) -> str:
        """What the test is, and what its errors are worth."""
        if self.fresh:
            return f"The test has {format_count(len(self.points), 'fresh reading')}, which no model has learned."
        return (
            "There are no fresh readings: every reading is predicted by models that were fitted without its fold. That "
            "the same readings chose the network makes its error too small, that it learned fewer of them too large. "
            "Fresh readings: --test."
        )

    def summary(self) -> str:
        """The answer: errors of the network and of the model to use, and which that is."""
        own = self.errors["network"]
        text = (
            f"Your network ({self.chosen.setting}): mean error {format_number(own.mean_mm)} mm of a coordinate "
            f"{self.test_phrase()}, 2 sigma {format_number(own.two_sigma_mm)} mm"
        )
        if self.best is None:
            return f"{text}."
        others = {name: one.mean_mm for name, one in self.errors.items() if name != "network"}
        name = min(others, key=lambda name: others[name]) if self.best == "network" else self.best
        ratio = own.mean_mm / others[name] if others[name] > 0 else 1.0
        compared = f", {ratio:.1f} times smaller" if ratio > 1.05 else ""
        use = "network, within its joint ranges" if self.best == "network" else f"{name} model"
        return f"{text}; {name} model {format_number(others[name])} mm{compared}: use the {use}."

    def advice(self) -> str:
        """What to know before using the result."""
        valid = "A network is valid only within the joint ranges of its readings."
        if self.best is None:
            few = "Its error still falls with the number of readings. " if self.is_falling else ""
            return f"{few}{valid} A model of the arm (--arm) needs far fewer readings."
        if self.best == "network":
            return valid
        if self.errors["network"].mean_mm > 1.05 * self.errors[self.best].mean_mm:
            n = format_count(self.n_readings, "reading")
            return f"With {n} a network does not reach the {self.best} model. {valid}"
        return f"The {self.best} model is the simpler one, and the network is no better. {valid}"

    @property
    def is_falling(self) -> bool:
        """Whether the last doubling of the readings, or what was tried of it, lowered the error by a tenth or more."""
        errors = [one.errors.mean_mm for one in self.amounts]
        return len(errors) > 1 and errors[-2] > GAIN * errors[-1]

    def amounts_sentence(self) -> str:
        """How the error falls with the number of readings."""
        values = ", ".join(f"{format_number(one.errors.mean_mm)} mm from {one.n_train}" for one in self.amounts)
        text = f"Amount of data: mean error {values} readings."
        if len(self.amounts) < 2:
            return text
        return f"{text} " + ("More readings will help." if self.is_falling else "More readings hardly help.")


def run_procedure(
    arm: Arm,
    readings: Session,
    test: Session | None,
    *,
    grid: SearchGrid,
    models: Sequence[str],
    fit: Fit,
    free: tuple[str, ...],
    folder: Path,
    progress: ProgressCallback | None = None,
) -> Procedure:
    """Search, train and test; trials that are in `folder` are read.

    Parameters
    ----------
    arm : Arm
    readings, test : Session
        All with points, in one frame; without a test the readings that the folds held out test the models.
    grid : SearchGrid
    models : sequence of str
        Models of the arm to compare with.
    fit : callable
    free : tuple of str
        What is unknown of the placement of the arm.
    folder : path
    progress : callable, optional

    Raises
    ------
    InputError
        If there are too few poses, or a network cannot learn from the readings.
    """
    run = CrossValidation(arm, readings, grid, fit, free, folder, progress)
    settings = grid.settings(len(readings), readings.n_joints)
    for setting in settings:
        setting.model(arm, seed=grid.seed).prepare(readings)  # refuses impossible settings before the first training
    times = [sum(one.estimated_seconds for one in run.trials(setting)) for setting in settings]
    # The last ones: the chosen network with fewer readings and with all, and the models.
    run.total = (
        sum(times) + 1.2 * max(times) + 0.005 * len(readings) * len(models) * (grid.folds if test is None else 1)
    )
    held_out = dict(run.result(setting) for setting in settings)
    chosen = min(held_out, key=lambda row: row.errors.mean_mm)
    amounts = grid.amount or tuple(chosen.n_train // k for k in (8, 4, 2))
    fewer = sorted({n for n in amounts if 2 * LEAST_TRIED <= n < chosen.n_train})
    learned = tuple(run.result(chosen.setting, amount)[0] for amount in fewer)
    network = run.final_network(chosen.setting)
    tested = readings if test is None else test
    predicted = {"network": held_out[chosen] if test is None else network.predict_readings(test)}
    refused: dict[str, str] = {}
    for name in models:
        points, results = run.predict(name, f"{name} model", test=test)
        if why := next((one.refused for one in results if one.refused), ""):
            refused[name] = why
        else:
            predicted[name] = points
    truth = np.asarray(tested.points)
    return Procedure(
        grid=grid,
        n_readings=len(readings),
        n_groups=run.n_groups,
        search=tuple(held_out),
        amounts=(*learned, chosen),
        chosen=chosen,
        network=network,
        fresh=test is not None,
        points=truth,
        predicted=predicted,
        errors={
            name: CoordinateErrors.of(predicted[name] - truth)
            for name in ("nominal", "network", *MODELS)
            if name in predicted
        },
        n_outside=int(network.outside_training(tested).sum()),
        best=_best(predicted, tested) if models else None,
        refused=refused,
    )


def _best(predicted: Mapping[str, FloatArray], tested: Session) -> str:
    """The simplest model whose mean distance exceeds the smallest by no more than a standard error, by position."""
    groups, points = cross_validation_groups(tested), np.asarray(tested.points)
    errors = {
        name: np.bincount(groups, np.linalg.norm(predicted[name] - points, axis=1)) / np.bincount(groups)
        for name in SIMPLEST_FIRST
        if name in predicted
    }
    least = min(errors, key=lambda name: float(errors[name].mean()))
    return next(name for name in errors if not exceeds(errors[name], errors[least]))
