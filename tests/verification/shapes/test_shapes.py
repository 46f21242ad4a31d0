"""Least-squares shapes: the published circle, exact constructions, derivatives, honest covariances, rigid motions."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from truearm.errors import InputError
from truearm.verification.shapes.circle import fit_circle
from truearm.verification.shapes.orthogonal_regression import radial_distances, tilt_frame
from truearm.verification.shapes.plane import fit_plane
from truearm.verification.shapes.sphere import fit_sphere

TURN = Rotation.from_euler("xyz", [0.4, -0.9, 1.3]).as_matrix()
CENTRE = np.array([812.0, -340.0, 155.0])


def on_sphere(rng, n=25):
    """Points on the upper half of a sphere of radius 12.5 mm."""
    away = rng.normal(size=(n, 3))
    away[:, 2] = np.abs(away[:, 2])
    return CENTRE + 12.5 * (away / np.linalg.norm(away, axis=1)[:, None]) @ TURN.T


def on_plane(rng, n=20):
    return CENTRE + np.column_stack([rng.uniform(-80, 80, n), rng.uniform(-30, 30, n), np.zeros(n)]) @ TURN.T


def on_circle(rng, n=15, half_angle=np.pi):
    angle = rng.uniform(-half_angle, half_angle, n)
    return CENTRE + 40 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)]) @ TURN.T


SHAPES = {
    "sphere": (fit_sphere, on_sphere, ("centre", "radius_mm")),
    "plane": (fit_plane, on_plane, ("point", "normal")),
    "circle": (fit_circle, on_circle, ("centre", "normal", "radius_mm")),
}
ALL = pytest.mark.parametrize("shape", SHAPES)
# Parameters that a shape has less those that its description's points and unit vectors repeat.
FREE = {"sphere": 4, "plane": 3, "circle": 6}


def parameters(shape, fit):
    return np.concatenate([np.atleast_1d(getattr(fit, name)) for name in SHAPES[shape][2]])


def across(shape, fit):
    """What keeps of a move of the shape's point the part that moves the shape: a plane slides in itself."""
    return np.outer(fit.normal, fit.normal) if shape == "plane" else np.eye(3)


def along(found, like):
    """Directions have no sign: the one that agrees."""
    return found * np.sign(found @ like)


# References ----------------------------------------------------------------------------------------------------------


def test_the_published_circle():
    """W. Gander, G. H. Golub, R. Strebel, "Least-squares fitting of circles and ellipses", BIT 34 (1994) 558.

    They print the best fit's centre (4.7398, 2.9835) and radius 4.7142 to six points. The digits beyond are ours:
    the root of the gradient at 40 digits (mpmath). The steps converge linearly on points that lie this far off.
    """
    x, y = [1, 2, 5, 7, 9, 3], [7, 6, 8, 7, 5, 7]
    fit = fit_circle(np.column_stack([x, y, np.zeros(6)]))
    np.testing.assert_allclose([*fit.centre[:2], fit.radius_mm], [4.7398, 2.9835, 4.7142], atol=0.5e-4)
    exact = [4.7397824109060740344, 2.9835326992924751602, 4.714226037792109746]
    np.testing.assert_allclose([*fit.centre[:2], fit.radius_mm], exact, atol=1e-12)


# Points that lie a good deal off, and their shapes by Newton's method on the sum of squares at 50 digits (mpmath), in
# other parameters than the program's and with derivatives by differences: made here, published nowhere.
OURS = {
    "sphere": (
        [
            [4.038, 6.111, 17.36], [-3.897, -7.032, 17.793], [4.527, 8.75, 13.315], [-4.668, 3.843, 13.986],
            [5.393, -15.296, 9.387], [9.39, -13.419, 12.547], [-3.941, -8.386, 16.692], [1.722, -15.282, 11.629],
            [4.762, -3.909, 21.241],
        ],
        [4.01083517092519095, -3.04043102392319427, 8.87707776005270793, 12.4428338587885667],
    ),
    "circle": (
        [
            [3.311, -30.398, -13.925], [-5.088, 41.775, 15.309], [20.176, -27.998, -14.41], [35.302, 32.926, -3.835],
            [32.258, -21.121, -12.169], [10.032, 44.762, 10.454], [36.643, 32.055, -0.829], [8.457, -32.586, -13.462],
        ],
        [
            5.56601365046974211, 6.38745541921662651, -0.292433791889560669,
            0.257790086114557885, -0.283115442563446001, 0.923791057373447916, 40.0888253142754124,
        ],
    ),
}  # fmt: skip


@pytest.mark.parametrize("shape", OURS)
def test_reference_pairs_of_our_own(shape):
    points, expected = OURS[shape]
    np.testing.assert_allclose(parameters(shape, SHAPES[shape][0](points)), expected, rtol=0, atol=1e-10)


def test_two_shells_mean_their_middle():
    """By symmetry: corners of a cube on two concentric spheres, each with all its mirror images."""
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / np.sqrt(3)
    fit = fit_sphere(1e3 + np.concatenate([12.49 * corners, 12.51 * corners]))
    np.testing.assert_allclose(fit.centre, 1e3, atol=1e-11)
    assert fit.radius_mm == pytest.approx(12.5, abs=1e-11)
    assert fit.form_mm == pytest.approx(0.02, abs=1e-11)
    # 16 residuals of 0.01 mm, less four parameters.
    assert fit.std_mm == pytest.approx(0.01 * np.sqrt(16 / 12), rel=1e-8)


def test_a_checkerboard_means_the_plane_between():
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-2.0, 3), np.arange(-2.0, 3)))
    z = 0.01 * ((-1) ** (x + y) - 1 / 25)  # even along both axes: no tilt; and of mean zero
    fit = fit_plane(np.column_stack([x, y, z]))
    np.testing.assert_allclose(fit.normal, [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(fit.residuals, z, atol=1e-15)


def test_a_bumpy_ring_means_the_circle_between():
    """By symmetry: radius and height of a ring's points alternate in patterns without its first harmonic."""
    angle = np.arange(24) * np.pi / 12
    r, z = 40 + 0.02 * np.cos(6 * angle), 0.03 * np.cos(4 * angle)
    ring = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    circle = fit_circle(CENTRE + ring @ TURN.T)
    np.testing.assert_allclose(circle.centre, CENTRE, atol=1e-11)
    np.testing.assert_allclose(along(circle.normal, TURN[:, 2]), TURN[:, 2], atol=1e-13)
    assert circle.radius_mm == pytest.approx(40, abs=1e-11)


@ALL
def test_perfect_points_give_the_shape_back(shape, rng):
    fit_shape, make, _ = SHAPES[shape]
    fit = fit_shape(make(rng))
    assert fit.form_mm < 1e-10
    if shape == "sphere":
        np.testing.assert_allclose(parameters(shape, fit), [*CENTRE, 12.5], atol=1e-11)
    if shape == "circle":
        np.testing.assert_allclose(fit.centre, CENTRE, atol=1e-11)
        assert fit.radius_mm == pytest.approx(40, abs=1e-11)


# Derivatives and covariances -----------------------------------------------------------------------------------------


def test_derivatives_of_the_distance_from_an_axis(rng):
    """Against difference quotients of 1e-6, whose own error is some 1e-10 of lengths of order 1."""
    points, frame, origin = rng.normal(size=(9, 3)), TURN, rng.normal(size=3)

    def distance(step):
        moved = tilt_frame(frame, step[3], step[4])
        return radial_distances((points - origin - frame @ step[:3]) @ moved)[0] - step[5]

    _, jacobian = radial_distances((points - origin) @ frame)
    steps = 1e-6 * np.eye(6)
    quotients = np.column_stack([(distance(h) - distance(-h)) / 2e-6 for h in steps])
    np.testing.assert_allclose(jacobian, quotients, atol=1e-9)


@ALL
def test_the_covariance_is_that_of_the_derivatives_by_every_coordinate(shape, rng):
    """On perfect points the first-order covariance is std^2 D D^T, D the parameters' derivative by all coordinates."""
    fit_shape, make, _ = SHAPES[shape]
    points = make(rng, n=9)
    middle = parameters(shape, fit_shape(points))
    columns = []
    for i, k in np.ndindex(points.shape):
        ends = []
        for h in (1e-4, -1e-4):
            moved = points.copy()
            moved[i, k] += h
            ends.append(parameters(shape, fit_shape(moved)))
        assert np.abs(ends[0] - middle).max() < 1e-2  # the sign of a direction has not turned
        columns.append((ends[0] - ends[1]) / 2e-4)
    D = np.column_stack(columns)
    fit = fit_shape(points, std_mm=0.01)
    # Quotients of 1e-4 mm are good to some 1e-8 of derivatives of order 1; the point of a plane stays the mean of
    # the given ones, also along it, which is no error of the shape: left out.
    T = np.eye(len(D))
    T[:3, :3] = across(shape, fit)
    expected = 1e-4 * T @ D @ D.T @ T.T
    np.testing.assert_allclose(fit.covariance, expected, atol=1e-7 * np.abs(expected).max())
    assert np.linalg.matrix_rank(fit.covariance, tol=1e-9 * np.abs(fit.covariance).max()) <= FREE[shape]


@pytest.mark.parametrize(("shape", "runs"), [("sphere", 400), ("plane", 400), ("circle", 150)])
def test_covariances_are_honest(shape, runs, rng):
    """Errors in units of the stated uncertainty: their mean square is 1 within four of its standard deviations."""
    fit_shape, make, _ = SHAPES[shape]
    points = make(rng)
    truth = parameters(shape, fit_shape(points))
    squares = []
    for _ in range(runs):
        fit = fit_shape(points + 0.01 * rng.normal(size=points.shape), std_mm=0.01)
        error = parameters(shape, fit) - truth
        error[:3] = across(shape, fit) @ error[:3]
        squares.append(error @ np.linalg.pinv(fit.covariance, rcond=1e-9) @ error / FREE[shape])
    assert np.mean(squares) == pytest.approx(1, abs=4 * np.sqrt(2 / (FREE[shape] * runs)))


@ALL
def test_the_scatter_is_found(shape, rng):
    """The mean variance of some fits is the planted one, within four standard deviations of a chi-squared mean."""
    fit_shape, make, _ = SHAPES[shape]
    points, runs = make(rng), 20
    found = [fit_shape(points + 0.02 * rng.normal(size=points.shape)).std_mm ** 2 for _ in range(runs)]
    n = len(points) * (2 if shape == "circle" else 1) - FREE[shape]
    assert np.mean(found) / 0.02**2 == pytest.approx(1, abs=4 * np.sqrt(2 / (n * runs)))


@ALL
def test_without_spare_points_nothing_is_said_of_the_scatter(shape, rng):
    fit_shape, make, _ = SHAPES[shape]
    least = {"sphere": 4, "plane": 3, "circle": 3}[shape]
    fit = fit_shape(make(rng, n=least))
    assert np.isnan(fit.std_mm)
    assert np.isnan(fit.covariance).any()
    assert np.isfinite(parameters(shape, fit)).all()
    assert np.isfinite(fit_shape(make(rng, n=least), std_mm=0.01).covariance).all()


# Motions, far places, thin arcs --------------------------------------------------------------------------------------


@ALL
@settings(max_examples=8)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    shift=st.tuples(*[st.floats(-5e3, 5e3)] * 3),
    seed=st.integers(0, 2**31),
)
def test_what_moves_the_points_moves_the_shape(shape, turn, shift, seed):
    fit_shape, make, names = SHAPES[shape]
    rng = np.random.default_rng(seed)
    points = make(rng) + 0.01 * rng.normal(size=make(rng).shape)
    R = Rotation.from_rotvec(turn).as_matrix()
    here, there = fit_shape(points), fit_shape(points @ R.T + shift)
    blocks = []
    for name in names:
        one, other = getattr(here, name), getattr(there, name)
        if name in ("centre", "point"):
            np.testing.assert_allclose(R @ one + shift, other, atol=1e-8)
            blocks.append(R)
        elif name == "radius_mm":
            assert one == pytest.approx(other, abs=1e-8)
            blocks.append(np.eye(1))
        else:
            sign = np.sign(other @ R @ one)
            np.testing.assert_allclose(sign * R @ one, other, atol=1e-9)
            blocks.append(sign * R)
    size = sum(len(block) for block in blocks)
    T, at = np.zeros((size, size)), 0
    for block in blocks:
        T[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    moved = T @ here.covariance @ T.T
    np.testing.assert_allclose(moved, there.covariance, atol=1e-5 * np.abs(moved).max())


@ALL
def test_scale_and_far_places_cost_no_digits_but_those_of_the_coordinates(shape, rng):
    fit_shape, make, names = SHAPES[shape]
    points = make(rng) + 0.01 * rng.normal(size=make(rng).shape) - CENTRE
    here, far, small = fit_shape(points), fit_shape(points + 1e6), fit_shape(points * 1e-9)
    for name in names:
        one = getattr(here, name)
        place, length = name in ("centre", "point"), name in ("centre", "point", "radius_mm")
        # A coordinate of 1e6 mm is rounded by 1e-10 mm.
        np.testing.assert_allclose(getattr(far, name) - (1e6 if place else 0), one, atol=1e-8)
        np.testing.assert_allclose(getattr(small, name) * (1e9 if length else 1), one, atol=1e-8)


@pytest.mark.parametrize("degrees", [20, 5, 2])
def test_thin_arcs_and_caps(degrees, rng):
    """The radius of a thin arc is uncertain; its fit is a minimum all the same, and its error as large as stated."""
    half = np.radians(degrees) / 2
    arc = on_circle(rng, n=40, half_angle=half)
    cap = np.column_stack([rng.uniform(-half, half, 60), rng.uniform(-half, half, 60)])
    cap = CENTRE + 40 * np.column_stack([np.sin(cap), np.sqrt(1 - (np.sin(cap) ** 2).sum(axis=1))])
    sagitta = 40 * (1 - np.cos(half))
    for fit_shape, points in ((fit_circle, arc), (fit_sphere, cap)):
        exact = fit_shape(points, std_mm=1e-9)
        assert exact.radius_mm == pytest.approx(40, abs=40 * 1e-13 / half**4 + 1e-9)
        noisy = fit_shape(points + 0.01 * sagitta * rng.normal(size=points.shape))
        assert abs(noisy.radius_mm - 40) < 5 * np.sqrt(noisy.covariance[-1, -1])
        assert np.sqrt(noisy.covariance[-1, -1]) < 4


# What is refused -----------------------------------------------------------------------------------------------------

COINCIDENT = np.tile(CENTRE, (8, 1))
COLLINEAR = CENTRE + np.outer(np.arange(8.0), [1.0, 2.0, -0.5])
GRID = np.array([[i, j, 0.0] for i in range(4) for j in range(4)])
COPLANAR = CENTRE + GRID @ TURN.T
CUBE = np.array([[i, j, k] for i in (0.0, 1) for j in (0.0, 1) for k in (0.0, 1)])
ROUND = np.column_stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4), np.zeros(8)])


@pytest.mark.parametrize(
    ("shape", "points", "phrase"),
    [
        ("sphere", np.eye(3), "4 points or more for a sphere, got 3"),
        ("plane", np.eye(3)[:2], "3 points or more for a plane, got 2"),
        ("circle", np.eye(3)[:2], "3 points or more for a circle, got 2"),
        ("sphere", COINCIDENT, "in one place"),
        ("plane", COINCIDENT, "in one place"),
        ("circle", COINCIDENT, "in one place"),
        ("sphere", COLLINEAR, "in one plane"),
        ("plane", COLLINEAR, "on a line"),
        ("circle", COLLINEAR, "on a line"),
        ("sphere", COPLANAR, "in one plane"),
        ("sphere", 1e5 + ROUND @ TURN, "in one plane"),
        ("plane", CUBE, "equal spreads"),
        ("circle", CUBE, "equal spreads"),
        ("sphere", [[1.0, 2, np.nan]] * 5, "finite coordinates"),
        ("sphere", np.zeros((5, 2)), "(n, 3), got shape (5, 2)"),
    ],
)
def test_points_that_determine_no_shape_are_refused(shape, points, phrase):
    with pytest.raises(InputError, match=re.escape(phrase)):
        SHAPES[shape][0](points)


@pytest.mark.parametrize("seed", range(8))
def test_a_flat_cloud_is_no_sphere_or_says_that_it_may_be_any(seed):
    """Noise in a plane: refused, or a radius so uncertain that nobody takes it for one."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-10, 10, (30, 2)), 0.01 * rng.normal(size=30)])
    try:
        fit = fit_sphere(points)
    except InputError as refused:
        assert "do not determine a sphere" in str(refused)  # noqa: PT017
    else:
        assert fit.radius_mm > 300
        assert np.sqrt(fit.covariance[3, 3]) > 0.02 * fit.radius_mm


def test_a_given_scatter_is_positive():
    with pytest.raises(InputError, match="positive standard deviation"):
        fit_plane(COPLANAR, std_mm=0.0)
