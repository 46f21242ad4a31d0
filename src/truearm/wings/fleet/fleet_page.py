"""The page of a fleet: the state of every arm, worst first, in one table that a reader filters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from truearm.number_format import format_count
from truearm.pages.page import Cell, Column, FormattedCell, LabelledValue, Page, PageVerdict, Section, State, Table

What = Literal[
    "failed", "not conforming", "recalibrate", "due", "to be fitted", "check again", "without readings", "in force"
]

# What must be done first, first; and its colour.
_STATES: dict[What, State] = {
    "failed": "bad",
    "not conforming": "bad",
    "recalibrate": "bad",
    "due": "doubtful",
    "to be fitted": "doubtful",
    "check again": "doubtful",
    "without readings": "none",
    "in force": "good",
}
_RANK = {what: rank for rank, what in enumerate(_STATES)}
_HEADS_OF_MODELS = ("since", "model", "readings", "held out [mm]", "moved [mm]", "constants changed", "session")
_HEADS_OF_CONSTANTS = (
    *("constant", "unit", "nominal", "identified", "standard uncertainty"),
    *("drift [u]", "from type [u]"),
)
_HEADS_OF_CERTIFICATES = ("number", "issued", "verdict", "next due", "SHA-256", "file")


_CAPTION_OF_MODELS = "The last one first, its file is {}. Moved: mean displacement of the tip."
_CAPTION_OF_CONSTANTS = (
    "Of the rigid arm nearest to the model in force. Drift: the largest difference from earlier models in force, in "
    "combined standard uncertainties; from type: the difference from the median of its type, with the type's scatter."
)


@dataclass(frozen=True)
class ArmState:
    """The state of one arm.

    Attributes
    ----------
    serial_number, arm, site : str
        The arm, its type, and where it is.
    what : str
        What is to be done first: the last fit ``failed``, a certificate states that the arm is ``not conforming``, its
        interim checks say ``recalibrate`` or ``check again``, readings or a certificate are ``due``, readings are
        ``to be fitted``, or it is ``without readings``; or its model is ``in force``.
    message : str
        Why; and which constants changed since the model before.
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
        The day on which readings or a certificate are due.
    drift_u : float or None
        The largest difference of a constant from earlier models in force, in combined standard uncertainties.
    from_type_u : float or None
        The same from the median of its type, with the scatter of the type.
    checked : str
        Day of the last interim check of the model in force.
    recalibrate : str
        Whether the checks ask for recalibration: ``yes``, ``no``, ``undecided``, ``not enough checks yet``.
    certificate, certified : str
        Number of the last certificate, and whether it states that the arm conforms.
    model_file : str
        The file of the model in force; empty if there is none.
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
    drift_u: float | None = None
    from_type_u: float | None = None
    checked: str = ""
    recalibrate: str = ""
    certificate: str = ""
    certified: str = ""
    model_file: str = ""
    page: str = ""

    @property
    def rank(self) -> tuple[int, float, float, str]:
        """Order in which arms need attention: by what is to be done, then by drift, then by the error of the model."""
        drift = max(self.drift_u or 0.0, self.from_type_u or 0.0)
        return _RANK[self.what], -drift, -(self.of_type or 0.0), self.serial_number


def worst_of(found: Iterable[What]) -> What:
    """What is to be done first."""
    return min(found, key=_RANK.__getitem__, default="without readings")


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
    worst = worst_of(one.what for one in arms)
    heads = (
        *("serial number", "type", "site", "state", "since", "due", "held out [mm]", "of type", "moved [mm]"),
        *("drift [u]", "from type [u]", "recalibrate", "certificate"),
    )
    rows = tuple(
        (
            FormattedCell(one.serial_number, page=one.page, remark=one.message),
            *(one.arm, one.site, one.what, one.since, one.due),
            *(fixed(one.held_out_mm, 4), fixed(one.of_type, 2), fixed(one.moved_mm, 4)),
            *(fixed(one.drift_u, 1), fixed(one.from_type_u, 1), one.recalibrate, one.certified),
        )
        for one in arms
    )
    table = Table(
        Column.of(*heads),
        rows,
        "Every arm, worst first; the reason is below its serial number. "
        "Held out: mean error of the model in force on readings held out of its fit; of type: "
        "as a multiple of the median of its type; moved: mean displacement of the tip from the model before; drift: "
        "the largest difference of a constant from earlier models in force, in combined standard uncertainties; from "
        "type: the same from the median of its type, with the scatter of the type. Of twenty constants that did not "
        "change, the largest drift is about 2, and above 4 in one arm of 800.",
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


def fixed(value: float | None, decimals: int) -> Cell:
    """A number of a long table: with fixed decimals it needs no element of its own to stand below the others."""
    if value is None:
        return None
    text = f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", "\u2212")  # no -0.0
    return FormattedCell(text, whole=text)


def arm_history_page(
    arm: ArmState,
    *,
    models: Sequence[tuple[Cell, ...]],
    checks: Sequence[tuple[Cell, ...]],
    constants: Sequence[tuple[Cell, ...]],
    certificates: Sequence[tuple[Cell, ...]],
    failed: Sequence[tuple[Cell, ...]],
    overview: str,
    facts: Sequence[tuple[str, str]] = (),
) -> Page:
    """Lay out the history of one arm.

    Parameters
    ----------
    arm : ArmState
    models : sequence of tuple
        Models that were in force, the last one first: since, kind, readings, held-out error [mm], displacement [mm],
        constants changed, session.
    checks : sequence of tuple
        Of the model in force: day of the last one, their number, whether to recalibrate.
    constants : sequence of tuple
        Of the model in force: name, unit, nominal and identified value, standard uncertainty, drift, difference from
        its type.
    certificates : sequence of tuple
        The last one first: number, day, verdict, day of the next one, SHA-256, file.
    failed : sequence of tuple
        Fits that failed: day, session, why.
    overview : str
        Address of the page of the fleet.
    facts : sequence of (str, str)
        Settings, as label and value.
    """
    sections = [
        Section(title, tables=(Table(Column.of(*heads), tuple(rows), caption),), folded=title == "Constants")
        for title, heads, rows, caption in (
            ("Models in force", _HEADS_OF_MODELS, models, _CAPTION_OF_MODELS.format(arm.model_file)),
            ("Interim checks", ("last", "checks", "recalibrate"), checks, "Of the model in force."),
            ("Certificates", _HEADS_OF_CERTIFICATES, certificates, "The last one first."),
            ("Constants", _HEADS_OF_CONSTANTS, constants, _CAPTION_OF_CONSTANTS),
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
        overview=FormattedCell("All arms of the fleet", page=overview),
    )
