"""Base and tip fitted to the same readings under many interpretations of an arm at once.

All interpretations go through NumPy together, a fifth of a millisecond each. Per interpretation it is Gauss-Newton on
base (6) and tip (3), from the alignment of the nominal tips with the points; with seats instead of points the base
plays no part, and the tips of one seat are compared with their mean. Gross errors are trimmed: every step takes the
`SHARE` of the readings with the least residuals (least trimmed squares with concentration steps: P. J. Rousseeuw,
K. Van Driessen, "Computing LTS regression for large data sets", Data Min. Knowl. Disc. 12 (2006) 29).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.description_mistakes import Interpretation
from truearm.arm.rigid_motions import cross_matrix
from truearm.identification.references.reference_table import ReferenceTable
from truearm.typing import BoolArray, FloatArray, IntArray

STEPS = 6
# Interpretations that are computed together: some ten megabytes.
BATCH = 250
# Of the free parameters, relative to the diagonal of their normal equations: those that no reading determines stay.
RIDGE = 1e-9
# Largest turn of the base [rad] and change of the tip [mm] in a step: beyond, the linearisation means nothing.
MAX_TURN, MAX_TIP_CHANGE = 0.7, 1e3


@dataclass(frozen=True, eq=False)
class DescriptionFits:
    """Fits of h interpretations to m readings.

    Attributes
    ----------
    residuals : (h, m, 3) array
        Of tips in the frame of the base: from their points, or from the mean of their seat [mm].
    kept : (h, m) bool array
        The readings that are not trimmed.
    tip_in_flange : (h, 3) array
        [mm].
    points_in_base : (h, m, 3) array
        Reference points; of seats the mean tips [mm].
    movement : (h,) array
        Root mean square movement of the tip by a radian of a stated angle [mm]. A description that moves the tip little
        errs little; residuals count relative to it where no reference instrument measured.
    """

    residuals: FloatArray
    kept: BoolArray
    tip_in_flange: FloatArray
    points_in_base: FloatArray
    movement: FloatArray

    def scores(self, table: ReferenceTable, interpretations: Sequence[Interpretation]) -> FloatArray:
        """(h,) logarithms of the residual standard deviation; in the stated unit, or relative to the movement."""
        squares = (np.where(self.kept[..., None], self.residuals, 0.0) ** 2).sum(axis=(1, 2))
        scale = [one.point_factor for one in interpretations] if table.has_points else self.movement
        return np.asarray(0.5 * np.log(np.maximum(squares, 1e-12)) - np.log(np.maximum(scale, 1e-12)))


def fit_descriptions(table: ReferenceTable, interpretations: Sequence[Interpretation]) -> DescriptionFits:
    """Fit base and tip under each interpretation."""
    parts = [_fit(table, interpretations[i : i + BATCH]) for i in range(0, len(interpretations), BATCH)]
    names = ("residuals", "kept", "tip_in_flange", "points_in_base", "movement")
    return DescriptionFits(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _fit(table: ReferenceTable, interpretations: Sequence[Interpretation]) -> DescriptionFits:
    angles = np.stack([one.angles(table.angles) for one in interpretations])
    fixed = fixed_motions(interpretations)
    slides = interpretations[0].table.prismatic
    flange, R, axes, origins = _forward(fixed, slides, angles)
    tip = np.stack([one.table.tip_in_flange for one in interpretations])
    kept = np.ones(angles.shape[:2], dtype=bool)
    if table.has_points:
        points = np.stack([table.points_of(one) for one in interpretations])
        residuals, kept, tip, in_base = _fit_points(flange, R, points, tip, table)
        movement = np.ones(len(tip))
    else:
        residuals, kept, tip, in_base = _fit_seats(flange, R, tip, table, interpretations)
        arms = (flange + np.einsum("hmij,hj->hmi", R, tip))[:, :, None] - origins
        by_joint = np.where(slides[:, None], axes, np.cross(axes, arms))
        matrix = np.stack([one.angle_matrix for one in interpretations])
        by_stated = np.einsum("hmjx,hjk->hmkx", by_joint, matrix)
        movement = np.sqrt((by_stated**2).sum(axis=-1).mean(axis=(1, 2)))
    return DescriptionFits(residuals, kept, tip, in_base, movement)


def fixed_motions(interpretations: Sequence[Interpretation]) -> FloatArray:
    """(h, n_joints + 1, 4, 4) fixed motions of the chains, as `DHTable.chain` builds them one by one."""
    tables = [one.table for one in interpretations]
    columns = {name: np.stack([getattr(one, name) for one in tables]) for name in ("a", "b", "d")}
    across, along = np.zeros((2, *columns["a"].shape, 4, 4))
    for matrix, name, sign in ((across, "alpha", (1, 2)), (along, "theta", (0, 1))):
        angle = np.stack([getattr(one, name) for one in tables])
        i, j = sign
        matrix[..., i, i] = matrix[..., j, j] = np.cos(angle)
        matrix[..., j, i] = np.sin(angle)
        matrix[..., i, j] = -matrix[..., j, i]
    across[..., 0, 0] = along[..., 2, 2] = across[..., 3, 3] = along[..., 3, 3] = 1.0
    beta = np.stack([one.beta for one in tables])
    if beta.any():
        turn = Rotation.from_euler("y", beta.reshape(-1, 1)).as_matrix().reshape(*beta.shape, 3, 3)
        across[..., :3, :3] = across[..., :3, :3] @ turn
    across[..., 0, 3], across[..., 1, 3], along[..., 2, 3] = columns["a"], columns["b"], columns["d"]
    base, flange = (np.stack([getattr(one, name) for one in tables]) for name in ("base", "flange"))
    is_standard = np.array([one.convention == "dh" for one in tables])[:, None, None, None]
    rows = np.where(is_standard, along @ across, across @ along)
    none = np.broadcast_to(np.eye(4), (len(tables), 1, 4, 4))
    fixed = np.where(is_standard, np.concatenate([none, rows], axis=1), np.concatenate([rows, none], axis=1))
    fixed[:, 0] = base @ fixed[:, 0]
    fixed[:, -1] = fixed[:, -1] @ flange
    return np.asarray(fixed)


def _forward(
    fixed: FloatArray, slides: BoolArray, angles: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Flange (h, m, 3), its orientation (h, m, 3, 3), axes and origins of the joints (h, m, n_joints, 3)."""
    h, m, n = angles.shape
    p = np.broadcast_to(fixed[:, None, 0, :3, 3], (h, m, 3))
    R = np.broadcast_to(fixed[:, None, 0, :3, :3], (h, m, 3, 3))
    axes, origins = np.empty((2, h, m, n, 3))
    cos, sin = np.cos(angles), np.sin(angles)
    for i in range(n):
        axes[:, :, i], origins[:, :, i] = R[..., 2], p
        if slides[i]:
            p = p + R[..., 2] * angles[:, :, i, None]
        else:
            c, s = cos[:, :, i, None], sin[:, :, i, None]
            R = np.stack([c * R[..., 0] + s * R[..., 1], c * R[..., 1] - s * R[..., 0], R[..., 2]], axis=-1)
        flat = np.ascontiguousarray(R).reshape(h, 3 * m, 3)
        p = p + (flat @ fixed[:, i + 1, :3, 3, None]).reshape(h, m, 3)
        R = (flat @ fixed[:, i + 1, :3, :3]).reshape(h, m, 3, 3)
    return p, R, axes, origins


def _fit_points(
    flange: FloatArray, R: FloatArray, points: FloatArray, tip: FloatArray, table: ReferenceTable
) -> tuple[FloatArray, BoolArray, FloatArray, FloatArray]:
    """Residuals (h, m, 3), readings kept, tips and points in the frame of the base."""
    kept = np.ones(points.shape[:2], dtype=bool)
    tips = flange + np.einsum("hmij,hj->hmi", R, tip)
    R_rb, t_rb = _aligned(tips, points) if "base" in table.free else _standing(len(points))
    columns = slice(0 if "base" in table.free else 6, 9 if "tip" in table.free else 6)
    for step in range(STEPS + 1):
        tips = flange + np.einsum("hmij,hj->hmi", R, tip)
        in_base = np.einsum("hji,hmj->hmi", R_rb, points - t_rb[:, None])
        residuals = tips - in_base
        if step:
            kept = _least(residuals, table.n_kept)
        if step == STEPS or columns.start == columns.stop:
            break
        eye = np.broadcast_to(np.eye(3), R.shape)
        J = np.concatenate([-cross_matrix(in_base), eye, R], axis=-1)[..., columns]
        change = np.zeros((len(points), 9))
        change[:, columns] = _step(J, residuals, kept)
        turn = _no_longer_than(MAX_TURN, change[:, :3])
        t_rb = t_rb + np.einsum("hij,hj->hi", R_rb, change[:, 3:6])
        R_rb = R_rb @ Rotation.from_rotvec(turn).as_matrix()
        tip = tip + _no_longer_than(MAX_TIP_CHANGE, change[:, 6:])
    return residuals, kept, tip, in_base


def _step(J: FloatArray, residuals: FloatArray, kept: BoolArray) -> FloatArray:
    """(h, k) Gauss-Newton steps of the readings that are kept."""
    h, m, _, k = J.shape
    J = np.where(kept[:, :, None, None], J, 0.0).reshape(h, 3 * m, k)
    Jt = J.transpose(0, 2, 1)
    normal = Jt @ J
    diagonal = np.einsum("hii->hi", normal)
    scale = 1 / np.sqrt(np.maximum(diagonal, 1e-12))
    normal = normal * scale[:, :, None] * scale[:, None] + RIDGE * np.eye(k)
    right = -(Jt @ residuals.reshape(h, 3 * m, 1)) * scale[:, :, None]
    return np.asarray((np.linalg.solve(normal, right) * scale[:, :, None])[..., 0])


def _no_longer_than(most: float, vectors: FloatArray) -> FloatArray:
    """Vectors (h, 3), the longer ones shortened."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors * np.minimum(1.0, most / np.maximum(lengths, 1e-12)))


def _least(residuals: FloatArray, n: int) -> BoolArray:
    """(h, m) the n readings with the least residuals."""
    squares = (residuals**2).sum(axis=-1)
    kept = np.zeros(squares.shape, dtype=bool)
    np.put_along_axis(kept, np.argsort(squares, axis=1, kind="stable")[:, :n], True, axis=1)
    return kept


def _aligned(tips: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rigid motions (h, 3, 3), (h, 3) of least squares from tips to points (see `alignment.align`)."""
    centre_b, centre_r = tips.mean(axis=1), points.mean(axis=1)
    U, _, Vt = np.linalg.svd((points - centre_r[:, None]).transpose(0, 2, 1) @ (tips - centre_b[:, None]))
    flip = np.ones((len(tips), 3))
    flip[:, 2] = np.sign(np.linalg.det(U @ Vt))
    turn = (U * flip[:, None]) @ Vt
    return turn, centre_r - np.einsum("hij,hj->hi", turn, centre_b)


def _standing(h: int) -> tuple[FloatArray, FloatArray]:
    return np.tile(np.eye(3), (h, 1, 1)), np.zeros((h, 3))


def _fit_seats(
    flange: FloatArray, R: FloatArray, tip: FloatArray, table: ReferenceTable, interpretations: Sequence[Interpretation]
) -> tuple[FloatArray, BoolArray, FloatArray, FloatArray]:
    """As `_fit_points`, of seats and the lengths between them: only the tip is fitted."""
    h, m = flange.shape[:2]
    kept = np.ones((h, m), dtype=bool)
    shifts = np.array([one.shift for one in interpretations])
    seat = np.stack([table.seats[shift] for shift in shifts.tolist()])
    flat = R.reshape(h, m, 9)
    tips = means = flange
    for step in range(STEPS + 1):
        same = (seat[:, :, None] == seat[:, None]) & kept[:, None, :]
        mean = same / np.maximum(same.sum(axis=-1, keepdims=True), 1)
        tips = flange + np.einsum("hmij,hj->hmi", R, tip)
        means = mean @ tips
        residuals = tips - means
        if step:
            kept = _least(residuals, table.n_kept)
        if step == STEPS or "tip" not in table.free:
            break
        J = (flat - mean @ flat).reshape(h, m, 3, 3)
        of_lengths = length_rows(table, interpretations, seat, means, (mean @ flat).reshape(h, m, 3, 3))
        if of_lengths is None:
            tip = tip + _no_longer_than(MAX_TIP_CHANGE, _step(J, residuals, kept))
            continue
        off, by_tip = of_lengths
        whole = np.concatenate([J, np.zeros((h, len(off[0]), 3, 3))], axis=1)
        whole[:, m:, 0] = by_tip
        rest = np.concatenate([residuals, np.zeros((h, len(off[0]), 3))], axis=1)
        rest[:, m:, 0] = off
        step_of_tip = _step(whole, rest, np.pad(kept, ((0, 0), (0, len(off[0]))), constant_values=True))
        tip = tip + _no_longer_than(MAX_TIP_CHANGE, step_of_tip)
    return residuals, kept, tip, means


def length_rows(
    table: ReferenceTable,
    interpretations: Sequence[Interpretation],
    seat: IntArray,
    means: FloatArray,
    mean_derivatives: FloatArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Deviations (h, l) of lengths between mean tips from the stated ones, and their derivatives (h, l, k).

    `mean_derivatives` (h, m, 3, k) are those of the mean tips of each reading's seat by k parameters. A length counts
    as the readings of its seats together.
    """
    if not len(table.lengths):
        return None
    h = len(means)
    factor = np.array([one.length_factor for one in interpretations])
    off, derivatives = np.zeros((h, len(table.lengths))), np.zeros((h, len(table.lengths), mean_derivatives.shape[-1]))
    each = np.arange(h)
    for k, (a, b, length, _) in enumerate(table.lengths):
        at_a, at_b = (np.argmax(seat == end, axis=1) for end in (a, b))
        there = (seat == a).any(axis=1) & (seat == b).any(axis=1)
        apart = means[each, at_a] - means[each, at_b]
        size = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
        weight = there * np.sqrt(0.5 * np.minimum((seat == a).sum(axis=1), (seat == b).sum(axis=1)))
        off[:, k] = weight * (size - factor * length)
        apart_by = mean_derivatives[each, at_a] - mean_derivatives[each, at_b]
        derivatives[:, k] = weight[:, None] * np.einsum("hi,hij->hj", apart / size[:, None], apart_by)
    return off, derivatives
