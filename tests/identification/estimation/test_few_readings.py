"""Laws of few readings: what is evaluated one reading at a time is what is evaluated many at a time."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import FEW, PerturbedChain
from truearm.identification.terms import ArmState, Constant, GravityTorque, Harmonics, Term, candidate_terms
from truearm.identification.terms.links import gravity_loads, uniform_links

MANY = 3 * FEW
# Of tips a metre away, double precision.
ROUNDING_MM = 1e-11


def state_of_many(chain: Chain) -> ArmState:
    rng = np.random.default_rng(3)
    n_joints = chain.n_joints
    return ArmState(
        chain,
        rng.uniform(-3, 3, (MANY, n_joints)),
        temperature_degC=rng.uniform(18, 25, MANY),
        directions=rng.choice([-1.0, 1.0], (MANY, n_joints)),
        columns={"load_1_Nm": rng.uniform(-5, 5, MANY)},
    )


@pytest.fixture(scope="module", params=["ur10", "measuring7", "sliding"])
def chain(request: pytest.FixtureRequest) -> Chain:
    if request.param != "sliding":
        return load_arm(request.param).chain
    ur10 = load_arm("ur10").chain
    return Chain(ur10.fixed, ur10.tip_in_flange, [True, False, False, True, False, False])


@pytest.fixture(scope="module")
def result(chain: Chain) -> tuple[IdentificationResult, ArmState]:
    """Terms of every kind with coefficients and a covariance of the size of their priors."""
    state = state_of_many(chain)
    terms, _ = candidate_terms(state, highest=9)
    perturbed_chain = PerturbedChain(chain, tuple(terms))
    std = np.minimum(np.concatenate([term.prior_stds for term in terms]), 0.5)
    rng = np.random.default_rng(4)
    root = rng.standard_normal((len(std), len(std))) / np.sqrt(len(std)) * std
    x = 0.3 * std * rng.standard_normal(len(std))
    return IdentificationResult(perturbed_chain, x, root.T @ root, std, (), (), True, 1), state


def one_by_one(state: ArmState) -> list[ArmState]:
    return [state.rows(np.arange(i, i + 1)) for i in range(5)] + [state.rows(slice(5, 5 + FEW))]


def test_values_and_tips_and_derivatives_are_those_of_many(result):
    fit, state = result
    chain, x = fit.perturbed_chain, fit.coefficients
    values, (tips, covariance) = chain.values(state), fit.uncertain_tips(state)[:2]
    np.testing.assert_array_equal(tips, fit.tips(state))
    columns = np.concatenate([part.copy() for _, _, part in chain.derivatives(state, x)], axis=2)
    first = 0
    for few in one_by_one(state):
        rows = slice(first, first + len(few))
        first += len(few)
        np.testing.assert_allclose(chain.values(few), values[:, rows], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(fit.tips(few), tips[rows], rtol=0, atol=ROUNDING_MM)
        ((_, there, own),) = chain.derivatives(few, x)
        np.testing.assert_allclose(there.T, tips[rows], rtol=0, atol=ROUNDING_MM)
        np.testing.assert_allclose(own, columns[:, :, rows], rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(fit.tip_covariance(few), covariance[rows], rtol=1e-10, atol=1e-12)


def test_poses_of_few_are_those_of_many(chain):
    rng = np.random.default_rng(5)
    q = rng.uniform(-3, 3, (MANY, chain.n_joints))
    motions = 0.01 * rng.standard_normal((MANY, chain.n_places, 6))
    whole = chain.pose(q, motions)
    alone = [chain.pose(q[i : i + 1], motions[i : i + 1]) for i in range(5)]
    np.testing.assert_allclose([one.tip_in_base[0] for one in alone], whole.tip_in_base[:5], rtol=0, atol=ROUNDING_MM)
    np.testing.assert_allclose([one.R_base_tip[0] for one in alone], whole.R_base_tip[:5], rtol=0, atol=1e-14)


def test_an_arm_of_constants_is_the_chain_with_their_motions(chain):
    terms = tuple(
        Term(f"{place} {axis}", place, tuple(np.eye(6)[axis]), Constant(), "constants", 1e-3)
        for place in range(chain.n_places)
        for axis in range(6)
    )
    constant = PerturbedChain(chain, terms)
    state, x = state_of_many(chain), 1e-3 * np.random.default_rng(6).standard_normal(len(terms))
    motions = constant.motions(x, constant.values(state))[:, :, 0]
    moved = chain.tip_in_base(state.angles, np.broadcast_to(motions, (MANY, *motions.shape)))
    np.testing.assert_allclose(constant.tips(state, x), moved, rtol=0, atol=ROUNDING_MM)
    # With terms that move nothing beside them, as those that a model does not have, it is the same arm.
    beside = PerturbedChain(chain, (*terms, Term("none", 2, (0, 0, 1, 0, 0, 0), Harmonics(2, (1,)), "none", 1e-3)))
    pair = (next(beside.derivatives(state, np.append(x, rest)))[2].copy() for rest in ([0, 0], [1e-12, 0]))
    np.testing.assert_allclose(*pair, rtol=0, atol=1e-6)


@pytest.mark.parametrize("basis", [Harmonics(7, (1, 2)), GravityTorque(7, 0)])
def test_a_joint_that_the_arm_does_not_have_is_refused_in_few_and_in_many(basis):
    chain = load_arm("ur10").chain
    perturbed_chain = PerturbedChain(chain, (Term("it", 1, (0, 0, 1, 0, 0, 0), basis, "group", 1e-3),))
    for state in (state_of_many(chain), state_of_many(chain).rows(slice(0, 1))):
        with pytest.raises((InputError, IndexError)):
            perturbed_chain.values(state)


def test_gravity_loads_are_sums_over_the_links_outward(chain):
    """Torque ``sum m_k (c_k - o_i) x g`` and force, by the poses of every link as a chain of its own."""
    rng = np.random.default_rng(7)
    q, links, g = (
        rng.uniform(-3, 3, (4, chain.n_joints)),
        uniform_links(chain, kg_per_m=2.0),
        np.array([1.0, 2.0, -9.0]),
    )
    loads = gravity_loads(chain, q, links, gravity_in_base=g)

    def place(i: int, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation of place i (counted from 0) and a point of it, in the base frame."""
        ends = np.concatenate([chain.fixed[: i + 1], np.eye(4)[None]])
        pose = Chain(ends, tip, chain.is_prismatic[: i + 1]).pose(q[:, : i + 1])
        return pose.R_base_tip, pose.tip_in_base

    for i in range(chain.n_joints):
        R, origin = place(i, np.zeros(3))
        arms = [
            (place(k, links.centre_in_joint_mm[k])[1] - origin) * links.mass_kg[k] for k in range(i, chain.n_joints)
        ]
        torque = np.cross(np.sum(arms, axis=0), g) / 1000
        np.testing.assert_allclose(loads.torque_in_joint[:, i], np.einsum("nab,na->nb", R, torque), atol=1e-11)
        force = links.mass_kg[i:].sum() * np.einsum("nab,a->nb", R, g)
        np.testing.assert_allclose(loads.force_in_joint[:, i], force, atol=1e-12)
    for row, pose in enumerate(q):
        alone = gravity_loads(chain, [pose], links, gravity_in_base=g)
        np.testing.assert_allclose(alone.torque_in_joint[0], loads.torque_in_joint[row], atol=1e-11)
        np.testing.assert_allclose(alone.force_in_joint[0], loads.force_in_joint[row], atol=1e-12)


def test_no_uncertain_coefficient_gives_no_covariance(result):
    fit, state = result
    known = replace(fit, covariance=np.zeros_like(fit.covariance))
    assert (known.tip_covariance(state.rows(slice(0, 2))) == 0).all()
