"""How much of what an arm leaves unexplained is the same at the same pose.

Residuals are noise, independent from reading to reading, and effects without a term, which come back. Poses of a
session hardly come back, but the angles of single joints do, and encoders, bearings and gears err by the angle of their
own joint: readings with like angles of a joint share its error. Beside the terms with their priors the residuals are
therefore white noise and a Gaussian process that is a sum of functions of one joint each (D. Duvenaud, H. Nickisch,
C. E. Rasmussen, "Additive Gaussian processes", NIPS 2011). Every share of the process is as likely before the
readings; its mean by their marginal likelihood is what is stated. Where poses were read several times, the scatter of
the repeats is measured instead.

Residuals also turn with the direction in which a joint reached its angle (hysteresis, backlash), and come back wherever
the part makes the joint turn around: of a bore at the same two sides. Where the model has no terms for it, each joint's
last movement is taken from the order of the readings, and every share of the residual variance that it explains is as
likely before them. An order that says nothing shows none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from truearm.arm.chain import Chain
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.terms.basis import Direction
from truearm.identification.terms.state import ArmState
from truearm.readings.repeats import LEAST_REPEATED
from truearm.typing import FloatArray

# Order of the functions of a joint, root mean square: chosen, the highest that encoders commonly have. Their
# correlation falls to 0.6 when the joint turns by 14 deg.
ORDER = 4.0
# Share of the process that acts like motions of all joints along their own coordinate, chosen: held-out readings of
# virtual arms are most likely with 0.4 to 0.5 (preset shop, two arms, both models) and 0.7 to 1 (research).
JOINT_VARIANCE_SHARE = 0.5
# What is stated where no readings tell: the mean of all shares.
UNKNOWN_SHARE = 0.5
# Of more readings an even selection: some thousand pairs of them have like angles of a joint.
MOST_READINGS, LEAST_READINGS = 120, 20
_SHARES = np.linspace(0.0, 1.0, 11)


class Repeating(NamedTuple):
    """What of the residuals comes back.

    Attributes
    ----------
    share : float
        Share of the residual variance that is the same at the same pose, 0 to 1; 1/2 where too few readings tell.
    hysteresis : (2, n_joints) array
        Mean and standard deviation of each joint's rotation, or travel, by the direction of its last movement, that the
        model does not correct [rad or mm]; 0 where too few readings tell.
    """

    share: float
    hysteresis: FloatArray


def repeating_residuals(
    fit: IdentificationResult,
    state: ArmState,
    directions: FloatArray,
    points: FloatArray,
    point_variance: FloatArray,
    variance: FloatArray,
) -> Repeating:
    """Estimate what of the residuals comes back at the same pose, and in the same direction of movement.

    Parameters
    ----------
    fit : IdentificationResult
        With the priors of its terms.
    state : ArmState
        Of n readings.
    directions : (n, n_joints) array
        Of the last movement of each joint, -1 to 1; 0 where it is not known.
    points : (n, 3) array
        Their reference points [mm].
    point_variance, variance : (n,) array
        Of a coordinate of them, by the reference, and by what the arm leaves unexplained [mm^2].
    """
    unknown = Repeating(UNKNOWN_SHARE, np.zeros((2, fit.chain.n_joints)))
    if len(points) < LEAST_READINGS:
        return unknown
    rows = np.linspace(0, len(points) - 1, min(len(points), MOST_READINGS)).astype(int)
    at, n = state.rows(rows), 3 * len(rows)
    ((_, tips, columns),) = fit.perturbed_chain.derivatives(at, fit.coefficients)
    J = columns.transpose(2, 1, 0).reshape(n, -1)
    y = (points[rows] - tips.T).ravel() + J @ fit.coefficients
    by_prior = J * fit.prior_std
    std = np.sqrt(np.repeat(variance[rows], 3))
    of_none = by_prior @ by_prior.T + np.diag(np.repeat(point_variance[rows], 3) + std**2)
    joints = JointProcess(fit.chain)
    change = std[:, None] * joints.covariance(at.angles).reshape(n, n) * std - np.diag(std**2)
    covariances = [of_none + share * change for share in _SHARES]
    evidence = np.array([_log_likelihood(y, one) for one in covariances])
    if not np.isfinite(evidence).any():
        return unknown
    share = float(_SHARES @ _weights(evidence))
    has_terms = any(isinstance(basis, Direction) for basis in fit.perturbed_chain.input_bases(at))
    if has_terms or not directions[rows].any():
        return unknown._replace(share=share)
    turns = directions[rows][:, :, None] * joints.radians[:, None] * joints.own_motions(at.angles)
    D = turns.transpose(0, 2, 1).reshape(n, -1)
    freedom = max(n - sum(group.effective for group in fit.groups), 1.0)
    found = _hysteresis(y, D, covariances[int(evidence.argmax())], float((std**2).mean()), freedom)
    return Repeating(share, joints.radians * found)


def _hysteresis(y: FloatArray, D: FloatArray, covariance: FloatArray, variance: float, freedom: float) -> FloatArray:
    """(2, n_joints) mean and standard deviation of the coefficients of D (n, n_joints) in y (n,).

    Of one prior variance for all, by every share of the residual variance (mm^2), with its weight; the rest of it
    remains. `freedom` is the number of degrees of freedom of the residuals.
    """
    factor = cholesky(covariance, lower=True, check_finite=False)
    white = solve_triangular(factor, np.column_stack([D, y]), lower=True, check_finite=False)
    values, vectors = np.linalg.eigh(white[:, :-1].T @ white[:, :-1])
    along = vectors.T @ (white[:, :-1].T @ white[:, -1])
    # Small shares matter, as what turns with the direction is not averaged away.
    share = _SHARES[:-1, None] ** 2
    prior = share * variance * len(D) / max(float((D**2).sum()), np.finfo(float).tiny)
    values, along = np.maximum(values, 0.0) / (1 - share), along / (1 - share)
    shrunk = prior / (1 + prior * values)
    evidence = (along**2 * shrunk - np.log1p(prior * values)).sum(axis=1) / 2
    rest = 1 - share[:, 0]
    evidence -= (freedom * np.log(rest) + white[:, -1] @ white[:, -1] / rest) / 2
    evidence[0] += np.log(len(rest))  # none is as likely as any
    each, weights = (shrunk * along) @ vectors.T, _weights(evidence)
    mean = weights @ each
    return np.stack([mean, np.sqrt(weights @ ((each - mean) ** 2 + shrunk @ (vectors**2).T))])


def _weights(evidence: FloatArray) -> FloatArray:
    """Probabilities by the logarithms of the evidence, all as likely before."""
    weight = np.exp(evidence - evidence.max())
    return np.asarray(weight / weight.sum())


def of_one_reading(variance: float, share: float, readings: PreparedReadings) -> tuple[float, float]:
    """Residual variance [mm^2] of one reading, and the share of it that repeats, by those of `readings`.

    They are the same unless some readings are means of repeats, which scatter by less.
    """
    if readings.n_repeats is None:
        return variance, share
    of_one = variance + readings.averaged_mm2
    if (readings.n_repeats > 1).sum() < LEAST_REPEATED:
        return of_one, share * variance / of_one
    return of_one, max(1 - readings.repeat_std_mm**2 / of_one, 0.0)


@dataclass(frozen=True)
class JointProcess:
    """The process of residuals that come back: a sum of functions of one joint each."""

    chain: Chain
    order: ClassVar[float] = ORDER

    @property
    def radians(self) -> FloatArray:
        """(n_joints,) equivalent of a radian for each joint [rad, or mm]: of a sliding one a third of the reach."""
        return np.where(self.chain.is_prismatic, self.chain.reach / 3, 1.0)

    def covariance(self, angles: FloatArray) -> FloatArray:
        """(n, 3, n, 3) covariance of the process at poses (n, n_joints), of a mean variance of 1 in every pose."""
        turned = angles / self.radians
        alike = np.exp(-(ORDER**2) * (1 - np.cos(turned[:, None] - turned)))
        alike = np.concatenate([alike, np.repeat(alike.mean(axis=2, keepdims=True), 3, axis=2)], axis=2)
        moved, n = self.unit_displacements(angles), len(angles)
        there = alike.transpose(0, 2, 1)[..., None] * moved.transpose(1, 0, 2)
        return np.asarray(moved.transpose(0, 2, 1) @ there.reshape(n, -1, 3 * n)).reshape(n, 3, n, 3)

    def unit_displacements(self, angles: FloatArray) -> FloatArray:
        """(n, n_joints + 3, 3) displacement of the tip by each function of the process at poses (n, n_joints) [mm].

        First by each joint along its own coordinate, all alike, then along each axis: `JOINT_VARIANCE_SHARE` of the
        variance and the rest. In every pose a coordinate has the variance 1 mm^2, the mean of the three.
        """
        by_joints = self.radians[:, None] * self.own_motions(angles)
        size = np.sqrt((by_joints**2).sum(axis=(1, 2), keepdims=True) / 3)
        # No joint moves a tip that is on the axes of all joints.
        by_joints = np.sqrt(JOINT_VARIANCE_SHARE) * by_joints / np.where(size > 0, size, 1.0)
        even = np.broadcast_to(np.sqrt(1 - JOINT_VARIANCE_SHARE) * np.eye(3), (len(angles), 3, 3))
        return np.concatenate([by_joints, even], axis=1)

    def own_motions(self, angles: FloatArray) -> FloatArray:
        """(n, n_joints, 3) displacement of the tip by each joint along its own coordinate [mm/rad or mm/mm]."""
        along_z = np.where(self.chain.is_prismatic, 5, 2)
        return self.chain.tip_derivatives(angles).motion_jacobian[:, np.arange(self.chain.n_joints) + 1, along_z]


def _log_likelihood(y: FloatArray, covariance: FloatArray) -> float:
    """Of y (n,), up to a constant; minus infinity where rounding leaves no covariance."""
    try:
        factor = cholesky(covariance, lower=True, check_finite=False)
    except LinAlgError:
        return -np.inf
    white = solve_triangular(factor, y, lower=True, check_finite=False)
    return float(-np.log(factor.diagonal()).sum() - white @ white / 2)
