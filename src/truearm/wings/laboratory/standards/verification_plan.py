"""Test plans: the numbers and formulas of a standard's tests, each with where it stands.

The standards are sold; their texts were not available. So all such numbers are in plans and none is in the evaluation,
and the formulas of the evaluation are named there: TOML files in the folder ``plans``, or the user's own, that state
the source of each entry and whether somebody has confirmed it.

Whatever enters a verdict is an entry of a plan, with where it stands and whether somebody looked it up. Formulas are
names out of closed lists, one for each that the evaluation implements: the name states what is calculated, so that it
can be compared with the text of the standard.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Literal, Self, TypeVar, get_args, get_origin

from pydantic import AfterValidator, Field, field_validator, model_validator

from truearm.errors import InputError
from truearm.files.dates import check_past
from truearm.files.toml_documents import (
    Document,
    Name,
    NotNegative,
    Positive,
    parse_toml,
    read_document,
    reject_control_characters,
)
from truearm.wings.laboratory.standards.decision import DECISION_RULES, DecisionRule
from truearm.wings.laboratory.standards.specification import check_no_verdict, named_standards

V = TypeVar("V", bound=float | str)
# Of an entry that a plan of an earlier version does not have.
NOT_IN_PLAN = "recalled; not in the plan file"
# Names of standards with their editions, years and parts: what remains of a source must name the place in the text.
_DESIGNATION = re.compile(
    r"\b[A-Z]{2,}(?:[/ ][A-Z]{2,})*[ -][A-Z]?\d[\d.\-]*(?::\s?\d{4})?|\b(?:19|20)\d\d\b|\b[Pp]art \d+"
)
# A number of a clause alone or with points, or a word for a place with its number: not any number.
_PLACE = re.compile(
    r"\d\.\d|^\W*\d+\W*$|§ ?\d|\b(?:clause|section|paragraph|page|table|figure|equation|formula|annex|appendix|"
    r"agreement|contract|order|offer|no)s?\W{0,4}(?:no\W{0,4})?(?:\d|[A-Z]\b)",
    re.IGNORECASE,
)
# Words of somebody who did not read the text, or not yet; and clause 0, which no text has.
_UNREAD = re.compile(
    r"\b(?:recall\w*|memory|remember\w*|to ?do|tb[acd]|fixme|guess\w*|placeholder|dummy|unknown|unsure|not sure|maybe|"
    r"perhaps|probably|presumably|hearsay|look up|not (?:yet )?(?:read|seen|checked|confirmed|compared))\b|\?|x{3,}",
    re.IGNORECASE,
)
_NOWHERE = re.compile(r"(?<![\w.])0+(?:\.0+)*(?!\w|\.\d)")


class PlanEntry(Document, Generic[V]):
    """A number or formula of a plan, and where it stands; `confirmed` by somebody who read it there."""

    value: V
    confirmed: Annotated[bool, Field(strict=True)]
    source: Annotated[str, Field(max_length=200, strict=True), AfterValidator(reject_control_characters)]


class WithFormulas(Document):
    """A table whose formulas and newer numbers are added, not confirmed, to a plan of an earlier version."""

    numbers_of_earlier_plans: ClassVar[Mapping[str, float]] = {}

    @model_validator(mode="before")
    @classmethod
    def _formulas_of_earlier_plans(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        named = {name: _formula_names(field.annotation)[:1] for name, field in cls.model_fields.items()}
        values = {**{name: names[0] for name, names in named.items() if names}, **cls.numbers_of_earlier_plans}
        added = {
            name: {"value": value, "confirmed": False, "source": NOT_IN_PLAN}
            for name, value in values.items()
            if name not in given
        }
        return {**given, **added}


@dataclass(frozen=True)
class StatedEntry:
    """An entry with its place in the plan.

    Attributes
    ----------
    key : str
        ``uni.lengths``; of the whole plan ``decision_rule``.
    value : float or str
        The number, or the name of the formula.
    confirmed : bool
    source : str
        Where it stands.
    """

    key: str
    value: float | str
    confirmed: bool
    source: str

    @property
    def test(self) -> str:
        """The test that has the entry; of the whole plan ``uncertainty`` or ``decision``."""
        return self.key.partition(".")[0] if "." in self.key else "decision"

    @property
    def name(self) -> str:
        """The key without its test."""
        return self.key.rpartition(".")[2]

    def describe(self) -> str:
        """``lengths = 5``; ``error: measured - calibrated length``."""
        return f"{self.name}: {self.value}" if isinstance(self.value, str) else f"{self.name} = {self.value:g}"

    @property
    def fault(self) -> str | None:
        """Why a confirmed entry does not say where it was read; None if it does."""
        if not self.source.strip():
            return "its source is empty"
        if unread := _UNREAD.search(self.source):
            return f"its source still says {unread[0].casefold()}"
        place = _NOWHERE.sub("", _DESIGNATION.sub("", self.source))
        return None if _PLACE.search(place) else "its source names no clause"


def stated_entries(table: Document, key: str) -> Iterator[StatedEntry]:
    """Yield the entries of a table of a plan, in its order."""
    for name in type(table).model_fields:
        if isinstance(entry := getattr(table, name), PlanEntry):
            yield StatedEntry(f"{key}.{name}" if key else name, entry.value, entry.confirmed, entry.source)


def _formula_names(annotation: Any) -> tuple[str, ...]:
    """The names of the formulas that an entry may have; empty for an entry with a number."""
    if not (isinstance(annotation, type) and issubclass(annotation, PlanEntry)):
        return ()
    value = annotation.model_fields["value"].annotation
    return get_args(value) if get_origin(value) is Literal else ()


CHECK_STANDARD = "check against your copy of the standard"
PLANS = ("iso10360-12", "asme-b89.4.22")


def _at_most_whole(share: float) -> float:
    if share > 1:
        raise InputError(f"expected a share of 1 or less, got {share:g}", hint="write 0.66 for 66 %")
    return share


Count = PlanEntry[Annotated[int, Field(strict=True, ge=1, le=1000)]]
Tolerated = PlanEntry[Annotated[int, Field(strict=True, ge=0, le=1000)]]
Size = PlanEntry[Positive]  # [mm], or a ratio
Share = PlanEntry[Annotated[NotNegative, AfterValidator(_at_most_whole)]]  # of a length; 0.66 is 66 %

GuardBand = Literal[
    "1.645 u, probability of 95 %", "U on both sides of the limit", "none where U is at most limit / 4, else U"
]
GUARD_BANDS: dict[DecisionRule, GuardBand] = {
    "iso14253-1:2017": "1.645 u, probability of 95 %",
    "iso14253-1:2013": "U on both sides of the limit",
    "simple": "none where U is at most limit / 4, else U",
}


class Uncertainty(WithFormulas):
    """How the uncertainty of every test value is evaluated."""

    contributions: PlanEntry[Literal["artefact and set-up, without the arm"]]
    form: PlanEntry[Literal["up to half the form deviation, uniform"]]
    coverage: PlanEntry[Literal["k = 2, or Student's t for 95.45 %"]]


class PlannedTest(WithFormulas):
    """A test of a plan: whether a verification needs it, and the clause of the standard."""

    required: Annotated[bool, Field(strict=True)]
    clause: Name


# The pattern of points on a sphere that is checked.
EVEN: Literal["evenly over half of the sphere"] = "evenly over half of the sphere"


class _OnSphere(PlannedTest):
    points: Count
    pattern: PlanEntry[Literal["evenly over half of the sphere", "as the operator chose"]]
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
    size: PlanEntry[Literal["least-squares diameter - calibrated"]]
    form: PlanEntry[Literal["max - min distance from the least-squares centre"]]


class Articulation(_OnSphere):
    """L_Dia: groups of points, each with one direction of the stylus, at several positions."""

    groups: Count
    positions: Count
    location: PlanEntry[Literal["diameter of the smallest sphere around the centres"]]


class LengthTest(PlannedTest):
    """E_Uni and E_Bi: lengths at positions, each repeated.

    In up to `tolerated_sets` sets (one length at one position) one value may exceed its limit, if none does when
    the set is measured again: the rule of ISO 10360-2; 0 switches it off. Of the directions of each length, as many
    as planned are 30 degrees and more apart. The longest length is `longest_share` of the measuring range or more, the
    shortest `shortest_most_share` or less; the widest gap between two of them is `gap_ratio` times the mean or less.
    """

    numbers_of_earlier_plans: ClassVar = {"directions": 4, "shortest_most_share": 0.2, "gap_ratio": 2.0}

    lengths: Count
    positions: Count
    directions: Count
    repeats: Count
    longest_share: Share
    shortest_most_share: Share
    gap_ratio: Size
    tolerated_sets: Tolerated
    error: PlanEntry[Literal["measured - calibrated length"]]


class EffectiveDiameter(_OnSphere):
    """Effective diameter: runs of points on one sphere."""

    repeats: Count
    error: PlanEntry[Literal["largest |least-squares diameter - calibrated|"]]


class SinglePoint(PlannedTest):
    """Single-point articulation: points in a seat, one position in each zone of the reach.

    The nearest and the farthest seat are a share of the measuring range apart.
    """

    numbers_of_earlier_plans: ClassVar = {"spread_share": 0.3}

    points: Count
    positions: Count
    spread_share: Share
    largest: PlanEntry[Literal["largest distance from the mean"]]
    twice_s: PlanEntry[Literal["2 s, divisor n - 1"]]


class Volumetric(PlannedTest):
    """Volumetric performance: lengths at several positions in all, in several directions each.

    The longest and the shortest length each lie in a zone, from a share of the measuring range to another.
    """

    numbers_of_earlier_plans: ClassVar = {
        "directions": 4,
        "shortest_share": 0.25,
        "shortest_most_share": 0.375,
        "longest_most_share": 0.75,
    }

    lengths: Count
    positions: Count
    directions: Count
    shortest_share: Share
    shortest_most_share: Share
    longest_share: Share
    longest_most_share: Share
    largest: PlanEntry[Literal["largest |measured - calibrated length|"]]
    twice_s: PlanEntry[Literal["2 s about the mean, divisor n - 1"]]
    twice_rms: PlanEntry[Literal["2 RMS, divisor n"]]


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
    decision_rule : PlanEntry
        One of "iso14253-1:2017", "iso14253-1:2013" and "simple": that of `verify`, unless that is given another one.
    guard_band : PlanEntry
        That of the rule.
    uncertainty : Uncertainty
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
    decision_rule: PlanEntry[DecisionRule]
    guard_band: PlanEntry[GuardBand]
    uncertainty: Uncertainty
    confirmation: Confirmation | None = None
    probing: Probing | None = None
    articulation: Articulation | None = None
    uni: LengthTest | None = None
    bi: LengthTest | None = None
    effective_diameter: EffectiveDiameter | None = None
    single_point: SinglePoint | None = None
    volumetric: Volumetric | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_earlier_versions(cls, given: Any) -> Any:
        """Plans of earlier versions state the rule without a source, and no formulas: these are not confirmed."""
        if not isinstance(given, dict):
            return given
        rule = given.get("decision_rule", DECISION_RULES[0])
        if isinstance(rule, str):
            rule = {"value": rule, "confirmed": False, "source": NOT_IN_PLAN}
        named = rule.get("value") if isinstance(rule, dict) else None
        band = GUARD_BANDS.get(named, GUARD_BANDS[DECISION_RULES[0]])  # type: ignore[arg-type]
        added = {"guard_band": {"value": band, "confirmed": False, "source": NOT_IN_PLAN}, "uncertainty": {}}
        return {**added, **given, "decision_rule": rule}

    @model_validator(mode="after")
    def _guard_band_of_the_rule(self) -> Self:
        rule, band = self.decision_rule.value, self.guard_band.value
        if band != GUARD_BANDS[rule]:
            raise InputError(
                f"the rule {rule!r} has another guard band than {band!r}",
                hint=f'write guard_band = {{ value = "{GUARD_BANDS[rule]}", .. }}, or another decision_rule',
            )
        return self

    @model_validator(mode="after")
    def _looked_up(self) -> Self:
        """A confirmed entry says where somebody read it; the word of the person alone opens no gate."""
        faults: dict[str, list[str]] = {}
        for one in self.entries():
            if one.confirmed and one.source not in _EARLIER_SOURCES and (fault := one.fault) is not None:
                faults.setdefault(fault, []).append(one.key)
        for fault, keys in faults.items():
            raise InputError(
                f"{', '.join(keys)}: confirmed = true, but {fault}",
                hint=f'type where it stands in {self.standard}, such as source = "clause 6.2.3" (an agreement: its '
                "number), or set confirmed = false",
            )
        return self

    @field_validator("title")
    @classmethod
    def _claims_nothing(cls, title: str) -> str:
        return check_no_verdict(title)

    @model_validator(mode="after")
    def _names_its_own_standard(self) -> Self:
        others = [one for one in named_standards(self.title) if one not in self.standard]
        if others:
            raise InputError(
                f"title: expected what is tested, got {self.title!r:.80}, which names {others[0]!r:.40}; the plan is "
                f"after {self.standard!r:.80}",
                hint="name a standard under standard only",
            )
        return self

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
        """The title; it names the standard as followed only if every entry is the standard's and is confirmed."""
        title = self.title.partition(", after ")[0]  # plans that earlier versions printed name the standard there
        if self.confirmation_gap(self.tests) is not None:
            plan = "own plan," if self.is_own else "plan"
            return f"{title} ({plan} not confirmed against {self.standard})"
        return f"{title}, own plan" if self.is_own else f"{title}, after {self.standard}"

    def confirmation_gap(self, tests: Collection[str], rule: DecisionRule | None = None) -> str | None:
        """Return what is missing before results of these tests, decided by a rule, count as confirmed.

        Parameters
        ----------
        tests : collection of str
            Those that were carried out.
        rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}, optional
            The rule of the decision; by default that of the plan.
        """
        missing = [one.key for one in self.unconfirmed(tests)]
        if missing:
            entries = "entry is" if len(missing) == 1 else "entries are"
            return (
                f"{len(missing)} {entries} not confirmed against {self.standard} in the test plan {self.name!r}: "
                f"{', '.join(missing)}"
            )
        if self.confirmation is None:
            return f"the test plan {self.name!r} does not state who confirmed its entries against {self.standard}"
        if rule not in (None, self.decision_rule.value):
            return (
                f"the decision rule {rule!r} is not that of the test plan {self.name!r}, "
                f"{self.decision_rule.value!r}: enter it there, with its source"
            )
        return None

    @property
    def tests(self) -> dict[str, PlannedTest]:
        """The tests of the plan by name, in the order of the standards."""
        tests = {name: getattr(self, name) for name in TESTS}
        return {name: test for name, test in tests.items() if test is not None}

    def entries(self, tests: Collection[str] | None = None) -> Iterator[StatedEntry]:
        """Yield what enters a verdict: the numbers and formulas of some tests (all by default), and of the decision."""
        for name, test in self.tests.items():
            if tests is None or name in tests:
                yield from stated_entries(test, name)
        yield from stated_entries(self.uncertainty, "uncertainty")
        yield from stated_entries(self, "")

    def unconfirmed(self, tests: Collection[str] | None = None) -> Iterator[StatedEntry]:
        """Yield the entries that nobody has confirmed."""
        return (one for one in self.entries(tests) if not is_confirmed(one))

    @property
    def is_own(self) -> bool:
        """Whether it is another plan than the standard's, as far as truearm knows that one."""
        return self._known is None or any(self.differences())

    def differences(self) -> Iterator[tuple[str, str]]:
        """Yield the tests, and what differs in them from truearm's plan after the same standard.

        The decision rule is no part of it: standards let customer and laboratory agree on another one.
        """
        known = {} if self._known is None else self._known.tests
        for name, there in known.items():
            test = self.tests.get(name)
            if there.required and (test is None or not test.required):
                yield name, "not in this plan" if test is None else "not required here"
            for one, other in zip(stated_entries(test, name), stated_entries(there, name), strict=True) if test else ():
                if one.value != other.value:
                    yield name, f"{one.describe()} ({other.describe().removeprefix(f'{one.name} = ')})"

    @property
    def _known(self) -> VerificationPlan | None:
        """The plan of truearm after the same standard."""
        return next((plan for plan in map(_builtin, PLANS) if plan.standard == self.standard), None)


# Sources that plans of earlier versions called confirmed: they name no clause, and count as not confirmed.
_EARLIER_SOURCES = ("Kreon's page on ISO 10360-12",)


def is_confirmed(entry: StatedEntry) -> bool:
    """Whether somebody read the entry where it says that it stands."""
    return entry.confirmed and entry.source not in _EARLIER_SOURCES


TESTS = tuple(
    name for name, field in VerificationPlan.model_fields.items() if not field.is_required() and name != "confirmation"
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
    return (files("truearm.wings.laboratory.standards") / "plans" / f"{name}.toml").read_text(encoding="utf-8")
