"""The interim check: a few readings in a seat, on a bar, on a sphere, in five minutes; and what a history of them says.

Its values are those of the standards' tests from fewer points, so that they are no verification: what counts is
whether they change. Between calibrations a laboratory makes such checks by ISO/IEC 17025, 6.4.10 [recalled].
"""

from __future__ import annotations

import datetime
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.readings.lengths import Lengths
from truearm.readings.thermal_expansion import thermal_expansion_at
from truearm.typing import FloatArray, NameArray
from truearm.verification.monitor.control_chart import (
    MIN_BASELINE_CHECKS,
    ControlChart,
    ControlRules,
    control_chart,
    control_rules,
)
from truearm.verification.shapes.sphere import fit_sphere
from truearm.verification.standards.decision import Verdict, decide
from truearm.verification.standards.specification import Specification

# A seat's points further from their mean than this are of two seats [mm]; no arm errs so much.
FARTHEST_IN_SEAT_MM = 10.0
# A length or a form that is off by this share of the size is of another artefact.
SAME_SHARE = 0.05
# Five tell form and diameter of a sphere.
LEAST_ON_SPHERE = 5


@dataclass(frozen=True)
class CheckQuantity:
    """What is measured on an artefact in an interim check.

    Attributes
    ----------
    name : str
    artefact : str
        What kind of thing it is measured on.
    charted : bool
        Whether it is watched by a chart; what goes with another quantity is not.
    scale : bool
        Whether it is a scatter: never negative, and only an increase is a change for the worse.
    symbols : tuple of str
        Of the limits in a specification that it must keep.
    """

    name: str
    artefact: str
    charted: bool
    scale: bool
    symbols: tuple[str, ...] = ()

    @property
    def n_sides(self) -> int:
        """In how many directions it may change for the worse."""
        return 1 if self.scale else 2


CHECK_QUANTITIES: Mapping[str, CheckQuantity] = {
    one.name: one
    for one in (
        CheckQuantity("SPAT.2s", "seat", charted=True, scale=True, symbols=("SPAT.2s",)),
        CheckQuantity("SPAT.Max", "seat", charted=False, scale=True, symbols=("SPAT.Max",)),
        CheckQuantity("length error", "length", charted=True, scale=False, symbols=("E_Uni", "Volumetric.Max")),
        CheckQuantity("form", "sphere", charted=True, scale=True, symbols=("P_Form.Sph.1x25",)),
        CheckQuantity("diameter", "sphere", charted=True, scale=False),
    )
}


@dataclass(frozen=True)
class CheckValue:
    """A test value of an interim check.

    Attributes
    ----------
    quantity : str
        One of `CHECK_QUANTITIES`.
    artefact : str
        Name of the seat or sphere, or of both seats of a length.
    value_mm : float
    u_mm : float
        Standard deviation that it is expected to have from check to check: of the scatter of points [mm].
    u_artefact_mm : float
        Standard uncertainty of the artefact: of its calibration and its place [mm].
    n : int
        Readings from which it comes.
    length_mm : float or None
        The known length of a length error that is one at 20 degC. None of others, and of a length error that is not:
        no limit holds for it.
    """

    quantity: str
    artefact: str
    value_mm: float
    u_mm: float
    u_artefact_mm: float
    n: int
    length_mm: float | None = None

    @property
    def key(self) -> tuple[str, str, bool]:
        """What tells its series from the others: a length that is not corrected has one of its own."""
        return self.quantity, self.artefact, self.length_mm is not None

    @property
    def label(self) -> str:
        """Artefact and quantity in words."""
        kind = CHECK_QUANTITIES[self.quantity].artefact
        as_measured = " as measured" if kind == "length" and self.length_mm is None else ""
        return f"{kind} {self.artefact}, {self.quantity}{as_measured}"

    def has(self, artefact: str) -> bool:
        """Whether it was measured on an artefact; a length, whether one of its seats is that."""
        return self.artefact == artefact or (
            CHECK_QUANTITIES[self.quantity].artefact == "length"
            and (self.artefact.startswith(f"{artefact} to ") or self.artefact.endswith(f" to {artefact}"))
        )


@dataclass(frozen=True)
class InterimCheck:
    """An interim check as a history holds it.

    Attributes
    ----------
    date : datetime.datetime
        Local time, without a zone.
    model, session : str
        Fingerprints of the model and of the readings.
    temperature_degC : float or None
        Mean of the readings'.
    values : tuple of CheckValue
    """

    date: datetime.datetime
    model: str
    session: str
    temperature_degC: float | None
    values: tuple[CheckValue, ...]


def format_date(date: datetime.datetime) -> str:
    """A date in words of a table: the day, with the time where there is one."""
    return date.date().isoformat() if date.time() == datetime.time() else date.isoformat(sep=" ", timespec="minutes")


def interim_values(
    points: npt.ArrayLike,
    *,
    std_mm: npt.ArrayLike,
    seat: NameArray | None = None,
    sphere: NameArray | None = None,
    lengths: Lengths | None = None,
    temperature_degC: float | None = None,
) -> tuple[CheckValue, ...]:
    """Find the test values of a check.

    Parameters
    ----------
    points : (n, 3) array
        The tip's centre at each reading [mm].
    std_mm : (n,) array
        Standard deviation of a coordinate of each, from reading to reading [mm].
    seat, sphere : (n,) array of str, optional
        In which seat or on which sphere each was taken; empty where in or on none.
    lengths : Lengths, optional
        Known ones between the seats.
    temperature_degC : float, optional
        Of arm and artefacts. A length whose thermal expansion is known is corrected from it to 20 degC, with
        the uncertainty of `truearm.readings.thermal_expansion.ARTEFACT_U_K`; others are as they are.

    Returns
    -------
    tuple of CheckValue
        Of each seat with two points or more `SPAT.Max` and `SPAT.2s` (see
        `truearm.verification.standards.asme_b89_4_22.single_point`); of each length the distance of the seats' means less the known
        one; of each sphere form and diameter of the least-squares sphere, as the tip's centre saw it, thus the ball's
        diameter more than the sphere's own.

    Raises
    ------
    InputError
        If there is nothing to find, shapes do not fit, a sphere has too few points, or points cannot be of one
        artefact.
    """
    points, std = np.asarray(points, dtype=float), np.asarray(std_mm, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or std.shape != points.shape[:1]:
        raise InputError(f"expected points (n, 3) and a deviation of each, got shapes {points.shape} and {std.shape}")
    if not (np.isfinite(points).all() and np.isfinite(std).all() and (std >= 0).all()):
        raise InputError("expected finite points and standard deviations of 0 or more")
    seats, spheres = _groups(seat, len(points)), _groups(sphere, len(points))
    values = [value for name, rows in seats.items() for value in _of_seat(name, points[rows], std[rows])]
    if lengths is not None:
        values += _of_lengths(lengths.between(seats), seats, points, std, temperature_degC)
    values += [value for name, rows in spheres.items() for value in _of_sphere(name, points[rows], std[rows])]
    if not values:
        raise InputError(
            "expected readings in a seat, two or more of them, or on a sphere, got none",
            hint="columns seat and sphere of the session name what the tip was in or on",
        )
    return tuple(values)


def _groups(names: NameArray | None, n: int) -> dict[str, npt.NDArray[np.intp]]:
    """Rows of each name, in the order in which they come first."""
    if names is None:
        return {}
    if names.shape != (n,):
        raise InputError(f"expected a name for each of {n} points, got shape {names.shape}")
    return {name: np.flatnonzero(names == name) for name in dict.fromkeys(names.tolist()) if name}


def _of_seat(name: str, points: FloatArray, std: FloatArray) -> list[CheckValue]:
    """Scatter in one seat.

    With a standard deviation sigma of each coordinate, ``(n - 1) s^2 / sigma^2`` has 3 (n - 1) degrees of freedom, so
    that ``s`` has the standard deviation ``sigma / sqrt(2 (n - 1))``, to first order. The largest deviation has about
    sigma, a little less.
    """
    n = len(points)
    if n < 2:
        return []
    away = points - points.mean(axis=0)
    largest = float(np.sqrt((away**2).sum(axis=1)).max())
    if largest > FARTHEST_IN_SEAT_MM:
        raise InputError(
            f"seat {name!r}: a point is {largest:.4g} mm from the mean of its points, they cannot be of one seat",
            hint="the names of the seats in the session, and whether the model is of this arm",
        )
    s = float(np.sqrt((away**2).sum() / (n - 1)))
    sigma = float(np.sqrt((std**2).mean()))
    return [
        CheckValue("SPAT.2s", name, 2 * s, 2 * sigma / np.sqrt(2 * (n - 1)), 0.0, n),
        CheckValue("SPAT.Max", name, largest, sigma, 0.0, n),
    ]


def _of_lengths(
    lengths: Lengths,
    seats: Mapping[str, npt.NDArray[np.intp]],
    points: FloatArray,
    std: FloatArray,
    degC: float | None,
) -> list[CheckValue]:
    """Errors of lengths: ``|mean_a - mean_b| / (1 + alpha (T - 20)) - L``.

    From check to check the means scatter along the length, the artefact sits anew and has another temperature.
    """
    values = []
    names = ("seat_a", "seat_b", "length_mm", "u_mm", "u_place_mm")
    growth = thermal_expansion_at(lengths, np.nan if degC is None else degC)
    u_growth = (np.where(growth.known, lengths.length_mm * u, 0.0) for u in (growth.u_temperature, growth.u_expansion))
    columns = (*(getattr(lengths, name) for name in names), growth.known, growth.factor, *u_growth)
    for a, b, known, u, u_place, at_reference, factor, u_warm, u_expansion in zip(
        *(column.tolist() for column in columns), strict=True
    ):
        rows = seats[a], seats[b]
        found = float(np.linalg.norm(points[rows[0]].mean(axis=0) - points[rows[1]].mean(axis=0)))
        if abs(found - known) > SAME_SHARE * known:
            raise InputError(
                f"seats {a!r} and {b!r} are {found:.5g} mm apart where {known:.5g} mm is known: it is another length",
                hint="the names of the seats in the session and in the file of lengths",
            )
        # As of a bar's certificate: the artefact's temperature, new each time, and its expansion (GUM H.1.3).
        scatter = float(np.sqrt(sum((std[each] ** 2).mean() / len(each) for each in rows) + u_place**2 + u_warm**2))
        u_artefact = float(np.linalg.norm([u, u_place, u_warm, u_expansion]))
        n = sum(len(each) for each in rows)
        values.append(
            CheckValue(
                "length error",
                f"{a} to {b}",
                found / factor - known,
                scatter,
                u_artefact,
                n,
                known if at_reference else None,
            )
        )
    return values


def _of_sphere(name: str, points: FloatArray, std: FloatArray) -> list[CheckValue]:
    """Form and diameter of a sphere.

    The form of n points scatters at most as the range of n normal values does, 0.864 standard deviations for five and
    less for more (d3 of the tables of control charts); the diameter by the covariance of the fit.
    """
    n = len(points)
    if n < LEAST_ON_SPHERE:
        raise InputError(
            f"sphere {name!r}: expected {LEAST_ON_SPHERE} readings or more, got {n}", hint="touch it all over"
        )
    sigma = max(float(np.sqrt((std**2).mean())), 1e-9)
    try:
        fit = fit_sphere(points, std_mm=sigma)
    except InputError as error:
        raise InputError(f"sphere {name!r}: {error.problem}", hint=error.hint) from None
    diameter = 2 * fit.radius_mm
    if fit.form_mm > SAME_SHARE * diameter:
        raise InputError(
            f"sphere {name!r}: its points lie {fit.form_mm:.4g} mm off a sphere of {diameter:.4g} mm: they are not of "
            "one sphere",
            hint="the names of the spheres in the session, and whether the model is of this arm",
        )
    return [
        CheckValue("form", name, fit.form_mm, 0.864 * sigma, 0.0, n),
        CheckValue("diameter", name, diameter, 2 * float(np.sqrt(fit.covariance[3, 3])), 0.0, n),
    ]


class RecalibrationAdvice(StrEnum):
    """The answer of a history."""

    YES = "yes"
    NO = "no"
    AGAIN = "check once more"
    NOT_ENOUGH = "not enough checks yet"


@dataclass(frozen=True, eq=False)
class Trend:
    """A series of a history with its chart.

    Attributes
    ----------
    latest : CheckValue
        The last one, of the last check that has it.
    current : bool
        Whether that is the last check of all.
    checks : (n,) int array
        The checks that have the value, counted from 0.
    chart : ControlChart or None
        None where the quantity is not charted.
    limit_mm : float or None
        What the specification permits; None where it says nothing.
    over_limit : bool
        Whether the last value is over that limit beyond its uncertainty.
    over_before : bool
        Whether the value before it was too, an error with the same sign.
    """

    latest: CheckValue
    current: bool
    checks: npt.NDArray[np.intp]
    chart: ControlChart | None
    limit_mm: float | None
    over_limit: bool
    over_before: bool

    @property
    def since(self) -> int | None:
        """The first check of the change that stands; None where nothing has changed."""
        changed = None if self.chart is None else self.chart.since
        return None if changed is None else int(self.checks[changed])

    @property
    def single_value_out_of_limits(self) -> bool:
        """Whether the last value alone is beyond the limits of its chart: it may be dirt in a seat."""
        return self.chart is not None and self.chart.change_index is None and self.since == int(self.checks[-1])

    @property
    def asks(self) -> bool:
        """Whether the last value asks for a check, to recalibrate or for another one."""
        return self.since is not None or self.over_limit

    @property
    def certain(self) -> bool:
        """Whether more than the last value says to recalibrate."""
        return (self.since is not None and not self.single_value_out_of_limits) or (
            self.over_limit and self.over_before
        )

    @property
    def enough(self) -> bool:
        """Whether it can say that nothing has changed, or could when it was measured last."""
        return self.chart is not None and self.chart.enough


@dataclass(frozen=True, eq=False)
class Assessment:
    """What a history says of the arm at its last check.

    Attributes
    ----------
    recalibrate : RecalibrationAdvice
    since : int or None
        The check with which the change began, counted from 0; None where there is none, or none that is certain.
    reasons : tuple of str
        Why to recalibrate, or to check once more.
    remarks : tuple of str
        What could not be said.
    n_before : int
        Of checks that the chart with the fewest of them, of those of the last check, has before it.
    trends : tuple of Trend
        Those of the values of the last check in their order, then those that earlier checks have.
    """

    recalibrate: RecalibrationAdvice
    since: int | None
    reasons: tuple[str, ...]
    remarks: tuple[str, ...]
    n_before: int
    trends: tuple[Trend, ...]


def assess(
    checks: Sequence[InterimCheck], specification: Specification | None = None, *, retired: Collection[str] = ()
) -> Assessment:
    """Say whether the arm has changed since the first checks.

    The answer is yes if a chart tells of a change (`truearm.verification.monitor.control_chart`), by its cumulative sum or by two
    values or more in a row beyond its limits on the same side, or if the last two values, of one sign, are over their
    limit in the specification by more than the uncertainty of the artefact (ISO 14253-1); of what the last check left
    out, those measured last. It is to check once more if that is so of the last value alone, which may be dirt in a
    seat. Else no, if every chart of the last check has enough checks before.

    Parameters
    ----------
    checks : sequence of InterimCheck
        All of one model, in the order in which they were made.
    specification : Specification, optional
    retired : collection of str, optional
        Artefacts that are mended or replaced, and are not asked any more; of a length, one of its seats.

    Raises
    ------
    InputError
        If there is no check, or an artefact that is retired is in the last one, or in none.

    Notes
    -----
    The false alarms are shared among the charts that the history had at each check, whichever of them it has later or
    the last check has: what was said of a check does not change with those after it.
    """
    if not checks:
        raise InputError("expected one check or more, got none")
    series: dict[tuple[str, str, bool], list[int]] = {}
    rules = []
    for i, check in enumerate(checks):
        for value in check.values:
            series.setdefault(value.key, []).append(i)
        charted = [CHECK_QUANTITIES[name] for name, *_ in series if CHECK_QUANTITIES[name].charted]
        rules.append(control_rules(max(1, sum(quantity.n_sides for quantity in charted))))
    _check_retired(retired, checks)
    by_key = [{value.key: value for value in check.values} for check in checks]
    trends = tuple(
        _trend([by_key[i][key] for i in series[key]], series[key], rules, specification)
        for key in dict.fromkeys((*by_key[-1], *series))
        if not any(by_key[series[key][-1]][key].has(name) for name in retired)
    )
    current = [trend for trend in trends if trend.current and trend.chart is not None]
    began = [trend.since for trend in trends if trend.since is not None and not trend.single_value_out_of_limits]
    if any(trend.certain for trend in trends):
        answer = RecalibrationAdvice.YES
    elif any(trend.asks for trend in trends):
        answer = RecalibrationAdvice.AGAIN
    elif current and all(trend.enough for trend in current):
        answer = RecalibrationAdvice.NO
    else:
        answer = RecalibrationAdvice.NOT_ENOUGH
    reasons = [_reason(trend, trend.since) for trend in trends if trend.since is not None]
    reasons += [_over(trend) for trend in trends if trend.over_limit]
    n_before = min((int(trend.chart.n_before[-1]) for trend in current if trend.chart is not None), default=0)
    remarks = (*_remarks(trends), *_not_compared(trends, specification))
    return Assessment(answer, min(began) if began else None, tuple(reasons), remarks, n_before, trends)


def describe_assessment(found: Assessment, checks: Sequence[InterimCheck]) -> str:
    """The answer of a history of these checks in a line."""
    if found.recalibrate is RecalibrationAdvice.YES:
        since = (
            "" if found.since is None else f", since check {found.since + 1} of {format_date(checks[found.since].date)}"
        )
        return f"recalibrate: yes{since}"
    if found.recalibrate is RecalibrationAdvice.AGAIN:
        return "recalibrate: not by one check alone; clean the artefacts, see that they are tight, and check once more"
    if found.recalibrate is RecalibrationAdvice.NO:
        return "recalibrate: no"
    return f"recalibrate: not enough checks yet, {found.n_before} before this one, {MIN_BASELINE_CHECKS} are needed"


def has_measured(artefact: str, checks: Sequence[InterimCheck]) -> bool:
    """Whether a check has a value of an artefact; of a length, of one of its seats."""
    return any(value.has(artefact) for check in checks for value in check.values)


def _check_retired(retired: Collection[str], checks: Sequence[InterimCheck]) -> None:
    for name in retired:
        if has_measured(name, checks[-1:]):
            raise InputError(
                f"{name!r} is retired, and is in the last check",
                hint="an artefact that is mended or replaced gets another name in the session",
            )
        if not has_measured(name, checks):
            known = dict.fromkeys(value.artefact for check in checks for value in check.values)
            raise InputError(f"no check has the retired {name!r:.80}", hint=", ".join(known)[:200])


def _trend(
    values: Sequence[CheckValue], at: Sequence[int], rules: Sequence[ControlRules], specification: Specification | None
) -> Trend:
    """The series `values` of the checks `at`, among checks that have the `rules`."""
    latest = values[-1]
    quantity = CHECK_QUANTITIES[latest.quantity]
    chart = None
    if quantity.charted:
        chart = control_chart(
            [one.value_mm for one in values],
            u=[one.u_mm for one in values],
            rules=[rules[i] for i in at],
            scale=quantity.scale,
            upper_only=quantity.scale,
        )
    limit, over = _against(latest, specification)
    over_before = (
        len(values) > 1 and _against(values[-2], specification)[1] and values[-2].value_mm * latest.value_mm > 0
    )
    return Trend(latest, at[-1] == len(rules) - 1, np.array(at), chart, limit, over, over_before)


def _against(value: CheckValue, specification: Specification | None) -> tuple[float | None, bool]:
    """What the specification permits [mm], and whether a value is over that beyond its uncertainty."""
    if specification is None or not _comparable(value, specification):
        return None, False
    stated = [specification.limit(symbol, value.length_mm) for symbol in CHECK_QUANTITIES[value.quantity].symbols]
    limit = min((one for one in stated if one is not None), default=None)
    # k = 2
    over = limit is not None and decide(value.value_mm, 2 * value.u_artefact_mm, limit) is Verdict.NOT_CONFORM
    return limit, over


def _comparable(value: CheckValue, specification: Specification) -> bool:
    """Whether the limits of the specification hold for a value: for lengths at 20 degC if it is corrected to that."""
    if CHECK_QUANTITIES[value.quantity].artefact != "length":
        return True
    return value.length_mm is not None and specification.corrected_to_20_degC


def _reason(trend: Trend, since: int) -> str:
    assert trend.chart is not None
    if trend.single_value_out_of_limits:
        return f"{trend.latest.label}: beyond the limits of its chart in check {since + 1} alone{_when_last(trend)}"
    if trend.chart.change_index is None:
        what = "beyond the limits of its chart since"
    elif trend.chart.gradual:
        what = "a drift since about"
    else:
        what = "a jump at about"
    return f"{trend.latest.label}: {what} check {since + 1}{_when_last(trend)}"


def _over(trend: Trend) -> str:
    sign = "" if CHECK_QUANTITIES[trend.latest.quantity].scale else "+"
    alone = "" if trend.over_before else f" in check {trend.checks[-1] + 1} alone"
    return (
        f"{trend.latest.label}: {trend.latest.value_mm:{sign}.4f} mm is over the limit of {trend.limit_mm:.4f} mm"
        f"{alone}{_when_last(trend)}"
    )


def _when_last(trend: Trend) -> str:
    return "" if trend.current else f", measured last in check {trend.checks[-1] + 1}"


def _remarks(trends: Sequence[Trend]) -> tuple[str, ...]:
    """Which charts cannot say yet that nothing has changed, beside others that can, and which were not asked today."""
    remarks = []
    some_enough = any(trend.enough for trend in trends)
    for trend in trends:
        if trend.chart is None or trend.asks:
            continue
        n = f"{trend.chart.n_before[-1]} of {MIN_BASELINE_CHECKS} checks before"
        if not trend.current:
            then = "unchanged" if trend.enough else f"not judged, {n},"
            remarks.append(f"{trend.latest.label}: not in this check; {then} in check {trend.checks[-1] + 1}")
        elif some_enough and not trend.enough:
            remarks.append(f"{trend.latest.label}: not judged yet, {n}")
    return tuple(remarks)


def _not_compared(trends: Sequence[Trend], specification: Specification | None) -> tuple[str, ...]:
    """Which lengths of the last check have limits in the specification that do not hold for them."""
    if specification is None:
        return ()
    if not specification.corrected_to_20_degC:
        why = "its limits hold for lengths that are not corrected to 20 degC"
    else:
        why = "a length is compared at 20 degC, and its expansion or the session's temperature is not known"
    return tuple(
        f"{trend.latest.label}: not compared with the specification: {why}"
        for trend in trends
        if trend.current
        and not _comparable(trend.latest, specification)
        and any(symbol in specification.limits for symbol in CHECK_QUANTITIES[trend.latest.quantity].symbols)
    )
