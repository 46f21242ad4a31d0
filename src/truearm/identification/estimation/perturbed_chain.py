"""A chain with small motions by terms, composed exactly, and the derivatives of its tips by their coefficients."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from truearm.arm.chain import Chain
from truearm.identification.terms.basis import Basis, Constant
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.typing import FloatArray, IntArray

CHUNK = 1024  # readings of a chunk: their narrow Jacobian stays in the cache of a core


@dataclass(frozen=True, eq=False)
class Site:
    """A place and a direction, with all basis functions that move the arm there.

    Attributes
    ----------
    place : int
    direction : (6,) array
    bases : tuple of Basis
    columns : (n_functions,) int array
        Their coefficients among the parameters.
    """

    place: int
    direction: FloatArray
    bases: tuple[Basis, ...]
    columns: IntArray

    @property
    def is_constant(self) -> bool:
        """Whether the motion is the same in every pose."""
        return all(isinstance(basis, Constant) for basis in self.bases)

    def values(self, state: ArmState) -> FloatArray:
        """(n_functions, m) values of the basis functions at a state's readings."""
        if len(self.bases) == 1:
            return self.bases[0].values(state)
        return np.concatenate([basis.values(state) for basis in self.bases])


@dataclass(frozen=True, eq=False)
class PerturbedChain:
    """A chain with terms, whose motions are composed exactly at every reading.

    Parameters
    ----------
    chain : Chain
        The nominal chain.
    terms : tuple of Term
    """

    chain: Chain
    terms: tuple[Term, ...]

    @cached_property
    def n_coefficients(self) -> int:
        """Number of coefficients of all terms."""
        return sum(term.n_coefficients for term in self.terms)

    @cached_property
    def sites(self) -> list[Site]:
        """Terms grouped by place and direction."""
        starts = np.cumsum([0, *(term.n_coefficients for term in self.terms)])
        grouped: dict[tuple[int, tuple[float, ...]], list[int]] = {}
        for i, term in enumerate(self.terms):
            grouped.setdefault((term.place, term.direction), []).append(i)
        return [
            Site(
                place,
                np.array(direction),
                tuple(self.terms[i].basis for i in members),
                np.concatenate([np.arange(starts[i], starts[i + 1]) for i in members]),
            )
            for (place, direction), members in grouped.items()
        ]

    def values(self, state: ArmState) -> list[FloatArray]:
        """Values of the basis functions of every site; sites with the same bases share them."""
        values: dict[tuple[Basis, ...], FloatArray] = {}
        for site in self.sites:
            if site.bases not in values:
                values[site.bases] = site.values(state)
        return [values[site.bases] for site in self.sites]

    def motions(self, x: FloatArray, values: list[FloatArray]) -> FloatArray:
        """(n_places, 6, m) motions [rad, mm] with coefficients `x`; (n_places, 6, 1) if they are constant."""
        m = 1 if all(site.is_constant for site in self.sites) else values[0].shape[1]
        out = np.zeros((self.chain.n_places, 6, m))
        for site, value in zip(self.sites, values, strict=True):
            part = x[site.columns]
            if part.any():
                out[site.place] += site.direction[:, None] * (part @ value[:, :m])
        return out

    def with_constants(self, x: FloatArray) -> Chain:
        """The chain with the constant terms composed, without the others."""
        motions, start = np.zeros((self.chain.n_places, 6)), 0
        for term in self.terms:
            if isinstance(term.basis, Constant):
                motions[term.place] += x[start] * np.array(term.direction)
            start += term.n_coefficients
        return self.chain.with_motions(motions)

    def tips(self, state: ArmState, x: FloatArray) -> FloatArray:
        """(n, 3) tips [mm] at the readings of a state."""
        out = np.empty((len(state), 3))
        for rows in chunks(len(state)):
            piece = state.rows(rows)
            motions = self.motions(x, self.values(piece)) if self.sites else np.zeros((self.chain.n_places, 6, 1))
            wide = np.broadcast_to(motions, (*motions.shape[:2], len(piece)))
            out[rows] = self.chain.tip_in_base(piece.angles, wide.transpose(2, 0, 1))
        return out

    def derivatives(self, state: ArmState, x: FloatArray) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Yield tips (3, m) [mm] and their derivatives (n_coefficients, 3, m) by chunks of readings."""
        for rows in chunks(len(state)):
            piece = state.rows(rows)
            values = self.values(piece)
            tips, motion_jacobian = moved_chain(self.chain, piece, self.motions(x, values))
            columns = np.empty((self.n_coefficients, 3, len(piece)))
            for site, value in zip(self.sites, values, strict=True):
                by_site = np.tensordot(site.direction, motion_jacobian[site.place], axes=1)
                columns[site.columns] = by_site * value[:, None, :]
            yield rows, tips, columns


def moved_chain(chain: Chain, state: ArmState, motions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Tips (3, m) [mm] and their derivatives (n_places, 6, 3, m) by the motions' components, of up to `CHUNK`."""
    _, tips, motion_jacobian = next(chain.tip_derivatives_by_chunk(state.angles, lambda _: motions, chunk=CHUNK))
    return tips, motion_jacobian


def chunks(n: int) -> list[slice]:
    """Slices of readings that are evaluated together."""
    return [slice(start, min(start + CHUNK, n)) for start in range(0, n, CHUNK)]
