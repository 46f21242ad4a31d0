"""Outliers: readings that an identified arm does not fit, and known lengths that contradict all other data.

A reading that was excluded as a gross error (`truearm.identification.judgement.gross_errors`) took no part in the
identification: its residual is its deviation from the arm by the others.

A known length enters with the uncertainty of its certificate, and a wrong one distorts the arm; its residual, and those
of the other lengths, then mean little. Each length is therefore compared with the value implied by all other data, in
closed form: with the whitened residuals r of the constraints and their whitened covariance S under the posterior,
``(I - S)^-1 r`` of the omitted ones (`truearm.identification.judgement.cross_validation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from truearm.identification.estimation.identification import initial_problem
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.linearisation import UNKNOWN_STD, eliminate_unknowns, linearised
from truearm.identification.references.references import Reference
from truearm.identification.terms.state import ArmState
from truearm.readings.session import Session
from truearm.solve.group_evidence import GroupedPrior, posterior
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray

# Readings of a robust weight below this have a residual of at least twice Huber's threshold.
MIN_ROBUST_WEIGHT = 0.5
# Standard deviations by which a known length may differ from the value implied by all other data.
MAX_NORMALIZED_RESIDUAL = 4.0
# Share of a residual's variance that must remain for other data to determine the length.
MIN_REDUNDANCY = 1e-8


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
    is_excluded : bool
        Whether the reading is a gross error and took no part in the identification.
    """

    name: str
    error_mm: float
    normalized_residual: float
    kind: str
    row: int | None = None
    line: int | None = None
    is_excluded: bool = False

    def __str__(self) -> str:
        status = ", excluded" if self.is_excluded else ""
        return f"{self.name}, error {self.error_mm:.3f} mm, normalized residual {self.normalized_residual:.0f}{status}"

    @classmethod
    def of_reading(
        cls, row: int, error_mm: float, normalized_residual: float, *, kind: str, is_excluded: bool = False
    ) -> Self:
        """A reading, by its row."""
        return cls(f"reading {row + 1}", error_mm, normalized_residual, kind, row, is_excluded=is_excluded)

    def located(self, session: Session, rows: IntArray | None = None) -> Outlier:
        """The same with its line in the file of a session; `rows` are the rows of the session that were used."""
        assert self.row is not None
        row = self.row if rows is None else int(rows[self.row])
        line = session.line_of(row)
        return replace(self, name=session.called(row), row=row, line=line)


def outliers(fit: IdentificationResult) -> list[Outlier]:
    """Readings whose robust weight is below one half: excluded ones first, then by their normalized residuals."""
    found = []
    for reference in fit.references:
        if reference.residuals.shape[1] == 0:
            continue
        variance = reference.std**2 + reference.noise_std**2
        length = np.linalg.norm(reference.residuals, axis=0)
        normalized = np.sqrt((reference.residuals**2 / variance).mean(axis=0))
        found += [
            Outlier.of_reading(
                int(reference.rows[i]),
                float(length[i]),
                float(normalized[i]),
                kind=reference.kind,
                is_excluded=bool(reference.robust_weight[i] == 0),
            )
            for i in np.flatnonzero(reference.robust_weight < MIN_ROBUST_WEIGHT)
        ]
    found.sort(key=lambda outlier: (not outlier.is_excluded, -outlier.normalized_residual))
    # A reading is excluded as a whole: where it has a point and a seat, the one that contradicts most is named.
    named = {outlier.row: outlier for outlier in reversed(found) if outlier.is_excluded}
    return [outlier for outlier in found if not outlier.is_excluded or named[outlier.row] is outlier]


class ConstraintResiduals(NamedTuple):
    """Residuals of the constraints among the references' unknowns, at the minimum of an identification.

    Attributes
    ----------
    names : tuple of str
    residuals : (l,) array
        Value by the identified arm less the stated value [mm].
    std : (l,) array
        Standard uncertainties of the stated values [mm].
    covariance : (l, l) array
        Of the values by the identified arm, from the posterior [mm^2].
    values : (l, 2) array
        By the identified arm and as stated [mm].
    """

    names: tuple[str, ...]
    residuals: FloatArray
    std: FloatArray
    covariance: FloatArray
    values: FloatArray


def length_outliers(fit: IdentificationResult, state: ArmState, references: Sequence[Reference]) -> list[Outlier]:
    """Known lengths and distances that contradict all other data, the worst first.

    The worst is omitted before the others are judged, as it distorts the arm for them too; then the next worst, until
    no normalized residual is above `MAX_NORMALIZED_RESIDUAL`.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of the readings of the identification.
    references : sequence of Reference
        Those of the identification.
    """
    stated = constraint_residuals(fit, state, references, references)
    if stated is None:
        return []
    r, S = stated.residuals / stated.std, stated.covariance / np.outer(stated.std, stated.std)
    found: list[Outlier] = []
    kept = np.arange(len(r))
    while len(kept):
        redundancy = 1 - S.diagonal()
        normalized = np.where(
            redundancy > MIN_REDUNDANCY, np.abs(r) / np.sqrt(np.maximum(redundancy, MIN_REDUNDANCY)), 0.0
        )
        worst = int(np.argmax(normalized))
        if not normalized[worst] > MAX_NORMALIZED_RESIDUAL:
            break
        error = -float(r[worst] / redundancy[worst] * stated.std[kept[worst]])
        found.append(Outlier(stated.names[kept[worst]], error, float(normalized[worst]), "length"))
        others = np.delete(np.arange(len(kept)), worst)
        along = S[others, worst] / redundancy[worst]
        r, S = r[others] + along * r[worst], S[np.ix_(others, others)] + np.outer(along, S[worst, others])
        kept = kept[others]
    return found


def constraint_residuals(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], stated: Sequence[Reference]
) -> ConstraintResiduals | None:
    """Residuals of the constraints at the minimum of an identification; None without constraints.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of the readings of the identification.
    references : sequence of Reference
        Those of the identification.
    stated : sequence of Reference
        The references whose constraints to evaluate: the same, or the same with additional constraints.
    """
    if all(_is_unconstrained(reference) for reference in stated):
        return None
    x, n = fit.parameters, len(fit.coefficients)
    problem, _ = initial_problem(fit.perturbed_chain, state, references)
    found, by = [], []
    with one_blas_thread():
        parts, whole = linearised(problem, x, [part.weights for part in fit.references])
        reduced = eliminate_unknowns(parts, whole, x)
        prior_std = np.concatenate([fit.prior_std, np.full(len(reduced.kept) - n, UNKNOWN_STD)])
        prior = GroupedPrior(prior_std, np.zeros(len(prior_std), np.intp), np.ones(1), np.zeros(1, bool))
        solution = posterior(reduced.gram, reduced.gram @ x[reduced.kept] - reduced.gradient, prior, size=reduced.size)
    # The iterations end within a fraction of the uncertainty, which is too coarse for unknowns of constraints alone.
    step = reduced.step(solution.x - x[reduced.kept])
    for i, reference in enumerate(stated):
        unknowns = x[problem.unknowns_of(i)]
        # Unknowns of constraints alone are the last ones; without them in the fit they have their stated values.
        tips = problem.perturbed_chain.tips(state.rows(reference.rows), fit.coefficients).T
        additional = reference.initialise(tips)[1][len(unknowns) :]
        constraints = reference.constraints(np.concatenate([unknowns, additional]))
        if constraints is None or reference.kind == "pose":  # whose common errors are no lengths
            continue
        wide = np.zeros((len(constraints.residuals), len(x)))
        wide[:, problem.unknowns_of(i)] = constraints.by_unknown[:, : len(unknowns)]
        found.append((constraints.residuals + wide @ step, constraints.std, constraints.values, constraints.names))
        by.append(wide)
    J = np.concatenate(by)
    of_kept = J[:, reduced.kept] - J[:, reduced.eliminated] @ reduced.slope
    of_eliminated = J[:, reduced.eliminated] @ reduced.root.T
    covariance = of_kept @ solution.covariance @ of_kept.T + of_eliminated @ of_eliminated.T
    residuals, std, values, names = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return ConstraintResiduals(tuple(names.tolist()), residuals, std, covariance, values)


def _is_unconstrained(reference: Reference) -> bool:
    """Whether a reference has no constraints."""
    return reference.kind == "pose" or reference.constraints(np.zeros(len(reference.unknowns))) is None
