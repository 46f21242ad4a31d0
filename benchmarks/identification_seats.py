"""Rows of `identification.py` on arms whose ball was held in sockets: tool positions left out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from identification_row import Row
from machine import Target
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel, NominalModel, PhysicalModel
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.identification.references.reading_references import state_of
from truearm.readings import Session
from truearm.readings.lengths import Lengths
from truearm.readings.seats import length_errors, seat_errors
from truearm.typing import FloatArray, NameArray

MODELS = {"nominal": NominalModel, "kinematic": KinematicModel, "physical": PhysicalModel}


@dataclass(frozen=True, eq=False)
class Position:
    """A tool position that no model learned from.

    Attributes
    ----------
    name : str
    n : int
        Readings in its two seats.
    drawn : dict of str to float
        Figures of the arm as drawn, nothing fitted.
    figures : dict of str to dict of str to float
        By the name of the model: mean, rms and max distance to the seat's mean, and the sockets' distance [mm].
    squares : (n,) array
        Squared Mahalanobis lengths of the deviations from the seat's mean under the physical model.
    """

    name: str
    n: int
    drawn: dict[str, float]
    figures: dict[str, dict[str, float]]
    squares: FloatArray


def figures_of(points: FloatArray, seat: NameArray, lengths: Lengths) -> dict[str, float]:
    """Distances of points to the mean of their seat, and between the means [mm]."""
    errors = seat_errors(points, seat)
    here = lengths.between(np.unique(seat).tolist())
    return {
        "mean_mm": errors["seat_mean_mm"],
        "rms_mm": errors["seat_rms_mm"],
        "max_mm": errors["seat_max_mm"],
        "sockets_mm": float((here.length_mm + length_errors(points, seat, here))[0]),
    }


@cache
def left_out(robot: str, train: tuple[str, ...], test: tuple[str, ...]) -> list[Position]:
    """Fit all models to some tool positions and look at others."""
    name = f"mukca-{robot}"
    readings, lengths, arm = (
        datasets.load_readings(name),
        datasets.load_lengths(name),
        load_arm(datasets.DATASETS[name].arm),
    )
    assert readings.position is not None
    assert lengths is not None
    learned = readings.rows(np.isin(readings.position, [f"{robot}/{position}" for position in train]))
    models = {label: kind(arm).fit_readings(learned, lengths=lengths) for label, kind in MODELS.items()}
    found = []
    for position in test:
        part = readings.rows(readings.position == f"{robot}/{position}")
        assert part.seat is not None
        figures = {
            label: figures_of(model.predict_readings(part), part.seat, lengths) for label, model in models.items()
        }
        drawn = figures_of(arm.chain.tip_in_base(part.angles), part.seat, lengths)
        found.append(Position(position, len(part), drawn, figures, squared_in_seats(models["physical"], part)))
    return found


def squared_in_seats(model: IdentifiedModel, readings: Session) -> FloatArray:
    """Squared Mahalanobis lengths of deviations from the means of seats, (m,).

    The mean of a seat takes its share of every reading's uncertainty along: the parameters' part is that of the
    deviation itself, what the model cannot explain counts by 1 - 1/n.
    """
    fit = model.fit_
    state = state_of(model.arm_, readings)
    parts = list(fit.perturbed_chain.derivatives(state, fit.coefficients))
    tips = np.concatenate([tips for _, tips, _ in parts], axis=1)
    columns = np.concatenate([columns for _, _, columns in parts], axis=2)
    squares = np.empty(len(readings))
    assert readings.seat is not None
    for seat in np.unique(readings.seat):
        rows = np.flatnonzero(readings.seat == seat)
        deviations = tips[:, rows] - tips[:, rows].mean(axis=1, keepdims=True)
        by = columns[:, :, rows] - columns[:, :, rows].mean(axis=2, keepdims=True)
        spread = (fit.covariance @ by.reshape(len(by), -1)).reshape(by.shape)
        covariance = np.einsum("pin,pjn->nij", by, spread)
        covariance += (1 - 1 / len(rows)) * model.residual_std_**2 * np.eye(3)
        squares[rows] = np.einsum("in,ni->n", deviations, np.linalg.solve(covariance, deviations.T[:, :, None])[..., 0])
    return squares


def tool_positions(robot: str) -> tuple[str, ...]:
    """The tool positions of a robot."""
    readings = datasets.load_readings(f"mukca-{robot}")
    assert readings.position is not None
    return tuple(name.rpartition("/")[2] for name in np.unique(readings.position).tolist())


def each_left_out(robot: str) -> list[Position]:
    """Every tool position as the others predict it."""
    names = tool_positions(robot)
    return [left_out(robot, tuple(n for n in names if n != name), (name,))[0] for name in names]


def row_of(title: str, positions: list[Position], targets: list[Target]) -> Row:
    """A table of tool positions, its targets and two on every position: no worse than nominal."""
    columns = ["position", "readings", "as drawn", *MODELS, "sockets [mm]"]
    cells = [
        [
            p.name,
            str(p.n),
            f"{p.drawn['mean_mm']:.2f}",
            *(
                f"{p.figures[m]['mean_mm']:.3f} {p.figures[m]['rms_mm']:.3f} {p.figures[m]['max_mm']:.3f}"
                for m in MODELS
            ),
            f"{p.figures['physical']['sockets_mm']:.2f}",
        ]
        for p in positions
    ]
    worst = max(p.figures["physical"]["mean_mm"] / p.figures["nominal"]["mean_mm"] for p in positions)
    found: dict[str, Any] = {p.name: {"as drawn": p.drawn, **p.figures} for p in positions}
    targets = [*targets, Target("mean over nominal's, the worst position", worst, 1.0)]
    note = "Distances to the mean of the seat: mean rms max [mm]; as drawn: mean. Nominal: the tip fitted."
    return Row(title, columns, cells, targets, found, [note])


def means_of(positions: list[Position]) -> list[float]:
    """Mean distance to the seat's mean at every position under the physical model [mm]."""
    return [p.figures["physical"]["mean_mm"] for p in positions]


def panda_1(seeds: int) -> Row:
    """Franka: one tool position to learn from, two to test on."""
    del seeds
    positions = left_out("panda_1", ("front",), ("right", "back-high"))
    targets = [
        *(
            Target(f"panda_1, {p.name}: mean [mm]", m, 0.35)
            for p, m in zip(positions, means_of(positions), strict=True)
        ),
        *(
            Target(f"panda_1, {p.name}: sockets off 50 mm [mm]", abs(p.figures["physical"]["sockets_mm"] - 50), 0.3)
            for p in positions
        ),
    ]
    return row_of("Franka panda_1, learned in front (two seats, one length)", positions, targets)


def panda_2(seeds: int) -> Row:
    """Franka: every tool position left out."""
    del seeds
    positions = each_left_out("panda_2")
    means = means_of(positions)
    targets = [
        Target("panda_2: mean, the median position [mm]", float(np.median(means)), 0.22),
        Target("panda_2: mean, the worst position [mm]", max(means), 0.7),
    ]
    return row_of("Franka panda_2, every tool position left out", positions, targets)


def panda_3(seeds: int) -> Row:
    """Franka: every tool position left out."""
    del seeds
    positions = each_left_out("panda_3")
    targets = [Target("panda_3: mean, the worst position [mm]", max(means_of(positions)), 0.28)]
    return row_of("Franka panda_3, every tool position left out", positions, targets)


def dinova_1(seeds: int) -> Row:
    """Kinova Gen3 lite: every tool position left out."""
    del seeds
    return row_of("Kinova Gen3 lite dinova_1, every tool position left out", each_left_out("dinova_1"), [])
