"""Hand-eye in closed form and by least squares: the two constant motions between camera, arm and board.

In both set-ups the board in the camera is ``T_camera_board = X A Y``. A camera that stands (eye to hand) has
``A = T_base_flange``, ``X = T_camera_base``, ``Y = T_flange_board``; a camera on the flange (eye in hand) has
``A = T_flange_base``, ``X = T_camera_flange``, ``Y = T_base_board``. Lengths in mm.

References
----------
F. C. Park, B. J. Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group", IEEE Trans. Robotics and
Automation 10 (1994) 717: the rotation of X by the rotation vectors of pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.rigid_motions import cross_matrix, motion
from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray, IntArray

# Pairs with larger turns are ignored: near half a turn the sign of a rotation vector is by chance [rad].
MOST_TURN = np.radians(160.0)
# Images of which all pairs are taken; of more, each with so many others.
ALL_PAIRS = 60
# Root mean square turning about other axes below which a direction is open: noise of orientations makes some of it.
OPEN_TURN = np.radians(3.0)
# A size with a larger relative standard deviation is not told by the positions.
LEAST_SIZED = 0.1
ROUNDS = 30
UNKNOWNS = 12


def _pairs(n: int) -> tuple[IntArray, IntArray]:
    i, j = np.triu_indices(n, 1)
    near = (j - i) % max(1, n // ALL_PAIRS) == 0
    return i[near], j[near]


def _turns(T: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """Rotation vectors (m, 3) of ``T_i T_j^-1``."""
    R = Rotation.from_matrix(T[:, :3, :3])
    return np.asarray((R[i] * R[j].inv()).as_rotvec())


@dataclass(frozen=True, eq=False)
class Parallel:
    """The direction about which poses turn least else: nothing along it is seen where they turn about it alone.

    Attributes
    ----------
    axis : (3,) array
        Along the axes of the frame before A: base, or flange where the camera is on it.
    turning : float
        Root mean square turning about other directions [rad].
    """

    axis: FloatArray
    turning: float

    @classmethod
    def of(cls, A: FloatArray) -> Parallel:
        """By the singular values of the stacked ``R(A_i A_j^-1) - 1``."""
        i, j = _pairs(len(A))
        R = A[i, :3, :3] @ A[j, :3, :3].transpose(0, 2, 1) - np.eye(3)
        values, vectors = np.linalg.eigh(np.einsum("nji,njk->ik", R, R) / len(R))
        axis = vectors[:, 0] * np.sign(vectors[np.abs(vectors[:, 0]).argmax(), 0])
        return cls(axis, float(np.sqrt(max(values[0], 0.0))))

    @property
    def is_open(self) -> bool:
        """Whether the position along the axis is not determined."""
        return bool(self.turning < OPEN_TURN)


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """The two constant motions in closed form, and the size of the board.

    Attributes
    ----------
    X, Y : (4, 4) array
    size, size_std : float
        True size of the board over the stated one, with its standard deviation.
    depth, depth_std : float
        Size along the axis of the camera over that across it: a focal length that is wrong changes it.
    rms_mm : float
        Root mean square distance of the board's positions, in the board's stated size; infinite where a mirror would
        fit better than any rotation.
    """

    X: FloatArray
    Y: FloatArray
    size: float
    size_std: float
    depth: float
    depth_std: float
    rms_mm: float


def closed_form(A: FloatArray, C: FloatArray, *, sized: bool) -> ClosedForm:
    """X and Y of ``C = X A Y``; with the size of the board free where it is `sized`.

    Parameters
    ----------
    A, C : (n, 4, 4) array
        Three or more.
    sized : bool

    Raises
    ------
    InputError
        If there are fewer.
    """
    if len(A) < 3:
        raise InputError(f"expected three images or more, got {len(A)}", hint="20 images or more, well turned")
    i, j = _pairs(len(A))
    a, c = _turns(A, i, j), _turns(C, i, j)
    near = (np.linalg.norm(a, axis=1) < MOST_TURN) & (np.linalg.norm(c, axis=1) < MOST_TURN)
    if near.sum() < 2:
        near[:] = True
    U, values, Vt = np.linalg.svd(c[near].T @ a[near])
    mirror = np.linalg.det(U @ Vt) < 0
    R_X = U @ np.diag([1.0, 1.0, -1.0 if mirror else 1.0]) @ Vt
    R_Y = Rotation.from_matrix((R_X @ A[:, :3, :3]).transpose(0, 2, 1) @ C[:, :3, :3]).mean().as_matrix()
    turned = R_X @ A[:, :3, :3]
    target = A[:, :3, 3] @ R_X.T
    unit = np.broadcast_to(np.eye(3), turned.shape)
    size, size_std, depth, depth_std = 1.0, 0.0, 1.0, 0.0
    if sized:
        # Linear in what a length of the arm is in the camera: t_i = s R_X t_i(A) + t_X + R_X R_i t_Y. The noise is that
        # of the camera; with the size at its positions, noise would pull it to zero where they hardly tell it.
        found, cov, _ = _linear([target[:, :, None], unit, turned], C[:, :3, 3])
        scale, scale_std = float(found[0]), float(np.sqrt(cov[0, 0]))
        size_std = scale_std / scale**2
        size = 1 / scale if scale_std < LEAST_SIZED * abs(scale) else 1.0
        if len(A) > UNKNOWNS // 2:
            along = C[:, :3, 3, None] * np.array([0.0, 0.0, 1.0])[:, None]
            found, cov, _ = _linear([along, target[:, :, None], unit, turned], C[:, :3, 3])
            depth, depth_std = 1 - float(found[0]), float(np.sqrt(cov[0, 0]))
    translations, _, left = _linear([unit, turned], size * C[:, :3, 3] - target)
    is_wrong = size <= 0 or (mirror and values[2] > 0.1 * values[1])
    rms = np.inf if is_wrong else float(np.sqrt((left**2).sum(axis=1).mean())) / size
    return ClosedForm(
        motion(R_X, translations[:3]), motion(R_Y, translations[3:]), size, size_std, depth, depth_std, rms
    )


def _linear(blocks: list[FloatArray], target: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Solution of least squares, its covariance, and what is left (n, 3)."""
    M, y = np.concatenate(blocks, axis=2).reshape(3 * len(target), -1), target.ravel()
    scale = np.linalg.norm(M, axis=0)
    inverted = np.linalg.pinv(M / scale)
    x = inverted @ y / scale
    left = y - M @ x
    variance = left @ left / max(len(y) - len(x), 1)
    return x, variance * (inverted @ inverted.T) / np.outer(scale, scale), left.reshape(target.shape)


@dataclass(frozen=True, eq=False)
class HandEyeAlone:
    """X and Y by least squares, six numbers an image, on an arm that stays as it is.

    Attributes
    ----------
    X, Y : (4, 4) array
    covariance : (12, 12) array
        Of a translation [mm] and a rotation [rad] of X along the axes of the frame that it leads to, then of Y.
    position_std, turn_std : float
        Noise of a coordinate of a position [mm], and of an orientation about an axis [rad].
    held_out_mm : (n,) array
        Distance of every board from where the other images put it.
    rows : (n,) bool array
        The images that were used; others are gross errors.
    """

    X: FloatArray
    Y: FloatArray
    covariance: FloatArray
    position_std: float
    turn_std: float
    held_out_mm: FloatArray
    rows: BoolArray


# A board that is so many times the usual distance off, and by more than so much, was not where others were [mm].
GROSS, LEAST_GROSS_MM = 6.0, 0.05


def refined(A: FloatArray, C: FloatArray, start: ClosedForm) -> HandEyeAlone:
    """Least squares from a closed form: positions and orientations have a noise of their own, by restricted likelihood.

    Images whose held-out position is a gross error are ignored, the worst first, up to a quarter.
    """
    rows, away = np.ones(len(A), dtype=bool), np.linalg.norm(C[:, :3, 3], axis=1)
    while True:
        found = _refined(A[rows], C[rows], start.X, start.Y)
        off = found.held_out_mm
        # The noise of a distance grows with its square, the error of an arm does not.
        off = off * np.minimum((np.median(away) / away[rows]) ** 2, 1.0)
        worst = int(off.argmax())
        is_gross = off[worst] > max(GROSS * float(np.median(off)), LEAST_GROSS_MM)
        if not is_gross or rows.sum() <= max(0.75 * len(A), 5):
            return replace(found, rows=rows)
        rows[np.flatnonzero(rows)[worst]] = False


def _refined(A: FloatArray, C: FloatArray, X: FloatArray, Y: FloatArray) -> HandEyeAlone:
    n, stds = len(A), np.array([1.0, 1e-3])
    unit = np.eye(3)
    for _ in range(ROUNDS):
        at_base = A @ Y
        turned = X[:3, :3] @ A[:, :3, :3]
        back = C[:, :3, :3].transpose(0, 2, 1)
        seen = X @ at_base
        t = seen[:, :3, 3] - C[:, :3, 3]
        r = Rotation.from_matrix(back @ seen[:, :3, :3]).as_rotvec()
        arms = -cross_matrix(at_base[:, :3, 3] @ X[:3, :3].T)
        J = np.zeros((n, 6, UNKNOWNS))
        J[:, :3, :3], J[:, :3, 3:6], J[:, :3, 6:9] = unit, arms, turned
        J[:, 3:, 3:6], J[:, 3:, 9:] = back, back @ turned
        weights = np.repeat(1 / stds, 3)
        W, y = J * weights[:, None], np.concatenate([t, r], axis=1) * weights
        covariance = np.linalg.pinv(np.einsum("nik,nil->kl", W, W), hermitian=True)
        step = -covariance @ np.einsum("nik,ni->k", W, y)
        hat = np.einsum("nik,kl,njl->nij", W, covariance, W)
        X = motion(Rotation.from_rotvec(step[3:6]).as_matrix() @ X[:3, :3], X[:3, 3] + step[:3])
        Y = motion(Rotation.from_rotvec(step[9:]).as_matrix() @ Y[:3, :3], Y[:3, 3] + step[6:9])
        used = np.einsum("nii->i", hat)
        freedom = np.maximum(3 * n - np.array([used[:3].sum(), used[3:].sum()]), 1.0)
        now = np.sqrt(np.array([(t**2).sum(), (r**2).sum()]) / freedom)
        now = np.maximum(now, [1e-9, 1e-12])  # exact data
        settled = np.abs(now / stds - 1).max() < 1e-3 and np.abs(step).max() < 1e-7
        stds = now
        if settled:
            break
    left = np.eye(6) - hat
    out = np.linalg.solve(left + 1e-12 * np.eye(6), y[..., None])[..., 0] / weights
    held_out = np.linalg.norm(out[:, :3], axis=1)
    return HandEyeAlone(X, Y, covariance, float(stds[0]), float(stds[1]), held_out, np.ones(n, dtype=bool))
