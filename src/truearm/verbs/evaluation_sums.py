"""Figures of an evaluation that are added over the parts of a session: errors of points, their coverage, outliers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from truearm.acceptance import acceptance_remarks, accepts
from truearm.choices import Conditions
from truearm.errors import Contradiction, InputError
from truearm.findings import Finding, findings_of
from truearm.identification.judgement.outliers import Outlier
from truearm.models import Compensator
from truearm.models.uncertainty import uncertainty_budget
from truearm.readings import Session, check_reach
from truearm.readings.checks import MAX_SKIPPED_SHARE
from truearm.readings.large_sessions import LargeSession, Part
from truearm.readings.point_error_sums import PointErrorSums
from truearm.solve.sums import Sums, first_different, joined
from truearm.verbs.inputs import (
    Limits,
    allowed_in_part,
    count_outside,
    fit_findings,
    payload_findings,
    training_findings,
    without_training_readings,
)
from truearm.verbs.sentences import describe_effective_number

# Outliers of a part, and of all, that are kept: the largest.
MAX_OUTLIERS = 20
# Share of the outliers that blames the file in which they are.
NEARLY_ALL = 0.9


def largest(a: tuple[Outlier, ...], b: tuple[Outlier, ...]) -> tuple[Outlier, ...]:
    """The largest outliers of parts."""
    return tuple(sorted((*a, *b), key=lambda one: -one.normalized_residual)[:MAX_OUTLIERS])


@dataclass(frozen=True, eq=False)
class EvaluationSums(Sums):
    """Figures of an evaluation that are added over parts.

    Attributes
    ----------
    n_read, n_beyond, n_training, n_known : int
        Readings; those beyond a joint limit, and those of a refit, which are skipped; those known from the fit.
    points : dict of str to PointErrorSums
        Errors of ``"nominal"`` and ``"model"``.
    n_covered, n_covered_99 : int
        Points in the ellipsoids of 95 % and 99 %.
    variance : float
        Sum of the variances of a coordinate, the mean of three at each reading [mm^2].
    n_outside, outside : int, dict of str to int
        Readings outside the trained range, and by input.
    n_outliers, outliers, outliers_of_file : int, tuple of Outlier, dict of Path to int
        Readings farther from their reference point than eight stated standard uncertainties, the largest, and by file.
    findings : tuple of Finding
    """

    n_read: int = 0
    n_beyond: int = 0
    n_training: int = 0
    n_known: int = 0
    points: Mapping[str, PointErrorSums] = field(default_factory=dict)
    n_covered: int = 0
    n_covered_99: int = 0
    variance: float = 0.0
    n_outside: int = 0
    outside: Mapping[str, int] = field(default_factory=dict)
    n_outliers: int = 0
    outliers: tuple[Outlier, ...] = field(default=(), metadata=joined(largest))
    outliers_of_file: Mapping[Path, int] = field(default_factory=dict)
    findings: tuple[Finding, ...] = field(default=(), metadata=joined(first_different))

    @property
    def n_points(self) -> int:
        """Points that are compared."""
        return self.points["model"].n

    def errors(self) -> dict[str, dict[str, Any]]:
        """Errors of ``"nominal"`` and ``"model"`` as `compare_errors` gives them; the 95 % quantile to 0.1 %."""
        found: dict[str, dict[str, Any]] = {name: dict(sums.errors()) for name, sums in self.points.items()}
        if "nominal" in found and (before := found["nominal"]["mean_abs_coordinate_mm"]) > 0:
            own = found["model"]
            own["removed_percent"] = 100 * (1 - own["mean_abs_coordinate_mm"] / before)
        return found

    def effective_number(self) -> str:
        """What the readings are worth, in a sentence."""
        own = self.points["model"]
        number, is_settled = own.effective_number()
        said = describe_effective_number(number, own.n, is_settled)
        return f"{said}: standard error of the mean {own.standard_error_mm():.2g} mm."

    def skipped_and_outliers(self) -> Iterator[str]:
        """How many readings are not compared, and how many are outliers, in sentences."""
        if without := self.n_read - self.n_points:
            yield f"{without} of {self.n_read} readings have no reference point or are skipped."
        if self.n_outliers > MAX_OUTLIERS:
            yield f"{self.n_outliers} outliers in all, of which the {MAX_OUTLIERS} largest are kept"
            file, n = max(self.outliers_of_file.items(), key=lambda one: one[1])
            # One file that has nearly all of them is another matter than single readings.
            if len(self.outliers_of_file) > 1 and n > NEARLY_ALL * self.n_outliers:
                yield (
                    f"{n} of them are in {file.name}: it may be in other units than the other files, or of another "
                    "arm. Try: fit it alone"
                )

    def to_json(self) -> dict[str, Any]:
        """What an evaluation over parts says beside its errors."""
        own = self.points["model"]
        number, is_settled = own.effective_number()
        return {
            "standard_error_mm": own.standard_error_mm(),
            "n_effective": number,
            "is_effective_number_settled": is_settled,
            "combined_u_mm": float(np.sqrt(self.variance / own.n)),
            "inputs_outside_training": self.outside,
            "n_outliers": self.n_outliers,
            "outliers_of_file": {str(file): n for file, n in self.outliers_of_file.items() if n},
        }


def sums_over_parts(
    model: Compensator,
    large: LargeSession,
    limits: Limits,
    conditions: Conditions | None,
    accept: str | None,
) -> EvaluationSums:
    """Figures of all reference points of a session.

    Raises
    ------
    InputError
        If there are none, or more than half of the readings are beyond a joint limit.
    """
    work = partial(_of_part, model=model, limits=limits, conditions=conditions, accept=accept, n_session=len(large))
    sums = reduce(add, large.sums([work] * len(large.parts)), EvaluationSums())
    if sums.n_beyond > MAX_SKIPPED_SHARE * sums.n_read:
        raise Contradiction(
            f"{sums.n_beyond} of {sums.n_read} readings are outside the limits of a joint",
            file=large.path,
            hint="check the unit, sign and zero of the angles, or the limits in the arm file",
        )
    if not sums.points:
        raise InputError(
            "expected reference points (x_mm, y_mm, z_mm), which a large session is evaluated against, got none",
            file=large.path,
            hint="a file of the readings in seats alone is evaluated as a small session",
        )
    outside = f"{count_outside(sums.outside, sums.n_outside, sums.n_points)}."
    found = (
        *findings_of("trained range", [outside] if sums.n_outside else []),
        *training_findings(model, sums.n_known, sums.n_points),
        *sums.findings,
    )
    return replace(sums, findings=found)


@accepts
def _of_part(
    given: Session,
    part: Part,
    *,
    model: Compensator,
    limits: Limits,
    conditions: Conditions | None,
    accept: str | None,
    n_session: int,
) -> EvaluationSums:
    allowed = allowed_in_part(given, model.arm, limits, accept)
    n_beyond = len(given) - len(allowed.rows)
    seen = np.flatnonzero(allowed.session.has_point)
    used, kept, training = without_training_readings(allowed.session.rows(seen), model)
    if not len(used):
        return EvaluationSums(len(given), n_beyond)
    if model.arm.has_kinematics:
        check_reach(used, reach=model.arm.chain.reach, sliding=model.arm.chain.is_prismatic)
    assert used.points is not None
    at = model.at(used)
    points = {"model": PointErrorSums.of(model.predict_readings(at), used.points, n_session)}
    if model.kind != "nominal" and model.arm_.has_kinematics:
        points = {"nominal": PointErrorSums.of(model.predict_nominal_readings(at), used.points, n_session)} | points
    stated = model.under(conditions or model.training_.conditions_of(used) or "reproducibility")
    budget, far = uncertainty_budget(stated, at if stated is model else used)
    outside = model.inputs_outside_training(at)
    named = [one.located(given, allowed.rows[seen[kept]]) for one in far[:MAX_OUTLIERS]]
    return EvaluationSums(
        len(given),
        n_beyond,
        len(seen) - len(kept),
        int(model.trained_on(used).sum()),
        points,
        budget.n_covered,
        budget.n_covered_99,
        len(used) * budget.combined_mm**2,
        int(np.logical_or.reduce([np.zeros(len(used), bool), *outside.values()]).sum()),
        {name: int(rows.sum()) for name, rows in outside.items()},
        len(far),
        tuple(replace(one, name=f"{one.name} of {part.file.name}") for one in named),
        {part.file: len(far)},
        (
            *findings_of("acceptance", acceptance_remarks(accept)),
            *allowed.findings,
            *training,
            *payload_findings(model.training_, used),
            *fit_findings(model),
        ),
    )
