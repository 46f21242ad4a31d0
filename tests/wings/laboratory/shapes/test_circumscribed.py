"""The minimum circumscribed sphere: against brute force in longer arithmetic, and by a certificate of its own."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from refusals import refuses
from truearm.wings.laboratory.shapes.minimum_zone import MAX_SPHERE_POINTS, circumscribed_sphere

REAL = np.longdouble


def brute_force(sets):
    """Radii (n,) of the smallest spheres about sets of points (n, 5, 3), in long double.

    Another way than the program's: candidates are the smallest spheres through two, three and four points, centres by
    Cramer's rule in barycentric weights; one counts if it holds all five points within 1e-12 of its size.
    """
    sets = np.asarray(sets, dtype=REAL)
    size = np.ptp(sets, axis=1).max(axis=1)
    sets = (sets - sets[:, :1]) / np.where(size > 0, size, 1)[:, None, None]
    best = np.full(len(sets), np.inf, dtype=REAL)
    for k in (2, 3, 4):
        for chosen in combinations(range(5), k):
            D = sets[:, chosen[1:]] - sets[:, chosen[:1]]
            gram = np.einsum("nik,njk->nij", D, D)
            weights = cramer(gram, np.einsum("nii->ni", gram) / 2)
            centre = sets[:, chosen[0]] + np.einsum("ni,nik->nk", weights, D)
            radius = np.sqrt(((sets[:, chosen[0]] - centre) ** 2).sum(axis=1))
            farthest = np.sqrt(((sets - centre[:, None]) ** 2).sum(axis=2)).max(axis=1)
            holds = farthest <= radius * REAL(1 + 1e-12)  # false of what is not a number
            best = np.where(holds & (radius < best), radius, best)
    return np.where(size > 0, best * size, 0).astype(float)


def cramer(matrix, right):
    """Solve systems (n, p, p) of order 1 to 3 by determinants."""

    def determinant(m):
        if m.shape[1] == 1:
            return m[:, 0, 0]
        if m.shape[1] == 2:
            return m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] * m[:, 1, 0]
        return sum(
            m[:, 0, i] * (m[:, 1, j] * m[:, 2, k] - m[:, 1, k] * m[:, 2, j])
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        )

    found = np.empty_like(right)
    with np.errstate(divide="ignore", invalid="ignore"):
        for i in range(right.shape[1]):
            replaced = matrix.copy()
            replaced[:, :, i] = right
            found[:, i] = determinant(replaced) / determinant(matrix)
    return found


def certified(points, found):
    """How far from proven minimal: the sphere must hold all, and its centre be a mean of points that it touches."""
    points = np.asarray(points, dtype=float)
    distance = np.linalg.norm(points - found.centre, axis=1)
    assert distance.max() <= found.radius_mm + 8 * np.finfo(float).eps * np.abs(points).max()
    touched = points[distance >= found.radius_mm * (1 - 1e-7)]
    scale = np.abs(touched - found.centre).max() or 1.0
    A = np.vstack([(touched - found.centre).T / scale, np.ones(len(touched))])
    return nnls(A, np.array([0.0, 0, 0, 1]))[1]


def radii(sets):
    return np.array([circumscribed_sphere(points).radius_mm for points in sets])


@pytest.mark.parametrize("n", [1000, pytest.param(10_000, marks=pytest.mark.weekly)])
def test_random_sets(n, rng):
    """To 1e-9 of the size, in arithmetic that carries three digits more."""
    sets = rng.normal(size=(n, 5, 3)) * np.exp(rng.uniform(-3, 3, (n, 1, 3)))
    expected = brute_force(sets)
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(radii(sets), expected, rtol=1e-9)


def degenerate(rng):
    """A thousand sets: coincident, collinear, coplanar, on one sphere, on one circle, grids; some of them nearly so."""
    sets = []
    for i in range(1000):
        points = rng.normal(size=(5, 3))
        kind = i % 8
        if kind == 0:
            points[1] = points[0]
            points[3] = points[2]
        elif kind == 1:
            points[:] = np.outer(rng.normal(size=5), rng.normal(size=3)) + rng.normal(size=3)
        elif kind == 2:
            points = rng.normal(size=(5, 2)) @ rng.normal(size=(2, 3))
        elif kind == 3:
            points /= np.linalg.norm(points, axis=1)[:, None]
        elif kind == 4:
            angle = rng.uniform(0, 2 * np.pi, 5)
            points = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(5)]) @ np.linalg.qr(points[:3])[0]
        elif kind == 5:
            points = rng.integers(-1, 2, size=(5, 3)).astype(float)
        elif kind == 6:
            points[1:] = points[0] + 1e-3 * points[1:]
        else:
            points = 1e3 + rng.normal(size=(5, 3)) * [1, 1e-6, 1e-9]
        near = rng.choice([0, 0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-4])
        sets.append(points + near * rng.normal(size=(5, 3)))
    return np.array(sets)


def test_a_thousand_degenerate_sets(rng):
    """Against brute force where it finds a sphere; where it loses it to rounding, the certificate is proof enough."""
    sets = degenerate(rng)
    found, expected = radii(sets), brute_force(sets)
    known = np.isfinite(expected)
    assert known.mean() > 0.9
    np.testing.assert_allclose(found[known], expected[known], rtol=1e-9, atol=1e-12)
    for points in sets:
        assert certified(points, circumscribed_sphere(points)) < 1e-3


@settings(max_examples=50)
@given(st.lists(st.tuples(*[st.floats(-100, 100)] * 3), min_size=1, max_size=8))
def test_it_holds_all_and_none_smaller_does(points):
    found = circumscribed_sphere(points)
    assert certified(points, found) < 1e-3
    apart = max((np.linalg.norm(np.subtract(a, b)) for a, b in combinations(points, 2)), default=0.0)
    # Jung's theorem in space: sqrt(3/8) of the largest distance at most, and half of it at least.
    assert apart / 2 * (1 - 1e-12) <= found.radius_mm <= np.sqrt(3 / 8) * apart * (1 + 1e-12)


def test_hand_made_cases():
    one = circumscribed_sphere([[1.0, 2, 3]])
    assert (one.radius_mm, *one.centre) == (0, 1, 2, 3)
    two = circumscribed_sphere([[0.0, 0, 0], [2, 0, 0], [1, 0, 0]])
    assert two.diameter_mm == 2
    np.testing.assert_array_equal(two.centre, [1, 0, 0])
    right = circumscribed_sphere([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
    assert right.diameter_mm == pytest.approx(5, abs=1e-14)
    obtuse = circumscribed_sphere([[0.0, 0, 0], [10, 0, 0], [5, 1, 0]])
    assert obtuse.diameter_mm == pytest.approx(10, abs=1e-14)
    tetrahedron = circumscribed_sphere([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0, 0, 0]])
    assert tetrahedron.radius_mm == pytest.approx(np.sqrt(3), abs=1e-14)
    np.testing.assert_allclose(tetrahedron.centre, 0, atol=1e-15)


@pytest.mark.parametrize(
    ("points", "phrase"),
    [
        (np.zeros((0, 3)), "got 0"),
        (np.zeros((MAX_SPHERE_POINTS + 1, 3)), f"got {MAX_SPHERE_POINTS + 1}"),
        (np.zeros((4, 2)), "got shape"),
        ([[0, 0, np.inf]], "finite"),
    ],
)
def test_what_is_no_set_of_points_is_refused(points, phrase):
    refuses(phrase, circumscribed_sphere, points)
