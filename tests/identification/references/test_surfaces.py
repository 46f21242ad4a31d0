"""Spheres, planes and lines: distances solved by hand, starts through exact tips, invariances, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mixed_session import unit
from truearm.errors import InputError
from truearm.identification.references.surfaces import Lines, Planes, Radius, Spheres, lines_of, planes_of, spheres_of

ALL = slice(None)
# Rounding of coordinates of some metres, 1e-12 mm, through a least-squares fit: three orders above.
ROUNDING_MM = 1e-9


def one(kind, n):
    return kind(np.arange(n), np.zeros(n, int), ("A",))


def drawn(kind, rng, n, *, sigma=0.0):
    """Tips (3, n) at distances N(0, sigma) from a random sphere of 30 mm, plane or line, and where that is."""
    frame, origin = Rotation.random(rng=rng).as_matrix(), rng.uniform(-2000, 2000, 3)
    if kind is Spheres:
        local = (30 + sigma * rng.normal(size=(n, 1))) * unit(rng.normal(size=(n, 3)))
    else:
        local = rng.uniform(-100, 100, (n, 3))
        across = [2] if kind is Planes else [0, 1]
        local[:, across] = sigma * rng.normal(size=(n, len(across)))
    return (local @ frame.T + origin).T, frame, origin


def test_distance_from_a_sphere_by_hand():
    reference = Spheres(np.arange(4), np.array([0, 0, 0, 0]), ("A",))
    tips = np.array([[13.0, 0, 1, 1], [2, 12, 2, 2], [3, 3, 3, 15]])
    found = reference.linearised(tips, np.array([1.0, 2, 3, 10]), ALL)
    np.testing.assert_allclose(found.residuals, [[2, np.sqrt(101) - 10, -10, 2]])
    np.testing.assert_allclose(found.by_tip[0, :, 0], [1, 0, 0])
    np.testing.assert_allclose(found.by_unknown[0, :, 0], [-1, 0, 0, -1])
    np.testing.assert_allclose(found.by_tip[0, :, 2], 0)  # at the centre there is no direction


def test_distances_from_a_plane_and_a_line_by_hand():
    tips = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 5]])
    frames, origins = np.eye(3)[None], np.zeros((1, 3))
    plane = Planes(np.arange(3), np.zeros(3, int), ("A",), frames, origins)
    np.testing.assert_allclose(plane.linearised(tips, np.array([0, 0, 2.0]), ALL).residuals, [[-2, -2, 3]])
    # tilted by 90 deg about x its normal, z, points along -y
    np.testing.assert_allclose(
        plane.linearised(tips, np.array([np.pi / 2, 0, 0]), ALL).residuals, [[0, -1, 0]], atol=1e-15
    )
    line = Lines(np.arange(3), np.zeros(3, int), ("A",), frames, origins)
    np.testing.assert_allclose(
        line.linearised(tips, np.array([0, 0, 2, 3.0]), ALL).residuals, [[-1, -2, -2], [-3, -2, -3]]
    )
    along_x = line.linearised(tips, np.array([0, np.pi / 2, 0, 0]), ALL).residuals
    np.testing.assert_allclose(np.linalg.norm(along_x, axis=0), [0, 1, 5], atol=1e-15)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([Spheres, Planes, Lines]), st.integers(5, 30))
def test_exact_tips_are_on_their_initial_surfaces(seed, kind, n):
    tips, frame, origin = drawn(kind, np.random.default_rng(seed), n)
    reference, unknowns = one(kind, n).initialise(tips)
    found = reference.linearised(tips, unknowns, ALL)
    atol = ROUNDING_MM * (100 if kind is Spheres else 1)  # five tips may lie nearly in a plane
    np.testing.assert_allclose(found.residuals, 0, atol=atol)
    if kind is Spheres:
        np.testing.assert_allclose(unknowns, [*origin, 30], atol=1e-6)
    else:
        axis = reference.frames[0][:, 2]
        assert abs(axis @ frame[:, 2]) == pytest.approx(1)
        np.testing.assert_allclose(np.linalg.det(reference.frames), 1)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([Planes, Lines]))
def test_residuals_are_the_distances_however_it_is_tilted(seed, kind):
    """Against a plain formula, at tilts up to 170 deg from where it started."""
    rng = np.random.default_rng(seed)
    tips, _, _ = drawn(kind, rng, 8, sigma=20.0)
    reference, _ = one(kind, 8).initialise(tips)
    tilt = rng.normal(size=2)
    tilt *= rng.uniform(0, 2.97) / np.linalg.norm(tilt)
    offset = rng.normal(0, 30, reference.n_residuals)
    found = reference.linearised(tips, np.array([*tilt, *offset]), ALL)
    frame = reference.frames[0] @ Rotation.from_rotvec([*tilt, 0]).as_matrix()
    away = tips.T - reference.origins[0]
    if kind is Planes:
        np.testing.assert_allclose(found.residuals[0], away @ frame[:, 2] - offset, atol=ROUNDING_MM)
    else:
        away = away - frame[:, :2] @ offset
        distance = np.linalg.norm(np.cross(away, frame[:, 2]), axis=1)
        np.testing.assert_allclose(np.linalg.norm(found.residuals, axis=0), distance, atol=ROUNDING_MM)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([Spheres, Planes, Lines]))
def test_residuals_do_not_depend_on_the_frame(seed, kind):
    rng = np.random.default_rng(seed)
    tips, _, _ = drawn(kind, rng, 12, sigma=0.5)
    moved = Rotation.random(rng=rng).as_matrix() @ tips + rng.uniform(-1000, 1000, (3, 1))
    sizes = []
    for each in (tips, moved):
        reference, unknowns = one(kind, 12).initialise(each)
        sizes.append(np.linalg.norm(reference.linearised(each, unknowns, ALL).residuals, axis=0))
    np.testing.assert_allclose(sizes[0], sizes[1], atol=1e-7)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.sampled_from([Planes, Lines]))
def test_planes_and_lines_start_at_their_orthogonal_regression(seed, kind):
    """No small tilt or offset lowers the sum of squares: its gradient is zero there."""
    tips, _, _ = drawn(kind, np.random.default_rng(seed), 15, sigma=2.0)
    reference, unknowns = one(kind, 15).initialise(tips)
    found = reference.linearised(tips, unknowns, ALL)
    gradient = np.einsum("km,kam->a", found.residuals, found.by_unknown)
    size = np.sqrt((found.by_unknown**2).sum(axis=(0, 2)))
    np.testing.assert_allclose(gradient / size, 0, atol=1e-7)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.2, 3.0))
def test_a_known_radius_puts_the_centre_of_a_cap_in_place(seed, half_angle):
    """Tips on a cap of a 30 mm sphere, read with 0.05 mm: as near as steps from there need."""
    rng = np.random.default_rng(seed)
    polar = half_angle * np.sqrt(rng.uniform(0, 1, 40))
    azimuth = rng.uniform(0, 2 * np.pi, 40)
    outward = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    tips = (30 + 0.05 * rng.normal(size=40)) * outward
    reference = Spheres(np.arange(40), np.zeros(40, int), ("A",), (Radius(0, 30.0, 0.001),))
    _, unknowns = reference.initialise(tips)
    assert unknowns[3] == 30
    # On a small cap the tilt of its middle plane counts: 0.05 mm / 0.1 rad / sqrt(40), four times it and some. On a
    # whole sphere the middle of the tips is the centre, but for the root of 2 x 30 mm x 0.05 mm / sqrt(40) and less.
    assert np.linalg.norm(unknowns[:3]) < (0.4 if half_angle < 1 else 3.0)


def test_a_start_from_tips_of_a_bad_arm_is_near(rng):
    """Tips off by 3 mm on a sphere of 15 mm: its centre to a few millimetres, and an effective radius of that order."""
    tips = 15 * unit(rng.normal(size=(25, 3))).T + rng.normal(0, 3, (3, 25))
    _, unknowns = one(Spheres, 25).initialise(tips)
    assert np.linalg.norm(unknowns[:3]) < 4
    assert 10 < unknowns[3] < 20


@pytest.mark.parametrize("kind", [Spheres, Planes, Lines])
@pytest.mark.parametrize("tips", [np.zeros((3, 6)), np.outer([1.0, 2, 3], np.arange(6)), np.full((3, 6), 1e5)])
def test_degenerate_tips_give_a_finite_start(kind, tips):
    reference, unknowns = one(kind, 6).initialise(tips)
    found = reference.linearised(tips, unknowns, ALL)
    assert np.isfinite(unknowns).all()
    assert np.isfinite(found.residuals).all()
    assert np.isfinite(found.by_unknown).all()


def test_readings_of_many_surfaces_keep_apart(rng):
    names = np.array(["b", "a"])[np.arange(20) % 2]
    for kind, make in ((Spheres, spheres_of), (Planes, planes_of), (Lines, lines_of)):
        a, b = (drawn(kind, rng, 10)[0] for _ in range(2))
        tips = np.empty((3, 20))
        tips[:, names == "a"], tips[:, names == "b"] = a, b
        reference, unknowns = make(np.arange(20), names).initialise(tips)
        np.testing.assert_allclose(reference.linearised(tips, unknowns, ALL).residuals, 0, atol=1e-6)
        # in pieces as at once
        found = reference.linearised(tips[:, 5:9], unknowns, slice(5, 9))
        size = len(unknowns) // 2
        assert (found.unknown[0] // size).tolist() == [0, 1, 0, 1]
        assert len(reference.unknowns) == len(unknowns)
        assert len(set(reference.unknowns)) == len(unknowns)


@pytest.mark.parametrize(("kind", "least"), [(Spheres, 4), (Planes, 3), (Lines, 2)])
def test_too_few_readings_are_refused_with_the_name(kind, least):
    kind(np.arange(least), np.zeros(least, int), ("A",))
    with pytest.raises(InputError, match=f"{least} readings on {kind.kind} 'A'"):
        kind(np.arange(least - 1), np.zeros(least - 1, int), ("A",))
    with pytest.raises(InputError, match="'B'"):
        kind(np.arange(least), np.zeros(least, int), ("A", "B"))
    with pytest.raises(InputError, match="got number 1"):
        kind(np.arange(least), np.ones(least, int), ("A",))


@pytest.mark.parametrize(
    ("radii", "message"),
    [
        ([("nowhere", 30.0, 0.1)], "no reading touches it"),
        ([("A", 0.0, 0.1)], "positive radius"),
        ([("A", 30.0, -0.1)], "positive radius"),
        ([("A", np.inf, 0.1)], "positive radius"),
    ],
)
def test_radii_must_make_sense(radii, message):
    with pytest.raises(InputError, match=message):
        spheres_of(np.arange(4), np.full(4, "A"), radii)
