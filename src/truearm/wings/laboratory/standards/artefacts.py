"""Calibrated artefacts: the values of their certificates, and the uncertainty of their set-up.

The file (TOML, docs/verification.md) has one entry for each artefact. Uncertainties are standard ones (k = 1): half
of a certificate's U for k = 2.
"""

from __future__ import annotations

import datetime
from importlib.resources import files
from math import inf, sqrt
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

from pydantic import Field, field_validator, model_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Name, NotNegative, Positive, Real, read_document
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray
from truearm.wings.laboratory import TemplateKind
from truearm.wings.laboratory.standards.propagation import ErrorSource, in_each

# No calibrated artefact has a larger form deviation or uncertainty [mm]; such numbers are micrometres.
LARGEST_MM = 0.2
IN_MM = "convert to mm: 0.5 micrometres are 0.0005"
# A calibrated length that differs from its nominal one by this share belongs to another artefact or unit.
NOMINAL_SHARE = 0.05


class _WithUncertainties(Document):
    """A table with standard uncertainties; the key of an expanded one has a message of its own."""

    @model_validator(mode="before")
    @classmethod
    def _standard_uncertainties(cls, given: object) -> object:
        for key in given if isinstance(given, dict) else ():
            small = "u" + str(key)[1:]
            if str(key).startswith("U") and small in cls.model_fields:
                raise InputError(
                    f"unknown key {key}",
                    hint=f"write {small}, the standard uncertainty (k = 1): half of a certificate's U for k = 2",
                )
        return given


class Artefact(_WithUncertainties):
    """The keys of every artefact.

    Attributes
    ----------
    name : str
        As in the file of points.
    serial_number : str or None
        As engraved; where the points state one in ``artefact_serial_number``, it must be the same.
    certificate : str
        Number or title of its certificate.
    issued_by : str or None
        The laboratory that issued the certificate; a certificate of the arm needs it.
    issuer_accreditation : str or None
        The accreditation of that laboratory, such as ``D-K-00000-01-00``; of a national institute the arrangement,
        such as ``CIPM MRA``. Without it no traceability is stated.
    date, expires : date
        Dates of the calibration and of the end of its validity.
    form_mm : float
        Form deviation of the ball, the faces or the seat [mm].
    u_form_mm : float
        Standard uncertainty of the form deviation [mm].
    u_fixture_mm : float
        Standard uncertainty of the position in its fixture [mm].
    """

    name: Name
    serial_number: Name | None = None
    certificate: Name
    issued_by: Name | None = None
    issuer_accreditation: Name | None = None
    date: datetime.date
    expires: datetime.date
    form_mm: NotNegative
    u_form_mm: NotNegative = 0.0
    u_fixture_mm: NotNegative
    kind: ClassVar = "seat"

    @field_validator("form_mm", "u_form_mm", "u_fixture_mm")
    @classmethod
    def _in_mm(cls, given: float) -> float:
        if given > LARGEST_MM:
            raise InputError(f"expected millimetres, {LARGEST_MM:g} at most, got {given:g}", hint=IN_MM)
        return given

    @model_validator(mode="after")
    def _dates_in_order(self) -> Self:
        if self.expires <= self.date:
            raise InputError(
                f"{self.name!r} expires on {self.expires}, which is not after its calibration on {self.date}",
                hint="copy both dates from the certificate",
            )
        return self

    def check_valid(self, day: datetime.date) -> None:
        """Check that the certificate is valid on a day.

        Raises
        ------
        InputError
            If it has expired before, or the calibration is later.
        """
        if day > self.expires:
            raise InputError(
                f"the certificate {self.certificate!r} of {self.name!r} expired on {self.expires}; points were "
                f"measured on {day}",
                hint="have it calibrated again, or use an artefact with a valid certificate",
            )
        if day < self.date:
            raise InputError(
                f"{self.name!r} was calibrated on {self.date}, after points were measured on it on {day}",
                hint="enter the certificate that was valid on that day",
            )

    def form_sources(self, shape: tuple[int, ...], *, ends: int = 1) -> tuple[ErrorSource, ErrorSource]:
        """Return what the form does to touches: each is off by up to half the form deviation, uniformly (GUM 4.3.7).

        Parameters
        ----------
        shape : tuple of int
            Of the readings, each with a touch of its own: (n,), or (n, 3) where it may be off in each direction.
        ends : int
            Number of touches in a reading: a length has two.
        """
        share = sqrt(ends / 12)
        return (
            in_each("form of the artefact", share * self.form_mm, shape),
            in_each("calibration of the form", share * self.u_form_mm, shape),
        )

    def fixture_source(self, shape: tuple[int, ...]) -> ErrorSource:
        """Return what the fixture does to readings: the artefact moves again in each, and each direction."""
        return in_each("fixture", self.u_fixture_mm, shape)


A = TypeVar("A", bound=Artefact)


class _Expanding(Artefact):
    """An artefact with a calibrated size and a thermal expansion."""

    expansion_per_K: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e-4, le=1e-3)]
    u_expansion_per_K: NotNegative
    u_temperature_K: NotNegative
    calibration_dof: Positive = inf

    @model_validator(mode="after")
    def _known_to_some_share(self) -> Self:
        if self.u_expansion_per_K > 1e-4:
            raise InputError(
                f"{self.name!r}: u_expansion_per_K = {self.u_expansion_per_K:g} is larger than any expansion "
                "coefficient",
                hint="write it per kelvin: 1e-6 is one micrometre per metre and kelvin",
            )
        return self

    def at_reference(self, length_mm: float, degC: float) -> float:
        """Correct a length measured at `degC` to 20 degC: ``L / (1 + alpha (T - 20))``."""
        return length_mm / (1 + self.expansion_per_K * (degC - REFERENCE_DEGC))

    def thermal_sources(self, length_mm: FloatArray, degC: FloatArray) -> tuple[ErrorSource, ErrorSource]:
        """Return ``L alpha u(T)`` and ``L (T - 20) u(alpha)`` (GUM H.1.3) of n readings, which have them in common.

        Parameters
        ----------
        length_mm, degC : (n,) array
            Sizes of this artefact, 0 in readings of another one, and its temperature.
        """
        warmth = length_mm * (degC - REFERENCE_DEGC)
        return (
            ErrorSource("temperature of the artefact", length_mm[None] * self.expansion_per_K * self.u_temperature_K),
            ErrorSource("expansion of the artefact", warmth[None] * self.u_expansion_per_K),
        )


class CalibratedSphere(_Expanding):
    """A sphere: `diameter_mm` at 20 degC and its standard uncertainty `u_diameter_mm`."""

    diameter_mm: Positive
    u_diameter_mm: Positive
    nominal_mm: Positive | None = None
    kind: ClassVar = "sphere"

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        _check_nominal(self.name, self.diameter_mm, self.nominal_mm)
        _check_small(self.name, self.diameter_mm, self.u_diameter_mm, "u_diameter_mm")
        _check_small(self.name, self.diameter_mm, self.form_mm, "form_mm")
        return self


class CalibratedLength(_WithUncertainties):
    """A length of a bar at 20 degC: between the centres of two balls, or two faces."""

    name: Name
    length_mm: Positive
    u_mm: Positive
    nominal_mm: Positive | None = None


class CalibratedBar(_Expanding):
    """A ball bar, ball plate, step gauge or gauge block with its lengths.

    Attributes
    ----------
    u_alignment_mm : float or None
        Of a length between faces, with one point on each: standard uncertainty of how far the point on one face lies
        beside the one opposite, in each of both directions across the length [mm]. None: three points or more a face.
    lengths : tuple of CalibratedLength
    """

    u_alignment_mm: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=20)] | None = None
    lengths: Annotated[tuple[CalibratedLength, ...], Field(min_length=1, max_length=1000)]
    kind: ClassVar = "bar"

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        _check_once([length.name for length in self.lengths], f"length of {self.name!r}")
        for length in self.lengths:
            what = f"{self.name}, {length.name}"
            _check_nominal(what, length.length_mm, length.nominal_mm)
            _check_small(what, length.length_mm, length.u_mm, "u_mm")
        return self

    def length(self, name: str) -> CalibratedLength:
        """Look a length up.

        Raises
        ------
        InputError
            If the certificate has no length of that name.
        """
        for length in self.lengths:
            if length.name == name:
                return length
        known = ", ".join(repr(length.name) for length in self.lengths)
        raise InputError(f"the certificate of {self.name!r} has no length {name!r}", hint=f"use one of {known}")


class Seat(Artefact):
    """A cone, trihedral socket or other seat for the tip; only its form is calibrated."""


class Artefacts(Document):
    """All artefacts of a verification, by kind.

    Examples
    --------
    >>> import truearm as ta
    >>> artefacts = ta.simulate_verification("perfect", n_arms=1).artefacts
    >>> isinstance(artefacts, ta.Artefacts)
    True
    """

    spheres: tuple[CalibratedSphere, ...] = ()
    bars: tuple[CalibratedBar, ...] = ()
    seats: tuple[Seat, ...] = ()

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        names = [one.name for one in self.all]
        if not names:
            raise InputError(
                "expected an artefact under [[spheres]], [[bars]] or [[seats]], got none",
                hint="add the artefacts you use",
            )
        _check_once(names, "artefact")
        return self

    @property
    def all(self) -> tuple[CalibratedSphere | CalibratedBar | Seat, ...]:
        """The artefacts of every kind."""
        return (*self.spheres, *self.bars, *self.seats)

    def sphere(self, name: str) -> CalibratedSphere:
        """Look a sphere up; an InputError lists the known ones."""
        return _look_up(self.spheres, name, "sphere")

    def bar(self, name: str) -> CalibratedBar:
        """Look a bar up; an InputError lists the known ones."""
        return _look_up(self.bars, name, "bar")

    def seat(self, name: str) -> Seat:
        """Look a seat up; an InputError lists the known ones."""
        return _look_up(self.seats, name, "seat")


def read_artefacts(path: str | Path) -> Artefacts:
    r"""Read a file of artefacts.

    Raises
    ------
    InputError
        If the file is missing or breaks a rule of its format, or a certificate contradicts itself.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> seat = '[[seats]]\nname = "cone"\ncertificate = "own"\ndate = 2026-01-15\nexpires = 2028-01-15\n'
    >>> _ = Path("artefacts.toml").write_text(seat + "form_mm = 0.001\nu_fixture_mm = 0.001\n")
    >>> ta.read_artefacts("artefacts.toml").seats[0].name
    'cone'
    """
    return read_document(path, Artefacts)


def _look_up(artefacts: tuple[A, ...], name: str, kind: str) -> A:
    for one in artefacts:
        if one.name == name:
            return one
    known = ", ".join(repr(one.name) for one in artefacts)
    hint = f"use one of {known}, or add it under [[{kind}s]]" if known else f"add it under [[{kind}s]]"
    raise InputError(f"the file of artefacts has no {kind} {name!r}", hint=hint)


def _check_once(names: list[str], what: str) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(f"the {what} {name!r} is given twice", hint="remove one, or rename it")


def _check_nominal(what: str, value: Real, nominal: Real | None) -> None:
    if nominal is not None and abs(value - nominal) > NOMINAL_SHARE * nominal:
        raise InputError(
            f"{what}: calibrated {value:g} mm, nominal {nominal:g} mm: too different for one artefact",
            hint="enter both in mm, from the same certificate",
        )


def _check_small(what: str, value: Real, u: Real, key: str) -> None:
    if u > min(0.01 * value, LARGEST_MM):
        raise InputError(
            f"{what}: {key} = {u:g} mm is more than a hundredth of the calibrated {value:g} mm, "
            f"or more than {LARGEST_MM:g} mm",
            hint=IN_MM,
        )


# Lengths of the example bar as shares of the measuring range: the longest exceeds the 66 % that plans ask for.
_EXAMPLE_SHARES = (0.06, 0.18, 0.36, 0.52, 0.68)
_EXAMPLE_DATES = {"date": datetime.date(2026, 1, 1), "expires": datetime.date(2028, 1, 1)}


def example_artefacts(measuring_range_mm: float) -> Artefacts:
    """Return example artefacts to try a plan with: a 25 mm ball, a carbon fibre bar with five lengths, and a seat.

    Uncertainties have the order of magnitude that laboratories state: 0.2 um for a ball, 1 um for a length and 0.5 K
    with 1e-6 / K for carbon fibre, 2.5 um for the fixture of a bar.
    """
    known: dict[str, Any] = {"certificate": "example, no calibration", "issued_by": "nobody", **_EXAMPLE_DATES}
    lengths = (round(share * measuring_range_mm, -1) or 1.0 for share in _EXAMPLE_SHARES)
    return Artefacts(
        spheres=(
            CalibratedSphere(
                name="ball",
                **known,
                diameter_mm=25.0,
                u_diameter_mm=0.0002,
                form_mm=0.0003,
                expansion_per_K=5.5e-6,
                u_expansion_per_K=0.5e-6,
                u_temperature_K=0.5,
                u_fixture_mm=0.0005,
            ),
        ),
        bars=(
            CalibratedBar(
                name="bar",
                **known,
                form_mm=0.0005,
                expansion_per_K=1e-6,
                u_expansion_per_K=0.3e-6,
                u_temperature_K=0.5,
                u_fixture_mm=0.0025,
                u_alignment_mm=0.5,
                lengths=tuple(CalibratedLength(name=f"{one:g}", length_mm=one, u_mm=0.001) for one in lengths),
            ),
        ),
        seats=(Seat(name="seat", **known, form_mm=0.001, u_fixture_mm=0.001),),
    )


def template(kind: TemplateKind) -> str:
    """Return the text of an empty file; it is refused until it is filled in.

    Parameters
    ----------
    kind : {"artefacts", "mpe"}
        The certificates of the artefacts, or the specification of the arm.
    """
    return files("truearm.wings.laboratory.standards").joinpath(f"{kind}_template.toml").read_text(encoding="utf-8")
