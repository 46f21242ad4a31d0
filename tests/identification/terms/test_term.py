"""Terms and the catalogue: what they do to an arm, and what readings allow."""

import json

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.arm import load_arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.terms import (
    FREE_BASE,
    FREE_TIP,
    ArmState,
    Column,
    Constant,
    Harmonics,
    SkippedTerm,
    Term,
    candidate_terms,
    catalogue,
    constants,
    growth_motions,
    uniform_links,
)

ABOUT_Z = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def motions(terms: list[Term], coefficients: list, state: ArmState) -> np.ndarray:
    """Motions of all places by terms, (n, n_places, 6): the definition."""
    out = np.zeros((len(state), state.chain.n_places, 6))
    for term, x in zip(terms, coefficients, strict=True):
        out[:, term.place] += (np.atleast_1d(x) @ term.basis.values(state))[:, None] * np.array(term.direction)
    return out


def turning(*angles: np.ndarray) -> ArmState:
    """An upright joint and others behind it, each across the one before, at angles [rad]."""
    hinge = np.array([[1.0, 0, 0, 300], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    return ArmState(Chain(np.stack([np.eye(4), *[hinge] * len(angles)]), [0, 0, 50.0]), np.column_stack(angles))


def orders_of(terms: list[Term], joint: int) -> list[int]:
    return [k for t in terms if t.name.startswith(f"J{joint} angle error") for k in t.basis.orders]


# What a term does


def test_own_axis_terms_are_errors_of_the_joint_angle(make_state):
    state = make_state(2)
    terms = catalogue.own_axis(state.chain, 3, highest=8)
    rng = np.random.default_rng(0)
    coefficients = [rng.normal(0, 1e-3, t.n_coefficients) for t in terms]
    off = np.zeros((40, 5))
    for term, x in zip(terms, coefficients, strict=True):
        off[:, 2] += x @ term.basis.values(state)
    moved = state.chain.tip_in_base(state.angles, motions(terms, coefficients, state))
    # Both exact; lengths reach 1e3 mm.
    assert moved == pytest.approx(state.chain.tip_in_base(state.angles + off), abs=1e-9)


def test_a_sliding_joints_hysteresis_is_an_error_of_its_displacement(make_state):
    state = make_state(2, sliding=True)
    (term,) = catalogue.hysteresis(state.chain, 3)
    off = np.zeros((40, 5))
    off[:, 2] = 0.3 * state.directions[:, 2]
    moved = state.chain.tip_in_base(state.angles, motions([term], [0.3], state))
    assert moved == pytest.approx(state.chain.tip_in_base(state.angles + off), abs=1e-9)


def test_thermal_terms_grow_every_link_along_itself(make_state):
    state = make_state(1)
    terms = catalogue.thermal(state.chain)
    assert [t.place for t in terms] == [0, 1, 2, 3, 4, 5]
    got = motions(terms, [2e-5] * 6, state)[:, :-1, 3:]
    # Growths reach 1e-1 mm.
    assert got == pytest.approx(2e-5 * growth_motions(state.chain, state.temperature_degC), abs=1e-12)


def test_a_link_of_no_length_does_not_grow():
    chain = Chain(np.stack([np.eye(4)] * 3), [0, 0, 10.0])
    assert [t.place for t in catalogue.thermal(chain)] == [2]


@pytest.mark.parametrize("free", [(), ("base",), ("tip",), ("base", "tip")])
def test_constants_have_the_priors_of_the_kinematic_model(make_chain, free):
    chain = make_chain()
    wanted = np.full((chain.n_places, 6), 3e-3)
    size = chain.reach / 1500.0  # lengths are those of an arm of 1.5 m
    wanted[:, 3:] = 3.0 * size
    wanted[-1, :3] = 0
    if "base" in free:
        wanted[0] = np.array(FREE_BASE) * [1, 1, 1, size, size, size]
    if "tip" in free:
        wanted[-1, 3:] = FREE_TIP * size
    terms, got = constants(chain, free=free), np.zeros_like(wanted)
    for term in terms:
        got[term.place, np.argmax(term.direction)] = term.prior_std
        part = {0: "base", chain.n_places - 1: "tip"}.get(term.place)
        assert term.learn == (part not in free and "equivalent to" not in term.group)
        assert (term.group == part) == (part in free)
        assert term.labels == (term.name,)
    assert np.array_equal(got, wanted)
    assert len({t.name for t in terms}) == len(terms) == 6 * (chain.n_places - 1) + 3


def test_constants_without_prior_uncertainty_are_omitted(make_chain):
    groups = {t.group for t in constants(make_chain(), angle_std=0.0)}
    free = {"base", "tip", "equivalent to a free base", "equivalent to a free tip"}
    assert groups == free | {"lengths and offsets"}


def test_constants_that_a_free_base_or_tip_makes_up_for_keep_their_prior():
    """Of a UR10: what turns and shifts joint 1 along its axis, all shifts of joint 6, joint 5's along that axis."""
    chain = load_arm("ur10").chain
    groups = {"base": set(), "tip": set()}
    for part, names in groups.items():
        names |= {t.name for t in constants(chain, free=(part,)) if t.group == f"equivalent to a free {part}"}
    assert groups["base"] == {"J1 rotation about z", "J1 translation along z"}
    assert groups["tip"] == {"J5 translation along y", *(f"J6 translation along {axis}" for axis in "xyz")}
    assert not [t for t in constants(chain, free=()) if "equivalent to" in t.group]
    # They do move tips as a shift of the tip or base does.
    q = np.random.default_rng(0).uniform(-2, 2, (20, 6))
    by = chain.tip_derivatives(q).motion_jacobian
    np.testing.assert_allclose(np.abs(by[:, 5, 4]), np.abs(by[:, 7, 5]), atol=1e-9)
    np.testing.assert_allclose(by[:, 1, [2, 5]], by[:, 0, [2, 5]], atol=1e-9)


def test_angle_error_orders_form_bands_with_one_scale_each(make_chain):
    terms = catalogue.own_axis(make_chain(), 2)
    assert [(t.basis.orders[0], t.basis.orders[-1]) for t in terms] == [
        (1, 2),
        (3, 4),
        (5, 8),
        (9, 16),
        (17, 32),
        (33, 64),
        (65, 110),
    ]
    assert [k for t in terms for k in t.basis.orders] == list(range(1, 111))
    assert len({t.group for t in terms}) == 7
    assert terms[3].name == "J2 angle error, orders 9 to 16"
    assert terms[3].group == "angle error, orders 9 to 16"
    assert orders_of(catalogue.own_axis(make_chain(), 2, highest=5), 2) == [1, 2, 3, 4, 5]


def test_wobble_is_every_motion_but_the_joints_own(make_chain):
    chain = make_chain()
    terms, size = catalogue.wobble(chain, 4), chain.reach / 1500.0  # lengths are those of an arm of 1.5 m
    assert [int(np.argmax(t.direction)) for t in terms] == [0, 1, 3, 4, 5]
    assert terms[0].prior_std == (5e-4, 5e-4, 2.5e-4, 2.5e-4)
    assert terms[2].prior_std == (0.2 * size, 0.2 * size, 0.1 * size, 0.1 * size)
    assert terms[0].labels[2] == "J4 wobble, rotation about x: cos 2 J4"
    assert {t.group for t in terms} == {"wobble, rotations", "wobble, translations"}


def test_gravity_terms_state_that_masses_are_assumed(make_chain):
    chain = make_chain()
    known = uniform_links(chain, kg_per_m=3.0)
    assert all("uniform link masses assumed" in t.name for t in catalogue.gravity(chain, 2))
    assert not any("uniform" in t.name for t in catalogue.gravity(chain, 2, links=known))
    assert len({(t.direction, t.basis) for t in catalogue.gravity(chain, 0)}) == 9


def test_sliding_joints_have_no_harmonics(make_chain):
    chain = make_chain(sliding=True)
    assert catalogue.own_axis(chain, 3) == catalogue.wobble(chain, 3) == []


def test_interpolation_is_offered_where_angles_are_fine_enough():
    rng = np.random.default_rng(0)
    groups = {
        n: {t.group for t in candidate_terms(turning(rng.uniform(-3, 3, n)))[0] if "interpolation" in t.group}
        for n in (200, 400, 3000)
    }
    assert groups[200] == set()
    assert groups[400] == {"encoder interpolation, order 128"}
    assert groups[3000] == {f"encoder interpolation, order {k}" for k in (128, 256, 512)}


def test_numbers_of_any_kind_are_made_plain():
    orders = tuple(np.arange(1, 3))
    plain = Term("t", 3, (0, 0, 1, 0, 0, 0), Harmonics(1, (1, 2)), "g", (0.5, 0.5, 0.25, 0.25))
    stds = tuple(np.float32([0.5, 0.5, 0.25, 0.25]))
    other = Term(
        "t", np.int64(3), tuple(np.eye(6, dtype=int)[2]), Harmonics(np.int16(1), orders), "g", stds, np.bool_(1)
    )
    assert other == plain
    assert json.dumps(other.as_data()) == json.dumps(plain.as_data())
    one = Term("t", 3, np.eye(6)[2], Harmonics(1, (1, 2)), "g", np.float32(0.5))
    assert one.prior_std == 0.5
    assert type(one.prior_std) is float


@pytest.mark.parametrize("joint", [0, 6])
def test_a_joint_the_arm_does_not_have_is_refused(make_chain, joint):
    for make in (catalogue.own_axis, catalogue.interpolation, catalogue.wobble, catalogue.hysteresis):
        refuses(f"joint from 1 to 5, got {joint}", make, make_chain(), joint)


def test_only_base_and_tip_can_be_free(make_chain):
    refuses("elbow", constants, make_chain(), free=("elbow",))


# What the readings allow


def test_a_state_of_everything_is_offered_everything(make_state):
    state = make_state(n=3000)
    terms, left_out = candidate_terms(state)
    assert left_out == []
    assert len({t.name for t in terms}) == len(terms)
    joints = range(1, 6)
    wanted = [
        *constants(state.chain),
        *(t for j in joints for made in (catalogue.own_axis, catalogue.interpolation) for t in made(state.chain, j)),
        *(t for j in joints for t in catalogue.wobble(state.chain, j)),
        *(t for j in range(6) for t in catalogue.gravity(state.chain, j)),
        *catalogue.thermal(state.chain),
        *(t for j in joints for t in catalogue.hysteresis(state.chain, j)),
    ]
    assert terms[:-1] == wanted
    load = state.columns["load_2_Nm"]
    assert terms[-1] == catalogue.column(state.chain, 2, "load_2_Nm", prior_std=1e-4 / np.std(load))[0]
    for term in terms:
        term.check_place(state.chain)
        assert term.basis.values(state).shape == (term.n_coefficients, 3000)


def test_skipped_terms_have_reasons(make_state):
    state = make_state(n=400, temperature_degC=None, directions=None, columns={"load_tip_N": np.arange(400.0)})
    _, left_out = candidate_terms(state)
    assert left_out == [
        SkippedTerm("thermal expansion", "the readings have no temperature"),
        SkippedTerm("hysteresis", "the directions of movement are not known"),
        SkippedTerm("load_tip_N", "its name does not give a joint, as load_2_Nm does"),
    ]


def test_constant_functions_are_skipped(make_state):
    state = make_state(n=400, temperature_degC=np.full(400, 23.0), columns={"load_1": np.ones(400)})
    terms, left_out = candidate_terms(state)
    assert {reason for _, reason in left_out} == {"it is constant in these readings"}
    assert [name for name, _ in left_out][-1] == "load_1"
    assert len(left_out) == 7
    assert not {"thermal expansion", "load_1"} & {t.group for t in terms}


def test_an_upright_first_joint_bears_no_torque_about_itself():
    state = turning(*np.random.default_rng(0).uniform(-3, 3, (2, 400)))
    terms, left_out = candidate_terms(state)
    names = [x.name for x in left_out]
    assert "gravity torque about z of J1" in names
    assert "gravity torque about z of the base" in names
    assert not any("base" in t.name and "torque about z" in t.name for t in terms)


def test_slow_harmonics_of_a_joint_that_hardly_moved_are_skipped_with_a_reason():
    rng = np.random.default_rng(0)
    state = turning(rng.uniform(-3, 3, 2000), np.radians(np.linspace(-6, 6, 2000)))
    terms, left_out = candidate_terms(state)
    # A quarter of a period is 12 deg at order 7.5.
    assert SkippedTerm("J2 orders 1 to 7", "J2 moved by only 12 deg") in left_out
    assert orders_of(terms, 2) == list(range(8, 111))
    assert orders_of(terms, 1) == list(range(1, 111))
    assert not any(t.name.startswith("J2 wobble") for t in terms)
    band = {t.place: t.name for t in terms if t.group == "angle error, orders 5 to 8"}
    assert band[2] == "J2 angle error, order 8"


def test_a_joint_that_stood_still_has_no_harmonics():
    state = turning(np.linspace(-3, 3, 50), np.full(50, 0.7))
    terms, left_out = candidate_terms(state)
    assert orders_of(terms, 2) == []
    assert SkippedTerm("J2 orders 1 to 110", "J2 moved by only 0 deg") in left_out


@settings(max_examples=25)
@given(st.integers(2, 40), st.floats(-7, 7), st.integers(0, 3), st.integers(0, 100))
def test_offered_harmonics_on_a_graduated_circle_are_distinguishable(n_angles, start, turns, seed):
    """At n angles around a circle, whatever the turn and the jitter, constant and harmonics are independent."""
    rng = np.random.default_rng(seed)
    angles = np.tile(start + np.arange(n_angles) * 2 * np.pi / n_angles, 4)
    angles += 2 * np.pi * rng.integers(0, turns + 1, len(angles)) + rng.normal(0, 1e-5, len(angles))
    state = turning(angles)
    kept = orders_of(candidate_terms(state)[0], 1)
    assert kept == list(range(1, len(kept) + 1))
    assert len(kept) in ((n_angles - 1) // 2, max((n_angles - 1) // 2 - 1, 0))
    assume(kept)
    columns = np.concatenate([np.ones((1, len(angles))), Harmonics(1, tuple(kept)).values(state)])
    # On an exact circle all singular values are within sqrt 2 of each other.
    assert np.linalg.cond(columns) < 2


def test_jitter_about_a_few_angles_does_not_count_as_angles():
    rng = np.random.default_rng(0)
    angles = np.repeat(np.radians([-150, -90, -30, 30, 90, 150]), 100) + np.radians(rng.normal(0, 0.02, 600))
    terms, left_out = candidate_terms(turning(angles))
    assert orders_of(terms, 1) == [1, 2]
    assert SkippedTerm("J1 orders 3 to 110", "J1 has readings at only 6 angles") in left_out


def test_a_sliding_joint_is_offered_the_rest(make_state):
    terms, left_out = candidate_terms(make_state(n=3000, sliding=True, columns={"load_3_N": np.arange(3000.0)}))
    assert left_out == [SkippedTerm("J3 harmonics", "J3 is prismatic")]
    own = [t for t in terms if t.name in ("J3 hysteresis", "J3 translation along z by load_3_N")]
    assert [t.direction for t in own] == [(0, 0, 0, 0, 0, 1)] * 2


@settings(max_examples=30)
@given(st.integers(0, 6), st.integers(0, 1000), st.sampled_from([0.0, 1e-9, 0.1, 1.0, 1e6]), st.integers(0, 100))
def test_any_readings_get_terms_that_they_can_determine(make_state, n, seed, size, highest):
    rng = np.random.default_rng(seed)
    state = make_state(seed % 7, n, angles=size * rng.normal(size=(n, 5)), columns={})
    terms, left_out = candidate_terms(state, highest=highest)
    assert {t.group for t in terms} >= {"base", "tip"}
    assert all(len(x.reason) > 5 for x in left_out)
    assert max((k for j in range(1, 6) for k in orders_of(terms, j)), default=0) <= highest
    assert all(np.isfinite(t.basis.values(state)).all() for t in terms)


# Terms as data


def good_data(**changed) -> dict:
    term = Term("J2 encoder", 2, ABOUT_Z, Harmonics(2, (1, 2)), "encoders", (1e-4, 1e-4, 5e-5, 5e-5))
    return term.as_data() | changed


def test_every_term_of_the_catalogue_comes_back_from_a_file(make_state):
    for sliding in (False, True):
        for term in candidate_terms(make_state(n=200, sliding=sliding))[0]:
            assert Term.from_data(json.loads(json.dumps(term.as_data()))) == term


@given(st.sampled_from(sorted(good_data())), st.data())
def test_hostile_data_make_a_term_or_an_input_error(key, draw):
    plain = st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=6) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
        max_leaves=6,
    )
    try:
        term = Term.from_data(good_data(**{key: draw.draw(plain)}))
    except InputError:
        return
    assert term.prior_stds.shape == (term.n_coefficients,)
    assert (term.prior_stds > 0).all()
    assert len(term.direction) == 6
    assert Term.from_data(json.loads(json.dumps(term.as_data()))) == term


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"name": ""}, "name as text"),
        ({"group": 3}, "group as text"),
        ({"place": -1}, "'J2 encoder'.*place of 0 or more"),
        ({"place": 1.0}, "place of 0 or more"),
        ({"direction": [0] * 6}, "not all zero"),
        ({"direction": [0, 0, 1]}, "6 numbers"),
        ({"direction": [0, 0, 1, 0, 0, float("nan")]}, "finite numbers as direction"),
        ({"direction": "001000"}, "finite numbers as direction"),
        ({"prior_std": 0.0}, "above zero"),
        ({"prior_std": [1e-4]}, "4 prior standard deviations"),
        ({"prior_std": []}, "above zero"),
        ({"prior_std": float("inf")}, "finite numbers as prior_std"),
        ({"prior_std": True}, "finite numbers as prior_std"),
        ({"learn": 1}, "true or false"),
        ({"scale": 1}, "expected a term with"),
    ],
)
def test_invalid_terms_are_refused(changed, says):
    refuses(says, Term.from_data, good_data(**changed))


def test_a_term_needs_a_basis_and_a_place_on_the_chain(make_chain):
    refuses("expected a basis, got str", Term, "a", 1, ABOUT_Z, "Constant", "a", 1e-3)
    refuses(r"0 \(base\) to 6 \(tip\), got 7", Term("a", 7, ABOUT_Z, Constant(), "a", 1e-3).check_place, make_chain())


def test_terms_accept_numpy_numbers():
    term = Term("a", 1, np.array(ABOUT_Z), Column("load_1"), "a", np.float64(1e-3))
    assert term == Term("a", 1, ABOUT_Z, Column("load_1"), "a", 1e-3)
    assert term.prior_stds.tolist() == [1e-3]
