"""The model that corrects the tip of a connected arm: a fit of the readings replaces it, if it is no worse."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from truearm.arm import Arm
from truearm.compensation.models import Compensator
from truearm.compensation.models.model_file import save_model
from truearm.errors import InputError, TruearmError
from truearm.files.atomic_write import check_writable
from truearm.number_format import format_count
from truearm.readings import read_session
from truearm.workflows.fit_process import FitProcess, Fitted, why_worse
from truearm.workflows.recording_event import Event


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
        self._arm, self.model, self.trained_on = arm, model, 0
        self._readings, self._out = readings, out
        self._fit: FitProcess | None = None

    def refit(self, n_readings: int) -> Event:
        """Begin to fit a model to the readings, by the command ``refit``."""
        if self._fit is not None:
            return Event("refused", "a fit is under way")
        if self._arm is None:
            return Event("refused", "a fit needs the arm: start with --arm ARM")
        if not n_readings:
            return Event("refused", "there are no readings to fit")
        self._fit = FitProcess(self._arm, read_session(self._readings))
        return Event("notice", f"fitting {format_count(n_readings, 'reading')}; further ones are taken meanwhile")

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
            session = read_session(self._readings)
            if worse := why_worse(new, self.model, session, self.trained_on):
                return Event("refused", f"the fit is worse, {self._stays}: {worse}")
        self.model, self.trained_on = new.model, new.n_readings
        return Event("model", f"new model in force. {new.summary}", {"model": new.model.kind, "n": new.n_readings})

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
            save_model(self.model, self._out)
        except TruearmError as error:
            return Event("refused", str(error))
        return Event("notice", f"model in {self._out}", {"file": str(self._out)})

    def close(self) -> None:
        """End a fit that is under way."""
        if self._fit is not None:
            self._fit.stop()
            self._fit = None
