"""Rendered images: against a plain loop over pixels, and what they show of what is known."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from truearm.wings.camera.boards import parse_board
from truearm.wings.camera.lenses import Lens
from truearm.wings.camera.patterns import pattern_of
from truearm.wings.camera.simulate_images import ALONG, BEHIND, INK, MARGIN_MM, PAPER, Renderer


def plain(pattern, lens, T):
    """The exact image pixel by pixel: every place of a pixel by its own ray."""
    image = np.empty((lens.height, lens.width))
    offsets = (np.arange(ALONG) + 0.5) / ALONG - 0.5
    normal, width, height = T[:3, 2], *pattern.size_mm
    for v in range(lens.height):
        for u in range(lens.width):
            pixels = np.stack([part.ravel() for part in np.meshgrid(u + offsets, v + offsets)])
            rays = np.vstack([lens.normalized(pixels), np.ones(ALONG**2)])
            on_plane = rays * (normal @ T[:3, 3] / (normal @ rays))
            x, y = pattern.on_sheet((T[:3, :3].T @ (on_plane - T[:3, 3:]))[:2])
            on = (x > -MARGIN_MM) & (y > -MARGIN_MM) & (x < width + MARGIN_MM) & (y < height + MARGIN_MM)
            image[v, u] = np.where(on, np.where(pattern.is_black(x, y), INK, PAPER), BEHIND).mean()
    return image


def test_the_fast_image_is_the_plain_one():
    lens = Lens(48, 40, 60.0, 61.0, 24.0, 19.0, "brown", [-0.1, 0.02, 1e-3, -1e-3, 0.0])
    pattern = pattern_of(parse_board("chessboard:4x3,20mm"))
    T = np.array([[0.96, -0.10, 0.26, -30.0], [0.05, 0.98, 0.19, -25.0], [-0.27, -0.17, 0.95, 150.0], [0, 0, 0, 1]])
    T[:3, :3] = np.linalg.qr(T[:3, :3])[0] * np.sign(np.diag(np.linalg.qr(T[:3, :3])[1]))
    exact = gaussian_filter(plain(pattern, lens, T), 0.5, mode="nearest")
    fast = Renderer(pattern, lens, blur_px=0.5, noise=0.0).image(T, seed=0)
    # Places beside a pixel's middle are found to first order: single ones change colour at an edge.
    assert np.abs(fast - exact).max() < 12  # of 185 grey values
    assert np.abs(fast - exact).mean() < 0.5


def test_a_board_behind_the_camera_or_beside_the_image_is_not_in_it():
    lens = Lens(48, 40, 60.0, 61.0, 24.0, 19.0)
    renderer = Renderer(pattern_of(parse_board("chessboard:4x3,20mm")), lens, blur_px=0.0, noise=0.0)
    for place in ([0.0, 0.0, -200.0], [2000.0, 0.0, 200.0]):
        T = np.eye(4)
        T[:3, 3] = place
        assert (renderer.image(T, seed=0) == BEHIND).all()


def test_the_noise_is_that_of_its_seed():
    lens = Lens(48, 40, 60.0, 61.0, 24.0, 19.0)
    renderer = Renderer(pattern_of(parse_board("chessboard:4x3,20mm")), lens, noise=3.0)
    T = np.eye(4)
    T[:3, 3] = [2000.0, 0.0, 200.0]
    images = [renderer.image(T, seed=seed) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(images[0], images[1])
    assert (images[0] != images[2]).any()
    assert images[0].std() == pytest.approx(3.0, rel=0.1)  # 1920 pixels: 2 % of sampling, and rounding
