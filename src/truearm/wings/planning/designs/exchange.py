"""Choose the readings for the smallest uncertainty: greedy selection, then exchange.

With information ``A = Lambda + sum over chosen i of J_i^T J_i`` (Lambda the prior precision, J_i a candidate's Jacobian
over its noise) and covariance ``C = A^-1``, the two criteria are

- I-optimal: ``trace(M C)``, where M is the mean over the volume of ``J_t^T J_t``: the mean squared uncertainty of a
  measured point there, three-dimensional [mm^2];
- D-optimal: ``-log det A``: the volume of the parameters' confidence ellipsoid.

The decrease of the criterion by a candidate with k rows follows from two k x k matrices, ``S_i = J_i C J_i^T`` and
``T_i = J_i C M C J_i^T`` (Woodbury):

    I: trace((I + S_i)^-1 T_i),        D: log det(I + S_i).

When candidate s is added, with ``U = C J_s^T`` and ``G = (I + S_s)^-1``, C falls by ``U G U^T``. The matrices of all
candidates follow from ``J_i U`` and ``J_i C M U`` alone, one product of all Jacobians with 2 k columns: a choice costs
n k^2 p operations, not n k p^2. A reading is removed in the same way with ``G = -(I - S_s)^-1``. A chosen reading
is exchanged for the best other one as long as that lowers the criterion (Fedorov's algorithm as modified by Cook and
Nachtsheim: each in turn, rather than the best of all pairs). The search ends at a local optimum, where no exchange of
one for one helps. Information is kept as factors: rows F with ``F^T F`` the information, freed from nuisance
parameters.

Sources: V. V. Fedorov, "Theory of Optimal Experiments", Academic Press 1972; R. D. Cook, C. J. Nachtsheim,
"A comparison of algorithms for constructing exact D-optimal designs", Technometrics 22 (1980) 315; I-optimality with a
prior: K. Chaloner, I. Verdinelli, "Bayesian experimental design: a review", Statistical Science 10 (1995) 273; for
robots, with poses to be accurate at: A. Klimchik, A. Pashkevich, Y. Wu, S. Caro, B. Furet, "Design of calibration
experiments for identification of manipulator elastostatic parameters", Applied Mechanics and Materials 162 (2012) 161.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_solve, qr

from truearm.errors import InputError
from truearm.identification.references.alignment import rigid_motions
from truearm.solve.linear_algebra import whiten
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray
from truearm.wings.planning.designs import Strategy


def moment_matrix(jacobians: FloatArray, tips: FloatArray | None = None, *, scale: bool = False) -> FloatArray:
    """Target of the I-criterion: the mean over poses of ``J_t^T J_t``, (p, p).

    With `tips`, the frame is first fitted to the points: these are the errors of an arm whose coordinates are compared
    with each other only, as those of a hand-guided arm. No seat and no bar determines its base position.

    Parameters
    ----------
    jacobians : (n, 3, p) array
        Derivatives of the tip by the parameters at poses of the later use of the arm [mm per unit].
    tips : (n, 3) array, optional
        The tip at these poses [mm].
    scale : bool
        Whether a scale is fitted with the frame: seats without a known length do not determine it.
    """
    rows = jacobians.reshape(-1, jacobians.shape[2])
    if tips is not None:
        rows = project_out(rows, rigid_motions(tips, scale=scale))
    return np.asarray(rows.T @ rows / len(jacobians))


def stack_factors(factors: Sequence[FloatArray]) -> FloatArray:
    """Stack candidates of different numbers of rows into one array (n, k, p), padded with zeros.

    Parameters
    ----------
    factors : sequence of (k_i, p) arrays
        One with more rows than parameters is replaced by its triangular factor, which has the same information.
    """
    reduced = [
        np.asarray(np.linalg.qr(factor, mode="r")) if factor.shape[0] > factor.shape[1] else factor
        for factor in factors
    ]
    out = np.zeros((len(reduced), max(1, *map(len, reduced)), reduced[0].shape[1]))
    for place, factor in zip(out, reduced, strict=True):
        place[: len(factor)] = factor
    return out


def project_out(jacobian: FloatArray, nuisance: FloatArray) -> FloatArray:
    """Eliminate unknowns that are estimated from the same readings: rows of information about the parameters alone.

    The information of ``[J B]`` about the parameters alone is ``J^T (I - B B^+) J``, the Schur complement of ``B^T B``;
    the rows returned are J in the orthogonal complement of B. A seat with k poses leaves 3 k - 3 of 3 k rows.

    Parameters
    ----------
    jacobian : (m, p) array
        By the parameters, rows over the noise.
    nuisance : (m, q) array
        By the unknowns, rows over the noise; without a prior.

    Returns
    -------
    (m - rank of nuisance, p) array
    """
    if not nuisance.size:
        return jacobian
    Q, R, _ = qr(nuisance, pivoting=True)
    size = np.abs(R.diagonal())
    rank = int((size > max(nuisance.shape) * np.finfo(float).eps * size[0]).sum())
    return np.asarray(Q[:, rank:].T @ jacobian)


def factor_of(matrix: FloatArray) -> FloatArray:
    """Rows F (r, p) with ``F^T F`` equal to a symmetric matrix (p, p) of rank r, to rounding.

    Raises
    ------
    InputError
        If it has an eigenvalue below zero.
    """
    scale = np.sqrt(np.abs(matrix.diagonal()))  # rounding must not depend on the parameters' units
    divisor = np.where(scale > 0, scale, 1.0)
    unit = matrix / np.outer(divisor, divisor)
    values, vectors = np.linalg.eigh(unit)
    rounding = len(values) * np.finfo(float).eps * np.abs(values).max()
    if values[0] < -10 * rounding:
        raise InputError(
            f"expected an information matrix without an eigenvalue below zero, got {values[0]:.3g} of the largest"
        )
    kept = values > rounding
    return np.ascontiguousarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T * scale)


def symmetric_matrix(name: str, matrix: npt.ArrayLike, p: int) -> FloatArray:
    """The matrix (p, p), checked: finite and symmetric to rounding."""
    array = np.asarray(matrix, dtype=float)
    if array.shape != (p, p) or p < 1:
        raise InputError(f"expected {name} of shape {(p, p)}, got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite")
    scale = np.sqrt(np.abs(array.diagonal()))
    if not (np.abs(array - array.T) <= 1e-9 * np.outer(scale, scale)).all():
        raise InputError(f"{name} must be symmetric")
    return np.asarray(0.5 * (array + array.T))


Progress = Callable[[str, int, int], None]
"""Called with the name of a step, the number done, and the total."""

# Rows of all Jacobians in one product, which bounds the memory of the copies.
_ROWS = 4096
# Decreases within this share of the best are equal: rounding must not decide, the first of them is chosen.
_TIE = 1e-9
# Smallest relative gain of an exchange; without it rounding might exchange for ever.
_LEAST = 1e-6
# Largest reduction by updates since the last exact calculation; the rounding error is this times 1e-16.
_MAX_REDUCTION = 1e8
# Smallest share of a direction's information that must remain when an update removes a reading.
_LEAST_LEFT = 1e-6


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Candidates, prior knowledge and target of an optimal design.

    Parameters
    ----------
    factors : (n, k, p) array
        Jacobian J_i of every candidate, rows divided by the standard deviation of their noise: its information is
        ``J_i^T J_i``. A candidate with fewer rows than others has rows of zeros (see `stack_factors`).
    prior_precision : (p, p) array
        Inverse of the prior covariance of the parameters; readings already measured add their ``J^T J`` to it.
    target : (p, p) array
        M [mm^2 per squared unit of the parameters], see `moment_matrix`.

    Notes
    -----
    The criteria do not depend on the units of the parameters. Unknowns shared by several candidates, such as the
    position of a common seat, are parameters with zeros in the target; unknowns of one candidate are eliminated (see
    `project_out`).

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, the prior is not positive definite, or the target has a negative
        eigenvalue.
    """

    factors: FloatArray
    prior_precision: FloatArray
    target: FloatArray

    def __post_init__(self) -> None:
        factors = np.ascontiguousarray(self.factors, dtype=float)
        if factors.ndim != 3 or 0 in factors.shape:
            raise InputError(f"expected factors of shape (candidates, rows, parameters), got {factors.shape}")
        if not np.isfinite(factors).all():
            bad = int(np.argmin(np.isfinite(factors).all(axis=(1, 2))))
            raise InputError(f"the factors of candidate {bad} are not finite")
        object.__setattr__(self, "factors", factors)
        for name in ("prior_precision", "target"):
            object.__setattr__(self, name, symmetric_matrix(name, getattr(self, name), factors.shape[2]))
        with one_blas_thread():
            if _variance(self.prior_precision, self._target_factor) is None:
                raise InputError(
                    "the prior precision must be positive definite",
                    hint="state a prior, however wide, for every parameter",
                )

    @property
    def n_candidates(self) -> int:
        """Number of candidates."""
        return len(self.factors)

    def information(self, rows: npt.ArrayLike) -> FloatArray:
        """(p, p) information of the prior and the candidates `rows`."""
        chosen = self.factors[np.asarray(rows, dtype=np.intp)].reshape(-1, self.factors.shape[2])
        return self.prior_precision + chosen.T @ chosen

    def variance(self, rows: npt.ArrayLike) -> float:
        """``trace(M C)`` once the candidates `rows` have been measured [mm^2], without updates."""
        variance = _variance(self.information(rows), self._target_factor)
        assert variance is not None  # no less definite than the prior
        return variance

    def log_det(self, rows: npt.ArrayLike) -> float:
        """``log det A`` once the candidates `rows` have been measured."""
        return float(np.linalg.slogdet(self.information(rows))[1])

    def course(self, rows: npt.ArrayLike) -> FloatArray:
        """``trace(M C)`` before any and after each of the candidates `rows` in turn, (len(rows) + 1,) [mm^2]."""
        order = np.asarray(rows, dtype=np.intp)
        with one_blas_thread():
            return np.array([self.variance(order[:count]) for count in range(len(order) + 1)])

    @cached_property
    def _target_factor(self) -> FloatArray:
        try:
            return factor_of(self.target)
        except InputError as error:
            raise InputError(f"the target must be a mean of squares: {error.problem}") from None


class Criterion(Protocol):
    """What a selection minimises."""

    def value(self, problem: DesignProblem, rows: npt.ArrayLike) -> float:
        """The criterion with candidates `rows` measured, without updates."""
        ...

    def drops(self, S: FloatArray, T: FloatArray) -> FloatArray:
        """(n,) decrease of the criterion by every candidate, from its (n, k, k) matrices S and T."""
        ...


class IOptimality:
    """Mean squared uncertainty of a point in the volume."""

    def value(self, problem: DesignProblem, rows: npt.ArrayLike) -> float:
        """``trace(M C)`` [mm^2]."""
        return problem.variance(rows)

    def drops(self, S: FloatArray, T: FloatArray) -> FloatArray:
        """``trace((I + S)^-1 T)`` [mm^2]."""
        return np.asarray(np.linalg.solve(np.eye(S.shape[1]) + S, T).trace(axis1=1, axis2=2))


class DOptimality:
    """Volume of the parameters' confidence ellipsoid."""

    def value(self, problem: DesignProblem, rows: npt.ArrayLike) -> float:
        """``-log det A``."""
        return -problem.log_det(rows)

    def drops(self, S: FloatArray, T: FloatArray) -> FloatArray:  # noqa: ARG002
        """``log det(I + S)``."""
        return np.asarray(np.linalg.slogdet(np.eye(S.shape[1]) + S)[1])


OPTIMAL: tuple[Strategy, ...] = ("i-optimal", "d-optimal")
"""The strategies of `select_candidates`, which choose poses for what they tell of the arm."""


def select_candidates(
    problem: DesignProblem, n: int, *, strategy: Strategy = "i-optimal", progress: Progress | None = None
) -> IntArray:
    """Choose candidates by a strategy.

    Parameters
    ----------
    problem : DesignProblem
    n : int
        Number of candidates, each at most once.
    strategy : str
        One of `OPTIMAL`.
    progress : callable, optional

    Returns
    -------
    (n,) int array
        In the order of measurement: each is the best of the remaining ones, so that an early stop leaves a good
        selection.

    Raises
    ------
    InputError
        If the strategy is unknown, or there are fewer candidates than asked for.
    """
    if strategy not in OPTIMAL:
        raise InputError(f"expected a strategy among {', '.join(OPTIMAL)}, got {strategy!r}")
    if not 1 <= n <= problem.n_candidates:
        raise InputError(f"expected to choose 1 to {problem.n_candidates} candidates, got {n}")
    criterion: Criterion = IOptimality() if strategy == "i-optimal" else DOptimality()
    starting: list[Criterion] = [criterion] if strategy == "d-optimal" else [criterion, DOptimality()]
    with one_blas_thread():
        # Some candidates are useful only together, as the first two poses in a seat: the first alone does not lower the
        # I-criterion, but it changes the determinant. The selection starts from both.
        starts = [greedy(problem, n, start, progress=progress) for start in starting]
        best = min(
            (fedorov_exchange(problem, start, criterion, progress=progress) for start in starts),
            key=lambda rows: criterion.value(problem, rows),
        )
        chosen = DesignProblem(problem.factors[best], problem.prior_precision, problem.target)
        return np.asarray(best[greedy(chosen, n, criterion)])


def decreases(problem: DesignProblem) -> FloatArray:
    """(n,) decrease of ``trace(M C)`` by each candidate alone [mm^2]."""
    with one_blas_thread():
        return _Posterior(problem, []).drops(IOptimality())


def greedy(problem: DesignProblem, n: int, criterion: Criterion, *, progress: Progress | None = None) -> IntArray:
    """Choose n candidates, (n,), each the one that lowers the criterion most.

    Parameters
    ----------
    problem : DesignProblem
    n : int
        At most the number of candidates.
    criterion : Criterion
    progress : callable, optional
    """
    posterior = _Posterior(problem, [])
    for count in range(n):
        drops = posterior.drops(criterion)
        drops[posterior.rows] = -np.inf
        posterior.add(_first_best(drops))
        if progress is not None:
            progress("choose", count + 1, n)
    return np.array(posterior.rows, dtype=np.intp)


def fedorov_exchange(
    problem: DesignProblem, rows: npt.ArrayLike, criterion: Criterion, *, progress: Progress | None = None
) -> IntArray:
    """Exchange chosen candidates for others, one for one, until no swap lowers the criterion.

    Parameters
    ----------
    problem : DesignProblem
    rows : (n,) int array
        The choice to start from.
    criterion : Criterion
    progress : callable, optional

    Returns
    -------
    (n,) int array
        Never worse than `rows`.
    """
    best = np.array(rows, dtype=np.intp)
    value = criterion.value(problem, best)
    while True:
        posterior = _Posterior(problem, best.tolist())
        tried = _one_round(posterior, criterion, progress)
        lowered = criterion.value(problem, tried)
        # Without updates: an improvement that is rounding only ends the search.
        if lowered >= value:
            return best
        best, value = tried, lowered


def _one_round(posterior: _Posterior, criterion: Criterion, progress: Progress | None) -> IntArray:
    """Try to exchange every chosen candidate once."""
    offered = list(posterior.rows)
    for count, row in enumerate(offered):
        posterior.refresh()
        without = posterior.without(row)
        drops = without.drops(criterion)
        own = drops[row]
        drops[without.rows] = -np.inf
        other = _first_best(drops)
        if drops[other] > (1 + _LEAST) * own:
            posterior = without
            posterior.add(other)
        if progress is not None:
            progress("exchange", count + 1, len(offered))
    return np.array(posterior.rows, dtype=np.intp)


class _Posterior:
    """Covariance with some candidates measured, and the matrices S and T of all candidates."""

    C: FloatArray
    S: FloatArray
    T: FloatArray
    # Traces of S and T at the last exact calculation: rounding since then is 1e-16 of them.
    S_then: FloatArray
    T_then: FloatArray

    def __init__(self, problem: DesignProblem, rows: list[int]) -> None:
        self.problem = problem
        self.rows = list(rows)
        self._recalculate()

    def drops(self, criterion: Criterion) -> FloatArray:
        """(n,) decrease of the criterion by every candidate."""
        self.refresh()
        return criterion.drops(self.S, self.T)

    def add(self, row: int) -> None:
        """Measure one more candidate."""
        self._update(row, np.linalg.inv(np.eye(self.S.shape[1]) + self.S[row]))
        self.rows.append(row)

    def without(self, row: int) -> _Posterior:
        """Remove a measured candidate."""
        remaining = np.eye(self.S.shape[1]) - self.S[row]
        rows = [other for other in self.rows if other != row]
        if np.linalg.eigvalsh(remaining)[0] < _LEAST_LEFT:
            return _Posterior(self.problem, rows)
        other = copy(self)
        other.rows = rows
        other._update(row, -np.linalg.inv(remaining))
        return other

    def refresh(self) -> None:
        """Recalculate everything if the rounding of the updates may matter."""
        S, T = self._sizes()
        S = 1 + np.abs(S)
        best = np.abs(T / S).max()
        if (self.S_then / S).max() > _MAX_REDUCTION or (self.T_then / S).max() > _MAX_REDUCTION * best:
            self._recalculate()

    def _update(self, row: int, G: FloatArray) -> None:
        """``C - U G U^T`` and the same for S and T, in new arrays: `without` shares the old ones."""
        factors, M = self.problem.factors, self.problem.target
        U = self.C @ factors[row].T
        MU = M @ U
        both = factors @ np.concatenate([U, self.C @ MU], axis=1)
        A, B = both[:, :, : len(G)], both[:, :, len(G) :]
        AG = A @ (0.5 * (G + G.T))
        BGA = B @ AG.transpose(0, 2, 1)
        self.C = self.C - U @ (0.5 * (G + G.T)) @ U.T
        self.S = self.S - AG @ A.transpose(0, 2, 1)
        self.T = self.T - BGA - BGA.transpose(0, 2, 1) + AG @ (U.T @ MU) @ AG.transpose(0, 2, 1)

    def _recalculate(self) -> None:
        """Calculate everything from the measured candidates."""
        factors, M = self.problem.factors, self.problem.target
        p = factors.shape[2]
        L = np.linalg.cholesky(self.problem.information(self.rows))
        self.C = cho_solve((L, True), np.eye(p), check_finite=False)
        self.S = np.empty((len(factors), factors.shape[1], factors.shape[1]))
        self.T = np.empty_like(self.S)
        at_once = max(1, _ROWS // factors.shape[1])
        for first in range(0, len(factors), at_once):
            some = factors[first : first + at_once]
            JC = (some.reshape(-1, p) @ self.C).reshape(some.shape)
            JCM = (JC.reshape(-1, p) @ M).reshape(some.shape)
            self.S[first : first + at_once] = JC @ some.transpose(0, 2, 1)
            self.T[first : first + at_once] = JCM @ JC.transpose(0, 2, 1)
        self.S_then, self.T_then = self._sizes()

    def _sizes(self) -> tuple[FloatArray, FloatArray]:
        return self.S.trace(axis1=1, axis2=2), self.T.trace(axis1=1, axis2=2)


def _first_best(drops: FloatArray) -> int:
    best = drops.max()
    return int(np.argmax(drops >= best - _TIE * abs(best)))


def _variance(information: FloatArray, target_factor: FloatArray) -> float | None:
    """``trace(F A^-1 F^T)``, or None if A is not positive definite."""
    half = whiten(information.copy(), target_factor.T)
    return None if half is None else float(np.vdot(half, half))
