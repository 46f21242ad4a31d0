"""A verification with what went into it: what a page or a certificate is made of."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan

from truearm.verification.standards.artefacts import Artefact, Artefacts
from truearm.verification.standards.decision import ConformityResult, DecisionRule
from truearm.verification.standards.measured_points import MeasuredPoints, PointGroup
from truearm.verification.standards.specification import Specification
from truearm.verification.standards.verification import Verification
from truearm.verification.standards.verification_plan import VerificationPlan


@dataclass(frozen=True, eq=False)
class VerificationRecord:
    """A verification with what went into it.

    Parameters
    ----------
    verification : Verification
    measured : MeasuredPoints
    plan : VerificationPlan
    artefacts : Artefacts
    specification : Specification
    rule : {"iso14253-1", "simple"}
    plan_sha256 : str, optional
        SHA-256 of the file of the plan, where it is one of the user's own.
    """

    verification: Verification
    measured: MeasuredPoints
    plan: VerificationPlan
    artefacts: Artefacts
    specification: Specification
    rule: DecisionRule = "iso14253-1"
    plan_sha256: str | None = None

    @property
    def groups(self) -> tuple[PointGroup, ...]:
        """The groups of points of all tests."""
        return tuple(group for groups in self.measured.tests.values() for group in groups)

    @property
    def rows_with_limit(self) -> tuple[ConformityResult, ...]:
        """The rows that have a limit."""
        return tuple(row for row in self.verification.rows if row.verdict is not None)

    @property
    def used_artefacts(self) -> tuple[Artefact, ...]:
        """The artefacts that points were taken on, in the order of the file of artefacts."""
        names = {group.artefact for group in self.groups}
        kinds = (self.artefacts.spheres, self.artefacts.bars, self.artefacts.seats)
        return tuple(one for kind in kinds for one in kind if one.name in names)

    def lengths_of(self, bar: str) -> set[str]:
        """The names of a bar's lengths that were measured."""
        return {group.keys["length"] for group in self.groups if group.artefact == bar}

    @property
    def temperatures(self) -> tuple[float, float] | None:
        """The lowest and the highest of the groups' mean artefact temperatures [degC]; None if none is known."""
        known = [group.degC for group in self.groups if not isnan(group.degC)]
        return (min(known), max(known)) if known else None
