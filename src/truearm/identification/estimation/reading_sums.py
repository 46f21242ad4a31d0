"""Sums over the points of a session that determine an arm: parts of a session are added, in their order.

At given parameters x the normal equations ``J^T W J``, ``J^T W r`` are sums over readings, and so is all else that an
identification needs of them. A session of any length is then identified in a few passes, with the memory of one part,
and parts may be summed anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import reduce
from itertools import pairwise, starmap

import numpy as np

from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import GaussNewtonSums
from truearm.identification.estimation.residual_variance import (
    FLOOR_MM2,
    expected_clipped_square,
    huber_threshold_squared,
    huber_weights,
)
from truearm.identification.references.references import Points
from truearm.identification.terms.state import ArmState
from truearm.solve.group_evidence import GroupedPrior, Posterior, determined_shares, posterior
from truearm.solve.sums import DesignEffect, Sums, block_starts, design_effect, joined, one_below_the_other
from truearm.typing import FloatArray, IntArray

# Noise variances, relative to the one assumed, at which whitened residuals are summed: the noise is found between them.
TRIAL_NOISE = np.array([1e-3, 0.1, 0.25, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 4.0, 10.0])


@dataclass(frozen=True, eq=False)
class ReadingSums(Sums):
    """Sums over points at parameters of p coefficients.

    Attributes
    ----------
    n : int
        Points, without gross errors.
    n_gross : int
        Gross errors: they take no part.
    gram : (p, p) array
        ``J^T W J``.
    gradient : (p,) array
        ``J^T W r``.
    clipped : (k,) array
        Squared whitened lengths at `TRIAL_NOISE`, clipped as in `paule_mandel_variance`.
    scores : (n_blocks, p) array
        The gradient of blocks of consecutive readings.
    """

    n: int
    n_gross: int
    gram: FloatArray
    gradient: FloatArray
    clipped: FloatArray
    scores: FloatArray = field(metadata=joined(one_below_the_other))

    @classmethod
    def zero(cls, p: int) -> ReadingSums:
        """Of no reading."""
        return cls(0, 0, np.zeros((p, p)), np.zeros(p), np.zeros(len(TRIAL_NOISE)), np.zeros((0, p)))

    @classmethod
    def of(
        cls,
        chain: PerturbedChain,
        state: ArmState,
        points: Points,
        x: FloatArray,
        noise_mm2: float,
        gross_limit: float,
        n_session: int | None = None,
    ) -> tuple[ReadingSums, IntArray]:
        """Sums over points, and which of them are gross errors.

        Parameters
        ----------
        chain : PerturbedChain
        state : ArmState
            Of the readings.
        points : Points
            Of all readings.
        x : (p,) array
            Coefficients.
        noise_mm2 : float
            Variance of a residual beyond the stated uncertainty.
        gross_limit : float
            Whitened length from which a reading is a gross error.
        n_session : int, optional
            Readings of the session, of which these are a part (`block_starts`).
        """
        most, n = huber_threshold_squared(3), len(state)
        equations, clipped, scores, gross_rows = GaussNewtonSums(chain, 0, n), np.zeros(len(TRIAL_NOISE)), [], []
        starts = block_starts(n, n_session).tolist()
        for block in starmap(slice, pairwise([*starts, n])):
            equations.gradient[:] = 0.0
            within = state.rows(block)
            for some, tips, along_sites, values in chain.site_derivatives(within, x):
                rows = np.arange(n)[block][some]
                residuals, known = tips - points.points[rows].T, points.std[:, rows] ** 2
                squares, variance = residuals**2, known + noise_mm2
                is_gross = (squares / variance).sum(axis=0) > gross_limit**2
                robust = np.where(is_gross, 0.0, huber_weights(residuals.T, variance.T))
                of_repeats = 0.0 if points.repeat_variance is None else points.repeat_variance[rows]
                weights = np.sqrt(robust / (variance + of_repeats))
                equations.add(residuals * weights, along_sites * weights, values, within.joint_angles[some])
                squares, known = squares[:, ~is_gross], known[:, ~is_gross]
                trials = known + noise_mm2 * TRIAL_NOISE[:, None, None]
                clipped += np.minimum((squares / trials).sum(axis=1), most).sum(axis=1)
                gross_rows.append(rows[is_gross])
            scores.append(equations.gradient[np.argsort(equations.order)])
        gross = np.concatenate(gross_rows)
        gradient, gram = reduce(np.add, scores), equations.equations().head
        return cls(n - len(gross), len(gross), gram, gradient, clipped, np.array(scores)), gross

    def without(self, part: ReadingSums) -> ReadingSums:
        """Sums over the readings that are not in a part; all scores."""
        less = {one.name: getattr(self, one.name) - getattr(part, one.name) for one in fields(self)[:-1]}
        return ReadingSums(**less, scores=self.scores)

    def posterior(self, x: FloatArray, prior_std: FloatArray, which: IntArray) -> Posterior:
        """Posterior of some coefficients, about zero like their prior, were the readings independent.

        The others are fixed at `x`, where the sums are.
        """
        gram, n = self.gram[np.ix_(which, which)], len(which)
        prior = GroupedPrior(prior_std[which], np.zeros(n, np.intp), np.ones(1), np.zeros(1, bool))
        return posterior(gram, gram @ x[which] - self.gradient[which], prior)

    def effect(self, independent: Posterior, prior_std: FloatArray, which: IntArray) -> DesignEffect:
        """By how much correlated readings are worth less for these coefficients."""
        determined = float(determined_shares(independent.variance, prior_std[which] ** -2.0).sum())
        return design_effect(self.scores[:, which], independent.covariance, self.n, determined)

    def correlated(
        self, independent: Posterior, prior_std: FloatArray, which: IntArray, repeated: FloatArray | None = None
    ) -> tuple[FloatArray, DesignEffect]:
        """Covariance of these coefficients by readings that are correlated, and by how much they are.

        With S the covariance of the gradient, P that of the coefficients by independent readings and L one over the
        prior's variances, it is ``P (S + L) P`` (P. J. Huber, Proc. 5th Berkeley Symp. 1 (1967) 221). S is the design
        effect times ``J^T W J``, and in directions where blocks scatter more, more: as much of it as their number
        allows to know. Errors that come back with the poses add a `repeated` covariance (p, p) to S, less what blocks
        show of it on average: of two readings of a pose that are in one block.
        """
        precision, root = prior_std[which] ** -2.0, independent.root
        effect = self.effect(independent, prior_std, which)
        determined = float(determined_shares(independent.variance, precision).sum())
        gram = self.gram[np.ix_(which, which)]
        sizes, directions = np.linalg.eigh(root @ (effect.scatter - effect.factor * gram) @ root.T)
        sizes = np.maximum(sizes, 0.0) * effect.n_blocks / (effect.n_blocks + determined)
        alike = effect.factor * gram + np.diag(precision)
        if repeated is not None:
            repeated = repeated[np.ix_(which, which)]
            more, shown = float((repeated * independent.covariance).sum()) / determined, effect.factor - 1
            if more > shown:
                alike += (1 - shown / more) * repeated
                effect = replace(effect, factor=1 + more, is_by_poses=True)
        middle = root @ alike @ root.T + (directions * sizes) @ directions.T
        covariance = root.T @ middle @ root
        return np.asarray((covariance + covariance.T) / 2), effect

    def noise_mm2(self, assumed: float, n_effective: float) -> float:
        """Variance of a residual as `paule_mandel_variance` estimates it, between the trials about an assumed one."""
        freedom = max(expected_clipped_square(3) * self.n - n_effective, 1e-3 * self.n)
        falling = np.log(np.maximum(self.clipped[::-1], 1e-300))
        trial = np.exp(np.interp(np.log(freedom), falling, np.log(TRIAL_NOISE[::-1])))
        return max(assumed * float(trial), FLOOR_MM2)
