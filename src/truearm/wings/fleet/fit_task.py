"""The fit of one arm as a task for any worker: files in, a model file and one row out."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from hashlib import sha256
from math import isfinite
from pathlib import Path
from typing import Any, Literal

from truearm import __version__
from truearm.arm.catalogue import arm_path
from truearm.choices import ModelName
from truearm.errors import InputError, MissingTool, TruearmError
from truearm.findings import format_mm
from truearm.identification.terms.type_prior import read_type_prior
from truearm.models import IdentifiedModel
from truearm.models.identified_model import to_identified
from truearm.verbs.fit import FitResult, fit
from truearm.wings.exports.formats.constants_table import constants_table
from truearm.wings.exports.formats.rigid_arm import best_rigid_arm
from truearm.wings.fleet.stored_files import content_sha256, local_copy
from truearm.wings.reports.compare import compare

State = Literal["fitted", "failed", "lost"]


@dataclass(frozen=True)
class FitTask:
    """What one fit needs.

    Attributes
    ----------
    serial_number : str
        Of the arm.
    arm : str
        The nominal arm, as `truearm.load_arm` takes it.
    session : str
        File of the readings, or its URL.
    model : str
        Kind of model, as `truearm.fit` takes it.
    key : str
        SHA-256 of all inputs: the same inputs need no second fit.
    out : str
        The model file to write.
    before : str
        File of the model in force; empty if there is none.
    prior : str
        File of the type prior in force; empty if there is none.
    """

    serial_number: str
    arm: str
    session: str
    model: ModelName
    key: str
    out: str
    before: str = ""
    prior: str = ""


@dataclass(frozen=True)
class FitRow:
    """The result of one fit, as the registry and the data set of results keep it.

    Attributes
    ----------
    key, serial_number, arm, session : str
        See `FitTask`.
    state : {"fitted", "failed", "lost"}
        Lost: for another reason than its inputs (a killed worker, a full disk); the next run tries again.
    message : str
        Why it failed.
    truearm, fitted_at : str
        Version, and UTC time (ISO 8601).
    model : str
        Kind of the fitted model.
    model_sha256 : str
        Of the model file.
    session_sha256 : str
        Of the file of the readings.
    n_readings : int
    held_out_mm, nominal_mm : float or None
        Mean error on held-out readings, of the model and of the nominal arm.
    residual_std_mm : float or None
        Residual standard deviation of a coordinate.
    moved_mm : float or None
        Mean displacement of the tip from the model that was in force.
    n_changed : int or None
        Constants that changed from that model by more than their uncertainty.
    seconds : float
        Duration of the fit.
    constants : tuple of dict
        Identified constants of the arm: ``name``, ``unit`` (mm or rad), ``nominal``, ``value``, ``u``.
    variances : tuple of dict
        Groups of terms: ``name``, ``scale`` of the prior as the evidence estimated it, and ``n_determined``.
    """

    key: str
    serial_number: str
    arm: str
    session: str
    state: State
    message: str = ""
    truearm: str = __version__
    fitted_at: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    model: str = ""
    model_sha256: str = ""
    session_sha256: str = ""
    n_readings: int = 0
    held_out_mm: float | None = None
    nominal_mm: float | None = None
    residual_std_mm: float | None = None
    moved_mm: float | None = None
    n_changed: int | None = None
    seconds: float = 0.0
    constants: tuple[dict[str, Any], ...] = ()
    variances: tuple[dict[str, Any], ...] = ()

    @classmethod
    def without_result(cls, task: FitTask, state: State, message: str) -> FitRow:
        """The row of a fit that gave no model."""
        return cls(task.key, task.serial_number, task.arm, task.session, state, message)

    @property
    def is_usable(self) -> bool:
        """Whether there is a model that is not worse than the nominal arm on readings held out."""
        worse = self.held_out_mm is not None and self.nominal_mm is not None and self.held_out_mm > self.nominal_mm
        return self.state == "fitted" and not worse

    @property
    def outcome(self) -> str:
        """The result in a few words."""
        if self.state != "fitted":
            return self.message
        if self.held_out_mm is None:
            return f"{self.model} model of {self.n_readings} readings"
        found = f"{self.model} model, {format_mm(self.held_out_mm)} on held-out readings"
        if self.is_usable:
            return found
        return f"{found}, worse than the nominal arm; not in force. Try: add more readings, or --model nominal"


def key_of(
    serial_number: str,
    arm: str,
    session: str,
    model: str,
    prior: str = "",
    sha256_of: Callable[[str], str] = content_sha256,
) -> str:
    """The SHA-256 of the inputs of a fit: contents of its files, kind of model, version of truearm.

    A file that cannot be read counts by its name, and the fit then says why. `sha256_of` gives that of a file.
    """
    drawing = str(arm_path(arm))
    inputs = [
        __version__,
        serial_number,
        _content(drawing, arm, sha256_of),
        _content(session, session, sha256_of),
        model,
        *([_content(prior, prior, sha256_of)] if prior else []),
    ]
    return sha256(json.dumps(inputs).encode()).hexdigest()


def _content(file: str, name: str, sha256_of: Callable[[str], str] = content_sha256) -> str:
    try:
        return sha256_of(file)
    except (OSError, TruearmError):
        return f"file {name}"


def fit_arm(task: FitTask) -> FitRow:
    """Fit one arm and write its model; what fails is in the row, so that one arm stops no other."""
    start = time.perf_counter()
    state: State = "failed"
    copy = task.session
    try:
        with local_copy(task.session) as file:
            copy = str(file)
            # By its number in the registry: not every session file states one.
            prior = read_type_prior(task.prior).without(task.serial_number) if task.prior else None
            result = fit(task.arm, file, model=task.model, prior=prior)
        check_serial_number(task.serial_number, result.model.arm.serial_number, task.session)
        state = "lost"  # what fails from here on may be mended without other readings
        if _has_changed(task):
            raise TruearmError(
                "its files changed during the fit, or the worker has others, or another version of truearm. "
                "Try: the same command again"
            )
        Path(task.out).parent.mkdir(parents=True, exist_ok=True)
        result.model.fit_seconds_ = 0.0  # the same inputs give the same file; the row has the duration
        result.save(task.out)
        return _row(task, result, seconds=time.perf_counter() - start)
    except (TruearmError, OSError, MemoryError) as error:
        if isinstance(error, (OSError, MemoryError, MissingTool)) or _has_changed(task):
            state = "lost"
        return FitRow.without_result(task, state, str(error).replace(copy, task.session) or type(error).__name__)
    except Exception:
        return FitRow.without_result(task, "failed", f"a fault of the program: {traceback.format_exc(limit=-3)}")


def _has_changed(task: FitTask) -> bool:
    return key_of(task.serial_number, task.arm, task.session, task.model, task.prior) != task.key


def check_serial_number(serial_number: str, stated: str, session: str) -> None:
    """Check that the arm or its readings state no other serial number than the registry.

    Raises
    ------
    InputError
        If they do.
    """
    if stated and stated != serial_number:
        raise InputError(
            f"the readings are of serial number {stated!r}, the registry has them for {serial_number!r}",
            file=session,
            hint="add them under the serial number that they state, or correct it in the session file",
        )


def _row(task: FitTask, result: FitResult, *, seconds: float) -> FitRow:
    held_out, nominal = result.held_out_mm or (None, None)
    identified = to_identified(result.model)
    moved, n_changed = _change(task.before, identified)
    groups = () if identified is None else identified.fit_.groups
    return FitRow(
        task.key,
        task.serial_number,
        result.model.arm.name,
        task.session,
        "fitted",
        model=result.model_name,
        model_sha256=_content(task.out, task.out),
        session_sha256=_content(task.session, task.session),
        n_readings=result.n_readings,
        held_out_mm=held_out,
        nominal_mm=nominal,
        residual_std_mm=result.model.facts().get("residual_std_mm"),
        moved_mm=moved,
        n_changed=n_changed,
        seconds=seconds,
        constants=() if identified is None else tuple(_constants(identified)),
        variances=tuple({"name": one.name, "scale": one.scale, "n_determined": one.effective} for one in groups),
    )


def _change(before: str, new: IdentifiedModel | None) -> tuple[float | None, int | None]:
    """How far the tip moved from the model in force, and how many constants changed; None where none is comparable."""
    if not before or new is None:
        return None, None
    try:
        change = compare(before, new)
    except (TruearmError, OSError):
        return None, None
    return change.change.displacement.mean_mm, len(change.changed)


def _constants(model: IdentifiedModel) -> Iterator[dict[str, Any]]:
    for one in constants_table(model, best_rigid_arm(model)).constants:
        values = {"nominal": one.nominal, "value": one.identified, "u": one.std}
        finite = {name: value if value is not None and isfinite(value) else None for name, value in values.items()}
        yield {"name": f"{one.place} {one.name}", "unit": one.unit, **finite}
