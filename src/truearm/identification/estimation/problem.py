"""The least-squares problem of an arm's terms: its residuals, and its normal equations without the Jacobian.

A column of the Jacobian is a product, the tip's derivative by a small motion (of a *site*: place and direction) times a
basis function of the arm's state. So for two sites a, b with basis functions phi and psi

    (J^T J)[(a, k), (b, l)] = sum_n [sum_c t_a,c t_b,c](n) phi_k(n) psi_l(n),

coordinates are contracted before readings. Sites with many functions (harmonics of a joint's angle) are evaluated that
way, in pairs; sites with few functions are columns of a narrow Jacobian, which costs less than pairs. Of many readings
the pairs of two sites of harmonics are Fourier transforms of what is contracted (`truearm.solve.trigonometric_sums`).
Readings are processed in chunks, so that memory does not grow with their number. The unknowns of an artefact affect its
own readings only: the matrix is an arrowhead (`truearm.solve.arrowhead`), whose cost and size are linear in the
artefacts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations_with_replacement, pairwise

import numpy as np
from scipy.sparse import csr_array

from truearm.arm.rigid_motions import rotations_and_jacobians
from truearm.identification.estimation.perturbed_chain import CHUNK, MOST_NARROW, PerturbedChain, chunks, moved_chain
from truearm.identification.references.references import LinearisedResiduals, Points, Reference
from truearm.identification.terms.state import ArmState
from truearm.solve.arrowhead import Arrowhead
from truearm.solve.threads import cores, one_blas_thread
from truearm.solve.trigonometric_sums import Multiples, is_cheaper, weighted_products
from truearm.typing import FloatArray, IntArray

# References that compare tips with each other. A smaller arm has smaller residuals of them, and they do not determine
# its size: their residuals are relative to that size, since otherwise noise and arm would shrink together.
RELATIVE = ("seat", "sphere", "plane", "line")
# References in mm of an instrument: they determine the size of the arm.
ABSOLUTE = ("point", "distance", "pose")
# Chunks are distributed to a fixed number of groups, so that the order of summation does not depend on the threads.
GROUPS = 2
# Readings that are transformed together: their weights are in memory.
TRANSFORMED = 32 * CHUNK
# Maximum size of the cache of basis function values: those of 12,000 readings of 1,400 functions.
KEPT_BYTES = 144 * 2**20


@dataclass(frozen=True, eq=False)
class SmallMotionProblem:
    """Residuals of readings under terms and references' unknowns.

    The parameters are the coefficients of all terms, then the unknowns of all references.

    Parameters
    ----------
    perturbed_chain : PerturbedChain
        The chain and its terms, with tips in the frame of the references.
    state : ArmState
        Of all readings.
    references : tuple of Reference
    """

    perturbed_chain: PerturbedChain
    state: ArmState
    references: tuple[Reference, ...]
    _kept: dict[tuple[int, int], FloatArray] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def n_parameters(self) -> int:
        """Number of coefficients and unknowns."""
        return self._starts[-1]

    def unknowns_of(self, which: int) -> slice:
        """Slice of the unknowns of a reference among the parameters."""
        return slice(self._starts[which], self._starts[which + 1])

    @cached_property
    def _starts(self) -> list[int]:
        counts = [self.perturbed_chain.n_coefficients, *(len(reference.unknowns) for reference in self.references)]
        return [int(start) for start in np.cumsum(counts)]

    @property
    def has_points_alone(self) -> bool:
        """Whether points are the only reference: residuals are tips, and parameters coefficients."""
        return len(self.references) == 1 and isinstance(self.references[0], Points)

    def residuals(self, x: FloatArray) -> list[FloatArray]:
        """(k, m) residuals of every reference [mm]."""
        return [
            np.concatenate([part.residuals for part in self._pieces(i, x, self._values)], axis=-1)
            for i in range(len(self.references))
        ]

    def normal_equations(self, x: FloatArray, weights: Sequence[FloatArray]) -> list[Arrowhead]:
        """Cost, gradient and Gauss-Newton matrix of each reference with its own unknowns.

        Parameters
        ----------
        x : (n_parameters,) array
            [rad, mm per unit of the basis; mm].
        weights : sequence of (k, m) array
            One over the standard deviations of each reference's residuals [1/mm].
        """
        with one_blas_thread():
            return [self._equations(i, x, weights[i]) for i in range(len(self.references))]

    def linearised(self, x: FloatArray, residuals: Sequence[FloatArray] | None = None) -> list[LinearisedResiduals]:
        """Residuals of every reference and their derivatives by tips, turns and unknowns; what it takes is not kept.

        Where the residuals at `x` are known, those of points tell where the tips are.
        """
        found = []
        for i, reference in enumerate(self.references):
            if residuals is not None and isinstance(reference, Points):
                found.append(reference.linearised(reference.points.T + residuals[i], x[:0], slice(None)))
                continue
            parts = list(self._pieces(i, x, lambda *of: self.perturbed_chain.values(of[2])))
            turns = [part.by_turn for part in parts if part.by_turn is not None]
            found.append(
                LinearisedResiduals(
                    np.concatenate([part.residuals for part in parts], axis=-1),
                    np.concatenate([part.by_tip for part in parts], axis=-1),
                    np.concatenate([part.unknown for part in parts], axis=-1),
                    np.concatenate([part.by_unknown for part in parts], axis=-1),
                    np.concatenate(turns, axis=-1) if turns else None,
                )
            )
        return found

    def changes(self, x: FloatArray, step: FloatArray, residuals: Sequence[FloatArray]) -> list[FloatArray]:
        """(k, m) changes of the residuals [mm] by a small step of the coefficients, to first order.

        `residuals` are those at `x`.
        """
        found = []
        for i, linear in enumerate(self.linearised(x, residuals)):
            of_pieces = []
            for piece in even_chunks(linear.residuals.shape[1]):
                state = self.state.rows(self.references[i].rows[piece])
                values = self._values(i, piece, state)
                along_sites = self._site_derivatives(state, of_readings(linear, piece), values, x)
                of_pieces.append(self.perturbed_chain.along(step, along_sites, values))
            found.append(np.concatenate(of_pieces, axis=1))
        return found

    def gradient_of_points(self, x: FloatArray, pulls: FloatArray) -> FloatArray:
        """(n_coefficients,) derivatives of the tips along vectors (3, m), summed over a problem of points alone."""
        (points,), found = self.references, np.zeros(self.perturbed_chain.n_coefficients)
        for piece in even_chunks(len(points.rows)):
            state = self.state.rows(points.rows[piece])
            values = self._values(0, piece, state)
            found += self.perturbed_chain.gradient_from_values(state, values, x, pulls[:, piece])
        return found

    def _pieces(
        self, which: int, x: FloatArray, values_of: Callable[[int, slice, ArmState], FloatArray]
    ) -> Iterator[LinearisedResiduals]:
        reference = self.references[which]
        for piece in even_chunks(len(reference.rows)):
            state = self.state.rows(reference.rows[piece])
            values = values_of(which, piece, state)
            if reference.uses_orientation:
                yield self._linearised(which, piece, state, self.perturbed_chain.motions(x, values), x)[0]
            else:
                tips = self.perturbed_chain.tips_from_values(state.angles, values, x).T
                yield reference.linearised(tips, x[self.unknowns_of(which)], piece)

    def site_derivatives(
        self, which: int, rows: IntArray, linear: LinearisedResiduals, x: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Factors of the derivatives by the terms, of some of a reference's readings.

        They are derivatives (n_sites, k, m) along the sites, and values (n_functions, m) of the functions. `linear` is
        the whole reference, as `linearised` gives it; of residuals times weights, if it was weighed.
        """
        state = self.state.rows(self.references[which].rows[rows])
        values = self.perturbed_chain.values(state)
        return self._site_derivatives(state, of_readings(linear, rows), values, x), values

    def _site_derivatives(
        self, state: ArmState, linear: LinearisedResiduals, values: FloatArray, x: FloatArray
    ) -> FloatArray:
        motions = self.perturbed_chain.motions(x, values)
        motion_jacobian = moved_chain(self.perturbed_chain.chain, state, motions)[1]
        return self._along_sites(linear, motions, motion_jacobian)

    def sums_of(
        self, members: Sequence[tuple[int, IntArray]], linear: Sequence[LinearisedResiduals], x: FloatArray
    ) -> GaussNewtonSums:
        """Sums over some readings of some references, without unknowns; the next ones take their memory.

        `members` are numbers of references with rows, `linear` each whole reference, as in `site_derivatives`.
        """
        self._memory.fill(0.0)
        sums = GaussNewtonSums(self.perturbed_chain, 0, sum(len(rows) for _, rows in members), self._memory)
        for which, rows in members:
            for some in (rows[piece] for piece in chunks(len(rows), CHUNK)):
                along_sites, values = self.site_derivatives(which, some, linear[which], x)
                angles = self.state.rows(self.references[which].rows[some]).joint_angles
                sums.add(linear[which].residuals[:, some], along_sites, values, angles)
        sums.transform()
        return sums

    @cached_property
    def _memory(self) -> FloatArray:
        """Of a matrix that is summed again and again: pages of new memory take half as long as its factorisation."""
        return np.empty((self.perturbed_chain.n_coefficients,) * 2)

    def log_size_ratio(self, x: FloatArray) -> float:
        """Logarithm of the size of the arm at readings with relative references, over its nominal size."""
        if not len(self._relative):
            return 0.0
        return float(np.log(self._size(x) / self._nominal_size) / 2)

    def log_size_ratio_gradient(self, x: FloatArray) -> FloatArray:
        """(n_parameters,) derivative of `log_size_ratio`."""
        found = np.zeros(self.n_parameters)
        if len(self._relative):
            off = self._off_axis(x)
            off = self.perturbed_chain.chain.fixed[0, :3, :3] @ off.T / ((off**2).sum() + 1e-12)
            state, chain = self.state.rows(self._relative), self.perturbed_chain
            found[: chain.n_coefficients] = chain.gradient(state, self._without_base(x), off)
            found[self._base] = 0.0
        return found

    @cached_property
    def _relative(self) -> IntArray:
        """Readings with relative references."""
        rows = [reference.rows for reference in self.references if reference.kind in RELATIVE]
        return np.unique(np.concatenate(rows)) if rows else np.zeros(0, dtype=np.intp)

    @cached_property
    def _base(self) -> IntArray:
        """Coefficients that move the arm as a whole."""
        columns = [site.columns for site in self.perturbed_chain.sites if site.place == 0]
        return np.concatenate(columns) if columns else np.zeros(0, dtype=np.intp)

    def _without_base(self, x: FloatArray) -> FloatArray:
        """Coefficients with those of the base set to zero."""
        coefficients = x[: self.perturbed_chain.n_coefficients].copy()
        coefficients[self._base] = 0.0
        return coefficients

    def _size(self, x: FloatArray) -> float:
        return float((self._off_axis(x) ** 2).sum()) + 1e-12  # a picometre

    @cached_property
    def _nominal_size(self) -> float:
        return self._size(np.zeros(self.n_parameters))

    def _off_axis(self, x: FloatArray) -> FloatArray:
        """These tips in the base frame (m, 3) [mm], relative to the axis of joint 1, and along it to their mean.

        The size is then independent of the position of the base and of the height on that axis, and it is defined for
        tips that are all in one seat.
        """
        base = self.perturbed_chain.chain.fixed[0]
        tips = self.perturbed_chain.tips(self.state.rows(self._relative), self._without_base(x))
        off: FloatArray = (tips - base[:3, 3]) @ base[:3, :3]
        off[:, 2] -= off[:, 2].mean()
        return off

    def equations(self, x: FloatArray, weights: Sequence[FloatArray]) -> tuple[list[Arrowhead], Arrowhead]:
        """Normal equations of every reference, and of all of them and their constraints together."""
        parts = self.normal_equations(x, weights)
        joined = Arrowhead.combine(parts)
        if not joined.blocks.shape[0]:
            return parts, joined
        constraints = self.constraints(x)
        return parts, Arrowhead(
            joined.cost + constraints.cost,
            joined.gradient + constraints.gradient,
            joined.head,
            joined.coupling,
            joined.blocks + constraints.blocks,
        )

    def constraints(self, x: FloatArray) -> Arrowhead:
        """Normal equations of the constraints among the unknowns, in all parameters."""
        p, u = self.perturbed_chain.n_coefficients, self.n_parameters - self.perturbed_chain.n_coefficients
        cost, gradient, blocks = 0.0, np.zeros(self.n_parameters), csr_array((u, u))
        for i, reference in enumerate(self.references):
            where = self.unknowns_of(i)
            constraints = reference.constraints(x[where])
            if constraints is not None:
                residuals = constraints.residuals / constraints.std
                line, unknown = np.nonzero(constraints.by_unknown)
                values = constraints.by_unknown[line, unknown] / constraints.std[line]
                by = csr_array((values, (line, unknown + where.start - p)), shape=(len(residuals), u))
                cost += 0.5 * float(residuals @ residuals)
                gradient[p:] += by.T @ residuals
                blocks = blocks + by.T @ by
        return Arrowhead(cost, gradient, np.zeros((p, p)), np.zeros((u, p)), blocks)

    def constraints_cost(self, x: FloatArray) -> float:
        """Cost of the constraints."""
        found = (self.references[i].constraints(x[self.unknowns_of(i)]) for i in range(len(self.references)))
        return sum(0.5 * float(((r.residuals / r.std) ** 2).sum()) for r in found if r is not None)

    def _equations(self, which: int, x: FloatArray, weights: FloatArray) -> Arrowhead:
        pieces = even_chunks(len(self.references[which].rows))
        groups = [pieces[start::GROUPS] for start in range(min(GROUPS, len(pieces)))]

        def sums_of(group: list[slice]) -> GaussNewtonSums:
            reference = self.references[which]
            sums = GaussNewtonSums(self.perturbed_chain, len(reference.unknowns), len(reference.rows))
            for piece in group:
                self._add(sums, which, piece, x, weights[:, piece])
            return sums

        if len(groups) == 1:
            return sums_of(groups[0]).equations()
        with ThreadPoolExecutor(cores()) as threads:
            first, *others = threads.map(sums_of, groups)
        for other in others:
            first.merge(other)
        return first.equations()

    def _add(self, sums: GaussNewtonSums, which: int, piece: slice, x: FloatArray, weights: FloatArray) -> None:
        state = self.state.rows(self.references[which].rows[piece])
        values = self._values(which, piece, state)
        motions = self.perturbed_chain.motions(x, values)
        plain, motion_jacobian = self._linearised(which, piece, state, motions, x)
        linear = plain.weighted(weights)
        along_sites = self._along_sites(linear, motions, motion_jacobian)
        sums.add(linear.residuals, along_sites, values, state.joint_angles, linear)

    def _along_sites(self, linear: LinearisedResiduals, motions: FloatArray, motion_jacobian: FloatArray) -> FloatArray:
        """(n_sites, k, m) derivatives of residuals along the sites, from those of the tips (n_places, 6, 3, m)."""
        parts = [(linear.by_tip, self.perturbed_chain.along_sites(motion_jacobian))]
        if linear.by_turn is not None:
            turns = np.zeros_like(motion_jacobian)
            for place, motion in enumerate(motions):
                _, jacobian = rotations_and_jacobians(motion[:3])
                wide = np.broadcast_to(jacobian, (3, 3, motion_jacobian.shape[3]))
                turns[place, :3] = np.einsum("dbm,dcm->bcm", wide, motion_jacobian[place, 3:])
            parts.append((linear.by_turn, self.perturbed_chain.along_sites(turns)))
        (k, _, m), n_sites = linear.by_tip.shape, len(self.perturbed_chain.sites)
        out, product = np.zeros((n_sites, k, m)), np.empty((n_sites, m))
        for by, along in parts:
            # Coordinate by coordinate: contiguous in the readings, several times as fast as an einsum.
            for row, coordinate in np.argwhere(by.any(axis=2)):
                out[:, row] += np.multiply(along[:, coordinate], by[row, coordinate], out=product)
        return out

    def _linearised(
        self, which: int, piece: slice, state: ArmState, motions: FloatArray, x: FloatArray
    ) -> tuple[LinearisedResiduals, FloatArray]:
        """Residuals and derivatives of a piece, and the tips' derivatives (n_places, 6, 3, m) by the motions."""
        reference = self.references[which]
        tips, motion_jacobian = moved_chain(self.perturbed_chain.chain, state, motions)
        # Translations of the tip are along the flange axes before a rotation of the tip.
        axes = motion_jacobian[-1, 3:].transpose(1, 0, 2)
        if reference.uses_orientation and motions[-1, :3].any():
            turned, _ = rotations_and_jacobians(motions[-1, :3])
            axes = np.einsum("abm,bcm->acm", axes, np.broadcast_to(turned, axes.shape))
        return reference.linearised(tips, x[self.unknowns_of(which)], piece, axes), motion_jacobian

    def _values(self, which: int, piece: slice, state: ArmState) -> FloatArray:
        key = (which, piece.start)
        if key not in self._kept:
            values = self.perturbed_chain.values(state)
            # Chunks are equally large but for the last.
            if values.nbytes * (len(self._kept) + 1) > KEPT_BYTES:
                return values
            self._kept[key] = values
        return self._kept[key]


def even_chunks(n: int) -> list[slice]:
    """Chunks of one size: a small rest would be a chunk with a matrix of its own, which takes longer than its sums."""
    n_chunks = max(math.ceil(n / CHUNK - 0.25), 1)
    return chunks(n, max(math.ceil(n / n_chunks), 1))


def of_readings(linear: LinearisedResiduals, rows: IntArray | slice) -> LinearisedResiduals:
    """The residuals of some readings."""
    return LinearisedResiduals(
        linear.residuals[:, rows],
        linear.by_tip[..., rows],
        linear.unknown[:, rows],
        linear.by_unknown[..., rows],
        None if linear.by_turn is None else linear.by_turn[..., rows],
    )


class GaussNewtonSums:
    """Sums over readings of gradient and Gauss-Newton matrix: narrow columns first, then the sites in pairs.

    `n_readings` will be added: pairs of sites of harmonics are transformed where that costs less. The matrix may be
    given, of zeros.
    """

    def __init__(self, chain: PerturbedChain, n_unknowns: int, n_readings: int, gram: FloatArray | None = None) -> None:
        sites, n_coefficients = chain.sites, chain.n_coefficients
        self.wide = [(i, site) for i, site in enumerate(sites) if len(site.columns) > MOST_NARROW]
        site_of, row_of = chain.of_coefficient
        narrow = np.flatnonzero(~np.isin(site_of, [i for i, _ in self.wide]))
        self.n_narrow, self.site_of_narrow, self.row_of_narrow = len(narrow), site_of[narrow], row_of[narrow]
        # The order of the sums: within a span both triangles of the matrix are summed, beside it the upper one.
        self.order = np.concatenate([narrow, *(site.columns for _, site in self.wide)])
        self.stops = np.cumsum([self.n_narrow, *(len(site.columns) for _, site in self.wide)])
        self.spans = [slice(int(a), int(b)) for a, b in pairwise(self.stops)]
        n_together = min(n_readings, TRANSFORMED)
        series = [(n, site.series) for n, (_, site) in enumerate(self.wide)]
        self.transformed = [
            (n, o, one, other)
            for (n, one), (o, other) in combinations_with_replacement(series, 2)
            if one and other and is_cheaper(n_together, one.orders, None if n == o else other.orders)
        ]
        self.products: list[FloatArray] = []
        self.angles: list[FloatArray] = []
        self._memory = np.empty(0)
        self.cost = 0.0
        self.gradient = np.zeros(n_coefficients)
        self.gram = np.zeros((n_coefficients, n_coefficients)) if gram is None else gram
        self.by_unknown = np.zeros(n_unknowns)
        self.coupling = np.zeros((n_unknowns, n_coefficients))
        self.blocks = csr_array((n_unknowns, n_unknowns))

    def add(
        self,
        residuals: FloatArray,
        by_site: FloatArray,
        values: FloatArray,
        angles: FloatArray,
        linear: LinearisedResiduals | None = None,
    ) -> None:
        """Add a weighted chunk of residuals (k, m) at joint angles (m, n_joints).

        `by_site` (n_sites, k, m) are derivatives along the sites, `values` (n_functions, m) of the chain's functions;
        `linear` those by unknowns.
        """
        # The same memory for every chunk: pages of new memory take a fifth of the time of the sums.
        n, (k, m) = self.n_narrow, residuals.shape
        if self._memory.size < (size := (n * (k + 2) + 1) * m):
            self._memory = np.empty(size)
        flat, narrow, contracted = np.split(self._memory[:size].reshape(-1, m), [n * k, n * (k + 1)])
        columns, flat = flat.reshape(n, k, m), flat.reshape(n, k * m)
        values.take(self.row_of_narrow, axis=0, out=narrow, mode="clip")  # which copies straight into the memory
        by_site.take(self.site_of_narrow, axis=0, out=columns, mode="clip")
        columns *= narrow[:, None, :]
        self.cost += 0.5 * float(np.vdot(residuals, residuals))
        self.gradient[: self.n_narrow] += flat @ residuals.ravel()
        self.gram[: self.n_narrow, : self.n_narrow] += flat @ flat.T
        pairs = [(n, o) for n, o, *_ in self.transformed]
        of_wide = [values[site.rows] for _, site in self.wide]
        for n, ((i, _), own, span) in enumerate(zip(self.wide, of_wide, self.spans, strict=True)):
            # An einsum without sums over the last axis takes a third of the time of product and sum.
            products = np.einsum("skm,km->sm", by_site, by_site[i])
            products.take(self.site_of_narrow, axis=0, out=contracted[:-1], mode="clip")
            contracted[:-1] *= narrow  # the residuals are one more column
            np.einsum("km,km->m", residuals, by_site[i], out=contracted[-1])
            product = contracted @ own.T
            self.gram[: self.n_narrow, span] += product[:-1]
            self.gradient[span] += product[-1]
            if (n, n) not in pairs:
                half = np.sqrt(products[i]) * own
                self.gram[span, span] += half @ half.T
            for o in range(n + 1, len(of_wide)):
                if (n, o) not in pairs:
                    self.gram[span, self.spans[o]] += (products[self.wide[o][0]] * own) @ of_wide[o].T
        if self.transformed:
            along = [by_site[i] for i, _ in self.wide]
            self.products.append(np.array([(along[n] * along[o]).sum(axis=0) for n, o in pairs]))
            self.angles.append(angles)
            if sum(map(len, self.angles)) >= TRANSFORMED:
                self.transform()
        if linear is not None and len(self.by_unknown):
            self._add_unknowns(linear, by_site, of_wide, flat)

    def _add_unknowns(
        self, linear: LinearisedResiduals, by_site: FloatArray, of_wide: list[FloatArray], flat: FloatArray
    ) -> None:
        by = by_all_unknowns(linear, len(self.by_unknown))
        self.by_unknown += by @ linear.residuals.ravel()
        self.blocks = self.blocks + by @ by.T
        self.coupling[:, : self.n_narrow] += by @ flat.T
        readings = np.broadcast_to(np.arange(linear.unknown.shape[1]), linear.unknown.shape).ravel()
        for (i, _), own, span in zip(self.wide, of_wide, self.spans, strict=True):
            contracted = (linear.by_unknown * by_site[i][:, None]).sum(axis=0)
            spread = csr_array(
                (contracted.ravel(), (linear.unknown.ravel(), readings)),
                shape=(len(self.by_unknown), linear.unknown.shape[1]),
            )
            self.coupling[:, span] += spread @ own.T

    def transform(self) -> None:
        """Add the pairs of sites of harmonics of all chunks since the last transforms."""
        if not self.angles:
            return
        products, angles = np.concatenate(self.products, axis=1), np.concatenate(self.angles).T
        self.products, self.angles = [], []
        for weights, (n, o, *series) in zip(products, self.transformed, strict=True):
            one, other = (Multiples(angles[joint - 1], orders) for joint, orders in series)
            self.gram[self.spans[n], self.spans[o]] += weighted_products(weights, one, None if n == o else other)

    def merge(self, other: GaussNewtonSums) -> None:
        """Add the sums of another group of chunks, whose pairs of harmonics are transformed with these."""
        self.products += other.products
        self.angles += other.angles
        self.cost += other.cost
        self.gradient += other.gradient
        self.gram += other.gram
        self.by_unknown += other.by_unknown
        self.coupling += other.coupling
        self.blocks = self.blocks + other.blocks

    def equations(self) -> Arrowhead:
        """The normal equations in the order of the parameters."""
        self.transform()
        back, head = np.argsort(self.order), np.empty_like(self.gram)
        # Whole blocks of adjacent parameters: element by element it takes as long as the products of few readings.
        cuts = np.union1d([0, *self.stops], np.flatnonzero(np.diff(self.order) != 1) + 1)
        runs = [(slice(a, b), slice(self.order[a], self.order[a] + b - a)) for a, b in pairwise(cuts)]
        for (one, here), (other, there) in combinations_with_replacement(runs, 2):
            block = self.gram[one, other]
            head[here, there], head[there, here] = block, block.T
        gradient = np.concatenate([self.gradient[back], self.by_unknown])
        return Arrowhead(self.cost, gradient, head, self.coupling[:, back], self.blocks)


def by_all_unknowns(linear: LinearisedResiduals, n: int) -> csr_array:
    """(n, k m) derivatives of residuals by all unknowns of their reference."""
    k, m = linear.residuals.shape
    unknown = np.broadcast_to(linear.unknown, linear.by_unknown.shape)
    residual = np.broadcast_to(m * np.arange(k)[:, None, None] + np.arange(m), unknown.shape)
    nonzero = linear.by_unknown != 0
    return csr_array((linear.by_unknown[nonzero], (unknown[nonzero], residual[nonzero])), shape=(n, k * m))
