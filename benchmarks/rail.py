"""A UR10 on a rail of 4 m with planted errors of rail and arm: kinematic and physical model at held-out readings."""

from __future__ import annotations

import numpy as np

import truearm as ta
from machine import options_of, print_rows
from truearm.arm.chain import Chain
from truearm.typing import FloatArray

TRAVEL_MM, NOISE_MM = 4000.0, 0.02
# Positions of the rail at which it was trained; None: anywhere.
TRAINED = {"anywhere": None, "5 positions": np.linspace(0, TRAVEL_MM, 5), "one half": (0.0, TRAVEL_MM / 2)}


def arm_on_rail() -> ta.Arm:
    """The robot, its base carried along y."""
    robot = ta.load_arm("ur10")
    along_y = np.eye(4)
    along_y[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    fixed = np.concatenate([[along_y, along_y.T @ robot.chain.fixed[0]], robot.chain.fixed[1:]])
    return ta.Arm("rail", Chain(fixed, robot.chain.tip_in_flange, np.arange(7) == 0), joint_names=tuple("R123456"))


def errors(travel_mm: FloatArray, n_places: int) -> FloatArray:
    """Motions of rail and arm, (n, n_places, 6) [rad, mm]."""
    u = travel_mm / TRAVEL_MM
    out = np.zeros((len(u), n_places, 6))
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 2e-4 * np.sin(5 * u + 1), 6e-4 * (u - 0.5) ** 2, 1e-4 * np.cos(7 * u)
    out[:, 1, 3], out[:, 1, 4] = 0.3 * np.sin(4 * u), 0.2 * u**3
    out[:, 1, 5] = 3e-5 * (travel_mm - TRAVEL_MM / 2) + 0.05 * np.sin(9 * u)
    out[:, 3, :3], out[:, 5, 3:] = [1e-3, -5e-4, 2e-4], [0.3, 0.2, -0.4]
    return out


def measured(arm: ta.Arm, n: int, where: object, *, seed: int) -> ta.Session:
    """Readings at random poses; `where` as in `TRAINED`."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-1.5, 1.5, (n, arm.n_joints))
    low, high = where if isinstance(where, tuple) else (0.0, TRAVEL_MM)
    angles[:, 0] = rng.choice(where, n) if isinstance(where, np.ndarray) else rng.uniform(low, high, n)
    tips = arm.chain.tip_in_base(angles, errors(angles[:, 0], arm.chain.n_places))
    return ta.Session(angles, tips + [500.0, 300.0, 20.0] + rng.normal(0, NOISE_MM, (n, 3)))


def main() -> None:
    """Print mean errors and stated uncertainties."""
    options = options_of(__doc__, readings=250)
    arm, found = arm_on_rail(), []
    test = measured(arm, 300, None, seed=9)
    for trained, where in TRAINED.items():
        session = measured(arm, options.readings, where, seed=1)
        for kind in (ta.KinematicModel, ta.PhysicalModel):
            points, covariance = kind(arm).fit_readings(session).predict_readings(test, return_cov=True)
            error = float(np.linalg.norm(points - test.points, axis=1).mean())
            u = float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / 3))
            found.append({"trained": trained, "model": kind.__name__, "mean_mm": error, "u_mm": u})
    print_rows(found, as_json=options.json)


if __name__ == "__main__":
    main()
