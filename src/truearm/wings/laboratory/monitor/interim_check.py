"""The interim check: a few readings in a seat, on a bar and on a sphere, and the test values from them.

The values are those of the standards' tests from fewer points. They verify nothing; what counts is whether they change.
Laboratories make such checks between calibrations (ISO/IEC 17025, 6.4.10) [recalled].
"""

from __future__ import annotations

import datetime
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np
import numpy.typing as npt

from truearm.acceptance import contradict
from truearm.errors import InputError
from truearm.readings import Lengths
from truearm.readings.thermal_expansion import ThermalExpansion
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.laboratory.monitor.control_chart import FALSE_ALARMS
from truearm.wings.laboratory.monitor.expected_values import (
    PointErrors,
    largest_form_and_diameter,
    largest_length_error,
    largest_scatter,
)
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere

# Points of a seat farther from their mean than this belong to two seats [mm]; no arm has such errors.
FARTHEST_IN_SEAT_MM = 10.0
# A length or a form that deviates by this share of the size belongs to another artefact.
SAME_SHARE = 0.05
# The least number of points that determines form and diameter of a sphere.
LEAST_ON_SPHERE = 5
MOST_NAME = 1000
# An interim check takes some ten points; the expectation for more than this costs too much, and is not calculated.
MOST_EXPECTED = 300


@dataclass(frozen=True)
class CheckQuantity:
    """A quantity measured on an artefact in an interim check.

    Attributes
    ----------
    name : str
    artefact : str
        The kind of artefact: seat, length or sphere; or the whole check.
    charted : bool
        Whether it has a control chart; a quantity that follows another one has none.
    scale : bool
        Whether it is a scatter: never negative, and only an increase is a change for the worse.
    symbols : tuple of str
        Symbols of the limits in a specification that apply to it.
    """

    name: str
    artefact: str
    charted: bool
    scale: bool
    symbols: tuple[str, ...] = ()

    @property
    def n_sides(self) -> int:
        """The number of directions in which it can change for the worse."""
        return 1 if self.scale else 2


CHECK_QUANTITIES: Mapping[str, CheckQuantity] = {
    one.name: one
    for one in (
        CheckQuantity("SPAT.2s", "seat", charted=True, scale=True, symbols=("SPAT.2s",)),
        CheckQuantity("SPAT.Max", "seat", charted=False, scale=True, symbols=("SPAT.Max",)),
        CheckQuantity("length error", "length", charted=True, scale=False, symbols=("E_Uni", "Volumetric.Max")),
        CheckQuantity("form", "sphere", charted=True, scale=True, symbols=("P_Form.Sph.1x25",)),
        CheckQuantity("diameter", "sphere", charted=True, scale=False),
        CheckQuantity("difference", "whole check", charted=True, scale=True),
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
        Name of the seat or sphere, or of both seats of a length; empty for a whole check.
    value_mm : float
    u_mm : float
        Expected standard deviation from check to check, from the scatter of the points [mm].
    u_artefact_mm : float
        Standard uncertainty of the artefact: of its calibration and its position [mm].
    n : int
        Number of readings.
    length_mm : float or None
        The known length, where the value is a length error at 20 degC; else None: no limit applies to a length error
        at another temperature.
    largest_expected_mm : float or None
        The deviation that the uncertainty of the model explains: a scatter, a length error of either sign, or the
        difference of a diameter from its true value [mm]. Of checks of an arm that is as its model states, 1 in 370 has
        a value that deviates by more (`FALSE_ALARMS`), all values of the check together. None where it is not known, or
        the quantity has no chart.

    Raises
    ------
    InputError
        If the quantity is unknown, or a number is not finite, negative where it cannot be, or not a number.
    """

    quantity: str
    artefact: str
    value_mm: float
    u_mm: float
    u_artefact_mm: float
    n: int
    length_mm: float | None = None
    largest_expected_mm: float | None = None

    def __post_init__(self) -> None:
        quantity = CHECK_QUANTITIES.get(self.quantity) if isinstance(self.quantity, str) else None
        if quantity is None:
            raise InputError(
                f"unknown quantity {self.quantity!r:.80}", hint=f"use one of {', '.join(CHECK_QUANTITIES)}"
            )
        if not isinstance(self.artefact, str) or len(self.artefact) > MOST_NAME:
            raise InputError(f"expected a name of at most {MOST_NAME} characters, got {self.artefact!r:.80}")
        optional = [0.0 if one is None else one for one in (self.length_mm, self.largest_expected_mm)]
        numbers = (self.value_mm, self.u_mm, self.u_artefact_mm, *optional)
        if not all(map(_is_number, numbers)) or type(self.n) is not int or self.n < 1:
            raise InputError(f"expected finite numbers and one reading or more, got {self!r:.200}")
        if min(self.u_mm, self.u_artefact_mm, optional[1], self.value_mm if quantity.scale else 0.0) < 0:
            raise InputError(f"expected scatters and uncertainties of 0 or more, got {self!r:.200}")

    @property
    def key(self) -> tuple[str, str, bool]:
        """The key of its series; a length that is not corrected to 20 degC has a series of its own."""
        return self.quantity, self.artefact, self.length_mm is not None

    @property
    def label(self) -> str:
        """The artefact and the quantity: ``seat cone, SPAT.2s``."""
        kind = CHECK_QUANTITIES[self.quantity].artefact
        as_measured = " as measured" if kind == "length" and self.length_mm is None else ""
        return f"{' '.join(filter(None, (kind, self.artefact)))}, {self.quantity}{as_measured}"

    def exceeds_expected(self, earlier_mm: Sequence[float]) -> bool:
        """Whether the value deviates by more than the uncertainty of the model explains.

        Parameters
        ----------
        earlier_mm : sequence of float
            Values of earlier checks. A diameter, which nobody states, is compared with their mean: n of them and the
            new one differ by ``sqrt(1 + 1/n)`` times the uncertainty of one at most, as some of it is common to all.
        """
        if self.largest_expected_mm is None:
            return False
        if self.quantity != "diameter":
            return abs(self.value_mm) > self.largest_expected_mm
        n = len(earlier_mm)
        return n > 0 and abs(self.value_mm - sum(earlier_mm) / n) > self.largest_expected_mm * math.sqrt(1 + 1 / n)

    def uses(self, artefact: str) -> bool:
        """Whether it was measured on an artefact; a length is measured on both of its seats."""
        return self.artefact == artefact or (
            CHECK_QUANTITIES[self.quantity].artefact == "length"
            and (self.artefact.startswith(f"{artefact} to ") or self.artefact.endswith(f" to {artefact}"))
        )


@dataclass(frozen=True)
class CheckReading:
    """A reading of an interim check, to compare with those in the same pose of other checks.

    Attributes
    ----------
    artefact : str
        Kind and name: ``seat cone``.
    pose : tuple of float
        Joint angles [rad]; of joints that slide, metres.
    deviation_mm : tuple of float
        From the mean of its seat, or from the sphere through those of its sphere, (3,) [mm].

    Raises
    ------
    InputError
        If a part is not of this kind.
    """

    artefact: str
    pose: tuple[float, ...]
    deviation_mm: tuple[float, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.artefact, str) or len(self.artefact) > MOST_NAME or len(self.deviation_mm) != 3:
            raise InputError(f"expected a reading of an artefact with a deviation of 3 coordinates, got {self!r:.200}")
        if not all(map(_is_number, (*self.pose, *self.deviation_mm))):
            raise InputError(f"expected finite numbers of a reading, got {self!r:.200}")

    @property
    def name(self) -> str:
        """The name of the artefact."""
        return self.artefact.partition(" ")[2]


@dataclass(frozen=True)
class Withdrawal:
    """Why a check no longer counts: what was wrong with it, and when that was stated.

    Raises
    ------
    InputError
        If the reason is empty, too long or cannot be printed.
    """

    date: datetime.datetime
    reason: str

    def __post_init__(self) -> None:
        reason = self.reason
        if not isinstance(reason, str) or not reason.strip() or len(reason) > MOST_NAME or not reason.isprintable():
            raise InputError(
                f"expected the reason of a withdrawal, up to {MOST_NAME} characters in one line, got {reason!r:.80}",
                hint='--reason "the ball was dirty"',
            )


@dataclass(frozen=True)
class InterimCheck:
    """An interim check as a history stores it.

    Attributes
    ----------
    date : datetime.datetime
        Local time, without a zone.
    model, session : str
        Fingerprints of the model and of the readings.
    temperature_degC : float or None
        Mean temperature of the readings.
    values : tuple of CheckValue
        One or more, each quantity of an artefact once.
    readings : tuple of CheckReading
        None in a check that was stored before they were.
    withdrawn : Withdrawal or None
        None for a check that counts.
    accepted : tuple of str
        Contradictions in its readings that a person accepted, with the reasons.

    Raises
    ------
    InputError
        If there are no values, one appears twice, poses have different numbers of joints, the temperature is not a
        finite number, or what was accepted cannot be printed.
    """

    date: datetime.datetime
    model: str
    session: str
    temperature_degC: float | None
    values: tuple[CheckValue, ...]
    readings: tuple[CheckReading, ...] = ()
    withdrawn: Withdrawal | None = None
    accepted: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for one in self.accepted:
            if not isinstance(one, str) or not one.strip() or not one.isprintable():
                raise InputError(f"expected what was accepted in words of one line, got {one!r:.80}")
        if self.temperature_degC is not None and not _is_number(self.temperature_degC):
            raise InputError(f"expected a temperature in degC, got {self.temperature_degC!r:.80}")
        if not self.values:
            raise InputError(f"the check of {self.date:%Y-%m-%d %H:%M} has no values")
        if len({len(one.pose) for one in self.readings}) > 1:
            raise InputError(f"the check of {self.date:%Y-%m-%d %H:%M} has poses of different numbers of joints")
        names = [(one.quantity, one.artefact) for one in self.values]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise InputError(f"the check has two values of {name[1]:.80}, {name[0]}")

    def has_session_of(self, other: InterimCheck) -> bool:
        """Whether both are of one session, its rows in whatever order: another order makes no other readings."""
        if self.session == other.session:
            return True
        mine, theirs = (sorted((r.artefact, r.pose, r.deviation_mm) for r in each.readings) for each in (self, other))
        if not mine or [one[:2] for one in mine] != [one[:2] for one in theirs]:
            return False
        degC = [math.nan if each.temperature_degC is None else each.temperature_degC for each in (self, other)]
        # Sums in another order differ by rounding, and deviations are rounded to 1 nm.
        return bool(
            np.isclose(degC[0], degC[1], equal_nan=True)
            and np.allclose([one[2] for one in mine], [one[2] for one in theirs], rtol=0, atol=2e-6)
        )


def counted(checks: Iterable[InterimCheck]) -> tuple[InterimCheck, ...]:
    """The checks that are not withdrawn."""
    return tuple(check for check in checks if check.withdrawn is None)


def _is_number(value: object) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def interim_values(
    points: npt.ArrayLike,
    *,
    std_mm: npt.ArrayLike,
    errors: PointErrors | None = None,
    seat: NameArray | None = None,
    sphere: NameArray | None = None,
    lengths: Lengths | None = None,
    temperature_degC: float | None = None,
    false_alarms: float = FALSE_ALARMS,
) -> tuple[CheckValue, ...]:
    """Calculate the test values of an interim check.

    Parameters
    ----------
    points : (n, 3) array
        The tip's centre at each reading [mm].
    std_mm : (n,) array
        Standard deviation of a coordinate of each point, from reading to reading [mm].
    errors : PointErrors, optional
        What the points are uncertain by in all; without them values have no largest expected ones.
    seat, sphere : (n,) array of str, optional
        Name of the seat or sphere of each point; empty where there is none.
    lengths : Lengths, optional
        Known lengths between the seats.
    temperature_degC : float, optional
        Temperature of arm and artefacts. A length with a known thermal expansion is corrected from it to 20 degC, with
        the uncertainty `ThermalExpansion.artefact_u_K`; other lengths are not corrected.
    false_alarms : float
        Share of checks with a value that deviates by more than `errors` explain, if these are right: each of the values
        with a chart has an equal part of it, so that all have at most that (Bonferroni).

    Returns
    -------
    tuple of CheckValue
        For each seat with two points or more, `SPAT.Max` and `SPAT.2s` (see `single_point` in
        `truearm.wings.laboratory.standards.asme_b89_4_22`). For each length, the distance of the seats' means less the
        known length. For each sphere, form and diameter of the least-squares sphere through the tip's centres; this
        diameter is larger than the sphere's by that of the tip.

    Raises
    ------
    InputError
        If there is no value to calculate, a point is not finite, a sphere has too few points, or points cannot belong
        to one artefact.
    """
    points, std = np.asarray(points, dtype=float), np.asarray(std_mm, dtype=float)
    if not (np.isfinite(points).all() and np.isfinite(std).all() and (std >= 0).all()):
        raise InputError("expected finite points and standard deviations of 0 or more")
    seats, spheres = _groups(seat), _groups(sphere)
    values = [value for name, rows in seats.items() for value in _of_seat(name, points[rows], std[rows])]
    if lengths is not None:
        values += _of_lengths(lengths.between(seats), seats, points, std, temperature_degC)
    values += [value for name, rows in spheres.items() for value in _of_sphere(name, points[rows], std[rows])]
    if not values:
        raise InputError(
            "expected readings in a seat, two or more of them, or on a sphere, got none",
            hint="name the seat or the sphere of each reading in the columns seat and sphere of the session",
        )
    return _with_largest_expected(values, points, errors, seats, spheres, false_alarms)


def _with_largest_expected(
    values: Sequence[CheckValue],
    points: FloatArray,
    errors: PointErrors | None,
    seats: Mapping[str, IntArray],
    spheres: Mapping[str, IntArray],
    false_alarms: float,
) -> tuple[CheckValue, ...]:
    """The values, each with the largest that the errors of the model explain, where they are known."""
    if errors is None:
        return tuple(values)
    probability = false_alarms / sum(CHECK_QUANTITIES[value.quantity].charted for value in values)
    largest = {
        **{("SPAT.2s", name): _expected_scatter(errors.of(rows), probability) for name, rows in seats.items()},
        **_expected_spheres(spheres, points, errors, probability),
    }
    for value in values:
        if value.quantity == "length error" and value.length_mm is not None:
            largest[value.quantity, value.artefact] = _expected_length(value, seats, points, errors, probability)
    # Zero: neither model nor artefact states an uncertainty.
    return tuple(
        replace(value, largest_expected_mm=largest.get((value.quantity, value.artefact)) or None) for value in values
    )


def copy_remarks(angles: FloatArray, artefact: Sequence[str]) -> list[str]:
    """Name artefacts with readings whose joint angles are the same to the last digit: these show no scatter."""
    remarks = []
    for name in sorted({*artefact} - {""}):
        own = angles[np.array(artefact) == name]
        if copies := len(own) - len(np.unique(own, axis=0)):
            remarks.append(
                f"{copies} of {len(own)} readings of {name} have the joint angles of another of them to the last "
                "digit: they show no scatter. Unless the encoders are as coarse, or a robot returned to its pose, they "
                "were stored twice: move the arm between readings."
            )
    return remarks


def single_reading_remarks(seat: NameArray | None, lengths: Lengths | None) -> list[str]:
    """Name seats with a single reading, which have no scatter: they are often misspelled names of other seats."""
    if seat is None:
        return []
    counts = Counter(name for name in seat.tolist() if name)
    ends = set() if lengths is None else {*lengths.seat_a.tolist(), *lengths.seat_b.tolist()}
    remarks = []
    for name in sorted(name for name, count in counts.items() if count == 1 and name not in ends):
        close = get_close_matches(name, [other for other, count in counts.items() if count > 1], n=1)
        meant = f"; is it {close[0]!r}, misspelled?" if close else ""
        remarks.append(f"Seat {name!r} has a single reading; ignored{meant}")
    return remarks


def _expected_scatter(errors: PointErrors, probability: float) -> float | None:
    return largest_scatter(errors, probability) if 2 <= len(errors.std_mm) <= MOST_EXPECTED else None


def _expected_length(
    value: CheckValue, seats: Mapping[str, IntArray], points: FloatArray, errors: PointErrors, probability: float
) -> float:
    ends = next((a, b) for a in seats for b in seats if value.artefact == f"{a} to {b}")
    a, b = (seats[end] for end in ends)
    away = points[a].mean(axis=0) - points[b].mean(axis=0)
    return largest_length_error(
        errors.of(a),
        errors.of(b),
        away / np.linalg.norm(away),
        u_artefact_mm=value.u_artefact_mm,
        probability=probability,
    )


def _expected_spheres(
    spheres: Mapping[str, IntArray], points: FloatArray, errors: PointErrors, probability: float
) -> dict[tuple[str, str], float | None]:
    found: dict[tuple[str, str], float | None] = {}
    for name, rows in spheres.items():
        if len(rows) <= MOST_EXPECTED:
            away = points[rows] - fit_sphere(points[rows]).centre
            directions = away / np.linalg.norm(away, axis=1, keepdims=True)
            form, diameter = largest_form_and_diameter(errors.of(rows), directions, probability)
            found |= {("form", name): form, ("diameter", name): diameter}
    return found


def interim_deviations(
    points: FloatArray, *, seat: NameArray | None = None, sphere: NameArray | None = None
) -> FloatArray:
    """The deviation of each point from the mean of its seat, or from the least-squares sphere of its sphere's points.

    Parameters
    ----------
    points : (n, 3) array
        The tip's centre at each reading [mm].
    seat, sphere : (n,) array of str, optional
        As in `interim_values`, which has accepted them.

    Returns
    -------
    (n, 3) array
        [mm]; NaN where nothing can be said: no artefact, or a single point in a seat.
    """
    deviation = np.full(points.shape, np.nan)
    for rows in _groups(seat).values():
        if len(rows) > 1:
            deviation[rows] = points[rows] - points[rows].mean(axis=0)
    for rows in _groups(sphere).values():
        fit = fit_sphere(points[rows], std_mm=1.0)
        away = points[rows] - fit.centre
        deviation[rows] = away * (1 - fit.radius_mm / np.linalg.norm(away, axis=1, keepdims=True))
    return deviation


def artefacts_of(seat: NameArray | None, sphere: NameArray | None, n: int) -> list[str]:
    """What each of n readings was taken on, kind and name, as a person calls it; empty for none."""
    none: NameArray = np.full(n, "")
    seats, spheres = (none if names is None else names for names in (seat, sphere))
    return [
        f"seat {one}" if one else f"sphere {other}" if other else ""
        for one, other in zip(seats.tolist(), spheres.tolist(), strict=True)
    ]


def _groups(names: NameArray | None) -> dict[str, IntArray]:
    """Rows of each name, in the order of first appearance."""
    if names is None:
        return {}
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
        contradict(
            InputError(
                f"seat {name!r}: a point is {largest:.4g} mm from the mean of the seat's points, too far for one seat",
                hint="check the names of the seats in the session, and that the model belongs to this arm",
            )
        )
    s = float(np.sqrt((away**2).sum() / (n - 1)))
    sigma = float(np.sqrt((std**2).mean()))
    return [
        CheckValue("SPAT.2s", name, 2 * s, 2 * sigma / np.sqrt(2 * (n - 1)), 0.0, n),
        CheckValue("SPAT.Max", name, largest, sigma, 0.0, n),
    ]


def _of_lengths(
    lengths: Lengths, seats: Mapping[str, IntArray], points: FloatArray, std: FloatArray, degC: float | None
) -> list[CheckValue]:
    """Errors of lengths: ``|mean_a - mean_b| / (1 + alpha (T - 20)) - L``.

    From check to check the means scatter along the length, and the artefact has a new position and temperature.
    """
    values = []
    names = ("seat_a", "seat_b", "length_mm", "u_mm", "u_place_mm")
    growth = ThermalExpansion.at(lengths, np.nan if degC is None else degC)
    u_growth = (np.where(growth.known, lengths.length_mm * u, 0.0) for u in (growth.u_temperature, growth.u_expansion))
    columns = (*(getattr(lengths, name) for name in names), growth.known, growth.factor, *u_growth)
    for a, b, known, u, u_place, at_reference, factor, u_warm, u_expansion in zip(
        *(column.tolist() for column in columns), strict=True
    ):
        rows = seats[a], seats[b]
        measured = float(np.linalg.norm(points[rows[0]].mean(axis=0) - points[rows[1]].mean(axis=0)))
        if abs(measured - known) > SAME_SHARE * known:
            contradict(
                InputError(
                    f"seats {a!r} and {b!r} are {measured:.5g} mm apart, the known length is {known:.5g} mm: these are "
                    "two different lengths",
                    hint="check the names of the seats in the session and in the file of lengths",
                )
            )
        # As for a bar with a certificate: the artefact's temperature, new in each check, and its expansion (GUM H.1.3).
        scatter = float(np.sqrt(sum((std[each] ** 2).mean() / len(each) for each in rows) + u_place**2 + u_warm**2))
        u_artefact = float(np.linalg.norm([u, u_place, u_warm, u_expansion]))
        n = sum(len(each) for each in rows)
        values.append(
            CheckValue(
                "length error",
                f"{a} to {b}",
                measured / factor - known,
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
            f"sphere {name!r}: expected {LEAST_ON_SPHERE} readings or more, got {n}",
            hint="measure more points all over the sphere",
        )
    sigma = max(float(np.sqrt((std**2).mean())), 1e-9)
    try:
        fit = fit_sphere(points, std_mm=sigma)
    except InputError as error:
        raise InputError(f"sphere {name!r}: {error.problem}", hint=error.hint) from None
    diameter = 2 * fit.radius_mm
    if fit.form_mm > SAME_SHARE * diameter:
        contradict(
            InputError(
                f"sphere {name!r}: the points deviate by {fit.form_mm:.4g} mm from a sphere of {diameter:.4g} mm, too "
                "far for one sphere",
                hint="check the names of the spheres in the session, and that the model belongs to this arm",
            )
        )
    return [
        CheckValue("form", name, fit.form_mm, 0.864 * sigma, 0.0, n),
        CheckValue("diameter", name, diameter, 2 * float(np.sqrt(fit.covariance[3, 3])), 0.0, n),
    ]
