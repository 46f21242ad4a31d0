"""Least-squares shapes: the published circle, exact constructions, derivatives, honest covariances, rigid motions."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.errors import InputError
from truearm.wings.laboratory.shapes.least_squares_shapes import (
    CIRCLE,
    CONE,
    CYLINDER,
    LINE,
    PLANE,
    SPHERE,
    TORUS,
    fit_circle,
    fit_cone,
    fit_cylinder,
    fit_line,
    fit_plane,
    fit_sphere,
    fit_torus,
)
from truearm.wings.laboratory.shapes.orthogonal_regression import Place

ELEMENTS = [LINE, PLANE, CIRCLE, SPHERE, CYLINDER, CONE, TORUS]
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


def on_line(rng, n=12):
    return CENTRE + np.column_stack([np.zeros((n, 2)), rng.uniform(-60, 60, n)]) @ TURN.T


def on_cylinder(rng, n=25):
    angle = rng.uniform(0, 2 * np.pi, n)
    return CENTRE + np.column_stack([20 * np.cos(angle), 20 * np.sin(angle), rng.uniform(-30, 30, n)]) @ TURN.T


def on_cone(rng, n=25):
    """Points of a countersink of 90 deg, its apex at the centre."""
    angle, height = rng.uniform(0, 2 * np.pi, n), rng.uniform(6, 25, n)
    return CENTRE + np.column_stack([height * np.cos(angle), height * np.sin(angle), height]) @ TURN.T


def on_torus(rng, n=40):
    ring, tube = rng.uniform(0, 2 * np.pi, n), rng.uniform(-2, 2, n)
    away = 30 + 8 * np.cos(tube)
    return CENTRE + np.column_stack([away * np.cos(ring), away * np.sin(ring), 8 * np.sin(tube)]) @ TURN.T


SHAPES = {
    "sphere": (fit_sphere, on_sphere, ("centre", "radius_mm")),
    "plane": (fit_plane, on_plane, ("point", "normal")),
    "circle": (fit_circle, on_circle, ("centre", "normal", "radius_mm")),
    "line": (fit_line, on_line, ("point", "direction")),
    "cylinder": (fit_cylinder, on_cylinder, ("point", "axis", "radius_mm")),
    "cone": (fit_cone, on_cone, ("apex", "axis", "half_angle_rad")),
    "torus": (fit_torus, on_torus, ("centre", "axis", "major_radius_mm", "minor_radius_mm")),
}
ALL = pytest.mark.parametrize("shape", SHAPES)
# Parameters that a shape has less those that its description's points and unit vectors repeat.
FREE = {"sphere": 4, "plane": 3, "circle": 6, "line": 4, "cylinder": 5, "cone": 6, "torus": 7}


def parameters(shape, fit):
    return np.concatenate([np.atleast_1d(getattr(fit, name)) for name in SHAPES[shape][2]])


def across(shape, fit):
    """What keeps of a move of its point the part that moves the shape: a plane and an axis slide in themselves."""
    if shape == "plane":
        return np.outer(fit.normal, fit.normal)
    if shape in ("line", "cylinder"):
        axis = fit.direction if shape == "line" else fit.axis
        return np.eye(3) - np.outer(axis, axis)
    return np.eye(3)


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
    "line": (
        [
            [10.526, 8.583, -37.975], [8.674, 4.153, -25.029], [6.024, 1.397, -12.094], [4.557, -2.693, -0.021],
            [1.937, -6.437, 12.215], [-0.57, -11.095, 25.529], [-3.556, -15.238, 37.575],
        ],
        [
            3.94171428571428571, -3.04714285714285714, 0.0285714285714285714,
            -0.173146695462576637, -0.293263622447397371, 0.940221606643572147,
        ],
    ),
    "cylinder": (
        [
            [25.414, 0.734, -5.01], [-10.401, 11.083, -1.447], [3.708, -23.983, -1.735], [16.108, 4.878, 16.966],
            [-13.194, 2.733, -11.573], [16.821, -18.422, -6.72], [6.833, 14.655, 10.151], [-15.643, -15.389, 4.245],
            [24.469, -6.658, -7.637], [-3.663, 15.744, 1.022],
        ],
        [
            4.0774250618085704, -2.96356036303677693, -0.906438468742568611,
            -0.217878060435698759, -0.311043729426825494, 0.925084293005253533, 20.0591740311073847,
        ],
    ),
    "cone": (
        [
            [6.542, -5.632, 7.951], [-4.297, -2.688, 12.644], [0.553, -18.379, 13.933], [10.367, -1.307, 26.128],
            [-17.161, -8.435, 23.558], [5.597, -9.277, 7.36], [2.898, 0.114, 14.936], [-8.355, -13.71, 13.721],
            [12.686, -14.918, 22.375], [-7.546, 2.825, 30.42], [0.234, -10.355, 5.765], [9.572, -5.388, 14.77],
            [-7.713, -2.962, 15.994], [1.846, -22.539, 17.453], [8.431, 0.069, 32.061], [-2.164, -5.138, 6.953],
        ],
        [
            3.80011862893542138, -3.15107701178928327, -0.0276775428855732311,
            -0.170689011503331058, -0.303775781065407585, 0.937328937028041014, 0.533898757689180578,
        ],
    ),
    "torus": (
        [
            [39.541, 2.17, 0.051], [-24.447, 22.783, 3.631], [2.695, -37.066, -2.488], [20.028, 8.848, 14.131],
            [-16.375, 0.297, -5.143], [22.233, -22.92, -12.593], [12.265, 33.103, 6.523], [-29.374, -20.56, -8.095],
            [30.815, -16.891, 11.245], [-5.441, 14.973, 8.619], [-4.324, -20.143, -13.012], [34.997, 6.134, -0.823],
            [-27.386, 19.409, -2.566], [9.415, -39.001, -4.739],
        ],
        [
            3.99629648853566466, -2.89505059491122182, -0.120453280112686735,
            -0.187506930630982856, -0.30158770687155157, 0.934818702224825447,
            29.8060218152574167, 9.21516547519808418,
        ],
    ),
}  # fmt: skip


@pytest.mark.parametrize("shape", OURS)
def test_reference_pairs_of_our_own(shape):
    points, expected = OURS[shape]
    np.testing.assert_allclose(parameters(shape, SHAPES[shape][0](points)), expected, rtol=0, atol=1e-10)


def sum_of_squares(fit):
    return float((fit.residuals**2).sum())


@pytest.mark.parametrize(
    ("half", "saddle", "lowest"),
    [
        # Symmetric about x = 0: steps from a centre there never leave it, and end in a saddle or a side valley.
        ([[3, -9], [2, -4], [10, -7]], 53.5105, 24.64226),
        ([[3, 7], [2, -3], [1, 2]], 25.1048, 21.00237),
    ],
)
def test_the_best_of_several_minima_is_found(half, saddle, lowest):
    """Points far from any circle, against a plain search: all centres of a fine grid, each with its best radius."""
    given = np.array(half, dtype=float)
    plane = np.concatenate([given, given * [-1, 1]])
    reach, turn = np.geomspace(0.1, 3000, 300), np.linspace(0, 2 * np.pi, 361)
    centres = np.multiply.outer(reach, np.column_stack([np.cos(turn), np.sin(turn)])).reshape(-1, 1, 2)
    searched = len(plane) * np.sqrt(((plane - centres) ** 2).sum(axis=2)).var(axis=1).min()
    found = sum_of_squares(fit_circle(np.column_stack([plane, np.zeros(len(plane))]) @ TURN.T))
    assert found < searched < 1.01 * found + 0.05
    assert found == pytest.approx(lowest, rel=1e-5)
    assert found < saddle


@settings(max_examples=12)
@given(st.lists(st.tuples(*[st.integers(-9, 9)] * 3), min_size=6, max_size=9, unique=True), st.sampled_from([2, 3]))
def test_no_centre_far_or_near_is_better(points, d):
    """Whole numbers at random, in a plane for circles: refused only where a straight line or a plane is as good."""
    given = np.array(points, dtype=float)[:, :d]
    flat = np.column_stack([given, np.zeros((len(given), 3 - d))])
    centred = given - given.mean(axis=0)
    straight = float(np.linalg.svd(centred, compute_uv=False)[-1] ** 2)
    away = np.random.default_rng(0).normal(size=(200, d))
    away /= np.linalg.norm(away, axis=1)[:, None]
    centres = np.multiply.outer(np.geomspace(0.3, 1000, 40), away).reshape(-1, 1, d)
    searched = len(given) * np.sqrt(((centred - centres) ** 2).sum(axis=2)).var(axis=1).min()
    try:
        found = sum_of_squares((fit_circle if d == 2 else fit_sphere)(flat))
    except InputError:
        assert searched > straight - 1e-3
    else:
        assert found <= min(searched, straight) + 1e-9


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
    if shape in ("circle", "torus"):
        np.testing.assert_allclose(fit.centre, CENTRE, atol=1e-10)
    sizes = {
        "circle": {"radius_mm": 40},
        "cylinder": {"radius_mm": 20},
        "cone": {"half_angle_rad": np.pi / 4},
        "torus": {"major_radius_mm": 30, "minor_radius_mm": 8},
    }
    for name, size in sizes.get(shape, {}).items():
        assert getattr(fit, name) == pytest.approx(size, abs=1e-11)
    if shape == "cone":
        np.testing.assert_allclose(fit.apex, CENTRE, atol=1e-10)
        np.testing.assert_allclose(fit.axis, TURN[:, 2], atol=1e-12)
    if shape in ("line", "cylinder"):
        np.testing.assert_allclose(across(shape, fit) @ (fit.point - CENTRE), 0, atol=1e-11)


# Derivatives and covariances -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", ELEMENTS, ids=[one.name for one in ELEMENTS])
def test_derivatives_of_the_distance_by_moves_and_sizes(element, rng):
    """Against difference quotients of 1e-6, whose own error is some 1e-10 of lengths of order 1."""
    points = rng.normal(size=(9, 3))
    place = Place(rng.normal(size=3), TURN, np.array([0.7, 0.3])[: len(element.is_length)])
    steps = 1e-6 * np.eye(len(element.moves) + len(element.is_length))

    def distances(step):
        return element.linearised(points, element.moved(place, step)).residuals

    quotients = np.column_stack([(distances(h) - distances(-h)) / 2e-6 for h in steps])
    np.testing.assert_allclose(element.linearised(points, place).jacobian, quotients, atol=1e-8)


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


@pytest.mark.parametrize(
    ("shape", "runs"),
    [("sphere", 200), ("plane", 200), ("circle", 80), ("line", 100), ("cylinder", 40), ("cone", 40), ("torus", 30)],
)
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
    n = fit_shape(points).residuals.size - FREE[shape]
    assert np.mean(found) / 0.02**2 == pytest.approx(1, abs=4 * np.sqrt(2 / (n * runs)))


@ALL
def test_without_spare_points_nothing_is_said_of_the_scatter(shape, rng):
    fit_shape, make, _ = SHAPES[shape]
    least = {"sphere": 4, "plane": 3, "circle": 3, "line": 2, "cylinder": 5, "cone": 6, "torus": 7}[shape]
    fit = fit_shape(make(rng, n=least))
    assert np.isnan(fit.std_mm)
    assert np.isnan(fit.covariance).any()
    assert np.isfinite(parameters(shape, fit)).all()
    assert np.isfinite(fit_shape(make(rng, n=least), std_mm=0.01).covariance).all()


# Motions, far places, thin arcs --------------------------------------------------------------------------------------


@ALL
@settings(max_examples=8)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3), shift=st.tuples(*[st.floats(-5e3, 5e3)] * 3), seed=st.integers(0, 2**31)
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
        if name in ("centre", "point", "apex"):
            np.testing.assert_allclose(R @ one + shift, other, atol=1e-8)
            blocks.append(R)
        elif name.endswith(("_mm", "_rad")):
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
        place = name in ("centre", "point", "apex")
        length = place or name.endswith("_mm")
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


def test_a_short_bend_of_a_pipe_is_a_torus(rng):
    """Circles through its points from above do not have their centre in that of the ring."""
    along, around = rng.uniform(-0.3, 0.3, 60), rng.uniform(-np.pi, np.pi, 60)
    across = 30 + 8 * np.cos(around)
    points = np.column_stack([across * np.cos(along), across * np.sin(along), 8 * np.sin(around)])
    fit = fit_torus(points)
    assert (fit.major_radius_mm, fit.minor_radius_mm) == pytest.approx((30, 8), abs=1e-9)


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
        ("torus", COPLANAR, "do not determine a torus"),
        ("sphere", [[1.0, 2, np.nan]] * 5, "finite coordinates"),
        ("sphere", np.zeros((5, 2)), "(n, 3), got shape (5, 2)"),
    ],
)
def test_points_that_determine_no_shape_are_refused(shape, points, phrase):
    refuses(re.escape(phrase), SHAPES[shape][0], points)


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
    refuses("positive standard deviation", fit_plane, COPLANAR, std_mm=0.0)
