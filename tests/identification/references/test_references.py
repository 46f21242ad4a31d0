"""References of all kinds in one solve: exact derivatives, planted truth found within its stated uncertainty, seats."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mixed_session import BAR_MM, NOISE, RADIUS_MM, planted
from plain_jacobian import plain_jacobian
from truearm.arm import Chain, load_arm
from truearm.errors import InputError
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.references.orientations import Orientations
from truearm.identification.references.references import Length, Points, Seats, seats_of
from truearm.identification.references.surfaces import lines_of, planes_of, spheres_of
from truearm.identification.terms import ArmState, constants
from truearm.identification.terms.catalogue import gravity, own_axis, tool_rotation, wobble
from truearm.solve.arrowhead import Arrowhead

KINDS = ("point", "seat", "sphere", "plane", "line", "orientation")


def random_chain(rng, n=3, *, sliding=False):
    fixed = np.tile(np.eye(4), (n + 1, 1, 1))
    fixed[:, :3, :3] = Rotation.random(n + 1, rng=rng).as_matrix()
    fixed[:, :3, 3] = rng.normal(0, 300, (n + 1, 3))
    return Chain(fixed, rng.normal(0, 100, 3), np.arange(n) == 1 if sliding else None)


def mixed_problem(chain, rng, *, counts, n_names=1, known=False):
    """A problem of terms of all sorts and references of the kinds in `counts`, and parameters off any optimum."""
    n = sum(counts.values())
    angles = rng.uniform(-1, 1, (n, chain.n_joints)) * np.where(chain.is_prismatic, 200, 3)
    terms = [*constants(chain), *tool_rotation(chain), *wobble(chain, 1), *own_axis(chain, 1, highest=30)[-1:]]
    terms += gravity(chain, chain.n_joints)[:3]
    pose, references, first = chain.pose(angles), [], 0
    for kind, m in counts.items():
        rows = np.arange(first, first + m)
        rng.shuffle(rows)
        first += m
        names = np.array([f"no {i % n_names}" for i in range(m)])
        match kind:
            case "point":
                references.append(Points(rows, pose.tip_in_base[rows] + rng.normal(0, 20, (m, 3))))
            case "seat":
                lengths = [("no 0", "no 1", 300.0, 0.1)] if known and n_names > 1 else []
                references.append(seats_of(rows, names, lengths))
            case "sphere":
                references.append(spheres_of(rows, names, [("no 0", 250.0, 0.1)] if known else []))
            case "plane":
                references.append(planes_of(rows, names))
            case "line":
                references.append(lines_of(rows, names))
            case "orientation":
                turned = Rotation.from_rotvec(rng.uniform(-1, 1, (m, 3))).as_matrix()
                references.append(Orientations(rows, pose.R_base_tip[rows] @ turned))
    started = [reference.initialise(pose.tip_in_base[reference.rows].T) for reference in references]
    problem = SmallMotionProblem(
        PerturbedChain(chain, tuple(terms)), ArmState(chain, angles), tuple(reference for reference, _ in started)
    )
    x = np.concatenate([np.zeros(problem.perturbed_chain.n_coefficients), *(unknowns for _, unknowns in started)])
    return problem, x + 0.05 * units(problem) * rng.normal(size=len(x))


def units(problem):
    """(p,) a radian or 100 mm: changes of every parameter that move tips alike."""
    turns = [
        max(map(abs, term.direction[:3])) > 0
        for term in problem.perturbed_chain.terms
        for _ in range(term.n_coefficients)
    ]
    turns += ["rad" in name for reference in problem.references for name in reference.unknowns]
    return np.where(turns, 1.0, 100.0)


def stacked(arrays):
    return np.concatenate([array.ravel() for array in arrays])


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.dictionaries(st.sampled_from(KINDS), st.integers(8, 11), min_size=1),
    st.integers(1, 2),
    st.booleans(),
    st.booleans(),
)
def test_derivatives_of_all_kinds_at_once_are_the_difference_quotients(seed, counts, n_names, known, sliding):
    """Along random directions, far from zero (0.05 rad, 5 mm).

    Steps of 1e-6 rad and 1e-4 mm: truncation is 1e-12 of third derivatives of some metres, rounding 1e-12 mm / 1e-6.
    """
    rng = np.random.default_rng(seed)
    problem, x = mixed_problem(random_chain(rng, sliding=sliding), rng, counts=counts, n_names=n_names, known=known)
    directions = units(problem) * rng.normal(size=(4, len(x)))
    h = 1e-6
    there, back = (np.stack([stacked(problem.residuals(x + s * h * v)) for v in directions]) for s in (1, -1))
    quotients = (there - back) / (2 * h)
    jacobian = np.concatenate([by.reshape(len(x), -1) for by in plain_jacobian(problem, x)], axis=1)
    np.testing.assert_allclose(directions @ jacobian, quotients, rtol=0, atol=1e-6 * np.abs(quotients).max())
    # The normal equations, weighted, are this Jacobian's.
    weights = [rng.uniform(0.5, 2, residual.shape) for residual in problem.residuals(x)]
    whole = Arrowhead.combine(problem.normal_equations(x, weights))
    whitened, residuals = directions @ jacobian * stacked(weights), stacked(weights) * stacked(problem.residuals(x))
    gram = whole.dense()
    size = np.linalg.norm(whitened, axis=1)
    np.testing.assert_allclose(
        (directions @ gram @ directions.T) / np.outer(size, size),
        (whitened @ whitened.T) / np.outer(size, size),
        atol=1e-9,
    )
    gradient = whole.gradient
    np.testing.assert_allclose(
        directions @ gradient, whitened @ residuals, rtol=0, atol=1e-9 * (size.max() * np.linalg.norm(residuals))
    )
    assert whole.cost == pytest.approx(0.5 * residuals @ residuals)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(2, 4))
def test_relations_among_unknowns_have_the_difference_quotients_as_derivatives(seed, n_names):
    """Lengths and radii; also where seats fall together."""
    rng = np.random.default_rng(seed)
    names = np.array([f"no {i % n_names}" for i in range(5 * n_names)])
    rows = np.arange(len(names))
    lengths = [("no 0", "no 1", 40.0, 0.01), ("no 1", "no 0", 41.0, 0.01), ("no 0", "no 1", 39.0, 0.01, "bar", 0.002)]
    for reference in (seats_of(rows, names, lengths), spheres_of(rows, names, [("no 1", 40.0, 0.01)])):
        x = rng.normal(0, 50, len(reference.unknowns))
        x[:6] = np.where(seed % 2, x[:6], 1.0)
        found = reference.constraints(x)
        for i, step in enumerate(1e-4 * np.eye(len(x))):  # mm: quadratic, so only rounding of 1e-13 mm / 1e-4
            quotient = (reference.constraints(x + step).residuals - reference.constraints(x - step).residuals) / 2e-4
            np.testing.assert_allclose(found.by_unknown[:, i], quotient, atol=1e-8)


@pytest.mark.parametrize(
    ("free", "counts", "bounds"),
    [
        # Over a hundred draws the mean was 1.1, a draw's standard deviation 0.4: bounds at four of six draws' mean.
        (("base", "tip"), {"point": 40, "seat": 30, "sphere": 30, "plane": 30, "line": 20}, (0.45, 1.75)),
        # Artefacts alone: few directions, as the scale from one bar, make most of the error. Sixty draws: 1.2 and 0.9.
        pytest.param(("tip",), {"seat": 60, "sphere": 40, "plane": 40}, (0.2, 2.7), marks=pytest.mark.weekly),
    ],
)
def test_a_planted_arm_is_recovered_within_its_stated_uncertainty(free, counts, bounds):
    """Six arms: squared errors of tips all over in their covariance, a third of a chi-square of three: 1 on average."""
    arm = load_arm("gao2017")
    terms = constants(arm.chain, free=free)
    drawn = {"base": (0.02, 5.0), "tip": (0.0, 5.0)}
    std = np.array([drawn[t.group][max(t.direction[:3]) == 0] if t.group in free else t.prior_std / 2 for t in terms])
    ratios, noises = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        session = planted(arm, terms, std * rng.normal(size=len(terms)), rng, counts=counts)
        found = identify(arm.chain, session.state, terms, session.references)
        assert found.converged
        elsewhere = ArmState(arm.chain, arm.working + 0.8 * rng.uniform(-1, 1, (100, arm.n_joints)))
        error = found.tips(elsewhere) - session.chain.tip_in_base(elsewhere.angles)
        inverse = np.linalg.inv(found.tip_covariance(elsewhere))
        ratios.append(np.einsum("ni,nij,nj->n", error, inverse, error).mean() / 3)
        noises.append([explained.noise_std / NOISE[explained.kind] for explained in found.references])
        by_kind = {explained.kind: explained for explained in found.references}
        radii = [by_kind["sphere"].unknowns[f"effective radius of sphere {name} [mm]"] for name in "AB"]
        # the first is known to 1 um, the other is found by fifteen readings or more of 5 um
        np.testing.assert_allclose(radii, RADIUS_MM, atol=0.02)
        seat = by_kind["seat"].unknowns
        a, b = (np.array([seat[f"{axis} of seat {name} [mm]"] for axis in "xyz"]) for name in "AB")
        assert np.linalg.norm(a - b) == pytest.approx(BAR_MM, abs=0.012)  # known to 2 um, read with an error of so much
    assert bounds[0] < np.mean(ratios) < bounds[1]
    # Six draws of thirty residuals or more less the unknowns': 12 % at one standard deviation and less.
    np.testing.assert_allclose(np.mean(noises, axis=0), 1, atol=0.3)


def test_blunders_are_outliers_in_every_kind_of_reference(rng):
    arm = load_arm("gao2017")
    terms = constants(arm.chain)
    session = planted(
        arm, terms, np.zeros(len(terms)), rng, counts={"point": 40, "seat": 30, "sphere": 30, "plane": 30, "line": 30}
    )
    angles = session.state.angles.copy()
    slipped = [reference.rows[7] for reference in session.references]
    angles[slipped] += np.radians(0.3)
    found = identify(arm.chain, ArmState(arm.chain, angles), terms, session.references)
    for explained, row in zip(found.references, slipped, strict=True):
        assert list(explained.rows[explained.robust_weight < 0.3]) == [row]


def test_seats_start_at_the_mean_of_their_tips():
    names = np.array(["b", "a", "b"])
    reference, unknowns = seats_of(np.arange(3), names).initialise(np.array([[0.0, 5, 2], [0, 6, 4], [0, 7, 6]]))
    assert unknowns.tolist() == [5, 6, 7, 1, 2, 3]
    assert reference.unknowns[:2] == ("x of seat a [mm]", "y of seat a [mm]")


def test_length_residual_is_the_distance_of_the_seats_less_the_length():
    """Near its value (d^2 - L^2) / 2 L is d - L."""
    reference = Seats(np.arange(2), np.arange(2), ("a", "b"), (Length(0, 1, 300.0, 0.01),))
    assert reference.constraints(np.array([0, 0, 0, 300.01, 0, 0])).residuals[0] == pytest.approx(0.01, rel=1e-4)


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        ([("a", "nowhere", 300.0, 0.1)], "no reading is in it"),
        ([("a", "a", 300.0, 0.1)], "itself"),
        ([("a", "b", -1.0, 0.1)], "positive length"),
        ([("a", "b", 300.0, 0.0)], "positive length"),
        ([("a", "b", np.nan, 0.1)], "positive length"),
    ],
)
def test_lengths_must_make_sense(lengths, message):
    with pytest.raises(InputError, match=message):
        seats_of(np.arange(2), np.array(["a", "b"]), lengths)


def test_a_seat_without_a_reading_is_refused():
    with pytest.raises(InputError, match="'b' has no reading"):
        Seats(np.arange(1), np.zeros(1, int), ("a", "b")).initialise(np.zeros((3, 1)))
