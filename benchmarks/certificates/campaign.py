"""A right campaign by each standard, and what a person changes in it: texts of files, points, a written certificate."""

from __future__ import annotations

import datetime
import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import truearm as ta
from benchmarks.certificates import seen
from benchmarks.rows import scratch
from truearm.typing import FloatArray
from truearm.wings.laboratory.certificate.certificate import Certificate
from truearm.wings.laboratory.standards.coordinate_origin import ARM_SOFTWARE, CoordinateOrigin
from truearm.wings.laboratory.standards.layout import lay_out_tests
from truearm.wings.laboratory.standards.measured_points import MeasuredPoints, PointGroup
from truearm.wings.laboratory.standards.verification_plan import plan_text

ISO, ASME = "iso10360-12", "asme-b89.4.22"
RANGE_MM = 2500.0
NOISE_MM = 0.004  # of each coordinate, of an arm that conforms
DAY = datetime.date(2026, 1, 20)
NUMBERS = itertools.count(1)

# What a person changes in a text: a regular expression and what comes in its place, everywhere.
Edit = tuple[str, str | Callable[[re.Match[str]], str]]
Edits = Sequence[Edit]
Groups = Mapping[tuple[str, ...], PointGroup]
# What becomes of a group, given all of its test by their keys; None: it is left out.
Change = Callable[[PointGroup, Groups], PointGroup | None]
PointsChange = Callable[[MeasuredPoints], MeasuredPoints]

ABOUT = """\
number = "V-1"
issued = 2026-02-10
received = 2026-01-18
place = "laboratory"
item = { name = "arm", maker = "Example Arms", model = "A", serial_number = "10017" }
set_up = { stylus = "ball of ruby, 6 mm", mounting = "granite table", software = "Example Measure 4.2" }
laboratory = { name = "Example Laboratory", city = "Exampletown", country = "DE", post_code = "00000" }
customer = { name = "Example Customer", city = "Exampleville", country = "FR", post_code = "00001" }
persons = [{ name = "First Example", main_signer = true }]
conditions = { temperature_degC = [19.5, 20.5], relative_humidity_percent = [40.0, 55.0] }
"""
LIMITS = """\
name = "Example Arms A"
source = "data sheet 7"
measuring_range_mm = 2500
[rated_conditions]
air_degC = { min = 15, max = 25 }
[limits]
"P_Size.Sph.1x25" = { B_um = 25 }
"P_Form.Sph.1x25" = { B_um = 40 }
"L_Dia.5x5" = { B_um = 50 }
E_Uni = { B_um = 60 }
E_Bi = { B_um = 70 }
EffectiveDiameter = { B_um = 25 }
"SPAT.Max" = { B_um = 40 }
"SPAT.2s" = { B_um = 50 }
"Volumetric.Max" = { B_um = 60 }
"Volumetric.2s" = { B_um = 60 }
"Volumetric.2RMS" = { B_um = 60 }
"""
_KNOWN = """\
issued_by = "Example Calibration"
issuer_accreditation = "X-K-00001-01-00"
date = 2026-01-01
expires = 2028-01-01
"""
ARTEFACTS = f"""\
[[spheres]]
name = "ball"
serial_number = "S-1"
certificate = "K-101"
{_KNOWN}diameter_mm = 25.0
u_diameter_mm = 0.0002
form_mm = 0.0003
expansion_per_K = 5.5e-6
u_expansion_per_K = 0.5e-6
u_temperature_K = 0.5
u_fixture_mm = 0.0005
[[bars]]
name = "bar"
serial_number = "B-1"
certificate = "K-102"
{_KNOWN}form_mm = 0.0005
expansion_per_K = 1e-6
u_expansion_per_K = 0.3e-6
u_temperature_K = 0.5
u_fixture_mm = 0.0025
u_alignment_mm = 0.5
lengths = [
  {{ name = "150", length_mm = 150, u_mm = 0.001 }},
  {{ name = "450", length_mm = 450, u_mm = 0.001 }},
  {{ name = "900", length_mm = 900, u_mm = 0.001 }},
  {{ name = "1300", length_mm = 1300, u_mm = 0.001 }},
  {{ name = "1700", length_mm = 1700, u_mm = 0.001 }},
]
[[seats]]
name = "seat"
serial_number = "C-1"
certificate = "K-103"
{_KNOWN}form_mm = 0.001
u_fixture_mm = 0.001
"""


def file(text: str | bytes, ending: str) -> str:
    """A new file with a text."""
    path = scratch() / f"certificates-{next(NUMBERS)}.{ending}"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return str(path)


def edited(text: str, edits: Edits) -> str:
    """A text as a person changes it; an error of this benchmark where there is nothing to change."""
    for pattern, after in edits:
        text, n = re.subn(pattern, after, text, flags=re.DOTALL)
        if not n:
            raise ValueError(f"there is no {pattern!r} to change")
    return text


def confirmed_plan(standard: str) -> str:
    """The plan as a laboratory confirms it, with the place where it read every entry, all tests required."""
    source = 'confirmed = true, source = "clause 6.2.3"'
    return edited(
        plan_text(standard),
        [
            (r'confirmed = false, source = "[^"]*"', source),
            (
                r"# \[confirmation\]\n# confirmed_by = \"\"[^\n]*\n# date = 1900-01-01",
                '[confirmation]\nconfirmed_by = "Second Example"\ndate = 2026-01-15',
            ),
            ("required = (?:true|false)", "required = true"),
        ],
    )


@cache
def measured(plan: str, artefacts: str, range_mm: float, seed: int = 1) -> MeasuredPoints:
    """Points as a plan lays them out, with noise, written to 10 nm."""
    layout = lay_out_tests(
        ta.load_verification_plan(file(plan, "toml")), ta.read_artefacts(file(artefacts, "toml")), range_mm
    )
    rng = np.random.default_rng(seed)
    groups = [
        (
            one.test,
            PointGroup(
                one.artefact,
                dict(one.keys),
                (one.points + NOISE_MM * rng.normal(size=one.points.shape)).round(5),
                20.0,
                0.0,
                DAY,
                tuple(range(2, 2 + len(one.points))),
                serial_number={"ball": "S-1", "bar": "B-1", "seat": "C-1"}.get(one.artefact, ""),
            ),
        )
        for one in layout
    ]
    made = MeasuredPoints.of(groups, serial_number="10017", origin=CoordinateOrigin(ARM_SOFTWARE))
    return replace(made, file=Path("points.csv"))


@dataclass(frozen=True)
class Campaign:
    """What a laboratory has when it certifies an arm: the texts of its files, and the points."""

    plan: str
    artefacts: str
    limits: str
    about: str
    points: MeasuredPoints

    def verified(self, **options: Any) -> ta.VerificationResult:
        """What `truearm verify` finds."""
        return ta.verify(
            self.points,
            plan=file(self.plan, "toml"),
            artefacts=file(self.artefacts, "toml"),
            specification=file(self.limits, "toml"),
            **options,
        )

    def certified(self, *, rule: Any = None, **options: Any) -> ta.CertificateResult:
        """What `truearm certificate` makes of it."""
        return ta.certificate(self.verified(rule=rule), file(self.about, "toml"), **options)

    def stated(self, **options: Any) -> str:
        """All that the certificate states in words, and what the command prints."""
        made = self.certified(**options)
        return f"{made} {words_of(made.certificate)}"

    def xml(self, **options: Any) -> str:
        """The certificate as it is written for machines, and read again."""
        path = file("", "xml")
        self.certified(**options).save(path, force=True)
        return Path(path).read_text(encoding="utf-8")


def words_of(certificate: Certificate) -> str:
    """The words of a certificate: statements, methods, artefacts."""
    said = [certificate.title, *(one.text for one in certificate.statements)]
    said += [f"{one.name}: {one.description} {one.norm or 'no standard'}" for one in certificate.methods]
    said += [f"{one.name}, serial number {one.serial_number}: {one.description}" for one in certificate.equipment]
    return " ".join([*said, f"conformity {certificate.conformity or 'none'}"])


def campaign(
    standard: str = ISO,
    *,
    plan: Edits = (),
    artefacts: Edits = (),
    limits: Edits = (),
    about: Edits = (),
    points: PointsChange | None = None,
    laid_out: bool = False,
    seed: int = 1,
) -> Campaign:
    """The right campaign by a standard with changes; `laid_out`: its points as changed plan and artefacts ask."""
    texts = edited(confirmed_plan(standard), plan), edited(ARTEFACTS, artefacts), edited(LIMITS, limits)
    range_mm = float(re.search(r"measuring_range_mm = (\d+)", texts[2])[1]) if laid_out else RANGE_MM  # type: ignore[index]
    as_planned = texts[:2] if laid_out else (confirmed_plan(standard), ARTEFACTS)
    given = measured(*as_planned, range_mm, seed)
    return Campaign(*texts, edited(ABOUT, about), given if points is None else points(given))


def in_test(test: str, change: Change) -> PointsChange:
    """Change the groups of a test."""

    def all_of(given: MeasuredPoints) -> MeasuredPoints:
        by_keys = {tuple(one.keys.values()): one for one in given.tests[test]}
        kept = [after for one in given.tests[test] if (after := change(one, by_keys)) is not None]
        tests = {**given.tests, test: tuple(kept)}
        return replace(given, tests={name: groups for name, groups in tests.items() if groups})

    return all_of


def in_all(change: Callable[[PointGroup], PointGroup]) -> PointsChange:
    """Change the groups of all tests."""
    return lambda given: replace(given, tests={test: tuple(map(change, all_)) for test, all_ in given.tests.items()})


def at(one: PointGroup, points: FloatArray) -> PointGroup:
    """A group with other points, written to 10 nm."""
    return replace(one, points=np.asarray(points).round(5), lines=tuple(range(2, 2 + len(points))))


@cache
def written(standard: str = ISO) -> str:
    """The certificate of the right campaign, for machines."""
    return campaign(standard).xml()


def read(text: str | bytes, *options: object, code: int = 0) -> str:
    """What is said of a certificate that somebody reads."""
    return seen("certificate", "--read", file(text, "xml"), *options, code=code)


def read_edited(*edits: Edit, standard: str = ISO) -> str:
    """What is said of the unsigned certificate of the right campaign after somebody changed its text."""
    return read(edited(written(standard), edits))
