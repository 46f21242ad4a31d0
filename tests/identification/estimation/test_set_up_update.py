"""Base and tip identified anew and the arm updated: against dense algebra, and against many planted arms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from truearm.arm.chain import Chain
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.set_up_update import update_in_set_up
from truearm.identification.references.references import Points, seats_of
from truearm.identification.terms import ArmState, constants
from truearm.identification.terms.catalogue import own_axis

NOISE = 0.02  # mm
ANEW = ("base", "tip")


def zigzag() -> Chain:
    """Three axes that turn by 90 degrees from joint to joint, a reach of some 500 mm."""
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [40, 0, 150]
    return Chain(fixed, np.array([10, 20, 60.0]))


def rigid(angle, shift):
    """A turn about an oblique axis [rad], and a shift [mm]."""
    chain = zigzag().with_reference_frame(np.eye(4))
    motions = np.zeros((chain.n_places, 6))
    motions[0] = [*(np.array([0.6, 0.0, 0.8]) * angle), *shift]
    return chain.with_motions(motions).fixed[0] @ np.linalg.inv(chain.fixed[0])


@pytest.fixture(scope="module")
def known():
    """A fit to 60 readings of an arm that is a little off its drawing, with its terms and state."""
    rng = np.random.default_rng(7)
    chain = zigzag()
    terms = constants(chain, free=ANEW, angle_std=1e-3, length_std=0.3)
    terms += [term for joint in (1, 2, 3) for term in own_axis(chain, joint, highest=2)]
    perturbed_chain = PerturbedChain(chain, tuple(terms))
    stds = np.concatenate([term.prior_stds for term in terms])
    x = np.where(stds < 0.5, stds, 0) * rng.normal(size=len(stds))
    state = ArmState(chain, rng.uniform(-1, 1, (60, 3)))
    points = perturbed_chain.tips(state, x) + rng.normal(0, NOISE, (60, 3))
    return identify(chain, state, terms, [Points(np.arange(60), points)])


def new_session(known, rng, n, *, T=None, tip=(0.0, 0.0, 0.0), x=None, half_width=1.0):
    """A chain placed by `T`, with the tip moved on the flange: state, points without noise, as the arm `x` gives."""
    chain = known.perturbed_chain.chain.with_reference_frame(np.eye(4) if T is None else T)
    chain = chain.with_tip(chain.tip_in_flange + np.array(tip))
    state = ArmState(known.perturbed_chain.chain, half_width * rng.uniform(-1, 1, (n, 3)))
    return state, PerturbedChain(chain, known.perturbed_chain.terms).tips(state, known.coefficients if x is None else x)


def anew(known, state, points, *, T=None, free=ANEW, unexplained_std=NOISE, robust=True):
    """Refitted to points, from a chain placed near `T`."""
    chain = known.perturbed_chain.chain.with_reference_frame(np.eye(4) if T is None else T)
    terms = constants(chain, free=free, angle_std=0.0, length_std=0.0)
    reference = Points(np.arange(len(points)), points)
    return update_in_set_up(known, chain, state, terms, [reference], unexplained_std=unexplained_std, robust=robust)


def change_of(known):
    """(n,) the standard deviations of changes for a share of 1: those of the arm's own terms."""
    stds = np.repeat(
        [0 < t.place <= 3 for t in known.perturbed_chain.terms], [t.n_coefficients for t in known.perturbed_chain.terms]
    )
    equivalent = known.columns_of(lambda term: term.group.startswith("equivalent to a free"))
    return known.prior_std * stds * ~equivalent


def test_answer_and_covariance_are_those_of_dense_algebra(known):
    """The posterior under a prior P + tau^2 D, flat for base and tip, written out with inverses; tau by a scan."""
    rng = np.random.default_rng(1)
    state, points = new_session(known, rng, 8, tip=(1.0, -2.0, 1.0))
    points = points + rng.normal(0, NOISE, points.shape)
    found = anew(known, state, points, robust=False)
    # The terms of base and tip stand behind the others now.
    where = [known.perturbed_chain.terms.index(term) for term in found.perturbed_chain.terms]
    starts = np.cumsum([0, *(term.n_coefficients for term in known.perturbed_chain.terms)])
    order = np.concatenate([np.arange(starts[i], starts[i + 1]) for i in where])
    P, x = known.covariance[np.ix_(order, order)], known.coefficients[order]
    D = np.diag(change_of(known)[order] ** 2)
    P[-9:], P[:, -9:] = 0.0, 0.0
    ((_, _, columns),) = list(found.perturbed_chain.derivatives(state, found.coefficients))
    J = columns.reshape(len(x), -1).T
    R = found.references[0].noise_std ** 2 * np.eye(len(J))
    r = (points - found.tips(state)).T.ravel() + J @ (found.coefficients - x)
    Q = np.linalg.qr(J[:, -9:], mode="complete")[0][:, 9:]

    def cost(log_ratio):
        S = Q.T @ (R + J @ (P + (0.1 * np.exp(log_ratio)) ** 2 * D) @ J.T) @ Q
        return (np.linalg.slogdet(S)[1] + (Q.T @ r) @ np.linalg.solve(S, Q.T @ r) + (log_ratio / np.log(5)) ** 2) / 2

    scan = np.linspace(-4, 4, 1601)
    best = scan[np.argmin([cost(one) for one in scan])]
    flat = np.diag([0.0] * (len(x) - 9) + [1e-2] * 3 + [1e3] * 6)

    def posterior(share):
        V = P + share**2 * D + flat
        K = np.linalg.solve(R + J @ V @ J.T, J @ V).T
        return K @ r, (np.eye(len(x)) - K @ J) @ V @ (np.eye(len(x)) - K @ J).T + K @ R @ K.T

    _, covariance = posterior(0.1 * np.exp(best))
    off, _ = posterior(0.1 * np.exp(best))
    # The rounds stop within a twentieth of the logarithm of tau, which moves the tips by a few micrometres.
    np.testing.assert_allclose(J @ (found.coefficients - x), J @ off, rtol=0, atol=0.1 * NOISE)
    # For the covariance tau is raised to its root mean square.
    tips = np.einsum("ij,jk,ik->i", J, covariance, J)
    stated = np.einsum("ij,jk,ik->i", J, found.covariance, J)
    assert (stated > 0.95 * tips).all()
    assert (stated < 1.2 * NOISE**2).all()


@pytest.mark.parametrize("changed", [pytest.param(0.0, marks=pytest.mark.weekly), 0.3])
def test_an_arm_that_changed_is_identified_again_and_the_uncertainty_holds(known, changed):
    """Planted changes of every joint term by a share of its prior standard deviation, unknown to the update."""
    rng = np.random.default_rng(21)
    root, size = np.linalg.cholesky(known.covariance), change_of(known)
    asked = ArmState(known.perturbed_chain.chain, rng.uniform(-1, 1, (20, 3)))
    squares, errors, unchanged = [], [], []
    for _ in range(40):
        x = known.coefficients + root @ rng.normal(size=len(root)) + changed * size * rng.normal(size=len(root))
        state, points = new_session(known, rng, 20, x=x)
        found = anew(known, state, points + rng.normal(0, NOISE, points.shape))
        truth = PerturbedChain(known.perturbed_chain.chain, known.perturbed_chain.terms).tips(asked, x)
        off = found.tips(asked) - truth
        squares.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.tip_covariance(asked)), off))
        errors.append((off**2).mean())
        exact = replace(known, covariance=np.zeros_like(known.covariance), prior_std=np.zeros_like(known.prior_std))
        unchanged.append(((anew(exact, state, points).tips(asked) - truth) ** 2).mean())
    # Rows of one arm are alike: of 40 arms a share of 0.95 is known to 0.035.
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 3)) > 0.88
    if changed:
        assert np.mean(errors) < 0.5 * np.mean(unchanged)


@pytest.mark.parametrize(("n", "most"), [(5, 1.0), pytest.param(40, 0.98, marks=pytest.mark.weekly)])
def test_stated_uncertainty_is_right_for_many_arms_and_set_ups(known, n, most):
    """True arms drawn from the posterior, each seen anew in a few poses and asked at others.

    Noise that never shrinks makes it too large where 6 degrees of freedom must tell it, not where 111 do.
    """
    rng = np.random.default_rng(n)
    root = np.linalg.cholesky(known.covariance)
    asked = ArmState(known.perturbed_chain.chain, rng.uniform(-1, 1, (20, 3)))
    squares = []
    for _ in range(60):
        x = known.coefficients + root @ rng.normal(size=len(root))
        T, tip = rigid(rng.uniform(-3, 3), rng.uniform(-500, 500, 3)), rng.uniform(-5, 5, 3)
        state, points = new_session(known, rng, n, T=T, tip=tip, x=x, half_width=1.5)
        found = anew(known, state, points + rng.normal(0, NOISE, points.shape), T=T)
        chain = known.perturbed_chain.chain.with_reference_frame(T)
        truth = PerturbedChain(chain.with_tip(chain.tip_in_flange + tip), known.perturbed_chain.terms).tips(asked, x)
        off = found.tips(asked) - truth
        squares.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.tip_covariance(asked)), off))
    # Of 60 independent arms, a share of 0.95 is known to 0.03, rows of one arm being alike.
    assert 0.89 < np.mean(np.array(squares) < chi2.ppf(0.95, 3)) <= most
    assert 1.5 < np.mean(squares) < 4.0


def test_many_readings_identify_the_arm_again(known):
    """400 new readings identify the arm as 400 do, and 60 before."""
    rng = np.random.default_rng(3)
    state, points = new_session(known, rng, 400)
    found = anew(known, state, points + rng.normal(0, NOISE, points.shape))
    before, after = (np.trace(fit.tip_covariance(state), axis1=1, axis2=2) for fit in (known, found))
    assert 60 / 460 / 2 < np.median(after) / np.median(before) < 60 / 400 * 2


@pytest.mark.parametrize("n", [4, 6, 20])
def test_a_probe_a_foot_longer_is_identified_from_few_readings(known, n):
    rng = np.random.default_rng(n)
    T = rigid(2.5, [900, -400, 1200])
    state, points = new_session(known, rng, n, T=T, tip=(-80, 120, 300), half_width=1.5)
    found = anew(known, state, points, T=rigid(2.3, [800, -300, 1100]))
    assert found.converged
    # Stops within a hundredth of an uncertainty, which is some hundredths of a millimetre with n readings.
    np.testing.assert_allclose(found.tips(state), points, rtol=0, atol=2e-3)


def test_one_gross_error_hardly_moves_the_frame(known):
    rng = np.random.default_rng(4)
    state, points = new_session(known, rng, 20)
    points = points + rng.normal(0, NOISE, points.shape)
    clean = anew(known, state, points)
    points[7] += [8.0, -5.0, 3.0]
    found = anew(known, state, points)
    assert found.references[0].robust_weight.argmin() == 7
    assert found.references[0].robust_weight[7] < 0.02
    # An influence of 4 standard deviations among 20 readings; without weights it moved the tips by half a millimetre.
    assert np.abs(found.tips(state) - clean.tips(state)).max() < 4 * NOISE
    assert np.abs(anew(known, state, points, robust=False).tips(state) - clean.tips(state)).max() > 0.3


def test_noise_is_kept_unless_the_readings_say_more(known):
    rng = np.random.default_rng(5)
    state, points = new_session(known, rng, 30)
    noise = rng.normal(size=points.shape)

    def noise_found(std):
        return anew(known, state, points + std * noise).references[0].noise_std

    assert noise_found(NOISE / 5) == pytest.approx(NOISE, rel=1e-12)
    # 81 degrees of freedom tell a standard deviation to 8 %.
    assert NOISE <= noise_found(NOISE) < 1.2 * NOISE
    assert noise_found(4 * NOISE) == pytest.approx(4 * NOISE, rel=0.25)


def test_a_frame_moved_moves_the_answer_and_nothing_else(known):
    rng = np.random.default_rng(6)
    state, points = new_session(known, rng, 12)
    points = points + rng.normal(0, NOISE, points.shape)
    T = rigid(1.0, [100, 200, -300])
    here, there = anew(known, state, points), anew(known, state, points @ T[:3, :3].T + T[:3, 3], T=T)
    # One part in 1e6 of an uncertainty of 0.01 mm, by rounding.
    np.testing.assert_allclose(there.tips(state), here.tips(state) @ T[:3, :3].T + T[:3, 3], rtol=0, atol=1e-6)
    turned = T[:3, :3] @ here.tip_covariance(state) @ T[:3, :3].T
    np.testing.assert_allclose(there.tip_covariance(state), turned, rtol=0, atol=1e-5 * turned.max())


def test_only_free_parts_change(known):
    rng = np.random.default_rng(8)
    state, points = new_session(known, rng, 12, tip=(1.0, 2.0, 3.0))
    found = anew(known, state, points, free=("tip",))
    changed = {
        term.name
        for i, term in enumerate(found.perturbed_chain.terms)
        if term not in known.perturbed_chain.terms
        or not np.isin(found.coefficients[_slice(found, i)], known.coefficients).all()
    }
    assert {"tip translation along x", "tip translation along y", "tip translation along z"} <= changed
    np.testing.assert_allclose(found.tips(state), points, rtol=0, atol=2e-3)


def _slice(fit, i):
    starts = np.cumsum([0, *(term.n_coefficients for term in fit.perturbed_chain.terms)])
    return slice(starts[i], starts[i + 1])


def test_seats_determine_the_tip(known):
    """The true tip is 2 mm off along each axis; poses that hold it in two seats are found by iteration."""
    from scipy.optimize import least_squares

    rng = np.random.default_rng(9)
    chain = known.perturbed_chain.chain.with_tip(known.perturbed_chain.chain.tip_in_flange + [2.0, -2.0, 2.0])
    true = PerturbedChain(chain, known.perturbed_chain.terms)

    def tip(angles):
        return true.tips(ArmState(known.perturbed_chain.chain, angles[None]), known.coefficients)[0]

    # Three joints hold a point in a few poses only: seats within reach of several elbows.
    angles, names = [], []
    for name, start in (("A", [0.2, 0.5, 0.4]), ("B", [0.5, -0.4, 0.6]), ("C", [-0.6, 0.3, -0.5])):
        seat = tip(np.array(start))
        for _ in range(12):
            fit = least_squares(lambda q, seat=seat: tip(q) - seat, rng.uniform(-3, 3, 3), xtol=1e-14, ftol=1e-14)
            if np.abs(fit.fun).max() < 1e-6 and all(np.abs(fit.x - other).max() > 0.01 for other in angles):
                angles.append(fit.x)
                names.append(name)
    assert len(angles) >= 8
    state = ArmState(known.perturbed_chain.chain, np.array(angles))
    terms = constants(known.perturbed_chain.chain, free=("tip",), angle_std=0.0, length_std=0.0)
    references = [seats_of(np.arange(len(angles)), np.array(names))]
    found = update_in_set_up(known, known.perturbed_chain.chain, state, terms, references, unexplained_std=NOISE)
    tip_before = known.coefficients[
        [known.perturbed_chain.terms.index(term) for term in found.perturbed_chain.terms[-3:]]
    ]
    off = found.coefficients[-3:] - tip_before - [2.0, -2.0, 2.0]
    std = np.sqrt(found.covariance.diagonal()[-3:])
    assert (np.abs(off) < 0.05 * std + 1e-3).all()  # exact readings: it stops within a hundredth of its uncertainty


def test_an_arm_known_exactly_has_the_plain_least_squares_answer(known):
    """P = D = 0: the covariance of base and tip is (A^T A)^-1 times the noise's variance, and nothing else has any."""
    rng = np.random.default_rng(10)
    state, points = new_session(known, rng, 10)
    exact = replace(known, covariance=np.zeros_like(known.covariance), prior_std=np.zeros_like(known.prior_std))
    found = anew(exact, state, points, robust=False)
    ((_, _, columns),) = list(found.perturbed_chain.derivatives(state, found.coefficients))
    A = columns[-9:].reshape(9, -1)
    np.testing.assert_allclose(found.covariance[-9:, -9:], NOISE**2 * np.linalg.inv(A @ A.T), rtol=1e-4)
    assert not found.covariance[:-9].any()
