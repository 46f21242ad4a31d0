"""What the arms of a fleet have in common, for the next arm of their type.

Whether that helps is shown by each arm in turn, held out and predicted from few readings. From a few readings of an arm
its constants are estimated twice: with the prior of the type as the other arms show it, and with that of any arm. What
counts is the error at its other readings, beyond that of the arm as all of its readings show it: noise, and what no
constant explains, are in both. All is to first order, on the normal equations of each arm, so that no arm is fitted
again.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t as student

from truearm import __version__
from truearm.arm import Arm, load_arm
from truearm.errors import InputError, TruearmError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.type_scatter import ReadingEquations, TypeScatter, type_scatter
from truearm.identification.identify import Start, estimate_without_gross_errors
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.terms import Term, constants
from truearm.identification.terms.type_prior import (
    FORMAT,
    ConstantPrior,
    HeldOutGain,
    HeldOutPart,
    TypePrior,
    kinematics_sha256,
    type_constants,
)
from truearm.models import KinematicModel
from truearm.models.arm_check import with_serial_number
from truearm.readings import Lengths, Session, read_session
from truearm.readings.repeats import merge_repeats
from truearm.solve.executors import Executor, WorkerLost
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.verbs.inputs import within_limits
from truearm.verbs.record import TableRecord, TextTable, columns_of, format_fixed, number_of
from truearm.wings.fleet.arm_list import RegisteredArm
from truearm.wings.fleet.stored_files import local_copy

# Readings of an arm that is held out from which the others are predicted; these are as many at least.
FEW = (10, 20)
LEAST_ARMS = 3
# Arms are held out one by one, or in so many parts.
MOST_PARTS = 20
# A prior is kept if the error falls, of which one can be as sure as this, and grows by no larger share anywhere.
CONFIDENCE, MOST_GROWTH = 0.95, 0.01


@dataclass(frozen=True, eq=False)
class ArmEquations:
    """The readings of one arm: the first few, the next few, and all others, in random order."""

    parts: tuple[ReadingEquations, ...]

    @classmethod
    def of(cls, fit: IdentificationResult, offered: Sequence[Term], readings: PreparedReadings) -> ArmEquations:
        """Those of readings from which an arm was identified by the terms offered."""
        n = len(readings)
        rank = np.random.default_rng(0).permutation(n)
        limits = [0, *(few for few in FEW if 2 * few <= n), n]
        parts = (
            ReadingEquations.of(fit, offered, readings.state, readings.references, (rank >= low) & (rank < high))
            for low, high in itertools.pairwise(limits)
        )
        return cls(tuple(parts))

    @property
    def all(self) -> ReadingEquations:
        """Of all readings."""
        return reduce(add, self.parts)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms of the arm."""
        return self.parts[0].terms

    @property
    def coefficients(self) -> list[str]:
        """Name of the term of each coefficient."""
        return [term.name for term in self.terms for _ in range(term.n_coefficients)]


class TypeEstimate(NamedTuple):
    """Constants of a type, what their prior gains on arms held out, and what they are without each part held out.

    Arm i is of part ``i % len(parts)``.
    """

    scatter: TypeScatter
    gains: tuple[HeldOutGain, ...]
    parts: tuple[TypeScatter, ...] = ()

    @property
    def helps(self) -> bool:
        """Whether the prior of the type is better than that of any arm."""
        logs = [(np.log(one.error_ratio), one.error_ratio_u / one.error_ratio, one.n_arms) for one in self.gains]
        falls = any(log < -student.ppf(CONFIDENCE, n - 1) * u for log, u, n in logs)
        return bool(falls and all(one.error_ratio <= 1 + MOST_GROWTH for one in self.gains))


def estimate_type(
    arms: Sequence[ArmEquations], terms: Sequence[Term], *, progress: Callable[[int, str], None] | None = None
) -> TypeEstimate:
    """Estimate what arms of a type have in common, and what that gains.

    Parameters
    ----------
    arms : sequence of ArmEquations
    terms : sequence of Term
        The p constants of the type (`truearm.identification.terms.type_prior.type_constants`).
    progress : callable, optional
        Called with the number of parts held out and a note.

    Raises
    ------
    InputError
        If there are fewer than `LEAST_ARMS` arms, or too few readings of them to hold any out.
    """
    names = [term.name for term in terms]
    enough = [one for one in arms if len(one.parts) > 1]
    if len(enough) < LEAST_ARMS:
        raise InputError(
            f"expected {LEAST_ARMS} arms or more of the type with {2 * FEW[0]} readings each, got {len(enough)}"
        )
    equations = [one.all.of_terms(np.isin(one.coefficients, names)) for one in arms]
    whole, n_parts = type_scatter(equations, terms), min(len(arms), MOST_PARTS)
    logs: dict[int, list[float]] = {}
    without: list[TypeScatter] = []
    for part in range(n_parts):
        others = [one for i, one in enumerate(equations) if i % n_parts != part]
        found = type_scatter(others, terms, start=whole)
        without.append(found)
        for arm in arms[part::n_parts]:
            for few, log_ratio in _log_ratios(arm, names, found).items():
                logs.setdefault(few, []).append(log_ratio)
        if progress is not None:
            progress(part + 1, f"arms held out: {part + 1} of {n_parts} parts")
    gains = tuple(_gain(few, np.array(found)) for few, found in logs.items() if len(found) >= LEAST_ARMS)
    return TypeEstimate(whole, gains, tuple(without))


def _log_ratios(arm: ArmEquations, names: Sequence[str], found: TypeScatter) -> dict[int, float]:
    """By number of readings the logarithm of the ratio of the errors at the others, with the prior and without."""
    values = {name: (m, s) for name, m, s in zip(names, found.mean, found.arm_std, strict=True)}
    mean = np.array([values.get(name, (0.0,))[0] for name in arm.coefficients])
    terms = [
        replace(term, prior_std=float(values[term.name][1])) if term.name in values else term for term in arm.terms
    ]
    nowhere, whole = np.zeros(len(mean)), arm.all
    best = whole.most_probable(arm.terms, nowhere)
    ratios = {}
    for i, few in enumerate(FEW[: len(arm.parts) - 1], 1):
        known, rest = reduce(add, arm.parts[:i]), reduce(add, arm.parts[i:])
        least = rest.square(best)
        without, with_prior = (
            # An error below that of the constants themselves is chance.
            max(rest.square(x) - least, float(len(names)))
            for x in (known.most_probable(arm.terms, nowhere), known.most_probable(terms, mean))
        )
        ratios[few] = float(np.log(with_prior / without)) / 2
    return ratios


def _gain(n_readings: int, logs: FloatArray) -> HeldOutGain:
    ratio = float(np.exp(logs.mean()))
    u = ratio * float(logs.std(ddof=1)) / np.sqrt(len(logs))
    return HeldOutGain(n_readings=n_readings, n_arms=len(logs), error_ratio=ratio, error_ratio_u=float(u))


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
    >>> from truearm.wings.fleet.type_prior import learned_from, linearised_arm
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
    arms: Sequence[RegisteredArm], *, arm: str | None, executor: Executor, progress: Callable[[int, str], None] | None
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
