"""A made-up verification and what a certificate of it says beside the results."""

import datetime
from itertools import count
from pathlib import Path

import numpy as np

from confirmed_plan import confirmed
from truearm.wings.laboratory.certificate.administrative_data import AdministrativeData
from truearm.wings.laboratory.certificate.certificate import make_certificate
from truearm.wings.laboratory.standards.artefacts import Artefacts
from truearm.wings.laboratory.standards.decision import (
    Budget,
    ConformityResult,
    Contribution,
    assess_conformity,
    overall_verdict,
)
from truearm.wings.laboratory.standards.measured_points import MeasuredPoints, PointGroup
from truearm.wings.laboratory.standards.specification import Specification
from truearm.wings.laboratory.standards.verification import Verification
from truearm.wings.laboratory.standards.verification_plan import load_verification_plan

DAY = datetime.date(2026, 11, 3)
DATED = {
    "certificate": "K-1",
    "issued_by": "Gauge & Co",
    "issuer_accreditation": "X-K-12",
    "date": DAY,
    "expires": DAY.replace(year=2028),
    "form_mm": 0.001,
    "u_fixture_mm": 0.002,
}
GROWING = {"expansion_per_K": 1e-6, "u_expansion_per_K": 1e-7, "u_temperature_K": 0.5}
ARTEFACTS = Artefacts(
    spheres=[
        {"name": "ball", "serial_number": "Q-4", "diameter_mm": 25.0004, "u_diameter_mm": 0.0002, **DATED, **GROWING}
    ],
    bars=[{"name": "bar", "lengths": [{"name": "900", "length_mm": 900.003, "u_mm": 0.0005}], **DATED, **GROWING}],
    seats=[{"name": "cone", **DATED}],
)
BUDGET = Budget((Contribution("calibration", 0.003, 4.0), Contribution("fixture", 0.004)))  # U = 0.0104 mm, k = 2.09
ADDRESS = {"post_code": "00000", "city": "Exampletown", "country": "DE"}
TOLD = {
    "number": "V-1",
    "issued": DAY.replace(day=5),
    "received": DAY.replace(day=2),
    "place": "customerBranch",
    "site": {"name": "Example Works", "street": "Caliper Road", "street_no": "2", **ADDRESS},
    "replaces": {"number": "V-0", "change": "substituted", "reason": "wrong serial number"},
    "item": {
        "name": "arm",
        "maker": "Example Arms",
        "model": "A",
        "serial_number": "7",
        "inventory_number": "12",
        "condition": "scratched base",
    },
    "laboratory": {"name": "Example Laboratory", "code": "X-0", "email": "a@b.example", "phone": "0", **ADDRESS},
    "customer": {"name": "Example Customer", "street": "Gauge Street", "street_no": "1", **ADDRESS},
    "persons": [{"name": "First Example", "role": "head", "main_signer": True}, {"name": "Second Example"}],
    "conditions": {"temperature_degC": (19.5, 20.5), "relative_humidity_percent": (40.1, 55.0)},
    "set_up": {"stylus": "ball of ruby, diameter 6 mm", "mounting": "granite table", "software": "Example Measure 4.2"},
    "adjustment": {"kind": "repair", "work": "cable of joint 4 renewed"},
    "notes": {
        "deviations": "bar in five positions only",
        "external_results": "form of the ball by Example Partner",
        "from_customer": "limits of the arm",
        "agreed_interval": "12 months",
        "opinions": "joint 4 wears",
    },
}
RECALLED = load_verification_plan("iso10360-12")
CONFIRMED = confirmed(RECALLED, DAY, "iso14253-1:2013")


def about(**changes):
    """The administrative data; a change of None leaves a key away."""
    return AdministrativeData.model_validate(
        {key: value for key, value in (TOLD | changes).items() if value is not None}
    )


def row(value, limit=0.05, *, label="E_Uni, 900", budget=BUDGET, rule="iso14253-1:2013"):
    return assess_conformity(label, value, budget, limit, rule=rule, where="position 1")


ROWS = (
    row(0.0102),
    row(-0.045, label="E_Uni, 300"),
    row(0.051, label="E_Uni, 150"),
    row(0.08, label="E_Bi, 900"),
    row(0.01, None, label="L_Dia.5x5, largest distance"),
    row(0.02, budget=Budget((Contribution("form", 0.0001),)), label="P_Form.Sph.1x25"),  # U = 0.0002 mm
    ConformityResult("E_Uni, sets measured again", 0, "", Budget(), None, None, "of 35"),
)

MEASURED = count()


def outcome(rows=ROWS, *, rule="iso14253-1:2013", degC=20.5, plan=None, plan_sha256=None):
    """A verification with these rows."""

    rng = np.random.default_rng(next(MEASURED))  # no two verifications have the same points

    def group(artefact, **keys):
        return PointGroup(artefact, keys, rng.normal(size=(5, 3)), degC, 0.0, DAY, (2,))

    groups = {
        "probing": (group("ball", position="1"),),
        "uni": (group("bar", length="900", position="1", repeat="1", end="A"),),
        "single_point": (group("cone", position="near"),),
    }
    specification = Specification(
        name="arm <7> & Co", source="its data sheet", measuring_range_mm=2500.0, limits={"E_Uni": {"B_um": 50.0}}
    )
    return Verification(
        tuple(rows),
        overall_verdict(rows),
        ("not tested: bi",),
        MeasuredPoints(groups, Path("points.csv")),
        plan or confirmed(RECALLED, DAY, rule),
        ARTEFACTS,
        specification,
        rule,
        plan_sha256,
    )


def certificate(told=None, made=None, **options):
    return make_certificate(told or about(), made or outcome(), **options)
