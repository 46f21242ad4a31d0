"""A fleet: a folder with a registry of arms, their models, and the results of all fits."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, get_args
from urllib.parse import quote

from truearm.arm import load_arm
from truearm.arm.catalogue import arm_path
from truearm.choices import ModelName
from truearm.compensation.models import Compensator
from truearm.compensation.models.model_file import load_model
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import MAX_NAME
from truearm.files.file_reading import parse_file, utf8_text
from truearm.files.toml_documents import reject_control_characters, toml_text
from truearm.fleet.arm_list import RegisteredArm
from truearm.fleet.fit_task import FitRow, FitTask, fit_arm, key_of
from truearm.fleet.results import write_results
from truearm.pages.html import write_page
from truearm.show.fleet_page import ArmState, What, arm_history_page, fleet_page
from truearm.solve.executor import Executor, Serial, WorkerLost
from truearm.workflows.outputs import PageRecord, check_page_path, make_folder, version_row
from truearm.workflows.record import Record, TextTable, format_fixed
from truearm.workflows.sentences import agree, number_of

if TYPE_CHECKING:
    from truearm.pages.page import Page

SETTINGS = "fleet.toml"
DEFAULT_DATABASE = "sqlite:///registry.sqlite"
MAX_BYTES = 100_000
# Arms that are printed.
MAX_ROWS = 20
MAX_DAYS = 36_500


class Fleet:
    """Arms of which truearm keeps the readings, the models and their history.

    Parameters
    ----------
    folder : path
        Made by `create`.

    Raises
    ------
    InputError
        If the folder is not that of a fleet, or the database is another one.
    TruearmError
        If the database does not answer.

    Examples
    --------
    >>> import tempfile
    >>> import truearm as ta
    >>> folder = tempfile.TemporaryDirectory()
    >>> fleet = ta.Fleet.create(folder.name)
    >>> ta.simulate("ur10", poses=20, seed=1).save(f"{folder.name}/a.csv")
    >>> fleet.add("virtual-research-0", "ur10", session=f"{folder.name}/a.csv", model="nominal")
    1
    >>> fleet.run().n_fitted
    1
    >>> fleet.model("virtual-research-0").kind
    'nominal'
    >>> fleet.close()
    >>> folder.cleanup()
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder).absolute()
        settings = self.folder / SETTINGS
        if not settings.is_file():
            raise InputError(
                "expected the folder of a fleet", file=self.folder, hint=f"truearm fleet init {folder} makes one"
            )
        from truearm.fleet.registry import Registry  # SQLAlchemy is an extra

        self.registry = Registry(parse_file(settings, _database, limit_bytes=MAX_BYTES), beside=self.folder)

    @classmethod
    def create(cls, folder: str | Path, *, database: str = DEFAULT_DATABASE) -> Fleet:
        """Make the folder of a fleet and the tables of its registry.

        Parameters
        ----------
        folder : path
            New, or without a fleet.
        database : str
            URL as SQLAlchemy writes it, without a password; a file of SQLite is in the folder. PostgreSQL takes
            passwords from ``~/.pgpass`` or ``PGPASSWORD``.

        Raises
        ------
        InputError
            If the folder is one of a fleet already, or the URL is none.
        TruearmError
            If the database does not answer.
        """
        from truearm.fleet.registry import Registry

        path = Path(folder).absolute()
        if (path / SETTINGS).exists():
            raise InputError("this is the folder of a fleet already", file=path)
        make_folder(path)
        Registry(database, beside=path, create=True).close()
        with atomic_file(path / SETTINGS) as beside:
            beside.write_text(f"[fleet]\ndatabase = {toml_text(database)}\n", encoding="utf-8")
        return cls(path)

    def close(self) -> None:
        """Close the connections to the database."""
        self.registry.close()

    def add(
        self,
        serial_number: str,
        arm: str,
        *,
        session: str | Path | None = None,
        site: str = "",
        model: ModelName | None = None,
        every_days: int | None = None,
    ) -> int:
        """Add an arm, or new readings of an arm that is there: the last ones added are those that are fitted.

        Site, model and days that are given replace those before.

        Parameters
        ----------
        serial_number : str
        arm : str
            The nominal arm: a name of `list_arms`, or an arm file or URDF.
        session : path, optional
            File of its readings. It stays where it is.
        site : str
            Where the arm is.
        model : str, optional
            Kind of model, as `fit` takes it; by default ``auto``.
        every_days : int, optional
            Days after which readings are due again.

        Returns
        -------
        int
            1 if anything is new, otherwise 0.

        Raises
        ------
        InputError
            If the number is registered for an arm of another type.
        """
        return self.add_all(
            [RegisteredArm(serial_number, arm, site, model, every_days, "" if session is None else str(session))]
        )

    def add_all(self, arms: Iterable[RegisteredArm], *, beside: Path | None = None) -> int:
        """Add many arms, all or none: see `add`.

        Parameters
        ----------
        arms : iterable of RegisteredArm
        beside : Path, optional
            Folder to which relative names of files refer; by default the current one.
        """
        return self.registry.add([_checked(one, beside or Path.cwd()) for one in arms])

    def model_file(self, key: str) -> Path:
        """The model file of a fit."""
        return self.folder / "models" / key[:2] / f"{key}.truearm"

    def model(self, serial_number: str) -> Compensator:
        """The model in force of an arm.

        Raises
        ------
        InputError
            If there is none.
        """
        key = self.registry.models_in_force().get(serial_number)
        if key is None:
            raise InputError(
                f"no model of an arm {serial_number!r} is in force", hint="truearm fleet status lists them"
            )
        file = self.model_file(key)
        if not file.is_file():
            raise InputError("the model file does not exist", file=file, hint="truearm fleet run fits it again")
        return load_model(file)

    def run(self, executor: Executor | None = None, *, progress: Callable[[int, str], None] | None = None) -> FleetRun:
        """Fit every arm whose readings, drawing or kind of model changed since its last fit.

        A failed fit, or one that is worse than the nominal arm, replaces no model in force. An interrupted run goes on
        where it was: what is fitted is not fitted again.

        Parameters
        ----------
        executor : Executor, optional
            Who computes; by default this process.
        progress : callable, optional
            Called with the number of arms done and a note.

        Returns
        -------
        FleetRun
        """
        tasks, unchanged = self._tasks()
        rows: list[FitRow] = []
        try:
            for i, found in (executor or Serial()).results(fit_arm, tasks):
                row = FitRow.without_result(tasks[i], "lost", found.reason) if isinstance(found, WorkerLost) else found
                self.registry.record(row, in_force=row.is_usable)
                rows.append(row)
                if progress is not None:
                    progress(len(rows), f"{len(rows)} of {len(tasks)}: {row.serial_number}: {row.outcome}")
        finally:
            self._write_results()
        return FleetRun(tuple(sorted(rows, key=lambda row: row.serial_number)), tuple(unchanged))

    def _write_results(self) -> None:
        """Write all results; again if another run had one meanwhile, so that the last one to write has them all."""
        written: set[str] = set()
        while True:
            found = {key: row for key, row in self.registry.fits().items() if row.state != "lost"}
            if found.keys() == written:
                break
            write_results(found.values(), self.folder / "results")
            written = set(found)

    def _tasks(self) -> tuple[list[FitTask], list[FitRow]]:
        """What is to be fitted, and the results of arms for which nothing changed."""
        in_force, fits = self.registry.models_in_force(), self.registry.fits()
        tasks, unchanged = [], []
        for arm in self.registry.arms():
            if not arm.session:
                continue
            task = self._task(arm, in_force)
            known = _fit_of(task, fits)
            if known is None or known.state == "lost":
                tasks.append(task)
                continue
            unchanged.append(known)
            if known.is_usable and in_force.get(arm.serial_number) != task.key:  # earlier readings were added again
                self.registry.put_in_force(arm.serial_number, task.key)
        return tasks, unchanged

    @property
    def n_arms(self) -> int:
        """How many arms are registered."""
        return len(self.registry.arms())

    def write_pages(self, out: str | Path, *, progress: Callable[[int, str], None] | None = None) -> int:
        """Write the overview of all arms, and beside it a page of each arm with its history.

        Parameters
        ----------
        out : path
            The overview, ``.html``; pages of the arms are in the folder of the same name with ``-arms``.
        progress : callable, optional
            Called with the number of pages written and a note.

        Returns
        -------
        int
            How many arms have a page.

        Raises
        ------
        InputError
            If a page cannot be written.
        """
        out = Path(out)
        check_page_path(out, *self.folder.glob("*.*"))
        beside = out.with_name(f"{out.stem}-arms")
        make_folder(beside)
        status, fits, histories, states = self.status(), self.registry.fits(), self.registry.histories(), []
        failed: dict[str, list[FitRow]] = {}
        for row in fits.values():
            if row.state != "fitted":
                failed.setdefault(row.serial_number, []).append(row)
        for i, one in enumerate(status.arms, 1):
            name = f"{sha256(one.serial_number.encode()).hexdigest()[:16]}.html"
            models = [(since, fits[key]) for since, key in histories.get(one.serial_number, ()) if key in fits]
            write_page(self._history(one, models, failed.get(one.serial_number, [])), beside / name)
            states.append(replace(one, page=quote(f"{beside.name}/{name}")))
            if progress is not None:
                progress(i, one.serial_number)
        write_page(FleetStatus(self.registry.place, tuple(states)).page(), out)
        return len(states)

    def _history(self, arm: ArmState, models: Sequence[tuple[str, FitRow]], failed: Sequence[FitRow]) -> Page:
        constants = models[-1][1].constants if models else ()
        return arm_history_page(
            arm,
            models=[
                (since[:10], one.model, one.n_readings, one.held_out_mm, one.moved_mm, one.n_changed, one.session)
                for since, one in reversed(models)
            ],
            constants=[(one["name"], one["unit"], one["nominal"], one["value"], one["u"]) for one in constants],
            failed=[(one.fitted_at[:10], one.session, one.message) for one in failed],
            facts=(("database", self.registry.place), version_row()),
        )

    def status(self, *, today: datetime | None = None) -> FleetStatus:
        """The state of every arm, worst first: failed, due, worse than others of its type.

        Parameters
        ----------
        today : datetime, optional
            For what is due; by default now.
        """
        now = (today or datetime.now(UTC)).astimezone(UTC)
        in_force, fits = self.registry.models_in_force(), self.registry.fits()
        of_type: dict[str, list[float]] = {}
        for key in in_force.values():
            if error := fits[key].held_out_mm:
                of_type.setdefault(fits[key].arm, []).append(error)
        medians = {name: median(errors) for name, errors in of_type.items()}
        # Readings are due from their first fit on: one by a later version of truearm makes them no newer.
        first: dict[tuple[str, str], str] = {}
        for row in fits.values():
            of = row.serial_number, row.session_sha256
            first[of] = min(row.fitted_at, first.get(of, row.fitted_at))
        states = []
        for arm in self.registry.arms():
            known = _fit_of(self._task(arm, in_force), fits) if arm.session else None
            used = fits.get(in_force.get(arm.serial_number, ""))
            read = None if used is None else first[used.serial_number, used.session_sha256]
            states.append(_state(arm, known, used, read, medians, now))
        return FleetStatus(self.registry.place, tuple(sorted(states, key=lambda one: one.rank)))

    def _task(self, arm: RegisteredArm, in_force: dict[str, str]) -> FitTask:
        key = key_of(arm.serial_number, arm.arm, arm.session, arm.model or "auto")
        before = in_force.get(arm.serial_number)
        return FitTask(
            arm.serial_number,
            arm.arm,
            arm.session,
            arm.model or "auto",
            key,
            str(self.model_file(key)),
            "" if before is None or before == key else str(self.model_file(before)),
        )


@dataclass(frozen=True, eq=False, repr=False)
class FleetRun(Record):
    """What a run did.

    Attributes
    ----------
    rows : tuple of FitRow
        Of the arms that were fitted, by serial number; those that failed are among them.
    unchanged : tuple of FitRow
        Earlier results of arms with the same inputs.

    Examples
    --------
    >>> from truearm.fleet.fleet import FleetRun
    >>> print(FleetRun((), ()))
    Nothing to fit: 0 arms are unchanged.
    """

    rows: tuple[FitRow, ...]
    unchanged: tuple[FitRow, ...]

    @property
    def n_fitted(self) -> int:
        """Arms that got a model."""
        return sum(row.state == "fitted" for row in self.rows)

    @property
    def failures(self) -> tuple[FitRow, ...]:
        """Fits without a model, those of earlier runs with the same inputs among them."""
        return tuple(row for row in (*self.rows, *self.unchanged) if row.state != "fitted")

    def summary(self) -> str:
        """How many arms were fitted, and how many failed."""
        same = f"{number_of(len(self.unchanged), 'arm')} {agree(len(self.unchanged), 'are')} unchanged"
        if not self.rows:
            return f"Nothing to fit: {same}."
        failed = len(self.rows) - self.n_fitted
        return f"{number_of(self.n_fitted, 'arm')} fitted, {failed} failed; {same}."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        for row in self.failures[:MAX_ROWS]:
            yield f"{row.serial_number}: {row.message}"
        if (more := len(self.failures) - MAX_ROWS) > 0:
            yield f"{number_of(more, 'more failure')}: truearm fleet status"
        for row in self.rows:
            if row.state == "fitted" and not row.is_usable:
                yield f"{row.serial_number}: {row.outcome}"

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "n_fitted": self.n_fitted,
            "n_unchanged": len(self.unchanged),
            "failures": {row.serial_number: row.message for row in self.failures},
            "rows": self.rows,
        }


@dataclass(frozen=True, eq=False, repr=False)
class FleetStatus(PageRecord):
    """The state of every arm of a fleet.

    Attributes
    ----------
    place : str
        The database.
    arms : tuple of ArmState
        Worst first.

    Examples
    --------
    >>> from truearm.fleet.fleet import FleetStatus
    >>> FleetStatus("sqlite:///registry.sqlite", ()).summary()
    'The fleet has no arms.'
    """

    place: str
    arms: tuple[ArmState, ...]

    def summary(self) -> str:
        """How many arms there are, by what is to be done."""
        if not self.arms:
            return "The fleet has no arms."
        counts = Counter(one.what for one in self.arms)
        return f"{number_of(len(self.arms), 'arm')}: " + ", ".join(f"{n} {what}" for what, n in counts.items()) + "."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        if self.arms:
            columns = ("serial number", "type", "site", "state", "held out, mm", "of type", "moved, mm", "due")
            yield TextTable(columns, (_text_row(one) for one in self.arms[:MAX_ROWS]), left_aligned=(0, 1, 2, 3, 7))
            if (more := len(self.arms) - MAX_ROWS) > 0:
                yield f"{number_of(more, 'more arm')}: truearm fleet report, or --json"
        for one in self.arms[:MAX_ROWS]:
            if one.message:
                yield f"{one.serial_number}: {one.message}"

    def page(self) -> Page:
        """See `PageRecord.page`."""
        return fleet_page(self.arms, summary=self.summary(), facts=(("database", self.place), version_row()))

    def _json(self) -> object:
        return {"summary": self.summary(), "database": self.place, "arms": self.arms}


def _fit_of(task: FitTask, fits: dict[str, FitRow]) -> FitRow | None:
    """The result of a task; None if there is none, or its model file is gone."""
    known = fits.get(task.key)
    return None if known is not None and known.state == "fitted" and not Path(task.out).is_file() else known


def _text_row(one: ArmState) -> tuple[str, ...]:
    numbers = [
        "" if value is None else format_fixed(value, decimals)
        for value, decimals in ((one.held_out_mm, 4), (one.of_type, 2), (one.moved_mm, 4))
    ]
    return one.serial_number, one.arm, one.site, one.what, *numbers, one.due


def _state(
    arm: RegisteredArm,
    known: FitRow | None,
    used: FitRow | None,
    read: str | None,
    medians: dict[str, float],
    now: datetime,
) -> ArmState:
    """The state of one arm from the fit of its readings, the fit whose model is in force, and when that was read."""
    due, overdue = "", False
    if read is not None and arm.every_days is not None:
        at = datetime.fromisoformat(read) + timedelta(days=arm.every_days)
        due, overdue = f"{at.date()}", at <= now
    what: What = "in force"
    message = ""
    if not arm.session:
        what = "without readings"
    elif known is not None and not known.is_usable:
        what, message = "failed", known.outcome
    elif known is None or known is not used:
        what = "to be fitted"
    elif overdue:
        what = "due"
    error = None if used is None else used.held_out_mm
    return ArmState(
        arm.serial_number,
        arm.arm if used is None else used.arm,
        arm.site,
        what,
        message=message,
        model="" if used is None else used.model,
        since="" if used is None else used.fitted_at[:10],
        n_readings=None if used is None else used.n_readings,
        held_out_mm=error,
        of_type=None if used is None or not error else error / medians[used.arm],
        moved_mm=None if used is None else used.moved_mm,
        n_changed=None if used is None else used.n_changed,
        due=due,
    )


def _checked(arm: RegisteredArm, beside: Path) -> RegisteredArm:
    """The arm with whole paths, if it can be that of a registry."""
    serial_number = arm.serial_number.strip()
    for name, value in (("serial_number", serial_number), ("site", arm.site), ("arm", arm.arm), ("file", arm.session)):
        reject_control_characters(value)
        if not value.isascii() and value != value.encode(errors="replace").decode():
            raise InputError(f"expected a {name} of Unicode characters, got {value!r}")
        if name in ("serial_number", "site") and len(value) > MAX_NAME:
            raise InputError(f"expected a {name} of at most {MAX_NAME} characters, got {len(value)}")
    if not serial_number:
        raise InputError("expected a serial number, got an empty one")
    if arm.model is not None and arm.model not in get_args(ModelName):
        raise InputError(f"expected a model among {', '.join(get_args(ModelName))}, got {arm.model!r}")
    if arm.every_days is not None and not 1 <= arm.every_days <= MAX_DAYS:
        raise InputError(f"expected every_days of 1 to {MAX_DAYS}, got {arm.every_days}")
    is_file = arm_path(beside / arm.arm).is_file()
    drawing = str((beside / arm.arm).absolute()) if is_file else arm.arm
    name = load_arm(drawing).name
    session = str((beside / arm.session).absolute()) if arm.session else ""
    if session and not Path(session).is_file():
        raise InputError("the file of the readings does not exist", file=session)
    return replace(arm, serial_number=serial_number, arm=drawing if is_file else name, session=session)


def _database(content: bytes) -> str:
    """The URL of the database in the settings of a fleet."""
    try:
        url = tomllib.loads(utf8_text(content))["fleet"]["database"]
    except (tomllib.TOMLDecodeError, KeyError, TypeError):
        url = None
    if not isinstance(url, str):
        raise InputError('expected [fleet] with database = "URL"', hint="truearm fleet init writes it")
    return url
