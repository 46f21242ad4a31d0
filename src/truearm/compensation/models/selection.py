"""Model selection: the simplest model whose error on readings held out is within a standard error of the least."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from truearm.arm.arm import Arm
from truearm.compensation.models.identified_model import (
    IdentifiedModel,
    KinematicModel,
    NominalModel,
    PhysicalModel,
)
from truearm.errors import InputError
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session

# The simplest first.
CANDIDATES: dict[str, type[IdentifiedModel]] = {
    "nominal": NominalModel,
    "kinematic": KinematicModel,
    "physical": PhysicalModel,
}


@dataclass(frozen=True)
class ModelScore:
    """Errors of a model on readings held out.

    Attributes
    ----------
    name : str
    mean_mm, standard_error_mm : float
        Mean error of readings held out with their position or seat, and its standard error.
    p95_mm, max_mm : float
    n_effective : float
        Parameters that the readings determine.
    kept : bool
        Whether the model was selected.
    """

    name: str
    mean_mm: float
    standard_error_mm: float
    p95_mm: float
    max_mm: float
    n_effective: float
    kept: bool


def select_model(
    arm: Arm,
    readings: Session,
    *,
    free: tuple[str, ...] = ("base", "tip"),
    lengths: Lengths | None = None,
    progress: Callable[[int, str], None] | None = None,
    nominal: NominalModel | None = None,
) -> tuple[IdentifiedModel, tuple[ModelScore, ...]]:
    """Fit the nominal, the kinematic and the physical model and keep one.

    One standard error rule (L. Breiman and others, "Classification and Regression Trees", 1984, section 3.4.3): the
    simplest model is kept whose mean error on readings held out lies within one standard error of the least.

    Parameters
    ----------
    arm : Arm
    readings : Session
        With reference points, seats, or both.
    free : tuple of str
        See the models.
    lengths : Lengths, optional
        Known lengths between seats.
    progress : callable, optional
        Called with the steps done and a note.
    nominal : NominalModel, optional
        The first of the three, if it is already fitted to these readings with these options.

    Returns
    -------
    model : IdentifiedModel
        Fitted to all readings.
    table : tuple of ModelScore
        All candidates, the simplest first.

    Raises
    ------
    InputError
        As `fit_readings`; also if no readings can be held out.
    """
    models: dict[str, IdentifiedModel] = {} if nominal is None else {"nominal": nominal}
    for number, (name, kind) in enumerate(CANDIDATES.items()):
        if name in models:
            continue

        def report(_: int, note: str, number: int = number, name: str = name) -> None:
            if progress is not None:
                progress(number, f"{name}: {note}")

        model = kind(arm, free=free)
        models[name] = model.fit_readings(readings, lengths=lengths, progress=report, nominal=models.get("nominal"))
        if not len(models[name].held_out_.rows):
            raise InputError(
                "expected readings with points, or seats of two readings or more: models are compared on points of "
                "readings held out",
                file=readings.file,
                hint="name the model: --model kinematic, or --model physical",
            )
    held_out = {name: model.held_out_ for name, model in models.items()}
    best = min(held_out, key=lambda name: held_out[name].mean_mm)
    most = held_out[best].mean_mm + held_out[best].standard_error_mm
    kept = next(name for name in models if held_out[name].mean_mm <= most)
    table = tuple(
        ModelScore(
            name,
            part.mean_mm,
            part.standard_error_mm,
            float(np.quantile(part.errors_mm, 0.95)),
            float(part.errors_mm.max()),
            sum(group.effective for group in models[name].fit_.groups),
            name == kept,
        )
        for name, part in held_out.items()
    )
    return models[kept], table
