"""The errors that belong to one arm: drawn once, the same in every reading."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.arm.masses import LinkMasses
from truearm.arm.rigid_motions import cross_matrix
from truearm.identification.terms import link_vectors, uniform_links
from truearm.identification.terms.gravity import STANDARD_GRAVITY
from truearm.identification.virtual.presets import Preset
from truearm.typing import FloatArray

ARCSEC = np.pi / 180 / 3600
"""One arc second [rad]."""

ENCODER_ORDERS = (1, 2, 4)
BEARING_ORDERS = (1, 2)
# First words of the two families of streams: an arm and a session of the same seed share nothing.
SYSTEMATIC, RANDOM = 1, 2
OWN_AXIS = 2  # rotation about z among a motion's six components


@dataclass(frozen=True, eq=False)
class SystematicErrors:
    """What is wrong with one arm, as coefficients of the functions in `truearm.identification.terms`.

    Attributes
    ----------
    constants : (n_places, 6) array
        Geometry: finite motions at all places [rad, mm].
    encoder : (n_joints, 3, 2) array
        Own-axis rotation by cos and sin of 1, 2 and 4 times the joint's angle [rad].
    bearing : (n_joints, 2, 2, 6) array
        Motions by cos and sin of 1 and 2 times the joint's angle [rad, mm]; nothing about the own axis.
    masses : LinkMasses
        What hangs on the joints: the arm's own where they are known, else straight links of the preset's weight.
    gravity_in_base : (3,) array
        Acceleration of free fall along the axes of the arm's base [m/s^2].
    load_to_motion : (n_joints, 6, 6) array
        Motion of joint and link by the load they carry, torque [N m] then force [N].
    expansion_per_K : (n_joints + 1,) array
        Of the stand and the links [1/K].
    lag_s : (n_joints + 1,) array
        Time constants of their temperatures [s].
    tip_mm_per_N : float
        Deflection of the tip by the measuring force.
    hysteresis : (n_joints,) array
        Own-axis rotation by the direction of the last movement [rad].
    cage : (n_joints, 2, 6) array
        Motions by cos and sin of the ball cage's angle [rad, mm]; nothing about the own axis.
    cage_ratio : float
        Turns of the cage in a turn of the joint.
    """

    constants: FloatArray
    encoder: FloatArray
    bearing: FloatArray
    masses: LinkMasses
    gravity_in_base: FloatArray
    load_to_motion: FloatArray
    expansion_per_K: FloatArray
    lag_s: FloatArray
    tip_mm_per_N: float
    hysteresis: FloatArray
    cage: FloatArray
    cage_ratio: float

    def with_constants(self, constants: FloatArray) -> SystematicErrors:
        """Give the same with other geometry."""
        return replace(self, constants=constants)


def draw_systematic_errors(arm: Arm, preset: Preset, *, seed: int) -> SystematicErrors:
    """Draw an arm's systematic errors. Each class has its own stream, so one class changed leaves the others."""
    chain, n = arm.chain, arm.n_joints
    bearing = np.zeros((n, 2, 2, 6))
    for k, share in enumerate((1.0, preset.bearing_order2_ratio)):
        bearing[:, k] = share * _wobble(
            _stream(seed, f"bearing {k + 1}"),
            n,
            tilt_std=preset.bearing_tilt_std_arcsec * ARCSEC,
            runout_std=preset.bearing_runout_std_um * 1e-3,
        )
    masses = masses_of(arm, preset)
    temperature = _stream(seed, "temperature")
    return SystematicErrors(
        constants=draw_constants(chain, preset, _stream(seed, "geometry")),
        encoder=_encoder(n, preset, _stream(seed, "encoder")),
        bearing=bearing,
        masses=masses,
        gravity_in_base=gravity_of(arm),
        load_to_motion=_load_to_motion(chain, preset, masses, _stream(seed, "stiffness")),
        expansion_per_K=preset.expansion_per_K + preset.expansion_spread_per_K * temperature.standard_normal(n + 1),
        lag_s=preset.lag_s * temperature.uniform(0.5, 1.5, n + 1),
        tip_mm_per_N=preset.tip_compliance_um_per_N * 1e-3,
        hysteresis=preset.hysteresis_std_arcsec * ARCSEC * _stream(seed, "hysteresis").standard_normal(n),
        cage=_wobble(
            _stream(seed, "cage"),
            n,
            tilt_std=preset.cage_tilt_std_arcsec * ARCSEC,
            runout_std=preset.cage_runout_std_um * 1e-3,
        ),
        cage_ratio=preset.cage_ratio,
    )


def masses_of(arm: Arm, preset: Preset) -> LinkMasses:
    """Give the arm's own masses where they are known, else straight links of the preset's weight."""
    return uniform_links(arm.chain, kg_per_m=preset.link_kg_per_m) if arm.masses is None else arm.masses


def gravity_of(arm: Arm) -> FloatArray:
    """Give the acceleration of free fall along the axes of the arm's base, (3,) [m/s^2]."""
    return STANDARD_GRAVITY * arm.gravity_direction


def draw_constants(chain: Chain, preset: Preset, stream: np.random.Generator) -> FloatArray:
    """Geometry: a constant motion at every place, (n_places, 6) [rad, mm]. The tip only shifts."""
    constants = stream.standard_normal((chain.n_places, 6))
    constants[:, :3] *= np.radians(preset.angle_std_deg)
    constants[:, 3:] *= preset.length_std_mm
    constants[-1, :3] = 0.0
    return constants


def geometry_stream(seed: int) -> np.random.Generator:
    """Give the stream that an arm's geometry is drawn from."""
    return _stream(seed, "geometry")


def eccentric_reading(eccentricity_um: npt.ArrayLike, *, diameter_mm: float) -> FloatArray:
    """Give the error of one read head on an eccentric grating [rad]: ``2 e / D``, or 412.5 e[um]/D[mm] arcsec."""
    return 2e-3 * np.asarray(eccentricity_um, dtype=float) / diameter_mm


def _encoder(n: int, preset: Preset, stream: np.random.Generator) -> FloatArray:
    out = stream.standard_normal((n, len(ENCODER_ORDERS), 2))
    out[:, 0] = eccentric_reading(preset.eccentricity_std_um * out[:, 0], diameter_mm=preset.grating_diameter_mm)
    out[:, 1] *= preset.encoder_order2_std_arcsec * ARCSEC
    out[:, 2] *= preset.encoder_order4_std_arcsec * ARCSEC
    return out


def _wobble(stream: np.random.Generator, n: int, *, tilt_std: float, runout_std: float) -> FloatArray:
    """Cosine and sine parts of a wobble of all axes but the joint's own, (n_joints, 2, 6)."""
    out = stream.standard_normal((n, 2, 6))
    out[..., :3] *= tilt_std
    out[..., 3:] *= runout_std
    out[..., OWN_AXIS] = 0.0
    return out


def _load_to_motion(chain: Chain, preset: Preset, masses: LinkMasses, stream: np.random.Generator) -> FloatArray:
    """Compliance of each joint, and of the link after it as a beam held at the joint."""
    n = chain.n_joints
    softness = np.exp(preset.stiffness_spread * stream.standard_normal((n, 2)))
    out = np.zeros((n, 6, 6))
    tilt, drive = preset.joint_tilt_arcsec_per_Nm * ARCSEC, preset.joint_drive_arcsec_per_Nm * ARCSEC
    out[:, :3, :3] = softness[:, 0, None, None] * np.diag([tilt, tilt, drive])
    for i, link_mm in enumerate(link_vectors(chain)[1:]):
        outward_kg = masses.mass_kg[i:].sum()
        own_share = masses.mass_kg[i] / outward_kg if outward_kg > 0 else 0.0
        out[i] += softness[i, 1] * beam(
            link_mm,
            own_share=own_share,
            bending_stiffness_Nm2=preset.link_bending_stiffness_Nm2,
            torsion_stiffness_Nm2=preset.link_torsion_stiffness_Nm2,
        )
    return out


def beam(
    link_mm: FloatArray, *, own_share: float, bending_stiffness_Nm2: float, torsion_stiffness_Nm2: float
) -> FloatArray:
    """Motion at the start of a straight link that moves its far end as bending and torsion of the link do.

    Euler-Bernoulli beam, held at the start. With length L, direction u, torque M and weight F carried at the start, of
    which W is the link's own, spread evenly: slope ``(L M - L^2/2 u x (F - W) - L^2/3 u x W) / EI``, deflection
    ``(L^2/2 M - L^3/6 u x (F - W) - L^3/8 u x W) x u / EI``, twist ``L (u . M) u / GJ``.

    Parameters
    ----------
    link_mm : (3,) array
        From the joint to the link's far end, in the joint's frame [mm].
    own_share : float
        W / F.
    bending_stiffness_Nm2, torsion_stiffness_Nm2 : float
        E I and G J [N m^2]; infinite is stiff.

    Returns
    -------
    (6, 6) array
        Columns: torque [N m], force [N]; rows: rotation [rad], translation [mm].
    """
    length_m = float(np.linalg.norm(link_mm)) * 1e-3
    out = np.zeros((6, 6))
    if length_m == 0.0:
        return out
    u = np.asarray(link_mm, dtype=float) * 1e-3 / length_m
    across, cross_u = np.eye(3) - np.outer(u, u), cross_matrix(u)
    by_torque = length_m * across / bending_stiffness_Nm2
    by_force = -(length_m**2) * ((1 - own_share) / 2 + own_share / 3) * cross_u / bending_stiffness_Nm2
    out[:3, :3] = by_torque + length_m * np.outer(u, u) / torsion_stiffness_Nm2
    out[:3, 3:] = by_force
    # Deflection is a moment turned into a shift: v -> v x u.
    shift_by_torque = length_m**2 / 2 * across / bending_stiffness_Nm2
    shift_by_force = -(length_m**3) * ((1 - own_share) / 6 + own_share / 8) * cross_u / bending_stiffness_Nm2
    out[3:, :3] = -1e3 * cross_u @ shift_by_torque
    out[3:, 3:] = -1e3 * cross_u @ shift_by_force
    # The rotation about the joint already carries the far end along by r x link: take that back.
    out[3:] += cross_matrix(np.asarray(link_mm, dtype=float)) @ out[:3]
    return out


def _stream(seed: int, what: str) -> np.random.Generator:
    return np.random.default_rng([SYSTEMATIC, seed, *what.encode()])
