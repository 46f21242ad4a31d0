"""Figures of an evaluation that are added over the parts of a session: errors of points, their coverage, outliers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from operator import add, or_
from pathlib import Path
from typing import Any

import numpy as np

from truearm.acceptance import accept_also, acceptance_remarks, accepts, overridden
from truearm.choices import Conditions
from truearm.errors import Contradiction, InputError
from truearm.findings import Finding, findings_of, shortened
from truearm.identification.judgement.outliers import Outlier
from truearm.models import Compensator
from truearm.models.compensator import CheckedReadings
from truearm.models.uncertainty import uncertainty_budget
from truearm.readings import Session, check_reach
from truearm.readings.checks import MAX_SKIPPED_SHARE, serial_number_of, serial_number_of_all
from truearm.readings.large_sessions import LargeSession, Part
from truearm.readings.point_errors import PointErrorSums, removed_percent
from truearm.solve.sums import MAX_KEPT, Sums, different, joined
from truearm.typing import IntArray
from truearm.verbs.inputs import (
    Limits,
    allowed_in_part,
    count_outside,
    fit_findings,
    nominal_error_findings,
    payload_findings,
    skipped_training,
    training_findings,
)
from truearm.verbs.record import describe_effective_number

# Outliers of a part, and of all, that are kept: the largest.
MAX_OUTLIERS = 20
# Share of the outliers that blames the file in which they are.
NEARLY_ALL = 0.9


def largest(a: tuple[Outlier, ...], b: tuple[Outlier, ...]) -> tuple[Outlier, ...]:
    """The largest outliers of parts."""
    return tuple(sorted((*a, *b), key=lambda one: -one.normalized_residual)[:MAX_OUTLIERS])


@dataclass(frozen=True, eq=False)
class CoverageSums(Sums):
    """Figures about the uncertainty that a model states under certain conditions.

    Attributes
    ----------
    n_points, n_covered, n_covered_99 : int
        Points that are compared, and those in the ellipsoids of 95 % and 99 %.
    variance : float
        Sum of the variances of a coordinate, the mean of three at each reading [mm^2].
    n_outliers, outliers, outliers_of_file : int, tuple of Outlier, dict of Path to int
        Readings farther from their reference point than eight stated standard uncertainties, the largest, and by file.
    """

    n_points: int = 0
    n_covered: int = 0
    n_covered_99: int = 0
    variance: float = 0.0
    n_outliers: int = 0
    outliers: tuple[Outlier, ...] = field(default=(), metadata=joined(largest))
    outliers_of_file: Mapping[Path, int] = field(default_factory=dict)

    @property
    def coverage(self) -> float:
        """Share of the points in their 95 % ellipsoids; NaN without any."""
        return self.n_covered / self.n_points if self.n_points else np.nan

    @property
    def combined_mm(self) -> float:
        """Standard uncertainty of a coordinate, root mean square [mm]."""
        return float(np.sqrt(self.variance / self.n_points))


@dataclass(frozen=True, eq=False)
class EvaluationSums(Sums):
    """Figures of an evaluation that are added over parts.

    Attributes
    ----------
    n_read, n_beyond, n_training, n_known : int
        Readings; those beyond a joint limit, and those of a refit, which are skipped; those known from the fit.
    points : dict of str to PointErrorSums
        Errors of ``"nominal"`` and ``"model"``.
    stated : dict of str to CoverageSums
        What the model states under ``"reproducibility"`` conditions and, where that makes a difference, under those of
        ``"repeatability"``.
    of_parts : frozenset of str or None
        The conditions of the readings of each part.
    n_outside, outside : int, dict of str to int
        Readings outside the trained range, and by input.
    findings : tuple of Finding
        Of many parts the first six different ones of each thing, and the number of the others.
    """

    n_read: int = 0
    n_beyond: int = 0
    n_training: int = 0
    n_known: int = 0
    points: Mapping[str, PointErrorSums] = field(default_factory=dict)
    stated: Mapping[Conditions, CoverageSums] = field(default_factory=dict)
    of_parts: frozenset[Conditions | None] = field(default=frozenset(), metadata=joined(or_))
    n_outside: int = 0
    outside: Mapping[str, int] = field(default_factory=dict)
    findings: tuple[Finding, ...] = field(default=(), metadata=joined(different))

    @property
    def n_points(self) -> int:
        """Points that are compared."""
        return self.points["model"].n

    @property
    def conditions(self) -> Conditions | None:
        """The conditions of all readings: repeatability if no part is of another day, None if one does not say it."""
        if not self.of_parts or None in self.of_parts:
            return None
        return "reproducibility" if "reproducibility" in self.of_parts else "repeatability"

    @property
    def applies(self) -> CoverageSums:
        """What the model states under the conditions of the readings; under those of any day if they are not known."""
        return self.stated.get(self.conditions or "reproducibility", self.stated["reproducibility"])

    def errors(self) -> dict[str, dict[str, Any]]:
        """Errors of ``"nominal"`` and ``"model"`` as `compare_errors` gives them; the 95 % quantile to 0.1 %."""
        found: dict[str, dict[str, Any]] = {name: dict(sums.errors()) for name, sums in self.points.items()}
        if "nominal" in found:
            found["model"]["removed_percent"] = removed_percent(found["model"], found["nominal"])
        return found

    def effective_number(self) -> str:
        """What the readings are worth, in a sentence."""
        own = self.points["model"]
        number, is_settled = own.effective_number()
        said = describe_effective_number(number, own.n, is_settled)
        return f"{said}: standard error of the mean {own.standard_error_mm():.2g} mm."

    def skipped_and_outliers(self) -> Iterator[str]:
        """How many readings are not compared, and how many are outliers, in sentences."""
        if without := self.n_read - self.n_points - self.n_training:
            yield f"{without} of {self.n_read} readings have no reference point, or are beyond a joint limit."
        far = self.applies
        if far.n_outliers > MAX_OUTLIERS:
            file, n = max(far.outliers_of_file.items(), key=lambda one: one[1])
            # One file that has nearly all of them is another matter than single readings.
            if len(far.outliers_of_file) > 1 and n > NEARLY_ALL * far.n_outliers:
                yield (
                    f"{n} of {far.n_outliers} outliers are in {file.name}: it may be in other units than the other "
                    "files, of another arm, or of another set-up. Try: evaluate it alone"
                )

    def to_json(self) -> dict[str, Any]:
        """What an evaluation over parts says beside its errors."""
        own, far = self.points["model"], self.applies
        number, is_settled = own.effective_number()
        return {
            "standard_error_mm": own.standard_error_mm(),
            "n_effective": number,
            "is_effective_number_settled": is_settled,
            "combined_u_mm": self.stated["reproducibility"].combined_mm,
            "inputs_outside_training": self.outside,
            "n_outliers": far.n_outliers,
            "outliers_of_file": {str(file): n for file, n in far.outliers_of_file.items() if n},
        }


@dataclass(frozen=True, eq=False)
class _PartSums(Sums):
    """Figures of readings of a refit and of others: which of them count, all parts together say."""

    n_read: int
    n_beyond: int
    others: EvaluationSums
    training: EvaluationSums
    findings: tuple[Finding, ...] = field(default=(), metadata=joined(different))
    overridden: tuple[str, ...] = field(default=(), metadata=joined(different))
    serial_numbers: frozenset[str] = field(default=frozenset(), metadata=joined(or_))


def sums_over_parts(
    model: Compensator, large: LargeSession, limits: Limits, conditions: Conditions | None, accept: str | None
) -> EvaluationSums:
    """Figures of all reference points of a session.

    Raises
    ------
    InputError
        If there are none, or more than half of the readings are beyond a joint limit.
    """
    work = partial(_of_part, model=model, limits=limits, accept=accept, n_session=len(large))
    every = reduce(add, large.sums([work] * len(large.parts)))
    accept_also(every.overridden)
    serial_number_of_all(every.serial_numbers, large.path)
    if every.n_beyond > MAX_SKIPPED_SHARE * every.n_read:
        raise Contradiction(
            f"{every.n_beyond} of {every.n_read} readings are outside the limits of a joint",
            file=large.path,
            hint="check the unit, sign and zero of the angles, or the limits in the arm file",
        )
    sums, n_training = every.others, every.training.n_points if every.training.points else 0
    if not sums.points:
        sums, n_training = every.training, 0
    if not sums.points:
        raise InputError(
            "expected reference points (x_mm, y_mm, z_mm), which a large session is evaluated against, got none",
            file=large.path,
            hint="a file of the readings in seats alone is evaluated as a small session",
        )
    arm_errors = sums.points.get("nominal", sums.points["model"]).errors()
    nominal_error = nominal_error_findings(model, arm_errors["mean_mm"]) if model.arm_.has_kinematics else ()
    outside = f"{count_outside(sums.outside, sums.n_outside, sums.n_points)}."
    found = (
        *findings_of("acceptance", acceptance_remarks(accept)),
        *shortened(every.findings, MAX_KEPT),
        *skipped_training(n_training, n_training + sums.n_points),
        *nominal_error,
        *findings_of("trained range", [outside] if sums.n_outside else []),
        *shortened(sums.findings, MAX_KEPT),
        *fit_findings(model),
        *training_findings(model, sums.n_known, sums.n_points),
    )
    return replace(
        sums,
        n_read=every.n_read,
        n_beyond=every.n_beyond,
        n_training=n_training,
        of_parts=frozenset([conditions]) if conditions else sums.of_parts,
        findings=found,
    )


@accepts
def _of_part(
    given: Session, part: Part, *, model: Compensator, limits: Limits, accept: str | None, n_session: int
) -> _PartSums:
    allowed = allowed_in_part(given, model.arm, limits, accept)
    seen = np.flatnonzero(allowed.session.has_point)
    others = training = EvaluationSums()
    if len(seen):
        used = allowed.session.rows(seen)
        if model.arm.has_kinematics:
            check_reach(used, reach=model.arm.chain.reach, sliding=model.arm.chain.is_prismatic)
        is_known = model.skipped_in_tests(used)
        others, training = (
            _evaluated(model, used.rows(of), given, allowed.rows[seen[of]], part.file, n_session)
            for of in (~is_known, is_known)
        )
    n_beyond, stated = len(given) - len(allowed.rows), serial_number_of(given)
    stated_by = frozenset(filter(None, [stated]))
    return _PartSums(len(given), n_beyond, others, training, allowed.findings, overridden(), stated_by)


def _evaluated(
    model: Compensator, used: Session, given: Session, rows: IntArray, file: Path, n_session: int
) -> EvaluationSums:
    """Figures of the readings `rows` of `given`, which have points."""
    on_the_day = model.under("repeatability")
    under: dict[Conditions, Compensator] = {"reproducibility": model}
    if on_the_day is not model:
        under["repeatability"] = on_the_day
    if not len(used):
        return EvaluationSums(stated={of: CoverageSums(outliers_of_file={file: 0}) for of in under})
    assert used.points is not None
    at = model.at(used)
    points = {"model": PointErrorSums.of(model.predict_readings(at), used.points, n_session)}
    if model.kind != "nominal" and model.arm_.has_kinematics:
        points = {"nominal": PointErrorSums.of(model.predict_nominal_readings(at), used.points, n_session)} | points
    outside = model.inputs_outside_training(at)
    return EvaluationSums(
        n_known=int(model.trained_on(used).sum()),
        points=points,
        stated={of: _coverage(at._replace(model=one), given, rows, file) for of, one in under.items()},
        of_parts=frozenset([model.training_.conditions_of(used)]),
        n_outside=int(np.logical_or.reduce([np.zeros(len(used), bool), *outside.values()]).sum()),
        outside={name: int(rows.sum()) for name, rows in outside.items()},
        findings=payload_findings(model.training_, used),
    )


def _coverage(at: CheckedReadings, given: Session, rows: IntArray, file: Path) -> CoverageSums:
    budget, far = uncertainty_budget(at.model, at)
    named = (one.located(given, rows) for one in far[:MAX_OUTLIERS])
    return CoverageSums(
        budget.n_points,
        budget.n_covered,
        budget.n_covered_99,
        budget.n_points * budget.combined_mm**2,
        len(far),
        tuple(replace(one, name=f"{one.name} of {file.name}") for one in named),
        {file: len(far)},
    )
