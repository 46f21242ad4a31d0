"""Evidence for the prior scales of groups of parameters, on a linearised least-squares problem.

With normal equations ``G`` (weighted, so that residuals have unit variance) and parameters x about zero with precisions
``1 / (s_g r_i)^2``, where the ratios r within a group are given and its scale s_g is unknown, the type-II likelihood is
greatest where ``s_g^2 gamma_g = sum over i in g of (x_i / r_i)^2`` with
``gamma_g = sum over i in g of 1 - Sigma_ii / (s_g r_i)^2``: MacKay's fixed point, group by group. gamma_g counts the
parameters of the group that the data, rather than the prior, determine.

Where the data do not determine a group, these equations do not determine its scale, which could shrink to zero or grow
without limit. A scale therefore has a wide prior: its logarithm is normally distributed about 0 with standard deviation
tau. The maximum is then where ``sum of (x_i / s_g r_i)^2 = gamma_g + log(s_g) / tau^2``, which Lambert's
function solves for s_g.

From fewer data than parameters the posterior follows with matrices of the size of the data (`LowRankEquations`). With
``G = R^T R`` of rank r, right side ``R^T y`` and priors of standard deviations s, the data alone have the covariance
``M = I + R S^2 R^T`` (r, r), and parameters follow from it as in a Gaussian process. Parameters whose priors are wide
compared with what the data know (a base, a seat) would spoil the digits of M; they are found by generalised least
squares with M of the others.

Source: D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415, section 4; groups: D. J. C. MacKay,
"Bayesian non-linear modeling for the energy prediction competition", ASHRAE Trans. 100 (1994) 1053; few data:
C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, section 2.7, eqs. 2.39 to 2.42; the
factor, N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., section 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cholesky, qr, solve_triangular
from scipy.linalg.blas import dtrmm
from scipy.linalg.lapack import dpstrf, dtrtri
from scipy.special import wrightomega

from truearm.solve.linear_algebra import MIN_PIVOT, ROUNDING, unit_diagonal
from truearm.typing import BoolArray, FloatArray, IntArray

# Largest rank, as a share of the parameters, at which this costs less than the equations of the parameters.
MAX_RANK = 0.4
# Priors are wide if the data know a parameter alone this many times better, as a ratio of variances.
WIDE = 1e4
# A right side must follow from data to this share.
MAX_REMAINDER = 1e-9
# Rows of a triangle that is not halved again.
SMALL = 64
# A group is pruned only if that increases the log evidence by this much: groups that the data hardly see remain.
MIN_GAIN = 1.0


@dataclass(frozen=True, eq=False)
class LowRankEquations:
    """Normal equations as the square of a matrix with few rows.

    Attributes
    ----------
    root : (r, p) array
        R with ``R^T R`` the matrix.
    data : (r,) array
        y with ``R^T y`` the right side.
    """

    root: FloatArray
    data: FloatArray

    @classmethod
    def of(cls, gram: FloatArray, right: FloatArray, size: FloatArray) -> LowRankEquations | None:
        """Factorise equations; None if the rank is not low, or if the right side does not follow from data."""
        p = len(gram)
        matrix, scale = unit_diagonal(gram, np.maximum(size, 0))
        factor, pivots, rank, _ = dpstrf(np.asfortranarray(matrix), tol=ROUNDING, overwrite_a=1)
        if not 0 < rank <= MAX_RANK * p:
            return None
        pivots = pivots - 1  # LAPACK counts from 1
        upper = np.triu(factor[:rank])
        root = np.empty((rank, p))
        root[:, pivots] = upper
        data = solve_triangular(upper[:, :rank], (right / scale)[pivots[:rank]], trans="T")
        if np.abs(root.T @ data - right / scale).max() > MAX_REMAINDER * np.abs(right / scale).max():
            return None
        return cls(root * scale, data)

    def solve(self, std: FloatArray) -> LowRankPosterior | None:
        """Posterior with priors of standard deviations `std` (p,); None if rounding spoils it."""
        root = self.root * std
        is_wide = (root**2).sum(axis=0) > WIDE
        narrow, wide = root[:, ~is_wide], root[:, is_wide]
        M = narrow @ narrow.T
        M.flat[:: len(M) + 1] += 1.0
        both = solve_triangular(cholesky(M, lower=True), np.column_stack([root, self.data]), lower=True)
        U, z = both[:, :-1], both[:, -1]
        H = U[:, is_wide].T @ U[:, is_wide]
        H.flat[:: len(H) + 1] += 1.0
        matrix, scale = unit_diagonal(H)
        try:
            lower = cholesky(matrix, lower=True) * scale[:, None] if wide.size else H
        except LinAlgError:
            return None
        if (lower.diagonal() ** 2 < MIN_PIVOT * H.diagonal()).any():
            return None
        return LowRankPosterior(std, is_wide, U, z, lower)


@dataclass(frozen=True, eq=False)
class LowRankPosterior:
    """Posterior of parameters by whitened data.

    Attributes
    ----------
    std : (p,) array
        Of the priors.
    is_wide : (p,) bool array
    columns : (r, p) array
        Whitened columns of the parameters in units of their priors.
    data : (r,) array
        Whitened data.
    lower : (w, w) array
        Cholesky factor of the precision of the wide parameters, in units of their priors.
    """

    std: FloatArray
    is_wide: BoolArray
    columns: FloatArray
    data: FloatArray
    lower: FloatArray

    @cached_property
    def x(self) -> FloatArray:
        """(p,) means."""
        narrow, wide = self.columns[:, ~self.is_wide], self.columns[:, self.is_wide]
        x = np.empty(len(self.std))
        right = solve_triangular(self.lower, wide.T @ self.data, lower=True) if len(self.lower) else np.zeros(0)
        x[self.is_wide] = solve_triangular(self.lower, right, lower=True, trans="T") if len(right) else right
        x[~self.is_wide] = narrow.T @ (self.data - wide @ x[self.is_wide])
        return x * self.std

    @cached_property
    def variance(self) -> FloatArray:
        """(p,) variances."""
        narrow, across, inverse = self._blocks()
        variance = np.empty(len(self.std))
        variance[self.is_wide] = (inverse**2).sum(axis=0)
        variance[~self.is_wide] = 1 - (narrow**2).sum(axis=0) + (across**2).sum(axis=0)
        return np.asarray(np.maximum(variance, 0.0) * self.std**2)

    @cached_property
    def covariance(self) -> FloatArray:
        """(p, p) covariance."""
        narrow, across, inverse = self._blocks()
        found = np.empty((len(self.std),) * 2)
        of_wide, of_narrow = np.flatnonzero(self.is_wide), np.flatnonzero(~self.is_wide)
        found[np.ix_(of_wide, of_wide)] = inverse.T @ inverse
        own = across.T @ across - narrow.T @ narrow
        own.flat[:: len(own) + 1] += 1.0
        found[np.ix_(of_narrow, of_narrow)] = own
        coupled = -across.T @ inverse
        found[np.ix_(of_narrow, of_wide)] = coupled
        found[np.ix_(of_wide, of_narrow)] = coupled.T
        return np.asarray(found * self.std * self.std[:, None])

    def times(self, vector: FloatArray) -> FloatArray:
        """(p,) the covariance times a vector (p,)."""
        (narrow, across, inverse), vector = self._blocks(), vector * self.std
        of_wide, of_narrow = vector[self.is_wide], vector[~self.is_wide]
        white, out = inverse @ of_wide - across @ of_narrow, np.empty(len(vector))
        out[self.is_wide] = inverse.T @ white
        out[~self.is_wide] = of_narrow - narrow.T @ (narrow @ of_narrow) - across.T @ white
        return out * self.std

    def block(self, rows: IntArray) -> FloatArray:
        """(m, m) covariance of some parameters."""
        return np.asarray(self.covariance[np.ix_(rows, rows)])

    def _blocks(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Narrow columns, their products with the wide ones, and the root of the latter's covariance."""
        narrow, wide = self.columns[:, ~self.is_wide], self.columns[:, self.is_wide]
        if not len(self.lower):
            return narrow, np.zeros((0, narrow.shape[1])), np.zeros((0, 0))
        inverse = solve_triangular(self.lower, np.eye(len(self.lower)), lower=True)
        return narrow, inverse @ (wide.T @ narrow), inverse


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
        Present scales.
    learned : (n_groups,) bool array
        Whether the data may change them.
    """

    ratio: FloatArray
    group: IntArray
    scale: FloatArray
    learned: BoolArray

    @property
    def active(self) -> BoolArray:
        """(p,) parameters that may differ from zero: groups of scale 0 are pruned."""
        return np.asarray(self.scale[self.group] > 0)

    @property
    def precision(self) -> FloatArray:
        """(p,) one over the variances; infinite for pruned parameters."""
        with np.errstate(divide="ignore"):
            return np.asarray((self.ratio * self.scale[self.group]) ** -2.0)

    def subset(self, which: IntArray) -> GroupedPrior:
        """The prior of some parameters."""
        return replace(self, ratio=self.ratio[which], group=self.group[which])

    def group_sums(self, values: FloatArray) -> FloatArray:
        """(n_groups,) sums of values (p,) by group."""
        return np.asarray(np.bincount(self.group, values, minlength=len(self.scale)), dtype=float)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Gaussian posterior of the parameters; pruned ones are zero and have no variance.

    Attributes
    ----------
    x : (p,) array
        Means.
    active : (k,) int array
        Parameters that are not pruned.
    root : (n, k) array
        F with ``F^T F`` their covariance.
    is_triangle : bool
        Whether F is a lower triangle.
    """

    x: FloatArray
    active: IntArray
    root: FloatArray
    is_triangle: bool

    @cached_property
    def variance(self) -> FloatArray:
        """(p,) variances: a fraction of the work of the covariance."""
        variance = np.zeros(len(self.x))
        variance[self.active] = np.einsum("ij,ij->j", self.root, self.root)
        return variance

    @cached_property
    def covariance(self) -> FloatArray:
        """(p, p) covariance."""
        own = _squared_triangle(self.root) if self.is_triangle else np.asarray(self.root.T @ self.root)
        if len(self.active) == len(self.x):
            return own
        covariance = np.zeros((len(self.x),) * 2)
        covariance[np.ix_(self.active, self.active)] = own
        return covariance

    def times(self, vector: FloatArray) -> FloatArray:
        """(p,) the covariance times a vector (p,)."""
        out = np.zeros(len(self.x))
        out[self.active] = self.root.T @ (self.root @ vector[self.active])
        return out

    def block(self, rows: IntArray) -> FloatArray:
        """(m, m) covariance of some of the active parameters, in increasing order."""
        own = self.root[:, np.searchsorted(self.active, rows)]
        return np.asarray(own.T @ own)


def posterior(gram: FloatArray, right: FloatArray, prior: GroupedPrior, *, size: FloatArray | None = None) -> Posterior:
    """Posterior of data with normal equations ``gram x = right``.

    `size` (p,) is the diagonal before other parameters were eliminated, which determines the rounding.
    """
    active, x = np.flatnonzero(prior.active), np.zeros(len(gram))
    x[active], root, is_triangle = _solved(gram, right, prior, active, size)
    return Posterior(x, active, root, is_triangle)


class GroupedEquations:
    """Normal equations to be solved under several priors.

    Parameters
    ----------
    gram : (p, p) array
    right : (p,) array
    size : (p,) array
        The diagonal before other parameters were eliminated.
    n_data : int
        Number of data, about the largest rank: if it is low, matrices of the size of the data are solved.
    """

    def __init__(self, gram: FloatArray, right: FloatArray, size: FloatArray, n_data: int) -> None:
        self._gram, self._right, self._size = gram, right, size
        self._few = LowRankEquations.of(gram, right, size) if n_data <= MAX_RANK * len(gram) else None

    def posterior(self, prior: GroupedPrior) -> Posterior | LowRankPosterior:
        """See the function `posterior`."""
        if self._few is None or (found := self._few.solve(prior.ratio * prior.scale[prior.group])) is None:
            return posterior(self._gram, self._right, prior, size=self._size)
        return found


def _solved(
    gram: FloatArray, right: FloatArray, prior: GroupedPrior, active: IntArray, size: FloatArray | None
) -> tuple[FloatArray, FloatArray, bool]:
    """Means of the active parameters, F with ``F^T F = (G + P)^-1`` of them, and whether it is a lower triangle.

    Rows and columns need no common unit: Cholesky's factor and its inverse have the rounding of a matrix that is scaled
    to unit diagonal (Higham, section 10.1). Pivots are compared with the diagonal before elimination.
    """
    if len(active) < len(gram):
        gram, right = gram[np.ix_(active, active)], right[active]
        size = None if size is None else size[active]
    precision = prior.precision[active]
    size = np.maximum(gram.diagonal() if size is None else size, 0)
    matrix = gram.copy()
    matrix.flat[:: len(matrix) + 1] += precision
    try:
        # The transpose of a symmetric matrix is itself, in the order of columns that LAPACK works on without a copy.
        lower = cholesky(matrix.T, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return _solved_by_orthogonal_factors(gram, right, precision, size)
    if (lower.diagonal() ** 2 < MIN_PIVOT * (size + precision)).any():
        return _solved_by_orthogonal_factors(gram, right, precision, size)
    # With A = L L^T it is L^-1, which costs a third of A^-1.
    root = inverse_triangle(lower)
    return root.T @ (root @ right), root, True


def _solved_by_orthogonal_factors(
    gram: FloatArray, right: FloatArray, precision: FloatArray, size: FloatArray
) -> tuple[FloatArray, FloatArray, bool]:
    """The same where priors are below the rounding of `gram`: parameters without data keep their prior.

    The matrix of the data is converted to a Jacobian, without the directions that are rounding; stacked with the prior
    it is a least-squares problem, solved by its triangular factor (rows sorted and columns pivoted, as
    sizes differ by decades: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., section 19.4).
    Columns are in units of their priors, so that the best determined come first: their rounding must not affect the
    priors of the others.
    """
    n = len(gram)
    scale = 1 / np.sqrt(precision)
    matrix, unit = unit_diagonal(gram, size)
    values, vectors = np.linalg.eigh(matrix)
    determined = values > ROUNDING * max(values[-1], 1.0)
    roots, vectors = np.sqrt(values[determined]), vectors[:, determined]
    stacked = np.zeros((len(roots) + n, n + 1))  # with the right side as the last column
    stacked[: len(roots), :n] = (vectors * roots).T * unit * scale
    stacked[: len(roots), n] = vectors.T @ (right / unit) / roots
    stacked[len(roots) :, :n] = np.diag(np.sqrt(precision) * scale)
    stacked = stacked[np.argsort(-np.abs(stacked[:, :n]).max(axis=1, initial=0.0))]
    turned, triangle, pivots = qr(stacked[:, :n], mode="economic", pivoting=True, check_finite=False)
    inverse = inverse_triangle(np.asarray(triangle, dtype=float).T)
    x, root = np.empty(n), np.empty((n, n))
    x[pivots] = (turned.T @ stacked[:, n]) @ inverse
    root[:, pivots] = inverse
    return x * scale, root * scale, False


def inverse_triangle(lower: FloatArray) -> FloatArray:
    """The inverse of a lower triangle (n, n), in its place.

    By halves, whose products take two thirds of the time of LAPACK's, of 300 rows less than half.
    """
    half = len(lower) // 2
    if 0 < len(lower) <= SMALL:
        lower[:] = dtrtri(lower, lower=1)[0]
    elif half:
        first, last = inverse_triangle(lower[:half, :half]), inverse_triangle(lower[half:, half:])
        across = dtrmm(-1.0, last, lower[half:, :half], lower=1)
        lower[half:, :half] = dtrmm(1.0, first, across, side=1, lower=1, overwrite_b=1)
    return lower


def _squared_triangle(lower: FloatArray) -> FloatArray:
    """``L^T L`` of a lower triangle (n, n), by halves: with a third of the multiplications of a product."""
    if len(lower) <= SMALL:
        return np.asarray(lower.T @ lower)
    half, out = len(lower) // 2, np.empty(lower.shape)
    first, across, last = lower[:half, :half], lower[half:, :half], lower[half:, half:]
    out[:half, :half] = _squared_triangle(first) + across.T @ across
    out[half:, half:] = _squared_triangle(last)
    out[half:, :half] = dtrmm(1.0, last, across, lower=1, trans_a=1)
    out[:half, half:] = out[half:, :half].T
    return out


def determined_shares(variance: FloatArray, precision: FloatArray) -> FloatArray:
    """(p,) how far data rather than the prior determine parameters, 0 to 1, by posterior variance and prior precision.

    Of directions that the data do not see, the rounding of the posterior leaves a variance beyond the prior's.
    """
    return np.asarray(np.clip(1 - variance * precision, 0.0, 1.0))


def update_scales(
    prior: GroupedPrior, found: Posterior | LowRankPosterior, *, log_spread: float, least: float, most: float
) -> tuple[FloatArray, FloatArray]:
    """One round of the fixed point.

    Parameters
    ----------
    prior : GroupedPrior
    found : Posterior
        Under `prior`.
    log_spread : float
        Prior standard deviation of the logarithm of a scale, about 0.
    least, most : float
        Bounds of a scale, so that it remains finite.

    Returns
    -------
    scale : (n_groups,) array
    effective : (n_groups,) array
        Number of parameters that the data determine.
    """
    active = prior.active
    share = np.zeros(len(active))
    share[active] = determined_shares(found.variance[active], prior.precision[active])
    effective = prior.group_sums(share)
    learned = prior.learned & (prior.scale > 0)
    sizes, spread, gamma = prior.group_sums((found.x / prior.ratio) ** 2)[learned], log_spread**2, effective[learned]
    with np.errstate(divide="ignore"):  # sizes of zero: Lambert's function is zero there
        log_scale = wrightomega(np.log(2 * spread * sizes) + 2 * spread * gamma) / 2 - spread * gamma
    scale = prior.scale.copy()
    scale[learned] = np.exp(np.clip(log_scale, np.log(least), np.log(most)))
    return scale, effective


def prune_groups(
    prior: GroupedPrior, found: Posterior | LowRankPosterior, which: BoolArray, *, log_spread: float
) -> GroupedPrior:
    """Prune those of some groups without which the evidence is larger.

    With x and S the posterior of a group's m parameters and P their prior covariance, pruning it changes the log
    evidence by ``(log|P| - log|S| - x^T S^-1 x) / 2`` (J. M. Dickey, Ann. Math. Stat. 42 (1971) 204), and removes the
    penalty of its scale. The group of largest gain is pruned first, and the posterior of the others without it decides
    on the next: of two equivalent groups one remains.

    Parameters
    ----------
    prior : GroupedPrior
    found : Posterior
        Under `prior`.
    which : (n_groups,) bool array
        Groups that may be pruned, if the data determine their scale.
    log_spread : float
        As in `update_scales`.

    Returns
    -------
    GroupedPrior
        With scale 0 for pruned groups.
    """
    std = prior.ratio * prior.scale[prior.group]
    scale = prior.scale.copy()
    per_std = np.divide(1.0, std, out=np.zeros(len(std)), where=std > 0)
    # In units of the prior; the covariance of all parameters is needed only once a group is pruned.
    x = found.x * per_std
    covariance: FloatArray | None = None
    members = {int(g): np.flatnonzero(prior.group == g) for g in np.flatnonzero(which & prior.learned & (scale > 0))}

    def whitening(rows: IntArray) -> tuple[FloatArray, float]:
        if covariance is None:
            return _whitening(found.block(rows) * per_std[rows] * per_std[rows, None])
        return _whitening(covariance[np.ix_(rows, rows)])

    while members:
        gains = {}
        for g, rows in members.items():
            half, log_det = whitening(rows)
            squares = (half @ x[rows]) ** 2
            gains[g] = 0.5 * (np.log(scale[g]) ** 2 / log_spread**2 - log_det - squares.sum())
        g = max(gains, key=gains.__getitem__)
        if gains[g] < MIN_GAIN:
            break
        rows = members.pop(g)
        half, _ = whitening(rows)
        if covariance is None:
            covariance = found.covariance * per_std * per_std[:, None]
        across = covariance[:, rows] @ half.T
        x -= across @ (half @ x[rows])
        covariance -= across @ across.T
        scale[g] = 0.0
    return replace(prior, scale=scale)


def _whitening(white: FloatArray) -> tuple[FloatArray, float]:
    """W with ``W^T W`` the inverse of a posterior covariance in units of the prior, and the log determinant of that.

    The eigenvalues are between 0 and 1 up to rounding; those that are rounding count as `ROUNDING`.
    """
    try:
        lower = cholesky(white, lower=True, check_finite=False)
    except LinAlgError:
        pass
    else:
        if (lower.diagonal() ** 2).min(initial=1.0) > MIN_PIVOT:
            log_det = 2 * float(np.log(lower.diagonal()).sum())
            return inverse_triangle(lower), log_det
    values, vectors = np.linalg.eigh(white)
    values = np.clip(values, ROUNDING, 1.0)
    return np.asarray((vectors / np.sqrt(values)).T), float(np.log(values).sum())
