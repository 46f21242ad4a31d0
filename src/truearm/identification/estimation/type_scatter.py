"""Mean and scatter of the constants of a type of arm, from the readings of several arms: empirical Bayes.

The constants x_i of arm i are normally distributed about the mean m of their type, each with its own scatter t_j, and
the readings of the arm have the normal equations ``G_i x_i = b_i``, from which base, tip and all else that is of one
arm alone were eliminated: G_i is singular along what they do not determine. With ``C_i = (G_i + T^-1)^-1``,
``T = diag t_j^2``, the mean has the precision ``S^-1 + sum of (G_i - G_i C_i G_i)`` and the right side ``sum of (b_i -
G_i C_i b_i)``. T and S, the size of the means, maximise the marginal likelihood by the EM algorithm: each variance is
the expected mean square of what it describes.

Few arms do not determine a scatter of each constant: it shrinks towards the geometric mean of its group of constants,
as if that had been seen in `PSEUDO_ARMS` further arms. Where no arm has readings that determine a constant, its mean
is zero, the nominal arm, and its scatter that of its group.

Source: N. M. Laird, J. H. Ware, "Random-effects models for longitudinal data", Biometrics 38 (1982) 963; the shrinkage:
A. Gelman, "Prior distributions for variance parameters in hierarchical models", Bayesian Analysis 1 (2006) 515.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from truearm.identification.estimation.group_scales import weigh_evidence
from truearm.identification.estimation.identification import grouped_prior, initial_problem
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.linearisation import eliminate_unknowns, linearised
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.references import Reference
from truearm.identification.terms import ArmState, Term
from truearm.solve.group_evidence import GroupedEquations
from truearm.solve.linear_algebra import unit_diagonal
from truearm.typing import BoolArray, FloatArray

PSEUDO_ARMS = 2.0
MOST_ROUNDS, SETTLED = 500, 1e-3
# Scatter and means to begin with, and their bounds, as shares of the prior standard deviations.
START, LEAST, MOST = 0.3, 1e-4, 10.0
EVIDENCE_ROUNDS, SCALE_ROUNDS = 5, 20


@dataclass(frozen=True, eq=False)
class ReadingEquations:
    """The sum of squares of weighted residuals about an identified arm, to first order: ``x G x - 2 b x + c``.

    Attributes
    ----------
    terms : tuple of Term
        With p coefficients x.
    gram : (p, p) array
        G.
    right : (p,) array
        b.
    constant : float
        c.
    n_residuals : int
    """

    terms: tuple[Term, ...]
    gram: FloatArray
    right: FloatArray
    constant: float
    n_residuals: int

    @classmethod
    def of(
        cls,
        fit: IdentificationResult,
        offered: Sequence[Term],
        state: ArmState,
        references: Sequence[Reference],
        used: BoolArray,
    ) -> Self:
        """Those of some readings, `used` (n,), from which an arm was identified, without unknowns of artefacts.

        The terms `offered` come first, those that were pruned among them.
        """
        identified = fit.perturbed_chain
        known = {term: fit.coefficients[own] for term, own in zip(identified.terms, identified.columns, strict=True)}
        chain = PerturbedChain(identified.chain, tuple(dict.fromkeys([*offered, *known])))
        problem, _ = initial_problem(chain, state, references)
        x = np.concatenate(
            [
                *(known.get(term, np.zeros(term.n_coefficients)) for term in chain.terms),
                fit.parameters[len(fit.coefficients) :],
            ]
        )
        n = chain.n_coefficients
        weights = [part.weights * used[part.rows] for part in fit.references]
        parts, whole = linearised(problem, x, weights)
        reduced = eliminate_unknowns(parts, whole, x)
        at = x[reduced.kept]
        right = reduced.gram @ at - reduced.gradient
        constant = 2 * whole.cost - reduced.gain - 2 * reduced.gradient @ at + at @ reduced.gram @ at
        # What remains of the unknowns, lengths of artefacts, stays as it was identified.
        along = reduced.gram[:n, n:] @ at[n:]
        constant += at[n:] @ reduced.gram[n:, n:] @ at[n:] - 2 * right[n:] @ at[n:]
        n_residuals = sum(int((w > 0).sum()) for w in weights)
        return cls(chain.terms, reduced.gram[:n, :n], right[:n] - along, float(constant), n_residuals)

    def __add__(self, other: ReadingEquations) -> ReadingEquations:
        return replace(
            self,
            gram=self.gram + other.gram,
            right=self.right + other.right,
            constant=self.constant + other.constant,
            n_residuals=self.n_residuals + other.n_residuals,
        )

    def square(self, x: FloatArray) -> float:
        """Sum of the squares of the residuals at coefficients x (p,)."""
        return float(self.constant + x @ self.gram @ x - 2 * self.right @ x)

    def of_terms(self, which: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and right side of some of the coefficients, the others integrated out with their priors."""
        other, gram = ~which, self.gram
        matrix = gram[np.ix_(other, other)] + np.diag(_prior_std(self.terms)[other] ** -2.0)
        unit, scale = unit_diagonal(matrix)
        across = gram[np.ix_(other, which)] / scale[:, None]
        solved = cho_solve(cho_factor(unit), np.column_stack([across, self.right[other] / scale]))
        reduced = gram[np.ix_(which, which)] - across.T @ solved[:, :-1]
        return (reduced + reduced.T) / 2, self.right[which] - across.T @ solved[:, -1]

    def most_probable(self, terms: Sequence[Term], mean: FloatArray) -> FloatArray:
        """(p,) coefficients under the priors of `terms` about a mean (p,), with scales of the groups by evidence."""
        prior, groups = grouped_prior(terms, 0)
        right = self.right - self.gram @ mean
        equations = GroupedEquations(self.gram, right, self.gram.diagonal().copy(), self.n_residuals)
        kept, prunable = np.arange(len(right)), np.zeros(len(groups) + 1, dtype=bool)
        for _ in range(EVIDENCE_ROUNDS):
            found = weigh_evidence(equations, kept, prior, prunable, rounds=SCALE_ROUNDS)
            prior = found.next
        return np.asarray(mean + found.posterior.x)


class TypeScatter(NamedTuple):
    """Constants of a type.

    Attributes
    ----------
    mean, std : (p,) array
        [rad, mm].
    mean_std : (p,) array
        Standard uncertainty of the mean.
    """

    mean: FloatArray
    std: FloatArray
    mean_std: FloatArray

    @property
    def arm_std(self) -> FloatArray:
        """(p,) standard deviations of an arm's constants about the mean, uncertain as that is [rad, mm]."""
        return np.hypot(self.std, self.mean_std)


def type_scatter(
    arms: Sequence[tuple[FloatArray, FloatArray]], terms: Sequence[Term], *, start: TypeScatter | None = None
) -> TypeScatter:
    """Mean and scatter of the constants of a type.

    Parameters
    ----------
    arms : sequence of (gram, right)
        Normal equations (p, p), (p,) of each arm.
    terms : sequence of Term
        The p constants; scatter shrinks within their groups.
    start : TypeScatter, optional
        Of nearly the same arms: fewer rounds are needed from there.
    """
    unit, names = _prior_std(terms), np.array([term.group for term in terms])
    groups = [np.flatnonzero(names == name) for name in dict.fromkeys(names.tolist())]
    grams = np.stack([gram for gram, _ in arms]) * unit * unit[:, None]
    rights = np.stack([right for _, right in arms]) * unit
    n, p = rights.shape
    # Variances in units of the prior.
    scatter, size = np.full(p, START**2) if start is None else (start.std / unit) ** 2, np.ones(p)
    for _ in range(MOST_ROUNDS):
        root = np.sqrt(scatter)
        covariances = root * np.linalg.inv(root * grams * root[:, None] + np.eye(p)) * root[:, None]
        gains = grams @ covariances
        precision = (grams - gains @ grams).sum(axis=0) + np.diag(1 / size)
        of_mean = np.linalg.inv((precision + precision.T) / 2)
        mean = of_mean @ (rights - (gains @ rights[:, :, None])[:, :, 0]).sum(axis=0)
        off = (covariances @ (rights - grams @ mean)[:, :, None])[:, :, 0]
        variance = np.einsum("nii->ni", covariances) + ((of_mean @ gains) * gains).sum(axis=1)
        squares, before = (off**2 + variance).sum(axis=0), scatter
        scatter, size = np.empty(p), np.empty(p)
        for own in groups:
            shared = np.exp(np.log(before[own]).mean())
            scatter[own] = np.clip((squares[own] + PSEUDO_ARMS * shared) / (n + PSEUDO_ARMS), LEAST**2, MOST**2)
            size[own] = np.clip((mean[own] ** 2 + of_mean.diagonal()[own]).mean(), LEAST**2, MOST**2)
        if np.abs(np.log(scatter / before)).max() < SETTLED:
            break
    return TypeScatter(mean * unit, np.sqrt(scatter) * unit, np.sqrt(of_mean.diagonal()) * unit)


def _prior_std(terms: Sequence[Term]) -> FloatArray:
    return np.concatenate([term.prior_stds for term in terms])
