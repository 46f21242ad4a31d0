"""Evidence for the prior scales of groups of parameters, on a linearised least-squares problem.

With normal equations ``G`` (weighted, so that residuals have unit variance) and parameters x about zero with precisions
``1 / (s_g r_i)^2``, where the ratios r within a group are given and its scale s_g is sought, the type-II likelihood is
greatest where ``s_g^2 gamma_g = sum over i in g of (x_i / r_i)^2`` with
``gamma_g = sum over i in g of 1 - Sigma_ii / (s_g r_i)^2``: MacKay's fixed point, group by group. gamma_g counts the
parameters of the group that the data, rather than the prior, determine.

Source: D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415, section 4; groups: D. J. C. MacKay,
"Bayesian non-linear modeling for the energy prediction competition", ASHRAE Trans. 100 (1994) 1053.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, cholesky
from scipy.linalg.lapack import dtrtri

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class GroupedPrior:
    """Gaussian prior about zero: standard deviations in groups that share a scale.

    Attributes
    ----------
    ratio : (p,) array
        Standard deviation of every parameter at scale 1, in its own unit.
    group : (p,) int array
        Its group.
    scale : (n_groups,) array
        Scales as they stand.
    learned : (n_groups,) bool array
        Whether the data may change them.
    """

    ratio: FloatArray
    group: IntArray
    scale: FloatArray
    learned: BoolArray

    @property
    def active(self) -> BoolArray:
        """(p,) which parameters may be other than zero: groups of scale 0 are left out."""
        return np.asarray(self.scale[self.group] > 0)

    @property
    def precision(self) -> FloatArray:
        """(p,) one over the variances; of parameters left out it is infinite."""
        with np.errstate(divide="ignore"):
            return np.asarray((self.ratio * self.scale[self.group]) ** -2.0)

    def sums(self, values: FloatArray) -> FloatArray:
        """(n_groups,) sums of values (p,) by group."""
        return np.asarray(np.bincount(self.group, values, minlength=len(self.scale)), dtype=float)


class Marginals(NamedTuple):
    """Posterior of every parameter by itself.

    Attributes
    ----------
    x : (p,) array
        Means; zero for those left out.
    variance : (p,) array
        Zero for those left out.
    """

    x: FloatArray
    variance: FloatArray


class Posterior(NamedTuple):
    """Gaussian posterior of the parameters.

    Attributes
    ----------
    x : (p,) array
        Means; zero for those left out.
    covariance : (p, p) array
        Zero for those left out.
    """

    x: FloatArray
    covariance: FloatArray


def marginals(gram: FloatArray, right: FloatArray, prior: GroupedPrior) -> Marginals:
    """Posterior of data with normal equations ``gram x = right``: means and variances."""
    active = np.flatnonzero(prior.active)
    root = _root_of_covariance(gram, prior, active)
    x, variance = np.zeros(len(gram)), np.zeros(len(gram))
    x[active] = root.T @ (root @ right[active])
    variance[active] = np.einsum("ij,ij->j", root, root)
    return Marginals(x, variance)


def posterior(gram: FloatArray, right: FloatArray, prior: GroupedPrior) -> Posterior:
    """The same with the whole covariance."""
    active = np.flatnonzero(prior.active)
    root = _root_of_covariance(gram, prior, active)
    x, covariance = np.zeros(len(gram)), np.zeros(gram.shape)
    x[active] = root.T @ (root @ right[active])
    covariance[np.ix_(active, active)] = root.T @ root
    return Posterior(x, covariance)


def _root_of_covariance(gram: FloatArray, prior: GroupedPrior, active: IntArray) -> FloatArray:
    """F with ``F^T F = (G + P)^-1`` of the active parameters.

    Columns are scaled to unit diagonal first, so that radians and millimetres may stand side by side.
    """
    matrix = gram[np.ix_(active, active)]
    scale = 1 / np.sqrt(matrix.diagonal() + prior.precision[active])
    matrix *= scale
    matrix *= scale[:, None]
    matrix.flat[:: len(matrix) + 1] = 1.0
    try:
        # With A = L L^T it is L^-1, which costs a third of A^-1.
        root, _ = dtrtri(cholesky(matrix, lower=True, check_finite=False), lower=1)
    except LinAlgError:  # rounding has left directions that nothing determines below zero: they keep a large variance
        values, vectors = np.linalg.eigh(matrix)
        root = (vectors / np.sqrt(np.maximum(values, 1e-14 * values[-1]))).T
    return np.asarray(root * scale)


def updated_scales(
    prior: GroupedPrior, found: Marginals, *, least: float, most: float
) -> tuple[FloatArray, FloatArray]:
    """One round of the fixed point.

    Parameters
    ----------
    prior : GroupedPrior
    found : Marginals
        Under `prior`.
    least, most : float
        Bounds of a scale: a group that the data have no use for goes to `least`.

    Returns
    -------
    scale : (n_groups,) array
    effective : (n_groups,) array
        Parameters determined by the data.
    """
    active = prior.active
    share = np.zeros(len(active))
    share[active] = 1 - found.variance[active] * prior.precision[active]
    effective = np.maximum(prior.sums(share), 0.0)
    sizes = prior.sums((found.x / prior.ratio) ** 2)
    told = prior.learned & (effective > 0)
    square = np.divide(sizes, effective, out=prior.scale**2, where=told)
    scale = np.where(told, np.clip(np.sqrt(square), least, most), prior.scale)
    return scale, effective
