"""What readings leave open, on arms of which it is known."""

from __future__ import annotations

import numpy as np
import pytest

from truearm.arm import load
from truearm.identify.identifiability import identifiability
from truearm.identify.identification import identify
from truearm.identify.references import Points
from truearm.terms import ArmState, constants

NOISE = 0.02  # mm


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def fitted(arm, angles, rng, terms=None):
    """An arm identified from points of one whose constants are off by their prior standard deviations."""
    terms = constants(arm.chain, free=()) if terms is None else terms
    motions = np.zeros((arm.chain.n_places, 6))
    for term in terms:
        motions[term.place] += np.array(term.direction) * term.prior_stds[0] * 0.5 * rng.standard_normal()
    points = arm.chain.with_motions(motions).tip_in_base(angles) + rng.normal(0, NOISE, (len(angles), 3))
    return identify(arm.chain, ArmState(arm.chain, angles), terms, [Points(np.arange(len(angles)), points)])


def test_offsets_along_parallel_axes_are_known_as_a_sum_only(rng):
    """The second, third and fourth axes of a UR10 are parallel."""
    arm = load("ur10")
    along = {"J2 shift along z", "J3 shift along z"}
    terms = [t for t in constants(arm.chain, free=()) if t.name in along]
    found = identifiability(fitted(arm, rng.uniform(-2, 2, (200, 6)), rng, terms))
    (untold,) = found.untold
    assert set(untold.constants) == along
    assert str(untold).endswith(" only together")
    # What one gains the other loses.
    assert untold.movement[0] == pytest.approx(-untold.movement[1], rel=1e-3)
    (pair,) = found.correlated
    assert pair.correlation == pytest.approx(-1, abs=1e-3)
    assert list(found.determined.values()) == pytest.approx([0.5, 0.5], abs=0.01)


def test_a_joint_that_stood_still_does_not_tell_its_zero_from_its_neighbour(rng):
    """With J5 of the measuring arm at rest, a turn after it looks like turns before it."""
    arm = load("gao2017")
    angles = arm.working + rng.uniform(-1, 1, (200, 6))
    moving = identifiability(fitted(arm, angles, rng))
    angles[:, 4] = arm.working[4]
    still = identifiability(fitted(arm, angles, rng))
    assert len(still.untold) > len(moving.untold)
    assert any("J5" in name for untold in still.untold for name in untold.constants)


def test_what_is_known_is_not_named(rng):
    arm = load("gao2017")
    terms = [t for t in constants(arm.chain, free=()) if t.name in ("J2 rotation about z", "J3 shift along x")]
    found = identifiability(fitted(arm, arm.working + rng.uniform(-1, 1, (100, 6)), rng, terms))
    assert found.untold == found.correlated == ()
    assert min(found.determined.values()) > 0.99


def test_an_arm_without_constants_has_nothing_to_tell(rng):
    arm = load("gao2017")
    found = identifiability(fitted(arm, arm.working + rng.uniform(-1, 1, (20, 6)), rng, []))
    assert found.determined == {}
    assert found.untold == ()
