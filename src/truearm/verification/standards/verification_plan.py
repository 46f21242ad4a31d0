"""Test plans: how many points, places, lengths and runs a standard's tests take, each number with its source.

The standards are sold; their texts were not at hand. So no such number stands in the evaluation: all are in plans
(TOML, in the folder ``plans``, or a user's own), each with where it comes from and whether it is confirmed.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, field_validator, model_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Name, NotNegative, Positive, parse_toml, read_document

CHECK_STANDARD = "check against your copy of the standard"
PLANS = ("iso10360-12", "asme-b89.4.22")


class _Sourced(Document):
    """A number of a plan: where it comes from, and whether a text that says so was read, or it is recalled."""

    confirmed: Annotated[bool, Field(strict=True)]
    source: Name


class Count(_Sourced):
    """A whole number."""

    value: Annotated[int, Field(strict=True, ge=1, le=1000)]


class Tolerated(_Sourced):
    """A whole number that may be 0."""

    value: Annotated[int, Field(strict=True, ge=0, le=1000)]


class Size(_Sourced):
    """A length [mm]."""

    value: Positive


class Share(_Sourced):
    """A share of a length; 0.66 is 66 %."""

    value: NotNegative

    @field_validator("value")
    @classmethod
    def _at_most_whole(cls, given: float) -> float:
        if given > 1:
            raise InputError(f"expected a share of 1 or less, got {given:g}", hint="0.66 is 66 %")
        return given


class PlannedTest(Document):
    """What every test of a plan has: whether a verification without it is incomplete, and the text it comes from."""

    required: Annotated[bool, Field(strict=True)]
    clause: Name


class _OnSphere(PlannedTest):
    points: Count
    smallest_sphere_mm: Size
    largest_sphere_mm: Size

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.smallest_sphere_mm.value > self.largest_sphere_mm.value:
            raise InputError("smallest_sphere_mm is larger than largest_sphere_mm")
        if self.points.value < 5:
            raise InputError(f"expected 5 points or more of a sphere, which leaves one spare, got {self.points.value}")
        return self


class Probing(_OnSphere):
    """P_Size and P_Form: so many points on a sphere at so many positions."""

    positions: Count


class Articulation(_OnSphere):
    """L_Dia: so many points in each group of one direction, at so many positions."""

    groups: Count
    positions: Count


class LengthTest(PlannedTest):
    """E_Uni and E_Bi: lengths at positions, each repeated.

    `tolerated_sets` of one length at one position may have one value outside, if measured again as often with all
    inside: the rule of ISO 10360-2; 0 switches it off.
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
    """Single-point articulation: points in a seat in each zone of the reach, one position a zone."""

    points: Count
    positions: Count


class Volumetric(PlannedTest):
    """Volumetric performance: lengths, in so many positions in all."""

    lengths: Count
    positions: Count
    longest_share: Share


class VerificationPlan(Document):
    """A test plan; tests that it has not are not part of it."""

    name: Name
    title: Name
    standard: Name
    probing: Probing | None = None
    articulation: Articulation | None = None
    uni: LengthTest | None = None
    bi: LengthTest | None = None
    effective_diameter: EffectiveDiameter | None = None
    single_point: SinglePoint | None = None
    volumetric: Volumetric | None = None

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if not self.tests:
            raise InputError("expected a test, got none", hint=", ".join(sorted(TESTS)))
        return self

    @property
    def tests(self) -> dict[str, PlannedTest]:
        """The tests of the plan by name, in the order of the standards."""
        found = {name: getattr(self, name) for name in TESTS}
        return {name: test for name, test in found.items() if test is not None}

    def unconfirmed(self) -> Iterator[tuple[str, float, str]]:
        """Numbers that were recalled and not read: key, value and where it comes from."""
        for name, test in self.tests.items():
            for key in type(test).model_fields:
                number = getattr(test, key)
                if isinstance(number, _Sourced) and not number.confirmed:
                    yield f"{name}.{key}", number.value, number.source  # type: ignore[attr-defined]

    def changed_numbers(self) -> Iterator[tuple[str, float, float]]:
        """Numbers other than in the program's own plan after the same standard: key, value, value there."""
        there = next((plan.tests for plan in map(_coming, PLANS) if plan.standard == self.standard), {})
        for name, test in self.tests.items():
            for key in type(test).model_fields:
                number, other = getattr(test, key), getattr(there.get(name), key, None)
                if isinstance(number, _Sourced) and isinstance(other, _Sourced):
                    value, coming_value = number.value, other.value  # type: ignore[attr-defined]
                    if value != coming_value:
                        yield f"{name}.{key}", value, coming_value


TESTS = tuple(name for name, field in VerificationPlan.model_fields.items() if not field.is_required())


def load_verification_plan(name: str | Path) -> VerificationPlan:
    """Load a plan: one that comes with the program by its name, or a file.

    Raises
    ------
    InputError
        If there is no plan of that name and no such file, or it breaks a rule of the format.
    """
    if str(name) in PLANS:
        return _coming(str(name))
    if not str(name).endswith(".toml"):
        raise InputError(
            f"there is no plan {str(name)!r:.80}", hint=f"{', '.join(PLANS)}, or a file that ends in .toml"
        )
    return read_document(name, VerificationPlan)


@cache
def _coming(name: str) -> VerificationPlan:
    """A plan that comes with the program, read once: simulated tests ask for it arm by arm."""
    return parse_toml(plan_text(name).encode(), VerificationPlan)


def plan_text(name: str) -> str:
    """The text of a plan that comes with the program, to edit.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in PLANS:
        raise InputError(f"there is no plan {name!r:.80}", hint=" or ".join(PLANS))
    return (files("truearm.verification.standards") / "plans" / f"{name}.toml").read_text(encoding="utf-8")
