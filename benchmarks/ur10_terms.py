"""What the terms found on a UR10, and whether it repeats: series A of July 2020 beside series B of November 2020.

Fits all of either series by itself, and draws the figure of docs/benchmarks.md.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.held_out import MODELS
from benchmarks.rows import RowResult, Rows
from truearm.arm import load_arm
from truearm.identification.judgement.outliers import outliers
from truearm.identification.references.reading_references import state_of
from truearm.identification.terms import GravityTorque
from truearm.models import PhysicalModel
from truearm.readings import Session
from truearm.wings.importing import datasets
from truearm.wings.reports.identification_sections import joint_error_figure
from truearm.wings.reports.term_effects import JointError, effects, joint_error

ROWS = Rows()
ARCSEC = np.degrees(1.0) * 3600
SERIES = {"July 2020": "ur10-a", "November 2020": "ur10-b"}
TOLD_ARCSEC = 25.0  # curves are compared where both are known as well
LEAST_SHARED = 100  # of 2400 angles
LINES = (128, 256, 512)
Fitted = tuple[PhysicalModel, Session]


@cache
def series() -> dict[str, Fitted]:
    """The physical models of all readings of the series, with the readings."""
    sets = {name: datasets.load_readings(data_set) for name, data_set in SERIES.items()}
    return {name: (PhysicalModel(load_arm("ur10")).fit_readings(each), each) for name, each in sets.items()}


@ROWS.row("fits")
def fits() -> RowResult:
    """Mean errors of held-out readings, by position [mm]."""
    table = []
    for name, (model, readings) in series().items():
        held = model.held_out_
        simpler = {label: MODELS[label](load_arm("ur10")).fit_readings(readings) for label in ("nominal", "kinematic")}
        table.append({
            "series": name,
            "readings": len(readings),
            "nominal arm [mm]": simpler["nominal"].held_out_.mean_mm,
            "all constants [mm]": simpler["kinematic"].held_out_.mean_mm,
            "all terms [mm]": held.mean_mm,
            "standard error [mm]": held.standard_error_mm,
            "residual standard deviation [mm]": model.residual_std_,
            "outliers": len(outliers(model.fit_)),
        })  # fmt: skip
    return RowResult(table)


def curve(model: PhysicalModel, joint: int, mean_at: np.ndarray, n: int = 2400) -> JointError:
    """A joint's error over the angles the model learned from."""
    return joint_error(model.fit_, joint, np.linspace(*model.angle_ranges_[joint - 1], n), mean_at=mean_at)


def shared(series: dict[str, Fitted], joint: int) -> np.ndarray:
    """Angles at which both series know a joint's error [rad]."""
    (first, at_first), (second, at_second) = series.values()
    low = max(model.angle_ranges_[joint - 1, 0] for model in (first, second))
    high = min(model.angle_ranges_[joint - 1, 1] for model in (first, second))
    angles = np.linspace(low, high, 2400)
    known = np.ones(len(angles), dtype=bool)
    for model, readings in ((first, at_first), (second, at_second)):
        found = joint_error(model.fit_, joint, angles, mean_at=readings.angles[:, joint - 1])
        known &= found.std * ARCSEC < TOLD_ARCSEC
    return angles[known]


@ROWS.row("joints")
def of_joints(figure: str | None = None) -> RowResult:
    """Errors of the joints [arcsec]: size in either series, and how alike they are where both know it."""
    table = []
    for joint in range(1, 7):
        angles = shared(series(), joint)
        row: dict[str, Any] = {"joint": f"J{joint}"}
        for name, (model, readings) in series().items():
            found = curve(model, joint, readings.angles[:, joint - 1])
            row[f"rms {name} [arcsec]"] = round(found.rms * ARCSEC) if found.is_significant else None
        if len(angles) >= LEAST_SHARED:
            both = [joint_error(model.fit_, joint, angles, mean_at=angles) for model, _ in series().values()]
            apart = (both[1].error - both[0].error) * ARCSEC
            row["both determine it over [deg]"] = round(np.degrees(np.diff(angles).min() * len(angles)))
            row["correlation"] = round(np.corrcoef(both[0].error, both[1].error)[0, 1], 2)
            row["rms difference [arcsec]"] = round(np.sqrt((apart**2).mean()))
            row["expected rms [arcsec]"] = round(np.sqrt(np.mean([b.std**2 for b in both], axis=1).sum()) * ARCSEC)
        table.append(row)
    if figure:
        draw(series(), Path(figure))
    return RowResult(table)


@ROWS.row("orders")
def of_orders() -> RowResult:
    """Amplitudes of single high orders with their standard uncertainties [arcsec]."""
    table = []
    for joint in range(1, 7):
        row: dict[str, Any] = {"joint": f"J{joint}"}
        for order in LINES:
            for name, (model, _) in series().items():
                found = joint_error(model.fit_, joint, np.zeros(1), mean_at=np.zeros(1))
                at = np.flatnonzero(found.orders == order)[:1]
                each = zip(found.amplitudes[at] * ARCSEC, found.amplitudes_std[at] * ARCSEC, strict=True)
                row[f"{order}, {name}"] = next((f"{size:.1f} +- {std:.1f}" for size, std in each), "-")
        table.append(row)
    return RowResult(table)


@ROWS.row("groups")
def of_groups() -> RowResult:
    """Groups of terms that move the tip: coefficients determined, and what they do to the tip [mm, rms]."""
    table: dict[str, dict[str, Any]] = {}
    for name, (model, readings) in series().items():
        for effect in effects(model.fit_, state_of(model.arm, readings)):
            if effect.determined < 0.5 or effect.tip_mm is None:
                continue
            row = table.setdefault(effect.group, {"group of terms": effect.group})
            row[f"determined {name}"] = f"{effect.determined:.0f} of {effect.offered}"
            row[f"at the tip {name} [mm]"] = round(effect.tip_mm, 3)
    return RowResult(list(table.values()))


@ROWS.row("drives")
def of_drives() -> RowResult:
    """Give of the drives, from least to most torque [arcsec], in brackets by N m of links of 1 kg/m."""
    table = []
    for joint in range(1, 7):
        row: dict[str, Any] = {"joint": f"J{joint}"}
        for name, (model, readings) in series().items():
            state, start = state_of(model.arm, readings), 0
            for term in model.fit_.perturbed_chain.terms:
                own = term.direction == (0, 0, 1, 0, 0, 0) and term.basis == GravityTorque(joint, 2)
                if own and term.place == joint:
                    coefficient = model.fit_.coefficients[start] * ARCSEC
                    std = np.sqrt(model.fit_.covariance[start, start]) * ARCSEC
                    span = float(np.ptp(term.basis.values(state)))
                    if coefficient > 3 * std:
                        row[name] = f"{coefficient * span:.0f} +- {std * span:.0f} ({coefficient:.1f})"
                start += term.n_coefficients
        table.append(row)
    return RowResult(table)


def draw(series: dict[str, Fitted], path: Path) -> None:
    """Draw both series' joint errors on each other."""
    angles = np.concatenate([readings.angles for _, readings in series.values()])
    errors: dict[str, list[JointError]] = {name: [] for name in series}
    for joint in range(1, 7):
        both = shared(series, joint)
        for name, (model, readings) in series.items():
            errors[name].append(
                curve(model, joint, both if len(both) >= LEAST_SHARED else readings.angles[:, joint - 1])
            )
    joint_error_figure(errors, angles, names=[f"J{i}" for i in range(1, 7)]).save(path, dpi=110)
