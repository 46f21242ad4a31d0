"""What the terms found on a UR10, and whether it repeats: series A of July 2020 beside series B of November 2020.

    python benchmarks/ur10_terms.py [--figure FILE.png]

Fits all of either series by itself, prints the tables of docs/ur10-terms.md and draws its figure. Data sets not at hand
are downloaded (`truearm.datasets`).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from machine import say_machine
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import PhysicalModel
from truearm.identification.estimation.diagnostics import JointError, effects, joint_error
from truearm.identification.judgement.outliers import outliers
from truearm.identification.references.reading_references import state_of
from truearm.identification.terms import GravityTorque
from truearm.pages.plotting import save_figure
from truearm.readings import Session
from truearm.show.joint_error_figure import joint_error_figure

ARCSEC = np.degrees(1.0) * 3600
SERIES = {"July 2020": "ur10-a", "November 2020": "ur10-b"}
TOLD_ARCSEC = 25.0  # curves are compared where both are known as well
LEAST_SHARED = 100  # of 2400 angles
LINES = (128, 256, 512)

Fitted = tuple[PhysicalModel, Session]


def fitted(name: str) -> Fitted:
    """The physical model of all readings of a set."""
    readings = datasets.load_readings(name)
    return PhysicalModel(load_arm("ur10")).fit_readings(readings), readings


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


def of_joints(series: dict[str, Fitted]) -> list[list[str]]:
    """For each joint: size in either series, and how alike they are where both know it."""
    rows = []
    for joint in range(1, 7):
        angles = shared(series, joint)
        alone = [curve(model, joint, r.angles[:, joint - 1]) for model, r in series.values()]
        sizes = [f"{found.rms * ARCSEC:.0f}" if found.is_significant else "-" for found in alone]
        if len(angles) < LEAST_SHARED:
            rows.append([f"J{joint}", *sizes, "-", "-", "-", "-"])
            continue
        both = [joint_error(model.fit_, joint, angles, mean_at=angles) for model, _ in series.values()]
        apart = (both[1].error - both[0].error) * ARCSEC
        expected = np.sqrt(np.mean([b.std**2 for b in both], axis=1).sum()) * ARCSEC
        alike = np.corrcoef(both[0].error, both[1].error)[0, 1]
        covered = np.degrees(np.diff(angles).min() * len(angles))
        rows.append(
            [
                f"J{joint}",
                *sizes,
                f"{covered:.0f}",
                f"{alike:.2f}",
                f"{np.sqrt((apart**2).mean()):.0f}",
                f"{expected:.0f}",
            ]
        )
    return rows


def of_lines(series: dict[str, Fitted]) -> list[list[str]]:
    """Amplitudes of single high orders with their standard uncertainties [arcsec]."""
    rows = []
    for joint in range(1, 7):
        cells = []
        for order in LINES:
            for model, _ in series.values():
                found = joint_error(model.fit_, joint, np.zeros(1), mean_at=np.zeros(1))
                (at,) = np.nonzero(found.orders == order)
                cells.append(
                    f"{found.amplitudes[at[0]] * ARCSEC:.1f} +- {found.amplitudes_std[at[0]] * ARCSEC:.1f}"
                    if len(at)
                    else "-"
                )
        rows.append([f"J{joint}", *cells])
    return rows


def of_groups(series: dict[str, Fitted]) -> list[list[str]]:
    """For each group of terms and series: determined, size of the motions, what they do to the tip."""
    found = []
    for model, readings in series.values():
        state = state_of(model.arm, readings)
        found.append({effect.group: effect for effect in effects(model.fit_, state)})
    rows = []
    for group in dict.fromkeys(name for one in found for name in one):
        cells = []
        for effect in (one.get(group) for one in found):
            if effect is None or effect.determined < 0.5:
                cells += ["-", "-", "-"]
                continue
            turning, shifting, tip = effect.rotation_rad, effect.shift_mm, effect.tip_mm
            size = f"{turning * ARCSEC:.1f} arcsec" if turning is not None else ""
            size = f"{shifting:.4f} mm" if shifting is not None else size
            cells += [f"{effect.determined:.0f} of {effect.offered}", size, "-" if tip is None else f"{tip:.3f}"]
        rows.append([group, *cells])
    return rows


def of_drives(series: dict[str, Fitted]) -> list[list[str]]:
    """For each joint: the give of its drive over all readings, from least to most torque [arcsec]."""
    rows = []
    for joint in range(1, 7):
        cells = []
        for model, readings in series.values():
            state, start, cell = state_of(model.arm, readings), 0, "-"
            for term in model.fit_.perturbed_chain.terms:
                own = term.direction == (0, 0, 1, 0, 0, 0) and term.basis == GravityTorque(joint, 2)
                if own and term.place == joint:
                    coefficient = model.fit_.coefficients[start] * ARCSEC
                    std = np.sqrt(model.fit_.covariance[start, start]) * ARCSEC
                    span = float(np.ptp(term.basis.values(state)))
                    cell = (
                        f"{coefficient * span:.0f} +- {std * span:.0f} ({coefficient:.1f})"
                        if coefficient > 3 * std
                        else "-"
                    )
                start += term.n_coefficients
            cells.append(cell)
        rows.append([f"J{joint}", *cells])
    return rows


def figure(series: dict[str, Fitted], path: Path) -> None:
    """Draw both series' joint errors on each other."""
    angles = np.concatenate([readings.angles for _, readings in series.values()])
    errors: dict[str, list[JointError]] = {name: [] for name in series}
    for joint in range(1, 7):
        both = shared(series, joint)
        for name, (model, readings) in series.items():
            errors[name].append(
                curve(model, joint, both if len(both) >= LEAST_SHARED else readings.angles[:, joint - 1])
            )
    save_figure(joint_error_figure(errors, angles, names=[f"J{i}" for i in range(1, 7)]), path, dpi=110)


def main() -> None:
    """Fit, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figure", type=Path, help="PNG file to draw to")
    options = parser.parse_args()
    say_machine()
    tell({name: fitted(data_set) for name, data_set in SERIES.items()}, options.figure)


def tell(series: dict[str, Fitted], path: Path | None) -> None:
    """Print the tables and draw the figure."""
    for name, (model, readings) in series.items():
        held = model.held_out_
        print(
            f"{name}: {len(readings)} readings, {model.fit_seconds_:.1f} s, held out {held.mean_mm:.4f} mm +- "
            f"{held.standard_error_mm:.4f}, unexplained {model.residual_std_:.4f} mm, "
            f"{len(outliers(model.fit_))} readings far off, settled: {model.fit_.converged}"
        )
    names = list(series)
    tables: dict[str, tuple[list[str], list[list[str]]]] = {
        "Groups of terms": (
            ["group of terms", *(f"{n}, {what}" for n in names for what in ("determined", "size", "at the tip [mm]"))],
            of_groups(series),
        ),
        "Errors of the joints [arcsec]": (
            ["joint", *(f"{name}, rms" for name in names), "shared [deg]", "correlation", "apart, rms", "expected"],
            of_joints(series),
        ),
        "Single orders [arcsec]": (
            ["joint", *(f"{order}, {name}" for order in LINES for name in names)],
            of_lines(series),
        ),
        "Give of the drives, from least to most torque [arcsec], and by N m of links of 1 kg/m": (
            ["joint", *names],
            of_drives(series),
        ),
    }
    for title, (heads, rows) in tables.items():
        print(f"\n{title}\n")
        for row in (heads, ["---"] * len(heads), *rows):
            print(f"| {' | '.join(cell or '-' for cell in row)} |")
    if path is not None:
        figure(series, path)


if __name__ == "__main__":
    main()
