"""The problem of terms and references: derivatives, sums without the Jacobian against the Jacobian, pieces, threads."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from truearm.arm import Chain
from truearm.identification.estimation import problem as problem_module
from truearm.identification.estimation.perturbed_chain import FEW, PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.references.references import LinearisedResiduals, Points, seats_of
from truearm.identification.terms import ArmState, Constant, Harmonics, Temperature, Term, candidate_terms, constants
from truearm.identification.terms.catalogue import interpolation, own_axis
from truearm.solve.arrowhead import Arrowhead

ROUNDING_MM = 1e-9


def random_chain(rng: np.random.Generator, n: int = 4, *, slides: int | None = None) -> Chain:
    fixed = np.tile(np.eye(4), (n + 1, 1, 1))
    fixed[:, :3, :3] = Rotation.random(n + 1, rng=rng).as_matrix()
    fixed[:, :3, 3] = rng.normal(0, 300, (n + 1, 3))
    return Chain(fixed, rng.normal(0, 100, 3), np.arange(n) == (-1 if slides is None else slides))


def random_state(chain: Chain, n: int, rng: np.random.Generator) -> ArmState:
    angles = rng.uniform(-3, 3, (n, chain.n_joints)) * np.where(chain.is_prismatic, 100, 1)
    return ArmState(
        chain,
        angles,
        temperature_degC=rng.uniform(15, 30, n),
        directions=rng.choice([-1.0, 1.0], angles.shape),
        columns={"load_2_Nm": rng.normal(0, 3, n)},
    )


@dataclass(frozen=True, eq=False)
class Pointer:
    """A reference whose residuals depend on the tip, on the flange's turn and on one unknown, in no linear way."""

    rows: np.ndarray
    target: np.ndarray
    kind = "pointer"
    n_residuals = 2
    uses_orientation = True
    unknowns = ("along [mm]",)

    @property
    def std(self):
        return np.zeros((2, len(self.rows)))

    def initialise(self, tips):
        return self, np.zeros(1)

    def linearised(self, tips, unknowns, which, axes=None):
        # a beam of 50 mm along the flange's z, and the square of its end's distance to a target
        beam = 50.0 * axes[:, 2]
        end = tips + beam + unknowns[0] * axes[:, 0]
        arm = beam + unknowns[0] * axes[:, 0]
        away = end - self.target[:, None]
        m = tips.shape[1]
        by_tip = np.stack([2 * away / 1000, np.broadcast_to(np.array([[1.0], [0], [0]]), (3, m))])
        by_turn = np.stack([np.cross(arm, g, axis=0) for g in by_tip])  # g . (w x arm) = w . (arm x g)
        by_unknown = np.einsum("kcm,cm->km", by_tip, axes[:, 0])[:, None]
        residuals = np.stack([(away**2).sum(axis=0) / 1000, end[0]])
        return LinearisedResiduals(residuals, by_tip, np.zeros((1, m), np.intp), by_unknown, by_turn)

    def constraints(self, unknowns):
        return None


def everything(seed: int, *, n: int = 21, slides: int | None = None, highest: int = 14, size: float = 1.0):
    """Problem, parameters and weights: all candidate terms, points, seats with a length, a pointer."""
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, slides=slides)
    state = random_state(chain, n, rng)
    terms, _ = candidate_terms(state, free=(), highest=highest)
    skew = Term("screw", 2, (0.3, 0, 1, 5, 0, 2), Harmonics(1, (2, 5)), "screws", 1e-3)
    perturbed_chain = PerturbedChain(chain, (*terms, skew))
    points = Points(np.arange(0, n), chain.tip_in_base(state.angles) + rng.normal(size=(n, 3)))
    names = np.array([f"s{i % 3}" for i in range(n - 4)])
    seats = seats_of(rng.permutation(n)[: n - 4], names, [("s0", "s1", 400.0, 0.1), ("s2", "s1", 500.0, 0.2)])
    pointer = Pointer(np.arange(0, n, 2), rng.normal(0, 100, 3))
    problem = SmallMotionProblem(perturbed_chain, state, (points, seats, pointer))
    prior = np.concatenate([term.prior_stds for term in perturbed_chain.terms])
    x = np.concatenate([size * prior * rng.normal(size=len(prior)), rng.normal(0, 300, 10)])
    weights = [rng.uniform(0.5, 2, (r.n_residuals, len(r.rows))) for r in problem.references]
    return problem, x, weights


def stacked(problem, x, weights):
    found = problem.residuals(x)
    return np.concatenate([(w * r).ravel() for w, r in zip(weights, found, strict=True)])


def jacobian(problem, x, weights):
    """By differences to fourth order; steps of a thirtieth of a coefficient's usual size, of a mm for unknowns."""
    prior = np.concatenate([term.prior_stds for term in problem.perturbed_chain.terms])
    steps = np.concatenate([0.03 * prior, np.ones(len(x) - len(prior))])
    columns = []
    for i, step in enumerate(steps):
        change = np.zeros(len(x))
        change[i] = step
        one = stacked(problem, x + change, weights) - stacked(problem, x - change, weights)
        two = stacked(problem, x + 2 * change, weights) - stacked(problem, x - 2 * change, weights)
        columns.append((8 * one - two) / (12 * step))
    return np.stack(columns, axis=1)


def summed(problem, x, weights):
    whole = Arrowhead.combine(problem.normal_equations(x, weights))
    return whole.cost, whole.gradient, whole.dense()


def assert_same_equations(found, expected, rtol=1e-10):
    """Matrices in the scale of their own diagonals, gradients in that of what residuals could make of them."""
    np.testing.assert_allclose(found[0], expected[0], rtol=rtol)
    size = np.sqrt(np.maximum(expected[2].diagonal(), 1e-300))
    np.testing.assert_allclose((found[1] - expected[1]) / size / np.sqrt(2 * expected[0]), 0, atol=rtol)
    np.testing.assert_allclose((found[2] - expected[2]) / np.outer(size, size), 0, atol=rtol)


# Derivatives


@pytest.mark.parametrize(
    ("seed", "slides", "size"), [(1, 2, 1.0), pytest.param(2, None, 30.0, marks=pytest.mark.weekly)]
)
def test_gradient_and_matrix_are_those_of_a_dense_jacobian_by_differences(seed, slides, size):
    """At motions of their usual size, and thirty times that (0.1 rad, 100 mm), where first order would not do."""
    problem, x, weights = everything(seed, slides=slides, size=size)
    J, r = jacobian(problem, x, weights), stacked(problem, x, weights)
    # Steps of 1e-4 rad, or orders below it, of motions that bend over a radian: 1e-12 by truncation; rounding leaves
    # 1e-12 mm / (1e-5 rad x 1e3 mm) = 1e-10.
    assert_same_equations(summed(problem, x, weights), (0.5 * r @ r, J.T @ r, J.T @ J), rtol=3e-8)


def test_a_sum_of_derivatives_along_vectors_is_that_of_all_derivatives(rng):
    """Of many readings in one pass, and of a few at once: the two ways to the derivatives along a tilted direction."""
    problem, x, _ = everything(4, n=FEW + 20)
    chain, state, pulls = problem.perturbed_chain, problem.state, rng.normal(size=(3, FEW + 20))
    x = x[: chain.n_coefficients]
    expected = np.zeros(chain.n_coefficients)
    for rows in (slice(0, FEW), slice(FEW, None)):
        ((_, _, columns),) = chain.derivatives(state.rows(rows), x)
        expected += np.einsum("pcm,cm->p", columns, pulls[:, rows])
    np.testing.assert_allclose(chain.gradient(state, x, pulls), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("n", [30, FEW + 30])
def test_motions_are_the_sums_of_the_terms(rng, n):
    """Of long series along one component, the same along two, short ones before, between and after; in any order."""
    chain = random_chain(rng)
    series = [Harmonics(joint, tuple(range(1, 41))) for joint in (1, 2)]
    terms = [
        Term("tilt", 1, (1.0, 0, 0, 0, 0, 0), Harmonics(1, (1, 2)), "tilt", 1e-4),
        Term("gear", 1, (0.0, 0, 1, 0, 0, 0), series[0], "gear", 1e-4),
        Term("zero", 1, (0.0, 0, 1, 0, 0, 0), Constant(), "zero", 1e-3),
        Term("lift", 1, (0.0, 0, 0, 0, 0.5, 0), Constant(), "zero", 1e-3),
        Term("screw", 2, (0.0, 0, 1, 0, 0, 2), series[1], "screw", 1e-4),
        Term("other", 2, (0.0, 0, 0, 0, 0, 1), Harmonics(2, tuple(range(50, 90))), "other", 1e-4),
        Term("later", 3, (0.0, 0, 1, 0, 0, 0), Harmonics(3, (5, 9)), "later", 1e-4),
        *(
            Term("more", 3, (0.0, 0, 1, 0, 0, 0), Harmonics(3, tuple(range(k, k + 8))), "more", 1e-4)
            for k in (10, 18, 26)
        ),
        Term("sooner", 3, (0.0, 0, 1, 0, 0, 0), Harmonics(3, (1, 2, 4)), "sooner", 1e-4),
        Term("far", 3, (1.0, 0, 1, 0, 0, 0), Harmonics(2, tuple(range(90, 120))), "far", 1e-4),
    ]
    arm, state = PerturbedChain(chain, tuple(terms)), random_state(chain, n, rng)
    x, expected = rng.normal(size=arm.n_coefficients), np.zeros((chain.n_places, 6, n))
    for term, columns in zip(terms, arm.columns, strict=True):
        expected[term.place] += np.multiply.outer(term.direction, x[columns] @ term.basis.values(state))
    np.testing.assert_allclose(arm.motions(x, arm.values(state)), expected, rtol=0, atol=1e-12)
    pulls = rng.normal(size=(3, n))
    ((_, _, columns),) = arm.derivatives(state, 1e-4 * x)
    dense = np.einsum("pcm,cm->p", columns, pulls)
    np.testing.assert_allclose(arm.gradient(state, 1e-4 * x, pulls), dense, rtol=0, atol=1e-10 * np.abs(dense).max())


def test_changes_of_residuals_are_those_by_differences(rng):
    problem, x, _ = everything(4, n=FEW + 20)
    n = problem.perturbed_chain.n_coefficients
    step = np.concatenate([1e-4 * x[:n] * rng.normal(size=n), np.zeros(len(x) - n)])
    changes = problem.changes(x, step[:n], problem.residuals(x))
    for change, one, other in zip(changes, problem.residuals(x + step), problem.residuals(x - step), strict=True):
        quotient = (one - other) / 2
        # A part in 1e7 is of third order in steps of 1e-4 of usual motions; rounding leaves 1e-12 mm.
        np.testing.assert_allclose(change, quotient, rtol=0, atol=1e-7 * np.abs(quotient).max() + 1e-11)


def test_relations_are_those_of_a_dense_jacobian_by_differences():
    problem, x, _ = everything(3)

    def residuals(x):
        seats = problem.references[1].constraints(x[problem.unknowns_of(1)])
        return seats.residuals / seats.std

    step = 1e-2  # mm; the residual is a square: exact but for rounding
    J = np.stack([(residuals(x + step * e) - residuals(x - step * e)) / (2 * step) for e in np.eye(len(x))], axis=1)
    found = problem.constraints(x)
    r = residuals(x)
    assert found.cost == pytest.approx(0.5 * r @ r)
    assert problem.constraints_cost(x) == pytest.approx(found.cost)
    np.testing.assert_allclose(found.gradient, J.T @ r, atol=1e-7 * np.abs(J.T @ r).max())
    np.testing.assert_allclose(found.dense(), J.T @ J, atol=1e-7 * np.abs(J.T @ J).max())


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), st.sampled_from([None, 0, 3]))
def test_tips_and_their_derivatives(seed, slides):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, slides=slides)
    state = random_state(chain, 5, rng)
    terms, _ = candidate_terms(state, free=(), highest=2)
    perturbed_chain = PerturbedChain(chain, tuple(terms))
    prior = np.concatenate([term.prior_stds for term in terms])
    x = prior * rng.normal(size=len(prior))
    ((_, tips, columns),) = perturbed_chain.derivatives(state, x)
    np.testing.assert_allclose(tips.T, perturbed_chain.tips(state, x), atol=ROUNDING_MM, rtol=0)
    for i in rng.choice(len(x), 8, replace=False):
        step = np.zeros(len(x))
        step[i] = 0.1 * prior[i]
        quotient = (perturbed_chain.tips(state, x + step) - perturbed_chain.tips(state, x - step)) / (2 * step[i])
        # second order in steps of 3e-4 rad at most: 1e-7 of the whole
        np.testing.assert_allclose(columns[i].T, quotient, atol=1e-6 * max(1, np.abs(quotient).max()))


def test_constant_terms_alone_are_the_chain_with_constants():
    rng = np.random.default_rng(4)
    chain = random_chain(rng)
    state = random_state(chain, 6, rng)
    perturbed_chain = PerturbedChain(chain, tuple(constants(chain)))
    x = rng.normal(size=perturbed_chain.n_coefficients) * 0.01
    np.testing.assert_allclose(
        perturbed_chain.tips(state, x), perturbed_chain.with_constants(x).tip_in_base(state.angles), atol=ROUNDING_MM
    )


def test_a_term_by_hand():
    """A shift along x at the base, 2 + 3 (T - 20) mm: a metre of arm moves with it, along the frame's axes."""
    rng = np.random.default_rng(5)
    chain = random_chain(rng)
    state = random_state(chain, 6, rng)
    along_x = (0.0, 0, 0, 1, 0, 0)
    terms = (Term("a", 0, along_x, Constant(), "a", 1.0), Term("b", 0, along_x, Temperature(), "b", 1.0))
    tips = PerturbedChain(chain, terms).tips(state, np.array([2.0, 3.0]))
    shift = (2 + 3 * (state.temperature_degC - 20))[:, None] * chain.fixed[0, :3, 0]
    np.testing.assert_allclose(tips, chain.tip_in_base(state.angles) + shift, atol=ROUNDING_MM)


def test_no_terms_leave_the_chain():
    rng = np.random.default_rng(6)
    chain = random_chain(rng)
    state = random_state(chain, 6, rng)
    nothing = PerturbedChain(chain, ())
    np.testing.assert_allclose(nothing.tips(state, np.zeros(0)), chain.tip_in_base(state.angles), atol=ROUNDING_MM)
    ((_, tips, columns),) = nothing.derivatives(state, np.zeros(0))
    assert columns.shape == (0, 3, 6)
    problem = SmallMotionProblem(nothing, state, (Points(np.arange(6), tips.T + 1.0),))
    (found,) = problem.normal_equations(np.zeros(0), [np.ones((3, 6))])
    assert found.cost == pytest.approx(9.0)
    assert found.dense().shape == (0, 0)


# The arm's size


def seats_only(rng, chain, state, terms, n_seats=3):
    seats = seats_of(np.arange(len(state)), np.array([f"s{i % n_seats}" for i in range(len(state))]))
    return SmallMotionProblem(PerturbedChain(chain, tuple(terms)), state, (seats,)), np.zeros(3 * n_seats)


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), st.sampled_from([None, 2]))
def test_growth_and_its_gradient(seed, slides):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, slides=slides)
    state = random_state(chain, 12, rng)
    terms, _ = candidate_terms(state, free=(), highest=2)
    problem, unknowns = seats_only(rng, chain, state, terms)
    prior = np.concatenate([term.prior_stds for term in terms])
    x = np.concatenate([prior * rng.normal(size=len(prior)), unknowns])
    gradient = problem.log_size_ratio_gradient(x)
    assert not gradient[len(prior) :].any()
    for i in rng.choice(len(prior), 10, replace=False):
        step = np.zeros(len(x))
        step[i] = 0.1 * prior[i]
        quotient = (problem.log_size_ratio(x + step) - problem.log_size_ratio(x - step)) / 0.2
        # by an usual coefficient an arm grows by 1e-2 at most; to second order in a tenth of it
        assert prior[i] * gradient[i] == pytest.approx(quotient, abs=1e-5)


@pytest.mark.parametrize("n_seats", [1, 3])
def test_an_arm_one_per_cent_larger_has_grown_by_that(n_seats):
    """All its links longer, wherever it stands; a single seat, whose tips keep together, tells it as well."""
    rng = np.random.default_rng(14)
    chain = random_chain(rng)
    state = random_state(chain, 12, rng)
    links = [*chain.fixed[1:, :3, 3], chain.tip_in_flange]
    terms = [
        Term(f"{i}", i + 1, (0.0, 0.0, 0.0, *(link / 100)), Constant(), "all", 1.0) for i, link in enumerate(links)
    ]
    terms += constants(chain, free=("base",), angle_std=0, length_std=0)
    problem, unknowns = seats_only(rng, chain, state, terms, n_seats)
    anywhere = np.array([0.3, -0.2, 0.1, 500, -900, 40])
    x = np.concatenate([np.ones(len(links)), anywhere, unknowns])
    assert problem.log_size_ratio(x) == pytest.approx(np.log(1.01), rel=1e-9)
    x[: len(links)] = 0
    assert problem.log_size_ratio(x) == pytest.approx(0, abs=1e-12)
    assert not problem.log_size_ratio_gradient(x)[len(links) : len(links) + 6].any()


def test_points_alone_leave_growth_out():
    problem, x, _ = everything(15)
    points = SmallMotionProblem(problem.perturbed_chain, problem.state, problem.references[:1])
    assert points.log_size_ratio(x[: points.n_parameters]) == 0
    assert not points.log_size_ratio_gradient(x[: points.n_parameters]).any()


# Sums


@pytest.mark.parametrize("chunk", [1, 4, 20, 21, 100])
def test_pieces_of_any_size_have_the_same_sums(chunk, monkeypatch):
    problem, x, weights = everything(7)
    expected = summed(problem, x, weights)
    residuals, tips = (
        problem.residuals(x),
        problem.perturbed_chain.tips(problem.state, x[: problem.perturbed_chain.n_coefficients]),
    )
    monkeypatch.setattr(problem_module, "CHUNK", chunk)
    problem, x, weights = everything(7)
    assert_same_equations(summed(problem, x, weights), expected)
    for found, one in zip(problem.residuals(x), residuals, strict=True):
        np.testing.assert_allclose(found, one, rtol=1e-10, atol=ROUNDING_MM)
    np.testing.assert_allclose(
        problem.perturbed_chain.tips(problem.state, x[: problem.perturbed_chain.n_coefficients]), tips, atol=ROUNDING_MM
    )
    columns = [
        by
        for _, _, by in problem.perturbed_chain.derivatives(problem.state, x[: problem.perturbed_chain.n_coefficients])
    ]
    assert sum(by.shape[2] for by in columns) == 21


@pytest.mark.parametrize("most_narrow", [0, 4, 8, 1000])
def test_sites_in_pairs_and_side_by_side_have_the_same_sums(most_narrow, monkeypatch):
    problem, x, weights = everything(8)
    counts = [len(site.columns) for site in problem.perturbed_chain.sites]
    assert min(counts) <= problem_module.MOST_NARROW < max(counts)  # both kinds are there
    expected = summed(problem, x, weights)
    monkeypatch.setattr(problem_module, "MOST_NARROW", most_narrow)
    assert_same_equations(summed(problem, x, weights), expected)


@pytest.mark.parametrize("transformed", [4, 10_000])
def test_transforms_and_products_have_the_same_sums(transformed, monkeypatch):
    """Of all pairs of harmonics, some readings at a time, where products would cost less."""
    problem, x, weights = everything(8, n=60, highest=20)
    assert sum(site.series is not None for site in problem.perturbed_chain.sites) > 1
    expected = summed(problem, x, weights)
    monkeypatch.setattr(problem_module, "CHUNK", 7)  # groups of chunks are merged before they are transformed
    monkeypatch.setattr(problem_module, "is_cheaper", lambda *_: True)
    monkeypatch.setattr(problem_module, "TRANSFORMED", transformed)
    found = summed(*everything(8, n=60, highest=20))
    assert_same_equations(found, expected)
    assert (found[2] == found[2].T).all()


@pytest.mark.parametrize(("groups", "threads"), [(1, 1), (3, 1), (3, 4)])
def test_groups_and_threads_do_not_matter(groups, threads, monkeypatch):
    problem, x, weights = everything(9)
    expected = summed(problem, x, weights)
    monkeypatch.setattr(problem_module, "CHUNK", 4)
    monkeypatch.setattr(problem_module, "GROUPS", groups)
    monkeypatch.setattr(problem_module, "cores", lambda: threads)
    problem, x, weights = everything(9)
    assert_same_equations(summed(problem, x, weights), expected)


def test_the_same_sums_to_the_last_digit_whatever_the_threads(monkeypatch):
    monkeypatch.setattr(problem_module, "CHUNK", 4)
    found = []
    for threads in (1, 2, 3):
        monkeypatch.setattr(problem_module, "cores", lambda threads=threads: threads)
        problem, x, weights = everything(10)
        found.append(summed(problem, x, weights))
    for other in found[1:]:
        np.testing.assert_array_equal(other[1], found[0][1])
        np.testing.assert_array_equal(other[2], found[0][2])


def test_values_kept_and_reckoned_again_are_the_same(monkeypatch):
    problem, x, weights = everything(11)
    expected = summed(problem, x, weights)
    again = summed(problem, x, weights)
    np.testing.assert_array_equal(again[2], expected[2])
    monkeypatch.setattr(problem_module, "KEPT_BYTES", 0)
    problem, x, weights = everything(11)
    np.testing.assert_array_equal(summed(problem, x, weights)[2], expected[2])


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20))
def test_the_whole_is_the_sum_of_its_readings(seed, first):
    rng = np.random.default_rng(seed)
    problem, x, (weights, *_) = everything(seed)
    points = problem.references[0]
    order = rng.permutation(21)
    parts = [order[:first], order[first:]]
    split = tuple(Points(points.rows[rows], points.points[rows]) for rows in parts)
    x = x[: problem.perturbed_chain.n_coefficients]
    whole = summed(SmallMotionProblem(problem.perturbed_chain, problem.state, (points,)), x, [weights])
    halves = SmallMotionProblem(problem.perturbed_chain, problem.state, split)
    assert_same_equations(summed(halves, x, [weights[:, rows] for rows in parts]), whole)


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10))
def test_weights_scale_the_sums(seed, factor):
    problem, x, weights = everything(seed, highest=2)
    cost, gradient, gram = summed(problem, x, weights)
    scaled = summed(problem, x, [factor * w for w in weights])
    assert_same_equations(scaled, (factor**2 * cost, factor**2 * gradient, factor**2 * gram))


def test_matrices_are_symmetric_and_not_negative():
    problem, x, weights = everything(12)
    for part in problem.normal_equations(x, weights):
        gram = part.dense()
        np.testing.assert_array_equal(gram, gram.T)
        size = np.sqrt(np.maximum(gram.diagonal(), 1e-300))
        assert np.linalg.eigvalsh(gram / np.outer(size, size))[0] > -1e-11


def test_a_series_of_harmonics_is_a_site_of_its_own():
    """Without orders far above it, which would make its transforms as large as themselves, and without few orders."""
    rng = np.random.default_rng(13)
    chain = random_chain(rng)
    terms = (
        *own_axis(chain, 2, highest=30),
        *interpolation(chain, 2, (128, 512)),
        *own_axis(chain, 3, highest=12),
        *constants(chain, free=()),
    )
    again = replace(terms[0], name="the same functions")
    series = [site for site in PerturbedChain(chain, (*terms, again)).sites if site.series]
    assert [(site.place, site.series.joint) for site in series] == [(2, 2)]
    np.testing.assert_array_equal(series[0].series.orders, np.arange(1, 31))
    np.testing.assert_array_equal(series[0].columns, np.arange(60))


def test_terms_of_one_place_and_direction_are_gathered():
    """Own axis in bands, the joint's zero: one site, whose coefficients stay where their terms have them."""
    rng = np.random.default_rng(13)
    chain = random_chain(rng)
    terms = (*own_axis(chain, 2, highest=8), *constants(chain, free=()))
    sites = PerturbedChain(chain, terms).sites
    (own,) = [site for site in sites if site.place == 2 and site.direction[2] == 1]
    assert len(own.columns) == 16 + 1
    everywhere = np.sort(np.concatenate([site.columns for site in sites]))
    np.testing.assert_array_equal(everywhere, np.arange(16 + len(constants(chain, free=()))))
    state = random_state(chain, 9, rng)
    x = rng.normal(size=len(everywhere)) * np.concatenate([term.prior_stds for term in terms])
    one_by_one = np.zeros((9, chain.n_places, 6))
    start = 0
    for term in terms:
        values = x[start : start + term.n_coefficients] @ term.basis.values(state)
        one_by_one[:, term.place] += values[:, None] * np.array(term.direction)
        start += term.n_coefficients
    np.testing.assert_allclose(
        PerturbedChain(chain, terms).tips(state, x), chain.tip_in_base(state.angles, one_by_one), atol=ROUNDING_MM
    )
