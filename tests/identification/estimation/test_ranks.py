"""How many parameters of an arm each kind of reference tells: numerical ranks beside what geometry says.

The parameters are those of a plain Denavit-Hartenberg table, a, d, alpha and theta of every joint and three coordinates
of the tip: 4 n + 3 of them. A table says some things twice and nothing of others:

- d and theta of joint 1 only move the whole arm about its first axis: 2 that need a known frame;
- joint n's four only move what is behind it, as the tip's three do, or turn what no tip shows: 4;
- without a length the size of everything: 1.
"""

from dataclasses import replace

import numpy as np
import pytest

from mixed_session import reached, unit
from plain_jacobian import plain_jacobian
from truearm.arm import Arm, DHTable
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.references.distances import Distances
from truearm.identification.references.orientations import Orientations
from truearm.identification.references.references import Points, seats_of
from truearm.identification.references.surfaces import lines_of, planes_of, spheres_of
from truearm.identification.terms import ArmState, Constant, Harmonics, Term, constants
from truearm.identification.terms.catalogue import tool_rotation
from truearm.wings.planning.designs.observability import rank_and_gap

# Kept and lost singular values stand so far apart or more.
GAP = 1e6


def generic_table(n):
    """Neighbouring axes at right angles as in measuring arms, but no length zero and no axis through the tip."""
    rng = np.random.default_rng(n)
    return DHTable(
        "dh",
        a=rng.uniform(30, 90, n),
        d=np.where(np.arange(n) % 2, 60.0, 350.0) + rng.uniform(0, 50, n),
        alpha=np.pi / 2 * np.where(np.arange(n) % 2, 1, -1),
        theta=rng.uniform(-0.5, 0.5, n),
        prismatic=np.zeros(n, bool),
        base=np.eye(4),
        flange=np.eye(4),
        tip_in_flange=np.array([20.0, 30, 150]),
    )


def dh_terms(table):
    """The table's parameters as motions of the chain's places, each of one unit.

    Behind ``Rz(q + theta)`` and ``Tz(d)`` stand ``Tx(a) Rx(alpha)``, along an x axis turned by theta and raised by d:
    turning about that line is a turn about the parallel through the place's origin and a shift.
    """
    terms = []
    for i, (theta, d) in enumerate(zip(table.theta, table.d, strict=True), start=1):
        c, s = np.cos(theta), np.sin(theta)
        directions = {
            "a": (0, 0, 0, c, s, 0),
            "d": (0, 0, 0, 0, 0, 1),
            "alpha": (c, s, 0, -d * s, d * c, 0),
            "theta": (0, 0, 1, 0, 0, 0),
        }
        terms += [Term(f"{name}{i}", i, direction, Constant(), "table", 1.0) for name, direction in directions.items()]
    shifts = np.eye(6)[3:]
    return terms + [Term(f"tip {i}", len(table.a) + 1, tuple(shifts[i]), Constant(), "table", 1.0) for i in range(3)]


def rank_of(chain, angles, terms, references, *, others=()):
    """Combinations of `terms` that readings tell although `others` and the references' unknowns are sought too."""
    tips = chain.tip_in_base(angles).T
    started = [reference.initialise(tips[:, reference.rows]) for reference in references]
    perturbed_chain = PerturbedChain(chain, (*terms, *others))
    problem = SmallMotionProblem(perturbed_chain, ArmState(chain, angles), tuple(reference for reference, _ in started))
    x = np.concatenate([np.zeros(perturbed_chain.n_coefficients), *(unknowns for _, unknowns in started)])
    rows = [by.reshape(len(x), -1).T for by in plain_jacobian(problem, x)]
    for i, reference in enumerate(problem.references):
        where = problem.unknowns_of(i)
        constraints = reference.constraints(x[where])
        if constraints is not None:
            wide = np.zeros((len(constraints.residuals), len(x)))
            wide[:, where] = constraints.by_unknown
            rows.append(wide)
    J = np.concatenate(rows)
    return clear_rank(J) - clear_rank(J[:, sum(term.n_coefficients for term in terms) :])


def clear_rank(J):
    """Rank of a Jacobian, columns of unit length, with nothing between what is kept and what is lost."""
    length = np.linalg.norm(J, axis=0)
    if not length.any():
        return 0
    rank, gap = rank_and_gap(np.linalg.svd(J[:, length > 0] / length[length > 0], compute_uv=False))
    assert rank == (length > 0).sum() or gap > GAP
    return rank


def session(table, what, rng):
    """Angles that bring the tip exactly to where `what` says, joints all over, and the references of them."""
    chain = table.chain()
    arm = Arm("generic", chain)
    n = 120
    rows, names = np.arange(n), np.array(["A", "B", "C"])
    a, b, c = chain.tip_in_base(np.array([0.5, 0.8, 1.1])[:, None] * np.ones(chain.n_joints))
    match what:
        case "points":
            angles = rng.uniform(-np.pi, np.pi, (n, chain.n_joints))
            return angles, [Points(rows, chain.tip_in_base(angles))]
        case "poses":
            angles = rng.uniform(-np.pi, np.pi, (n, chain.n_joints))
            pose = chain.pose(angles)
            return angles, [Points(rows, pose.tip_in_base), Orientations(rows, pose.R_base_tip)]
        case "one anchor" | "three anchors":
            angles = rng.uniform(-np.pi, np.pi, (n, chain.n_joints))
            anchor = rows % (1 if what == "one anchor" else 3)
            places = chain.reach * np.array([[1.0, 0.3, 0.2], [-0.8, 0.9, -0.1], [0.1, -1.1, 0.6]])
            distance = np.linalg.norm(chain.tip_in_base(angles) - places[anchor], axis=1)
            k = 1 + int(anchor.max())
            return angles, [Distances(rows, anchor, tuple("ABC"[:k]), distance, np.zeros(n), np.ones(k))]
        case "seat A" | "seats A, B, C" | "seats A, B and the length between":
            seats = 1 if what == "seat A" else 2 if "length" in what else 3
            name = names[rows % seats]
            targets = np.stack([a, b, c])[rows % seats]
            lengths = [("A", "B", np.linalg.norm(a - b), 0.01)] if "length" in what else []
            references = [seats_of(rows, name, lengths)]
        case "sphere" | "sphere of known radius":
            targets = a + 40 * unit(rng.normal(size=(n, 3)))
            references = [spheres_of(rows, names[0 * rows], [("A", 40.0, 0.01)] if "known" in what else [])]
        case "plane":
            targets = a + rng.uniform(-100, 100, (n, 3)) * [1, 1, 0]
            references = [planes_of(rows, names[0 * rows])]
        case "line":
            targets = a + rng.uniform(-100, 100, (n, 3)) * [1, 0, 0]
            references = [lines_of(rows, names[0 * rows])]
    return reached(arm, chain, targets, rng, half_width=np.pi), references


@pytest.mark.parametrize("n", [6, 7])
def test_the_terms_are_the_tables_parameters(n):
    """Against difference quotients of the chain that the table makes."""
    table = generic_table(n)
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (5, n))
    perturbed_chain = PerturbedChain(table.chain(), tuple(dh_terms(table)))
    ((_, _, columns),) = perturbed_chain.derivatives(
        ArmState(table.chain(), angles), np.zeros(perturbed_chain.n_coefficients)
    )
    for i in range(n):
        for k, name in enumerate(("a", "d", "alpha", "theta")):
            there, back = (
                replace(table, **{name: getattr(table, name) + sign * 1e-5 * np.eye(n)[i]}).chain().tip_in_base(angles)
                for sign in (1, -1)
            )
            # rounding of 1e-12 mm / 1e-5, truncation 1e-10 / 6 of a metre
            np.testing.assert_allclose(columns[4 * i + k].T, (there - back) / 2e-5, atol=1e-6)


@pytest.mark.parametrize("harmonics", [False, True])
@pytest.mark.parametrize("n", [6, pytest.param(7, marks=pytest.mark.weekly)])
@pytest.mark.parametrize(
    ("what", "frame", "told"),
    [
        ("points", "known", lambda n: 4 * n - 1),
        ("points", "fitted", lambda n: 4 * n - 3),
        ("poses", "known", lambda n: 4 * n - 1),
        ("poses", "fitted", lambda n: 4 * n - 3),
        ("seat A", "none", lambda n: 4 * n - 4),
        ("seats A, B, C", "none", lambda n: 4 * n - 4),
        ("seats A, B and the length between", "none", lambda n: 4 * n - 3),
        ("sphere", "none", lambda n: 4 * n - 4),
        ("sphere of known radius", "none", lambda n: 4 * n - 3),
        ("plane", "none", lambda n: 4 * n - 4),
        ("line", "none", lambda n: 4 * n - 4),
        ("one anchor", "none", lambda n: 4 * n - 3),
        ("three anchors", "none", lambda n: 4 * n - 3),
    ],
)
def test_rank_by_reference(what, frame, told, n, harmonics):
    """23 and 27 of a plain table from points in a known frame, 21 and 25 in an unknown one or from seats and a length,
    20 and 24 from seats alone; and every encoder harmonic on top, four of each joint, even from one seat."""
    table = generic_table(n)
    angles, references = session(table, what, np.random.default_rng(n))
    terms, others = dh_terms(table), []
    if harmonics:
        turn = (0, 0, 1, 0, 0, 0)
        terms += [Term(f"J{i}", i, turn, Harmonics(i, (1, 2)), "harmonics", 1.0) for i in range(1, n + 1)]
    if frame == "fitted":
        others += [term for term in constants(table.chain(), free=("base",)) if term.group == "base"]
    if what == "poses":
        others += tool_rotation(table.chain())
    found = rank_of(table.chain(), angles, terms, references, others=others)
    assert found == told(n) + (4 * n if harmonics else 0)


def test_a_tip_on_the_last_axis_hides_two_more():
    """Turning joint n does not move it: positions then say nothing of the direction of its axis. Base free."""
    generic = generic_table(7)
    last = np.arange(7) == 6
    table = replace(generic, a=generic.a * ~last, alpha=generic.alpha * ~last, tip_in_flange=np.array([0.0, 0, 150]))
    for each, told in ((generic, 4 * 7 + 3), (table, 4 * 7 + 1)):
        angles, references = session(each, "points", np.random.default_rng(0))
        assert rank_of(each.chain(), angles, constants(each.chain()), references) == told
