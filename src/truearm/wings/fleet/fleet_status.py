"""The state of every arm of a fleet.

To it belongs how far the constants of an arm are from those that it had, and from those of other arms of its type, in
combined standard uncertainties. Where an arm stands and which tip it has are no constants of the arm: base and
tip do not count.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from statistics import NormalDist, median
from typing import TYPE_CHECKING, Any

from truearm.number_format import RoundedNumber
from truearm.pages.drawings.page_record import PageRecord, version_row
from truearm.verbs.record import TableRecord, TextTable, columns_of, format_fixed, number_of
from truearm.wings.fleet.arm_list import RegisteredArm
from truearm.wings.fleet.certificates import RegisteredCertificate
from truearm.wings.fleet.fit_task import FitRow
from truearm.wings.fleet.fleet_page import ArmState, What, arm_history_page, fixed, fleet_page, worst_of
from truearm.wings.laboratory.monitor.assessment import RecalibrationAdvice

# Columns of the base and the tip; joints have those of Denavit and Hartenberg.
_SET_UP = frozenset({"x", "y", "z", "rx", "ry", "rz"})
# Arms of a type from which the scatter of a constant is stated.
LEAST_OF_TYPE = 5
# A normal distribution's standard deviation in median absolute deviations.
_MAD = 1.4826
# Share of the arms whose constants did not change that get a remark.
_FALSE_REMARKS = 0.001
# Constants that a remark names.
_NAMED = 3


@dataclass(frozen=True)
class TypeConstant:
    """A constant over the arms of a type: median, and a standard deviation that single arms do not move."""

    median: float
    std: float


@dataclass(frozen=True)
class ConstantDrift:
    """A constant of an arm, beside its own history and its type.

    Attributes
    ----------
    name, unit : str
    nominal, value : float or None
    u : float or None
        Standard uncertainty of the value.
    own : float or None
        Difference from that earlier model in force from which it is largest, in combined standard uncertainties.
    of_type : float or None
        Difference from the median of its type, in units of ``sqrt(std^2 + u^2)``.
    """

    name: str
    unit: str
    nominal: float | None
    value: float | None
    u: float | None
    own: float | None
    of_type: float | None


def type_constants(models: Iterable[FitRow]) -> dict[str, dict[str, TypeConstant]]:
    """The constants of every type with enough arms, by type and name.

    Parameters
    ----------
    models : iterable of FitRow
        In force, one of each arm.
    """
    values: dict[tuple[str, str], list[float]] = {}
    for row in models:
        for name, (value, _) in _joints(row).items():
            values.setdefault((row.arm, name), []).append(value)
    found: dict[str, dict[str, TypeConstant]] = {}
    for (arm, name), of_arms in values.items():
        if len(of_arms) >= LEAST_OF_TYPE:
            middle = median(of_arms)
            std = _MAD * median(abs(value - middle) for value in of_arms)
            found.setdefault(arm, {})[name] = TypeConstant(middle, std)
    return found


def constant_drifts(models: Sequence[FitRow], of_type: Mapping[str, TypeConstant]) -> list[ConstantDrift]:
    """The constants of the last of an arm's models in force.

    Parameters
    ----------
    models : sequence of FitRow
        One or more, the last one last.
    of_type : mapping of str to TypeConstant
        Of its type, see `type_constants`.
    """
    joints, earlier = _joints(models[-1]), [_joints(row) for row in models[:-1]]
    found = []
    for one in models[-1].constants:
        own = type_wise = None
        if (name := one["name"]) in joints:
            value, u = joints[name]
            before = [(value - was, (u**2 + u_was**2) ** 0.5) for was, u_was in (e[name] for e in earlier if name in e)]
            own = max((shift / scale for shift, scale in before), key=abs, default=None)
            if (typical := of_type.get(name)) is not None:
                type_wise = (value - typical.median) / (typical.std**2 + u**2) ** 0.5
        found.append(ConstantDrift(name, one["unit"], one["nominal"], one["value"], one["u"], own, type_wise))
    return found


def drift_remark(models: Sequence[FitRow]) -> str:
    """Which constants changed since the last model of other readings by more than chance explains, worst first.

    The limit is that which one of a thousand unchanged arms exceeds, by the normal distribution and the number of its
    constants (Bonferroni): 4.0 u of 18 constants.

    Parameters
    ----------
    models : sequence of FitRow
        That were in force, one or more, the last one last.

    Returns
    -------
    str
        Empty if there are none.
    """
    before = [row for row in models[:-1] if row.session_sha256 != models[-1].session_sha256][-1:]
    drifts = {one.name: one.own for one in constant_drifts([*before, models[-1]], {}) if one.own is not None}
    limit = NormalDist().inv_cdf(1 - _FALSE_REMARKS / (2 * max(len(drifts), 1)))
    worst = sorted((-abs(own), name) for name, own in drifts.items() if abs(own) > limit)
    if not worst:
        return ""
    named = ", ".join(f"{name} by {-minus:.1f} u" for minus, name in worst[:_NAMED])
    more = f" and {len(worst) - _NAMED} more" if len(worst) > _NAMED else ""
    return f"changed since the model before: {named}{more} (limit {limit:.1f} u)"


def _joints(row: FitRow) -> dict[str, tuple[float, float]]:
    """Value and standard uncertainty of the constants of the joints that a model identified."""
    return {
        one["name"]: (one["value"], one["u"])
        for one in row.constants
        if one["name"].rpartition(" ")[2] not in _SET_UP and one["value"] is not None and one["u"]
    }


if TYPE_CHECKING:
    from truearm.pages.page import Page
    from truearm.wings.fleet.check_history import CheckVerdict

# Arms that are printed.
MAX_ROWS = 20


@dataclass(frozen=True, eq=False, repr=False)
class FleetStatus(TableRecord, PageRecord):
    """The state of every arm of a fleet.

    Attributes
    ----------
    place : str
        The database.
    arms : tuple of ArmState
        Worst first.

    Examples
    --------
    >>> from truearm.wings.fleet.fleet_status import FleetStatus
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
            rows = [_text_row(one) for one in self.arms[:MAX_ROWS]]
            shown = [head for head in _HEADS if head in _HEADS[:4] or any(row[head] for row in rows)]
            words = tuple(i for i, head in enumerate(shown) if head not in _NUMBERS)
            yield TextTable(shown, [[row[head] for head in shown] for row in rows], left_aligned=words)
            if (more := len(self.arms) - MAX_ROWS) > 0:
                yield f"{number_of(more, 'more arm')}: truearm fleet report, or --json"
        for one in self.arms[:MAX_ROWS]:
            if one.message:
                yield f"{one.serial_number}: {one.message}"
        if any(one.model_file for one in self.arms):
            yield "Files of the models in force: --json (model_file), or the page of the arm."

    def page(self) -> Page:
        """See `PageRecord.page`."""
        return fleet_page(self.arms, summary=self.summary(), facts=(("database", self.place), version_row()))

    def columns(self) -> dict[str, list[Any]]:
        """A row for each arm, worst first; ``of_type`` is a ratio, ``_u`` counts standard uncertainties."""
        return columns_of(self.arms)

    def _json(self) -> object:
        return {"summary": self.summary(), "database": self.place, "arms": self.arms}


_NUMBERS = ("held out, mm", "of type", "drift, u", "from type, u")
# Columns of the table; those after the fourth are shown where one of the arms has an entry.
_HEADS = ("serial number", "type", "site", "state", *_NUMBERS, "due", "recalibrate", "certificate")


def _text_row(one: ArmState) -> dict[str, str]:
    numbers = [
        "" if value is None else format_fixed(value, decimals)
        for value, decimals in ((one.held_out_mm, 4), (one.of_type, 2), (one.drift_u, 1), (one.from_type_u, 1))
    ]
    certificate = ", ".join(filter(None, (one.certificate, one.certified)))
    cells = one.serial_number, one.arm, one.site, one.what, *numbers, one.due, one.recalibrate, certificate
    return dict(zip(_HEADS, cells, strict=True))


@dataclass(frozen=True)
class ArmRecords:
    """What the registry has of one arm.

    Attributes
    ----------
    arm : RegisteredArm
    known : FitRow or None
        The fit of its last readings.
    models : tuple of FitRow
        That were in force, the last one last.
    days : tuple of str
        Since when each was.
    read : str or None
        UTC time of the first fit of the readings of the model in force.
    verdict : CheckVerdict or None
        Of the interim checks of the model in force.
    certificates : tuple of RegisteredCertificate
        The last one last.
    model_file : str
        Of the model in force.
    """

    arm: RegisteredArm
    known: FitRow | None = None
    models: tuple[FitRow, ...] = ()
    days: tuple[str, ...] = ()
    read: str | None = None
    verdict: CheckVerdict | None = None
    certificates: tuple[RegisteredCertificate, ...] = ()
    model_file: str = ""

    @property
    def used(self) -> FitRow | None:
        """The fit whose model is in force."""
        return self.models[-1] if self.models else None


class FleetFigures:
    """What the arms of a fleet have in common: the median error and the constants of each type.

    Parameters
    ----------
    in_force : iterable of FitRow
        One of each arm that has a model in force.
    """

    def __init__(self, in_force: Iterable[FitRow]) -> None:
        rows = list(in_force)
        errors: dict[str, list[float]] = {}
        for row in rows:
            if row.held_out_mm:
                errors.setdefault(row.arm, []).append(row.held_out_mm)
        self.median_mm = {name: median(of_arms) for name, of_arms in errors.items()}
        self._constants = type_constants(rows)

    def drifts(self, models: Sequence[FitRow]) -> list[ConstantDrift]:
        """The constants of an arm's model in force beside earlier ones and its type; none without a model."""
        return constant_drifts(models, self._constants.get(models[-1].arm, {})) if models else []


def arm_state(of: ArmRecords, figures: FleetFigures, now: datetime) -> ArmState:
    """The state of one arm."""
    used, verdict = of.used, of.verdict
    certificate = of.certificates[-1] if of.certificates else None
    due, late = _due(of, certificate, now)
    found = {**_faults(of, certificate), **late}
    error = None if used is None else used.held_out_mm
    drifts = figures.drifts(of.models)
    return ArmState(
        of.arm.serial_number,
        of.arm.arm if used is None else used.arm,
        of.arm.site,
        worst_of(found),
        message="; ".join(filter(None, (*found.values(), drift_remark(of.models) if of.models else ""))),
        model="" if used is None else used.model,
        since="" if used is None else used.fitted_at[:10],
        n_readings=None if used is None else used.n_readings,
        held_out_mm=error,
        of_type=None if used is None or not error else error / figures.median_mm[used.arm],
        moved_mm=None if used is None else used.moved_mm,
        n_changed=None if used is None else used.n_changed,
        due=due,
        drift_u=_largest(one.own for one in drifts),
        from_type_u=_largest(one.of_type for one in drifts),
        checked="" if verdict is None else verdict.date,
        recalibrate="" if verdict is None else verdict.recalibrate.value,
        certificate="" if certificate is None else certificate.number,
        certified="" if certificate is None else certificate.verdict,
        model_file=of.model_file,
    )


def _faults(of: ArmRecords, certificate: RegisteredCertificate | None) -> Mapping[What, str]:
    """What readings, checks and certificate say of an arm, each with why."""
    found: dict[What, str] = {"in force": ""}
    if not of.arm.session:
        found = {"without readings": ""}
    elif of.known is not None and not of.known.is_usable:
        found["failed"] = of.known.outcome
    elif of.known is None or of.known is not of.used:
        found["to be fitted"] = ""
    elif of.verdict is not None and of.verdict.recalibrate is RecalibrationAdvice.YES:
        found["recalibrate"] = of.verdict.message
    elif of.verdict is not None and of.verdict.recalibrate is RecalibrationAdvice.UNDECIDED:
        found["check again"] = of.verdict.message
    if certificate is not None and not certificate.conforms:
        found["not conforming"] = f"certificate {certificate.number}: {certificate.verdict}"
    return found


def _due(of: ArmRecords, certificate: RegisteredCertificate | None, now: datetime) -> tuple[str, dict[What, str]]:
    """The day on which readings or a certificate are due, the earlier one; and which of them are by now."""
    days: list[tuple[str, str]] = []
    if of.read is not None and of.arm.every_days is not None:
        days.append((f"{(datetime.fromisoformat(of.read) + timedelta(days=of.arm.every_days)).date()}", "readings"))
    if certificate is not None and certificate.due:
        days.append((certificate.due, "calibration"))
    today = f"{now.date()}"
    fitted = of.known is of.used  # other readings are there, but not fitted yet
    late = [f"{what} due since {day}" for day, what in sorted(days) if day <= today and (fitted or what != "readings")]
    return min(days, default=("", ""))[0], {"due": "; ".join(late)} if late else {}


def _rounded(value: float | None, u: float | None) -> RoundedNumber | None:
    return None if value is None else RoundedNumber(value, u or 0.0)


def _largest(values: Iterable[float | None]) -> float | None:
    return max((abs(value) for value in values if value is not None), default=None)


def history_page(
    of: ArmRecords,
    state: ArmState,
    drifts: Sequence[ConstantDrift],
    failed: Iterable[FitRow],
    overview: str,
    facts: Sequence[tuple[str, str]],
) -> Page:
    """The page of one arm; `overview` is the address of that of the fleet."""
    checks = [] if of.verdict is None else [(of.verdict.date, of.verdict.n_checks, of.verdict.recalibrate.value)]
    return arm_history_page(
        state,
        models=[
            (since, one.model, one.n_readings, one.held_out_mm, one.moved_mm, one.n_changed, one.session)
            for since, one in reversed(list(zip(of.days, of.models, strict=True)))
        ],
        checks=checks,
        certificates=[
            (one.number, one.issued, one.verdict, one.due, one.sha256, one.file) for one in reversed(of.certificates)
        ],
        constants=[
            (
                *(one.name, one.unit, _rounded(one.nominal, one.u), _rounded(one.value, one.u), one.u),
                *(fixed(one.own, 1), fixed(one.of_type, 1)),
            )
            for one in drifts
        ],
        failed=[(one.fitted_at[:10], one.session, one.outcome) for one in failed],
        overview=overview,
        facts=facts,
    )
