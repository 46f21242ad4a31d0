"""Seats of one place, no instrument: errors at all other places of four hand-guided arms, and of virtual ones.

Every tool position of the sets `mukca-*` is learned from alone. What `auto` keeps, and the physical model, are compared
with the kinematic model at the other positions. Virtual arms are learned from two seats 50 mm apart and tested in ten
seats all around.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from identification_seats import tool_positions
from imperfect_finding import Finding, print_findings
from truearm import datasets
from truearm.arm import Arm, load_arm
from truearm.compensation.models import KinematicModel, PhysicalModel
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.compensation.models.selection import select_model
from truearm.identification.planning.sampling import STRATEGIES
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.readings import Session
from truearm.readings.lengths import Lengths
from truearm.readings.seats import seat_errors

ROBOTS = ("panda_1", "panda_2", "panda_3", "dinova_1")
# What counts as worse than the kinematic model.
MARGIN = 1.02
ARM = "gao2017"
PRESETS = ("research", "shop")
APART_MM = np.array([50.0, 0.0, 0.0])


def at_other_places(model: IdentifiedModel, tests: Sequence[Session]) -> float:
    """Mean distance of the points to the mean of their seat, over all readings of some sessions [mm]."""
    means = []
    for part in tests:
        assert part.seat is not None
        means.append(seat_errors(model.predict_readings(part), part.seat)["seat_mean_mm"])
    return float(np.average(means, weights=[len(part) for part in tests]))


def ratios(arm: Arm, learned: Session, lengths: Lengths, tests: Sequence[Session]) -> dict[str, float]:
    """Errors elsewhere of the physical model and of what `auto` keeps, over those of the kinematic model."""
    error = partial(at_other_places, tests=tests)
    kinematic = error(KinematicModel(arm).fit_readings(learned, lengths=lengths))
    kept, _, _ = select_model(arm, learned, lengths=lengths)
    physical = kept if isinstance(kept, PhysicalModel) else PhysicalModel(arm).fit_readings(learned, lengths=lengths)
    return {"physical": error(physical) / kinematic, "auto": error(kept) / kinematic, "kinematic_mm": kinematic}


def real_arms(*, quick: bool) -> dict[str, dict[str, float]]:
    """Every training on a single tool position."""
    found = {}
    for robot in ROBOTS[2:] if quick else ROBOTS:
        name = f"mukca-{robot}"
        readings, lengths = datasets.load_readings(name), datasets.load_lengths(name)
        arm = load_arm(datasets.DATASETS[name].arm)
        assert readings.position is not None
        assert lengths is not None
        places = {place: readings.rows(readings.position == f"{robot}/{place}") for place in tool_positions(robot)}
        for place, learned in places.items():
            others = [part for other, part in places.items() if other != place]
            found[f"{robot} {place}"] = ratios(arm, learned, lengths, others)
    return found


def virtual_arms(preset: str, *, quick: bool) -> dict[str, dict[str, float]]:
    """Two seats of one place, 30 poses in each, of virtual arms."""
    arm, found = load_arm(ARM), {}
    around = STRATEGIES["seat"](arm, 200, seed=5, seats=10)
    assert around.seat is not None
    assert around.seat_points is not None
    places = around.seat_points[np.unique(around.seat, return_index=True)[1]]
    for seed in range(2 if quick else 4):
        real, place = VirtualArm.draw(arm, load_preset(preset), seed=seed), places[seed]
        poses = STRATEGIES["seat"](arm, 60, seed=seed, seats=np.array([place, place + APART_MM]))
        measure: Callable[..., Session] = lambda poses, seed, real=real: (  # noqa: E731
            real.measure(
                poses.angles, seed=seed, seat=poses.seat, seat_points=poses.seat_points, reference=False
            ).readings
        )
        learned, test = measure(poses, seed), measure(around, 77 + seed)
        assert learned.seat is not None
        names = np.unique(learned.seat)
        lengths = Lengths(names[[0]], names[[1]], np.array([50.0]), np.array([0.01]))
        found[f"{preset} {seed}"] = ratios(arm, learned, lengths, [test])
    return found


def mean_and_worst(found: dict[str, dict[str, float]], which: str) -> tuple[float, float]:
    """Geometric mean and largest ratio."""
    values = np.array([one[which] for one in found.values()])
    return float(np.exp(np.log(values).mean())), float(values.max())


def rows(*, quick: bool) -> list[Finding]:
    """Ratios of errors at other places over those of the kinematic model."""
    out = []
    found = real_arms(quick=quick)
    for which in ("auto", "physical"):
        mean, worst = mean_and_worst(found, which)
        worse = sum(one[which] > MARGIN for one in found.values())
        out.append(
            Finding(
                f"seats of one place, no instrument: {which}, error at other places over the kinematic model's",
                "each 1.02 at most, mean below 1",
                f"mean {mean:.3f}, worst {worst:.3f}; {worse} of {len(found)} above {MARGIN}",
                worst <= MARGIN and mean < 1,
            )
        )
    for preset in PRESETS:
        mean, worst = mean_and_worst(virtual_arms(preset, quick=quick), "auto")
        out.append(
            Finding(f"the same, virtual arms `{preset}`: auto", "1.02", f"mean {mean:.3f}, worst {worst:.3f}", None)
        )
    return out


if __name__ == "__main__":
    print_findings(__doc__, rows)
