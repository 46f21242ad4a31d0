"""A fleet: a folder with a registry of arms, their models, and the results of all fits.

The results are a Parquet data set, which DuckDB, Polars and pandas read: its columns are those of `FitRow`, units in
their names. A run states the arms that were fitted, and those that failed.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from datetime import UTC, date, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any, get_args
from urllib.parse import quote

from truearm.arm import Arm, load_arm
from truearm.arm.catalogue import arm_path
from truearm.choices import ModelName
from truearm.errors import InputError, TruearmError, extra_module
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import MAX_NAME
from truearm.files.file_reading import parse_file
from truearm.files.toml_documents import load_toml, reject_control_characters, toml_text
from truearm.identification.terms.type_prior import kinematics_sha256, read_type_prior
from truearm.models import Compensator, load_model
from truearm.models.arm_check import with_serial_number
from truearm.pages.drawings.page_record import check_page_path, make_folder, version_row
from truearm.pages.html import write_page
from truearm.readings import read_session
from truearm.solve.executors import Executor, Serial, WorkerLost
from truearm.verbs.fit import WITHOUT_CONSTANTS
from truearm.verbs.inputs import LengthsLike, SessionLike
from truearm.verbs.record import TableRecord, TextTable, agree, columns_of, number_of
from truearm.wings.fleet.arm_list import RegisteredArm
from truearm.wings.fleet.certificates import read_registered
from truearm.wings.fleet.fit_task import FitRow, FitTask, check_serial_number, fit_arm, key_of
from truearm.wings.fleet.fleet_status import ArmRecords, FleetFigures, FleetStatus, arm_state, history_page
from truearm.wings.fleet.stored_files import FileHashes, check_stored, is_url
from truearm.wings.fleet.type_prior import LearnedTypePrior, learn_type_prior
from truearm.wings.laboratory.monitor.history import History
from truearm.wings.laboratory.verbs.check import CheckResult, check
from truearm.wings.laboratory.verbs.verify import SpecificationLike

# Failures that are printed.
MAX_ROWS = 20


@dataclass(frozen=True, eq=False, repr=False)
class FleetRun(TableRecord):
    """What a run did.

    Attributes
    ----------
    rows : tuple of FitRow
        Of the arms that were fitted, by serial number; those that failed are among them.
    unchanged : tuple of FitRow
        Earlier results of arms with the same inputs.

    Examples
    --------
    >>> from truearm.wings.fleet.fleet import FleetRun
    >>> print(FleetRun((), ()))
    Nothing to fit: 0 arms are unchanged.
    """

    rows: tuple[FitRow, ...]
    unchanged: tuple[FitRow, ...]

    @property
    def n_fitted(self) -> int:
        """Arms that got a model in force."""
        return sum(row.is_usable for row in self.rows)

    @property
    def failures(self) -> tuple[FitRow, ...]:
        """Fits without a model, or with one worse than the nominal arm; those of earlier runs are among them."""
        return tuple(row for row in (*self.rows, *self.unchanged) if not row.is_usable)

    def summary(self) -> str:
        """How many arms were fitted, and how many failed."""
        same = f"{number_of(len(self.unchanged), 'arm')} {agree(len(self.unchanged), 'are')} unchanged"
        if n_before := sum(not row.is_usable for row in self.unchanged):
            same += f", {n_before} of them failed"
        if not self.rows:
            return f"Nothing to fit: {same}."
        failed = len(self.rows) - self.n_fitted
        return f"{number_of(self.n_fitted, 'arm')} fitted, {failed} failed; {same}."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        for row in self.failures[:MAX_ROWS]:
            yield f"{row.serial_number}: {row.outcome}"
        if (more := len(self.failures) - MAX_ROWS) > 0:
            yield f"{number_of(more, 'more failure')}: truearm fleet status"

    def columns(self) -> dict[str, list[Any]]:
        """A row for each fit of this run; ``seconds`` is its duration."""
        return columns_of(self.rows)

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "n_fitted": self.n_fitted,
            "n_unchanged": len(self.unchanged),
            "failures": {row.serial_number: row.outcome for row in self.failures},
            "rows": self.rows,
        }


def write_results(rows: Iterable[FitRow], folder: Path) -> None:
    """Write the rows as the file of the data set, whole or not at all; results of removed arms that it has stay.

    Parameters
    ----------
    rows : iterable of FitRow
    folder : Path
        Made where it does not exist.

    Raises
    ------
    TruearmError
        If pyarrow is not installed, or the file cannot be written.
    """
    needs, hint = "the data set of results needs the package pyarrow", "pip install 'truearm[fleet]'"
    pa, pc, pq = (extra_module(f"pyarrow{part}", needs, hint) for part in ("", ".compute", ".parquet"))
    text, number = pa.string(), pa.float64()
    constant = pa.struct([("name", text), ("unit", text), ("nominal", number), ("value", number), ("u", number)])
    group = pa.struct([("name", text), ("scale", number), ("n_determined", number)])
    kinds = {
        **dict.fromkeys(("n_readings", "n_changed"), pa.int64()),
        **dict.fromkeys(("held_out_mm", "nominal_mm", "residual_std_mm", "moved_mm", "seconds"), number),
        "constants": pa.list_(constant),
        "variances": pa.list_(group),
    }
    schema = pa.schema([(one.name, kinds.get(one.name, text)) for one in fields(FitRow)])
    make_folder(folder)
    found = pa.Table.from_pylist([vars(row) for row in rows], schema=schema)
    file = folder / "fits.parquet"
    try:
        if file.is_file():
            before = pq.read_table(file, partitioning=None)
            removed = before.filter(pc.invert(pc.is_in(before["key"], found["key"])))
            found = pa.concat_tables([found, removed], promote_options="default").select(schema.names)
    except (pa.ArrowException, KeyError) as error:
        raise InputError(f"the data set of results is damaged ({error})", file=file, hint="move it away") from None
    with atomic_file(file) as beside:
        pq.write_table(found, beside)


SETTINGS = "fleet.toml"
PRIORS = "priors"
DEFAULT_DATABASE = "sqlite:///registry.sqlite"
MAX_BYTES = 100_000
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
        from truearm.wings.fleet.registry import Registry  # SQLAlchemy is an extra

        self.registry = Registry(_read_database(settings), beside=self.folder)

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
        from truearm.wings.fleet.registry import Registry

        path = Path(folder).absolute()
        if (path / SETTINGS).exists():
            raise InputError("this is the folder of a fleet already", file=path)
        make_folder(path)
        Registry(database, beside=path, create=True).close()
        with atomic_file(path / SETTINGS, read=_read_database) as beside:
            beside.write_text(f"[fleet]\ndatabase = {toml_text(database)}\n", encoding="utf-8")
        return cls(path)

    def close(self) -> None:
        """Close the connections to the database."""
        self.registry.close()

    def add(
        self,
        serial_number: str,
        arm: str | None = None,
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
        arm : str, optional
            The nominal arm: a name of `list_arms`, or an arm file or URDF; by default that of the arm that is there.
        session : path, optional
            File of its readings, or its URL as fsspec has it (``s3://bucket/a.csv``). It stays where it is.
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
            If the number is registered for an arm of another type, is new although no `arm` is given, or is not that
            which the file of the readings states.
        """
        if arm is None:
            arm = self.registry.nominal_arm(serial_number.strip())
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

    def remove(self, serial_number: str) -> dict[str, int]:
        """Take an arm off the fleet, with its history of checks; readings, model files and results stay as files.

        Parameters
        ----------
        serial_number : str

        Returns
        -------
        dict of str to int
            How many rows of the registry went, by its tables: ``fits``, ``checks``, ``certificates`` and so on.

        Raises
        ------
        InputError
            If there is no such arm.
        """
        self._write_results()
        return self.registry.remove(serial_number)

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

    def add_certificates(
        self, files: Iterable[str | Path], *, due: date | None = None, trusted: str | Path | None = None
    ) -> int:
        """Add calibration certificates of arms of the fleet, all or none; each states the serial number of its arm.

        Parameters
        ----------
        files : iterable of path
            Digital calibration certificates, ``.xml`` or the ``.pdf`` with one inside. They stay where they are.
        due : date, optional
            Day of the next calibration; by default that which a certificate states.
        trusted : path, optional
            Certificates (PEM) of the signers, as `read_certificate` takes them.

        Returns
        -------
        int
            Of how many something is new.

        Raises
        ------
        InputError
            If a file is no certificate, its signature is broken, or it is of no arm of the fleet.
        """
        arms = {one.serial_number for one in self.registry.arms()}
        return self.registry.keep_certificates(
            [read_registered(file, arms, due=due, trusted=trusted) for file in files]
        )

    def history(self, serial_number: str) -> History:
        """The history of an arm's interim checks, as `check` and `withdraw_check` take it."""
        return self.registry.history(serial_number)

    def check(
        self,
        serial_number: str,
        session: SessionLike,
        *,
        lengths: LengthsLike | None = None,
        specification: SpecificationLike | None = None,
        retired: Sequence[str] = (),
        date: datetime | str | None = None,
        accept: str | None = None,
    ) -> CheckResult:
        """Check whether an arm is still as its model in force: see `truearm.check`.

        Its history and what it says are in the registry.

        Parameters
        ----------
        serial_number : str
        session, lengths, specification, retired, date, accept
            As `truearm.check` takes them.
        """
        result = check(
            self.model(serial_number),
            session,
            self.history(serial_number),
            lengths=lengths,
            specification=specification,
            retired=retired,
            date=date,
            accept=accept,
        )
        self.registry.keep_verdict(serial_number, result.head, result.record.checks, result.assessment)
        return result

    def run(
        self,
        executor: Executor | None = None,
        *,
        prior: str | Path | None = None,
        verify: bool = False,
        progress: Callable[[int, str], None] | None = None,
    ) -> FleetRun:
        """Fit every arm whose readings, drawing, kind of model or type prior changed since its last fit.

        A failed fit, or one that is worse than the nominal arm, replaces no model in force. An interrupted run goes on
        where it was: what is fitted is not fitted again.

        Parameters
        ----------
        executor : Executor, optional
            Who computes; by default this process.
        prior : path, optional
            File of a type prior (`type_prior`) that is in force from now on: all arms of its type are fitted with it,
            those that it was learned from with what the others have in common.
        verify : bool
            Read every session file, also those of which size and time are as they were.
        progress : callable, optional
            Called with the number of arms done and a note.

        Returns
        -------
        FleetRun

        Raises
        ------
        InputError
            If the prior is of no arm of the fleet.
        """
        if prior is not None:
            self._keep_prior(prior)
        tasks, unchanged = self._tasks(verify=verify)
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

    def type_prior(
        self,
        arm: str | None = None,
        *,
        executor: Executor | None = None,
        progress: Callable[[int, str], None] | None = None,
    ) -> LearnedTypePrior:
        """Learn what the arms of a type have in common, from the readings of those with a model in force.

        Parameters
        ----------
        arm : str, optional
            The nominal arm, as it was added; needed if the fleet has several types.
        executor : Executor, optional
            Who computes; by default this process.
        progress : callable, optional
            Called with the number of steps done and a note.

        Returns
        -------
        LearnedTypePrior
            Its `save` writes the file that `truearm.fit` takes.

        Raises
        ------
        InputError
            If the type is not one of the fleet, or has fewer than three arms with 20 readings.
        """
        in_force = self.registry.models_in_force()
        arms = [one for one in self.registry.arms() if one.session and one.serial_number in in_force]
        return learn_type_prior(arms, arm=arm, executor=executor or Serial(), progress=progress)

    def _keep_prior(self, file: str | Path) -> None:
        """Put a type prior in force."""
        found = read_type_prior(file)
        nominal = next((one for _, one in self._nominal_arms() if kinematics_sha256(one) == found.arm_sha256), None)
        if nominal is None:
            raise InputError(f"expected the prior of a type of the fleet, got one of {found.arm!r}", file=file)
        found.check_arm(nominal)
        make_folder(self.folder / PRIORS)
        found.save(self.folder / PRIORS / f"{found.arm_sha256}.toml")

    def _priors(self) -> dict[str, str]:
        """The file of the type prior in force, by the nominal arm."""
        if not (self.folder / PRIORS).is_dir():
            return {}
        files = {name: self.folder / PRIORS / f"{kinematics_sha256(arm)}.toml" for name, arm in self._nominal_arms()}
        return {name: str(file) for name, file in files.items() if file.is_file()}

    def _nominal_arms(self) -> Iterator[tuple[str, Arm]]:
        """The nominal arms, each once, as the registry names them; why one cannot be read, its fit says."""
        for name in sorted({one.arm for one in self.registry.arms()}):
            with suppress(TruearmError, OSError):
                yield name, load_arm(name)

    def _write_results(self) -> None:
        """Write all results; again if another run had one meanwhile, so that the last one to write has them all."""
        written: set[str] = set()
        while True:
            found = {key: row for key, row in self.registry.fits().items() if row.state != "lost"}
            if found.keys() == written:
                break
            write_results(found.values(), self.folder / "results")
            written = set(found)

    def _tasks(self, *, verify: bool) -> tuple[list[FitTask], list[FitRow]]:
        """What is to be fitted, and the results of arms for which nothing changed."""
        in_force, fits = self.registry.models_in_force(), self.registry.fits()
        arms, priors = [arm for arm in self.registry.arms() if arm.session], self._priors()
        with self._hashes(verify=verify) as sha256_of:
            of_arms = [self._task(arm, in_force.get(arm.serial_number), priors, sha256_of) for arm in arms]
        tasks, unchanged = [], []
        for task in of_arms:
            known = _fit_of(task, fits)
            if known is None or known.state == "lost":
                tasks.append(task)
                continue
            unchanged.append(known)
            if known.is_usable and in_force.get(task.serial_number) != task.key:  # earlier readings were added again
                self.registry.put_in_force(task.serial_number, task.key)
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
        records = {one.arm.serial_number: one for one in self._records(verify=False)}
        figures = FleetFigures(one.used for one in records.values() if one.used is not None)
        now = datetime.now(UTC)
        failed: dict[str, list[FitRow]] = {}
        for row in self.registry.fits().values():
            if not row.is_usable:
                failed.setdefault(row.serial_number, []).append(row)
        facts = (("database", self.registry.place), version_row())
        states = []
        for one in sorted((arm_state(one, figures, now) for one in records.values()), key=lambda one: one.rank):
            name, of = f"{sha256(one.serial_number.encode()).hexdigest()[:16]}.html", records[one.serial_number]
            failures = failed.get(one.serial_number, ())
            page = history_page(of, one, figures.drifts(of.models), failures, quote(f"../{out.name}"), facts)
            write_page(page, beside / name)
            states.append(replace(one, page=quote(f"{beside.name}/{name}")))
            if progress is not None:
                progress(len(states), one.serial_number)
        write_page(FleetStatus(self.registry.place, tuple(states)).page(), out)
        return len(states)

    def status(self, *, today: datetime | None = None, verify: bool = False) -> FleetStatus:
        """The state of every arm, worst first: by what is to be done, then by the drift of its constants.

        Parameters
        ----------
        today : datetime, optional
            For what is due; by default now.
        verify : bool
            Read every session file, also those of which size and time are as they were.
        """
        now = (today or datetime.now(UTC)).astimezone(UTC)
        records = self._records(verify=verify)
        figures = FleetFigures(one.used for one in records if one.used is not None)
        states = [arm_state(one, figures, now) for one in records]
        return FleetStatus(self.registry.place, tuple(sorted(states, key=lambda one: one.rank)))

    def _records(self, *, verify: bool) -> list[ArmRecords]:
        """What the registry has of every arm, by serial number."""
        fits, histories = self.registry.fits(), self.registry.histories()
        verdicts, certificates = self.registry.verdicts(), self.registry.certificates()
        # Readings are due from their first fit on: one by a later version of truearm makes them no newer.
        first: dict[tuple[str, str], str] = {}
        for row in fits.values():
            of = row.serial_number, row.session_sha256
            first[of] = min(row.fitted_at, first.get(of, row.fitted_at))
        records, priors = [], self._priors()
        with self._hashes(verify=verify) as sha256_of:
            for arm in self.registry.arms():
                history = [
                    (since[:10], fits[key]) for since, key in histories.get(arm.serial_number, ()) if key in fits
                ]
                days, models = tuple(day for day, _ in history), tuple(row for _, row in history)
                used = models[-1] if models else None
                task = self._task(arm, None if used is None else used.key, priors, sha256_of)
                verdict = verdicts.get(arm.serial_number)
                records.append(
                    ArmRecords(
                        arm,
                        known=_fit_of(task, fits) if arm.session else None,
                        models=models,
                        days=days,
                        read=None if used is None else first[used.serial_number, used.session_sha256],
                        verdict=verdict if used and verdict and verdict.model == used.model_sha256 else None,
                        certificates=tuple(certificates.get(arm.serial_number, ())),
                        model_file="" if used is None else str(self.model_file(used.key)),
                    )
                )
        return records

    @contextmanager
    def _hashes(self, *, verify: bool) -> Iterator[Callable[[str], str]]:
        """Gives the SHA-256 of files, by size and time of those that were read before; keeps what is new."""
        hashes = FileHashes({} if verify else self.registry.file_hashes())
        yield hashes.sha256
        self.registry.keep_file_hashes(hashes.new)

    def _task(
        self, arm: RegisteredArm, before: str | None, priors: Mapping[str, str], sha256_of: Callable[[str], str]
    ) -> FitTask:
        """The fit of an arm; `before` is the key of that whose model is in force."""
        model = arm.model or "auto"
        prior = "" if model in WITHOUT_CONSTANTS else priors.get(arm.arm, "")
        key = key_of(arm.serial_number, arm.arm, arm.session, model, prior, sha256_of)
        return FitTask(
            arm.serial_number,
            arm.arm,
            arm.session,
            model,
            key,
            str(self.model_file(key)),
            "" if before is None or before == key else str(self.model_file(before)),
            prior,
        )


def _fit_of(task: FitTask, fits: dict[str, FitRow]) -> FitRow | None:
    """The result of a task; None if there is none, or its model file is gone."""
    known = fits.get(task.key)
    return None if known is not None and known.state == "fitted" and not Path(task.out).is_file() else known


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
    nominal = load_arm(drawing)
    session = arm.session if not arm.session or is_url(arm.session) else str((beside / arm.session).absolute())
    if session:
        check_stored(session)
        _check_readings(serial_number, nominal, session)
    return replace(arm, serial_number=serial_number, arm=drawing if is_file else nominal.name, session=session)


def _check_readings(serial_number: str, nominal: Arm, session: str) -> None:
    """Check that a file on this machine states no other serial number; what else is wrong with it the run says."""
    if is_url(session):
        return
    try:
        readings = read_session(session)
    except TruearmError:
        return
    check_serial_number(serial_number, with_serial_number(nominal, readings).serial_number, session)


def _read_database(settings: Path) -> str:
    return parse_file(settings, _database, limit_bytes=MAX_BYTES)


def _database(content: bytes) -> str:
    """The URL of the database in the settings of a fleet."""
    try:
        url = load_toml(content)["fleet"]["database"]
    except (tomllib.TOMLDecodeError, KeyError, TypeError):
        url = None
    if not isinstance(url, str):
        raise InputError('expected [fleet] with database = "URL"', hint="truearm fleet init writes it")
    return url
