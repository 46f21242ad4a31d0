"""A root of the covariance of an arm's coefficients, times the derivatives of its tips.

A column of the derivatives is a product: the tip's derivative t along a *site* (place and direction) times a function
phi of the arm's state. With F^T F the covariance, and F_s the columns of F of a site's functions,

    F J^T = sum_s t_s (F_s phi_s),

where phi has one value a reading and t as many as a reading has coordinates: multiplied first, the functions cost a
third of the product with the columns of J. Sites with few functions are such columns all the same, as there are many of
them. With these first, and the sites with many functions one after the other, Cholesky's F is an upper triangle, and
F_s has as many rows as it and those before it have columns.

Source of the factor: G. H. Golub, C. F. Van Loan, "Matrix Computations", 4th ed., section 4.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from truearm.identification.estimation.perturbed_chain import MOST_NARROW, PerturbedChain, as_slice
from truearm.solve.square_roots import covariance_factor
from truearm.typing import FloatArray, IntArray


class _Part(NamedTuple):
    """Some coefficients with the sites and functions whose products are their derivatives, and their columns of F."""

    coefficients: IntArray
    sites: IntArray
    functions: IntArray | slice
    columns: FloatArray


@dataclass(frozen=True, eq=False)
class CovarianceRoot:
    """F with ``F^T F`` the covariance of the coefficients, in parts by the sites of their terms.

    Its rows are independent causes of variance one, in an order of their own.

    Attributes
    ----------
    n_rows : int
        One for each coefficient that is uncertain.
    narrow : _Part
        All sites with few functions.
    wide : tuple of _Part
        A site with many functions each.
    """

    n_rows: int
    narrow: _Part
    wide: tuple[_Part, ...]

    @classmethod
    def of(cls, covariance: FloatArray, perturbed_chain: PerturbedChain) -> Self:
        """The root of a covariance (n_coefficients, n_coefficients), which may be singular."""
        site_of, row_of = perturbed_chain.of_coefficient
        uncertain = np.flatnonzero(covariance.diagonal() > 0)
        counts = np.bincount(site_of[uncertain], minlength=len(perturbed_chain.sites))
        is_wide = counts > MOST_NARROW
        wide = [uncertain[site_of[uncertain] == site] for site in np.flatnonzero(is_wide)]
        order = [uncertain[~is_wide[site_of[uncertain]]], *wide]
        which = np.concatenate(order)
        factor = covariance_factor(covariance[np.ix_(which, which)])
        is_triangle = not np.tril(factor, -1).any()  # from eigenvectors, of a singular covariance, it is none
        parts, stop = [], 0
        for coefficients in order:
            start, stop = stop, stop + len(coefficients)
            columns = np.ascontiguousarray(factor[: stop if is_triangle else None, start:stop])
            parts.append(_Part(coefficients, site_of[coefficients], as_slice(row_of[coefficients]), columns))
        return cls(len(factor), parts[0], tuple(parts[1:]))

    def times(self, along_sites: FloatArray, values: FloatArray) -> FloatArray:
        """``F J^T``: displacements by each cause.

        Parameters
        ----------
        along_sites : (n_sites, k, m) array
            Derivatives of k coordinates or residuals of m readings along the sites.
        values : (n_functions, m) array
            Of the basis functions, as `PerturbedChain.values` gives them.

        Returns
        -------
        (k, n_rows, m) array
        """
        (_, k, m), narrow = along_sites.shape, self.narrow
        out = np.zeros((k, self.n_rows, m))
        by_narrow = along_sites[narrow.sites] * values[narrow.functions][:, None]
        height = len(narrow.columns)
        product = narrow.columns @ by_narrow.reshape(len(by_narrow), k * m)
        out[:, :height] = product.reshape(height, k, m).transpose(1, 0, 2)
        for part in self.wide:
            by_function = part.columns @ values[part.functions]
            for own, along in zip(out, along_sites[part.sites[0]], strict=True):
                own[: len(by_function)] += along * by_function
        return out

    def times_matrix(self, matrix: FloatArray) -> FloatArray:
        """``F @ matrix`` of a matrix (n_coefficients, q): (n_rows, q)."""
        out = np.zeros((self.n_rows, matrix.shape[1]))
        for part in (self.narrow, *self.wide):
            out[: len(part.columns)] += part.columns @ matrix[part.coefficients]
        return out
