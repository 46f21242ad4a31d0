"""Errors of a worn arm: terms that identification never offers, as no smooth function of one angle describes them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import radians

from truearm.arm.chain import Chain
from truearm.identification.terms import Basis, Column, Term
from truearm.identification.virtual.bases import CableDrag, GearErrors, Slack, Spots
from truearm.identification.virtual.error_class import DrawnTerm, ErrorClass
from truearm.identification.virtual.presets import ARCSEC, Preset
from truearm.identification.virtual.state import base_motion_column

SPOTS, GEARS, SLACK, CABLES, BASE = WEAR_GROUPS = ("spots", "gears", "slack", "cable drag", "base motion")
"""Groups of the terms of a worn arm."""

_OWN_AXIS = 2
_DAMAGE = 3  # power of the random numbers of spots, see `ErrorClass`


def wear_classes(chain: Chain, preset: Preset) -> tuple[ErrorClass, ...]:
    """Classes of the errors of wear."""
    joints, before_last = range(1, chain.n_joints + 1), range(1, chain.n_joints)

    def spots(joint: int) -> Basis:
        return Spots(joint, radians(preset.spot_width_deg))

    def gear(joint: int) -> Basis:
        return GearErrors(joint, preset.gear_ratio)

    def slack(joint: int) -> Basis:
        return Slack(joint, preset.slack_zone_Nm)

    gear_spot, bearing_spot = preset.gear_spot_std_arcsec, preset.bearing_spot_std_arcsec
    base = tuple(_base(preset))
    return (
        _turns("gear spot", SPOTS, joints, spots, gear_spot, power=_DAMAGE),
        _turns("bearing spot x", SPOTS, joints, spots, bearing_spot, axis=0, power=_DAMAGE),
        _turns("bearing spot y", SPOTS, joints, spots, bearing_spot, axis=1, power=_DAMAGE),
        _turns("gear", GEARS, joints, gear, preset.gear_std_arcsec),
        _turns("slack", SLACK, joints, slack, preset.slack_std_arcsec),
        _turns("cable", CABLES, before_last, CableDrag, preset.cable_std_arcsec),
        ErrorClass("base motion", base, len(base)),
    )


def _turns(
    stream: str,
    group: str,
    joints: Iterable[int],
    basis: Callable[[int], Basis],
    std_arcsec: float,
    *,
    axis: int = _OWN_AXIS,
    power: int = 1,
) -> ErrorClass:
    """A class of rotations of joints, each coefficient with a number of its own."""
    rows, first = [], 0
    direction = tuple(float(component == axis) for component in range(6))
    for joint in joints if std_arcsec > 0 else ():
        term = Term(f"J{joint} {stream}", joint, direction, basis(joint), group, std_arcsec * ARCSEC)
        rows.append(DrawnTerm(term, tuple(range(first, first + term.n_coefficients))))
        first += term.n_coefficients
    return ErrorClass(stream, tuple(rows), first, power=power)


def _base(preset: Preset) -> Iterator[DrawnTerm]:
    """Motion of the base, which the state of a session states in rad and mm."""
    turns = preset.base_creep_arcsec_per_sqrt_h > 0
    shifts = preset.base_creep_um_per_sqrt_h > 0 or preset.base_settling_um > 0
    for component in (*range(3 if turns else 0), *range(3, 6 if shifts else 3)):
        column = base_motion_column(component)
        direction = tuple(float(other == component) for other in range(6))
        yield DrawnTerm(Term(column, 0, direction, Column(column), BASE, 1.0), (0,), mean=1.0, std=0.0)
