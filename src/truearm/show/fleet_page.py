"""The page of a fleet: the state of every arm, worst first, in one table that a reader filters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from truearm.number_format import format_count
from truearm.pages.page import Cell, Column, FormattedCell, LabelledValue, Page, PageVerdict, Section, State, Table

What = Literal["failed", "due", "to be fitted", "without readings", "in force"]

# The order of the page, and the colours: what must be done first.
_RANK: dict[What, int] = {"failed": 0, "due": 1, "to be fitted": 2, "without readings": 3, "in force": 4}
_STATES: dict[What, State] = {
    "failed": "bad",
    "due": "doubtful",
    "to be fitted": "doubtful",
    "without readings": "none",
    "in force": "good",
}
_HEADS_OF_MODELS = ("since", "model", "readings", "held out [mm]", "moved [mm]", "constants changed", "session")
_HEADS_OF_CONSTANTS = ("constant", "unit", "nominal", "identified", "standard uncertainty")


@dataclass(frozen=True)
class ArmState:
    """The state of one arm.

    Attributes
    ----------
    serial_number, arm, site : str
        The arm, its type, and where it is.
    what : str
        What is to be done: ``failed``, ``due``, ``to be fitted``, ``without readings``; or its model is ``in force``.
    message : str
        Why the last fit failed.
    model, since : str
        Kind and date of the model in force; empty if there is none.
    n_readings : int or None
    held_out_mm : float or None
        Mean error of that model on held-out readings.
    of_type : float or None
        The same as a multiple of the median of its type.
    moved_mm : float or None
        Mean displacement of the tip from the model before.
    n_changed : int or None
        Constants that changed from the model before.
    due : str
        The day on which readings are due.
    page : str
        The arm's own page, beside that of the fleet.
    """

    serial_number: str
    arm: str
    site: str
    what: What
    message: str = ""
    model: str = ""
    since: str = ""
    n_readings: int | None = None
    held_out_mm: float | None = None
    of_type: float | None = None
    moved_mm: float | None = None
    n_changed: int | None = None
    due: str = ""
    page: str = ""

    @property
    def rank(self) -> tuple[int, float, str]:
        """Order in which arms need attention: by what is to be done, then by the error beside others of the type."""
        return _RANK[self.what], -(self.of_type or 0.0), self.serial_number


def fleet_page(arms: Sequence[ArmState], *, summary: str, facts: Sequence[tuple[str, str]] = ()) -> Page:
    """Lay out the state of a fleet.

    Parameters
    ----------
    arms : sequence of ArmState
        In the order of the page.
    summary : str
        The verdict's sentence.
    facts : sequence of (str, str)
        Settings, as label and value.
    """
    counts = Counter(one.what for one in arms)
    worst: What = min((one.what for one in arms), key=_RANK.__getitem__, default="without readings")
    heads = "serial number", "type", "site", "state", "since", "due", "held out [mm]", "of type", "moved [mm]", "remark"
    rows = tuple(
        (
            *(FormattedCell(one.serial_number, page=one.page), one.arm, one.site, one.what, one.since, one.due),
            *(_fixed(one.held_out_mm, 4), _fixed(one.of_type, 2), _fixed(one.moved_mm, 4), one.message),
        )
        for one in arms
    )
    table = Table(
        Column.of(*heads),
        rows,
        "Every arm, worst first. Held out: mean error of the model in force on readings held out of its fit; of type: "
        "as a multiple of the median of its type; moved: mean displacement of the tip from the model before.",
        states=tuple(_STATES[one.what] for one in arms),
        filtered=True,
    )
    return Page(
        "Fleet",
        format_count(len(arms), "arm"),
        summary=tuple(LabelledValue(what, counts[what]) for what in _RANK if counts[what]),
        sections=(Section("Arms", tables=(table,)),),
        facts=tuple(facts),
        verdict=PageVerdict(summary, _STATES[worst]),
    )


def _fixed(value: float | None, decimals: int) -> Cell:
    """A number of a long table: with fixed decimals it needs no element of its own to stand below the others."""
    return None if value is None else FormattedCell(text := f"{value:.{decimals}f}", whole=text)


def arm_history_page(
    arm: ArmState,
    *,
    models: Sequence[tuple[Cell, ...]],
    constants: Sequence[tuple[Cell, ...]],
    failed: Sequence[tuple[Cell, ...]],
    facts: Sequence[tuple[str, str]] = (),
) -> Page:
    """Lay out the history of one arm.

    Parameters
    ----------
    arm : ArmState
    models : sequence of tuple
        Models that were in force, the last one first: since, kind, readings, held-out error [mm], displacement [mm],
        constants changed, session.
    constants : sequence of tuple
        Of the model in force: name, unit, nominal and identified value, standard uncertainty.
    failed : sequence of tuple
        Fits that failed: day, session, why.
    facts : sequence of (str, str)
        Settings, as label and value.
    """
    sections = [
        Section(title, tables=(Table(Column.of(*heads), tuple(rows), caption),), folded=title == "Constants")
        for title, heads, rows, caption in (
            ("Models in force", _HEADS_OF_MODELS, models, "The last one first. Moved: mean displacement of the tip."),
            ("Constants", _HEADS_OF_CONSTANTS, constants, "Of the rigid arm nearest to the model in force."),
            ("Failed fits", ("day", "session", "why"), failed, "They changed nothing."),
        )
        if rows
    ]
    return Page(
        arm.serial_number,
        ", ".join(filter(None, (arm.arm, arm.site))),
        sections=tuple(sections),
        facts=tuple(facts),
        verdict=PageVerdict(f"{arm.serial_number}: {arm.what}.", _STATES[arm.what], arm.message),
    )
