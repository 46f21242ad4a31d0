"""Readings that lie far from where an identified arm expects them, and known lengths that are far from what it finds.

A length counts with its certificate's uncertainty and bends the arm to it, however wrong it is; its residual, and those
of the others, then say little. So each is judged by what is found without it, in closed form: with the whitened
residuals r of the constraints and their whitened covariance S under the posterior, ``(I - S)^-1 r`` of those left out
(`truearm.identification.estimation.cross_validation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from truearm.identification.estimation.identification import (
    UNKNOWN_STD,
    IdentificationResult,
    eliminate_unknowns,
    initial_problem,
    linearised,
)
from truearm.identification.estimation.references import Reference
from truearm.identification.terms.state import ArmState
from truearm.readings.session import Session
from truearm.solve.group_evidence import GroupedPrior, posterior
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray

# A reading that counts less than this has a residual of twice the length from which weights fall.
LEAST_TRUST = 0.5
# Standard deviations by which a known length may miss what is found without it.
MAX_NORMALIZED_RESIDUAL = 4.0
# Share of a length's variance that must be left without it for anything but itself to tell of it.
LEAST_LEFT = 1e-8


@dataclass(frozen=True)
class Outlier:
    """A reading, or a known length, whose residual is too large for its uncertainty.

    Attributes
    ----------
    name : str
        What it is: "line 3777" of a file, "reading 12" without one, "length between seats A and B".
    error_mm : float
        Of a reading the length of its residual; of a known length the stated value less the one implied by all other
        data [mm].
    normalized_residual : float
        The error over its standard deviation; of a reading over the root mean square expected of its residual.
    kind : str
        The kind of reference that it contradicts: point, seat, ...; "prediction" for a reading that a model does not
        fit, "length" for a length.
    row : int or None
        Row of the reading, counted from 0; None for a length.
    line : int or None
        Line of the reading in its file, counted from 1; None without a file.
    """

    name: str
    error_mm: float
    normalized_residual: float
    kind: str
    row: int | None = None
    line: int | None = None

    def __str__(self) -> str:
        return f"{self.name}, error {self.error_mm:.3f} mm, normalized residual {self.normalized_residual:.0f}"

    @classmethod
    def of_reading(cls, row: int, error_mm: float, normalized_residual: float, *, kind: str) -> Self:
        """A reading, by its row."""
        return cls(f"reading {row + 1}", error_mm, normalized_residual, kind, row)

    def located(self, session: Session, rows: IntArray | None = None) -> Outlier:
        """The same with its line in the file of a session; `rows` are the rows of the session that were used."""
        assert self.row is not None
        row = self.row if rows is None else int(rows[self.row])
        line = session.line_of(row)
        return replace(self, name=session.called(row), row=row, line=line)


def outliers(fit: IdentificationResult) -> list[Outlier]:
    """Readings whose robust weight is below one half, the farthest first."""
    found = []
    for reference in fit.references:
        if reference.residuals.shape[1] == 0:
            continue
        variance = reference.std**2 + reference.noise_std**2
        length = np.linalg.norm(reference.residuals, axis=0)
        normalized = np.sqrt((reference.residuals**2 / variance).mean(axis=0))
        found += [
            Outlier.of_reading(int(reference.rows[i]), float(length[i]), float(normalized[i]), kind=reference.kind)
            for i in np.flatnonzero(reference.robust_weight < LEAST_TRUST)
        ]
    return sorted(found, key=lambda outlier: -outlier.normalized_residual)


class ConstraintResiduals(NamedTuple):
    """What an identified arm says of constraints among its references' unknowns.

    Attributes
    ----------
    names : tuple of str
    residuals : (l,) array
        Found less stated [mm].
    std : (l,) array
        Standard uncertainties of what is stated [mm].
    covariance : (l, l) array
        Of the residuals, by the posterior [mm^2].
    values : (l, 2) array
        As found and as stated [mm].
    """

    names: tuple[str, ...]
    residuals: FloatArray
    std: FloatArray
    covariance: FloatArray
    values: FloatArray


def length_outliers(fit: IdentificationResult, state: ArmState, references: Sequence[Reference]) -> list[Outlier]:
    """Known lengths and distances that miss what is found without them by more than `MAX_NORMALIZED_RESIDUAL`, the worst first.

    The worst is left out before the others are judged, as it bends the arm for them too; and so on.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of the readings it was identified from.
    references : sequence of Reference
        From which it was identified.
    """
    told = constraint_residuals(fit, state, references, references)
    if told is None:
        return []
    r, S = told.residuals / told.std, told.covariance / np.outer(told.std, told.std)
    found: list[Outlier] = []
    kept = np.arange(len(r))
    while len(kept):
        left = 1 - S.diagonal()
        normalized = np.where(left > LEAST_LEFT, np.abs(r) / np.sqrt(np.maximum(left, LEAST_LEFT)), 0.0)
        worst = int(np.argmax(normalized))
        if not normalized[worst] > MAX_NORMALIZED_RESIDUAL:
            break
        error = -float(r[worst] / left[worst] * told.std[kept[worst]])
        found.append(Outlier(told.names[kept[worst]], error, float(normalized[worst]), "length"))
        others = np.delete(np.arange(len(kept)), worst)
        along = S[others, worst] / left[worst]
        r, S = r[others] + along * r[worst], S[np.ix_(others, others)] + np.outer(along, S[worst, others])
        kept = kept[others]
    return found


def constraint_residuals(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], stated: Sequence[Reference]
) -> ConstraintResiduals | None:
    """What the arm says of constraints, at its minimum; None if there are none.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of the readings it was identified from.
    references : sequence of Reference
        From which it was identified.
    stated : sequence of Reference
        Those whose constraints are asked for: the same, or the same but for constraints that `references` are without.
    """
    if all(_is_silent(reference) for reference in stated):
        return None
    x, n = fit.parameters, len(fit.coefficients)
    problem, _ = initial_problem(fit.perturbed_chain, state, references)
    names: list[str] = []
    residuals, std, by, values = [], [], [], []
    with one_blas_thread():
        parts, whole = linearised(problem, x, [part.weights for part in fit.references])
        left = eliminate_unknowns(parts, whole, x)
        prior_std = np.concatenate([fit.prior_std, np.full(len(left.kept) - n, UNKNOWN_STD)])
        prior = GroupedPrior(prior_std, np.zeros(len(prior_std), np.intp), np.ones(1), np.zeros(1, bool))
        found = posterior(left.gram, left.gram @ x[left.kept] - left.gradient, prior, size=left.size)
    # The iterations end within a part of all uncertainty, and what constraints alone hold is seldom known to that.
    step = left.step(found.x - x[left.kept])
    for i, reference in enumerate(stated):
        unknowns = x[problem.unknowns_of(i)]
        # Unknowns of constraints alone stand last; they are as stated where the arm was identified without them.
        tips = problem.perturbed_chain.tips(state.rows(reference.rows), fit.coefficients).T
        beside = reference.initialise(tips)[1][len(unknowns) :]
        constraints = reference.constraints(np.concatenate([unknowns, beside]))
        if constraints is None:
            continue
        names += constraints.names
        wide = np.zeros((len(constraints.residuals), len(x)))
        wide[:, problem.unknowns_of(i)] = constraints.by_unknown[:, : len(unknowns)]
        residuals.append(constraints.residuals + wide @ step)
        std.append(constraints.std)
        by.append(wide)
        values.append(constraints.values)
    J = np.concatenate(by)
    of_kept, of_gone = J[:, left.kept] - J[:, left.eliminated] @ left.slope, J[:, left.eliminated] @ left.root.T
    covariance = of_kept @ found.covariance @ of_kept.T + of_gone @ of_gone.T
    return ConstraintResiduals(
        tuple(names), np.concatenate(residuals), np.concatenate(std), covariance, np.concatenate(values)
    )


def _is_silent(reference: Reference) -> bool:
    """Whether it has no constraints."""
    return reference.constraints(np.zeros(len(reference.unknowns))) is None
