"""What the arms of a fleet have in common, for the next arm of their type."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from truearm import __version__
from truearm.arm import Arm, load_arm
from truearm.compensation.models import KinematicModel
from truearm.compensation.models.arm_check import with_serial_number
from truearm.errors import InputError, TruearmError
from truearm.fleet.arm_list import RegisteredArm
from truearm.fleet.stored_files import local_copy
from truearm.fleet.type_gain import ArmEquations, estimate_type
from truearm.identification.estimation.type_scatter import TypeScatter
from truearm.identification.identify import Start, estimate_without_gross_errors
from truearm.identification.terms import constants
from truearm.identification.terms.type_prior import (
    FORMAT,
    ConstantPrior,
    HeldOutPart,
    TypePrior,
    kinematics_sha256,
    type_constants,
)
from truearm.readings import Lengths, Session, read_session
from truearm.readings.repeats import merge_repeats
from truearm.solve.executor import Executor, WorkerLost
from truearm.solve.threads import one_blas_thread
from truearm.workflows.inputs import within_limits
from truearm.workflows.record import TableRecord, TextTable, columns_of, format_fixed
from truearm.workflows.sentences import number_of

# A mean is said to differ from the nominal arm by more than this many of its standard uncertainties.
CLEAR = 3.0
MAX_ROWS = 10


class ArmTask(NamedTuple):
    """The arm whose readings are linearised: serial number, nominal arm, session file."""

    serial_number: str
    arm: str
    session: str


def arm_equations(task: ArmTask) -> ArmEquations | str:
    """The normal equations of an arm's readings, or why there are none."""
    try:
        arm = load_arm(task.arm)
        with local_copy(task.session) as file:
            return linearised_arm(arm, read_session(file, n_joints=arm.n_joints))
    except (TruearmError, OSError) as error:
        return str(error)


@one_blas_thread()
def linearised_arm(arm: Arm, session: Session, lengths: Lengths | None = None) -> ArmEquations:
    """The normal equations of the readings of an arm, about its identified constants.

    Raises
    ------
    InputError
        If the readings are not of this arm, or too few.
    """
    arm = with_serial_number(arm, session)
    used = merge_repeats(within_limits(session, arm).session).readings
    readings = KinematicModel(arm).prepare(used, lengths)
    terms = constants(arm.chain, free=readings.free)
    found = estimate_without_gross_errors(readings, terms, Start(np.ones(len(used))))
    return ArmEquations.of(found.fit, terms, readings)


@dataclass(frozen=True, eq=False, repr=False)
class LearnedTypePrior(TableRecord):
    """What the arms of a type have in common, and whether that helps the next one.

    Attributes
    ----------
    prior : TypePrior
    helps : bool
        Whether it predicts arms held out better than the prior of any arm.
    remarks : tuple of str
        Arms that were skipped, and why.

    Examples
    --------
    >>> import truearm as ta
    >>> from truearm.fleet.type_prior import learned_from, linearised_arm
    >>> sessions = [ta.simulate("ur10", poses=20, seed=i, arm_seed=i).session for i in range(3)]
    >>> arm = ta.load_arm("ur10")
    >>> learned = learned_from(arm, {f"{i}": linearised_arm(arm, one) for i, one in enumerate(sessions)})
    >>> learned.prior.arm, len(learned.prior.arms), learned.prior.gains[0].n_readings
    ('ur10', 3, 10)
    """

    prior: TypePrior
    helps: bool
    remarks: tuple[str, ...] = ()

    def save(self, path: str | Path) -> None:
        """Write the file that `truearm.fit` takes.

        Raises
        ------
        InputError
            If the prior does not help.
        """
        if not self.helps:
            raise InputError(self.summary(), hint="fit without --prior")
        self.prior.save(path)

    def summary(self) -> str:
        """Whether the prior helps."""
        of = f"{number_of(len(self.prior.arms), 'arm')} of type {self.prior.arm}"
        if not self.helps:
            return f"No gain: what {of} have in common does not help an arm held out. There is no type prior."
        best = min(self.prior.gains, key=lambda one: one.error_ratio)
        return (
            f"Type prior of {of}: with it an arm held out has {best.error_ratio:.2f} of the error "
            f"after {best.n_readings} readings."
        )

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        if self.prior.gains:
            yield TextTable(
                ("readings", "arms held out", "error with the prior / without", "u"),
                (
                    (
                        f"{one.n_readings}",
                        f"{one.n_arms}",
                        format_fixed(one.error_ratio, 2),
                        format_fixed(one.error_ratio_u, 2),
                    )
                    for one in self.prior.gains
                ),
            )
        clear = sorted(
            (one for one in self.prior.constants if abs(one.mean) > CLEAR * one.mean_u),
            key=lambda one: -abs(one.mean) / one.std,
        )
        if clear and self.helps:
            yield "Constants of the type that differ most from the nominal arm:"
            yield TextTable(("constant", "mean", "u", "scatter", ""), map(_row, clear[:MAX_ROWS]), left_aligned=(0, 4))
        yield from self.remarks

    def columns(self) -> dict[str, list[Any]]:
        """A row for each constant of the type: its difference from the nominal arm, in its ``unit`` (rad or mm)."""
        return columns_of(
            {**one.model_dump(), "unit": "mm" if "translation" in one.name else "rad"} for one in self.prior.constants
        )

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "helps": self.helps,
            "prior": self.prior.model_dump(),
            "remarks": self.remarks,
        }


def learn_type_prior(
    arms: Sequence[RegisteredArm],
    *,
    arm: str | None,
    executor: Executor,
    progress: Callable[[int, str], None] | None,
) -> LearnedTypePrior:
    """Learn what arms of one type have in common; see `Fleet.type_prior`."""
    kind = _type_of(arms, arm)
    tasks = [ArmTask(one.serial_number, one.arm, one.session) for one in arms if one.arm == kind]
    found: dict[int, ArmEquations] = {}
    skipped = {}
    for done, (i, result) in enumerate(executor.results(arm_equations, tasks), 1):
        if isinstance(result, ArmEquations):
            found[i] = result
        else:
            skipped[i] = result.reason if isinstance(result, WorkerLost) else result
        if progress is not None:
            progress(done, f"{done} of {len(tasks)}: {tasks[i].serial_number}")
    learned = learned_from(load_arm(kind), {tasks[i].serial_number: found[i] for i in sorted(found)}, progress=progress)
    remarks = tuple(f"{tasks[i].serial_number} is skipped: {skipped[i]}" for i in sorted(skipped))
    return replace(learned, remarks=remarks)


def learned_from(
    arm: Arm, arms: Mapping[str, ArmEquations], *, progress: Callable[[int, str], None] | None = None
) -> LearnedTypePrior:
    """What arms by serial number have in common.

    Raises
    ------
    InputError
        If they are too few, or have too few readings.
    """
    terms = type_constants(arm.chain)
    estimate = estimate_type(list(arms.values()), terms, progress=progress)
    mean, mean_u, std = _values(estimate.scatter)
    prior = TypePrior(
        format=FORMAT,
        truearm=__version__,
        arm=arm.name,
        arm_sha256=kinematics_sha256(arm),
        arms=tuple(arms),
        gains=estimate.gains,
        constants=tuple(
            ConstantPrior(name=term.name, mean=m, mean_u=u, std=s)
            for term, m, u, s in zip(terms, mean, mean_u, std, strict=True)
        ),
        held_out=tuple(
            HeldOutPart(arms=tuple(arms)[i :: len(estimate.parts)], mean=m, mean_u=u, std=s)
            for i, (m, u, s) in enumerate(map(_values, estimate.parts))
        ),
    )
    return LearnedTypePrior(prior, helps=estimate.helps)


def _values(scatter: TypeScatter) -> tuple[tuple[float, ...], ...]:
    """Mean, its uncertainty, and standard deviation of an arm about it, of every constant."""
    return tuple(tuple(part.tolist()) for part in (scatter.mean, scatter.mean_std, scatter.arm_std))


def _type_of(arms: Sequence[RegisteredArm], arm: str | None) -> str:
    """The nominal arm whose type is meant."""
    kinds = sorted({one.arm for one in arms})
    chosen = kinds if arm is None else [kind for kind in kinds if kind in (arm, str(Path(arm).absolute()))]
    if len(chosen) != 1:
        of = "no arm with a model in force" if not kinds else f"arms of {', '.join(kinds)[:200]}"
        asked = "one type" if arm is None else f"the type {arm}"
        raise InputError(f"expected {asked}, the fleet has {of}", hint="truearm fleet run FOLDER, or --arm ARM")
    return chosen[0]


def _row(one: ConstantPrior) -> tuple[str, ...]:
    unit, factor = ("mm", 1.0) if "translation" in one.name else ("mrad", 1e3)
    numbers = (format_fixed(factor * value, 3) for value in (one.mean, one.mean_u, one.std))
    return one.name, *numbers, unit
