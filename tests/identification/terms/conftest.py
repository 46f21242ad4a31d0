"""States of random arms."""

import numpy as np
import pytest

from truearm.arm.chain import Chain
from truearm.identification.terms import ArmState


@pytest.fixture(scope="session")
def make_chain():
    """Chain of random places, optionally with its third joint sliding."""

    def make(seed: int = 0, n: int = 5, *, sliding: bool = False) -> Chain:
        rng = np.random.default_rng(seed)
        fixed = np.tile(np.eye(4), (n + 1, 1, 1))
        fixed[:, :3, :3] = np.linalg.qr(rng.normal(size=(n + 1, 3, 3)))[0]
        fixed[:, 0, :3] *= np.sign(np.linalg.det(fixed[:, :3, :3]))[:, None]
        fixed[:, :3, 3] = rng.normal(0, 300, (n + 1, 3))
        return Chain(fixed, rng.normal(0, 100, 3), np.arange(n) == 2 if sliding else None)

    return make


@pytest.fixture(scope="session")
def make_state(make_chain):
    """State of all that can be known, at random readings."""

    def make(seed: int = 0, n: int = 40, *, sliding: bool = False, **changed) -> ArmState:
        chain = make_chain(seed, sliding=sliding)
        rng = np.random.default_rng(seed + 1)
        known = {
            "angles": rng.uniform(-3, 3, (n, 5)),
            "temperature_degC": rng.uniform(15, 30, (n, 6)),
            "directions": rng.choice([-1.0, 1.0], (n, 5)),
            "columns": {"load_2_Nm": rng.normal(0, 3, n)},
        }
        return ArmState(chain, **(known | changed))

    return make
