"""`reproduce` with readings: the founding paper's procedure on a person's own arm."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.arm_check import WAYS_TO_AN_ARM, arm_of_readings
from truearm.models.compensator import FREE_PARTS
from truearm.pages.drawings.page_record import PageRecord, check_folder, input_files, write_numbers
from truearm.readings import Session
from truearm.verbs.fit import fit
from truearm.verbs.inputs import ArmLike, SessionLike, to_arm, to_session, within_limits
from truearm.verbs.outputs import check_output_is_not_input
from truearm.verbs.record import TableRecord, TextTable, columns_of, format_fixed, to_plain
from truearm.wings.gao2017.procedure import Procedure, Row, run_procedure
from truearm.wings.gao2017.results import MODELS
from truearm.wings.gao2017.search import SearchGrid

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
