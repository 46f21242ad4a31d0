"""Scales of the groups of terms: by evidence on a linearisation, and which groups readings cannot show.

The prior scale of every group maximises the evidence, a few updates in each round of an identification. Three rules
drop groups: invisible ones, fast ones that the evidence prunes, and at the end those that are negligible at any pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms.basis import Harmonics
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.solve.group_evidence import (
    GroupedEquations,
    GroupedPrior,
    LowRankPosterior,
    Posterior,
    prune_groups,
    update_scales,
)
from truearm.typing import BoolArray, FloatArray, IntArray

# Rounds of the evidence on one linearisation, at most, of as many as cost less than it: with p coefficients one costs
# about as much as the products of so many times p residuals, and a linearisation never less than that of so many. One
# that costs more than two of these is left to the next round, which needs it anyway.
MOST_SCALE_ROUNDS, RESIDUALS_OF_A_ROUND, LEAST_RESIDUALS, LEAST_AFFORDABLE = 20, 20, 10_000, 0.5
# Scales have converged when none changes by a larger share; a scale is known to some tens of per cent at best.
SETTLED_SCALES = 1e-2
# Groups of fewer effective parameters are not considered for that.
LEAST_EFFECTIVE = 0.1
# A group is invisible if its prior size is a smaller share of the noise, root mean square, and if it moves all
# residuals together by less than one standard deviation.
INVISIBLE, INVISIBLE_IN_ALL = 0.02, 1.0
MOST_LOG_RAISED = 1.0
# Groups are negligible if together they would move all residuals by less than this many standard deviations, were these
# at so many random poses.
NEGLIGIBLE_IN_ALL, NEGLIGIBLE_POSES = 1.0, 100
# The prior of a group's scale has a spread of a factor of five, as arms differ by as much, and a maximum of ten: larger
# terms imitate missing ones. Harmonics up to 16 alone would explain some higher ones of a UR10 by radians that nearly
# cancel at the readings, and miss others by 20 mm.
LOG_SPREAD = float(np.log(5.0))
LEAST_SCALE, MOST_SCALE = 1e-4, 10.0


def without_invisible(prior: GroupedPrior, diagonal: FloatArray, n_residuals: int) -> GroupedPrior:
    """Prune groups that are invisible at their prior size, for example harmonics of a joint whose axis meets the tip.

    The evidence would scale them up without limit, until they are visible.
    """
    in_all = np.sqrt(prior.group_sums(prior.ratio**2 * diagonal))
    hidden = (in_all < INVISIBLE * np.sqrt(n_residuals)) & (in_all < INVISIBLE_IN_ALL)
    return replace(prior, scale=np.where(prior.learned & hidden, 0.0, prior.scale))


def is_fast(terms: Sequence[Term], groups: tuple[str, ...], state: ArmState) -> BoolArray:
    """(n_groups,) groups of which every function went through a period or more in the readings, the unknowns' too.

    Only these are pruned by evidence. What they do elsewhere they do in the readings as well, where it is part of the
    residual variance if they are pruned. Slower functions grow beyond the readings: a zero size would state there that
    nothing is unknown.
    """
    fast = dict.fromkeys(groups, True)
    for term in terms:
        basis = term.basis
        fast[term.group] &= isinstance(basis, Harmonics) and bool(
            basis.orders[0] * np.ptp(state.joint_angles[:, basis.joint - 1]) >= 2 * np.pi
        )
    return np.array([*fast.values(), False])


def with_uncertain_scales(prior: GroupedPrior, effective: FloatArray) -> GroupedPrior:
    """Raise learned scales from the most probable value to the root mean square.

    gamma coefficients determine the logarithm of their scale with the information 2 gamma, its prior adds
    1 / `LOG_SPREAD`^2; a lognormal scale of variance v has the root mean square exp(v) times its mode in the logarithm.
    """
    variance = np.minimum(1 / (2 * effective + LOG_SPREAD**-2.0), MOST_LOG_RAISED)
    raised = np.minimum(prior.scale * np.exp(variance), np.maximum(MOST_SCALE, prior.scale))
    return replace(prior, scale=np.where(prior.learned, raised, prior.scale))


def without_negligible(
    prior: GroupedPrior, perturbed_chain: PerturbedChain, state: ArmState, noise_std: float, n_residuals: int
) -> GroupedPrior:
    """Drop groups that could not be seen in these many residuals, wherever the joints are.

    The scale of a group that the readings do not show becomes as small as they require, and what it may still do at
    other poses belongs to the uncertainty there. Only its prior size decides, not a comparison of evidence: where that
    is close, a small change of the readings would change the model.
    """
    rng, sample = np.random.default_rng(0), np.linspace(0, len(state) - 1, NEGLIGIBLE_POSES).astype(np.intp)
    chain = perturbed_chain.chain
    anywhere = rng.uniform(-np.pi, np.pi, (NEGLIGIBLE_POSES, chain.n_joints))
    there = state.rows(sample)
    there = replace(there, angles=np.where(chain.is_prismatic, there.angles, anywhere))
    squares = np.zeros(len(prior.ratio))
    n = perturbed_chain.n_coefficients
    for _, _, columns in perturbed_chain.derivatives(there, np.zeros(n)):
        squares[:n] += (columns**2).sum(axis=(1, 2)) / (3 * NEGLIGIBLE_POSES)
    size = prior.group_sums(squares * (prior.ratio * prior.scale[prior.group]) ** 2) / noise_std**2
    size[~prior.learned] = np.inf
    smallest = np.argsort(size)
    scale = prior.scale.copy()
    scale[smallest[np.cumsum(size[smallest]) < NEGLIGIBLE_IN_ALL**2 / max(n_residuals, 1)]] = 0.0
    return replace(prior, scale=scale)


class WeighedEvidence(NamedTuple):
    """Posterior of a linearisation under scales near those of maximum evidence.

    Attributes
    ----------
    prior : GroupedPrior
        The prior of the posterior.
    next : GroupedPrior
        One update further, to begin the next round with.
    posterior : Posterior or LowRankPosterior
        Of the kept parameters under `prior`.
    effective : (n_groups,) array
        Number of parameters of every group that the data determine.
    """

    prior: GroupedPrior
    next: GroupedPrior
    posterior: Posterior | LowRankPosterior
    effective: FloatArray


def scale_rounds(n_coefficients: int, n_residuals: int, *, is_first: bool, is_calm: bool) -> int:
    """Rounds of the evidence on a linearisation, before its step.

    No more than one while the noise still changes, as the scales follow it from one linearisation to the next; but one
    at first, where all groups are as large as arms may have them, and would explain noise.
    """
    affordable = max(n_residuals, LEAST_RESIDUALS) / (RESIDUALS_OF_A_ROUND * max(n_coefficients, 1))
    least = int(is_first or (is_calm and affordable >= LEAST_AFFORDABLE))
    return min(max(int(affordable), least), MOST_SCALE_ROUNDS if is_calm else 1)


def weigh_evidence(
    equations: GroupedEquations, kept: IntArray, prior: GroupedPrior, prunable: BoolArray, *, rounds: int
) -> WeighedEvidence:
    """Some rounds towards the scales of maximum evidence on a linearisation.

    Groups that are `prunable` (n_groups,) get scale 0, and keep it, where the evidence is larger without them.
    """
    of_kept = prior.subset(kept)
    bounds = {"log_spread": LOG_SPREAD, "least": LEAST_SCALE, "most": MOST_SCALE}
    known = equations.posterior(of_kept)
    scale, effective = update_scales(of_kept, known, **bounds)
    for _ in range(rounds):
        counted = effective > LEAST_EFFECTIVE
        change = np.abs(scale - of_kept.scale)[counted] / of_kept.scale[counted]
        of_kept = replace(of_kept, scale=scale)
        known = equations.posterior(of_kept)
        scale, effective = update_scales(of_kept, known, **bounds)
        if change.max(initial=0.0) < SETTLED_SCALES:
            break
    if (prunable & prior.learned & (of_kept.scale > 0)).any():
        pruned = prune_groups(of_kept, known, prunable, log_spread=LOG_SPREAD)
        if (pruned.scale < of_kept.scale).any():
            of_kept = pruned
            known = equations.posterior(of_kept)
            scale, effective = update_scales(of_kept, known, **bounds)
    return WeighedEvidence(replace(prior, scale=of_kept.scale), replace(prior, scale=scale), known, effective)
