"""Presets: magnitudes of the errors of virtual arms, each with its unit and source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any

import numpy as np

from truearm.errors import InputError

ARCSEC = np.pi / 180 / 3600
"""One arc second [rad]."""

# Sources of the magnitudes, as printed in the documentation.
GAO_2018 = "identified minus nominal parameters of a 6-axis arm: Gao et al. 2018, Math. Probl. Eng. 1760190, table 2"
GRATING = "encoder makers: 412.5 e/D arcsec; raw arms 20 to 80 arcsec, compensated 1 to 4"
HARMONICS = "order of magnitude: raw 2 to 10 and 0.5 to 2 arcsec (orders 2 and 4), compensated 0.5 to 2"
BEARING = "order of magnitude for preloaded pairs: run-out 1 to 5 um, tilt 2 to 20 arcsec"
STIFFNESS = "estimated: a preloaded bearing pair, 1e5 to 2e5 N m/rad"
TUBE = "computed: carbon fibre tube 80 x 4 mm, E 70 GPa, G 25 GPa"
EXPANSION = "order of magnitude: carbon fibre -0.5e-6 to 2e-6 /K, aluminium 23e-6 /K"
LAG = "order of magnitude: 5 to 20 min a link"
ENCODER = "computed: step 1 296 000 arcsec / counts; noise of good heads 0.1 to 0.5 arcsec, of a joint about 1"
FORCE = "order of magnitude: 1 to 10 N by hand; steel stylus 4 x 50 mm 15.8 um/N, tungsten carbide 5.3 um/N (computed)"
REFERENCE = "order of magnitude: laser tracker or calibrated gauge in a laboratory"
SEAT = "order of magnitude: three-ball seat 2 to 8 um"
CAGE = "geometry of ball bearings: the cage turns at about 0.4 of the shaft"
WEAR = "chosen: with the other wear 30 to 50 % of what identification leaves of the error"
HUNTING = "chosen: a gear of 101 and 2 teeth repeats after two turns"
SERVO = "geometry: a horn on a spline of 25 teeth is set to 14.4 deg; within half a tooth by care, one beside by haste"
CHOICE = "chosen: kept small beside the noise, since no linear term describes it"
PAPER = "Gao et al. 2017, Complexity 5156264, section 4: 0.4492 mm mean, 0.8978 mm maximum over 200 poses"


def _magnitude(unit: str, source: str, *, default: float = 0.0, positive: bool = False) -> Any:
    return field(default=default, metadata={"unit": unit, "source": source, "positive": positive})


@dataclass(frozen=True)
class Preset:
    """Magnitudes of the errors of virtual arms, by default zero: a perfect arm.

    Magnitudes of *systematic* errors are standard deviations of one draw per arm; those of noise are standard
    deviations of one draw per reading. `magnitudes` lists every one with its unit and source.
    """

    name: str = "custom"
    about: str = ""

    # Geometry: constant motions at all places.
    length_std_mm: float = _magnitude("mm", GAO_2018)
    angle_std_deg: float = _magnitude("deg", GAO_2018)

    zero_std_deg: float = _magnitude("deg, of each joint's zero beyond `angle_std_deg`", SERVO)

    # Encoders: systematic, own axis.
    eccentricity_std_um: float = _magnitude("um, each direction", GRATING)
    grating_diameter_mm: float = _magnitude("mm", GRATING, default=60.0, positive=True)
    encoder_order2_std_arcsec: float = _magnitude("arcsec, cos and sin each", HARMONICS)
    encoder_order4_std_arcsec: float = _magnitude("arcsec, cos and sin each", HARMONICS)

    # Bearings: systematic, five other axes; the second order is half of the first unless stated.
    bearing_runout_std_um: float = _magnitude("um, cos and sin each, order 1", BEARING)
    bearing_tilt_std_arcsec: float = _magnitude("arcsec, cos and sin each, order 1", BEARING)
    bearing_order2_ratio: float = _magnitude("order 2 over order 1", BEARING, default=0.5)

    # Gravity: systematic.
    link_kg_per_m: float = _magnitude(
        "kg/m", "estimated: 10 to 20 N beyond the elbow of an arm with 1.3 m reach", default=2.0
    )
    joint_tilt_arcsec_per_Nm: float = _magnitude("arcsec/(N m), normal to the axis", STIFFNESS)
    joint_drive_arcsec_per_Nm: float = _magnitude(
        "arcsec/(N m), about the axis", "zero: a joint turned by hand bears no torque about its axis"
    )
    link_bending_stiffness_Nm2: float = _magnitude("N m^2 (E I); inf is stiff", TUBE, default=np.inf)
    link_torsion_stiffness_Nm2: float = _magnitude("N m^2 (G J); inf is stiff", TUBE, default=np.inf)
    stiffness_spread: float = _magnitude("relative, from joint to joint", "chosen")

    # Temperature: systematic coefficients, and the air of a session.
    expansion_per_K: float = _magnitude("1/K", EXPANSION)
    expansion_spread_per_K: float = _magnitude("1/K, from link to link", EXPANSION)
    temperature_degC: float = _magnitude("degC, mean of the air", "chosen", default=20.0)
    temperature_swing_K: float = _magnitude("K, amplitude of the air", "chosen")
    temperature_period_s: float = _magnitude("s, of the air", "chosen", default=7200.0, positive=True)
    reading_interval_s: float = _magnitude("s, between readings", "chosen", default=5.0)
    lag_s: float = _magnitude("s, time constant of the links behind the air", LAG)

    # Force of the operator, at the tip.
    tip_compliance_um_per_N: float = _magnitude("um/N", FORCE)
    force_mean_N: float = _magnitude("N", FORCE)
    force_std_N: float = _magnitude("N, per reading", FORCE)
    force_tilt_deg: float = _magnitude("deg, contact normal about the probe axis, per reading", "chosen")

    # Effects that no linear term describes: systematic magnitudes.
    hysteresis_std_arcsec: float = _magnitude("arcsec, half the gap between the two directions", CHOICE)
    cage_tilt_std_arcsec: float = _magnitude("arcsec, cos and sin each", CHOICE)
    cage_runout_std_um: float = _magnitude("um, cos and sin each", CHOICE)
    cage_ratio: float = _magnitude("turns of the cage in a turn of the joint", CAGE, default=0.4)

    # Wear, which no term describes: spots, gears, slack, cables, and a base that moves.
    gear_spot_std_arcsec: float = _magnitude("arcsec, bumps about the axis; a few are large", WEAR)
    bearing_spot_std_arcsec: float = _magnitude("arcsec, tilts normal to the axis; a few are large", WEAR)
    spot_width_deg: float = _magnitude(
        "deg, standard deviation of a bump's Gaussian", "chosen", default=3.0, positive=True
    )
    gear_std_arcsec: float = _magnitude("arcsec, cos, sin and two sawteeth each", WEAR)
    gear_ratio: float = _magnitude("periods of the gear in a turn of the joint", HUNTING, default=50.5, positive=True)
    slack_std_arcsec: float = _magnitude("arcsec, half the gap about the axis, by the side of the load", WEAR)
    slack_zone_Nm: float = _magnitude("N m, load that closes the gap", "chosen", default=0.5, positive=True)
    cable_std_arcsec: float = _magnitude("arcsec about the axis, by a cable across this joint and the next", WEAR)
    base_settling_um: float = _magnitude("um, each coordinate, per session", WEAR)
    base_creep_um_per_sqrt_h: float = _magnitude("um/h^(1/2), each coordinate, random walk in a session", WEAR)
    base_creep_arcsec_per_sqrt_h: float = _magnitude("arcsec/h^(1/2), each axis, random walk in a session", WEAR)

    # Noise: random, per reading.
    encoder_counts: float = _magnitude("counts a turn; 0 reads continuously", ENCODER)
    encoder_noise_arcsec: float = _magnitude("arcsec", ENCODER)
    reference_std_mm: float = _magnitude("mm, each coordinate", REFERENCE)
    seat_std_mm: float = _magnitude("mm, each coordinate, tip in its seat", SEAT)

    # Constrained draw: keep only arms whose nominal model errs as a known arm's does.
    nominal_mean_mm: float = _magnitude("mm, mean absolute coordinate error of the nominal model; 0 is free", PAPER)
    nominal_max_mm: float = _magnitude("mm, its maximum over `constraint_poses` poses", PAPER)
    nominal_max_tolerance_mm: float = _magnitude(
        "mm, on the maximum of each of thirty such tests", "chosen", default=0.04
    )
    constraint_poses: int = _magnitude("poses in one test", PAPER, default=200, positive=True)
    constraint_half_width_deg: float = _magnitude(
        "deg about the working pose", "chosen: the paper states no box; that of strategy `box`", default=20.0
    )

    def __post_init__(self) -> None:
        for part in fields(self):
            value = getattr(self, part.name)
            if part.metadata and not (isinstance(value, int | float) and _may_be(part, value)):
                raise InputError(
                    f"preset {self.name!r}: {part.name} must be a number >= 0 [{part.metadata['unit']}], got {value!r}"
                )
        if self.nominal_mean_mm > 0 and self.length_std_mm == self.angle_std_deg == 0:
            raise InputError(
                f"preset {self.name!r}: a constrained nominal error needs errors of the geometry; their magnitudes are "
                "zero"
            )
        if (self.nominal_mean_mm > 0) != (self.nominal_max_mm > self.nominal_mean_mm):
            raise InputError(
                f"preset {self.name!r}: nominal_mean_mm needs a larger nominal_max_mm, "
                f"got {self.nominal_mean_mm} and {self.nominal_max_mm} mm"
            )


def _may_be(part: Field[Any], value: float) -> bool:
    """Whether a value is in the range of a magnitude."""
    if part.name.endswith("stiffness_Nm2"):
        return value > 0
    return bool(0 < value < np.inf if part.metadata["positive"] else 0 <= value < np.inf)


@dataclass(frozen=True)
class Magnitude:
    """One magnitude of a preset, as in the table of the documentation."""

    name: str
    value: float
    unit: str
    source: str


def magnitudes(preset: Preset) -> list[Magnitude]:
    """Every magnitude of a preset with its unit and source, in reading order."""
    return [
        Magnitude(part.name, getattr(preset, part.name), part.metadata["unit"], part.metadata["source"])
        for part in fields(preset)
        if part.metadata
    ]


PERFECT = Preset(name="perfect", about="no errors and no noise: the nominal arm itself")

# What a hand-guided arm has in a laboratory as in a workshop.
_HAND_GUIDED = Preset(
    expansion_spread_per_K=1e-6,
    lag_s=600.0,
    tip_compliance_um_per_N=5.3,
    force_mean_N=2.0,
    force_tilt_deg=20.0,
    encoder_counts=2**20,
    seat_std_mm=0.003,
)

RESEARCH = replace(
    _HAND_GUIDED,
    name="research",
    about="a research arm before identification, with the nominal error of the arm of Gao et al. 2017",
    length_std_mm=0.3,
    angle_std_deg=0.03,
    eccentricity_std_um=2.0,
    encoder_order2_std_arcsec=3.0,
    encoder_order4_std_arcsec=0.7,
    bearing_runout_std_um=1.5,
    bearing_tilt_std_arcsec=2.0,
    joint_tilt_arcsec_per_Nm=1.0,
    link_bending_stiffness_Nm2=48e3,
    link_torsion_stiffness_Nm2=34e3,
    stiffness_spread=0.2,
    expansion_per_K=2e-6,
    temperature_swing_K=1.5,
    force_std_N=0.4,
    hysteresis_std_arcsec=0.25,
    cage_tilt_std_arcsec=0.1,
    cage_runout_std_um=0.2,
    encoder_noise_arcsec=1.0,
    reference_std_mm=0.0068,
    nominal_mean_mm=0.449,
    nominal_max_mm=0.898,
)

SHOP = replace(
    _HAND_GUIDED,
    name="shop",
    about="a good 2.5 m measuring arm in a workshop: compensated by its maker, temperature varying",
    # Calibrated arms keep 5 to 30 um and 1 to 3 arcsec, but correlated, so that the tip errs less. Independent draws
    # must be smaller: these give 0.03 mm in a single-point articulation test of ten very different poses.
    length_std_mm=0.003,
    angle_std_deg=0.3 / 3600,
    eccentricity_std_um=0.1,
    encoder_order2_std_arcsec=0.5,
    encoder_order4_std_arcsec=0.3,
    bearing_runout_std_um=1.0,
    bearing_tilt_std_arcsec=0.5,
    joint_tilt_arcsec_per_Nm=0.05,
    link_bending_stiffness_Nm2=48e4,
    link_torsion_stiffness_Nm2=34e4,
    stiffness_spread=0.5,
    expansion_per_K=1e-6,
    temperature_degC=22.0,
    temperature_swing_K=3.0,
    force_std_N=0.7,
    hysteresis_std_arcsec=0.3,
    cage_tilt_std_arcsec=0.3,
    cage_runout_std_um=0.5,
    encoder_noise_arcsec=0.5,
    reference_std_mm=0.003,
)

WORN = replace(
    SHOP,
    name="worn",
    about="the measuring arm of the shop after years of use: damaged spots, slack, cable drag, a base that creeps",
    gear_spot_std_arcsec=1.5,
    bearing_spot_std_arcsec=1.5,
    gear_std_arcsec=0.8,
    slack_std_arcsec=2.0,
    cable_std_arcsec=4.0,
    base_settling_um=2.5,
    base_creep_um_per_sqrt_h=2.0,
    base_creep_arcsec_per_sqrt_h=0.5,
)

# Orders of magnitude for arms of the hobby: prints shrink by 0.2 to 0.5 %, screws and holes have play; servos with 4096
# counts a turn and a dead band or backlash of some 0.25 to 0.5 deg; PLA has E 2.5 GPa, G 0.9 GPa, 70e-6 /K, and a
# printed box of 30 x 30 mm with walls of 3 mm 4e-8 m^4; a camera or a tape reads to 0.5 to 2 mm.
PRINTED = Preset(
    name="printed",
    about="a printed plastic arm with hobby servos: horns a tooth off, backlash, soft links, read with a camera",
    length_std_mm=1.0,
    angle_std_deg=0.5,
    zero_std_deg=8.0,
    link_kg_per_m=1.0,
    joint_tilt_arcsec_per_Nm=300.0,
    joint_drive_arcsec_per_Nm=1000.0,
    link_bending_stiffness_Nm2=100.0,
    link_torsion_stiffness_Nm2=70.0,
    stiffness_spread=0.3,
    expansion_per_K=70e-6,
    hysteresis_std_arcsec=450.0,
    slack_std_arcsec=450.0,
    slack_zone_Nm=0.05,
    encoder_counts=4096,
    encoder_noise_arcsec=180.0,
    reference_std_mm=1.0,
)

PRESETS: Mapping[str, Preset] = {preset.name: preset for preset in (PERFECT, RESEARCH, SHOP, WORN, PRINTED)}


def load_preset(name: str) -> Preset:
    """Return a preset by its name.

    Raises
    ------
    InputError
        If there is no preset of that name.
    """
    if name not in PRESETS:
        raise InputError(f"expected a preset among {', '.join(PRESETS)}, got {name!r}")
    return PRESETS[name]
