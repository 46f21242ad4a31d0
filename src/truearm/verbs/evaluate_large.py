"""Evaluate a model on a large session: errors of points and their coverage, as sums over its parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from truearm.acceptance import OVERRIDE, acceptance_remarks, accepts
from truearm.choices import Conditions
from truearm.errors import Contradiction, InputError
from truearm.identification.judgement.outliers import Outlier
from truearm.models import Compensator
from truearm.models.uncertainty import uncertainty_budget
from truearm.readings import Session, check_reach
from truearm.readings.checks import MAX_SKIPPED_SHARE
from truearm.readings.large_sessions import LargeSession, Part
from truearm.readings.point_error_sums import PointErrorSums
from truearm.solve.executors import Executor
from truearm.solve.sums import Sums, joined
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import (
    Limits,
    ModelLike,
    fit_findings,
    payload_findings,
    to_model,
    training_findings,
    without_training_readings,
)
from truearm.verbs.pass_over_parts import PartTask, allowed_in_part, joined_remarks, pass_over_parts
from truearm.verbs.record import TableRecord, TextTable, columns_of, format_fixed
from truearm.verbs.sentences import compare_with_nominal, describe_effective_number, format_mm, listed

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
    n_read : int
        Readings, those without a reference point among them.
    n_beyond : int
        Those beyond a joint limit, which are skipped.
    n_known : int
        Readings that are known from the fit of the model.
    errors : dict of str to PointErrorSums
        Of ``"nominal"`` and ``"model"``.
    n_covered, n_covered_99 : int
        Points in the ellipsoids of 95 % and 99 %.
    variance : float
        Sum of the variances of a coordinate, the mean of three at each reading [mm^2].
    outside : dict of str to int
        Readings outside the trained range, by input.
    n_outliers : int
        Readings farther from their reference point than eight stated standard uncertainties.
    outliers : tuple of Outlier
        The largest of them.
    outliers_of_file : dict of Path to int
        Number of outliers of each file.
    remarks : tuple of str
    """

    n_read: int = 0
    n_beyond: int = 0
    n_known: int = 0
    errors: Mapping[str, PointErrorSums] = field(default_factory=dict)
    n_covered: int = 0
    n_covered_99: int = 0
    variance: float = 0.0
    outside: Mapping[str, int] = field(default_factory=dict)
    n_outliers: int = 0
    outliers: tuple[Outlier, ...] = field(default=(), metadata=joined(largest))
    outliers_of_file: Mapping[Path, int] = field(default_factory=dict)
    remarks: tuple[str, ...] = field(default=(), metadata=joined(joined_remarks))


def _named(outlier: Outlier, part: Part) -> Outlier:
    return replace(outlier, name=f"{outlier.name} of {part.file.name}")


@dataclass(frozen=True)
class EvaluateTask(PartTask[EvaluationSums]):
    """What is evaluated of each part."""

    model: Compensator
    limits: Limits
    conditions: Conditions | None
    accept: str | None
    n_session: int

    def sums(self, readings: Session, part: Part) -> EvaluationSums:
        """See `PartTask.sums`."""
        return _sums_of(self, readings, part, accept=self.accept)


@accepts
def _sums_of(task: EvaluateTask, given: Session, part: Part, *, accept: str | None) -> EvaluationSums:
    model = task.model
    allowed = allowed_in_part(given, model.arm, task.limits, accept)
    n_beyond = len(given) - len(allowed.rows)
    seen = np.flatnonzero(allowed.session.has_point)
    used, kept, training = without_training_readings(allowed.session.rows(seen), model)
    seen = seen[kept]
    if not len(used):
        return EvaluationSums(len(given), n_beyond)
    if model.arm.has_kinematics:
        check_reach(used, reach=model.arm.chain.reach, sliding=model.arm.chain.is_prismatic)
    assert used.points is not None
    at = model.at(used)
    errors = {"model": PointErrorSums.of(model.predict_readings(at), used.points, task.n_session)}
    if model.kind != "nominal" and model.arm_.has_kinematics:
        errors = {
            "nominal": PointErrorSums.of(model.predict_nominal_readings(at), used.points, task.n_session)
        } | errors
    conditions = task.conditions or model.training_.conditions_of(used) or "reproducibility"
    stated = model.under(conditions)
    budget, far = uncertainty_budget(stated, at if stated is model else used)
    return EvaluationSums(
        len(given),
        n_beyond,
        int(model.trained_on(used).sum()),
        errors,
        budget.n_covered,
        budget.n_covered_99,
        len(used) * budget.combined_mm**2,
        {name: int(rows.sum()) for name, rows in model.inputs_outside_training(at).items()},
        len(far),
        tuple(_named(one.located(given, allowed.rows[seen]), part) for one in far[:MAX_OUTLIERS]),
        {part.file: len(far)},
        (
            *acceptance_remarks(accept),
            *allowed.remarks,
            *map(str, training),
            *map(str, payload_findings(model.training_, used)),
            *map(str, fit_findings(model)),
        ),
    )


@one_blas_thread()
def evaluate_large(
    model: ModelLike,
    session: str | Path,
    *,
    limits: Limits = "skip",
    conditions: Conditions | None = None,
    accept: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> LargeEvaluation:
    """Test a model on the reference points of a large session, beside the nominal arm.

    Seats, lengths and distances compare readings of different parts with each other, and are not evaluated.

    Parameters
    ----------
    model, limits, accept
        As of `evaluate`.
    conditions : {"reproducibility", "repeatability"}, optional
        Of these readings; the coverage is that of these. By default what names of their sessions say, otherwise
        reproducibility.
    session : str or Path
        One file, or a folder of files (`LargeSession`).
    executor : Executor, optional
        Who computes the parts; this process by default. The figures do not depend on it.
    progress : callable, optional
        Called with the number of readings done and a note.

    Returns
    -------
    LargeEvaluation

    Raises
    ------
    InputError
        As `evaluate`; or if no reading has a reference point.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> Path("line").mkdir()
    >>> session.save("line/1.csv")
    >>> model = ta.fit("ur10", session, model="nominal").model
    >>> ta.evaluate_large(model, "line").errors["model"]["n"]
    40
    """
    known = to_model(model)
    large = LargeSession.open(session, n_joints=known.arm.n_joints)
    tasks = [EvaluateTask(known, limits, conditions, accept, len(large))] * len(large.parts)
    sums = reduce(add, pass_over_parts(large, tasks, executor, progress), EvaluationSums())
    if sums.n_beyond > MAX_SKIPPED_SHARE * sums.n_read:
        raise Contradiction(
            f"{sums.n_beyond} of {sums.n_read} readings are outside the limits of a joint",
            file=session,
            hint=f"check the unit, sign and zero of the angles, or the limits in the arm file; {OVERRIDE}",
        )
    if "model" not in sums.errors:
        raise InputError(
            "expected reference points (x_mm, y_mm, z_mm), which a large session is evaluated against, got none",
            file=session,
            hint="a file of the readings in seats alone is evaluated as a small session",
        )
    trained = map(str, training_findings(known, sums.n_known, sums.errors["model"].n))
    return LargeEvaluation(known, len(large.parts), replace(sums, remarks=(*trained, *sums.remarks)))


@dataclass(frozen=True, eq=False, repr=False)
class LargeEvaluation(TableRecord):
    """Errors of a model and of the nominal arm on the reference points of a large session.

    Attributes
    ----------
    model : Compensator
    n_parts : int
    sums : EvaluationSums
    """

    model: Compensator
    n_parts: int
    sums: EvaluationSums

    @property
    def errors(self) -> dict[str, dict[str, Any]]:
        """For ``"nominal"`` and ``"model"``, as of `Evaluation`; the 95 % quantile to 0.1 %."""
        found: dict[str, dict[str, Any]] = {name: dict(sums.errors()) for name, sums in self.sums.errors.items()}
        if "nominal" in found and (before := found["nominal"]["mean_abs_coordinate_mm"]) > 0:
            own = found["model"]
            own["removed_percent"] = 100 * (1 - own["mean_abs_coordinate_mm"] / before)
        return found

    @property
    def coverage(self) -> float:
        """Share of the reference points inside the 95 % ellipsoid that the model states for their conditions."""
        return self.sums.n_covered / self.sums.errors["model"].n

    def summary(self) -> str:
        """The answer in one sentence: the mean error, and how it compares with the nominal arm."""
        errors = self.errors
        own, nominal = errors["model"], errors.get("nominal")
        compared = "" if nominal is None else compare_with_nominal(own["mean_mm"], nominal["mean_mm"])
        return f"Mean error {format_mm(own['mean_mm'])} on {own['n']} readings{compared}."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        errors, own = self.errors, self.sums.errors["model"]
        yield self.summary()
        number, is_settled = own.effective_number()
        said = describe_effective_number(number, own.n, is_settled)
        yield f"{said}: standard error of the mean {own.standard_error_mm():.2g} mm."
        names = [name for name in errors["model"] if name.endswith("_mm")]
        rows = [(name, *(format_fixed(one[name]) for one in errors.values())) for name in names]
        yield TextTable((f"{own.n} readings", *errors), rows)
        n = own.n
        yield f"{100 * self.coverage:.1f} % of the points are inside their stated 95 % ellipsoid"
        yield f"{100 * self.sums.n_covered_99 / n:.1f} % of the points are inside their stated 99 % ellipsoid"
        if self.sums.outside:
            inputs = ", ".join(f"{name} {count}" for name, count in self.sums.outside.items())
            yield f"Outside the trained range ({inputs} of {n} readings)."
        if without := self.sums.n_read - n:
            yield f"{without} of {self.sums.n_read} readings have no reference point or are skipped."
        yield from listed("outlier", self.sums.outliers, "readings")
        if self.sums.n_outliers > MAX_OUTLIERS:
            yield f"{self.sums.n_outliers} outliers in all, of which the {MAX_OUTLIERS} largest are kept"
            yield from self._file_of_outliers()
        yield from self.sums.remarks

    def _file_of_outliers(self) -> Iterator[str]:
        """One file that has nearly all of them is another matter than single readings."""
        file, n = max(self.sums.outliers_of_file.items(), key=lambda one: one[1])
        if len(self.sums.outliers_of_file) > 1 and n > NEARLY_ALL * self.sums.n_outliers:
            yield (
                f"{n} of them are in {file.name}: it may be in other units than the other files, or of another arm. "
                "Try: fit it alone"
            )

    def columns(self) -> dict[str, list[Any]]:
        """A row for the nominal arm, where it is compared, and one for the model: their errors."""
        return columns_of({"arm": name} | dict(one) for name, one in self.errors.items())

    def _json(self) -> object:
        errors, own = self.errors, self.sums.errors["model"]
        number, is_settled = own.effective_number()
        return {
            "summary": self.summary(),
            **errors["model"],
            "nominal": errors.get("nominal"),
            "standard_error_mm": own.standard_error_mm(),
            "n_effective": number,
            "is_effective_number_settled": is_settled,
            "n_parts": self.n_parts,
            "coverage": self.coverage,
            "coverage_99": self.sums.n_covered_99 / own.n,
            "combined_u_mm": float(np.sqrt(self.sums.variance / own.n)),
            "inputs_outside_training": self.sums.outside,
            "n_outliers": self.sums.n_outliers,
            "outliers": self.sums.outliers,
            "outliers_of_file": {str(file): n for file, n in self.sums.outliers_of_file.items() if n},
            "remarks": self.sums.remarks,
        }
