"""Is the stated uncertainty right where nothing was learned? A UR10, learned from half the range of a joint.

    python benchmarks/away_from_training.py [--json]

The readings of series B with joint 1 (joint 4) below its median teach, those above it test; and the other way round.
15 % of the goal positions are held out of the teaching half, to compare with.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2

from machine import options_of, print_json, print_table, say_machine
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel, NominalModel, PhysicalModel
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.readings import Session, hold_out

MODELS: dict[str, type[IdentifiedModel]] = {
    "nominal": NominalModel,
    "kinematic": KinematicModel,
    "physical": PhysicalModel,
}
JOINTS = (1, 4)
Figures = dict[str, float]


def figures(model: IdentifiedModel, test: Session) -> Figures:
    """Mean error [mm], median standard uncertainty of a coordinate [mm], share in the 95 % ellipsoids."""
    points, covariance = model.predict_readings(test, return_cov=True)
    off = points - test.points
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return {
        "mean_mm": float(np.linalg.norm(off, axis=1).mean()),
        "std_mm": float(np.median(std)),
        "in_95_percent": float((squares < chi2.ppf(0.95, 3)).mean()),
        "flagged": float(model.outside_training(test.angles).mean()),
    }


def halves(readings: Session) -> Iterator[tuple[str, Session, Session, Session]]:
    """Which half teaches; what it teaches, what is held out of it, and the other half."""
    for joint in JOINTS:
        angle = readings.angles[:, joint - 1]
        below = angle <= np.median(angle)
        for which, half in (("below", below), ("above", ~below)):
            teach, held_out = hold_out(readings.rows(half), by="position", fraction=0.15, seed=0)
            yield f"joint {joint} {which} {np.degrees(np.median(angle)):.0f} deg", teach, held_out, readings.rows(~half)


def main() -> None:
    """Measure and print."""
    options = options_of(__doc__)
    found = {
        name: {
            label: {where: figures(model, test) for where, test in (("inside", inside), ("away", away))}
            for label, model in ((label, kind(load_arm("ur10")).fit_readings(teach)) for label, kind in MODELS.items())
        }
        for name, teach, inside, away in halves(datasets.load_readings("ur10-b"))
    }
    if options.json:
        print_json({"halves": found}, [])
        return
    say_machine()
    print(
        "\nUR10 series B: mean error [mm], standard uncertainty of a coordinate [mm], points in the 95 % ellipsoids\n"
    )
    rows = [
        [name, where, *(f"{f['mean_mm']:.2f}  {f['std_mm']:.3f}  {f['in_95_percent']:.0%}" for f in cells)]
        for name, models in found.items()
        for where in ("inside", "away")
        for cells in [[models[label][where] for label in MODELS]]
    ]
    print_table(["learned from", "tested", *MODELS], rows)


if __name__ == "__main__":
    main()
