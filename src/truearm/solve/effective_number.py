"""How many independent readings correlated ones are worth: the design effect, by sums over blocks.

Consecutive readings of a moving arm have residuals alike. The covariance of a sum over them, such as the gradient of
a least-squares cost, is then larger than that of as many independent ones, by the design effect (L. Kish, "Survey
Sampling", 1965, section 8.2). Sums over blocks of consecutive readings are nearly independent of each other if the
blocks are much longer than the correlation; the length follows from the readings: blocks are joined in pairs until the
effect no longer grows (H. Flyvbjerg, H. G. Petersen, "Error estimates on averages of correlated data", J. Chem. Phys.
91 (1989) 461). Of a gradient it includes how the derivatives change along the readings (K.-Y. Liang, S. L. Zeger,
"Longitudinal data analysis using generalized linear models", Biometrika 73 (1986) 13).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.typing import FloatArray, IntArray

# Consecutive readings of the shortest block.
BLOCK = 1024
# With fewer blocks their scatter is not known.
LEAST_BLOCKS = 8
# Growth from one length to its double that counts, in standard errors.
SIGNIFICANT = 2.0


@dataclass(frozen=True)
class DesignEffect:
    """Factor on the covariance of independent readings.

    Attributes
    ----------
    factor : float
        1 or more: n readings are worth n / factor independent ones.
    n_block : int
        Consecutive readings of the blocks from which it follows.
    is_settled : bool
        Whether longer blocks would show no more; otherwise there are too few, and the factor may be larger.
    """

    factor: float
    n_block: int
    is_settled: bool


def design_effect(scores: FloatArray, covariance: FloatArray, n_readings: int) -> DesignEffect:
    """Design effect of estimates whose gradient is a sum of scores.

    Parameters
    ----------
    scores : (n_blocks, p) array
        Sums over blocks of about equal numbers of consecutive readings, in their order.
    covariance : (p, p) array
        Of the estimates, if readings were independent; it may contain a weak prior.
    n_readings : int
        In all blocks.
    """
    scores = scores - scores.mean(axis=0)
    n_estimates = len(covariance)
    length = n_readings / max(len(scores), 1)
    factor, error, n_block = 1.0, np.inf, length
    while len(scores) >= LEAST_BLOCKS:
        n = len(scores)
        total = float(np.einsum("bi,ij,bj->", scores, covariance, scores))
        longer = total / n_estimates * n / (n - 1)
        own_error = longer * np.sqrt(2 / (n * n_estimates))
        if longer - factor < SIGNIFICANT * own_error and np.isfinite(error):
            return DesignEffect(max(factor, longer, 1.0), round(n_block), True)
        factor, error, n_block = longer, own_error, length
        pairs = scores[: n // 2 * 2]
        scores, length = pairs[::2] + pairs[1::2], 2 * length
    return DesignEffect(max(factor, 1.0), round(n_block), False)


def block_starts(n: int) -> IntArray:
    """First rows of the blocks of n consecutive readings: of `BLOCK` each, the last of up to twice as many."""
    return np.arange(0, max(n - BLOCK + 1, 1), BLOCK)
