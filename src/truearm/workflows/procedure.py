"""`reproduce` with readings: the founding paper's procedure on a person's own arm."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truearm.arm import Arm
from truearm.compensation.models import Compensator, NetworkModel
from truearm.compensation.models.arm_check import WAYS_TO_AN_ARM, arm_of_readings
from truearm.compensation.models.model_file import save_model
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.papers.gao2017.procedure import Procedure, run_procedure
from truearm.papers.gao2017.results import MODELS
from truearm.papers.gao2017.search import CoordinateErrors, SearchGrid, SettingResult
from truearm.papers.gao2017.trials import claim_folder
from truearm.readings import Session
from truearm.workflows.fit import fit
from truearm.workflows.inputs import ArmLike, SessionLike, to_arm, to_session, within_limits
from truearm.workflows.outputs import PageRecord, check_folder, check_output_is_not_input, input_files
from truearm.workflows.record import TextTable, format_fixed

if TYPE_CHECKING:
    from truearm.pages.page import Page

FILES = ("procedure.json", "procedure.html", "network.truearm")
PICTURES = {number: f"figure-{number}.png" for number in (6, 7, 8)}
NUMBERS = (
    "n_readings", "n_groups", "fresh", "best", "errors", "n_outside", "refused", "grid", "search", "chosen",
    "amounts", "points", "predicted",
)  # fmt: skip
NO_ARM = (
    "No arm is given: nominal, kinematic, hybrid and physical model are not compared. To compare them: "
    f"{WAYS_TO_AN_ARM.partition(';')[0]}."
)


@dataclass(frozen=True, eq=False, repr=False)
class ProcedureResult(PageRecord):
    """The paper's procedure on readings of one's own: the network chosen, and what models of the arm reach beside it.

    Attributes
    ----------
    results : Procedure
        All numbers.
    arm : Arm or None
    remarks : tuple of str
        What was skipped, and what is missing.
    files : tuple of Path
        The files that were read.
    """

    results: Procedure
    arm: Arm | None
    remarks: tuple[str, ...]
    files: tuple[Path, ...] = ()

    def summary(self) -> str:
        """The answer in one sentence: errors of the network and of the best model of the arm, and which to use."""
        return self.results.summary()

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the numbers (JSON), the page (HTML), the network (a model file) and Figures 6 to 8 (PNG).

        Returns
        -------
        tuple of Path
            The files written.

        Raises
        ------
        InputError
            If a file cannot be written.
        """
        from truearm.pages.html import write_page
        from truearm.pages.plotting import save_figure
        from truearm.papers.gao2017.procedure_page import paper_figures

        numbers, page, model = (Path(folder) / name for name in FILES)
        with atomic_file(numbers) as beside:
            text = json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"
            beside.write_text(text, encoding="utf-8", newline="\n")
        write_page(self.page(), page)
        save_model(self.results.network, model)
        figures = {Path(folder) / PICTURES[number]: figure for number, figure in paper_figures(self.results).items()}
        for file, figure in figures.items():
            save_figure(figure, file)
        return numbers, page, model, *figures

    def page(self) -> Page:
        """The answer, the errors of all models, the search, and the paper's figures of this arm."""
        from truearm.papers.gao2017.procedure_page import procedure_page

        return procedure_page(self.results, arm=None if self.arm is None else self.arm.name, remarks=self.remarks)

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        results = self.results
        yield self.summary()
        yield results.advice()
        yield from self.remarks
        heads = [f"coordinate error {results.test_phrase()}, mm", "mean", "rms", "95 %", "max", "2 sigma"]
        levels = [f"> {level:g}" for level in results.errors["network"].over_mm]
        yield TextTable([*heads, *levels], [_error_cells(name, one) for name, one in results.errors.items()])
        yield from (f"no {name} model: {why}" for name, why in results.refused.items())
        yield results.errors["network"].two_sigma_sentence()
        heads = [
            f"search, {results.grid.folds} folds",
            "trainer",
            "goal",
            "rate",
            "weights",
            "mean",
            "max",
            "epochs",
            "s",
            "",
        ]
        rows = [(*_setting_cells(row), "chosen" if row is results.chosen else "") for row in results.search]
        yield TextTable(heads, rows, (0, 1, 9))
        yield results.amounts_sentence()

    def _json(self) -> object:
        numbers = {name: getattr(self.results, name) for name in NUMBERS}
        return {"summary": self.summary(), **numbers, "remarks": self.remarks}


def follow_procedure(
    readings: SessionLike,
    test: SessionLike | None,
    arm: ArmLike | None,
    *,
    free: tuple[str, ...],
    quick: bool,
    folder: Path,
    progress: Callable[[float, str], None] | None,
    search: Mapping[str, Any],
) -> ProcedureResult:
    """Guard the readings, and follow the paper's procedure on them; see `reproduce`."""
    if unknown := sorted(search.keys() - SearchGrid.__dataclass_fields__.keys()):
        raise InputError(f"unknown options {unknown}", hint=", ".join(SearchGrid.__dataclass_fields__))
    grid = SearchGrid(**search).quick() if quick else SearchGrid(**search)
    files = input_files(readings, test, arm)
    check_folder(folder, [*FILES, *PICTURES.values()])
    for name in FILES:
        check_output_is_not_input(folder / name, *files)
    known = None if arm is None else to_arm(arm)
    given = to_session(readings, n_joints=None if known is None else known.n_joints)
    described = known or arm_of_readings(given)
    train, remarks = _usable(given, described, "training")
    if known is None:
        remarks += (NO_ARM,)
    else:
        fit(known, train, model="nominal", free=free)  # refuses readings of another arm, or in another unit
    # A network of one unit refuses what any network refuses, in no time.
    NetworkModel(described, hidden=(1,), epochs=1).fit_readings(train)
    fresh = None
    if test is not None:
        fresh, more = _usable(to_session(test, n_joints=described.n_joints), described, "test")
        _check_fresh(fresh, train)
        remarks += more

    def fitted(name: str, session: Session) -> Compensator:
        assert known is not None  # else there are no models to compare with
        return fit(known, session, model=name, free=free).model  # type: ignore[arg-type]

    runs = folder / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    claim_folder(runs, train)
    models = () if known is None else ("nominal", *MODELS)
    results = run_procedure(
        described, train, fresh, grid=grid, models=models, fit=fitted, free=free, folder=runs, progress=progress
    )
    return ProcedureResult(results, known, remarks, files)


def _usable(session: Session, arm: Arm, purpose: str) -> tuple[Session, tuple[str, ...]]:
    """Readings with a point, within the limits of their joints."""
    if not session.has_point.any():
        raise session.error(
            "the paper's network learns coordinates, and no reading has a point",
            hint="measure x, y, z with an instrument; readings in seats or with distances identify the arm itself: "
            "truearm fit SESSION --arm ARM",
        )
    checked = within_limits(session, arm)
    there = checked.session.has_point
    if there.all():
        return checked.session, checked.remarks
    remark = f"{int((~there).sum())} of {len(there)} {purpose} readings have no point and were skipped."
    return checked.session.rows(there), (*checked.remarks, remark)


def _check_fresh(test: Session, train: Session) -> None:
    """Refuse a test with readings that the network learns."""
    learned = {row.tobytes() for row in np.hstack([train.angles, np.asarray(train.points)])}
    rows = np.hstack([test.angles, np.asarray(test.points)])
    same = [i for i, row in enumerate(rows) if row.tobytes() in learned]
    if same:
        raise test.error(
            f"{len(same)} of {len(test)} test readings are training readings too, which is no test",
            same[0],
            hint="fresh readings; truearm split divides a session; without a test the cross-validation tests",
        )


def _error_cells(name: str, one: CoordinateErrors) -> list[str]:
    sizes = one.mean_mm, one.rms_mm, one.p95_mm, one.max_mm, one.two_sigma_mm
    return [name, *map(format_fixed, sizes), *map(str, one.over_mm.values())]


def _setting_cells(row: SettingResult) -> tuple[str, ...]:
    setting, errors = row.setting, row.errors
    rate = "" if setting.learning_rate is None else f"{setting.learning_rate:g}"
    sizes = format_fixed(errors.mean_mm), format_fixed(errors.max_mm), f"{row.epochs:.0f}", f"{row.seconds:.1f}"
    return str(setting), setting.trainer, f"{setting.goal:g}", rate, str(row.n_weights), *sizes
