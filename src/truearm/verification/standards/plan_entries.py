"""Entries of a test plan: numbers and named formulas, each with where it stands and whether somebody looked it up.

Whatever enters a verdict is such an entry. Formulas are names out of closed lists, one for each that the evaluation
implements: the name states what is calculated, so that it can be compared with the text of the standard.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeVar, get_args, get_origin

from pydantic import AfterValidator, Field, model_validator

from truearm.files.toml_documents import Document, reject_control_characters

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
