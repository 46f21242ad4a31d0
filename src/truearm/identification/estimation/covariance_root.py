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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from truearm.identification.estimation.perturbed_chain import MOST_NARROW, PerturbedChain
from truearm.solve.square_roots import covariance_factor
from truearm.typing import FloatArray, IntArray


class _Narrow(NamedTuple):
    """Coefficients of sites with few functions: the site and the function of each, and their columns of F."""

    coefficients: IntArray
    sites: IntArray
    functions: IntArray
    columns: FloatArray


class _Wide(NamedTuple):
    """A site with many functions: its coefficients, its functions, and their columns of F."""

    coefficients: IntArray
    site: int
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
    narrow : _Narrow
    wide : tuple of _Wide
    """

    n_rows: int
    narrow: _Narrow
    wide: tuple[_Wide, ...]

    @classmethod
    def of(cls, covariance: FloatArray, perturbed_chain: PerturbedChain) -> Self:
        """The root of a covariance (n_coefficients, n_coefficients), which may be singular."""
        is_uncertain = covariance.diagonal() > 0
        narrow: list[tuple[int, IntArray, IntArray | slice]] = []
        wide: list[tuple[int, IntArray, IntArray | slice]] = []
        for number, site in enumerate(perturbed_chain.sites):
            kept = is_uncertain[site.columns]
            functions = site.rows if isinstance(site.rows, slice) and kept.all() else _numbers(site.rows)[kept]
            part = number, site.columns[kept], functions
            (wide if kept.sum() > MOST_NARROW else narrow).append(part)
        of_narrow = [np.concatenate([part[1] for part in narrow])] if narrow else [np.zeros(0, dtype=np.intp)]
        order = [*of_narrow, *(part[1] for part in wide)]
        which = np.concatenate(order)
        factor = covariance_factor(covariance[np.ix_(which, which)])
        stops = np.cumsum([len(part) for part in order])
        # From eigenvectors, of a singular covariance, it is no triangle.
        heights = stops if not np.tril(factor, -1).any() else np.full(len(stops), len(factor))
        columns = [
            np.ascontiguousarray(factor[:height, stop - len(part) : stop])
            for part, height, stop in zip(order, heights, stops, strict=True)
        ]
        return cls(
            len(factor),
            _Narrow(
                order[0],
                np.repeat(np.array([part[0] for part in narrow], dtype=np.intp), [len(part[1]) for part in narrow]),
                np.concatenate([np.zeros(0, dtype=np.intp), *(_numbers(part[2]) for part in narrow)]),
                columns[0],
            ),
            tuple(
                _Wide(coefficients, site, functions, own)
                for (site, coefficients, functions), own in zip(wide, columns[1:], strict=True)
            ),
        )

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
            for own, along in zip(out, along_sites[part.site], strict=True):
                own[: len(by_function)] += along * by_function
        return out

    def times_matrix(self, matrix: FloatArray) -> FloatArray:
        """``F @ matrix`` of a matrix (n_coefficients, q): (n_rows, q)."""
        out = np.zeros((self.n_rows, matrix.shape[1]))
        parts: Sequence[_Narrow | _Wide] = (self.narrow, *self.wide)
        for part in parts:
            out[: len(part.columns)] += part.columns @ matrix[part.coefficients]
        return out


def _numbers(rows: IntArray | slice) -> IntArray:
    """Row numbers, also of a slice."""
    return np.arange(rows.start, rows.stop) if isinstance(rows, slice) else rows
