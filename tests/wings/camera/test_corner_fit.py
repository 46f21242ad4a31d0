"""The fit of a corner to grey values: its derivatives, and planted corners."""

import numpy as np
import pytest
from scipy.special import erf

from truearm.wings.camera.detection import _model, fit_corners

X = np.array([[20.3, 18.6, 0.4, 2.1, 110.0, 70.0, np.log(0.9)], [31.2, 30.9, -0.3, 1.2, 90.0, -60.0, np.log(1.6)]])


def places():
    v, u = (part.ravel() for part in np.mgrid[-6:7, -6:7])
    base = np.round(X[:, :2]).astype(int)
    return base[:, :1] + u, base[:, 1:] + v


@pytest.mark.parametrize("is_marker", [False, True])
def test_derivatives_are_difference_quotients(is_marker):
    u, v = places()
    grey, inside = np.zeros(u.shape), np.ones(u.shape, bool)
    _, J = _model(X, grey, inside, u, v, is_marker=is_marker)
    for k in range(7):
        step = np.zeros(7)
        step[k] = 1e-6
        lower, upper = (_model(X + sign * step, grey, inside, u, v, is_marker=is_marker)[0] for sign in (-1, 1))
        # Values of a hundred with 16 digits over a step of 2e-6.
        np.testing.assert_allclose(J[:, :, k], (upper - lower) / 2e-6, atol=1e-6, err_msg=str(k))


def image_of(corner, axes, *, is_marker, blur=0.9, noise=2.0, seed=0):
    """A corner whose edges run along the columns of `axes`."""
    v, u = np.mgrid[:50, :50]
    shape = 1.0
    for along, towards in ((1, 0), (0, 1)):
        normal = np.array([-axes[1, along], axes[0, along]]) / np.hypot(*axes[:, along])
        normal *= np.sign(normal @ axes[:, towards])
        s = ((u - corner[0]) * normal[0] + (v - corner[1]) * normal[1]) / blur
        shape = shape * (0.5 + 0.5 * erf(s / np.sqrt(2)) if is_marker else erf(s / np.sqrt(2)))
    grey = (200 - 160 * shape if is_marker else 120 + 80 * shape) + noise * np.random.default_rng(seed).standard_normal(
        (50, 50)
    )
    return np.clip(np.round(grey), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("is_marker", [False, True])
def test_a_planted_corner_is_found_within_its_uncertainty(is_marker):
    axes = np.array([[3.0, -0.9], [0.7, 3.3]])  # px/mm
    misses, stated = [], []
    for seed in range(40):
        corner = np.random.default_rng(seed).uniform(24, 26, 2)
        image = image_of(corner, axes, is_marker=is_marker, seed=seed)
        found = fit_corners(image, corner[None] + [[0.8, -0.7]], axes[None], 3.0, is_marker=is_marker)
        assert found.found.all()
        assert found.blur_px[0] == pytest.approx(0.9, abs=0.15)
        misses.append(found.pixels[0] - corner)
        stated.append(found.u_px[0])
    rms = np.sqrt(np.mean(np.square(misses)))
    assert rms < 0.05  # px
    assert rms == pytest.approx(np.mean(stated), rel=0.3)  # 80 values: 8 %, and the two axes differ


def test_where_nothing_is_no_corner_is_found():
    image = np.full((50, 50), 128, np.uint8)
    found = fit_corners(image, np.array([[25.0, 25.0]]), 3 * np.eye(2)[None], 3.0, is_marker=False)
    assert not found.found.any()


def test_a_corner_at_the_edge_of_the_image_is_fitted_to_what_is_there():
    axes = 3 * np.eye(2)
    image = image_of((3.4, 25.2), axes, is_marker=False)
    found = fit_corners(image, np.array([[3.0, 25.0]]), axes[None], 3.0, is_marker=False)
    np.testing.assert_allclose(found.pixels, [[3.4, 25.2]], atol=0.1)  # px: noise, and half a window
