"""Basis functions as data: their values by law, their way through a file, what they refuse."""

import json
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import Field

from refusals import refuses
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.terms import (
    ArmState,
    Basis,
    Column,
    Constant,
    Direction,
    Expression,
    GravityTorque,
    Harmonics,
    InSession,
    LinkMasses,
    Temperature,
    basis_from_data,
    harmonics,
    register_basis,
    uniform_links,
)
from truearm.identification.terms.basis import JointNumber

G = 9.80665  # m/s^2

orders = st.lists(st.integers(1, 1000), min_size=1, max_size=20, unique=True).map(lambda k: tuple(sorted(k)))
bases = st.one_of(
    st.builds(Constant),
    st.builds(Harmonics, st.integers(1, 5), orders),
    st.builds(GravityTorque, st.integers(0, 5), st.integers(0, 2)),
    st.builds(Temperature, st.integers(0, 5)),
    st.builds(Direction, st.integers(1, 5)),
    st.just(Column("load_2_Nm")),
)


@settings(max_examples=40)
@given(orders, st.integers(0, 1000))
def test_harmonics_by_the_addition_theorem_are_cosines_and_sines(orders, seed):
    angles = np.random.default_rng(seed).uniform(-20, 20, (30, 2))
    basis = Harmonics(2, orders)
    wanted = harmonics(angles[:, 1], orders).reshape(30, -1).T
    # Rounding of the argument k q, up to 2e4, is 4e-12 there.
    got = basis.values(ArmState(flat_chain(), angles))
    assert got == pytest.approx(wanted, abs=2.3e-16 * 20 * (orders[-1] + 20))


def test_harmonics_to_order_1000_are_exact_to_3e_14():
    """At angles of few binary digits, whose multiples have no rounding."""
    angles = np.arange(-3600, 3600, 13)[:, None] / 512
    for orders in (range(1, 1001), range(1, 81), range(3, 1000, 7), [1, 64, 1000]):
        wanted = harmonics(angles[:, 0], orders).reshape(len(angles), -1).T
        got = Harmonics(1, tuple(orders)).values(ArmState(flat_chain(), angles * [1, 1]))
        np.testing.assert_allclose(got, wanted, rtol=0, atol=3e-14)


@settings(max_examples=40)
@given(bases, st.integers(0, 100), st.booleans())
def test_every_basis_has_a_label_a_function_and_keeps_to_its_rows(make_state, basis, seed, sliding):
    state = make_state(seed, 12, sliding=sliding)
    values = basis.values(state)
    assert values.shape == (basis.n_functions, 12) == (len(basis.labels()), 12)
    assert values.flags.c_contiguous
    assert values.dtype == np.float64
    for which in (slice(3, 9), np.array([5, 1]), np.arange(12) % 2 == 0, slice(0, 0)):
        # Chunks of another length may be summed in another order.
        assert basis.values(state.rows(which)) == pytest.approx(values[:, which], abs=1e-9)


@given(bases)
def test_every_basis_comes_back_from_a_file(basis):
    back = basis_from_data(json.loads(json.dumps(basis.as_data())))
    assert back == basis
    assert hash(back) == hash(basis)


@settings(max_examples=20)
@given(st.integers(0, 1000))
def test_the_torque_on_the_base_is_the_work_of_the_weights_in_a_small_rotation(make_state, seed):
    """Torque about an axis of place 0 = weight times the masses' change of height by a small rotation there."""
    rng = np.random.default_rng(seed)
    links = LinkMasses(rng.uniform(0, 5, 5), rng.normal(0, 200, (5, 3)))
    state = make_state(seed, 6, links=links)
    work = np.zeros((3, 6))
    for k in range(1, 6):
        fixed = np.concatenate([state.chain.fixed[:k], np.eye(4)[None]])
        upto = Chain(fixed, links.centre_in_joint_mm[k - 1])
        work -= (
            links.mass_kg[k - 1] * G * 1e-3 * upto.tip_derivatives(state.angles[:, :k]).motion_jacobian[:, 0, :3, 2].T
        )
    for axis in range(3):
        # Torques reach 1e2 N m: rounding is 1e-13.
        assert GravityTorque(0, axis).values(state) == pytest.approx(work[[axis]], abs=1e-10)


def test_a_prismatic_first_joint_transmits_its_torque_unchanged():
    lying = np.eye(4)
    lying[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]  # slides along the base's x
    arm = np.eye(4)
    arm[0, 3] = 500.0
    chain = Chain(np.stack([lying, arm]), [0, 0, 0], [True])
    state = ArmState(chain, [[0.0], [100.0]], links=LinkMasses([2.0], [[500.0, 0, 0]]))
    # 2 kg at 0.5 m along place 1's x = the base's y: torque about the base's x = place 1's z.
    values = np.concatenate([GravityTorque(0, axis).values(state) for axis in range(3)])
    assert values == pytest.approx(np.array([[0, 0], [0, 0], [-G, -G]]), abs=1e-12)


def test_without_masses_links_weigh_a_kilogram_a_metre(make_state):
    state = make_state(4)
    weighed = make_state(4, links=uniform_links(state.chain, kg_per_m=1.0))
    assert np.array_equal(state.gravity_torques, weighed.gravity_torques)


def test_one_temperature_is_that_of_every_link(make_state):
    state = make_state(temperature_degC=np.linspace(18, 24, 40))
    for link in (0, 5):
        assert Temperature(link).values(state)[0] == pytest.approx(np.linspace(-2, 4, 40), abs=1e-12)


def test_links_have_temperatures_of_their_own(make_state):
    state = make_state()
    assert Temperature(3).values(state)[0] == pytest.approx(state.temperature_degC[:, 3] - 20.0, abs=1e-12)


@pytest.mark.parametrize(
    ("basis", "says"),
    [
        (Temperature(), "temperature_degC"),
        (Direction(1), "directions"),
        (Column("load_1_Nm"), "load_1_Nm"),
        (Harmonics(3, (1,)), "joint from 1 to 2, got 3"),
        (GravityTorque(9, 0), "joint from 1 to 2, got 9"),
    ],
)
def test_missing_quantities_are_named(basis, says):
    refuses(says, basis.values, ArmState(flat_chain(), np.zeros((3, 2))))


def test_a_basis_of_one_s_own_may_annotate_its_fields():
    @dataclass(frozen=True)
    class Annotations(Basis):
        joint: Annotated[int, "counted from 1"]
        order: Annotated[int, Field(ge=1)]
        names: Annotated[list[str], "any"]
        checked: JointNumber = 1

        def expressions(self):
            return ((self.order * Expression.angle(self.joint)).cos(),)

    assert Annotations(2, 3, []).labels() == ("cos(3 * q2)",)
    refuses("expected checked as whole numbers, 1 to 100", Annotations, 2, 3, [], 0)


def test_names_and_orders_have_a_length():
    assert Column("x" * 1000).name
    for make in (Column, InSession):
        for name in ("", "x" * 1001, 1):
            refuses("expected a name as text of 1 to 1000 characters", make, name)
    refuses("expected a tuple of orders, 1 to 1000 of them", Harmonics, 1, (1,) * 1001)


def test_whole_numbers_of_any_kind_are_made_plain():
    bases = [
        Harmonics(np.int64(2), tuple(np.arange(1, 4, dtype=np.uint8))),
        GravityTorque(np.int32(1), np.int64(2)),
        Temperature(np.int8(3)),
        Direction(np.int64(4)),
    ]
    assert bases[0] == Harmonics(2, (1, 2, 3))
    for basis in bases:
        assert basis_from_data(json.loads(json.dumps(basis.as_data()))) == basis
    refuses("whole numbers", Harmonics, 1, (np.float64(1),))
    refuses("whole numbers", Direction, np.bool_(True))


def test_a_session_is_one_at_its_own_readings_only():
    state = ArmState(flat_chain(), np.zeros((3, 2)), session=np.array(["May", "", "June"]))
    assert InSession("May").values(state).tolist() == [[1, 0, 0]]
    assert InSession("May").values(state.rows(np.array([2, 0]))).tolist() == [[0, 1]]
    assert InSession("May").values(ArmState(flat_chain(), np.zeros((3, 2)))).tolist() == [[0, 0, 0]]
    assert basis_from_data(InSession("May").as_data()) == InSession("May")
    refuses(r"sessions of shape \(3,\)", ArmState, flat_chain(), np.zeros((3, 2)), session=np.array(["May"]))


def test_all_rows_of_a_state_are_the_state_and_a_mask_is_no_row_numbers():
    state = ArmState(flat_chain(), np.arange(4.0).reshape(2, 2) / 10)
    assert state.rows(np.arange(2)) is state
    for which, angles in (([1, 0], state.angles[::-1]), ([False, True], state.angles[1:]), ([0], state.angles[:1])):
        np.testing.assert_array_equal(state.rows(np.array(which)).angles, angles)


def test_a_link_beyond_the_last_is_refused(make_state):
    refuses("link from 0 to 5, got 6", Temperature(6).values, make_state())


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Harmonics(0, (1,)), "joint"),
        (lambda: Harmonics(True, (1,)), "joint"),
        (lambda: Harmonics(1, [1]), "tuple of orders"),
        (lambda: Harmonics(1, ()), "tuple of orders"),
        (lambda: Harmonics(1, (2, 1)), "rising"),
        (lambda: Harmonics(1, (1, 1)), "rising"),
        (lambda: Harmonics(1, (0.4,)), "whole numbers"),
        (lambda: Harmonics(1, (1001,)), "1 to 1000"),
        (lambda: GravityTorque(1, 3), "0 to 2"),
        (lambda: GravityTorque(-1, 0), "0 to 100"),
        (lambda: Temperature(-1), "0 to 100"),
        (lambda: Direction("1"), "whole numbers"),
        (lambda: Column(""), "name as text"),
        (lambda: Column(3), "name as text"),
        (lambda: InSession(""), "name as text"),
        (lambda: InSession(7), "name as text"),
    ],
)
def test_invalid_bases_are_refused(make, says):
    refuses(says, make)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({"kind": "Spline", "joint": 1}, r"among .*'Column', 'Constant'.*got 'Spline'.*import the module"),
        ({"joint": 1}, "with its kind"),
        (["Constant"], "with its kind"),
        ({"kind": "Harmonics", "joint": 1}, "fields of a basis 'Harmonics'"),
        ({"kind": "Constant", "joint": 1}, "fields of a basis 'Constant'"),
        ({"kind": "Harmonics", "joint": 1, "orders": [[1]]}, "whole numbers"),
    ],
)
def test_foreign_data_are_refused(data, says):
    refuses(says, basis_from_data, data)


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)
kinds = st.sampled_from(
    ["Constant", "Harmonics", "GravityTorque", "Temperature", "Direction", "InSession", "Column", "Formula"]
)
keys = st.sampled_from(["joint", "orders", "functions", "axis", "link", "name", "self", ""])


@settings(max_examples=40)
@given(plain | st.builds(lambda kind, fields: fields | {"kind": kind}, kinds, st.dictionaries(keys, plain, max_size=3)))
def test_hostile_data_make_a_basis_or_an_input_error(data):
    try:
        basis = basis_from_data(data)
    except InputError:
        return
    assert basis_from_data(basis.as_data()) == basis


def test_a_basis_of_ones_own_comes_back_from_a_file_too(make_state):
    @register_basis
    @dataclass(frozen=True)
    class Cage(Basis):
        joint: int
        ratio: float = 0.4

        def labels(self):
            return ("cage",)

        def values(self, state):
            return np.cos(self.ratio * state.angles[:, [self.joint - 1]].T)

    basis = Cage(2)
    assert basis_from_data(json.loads(json.dumps(basis.as_data()))) == basis
    assert basis.values(make_state()).shape == (basis.n_functions, 40)
    assert register_basis(Cage) is Cage
    refuses("fields of a basis 'Cage'", basis_from_data, {"kind": "Cage"})


def test_a_second_class_of_the_same_name_is_refused():
    refuses("'Constant' is already registered", register_basis, type("Constant", (Basis,), {}))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"angles": np.zeros((4, 3))}, r"angles of shape \(n, 5\), got \(4, 3\)"),
        ({"angles": np.full((40, 5), np.nan)}, "finite angles"),
        ({"temperature_degC": np.zeros((40, 2))}, r"temperatures of shape \(40,\) or \(40, 6\)"),
        ({"temperature_degC": np.full(40, np.inf)}, "finite temperatures"),
        ({"directions": np.zeros(40)}, "directions of shape"),
        ({"directions": np.full((40, 5), 2.0)}, "between -1 and 1"),
        ({"columns": {"load_1_Nm": np.zeros(3)}}, "column 'load_1_Nm' of shape"),
        ({"gravity_in_base": [0, 0]}, "gravity of shape"),
    ],
)
def test_invalid_states_are_refused(make_state, changed, says):
    refuses(says, make_state, **changed)


def flat_chain() -> Chain:
    along = np.eye(4)
    along[0, 3] = 300.0
    return Chain(np.stack([np.eye(4), along, along]), [0, 0, 0])


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("axis", range(3))
def test_gravity_torques_are_those_of_their_expressions(make_state, joint, axis):
    basis, state = GravityTorque(joint, axis), make_state()
    np.testing.assert_array_equal(basis.values(state), [one.values(state) for one in basis.expressions()])
