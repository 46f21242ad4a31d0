"""`verify`: measured points against the test plan of a standard and the specification of an arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import file_digest
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from truearm.acceptance import accepted, accepts
from truearm.pages.drawings.page_record import PageRecord, version_row
from truearm.solve.threads import one_blas_thread
from truearm.verbs.record import TableRecord, TextTable, columns_of, format_fixed
from truearm.wings.laboratory.standards.artefacts import Artefacts, read_artefacts
from truearm.wings.laboratory.standards.decision import (
    COVERAGE_PROBABILITY,
    DECISION_RULES,
    ConformityResult,
    DecisionRule,
    Verdict,
)
from truearm.wings.laboratory.standards.measured_points import MeasuredPoints, read_points
from truearm.wings.laboratory.standards.specification import Specification, read_specification
from truearm.wings.laboratory.standards.verification import (
    Verification,
    describe_rule,
    describe_sources,
    describe_unmet,
    verdict_sentence,
)
from truearm.wings.laboratory.standards.verification import verify as verify_points
from truearm.wings.laboratory.standards.verification_plan import (
    PLANS,
    VerificationPlan,
    is_confirmed,
    load_verification_plan,
)

if TYPE_CHECKING:
    from truearm.pages.page import Page
    from truearm.pages.plotting import Figure

PointsLike: TypeAlias = MeasuredPoints | str | Path
PlanLike: TypeAlias = VerificationPlan | str | Path
ArtefactsLike: TypeAlias = Artefacts | str | Path
SpecificationLike: TypeAlias = Specification | str | Path

_ANSWERS = {
    Verdict.CONFORM: "the values tested are within their limits",
    Verdict.NOT_CONFORM: "values are outside their limits",
    Verdict.UNDECIDED: "a value is within its uncertainty of a limit; a better artefact or set-up can decide",
}


@dataclass(frozen=True, eq=False, repr=False)
class VerificationResult(TableRecord, PageRecord):
    """The test values of an arm with their uncertainties, limits and verdicts.

    Attributes
    ----------
    verification : Verification
        The test values with all inputs.
    digests : mapping of Path to str
        SHA-256 of the input files.
    artefacts_file : Path or None
        The file of the artefacts, if they come from one.
    """

    verification: Verification
    digests: Mapping[Path, str]
    artefacts_file: Path | None = None

    @property
    def verdict(self) -> Verdict:
        """Conform only where every value that has a limit is, by a plan whose numbers are confirmed."""
        return self.verification.conclusion

    @property
    def rows(self) -> tuple[ConformityResult, ...]:
        """The test values."""
        return self.verification.rows

    @property
    def serial_number(self) -> str:
        """Serial number of the arm that the points state; empty if they state none."""
        return self.verification.measured.serial_number

    @property
    def remarks(self) -> tuple[str, ...]:
        """Suspected mistakes of the operator, what was not tested, and numbers of the plan to check."""
        return self.verification.remarks

    @property
    def input_files(self) -> tuple[Path, ...]:
        """See `PageRecord`."""
        return tuple(self.digests)

    def page(self) -> Page:
        """Decision, values, uncertainty budgets and artefacts."""
        from truearm.wings.laboratory.pages.verification_page import verification_page

        return verification_page(self.verification, facts=self.facts())

    def figure(self) -> Figure:
        """Values as shares of their limits, with their uncertainties and guard bands."""
        from truearm.wings.laboratory.pages.verification_page import shares_figure

        return shares_figure(self.verification)

    def facts(self) -> list[tuple[str, str]]:
        """The sources of the result: plan, files with their SHA-256, program."""
        plan = self.verification.plan
        return [
            ("plan", f"{plan.name}: {plan.standard}{', own plan' if plan.is_own else ''}"),
            ("serial number in the points", self.serial_number or "not stated"),
            ("coordinates", self.verification.measured.origin.describe().removeprefix("Coordinates: ")),
            *((file.name, f"SHA-256 {digest}") for file, digest in self.digests.items()),
            version_row(),
        ]

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        unrated = self.verdict is Verdict.UNDECIDED and not all(row.in_rated_conditions for row in self.rows)
        if self.verdict is Verdict.NOT_FOR_DECISIONS:
            yield verdict_sentence(self.verification)
        else:
            yield f"{self.verdict.value}: {describe_unmet(self.verification) if unrated else _ANSWERS[self.verdict]}"
        unit = f", serial number {self.serial_number}" if self.serial_number else ""
        specification = self.verification.specification
        measuring_range = f"measuring range {specification.measuring_range_mm:g} mm"
        yield f"{self.verification.plan.heading}: {specification.name}, {measuring_range}{unit}"
        yield self.verification.measured.origin.describe()
        yield (
            "Artefacts: " + "; ".join(map(self.verification.describe_artefact, self.verification.used_artefacts)) + "."
        )
        yield TextTable(
            ["test", "value [mm]", "U [mm]", "limit [mm]", "verdict", "where"], map(self._cells, self.rows), (0, 4, 5)
        )
        yield (
            f"U: expanded uncertainty of artefact and set-up, {COVERAGE_PROBABILITY:.2%} (k = 2, or more with few "
            "degrees of freedom)"
        )
        decides = self.verification.gap is None
        if decides or self.verification.rule != DECISION_RULES[0]:
            yield describe_rule(self.verification.rule, confirmed=decides)
        yield from self.remarks
        yield from describe_sources(self.verification)
        if not decides:
            yield (
                "Next: compare the plan with your copy of the standard, and confirm it in a plan of your own "
                "(truearm verify plan; docs/verification.md)."
            )
        else:
            yield "Next: truearm certificate writes this as a calibration certificate, from the same files."

    def _cells(self, row: ConformityResult) -> list[str]:
        verdict = self.verification.describe_row(row) or ""
        limit = "" if row.limit is None else f"{row.limit:.4f}"
        if row.unit != "mm":  # a count
            return [row.label, f"{row.value:g}", "", limit, verdict, row.where]
        value = format_fixed(row.value, sign=True)
        return [row.label, value, f"{row.uncertainty:.4f}", limit, verdict, row.where]

    def columns(self) -> dict[str, list[Any]]:
        """A row for each test value, in its ``unit`` (mm, or none for a count)."""
        return columns_of(_row_json(row, self.verification.describe_row(row)) for row in self.rows)

    def _json(self) -> object:
        of = self.verification
        return {
            "plan": of.plan.name,
            "standard": of.plan.standard,
            "own_plan": of.plan.is_own,
            "plan_entries": [
                {"key": one.key, "value": one.value, "source": one.source, "confirmed": is_confirmed(one)}
                for one in of.plan.entries(of.measured.tests)
            ],
            "specification": of.specification.name,
            "measuring_range_mm": of.specification.measuring_range_mm,
            "artefacts": [
                {"name": one.name, "serial_number": of.serial_number(one), "certificate": one.certificate}
                for one in of.used_artefacts
            ],
            "serial_number": self.serial_number or None,
            "coordinates": of.measured.origin.to_json(),
            "rule": of.rule,
            "verdict": self.verdict,
            "rated_conditions": [
                {
                    "condition": one.name,
                    "unit": one.unit,
                    "rated": [one.rated.min, one.rated.max],
                    "measured": one.measured,
                    "met": one.met,
                }
                for one in of.conditions
            ],
            "rows": [_row_json(row, of.describe_row(row)) for row in self.rows],
            "remarks": self.remarks,
        }


@one_blas_thread()
@accepts
def verify(
    points: PointsLike,
    *,
    plan: PlanLike = "iso10360-12",
    artefacts: ArtefactsLike,
    specification: SpecificationLike,
    rule: DecisionRule | None = None,
    accept: str | None = None,  # noqa: ARG001 of `accepts`
) -> VerificationResult:
    """Verify an arm by the tests of a standard.

    Parameters
    ----------
    points : MeasuredPoints or path
        The measured points; they may come from any program.
    plan : VerificationPlan, str or path
        Test plan: ``iso10360-12``, ``asme-b89.4.22``, or a file of your own.
    artefacts : Artefacts or path
        Certificates of the artefacts.
    specification : Specification or path
        The limits of the arm.
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}, optional
        Decision rule, by default that of the plan. ``simple`` ignores the uncertainty where it is at most a quarter of
        the limit.
    accept : str, optional
        Why what is contradicted is right all the same: lengths that fit another bar better, points beyond the measuring
        range or months apart, a thermometer without uncertainty. A remark states it.

    Returns
    -------
    VerificationResult

    Raises
    ------
    InputError
        If points do not fit the plan, an artefact or its certificate does not fit the points, or nothing has a limit.

    Examples
    --------
    Simulated points of an arm with its examples of artefacts and specification:

    >>> import truearm as ta
    >>> simulated = ta.simulate_verification("perfect", n_arms=1)
    >>> result = ta.verify(simulated.points(0), artefacts=simulated.artefacts, specification=simulated.specification)
    >>> result.verdict.value  # nobody has compared the numbers of the plan with the standard
    'not for conformity decisions'
    """
    own_plan = Path(plan) if isinstance(plan, str | Path) and str(plan) not in PLANS else None
    digests = digests_of([Path(f) for f in (own_plan, points, artefacts, specification) if isinstance(f, str | Path)])
    plan, specification = to_plan(plan), to_specification(specification)
    verification = verify_points(
        points if isinstance(points, MeasuredPoints) else read_points(points),
        plan=plan,
        artefacts=to_artefacts(artefacts),
        specification=specification,
        rule=rule,
        plan_sha256=None if own_plan is None else digests.get(own_plan),
    )
    if said := [str(one).removesuffix(".") for one in accepted()]:
        verification = replace(verification, remarks=(*said, *verification.remarks))
    return VerificationResult(verification, digests, Path(artefacts) if isinstance(artefacts, str | Path) else None)


def to_plan(plan: PlanLike) -> VerificationPlan:
    """A test plan as it is, by its name, or from a file."""
    return plan if isinstance(plan, VerificationPlan) else load_verification_plan(plan)


def to_artefacts(artefacts: ArtefactsLike) -> Artefacts:
    """Artefacts as they are, or from a file."""
    return artefacts if isinstance(artefacts, Artefacts) else read_artefacts(artefacts)


def to_specification(specification: SpecificationLike) -> Specification:
    """A specification as it is, or from a file."""
    return specification if isinstance(specification, Specification) else read_specification(specification)


def digests_of(files: Sequence[Path]) -> dict[Path, str]:
    """SHA-256 of the files that can be read more than once: a pipe cannot."""
    digests = {}
    for file in files:
        if file.is_file():
            with file.open("rb") as stream:
                digests[file] = file_digest(stream, "sha256").hexdigest()
    return digests


def _row_json(row: ConformityResult, verdict: str | None) -> dict[str, object]:
    return {
        "label": row.label,
        "value": row.value,
        "unit": row.unit,
        "uncertainty": row.uncertainty,
        "coverage_factor": row.budget.coverage_factor,
        "degrees_of_freedom": row.budget.dof,
        "limit": row.limit,
        "conformance_probability": row.conformance_probability,
        "verdict": verdict,
        "where": row.where,
        "budget": [{"label": one.label, "u": one.u, "degrees_of_freedom": one.dof} for one in row.budget.contributions],
    }
