"""Normal equations in the shape of an arrowhead, whose small blocks are eliminated one by one.

A few parameters, the *head*, affect all data. The others, the *unknowns*, form small blocks that are coupled with the
head and within themselves only, for example the positions of seats:

    | A   B^T | | x |   | a |
    | B   D   | | z | = | b |,      D block-diagonal.

Eliminating z leaves the Schur complement ``(A - B^T D^-1 B) x = a - B^T D^-1 b``, of the size of the head, from which x
has the same mean and covariance. The cost is linear in the number of blocks.

Source: G. H. Golub, V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems whose
variables separate", SIAM J. Numer. Anal. 10 (1973) 413; L. Kaufman, BIT 15 (1975) 49; of photogrammetry, D. C. Brown,
"The bundle adjustment", Int. Arch. Photogramm. 21-III (1976).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from scipy.sparse import block_diag, csr_array, diags_array

from truearm.solve.linear_algebra import MIN_PIVOT, ROUNDING
from truearm.typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Arrowhead:
    """The quadratic model of a least-squares cost at a point, of p parameters in the head and u unknowns.

    Attributes
    ----------
    cost : float
        Half the sum of squared residuals.
    gradient : (p + u,) array
        ``J^T r``, the head first.
    head : (p, p) array
        A, symmetric.
    coupling : (u, p) array
        B.
    blocks : (u, u) sparse array
        D, symmetric.
    """

    cost: float
    gradient: FloatArray
    head: FloatArray
    coupling: FloatArray
    blocks: csr_array

    @classmethod
    def combine(cls, parts: Sequence[Arrowhead]) -> Arrowhead:
        """The sum of parts with a common head and separate unknowns, in this order."""
        if len(parts) == 1:
            return cls(**vars(parts[0]))
        p = len(parts[0].head)
        return cls(
            sum(part.cost for part in parts),
            np.concatenate([sum(part.gradient[:p] for part in parts), *(part.gradient[p:] for part in parts)]),
            reduce(np.add, (part.head for part in parts)),
            np.concatenate([part.coupling for part in parts]),
            csr_array(block_diag([part.blocks for part in parts], format="csr")),
        )

    @property
    def diagonal(self) -> FloatArray:
        """(p + u,) diagonal of the matrix."""
        return np.concatenate([self.head.diagonal(), self.blocks.diagonal()])

    def dense(self) -> FloatArray:
        """The whole matrix, (p + u, p + u)."""
        return np.block([[self.head, self.coupling.T], [self.coupling, self.blocks.toarray()]])

    def times(self, x: FloatArray) -> FloatArray:
        """The matrix times a vector, (p + u,)."""
        head, unknown = x[: len(self.head)], x[len(self.head) :]
        return np.concatenate(
            [self.head @ head + self.coupling.T @ unknown, self.coupling @ head + self.blocks @ unknown]
        )

    def eliminate(self, precision: FloatArray, x: FloatArray, *, shared: BoolArray) -> SchurComplement:
        """Eliminate the unknowns, except those that would couple blocks.

        Parameters
        ----------
        precision : (u,) array
            Of the unknowns' priors, with mean zero.
        x : (p + u,) array
            The point of the linearisation.
        shared : (u,) bool array
            Unknowns to keep with the head, for example the length of an artefact used in many places.
        """
        p = len(self.head)
        if not len(shared):  # sparse matrices take milliseconds without a single entry
            nothing, none = np.zeros(0), np.zeros(0, dtype=np.intp)
            of_none = csr_array((0, 0)), np.zeros((0, p)), nothing, 0.0, 0.0
            return SchurComplement(np.arange(p), none, self.head, self.gradient, self.head.diagonal(), *of_none)
        eliminated, stay = np.flatnonzero(~shared), np.flatnonzero(shared)
        kept = np.concatenate([np.arange(p), p + stay])
        gram, gradient = self.head, self.gradient[kept]
        coupling = self.coupling[eliminated]
        if len(stay):
            of_shared = self.blocks[stay]
            gram = np.block([[gram, self.coupling[stay].T], [self.coupling[stay], of_shared[:, stay].toarray()]])
            coupling = np.hstack([coupling, of_shared[:, eliminated].toarray().T])
        size = gram.diagonal()
        root, n_full = _inverse_root(
            csr_array(self.blocks[eliminated][:, eliminated] + diags_array(precision[eliminated]))
        )
        half = root @ coupling
        towards = root @ (self.gradient[p:][eliminated] + precision[eliminated] * x[p:][eliminated])
        if len(eliminated):
            gram, gradient = gram - half.T @ half, gradient - half.T @ towards
        # Directions known only by their prior are not determined by the data.
        n_determined = n_full - float((root.multiply(root) @ precision[eliminated]).sum())
        gain = float(towards @ towards)
        return SchurComplement(
            kept, p + eliminated, gram, gradient, size, root, root.T @ half, -(root.T @ towards), gain, n_determined
        )


@dataclass(frozen=True, eq=False)
class SchurComplement:
    """The Schur complement of an `Arrowhead` without its blocks, and the step of the eliminated parameters.

    Attributes
    ----------
    kept, eliminated : (k,), (g,) int array
        Parameters in the Schur complement, the head first, and eliminated ones.
    gram : (k, k) array
    gradient : (k,) array
    size : (k,) array
        The diagonal before the elimination, which determines the rounding.
    root : (g, g) sparse array
        R with ``R^T R = D^-1``, priors included.
    slope : (g, k) array
        ``D^-1 B``: the eliminated parameters move by minus this times the step of the kept ones.
    offset : (g,) array
        Step of the eliminated parameters if the kept ones do not move.
    gain : float
        Decrease of twice the cost if the kept parameters do not move.
    n_determined : float
        Number of eliminated parameters that the data determine, given the kept ones.
    """

    kept: IntArray
    eliminated: IntArray
    gram: FloatArray
    gradient: FloatArray
    size: FloatArray
    root: csr_array
    slope: FloatArray
    offset: FloatArray
    gain: float
    n_determined: float

    def step(self, of_kept: FloatArray) -> FloatArray:
        """(p + u,) the step of all parameters for a step (k,) of the kept ones."""
        step = np.empty(len(self.kept) + len(self.eliminated))
        step[self.kept] = of_kept
        step[self.eliminated] = self.offset - self.slope @ of_kept
        return step

    def traces(self, parts: Sequence[Arrowhead], covariance: FloatArray) -> FloatArray:
        """Traces of the parts' matrices times the covariance of all parameters, from that of the kept ones (k, k).

        The unknowns of the parts follow each other in the order of the whole.
        """
        p = len(parts[0].head)
        # The covariance of the unknowns is `along` times that of the kept ones, plus D^-1 for the eliminated ones.
        along = np.zeros((len(self.kept) + len(self.eliminated) - p, len(self.kept)))
        along[self.eliminated - p] = -self.slope
        along[self.kept[p:] - p, np.arange(p, len(self.kept))] = 1.0
        across = along @ covariance
        place = np.full(len(along), -1, dtype=np.intp)
        place[self.eliminated - p] = np.arange(len(self.eliminated))
        traces, start = [], 0
        for part in parts:
            here = slice(start, start + part.blocks.shape[0])
            start = here.stop
            trace = float(np.vdot(part.head, covariance[:p, :p]))
            if here.stop > here.start:
                trace += 2 * float(np.vdot(part.coupling, across[here, :p]))
                trace += float(np.vdot(part.blocks @ along[here], across[here]))
                own = place[here]
                root = self.root[:, own[own >= 0]]
                trace += float((root.T @ root).multiply(part.blocks[own >= 0][:, own >= 0]).sum())
            traces.append(trace)
        return np.array(traces)


def _inverse_root(matrix: csr_array) -> tuple[csr_array, int]:
    """R with ``R^T R`` the inverse of a block-diagonal matrix, and the number of directions above rounding.

    In the others, which the data do not determine and which do not couple with the head, R is zero.
    """
    n = matrix.shape[0]
    if not n:
        return csr_array((0, 0)), 0
    from scipy.sparse.csgraph import connected_components  # slow to import, and points alone need no blocks

    n_blocks, block = connected_components(matrix, directed=False)
    sizes = np.bincount(block, minlength=n_blocks)
    order = np.argsort(block, kind="stable")
    within = np.empty(n, dtype=np.intp)
    within[order] = np.arange(n) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    scale = 1 / np.sqrt(matrix.diagonal())
    entries = matrix.tocoo()
    row, column = entries.coords
    unit = entries.data * scale[row] * scale[column]
    n_determined, rows, columns, values = 0, [], [], []
    for size in np.unique(sizes):
        number = np.full(n_blocks, -1, dtype=np.intp)
        number[sizes == size] = np.arange((sizes == size).sum())
        here = number[block[row]] >= 0
        dense = np.zeros(((sizes == size).sum(), size, size))
        dense[number[block[row[here]]], within[row[here]], within[column[here]]] = unit[here]
        members = np.empty(dense.shape[:2], dtype=np.intp)
        mine = number[block] >= 0
        members[number[block[mine]], within[mine]] = np.flatnonzero(mine)
        roots, n_here = _roots(dense)
        n_determined += n_here
        values.append((roots * scale[members][:, None, :]).ravel())
        rows.append(np.broadcast_to(members[:, :, None], dense.shape).ravel())
        columns.append(np.broadcast_to(members[:, None, :], dense.shape).ravel())
    together = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csr_array(together, shape=(n, n)), n_determined


def _roots(blocks: FloatArray) -> tuple[FloatArray, int]:
    """The same for blocks (n, s, s) of unit diagonal."""
    try:
        lower = np.linalg.cholesky(blocks)
    except np.linalg.LinAlgError:
        pass
    else:
        if (np.diagonal(lower, axis1=1, axis2=2) ** 2).min() >= MIN_PIVOT:
            return np.linalg.inv(lower), lower.shape[0] * lower.shape[1]
    values, vectors = np.linalg.eigh(blocks)
    is_determined = values > ROUNDING * values[:, -1:]
    scale = np.where(is_determined, 1 / np.sqrt(np.where(is_determined, values, 1.0)), 0.0)
    return scale[:, :, None] * vectors.transpose(0, 2, 1), int(is_determined.sum())
