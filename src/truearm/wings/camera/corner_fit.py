"""Corners to a hundredth of a pixel: the grey values around each are fitted by two blurred edges that cross there.

The grey value at a place x is ``a + b g(n1 . (x - c) / s) g(n2 . (x - c) / s)``, with the corner c, the normals n1 and
n2 of the two edges and the blur s. Where squares of a chessboard meet, g is the error function, which changes its sign
at the edge; at the corner of a marker it rises from 0 to 1. A window that takes in what is printed beside the corner
would pull it away: it ends before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.typing import BoolArray, FloatArray, IntArray

# Half the side of the largest window [px], and the least that a window must hold.
HALF_PX = 9
LEAST_HALF_PX = 2.0
# The blur of the two edges reaches into the window from what is beyond it [px].
REACH_OF_BLUR_PX = 1.5
STEPS = 15
SETTLED_PX = 1e-3
# A corner that moves farther is another one; edges with less contrast are none [px; grey values].
FARTHEST_PX = 2.5
LEAST_CONTRAST = 8.0
BLUR_PX = (0.3, 6.0)


@dataclass(frozen=True, eq=False)
class FittedCorners:
    """Corners of an image.

    Attributes
    ----------
    pixels : (n, 2) array
    u_px : (n,) array
        Standard uncertainty of a coordinate by the noise of the image.
    blur_px : (n,) array
        Standard deviation of the blur of the edges.
    found : (n,) bool array
        Whether the fit found a corner there.
    """

    pixels: FloatArray
    u_px: FloatArray
    blur_px: FloatArray
    found: BoolArray


def fit_corners(
    image: npt.NDArray[np.uint8], start: FloatArray, axes: FloatArray, reach_mm: float, *, is_marker: bool
) -> FittedCorners:
    """Fit the corners of an image.

    Parameters
    ----------
    image : (height, width) array
    start : (n, 2) array
        Where they are to a pixel or two.
    axes : (n, 2, 2) array
        How many pixels u, v the board's x and y axis move by there [px/mm]; the last index is the axis.
    reach_mm : float
        Distance along the axes to what is printed next.
    is_marker : bool
        Whether the corners are those of markers; else four squares meet in each.
    """
    base = np.round(start).astype(int)
    half = int(min(HALF_PX, np.ceil(1 + np.abs(axes).sum(axis=2).max() * reach_mm)))
    steps = np.arange(-half, half + 1)
    dv, du = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
    u, v = base[:, :1] + du, base[:, 1:] + dv
    height, width = image.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    grey = image[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(float)
    inside &= _within(start, axes, reach_mm, u, v)
    x = _start(start, axes, grey, inside, u, v, is_marker=is_marker)
    damping = np.full(len(x), 1e-3)
    residual, J = _model(x, grey, inside, u, v, is_marker=is_marker)
    cost = (residual**2).sum(axis=1)
    for _ in range(STEPS):
        normal = np.einsum("nmi,nmj->nij", J, J)
        size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-12))
        scaled = normal / (size[:, :, None] * size[:, None]) + damping[:, None, None] * np.eye(7)
        step = -np.linalg.solve(scaled, (np.einsum("nmi,nm->ni", J, residual) / size)[:, :, None])[:, :, 0] / size
        trial = x + step
        trial[:, 6] = np.clip(trial[:, 6], *np.log(BLUR_PX))
        new, J_new = _model(trial, grey, inside, u, v, is_marker=is_marker)
        new_cost = (new**2).sum(axis=1)
        better = new_cost <= cost
        x, residual = np.where(better[:, None], trial, x), np.where(better[:, None], new, residual)
        J, cost = np.where(better[:, None, None], J_new, J), np.where(better, new_cost, cost)
        damping = np.where(better, damping / 10, np.minimum(10 * damping, 1e3))
        if (np.abs(step[:, :2]).max(axis=1) < SETTLED_PX).all():
            break
    freedom = np.maximum(inside.sum(axis=1) - 7, 1)
    covariance = np.linalg.inv(np.einsum("nmi,nmj->nij", J, J) + 1e-9 * np.eye(7))[:, :2, :2]
    noise = np.sqrt(cost / freedom)
    u_px = noise * np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2))
    moved = np.linalg.norm(x[:, :2] - start, axis=1)
    found = (moved < FARTHEST_PX) & (np.abs(x[:, 5]) > np.maximum(LEAST_CONTRAST, 3 * noise)) & (u_px < 1.0)
    return FittedCorners(x[:, :2], u_px, np.exp(x[:, 6]), found)


def _within(start: FloatArray, axes: FloatArray, reach_mm: float, u: IntArray, v: IntArray) -> BoolArray:
    """Which pixels (n, m) are nearer to the corner than what is printed next, its blur included."""
    apart = np.stack([u - start[:, :1], v - start[:, 1:]], axis=2)
    on_board = np.einsum("nij,nmj->nmi", np.linalg.inv(axes), apart)  # [mm]
    per_mm = np.linalg.norm(axes, axis=1)[:, None]  # of each axis [px/mm]
    half = np.maximum(reach_mm * per_mm - REACH_OF_BLUR_PX, LEAST_HALF_PX)
    near: BoolArray = (np.abs(on_board) * per_mm <= half).all(axis=2)
    return near


def _start(
    start: FloatArray,
    axes: FloatArray,
    grey: FloatArray,
    inside: BoolArray,
    u: IntArray,
    v: IntArray,
    *,
    is_marker: bool,
) -> FloatArray:
    """Start (n, 7): corner, angles of the normals, mean and contrast, logarithm of the blur."""
    x = np.zeros((len(start), 7))
    x[:, :2] = start
    # The normal of an edge along one axis, towards the other.
    for k, (along, towards) in enumerate(((1, 0), (0, 1))):
        normal = np.stack([-axes[:, 1, along], axes[:, 0, along]], axis=1)
        sign = np.sign((normal * axes[:, :, towards]).sum(axis=1))
        x[:, 2 + k] = np.arctan2(sign * normal[:, 1], sign * normal[:, 0])
    x[:, 5] = 1.0
    shape = _model(x, np.zeros_like(grey), inside, u, v, is_marker=is_marker)[0]
    n = np.maximum(inside.sum(axis=1), 1)
    mean_grey, mean_shape = (np.where(inside, part, 0).sum(axis=1) / n for part in (grey, shape))
    a, b = (np.where(inside, part - mean[:, None], 0) for part, mean in ((grey, mean_grey), (shape, mean_shape)))
    x[:, 5] = (a * b).sum(axis=1) / np.maximum((b * b).sum(axis=1), 1e-9)
    x[:, 4] = mean_grey - x[:, 5] * mean_shape
    return x


def _model(
    x: FloatArray,
    grey: FloatArray,
    inside: BoolArray,
    u: IntArray,
    v: IntArray,
    *,
    is_marker: bool,
) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, m) and derivatives (n, m, 7) by `_start`'s parameters; zero outside the windows."""
    from scipy.special import erf

    apart = np.stack([u - x[:, :1], v - x[:, 1:2]], axis=2)
    blur, b = np.exp(x[:, 6]), x[:, 5:6]
    scale, offset = (0.5, 0.5) if is_marker else (1.0, 0.0)
    turns = np.stack([np.stack([np.cos(x[:, k]), np.sin(x[:, k])], axis=1) for k in (2, 3)])  # (2, n, 2) normals
    across = np.stack([-turns[:, :, 1], turns[:, :, 0]], axis=2)
    s, by_angle = (np.einsum("nmi,kni->knm", apart, parts) / blur[:, None] for parts in (turns, across))
    g = offset + scale * erf(s / np.sqrt(2))
    slope = b * scale * np.sqrt(2 / np.pi) * np.exp(-0.5 * s * s) * g[::-1]
    J = np.empty((*grey.shape, 7))
    J[:, :, :2] = -np.einsum("knm,kni->nmi", slope, turns / blur[:, None])
    J[:, :, 2:4] = (slope * by_angle).transpose(1, 2, 0)
    J[:, :, 4], J[:, :, 5] = 1.0, g[0] * g[1]
    J[:, :, 6] = -(slope * s).sum(axis=0)
    residual = x[:, 4:5] + b * g[0] * g[1] - grey
    return np.where(inside, residual, 0.0), np.where(inside[:, :, None], J, 0.0)
