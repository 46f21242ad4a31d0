"""Changes during a session: a tracker that was pushed, a base that creeps, a tip that was turned, a joint that slipped.

Each kind of change has its motions B of a point: the six of a rigid frame, three of a tip in the flange, one of a
joint's zero. Each reading's residual r is projected on them with the weights W: scores ``s = B^T W r``. If nothing
changed, their order says nothing. Their cumulated sums, centred, whitened by the scores' own covariance and scaled by
``t (1 - t)`` at a share t of the readings, are the score statistics of a step there; the largest is the sup-LM
statistic of D. W. K. Andrews, "Tests for parameter instability and structural change with unknown change point",
Econometrica 61 (1993) 821. That of a kind is compared with those of others by its tail probability for as many degrees
of freedom as it has motions. The distribution of the smallest one if nothing changed is, of many readings, the limit of
each kind, and all kinds together by Bonferroni's inequality. Of few readings it is that over random orders of the same
scores, unless the limit leaves no doubt: no normality is assumed.

What a model does not explain depends on the pose, and poses are often measured region by region. From each score the
mean of those at the most similar poses is therefore subtracted: a change counts only where poses before and after it
are alike. Readings that repeat a pose one after the other count as one, their mean: compared with each other they would
hide every change between poses. It must also be there in residuals less a smooth function of the joints. Consecutive
readings of like poses have like residuals; the statistic is divided by the ratio of long-run and plain variance (W. K.
Newey, K. D. West, Econometrica 55 (1987) 703) of the scores without the step.

What changed, and where, is what explains the residuals best: every kind, as a step at every row and as a drift in
proportion to the row, by its likelihood beside all constant motions, the noise being as large as the scatter that
remains. Motions count by the Bayesian information criterion (G. Schwarz, Ann. Stat. 6 (1978) 461). Several changes are
found in turn, and each is then found again beside the others until none changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.special import chdtrc, chdtri, gammaln  # `scipy.stats` takes longer to import than a small fit

from truearm.arm.rigid_motions import cross_matrix
from truearm.identification.estimation.perturbed_chain import chunks
from truearm.solve.linear_algebra import inverse_root
from truearm.typing import BoolArray, FloatArray, IntArray

# A session of good readings is questioned once in five hundred.
SIGNIFICANCE = 0.002
# From so many readings on the limit holds: of Gaussian scores, and of a t with 4 degrees of freedom, false alarms are
# 0.4 to 1.3 times as frequent as stated. Fewer readings are put into random orders.
LIMIT_READINGS, N_ORDERS = 1000, 1999
# Of fewer readings the limit leaves no doubt: with a t of 1.2 degrees of freedom it is too small by a factor of 20.
NO_DOUBT = SIGNIFICANCE / 1000
# Larger tail probabilities of one kind are not examined further: some good session in ten has a smaller one.
LARGEST_TAIL = 0.004
# Readings on both sides of a step, at least: so many, and this share.
LEAST_READINGS, LEAST_SHARE = 8, 0.05
# With fewer readings for each function of the joints these would explain a step too; more do not help.
READINGS_PER_FUNCTION, MAX_FUNCTIONS = 4, 400
# Similar poses that a reading is compared with.
NEIGHBOURS = 8
# Consecutive readings are of one pose if no joint differs by more: as a share of its scatter, or in rad and mm.
STILL_SHARE, STILL_ANGLE = 0.01, 1e-3
# Readings that are tested, at most: they show a step of a sixteenth of their scatter.
MOST_READINGS = 20_000
# Changes that are looked for one after the other.
MAX_CHANGES = 5
# Rounds in which each is found again beside the others, at most: eleven thousand readings of a UR10 take three.
MAX_ROUNDS = 10
# Smaller eigenvalues of products of columns of unit size are rounding.
LEAST_EIGENVALUE = 1e-11
# Of scores of unit size: directions of a smaller variance do not vary.
LEAST_VARIANCE = 1e-9
# Of a motion of which others leave a smaller share nothing is left.
LEAST_LEFT = 1e-6
# A kind is named alone if its odds against every other are better.
CLEAR_ODDS = 20.0
# Smaller probabilities are not stated.
LEAST_PROBABILITY = 1e-3


@dataclass(frozen=True)
class Change:
    """What changed between two readings of a session, or slowly.

    Attributes
    ----------
    kind : {"step", "drift"}
    what : str
        The kind of motion that explains it best.
    odds : dict of str to float
        Probability of each kind of motion, that of `what` first, of those that are not negligible.
    row : int
        First row of the readings after the step; of a drift the row in its middle.
    first_row, last_row : int
        95 % interval of that row.
    shift_mm : float
        Root mean square distance by which the points moved; of a drift from the first to the last reading [mm].
    motion : (k,) array
        Along the motions of `what`, in their unit.
    p_value : float
        Probability of a change as clear as this if nothing changed.
    """

    kind: Literal["step", "drift"]
    what: str
    odds: dict[str, float]
    row: int
    first_row: int
    last_row: int
    shift_mm: float
    motion: FloatArray = field(repr=False)
    p_value: float


def rigid_motions(points: FloatArray) -> FloatArray:
    """(n, 3, 6) displacements of points (n, 3) by rotations about their centroid [mm/rad] and translations."""
    away = points - points.mean(axis=0)
    turns = -cross_matrix(away)
    return np.concatenate([turns, np.broadcast_to(np.eye(3), turns.shape)], axis=2)


def session_changes(
    angles: FloatArray, motions: Mapping[str, FloatArray], residuals: FloatArray, weights: FloatArray, rows: IntArray
) -> list[Change]:
    """Test whether something changed during a session, and what.

    Parameters
    ----------
    angles : (n, n_joints) array
        Of the readings, in the order in which they were measured [rad, or mm].
    motions : mapping of str to (n, 3, k) array
        By the kind of change the displacements of the points [mm per unit of the motion].
    residuals : (n, 3) array
        Predicted less measured, any constant motion being identified [mm].
    weights : (n, 3) array
        One over their variances, times robust weights [1/mm^2].
    rows : (n,) int array
        Rows of the readings in the session.

    Returns
    -------
    list of Change
        In the order of their rows; empty if the order of the residuals is what chance gives. Of more than 20,000
        readings 20,000 are tested, evenly selected, and rows are known to the next of these.
    """
    at = _Readings(angles, dict(motions), residuals, weights, rows).evenly(MOST_READINGS).less_repeats()
    if len(at.rows) < 2 * at.margin + 1:
        return []
    found, p_values = _steps(at)
    if not found:
        return []
    drift = _best(at, [], steps=False).course
    if _log_likelihood(at, [drift], found) > _log_likelihood(at, found, found):
        found, p_values = [drift], p_values[:1]
    described = [_describe(at, found, number, p_value, int(rows[-1])) for number, p_value in enumerate(p_values)]
    return sorted(described, key=lambda change: change.row)


def _steps(at: _Readings) -> tuple[list[_Course], list[float]]:
    """Steps found in turn, and the p-value of each; each at the best row beside the others."""
    found: list[_Course] = []
    p_values: list[float] = []
    while len(found) < MAX_CHANGES:
        p_value = _significance(at, _without(at, found))
        if p_value is None:
            break
        step = _best(at, found, steps=True)
        if step.likelihoods[step.course.what].max() < 0:  # not worth its motions
            break
        found.append(step.course)
        p_values.append(p_value)
        before: list[_Course] = []
        for _ in range(MAX_ROUNDS):
            if found == before:
                break
            before = list(found)
            for number in range(len(found)):
                found[number] = _best(at, found[:number] + found[number + 1 :], steps=True).course
    return found, p_values


@dataclass(frozen=True, eq=False)
class _Readings:
    """What is tested; see `session_changes`."""

    angles: FloatArray
    motions: dict[str, FloatArray]
    residuals: FloatArray
    weights: FloatArray
    rows: IntArray
    moved: dict[_Course, tuple[FloatArray, FloatArray]] = field(default_factory=dict, init=False)
    identified: dict[tuple[_Course, ...], _Identified] = field(default_factory=dict, init=False)
    products: dict[tuple[_Course, ...], dict[str, _StepProducts]] = field(default_factory=dict, init=False)
    best: dict[tuple[Any, ...], _Best] = field(default_factory=dict, init=False)

    @property
    def margin(self) -> int:
        """Readings on both sides of a step, at least."""
        return _margin(len(self.rows))

    @cached_property
    def together(self) -> FloatArray:
        """(n, 3, p) all motions."""
        return np.concatenate(list(self.motions.values()), axis=2)

    @cached_property
    def by_motion(self) -> FloatArray:
        """(p, 3, n) all motions, of each the readings in a row."""
        return _by_column(self.together)

    @cached_property
    def roots(self) -> FloatArray:
        """(3, n) roots of the weights."""
        return np.sqrt(np.ascontiguousarray(self.weights.T))

    @cached_property
    def measured(self) -> tuple[BoolArray, int]:
        """(3,) the axes that were measured, and the number of readings."""
        measured = self.weights > 0
        return np.asarray(measured.any(axis=0)), int(measured.any(axis=1).sum())

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Of all motions those of each kind."""
        stops = np.cumsum([of.shape[2] for of in self.motions.values()]).tolist()
        return {what: slice(start, stop) for what, start, stop in zip(self.motions, [0, *stops], stops, strict=False)}

    @cached_property
    def nearest(self) -> IntArray:
        """(n, k) The readings of the most similar poses."""
        scaled = _standardized(self.angles)
        k = min(NEIGHBOURS, len(scaled) - 1)
        found = np.asarray(cKDTree(scaled).query(scaled, k=k + 1)[1])
        own = found == np.arange(len(found))[:, None]  # of exact repeats it need not be the first
        own[~own.any(axis=1), -1] = True
        return np.asarray(found[~own].reshape(len(found), k))

    def _less_nearest(self, weight: FloatArray) -> csr_array:
        """(n, n) what takes from a value at each reading the mean of those at similar poses, by weight (n,)."""
        (n, k), weight = self.nearest.shape, weight[self.nearest]
        share = weight / np.maximum(weight.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        values, rows = np.insert(-share, 0, 1.0, axis=1), np.insert(self.nearest, 0, np.arange(n), axis=1)
        return csr_array((values.ravel(), rows.ravel(), np.arange(0, n * (k + 1) + 1, k + 1)), shape=(n, n))

    @cached_property
    def plain_contrast(self) -> csr_array:
        """(n, n) of each reading with those at the most similar poses, all alike."""
        return self._less_nearest(np.ones(len(self.rows)))

    @cached_property
    def contrast(self) -> csr_array:
        """(n, n) of each reading with those at the most similar poses, by weight."""
        return self._less_nearest(self.weights.mean(axis=1))

    @cached_property
    def back(self) -> csr_array:
        """(n, n) the transpose of the contrast."""
        return csr_array(self.contrast.T)

    def differences(self, columns: FloatArray) -> FloatArray:
        """(k, 3 n) of columns (n, 3, k) from those at like poses, whitened."""
        found = _by_column((self.contrast @ columns.reshape(len(columns), -1)).reshape(columns.shape))
        found *= self.roots
        return found.reshape(len(found), -1)

    def towards(self, differences: FloatArray) -> FloatArray:
        """(q, 3, n) whose products with columns are those of the differences of the columns with these (q, 3 n)."""
        weighed = (self.roots * differences.reshape(-1, *self.roots.shape)).reshape(-1, len(self.rows))
        return np.ascontiguousarray((self.back @ weighed.T).T).reshape(-1, *self.roots.shape)

    @cached_property
    def own_products(self) -> dict[str, _StepProducts]:
        """By kind, beside nothing: of each reading with itself and those before it, by the products of all pairs."""
        n, earlier = len(self.rows), np.empty_like(self.together)
        left = set(range(3))
        while left:  # axes, often of the same weights
            weight = self.weights[:, min(left)]
            alike = [axis for axis in left if (self.weights[:, axis] == weight).all()]
            left.difference_update(alike)
            precision = csr_array(self.back @ (weight[:, None] * self.contrast))
            rows = np.repeat(np.arange(n), np.diff(precision.indptr))
            precision.data *= (precision.indices < rows) + 0.5 * (precision.indices == rows)
            precision.eliminate_zeros()
            earlier[:, alike] = (precision @ self.together[:, alike].reshape(n, -1)).reshape(n, len(alike), -1)
        earlier, residuals, found = _by_column(earlier), self.towards(self.differences(self.residuals[:, :, None])), {}
        for what, of in self.columns.items():
            half, right = (_up_to_each(self.by_motion[of], one, self.margin) for one in (earlier[of], residuals))
            found[what] = _StepProducts([one[row:] + half[row:, row] for row, one in enumerate(half)], right[:, 0])
        return found

    @cached_property
    def plain_constant(self) -> tuple[FloatArray, FloatArray]:
        """(p, 3 n) all motions times the weights, and the root of their products."""
        plain = self.by_motion.reshape(len(self.by_motion), -1)
        weighted = plain * self.weights.T.ravel()
        return weighted, inverse_root(weighted @ plain.T, LEAST_EIGENVALUE)

    @cached_property
    def _smooth(self) -> tuple[list[FloatArray], FloatArray] | None:
        """Cubic functions of each joint and distances from some poses, and the root of their weighed products.

        (p, n) in parts, whose products are formed while they are in the cache; None where too few readings would
        determine them.
        """
        z = _standardized(self.angles)
        powers = np.vstack([np.ones(len(z)), z.T, z.T**2, z.T**3])
        n_functions = min(len(z) // READINGS_PER_FUNCTION, MAX_FUNCTIONS)
        if n_functions < len(powers):
            return None
        poses = z[np.linspace(0, len(z) - 1, n_functions - len(powers), dtype=int)]
        gram, roots, parts = np.zeros((n_functions, n_functions)), np.sqrt(self.weights.mean(axis=1)), []
        for rows in chunks(len(z)):
            part = np.empty((n_functions, len(z[rows])))
            part[: len(powers)] = powers[:, rows]
            cdist(poses, z[rows], out=part[len(powers) :])
            weighed = part * roots[rows]
            gram += weighed @ weighed.T
            parts.append(part)
        return parts, inverse_root(gram, LEAST_EIGENVALUE)

    def less_smooth(self, residuals: FloatArray) -> FloatArray:
        """Residuals less what is smooth in the joints."""
        if self._smooth is None:
            return residuals
        parts, root = self._smooth
        weighted = self.weights.mean(axis=1) * residuals.T
        # As rows, not columns: that is how the parts lie.
        along = sum(weighted[:, rows] @ part.T for rows, part in zip(chunks(len(residuals)), parts, strict=True))
        along = (root @ (root.T @ along.T)).T
        return np.asarray(residuals - np.concatenate([along @ part for part in parts], axis=1).T)

    def evenly(self, most: int) -> _Readings:
        """No more than `most` of them, evenly selected in their order."""
        if len(self.rows) <= most:
            return self
        some = np.linspace(0, len(self.rows) - 1, most).astype(np.intp)
        motions = {name: value[some] for name, value in self.motions.items()}
        return _Readings(self.angles[some], motions, self.residuals[some], self.weights[some], self.rows[some])

    def less_repeats(self) -> _Readings:
        """The mean of readings that repeat a pose one after the other, and the first row of each."""
        angles = self.angles
        near = np.maximum(STILL_SHARE * angles.std(axis=0), STILL_ANGLE) if len(angles) else np.zeros(1)
        is_first, stop = np.ones(len(angles), dtype=bool), 0
        for row in (np.flatnonzero((np.abs(np.diff(angles, axis=0)) <= near).all(axis=1)) + 1).tolist():
            if row <= stop:  # of the pose before
                continue
            stop = row
            while stop < len(angles) and (np.abs(angles[stop] - angles[row - 1]) <= near).all():
                stop += 1
            is_first[row:stop] = False
        if is_first.all():
            return self
        starts = np.flatnonzero(is_first)
        ends = np.append(starts, len(angles))
        share = np.repeat(1 / np.diff(ends), np.diff(ends))
        of_pose = csr_array((share, np.arange(len(angles)), ends))

        def mean(values: FloatArray) -> FloatArray:
            return np.asarray((of_pose @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:]))

        weight = mean(self.weights)
        weighted = np.divide(mean(self.weights * self.residuals), weight, out=np.zeros_like(weight), where=weight > 0)
        motions = {name: mean(value) for name, value in self.motions.items()}
        return _Readings(mean(angles), motions, weighted, weight, self.rows[starts])


class _Course(NamedTuple):
    """A kind of motion and its course: a step before a number of readings, or a drift (0)."""

    what: str
    step: int

    def over(self, n: int) -> FloatArray:
        """(n,) share of the motion at each reading."""
        return np.linspace(0.0, 1.0, n) if self.step == 0 else (np.arange(n) >= self.step).astype(float)


def _margin(n: int) -> int:
    """Readings on both sides of a step, at least."""
    return max(LEAST_READINGS, int(np.ceil(LEAST_SHARE * n)))


# Whether anything changed ---------------------------------------------------------------------------------------------


def _significance(at: _Readings, residuals: FloatArray) -> float | None:
    """P-value of the clearest step of any kind; None if it is not significant."""
    p_values = []
    # As they are, and without what is smooth in the joints: each alone leaves some errors of the pose. One that is not
    # significant decides; of few readings the second, which is so more often, spares random orders of the first.
    for is_smooth_left in (True, False) if len(residuals) >= LIMIT_READINGS else (False, True):
        some = residuals if is_smooth_left else at.less_smooth(residuals)
        scores = np.einsum("nip,ni->np", at.together, at.weights * some)
        contrasts = np.ascontiguousarray((at.plain_contrast @ scores).T)
        contrasts -= contrasts.mean(axis=1, keepdims=True)
        whitened = [_whitened(contrasts[of]) for of in at.columns.values()]
        p_value = _p_value([white for white in whitened if len(white)])
        if p_value is None:
            return None
        p_values.append(p_value)
    return max(p_values)


def _p_value(whitened: list[FloatArray]) -> float | None:
    """Probability of a step as clear as the clearest of any kind if nothing changed; None if it is not significant."""
    n = whitened[0].shape[1] if whitened else 0
    margin = _margin(n)
    if n < 2 * margin + 1:
        return None
    white, widths, factors = np.concatenate(whitened), [len(one) for one in whitened], _factors(n, margin)
    kinds, sums = np.cumsum([0, *widths[:-1]]), np.cumsum(white, axis=1)
    likeliest = np.argmax(np.add.reduceat(sums[:, margin - 1 : n - margin] ** 2, kinds) * factors, axis=1)
    step, factor = (np.repeat(of, widths) for of in (margin + likeliest, factors[likeliest]))
    before, after = sums[np.arange(len(white)), step - 1], sums[:, -1]
    means = (before / step)[:, None], ((after - before) / (n - step))[:, None]
    within = white - np.where(np.arange(n) < step[:, None], *means)
    largest = _clearness(np.add.reduceat(before**2 / _long_run_ratio(within) * factor, kinds), widths).max()
    if largest < -np.log(LARGEST_TAIL):
        return None
    of_kinds = [_whitened(one) for one in np.split(within, kinds[1:])]
    widths = [len(one) for one in of_kinds]
    limits = chdtri(widths, np.exp(-min(largest, 700.0)))  # as clear as this
    probability = float(sum(_limit_probability(x, k, margin / n) for x, k in zip(limits, widths, strict=True)))
    if n < LIMIT_READINGS and probability > NO_DOUBT:
        probability = _share_of_orders(of_kinds, limits, margin)
    return probability if probability <= SIGNIFICANCE else None


def _limit_probability(statistic: float, freedom: int, trimmed: float) -> float:
    """Probability that the statistic of any step is as large, in the limit of many readings, if nothing changed.

    The tail of the largest norm of a standardized Brownian bridge between `trimmed` and its rest: L. Yu. Vostrikova,
    Theory Probab. Appl. 26 (1981) 356, in the form of M. Csorgo and L. Horvath, Limit Theorems in Change-Point Analysis
    (1997), equation 1.3.26. It holds for probabilities below 0.1.
    """
    span = 2 * np.log((1 - trimmed) / trimmed)
    density = np.exp(freedom / 2 * np.log(statistic / 2) - statistic / 2 - gammaln(freedom / 2))
    return float(density * ((1 - freedom / statistic) * span + 4 / statistic))


def _share_of_orders(within: list[FloatArray], limits: FloatArray, margin: int) -> float:
    """Share of random orders of the scores with a statistic beyond its limit; 1 as soon as it cannot be significant."""
    together, kinds = np.concatenate(within), np.cumsum([0, *(len(one) for one in within[:-1])])
    rng, exceeded, n = np.random.default_rng(0), 0, together.shape[1]
    factors = _factors(n, margin)
    for _ in range(N_ORDERS):
        sums = np.cumsum(together[:, rng.permutation(n)], axis=1)[:, margin - 1 : n - margin]
        statistics = np.add.reduceat(sums**2, kinds) * factors
        exceeded += bool((statistics.max(axis=1) >= limits).any())
        if exceeded > SIGNIFICANCE * (N_ORDERS + 1) - 1:
            return 1.0
    return (exceeded + 1) / (N_ORDERS + 1)


def _clearness(statistics: FloatArray, freedom: list[int]) -> FloatArray:
    """Minus the logarithm of the tail probability of each."""
    with np.errstate(divide="ignore"):  # a probability below the smallest number
        return np.asarray(-np.log(chdtrc(freedom, statistics)))


def _standardized(angles: FloatArray) -> FloatArray:
    scatter = angles.std(axis=0)
    return np.asarray((angles - angles.mean(axis=0)) / np.where(scatter > 0, scatter, 1.0))


def _whitened(scores: FloatArray) -> FloatArray:
    """Scores (k, n) without a mean, with a unit covariance; directions that do not vary are omitted."""
    return np.asarray(inverse_root(scores @ scores.T / scores.shape[1], LEAST_VARIANCE).T @ scores)


def _factors(n: int, margin: int) -> FloatArray:
    """By which a squared sum of whitened scores becomes the statistic of a step after them; of a margin and more."""
    before = np.arange(margin, n - margin + 1)
    return np.asarray(n / (before * (n - before)))


def _long_run_ratio(white: FloatArray) -> FloatArray:
    """(k,) long-run over plain variance of white (k, n), 1 or more: Bartlett's kernel over the cube root of n lags.

    Squared sums of as many consecutive values contain each product of two as often as that kernel weighs it.
    """
    many = 1 + max(1, int(np.ceil(white.shape[1] ** (1 / 3))))
    sums = np.cumsum(np.pad(white, ((0, 0), (many, many - 1))), axis=1)
    spans = sums[:, many:] - sums[:, :-many]
    long_run, plain = (np.einsum("kn,kn->k", of, of) for of in (spans, white))
    return np.asarray(np.maximum(long_run / many / plain, 1.0))


# What changed, and where ----------------------------------------------------------------------------------------------


class _StepProducts(NamedTuple):
    """Products of the differences by a step at each row, of the motions of a kind before it, beside what is identified.

    Attributes
    ----------
    triangle : list of (k, n_steps), (k - 1, n_steps), ... array
        Of each motion with itself and with those after it.
    right : (k, n_steps) array
        With the differences of the residuals.
    """

    triangle: list[FloatArray]
    right: FloatArray


class _Identified(NamedTuple):
    """What is identified of the residuals: all motions, constant, and some changes.

    Attributes
    ----------
    moved : (k, 3 n) array
        Differences by the last of them beside the others.
    root : (k, r) array
        Its products with itself are the pseudoinverse of those of `moved`.
    along : (r,) array
        Of the residuals, along these.
    left : (3 n,) array
        Differences of the residuals less all these from those at like poses, whitened.
    """

    moved: FloatArray
    root: FloatArray
    along: FloatArray
    left: FloatArray


class _Best(NamedTuple):
    """The most probable change beside others, at its likeliest row.

    Attributes
    ----------
    course : _Course
    log_odds : dict of str to float
        Logarithm of the probability of each kind, the most probable first.
    likelihoods : dict of str to array
        Log likelihoods by kind: of steps at all rows, of drifts one.
    """

    course: _Course
    log_odds: dict[str, float]
    likelihoods: dict[str, FloatArray]


def _moved(at: _Readings, course: _Course) -> tuple[FloatArray, FloatArray]:
    """(k, 3 n) differences by a change beside constant motions, and (k,) its size; once for the same change."""
    if (found := at.moved.get(course)) is None:
        columns = course.over(len(at.rows))[:, None, None] * at.motions[course.what]
        moved = _beside(at.differences(columns), [_identified(at, [])])
        found = at.moved[course] = moved, np.einsum("nik,nik,ni->k", columns, columns, at.weights)
    return found


def _identified(at: _Readings, courses: Sequence[_Course]) -> _Identified:
    """Once for the same changes."""
    if (found := at.identified.get(tuple(courses))) is None:
        if courses:
            before = [_identified(at, courses[:number]) for number in range(len(courses))]
            left, (moved, size) = before[-1].left, _moved(at, courses[-1])
            moved = _beside(moved, before[1:])
        else:
            left, moved = at.differences(at.residuals[:, :, None])[0], at.differences(at.together)
            # What is constant has no differences: by its own size it stays zero.
            size = np.einsum("pin,pin,in->p", at.by_motion, at.by_motion, at.weights.T)
        root = inverse_root(moved @ moved.T, LEAST_EIGENVALUE, size)
        along = root.T @ (moved @ left)
        found = at.identified[tuple(courses)] = _Identified(moved, root, along, left - (root @ along) @ moved)
    return found


def _beside(differences: FloatArray, others: Sequence[_Identified]) -> FloatArray:
    """Differences (k, 3 n) less what others explain of them."""
    for other in others:
        differences = differences - (differences @ other.moved.T @ other.root @ other.root.T) @ other.moved
    return differences


def _step_products(at: _Readings, courses: Sequence[_Course]) -> dict[str, _StepProducts]:
    """By kind, beside constant motions and some changes; once for the same ones."""
    if (found := at.products.get(tuple(courses))) is None:
        last, before = _identified(at, courses), _step_products(at, courses[:-1]) if courses else at.own_products
        towards, found = at.towards(last.root.T @ last.moved), {}
        for what, (triangle, right) in before.items():
            taken = _up_to_each(at.by_motion[at.columns[what]], towards, at.margin)
            less = [np.einsum("rn,qrn->qn", one, taken[row:]) for row, one in enumerate(taken)]
            left = [one - other for one, other in zip(triangle, less, strict=True)]
            found[what] = _StepProducts(left, right - last.along @ taken)
        at.products[tuple(courses)] = found
    return found


def _solved(at: _Readings, courses: Sequence[_Course]) -> list[FloatArray]:
    """The motion (k,) of each of some changes, beside constant motions."""
    moved, sizes = zip(*(_moved(at, one) for one in courses), strict=True)
    together = np.concatenate(moved)
    root = inverse_root(together @ together.T, LEAST_EIGENVALUE, np.concatenate(sizes))
    return np.split(root @ (root.T @ (together @ _identified(at, []).left)), np.cumsum([len(of) for of in sizes]))[:-1]


def _without(at: _Readings, courses: list[_Course]) -> FloatArray:
    """Residuals without changes, any constant motion being identified: differences alone do not determine that."""
    if not courses:
        return at.residuals
    residuals = at.residuals.T.copy()
    for course, motion in zip(courses, _solved(at, courses), strict=True):
        residuals -= course.over(len(at.rows)) * (at.motions[course.what] @ motion).T
    weighted, root = at.plain_constant
    for _ in range(2):  # of motions that are nearly alike the second takes what rounding has left
        residuals -= np.tensordot(root @ (root.T @ (weighted @ residuals.ravel())), at.by_motion, 1)
    return residuals.T


def _by_column(values: FloatArray) -> FloatArray:
    """(p, 3, n) columns (n, 3, p), of each the readings in a row."""
    return np.ascontiguousarray(values.transpose(2, 1, 0))


def _up_to_each(columns: FloatArray, others: FloatArray, margin: int) -> FloatArray:
    """(p, q, n_steps) products of columns (p, 3, n) before a step at each row with others (q, 3, n)."""
    both = columns, others
    products = np.einsum("pin,qin->pqn", *(of[..., margin - 1 : of.shape[-1] - margin] for of in both))
    products[..., 0] += np.einsum("pin,qin->pq", *(of[..., : margin - 1] for of in both))
    return np.cumsum(products, axis=-1, out=products)


def _best(at: _Readings, others: list[_Course], *, steps: bool) -> _Best:
    """The most probable kind of step or drift beside other changes; once beside the same."""
    if (found := at.best.get((steps, *others))) is None:
        likelihoods = _log_likelihoods(at, others, steps=steps)
        # Any row is as probable as any other.
        evidence = {what: _log_sum(of) for what, of in likelihoods.items()}
        total = _log_sum(np.array(list(evidence.values())))
        odds = {what: of - total for what, of in sorted(evidence.items(), key=lambda one: -one[1])}
        what = next(iter(odds))
        course = _Course(what, at.margin + int(np.argmax(likelihoods[what])) if steps else 0)
        found = at.best[steps, *others] = _Best(course, odds, likelihoods)
    return found


def _log_sum(logarithms: FloatArray) -> float:
    """Logarithm of the sum of numbers by their logarithms; `scipy.special.logsumexp` took a seventh of the search."""
    largest = logarithms.max()
    return float(largest + np.log(np.exp(logarithms - largest).sum()))


def _log_likelihoods(at: _Readings, others: list[_Course], *, steps: bool) -> dict[str, FloatArray]:
    """Log likelihoods of a change beside others, by kind; of steps at all rows, of drifts one.

    Beside constant motions it is the same whether a motion is there before or after a step. Of its products with
    itself and with the residuals sums over the readings before it are enough: those of all rows are one cumulated sum.
    """
    n, beside = len(at.rows), [_identified(at, others[:number]) for number in range(len(others) + 1)]
    square = max(float((beside[-1].left ** 2).sum()), np.finfo(float).tiny)
    if steps:
        products = _step_products(at, others)
        size = {what: [one[0] for one in of.triangle] for what, of in at.own_products.items()}
    else:
        plain = at.differences(np.linspace(0.0, 1.0, n)[:, None, None] * at.together)
        moved, products = _beside(plain, beside), {}
        gram, right = (moved @ moved.T)[:, :, None], (moved @ beside[-1].left)[:, None]
        for what, of in at.columns.items():
            triangle = [one[row : of.stop] for row, one in enumerate(gram[of], of.start)]
            products[what] = _StepProducts(triangle, right[of])
        size = {what: (plain[of] ** 2).sum(axis=1) for what, of in at.columns.items()}
    found = {what: np.maximum(square - _explained(*products[what], size[what]), 1e-12 * square) for what in products}
    least = min(found, key=lambda what: float(found[what].min()))
    best = _Course(least, at.margin + int(np.argmin(found[least])) if steps else 0)
    freedom = _freedom(at, [*others, best])
    return {
        what: -freedom / 2 * np.log(of / square) - at.motions[what].shape[2] / 2 * np.log(n) - steps * np.log(n)
        for what, of in found.items()
    }


def _explained(triangle: list[FloatArray], right: FloatArray, size: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """(n,) squares that motions explain, by their products, as of `_StepProducts`.

    By elimination; motions of which less than a share of their `size`, numbers or (n,) arrays, is left explain nothing.
    """
    triangle, right, gain = [*triangle], right.copy(), np.zeros(right.shape[1])
    for row, pivot_size in enumerate(size):
        pivot, *across = triangle[row]
        inverse = np.divide(1.0, pivot, out=np.zeros_like(gain), where=pivot > LEAST_LEFT * pivot_size)
        gain += right[row] ** 2 * inverse
        for after, one in enumerate(across, 1):
            share = one * inverse
            right[row + after] -= share * right[row]
            triangle[row + after] = triangle[row + after] - share * triangle[row][after:]
    return gain


def _log_likelihood(at: _Readings, courses: list[_Course], best: list[_Course]) -> float:
    """Of some changes together, less what their motions and rows cost; the noise as it is without the best ones."""
    n, left = len(at.rows), _identified(at, courses).left
    cost = sum(at.motions[one.what].shape[2] / 2 + (one.step > 0) for one in courses) * np.log(n)
    return float(-_freedom(at, best) / 2 * np.log((left**2).sum()) - cost)


def _freedom(at: _Readings, courses: list[_Course]) -> float:
    """Number of coordinates that are independent, of what some changes leave over on axes that were measured."""
    axes, number = at.measured
    left = _identified(at, courses).left.reshape(3, -1)[axes]
    return float(number * len(left) / _long_run_ratio(left).mean())


def _describe(at: _Readings, found: list[_Course], number: int, p_value: float, last_row: int) -> Change:
    """Kind, row and size of a change beside the others: as these show it, so that its odds are of this kind."""
    steps, others = found[number].step > 0, found[:number] + found[number + 1 :]
    course, log_odds, likelihoods = _best(at, others, steps=steps)
    n, rows = len(at.rows), at.rows
    odds = {what: float(np.exp(of)) for what, of in log_odds.items() if np.exp(of) > LEAST_PROBABILITY}
    motion = -_solved(at, [*others, course])[-1]
    shift = float(np.sqrt(((at.motions[course.what] @ motion) ** 2).sum(axis=1).mean()))
    if not steps:
        return Change("drift", course.what, odds, int(rows[n // 2]), int(rows[0]), last_row, shift, motion, p_value)
    below = np.cumsum(np.exp(likelihoods[course.what] - _log_sum(likelihoods[course.what])))
    first, last = (at.margin + int(np.searchsorted(below, share)) for share in (0.025, 0.975))
    first_row, row, last_row = (
        int(rows[at]) for at in (min(first, course.step), course.step, min(max(last, course.step), n - 1))
    )
    return Change("step", course.what, odds, row, first_row, last_row, shift, motion, p_value)
