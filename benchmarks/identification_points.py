"""Rows of `identification.py` on arms that a laser tracker measured: held-out errors, outliers, coverage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.stats import chi2

from identification_row import Row, over_splits, three_figures, told
from machine import Target
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel, NominalModel, PhysicalModel
from truearm.readings import Session, hold_out
from truearm.typing import BoolArray, FloatArray, IntArray

SPLITS = {"ur10-a": "position", "ur10-b": "position", "ur5": "row", "wam": "row"}
MODELS = {"nominal": NominalModel, "kinematic": KinematicModel, "physical": PhysicalModel}
HELD_OUT = 0.3
# A held-out reading is an outlier where its squared Mahalanobis length, by the uncertainty that the model states and
# that of the reference, is one that a Gaussian reading passes once in a thousand million (6.7 standard deviations).
OUTLIER = float(chi2.isf(1e-9, 3))
LEVEL = float(chi2.ppf(0.95, 3))
QUARTERS = 4
# Line of a set's first reading in its file.
FIRST_LINE = 2


@dataclass(frozen=True, eq=False)
class Seen:
    """Held-out readings as one model sees them.

    Attributes
    ----------
    points : (m, 3) array
        Predicted [mm].
    squares : (m,) array
        Squared Mahalanobis lengths of their deviations.
    seconds : float
        That the fit took.
    """

    points: FloatArray
    squares: FloatArray
    seconds: float


@dataclass(frozen=True, eq=False)
class Split:
    """A split of a set, and its held-out readings under every model.

    Attributes
    ----------
    test : Session
        Held out; `session` is each reading's number in the set, from 0.
    seen : dict of str to Seen
        By the name of the model.
    ring : (m,) int array
        Quarter by the distance of the angles from their training mean, in units of every joint's spread.
    quadrant : (m,) int array
        Quarter by the sides of the training medians on which joints 2 and 3 are.
    """

    test: Session
    seen: dict[str, Seen]
    ring: IntArray
    quadrant: IntArray


@cache
def split_of(name: str, seed: int) -> Split:
    """Fit all models to what one split trains on, once."""
    readings = datasets.load_readings(name)
    arm = load_arm(datasets.DATASETS[name].arm)
    numbered = replace(readings, session=np.arange(len(readings)).astype(np.str_))
    train, test = hold_out(numbered, by=SPLITS[name], fraction=HELD_OUT, seed=seed)  # type: ignore[arg-type]
    seen = {}
    for label, kind in MODELS.items():
        model = kind(arm).fit_readings(replace(train, session=None))
        points, covariance = model.predict_readings(test, return_cov=True)
        seen[label] = Seen(points, squared_lengths(points, covariance, test), model.fit_seconds_)
    return Split(test, seen, *quarters(train.angles, test.angles))


def squared_lengths(points: FloatArray, covariance: FloatArray, test: Session) -> FloatArray:
    """Squared Mahalanobis lengths (m,) of predicted points, the reference's own uncertainty with them."""
    assert test.points is not None
    if test.point_std is not None:
        covariance = covariance + test.point_std[:, :, None] ** 2 * np.eye(3)
    deviations = points - test.points
    return np.einsum("ni,ni->n", deviations, np.linalg.solve(covariance, deviations[:, :, None])[:, :, 0])


def quarters(train: FloatArray, test: FloatArray) -> tuple[IntArray, IntArray]:
    """Give the quarters of the joint space that test poses are in: by distance from the middle, by joints 2 and 3."""
    away = np.linalg.norm((test - train.mean(axis=0)) / train.std(axis=0), axis=1)
    ring = np.searchsorted(np.quantile(away, [0.25, 0.5, 0.75]), away)
    above = test[:, 1:3] > np.median(train[:, 1:3], axis=0)
    return ring.astype(np.intp), (2 * above[:, 0] + above[:, 1]).astype(np.intp)


def held_out(name: str, title: str, limits: dict[str, float], seeds: int) -> Row:
    """Errors on what the splits hold out, of the three models; `limits` of the physical model's figures."""
    splits = [split_of(name, seed) for seed in range(seeds)]
    figures = {
        label: over_splits([three_figures(split.seen[label].points, _points(split.test)) for split in splits])
        for label in MODELS
    }
    seconds = {label: float(np.median([split.seen[label].seconds for split in splits])) for label in MODELS}
    cells = [[label, told(figures[label]), f"{seconds[label]:.1f}"] for label in MODELS]
    targets = [
        Target(f"{name}: {figure.removesuffix('_mm')} of held-out errors [mm]", figures["physical"][figure], limit)
        for figure, limit in limits.items()
    ]
    return Row(
        f"{title}, {HELD_OUT:.0%} held out by {SPLITS[name]}, {seeds} splits (max: largest of all)",
        ["model", "mean / p95 / max [mm]", "fit [s]"],
        cells,
        targets,
        {"figures": figures, "fit_seconds": seconds},
    )


def ur10_b(seeds: int) -> Row:
    """UR10, series B."""
    row = held_out("ur10-b", "UR10 series B", {"mean_mm": 0.080, "p95_mm": 0.17, "max_mm": 0.45}, seeds)
    return with_outliers_named(row, "ur10-b", {"mean": 0.080, "max": 0.45}, seeds)


def ur10_a(seeds: int) -> Row:
    """UR10, series A: bad readings are named, and the others judged."""
    row = held_out("ur10-a", "UR10 series A", {"mean_mm": 0.075, "p95_mm": 0.15}, seeds)
    return with_outliers_named(row, "ur10-a", {"max": 0.6}, seeds)


def with_outliers_named(row: Row, name: str, limits: dict[str, float], seeds: int) -> Row:
    """Add to a row the held-out readings that the physical model's uncertainty rules out, and the errors of the rest.

    `limits` are of their `mean` over all splits and of the largest, `max` [mm].
    """
    bad: dict[int, float] = {}
    means, largest = [], []
    for split in (split_of(name, seed) for seed in range(seeds)):
        seen = split.seen["physical"]
        errors = np.linalg.norm(seen.points - _points(split.test), axis=1)
        is_bad = seen.squares > OUTLIER
        bad |= {int(_numbers(split.test)[i]): float(errors[i]) for i in np.flatnonzero(is_bad)}
        means.append(float(errors[~is_bad].mean()))
        largest.append(float(errors[~is_bad].max()))
    rest = {"mean": float(np.mean(means)), "max": max(largest)}
    rule = (
        f"Outliers are held-out readings whose squared Mahalanobis length is beyond {OUTLIER:.1f} (chi-squared of 3"
        " degrees of freedom, probability 1e-9 for a Gaussian reading), by the model's stated uncertainty alone."
    )
    named = ", ".join(f"{i + FIRST_LINE} ({bad[i]:.2f})" for i in sorted(bad))
    list_of_them = (
        f"{len(bad)} of {len(datasets.load_readings(name))} readings were named in one split or more, by line of the"
        f" file (error [mm]): {named}"
    )
    of_rest = f"Of the others the mean is {rest['mean']:.4f}, the largest {rest['max']:.3f} mm."
    return replace(
        row,
        targets=[
            *row.targets,
            *(Target(f"{name}: {what} of those not named outliers [mm]", rest[what], limits[what]) for what in limits),
        ],
        found=row.found | {"outliers": bad, "of_the_rest_mm": rest},
        notes=[rule, list_of_them, of_rest],
    )


def ur5(seeds: int) -> Row:
    """UR5 on a grid."""
    return held_out("ur5", "UR5 grid", {"mean_mm": 0.052, "max_mm": 0.20}, seeds)


def wam(seeds: int) -> Row:
    """Barrett WAM on a grid."""
    return held_out("wam", "Barrett WAM grid", {"mean_mm": 2.3}, seeds)


def coverage(seeds: int) -> Row:
    """Shares of held-out points in the 95 % ellipsoids of the physical model, on every set with points."""
    cells, targets, found = [], [], {}
    for name in SPLITS:
        splits = [split_of(name, seed) for seed in range(seeds)]
        inside = np.concatenate([split.seen["physical"].squares <= LEVEL for split in splits])
        ring = np.concatenate([split.ring for split in splits])
        quadrant = np.concatenate([split.quadrant for split in splits])
        shares = shares_of(inside, ring, quadrant)
        found[name] = shares | {"points": len(inside)}
        cells.append([name, str(len(inside)), *covered_cells(shares)])
        targets += covered_targets(name, shares)
    quarters_are = (
        "Rings: quarters of the test poses by the distance of their angles from the training mean, in units of every"
        " joint's spread, the inner one first. Quadrants: joints 2 and 3 below or above their training medians."
    )
    pooled = (
        f"Pooled over {seeds} splits. Of m independent points a share of 95 % has a standard error of"
        " 22 % / sqrt(m): 1 % of 475, 2.5 % of 76."
    )
    title = "Points held out inside the 95 % ellipsoids of the physical model [%]"
    return Row(title, ["set", "points", "all", "rings", "quadrants"], cells, targets, found, [quarters_are, pooled])


def shares_of(inside: BoolArray, ring: IntArray, quadrant: IntArray) -> dict[str, Any]:
    """Shares of points inside [%]: of all, and by quarter."""

    def by(quarter: IntArray) -> list[float | None]:
        return [100 * float(inside[quarter == k].mean()) if (quarter == k).any() else None for k in range(QUARTERS)]

    return {"all": 100 * float(inside.mean()), "rings": by(ring), "quadrants": by(quadrant)}


def covered_cells(shares: dict[str, Any]) -> list[str]:
    """Write the shares of all points, of the rings and of the quadrants."""
    by = (" ".join("-" if s is None else f"{s:.1f}" for s in shares[name]) for name in ("rings", "quadrants"))
    return [f"{shares['all']:.1f}", *by]


def covered_targets(name: str, shares: dict[str, Any]) -> list[Target]:
    """93 to 97 % of all points, and of every quarter."""
    parts = [s for by in ("rings", "quadrants") for s in shares[by] if s is not None]
    return [
        Target(f"{name}: inside, all, less [%]", shares["all"], 93, good="above"),
        Target(f"{name}: inside, all, more [%]", shares["all"], 97),
        Target(f"{name}: inside, the emptiest quarter [%]", min(parts), 93, good="above"),
        Target(f"{name}: inside, the fullest quarter [%]", max(parts), 97),
    ]


def _points(readings: Session) -> FloatArray:
    assert readings.points is not None
    return readings.points


def _numbers(readings: Session) -> IntArray:
    """Numbers of the readings in their set, from 0."""
    assert readings.session is not None
    return readings.session.astype(np.intp)
