"""An interim check, assessed beside the earlier ones and added to the history."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from truearm.wings.laboratory.monitor.assessment import Assessment, assess, is_measured
from truearm.wings.laboratory.monitor.control_chart import MIN_BASELINE_CHECKS
from truearm.wings.laboratory.monitor.history import History, OtherModel
from truearm.wings.laboratory.monitor.interim_check import InterimCheck, counted
from truearm.wings.laboratory.standards.specification import Specification


@dataclass(frozen=True, eq=False)
class RecordedCheck:
    """An interim check with its history.

    Attributes
    ----------
    check : InterimCheck
    checks : tuple of InterimCheck
        All checks of its model in the order of their dates, itself and withdrawn ones included.
    assessment : Assessment
        Of `checks`.
    added : bool
        Whether it is a new check in the history.
    completed : bool
        Whether it has completed the last check of the same session.
    other_models : tuple of (OtherModel, Assessment)
        The other models with checks in the history, the last used one first.
    """

    check: InterimCheck
    checks: tuple[InterimCheck, ...]
    assessment: Assessment
    added: bool
    completed: bool
    other_models: tuple[tuple[OtherModel, Assessment], ...]

    @property
    def number(self) -> int:
        """The number of the check of this session, counted from 1."""
        return max(i for i, one in enumerate(self.checks, start=1) if one.has_session_of(self.check))

    @property
    def last(self) -> InterimCheck:
        """The last check that counts."""
        return counted(self.checks)[-1]

    @property
    def remarks(self) -> tuple[str, ...]:
        """The results of other models, while this one is new or was last used before them."""
        own, others = counted(self.checks), self.other_models
        n = len(own)
        if not others or (n > MIN_BASELINE_CHECKS and own[-2].date > others[0][0].last.date):
            return ()
        prefix = "a new model: " if n == 1 else ""
        return tuple(f"{prefix}{model.describe(assessment)}" for model, assessment in others)


def record_check(
    history: History,
    check: InterimCheck,
    *,
    specification: Specification | None = None,
    retired: Collection[str] = (),
    name: str = "",
    arm: str = "",
    serial_number: str = "",
) -> RecordedCheck:
    """Assess a check beside the earlier ones of its model, and add it to the history.

    Parameters
    ----------
    history : History
    check : InterimCheck
    specification : Specification, optional
        Limits for the values.
    retired : collection of str, optional
        Artefacts that were repaired or replaced, and are no longer assessed; for a length, one of its seats.
    name, arm : str
        Names of the model's file and of its arm, as `History.append` takes them.
    serial_number : str
        Of the arm.

    Raises
    ------
    InputError
        As `History.append` and `assess`; nothing is added then.
    """
    others = history.other_models(check.model, arm=arm, serial_number=serial_number)
    before, checks = history.checks(check.model), history.with_check(check)
    elsewhere = [one for model in others for one in counted(model.checks)]
    # Artefacts that only checks of other models have were retired before this model.
    own = [
        artefact
        for artefact in retired
        if is_measured(artefact, counted(checks)) or not is_measured(artefact, elsewhere)
    ]
    assessment = assess(checks, specification, retired=own)
    other_models = tuple((model, model.assess(specification, retired=retired)) for model in others)
    changed = history.append(check, name=name, arm=arm, serial_number=serial_number)
    completed = changed and len(checks) == len(before)
    return RecordedCheck(check, checks, assessment, changed and not completed, completed, other_models)
