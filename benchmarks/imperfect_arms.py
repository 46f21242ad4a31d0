"""Wrong arms: every single mistake of signs, order, zeros and units, and whether a fit refuses it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from imperfect_finding import Finding
from truearm import datasets
from truearm.arm import load_arm
from truearm.arm.arm import Arm
from truearm.compensation.models import KinematicModel
from truearm.errors import InputError
from truearm.identification.planning.sampling import STRATEGIES
from truearm.identification.virtual import PRESETS, VirtualArm
from truearm.readings import Session

READINGS = 60
# A kit that nobody has calibrated: some 10 mm off, with backlash of 5 arc minutes.
KIT = replace(
    PRESETS["research"],
    name="kit",
    length_std_mm=2.0,
    angle_std_deg=0.3,
    nominal_mean_mm=0.0,
    nominal_max_mm=0.0,
    encoder_noise_arcsec=60.0,
    hysteresis_std_arcsec=300.0,
)
# A mistake is harmful if held-out readings err this many times as much as without it.
HARMFUL = 2.0


@dataclass(frozen=True)
class Outcome:
    """A fit with a mistake: refused, or the mean error of held-out readings [mm]."""

    what: str
    is_refused: bool
    error_mm: float
    ratio: float


def sessions(*, quick: bool) -> Iterator[tuple[str, Arm, Session]]:
    """Arms without joint limits, which would find many mistakes, and readings of them."""
    names = ("gao2017",) if quick else ("gao2017", "ur10", "panda")
    for name in names:
        arm = load_arm(name)
        for strategy in ("box", "uniform"):
            for preset in (PRESETS["research"], KIT):
                angles = STRATEGIES[strategy](arm, READINGS, seed=3).angles
                session = VirtualArm.draw(arm, preset, seed=1).measure(angles, seed=3).readings
                yield f"{name} {strategy} {preset.name}", arm, Session(session.angles, session.points)
    for name in ("ur5",) if quick else ("ur10-a", "ur10-b", "ur5", "wam"):
        session = datasets.load_readings(name)
        rows = np.sort(np.random.default_rng(0).permutation(len(session))[:READINGS])
        assert session.points is not None
        yield name, load_arm(datasets.DATASETS[name].arm), Session(session.angles[rows], session.points[rows])


def mistakes(session: Session) -> Iterator[tuple[str, Session]]:
    """The session with every single mistake; those of the base joint's zero are none, as the base is free."""
    angles, points, n = session.angles, session.points, session.n_joints
    assert points is not None

    def with_columns(columns: list[int]) -> Session:
        return Session(angles[:, columns], points)

    for j in range(n):
        sign = np.where(np.arange(n) == j, -1.0, 1.0)
        yield f"sign J{j + 1}", Session(angles * sign, points)
    for i, j in combinations(range(n), 2):
        columns = list(range(n))
        columns[i], columns[j] = j, i
        yield f"J{i + 1} and J{j + 1} exchanged", with_columns(columns)
    for j in range(1, n):
        for degrees in (90, -90, 180):
            yield f"zero J{j + 1} {degrees} deg", Session(angles + np.radians(degrees) * (np.arange(n) == j), points)
    yield "all signs", Session(-angles, points)
    yield "degrees", Session(np.degrees(angles), points)
    yield "radians twice", Session(np.radians(angles), points)
    for unit, mm in {"m": 1e3, "cm": 10.0, "inch": 25.4, "ft": 304.8}.items():
        yield f"points in {unit}", Session(angles, points / mm)
    yield "left-handed points", Session(angles, points * [-1, 1, 1])
    yield "points one row later", Session(angles[1:], points[:-1])


def right(session: Session) -> Iterator[tuple[str, Session]]:
    """Sessions that a fit must accept: as they are, and with zeros that are off by some degrees."""
    yield "as it is", session
    signs = np.random.default_rng(0).choice([-1, 1], session.n_joints)
    yield "zeros off by 5 deg", Session(session.angles + np.radians(5) * signs, session.points)
    points = np.array(session.points)
    points[::10] += 100.0
    yield "a tenth of the points off by 173 mm", Session(session.angles, points)


def outcome(arm: Arm, what: str, session: Session) -> Outcome:
    """Fit the kinematic model by the Python door."""
    try:
        model = KinematicModel(replace(arm, lower=None, upper=None)).fit_readings(session)
    except InputError:
        return Outcome(what, True, float("nan"), float("nan"))
    check = getattr(model, "nominal_check_", None)
    return Outcome(what, False, model.held_out_.mean_mm, float("nan") if check is None else check.ratio)


def rows(*, quick: bool) -> list[Finding]:
    """Mistakes that are accepted and harm, and right arms that are refused."""
    n = n_refused = n_harmful = n_right = 0
    accepted, refused, largest = [], [], 0.0
    for name, arm, session in sessions(quick=quick):
        good = [outcome(arm, what, some) for what, some in right(session)]
        n_right += len(good)
        refused += [f"{name}: {one.what}" for one in good if one.is_refused]
        largest = max([largest, good[0].ratio])
        for what, wrong in mistakes(session) if "kit" not in name else ():
            found = outcome(arm, what, wrong)
            n, n_refused = n + 1, n_refused + found.is_refused
            if not found.is_refused and found.error_mm > HARMFUL * good[0].error_mm:
                n_harmful += 1
                accepted.append(
                    f"{name}: {what}, {found.error_mm:.3f} for {good[0].error_mm:.3f} mm, {found.ratio:.1f}"
                )
    print("\n".join([*accepted, *refused]), file=sys.stderr)
    return [
        Finding(
            "a wrong sign, order, zero or unit of the joints or points, by the Python door",
            "every one that harms is refused",
            f"{n_refused} of {n} refused; {n_harmful} others harm, {n - n_refused - n_harmful} do not",
            n_harmful == 0,
        ),
        Finding(
            "a right arm, a kit 10 mm off, zeros off by 5 deg, a tenth gross errors",
            "none refused",
            f"{len(refused)} of {n_right} refused; nominal error up to {largest:.1f} times the usual",
            not refused,
        ),
    ]
