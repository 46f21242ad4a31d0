"""A chain with small motions by terms, composed exactly, and the derivatives of its tips by their coefficients."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import accumulate, groupby, pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from truearm.arm.chain import Chain, Pose, PoseDerivatives
from truearm.identification.terms.basis import Basis, Constant, Harmonics, InSession, OfTip
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.readings.readings import PAYLOAD
from truearm.typing import BoolArray, FloatArray, IntArray

CHUNK = 1024  # readings of a chunk: their narrow Jacobian stays in the cache of a core
FEW = 64  # readings up to which the number of array operations counts, not their length
MOST_NARROW = 24  # functions of a site up to which they are cheaper as columns of a Jacobian than by themselves
POSE_CHUNK = 4096  # poses have no wide Jacobian: fewer calls are worth more


# By chunks of readings: which, tips, their derivatives along the sites, and values of the basis functions.
SiteDerivatives: TypeAlias = Iterator[tuple[slice, FloatArray, FloatArray, FloatArray]]


class HarmonicSeries(NamedTuple):
    """Cosine and sine of multiples of a joint's angle: the joint, counted from 1, and the distinct orders (n,)."""

    joint: int
    orders: IntArray


@dataclass(frozen=True, eq=False)
class Site:
    """A place and a direction, with all basis functions that move the arm there.

    Attributes
    ----------
    place : int
    direction : (6,) array
    columns : (n_functions,) int array
        Their coefficients among the parameters.
    rows : (n_functions,) int array or slice
        The functions among the values of `PerturbedChain.values`.
    series : HarmonicSeries, optional
        What the functions are, where they are many harmonics of a joint.
    """

    place: int
    direction: FloatArray
    columns: IntArray
    rows: IntArray | slice
    series: HarmonicSeries | None = None


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

    def __getstate__(self) -> dict[str, Any]:
        """The fields without what is prepared from them: functions cannot be pickled, nor sent to another process."""
        return {"chain": self.chain, "terms": self.terms}

    def in_frame(self, T_reference_base: FloatArray) -> PerturbedChain:
        """The same terms on the chain in another frame (`Chain.with_reference_frame`), and what is prepared of them."""
        new = PerturbedChain(self.chain.with_reference_frame(T_reference_base), self.terms)
        prepared = [name for name, value in vars(PerturbedChain).items() if isinstance(value, cached_property)]
        vars(new).update({name: getattr(self, name) for name in prepared})
        return new

    @cached_property
    def n_coefficients(self) -> int:
        """Number of coefficients of all terms."""
        return sum(term.n_coefficients for term in self.terms)

    @cached_property
    def columns(self) -> list[IntArray]:
        """Coefficients of each term."""
        starts = np.cumsum([0, *(term.n_coefficients for term in self.terms)])
        return [np.arange(first, stop) for first, stop in pairwise(starts)]

    @cached_property
    def _varying(self) -> IntArray:
        """Coefficients of the terms that are no constants."""
        return np.flatnonzero(~self.of_basis(Constant))

    def of_basis(self, *kinds: type[Basis]) -> BoolArray:
        """(n_coefficients,) which coefficients are of terms with a basis of these kinds."""
        are_meant = [isinstance(term.basis, kinds) for term in self.terms]
        return np.repeat(np.array(are_meant, bool), [term.n_coefficients for term in self.terms])

    def is_constant(self, x: FloatArray) -> bool:
        """Whether the motions with coefficients `x` are the same at every reading."""
        return not x[self._varying].any()

    @cached_property
    def sites(self) -> list[Site]:
        """Terms grouped by place and direction; series of harmonics of a joint are a site of their own."""
        harmonics: dict[tuple[int, tuple[float, ...], int], list[Harmonics]] = {}
        for term in self.terms:
            if isinstance(term.basis, Harmonics):
                harmonics.setdefault((term.place, term.direction, term.basis.joint), []).append(term.basis)
        series = {key: _dense_series(bases) for key, bases in harmonics.items()}
        grouped: dict[tuple[int, tuple[float, ...], int], list[tuple[Basis, IntArray]]] = {}
        for term, columns in zip(self.terms, self.columns, strict=True):
            joint = term.basis.joint if isinstance(term.basis, Harmonics) else 0
            key, own = (term.place, term.direction, joint), (term.place, term.direction, 0)
            if term.basis in (left := series.get(key, [])):
                left.remove(term.basis)  # of two terms of the same functions only one is of the series
                own = key
            grouped.setdefault(own, []).append((term.basis, columns))
        sites = []
        for (place, direction, joint), members in grouped.items():
            columns = np.concatenate([columns for _, columns in members])
            rows = _joined([self._functions[place, basis] for basis, _ in members])
            orders = [order for basis, _ in members for order in getattr(basis, "orders", ())]
            own_series = HarmonicSeries(joint, np.array(orders, dtype=np.intp)) if joint else None
            sites.append(Site(place, np.array(direction), columns, rows, own_series))
        return sites

    def values(self, state: ArmState) -> FloatArray:
        """(n_functions, m) values of the distinct basis functions of every place, place by place."""
        if len(state) <= FEW:
            evaluators, rows = self._evaluators
            if len(rows):
                return np.concatenate([evaluate(state) for evaluate in evaluators])[rows]
        out = np.empty((self._of_place[-1].stop, len(state)))
        for basis, ((first, places), *others) in self._evaluated:
            if isinstance(basis, Harmonics) and first.stop - first.start == basis.n_functions:  # all, in this order
                found = basis.values(state, out[first])
            else:
                found = basis.values(state)
                out[first] = found[places]
            for into, places in others:
                out[into] = found[places]
        return out

    def by_site(self, values: FloatArray) -> list[FloatArray]:
        """Values of the basis functions of every site, (n_functions, m) each."""
        return [values[site.rows] for site in self.sites]

    def motions(self, x: FloatArray, values: FloatArray) -> FloatArray:
        """(n_places, 6, m) motions [rad, mm] with coefficients `x`; (n_places, 6, 1) if they are constant."""
        by_function = self._by_function(x, len(values))
        m = 1 if self.is_constant(x) else values.shape[1]
        out = np.zeros((self.chain.n_places, 6, m))
        for place, rows, axes in self._runs:
            out[place, axes] += by_function[rows, axes].T @ values[rows, :m]
        return out

    def motion_slopes(self, x: FloatArray, values: FloatArray) -> list[tuple[int, int, FloatArray]]:
        """Derivatives of motions by joint angles: place, joint counted from 0, and (6, m) [per rad]; none is zero.

        Those of gravity torques are neglected, see `Basis.joint_slope`.
        """
        by_function = self._by_function(x, len(values))
        slopes: dict[tuple[int, int], FloatArray] = {}
        for (place, basis), rows in self._functions.items():
            if (slope := basis.joint_slope(by_function[rows])) is not None:
                joint, weights = slope
                own = self._of_place[place]
                whole = slopes.setdefault((place, joint - 1), np.zeros((own.stop - own.start, 6)))
                whole[rows.start - own.start : rows.stop - own.start] = weights
        return [(place, joint, w.T @ values[self._of_place[place]]) for (place, joint), w in slopes.items()]

    def poses(self, state: ArmState, x: FloatArray) -> Pose:
        """Tip poses at the readings of a state, in the frame of the chain."""
        R, tip = np.empty((len(state), 3, 3)), np.empty((len(state), 3))
        for rows in chunks(len(state), POSE_CHUNK):
            piece = state.rows(rows)
            motions = self.motions(x, self.values(piece))
            wide = np.broadcast_to(motions, (*motions.shape[:2], len(piece)))
            R[rows], tip[rows] = self.chain.pose(piece.angles, wide.transpose(2, 0, 1))
        return Pose(R, tip)

    def pose_jacobians(self, state: ArmState, x: FloatArray) -> tuple[Pose, FloatArray]:
        """Tip poses and their derivatives by the joints, (n, 6, n_joints).

        Translation of the tip [mm], then rotation of the flange [rad], per rad or mm of the joint. The slopes of
        harmonics are included, those of gravity torques are neglected.
        """

        def derivatives(rows: slice) -> PoseDerivatives:
            piece = state.rows(rows)
            values = self.values(piece)
            here = self.chain.pose_derivatives(piece.angles, self.motions(x, values))
            for place, joint, slope in self.motion_slopes(x, values):
                here.by_joint[joint] += np.einsum("com,cm->om", here.by_motion[place], slope)
            return here

        return self.chain.pose_jacobians(state.angles, derivatives)

    def pose_by_coefficients(self, state: ArmState, x: FloatArray) -> tuple[Pose, FloatArray]:
        """Tip poses and their derivatives by the coefficients (n, 6, n_coefficients), as `pose_jacobians` has them."""
        R, tip = np.empty((len(state), 3, 3)), np.empty((len(state), 3))
        by = np.empty((len(state), 6, self.n_coefficients))
        for rows in chunks(len(state)):
            piece = state.rows(rows)
            values = self.values(piece)
            here = self.chain.pose_derivatives(piece.angles, self.motions(x, values))
            R[rows], tip[rows] = here.R_base_tip.transpose(2, 0, 1), here.tip_in_base.T
            by[rows] = self.by_coefficient(self.along_sites(here.by_motion), values).transpose(2, 1, 0)
        return Pose(R, tip), by

    def constants_of(self, session: str, tip: str) -> BoolArray:
        """(n_coefficients,) which coefficients are the same at all readings of a session with a tip."""
        return np.repeat(
            [isinstance(term.basis, Constant) or term.basis in (InSession(session), OfTip(tip)) for term in self.terms],
            [term.n_coefficients for term in self.terms],
        )

    def constant_motions(self, x: FloatArray, which: BoolArray | None = None) -> FloatArray:
        """(n_places, 6) motions [rad, mm] by the constant terms, or by those of `constants_of`, without the others."""
        which = self.of_basis(Constant) if which is None else which
        motions = np.zeros((self.chain.n_places, 6))
        for term, columns in zip(self.terms, self.columns, strict=True):
            if which[columns[0]]:
                motions[term.place] += x[columns[0]] * np.array(term.direction)
        return motions

    def with_constants(self, x: FloatArray, which: BoolArray | None = None) -> Chain:
        """The chain with the constant terms composed, or those of `constants_of`, without the others."""
        return self.chain.with_motions(self.constant_motions(x, which))

    def tips(self, state: ArmState, x: FloatArray) -> FloatArray:
        """(n, 3) tips [mm] at the readings of a state."""
        if self.is_constant(x):
            return self.with_constants(x).tip_in_base(state.angles)
        out = np.empty((len(state), 3))
        for rows in chunks(len(state)):
            piece = state.rows(rows)
            out[rows] = self.tips_from_values(piece.angles, self.values(piece), x)
        return out

    def tips_from_values(self, angles: FloatArray, values: FloatArray, x: FloatArray) -> FloatArray:
        """(n, 3) tips [mm] at angles (n, n_joints), with values of the basis functions at the same readings."""
        motions = self.motions(x, values)
        if self.is_constant(x):
            return _moved(self.chain, motions[:, :, 0].tobytes()).tip_in_base(angles)
        return self.chain.tip_in_base(angles, motions.transpose(2, 0, 1))

    def derivatives(self, state: ArmState, x: FloatArray) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Yield tips (3, m) [mm] and their derivatives (n_coefficients, 3, m) by chunks of readings."""
        for rows, tips, along_sites, values in self.site_derivatives(state, x):
            yield rows, tips, self.by_coefficient(along_sites, values)

    def site_derivatives(self, state: ArmState, x: FloatArray) -> SiteDerivatives:
        """Yield the factors of the derivatives by chunks of readings.

        They are tips (3, m) [mm], their derivatives (n_sites, 3, m) along the sites, and the values (n_functions, m) of
        the basis functions.
        """
        for rows in chunks(len(state)):
            piece = state.rows(rows)
            values = self.values(piece)
            tips, motion_jacobian = moved_chain(self.chain, piece, self.motions(x, values))
            yield rows, tips, self.along_sites(motion_jacobian), values

    def along_sites(self, by_motion: FloatArray) -> FloatArray:
        """Derivatives (n_sites, k, m) along the sites, from those (n_places, 6, k, m) by the motions of the places."""
        if by_motion.shape[3] <= FEW:
            directions, places = self.of_site
            return np.asarray(np.einsum("sd,sdcm->scm", directions, by_motion[places]))
        out = np.empty((len(self.sites), *by_motion.shape[2:]))
        for own, (place, (first, *others)) in zip(out, self._axes, strict=True):
            # Nearly all directions are an axis: a sum of six components takes ten times as long.
            np.multiply(by_motion[place, first[0]], first[1], out=own)
            for axis, component in others:
                own += by_motion[place, axis] * component
        return out

    def by_coefficient(self, along_sites: FloatArray, values: FloatArray) -> FloatArray:
        """Derivatives (n_coefficients, k, m) from those along the sites and the values of the basis functions."""
        if values.shape[1] <= FEW:
            site_of, row_of = self.of_coefficient
            return np.asarray(along_sites[site_of] * values[row_of][:, None, :])
        out = np.empty((self.n_coefficients, *along_sites.shape[1:]), along_sites.dtype)
        for along, site, value in zip(along_sites, self.sites, self.by_site(values), strict=True):
            out[site.columns] = along * value[:, None, :]
        return out

    def along(self, x: FloatArray, along_sites: FloatArray, values: FloatArray) -> FloatArray:
        """(k, m) derivatives along a change `x` of the coefficients, from those along the sites and the values."""
        shares = np.stack([x[site.columns] @ own for site, own in zip(self.sites, self.by_site(values), strict=True)])
        return np.asarray(np.einsum("skm,sm->km", along_sites, shares))

    def direction_effects(self, state: ArmState, x: FloatArray, along_sites: FloatArray) -> FloatArray:
        """Effects of unknown directions of movement (those that are 0) on the tips, from the derivatives along sites.

        Returns
        -------
        (n_joints, m, 3) array
            By joint the tip with direction 1 less the mean over 1 and -1 [mm]: the error to first order is of third
            order in the motions. Both directions are equally likely, so this is also the standard deviation.
        """
        out = np.zeros((self.chain.n_joints, len(state), 3))
        bases, coefficients, functions = self._directed
        if state.directions is None or not bases:
            return out
        unknown = np.argwhere(state.directions == 0)
        for part in chunks(len(unknown)):  # all joints at once: few readings cost by the number of array operations
            rows, joints = unknown[part].T
            at, n = state.rows(np.concatenate([rows, rows])), len(rows)
            directions = np.array(at.directions)
            directions[np.arange(n), joints], directions[np.arange(n, 2 * n), joints] = 1.0, -1.0
            either = replace(at, directions=directions)
            values = np.concatenate([basis.values(either) for basis in bases])
            moved = x[coefficients, None] * ((values[:, :n] - values[:, n:]) / 2)[functions]
            along = along_sites[self.of_coefficient[0][coefficients]]
            out[joints, rows] = np.einsum("pu,pku->uk", moved, along[:, :, rows])
        return out

    def gradient(self, state: ArmState, x: FloatArray, pulls: FloatArray) -> FloatArray:
        """(n_coefficients,) derivatives of the tips along vectors (3, n), summed over the readings of a state."""
        found = np.zeros(self.n_coefficients)
        for rows in chunks(len(state)):
            piece = state.rows(rows)
            found += self.gradient_from_values(piece, self.values(piece), x, pulls[:, rows])
        return found

    def gradient_from_values(self, state: ArmState, values: FloatArray, x: FloatArray, pulls: FloatArray) -> FloatArray:
        """The same with the values of the basis functions: derivatives by the motions, pulled before the functions."""
        _, motion_jacobian = moved_chain(self.chain, state, self.motions(x, values))
        by_motion = np.einsum("pacm,cm->pam", motion_jacobian, pulls)
        by_function = np.zeros((len(values), 6))
        for place, rows, axes in self._runs:
            by_function[rows, axes] = values[rows] @ by_motion[place, axes].T
        coefficient, entry, component = self._entries
        sums = np.bincount(coefficient, component * by_function.ravel()[entry], minlength=self.n_coefficients)
        return np.asarray(sums, dtype=float)

    def motion_derivatives(self, state: ArmState, x: FloatArray, place: int) -> FloatArray:
        """(n, 6, 3) derivatives of the tips [mm] by the components of a motion at a place."""
        out = np.empty((len(state), 6, 3))
        for rows in chunks(len(state)):
            piece = state.rows(rows)
            _, motion_jacobian = moved_chain(self.chain, piece, self.motions(x, self.values(piece)))
            out[rows] = motion_jacobian[place].transpose(2, 0, 1)
        return out

    def _by_function(self, x: FloatArray, n_values: int) -> FloatArray:
        """(n_values, 6) components of the motions by each basis function."""
        coefficient, entry, component = self._entries
        sums: FloatArray = np.bincount(entry, component * x[coefficient], minlength=6 * n_values).astype(float)
        return sums.reshape(-1, 6)

    @cached_property
    def _functions(self) -> dict[tuple[int, Basis], slice]:
        """Rows of each basis at each place among the values; those of one place are adjacent."""
        distinct = sorted(dict.fromkeys((term.place, term.basis) for term in self.terms), key=lambda both: both[0])
        starts = accumulate((basis.n_functions for _, basis in distinct), initial=0)
        return {both: slice(first, stop) for both, (first, stop) in zip(distinct, pairwise(starts), strict=True)}

    @cached_property
    def _evaluators(self) -> tuple[list[Callable[[ArmState], FloatArray]], IntArray]:
        """The distinct bases by kind, see `Basis.together`, and the row of each value among theirs."""
        kinds: dict[type[Basis], list[Basis]] = {}
        for basis in dict.fromkeys(basis for _, basis in self._functions):
            kinds.setdefault(type(basis), []).append(basis)
        order = [basis for bases in kinds.values() for basis in bases]
        starts = np.cumsum([0, *(basis.n_functions for basis in order)])
        rows = {basis: np.arange(first, stop) for basis, (first, stop) in zip(order, pairwise(starts), strict=True)}
        of_values = [rows[basis] for _, basis in self._functions]
        return [kind.together(bases) for kind, bases in kinds.items()], np.concatenate(
            [np.zeros(0, dtype=np.intp), *of_values]
        )

    @cached_property
    def of_site(self) -> tuple[FloatArray, IntArray]:
        """Directions (n_sites, 6) and places (n_sites,) of the sites."""
        directions = np.array([site.direction for site in self.sites]).reshape(-1, 6)
        return directions, np.array([site.place for site in self.sites], dtype=np.intp)

    @cached_property
    def _axes(self) -> list[tuple[int, list[tuple[int, float]]]]:
        """Of each site its place, and the components of its direction that are not zero."""
        return [
            (site.place, [(axis, component) for axis, component in enumerate(site.direction.tolist()) if component])
            for site in self.sites
        ]

    @cached_property
    def of_coefficient(self) -> tuple[IntArray, IntArray]:
        """(n_coefficients,) site of each coefficient, counted as `sites`, and its row among the values."""
        site_of, row_of = np.empty((2, self.n_coefficients), dtype=np.intp)
        for number, site in enumerate(self.sites):
            site_of[site.columns], row_of[site.columns] = number, np.arange(self._of_place[-1].stop)[site.rows]
        return site_of, row_of

    def input_bases(self, state: ArmState) -> tuple[Basis, ...]:
        """The distinct bases that depend on more than what every reading states: joint angles, and its session.

        With known masses and a payload in the state, gravity torques are among them.
        """
        if state.links is None or PAYLOAD not in state.columns:
            return self._input_bases
        by_gravity = (basis for _, basis in self._functions if "gravity torque" in (basis.inputs or ()))
        return tuple(dict.fromkeys((*self._input_bases, *by_gravity)))

    @cached_property
    def _input_bases(self) -> tuple[Basis, ...]:
        bases = dict.fromkeys(basis for _, basis in self._functions)
        return tuple(basis for basis in bases if basis.has_stated_inputs)

    @cached_property
    def _directed(self) -> tuple[list[Basis], IntArray, IntArray]:
        """Bases that may depend on directions of movement, coefficients of their terms, and their functions' rows."""
        bases = [basis for basis in self._input_bases if basis.inputs is None or "direction" in basis.inputs]
        first = dict(zip(bases, accumulate((basis.n_functions for basis in bases), initial=0), strict=False))
        terms = [both for both in zip(self.terms, self.columns, strict=True) if both[0].basis in first]
        functions = [columns - columns[0] + first[term.basis] for term, columns in terms]
        nothing = [np.zeros(0, dtype=np.intp)]
        return bases, np.concatenate([*nothing, *(own for _, own in terms)]), np.concatenate([*nothing, *functions])

    @cached_property
    def _evaluated(self) -> list[tuple[Basis, list[tuple[slice, IntArray | slice]]]]:
        """Each distinct basis, with rows among the values and the functions there; harmonics of a joint are one."""
        orders: dict[int, set[int]] = {}
        for _, basis in self._functions:
            if isinstance(basis, Harmonics):
                orders.setdefault(basis.joint, set()).update(basis.orders)
        tables = {joint: Harmonics(joint, tuple(sorted(of_joint))) for joint, of_joint in orders.items()}
        found: dict[Basis, list[tuple[slice, list[slice]]]] = {}
        for (_, basis), rows in self._functions.items():
            table, functions = basis, [slice(0, basis.n_functions)]
            if isinstance(basis, Harmonics):
                table = tables[basis.joint]
                places = np.searchsorted(table.orders, basis.orders).tolist()
                functions = [slice(2 * one, 2 * one + 2) for one in places]
            uses = found.setdefault(table, [])
            if uses and (uses[-1][0].stop, uses[-1][1][-1].stop) == (rows.start, functions[0].start):  # go on
                before, known = uses.pop()
                rows, functions = slice(before.start, rows.stop), known + functions
            uses.append((rows, functions))
        # The most functions first.
        ordered = {basis: sorted(uses, key=lambda use: use[0].start - use[0].stop) for basis, uses in found.items()}
        return [(basis, [(rows, _joined(functions)) for rows, functions in uses]) for basis, uses in ordered.items()]

    @cached_property
    def _runs(self) -> list[tuple[int, slice, int | slice]]:
        """Place, functions and components that these may move it along: one, of many functions, or all of the others.

        The product with one component takes half the time of that with six.
        """
        axes_of = dict.fromkeys(self._functions, np.zeros(6, bool))
        for term in self.terms:
            key = term.place, term.basis
            axes_of[key] = axes_of[key] | (np.array(term.direction) != 0)
        only = {key: int(axes.argmax()) if axes.sum() == 1 else slice(None) for key, axes in axes_of.items()}
        runs: list[tuple[int, slice, int | slice]] = []
        for (place, axes), keys in groupby(self._functions, lambda key: (key[0], only[key])):
            rows = [self._functions[key] for key in keys]
            start, stop = rows[0].start, rows[-1].stop
            axes = slice(None) if stop - start <= MOST_NARROW else axes
            if runs and (runs[-1][0], runs[-1][2]) == (place, axes):  # go on
                start = runs.pop()[1].start
            runs.append((place, slice(start, stop), axes))
        return runs

    @cached_property
    def _of_place(self) -> list[slice]:
        """Rows of each place among the values."""
        counts = np.zeros(self.chain.n_places, dtype=int)
        for (place, _), rows in self._functions.items():
            counts[place] += rows.stop - rows.start
        return [slice(int(first), int(stop)) for first, stop in pairwise(np.cumsum([0, *counts]))]

    @cached_property
    def _entries(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Coefficient, entry of the matrix (n_functions, 6) that it adds to, and component of the direction."""
        found = [
            (columns[0], self._functions[term.place, term.basis].start, axis, component, len(columns))
            for term, columns in zip(self.terms, self.columns, strict=True)
            for axis, component in enumerate(term.direction)
            if component
        ]
        of_axis = np.array(found, dtype=float).reshape(-1, 5)
        n = of_axis[:, 4].astype(np.intp)
        coefficient, row, axis, component, _ = of_axis.repeat(n, axis=0).T
        within = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n)
        return (coefficient + within).astype(np.intp), (6 * (row + within) + axis).astype(np.intp), component


def _dense_series(bases: list[Harmonics]) -> list[Harmonics]:
    """Those of one joint whose orders, all different, fill at least half of the range up to the highest.

    None where they are so few that they are cheaper as columns.
    """
    found: list[Harmonics] = []
    orders: set[int] = set()
    for basis in sorted(bases, key=lambda basis: basis.orders):
        if orders.isdisjoint(basis.orders) and basis.orders[-1] <= 2 * (len(orders) + len(basis.orders)):
            found.append(basis)
            orders.update(basis.orders)
    return found if 2 * len(orders) > MOST_NARROW else []


@lru_cache(maxsize=16)
def _moved(chain: Chain, motions: bytes) -> Chain:
    """With constant motions (n_places, 6), which are those of every chunk of readings."""
    return chain.with_motions(np.frombuffer(motions).reshape(-1, 6).copy())


def moved_chain(chain: Chain, state: ArmState, motions: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Tips (3, m) [mm] and their derivatives (n_places, 6, 3, m) by the components of motions, or by small ones."""
    chunk, given = max(len(state), 1), None if motions is None else lambda _: motions
    _, tips, motion_jacobian = next(chain.tip_derivatives_by_chunk(state.angles, given, chunk=chunk))
    return tips, motion_jacobian


def chunks(n: int, size: int = CHUNK) -> list[slice]:
    """Slices of readings that are evaluated together."""
    return [slice(start, min(start + size, n)) for start in range(0, n, size)]


def _joined(rows: list[slice]) -> IntArray | slice:
    """Rows one below the other; adjacent ones are a slice, whose values are not copied."""
    if all(one.stop == other.start for one, other in pairwise(rows)):
        return slice(rows[0].start, rows[-1].stop)
    return np.concatenate([np.arange(one.start, one.stop) for one in rows])


def as_slice(rows: IntArray) -> IntArray | slice:
    """Adjacent rows as a slice, whose values are not copied."""
    adjacent = len(rows) > 0 and (np.diff(rows) == 1).all()
    return slice(int(rows[0]), int(rows[-1]) + 1) if adjacent else rows
