"""A fit of the readings so far, in a process of its own, and whether its model replaces the one in force."""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from truearm.arm import Arm
from truearm.compensation.models import Compensator, load_model
from truearm.errors import InputError, ProgramFault, TruearmError
from truearm.readings import Session
from truearm.readings.anchors import LEAST_COMPARED
from truearm.workflows.evaluate import evaluate
from truearm.workflows.fit import fit


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model that may replace the one in force.

    Attributes
    ----------
    model : Compensator
    summary : str
        Its mean error on held-out readings, in a sentence.
    """

    model: Compensator
    summary: str


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
                kind, text = self._said.recv()
                if kind == "step":
                    yield str(text)
                    continue
                if kind == "done":
                    yield Fitted(load_model(self._file), str(text))
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
            said.send(("step", note))

    try:
        result = fit(arm, session, progress=report)
        result.save(file)
    except (TruearmError, ProgramFault) as error:
        said.send(("failed", str(error)))
    else:
        said.send(("done", result.summary()))


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
