"""The paper's procedure on readings of a person's own: choose a network by trying, train it, test it on fresh poses.

Its page has the answer, the paper's Table 4 and Figures 6 to 8.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from truearm import __version__
from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.judgement.held_out_errors import selected
from truearm.identification.references.cross_validation_groups import cross_validation_groups
from truearm.models import Compensator, NetworkModel
from truearm.number_format import format_count, format_number
from truearm.pages.drawings.error_figures import coordinates_by_reading, errors_by_reading
from truearm.pages.page import Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.plotting import Figure
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.gao2017.claim_figures import share_figure
from truearm.wings.gao2017.results import MODELS
from truearm.wings.gao2017.search import CoordinateErrors, CrossValidation, SearchGrid, SettingResult
from truearm.wings.gao2017.table_figure import STYLES, network_layers
from truearm.wings.gao2017.training import ProgressCallback


def procedure_page(results: Procedure, *, arm: str | None, remarks: tuple[str, ...]) -> Page:
    """Make the page.

    Parameters
    ----------
    results : Procedure
    arm : str or None
        Its name.
    remarks : tuple of str
        What to know before using the result.
    """
    own, best = results.errors["network"], results.best
    shown = {"network": own} if best is None else {"network": own, best: results.errors[best]}
    state: State = "none" if best is None else "good" if best == "network" else "doubtful"
    return Page(
        title="The procedure of Gao et al. 2017 on these readings",
        subtitle=f"{arm or 'An arm without a description'}, {format_count(results.n_readings, 'reading')}: a network "
        "is chosen by cross-validation, trained on all of them and tested, where the arm is known beside its models.",
        summary=(
            *(LabelledValue(f"mean error of a coordinate, {name}", one.mean_mm, "mm") for name, one in shown.items()),
            LabelledValue("2 sigma, network", own.two_sigma_mm, "mm"),
        ),
        sections=(_comparison(results, remarks), _search(results), _network(results)),
        facts=(
            ("arm", arm or "no description"),
            ("readings", f"{results.n_readings}, fingerprint {results.network.data_fingerprint_}"),
            ("trained range", _ranges(results)),
            ("seed", str(results.grid.seed)),
            ("versions", f"truearm {__version__}, NumPy {np.__version__}"),
        ),
        verdict=PageVerdict(results.summary(), state, remarks[0]),
    )


def paper_figures(results: Procedure) -> dict[int, Figure]:
    """Figures 6 (nominal errors, of an arm that is known), 7 (predicted coordinates) and 8 (their errors)."""
    figures = {7: coordinates_by_reading(results.points, {"network": results.predicted["network"]}, styles=STYLES)}
    for number, name in ((6, "nominal"), (8, "network")):
        if name in results.predicted:
            figures[number] = errors_by_reading({name: results.predicted[name] - results.points}, styles=STYLES)
    return {
        number: replace(figure, caption=f"Figure {number} of the paper, of this arm. {figure.caption}")
        for number, figure in sorted(figures.items())
    }


def _comparison(results: Procedure, remarks: tuple[str, ...]) -> Section:
    """The errors of all models, and the paper's figures."""
    own, means = results.errors["network"], {name: one.mean_mm for name, one in results.errors.items()}
    shares = (share_figure(means, before="nominal"),) if "nominal" in means and min(means.values()) > 0 else ()
    heads, rows = results.error_table()
    table = Table(
        Column.of(*heads),
        tuple(rows),
        f"Absolute error of a coordinate {results.test_phrase()}, {3 * own.n} coordinates; how many exceed a length. "
        "2 sigma is twice the root mean square error",
    )
    text = "\n\n".join((own.two_sigma_sentence(), *remarks[1:]))
    figures = (*shares, *paper_figures(results).values())
    return Section("Error before and after (Figures 6 to 8)", text, tables=(table,), figures=figures)


def _search(results: Procedure) -> Section:
    grid, folds = results.grid, results.chosen.fold_mean_mm
    text = (
        f"Each network is trained {grid.folds} times without one of {grid.folds} folds, from another random start, and "
        "tested on this fold. Kept is the smallest mean error, as in the paper. Folds and starts alone make the chosen "
        f"one err by {min(folds):.3g} to {max(folds):.3g} mm. Readings of one position or pose are in one fold; there "
        f"are {results.n_groups} of them. Without a goal (0) 15 % of the readings end a training when their error "
        "grows. There is no learning rate: the Levenberg-Marquardt method has none; what the paper varies by it is the "
        f"random start.{'' if grid.hidden else ' Larger networks than coordinates to fit are not tried.'}"
        f"\n\n{results.amounts_sentence()}"
    )
    heads, rows = results.search_table()
    table = Table(Column.of(*heads), tuple(rows), "Table 4 of this arm; last the chosen network with fewer readings")
    return Section("The search (Tables 2 and 4)", text, tables=(table,))


def _network(results: Procedure) -> Section:
    network, record = results.network, results.network.record_
    text = (
        f"Trained on all {format_count(results.n_readings, 'reading')}: {format_count(record.num_epochs, 'epoch')}, "
        f"stop: {record.stop.rstrip('.')}. It is in network.truearm, which truearm predict and evaluate take."
    )
    sizes = (network.arm_.n_joints, *network.hidden, 3)
    return Section("The network (Figure 3)", text, figures=(network_layers(sizes),), folded=True)


def _ranges(results: Procedure) -> str:
    network = results.network
    joints = zip(network.angle_ranges_, network.arm_.chain.is_prismatic, strict=True)
    return "; ".join(
        f"J{i}: {low:.2f} to {high:.2f} mm" if slides else f"J{i}: {np.degrees(low):.2f} to {np.degrees(high):.2f} deg"
        for i, ((low, high), slides) in enumerate(joints, start=1)
    )


SIMPLEST_FIRST = ("nominal", "kinematic", "physical", "hybrid", "network")
LEAST_READINGS = 6  # of a training with fewer readings
Row = tuple[str | float | None, ...]
"""Cells of a table."""
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

    def remarks(self) -> tuple[str, ...]:
        """What to know before using the result."""
        found = ["A network is valid only within the joint ranges of its readings."]
        if self.n_outside:
            found.append(f"{self.n_outside} of {len(self.points)} test readings lie outside them.")
        if self.best not in (None, "network"):
            found.append(f"This writes the {self.best} model: truearm fit SESSION --arm ARM --model {self.best}.")
        if not self.fresh:
            found.append(
                "There are no fresh readings (--test-session): every reading is predicted by models that were fitted "
                "without its fold. That the same readings chose the network makes its error too small."
            )
        return (*found, *(f"There is no {name} model: {why}." for name, why in self.refused.items()))

    def error_table(self) -> tuple[list[str], list[Row]]:
        """Heads and rows: absolute errors of a coordinate of every model [mm]."""
        levels = [f"> {level:g} mm" for level in self.errors["network"].over_mm]
        return ["model", "mean [mm]", "95 % [mm]", "max [mm]", "2 sigma [mm]", *levels], [
            (name, one.mean_mm, one.p95_mm, one.max_mm, one.two_sigma_mm, *one.over_mm.values())
            for name, one in self.errors.items()
        ]

    def search_table(self) -> tuple[list[str], list[Row]]:
        """Heads and rows: the networks of the search, then the chosen one with fewer readings."""
        heads = ["network", "trainer", "goal", "weights", "readings", "mean [mm]", "max [mm]", "epochs", "time [s]", ""]
        return heads, [
            (
                str(one.setting),
                one.setting.training,
                f"{one.setting.goal:g}",
                one.n_weights,
                one.n_train,
                one.errors.mean_mm,
                one.errors.max_mm,
                round(one.epochs),
                f"{one.seconds:.1f}",
                "chosen" if one is self.chosen else "",
            )
            for one in (*self.search, *self.amounts[:-1])
        ]

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


def _with_fewer_readings(run: CrossValidation, chosen: SettingResult) -> list[SettingResult]:
    """The chosen network, trained with an eighth, a quarter and half of the readings."""
    rows = []
    for amount in (n for k in (8, 4, 2) if (n := chosen.n_train // k) >= LEAST_READINGS):
        try:
            rows.append(run.result(chosen.setting, amount)[0])
        except InputError:  # of one position, for example
            continue
    return rows


def _searched(run: CrossValidation, arm: Arm) -> dict[SettingResult, FloatArray]:
    """The settings of the grid, each with its predictions of held-out readings."""
    readings, grid = run.readings, run.grid
    settings = grid.settings(len(readings), readings.n_joints)
    for setting in settings:
        setting.model(arm, seed=grid.seed).prepare(readings)  # refuses impossible settings before the first training
    times = [grid.folds * run.seconds(setting, len(readings)) for setting in settings]
    run.total = sum(times) + max(times)  # last the chosen network, with fewer readings and with all
    return dict(run.result(setting) for setting in settings)


def _predictions(
    run: CrossValidation,
    models: Iterable[str],
    fit: Callable[[str, Session], Compensator],
    test: Session | None,
    of_network: FloatArray,
) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """Predictions of network and models, of held-out readings where there are no others; why some have none."""
    predicted = {"network": of_network}
    refused: dict[str, str] = {}
    for name in models:
        run.tell(0.0, f"{name} model")
        try:
            if test is None:
                predicted[name] = run.held_out(lambda _, train, name=name: fit(name, train))  # type: ignore[misc]
            else:
                predicted[name] = fit(name, run.readings).predict_readings(test)
        except InputError as error:
            refused[name] = error.problem
    return predicted, refused


def run_procedure(
    arm: Arm,
    readings: Session,
    test: Session | None,
    *,
    grid: SearchGrid,
    models: Iterable[str],
    fit: Callable[[str, Session], Compensator],
    free: tuple[str, ...],
    folder: Path,
    progress: ProgressCallback | None = None,
) -> Procedure:
    """Search, train and test; trainings whose files are in `folder` are read.

    Parameters
    ----------
    arm : Arm
    readings, test : Session
        All with points, in one frame; without a test the readings that the folds held out test the models.
    grid : SearchGrid
    models : iterable of str
        Models of the arm to compare with.
    fit : callable
        Fits one of these to readings.
    free : tuple of str
        What is unknown of the placement of the arm.
    folder : path
    progress : callable, optional

    Raises
    ------
    InputError
        If there are too few poses, or a network cannot learn from the readings.
    """
    run = CrossValidation(readings, grid, folder, progress)
    held_out = _searched(run, arm)
    chosen = min(held_out, key=lambda row: row.errors.mean_mm)
    amounts = _with_fewer_readings(run, chosen)
    untrained = chosen.setting.model(arm, seed=grid.seed, free=free)
    network = run.network(untrained, chosen.setting, readings, f"{chosen.setting}, all")
    tested, of_network = (readings, held_out[chosen]) if test is None else (test, network.predict_readings(test))
    predicted, refused = _predictions(run, models, fit, test, of_network)
    truth, shown = np.asarray(tested.points), [name for name in ("nominal", "network", *MODELS) if name in predicted]
    return Procedure(
        grid=grid,
        n_readings=len(readings),
        n_groups=run.n_groups,
        search=tuple(held_out),
        amounts=(*amounts, chosen),
        chosen=chosen,
        network=network,
        fresh=test is not None,
        points=truth,
        predicted=predicted,
        errors={name: CoordinateErrors.of(predicted[name] - truth) for name in shown},
        n_outside=int(network.outside_training(tested).sum()),
        best=_best(predicted, tested) if len(predicted) > 1 else None,
        refused=refused,
    )


def _best(predicted: Mapping[str, FloatArray], tested: Session) -> str:
    """The model to keep by mean distances by position."""
    groups, points = cross_validation_groups(tested), np.asarray(tested.points)
    errors = {
        name: np.bincount(groups, np.linalg.norm(predicted[name] - points, axis=1)) / np.bincount(groups)
        for name in SIMPLEST_FIRST
        if name in predicted
    }
    return selected(errors, int(groups.max()) + 1)[0]
