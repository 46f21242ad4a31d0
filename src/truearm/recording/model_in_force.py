"""The model that corrects the tip of a connected arm: a fit of the readings replaces it, if it is no worse."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from truearm.arm import Arm
from truearm.compensation.models import Compensator
from truearm.errors import InputError, ProgramFault, TruearmError
from truearm.files.atomic_write import check_writable
from truearm.number_format import format_count
from truearm.readings import read_session
from truearm.readings.anchors import LEAST_COMPARED
from truearm.recording.fit_process import FitProcess, Fitted, why_worse
from truearm.recording.recording_event import Event


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
        Where `save` writes the model; must be new.

    Attributes
    ----------
    model : Compensator, optional
    trained_on : int
        Number of readings of the session, from its first, that the model was fitted to.
    """

    def __init__(self, arm: Arm | None, model: Compensator | None, readings: Path, out: Path | None) -> None:
        if out is not None:
            if out.exists():
                raise InputError("the file exists", file=out, hint="choose another name for the model")
            check_writable(out)
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
        return Event("model", f"new model in force. {new.summary}", {"model": new.model.kind, "n": self.trained_on})

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
