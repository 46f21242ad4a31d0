"""What must not matter: where the joints have their zeros, the unit of lengths, and zeros that are drawn wrongly.

Each arm is identified twice from the same 100 readings, once as it is and once described otherwise; the figures are the
largest distance of two predictions at 200 other poses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from imperfect_finding import Finding, print_findings
from truearm.arm import Arm, load_arm
from truearm.arm.chain import Chain
from truearm.compensation.models import KinematicModel, PhysicalModel
from truearm.identification.planning.sampling import STRATEGIES
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.readings import Session
from truearm.typing import FloatArray

ARM, N, N_TEST = "gao2017", 100, 200
KINDS = {"kinematic": KinematicModel, "physical": PhysicalModel}
UNITS = {"inches": 1 / 25.4, "micrometres": 1000.0}
WRONG_DEG = (0.05, 1.0, 5.0)
LIMITS = {"zeros": 1e-6, "unit": 1e-3, "drawn": 0.1}  # mm; of the standard uncertainty


def turned_about_z(angle: float) -> FloatArray:
    """(4, 4) a rotation about z."""
    out = np.eye(4)
    out[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return out


def with_zeros(arm: Arm, shift: FloatArray) -> Arm:
    """The arm whose joints read nothing where it read minus `shift` [rad]; limits follow."""
    fixed = arm.chain.fixed.copy()
    for i, angle in enumerate(shift):
        fixed[i + 1] = turned_about_z(-angle) @ fixed[i + 1]
    lower, upper = arm.limits.T + shift[None]
    chain = Chain(fixed, arm.chain.tip_in_flange)
    return replace(arm, chain=chain, lower=lower, upper=upper, working_pose=arm.working + shift)


def in_unit(arm: Arm, factor: float) -> Arm:
    """The arm with its lengths times a factor."""
    fixed = arm.chain.fixed.copy()
    fixed[:, :3, 3] *= factor
    return replace(arm, chain=Chain(fixed, arm.chain.tip_in_flange * factor))


def differences(seed: int) -> Iterator[tuple[str, str, float, float]]:
    """What was changed, the model, and the largest difference in mm and in standard uncertainties."""
    arm = load_arm(ARM)
    real = VirtualArm.draw(arm, load_preset("research"), seed=seed)
    measured = real.measure(STRATEGIES["measuring"](arm, N, seed=1).angles, seed=1).readings
    assert measured.points is not None
    angles, points = measured.angles, measured.points
    at = STRATEGIES["measuring"](arm, N_TEST, seed=2).angles
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-2, 2, arm.n_joints)
    for name, kind in KINDS.items():
        plain, covariance = kind(arm).fit_readings(Session(angles, points)).predict(at, return_cov=True)
        uncertainty = np.sqrt(np.trace(covariance, axis1=1, axis2=2))

        def off(found: FloatArray, plain: FloatArray = plain, u: FloatArray = uncertainty) -> tuple[float, float]:
            distance = np.linalg.norm(found - plain, axis=1)
            return float(distance.max()), float((distance / u).max())

        moved = kind(with_zeros(arm, shift)).fit_readings(Session(angles + shift, points))
        yield "zeros", name, *off(moved.predict(at + shift))
        for factor in UNITS.values():
            other = kind(in_unit(arm, factor)).fit_readings(Session(angles, points * factor))
            yield "unit", name, *off(other.predict(at) / factor)
        for degrees in WRONG_DEG:
            signs = np.radians(degrees) * rng.choice([-1.0, 1.0], arm.n_joints)
            drawn = replace(with_zeros(arm, signs), lower=arm.lower, upper=arm.upper, working_pose=arm.working)
            yield "drawn", name, *off(kind(drawn).fit_readings(Session(angles, points)).predict(at))


def rows(*, quick: bool) -> list[Finding]:
    """The largest difference of any arm, for each thing that must not matter."""
    found = [one for seed in range(1 if quick else 3) for one in differences(seed)]
    worst = {
        what: (max(mm for w, _, mm, _ in found if w == what), max(u for w, _, _, u in found if w == what))
        for what in LIMITS
    }
    (zeros, _), (_, unit), (drawn_mm, drawn) = (worst[what] for what in LIMITS)
    return [
        Finding("joint zeros in the arm file shifted", "1e-6 mm", f"{zeros:.1e} mm", zeros <= LIMITS["zeros"]),
        Finding("lengths in inches or micrometres", "1e-3 u", f"{unit:.1e} u", unit <= LIMITS["unit"]),
        Finding(
            "zeros drawn wrong by 0.05 to 5 degrees",
            "0.1 u",
            f"{drawn:.2f} u ({1000 * drawn_mm:.1f} um)",
            drawn <= LIMITS["drawn"],
        ),
    ]


if __name__ == "__main__":
    print_findings(__doc__, rows)
