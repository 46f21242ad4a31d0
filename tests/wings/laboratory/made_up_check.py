"""A made-up arm that is checked again and again: its model, its bar, and sessions of five minutes each."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from truearm.arm import load_arm
from truearm.models import KinematicModel
from truearm.readings import Session, write_session
from truearm.wings.planning.designs.candidates import bar_places
from truearm.wings.planning.designs.sampling import measuring_poses, seat
from truearm.wings.planning.virtual import VirtualArm, load_preset

ARM, BAR_MM, SPHERE_MM = "measuring7", 600.0, 25.0
ELBOW = 3  # the joint whose zero creeps, counted from 0
# Of carbon fibre.
LENGTHS = "seat_a,seat_b,length_mm,u_mm,expansion_per_K,u_expansion_per_K\nbar A,bar B,600.0021,0.0005,0,0.0000005\n"


@dataclass(frozen=True)
class Bench:
    """Where the artefacts stand, and the poses in which a technician touches them."""

    angles: np.ndarray
    points: np.ndarray
    seat: np.ndarray
    sphere: np.ndarray


@cache
def virtual() -> VirtualArm:
    return VirtualArm.draw(load_arm(ARM), load_preset("shop"), seed=4)


@cache
def bench() -> Bench:
    """Ten readings in a cone, four in either seat of the bar, nine on the sphere."""
    arm = virtual().nominal
    cone = seat(arm, 10, seed=5, seats=1)
    bar = bar_places(arm, 1, length_mm=BAR_MM, poses=4, seed=6)
    middle = cone.seat_points[0] + [60.0, 40.0, 30.0]
    # Round the equator, half way up, and the pole.
    turns = np.radians([0, 90, 180, 270, 45, 135, 225, 315, 0])
    heights = np.radians([0, 0, 0, 0, 45, 45, 45, 45, 90])
    outward = np.stack([np.cos(heights) * np.cos(turns), np.cos(heights) * np.sin(turns), np.sin(heights)], axis=1)
    touched = middle + (SPHERE_MM / 2 + 3.0) * outward
    ball = seat(arm, 9, seed=7, seats=touched)
    ends = np.where(np.char.endswith(bar.seat, "a"), "bar A", "bar B")
    return Bench(
        np.concatenate([cone.angles, bar.angles, ball.angles]),
        np.concatenate([cone.seat_points, bar.seat_points, touched]),
        np.concatenate([np.full(10, "cone"), ends, np.full(9, "")]),
        np.concatenate([np.full(10 + len(ends), ""), np.full(9, "ball")]),
    )


def session(day: int, *, creep_arcsec: float = 0.0) -> Session:
    """The readings of a day: poses a little different each time, the elbow's zero off by `creep_arcsec`."""
    made, rng = bench(), np.random.default_rng([11, day])
    poses = made.angles + np.radians(rng.uniform(-1.5, 1.5, made.angles.shape))
    measured = (
        virtual()
        .measure(
            poses,
            seed=100 + day,
            temperature_degC=21.0 + 0.5 * rng.standard_normal(),
            seat_points=made.points,
            reference=False,
        )
        .readings
    )
    angles = measured.angles.copy()
    angles[:, ELBOW] += np.radians(creep_arcsec / 3600)
    return replace(measured, angles=angles, seat=made.seat, sphere=made.sphere)


def write_days(folder: Path, creep_arcsec: list[float]) -> list[Path]:
    """A session file a day."""
    paths = []
    for day, creep in enumerate(creep_arcsec, start=1):
        paths.append(folder / f"day{day:02}.csv")
        write_session(session(day, creep_arcsec=creep), paths[-1])
    return paths


def write_model(folder: Path) -> Path:
    """The arm's model, from readings with a reference instrument."""
    arm = virtual()
    poses = measuring_poses(arm.nominal, 150, seed=1)
    path = folder / "arm.truearm"
    KinematicModel(arm.nominal, free=()).fit_readings(arm.measure(poses.angles, seed=1).readings).save(path)
    return path
