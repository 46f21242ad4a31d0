"""The residual process: smooth errors that no term describes, as a Gaussian process over all joints.

Each component of a translation of the tip, along the axes of the arm's base, is a process of its own. Inducing points
make it a group of terms with as many coefficients as points, whose scale the evidence determines like any other
(`truearm.identification.terms.kernel`). Far from the readings the process returns to zero, and its variance to that of
its prior: the arm fades to its other terms, and its uncertainty grows.

Whether the readings show such a process, and with which length scale, is tested before it is identified. With the
residuals r of an identification without it, their weights W, the derivatives J of the tips by the coefficients with
posterior covariance Sigma, and the functions Phi of the process,

    A = Phi^T W Phi - (J^T W Phi)^T Sigma (J^T W Phi),      b = (J^T W Phi)^T Sigma g - Phi^T W r,

the logarithm of the evidence changes by ``(s^2 b^T (I + s^2 A)^-1 b - log|I + s^2 A|) / 2`` if a process of standard
deviation s is added (C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, eqs. 2.43
and 5.8; A.9 and A.10 for the inverse): Sigma contains what the other terms would take over. g is the gradient that the
identification left: rounding where it converged, but a process that resembles its terms would explain every step that
is missing. b is a sum over all readings. Of many, A is that of a sample, times their number over that of the sample,
with a Sigma by the same readings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from truearm.identification.estimation.identification import sample_size, select_evenly
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import MOST_NARROW
from truearm.identification.terms.basis import AXES, Basis
from truearm.identification.terms.kernel import InducedProcess, embedded, inducing_points
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.solve.linear_algebra import covariance_factor
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

GROUP = "residual process"
# Length scales that are tried: of turning joints [rad], of sliding joints in units of their standard deviation.
LENGTH_SCALES = (0.5, 1.0, 2.0)
# Inducing points: each adds three coefficients.
MOST_POINTS = 64
# A process that explains a smaller share of the squared residuals is not worth the time of a second identification:
# the error falls by half of that share.
LEAST_SHARE = 0.05
# Standard deviations of the process that are tried, in units of the noise.
LEAST_SIZE, MOST_SIZE, N_SIZES = 0.01, 10.0, 60


class ProposedProcess(NamedTuple):
    """The terms of a residual process, and by how much it raises the logarithm of the evidence.

    The gain allows for the two numbers that were chosen (G. Schwarz, Ann. Statist. 6 (1978) 461).
    """

    terms: tuple[Term, ...]
    gain: float


def propose_process(fit: IdentificationResult, state: ArmState) -> ProposedProcess | None:
    """Return the residual process of greatest evidence, judged by readings with points.

    Parameters
    ----------
    fit : IdentificationResult
        Without the process.
    state : ArmState
        Of its readings.

    Returns
    -------
    ProposedProcess or None
        None without points, and where it would explain next to nothing: `LEAST_SHARE` of the residuals' squares. Prior
        standard deviations are those of greatest evidence.
    """
    points = next((part for part in fit.references if part.kind == "point"), None)
    if points is None:
        return None
    used = np.flatnonzero(points.robust_weight > 0)
    # A, the costly part, is of a sample. In a small one the other terms take too much over: with eight readings a
    # coefficient a 24th at most. b contains the noise of every reading and is never sampled.
    n_sample = sample_size(len(fit.coefficients))
    # More than half of the readings cost more than all of them, whose covariance is known.
    n_sample = n_sample if 2 * n_sample <= len(used) else len(used)
    chosen = select_evenly(used, n_sample)
    sample = state.rows(points.rows[chosen])
    tried = [_terms(_process(sample, length), 1.0) for length in LENGTH_SCALES]
    bases = [terms[0].basis for terms in tried]
    order = np.concatenate([chosen, np.setdiff1d(used, chosen)])
    with one_blas_thread():
        weights, times = points.weights[:, order], len(used) / len(chosen)
        equations = _equations(
            fit, state.rows(points.rows[order]), bases, weights, points.residuals[:, order], len(chosen), times
        )
        sizes = points.noise_std * np.geomspace(LEAST_SIZE, MOST_SIZE, N_SIZES)
        found = [evidence_gain(*of_process, sizes) for of_process in equations]
    best = int(np.argmax([gain for _, gain, _ in found]))
    size, gain, explained = found[best]
    if explained < LEAST_SHARE * 3 * len(used):
        return None
    # Size and length scale are chosen: half the logarithm of the number of readings each.
    allowance = float(np.log(len(used)))
    return ProposedProcess(tuple(replace(term, prior_std=size) for term in tried[best]), gain - allowance)


def evidence_gain(information: FloatArray, right: FloatArray, sizes: FloatArray) -> tuple[float, float, float]:
    """Return the prior standard deviation of greatest evidence, its gain over none at all, and what it explains.

    Parameters
    ----------
    information, right : (p, p) and (p,) array
        A and b of the module's equation.
    sizes : (k,) array
        Standard deviations that are tried.

    Returns
    -------
    size, gain, explained : float
        The gain of the logarithm of the evidence is negative if each of `sizes` lowers it. Explained is by how much a
        process of this size lowers the sum of the squared residuals, in units of their variances.
    """
    values, axes = np.linalg.eigh(information)
    along, shown = (axes.T @ right) ** 2, sizes[:, None] ** 2 * np.maximum(values, 0.0)
    explained = (sizes[:, None] ** 2 * along / (1 + shown)).sum(axis=1)
    gains = 0.5 * (explained - np.log1p(shown).sum(axis=1))
    best = int(gains.argmax())
    return float(sizes[best]), float(gains[best]), float(explained[best])


def _equations(
    fit: IdentificationResult,
    state: ArmState,
    bases: Sequence[Basis],
    weights: FloatArray,
    residuals: FloatArray,
    n_sample: int,
    times: float,
) -> list[tuple[FloatArray, FloatArray]]:
    """A and b of every process, by points with weights and residuals (3, m); A by a sample, the first, each of `times`.

    The gradient is taken for zero if there are references of other kinds, which would have to be added.
    """
    chain, x = fit.perturbed_chain, fit.coefficients
    p, stops, axes = len(x), np.cumsum([basis.n_functions for basis in bases]), chain.chain.fixed[0, :3, :3].T
    gradient, right, across = x / fit.prior_std**2, np.zeros((3, stops[-1])), np.zeros((p, 3, stops[-1]))
    # All coefficients of sites with few functions together, then site by site: columns of one stay in the cache.
    site_of, row_of = chain.of_coefficient
    wide = [(site.columns, site.rows, i) for i, site in enumerate(chain.sites) if len(site.columns) > MOST_NARROW]
    narrow = np.flatnonzero(~np.isin(site_of, [i for _, _, i in wide]))
    parts = [(narrow, row_of[narrow], site_of[narrow]), *wide]
    information = [np.zeros((3, basis.n_functions, 3, basis.n_functions)) for basis in bases]
    for rows, _, along_sites, of_chain in chain.site_derivatives(state, x):
        values = np.concatenate([basis.values(state.rows(rows)) for basis in bases])
        squared = weights[:, rows] ** 2
        weighted = squared * residuals[:, rows]
        right -= axes @ weighted @ values.T
        pulled = np.einsum("scm,cm->sm", along_sites, weighted)
        for which, functions, sites in parts:
            gradient[which] += np.einsum("...m,...m->...", of_chain[functions], pulled[sites])
        if rows.start >= n_sample:
            continue
        squared[:, max(n_sample - rows.start, 0) :] = 0.0
        # Products need no more digits than this, and take half the time with them.
        single = values.astype(np.float32)
        by_axis = np.matmul(axes, along_sites * squared).astype(np.float32)  # before the functions: fewer
        for which, functions, sites in parts:
            columns = of_chain[functions].astype(np.float32)[:, None] * by_axis[sites]
            products = columns.reshape(-1, columns.shape[2]) @ single.T
            across[which] += products.reshape(-1, 3, products.shape[1])
        for axis, other in combinations_with_replacement(range(3), 2):
            of_both = ((axes[axis] * axes[other]) @ squared).astype(np.float32)
            for own, value in zip(information, np.split(single, stops[:-1]), strict=True):
                block = (of_both * value) @ value.T
                own[axis, :, other] += block
                if other > axis:  # symmetric, as the product is
                    own[other, :, axis] += block
    if len(fit.references) > 1:
        gradient[:] = 0.0
    # With the covariance by all readings A would not be that of a least squares fit, and could be negative. References
    # of other kinds are left out: the other terms take over rather more.
    sample = slice(n_sample)
    times_root: Callable[[FloatArray], FloatArray] = fit.covariance_root.times_matrix
    if times != 1:
        precision = _precision(fit, state.rows(sample), weights[:, sample], times)
        times_root = partial(np.matmul, covariance_factor(np.asarray(np.linalg.inv(precision), dtype=float)))
    along, found = times_root(gradient[:, None])[:, 0], []
    for own, pull, by in zip(
        information, np.split(right, stops[:-1], axis=1), np.split(across, stops[:-1], axis=2), strict=True
    ):
        taken_over = times_root(by.reshape(p, -1))
        reduced = times * (own.reshape(taken_over.shape[1], -1) - times * taken_over.T @ taken_over)
        found.append((reduced, pull.ravel() + times * along @ taken_over))
    return found


def _precision(fit: IdentificationResult, sample: ArmState, weights: FloatArray, times: float) -> FloatArray:
    """Of the coefficients, by the points of the sample."""
    precision = np.diag(fit.prior_std**-2.0)
    for rows, _, columns in fit.perturbed_chain.derivatives(sample, fit.coefficients):
        weighted = (columns * weights[:, rows]).reshape(len(columns), -1)
        precision += times * weighted @ weighted.T
    return precision


def _terms(basis: InducedProcess, std: float) -> tuple[Term, ...]:
    """A process of each component of a translation, along the axes of the base."""
    return tuple(
        Term(
            f"residual process along {AXES[axis]}", 0, tuple(float(i == 3 + axis) for i in range(6)), basis, GROUP, std
        )
        for axis in range(3)
    )


def _process(state: ArmState, length: float) -> InducedProcess:
    """A process with inducing points among the readings of a state."""
    sliding = state.chain.is_prismatic
    spread = state.angles.std(axis=0)
    scales = np.where(sliding, length * np.where(spread > 0, spread, 1.0), length)
    rows = inducing_points(embedded(state.angles, scales, sliding), MOST_POINTS)
    joints = np.flatnonzero(sliding) + 1
    return InducedProcess(tuple(state.angles[rows].ravel().tolist()), tuple(scales.tolist()), tuple(joints.tolist()))
