"""What readings leave open, on arms of which it is known."""

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.estimation.diagnostics import MOST_PARTNERS, identifiability
from truearm.identification.estimation.identification import identify
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, constants

NOISE = 0.02  # mm


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def fitted(arm, angles, rng, terms=None):
    """An arm identified from points of one whose constants are off by half their prior standard deviations."""
    terms = constants(arm.chain, free=()) if terms is None else terms
    motions = np.zeros((arm.chain.n_places, 6))
    for term in terms if all(term.learn for term in terms) else constants(arm.chain, free=()):
        motions[term.place] += np.array(term.direction) * term.prior_stds[0] * 0.5 * rng.standard_normal()
    points = arm.chain.with_motions(motions).tip_in_base(angles) + rng.normal(0, NOISE, (len(angles), 3))
    return identify(arm.chain, ArmState(arm.chain, angles), terms, [Points(np.arange(len(angles)), points)])


def test_offsets_along_parallel_axes_are_known_as_a_sum_only(rng):
    """The second, third and fourth axes of a UR10 are parallel."""
    arm = load_arm("ur10")
    along = {"J2 translation along z", "J3 translation along z"}
    terms = [t for t in constants(arm.chain, free=()) if t.name in along]
    found = identifiability(fitted(arm, rng.uniform(-2, 2, (200, 6)), rng, terms))
    (unidentifiable,) = found.unidentifiable
    assert set(unidentifiable.constants) == along
    assert str(unidentifiable).endswith(" (only as a sum)")
    # What one gains the other loses.
    assert unidentifiable.movement[0] == pytest.approx(-unidentifiable.movement[1], rel=1e-3)
    (pair,) = found.correlated
    assert pair.correlation == pytest.approx(-1, abs=1e-3)
    assert list(found.determined.values()) == pytest.approx([0.5, 0.5], abs=0.01)


def test_the_offset_of_a_joint_that_did_not_move_is_identifiable_only_with_its_neighbour(rng):
    """With J5 of the measuring arm at rest, a turn after it looks like turns before it."""
    arm = load_arm("gao2017")
    angles = arm.working + rng.uniform(-1, 1, (200, 6))
    moving = identifiability(fitted(arm, angles, rng))
    angles[:, 4] = arm.working[4]
    still = identifiability(fitted(arm, angles, rng))
    assert not [unidentifiable for unidentifiable in moving.unidentifiable if unidentifiable.at_other_poses]
    missing = [unidentifiable for unidentifiable in still.unidentifiable if unidentifiable.at_other_poses]
    assert any("J5" in name for unidentifiable in missing for name in unidentifiable.constants)
    assert {u.constants for u in moving.unidentifiable} == {
        u.constants for u in still.unidentifiable if not u.at_other_poses
    }


def test_offsets_of_the_last_link_and_a_free_tip_are_known_together_only(rng):
    """A metre of prior for the tip, a millimetre for the offset: what makes up for what is told in millimetres."""
    arm = load_arm("ur10")
    found = identifiability(fitted(arm, rng.uniform(-2, 2, (200, 6)), rng, constants(arm.chain)))
    named = {frozenset(unidentifiable.constants): unidentifiable.movement for unidentifiable in found.unidentifiable}
    offset, tip = named[frozenset({"J6 translation along z", "tip translation along z"})]
    assert tip == pytest.approx(-offset, rel=1e-3)
    assert frozenset({"J1 rotation about z", "base rotation about z"}) in named
    assert frozenset({"J1 translation along z", "base translation along z"}) in named
    # Theory says of six joints, base and tip: 45 constants, 27 combinations. The parallel axes 2, 3, 4 cost up to two.
    assert (
        45 - 27
        <= len([unidentifiable for unidentifiable in found.unidentifiable if not unidentifiable.at_other_poses])
        <= 45 - 27 + 2
    )
    assert len(found.unidentifiable) <= 45 - 27 + 2
    assert found.determined["J6 translation along z"] < 0.01


@pytest.mark.parametrize("name", ["ur10", "gao2017", "measuring7"])
def test_a_common_motion_of_combined_constants_has_no_effect(name, rng):
    """Moving the members together moves tips less, mostly by far, than one of them would by itself."""
    arm = load_arm(name)
    angles = arm.working + rng.uniform(-1, 1, (200, arm.n_joints))
    fit = fitted(arm, angles, rng, constants(arm.chain))
    state, names = ArmState(arm.chain, angles), [term.name for term in fit.perturbed_chain.terms]
    ((_, _, columns),) = fit.perturbed_chain.derivatives(state, fit.coefficients)
    together = [
        unidentifiable
        for unidentifiable in identifiability(fit).unidentifiable
        if 1 < len(unidentifiable.constants) < MOST_PARTNERS
    ]
    assert len(together) > 10
    left = []
    for unidentifiable in together:
        moved = [
            columns[names.index(one)] * by
            for one, by in zip(unidentifiable.constants, unidentifiable.movement, strict=True)
        ]
        left.append(np.sqrt((sum(moved) ** 2).mean() / max((one**2).mean() for one in moved)))
    assert np.median(left) < 0.01
    assert sorted(left)[-2] < 0.5  # one of small effect whose third member goes unnamed


def test_identifiable_constants_are_not_listed(rng):
    arm = load_arm("gao2017")
    terms = [t for t in constants(arm.chain, free=()) if t.name in ("J2 rotation about z", "J3 translation along x")]
    found = identifiability(fitted(arm, arm.working + rng.uniform(-1, 1, (100, 6)), rng, terms))
    assert found.unidentifiable == found.correlated == ()
    assert min(found.determined.values()) > 0.99


def test_an_arm_without_constants_has_an_empty_identifiability(rng):
    arm = load_arm("gao2017")
    found = identifiability(fitted(arm, arm.working + rng.uniform(-1, 1, (20, 6)), rng, []))
    assert found.determined == {}
    assert found.unidentifiable == ()
