"""Constant small motions of a chain, identified from tip positions that a reference instrument saw."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from truearm.arm.chain import Chain, exponential_derivative
from truearm.errors import InputError
from truearm.identify.alignment import align
from truearm.identify.noise import huber_weights, unexplained_variance
from truearm.solve import Epochs, Nielsen, NormalEquations, Settled, levenberg_marquardt
from truearm.solve.threads import one_blas_thread

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# Rounds of reweighting, at most. Three are enough where data outweigh the priors; a dozen readings need some sixty.
MOST_ROUNDS = 200
# Rounds end when no weight changes by a larger share: the motions then move by less than that of their uncertainty.
SETTLED_WEIGHTS = 1e-4
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
    residuals, with the effective number of parameters (D. J. C. MacKay, Neural Computation 4 (1992) 415, eq. 4.10) and
    robust weights, in rounds until the weights stand still.

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
        `converged` is False if the weights have not settled, or a step still promised progress when none was found.

    Raises
    ------
    InputError
        If a prior standard deviation is negative or not finite.
    """
    if not (np.isfinite(prior_std).all() and (prior_std >= 0).all()):
        raise InputError("expected prior standard deviations of zero or more (finite), got others")
    reference_variance = np.zeros((len(angles), 3)) if point_std is None else point_std**2
    problem = PointProblem(chain, angles, points, np.zeros((len(angles), 3)), prior_std)
    x = np.zeros(int(problem.free.sum()))
    covariance, n_effective, settled, solved = np.zeros((len(x), len(x))), 0.0, False, not len(x)
    for _ in range(MOST_ROUNDS):
        residuals = chain.with_motions(problem.motions(x)).tip_in_base(angles) - points
        noise = unexplained_variance(residuals, reference_variance, n_effective=n_effective, robust=robust)
        variance = reference_variance + noise
        trust = huber_weights(residuals, variance) if robust else np.ones(len(angles))
        weights = np.sqrt(trust[:, None] / variance)
        settled = np.allclose(weights, problem.weights, rtol=SETTLED_WEIGHTS, atol=0)
        if settled or not len(x):
            break
        problem = replace(problem, weights=weights)
        with one_blas_thread():
            result = levenberg_marquardt(problem, x, damping=Nielsen(FIRST_DAMPING), stops=(Settled(1e-6), Epochs(50)))
        x, solved = result.x, result.reason.converged
        covariance = result.covariance()
        n_effective = len(x) - float((covariance.diagonal() / prior_std[problem.free] ** 2).sum())
    motions = problem.motions(x)
    to_small = small_motion_of_component(motions)[:, problem.free.ravel()]
    return PointFit(
        chain=chain.with_motions(motions) if len(x) else chain,
        motions=motions,
        covariance=to_small @ covariance @ to_small.T,
        noise_std=float(np.sqrt(noise)),
        weights=trust,
        converged=bool(solved and (settled or not len(x))),
    )
