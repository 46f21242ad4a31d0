"""Arms a little off their drawing, and what is measured with them."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.readings import Lengths, Session
from truearm.wings.planning.designs.sampling import seat

NOISE = 0.02  # mm


@dataclass(frozen=True)
class Real:
    """An arm, its true chain, and the true places of three seats in its base frame [mm]."""

    arm: Arm
    chain: Chain
    seats: np.ndarray
    in_seats: np.ndarray
    names: np.ndarray

    def points(self, n, rng, *, half_width=0.8, **more):
        """(n,) readings with reference points."""
        angles = self.arm.working + half_width * rng.uniform(-1, 1, (n, self.arm.n_joints))
        return Session(angles, self.chain.tip_in_base(angles) + rng.normal(0, NOISE, (n, 3)), **more)

    def held(self, rng):
        """60 readings in three seats, without points: angles are read to 1e-5 rad, some 0.01 mm."""
        return Session(self.in_seats + rng.normal(0, 1e-5, self.in_seats.shape), seat=self.names)

    def lengths(self):
        """Lengths from the first seat to the others."""
        apart = np.linalg.norm(self.seats[1:] - self.seats[0], axis=1)
        return Lengths(np.array(["S1", "S1"]), np.array(["S2", "S3"]), apart, np.full(2, 0.005))


@pytest.fixture(scope="session")
def real() -> Real:
    """A `gao2017` whose every constant is off, by about 1 mrad and 0.5 mm."""
    rng = np.random.default_rng(20170101)
    arm = load_arm("gao2017")
    chain = arm.chain.with_motions(np.array([1e-3] * 3 + [0.5] * 3) * rng.normal(size=(arm.chain.n_places, 6)))
    poses = seat(replace(arm, chain=chain), 60, seed=3, seats=3)
    first = np.flatnonzero(np.r_[True, poses.seat[1:] != poses.seat[:-1]])
    return Real(arm, chain, chain.tip_in_base(poses.angles[first]), poses.angles, poses.seat)
