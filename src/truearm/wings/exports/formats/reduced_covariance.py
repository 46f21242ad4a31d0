"""The covariance of a model's coefficients in a small table: leading directions, and by joint what remains.

With the covariance ``F^T F`` and ``G = sum J^T J`` over poses of the trained region, each divided by the variance that
the model states there, the eigenvectors of ``F G F^T`` are the directions in which the coefficients' uncertainty shows
most at tips. What the leading ones omit is mostly the errors of high order about the joints' own axes, each of which
hardly matters and which are hardly correlated between joints. So each joint has a further variance about its axis,
tabulated over its angle, fitted to what remains, and the tip one of its own along each axis of the frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array, hstack
from scipy.sparse.linalg import lsqr

from truearm.identification.terms import ArmState
from truearm.models import IdentifiedModel
from truearm.models.training_conditions import InputRange
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.wings.exports.formats.plain_model import CovarianceRows, PlainModel, Run, ValueLayout, runs_of

# Poses from which directions and variances are computed, and others that judge them.
N_POSES, N_JUDGES = 8000, 2000
# Poses beyond the region, so that the table is roughly right there too: joint ranges with their gaps and longer by a
# quarter at both ends, temperatures 15 K beyond, loads by their span.
N_BEYOND, BEYOND_SHARE, BEYOND_KELVIN = 3000, 0.25, 15.0
# What they count beside one of the region.
BEYOND_WEIGHT = 0.03
# Up to so many coefficients all directions are written, which is exact.
MAX_EXACT = 96
# Largest relative error of a standard uncertainty at the judging poses. At five times as many the largest is less
# than twice that.
TOLERANCE = 0.006
# Directions are added by so many, a multiple of what a processor adds at once.
RANK_STEP, MAX_RANK = 16, 512
# Share of the smallest variance that rounding of the table to whole numbers may have: of a large table, whose errors
# average out, and of a small one.
ROUNDING_SHARE, FINE_SHARE = 1e-4, 1e-7
# Nodes of a joint's variance over a turn: this many for the shortest period of its harmonics.
NODES_PER_PERIOD, MIN_NODES, MAX_NODES = 6.5, 16, 1024
# Ridge of the fit, relative to a node's own equations: nodes without poses stay at zero.
RIDGE = 0.03
MAX_ITERATIONS = 300
# Share of the reach: a tip this near to a joint's axis does not show its angle, and small motions change the lever.
SHORT_LEVER = 0.01


@dataclass(frozen=True, eq=False)
class JointVariances:
    """A variance of each joint about (of a sliding one along) its axis, piecewise linear over its angle.

    Attributes
    ----------
    lower, per_unit : (n_joints,) array
        The first node's angle [rad, or mm], and nodes per rad or mm.
    first, count : (n_joints,) int array
        The joint's nodes in `variance`.
    variance : (n_nodes,) array
        [rad^2, or mm^2].
    of_axes : (3,) array
        The tip's own variance along the axes of the frame [mm^2].
    """

    lower: FloatArray
    per_unit: FloatArray
    first: IntArray
    count: IntArray
    variance: FloatArray
    of_axes: FloatArray

    @classmethod
    def nodes(cls, low: FloatArray, high: FloatArray, prismatic: BoolArray, highest: Sequence[int]) -> JointVariances:
        """Nodes with variances of zero from low to high, dense enough for harmonics up to the highest order."""
        periods = np.where(prismatic, 0.0, (high - low) / (2 * np.pi) * np.array(highest))
        count = np.clip(np.ceil(NODES_PER_PERIOD * periods), MIN_NODES, MAX_NODES).astype(np.intp)
        span = np.where(high > low, high - low, 1.0)
        first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.intp)
        return cls(low, (count - 1) / span, first, count, np.zeros(int(count.sum())), np.zeros(3))

    def design(self, angles: FloatArray, levers: FloatArray) -> csr_array:
        """(3 n, n_nodes + 3) share of each variance in those of the coordinates, with levers (n, n_joints, 3) [mm]."""
        n = len(angles)
        rows, columns, values = [], [], []
        for joint, count in enumerate(self.count):
            at = np.clip((angles[:, joint] - self.lower[joint]) * self.per_unit[joint], 0.0, count - 1.0)
            below = np.minimum(at.astype(np.intp), count - 2)
            squares = levers[:, joint] ** 2
            for node, share in ((below, 1 - (at - below)), (below + 1, at - below)):
                rows.append(np.arange(3 * n))
                columns.append(np.repeat(self.first[joint] + node, 3))
                values.append((squares * share[:, None]).ravel())
        shape = (3 * n, len(self.variance))
        by_node = csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
        return csr_array(hstack([by_node, csr_array(np.tile(np.eye(3), (n, 1)))]))

    def with_values(self, values: FloatArray) -> JointVariances:
        """The same nodes with variances (n_nodes + 3,), none below zero."""
        values = np.maximum(values, 0.0)
        return JointVariances(self.lower, self.per_unit, self.first, self.count, values[:-3], values[-3:])

    @property
    def values(self) -> FloatArray:
        """(n_nodes + 3,) variances in the order of `design`."""
        return np.concatenate([self.variance, self.of_axes])


@dataclass(frozen=True, eq=False)
class ReducedCovariance:
    """The covariance of an identified model's coefficients as an integer table and what it omits.

    Attributes
    ----------
    runs : tuple of Run
        Components and values of the table's rows.
    entries : (n_rows, rank) int array
        Deviation of a motion along each direction, in units of `quantum`.
    quantum : (n_rows,) array
        [rad, or mm].
    remainder : JointVariances or None
        None where no direction is omitted.
    largest_error : float
        Largest relative difference of a coordinate's standard uncertainty from the model's at poses of the trained
        region that were not used to make the table.
    """

    runs: tuple[Run, ...]
    entries: IntArray
    quantum: FloatArray
    remainder: JointVariances | None
    largest_error: float

    @property
    def rank(self) -> int:
        """Number of directions."""
        return int(self.entries.shape[1])


@dataclass(frozen=True, eq=False)
class _Poses:
    """Poses of the trained region with what the model states there.

    `spread` (3 n, p) are deviations of the coordinates by independent deviations of the coefficients, `own` (3 n,)
    their variances, `unexplained` (3 n,) the residual variances, `effects` (p,) root mean squares of the derivatives.
    """

    angles: FloatArray
    levers: FloatArray
    spread: npt.NDArray[np.float32]
    own: FloatArray
    unexplained: FloatArray
    effects: FloatArray

    @classmethod
    def of(cls, plain: PlainModel, state: ArmState) -> _Poses:
        model, n, kept, p = plain.model, len(state), plain.coefficients, plain.covariance_root.shape[1]
        root = plain.covariance_root.T.astype(np.float32)
        spread, squares = np.empty((n, 3, len(root.T)), dtype=np.float32), np.zeros(p)
        for rows, _, columns in model.fit_.perturbed_chain.derivatives(state, model.fit_.coefficients):
            part = columns[kept].reshape(p, 3 * columns.shape[2])
            squares += np.einsum("pn,pn->p", part, part)
            spread[rows] = (part.astype(np.float32).T @ root).reshape(3, columns.shape[2], p).transpose(1, 0, 2)
        axes = model.fit_.chain.tip_derivatives(state.angles).motion_jacobian[:, 1:-1]
        levers = np.where(plain.chain.is_prismatic[:, None], axes[:, :, 5], axes[:, :, 2])
        short = np.sqrt((levers**2).sum(axis=2).mean(axis=0)) < SHORT_LEVER * plain.chain.reach
        levers[:, short & ~plain.chain.is_prismatic] = 0.0
        flat = spread.reshape(3 * n, p)
        unexplained = model.residual_std_**2 * model.variance_function_.share(state.angles)
        own = np.einsum("np,np->n", flat, flat, dtype=np.float64)
        return cls(state.angles, levers, flat, own, np.repeat(unexplained, 3), np.sqrt(squares / (3 * n)))

    @property
    def total(self) -> FloatArray:
        """(3 n,) variances of the coordinates [mm^2]."""
        return np.asarray(self.own + self.unexplained)


def sample_trained_region(model: IdentifiedModel, n: int, rng: np.random.Generator, *, beyond: int = 0) -> ArmState:
    """States drawn evenly from what a model was trained on: angles without their gaps, temperatures, loads.

    Parameters
    ----------
    model : IdentifiedModel
    n : int
        States.
    rng : Generator
    beyond : int
        Further states after them, from a wider region.
    """
    training = model.training_
    angles = np.empty((n, len(training.angle_ranges)))
    for joint, (low, high) in enumerate(training.angle_ranges):
        gaps = training.angle_gaps[training.angle_gaps[:, 0] == joint, 1:]
        ends = np.concatenate([[low], np.sort(gaps.ravel()), [high]]).reshape(-1, 2)
        lengths = ends[:, 1] - ends[:, 0]
        begins = np.concatenate([[0.0], np.cumsum(lengths)])
        at = rng.uniform(0, begins[-1], n)
        part = np.clip(np.searchsorted(begins, at, side="right") - 1, 0, len(lengths) - 1)
        angles[:, joint] = ends[part, 0] + at - begins[part]
    low, high = _wider_ranges(model)
    angles = np.concatenate([angles, rng.uniform(low, high, (beyond, len(low)))])

    def drawn(known: InputRange, further: float) -> FloatArray:
        # The mean of a new set-up, which counts where an input is not stated, may be beyond the range.
        inside = rng.uniform(min(known.lower, known.mean), max(known.upper, known.mean), n)
        return np.concatenate([inside, rng.uniform(known.lower - further, known.upper + further, beyond)])

    temperature = training.temperature_degC
    return ArmState.of(
        model.arm_,
        angles,
        temperature_degC=None if temperature is None else drawn(temperature, BEYOND_KELVIN),
        columns={name: drawn(known, known.upper - known.lower) for name, known in training.columns.items()},
        directions=rng.choice([-1.0, 1.0], size=angles.shape),
    )


def _wider_ranges(model: IdentifiedModel) -> tuple[FloatArray, FloatArray]:
    """(n_joints,) lower and upper ends of the trained angles, widened as far as the joints' limits permit."""
    low, high = model.training_.angle_ranges.T
    further = BEYOND_SHARE * (high - low)
    lower, upper = model.arm_.limits.T
    return np.minimum(np.maximum(low - further, lower), low), np.maximum(np.minimum(high + further, upper), high)


def reduced_covariance(plain: PlainModel, layout: ValueLayout) -> ReducedCovariance:
    """The covariance of a model's coefficients with as few directions as its standard uncertainties need.

    Parameters
    ----------
    plain : PlainModel
        Tables of the model.
    layout : ValueLayout
        Of its values.
    """
    model, rows = plain.model, CovarianceRows.of(plain, layout)
    p = plain.covariance_root.shape[1]
    if p <= MAX_EXACT:
        poses = _Poses.of(plain, sample_trained_region(model, N_JUDGES, np.random.default_rng(1)))
        return _rounded(rows, plain.covariance_root.T, poses, None, 0.0)
    weight = np.repeat(np.where(np.arange(N_POSES + N_BEYOND) < N_POSES, 1.0, BEYOND_WEIGHT), 3)
    states = sample_trained_region(model, N_POSES, np.random.default_rng(1), beyond=N_BEYOND)
    poses = _Poses.of(plain, states)
    judges = _Poses.of(plain, sample_trained_region(model, N_JUDGES, np.random.default_rng(2)))
    directions = _leading_directions(poses, weight)
    nodes = JointVariances.nodes(*_wider_ranges(model), plain.chain.is_prismatic, [k for _, k in layout.harmonics])
    leading = directions[:, :MAX_RANK].astype(np.float32)
    squares, judged_squares = (np.asarray((one.spread @ leading) ** 2, dtype=np.float32) for one in (poses, judges))
    design, judged_design = (nodes.design(one.angles, one.levers) for one in (poses, judges))
    weight = weight / poses.total

    def remaining(rank: int) -> tuple[JointVariances, float]:
        """Variances that remain after the leading directions, and the largest error of a standard uncertainty."""
        rest = poses.own - squares[:, :rank].sum(axis=1, dtype=float)
        remainder = nodes.with_values(_ridge_solution(design, rest, weight))
        kept = judged_squares[:, :rank].sum(axis=1, dtype=float) + judged_design @ remainder.values
        ratio = (kept + judges.unexplained) / judges.total
        return remainder, float(np.abs(np.sqrt(ratio) - 1).max())

    ranks = [*range(RANK_STEP, min(p, MAX_RANK) + 1, RANK_STEP)]
    low, high = 0, len(ranks) - 1  # the error falls with the rank, up to chance
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if remaining(ranks[middle])[1] <= TOLERANCE else (middle + 1, high)
    remainder, error = remaining(ranks[low])
    return _rounded(rows, plain.covariance_root.T @ directions[:, : ranks[low]], judges, remainder, error)


def _ridge_solution(design: csr_array, values: FloatArray, weight: FloatArray) -> FloatArray:
    """Weighted least squares with columns of one size."""
    weighted = design.multiply(weight[:, None]).tocsc()
    scale = np.sqrt(np.asarray(weighted.multiply(weighted).sum(axis=0)).ravel())
    scale = np.where(scale > 0, scale, 1.0)
    solved = lsqr(weighted.multiply(1 / scale[None, :]).tocsr(), values * weight, damp=RIDGE, iter_lim=MAX_ITERATIONS)
    return np.asarray(solved[0] / scale)


def _leading_directions(poses: _Poses, weight: FloatArray) -> FloatArray:
    """(p, p) orthonormal directions of the coefficients' deviations, those first that show most at tips."""
    weighted = poses.spread * np.sqrt(weight / poses.total).astype(np.float32)[:, None]
    values, vectors = np.linalg.eigh((weighted.T @ weighted).astype(float))
    return np.asarray(vectors[:, np.argsort(-values)])


def _rounded(
    rows: CovarianceRows, by_direction: FloatArray, poses: _Poses, remainder: JointVariances | None, error: float
) -> ReducedCovariance:
    """The table in whole numbers, each row's unit so small that tips do not show the rounding."""
    table = rows.of_coefficient @ by_direction
    # A row's effect on tips, from those of its coefficients.
    shares = np.abs(rows.of_coefficient)
    effect = np.max(np.where(shares > 0, poses.effects / np.where(shares > 0, shares, 1.0), 0.0), axis=1, initial=0.0)
    share = FINE_SHARE if remainder is None else ROUNDING_SHARE
    unit = np.sqrt(12 * share * poses.total.min() / max(table.size, 1))
    quantum = unit / np.where(effect > 0, effect, 1.0)
    return ReducedCovariance(
        runs=runs_of(rows.keys),
        entries=np.rint(table / quantum[:, None]).astype(np.intp),
        quantum=quantum,
        remainder=remainder,
        largest_error=error,
    )
