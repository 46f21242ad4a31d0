"""Masses of an arm's links."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray

# A hundred tonnes, a kilometre: larger numbers have a wrong unit.
MAX_KG = 1e5
MAX_CENTRE_MM = 1e6


@dataclass(frozen=True, eq=False)
class LinkMasses:
    """Masses of the moving links.

    Parameters
    ----------
    mass_kg : (n_joints,) array
        Mass of the link that moves with joint i (from joint i to joint i + 1, the last one to the tip).
    centre_in_joint_mm : (n_joints, 3) array
        Its centre of mass in the frame of place i (see `truearm.arm.chain`).

    Raises
    ------
    InputError
        If the shapes do not fit, a number is not finite, a mass is negative, or one is beyond 100 t or 1 km.
    """

    mass_kg: FloatArray
    centre_in_joint_mm: FloatArray

    def __post_init__(self) -> None:
        mass, centre = np.array(self.mass_kg, dtype=float), np.array(self.centre_in_joint_mm, dtype=float)
        if mass.ndim != 1 or centre.shape != (len(mass), 3):
            raise InputError(f"expected n masses and (n, 3) centres of mass, got {mass.shape} and {centre.shape}")
        if not (np.isfinite(mass).all() and np.isfinite(centre).all() and (mass >= 0).all()):
            raise InputError(f"masses must be finite and not negative and their centres finite, got masses {mass} kg")
        if mass.max(initial=0.0) > MAX_KG or np.abs(centre).max(initial=0.0) > MAX_CENTRE_MM:
            raise InputError(
                f"expected masses of at most {MAX_KG:g} kg with centres within {MAX_CENTRE_MM:g} mm, got up to "
                f"{mass.max():g} kg and {np.abs(centre).max():g} mm",
                hint="check their units",
            )
        for name, value in (("mass_kg", mass), ("centre_in_joint_mm", centre)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)


class PointMass(NamedTuple):
    """A mass that moves with a joint.

    Attributes
    ----------
    joint : int
        Counted from 1.
    mass_kg : float
    centre_in_joint_mm : (3,) array
        In the frame of the joint's place.
    """

    joint: int
    mass_kg: float
    centre_in_joint_mm: FloatArray


def combine_point_masses(lumps: Iterable[PointMass], n_joints: int) -> LinkMasses:
    """Combine point masses to masses of links; a link without any has mass zero."""
    mass, moment = np.zeros(n_joints), np.zeros((n_joints, 3))
    for lump in lumps:
        mass[lump.joint - 1] += lump.mass_kg
        moment[lump.joint - 1] += lump.mass_kg * lump.centre_in_joint_mm
    return LinkMasses(mass, moment / np.where(mass > 0, mass, 1.0)[:, None])
