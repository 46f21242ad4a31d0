"""Artefacts and a specification to try a plan with, where the user's own are not at hand: chosen here, no maker's."""

from __future__ import annotations

import datetime

from truearm.verification.standards.artefacts import Artefacts, CalibratedBar, CalibratedLength, CalibratedSphere, Seat
from truearm.verification.standards.specification import Limit, Specification

# The lengths of a bar in shares of the measuring range: the longest over the 66 % that plans ask for.
SHARES = (0.06, 0.18, 0.36, 0.52, 0.68)
_FROM, _UNTIL = datetime.date(2026, 1, 1), datetime.date(2028, 1, 1)
_WHENCE = "example, no calibration"


def example_artefacts(measuring_range_mm: float) -> Artefacts:
    """A 25 mm ball, a carbon fibre bar with balls or seats at five lengths, and a seat.

    Uncertainties are those that laboratories state of such artefacts (order of magnitude): 0.2 um of a ball, 1 um of a
    length and 0.5 K with 1e-6 / K of carbon fibre, 2.5 um of the fixture of a bar.
    """
    lengths = (round(share * measuring_range_mm, -1) or 1.0 for share in SHARES)
    return Artefacts(
        spheres=(
            CalibratedSphere(
                name="ball",
                certificate=_WHENCE,
                date=_FROM,
                expires=_UNTIL,
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
                certificate=_WHENCE,
                date=_FROM,
                expires=_UNTIL,
                form_mm=0.0005,
                expansion_per_K=1e-6,
                u_expansion_per_K=0.3e-6,
                u_temperature_K=0.5,
                u_fixture_mm=0.0025,
                lengths=tuple(CalibratedLength(name=f"{one:g}", length_mm=one, u_mm=0.001) for one in lengths),
            ),
        ),
        seats=(Seat(name="seat", certificate=_WHENCE, date=_FROM, expires=_UNTIL, form_mm=0.001, u_fixture_mm=0.001),),
    )


def example_specification(measuring_range_mm: float) -> Specification:
    """Limits chosen here for an arm of a measuring range, growing with it."""
    share = measuring_range_mm / 2500.0
    micrometres = {
        "P_Size.Sph.1x25": 25.0,
        "P_Form.Sph.1x25": 40.0,
        "L_Dia.5x5": 50.0,
        "E_Uni": 60.0,
        "E_Bi": 70.0,
        "EffectiveDiameter": 25.0,
        "SPAT.Max": 40.0,
        "SPAT.2s": 50.0,
        "Volumetric.Max": 60.0,
        "Volumetric.2s": 60.0,
        "Volumetric.2RMS": 60.0,
    }
    return Specification(
        name=f"example, measuring range {measuring_range_mm:.5g} mm",
        source="limits chosen here, no maker's",
        measuring_range_mm=measuring_range_mm,
        limits={symbol: Limit(B_um=round(share * limit, 1)) for symbol, limit in micrometres.items()},
    )
