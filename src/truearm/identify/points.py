"""Constant small motions of a chain, identified from tip positions that a reference instrument saw."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from truearm.arm.chain import Chain, exponential_derivative
from truearm.identify.alignment import align
from truearm.solve import Nielsen, NormalEquations, Settled, levenberg_marquardt
from truearm.solve.threads import one_blas_thread

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# Rounds of reweighting, at most: the weights of the UR10 sets change by less than a percent after the third.
ROUNDS = 4
# Rounds end when no weight changes by a larger share: the motions then move by less than that of their uncertainty.
SETTLED_WEIGHTS = 1e-4
# Residuals longer than this many medians weigh less, by Huber's rule; of Gaussian residuals 0.5 % are longer than 2.5.
HUBER_MEDIANS = 3.0
# The first damping, as a share of the matrix's largest diagonal element. Priors keep the matrix definite, and a chain
# is nearly linear in its small motions: the first steps are Gauss-Newton's. Damping that a radian's column (a metre of
# lever) hardly feels would hold a millimetre's fast: their squares differ by a million.
FIRST_DAMPING = 1e-12


@dataclass(frozen=True, eq=False)
class PointProblem:
    """Maximum a posteriori fit of constant motions to tip positions, as a least-squares problem.

    Parameters
    ----------
    chain : Chain
        The chain without the motions; its tips come out in the frame of `points`.
    angles : (n, n_joints) array
        [rad], or [mm] for sliding joints.
    points : (n, 3) array
        [mm].
    weights : (n, 3) array
        What a residual is multiplied with: one over its standard deviation [1/mm].
    prior_std : (n_places, 6) array
        Standard deviations of the motions' components about zero [rad, mm]; 0 keeps one at zero.
    """

    chain: Chain
    angles: FloatArray
    points: FloatArray
    weights: FloatArray
    prior_std: FloatArray

    @property
    def free(self) -> BoolArray:
        """(n_places, 6) which components are sought; in this order they make up the parameters."""
        return np.asarray(self.prior_std > 0)

    def motions(self, x: FloatArray) -> FloatArray:
        """(n_places, 6) motions of parameters `x`."""
        motions = np.zeros(self.prior_std.shape)
        motions[self.free] = x
        return motions

    def cost(self, x: FloatArray) -> float:
        """Half the sum of squared weighted residuals and prior deviations."""
        residuals = self.weights * (self.chain.with_motions(self.motions(x)).tip_in_base(self.angles) - self.points)
        deviations = x / self.prior_std[self.free]
        return 0.5 * (float(np.vdot(residuals, residuals)) + float(deviations @ deviations))

    def normal_equations(self, x: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton matrix."""
        motions = self.motions(x)
        moved = self.chain.with_motions(motions)
        size = self.prior_std.size
        cost, gradient, gram = 0.0, np.zeros(size), np.zeros((size, size))
        for rows, tips, by_motion in moved.small_motions_by_chunk(self.angles):
            weights = self.weights[rows].T
            residuals = (weights * (tips - self.points[rows].T)).ravel()
            columns = np.multiply(by_motion, weights, out=by_motion).reshape(size, -1)
            cost += 0.5 * float(residuals @ residuals)
            gradient += columns @ residuals
            gram += columns @ columns.T
        to_components = small_motion_of_component(motions)[:, self.free.ravel()]
        precision = self.prior_std[self.free] ** -2.0
        gram = to_components.T @ gram @ to_components
        gram.flat[:: len(gram) + 1] += precision
        return NormalEquations(
            cost + 0.5 * float(precision @ (x * x)), to_components.T @ gradient + precision * x, gram
        )


@dataclass(frozen=True, eq=False)
class PointFit:
    """Identified motions.

    Attributes
    ----------
    chain : Chain
        The chain with the motions composed.
    motions : (n_places, 6) array
        [rad, mm].
    covariance : (n_places * 6, n_places * 6) array
        Posterior covariance, as small motions at the places of `chain` [rad, mm].
    noise_std : float
        Standard deviation of a coordinate that neither the motions nor the reference's own uncertainty explains [mm].
    weights : (n,) array
        Robust weight of every reading, 1 for an ordinary one.
    converged : bool
    """

    chain: Chain
    motions: FloatArray
    covariance: FloatArray
    noise_std: float
    weights: FloatArray
    converged: bool


def small_motion_of_component(motions: FloatArray) -> FloatArray:
    """(n_places * 6, n_places * 6) small motions of the moved chain's places by the components of `motions`.

    After joint i a motion stands to the left of F_i, where the place is; at the base it stands to the right of F_0, so
    there the change is seen from the other side of the motion: rotation ``J(-r) dr``, translation ``Rot(r)^T dt``.
    """
    blocks = exponential_derivative(motions)
    r = motions[0, :3]
    base = np.zeros((6, 6))
    base[:3, :3] = exponential_derivative(-motions[0])[:3, :3]
    base[3:, 3:] = Rotation.from_rotvec(r).as_matrix().T
    return np.asarray(block_diag(base, *blocks[1:]))


def placed_roughly(chain: Chain, angles: FloatArray, points: FloatArray) -> Chain:
    """The chain moved as a whole to where its tips come nearest to `points` (n, 3) [mm]."""
    return chain.placed(align(chain.tip_in_base(angles), points))


def fit_points(
    chain: Chain,
    angles: FloatArray,
    points: FloatArray,
    *,
    prior_std: FloatArray,
    point_std: FloatArray | None = None,
    robust: bool = True,
) -> PointFit:
    """Identify constant motions from tip positions.

    The variance of a coordinate is that of the reference plus an unexplained part, which is estimated from the
    residuals together with robust weights (Huber, Ann. Math. Stat. 35 (1964) 73, on the residuals' length) in a few
    rounds.

    Parameters
    ----------
    chain : Chain
        Nominal; its tips come out (roughly) in the frame of `points`. Small-angle steps converge from some 30 deg and a
        third of the reach.
    angles : (n, n_joints) array
        [rad], or [mm] for sliding joints.
    points : (n, 3) array
        [mm].
    prior_std : (n_places, 6) array
        Prior standard deviations [rad, mm]: 0 fixes a component.
    point_std : (n, 3) array, optional
        Standard uncertainties of `points` [mm].
    robust : bool
        Whether far readings weigh less.

    Returns
    -------
    PointFit
    """
    n = len(angles)
    reference_variance = np.zeros((n, 3)) if point_std is None else point_std**2
    problem = PointProblem(chain, angles, points, np.ones((n, 3)), prior_std)
    x = np.zeros(int(problem.free.sum()))
    if not len(x):
        return _nothing_free(problem, reference_variance)
    robust_weights, noise_variance, result = np.ones(n), np.nan, None
    for _ in range(ROUNDS):
        residuals = problem.chain.with_motions(problem.motions(x)).tip_in_base(angles) - points
        if robust and np.isfinite(noise_variance):
            robust_weights = huber_weights(residuals)
        noise_variance = _unexplained_variance(residuals, reference_variance, robust_weights, len(x))
        weights = np.sqrt(robust_weights[:, None] / (reference_variance + noise_variance))
        if np.allclose(weights, problem.weights, rtol=SETTLED_WEIGHTS, atol=0) and result is not None:
            break
        problem = replace(problem, weights=weights)
        with one_blas_thread():
            result = levenberg_marquardt(problem, x, damping=Nielsen(FIRST_DAMPING), stops=(Settled(1e-6),))
        x = result.x
    assert result is not None
    residuals = problem.chain.with_motions(problem.motions(x)).tip_in_base(angles) - points
    noise_variance = _unexplained_variance(residuals, reference_variance, robust_weights, len(x))
    motions = problem.motions(x)
    to_small = small_motion_of_component(motions)[:, problem.free.ravel()]
    return PointFit(
        chain=chain.with_motions(motions),
        motions=motions,
        covariance=to_small @ _covariance(result.equations.gram) @ to_small.T,
        noise_std=float(np.sqrt(noise_variance)),
        weights=robust_weights,
        converged=result.reason.converged,
    )


def huber_weights(residuals: FloatArray) -> FloatArray:
    """(n,) Huber weights of residuals (n, 3): 1 up to `HUBER_MEDIANS` median lengths, as one over the length beyond."""
    lengths = np.linalg.norm(residuals, axis=1)
    threshold = HUBER_MEDIANS * np.median(lengths)
    if threshold == 0:  # more than half the residuals are exactly zero
        return np.ones(len(lengths))
    return np.asarray(threshold / np.maximum(lengths, threshold))


def _unexplained_variance(
    residuals: FloatArray, reference_variance: FloatArray, weights: FloatArray, n_parameters: int
) -> float:
    """Weighted mean square of residuals less the reference's own share, and never nothing.

    The floor (a nanometre) keeps the weights finite where the data are exact.
    """
    total = 3 * float(weights.sum())
    # No more than half the data may go to the parameters: priors hold what the data do not.
    freedom = max(total - n_parameters, total / 2)
    square = float((weights[:, None] * residuals**2).sum()) / freedom
    return max(square - float((weights[:, None] * reference_variance).sum()) / total, 1e-12)


def _covariance(gram: FloatArray) -> FloatArray:
    """Inverse of the Gauss-Newton matrix.

    Directions that neither readings nor priors determine to working precision keep a large but finite variance.
    """
    scale = 1 / np.sqrt(gram.diagonal())
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    root = (scale[:, None] * vectors) / np.sqrt(np.maximum(values, 1e-14 * values[-1]))
    return np.asarray(root @ root.T)


def _nothing_free(problem: PointProblem, reference_variance: FloatArray) -> PointFit:
    residuals = problem.chain.tip_in_base(problem.angles) - problem.points
    weights = np.ones(len(residuals))
    size = problem.prior_std.size
    return PointFit(
        chain=problem.chain,
        motions=np.zeros(problem.prior_std.shape),
        covariance=np.zeros((size, size)),
        noise_std=float(np.sqrt(_unexplained_variance(residuals, reference_variance, weights, 0))),
        weights=weights,
        converged=True,
    )
