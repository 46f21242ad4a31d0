"""Row of `identification.py` on session transfer: the UR10 of series A in the set-up of series B."""

from __future__ import annotations

from functools import cache

import numpy as np

from identification_row import Row, over_splits, three_figures, told
from machine import Target
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel, PhysicalModel
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.compensation.models.refit import refit
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray

ROWS = 20
MODELS: dict[str, type[IdentifiedModel]] = {"geometry alone": KinematicModel, "physical": PhysicalModel}
# Readings of B whose point was taken at another pose: the publisher's file repeats a neighbour's point, to the last
# digit in the first of them, with the elbow on the other side (lines 534, 856 and 857).
MISPAIRED = (532, 854, 855)


@cache
def of_series_a(label: str) -> IdentifiedModel:
    """Fit a model to all of series A."""
    model = MODELS[label](load_arm("ur10"))
    model.fit_readings(datasets.load_readings("ur10-a"))
    return model


def transfer(seeds: int) -> Row:
    """Learn from series A, refit base and tip on a few rows of B, test on the others of B."""
    b = datasets.load_readings("ur10-b")
    good = b.rows(np.setdiff1d(np.arange(len(b)), MISPAIRED))
    figures: dict[str, dict[str, list[dict[str, float]]]] = {label: {} for label in MODELS}
    shares = []
    for seed in range(seeds):
        chosen = np.random.default_rng(seed).permutation(len(good))
        few, rest = good.rows(np.sort(chosen[:ROWS])), good.rows(np.sort(chosen[ROWS:]))
        away = of_series_a("physical").outside_training(rest.angles)
        shares.append(float(away.mean()))
        for label in MODELS:
            points = refit(of_series_a(label), few).predict(rest.angles)
            for where, rows in parts(away).items():
                figures[label].setdefault(where, []).append(three_figures(points[rows], points_of(rest)[rows]))
    means = {label: {where: over_splits(each) for where, each in parts.items()} for label, parts in figures.items()}
    cells = [[where, *(told(means[label][where]) for label in MODELS)] for where in parts(np.zeros(0, dtype=bool))]
    near, far = "where A has readings", "all other rows, flagged"
    ratios = {name: means["physical"][far][name] / means["geometry alone"][far][name] for name in ("mean_mm", "p95_mm")}
    targets = [
        Target("A to B, where A has readings: mean [mm]", means["physical"][near]["mean_mm"], 0.20),
        Target("A to B, all other rows: mean over that of geometry alone", ratios["mean_mm"], 1.0),
        Target("A to B, all other rows: p95 over that of geometry alone", ratios["p95_mm"], 1.0),
    ]
    draws = (
        f"{ROWS} random rows of B, {seeds} draws, mean / p95 / max [mm] (max: largest of all). Flagged by the model"
        f" itself: a joint away from where A has readings, {np.mean(shares):.0%} of the rows."
    )
    without = "Left out: lines 534, 856 and 857 of B, whose points were taken at a neighbouring pose."
    found = {"means": means, "flagged_share": shares}
    return Row(
        "UR10: learned from series A, base and tip refitted in B",
        ["rows", *MODELS],
        cells,
        targets,
        found,
        [draws, without],
    )


def parts(away: BoolArray) -> dict[str, BoolArray]:
    """The rows to judge apart."""
    return {"all": np.ones_like(away), "where A has readings": ~away, "all other rows, flagged": away}


def points_of(readings: Session) -> FloatArray:
    """Reference points of readings that all have one [mm]."""
    assert readings.points is not None
    return readings.points
