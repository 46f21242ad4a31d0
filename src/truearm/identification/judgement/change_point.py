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
from scipy.sparse import csr_array, eye_array, tril
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.special import chdtrc, chdtri, gammaln, logsumexp  # `scipy.stats` takes longer to import than a small fit

from truearm.arm.rigid_motions import cross_matrix
from truearm.identification.estimation.perturbed_chain import chunks
from truearm.solve.linear_algebra import inverse_root
from truearm.typing import FloatArray, IntArray

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
    margin = _margin(len(at.rows))
    if len(at.rows) < 2 * margin + 1:
        return []
    found, p_values = _steps(at, margin)
    if not found:
        return []
    drift = _best(at, [], margin, steps=False)[0]
    if _log_likelihood(at, [drift], found) > _log_likelihood(at, found, found):
        found, p_values = [drift], p_values[:1]
    described = [
        _describe(at, found, number, margin, p_value, last_row=int(rows[-1])) for number, p_value in enumerate(p_values)
    ]
    return sorted(described, key=lambda change: change.row)


def _steps(at: _Readings, margin: int) -> tuple[list[_Course], list[float]]:
    """Steps found in turn, and the p-value of each; each at the best row beside the others."""
    found: list[_Course] = []
    p_values: list[float] = []
    while len(found) < MAX_CHANGES:
        p_value = _significance(at, _without(at, found))
        if p_value is None:
            break
        step, likelihoods = _best(at, found, margin, steps=True)
        if likelihoods[step.what].max() < 0:  # not worth its motions
            break
        found.append(step)
        p_values.append(p_value)
        before: list[_Course] = []
        for _ in range(MAX_ROUNDS):
            if found == before:
                break
            before = list(found)
            for number in range(len(found)):
                found[number] = _best(at, found[:number] + found[number + 1 :], margin, steps=True)[0]
    return found, p_values


@dataclass(frozen=True, eq=False)
class _Readings:
    """What is tested; see `session_changes`."""

    angles: FloatArray
    motions: dict[str, FloatArray]
    residuals: FloatArray
    weights: FloatArray
    rows: IntArray
    identified: dict[tuple[_Course, ...], _Identified] = field(default_factory=dict, init=False)
    likelihoods: dict[tuple[Any, ...], dict[str, FloatArray]] = field(default_factory=dict, init=False)

    @cached_property
    def together(self) -> FloatArray:
        """(n, 3, p) all motions."""
        return np.concatenate(list(self.motions.values()), axis=2)

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
        mean = csr_array((share.ravel(), self.nearest.ravel(), np.arange(0, n * k + 1, k)), shape=(n, n))
        return eye_array(n, format="csr") - mean

    @cached_property
    def plain_contrast(self) -> csr_array:
        """(n, n) of each reading with those at the most similar poses, all alike."""
        return self._less_nearest(np.ones(len(self.rows)))

    @cached_property
    def contrast(self) -> csr_array:
        """(n, n) of each reading with those at the most similar poses, by weight."""
        return self._less_nearest(self.weights.mean(axis=1))

    def weighed(self, columns: FloatArray) -> FloatArray:
        """(n, 3, p) columns times the weights of products with their differences from those at like poses."""
        n = len(columns)
        differences = (self.contrast @ columns.reshape(n, -1)).reshape(columns.shape)
        differences *= self.weights[:, :, None]
        return np.asarray((self.contrast.T @ differences.reshape(n, -1)).reshape(columns.shape))

    @cached_property
    def weighed_together(self) -> FloatArray:
        """(n, 3, p) all motions, weighed."""
        return self.weighed(self.together)

    @cached_property
    def of_constant(self) -> tuple[FloatArray, FloatArray]:
        """(p, p) products of all motions with themselves, weighed, and (p,) their sizes."""
        return _products(self.together, self.weighed_together), _products(self.together**2, self.weights)

    @cached_property
    def products(self) -> FloatArray:
        """(p, p, n) products of all motions up to each reading with all motions, weighed."""
        return _up_to_each(self.together, self.weighed_together)

    @cached_property
    def own_products(self) -> dict[str, FloatArray]:
        """(k, k, n) by kind products of the motions up to each reading with themselves, weighed."""
        n, earlier, back = len(self.rows), np.empty_like(self.together), csr_array(self.contrast.T)
        left = set(range(3))
        while left:  # axes, often of the same weights
            weight = self.weights[:, min(left)]
            alike = [axis for axis in left if (self.weights[:, axis] == weight).all()]
            left.difference_update(alike)
            precision = tril(back @ (weight[:, None] * self.contrast), format="csr")
            precision.setdiag(precision.diagonal() / 2)
            earlier[:, alike] = (precision @ self.together[:, alike].reshape(n, -1)).reshape(n, len(alike), -1)
        half = {what: _up_to_each(self.together[..., of], earlier[..., of]) for what, of in self.columns.items()}
        return {what: of + of.transpose(1, 0, 2) for what, of in half.items()}

    @cached_property
    def _smooth(self) -> tuple[FloatArray, FloatArray] | None:
        """Cubic functions of each joint and distances from some poses, (p, n), and the root of their weighed products.

        None where too few readings would determine them.
        """
        z = _standardized(self.angles)
        powers = np.vstack([np.ones(len(z)), z.T, z.T**2, z.T**3])
        smooth = np.empty((min(len(z) // READINGS_PER_FUNCTION, MAX_FUNCTIONS), len(z)))
        if len(smooth) < len(powers):
            return None
        smooth[: len(powers)], distances = powers, smooth[len(powers) :]
        cdist(z[np.linspace(0, len(z) - 1, len(distances), dtype=int)], z, out=distances)
        gram, roots = np.zeros((len(smooth),) * 2), np.sqrt(self.weights.mean(axis=1))
        for rows in chunks(len(z)):
            weighed = smooth[:, rows] * roots[rows]
            gram += weighed @ weighed.T
        return smooth, inverse_root(gram, LEAST_EIGENVALUE)

    def less_smooth(self, residuals: FloatArray) -> FloatArray:
        """Residuals less what is smooth in the joints."""
        if self._smooth is None:
            return residuals
        smooth, root = self._smooth
        along = smooth @ (self.weights.mean(axis=1)[:, None] * residuals)
        return np.asarray(residuals - smooth.T @ (root @ (root.T @ along)))

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
        contrasts = np.asfortranarray(at.plain_contrast @ scores)
        contrasts -= contrasts.mean(axis=0)
        whitened = [_whitened(contrasts[:, of]) for of in at.columns.values()]
        p_value = _p_value([white for white in whitened if white.shape[1]])
        if p_value is None:
            return None
        p_values.append(p_value)
    return max(p_values)


def _p_value(whitened: list[FloatArray]) -> float | None:
    """Probability of a step as clear as the clearest of any kind if nothing changed; None if it is not significant."""
    within, largest, n = [], 0.0, len(whitened[0]) if whitened else 0
    margin = _margin(n)
    if n < 2 * margin + 1:
        return None
    cut = slice(margin, n - margin + 1)
    for white in whitened:
        step = margin + int(np.argmax(_statistics(white)[cut]))
        without = _without_step(white, step)
        sums = white[:step].sum(axis=0) ** 2 / _long_run_ratio(without)
        largest = max(largest, _clearness(float(sums.sum()) * n / (step * (n - step)), white.shape[1]))
        within.append(without)
    if largest < -np.log(LARGEST_TAIL):
        return None
    within = [_whitened(one) for one in within]
    widths = [one.shape[1] for one in within]
    limits = chdtri(widths, np.exp(-min(largest, 700.0)))  # as clear as this
    probability = float(sum(_limit_probability(x, k, margin / n) for x, k in zip(limits, widths, strict=True)))
    if n < LIMIT_READINGS and probability > NO_DOUBT:
        probability = _share_of_orders(within, limits, margin)
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
    rng, exceeded, n = np.random.default_rng(0), 0, len(within[0])
    together = np.ascontiguousarray(np.hstack(within).T)
    kinds = np.cumsum([0, *(one.shape[1] for one in within[:-1])])
    for _ in range(N_ORDERS):
        sums = np.cumsum(together[:, rng.permutation(n)], axis=1)[:, margin - 1 : n - margin]
        statistics = np.add.reduceat(sums**2, kinds) * _factors(n)[margin : n - margin + 1]
        exceeded += bool((statistics.max(axis=1) >= limits).any())
        if exceeded > SIGNIFICANCE * (N_ORDERS + 1) - 1:
            return 1.0
    return (exceeded + 1) / (N_ORDERS + 1)


def _clearness(statistic: float, freedom: int) -> float:
    """Minus the logarithm of its tail probability."""
    with np.errstate(divide="ignore"):  # a probability below the smallest number
        return -float(np.log(chdtrc(freedom, statistic)))


def _standardized(angles: FloatArray) -> FloatArray:
    scatter = angles.std(axis=0)
    return np.asarray((angles - angles.mean(axis=0)) / np.where(scatter > 0, scatter, 1.0))


def _whitened(scores: FloatArray) -> FloatArray:
    """Scores with a unit covariance; directions that do not vary are omitted."""
    scaled = scores / np.maximum(scores.std(axis=0), np.finfo(float).tiny)
    values, axes = np.linalg.eigh(scaled.T @ scaled / len(scores))
    varies = values > 1e-9
    # Each column in one piece: sums over the readings take a third of the time.
    return np.asarray(((axes[:, varies] / np.sqrt(values[varies])).T @ scaled.T).T)


def _factors(n: int) -> FloatArray:
    """(n + 1,) by which a squared sum of that many whitened scores becomes the statistic of a step after them."""
    before = np.arange(1, n)
    return np.pad(n / (before * (n - before)), 1)


def _statistics(white: FloatArray) -> FloatArray:
    """(n + 1,) the statistic of a step after each number of readings; zero at the ends."""
    return np.pad((np.cumsum(white, axis=0) ** 2).sum(axis=1), (1, 0)) * _factors(len(white))


def _without_step(white: FloatArray, step: int) -> FloatArray:
    """Scores less the means of both parts."""
    without = np.copy(white)
    for part in (without[:step], without[step:]):
        part -= part.mean(axis=0)
    return without


def _long_run_ratio(white: FloatArray) -> FloatArray:
    """Long-run over plain variance of each column, 1 or more: Bartlett's kernel over the cube root of n lags.

    Squared sums of as many consecutive values contain each product of two as often as that kernel weighs it.
    """
    n = len(white)
    many = 1 + max(1, int(np.ceil(n ** (1 / 3))))
    sums = np.cumsum(np.pad(white, ((many, many - 1), (0, 0))), axis=0)
    long_run = ((sums[many:] - sums[:-many]) ** 2).sum(axis=0) / many
    return np.asarray(np.maximum(long_run / (white**2).sum(axis=0), 1.0))


# What changed, and where ----------------------------------------------------------------------------------------------


class _Identified(NamedTuple):
    """What is identified of the residuals: all motions, constant, and some changes.

    Attributes
    ----------
    columns, weighed : list of (n, 3, p) array
        Displacements by all motions, and by the changes; these weighed.
    root : (p, r) array
        Its products with itself are the pseudoinverse of those of the columns.
    coefficients : (p,) array
    left : (n, 3) array
        Residuals less these.
    differences : (n, 3) array
        Of these from those at like poses, whitened.
    """

    columns: list[FloatArray]
    weighed: list[FloatArray]
    root: FloatArray
    coefficients: FloatArray
    left: FloatArray
    differences: FloatArray


def _identified(at: _Readings, courses: Sequence[_Course]) -> _Identified:
    """Once for the same changes."""
    if (found := at.identified.get(tuple(courses))) is not None:
        return found
    columns, weighed, n = [at.together], [at.weighed_together], len(at.rows)
    # What is constant has no differences: by its own size it stays zero.
    gram, size = at.of_constant
    if courses:
        columns.append(np.concatenate([one.over(n)[:, None, None] * at.motions[one.what] for one in courses], axis=2))
        weighed.append(at.weighed(columns[1]))
        across, own = (_products(one, weighed[1]) for one in columns)
        gram = np.block([[gram, across], [across.T, own]])
        size = np.concatenate([size, _products(columns[1] ** 2, at.weights)])
    root = inverse_root(gram, LEAST_EIGENVALUE, size)
    coefficients = root @ (root.T @ np.concatenate([_products(one, at.residuals) for one in weighed]))
    parts = np.split(coefficients, [at.together.shape[2]])
    left = at.residuals - sum(one @ part for one, part in zip(columns, parts, strict=False))
    found = _Identified(columns, weighed, root, coefficients, left, np.sqrt(at.weights) * (at.contrast @ left))
    at.identified[tuple(courses)] = found
    return found


def _without(at: _Readings, courses: list[_Course]) -> FloatArray:
    """Residuals without changes, any constant motion being identified: differences alone do not determine that."""
    if not courses:
        return at.residuals
    constant, changes = at.together, _identified(at, courses)
    residuals = at.residuals - changes.columns[1] @ changes.coefficients[constant.shape[2] :]
    weighted = at.weights[:, :, None] * constant
    root = inverse_root(_products(constant, weighted), LEAST_EIGENVALUE)
    return np.asarray(residuals - constant @ (root @ (root.T @ _products(weighted, residuals))))


def _products(columns: FloatArray, others: FloatArray) -> FloatArray:
    """(p, ...) products of columns (n, 3, p) with others (n, 3, ...)."""
    return np.tensordot(columns, others, axes=((0, 1), (0, 1)))


def _up_to_each(columns: FloatArray, others: FloatArray) -> FloatArray:
    """(p, q, n) products of columns (n, 3, p) up to each reading with others (n, 3, q)."""
    one, other = (np.ascontiguousarray(of.transpose(2, 1, 0)) for of in (columns, others))
    products = np.einsum("pin,qin->pqn", one, other)
    return np.cumsum(products, axis=-1, out=products)


def _best(at: _Readings, others: list[_Course], margin: int, *, steps: bool) -> tuple[_Course, dict[str, FloatArray]]:
    """The most probable kind of step or drift beside other changes, at its likeliest row; log likelihoods by kind.

    Of steps at all rows, of drifts one.
    """
    if (found := at.likelihoods.get((steps, *others))) is None:
        found = at.likelihoods[steps, *others] = _log_likelihoods(at, others, margin, steps=steps)
    best = next(iter(_log_odds(found)))
    return _Course(best, margin + int(np.argmax(found[best])) if steps else 0), found


def _log_odds(likelihoods: dict[str, FloatArray]) -> dict[str, float]:
    """Logarithm of the probability of each kind, the most probable first: any row is as probable as any other."""
    evidence = {what: float(logsumexp(of)) for what, of in likelihoods.items()}
    total = float(logsumexp(list(evidence.values())))
    return {what: of - total for what, of in sorted(evidence.items(), key=lambda one: -one[1])}


def _log_likelihoods(at: _Readings, others: list[_Course], margin: int, *, steps: bool) -> dict[str, FloatArray]:
    """Log likelihoods of a change beside others, by kind; of steps at all rows, of drifts one.

    Beside constant motions it is the same whether a motion is there before or after a step. Of its products with
    itself, with the constant columns and with the residuals sums over the readings before it are enough: those of all
    rows are one cumulated sum.
    """
    n, p, beside = len(at.rows), at.together.shape[2], _identified(at, others)
    square = max(float((beside.differences**2).sum()), np.finfo(float).tiny)
    towards_all = at.contrast.T @ (np.sqrt(at.weights) * beside.differences)
    rest = np.concatenate([*beside.weighed[1:], towards_all[:, :, None]], axis=2)
    if steps:
        cut = slice(margin - 1, n - margin)
        own = {what: of[:, :, cut] for what, of in at.own_products.items()}
        with_constant, with_rest = at.products[:, :, cut], _up_to_each(at.together, rest)[:, :, cut]
    else:
        ramp = np.linspace(0.0, 1.0, n)[:, None, None] * at.together
        of_both = _products(ramp, at.weighed(ramp))[:, :, None]
        own = {what: of_both[of, of] for what, of in at.columns.items()}
        with_constant, with_rest = (_products(ramp, one)[:, :, None] for one in (at.weighed_together, rest))
    taken = np.empty((p, beside.root.shape[1], with_rest.shape[2]))
    constant, changing = np.split(beside.root.T, [p], axis=1)
    for one, all_constant, changes in zip(taken, with_constant, with_rest[:, :-1], strict=True):  # each in the cache
        np.matmul(constant, all_constant, out=one)
        one += changing @ changes
    found = {}
    for what, of in at.columns.items():
        gram = own[what] - np.einsum("pin,qin->pqn", taken[of], taken[of])
        gain = _explained(gram, with_rest[of, -1], np.einsum("ppn->pn", own[what]))
        found[what] = np.maximum(square - gain, 1e-12 * square)
    least = min(found, key=lambda what: float(found[what].min()))
    best = _Course(least, margin + int(np.argmin(found[least])) if steps else 0)
    freedom = _freedom(at, [*others, best])
    return {
        what: -freedom / 2 * np.log(of / square) - at.motions[what].shape[2] / 2 * np.log(n) - steps * np.log(n)
        for what, of in found.items()
    }


def _explained(gram: FloatArray, right: FloatArray, size: FloatArray) -> FloatArray:
    """(n,) squares that motions explain, by their products (k, k, n) and those with the residuals (k, n).

    By elimination; motions of which less than a share of their `size` (k, n) is left explain nothing.
    """
    gain, right = np.zeros(right.shape[1]), right.copy()
    for k, pivot in enumerate(np.einsum("ppn->pn", gram)):
        inverse = np.divide(1.0, pivot, out=np.zeros_like(pivot), where=pivot > LEAST_LEFT * size[k])
        gain += right[k] ** 2 * inverse
        share = gram[k + 1 :, k] * inverse
        right[k + 1 :] -= share * right[k]
        gram[k + 1 :, k + 1 :] -= share[:, None] * gram[k, k + 1 :]
    return gain


def _log_likelihood(at: _Readings, courses: list[_Course], best: list[_Course]) -> float:
    """Of some changes together, less what their motions and rows cost; the noise as it is without the best ones."""
    n, left = len(at.rows), _identified(at, courses).differences
    cost = sum(at.motions[one.what].shape[2] / 2 + (one.step > 0) for one in courses) * np.log(n)
    return float(-_freedom(at, best) / 2 * np.log((left**2).sum()) - cost)


def _freedom(at: _Readings, courses: list[_Course]) -> float:
    """Number of coordinates that are independent, of what some changes leave over on axes that were measured."""
    left = _identified(at, courses).differences[:, (at.weights > 0).any(axis=0)]
    return float((at.weights > 0).any(axis=1).sum() * left.shape[1] / _long_run_ratio(left).mean())


def _describe(
    at: _Readings, found: list[_Course], number: int, margin: int, p_value: float, *, last_row: int
) -> Change:
    """Kind, row and size of a change beside the others: as these show it, so that its odds are of this kind."""
    steps, others = found[number].step > 0, found[:number] + found[number + 1 :]
    course, likelihoods = _best(at, others, margin, steps=steps)
    n, rows, motions = len(at.rows), at.rows, at.motions[course.what]
    odds = {what: float(np.exp(of)) for what, of in _log_odds(likelihoods).items() if np.exp(of) > LEAST_PROBABILITY}
    motion = -_identified(at, [*others, course]).coefficients[-motions.shape[2] :]
    shift = float(np.sqrt(((motions @ motion) ** 2).sum(axis=1).mean()))
    if not steps:
        return Change("drift", course.what, odds, int(rows[n // 2]), int(rows[0]), last_row, shift, motion, p_value)
    below = np.cumsum(np.exp(likelihoods[course.what] - logsumexp(likelihoods[course.what])))
    first, last = (margin + int(np.searchsorted(below, share)) for share in (0.025, 0.975))
    first_row, row, last_row = (
        int(rows[at]) for at in (min(first, course.step), course.step, min(max(last, course.step), n - 1))
    )
    return Change("step", course.what, odds, row, first_row, last_row, shift, motion, p_value)
