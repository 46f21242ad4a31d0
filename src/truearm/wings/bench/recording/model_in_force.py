"""The model that corrects the tip of a connected arm, sample by sample: a fit of the readings replaces it, if no worse.

The fit has a process of its own.
"""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError, ProgramFault, TruearmError
from truearm.models import Compensator, load_model
from truearm.number_format import format_count
from truearm.readings import Session, read_session
from truearm.readings.anchors import LEAST_COMPARED
from truearm.typing import FloatArray
from truearm.verbs.evaluate import evaluate
from truearm.verbs.fit import fit
from truearm.verbs.outputs import check_model_output
from truearm.wings.bench.recording.session_log import Event
from truearm.wings.bench.sources import Sample

COVERAGE_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class CorrectedTip:
    """Where a model says that the tip is.

    Attributes
    ----------
    tip_in_reference_mm : (3,) array
    U_mm : (3,) array
        Expanded uncertainties of its coordinates, k = 2 [mm].
    is_trained : bool
        Whether all inputs are within the trained range.
    """

    tip_in_reference_mm: FloatArray
    U_mm: FloatArray
    is_trained: bool

    def __str__(self) -> str:
        x, y, z = self.tip_in_reference_mm
        outside = "" if self.is_trained else ", outside the trained range"
        return f"x {x:.3f}  y {y:.3f}  z {z:.3f} mm, U (k = 2) {self.U_mm.max():.3f} mm{outside}"


def corrected_tip(model: Compensator, sample: Sample, directions: FloatArray) -> CorrectedTip | str:
    """The tip at a sample, with its temperature and loads; or why there is none.

    Parameters
    ----------
    model : Compensator
    sample : Sample
        Of the arm that the model is of.
    directions : (n_joints,) array
        Sign of each joint's last movement: -1, 1, or 0; an unknown one takes time, for its uncertainty.
    """
    temperature = None if sample.temperature_degC is None else np.array([sample.temperature_degC])
    loads = {name: np.array([value]) for name, value in sample.columns.items()}
    try:
        readings = Session(
            sample.joint_angles_rad[None], temperature_degC=temperature, directions=directions[None], columns=loads
        )
        (tip,) = corrected_tips(model, readings)
    except InputError as error:
        return error.problem
    return tip


def corrected_tips(model: Compensator, readings: Session) -> list[CorrectedTip]:
    """The tip at each reading.

    Raises
    ------
    InputError
        If the readings lack what the model needs, or are of another arm.
    """
    at = model.checked(readings)
    points, covariances = model.predict_readings(at, return_cov=True)
    U_mm = COVERAGE_FACTOR * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    return [*map(CorrectedTip, points, U_mm, (~model.outside_training(at)).tolist())]


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model that may replace the one in force.

    Attributes
    ----------
    model : Compensator
    summary : str
        Its mean error on held-out readings, in a sentence.
    held_out_mm : tuple of 2 floats, optional
        That error and the one of the nominal arm [mm].
    """

    model: Compensator
    summary: str
    held_out_mm: tuple[float, float] | None = None


class FitProcess:
    """The fit ``model="auto"`` of a session, in a process that can be stopped.

    Parameters
    ----------
    arm : Arm
    session : Session
    """

    def __init__(self, arm: Arm, session: Session) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="truearm-")
        self._file = Path(self._folder.name) / "fitted.truearm"
        context = get_context("spawn")  # threads of a BLAS do not survive a fork
        self._said, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_fit, args=(theirs, arm, session, self._file), daemon=True)
        self._process.start()
        theirs.close()

    def news(self) -> Iterator[str | Fitted | TruearmError]:
        """What came since it was last asked for: the steps in words, and last the model, or why there is none."""
        try:
            while self._said.poll():
                kind, text, held_out_mm = self._said.recv()
                if kind == "step":
                    yield str(text)
                    continue
                if kind == "done":
                    yield Fitted(load_model(self._file), str(text), held_out_mm)
                else:
                    yield TruearmError(str(text))
                self.stop()
                return
        except (EOFError, OSError):
            self.stop()
            yield TruearmError("the process of the fit has ended without a model")

    def stop(self) -> None:
        """End the process, done or not."""
        self._process.terminate()
        self._process.join()
        self._said.close()
        self._folder.cleanup()


def _fit(said: Connection, arm: Arm, session: Session, file: Path) -> None:
    """What the process does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started this one, which ends it
    steps = list[int]()

    def report(done: int, note: str) -> None:
        if done not in steps:
            steps.append(done)
            said.send(("step", note, None))

    try:
        result = fit(arm, session, progress=report)
        result.save(file)
    except (TruearmError, ProgramFault) as error:
        said.send(("failed", str(error), None))
    else:
        said.send(("done", result.summary(), result.held_out_mm))


def why_worse(new: Compensator, in_force: Compensator, unknown: Session) -> str:
    """Why a fitted model does not replace the one in force; empty if it does.

    It is compared by its errors on held-out readings with those of the model in force on readings that this one does
    not know. Of fewer than `LEAST_COMPARED`, nothing follows.
    """
    held_out = new.held_out_
    if len(unknown) < LEAST_COMPARED or not len(held_out.rows):
        return ""
    try:
        errors = evaluate(in_force, unknown).errors["model"]
        before_mm = errors["mean_mm"] if "mean_mm" in errors else errors["seat_mean_mm"]
    except (InputError, KeyError):
        return ""  # it does not apply to these readings
    if held_out.mean_mm - held_out.standard_error_mm <= before_mm:
        return ""
    return f"mean error {held_out.mean_mm:.3f} mm on held-out readings, {before_mm:.3f} mm of the model in force"


class ModelInForce:
    """The model in force, and the fit that may replace it.

    Parameters
    ----------
    arm : Arm, optional
        The nominal arm, which a fit needs.
    model : Compensator, optional
    readings : Path
        Session file of the recording.
    out : Path, optional
        Where `save` writes the model, which replaces one of the same arm only.

    Attributes
    ----------
    model : Compensator, optional
    trained_on : int
        Number of readings of the session, from its first, that the model was fitted to.
    """

    def __init__(self, arm: Arm | None, model: Compensator | None, readings: Path, out: Path | None) -> None:
        if out is not None:
            try:
                check_model_output(out, arm, readings, force=False)
            except InputError as error:
                raise error.with_hint("another name for the model") from None
        self._arm, self.model, self._readings, self._out = arm, model, readings, out
        self.trained_on = 0 if model is None else _n_known(model, readings)
        self._fit: FitProcess | None = None
        self._fitted_on = 0  # as trained_on, of the fit under way

    def refit(self, n_readings: int) -> Event:
        """Begin to fit a model to the readings, by the command ``refit``."""
        if self._fit is not None:
            return Event("refused", "a fit is under way")
        if self._arm is None:
            return Event("refused", "a fit needs the arm: start with --arm ARM")
        if not n_readings:
            return Event("refused", "there are no readings to fit")
        try:
            self._fit, self._fitted_on = FitProcess(self._arm, read_session(self._readings)), n_readings
        except (InputError, OSError) as error:  # a person broke the file, or there is no memory or disk
            return Event("refused", f"no fit begins: {error}")
        return Event("notice", f"fitting {format_count(n_readings, 'reading')}; further ones are taken meanwhile")

    @property
    def is_fitting(self) -> bool:
        """Whether a fit is under way."""
        return self._fit is not None

    def undone(self, n_readings: int) -> None:
        """Of the session only the first `n_readings` are left."""
        self.trained_on, self._fitted_on = min(self.trained_on, n_readings), min(self._fitted_on, n_readings)

    def news(self) -> Iterator[Event]:
        """What the fit says: its steps, and of the kind ``model`` that another one is in force now."""
        for one in () if self._fit is None else self._fit.news():
            if isinstance(one, str):
                yield Event("notice", f"fit: {one}")
                continue
            self._fit = None
            yield self._replaced(one)

    def _replaced(self, new: Fitted | TruearmError) -> Event:
        if isinstance(new, TruearmError):
            return Event("refused", f"the fit has failed, {self._stays}: {new}")
        if self.model is not None:
            try:
                session = read_session(self._readings)
            except InputError as error:
                return Event("refused", f"the fit cannot be compared, {self._stays}: {error}")
            unknown = session.rows(np.arange(self.trained_on, min(self._fitted_on, len(session))))
            # It knows more than a model of the same session; than one of others, it must be shown to be no worse.
            if not self.trained_on and len(unknown) < LEAST_COMPARED:
                few = f"a comparison needs {LEAST_COMPARED} readings, there are {len(unknown)}"
                return Event("refused", f"the fit cannot be compared, {self._stays}: {few}")
            if worse := why_worse(new.model, self.model, unknown):
                return Event("refused", f"the fit is worse, {self._stays}: {worse}")
        self.model, self.trained_on = new.model, self._fitted_on
        values: dict[str, object] = {"model": new.model.kind, "n": self.trained_on}
        if new.held_out_mm is not None:
            values |= zip(("held_out_mm", "nominal_mm"), new.held_out_mm, strict=True)
        return Event("model", f"new model in force. {new.summary}", values)

    @property
    def _stays(self) -> str:
        return "and no model is in force" if self.model is None else "and the model in force stays"

    def save(self) -> Event:
        """Write the model in force, by the command ``save``."""
        if self._out is None:
            return Event("refused", "the model has no file: start with --out-model FILE")
        if self.model is None:
            return Event("refused", "no model is in force yet: refit first")
        try:
            self.model.save(self._out)
        except (TruearmError, ProgramFault) as error:
            return Event("refused", str(error))
        return Event("notice", f"model in {self._out}", {"file": str(self._out)})

    def close(self) -> None:
        """End a fit that is under way."""
        if self._fit is not None:
            self._fit.stop()
            self._fit = None


def _n_known(model: Compensator, readings: Path) -> int:
    """Number of readings of a session file, from its first, that a model was fitted to: all that it knows, or none."""
    n = model.training_.n_readings
    with suppress(InputError):  # no file yet, or none that can be read
        session = read_session(readings)
        if n <= len(session) and model.is_trained_on(session.rows(np.arange(n))):
            return n
    return 0
