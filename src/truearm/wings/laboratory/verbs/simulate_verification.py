"""`simulate_verification`: the test of a standard, taken by virtual arms before anything is measured."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor
from pathlib import Path
from typing import Any

from truearm.models import Compensator
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import ArmLike
from truearm.verbs.record import TableRecord, TextTable, columns_of
from truearm.wings.laboratory.standards.artefacts import Artefacts
from truearm.wings.laboratory.standards.decision import DecisionRule, Verdict
from truearm.wings.laboratory.standards.measured_points import MeasuredPoints
from truearm.wings.laboratory.standards.specification import Specification
from truearm.wings.laboratory.standards.verification import Verification
from truearm.wings.laboratory.standards.verification_plan import VerificationPlan
from truearm.wings.laboratory.tasks import simulated_verification as simulation
from truearm.wings.laboratory.tasks.posed_test import PosedTest, pose_test
from truearm.wings.laboratory.tasks.sampled_arms import ArmDistribution
from truearm.wings.laboratory.verbs.task import to_arm_distribution
from truearm.wings.laboratory.verbs.verify import (
    ArtefactsLike,
    PlanLike,
    SpecificationLike,
    to_artefacts,
    to_plan,
    to_specification,
)
from truearm.wings.planning.virtual.presets import Preset


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedVerification(TableRecord):
    """What virtual arms obtain in the test of a standard.

    Attributes
    ----------
    source : str
        What is known of the arms: a preset or a model.
    arms : ArmDistribution
        The arms that may be the one in question.
    posed : PosedTest
        The points of the test with joint angles.
    plan, artefacts, specification, rule
        As of `verify`.
    artefacts_source : str
        File of the artefacts; ``example`` if there is none.
    verifications : tuple of Verification
        One for each arm.
    seed : int
        Seed of arms, poses and noise.
    """

    source: str
    arms: ArmDistribution
    posed: PosedTest
    plan: VerificationPlan
    artefacts: Artefacts
    artefacts_source: str
    specification: Specification
    rule: DecisionRule
    verifications: tuple[Verification, ...]
    seed: int

    @property
    def n_arms(self) -> int:
        """Number of virtual arms."""
        return len(self.verifications)

    @property
    def rows(self) -> tuple[simulation.ResultDistribution, ...]:
        """How each test value is distributed over the arms."""
        return simulation.result_distributions(self.verifications)

    @property
    def shares(self) -> Mapping[Verdict, float]:
        """Shares of the arms by the verdict of the whole test."""
        return simulation.verdict_shares(self.verifications)

    @property
    def n_conform(self) -> int:
        """Number of arms that conform."""
        return sum(one.verdict is Verdict.CONFORM for one in self.verifications)

    @property
    def conform_interval(self) -> tuple[float, float]:
        """Bounds of the share of all such arms that conform, 95 % confidence."""
        return simulation.proportion_interval(self.n_conform, self.n_arms)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks of the verification of the first arm: not tested, numbers of the plan to check."""
        return self.verifications[0].remarks

    def points(self, number: int) -> MeasuredPoints:
        """The points that one of the arms measures, counted from 0, as `verify` takes them."""
        own = simulation.MAX_ARMS * self.seed + number
        return simulation.simulate_points(self.arms.draw(own), self.posed, self.artefacts, seed=own)

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        low, high = self.conform_interval
        n = self.n_arms
        yield (
            f"{self.n_conform} of {n} virtual arms {self.arms.arm.name} ({self.source}) conform: "
            f"{floor(100 * low)} % to {ceil(100 * high)} % of all such arms (95 % confidence)"
        )
        yield f"{self.plan.heading}; limits: {self.specification.name}, {self.specification.source}"
        if self.artefacts_source == "example":
            yield "artefacts: examples; give your own certificates"
        heads = ["test", "median [mm]", "95 % [mm]", "limit [mm]", *(verdict.value for verdict in _VERDICTS)]
        whole = ["whole test", "", "", "", *_percent([self.shares[verdict] for verdict in _VERDICTS])]
        yield TextTable(heads, [*map(_cells, self.rows), whole])
        all_conform, _ = simulation.proportion_interval(n, n)
        yield (
            "median, 95 %: not exceeded in magnitude by half of the arms, and by 95 % of them; 100 % in a line means "
            f"{floor(100 * all_conform)} % or more of all such arms"
        )
        yield from self.remarks

    def columns(self) -> dict[str, list[Any]]:
        """A row for each test value, in its ``unit``: its distribution over the arms, and shares of the verdicts."""
        return columns_of(self.rows)

    def _json(self) -> object:
        return {
            "simulated": self.source,
            "arm": self.arms.arm.name,
            "arms": self.n_arms,
            "seed": self.seed,
            "plan": self.plan.name,
            "standard": self.plan.standard,
            "specification": self.specification.name,
            "artefacts": self.artefacts_source,
            **self._named("rule", "rows"),
            "all": {verdict.value.replace(" ", "_"): share for verdict, share in self.shares.items()},
            "conform_interval_95": self.conform_interval,
            "remarks": self.remarks,
        }


@one_blas_thread()
def simulate_verification(
    source: Compensator | Preset | str | Path,
    *,
    arm: ArmLike | None = None,
    plan: PlanLike = "iso10360-12",
    artefacts: ArtefactsLike | None = None,
    specification: SpecificationLike | None = None,
    rule: DecisionRule | None = None,
    n_arms: int = 100,
    seed: int = 0,
    progress: Callable[[int, str], None] | None = None,
) -> SimulatedVerification:
    """Simulate the test of a standard with virtual arms: which share of them conforms.

    Parameters
    ----------
    source : Preset, identified model, str or path
        What is known of the arms: a preset (``research``, ``shop``, ``worn``, ``printed``, ``perfect``), or a model
        (file).
    arm : Arm, str or path, optional
        The nominal arm of a preset; by default ``measuring7``. A model has its own.
    plan, rule
        As of `verify`.
    artefacts : Artefacts or path, optional
        Certificates of the artefacts; by default examples.
    specification : Specification or path, optional
        The limits of the arm; by default an example, with the largest measuring range that the arm reaches.
    n_arms : int
        Number of virtual arms.
    seed : int
        Seed of arms, poses and noise.
    progress : callable, optional
        Called with the number of arms done and a remark.

    Returns
    -------
    SimulatedVerification

    Raises
    ------
    InputError
        If the arm does not reach all points, or errs so much that an artefact cannot be recognized.

    Examples
    --------
    >>> import truearm as ta
    >>> simulated = ta.simulate_verification("perfect", n_arms=2)
    >>> simulated.n_conform
    2
    """
    tell = progress or _silent
    planned = to_plan(plan)
    arms, about = to_arm_distribution(source, arm)
    tell(0, "finding poses")
    limits, certified, posed = pose_test(
        arms.arm,
        planned,
        artefacts=None if artefacts is None else to_artefacts(artefacts),
        specification=None if specification is None else to_specification(specification),
        seed=seed,
    )
    verifications = simulation.simulate_verification(
        arms,
        posed,
        plan=planned,
        artefacts=certified,
        specification=limits,
        n_arms=n_arms,
        seed=seed,
        rule=rule,
        progress=lambda done: tell(done, ""),
    )
    where = "example" if artefacts is None else str(artefacts) if isinstance(artefacts, str | Path) else "given"
    return SimulatedVerification(
        about,
        arms,
        posed,
        planned,
        certified,
        where,
        limits,
        rule or planned.decision_rule.value,
        tuple(verifications),
        seed,
    )


_VERDICTS = (Verdict.CONFORM, Verdict.NOT_CONFORM, Verdict.UNDECIDED)


def _cells(row: simulation.ResultDistribution) -> list[str]:
    digits = ".4f" if row.unit == "mm" else "g"  # else a count
    limit = "" if row.limit is None else format(row.limit, digits)
    shares = [""] * 3 if row.limit is None else _percent([row.conform, row.not_conform, row.undecided])
    return [row.label, format(row.median, digits), format(row.quantile_95, digits), limit, *shares]


def _percent(shares: Sequence[float]) -> list[str]:
    return [f"{100 * share:.3g} %" for share in shares]


def _silent(done: int, note: str) -> None:
    """Ignore the progress."""
