"""Torques of a payload: against hand-solved cases, and against the masses of links."""

from dataclasses import replace

import numpy as np
import pytest

from refusals import refuses
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.terms import ArmState, LinkMasses, PayloadTorque, basis_from_data, gravity_torques
from truearm.identification.terms.catalogue import PAYLOAD_COMPLIANCE, candidate_terms, payload_terms, unlearned_terms
from truearm.identification.terms.links import STANDARD_GRAVITY, link_vectors, loads_per_kg_at_tip
from truearm.readings.session import Session

# N m, of torques up to some ten: rounding.
ROUNDING = 1e-11


def beam() -> Chain:
    """One joint about a level axis (y of the base, its z) and a tip 1000 mm along x where its angle is zero."""
    fixed = np.tile(np.eye(4), (2, 1, 1))
    fixed[0, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    return Chain(fixed, [1000.0, 0.0, 0.0])


def test_a_payload_of_2_kg_at_1_m_turns_a_level_joint_by_19_6_newton_metres():
    state = ArmState(beam(), np.radians([[0.0], [60.0], [90.0]]), columns={"payload_kg": np.full(3, 2.0)})
    torque = PayloadTorque(1, 2).values(state)[0]
    np.testing.assert_allclose(np.abs(torque), 2 * STANDARD_GRAVITY * np.array([1.0, 0.5, 0.0]), atol=ROUNDING)
    # Joint 1 turns about -y of the base: with x level, weight turns the tip down, about +y.
    assert torque[0] < 0
    of_half = replace(PayloadTorque(1, 2), from_kg=1.0)
    np.testing.assert_allclose(of_half.values(state)[0], torque / 2, atol=ROUNDING)


@pytest.mark.parametrize("sliding", [False, True])
def test_it_is_the_torque_of_a_mass_in_the_last_link(make_chain, sliding):
    chain = make_chain(sliding=sliding)
    angles = np.random.default_rng(3).uniform(-3, 3, (20, 5))
    own = LinkMasses(np.arange(1.0, 6.0), np.random.default_rng(4).normal(0, 100, (5, 3)))
    loaded = own.mass_kg + 2.5 * (np.arange(5) == 4)
    centre = own.centre_in_joint_mm.copy()
    centre[4] = (5.0 * centre[4] + 2.5 * link_vectors(chain)[-1]) / 7.5
    gravity = np.array([0.0, 3.0, -9.0])
    whole = gravity_torques(chain, angles, LinkMasses(loaded, centre), gravity_in_base=gravity)
    of_arm = gravity_torques(chain, angles, own, gravity_in_base=gravity)
    per_kg = loads_per_kg_at_tip(chain, angles, gravity_in_base=gravity).torque_in_joint
    np.testing.assert_allclose(of_arm + 2.5 * per_kg, whole, atol=ROUNDING)
    state = ArmState(chain, angles, links=own, gravity_in_base=gravity, columns={"payload_kg": np.full(20, 2.5)})
    np.testing.assert_allclose(state.gravity_torques, whole, atol=ROUNDING)
    # Torques of assumed masses have no unit that a payload in kg would fit.
    unknown = replace(state, links=None)
    np.testing.assert_array_equal(unknown.gravity_torques, replace(unknown, columns={}).gravity_torques)


def test_the_torque_on_the_base_does_not_turn_with_joint_1(make_chain):
    state = ArmState(
        make_chain(), np.random.default_rng(5).uniform(-3, 3, (10, 5)), columns={"payload_kg": np.ones(10)}
    )
    x, y, z = (PayloadTorque(0, axis).values(state)[0] for axis in range(3))
    at_joint = state.loads_per_kg.torque_in_joint[:, 0]
    turned = np.cos(state.angles[:, 0]) * at_joint[:, 0] - np.sin(state.angles[:, 0]) * at_joint[:, 1]
    np.testing.assert_allclose(x, turned, atol=ROUNDING)
    np.testing.assert_allclose(x**2 + y**2 + z**2, (at_joint**2).sum(axis=1), atol=1e-9)  # (N m)^2


def test_terms_are_offered_where_the_payload_varies_and_keep_their_prior_where_it_does_not(make_state):
    def of(kg):
        return make_state(columns={"payload_kg": kg})

    def groups(state):
        return {term.group for term in candidate_terms(state)[0]}

    assert PAYLOAD_COMPLIANCE in groups(of(np.resize([0.0, 3.0], 40)))
    assert not [term for term, _ in unlearned_terms(of(np.resize([0.0, 3.0], 40))) if term.group == PAYLOAD_COMPLIANCE]
    for constant in (0.0, 2.5):
        state = of(np.full(40, constant))
        offered, skipped = candidate_terms(state)
        assert PAYLOAD_COMPLIANCE not in {term.group for term in offered}
        assert ("payload_kg", "it is constant in these readings") in [tuple(one) for one in skipped]
        kept = [(term, value) for term, value in unlearned_terms(state) if term.group == PAYLOAD_COMPLIANCE]
        assert len(kept) == len(payload_terms(state.chain))
        assert {(term.basis.from_kg, value) for term, value in kept} == {(constant, 0.0)}


def test_plain_data_gives_the_same_basis():
    basis = PayloadTorque(2, 1, 2.5)
    assert basis_from_data(basis.as_data()) == basis
    assert basis.labels() == ("torque of the payload above 2.5 kg about y of J2",)


@pytest.mark.parametrize("wrong", [{"joint": -1}, {"axis": 3}, {"from_kg": "2"}, {"from_kg": float("nan")}])
def test_wrong_fields_are_refused(wrong):
    refuses("expected", basis_from_data, {"kind": "PayloadTorque", "joint": 1, "axis": 0, "from_kg": 0.0} | wrong)


def test_readings_without_a_payload_are_refused(make_state):
    refuses("readings with a payload, got none", PayloadTorque(1, 0).values, make_state())


@pytest.mark.parametrize("kg", [-0.1, 2500000.0])
def test_a_payload_that_no_arm_carries_is_refused(kg):
    with pytest.raises(InputError, match=r"expected a payload of 0 to 10000 kg, got .* kg"):
        Session([[0.1], [0.2]], columns={"payload_kg": [1.0, kg]})
