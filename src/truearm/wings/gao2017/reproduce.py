"""`reproduce`: the tables and figures of a paper beside their reproduction, and its procedure on other readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.arm_check import WAYS_TO_AN_ARM, arm_of_readings
from truearm.models.compensator import FREE_PARTS
from truearm.pages.drawings.page_record import PageRecord, check_folder, input_files, write_numbers
from truearm.readings import Session
from truearm.solve.threads import one_blas_thread
from truearm.verbs.fit import fit
from truearm.verbs.inputs import ArmLike, SessionLike, to_arm, to_free_parts, to_session, within_limits
from truearm.verbs.outputs import check_output_is_not_input
from truearm.verbs.record import TableRecord, TextTable, columns_of, format_fixed, to_plain
from truearm.wings.gao2017.phrases import mark_cut
from truearm.wings.gao2017.procedure import Procedure, Row, run_procedure
from truearm.wings.gao2017.reproduction import reproduce as run_trainings
from truearm.wings.gao2017.results import MODELS, FinalTestResult, Reproduction, RowResult
from truearm.wings.gao2017.search import SearchGrid
from truearm.wings.gao2017.training_plan import PARTS

if TYPE_CHECKING:
    from truearm.pages.page import Page


FILES = ("procedure.json", "procedure.html", "network.truearm")
PICTURES = {number: f"figure-{number}.png" for number in (6, 7, 8)}
NO_ARM = (
    "No arm is given: no nominal, kinematic, hybrid or physical model stands beside the network, and these need far "
    f"fewer readings. --arm takes {WAYS_TO_AN_ARM.partition(';')[0]}."
)


@dataclass(frozen=True, eq=False, repr=False)
class ProcedureResult(TableRecord, PageRecord):
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

    Examples
    --------
    >>> import tempfile
    >>> import truearm as ta
    >>> session = ta.simulate("gao2017", poses=40, seed=1).session
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found = ta.reproduce(readings=session, hidden=((3,),), epochs=3, folds=2, folder=folder)
    >>> found.results.chosen.setting.hidden
    (3,)
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
        from truearm.wings.gao2017.procedure import paper_figures

        numbers, page, model = (Path(folder) / name for name in FILES)
        write_numbers(self, numbers)
        write_page(self.page(), page)
        self.results.network.save(model)
        figures = {Path(folder) / PICTURES[number]: figure for number, figure in paper_figures(self.results).items()}
        for file, figure in figures.items():
            figure.save(file)
        return numbers, page, model, *figures

    def page(self) -> Page:
        """The answer, the errors of all models, the search, and the paper's figures of this arm."""
        from truearm.wings.gao2017.procedure import procedure_page

        return procedure_page(self.results, arm=None if self.arm is None else self.arm.name, remarks=self._remarks())

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        yield self.summary()
        yield from self._remarks()
        yield f"Absolute error of a coordinate {self.results.test_phrase()}; how many exceed a length:"
        yield _text_table(*self.results.error_table())
        yield self.results.errors["network"].two_sigma_sentence()
        yield f"Search with {self.results.grid.folds} folds, then the chosen network with fewer readings:"
        yield _text_table(*self.results.search_table())
        yield self.results.amounts_sentence()

    def _remarks(self) -> tuple[str, ...]:
        return (*self.results.remarks(), *self.remarks)

    def columns(self) -> dict[str, list[Any]]:
        """A row for each model: absolute errors of a coordinate on the test readings."""
        return columns_of(
            {"model": name, **to_plain(one), "two_sigma_mm": one.two_sigma_mm}
            for name, one in self.results.errors.items()
        )

    def _json(self) -> object:
        numbers = {name: value for name, value in vars(self.results).items() if name != "network"}
        sigma, amounts = self.results.errors["network"].two_sigma_sentence(), self.results.amounts_sentence()
        said = {"summary": self.summary(), "two_sigma": sigma, "amount_of_data": amounts, "remarks": self._remarks()}
        return said | {"arm": None if self.arm is None else self.arm.name} | numbers


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
    if known is None and set(free) != set(FREE_PARTS):
        raise InputError("free is what is unknown of the placement of an arm, and no arm is given", hint="--arm ARM")
    given = to_session(readings, n_joints=None if known is None else known.n_joints)
    described = known or arm_of_readings(given)
    train, remarks = _usable(given, described, "training")
    if known is None:
        remarks += (NO_ARM,)
    else:
        fit(known, train, model="nominal", free=free)  # refuses readings of another arm, or in another unit
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
        return checked.session, tuple(map(str, checked.findings))
    remark = f"{int((~there).sum())} of {len(there)} {purpose} readings have no point and were skipped."
    return checked.session.rows(there), (*map(str, checked.findings), remark)


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


def _text_table(heads: list[str], rows: list[Row]) -> TextTable:
    cells = [[format_fixed(cell) if isinstance(cell, float) else str(cell) for cell in row] for row in rows]
    return TextTable(
        heads, cells, tuple(i for i, head in enumerate(heads) if head in ("model", "network", "trainer", ""))
    )


FOLDER = "truearm-gao2017"
TABLE_HEADS = {2: "Table 2, simulation 1", 3: "Table 3, simulation 2", 4: "Table 4, experiment on virtual arms"}


@dataclass(frozen=True, eq=False, repr=False)
class ReproductionResult(TableRecord, PageRecord):
    """The tables and figures of a paper beside their reproduction.

    Attributes
    ----------
    results : Reproduction
        All numbers.
    parts : tuple of str
        What was reproduced, such as ``table 2``.
    """

    results: Reproduction
    parts: tuple[str, ...]

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the numbers (JSON) and the page (HTML); of a single figure also its picture (PNG).

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
        from truearm.wings.gao2017.reproduction_page import paper_figure

        files = result_files(self.parts, folder)
        page = self.page()
        if files[2:]:
            picture = paper_figure(page, int(self.parts[0].split()[1]))
            assert picture is not None  # the figure was asked for
            picture.save(files[2])
        write_numbers(self, files[0])
        write_page(page, files[1])
        return files

    def page(self) -> Page:
        """Tables and figures of the paper beside the reproduction, and experiments on its claims."""
        from truearm.wings.gao2017.reproduction_page import reproduction_page

        return reproduction_page(self.results)

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        from truearm.wings.gao2017.table_sections import describe_skipped_rows

        results = self.results
        verdicts = [verdict for row in results.rows() for verdict in row.verdicts.values()]
        counts = {verdict: verdicts.count(verdict) for verdict in dict.fromkeys(verdicts)}
        if verdicts:
            yield f"{len(verdicts)} trainings: " + ", ".join(f"{n} {verdict}" for verdict, n in counts.items())
            if skipped := describe_skipped_rows(results.tables):
                yield skipped
            n_cut = sum(one.n_cut for row in results.rows() for name in row.verdicts if (one := row.results[name]))
            if n_cut:
                yield f"The time limit ended {n_cut} starts before a stop of their own; their rows are marked (cut)."
            yield "trainlm fits 70 % of the poses (15 % for validation, 15 % for test), varpro fits all of them."
        else:
            yield f"gao2017: {', '.join(self.parts)}"
        for number, head in TABLE_HEADS.items():
            if (rows := results.tables[number]) is not None:
                yield f"{head}: absolute error of a coordinate [mm], median over starts [least, largest]"
                heads = ["row", "network", "by", "mean", "", "epochs", "s", "ratio", "verdict"]
                yield TextTable(heads, [line for row in rows for line in _lines(row)], (0, 1, 2, 4, 8))
                yield ""
        if results.final_test is not None:
            n = results.final_test.poses
            yield f"Final test: {n} further poses of each arm, absolute error of a coordinate [mm]"
            yield _final_table(results.final_test)
            yield ""
        for part in results.skipped:
            yield f"skipped: {part}"

    def columns(self) -> dict[str, list[Any]]:
        """A row for each row of the paper's tables and each trainer that ran: median over the starts."""
        return columns_of(
            {
                "table": number,
                "row": row.paper.row,
                "network": "-".join(map(str, row.paper.hidden)),
                "trainer": one.trainer,
                "mean_mm": one.median["mean_many_mm"],
                "max_mm": one.median["max_many_mm"],
                "paper_mean_mm": row.paper.mean_mm,
                "ratio": row.ratio[method],
                "epochs": one.median["epochs"],
                "time_s": one.median["seconds"],
                "n_starts": len(one.runs),
                "verdict": row.verdict[method],
            }
            for number, rows in self.results.tables.items()
            for row in rows or ()
            for method, one in row.results.items()
            if one is not None
        )

    def _json(self) -> object:
        return self.results


@one_blas_thread()
def reproduce(
    paper: Literal["gao2017"] = "gao2017",
    *,
    readings: SessionLike | None = None,
    test: SessionLike | None = None,
    arm: ArmLike | None = None,
    free: Iterable[str] = ("base", "tip"),
    table: int | None = None,
    figure: int | None = None,
    quick: bool = False,
    time_limit: float | None = None,
    folder: str | Path = FOLDER,
    progress: Callable[[float, str], None] | None = None,
    **search: Any,
) -> ReproductionResult | ProcedureResult:
    """Reproduce the tables and figures of a paper, or follow its procedure on readings of one's own.

    Every row of the paper's tables is trained by MATLAB's rules (``trainlm``) and by truearm's own trainer
    (``varpro``). Finished trainings stay in the folder: after an interruption the same call resumes with the next one.

    With `readings` the network is chosen by cross-validation on them, as the paper chooses its own, trained on all of
    them, and tested on fresh ones beside models of the arm.

    Parameters
    ----------
    paper : {"gao2017"}
        Gao et al., Complexity 2017, article 5156264.
    readings : Session, DataFrame, str or Path, optional
        Readings with a reference point each, in one frame, to choose and train a network.
    test : Session, DataFrame, str or Path, optional
        Fresh readings to test it; without them those that the cross-validation held out.
    arm : Arm, str or Path, optional
        The nominal arm, for the models to compare with.
    free : iterable of {"base", "tip"}
        What is unknown of its placement.
    table : int, optional
        One of tables 2 to 4 alone; by default everything, which takes an hour and a quarter.
    figure : int, optional
        One of figures 1 to 8 (without 5) alone, also as figure-N.png.
    quick : bool
        One start a row and no long trainings: minutes.
    time_limit : float, optional
        CPU time of one training [s], 400 by default. A training that it ends is marked wherever its numbers appear;
        with a larger limit it runs again. ``inf``: every training runs to its own stop, which takes many hours.
    folder : path
        Folder for the trainings; created if it does not exist.
    progress : callable, optional
        Called with the share of the estimated time that is over, and the training that runs.
    **search
        With `readings`, what to try, a sequence each: ``hidden``, ``trainer``, ``goal``; and the numbers ``epochs``,
        ``folds`` and ``seed``.

    Returns
    -------
    ReproductionResult or ProcedureResult

    Raises
    ------
    InputError
        If there is no such part, the time limit is not above 0, or the folder cannot be written, has a damaged file;
        if readings have no points, are of several frames, or contradict the arm.

    Examples
    --------
    >>> import tempfile
    >>> import truearm as ta
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     print(ta.reproduce("gao2017", figure=3, folder=folder))
    gao2017: figure 3
    """
    from truearm.wings.gao2017 import training_plan

    if readings is not None:
        if (table, figure, time_limit) != (None, None, None):
            raise InputError("table, figure and time_limit are of the paper's own arm", hint="omit them, or readings")
        parts = to_free_parts(free)
        return follow_procedure(
            readings, test, arm, free=parts, quick=quick, folder=Path(folder), progress=progress, search=search
        )
    if test is not None or arm is not None or search:
        raise InputError("test, arm and options of the search need readings", hint="readings, --session FILE")
    if time_limit is not None and not time_limit > 0:
        raise InputError(f"expected a time limit above 0 s, got {time_limit}", hint="inf: no limit")
    if paper != "gao2017":
        raise InputError(f"there is no paper {paper!r}", hint="gao2017")
    parts = parts_of(table=table, figure=figure)
    runs = Path(folder) / "runs"
    check_folder(folder, [file.name for file in result_files(parts, folder)])
    runs.mkdir(parents=True, exist_ok=True)
    effort = training_plan.QUICK_EFFORT if quick else training_plan.FULL_EFFORT
    if time_limit is not None:
        effort = replace(effort, time_limit_s=None if time_limit == math.inf else time_limit)
    return ReproductionResult(run_trainings(parts, effort=effort, folder=runs, progress=progress), parts)


def parts_of(*, table: int | None, figure: int | None) -> tuple[str, ...]:
    """The parts of the reproduction that are asked for.

    Raises
    ------
    InputError
        If both a table and a figure are asked for, or there is no such part.
    """
    if table is not None and figure is not None:
        raise InputError("expected a table or a figure, got both")
    if table is None and figure is None:
        return tuple(PARTS)
    part = f"table {table}" if figure is None else f"figure {figure}"
    if part not in PARTS:
        kind, number = part.split()
        numbers = ", ".join(name.split()[1] for name in PARTS if name.startswith(kind))
        raise InputError(f"expected a {kind} among {numbers}, got {number}")
    return (part,)


def result_files(parts: tuple[str, ...], folder: str | Path) -> tuple[Path, ...]:
    """The files that `ReproductionResult.save` writes; a part has names of its own and does not replace the whole."""
    stem = parts[0].replace(" ", "-") if len(parts) == 1 else "reproduction"
    kinds = (".json", ".html", *([".png"] if stem.startswith("figure") else []))
    return tuple(Path(folder) / f"{stem}{kind}" for kind in kinds)


def _lines(row: RowResult) -> Iterator[list[str]]:
    """A row of a table of the paper, and a row for each trainer."""
    paper = row.paper
    network = "-".join(map(str, paper.hidden))
    effort = [f"{paper.epochs:.0f}", f"{paper.seconds:.1f}"]
    yield [str(paper.row), network, "paper", f"{paper.mean_mm:.4g}", "", *effort, "", ""]
    for method, one in row.results.items():
        verdict = row.verdict[method] or ""
        if one is None:
            yield ["", "", method, "", "", "", "", "", verdict]
            continue
        if not verdict and row.same_training_as:
            verdict = f"as row {row.same_training_as}"
        low, high = one.range_mm
        spread = f"[{low:.3g}, {high:.3g}]" if len(one.runs) > 1 else ""
        mean, ratio = one.median["mean_many_mm"], row.ratio[method]
        effort = [f"{one.median['epochs']:.0f}", f"{one.median['seconds']:.1f}"]
        verdict = mark_cut(verdict, one.n_cut)
        yield ["", "", one.trainer, f"{mean:.4g}", spread, *effort, "" if ratio is None else f"{ratio:.2f}", verdict]


def _final_table(test: FinalTestResult) -> TextTable:
    arms = {"paper": test.paper, **{f"seed {run.seed}": run.errors for run in test.runs}}
    rows = []
    for arm, models in arms.items():
        for i, (model, errors) in enumerate(models.items()):
            counts = [*map(str, errors.over_mm.values()), f"{errors.removed_percent:.1f}"]
            compensated = [""] * 3 if model == "nominal" else counts
            mean, largest = f"{errors.mean_mm:.4f}", f"{errors.max_mm:.4f}"
            rows.append(["" if i else arm, mark_cut(model, errors.was_cut), mean, largest, *compensated])
    return TextTable(["arm", "model", "mean", "max", "> 0.05", "> 0.08", "removed %"], rows, (0, 1))
