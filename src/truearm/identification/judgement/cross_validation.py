"""Cross-validation by group: residuals of readings from an arm identified without their group, in closed form.

The closed form holds on the linearisation at the minimum, with fixed prior scales, noise and robust weights. With
the whitened residuals r of a group, their whitened Jacobian J by the coefficients and the artefacts' unknowns, the
posterior covariance Sigma of these, and ``S = J Sigma J^T``,

    residuals without the group:                  (I - S)^-1 r
    covariance of predictions without the group:  S (I - S)^-1.

All references of a group are held out: points and orientations, seats and surfaces, and lengths between seats that
remain without readings. A reading that was excluded from the identification is predicted in the same way, with a weight
so small that it moves nothing. A complete leave-one-group-out cross-validation costs about as much as one more
Gauss-Newton matrix. Source: R. D. Cook, S. Weisberg, "Residuals and Influence in Regression", 1982, eqs. 2.2.7 and
3.6.4, for several cases at once.

Tips with points are compared with these. Tips in seats are compared with the position of the seat by the readings of
other groups or, for a seat that only this group touched, with the mean of the tips predicted in it. Distances are
compared where there are neither points nor seats, or apart from these; where there are none either, distances from
surfaces, from lines, or orientations. Anchors, surfaces and lines are located by other groups.

The Birge ratio compares the residual variance of held-out readings with the one that the posterior was computed with:
R. T. Birge, "The calculation of errors by the method of least squares", Phys. Rev. 40 (1932) 207.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import chain, compress, pairwise
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.linalg import eigh
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs
from scipy.sparse import csr_array, hstack, vstack

from truearm.identification.estimation import perturbed_chain
from truearm.identification.estimation.covariance_root import CovarianceRoot, too_large
from truearm.identification.estimation.identification import initial_problem, select_evenly
from truearm.identification.estimation.identification_result import IdentificationResult, ReferenceFit
from truearm.identification.estimation.linearisation import UNKNOWN_STD, eliminate_unknowns
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.estimation.residual_variance import FLOOR_MM2, NONE_HELD_OUT, HeldOutReadings
from truearm.identification.references.distances import Distances
from truearm.identification.references.references import LinearisedResiduals, Reference
from truearm.identification.references.surfaces import Lines, Planes, Spheres
from truearm.identification.terms.state import ArmState
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray

# Eigenvalues of I - S: 1 where the other groups determine a direction, 0 where only this group does. Below this bound
# residuals are mostly what the iterations left of them, and are scaled by no more than a thousand; where only a wide
# prior remains (the frame of a session that is one group), deviations are then as small as residuals. The covariance
# continues down to rounding, and shows which deviations these are (`HeldOutReadings.select_informative`).
LEAST_FREEDOM = 1e-3
# Smaller shares of a variance count as zero.
ROUNDING = 1e-9
# Robust weight of an excluded reading, which keeps its whitened residuals above rounding: one of 1000 standard
# deviations moves nothing by more than a hundred-thousandth of a standard deviation.
LEAST_WEIGHT = 1e-8
# Kinds of references that are compared with each other: what a tip is known by most directly comes first.
IN_SPACE, IN_LENGTH = ("point", "seat", "pose"), ("distance",)
COMPARED = (IN_SPACE, IN_LENGTH, ("sphere", "plane"), ("line",), ("orientation",))
# Readings that locate an anchor, a surface or a line.
LEAST_TOUCHES: dict[str, int] = {touched.kind: touched.least for touched in (Distances, Spheres, Planes, Lines)}
# Rounding of displacements in single precision, over the root of their variance by each coefficient alone: ten of the
# last of 24 bits. It is in no direction of the p causes, and S has this over the root of p (measured a quarter, of
# 1,400 coefficients). And what it may make of a deviation, in standard ones.
SINGLE_ROUNDING, MOST_ROUNDED = 6e-7, 1e-3
# Derivatives in memory at once, some ten megabytes, and the most readings of them.
MOST_DERIVATIVES = 1_200_000
MOST_READINGS = perturbed_chain.CHUNK
# Residuals a coefficient up to which the root of S is kept: some tens of megabytes.
MOST_SPREAD = 3
# Readings whose covariances are computed together, of a large group.
MOST_JUDGED = 2 * MOST_READINGS
# The readings of a group: for each of its references the rows.
Members = list[tuple[int, IntArray]]


def cross_validate_by_group(
    fit: IdentificationResult,
    state: ArmState,
    references: Sequence[Reference],
    group: IntArray,
    kinds: Sequence[str] | None = None,
) -> HeldOutReadings:
    """Deviations of readings from an arm identified without their group.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of the readings of the identification.
    references : sequence of Reference
        Those of the identification.
    group : (n,) int array
        The group of every reading.
    kinds : sequence of str, optional
        Kinds of references to compare, one of `COMPARED`; `compared_kinds` by default.

    Returns
    -------
    HeldOutReadings
        Of readings with points, and of those in seats of two or more, or of the other kinds; in the order of the
        readings.
    """
    kinds = compared_kinds(fit.references) if kinds is None else kinds
    with one_blas_thread():
        minimum = _minimum_of(fit, state, references, kinds)
        if len(fit.references) == 1 and not minimum.slope.size and 1 < len(np.unique(group)) == len(group):
            found = list(minimum.without_each(group))
        else:
            found = [
                part
                for batch in group_batches(fit.references, group, minimum.chunk)
                for part in minimum.without(batch, group)
            ]
    together = _together(found)
    return together.select(np.argsort(together.rows))


def cross_validate_regions(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], regions: Sequence[BoolArray], most: int
) -> list[HeldOutReadings]:
    """Deviations of the readings of each region (n,) from an arm identified without them; regions may overlap.

    All readings of a region are held out; `most` of them at most, evenly selected, are predicted.
    """
    kinds = IN_SPACE if any(part.kind in IN_SPACE for part in fit.references) else IN_LENGTH
    if not regions or not any(part.kind in kinds for part in fit.references):
        return [NONE_HELD_OUT for _ in regions]
    found = []
    with one_blas_thread():
        minimum = _minimum_of(fit, state, references, kinds)
        _MINIMA.pop(fit)  # regions come last
        for region in regions:
            own = minimum.judging(region, most)
            rows = [np.flatnonzero(region[part.rows]) for part in fit.references]
            which = np.repeat(np.arange(len(rows)), [len(some) for some in rows])
            row = np.concatenate(rows)
            batch = GroupBatch(np.zeros(len(row), dtype=np.intp), which, row)
            parts = list(own.without(batch, np.zeros(len(region), dtype=np.intp))) if len(row) else []
            found.append(_together(parts))
    return found


def _minimum_of(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], kinds: Sequence[str]
) -> _Minimum:
    """The linearisation at the minimum, once for groups and regions."""
    given = state, tuple(references), tuple(kinds)
    if fit not in _MINIMA or _MINIMA[fit][0] != given:
        _MINIMA[fit] = given, _Minimum.of(fit, state, references, kinds)
    return _MINIMA[fit][1]


def _together(parts: Sequence[HeldOutReadings]) -> HeldOutReadings:
    """Held-out readings of several groups."""
    if not parts:
        return NONE_HELD_OUT
    names = [field.name for field in fields(HeldOutReadings)]
    return HeldOutReadings(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def compared_kinds(references: Sequence[ReferenceFit]) -> tuple[str, ...]:
    """The kinds of references by which held-out readings are compared: the first of `COMPARED` that there is."""
    return next(kinds for kinds in COMPARED if any(part.kind in kinds for part in references))


class GroupBatch(NamedTuple):
    """Groups of readings: of each reading its group, counted from 0, reference and row there, in this order."""

    group: IntArray
    which: IntArray
    row: IntArray

    @property
    def n_groups(self) -> int:
        """Number of groups."""
        return int(self.group[-1]) + 1

    def members(self) -> list[Members]:
        """The members of every group."""
        found: list[Members] = []
        for start, stop in pairwise(np.searchsorted(self.group, np.arange(self.n_groups + 1)).tolist()):
            which, row = self.which[start:stop], self.row[start:stop]
            parts = np.split(row, np.flatnonzero(np.diff(which)) + 1)
            found.append(list(zip(which[np.r_[True, np.diff(which) > 0]].tolist(), parts, strict=True)))
        return found

    def of(self, which: int) -> tuple[IntArray, IntArray, IntArray]:
        """Rows (m,) of a reference, their groups, and their places in these."""
        mine = self.which == which
        group = self.group[mine]
        first = np.searchsorted(group, np.arange(self.n_groups))
        return self.row[mine], group, np.arange(len(group)) - first[group]

    def largest(self, which: int) -> int:
        """Largest number of readings of a reference in a group."""
        return int(np.bincount(self.group[self.which == which], minlength=1).max())


def group_batches(references: Sequence[ReferenceFit], group: IntArray, chunk: int) -> Iterator[GroupBatch]:
    """Groups, several small ones of about one size at once, so that one pass of the chain evaluates many readings.

    As many places as the largest group has are within `chunk` for all groups of a batch, unless it is one group.
    """
    key = np.concatenate([group[reference.rows] for reference in references])
    which = np.concatenate([np.full(len(reference.rows), i) for i, reference in enumerate(references)])
    row = np.concatenate([np.arange(len(reference.rows)) for reference in references])
    key = np.unique(key, return_inverse=True)[1]
    order = np.lexsort((row, which, key, np.bincount(key)[key]))
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    stops = np.r_[starts[1:], len(order)]
    sizes = stops - starts
    first = 0
    while first < len(starts):
        places = np.arange(1, len(sizes[first : first + chunk]) + 1) * sizes[first : first + chunk]  # sizes rise
        after = first + max(int(np.searchsorted(places, chunk, side="right")), 1)
        some = order[starts[first] : stops[after - 1]]
        yield GroupBatch(np.cumsum(np.diff(key[some], prepend=key[some[0]]) != 0), which[some], row[some])
        first = after


@dataclass(frozen=True, eq=False)
class _Whitened:
    """A reference at the minimum, whitened; rows of matrices are its residuals, reading by reading.

    Attributes
    ----------
    reference_fit : ReferenceFit
    weights, residuals : (m, k) array
    linear : LinearisedResiduals
    by_unknown : (m k, u) sparse array
        Derivatives by the eliminated unknowns of all references.
    spread : (m k, u + s) sparse array
        The root of their part of S, for the unknowns given the coefficients; the last s columns for shared unknowns.
    columns : (n_artefacts, a) int array
        The columns of each artefact.
    count : (n_artefacts,) int array
        Number of readings of each.
    is_linked : (n_artefacts,) bool array
        Whether constraints also determine it.
    is_judged : (m,) bool array
        Readings with a point, and those in seats without a point, so that no reading is compared twice.
    """

    reference_fit: ReferenceFit
    weights: FloatArray
    residuals: FloatArray
    linear: LinearisedResiduals
    by_unknown: csr_array
    spread: csr_array
    columns: IntArray
    count: IntArray
    is_linked: BoolArray
    is_judged: BoolArray


class _Piece(NamedTuple):
    """Readings `rows` of a reference, and the coefficients' part of the root of S of them, (m k, p)."""

    which: int
    rows: IntArray
    spread: FloatArray


class _Group(NamedTuple):
    """A group's residuals (n,), and the unknowns' part of the root of S of them, (n, t).

    `own` (n, q), orthonormal, are the motions of the seats that only this group touched; `n_touches` are its
    readings of each anchor, surface and line, by the number of the reference.
    """

    residuals: FloatArray
    spread: FloatArray
    own: csr_array | None
    n_touches: dict[int, IntArray]


@dataclass(frozen=True, eq=False)
class _Minimum:
    """The linearisation at the minimum.

    With the root F of the coefficients' covariance, ``F^T F``; unknowns move by minus `slope` (u, p) times them.
    `of_slope` (r, u) is ``F @ slope^T``. Where readings are few, `spreads` are the coefficients' parts of the root of S
    of all readings, for the references that were asked for.
    """

    problem: SmallMotionProblem
    x: FloatArray
    root: CovarianceRoot
    slope: FloatArray
    of_slope: FloatArray
    parts: list[_Whitened]
    spreads: dict[int, FloatArray] = field(default_factory=dict)

    @property
    def chunk(self) -> int:
        """Number of readings whose derivatives are in memory at once."""
        return min(MOST_READINGS, max(1, int(MOST_DERIVATIVES // (3 * max(self.slope.shape[1], 1)))))

    @classmethod
    def of(
        cls, fit: IdentificationResult, state: ArmState, references: Sequence[Reference], kinds: Sequence[str]
    ) -> _Minimum:
        problem, _ = initial_problem(fit.perturbed_chain, state, references)
        x, weights = fit.parameters, [_positive_weights(part) for part in fit.references]
        p, u = len(fit.coefficients), len(x) - len(fit.coefficients)
        slope, root_of_eliminated, of_shared = np.zeros((0, p)), csr_array((0, 0)), np.zeros((0, 0))
        place, is_linked = np.zeros(u, dtype=np.intp), np.zeros(u, dtype=bool)
        if u:
            parts, whole = problem.equations(x, weights)
            reduced = eliminate_unknowns(parts, whole, x)
            # Shared unknowns are eliminated like the others, one level up.
            matrix = reduced.gram[p:, p:] + UNKNOWN_STD**-2.0 * np.eye(len(reduced.kept) - p)
            half = np.linalg.inv(np.linalg.cholesky(matrix))
            slope = reduced.slope[:, :p] - reduced.slope[:, p:] @ (half.T @ (half @ reduced.gram[p:, :p]))
            root_of_eliminated, of_shared = reduced.root, reduced.slope[:, p:] @ half.T
            place[reduced.eliminated - p] = np.arange(len(reduced.eliminated))
            is_linked = problem.constraints(x).blocks.diagonal() > 0
        found, linearised = [], problem.linearised(x, [part.residuals for part in fit.references])
        for i, (part, weight, linear) in enumerate(zip(fit.references, weights, linearised, strict=True)):
            own = problem.unknowns_of(i).start - p + linear.unknown
            residuals = part.residuals if part.to_minimum is None else part.residuals + part.to_minimum
            weighed = linear._replace(residuals=residuals).weighted(weight)
            by_unknown = _by_unknown(weighed, place[own], len(slope))
            first = np.unique(part.artefact, return_index=True)[1]
            found.append(
                _Whitened(
                    part,
                    weight.T,
                    weighed.residuals.T,
                    weighed,
                    by_unknown,
                    csr_array(
                        hstack([by_unknown @ root_of_eliminated.T, csr_array(by_unknown @ of_shared)], format="csr")
                    ),
                    place[own[:, first]].T,
                    np.bincount(part.artefact),
                    is_linked[own[:, first]].any(axis=0),
                    _is_judged(part, fit.references, kinds),
                )
            )
        root = fit.covariance_root
        return cls(problem, x, root, slope, root.times_matrix(slope.T), found)

    @property
    def is_long(self) -> bool:
        """Whether there are too many residuals to keep the root of S of all."""
        return sum(part.residuals.size for part in self.parts) > MOST_SPREAD * self.root.n_rows

    def judging(self, region: BoolArray, most: int) -> _Minimum:
        """The same, where of the readings of a region (n,) no more than `most` are judged, evenly selected."""
        judged = np.concatenate([part.reference_fit.rows[part.is_judged] for part in self.parts])
        rows = np.unique(judged[region[judged]])
        chosen = np.isin(np.arange(len(region)), select_evenly(rows, min(most, len(rows))))
        parts = [replace(part, is_judged=part.is_judged & chosen[part.reference_fit.rows]) for part in self.parts]
        return replace(self, parts=parts)

    def without(self, batch: GroupBatch, group: IntArray) -> Iterator[HeldOutReadings]:
        """The deviations of every group of a batch."""
        # A group by itself, such as a region, is large.
        is_small = batch.n_groups > 1 and len(batch.row) <= self.chunk
        if is_small and not any(part.linear.unknown.size for part in self.parts):
            yield from self._without_stacked(batch, group)
            return
        judged = [
            members for members in batch.members() if any(self.parts[i].is_judged[rows].any() for i, rows in members)
        ]
        if batch.n_groups == 1 and judged:
            if (found := self._without_data(judged[0], group)) is not None:
                yield from found
                return
            yield from self._without(self._group(judged[0]), partial(self._pieces, judged[0]), group)
            return
        spread: dict[int, list[FloatArray]] = {}
        for i in {i for members in judged for i, _ in members}:
            rows = [rows for members in judged for j, rows in members if j == i]
            stops = self.parts[i].weights.shape[1] * np.cumsum([len(some) for some in rows])
            spread[i] = np.split(self._spread(i, np.concatenate(rows)), stops[:-1])
        for members in judged:
            pieces = [_Piece(i, rows, spread[i].pop(0)) for i, rows in members]
            yield from self._without(self._group(members), lambda pieces=pieces: iter(pieces), group)  # type: ignore[misc]

    def without_each(self, group: IntArray) -> Iterator[HeldOutReadings]:
        """The deviations of the readings of the only reference, which has no unknowns, each a group of its own."""
        (part,) = self.parts
        judged = np.flatnonzero(part.is_judged)
        for rows in (judged[piece] for piece in perturbed_chain.chunks(len(judged), MOST_JUDGED)):
            angles = self.problem.state.rows(part.reference_fit.rows[rows]).joint_angles
            S = self.root.covariances(*self.problem.site_derivatives(0, rows, part.linear, self.x), angles)
            inverse = np.linalg.inv(np.eye(S.shape[1]) - S)
            free = np.linalg.norm(inverse, axis=(1, 2)) <= 1 / LEAST_FREEDOM
            white = np.matmul(inverse[free], part.residuals[rows[free], :, None])[:, :, 0]
            yield _held_out(part, rows[free], white, S[free] @ inverse[free], np.ones(len(white)), group)
            for row in rows[~free, None]:
                yield from self._without(self._group([(0, row)]), partial(self._pieces, [(0, row)]), group)

    def _without_data(self, members: Members, group: IntArray) -> list[HeldOutReadings] | None:
        """The deviations of a large group, by the arm's normal equations less those of the group.

        None for a group with unknowns, of fewer residuals than coefficients, or where rounding spoils it.
        """
        n_residuals = sum(self.parts[i].residuals[rows].size for i, rows in members)
        has_unknowns = any(self.parts[i].linear.unknown.size for i, _ in members)
        if has_unknowns or not 0 < self.root.n_rows < n_residuals:
            return None
        own = self.problem.sums_of(members, [part.linear for part in self.parts], self.x)
        known = np.isin(own.order, self.root.order)
        without = self.root.without(own.gram if known.all() else own.gram[np.ix_(known, known)])
        if without is None:
            return None
        shift = without.shift(own.gradient[known], LEAST_FREEDOM)
        found = []
        for i, rows in members:
            part = self.parts[i]
            judged = rows[part.is_judged[rows]]
            for some in (judged[piece] for piece in perturbed_chain.chunks(len(judged), MOST_READINGS)):
                factors = self.problem.site_derivatives(i, some, part.linear, self.x)
                white = part.residuals[some] + self.problem.perturbed_chain.along(shift, *factors).T
                blocks = without.covariances(self.problem.perturbed_chain.by_coefficient(*factors))
                found.append(_held_out(part, some, white, blocks, np.ones(len(some)), group))
        return found

    def _pieces(self, members: Members) -> Iterator[_Piece]:
        for i, rows in members:
            for start in range(0, len(rows), self.chunk):
                some = rows[start : start + self.chunk]
                yield _Piece(i, some, self._spread(i, some))

    def _spread(self, which: int, rows: IntArray) -> FloatArray:
        """(m k, r) the coefficients' part of the root of S, of some readings of a reference."""
        part, every = self.parts[which], np.arange(len(self.parts[which].residuals))
        if not self.is_long and len(rows) < len(every):  # groups and regions ask for each again
            if which not in self.spreads:
                self.spreads[which] = self._spread(which, every)
            return self.spreads[which][_residuals_of(rows, part)]
        by_root = self.root.times(*self.problem.site_derivatives(which, rows, part.linear, self.x))
        spread = by_root.transpose(2, 1, 0).reshape(by_root.shape[1] * by_root.shape[2], len(by_root))
        if part.linear.unknown.size:
            spread = spread - part.by_unknown[_residuals_of(rows, part)] @ self.of_slope.T
        return spread

    def _without_stacked(self, batch: GroupBatch, group: IntArray) -> Iterator[HeldOutReadings]:
        """The deviations of small groups of readings without unknowns, all groups at once.

        With S = A A^T, ``(I - S)^-1 = I + A (I - A^T A)^-1 A^T``: of the two matrices the smaller is inverted.
        """
        stacks: list[tuple[int, IntArray, IntArray, IntArray]] = []
        n_places = 0
        for i in np.unique(batch.which).tolist():
            k, (rows, groups, place) = self.parts[i].weights.shape[1], batch.of(i)
            stacks.append((i, rows, groups[:, None], n_places + k * place[:, None] + np.arange(k)))
            n_places += k * batch.largest(i)
        # It pays where products take the time; of few groups rounding will be too much.
        long = stacks if self.is_long else []
        factors = {i: self.problem.site_derivatives(i, rows, self.parts[i].linear, self.x) for i, rows, *_ in long}
        size = max([0.0, *(float(self.root.alone(*both).max()) for both in factors.values())])
        rounding = SINGLE_ROUNDING * np.sqrt(size / max(self.root.n_rows, 1))
        single = self.is_long and bool(self.root.wide) and rounding * n_places <= MOST_ROUNDED
        shape = batch.n_groups, n_places
        A, r = np.zeros((*shape, self.root.n_rows), np.float32 if single else float), np.zeros(shape)
        for i, rows, groups, at in stacks:  # what a group lacks is zero
            if factors:
                root = self.root.times(*(of.astype(A.dtype, copy=False) for of in factors[i])).transpose(2, 1, 0)
            else:
                root = self._spread(i, rows).reshape(*at.shape, -1)
            A[groups, at] = root
            r[groups, at] = self.parts[i].residuals[rows]
        At, is_dual = A.transpose(0, 2, 1), A.shape[1] <= A.shape[2]
        S = (A @ At if is_dual else At @ A).astype(float, copy=False)
        inverse = np.linalg.inv(np.eye(S.shape[1]) - S)
        along = np.matmul(inverse, r[:, :, None] if is_dual else At @ r[:, :, None])
        white = along[:, :, 0] if is_dual else r + (A @ along)[:, :, 0]
        # Its largest eigenvalue is below this norm; else some direction needs a bound.
        norm = np.linalg.norm(inverse, axis=(1, 2))
        is_free = norm <= 1 / LEAST_FREEDOM
        if single:
            is_free &= rounding * norm * np.linalg.norm(white, axis=1) <= MOST_ROUNDED
        left, right = (S, inverse) if is_dual else (A @ inverse, A)
        for i, rows, groups, at in stacks:
            free = is_free[groups[:, 0]]
            if self.parts[i].is_judged[rows].any() and free.any():
                of = groups[free], at[free]
                blocks = left[of] @ right[of].transpose(0, 2, 1)
                yield _held_out(self.parts[i], rows[free], white[of], blocks, np.ones(int(free.sum())), group)
        if not is_free.all():
            for members in compress(batch.members(), ~is_free):
                yield from self._without(self._group(members), partial(self._pieces, members), group)

    def _group(self, members: Members) -> _Group:
        residuals = np.concatenate([self.parts[i].residuals[rows].ravel() for i, rows in members])
        n = len(residuals)
        if not any(self.parts[i].linear.unknown.size for i, _ in members):
            return _Group(residuals, np.zeros((n, 0)), None, {})
        spread = csr_array(
            vstack([self.parts[i].spread[_residuals_of(rows, self.parts[i])] for i, rows in members], format="csr")
        )
        touched = np.zeros(spread.shape[1], dtype=bool)
        touched[spread.indices] = True
        apart = np.zeros(len(touched), dtype=bool)
        where, column, values = [], [], []
        start = n_own = 0
        for i, rows in members:
            part = self.parts[i]
            k = part.weights.shape[1]
            if part.linear.unknown.size:
                artefact = part.reference_fit.artefact[rows]
                whole = np.bincount(artefact, minlength=len(part.count)) == part.count
                # Only this group determines these unknowns: they absorb their part of the residuals.
                apart[part.columns[whole & ~part.is_linked]] = True
                if part.reference_fit.kind == "seat":
                    inside = np.flatnonzero(whole[artefact])
                    length = np.sqrt(
                        [np.bincount(artefact, w, minlength=len(whole)) for w in part.weights[rows].T ** 2]
                    )
                    values.append((part.weights[rows[inside]] / length[:, artefact[inside]].T).ravel())
                    where.append((start + k * inside[:, None] + np.arange(k)).ravel())
                    seat = np.cumsum(whole)[artefact[inside]] - 1
                    column.append((n_own + k * seat[:, None] + np.arange(k)).ravel())
                    n_own += k * int(whole.sum())
            start += k * len(rows)
        taken_up = spread[:, np.flatnonzero(apart & touched)]
        residuals = residuals - taken_up @ (taken_up.T @ residuals)
        own = None
        if n_own:
            entries = np.concatenate(values), (np.concatenate(where), np.concatenate(column))
            own = csr_array(entries, shape=(n, n_own))
        n_touches = {
            i: np.bincount(self.parts[i].reference_fit.artefact[rows], minlength=len(self.parts[i].count))
            for i, rows in members
            if self.parts[i].reference_fit.kind in LEAST_TOUCHES
        }
        return _Group(residuals, spread[:, np.flatnonzero(touched & ~apart)].toarray(), own, n_touches)

    def _without(
        self, of: _Group, pieces: Callable[[], Iterator[_Piece]], group: IntArray
    ) -> Iterator[HeldOutReadings]:
        """The deviations of a group."""
        r, own = of.residuals, of.own
        n, dimension = len(r), self.root.n_rows + of.spread.shape[1]
        # With S = A A^T: (I - S)^-1 = I + A (I - A^T A)^-1 A^T, of which one matrix is small.
        dual = n <= dimension
        if dual:
            few = list(pieces())
            pieces = partial(iter, few)
            A = few[0].spread if len(few) == 1 else np.concatenate([piece.spread for piece in few])
            A = np.hstack([A, of.spread]) if of.spread.size else A  # of a large group every copy counts
            S = A @ A.T
            if own is None and not of.n_touches and (lower := _root_of_rest(S)) is not None:

                def remaining_of(right: FloatArray) -> FloatArray:
                    return np.asarray(dpotrs(lower, right, lower=1)[0])

                white = remaining_of(r) - too_large(remaining_of, S @ r, 1 / LEAST_FREEDOM)
                inverse = dpotri(lower, lower=1)[0]  # below the diagonal
                for piece, at in _placed(iter(few)):
                    part, m = self.parts[piece.which], len(piece.rows)
                    of_reading = np.arange(at.start, at.stop).reshape(m, -1)
                    row, column = of_reading[:, :, None], of_reading[:, None]
                    blocks = inverse[np.maximum(row, column), np.minimum(row, column)] - np.eye(of_reading.shape[1])
                    yield _held_out(part, piece.rows, white[of_reading], blocks, np.ones(m), group)
                return
            shares, vectors = np.linalg.eigh(S)
            determined = vectors * np.sqrt(np.maximum(shares, 0))
            along, mean = determined.T @ r, np.zeros((0, n)) if own is None else own.T @ determined
        else:
            gram, along = np.zeros((dimension, dimension)), np.zeros(dimension)
            mean = np.zeros((0 if own is None else own.shape[1], dimension))
            for piece, at in _placed(pieces()):
                A = np.hstack([piece.spread, of.spread[at]])
                gram += A.T @ A
                along += A.T @ r[at]
                if own is not None:
                    mean += own[at].T @ A
            shares, vectors = eigh(gram.T, overwrite_a=True, check_finite=False)  # of columns: no copy is made
            along, mean = vectors.T @ along, mean @ vectors
        along = along / np.maximum(1 - shares, LEAST_FREEDOM)
        remaining = np.sqrt(np.maximum(1 - shares, ROUNDING))
        half_mean = mean / remaining
        for piece, at in _placed(pieces()):
            part = self.parts[piece.which]
            if not part.is_judged[piece.rows].any():
                continue
            predicted = determined[at] if dual else np.hstack([piece.spread, of.spread[at]]) @ vectors
            white, half, freedom = r[at] + predicted @ along, predicted / remaining, np.ones(len(piece.rows))
            if own is not None:
                unit = own[at]
                white -= unit @ (own.T @ r + mean @ along)
                half -= unit @ half_mean
                freedom -= (unit.multiply(unit)).sum(axis=1).reshape(len(freedom), -1).mean(axis=1)
            if (held := of.n_touches.get(piece.which)) is not None:
                # Other groups must locate the anchor, the surface or the line.
                least = LEAST_TOUCHES[part.reference_fit.kind]
                freedom[(part.count - held)[part.reference_fit.artefact[piece.rows]] < least] = 0.0
            half = half.reshape(len(piece.rows), part.weights.shape[1], -1)
            blocks = half @ half.transpose(0, 2, 1)
            yield _held_out(part, piece.rows, white.reshape(len(piece.rows), -1), blocks, freedom, group)


# Of the fits that are at work: the matrices of some are tens of megabytes.
_MINIMA: WeakKeyDictionary[IdentificationResult, tuple[tuple[object, ...], _Minimum]] = WeakKeyDictionary()


def _root_of_rest(S: FloatArray) -> FloatArray | None:
    """Cholesky's triangle of ``I - S``; None where an eigenvalue of it is rounding."""
    lower, info = dpotrf((np.eye(len(S)) - S).T, lower=1, overwrite_a=1)
    return None if info or (lower.diagonal() ** 2).min() < ROUNDING else np.asarray(lower)


def _positive_weights(part: ReferenceFit) -> FloatArray:
    """(k, m) weights of the residuals, also of excluded readings [1/mm]."""
    return replace(part, robust_weight=np.maximum(part.robust_weight, LEAST_WEIGHT)).weights


def _held_out(
    part: _Whitened, rows: IntArray, white: FloatArray, blocks: FloatArray, freedom: FloatArray, group: IntArray
) -> HeldOutReadings:
    """Whitened deviations (m, k) and their covariances (m, k, k), in mm; seats with one reading give no deviation."""
    shows = part.is_judged[rows] & (freedom > ROUNDING)
    # Of a pose the first three: displacements.
    rows, weights, k = rows[shows], part.weights[rows[shows], :3], min(part.weights.shape[1], 3)
    covariance = blocks[shows, :k, :k] / (weights[:, :, None] * weights[:, None, :])
    covariance += (part.reference_fit.std[:k, rows].T ** 2)[:, :, None] * np.eye(k)
    readings = part.reference_fit.rows[rows]
    return HeldOutReadings(readings, group[readings], white[shows, :k] / weights, covariance, freedom[shows])


def _is_judged(part: ReferenceFit, references: Sequence[ReferenceFit], kinds: Sequence[str]) -> BoolArray:
    if part.kind not in kinds:
        return np.zeros(len(part.rows), dtype=bool)
    if part.kind == "seat":
        pointed = [reference.rows for reference in references if reference.kind in ("point", "pose")]
        return ~np.isin(part.rows, np.concatenate([np.zeros(0, dtype=np.intp), *pointed]))
    return np.ones(len(part.rows), dtype=bool)


def _placed(pieces: Iterator[_Piece]) -> Iterator[tuple[_Piece, slice]]:
    """Pieces of a group, and the slices of its residuals."""
    start = 0
    for piece in pieces:
        yield piece, slice(start, start + len(piece.spread))
        start += len(piece.spread)


def _residuals_of(rows: IntArray, part: _Whitened) -> IntArray:
    """Rows of matrices (m k, ..) of readings."""
    k = part.weights.shape[1]
    return np.asarray((k * rows[:, None] + np.arange(k)).ravel())


def _by_unknown(linear: LinearisedResiduals, unknown: IntArray, n: int) -> csr_array:
    """(m k, n) derivatives by `unknown` (a, m) of n, reading by reading."""
    k, a, m = linear.by_unknown.shape
    residual = np.broadcast_to(np.arange(k)[:, None, None] + k * np.arange(m), (k, a, m))
    nonzero = linear.by_unknown != 0
    column = np.broadcast_to(unknown, (k, a, m))
    return csr_array((linear.by_unknown[nonzero], (residual[nonzero], column[nonzero])), shape=(m * k, n))


def birge_ratio(references: Sequence[ReferenceFit], rows: IntArray, residual_std: float) -> float:
    """Return the factor by which held-out readings increase the standard deviations of a posterior.

    The posterior was computed with the variance ``std^2 + noise^2`` of each residual, stated and estimated. Held-out
    readings have the variance ``std^2 + residual_std^2``. The squared factor is the mean ratio of the two.

    Parameters
    ----------
    references : sequence of ReferenceFit
        Of the identification.
    rows : (m,) int array
        Held-out readings, compared with points, or with seats where they have no point, or with what they have.
    residual_std : float
        Residual standard deviation of these [mm].

    Returns
    -------
    float
        1 or more.
    """
    ratios = []
    pointed = np.zeros(0, dtype=np.intp)
    for kind in chain.from_iterable(COMPARED):
        for reference in (reference for reference in references if reference.kind == kind):
            compared = np.isin(reference.rows, rows) & ~np.isin(reference.rows, pointed)
            if compared.any():
                stated = reference.std[:, compared].ravel() ** 2 + FLOOR_MM2
                ratios.append((stated + residual_std**2) / (stated + reference.noise_std**2))
            pointed = np.union1d(pointed, reference.rows)
    return max(1.0, float(np.sqrt(np.concatenate(ratios).mean()))) if ratios else 1.0
