"""A root of the covariance of an arm's coefficients, times the derivatives of its tips.

A column of the derivatives is a product: the tip's derivative t along a *site* (place and direction) times a function
phi of the arm's state. With F^T F the covariance, and F_s the columns of F of a site's functions,

    F J^T = sum_s t_s (F_s phi_s),

where phi has one value a reading and t as many as a reading has coordinates: multiplied first, the functions cost a
third of the product with the columns of J. Sites with few functions are such columns all the same, as there are many of
them. With these first, and the sites with many functions one after the other, Cholesky's F is an upper triangle, and
F_s has as many rows as it and those before it have columns.

Data of the normal matrix G that are taken back leave the covariance ``(Sigma^-1 - G)^-1``: one factorisation, however
many the data are.

Source of the factor: G. H. Golub, C. F. Van Loan, "Matrix Computations", 4th ed., section 4.2; of the iteration,
section 10.3.6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement, pairwise
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dtrmm, dtrsm, strsm
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs

from truearm.identification.estimation.perturbed_chain import (
    FEW,
    MOST_NARROW,
    HarmonicSeries,
    PerturbedChain,
    as_slice,
    chunks,
)
from truearm.solve.linear_algebra import covariance_factor
from truearm.solve.trigonometric_sums import Multiples, bilinear_form, is_cheaper
from truearm.typing import FloatArray, IntArray

# A Krylov space of blocks of so many vectors, so many of them at least, has the large eigenvalues of a matrix along a
# vector: their residuals are less than this share of its image.
BLOCK, FEWEST, CONVERGED = 8, 3, 0.003
# Covariances of displacements, with a residual of unit variance along every direction, are the same to this share.
SAME = 1e-3
# Share of the variance by each coefficient alone, summed, that may remain of it with their covariances: below it their
# sum has lost ten digits of sixteen.
LEAST_SHARE = 1e-10
# Readings whose products stay in the cache of a core, of some 200 coefficients.
PIECE = 192


class _Part(NamedTuple):
    """Some coefficients, of a span of their order, with the sites and functions whose products are their derivatives.

    A part of one site may be a series of harmonics.
    """

    span: slice
    coefficients: IntArray
    sites: IntArray
    functions: IntArray | slice
    series: HarmonicSeries | None


@dataclass(frozen=True, eq=False)
class CovarianceRoot:
    """The covariance of the coefficients and F with ``F^T F`` equal to it, in parts by the sites of their terms.

    The rows of F are independent causes of variance one, in an order of their own.

    Attributes
    ----------
    perturbed_chain : PerturbedChain
    order : (p,) int array
        The coefficients that are uncertain; those of sites with few functions first, then site by site.
    wide : tuple of slice
        Of each site with many functions among them.
    covariance : (p, p) array
        In that order.
    """

    perturbed_chain: PerturbedChain
    order: IntArray
    wide: tuple[slice, ...]
    covariance: FloatArray

    @classmethod
    def of(cls, covariance: FloatArray, perturbed_chain: PerturbedChain) -> Self:
        """The root of a covariance (n_coefficients, n_coefficients), which may be singular."""
        site_of, _ = perturbed_chain.of_coefficient
        uncertain = np.flatnonzero(covariance.diagonal() > 0)
        is_wide = np.bincount(site_of, minlength=len(perturbed_chain.sites)) > MOST_NARROW
        each = (uncertain[site_of[uncertain] == site] for site in np.flatnonzero(is_wide))
        wide = [own for own in each if len(own)]
        order = np.concatenate([uncertain[~is_wide[site_of[uncertain]]], *wide])
        stops = len(order) - np.cumsum([0, *map(len, wide[::-1])])[::-1]
        spans = tuple(slice(int(start), int(stop)) for start, stop in pairwise(stops))
        # Rows first: half the time of both at once.
        return cls(perturbed_chain, order, spans, covariance.take(order, axis=0).take(order, axis=1))

    @cached_property
    def factor(self) -> FloatArray:
        """(n_rows, p) F in that order."""
        return covariance_factor(self.covariance)

    @property
    def n_rows(self) -> int:
        """One for each coefficient that is uncertain."""
        return len(self.order)

    @cached_property
    def is_triangle(self) -> bool:
        """Whether F is an upper triangle; from eigenvectors, of a singular covariance, it is none."""
        return not np.tril(self.factor, -1).any()

    @cached_property
    def _information(self) -> FloatArray:
        """(p, p) the upper triangle of the inverse of the covariance, of a triangle."""
        # A copy: LAPACK writes into it, and the factor may be in either order.
        return np.asarray(dpotri(np.array(self.factor.T, order="F"), lower=1, overwrite_c=1)[0].T)

    def without(self, gram: FloatArray) -> WithoutData | None:
        """The same without data of the normal matrix (p, p) in the same order, whose upper triangle is spoilt.

        None where they leave nothing to rounding, and where the covariance itself is singular.
        """
        if not self.is_triangle:
            return None
        np.subtract(self._information, gram, out=gram)
        # The transpose is in the order of columns that LAPACK works on without a copy.
        lower, info = dpotrf(gram.T, lower=1, clean=0, overwrite_a=1)
        return None if info else WithoutData(self, lower)

    def times(self, along_sites: FloatArray, values: FloatArray) -> FloatArray:
        """``F J^T``: displacements by each cause, in the precision of what is given.

        In single precision it has the rounding of displacements as large as `alone` says.

        Parameters
        ----------
        along_sites : (n_sites, k, m) array
            Derivatives of k coordinates or residuals of m readings along the sites.
        values : (n_functions, m) array
            Of the basis functions, as `PerturbedChain.values` gives them.

        Returns
        -------
        (n_rows, k, m) array
        """
        (_, k, m), is_double = along_sites.shape, along_sites.dtype == float
        (narrow, *wide), (of_few, *of_many) = self._parts, self._columns if is_double else self._single_columns
        columns = along_sites[narrow.sites]
        columns *= values[narrow.functions, None]
        flat = columns.reshape(len(columns), k * m)
        if m > FEW and self.is_triangle and is_double:  # in place, with half the multiplications: both count by columns
            found = dtrmm(1.0, of_few.T, flat.T, side=1, lower=1, overwrite_b=1).T
        else:
            found = of_few.dot(flat)
        found = found.reshape(-1, k, m)
        if not wide:
            return found
        along = np.ascontiguousarray(along_sites[[part.sites[0] for part in wide]].transpose(2, 1, 0))
        out = np.empty((m, k, self.n_rows), along.dtype)
        of_sites = np.zeros((min(m, PIECE), len(wide), self.n_rows), along.dtype)
        for rows in chunks(m, PIECE):
            some = of_sites[: len(along[rows])]
            for n, (part, own) in enumerate(zip(wide, of_many, strict=True)):
                np.matmul(values[part.functions, rows].T, own.T, out=some[:, n, : len(own)])
            np.matmul(along[rows], some, out=out[rows])
        out[:, :, : len(found)] += found.transpose(2, 1, 0)
        return out.transpose(2, 1, 0)

    def alone(self, along_sites: FloatArray, values: FloatArray) -> FloatArray:
        """(m,) variance of the displacements by each coefficient alone, summed, or of harmonics up to twice that.

        Parameters are those of `times`.
        """
        (narrow, *wide), variance = self._parts, self.covariance.diagonal()
        squares = np.einsum("skm,skm->sm", along_sites, along_sites)
        found = variance[narrow.span] @ (squares[narrow.sites] * values[narrow.functions] ** 2)
        for part in wide:
            found += variance[part.span].sum() * squares[part.sites[0]]
        return np.asarray(found)

    def covariances(self, along_sites: FloatArray, values: FloatArray, angles: FloatArray) -> FloatArray:
        """``J Sigma J^T`` of every reading: displacements of k coordinates, or of residuals.

        Of many readings without F: with c of two sites the covariance ``phi^T Sigma_sr psi`` of their motions, it is
        the sum of ``c t_s t_r^T`` over all pairs, and of two series of harmonics c is a trigonometric polynomial
        (`truearm.solve.trigonometric_sums`).

        Parameters
        ----------
        along_sites, values
            As in `times`.
        angles : (m, n_joints) array
            Of the joints [rad, or mm].

        Returns
        -------
        (m, k, k) array
        """
        narrow, *wide = self._parts
        if len(angles) <= FEW or not wide:
            return self._squared(along_sites, values)
        (_, k, m), function = along_sites.shape, values[narrow.functions]
        columns = along_sites[narrow.sites] * function[:, None]
        product = (self._blocks[0, 0] @ columns.reshape(-1, k * m)).reshape(columns.shape)
        half = 0.5 * np.stack([np.einsum("pm,plm->lm", columns[:, i], product) for i in range(k)])
        sites, of_site = np.unique(narrow.sites, return_inverse=True)
        members = (of_site == np.arange(len(sites))[:, None]).astype(float)
        for n, part in enumerate(wide, 1):
            of_sites = members @ (function * (self._blocks[0, n] @ values[part.functions]))
            common = np.einsum("sm,skm->km", of_sites, along_sites[sites])
            for o in range(1, n + 1):
                shared = self._shared(o, n, values, angles) * (0.5 if o == n else 1.0)
                common += shared * along_sites[self._parts[o].sites[0]]
            half += common[:, None] * along_sites[part.sites[0]]
        found = (half + half.transpose(1, 0, 2)).transpose(2, 0, 1)
        if (np.trace(found, axis1=1, axis2=2) < LEAST_SHARE * self.alone(along_sites, values)).any():
            return self._squared(along_sites, values)
        return np.ascontiguousarray(found)

    def _squared(self, along_sites: FloatArray, values: FloatArray) -> FloatArray:
        """The same as sums of squares, which are not negative for an arm known to rounding."""
        _, k, m = along_sites.shape
        if m == 1:
            spread = self.times(along_sites, values)[:, :, 0]
            return np.asarray(spread.T.dot(spread))[None]  # a tenth of the time of `einsum`
        out = np.empty((m, k, k))
        for rows in chunks(m, PIECE):
            spread = self.times(along_sites[..., rows], values[:, rows])
            for apart in range(k):  # the pairs of coordinates that are so far apart, in one pass
                products = np.einsum("pkn,pkn->kn", spread[:, : k - apart], spread[:, apart:])
                for i, found in enumerate(products):
                    out[rows, i, i + apart] = out[rows, i + apart, i] = found
        return out

    def _shared(self, o: int, n: int, values: FloatArray, angles: FloatArray) -> FloatArray:
        """(m,) covariance of the motions of two sites with many functions."""
        one, other, matrix, same = self._parts[o], self._parts[n], self._blocks[o, n], o == n
        series = [part.series for part in (one, other) if part.series is not None]
        if len(series) == 2 and is_cheaper(len(angles), series[0].orders, None if same else series[1].orders):
            first, second = (Multiples(angles[:, joint - 1], orders) for joint, orders in series)
            return bilinear_form(matrix, first, None if same else second)
        return np.asarray((values[one.functions] * (matrix @ values[other.functions])).sum(axis=0))

    @cached_property
    def _blocks(self) -> dict[tuple[int, int], FloatArray]:
        """The covariance of the coefficients of every part with those of itself and each later one."""
        pairs = combinations_with_replacement(enumerate(self._parts), 2)
        return {(o, n): np.ascontiguousarray(self.covariance[one.span, other.span]) for (o, one), (n, other) in pairs}

    def times_matrix(self, matrix: FloatArray) -> FloatArray:
        """``F @ matrix`` of a matrix (n_coefficients, q): (n_rows, q)."""
        out = np.zeros((self.n_rows, matrix.shape[1]))
        for part, columns in zip(self._parts, self._columns, strict=True):
            out[: len(columns)] += columns @ matrix[part.coefficients]
        return out

    @cached_property
    def _columns(self) -> list[FloatArray]:
        """Columns of F of each part, down to the diagonal of a triangle."""
        spans = [part.span for part in self._parts]
        return [np.ascontiguousarray(self.factor[: span.stop if self.is_triangle else None, span]) for span in spans]

    @cached_property
    def _single_columns(self) -> list[FloatArray]:
        return [columns.astype(np.float32) for columns in self._columns]

    @cached_property
    def _parts(self) -> list[_Part]:
        """All sites with few functions, and each with many."""
        site_of, row_of = self.perturbed_chain.of_coefficient
        n_narrow = self.wide[0].start if self.wide else len(self.order)
        parts = []
        for span in (slice(0, n_narrow), *self.wide):
            coefficients = self.order[span]
            sites = site_of[coefficients]
            site = self.perturbed_chain.sites[sites[0]] if span in self.wide else None
            series = site.series if site is not None and len(site.columns) == len(coefficients) else None
            parts.append(_Part(span, coefficients, sites, as_slice(row_of[coefficients]), series))
        return parts


@dataclass(frozen=True, eq=False)
class WithoutData:
    """What is known of the coefficients where some data are taken back.

    Attributes
    ----------
    whole : CovarianceRoot
        With these data.
    lower : (p, p) array
        Cholesky's triangle of the information without them, in the order of `whole`; what is above it is of no use.
    """

    whole: CovarianceRoot
    lower: FloatArray

    def spread(self, columns: FloatArray) -> FloatArray:
        """(p, ..) displacements by each cause, of derivatives (n_coefficients, ..), in the precision of these."""
        own = columns[self.whole.order]
        solve, lower = (dtrsm, self.lower) if own.dtype == float else (strsm, self.lower.astype(np.float32))
        flat = own.reshape(len(own), -1)  # its transpose counts by columns, as BLAS does
        return np.asarray(solve(1.0, lower, flat.T, side=1, lower=1, trans_a=1, overwrite_b=1).T.reshape(own.shape))

    def covariances(self, columns: FloatArray) -> FloatArray:
        """(m, k, k) covariances of displacements, of derivatives (n_coefficients, k, m) by the coefficients.

        In single precision where those of a few are the same in double to `SAME`, along every direction: what is known
        well along one is not lost beside what is hardly known along another.
        """
        single, some = self.spread(columns.astype(np.float32)), slice(None, None, 1 + columns.shape[2] // 4)
        near, exact = (_covariances(spread) for spread in (single[..., some], self.spread(columns[..., some])))
        unit = np.linalg.inv(np.linalg.cholesky(np.eye(columns.shape[1]) + exact))
        is_same = (np.abs(unit @ (near - exact) @ unit.transpose(0, 2, 1)) <= SAME).all()
        return _covariances(single if is_same else self.spread(columns))

    def shift(self, gradient: FloatArray, least: float) -> FloatArray:
        """(n_coefficients,) the change of the coefficients where the data of a gradient (p,) are taken back.

        Of a direction that they determined nearly alone its variance with them is a small share of that without; it
        counts as `least`.
        """
        found, factor = np.zeros(self.whole.perturbed_chain.n_coefficients), self.whole.factor

        def ratio_times(directions: FloatArray) -> FloatArray:
            """The covariance without the data, in units of that with them, times some directions (p, k)."""
            moved = dpotrs(self.lower, solve_triangular(factor, directions, check_finite=False), lower=1)[0]
            return np.asarray(solve_triangular(factor, moved, trans="T", check_finite=False))

        too_far = factor.T @ too_large(ratio_times, factor @ gradient, 1 / least)
        found[self.whole.order] = dpotrs(self.lower, gradient, lower=1)[0] - too_far
        return found


def _covariances(spread: FloatArray) -> FloatArray:
    """(m, k, k) covariances of displacements by each cause (p, k, m)."""
    return np.asarray(np.einsum("pkm,plm->mkl", spread, spread), dtype=float)


def too_large(times: Callable[[FloatArray], FloatArray], vector: FloatArray, most: float) -> FloatArray:
    """What a matrix times a vector (n,) is more than if its eigenvalues were no larger than `most`.

    By what the matrix times some directions (n, k) is.
    """
    new = np.random.default_rng(0).normal(size=(len(vector), BLOCK))
    new[:, 0] = vector
    basis, images = np.zeros((2, len(vector), 0))
    while 2 * max(basis.shape[1] + BLOCK, FEWEST * BLOCK) <= len(vector):
        for _ in range(2):  # the second makes up for what rounding left along the basis
            new = np.linalg.qr(new - basis @ (basis.T @ new))[0]
        basis, images = np.hstack([basis, new]), np.hstack([images, times(new)])
        values, vectors = np.linalg.eigh(basis.T @ images)
        along = vectors.T @ (basis.T @ vector)
        large = values >= min(values[-1], most)
        off = np.linalg.norm(images @ vectors[:, large] - basis @ (vectors[:, large] * values[large]), axis=0)
        is_close = np.linalg.norm(off * along[large]) <= CONVERGED * np.linalg.norm(np.minimum(values, most) * along)
        if is_close and basis.shape[1] >= FEWEST * BLOCK:
            return np.asarray(basis @ (vectors @ (np.maximum(values - most, 0) * along)))
        new = images[:, -BLOCK:]
    values, vectors = np.linalg.eigh(times(np.eye(len(vector))))
    return np.asarray(vectors @ (np.maximum(values - most, 0) * (vectors.T @ vector)))
