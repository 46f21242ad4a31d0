"""The state of every arm of a fleet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

from truearm.fleet.arm_list import RegisteredArm
from truearm.fleet.fit_task import FitRow
from truearm.show.fleet_page import ArmState, What, fleet_page
from truearm.workflows.outputs import PageRecord, version_row
from truearm.workflows.record import TextTable, format_fixed
from truearm.workflows.sentences import number_of

if TYPE_CHECKING:
    from truearm.pages.page import Page

# Arms that are printed.
MAX_ROWS = 20


@dataclass(frozen=True, eq=False, repr=False)
class FleetStatus(PageRecord):
    """The state of every arm of a fleet.

    Attributes
    ----------
    place : str
        The database.
    arms : tuple of ArmState
        Worst first.

    Examples
    --------
    >>> from truearm.fleet.fleet_status import FleetStatus
    >>> FleetStatus("sqlite:///registry.sqlite", ()).summary()
    'The fleet has no arms.'
    """

    place: str
    arms: tuple[ArmState, ...]

    def summary(self) -> str:
        """How many arms there are, by what is to be done."""
        if not self.arms:
            return "The fleet has no arms."
        counts = Counter(one.what for one in self.arms)
        return f"{number_of(len(self.arms), 'arm')}: " + ", ".join(f"{n} {what}" for what, n in counts.items()) + "."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        if self.arms:
            columns = ("serial number", "type", "site", "state", "held out, mm", "of type", "moved, mm", "due")
            yield TextTable(columns, (_text_row(one) for one in self.arms[:MAX_ROWS]), left_aligned=(0, 1, 2, 3, 7))
            if (more := len(self.arms) - MAX_ROWS) > 0:
                yield f"{number_of(more, 'more arm')}: truearm fleet report, or --json"
        for one in self.arms[:MAX_ROWS]:
            if one.message:
                yield f"{one.serial_number}: {one.message}"

    def page(self) -> Page:
        """See `PageRecord.page`."""
        return fleet_page(self.arms, summary=self.summary(), facts=(("database", self.place), version_row()))

    def _json(self) -> object:
        return {"summary": self.summary(), "database": self.place, "arms": self.arms}


def _text_row(one: ArmState) -> tuple[str, ...]:
    numbers = [
        "" if value is None else format_fixed(value, decimals)
        for value, decimals in ((one.held_out_mm, 4), (one.of_type, 2), (one.moved_mm, 4))
    ]
    return one.serial_number, one.arm, one.site, one.what, *numbers, one.due


def arm_state(
    arm: RegisteredArm,
    known: FitRow | None,
    used: FitRow | None,
    read: str | None,
    medians: dict[str, float],
    now: datetime,
) -> ArmState:
    """The state of one arm from the fit of its readings, the fit whose model is in force, and when that was read."""
    due, overdue = "", False
    if read is not None and arm.every_days is not None:
        at = datetime.fromisoformat(read) + timedelta(days=arm.every_days)
        due, overdue = f"{at.date()}", at <= now
    what: What = "in force"
    message = ""
    if not arm.session:
        what = "without readings"
    elif known is not None and not known.is_usable:
        what, message = "failed", known.outcome
    elif known is None or known is not used:
        what = "to be fitted"
    elif overdue:
        what = "due"
    error = None if used is None else used.held_out_mm
    return ArmState(
        arm.serial_number,
        arm.arm if used is None else used.arm,
        arm.site,
        what,
        message=message,
        model="" if used is None else used.model,
        since="" if used is None else used.fitted_at[:10],
        n_readings=None if used is None else used.n_readings,
        held_out_mm=error,
        of_type=None if used is None or not error else error / medians[used.arm],
        moved_mm=None if used is None else used.moved_mm,
        n_changed=None if used is None else used.n_changed,
        due=due,
    )
