"""The deviations of the values of an interim check that the uncertainty of the model alone explains.

With few checks there is no scatter of earlier ones to compare a value with. But the model states what its points are
uncertain by. The errors of all coordinates of a check are normal, with the covariance ``S = D^T D + diag(std^2)``: D
are displacements that readings have in common, by the uncertainty of the model's parameters, and std what each reading
has of its own. What a model states is itself uncertain: by another operator, in other poses, on another day the scatter
is larger or smaller. Its relative standard uncertainty is `U_OF_STATED`, so that the scale of S is known as from
`FREEDOM` degrees of freedom (JCGM 100:2008, G.4.2). From both follows what an unchanged arm exceeds with a stated
probability:

- scatter in a seat: the points less their mean, ``sum |p - mean|^2 = (n - 1) s^2``, are a quadratic form of the errors,
  whose weights are the eigenvalues of S less the means;
- length error: Student's t, with the variance of the difference of both means along the length and of the artefact;
- form of a sphere: the residuals of the fit are linear in the errors. Form is the largest difference of two of them, so
  that the probability of a larger one is at most the sum of those of all pairs (Bonferroni);
- diameter: linear in the errors too, Student's t. Nobody states it, so it is compared with those of earlier checks.

So quantiles are needed of sums of squares of normal errors that differ in size or are correlated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr, roots_genlaguerre, stdtrit

from truearm.errors import InputError
from truearm.typing import FloatArray, IntArray

# Relative, of the root of a saddlepoint and of a quantile.
_TOLERANCE = 1e-10


def quadratic_form_quantile_beyond(weights: FloatArray, probability: float, *, freedom: float = np.inf) -> float:
    """The value that a sum of weighted squares exceeds with a probability.

    The sum is ``Q = sum w_i z_i^2 / s^2`` of independent standard normal z. The square s^2 is 1, or, with finite
    `freedom` m, a chi-squared variable of m degrees of freedom over m, for variances whose common scale is known no
    better than m readings tell it. With equal weights ``Q / sum w`` is an F variable.

    Parameters
    ----------
    weights : (n,) array
        Eigenvalues of the covariance of the errors, 0 or more.
    probability : float
        Below 0.3, so that the value is above the mean.
    freedom : float
        1 or more.

    Returns
    -------
    float
        In the unit of the weights; 0 if all are 0.

    Raises
    ------
    InputError
        If a weight is negative or not finite, the probability is not between 0 and 0.3, or the freedom is below 1.

    Notes
    -----
    The tail by a saddlepoint of ``K(t) = -1/2 sum log(1 - 2 t w_i) - m/2 log(1 + 2 t x / m)``, the cumulant generating
    function of ``sum w_i z_i^2 - x s^2``, of which the sign is asked: ``P = 1 - Phi(r + log(v / r) / r)`` with
    ``K'(t) = 0``, ``r^2 = -2 K(t)`` and ``v = t sqrt(K''(t))`` (D. Kuonen, Biometrika 86 (1999) 929, after
    R. Lugannani, S. O. Rice 1980 [recalled]). The value is a little too large: the probability beyond it is smaller
    than stated, with a single weight and few degrees of freedom by 10 %, with several equal weights by less than 5 %.
    """
    w = np.asarray(weights, dtype=float)
    if not (np.isfinite(w).all() and (w >= 0).all()):
        raise InputError("expected finite weights of 0 or more")
    if not 0 < probability < 0.3:
        raise InputError(f"expected a probability between 0 and 0.3, got {probability:g}")
    if not freedom >= 1:
        raise InputError(f"expected 1 degree of freedom or more, got {freedom:g}")
    if not w.any():
        return 0.0
    unit = float(w.sum())
    w = w[w > 0] / unit

    def excess(x: float) -> float:
        return float(np.log(_tail(w, x, freedom) / probability))

    low, high = 1.001, 2.0  # the mean is 1, where the formula is 0/0
    while excess(high) > 0:
        low, high = high, 2 * high
    return unit * (float(brentq(excess, low, high, rtol=_TOLERANCE)) if excess(low) > 0 else low)


def _tail(w: FloatArray, x: float, freedom: float) -> float:
    """P(Q > x) of weights that sum to 1, x above 1."""

    def slope(t: float) -> float:
        return float((w / (1 - 2 * t * w)).sum() - x / (1 + 2 * t * x / freedom))

    t = float(brentq(slope, 0.0, (1 - 1e-13) / (2 * w.max())))
    of_scale = t * x if np.isinf(freedom) else freedom / 2 * np.log1p(2 * t * x / freedom)
    r = np.sqrt(np.log1p(-2 * t * w).sum() + 2 * of_scale)
    v = t * np.sqrt(2 * ((w / (1 - 2 * t * w)) ** 2).sum() + 2 * x**2 / freedom / (1 + 2 * t * x / freedom) ** 2)
    return float(ndtr(-(r + np.log(v / r) / r)))


U_OF_STATED = 0.25
"""Relative standard uncertainty of the uncertainty that a model states.

By judgement (type B) from virtual arms of the preset `shop` whose kinematic model has 150 readings: in a check, tips
were off by 0.8 to 1.3 times the stated uncertainty in the trained range, by 1.4 to 1.9 times with a joint outside.
"""

FREEDOM = 1 / (2 * U_OF_STATED**2)
"""Degrees of freedom of an uncertainty that is itself uncertain by that: 8 (JCGM 100:2008, G.3)."""

_NODES = 100  # of the integral over the scale: the form to 1 %


@dataclass(frozen=True, eq=False)
class PointErrors:
    """What the points of a check are uncertain by.

    Attributes
    ----------
    std_mm : (n,) array
        Standard deviation of a coordinate of each point, independent of all others [mm].
    shared_mm : (k, n, 3) array
        Displacements of the points by k independent causes of variance one [mm].
    """

    std_mm: FloatArray
    shared_mm: FloatArray

    def of(self, rows: IntArray) -> PointErrors:
        """Those of some of the points."""
        return PointErrors(self.std_mm[rows], self.shared_mm[:, rows])

    def along(self, directions: FloatArray) -> FloatArray:
        """(n, n) covariance of the errors along a direction (3,) at each point, (n, 3) [mm^2]."""
        shared = np.einsum("knx,nx->kn", self.shared_mm, directions)
        return np.asarray(shared.T @ shared + np.diag(self.std_mm**2 * (directions**2).sum(axis=1)))


def largest_scatter(errors: PointErrors, probability: float) -> float:
    """The twofold standard deviation in a seat that such errors exceed with a probability [mm]."""
    n = len(errors.std_mm)
    shared = errors.shared_mm - errors.shared_mm.mean(axis=1, keepdims=True)
    centring = np.eye(n) - 1 / n
    own = np.kron(centring * errors.std_mm**2 @ centring, np.eye(3))
    flat = shared.reshape(len(shared), 3 * n)
    weights = np.linalg.eigvalsh(own + flat.T @ flat)
    largest = quadratic_form_quantile_beyond(np.maximum(weights, 0.0), probability, freedom=FREEDOM)
    return 2 * float(np.sqrt(largest / (n - 1)))


def largest_length_error(
    a: PointErrors, b: PointErrors, direction: FloatArray, *, u_artefact_mm: float, probability: float
) -> float:
    """The error of a length between the means of two seats that such errors exceed with a probability [mm].

    Parameters
    ----------
    a, b : PointErrors
        Of the points in either seat; the causes of what they share are the same.
    direction : (3,) array
        Of the length, of length one.
    u_artefact_mm : float
        Standard uncertainty of the artefact [mm].
    probability : float
        Of an error of either sign.
    """
    shared = (a.shared_mm.mean(axis=1) - b.shared_mm.mean(axis=1)) @ direction
    own = sum(float((one.std_mm**2).sum()) / len(one.std_mm) ** 2 for one in (a, b))
    return float(np.sqrt(shared @ shared + own + u_artefact_mm**2)) * _two_sided(probability)


def largest_form_and_diameter(errors: PointErrors, directions: FloatArray, probability: float) -> tuple[float, float]:
    """The form and the error of the diameter of a sphere that such errors exceed with a probability each [mm].

    Parameters
    ----------
    errors : PointErrors
        Of its points, five or more.
    directions : (n, 3) array
        From its centre to the points, of length one.
    probability : float
    """
    covariance = errors.along(directions)
    jacobian = np.concatenate([directions, np.ones((len(directions), 1))], axis=1)
    solution = np.linalg.pinv(jacobian)
    residuals = np.eye(len(directions)) - jacobian @ solution
    radius_std = float(np.sqrt(solution[3] @ covariance @ solution[3]))
    spread = residuals @ covariance @ residuals
    variance = np.diagonal(spread)
    pairs = np.triu_indices(len(spread), 1)
    std = np.sqrt(np.maximum((variance[:, None] + variance - 2 * spread)[pairs], 0.0))
    return _largest_of(std[std > 0], probability), 2 * radius_std * _two_sided(probability)


def _largest_of(std: FloatArray, probability: float) -> float:
    """The magnitude that the largest of some errors of one uncertain scale exceeds with at most a probability.

    At each scale the sum over the errors, at most 1; its mean over the scales by a Gauss and Laguerre sum.
    """
    if not len(std):
        return 0.0
    nodes, weights = roots_genlaguerre(_NODES, FREEDOM / 2 - 1)
    scale, weights = np.sqrt(2 * nodes / FREEDOM), weights / weights.sum()

    def excess(x: float) -> float:
        beyond = 2 * ndtr(-x * scale[:, None] / std).sum(axis=1)
        return float(weights @ np.minimum(beyond, 1.0)) - probability

    top = float(std.max()) * _two_sided(probability / len(std))
    return float(brentq(excess, 0.0, 1.01 * top, xtol=1e-9 * top))


def _two_sided(probability: float) -> float:
    return -float(stdtrit(FREEDOM, probability / 2))
