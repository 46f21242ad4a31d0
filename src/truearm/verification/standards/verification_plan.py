"""Test plans: the numbers of points, positions, lengths and runs of a standard's tests, each with its source.

The standards are sold; their texts were not available. So all such numbers are in plans and none is in the evaluation:
TOML files in the folder ``plans``, or the user's own, that state the source of each number and whether it is confirmed.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Collection, Iterator
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Generic, Self, TypeVar

from pydantic import AfterValidator, Field, field_validator, model_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Name, NotNegative, Positive, parse_toml, read_document
from truearm.verification.standards.dates import check_past
from truearm.verification.standards.decision import DECISION_RULES, DecisionRule

CHECK_STANDARD = "check against your copy of the standard"
PLANS = ("iso10360-12", "asme-b89.4.22")


def _at_most_whole(share: float) -> float:
    if share > 1:
        raise InputError(f"expected a share of 1 or less, got {share:g}", hint="write 0.66 for 66 %")
    return share


V = TypeVar("V", bound=float)


class PlanNumber(Document, Generic[V]):
    """A number of a plan with its source; `confirmed` if it was read in a published text, otherwise recalled."""

    confirmed: Annotated[bool, Field(strict=True)]
    source: Name
    value: V


Count = PlanNumber[Annotated[int, Field(strict=True, ge=1, le=1000)]]
Tolerated = PlanNumber[Annotated[int, Field(strict=True, ge=0, le=1000)]]
Size = PlanNumber[Positive]  # [mm]
Share = PlanNumber[Annotated[NotNegative, AfterValidator(_at_most_whole)]]  # of a length; 0.66 is 66 %


class PlannedTest(Document):
    """A test of a plan: whether a verification needs it, and the clause of the standard."""

    required: Annotated[bool, Field(strict=True)]
    clause: Name


class _OnSphere(PlannedTest):
    points: Count
    smallest_sphere_mm: Size
    largest_sphere_mm: Size

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.smallest_sphere_mm.value > self.largest_sphere_mm.value:
            raise InputError("smallest_sphere_mm is larger than largest_sphere_mm", hint="exchange the two")
        if self.points.value < 5:
            raise InputError(
                f"expected 5 points or more on a sphere, got {self.points.value}",
                hint="plan one point more than the four unknowns",
            )
        return self


class Probing(_OnSphere):
    """P_Size and P_Form: points on a sphere at several positions."""

    positions: Count


class Articulation(_OnSphere):
    """L_Dia: groups of points, each with one direction of the stylus, at several positions."""

    groups: Count
    positions: Count


class LengthTest(PlannedTest):
    """E_Uni and E_Bi: lengths at positions, each repeated.

    In up to `tolerated_sets` sets (one length at one position) one value may exceed its limit, if none does when
    the set is measured again: the rule of ISO 10360-2; 0 switches it off.
    """

    lengths: Count
    positions: Count
    repeats: Count
    longest_share: Share
    tolerated_sets: Tolerated


class EffectiveDiameter(_OnSphere):
    """Effective diameter: runs of points on one sphere."""

    repeats: Count


class SinglePoint(PlannedTest):
    """Single-point articulation: points in a seat, one position in each zone of the reach."""

    points: Count
    positions: Count


class Volumetric(PlannedTest):
    """Volumetric performance: lengths at several positions in all."""

    lengths: Count
    positions: Count
    longest_share: Share


class Confirmation(Document):
    """Who compared the numbers of a plan with the text of the standard, and when."""

    confirmed_by: Name
    date: datetime.date

    @field_validator("confirmed_by")
    @classmethod
    def _somebody(cls, given: str) -> str:
        given = given.strip()
        if sum(sign.isalpha() for sign in given) < 2:
            raise InputError(f"expected who confirmed the numbers, got {given!r:.80}", hint="write name and function")
        return given

    @field_validator("date")
    @classmethod
    def _past(cls, day: datetime.date) -> datetime.date:
        check_past(day)
        return day


class VerificationPlan(Document):
    """A test plan; a test without an entry is not part of it.

    Attributes
    ----------
    name, title, standard : str
    decision_rule : {"iso14253-1:2013", "iso14253-1:2017", "simple"}
        That of `verify`, unless that is given another one.
    confirmation : Confirmation or None
        Who confirmed its numbers; None if nobody has.
    probing, articulation, uni, bi, effective_diameter, single_point, volumetric : PlannedTest or None

    Examples
    --------
    >>> import truearm as ta
    >>> plan = ta.load_verification_plan("iso10360-12")
    >>> plan.title != ""
    True
    """

    name: Name
    title: Name
    standard: Name
    decision_rule: DecisionRule = DECISION_RULES[0]
    confirmation: Confirmation | None = None
    probing: Probing | None = None
    articulation: Articulation | None = None
    uni: LengthTest | None = None
    bi: LengthTest | None = None
    effective_diameter: EffectiveDiameter | None = None
    single_point: SinglePoint | None = None
    volumetric: Volumetric | None = None

    @field_validator("decision_rule", mode="before")
    @classmethod
    def _known_rule(cls, given: object) -> object:
        if given not in DECISION_RULES:
            raise InputError(f"unknown decision rule {given!r:.80}", hint=f"use one of {', '.join(DECISION_RULES)}")
        return given

    @model_validator(mode="after")
    def _confirmed_after_publication(self) -> Self:
        """Numbers are compared with a text that exists; a standard's name ends in its year."""
        year = re.search(r"\b(19|20)\d\d$", self.standard.strip())
        if self.confirmation is not None and year is not None and self.confirmation.date.year < int(year[0]):
            raise InputError(
                f"the numbers were confirmed on {self.confirmation.date}, before {self.standard} was published",
                hint="correct date under [confirmation]",
            )
        return self

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if not self.tests:
            raise InputError("expected a test, got none", hint=f"add one of {', '.join(sorted(TESTS))}")
        return self

    @property
    def heading(self) -> str:
        """The title; it names the standard as followed only if every number is confirmed, and by whom is stated."""
        title = self.title.partition(", after ")[0]  # plans that earlier versions printed name the standard there
        gap = self.confirmation_gap(self.tests)
        if gap is None:
            return f"{title}, after {self.standard}"
        return f"{title} (plan not confirmed against {self.standard})"

    def confirmation_gap(self, tests: Collection[str]) -> str | None:
        """Return what is missing before results of these tests count as results after the standard."""
        missing = [key for key, _, _ in self.unconfirmed() if key.partition(".")[0] in tests]
        if missing:
            numbers = "number is" if len(missing) == 1 else "numbers are"
            return (
                f"{len(missing)} {numbers} not confirmed against {self.standard} in the test plan {self.name!r}: "
                f"{', '.join(missing)}"
            )
        if self.confirmation is None and self not in map(_builtin, PLANS):
            return f"the test plan {self.name!r} does not state who confirmed its numbers against {self.standard}"
        return None

    @property
    def tests(self) -> dict[str, PlannedTest]:
        """The tests of the plan by name, in the order of the standards."""
        tests = {name: getattr(self, name) for name in TESTS}
        return {name: test for name, test in tests.items() if test is not None}

    def unconfirmed(self) -> Iterator[tuple[str, float, str]]:
        """Yield the numbers that are not confirmed: key, value and source."""
        for name, test in self.tests.items():
            for key in type(test).model_fields:
                number = getattr(test, key)
                if isinstance(number, PlanNumber) and not number.confirmed:
                    yield f"{name}.{key}", number.value, number.source

    def changed_numbers(self) -> Iterator[tuple[str, float, float]]:
        """Yield the numbers that differ from truearm's plan after the same standard: key, value, value there."""
        there = next((plan.tests for plan in map(_builtin, PLANS) if plan.standard == self.standard), {})
        for name, test in self.tests.items():
            for key in type(test).model_fields:
                number, other = getattr(test, key), getattr(there.get(name), key, None)
                if isinstance(number, PlanNumber) and isinstance(other, PlanNumber) and number.value != other.value:
                    yield f"{name}.{key}", number.value, other.value


TESTS = tuple(
    name
    for name, field in VerificationPlan.model_fields.items()
    if not field.is_required() and name not in ("decision_rule", "confirmation")
)


def load_verification_plan(name: str | Path) -> VerificationPlan:
    """Load a plan of truearm by its name, or a file.

    Raises
    ------
    InputError
        If there is no plan of that name and no such file, or it breaks a rule of the format.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.load_verification_plan("iso10360-12").standard
    'ISO 10360-12:2016'
    """
    if str(name) in PLANS:
        return _builtin(str(name))
    if not str(name).endswith(".toml"):
        raise InputError(
            f"there is no plan {str(name)!r:.80}", hint=f"use {', '.join(PLANS)}, or a file that ends in .toml"
        )
    return read_document(name, VerificationPlan)


@cache
def _builtin(name: str) -> VerificationPlan:
    """A plan of truearm, read once: simulated tests ask for it for each arm."""
    return parse_toml(plan_text(name).encode(), VerificationPlan)


def plan_text(name: str) -> str:
    """Return the text of a plan of truearm, to edit.

    Raises
    ------
    InputError
        If there is no plan of that name.
    """
    if name not in PLANS:
        raise InputError(f"there is no plan {name!r:.80}", hint=f"use {' or '.join(PLANS)}")
    return (files("truearm.verification.standards") / "plans" / f"{name}.toml").read_text(encoding="utf-8")
